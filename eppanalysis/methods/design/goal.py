"""What a design is to be good at, and what it keeps besides: numbers of the case, and measures of the linearised loop.

The objective is one of the tuned parameters, any other number of the case that follows from them (an expression such as
``Ki = "Kp/Ti"``), or a measure of the linearised loop, cut open at a place as :func:`eppanalysis.margins` has it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum

from eppanalysis.errors import ArgumentError, EppError, did_you_mean, shown
from eppanalysis.methods.margins.margins import margins
from eppanalysis.methods.margins.result import Margins
from eppanalysis.models.systems.subject import CaseLike
from eppanalysis.readable import quantity, words
from eppanalysis.results import PlainData
from eppanalysis.units import QuantityError, parse_quantity

_TURN = 2.0 * math.pi
#: How people read a frequency [rad/s].
_IN_HERTZ = ("Hz", 1.0 / _TURN)


class Sense(StrEnum):
    """Which value of the objective is looked for."""

    LARGEST = "largest"
    SMALLEST = "smallest"


class Measure(StrEnum):
    """Of the linearised loop."""

    BANDWIDTH = "bandwidth"
    CROSSOVER = "crossover"
    PHASE_MARGIN = "phase_margin"
    GAIN_MARGIN = "gain_margin"
    DISK_MARGIN = "disk_margin"
    DELAY_MARGIN = "delay_margin"
    TRACKING_ERROR = "tracking_error"

    @property
    def at_most(self) -> bool:
        """Whether small values are good, so that what is kept is kept at most."""
        return self is Measure.TRACKING_ERROR

    @property
    def unit(self) -> str:
        """SI unit."""
        return _UNITS.get(self, "")

    @property
    def shown(self) -> tuple[str, float] | None:
        """The unit that people use, and the factor from SI to it."""
        return _IN_HERTZ if self.unit == "rad/s" else None

    def of(self, found: Margins) -> float:
        """The measure [SI]; the worst there is where the loop is unstable or has none."""
        value = float(getattr(found, _ATTRIBUTES.get(self, self)))
        if self is Measure.GAIN_MARGIN:  # a gain that may be lowered so far counts as one that may be raised so far
            value = max(value, 1.0 / value) if value > 0 else math.nan
        worst = math.inf if self.at_most else -math.inf
        return worst if found.stable is False or math.isnan(value) else value

    def read(self, text: object) -> float:
        """A value to be kept as people write it [SI]; a frequency in Hz or in rad/s.

        Raises
        ------
        EppError
            If it is none.
        """
        try:
            value = parse_quantity(text, self.unit)
        except QuantityError as error:
            try:
                value = parse_quantity(text, "Hz") * _TURN if self.unit == "rad/s" else math.nan
            except QuantityError:
                value = math.nan
            if math.isnan(value):
                raise ArgumentError("subject_to", f": {self} is {shown(text)}; expected {error.expected}.") from None
        if not 0.0 < value < math.inf:
            raise ArgumentError("subject_to", f": {self} is {shown(text)}; expected a positive number.")
        return value


_UNITS = {
    Measure.BANDWIDTH: "rad/s", Measure.CROSSOVER: "rad/s", Measure.PHASE_MARGIN: "rad", Measure.DELAY_MARGIN: "s",
    Measure.TRACKING_ERROR: "s",
}  # fmt: skip
_ATTRIBUTES = {Measure.CROSSOVER: "gain_crossover"}


@dataclass(frozen=True)
class Kept(PlainData):
    """A measure of the linearised loop that a design keeps at least, or at most where small values are good.

    Attributes
    ----------
    measure : Measure
    limit : float
        [SI]
    """

    measure: Measure
    limit: float

    def __str__(self) -> str:
        """As people say it."""
        return f"{words(self.measure)} of {quantity(self.limit, self.measure.unit, shown=self.measure.shown)}"

    @property
    def side(self) -> str:
        """Of the limit."""
        return "at most" if self.measure.at_most else "at least"

    def slack(self, found: Margins) -> float:
        """By what share the measure is better than required; negative where it is not kept."""
        value = self.measure.of(found)
        ratio = self.limit / max(value, 1e-300) if self.measure.at_most else value / self.limit
        return min(ratio, 1e300) - 1.0


@dataclass(frozen=True)
class Judged:
    """A design before cycles are searched in it."""

    worth: float  # of the objective: larger is better
    #: By what share the measure that is kept least well is above what is requested; infinite where none is kept.
    slack: float = math.inf
    tightest: Kept | None = None

    @property
    def feasible(self) -> bool:
        """Whether all that is to be kept is."""
        return self.slack >= 0.0 and math.isfinite(self.worth)


@dataclass(frozen=True)
class Goal:
    """The objective, and what is kept."""

    name: str  # a parameter of the case, or a measure of the linearised loop
    sign: float  # {1, -1}: 1 where it is to be large
    kept: tuple[Kept, ...] = ()
    at: str | None = None  # where the loop is cut; None where its margins are taken

    @property
    def measure(self) -> Measure | None:
        """The objective as a measure; None where it is a parameter."""
        return Measure(self.name) if self.name in set(Measure) else None

    def judge(self, case: CaseLike) -> Judged:
        """How good a case is, and what of what it is to keep it keeps least well."""
        measure = self.measure
        found = margins(case, self.at) if measure is not None or self.kept else None
        value = case.value(self.name) if measure is None or found is None else measure.of(found)
        if found is None or not self.kept:
            return Judged(self.sign * value)
        slacks = [k.slack(found) for k in self.kept]
        worst = min(range(len(slacks)), key=lambda i: slacks[i])
        return Judged(self.sign * value, slacks[worst], self.kept[worst])


def goal_of(
    case: CaseLike,
    maximise: str | None,
    minimise: str | None,
    subject_to: Mapping[str, object] | None,
    at: str | None,
) -> Goal:
    """The goal as it is requested.

    Raises
    ------
    EppError
        If not one objective is given, it is neither a number of the case nor a measure, or something to be kept is no
        measure of the loop with a quantity.
    """
    if (maximise is None) == (minimise is None):
        raise EppError(f"design: maximise is {shown(maximise)}, minimise {shown(minimise)}; expected one of the two.")
    name, sign = (maximise, 1.0) if maximise is not None else (minimise, -1.0)
    assert name is not None
    if name not in set(Measure):
        case.value(name)
    kept = []
    for asked, least in (subject_to or {}).items():
        if asked not in set(Measure):
            hint = did_you_mean(asked, [str(m) for m in Measure])
            raise ArgumentError(
                "subject_to",
                f": {shown(asked)} is no measure of the linearised loop; expected one: {hint.rstrip('?')}.",
            )
        kept.append(Kept(Measure(asked), Measure(asked).read(least)))
    return Goal(name, sign, tuple(kept), at)
