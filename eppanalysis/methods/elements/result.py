"""What the check of an element returns."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from eppanalysis.arguments import checked
from eppanalysis.arrays import Array, ComplexArray
from eppanalysis.methods.elements.rules import Finding, Flaw
from eppanalysis.readable import number, words
from eppanalysis.results import Result, Status
from eppanalysis.shown import frame_of

if TYPE_CHECKING:
    import pandas
    from matplotlib.axes import Axes

#: Energy that is rounding, over amplitude times output.
_ROUNDING = 1e-9


@dataclass(frozen=True, eq=False, repr=False)
class ElementCheck(Result):
    """Whether an element's rules are unambiguous, whether it can chatter, and what it does to a sine.

    Attributes
    ----------
    name : str
        Of the element.
    status : Status
        INCOMPLETE where the rules are not decided or there is no describing function; `message` says why.
    findings : tuple of Finding
        Overlaps, ties, endless chains and chatter, each with an example.
    amplitudes : array, shape (n,)
        Of the sine at the input [its unit].
    omega : float
        Angular frequency of the sine [rad/s].
    mean, gain : array, complex array, shape (n,)
        Describing function of the first output there.
    over_way, over_speed : array, shape (n,)
        Energy that it takes up in a period where the input is a displacement and the output the force against it, and
        where the input is a speed [product of their units; times s over a speed]. Negative: it gives off energy.
    decided : bool
        Whether the rules could be examined.
    message : str
        Why the check is incomplete; empty where it is not.
    """

    name: str
    status: Status
    findings: tuple[Finding, ...] = ()
    amplitudes: Array = field(default_factory=lambda: np.zeros(0))
    mean: Array = field(default_factory=lambda: np.zeros(0))
    gain: ComplexArray = field(default_factory=lambda: np.zeros(0, complex))
    over_way: Array = field(default_factory=lambda: np.zeros(0))
    over_speed: Array = field(default_factory=lambda: np.zeros(0))
    omega: float = 1.0
    decided: bool = True
    message: str = ""

    in_json = (
        "name status message deterministic can_chatter gives_off_over_way gives_off_over_speed findings amplitudes "
        "mean gain over_way over_speed provenance"
    )

    @property
    def deterministic(self) -> bool | None:
        """Whether at most one thing can happen at a time, where surfaces of guards meet left aside; None: not decided.

        An endless chain of events in no time leads nowhere, and counts as not deterministic.
        """
        return not any(f.kind in (Flaw.OVERLAP, Flaw.ENDLESS) for f in self.findings) if self.decided else None

    @property
    def can_chatter(self) -> bool | None:
        """Whether events can take one another back without a gap while the output jumps; None: not decided."""
        return any(f.kind in (Flaw.CHATTER, Flaw.ENDLESS) for f in self.findings) if self.decided else None

    @property
    def gives_off_over_way(self) -> Array:
        """Amplitudes at which it gives off energy where the input is a displacement."""
        return self._negative(self.over_way)

    @property
    def gives_off_over_speed(self) -> Array:
        """Amplitudes at which it gives off energy where the input is a speed."""
        return self._negative(self.over_speed)

    def _negative(self, energy: Array) -> Array:
        size = self.amplitudes**2 * np.abs(self.gain)
        return np.asarray(self.amplitudes[energy < -_ROUNDING * np.max(size, initial=0.0)])

    def to_frame(self) -> pandas.DataFrame:
        """The amplitudes, one a row: mean, gain, phase [rad], and the energy over a displacement and over a speed."""
        columns = {
            "amplitude": self.amplitudes, "mean": self.mean, "gain": np.abs(self.gain), "phase": np.angle(self.gain),
            "energy over a displacement": self.over_way, "energy over a speed": self.over_speed,
        }  # fmt: skip
        every = zip(*(column.tolist() for column in columns.values()), strict=True)
        rows = [dict(zip(columns, row, strict=True)) for row in every]
        return frame_of(rows, {"phase": "rad"})

    def __str__(self) -> str:
        """Whether it is deterministic and can chatter, and over what it gives off energy, in one sentence."""
        parts = [f"The rules of {words(self.name)} are {self._rules()}"]
        if self.amplitudes.size:
            where = (
                self._where("a displacement", self.gives_off_over_way),
                self._where("a speed", self.gives_off_over_speed),
            )
            there = " and ".join(filter(None, where)) or f"at none of {self.amplitudes.size} amplitudes"
            parts.append(f"it gives off energy {there}")
        return f"{'; '.join(parts)}.{f' {self.message}' if self.message else ''}"

    def _rules(self) -> str:
        if not self.decided:
            return "not decided"
        said = {True: "deterministic", False: "not deterministic"}[bool(self.deterministic)]
        said += " and can chatter" if self.can_chatter else " and cannot chatter"
        # The worst of them, with its example.
        worst = min(self.findings, key=lambda f: list(Flaw).index(f.kind), default=None)
        return said if worst is None else f"{said} ({sentence(worst)})"

    def _where(self, over: str, given: Array) -> str:
        if not given.size:
            return ""
        where = f"{number(float(given[0]))} to {number(float(given[-1]))}"
        return f"as a force over {over} at {given.size} of {self.amplitudes.size} amplitudes, {where}"

    @checked
    def plot(self, ax: Axes | None = None) -> Axes:
        """Describing function over the amplitude, and below it the energy; a given `ax` takes the first alone."""
        return self.drawn("plot_element_check", ax)


def sentence(finding: Finding) -> str:
    """A finding in words, with its example."""
    guards = " and ".join(repr(name) for name in dict.fromkeys(finding.guards))
    parts = (("input", finding.inputs), ("rate", finding.rates), ("memory", finding.memory))
    named = (f"{what} {', '.join(number(v) for v in values)}" for what, values in parts if values)
    where = f"in mode {finding.mode!r}, for instance at {', '.join(named)}"
    return {
        Flaw.OVERLAP: f"{guards} rise together {where}",
        Flaw.TIE: f"{guards} meet {where}: there the first counts",
        Flaw.ENDLESS: f"{guards} begins events without end {where}",
        Flaw.CHATTER: f"{guards} follow one another without a gap {where}",
    }[finding.kind]
