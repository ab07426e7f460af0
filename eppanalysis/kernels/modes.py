"""Compiled: the affine system of one combination of element modes, and its exact step with bounds for the guards.

A hybrid system comes as flat arrays (`Model`). The combination of modes that a run visits is compiled on first visit
into a slot of `Slots`: state matrix, guard rows, and for one step h the matrices that carry state, rate and guards from
the start of the step to its end, with a bound on how far a guard can stray from the cubic through its end values.
"""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numba import njit

from eppanalysis.kernels.lanes import add, add_sizes, any_above, dot, padded, row_sum, take, take_sizes
from eppanalysis.kernels.tuples import by_address

#: The engine's functions allocate nothing, so that reference counts (which cost more than the arithmetic) are left out.
#: Products and sums may contract to one rounding; nothing else of the arithmetic is loosened.
ENTRY = {"cache": True, "nogil": True, "_nrt": False, "fastmath": {"contract"}}
#: Those that only kernels call: no way in from Python is compiled.
HOT = {**ENTRY, "no_cpython_wrapper": True, "no_cfunc_wrapper": True}
#: Those that are called at every step are also written into their caller: handing over all these arrays costs more than
#: most of them compute.
INLINE = {**HOT, "inline": "always"}

#: A long step is 2**4 steps of the grid, the longest 2**8.
LONG_DOUBLINGS, LONGS = 4, 2


@by_address
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


@by_address
class Slots(NamedTuple):
    """Compiled mode combinations (leading axis: slot).

    Lengths with a + are those of rows that are summed four numbers at a time: padded with zeros.
    """

    count: np.ndarray  # (2,) int: in use, ever used
    key: np.ndarray  # (q, E) int
    linear: np.ndarray  # (q,) int: no smooth channel acts
    step: np.ndarray  # (q,)
    rate: np.ndarray  # (q,) bound on the growth of the powers of M
    ready: np.ndarray  # (q,) int: whether T and bound are filled
    M: np.ndarray  # (q, n+, n+) transposed: M[j, i] = d x_i' / d x_j
    M_twice: np.ndarray  # (q, n+, n+) its square
    M_size: np.ndarray  # (q, n+, n+) its absolute values
    N: np.ndarray  # (q, n, H)
    S: np.ndarray  # (q, n, s)
    Wx: np.ndarray  # (q, w, n)
    WH: np.ndarray  # (q, w, H)
    Ws: np.ndarray  # (q, w, s)
    Zx: np.ndarray  # (q, z, n)
    ZH: np.ndarray  # (q, z, H)
    Zs: np.ndarray  # (q, z, s)
    Y: np.ndarray  # (q, n+, y+) transposed: signals on the state
    YH: np.ndarray  # (q, y, H)
    Ys: np.ndarray  # (q, y, s)
    n_guards: np.ndarray  # (q,) int
    guard: np.ndarray  # (q, G) int
    next: np.ndarray  # (q, G) int
    ga: np.ndarray  # (q, G, n+) guard rows on the state
    ga_count: np.ndarray  # (q, G) int: their entries that are not zero
    ga_place: np.ndarray  # (q, G, n) int
    ga_size: np.ndarray  # (q, G, n+) their absolute values
    gb: np.ndarray  # (q, G, n+) guard rows on the rate of the state
    gb_size: np.ndarray  # (q, G, n+)
    on_rate: np.ndarray  # (q, G) int: whether gb has an entry
    gH: np.ndarray  # (q, G, H)
    gs: np.ndarray  # (q, G, s)
    gt: np.ndarray  # (q, G, s): on the rates of the smooth channels
    smooth_guard: np.ndarray  # (q, G) int: whether gs or gt has an entry
    gf: np.ndarray  # (q, G, n+) guard rows on the state, with the rate put in
    gfH: np.ndarray  # (q, G, H)
    all_gf: np.ndarray  # (q, n+, G+) transposed: all of them
    reach_gf: np.ndarray  # (q, n+, G+) a trace more than their absolute values
    T: np.ndarray  # (q, n+, 2n+ + 2G+): from rate at start to state increment, rate, guard increments, guard rates
    bound: np.ndarray  # (q, n+, G+)
    longs: np.ndarray  # (q,) int: lengths of the next two that are filled
    T_long: np.ndarray  # (q, lengths, n+, 2n+ + 2G+): as T, over long steps
    reach: np.ndarray  # (q, lengths, n+, G+): bound on how far a guard moves on the way, from the rate at the start


