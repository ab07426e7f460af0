#include "engine/curves.hpp"

namespace epp {
inline namespace EPP_ARCH {

/// Coefficient k of the product of two series.
double _product(Matrix a, Matrix b, i64 j, i64 k) {
    double total = 0.0;
    for (i64 i = 0, i_end = k + 1; i < i_end; ++i) {
        total += a(i, j) * b(k - i, j);
    }
    return total;
}

void _power_term(i64 kind, i64 j, i64 k, double scale, Matrix Sg, Matrix arg, Matrix aux) {
    double total{};
    aux(k, j) = _product(arg, arg, j, k);
    if (kind == SQUARE) {
        Sg(k, j) = scale * aux(k, j);
    } else if (kind == FOURTH) {
        Sg(k, j) = scale * _product(aux, aux, j, k);
    } else {
        total = 0.0;
        for (i64 i = 0, i_end = k + 1; i < i_end; ++i) {
            total += _product(aux, aux, j, i) * arg(k - i, j);
        }
        Sg(k, j) = scale * total;
    }
}

/// Value and slope of a function.
std::tuple<double, double> curve(i64 kind, double x) {
    double e{};
    if (kind == SQUARE) {
        return {x * x, 2.0 * x};
    }
    if (kind == FOURTH) {
        return {x * x * x * x, 4.0 * x * x * x};
    }
    if (kind == FIFTH) {
        return {x * x * x * x * x, 5.0 * x * x * x * x};
    }
    // 4 e/(1 + e)^2 for 1 - tanh^2, which would cancel where the function saturates.
    if (kind == TANH) {
        e = std::exp(-2.0 * std::fabs(x));
        return {std::tanh(x), 4.0 * e / ((1.0 + e) * (1.0 + e))};
    }
    if (kind == ARCTAN) {
        return {std::atan(x), 1.0 / (1.0 + x * x)};
    }
    if (kind == LOGARITHM) {
        return (std::fabs(x) > LEAST) ? std::tuple<double, double>{std::log(std::fabs(x)), 1.0 / x} :
            std::tuple<double, double>{std::log(LEAST), 0.0};
    }
    if (kind == EXPONENTIAL) {
        return {std::exp(x), std::exp(x)};
    }
    double y = std::exp(-x * x);
    return {y, -2.0 * x * y};
}

/// Coefficient k of a scaled function.
void curve_term(i64 kind, i64 j, i64 k, double scale, Matrix Sg, Matrix arg, Matrix aux) {
    double value{}, slope{};
    if (kind <= FIFTH) {
        _power_term(kind, j, k, scale, Sg, arg, aux);
        return;
    }
    if (k == 0) {
        std::tie(value, slope) = curve(kind, arg(0, j));
        Sg(0, j) = scale * value;
        aux(0, j) = scale * slope;
        return;
    }
    double total = 0.0;
    // y' = -(x^2)' y
    if (kind == GAUSSIAN) {
        for (i64 i = 1, i_end = k + 1; i < i_end; ++i) {
            total -= i * _product(arg, arg, j, i) * Sg(k - i, j);
        }
        Sg(k, j) = total / k;
        return;
    }
    // y' = slope(x) x'
    for (i64 i = 1, i_end = k + 1; i < i_end; ++i) {
        total += i * arg(i, j) * aux(k - i, j);
    }
    Sg(k, j) = total / k;
    // slope = 1 - y^2
    if (kind == TANH) {
        aux(k, j) = (scale != 0.0) ? -_product(Sg, Sg, j, k) / scale : 0.0;
        return;
    }
    // slope = y
    if (kind == EXPONENTIAL) {
        aux(k, j) = Sg(k, j);
        return;
    }
    total = 0.0;
    // slope x = 1, and none at rest
    if (kind == LOGARITHM) {
        for (i64 i = 1, i_end = k + 1; i < i_end; ++i) {
            total -= arg(i, j) * aux(k - i, j);
        }
        aux(k, j) = (aux(0, j) != 0.0) ? total / arg(0, j) : 0.0;
        return;
    }
    // slope (1 + x^2) = 1
    for (i64 i = 1, i_end = k + 1; i < i_end; ++i) {
        total -= _product(arg, arg, j, i) * aux(k - i, j);
    }
    aux(k, j) = total / (1.0 + arg(0, j) * arg(0, j));
}

/// Whether a function that is flat where its series begins may bend on the way, by terms that are still to come.
///
/// ``1 - tanh`` of thirty is beneath the rounding of one, and so are its first terms on the way through zero: by its
/// own size each is larger than the one before. The function may stay flat for the whole step, or the series of what
/// bends it has fallen.
bool hides(i64 kind, i64 j, i64 k, double limit, double scale, Matrix Sg, Matrix arg, Matrix aux) {
    if (scale == 0.0 || (kind == ARCTAN || kind == LOGARITHM)) {
        return false;
    }
    double flat = (kind == TANH) ? SATURATED : ((kind == GAUSSIAN) ? GONE : DECAYED);
    double rest = std::fabs(arg(0, j));
    double size = 0.0;
    Matrix bend = (kind == TANH) ? aux : Sg;
    for (i64 i = 0, i_end = k + 1; i < i_end; ++i) {
        size = greatest_of(size, std::fabs(bend(i, j)));
        if (i > 0) {
            rest -= std::fabs(arg(i, j));
        }
    }
    return rest <= flat && !(std::fabs(bend(k, j)) < (limit * size));
}

/// Whether coefficient k is below a share of what the series begins with, and does not hide those behind it.
///
/// A function that passes zero begins with nothing there: the largest coefficient counts.
bool has_fallen(i64 kind, i64 j, i64 k, double limit, double scale, Matrix Sg, Matrix arg, Matrix aux) {
    double size = std::fabs(Sg(0, j));
    if (SQUARE <= kind && kind <= EXPONENTIAL) {
        for (i64 i = 1, i_end = k + 1; i < i_end; ++i) {
            size = greatest_of(size, std::fabs(Sg(i, j)));
        }
    }
    return std::fabs(Sg(k, j)) <= (limit * size) && !((TANH <= kind && kind <= EXPONENTIAL) && hides(kind, j, k, limit,
        scale, Sg, arg, aux));
}

/// Coefficient k of the slope of a scaled function by its argument, behind `curve_term`.
double curve_slope_term(i64 kind, i64 j, i64 k, double scale, Matrix Sg, Matrix arg, Matrix aux) {
    if (kind == SQUARE) {
        return 2.0 * scale * arg(k, j);
    }
    if (kind == FOURTH) {
        return 4.0 * scale * _product(aux, arg, j, k);
    }
    if (kind == FIFTH) {
        return 5.0 * scale * _product(aux, aux, j, k);
    }
    if (kind == GAUSSIAN) {
        return -2.0 * _product(arg, Sg, j, k);
    }
    return aux(k, j);
}

}  // namespace EPP_ARCH
}  // namespace epp
