"""Compiled: Newton's method on the equations of an orbit of a fixed sequence of events, damped.

The equations are those of :mod:`eppanalysis.kernels.orbits.sweep`.
"""

import math
from typing import NamedTuple

import numpy as np

from eppanalysis.kernels.balances import room_for, solve_at
from eppanalysis.kernels.compiling import KERNEL, PART, njit
from eppanalysis.kernels.filling import fill, fill_rows, largest
from eppanalysis.kernels.orbits.flow import MOST_SERIES, affine_flow, numbers_of, room, smooth_flow
from eppanalysis.kernels.orbits.sizes import size_of_motion, sizes_of_residuals
from eppanalysis.kernels.orbits.sweep import sweep

#: A solution this many times larger than its right-hand side is rounding.
STRAY = 1e9
#: Residual below which a step is near rounding, and the shortest period that counts as one.
_ROUNDING, _NO_TIME = 1e-11, 1e-300
#: Shares of Newton's step that are tried, longest first.
_SHARES = 0.4 ** np.arange(8)


class Chain(NamedTuple):
    """The arcs of an orbit, as :func:`~eppanalysis.kernels.orbits.sweep.sweep` takes them."""

    F: np.ndarray
    S: np.ndarray
    g: np.ndarray
    gs: np.ndarray
    J: np.ndarray
    smooth: np.ndarray
    at_once: np.ndarray
    free: np.ndarray
    shift: np.ndarray
    duration: float  # of all arcs together where an input drives the motion; else not a number


class Motion(NamedTuple):
    """An iterate: start, dwell times, what a sweep along the arcs fills, sizes of the motion and of the residuals."""

    y: np.ndarray  # (N,)
    tau: np.ndarray  # (p,)
    starts: np.ndarray  # (p + 1, N)
    ends: np.ndarray  # (p, N)
    A: np.ndarray  # (m + p, m + p)
    r: np.ndarray  # (m + p,)
    speed: np.ndarray  # (p,)
    scale: np.ndarray  # (N,)
    rows: np.ndarray  # (m + p,)


class Effort(NamedTuple):
    """Work that may be done, and how much a sweep with its linear equations is, and a series."""

    most: float
    sweep: float
    series: float


@njit(**KERNEL)
def newton(channels, chain, effort, iterations, step, here, share):
    """Newton's method from `here`, which is moved; without iterations its equations alone are set up.

    Parameters
    ----------
    channels, chain, effort : Channels or None, Chain, Effort
    iterations : int
        Steps at most.
    step : array (m + p,)
        The first step, in the units of the unknowns, from `here` with its equations; empty where there is none yet.
    here : Motion
    share : int
        Number of the share of the last step that was taken.

    Returns
    -------
    int, int, float
        Steps that are left, none where the method has ended; the number of the last share; the work done. Where steps
        are left the next one is wanted by least squares.
    """
    n, used, begins = here.r.size, 0.0, step.size == 0
    wanted, columns, scaled, matrix, places = np.zeros(n), np.ones(n), np.empty((n, n)), room_for(n), np.arange(n)
    better, trial = _like(here), _like(here)
    given = not begins
    if given:
        fill(wanted, step)
    left = iterations
    while begins or (left > 0 and used < effort.most):
        residual, most = math.inf, 1.0
        if begins:
            fill(here.rows, columns)
        else:
            residual = largest_share(here.r, here.rows)
            sizes_of_unknowns(chain, here, columns)
            if math.isfinite(residual) and not given and not _step(here, columns, places, scaled, matrix, wanted):
                return left, share, used
            size, left, given = largest_share(wanted, columns), left - 1, False
            if not (math.isfinite(residual) and math.isfinite(size)):
                break
            # No step of more than half the motion's own size: of flows so far away the derivative says nothing.
            most = min(1.0, 0.5 / size) if size > 0.0 else 1.0
        used, k, better, trial = _search(
            channels, chain, effort, used, here, wanted, most, share, residual, better, trial
        )
        if k < 0 and not begins:
            break
        measure(channels, chain, better)
        new = largest_share(better.r, better.rows)
        ends = new < _ROUNDING and new > 0.3 * residual
        if not ends or new < residual:
            _copy(better, here)
        if ends:
            break
        share, begins = max(k, 0) if not begins else share, False
    return 0, share, used


@njit(**PART)
def _search(channels, chain, effort, used, here, step, most, share, residual, better, trial):
    """The longest share of a step that lowers the residual: work done, its number (-1 for none), its motion, room.

    It is looked for from that of the step before on, which is a neighbour as a rule. Where there is no residual yet the
    motion is taken as it is.
    """
    turn, found, k, count = 0, -1, share, _SHARES.size
    m = chain.free.size
    while turn < count:
        fill(trial.y, here.y)
        for j in range(m):
            trial.y[chain.free[j]] += most * _SHARES[k] * step[j]
        for a in range(here.tau.size):
            trial.tau[a] = here.tau[a] + most * _SHARES[k] * step[m + a]
        used = run_along(channels, chain, effort, used, trial)
        size = largest_share(trial.r, here.rows)
        # Near rounding any step will do.
        if size < residual * (1.0 - 0.1 * most * _SHARES[k]) or (size < _ROUNDING and residual < _ROUNDING):
            better, trial, found = trial, better, k
            # The range of Newton's method grows as the orbit is neared, by one share a step as a rule.
            if turn > 0 or k == 0 or residual == math.inf:
                break
            k -= 1
        elif found >= 0:
            break
        elif residual == math.inf:
            return used, -1, trial, better
        else:
            # Shorter shares first: Newton's direction lowers the residual over a short way, if at all.
            turn += 1
            k = (share + turn) % count
    return used, found, better, trial


