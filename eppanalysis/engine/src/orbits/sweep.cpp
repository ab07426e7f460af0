#include "orbits/sweep.hpp"

namespace epp {
inline namespace EPP_ARCH {

namespace orbits_sweep {

/// out = P Q over the first columns; rows of P from n_dense on are those of the identity.
void times(Matrix P, Matrix Q, Matrix out, i64 n_dense, i64 n_columns) {
    double f{};
    i64 N = P.shape(0);
    for (i64 i = 0; i < n_dense; ++i) {
        for (i64 j = 0; j < n_columns; ++j) {
            out(i, j) = 0.0;
        }
        for (i64 k = 0; k < N; ++k) {
            f = P(i, k);
            if (f != 0.0) {
                for (i64 j = 0; j < n_columns; ++j) {
                    out(i, j) += f * Q(k, j);
                }
            }
        }
    }
    for (i64 i = n_dense; i < N; ++i) {
        for (i64 j = 0; j < n_columns; ++j) {
            out(i, j) = Q(i, j);
        }
    }
}

/// What the smooth channels add to a guard's value, and to its derivative by y in `row`.
double guard_channels(None channels, Vector gs, Vector sigma, Vector slope, Vector row) {
    double value = 0.0;
    return value;
}

/// Row of Newton's equations for the dwell time of an arc (at `place`), and its residual.
void guard_equation(i64 at_once, double tau, double value, Vector row, Matrix E, Vector A, Vector r, i64 place) {
    // Of events at one instant only the first waits for its guard.
    if (at_once == 1) {
        A(place) = 1.0;
        r(0) = tau;
        return;
    }
    r(0) = value;
    for (i64 i = 0; i < row.size(); ++i) {
        if (row(i) != 0.0) {
            for (i64 j = 0, j_end = place + 1; j < j_end; ++j) {
                A(j) += row(i) * E(i, j);
            }
        }
    }
    // The arc begins on the guard that ends it: divide, so that Newton does not fall back on the begin.
    if (at_once == 2 && tau != 0.0) {
        r(0) /= tau;
        for (i64 j = 0, j_end = place + 1; j < j_end; ++j) {
            A(j) /= tau;
        }
        A(place) -= r(0) / tau;
    }
}

/// Derivative of a guard by each smooth channel, by way of those that have it in their argument too.
Vector weights(const Channels& channels, Vector gs, Vector slope) {
    double through{};
    Vector weight = copy_of(gs);
    // From the last channel back: each hands its weight on to those in its argument.
    for (i64 j = weight.size() - 1; j > 0; --j) {
        through = weight(j) * slope(j);
        for (i64 i = 0; i < j; ++i) {
            weight(i) += through * channels.smooth_s(j, i);
        }
    }
    return weight;
}

/// What the smooth channels add to a guard's value, and to its derivative by y in `row`.
double guard_channels(const Channels& channels, Vector gs, Vector sigma, Vector slope, Vector row) {
    Scope scope;
    double through{};
    double value = 0.0;
    i64 n = channels.smooth_x.shape(1);
    Vector weight = weights(channels, gs, slope);
    for (i64 j = sigma.size() - 1; j > -1; --j) {
        value += gs(j) * sigma(j);
        through = weight(j) * slope(j);
        if (through != 0.0) {
            filling::accumulate(row.slice(0, n), through, channels.smooth_x.row(j));
            filling::accumulate(row.slice(n, row.shape(0)), through, channels.smooth_H.row(j));
        }
    }
    return value;
}

/// Value of the guard that ends an arc, and its derivative by y into `row`, at the arc's end.
template <class C>
double guard_at(const C& channels, Vector g, Vector gs, i64 smooth, Vector end, Vector sigma, Vector slope,
    Vector row) {
    filling::fill(row, g);
    double value = smooth ? guard_channels(channels, gs, sigma, slope, row) : 0.0;
    for (i64 j = 0; j < end.size(); ++j) {
        value += g(j) * end(j);
    }
    return value;
}

/// Run along the arcs from y0, and set up Newton's equations for the free part of y0 and the dwell times.
///
/// Parameters
/// ----------
/// F, S, g, gs, J, smooth : arrays
///     See `build_arcs`.
/// at_once : int array (p,)
///     1 where the event follows the one before without delay (its dwell time is zero, whatever its guard); 2 where the
///     arc begins on the guard that ends it (its equation is divided by the dwell time).
/// y0, tau : arrays (N,), (p,)
///     Start, dwell times.
/// free : int array (m,)
///     Places of y that must repeat.
/// shift : array (N,)
///     What a clock, and what is measured by it, advances per unit of time.
/// most : int
///     Series that may be made; the motion is not a number behind them.
/// starts, ends : arrays (p + 1, N), (p, N)
///     Filled with y behind and before each event.
/// A, r : arrays (m + p, m + p), (m + p,)
///     Filled with the derivative and the residual of (periodicity, guards).
/// speed : array (p,)
///     Filled with the rate at which each guard is crossed.
///
/// Returns
/// -------
/// int
///     Series that were made, those that did not converge too.
template <class C>
i64 sweep(const C& channels, Matrices F, Matrices S, Matrix g, Matrix gs, Matrices J, Indices smooth,
    Indices at_once, Vector y0, Vector tau, Indices free, Vector shift, i64 most, Matrix starts, Matrix ends, Matrix A,
    Vector r, Vector speed) {
    Scope scope;
    i64 i{};
    Vector end{};
    NumbersOf<C> own{};
    double value{}, v{};
    i64 p = F.shape(0);
    i64 n = F.shape(1);
    i64 N = F.shape(2);
    i64 m = free.size();
    i64 made = 0;
    Vector sigma = zeros<double>(S.shape(2));
    Vector slope = zeros<double>(S.shape(2));
    Matrix D = zeros<double>(N, m + p);
    Matrix E = zeros<double>(N, m + p);
    Vector row = zeros<double>(N);
    Matrix Phi = zeros<double>(N, N);
    Vector rate = zeros<double>(N);
    Matrices square = orbits_flow::room(F);
    A.fill(0.0);
    r.fill(0.0);
    // E and D carry the derivative of y before and behind each event, by the free part of the start and by the dwell
    // times so far: one pass gives the residual and Newton's matrix, from which the multipliers come, too.
    for (i64 k = 0; k < m; ++k) {
        D(free(k), k) = 1.0;
    }
    Vector y = copy_of(y0);
    for (i64 a = 0; a < p; ++a) {
        filling::fill(starts.row(a), y);
        if (smooth(a)) {
            own = orbits_flow::numbers_of(channels, F.row(a), S.row(a));
            made += orbits_flow::smooth_flow(channels, a, F.row(a), S.row(a), y, tau(a), most - made, ends.row(a), Phi,
                sigma, slope, own);
        } else {
            sigma.fill(0.0);
            slope.fill(0.0);
            orbits_flow::affine_flow(F.row(a), y, tau(a), ends.row(a), Phi, square);
        }
        end = ends.row(a);
        times(Phi, D, E, n, m + a);
        value = guard_at(channels, g.row(a), gs.row(a), smooth(a), end, sigma, slope, row);
        orbits_flow::rate_at(F.row(a), S.row(a), end, sigma, rate);
        // A later end of this arc moves the state by its rate: the column of the dwell time.
        for (i64 i_at = 0; i_at < N; ++i_at) {
            i = i_at;
            E(i, m + a) = rate(i);
        }
        speed(a) = 0.0;
        for (i64 j = 0; j < N; ++j) {
            speed(a) += row(j) * rate(j);
        }
        guard_equation(at_once(a), tau(a), value, row, E, A.row(m + a), r.slice(m + a, r.shape(0)), m + a);
        for (i64 i_at = 0; i_at < N; ++i_at) {
            i = i_at;
            v = 0.0;
            for (i64 j = 0; j < N; ++j) {
                v += J(a, i, j) * end(j);
            }
            y(i) = v;
        }
        times(J.row(a), E, D, N, m + a + 1);
    }
    filling::fill(starts.row(p), y);
    double total = sum_of(tau);
    for (i64 k = 0; k < m; ++k) {
        i = free(k);
        r(k) = y(i) - y0(i) - shift(i) * total;
        for (i64 j = 0, j_end = m + p; j < j_end; ++j) {
            A(k, j) = D(i, j);
        }
        // Periodicity: y behind the last event less y0, but for what a clock advances by in a period.
        A(k, k) -= 1.0;
        if (shift(i) != 0.0) {
            for (i64 a = 0; a < p; ++a) {
                A(k, m + a) -= shift(i);
            }
        }
    }
    return made;
}

/// Arc a from y: fill its end and the derivative Phi of that, the channels there, and the guard's derivative.
template <class C>
void along(const C& channels, i64 a, Matrix F, Matrix S, Vector g, Vector gs, i64 smooth, Vector y, double tau,
    Vector end, Matrix Phi, Vector sigma, Vector row) {
    Scope scope;
    NumbersOf<C> own{};
    i64 n = F.shape(0);
    i64 N = F.shape(1);
    Vector slope = zeros<double>(S.shape(1));
    sigma.fill(0.0);
    if (smooth) {
        own = orbits_flow::numbers_of(channels, F, S);
        orbits_flow::smooth_flow(channels, a, F, S, y, tau, MOST_SERIES, end, Phi, sigma, slope, own);
    } else {
        orbits_flow::affine_flow(F, y, tau, end, Phi, orbits_flow::room(F.reshape(std::array<i64, 3>{1, n, N})));
    }
    guard_at(channels, g, gs, smooth, end, sigma, slope, row);
}

/// Change of the guard that ends an arc with a parameter, the state at its end held; `by` has the derivatives.
double guard_change(None channels, None by, Vector dg, Vector dgs, Vector gs, i64 smooth, Vector end, Vector sigma,
    Vector slope) {
    double value = 0.0;
    for (i64 j = 0; j < end.size(); ++j) {
        value += dg(j) * end(j);
    }
    return value;
}

/// Change of the guard that ends an arc with a parameter, the state at its end held; `by` has the derivatives.
double guard_change(const Channels& channels, const Numbers& by, Vector dg, Vector dgs, Vector gs, i64 smooth,
    Vector end, Vector sigma, Vector slope) {
    Scope scope;
    double through{};
    double value = 0.0;
    for (i64 j = 0; j < end.size(); ++j) {
        value += dg(j) * end(j);
    }
    if (!smooth) {
        return value;
    }
    i64 n = channels.smooth_x.shape(1);
    Vector weight = weights(channels, gs, slope);
    for (i64 j = sigma.size() - 1; j > -1; --j) {
        value += dgs(j) * sigma(j);
        through = weight(j) * slope(j);
        for (i64 i = 0; i < n; ++i) {
            value += through * by.smooth_x(j, i) * end(i);
        }
        for (i64 i = n; i < end.size(); ++i) {
            value += through * by.smooth_H(j, i - n) * end(i);
        }
        for (i64 i = 0; i < j; ++i) {
            value += through * by.smooth_s(j, i) * sigma(i);
        }
        if (channels.smooth_scale(j) != 0.0) {
            value += weight(j) * by.smooth_scale(j) / channels.smooth_scale(j) * sigma(j);
        }
    }
    return value;
}

/// Derivative of the equations that `sweep` sets up by a parameter of which all numbers are functions.
///
/// Parameters
/// ----------
/// starts : array (p + 1, N)
///     As `sweep` fills them.
/// of_channels, dF, dS, dg, dgs, dJ, dshift : Channels and arrays
///     Derivatives of the numbers by the parameter.
/// dy : array (N,)
///     Derivative of the start; that of a driven loop's inputs. Behind the call that of the end.
/// out : array (m + p,)
///     Filled with the derivative of the residual at fixed start and dwell times.
template <class C>
void sweep_by(const C& channels, Matrices F, Matrices S, Matrix g, Matrix gs, Matrices J, Indices smooth,
    Indices at_once, Matrix starts, Vector tau, Indices free, const C& of_channels, Matrices dF, Matrices dS,
    Matrix dg, Matrix dgs, Matrices dJ, Vector dshift, Vector dy, Vector out) {
    Scope scope;
    i64 i{};
    NumbersOf<C> by{};
    double value{};
    i64 p = F.shape(0);
    i64 N = F.shape(2);
    i64 m = free.size();
    Vector sigma = zeros<double>(S.shape(2));
    Vector slope = zeros<double>(S.shape(2));
    Vector end = zeros<double>(N);
    Vector moved = zeros<double>(N);
    Vector row = zeros<double>(N);
    Matrix Phi = zeros<double>(N, N);
    Matrices square = orbits_flow::room(F);
    Matrix wide = zeros<double>(N, N + 1);
    Vector begin = copy_of(dy);
    // Forward mode: beside the state goes its change with the parameter, through every arc and every event.
    for (i64 a = 0; a < p; ++a) {
        by = orbits_flow::numbers_of(of_channels, dF.row(a), dS.row(a));
        if (smooth(a)) {
            orbits_flow::smooth_flow(channels, a, F.row(a), S.row(a), starts.row(a), tau(a), MOST_SERIES, end, wide,
                sigma, slope, by);
            for (i64 i_at = 0; i_at < N; ++i_at) {
                i = i_at;
                moved(i) = wide(i, N);
                for (i64 j = 0; j < N; ++j) {
                    moved(i) += wide(i, j) * dy(j);
                }
            }
        } else {
            sigma.fill(0.0);
            slope.fill(0.0);
            orbits_flow::affine_flow(F.row(a), starts.row(a), tau(a), end, Phi, square);
            orbits_flow::affine_change(F.row(a), dF.row(a), starts.row(a), tau(a), dy, moved);
        }
        value = guard_change(channels, by, dg.row(a), dgs.row(a), gs.row(a), smooth(a), end, sigma, slope);
        guard_at(channels, g.row(a), gs.row(a), smooth(a), end, sigma, slope, row);
        for (i64 j = 0; j < N; ++j) {
            value += row(j) * moved(j);
        }
        if (at_once(a) == 1) {
            value = 0.0;
        } else if (at_once(a) == 2 && tau(a) != 0.0) {
            value /= tau(a);
        }
        out(m + a) = value;
        for (i64 i_at = 0; i_at < N; ++i_at) {
            i = i_at;
            dy(i) = 0.0;
            for (i64 j = 0; j < N; ++j) {
                dy(i) += J(a, i, j) * moved(j) + dJ(a, i, j) * end(j);
            }
        }
    }
    double total = sum_of(tau);
    for (i64 k = 0; k < m; ++k) {
        i = free(k);
        out(k) = dy(i) - begin(i) - dshift(i) * total;
    }
}

// Where no smooth channel acts, and where some do.
template double guard_at(const None& channels, Vector g, Vector gs, i64 smooth, Vector end, Vector sigma, Vector slope,
    Vector row);
template double guard_at(const Channels& channels, Vector g, Vector gs, i64 smooth, Vector end, Vector sigma, Vector slope,
    Vector row);
template i64 sweep(const None& channels, Matrices F, Matrices S, Matrix g, Matrix gs, Matrices J, Indices smooth,
    Indices at_once, Vector y0, Vector tau, Indices free, Vector shift, i64 most, Matrix starts, Matrix ends, Matrix A,
    Vector r, Vector speed);
template i64 sweep(const Channels& channels, Matrices F, Matrices S, Matrix g, Matrix gs, Matrices J, Indices smooth,
    Indices at_once, Vector y0, Vector tau, Indices free, Vector shift, i64 most, Matrix starts, Matrix ends, Matrix A,
    Vector r, Vector speed);
template void along(const None& channels, i64 a, Matrix F, Matrix S, Vector g, Vector gs, i64 smooth, Vector y, double tau,
    Vector end, Matrix Phi, Vector sigma, Vector row);
template void along(const Channels& channels, i64 a, Matrix F, Matrix S, Vector g, Vector gs, i64 smooth, Vector y, double tau,
    Vector end, Matrix Phi, Vector sigma, Vector row);
template void sweep_by(const None& channels, Matrices F, Matrices S, Matrix g, Matrix gs, Matrices J, Indices smooth,
    Indices at_once, Matrix starts, Vector tau, Indices free, const None& of_channels, Matrices dF, Matrices dS,
    Matrix dg, Matrix dgs, Matrices dJ, Vector dshift, Vector dy, Vector out);
template void sweep_by(const Channels& channels, Matrices F, Matrices S, Matrix g, Matrix gs, Matrices J, Indices smooth,
    Indices at_once, Matrix starts, Vector tau, Indices free, const Channels& of_channels, Matrices dF, Matrices dS,
    Matrix dg, Matrix dgs, Matrices dJ, Vector dshift, Vector dy, Vector out);

}  // namespace orbits_sweep
}  // namespace EPP_ARCH
}  // namespace epp
