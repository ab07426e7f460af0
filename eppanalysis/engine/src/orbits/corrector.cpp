#include "orbits/corrector.hpp"

namespace epp {
inline namespace EPP_ARCH {

namespace orbits_corrector {

/// The arcs whose numbers are in a vector.
Chain chain_of(const Chain& like, Vector numbers) {
    i64 a = like.F.size();
    i64 b = a + like.S.size();
    i64 c = b + like.g.size();
    i64 d = c + like.gs.size();
    i64 e = d + like.J.size();
    return Chain{numbers.slice(0, a).reshape(like.F.lengths), numbers.slice(a, b).reshape(like.S.lengths),
        numbers.slice(b, c).reshape(like.g.lengths), numbers.slice(c, d).reshape(like.gs.lengths), numbers.slice(d,
        e).reshape(like.J.lengths), like.smooth, like.at_once, like.free, numbers.slice(e, e + like.shift.size()),
        like.duration};
}

/// The smooth channels whose numbers are in a vector, behind those of the arcs.
None channels_of(None like, const Chain& chain, Vector numbers) {
    return {};
}

/// Fill in the numbers that vary, at a value of the parameter.
void numbers_at(const Curve& curve, double value, Vector numbers) {
    double wave{};
    if (curve.places.size() == 0) {
        return;
    }
    // As cosines: the place stays within the range, whatever rounding makes of its ends.
    double angle = std::acos(least_of(greatest_of((value - curve.middle) / curve.half, -1.0), 1.0));
    for (i64 i = 0, i_end = curve.places.size(); i < i_end; ++i) {
        numbers(curve.places(i)) = 0.0;
    }
    for (i64 k = 0, k_end = curve.coefficients.shape(0); k < k_end; ++k) {
        wave = std::cos(k * angle);
        for (i64 i = 0, i_end = curve.places.size(); i < i_end; ++i) {
            numbers(curve.places(i)) += wave * curve.coefficients(k, i);
        }
    }
}

/// Fill in the step to the plane, and the size of the parameter's column; whether it is more than rounding.
bool bordered(const Motion& here, const Plane& plane, Vector u, Vector columns, Vector right, Indices places,
    Matrix scaled, Matrix matrix, Vector change) {
    i64 n = here.r.size();
    double most = 0.0;
    double across = 0.0;
    double missed = -plane.distance;
    for (i64 i = 0; i < n; ++i) {
        most = greatest_of(most, std::fabs(plane.slope(i) / here.rows(i)));
    }
    columns(n) = (most > 0.0) ? 1.0 / most : 1.0;
    for (i64 j = 0, j_end = n + 1; j < j_end; ++j) {
        across = greatest_of(across, std::fabs(plane.row(j) * columns(j)));
        missed += plane.row(j) * (u(j) - plane.old(j));
    }
    across = (across > 0.0) ? across : 1.0;
    for (i64 i = 0; i < n; ++i) {
        right(i) = -here.r(i) / here.rows(i);
        for (i64 j = 0; j < n; ++j) {
            scaled(i, j) = here.A(i, j) / here.rows(i) * columns(j);
        }
        scaled(i, n) = plane.slope(i) / here.rows(i) * columns(n);
    }
    for (i64 j = 0, j_end = n + 1; j < j_end; ++j) {
        scaled(n, j) = plane.row(j) / across * columns(j);
    }
    right(n) = -missed / across;
    return orbits_newton::solved(scaled, right, columns, places, matrix, change);
}

/// The smooth channels whose numbers are in a vector, behind those of the arcs.
Channels channels_of(const Channels& like, const Chain& chain, Vector numbers) {
    i64 a = chain.F.size() + chain.S.size() + chain.g.size() + chain.gs.size() + chain.J.size() + chain.shift.size();
    i64 b = a + like.smooth_x.size();
    i64 c = b + like.smooth_H.size();
    i64 d = c + like.smooth_s.size();
    return Channels{like.smooth_kind, numbers.slice(a, b).reshape(like.smooth_x.lengths), numbers.slice(b,
        c).reshape(like.smooth_H.lengths), numbers.slice(c, d).reshape(like.smooth_s.lengths), numbers.slice(d, d +
        like.smooth_scale.size()), like.sense};
}

/// Newton's method to the orbit in a plane, over start, dwell times and parameter.
///
/// Parameters
/// ----------
/// channels, chain : Channels or None, Chain
///     Of the same arcs at any value.
/// curve : Curve
///     Their numbers, in the order of Chain, then of Channels, then the places of the loop's inputs.
/// input_place, n_inputs : int
///     Places of the inputs in y.
/// effort, plane : Effort, Plane
/// step : array (m + p + 1,)
///     The first step; empty where there is none yet.
/// progress : array (2,)
///     Iterations made, and the smallest step so far; both go on.
/// u : array (m + p + 1,)
///     Free part of the start, dwell times, parameter; moved.
/// here : Motion
///     Filled with that at u; y holds what is no unknown.
///
/// Returns
/// -------
/// int, float
///     One of ARRIVED, LOST, WANTS_NUMBERS, WANTS_STEP; the work done.
template <class C>
std::tuple<i64, double> correct(C channels, Chain chain, const Curve& curve, i64 input_place, i64 n_inputs,
    const Effort& effort, const Plane& plane, Vector step, Vector progress, Vector u, const Motion& here) {
    Scope scope;
    bool still{};
    double residual{}, period{}, motion{}, size{};
    i64 n = here.r.size();
    i64 m = chain.free.size();
    bool given = step.size() > 0;
    Vector numbers = copy_of(curve.base);
    double used = 0.0;
    {
        const Chain was1 = chain_of(chain, numbers);
        const C was2 = channels_of(channels, chain, numbers);
        chain = was1;
        channels = was2;
    }
    Matrix scaled = empty<double>(n + 1, n + 1);
    Matrix matrix = balances::room_for(n + 1);
    Indices places = counted(n + 1);
    Vector change = empty<double>(n + 1);
    Vector columns = empty<double>(n + 1);
    Vector right = empty<double>(n + 1);
    while (progress(0) < MOST_CORRECTIONS && used < effort.most) {
        if (!(std::fabs(u(n) - curve.middle) <= (curve.half * (1.0 + 1e-12)))) {
            return {WANTS_NUMBERS, used};
        }
        numbers_at(curve, u(n), numbers);
        for (i64 k = 0; k < m; ++k) {
            here.y(chain.free(k)) = u(k);
        }
        for (i64 k = 0; k < n_inputs; ++k) {
            here.y(input_place + k) = numbers(numbers.size() - n_inputs + k);
        }
        for (i64 a = 0, a_end = here.tau.size(); a < a_end; ++a) {
            here.tau(a) = u(m + a);
        }
        used = orbits_newton::run_along(channels, chain, effort, used, here);
        orbits_newton::measure(channels, chain, here);
        residual = orbits_newton::largest_share(here.r, here.rows);
        period = sum_of(here.tau);
        motion = 0.0;
        for (i64 j = 0, j_end = here.scale.size(); j < j_end; ++j) {
            motion = greatest_of(motion, here.scale(j));
        }
        if (motion > plane.largest || !(residual < ASTRAY && (0.0 < period && period < plane.longest))) {
            return {LOST, used};
        }
        orbits_newton::sizes_of_unknowns(chain, here, columns);
        if (given) {
            filling::fill(change, step);
            given = false;
        } else if (!bordered(here, plane, u, columns, right, places, scaled, matrix, change)) {
            return {WANTS_STEP, used};
        }
        size = 0.0;
        for (i64 k = 0; k < n; ++k) {
            size = greatest_of(size, std::fabs(change(k)) / columns(k));
        }
        // Rounding limits either the residual or the step; whichever it is, a step that no longer shrinks is the last
        // one.
        still = (residual < CLOSED && size < SMALL) || size < STILL;
        if (residual < CONVERGED && (still || size > (0.5 * progress(1)))) {
            return {ARRIVED, used};
        }
        // A step that grows again after Newton has had his start will not converge.
        if (progress(0) > 3 && size > progress(1)) {
            return {LOST, used};
        }
        progress(0) += 1;
        progress(1) = least_of(progress(1), size);
        filling::accumulate(u, 1.0, change);
    }
    return {LOST, used};
}

// Where no smooth channel acts, and where some do.
template std::tuple<i64, double> correct(None channels, Chain chain, const Curve& curve, i64 input_place, i64 n_inputs,
    const Effort& effort, const Plane& plane, Vector step, Vector progress, Vector u, const Motion& here);
template std::tuple<i64, double> correct(Channels channels, Chain chain, const Curve& curve, i64 input_place, i64 n_inputs,
    const Effort& effort, const Plane& plane, Vector step, Vector progress, Vector u, const Motion& here);

}  // namespace orbits_corrector
}  // namespace EPP_ARCH
}  // namespace epp
