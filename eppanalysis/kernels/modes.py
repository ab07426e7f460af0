"""Compiled: the affine system of one combination of element modes, and its exact step with bounds for the guards.

A hybrid system comes as flat arrays (`Model`). The combination of modes that a run visits is compiled on first visit
into a slot of `Slots`: state matrix, guard rows, and for one step h the matrices that carry state, rate and guards from
the start of the step to its end, with a bound on how far a guard can stray from the cubic through its end values.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

#: Hot functions: they allocate nothing, so that reference counts (which cost more than the arithmetic) are left out.
#: Products and sums may contract to one rounding; nothing else of the arithmetic is loosened.
HOT = {"cache": True, "nogil": True, "_nrt": False, "fastmath": {"contract"}}
#: Those that are called at every step are also written into their caller: handing over all these arrays costs more than
#: most of them compute.
INLINE = {**HOT, "inline": "always"}

#: A long step is 2**4 steps of the grid, the longest 2**8.
LONG_DOUBLINGS, LONGS = 4, 2


class Model(NamedTuple):
    """Flat arrays of a hybrid system: n states, w outputs, z inputs, H held values (the last is 1), s smooth ones."""

    A: np.ndarray  # (n, n)
    B: np.ndarray  # (n, w), without delayed outputs
    S: np.ndarray  # (n, s)
    K: np.ndarray  # (n, H)
    C: np.ndarray  # (z, n)
    D: np.ndarray  # (z, w)
    Kz: np.ndarray  # (z, H)
    first: np.ndarray  # (E + 1, 3) int: where each element's inputs, outputs, held values begin
    mode_first: np.ndarray  # (E + 1,) int
    mode_wz: np.ndarray  # (m, w_max, z_max)
    mode_wh: np.ndarray  # (m, w_max, h_max)
    mode_ws: np.ndarray  # (m, w_max, s)
    mode_w0: np.ndarray  # (m, w_max)
    mode_stick: np.ndarray  # (m,) int
    mode_level: np.ndarray  # (m,)
    guard_first: np.ndarray  # (m + 1,) int
    guard_element: np.ndarray  # (g,) int
    guard_target: np.ndarray  # (g,) int, mode number within the element
    guard_bypass: np.ndarray  # (g,) int, the mode beyond a sticking target, for an input that jumped over its level
    guard_z: np.ndarray  # (g, z_max)
    guard_rate: np.ndarray  # (g, z_max)
    guard_h: np.ndarray  # (g, h_max)
    guard_w: np.ndarray  # (g, w_max)
    guard_0: np.ndarray  # (g,)
    reset_z: np.ndarray  # (g, h_max, z_max)
    reset_h: np.ndarray  # (g, h_max, h_max)
    reset_0: np.ndarray  # (g, h_max)
    smooth_kind: np.ndarray  # (s,) int
    smooth_x: np.ndarray  # (s, n)
    smooth_H: np.ndarray  # (s, H)
    smooth_scale: np.ndarray  # (s,)
    smooth_w: np.ndarray  # (s,) int, the delayed output of a delay channel
    smooth_delay: np.ndarray  # (s,)
    Yx: np.ndarray  # (y, n)
    Yw: np.ndarray  # (y, w)
    YH: np.ndarray  # (y, H)
    knot_time: np.ndarray  # (k,)
    knot_state: np.ndarray  # (k,) int
    knot_value: np.ndarray  # (k,)
    knot_held: np.ndarray  # (k,) int
    knot_slope: np.ndarray  # (k,)


class Slots(NamedTuple):
    """Compiled mode combinations (leading axis: slot)."""

    count: np.ndarray  # (1,) int
    key: np.ndarray  # (q, E) int
    linear: np.ndarray  # (q,) int: no smooth channel acts
    step: np.ndarray  # (q,)
    rate: np.ndarray  # (q,) bound on the growth of the powers of M
    ready: np.ndarray  # (q,) int: whether T and bound are filled
    M: np.ndarray  # (q, n, n) transposed: M[j, i] = d x_i' / d x_j
    M_count: np.ndarray  # (q, n) int: entries of each row of M that are not zero
    M_place: np.ndarray  # (q, n, n) int: their columns
    M_value: np.ndarray  # (q, n, n)
    N: np.ndarray  # (q, n, H)
    S: np.ndarray  # (q, n, s)
    Wx: np.ndarray  # (q, w, n)
    WH: np.ndarray  # (q, w, H)
    Ws: np.ndarray  # (q, w, s)
    Zx: np.ndarray  # (q, z, n)
    ZH: np.ndarray  # (q, z, H)
    Zs: np.ndarray  # (q, z, s)
    Y_count: np.ndarray  # (q, y) int: signal rows on the state, entries that are not zero
    Y_place: np.ndarray  # (q, y, n) int
    Y_value: np.ndarray  # (q, y, n)
    YH: np.ndarray  # (q, y, H)
    Ys: np.ndarray  # (q, y, s)
    n_guards: np.ndarray  # (q,) int
    guard: np.ndarray  # (q, G) int
    next: np.ndarray  # (q, G) int
    ga_count: np.ndarray  # (q, G) int: guard rows on the state, entries that are not zero
    ga_place: np.ndarray  # (q, G, n) int
    ga_value: np.ndarray  # (q, G, n)
    gb_count: np.ndarray  # (q, G) int: guard rows on the rate of the state
    gb_place: np.ndarray  # (q, G, n) int
    gb_value: np.ndarray  # (q, G, n)
    gH: np.ndarray  # (q, G, H)
    gs: np.ndarray  # (q, G, s)
    gt: np.ndarray  # (q, G, s): on the rates of the smooth channels
    smooth_guard: np.ndarray  # (q, G) int: whether gs or gt has an entry
    gf: np.ndarray  # (q, G, n)
    gfH: np.ndarray  # (q, G, H)
    T: np.ndarray  # (q, n, 2n + 2G): from the rate at the start to state increment, rate, guard increments, guard rates
    bound: np.ndarray  # (q, n, G)
    longs: np.ndarray  # (q,) int: lengths of the next two that are filled
    T_long: np.ndarray  # (q, lengths, n, 2n + 2G): as T, over long steps
    reach: np.ndarray  # (q, lengths, n, G): bound on how far a guard moves on the way, from the rate at the start


class Work(NamedTuple):
    """Scratch room for compiling a slot."""

    E: np.ndarray  # (w, w)
    F: np.ndarray  # (w, n + H + s)
    rate: np.ndarray  # (n, n + H + s)
    inputs: np.ndarray  # (z, n + H + s)
    signals: np.ndarray  # (y, n + H + s)
    square: np.ndarray  # (7, n, n)
    row: np.ndarray  # (4, n)


@njit(cache=True, nogil=True)
def make_work(model):
    """Scratch room for a model's slots."""
    n, n_w = model.B.shape
    total = n + model.K.shape[1] + model.S.shape[1]
    return Work(
        np.empty((n_w, n_w)),
        np.empty((n_w, total)),
        np.empty((n, total)),
        np.empty((model.C.shape[0], total)),
        np.empty((model.Yx.shape[0], total)),
        np.empty((7, n, n)),
        np.empty((4, n)),
    )


