"""The curve through a measured frequency response: splines of log magnitude and unwrapped phase over log frequency.

Without a standard deviation the curve passes through every point (a cubic interpolating spline). With one it is a cubic
spline fitted by least squares, with so few knots, and these where the response bends, that the points scatter about it
as their deviation says: what is between two neighbours then follows from all the points around. Either way the curve is
linear in the data, so that its own standard deviation is known.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from eppanalysis.arrays import Array, BoolArray, ComplexArray

# Only a measured loop pays for loading splines.
if TYPE_CHECKING:
    from scipy.interpolate import BSpline

#: Fewest spans of a fitted spline, and fewest points in each.
_FEWEST_SPANS, _POINTS_EACH = 3, 2
#: Share of the spans that are halved at once, and halvings without a better fit after which there is none.
_WORST, _PATIENCE = 0.4, 6
#: Points on either side that give the error between two points.
_BESIDE = 4
#: Deviations of the mean square of the scatter that a value rests on, from which it is not by chance.
_BY_CHANCE = 4.0


@dataclass(frozen=True, eq=False)
class Curve:
    """``ln G(j omega)``: two splines over ``ln omega``."""

    log_omega: Array  # (m,): of the points, ascending
    points: Array  # (m, 2): log magnitude and phase [rad], unwrapped
    deviation: Array | None  # (m,): standard deviation of either; None where the curve passes through the points
    spline: BSpline  # values of shape (2,)

    @classmethod
    def through(cls, x: Array, y: Array, deviation: Array | None) -> Curve:
        """The curve through points as it has them, or fitted to them where they have a deviation."""
        if deviation is None:
            return cls(x, y, None, _through(x, y))
        return cls(x, y, deviation, _fitted(x, y, deviation))

    def at(self, omega: Array) -> tuple[ComplexArray, ComplexArray]:
        """Response and its derivative by omega, at frequencies [rad/s] within the data."""
        G, dG = self._cubics.at(omega)
        return G[..., 0], dG[..., 0]

    @cached_property
    def _cubics(self) -> Cubics:
        return Cubics.of([self])

    @cached_property
    def scatter(self) -> float:
        """How much the points scatter about a fitted curve, over their deviation; 1 where it passes through them.

        By their median, which a resonance that no spline follows does not move.
        """
        if self.deviation is None:
            return 1.0
        free = 1.0 - len(self.spline.c) / len(self.points)
        return float(np.sqrt(np.median(self._squares) / (np.log(2.0) * max(free, 1.0 / len(self.points)))))

    def scatter_at(self, omega: ArrayLike) -> Array:
        """The same of the points that values at frequencies rest on, where it is more than chance makes it."""
        if self.deviation is None:
            return np.ones(np.shape(omega))
        return self._scatter_of(self._weights(omega) ** 2)

    def _scatter_of(self, weight: Array) -> Array:
        """By the squares of the weights (..., m) that the points have in a value."""
        # What is left over counts as it moves the value: a resonance that no spline follows, ten knots away, does not.
        here = weight @ self._squares / (weight @ self._free)
        usual, count = self.scatter**2, weight.sum(-1) ** 2 / (weight**2).sum(-1)
        return np.asarray(np.sqrt(np.where(here > usual * (1.0 + _BY_CHANCE / np.sqrt(count)), here, usual)))

    @cached_property
    def _squares(self) -> Array:
        """Squares of what points lie off the curve over their deviation, mean of magnitude and phase, shape (m,)."""
        assert self.deviation is not None
        off = (self.spline(self.log_omega) - self.points) / self.deviation[:, None]
        return np.asarray(0.5 * (off**2).sum(1))

    def deviation_at(self, omega: ArrayLike) -> Array:
        """Standard deviation of log magnitude and phase of a fitted curve at frequencies; zero without one.

        Where the points scatter more than their deviation says, that scatter counts.
        """
        if self.deviation is None:
            return np.zeros(np.shape(omega))
        weight = self._weights(omega) ** 2
        return np.asarray(np.sqrt(weight.sum(-1)) * np.maximum(self._scatter_of(weight), 1.0))

    def _weights(self, omega: ArrayLike) -> Array:
        """Of the points over their deviation in values of a fitted curve at frequencies, shape (..., m)."""
        x = np.clip(np.log(np.asarray(omega, float)), self.log_omega[0], self.log_omega[-1])
        return np.asarray(self._fit(x))

    @cached_property
    def _fit(self) -> BSpline:
        """What each point over its deviation adds, values of shape (m,).

        The variance of a fit that is linear in its data (docs/theory/measured.md, Between the points) follows from it:
        normal equations would square its condition.
        """
        Q, R = np.linalg.qr(self._design)
        return type(self.spline)(self.spline.t, np.linalg.solve(R, Q.T), self.spline.k)

    @cached_property
    def _design(self) -> Array:
        """Design matrix, its rows over the deviation, shape (m, p)."""
        assert self.deviation is not None
        B = type(self.spline).design_matrix(self.log_omega, self.spline.t, self.spline.k).toarray()
        return np.asarray(B / self.deviation[:, None])

    @cached_property
    def _free(self) -> Array:
        """Share of its variance that each point keeps about the curve, shape (m,)."""
        return np.asarray(1.0 - np.einsum("mp,pm->m", self._design, self._fit.c))

    def error_between(self, omega: float) -> float:
        """Estimated error of ``ln G`` between two points: how far points beside lie off a curve without them.

        A curve of every second point has gaps twice as wide; where the response is smooth, its error is some sixteen
        times that of the curve itself. Zero for a fitted curve, whose deviation says it.
        """
        if self.deviation is not None:
            return 0.0
        size = np.abs(self._left_out)
        i = int(np.searchsorted(self.log_omega, np.log(omega)))
        return float(size[max(0, i - _BESIDE) : i + _BESIDE].max(initial=0.0))

    @cached_property
    def _left_out(self) -> ComplexArray:
        """What each inner point lies off the curve through every second point, itself left out, shape (m,)."""
        out = np.zeros(len(self.log_omega), complex)
        for first in (0, 1):
            kept = np.unique(np.append(np.arange(first, len(out), 2), [0, len(out) - 1]))
            left = np.setdiff1d(np.arange(len(out)), kept)
            if len(kept) < 4:
                continue
            off = _through(self.log_omega[kept], self.points[kept])(self.log_omega[left])
            off -= self.points[left]
            out[left] = off[:, 0] + 1j * off[:, 1]
        return out


@dataclass(frozen=True, eq=False)
class Cubics:
    """Several curves as powers of the distance from knots that all have: they are evaluated at once."""

    knots: Array  # (n + 1,): those of all curves, ascending
    ends: Array  # (2, p): between which each curve is known
    powers: Array  # (p, n, 4, 2): its coefficients above each knot, from the constant on, of log magnitude and phase

    @classmethod
    def of(cls, curves: Sequence[Curve]) -> Cubics:
        """Those of curves."""
        knots = np.unique(np.concatenate([c.spline.t for c in curves]))
        powers = [[c.spline(knots[:-1], nu) / math.factorial(nu) for nu in range(4)] for c in curves]
        ends = np.transpose([c.log_omega[[0, -1]] for c in curves])
        return cls(knots, ends, np.moveaxis(np.asarray(powers), 1, 2))

    def at(self, omega: Array) -> tuple[ComplexArray, ComplexArray]:
        """Responses and their derivatives by omega, shape (..., p); outside a curve those at its end."""
        omega = np.clip(omega[..., None], *np.exp(self.ends))
        x = np.log(omega)
        span = np.clip(np.searchsorted(self.knots, x, side="right") - 1, 0, len(self.knots) - 2)
        h = (x - self.knots[span])[..., None]
        a, b, c, d = np.moveaxis(self.powers[np.arange(len(self.powers)), span], -2, 0)
        value, slope = a + h * (b + h * (c + h * d)), b + h * (2.0 * c + h * 3.0 * d)
        G = np.exp(value[..., 0] + 1j * value[..., 1])
        return G, G * (slope[..., 0] + 1j * slope[..., 1]) / omega


def _through(x: Array, y: Array) -> BSpline:
    from scipy.interpolate import make_interp_spline

    return make_interp_spline(x, y, k=3)


def _fitted(x: Array, y: Array, deviation: Array) -> BSpline:
    """The spline with the least of Akaike's criterion among those whose spans were halved where they fit worst.

    Akaike (1974): the weighted sum of squares and twice the number of coefficients. At the end all spans are halved.
    """
    edges = np.linspace(0, len(x), _FEWEST_SPANS + 1).astype(int)
    least, best, since = np.inf, edges, 0
    while since <= _PATIENCE:
        spline = _with_knots(x, y, deviation, edges)
        squares = (((spline(x) - y) / deviation[:, None]) ** 2).sum(1)
        # Magnitude and phase have as many coefficients each: twice Akaike's two.
        loss = squares.sum() + 4.0 * len(spline.c)
        least, best, since = (loss, edges, 0) if loss < least else (least, best, since + 1)
        # Standard deviations by which the sum of squares of each span is off that of noise.
        count = 2.0 * np.diff(edges)
        excess = (np.add.reduceat(squares, edges[:-1]) - count) / np.sqrt(2.0 * count)
        finer = _halved(edges, excess >= max(0.0, np.quantile(excess, 1.0 - _WORST)))
        if len(finer) == len(edges):
            break
        edges = finer
    return _with_knots(x, y, deviation, _halved(best, np.ones(len(best) - 1, bool)))


def _halved(edges: NDArray[np.int_], which: BoolArray) -> NDArray[np.int_]:
    """The edges of spans with those between, of the spans that have points enough for two."""
    enough = np.diff(edges) >= 2 * _POINTS_EACH
    return np.union1d(edges, ((edges[:-1] + edges[1:]) // 2)[which & enough])


def _with_knots(x: Array, y: Array, deviation: Array, edges: NDArray[np.int_]) -> BSpline:
    """Least-squares cubic spline with a knot before the first point of each span but the first."""
    from scipy.interpolate import make_lsq_spline

    inner = 0.5 * (x[edges[1:-1] - 1] + x[edges[1:-1]])
    t = np.concatenate([np.full(4, x[0]), inner, np.full(4, x[-1])])
    return make_lsq_spline(x, y, t, k=3, w=1.0 / deviation)
