#pragma once
// Sums of rows, eight numbers at a time.
//
// All rows that come here have a length that is a multiple of eight, zero beyond what they hold. The order of every sum
// is fixed: each of the eight lanes adds up on its own, even and odd rows apart, lanes together by halves. So there are
// the same bits with vectors of any length and with none.

#include "arena.hpp"

#if defined(__SSE2__) && defined(__GNUC__)
#include <immintrin.h>
#endif

namespace epp {
inline namespace EPP_ARCH {

constexpr i64 VECTOR_SIZE = 8;

inline i64 padded(i64 n) { return (n + VECTOR_SIZE - 1) / VECTOR_SIZE * VECTOR_SIZE; }

#if defined(__GNUC__)
#define EPP_INLINE inline __attribute__((always_inline))
#else
#define EPP_INLINE inline
#endif

// Eight numbers are pairs of pairs down to what the machine holds in one register: eight with AVX-512, four with AVX, two
// with SSE2 or NEON, one in plain loops. (Vectors of 64 bytes on a machine with shorter ones GCC keeps in memory.)
#if defined(__GNUC__) && !defined(EPP_PLAIN)
#define EPP_VECTORS
#if defined(__AVX512F__)
constexpr int LANES = 8;
#elif defined(__AVX__)
constexpr int LANES = 4;
#else
constexpr int LANES = 2;
#endif
typedef double Register __attribute__((vector_size(8 * LANES)));
typedef double Anywhere __attribute__((vector_size(8 * LANES), aligned(8), may_alias));
typedef std::int64_t Mask __attribute__((vector_size(8 * LANES)));
#else
constexpr int LANES = 1;
using Register = double;
#endif

template <class Half> struct Pair {
    Half low, high;
};
template <int n> struct Lanes {
    using Type = Pair<typename Lanes<n / 2>::Type>;
};
template <> struct Lanes<LANES> {
    using Type = Register;
};
using Eight = Lanes<8>::Type;

template <class T> struct Of;

#ifdef EPP_VECTORS
template <> struct Of<Register> {
    static EPP_INLINE Register load(const double* at) { return *reinterpret_cast<const Anywhere*>(at); }
    static EPP_INLINE Register spread(double a) {
        Register out;
        for (int i = 0; i < LANES; ++i) out[i] = a;
        return out;
    }
    static constexpr int size = LANES;
};
EPP_INLINE void keep(double* at, Register a) { *reinterpret_cast<Anywhere*>(at) = a; }
EPP_INLINE Register size_of(Register a) {
    return (Register)((Mask)a & (Mask{} + std::numeric_limits<std::int64_t>::max()));
}
EPP_INLINE Register larger(Register a, Register b) { return a > b ? a : b; }
EPP_INLINE Register smaller(Register a, Register b) { return a < b ? a : b; }
EPP_INLINE Register zero_above(Register a, Register level) { return a > level ? Register{} : a; }
/// Bits of all ones where a is at most b; of what is no number nothing.
EPP_INLINE Mask at_most(Register a, Register b) { return a <= b; }
EPP_INLINE bool all(Mask m) {
    std::int64_t both = m[0];
    for (int i = 1; i < LANES; ++i) both &= m[i];
    return both != 0;
}
EPP_INLINE bool any(Mask m) {
    std::int64_t either = m[0];
    for (int i = 1; i < LANES; ++i) either |= m[i];
    return either != 0;
}
EPP_INLINE Register root(Register a) {
#if defined(__AVX512F__)
    return (Register)_mm512_sqrt_pd((__m512d)a);
#elif defined(__AVX__)
    return (Register)_mm256_sqrt_pd((__m256d)a);
#elif defined(__SSE2__)
    return (Register)_mm_sqrt_pd((__m128d)a);
#else
    for (int i = 0; i < LANES; ++i) a[i] = std::sqrt(a[i]);
    return a;
#endif
}
/// Sum of the lanes, by halves.
template <int n, class R> EPP_INLINE double sum_of(R a) {
    if constexpr (n == 2)
        return a[0] + a[1];
    else if constexpr (n == 4)
        return (a[0] + a[2]) + (a[1] + a[3]);
    else
        return ((a[0] + a[4]) + (a[2] + a[6])) + ((a[1] + a[5]) + (a[3] + a[7]));
}
EPP_INLINE double sum(Register a) { return sum_of<LANES>(a); }
#else
template <> struct Of<double> {
    static double load(const double* at) { return *at; }
    static double spread(double a) { return a; }
    static constexpr int size = 1;
};
inline void keep(double* at, double a) { *at = a; }
inline double size_of(double a) { return std::fabs(a); }
inline double larger(double a, double b) { return a > b ? a : b; }
inline double smaller(double a, double b) { return a < b ? a : b; }
inline double zero_above(double a, double level) { return a > level ? 0.0 : a; }
inline bool at_most(double a, double b) { return a <= b; }
inline bool all(bool b) { return b; }
inline bool any(bool b) { return b; }
inline double sum(double a) { return a; }
#endif

inline double root(double a) { return std::sqrt(a); }

template <class H> struct Of<Pair<H>> {
    static constexpr int size = 2 * Of<H>::size;
    static EPP_INLINE Pair<H> load(const double* at) { return {Of<H>::load(at), Of<H>::load(at + Of<H>::size)}; }
    static EPP_INLINE Pair<H> spread(double a) { return {Of<H>::spread(a), Of<H>::spread(a)}; }
};
template <class H> EPP_INLINE Pair<H> operator+(Pair<H> a, Pair<H> b) { return {a.low + b.low, a.high + b.high}; }
template <class H> EPP_INLINE Pair<H> operator-(Pair<H> a, Pair<H> b) { return {a.low - b.low, a.high - b.high}; }
template <class H> EPP_INLINE Pair<H> operator*(Pair<H> a, Pair<H> b) { return {a.low * b.low, a.high * b.high}; }
template <class H> EPP_INLINE void keep(double* at, Pair<H> a) {
    keep(at, a.low);
    keep(at + Of<H>::size, a.high);
}
template <class H> EPP_INLINE Pair<H> size_of(Pair<H> a) { return {size_of(a.low), size_of(a.high)}; }
template <class H> EPP_INLINE Pair<H> larger(Pair<H> a, Pair<H> b) { return {larger(a.low, b.low), larger(a.high, b.high)}; }
template <class H> EPP_INLINE Pair<H> smaller(Pair<H> a, Pair<H> b) { return {smaller(a.low, b.low), smaller(a.high, b.high)}; }
template <class H> EPP_INLINE Pair<H> zero_above(Pair<H> a, Pair<H> level) {
    return {zero_above(a.low, level.low), zero_above(a.high, level.high)};
}
template <class H> EPP_INLINE auto at_most(Pair<H> a, Pair<H> b) { return at_most(a.low, b.low) & at_most(a.high, b.high); }
template <class H> EPP_INLINE double sum(Pair<H> a) { return sum(a.low + a.high); }

EPP_INLINE Eight load(const double* at) { return Of<Eight>::load(at); }
EPP_INLINE Eight spread(double a) { return Of<Eight>::spread(a); }
/// What is above zero of each number.
EPP_INLINE Eight positive(Eight a) { return larger(a, Eight{}); }

using Row = View<double, 1>;
using Rows = View<double, 2>;

template <bool from>
EPP_INLINE void row_sum_in(const double* start, const Rows& rows, const Row& weights, double scale, const Row& out) {
    const i64 width = rows.shape(1), count = weights.size(), length = out.size();
    EPP_CHECK(count <= rows.shape(0) && length <= width && length % VECTOR_SIZE == 0 && count % VECTOR_SIZE == 0);
    for (i64 column = 0; column < length; column += VECTOR_SIZE) {
        // Even and odd rows apart: one sum alone would wait for its own last addition at every row.
        Eight even = from ? load(start + column) : Eight{}, odd{};
        const double* at = rows.data + column;
        for (i64 first = 0; first < count; first += VECTOR_SIZE)
            for (i64 r = first; r < first + VECTOR_SIZE; r += 2, at += 2 * width) {
                even = spread(weights.data[r]) * load(at) + even;
                odd = spread(weights.data[r + 1]) * load(at + width) + odd;
            }
        keep(out.data + column, spread(scale) * (even + odd));
    }
}

/// out = scale * weights @ rows, with as many columns as `out` has.
EPP_INLINE void row_sum(Rows rows, Row weights, double scale, Row out) {
    row_sum_in<false>(nullptr, rows, weights, scale, out);
}
/// out = scale * (start + weights @ rows).
EPP_INLINE void row_sum_from(Row start, Rows rows, Row weights, double scale, Row out) {
    row_sum_in<true>(start.data, rows, weights, scale, out);
}

template <bool from, bool sizes>
EPP_INLINE void sparse_sum_in(const double* start, Rows entries, View<i64, 1> rows, View<i64, 1> ends, Row weights,
                             double scale, Row out) {
    i64 k = 0;
    for (i64 column = 0, block = 0; column < out.size(); column += VECTOR_SIZE, ++block) {
        Eight sums[4]{};
        if (from) sums[0] = load(start + column);
        for (; k < ends(block); k += 4)
            for (int r = 0; r < 4; ++r) {
                Eight values = load(entries.data + (k + r) * VECTOR_SIZE);
                if (sizes) values = size_of(values);
                sums[r] = spread(weights(rows(k + r))) * values + sums[r];
            }
        keep(out.data + column, spread(scale) * ((sums[0] + sums[1]) + (sums[2] + sums[3])));
    }
}
/// As `row_sum`, of a matrix that is kept by its rows of eight numbers that are not zero, four at a time.
EPP_INLINE void sparse_sum(Rows entries, View<i64, 1> rows, View<i64, 1> ends, Row weights, double scale, Row out) {
    sparse_sum_in<false, false>(nullptr, entries, rows, ends, weights, scale, out);
}
EPP_INLINE void sparse_sum_from(Row start, Rows entries, View<i64, 1> rows, View<i64, 1> ends, Row weights,
                               double scale, Row out) {
    sparse_sum_in<true, false>(start.data, entries, rows, ends, weights, scale, out);
}
EPP_INLINE void sparse_size_sum(Rows entries, View<i64, 1> rows, View<i64, 1> ends, Row weights, double scale, Row out) {
    sparse_sum_in<false, true>(nullptr, entries, rows, ends, weights, scale, out);
}

/// Set a row from its old values and those of others, place by place.
template <class F> EPP_INLINE void each(Row out, F&& f) {
    for (i64 i = 0; i < out.size(); i += VECTOR_SIZE) keep(out.data + i, f(i));
}
EPP_INLINE void add(Row out, Row a) {
    each(out, [&](i64 i) { return load(out.data + i) + load(a.data + i); });
}
EPP_INLINE void take(Row out, Row a) {
    each(out, [&](i64 i) { return load(a.data + i); });
}
EPP_INLINE void take_sizes(Row out, Row a) {
    each(out, [&](i64 i) { return size_of(load(a.data + i)); });
}
EPP_INLINE void add_sizes(Row out, Row a, double scale) {
    each(out, [&](i64 i) { return spread(scale) * size_of(load(a.data + i)) + load(out.data + i); });
}
EPP_INLINE void take_larger(Row out, Row a, Row b) {
    each(out, [&](i64 i) { return larger(size_of(load(a.data + i)), load(b.data + i)); });
}
EPP_INLINE void lower_to(Row out, Row a) {
    each(out, [&](i64 i) { return smaller(load(a.data + i), load(out.data + i)); });
}
EPP_INLINE void raise_to(Row out, Row a) {
    each(out, [&](i64 i) { return larger(load(a.data + i), load(out.data + i)); });
}

/// Whether all curves that stray from a cubic by so much at most stay below zero; not, where one is not a number.
EPP_INLINE bool cubics_below(Row start, Row start_rate, Row step, Row end_rate, double third, Row noise, Row stray) {
    for (i64 i = 0; i < start.size(); i += VECTOR_SIZE) {
        const Eight a = load(start.data + i), tol = load(noise.data + i), level = spread(0.0) - tol;
        const Eight b = a + load(step.data + i), rise = spread(third) * load(start_rate.data + i);
        const Eight fall = spread(third) * load(end_rate.data + i), first = zero_above(a, level);
        const Eight middle = spread(0.5) * ((first + rise) + (b - fall));
        const auto low = at_most(a, tol) & at_most(first + spread(0.75) * rise, level) &
                         at_most(middle + spread(8.0 / 3.0) * load(stray.data + i), level) &
                         at_most(b - spread(0.75) * fall, level) & at_most(b, level);
        if (!all(low)) return false;
    }
    return true;
}

EPP_INLINE double dot(Row a, Row b) {
    Eight total{};
    for (i64 i = 0; i < a.size(); i += VECTOR_SIZE) total = load(a.data + i) * load(b.data + i) + total;
    return sum(total);
}
/// Sum of the positive ones among the products.
EPP_INLINE double rises(Row a, Row b) {
    Eight total{};
    for (i64 i = 0; i < a.size(); i += VECTOR_SIZE) total = total + positive(load(a.data + i) * load(b.data + i));
    return sum(total);
}
/// Sum of terms[k] u^k, and of k terms[k] u^k.
EPP_INLINE std::tuple<double, double> value_and_slope(Row terms, double u) {
    const double u2 = u * u, u4 = u2 * u2, u8 = u4 * u4;
    // Lane k holds ((1 * u^(bit 0)) * u^2^(bit 1)) * u^4^(bit 2).
    const double p[8] = {1.0, u, u2, u * u2, u4, u * u4, u2 * u4, (u * u2) * u4};
    const double k[8] = {0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0};
    const Eight powers = load(p), lanes = load(k), step = spread(u8);
    Eight value{}, slope{};
    for (i64 place = terms.size() - VECTOR_SIZE; place >= 0; place -= VECTOR_SIZE) {
        const Eight now = load(terms.data + place), counts = spread(double(place)) + lanes;
        value = value * step + now;
        slope = slope * step + now * counts;
    }
    return {sum(value * powers), sum(slope * powers)};
}
/// out = sum of rows[k] u^k up to k = last (2 or more), its even and its odd terms beside each other.
EPP_INLINE void polynomial(Rows rows, i64 last, double u, Row out) {
    const i64 width = rows.shape(1);
    EPP_CHECK(last >= 0 && last < rows.shape(0));
    const Eight at = spread(u), square = spread(u * u);
    for (i64 column = 0; column < out.size(); column += VECTOR_SIZE) {
        const double* top = rows.data + column;
        Eight upper = load(top + last * width), lower = load(top + (last - 1) * width);
        for (i64 k = last - 2; k > 0; k -= 2) {
            upper = upper * square + load(top + k * width);
            lower = lower * square + load(top + (k - 1) * width);
        }
        keep(out.data + column, last % 2 == 0 ? lower * at + (upper * square + load(top)) : upper * at + lower);
    }
}
/// out = sum of the sizes of rows[1] to rows[last].
EPP_INLINE void size_sum(Rows rows, i64 last, Row out) {
    for (i64 column = 0; column < out.size(); column += VECTOR_SIZE) {
        Eight total{};
        for (i64 k = 1; k <= last; ++k) total = total + size_of(load(rows.data + k * rows.shape(1) + column));
        keep(out.data + column, total);
    }
}
/// Whether the size of any number of a row, times a positive scale, is above its limit, or is none.
EPP_INLINE bool any_above(Row row, double scale, Row limits) {
    for (i64 i = 0; i < row.size(); i += VECTOR_SIZE)
        if (!all(at_most(spread(scale) * size_of(load(row.data + i)), load(limits.data + i)))) return true;
    return false;
}

}  // namespace EPP_ARCH
}  // namespace epp
