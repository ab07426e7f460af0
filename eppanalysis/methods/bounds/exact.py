"""From the bound by describing functions to the exact one: the fold of the branch of exact orbits.

A cycle of the balance a little inside the bound gives the first exact orbit, else one far inside, where the balance is
nearest to the truth; from there the branch is followed to where it turns back. Branches also turn back where the orbit
ceases to visit a mode, with a border collision in place of a smooth fold; both end the family and count, and both are
solved for exactly. Where no orbit is found that continues a branch (a cycle that ceases to stick and goes on without
any switch), the family is known up to there: that is the bound of exact orbits, and the tests on both sides say whether
it bounds anything.

Where neither leads to an orbit, exact orbits are searched for, farther and farther from where the balance put it.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from eppanalysis.errors import EppError
from eppanalysis.methods.bounds.balanced import BalancedBound, BoundProblem, spread, steady_loop
from eppanalysis.methods.bounds.fold import Cycle, balanced
from eppanalysis.methods.bounds.result import Turn
from eppanalysis.methods.continuation.branch import continue_branch
from eppanalysis.methods.continuation.result import Branch
from eppanalysis.methods.continuation.steps import BranchPoint
from eppanalysis.methods.harmonic.balance import cycle_of
from eppanalysis.methods.harmonic.elements import Unsettled
from eppanalysis.methods.search.find import find_limit_cycles
from eppanalysis.methods.steady.changes import Change
from eppanalysis.results import LimitCycle

#: How far inside a bound an orbit is sought, relative to it, and how far beyond the branch is followed.
_INSIDE = (0.05, 0.2)
_OUTSIDE = 0.25
#: Where families of cycles end, and what that is to a bound; with an infinite period a cycle is born as at a fold.
BORN = {
    Change.FOLD: Turn.FOLD,
    Change.INFINITE: Turn.FOLD,
    Change.TURNING: Turn.CORNER,
    Change.LINEAR: Turn.LINEAR,
}
#: The same, and where no orbit is found that continues a family.
_ENDS = {**BORN, Change.END: Turn.BREAK}
#: Where an orbit is looked for beyond such a place with a kink, relative to its value, and how often at most.
_BEYOND, _MOST_COLLISIONS = (2e-4, 1e-3, 4e-3), 5
#: Values from a bound of the balance to the far end of the range at which exact orbits are searched for.
_N_SEARCHED = 7


@dataclass(frozen=True, eq=False)
class ExactBound:
    """The exact bound, or why there is none."""

    value: float = float("nan")  # [SI]; nan where it could not be found
    period: float = float("nan")  # of the orbit at the bound [s]
    cycle: LimitCycle | None = None  # the orbit there
    kind: Turn = Turn.UNKNOWN
    point: BranchPoint | None = None  # the orbit with the direction of its branch
    message: str = ""  # why there is none

    @property
    def is_solved(self) -> bool:
        """Whether the orbit solves equations of the bound, by which that has slopes: a border needs its arc."""
        at_border = self.kind in (Turn.CORNER, Turn.BREAK)
        return self.point is not None and not (at_border and self.point.arc is None)


def correct(question: BoundProblem, near: Cycle, sign: float) -> ExactBound:
    """The exact bound near a cycle of the balance at its bound; `sign` is 1 where the cycles lie above it."""
    message = "no exact orbit was found near the cycles of the describing function"
    # At the bound two orbits meet and Newton's matrix is singular, so the first orbit is closed some way inside.
    for share in _INSIDE:
        inside = near.value * (1.0 + sign * share)
        if not question.low <= inside <= question.high:
            continue
        stop = float(np.clip(near.value * (1.0 - sign * _OUTSIDE), question.low, question.high))
        for start in _cycles_inside(question, near, inside):
            branch = _branch(question, inside, stop, start)
            if branch is None:
                continue
            turn = turn_of(question, branch, stop, sign)
            if turn is not None:
                return turn
            message = f"the branch of exact orbits has no fold near: {branch.message[0].lower()}{branch.message[1:]}"
    return ExactBound(message=message)


def of_balance(question: BoundProblem, bound: BalancedBound) -> ExactBound:
    """The exact bound to which the cycles of describing functions lead: near their bound, else from far inside."""
    assert bound.fold is not None
    found = correct(question, bound.fold.cycle, bound.sign)
    if found.cycle is not None:
        return found
    # The cycles far inside mostly lie on one branch, behind whose fold the others are met again.
    far = (farthest_turn(question, c.value, _as_cycle(question, c), bound.sign) for c in bound.far)
    return next((turn for turn in far if turn is not None), found)


def searched(question: BoundProblem, near: float, sign: float) -> ExactBound:
    """The exact bound of the cycles that the exact search finds next to a value `near`, on the side that has cycles."""
    end, far = question.ends(sign)
    if find_limit_cycles(question.case_at(end)):
        return ExactBound(kind=Turn.END)
    with_cycles, without = set[float](), {end}
    for value in spread(float(np.clip(near, question.low, question.high)), far, _N_SEARCHED):
        if value == end:
            continue
        orbits = find_limit_cycles(question.case_at(value))
        turn = farthest_turn(question, value, orbits, sign)
        if turn is not None:
            return turn
        (with_cycles if orbits else without).add(value)
    message = f"the exact search finds no limit cycle at {question.in_words(sorted(without))}"
    if with_cycles:
        seen = question.in_words(sorted(with_cycles))
        message += f", and limit cycles at {seen}, whose branches could not be followed to an end"
    return ExactBound(message=message)


def turn_of(
    question: BoundProblem,
    branch: Branch,
    stop: float,
    sign: float,
    ends: Mapping[Change, Turn] = BORN,
    collisions: int = _MOST_COLLISIONS,
) -> ExactBound | None:
    """The bound at the farthest place where a branch turns back, or otherwise ends; None where there is none by `stop`.

    At a border collision the step on to the new sequence of events may have been taken the wrong way round, or none may
    have been found. Where an orbit near the one at the border exists beyond it, the branch goes on from there.
    """
    turn = min((s for s in branch.special if s.kind in ends), key=lambda s: sign * s.value, default=None)
    if turn is None:
        return None
    for share in _BEYOND if collisions and turn.kind in (Change.TURNING, Change.END) else ():
        value = turn.value * (1.0 - sign * share)
        further = _branch(question, value, stop, turn.cycle) if sign * (value - stop) > 0 else None
        if further is not None:
            return turn_of(question, further, stop, sign, ends, collisions - 1)
    return ExactBound(turn.value, turn.cycle.period, turn.cycle, ends[turn.kind], turn.point)


def farthest_turn(question: BoundProblem, value: float, cycles: Iterable[LimitCycle], sign: float) -> ExactBound | None:
    """The farthest bound of families of which cycles at a value are known; None where none ends within the range."""
    end, _ = question.ends(sign)
    branches = (_branch(question, value, end, cycle) for cycle in cycles)
    turns = [turn_of(question, branch, end, sign, _ENDS) for branch in branches if branch is not None]
    return min((t for t in turns if t is not None), key=lambda t: sign * t.value, default=None)


def _branch(question: BoundProblem, start: float, stop: float, cycle: LimitCycle) -> Branch | None:
    """The branch from a cycle near an orbit at `start`; None where there is no such orbit."""
    try:
        with np.errstate(over="ignore", invalid="ignore"):
            return continue_branch(question.case, question.limit, start, stop, cycle=cycle, n_points=150, max_step=0.08)
    except (EppError, np.linalg.LinAlgError):
        return None


def _cycles_inside(question: BoundProblem, near: Cycle, value: float) -> Iterator[LimitCycle]:
    """Cycles of the balance at a value inside its bound, carried there from the bound at once, else in steps."""
    model = question.model()
    here = balanced(model, value, near)
    if here is None:
        here = near
        for v in np.geomspace(near.value, value, 4)[1:].tolist():
            here = balanced(model, v, here) or here
    # What does not balance may still be near enough to the exact orbit.
    yield from _as_cycle(question, replace(here, value=value))


def _as_cycle(question: BoundProblem, cycle: Cycle) -> Iterator[LimitCycle]:
    """A cycle of the balance as that of the loop; none where the elements' answer to it does not settle."""
    with suppress(Unsettled):
        yield cycle_of(steady_loop(question.case_at(cycle.value)), cycle.Z, cycle.omega)
