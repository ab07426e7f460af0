#include "extrema.hpp"

namespace epp {
inline namespace EPP_ARCH {

namespace extrema {

/// Value of a series at the greatest value next to u, as far as Newton's method gets on the piece.
double top(Vector c, double u, double sign) {
    double p0{}, p1{}, d0{}, d1{}, b0{}, b1{}, slope{}, bend{}, odd{}, step{}, before{};
    double value = -INF;
    // Legendre polynomials of two degrees with their first two derivatives, and what they sum up to.
    for (i64 turn_ = 0; turn_ < ITERATIONS; ++turn_) {
        p0 = 1.0;
        p1 = u;
        d0 = 0.0;
        d1 = 1.0;
        b0 = 0.0;
        b1 = 0.0;
        value = sign * (c(0) + c(1) * u);
        slope = sign * c(1);
        bend = 0.0;
        for (i64 k = 1, k_end = c.size() - 1; k < k_end; ++k) {
            odd = 2.0 * k + 1.0;
            {
                const double was1 = p1;
                const double was2 = (odd * u * p1 - k * p0) / (k + 1.0);
                const double was3 = d1;
                const double was4 = d0 + odd * p1;
                const double was5 = b1;
                const double was6 = b0 + odd * d1;
                p0 = was1;
                p1 = was2;
                d0 = was3;
                d1 = was4;
                b0 = was5;
                b1 = was6;
            }
            value = value + sign * c(k + 1) * p1;
            slope = slope + sign * c(k + 1) * d1;
            bend = bend + sign * c(k + 1) * b1;
        }
        step = (bend < 0.0) ? slope / bend : 0.0;
        before = u;
        u = least_of(greatest_of(u - step, -1.0), 1.0);
        if (std::fabs(u - before) < STANDS) {
            break;
        }
    }
    return value;
}

double greatest(Matrix c, Matrix fine, Vector grid, double sign) {
    Scope scope;
    i64 best{};
    Indices place = zeros<i64>(c.shape(0));
    Vector height = full<double>(-INF, c.shape(0));
    for (i64 p = 0; p < c.shape(0); ++p) {
        for (i64 k = 0; k < grid.size(); ++k) {
            if ((sign * fine(p, k)) > height(p)) {
                place(p) = k;
                height(p) = sign * fine(p, k);
            }
        }
    }
    double greatest = -INF;
    for (i64 turn_ = 0, turn__end = least_of<i64>(TRIED, c.shape(0)); turn_ < turn__end; ++turn_) {
        best = 0;
        for (i64 p = 0; p < c.shape(0); ++p) {
            if (height(p) > height(best)) {
                best = p;
            }
        }
        greatest = greatest_of(greatest_of(greatest, height(best)), top(c.row(best), grid(place(best)), sign));
        height(best) = -INF;
    }
    return greatest;
}

/// Greatest less least value of each signal: the best values on a grid, each refined by Newton's method.
///
/// Parameters
/// ----------
/// c : array, shape (signals, pieces, degrees)
///     Legendre coefficients.
/// fine : array, shape (signals, pieces, points)
///     The signals on the grid of each piece.
/// grid : array, shape (points,)
///     From -1 to 1.
/// out : array, shape (signals,)
///     Filled.
void spans(Matrices c, Matrices fine, Vector grid, Vector out) {
    // A least value is the greatest of the mirror image.
    for (i64 s = 0; s < out.shape(0); ++s) {
        out(s) = greatest(c.row(s), fine.row(s), grid, 1.0) + greatest(c.row(s), fine.row(s), grid, -1.0);
    }
}

}  // namespace extrema
}  // namespace EPP_ARCH
}  // namespace epp
