#include "engine/modes.hpp"

namespace epp {
inline namespace EPP_ARCH {

bool _equal(Vector row, Vector other) {
    for (i64 i = 0; i < row.size(); ++i) {
        if (row(i) != other(i)) {
            return false;
        }
    }
    return true;
}

/// Whether two modes of an element, and their guards, weigh what they see alike.
bool _same_but_constants(const Model& model, i64 a, i64 b) {
    i64 first = model.guard_first(a);
    i64 other = model.guard_first(b);
    i64 guards = model.guard_first(a + 1) - first;
    if (model.mode_stick(a) != model.mode_stick(b) || guards != (model.guard_first(b + 1) - other)) {
        return false;
    }
    for (i64 i = 0, i_end = model.mode_w0.shape(1); i < i_end; ++i) {
        if (!(_equal(model.mode_wz.row(a, i), model.mode_wz.row(b, i)) && _equal(model.mode_wh.row(a, i),
            model.mode_wh.row(b, i)) && _equal(model.mode_ws.row(a, i), model.mode_ws.row(b, i)))) {
            return false;
        }
    }
    for (i64 g = 0; g < guards; ++g) {
        if (!(_equal(model.guard_z.row(first + g), model.guard_z.row(other + g)) && _equal(model.guard_rate.row(first +
            g), model.guard_rate.row(other + g)) && _equal(model.guard_h.row(first + g), model.guard_h.row(other +
            g)) && _equal(model.guard_w.row(first + g), model.guard_w.row(other + g)))) {
            return false;
        }
    }
    return true;
}

/// Place of a combination that differs from `modes` in constants alone, behind the last given up; -1 for none.
i64 _alike(const Model& model, const Combinations& compiled, Indices modes) {
    i64 q{}, m{};
    bool alike{};
    for (i64 i = 0, i_end = compiled.count(0); i < i_end; ++i) {
        q = modulo(compiled.count(2) + 1 + i, compiled.count(0));
        alike = true;
        for (i64 e = 0; e < modes.size(); ++e) {
            m = model.mode_first(e);
            if (compiled.key(q, e) != modes(e) && !_same_but_constants(model, m + compiled.key(q, e), m + modes(e))) {
                alike = false;
                break;
            }
        }
        if (alike) {
            return q;
        }
    }
    return -1;
}

/// E w = F [x, H, sigma]: each output's mode equation, or for a sticking mode the vanishing rate of its input.
///
/// `inputs` has the rows of inputs on the state; without any, what sticks gives nothing.
void _output_equations(const Model& model, Indices modes, Matrix E, Matrix F, const Matrix* inputs) {
    i64 m{}, z0{}, w0{}, h0{}, n_ze{}, n_we{}, n_he{}, row{};
    Vector c{};
    double scale{}, ci{}, gain{};
    i64 n = model.B.shape(0);
    i64 n_w = model.B.shape(1);
    i64 n_H = model.K.shape(1);
    i64 n_s = model.S.shape(1);
    E.fill(0.0);
    F.fill(0.0);
    for (i64 e = 0; e < modes.size(); ++e) {
        m = model.mode_first(e) + modes(e);
        z0 = model.first(e, 0);
        w0 = model.first(e, 1);
        h0 = model.first(e, 2);
        n_ze = model.first(e + 1, 0) - z0;
        n_we = model.first(e + 1, 1) - w0;
        n_he = model.first(e + 1, 2) - h0;
        // What sticks has no law of its own: its output is what keeps its input still, c x' = 0, with the row scaled
        // to the size of the others (docs/theory/engine.md, Modes).
        if (model.mode_stick(m) && inputs == nullptr) {
            E(w0, w0) = 1.0;
        } else if (model.mode_stick(m)) {
            c = inputs->row(z0);
            scale = 0.0;
            for (i64 i = 0; i < n; ++i) {
                scale += c(i) * model.B(i, w0);
            }
            for (i64 i = 0; i < n; ++i) {
                ci = c(i) / scale;
                if (ci == 0.0) {
                    continue;
                }
                for (i64 j = 0; j < n_w; ++j) {
                    E(w0, j) += ci * model.B(i, j);
                }
                for (i64 j = 0; j < n; ++j) {
                    F(w0, j) -= ci * model.A(i, j);
                }
                for (i64 j = 0; j < n_H; ++j) {
                    F(w0, n + j) -= ci * model.K(i, j);
                }
                for (i64 j = 0; j < n_s; ++j) {
                    F(w0, n + n_H + j) -= ci * model.S(i, j);
                }
            }
        }
        for (i64 a = model.mode_stick(m) ? 1 : 0; a < n_we; ++a) {
            row = w0 + a;
            E(row, row) += 1.0;
            for (i64 b = 0; b < n_ze; ++b) {
                gain = model.mode_wz(m, a, b);
                if (gain == 0.0) {
                    continue;
                }
                for (i64 j = 0; j < n_w; ++j) {
                    E(row, j) -= gain * model.D(z0 + b, j);
                }
                for (i64 j = 0; j < n; ++j) {
                    F(row, j) += gain * model.C(z0 + b, j);
                }
                for (i64 j = 0; j < n_H; ++j) {
                    F(row, n + j) += gain * model.Kz(z0 + b, j);
                }
            }
            for (i64 b = 0; b < n_he; ++b) {
                F(row, n + h0 + b) += model.mode_wh(m, a, b);
            }
            F(row, n + n_H - 1) += model.mode_w0(m, a);
            for (i64 j = 0; j < n_s; ++j) {
                F(row, n + n_H + j) += model.mode_ws(m, a, j);
            }
        }
    }
}

/// Solve E X = F in place by elimination with pivoting; False when E is singular.
bool _solve(Matrix E, Matrix F) {
    i64 p{};
    double f{}, v{};
    i64 n = E.shape(0);
    i64 m = F.shape(1);
    double size = 0.0;
    for (i64 i = 0; i < n; ++i) {
        for (i64 j = 0; j < n; ++j) {
            size = greatest_of(size, std::fabs(E(i, j)));
        }
    }
    for (i64 k = 0; k < n; ++k) {
        p = k;
        for (i64 i = k + 1; i < n; ++i) {
            if (std::fabs(E(i, k)) > std::fabs(E(p, k))) {
                p = i;
            }
        }
        // A pivot of rounding: the modes contradict one another, or leave an output open. One that is no number: what
        // sticks has no hold on its input.
        if (!(std::fabs(E(p, k)) > (1e-14 * size))) {
            return false;
        }
        if (p != k) {
            for (i64 j = 0; j < n; ++j) {
                {
                    const double was1 = E(p, j);
                    const double was2 = E(k, j);
                    E(k, j) = was1;
                    E(p, j) = was2;
                }
            }
            for (i64 j = 0; j < m; ++j) {
                {
                    const double was3 = F(p, j);
                    const double was4 = F(k, j);
                    F(k, j) = was3;
                    F(p, j) = was4;
                }
            }
        }
        for (i64 i = k + 1; i < n; ++i) {
            f = E(i, k) / E(k, k);
            if (f != 0.0) {
                for (i64 j = k; j < n; ++j) {
                    E(i, j) -= f * E(k, j);
                }
                for (i64 j = 0; j < m; ++j) {
                    F(i, j) -= f * F(k, j);
                }
            }
        }
    }
    for (i64 k = n - 1; k > -1; --k) {
        for (i64 j = 0; j < m; ++j) {
            v = F(k, j);
            for (i64 i = k + 1; i < n; ++i) {
                v -= E(k, i) * F(i, j);
            }
            F(k, j) = v / E(k, k);
        }
    }
    return true;
}

void _put(Matrix out, i64 first, Matrix block) {
    for (i64 i = 0; i < block.shape(0); ++i) {
        for (i64 j = 0; j < block.shape(1); ++j) {
            out(i, first + j) = block(i, j);
        }
    }
}

void _add_product(Matrix out, Matrix P, Matrix Q) {
    double p{};
    for (i64 i = 0; i < P.shape(0); ++i) {
        for (i64 k = 0; k < P.shape(1); ++k) {
            p = P(i, k);
            if (p != 0.0) {
                for (i64 j = 0; j < Q.shape(1); ++j) {
                    out(i, j) += p * Q(k, j);
                }
            }
        }
    }
}

/// Remove what rounding left of c @ rate, so that a stuck input does not creep.
void _hold_input(Matrix rate, Vector c, Matrix B, i64 w) {
    double left{};
    i64 n = c.size();
    i64 alone = -1;
    i64 count = 0;
    double scale = 0.0;
    for (i64 i = 0; i < n; ++i) {
        scale += c(i) * B(i, w);
        if (c(i) != 0.0) {
            alone = i;
            count = count + 1;
        }
    }
    if (count == 1) {
        for (i64 j = 0; j < rate.shape(1); ++j) {
            rate(alone, j) = 0.0;
        }
        return;
    }
    for (i64 j = 0; j < rate.shape(1); ++j) {
        left = 0.0;
        for (i64 i = 0; i < n; ++i) {
            left += c(i) * rate(i, j);
        }
        for (i64 i = 0; i < n; ++i) {
            rate(i, j) -= B(i, w) * left / scale;
        }
    }
}

/// Whether no smooth channel acts on a rate or an output; a dead time always does.
i64 _is_linear(const Model& model, Matrix rate, Matrix F) {
    i64 first = model.A.shape(0) + model.K.shape(1);
    for (i64 j = 0, j_end = model.S.shape(1); j < j_end; ++j) {
        if (model.smooth_kind(j) == DELAY_LINE) {
            return 0;
        }
        for (i64 i = 0; i < rate.shape(0); ++i) {
            if (rate(i, first + j) != 0.0) {
                return 0;
            }
        }
        for (i64 i = 0; i < F.shape(0); ++i) {
            if (F(i, first + j) != 0.0) {
                return 0;
            }
        }
    }
    return 1;
}

void _take(Matrix block, Matrix source, i64 first) {
    for (i64 i = 0; i < block.shape(0); ++i) {
        for (i64 j = 0; j < block.shape(1); ++j) {
            block(i, j) = source(i, first + j);
        }
    }
}

/// Rates, outputs, inputs and signals on state, memory values and smooth channels into mode combination q.
void _write_mode(const Combinations& compiled, i64 q, Matrix rate, Matrix F, Matrix inputs, Matrix signals) {
    i64 n = compiled.N.shape(1);
    i64 n_H = compiled.N.shape(2);
    for (i64 i = 0; i < n; ++i) {
        for (i64 j = 0; j < n; ++j) {
            {
                const double was1 = rate(i, j);
                const double was2 = std::fabs(rate(i, j));
                compiled.M(q, j, i) = was1;
                compiled.M_size(q, j, i) = was2;
            }
        }
    }
    if (compiled.row_end.shape(1) == 0) {
        multiply(compiled.M.row(q), compiled.M.row(q), 1.0, compiled.M_twice.row(q));
    }
    _take(compiled.N.row(q), rate, n);
    _take(compiled.S.row(q), rate, n + n_H);
    _take(compiled.Wx.row(q), F, 0);
    _take(compiled.WH.row(q), F, n);
    _take(compiled.Ws.row(q), F, n + n_H);
    _take(compiled.Zx.row(q), inputs, 0);
    _take(compiled.ZH.row(q), inputs, n);
    _take(compiled.Zs.row(q), inputs, n + n_H);
    for (i64 i = 0; i < signals.shape(0); ++i) {
        for (i64 j = 0; j < n; ++j) {
            compiled.Y(q, j, i) = signals(i, j);
        }
    }
    _take(compiled.YH.row(q), signals, n);
    _take(compiled.Ys.row(q), signals, n + n_H);
}

/// Whether an element that sticks reads an output of another one straight.
bool _sticks_behind_another(const Model& model, Indices modes) {
    for (i64 e = 0; e < modes.size(); ++e) {
        if (!model.mode_stick(model.mode_first(e) + modes(e))) {
            continue;
        }
        for (i64 j = 0, j_end = model.D.shape(1); j < j_end; ++j) {
            if (model.D(model.first(e, 0), j) != 0.0) {
                return true;
            }
        }
    }
    return false;
}

/// Inputs of the elements on state, memory values and smooth channels, for outputs F.
void _put_inputs(const Model& model, Matrix inputs, Matrix F) {
    inputs.fill(0.0);
    _put(inputs, 0, model.C);
    _put(inputs, model.C.shape(1), model.Kz);
    _add_product(inputs, model.D, F);
}

/// Affine system of the combination `modes` into place q.
bool compile_modes(const Model& model, const Combinations& compiled, const Work& work, i64 q, Indices modes) {
    i64 m{};
    i64 n = model.K.shape(0);
    i64 n_H = model.K.shape(1);
    Matrix E = work.E;
    Matrix F = work.F;
    Matrix rate = work.rate;
    Matrix inputs = work.inputs;
    Matrix signals = work.signals;
    F.fill(0.0);
    // What acts straight on the input of an element that sticks does not feel its output (`admitted`): with none of it
    // the inputs are what they are.
    if (_sticks_behind_another(model, modes)) {
        _output_equations(model, modes, E, F, nullptr);
        if (!_solve(E, F)) {
            return false;
        }
    }
    _put_inputs(model, inputs, F);
    _output_equations(model, modes, E, F, &inputs);
    if (!_solve(E, F)) {
        return false;
    }
    for (i64 e = 0; e < modes.size(); ++e) {
        compiled.key(q, e) = modes(e);
    }
    rate.fill(0.0);
    _put(rate, 0, model.A);
    _put(rate, n, model.K);
    _put(rate, n + n_H, model.S);
    _add_product(rate, model.B, F);
    for (i64 e = 0; e < modes.size(); ++e) {
        m = model.mode_first(e) + modes(e);
        if (model.mode_stick(m)) {
            _hold_input(rate, inputs.row(model.first(e, 0)).slice(0, n), model.B, model.first(e, 1));
        }
    }
    compiled.linear(q) = _is_linear(model, rate, F);
    _put_inputs(model, inputs, F);
    signals.fill(0.0);
    _put(signals, 0, model.Yx);
    _put(signals, n, model.YH);
    _add_product(signals, model.Yw, F);
    _write_mode(compiled, q, rate, F, inputs, signals);
    return true;
}

void _add_row(Vector out, double factor, Vector row) {
    if (factor != 0.0) {
        for (i64 i = 0; i < row.size(); ++i) {
            out(i) += factor * row(i);
        }
    }
}

/// Guard g, at place k, on state, rate, memory values and smooth channels, with its element's signals put in.
void _guard_rows(const Model& model, const Combinations& compiled, i64 q, i64 k, i64 g) {
    double c{}, r{};
    i64 e = model.guard_element(g);
    i64 z0 = model.first(e, 0);
    i64 w0 = model.first(e, 1);
    i64 h0 = model.first(e, 2);
    Vector ga = compiled.ga.row(q, k);
    Vector gb = compiled.gb.row(q, k);
    Vector gH = compiled.gH.row(q, k);
    Vector gs = compiled.gs.row(q, k);
    Vector gt = compiled.gt.row(q, k);
    for (Vector row : {ga, gb, gH, gs, gt}) {
        row.fill(0.0);
    }
    for (i64 a = 0, a_end = model.first(e + 1, 0) - z0; a < a_end; ++a) {
        c = model.guard_z(g, a);
        r = model.guard_rate(g, a);
        _add_row(ga, c, compiled.Zx.row(q, z0 + a));
        _add_row(gb, r, compiled.Zx.row(q, z0 + a));
        _add_row(gH, c, compiled.ZH.row(q, z0 + a));
        _add_row(gs, c, compiled.Zs.row(q, z0 + a));
        _add_row(gt, r, compiled.Zs.row(q, z0 + a));
    }
    for (i64 a = 0, a_end = model.first(e + 1, 1) - w0; a < a_end; ++a) {
        c = model.guard_w(g, a);
        _add_row(ga, c, compiled.Wx.row(q, w0 + a));
        _add_row(gH, c, compiled.WH.row(q, w0 + a));
        _add_row(gs, c, compiled.Ws.row(q, w0 + a));
    }
    for (i64 a = 0, a_end = model.first(e + 1, 2) - h0; a < a_end; ++a) {
        gH(h0 + a) += model.guard_h(g, a);
    }
    gH(gH.size() - 1) += model.guard_0(g);
}

/// Which entries of the guard at place k are not zero, and their sizes.
void _guard_shape(const Combinations& compiled, i64 q, i64 k) {
    Vector ga = compiled.ga.row(q, k);
    Vector gb = compiled.gb.row(q, k);
    const i64 was1 = 0;
    compiled.on_rate(q, k) = was1;
    compiled.smooth_guard(q, k) = was1;
    compiled.ga_count(q, k) = was1;
    for (i64 i = 0, i_end = compiled.N.shape(1); i < i_end; ++i) {
        {
            const double was2 = std::fabs(ga(i));
            const double was3 = std::fabs(gb(i));
            compiled.ga_size(q, k, i) = was2;
            compiled.gb_size(q, k, i) = was3;
        }
        if (ga(i) != 0.0) {
            compiled.ga_place(q, k, compiled.ga_count(q, k)) = i;
            compiled.ga_count(q, k) += 1;
        }
        if (gb(i) != 0.0) {
            compiled.on_rate(q, k) = 1;
        }
    }
    for (i64 j = 0, j_end = compiled.gs.shape(2); j < j_end; ++j) {
        if (compiled.gs(q, k, j) != 0.0 || compiled.gt(q, k, j) != 0.0) {
            compiled.smooth_guard(q, k) = 1;
        }
    }
}

/// The guard at place k with the rate put in: a row on state and memory values alone.
void _guard_with_rate(const Combinations& compiled, i64 q, i64 k) {
    i64 n = compiled.N.shape(1);
    Vector gb = compiled.gb.row(q, k);
    Vector gf = compiled.gf.row(q, k);
    Vector gfH = compiled.gfH.row(q, k);
    for (i64 i = 0; i < n; ++i) {
        gf(i) = compiled.ga(q, k, i);
    }
    for (i64 i = 0; i < gfH.size(); ++i) {
        gfH(i) = compiled.gH(q, k, i);
    }
    for (i64 j = 0; j < n; ++j) {
        if (gb(j) != 0.0) {
            for (i64 i = 0; i < n; ++i) {
                gf(i) += gb(j) * compiled.M(q, i, j);
            }
            _add_row(gfH, gb(j), compiled.N.row(q, j));
        }
    }
    for (i64 i = 0; i < n; ++i) {
        {
            const double was1 = gf(i);
            const double was2 = 1.000001 * std::fabs(gf(i));
            compiled.all_gf(q, i, k) = was1;
            compiled.reach_gf(q, i, k) = was2;
        }
    }
}

/// Guard rows of the combination, on state, rate, memory values and smooth channels, in the order of the cascade.
///
/// Of guards that a jump has passed the first one fires, so that an element meets the jump that is left behind others.
void compile_guards(const Model& model, const Combinations& compiled, i64 q, Indices modes) {
    i64 m{};
    i64 k = 0;
    for (const auto& e : model.order) {
        m = model.mode_first(e) + modes(e);
        for (i64 g = model.guard_first(m), g_end = model.guard_first(m + 1); g < g_end; ++g) {
            compiled.guard(q, k) = g;
            compiled.next(q, k) = -1;
            _guard_rows(model, compiled, q, k, g);
            _guard_shape(compiled, q, k);
            _guard_with_rate(compiled, q, k);
            k += 1;
        }
    }
    compiled.n_guards(q) = k;
    // Columns that another combination may have left.
    const double was1 = 0.0;
    compiled.all_gf.cut(q, ALL, Span{k, compiled.all_gf.shape(2)}).fill(was1);
    compiled.reach_gf.cut(q, ALL, Span{k, compiled.reach_gf.shape(2)}).fill(was1);
}

/// Number of a combination of modes, compiled if new; -1 when the combination has no unique solution.
i64 find_combination(const Model& model, const Combinations& compiled, const Work& work, Indices modes,
    double base_step) {
    i64 q{};
    for (i64 q_at = 0, q_at_end = compiled.count(0); q_at < q_at_end; ++q_at) {
        q = q_at;
        if (is_of(compiled, q, modes)) {
            return q;
        }
    }
    i64 alike = -1;
    if (compiled.count(0) < compiled.key.shape(0)) {
        q = compiled.count(0);
        if (q == compiled.count(1)) {
            clear(compiled, q);
            compiled.count(1) = q + 1;
        }
    } else {
        // A full table gives up the place of a combination that differs in constants alone (an encoder has thousands of
        // levels): the matrices stay, those of steps as well. Places are given up in turn.
        alike = _alike(model, compiled, modes);
        const i64 was1 = (alike >= 0) ? alike : modulo(compiled.count(2) + 1, compiled.key.shape(0));
        q = was1;
        compiled.count(2) = was1;
    }
    if (!compile_modes(model, compiled, work, q, modes)) {
        return -1;
    }
    compile_guards(model, compiled, q, modes);
    if (alike < 0) {
        choose_step(compiled, work, q, base_step);
    }
    compiled.count(0) = greatest_of<i64>(compiled.count(0), q + 1);
    return q;
}

}  // namespace EPP_ARCH
}  // namespace epp
