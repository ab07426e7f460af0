"""What happens to a motion at a special point of a branch."""

from __future__ import annotations

from enum import StrEnum

import numpy as np

from eppanalysis.arrays import ComplexArray


class Change(StrEnum):
    """What happens at a special point of a branch."""

    FOLD = "fold"
    PERIOD_DOUBLING = "period doubling"
    TORUS = "torus"
    BRANCH_POINT = "branch point"
    SEQUENCE = "change of sequence"
    TURNING = "turning change of sequence"
    END = "end"
    #: Where the branch goes on at one value of the parameter for ever: the period grows without bound, or cycles of all
    #: sizes exist there.
    INFINITE = "infinite period"
    CONTINUUM = "continuum"
    #: Where at each value of the parameter cycles of many sizes exist: which of them a branch takes would be rounding.
    CONTINUA = "continuum at each value"
    #: Where the cycle becomes the free oscillation of the linear loop, which is at the limit of stability there.
    LINEAR = "linear limit"
    #: Where a function that is watched along the branch, such as the size of the cycle, passes zero.
    PASSAGE = "passage"
    #: Of a sampled loop: the cycle ceases, and the branch goes on with one that has another place among the samples.
    SAMPLES = "change of samples"


def left(values: ComplexArray) -> tuple[Change, complex]:
    """What a multiplier does that has just left the unit circle, and which it is; values sorted, largest first."""
    # Of those outside the circle the last one is the nearest to it.
    leading = complex(values[np.abs(values) >= 1.0][-1])
    if abs(leading.imag) > 1e-9:
        return Change.TORUS, leading
    return (Change.PERIOD_DOUBLING if leading.real < 0 else Change.BRANCH_POINT), leading
