#include "describing/closed_forms.hpp"

namespace epp {
inline namespace EPP_ARCH {

namespace describing_closed_forms {

double angle(double from_peak, double to_trough) {
    // By the tangent of half the angle: an arc cosine would lose half its digits near the peak and the trough.
    return 2.0 * std::atan2(std::sqrt(greatest_of(from_peak, 0.0)), std::sqrt(greatest_of(to_trough, 0.0)));
}

/// Integral of sin^2 from 0 to theta, of which sine and cosine are known.
double squared_sine_to(double theta, double sine, double cosine) {
    double q{}, tail{};
    if (std::fabs(theta) < SMALL) {
        q = theta * theta;
        tail = double(2) / double(155925) + q * (double(-2) / double(6081075) + q * 4 / 638512875);
        return theta * q * (double(1) / double(3) + q * (double(-1) / double(15) + q * (double(2) / double(315) + q *
            (double(-1) / double(2835) + q * tail))));
    }
    return (theta - sine * cosine) / 2.0;
}

double squared_sine(double theta) {
    return squared_sine_to(theta, std::sin(theta), std::cos(theta));
}

/// Integral of the stretch from the peak to theta.
double area(double theta, double top, double a) {
    return top * theta - 4.0 * a * squared_sine(theta / 2.0);
}

/// Mean, real and imaginary part of the gain of a cable that slides; the stretch rises by `reach` before it does.
std::tuple<double, double, double> slide(Vector of, double a, double b, double reach) {
    double rise = of(3);
    double fall = of(4);
    // Slack cable carries no force: stretch below zero counts as none (docs/theory/play.md, The pulley with stiction).
    double top = b + a;
    double bottom = greatest_of(b - a, 0.0);
    double under = bottom - (b - a);
    double drop = top * of(6);
    // Angles from the peak at which it breaks away up, breaks away down and comes to the least taut stretch.
    double up = angle(top - bottom - reach, under + reach);
    double down = angle(drop, 2.0 * a - drop);
    double end = angle(top - bottom, under);
    double jump_up = of(7) * (bottom + reach) / a;
    double jump_down = of(8) * (top - drop) / a;
    double real = rise * squared_sine(up) + jump_up * std::sin(up);
    real = real + fall * (squared_sine(end) - squared_sine(down)) + jump_down * std::sin(down);
    double lag = rise * whole_power(std::sin(up), 2) / 2.0 + jump_up * std::cos(up);
    lag = lag + fall * (whole_power(std::sin(down), 2) - whole_power(std::sin(end), 2)) / 2.0 - jump_down *
        std::cos(down);
    double mean = fall * bottom * (PI - up) + rise * (area(up, top, a) + top * down);
    mean += fall * (area(end, top, a) - area(down, top, a));
    return {mean / (2.0 * PI), real / PI, -lag / PI};
}

/// Both forces of a cable that sticks to a pulley.
///
/// Parameters
/// ----------
/// forearm, harness : float
///     Stiffnesses [N/m].
/// of : array, shape (9,)
///     Shares of the stretch at rest, at the static friction and against it, at the kinetic friction and against it;
///     reach and drop before it breaks away over stretch; jumps of the share as it does, up and down.
/// amplitude, bias : array, shape (n,)
///     Of the stretch.
/// mean, gain : array and complex array, shape (n, 2)
///     Are filled.
void stiction_pulley(double forearm, double harness, Vector of, Vector amplitude, Vector bias, Matrix mean,
    ComplexMatrix gain) {
    double a{}, b{}, top{}, bottom{}, held{}, real{}, imaginary{}, taut{}, taut_gain{}, reach{}, slack{};
    for (i64 i = 0; i < amplitude.size(); ++i) {
        a = amplitude(i);
        b = bias(i);
        top = b + a;
        bottom = greatest_of(b - a, 0.0);
        held = 0.0;
        real = 0.0;
        imaginary = 0.0;
        taut = 0.0;
        taut_gain = 0.0;
        if (std::isnan(a) || std::isnan(b)) {
            held = NaN;
            real = NaN;
            imaginary = NaN;
        } else if (top > 0.0) {
            reach = bottom * of(5);
            if ((top - bottom) > reach) {
                std::tie(held, real, imaginary) = slide(of, a, b, reach);
            } else {
                held = least_of(greatest_of(of(0) * b, of(1) * top), of(2) * bottom);
            }
            slack = angle(top - bottom, (b >= a) ? 0.0 : a - b);
            taut = area(slack, top, a) / PI;
            taut_gain = 2.0 / PI * squared_sine(slack);
        }
        mean(i, 0) = forearm * held;
        mean(i, 1) = harness * (taut - held);
        gain(i, 0) = Complex(forearm * real, forearm * imaginary);
        gain(i, 1) = Complex(harness * (taut_gain - real), -harness * imaginary);
    }
}

/// Twice the angle of (x, y), its sine and its cosine.
std::tuple<double, double, double> twice(double y, double x) {
    double share = 1.0 / (x * x + y * y);
    return {2.0 * std::atan2(y, x), 2.0 * x * y * share, (x - y) * (x + y) * share};
}

/// Integral of t sin(t) from 0 to theta, of which sine and cosine are known.
double lever_to(double theta, double sine, double cosine) {
    double q{}, tail{};
    if (std::fabs(theta) < SMALL) {
        q = theta * theta;
        tail = double(1) / double(3991680) - q / 518918400;
        return theta * q * (double(1) / double(3) + q * (double(-1) / double(30) + q * (double(1) / double(840) + q *
            (double(-1) / double(45360) + q * tail))));
    }
    return sine - theta * cosine;
}

/// Unilateral contact on one side; arguments and results as in `_hold`.
///
/// With ``depth = 1 + inside/a``, the greatest penetration over the amplitude, the torque ``sin + q cos - (1 - depth)``
/// falls through zero at the angle `end` behind the peak and rises through it at `begin` before the peak (which counts
/// only where the gap is not reached, depth >= 2); the half-angle tangents are roots of a quadratic.
std::tuple<double, double, double> push(double a, double inside, double q) {
    double begin{}, sin_begin{}, cos_begin{}, end{}, sin_end{}, cos_end{};
    if (!(inside > (-a))) {
        return {0.0, 0.0, 0.0};
    }
    if (inside >= a && inside >= (a * std::hypot(1.0, q))) {
        return {2.0 * PI * inside, PI, PI * q};
    }
    double d = (a + inside) / a;
    double root = std::sqrt(greatest_of(q * q + d * (2.0 - d), 0.0));
    bool edge = d <= 2.0;
    std::tie(begin, sin_begin, cos_begin) = edge ? twice(std::sqrt(d), std::sqrt(2.0 - d)) : twice(d, root - q);
    // Contact ends where the torque is zero, before the twist is back at the gap (docs/theory/lock_pin.md). With the
    // root in the denominator neither a shallow contact cancels nor d = 2 divides by zero.
    std::tie(end, sin_end, cos_end) = twice(d, q + root);
    double held = squared_sine_to(begin, sin_begin, cos_begin) + squared_sine_to(end, sin_end, cos_end);
    double begin_square = sin_begin * sin_begin;
    double end_square = sin_end * sin_end;
    double real = held + q / 2.0 * (end_square + (edge ? begin_square : -begin_square));
    double imaginary = q * (held + q / 2.0 * (end_square - (edge ? 0.0 : begin_square)));
    double damper = q * sin_end * (end + q) + (edge ? 0.0 : q * sin_begin * (q - begin));
    double levers = lever_to(begin, sin_begin, cos_begin) + lever_to(end, sin_end, cos_end);
    return {a * (levers + damper), real, imaginary};
}

double lever(double theta) {
    return lever_to(theta, std::sin(theta), std::cos(theta));
}

/// Classical contact on one side: the cosine of the damper adds the spring's own integral, turned by 90 degrees.
///
/// Integrals over one cycle of the torque over the stiffness, for ``delta = edge + inside + a sin(phi)``: mean, real
/// and imaginary part of the gain.
std::tuple<double, double, double> hold(double a, double inside, double q) {
    double theta = angle(least_of(greatest_of(a + inside, 0.0), 2.0 * a), least_of(greatest_of(a - inside, 0.0), 2.0 *
        a));
    double mean = (inside >= a) ? 2.0 * PI * inside : ((inside > (-a)) ? 2.0 * a * lever(theta) : 0.0);
    double held = 2.0 * squared_sine(theta);
    return {mean, held, held * q};
}

/// Mean and gain of one input to `lock_pin`.
std::tuple<double, Complex> lock_pin_at(double gap, double stiffness, double damping, bool unilateral, double a,
    double b, double omega) {
    double up{}, up_real{}, up_imaginary{}, down{}, down_real{}, down_imaginary{};
    double q = damping / stiffness * omega;
    if (std::isnan(a + b + q)) {
        return {NaN, Complex(NaN, 0.0)};
    }
    // The other side sees the twist mirrored: its mean is subtracted, its gain the same way round
    // (docs/theory/lock_pin.md).
    if (unilateral) {
        std::tie(up, up_real, up_imaginary) = push(a, b - gap / 2.0, q);
        std::tie(down, down_real, down_imaginary) = push(a, -b - gap / 2.0, q);
    } else {
        std::tie(up, up_real, up_imaginary) = hold(a, b - gap / 2.0, q);
        std::tie(down, down_real, down_imaginary) = hold(a, -b - gap / 2.0, q);
    }
    double factor = stiffness / PI;
    Complex gain = Complex(factor * (up_real + down_real), factor * (up_imaginary + down_imaginary));
    return {stiffness / (2.0 * PI) * (up - down), gain};
}

/// Torque of a spring and a damper outside a gap.
///
/// Parameters
/// ----------
/// gap, stiffness, damping : float
///     [rad], [N*m/rad], [N*m*s/rad].
/// unilateral : bool
///     Whether it only pushes.
/// amplitude, bias, omega : array, shape (n,)
///     Of the twist.
/// mean, gain : array and complex array, shape (n,)
///     Are filled.
void lock_pin(double gap, double stiffness, double damping, bool unilateral, Vector amplitude, Vector bias,
    Vector omega, Vector mean, ComplexVector gain) {
    for (i64 i = 0; i < amplitude.size(); ++i) {
        std::tie(mean(i), gain(i)) = lock_pin_at(gap, stiffness, damping, unilateral, amplitude(i), bias(i), omega(i));
    }
}

}  // namespace describing_closed_forms
}  // namespace EPP_ARCH
}  // namespace epp
