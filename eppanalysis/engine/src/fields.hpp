#pragma once
// Fields of the tables, in the order in which Python has them.

#include "structures.hpp"

namespace epp {
inline namespace EPP_ARCH {

/// Names of a table's fields, each behind the table's own, one after the other.
template <size_t count, size_t room> struct Names {
    char text[room]{};
    size_t begin[count]{};
    constexpr const char* operator[](size_t k) const { return text + begin[k]; }
};
constexpr size_t count_of(const char* fields) {
    size_t count = 1;
    for (; *fields != 0; ++fields) count += *fields == ',';
    return count;
}
template <size_t count, size_t length, size_t all>
constexpr auto names_of(const char (&table)[length], const char (&fields)[all]) {
    Names<count, all + count*(length + 1)> out{};
    size_t at = 0, from = 0;
    for (size_t k = 0; k < count; ++k) {
        out.begin[k] = at;
        for (size_t i = 0; i + 1 < length; ++i) out.text[at++] = table[i];
        out.text[at++] = '.';
        while (fields[from] == ' ') ++from;
        while (fields[from] != ',' && fields[from] != 0) out.text[at++] = fields[from++];
        out.text[at++] = 0;
        ++from;
    }
    return out;
}

template <class T> struct Fields;

/// What a table holds, by reference, and how that is called.
#define EPP_FIELDS(T, ...) EPP_FIELDS_OF(T, __VA_ARGS__)  // names of several are put in first
#define EPP_FIELDS_OF(T, ...)                                                                          \
    template <> struct Fields<T> {                                                                     \
        template <class Table> static auto of(Table& table_) {                                        \
            auto& [__VA_ARGS__] = table_;                                                              \
            return std::tie(__VA_ARGS__);                                                              \
        }                                                                                              \
        static constexpr size_t count = count_of(#__VA_ARGS__);                                        \
    };                                                                                                 \
    constexpr auto names_of_##T = names_of<Fields<T>::count>(#T, #__VA_ARGS__);                        \
    inline const char* name_of(const T*, size_t k) { return names_of_##T[k]; }

EPP_FIELDS(Chain, F, S, g, gs, J, smooth, at_once, free, shift, duration)
EPP_FIELDS(Met, time, guard, state, memory, modes)
EPP_FIELDS(Channels, smooth_kind, smooth_x, smooth_H, smooth_s, smooth_scale, sense)
EPP_FIELDS(Combinations, count, key, linear, step, rate, ready, M, M_twice, M_size, entries, row, row_end,
    spread_rate, far, y_entries, y_row, y_row_end, N, S, Wx, WH, Ws, Zx, ZH, Zs, Y, YH, Ys, n_guards, guard, next, ga,
    ga_count, ga_place, ga_size, gb, gb_size, on_rate, gH, gs, gt, smooth_guard, gf, gfH, all_gf, reach_gf, T, bound,
    longs, T_long, reach)
EPP_FIELDS(Curve, middle, half, base, places, coefficients)
EPP_FIELDS(Effort, most, sweep, series)
EPP_FIELDS(EventBuffer, t, guard, x, v, H, modes)
#define EPP_OF_A_MODEL \
    A, B, S, K, C, D, Kz, first, order, reach, mode_first, mode_wz, mode_wh, mode_ws, mode_w0, mode_stick, \
    mode_lags, mode_level, guard_first, guard_element, guard_target, guard_bypass, guard_on_threshold, guard_z, guard_rate, \
    guard_h, guard_w, guard_0, reset_z, reset_h, reset_0, guard_impulse, smooth_kind, smooth_x, smooth_H, \
    smooth_s, smooth_scale, smooth_w, smooth_delay, Yx, Yw, YH, breakpoint_time, breakpoint_state, \
    breakpoint_value, breakpoint_memory, breakpoint_slope
EPP_FIELDS(Model, EPP_OF_A_MODEL)
EPP_FIELDS(Models, EPP_OF_A_MODEL)
EPP_FIELDS(Motion, y, tau, starts, ends, A, r, speed, scale, rows)
EPP_FIELDS(Outcome, code, verdict, events, since, period, change, mean, low, high, rms, stop)
EPP_FIELDS(Pieces, edges, modes, memory, fired)
EPP_FIELDS(Plane, row, old, distance, slope, largest, longest)
EPP_FIELDS(Rules, from_input, from_memory, from_smooth, constant, smooth_kind, smooth_input, smooth_constant,
    smooth_scale, guard_mode, target, on_input, on_rate, on_memory, on_output, guard_constant, memory_from_input,
    memory_from_memory, memory_constant, start)
EPP_FIELDS(Samples, times, rows, out, phases, order, bins)
EPP_FIELDS(Table, roles, first, series, factor, constant, on_memory, on_clock, target, from_input, from_memory,
    memory_constant, on_free, on_rate, free_series, rate_series, w_free, w_rate, w_memory, w_constant)
EPP_FIELDS(Work, E, F, rate, inputs, signals, square, guards)
EPP_FIELDS(Workspace, X, Y, Z, Sg, arg, aux, p, still, x, modes, H, rate, low, high, largest, recent, spread, push,
    slope, speed, small, wide, one, memory, constant, lift, g0, g1, tol, stray, top, end, watch, line_t, line_h,
    line_c, line_n, behind_x, behind_modes, behind_H, behind_recent, once, then_x, then_modes, then_H, before)

/// One of several models.
inline Model one_of(const Models& all, i64 k) {
    return std::apply([&](const auto&... field) { return Model{field.row(k)...}; }, Fields<Models>::of(all));
}

}  // namespace EPP_ARCH
}  // namespace epp
