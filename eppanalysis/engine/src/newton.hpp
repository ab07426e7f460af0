#pragma once
// Newton's method for DF balances, start to end, where all elements have closed forms in kernels.
//
// Few points on a curve took their time by calls, many on a grid by what was written and read again between them. What is
// computed is what `describing` does step by step for other elements, to the last bit.

#include "engine/constants.hpp"
#include "structures.hpp"
#include "balances.hpp"
#include "describing/closed_forms.hpp"
#include "describing/piecewise.hpp"
#include "describing/rate_limit.hpp"
#include "responses.hpp"

namespace epp {
inline namespace EPP_ARCH {

namespace newton {

constexpr i64 AT_ONCE = 64;

Matrix shapes(Indices first, const std::tuple<Vector, Vector, Vector, Vector>& maps);
void describe(Matrix X, Indices points, i64 begin, Indices block, Indices places, i64 pivot, double relative,
    const std::tuple<Indices, std::tuple<Vector, Vector, Vector, Vector>, Matrix>& elements, Matrix shapes, bool free,
    Matrix row, ComplexMatrix inputs, const std::tuple<Matrix, ComplexMatrix, Matrices, ComplexMatrices>& of_elements);
void newton(Matrix X, Matrix normal, i64 iterations, const std::tuple<double, double, double, double, double,
    double>& limits, const std::tuple<Indices, Indices, Indices>& parts, Indices places, i64 pivot,
    const std::tuple<Matrix, Matrix, Vector>& static_, const std::tuple<Indices, std::tuple<Vector, Vector, Vector,
    Vector>, Matrix>& elements, const std::tuple<Matrix, Matrix, Matrix, Matrix>& linear, ComplexMatrices L,
    ComplexVector around, Matrices jacobian, Flags found);

}  // namespace newton
}  // namespace EPP_ARCH
}  // namespace epp