@by_address
class Work(NamedTuple):
    """Scratch room for compiling a slot."""

    E: np.ndarray  # (w, w)
    F: np.ndarray  # (w, n + H + s)
    rate: np.ndarray  # (n, n + H + s)
    inputs: np.ndarray  # (z, n + H + s)
    signals: np.ndarray  # (y, n + H + s)
    square: np.ndarray  # (8, n+, n+)
    guards: np.ndarray  # (3, n+, G+)


def make_work(model: Model) -> Work:
    """Scratch room for a model's slots."""
    n, n_w = model.B.shape
    total = n + model.K.shape[1] + model.S.shape[1]
    return Work(
        np.empty((n_w, n_w)),
        np.empty((n_w, total)),
        np.empty((n, total)),
        np.empty((model.C.shape[0], total)),
        np.empty((model.Yx.shape[0], total)),
        np.zeros((8, padded(n), padded(n))),
        np.zeros((3, padded(n), padded(most_guards(model)))),
    )


def most_guards(model: Model) -> int:
    """Guards that a mode combination can have."""
    of_mode = np.diff(model.guard_first).tolist()
    return sum(max(of_mode[a:b], default=0) for a, b in pairwise(model.mode_first.tolist()))


def make_slots(model: Model, capacity: int) -> Slots:
    """Room for `capacity` mode combinations, each set to zero when it is first used (see :func:`clear`)."""
    n, n_w = model.B.shape
    n_z, n_H, n_s, n_y = model.C.shape[0], model.K.shape[1], model.S.shape[1], model.Yx.shape[0]
    n_e, G = model.mode_first.size - 1, most_guards(model)
    q, wide, steps = capacity, padded(n), 2 * padded(n) + 2 * padded(G)
    return Slots(
        np.zeros(2, np.int64),
        np.zeros((q, n_e), np.int64),
        np.zeros(q, np.int64),
        np.zeros(q),
        np.zeros(q),
        np.zeros(q, np.int64),
        np.empty((q, wide, wide)),
        np.empty((q, wide, wide)),
        np.empty((q, wide, wide)),
        np.empty((q, n, n_H)),
        np.empty((q, n, n_s)),
        np.empty((q, n_w, n)),
        np.empty((q, n_w, n_H)),
        np.empty((q, n_w, n_s)),
        np.empty((q, n_z, n)),
        np.empty((q, n_z, n_H)),
        np.empty((q, n_z, n_s)),
        np.empty((q, wide, padded(n_y))),
        np.empty((q, n_y, n_H)),
        np.empty((q, n_y, n_s)),
        np.zeros(q, np.int64),
        np.empty((q, G), np.int64),
        np.empty((q, G), np.int64),
        np.empty((q, G, wide)),
        np.empty((q, G), np.int64),
        np.empty((q, G, n), np.int64),
        np.empty((q, G, wide)),
        np.empty((q, G, wide)),
        np.empty((q, G, wide)),
        np.empty((q, G), np.int64),
        np.empty((q, G, n_H)),
        np.empty((q, G, n_s)),
        np.empty((q, G, n_s)),
        np.empty((q, G), np.int64),
        np.empty((q, G, wide)),
        np.empty((q, G, n_H)),
        np.empty((q, wide, padded(G))),
        np.empty((q, wide, padded(G))),
        np.empty((q, wide, steps)),
        np.empty((q, wide, padded(G))),
        np.zeros(q, np.int64),
        np.empty((q, LONGS, wide, steps)),
        np.empty((q, LONGS, wide, padded(G))),
    )


