"""Functions of one variable as polynomials that agree with them to rounding, and by these their derivatives.

The numbers of a loop come from some hundred constructors that work on plain floats. Each number is an analytic function
of a parameter, so that the coefficients of its Chebyshev polynomials fall off until they are rounding; what is left of
them is the number itself, and can be differentiated as it stands.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import NDArray

from eppanalysis.errors import EppError

Array = NDArray[np.float64]

#: Degrees that are tried. The places of one are among those of the next.
DEGREES = (4, 8, 16, 32)
#: Largest of the last two coefficients, and one that rounding makes of zero, relative to the sum of all; the largest
#: that is taken for noise where it is as large at twice the degree.
_RESOLVED, _ROUNDING, _NOISE = 4e-15, 4e-16, 1e-10
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
    """

    middle: float
    half: float
    base: Array
    places: NDArray[np.intp]
    coefficients: Array

    def covers(self, x: float) -> bool:
        """Whether a place is within the range."""
        return abs(x - self.middle) <= self.half * (1.0 + 1e-12)

    def at(self, x: float) -> Array:
        """All entries at a place."""
        out = self.base.copy()
        # As cosines: the place stays within the range, whatever rounding makes of its ends.
        angle = np.arccos(np.clip((x - self.middle) / self.half, -1.0, 1.0))
        out[self.places] = np.cos(angle * np.arange(self.coefficients.shape[0])) @ self.coefficients
        return out

    def slope(self, x: float) -> Array:
        """Derivatives of all entries at a place."""
        out = np.zeros(self.base.size)
        if self.places.size:
            share = min(max((x - self.middle) / self.half, -1.0), 1.0)
            out[self.places] = chebyshev.chebval(share, chebyshev.chebder(self.coefficients)) / self.half
        return out


def polynomial(function: Callable[[float], Array | None], low: float, high: float) -> Polynomial | None:
    """The polynomial of a vector of functions between two places.

    Parameters
    ----------
    function : callable
        The vector (n,) at a place; None where it is another one.
    low, high : float

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
    known: dict[float, Array] = {}
    before = np.inf
    for degree in DEGREES:
        nodes = np.cos(np.pi * np.arange(degree + 1) / degree)
        for k in range(degree + 1):
            if k / degree not in known:
                value = function(middle + half * float(nodes[k]))
                if value is None or (known and value.size != known[0.0].size):
                    return None
                known[k / degree] = value
        rows = np.array([known[k / degree] for k in range(degree + 1)])
        places = np.flatnonzero(np.any(rows != rows[0], axis=0))
        # From their difference to one of them: what is the same at all places would leave its rounding.
        c = _to_coefficients(degree) @ (rows[:, places] - rows[0, places])
        c[0] += rows[0, places]
        share = np.abs(c) / np.abs(c).sum(axis=0)
        tail = share[-2:].max(axis=0)
        worst = float(tail.max(initial=0.0))
        if worst <= _RESOLVED or 0.1 * before < worst <= _NOISE:
            # What is noise in the coefficients of an entry would count degree^2 times in its derivative.
            noise = np.where(tail <= _RESOLVED, _ROUNDING, 4.0 * tail)
            return Polynomial(middle, half, rows[0], places, np.where(share > noise, c, 0.0))
        before = worst
    return None


def polynomial_at(function: Callable[[float], Array | None], x: float, size: float) -> Polynomial | None:
    """The polynomial over the widest range about a place, or to one side of it, over which the functions are smooth.

    Parameters
    ----------
    function : callable
        As :func:`polynomial` takes it.
    x : float
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
