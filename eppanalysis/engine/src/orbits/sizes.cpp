#include "orbits/sizes.hpp"

namespace epp {
inline namespace EPP_ARCH {

namespace orbits_sizes {

/// Fill `rows` (m + p,) with the sizes of what must vanish: places `free` of y, and the guard that ends each arc.
///
/// Where an arc ends at once, or its guard sees nothing, that is its dwell time; where it begins on its own guard, the
/// mean rate of that (`at_once`: 1 and 2).
void sizes_of_residuals(Matrix g, Indices at_once, Indices free, Vector scale, double period, Vector rows) {
    double size{};
    i64 m = free.size();
    for (i64 k = 0; k < m; ++k) {
        rows(k) = scale(free(k));
    }
    for (i64 a = 0; a < g.shape(0); ++a) {
        size = 0.0;
        for (i64 j = 0; j < g.shape(1); ++j) {
            size += std::fabs(g(a, j)) * scale(j);
        }
        if (at_once(a) == 1 || size == 0.0) {
            size = period;
        } else if (at_once(a) == 2) {
            size /= period;
        }
        rows(m + a) = size;
    }
}

/// Fill `scale` (N,) with the size of the motion in each place of y; never zero.
///
/// Parameters
/// ----------
/// F : array (p, n, N)
///     Rates on the arcs.
/// starts, ends, inner : arrays (p + 1, N), (p, N), (k, N)
///     y behind and before the events, and half-way along some arcs.
/// tau : array (p,)
///     Dwell times.
void size_of_motion(Matrices F, Matrix starts, Matrix ends, Matrix inner, Vector tau, Vector scale) {
    double low{}, high{}, size{}, span{}, first{}, last{};
    i64 p = F.shape(0);
    i64 n = F.shape(1);
    i64 N = F.shape(2);
    for (i64 j = 0; j < N; ++j) {
        low = starts(0, j);
        high = starts(0, j);
        for (Matrix rows : {starts, ends, inner}) {
            for (i64 a = 0; a < rows.shape(0); ++a) {
                low = minimum(low, rows(a, j));
                high = maximum(high, rows(a, j));
            }
        }
        size = greatest_of(std::fabs(low), std::fabs(high));
        span = high - low;
        // What is fast comes back before the event: the way that it could go counts, too.
        if (j < n) {
            for (i64 a = 0; a < p; ++a) {
                first = 0.0;
                last = 0.0;
                for (i64 i = 0; i < N; ++i) {
                    first += F(a, j, i) * starts(a, i);
                    last += F(a, j, i) * ends(a, i);
                }
                span = maximum(span, 0.1 * std::fabs(tau(a)) * maximum(std::fabs(first), std::fabs(last)));
            }
        }
        scale(j) = (span > (1e-09 * size)) ? span : ((size > 0.0) ? size : 1.0);
    }
}

}  // namespace orbits_sizes
}  // namespace EPP_ARCH
}  // namespace epp
