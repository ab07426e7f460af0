"""Bounds with an amplitude that is allowed: where the largest stable limit cycle becomes larger than that.

The exact search says at a few values whether a stable cycle exceeds what is allowed. From the values at which one does,
its exact branch is followed to the safe end of the range. The bound is the last place, towards the safe side, at which
the branch has a stable orbit that is too large: the root of size - allowed, located like a fold; or the fold (border
collision, change of stability) itself, where the cycle is too large as soon as it is there.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cache, partial

import numpy as np

from eppanalysis.errors import EppError, ModelError
from eppanalysis.methods.bounds.balanced import N_SCAN, BoundProblem, idle, spread, value_of
from eppanalysis.methods.bounds.exact import BORN, ExactBound
from eppanalysis.methods.bounds.result import Finding, Turn
from eppanalysis.methods.bounds.sizes.allowed import Allowed
from eppanalysis.methods.continuation.branch import Continuation
from eppanalysis.methods.continuation.families import Family
from eppanalysis.methods.continuation.seeds import steady_case
from eppanalysis.methods.continuation.steps import BranchPoint, make_point
from eppanalysis.methods.describing.predict import predicted_cycles
from eppanalysis.methods.orbits.cycle import to_limit_cycle
from eppanalysis.methods.orbits.exact import start_of
from eppanalysis.methods.orbits.shooting import orbits_near
from eppanalysis.methods.search.find import find_limit_cycles
from eppanalysis.methods.simulation.stability import is_stable
from eppanalysis.methods.steady.changes import Change
from eppanalysis.results import LimitCycle

#: Orbits of a branch at most, and the longest step along it.
_MOST, _STEP = 200, 0.05
#: A cycle counts as too large at its birth from this share of what is allowed on: rounding of the extrema.
_AT_BIRTH = 1.0 - 1e-9
#: Halvings by which the bound of the DF is found between two values of the scan.
_HALVINGS = 20
_STABLE_FROM = (Change.PERIOD_DOUBLING, Change.TORUS, Change.BRANCH_POINT, Change.SEQUENCE)


@dataclass(frozen=True, eq=False)
class Scan:
    """Where in the range of the limiting parameter stable cycles exceed what is allowed."""

    finding: Finding
    sign: float = 1.0  # 1 where they do at large values, -1 where at small ones
    safe: float = float("nan")  # the value next to `cycles` at which none does [SI]
    value: float = float("nan")  # that of `cycles` [SI]
    cycles: tuple[LimitCycle, ...] = ()  # those that are too large, next to the safe side
    note: str = ""  # what there is to say where nothing bounds the parameter


_Seen = tuple[float, tuple[LimitCycle, ...], bool]


def scan(question: BoundProblem, allowed: Allowed) -> Scan:
    """Search the range of the limiting parameter for stable cycles that are larger than allowed."""
    values = tried_values(question)
    if idle(question, values):
        return Scan(Finding.IDLE, note=Finding.IDLE.sentence)
    seen = [_seen_at(question, allowed, value) for value in values]
    there = [bool(cycles) for _, cycles, _ in seen]
    if not any(there) or (there[0] and there[-1]):
        return without_bound(question, seen, allowed.exceeded)
    sign = -1.0 if there[0] else 1.0
    ordered = seen if sign > 0 else seen[::-1]
    # The first value from the safe end on at which one is there: between it and its neighbour lies the bound.
    i = there.index(True) if sign > 0 else there[::-1].index(True)
    last = max(k for k, true in enumerate(there) if true)
    above = "" if there[0] or there[-1] else f"There is none at {question.in_words([seen[last + 1][0]])} either."
    return Scan(Finding.BOUND, sign, ordered[i - 1][0], ordered[i][0], ordered[i][1], above)


def tried_values(question: BoundProblem) -> list[float]:
    """Values of the limiting parameter over its range, and the case's own, lowest first [SI]."""
    values = spread(question.low, question.high, N_SCAN)
    own = value_of(question.case, question.limit)
    return sorted({*values, own}) if own is not None and question.low < own < question.high else values


def without_bound(question: BoundProblem, seen: Sequence[_Seen], what: str, asked: str = "The exact search") -> Scan:
    """Why there is no place where such cycles begin."""
    some, free, unknown = (
        question.in_words(value for value, cycles, complete in seen if holds(bool(cycles), complete))
        for holds in (lambda there, _: there, lambda there, _: not there, lambda there, done: not (there or done))
    )
    if not free:
        return Scan(Finding.ALWAYS, note=f"At all values tried in the range there is a {what}: none of them is safe.")
    if unknown:
        note = f"{asked} found no {what}, but left runs undecided at {unknown}."
        if some:
            note = f"There is a {what} at {some}; of the others, runs were left undecided at {unknown}."
        return Scan(Finding.UNSURE, note=note)
    if not some:
        return Scan(Finding.NONE, note=f"At no value tried in the range there is a {what}: nothing bounds it there.")
    note = f"There is a {what} at {some} and none at {free}: give a narrower range that ends among these."
    return Scan(Finding.BETWEEN, note=note)


