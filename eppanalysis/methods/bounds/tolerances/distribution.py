"""How values are distributed within a tolerance."""

from __future__ import annotations

from enum import StrEnum

import numpy as np

from eppanalysis.arrays import Array
from eppanalysis.errors import EppError, shown


class Distribution(StrEnum):
    """Even within a tolerance, or normal with a third of it as standard deviation, cut at its ends."""

    UNIFORM = "uniform"
    NORMAL = "normal"

    @classmethod
    def called(cls, name: str, who: str) -> Distribution:
        """The one of a name.

        Raises
        ------
        EppError
            If there is none.
        """
        if name not in list(cls):
            raise EppError(f"{who}: the distribution is {shown(name)}; expected 'uniform' or 'normal'.")
        return cls(name)

    def within(self, share: Array) -> Array:
        """Values between -1 and 1 from shares (any shape) that are even between 0 and 1."""
        from scipy.stats import truncnorm

        if self is Distribution.UNIFORM:
            return 2.0 * share - 1.0
        return np.asarray(truncnorm(-3.0, 3.0).ppf(share) / 3.0, float)
