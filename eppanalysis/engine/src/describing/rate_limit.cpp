#include "describing/rate_limit.hpp"

namespace epp {
inline namespace EPP_ARCH {

namespace describing_rate_limit {

/// ``x - sin(x)``, accurate down to zero.
double above_sine(double x) {
    if (std::fabs(x) > 1.0) {
        return x - std::sin(x);
    }
    double q = x * x;
    double term = x * q / 6.0;
    double total = 0.0;
    i64 k = 4;
    while (std::fabs(term) > (1e-18 * std::fabs(total))) {
        total += term;
        term *= -q / (k * (k + 1));
        k += 2;
    }
    return total;
}

/// Input less output on a ramp of rate ``cos(beta)`` from `begin`, where they are equal; accurate down to zero.
double gap(double phi, double begin, double beta) {
    double loss = 2.0 * whole_power(std::sin(0.5 * beta), 2);
    return (phi - begin) * loss - above_sine(phi) + above_sine(begin);
}

/// Phase at which a ramp that begins at `begin`, in [-beta, beta], meets the input from which it left again.
double ramp_end(double begin, double beta) {
    double value{}, slope{}, step{};
    double rate = std::cos(beta);
    double sine = std::sin(begin);
    bool wide = beta > 0.5;
    double low = beta;
    double high = 2.0 * PI - beta;
    // exact to first order for a short ramp
    double phi = least_of(greatest_of(0.5 * (3.0 * beta - begin), low), high);
    // On a short ramp input and output agree to many digits: there the difference itself is summed up.
    for (i64 turn_ = 0; turn_ < STEPS; ++turn_) {
        value = wide ? std::sin(phi) - sine - (phi - begin) * rate : gap(phi, begin, beta);
        if (value > 0.0) {
            low = phi;
        } else {
            high = phi;
        }
        slope = std::cos(phi) - rate;
        if (slope < 0.0) {
            step = value / slope;
            if (std::fabs(step) <= (2e-15 * phi)) {
                return phi - step;
            }
            phi -= step;
        }
        if (!(low < phi && phi < high)) {
            phi = 0.5 * (low + high);
        }
        if ((high - low) <= (4e-16 * high)) {
            break;
        }
    }
    return phi;
}

/// How far the servo's error, over that of its limit, has to fall further where the next ramp should begin.
///
/// Returns that, its derivative by `begin`, and the end of the ramp.
std::tuple<double, double, double> late(double begin, double beta, double kappa) {
    double end = ramp_end(begin, beta);
    double rate = std::cos(beta);
    double wait = begin + PI - end;
    // The ramp lasts beyond the begin of the next one: a later begin shortens it, so the root lies there.
    if (wait <= 0.0) {
        return {2.0, -1.0, end};
    }
    double share = kappa / (rate * (kappa * kappa + 1.0));
    double cosine = std::cos(begin);
    double sine = std::sin(begin);
    double stop_cosine = std::cos(end);
    double stop_sine = std::sin(end);
    double left = std::exp(-kappa * wait);
    double gone = 1.0 - share * (kappa * stop_cosine + stop_sine);
    double falls = stop_cosine - rate;
    double moves = (falls < 0.0) ? (cosine - rate) / falls : -1.0;
    double slope = share * (kappa * sine - cosine);
    slope -= left * (moves * share * (stop_cosine - kappa * stop_sine) + gone * kappa * (1.0 - moves));
    return {1.0 - share * (kappa * cosine + sine) + gone * left, slope, end};
}

/// Phases at which the rising ramp begins and ends.
std::tuple<double, double> ramp(double beta, double kappa) {
    double end{}, value{}, slope{}, step{};
    // Where the corner of a triangle would lie, for an output that never follows (docs/theory/rate_limit.md, The ideal
    // limiter): the ideal limiter's begin then, and a start for the servo's.
    double begin = -std::asin(least_of(1.0, 0.5 * PI * std::cos(beta)));
    if (std::isinf(kappa)) {
        end = ramp_end(-beta, beta);
        return (end <= (PI - beta)) ? std::tuple<double, double>{-beta, end} : std::tuple<double, double>{begin,
            begin + PI};
    }
    // One equation for the begin: half a period later the error has to stand at the other limit
    // (docs/theory/rate_limit.md, The servo). Newton's method, kept in its bracket.
    double low = -beta;
    double high = beta;
    begin = greatest_of(begin, 0.999 * low);
    end = beta;
    for (i64 turn_ = 0; turn_ < STEPS; ++turn_) {
        std::tie(value, slope, end) = late(begin, beta, kappa);
        if (value > 0.0) {
            low = begin;
        } else {
            high = begin;
        }
        if (slope < 0.0) {
            step = value / slope;
            if (std::fabs(step) <= (2e-15 * beta)) {
                break;
            }
            begin -= step;
        }
        if (!(low < begin && begin < high)) {
            begin = 0.5 * (low + high);
        }
        if ((high - low) <= (4e-16 * beta)) {
            break;
        }
    }
    return {begin, end};
}

/// What the fundamental of the ideal limiter's output lacks, by quadrature over the ramp.
Complex short_(double begin, double end, double beta) {
    double phi{};
    Complex total = 0.0 + Complex(0.0, 0.0);
    double half = 0.5 * (end - begin);
    double middle = 0.5 * (end + begin);
    for (i64 k = 0; k < PLACE.size(); ++k) {
        phi = middle + half * PLACE(k);
        total += half * WEIGHT(k) * gap(phi, begin, beta) * Complex(std::sin(phi), std::cos(phi));
    }
    return 2.0 / PI * total;
}

/// ``exp(-j phi)``
Complex turn(double phi) {
    return Complex(std::cos(phi), -std::sin(phi));
}

/// Integrals of ``cos(phi) exp(-j phi)`` and ``sin(phi) exp(-j phi)`` from `low` to `high`.
std::tuple<Complex, Complex> following(double low, double high) {
    double width = high - low;
    Complex twice = Complex(0.0, 0.5) * (turn(2.0 * high) - turn(2.0 * low));
    return {0.5 * (width + twice), -Complex(0.0, 0.5) * (width - twice)};
}

/// ``1 - N`` of the describing function N from input to output.
Complex lack(double alpha, double kappa) {
    Complex turn{}, ramp{}, with_cosine{}, with_sine{};
    double begin{}, end{};
    Complex linear = std::isinf(kappa) ? Complex(0.0, 0.0) : 1.0 / Complex(1.0, -kappa);
    if (!(alpha > std::sqrt(1.0 + 1.0 / (kappa * kappa)))) {
        return linear;
    }
    // arccos(1/alpha) by the half angle, which keeps its digits where alpha is hardly above one.
    double beta = 2.0 * std::atan2(std::sqrt(alpha - 1.0), std::sqrt(alpha + 1.0));
    std::tie(begin, end) = describing_rate_limit::ramp(beta, kappa);
    // A short ramp costs as little as beta^4 (docs/theory/rate_limit.md, The ideal limiter): the closed form, one less
    // nearly one, would keep no digit of it, and the gain from the error divides by it.
    if (std::isinf(kappa) && end < SHORT) {
        return short_(begin, end, beta);
    }
    double stop = begin + PI;
    turn = describing_rate_limit::turn(end);
    ramp = Complex(0.0, 1.0) / alpha * (turn - describing_rate_limit::turn(begin));
    std::tie(with_cosine, with_sine) = following(end, stop);
    if (std::isinf(kappa)) {
        return 1.0 - 2.0 / PI * (ramp + with_cosine);
    }
    double share = kappa * kappa / (kappa * kappa + 1.0);
    double gone = 1.0 / alpha - share * (std::cos(end) + std::sin(end) / kappa);
    double wait = stop - end;
    Complex left = std::exp(-kappa * wait) * describing_rate_limit::turn(wait);
    Complex behind = gone * turn * (1.0 - left) / Complex(kappa, 1.0);
    return 1.0 - 2.0 / PI * (ramp + share * (with_cosine + with_sine / kappa) + behind);
}

/// Gains from input to output, for points (p,) of alpha and kappa.
void describe(Vector alpha, Vector kappa, ComplexVector gain) {
    for (i64 i = 0; i < alpha.size(); ++i) {
        gain(i) = (alpha(i) >= 0.0 && kappa(i) > 0.0) ? 1.0 - lack(alpha(i), kappa(i)) : Complex(NaN, NaN);
    }
}

/// How much the error of input less output is too large, at the input whose rate is ``1/cos(beta)`` of the limit.
double excess(double beta, double error, double kappa) {
    double alpha = 1.0 / std::cos(beta);
    double ratio = modulus(lack(alpha, kappa)) * alpha / error;
    // The ideal limiter's error starts with the fourth power of beta.
    return std::isinf(kappa) ? std::sqrt(std::sqrt(ratio)) - 1.0 : ratio - 1.0;
}

/// alpha at which the fundamental of the error ``alpha (u - y)`` has the size `error`, above the linear range.
double drive(double error, double kappa) {
    double middle{}, value{};
    // Of a triangle |1 - N|^2 = 1 - (4 - 16/pi^2)/alpha^2, so that the drive follows from the error at once.
    if (std::isinf(kappa) && error > SATURATED) {
        return std::sqrt(error * error + 4.0 - 16.0 / whole_power(PI, 2));
    }
    // alpha = 1/cos(beta) maps all drives onto a bounded interval; a regula falsi on it, with the end that stays halved
    // (docs/theory/rate_limit.md).
    double low = std::atan(1.0 / kappa);
    double high = std::acos(1.0 / (error + 4.0 / PI + 1.0 / kappa));
    double at_low = excess(low, error, kappa);
    double at_high = excess(high, error, kappa);
    i64 side = 0;
    for (i64 turn_ = 0; turn_ < STEPS; ++turn_) {
        if (!(at_low < 0.0) || !(at_high > 0.0) || (high - low) <= (4e-16 * high)) {
            break;
        }
        middle = (low * at_high - high * at_low) / (at_high - at_low);
        if (!(low < middle && middle < high)) {
            middle = 0.5 * (low + high);
        }
        value = excess(middle, error, kappa);
        if (std::fabs(value) <= ROUNDING) {
            return 1.0 / std::cos(middle);
        }
        if (value < 0.0) {
            low = middle;
            at_low = value;
            at_high = (side == (-1)) ? 0.5 * at_high : at_high;
            side = -1;
        } else {
            high = middle;
            at_high = value;
            at_low = (side == 1) ? 0.5 * at_low : at_low;
            side = 1;
        }
    }
    return 1.0 / std::cos((std::fabs(at_low) < std::fabs(at_high)) ? low : high);
}

/// Gains from the error ``u - y`` to the rate of the output, over the frequency, for points (p,).
///
/// `error` is the amplitude of the fundamental of the error, over the limit divided by the frequency. In the linear
/// range of the servo the gain is kappa; the ideal limiter has none, and any error there is has a ramp.
void describe_inside(Vector error, Vector kappa, ComplexVector gain) {
    Complex missing{};
    for (i64 i = 0; i < error.size(); ++i) {
        if (!(error(i) > 0.0 && kappa(i) > 0.0)) {
            gain(i) = Complex(NaN, NaN);
        } else if ((error(i) * kappa(i)) <= 1.0) {
            gain(i) = kappa(i);
        } else {
            missing = lack(drive(error(i), kappa(i)), kappa(i));
            gain(i) = (missing != 0.0) ? Complex(0.0, 1.0) * (1.0 - missing) / missing : 1.0 / error(i) + Complex(0.0,
                0.0);
        }
    }
}

}  // namespace describing_rate_limit
}  // namespace EPP_ARCH
}  // namespace epp
