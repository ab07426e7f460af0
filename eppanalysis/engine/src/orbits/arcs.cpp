#include "orbits/arcs.hpp"

namespace epp {
inline namespace EPP_ARCH {

namespace orbits_arcs {

/// Rate of the state in a mode combination: on y, F (n, N), and on the smooth channels, S (n, s).
void rates_of(const Combinations& compiled, i64 q, Matrix F, Matrix S) {
    i64 n = F.shape(0);
    for (i64 i = 0; i < n; ++i) {
        for (i64 j = 0; j < n; ++j) {
            F(i, j) = compiled.M(q, j, i);
        }
        filling::fill(F.row(i).slice(n, F.shape(1)), compiled.N.row(q, i));
        filling::fill(S.row(i), compiled.S.row(q, i));
    }
}

/// Whether a smooth channel acts on rates or guard; fill `sense` (s,), the sign of the argument of each.
bool is_smooth(const Model& model, Indices modes, Matrix S, Vector gs, Vector sense) {
    bool acts = false;
    // The weight with which a slipping mode lets the function act has the sign of its velocity, which at breakaway is
    // zero and tells nothing.
    for (i64 j = 0; j < gs.size(); ++j) {
        sense(j) = 1.0;
        for (i64 e = 0; e < modes.size(); ++e) {
            if (model.mode_ws(model.mode_first(e) + modes(e), 0, j) < 0.0) {
                sense(j) = -1.0;
            }
        }
        if (model.smooth_kind(j) != DELAY_LINE && (gs(j) != 0.0 || S.cut(ALL, j).any([&](auto one) { return one != 0.0; }))) {
            acts = true;
        }
    }
    return acts;
}

/// Row of a guard on y and on the smooth channels, rates put in.
i64 guard_rows(const Model& model, const Combinations& compiled, i64 q, i64 guard, Vector g, Vector gs) {
    i64 n = model.A.shape(0);
    for (i64 k = 0, k_end = compiled.n_guards(q); k < k_end; ++k) {
        if (compiled.guard(q, k) != guard) {
            continue;
        }
        filling::fill(g.slice(0, n), compiled.gf.row(q, k));
        filling::fill(g.slice(n, g.shape(0)), compiled.gfH.row(q, k));
        for (i64 j = 0; j < gs.size(); ++j) {
            if (compiled.gt(q, k, j) != 0.0) {
                return UNSUPPORTED;
            }
            gs(j) = compiled.gs(q, k, j);
            for (i64 i = 0; i < n; ++i) {
                gs(j) += compiled.gb(q, k, i) * compiled.S(q, i, j);
            }
        }
        return READY;
    }
    return NOT_A_GUARD;
}

/// Let the event map J end with ``c x + on_memory H = level``.
void level_map(Matrix J, Vector c, Vector on_memory, double level, Strided<double, 1> b) {
    Scope scope;
    i64 n = c.size();
    i64 N = J.shape(0);
    Vector left = zeros<double>(N);
    left(N - 1) = -level;
    i64 alone = -1;
    i64 count = 0;
    double scale = 0.0;
    for (i64 i = 0; i < n; ++i) {
        if (c(i) != 0.0) {
            alone = i;
            count = count + 1;
            scale += c(i) * b(i);
        }
    }
    // What misses the level behind the event is taken off along b, the direction in which the element acts, or off the
    // one state that is the input: as the engine settles it (`settle_on_level`).
    for (i64 j = 0; j < on_memory.size(); ++j) {
        if (on_memory(j) != 0.0) {
            filling::accumulate(left, on_memory(j), J.row(n + j));
        }
    }
    if (count == 1) {
        for (i64 j = 0; j < N; ++j) {
            J(alone, j) = -left(j) / c(alone);
        }
        return;
    }
    for (i64 i = 0; i < n; ++i) {
        if (c(i) != 0.0) {
            filling::accumulate(left, c(i), J.row(i));
        }
    }
    for (i64 i = 0; i < n; ++i) {
        if (b(i) != 0.0) {
            filling::accumulate(J.row(i), -b(i) / scale, left);
        }
    }
}

/// Memory values and the state after the event; then the input of a sticking element is put on its level.
i64 event_map(const Model& model, const Combinations& compiled, i64 q, i64 guard, Indices after, Matrix J) {
    Vector row{};
    double c{};
    i64 n = model.A.shape(0);
    i64 n_H = model.K.shape(1);
    i64 e = model.guard_element(guard);
    i64 z0 = model.first(e, 0);
    i64 w0 = model.first(e, 1);
    i64 h0 = model.first(e, 2);
    for (i64 a = 0, a_end = model.first(e + 1, 2) - h0; a < a_end; ++a) {
        row = J.row(n + h0 + a);
        row.fill(0.0);
        row(n + n_H - 1) = model.reset_0(guard, a);
        for (i64 b = 0, b_end = model.first(e + 1, 2) - h0; b < b_end; ++b) {
            row(n + h0 + b) += model.reset_h(guard, a, b);
        }
        for (i64 b = 0, b_end = model.first(e + 1, 0) - z0; b < b_end; ++b) {
            c = model.reset_z(guard, a, b);
            if (c != 0.0) {
                if (compiled.Zs.row(q, z0 + b).any([&](auto one) { return one != 0.0; })) {
                    return UNSUPPORTED;
                }
                filling::accumulate(row.slice(0, n), c, compiled.Zx.row(q, z0 + b));
                filling::accumulate(row.slice(n, row.shape(0)), c, compiled.ZH.row(q, z0 + b));
            }
        }
    }
    for (i64 b = 0, b_end = model.first(e + 1, 0) - z0; b < b_end; ++b) {
        c = model.guard_impulse(guard, b);
        if (c != 0.0) {
            if (compiled.Zs.row(q, z0 + b).any([&](auto one) { return one != 0.0; })) {
                return UNSUPPORTED;
            }
            for (i64 i = 0; i < n; ++i) {
                if (model.B(i, w0) != 0.0) {
                    filling::accumulate(J.row(i).slice(0, n), c * model.B(i, w0), compiled.Zx.row(q, z0 + b));
                    filling::accumulate(J.row(i).slice(n, J.shape(1)), c * model.B(i, w0), compiled.ZH.row(q, z0 + b));
                }
            }
        }
    }
    // As the engine settles it behind the event, so that both have the same map. The input is before the event what it is
    // behind it: the element itself does not act straight on it.
    i64 m = model.mode_first(e) + after(e);
    if (model.mode_stick(m)) {
        level_map(J, compiled.Zx.row(q, z0), compiled.ZH.row(q, z0), model.mode_level(m), model.B.cut(ALL, w0));
    }
    return READY;
}

/// Fill the arrays of an orbit's arcs from the modes on them and the guards that end them.
///
/// Parameters
/// ----------
/// model, compiled, work : Model, Combinations, Work
///     Mode combinations that runs with steps of `base_step` have met are compiled already.
/// modes, guards, timing : int arrays (p, E), (p,), (p,)
///     Modes on each arc; number of the guard at its end, -1 for none, and of the guard that tells when that is.
/// F, S : arrays (p, n, N), (p, n, s)
///     Rate of the state.
/// g, gs : arrays (p, N), (p, s)
///     Guard.
/// J : array (p, N, N)
///     Map of the event.
/// smooth : int array (p,)
///     Whether a smooth channel acts.
/// sense : array (p, s)
///     Sign of the argument of each smooth channel on each arc, where its element slips (friction).
/// Y, Ys : arrays (p, y, N), (p, y, s)
///     Signals.
/// W : array (p, w, N)
///     Outputs of the elements, but for smooth channels.
///
/// Returns
/// -------
/// int
///     READY, or why the arcs cannot be had.
i64 build_arcs(const Model& model, const Combinations& compiled, const Work& work, double base_step, IndexMatrix modes,
    Indices guards, Indices timing, Matrices F, Matrices S, Matrix g, Matrix gs, Matrices J, Indices smooth,
    Matrix sense, Matrices Y, Matrices Ys, Matrices W) {
    Scope scope;
    i64 q{}, code{};
    i64 n = model.A.shape(0);
    i64 n_s = model.S.shape(1);
    i64 n_H = model.K.shape(1);
    for (i64 a = 0; a < guards.size(); ++a) {
        q = epp::find_combination(model, compiled, work, modes.row(a), base_step);
        if (q < 0) {
            return SINGULAR;
        }
        rates_of(compiled, q, F.row(a), S.row(a));
        for (i64 i = 0; i < Y.shape(1); ++i) {
            for (i64 j = 0; j < n; ++j) {
                Y(a, i, j) = compiled.Y(q, j, i);
            }
            filling::fill(Y.row(a, i).slice(n, Y.shape(2)), compiled.YH.row(q, i));
            filling::fill(Ys.row(a, i), compiled.Ys.row(q, i));
        }
        filling::fill_rows(W.cut(a, ALL, Span{0, n}), compiled.Wx.row(q));
        filling::fill_rows(W.cut(a, ALL, Span{n, W.shape(2)}), compiled.WH.row(q));
        filling::fill_rows(J.row(a), identity(n + n_H));
        g.row(a).fill(0.0);
        gs.row(a).fill(0.0);
        if (guards(a) >= 0) {
            code = guard_rows(model, compiled, q, timing(a), g.row(a), gs.row(a));
            if (code == READY) {
                code = event_map(model, compiled, q, guards(a), modes.row(modulo(a + 1, guards.size())), J.row(a));
            }
            if (code != READY) {
                return code;
            }
        }
        smooth(a) = is_smooth(model, modes.row(a), S.row(a), gs.row(a), sense.row(a));
    }
    return READY;
}

}  // namespace orbits_arcs
}  // namespace EPP_ARCH
}  // namespace epp
