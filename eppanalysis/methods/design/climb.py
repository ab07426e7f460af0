"""To the top of what is the least of several smooth functions, by their values and slopes alone.

Each place tried says by value and slope what is to be expected round it. The highest place of the least of
these expectations within reach is a linear programme; it is tried next, the reach grows where it was better and shrinks
where it was not. Neither a place where two functions meet nor the end of a range stops it, as both do Newton's method:
Bagirov, Karmitsa and Makela, Introduction to Nonsmooth Optimization, 2014, chapter 12 (bundle methods).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from eppanalysis.arrays import Array

#: Gain, relative to the value, below which there is nothing left to be had.
_NOTHING = 1e-7
#: From how far expectations count, in reaches; how the reach grows and shrinks.
_COUNTS, _GROWS, _SHRINKS = 3.0, 1.6, 0.4


@dataclass(frozen=True, eq=False)
class Slope:
    """A place [shares of the ranges] with its value and derivative."""

    place: Array
    value: float
    slope: Array


def climb(ask: Callable[[Array], Slope | None], start: Slope, reach: float, close: float, most: int) -> Slope:
    """The highest place that is found from a start, within the unit box.

    Parameters
    ----------
    ask : callable
        Value and slope at a place; None where it has none.
    reach : float
        The first reach, as a share of the ranges.
    close : float
        The reach at which it ends.
    most : int
        Places tried at most.
    """
    here, seen = start, [start]
    for _ in range(most):
        if reach < close:
            break
        place, expected = _highest(here, seen, reach)
        if expected - here.value <= _NOTHING * abs(here.value):
            break
        found = ask(place)
        # A lower place counts as well: what is expected round it keeps the next step away.
        if found is not None:
            seen.append(found)
        if found is not None and found.value > here.value:
            as_expected = found.value - here.value > 0.7 * (expected - here.value)
            reach = reach * _GROWS if as_expected else reach
            here = found
        else:
            reach *= _SHRINKS
    return here


def _highest(here: Slope, seen: list[Slope], reach: float) -> tuple[Array, float]:
    """The highest place of the least expectation within reach, and what is expected there."""
    from scipy.optimize import linprog

    m = here.place.size
    near = [s for s in seen if np.abs(s.place - here.place).max() <= _COUNTS * reach]
    scale = max(abs(here.value), 1e-300)
    rows, right = [], []
    for s in near:
        # Expectations from elsewhere that are below what is known here are lifted to it.
        at_here = max(s.value + float(s.slope @ (here.place - s.place)), here.value)
        rows.append(np.append(-s.slope, scale) / scale)
        right.append((at_here - float(s.slope @ here.place)) / scale)
    low, high = np.maximum(0.0, here.place - reach), np.minimum(1.0, here.place + reach)
    bounds = [*zip(low.tolist(), high.tolist(), strict=True), (None, None)]
    found = linprog([*np.zeros(m), -1.0], A_ub=np.array(rows), b_ub=np.array(right), bounds=bounds, method="highs")
    if found.x is None or not found.success:
        return here.place, here.value
    return np.clip(found.x[:m], low, high), float(found.x[m]) * scale