@njit(**PART)
def run_along(channels, chain, effort, used, it):
    """Run along the arcs once; the work done behind it."""
    used += effort.sweep
    most = int(min(MOST_SERIES, 1.0 + max(effort.most - used, 0.0) / effort.series))
    made = sweep(
        channels, chain.F, chain.S, chain.g, chain.gs, chain.J, chain.smooth, chain.at_once, it.y, it.tau, chain.free,
        chain.shift, most, it.starts, it.ends, it.A, it.r, it.speed,
    )  # fmt: skip
    if not math.isnan(chain.duration):  # the last arc ends when the time is over
        for j in range(chain.free.size, it.r.size):
            it.A[-1, j] = 1.0
        it.r[-1] = it.tau.sum() - chain.duration
    return used + effort.series * made


@njit(**PART)
def measure(channels, chain, it):
    """Fill in the size of the motion in each place of y, and those of the residuals."""
    p, n, N = chain.F.shape
    driven = not math.isnan(chain.duration)
    known = math.isfinite(largest(it.starts)) and math.isfinite(largest(it.ends))
    inner, count = np.empty((p, N)), 0
    sigma, slope, Phi, square = np.empty(chain.S.shape[2]), np.empty(chain.S.shape[2]), np.empty((N, N)), room(chain.F)
    # F holds no contribution of smooth channels; what is driven may have no event but its begin.
    for a in range(p):
        if known and chain.smooth[a]:
            own = numbers_of(channels, chain.F[a], chain.S[a])
            half = 0.5 * it.tau[a]
            smooth_flow(
                channels, a, chain.F[a], chain.S[a], it.starts[a], half, MOST_SERIES, inner[count], Phi, sigma, slope,
                own,
            )  # fmt: skip
            count += 1
        elif known and driven:
            affine_flow(chain.F[a], it.starts[a], 0.5 * it.tau[a], inner[count], Phi, square)
            count += 1
    size_of_motion(chain.F, it.starts, it.ends, inner[:count], it.tau, it.scale)
    period = max(it.tau.sum(), _NO_TIME)
    sizes_of_residuals(chain.g, chain.at_once, chain.free, it.scale, period, it.rows)


@njit(**PART)
def sizes_of_unknowns(chain, it, columns):
    """Fill in the sizes of the unknowns."""
    m, period = chain.free.size, max(it.tau.sum(), _NO_TIME)
    for k in range(m):
        columns[k] = it.scale[chain.free[k]]
    for k in range(m, columns.size):
        columns[k] = period


@njit(**PART)
def _step(it, columns, places, scaled, matrix, step):
    """Fill in Newton's step; whether the equations give one that is more than rounding."""
    n = columns.size
    right = np.empty(n)
    for i in range(n):
        right[i] = -it.r[i] / it.rows[i]
        for j in range(n):
            scaled[i, j] = it.A[i, j] / it.rows[i] * columns[j]
    return solved(scaled, right, columns, places, matrix, step)


@njit(**PART)
def solved(scaled, right, columns, places, matrix, step):
    """Fill in the solution of scaled equations, in the units of the unknowns; whether it is more than rounding."""
    if not solve_at(scaled, right, places, places, right, 0.0, matrix, step):
        return False
    size, most = 0.0, 0.0
    for i in range(columns.size):
        size, most = max(size, abs(step[i])), max(most, abs(right[i]))
        step[i] *= columns[i]
    return size <= STRAY * most


@njit(**PART)
def largest_share(values, sizes):
    """Largest value relative to its size; infinite where one is no number."""
    found = 0.0
    for i in range(values.size):
        share = abs(values[i] / sizes[i])
        if not math.isfinite(share):
            return math.inf
        found = max(found, share)
    return found


@njit(**PART)
def _like(it):
    """Room for another motion."""
    y, tau, r = np.empty(it.y.size), np.empty(it.tau.size), np.empty(it.r.size)
    scale, rows, speed = np.empty(it.y.size), np.empty(it.r.size), np.empty(it.tau.size)
    return Motion(
        y, tau, np.empty(it.starts.shape), np.empty(it.ends.shape), np.empty(it.A.shape), r, speed, scale, rows
    )


@njit(**PART)
def _copy(source, it):
    """Overwrite a motion by another."""
    for one, other in (
        (it.y, source.y), (it.tau, source.tau), (it.r, source.r), (it.speed, source.speed), (it.scale, source.scale),
        (it.rows, source.rows),
    ):  # fmt: skip
        fill(one, other)
    for one, other in ((it.starts, source.starts), (it.ends, source.ends), (it.A, source.A)):
        fill_rows(one, other)
