#pragma once
// Arguments from Python, and results to it: arrays are looked at in place, by Python's buffer protocol.

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include <complex>
#include <functional>
#include <string>
#include <type_traits>
#include <vector>

#include "fields.hpp"

#ifndef EPP_MODULE
#define EPP_MODULE _native
#endif

namespace nb = nanobind;

namespace epp {
inline namespace EPP_ARCH {

template <class T> constexpr bool is_view = false;
template <class T, int N> constexpr bool is_view<View<T, N>> = true;
template <class T> constexpr bool is_tuple = false;
template <class... T> constexpr bool is_tuple<std::tuple<T...>> = true;

/// What one call takes from Python, and gives back.
class Call {
  public:
    Call() = default;
    Call(const Call&) = delete;
    Call& operator=(const Call&) = delete;

    template <class T> decltype(auto) take(nb::handle from, const char* name) {
        if constexpr (std::is_same_v<T, Progress>) {
            return progress(from, name);
        } else if constexpr (std::is_same_v<T, None>) {
            return None{};
        } else {
            T out{};
            put(from, name, out);
            return out;
        }
    }

    /// What a function gives, while other threads of Python run.
    template <class F> auto result(F&& function) {
        if constexpr (std::is_void_v<decltype(function())>) {
            {
                nb::gil_scoped_release others_run;
                function();
            }
            give_back();
            return nb::none();
        } else {
            auto out = [&] {
                nb::gil_scoped_release others_run;
                return function();
            }();
            give_back();
            return object(out);
        }
    }

  private:
    Scope scope;
    std::vector<std::function<void()>> copies;

    void give_back() {
        for (auto& copy : copies) copy();
    }

    static std::string said(const char* name) { return std::string("engine: ") + name; }

    void put(nb::handle from, const char* name, double& out) {
        out = PyFloat_AsDouble(from.ptr());
        if (out == -1.0 && PyErr_Occurred()) {
            PyErr_Clear();
            throw nb::type_error((said(name) + ": expected a number").c_str());
        }
    }
    void put(nb::handle from, const char* name, i64& out) {
        PyObject* whole = PyNumber_Index(from.ptr());
        if (whole == nullptr) {
            PyErr_Clear();
            throw nb::type_error((said(name) + ": expected a whole number").c_str());
        }
        out = PyLong_AsLongLong(whole);
        Py_DECREF(whole);
    }
    void put(nb::handle from, const char*, bool& out) { out = PyObject_IsTrue(from.ptr()) == 1; }

    template <class... T> void put(nb::handle from, const char* name, std::tuple<T...>& out) {
        PyObject* tuple = checked(from, name, sizeof...(T));
        Py_ssize_t k = 0;
        std::apply([&](auto&... one) { (put(PyTuple_GetItem(tuple, k++), name, one), ...); }, out);
    }

    template <class T, std::enable_if_t<std::is_class_v<T> && !is_view<T> && !is_tuple<T>, int> = 0>
    void put(nb::handle from, const char* name, T& out) {
        PyObject* tuple = checked(from, name, Fields<T>::count);
        size_t k = 0;
        auto one = [&](auto& field) {
            put(PyTuple_GetItem(tuple, static_cast<Py_ssize_t>(k)), name_of(&out, k), field);
            ++k;
        };
        std::apply([&](auto&... field) { (one(field), ...); }, Fields<T>::of(out));
    }
    /// Automata of several elements: the tables are in a tuple.
    void put(nb::handle from, const char* name, Automata& out) {
        PyObject* tuple = checked(from, name, 4);
        PyObject* tables = checked(PyTuple_GetItem(tuple, 0), "Automata.tables", -1);
        auto room = empty<Table>(static_cast<i64>(PyTuple_Size(tables)));
        for (i64 k = 0; k < room.size(); ++k) {
            new (&room(k)) Table{};
            put(PyTuple_GetItem(tables, k), "Automata.tables", room(k));
        }
        out.tables = View<const Table, 1>(room.data, room.lengths);
        put(PyTuple_GetItem(tuple, 1), "Automata.modes", out.modes);
        put(PyTuple_GetItem(tuple, 2), "Automata.clocked", out.clocked);
        put(PyTuple_GetItem(tuple, 3), "Automata.first", out.first);
    }

    static PyObject* checked(nb::handle from, const char* name, Py_ssize_t count) {
        if (!PyTuple_Check(from.ptr()) || (count >= 0 && PyTuple_Size(from.ptr()) != count))
            throw nb::type_error((said(name) + ": expected a tuple" + (count < 0 ? "" : " of " + std::to_string(count))).c_str());
        return from.ptr();
    }

    template <class T> static bool fits(const char* format) {
        const std::string f = format == nullptr ? "B" : format;
        if constexpr (std::is_same_v<T, double>) return f == "d";
        if constexpr (std::is_same_v<T, i64>) return f == "l" || f == "q";
        if constexpr (std::is_same_v<T, bool>) return f == "?";
        if constexpr (std::is_same_v<T, Complex>) return f == "Zd";
        return false;
    }
    template <class T> static constexpr const char* numbers() {
        if constexpr (std::is_same_v<T, double>) return "float64";
        if constexpr (std::is_same_v<T, i64>) return "int64";
        if constexpr (std::is_same_v<T, bool>) return "bool";
        return "complex128";
    }

    /// A view of an array, which who calls keeps alive; of one with gaps a copy, which is written back.
    template <class T, int N> void put(nb::handle from, const char* name, View<T, N>& out) {
        Py_buffer buffer;
        if (PyObject_GetBuffer(from.ptr(), &buffer, PyBUF_STRIDES | PyBUF_FORMAT) != 0) {
            PyErr_Clear();
            throw nb::type_error((said(name) + ": expected an array").c_str());
        }
        const bool good = buffer.ndim == N && buffer.itemsize == static_cast<Py_ssize_t>(sizeof(T)) && fits<T>(buffer.format);
        bool whole = true;
        if (good) {
            Strided<T, N> there;
            there.data = static_cast<T*>(buffer.buf);
            Py_ssize_t stride = sizeof(T);
            for (int k = N - 1; k >= 0; --k) {
                const size_t axis = static_cast<size_t>(k);
                there.lengths[axis] = buffer.shape[k];
                there.strides[axis] = buffer.strides[k] / static_cast<Py_ssize_t>(sizeof(T));
                whole = whole && (buffer.shape[k] <= 1 || buffer.strides[k] == stride);
                stride *= buffer.shape[k];
            }
            out = View<T, N>(there.data, there.lengths);
            if (!whole && out.size() > 0) {
                out = empty_of<T>(there.lengths);
                out.copy(there);
                if (!buffer.readonly) copies.push_back([=] { there.copy(out); });
            }
        }
        PyBuffer_Release(&buffer);
        if (!good)
            throw nb::type_error((said(name) + ": expected an array of " + numbers<T>() + " with " + std::to_string(N) + " axes").c_str());
    }

    /// The record of progress, in place.
    static Progress& progress(nb::handle from, const char* name) {
        Py_buffer buffer;
        nb::object data = nb::getattr(from, "data");
        if (PyObject_GetBuffer(data.ptr(), &buffer, PyBUF_SIMPLE) != 0) {
            PyErr_Clear();
            throw nb::type_error((said(name) + ": expected a record of PROGRESS").c_str());
        }
        void* there = buffer.buf;
        const bool good = buffer.len == static_cast<Py_ssize_t>(sizeof(Progress)) &&
                          reinterpret_cast<std::uintptr_t>(there) % alignof(Progress) == 0;
        PyBuffer_Release(&buffer);
        if (!good) throw nb::type_error((said(name) + ": expected a record of PROGRESS").c_str());
        return *static_cast<Progress*>(there);
    }

    static nb::object object(double a) { return nb::steal(PyFloat_FromDouble(a)); }
    static nb::object object(i64 a) { return nb::steal(PyLong_FromLongLong(a)); }
    static nb::object object(bool a) { return nb::steal(PyBool_FromLong(a)); }
    static nb::object object(Complex a) { return nb::steal(PyComplex_FromDoubles(a.real, a.imag)); }
    static nb::object object(None) { return nb::none(); }
    template <class... T> static nb::object object(const std::tuple<T...>& all) {
        return std::apply([](const auto&... one) -> nb::object { return nb::make_tuple(object(one)...); }, all);
    }
    static nb::object object(const Pieces& p) { return nb::make_tuple(object(p.edges), object(p.modes), object(p.memory), object(p.fired)); }
    template <class T, int N> static nb::object object(const View<T, N>& a) {
        using Number = std::conditional_t<std::is_same_v<T, Complex>, std::complex<double>, T>;
        T* numbers = new T[static_cast<size_t>(std::max<i64>(a.size(), 1))];
        std::copy(a.begin(), a.end(), numbers);
        nb::capsule owner(numbers, [](void* p) noexcept { delete[] static_cast<T*>(p); });
        size_t shape[N];
        for (size_t k = 0; k < static_cast<size_t>(N); ++k) shape[k] = static_cast<size_t>(a.lengths[k]);
        return nb::cast(nb::ndarray<nb::numpy, Number>(numbers, static_cast<size_t>(N), shape, owner));
    }
};

template <class> using Handle = nb::handle;
/// What an argument is taken as: all are values, views of arrays among them, but the record of progress.
template <class A> using Taken = std::conditional_t<std::is_same_v<A, Progress&>, A, std::decay_t<A>>;

template <class R, class... A, size_t... I>
auto called(R (*function)(A...), const std::array<const char*, sizeof...(A)>& names, std::index_sequence<I...>, Handle<A>... from) {
    Call call;
    std::tuple<Taken<A>...> all{call.take<std::decay_t<A>>(from, names[I])...};
    return call.result([&] { return std::apply(function, all); });
}

/// A function of the engine under its name in Python: what it takes is said by its types.
template <class R, class... A>
void bind(nb::module_& m, const char* name, R (*function)(A...), const std::array<const char*, sizeof...(A)>& names, const char* doc) {
    std::apply([&](auto... one) {
        m.def(name, [=](Handle<A>... from) { return called(function, names, std::index_sequence_for<A...>{}, from...); },
            nb::arg(one)..., doc);
    }, names);
}

/// One that is made for orbits without smooth channels, too: the first argument is None for them.
template <class R, class... A, class... B>
void bind(nb::module_& m, const char* name, R (*without)(A...), R (*with)(B...), const std::array<const char*, sizeof...(B)>& names,
    const char* doc) {
    std::apply([&](auto first, auto... one) {
        m.def(name, [=](nb::handle channels, Handle<decltype(one)>... from) {
            return channels.is_none() ? called(without, names, std::index_sequence_for<A...>{}, channels, from...)
                                      : called(with, names, std::index_sequence_for<B...>{}, channels, from...);
        }, nb::arg(first).none(), nb::arg(one).none()..., doc);
    }, names);
}

/// Parts of the engine, for its tests alone.
void parts(nb::module_& m);

}  // namespace EPP_ARCH
}  // namespace epp
