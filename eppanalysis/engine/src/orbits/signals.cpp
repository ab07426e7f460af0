#include "orbits/signals.hpp"

namespace epp {
inline namespace EPP_ARCH {

namespace orbits_signals {

/// y at increasing `times` of one period, each by its own flow from the start of its arc.
template <class C>
void states_at(const C& channels, Matrices F, Matrices S, Indices smooth, Matrix starts, Vector marks,
    Vector times, Matrix out) {
    Scope scope;
    double t{};
    NumbersOf<C> own{};
    i64 p = F.shape(0);
    i64 n = F.shape(1);
    i64 N = F.shape(2);
    Matrices square = orbits_flow::room(F);
    Matrix Phi = zeros<double>(N, N);
    Vector sigma = zeros<double>(S.shape(2));
    Vector slope = zeros<double>(S.shape(2));
    i64 a = 0;
    for (i64 i = 0; i < times.size(); ++i) {
        while (a < (p - 1) && times(i) > marks(a + 1)) {
            a += 1;
        }
        t = times(i) - marks(a);
        if (smooth(a)) {
            own = orbits_flow::numbers_of(channels, F.row(a), S.row(a));
            orbits_flow::smooth_flow(channels, a, F.row(a), S.row(a), starts.row(a), t, MOST_SERIES, out.row(i), Phi,
                sigma, slope, own);
        } else {
            orbits_flow::affine_flow(F.row(a), starts.row(a), t, out.row(i), Phi, square);
        }
    }
}

/// In how many steps of an affine arc no signal turns twice in one: where powers of F grow within it, in more.
i64 steps_of(Matrix F, double tau, Matrices square) {
    i64 moving = least_of<i64>(F.shape(0), square.shape(1));
    for (i64 i = 0; i < moving; ++i) {
        filling::fill(square.row(0, i).slice(0, moving), F.row(i).slice(0, moving));
    }
    return i64(least_of(greatest_of(PER_TURN * epp::growth_rate(square.row(0), square.row(3), square.row(4)) * tau,
        double(FEWEST)), double(MOST)));
}

/// One more step of an affine arc.
void carry(Matrix Phi, Vector y, Vector out, i64 n) {
    double v{};
    i64 N = y.size();
    for (i64 i = 0; i < n; ++i) {
        v = 0.0;
        for (i64 j = 0; j < N; ++j) {
            v += Phi(i, j) * y(j);
        }
        out(i) = v;
    }
    for (i64 i = n; i < N; ++i) {
        out(i) = y(i);
    }
}

/// Fill in the terms by which a signal changes over a step of an affine arc; their number, 0 where they go on.
i64 series_of(Vector Y, Matrix F, Vector rate, double d, Vector terms) {
    Scope scope;
    i64 n = F.shape(0);
    double size = 0.0;
    double before = INF;
    Vector motion = empty<double>(n);
    Vector moved = empty<double>(n);
    for (i64 i = 0; i < n; ++i) {
        motion(i) = d * rate(i);
    }
    for (i64 k = 0; k < TERMS; ++k) {
        terms(k) = 0.0;
        for (i64 i = 0; i < n; ++i) {
            terms(k) += Y(i) * motion(i);
        }
        size += std::fabs(terms(k));
        // Two terms: of an odd or even motion every other one is zero.
        if ((std::fabs(terms(k)) + before) <= (BENEATH * size)) {
            return k + 1;
        }
        before = std::fabs(terms(k));
        for (i64 i = 0; i < n; ++i) {
            moved(i) = 0.0;
            for (i64 j = 0; j < n; ++j) {
                moved(i) += F(i, j) * motion(j);
            }
        }
        for (i64 i = 0; i < n; ++i) {
            motion(i) = moved(i) * d / (k + 2);
        }
    }
    return 0;
}

/// Sum of a series at a share of its step, and its first two derivatives by that.
std::tuple<double, double, double> sum_at(Vector terms, double share) {
    double value = 0.0;
    double slope = 0.0;
    double bend = 0.0;
    for (i64 k = terms.size() - 1; k > -1; --k) {
        bend = bend * share + 2.0 * slope;
        slope = slope * share + value;
        value = value * share + terms(k);
    }
    // The first term goes with the share itself.
    return {value * share, slope * share + value, bend * share + 2.0 * slope};
}

/// Value of a signal where its rate vanishes inside a step: by Newton's method on the rate, where it stays inside.
///
/// Else, and with smooth channels, by regula falsi (Illinois).
template <class C>
double turning_value(const C& channels, i64 a, Matrix F, Matrix S, i64 smooth, Vector Y, Vector Ys, Vector y,
    double d, double left, double right, Vector end, Matrices square) {
    Scope scope;
    double slope{};
    NumbersOf<C> own{};
    i64 N = y.size();
    Matrix Phi = zeros<double>(N, N);
    Vector rate = zeros<double>(N);
    Vector sigma = zeros<double>(S.shape(1));
    Vector change = zeros<double>(S.shape(1));
    double t0 = 0.0;
    double t1 = d;
    double t = 0.0;
    double value = 0.0;
    double bend = 0.0;
    double begin = 0.0;
    i64 count = 0;
    Vector terms = empty<double>(TERMS);
    if (!smooth) {
        orbits_flow::rate_at(F, S, y, sigma, rate);
        count = series_of(Y, F, rate, d, terms);
        for (i64 j = 0; j < N; ++j) {
            begin += Y(j) * y(j);
        }
    }
    for (i64 turn_ = 0; turn_ < 12; ++turn_) {
        if (!(t0 < t && t < t1)) {
            t = (t0 * right - t1 * left) / (right - left);
        }
        if (count > 0) {
            std::tie(value, slope, bend) = sum_at(terms.slice(0, count), t / d);
            value = begin + value;
            slope = slope / d;
            bend = bend / (d * d);
        } else {
            if (smooth) {
                own = orbits_flow::numbers_of(channels, F, S);
                orbits_flow::smooth_flow(channels, a, F, S, y, t, MOST_SERIES, end, Phi, sigma, change, own);
            } else {
                orbits_flow::affine_flow(F, y, t, end, Phi, square);
            }
            orbits_flow::rate_at(F, S, end, sigma, rate);
            value = 0.0;
            slope = 0.0;
            for (i64 j = 0; j < N; ++j) {
                value += Y(j) * end(j);
                slope += Y(j) * rate(j);
            }
            if (smooth) {
                for (i64 j = 0; j < sigma.size(); ++j) {
                    value += Ys(j) * sigma(j);
                }
            }
        }
        if ((slope * right) > 0.0) {
            t1 = t;
            right = slope;
            left = 0.5 * left;
        } else {
            t0 = t;
            left = slope;
            right = 0.5 * right;
        }
        // The value is off by the rate times what is left of the interval, to second order.
        if ((std::fabs(slope) * d) <= (1e-09 * std::fabs(value)) || (t1 - t0) <= (1e-09 * d)) {
            break;
        }
        if (count == 0) {
            bend = 0.0;
            for (i64 i = 0; i < F.shape(0); ++i) {
                if (Y(i) != 0.0) {
                    for (i64 j = 0; j < N; ++j) {
                        bend += Y(i) * F(i, j) * rate(j);
                    }
                }
            }
        }
        t = (smooth || bend == 0.0) ? -1.0 : t - slope / bend;
    }
    return value;
}

/// Smallest and largest value of every signal over an orbit, exact: nodes on every arc, then Newton on the rate.
template <class C>
void extents(const C& channels, Matrices F, Matrices S, Indices smooth, Matrices Y, Matrices Ys, Matrix starts,
    Vector tau, Vector low, Vector high) {
    Scope scope;
    i64 steps{};
    Matrix node{}, value{}, slope{};
    double d{}, reach{}, left{}, right{}, v{};
    NumbersOf<C> own{};
    bool turns_over{};
    i64 p = F.shape(0);
    i64 n = F.shape(1);
    i64 N = F.shape(2);
    i64 n_y = Y.shape(1);
    Vector rate = zeros<double>(N);
    Matrices square = orbits_flow::room(F);
    Matrix Phi = zeros<double>(N, N);
    Vector row = zeros<double>(N);
    Vector sigma = zeros<double>(S.shape(2));
    Vector change = zeros<double>(S.shape(2));
    low.fill(INF);
    high.fill(-INF);
    for (i64 a = 0; a < p; ++a) {
        if (tau(a) <= 0.0) {
            continue;
        }
        steps = smooth(a) ? FEWEST : steps_of(F.row(a), tau(a), square);
        node = zeros<double>(steps + 1, N);
        value = zeros<double>(steps + 1, n_y);
        slope = zeros<double>(steps + 1, n_y);
        d = tau(a) / steps;
        filling::fill(node.row(0), starts.row(a));
        for (i64 k = 0, k_end = steps + 1; k < k_end; ++k) {
            if (k && smooth(a)) {
                own = orbits_flow::numbers_of(channels, F.row(a), S.row(a));
                orbits_flow::smooth_flow(channels, a, F.row(a), S.row(a), node.row(k - 1), d, MOST_SERIES, node.row(k),
                    Phi, sigma, change, own);
            } else if (k == 1) {
                orbits_flow::affine_flow(F.row(a), node.row(0), d, node.row(1), Phi, square);
            } else if (k) {
                carry(Phi, node.row(k - 1), node.row(k), n);
            }
            orbits_flow::channels_at(channels, a, node.row(k).slice(0, n), node.row(k).slice(n, node.shape(1)), sigma,
                change);
            orbits_flow::rate_at(F.row(a), S.row(a), node.row(k), sigma, rate);
            // Rates at the nodes tell in which steps a signal turns: extrema at a switch are nodes, all others lie
            // inside a step.
            for (i64 s = 0; s < n_y; ++s) {
                value(k, s) = 0.0;
                slope(k, s) = 0.0;
                for (i64 j = 0; j < N; ++j) {
                    value(k, s) += Y(a, s, j) * node(k, j);
                    slope(k, s) += Y(a, s, j) * rate(j);
                }
                for (i64 j = 0; j < sigma.size(); ++j) {
                    if (smooth(a)) {
                        value(k, s) += Ys(a, s, j) * sigma(j);
                    }
                }
            }
        }
        for (i64 s = 0; s < n_y; ++s) {
            for (i64 k = 0, k_end = steps + 1; k < k_end; ++k) {
                {
                    const double was1 = least_of(low(s), value(k, s));
                    const double was2 = greatest_of(high(s), value(k, s));
                    low(s) = was1;
                    high(s) = was2;
                }
            }
        }
        for (i64 s = 0; s < n_y; ++s) {
            for (i64 k = 0; k < steps; ++k) {
                turns_over = slope(k, s) > 0.0 && slope(k + 1, s) < 0.0;
                if (!turns_over && !(slope(k, s) < 0.0 && slope(k + 1, s) > 0.0)) {
                    continue;
                }
                // A cubic exceeds its end values by at most 4/27 d of its end rates: where that does not reach the
                // extremum so far, it is not looked for.
                reach = 0.15 * d * (std::fabs(slope(k, s)) + std::fabs(slope(k + 1, s)));
                if (turns_over && (greatest_of(value(k, s), value(k + 1, s)) + reach) <= high(s)) {
                    continue;
                }
                if (!turns_over && (least_of(value(k, s), value(k + 1, s)) - reach) >= low(s)) {
                    continue;
                }
                left = slope(k, s);
                right = slope(k + 1, s);
                v = turning_value(channels, a, F.row(a), S.row(a), smooth(a), Y.row(a, s), Ys.row(a, s), node.row(k),
                    d, left, right, row, square);
                {
                    const double was3 = least_of(low(s), v);
                    const double was4 = greatest_of(high(s), v);
                    low(s) = was3;
                    high(s) = was4;
                }
            }
        }
    }
}

// Where no smooth channel acts, and where some do.
template void states_at(const None& channels, Matrices F, Matrices S, Indices smooth, Matrix starts, Vector marks,
    Vector times, Matrix out);
template void states_at(const Channels& channels, Matrices F, Matrices S, Indices smooth, Matrix starts, Vector marks,
    Vector times, Matrix out);
template double turning_value(const None& channels, i64 a, Matrix F, Matrix S, i64 smooth, Vector Y, Vector Ys, Vector y,
    double d, double left, double right, Vector end, Matrices square);
template double turning_value(const Channels& channels, i64 a, Matrix F, Matrix S, i64 smooth, Vector Y, Vector Ys, Vector y,
    double d, double left, double right, Vector end, Matrices square);
template void extents(const None& channels, Matrices F, Matrices S, Indices smooth, Matrices Y, Matrices Ys, Matrix starts,
    Vector tau, Vector low, Vector high);
template void extents(const Channels& channels, Matrices F, Matrices S, Indices smooth, Matrices Y, Matrices Ys, Matrix starts,
    Vector tau, Vector low, Vector high);

}  // namespace orbits_signals
}  // namespace EPP_ARCH
}  // namespace epp
