#include "orbits/newton.hpp"

namespace epp {
inline namespace EPP_ARCH {

namespace orbits_newton {

/// Largest value relative to its size; infinite where one is no number.
double largest_share(Vector values, Vector sizes) {
    double share{};
    double found = 0.0;
    for (i64 i = 0; i < values.size(); ++i) {
        share = std::fabs(values(i) / sizes(i));
        if (!std::isfinite(share)) {
            return INF;
        }
        found = greatest_of(found, share);
    }
    return found;
}

/// Fill in the sizes of the unknowns.
void sizes_of_unknowns(const Chain& chain, const Motion& it, Vector columns) {
    i64 m = chain.free.size();
    double period = greatest_of(sum_of(it.tau), NO_TIME);
    for (i64 k = 0; k < m; ++k) {
        columns(k) = it.scale(chain.free(k));
    }
    for (i64 k = m; k < columns.size(); ++k) {
        columns(k) = period;
    }
}

/// Fill in the solution of scaled equations, in the units of the unknowns; whether it is more than rounding.
bool solved(Matrix scaled, Vector right, Vector columns, Indices places, Matrix matrix, Vector step) {
    if (!balances::solve_at(scaled, right, places, places, right, 0.0, matrix, step)) {
        return false;
    }
    double size = 0.0;
    double most = 0.0;
    for (i64 i = 0; i < columns.size(); ++i) {
        size = greatest_of(size, std::fabs(step(i)));
        most = greatest_of(most, std::fabs(right(i)));
        step(i) *= columns(i);
    }
    return size <= (STRAY * most);
}

/// Run along the arcs once; the work done behind it.
template <class C>
double run_along(const C& channels, const Chain& chain, const Effort& effort, double used, const Motion& it) {
    used += effort.sweep;
    i64 most = i64(least_of(double(MOST_SERIES), 1.0 + greatest_of(effort.most - used, 0.0) / effort.series));
    i64 made = orbits_sweep::sweep(channels, chain.F, chain.S, chain.g, chain.gs, chain.J, chain.smooth, chain.at_once,
        it.y, it.tau, chain.free, chain.shift, most, it.starts, it.ends, it.A, it.r, it.speed);
    // the last arc ends when the time is over
    if (!std::isnan(chain.duration)) {
        for (i64 j = chain.free.size(), j_end = it.r.size(); j < j_end; ++j) {
            it.A(it.A.shape(0) - 1, j) = 1.0;
        }
        it.r(it.r.shape(0) - 1) = sum_of(it.tau) - chain.duration;
    }
    return used + effort.series * made;
}

/// Fill in the size of the motion in each place of y, and those of the residuals.
template <class C>
void measure(const C& channels, const Chain& chain, const Motion& it) {
    Scope scope;
    NumbersOf<C> own{};
    double half{};
    i64 p = chain.F.shape(0);
    i64 n = chain.F.shape(1);
    i64 N = chain.F.shape(2);
    bool driven = !std::isnan(chain.duration);
    bool known = std::isfinite(filling::largest(it.starts)) && std::isfinite(filling::largest(it.ends));
    Matrix inner = empty<double>(p, N);
    i64 count = 0;
    Vector sigma = empty<double>(chain.S.shape(2));
    Vector slope = empty<double>(chain.S.shape(2));
    Matrix Phi = empty<double>(N, N);
    Matrices square = orbits_flow::room(chain.F);
    // F holds no contribution of smooth channels; what is driven may have no event but its begin.
    for (i64 a = 0; a < p; ++a) {
        if (known && chain.smooth(a)) {
            own = orbits_flow::numbers_of(channels, chain.F.row(a), chain.S.row(a));
            half = 0.5 * it.tau(a);
            orbits_flow::smooth_flow(channels, a, chain.F.row(a), chain.S.row(a), it.starts.row(a), half, MOST_SERIES,
                inner.row(count), Phi, sigma, slope, own);
            count += 1;
        } else if (known && driven) {
            orbits_flow::affine_flow(chain.F.row(a), it.starts.row(a), 0.5 * it.tau(a), inner.row(count), Phi, square);
            count += 1;
        }
    }
    orbits_sizes::size_of_motion(chain.F, it.starts, it.ends, inner.slice(0, count), it.tau, it.scale);
    double period = greatest_of(sum_of(it.tau), NO_TIME);
    orbits_sizes::sizes_of_residuals(chain.g, chain.at_once, chain.free, it.scale, period, it.rows);
}

/// Room for another motion.
Motion like(const Motion& it) {
    Vector y = empty<double>(it.y.size());
    Vector tau = empty<double>(it.tau.size());
    Vector r = empty<double>(it.r.size());
    Vector scale = empty<double>(it.y.size());
    Vector rows = empty<double>(it.r.size());
    Vector speed = empty<double>(it.tau.size());
    return Motion{y, tau, empty_of<double>(it.starts.lengths), empty_of<double>(it.ends.lengths),
        empty_of<double>(it.A.lengths), r, speed, scale, rows};
}

/// Fill in Newton's step; whether the equations give one that is more than rounding.
bool step(const Motion& it, Vector columns, Indices places, Matrix scaled, Matrix matrix, Vector step) {
    Scope scope;
    i64 n = columns.size();
    Vector right = empty<double>(n);
    for (i64 i = 0; i < n; ++i) {
        right(i) = -it.r(i) / it.rows(i);
        for (i64 j = 0; j < n; ++j) {
            scaled(i, j) = it.A(i, j) / it.rows(i) * columns(j);
        }
    }
    return solved(scaled, right, columns, places, matrix, step);
}

/// Overwrite a motion by another.
void copy(const Motion& source, const Motion& it) {
    filling::fill(it.y, source.y);
    filling::fill(it.tau, source.tau);
    filling::fill(it.r, source.r);
    filling::fill(it.speed, source.speed);
    filling::fill(it.scale, source.scale);
    filling::fill(it.rows, source.rows);
    filling::fill_rows(it.starts, source.starts);
    filling::fill_rows(it.ends, source.ends);
    filling::fill_rows(it.A, source.A);
}

/// The longest share of a step that lowers the residual: work done, its number (-1 for none), its motion, room.
///
/// It is looked for from that of the step before on, which is a neighbour as a rule. Where there is no residual yet the
/// motion is taken as it is.
template <class C>
std::tuple<double, i64, Motion, Motion> search(const C& channels, const Chain& chain, const Effort& effort,
    double used, const Motion& here, Vector step, double most, i64 share, double residual, Motion better,
    Motion trial) {
    double size{};
    i64 turn = 0;
    i64 found = -1;
    i64 k = share;
    i64 count = SHARES.size();
    i64 m = chain.free.size();
    while (turn < count) {
        filling::fill(trial.y, here.y);
        for (i64 j = 0; j < m; ++j) {
            trial.y(chain.free(j)) += most * SHARES(k) * step(j);
        }
        for (i64 a = 0, a_end = here.tau.size(); a < a_end; ++a) {
            trial.tau(a) = here.tau(a) + most * SHARES(k) * step(m + a);
        }
        used = run_along(channels, chain, effort, used, trial);
        size = largest_share(trial.r, here.rows);
        // Near rounding any step will do.
        if (size < (residual * (1.0 - 0.1 * most * SHARES(k))) || (size < ROUNDING && residual < ROUNDING)) {
            {
                const Motion was1 = trial;
                const Motion was2 = better;
                const i64 was3 = k;
                better = was1;
                trial = was2;
                found = was3;
            }
            // The range of Newton's method grows as the orbit is neared, by one share a step as a rule.
            if (turn > 0 || k == 0 || residual == INF) {
                break;
            }
            k -= 1;
        } else if (found >= 0) {
            break;
        } else if (residual == INF) {
            return {used, -1, trial, better};
        } else {
            // Shorter shares first: Newton's direction lowers the residual over a short way, if at all.
            turn += 1;
            k = modulo(share + turn, count);
        }
    }
    return {used, found, better, trial};
}

/// Newton's method from `here`, which is moved; without iterations its equations alone are set up.
///
/// Parameters
/// ----------
/// channels, chain, effort : Channels or None, Chain, Effort
/// iterations : int
///     Steps at most.
/// step : array (m + p,)
///     The first step, in the units of the unknowns, from `here` with its equations; empty where there is none yet.
/// here : Motion
/// share : int
///     Number of the share of the last step that was taken.
///
/// Returns
/// -------
/// int, int, float
///     Steps that are left, none where the method has ended; the number of the last share; the work done. Where steps
///     are left the next one is wanted by least squares.
template <class C>
std::tuple<i64, i64, double> newton(const C& channels, const Chain& chain, const Effort& effort, i64 iterations,
    Vector step, const Motion& here, i64 share) {
    Scope scope;
    i64 k{};
    double residual{}, most{}, size{}, new_{};
    bool ends{};
    i64 n = here.r.size();
    double used = 0.0;
    bool begins = step.size() == 0;
    Vector wanted = zeros<double>(n);
    Vector columns = full<double>(1.0, n);
    Matrix scaled = empty<double>(n, n);
    Matrix matrix = balances::room_for(n);
    Indices places = counted(n);
    Motion better = like(here);
    Motion trial = like(here);
    bool given = !begins;
    if (given) {
        filling::fill(wanted, step);
    }
    i64 left = iterations;
    while (begins || (left > 0 && used < effort.most)) {
        residual = INF;
        most = 1.0;
        if (begins) {
            filling::fill(here.rows, columns);
        } else {
            residual = largest_share(here.r, here.rows);
            sizes_of_unknowns(chain, here, columns);
            if (std::isfinite(residual) && !given && !orbits_newton::step(here, columns, places, scaled, matrix,
                wanted)) {
                return {left, share, used};
            }
            size = largest_share(wanted, columns);
            left = left - 1;
            given = false;
            if (!(std::isfinite(residual) && std::isfinite(size))) {
                break;
            }
            // No step of more than half the motion's own size: of flows so far away the derivative says nothing.
            most = (size > 0.0) ? least_of(1.0, 0.5 / size) : 1.0;
        }
        std::tie(used, k, better, trial) = search(channels, chain, effort, used, here, wanted, most, share, residual,
            better, trial);
        if (k < 0 && !begins) {
            break;
        }
        measure(channels, chain, better);
        new_ = largest_share(better.r, better.rows);
        ends = new_ < ROUNDING && new_ > (0.3 * residual);
        if (!ends || new_ < residual) {
            copy(better, here);
        }
        if (ends) {
            break;
        }
        share = (!begins) ? greatest_of<i64>(k, 0) : share;
        begins = false;
    }
    return {0, share, used};
}

// Where no smooth channel acts, and where some do.
template double run_along(const None& channels, const Chain& chain, const Effort& effort, double used, const Motion& it);
template double run_along(const Channels& channels, const Chain& chain, const Effort& effort, double used, const Motion& it);
template void measure(const None& channels, const Chain& chain, const Motion& it);
template void measure(const Channels& channels, const Chain& chain, const Motion& it);
template std::tuple<double, i64, Motion, Motion> search(const None& channels, const Chain& chain, const Effort& effort,
    double used, const Motion& here, Vector step, double most, i64 share, double residual, Motion better,
    Motion trial);
template std::tuple<double, i64, Motion, Motion> search(const Channels& channels, const Chain& chain, const Effort& effort,
    double used, const Motion& here, Vector step, double most, i64 share, double residual, Motion better,
    Motion trial);
template std::tuple<i64, i64, double> newton(const None& channels, const Chain& chain, const Effort& effort, i64 iterations,
    Vector step, const Motion& here, i64 share);
template std::tuple<i64, i64, double> newton(const Channels& channels, const Chain& chain, const Effort& effort, i64 iterations,
    Vector step, const Motion& here, i64 share);

}  // namespace orbits_newton
}  // namespace EPP_ARCH
}  // namespace epp
