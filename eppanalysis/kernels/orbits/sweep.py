"""Compiled: once along the arcs of an orbit, with Newton's equations for its start and its dwell times.

The equations and their unknowns are those of docs/theory/exact_orbits.md, "Closing an orbit".
"""

import numpy as np

from eppanalysis.kernels.compiling import KERNEL, PART, njit
from eppanalysis.kernels.filling import accumulate, fill
from eppanalysis.kernels.orbits.flow import (
    MOST_SERIES,
    affine_change,
    affine_flow,
    numbers_of,
    rate_at,
    room,
    smooth_flow,
)


@njit(**PART)
def guard_at(channels, g, gs, smooth, end, sigma, slope, row):
    """Value of the guard that ends an arc, and its derivative by y into `row`, at the arc's end."""
    fill(row, g)
    value = _guard_channels(channels, gs, sigma, slope, row) if smooth else 0.0
    for j in range(end.size):
        value += g[j] * end[j]
    return value


@njit(**PART)
def _guard_channels(channels, gs, sigma, slope, row):
    """What the smooth channels add to a guard's value, and to its derivative by y in `row`."""
    value = 0.0
    if channels is None:
        return value
    n, weight = channels.smooth_x.shape[1], _weights(channels, gs, slope)
    for j in range(sigma.size - 1, -1, -1):
        value += gs[j] * sigma[j]
        through = weight[j] * slope[j]
        if through != 0.0:
            accumulate(row[:n], through, channels.smooth_x[j])
            accumulate(row[n:], through, channels.smooth_H[j])
    return value


@njit(**PART)
def _weights(channels, gs, slope):
    """Derivative of a guard by each smooth channel, by way of those that have it in their argument too."""
    weight = gs.copy()
    # From the last channel back: each hands its weight on to those in its argument.
    for j in range(weight.size - 1, 0, -1):
        through = weight[j] * slope[j]
        for i in range(j):
            weight[i] += through * channels.smooth_s[j, i]
    return weight


@njit(**PART)
def _along(channels, a, F, S, g, gs, smooth, y, tau, end, Phi, sigma, row):
    """Arc a from y: fill its end and the derivative Phi of that, the channels there, and the guard's derivative."""
    n, N = F.shape
    slope = np.zeros(S.shape[1])
    sigma[:] = 0.0
    if smooth:
        own = numbers_of(channels, F, S)
        smooth_flow(channels, a, F, S, y, tau, MOST_SERIES, end, Phi, sigma, slope, own)
    else:
        affine_flow(F, y, tau, end, Phi, room(F.reshape((1, n, N))))
    guard_at(channels, g, gs, smooth, end, sigma, slope, row)


@njit(**KERNEL)
def carry(channels, F, S, g, gs, J, smooth, at_once, starts, tau, D):
    """Carry disturbances of the start, the columns of D (N, m), along arcs from known starts and through their events.

    A number that is none comes back where a guard is only touched.
    """
    p, n, N = F.shape
    m, Phi, E = D.shape[1], np.zeros((N, N)), np.zeros((N, D.shape[1]))
    end, row, sigma, rate = np.zeros(N), np.zeros(N), np.zeros(S.shape[2]), np.zeros(n)
    for a in range(p):
        _along(channels, a, F[a], S[a], g[a], gs[a], smooth[a], starts[a], tau[a], end, Phi, sigma, row)
        _times(Phi, D, E, n, m)
        if at_once[a] != 1:  # the instant of a sample stands
            # A switch of another element comes sooner or later with the start: by that time, at the arc's rate, the
            # disturbance ends elsewhere (docs/theory/sampled.md, Exact orbits).
            rate_at(F[a], S[a], end, sigma, rate)
            speed = 0.0
            for i in range(n):
                speed += row[i] * rate[i]
            for j in range(m):
                sooner = 0.0
                for i in range(N):
                    sooner += row[i] * E[i, j]
                if sooner != 0.0:
                    accumulate(E[:n, j], -sooner / speed if speed != 0.0 else np.nan, rate)
        _times(J[a], E, D, N, m)