@njit(cache=True, nogil=True)
def make_slots(model, capacity):
    """Room for `capacity` mode combinations."""
    n, n_w = model.B.shape
    n_z, n_H, n_s, n_y = model.C.shape[0], model.K.shape[1], model.S.shape[1], model.Yx.shape[0]
    n_e = model.mode_first.size - 1
    G = 0
    for e in range(n_e):
        most = 0
        for m in range(model.mode_first[e], model.mode_first[e + 1]):
            most = max(most, model.guard_first[m + 1] - model.guard_first[m])
        G += most
    q = capacity
    return Slots(
        np.zeros(1, np.int64),
        np.zeros((q, n_e), np.int64),
        np.zeros(q, np.int64),
        np.zeros(q),
        np.zeros(q),
        np.zeros(q, np.int64),
        np.empty((q, n, n)),
        np.empty((q, n), np.int64),
        np.empty((q, n, n), np.uint32),
        np.empty((q, n, n)),
        np.empty((q, n, n_H)),
        np.empty((q, n, n_s)),
        np.empty((q, n_w, n)),
        np.empty((q, n_w, n_H)),
        np.empty((q, n_w, n_s)),
        np.empty((q, n_z, n)),
        np.empty((q, n_z, n_H)),
        np.empty((q, n_z, n_s)),
        np.empty((q, n_y), np.int64),
        np.empty((q, n_y, n), np.uint32),
        np.empty((q, n_y, n)),
        np.empty((q, n_y, n_H)),
        np.empty((q, n_y, n_s)),
        np.zeros(q, np.int64),
        np.empty((q, G), np.int64),
        np.empty((q, G), np.int64),
        np.empty((q, G), np.int64),
        np.empty((q, G, n), np.uint32),
        np.empty((q, G, n)),
        np.empty((q, G), np.int64),
        np.empty((q, G, n), np.uint32),
        np.empty((q, G, n)),
        np.empty((q, G, n_H)),
        np.empty((q, G, n_s)),
        np.empty((q, G, n_s)),
        np.empty((q, G), np.int64),
        np.empty((q, G, n)),
        np.empty((q, G, n_H)),
        np.empty((q, n, 2 * n + 2 * G)),
        np.empty((q, n, G)),
        np.zeros(q, np.int64),
        np.empty((q, LONGS, n, 2 * n + 2 * G)),
        np.empty((q, LONGS, n, G)),
    )


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
    if not _compile(model, slots, work, q, modes):
        return -1
    _compile_guards(model, slots, work, q, modes)
    _choose_step(slots, work, q, base_step)
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
def _compile(model, slots, work, q, modes):
    """Affine system of the combination `modes` into slot q."""
    n, n_w = model.B.shape
    n_H, n_s, n_y = model.K.shape[1], model.S.shape[1], model.Yx.shape[0]
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
    linear = 1
    for j in range(n_s):
        for i in range(n):
            if rate[i, n + n_H + j] != 0.0:
                linear = 0
        for i in range(n_w):
            if F[i, n + n_H + j] != 0.0:
                linear = 0
        if model.smooth_kind[j] == 10:
            linear = 0
    slots.linear[q] = linear
    inputs[:, :] = 0.0
    _put(inputs, 0, model.C)
    _put(inputs, n, model.Kz)
    _add_product(inputs, model.D, F)
    signals[:, :] = 0.0
    _put(signals, 0, model.Yx)
    _put(signals, n, model.YH)
    _add_product(signals, model.Yw, F)
    for i in range(n):
        for j in range(n):
            slots.M[q, j, i] = rate[i, j]
        slots.M_count[q, i] = _sparse(rate[i, :n], slots.M_place[q, i], slots.M_value[q, i])
    _take(slots.N[q], rate, n)
    _take(slots.S[q], rate, n + n_H)
    _take(slots.Wx[q], F, 0)
    _take(slots.WH[q], F, n)
    _take(slots.Ws[q], F, n + n_H)
    _take(slots.Zx[q], inputs, 0)
    _take(slots.ZH[q], inputs, n)
    _take(slots.Zs[q], inputs, n + n_H)
    for i in range(n_y):
        slots.Y_count[q, i] = _sparse(signals[i, :n], slots.Y_place[q, i], slots.Y_value[q, i])
    _take(slots.YH[q], signals, n)
    _take(slots.Ys[q], signals, n + n_H)
    return True


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
def _compile_guards(model, slots, work, q, modes):
    """Guard rows of the combination, on state, rate, held values and smooth channels."""
    n, n_H, n_s = model.A.shape[0], model.K.shape[1], model.S.shape[1]
    ga, gb = work.row[0], work.row[1]
    k = 0
    for e in range(modes.size):
        m = model.mode_first[e] + modes[e]
        z0, w0, h0 = model.first[e, 0], model.first[e, 1], model.first[e, 2]
        n_ze, n_we, n_he = model.first[e + 1, 0] - z0, model.first[e + 1, 1] - w0, model.first[e + 1, 2] - h0
        for g in range(model.guard_first[m], model.guard_first[m + 1]):
            slots.guard[q, k] = g
            slots.next[q, k] = -1
            gH, gs, gt = slots.gH[q, k], slots.gs[q, k], slots.gt[q, k]
            for i in range(n):
                ga[i], gb[i] = 0.0, 0.0
            for i in range(n_H):
                gH[i] = 0.0
            for i in range(n_s):
                gs[i], gt[i] = 0.0, 0.0
            for a in range(n_ze):
                c, r = model.guard_z[g, a], model.guard_rate[g, a]
                _add_row(ga, c, slots.Zx[q, z0 + a])
                _add_row(gb, r, slots.Zx[q, z0 + a])
                _add_row(gH, c, slots.ZH[q, z0 + a])
                _add_row(gs, c, slots.Zs[q, z0 + a])
                _add_row(gt, r, slots.Zs[q, z0 + a])
            for a in range(n_we):
                c = model.guard_w[g, a]
                _add_row(ga, c, slots.Wx[q, w0 + a])
                _add_row(gH, c, slots.WH[q, w0 + a])
                _add_row(gs, c, slots.Ws[q, w0 + a])
            for a in range(n_he):
                gH[h0 + a] += model.guard_h[g, a]
            gH[n_H - 1] += model.guard_0[g]
            slots.ga_count[q, k] = _sparse(ga, slots.ga_place[q, k], slots.ga_value[q, k])
            slots.gb_count[q, k] = _sparse(gb, slots.gb_place[q, k], slots.gb_value[q, k])
            slots.smooth_guard[q, k] = 0
            for j in range(n_s):
                if gs[j] != 0.0 or gt[j] != 0.0:
                    slots.smooth_guard[q, k] = 1
            # With the rate put in, a row on state and held values alone.
            gf, gfH = slots.gf[q, k], slots.gfH[q, k]
            for i in range(n):
                gf[i] = ga[i]
            for i in range(n_H):
                gfH[i] = gH[i]
            for j in range(n):
                if gb[j] != 0.0:
                    for i in range(n):
                        gf[i] += gb[j] * slots.M[q, i, j]
                    _add_row(gfH, gb[j], slots.N[q, j])
            k += 1
    slots.n_guards[q] = k


