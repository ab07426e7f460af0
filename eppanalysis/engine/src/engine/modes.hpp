#pragma once
// The affine system of one combination of element modes, with its guards.

#include "engine/constants.hpp"
#include "structures.hpp"
#include "engine/flow.hpp"
#include "engine/tables.hpp"

namespace epp {
inline namespace EPP_ARCH {

inline bool is_of(const Combinations& compiled, i64 q, Indices modes);
bool _equal(Vector row, Vector other);
bool _same_but_constants(const Model& model, i64 a, i64 b);
i64 _alike(const Model& model, const Combinations& compiled, Indices modes);
void _output_equations(const Model& model, Indices modes, Matrix E, Matrix F);
bool _solve(Matrix E, Matrix F);
void _put(Matrix out, i64 first, Matrix block);
void _add_product(Matrix out, Matrix P, Matrix Q);
void _hold_input(Matrix rate, Vector c, Matrix B, i64 w);
i64 _is_linear(const Model& model, Matrix rate, Matrix F);
void _take(Matrix block, Matrix source, i64 first);
void _write_mode(const Combinations& compiled, i64 q, Matrix rate, Matrix F, Matrix inputs, Matrix signals);
bool compile_modes(const Model& model, const Combinations& compiled, const Work& work, i64 q, Indices modes);
void _add_row(Vector out, double factor, Vector row);
void _guard_rows(const Model& model, const Combinations& compiled, i64 q, i64 k, i64 g);
void _guard_shape(const Combinations& compiled, i64 q, i64 k);
void _guard_with_rate(const Combinations& compiled, i64 q, i64 k);
void compile_guards(const Model& model, const Combinations& compiled, i64 q, Indices modes);
i64 find_combination(const Model& model, const Combinations& compiled, const Work& work, Indices modes,
    double base_step);

/// Whether place q of the table holds the combination `modes`.
inline bool is_of(const Combinations& compiled, i64 q, Indices modes) {
    for (i64 e = 0; e < modes.size(); ++e) {
        if (compiled.key(q, e) != modes(e)) {
            return false;
        }
    }
    return true;
}

}  // namespace EPP_ARCH
}  // namespace epp
