#pragma once
// Newton's method for many DF balances, but for what elements and linear part answer.
//
// What the equations are is in `balance`; here are the loops over points, elements and
// outputs, which are too short for array operations to be worth their calls.

#include "engine/constants.hpp"
#include "structures.hpp"
#include "responses.hpp"

namespace epp {
inline namespace EPP_ARCH {

namespace balances {

constexpr double FAR = 300.0;
constexpr double SINGULAR = 1e-13;

Matrix room_for(i64 size);
bool take(Matrix J, Vector R, Indices rows, Indices columns, Vector border, double edge, Matrix matrix);
void eliminate(Matrix matrix);
bool solve_at(Matrix J, Vector R, Indices rows, Indices columns, Vector border, double edge, Matrix matrix,
    Vector step);
void shift(Matrix X, Indices places, i64 pivot, Indices of_outputs, double relative, ComplexMatrix inputs, Matrices a,
    Matrices b, Matrix omega, Matrices steps);
void balance_at(Vector x, i64 k, Indices block, Indices places, Indices owner, i64 pivot, const std::tuple<Matrix,
    Matrix, Vector>& static_, const std::tuple<Matrix, ComplexMatrix, Matrices, ComplexMatrices>& of_elements,
    ComplexMatrix inputs, ComplexMatrix L, ComplexMatrix dL, Matrix J, Vector R);
void assemble(Matrix X, Indices places, Indices owner, i64 pivot, const std::tuple<Matrix, Matrix, Vector>& static_,
    const std::tuple<Matrix, ComplexMatrix, Matrices, ComplexMatrices>& of_elements, ComplexMatrix inputs,
    ComplexMatrices L, ComplexMatrices dL, Matrices J, Matrix R);
void drive(ComplexMatrices L, ComplexMatrix gains, Indices owner, Indices others, i64 pivot, ComplexMatrix inputs);
void solve(Matrices J, Matrix R, Indices rows, Indices columns, Matrix border, double edge, Matrix step, Flags regular);
std::tuple<double, bool> move_at(Vector x, Indices columns, Indices places, Vector step, double longest);
void move(Matrix X, Indices places, Matrix step, double longest, Vector largest, Flags sound);

}  // namespace balances
}  // namespace EPP_ARCH
}  // namespace epp
