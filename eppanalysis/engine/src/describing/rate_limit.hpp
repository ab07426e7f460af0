#pragma once
// The answer of a servo with a limited rate to a sine, ``dy/dphi = clip(kappa (u - y), -1/alpha, 1/alpha)``.
//
// The input is ``u = sin(phi)``; alpha is the input's greatest rate over the limit, kappa the servo's bandwidth over the
// frequency, and infinite for the ideal limiter, which follows its input where that is slow enough. The answer is odd by
// half a period. In each half it ramps from the phase `begin`, where the rate reaches its limit, to the phase `end`; the
// two are roots, and with them the fundamental of the output is elementary, by ``integral of y' exp(-j phi)``.

#include "engine/constants.hpp"
#include "structures.hpp"

namespace epp {
inline namespace EPP_ARCH {

namespace describing_rate_limit {

alignas(64) inline double PLACE_numbers[] = {-0.993128599185095, -0.9639719272779138, -0.912234428251326,
    -0.8391169718222188, -0.7463319064601508, -0.636053680726515, -0.5108670019508271, -0.37370608871541955,
    -0.22778585114164507, -0.07652652113349734, 0.07652652113349734, 0.22778585114164507, 0.37370608871541955,
    0.5108670019508271, 0.636053680726515, 0.7463319064601508, 0.8391169718222188, 0.912234428251326,
    0.9639719272779138, 0.993128599185095};
inline const Vector PLACE(PLACE_numbers, {20});
constexpr double ROUNDING = 1e-15;
constexpr double SATURATED = 1.0433312218800623;
constexpr double SHORT = 0.6;
constexpr i64 STEPS = 100;
alignas(64) inline double WEIGHT_numbers[] = {0.017614007139150893, 0.040601429800386446, 0.06267204833410879,
    0.08327674157670471, 0.1019301198172407, 0.1181945319615186, 0.1316886384491769, 0.1420961093183824,
    0.14917298647260424, 0.15275338713072628, 0.15275338713072628, 0.14917298647260424, 0.1420961093183824,
    0.1316886384491769, 0.1181945319615186, 0.1019301198172407, 0.08327674157670471, 0.06267204833410879,
    0.040601429800386446, 0.017614007139150893};
inline const Vector WEIGHT(WEIGHT_numbers, {20});

double above_sine(double x);
double gap(double phi, double begin, double beta);
double ramp_end(double begin, double beta);
std::tuple<double, double, double> late(double begin, double beta, double kappa);
std::tuple<double, double> ramp(double beta, double kappa);
Complex short_(double begin, double end, double beta);
Complex turn(double phi);
std::tuple<Complex, Complex> following(double low, double high);
Complex lack(double alpha, double kappa);
void describe(Vector alpha, Vector kappa, ComplexVector gain);
double excess(double beta, double error, double kappa);
double drive(double error, double kappa);
void describe_inside(Vector error, Vector kappa, ComplexVector gain);

}  // namespace describing_rate_limit
}  // namespace EPP_ARCH
}  // namespace epp
