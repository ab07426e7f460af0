#pragma once
// Room for arrays of a call: taken one behind the other, given back all at once where a scope ends.

#include <algorithm>
#include <cstddef>
#include <memory>
#include <vector>

#include "complex.hpp"

namespace epp {
inline namespace EPP_ARCH {

/// Memory of one thread, which stays for its next calls.
class Arena {
  public:
    void* take(size_t bytes) {
        bytes = (bytes + 63) / 64 * 64;
        while (block < blocks.size() && used + bytes > blocks[block].size) {
            ++block;
            used = 0;
        }
        if (block == blocks.size()) {
            const size_t size = std::max<size_t>(bytes, size_t{1} << 16 << std::min<size_t>(block, 10));
            blocks.push_back({std::make_unique<std::byte[]>(size + 64), size});
            used = 0;
        }
        const auto first = reinterpret_cast<std::uintptr_t>(blocks[block].bytes.get());
        void* at = reinterpret_cast<void*>((first + 63) / 64 * 64 + used);
        used += bytes;
        return at;
    }
    static Arena& own() {
        static thread_local Arena arena;
        return arena;
    }

  private:
    friend class Scope;
    struct Block {
        std::unique_ptr<std::byte[]> bytes;
        size_t size;
    };
    std::vector<Block> blocks;
    size_t block = 0, used = 0;
};

/// Arrays that are made in a scope last as long as it does.
class Scope {
  public:
    Scope() : arena(Arena::own()), block(arena.block), used(arena.used) {}
    Scope(const Scope&) = delete;
    Scope& operator=(const Scope&) = delete;
    ~Scope() { arena.block = block, arena.used = used; }

  private:
    Arena& arena;
    size_t block, used;
};

/// An array of any numbers.
template <class T, size_t N> View<T, static_cast<int>(N)> empty_of(const std::array<i64, N>& lengths) {
    View<T, static_cast<int>(N)> out(nullptr, lengths);
    out.data = static_cast<T*>(Arena::own().take(static_cast<size_t>(std::max<i64>(out.size(), 1)) * sizeof(T)));
    return out;
}
template <class T, class... I> View<T, static_cast<int>(sizeof...(I))> empty(I... lengths) {
    return empty_of<T>(std::array<i64, sizeof...(I)>{static_cast<i64>(lengths)...});
}
template <class T, class V, class... I> View<T, static_cast<int>(sizeof...(I))> full(V value, I... lengths) {
    auto out = empty<T>(lengths...);
    for (T& one : out) one = value;
    return out;
}
template <class T, class... I> View<T, static_cast<int>(sizeof...(I))> zeros(I... lengths) { return full<T>(T{}, lengths...); }
/// 0, 1, 2, ...
inline View<i64, 1> counted(i64 n) {
    auto out = empty<i64>(n);
    for (i64 i = 0; i < n; ++i) out(i) = i;
    return out;
}
inline View<double, 2> identity(i64 n) {
    auto out = zeros<double>(n, n);
    for (i64 i = 0; i < n; ++i) out(i, i) = 1.0;
    return out;
}
template <class T> View<T, 1> array_of(std::initializer_list<T> numbers) {
    auto out = empty<T>(static_cast<i64>(numbers.size()));
    std::copy(numbers.begin(), numbers.end(), out.data);
    return out;
}
template <class T, int N, template <class, int> class Any> View<T, N> copy_of(const Any<T, N>& from) {
    auto out = empty_of<T>(from.lengths);
    out.copy(from);
    return out;
}

}  // namespace EPP_ARCH
}  // namespace epp
