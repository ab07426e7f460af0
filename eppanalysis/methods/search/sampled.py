"""All limit cycles of a loop with samples: those locked to them exactly, others as runs have them.

Runs from many states end on stable cycles; of a continuum one is listed. Between starts that end differently the
boundary is bisected, and a run from there stays near the unstable cycle on it. From states on the cycles that are
known, and on predicted ones, orbits of all numbers of samples near are sought by Newton's method: several may exist
side by side.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import islice

import numpy as np

from eppanalysis.arrays import Array, IntArray
from eppanalysis.methods.orbits.samples.locked import (
    LockedOrbit,
    away,
    begun_behind,
    close_locked,
    lengths_near,
    locked_cycle,
    not_among,
    of_one_continuum,
    same_round,
    samples_of,
    starts_on,
)
from eppanalysis.methods.search.outcomes import Look, RunOutcome
from eppanalysis.methods.search.reach import driven_behind_controllers, oscillations_at_reach, reach_of_elements
from eppanalysis.methods.search.result import CycleSearch, exists, undecided
from eppanalysis.methods.search.unmet import MANY, more_of, unmet
from eppanalysis.methods.simulation.budget import Budget, BudgetExceeded, budget, telling
from eppanalysis.methods.simulation.kept import Run
from eppanalysis.methods.simulation.runs import cycle_of_run, judge, run_hybrid
from eppanalysis.methods.simulation.samples import extent_of, is_locked
from eppanalysis.models.systems.hybrid import HybridSystem
from eppanalysis.models.systems.linear import poles, slowest_pole
from eppanalysis.models.systems.lure import LureSystem
from eppanalysis.models.systems.operating import OperatingPoint
from eppanalysis.models.systems.sampled.strobe import Strobe
from eppanalysis.progress import Progress
from eppanalysis.readable import count
from eppanalysis.results import LimitCycle, Status, smallest_first
from eppanalysis.results.provenance import Provenance

#: Whether a cycle that was found is all that is wanted.
Enough = Callable[[LimitCycle], bool]

#: Factors on a predicted oscillation, or on the distance of the start from rest, at which runs are started.
_SCALES = (0.1, 0.3, 0.6, 1.0, 1.6, 3.0)
#: Fewest and most random starts of a draw, sizes of them in parts of where elements begin to matter, draws at most.
_N_RANDOM, _MOST_RANDOM, _SMALLEST, _LARGEST, _DRAWS, _SEED = 16, 200, 0.05, 3.0, 8, 20050901
#: Turns of a predicted cycle in a run, fewest and most samples, how many times as long a run is made, how often.
_TURNS, _FEWEST, _MOST, _FACTOR, _LONGER = 40.0, 400, 40_000, 3.0, 3
#: Samples in which a run that comes to a locked cycle has done so, and repeated it.
_LOCKS = 8000
#: Samples of orbits beside which others of as many samples are sought.
_MIDWAY = 40
#: Starts on a cycle from which orbits of other numbers of samples are sought, and samples in all of those.
_STARTS, _MOST_SOUGHT = 6, 30_000
#: Samples in all runs from the random starts of a draw, in those between starts that end differently, and how often the
#: way between two is halved: a run from there is near what lies between for some turns.
_MOST_DRAWN, _MOST_BETWEEN, _HALVINGS = 100_000, 150_000, 14
#: Turns of the longest known orbit that a run from a boundary is long, and how near it comes back, relative to how far
#: it is from known orbits, where another one is sought.
_STAYS, _RETURNS = 4, 0.1
#: Steps of the engine, and what is worth as many, after which a search ends; the share of them for runs.
_MOST_WORK, _FOR_RUNS = 2e7, 0.5
#: Distance between orbits, in the size of the motion, that is rounding.
_SAME = 1e-7
#: Cycles that are not locked are one where they are as near as this, in logarithms of period and size, and how many
#: times as long a run that must tell the same is: what creeps by less within it is taken for a cycle.
_ALIKE, _LASTS = 0.1, 10.0

#: What a run comes to: the number of a locked orbit, or how else it ends.
OutcomeOrCycle = int | RunOutcome


@dataclass(frozen=True, eq=False)
class Starts:
    """States of a loop as its user has them, and how the runs of a search begin there."""

    loop: LureSystem
    hybrid: HybridSystem  # as it is run
    predicted: Sequence[LimitCycle]
    begun: Callable[[Array, Sequence[object]], HybridSystem]
    #: The user's state of states and memory values as they are run.
    state: Callable[[Array], Array]
    #: Cycles that they may not lead to, in words.
    misses: str = "with small basins"
    #: A cycle as its user has it.
    to_user: Callable[[LimitCycle], LimitCycle] = lambda cycle: cycle

    @property
    def slowest(self) -> float:
        """Rate of the slowest motion of the linear part [1/s]; zero where none is slow."""
        if not self.loop.time_step:
            return slowest_pole(self.loop.A)
        values = poles(self.loop.A).astype(complex)
        rates = np.abs(np.log(values[values != 0.0])) / self.loop.time_step
        return float(rates[rates > 1e-9 * rates.max(initial=0.0)].min(initial=np.inf)) if rates.any() else 0.0

    def given(self) -> list[HybridSystem]:
        """Where elements begin to matter, and predicted cycles, in several sizes."""
        reach = reach_of_elements(self.loop)
        starts = [self.begun(s * reach, ()) for s in _SCALES if np.any(reach)]
        for cycle in self.predicted:
            state = cycle.require_state(reach.size).state
            middle = middle_of(cycle)
            starts += [self.begun(middle + s * (state - middle), cycle.memory) for s in _SCALES]
        return starts

    @cached_property
    def _columns(self) -> Array:
        """States of which random ones are sums: the same in all coordinates."""
        at_reach = oscillations_at_reach(self.loop)[0]
        begun = [c.state - middle_of(c) for c in self.predicted]
        told = np.column_stack([self.loop.x0, *begun, reach_of_elements(self.loop), at_reach.real, at_reach.imag])
        # Behind a controller nothing tells how far a state must go: as far as another one, or one of its units.
        size, moves = np.abs(told).max(axis=1, initial=0.0), np.any(np.hstack([self.loop.A, self.loop.B]), axis=1)
        untold = np.where((size > 0.0) | ~moves, 0.0, size.max(initial=0.0) or 1.0)
        return np.hstack([told, np.diag(untold)[:, untold > 0.0]])

    def random(self, number: int, seed: int) -> list[Array]:
        """Random states, from a twentieth of where elements begin to matter to three times as large.

        As many more where a controller stands before an element: the threshold there says little of the motions that
        its output makes.
        """
        rng = np.random.default_rng(seed)
        size = np.exp(rng.uniform(np.log(_SMALLEST), np.log(_LARGEST), (number, 1)))
        noise = rng.normal(size=(number, self._columns.shape[1]))
        states = size * noise / np.sqrt(self._columns.shape[1]) @ self._columns.T
        driven = driven_behind_controllers(self.loop)
        columns = np.hstack([driven.real, driven.imag])
        more = number if columns.size else 0
        far = size[:more] * rng.normal(size=(more, columns.shape[1])) @ columns.T
        return [*states, *far]


def middle_of(cycle: LimitCycle) -> Array:
    """Where starts of other sizes are made about: the mean of a cycle, or the origin where that is not known."""
    return cycle.mean_state if cycle.mean_state.size == cycle.state.size else np.zeros(cycle.state.size)


@dataclass
class SampledSearch:
    """State of one search; lives for one call."""

    system: LureSystem  # as it is run
    strobe: Strobe
    starts: Starts
    progress: Progress | None = None
    enough: Enough | None = None
    rounds: list[LockedOrbit] = field(default_factory=list)
    others: list[LimitCycle] = field(default_factory=list)
    extents: list[Array] = field(default_factory=list)
    ends: Counter[RunOutcome] = field(default_factory=Counter)
    lengths: set[int] = field(default_factory=set)
    rest: HybridSystem | None = None  # begun at the state of rest of the first run that settles
    begun: list[tuple[Array, OutcomeOrCycle]] = field(default_factory=list)
    boundaries: int = 0
    refused: int = 0
    work: Budget = field(default_factory=lambda: Budget(_MOST_WORK))
    ended: bool = False
    stopped: bool = False

    def run_all(self) -> None:
        """Runs, boundaries between their starts, then orbits of other numbers of samples."""
        with budget(_MOST_WORK) as self.work:
            try:
                with budget(_FOR_RUNS * _MOST_WORK):
                    if self._runs() or self._between() or self._mirrored():
                        return
            except BudgetExceeded:
                self.ended = True
            try:
                self._seek()
            except BudgetExceeded:
                self.ended = True

    def _runs(self) -> bool:
        """Runs from the loop's own start and from others, more while cycles are met once; whether one is enough."""
        for start in (self.hybrid, *self.starts.given()):
            self.outcome(start)
            if self.stopped:
                return True
        number = int(np.clip(_MOST_DRAWN // self.strobe.samples_in(self.horizon), _N_RANDOM, _MOST_RANDOM))
        for draw in range(_DRAWS):
            drawn = self.starts.random(number, _SEED + draw)
            for k, state in enumerate(drawn):
                self._say(k, len(drawn), f"run {k + 1} of {len(drawn)}")
                self.begun.append((state, self.outcome(self.starts.begun(state, ()))))
                if self.stopped:
                    return True
            if self.unmet < MANY:
                break
        for start in self._from_rest():
            self.outcome(start)
            if self.stopped:
                return True
        return False

    @property
    def hybrid(self) -> HybridSystem:
        """The loop as it is run, begun at its own start."""
        return self.starts.hybrid

    @property
    def suffices(self) -> bool:
        """Whether a cycle that was found is all that is wanted."""
        return self.enough is not None and any(self.enough(self.starts.to_user(cycle)) for cycle in self.cycles())

    @property
    def unmet(self) -> float:
        """At least how many cycles more there probably are that runs end on; a continuum counts as one cycle."""
        met = Counter(on for _, on in self.begun if not isinstance(on, RunOutcome))
        return unmet(n for on, n in met.items() if not self.rounds[on].one_of_many)

    def outcome(self, start: HybridSystem) -> OutcomeOrCycle:
        """What a run from a start comes to; the cycle that it ends on is kept."""
        before = len(self.rounds) + len(self.others)
        end, on = self.end_of(start)
        self.ends[end] += 1
        new = len(self.rounds) + len(self.others) > before
        self.stopped = new and self.suffices
        return end if on is None else on

    def cycles(self) -> list[LimitCycle]:
        """Those found."""
        closed = [locked_cycle(self.system, orbit) for orbit in self.rounds]
        return [*closed, *(c for c in self.others if not any(_stands_for(orbit, c) for orbit in closed))]

    def _say(self, done: int, of: int | None, doing: str) -> None:
        if self.progress is not None:
            found = count(len(self.rounds) + len(self.others), "cycle")
            self.progress(done, of, f"{self.system.name}: {doing}, {found}")

    @cached_property
    def horizon(self) -> float:
        """How long a run is before it is judged for the first time [s]."""
        T = self.strobe.controllers[0].sample_time
        turn, slow = max((c.period for c in self.starts.predicted), default=0.0), self.starts.slowest
        want = _TURNS * turn if turn else 30.0 / slow if slow else 0.0
        return float(np.clip(want, _FEWEST * T, _MOST * T))

    def end_of(self, start: HybridSystem) -> tuple[RunOutcome, int | None]:
        """How a run from a start ends, and on which of the locked orbits."""
        *_, last = islice(self.looks(start, self.horizon), _LONGER)
        on = last.outcome
        return (on, None) if isinstance(on, RunOutcome) else (RunOutcome.CYCLE, on)

    def looks(self, start: HybridSystem, t: float) -> Iterator[Look]:
        """What a motion has come to: runs three times as long each, from t [s] on, until one has come to something."""
        while True:
            run, status, found = self._judged(start, t)
            # Turns that differ may be on their way to a locked cycle, or parts of one of several turns.
            may_lock = status is Status.LIMIT_CYCLE and not is_locked(found) and self.strobe.samples_in(t) < _LOCKS
            if not may_lock and (end := self._come_to(start, run, status, found)) is not None:
                outcome, on = end
                yield Look(t, outcome if on is None else on)
                return
            yield Look(t, RunOutcome.OUT_OF_EVENTS if status is Status.EVENT_LIMIT else RunOutcome.UNDECIDED)
            # One that has run away passes more edges of its encoder than a longer run has events for.
            if status is Status.EVENT_LIMIT and _FACTOR * run.stats[0] < t:
                return
            t *= _FACTOR

    def _come_to(
        self, start: HybridSystem, run: Run, status: Status, found: Array
    ) -> tuple[RunOutcome, int | None] | None:
        """What a run has come to; None where it is on its way."""
        if status is Status.SETTLED:
            self.rest = self.rest or self._rest_of(run)
            return RunOutcome.REST, None
        if status is Status.DIVERGED:
            return RunOutcome.DIVERGENCE, None
        return self._keep(start, run, found) if status is Status.LIMIT_CYCLE else None

    def _rest_of(self, run: Run) -> HybridSystem:
        """The loop at the end of a run, its clock turned back."""
        last = run.order[-1]
        return self.strobe.begun(run.x_end, run.memory_values[last], run.modes[last])

    def _from_rest(self) -> list[HybridSystem]:
        """From the state of rest that is known, where a setpoint or a load moves it; other starts lie about zero."""
        reach, rest = reach_of_elements(self.starts.loop), self.rest
        zero = self.starts.begun(0.0 * reach, ())
        loop = self.starts.loop
        if rest is None or not any(map(np.any, (zero.x0[zero.n_plant :], loop.constant_state, loop.constant_input))):
            return []
        moved = self.starts.begun(reach, ()).x0 - zero.x0
        return [rest.at(rest.x0 + s * moved, rest.H0, rest.modes0) for s in _SCALES if np.any(moved)]

    def _judged(self, start: HybridSystem, t: float, n_kept: int | None = None) -> tuple[Run, Status, Array]:
        """A run of so long, of which so many events are kept, and what it says of itself."""
        most = self.strobe.samples_in(t) + 20_000
        step = 2.0 * self.hybrid.time_scale
        run = run_hybrid(start, t, np.zeros(0), step, most, most if n_kept is None else n_kept)
        return run, *judge(start, run, t)

    def _keep(self, start: HybridSystem, run: Run, found: Array) -> tuple[RunOutcome, int | None]:
        if is_locked(found) and not self.strobe.forgets:
            n = round(found[1] / self.strobe.period)
            begin = next(starts_on(self.strobe, run, n, 1))
            known = self._known(begin, n, float(found[3]))
            if known is not None:
                return RunOutcome.CYCLE, known
            orbit = close_locked(self.strobe, begin, n)
            return (RunOutcome.UNDECIDED, None) if orbit is None else (RunOutcome.CYCLE, self._add(orbit))
        # The period of a slow cycle has ten thousand samples: its harmonics take ten times as long as the run.
        met = self._is_met(run, found)
        if (on := self._on_its_way(run, float(found[2]), met)) is not None:
            return RunOutcome.CYCLE, on
        if met:
            return RunOutcome.OF_RUNS, None
        if not is_locked(found):
            # No closing tells of turns that differ whether they creep to another size: many times as long a run does.
            longer = self._judged(start, _LASTS * float(run.time[run.order[-1]]), run.n_kept)
            if longer[1] is not Status.LIMIT_CYCLE or is_locked(longer[2]):
                return self._come_to(start, *longer) or (RunOutcome.UNDECIDED, None)
            if not _are_alike(extent_of(self.strobe, run, found), extent_of(self.strobe, longer[0], longer[2])):
                return RunOutcome.UNDECIDED, None
        facts = Provenance("event-exact simulation", {"system": self.system.name})
        cycle = cycle_of_run(self.system, start, run, found, facts)
        if cycle is None:
            return RunOutcome.UNDECIDED, None
        self.extents.append(extent_of(self.strobe, run, found))
        if not any(away(cycle, known) < _ALIKE for known in self.others):
            self.others.append(cycle)
        return RunOutcome.OF_RUNS, None

    def _on_its_way(self, run: Run, differs: float, met: bool) -> int | None:
        """The stable locked orbit to which a run comes whose turns still differ so much; None for none.

        Where its motion has been `met` and is listed, its turns have closed on none already.
        """
        if not self.strobe.closes:
            return None
        samples, rows = self._at_samples(run)
        for k, orbit in enumerate(self.rounds):
            if _comes_to(rows, orbit, differs):
                return k
        if met or self.refused == _STARTS or len(rows) < 6:  # what has closed on none so often fills a curve
            return None
        size = np.ptp(rows, axis=0)
        back = np.abs(rows[-3 : -len(rows) // 2 : -1] - rows[-1]) / np.where(size > 0.0, size, np.inf)
        n = 2 + int(np.argmin(back.max(axis=1)))
        closed = close_locked(self.strobe, begun_behind(self.strobe, run, samples[-1]), n)
        if closed is None or not _comes_to(rows, closed, differs):
            self.refused += 1
            return None
        self.refused = 0
        return self._add(closed)

    def _at_samples(self, run: Run) -> tuple[IntArray, Array]:
        """Places of the samples of a run, and what repeats there, shape (samples, m)."""
        samples = samples_of(self.strobe, run)
        return samples, np.hstack([run.state[samples], run.memory_values[samples]])[:, self.strobe.free]

    def _is_met(self, run: Run, found: Array) -> bool:
        """Whether a run is on a cycle that is not locked and is listed."""
        extent = extent_of(self.strobe, run, found)
        return any(_are_alike(extent, known) for known in self.extents)

    def _known(self, begin: HybridSystem, n: int, to_come: float) -> int | None:
        """The known orbit that a run of n samples a turn is on, but for its changes still to come."""
        y = np.append(begin.x0, begin.H0)[self.strobe.free]
        for k, orbit in enumerate(self.rounds):
            away = np.max(np.abs(orbit.at_samples - y) / orbit.scale, axis=1)
            if orbit.n == n and np.min(away) <= _SAME + 2.0 * to_come:
                return k
        return None

    def _add(self, orbit: LockedOrbit) -> int:
        """The place of an orbit among those listed, one for each continuum."""
        for k, known in enumerate(self.rounds):
            if same_round(known, orbit) or of_one_continuum(known, orbit):
                return k
        self.rounds.append(orbit)
        return len(self.rounds) - 1

    def _between(self) -> bool:
        """Boundaries between starts that have ended differently, and whether a cycle met there is enough.

        Small basins lie along the boundaries of large ones, where a run from a random start seldom comes, and unstable
        cycles on them.
        """
        rng = np.random.default_rng(_SEED)
        self._left = _MOST_BETWEEN // self.strobe.samples_in(self.horizon)
        ended = [start for start in self.begun if start[1] not in (RunOutcome.UNDECIDED, RunOutcome.OUT_OF_EVENTS)]
        while self._left > 0 and len({on for _, on in ended}) > 1:
            self._say(self.boundaries, None, "boundaries between starts of different ends")
            (a, on_a), (b, on_b) = (ended[k] for k in rng.choice(len(ended), 2, replace=False))
            self._left -= 1
            if on_a != on_b and self._bisect(a, on_a, b):
                return True
        return False

    def _bisect(self, a: Array, on_a: OutcomeOrCycle, b: Array) -> bool:
        """Halve the way between two starts that end differently, and close the orbit there; whether it is enough."""
        for _ in range(_HALVINGS):
            self._left -= 1
            middle = 0.5 * (a + b)
            on = self.outcome(self.starts.begun(middle, ()))
            if self.stopped:
                return True
            if on == on_a:
                a = middle
            else:
                b = middle
        self.boundaries += 1
        if self.strobe.closes:
            orbit = self._on_boundary(self.starts.begun(a, ()))
            if orbit is not None:
                self._add(orbit)
                self.stopped = self.suffices
        return self.stopped

    def _on_boundary(self, start: HybridSystem) -> LockedOrbit | None:
        """The orbit near which a run from a boundary stays for a while: where it returns, and not to a known one."""
        longest = max((orbit.n for orbit in self.rounds), default=1)
        run, *_ = self._judged(start, max(self.horizon, _STAYS * longest * self.strobe.period))
        samples, rows = self._at_samples(run)
        size = np.ptp(rows, axis=0)
        size = np.where(size > 0.0, size, np.inf)
        beside, moving = np.ones(len(rows)), np.isfinite(size)
        if self.rounds:
            known = np.concatenate([orbit.at_samples for orbit in self.rounds])
            beside = _nearest((known / size)[:, moving], (rows / size)[:, moving])[0]
        tries, floor = 0, np.maximum(beside, np.finfo(float).tiny)
        for n in range(1, len(rows) // 2):
            if tries == _STARTS:
                break
            back = np.max(np.abs(rows[n:] - rows[:-n]) / size, axis=1)
            place = int(np.argmin(back / floor[:-n]))
            if back[place] < _RETURNS * beside[place]:
                orbit = close_locked(self.strobe, begun_behind(self.strobe, run, samples[place]), n)
                if orbit is not None:
                    return orbit
                tries += 1
        return None

    def _mirrored(self) -> bool:
        """Runs from the images of all orbits about rest, which a symmetric loop has too, and whether one is enough."""
        free, n = self.strobe.free, self.hybrid.x0.size
        for orbit in list(self.rounds):
            y = orbit.rows[0].copy()
            y[free] *= -1.0
            if self.rest is not None:
                y[free] += 2.0 * np.append(self.rest.x0, self.rest.H0)[free]
            self.outcome(self.strobe.begun(y[:n], y[n:], orbit.start.modes0))
            if self.stopped:
                return True
        return False

    def _seek(self) -> None:
        """Orbits between those known, and of all numbers of samples near those known and predicted."""
        if not self.strobe.closes:
            return
        self._seek_midway()
        of_each = {o.n: o for o in reversed(self.rounds)}  # of as many samples others are near, or mirror images
        seeds = [
            (n, [o.strobe.begun(*self._split(o, k), o.start.modes0) for k in self._spread(o)])
            for n, o in of_each.items()
        ]
        for cycle in self.starts.predicted:
            begin = self.starts.begun(cycle.state, cycle.memory)
            run, *_ = self._judged(begin, 2.5 * cycle.period + self.strobe.period)
            n = max(round(cycle.period / self.strobe.period), 1)
            seeds.append((n, list(starts_on(self.strobe, run, n, _STARTS))))
        for length, starts in seeds:
            # Each cycle has its share of all samples: a long one would take what is there for the others.
            left = _MOST_SOUGHT // max(len(seeds), 1)
            size = np.max([o.motion for o in self.rounds], axis=0) if self.rounds else None
            for n in lengths_near(length):
                left -= n * len(starts)
                if left < 0:
                    break
                self.lengths.add(n)
                self._say(len(self.lengths), None, f"orbits of {n} samples")
                for start in starts:
                    orbit = close_locked(self.strobe, start, n, size)
                    if orbit is not None:
                        self._add(orbit)

    def _seek_midway(self) -> None:
        """Orbits midway between neighbouring samples of those known: on a curve unstable ones lie between stable."""
        alike: dict[int, list[LockedOrbit]] = {}
        for orbit in self.rounds:
            if not orbit.one_of_many:  # between those of a continuum lie its others
                alike.setdefault(orbit.n, []).append(orbit)
        for n, orbits in alike.items():
            rows = np.concatenate([orbit.at_samples[:-1] for orbit in orbits])
            size = np.max([orbit.scale for orbit in orbits], axis=0)
            near = _nearest(rows / size, rows / size, min(3, len(rows)))[1]
            spread = np.unique(np.linspace(0, len(rows) - 1, min(_MIDWAY, len(rows))).astype(int))
            for one, other in ((k, other) for k in spread.tolist() for other in near[k, 1:]):
                begun = orbits[one // n].begun_at(0.5 * (rows[one] + rows[other]))
                found = close_locked(self.strobe, begun, n, size)
                if found is not None:
                    self._add(found)

    def _spread(self, orbit: LockedOrbit) -> list[int]:
        """Places of some samples of an orbit, evenly spread."""
        places = np.append(0, np.flatnonzero(orbit.run.guard[: orbit.last] == self.strobe.guard) + 1)
        places = places[:: self.strobe.every]
        return places[np.unique(np.linspace(0, places.size - 1, min(_STARTS, places.size)).astype(int))].tolist()

    def _split(self, orbit: LockedOrbit, k: int) -> tuple[Array, Array]:
        n = self.hybrid.x0.size
        return orbit.rows[k, :n], orbit.rows[k, n:]

    def sentence(self) -> str:
        """How completeness was sought."""
        ends = ", ".join(f"{n} {what}" for what, n in sorted(self.ends.items()))
        between = ", and from states between these," * (len(self.rounds) > 1)
        rest = " and states about rest" * bool(self._from_rest())
        text = f"{sum(self.ends.values())} runs from predicted and random states{rest}{between} ({ends}); "
        if self.lengths:
            text += (
                f"orbits that are locked to the samples were sought by Newton's method at {min(self.lengths)} to "
                f"{max(self.lengths)} times {self.strobe.period:g} s, near the known ones."
            )
        else:
            text += "no cycle gave a start for orbits that are locked to the samples."
        if self.boundaries:
            text += (
                f" {count(self.boundaries, 'boundary').capitalize()} between starts with different outcomes were "
                "bisected."
            )
        if self.others:
            text += (
                " Cycles that are not locked to the samples, and those through a dead time, are listed from runs, "
                "stable ones only."
            )
        if self.ends[RunOutcome.UNDECIDED]:
            text += " Motions of runs that neither settle nor repeat themselves may fill a curve."
        text += " The search was stopped early." * self.ended
        return text + " It ended at the first cycle that was enough." * self.stopped


def _nearest(points: Array, rows: Array, most: int = 1) -> tuple[Array, IntArray]:
    """Distances from rows to their nearest points, in the largest of all places, and which points they are."""
    from scipy.spatial import KDTree  # loads long, and few searches need it

    away, which = KDTree(points).query(rows, k=most, p=np.inf)
    return np.asarray(away), np.asarray(which)


def _comes_to(rows: Array, orbit: LockedOrbit, differs: float) -> bool:
    """Whether samples (k, m) of a run come ever nearer to a stable orbit, and are as near as its turns differ."""
    n = orbit.n
    if not orbit.is_stable or len(rows) < 2 * n:
        return False
    turns = [rows[end - n : end] for end in np.linspace(max(len(rows) // 2, n), len(rows), 3).astype(int)]
    far = [float(np.max(_nearest(orbit.at_samples / orbit.scale, turn / orbit.scale)[0])) for turn in turns]
    return far[2] < far[1] < far[0] and far[2] <= differs


def _are_alike(one: Array, other: Array) -> bool:
    """Whether two motions that are not locked are one, by what :func:`extent_of` has of them."""
    return bool(abs(one[0] - other[0]) + np.abs(one - other)[1:].max() < _ALIKE)


def _stands_for(orbit: LimitCycle, motion: LimitCycle) -> bool:
    """Whether a stable orbit of one or several turns is a motion that a run has, as far as that tells of it."""
    near, turns = motion.error_estimate, orbit.period / motion.period
    alike = abs(turns - round(turns)) <= near * turns and round(turns) > 0
    return (
        alike
        and bool(orbit.stable)
        and all(abs(orbit.peak_to_peak[k] - y) <= near * y for k, y in motion.peak_to_peak.items())
    )


def search_sampled(
    system: LureSystem,
    starts: Starts,
    at: OperatingPoint,
    progress: Progress | None = None,
    enough: Enough | None = None,
) -> CycleSearch:
    """All cycles of a loop with samples that runs and predictions lead to, or the first that is enough."""
    search = _search(system, starts, enough, progress)
    search.run_all()
    return _result(search, at)


def _search(
    system: LureSystem, starts: Starts, enough: Enough | None, progress: Progress | None = None
) -> SampledSearch:
    strobe = Strobe.of(starts.hybrid)
    assert strobe is not None
    return SampledSearch(system, strobe, starts, progress, enough)


def search_near(system: LureSystem, starts: Starts, at: OperatingPoint, enough: Enough) -> CycleSearch | None:
    """What runs from cycles that are known at another value end on, where one of these is enough; else None."""
    search = _search(system, starts, enough)
    for cycle in starts.predicted:
        search.outcome(starts.begun(cycle.state, cycle.memory))
        if search.stopped:
            return _result(search, at)
    return None


def _result(search: SampledSearch, at: OperatingPoint) -> CycleSearch:
    system = search.system
    with telling():
        cycles = search.cycles()
    unclosed = () if search.stopped else not_among(cycles, search.starts.predicted)
    open_runs = search.ends[RunOutcome.UNDECIDED]
    left = [undecided(open_runs)] * bool(open_runs) + [
        f"the search ended when it had taken {_MOST_WORK:.0e} steps"
    ] * search.ended
    left += more_of("cycles that runs end on", search.unmet)
    if used_up := search.ends[RunOutcome.OUT_OF_EVENTS]:
        left.append(f"{count(used_up, 'run')} had used up all events before anything settled or repeated itself")
    rest = search.rest
    return CycleSearch(
        cycles=tuple(replace(c, operating_point=at) for c in smallest_first(cycles)),
        status=Status.UNDECIDED if left or any(map(exists, unclosed)) else Status.CONVERGED,
        settles=search.ends[RunOutcome.REST] > 0,
        diverges=search.ends[RunOutcome.DIVERGENCE] > 0,
        search=search.sentence(),
        not_covered=f"Cycles {search.starts.misses} may be missed",
        rest_state=np.zeros(0) if rest is None else search.starts.state(np.append(rest.x0, rest.H0)),
        unclosed=unclosed,
        left_open=tuple(left),
        n_continua=sum(o.one_of_many for o in search.rounds),
        n_runs=sum(search.ends.values()),
        provenance=Provenance(
            "search for limit cycles",
            {"system": system.name},
            {},
            {**{str(end): n for end, n in search.ends.items()}, "work": search.work.used},
        ),
        operating_point=at,
    )