@njit(**HOT)
def _add_row(out, factor, row):
    if factor != 0.0:
        for i in range(out.size):
            out[i] += factor * row[i]


@njit(**HOT)
def _sparse(row, place, value):
    """Entries of a row that are not zero; returns how many."""
    count = 0
    for i in range(row.size):
        if row[i] != 0.0:
            place[count], value[count] = i, row[i]
            count += 1
    return count


@njit(**HOT)
def _multiply(P, Q, out):
    """out = P Q for small matrices (no BLAS: its threads cost more than the product)."""
    n = P.shape[0]
    for i in range(n):
        for j in range(n):
            out[i, j] = 0.0
        for k in range(n):
            p = P[i, k]
            if p != 0.0:
                for j in range(n):
                    out[i, j] += p * Q[k, j]


@njit(**HOT)
def growth_rate(M, P, Q):
    """Bound on the growth of the powers of M: the 32nd root of the norm of its 32nd power [1/s]."""
    n = M.shape[0]
    size = 0.0
    for i in range(n):
        for j in range(n):
            P[i, j] = M[i, j]
            size = max(size, abs(P[i, j]))
    if size == 0.0:
        return 0.0
    for i in range(n):
        for j in range(n):
            P[i, j] /= size
    log_scale = 0.0
    for _ in range(5):
        _multiply(P, P, Q)
        P, Q = Q, P
        norm = 0.0
        for i in range(n):
            for j in range(n):
                norm += P[i, j] * P[i, j]
        if norm == 0.0:
            return 0.0
        norm = np.sqrt(norm)
        log_scale = 2.0 * log_scale + np.log(norm)
        for i in range(n):
            for j in range(n):
                P[i, j] /= norm
    return size * np.exp(log_scale / 32.0)