def _seen_at(question: BoundProblem, allowed: Allowed, value: float) -> _Seen:
    """A value, the cycles that are too large there, and whether the search left nothing open."""
    search = find_limit_cycles(question.case_at(value))
    return value, tuple(c for c in search if allowed.exceeded_by(c)), not search.left_open


def predicted_too_large(question: BoundProblem, allowed: Allowed | None, value: float) -> bool:
    """Whether the DF has a cycle at a value that is larger than allowed; any, where no size is."""
    try:
        cycles = predicted_cycles(question.case_at(value))
    except ModelError:  # an element without a describing function
        return False
    return any(allowed is None or allowed.exceeded_by(c) for c in cycles)


def first_order_bound(question: BoundProblem, allowed: Allowed, found: Scan) -> float:
    """Where the largest stable cycle of the DF becomes larger than allowed [SI]; nan where it does not nearby.

    It is sought over the whole range, from the far end of it, by halving: where cycles of the DF are too large
    there and not at the safe end.
    """
    safe, far = question.ends(found.sign)
    too_large = partial(predicted_too_large, question, allowed)
    other = next((v for v in (found.value, found.safe, far) if too_large(v)), None)
    if other is None or too_large(safe):
        return float("nan")
    for _ in range(_HALVINGS):
        middle = 0.5 * (safe + other)
        safe, other = (safe, middle) if too_large(middle) else (middle, other)
    return other


def bound_of_size(question: BoundProblem, allowed: Allowed, found: Scan) -> ExactBound:
    """The exact bound next to the safe side of a scan."""
    return farthest_passage(question, allowed, found.value, found.cycles, found.sign) or ExactBound(
        message="the branches of the cycles that are too large do not show where they begin to be"
    )


def farthest_passage(
    question: BoundProblem, allowed: Allowed, value: float, cycles: Iterable[LimitCycle], sign: float
) -> ExactBound | None:
    """The bound, farthest to the safe side, of families of which too large cycles at a value are known."""
    bounds = [_passage(question, allowed, value, cycle, sign) for cycle in cycles]
    return min((b for b in bounds if b is not None), key=lambda b: sign * b.value, default=None)


def _passage(
    question: BoundProblem, allowed: Allowed, value: float, cycle: LimitCycle, sign: float
) -> ExactBound | None:
    """Where the family of one cycle begins to be too large; None where its branch does not show it."""
    end, _ = question.ends(sign)
    system = question.case_at(value).to_system()
    limits = min(value, end), max(value, end)
    family = Family(lambda v: steady_case(question.case_at(v)), limits)

    @cache  # each point is needed several times on its way
    def excess(point: BranchPoint) -> float:
        return allowed.of_orbit(system, point.orbit) / allowed.size - 1.0

    try:
        hybrid = family.at(value)
        orbit = next(orbits_near(hybrid, *start_of(hybrid, cycle), cycle.period), None)
        if orbit is None or orbit.motion is not None:
            return None
        walk = Continuation(question.case, question.limit, family, limits, _MOST, _STEP, passes=excess)
        begin = make_point(family, value, orbit, None, -sign)
        points, _ = walk.along(begin, _MOST)
    except (EppError, np.linalg.LinAlgError):
        return None
    # Only stable cycles count: the bound is at the special point beside
    # the last stable one that is too large, wherever the branch goes on.
    too_large = [is_stable(p.multipliers) and excess(p) > 0 for p in points]
    last = min((k for k, true in enumerate(too_large) if true), key=lambda k: sign * points[k].value, default=None)
    if last is None:
        return None
    if sign * (points[last].value - end) <= 1e-9 * family.width:
        return ExactBound(kind=Turn.END)
    # A cycle that is born with an infinite period ends in many points of one value.
    close = 1e-6 * family.width
    found = [
        (s[0], s[1]) for s in walk.special if s[3] in (last, last + 1) or abs(s[1].value - points[last].value) < close
    ]
    turns = [(t, p) for t, p in ((_turn(kind, p, excess), p) for kind, p in found) if t is not Turn.UNKNOWN]
    kind, point = min(turns, key=lambda pair: sign * pair[1].value, default=(Turn.UNKNOWN, None))
    if point is None or sign * (point.value - points[last].value) > close:
        return None
    return ExactBound(point.value, point.orbit.period, to_limit_cycle(system, point.orbit), kind, point)


def _turn(change: Change, point: BranchPoint, excess: Callable[[BranchPoint], float]) -> Turn:
    """What a special point is to the bound; UNKNOWN where it is nothing to it."""
    if change is Change.PASSAGE:
        return Turn.SIZE if is_stable(point.multipliers) else Turn.UNKNOWN
    if 1.0 + excess(point) < _AT_BIRTH:
        return Turn.UNKNOWN
    return BORN.get(change, Turn.STABILITY if change in _STABLE_FROM else Turn.UNKNOWN)
