#pragma once
// Exact steps of an affine system, with bounds for its guards.
//
// For one step h the matrices are made that carry state, rate and guards from the start of the step to its end, with a
// bound on how far a guard can stray from the cubic through its end values; for long steps, with a bound on its travel.

#include "engine/constants.hpp"
#include "structures.hpp"

namespace epp {
inline namespace EPP_ARCH {

void multiply(Matrix P, Matrix Q, double scale, Matrix out);
void _copy(Matrix out, Matrix source);
double growth_rate(Matrix M, Matrix P, Matrix Q);
void _keep_sparse(Matrix M, Matrix entries, Indices row, Indices row_end);
void choose_step(const Combinations& compiled, const Work& work, i64 q, double base_step);
inline void rate_from(const Combinations& compiled, i64 q, Vector start, Vector x, double scale, Vector out);
inline void size_of_rate(const Combinations& compiled, i64 q, Vector sizes, double scale, Vector out);
void _add(Matrix out, Matrix P);
bool _any_above(Matrix P, double scale, Vector limits);
void flow(Matrix M, double h, double rate, Matrix integral, Matrix power, Matrix half, Matrix term, Matrix work);
void _fill_step(Matrix T, Matrix gf, i64 G, Matrix integral, Matrix power);
void _sizes_of_powers(Matrix M, double step, double shift, Matrix P, Matrix Q, Matrix total);
void compile_step(const Combinations& compiled, const Work& work, i64 q);
void compile_long(const Combinations& compiled, const Work& work, i64 q);
inline void rate_of(const Combinations& compiled, i64 q, Vector x, double scale, Vector out);

/// out = scale * (start + M x).
inline void rate_from(const Combinations& compiled, i64 q, Vector start, Vector x, double scale, Vector out) {
    if (compiled.row_end.shape(1) > 0) {
        sparse_sum_from(start, compiled.entries.row(q), compiled.row.row(q), compiled.row_end.row(q), x, scale, out);
    } else {
        row_sum_from(start, compiled.M.row(q), x, scale, out);
    }
}

/// out = scale * abs(M) sizes.
inline void size_of_rate(const Combinations& compiled, i64 q, Vector sizes, double scale, Vector out) {
    if (compiled.row_end.shape(1) > 0) {
        sparse_size_sum(compiled.entries.row(q), compiled.row.row(q), compiled.row_end.row(q), sizes, scale, out);
    } else {
        row_sum(compiled.M_size.row(q), sizes, scale, out);
    }
}

/// out = scale * M x.
inline void rate_of(const Combinations& compiled, i64 q, Vector x, double scale, Vector out) {
    if (compiled.row_end.shape(1) > 0) {
        sparse_sum(compiled.entries.row(q), compiled.row.row(q), compiled.row_end.row(q), x, scale, out);
    } else {
        row_sum(compiled.M.row(q), x, scale, out);
    }
}

}  // namespace EPP_ARCH
}  // namespace epp
