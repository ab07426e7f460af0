"""Compiled: states and signals along a closed orbit: at given times, and their least and greatest values."""

import math

import numpy as np

from eppanalysis.kernels.compiling import KERNEL, PART, njit
from eppanalysis.kernels.engine.flow import growth_rate
from eppanalysis.kernels.filling import fill
from eppanalysis.kernels.orbits.flow import (
    MOST_SERIES,
    affine_flow,
    channels_at,
    numbers_of,
    rate_at,
    room,
    smooth_flow,
)

#: Steps of an arc, at least, at most, and over the time constant of what is fastest on it.
_FEWEST, _MOST, _PER_TURN = 8, 4096, 0.3
#: Terms of the series of a signal within a step, at most, and the share of all that is beneath rounding.
_TERMS, _BENEATH = 24, 1e-18


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
            own = numbers_of(channels, F[a], S[a])
            smooth_flow(channels, a, F[a], S[a], starts[a], t, MOST_SERIES, out[i], Phi, sigma, slope, own)
        else:
            affine_flow(F[a], starts[a], t, out[i], Phi, square)


@njit(**KERNEL)
def extents(channels, F, S, smooth, Y, Ys, starts, tau, low, high):
    """Smallest and largest value of every signal over an orbit, exact: nodes on every arc, then Newton on the rate."""
    p, n, N = F.shape
    n_y, rate = Y.shape[1], np.zeros(N)
    square, Phi, row = room(F), np.zeros((N, N)), np.zeros(N)
    sigma, change = np.zeros(S.shape[2]), np.zeros(S.shape[2])
    low[:], high[:] = np.inf, -np.inf
    for a in range(p):
        if tau[a] <= 0.0:
            continue
        steps = _FEWEST if smooth[a] else _steps_of(F[a], tau[a], square)
        node, value, slope = np.zeros((steps + 1, N)), np.zeros((steps + 1, n_y)), np.zeros((steps + 1, n_y))
        d = tau[a] / steps
        fill(node[0], starts[a])
        for k in range(steps + 1):
            if k and smooth[a]:
                own = numbers_of(channels, F[a], S[a])
                smooth_flow(channels, a, F[a], S[a], node[k - 1], d, MOST_SERIES, node[k], Phi, sigma, change, own)
            elif k == 1:
                affine_flow(F[a], node[0], d, node[1], Phi, square)
            elif k:
                _carry(Phi, node[k - 1], node[k], n)
            channels_at(channels, a, node[k, :n], node[k, n:], sigma, change)
            rate_at(F[a], S[a], node[k], sigma, rate)
            for s in range(n_y):
                # Rates at the nodes tell in which steps a signal turns: extrema at a switch are nodes, all others lie
                # inside a step.
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
                # A cubic exceeds its end values by at most 4/27 d of its end rates: where that does not reach the
                # extremum so far, it is not looked for.
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
def _steps_of(F, tau, square):
    """In how many steps of an affine arc no signal turns twice in one: where powers of F grow within it, in more."""
    moving = min(len(F), square.shape[1])
    for i in range(moving):
        fill(square[0, i, :moving], F[i, :moving])
    return int(min(max(_PER_TURN * growth_rate(square[0], square[3], square[4]) * tau, _FEWEST), _MOST))


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
def _series_of(Y, F, rate, d, terms):
    """Fill in the terms by which a signal changes over a step of an affine arc; their number, 0 where they go on."""
    n, size, before = len(F), 0.0, math.inf
    motion, moved = np.empty(n), np.empty(n)
    for i in range(n):
        motion[i] = d * rate[i]
    for k in range(_TERMS):
        terms[k] = 0.0
        for i in range(n):
            terms[k] += Y[i] * motion[i]
        size += abs(terms[k])
        # Two terms: of an odd or even motion every other one is zero.
        if abs(terms[k]) + before <= _BENEATH * size:
            return k + 1
        before = abs(terms[k])
        for i in range(n):
            moved[i] = 0.0
            for j in range(n):
                moved[i] += F[i, j] * motion[j]
        for i in range(n):
            motion[i] = moved[i] * d / (k + 2)
    return 0


@njit(**PART)
def _sum_at(terms, share):
    """Sum of a series at a share of its step, and its first two derivatives by that."""
    value, slope, bend = 0.0, 0.0, 0.0
    for k in range(terms.size - 1, -1, -1):
        bend = bend * share + 2.0 * slope
        slope = slope * share + value
        value = value * share + terms[k]
    # The first term goes with the share itself.
    return value * share, slope * share + value, bend * share + 2.0 * slope


@njit(**PART)
def _turning_value(channels, a, F, S, smooth, Y, Ys, y, d, left, right, end, square):
    """Value of a signal where its rate vanishes inside a step: by Newton's method on the rate, where it stays inside.

    Else, and with smooth channels, by regula falsi (Illinois).
    """
    N = y.size
    Phi, rate = np.zeros((N, N)), np.zeros(N)
    sigma, change = np.zeros(S.shape[1]), np.zeros(S.shape[1])
    t0, t1, t, value, bend, begin, count = 0.0, d, 0.0, 0.0, 0.0, 0.0, 0
    terms = np.empty(_TERMS)
    if not smooth:
        rate_at(F, S, y, sigma, rate)
        count = _series_of(Y, F, rate, d, terms)
        for j in range(N):
            begin += Y[j] * y[j]
    for _ in range(12):
        if not t0 < t < t1:
            t = (t0 * right - t1 * left) / (right - left)
        if count > 0:
            value, slope, bend = _sum_at(terms[:count], t / d)
            value, slope, bend = begin + value, slope / d, bend / (d * d)
        else:
            if smooth:
                own = numbers_of(channels, F, S)
                smooth_flow(channels, a, F, S, y, t, MOST_SERIES, end, Phi, sigma, change, own)
            else:
                affine_flow(F, y, t, end, Phi, square)
            rate_at(F, S, end, sigma, rate)
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
        if count == 0:
            bend = 0.0
            for i in range(len(F)):
                if Y[i] != 0.0:
                    for j in range(N):
                        bend += Y[i] * F[i, j] * rate[j]
        t = -1.0 if smooth or bend == 0.0 else t - slope / bend
    return value
