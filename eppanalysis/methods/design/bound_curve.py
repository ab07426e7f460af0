"""The exact bound on one parameter as a function of another: the DF proposes where it lies, exact folds say it.

At values of the other parameters an exact cycle is found near the bound that the DF proposes (else by a search
over the range), and its branch is followed to the first place at which it turns back. Near an earlier place the
cycle known there is closed again instead, beyond where the slopes of the bound foretell it. Other families are not
looked for here: a bound is put to the test where it matters, at the optimum, and families met there are added.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from eppanalysis.errors import EppError
from eppanalysis.methods.bounds.balanced import BoundProblem, spread
from eppanalysis.methods.bounds.elasticity import exact_slopes, size_elasticities
from eppanalysis.methods.bounds.exact import BORN, ExactBound
from eppanalysis.methods.bounds.result import Turn
from eppanalysis.methods.bounds.sizes.allowed import Allowed
from eppanalysis.methods.bounds.sizes.bound import farthest_passage, predicted_too_large
from eppanalysis.methods.bounds.verify import Verification, verify
from eppanalysis.methods.continuation.branch import Continuation
from eppanalysis.methods.continuation.families import Family
from eppanalysis.methods.continuation.folds import fold_in
from eppanalysis.methods.continuation.seeds import steady_case
from eppanalysis.methods.continuation.steps import BranchPoint, make_point, step
from eppanalysis.methods.design.machines import machines_at_rest
from eppanalysis.methods.design.programme import N_SCAN, Place, Programme, distance
from eppanalysis.methods.orbits.cycle import to_limit_cycle
from eppanalysis.methods.orbits.exact import start_of
from eppanalysis.methods.orbits.shooting import orbits_near
from eppanalysis.methods.search.find import find_limit_cycles
from eppanalysis.models.systems.subject import CaseLike
from eppanalysis.results import LimitCycle

#: Halvings of the DF between two values of the range.
_HALVINGS = 9
#: Where exact cycles are searched for, relative to the bound of the DF, from the safe side on.
_AROUND = (0.8, 0.9, 0.97, 1.03, 1.1, 1.2, 1.35)
#: How far beyond a bound nearby the cycle known there is closed again.
_BEYOND = (0.005, 0.02, 0.06, 0.15)
#: Part of a parameter round the start of a branch in which its turn is expected.
_WINDOW = 0.08
#: The same for a turn that is foretold; one farther away is not believed.
_BESIDE = 0.02
#: How far along its branch from a fold a cycle beyond it is taken, and how much the branch bends there at least.
_ALONG, _BENT = 0.02, 1e-2
#: Change of a bound, relative to it, that slopes are believed; how often the way to a place is halved, and a distance
#: too short for that.
_MOST_FORETOLD, _DEEPEST, _NEAR = 0.3, 4, 0.02
#: Orbits of a branch at most, how many are made before the test whether it has turned back, and the longest step.
_MOST, _AT_ONCE, _STEP = 120, 8, 0.05


@dataclass(frozen=True, eq=False)
class Known:
    """A cycle from which a family is followed: at a place, and at a value of the bounded parameter [SI]."""

    place: Place
    value: float
    cycle: LimitCycle
    bound: ExactBound


@dataclass(eq=False)
class BoundCurve:
    """The bound on a parameter over other ones; lives for one design and its front."""

    question: BoundProblem  # with the parameter that is bounded, and its range
    widths: dict[str, float]  # the parameters that run, and how far each does [SI]
    sign: float  # {1, -1}: 1 where the parameter is to be large, so that cycles are sought above its bound
    allowed: Allowed | None = None
    families: list[list[Known]] = field(default_factory=list)
    #: bounds, first, questions: what is known already, exactly and by the DF, by the values of the parameters that
    #: run.
    bounds: dict[Place, ExactBound] = field(default_factory=dict)
    first: dict[Place, float | None] = field(default_factory=dict)
    questions: dict[Place, BoundProblem] = field(default_factory=dict)
    #: Of exact bounds, by parameters with their sizes.
    derivatives: dict[tuple[BranchPoint, str, float], float] = field(default_factory=dict)

    @property
    def is_foretold(self) -> bool:
        """Whether the DF says on a grid where exact bounds are computed."""
        return True

    @property
    def not_covered(self) -> str:
        """What the bounds do not cover, in a sentence; empty where they are exact."""
        return ""

    def over(self, low: float, high: float) -> BoundCurve:
        """The same over another range of the bounded parameter."""
        question = replace(self.question, low=low, high=high)
        return replace(self, question=question, families=[], bounds={}, first={}, questions={}, derivatives={})

    @property
    def ends(self) -> tuple[float, float]:
        """The end of the range that is safe, if any is, and the end that is wanted."""
        return self.question.ends(self.sign)

    def here(self, place: Place) -> BoundProblem:
        """The question at values of the parameters that run."""
        if place not in self.questions:
            values = dict(zip(self.widths, place, strict=True))
            case = self.question.case.with_values(values) if place else self.question.case
            self.questions[place] = replace(self.question, case=case)
        return self.questions[place]

    def of_bound(self, place: Place, bound: ExactBound, sizes: Mapping[str, float]) -> dict[str, float]:
        """Derivative of the bound at a place by parameters with their sizes; none where it has none."""
        point, here = bound.point, self.here(place)
        if point is None:
            return {}
        if bound.kind is Turn.SIZE and self.allowed is not None:
            elastic = size_elasticities(here, point, self.allowed, sizes)
            return {n: e * point.value / here.case.value(n) for n, e in elastic.items() if n in sizes}
        return self.slopes(place, point, sizes) if bound.is_solved else {}

    def tested(self, place: Place, bound: ExactBound, margin: float, starts: int, seed: int) -> Verification:
        """The bound at a place put to the test on both sides; it has a cycle."""
        assert bound.cycle is not None
        return verify(
            self.here(place),
            bound.value,
            self.sign,
            bound.cycle,
            margin=margin,
            n_starts=starts,
            seed=seed,
            allowed=self.allowed,
            beyond=self.beyond(place),
        )

    def at_rest(self, cases: Sequence[CaseLike], cycle: LimitCycle, rng: np.random.Generator) -> int:
        """How many cases come to rest, or to a cycle that is allowed, from starts of their own about the cycle."""
        return machines_at_rest(cases, cycle, self.allowed, rng)

    def slopes(self, place: Place, point: BranchPoint, sizes: Mapping[str, float]) -> dict[str, float]:
        """Derivative of an exact bound at a place by parameters, as :func:`exact_slopes` has it."""
        new = {n: s for n, s in sizes.items() if (point, n, s) not in self.derivatives}
        for name, slope in exact_slopes(self.here(place), point, new).items() if new else ():
            self.derivatives[point, name, sizes[name]] = slope
        return {name: self.derivatives[point, name, size] for name, size in sizes.items()}

    def worth(self, bound: ExactBound) -> float:
        """How good a bound is: larger is better; minus infinity where nothing is free."""
        if bound.kind is Turn.UNKNOWN or not np.isfinite(bound.value):
            return -np.inf
        return self.sign * bound.value

    def at(self, place: Place) -> ExactBound:
        """The exact bound at values of the parameters that run.

        Its kind is END where the whole range is free (the value is then the wanted end), and UNKNOWN with a message
        where none of it is.
        """
        if place not in self.bounds:
            self.bounds[place] = self._at(place)
        return self.bounds[place]

    def _at(self, place: Place) -> ExactBound:
        here = self.here(place)
        found = [b for b in (self._carried(place, family) for family in self.families) if b is not None]
        if not found:
            found.append(self._sought(here, place))
        return min(found, key=self.worth)

    def add(self, place: Place, value: float, cycles: Sequence[LimitCycle]) -> bool:
        """Families of cycles that a test found; whether there is a new one. What was known is computed again."""
        here, known = self.here(place), len(self.families)
        for cycle in cycles:
            bound = self._followed(here, value, cycle)
            if bound is not None and bound.cycle is not None:
                self.families.append([Known(place, value, cycle, bound)])
        self.bounds.clear()
        return len(self.families) > known

    def beyond(self, place: Place) -> LimitCycle | None:
        """A cycle that is known on the far side of the bound at a place."""
        here = self.bounds.get(place)
        known = (k for family in self.families for k in family if k.place == place and k.bound is here)
        return next((k.cycle for k in known), None)

    def _carried(self, place: Place, family: list[Known], depth: int = 0) -> ExactBound | None:
        """The bound of a family, from its member nearest by; else by way of places between."""
        near, here = min(family, key=lambda known: distance(self.widths, known.place, place)), self.here(place)
        foretold = self._foretold(near, place)
        moved = self._moved(near, here, foretold)
        if moved is not None:
            family.append(replace(moved, place=place))
            return moved.bound
        # Where the fold itself is not found, the cycle nearby is
        # closed a little beyond it, and its branch followed back.
        for share in _BEYOND:
            value = float(np.clip(foretold * (1.0 + self.sign * share), here.low, here.high))
            bound = self._followed(here, value, near.cycle)
            if bound is not None and bound.kind is not Turn.END:
                self._keep(here, place, value, near.cycle, bound, family)
                return bound
        if depth == _DEEPEST or distance(self.widths, near.place, place) < _NEAR:
            return None
        between = tuple(0.5 * (a + b) for a, b in zip(near.place, place, strict=True))
        found = self._carried(between, family, depth + 1)
        return None if found is None else self._carried(place, family, depth + 1)

    def _foretold(self, near: Known, place: Place) -> float:
        """The bound at a place as its slopes at the nearest one foretell it."""
        value, point = near.bound.value, near.bound.point
        moves = {n: b - a for n, a, b in zip(self.widths, near.place, place, strict=True) if a != b}
        if point is None or not near.bound.is_solved or self.allowed is not None:
            return value
        slopes = self.slopes(near.place, point, {name: self.widths[name] for name in moves})
        change = sum(slopes[name] * move for name, move in moves.items())
        return value + change if abs(change) < _MOST_FORETOLD * abs(value) else value

    def _moved(self, near: Known, here: BoundProblem, foretold: float) -> Known | None:
        """The fold that the one at a place nearby leads to, with a cycle beyond it."""
        fold = near.bound.point
        if self.allowed is not None or near.bound.kind is not Turn.FOLD or fold is None or _aside(fold) is None:
            return None
        window = max(here.low, foretold * (1.0 - _BESIDE)), min(here.high, foretold * (1.0 + _BESIDE))
        family = Family(lambda v: steady_case(here.case_at(v)), (here.low, here.high), window, patience=0)
        try:
            found = fold_in(family, fold, np.append(fold.unknowns[:-1], foretold))
        except (EppError, np.linalg.LinAlgError):
            return None
        aside = None if found is None else _aside(found)
        # A fold far from where it is foretold may be another one.
        if found is None or aside is None or not window[0] <= found.value <= window[1]:
            return None
        cycle = to_limit_cycle(here.case_at(aside.value).to_system(), aside.orbit)
        return Known((), aside.value, cycle, _at_turn(here, found, Turn.FOLD))

    def _keep(
        self, here: BoundProblem, place: Place, value: float, cycle: LimitCycle, bound: ExactBound, family: list[Known]
    ) -> None:
        """Remember the exact cycle at a value, from which neighbours go on."""
        closed = _closed(here, value, cycle)
        if closed is not None and bound.cycle is not None:
            family.append(Known(place, value, closed, bound))

    def _sought(self, here: BoundProblem, place: Place) -> ExactBound:
        """The bound by searches: around the one of the DF, then over the whole range."""
        wanted, grows = self.ends[1], float("nan")
        for value in self._places(here, place):
            search = find_limit_cycles(here.case_at(value))
            for cycle in (c for c in search if self.allowed is None or self.allowed.exceeded_by(c)):
                bound = self._followed(here, value, cycle)
                if bound is None:
                    continue
                if bound.kind is Turn.END:
                    return self._beyond(here)
                # Where motions grow without bound nearer to the safe end, this fold is not what bounds the design.
                if self.sign * (grows - bound.value) < 0:
                    break
                self.families.append([Known(place, value, cycle, bound)])
                return bound
            if search.diverges and not search.left_open and not self.sign * (value - grows) >= 0:
                grows = value
            if search.left_open and value == wanted:
                return ExactBound(message=f"the search leaves runs undecided at {self.question.limit} = {value:.6g}")
        if np.isfinite(grows):
            return ExactBound(message=f"motions grow without bound at {self.question.limit} = {grows:.6g}")
        return ExactBound(wanted, kind=Turn.END)

    def _beyond(self, here: BoundProblem) -> ExactBound:
        """The bound where cycles exist down to the safe end: the wanted one, if it is free itself."""
        wanted, name = self.ends[1], self.question.limit
        search = find_limit_cycles(here.case_at(wanted))
        if any(self.allowed is None or self.allowed.exceeded_by(c) for c in search):
            return ExactBound(message=f"cycles exist at both ends of the range of {name}")
        if search.left_open or search.diverges:
            return ExactBound(message=f"the search leaves runs undecided at {name} = {wanted:.6g}")
        return ExactBound(wanted, kind=Turn.END)

    def _places(self, here: BoundProblem, place: Place) -> Iterator[float]:
        """Where cycles are searched for: around the bound of the DF, then over the range, the wanted end last."""
        safe, wanted = self.ends
        proposed = self.first_order(place)
        if proposed is not None:
            for share in _AROUND if self.sign > 0 else [2.0 - s for s in _AROUND]:
                if here.low < proposed * share < here.high:
                    yield proposed * share
        yield from spread(safe, wanted, N_SCAN)

    @cached_property
    def programme(self) -> Programme:
        """Where cycles of the DF begin, whatever their size."""
        return Programme(self.here, self.widths, self.sign)

    def first_order(self, place: Place) -> float | None:
        """Where the DF says that cycles (that are too large) begin, from the safe end on [SI]; None: nowhere."""
        if self.allowed is None:
            fold = self.programme.bound(place)
            return None if fold is None else fold.cycle.value
        if place not in self.first:
            self.first[place] = self._first_order(self.here(place))
        return self.first[place]

    def _first_order(self, here: BoundProblem) -> float | None:
        safe, wanted = self.ends
        before = safe
        for value in spread(safe, wanted, N_SCAN):
            if predicted_too_large(here, self.allowed, value):
                for _ in range(_HALVINGS if value != safe else 0):
                    middle = 0.5 * (before + value)
                    there = predicted_too_large(here, self.allowed, middle)
                    before, value = (before, middle) if there else (middle, value)
                return value
            before = value
        return None

    def _followed(self, here: BoundProblem, value: float, cycle: LimitCycle) -> ExactBound | None:
        if self.allowed is not None:
            return farthest_passage(here, self.allowed, value, [cycle], self.sign)
        return first_turn(here, value, cycle, self.sign)


def first_turn(question: BoundProblem, value: float, cycle: LimitCycle, sign: float) -> ExactBound | None:
    """Where the branch of a cycle at a value first turns back on its way to the safe end; None where it shows no end.

    Parameters
    ----------
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
    end, _ = question.ends(sign)
    limits = min(value, end), max(value, end)
    if limits[0] == limits[1]:
        return None
    # Most branches turn back soon.
    window = max(limits[0], value - _WINDOW * abs(value)), min(limits[1], value + _WINDOW * abs(value))
    # The walk needs some sixty systems.
    family = Family(lambda v: steady_case(question.case_at(v)), limits, window, patience=1)
    try:
        hybrid = family.at(value)
        if cycle.state.size != hybrid.n_plant:  # of a loop of another structure
            return None
        orbit = next(orbits_near(hybrid, *start_of(hybrid, cycle), cycle.period), None)
        if orbit is None or orbit.motion is not None:
            return None
        walk = Continuation(question.case, question.limit, family, limits, _MOST, _STEP)
        point, why = make_point(family, value, orbit, None, -sign), ""
        for _ in range(_MOST // (_AT_ONCE - 1)):
            points, why = walk.along(point, _AT_ONCE)
            turn = next((s for s in walk.special if s[0] in BORN), None)
            if turn is not None:
                return _at_turn(question, turn[1], BORN[turn[0]])
            point = points[-1]
            if len(points) < _AT_ONCE:
                break
    except (EppError, np.linalg.LinAlgError):
        return None
    return ExactBound(kind=Turn.END) if abs(point.value - end) <= 1e-9 * family.width else None


def _at_turn(question: BoundProblem, found: BranchPoint, kind: Turn) -> ExactBound:
    """The bound where a branch turns back."""
    cycle = to_limit_cycle(question.case_at(found.value).to_system(), found.orbit)
    return ExactBound(found.value, found.orbit.period, cycle, kind, found)


def _aside(fold: BranchPoint) -> BranchPoint | None:
    """A cycle beside a fold; None where the branch does not turn back, but the parameter is constant along it.

    There the period grows without end, and before it does another fold may come up at places nearby.
    """
    for ds in (_ALONG, -_ALONG):
        found = step(fold, ds)
        if found is not None:
            return found if abs(found.turn - fold.turn) > _BENT * _ALONG else None
    return None


def _closed(question: BoundProblem, value: float, cycle: LimitCycle) -> LimitCycle | None:
    """The exact cycle near a known one at a value."""
    system = question.case_at(value).to_system()
    hybrid = steady_case(question.case_at(value))
    orbit = next(orbits_near(hybrid, *start_of(hybrid, cycle), cycle.period), None)
    return None if orbit is None else to_limit_cycle(system, orbit)
