#include "describing/shaft.hpp"

namespace epp {
inline namespace EPP_ARCH {

namespace describing_shaft {

/// Phase at which the torque falls to zero, for the twist beyond the side, q times ``hypot(1, 1/kappa)``.
double release(double q, double kappa) {
    return 0.5 * PI + std::atan(kappa) - std::asin(greatest_of(-1.0, least_of(1.0, q)));
}

/// Twist less contact angle at the release, over the amplitude.
double lead(double release, double beyond, double kappa) {
    return (kappa > 1.0) ? -std::cos(release) / kappa : std::sin(release) - beyond;
}

/// How far the contact angle has moved at the phase t behind its release, and its derivative.
std::tuple<double, double> way(double t, double release, double lead, double kappa) {
    double left = std::exp(-kappa * t);
    double moved = 2.0 * std::cos(release + 0.5 * t) * std::sin(0.5 * t) - lead * std::expm1(-kappa * t);
    return {moved, std::cos(release + t) - std::cos(release) * left};
}

/// Phase behind a release at which the contact angle turns back.
double turn(double release, double kappa) {
    double t{};
    // The rate times exp(kappa t) has its minimum at tan(phase) = kappa, beyond the release, and rises from there on.
    double low = greatest_of(PI + std::atan(kappa) - release, 0.0);
    double high = 1.5 * PI - release;
    while (low < (0.5 * (low + high)) && (0.5 * (low + high)) < high) {
        t = 0.5 * (low + high);
        if (std::get<1>(way(t, release, 0.0, kappa)) > 0.0) {
            high = t;
        } else {
            low = t;
        }
    }
    return high;
}

/// Phase behind a release at which the contact angle has moved by `level`, between two that it lies between.
double root(double level, double low, double high, double release, double lead, double kappa) {
    double moved{}, slope{}, step{}, there{};
    bool rises = std::get<0>(way(high, release, lead, kappa)) > level;
    double t = 0.5 * (low + high);
    for (i64 turn_ = 0; turn_ < STEPS; ++turn_) {
        std::tie(moved, slope) = way(t, release, lead, kappa);
        if ((moved > level) == rises) {
            high = t;
        } else {
            low = t;
        }
        step = (slope != 0.0) ? (level - moved) / slope : INF;
        there = t + step;
        if (!(low <= there && there <= high)) {
            there = 0.5 * (low + high);
        }
        if (there == t || !(low < (0.5 * (low + high)) && (0.5 * (low + high)) < high)) {
            return there;
        }
        t = there;
    }
    return t;
}

/// Mean, and complex fundamental, of the torque over a contact of that length which ends with it at zero.
std::tuple<double, Complex> pushes(double length, double q) {
    double h = 0.5 * length;
    double m = PI - std::asin(greatest_of(-1.0, least_of(1.0, q))) - h;
    double across = std::sin(m);
    double along = -std::cos(m);
    double twice = 2.0 * describing_closed_forms::squared_sine(h);
    double mean = across * describing_closed_forms::lever(h) + along * h * std::sin(h);
    double real = across * twice + 2.0 * along * whole_power(std::sin(h), 2);
    double imaginary = along * twice;
    return {2.0 * mean, Complex(real, imaginary) * Complex(-along, -across)};
}

/// Mean over ``|k + j c w|`` and gain over ``k + j c w`` of the torque; no bias is negative, lengths are over a.
std::tuple<double, Complex> answer(double bias, double half, double kappa) {
    double release{}, lead{}, turn{}, back{}, mean{}, up{}, down{};
    Complex wave{}, up_wave{}, down_wave{};
    double root = std::hypot(1.0, 1.0 / kappa);
    double near = (half - bias) / root;
    double far = (half + bias) / root;
    if ((1.0 + bias) <= half) {
        return {0.0, Complex(0.0, 0.0)};
    }
    if (near <= (-1.0)) {
        return {-near, Complex(1.0, 0.0)};
    }
    release = describing_shaft::release(near, kappa);
    lead = describing_shaft::lead(release, half - bias, kappa);
    turn = describing_shaft::turn(release, kappa);
    // It comes back to the side that it has left, without having seen the other.
    if (std::get<0>(way(turn, release, lead, kappa)) > (-2.0 * half) || far >= 1.0) {
        back = describing_shaft::root(0.0, turn, 2.0 * PI, release, lead, kappa);
        std::tie(mean, wave) = pushes(2.0 * PI - back, near);
        return {mean / (2.0 * PI), Complex(0.0, 1.0) * wave / PI};
    }
    double across = describing_shaft::root(-2.0 * half, 0.0, turn, release, lead, kappa);
    double other = describing_shaft::release(far, kappa);
    lead = describing_shaft::lead(other, half + bias, kappa);
    back = describing_shaft::root(-2.0 * half, 0.0, describing_shaft::turn(other, kappa), other, lead, kappa);
    std::tie(up, up_wave) = pushes(greatest_of(release - other + PI - back, 0.0), near);
    std::tie(down, down_wave) = pushes(greatest_of(other - release + PI - across, 0.0), far);
    return {(up - down) / (2.0 * PI), Complex(0.0, 1.0) * (up_wave + down_wave) / PI};
}

/// Torque of the settled shaft.
///
/// Parameters
/// ----------
/// gap, stiffness, damping : float
///     [rad], [N*m/rad], [N*m*s/rad].
/// amplitude, bias, omega : array, shape (n,)
///     Of the twist; no amplitude is zero.
/// mean, share : array and complex array, shape (n,)
///     Are filled: mean torque, and its gain over that of the shaft without a gap.
void nordin_shaft(double gap, double stiffness, double damping, Vector amplitude, Vector bias, Vector omega,
    Vector mean, ComplexVector share) {
    double a{}, b{}, w{}, kappa{}, whole{};
    for (i64 i = 0; i < amplitude.size(); ++i) {
        a = amplitude(i);
        b = bias(i);
        w = omega(i);
        if (std::isnan(a + b + w)) {
            {
                const double was1 = NaN;
                const Complex was2 = Complex(NaN, 0.0);
                mean(i) = was1;
                share(i) = was2;
            }
            continue;
        }
        kappa = least_of(greatest_of(stiffness / (damping * w), 1e-200), 1e+200);
        std::tie(whole, share(i)) = answer(std::fabs(b) / a, 0.5 * gap / a, kappa);
        mean(i) = std::copysign(whole * a * std::hypot(stiffness, damping * w), b);
    }
}

}  // namespace describing_shaft
}  // namespace EPP_ARCH
}  // namespace epp
