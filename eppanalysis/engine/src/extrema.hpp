#pragma once
// How far signals go that are Legendre series on each of many pieces.

#include "engine/constants.hpp"
#include "structures.hpp"

namespace epp {
inline namespace EPP_ARCH {

namespace extrema {

constexpr i64 ITERATIONS = 8;
constexpr double STANDS = 1e-09;
constexpr i64 TRIED = 4;

double top(Vector c, double u, double sign);
double greatest(Matrix c, Matrix fine, Vector grid, double sign);
void spans(Matrices c, Matrices fine, Vector grid, Vector out);

}  // namespace extrema
}  // namespace EPP_ARCH
}  // namespace epp
