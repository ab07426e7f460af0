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
    double series = 1.0;
    for (i64 k = 18; k > 3; k -= 2) {
        series = 1.0 - q / (k * (k + 1)) * series;
    }
    return x * q / 6.0 * series;
}

/// The answer whose ramps last twice `half`, which is less by `rest` than a quarter of a period.
Ramp ramp_of(double half, double rest, double kappa) {
    Ramp r{};
    r.half = half;
    r.rest = rest;
    r.left = std::isinf(kappa) ? 0.0 : std::exp(-2.0 * kappa * rest);
    r.tanh = std::isinf(kappa) ? 1.0 : -std::expm1(-2.0 * kappa * rest) / (1.0 + r.left);
    r.sine = std::sin(half);
    r.cosine = std::sin(rest);
    double over = above_sine(half) / half;
    double mean = 1.0 - over;  // of the cosine over the ramp, in its middle
    double above = 2.0 * whole_power(std::sin(0.5 * half), 2) - over;  // that mean over the cosine at its ends
    // Half a period later the error has to be at the other limit (docs/theory/rate_limit.md, The answer).
    double up = above + (mean / kappa + r.tanh * r.sine) / kappa;
    double down = r.tanh * r.sine + r.cosine / kappa;
    r.tangent = up / down;
    double share = 1.0 / (1.0 + r.tangent * r.tangent);
    r.rate = mean * std::sqrt(share);
    r.steepness = std::sqrt(r.tangent * r.tangent + over * (1.0 + mean)) / mean;
    double falls = std::isinf(kappa) ? 0.0 : kappa * (1.0 - r.tanh) * (1.0 + r.tanh);
    double up_moves = r.sine - above / half + (r.tanh * r.cosine - falls * r.sine - above / half / kappa) / kappa;
    double down_moves = r.tanh * r.cosine - falls * r.sine - r.sine / kappa;
    double moves = share * (up_moves - r.tangent * down_moves) / down;
    r.slope = -above / half / mean - r.tangent * moves;
    return r;
}

/// What the fundamental of the ideal limiter's output lacks after a short ramp, by quadrature over half of its phase.
Complex short_(double half, double begin) {
    double sine{}, cosine{};
    Complex total = Complex(0.0, 0.0);
    double width = 0.5 * half;
    double begin_sine = std::sin(begin);
    double begin_cosine = std::cos(begin);
    for (i64 k = 0; k < PLACE.size(); ++k) {
        sine = std::sin(width * (1.0 + PLACE(k)));
        cosine = std::cos(width * (1.0 + PLACE(k)));
        total += WEIGHT(k) * sine * whole_power(begin_sine * cosine + begin_cosine * sine, 2) * Complex(sine, cosine);
    }
    return 16.0 / PI * width * total;
}

/// ``1 - N`` of the describing function N from input to output, and its derivative by the ramp's rate.
std::tuple<Complex, Complex> lack(const Ramp& r, double kappa) {
    double middle_cosine = 1.0 / std::sqrt(1.0 + r.tangent * r.tangent);
    Complex middle = Complex(middle_cosine, -middle_cosine * r.tangent);  // exp(-j phi) in the middle of the ramp
    Complex begun = middle * Complex(r.cosine, r.sine);
    Complex ended = middle * Complex(r.cosine, -r.sine);
    double half = r.half;
    // The input's rate less the output's, by exp(-j phi): over the ramp, and beyond it.
    Complex twice = r.sine * r.cosine * middle * middle;
    Complex missing = half + twice - 2.0 * r.rate * r.sine * middle;
    // The ramp is longer or shorter as a whole, and what it has gone too far fades behind it.
    double stays = half * (1.0 - r.tanh);
    Complex arm = Complex(2.0 * half * r.sine, -2.0 * (r.sine - half * r.cosine));
    Complex by_rate = (2.0 * stays * r.sine - arm) * middle;
    if (std::isinf(kappa)) {
        // A short ramp costs as little as beta^4 (docs/theory/rate_limit.md, The answer): the closed form would keep
        // no digit of it, and the gain from the error divides by it.
        double end = half + std::atan(r.tangent);
        if (end < SHORT) {
            return {short_(half, end - 2.0 * half), Complex(0.0, 2.0 / PI) * by_rate};
        }
        return {2.0 / PI * missing, Complex(0.0, 2.0 / PI) * by_rate};
    }
    double share = 1.0 / (kappa * kappa + 1.0);
    double gone = r.rate - kappa * share * (kappa * ended.real - ended.imag);
    Complex fades = (ended + r.left * begun) / Complex(kappa, 1.0);
    missing += share * (Complex(1.0, kappa) * r.rest - Complex(1.0, -kappa) * twice) - gone * fades;
    by_rate += (stays - 2.0 * half) * fades;
    return {2.0 / PI * missing, Complex(0.0, 2.0 / PI) * by_rate};
}

