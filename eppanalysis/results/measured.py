"""A limit cycle that is predicted from measured data: what it takes from them, and how well they tell it."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from eppanalysis.results import LimitCycle


@dataclass(frozen=True, eq=False, repr=False)
class MeasuredCycle(LimitCycle):
    """A limit cycle of a measured linear part and an element.

    Attributes
    ----------
    intervals : dict of str to (float, float)
        "amplitude" of the element's input and "frequency" [Hz]: where first order with the true response is in 95 of
        100 cases, by the standard deviation of the data; empty where they have none.
    interpolation_error : float
        Estimated relative error of amplitude and frequency by what the response does between the points.
    highest_harmonic : int
        The highest that the data reach.
    beyond : float
        Most that all higher ones together can be of the element's input, over its fundamental, where the response rises
        no more beyond the data.
    """

    intervals: dict[str, tuple[float, float]] = field(default_factory=dict)
    interpolation_error: float = float("nan")
    highest_harmonic: int = 0
    beyond: float = float("nan")

    in_json = f"{LimitCycle.in_json} intervals interpolation_error highest_harmonic beyond"

    def with_intervals(self) -> str:
        """Amplitude and frequency with their intervals, and how far the data reach, in a sentence."""
        amplitude = float(next(iter(self.elements.values()))["amplitude"])
        values = {"amplitude": (amplitude, ""), "frequency": (self.frequency, " Hz")}
        parts = []
        for name, (value, unit) in values.items():
            low, high = self.intervals.get(name, (value, value))
            between = f" ({low:.4g} to {high:.4g})" if low < high else ""
            parts.append(f"{name} {value:.4g}{between}{unit}")
        return f"{', '.join(parts)}; the data reach harmonic {self.highest_harmonic}"

    @classmethod
    def of(cls, cycle: LimitCycle, **found: Any) -> MeasuredCycle:
        """The same cycle with what belongs to its data."""
        return cls(**{**vars(cycle), **found})