@njit(**PART)
def _guard_change(channels, by, dg, dgs, gs, smooth, end, sigma, slope):
    """Change of the guard that ends an arc with a parameter, the state at its end held; `by` has the derivatives."""
    value = 0.0
    for j in range(end.size):
        value += dg[j] * end[j]
    if channels is None or not smooth:
        return value
    n, weight = channels.smooth_x.shape[1], _weights(channels, gs, slope)
    for j in range(sigma.size - 1, -1, -1):
        value += dgs[j] * sigma[j]
        through = weight[j] * slope[j]
        for i in range(n):
            value += through * by.smooth_x[j, i] * end[i]
        for i in range(n, end.size):
            value += through * by.smooth_H[j, i - n] * end[i]
        for i in range(j):
            value += through * by.smooth_s[j, i] * sigma[i]
        if channels.smooth_scale[j] != 0.0:
            value += weight[j] * by.smooth_scale[j] / channels.smooth_scale[j] * sigma[j]
    return value


@njit(**PART)
def _guard_equation(at_once, tau, value, row, E, A, r, place):
    """Row of Newton's equations for the dwell time of an arc (at `place`), and its residual."""
    if at_once == 1:
        # Of events at one instant only the first waits for its guard.
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


@njit(**PART)
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
    # E and D carry the derivative of y before and behind each event, by the free part of the start and by the dwell
    # times so far: one pass gives the residual and Newton's matrix, from which the multipliers come, too.
    for k in range(m):
        D[free[k], k] = 1.0
    y = y0.copy()
    for a in range(p):
        fill(starts[a], y)
        if smooth[a]:
            own = numbers_of(channels, F[a], S[a])
            made += smooth_flow(channels, a, F[a], S[a], y, tau[a], most - made, ends[a], Phi, sigma, slope, own)
        else:
            sigma[:], slope[:] = 0.0, 0.0
            affine_flow(F[a], y, tau[a], ends[a], Phi, square)
        end = ends[a]
        _times(Phi, D, E, n, m + a)
        value = guard_at(channels, g[a], gs[a], smooth[a], end, sigma, slope, row)
        rate_at(F[a], S[a], end, sigma, rate)
        # A later end of this arc moves the state by its rate: the column of the dwell time.
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
        # Periodicity: y behind the last event less y0, but for what a clock advances by in a period.
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
def sweep_by(
    channels, F, S, g, gs, J, smooth, at_once, starts, tau, free, of_channels, dF, dS, dg, dgs, dJ, dshift, dy, out
):
    """Derivative of the equations that `sweep` sets up by a parameter of which all numbers are functions.

    Parameters
    ----------
    starts : array (p + 1, N)
        As `sweep` fills them.
    of_channels, dF, dS, dg, dgs, dJ, dshift : Channels and arrays
        Derivatives of the numbers by the parameter.
    dy : array (N,)
        Derivative of the start; that of a driven loop's inputs. Behind the call that of the end.
    out : array (m + p,)
        Filled with the derivative of the residual at fixed start and dwell times.
    """
    p, _, N = F.shape
    m = free.size
    sigma, slope = np.zeros(S.shape[2]), np.zeros(S.shape[2])
    end, moved, row, Phi = np.zeros(N), np.zeros(N), np.zeros(N), np.zeros((N, N))
    square, wide = room(F), np.zeros((N, N + 1))
    begin = dy.copy()
    # Forward mode: beside the state goes its change with the parameter, through every arc and every event.
    for a in range(p):
        by = numbers_of(of_channels, dF[a], dS[a])
        if smooth[a]:
            smooth_flow(channels, a, F[a], S[a], starts[a], tau[a], MOST_SERIES, end, wide, sigma, slope, by)
            for i in range(N):
                moved[i] = wide[i, N]
                for j in range(N):
                    moved[i] += wide[i, j] * dy[j]
        else:
            sigma[:], slope[:] = 0.0, 0.0
            affine_flow(F[a], starts[a], tau[a], end, Phi, square)
            affine_change(F[a], dF[a], starts[a], tau[a], dy, moved)
        value = _guard_change(channels, by, dg[a], dgs[a], gs[a], smooth[a], end, sigma, slope)
        guard_at(channels, g[a], gs[a], smooth[a], end, sigma, slope, row)
        for j in range(N):
            value += row[j] * moved[j]
        if at_once[a] == 1:
            value = 0.0
        elif at_once[a] == 2 and tau[a] != 0.0:
            value /= tau[a]
        out[m + a] = value
        for i in range(N):
            dy[i] = 0.0
            for j in range(N):
                dy[i] += J[a, i, j] * moved[j] + dJ[a, i, j] * end[j]
    total = tau.sum()
    for k in range(m):
        i = free[k]
        out[k] = dy[i] - begin[i] - dshift[i] * total