@njit(**HOT)
def clear(slots, q):
    """Set the rows of slot q to zero that are longer than what they hold."""
    slots.M[q], slots.M_twice[q], slots.M_size[q], slots.Y[q] = 0.0, 0.0, 0.0, 0.0
    slots.ga[q], slots.ga_size[q], slots.gb[q], slots.gb_size[q], slots.gf[q] = 0.0, 0.0, 0.0, 0.0, 0.0
    slots.all_gf[q], slots.reach_gf[q] = 0.0, 0.0
    slots.T[q], slots.bound[q], slots.T_long[q], slots.reach[q] = 0.0, 0.0, 0.0, 0.0


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
            slots.M[q, j, i], slots.M_size[q, j, i] = rate[i, j], abs(rate[i, j])
    _multiply(slots.M[q], slots.M[q], 1.0, slots.M_twice[q])
    _take(slots.N[q], rate, n)
    _take(slots.S[q], rate, n + n_H)
    _take(slots.Wx[q], F, 0)
    _take(slots.WH[q], F, n)
    _take(slots.Ws[q], F, n + n_H)
    _take(slots.Zx[q], inputs, 0)
    _take(slots.ZH[q], inputs, n)
    _take(slots.Zs[q], inputs, n + n_H)
    for i in range(n_y):
        for j in range(n):
            slots.Y[q, j, i] = signals[i, j]
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
    k = 0
    for e in range(modes.size):
        m = model.mode_first[e] + modes[e]
        z0, w0, h0 = model.first[e, 0], model.first[e, 1], model.first[e, 2]
        n_ze, n_we, n_he = model.first[e + 1, 0] - z0, model.first[e + 1, 1] - w0, model.first[e + 1, 2] - h0
        for g in range(model.guard_first[m], model.guard_first[m + 1]):
            slots.guard[q, k] = g
            slots.next[q, k] = -1
            ga, gb, gH, gs, gt = slots.ga[q, k], slots.gb[q, k], slots.gH[q, k], slots.gs[q, k], slots.gt[q, k]
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
            slots.on_rate[q, k] = slots.smooth_guard[q, k] = slots.ga_count[q, k] = 0
            for i in range(n):
                slots.ga_size[q, k, i], slots.gb_size[q, k, i] = abs(ga[i]), abs(gb[i])
                if ga[i] != 0.0:
                    slots.ga_place[q, k, slots.ga_count[q, k]] = i
                    slots.ga_count[q, k] += 1
                if gb[i] != 0.0:
                    slots.on_rate[q, k] = 1
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
            for i in range(n):
                slots.all_gf[q, i, k], slots.reach_gf[q, i, k] = gf[i], 1.000001 * abs(gf[i])
            k += 1
    slots.n_guards[q] = k
    # Columns that another combination may have left.
    slots.all_gf[q, :, k:] = slots.reach_gf[q, :, k:] = 0.0


@njit(**HOT)
def _add_row(out, factor, row):
    if factor != 0.0:
        for i in range(row.size):
            out[i] += factor * row[i]


@njit(**HOT)
def _multiply(P, Q, scale, out):
    """out = scale P Q for small matrices, padded (no BLAS: its threads cost more than the product)."""
    for i in range(P.shape[0]):
        row_sum(Q, P[i], scale, out[i])


@njit(**HOT)
def _add(out, P):
    """out += P."""
    for i in range(P.shape[0]):
        add(out[i], P[i])


@njit(**HOT)
def growth_rate(M, P, Q):
    """Bound on the growth of the powers of M (padded): the 32nd root of the norm of its 32nd power [1/s]."""
    n = M.shape[0]
    size = 0.0
    for i in range(n):
        size += dot(M[i], M[i])
    if size == 0.0:
        return 0.0
    _copy(P, M)
    log_scale, scale = 0.5 * np.log(size), 1.0 / size
    for _ in range(5):
        _multiply(P, P, scale, Q)
        P, Q = Q, P
        norm = 0.0
        for i in range(n):
            norm += dot(P[i], P[i])
        if norm == 0.0:
            return 0.0
        log_scale, scale = 2.0 * log_scale + 0.5 * np.log(norm), 1.0 / norm
    return np.exp(log_scale / 32.0)


@njit(**HOT)
def flow(M, h, rate, integral, power, half, term, work):
    """exp(M h), its integral over [0, h], and exp(M h/2), into the arrays so named; for M (padded) or its transpose."""
    n = M.shape[0]
    doublings = 1
    while rate * h / 2.0**doublings > 0.5:
        doublings += 1
    d = h / 2.0**doublings
    for i in range(n):
        for j in range(n):
            term[i, j] = integral[i, j] = d if i == j else 0.0
    for i in range(n):
        power[0, i] = 1e-18 * d
    for k in range(2, 22):
        _multiply(M, term, d / k, work)
        term, work = work, term
        _add(integral, term)
        if not _any_above(term, 1.0, power[0]):
            break
    _multiply(M, integral, 1.0, power)
    for i in range(n):
        power[i, i] += 1.0
    for k in range(doublings):
        if k == doublings - 1:
            _copy(half, power)
        _multiply(power, integral, 1.0, work)
        _add(integral, work)
        _multiply(power, power, 1.0, work)
        _copy(power, work)


