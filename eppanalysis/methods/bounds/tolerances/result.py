"""What a bound under tolerances is: nominal, in the worst case, and with a probability."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from eppanalysis.arguments import checked
from eppanalysis.arrays import Array
from eppanalysis.limits import Limit, Printed
from eppanalysis.readable import listed, number, words
from eppanalysis.results import Result, Status
from eppanalysis.shown import frame_of

if TYPE_CHECKING:
    import pandas
    from matplotlib.axes import Axes


@dataclass(frozen=True)
class Quantile:
    """The bound that holds with a probability."""

    probability: float
    value: float  # [SI]; nan where there are too few draws
    #: low, high: its 95 % confidence interval.
    low: float
    high: float


@dataclass(frozen=True, eq=False, repr=False)
class ToleranceBound(Result):
    """The bound of a case whose parameters carry tolerances.

    Attributes
    ----------
    limit, unit : str
        The parameter that is bounded, and its SI unit.
    readable : (str, float)
        The unit that people use for it, and the factor from SI to that.
    sign : float
        1: free below the bound; -1: free above it.
    half_widths : dict of str to float
        Of the parameters [SI].
    nominal, worst_case : float
        Exact bounds with the parameters at their values, and anywhere in their box [SI].
    worst_values : dict of str to float
        Parameters in the worst case [SI].
    n_corners : int
        Corners checked besides.
    quantiles : tuple of Quantile
        Bounds that hold with each given probability, with their confidence intervals.
    draws : array, shape (samples,)
        Bounds of the draws [SI].
    engine_offset : float
        Relative difference of the nominal bound as runs see it from the exact one.
    message : str
        What is missing; empty where nothing is.
    not_covered : str
        What bounds of the search do not cover, in a sentence; empty where they are exact.
    """

    limit: str
    unit: str
    readable: tuple[str, float]
    sign: float
    half_widths: dict[str, float]
    nominal: float
    worst_case: float
    worst_values: dict[str, float]
    n_corners: int
    quantiles: tuple[Quantile, ...]
    draws: Array
    engine_offset: float
    message: str = ""
    not_covered: str = ""

    in_json = (
        "limit unit sign half_widths nominal worst_case worst_values n_corners quantiles samples=draws.size "
        "engine_offset message not_covered provenance"
    )

    def __str__(self) -> str:
        """The bound in the worst case, beside the nominal one and those that hold with a probability."""
        side = "below" if self.sign > 0 else "above"
        printed = Printed(*self.readable)
        worst, nominal = (printed.computed(Limit(value, self.sign < 0)) for value in (self.worst_case, self.nominal))
        shares = [
            f"{side} {printed.computed(Limit(q.value, self.sign < 0))} in {number(100 * q.probability)} %"
            for q in self.quantiles
            if np.isfinite(q.value)
        ]
        rest = f"; of all designs, {listed(shares)}" if shares else ""
        free = "No limit cycle was found" if self.not_covered else "Free of limit cycles"
        where = "at the corners of the tolerances" if self.not_covered else "wherever the tolerances lie"
        beside = "".join(f" {text}" for text in (self.message, self.not_covered) if text)
        return (
            f"{free} {side} a {words(self.limit)} of {worst} {where}, against {nominal} at the nominal values{rest}."
            f"{beside}"
        )

    def to_frame(self) -> pandas.DataFrame:
        """The bounds, one a row [SI], with the ends of the 95 % intervals of those that hold with a probability."""
        rows: list[dict[str, object]] = [
            {"holds": "at the nominal values", "bound": self.nominal},
            {"holds": "in the worst case", "bound": self.worst_case},
        ]
        rows += [
            {"holds": f"in {number(100 * q.probability)} %", "bound": q.value, "low": q.low, "high": q.high}
            for q in self.quantiles
        ]
        columns = ("bound", "low", "high")
        return frame_of(rows, dict.fromkeys(columns, self.unit), dict.fromkeys(columns, self.readable))

    @checked
    def plot(self, ax: Axes | None = None) -> Axes:
        """The bounds of the draws, with the nominal one and the worst case."""
        return self.drawn("plot_tolerance", ax)

    @property
    def status(self) -> Status:
        """CONVERGED where nothing is missing; INCOMPLETE where something is not covered alone."""
        if self.message:
            return Status.UNDECIDED
        return Status.INCOMPLETE if self.not_covered else Status.CONVERGED
