"""Functions of one variable as polynomials that agree with them to rounding, and by these their derivatives.

The numbers of a loop come from some hundred constructors that work on plain floats. Each number is an analytic function
of a parameter, so that the coefficients of its Chebyshev polynomials fall off until they are rounding; what is left of
them is the number itself, and can be differentiated as it is. How large the rounding of a number is, the number
tells itself: at places so near to each other that the function between them is a parabola, it is the rest.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import NDArray

from eppanalysis.arrays import Array, BoolArray
from eppanalysis.errors import EppError

#: Degrees that are tried. The places of one are among those of the next.
DEGREES = (4, 8, 16, 32)
#: Largest of the last two coefficients, and one that rounding makes of zero, relative to the sum of all.
_RESOLVED, _ROUNDING = 4e-15, 4e-16
#: Where the last coefficients are still more than this share of those of half the degree, rounding is looked for.
_FALLS = 0.1
#: Places at which it is looked at (of the range); how many neighbours of each, towards the middle, and how far from
#: each other: beyond the teeth of what is rounded to a float, and what bends between them is far below rounding.
_LOOKED_AT, _NEIGHBOURS, _APART = (0.0, 0.5, 1.0), 4, 1.3e-9
#: Which differences of neighbours are rounding alone, and a coefficient of it relative to the largest of them.
_ORDER, _NOISE = 3, 2.5
#: The largest share of the nodes at which a number may differ from what it is at all others.
_STRAYS = 0.25
#: How often a number that is rounding alone comes back to the same value from others: no smooth one does over a range
#: so short.
_RETURNS = 2
#: Half the lengths of ranges about a place, relative to it.
_AROUND = (1e-2, 1e-3, 1e-4, 1e-5)


@dataclass(frozen=True, eq=False)
class Polynomial:
    """A vector (n,) of polynomials over ``middle +- half``.

    Attributes
    ----------
    middle, half : float
    base : array, shape (n,)
        The entries that stay the same, and those of one place where they vary.
    places : int array, shape (k,)
        Entries that vary.
    coefficients : array, shape (degree + 1, k)
        Of their Chebyshev polynomials.
    noise : array, shape (k,)
        Rounding of them that is more than that of the result.
    """

    middle: float
    half: float
    base: Array
    places: NDArray[np.intp]
    coefficients: Array
    noise: Array

    @property
    def used(self) -> BoolArray:
        """Which entries are not zero throughout, shape (n,)."""
        used = self.base != 0.0
        used[self.places] = True
        return used

    def covers(self, x: float) -> bool:
        """Whether a place is within the range."""
        return abs(x - self.middle) <= self.half * (1.0 + 1e-12)

    def at(self, x: float) -> Array:
        """All entries at a place."""
        out = self.base.copy()
        out[self.places] = self._cosines(x, len(self.coefficients)) @ self.coefficients
        return out

    def slope(self, x: float) -> Array:
        """Derivatives of all entries at a place."""
        out = np.zeros(self.base.size)
        out[self.places] = self._cosines(x, len(self._derivative)) @ self._derivative / self.half
        return out

    def _cosines(self, x: float, count: int) -> Array:
        """So many Chebyshev polynomials at a place."""
        # As cosines: the place stays within the range, whatever rounding makes of its ends.
        return np.cos(math.acos(self._share(x)) * np.arange(count))

    def _share(self, x: float) -> float:
        return min(max((x - self.middle) / self.half, -1.0), 1.0)

    @cached_property
    def _derivative(self) -> Array:
        return np.asarray(chebyshev.chebder(self.coefficients), float)


def constant(values: Array, x: float) -> Polynomial:
    """A vector that is known at one place alone."""
    none = np.zeros(0)
    return Polynomial(x, 0.0, values, np.zeros(0, np.intp), np.zeros((1, 0)), none)


def polynomial(
    function: Callable[[float], Array | None], low: float, high: float, degrees: Sequence[int] = DEGREES
) -> Polynomial | None:
    """The polynomial of a vector of functions between two places.

    Parameters
    ----------
    function : callable
        The vector (n,) at a place; None where it is another one.
    degrees : sequence of int
        Those of `DEGREES` that are tried, the first among them.

    Returns
    -------
    Polynomial or None
        None where the functions are not smooth enough, or change their number.

    Examples
    --------
    >>> import numpy as np
    >>> found = polynomial(lambda x: np.array([1.0 / x, x * x, 3.0]), 1.9, 2.1)
    >>> found.slope(2.0).round(12).tolist()
    [-0.25, 4.0, 0.0]
    """
    middle, half = 0.5 * (low + high), 0.5 * (high - low)
    first = function(middle)
    if first is None:
        return None
    known, n, noise = {0.5: first}, first.size, None
    coefficients, left = np.zeros((degrees[-1] + 1, n)), np.zeros(n)
    before, is_open = np.full(n, np.inf), np.ones(n, bool)
    for degree in degrees:
        nodes = np.cos(np.pi * np.arange(degree + 1) / degree)
        for k in range(degree + 1):
            if k / degree not in known:
                value = function(middle + half * float(nodes[k]))
                if value is None or value.size != n:
                    return None
                known[k / degree] = value
        rows = _without_strays(np.array([known[k / degree] for k in range(degree + 1)]))
        # An entry that is resolved stays as it is: of a higher degree its rounding counts more in the derivative.
        places = np.flatnonzero(is_open & np.any(rows != rows[0], axis=0))
        if not np.all(np.isfinite(rows[:, places])):
            return None
        c, tail, rough = _coefficients(rows[:, places], left[places])
        if np.any(tail[rough] > _FALLS * before[places[rough]]):
            noise = _noise(function, known, middle, half) if noise is None else noise
            left[places[rough]] = 0.0 if noise is None else noise[places[rough]]
            c, tail, rough = _coefficients(rows[:, places], left[places])
        before[places] = tail
        coefficients[: degree + 1, places[~rough]] = c[:, ~rough]
        is_open[places[~rough]] = False
        if not rough.any():
            places = np.flatnonzero(~is_open)
            kept = np.ascontiguousarray(coefficients[: degree + 1, places])
            return Polynomial(middle, half, rows[0], places, kept, left[places])
    return None


def _coefficients(rows: Array, noise: Array) -> tuple[Array, Array, BoolArray]:
    """Coefficients from values at Chebyshev's extrema, those of rounding zero; the last; which entries want more."""
    # From their difference to one of them: what is the same at all places would leave its rounding.
    c = _to_coefficients(rows.shape[0] - 1) @ (rows - rows[0])
    c[0] += rows[0]
    size, tail = np.abs(c).sum(axis=0), np.abs(c[-2:]).max(axis=0)
    # What is rounding in a coefficient would count degree^2 times in the derivative.
    kept = np.abs(c) > _ROUNDING * size + noise
    kept[0] = True
    return np.where(kept, c, 0.0), tail, tail > _RESOLVED * size + noise