@njit(**HOT)
def _any_above(P, scale, limits):
    """Whether a number of the matrix P is above the limit of its column."""
    for i in range(P.shape[0]):
        if any_above(P[i], scale, limits):
            return True
    return False


@njit(**HOT)
def _copy(out, source):
    for i in range(out.shape[0]):
        take(out[i], source[i])


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
    """Fill the matrices that carry state, rate and guards over the step of slot q.

    How far a guard strays from the cubic through its end values is bounded by its fourth derivative over the step,
    ``gf M^3 exp(M s) x'(0)``, by its series about the middle.
    """
    M, h, rate, a = slots.M[q], slots.step[q], slots.rate[q], work.square
    slots.ready[q] = 1
    integral, power, half = a[2], a[3], a[4]
    flow(M, h, rate, integral, power, half, a[5], a[6])
    _fill_step(slots.T[q], slots.gf[q], slots.n_guards[q], integral, power)
    P, Q = work.guards[0], work.guards[1]
    _multiply(M, slots.all_gf[q], 1.001 * h**4 / 384.0, P)
    _multiply(M, P, 1.0, Q)
    _multiply(M, Q, 1.0, P)
    _multiply(half, P, 1.0, Q)
    _sizes_of_powers(M, 0.5 * h, 0.0, Q, P, slots.bound[q])


@njit(**HOT)
def _sizes_of_powers(M, step, shift, P, Q, total):
    """total = sum of abs(M^k P) step^k shift!/(k + shift)! over k; P and Q are overwritten."""
    for i in range(P.shape[0]):
        take_sizes(total[i], P[i])
    factor = 1.0
    for k in range(1, 64):
        factor *= step / (k + shift)
        _multiply(M, P, 1.0, Q)
        P, Q = Q, P
        grown = k <= 8
        for i in range(P.shape[0]):
            add_sizes(total[i], P[i], factor)
            grown = grown or any_above(P[i], 1e4 * factor, total[i])
        if not grown:
            break


@njit(**HOT)
def compile_long(slots, work, q):
    """Fill the matrices of the next longer step of slot q, and the bound on its guards' travel."""
    n, level, a = slots.N.shape[1], slots.longs[q], work.square
    integral, power, product = a[2], a[3], a[4]
    T = slots.T[q] if level == 0 else slots.T_long[q, level - 1]
    reach = slots.reach[q, level]
    for i in range(n):
        for j in range(n):
            integral[i, j], power[i, j] = T[i, j], T[i, power.shape[0] + j]
    P, Q = work.guards[0], work.guards[1]
    if level == 0:
        h = slots.step[q]
        for i in range(power.shape[0]):
            for g in range(P.shape[1]):
                P[i, g] = 1.001 * h * slots.all_gf[q, i, g]
        _sizes_of_powers(slots.M[q], h, 1.0, P, Q, reach)
    else:
        _copy(reach, slots.reach[q, level - 1])
    for _ in range(LONG_DOUBLINGS):
        for i in range(power.shape[0]):
            take_sizes(product[i], power[i])
        _multiply(product, reach, 1.0, P)
        _add(reach, P)
        _multiply(power, integral, 1.0, product)
        _add(integral, product)
        _multiply(power, power, 1.0, product)
        _copy(power, product)
    _fill_step(slots.T_long[q, level], slots.gf[q], slots.n_guards[q], integral, power)
    slots.longs[q] = level + 1


@njit(**HOT)
def _fill_step(T, gf, G, integral, power):
    """Columns of T: state increment, rate, guard increments and guard rates at the end of a step."""
    wide = power.shape[0]
    half = (T.shape[1] - 2 * wide) // 2
    for i in range(wide):
        for j in range(wide):
            T[i, j], T[i, wide + j] = integral[i, j], power[i, j]
        for g in range(half):
            own = g < G
            T[i, 2 * wide + g] = dot(integral[i], gf[g]) if own else 0.0
            T[i, 2 * wide + half + g] = dot(power[i], gf[g]) if own else 0.0
