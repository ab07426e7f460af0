"""Closed orbits as chains of arcs between events, and Newton's method for them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from eppanalysis.engine._engine import (
    build_arcs,
    correct,
    derivative_of_run,
    extents,
    newton_orbit,
    sizes_of_residuals,
    states_at,
    sweep_by,
)

__all__ = [
    "ARRIVED",
    "LOST",
    "NOT_A_GUARD",
    "READY",
    "SINGULAR",
    "STRAY",
    "TOUCHES",
    "UNSUPPORTED",
    "WANTS_NUMBERS",
    "WANTS_STEP",
    "Chain",
    "Channels",
    "Curve",
    "Effort",
    "Motion",
    "Plane",
    "build_arcs",
    "correct",
    "derivative_of_run",
    "extents",
    "newton_orbit",
    "sizes_of_residuals",
    "states_at",
    "sweep_by",
]


#: Whether arcs could be built.
READY, SINGULAR, NOT_A_GUARD, UNSUPPORTED = 0, 1, 2, 3
#: With what the derivative of a run is marked where an event that a jump brings about only just reaches its threshold.
TOUCHES = 4
#: The state of a corrector: arrived, lost, or in want of numbers at another value, or of a step by least squares.
ARRIVED, LOST, WANTS_NUMBERS, WANTS_STEP = 0, 1, 2, 3
#: A solution this many times larger than its right-hand side is rounding.
STRAY = 1e9


class Channels(NamedTuple):
    """The smooth channels of a model, under the names that they have there.

    None where none acts on any arc.
    """

    smooth_kind: np.ndarray  # (s,) int
    smooth_x: np.ndarray  # (s, n)
    smooth_H: np.ndarray  # (s, H)
    smooth_s: np.ndarray  # (s, s): on those before it
    smooth_scale: np.ndarray  # (s,)
    sense: np.ndarray  # (p, s): sign of the argument on each arc, for channels that depend on its magnitude


class Chain(NamedTuple):
    """The arcs of an orbit, as a sweep takes them."""

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
