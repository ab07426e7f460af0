"""Roots and minima along one variable, of functions of many points at once: all that are sought move together."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from eppanalysis.arrays import Array, BoolArray

#: Values (n,) at points (n,), each of the function of its number.
Numbered = Callable[[Array, NDArray[np.intp]], Array]

GOLDEN = (np.sqrt(5.0) - 1.0) / 2.0
_MOST_STEPS = 60


def between(f: Numbered, low: Array, high: Array) -> Array:
    """Roots of ``f(x, number)`` in brackets (n,), each with its number; not-a-number without a change of sign.

    By false position in which an end that stays counts half (the Illinois rule), every third step a halving. Where f is
    zero over a stretch, a point of it.

    Examples
    --------
    >>> import numpy as np
    >>> between(lambda x, i: x * x - np.array([2.0, 9.0])[i], np.zeros(2), np.full(2, 5.0)).round(9).tolist()
    [1.414213562, 3.0]
    """
    low, high = low.copy(), high.copy()
    every = np.arange(low.size)
    f_low, f_high = f(low, every), f(high, every)
    out = np.where(f_low == 0, low, np.where(f_high == 0, high, np.nan))
    todo = np.flatnonzero(f_low * f_high < 0)
    for step in range(2 * _MOST_STEPS):
        if not todo.size:
            break
        share = np.clip(f_low[todo] / (f_low[todo] - f_high[todo]), 1e-3, 1 - 1e-3) if step % 3 else 0.5
        x = low[todo] + share * (high[todo] - low[todo])
        value = f(x, todo)
        left = (value < 0) == (f_low[todo] < 0)
        f_low[todo], f_high[todo] = (
            np.where(left, value, 0.5 * f_low[todo]),
            np.where(left, 0.5 * f_high[todo], value),
        )
        low[todo], high[todo] = np.where(left, x, low[todo]), np.where(left, high[todo], x)
        out[todo] = x
        narrow = high[todo] - low[todo] <= 4e-16 * np.maximum(np.abs(low[todo]), np.abs(high[todo]))
        todo = todo[(value != 0) & ~narrow]
    return out


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
    >>> at, value = least(lambda x, i: (x - 2.0) ** 2, x, (x - 2.0) ** 2, lambda x, y: x[2] - x[0] > 1e-6)
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
