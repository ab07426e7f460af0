"""What happens to a motion at a special point of a branch."""

from __future__ import annotations

from enum import StrEnum


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
