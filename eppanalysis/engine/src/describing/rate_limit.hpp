#pragma once
// The answer of a servo with a limited rate to a sine, ``dy/dphi = clip(kappa (u - y), -1/alpha, 1/alpha)``.
//
// The input is ``u = sin(phi)``; alpha is the input's greatest rate over the limit, kappa the servo's bandwidth over
// the frequency, infinite for the ideal limiter, which follows an input that is slow enough. The answer is odd by
// half a period, in each of which it ramps once. Of a ramp of a given length all else is explicit: the phase of its
// middle, the rate 1/alpha, the fundamental of the output and its derivatives. So the answer to an input, and that with
// an error of a given size, are one equation each for the length of the ramp.

#include "engine/constants.hpp"
#include "structures.hpp"

namespace epp {
inline namespace EPP_ARCH {

namespace describing_rate_limit {

constexpr double NEAR = 1e-8;
constexpr double NEVER_FOLLOWS = 1.8620957726892046;
alignas(64) inline double PLACE_numbers[] = {-0.9602898564975362, -0.7966664774136267, -0.525532409916329,
    -0.18343464249564978, 0.18343464249564978, 0.525532409916329, 0.7966664774136267, 0.9602898564975362};
inline const Vector PLACE(PLACE_numbers, {8});
constexpr double SATURATED = 1.0433312218800623;
constexpr double SHORT = 0.6;
constexpr i64 STEPS = 100;
alignas(64) inline double WEIGHT_numbers[] = {0.10122853629037706, 0.22238103445337443, 0.3137066458778869,
    0.36268378337836166, 0.36268378337836166, 0.3137066458778869, 0.22238103445337443, 0.10122853629037706};
inline const Vector WEIGHT(WEIGHT_numbers, {8});

/// One answer to a sine.
struct Ramp {
    double half;  // half the length of a ramp, and of what lies between two
    double rest;
    double sine;  // of that half
    double cosine;
    double left;  // of an error behind a ramp at the begin of the next one
    double tanh;  // (1 - left)/(1 + left)
    double tangent;  // of the phase in the middle of the ramp
    double rate;  // of the ramp, 1/alpha
    double steepness;  // sqrt(alpha^2 - 1)
    double slope;  // of the logarithm of the rate, by half
};

double above_sine(double x);
Ramp ramp_of(double half, double rest, double kappa);
Complex short_(double half, double begin);
std::tuple<Complex, Complex> lack(const Ramp& r, double kappa);
std::tuple<Complex, Complex> lack_of_triangle(double rate);
double first_guess(double squared_steepness, double kappa);
Complex gain_at(double alpha, double kappa);
void describe(Vector alpha, Vector kappa, ComplexVector gain);
std::tuple<Complex, Complex> inside_at(double error, double kappa);
void describe_inside(Vector error, Vector kappa, ComplexVector gain);

}  // namespace describing_rate_limit
}  // namespace EPP_ARCH
}  // namespace epp
