"""What branches of all kinds share: where a function passes zero between two places, directions, and equations."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

import numpy as np

from eppanalysis.arrays import Array

P = TypeVar("P")
#: A place, and how far it is along the branch.
End = tuple[float, P]

#: Secants at most, and the share of the first value of the function below which rounding may keep it from zero.
_MOST, _NOISE = 40, 1e-6


def located(
    first: End[P],
    last: End[P],
    test: Callable[[P], float],
    at: Callable[[End[P], End[P], float], P | None],
    tolerance: float,
) -> P | None:
    """Where `test` changes its sign between two places of a branch, by regula falsi (Illinois); None where it does not.

    Parameters
    ----------
    first, last : tuple of (float, place)
    test : callable
    at : callable
        The place at a distance between two known ones; None where none is found, which ends the search.
    tolerance : float
        Of `test`. It also ends where rounding keeps `test` from becoming smaller.
    """
    ends = [(*first, test(first[1])), (*last, test(last[1]))]
    if ends[0][2] * ends[1][2] > 0:
        return None
    best, least = min(((p, abs(f)) for _, p, f in ends), key=lambda pair: pair[1])
    reach, size, moved, in_vain = abs(last[0] - first[0]), max(abs(f) for *_, f in ends), -1, 0
    for _ in range(_MOST):
        (a, p_a, f_a), (b, p_b, f_b) = ends
        if abs(b - a) < 1e-14 * reach or f_a == f_b:  # zero at both
            break
        c = (a * f_b - b * f_a) / (f_b - f_a)
        found = at((a, p_a), (b, p_b), c)
        if found is None:
            return best
        f_c = test(found)
        in_vain = 0 if abs(f_c) < least else in_vain + 1
        if in_vain == 0:
            best, least = found, abs(f_c)
        if least < tolerance or (in_vain > 1 and least < _NOISE * size):
            break
        side = int(f_c * f_b > 0)
        ends[side] = c, found, f_c
        if side == moved:  # an end that stays counts half, or it might stay for ever
            s, p, f = ends[1 - side]
            ends[1 - side] = s, p, 0.5 * f
        moved = side
    return best


def turned(weights: Array, old: Array, new: Array) -> float:
    """How much a direction turns, in weighted coordinates: one less the cosine of the angle."""
    sizes = np.sqrt(np.sum(weights * old**2) * np.sum(weights * new**2))
    return float(1.0 - np.sum(weights * old * new) / sizes)


def solved(K: Array, right: Array) -> Array:
    """The solution of ``K s = right``, a least one where K is singular; nan where not all of it are numbers."""
    if not (np.isfinite(K).all() and np.isfinite(right).all()):
        return np.full_like(right, np.nan)  # LAPACK would complain on the terminal
    try:
        return np.asarray(np.linalg.solve(K, right))
    except np.linalg.LinAlgError:
        return np.asarray(np.linalg.lstsq(K, right, rcond=None)[0])
