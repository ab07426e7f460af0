#pragma once
// The integrator of a clamped PID controller whose output without limits is a sine, derivative included.
//
// With ``v = b + a sin(phi)``, the integrator's state s and the filter's state d, let ``sigma = (s - b)/a`` and ``delta =
// (kd/filter_time) d/a``. The error is ``q = sin(phi) - sigma + delta`` but for a positive factor, and by the phase
//
//     sigma' = kappa q  (zero while v is beyond a limit and q of its side),    delta' = tau (eta q - delta),
//
// with ``kappa = ki/(g w)``, ``eta = kd/(filter_time g)``, ``tau = 1/(filter_time w)`` and ``g = kp + kd/filter_time``.
// Both laws are linear, and where one takes over from the other inside a limit q is zero, so that rates are continuous:
// the map of a period has the product of its arcs' matrices as derivative, and Newton's method finds its fixed point.
// Mean and fundamental follow from the ends of arcs: ``x' = M x + f`` by parts is ``(M - j) I = [x exp(-j phi)] - F``.

#include "engine/constants.hpp"
#include "structures.hpp"

namespace epp {
inline namespace EPP_ARCH {

namespace describing_clamped {

constexpr i64 ARCS = 12;
constexpr i64 EVEN = 24;
constexpr i64 HALVED = 16;
constexpr i64 HALVINGS = 12;
alignas(64) inline double PLACE_numbers[] = {-0.993128599185095, -0.9639719272779138, -0.912234428251326,
    -0.8391169718222188, -0.7463319064601508, -0.636053680726515, -0.5108670019508271, -0.37370608871541955,
    -0.22778585114164507, -0.07652652113349734, 0.07652652113349734, 0.22778585114164507, 0.37370608871541955,
    0.5108670019508271, 0.636053680726515, 0.7463319064601508, 0.8391169718222188, 0.912234428251326,
    0.9639719272779138, 0.993128599185095};
inline const Vector PLACE(PLACE_numbers, {20});
constexpr double ROUNDING = 4e-16;
constexpr i64 STEPS = 120;
alignas(64) inline double WEIGHT_numbers[] = {0.017614007139150893, 0.040601429800386446, 0.06267204833410879,
    0.08327674157670471, 0.1019301198172407, 0.1181945319615186, 0.1316886384491769, 0.1420961093183824,
    0.14917298647260424, 0.15275338713072628, 0.15275338713072628, 0.14917298647260424, 0.1420961093183824,
    0.1316886384491769, 0.1181945319615186, 0.1019301198172407, 0.08327674157670471, 0.06267204833410879,
    0.040601429800386446, 0.017614007139150893};
inline const Vector WEIGHT(WEIGHT_numbers, {20});

/// One of both laws, with the coefficients (s, d) of its response ``Im(c exp(j phi))`` to the sine.
struct Law {
    bool free;
    double kappa;
    double eta;
    double tau;
    Complex s;
    Complex d;
};

/// What a passage adds to sigma and delta, of either.
struct Passage {
    double ss;
    double sd;
    double ds;
    double dd;
};

Law law_of(bool free, double kappa, double eta, double tau);
Passage passage(const Law& law, double t);
Passage joined(const Passage& a, const Passage& b);
Complex turned(double t);
std::tuple<double, double> after(const Law& law, double begin, double t, double s, double d);
double turn(const Law& law, double side, double begin, double low, double high, double s, double d);
double until(const Law& law, double side, double begin, double end, double s, double d);
void integrals(const Law& law, double begin, double t, double s, double d, double s1, double d1, ComplexVector sums);
std::tuple<double, double> period(double s, double d, Vector edges, const Law& drives, const Law& holds, Matrix product,
    ComplexVector sums);
std::tuple<double, Complex> answer(double low, double high, double kappa, double eta, double tau);
void describe(Vector low, Vector high, Vector kappa, Vector eta, Vector tau, Vector mean, ComplexVector gain);

}  // namespace describing_clamped
}  // namespace EPP_ARCH
}  // namespace epp
