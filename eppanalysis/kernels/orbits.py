"""Compiled: a closed orbit as a chain of arcs between events, with the derivatives that Newton's method needs.

State and memory values of the loop are stacked into one vector ``y = (x, H)`` of N numbers, the last of which is 1 and
carries every constant. On an arc ``dy/dt = F y + S sigma(y)``, its end lies on a guard ``g y + gs sigma(y) = 0``, and
the event there maps y to ``J y``. Without smooth channels sigma the flow is a matrix exponential; with them it is a
Taylor series, and so is its derivative.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from eppanalysis.kernels.compiling import KERNEL, PART, njit
from eppanalysis.kernels.engine.curves import SQUARE, curve, curve_slope_term
from eppanalysis.kernels.engine.flow import flow, growth_rate
from eppanalysis.kernels.engine.modes import compile_guards, compile_modes
from eppanalysis.kernels.engine.series import DELAY_LINE, EPS, ORDER, _smooth_term
from eppanalysis.kernels.engine.tables import clear
from eppanalysis.kernels.filling import accumulate, fill, fill_rows, largest
from eppanalysis.kernels.simd.vectors import padded

READY, SINGULAR, NOT_A_GUARD, UNSUPPORTED = 0, 1, 2, 3
RECIPROCAL = 2
#: Series along one arc with smooth channels, at most: some tenths of a second.
MOST_SERIES = 10_000


class Channels(NamedTuple):
    """The smooth channels of a model, under the names that they have there."""

    smooth_kind: np.ndarray  # (s,) int
    smooth_x: np.ndarray  # (s, n)
    smooth_H: np.ndarray  # (s, H)
    smooth_scale: np.ndarray  # (s,)
    sense: np.ndarray  # (p, s): sign of the argument on each arc, for channels that depend on its magnitude


@njit(**KERNEL)
def build_arcs(model, compiled, work, modes, guards, timing, F, S, g, gs, J, smooth, sense, Y, Ys, W):
    """Fill the arrays of an orbit's arcs from the modes on them and the guards that end them.

    Parameters
    ----------
    model : eppanalysis.kernels.engine.tables.Model
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
    q = 0
    clear(compiled, q)
    for a in range(guards.size):
        if not compile_modes(model, compiled, work, q, modes[a]):
            return SINGULAR
        compile_guards(model, compiled, work, q, modes[a])
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
    """Memory values after the event; then the input of a sticking element is put on its level."""
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


@njit(**KERNEL)
def guard_at(channels, g, gs, smooth, end, sigma, slope, row):
    """Value of the guard that ends an arc, and its derivative by y into `row`, at the arc's end."""
    n = channels.smooth_x.shape[1]
    fill(row, g)
    value = 0.0
    for j in range(sigma.size):
        if smooth and gs[j] != 0.0:
            value += gs[j] * sigma[j]
            accumulate(row[:n], gs[j] * slope[j], channels.smooth_x[j])
            accumulate(row[n:], gs[j] * slope[j], channels.smooth_H[j])
    for j in range(end.size):
        value += g[j] * end[j]
    return value


@njit(**PART)
def _guard_equation(at_once, tau, value, row, E, A, r, place):
    """Row of Newton's equations for the dwell time of an arc (at `place`), and its residual."""
    if at_once == 1:
        A[place], r[0] = 1.0, tau
        return
    r[0] = value
    for i in range(row.size):
        if row[i] != 0.0:
            for j in range(place + 1):
                A[j] += row[i] * E[i, j]
    if at_once == 2 and tau != 0.0:
        # The arc begins on the guard that ends it: divide, so that Newton does not fall back on the begin.
        r[0] /= tau
        for j in range(place + 1):
            A[j] /= tau
        A[place] -= r[0] / tau


