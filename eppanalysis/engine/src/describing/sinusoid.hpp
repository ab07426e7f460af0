#pragma once
// The describing function of any automaton by quadrature, its switches located.
//
// The input is ``b + a sin(phi)``; peaks are on the grid of phases, between which guards on the input alone are
// monotone. Within a step the first guard that rises is located, and the output is integrated on either side: in closed
// form where it is affine in a sinusoid, else by Gauss's rule of four points, in as many panels as smooth functions need.
// Periods follow each other until what the element remembers repeats.

#include "engine/constants.hpp"
#include "structures.hpp"
#include "engine/curves.hpp"
#include "filling.hpp"

namespace epp {
inline namespace EPP_ARCH {

namespace describing_sinusoid {

constexpr double AGREES = 1e-12;
constexpr i64 MOST_EVENTS = 64;
constexpr i64 MOST_PANELS = 10'000;
constexpr double NARROWEST = 1e-09;
constexpr i64 PERIODS = 6;
// Steps after which periods are counted: what starts at a phase switches there, and a turn later to rounding.
constexpr i64 RUN_IN = 11;
alignas(64) inline double PLACE_numbers[] = {-0.8611363115940526, -0.33998104358485626, 0.33998104358485626,
    0.8611363115940526};
inline const Vector PLACE(PLACE_numbers, {4});
constexpr double REPEATS = 1e-09;
constexpr i64 SQUARE = 3;
constexpr i64 STEPS = 64;
alignas(64) inline double WEIGHT_numbers[] = {0.34785484513745357, 0.6521451548625464, 0.6521451548625464,
    0.34785484513745357};
inline const Vector WEIGHT(WEIGHT_numbers, {4});

/// ``level + sine sin(phi) + cosine cos(phi)``.
struct Wave {
    double level, sine, cosine;
};

void inputs(double a, double b, double omega, double phi, Vector z, Vector rate);
void outputs(const Rules& rules, i64 mode, Vector z, Vector memory, Vector w);
double guard(const Rules& rules, i64 g, i64 mode, double a, double b, double omega, double phi, Vector memory,
    Vector z, Vector rate, Vector w);
Wave output_wave(const Rules& rules, i64 mode, i64 i, double a, double b, double omega, Vector memory);
Wave guard_wave(const Rules& rules, i64 g, i64 mode, double a, double b, double omega, Vector memory);
double rise(const Wave& wave, double low, double high);
std::tuple<i64, double> next_event(const Rules& rules, i64 mode, double a, double b, double omega, double low,
    double high, Vector memory, Vector z, Vector rate, Vector w);
double panel(const Rules& rules, i64 mode, double a, double b, double omega, double low, double high, Vector memory,
    Vector z, Vector rate, Vector w, Matrix total);
void add_waves(const Rules& rules, i64 mode, double a, double b, double omega, double low, double high, Vector memory,
    Matrix total);
bool integrate(const Rules& rules, i64 mode, double a, double b, double omega, double low, double high, Vector memory,
    Vector z, Vector rate, Vector w, Matrix total, Matrix once, Matrix twice);
void write(const Rules& rules, i64 g, double a, double b, double omega, double phi, Vector z, Vector rate,
    Vector memory, Vector before);
std::tuple<i64, i64> steps(const Rules& rules, i64 mode, double a, double b, double omega, i64 first, i64 last,
    Vector memory, Vector z, Vector rate, Vector w, Vector before, Matrix total, Matrix once, Matrix twice);
void describe(const Rules& rules, i64 start_mode, Vector a, Vector b, Vector omega, Matrix mean, ComplexMatrix gain);

}  // namespace describing_sinusoid
}  // namespace EPP_ARCH
}  // namespace epp
