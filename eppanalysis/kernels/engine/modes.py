"""Compiled: the affine system of one combination of element modes, with its guards."""

from eppanalysis.kernels.compiling import njit
from eppanalysis.kernels.engine.flow import choose_step, multiply
from eppanalysis.kernels.engine.series import DELAY_LINE
from eppanalysis.kernels.engine.tables import HOT, INLINE, clear


@njit(**HOT)
def find_combination(model, compiled, work, modes, base_step):
    """Number of a combination of modes, compiled if new; -1 when the combination has no unique solution."""
    for q in range(compiled.count[0]):
        if is_of(compiled, q, modes):
            return q
    alike = -1
    if compiled.count[0] < compiled.key.shape[0]:
        q = compiled.count[0]
        if q == compiled.count[1]:
            clear(compiled, q)
            compiled.count[1] = q + 1
    else:
        # A full table gives up the place of a combination that differs in constants alone (an encoder has thousands of
        # levels): the matrices stay, those of steps as well. Places are given up in turn.
        alike = _alike(model, compiled, modes)
        q = compiled.count[2] = alike if alike >= 0 else (compiled.count[2] + 1) % compiled.key.shape[0]
    if not compile_modes(model, compiled, work, q, modes):
        return -1
    compile_guards(model, compiled, q, modes)
    if alike < 0:
        choose_step(compiled, work, q, base_step)
    compiled.count[0] = max(compiled.count[0], q + 1)
    return q


@njit(**INLINE)
def is_of(compiled, q, modes):
    """Whether place q of the table holds the combination `modes`."""
    for e in range(modes.size):
        if compiled.key[q, e] != modes[e]:
            return False
    return True


@njit(**HOT)
def _alike(model, compiled, modes):
    """Place of a combination that differs from `modes` in constants alone, behind the last given up; -1 for none."""
    for i in range(compiled.count[0]):
        q = (compiled.count[2] + 1 + i) % compiled.count[0]
        alike = True
        for e in range(modes.size):
            m = model.mode_first[e]
            if compiled.key[q, e] != modes[e] and not _same_but_constants(model, m + compiled.key[q, e], m + modes[e]):
                alike = False
                break
        if alike:
            return q
    return -1


@njit(**HOT)
def _same_but_constants(model, a, b):
    """Whether two modes of an element, and their guards, weigh what they see alike."""
    first, other = model.guard_first[a], model.guard_first[b]
    guards = model.guard_first[a + 1] - first
    if model.mode_stick[a] != model.mode_stick[b] or guards != model.guard_first[b + 1] - other:
        return False
    for i in range(model.mode_w0.shape[1]):
        if not (
            _equal(model.mode_wz[a, i], model.mode_wz[b, i])
            and _equal(model.mode_wh[a, i], model.mode_wh[b, i])
            and _equal(model.mode_ws[a, i], model.mode_ws[b, i])
        ):
            return False
    for g in range(guards):
        if not (
            _equal(model.guard_z[first + g], model.guard_z[other + g])
            and _equal(model.guard_rate[first + g], model.guard_rate[other + g])
            and _equal(model.guard_h[first + g], model.guard_h[other + g])
            and _equal(model.guard_w[first + g], model.guard_w[other + g])
        ):
            return False
    return True


@njit(**HOT)
def _equal(row, other):
    for i in range(row.size):
        if row[i] != other[i]:
            return False
    return True


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
        # A pivot of rounding: the modes contradict one another, or leave an output open.
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
            # What sticks has no law of its own: its output is what keeps its input still, c x' = 0, with the row scaled
            # to the size of the others (docs/theory/engine.md, Modes).
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
        for a in range(1 if model.mode_stick[m] else 0, n_we):
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
def compile_modes(model, compiled, work, q, modes):
    """Affine system of the combination `modes` into place q."""
    n, n_H = model.K.shape
    E, F, rate, inputs, signals = work.E, work.F, work.rate, work.inputs, work.signals
    _output_equations(model, modes, E, F)
    if not _solve(E, F):
        return False
    for e in range(modes.size):
        compiled.key[q, e] = modes[e]
    rate[:, :] = 0.0
    _put(rate, 0, model.A)
    _put(rate, n, model.K)
    _put(rate, n + n_H, model.S)
    _add_product(rate, model.B, F)
    for e in range(modes.size):
        m = model.mode_first[e] + modes[e]
        if model.mode_stick[m]:
            _hold_input(rate, model.C[model.first[e, 0]], model.B, model.first[e, 1])
    compiled.linear[q] = _is_linear(model, rate, F)
    inputs[:, :] = 0.0
    _put(inputs, 0, model.C)
    _put(inputs, n, model.Kz)
    _add_product(inputs, model.D, F)
    signals[:, :] = 0.0
    _put(signals, 0, model.Yx)
    _put(signals, n, model.YH)
    _add_product(signals, model.Yw, F)
    _write_mode(compiled, q, rate, F, inputs, signals)
    return True


@njit(**HOT)
def _is_linear(model, rate, F):
    """Whether no smooth channel acts on a rate or an output; a dead time always does."""
    first = model.A.shape[0] + model.K.shape[1]
    for j in range(model.S.shape[1]):
        if model.smooth_kind[j] == DELAY_LINE:
            return 0
        for i in range(rate.shape[0]):
            if rate[i, first + j] != 0.0:
                return 0
        for i in range(F.shape[0]):
            if F[i, first + j] != 0.0:
                return 0
    return 1


