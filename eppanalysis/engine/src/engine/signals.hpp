#pragma once
// What follows from a state in its mode: constant parts until the next event, its rate, the signals.

#include "engine/constants.hpp"
#include "structures.hpp"
#include "engine/flow.hpp"
#include "engine/series.hpp"
#include "engine/switches.hpp"

namespace epp {
inline namespace EPP_ARCH {

inline void enter(const Combinations& compiled, i64 q, Vector H, Vector f, Vector constant, Vector lift, Vector still);
inline void rates(const Combinations& compiled, i64 q, Vector x, Vector f, Matrix Sg, i64 last, double u, Vector rate);
void rate_at_end(const Model& model, const Combinations& compiled, i64 q, const Workspace& workspace);
inline void write(Matrix Y, Matrix Ys, Vector x, Vector still, Vector sigma, Vector row);
void write_rest(const Combinations& compiled, i64 q, Vector x, Vector still, Vector sigma, Indices rows, i64 first,
    i64 stop, Matrix out);
inline double slack_at(double t, double step);
void sample_signals(const Combinations& compiled, i64 q, const Workspace& workspace, i64 last, const Samples& samples,
    i64 first, i64 stop, double t, double d);
void sample_series(Matrix Y, Matrix Ys, Matrix X, i64 last, Matrix Sg, Vector samples, Indices rows, i64 first,
    i64 stop, double t, double d, Vector still, Vector x, Matrix out);

/// Constant parts of the rate, the guards (on state and rate; on the state alone), the signals, until an event.
inline void enter(const Combinations& compiled, i64 q, Vector H, Vector f, Vector constant, Vector lift, Vector still) {
    double v{};
    for (i64 i = 0, i_end = compiled.N.shape(1); i < i_end; ++i) {
        v = 0.0;
        for (i64 j = 0; j < H.size(); ++j) {
            v += compiled.N(q, i, j) * H(j);
        }
        f(i) = v;
    }
    for (i64 g = 0, g_end = compiled.n_guards(q); g < g_end; ++g) {
        v = 0.0;
        for (i64 j = 0; j < H.size(); ++j) {
            v += compiled.gH(q, g, j) * H(j);
        }
        const double was1 = v;
        constant(g) = was1;
        lift(g) = was1;
        if (compiled.on_rate(q, g)) {
            v = 0.0;
            for (i64 j = 0; j < H.size(); ++j) {
                v += compiled.gfH(q, g, j) * H(j);
            }
            lift(g) = v;
        }
    }
    for (i64 i = 0, i_end = compiled.YH.shape(1); i < i_end; ++i) {
        v = 0.0;
        for (i64 j = 0; j < H.size(); ++j) {
            v += compiled.YH(q, i, j) * H(j);
        }
        still(i) = v;
    }
}

/// Rate of the state x at place u of a series step.
inline void rates(const Combinations& compiled, i64 q, Vector x, Vector f, Matrix Sg, i64 last, double u, Vector rate) {
    double sigma{};
    rate_from(compiled, q, f, x, 1.0, rate);
    for (i64 j = 0; j < Sg.shape(1); ++j) {
        sigma = smooth_at(Sg, last, j, u);
        for (i64 i = 0, i_end = compiled.S.shape(1); i < i_end; ++i) {
            rate(i) += compiled.S(q, i, j) * sigma;
        }
    }
}

/// Signals at state x.
inline void write(Matrix Y, Matrix Ys, Vector x, Vector still, Vector sigma, Vector row) {
    row_sum_from(still, Y, x, 1.0, row);
    for (i64 j = 0; j < sigma.size(); ++j) {
        for (i64 i = 0; i < Ys.shape(0); ++i) {
            row(i) += Ys(i, j) * sigma(j);
        }
    }
}

/// How far from the end of a step, at time t, a sample counts as at its end: the rounding of times.
///
/// It is little of the step, too: smooth motion may be faster than the steps of its mode by any factor.
inline double slack_at(double t, double step) {
    return least_of(16.0 * EPS * t, 1e-09 * step);
}

}  // namespace EPP_ARCH
}  // namespace epp
