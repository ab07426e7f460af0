#pragma once
// Views of numpy arrays, and the few rules of Python's arithmetic that the engine relies on.
//
// A view is an address and its lengths; who has the array keeps it alive. With EPP_CHECKED every access is checked.

#include <array>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <initializer_list>
#include <limits>
#include <tuple>
#include <type_traits>

// All code that does arithmetic is in a namespace of its instruction set, so that two builds of it fit into one
// process, and none takes an inline function of the other.
#ifndef EPP_ARCH
#define EPP_ARCH baseline
#endif

namespace epp {

using i64 = std::int64_t;
constexpr double INF = std::numeric_limits<double>::infinity(), NaN = std::numeric_limits<double>::quiet_NaN();
constexpr double PI = 3.141592653589793;

inline namespace EPP_ARCH {

#ifdef EPP_CHECKED
[[noreturn]] inline void broken(const char* file, int line, const char* what) {
    std::fprintf(stderr, "%s:%d: %s\n", file, line, what);
    std::abort();
}
#define EPP_CHECK(what) ((what) ? (void)0 : broken(__FILE__, __LINE__, #what))
#else
#define EPP_CHECK(what) ((void)0)
#endif

/// An argument that is left out.
struct None {};

/// Part of an axis, and all of it, where a view is cut.
struct Span {
    i64 first, stop;
};
struct All {};
constexpr All ALL{};

using std::size_t;

/// What views of one rank have in common: the places follow from `Self::stride`.
template <class T, int N, class Self> struct Basic {
    std::array<i64, static_cast<size_t>(N)> lengths{};

    i64 shape(i64 k) const { return lengths[static_cast<size_t>(k)]; }
    i64 size() const {
        i64 all = 1;
        for (i64 n : lengths) all *= n;
        return all;
    }
    template <class V> void fill(V value) const {
        const Self& self = static_cast<const Self&>(*this);
        for (i64 i = 0; i < lengths[0]; ++i) {
            if constexpr (N == 1)
                self(i) = value;
            else
                self.row(i).fill(value);
        }
    }
    template <class Other> void copy(const Other& from) const {
        EPP_CHECK(from.lengths == lengths);
        const Self& self = static_cast<const Self&>(*this);
        for (i64 i = 0; i < lengths[0]; ++i) {
            if constexpr (N == 1)
                self(i) = from(i);
            else
                self.row(i).copy(from.row(i));
        }
    }
    template <class Other> void add(const Other& from) const {
        EPP_CHECK(from.lengths == lengths);
        const Self& self = static_cast<const Self&>(*this);
        for (i64 i = 0; i < lengths[0]; ++i) {
            if constexpr (N == 1)
                self(i) += from(i);
            else
                self.row(i).add(from.row(i));
        }
    }
    template <class F> bool any(F&& holds) const {
        const Self& self = static_cast<const Self&>(*this);
        for (i64 i = 0; i < lengths[0]; ++i) {
            if constexpr (N == 1) {
                if (holds(self(i))) return true;
            } else if (self.row(i).any(holds)) {
                return true;
            }
        }
        return false;
    }
};

/// An array some of whose axes have strides of their own.
template <class T, int N> struct Strided : Basic<T, N, Strided<T, N>> {
    T* data = nullptr;
    std::array<i64, static_cast<size_t>(N)> strides{};

    template <class... I> T& operator()(I... index) const {
        static_assert(sizeof...(I) == N && (std::is_integral_v<I> && ...), "one whole number for each axis");
        i64 at = 0;
        size_t axis = 0;
        ((EPP_CHECK(index >= 0 && index < this->lengths[axis]), at += static_cast<i64>(index) * strides[axis], ++axis), ...);
        return data[at];
    }
    template <class... I> Strided<T, N - static_cast<int>(sizeof...(I))> row(I... index) const {
        constexpr size_t gone = sizeof...(I);
        Strided<T, N - static_cast<int>(gone)> out;
        i64 at = 0;
        size_t axis = 0;
        ((EPP_CHECK(index >= 0 && index < this->lengths[axis]), at += static_cast<i64>(index) * strides[axis], ++axis), ...);
        for (size_t k = 0; k < out.lengths.size(); ++k) {
            out.lengths[k] = this->lengths[gone + k];
            out.strides[k] = strides[gone + k];
        }
        out.data = data + at;
        return out;
    }
    template <class... I> auto cut(I... index) const {
        constexpr int left = N - (0 + ... + static_cast<int>(std::is_integral_v<I>));
        Strided<T, left> out;
        out.data = data;
        size_t axis = 0, into = 0;
        ((take(out, axis, into, index)), ...);
        return out;
    }

  private:
    template <class Out> void take(Out& out, size_t& axis, size_t&, i64 index) const {
        EPP_CHECK(index >= 0 && index < this->lengths[axis]);
        out.data += index * strides[axis++];
    }
    template <class Out> void take(Out& out, size_t& axis, size_t& into, Span part) const {
        EPP_CHECK(part.first >= 0 && part.stop <= this->lengths[axis]);
        out.data += part.first * strides[axis];
        out.lengths[into] = part.stop > part.first ? part.stop - part.first : 0;
        out.strides[into++] = strides[axis++];
    }
    template <class Out> void take(Out& out, size_t& axis, size_t& into, All) const {
        out.lengths[into] = this->lengths[axis];
        out.strides[into++] = strides[axis++];
    }
};

/// An array without gaps.
template <class T, int N> struct View : Basic<T, N, View<T, N>> {
    T* data = nullptr;

    View() = default;
    View(T* data, std::array<i64, static_cast<size_t>(N)> lengths) : data(data) { this->lengths = lengths; }

    operator Strided<T, N>() const {
        Strided<T, N> out;
        out.data = data;
        out.lengths = this->lengths;
        i64 stride = 1;
        for (size_t k = static_cast<size_t>(N); k-- > 0;) {
            out.strides[k] = stride;
            stride *= this->lengths[k];
        }
        return out;
    }
    T* begin() const { return data; }
    T* end() const { return data + this->size(); }

    /// One number.
    template <class... I> T& operator()(I... index) const {
        static_assert(sizeof...(I) == N, "one index for each axis");
        static_assert((std::is_integral_v<I> && ...), "whole numbers");
        return data[place(static_cast<i64>(index)...)];
    }
    /// What is behind the first indices.
    template <class... I> View<T, N - static_cast<int>(sizeof...(I))> row(I... index) const {
        constexpr int left = N - static_cast<int>(sizeof...(I));
        View<T, left> out;
        i64 stride = 1;
        for (int k = 0; k < left; ++k) {
            out.lengths[static_cast<size_t>(k)] = this->lengths[static_cast<size_t>(N - left + k)];
            stride *= out.lengths[static_cast<size_t>(k)];
        }
        out.data = data + place(static_cast<i64>(index)...) * stride;
        return out;
    }
    /// The rows, or numbers, from one place on, up to another.
    View slice(i64 first, i64 stop) const {
        EPP_CHECK(first >= 0 && stop <= this->lengths[0]);
        View out = *this;
        i64 stride = 1;
        for (size_t k = 1; k < static_cast<size_t>(N); ++k) stride *= this->lengths[k];
        out.data = data + first * stride;
        out.lengths[0] = stop > first ? stop - first : 0;
        return out;
    }
    template <class... I> auto cut(I... index) const { return Strided<T, N>(*this).cut(index...); }
    /// The same numbers in another shape.
    template <size_t M> View<T, static_cast<int>(M)> reshape(const std::array<i64, M>& lengths) const {
        View<T, static_cast<int>(M)> out(data, lengths);
        EPP_CHECK(out.size() == this->size());
        return out;
    }

  private:
    template <class... I> i64 place(I... index) const {
        i64 at = 0;
        size_t axis = 0;
        ((EPP_CHECK(index >= 0 && index < this->lengths[axis]), at = at * this->lengths[axis] + index, ++axis), ...);
        return at;
    }
};

/// Of two numbers the second where it is greater: a first one that is not a number stays, a second one never comes.
template <class T> inline T greatest_of(T a, T b) { return b > a ? b : a; }
template <class T> inline T least_of(T a, T b) { return b < a ? b : a; }
/// Of two numbers the greater, the smaller one, or that which is none.
inline double maximum(double a, double b) { return std::isnan(a) ? a : std::isnan(b) ? b : a >= b ? a : b; }
inline double minimum(double a, double b) { return std::isnan(a) ? a : std::isnan(b) ? b : a <= b ? a : b; }

/// Towards minus infinity, as Python divides.
inline i64 floor_div(i64 a, i64 b) {
    const i64 q = a / b;
    return q - (a % b != 0 && (a < 0) != (b < 0));
}
inline i64 modulo(i64 a, i64 b) {
    const i64 r = a % b;
    return r != 0 && (r < 0) != (b < 0) ? r + b : r;
}
inline double modulo(double a, double b) {
    const double r = std::fmod(a, b);
    if (r == 0.0) return b < 0.0 ? -0.0 : 0.0;
    return (b < 0.0) != (r < 0.0) ? r + b : r;
}

/// A whole power by squaring.
inline double whole_power(double a, i64 n) {
    double out = 1.0;
    for (i64 left = n < 0 ? -n : n; left != 0; left >>= 1) {
        if (left & 1) out *= a;
        a *= a;
    }
    return n < 0 ? 1.0 / out : out;
}

/// Sum of a row from its first number on.
inline double sum_of(View<double, 1> a) {
    double total = 0.0;
    for (double one : a) total += one;
    return total;
}

/// Where a number would be put into an ascending row: before those that equal it, or behind.
inline i64 searchsorted(View<double, 1> a, double value) {
    i64 low = 0, high = a.size();
    while (low < high) {
        const i64 middle = low + ((high - low) >> 1);
        if (a(middle) < value || (std::isnan(value) && !std::isnan(a(middle))))
            low = middle + 1;
        else
            high = middle;
    }
    return low;
}
inline i64 searchsorted_right(View<double, 1> a, double value) {
    i64 low = 0, high = a.size();
    while (low < high) {
        const i64 middle = low + ((high - low) >> 1);
        if (a(middle) <= value || std::isnan(value))
            low = middle + 1;
        else
            high = middle;
    }
    return low;
}

}  // namespace EPP_ARCH
}  // namespace epp
