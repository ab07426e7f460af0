#include "engine/series.hpp"

namespace epp {
inline namespace EPP_ARCH {

/// Sine (in Sg) and cosine (in aux), both scaled.
void _sine_term(i64 j, i64 k, double scale, Matrix Sg, Matrix arg, Matrix aux) {
    if (k == 0) {
        Sg(0, j) = scale * std::sin(arg(0, j));
        aux(0, j) = scale * std::cos(arg(0, j));
        return;
    }
    // sin' = cos a' and cos' = -sin a', coefficient by coefficient.
    double s = 0.0;
    double c = 0.0;
    for (i64 i = 1, i_end = k + 1; i < i_end; ++i) {
        s += i * arg(i, j) * aux(k - i, j);
        c -= i * arg(i, j) * Sg(k - i, j);
    }
    Sg(k, j) = s / k;
    aux(k, j) = c / k;
}

/// scale/(1 + |a|); within a mode the argument keeps its sign, which near zero its rate tells.
///
/// `noise` is the rounding of the terms of which the argument is made.
void _reciprocal_term(i64 j, i64 k, double scale, double noise, Matrix Sg, Matrix arg, Matrix aux) {
    if (k == 0) {
        Sg(0, j) = scale / (1.0 + std::fabs(arg(0, j)));
        aux(0, j) = (arg(0, j) >= 0) ? 1.0 : -1.0;
        return;
    }
    // From rest the first coefficient that does not vanish gives the sign, for a speed and its rate may start at zero.
    double before = 0.0;
    for (i64 i = 0; i < k; ++i) {
        before = greatest_of(before, std::fabs(arg(i, j)));
    }
    if (before <= (1e-09 * std::fabs(arg(k, j))) || (before <= noise && noise < std::fabs(arg(k, j)))) {
        aux(0, j) = (arg(k, j) > 0) ? 1.0 : -1.0;
    }
    // y (1 + |a|) = scale: of a product that is constant all coefficients but the first vanish.
    double v = 0.0;
    for (i64 i = 1, i_end = k + 1; i < i_end; ++i) {
        v -= aux(0, j) * arg(i, j) * Sg(k - i, j);
    }
    Sg(k, j) = v / (1.0 + std::fabs(arg(0, j)));
}

/// Coefficient k of smooth channel j by the recurrences of Taylor arithmetic.
void smooth_term(const Model& model, i64 j, i64 k, Matrix X, Vector H, Matrix Sg, Matrix arg, Matrix aux) {
    double square{}, cube{}, noise{};
    arg(k, j) = argument(model, j, k, X, H, Sg);
    double scale = model.smooth_scale(j);
    i64 kind = model.smooth_kind(j);
    if (kind == SINE) {
        _sine_term(j, k, scale, Sg, arg, aux);
    } else if (kind == CUBE) {
        // Products of series: the square is kept in `aux`, and the cube is its product with the argument.
        square = 0.0;
        cube = 0.0;
        for (i64 i = 0, i_end = k + 1; i < i_end; ++i) {
            square += arg(i, j) * arg(k - i, j);
        }
        aux(k, j) = square;
        for (i64 i = 0, i_end = k + 1; i < i_end; ++i) {
            cube += aux(i, j) * arg(k - i, j);
        }
        Sg(k, j) = scale * cube;
    } else if (kind >= SQUARE) {
        curve_term(kind, j, k, scale, Sg, arg, aux);
    } else {
        noise = 0.0;
        for (i64 i = 0, i_end = model.smooth_x.shape(1); i < i_end; ++i) {
            noise += std::fabs(model.smooth_x(j, i) * X(0, i));
        }
        for (i64 i = 0; i < H.size(); ++i) {
            noise += std::fabs(model.smooth_H(j, i) * H(i));
        }
        for (i64 i = 0; i < j; ++i) {
            noise += std::fabs(model.smooth_s(j, i) * Sg(0, i));
        }
        _reciprocal_term(j, k, scale, 64.0 * EPS * noise, Sg, arg, aux);
    }
}

/// Finish from a point where the zero ahead is unique and near.
double _newton(Vector p, double u, double v, double d) {
    double step{};
    for (i64 turn_ = 0; turn_ < 12; ++turn_) {
        if (d == 0.0) {
            break;
        }
        step = -v / d;
        u += step;
        if (std::fabs(step) <= (1e-17 + 1e-16 * u) || !(u > 0.0)) {
            break;
        }
        std::tie(v, d) = value_and_slope(p, u);
        d /= u;
    }
    return (u <= 1.0) ? u : 2.0;
}

/// First u in (0, 1] where ``sum p[k] u**k`` rises to zero from a negative start; 2.0 when nowhere.
///
/// Each step goes to the first zero of a quadratic that lies above the series (its curvature is a bound on [u, 1]),
/// so no zero can be passed; once Newton's condition holds the zero is unique ahead and Newton finishes.
double first_rise(Vector p, double tolerance) {
    double rest{}, root{};
    // Sums over the terms that rise bound p'' above, and -p'', on all of [0, 1] (docs/theory/engine.md, Series step).
    double over = rises(p, CURVATURE);
    double under = rises(p, MINUS_CURVATURE);
    double u = 0.0;
    double v = p(0);
    double d = p(1);
    for (i64 turn_ = 0; turn_ < 1000; ++turn_) {
        if (v >= 0.0 || (v >= (-tolerance) && d >= 0.0)) {
            return u;
        }
        rest = 1.0 - u;
        if ((v + rest * (d + 0.5 * over * rest)) < 0.0) {
            return 2.0;
        }
        // Kantorovich's condition, twice as strict as he needs it: only downward curvature bends away from the zero.
        if (d > 0.0 && (under * -v) < (0.25 * d * d) && (-2.0 * v) <= (d * rest)) {
            return _newton(p, u, v, d);
        }
        root = std::sqrt(d * d - 2.0 * over * v);
        // Just beneath zero, and falling: the sum of slope and root would be rounding, or none at all.
        if (d < 0.0) {
            if (over <= 0.0) {
                return 2.0;
            }
            u += (root - d) / over;
        } else {
            if ((d + root) <= 0.0) {
                return 2.0;
            }
            u += -2.0 * v / (d + root);
        }
        if (u > 1.0) {
            return 2.0;
        }
        // a bound beyond all range: no step is safe, however short
        if (!(u > 0.0)) {
            return 0.0;
        }
        std::tie(v, d) = value_and_slope(p, u);
        d /= u;
    }
    return u;
}

/// Coefficient k of smooth channel j by the recurrences of Taylor arithmetic.
void smooth_term(const Channels& model, i64 j, i64 k, Matrix X, Vector H, Matrix Sg, Matrix arg, Matrix aux) {
    double square{}, cube{}, noise{};
    arg(k, j) = argument(model, j, k, X, H, Sg);
    double scale = model.smooth_scale(j);
    i64 kind = model.smooth_kind(j);
    if (kind == SINE) {
        _sine_term(j, k, scale, Sg, arg, aux);
    } else if (kind == CUBE) {
        // Products of series: the square is kept in `aux`, and the cube is its product with the argument.
        square = 0.0;
        cube = 0.0;
        for (i64 i = 0, i_end = k + 1; i < i_end; ++i) {
            square += arg(i, j) * arg(k - i, j);
        }
        aux(k, j) = square;
        for (i64 i = 0, i_end = k + 1; i < i_end; ++i) {
            cube += aux(i, j) * arg(k - i, j);
        }
        Sg(k, j) = scale * cube;
    } else if (kind >= SQUARE) {
        curve_term(kind, j, k, scale, Sg, arg, aux);
    } else {
        noise = 0.0;
        for (i64 i = 0, i_end = model.smooth_x.shape(1); i < i_end; ++i) {
            noise += std::fabs(model.smooth_x(j, i) * X(0, i));
        }
        for (i64 i = 0; i < H.size(); ++i) {
            noise += std::fabs(model.smooth_H(j, i) * H(i));
        }
        for (i64 i = 0; i < j; ++i) {
            noise += std::fabs(model.smooth_s(j, i) * Sg(0, i));
        }
        _reciprocal_term(j, k, scale, 64.0 * EPS * noise, Sg, arg, aux);
    }
}

}  // namespace EPP_ARCH
}  // namespace epp
