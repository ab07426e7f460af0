"""Pieces of a period between switches and their echoes behind dead times, with polynomials on them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np
from numpy.polynomial import legendre

from eppanalysis.arrays import Array, IntArray
from eppanalysis.errors import ModelError

#: Pieces at most; and the longest one, of a period.
_MOST_PIECES, _LONGEST = 160, 1.0 / 24.0
#: Breaks of pieces nearer than this to each other, of a period, are one.
_SAME = 1e-10


@dataclass(frozen=True, eq=False)
class Mesh:
    """Pieces of a period."""

    rows: Array  # (pieces + 1, p + 1): the times between the pieces as sums of dwell times, with a constant last [s]
    tau: Array  # (p,): dwell times [s]
    arc: IntArray  # (pieces,): the arc that each piece is part of
    degree: int

    @classmethod
    def of(cls, tau: Array, delays: Array, echoes: int, degree: int) -> Mesh:
        """Between the events and their echoes.

        Raises
        ------
        ModelError
            Where there are too many, or events at one instant, but for rounding.
        """
        if np.any(tau <= _SAME * tau.sum()):
            raise ModelError("orbit: switches at one instant.")
        p = tau.size
        whole = np.append(np.ones(p), 0.0)
        at = np.append(tau, 1.0)
        # Every break is a sum of dwell times and delays, so that the mesh moves with them from step to step of Newton's
        # method.
        events = np.hstack([np.tri(p + 1, p, -1), np.zeros((p + 1, 1))])
        period = float(whole @ at)
        rows = layer = events
        for _ in range(echoes):
            layer = np.concatenate([layer + np.append(np.zeros(p), late) for late in delays])
            layer = layer - np.floor(layer @ at / period)[:, None] * whole
            fresh = [r for r in layer if np.min(np.abs(rows @ at - r @ at)) > _SAME * period]
            rows = layer = np.concatenate([rows, np.array(fresh).reshape(-1, p + 1)])
            if len(rows) > _MOST_PIECES:
                raise ModelError("orbit: too many switches within a dead time.")
        rows = rows[np.argsort(rows @ at)]
        rows = rows[np.append(True, np.diff(rows @ at) > _SAME * period)]
        parts = np.maximum(np.ceil(np.diff(rows @ at) / (_LONGEST * period)).astype(int), 1)
        cut = [a + np.arange(k)[:, None] / k * (b - a) for a, b, k in zip(rows, rows[1:], parts, strict=False)]
        rows = np.concatenate([*cut, rows[-1:]])
        breaks = rows @ at
        arc = np.searchsorted(np.cumsum(tau), 0.5 * (breaks[:-1] + breaks[1:]))
        return cls(rows, tau, arc.astype(np.int64), degree)

    def moved(self, tau: Array) -> Mesh:
        """The same pieces with other dwell times."""
        return replace(self, tau=tau)

    @cached_property
    def breaks(self) -> Array:
        """From 0 to the period, shape (pieces + 1,) [s]."""
        return np.asarray(self.rows @ np.append(self.tau, 1.0), float)

    @cached_property
    def times(self) -> Array:
        """Of the nodes of each piece, shape (pieces, degree + 1) [s]."""
        return self.breaks[:-1, None] + self.size[:, None] * nodes(self.degree)

    @property
    def period(self) -> float:
        """The period [s]."""
        return float(self.breaks[-1])

    @property
    def n_pieces(self) -> int:
        """Number of pieces."""
        return self.arc.size

    @cached_property
    def size(self) -> Array:
        """Lengths of the pieces [s]."""
        return np.diff(self.breaks)

    @cached_property
    def last(self) -> IntArray:
        """The last piece of each arc."""
        return np.append(np.flatnonzero(np.diff(self.arc)), self.n_pieces - 1)

    def locate(self, times: Array) -> tuple[IntArray, IntArray, Array]:
        """Piece in which each time lies, how many periods earlier, and the row of values at the nodes there."""
        turns = np.floor(times / self.period + 1e-14).astype(np.int64)
        inside = times - turns * self.period
        piece = np.clip(np.searchsorted(self.breaks, inside, side="right") - 1, 0, self.n_pieces - 1)
        return piece, -turns, basis((inside - self.breaks[piece]) / self.size[piece], self.degree)


def nodes(degree: int) -> Array:
    """Chebyshev-Lobatto nodes on [0, 1]."""
    return 0.5 - 0.5 * np.cos(np.pi * np.arange(degree + 1) / degree)


def basis(u: Array, degree: int, order: int = 0) -> Array:
    """Rows that give a polynomial (or its derivative) at u in [0, 1] from its values at the nodes."""
    return np.asarray(legendre.legvander(2.0 * u - 1.0, degree - order) @ _to_series(degree, order), float)


@lru_cache(maxsize=16)
def _to_series(degree: int, order: int) -> Array:
    """Legendre's series of a polynomial, or of its derivative, from its values at the nodes."""
    to_series = np.linalg.inv(legendre.legvander(2.0 * nodes(degree) - 1.0, degree))
    return np.asarray(2.0 * legendre.legder(to_series) if order else to_series, float)