@njit(**KERNEL)
def sweep(channels, F, S, g, gs, J, smooth, at_once, y0, tau, free, shift, most, starts, ends, A, r, speed):
    """Run along the arcs from y0, and set up Newton's equations for the free part of y0 and the dwell times.

    Parameters
    ----------
    F, S, g, gs, J, smooth : arrays
        See :func:`build_arcs`.
    at_once : int array (p,)
        1 where the event follows the one before without delay (its dwell time is zero, whatever its guard); 2 where the
        arc begins on the guard that ends it (its equation is divided by the dwell time).
    y0, tau : arrays (N,), (p,)
        Start, dwell times.
    free : int array (m,)
        Places of y that must repeat.
    shift : array (N,)
        What a clock, and what is measured by it, advances per unit of time.
    most : int
        Series that may be made; the motion is not a number behind them.
    starts, ends : arrays (p + 1, N), (p, N)
        Filled with y behind and before each event.
    A, r : arrays (m + p, m + p), (m + p,)
        Filled with the derivative and the residual of (periodicity, guards).
    speed : array (p,)
        Filled with the rate at which each guard is crossed.

    Returns
    -------
    int
        Series that were made, those that did not converge too.
    """
    p, n, N = F.shape
    m, made = free.size, 0
    sigma = np.zeros(S.shape[2])
    slope = np.zeros(S.shape[2])
    D, E, row = np.zeros((N, m + p)), np.zeros((N, m + p)), np.zeros(N)
    Phi, rate = np.zeros((N, N)), np.zeros(N)
    square = room(F)
    A[:, :], r[:] = 0.0, 0.0
    for k in range(m):
        D[free[k], k] = 1.0
    y = y0.copy()
    for a in range(p):
        fill(starts[a], y)
        if smooth[a]:
            made += smooth_flow(
                channels, channels.sense[a], F[a], S[a], y, tau[a], most - made, ends[a], Phi, sigma, slope
            )
        else:
            sigma[:], slope[:] = 0.0, 0.0
            affine_flow(F[a], y, tau[a], ends[a], Phi, square)
        end = ends[a]
        _times(Phi, D, E, n, m + a)
        value = guard_at(channels, g[a], gs[a], smooth[a], end, sigma, slope, row)
        _rate(F[a], S[a], end, sigma, rate)
        for i in range(N):
            E[i, m + a] = rate[i]
        speed[a] = 0.0
        for j in range(N):
            speed[a] += row[j] * rate[j]
        _guard_equation(at_once[a], tau[a], value, row, E, A[m + a], r[m + a :], m + a)
        for i in range(N):
            v = 0.0
            for j in range(N):
                v += J[a, i, j] * end[j]
            y[i] = v
        _times(J[a], E, D, N, m + a + 1)
    fill(starts[p], y)
    total = tau.sum()
    for k in range(m):
        i = free[k]
        r[k] = y[i] - y0[i] - shift[i] * total
        for j in range(m + p):
            A[k, j] = D[i, j]
        A[k, k] -= 1.0
        if shift[i] != 0.0:
            for a in range(p):
                A[k, m + a] -= shift[i]
    return made


@njit(**PART)
def _times(P, Q, out, n_dense, n_columns):
    """out = P Q over the first columns; rows of P from n_dense on are those of the identity."""
    N = P.shape[0]
    for i in range(n_dense):
        for j in range(n_columns):
            out[i, j] = 0.0
        for k in range(N):
            f = P[i, k]
            if f != 0.0:
                for j in range(n_columns):
                    out[i, j] += f * Q[k, j]
    for i in range(n_dense, N):
        for j in range(n_columns):
            out[i, j] = Q[i, j]


@njit(**KERNEL)
def room(F):
    """Room for the flow of the states that move of themselves or one another; those behind are clocks.

    With dead time an orbit has a clock for each switch on its way: a hundred of them beside two states of a plant.
    """
    p, n, _ = F.shape
    moving = 1
    for a in range(p):
        for i in range(n):
            for j in range(n):
                if F[a, i, j] != 0.0:
                    moving = max(moving, i + 1, j + 1)
    return np.zeros((8, padded(moving), padded(moving)))


