"""What a search for the least dither returns: the amplitude, the DF beside it, and the runs that tell."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from eppanalysis.arrays import Array
from eppanalysis.methods.dither.runs import DitherRun
from eppanalysis.methods.dither.smoothed import Wave, smoothed
from eppanalysis.models.elements.base import Nonlinearity
from eppanalysis.readable import count, percent
from eppanalysis.results import LimitCycle, Result, Status
from eppanalysis.shown import frame_of

if TYPE_CHECKING:
    import pandas
    from matplotlib.axes import Axes

#: Share of the dither that the loop may return before the sentence warns of it.
_MUCH = 0.05


@dataclass(frozen=True, eq=False, repr=False)
class Dither(Result):
    """The least dither that removes a limit cycle.

    Attributes
    ----------
    element : str
        Name of the element that is dithered.
    characteristic : Nonlinearity
        That element.
    wave : {"sine", "triangle"}
        Form of the dither.
    frequency : float
        Of the dither [Hz].
    amplitude : float
        The least at which runs show that the cycle goes, in the unit of the element's input; nan where none does.
    stays : float
        The largest at which they show that it stays, or cannot tell; 0 where they show none.
    first_order : float
        The least at which the describing function gives the smoothed loop no stable cycle; nan where it always does.
    size : float
        Peak-to-peak of the element's input on the cycle.
    cycle : LimitCycle
        The one that is removed.
    returned : float
        Share of the dither that the loop returns to the element's input, by the fundamental: zero for one that is fast.
    predicted : array, shape (k, 2)
        Amplitudes of the dither, and peak-to-peak of the slow cycle at the element's input there, by DF; 0 for
        none.
    runs : tuple of DitherRun
        By amplitude.
    status : Status
        UNDECIDED where runs do not show on both sides of one amplitude that the cycle stays and goes.
    """

    element: str
    characteristic: Nonlinearity
    wave: Wave
    frequency: float
    amplitude: float
    stays: float
    first_order: float
    size: float
    cycle: LimitCycle
    returned: float
    predicted: Array
    runs: tuple[DitherRun, ...]
    status: Status

    in_json = (
        "element wave frequency amplitude stays describing_function=first_order size returned status sentence "
        "cycle predicted runs operating_point provenance"
    )

    @property
    def effective(self) -> Nonlinearity:
        """What the least dither makes of the element: its `output` is the effective characteristic for slow inputs."""
        used = self.amplitude if np.isfinite(self.amplitude) else self.first_order
        return smoothed(self.characteristic, used, self.wave)

    @property
    def gain(self) -> float:
        """Its gain for small slow signals."""
        return float(np.real(self.effective.describing_function(0.0)[1]))

    def __str__(self) -> str:
        return self.sentence

    @property
    def sentence(self) -> str:
        """The least dither, the describing function's beside it, and what was not tried."""
        what = f"a {self.wave} of {self.frequency:.4g} Hz at the input of {self.element}"
        first = f"{self.first_order:.4g}" if np.isfinite(self.first_order) else "none"
        if not np.isfinite(self.amplitude):
            told = f"No amplitude tried removes the limit cycle by {what}; the describing function says {first}."
        elif not self.stays:
            told = (
                f"The limit cycle goes under a dither of amplitude {self.amplitude:.4g}, {what}, and under all less "
                "that were run."
            )
        else:
            told = (
                f"The least dither that removes the limit cycle has amplitude {self.amplitude:.4g}, {what}; at "
                f"{self.stays:.4g} {self._below()}. The describing function says {first}. The effective gain for "
                f"small signals is then {self.gain:.4g}."
            )
        if self.returned > _MUCH:
            told += (
                f" The loop returns {percent(self.returned)} of the dither to the element, which the describing "
                "function leaves out: of a faster one it would return less."
            )
        return (
            f"{told} Shown by {count(len(self.runs), 'run')} from the cycle and from the loop's own start; other "
            "starts were not tried."
        )

    def _below(self) -> str:
        unclear = any(run.amplitude == self.stays and run.gone is None for run in self.runs)
        return "the runs do not decide" if unclear else "it stays"

    def to_frame(self) -> pandas.DataFrame:
        """One row a run: amplitude of the dither [SI], start, share of the cycle left, periods, whether it is gone."""
        return frame_of([vars(run) for run in self.runs], {"amplitude": ""})

    def plot(self, ax: Axes | None = None) -> Axes:
        """What is left of the cycle over the dither's amplitude; the effective characteristic in a second panel."""
        return self.drawn("plot_dither", ax)