@njit(**HOT)
def flow(M, h, rate, integral, power, half, term, work):
    """exp(M h), its integral over [0, h], and exp(M h/2), into the arrays so named; M or its transpose, alike."""
    n = M.shape[0]
    doublings = 1
    while rate * h / 2.0**doublings > 0.5:
        doublings += 1
    d = h / 2.0**doublings
    for i in range(n):
        for j in range(n):
            term[i, j] = integral[i, j] = d if i == j else 0.0
    for k in range(2, 22):
        _multiply(M, term, work)  # in this order, because M has few entries
        largest = 0.0
        for i in range(n):
            for j in range(n):
                term[i, j] = work[i, j] * (d / k)
                integral[i, j] += term[i, j]
                largest = max(largest, abs(term[i, j]))
        if largest <= 1e-18 * d:
            break
    _multiply(M, integral, power)
    for i in range(n):
        power[i, i] += 1.0
    for k in range(doublings):
        if k == doublings - 1:
            _copy(half, power)
        _multiply(power, integral, work)
        for i in range(n):
            for j in range(n):
                integral[i, j] += work[i, j]
        _multiply(power, power, work)
        _copy(power, work)


@njit(**HOT)
def _copy(out, source):
    for i in range(out.shape[0]):
        for j in range(out.shape[1]):
            out[i, j] = source[i, j]


@njit(**HOT)
def _choose_step(slots, work, q, base_step):
    """Step of slot q: the base step, halved until the mode's motion is resolved; its matrices wait for their use."""
    rate = growth_rate(slots.M[q], work.square[0], work.square[1])
    h = base_step
    while rate * h > 6.0:
        h *= 0.5
    slots.step[q], slots.rate[q], slots.ready[q], slots.longs[q] = h, rate, 0, 0


@njit(**HOT)
def compile_step(slots, work, q):
    """Fill the matrices that carry state, rate and guards over the step of slot q."""
    M, h, rate, a = slots.M[q], slots.step[q], slots.rate[q], work.square
    n, G = M.shape[0], slots.n_guards[q]
    slots.ready[q] = 1
    integral, power, half = a[2], a[3], a[4]
    flow(M, h, rate, integral, power, half, a[5], a[6])
    bound = slots.bound[q]
    _fill_step(slots.T[q], slots.gf[q], G, integral, power)
    for g in range(G):
        twin = _twin(slots.gf[q], g)
        for i in range(n):
            bound[i, g] = bound[i, twin]
        if twin == g:
            _stray(slots, work, q, g, half, bound)


