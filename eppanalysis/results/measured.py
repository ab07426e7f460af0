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
        "amplitude" of the element's input and "frequency" [Hz]: where the describing function with the true response is
        in 95 of 100 cases, by the standard deviation of the data; zero or infinite where there is no end, empty where
        the data have none.
    at_a_fold : bool
        Whether the cycle and another one meet within what the noise leaves open, so that it may not exist.
    interpolation_error : float
        Estimated relative error of amplitude and frequency by what the response does between the points.
    highest_harmonic : int
        The highest that the data reach.
    beyond : float
        Most that all higher ones together can be of the element's input, over its fundamental, where the response rises
        no more beyond the data.
    """

    intervals: dict[str, tuple[float, float]] = field(default_factory=dict)
    at_a_fold: bool = False
    interpolation_error: float = float("nan")
    highest_harmonic: int = 0
    beyond: float = float("nan")

    in_json = f"{LimitCycle.in_json} intervals at_a_fold interpolation_error highest_harmonic beyond"

    @property
    def amplitude_of_first(self) -> float:
        """Amplitude at the input of the first element."""
        return float(next(iter(self.elements.values()))["amplitude"])

    def with_intervals(self) -> str:
        """Peak to peak and frequency with their intervals, and how far the data reach, in a sentence."""
        at_input = self.amplitude_of_first
        values = (
            ("amplitude", at_input, 2.0, "peak to peak", ""),
            ("frequency", self.frequency, 1.0, "frequency", " Hz"),
        )
        parts = []
        for name, value, factor, said, unit in values:
            low, high = (factor * end for end in self.intervals.get(name, (value, value)))
            between = f" ({low:.4g} to {high:.4g})" if low < high else ""
            parts.append(f"{said} {factor * value:.4g}{between}{unit}")
        doubt = "; at a fold within the noise, so that it may not exist" * self.at_a_fold
        return f"{', '.join(parts)}{doubt}; the data reach harmonic {self.highest_harmonic}"

    @classmethod
    def of(cls, cycle: LimitCycle, **found: Any) -> MeasuredCycle:
        """The same cycle with what belongs to its data."""
        return cls(**{**vars(cycle), **found})
