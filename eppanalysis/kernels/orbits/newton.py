"""Compiled: Newton's method on the equations of an orbit of a fixed sequence of events, damped.

The equations are those of :mod:`eppanalysis.kernels.orbits.sweep`.
"""

import math
from typing import NamedTuple

import numpy as np

from eppanalysis.kernels.balances import room_for, solve_at
from eppanalysis.kernels.compiling import KERNEL, PART, njit
from eppanalysis.kernels.filling import accumulate, fill, fill_rows, largest
from eppanalysis.kernels.orbits.flow import MOST_SERIES, Channels, affine_flow, numbers_of, room, smooth_flow
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
            residual = _largest(here.r, here.rows)
            _columns(chain, here, columns)
            if math.isfinite(residual) and not given and not _step(here, columns, places, scaled, matrix, wanted):
                return left, share, used
            size, left, given = _largest(wanted, columns), left - 1, False
            if not (math.isfinite(residual) and math.isfinite(size)):
                break
            # No step of more than half the motion's own size: of flows so far away the derivative says nothing.
            most = min(1.0, 0.5 / size) if size > 0.0 else 1.0
        used, k, better, trial = _search(
            channels, chain, effort, used, here, wanted, most, share, residual, better, trial
        )
        if k < 0 and not begins:
            break
        _measure(channels, chain, better)
        new = _largest(better.r, better.rows)
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
        used = _run(channels, chain, effort, used, trial)
        size = _largest(trial.r, here.rows)
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
def _run(channels, chain, effort, used, it):
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
def _measure(channels, chain, it):
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
                channels,
                a,
                chain.F[a],
                chain.S[a],
                it.starts[a],
                half,
                MOST_SERIES,
                inner[count],
                Phi,
                sigma,
                slope,
                own,
            )
            count += 1
        elif known and driven:
            affine_flow(chain.F[a], it.starts[a], 0.5 * it.tau[a], inner[count], Phi, square)
            count += 1
    size_of_motion(chain.F, it.starts, it.ends, inner[:count], it.tau, it.scale)
    period = max(it.tau.sum(), _NO_TIME)
    sizes_of_residuals(chain.g, chain.at_once, chain.free, it.scale, period, it.rows)


@njit(**PART)
def _columns(chain, it, columns):
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
    if not solve_at(scaled, right, places, places, right, 0.0, matrix, step):
        return False
    size, most = 0.0, 0.0
    for i in range(n):
        size, most = max(size, abs(step[i])), max(most, abs(right[i]))
        step[i] *= columns[i]
    return size < STRAY * most


@njit(**PART)
def _largest(values, sizes):
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


#: Where a corrector stands: arrived, lost, or in want of numbers at another value, or of a step by least squares.
ARRIVED, LOST, WANTS_NUMBERS, WANTS_STEP = 0, 1, 2, 3
#: Residual, relative to the motion, with which an orbit counts as one, and below which a small step is the last.
_CONVERGED, _CLOSED = 1e-9, 1e-11
#: Change of the unknowns that is small, and one that is rounding; residual from which Newton's method does not return.
_SMALL, _STILL, _ASTRAY = 1e-9, 1e-11, 1e3
_MOST_CORRECTIONS = 9


class Curve(NamedTuple):
    """All numbers of an orbit's arcs in one vector, and the polynomials of the parameter that some of them are."""

    middle: float
    half: float
    base: np.ndarray  # (n,)
    places: np.ndarray  # (k,) int: those that vary
    coefficients: np.ndarray  # (degree + 1, k): of Chebyshev's polynomials over middle +- half


class Plane(NamedTuple):
    """A plane across a branch, at a distance from an orbit on it, and how far Newton's method may go from there."""

    row: np.ndarray  # (m + p + 1,)
    old: np.ndarray  # (m + p + 1,): unknowns of the orbit
    distance: float
    slope: np.ndarray  # (m + p,): derivative of the residual by the parameter
    largest: float  # size of the motion
    longest: float  # period [s]


