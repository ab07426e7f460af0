"""What the onset point of a limited rate is: a frequency, a place in Nichols' chart, and a side of the boundary."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from eppanalysis.arguments import checked
from eppanalysis.arrays import Array, ComplexArray
from eppanalysis.readable import words
from eppanalysis.results import Result, Status
from eppanalysis.shown import frame_of

if TYPE_CHECKING:
    import pandas
    from matplotlib.axes import Axes

#: Duda's boundary in Nichols' chart: phase [deg] and magnitude [dB].
BOUNDARY = ((-180.0, 0.0), (-160.0, 0.0), (-140.0, 1.1), (-120.0, 2.5), (-100.0, 5.5), (-90.0, 7.5), (-60.0, 13.5))


@dataclass(frozen=True, eq=False, repr=False)
class OnsetPoint(Result):
    """Open-loop onset point of a rate limiter.

    Attributes
    ----------
    at : str
        The limiter, where the loop is cut.
    status : Status
        INCOMPLETE where the boundary says nothing: the linearised loop is not stable, or the phase is outside.
    amplitude : float
        Of the sine at the reference [SI].
    omega : float
        Onset frequency [rad/s]; nan where the limit is not reached.
    phase, gain : float
        Phase [rad] and gain (a factor) of the open loop there.
    boundary : float
        Gain on the boundary at that phase; nan outside it.
    message : str
        What else there is to say; empty where there is nothing.
    rule : tuple of str
        The gain of each element, and why.
    frequencies, response : array, complex array, shape (m,)
        The open loop, for a feedback of -1, on frequencies [rad/s].
    """

    at: str
    status: Status
    amplitude: float
    omega: float
    phase: float
    gain: float
    boundary: float
    message: str = ""
    rule: tuple[str, ...] = ()
    frequencies: Array = field(default_factory=lambda: np.zeros(0))
    response: ComplexArray = field(default_factory=lambda: np.zeros(0, complex))

    def to_frame(self) -> pandas.DataFrame:
        """One row: where it is cut, the onset frequency, the open loop there, the boundary and the margin."""
        row = {"at": self.at, "omega": self.omega, "phase": self.phase, "gain": self.gain}
        row |= {"boundary": self.boundary, "margin": self.margin}
        return frame_of([row], {"omega": "rad/s", "phase": "rad"})

    in_json = "at status amplitude omega phase gain boundary margin prone rule message provenance"

    @property
    def margin(self) -> float:
        """Factor between the boundary and the open loop: above one, the loop gain may grow by it before the point is on
        the boundary; infinite where the limit is not reached, nan where the boundary says nothing.
        """
        if not self.status.ok:
            return float("nan")
        return math.inf if math.isnan(self.omega) else self.boundary / self.gain

    @property
    def prone(self) -> bool | None:
        """Whether the loop is prone to jump once the limit sets in; None where the boundary says nothing."""
        return None if math.isnan(self.margin) else self.margin < 1.0

    def __str__(self) -> str:
        """Whether the loop is prone to jump, and the point in the units that people read."""
        if math.isnan(self.omega):
            return f"Onset point of {words(self.at)}: {self.message}"
        place = (
            f"rate reached at {self.omega:.4g} rad/s, where the open loop has {_decibels(self.gain):.4g} dB at "
            f"{math.degrees(self.phase):.4g} deg"
        )
        if self.prone is None:
            return f"Onset point of {words(self.at)}: {place}. {self.message}"
        side = "above" if self.prone else "below"
        verdict = "Prone to jump" if self.prone else "Not prone to jump"
        off = f"the onset point of {words(self.at)} lies {abs(_decibels(self.margin)):.4g} dB {side} the boundary"
        return f"{verdict}: {off}; {place}."

    @checked
    def plot(self, ax: Axes | None = None) -> Axes:
        """Nichols chart with the open loop, the boundary and the point."""
        return self.drawn("plot_onset_point", ax)


def _decibels(gain: float) -> float:
    return 20.0 * math.log10(gain) if gain > 0 else -math.inf
