"""From the bound by harmonic balance to the exact one: the fold of the branch of exact orbits nearest to it.

A cycle of the balance a little inside the bound gives the first exact orbit, from there the branch is followed to where
it turns back. Branches also turn back where an event comes or goes at a grazing contact, with a corner in place of a
smooth fold; both end the family and count.
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
from eppanalysis.methods.harmonic import cycle_of, settled
from eppanalysis.methods.harmonic_elements import Unsettled
from eppanalysis.results import LimitCycle

#: How far inside the harmonic bound an orbit is sought, relative to it, and how far beyond the branch is followed.
_INSIDE = (0.02, 0.05, 0.1, 0.2, 0.4, 0.8)
_OUTSIDE = 0.25
_TURNS = ("fold", "turning change of sequence")


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
    message : str
        Why there is none.
    """

    value: float = float("nan")
    period: float = float("nan")
    cycle: LimitCycle | None = None
    kind: str = ""
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
        stop = np.clip(near.value * (1.0 - sign * _OUTSIDE), question.low, question.high)
        for start in _cycles_inside(question, near, inside):
            try:
                branch = continue_branch(
                    question.case, question.limit, inside, float(stop), cycle=start, n_points=150, max_step=0.08
                )
            except EppError:
                continue
            turn = _extreme(branch, sign)
            if turn is not None:
                kind = "fold" if turn.kind == "fold" else "corner"
                return ExactBound(turn.value, turn.cycle.period, turn.cycle, kind)
            message = f"the branch of exact orbits has no fold near: {branch.message[0].lower()}{branch.message[1:]}"
    return ExactBound(message=message)


def _extreme(branch: Branch, sign: float) -> SpecialPoint | None:
    turns = [s for s in branch.special if s.kind in _TURNS]
    return min(turns, key=lambda s: sign * s.value) if turns else None


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
