#pragma once
// Smooth functions of one argument beyond sine, cube and the falling friction: values, slopes, Taylor series.
//
// The numbers are those of ``SMOOTH_KINDS``. Series are scaled to the step, as in
// `series`: with the coefficients of the argument in `arg` up to order k, coefficient k of
// the scaled function goes into `Sg`. `aux` holds the squared argument (powers) or the scaled slope (others).

#include "engine/constants.hpp"
#include "structures.hpp"

namespace epp {
inline namespace EPP_ARCH {

double _product(Matrix a, Matrix b, i64 j, i64 k);
void _power_term(i64 kind, i64 j, i64 k, double scale, Matrix Sg, Matrix arg, Matrix aux);
std::tuple<double, double> curve(i64 kind, double x);
void curve_term(i64 kind, i64 j, i64 k, double scale, Matrix Sg, Matrix arg, Matrix aux);
bool hides(i64 kind, i64 j, i64 k, double limit, double scale, Matrix Sg, Matrix arg, Matrix aux);
bool has_fallen(i64 kind, i64 j, i64 k, double limit, double scale, Matrix Sg, Matrix arg, Matrix aux);
double curve_slope_term(i64 kind, i64 j, i64 k, double scale, Matrix Sg, Matrix arg, Matrix aux);

}  // namespace EPP_ARCH
}  // namespace epp
