"""Compiled: the corrector of a branch, Newton's method to the orbit in a plane across it; the parameter is sought, too.

The numbers of the loop come from their polynomials over the parameter; the equations are those of
:mod:`eppanalysis.kernels.orbits.newton`, bordered by the plane's.
"""

import math
from typing import NamedTuple

import numpy as np

from eppanalysis.kernels.balances import room_for
from eppanalysis.kernels.compiling import KERNEL, PART, njit
from eppanalysis.kernels.filling import accumulate, fill
from eppanalysis.kernels.orbits.flow import Channels
from eppanalysis.kernels.orbits.newton import Chain, largest_share, measure, run_along, sizes_of_unknowns, solved

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
def correct(channels, chain, curve, input_place, n_inputs, effort, plane, step, progress, u, here):
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
    step : array (m + p + 1,)
        The first step; empty where there is none yet.
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
    n, m, given = here.r.size, chain.free.size, step.size > 0
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
        used = run_along(channels, chain, effort, used, here)
        measure(channels, chain, here)
        residual, period, motion = largest_share(here.r, here.rows), here.tau.sum(), 0.0
        for j in range(here.scale.size):
            motion = max(motion, here.scale[j])
        if motion > plane.largest or not (residual < _ASTRAY and 0.0 < period < plane.longest):
            return LOST, used
        sizes_of_unknowns(chain, here, columns)
        if given:
            fill(change, step)
            given = False
        elif not _bordered(here, plane, u, columns, right, places, scaled, matrix, change):
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
    return solved(scaled, right, columns, places, matrix, change)


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
