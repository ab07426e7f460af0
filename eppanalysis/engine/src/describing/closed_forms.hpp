#pragma once
// Closed forms of describing functions that are many short terms a point.
//
// The input is ``b + a sin(phi)``, phases are measured from its peak: what is ``from_peak`` below it and ``to_trough``
// above the trough is passed at an angle that is known to full relative accuracy.

#include "engine/constants.hpp"
#include "structures.hpp"

namespace epp {
inline namespace EPP_ARCH {

namespace describing_closed_forms {

constexpr double SMALL = 0.25;

double angle(double from_peak, double to_trough);
double squared_sine_to(double theta, double sine, double cosine);
double squared_sine(double theta);
double area(double theta, double top, double a);
std::tuple<double, double, double> slide(Vector of, double a, double b, double reach);
void stiction_pulley(double forearm, double harness, Vector of, Vector amplitude, Vector bias, Matrix mean,
    ComplexMatrix gain);
std::tuple<double, double, double> twice(double y, double x);
double lever_to(double theta, double sine, double cosine);
std::tuple<double, double, double> push(double a, double inside, double q);
double lever(double theta);
std::tuple<double, double, double> hold(double a, double inside, double q);
std::tuple<double, Complex> lock_pin_at(double gap, double stiffness, double damping, bool unilateral, double a,
    double b, double omega);
void lock_pin(double gap, double stiffness, double damping, bool unilateral, Vector amplitude, Vector bias,
    Vector omega, Vector mean, ComplexVector gain);

}  // namespace describing_closed_forms
}  // namespace EPP_ARCH
}  // namespace epp
