#pragma once
// Fourier series and the automaton of an element whose input is one.
//
// A series is a row of complex coefficients c[0..n], real c[0], and means ``Re(sum c[k] exp(j k phi))``. Between its
// extrema it is monotone, so that its next rise through a level is found to rounding; guards are multiples of few series.

#include "engine/constants.hpp"
#include "structures.hpp"
#include "filling.hpp"

namespace epp {
inline namespace EPP_ARCH {

namespace periodic {

constexpr i64 ENDLESS = -1;
constexpr double EXCURSION = 4.0;
constexpr i64 LEAST = 32;
constexpr i64 MOST_PERIODS = 6;
constexpr i64 MOST_STEPS = 60;
constexpr i64 PER_WAVE = 8;
constexpr double ROUNDING = 1e-13;
constexpr double SAME = 1e-09;
constexpr double TURN = 6.283185307179586;
constexpr i64 UNSETTLED = -2;

std::tuple<double, double> slope_and_bend(ComplexVector c, Complex step);
double turning_point(ComplexVector c, double low, double high, bool rising);
std::tuple<double, double> series_at(ComplexVector c, double phi);
i64 put(Vector phase, Vector value, i64 count, ComplexVector c, double low, double high, bool rising);
double where_it_turns(ComplexVector c, double low, double high, double slope);
i64 find_extrema(ComplexVector c, Vector phase, Vector value);
double due(const Table& table, i64 mode_guard, double offset, double phi, double omega);
double root(ComplexVector c, double low, double begin, double high, double share, double level, double sign);
double next_rise(ComplexVector c, Vector phase, Vector value, i64 count, double phi, double here, double level,
    double sign);
std::tuple<i64, i64> advance(const Table& table, ComplexMatrix series, Matrix phase, Matrix value, Indices counts,
    ComplexVector z, double omega, double phi, double end, i64 mode, Vector memory, Vector work, Vector here,
    Vector at, Indices fired, Matrix holds);
std::tuple<i64, i64, double> repeat(const Table& table, const std::tuple<ComplexMatrix, Matrices, Indices,
    ComplexVector, double>& motion, double start, i64 mode, Vector memory, i64 least, bool clocked,
    const std::tuple<Vector, Vector, Vector, Vector, Indices, Matrix>& room);
std::tuple<i64, i64, double, Vector, Vector, Indices, Matrix> settle_part(const Table& table, ComplexVector z,
    double omega, i64 mode, bool clocked, Vector rest);

}  // namespace periodic
}  // namespace EPP_ARCH
}  // namespace epp
