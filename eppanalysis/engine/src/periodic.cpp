#include "periodic.hpp"

namespace epp {
inline namespace EPP_ARCH {

namespace periodic {

/// First and second derivative of a series at the phase whose wave is `step`.
std::tuple<double, double> slope_and_bend(ComplexVector c, Complex step) {
    Complex wave = Complex(1.0, 0.0);
    double slope = 0.0;
    double bend = 0.0;
    for (i64 k = 1; k < c.size(); ++k) {
        wave *= step;
        slope -= k * (c(k).real * wave.imag + c(k).imag * wave.real);
        bend -= k * k * (c(k).real * wave.real - c(k).imag * wave.imag);
    }
    return {slope, bend};
}

/// The root of the slope in a bracket, by Newton's method kept inside it; `rising` tells its sign at the ends.
double turning_point(ComplexVector c, double low, double high, bool rising) {
    double slope{}, bend{}, new_{}, move{};
    double phi = 0.5 * (low + high);
    for (i64 turn_ = 0; turn_ < MOST_STEPS; ++turn_) {
        std::tie(slope, bend) = slope_and_bend(c, Complex(std::cos(phi), std::sin(phi)));
        if ((slope > 0.0) == rising) {
            high = phi;
        } else {
            low = phi;
        }
        new_ = phi - slope / bend;
        if (!((low - 1e-14) <= new_ && new_ <= (high + 1e-14))) {
            new_ = 0.5 * (low + high);
        }
        move = std::fabs(new_ - phi);
        phi = new_;
        if (move <= 4e-15) {
            break;
        }
    }
    return phi;
}

/// Value and slope of a series (n + 1,) at a phase.
std::tuple<double, double> series_at(ComplexVector c, double phi) {
    Complex step = Complex(std::cos(phi), std::sin(phi));
    Complex wave = Complex(1.0, 0.0);
    double value = c(0).real;
    double slope = 0.0;
    for (i64 k = 1; k < c.size(); ++k) {
        wave *= step;
        value += c(k).real * wave.real - c(k).imag * wave.imag;
        slope -= k * (c(k).real * wave.imag + c(k).imag * wave.real);
    }
    return {value, slope};
}

/// Add the extremum in a bracket to those in order of phase; returns their number.
i64 put(Vector phase, Vector value, i64 count, ComplexVector c, double low, double high, bool rising) {
    double phi = modulo(turning_point(c, low, high, rising), TURN);
    if (count == phase.size()) {
        return count;
    }
    i64 i = count;
    while (i > 0 && phase(i - 1) > phi) {
        phase(i) = phase(i - 1);
        value(i) = value(i - 1);
        i -= 1;
    }
    {
        const double was1 = phi;
        const double was2 = std::get<0>(series_at(c, phi));
        phase(i) = was1;
        value(i) = was2;
    }
    return count + 1;
}

/// A phase where the slope, which comes nearer to zero and goes again, has the other sign; 0 where it never has.
double where_it_turns(ComplexVector c, double low, double high, double slope) {
    double middle{}, here{}, bend{};
    for (i64 turn_ = 0; turn_ < MOST_STEPS; ++turn_) {
        middle = 0.5 * (low + high);
        std::tie(here, bend) = slope_and_bend(c, Complex(std::cos(middle), std::sin(middle)));
        if ((here > 0.0) != (slope > 0.0)) {
            return middle;
        }
        // Slope times bend is half the rate of the squared slope: negative on the way to where it is nearest to zero.
        if ((here * bend) <= 0.0) {
            low = middle;
        } else {
            high = middle;
        }
    }
    return 0.0;
}

/// All extrema of a series, in order of phase in [0, 2 pi); returns their number.
///
/// Brackets come from the slope on an even grid; where it comes near zero between two samples without a change of sign,
/// the point where it is nearest is sought, so that no close pair is missed.
///
/// Parameters
/// ----------
/// c : array, shape (n + 1,)
/// phase, value : array, shape (workspace,)
///     Are filled. A series of order n has at most 2 n extrema; what rounding makes of a flat one beyond the workspace
///     is left out.
i64 find_extrema(ComplexVector c, Vector phase, Vector value) {
    double slope{}, bend{}, phi{}, after{}, bend_after{}, split{};
    i64 n = c.size() - 1;
    double amplitude = 0.0;
    for (i64 k = 1, k_end = n + 1; k < k_end; ++k) {
        amplitude += modulus(c(k));
    }
    // Beside so large a mean the extrema would be those of rounding.
    if (!(amplitude > (0.01 * ROUNDING * modulus(c(0))))) {
        return 0;
    }
    i64 cells = greatest_of<i64>(LEAST, PER_WAVE * n);
    double h = TURN / cells;
    i64 count = 0;
    std::tie(slope, bend) = slope_and_bend(c, Complex(1.0, 0.0));
    // The last cell ends on the very first sample: half a rounding off it the slope may have the other sign.
    for (i64 i = 0; i < cells; ++i) {
        phi = modulo(i + 1, cells) * h;
        std::tie(after, bend_after) = slope_and_bend(c, Complex(std::cos(phi), std::sin(phi)));
        if ((slope > 0.0) != (after > 0.0)) {
            count = put(phase, value, count, c, i * h, (i + 1) * h, after > 0.0);
        } else if ((slope * bend) <= 0.0 && (after * bend_after) >= 0.0 && least_of(std::fabs(slope),
            std::fabs(after)) < (h * greatest_of(std::fabs(bend), std::fabs(bend_after)))) {
            // Two extrema hide in a cell only where the slope falls towards zero from both of its ends, and the bend can
            // bring the smaller of the two to zero within it.
            split = where_it_turns(c, i * h, (i + 1) * h, slope);
            if (split > 0.0) {
                count = put(phase, value, count, c, i * h, split, slope <= 0.0);
                count = put(phase, value, count, c, split, (i + 1) * h, slope > 0.0);
            }
        }
        slope = after;
        bend = bend_after;
    }
    return count;
}

/// Phase at which a mode guard on the clock alone (or on nothing) fires.
double due(const Table& table, i64 mode_guard, double offset, double phi, double omega) {
    double clock = table.on_clock(mode_guard);
    if (clock <= 0.0) {
        return ((offset + clock * phi / omega) > 0.0) ? phi : INF;
    }
    return greatest_of(phi, -offset / clock * omega);
}

/// Where a rising piece from `begin` to `high` meets a level, not before `low`: begun as on a cosine.
double root(ComplexVector c, double low, double begin, double high, double share, double level, double sign) {
    double value{}, slope{}, gap{}, new_{};
    double x = begin + (high - begin) * std::acos(share) / PI;
    x = least_of(greatest_of(x, low), high);
    for (i64 turn_ = 0; turn_ < MOST_STEPS; ++turn_) {
        std::tie(value, slope) = series_at(c, x);
        gap = sign * (value - level);
        slope = sign * slope;
        if (gap > 0.0) {
            high = x;
        } else {
            low = x;
        }
        new_ = (slope > 0.0) ? x - gap / slope : 0.5 * (low + high);
        if (!(low <= new_ && new_ <= high)) {
            new_ = 0.5 * (low + high);
        }
        // Newton squares its error: after so small a step the next one would be below rounding.
        if (std::fabs(new_ - x) <= 1e-09) {
            return new_;
        }
        x = new_;
    }
    return x;
}

/// Phase, not before `phi`, at which ``sign * series`` next exceeds ``sign * level``; infinite if it never does.
///
/// Parameters
/// ----------
/// c : array, shape (n + 1,)
///     The series; `phase`, `value` and `count` are its extrema from `find_extrema`, `here` its value at `phi`.
double next_rise(ComplexVector c, Vector phase, Vector value, i64 count, double phi, double here, double level,
    double sign) {
    double top{}, low{}, high{}, bottom{};
    i64 before{};
    double size = 0.0;
    for (i64 k = 0; k < c.size(); ++k) {
        size += modulus(c(k));
    }
    double slack = ROUNDING * (size + std::fabs(level));
    double goal = sign * level;
    if ((sign * here) > (goal + slack)) {
        return phi;
    }
    i64 turns = i64(std::floor(phi / TURN));
    i64 start = 0;
    while (start < count && phase(start) <= (phi - turns * TURN)) {
        start += 1;
    }
    for (i64 i = start, i_end = start + count; i < i_end; ++i) {
        top = sign * value(modulo(i, count));
        if (!(top > (goal + slack))) {
            continue;
        }
        // On its level but for rounding, and on the way to a top that is clearly above: it rises here.
        if (i == start && (sign * here) >= goal) {
            return phi;
        }
        before = modulo(i - 1, count);
        // In Python's sense: the extremum before the first is the last one of the turn before.
        low = phase(before) + TURN * (turns + floor_div(i - 1, count));
        high = phase(modulo(i, count)) + TURN * (turns + floor_div(i, count));
        bottom = sign * value(before);
        if (high <= phi || bottom >= goal) {
            return greatest_of(phi, low);
        }
        return root(c, greatest_of(low, phi), low, high, 1.0 - 2.0 * (goal - bottom) / (top - bottom), level, sign);
    }
    return INF;
}

/// Run an automaton over phases, from `phi` to before `end` (over what is due at once if both are the same).
///
/// Parameters
/// ----------
/// table : Table
/// series : array, shape (S + 1, n + 1)
///     Those of the guards, and the input.
/// phase, value, counts : array, shapes (S + 1, workspace), (S + 1, workspace), (S + 1,)
///     Their extrema.
/// z : array, shape (n + 1,)
///     The free input.
/// omega : float
///     [rad/s].
/// memory : array, shape (h,)
///     Memory values; left as they are at the end.
/// work, here : array, shapes (h,), (S,)
///     For work.
/// at, fired, holds : array, shapes (most,), (most,), (most, h)
///     Are filled with phase, mode guard, and memory values behind each switch.
///
/// Returns
/// -------
/// (int, int)
///     Number of switches, and the mode at the end; -1 switches where there are more than `most`.
std::tuple<i64, i64> advance(const Table& table, ComplexMatrix series, Matrix phase, Matrix value, Indices counts,
    ComplexVector z, double omega, double phi, double end, i64 mode, Vector memory, Vector work, Vector here,
    Vector at, Indices fired, Matrix holds) {
    i64 s{}, best{}, role{};
    double when{}, offset{}, due{}, sign{}, level{}, slope{}, new_{}, part{};
    bool only_now = end == phi;
    i64 n_memory = memory.size();
    i64 number = 0;
    while (true) {
        for (i64 s_at = 0; s_at < here.size(); ++s_at) {
            s = s_at;
            here(s) = std::get<0>(series_at(series.row(s), phi));
        }
        when = INF;
        best = -1;
        // Between switches memory is constant, so a guard on the input is a level that the series has to pass.
        for (i64 t = table.first(mode), t_end = table.first(mode + 1); t < t_end; ++t) {
            offset = table.constant(t);
            for (i64 h = 0; h < n_memory; ++h) {
                offset += table.on_memory(t, h) * memory(h);
            }
            s = table.series(t);
            if (s < 0) {
                due = periodic::due(table, t, offset, phi, omega);
            } else {
                sign = (table.factor(t) > 0.0) ? 1.0 : -1.0;
                level = -offset / table.factor(t);
                due = next_rise(series.row(s), phase.row(s), value.row(s), counts(s), phi, here(s), level, sign);
            }
            if (due < when) {
                when = due;
                best = t;
            }
        }
        if (best < 0 || (only_now ? when > phi : when >= end)) {
            return {number, mode};
        }
        if (number == at.size()) {
            return {-1, mode};
        }
        phi = when;
        mode = table.target(best);
        std::tie(level, slope) = series_at(z, phi);
        filling::fill(work, memory);
        for (i64 h = 0; h < n_memory; ++h) {
            new_ = table.memory_constant(best, h);
            for (i64 i = 0, i_end = table.roles.size(); i < i_end; ++i) {
                role = table.roles(i);
                part = (role == 0) ? level : ((role == 1) ? omega * slope : phi / omega);
                new_ += table.from_input(best, h, i) * part;
            }
            for (i64 k = 0; k < n_memory; ++k) {
                new_ += table.from_memory(best, h, k) * work(k);
            }
            memory(h) = new_;
            holds(number, h) = new_;
        }
        at(number) = phi;
        fired(number) = best;
        number += 1;
    }
}

/// Run at least `least` periods of a motion from a phase, until one ends as it began; returns as `settle`.
std::tuple<i64, i64, double> repeat(const Table& table, const std::tuple<ComplexMatrix, Matrices, Indices,
    ComplexVector, double>& motion, double start, i64 mode, Vector memory, i64 least, bool clocked,
    const std::tuple<Vector, Vector, Vector, Vector, Indices, Matrix>& room) {
    ComplexMatrix series{};
    Matrices extrema{};
    Indices counts{}, fired{};
    ComplexVector z{};
    double omega{}, begin{}, end{}, moved{};
    Vector begun{}, work{}, here{}, at{};
    Matrix holds{};
    i64 count{}, before{};
    bool same{}, near{};
    std::tie(series, extrema, counts, z, omega) = motion;
    std::tie(begun, work, here, at, fired, holds) = room;
    double size = 0.0;
    for (i64 k = 0; k < z.size(); ++k) {
        size += modulus(z(k));
    }
    double turn = TURN / omega;
    Matrix phase = extrema.row(0);
    Matrix value = extrema.row(1);
    std::tie(count, mode) = advance(table, series, phase, value, counts, z, omega, start, start, mode, memory, work,
        here, at, fired, holds);
    if (count < 0) {
        return {ENDLESS, mode, start};
    }
    for (i64 period = 0; period < MOST_PERIODS; ++period) {
        begin = start + TURN * period;
        before = mode;
        filling::fill(begun, memory);
        end = begin + TURN;
        std::tie(count, mode) = advance(table, series, phase, value, counts, z, omega, begin, end, mode, memory, work,
            here, at, fired, holds);
        if (count < 0) {
            return {ENDLESS, mode, begin};
        }
        same = (period + 1) >= least && mode == before;
        for (i64 h = 0; h < memory.size(); ++h) {
            moved = memory(h) - begun(h);
            near = std::fabs(moved) <= (SAME * (size + std::fabs(begun(h))));
            // A memory value that is a time repeats itself a period later.
            same = same && (near || (clocked && std::fabs(moved - turn) <= (SAME * turn)));
        }
        if (same) {
            return {count, mode, begin};
        }
    }
    return {UNSETTLED, mode, start};
}

/// Run an automaton over whole periods until mode and memory values come back.
///
/// An element that holds values comes from a larger motion, so that it joins its loop even where it could also rest;
/// only if it then does not switch at all does it rest, where its describing function has it rest.
///
/// Parameters
/// ----------
/// table : Table
/// z : array, shape (n + 1,)
///     The free input.
/// omega : float
///     [rad/s].
/// mode : int
///     At the start.
/// clocked : bool
///     Whether a guard is on the time.
/// rest : array, shape (h,)
///     Memory values at rest.
///
/// Returns
/// -------
/// count : int
///     Number of switches, `ENDLESS` where they never end, `UNSETTLED` where no period repeats.
/// mode : int
/// start : float
///     At the beginning of the period, its phase.
/// begun : array, shape (h,)
///     Memory values there.
/// at, fired, holds : array, shapes (s,), (s,), (s, h)
///     Phase, mode guard, and memory values behind each switch of the period.
std::tuple<i64, i64, double, Vector, Vector, Indices, Matrix> settle_part(const Table& table, ComplexVector z,
    double omega, i64 mode, bool clocked, Vector rest) {
    i64 s{};
    double on_free{}, on_rate{}, free{}, rate{}, best{}, before{};
    ComplexVector moving{};
    i64 n = z.size() - 1;
    i64 n_series = table.free_series.size();
    i64 n_memory = rest.size();
    // No wave of order n passes a level more than 2 n times in a period.
    i64 most = 200 + 2 * z.size() * greatest_of<i64>(20, table.series.size());
    Vector at = empty<double>(most);
    Indices fired = empty<i64>(most);
    Matrix holds = empty<double>(most, n_memory);
    ComplexMatrices series = empty<Complex>(2, n_series + 1, n + 1);
    Matrices extrema = empty<double>(3, n_series + 1, 8 * n + 32);
    Indices counts = zeros<i64>(n_series + 1);
    Vector here = empty<double>(n_series);
    Vector begun = zeros<double>(n_memory);
    ComplexMatrix own = series.row(0);
    ComplexMatrix larger = series.row(1);
    Matrix phase = extrema.row(0);
    Matrix value = extrema.row(1);
    Matrix wide = extrema.row(2);
    Vector held = copy_of(rest);
    Vector work = empty<double>(n_memory);
    std::tuple<ComplexMatrix, Matrices, Indices, ComplexVector, double> motion = std::tuple<ComplexMatrix, Matrices,
        Indices, ComplexVector, double>{own, extrema, counts, z, omega};
    std::tuple<Vector, Vector, Vector, Vector, Indices, Matrix> room = std::tuple<Vector, Vector, Vector, Vector,
        Indices, Matrix>{begun, work, here, at, fired, holds};
    // The last row is the input itself, which mostly is one of the series, too.
    i64 same = n_series;
    for (i64 s_at = 0; s_at < n_series; ++s_at) {
        s = s_at;
        on_free = table.free_series(s);
        on_rate = table.rate_series(s);
        same = (on_free == 1.0 && on_rate == 0.0) ? s : same;
        for (i64 k = 0, k_end = n + 1; k < k_end; ++k) {
            free = on_free;
            rate = on_rate * (omega * k);
            own(s, k) = Complex(free * z(k).real - rate * z(k).imag, free * z(k).imag + rate * z(k).real);
        }
        counts(s) = find_extrema(own.row(s), phase.row(s), value.row(s));
    }
    own.row(n_series).copy(z);
    i64 count = 0;
    double start = 0.0;
    i64 least = clocked ? 2 : 1;
    i64 there = mode;
    if (n_memory > 0 && !clocked) {
        if (same == n_series) {
            counts(same) = find_extrema(z, phase.row(same), value.row(same));
        }
        best = -INF;
        for (i64 i = 0, i_end = counts(same); i < i_end; ++i) {
            if (value(same, i) > best) {
                best = value(same, i);
                start = phase(same, i);
            }
        }
        for (i64 s_at = 0, s_at_end = n_series + 1; s_at < s_at_end; ++s_at) {
            s = s_at;
            larger(s, 0) = own(s, 0);
            for (i64 k = 1, k_end = n + 1; k < k_end; ++k) {
                larger(s, k) = EXCURSION * own(s, k);
            }
            for (i64 i = 0, i_end = counts(s); i < i_end; ++i) {
                wide(s, i) = own(s, 0).real + EXCURSION * (value(s, i) - own(s, 0).real);
            }
        }
        // From peak to peak, so that the larger motion hands over at the top of the smaller one.
        moving = larger.row(n_series);
        before = start - TURN;
        std::tie(count, there) = advance(table, larger, phase, wide, counts, moving, omega, before, start, mode, held,
            work, here, at, fired, holds);
        if (count >= 0) {
            std::tie(count, there, start) = repeat(table, motion, start, there, held, 2, clocked, room);
        }
        if (count == 0) {
            filling::fill(held, rest);
            start = 0.0;
            there = mode;
        }
    }
    // What holds nothing, or does not switch in a motion of its own.
    if (count == 0) {
        std::tie(count, there, start) = repeat(table, motion, start, there, held, least, clocked, room);
    }
    s = greatest_of<i64>(count, 0);
    return {count, there, start, begun, copy_of(at.slice(0, s)), copy_of(fired.slice(0, s)), copy_of(holds.slice(0,
        s))};
}

}  // namespace periodic
}  // namespace EPP_ARCH
}  // namespace epp
