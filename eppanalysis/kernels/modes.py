"""Compiled: the affine system of one combination of element modes, with its guards."""

from __future__ import annotations

from eppanalysis.kernels.compiling import njit
from eppanalysis.kernels.flow import choose_step, multiply
from eppanalysis.kernels.tables import HOT, clear


@njit(**HOT)
def find_slot(model, slots, work, modes, base_step):
    """Slot of a combination of modes, compiled if new; -1 when the combination has no unique solution."""
    n_e = modes.size
    for q in range(slots.count[0]):
        same = True
        for e in range(n_e):
            if slots.key[q, e] != modes[e]:
                same = False
                break
        if same:
            return q
    if slots.count[0] == slots.key.shape[0]:
        slots.count[0] = 0
        slots.next[:, :] = -1
    q = slots.count[0]
    if q == slots.count[1]:
        clear(slots, q)
        slots.count[1] = q + 1
    if not compile_modes(model, slots, work, q, modes):
        return -1
    compile_guards(model, slots, work, q, modes)
    choose_step(slots, work, q, base_step)
    slots.count[0] += 1
    return q


@njit(**HOT)
def _solve(E, F):
    """Solve E X = F in place by elimination with pivoting; False when E is singular."""
    n, m = E.shape[0], F.shape[1]
    size = 0.0
    for i in range(n):
        for j in range(n):
            size = max(size, abs(E[i, j]))
    for k in range(n):
        p = k
        for i in range(k + 1, n):
            if abs(E[i, k]) > abs(E[p, k]):
                p = i
        if abs(E[p, k]) <= 1e-14 * size:
            return False
        if p != k:
            for j in range(n):
                E[k, j], E[p, j] = E[p, j], E[k, j]
            for j in range(m):
                F[k, j], F[p, j] = F[p, j], F[k, j]
        for i in range(k + 1, n):
            f = E[i, k] / E[k, k]
            if f != 0.0:
                for j in range(k, n):
                    E[i, j] -= f * E[k, j]
                for j in range(m):
                    F[i, j] -= f * F[k, j]
    for k in range(n - 1, -1, -1):
        for j in range(m):
            v = F[k, j]
            for i in range(k + 1, n):
                v -= E[k, i] * F[i, j]
            F[k, j] = v / E[k, k]
    return True


@njit(**HOT)
def _output_equations(model, modes, E, F):
    """E w = F [x, H, sigma]: each output's mode equation, or for a sticking mode the vanishing rate of its input."""
    n, n_w = model.B.shape
    n_H, n_s = model.K.shape[1], model.S.shape[1]
    E[:, :] = 0.0
    F[:, :] = 0.0
    for e in range(modes.size):
        m = model.mode_first[e] + modes[e]
        z0, w0, h0 = model.first[e, 0], model.first[e, 1], model.first[e, 2]
        n_ze, n_we, n_he = model.first[e + 1, 0] - z0, model.first[e + 1, 1] - w0, model.first[e + 1, 2] - h0
        if model.mode_stick[m]:
            c = model.C[z0]
            scale = 0.0
            for i in range(n):
                scale += c[i] * model.B[i, w0]
            for i in range(n):
                ci = c[i] / scale
                if ci == 0.0:
                    continue
                for j in range(n_w):
                    E[w0, j] += ci * model.B[i, j]
                for j in range(n):
                    F[w0, j] -= ci * model.A[i, j]
                for j in range(n_H):
                    F[w0, n + j] -= ci * model.K[i, j]
                for j in range(n_s):
                    F[w0, n + n_H + j] -= ci * model.S[i, j]
            continue
        for a in range(n_we):
            row = w0 + a
            E[row, row] += 1.0
            for b in range(n_ze):
                gain = model.mode_wz[m, a, b]
                if gain == 0.0:
                    continue
                for j in range(n_w):
                    E[row, j] -= gain * model.D[z0 + b, j]
                for j in range(n):
                    F[row, j] += gain * model.C[z0 + b, j]
                for j in range(n_H):
                    F[row, n + j] += gain * model.Kz[z0 + b, j]
            for b in range(n_he):
                F[row, n + h0 + b] += model.mode_wh[m, a, b]
            F[row, n + n_H - 1] += model.mode_w0[m, a]
            for j in range(n_s):
                F[row, n + n_H + j] += model.mode_ws[m, a, j]


