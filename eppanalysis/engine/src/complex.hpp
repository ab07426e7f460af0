#pragma once
// Complex numbers with plain products, and quotients as Python has them: `std::complex` multiplies and divides by other
// rules, which are slower.

#include "views.hpp"

namespace epp {
inline namespace EPP_ARCH {

struct Complex {
    double real = 0.0, imag = 0.0;

    constexpr Complex() = default;
    constexpr Complex(double real, double imag = 0.0) : real(real), imag(imag) {}  // NOLINT: a number is a complex one

    constexpr Complex conjugate() const { return {real, -imag}; }
    constexpr Complex operator-() const { return {-real, -imag}; }
    friend constexpr Complex operator+(Complex a, Complex b) { return {a.real + b.real, a.imag + b.imag}; }
    friend constexpr Complex operator-(Complex a, Complex b) { return {a.real - b.real, a.imag - b.imag}; }
    friend constexpr Complex operator*(Complex a, Complex b) {
        return {a.real * b.real - a.imag * b.imag, a.real * b.imag + a.imag * b.real};
    }
    /// By the larger part of the divisor, so that no square overflows.
    friend Complex operator/(Complex a, Complex b) {
        if (std::fabs(b.real) >= std::fabs(b.imag)) {
            const double ratio = b.imag / b.real, whole = b.real + b.imag * ratio;
            return {(a.real + a.imag * ratio) / whole, (a.imag - a.real * ratio) / whole};
        }
        if (std::fabs(b.imag) >= std::fabs(b.real)) {
            const double ratio = b.real / b.imag, whole = b.real * ratio + b.imag;
            return {(a.real * ratio + a.imag) / whole, (a.imag * ratio - a.real) / whole};
        }
        return {NaN, NaN};
    }
    Complex& operator+=(Complex b) { return *this = *this + b; }
    Complex& operator-=(Complex b) { return *this = *this - b; }
    Complex& operator*=(Complex b) { return *this = *this * b; }
    Complex& operator/=(Complex b) { return *this = *this / b; }
    friend constexpr bool operator==(Complex a, Complex b) { return a.real == b.real && a.imag == b.imag; }
    friend constexpr bool operator!=(Complex a, Complex b) { return !(a == b); }
};

using Vector = View<double, 1>;
using Matrix = View<double, 2>;
using Matrices = View<double, 3>;
using Indices = View<i64, 1>;
using IndexMatrix = View<i64, 2>;
using Flags = View<bool, 1>;
using ComplexVector = View<Complex, 1>;
using ComplexMatrix = View<Complex, 2>;
using ComplexMatrices = View<Complex, 3>;

inline double modulus(Complex a) { return std::hypot(a.real, a.imag); }

inline Complex exponential(Complex a) {
    if (std::isfinite(a.real)) {
        if (!std::isfinite(a.imag)) return {NaN, NaN};
        const double size = std::exp(a.real);
        return {size * std::cos(a.imag), size * std::sin(a.imag)};
    }
    if (std::isnan(a.real)) return {a.real, a.imag != 0.0 ? a.real : a.imag};
    if (a.real < 0.0) return std::isfinite(a.imag) ? Complex{0.0 * std::cos(a.imag), 0.0 * std::sin(a.imag)} : Complex{};
    if (!std::isfinite(a.imag)) return {a.real, NaN};
    const double cosine = std::cos(a.imag), sine = std::sin(a.imag);
    return {cosine != 0.0 ? cosine * a.real : cosine, sine != 0.0 ? sine * a.real : sine};
}

}  // namespace EPP_ARCH
}  // namespace epp
