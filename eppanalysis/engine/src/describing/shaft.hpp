#pragma once
// The torque of a damped shaft behind a gap (docs/theory/lock_pin.md, The damped shaft).
//
// With ``twist = b + a sin(phi)``, lengths over a and ``kappa = k/(c w)``, the torque on a side is ``sin(phi + psi) - q``
// but for the factor ``a |k + j c w|``, with ``tan(psi) = 1/kappa``: it falls through zero at a phase that is closed, and
// begins where the contact angle arrives, of which the phase is a root.

#include "engine/constants.hpp"
#include "structures.hpp"
#include "describing/closed_forms.hpp"

namespace epp {
inline namespace EPP_ARCH {

namespace describing_shaft {

constexpr i64 STEPS = 200;

double release(double q, double kappa);
double lead(double release, double beyond, double kappa);
std::tuple<double, double> way(double t, double release, double lead, double kappa);
double turn(double release, double kappa);
double root(double level, double low, double high, double release, double lead, double kappa);
std::tuple<double, Complex> pushes(double length, double q);
std::tuple<double, Complex> answer(double bias, double half, double kappa);
void nordin_shaft(double gap, double stiffness, double damping, Vector amplitude, Vector bias, Vector omega,
    Vector mean, ComplexVector share);

}  // namespace describing_shaft
}  // namespace EPP_ARCH
}  // namespace epp
