#pragma once
// Fourier coefficients of an element's outputs in its periodic regime, and their derivatives.
//
// The sums are those of docs/theory/harmonic_balance.md, Coefficients without sampling. Unknowns are the mean, the real
// and the imaginary parts of the input's coefficients, and the frequency: 2 n + 2 at order n. A period has pieces, one
// more than switches; the first begins where the period does.

#include "engine/constants.hpp"
#include "structures.hpp"
#include "periodic.hpp"

namespace epp {
inline namespace EPP_ARCH {

namespace answers {

constexpr double GRAZES = 1e-300;
constexpr double NO_JUMP = 1e-14;
constexpr double TURN = 6.283185307179586;

void means(const Pieces& pieces, i64 p, i64 n, ComplexVector wave);
double level(const Table& table, const Pieces& pieces, i64 p, i64 o);
std::tuple<Complex, Complex> product(ComplexVector S, i64 n, i64 k, i64 m);
Complex convolved(ComplexVector S, i64 n, i64 k, ComplexVector z, bool factor);
void coefficients(const Table& table, const Pieces& pieces, ComplexVector z, double omega, ComplexMatrix W,
    ComplexMatrix S, ComplexMatrix R);
std::tuple<std::tuple<i64, i64, double, Vector, Vector, Indices, Matrix>, Pieces, std::tuple<ComplexMatrix,
    ComplexMatrix, ComplexMatrix>> answer(const Table& table, ComplexVector z, double omega, i64 mode, bool clocked,
    Vector rest);
bool jumps(const Table& table, const Pieces& pieces, ComplexVector z, double omega, Matrix jump);
double value(ComplexVector c, double phi, i64 power);
double read(double free, double rate, double clock, ComplexVector z, double omega, double phi, Vector by_x);
double reset(const Table& table, i64 g, i64 h, ComplexVector z, double omega, double phi, Vector by_x);
void pass_on(const Table& table, const Pieces& pieces, ComplexVector z, double omega, i64 i, Matrix here, Matrix moved,
    Matrix memory, Vector by_x);
void move(const Table& table, const Pieces& pieces, ComplexVector z, double omega, Matrix here, Matrix moved,
    Matrices memory, Vector by_x);
void add_moved(const Pieces& pieces, Matrix jump, Matrix moved, ComplexMatrices dW);
void add_memory(const Table& table, const Pieces& pieces, Matrices memory, ComplexVector wave, ComplexMatrices dW);
ComplexMatrices slopes(const Table& table, const Pieces& pieces, ComplexVector z, double omega, ComplexMatrix S,
    ComplexMatrix R, Matrix jump, Vector at_rest);
Matrix jacobian(ComplexMatrices dW, ComplexMatrix W, ComplexMatrices L, ComplexMatrices dL, Matrix on_bias,
    Matrix on_mean, i64 pivot);
bool equations(const Automata& automata, Vector rest, Vector X, const std::tuple<ComplexMatrices,
    ComplexMatrices>& linear, const std::tuple<Matrix, Matrix, Vector>& means, i64 pivot, Matrix J, Vector R,
    ComplexMatrix W, Indices switches);

}  // namespace answers
}  // namespace EPP_ARCH
}  // namespace epp
