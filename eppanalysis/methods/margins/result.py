"""What margins are: numbers that belong to a cut, and the gains in place of the elements in them."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from eppanalysis.arguments import checked
from eppanalysis.arrays import Array, ComplexArray
from eppanalysis.readable import number
from eppanalysis.results import Result, Status
from eppanalysis.shown import frame_of

if TYPE_CHECKING:
    import pandas
    from matplotlib.axes import Axes

_NAN = float("nan")
_UNITS = {"phase_margin": "rad", "delay_margin": "s", "phase_crossover": "rad/s", "gain_crossover": "rad/s"}


@dataclass(frozen=True, eq=False, repr=False)
class Margins(Result):
    """Margins of the linearised loop, cut open at one place.

    Attributes
    ----------
    at : str
        Where the loop is cut.
    status : Status
        INCOMPLETE where the loop leads through an element without a gain, or its stability is undecided.
    rule : tuple of str
        The gain of each element, and why.
    message : str
        What else there is to say; empty where there is nothing.
    gain_margin : float
        Factor on the loop gain that brings the loop to the border of stability, the one nearest to 1; infinite where
        none does, nan where the loop has no margins.
    phase_margin : float
        Phase that the loop may lose [rad], negative where it would have to gain it.
    disk_margin : float
        With d, any gain between (2 - d)/(2 + d) and (2 + d)/(2 - d) is borne, or any phase up to 2 atan(d/2); 0 where
        the linearised loop is unstable.
    delay_margin : float
        Dead time that brings a stable loop to the border [s]; 0 where the loop is unstable, nan where its stability is
        not decided.
    phase_crossover, gain_crossover, disk_frequency : float
        Where these are taken [rad/s]; nan where there is none.
    bandwidth : float
        Where the closed loop L/(1 + L) first falls 3 dB below what it is at rest [rad/s]; infinite where it never does,
        nan where the loop is unstable or passes nothing at rest.
    tracking_error : float
        How far the closed loop stays behind a ramp in the end, over its rate [s]: one over the velocity constant;
        infinite where it falls behind ever farther, nan where the loop is unstable.
    stable : bool or None
        Whether the linearised closed loop is stable; None where that is not decided.
    omega, response : array, complex array, shape (m,)
        The loop gain L, for a feedback of -1, on frequencies [rad/s] that show all that it does.
    """

    at: str
    status: Status
    rule: tuple[str, ...]
    message: str = ""
    gain_margin: float = _NAN
    phase_margin: float = _NAN
    disk_margin: float = _NAN
    delay_margin: float = _NAN
    phase_crossover: float = _NAN
    gain_crossover: float = _NAN
    disk_frequency: float = _NAN
    bandwidth: float = _NAN
    tracking_error: float = _NAN
    stable: bool | None = None
    omega: Array = field(default_factory=lambda: np.zeros(0))
    response: ComplexArray = field(default_factory=lambda: np.zeros(0, complex))

    in_json = (
        "at status gain_margin phase_margin disk_margin delay_margin phase_crossover gain_crossover disk_frequency "
        "bandwidth tracking_error stable rule message provenance"
    )

    @property
    def exist(self) -> bool:
        """Whether the loop has margins at this place at all."""
        return not math.isnan(self.gain_margin)

    def numbers(self) -> dict[str, float]:
        """The margins and their frequencies by name [SI]."""
        names = ["gain_margin", "phase_margin", "disk_margin", "delay_margin", "phase_crossover", "gain_crossover"]
        return {name: float(getattr(self, name)) for name in names}

    def summary(self) -> dict[str, Any]:
        """Where the loop is cut, the numbers, and the gains of the elements, for a prediction."""
        return {"at": self.at, **self.numbers(), "stable": self.stable, "rule": self.rule, "message": self.message}

    def __str__(self) -> str:
        """Whether the loop is stable, the numbers in the units that people read, and the cut."""
        if not self.exist:
            return f"No margins at {self.at}: {self.message[:1].lower()}{self.message[1:]}"
        parts = [
            f"gain margin {number(self.gain_margin)}{_at(self.phase_crossover)}",
            f"phase margin {_in(math.degrees(self.phase_margin), 'deg')}{_at(self.gain_crossover)}",
        ]
        others = f"disk margin {self.disk_margin:.4g}, delay margin {_in(self.delay_margin, 's')}"
        stable = {True: "stable", False: "unstable", None: "not decided"}[self.stable]
        return f"Linearised loop {stable}: {', '.join(parts)}; {others}; cut at {self.at}. {self.message}".rstrip()

    def to_frame(self) -> pandas.DataFrame:
        """One row: the place and the numbers [SI]."""
        return frame_of([{"at": self.at, **self.numbers(), "stable": self.stable}], _UNITS)

    @checked
    def plot(self, ax: Axes | None = None) -> Axes:
        """Nyquist plot of the loop cut open at the place, with its crossovers."""
        return self.drawn("plot_margins", ax)


def _in(value: float, unit: str) -> str:
    if math.isnan(value):
        return "not decided"
    return f"{number(value)} {unit}" if math.isfinite(value) else number(value)


def _at(omega: float) -> str:
    return "" if math.isnan(omega) else f" at {omega:.4g} rad/s"