@njit(**HOT)
def _write_mode(compiled, q, rate, F, inputs, signals):
    """Rates, outputs, inputs and signals on state, memory values and smooth channels into mode combination q."""
    n, n_H = compiled.N.shape[1], compiled.N.shape[2]
    for i in range(n):
        for j in range(n):
            compiled.M[q, j, i], compiled.M_size[q, j, i] = rate[i, j], abs(rate[i, j])
    if compiled.row_end.shape[1] == 0:
        multiply(compiled.M[q], compiled.M[q], 1.0, compiled.M_twice[q])
    _take(compiled.N[q], rate, n)
    _take(compiled.S[q], rate, n + n_H)
    _take(compiled.Wx[q], F, 0)
    _take(compiled.WH[q], F, n)
    _take(compiled.Ws[q], F, n + n_H)
    _take(compiled.Zx[q], inputs, 0)
    _take(compiled.ZH[q], inputs, n)
    _take(compiled.Zs[q], inputs, n + n_H)
    for i in range(signals.shape[0]):
        for j in range(n):
            compiled.Y[q, j, i] = signals[i, j]
    _take(compiled.YH[q], signals, n)
    _take(compiled.Ys[q], signals, n + n_H)


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
def compile_guards(model, compiled, q, modes):
    """Guard rows of the combination, on state, rate, memory values and smooth channels, in the order of the cascade.

    Of guards that a jump has passed the first one fires, so that an element meets the jump that is left behind others.
    """
    k = 0
    for e in model.order:
        m = model.mode_first[e] + modes[e]
        for g in range(model.guard_first[m], model.guard_first[m + 1]):
            compiled.guard[q, k] = g
            compiled.next[q, k] = -1
            _guard_rows(model, compiled, q, k, g)
            _guard_shape(compiled, q, k)
            _guard_with_rate(compiled, q, k)
            k += 1
    compiled.n_guards[q] = k
    # Columns that another combination may have left.
    compiled.all_gf[q, :, k:] = compiled.reach_gf[q, :, k:] = 0.0


@njit(**HOT)
def _guard_rows(model, compiled, q, k, g):
    """Guard g, at place k, on state, rate, memory values and smooth channels, with its element's signals put in."""
    e = model.guard_element[g]
    z0, w0, h0 = model.first[e, 0], model.first[e, 1], model.first[e, 2]
    ga, gb, gH, gs, gt = compiled.ga[q, k], compiled.gb[q, k], compiled.gH[q, k], compiled.gs[q, k], compiled.gt[q, k]
    for row in (ga, gb, gH, gs, gt):
        row[:] = 0.0
    for a in range(model.first[e + 1, 0] - z0):
        c, r = model.guard_z[g, a], model.guard_rate[g, a]
        _add_row(ga, c, compiled.Zx[q, z0 + a])
        _add_row(gb, r, compiled.Zx[q, z0 + a])
        _add_row(gH, c, compiled.ZH[q, z0 + a])
        _add_row(gs, c, compiled.Zs[q, z0 + a])
        _add_row(gt, r, compiled.Zs[q, z0 + a])
    for a in range(model.first[e + 1, 1] - w0):
        c = model.guard_w[g, a]
        _add_row(ga, c, compiled.Wx[q, w0 + a])
        _add_row(gH, c, compiled.WH[q, w0 + a])
        _add_row(gs, c, compiled.Ws[q, w0 + a])
    for a in range(model.first[e + 1, 2] - h0):
        gH[h0 + a] += model.guard_h[g, a]
    gH[gH.size - 1] += model.guard_0[g]


@njit(**HOT)
def _guard_shape(compiled, q, k):
    """Which entries of the guard at place k are not zero, and their sizes."""
    ga, gb = compiled.ga[q, k], compiled.gb[q, k]
    compiled.on_rate[q, k] = compiled.smooth_guard[q, k] = compiled.ga_count[q, k] = 0
    for i in range(compiled.N.shape[1]):
        compiled.ga_size[q, k, i], compiled.gb_size[q, k, i] = abs(ga[i]), abs(gb[i])
        if ga[i] != 0.0:
            compiled.ga_place[q, k, compiled.ga_count[q, k]] = i
            compiled.ga_count[q, k] += 1
        if gb[i] != 0.0:
            compiled.on_rate[q, k] = 1
    for j in range(compiled.gs.shape[2]):
        if compiled.gs[q, k, j] != 0.0 or compiled.gt[q, k, j] != 0.0:
            compiled.smooth_guard[q, k] = 1


@njit(**HOT)
def _guard_with_rate(compiled, q, k):
    """The guard at place k with the rate put in: a row on state and memory values alone."""
    n, gb, gf, gfH = compiled.N.shape[1], compiled.gb[q, k], compiled.gf[q, k], compiled.gfH[q, k]
    for i in range(n):
        gf[i] = compiled.ga[q, k, i]
    for i in range(gfH.size):
        gfH[i] = compiled.gH[q, k, i]
    for j in range(n):
        if gb[j] != 0.0:
            for i in range(n):
                gf[i] += gb[j] * compiled.M[q, i, j]
            _add_row(gfH, gb[j], compiled.N[q, j])
    for i in range(n):
        compiled.all_gf[q, i, k], compiled.reach_gf[q, i, k] = gf[i], 1.000001 * abs(gf[i])


@njit(**HOT)
def _add_row(out, factor, row):
    if factor != 0.0:
        for i in range(row.size):
            out[i] += factor * row[i]
