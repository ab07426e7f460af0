"""Where branches begin: orbits of a given cycle, of the case's own run, or of a search."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace

import numpy as np

from eppanalysis.errors import EppError
from eppanalysis.methods.continuation.families import Family
from eppanalysis.methods.orbits.exact import MOST_WORK, Candidate, asked_for, orbits_of, require_own, steady_hybrid
from eppanalysis.methods.orbits.orbit import Orbit
from eppanalysis.methods.orbits.shooting import orbit_of
from eppanalysis.methods.search.find import find_limit_cycles
from eppanalysis.methods.simulation.budget import BudgetExceeded, budget
from eppanalysis.methods.simulation.runs import judge, run_hybrid
from eppanalysis.models.systems.hybrid import HybridSystem
from eppanalysis.models.systems.subject import CaseLike
from eppanalysis.results import EXACT_ORBIT, LimitCycle, Status

#: Error of a given cycle, by which its orbit is known from others; of an exact one of a neighbouring loop beside a
#: fold, from where cycles move fast, where none is so near.
_NEIGHBOURS, _BESIDE_A_FOLD = 0.05, 0.5


def steady_case(case: CaseLike) -> HybridSystem:
    """The hybrid system of a case at its operating point.

    Raises
    ------
    EppError
        For a discrete-time system, or an input that is not constant.
    """
    return steady_hybrid(case.to_system(), case.operating_point)


def refused(case: CaseLike, parameter: str, value: float) -> str:
    """Why there is no loop at a value of a parameter, in words; empty where there is one."""
    try:
        case.with_values({parameter: value}).to_system()
    except EppError as error:
        return str(error).rstrip(".")
    return ""


def seed(
    case: CaseLike, parameter: str, family: Family, ends: tuple[float, float], cycle: LimitCycle | None
) -> tuple[float, Orbit]:
    """A first orbit: from the cycle given, from a run at either end, or from a search there."""
    if cycle is not None:
        return ends[0], _given(case, parameter, family, ends[0], cycle)
    for value in ends:
        hybrid = steady_case(case.with_values({parameter: value}))
        run = run_hybrid(hybrid, case.t_end, np.zeros(0), 2.0 * hybrid.time_scale, 60_000, 600)
        status, found = judge(hybrid, run, case.t_end)
        if status is Status.LIMIT_CYCLE:
            closed = orbit_of(family.at(value), run, float(found[1]))
            if closed is not None and _goes_on(family, value, closed):
                return value, closed
    is_there = False
    for value in ends[::-1]:
        for closed in orbits_found(case, parameter, family, value):
            is_there = True
            if closed is not None and _goes_on(family, value, closed):
                return value, closed
    if is_there:
        raise EppError(
            f"continue_branch: limit cycles were found at the ends of the range of {parameter}, but none as an exact "
            "orbit from switch to switch; expected one, which a loop with dead time need not have."
        )
    raise EppError(
        f"continue_branch: no limit cycle was found at either end of the range of {parameter}; expected a range with "
        "one at an end, from which the branch begins."
    )


def _given(case: CaseLike, parameter: str, family: Family, value: float, cycle: LimitCycle) -> Orbit:
    """The orbit at a value of a cycle that is given, which may be one of a neighbouring loop."""
    there, exact = case.with_values({parameter: value}), cycle.method == EXACT_ORBIT
    require_own(there.to_system(), cycle)
    for error in (_NEIGHBOURS, _BESIDE_A_FOLD) if exact else (max(cycle.error_estimate, _NEIGHBOURS),):
        near = replace(cycle, error_estimate=error)
        orbit = _orbit_of(there, family.at(value), near, by_balance=not exact)
        if orbit is not None:
            return orbit
    at = case.text(parameter, value)
    raise EppError(f"continue_branch: there is no exact orbit near the given cycle at {parameter} = {at}.")


def _goes_on(family: Family, value: float, orbit: Orbit) -> bool:
    """Whether the loop has the same structure beside a value, or what is delayed moves; a dead time of zero is none."""
    if orbit.motion is None:
        try:
            family.slope(orbit, value)
        except EppError:
            return False
    return True


def orbits_found(case: CaseLike, parameter: str, family: Family, value: float) -> Iterator[Orbit | None]:
    """The orbits of all cycles that the exact search finds at a value, smallest first; None for one without."""
    there = case.with_values({parameter: value})
    for known in find_limit_cycles(there):
        yield _orbit_of(there, family.at(value), known, by_balance=False)


def _orbit_of(case: CaseLike, hybrid: HybridSystem, cycle: LimitCycle, by_balance: bool) -> Orbit | None:
    """The orbit of a cycle, and no neighbour: runs from an unstable one end on others."""
    found: list[Candidate] = []
    with suppress(BudgetExceeded), budget(MOST_WORK):
        found.extend(orbits_of(case.to_system(), hybrid, cycle, case.operating_point, by_balance))
    return asked_for(found)
