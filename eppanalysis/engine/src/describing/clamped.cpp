#include "describing/clamped.hpp"

namespace epp {
inline namespace EPP_ARCH {

namespace describing_clamped {

/// The law that drives the integrator, or the one that holds it.
Law law_of(bool free, double kappa, double eta, double tau) {
    if (!free) {
        return {free, kappa, eta, tau, Complex(0.0, 0.0), eta * tau / (Complex(0.0, 1.0) + (1.0 - eta) * tau)};
    }
    // (j - M) c = (kappa, eta tau).
    Complex m00 = Complex(0.0, 1.0) + kappa;
    double m01 = -kappa;
    double m10 = eta * tau;
    Complex m11 = Complex(0.0, 1.0) + (1.0 - eta) * tau;
    Complex det = m00 * m11 - m01 * m10;
    return {free, kappa, eta, tau, (kappa * m11 - m01 * eta * tau) / det, (m00 * eta * tau - m10 * kappa) / det};
}

/// Matrix of a passage of length t less that of none: of sigma and delta, on sigma and delta.
Passage passage(const Law& law, double t) {
    double gone{}, quick{}, slow{}, between{}, first{}, dd{};
    double kappa = law.kappa;
    double eta = law.eta;
    double tau = law.tau;
    double fall = (1.0 - eta) * tau;
    if (!law.free) {
        gone = std::expm1(-fall * t);
        return {0.0, 0.0, eta / (1.0 - eta) * gone, gone};
    }
    // Roots of M, the slow one from the product, and exp(M t) - 1 = expm1(slow t) + (M - slow) dd.
    double half = 0.5 * (kappa + fall);
    double product = kappa * tau;
    double square = half * half - product;
    if (square >= 0.0) {
        quick = -half - std::sqrt(square);
        slow = product / quick;
        between = slow - quick;
        first = std::expm1(slow * t);
        // The difference quotient of the exponential at both roots: its limit where they coincide, which no quotient
        // would reach.
        dd = t * std::exp(slow * t);
        if ((between * t) > 1e-09) {
            dd = -std::exp(slow * t) * std::expm1(-between * t) / between;
        }
        return {first + (-kappa - slow) * dd, kappa * dd, -eta * tau * dd, first + (-fall - slow) * dd};
    }
    double turn = std::sqrt(-square);
    double left = std::exp(-half * t);
    // exp(-half t) cos(turn t) - 1, without cancellation.
    first = std::expm1(-half * t) - left * 2.0 * whole_power(std::sin(0.5 * turn * t), 2);
    dd = left * std::sin(turn * t) / turn;
    return {first + (half - kappa) * dd, kappa * dd, -eta * tau * dd, first + (half - fall) * dd};
}

/// One passage after another.
Passage joined(const Passage& a, const Passage& b) {
    return {a.ss + b.ss + (b.ss * a.ss + b.sd * a.ds), a.sd + b.sd + (b.ss * a.sd + b.sd * a.dd),
        a.ds + b.ds + (b.ds * a.ss + b.dd * a.ds), a.dd + b.dd + (b.ds * a.sd + b.dd * a.dd)};
}

/// ``exp(j t) - 1``, without cancellation.
Complex turned(double t) {
    return Complex(0.0, 2.0) * std::sin(0.5 * t) * exponential(Complex(0.0, 0.5) * t);
}

/// States behind an arc of length t from `begin`.
std::tuple<double, double> after(const Law& law, double begin, double t, double s, double d) {
    Complex turn = exponential(Complex(0.0, 1.0) * begin);
    Complex change = turn * turned(t);
    double rest_s = s - (law.s * turn).imag;
    double rest_d = d - (law.d * turn).imag;
    Passage p = passage(law, t);
    return {s + p.ss * rest_s + p.sd * rest_d + (law.s * change).imag, d + p.ds * rest_s + p.dd * rest_d + (law.d *
        change).imag};
}

/// Length of the arc up to the place between two at which the error turns: Newton's method, kept in its bracket.
double turn(const Law& law, double side, double begin, double low, double high, double s, double d) {
    double at_s{}, at_d{}, q{}, moves{};
    double t = high;
    while (true) {
        std::tie(at_s, at_d) = after(law, begin, t, s, d);
        q = std::sin(begin + t) - at_s + at_d;
        if ((side * q > 0.0) != law.free) {
            low = t;
        } else {
            high = t;
        }
        moves = std::cos(begin + t) - (law.free ? law.kappa * q : 0.0) + law.tau * (law.eta * q - at_d);
        if (std::fabs(q) <= (ROUNDING * t * std::fabs(moves))) {
            return t;
        }
        t -= q / moves;
        if (!(low < t && t < high)) {
            t = 0.5 * (low + high);
        }
        if (!(low < t && t < high)) {
            return high;
        }
    }
}

/// Length of an arc beyond a limit, up to where the error turns or to its end; minus one where it has turned before.
///
/// Where the error begins at zero, its sign is that of the first places at which it is not rounding.
double until(const Law& law, double side, double begin, double end, double s, double d) {
    Complex change{};
    double q{};
    double whole = end - begin;
    double last = 0.0;
    bool seen = false;
    Complex from = exponential(Complex(0.0, 1.0) * begin);
    double rest_s = s - (law.s * from).imag;
    double rest_d = d - (law.d * from).imag;
    // From place to place by products: twice as far from the first ones, an even step further from the others.
    double t = whole / EVEN * whole_power(0.5, HALVED);
    Complex far = turned(t);
    Passage p = passage(law, t);
    Complex step = far;
    Passage by = p;
    for (i64 k = 0, k_end = HALVED + EVEN; k < k_end; ++k) {
        if (k > 0) {
            step = (k <= HALVED) ? far : step;
            by = (k <= HALVED) ? p : by;
            far += step + step * far;
            p = joined(p, by);
            t = (k <= HALVED) ? 2.0 * t : whole * (k - HALVED + 1.0) / EVEN;
            if (k == HALVED) {
                step = far;
                by = p;
            }
        }
        change = from * far;
        q = from.imag + change.imag - (s + p.ss * rest_s + p.sd * rest_d + (law.s * change).imag) + (d + p.ds * rest_s +
            p.dd * rest_d + (law.d * change).imag);
        if ((side * q > 0.0) != law.free) {
            last = t;
            seen = true;
        } else if (seen) {
            return turn(law, side, begin, last, t, s, d);
        }
    }
    return seen ? whole : -1.0;
}

/// Add the integrals of sigma, and of sigma times ``exp(-j phi)``, over an arc to `sums`.
void integrals(const Law& law, double begin, double t, double s, double d, double s1, double d1, ComplexVector sums) {
    double past{}, here{};
    double kappa = law.kappa;
    double eta = law.eta;
    double tau = law.tau;
    Complex turn = exponential(-Complex(0.0, 1.0) * begin);
    if (!law.free) {
        sums(0) += s * t;
        sums(1) += s * turn * (1.0 - exponential(-Complex(0.0, 1.0) * t)) / Complex(0.0, 1.0);
        return;
    }
    // By parts small integrals would be differences divided by small determinants, det M = kappa tau: on a short arc
    // Gauss's rule leaves rounding alone.
    if (((kappa + tau) * t) < 2.0) {
        for (i64 k = 0; k < PLACE.size(); ++k) {
            past = 0.5 * t * (1.0 + PLACE(k));
            std::tie(here, std::ignore) = after(law, begin, past, s, d);
            sums(0) += 0.5 * t * WEIGHT(k) * here;
            sums(1) += 0.5 * t * WEIGHT(k) * here * exponential(-Complex(0.0, 1.0) * (begin + past));
        }
        return;
    }
    double m00 = -kappa;
    double m01 = kappa;
    double m10 = -eta * tau;
    double m11 = -(1.0 - eta) * tau;
    // Of the sine, and of the sine times exp(-j phi).
    double sine = 2.0 * std::sin(begin + 0.5 * t) * std::sin(0.5 * t);
    Complex twice = (exponential(-Complex(0.0, 2.0) * begin) - exponential(-Complex(0.0, 2.0) * (begin +
        t))) / Complex(0.0, 4.0);
    Complex wave = t / Complex(0.0, 2.0) - twice / Complex(0.0, 1.0);
    double r0 = s1 - s - kappa * sine;
    double r1 = d1 - d - eta * tau * sine;
    sums(0) += (m11 * r0 - m01 * r1) / (m00 * m11 - m01 * m10);
    Complex stop = exponential(-Complex(0.0, 1.0) * (begin + t));
    Complex c0 = s1 * stop - s * turn - kappa * wave;
    Complex c1 = d1 * stop - d * turn - eta * tau * wave;
    Complex n00 = m00 - Complex(0.0, 1.0);
    Complex n11 = m11 - Complex(0.0, 1.0);
    sums(1) += (n11 * c0 - m01 * c1) / (n00 * n11 - m01 * m10);
}

/// Go through a period: states behind it; fills the product of the passages, and integrals.
std::tuple<double, double> period(double s, double d, Vector edges, const Law& drives, const Law& holds, Matrix product,
    ComplexVector sums) {
    double begin{}, end{}, side{}, t{}, s1{}, d1{}, one{}, two{};
    bool free{};
    const double was1 = 1.0;
    product(0, 0) = was1;
    product(1, 1) = was1;
    const double was2 = 0.0;
    product(0, 1) = was2;
    product(1, 0) = was2;
    sums.fill(0.0);
    for (i64 part = 0; part < 5; ++part) {
        begin = edges(part);
        end = edges(part + 1);
        // From trough to trough v is beyond the lower limit, within, beyond the upper one, within, beyond the lower one.
        // Within the integrator always moves; beyond a limit only where the error leads back
        // (docs/theory/anti_windup.md, Clamping).
        side = (part == 2) ? 1.0 : -1.0;
        free = (modulo(part, 2)) == 1 || (side * (std::sin(begin) - s + d)) < 0.0;
        for (i64 arc = 0; arc < ARCS; ++arc) {
            if (!(end > begin)) {
                break;
            }
            t = end - begin;
            if ((modulo(part, 2)) == 0 && arc < (ARCS - 1)) {
                t = until(free ? drives : holds, side, begin, end, s, d);
                // The error has nowhere on the arc the sign of its begin, which was rounding: the other law holds.
                if (t < 0.0) {
                    free = !free;
                    t = end - begin;
                }
            }
            const Law& law = free ? drives : holds;
            std::tie(s1, d1) = after(law, begin, t, s, d);
            integrals(law, begin, t, s, d, s1, d1, sums);
            Passage p = passage(law, t);
            for (i64 k = 0; k < 2; ++k) {
                one = product(0, k);
                two = product(1, k);
                product(0, k) = one + p.ss * one + p.sd * two;
                product(1, k) = two + p.ds * one + p.dd * two;
            }
            s = s1;
            d = d1;
            begin = ((begin + t) >= end) ? end : begin + t;
            free = !free;
        }
    }
    return {s, d};
}

/// Mean of sigma and its fundamental over the sine; no numbers where no period repeats itself.
std::tuple<double, Complex> answer(double low, double high, double kappa, double eta, double tau) {
    Scope scope;
    double s1{}, d1{}, off_s{}, off_d{}, off{}, a{}, b{}, c{}, e{}, det{};
    double below = std::asin(least_of(greatest_of(low, -1.0), 1.0));
    double above = std::asin(least_of(greatest_of(high, -1.0), 1.0));
    double quarter = 0.5 * PI;
    Vector edges = array_of<double>({-quarter, below, above, PI - above, PI - below, 3.0 * quarter});
    Matrix product = empty<double>(2, 2);
    ComplexVector sums = empty<Complex>(2);
    Law drives = law_of(true, kappa, eta, tau);
    Law holds = law_of(false, kappa, eta, tau);
    double s = least_of(greatest_of(0.0, low), high);
    double d = 0.0;
    double from_s = s;
    double from_d = d;
    double move_s = 0.0;
    double move_d = 0.0;
    double least = INF;
    i64 halved = 0;
    for (i64 turn_ = 0; turn_ < STEPS; ++turn_) {
        std::tie(s1, d1) = period(s, d, edges, drives, holds, product, sums);
        off_s = s1 - s;
        off_d = d1 - d;
        off = std::fabs(off_s) + std::fabs(off_d);
        // The map is of several linear pieces: a whole step may lead beyond the one that holds.
        if (off > least && halved < HALVINGS) {
            halved += 1;
            move_s = 0.5 * move_s;
            move_d = 0.5 * move_d;
            s = from_s + move_s;
            d = from_d + move_d;
            continue;
        }
        a = 1.0 - product(0, 0);
        b = -product(0, 1);
        c = -product(1, 0);
        e = 1.0 - product(1, 1);
        det = a * e - b * c;
        move_s = (e * off_s - b * off_d) / det;
        move_d = (a * off_d - c * off_s) / det;
        // Where the integrator is slow, one less the derivative of the map is small, and a step as uncertain as rounding
        // over its determinant.
        if ((std::fabs(move_s) + std::fabs(move_d)) <= (ROUNDING * (1.0 + std::fabs(s) + std::fabs(d)) / least_of(1.0,
            greatest_of(std::fabs(det), 1e-12)))) {
            return {sums(0).real / (2.0 * PI), Complex(0.0, 1.0) * sums(1) / PI};
        }
        from_s = s;
        from_d = d;
        least = off;
        halved = 0;
        s = s + move_s;
        d = d + move_d;
    }
    return {NaN, Complex(NaN, NaN)};
}

/// Mean of the integrator's state about the bias and its fundamental, over the amplitude.
///
/// Parameters
/// ----------
/// low, high : array, shape (n,)
///     Limits less the bias, over the amplitude.
/// kappa, eta, tau : array, shape (n,)
///     As in the module's first lines.
/// mean : array, shape (n,)
///     Written to.
/// gain : array of complex, shape (n,)
///     Written to.
void describe(Vector low, Vector high, Vector kappa, Vector eta, Vector tau, Vector mean, ComplexVector gain) {
    for (i64 i = 0; i < low.size(); ++i) {
        std::tie(mean(i), gain(i)) = answer(low(i), high(i), kappa(i), eta(i), tau(i));
    }
}

}  // namespace describing_clamped
}  // namespace EPP_ARCH
}  // namespace epp