@njit(**KERNEL)
def correct(channels, chain, curve, input_place, n_inputs, effort, plane, progress, u, here):
    """Newton's method to the orbit in a plane, over start, dwell times and parameter.

    Parameters
    ----------
    channels, chain : Channels or None, Chain
        Of the same arcs at any value.
    curve : Curve
        Their numbers, in the order of Chain, then of Channels, then where the loop's inputs stand.
    input_place, n_inputs : int
        Where in y the inputs stand.
    effort, plane : Effort, Plane
    progress : array (2,)
        Iterations made, and the smallest step so far; both go on.
    u : array (m + p + 1,)
        Free part of the start, dwell times, parameter; moved.
    here : Motion
        Filled with that at u; y holds what is no unknown.

    Returns
    -------
    int, float
        One of ARRIVED, LOST, WANTS_NUMBERS, WANTS_STEP; the work done.
    """
    n, m = here.r.size, chain.free.size
    numbers, used = curve.base.copy(), 0.0
    chain, channels = _chain_of(chain, numbers), _channels_of(channels, chain, numbers)
    scaled, matrix, places = np.empty((n + 1, n + 1)), room_for(n + 1), np.arange(n + 1)
    change, columns, right = np.empty(n + 1), np.empty(n + 1), np.empty(n + 1)
    while progress[0] < _MOST_CORRECTIONS and used < effort.most:
        if not abs(u[n] - curve.middle) <= curve.half * (1.0 + 1e-12):
            return WANTS_NUMBERS, used
        _numbers_at(curve, u[n], numbers)
        for k in range(m):
            here.y[chain.free[k]] = u[k]
        for k in range(n_inputs):
            here.y[input_place + k] = numbers[numbers.size - n_inputs + k]
        for a in range(here.tau.size):
            here.tau[a] = u[m + a]
        used = _run(channels, chain, effort, used, here)
        _measure(channels, chain, here)
        residual, period, motion = _largest(here.r, here.rows), here.tau.sum(), 0.0
        for j in range(here.scale.size):
            motion = max(motion, here.scale[j])
        if motion > plane.largest or not (residual < _ASTRAY and 0.0 < period < plane.longest):
            return LOST, used
        _columns(chain, here, columns)
        if not _bordered(here, plane, u, columns, right, places, scaled, matrix, change):
            return WANTS_STEP, used
        size = 0.0
        for k in range(n):
            size = max(size, abs(change[k]) / columns[k])
        # Rounding limits either the residual or the step; whichever it is, a step that no longer shrinks is the last
        # one.
        still = (residual < _CLOSED and size < _SMALL) or size < _STILL
        if residual < _CONVERGED and (still or size > 0.5 * progress[1]):
            return ARRIVED, used
        # A step that grows again after Newton has had his start will not converge.
        if progress[0] > 3 and size > progress[1]:
            return LOST, used
        progress[0] += 1
        progress[1] = min(progress[1], size)
        accumulate(u, 1.0, change)
    return LOST, used


@njit(**PART)
def _bordered(here, plane, u, columns, right, places, scaled, matrix, change):
    """Fill in the step to the plane, and the size of the parameter's column; whether it is more than rounding."""
    n = here.r.size
    most, across, missed = 0.0, 0.0, -plane.distance
    for i in range(n):
        most = max(most, abs(plane.slope[i] / here.rows[i]))
    columns[n] = 1.0 / most if most > 0.0 else 1.0
    for j in range(n + 1):
        across = max(across, abs(plane.row[j] * columns[j]))
        missed += plane.row[j] * (u[j] - plane.old[j])
    across = across if across > 0.0 else 1.0
    for i in range(n):
        right[i] = -here.r[i] / here.rows[i]
        for j in range(n):
            scaled[i, j] = here.A[i, j] / here.rows[i] * columns[j]
        scaled[i, n] = plane.slope[i] / here.rows[i] * columns[n]
    for j in range(n + 1):
        scaled[n, j] = plane.row[j] / across * columns[j]
    right[n] = -missed / across
    if not solve_at(scaled, right, places, places, right, 0.0, matrix, change):
        return False
    size, most = 0.0, 0.0
    for j in range(n + 1):
        size, most = max(size, abs(change[j])), max(most, abs(right[j]))
        change[j] *= columns[j]
    return size <= STRAY * most


@njit(**PART)
def _numbers_at(curve, value, numbers):
    """Fill in the numbers that vary, at a value of the parameter."""
    if curve.places.size == 0:
        return
    # As cosines: the place stays within the range, whatever rounding makes of its ends.
    angle = math.acos(min(max((value - curve.middle) / curve.half, -1.0), 1.0))
    for i in range(curve.places.size):
        numbers[curve.places[i]] = 0.0
    for k in range(len(curve.coefficients)):
        wave = math.cos(k * angle)
        for i in range(curve.places.size):
            numbers[curve.places[i]] += wave * curve.coefficients[k, i]


@njit(**PART)
def _chain_of(like, numbers):
    """The arcs whose numbers stand in a vector."""
    a = like.F.size
    b = a + like.S.size
    c = b + like.g.size
    d = c + like.gs.size
    e = d + like.J.size
    return Chain(
        numbers[:a].reshape(like.F.shape),
        numbers[a:b].reshape(like.S.shape),
        numbers[b:c].reshape(like.g.shape),
        numbers[c:d].reshape(like.gs.shape),
        numbers[d:e].reshape(like.J.shape),
        like.smooth,
        like.at_once,
        like.free,
        numbers[e : e + like.shift.size],
        like.duration,
    )


@njit(**PART)
def _channels_of(like, chain, numbers):
    """The smooth channels whose numbers stand in a vector, behind those of the arcs."""
    if like is None:
        return None
    a = chain.F.size + chain.S.size + chain.g.size + chain.gs.size + chain.J.size + chain.shift.size
    b = a + like.smooth_x.size
    c = b + like.smooth_H.size
    d = c + like.smooth_s.size
    return Channels(
        like.smooth_kind,
        numbers[a:b].reshape(like.smooth_x.shape),
        numbers[b:c].reshape(like.smooth_H.shape),
        numbers[c:d].reshape(like.smooth_s.shape),
        numbers[d : d + like.smooth_scale.size],
        like.sense,
    )
