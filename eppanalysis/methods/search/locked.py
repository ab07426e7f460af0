"""All limit cycles of a loop with sampled controllers: those locked to the samples exactly, others as runs have them.

Runs from many states, and from states between those that end differently, end on stable cycles; of a continuum one is
listed. From states on the cycles that are known, and on predicted ones, orbits of all numbers of samples near are
sought by Newton's method, stable and unstable: several may exist side by side.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from eppanalysis.arrays import Array
from eppanalysis.methods.orbits.samples.locked import (
    Round,
    away,
    close_locked,
    lengths_near,
    locked_cycle,
    not_among,
    of_one_continuum,
    same_round,
    starts_on,
)
from eppanalysis.methods.search.ends import End
from eppanalysis.methods.search.reach import reach_of_elements
from eppanalysis.methods.search.result import CycleSearch, exists, undecided
from eppanalysis.methods.search.unmet import more_of, unmet
from eppanalysis.methods.simulation.effort import Spent, allotted
from eppanalysis.methods.simulation.kept import Run
from eppanalysis.methods.simulation.samples import extent_of
from eppanalysis.methods.simulation.simulate import cycle_of_run, judge, run_hybrid
from eppanalysis.models.systems.hybrid import HybridSystem
from eppanalysis.models.systems.linear import slowest_pole
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
#: Fewest and most random starts, and of every other one the smallest size in parts of the largest predicted one.
_N_RANDOM, _MOST_RANDOM, _SMALLEST, _SEED = 16, 128, 0.05, 20050901
#: Turns of a predicted cycle in a run, fewest and most samples, how many times as long a run is made, how often.
_TURNS, _FEWEST, _MOST, _FACTOR, _LONGER = 40.0, 400, 40_000, 3.0, 3
#: Starts on a cycle from which orbits of other numbers of samples are sought, and samples in all of those.
_STARTS, _MOST_SOUGHT = 6, 30_000
#: Samples in all runs from random starts beyond the fewest, in those between starts that end on different orbits, and
#: how often the way between two is halved.
_MOST_MORE, _MOST_BETWEEN, _HALVINGS = 50_000, 100_000, 8
#: Steps of the engine, and what is worth as many, after which a search ends.
_MOST_WORK = 2e7
#: Cycles that are not locked are one where they are as near as this, in logarithms of period and size.
_ALIKE = 0.1


@dataclass
class SampledSearch:
    """State of one search; lives for one call."""

    system: LureSystem
    hybrid: HybridSystem
    strobe: Strobe
    predicted: Sequence[LimitCycle]
    progress: Progress | None = None
    enough: Enough | None = None
    rounds: list[Round] = field(default_factory=list)
    others: list[LimitCycle] = field(default_factory=list)
    extents: list[Array] = field(default_factory=list)
    ends: Counter[End] = field(default_factory=Counter)
    lengths: set[int] = field(default_factory=set)
    rest: Array = field(default_factory=lambda: np.zeros(0))
    begun: list[tuple[Array, int]] = field(default_factory=list)
    on: int | None = None
    ended: bool = False
    stopped: bool = False

    def run_all(self) -> None:
        """Runs, then orbits of other numbers of samples."""
        try:
            with allotted(_MOST_WORK):
                starts = self.starts()
                for k, start in enumerate(starts):
                    self._say(k, len(starts), f"run {k + 1} of {len(starts)}")
                    if self.suffices(start):
                        return
                if not (self._between() or self._mirrored()):
                    self._seek()
        except Spent:
            self.ended = True

    def suffices(self, start: HybridSystem) -> bool:
        """Whether a run from a start ends on a cycle that is all that is wanted."""
        before = len(self.rounds) + len(self.others)
        self.on = None
        self.ends[self.end_of(start)] += 1
        if self.on is not None:
            self.begun.append((start.x0[: self.hybrid.n_plant], self.on))
        new = len(self.rounds) + len(self.others) > before
        self.stopped = new and self.enough is not None and any(map(self.enough, self.cycles()))
        return self.stopped

    def cycles(self) -> list[LimitCycle]:
        """Those found."""
        return [*(locked_cycle(self.system, o) for o in self.rounds), *self.others]

    def _say(self, done: int, of: int | None, doing: str) -> None:
        if self.progress is not None:
            found = count(len(self.rounds) + len(self.others), "cycle")
            self.progress(done, of, f"{self.system.name}: {doing}, {found}")

    @property
    def horizon(self) -> float:
        """How long a run is before it is judged for the first time [s]."""
        T = self.strobe.controllers[0].sample_time
        turn, slow = max((c.period for c in self.predicted), default=0.0), slowest_pole(self.system.A)
        want = _TURNS * turn if turn else 30.0 / slow if slow else 0.0
        return float(np.clip(want, _FEWEST * T, _MOST * T))

    def starts(self) -> list[HybridSystem]:
        """The loop's own start, predicted cycles in several sizes, and random states of their size."""
        n, own = self.hybrid.n_plant, self.hybrid.x0
        sizes = [np.abs(own[:n]), np.abs(reach_of_elements(self.system))]
        starts = [self.hybrid]
        starts += [self._at(s * sizes[1]) for s in _SCALES if np.any(sizes[1])]
        for cycle in self.predicted:
            centre = cycle.mean_state if cycle.mean_state.size == n else np.zeros(n)
            for s in _SCALES:
                begun = self.hybrid.begun(centre + s * (cycle.state - centre), cycle.memory)
                starts.append(begun)
            sizes.append(np.abs(cycle.state - centre))
        size = np.max(sizes, axis=0)
        size = np.where(size > 0.0, size, size.max(initial=0.0) or 1.0)
        rng = np.random.default_rng(_SEED)
        more = _MOST_MORE // self.strobe.samples_in(self.horizon)
        draws = size * rng.uniform(-1.5, 1.5, (int(np.clip(more, _N_RANDOM, _MOST_RANDOM)), n))
        draws[1::2] *= np.exp(rng.uniform(np.log(_SMALLEST), 0.0, (len(draws) // 2, 1)))
        return starts + [self._at(draw) for draw in draws]

    def _at(self, state: Array) -> HybridSystem:
        x = self.hybrid.x0.copy()
        x[: self.hybrid.n_plant] = state
        x[self.strobe.clock] = 0.0
        return replace(self.hybrid, x0=x)

    def end_of(self, start: HybridSystem) -> End:
        """What a run from a start comes to; the cycle that it ends on is kept."""
        t = self.horizon
        for _ in range(_LONGER):
            run = self._run(start, t)
            status, found = judge(start, run, t)
            if status is Status.SETTLED:
                self.rest = run.x_end[: start.n_plant] if not self.rest.size else self.rest
                return End.REST
            if status is Status.DIVERGED:
                return End.DIVERGENCE
            if status is Status.LIMIT_CYCLE:
                return self._keep(start, run, found)
            # One that has run away passes more edges of its encoder than a longer run has events for.
            if status is Status.EVENT_LIMIT and _FACTOR * run.stats[0] < t:
                break
            t *= _FACTOR
        return End.OUT_OF_EVENTS if status is Status.EVENT_LIMIT else End.UNDECIDED

    def _run(self, start: HybridSystem, t: float) -> Run:
        most = self.strobe.samples_in(t) + 20_000
        return run_hybrid(start, t, np.zeros(0), 2.0 * self.hybrid.time_scale, most, most)

    def _keep(self, start: HybridSystem, run: Run, found: Array) -> End:
        if not found[5] and not self.strobe.forgets:
            n = round(found[1] / self.strobe.period)
            begin = next(starts_on(self.strobe, run, n, 1))
            orbit = close_locked(self.strobe, begin, n)
            if orbit is None:
                return End.UNDECIDED
            self.on = self._add(orbit)
            return End.CYCLE
        # The period of a slow cycle has ten thousand samples: its harmonics take ten times as long as the run.
        extent = extent_of(self.hybrid.compared, run, found)
        if any(np.abs(extent[0] - known[0]) + np.abs(extent - known)[1:].max() < _ALIKE for known in self.extents):
            return End.OF_RUNS
        facts = Provenance("event-exact simulation", {"system": self.system.name})
        cycle = cycle_of_run(self.system, start, run, found, facts)
        if cycle is None:
            return End.UNDECIDED
        self.extents.append(extent)
        if not any(away(cycle, known) < _ALIKE for known in self.others):
            self.others.append(cycle)
        return End.OF_RUNS

    def _add(self, orbit: Round) -> int:
        """The place of an orbit among those listed, one for each continuum."""
        for k, known in enumerate(self.rounds):
            if same_round(known, orbit) or of_one_continuum(known, orbit):
                return k
        self.rounds.append(orbit)
        return len(self.rounds) - 1

    def _between(self) -> bool:
        """Runs from starts midway between some that have ended on different orbits, and whether one is enough.

        Small basins lie along the boundaries of large ones, where a run from a random start seldom comes.
        """
        rng = np.random.default_rng(_SEED)
        left = _MOST_BETWEEN // self.strobe.samples_in(self.horizon)
        while left > 0 and len(self.rounds) > 1:
            self._say(len(self.begun), None, "runs between starts of different ends")
            (a, on_a), (b, on_b) = (self.begun[k] for k in rng.choice(len(self.begun), 2, replace=False))
            left -= 1
            for _ in range(_HALVINGS * (on_a != on_b)):
                left -= 1
                middle = 0.5 * (a + b)
                if self.suffices(self._at(middle)):
                    return True
                if self.on is None:
                    break
                a, on_b, b = (middle, on_b, b) if self.on == on_a else (a, self.on, middle)
        return False

    def _mirrored(self) -> bool:
        """Runs from the images of all orbits about rest, which a symmetric loop has too, and whether one is enough."""
        free, n = self.strobe.free, self.hybrid.x0.size
        for orbit in self.rounds:
            y = orbit.rows[0].copy()
            y[free] *= -1.0
            moved = free[free < self.rest.size]
            y[moved] += 2.0 * self.rest[moved]
            if self.suffices(self.strobe.begun(y[:n], y[n:], orbit.start.modes0)):
                return True
        return False

    def _seek(self) -> None:
        """Orbits of all numbers of samples near those known and predicted."""
        if self.strobe.forgets or not self.strobe.every:
            return
        seeds = [
            (o.n, [o.strobe.begun(*self._split(o, k), o.start.modes0) for k in self._spread(o)]) for o in self.rounds
        ]
        for cycle in self.predicted:
            run = self._run(self.hybrid.begun(cycle.state, cycle.memory), 2.5 * cycle.period + self.strobe.period)
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

    def _spread(self, orbit: Round) -> list[int]:
        """Places of some samples of an orbit, evenly spread."""
        places = np.append(0, np.flatnonzero(orbit.run.guard[: orbit.last] == self.strobe.guard) + 1)
        places = places[:: self.strobe.every]
        return places[np.unique(np.linspace(0, places.size - 1, min(_STARTS, places.size)).astype(int))].tolist()

    def _split(self, orbit: Round, k: int) -> tuple[Array, Array]:
        n = self.hybrid.x0.size
        return orbit.rows[k, :n], orbit.rows[k, n:]

    def sentence(self) -> str:
        """How completeness was sought."""
        ends = ", ".join(f"{n} {what}" for what, n in sorted(self.ends.items()))
        between = ", and from states between these," * (len(self.rounds) > 1)
        text = f"{sum(self.ends.values())} runs from predicted and random states{between} ({ends}); "
        if self.lengths:
            text += (
                f"orbits that are locked to the samples were sought by Newton's method at {min(self.lengths)} to "
                f"{max(self.lengths)} times {self.strobe.period:g} s, near the known ones."
            )
        else:
            text += "no cycle gave a start to seek orbits from that are locked to the samples."
        if self.others:
            text += (
                " Cycles that are not locked to the samples, and those through a dead time, are listed as runs have "
                "them, stable ones only."
            )
        text += " The search ended before it had come to its end." * self.ended
        return text + " It ended at the first cycle that was enough." * self.stopped


def search_locked(
    system: LureSystem,
    hybrid: HybridSystem,
    strobe: Strobe,
    at: OperatingPoint,
    predicted: Sequence[LimitCycle],
    progress: Progress | None = None,
    enough: Enough | None = None,
) -> CycleSearch:
    """All cycles of a loop with sampled controllers that runs and predictions lead to, or the first that is enough."""
    search = SampledSearch(system, hybrid, strobe, predicted, progress, enough)
    search.run_all()
    return _result(search, at)


def search_near(
    system: LureSystem, hybrid: HybridSystem, at: OperatingPoint, known: Sequence[LimitCycle], enough: Enough
) -> CycleSearch | None:
    """What runs from cycles that are known at another value end on, where one of these is enough; else None."""
    strobe = Strobe.of(hybrid)
    assert strobe is not None
    search = SampledSearch(system, hybrid, strobe, known, enough=enough)
    found = any(search.suffices(hybrid.begun(cycle.state, cycle.memory)) for cycle in known)
    return _result(search, at) if found else None


def _result(search: SampledSearch, at: OperatingPoint) -> CycleSearch:
    system = search.system
    cycles = search.cycles()
    unclosed = () if search.stopped else not_among(cycles, search.predicted)
    open_runs = search.ends[End.UNDECIDED]
    left = [undecided(open_runs)] * bool(open_runs) + ["the search took too many steps"] * search.ended
    left += more_of("cycles that runs end on", unmet(Counter(on for _, on in search.begun).values()))
    if used_up := search.ends[End.OUT_OF_EVENTS]:
        left.append(f"{count(used_up, 'run')} had used up all events before anything settled or repeated itself")
    return CycleSearch(
        cycles=tuple(replace(c, operating_point=at) for c in smallest_first(cycles)),
        status=Status.UNDECIDED if left or any(map(exists, unclosed)) else Status.CONVERGED,
        settles=search.ends[End.REST] > 0,
        diverges=search.ends[End.DIVERGENCE] > 0,
        search=search.sentence(),
        not_covered="Cycles that small basins or only other contents of the controllers' memory lead to may be missed",
        rest_state=search.rest,
        unclosed=unclosed,
        left_open=tuple(left),
        n_continua=sum(o.one_of_many for o in search.rounds),
        n_runs=sum(search.ends.values()),
        provenance=Provenance(
            "search for limit cycles", {"system": system.name}, {}, {str(end): n for end, n in search.ends.items()}
        ),
        operating_point=at,
    )
