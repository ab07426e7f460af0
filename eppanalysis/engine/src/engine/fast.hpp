#pragma once
// Fast steps of an affine mode by matrices made beforehand, each with the proof that no guard rises on it.
//
// A fast step proves it from end values, end rates and a bound on the fourth derivative (Bernstein coefficients of the
// cubic plus its remainder); a long one, of 16 to 65536 steps of the grid, from a bound on how far a guard travels at all.
// Derived in docs/theory/engine.md, "Two ways to advance".

#include "engine/constants.hpp"
#include "structures.hpp"
#include "engine/flow.hpp"
#include "engine/signals.hpp"

namespace epp {
inline namespace EPP_ARCH {

inline bool too_large(Vector x);
inline bool pays(const Combinations& compiled, const Samples& samples, Progress& now);
inline void arm(const Combinations& compiled, const Work& work, i64 q, const Workspace& workspace);
inline bool _long_step(const Combinations& compiled, i64 q, i64 level, Vector xd, Vector speed, Vector g0, Vector tol,
    Vector stray, Vector end);
inline void _move(Vector x, Vector xd, Vector speed, Vector g0, Vector g1, Vector end, Vector low, Vector high);
bool go_far(const Combinations& compiled, const Work& work, const Workspace& workspace, const Samples& samples,
    Progress& now);
inline std::tuple<i64, i64, i64> _fast_steps(Matrix T, Matrix bound, Matrix Y, Matrix Ys, Vector x, Vector xd,
    Vector speed, Vector g0, Vector g1, Vector tol, Vector stray, Vector end, Vector still, Vector one, Vector sigma,
    Vector times, Indices rows, Matrix out, double origin, i64 j, double h, double t, double t_stop, i64 i_sample,
    i64 n_samples, i64 quiet, Vector low, Vector high);
bool go_fast(const Combinations& compiled, const Workspace& workspace, const Samples& samples, Progress& now);
inline double predicted(const Combinations& compiled, i64 q, Vector g0, Vector g1, Vector tol, double h, Vector end);

/// Whether a state is beyond all bounds, or no number.
inline bool too_large(Vector x) {
    for (i64 i = 0; i < x.size(); ++i) {
        if (!(std::fabs(x(i)) < LARGEST)) {
            return true;
        }
    }
    return false;
}

/// Whether steps by matrices may be made: where series go as far for less, only long ones, once they are due.
inline bool pays(const Combinations& compiled, const Samples& samples, Progress& now) {
    if (compiled.far(now.q) == 0.0) {
        return true;
    }
    bool until_sample = now.i_sample == now.n_samples || samples.times(now.i_sample) >= (now.t + LONG_QUIET * now.h);
    return now.quiet >= LONG_QUIET && until_sample;
}

/// Matrices, rates and guards of a linear mode combination, for the fast steps that follow.
inline void arm(const Combinations& compiled, const Work& work, i64 q, const Workspace& workspace) {
    double v{}, size{};
    if (!compiled.ready(q)) {
        compile_step(compiled, work, q);
    }
    Vector x = workspace.x;
    Vector xd = workspace.slope;
    Vector wide = workspace.wide;
    Vector speed = workspace.speed;
    Vector constant = workspace.constant;
    Vector g0 = workspace.g0;
    take_sizes(wide, x);
    // The rate is summed anew from the state, so that steps carry no rounding from one mode into the next.
    rate_from(compiled, q, workspace.push, x, 1.0, xd);
    take_sizes(speed, xd);
    i64 G = compiled.n_guards(q);
    for (i64 g = 0; g < G; ++g) {
        v = constant(g) + dot(compiled.ga.row(q, g), x);
        size = std::fabs(constant(g)) + dot(compiled.ga_size.row(q, g), wide);
        if (compiled.on_rate(q, g)) {
            v += dot(compiled.gb.row(q, g), xd);
            size += dot(compiled.gb_size.row(q, g), speed);
        }
        {
            const double was1 = v;
            const double was2 = dot(compiled.gf.row(q, g), xd);
            const double was3 = 256.0 * EPS * size;
            g0(g) = was1;
            workspace.g1(g) = was2;
            workspace.tol(g) = was3;
        }
    }
    for (i64 g = G; g < g0.size(); ++g) {
        g0(g) = -1.0;
        workspace.g1(g) = 0.0;
        workspace.tol(g) = 0.0;
    }
}

/// Increments over a long step into `end`; False when an event inside cannot be excluded.
inline bool _long_step(const Combinations& compiled, i64 q, i64 level, Vector xd, Vector speed, Vector g0, Vector tol,
    Vector stray, Vector end) {
    // A bound on travel alone, whichever way a guard goes: enough at rest, where this step is for.
    row_sum_from(tol, compiled.reach.row(q, level), speed, 1.0, stray);
    for (i64 g = 0, g_end = compiled.n_guards(q); g < g_end; ++g) {
        if (!((g0(g) + stray(g)) < 0.0)) {
            return false;
        }
    }
    row_sum(compiled.T_long.row(q, level), xd, 1.0, end);
    return true;
}

/// Take over the increments of a step.
inline void _move(Vector x, Vector xd, Vector speed, Vector g0, Vector g1, Vector end, Vector low, Vector high) {
    i64 wide = x.size();
    i64 half = g0.size();
    add(x, end.slice(0, wide));
    lower_to(low, x);
    raise_to(high, x);
    take(xd, end.slice(wide, 2 * wide));
    take_sizes(speed, xd);
    add(g0, end.slice(2 * wide, 2 * wide + half));
    take(g1, end.slice(2 * wide + half, end.shape(0)));
}

/// Steps of the grid from its point j on, with the samples on it; returns the point, the next sample, why there.
///
/// EVENT_AHEAD: a switch within the next step can't be excluded, and what the step would add is in `end`. OFF_GRID: the
/// next step would go beyond `t_stop` or a sample. LONG_AHEAD: so much has passed without a switch that a long step may
/// be tried, or the state has grown too large. A row of ones is in `one`.
inline std::tuple<i64, i64, i64> _fast_steps(Matrix T, Matrix bound, Matrix Y, Matrix Ys, Vector x, Vector xd,
    Vector speed, Vector g0, Vector g1, Vector tol, Vector stray, Vector end, Vector still, Vector one, Vector sigma,
    Vector times, Indices rows, Matrix out, double origin, i64 j, double h, double t, double t_stop, i64 i_sample,
    i64 n_samples, i64 quiet, Vector low, Vector high) {
    double t1{};
    i64 wide = x.size();
    i64 half = g0.size();
    double slack = slack_at(t_stop, h);
    i64 after = 2 * wide + half;
    while (true) {
        if (i_sample < n_samples && times(i_sample) <= (t + slack)) {
            write(Y, Ys, x, still, sigma, out.row(rows(i_sample)));
            i_sample += 1;
        }
        t1 = origin + (j + 1) * h;
        if (t1 > t_stop || (i_sample < n_samples && times(i_sample) < (t1 - slack))) {
            return {j, i_sample, OFF_GRID};
        }
        // T acts on the rate, not on the state: what is added is small near rest, and no large numbers cancel.
        row_sum(T, xd, 1.0, end);
        row_sum(bound, speed, 1.0, stray);
        // Ordinates of the cubic in Bernstein form are its end values and these less, or more, a third of a step of its
        // rates; the middle ones are lifted by the remainder (docs/theory/engine.md, Fast step).
        if (!cubics_below(g0, g1, end.slice(2 * wide, after), end.slice(after, end.shape(0)), h / 3.0, tol, stray)) {
            return {j, i_sample, EVENT_AHEAD};
        }
        _move(x, xd, speed, g0, g1, end, low, high);
        j += 1;
        t = t1;
        quiet += 1;
        if (any_above(x, 1.0 / LARGEST, one) || t >= t_stop || (quiet >= LONG_QUIET && (i_sample == n_samples ||
            times(i_sample) >= (t + LONG_QUIET * h)))) {
            return {j, i_sample, LONG_AHEAD};
        }
    }
}

/// Fraction of the step that surely holds the first event, by the guards' cubics: how far the series need reach.
///
/// Guards at zero are left to the rules of the series.
inline double predicted(const Combinations& compiled, i64 q, Vector g0, Vector g1, Vector tol, double h, Vector end) {
    double a{}, b{}, c{}, d{}, u{}, w{}, v{};
    double first = 1.0;
    i64 half = g0.size();
    i64 place = end.size() - 2 * half;
    for (i64 g = 0, g_end = compiled.n_guards(q); g < g_end; ++g) {
        a = g0(g);
        b = h * g1(g);
        c = g0(g) + end(place + g);
        d = h * end(place + half + g);
        // The cubic lies below zero where its four Bernstein ordinates do; only the others are looked at, on a grid of
        // u.
        if (a > (-tol(g)) || (c <= 0.0 && (a + b / 3.0) <= 0.0 && (c - d / 3.0) <= 0.0)) {
            continue;
        }
        u = 0.05;
        // Hermite's form of the cubic through end values and end rates.
        while (u < first) {
            w = 1.0 - u;
            v = w * w * ((1.0 + 2.0 * u) * a + u * b) + u * u * ((3.0 - 2.0 * u) * c - w * d);
            if (v > 0.0) {
                first = u;
            }
            u += 0.05;
        }
    }
    return first + 0.05;
}

}  // namespace EPP_ARCH
}  // namespace epp