@njit(**KERNEL)
def affine_flow(F, y, tau, end, Phi, square):
    """State at the end of an affine arc, and its derivative; `square` is what `room` gave."""
    n, N = F.shape
    moving = min(n, square.shape[1])
    M, integral, power = square[0], square[1], square[2]
    for i in range(moving):
        for j in range(moving):
            M[i, j] = F[i, j]
    if tau == 0.0:
        integral[:, :] = 0.0
        fill_rows(power, np.eye(power.shape[0]))
    else:
        rate = growth_rate(M, square[3], square[4])
        flow(M, tau, rate, integral, power, square[5], square[6], square[7])
    Phi[:, :] = 0.0
    for i in range(N):
        end[i] = y[i]
        Phi[i, i] = 1.0
    for i in range(moving):
        v = 0.0
        for j in range(N):
            v += F[i, j] * y[j]
        for k in range(moving):
            end[k] += integral[k, i] * v
        for j in range(moving):
            Phi[i, j] = power[i, j]
        for k in range(moving):
            f = integral[i, k]
            if f != 0.0:
                for j in range(n, N):
                    Phi[i, j] += f * F[k, j]
    for i in range(moving, n):
        for j in range(n, N):
            end[i] += tau * F[i, j] * y[j]
            Phi[i, j] = tau * F[i, j]


@njit(**KERNEL)
def smooth_flow(channels, sense, F, S, y, tau, most, end, Phi, sigma, slope):
    """State at the end of an arc with smooth channels, its derivative, and there the channels with their slopes.

    Returns the number of series made. The end is not a number where it is not reached with `most` of them: the stiffer
    the motion, the shorter its series.
    """
    n, N = F.shape
    n_s = S.shape[1]
    H = y[n:].copy()
    X, V = np.zeros((ORDER + 1, n)), np.zeros((ORDER + 1, n, N))
    workspace = np.zeros((4, ORDER + 1, n_s))
    row = np.zeros((ORDER + 1, N))
    square = np.zeros((3, padded(n), padded(n)))
    fill_rows(square[0, :n, :n], F)
    rate = growth_rate(square[0], square[1], square[2])
    x, P = y[:n].copy(), np.zeros((n, N))
    for i in range(n):
        P[i, i] = 1.0
    done, d = 0.0, abs(tau)
    while rate * d > 1.0:
        d *= 0.5
    if tau < 0.0:
        d = -d
    made, last = 0, False
    while not last:
        last = abs(done + d) >= abs(tau) * (1.0 - 1e-14)
        h = tau - done if last else d
        if made >= most or not abs(d) >= 1e-12 * abs(tau):
            x[:], P[:, :] = np.nan, np.nan
            break
        fill(X[0], x)
        fill_rows(V[0], P)
        made += 1
        if not _series(channels, sense, F, S, H, h, X, V, workspace, row):
            d, last = 0.5 * h, False
            continue
        for k in range(ORDER - 1, -1, -1):
            accumulate(X[ORDER], 1.0, X[k])
            for i in range(n):
                accumulate(V[ORDER, i], 1.0, V[k, i])
        fill(x, X[ORDER])
        fill_rows(P, V[ORDER])
        X[ORDER], V[ORDER] = 0.0, 0.0
        done += h
    fill(end[:n], x)
    fill(end[n:], H)
    Phi[:, :] = 0.0
    fill_rows(Phi[:n], P)
    for i in range(n, N):
        Phi[i, i] = 1.0
    _channels(channels, sense, x, H, sigma, slope)
    return made


@njit(**PART)
def _series(channels, sense, F, S, H, h, X, V, workspace, row):
    """Series of state and derivative over the step h, all but the last order; False when they do not converge."""
    n, N = F.shape
    n_s = S.shape[1]
    Sg, arg, aux, slope = workspace[0], workspace[1], workspace[2], workspace[3]
    size = largest(X[:1]) + 1e-300
    size_v = largest(V[0])
    for k in range(ORDER - 1):
        for j in range(n_s):
            if channels.smooth_kind[j] != DELAY_LINE:
                _channel_term(channels, sense, j, k, X, H, Sg, arg, aux, slope)
        factor = h / (k + 1)
        for i in range(n):
            v = 0.0
            for j in range(n):
                v += F[i, j] * X[k, j]
            if k == 0:
                for j in range(H.size):
                    v += F[i, n + j] * H[j]
            for j in range(n_s):
                v += S[i, j] * Sg[k, j]
            X[k + 1, i] = v * factor
        V[k + 1] = 0.0
        for i in range(n):
            for c in range(n):
                if F[i, c] != 0.0:
                    accumulate(V[k + 1, i], F[i, c], V[k, c])
            if k == 0:
                accumulate(V[1, i, n:], 1.0, F[i, n:])
        for j in range(n_s):
            if channels.smooth_kind[j] == DELAY_LINE:
                continue
            row[k] = 0.0
            for c in range(k + 1):
                for i in range(n):
                    accumulate(row[k], slope[k - c, j] * channels.smooth_x[j, i], V[c, i])
            accumulate(row[k, n:], slope[k, j], channels.smooth_H[j])
            for i in range(n):
                accumulate(V[k + 1, i], S[i, j], row[k])
        for i in range(n):
            for j in range(N):
                V[k + 1, i, j] *= factor
    tail = largest(X[ORDER - 1 : ORDER]) + largest(X[ORDER - 2 : ORDER - 1])
    tail_v = largest(V[ORDER - 1]) + largest(V[ORDER - 2])
    return tail <= 0.5 * EPS * size and tail_v <= EPS * size_v


