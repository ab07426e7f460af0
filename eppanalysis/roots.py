"""Roots and minima along one variable, of functions of many points at once (all that are sought move together), and
stretches between them.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from eppanalysis.arrays import Array, BoolArray

#: Values (n,) at points (n,), each of the function of its number.
Numbered = Callable[[Array, NDArray[np.intp]], Array]

GOLDEN = (np.sqrt(5.0) - 1.0) / 2.0
_MOST_STEPS = 60


def between(f: Numbered, low: Array, high: Array, ends: tuple[Array, Array] | None = None) -> Array:
    """Roots of ``f(x, number)`` in brackets (n,), each with its number; not-a-number without a change of sign.

    By Chandrupatla's rule: the parabola of x over f through the last three points, where that is monotone between them,
    else a halving. Where f is zero over a stretch, a point of it. Values at the ends may be given.

    Examples
    --------
    >>> import numpy as np
    >>> square = np.array([2.0, 9.0])
    >>> roots = between(lambda x, i: x * x - square[i], np.zeros(2), np.full(2, 5.0))
    >>> roots.round(9).tolist()
    [1.414213562, 3.0]
    """
    every = np.arange(low.size)
    f_low, f_high = (f(low, every), f(high, every)) if ends is None else ends
    out = np.where(f_low == 0, low, np.where(f_high == 0, high, np.nan))
    todo = np.flatnonzero(f_low * f_high < 0)
    # The last point, that on the other side of the root, and what either replaced.
    x, other, fx, f_other = (v[todo] for v in (low, high, f_low, f_high))
    share = np.clip(fx / (fx - f_other), 1e-3, 1.0 - 1e-3)
    for _ in range(2 * _MOST_STEPS):
        if not todo.size:
            break
        new = x + share * (other - x)
        value = f(new, todo)
        same = (value < 0) == (fx < 0)
        before, f_before = np.where(same, x, other), np.where(same, fx, f_other)
        other, f_other = np.where(same, other, x), np.where(same, f_other, fx)
        x, fx = new, value
        out[todo] = best = np.where(np.abs(f_other) < np.abs(fx), other, x)
        left = other - x
        least_share = 4e-16 * np.abs(best) / np.abs(left)
        kept = np.flatnonzero((fx != 0) & (least_share < 0.5))
        share = np.clip(_share(x, other, before, fx, f_other, f_before), least_share, 1.0 - least_share)
        todo, x, other, fx, f_other, share = todo[kept], x[kept], other[kept], fx[kept], f_other[kept], share[kept]
    return out


@np.errstate(all="ignore")
def _share(x: Array, other: Array, before: Array, f: Array, f_other: Array, f_before: Array) -> Array:
    """Of the way from a point to that on the other side of a root: where the root is taken to be."""
    place, height = (x - other) / (before - other), (f - f_other) / (f_before - f_other)
    monotone = (height**2 < place) & ((1.0 - height) ** 2 < 1.0 - place)
    inverse = f / (f_other - f) * f_before / (f_other - f_before)
    inverse += (before - x) / (other - x) * f / (f_before - f) * f_other / (f_before - f_other)
    return np.where(monotone, inverse, 0.5)


def least(f: Numbered, x: Array, y: Array, wanted: Callable[[Array, Array], BoolArray]) -> tuple[Array, Array]:
    """Minima of ``f(x, number)`` by golden section, and the values there, shapes (n,).

    Parameters
    ----------
    f : callable
    x, y : array, shape (3, n)
        Of each minimum left end, point inside and right end, and the values there.
    wanted : callable
        From such arrays which minima are still sought, bool array (n,).

    Examples
    --------
    >>> import numpy as np
    >>> x = np.array([[0.0], [1.0], [5.0]])
    >>> bowl = (x - 2.0) ** 2
    >>> goes_on = lambda x, y: x[2] - x[0] > 1e-6
    >>> at, value = least(lambda x, i: (x - 2.0) ** 2, x, bowl, goes_on)
    >>> at.round(5).tolist()
    [2.0]
    """
    (left, best, right), (f_left, f_best, f_right) = x, y = x.copy(), y.copy()
    for _ in range(_MOST_STEPS):
        k = np.flatnonzero(wanted(x, y))
        if not k.size:
            break
        after = right[k] - best[k] > best[k] - left[k]
        u = best[k] + (1.0 - GOLDEN) * np.where(after, right[k] - best[k], left[k] - best[k])
        value = f(u, k)
        better = value < f_best[k]
        # The better of the two points stays inside, the other one becomes the end on its side.
        for end, f_end, side in ((left, f_left, after == better), (right, f_right, after != better)):
            end[k[side]] = np.where(better, best[k], u)[side]
            f_end[k[side]] = np.where(better, f_best[k], value)[side]
        best[k], f_best[k] = np.where(better, u, best[k]), np.where(better, value, f_best[k])
    return best, f_best


def stretches(mask: BoolArray) -> list[slice]:
    """Stretches of True that hold two points or more."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(int)))
    return [slice(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True) if b - a > 1]