@njit(**HOT)
def _twin(gf, g):
    """An earlier guard on the same row but for its sign (two levels of one input), or the guard itself."""
    for k in range(g):
        same, mirrored = True, True
        for i in range(gf.shape[1]):
            same = same and gf[k, i] == gf[g, i]
            mirrored = mirrored and gf[k, i] == -gf[g, i]
        if same or mirrored:
            return k
    return g


@njit(**HOT)
def _stray(slots, work, q, g, half, bound):
    """Bound on how far guard g strays from the cubic through its end values: its fourth derivative over the step.

    The derivative is ``gf M^3 exp(M s) x'(0)``, bounded by its series about the middle.
    """
    M, h, n = slots.M[q], slots.step[q], half.shape[0]
    row, other, total = work.row[0], work.row[1], work.row[2]
    _apply(M, slots.gf[q, g], row)
    _apply(M, row, other)
    _apply(M, other, row)
    _apply(half, row, other)
    factor = 1.0
    for i in range(n):
        row[i], total[i] = other[i], abs(other[i])
    for k in range(1, 25):
        factor *= 0.5 * h / k
        _apply(M, row, other)
        grown = False
        for i in range(n):
            row[i] = other[i]
            total[i] += factor * abs(other[i])
            grown = grown or factor * abs(other[i]) > 1e-4 * total[i]
        if k > 8 and not grown:
            break
    for i in range(n):
        bound[i, g] = 1.001 * h**4 / 384.0 * total[i]


@njit(**HOT)
def compile_long(slots, work, q):
    """Fill the matrices of the next longer step of slot q, and the bound on its guards' travel."""
    n, G, level, a = slots.M.shape[1], slots.n_guards[q], slots.longs[q], work.square
    integral, power, product = a[2], a[3], a[4]
    T = slots.T[q] if level == 0 else slots.T_long[q, level - 1]
    reach = slots.reach[q, level]
    for i in range(n):
        for j in range(n):
            integral[i, j], power[i, j] = T[i, j], T[i, n + j]
    row, other = work.row[0], work.row[1]
    for g in range(G):
        if level == 0:
            _travel(slots, q, g, row, other, reach)
        else:
            for i in range(n):
                reach[i, g] = slots.reach[q, level - 1, i, g]
    for _ in range(LONG_DOUBLINGS):
        for g in range(G):
            for i in range(n):
                v = reach[i, g]
                for j in range(n):
                    v += abs(power[i, j]) * reach[j, g]
                row[i] = v
            for i in range(n):
                reach[i, g] = row[i]
        _multiply(power, integral, product)
        for i in range(n):
            for j in range(n):
                integral[i, j] += product[i, j]
        _multiply(power, power, product)
        _copy(power, product)
    _fill_step(slots.T_long[q, level], slots.gf[q], G, integral, power)
    slots.longs[q] = level + 1


@njit(**HOT)
def _travel(slots, q, g, row, other, reach):
    """Bound on how far guard g moves over the step of slot q, from the rate at the start, by its series."""
    n, h = slots.M.shape[1], slots.step[q]
    f = slots.gf[q, g]
    for i in range(n):
        row[i] = f[i]
        reach[i, g] = h * abs(f[i])
    factor = h
    for k in range(2, 64):
        factor *= h / k
        _apply(slots.M[q], row, other)
        grown = False
        for i in range(n):
            row[i] = other[i]
            v = factor * abs(other[i])
            reach[i, g] += v
            grown = grown or v > 1e-4 * reach[i, g]
        if k > 8 and not grown:
            break
    for i in range(n):
        reach[i, g] *= 1.001


@njit(**HOT)
def _fill_step(T, gf, G, integral, power):
    """Columns of T: state increment, rate, guard increments and guard rates at the end of a step."""
    n = integral.shape[0]
    _put(T, 0, integral)
    _put(T, n, power)
    for g in range(G):
        f = gf[g]
        for i in range(n):
            u, v = 0.0, 0.0
            for j in range(n):
                u += integral[i, j] * f[j]
                v += power[i, j] * f[j]
            T[i, 2 * n + g] = u
            T[i, 2 * n + G + g] = v


@njit(**HOT)
def _apply(M, row, out):
    """out = row @ (matrix whose transpose is M)."""
    n = row.size
    for i in range(n):
        v = 0.0
        for j in range(n):
            v += M[i, j] * row[j]
        out[i] = v