def _without_strays(rows: Array) -> Array:
    """Values at all nodes, where an entry is one number at most of them and another at single ones between: that one.

    A sum that cancels is zero at most places, and at some the rounding of its terms, which three looks at it miss. A
    step has two sides, and a kink goes on to an end. The place in question is in the middle or at an end: what differs
    there stays, unless the entry comes back to zero, to the last bit, time and again.
    """
    if rows.shape[0] <= DEGREES[0] + 1:
        return rows
    usual = np.where(np.any(rows == 0.0, axis=0), 0.0, np.median(rows, axis=0))
    stray = rows != usual
    alone = stray.copy()
    alone[[0, rows.shape[0] // 2, -1]] = False
    alone[1:] &= ~stray[:-1]
    alone[:-1] &= ~stray[1:]
    few = stray.sum(axis=0) <= _STRAYS * rows.shape[0]
    returns = (stray[:-1] & ~stray[1:]).sum(axis=0) - stray[0]
    return np.where((few & np.all(alone == stray, axis=0)) | (returns >= _RETURNS), usual, rows)


def _noise(
    function: Callable[[float], Array | None], known: dict[float, Array], middle: float, half: float
) -> Array | None:
    """Rounding of each entry, shape (n,): what its changes between neighbours have besides slope and bend."""
    # A sum that cancels keeps the rounding of its terms. No scale of other entries tells how large those were: entries
    # have units of their own, and each state may be counted in another one.
    spacing = _APART * (abs(middle) + half)
    found = []
    for key in _LOOKED_AT:
        u = float(np.cos(np.pi * key))
        near = [function(middle + half * u - np.copysign(k * spacing, u)) for k in range(1, _NEIGHBOURS + 1)]
        values = [value for value in near if value is not None and value.size == known[key].size]
        if len(values) < _NEIGHBOURS:
            return None
        found.append(np.abs(np.diff([known[key], *values], _ORDER, axis=0)).max(axis=0))
    # Rounding is at all places. What is at one alone is a step of the function, which has no polynomial.
    return np.asarray(_NOISE * np.median(found, axis=0), float)


def polynomial_at(function: Callable[[float], Array | None], x: float, size: float) -> Polynomial | None:
    """The polynomial over the widest range about a place, or to one side of it, over which the functions are smooth.

    Parameters
    ----------
    function : callable
        As :func:`polynomial` takes it.
    size : float
        Where the place is zero, what is large there.

    Returns
    -------
    Polynomial or None
        None where there is no such range; a place that the function refuses by an `EppError` lies in none.
    """
    for half in (share * (abs(x) or size) for share in _AROUND):
        for side in (0.0, 1.0, -1.0):
            with suppress(EppError, IndexError, ValueError):
                found = polynomial(function, x + (side - 1.0) * half, x + (side + 1.0) * half)
                if found is not None:
                    return found
    return None


def _to_coefficients(degree: int) -> Array:
    """From values at Chebyshev's extrema to coefficients: the discrete cosine transform, shape (d + 1, d + 1)."""
    k = np.arange(degree + 1)
    out = np.cos(np.pi / degree * (np.outer(k, k) % (2 * degree))) * (2.0 / degree)
    # The first and last node, and the first and last coefficient, count half.
    for ends in (np.s_[[0, -1]], np.s_[:, [0, -1]]):
        out[ends] /= 2.0
    return np.asarray(out, float)
