"""Where two events of an orbit merge: the orbit with an arc of no duration, exactly, and the sequence beyond it.

A visit to a mode that becomes ever shorter ends with its two events at one instant, as where friction holds the drive
for a moment less and less long. In the dwell time of that arc the branch is smooth where in its parameter it may bend
like a root, so that Newton's method for a dwell time of zero arrives where steps along the branch shrink to
nothing. The same motion without the visit is an orbit too, with its own branch: where that one leads back, both meet in
a border collision (a non-smooth fold: di Bernardo et al., Piecewise-smooth Dynamical Systems, 2008, chapter 8).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from eppanalysis.methods.continuation.ranges import near
from eppanalysis.methods.continuation.steps import (
    BranchPoint,
    admissible,
    bend,
    make_point,
    point_across,
    regular,
    step,
)
from eppanalysis.methods.orbits.guess import Guess, make_guess
from eppanalysis.methods.orbits.orbit import CONVERGED, Orbit, solve

#: Arcs that are tried, soonest first; farthest border, relative to the parameter's range.
_MOST_ARCS, _REACH = 3, 1e-2
#: How far a border may be from where the engine says that the sequence changes.
_BISECTED = 1e-3
#: Durations from which the branch is drawn on to none at all, of a period.
_SHORT = 5e-5
#: How far beyond a border the new sequence must hold.
_BEYOND = (1e-6, 1e-5, 1e-4, 1e-3)


def borders(point: BranchPoint, ahead: bool = True) -> Iterator[BranchPoint]:
    """Nearby orbits on the same branch of which an arc has no duration, the one that is reached soonest first.

    Parameters
    ----------
    ahead : bool
        Whether they are looked for in the direction of the branch, or behind.
    """
    tau, m = point.orbit.tau, point.orbit.arcs.free.size
    # Dwell times extrapolated along the branch: the one that would first be used up is the first to be tried.
    rate = -point.tangent[m:-1] if ahead else point.tangent[m:-1]
    waits = point.orbit.arcs.event_sequence.at_once != 1
    soon = np.where(waits & (rate > 0), tau / np.where(rate > 0, rate, 1.0), np.inf)
    for arc in np.argsort(soon)[:_MOST_ARCS].tolist():
        found = _without_duration(point, arc) if np.isfinite(soon[arc]) else None
        if found is not None:
            yield found


def _without_duration(point: BranchPoint, arc: int) -> BranchPoint | None:
    """The orbit of the same sequence with a dwell time of zero."""
    row = np.zeros(point.unknowns.size)
    row[point.orbit.arcs.free.size + arc] = 1.0
    found = point_across(point, point.unknowns - point.orbit.tau[arc] * row, row)
    if found is None or abs(found.value - point.value) > _REACH * point.family.width:
        return None
    others = np.delete(found.orbit.tau, arc)
    if np.any(others < -1e-12 * found.orbit.period) or not near(found.orbit, point.orbit):
        return None
    return replace(found, arc=arc)


def across(border: BranchPoint, way: float) -> tuple[BranchPoint | None, bool]:
    """Beyond a border: the orbit without the visit that has no duration there, and whether the branch turns back.

    Parameters
    ----------
    way : {1, -1}
        Whether the parameter grows or falls on the way to the border.
    """
    guess = _without_visit(border)
    orbit = None if guess is None else solve(border.orbit.hybrid, guess)
    if orbit is None or not orbit.residual < CONVERGED or not near(orbit, border.orbit):
        return None, False
    # The shorter sequence has a branch to both sides of the border; the engine says on which of them its events are
    # true (docs/theory/exact_orbits.md, Branches).
    for share in _BEYOND:
        for turns_back in (False, True):
            begin = make_point(border.family, border.value, orbit, None, -way if turns_back else way)
            new = step(begin, share)
            if new is not None and bend(begin, new) < 0.4 and admissible(new):
                return new, turns_back
    return None, False


def border_collision(inside: BranchPoint, new: BranchPoint | None) -> BranchPoint:
    """Where a branch turns back from one sequence to another: what the longer one visits has no duration there.

    Parameters
    ----------
    inside, new : Point
        Last point of the old sequence, and first of the new one.
    """
    if new is None or new.orbit.arcs.n_arcs < inside.orbit.arcs.n_arcs:
        return next(borders(inside), inside)
    return next(borders(new, ahead=False), inside)


def visit_ends(inside: BranchPoint, new: BranchPoint) -> BranchPoint:
    """Where a branch that goes on loses a visit, exactly; the given point where no such border is near.

    The engine does not meet a visit that is shorter than its rounding, which is larger in turned states.
    """
    shorter = new.orbit.arcs.n_arcs < inside.orbit.arcs.n_arcs
    found = next(borders(inside), None) if shorter else None
    if found is None or found.arc is None:
        return inside
    if inside.orbit.arcs.event_sequence.at_once[found.arc] == 2:
        found = _limit(inside, found.arc) or inside
    found = shown_at(found, inside)
    return found if abs(found.value - inside.value) < _BISECTED * inside.family.width else inside


def shown_at(border: BranchPoint, inside: BranchPoint) -> BranchPoint:
    """The orbit that is shown for a border: that before it where a contact grazes, and what switches is constant."""
    return border if regular(border) else replace(inside, value=border.value)


def _limit(inside: BranchPoint, arc: int) -> BranchPoint | None:
    """A point with the value to which its branch comes as an arc that begins on its own guard becomes ever shorter.

    At no duration at all such an arc is on its guard whatever the orbit, and shortly before rounding tells its end.
    """
    place = inside.orbit.arcs.free.size + arc
    row = np.eye(1, inside.unknowns.size, place)[0]
    aside = [inside.unknowns + (k * _SHORT * inside.orbit.period - inside.unknowns[place]) * row for k in (1, 2, 3)]
    values = [p.value for p in (point_across(inside, u, row) for u in aside) if p is not None]
    return replace(inside, value=float(np.dot([3.0, -3.0, 1.0], values))) if len(values) == 3 else None


def _without_visit(border: BranchPoint) -> Guess | None:
    """The orbit at a border without the two events that meet there; None where they do not undo each other."""
    whole: Orbit = border.orbit
    if border.arc is None or whole.arcs.n_timers or whole.arcs.n_arcs < 4:
        return None
    orbit = whole.rotated((border.arc - 1) % whole.arcs.n_arcs)
    it, n = orbit.arcs.event_sequence, orbit.arcs.n_state
    if not np.array_equal(it.modes[0], it.modes[2]):
        return None
    # Arc 1 has no duration: without it and its two events arcs 0 and 2 are one, and the third guard ends it.
    kept = np.r_[0, 3 : it.guards.size]
    starts = orbit.starts[kept][:, np.r_[0:n, orbit.arcs.memory]]
    tau = np.concatenate([[orbit.tau[:3].sum()], orbit.tau[3:]])
    return make_guess(orbit.hybrid, it.modes[kept], it.guards[2:], starts, tau)