@njit(**PART)
def _channel_term(model, sense, j, k, X, H, Sg, arg, aux, slope):
    """Coefficient k of smooth channel j and of its derivative with respect to its argument."""
    kind, scale = model.smooth_kind[j], model.smooth_scale[j]
    if kind != RECIPROCAL:
        _smooth_term(model, j, k, X, H, Sg, arg, aux)
        if kind >= SQUARE:
            slope[k, j] = curve_slope_term(kind, j, k, scale, Sg, arg, aux)
        else:
            slope[k, j] = aux[k, j] if kind == 0 else 3.0 * scale * aux[k, j]
        return
    # scale/(1 + s a), with the sign s of the mode: at breakaway the argument and its rate are both zero.
    v = 0.0
    for i in range(X.shape[1]):
        v += model.smooth_x[j, i] * X[k, i]
    if k == 0:
        for i in range(H.size):
            v += model.smooth_H[j, i] * H[i]
    arg[k, j] = v
    s = sense[j]
    v = scale if k == 0 else 0.0
    for i in range(1, k + 1):
        v -= s * arg[i, j] * Sg[k - i, j]
    Sg[k, j] = v / (1.0 + s * arg[0, j])
    v = 0.0
    for i in range(k + 1):
        v += Sg[i, j] * Sg[k - i, j]
    slope[k, j] = -s * v / scale if scale != 0.0 else 0.0


@njit(**PART)
def _channels(model, sense, x, H, sigma, slope):
    """Values and slopes of the smooth channels at the end of an arc."""
    for j in range(sigma.size):
        kind, scale = model.smooth_kind[j], model.smooth_scale[j]
        a = 0.0
        for i in range(x.size):
            a += model.smooth_x[j, i] * x[i]
        for i in range(H.size):
            a += model.smooth_H[j, i] * H[i]
        if kind == 0:
            sigma[j], slope[j] = scale * np.sin(a), scale * np.cos(a)
        elif kind == 1:
            sigma[j], slope[j] = scale * a**3, 3.0 * scale * a * a
        elif SQUARE <= kind < DELAY_LINE:
            value, rate = curve(kind, a)
            sigma[j], slope[j] = scale * value, scale * rate
        elif kind != DELAY_LINE:
            sigma[j] = scale / (1.0 + sense[j] * a)
            slope[j] = -sense[j] * sigma[j] * sigma[j] / scale if scale != 0.0 else 0.0


@njit(**KERNEL)
def states_at(channels, F, S, smooth, starts, marks, times, out):
    """y at increasing `times` of one period, each by its own flow from the start of its arc."""
    p, n, N = F.shape
    square, Phi = room(F), np.zeros((N, N))
    sigma, slope = np.zeros(S.shape[2]), np.zeros(S.shape[2])
    a = 0
    for i in range(times.size):
        while a < p - 1 and times[i] > marks[a + 1]:
            a += 1
        t = times[i] - marks[a]
        if smooth[a]:
            smooth_flow(channels, channels.sense[a], F[a], S[a], starts[a], t, MOST_SERIES, out[i], Phi, sigma, slope)
        else:
            affine_flow(F[a], starts[a], t, out[i], Phi, square)


