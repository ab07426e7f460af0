#include "describing/piecewise.hpp"

namespace epp {
inline namespace EPP_ARCH {

namespace describing_piecewise {

/// The jump at breakpoints that are evenly spaced and have one jump, both to rounding; else zero.
double even_jump(Vector breakpoints, Vector jumps, i64 first, i64 last) {
    double place{};
    double step = (breakpoints(last - 1) - breakpoints(first)) / (last - 1 - first);
    i64 nearest = first;
    for (i64 k = first; k < last; ++k) {
        nearest = (std::fabs(breakpoints(k)) < std::fabs(breakpoints(nearest))) ? k : nearest;
    }
    // Next to zero, where least has been cancelled in it.
    double jump = jumps(nearest);
    double apart = 0.0;
    for (i64 k = first; k < last; ++k) {
        place = std::fabs(breakpoints(first) + (k - first) * step - breakpoints(k));
        apart = greatest_of(greatest_of(apart, place), (jump != 0.0) ? std::fabs(jumps(k) / jump - 1.0) * step : INF);
    }
    return (apart <= (8.0 * EPSILON * greatest_of(std::fabs(breakpoints(first)), std::fabs(breakpoints(last - 1))))) ?
        jump : 0.0;
}

/// Whether a piece slopes, and the jump at all breakpoints where they are those of an even staircase, else zero.
///
/// Computed once for many chunks: an encoder has ten thousands of levels.
std::tuple<bool, double> shape_of(Vector breakpoints, Vector slopes, Vector jumps) {
    bool sloped = false;
    for (const auto& slope : slopes) {
        sloped = sloped || slope != 0.0;
    }
    return {sloped, (breakpoints.size() > FEW) ? even_jump(breakpoints, jumps, 0, breakpoints.size()) : 0.0};
}

/// Start `mean` with the output at the bias and `gain` with zero, or finish both where nothing oscillates.
void start(Vector breakpoints, Vector slopes, Vector intercepts, Vector jumps, Vector amplitude, Vector bias,
    Vector mean, Vector gain, Strided<double, 2> by) {
    double b{};
    i64 above{}, below{};
    double last = NaN;
    double level = NaN;
    double slope = NaN;
    double jump = 0.0;
    for (i64 i = 0; i < amplitude.size(); ++i) {
        b = bias(i);
        // At a breakpoint both sides count half, as a sine about it is as long on either; what lies off it the
        // pieces and jumps add.
        if (b != last) {
            above = searchsorted_right(breakpoints, b);
            below = (above > 0 && breakpoints(above - 1) == b) ? above - 1 : above;
            slope = (slopes(below) + slopes(above)) / 2;
            level = slope * b + (intercepts(below) + intercepts(above)) / 2;
            jump = (below < above) ? jumps(below) : 0.0;
            last = b;
        }
        mean(i) = level;
        gain(i) = 0.0;
        by(0, i) = 0.0;
        by(1, i) = 0.0;
        if (amplitude(i) <= 0.0) {
            gain(i) = (jump != 0.0) ? std::copysign(INF, jump) : slope;
        } else if (std::isnan(amplitude(i)) || std::isnan(b)) {
            mean(i) = NaN;
            gain(i) = NaN;
        }
    }
}

/// Lowest and highest input in a chunk, and the lowest and highest bias.
std::tuple<double, double, double, double> reach(Vector amplitude, Vector bias) {
    double bottom = INF;
    double top = -INF;
    double lowest = INF;
    double highest = -INF;
    for (i64 i = 0; i < amplitude.size(); ++i) {
        bottom = least_of(bottom, bias(i) - amplitude(i));
        top = greatest_of(top, bias(i) + amplitude(i));
        lowest = least_of(lowest, bias(i));
        highest = greatest_of(highest, bias(i));
    }
    return {bottom, top, lowest, highest};
}

/// As many inputs as a register holds, from one on; fewer at the end, where amplitudes of zero fill the rest.
struct Some {
    i64 first, count;

    Register of(Vector a) const {
        if (count == LANES) return Of<Register>::load(&a(first));
        double few[LANES] = {};
        for (i64 k = 0; k < count; ++k) few[k] = a(first + k);
        return Of<Register>::load(few);
    }
    /// Add to what is kept of those that are `inside`.
    template <class Flags> void add(Vector a, Flags inside, Register more) const {
        const Register before = of(a);
        const Register after = inside ? before + more : before;
        if (count == LANES) return keep(&a(first), after);
        double few[LANES];
        keep(few, after);
        for (i64 k = 0; k < count; ++k) a(first + k) = few[k];
    }
};

/// Add what a sloped piece brings on one `side` (1 above, -1 below) of the bias; it runs outwards, start to end.
///
/// ``integral cos^2(phi) dphi`` and ``integral (pi/2 - phi) cos(phi) dphi`` are written in the middle of the two ends'
/// angles from the peak and the half width between them.
void add_piece(double start, double end, double slope, double side, Vector amplitude, Vector bias, Vector mean,
    Vector gain, Vector level, Vector sway) {
    const Register none = Of<Register>::spread(0.0);
    for (i64 i = 0; i < amplitude.size(); i += LANES) {
        const Some part{i, least_of<i64>(LANES, amplitude.size() - i)};
        const Register A = part.of(amplitude), b = part.of(bias);
        Register near = (start - b) * side;
        Register far = (end - b) * side;
        // Between two breakpoints, not between their rounded distances from the bias.
        const auto whole = (near >= 0.0) & (far < A);
        near = none > near ? none : near;
        far = A < far ? A : far;
        const auto inside = (far > near) & (A > 0.0);
        if (!any(inside)) {
            continue;
        }
        const Register swept = whole ? none + (end - start) * side : far - near;
        const auto [s1, c1] = halves(A, near);
        const auto [s2, c2] = halves(A, far);
        const Register sin_middle = s1 * c2 + c1 * s2;
        const Register cos_middle = c1 * c2 - s1 * s2;
        // From the swept width itself: as a difference of two angles a piece much narrower than the amplitude would lose
        // its digits.
        const Register sin_width = 0.5 * swept / (A * sin_middle);
        const Register cos_width = c1 * c2 + s1 * s2;
        const Register flat = sin_middle * sin_width;
        const Register q = sin_width * sin_width;
        const Register cube = sin_width * q;
        const Register here = cube * value(EXCESS, q) + 2.0 * flat * sin_middle * cos_width;
        const Register lever = 2.0 * (angle(sin_middle, cos_middle) * flat + cos_middle * cube * value(LEVER, q));
        part.add(gain, inside, 2.0 / PI * slope * here);
        part.add(mean, inside, side * slope / PI * A * lever);
        part.add(level, inside, 2.0 / PI * slope * sin_width * value(ASIN, q));
        part.add(sway, inside, side * 2.0 / PI * slope * sin_width * cos_middle);
    }
}

/// Fill f, shape (4, 8), with what the four sums of `_even_side` add at t, and the first seven derivatives of each.
///
/// All follow from those of ``g = 1/sqrt(A^2 - t^2)``, which has ``(A^2 - t^2) g' = t g``.
void slopes_at(double t, double A, Matrix f) {
    double left = (A - t) * (A + t);
    double root = std::sqrt(left);
    {
        const double was1 = root;
        const double was2 = std::acos(t / A);
        const double was3 = 1.0 / root;
        f(0, 0) = was1;
        f(1, 0) = was2;
        f(2, 0) = was3;
    }
    for (i64 n = 0; n < 7; ++n) {
        f(2, n + 1) = ((2 * n + 1) * t * f(2, n) + n * n * (n ? f(2, n - 1) : 0.0)) / left;
    }
    f(3, 0) = t * f(2, 0);
    for (i64 n = 1; n < 8; ++n) {
        f(3, n) = t * f(2, n) + n * f(2, n - 1);
        f(0, n) = -f(3, n - 1);
        f(1, n) = -f(2, n - 1);
    }
}

/// Sums of sqrt(A^2 - t^2), acos(t/A), 1/sqrt(A^2 - t^2) and t/sqrt(A^2 - t^2) over evenly spaced edges.
///
/// t is the distance of an edge from the bias; `first` is the nearest and `last` lies behind the farthest, either way.
/// Near the peak, where the roots are singular, term by term; before it by Euler and Maclaurin's formula, whose rest
/// is a part in 10^15 of what is summed at these distances from the peak.
void even_side(Vector edges, i64 first, i64 last, double bias, double A, Vector sums, Matrix below, Matrix above) {
    i64 edge{};
    double t{}, root{}, power{};
    sums.fill(0.0);
    i64 way = (last > first) ? 1 : -1;
    i64 cut = (std::abs(last - first) <= (2 * ENDS)) ? last : last - way * ENDS;
    i64 begin = (cut != last) ? cut : first;
    for (i64 k = 0, k_end = std::abs(last - begin); k < k_end; ++k) {
        edge = begin + way * k;
        t = std::fabs(edges(edge) - bias);
        root = std::sqrt((A - t) * (A + t));
        sums(0) += root;
        sums(1) += std::acos(t / A);
        sums(2) += 1.0 / root;
        sums(3) += t / root;
    }
    if (cut == last) {
        return;
    }
    double p = std::fabs(edges(first) - bias);
    double q = std::fabs(edges(cut - way) - bias);
    double step = (q - p) / (std::abs(cut - first) - 1);
    slopes_at(p, A, below);
    slopes_at(q, A, above);
    double arc = std::asin(q / A) - std::asin(p / A);
    double fall = above(0, 0) - below(0, 0);
    sums(0) += 0.5 * (q * above(0, 0) - p * below(0, 0) + A * A * arc) / step;
    sums(1) += (q * above(1, 0) - p * below(1, 0) - fall) / step;
    sums(2) += arc / step;
    sums(3) -= fall / step;
    for (i64 i = 0; i < 4; ++i) {
        sums(i) += 0.5 * (above(i, 0) + below(i, 0));
        power = step;
        for (i64 j = 0; j < 4; ++j) {
            sums(i) += BERNOULLI(j) * power * (above(i, 2 * j + 1) - below(i, 2 * j + 1));
            power *= step * step;
        }
    }
}

/// Add what a staircase of equal steps brings, in a time that does not grow with the steps that are passed.
void add_stairs(Vector edges, double jump, Vector amplitude, Vector bias, Vector mean, Vector gain, Strided<double,
    1> level, Strided<double, 1> sway) {
    Scope scope;
    double A{}, b{};
    i64 low{}, high{}, beyond{}, before{}, middle{};
    Vector up = empty<double>(4);
    Vector down = empty<double>(4);
    Matrix below = empty<double>(4, 8);
    Matrix above = empty<double>(4, 8);
    for (i64 i = 0; i < amplitude.size(); ++i) {
        A = amplitude(i);
        b = bias(i);
        if (!(A > 0.0)) {
            continue;
        }
        // Edges that are passed: distances from the bias decide, as rounding of bias and amplitude together would not.
        low = searchsorted(edges, b - A);
        high = searchsorted(edges, b + A);
        if (low < edges.size() && !((b - edges(low)) < A)) {
            low += 1;
        }
        if (high > 0 && !((edges(high - 1) - b) < A)) {
            high -= 1;
        }
        beyond = searchsorted_right(edges, b);
        before = searchsorted(edges, b);
        even_side(edges, beyond, greatest_of<i64>(high, beyond), b, A, up, below, above);
        even_side(edges, before - 1, least_of<i64>(low, before) - 1, b, A, down, below, above);
        // an edge at the bias itself
        middle = beyond - before;
        gain(i) += 2.0 * jump / (PI * A) * ((up(0) + down(0)) / A + middle);
        mean(i) += jump / PI * (up(1) - down(1));
        level(i) += jump / PI * (up(2) + down(2) + middle / A);
        sway(i) += jump / (PI * A) * (up(3) - down(3));
    }
}

/// Add what a jump at `edge` brings where the input passes it.
void add_jump(double edge, double jump, Vector amplitude, Vector bias, Vector mean, Vector gain, Strided<double,
    1> level, Strided<double, 1> sway) {
    double A{}, distance{}, s{}, c{}, side{}, rate{};
    bool inside{};
    for (i64 i = 0; i < amplitude.size(); ++i) {
        A = amplitude(i);
        distance = std::fabs(edge - bias(i));
        inside = distance < A;
        A = inside ? A : 1.0;
        std::tie(s, c) = halves(A, inside ? distance : 0.0);
        side = (edge == bias(i)) ? 0.0 : std::copysign(1.0, edge - bias(i));
        gain(i) += inside ? 4.0 / PI * jump * s * c / A : 0.0;
        mean(i) += inside ? side * 2.0 / PI * jump * angle(s, c) : 0.0;
        // It is passed at the rate of the input: twice s times c is that over the amplitude.
        rate = 2.0 * s * c;
        level(i) += inside ? jump / (PI * A * rate) : 0.0;
        sway(i) += inside ? jump * (edge - bias(i)) / (PI * A * A * rate) : 0.0;
    }
}

/// One chunk, of a map of the `shape` that `shape_of` tells: only what some of its inputs reach is visited.
void describe(Vector breakpoints, Vector slopes, Vector intercepts, Vector jumps, const std::tuple<bool,
    double>& shape, Vector amplitude, Vector bias, Vector mean, Vector gain, Strided<double, 2> by) {
    double bottom{}, top{}, lowest{}, highest{}, even{}, low{}, high{};
    bool sloped{};
    start(breakpoints, slopes, intercepts, jumps, amplitude, bias, mean, gain, by);
    std::tie(bottom, top, lowest, highest) = reach(amplitude, bias);
    const Vector level(by.row(0).data, {by.shape(1)}), sway(by.row(1).data, {by.shape(1)});
    i64 k = breakpoints.size();
    std::tie(sloped, even) = shape;
    for (i64 piece = 0, piece_end = sloped ? k + 1 : 0; piece < piece_end; ++piece) {
        low = (piece > 0) ? breakpoints(piece - 1) : -INF;
        high = (piece < k) ? breakpoints(piece) : INF;
        if (slopes(piece) != 0.0 && high > lowest && low < top) {
            add_piece(low, high, slopes(piece), 1.0, amplitude, bias, mean, gain, level, sway);
        }
        if (slopes(piece) != 0.0 && low < highest && high > bottom) {
            add_piece(high, low, slopes(piece), -1.0, amplitude, bias, mean, gain, level, sway);
        }
    }
    i64 first = searchsorted_right(breakpoints, bottom);
    i64 last = searchsorted(breakpoints, top);
    double jump = 0.0;
    if ((last - first) > FEW) {
        jump = (even != 0.0) ? even : even_jump(breakpoints, jumps, first, last);
    }
    if (jump != 0.0) {
        add_stairs(breakpoints.slice(first, last), jump, amplitude, bias, mean, gain, by.row(0), by.row(1));
        return;
    }
    for (i64 edge = first; edge < last; ++edge) {
        if (jumps(edge) != 0.0) {
            add_jump(breakpoints(edge), jumps(edge), amplitude, bias, mean, gain, by.row(0), by.row(1));
        }
    }
}

/// Fill `mean`, `gain` and what they change `by` for every pair of `amplitude` and `bias`; only breakpoints inside
/// the oscillation are visited.
///
/// Parameters
/// ----------
/// breakpoints : array, shape (k,)
///     Ascending.
/// slopes, intercepts : array, shape (k + 1,)
///     Piece i is ``y = slopes[i] * x + intercepts[i]``.
/// jumps : array, shape (k,)
///     Step of y at each breakpoint; exactly zero where the map is continuous.
/// amplitude, bias : array, shape (n,)
///     The input ``bias + amplitude * sin(phi)``, amplitude at least zero. At zero the gain is the slope at the bias
///     (the mean slope at a corner, infinite at a jump); not-a-number gives not-a-number.
/// mean, gain : array, shape (n,)
///     Where the results are written.
/// by : array, shape (2, n)
///     Likewise: derivatives of the mean by bias and amplitude, where the amplitude is above zero. Those of the gain
///     follow from them, as all are moments of the map's slope: ``2 by[1] / A`` by the bias, and by the amplitude
///     ``2 (by[0] - gain) / A``, for the squares of sine and cosine add up to one.
void biased_sinusoid(Vector breakpoints, Vector slopes, Vector intercepts, Vector jumps, Vector amplitude, Vector bias,
    Vector mean, Vector gain, Matrix by) {
    i64 j{};
    std::tuple<bool, double> shape = shape_of(breakpoints, slopes, jumps);
    for (i64 i = 0; i < amplitude.size(); i += CHUNK) {
        j = least_of<i64>(i + CHUNK, amplitude.size());
        describe(breakpoints, slopes, intercepts, jumps, shape, amplitude.slice(i, j), bias.slice(i, j), mean.slice(i,
            j), gain.slice(i, j), by.cut(ALL, Span{i, j}));
    }
}

}  // namespace describing_piecewise
}  // namespace EPP_ARCH
}  // namespace epp