/// The same of the ideal limiter where it never follows its input: a triangle, whose corners lie on it.
std::tuple<Complex, Complex> lack_of_triangle(double rate) {
    double cosine = 0.5 * PI * rate;
    double sine = std::sqrt((1.0 - cosine) * (1.0 + cosine));
    Complex middle = Complex(cosine, -sine);
    return {1.0 - 4.0 / PI * rate * middle, -Complex(0.0, 4.0 / PI) * middle * middle / sine};
}

/// ``1 - N``, its derivative by the ramp's rate, and that rate, where an error is zero that grows with the ramp.
///
/// `off` gives that error for an answer, its lack and the lack's derivative, and its slope by half the ramp's length;
/// `most` is an upper bound of the input's rate over the limit.
template <class Off> std::tuple<Complex, Complex, double> balanced(double tangent, double most, double kappa, Off off) {
    Ramp r{};
    Complex missing{}, by_rate{};
    double value{}, slope{}, step{}, moves{};
    bool ideal = std::isinf(kappa);
    // Newton's method, kept in its bracket. Its variable is the logarithm of the tangent of half the ramp, as the servo
    // ramps for nearly all of a period where its input is large; that of half of this half for the ideal limiter, which
    // ends with the triangle.
    double place = ideal ? std::tan(0.5 * std::atan(tangent)) : tangent;
    double low = 0.0;
    // Beyond the ramp the error passes twice the limit over the bandwidth, no faster than input and output move.
    double high = ideal ? 1.0 : kappa * (most + 1.0);
    for (i64 turn_ = 0; turn_ < STEPS; ++turn_) {
        r = ideal ? ramp_of(2.0 * std::atan(place), 0.5 * PI - 2.0 * std::atan(place), kappa) :
            ramp_of(std::atan(place), std::atan(1.0 / place), kappa);
        std::tie(missing, by_rate) = lack(r, kappa);
        std::tie(value, slope) = off(r, missing, by_rate);
        if (value > 0.0) {
            high = place;
        } else {
            low = place;
        }
        moves = ideal ? r.sine : r.sine * r.cosine;
        step = -value / (slope * moves);
        // What is left after it is of the order of its square.
        if (std::fabs(step) <= NEAR) {
            step *= r.rate * r.slope * moves;
            return {missing + by_rate * step, by_rate, r.rate + step};
        }
        place *= std::exp(step);
        if (!(low < place && place < high)) {
            place = 0.5 * (low + high);
        }
        if (!(low < place && place < high)) {
            break;
        }
    }
    return {missing, by_rate, r.rate};
}

/// Where Newton's method begins for a rate of the input, over the limit: its ramp is that of a servo which lags far.
///
/// The steepness is the tangent of the angle whose cosine is the limit over that rate; 1/kappa at the servo's onset.
double first_guess(double squared_steepness, double kappa) {
    double onset = 1.0 / (kappa * kappa);
    return std::sqrt((squared_steepness - onset) / (1.0 + onset));
}

