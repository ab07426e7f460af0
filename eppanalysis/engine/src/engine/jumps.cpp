#include "engine/jumps.hpp"

namespace epp {
inline namespace EPP_ARCH {

/// Place of guard k in a mode combination.
i64 place_of(const Combinations& compiled, i64 q, i64 k) {
    for (i64 i = 0, i_end = compiled.n_guards(q); i < i_end; ++i) {
        if (compiled.guard(q, i) == k) {
            return i;
        }
    }
    return -1;
}

/// Size of the terms that an element's input is added up from.
double _input_size(const Combinations& compiled, i64 q, i64 row, Vector x, Vector recent, Vector H) {
    double size = 0.0;
    for (i64 i = 0, i_end = compiled.Zx.shape(2); i < i_end; ++i) {
        size += std::fabs(compiled.Zx(q, row, i)) * greatest_of(std::fabs(x(i)), recent(i));
    }
    for (i64 j = 0; j < H.size(); ++j) {
        size += std::fabs(compiled.ZH(q, row, j) * H(j));
    }
    return size;
}

/// Guard of a sticking mode that leads to the mode on the side to which its input has been thrown off the level.
i64 _way_off(const Model& model, i64 m, double off) {
    i64 e{}, beyond{};
    bool returns{};
    for (i64 k = model.guard_first(m), k_end = model.guard_first(m + 1); k < k_end; ++k) {
        e = model.guard_element(k);
        beyond = model.mode_first(e) + model.guard_target(k);
        // The side beyond a guard is the one from which a guard leads back here as the input comes down to the
        // level.
        for (i64 back = model.guard_first(beyond), back_end = model.guard_first(beyond + 1); back < back_end; ++back) {
            returns = (model.mode_first(e) + model.guard_target(back)) == m;
            if (returns && (model.guard_z(back, 0) * off) < 0.0) {
                return k;
            }
        }
    }
    return -1;
}

/// Guard by which an element in a mode lets go where its inputs jump from `before` to those in combination `new`.
i64 _letting_go(const Model& model, const Combinations& compiled, i64 e, i64 mode, Vector before, i64 new_, Vector x,
    Vector recent, Vector H, Matrix Sg, i64 last, double u) {
    double off{}, size{}, change{}, r{};
    i64 m = model.mode_first(e) + mode;
    i64 z0 = model.first(e, 0);
    if (!model.mode_lags(m)) {
        return -1;
    }
    // Held on a level, it is thrown off where the jump ends beyond it by more than rounding.
    if (model.mode_stick(m)) {
        off = input_at(compiled, new_, z0, x, H, Sg, last, u) - model.mode_level(m);
        size = _input_size(compiled, new_, z0, x, recent, H) + std::fabs(model.mode_level(m));
        return (std::fabs(off) > (CLEAR * size)) ? _way_off(model, m, off) : -1;
    }
    for (i64 k = model.guard_first(m), k_end = model.guard_first(m + 1); k < k_end; ++k) {
        const double was1 = 0.0;
        change = was1;
        size = was1;
        for (i64 a = 0, a_end = model.first(e + 1, 0) - z0; a < a_end; ++a) {
            r = model.guard_rate(k, a);
            if (r != 0.0) {
                change += r * (input_at(compiled, new_, z0 + a, x, H, Sg, last, u) - before(z0 + a));
                size += std::fabs(r) * (_input_size(compiled, new_, z0 + a, x, recent, H) + std::fabs(before(z0 + a)));
            }
        }
        // A jump has no rate: the guard on rates sees the way from the old value to the new one in its place.
        if (change > (CLEAR * size)) {
            return k;
        }
    }
    return -1;
}

/// Whether a guard on inputs, memory values and outputs is clearly above zero: a jump has passed it.
bool clearly_above(const Combinations& compiled, i64 q, i64 i, Vector x, Vector recent, Vector H, Matrix Sg, i64 last,
    double u) {
    double c{};
    if (compiled.on_rate(q, i)) {
        return false;
    }
    double v = dot(compiled.ga.row(q, i), x);
    double size = 0.0;
    for (i64 j = 0; j < x.size(); ++j) {
        size += compiled.ga_size(q, i, j) * greatest_of(std::fabs(x(j)), recent(j));
    }
    for (i64 j = 0; j < H.size(); ++j) {
        v += compiled.gH(q, i, j) * H(j);
        size += std::fabs(compiled.gH(q, i, j) * H(j));
    }
    for (i64 j = 0; j < Sg.shape(1); ++j) {
        c = compiled.gs(q, i, j);
        if (c != 0.0) {
            v += c * smooth_at(Sg, last, j, u);
            size += std::fabs(c * Sg(0, j));
        }
    }
    return v > (CLEAR * size);
}

/// A guard that a jump has passed, without any series; -1 when there is none.
i64 passed(const Combinations& compiled, i64 q, const Workspace& workspace) {
    for (i64 g = 0, g_end = compiled.n_guards(q); g < g_end; ++g) {
        // The sum first: what it is judged by costs more, and is wanted where it is positive alone.
        if (workspace.constant(g) + dot(compiled.ga.row(q, g), workspace.x) > 0.0 && clearly_above(compiled, q, g,
            workspace.x, workspace.recent, workspace.H, workspace.Sg, 0, 0.0)) {
            return g;
        }
    }
    return -1;
}

/// Place in combination q of a guard of an element that is clearly above zero; -1 for none.
i64 _passed(const Model& model, const Combinations& compiled, i64 q, i64 e, Vector x, Vector recent, Vector H,
    Matrix Sg, i64 last, double u) {
    for (i64 i = 0, i_end = compiled.n_guards(q); i < i_end; ++i) {
        if (model.guard_element(compiled.guard(q, i)) == e && clearly_above(compiled, q, i, x, recent, H, Sg, last,
            u)) {
            return i;
        }
    }
    return -1;
}

/// Guard of the first element along the cascade that a jump leaves behind; -1 when there is none.
i64 _left_behind(const Model& model, const Combinations& compiled, const Work& work, const Workspace& workspace, i64 q,
    i64 k, bool stays, Vector x, Vector beyond, Vector recent, Vector H, Matrix Sg, i64 last, double u, Indices modes,
    double base_step) {
    i64 i{}, g{};
    i64 source = (k >= 0) ? model.guard_element(k) : modes.size();
    Vector before = workspace.before;
    Vector new_x = workspace.then_x.row(1);
    Indices new_modes = workspace.then_modes;
    Vector new_H = workspace.then_H;
    for (i64 row = 0; row < before.size(); ++row) {
        before(row) = input_at(compiled, q, row, x, H, Sg, last, u);
    }
    take(new_x, beyond);
    for (i64 e = 0; e < modes.size(); ++e) {
        new_modes(e) = modes(e);
    }
    for (i64 i_at = 0; i_at < H.size(); ++i_at) {
        i = i_at;
        new_H(i) = H(i);
    }
    // All on copies: what the jump would do is tried to its end before anything is allowed to happen
    // (docs/theory/simulation.md, rules of a jump).
    i64 new_ = q;
    if (k >= 0) {
        i = place_of(compiled, q, k);
        new_ = switch_(model, compiled, work, q, i, stays, new_x, recent, new_H, Sg, last, u, new_modes, workspace.memory,
            base_step);
    }
    for (const auto& e : model.order) {
        if (new_ < 0) {
            return -1;
        }
        if (e != source && model.reach(source, e)) {
            g = _letting_go(model, compiled, e, modes(e), before, new_, new_x, recent, new_H, Sg, last, u);
            if (g >= 0) {
                return g;
            }
        }
        // Settled before those downstream are looked at; more passages than there are modes go in a circle.
        if (e == source || model.reach(source, e)) {
            for (i64 turn_ = 0, turn__end = 2 * model.mode_first(model.mode_first.shape(0) - 1) + 16;
                turn_ < turn__end; ++turn_) {
                i = _passed(model, compiled, new_, e, new_x, recent, new_H, Sg, last, u);
                if (i < 0) {
                    break;
                }
                new_ = switch_(model, compiled, work, new_, i, false, new_x, recent, new_H, Sg, last, u,
                    new_modes, workspace.memory, base_step);
                if (new_ < 0) {
                    return -1;
                }
            }
        }
    }
    return -1;
}

/// Let everything go that a jump will leave behind; returns the mode combination then, -1 for none, and the events
/// in all.
///
/// Parameters
/// ----------
/// k : int
///     Guard at whose event the jump takes place, -1 for a jump of external inputs.
/// stays : bool
///     Whether that guard stays on zero instead of rising.
/// x, beyond : arrays (n+,)
///     State, and that behind a jump of external inputs (the same otherwise).
/// last, u : int, float
///     Place on the series of the smooth channels.
/// kept : bool
///     Whether events are kept.
std::tuple<i64, i64> let_go(const Model& model, const Combinations& compiled, const Work& work,
    const Workspace& workspace, const EventBuffer& buffer, i64 q, i64 k, bool stays, Vector x, Vector beyond,
    Vector recent, Vector H, Matrix Sg, i64 last, double u, Indices modes, double base_step, double t, Vector rate, i64 count,
    bool kept) {
    i64 g{};
    i64 keep = buffer.t.size();
    // As above: more than there are modes go in a circle, which the guards are judged anew to leave.
    for (i64 turn_ = 0, turn__end = 2 * model.mode_first(model.mode_first.shape(0) - 1) + 16; q >= 0 && turn_ < turn__end;
        ++turn_) {
        g = _left_behind(model, compiled, work, workspace, q, k, stays, x, beyond, recent, H, Sg, last, u, modes,
            base_step);
        // The trial switches may have overwritten this mode combination in the table.
        q = find_combination(model, compiled, work, modes, base_step);
        if (g < 0 || q < 0) {
            break;
        }
        q = switch_(model, compiled, work, q, place_of(compiled, q, g), false, x, recent, H, Sg, last, u, modes,
            workspace.memory, base_step);
        if (kept) {
            buffer.t(modulo(count, keep)) = t;
            buffer.guard(modulo(count, keep)) = g;
            record(buffer, modulo(count, keep), x, rate, H, modes);
            count += 1;
        }
    }
    return {q, count};
}

}  // namespace EPP_ARCH
}  // namespace epp
