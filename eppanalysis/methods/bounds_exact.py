"""From the bound by harmonic balance to the exact one: the fold of the branch of exact orbits nearest to it.

A cycle of the balance a little inside the bound gives the first exact orbit, from there the branch is followed to where
it turns back. Branches also turn back where the orbit ceases to visit a mode, with a corner in place of a smooth fold;
both end the family and count, and both are solved for exactly.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from eppanalysis.errors import EppError
from eppanalysis.methods.bounds_fold import Cycle
from eppanalysis.methods.bounds_harmonic import Question, steady_loop
from eppanalysis.methods.bounds_numbers import Numbers
from eppanalysis.methods.continuation import Branch, SpecialPoint, continue_branch
from eppanalysis.methods.continuation_steps import Point
from eppanalysis.methods.harmonic import cycle_of, settled
from eppanalysis.methods.harmonic_elements import Unsettled
from eppanalysis.results import LimitCycle

#: How far inside the harmonic bound an orbit is sought, relative to it, and how far beyond the branch is followed.
_INSIDE = (0.02, 0.05, 0.1, 0.2, 0.4, 0.8)
_OUTSIDE = 0.25
_KINDS = {"fold": "fold", "turning change of sequence": "corner"}
#: Where an orbit is looked for beyond a corner, relative to its value, and how often.
_BEYOND, _MOST_CORNERS = (2e-4, 1e-3, 4e-3), 6


@dataclass(frozen=True, eq=False)
class ExactBound:
    """The exact bound, or why there is none.

    Attributes
    ----------
    value : float
        [SI]; nan where it could not be found.
    period : float
        Of the orbit at the bound [s].
    cycle : LimitCycle or None
        The orbit there.
    kind : str
        "fold" or "corner".
    point : Point or None
        The orbit with the direction of its branch.
    message : str
        Why there is none.
    """

    value: float = float("nan")
    period: float = float("nan")
    cycle: LimitCycle | None = None
    kind: str = ""
    point: Point | None = None
    message: str = ""


def correct(question: Question, near: Cycle, sign: float) -> ExactBound:
    """The exact bound near a bound by harmonic balance.

    Parameters
    ----------
    question : Question
        At one value of the parameter that runs.
    near : Cycle
        The cycle of harmonic balance at its bound.
    sign : {1, -1}
        1 where the cycles lie above the bound.
    """
    message = "no exact orbit was found near the cycles of harmonic balance"
    for share in _INSIDE:
        inside = near.value * (1.0 + sign * share)
        if not question.low <= inside <= question.high:
            continue
        stop = float(np.clip(near.value * (1.0 - sign * _OUTSIDE), question.low, question.high))
        for start in _cycles_inside(question, near, inside):
            branch = branch_from(question, inside, stop, start)
            if branch is None:
                continue
            turn = turn_of(question, branch, stop, sign)
            if turn is not None:
                return turn
            message = f"the branch of exact orbits has no fold near: {branch.message[0].lower()}{branch.message[1:]}"
    return ExactBound(message=message)


def turn_of(question: Question, branch: Branch, stop: float, sign: float) -> ExactBound | None:
    """The bound where a branch turns back; None where it does not before `stop`."""
    turn = _last_turn(question, branch, stop, sign)
    if turn is None:
        return None
    return ExactBound(turn.value, turn.cycle.period, turn.cycle, _KINDS[turn.kind], turn.point)


def branch_from(question: Question, start: float, stop: float, cycle: LimitCycle) -> Branch | None:
    """The branch from a cycle near an orbit at `start`; None where there is no such orbit."""
    try:
        with np.errstate(over="ignore", invalid="ignore"):
            return continue_branch(question.case, question.limit, start, stop, cycle=cycle, n_points=150, max_step=0.08)
    except (EppError, np.linalg.LinAlgError):
        return None


def _last_turn(question: Question, branch: Branch, stop: float, sign: float) -> SpecialPoint | None:
    """The farthest place at which a branch turns back.

    At a corner the step on to the new sequence of events may have been taken the wrong way round. Where an orbit near
    the one at the corner exists beyond it, the branch goes on from there.
    """
    for _ in range(_MOST_CORNERS):
        turns = [s for s in branch.special if s.kind in _KINDS]
        turn = min(turns, key=lambda s: sign * s.value) if turns else None
        if turn is None or turn.kind == "fold":
            return turn
        further = None
        for share in _BEYOND:
            value = turn.value * (1.0 - sign * share)
            further = branch_from(question, value, stop, turn.cycle) if sign * (value - stop) > 0 else None
            if further is not None:
                break
        if further is None:
            return turn
        branch = further
    return turn


def _cycles_inside(question: Question, near: Cycle, value: float) -> Iterator[LimitCycle]:
    """Cycles of harmonic balance at a value inside the bound, carried there from the bound in steps."""
    numbers: Numbers = question.numbers()
    here = near
    for v in np.geomspace(near.value, value, 4)[1:]:
        try:
            true = settled(numbers.loop(float(v)), here.Z, here.omega)
        except Unsettled:
            true = None
        if true is not None:
            here = Cycle(float(v), *true)
    if here is near or here.value != value:
        # What does not balance may still be near enough to the exact orbit.
        here = Cycle(value, here.Z, here.omega)
    try:
        yield cycle_of(steady_loop(question.case_at(value)), here.Z, here.omega)
    except Unsettled:
        return
