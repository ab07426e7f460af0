"""Compiled: the arcs of an orbit: rates, guards and maps of events, from the modes and the guards that end them.

State and memory values of the loop are stacked into one vector ``y = (x, H)`` of N numbers, the last of which is 1 and
carries every constant. On an arc ``dy/dt = F y + S sigma(y)``, its end lies on a guard ``g y + gs sigma(y) = 0``, and
the event there maps y to ``J y`` (docs/theory/exact_orbits.md, "Closing an orbit").
"""

import numpy as np

from eppanalysis.kernels.compiling import KERNEL, PART, njit
from eppanalysis.kernels.engine.modes import find_combination
from eppanalysis.kernels.engine.series import DELAY_LINE
from eppanalysis.kernels.filling import accumulate, fill, fill_rows

READY, SINGULAR, NOT_A_GUARD, UNSUPPORTED = 0, 1, 2, 3


@njit(**KERNEL)
def build_arcs(model, compiled, work, base_step, modes, guards, timing, F, S, g, gs, J, smooth, sense, Y, Ys, W):
    """Fill the arrays of an orbit's arcs from the modes on them and the guards that end them.

    Parameters
    ----------
    model, compiled, work : eppanalysis.kernels.engine.tables.Model, Combinations, Work
        Mode combinations that runs with steps of `base_step` have met are compiled already.
    modes, guards, timing : int arrays (p, E), (p,), (p,)
        Modes on each arc; number of the guard at its end, -1 for none, and of the guard that tells when that is.
    F, S : arrays (p, n, N), (p, n, s)
        Rate of the state.
    g, gs : arrays (p, N), (p, s)
        Guard.
    J : array (p, N, N)
        Map of the event.
    smooth : int array (p,)
        Whether a smooth channel acts.
    sense : array (p, s)
        Sign of the argument of each smooth channel on each arc, where its element slips (friction).
    Y, Ys : arrays (p, y, N), (p, y, s)
        Signals.
    W : array (p, w, N)
        Outputs of the elements, but for smooth channels.

    Returns
    -------
    int
        READY, or why the arcs cannot be had.
    """
    n, n_s, n_H = model.A.shape[0], model.S.shape[1], model.K.shape[1]
    for a in range(guards.size):
        q = find_combination(model, compiled, work, modes[a], base_step)
        if q < 0:
            return SINGULAR
        for i in range(n):
            for j in range(n):
                F[a, i, j] = compiled.M[q, j, i]
            fill(F[a, i, n:], compiled.N[q, i])
            fill(S[a, i], compiled.S[q, i])
        for i in range(Y.shape[1]):
            for j in range(n):
                Y[a, i, j] = compiled.Y[q, j, i]
            fill(Y[a, i, n:], compiled.YH[q, i])
            fill(Ys[a, i], compiled.Ys[q, i])
        fill_rows(W[a, :, :n], compiled.Wx[q])
        fill_rows(W[a, :, n:], compiled.WH[q])
        fill_rows(J[a], np.eye(n + n_H))
        g[a], gs[a] = 0.0, 0.0
        if guards[a] >= 0:
            code = _guard_rows(model, compiled, q, timing[a], g[a], gs[a])
            if code == READY:
                code = _event_map(model, compiled, q, guards[a], modes[(a + 1) % guards.size], J[a])
            if code != READY:
                return code
        smooth[a] = 0
        for j in range(n_s):
            # The weight with which a slipping mode lets the function act has the sign of its velocity, which at
            # breakaway is zero and tells nothing.
            sense[a, j] = 1.0
            for e in range(modes.shape[1]):
                if model.mode_ws[model.mode_first[e] + modes[a, e], 0, j] < 0.0:
                    sense[a, j] = -1.0
            if model.smooth_kind[j] != DELAY_LINE and (np.any(S[a, :, j] != 0.0) or gs[a, j] != 0.0):
                smooth[a] = 1
    return READY


@njit(**PART)
def _guard_rows(model, compiled, q, guard, g, gs):
    """Row of a guard on y and on the smooth channels, rates put in."""
    n = model.A.shape[0]
    for k in range(compiled.n_guards[q]):
        if compiled.guard[q, k] != guard:
            continue
        fill(g[:n], compiled.gf[q, k])
        fill(g[n:], compiled.gfH[q, k])
        for j in range(gs.size):
            if compiled.gt[q, k, j] != 0.0:
                return UNSUPPORTED
            gs[j] = compiled.gs[q, k, j]
            for i in range(n):
                gs[j] += compiled.gb[q, k, i] * compiled.S[q, i, j]
        return READY
    return NOT_A_GUARD


@njit(**PART)
def _event_map(model, compiled, q, guard, after, J):
    """Memory values and the state after the event; then the input of a sticking element is put on its level."""
    n, n_H = model.A.shape[0], model.K.shape[1]
    e = model.guard_element[guard]
    z0, w0, h0 = model.first[e, 0], model.first[e, 1], model.first[e, 2]
    for a in range(model.first[e + 1, 2] - h0):
        row = J[n + h0 + a]
        row[:] = 0.0
        row[n + n_H - 1] = model.reset_0[guard, a]
        for b in range(model.first[e + 1, 2] - h0):
            row[n + h0 + b] += model.reset_h[guard, a, b]
        for b in range(model.first[e + 1, 0] - z0):
            c = model.reset_z[guard, a, b]
            if c != 0.0:
                if np.any(compiled.Zs[q, z0 + b] != 0.0):
                    return UNSUPPORTED
                accumulate(row[:n], c, compiled.Zx[q, z0 + b])
                accumulate(row[n:], c, compiled.ZH[q, z0 + b])
    for b in range(model.first[e + 1, 0] - z0):
        c = model.guard_impulse[guard, b]
        if c != 0.0:
            if np.any(compiled.Zs[q, z0 + b] != 0.0):
                return UNSUPPORTED
            for i in range(n):
                if model.B[i, w0] != 0.0:
                    accumulate(J[i, :n], c * model.B[i, w0], compiled.Zx[q, z0 + b])
                    accumulate(J[i, n:], c * model.B[i, w0], compiled.ZH[q, z0 + b])
    # As the engine settles it behind the event, so that both have the same map.
    m = model.mode_first[e] + after[e]
    if model.mode_stick[m]:
        _level_map(J, model.C[z0], model.Kz[z0], model.mode_level[m], model.B[:, w0])
    return READY


@njit(**PART)
def _level_map(J, c, on_memory, level, b):
    """Let the event map J end with ``c x + on_memory H = level``."""
    n, N = c.size, J.shape[0]
    left = np.zeros(N)
    left[N - 1] = -level
    alone, count, scale = -1, 0, 0.0
    for i in range(n):
        if c[i] != 0.0:
            alone, count = i, count + 1
            scale += c[i] * b[i]
    # What misses the level behind the event is taken off along b, the direction in which the element acts, or off the
    # one state that is the input: as the engine settles it (`settle_on_level`).
    for j in range(on_memory.size):
        if on_memory[j] != 0.0:
            accumulate(left, on_memory[j], J[n + j])
    if count == 1:
        for j in range(N):
            J[alone, j] = -left[j] / c[alone]
        return
    for i in range(n):
        if c[i] != 0.0:
            accumulate(left, c[i], J[i])
    for i in range(n):
        if b[i] != 0.0:
            accumulate(J[i], -b[i] / scale, left)