/// Gain from input to output.
Complex gain_at(double alpha, double kappa) {
    Complex missing{};
    double squared = (alpha - 1.0) * (alpha + 1.0);
    if (!(alpha > 1.0 && squared * kappa * kappa > 1.0)) {
        return std::isinf(kappa) ? Complex(1.0, 0.0) : kappa / Complex(kappa, 1.0);
    }
    if (std::isinf(kappa) && alpha >= NEVER_FOLLOWS) {
        std::tie(missing, std::ignore) = lack_of_triangle(1.0 / alpha);
        return 1.0 - missing;
    }
    double wanted = std::sqrt(squared);
    auto off = [wanted](const Ramp& r, Complex, Complex) {
        double steep = r.steepness * r.steepness;
        return std::tuple<double, double>{std::log(r.steepness / wanted), -r.slope * (1.0 + steep) / steep};
    };
    std::tie(missing, std::ignore, std::ignore) = balanced(first_guess(squared, kappa), alpha, kappa, off);
    return 1.0 - missing;
}

/// Gains from input to output, for points (p,) of alpha and kappa.
void describe(Vector alpha, Vector kappa, ComplexVector gain) {
    for (i64 i = 0; i < alpha.size(); ++i) {
        gain(i) = (alpha(i) >= 0.0 && kappa(i) > 0.0) ? gain_at(alpha(i), kappa(i)) : Complex(NaN, NaN);
    }
}

/// Gain from the error ``u - y`` to the rate of the output, over the frequency, and its derivative by ln error.
///
/// `error` is the amplitude of the fundamental of the error, over the limit divided by the frequency. In the linear
/// range of the servo the gain is kappa; the ideal limiter has none, and any error there is has a ramp.
std::tuple<Complex, Complex> inside_at(double error, double kappa) {
    Complex missing{}, by_rate{};
    double rate{};
    if (!(error > 0.0 && kappa > 0.0)) {
        return {Complex(NaN, NaN), Complex(NaN, NaN)};
    }
    if ((error * kappa) <= 1.0) {
        return {Complex(kappa, 0.0), Complex(0.0, 0.0)};
    }
    // Of a triangle |1 - N|^2 = 1 - (4 - 16/pi^2)/alpha^2, so that the input follows from the error at once; of a short
    // ramp |1 - N| = 9/(4 pi) beta^4.
    bool never = error > SATURATED;
    double alpha = std::sqrt(error * error + 4.0 - 16.0 / whole_power(PI, 2));
    if (std::isinf(kappa) && never) {
        rate = 1.0 / alpha;
        std::tie(missing, by_rate) = lack_of_triangle(rate);
    } else {
        double squared = never ? alpha * alpha - 1.0 : whole_power(std::tan(std::sqrt(std::sqrt(4.0 * PI / 9.0 *
            error))), 2);
        // The error's fundamental is what is missing, over the rate.
        auto off = [error](const Ramp& r, Complex lacks, Complex by) {
            double along = (by * r.rate / lacks).real - 1.0;
            return std::tuple<double, double>{std::log(modulus(lacks) / (r.rate * error)), along * r.slope};
        };
        double most = error + 4.0 / PI + 1.0 / kappa;
        std::tie(missing, by_rate, rate) = balanced(first_guess(squared, kappa), most, kappa, off);
    }
    if (missing == 0.0) {
        return {Complex(1.0 / error, 0.0), Complex(-1.0 / error, 0.0)};
    }
    Complex along = by_rate * rate / missing;
    Complex front = Complex(0.0, 1.0) / missing;
    return {front * (1.0 - missing), -front * along / (along.real - 1.0)};
}

/// Gains from the error to the rate of the output, over the frequency, for points (p,); see `inside_at`.
void describe_inside(Vector error, Vector kappa, ComplexVector gain) {
    for (i64 i = 0; i < error.size(); ++i) {
        std::tie(gain(i), std::ignore) = inside_at(error(i), kappa(i));
    }
}

}  // namespace describing_rate_limit
}  // namespace EPP_ARCH
}  // namespace epp
