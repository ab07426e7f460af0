"""How a run of a search ends: at rest, far away, on a cycle, or none of these."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from enum import StrEnum
from functools import cached_property

import numpy as np

from eppanalysis.arrays import Array, IntArray
from eppanalysis.errors import EppError
from eppanalysis.methods.orbits.delayed.smooth import closed_behind_delay, is_smooth_delayed
from eppanalysis.methods.orbits.exact import centre_of, start_of, steady_hybrid
from eppanalysis.methods.orbits.guess import recurrences
from eppanalysis.methods.orbits.orbit import Orbit
from eppanalysis.methods.orbits.shooting import close_orbit, orbit_of, same_orbit
from eppanalysis.methods.search.continua import at_end, has_period_of, has_switches_of, on_rim, same_continuum
from eppanalysis.methods.search.decay import PoincareReturns, comes_to_rest, dwindles
from eppanalysis.methods.search.reach import reach_of_elements
from eppanalysis.methods.search.rests import VisitedModes, note_modes
from eppanalysis.methods.simulation.budget import Budget, BudgetExceeded, budget, remaining
from eppanalysis.methods.simulation.futures import Future, Leaves, Rests, Swings, Switches, future_of
from eppanalysis.methods.simulation.kept import Run
from eppanalysis.methods.simulation.runs import cycle_of_run, judge, repeats_undecided, run_hybrid
from eppanalysis.methods.simulation.stability import is_stable
from eppanalysis.models.systems.hybrid import HybridSystem
from eppanalysis.models.systems.linear import slowest_pole
from eppanalysis.models.systems.lure import LureSystem
from eppanalysis.models.systems.operating import OperatingPoint
from eppanalysis.models.systems.starts import remembered
from eppanalysis.progress import Progress
from eppanalysis.results import EXACT_ORBIT, LimitCycle, Status
from eppanalysis.results.provenance import Provenance

#: A line of starts: centre, direction, memory values.
Ray = tuple[Array, Array, Array]

NO_SAMPLES = np.zeros(0)
MOST_EVENTS = 60_000
#: A run without an outcome after this many events is not made longer.
_ENOUGH_EVENTS = 600
#: Relative difference of the return of a run from the period of a cycle that it may be on the way to.
_NEARS = 1e-2
#: A run is tested for a cycle without switches on one that is so many times as long.
_SEEN = 3.0
#: A run is made three times longer this often at most, and to so many horizons unless it still switches or is carried
#: on to a switch.
_LOOKS, _LONGEST = 16, 3.0**7
#: A cycle is listed as a run has it when all changes still to come are below this share of its amplitude. The run is
#: made three times longer this often at most. Only so many are listed, for they may fill a continuum.
_REACHED, _MOST_LONGER, MOST_REACHED = 1e-9, 6, 12
#: Relative difference of closed cycles that are one.
_SAME_CYCLE = 1e-6
#: Estimated error above which a prediction is no measure of how long runs take.
_DOUBTFUL = 1.0
#: How far beside a start that is a state of rest another one is tried, relative to the motions in question.
ASIDE = 1e-6
#: Share of all work that one prediction, one start or one mirror image may take.
FOR_ONE = 0.1


class RunOutcome(StrEnum):
    """Where a run of a search ends, in words that follow their number."""

    REST = "at rest"
    CYCLE = "on a cycle"
    #: Of a loop with sampled controllers, not locked to the samples.
    OF_RUNS = "on a cycle known from runs"
    UNCLOSED = "on a cycle that could not be closed"
    #: Its elements change less in a period than rounding does.
    BENEATH_ROUNDING = "beneath rounding"
    DIVERGENCE = "without bound"
    UNDECIDED = "undecided"
    #: Of a loop with sampled controllers.
    OUT_OF_EVENTS = "out of events"
    NOT_RUN = "not run"


@dataclass(frozen=True)
class Look:
    """What a motion has come to by a time [s], a cycle by its number; undecided where it goes on."""

    time: float
    outcome: RunOutcome | int


#: Of a cycle that no run has met.
NO_CORNERS = np.zeros(0, np.int64), np.zeros((0, 0)), np.zeros(0)


@dataclass(frozen=True, eq=False)
class SimulatedCycle:
    """A cycle that a run is on, whose orbit could not be closed."""

    cycle: LimitCycle  # as the run has it, or closed by collocation behind a dead time
    #: (events,), (events, n), (n,): guard and state at each event of a period, and how far each state moves.
    corners: tuple[IntArray, Array, Array]

    @classmethod
    def of(cls, system: LureSystem, start: HybridSystem, run: Run, facts: Array) -> SimulatedCycle | None:
        """From the end of a run, and what the verdict says of it; None where its period cannot be computed again."""
        events, period = run.order[-int(facts[0]) - 1 : -1], float(facts[1])
        states = run.state[events]
        size = np.ptp(states, axis=0) + np.abs(run.rate[events]).max(axis=0) * period / (2.0 * np.pi)
        size = np.where(size > 0, size, np.inf)
        told = Provenance("event-exact simulation", {"system": system.name, "t_end": float(run.stats[0])})
        cycle = cycle_of_run(system, start, run, facts, told)
        return None if cycle is None else cls(cycle, (run.guard[events], states, size))


@dataclass
class RunOutcomes:
    """The runs of a search and how they end; what they end on is kept."""

    system: LureSystem
    hybrid: HybridSystem
    predicted: Sequence[LimitCycle]
    at: OperatingPoint
    progress: Progress | None = None
    orbits: list[Orbit] = field(default_factory=list)
    reached: list[SimulatedCycle] = field(default_factory=list)
    outcomes: Counter[RunOutcome] = field(default_factory=Counter)
    times: Counter[int] = field(default_factory=Counter)
    bounding: Counter[int] = field(default_factory=Counter)
    n_runs: int = 0
    n_boundaries: int = 0
    n_ended: int = 0
    work: Budget = field(default_factory=lambda: Budget(float("inf")))
    rest: tuple[Array, Array] | None = None
    visited: VisitedModes = field(default_factory=dict)

    @cached_property
    def horizon(self) -> float:
        """How long a run is before it is judged for the first time [s]."""
        if self.predicted:
            # What may not exist sets no length: a run is made longer anyway where it has not come to an end.
            trusted = [c for c in self.predicted if c.error_estimate <= _DOUBTFUL]
            return 40.0 * max(c.period for c in trusted or self.predicted)
        slow = slowest_pole(self.system.A) if self.system.A.size else 1.0
        return 3.0 / slow if slow else 100.0 * self.hybrid.time_scale

    @cached_property
    def rays(self) -> list[Ray]:
        """Lines of starts."""
        rays = []
        for cycle in self.predicted:
            x, H = start_of(self.hybrid, cycle)
            centre = x.copy()
            centre[: self.hybrid.n_plant] = centre_of(self.hybrid, cycle)
            rays.append((centre, x - centre, H))
        x0 = self.hybrid.x0
        centre = self.centre
        if np.any(x0 != centre):
            rays.append((centre, x0 - centre, self.hybrid.H0))
        if np.any(self.reach):
            rays.append((centre, self.reach, self.hybrid.H0))
        return rays

    @cached_property
    def centre(self) -> Array:
        """Zero, with the inputs held: where nothing moves without the elements, as the state is counted."""
        centre = self.hybrid.x0.copy()
        centre[: self.hybrid.n_plant] = 0.0
        return centre

    @cached_property
    def reach(self) -> Array:
        """How far the states must go for the elements to matter; zero where nothing says it."""
        reach = np.zeros_like(self.hybrid.x0)
        reach[: self.hybrid.n_plant] = reach_of_elements(self.system)
        return reach

    def add(self, orbit: Orbit) -> int:
        """Number of an orbit among those found; a new one is appended."""
        for i, known in enumerate(self.orbits):
            if any(test(known, orbit) for test in (same_orbit, same_continuum, on_rim, at_end)):
                return i
            if at_end(orbit, known):
                self.orbits[i] = orbit
                return i
        self.orbits.append(orbit)
        return len(self.orbits) - 1

    def outcome(self, x: Array, H: Array, rests_by: float = 0.0) -> RunOutcome | int:
        """Where a run from (x, H) ends, a cycle by its number; rest by `rests_by` [s] counts though it be left."""
        try:
            found = self._outcome(x, H, rests_by)
        except BudgetExceeded:
            self.n_ended += 1
            found = RunOutcome.NOT_RUN
        self.outcomes[found if isinstance(found, RunOutcome) else RunOutcome.CYCLE] += 1
        if not isinstance(found, RunOutcome):
            self.times[found] += 1
        return found

    def _outcome(self, x: Array, H: Array, rests_by: float = 0.0) -> RunOutcome | int:
        self._tell()
        start = self.hybrid.at(x, H, self.hybrid.modes0)
        try:
            with budget(FOR_ONE * self.work.most):
                if rests_by and judge(start, run := self._run(start, rests_by), rests_by)[0] is Status.SETTLED:
                    return self._rested(start, run)
                return self._beside(x, H, self._end_of(start))
        except EppError:  # a dead time with more switches than its history holds
            return RunOutcome.UNDECIDED
        except BudgetExceeded:
            if not remaining():  # of what lies around this start
                raise
            return RunOutcome.UNDECIDED

    def _beside(self, x: Array, H: Array, end: RunOutcome | int) -> RunOutcome | int:
        """The end of a run, but that of one beside it where a run stays at its very start and to neither side a motion
        settles there.
        """
        if end is not RunOutcome.REST or self.rest is None or not np.array_equal(self.rest[0], x):
            return end
        rest, moved = self.rest, self.hybrid.compared * ASIDE * self._sizes()
        # The elements remember what they have at rest: of what they are given some can take a part only, as a play.
        start = self.hybrid.at(x, H, self.hybrid.modes0)
        there = self._run(start, self.horizon).end(start)
        memory = remembered(there, there.x0, there.H0, there.modes0)
        for sign in (1.0, -1.0):
            beside = self._end_of(there.begun((x + sign * moved)[: there.n_plant], memory))
            if beside is RunOutcome.REST:
                break
        self.rest = rest if beside is RunOutcome.REST else None
        return beside

    def _end_of(self, start: HybridSystem) -> RunOutcome | int:
        """What a run comes to."""
        *_, last = self.looks(start, self.horizon)
        return last.outcome

    def looks(self, start: HybridSystem, t: float) -> Iterator[Look]:
        """What a motion has come to: runs three times as long each, from t [s] on, until one is on a cycle or its modes
        say the rest.
        """
        gone, longest, turns = 0.0, _LONGEST * t, None
        for turn in range(_LOOKS):
            run = self._run(start, t)
            status, facts = judge(start, run, t)
            turns = PoincareReturns.of(start, run, turns)
            future = turns.sliding
            # Swings that shrink by less than rounding in a turn look like a cycle.
            rests = isinstance(future, Rests)
            known = self._rested(start, run, future) if rests else self._by_then(start, run, t, status, facts)
            if known is None:
                future = future or future_of(run.end(start))
                known = self._to_come(future, turns, start, run, t)
            yield Look(gone + t, RunOutcome.UNDECIDED if known is None else known)
            if known is not None or status is Status.EVENT_LIMIT:
                return
            if isinstance(future, Switches) and future.after > 3.0 * t:  # it is carried there
                gone += t + future.after
                start = run.end(start)
                start = start.at(future.state, start.H0, start.modes0)
                t *= 3.0
                continue
            if turn >= 3 and status is not Status.LIMIT_CYCLE and self._is_without_end(start, run):
                return
            is_quiet = run.is_quiet_at(t) and not isinstance(future, Switches)
            t, turns = 3.0 * t, None
            if t > longest and (is_quiet or run.count > _ENOUGH_EVENTS):
                return

    def _by_then(
        self, start: HybridSystem, run: Run, t: float, status: Status, facts: Array
    ) -> RunOutcome | int | None:
        """The outcome of a run by what it has done until t; None for one that goes on."""
        if repeats_undecided(status, facts):
            return RunOutcome.BENEATH_ROUNDING
        if status is Status.SETTLED:
            return self._rested(start, run)
        if status is Status.DIVERGED:
            return RunOutcome.DIVERGENCE
        if status is Status.EVENT_LIMIT:
            return None
        known = self._recognise(start, run, float(facts[1]) if status is Status.LIMIT_CYCLE else None)
        if known is RunOutcome.UNDECIDED and self.hybrid.may_be_quiet:
            known = self._quiet_cycle(run, t)
        return None if known is RunOutcome.UNDECIDED else known

    def _to_come(
        self, future: Future | None, turns: PoincareReturns, start: HybridSystem, run: Run, t: float
    ) -> RunOutcome | int | None:
        """The outcome of a run by what is to come behind its end: by its modes there, or as its turns are alike; None
        where neither says it.
        """
        if isinstance(future, Leaves):
            return RunOutcome.DIVERGENCE
        if isinstance(future, Swings):
            known = self._quiet_cycle(run, t)
            return None if known is RunOutcome.UNDECIDED else known
        if comes_to_rest(future, turns, start, run, t, self._sizes()):
            return self._rested(start, run, future)
        return None if turns.ratio is None else RunOutcome.DIVERGENCE

    def _is_without_end(self, start: HybridSystem, run: Run) -> bool:
        """Whether a longer run would tell nothing: after many switches that do not become smaller, as they do for long
        beside a fold.
        """
        if run.count <= _ENOUGH_EVENTS or dwindles(start, run):
            return False
        # A motion that is slow beside its switches, as a drive under a switched current, nears its cycle for long.
        for guess in recurrences(self.hybrid, run, None, 3, _ENOUGH_EVENTS):
            period, closed = float(guess.tau.sum()), close_orbit(self.hybrid, guess)
            if closed is not None and is_stable(closed.multipliers, closed.one_of_many):
                self.add(closed)
            if any(is_stable(o.multipliers) and abs(period / o.period - 1.0) < _NEARS for o in self.orbits):
                return False
        return True

    def _quiet_cycle(self, run: Run, t: float) -> RunOutcome | int:
        """Number of the cycle that a run without switches is on at its end: of a linear part that does not damp it, or
        of curved elements.
        """
        if not run.is_quiet_at(t):
            return RunOutcome.UNDECIDED
        observed = steady_hybrid(self.system, self.at, observed=True)
        end = run.end(self.hybrid)
        modes = np.append(end.modes0, observed.modes0[end.modes0.size :])
        start = replace(observed, x0=end.x0, H0=end.H0, modes0=modes, time_scale=self.hybrid.time_scale)
        again = self._run(start, _SEEN * t)
        status, facts = judge(start, again, _SEEN * t)
        if status is Status.LIMIT_CYCLE and (known := self._listed(again)) is not None:
            return known
        orbit = orbit_of(start, again, float(facts[1])) if status is Status.LIMIT_CYCLE else None
        return RunOutcome.UNDECIDED if orbit is None else self.add(orbit)

    def _rested(self, start: HybridSystem, run: Run, future: Future | None = None) -> RunOutcome:
        """Keep the state of rest of the first run that settles, or is known to come to one."""
        if self.rest is None:
            end = run.end(start)
            self.rest = future.state if isinstance(future, Rests) else end.x0, end.H0
        return RunOutcome.REST

    def _recognise(self, start: HybridSystem, run: Run, period: float | None) -> RunOutcome | int:
        """Number of the cycle that a run is on at its end."""
        if run.n_kept == 0:
            return RunOutcome.UNDECIDED
        if (known := self._listed(run)) is not None:
            return known
        if period is None:
            return RunOutcome.UNDECIDED
        orbit = orbit_of(self.hybrid, run, period)
        if orbit is not None:
            return self.add(orbit)
        for i, other in enumerate(self.orbits):
            if has_period_of(other, period):  # it only touches a guard, now and then
                return i
        if dwindles(start, run):
            return RunOutcome.UNDECIDED
        return self._reach(start, float(run.stats[0]))

    def _listed(self, run: Run) -> RunOutcome | int | None:
        """The outcome of a run on a cycle that is listed; None on another one."""
        n = self.hybrid.x0.size
        for i, known in enumerate(self.orbits):
            if self._is_on(run, known.arcs.event_sequence.guards, known.starts[1:, :n], known.scale[:n]):
                return i
        for i, r in enumerate(self.reached):
            if r.corners[0].size and self._is_on(run, *r.corners):
                return _outcome_on(i, r)
        return None

    def _is_on(self, run: Run, guards: IntArray, states: Array, scale: Array) -> bool:
        """Whether a run's last event is one of a cycle's: the same guard, in the same state."""
        last, compared = run.order[-1], self.hybrid.compared
        away = np.abs(states[guards == run.guard[last]] - run.state[last])[:, compared]
        return bool(len(away)) and float((away / scale[compared]).max(axis=1).min()) < 1e-3

    def _reach(self, start: HybridSystem, t: float) -> RunOutcome | int:
        """List the cycle that a run is on at time t as the run has it, once it is on it to many digits."""
        for longer in 3.0 ** np.arange(_MOST_LONGER if len(self.reached) < MOST_REACHED else 0):
            run = self._run(start, longer * t)
            status, facts = judge(start, run, longer * t)
            if status is not Status.LIMIT_CYCLE:
                break
            if (known := self._listed(run)) is not None:
                return known
            turn = run.guard[run.order[-int(facts[0]) :]]
            for i, other in enumerate(self.orbits):
                if has_switches_of(other, turn):
                    return i
            if facts[3] < _REACHED:
                # Beside a doubled period the run was not near enough before.
                if (orbit := orbit_of(self.hybrid, run, float(facts[1]))) is not None:
                    return self.add(orbit)
                reached = SimulatedCycle.of(self.system, start, run, facts)
                return RunOutcome.UNCLOSED if reached is None else self.keep(reached)
        return RunOutcome.UNCLOSED

    def keep(self, reached: SimulatedCycle) -> RunOutcome | int:
        """List a cycle as it is, or closed where that comes out; one that is listed already learns its corners."""
        closed = None
        if is_smooth_delayed(self.hybrid) and reached.cycle.method != EXACT_ORBIT:
            closed, _ = closed_behind_delay(self.system, self.hybrid, reached.cycle, self.at)
        cycle = closed or reached.cycle
        for i, known in enumerate(self.reached):
            if cycle.method == known.cycle.method == EXACT_ORBIT and _same(known.cycle, cycle):
                if reached.corners[0].size:
                    self.reached[i] = replace(known, corners=reached.corners)
                return _outcome_on(i, known)
        self.reached.append(replace(reached, cycle=cycle))
        return _outcome_on(len(self.reached) - 1, self.reached[-1])

    def _run(self, start: HybridSystem, t: float) -> Run:
        """A run of the search, without samples."""
        self.n_runs += 1
        run = run_hybrid(start, t, NO_SAMPLES, 2.0 * self.hybrid.time_scale, MOST_EVENTS, 600)
        if self.rest is None and start.model is self.hybrid.model:
            note_modes(self.visited, start, run)
        return run

    def _sizes(self) -> Array:
        """How far the states move on what was predicted and found."""
        n = self.hybrid.x0.size
        size = 1e-9 * np.abs(self.hybrid.x0)
        for ray in self.rays:
            size = np.maximum(size, np.abs(ray[1]))
        for orbit in self.orbits:
            size = np.maximum(size, orbit.scale[:n])
        return size

    def _tell(self) -> None:
        """How far the search is."""
        if self.progress is not None:
            found = f"{self.n_runs} runs, {self.n_boundaries} basin boundaries, {len(self.orbits)} cycles"
            self.progress(self.n_runs, None, f"{self.system.name}: {found}")


def _outcome_on(number: int, reached: SimulatedCycle) -> RunOutcome | int:
    """The outcome of a run on a cycle without an orbit of arcs: below zero the number of a closed one."""
    return -1 - number if reached.cycle.method == EXACT_ORBIT else RunOutcome.UNCLOSED


def _same(one: LimitCycle, other: LimitCycle) -> bool:
    """Whether two closed cycles have the same period, sizes and means."""
    size = one.peak_to_peak
    apart = [abs(one.period / other.period - 1.0)]
    apart += [abs(size[k] - other.peak_to_peak[k]) / size[k] for k in size if size[k] > 0]
    apart += [abs(one.mean[k] - other.mean[k]) / size[k] for k in size if size[k] > 0]
    return max(apart) < _SAME_CYCLE
