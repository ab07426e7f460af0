#include "engine/delays.hpp"

namespace epp {
inline namespace EPP_ARCH {

/// Before the start a delayed output has had its value at the start for ever.
void start_lines(const Model& model, const Combinations& compiled, i64 q, Vector x, Vector H, Matrices line_t,
    Matrix line_h, Matrices line_c, IndexMatrix line_n) {
    i64 w{};
    double v{};
    for (i64 j = 0; j < line_n.shape(0); ++j) {
        if (model.smooth_kind(j) != DELAY_LINE) {
            continue;
        }
        w = model.smooth_w(j);
        v = 0.0;
        for (i64 i = 0, i_end = compiled.Wx.shape(2); i < i_end; ++i) {
            v += compiled.Wx(q, w, i) * x(i);
        }
        for (i64 i = 0; i < H.size(); ++i) {
            v += compiled.WH(q, w, i) * H(i);
        }
        line_t(j, 0, 0) = -ALWAYS;
        line_t(j, 0, 1) = 0.0;
        line_h(j, 0) = 2.0 * ALWAYS;
        // what an earlier run left there
        line_c.row(j, 0).fill(0.0);
        line_c(j, 0, 0) = v;
        line_n(j, 0) = 1;
        line_n(j, 1) = 0;
    }
}

/// How far from t on the segment that holds t - delay counts, and how far its series holds.
///
/// Both are -1 when history was overwritten.
std::tuple<double, double> segment_reach(const Model& model, i64 j, double t, Matrices line_t, Matrix line_h,
    IndexMatrix line_n) {
    i64 size = line_t.shape(1);
    double late = t - model.smooth_delay(j);
    // A segment that ends here but for the rounding of times would be read over no time at all.
    double slack = 1e-14 * greatest_of(std::fabs(t), std::fabs(late));
    while (line_n(j, 1) < (line_n(j, 0) - 1) && line_t(j, modulo(line_n(j, 1), size), 1) <= (late + slack)) {
        line_n(j, 1) += 1;
    }
    if ((line_n(j, 0) - line_n(j, 1)) > size) {
        return {-1.0, -1.0};
    }
    i64 r = modulo(line_n(j, 1), size);
    double counts = line_t(j, r, 1) - late;
    double holds = line_t(j, r, 0) + line_h(j, r) - late;
    return {greatest_of(counts, 0.0), greatest_of(counts, holds)};
}

/// Coefficients of the polynomial c about u.
void _shift(Vector c, double u, Vector p) {
    for (i64 k = 0, k_end = ORDER + 1; k < k_end; ++k) {
        p(k) = c(k);
    }
    if (u == 0.0) {
        return;
    }
    // Horner's scheme, repeated: each pass takes off one factor of the new variable.
    for (i64 i = 0; i < ORDER; ++i) {
        for (i64 k = ORDER - 1, k_end = i - 1; k > k_end; --k) {
            p(k) += u * p(k + 1);
        }
    }
}

/// Series of the delayed output over [t, t + d] from its segment, by a shift of the series.
void read_line(const Model& model, i64 j, double t, double d, Matrices line_t, Matrix line_h, Matrices line_c,
    IndexMatrix line_n, Matrix Sg, Vector p) {
    i64 r = modulo(line_n(j, 1), line_t.shape(1));
    Vector c = line_c.row(j, r);
    double h = line_h(j, r);
    bool constant = true;
    for (i64 k = 1, k_end = ORDER + 1; k < k_end; ++k) {
        if (c(k) != 0.0) {
            constant = false;
        }
    }
    if (constant) {
        Sg(0, j) = c(0);
        for (i64 k = 1, k_end = ORDER + 1; k < k_end; ++k) {
            Sg(k, j) = 0.0;
        }
        return;
    }
    _shift(c, (t - model.smooth_delay(j) - line_t(j, r, 0)) / h, p);
    double f = 1.0;
    for (i64 k = 0, k_end = ORDER + 1; k < k_end; ++k) {
        Sg(k, j) = p(k) * f;
        f *= d / h;
    }
}

/// Whether a series over [t, t + u1 d] is what an earlier one, in units of h from its begin, says of it.
bool _continues(Vector old, double begin, double h, Vector new_, double t, double d, double u1, Vector p) {
    if ((t + u1 * d) > (begin + h)) {
        return false;
    }
    _shift(old, (t - begin) / h, p);
    double f = 1.0;
    double away = 0.0;
    double size = 0.0;
    for (i64 k = 0, k_end = ORDER + 1; k < k_end; ++k) {
        away += std::fabs(p(k) * f - new_(k));
        size += std::fabs(new_(k));
        f *= d / h;
    }
    return away <= (CONTINUES * size);
}

/// Append what the delayed outputs did over the step just made.
void extend_lines(const Model& model, const Combinations& compiled, i64 q, Matrix X, i64 last, Matrix Sg, Vector H,
    double t, double d, double u1, Matrices line_t, Matrix line_h, Matrices line_c, IndexMatrix line_n, Vector p) {
    i64 size{}, r{}, w{}, before{};
    bool constant{};
    double v{};
    i64 n_s = line_n.shape(0);
    for (i64 j = 0; j < n_s; ++j) {
        if (model.smooth_kind(j) != DELAY_LINE) {
            continue;
        }
        size = line_t.shape(1);
        r = modulo(line_n(j, 0), size);
        w = model.smooth_w(j);
        constant = true;
        for (i64 k = last + 1, k_end = ORDER + 1; k < k_end; ++k) {
            line_c(j, r, k) = 0.0;
        }
        for (i64 k = 0, k_end = last + 1; k < k_end; ++k) {
            v = 0.0;
            for (i64 i = 0, i_end = compiled.Wx.shape(2); i < i_end; ++i) {
                v += compiled.Wx(q, w, i) * X(k, i);
            }
            for (i64 i = 0; i < n_s; ++i) {
                v += compiled.Ws(q, w, i) * Sg(k, i);
            }
            if (k == 0) {
                for (i64 i = 0; i < H.size(); ++i) {
                    v += compiled.WH(q, w, i) * H(i);
                }
            } else if (v != 0.0) {
                constant = false;
            }
            line_c(j, r, k) = v;
        }
        // Where the series only goes on there was no switch: one segment more would come back as an end after every dead
        // time.
        before = modulo(line_n(j, 0) - 1, size);
        if (_continues(line_c.row(j, before), line_t(j, before, 0), line_h(j, before), line_c.row(j, r), t, d, u1, p)) {
            line_t(j, before, 1) = t + u1 * d;
            continue;
        }
        line_t(j, r, 0) = t;
        line_t(j, r, 1) = t + u1 * d;
        line_h(j, r) = constant ? 2.0 * ALWAYS : d;
        line_n(j, 0) += 1;
    }
}

}  // namespace EPP_ARCH
}  // namespace epp
