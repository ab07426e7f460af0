"""What a continuation returns: a branch of limit cycles over a parameter, with what is special on it."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from eppanalysis.arguments import checked
from eppanalysis.arrays import Array
from eppanalysis.limits import Limit, Printed
from eppanalysis.methods.continuation.cover import Gap, covered
from eppanalysis.methods.continuation.steps import BranchPoint
from eppanalysis.methods.steady.changes import Change
from eppanalysis.readable import count, listed, quantity, readable, words
from eppanalysis.results import Brief, LimitCycle, Result, Status
from eppanalysis.shown import frame_of

if TYPE_CHECKING:
    import pandas
    from matplotlib.axes import Axes


#: Where the cycles of a branch cease to exist.
CEASES = (Change.FOLD, Change.TURNING, Change.INFINITE, Change.LINEAR)
#: What is this near to a special point, relative to it and to the branch, is at it.
_AT = 1e-9


@dataclass(frozen=True, eq=False, repr=False)
class SpecialPoint(Brief):
    """A point of a branch where something changes.

    Attributes
    ----------
    kind : Change
    value : float
        The parameter [SI].
    note : str
        What changes, in words.
    cycle : LimitCycle
        The orbit there.
    index : int
        Number of the branch's point after it.
    point : Point or None
        The orbit and the branch's direction, from which others may go on; None where cycles of a sampled loop are
        followed.
    """

    kind: Change
    value: float
    note: str
    cycle: LimitCycle
    index: int
    point: BranchPoint | None = field(default=None, repr=False)

    in_json = "kind value note index cycle"


@dataclass(frozen=True, eq=False, repr=False)
class Branch(Result):
    """Exact orbits along a branch, in its own order.

    Attributes
    ----------
    parameter, unit : str
        The parameter, and its SI unit.
    points : dict of str to array
        "value" [SI], "period" [s], "frequency" [Hz], "stable" (bool), "multiplier" (largest magnitude), "residual", and
        "<signal>" for the peak-to-peak of every signal; of a sampled loop also "samples", the number in a period, nan
        where a cycle is not locked to them.
    special : tuple of SpecialPoint
        Folds, changes of stability and of the sequence of events, and ends, in the order of the branch.
    status : Status
        NOT_CONVERGED where no orbit continues it at one of its ends.
    message : str
        How the branch ended, at both ends.
    signals : tuple of str
        Names of the signals in `points`.
    units : dict of str to str
        SI unit of each signal.
    simulated : dict of str to array
        Points of runs for comparison, where requested.
    ends : (str, str)
        How it ends at its first and at its last point.
    missing : tuple of Gap
        Parts of the given range in which neither it nor one of `others` has an orbit, and why.
    others : tuple of Branch
        Branches of other cycles, followed where this one leaves a part of the range without having turned back.
    readable : (str, float)
        The unit that people use for the parameter, and the factor from SI to it.
    not_covered : str
        What the branch of a sampled loop does not cover, in a sentence; empty for other loops.
    operating_point : OperatingPoint or None
        Where the case holds the external inputs; with a parameter that moves them, at the case's own value of it.
    """

    parameter: str
    unit: str
    points: dict[str, Array]
    special: tuple[SpecialPoint, ...]
    status: Status
    message: str
    signals: tuple[str, ...] = ()
    units: dict[str, str] = field(default_factory=dict)
    simulated: dict[str, Array] = field(default_factory=dict)
    ends: tuple[str, str] = ("", "")
    missing: tuple[Gap, ...] = ()
    others: tuple[Branch, ...] = ()
    not_covered: str = ""
    readable: tuple[str, float] | None = None

    in_json = (
        "parameter unit status message points special simulated missing others not_covered operating_point provenance"
    )

    def __len__(self) -> int:
        return int(self.points["value"].size)

    @property
    def folds(self) -> tuple[SpecialPoint, ...]:
        """Where the branch turns back: a stable and an unstable cycle meet."""
        return tuple(s for s in self.special if s.kind is Change.FOLD)

    def __str__(self) -> str:
        """Over which part of the range there are cycles, where they fold, and what the branches leave."""
        branches = (self, *self.others)
        folds = [one.place(fold) for one in branches for fold in one.folds]
        # A fold lies a little beyond the points beside it.
        parts = covered([np.append(one.points["value"], [fold.value for fold in one.folds]) for one in branches])
        places = f", at {listed(folds)}" if folds else ""
        known = f"; {count(len(folds), 'fold')}{places}"
        for kind, name in (
            (Change.INFINITE, "infinite period"),
            (Change.CONTINUUM, "continuum"),
            (Change.CONTINUA, "continuum at each value, met"),
            (Change.LINEAR, "linear limit"),
        ):
            found = [one.place(s) for one in branches for s in one.special if s.kind is kind]
            known += f"; {name} at {listed(found)}" if found else ""
        left = f" {self.message}" if self.missing or not self.status.ok else ""
        if self.not_covered:
            known, left = "", f"{left} {self.not_covered}"
        where = listed([self._span(*part) for part in parts])
        return f"Limit cycles exist for {words(self.parameter)} {where}{known}.{left}"

    def place(self, special: SpecialPoint) -> str:
        """Where a special point is; one at which cycles cease to exist is rounded to the side without them."""
        printed = Printed(*self.shown_in)
        if special.kind in CEASES:
            return printed.computed(Limit(special.value, not self.lies_above(special)))
        return quantity(special.value, self.unit, shown=self.shown_in)

    def lies_above(self, special: SpecialPoint) -> bool:
        """Whether the cycles beside a special point at which they cease to exist are at larger values."""
        values = self.points["value"]
        near = values[max(special.index - 1, 0) : special.index + 1] - special.value
        beside = near[np.abs(near) > _AT * max(abs(special.value), np.ptp(values))]
        return bool(np.mean(beside if beside.size else values - special.value) > 0.0)

    def ends_of(self, low: float, high: float) -> tuple[str, str]:
        """From where to where there are cycles, both ends rounded to the side without them."""
        printed = Printed(*self.shown_in)
        return printed.computed(Limit(low)), printed.computed(Limit(high, holds_above=True))

    def _span(self, low: float, high: float) -> str:
        first, last = self.ends_of(low, high)
        return f"at {first}" if low == high else f"from {first} to {last}"

    def to_frame(self) -> pandas.DataFrame:
        """The orbits along the branch and then along the others, one a row, with what is special at each."""
        rows = []
        for k, one in enumerate((self, *self.others), 1):
            notes = {min(s.index, len(one) - 1): s.kind.value for s in one.special}
            for i in range(len(one)):
                row = {self.parameter if name == "value" else name: v[i].item() for name, v in one.points.items()}
                rows.append({"branch": k, **row, "special": notes.get(i, "")})
        units = {self.parameter: self.unit, "period": self.units.get("time", "s"), "frequency": "Hz", **self.units}
        return frame_of(rows, units, {self.parameter: self.shown_in})

    @property
    def shown_in(self) -> tuple[str, float]:
        """The unit in which people read the parameter, and the factor from SI to it."""
        return readable(self.unit) if self.readable is None else self.readable

    def in_brief(self) -> pandas.DataFrame:
        """The ends of the branches and their special points, by the first signal."""
        frame = self.to_frame()
        ends = np.append(np.flatnonzero(np.diff(frame["branch"])), len(frame) - 1)
        rows = sorted({0, *ends.tolist(), *(ends[:-1] + 1).tolist(), *np.flatnonzero(frame["special"] != "").tolist()})
        columns = ["branch", self.parameter, "stable", "frequency", *self.signals[:1], "special"]
        return frame.iloc[rows][columns]

    @checked
    def plot(self, ax: Axes | None = None, signal: str | None = None, at: float | None = None) -> Axes:
        """Peak to peak and frequency against the parameter, with a dotted line at its value `at` [SI]."""
        return self.drawn("plot_branch", ax, signal, at)
