#include "engine/signals.hpp"

namespace epp {
inline namespace EPP_ARCH {

/// Rate of the state of a run; one that is rounding of what it was added up from is none.
void rate_at_end(const Model& model, const Combinations& compiled, i64 q, const Workspace& workspace) {
    Vector rate = workspace.rate;
    Matrix Sg = workspace.Sg;
    Vector f = workspace.push;
    Vector small = workspace.small;
    i64 n_s = Sg.shape(1);
    take(workspace.X.row(0), workspace.x);
    for (i64 j = 0; j < n_s; ++j) {
        if (model.smooth_kind(j) != DELAY_LINE) {
            smooth_term(model, j, 0, workspace.X, workspace.H, Sg, workspace.arg, workspace.aux);
        }
    }
    rates(compiled, q, workspace.x, f, Sg, 0, 0.0, rate);
    take_sizes(workspace.wide, workspace.x);
    size_of_rate(compiled, q, workspace.wide, 1.0, small);
    // The verdict recognises a run at rest by rates that are exactly zero.
    for (i64 i = 0, i_end = compiled.S.shape(1); i < i_end; ++i) {
        if (n_s == 0 && !(std::fabs(rate(i)) > (64.0 * EPS * (std::fabs(f(i)) + small(i))))) {
            rate(i) = 0.0;
        }
    }
}

/// Signals at state x at the samples first..stop.
void write_rest(const Combinations& compiled, i64 q, Vector x, Vector still, Vector sigma, Indices rows, i64 first,
    i64 stop, Matrix out) {
    for (i64 k = first; k < stop; ++k) {
        write(compiled.Y.row(q), compiled.Ys.row(q), x, still, sigma, out.row(rows(k)));
    }
}

/// Signals at the samples first..stop of a series step without smooth channels, by series of their own.
///
/// They see few states of a large loop, and several samples come in a step.
void sample_signals(const Combinations& compiled, i64 q, const Workspace& workspace, i64 last, const Samples& samples,
    i64 first, i64 stop, double t, double d) {
    Matrix Z = workspace.Z;
    double per_unit = 1.0 / d;
    for (i64 k = 0, k_end = last + 1; k < k_end; ++k) {
        sparse_sum(compiled.y_entries.row(q), compiled.y_row.row(q), compiled.y_row_end.row(q), workspace.X.row(k),
            1.0, Z.row(k));
    }
    add(Z.row(0), workspace.still);
    for (i64 k = first; k < stop; ++k) {
        polynomial(Z, last, greatest_of(0.0, (samples.times(k) - t) * per_unit), samples.out.row(samples.rows(k)));
    }
}

/// Signals at the samples first..stop of a series step. (A call with all arrays would be dearer.)
void sample_series(Matrix Y, Matrix Ys, Matrix X, i64 last, Matrix Sg, Vector samples, Indices rows, i64 first,
    i64 stop, double t, double d, Vector still, Vector x, Matrix out) {
    double u{}, sigma{};
    Vector row{};
    double per_unit = 1.0 / d;
    // A sample left over by the step before may lie before this one by rounding, which no series extrapolates.
    for (i64 k = first; k < stop; ++k) {
        u = greatest_of(0.0, (samples(k) - t) * per_unit);
        polynomial(X, last, u, x);
        row = out.row(rows(k));
        row_sum_from(still, Y, x, 1.0, row);
        for (i64 j = 0; j < Sg.shape(1); ++j) {
            sigma = smooth_at(Sg, last, j, u);
            for (i64 i = 0; i < Ys.shape(0); ++i) {
                row(i) += Ys(i, j) * sigma;
            }
        }
    }
}

}  // namespace EPP_ARCH
}  // namespace epp