@njit(**KERNEL)
def extents(channels, F, S, smooth, Y, Ys, starts, tau, low, high):
    """Smallest and largest value of every signal over an orbit, exact: nodes on every arc, then Newton on the rate."""
    p, n, N = F.shape
    n_y, steps = Y.shape[1], 8
    node, rate = np.zeros((steps + 1, N)), np.zeros(N)
    value, slope = np.zeros((steps + 1, n_y)), np.zeros((steps + 1, n_y))
    square, Phi, row = room(F), np.zeros((N, N)), np.zeros(N)
    sigma, change = np.zeros(S.shape[2]), np.zeros(S.shape[2])
    low[:], high[:] = np.inf, -np.inf
    for a in range(p):
        if tau[a] <= 0.0:
            continue
        d = tau[a] / steps
        fill(node[0], starts[a])
        for k in range(steps + 1):
            if k and smooth[a]:
                smooth_flow(
                    channels, channels.sense[a], F[a], S[a], node[k - 1], d, MOST_SERIES, node[k], Phi, sigma, change
                )
            elif k == 1:
                affine_flow(F[a], node[0], d, node[1], Phi, square)
            elif k:
                _carry(Phi, node[k - 1], node[k], n)
            _channels(channels, channels.sense[a], node[k, :n], node[k, n:], sigma, change)
            _rate(F[a], S[a], node[k], sigma, rate)
            for s in range(n_y):
                value[k, s], slope[k, s] = 0.0, 0.0
                for j in range(N):
                    value[k, s] += Y[a, s, j] * node[k, j]
                    slope[k, s] += Y[a, s, j] * rate[j]
                for j in range(sigma.size):
                    if smooth[a]:
                        value[k, s] += Ys[a, s, j] * sigma[j]
        for s in range(n_y):
            for k in range(steps + 1):
                low[s], high[s] = min(low[s], value[k, s]), max(high[s], value[k, s])
        for s in range(n_y):
            for k in range(steps):
                turns_over = slope[k, s] > 0.0 and slope[k + 1, s] < 0.0
                if not turns_over and not (slope[k, s] < 0.0 and slope[k + 1, s] > 0.0):
                    continue
                reach = 0.15 * d * (abs(slope[k, s]) + abs(slope[k + 1, s]))
                if turns_over and max(value[k, s], value[k + 1, s]) + reach <= high[s]:
                    continue
                if not turns_over and min(value[k, s], value[k + 1, s]) - reach >= low[s]:
                    continue
                left, right = slope[k, s], slope[k + 1, s]
                v = _turning_value(
                    channels, a, F[a], S[a], smooth[a], Y[a, s], Ys[a, s], node[k], d, left, right, row, square
                )
                low[s], high[s] = min(low[s], v), max(high[s], v)


@njit(**PART)
def _carry(Phi, y, out, n):
    """One more step of an affine arc."""
    N = y.size
    for i in range(n):
        v = 0.0
        for j in range(N):
            v += Phi[i, j] * y[j]
        out[i] = v
    for i in range(n, N):
        out[i] = y[i]


@njit(**PART)
def _rate(F, S, y, sigma, rate):
    for i in range(F.shape[0]):
        v = 0.0
        for j in range(y.size):
            v += F[i, j] * y[j]
        for j in range(sigma.size):
            v += S[i, j] * sigma[j]
        rate[i] = v


@njit(**PART)
def _turning_value(channels, a, F, S, smooth, Y, Ys, y, d, left, right, end, square):
    """Value of a signal where its rate vanishes inside a step, by regula falsi (Illinois) on the rate."""
    N = y.size
    Phi, rate = np.zeros((N, N)), np.zeros(N)
    sigma, change = np.zeros(S.shape[1]), np.zeros(S.shape[1])
    t0, t1, value = 0.0, d, 0.0
    for _ in range(12):
        t = (t0 * right - t1 * left) / (right - left)
        if smooth:
            smooth_flow(channels, channels.sense[a], F, S, y, t, MOST_SERIES, end, Phi, sigma, change)
        else:
            affine_flow(F, y, t, end, Phi, square)
        _rate(F, S, end, sigma, rate)
        value, slope = 0.0, 0.0
        for j in range(N):
            value += Y[j] * end[j]
            slope += Y[j] * rate[j]
        if smooth:
            for j in range(sigma.size):
                value += Ys[j] * sigma[j]
        if slope * right > 0.0:
            t1, right, left = t, slope, 0.5 * left
        else:
            t0, left, right = t, slope, 0.5 * right
        # The value is off by the rate times what is left of the interval, to second order.
        if abs(slope) * d <= 1e-9 * abs(value) or t1 - t0 <= 1e-9 * d:
            break
    return value