@njit(**HOT)
def compile_modes(model, slots, work, q, modes):
    """Affine system of the combination `modes` into slot q."""
    n, n_H = model.K.shape
    E, F, rate, inputs, signals = work.E, work.F, work.rate, work.inputs, work.signals
    _output_equations(model, modes, E, F)
    if not _solve(E, F):
        return False
    for e in range(modes.size):
        slots.key[q, e] = modes[e]
    rate[:, :] = 0.0
    _put(rate, 0, model.A)
    _put(rate, n, model.K)
    _put(rate, n + n_H, model.S)
    _add_product(rate, model.B, F)
    for e in range(modes.size):
        m = model.mode_first[e] + modes[e]
        if model.mode_stick[m]:
            _hold_input(rate, model.C[model.first[e, 0]], model.B, model.first[e, 1])
    slots.linear[q] = _is_linear(model, rate, F)
    inputs[:, :] = 0.0
    _put(inputs, 0, model.C)
    _put(inputs, n, model.Kz)
    _add_product(inputs, model.D, F)
    signals[:, :] = 0.0
    _put(signals, 0, model.Yx)
    _put(signals, n, model.YH)
    _add_product(signals, model.Yw, F)
    _write_mode(slots, q, rate, F, inputs, signals)
    return True


@njit(**HOT)
def _is_linear(model, rate, F):
    """Whether no smooth channel acts on a rate or an output; a dead time always does."""
    first = model.A.shape[0] + model.K.shape[1]
    for j in range(model.S.shape[1]):
        if model.smooth_kind[j] == 10:
            return 0
        for i in range(rate.shape[0]):
            if rate[i, first + j] != 0.0:
                return 0
        for i in range(F.shape[0]):
            if F[i, first + j] != 0.0:
                return 0
    return 1


@njit(**HOT)
def _write_mode(slots, q, rate, F, inputs, signals):
    """Rates, outputs, inputs and signals on state, held values and smooth channels into slot q."""
    n, n_H = slots.N.shape[1], slots.N.shape[2]
    for i in range(n):
        for j in range(n):
            slots.M[q, j, i], slots.M_size[q, j, i] = rate[i, j], abs(rate[i, j])
    multiply(slots.M[q], slots.M[q], 1.0, slots.M_twice[q])
    _take(slots.N[q], rate, n)
    _take(slots.S[q], rate, n + n_H)
    _take(slots.Wx[q], F, 0)
    _take(slots.WH[q], F, n)
    _take(slots.Ws[q], F, n + n_H)
    _take(slots.Zx[q], inputs, 0)
    _take(slots.ZH[q], inputs, n)
    _take(slots.Zs[q], inputs, n + n_H)
    for i in range(signals.shape[0]):
        for j in range(n):
            slots.Y[q, j, i] = signals[i, j]
    _take(slots.YH[q], signals, n)
    _take(slots.Ys[q], signals, n + n_H)


@njit(**HOT)
def _put(out, first, block):
    for i in range(block.shape[0]):
        for j in range(block.shape[1]):
            out[i, first + j] = block[i, j]


@njit(**HOT)
def _take(block, source, first):
    for i in range(block.shape[0]):
        for j in range(block.shape[1]):
            block[i, j] = source[i, first + j]


@njit(**HOT)
def _add_product(out, P, Q):
    for i in range(P.shape[0]):
        for k in range(P.shape[1]):
            p = P[i, k]
            if p != 0.0:
                for j in range(Q.shape[1]):
                    out[i, j] += p * Q[k, j]


@njit(**HOT)
def _hold_input(rate, c, B, w):
    """Remove what rounding left of c @ rate, so that a stuck input does not creep."""
    n = c.size
    alone, count = -1, 0
    scale = 0.0
    for i in range(n):
        scale += c[i] * B[i, w]
        if c[i] != 0.0:
            alone, count = i, count + 1
    if count == 1:
        for j in range(rate.shape[1]):
            rate[alone, j] = 0.0
        return
    for j in range(rate.shape[1]):
        left = 0.0
        for i in range(n):
            left += c[i] * rate[i, j]
        for i in range(n):
            rate[i, j] -= B[i, w] * left / scale


