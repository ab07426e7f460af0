"""Compiled: how far signals go that are Legendre series on each of many pieces."""

import numpy as np

from eppanalysis.kernels.compiling import KERNEL, PART, njit

#: Pieces in which an extremum is looked for: the best value on the grid may stand at the end of one, with the extremum
#: just inside the next.
_TRIED = 4
_ITERATIONS, _STANDS = 8, 1e-9


@njit(**KERNEL)
def spans(c, fine, grid, out):
    """Greatest less least value of each signal: the best values on a grid, each refined by Newton's method.

    Parameters
    ----------
    c : array, shape (signals, pieces, degrees)
        Legendre coefficients.
    fine : array, shape (signals, pieces, points)
        The signals on the grid of each piece.
    grid : array, shape (points,)
        From -1 to 1.
    out : array, shape (signals,)
        Filled.
    """
    for s in range(len(out)):
        # A least value is the greatest of the mirror image.
        out[s] = _greatest(c[s], fine[s], grid, 1.0) + _greatest(c[s], fine[s], grid, -1.0)


@njit(**PART)
def _greatest(c, fine, grid, sign):
    place, height = np.zeros(len(c), np.int64), np.full(len(c), -np.inf)
    for p in range(len(c)):
        for k in range(grid.size):
            if sign * fine[p, k] > height[p]:
                place[p], height[p] = k, sign * fine[p, k]
    greatest = -np.inf
    for _ in range(min(_TRIED, len(c))):
        best = 0
        for p in range(len(c)):
            if height[p] > height[best]:
                best = p
        greatest = max(greatest, height[best], _top(c[best], grid[place[best]], sign))
        height[best] = -np.inf
    return greatest


@njit(**PART)
def _top(c, u, sign):
    """Value of a series at the greatest value next to u, as far as Newton's method gets on the piece."""
    value = -np.inf
    for _ in range(_ITERATIONS):
        # Legendre polynomials of two degrees with their first two derivatives, and what they sum up to.
        p0, p1, d0, d1, b0, b1 = 1.0, u, 0.0, 1.0, 0.0, 0.0
        value, slope, bend = sign * (c[0] + c[1] * u), sign * c[1], 0.0
        for k in range(1, c.size - 1):
            odd = 2.0 * k + 1.0
            p0, p1, d0, d1, b0, b1 = p1, (odd * u * p1 - k * p0) / (k + 1.0), d1, d0 + odd * p1, b1, b0 + odd * d1
            value, slope, bend = value + sign * c[k + 1] * p1, slope + sign * c[k + 1] * d1, bend + sign * c[k + 1] * b1
        step = slope / bend if bend < 0.0 else 0.0
        before, u = u, min(max(u - step, -1.0), 1.0)
        if abs(u - before) < _STANDS:
            break
    return value
