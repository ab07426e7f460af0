"""Cycles side by side of which one passes into the other: an integrator keeps for ever what it began with."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from eppanalysis.arrays import Array

#: Change once round, relative to the motion, that is rounding, and the share of its neighbours' size that a cycle
#: between two of one continuum has at least.
_STILL, _AS_LARGE = 1e-9, 0.9


def joined(one: Array, other: Array, once: Callable[[Array], Array | None]) -> bool:
    """Whether what lies midway between two cycles is a cycle as large: they are of one continuum then.

    Parameters
    ----------
    one, other : array, shape (samples, m)
        What repeats, at the samples of each.
    once : callable
        From what repeats, at the first sample of `one`, to that at all samples and at the next, shape (samples + 1, m);
        None where it is not so long in motion.
    """
    if one.shape != other.shape:
        return False
    shift = min(range(len(one)), key=lambda k: float(np.ptp(np.roll(other, -k, 0) - one, axis=0).max()))
    path = once(0.5 * (one[0] + other[shift]))
    if path is None:
        return False
    size, least = np.ptp(path, axis=0), np.minimum(np.ptp(one, axis=0), np.ptp(other, axis=0))
    back = np.abs(path[-1] - path[0]) <= _STILL * (size.max() + np.abs(path[0]))
    return bool(np.all(back) and np.all(size >= _AS_LARGE * least))