@njit(**HOT)
def compile_guards(model, slots, work, q, modes):
    """Guard rows of the combination, on state, rate, held values and smooth channels, in the order of the cascade.

    Of guards that a jump has passed the first one fires, so that an element meets the jump that is left behind others.
    """
    k = 0
    for e in model.order:
        m = model.mode_first[e] + modes[e]
        for g in range(model.guard_first[m], model.guard_first[m + 1]):
            slots.guard[q, k] = g
            slots.next[q, k] = -1
            _guard_rows(model, slots, q, k, g)
            _guard_shape(slots, q, k)
            _guard_with_rate(slots, q, k)
            k += 1
    slots.n_guards[q] = k
    # Columns that another combination may have left.
    slots.all_gf[q, :, k:] = slots.reach_gf[q, :, k:] = 0.0


@njit(**HOT)
def _guard_rows(model, slots, q, k, g):
    """Guard g, at place k, on state, rate, held values and smooth channels, with its element's signals put in."""
    e = model.guard_element[g]
    z0, w0, h0 = model.first[e, 0], model.first[e, 1], model.first[e, 2]
    ga, gb, gH, gs, gt = slots.ga[q, k], slots.gb[q, k], slots.gH[q, k], slots.gs[q, k], slots.gt[q, k]
    for row in (ga, gb, gH, gs, gt):
        row[:] = 0.0
    for a in range(model.first[e + 1, 0] - z0):
        c, r = model.guard_z[g, a], model.guard_rate[g, a]
        _add_row(ga, c, slots.Zx[q, z0 + a])
        _add_row(gb, r, slots.Zx[q, z0 + a])
        _add_row(gH, c, slots.ZH[q, z0 + a])
        _add_row(gs, c, slots.Zs[q, z0 + a])
        _add_row(gt, r, slots.Zs[q, z0 + a])
    for a in range(model.first[e + 1, 1] - w0):
        c = model.guard_w[g, a]
        _add_row(ga, c, slots.Wx[q, w0 + a])
        _add_row(gH, c, slots.WH[q, w0 + a])
        _add_row(gs, c, slots.Ws[q, w0 + a])
    for a in range(model.first[e + 1, 2] - h0):
        gH[h0 + a] += model.guard_h[g, a]
    gH[gH.size - 1] += model.guard_0[g]


@njit(**HOT)
def _guard_shape(slots, q, k):
    """Which entries of the guard at place k are not zero, and their sizes."""
    ga, gb = slots.ga[q, k], slots.gb[q, k]
    slots.on_rate[q, k] = slots.smooth_guard[q, k] = slots.ga_count[q, k] = 0
    for i in range(slots.N.shape[1]):
        slots.ga_size[q, k, i], slots.gb_size[q, k, i] = abs(ga[i]), abs(gb[i])
        if ga[i] != 0.0:
            slots.ga_place[q, k, slots.ga_count[q, k]] = i
            slots.ga_count[q, k] += 1
        if gb[i] != 0.0:
            slots.on_rate[q, k] = 1
    for j in range(slots.gs.shape[2]):
        if slots.gs[q, k, j] != 0.0 or slots.gt[q, k, j] != 0.0:
            slots.smooth_guard[q, k] = 1


@njit(**HOT)
def _guard_with_rate(slots, q, k):
    """The guard at place k with the rate put in: a row on state and held values alone."""
    n, gb, gf, gfH = slots.N.shape[1], slots.gb[q, k], slots.gf[q, k], slots.gfH[q, k]
    for i in range(n):
        gf[i] = slots.ga[q, k, i]
    for i in range(gfH.size):
        gfH[i] = slots.gH[q, k, i]
    for j in range(n):
        if gb[j] != 0.0:
            for i in range(n):
                gf[i] += gb[j] * slots.M[q, i, j]
            _add_row(gfH, gb[j], slots.N[q, j])
    for i in range(n):
        slots.all_gf[q, i, k], slots.reach_gf[q, i, k] = gf[i], 1.000001 * abs(gf[i])


@njit(**HOT)
def _add_row(out, factor, row):
    if factor != 0.0:
        for i in range(row.size):
            out[i] += factor * row[i]
