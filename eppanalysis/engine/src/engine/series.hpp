#pragma once
// Taylor series of the state in one mode, and the first rise of a guard through zero along it.
//
// Series are scaled to the step: ``x(t + u h) = sum X[k] u**k`` with u in [0, 1].

#include "engine/constants.hpp"
#include "structures.hpp"
#include "engine/curves.hpp"
#include "engine/flow.hpp"

namespace epp {
inline namespace EPP_ARCH {

inline double argument(const Model& rows, i64 j, i64 k, Matrix X, Vector H, Matrix Sg);
void _sine_term(i64 j, i64 k, double scale, Matrix Sg, Matrix arg, Matrix aux);
void _reciprocal_term(i64 j, i64 k, double scale, double noise, Matrix Sg, Matrix arg, Matrix aux);
void smooth_term(const Model& model, i64 j, i64 k, Matrix X, Vector H, Matrix Sg, Matrix arg, Matrix aux);
inline i64 _expand_linear(Matrix M, Matrix M_twice, Vector f, double h, Vector small, Matrix X);
inline i64 expand(const Model& model, const Combinations& compiled, i64 q, Vector x, Vector f, Vector H, double h,
    Vector largest, Vector small, Matrix X, Matrix Sg, Matrix arg, Matrix aux);
inline void guard_series(const Combinations& compiled, i64 q, i64 g, Matrix X, i64 last, Matrix Sg, double constant,
    double h, Vector p);
inline bool may_rise(Vector p);
inline void term_sizes(const Combinations& compiled, i64 q, Matrix X, Matrix Sg, Vector H, double h, Vector recent,
    double clock, i64 first, i64 last, Matrix Y, Vector wide);
inline double guard_noise(const Combinations& compiled, i64 q, i64 g, i64 k, Matrix Sg, Vector H, double h, Matrix Y);
double _newton(Vector p, double u, double v, double d);
double first_rise(Vector p, double tolerance);
inline double argument(const Channels& rows, i64 j, i64 k, Matrix X, Vector H, Matrix Sg);
void smooth_term(const Channels& model, i64 j, i64 k, Matrix X, Vector H, Matrix Sg, Matrix arg, Matrix aux);
inline double argument(const Numbers& rows, i64 j, i64 k, Matrix X, Vector H, Matrix Sg);

/// Coefficient k of what the rows of channel j make of state, memory and the channels before it.
inline double argument(const Model& rows, i64 j, i64 k, Matrix X, Vector H, Matrix Sg) {
    double a = 0.0;
    for (i64 i = 0, i_end = rows.smooth_x.shape(1); i < i_end; ++i) {
        a += rows.smooth_x(j, i) * X(k, i);
    }
    if (k == 0) {
        for (i64 i = 0; i < H.size(); ++i) {
            a += rows.smooth_H(j, i) * H(i);
        }
    }
    for (i64 i = 0; i < j; ++i) {
        a += rows.smooth_s(j, i) * Sg(k, i);
    }
    return a;
}

/// As `expand`, without smooth channels: odd and even orders beside each other, two products at a time.
inline i64 _expand_linear(Matrix M, Matrix M_twice, Vector f, double h, Vector small, Matrix X) {
    row_sum_from(f, M, X.row(0), h, X.row(1));
    row_sum(M, X.row(1), 0.5 * h, X.row(2));
    // By M^2 each order needs the last but one: neither of the two products waits for the other.
    for (i64 k = 1, k_end = ORDER - 2; k < k_end; k += 2) {
        row_sum(M_twice, X.row(k), h * h / ((k + 1) * (k + 2)), X.row(k + 2));
        row_sum(M_twice, X.row(k + 1), h * h / ((k + 2) * (k + 3)), X.row(k + 3));
        if (!any_above(X.row(k + 2), 1.0, small) && !any_above(X.row(k + 3), 1.0, small)) {
            return k + 3;
        }
    }
    return -1;
}

/// Fill X with the series of the state from x over the step h, and Sg with those of the smooth channels.
///
/// `f` is the constant part of the rate (from the memory values). Delay channels must be in Sg already. Returns the
/// order at which two terms in a row are below the rounding of every state's own size (or of a trace of its size over
/// the run); -1 when that is not reached.
inline i64 expand(const Model& model, const Combinations& compiled, i64 q, Vector x, Vector f, Vector H, double h,
    Vector largest, Vector small, Matrix X, Matrix Sg, Matrix arg, Matrix aux) {
    i64 kind{};
    double factor{}, scale{};
    bool over{};
    Matrix S = compiled.S.row(q);
    i64 n = S.shape(0);
    i64 n_s = S.shape(1);
    for (i64 i = 0; i < n; ++i) {
        X(0, i) = x(i);
        // A state that passes zero has no size there; without a trace of its largest the order would rise for nothing.
        small(i) = 0.5 * EPS * greatest_of(std::fabs(x(i)), 0.01 * largest(i));
    }
    if (n_s == 0 && compiled.row_end.shape(1) == 0) {
        return _expand_linear(compiled.M.row(q), compiled.M_twice.row(q), f, h, small, X);
    }
    i64 below = 0;
    for (i64 k = 0; k < ORDER; ++k) {
        for (i64 j = 0; j < n_s; ++j) {
            if (model.smooth_kind(j) != DELAY_LINE) {
                smooth_term(model, j, k, X, H, Sg, arg, aux);
            }
        }
        factor = h / (k + 1);
        if (k == 0) {
            rate_from(compiled, q, f, X.row(0), h, X.row(1));
        } else {
            rate_of(compiled, q, X.row(k), factor, X.row(k + 1));
        }
        for (i64 j = 0; j < n_s; ++j) {
            for (i64 i = 0; i < n; ++i) {
                X(k + 1, i) += factor * S(i, j) * Sg(k, j);
            }
        }
        // Of what moves at the pace of its step the first terms are not small.
        over = (n_s == 0 && k < SOON) || any_above(X.row(k + 1), 1.0, small);
        for (i64 j = 0; j < n_s; ++j) {
            kind = model.smooth_kind(j);
            scale = model.smooth_scale(j);
            over = over || !has_fallen(kind, j, k, 0.25 * EPS, scale, Sg, arg, aux);
        }
        below = over ? 0 : below + 1;
        // One small term proves nothing: of a motion that begins at its turn every other one is zero.
        if (below == 2) {
            for (i64 j = 0; j < n_s; ++j) {
                if (model.smooth_kind(j) != DELAY_LINE) {
                    smooth_term(model, j, k + 1, X, H, Sg, arg, aux);
                }
            }
            return k + 1;
        }
    }
    return -1;
}

/// Series of guard g of combination q into p, zero behind its order `last`; a guard on rates has one order less.
inline void guard_series(const Combinations& compiled, i64 q, i64 g, Matrix X, i64 last, Matrix Sg, double constant,
    double h, Vector p) {
    i64 i{};
    double a{};
    Vector row = compiled.ga.row(q, g);
    Indices place = compiled.ga_place.row(q, g);
    for (i64 k = 0; k < p.size(); ++k) {
        p(k) = 0.0;
    }
    for (i64 c = 0, c_end = compiled.ga_count(q, g); c < c_end; ++c) {
        i = place(c);
        a = row(i);
        for (i64 k = 0, k_end = last + 1; k < k_end; ++k) {
            p(k) += a * X(k, i);
        }
    }
    if (compiled.on_rate(q, g)) {
        for (i64 k = 0; k < last; ++k) {
            p(k) += dot(compiled.gb.row(q, g), X.row(k + 1)) * (k + 1) / h;
        }
    }
    if (compiled.smooth_guard(q, g)) {
        for (i64 j = 0; j < Sg.shape(1); ++j) {
            for (i64 k = 0, k_end = last + 1; k < k_end; ++k) {
                p(k) += compiled.gs(q, g, j) * Sg(k, j);
            }
            for (i64 k = 0; k < last; ++k) {
                p(k) += compiled.gt(q, g, j) * Sg(k + 1, j) * (k + 1) / h;
            }
        }
    }
    p(0) += constant;
}

/// Cheap test of a series that starts below zero: False proves that it stays there on [0, 1].
inline bool may_rise(Vector p) {
    return (p(0) + rises(p, AFTER)) > 0.0;
}

/// Rows first..last of Y: sizes of the terms that were added up to make the rows of X.
///
/// Rounding comes from these, not from what is left after they cancel; `recent` holds the sizes from which the state at
/// the start was computed. What comes out of the past comes with the rounding of the time at which it is read: `clock`
/// is that time in steps, 0 where nothing is delayed. `wide` is workspace.
inline void term_sizes(const Combinations& compiled, i64 q, Matrix X, Matrix Sg, Vector H, double h, Vector recent,
    double clock, i64 first, i64 last, Matrix Y, Vector wide) {
    double v{};
    i64 n = compiled.N.shape(1);
    i64 n_s = Sg.shape(1);
    if (first == 0) {
        take_larger(Y.row(0), X.row(0), recent);
    }
    for (i64 k = greatest_of<i64>(first, 1), k_end = last + 1; k < k_end; ++k) {
        take_larger(wide, X.row(k - 1), Y.row(k - 1));
        size_of_rate(compiled, q, wide, h / k, Y.row(k));
        if (k == 1) {
            for (i64 i = 0; i < n; ++i) {
                v = 0.0;
                for (i64 j = 0; j < H.size(); ++j) {
                    v += std::fabs(compiled.N(q, i, j) * H(j));
                }
                Y(1, i) += v * h;
            }
        }
        for (i64 j = 0; j < n_s; ++j) {
            for (i64 i = 0; i < n; ++i) {
                Y(k, i) += std::fabs(compiled.S(q, i, j)) * (std::fabs(Sg(k - 1, j)) + clock * k * std::fabs(Sg(k,
                    j))) * h / k;
            }
        }
    }
}

/// Rounding noise of term k of a guard's series, from the sizes in Y.
inline double guard_noise(const Combinations& compiled, i64 q, i64 g, i64 k, Matrix Sg, Vector H, double h, Matrix Y) {
    double v = dot(compiled.ga_size.row(q, g), Y.row(k));
    if (compiled.on_rate(q, g)) {
        v += dot(compiled.gb_size.row(q, g), Y.row(k + 1)) * (k + 1) / h;
    }
    for (i64 j = 0; j < Sg.shape(1); ++j) {
        v += std::fabs(compiled.gs(q, g, j) * Sg(k, j)) + std::fabs(compiled.gt(q, g, j) * Sg(k + 1, j)) * (k + 1) / h;
    }
    if (k == 0) {
        for (i64 j = 0; j < H.size(); ++j) {
            v += std::fabs(compiled.gH(q, g, j) * H(j));
        }
    }
    return 64.0 * EPS * v;
}

/// Coefficient k of what the rows of channel j make of state, memory and the channels before it.
inline double argument(const Channels& rows, i64 j, i64 k, Matrix X, Vector H, Matrix Sg) {
    double a = 0.0;
    for (i64 i = 0, i_end = rows.smooth_x.shape(1); i < i_end; ++i) {
        a += rows.smooth_x(j, i) * X(k, i);
    }
    if (k == 0) {
        for (i64 i = 0; i < H.size(); ++i) {
            a += rows.smooth_H(j, i) * H(i);
        }
    }
    for (i64 i = 0; i < j; ++i) {
        a += rows.smooth_s(j, i) * Sg(k, i);
    }
    return a;
}

/// Coefficient k of what the rows of channel j make of state, memory and the channels before it.
inline double argument(const Numbers& rows, i64 j, i64 k, Matrix X, Vector H, Matrix Sg) {
    double a = 0.0;
    for (i64 i = 0, i_end = rows.smooth_x.shape(1); i < i_end; ++i) {
        a += rows.smooth_x(j, i) * X(k, i);
    }
    if (k == 0) {
        for (i64 i = 0; i < H.size(); ++i) {
            a += rows.smooth_H(j, i) * H(i);
        }
    }
    for (i64 i = 0; i < j; ++i) {
        a += rows.smooth_s(j, i) * Sg(k, i);
    }
    return a;
}

}  // namespace EPP_ARCH
}  // namespace epp
