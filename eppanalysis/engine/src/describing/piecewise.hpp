#pragma once
// Describing function of a biased sinusoid through a piecewise-linear map: floats in, floats out.
//
// The rising half of the input, ``x = b + A sin(phi)`` with ``phi`` from -pi/2 to pi/2, is walked outwards from the bias
// to either peak. Integration by parts turns the Fourier integrals into sums over the output's *changes* (slopes, jumps),
//
//     gain = 2/(pi A) * integral cos(phi) dy,     mean = y(b) + 1/pi * integral (pi/2 - |phi|) sgn(phi) dy,
//
// so that saturated pieces add nothing and monotone maps cancel nothing. Angles are held as the sine and cosine of half
// the angle from the peak, which keeps the relative accuracy both of pieces much narrower than the amplitude and of
// amplitudes that only just pass a threshold.
//
// Pieces are the outer loop and amplitudes the inner one; what an amplitude does not reach costs it nothing. The arc sine
// and what is left of it are polynomials of one order, which take a fraction of what library calls take.

#include "engine/constants.hpp"
#include "rows.hpp"
#include "structures.hpp"

namespace epp {
inline namespace EPP_ARCH {

namespace describing_piecewise {

alignas(64) inline double ASIN_numbers[] = {1.0471975511965979, 0.05375149359132688, 0.007798902238973631,
    0.0015196685396007047, 0.0003408637234223566, 8.302317787417888e-05, 2.1345552502340797e-05, 5.701783620636128e-06,
    1.5669634225237398e-06, 4.4019653102904206e-07, 1.2584262670471309e-07, 3.649417686088301e-08,
    1.0708846364256536e-08, 3.1690560126936583e-09, 9.46796606590854e-10, 2.9127320416808096e-10,
    8.868082109489377e-11, 2.2131685518217773e-11, 6.589569102144062e-12, 4.204585686624859e-12,
    1.3371178696831771e-12};
inline const Vector ASIN(ASIN_numbers, {21});
alignas(64) inline double BERNOULLI_numbers[] = {0.08333333333333333, -0.001388888888888889, 3.306878306878307e-05,
    -8.267195767195768e-07};
inline const Vector BERNOULLI(BERNOULLI_numbers, {4});
constexpr i64 CHUNK = 512;
constexpr i64 ENDS = 32;
constexpr double EPSILON = 2.220446049250313e-16;
alignas(64) inline double EXCESS_numbers[] = {0.7246885896486364, 0.06766765390629689, 0.011640477482066432,
    0.0024569504150799056, 0.0005770781741812718, 0.0001448150663102569, 3.801727593508049e-05, 1.0312511947568247e-05,
    2.86772720776265e-06, 8.131675311627432e-07, 2.3423268627258746e-07, 6.835355531540741e-08, 2.016340031394097e-08,
    5.993514126515006e-09, 1.7975573232685111e-09, 5.550485237983366e-10, 1.6949546881191487e-10,
    4.232128901344687e-11, 1.2628663151561788e-11, 8.105638498946746e-12, 2.5823838928414283e-12};
inline const Vector EXCESS(EXCESS_numbers, {21});
constexpr i64 FEW = 128;
constexpr double HALF_PI = 1.5707963267948966;
alignas(64) inline double LEVER_numbers[] = {0.37240127153156427, 0.04599788078072616, 0.008402684344413497,
    0.0018190669401932087, 0.00043319305759469405, 0.00010965053411707748, 2.8955959759038462e-05,
    7.888185367459944e-06, 2.2006751165102902e-06, 6.256029010012352e-07, 1.8057229467137736e-07,
    5.278270936550178e-08, 1.5591997069911423e-08, 4.6401346527994915e-09, 1.393071171487545e-09,
    4.3056930636132195e-10, 1.315861201365936e-10, 3.285995352202476e-11, 9.81103899676592e-12, 6.3068412740612414e-12,
    2.010246670971981e-12};
inline const Vector LEVER(LEVER_numbers, {21});

double even_jump(Vector breakpoints, Vector jumps, i64 first, i64 last);
std::tuple<bool, double> shape_of(Vector breakpoints, Vector slopes, Vector jumps);
void start(Vector breakpoints, Vector slopes, Vector intercepts, Vector jumps, Vector amplitude, Vector bias,
    Vector mean, Vector gain, Strided<double, 2> by);
std::tuple<double, double, double, double> reach(Vector amplitude, Vector bias);
void add_piece(double start, double end, double slope, double side, Vector amplitude, Vector bias, Vector mean,
    Vector gain, Vector level, Vector sway);
void slopes_at(double t, double A, Matrix f);
void even_side(Vector edges, i64 first, i64 last, double bias, double A, Vector sums, Matrix below, Matrix above);
void add_stairs(Vector edges, double jump, Vector amplitude, Vector bias, Vector mean, Vector gain, Strided<double,
    1> level, Strided<double, 1> sway);
void add_jump(double edge, double jump, Vector amplitude, Vector bias, Vector mean, Vector gain, Strided<double,
    1> level, Strided<double, 1> sway);
void describe(Vector breakpoints, Vector slopes, Vector intercepts, Vector jumps, const std::tuple<bool,
    double>& shape, Vector amplitude, Vector bias, Vector mean, Vector gain, Strided<double, 2> by);
void biased_sinusoid(Vector breakpoints, Vector slopes, Vector intercepts, Vector jumps, Vector amplitude, Vector bias,
    Vector mean, Vector gain, Matrix by);

/// Sine and cosine of half the angle from the peak at which the input has gone `distance` from its bias; of one input,
/// or of as many as a register holds.
template <class R> EPP_INLINE std::tuple<R, R> halves(R amplitude, R distance) {
    const R share = 0.5 / amplitude;
    return {root((amplitude - distance) * share), root((amplitude + distance) * share)};
}

template <class R> EPP_INLINE R value(Vector c, R q) {
    const R x = 4.0 * q - 1.0, s = x * x;
    // Even and odd powers apart, as one sum alone would wait for each of its products; written out, as a loop would
    // choose among the coefficients at each turn.
    R even = ((((c(20) * s + c(18)) * s + c(16)) * s + c(14)) * s + c(12)) * s + c(10);
    even = ((((even * s + c(8)) * s + c(6)) * s + c(4)) * s + c(2)) * s + c(0);
    R odd = (((c(19) * s + c(17)) * s + c(15)) * s + c(13)) * s + c(11);
    odd = ((((odd * s + c(9)) * s + c(7)) * s + c(5)) * s + c(3)) * s + c(1);
    return even + x * odd;
}

/// Angle from 0 to pi/2 of the sine `s` and cosine `c`.
template <class R> EPP_INLINE R angle(R s, R c) {
    const R least = c < s ? c : s;
    const R angle = least * value(ASIN, least * least);
    return s <= c ? angle : HALF_PI - angle;
}

}  // namespace describing_piecewise
}  // namespace EPP_ARCH
}  // namespace epp
