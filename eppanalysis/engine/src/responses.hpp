#pragma once
// Responses of a linear part and their slopes, for matrices that are too small for a call to LAPACK each.

#include "engine/constants.hpp"
#include "structures.hpp"

namespace epp {
inline namespace EPP_ARCH {

namespace responses {

std::tuple<ComplexMatrix, Indices, ComplexMatrix> room_for_answers(i64 n, i64 w);
void subtracted(Matrix A, Complex s, double beside, ComplexMatrix matrix);
std::tuple<i64, double> pivot_row(ComplexMatrix matrix, i64 k);
bool factored(ComplexMatrix matrix, Indices pivots);
double beside(Matrix A, Complex s);
void substitute(ComplexMatrix matrix, Indices pivots, ComplexMatrix x);
void answer_at(Matrix A, Matrix B, Matrix C, Complex s, Complex ds, const std::tuple<ComplexMatrix, Indices,
    ComplexMatrix>& room, Strided<Complex, 3> out);
void response_and_slope(Matrix A, Matrix B, Matrix C, ComplexVector s, ComplexVector ds, View<Complex, 4> out);

}  // namespace responses
}  // namespace EPP_ARCH
}  // namespace epp
