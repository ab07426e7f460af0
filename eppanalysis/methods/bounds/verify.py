"""A bound put to the test by methods that did not make it: the full search and a cloud of runs, on both sides.

On the safe side, a margin away from the bound, the search for all exact orbits must find none and event-exact runs from
at least a thousand seeded starts (states all round the orbit that exists at the bound, and steps of the inputs) must
all come to rest. On the other side, the same margin away, the exact orbit is shown. Cycles that the search or a run
does find on the safe side are handed on, for they lead to the true bound.

Where a size is allowed, cycles up to it are as good as rest: the search must find no stable one that is larger, each
run must come to rest or end on one that is not, and on the other side a stable orbit is shown that is larger.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from eppanalysis.arrays import Array
from eppanalysis.errors import ArgumentError
from eppanalysis.methods.bounds.balanced import BoundProblem
from eppanalysis.methods.bounds.sizes.allowed import Allowed, ends_of
from eppanalysis.methods.orbits.cycle import to_limit_cycle
from eppanalysis.methods.orbits.exact import start_of, steady_hybrid
from eppanalysis.methods.orbits.orbit import Orbit
from eppanalysis.methods.orbits.shooting import orbit_of, orbits_near
from eppanalysis.methods.search.find import find_limit_cycles, seeds_of
from eppanalysis.methods.search.result import CycleSearch
from eppanalysis.methods.search.trigger import Judge
from eppanalysis.methods.simulation.batch import HybridStack, simulate_batch
from eppanalysis.models.systems.hybrid import HybridSystem
from eppanalysis.models.systems.subject import CaseLike
from eppanalysis.readable import count
from eppanalysis.results import LimitCycle, Status

#: Of the runs of a cloud, the share that begins with a step of the inputs; largest displacement, relative to the orbit.
_STEPS, _REACH = 0.25, 4.0
#: Length of a run in periods of the orbit. Undecided ones are looked at longer, until so many do not come to rest.
PERIODS, _ENOUGH = 40.0, 50
#: So many orbits of the cloud are closed at most; relative difference of periods within which one is known already.
_MOST_ORBITS, _SAME_PERIOD = 4, 1e-6


@dataclass(frozen=True, eq=False)
class Verification:
    """What the tests of one bound found."""

    #: safe_value, other_value: where the tests were made, on the safe side and on the other one [SI].
    safe_value: float
    other_value: float
    #: n_runs, n_settled: runs of the cloud, and those of which it is known that they came to rest, or to a cycle that
    #: is allowed.
    n_runs: int
    n_settled: int
    search: CycleSearch | None  # on the safe side; None where what it found is in `cycles` alone
    cycles: tuple[LimitCycle, ...]  # exact ones on the safe side, found by the search or by the runs, and not allowed
    orbit: LimitCycle | None  # the exact orbit on the other side
    message: str  # what is missing; empty where nothing is
    #: (k, states): starts of runs without a known end: neither at rest, nor on a cycle that could be closed, nor far
    #: away.
    slow: Array = field(default_factory=lambda: np.zeros((0, 0)))
    grows: bool = False  # whether a run grew without bound on the safe side

    @property
    def verified(self) -> bool:
        """Whether no cycle was found on the safe side and one on the other."""
        return not self.message


def verify(
    question: BoundProblem,
    value: float,
    sign: float,
    orbit: LimitCycle,
    *,
    margin: float,
    n_starts: int,
    seed: int,
    allowed: Allowed | None = None,
    beyond: LimitCycle | None = None,
) -> Verification:
    """Test a bound on both sides.

    Parameters
    ----------
    value : float
        The bound [SI].
    sign : {1, -1}
        1 where it is free of cycles below the bound.
    orbit : LimitCycle
        The orbit at the bound (or one near it): it gives the size of the cloud and the length of the runs.
    margin : float
        Distance of the tests from the bound, relative to it.
    n_starts : int
        Runs of the cloud.
    seed : int
        Of the cloud.
    allowed : Allowed, optional
        The stable cycles that may be there.
    beyond : LimitCycle, optional
        A cycle on the other side of the bound, where one is known; by default the one at the bound leads to it.
    """
    safe, other = value * (1.0 - sign * margin), value * (1.0 + sign * margin)
    missing = []
    case = question.case_at(safe)
    system = case.to_system()
    # The predicted cycles' balances have just been followed to the bound itself. Without them no cycle that is found
    # depends on what the predictions say of their errors, which takes half of the time to find.
    seeds = [replace(seed, error_estimate=math.nan, harmonic_content=math.nan) for seed in seeds_of(case)]
    search = find_limit_cycles(case, by_balance=False, predicted=seeds)
    bad = [c for c in search if allowed is None or allowed.exceeded_by(c)]
    larger = "" if allowed is None else " larger than allowed"
    if bad:
        missing.append(f"the search finds {count(len(bad), 'limit cycle')}{larger} on the safe side")
    elif search.left_open:
        missing.append("the search left a run undecided on the safe side")
    fates = _settling(case, orbit, n_starts, seed, allowed) if n_starts else _Fates()
    n_settled, n_moving, met = fates.n_settled, fates.n_moving, fates.orbits
    if n_moving:
        fate = "come to rest" if allowed is None else "come to rest, or to a cycle that is allowed,"
        missing.append(f"{n_moving} of {n_settled + n_moving} runs did not {fate} on the safe side")
    if n_settled + n_moving < n_starts:
        missing.append(f"{n_starts - n_settled - n_moving} slow runs after these were not run to their end")
    further = [o for o in met if not _known(o, [c.period for c in search])]
    cycles = (*bad, *(to_limit_cycle(system, o) for o in further))
    found = orbit_at(question, other, orbit if beyond is None else beyond, allowed)
    if found is None:
        missing.append(
            f"no exact {'orbit' if allowed is None else f'stable orbit{larger}'} was found on the other side"
        )
    slow = np.array(fates.slow)
    return Verification(safe, other, n_starts, n_settled, search, cycles, found, "; ".join(missing), slow, fates.grows)


@dataclass
class _Fates:
    """How the runs of a cloud end; lives for one test."""

    n_settled: int = 0
    n_moving: int = 0
    orbits: list[Orbit] = field(default_factory=list)
    slow: list[Array] = field(default_factory=list)
    grows: bool = False


def orbit_at(question: BoundProblem, value: float, near: LimitCycle, allowed: Allowed | None) -> LimitCycle | None:
    """An exact orbit at a value that is not allowed: near a known one, else any that the search finds."""
    case = question.case_at(value)
    system = case.to_system()
    hybrid = steady_hybrid(system, case.operating_point)
    if near.state.size == system.A.shape[0]:
        for orbit in orbits_near(hybrid, *start_of(hybrid, near), near.period):
            cycle = to_limit_cycle(system, orbit)
            if allowed is None or (cycle.stable and allowed.exceeded_by(cycle)):
                return cycle
    return next((c for c in find_limit_cycles(case) if allowed is None or (c.stable and allowed.exceeded_by(c))), None)


def _settling(case: CaseLike, orbit: LimitCycle, n_starts: int, seed: int, allowed: Allowed | None) -> _Fates:
    """How the runs of a cloud end: at rest (or within what is allowed), on which orbits, or undecided.

    Near its bound a cycle that has vanished slows down whatever passes its ghost, so that many runs are undecided at
    the end of the horizon: each is looked at for longer. Only where many of these keep moving is the rest left alone.
    """
    system = case.to_system()
    hybrid = steady_hybrid(system, case.operating_point)
    size = size_of(hybrid, orbit)
    to = Judge(PERIODS * orbit.period, size)
    rest = rest_of(hybrid, to)
    starts = cloud(hybrid, rest, system.v0, size, n_starts, seed)
    stack = HybridStack.of([hybrid], system.signals.names).take(np.zeros(n_starts, int))
    ends = ends_of(simulate_batch(replace(stack, x0=starts), to.horizon), allowed)
    undecided = [i for i, status in enumerate(ends) if status is not Status.SETTLED]
    fates = _Fates(n_starts - len(undecided))
    for k, i in enumerate(undecided):
        if fates.n_moving == _ENOUGH:
            fates.slow += [starts[j] for j in undecided[k:]]
            break
        status, run = to.ends(replace(hybrid, x0=starts[i]))
        on_cycle = status is Status.LIMIT_CYCLE and (allowed is not None or len(fates.orbits) < _MOST_ORBITS)
        closed = orbit_of(hybrid, run) if on_cycle else None
        within = closed is not None and allowed is not None and allowed.of_orbit(system, closed) <= allowed.size
        fates.n_settled += status is Status.SETTLED or within
        fates.n_moving += not (status is Status.SETTLED or within)
        fates.slow += [starts[i]] if status is Status.UNDECIDED else []
        fates.grows |= status is Status.DIVERGED
        if closed is not None and not within and not _known(closed, [known.period for known in fates.orbits]):
            fates.orbits.append(closed)
    return fates


def _known(orbit: Orbit, periods: Sequence[float]) -> bool:
    """Whether a cycle has one of these periods: runs after different steps are on one cycle in different places."""
    return any(abs(orbit.period / known - 1.0) < _SAME_PERIOD for known in periods)


def size_of(hybrid: HybridSystem, orbit: LimitCycle) -> Array:
    """How far each state moves on the orbit; of states between whose corners nothing is seen, its own size."""
    corners = orbit.event_states if orbit.event_states.size else orbit.state[None]
    amplitude = np.zeros(hybrid.x0.size)
    span = np.ptp(corners, axis=0)
    amplitude[: hybrid.n_plant] = np.where(span > 0, span, np.abs(corners).max(axis=0))
    return amplitude


def rest_of(hybrid: HybridSystem, to: Judge) -> Array:
    """Where a run from the start comes to rest; the start itself if it does not."""
    status, run = to.ends(hybrid)
    return run.x_end if status is Status.SETTLED else hybrid.x0


def cloud(hybrid: HybridSystem, rest: Array, v0: Array, size: Array, n: int, seed: int) -> Array:
    """Starts of a cloud, shape (n, states): displaced from rest, and steps of the inputs from where they were.

    The displacements have all directions and sizes from a hundredth of the orbit to four times it; the steps go from
    twice as far as the case's own in one direction to as far in the other.
    """
    rng = np.random.default_rng(seed)
    starts = np.repeat(rest[None], n, axis=0)
    n_steps = int(_STEPS * n) if np.any(hybrid.x0[hybrid.n_plant :] != v0) else 0
    n_moved = n - n_steps
    direction = rng.uniform(-1.0, 1.0, (n_moved, size.size))
    # Displacements from a hundredth of the orbit to four times
    # it, even in the logarithm: what guards rest may be small.
    reach = _REACH * 10.0 ** rng.uniform(-2.6, 0.0, (n_moved, 1))
    starts[:n_moved] += np.where(hybrid.compared, reach * direction * size, 0.0)
    if n_steps:
        inputs = hybrid.x0[hybrid.n_plant :]
        factor = rng.uniform(-2.0, 2.0, (n_steps, 1))
        starts[n_moved:] = hybrid.x0
        starts[n_moved:, hybrid.n_plant :] = v0 + factor * (inputs - v0)
    return starts


def check_verification(margin: float, n_starts: int) -> None:
    """Refuse settings that make no sense.

    Raises
    ------
    EppError
        If the margin is not between 0 and 0.5, or the number of starts is negative.
    """
    if not 0.0 < margin < 0.5:
        raise ArgumentError("margin", f" is {margin}; expected a share between 0 and 0.5.", "design_bounds")
    if n_starts < 0:
        raise ArgumentError("starts", f" is {n_starts}; expected zero or a positive number.", "design_bounds")
