"""The exact bound on one parameter as a function of another: first order proposes where it lies, exact folds say it.

At a value of the other parameter an exact cycle is found near the bound that first order proposes (else by a search
over the range), and its branch is followed to the first place at which it turns back. Near the last place asked for,
the cycle known there is closed again instead. Other families are not looked for here: a bound is put to the test where
it matters, at the optimum, and families met there are added.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from eppanalysis.errors import EppError, ModelError
from eppanalysis.methods.bounds.exact import BORN, ExactBound
from eppanalysis.methods.bounds.harmonic import Question
from eppanalysis.methods.bounds.result import Turn
from eppanalysis.methods.bounds.sizes.allowed import Allowed
from eppanalysis.methods.bounds.sizes.bound import farthest_passage
from eppanalysis.methods.continuation.branch import Walk, steady_case
from eppanalysis.methods.continuation.families import Family
from eppanalysis.methods.continuation.steps import make_point
from eppanalysis.methods.describing.predict import predict_limit_cycles
from eppanalysis.methods.orbits.cycle import to_limit_cycle
from eppanalysis.methods.orbits.exact import start_of
from eppanalysis.methods.orbits.shooting import orbits_near
from eppanalysis.methods.search.find import find_limit_cycles
from eppanalysis.results import LimitCycle

#: Values of the range that are asked, by first order and by the exact search, and halvings of first order.
_N_SCAN, _HALVINGS = 9, 9
#: Where exact cycles are searched for, relative to the bound of first order, from the safe side on.
_AROUND = (0.8, 0.9, 0.97, 1.03, 1.1, 1.2, 1.35)
#: How far beyond a bound nearby the cycle known there is closed again.
_BEYOND = (0.02, 0.06, 0.15)
#: Orbits of a branch at most, how many are made before it is asked whether it has turned back, and the longest step.
_MOST, _AT_ONCE, _STEP = 120, 8, 0.05


@dataclass(frozen=True, eq=False)
class Known:
    """A cycle from which a family is followed: at a value of the other parameter and one of the bounded one [SI]."""

    at: float
    value: float
    cycle: LimitCycle
    bound: float


@dataclass(eq=False)
class Frontier:
    """The bound on a parameter over another one; lives for one design.

    Attributes
    ----------
    question : Question
        With the parameter that is bounded, its range, and the one that runs (None where there is none).
    sign : {1, -1}
        1 where the parameter is to be large, so that cycles are sought above its bound.
    allowed : Allowed or None
    families : list of list of Known
    bounds : dict of float to ExactBound
        What is known already.
    """

    question: Question
    sign: float
    allowed: Allowed | None = None
    families: list[list[Known]] = field(default_factory=list)
    bounds: dict[float, ExactBound] = field(default_factory=dict)

    @property
    def ends(self) -> tuple[float, float]:
        """The end of the range that is safe, if any is, and the end that is wanted."""
        low, high = self.question.low, self.question.high
        return (low, high) if self.sign > 0 else (high, low)

    def worth(self, bound: ExactBound) -> float:
        """How good a bound is: larger is better; minus infinity where nothing is free."""
        if bound.kind is Turn.UNKNOWN or not np.isfinite(bound.value):
            return -np.inf
        return self.sign * bound.value

    def at(self, other: float) -> ExactBound:
        """The exact bound at a value of the other parameter.

        Its kind is END where the whole range is free (the value is then the wanted end), and UNKNOWN with a message
        where none of it is.
        """
        if other not in self.bounds:
            self.bounds[other] = self._at(other)
        return self.bounds[other]

    def _at(self, other: float) -> ExactBound:
        here = self.question.at(other)
        found = []
        for family in self.families:
            bound = self._carried(here, other, family)
            if bound is not None:
                found.append(bound)
        if not found:
            found.append(self._sought(here, other))
        return min(found, key=self.worth)

    def add(self, other: float, value: float, cycles: Sequence[LimitCycle]) -> bool:
        """Families of cycles that a test found; whether there is a new one. What was known is asked again."""
        here, known = self.question.at(other), len(self.families)
        for cycle in cycles:
            bound = self._followed(here, value, cycle)
            if bound is not None and bound.cycle is not None:
                self.families.append([Known(other, value, cycle, bound.value)])
        self.bounds.clear()
        return len(self.families) > known

    def _carried(self, here: Question, other: float, family: list[Known]) -> ExactBound | None:
        """The bound of a family, from its member nearest by; None where its cycle cannot be closed again."""
        near = min(family, key=lambda k: abs(k.at - other))
        for share in _BEYOND:
            value = float(np.clip(near.bound * (1.0 + self.sign * share), here.low, here.high))
            bound = self._followed(here, value, near.cycle)
            if bound is not None and bound.kind is not Turn.END:
                self._keep(here, other, value, near.cycle, bound, family)
                return bound
        return None

    def _keep(
        self, here: Question, other: float, value: float, cycle: LimitCycle, bound: ExactBound, family: list[Known]
    ) -> None:
        """Remember the exact cycle at a value, from which neighbours go on."""
        closed = _closed(here, value, cycle)
        if closed is not None and bound.cycle is not None:
            family.append(Known(other, value, closed, bound.value))

    def _sought(self, here: Question, other: float) -> ExactBound:
        """The bound by searches: around the one of first order, then over the whole range."""
        wanted, grows = self.ends[1], float("nan")
        for value in self._places(here):
            search = find_limit_cycles(here.case_at(value))
            for cycle in (c for c in search if self.allowed is None or self.allowed.exceeded_by(c)):
                bound = self._followed(here, value, cycle)
                if bound is None:
                    continue
                if bound.kind is Turn.END:
                    return self._beyond(here)
                if self.sign * (grows - bound.value) < 0:
                    break
                self.families.append([Known(other, value, cycle, bound.value)])
                return bound
            if search.diverges and not self.sign * (value - grows) >= 0:
                grows = value
            if search.left_open and value == wanted:
                return ExactBound(message=f"the search leaves runs undecided at {self.question.limit} = {value:.6g}")
        if np.isfinite(grows):
            return ExactBound(message=f"motions grow without bound at {self.question.limit} = {grows:.6g}")
        return ExactBound(wanted, kind=Turn.END)

    def _beyond(self, here: Question) -> ExactBound:
        """The bound where cycles exist down to the safe end: the wanted one, if it is free itself."""
        wanted, name = self.ends[1], self.question.limit
        search = find_limit_cycles(here.case_at(wanted))
        if any(self.allowed is None or self.allowed.exceeded_by(c) for c in search):
            return ExactBound(message=f"cycles exist at both ends of the range of {name}")
        if search.left_open or search.diverges:
            return ExactBound(message=f"the search leaves runs undecided at {name} = {wanted:.6g}")
        return ExactBound(wanted, kind=Turn.END)

    def _places(self, here: Question) -> Iterator[float]:
        """Where cycles are searched for: around the bound of first order, then over the range, the wanted end last."""
        safe, wanted = self.ends
        proposed = self.first_order(here)
        if proposed is not None:
            for share in _AROUND if self.sign > 0 else [2.0 - s for s in _AROUND]:
                if here.low < proposed * share < here.high:
                    yield proposed * share
        yield from _spread(safe, wanted)

    def first_order(self, here: Question) -> float | None:
        """Where first order says that cycles begin, from the safe end on [SI]; None where it sees none."""
        safe, wanted = self.ends
        before = safe
        for value in _spread(safe, wanted):
            if self._predicted(here, value):
                for _ in range(_HALVINGS if value != safe else 0):
                    middle = 0.5 * (before + value)
                    before, value = (before, middle) if self._predicted(here, middle) else (middle, value)
                return value
            before = value
        return None

    def _predicted(self, here: Question, value: float) -> bool:
        try:
            cycles = predict_limit_cycles(here.case_at(value))
        except ModelError:  # an element without a describing function
            return False
        return any(self.allowed is None or self.allowed.exceeded_by(c) for c in cycles)

    def _followed(self, here: Question, value: float, cycle: LimitCycle) -> ExactBound | None:
        if self.allowed is not None:
            return farthest_passage(here, self.allowed, value, [cycle], self.sign)
        return first_turn(here, value, cycle, self.sign)


def first_turn(question: Question, value: float, cycle: LimitCycle, sign: float) -> ExactBound | None:
    """Where the branch of a cycle at a value first turns back on its way to the safe end; None where it shows no end.

    Parameters
    ----------
    question : Question
        At one value of the parameter that runs.
    value : float
        Where the cycle is [SI].
    cycle : LimitCycle
        Exact, or near an exact one.
    sign : {1, -1}
        1 where small values are safe.

    Returns
    -------
    ExactBound or None
        Of kind END where the branch goes on to the safe end.
    """
    end = question.low if sign > 0 else question.high
    limits = min(value, end), max(value, end)
    if limits[0] == limits[1]:
        return None
    family = Family(lambda v: steady_case(question.case_at(v)), limits)
    try:
        hybrid = family.at(value)
        if cycle.state.size != hybrid.n_plant:  # of a loop of another structure
            return None
        orbit = next(orbits_near(hybrid, *start_of(hybrid, cycle), cycle.period), None)
        if orbit is None or orbit.motion is not None:
            return None
        walk = Walk(question.case, question.limit, family, limits, _MOST, _STEP)
        point, why = make_point(family, value, orbit, None, -sign), ""
        for _ in range(_MOST // (_AT_ONCE - 1)):
            points, why = walk.along(point, _AT_ONCE)
            turn = next((s for s in walk.special if s[0] in BORN), None)
            if turn is not None:
                found, system = turn[1], question.case_at(value).to_system()
                cycle_there = to_limit_cycle(system, found.orbit)
                return ExactBound(found.value, found.orbit.period, cycle_there, BORN[turn[0]], found)
            point = points[-1]
            if len(points) < _AT_ONCE:
                break
    except (EppError, np.linalg.LinAlgError):
        return None
    return ExactBound(kind=Turn.END) if abs(point.value - end) <= 1e-9 * family.width else None


def _closed(question: Question, value: float, cycle: LimitCycle) -> LimitCycle | None:
    """The exact cycle near a known one at a value."""
    system = question.case_at(value).to_system()
    hybrid = steady_case(question.case_at(value))
    orbit = next(orbits_near(hybrid, *start_of(hybrid, cycle), cycle.period), None)
    return None if orbit is None else to_limit_cycle(system, orbit)


def _spread(first: float, last: float) -> list[float]:
    """Values from one end of a range to the other."""
    make = np.geomspace if min(first, last) > 0 else np.linspace
    values = [float(v) for v in make(first, last, _N_SCAN)]
    return [first, *values[1:-1], last]
