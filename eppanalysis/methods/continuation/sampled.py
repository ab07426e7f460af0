"""Branches of limit cycles of loops with sampled controllers: at one number of samples until they cease, then on.

A cycle that is locked to the samples is a fixed point of the map over its number of samples; Newton's method carries it
from value to value. Where none is found the step is halved, until the border at which the cycle ceases to exist is
known: there a switch meets a sample. Beyond it the branch goes on with the nearest cycle of as many samples, or of a
neighbouring number; where there is none, a run and the search decide. A cycle that is not locked has no exact orbit:
it is carried by runs, each from the last one's state, as long as these stay near it. Trials of these are judged by the
period and the size of the run's last turn; only those that are kept are analysed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from eppanalysis.arrays import Array, ComplexArray
from eppanalysis.errors import EppError
from eppanalysis.methods.continuation.cover import gaps
from eppanalysis.methods.continuation.labels import in_words
from eppanalysis.methods.continuation.own_states import searched
from eppanalysis.methods.continuation.result import Branch, SpecialPoint
from eppanalysis.methods.orbits.exact import steady_hybrid
from eppanalysis.methods.orbits.samples.locked import (
    LockedOrbit,
    away,
    close_locked,
    locked_cycle,
    rounds_near,
    starts_on,
)
from eppanalysis.methods.search.simulate import simulate
from eppanalysis.methods.simulation.budget import BudgetExceeded, budget
from eppanalysis.methods.simulation.kept import Run
from eppanalysis.methods.simulation.runs import cycle_of_run, judge, run_hybrid
from eppanalysis.methods.simulation.samples import extent_of
from eppanalysis.methods.steady.changes import Change
from eppanalysis.models.systems.hybrid import HybridSystem
from eppanalysis.models.systems.lure import LureSystem
from eppanalysis.models.systems.sampled.strobe import Strobe
from eppanalysis.models.systems.starts import remembered
from eppanalysis.models.systems.subject import CaseLike, facts_of
from eppanalysis.progress import Progress
from eppanalysis.readable import count
from eppanalysis.results import SIMULATION, LimitCycle, Status
from eppanalysis.results.provenance import Provenance

#: How far a cycle may move from one value to the next, relative to its motion; of those that runs carry, the change
#: of period and size as logarithms.
_MOVES, _MOVES_IN_RUNS = 0.3, 0.2
#: Share of a step after which the way of an orbit is taken.
_NEAR = 1e-2
#: How well a border is located, relative to the range; one behind which runs are made.
_BORDER, _BORDER_OF_RUNS = 1e-6, 2e-3
#: How far behind a border the branch goes on, relative to the range; the numbers of samples that are tried there on
#: either side, and starts on the last orbit for each, with their sizes.
_BEYOND, _NEIGHBOURS, _STARTS = 1e-4, 5, 12
_SIZES = (1.0, 0.8, 1.25)
#: Decimals of the distance of two cycles beyond which it is rounding.
_TIED = 6
#: Turns of a run, and of the one that goes on where that says nothing.
_TURNS = (12.0, 24.0)
#: Steps of the engine, and what is worth as many, after which a branch ends: a minute or two.
_MOST_WORK = 6e7
#: Values between the end of a branch and that of the range at which runs look for another one.
_FARTHER = 8
_CEASED = "ends where no cycle near it continues it"
#: A multiplier as near to 1 as this at a border is that of a fold.
_AT_FOLD = 0.02
NOT_COVERED = (
    "The loop is sampled: the branch follows one cycle at a time. Cycles beside it with another number of samples, or "
    "with none, are not covered; parts that are not locked to the samples are stable cycles from runs."
)


@dataclass(frozen=True, eq=False)
class _Here:
    """The loop at a value of the parameter."""

    value: float
    case: CaseLike
    system: LureSystem
    hybrid: HybridSystem
    strobe: Strobe

    def locked(self, once: LockedOrbit | None) -> _Point | None:
        """A point of a closed orbit."""
        return None if once is None else _Point(self, once)

    def carried(
        self, near: LockedOrbit, n: int, sample: int = 0, size: float = 1.0, by: Array | None = None
    ) -> LockedOrbit | None:
        """The orbit of n periods of the samples nearest to one at another value, begun on it, scaled, moved."""
        behind = np.flatnonzero(near.run.guard[: near.last] == near.strobe.guard) + 1
        place = int(np.append(0, behind)[:: near.strobe.every][sample])
        row, hybrid, N = near.rows[place], self.hybrid, self.hybrid.x0.size
        if row.size != N + hybrid.H0.size:
            return None
        x, mean = hybrid.x0.copy(), near.rows[:-1].mean(axis=0)
        x[hybrid.compared] = (mean + size * (row - mean))[:N][hybrid.compared]
        x[self.strobe.clock] = row[self.strobe.clock]
        modes = near.run.modes[place - 1] if place else near.start.modes0
        y = np.append(x, row[N:])
        y[self.strobe.free] += 0.0 if by is None else by
        found = close_locked(self.strobe, self.strobe.begun(y[:N], y[N:], modes), n, near.motion)
        return found if found is not None and found.n == n else None

    def searched(self, near: LimitCycle, progress: Progress | None) -> _Point | None:
        """The first cycle near one at another value that the search finds, which starts from that one."""

        def alike(cycle: LimitCycle) -> bool:
            return away(cycle, near) < np.log(2.0)

        try:
            found = searched(self.case, [near], alike, progress)
        except EppError:
            return None
        likely = sorted(filter(alike, found), key=lambda c: away(c, near))
        return next(_points_of(self, likely), None)

    def by_run(self, state: Array, memory: tuple[float | None, ...], period: float) -> _Point | None:
        """The cycle that a run from a state on another one ends on; None for none, and for rest."""
        start = self.hybrid.begun(state, memory)
        for turns in _TURNS:
            t = turns * period
            most = self.strobe.samples_in(t) + 20_000
            run = run_hybrid(start, t, np.zeros(0), 2.0 * start.time_scale, most, most)
            status, found = judge(start, run, t)
            if status is not Status.UNDECIDED or not self.strobe.every or self.strobe.forgets:
                break
            start = next(starts_on(self.strobe, run, 1, 1), start)
        if status is not Status.LIMIT_CYCLE:
            return None
        if not found[5] and not self.strobe.forgets:
            n = round(found[1] / self.strobe.period)
            return self.locked(close_locked(self.strobe, next(starts_on(self.strobe, run, n, 1)), n))
        return _Point(self, _LastTurn(start, run, found))


@dataclass(frozen=True, eq=False)
class _LastTurn:
    """What a run that is not locked to the samples came to: `found` is what its verdict says."""

    start: HybridSystem
    run: Run
    found: Array

    @property
    def state(self) -> Array:
        """Where the turn begins."""
        return self.run.state[self._first, : self.start.n_plant]

    @property
    def memory(self) -> tuple[float | None, ...]:
        """Of the elements, there."""
        run = self.run
        return remembered(self.start, run.state[self._first], run.memory_values[self._first], run.modes[self._first])

    @property
    def _first(self) -> int:
        return int(self.run.order[-int(self.found[0]) - 1])

    @cached_property
    def extent(self) -> Array:
        """Logarithms of its period and of how far each state moves."""
        strobe = Strobe.of(self.start)
        assert strobe is not None
        return extent_of(strobe, self.run, self.found)

    def away(self, other: _LastTurn) -> float:
        """How far two are apart in period and sizes, as logarithms."""
        apart = np.abs(self.extent - other.extent)
        return float(apart[0] + np.median(apart[1:]))

    def cycle(self, system: LureSystem) -> LimitCycle:
        """The turn, analysed."""
        facts = Provenance("event-exact simulation", {"system": system.name})
        cycle = cycle_of_run(system, self.start, self.run, self.found, facts)
        if cycle is None:
            raise EppError("continue_branch: the last turn of a run could not be computed once more.")
        return cycle


@dataclass(frozen=True, eq=False)
class _Point:
    """A cycle at a value of the parameter: its orbit where it is locked to the samples, else the last turn of a run."""

    here: _Here
    of: LockedOrbit | _LastTurn
    slope: Array | None = None  # of what repeats at its first sample by the parameter, shape (m,); none at first

    @property
    def once(self) -> LockedOrbit | None:
        """The orbit, where it is locked to the samples."""
        return self.of if isinstance(self.of, LockedOrbit) else None

    @cached_property
    def cycle(self) -> LimitCycle:
        """The cycle, analysed."""
        return (
            locked_cycle(self.here.system, self.of)
            if isinstance(self.of, LockedOrbit)
            else self.of.cycle(self.here.system)
        )

    @property
    def value(self) -> float:
        """Of the parameter [SI]."""
        return self.here.value

    @property
    def multipliers(self) -> ComplexArray:
        """Of the orbit; none where a run is all that is known."""
        return np.zeros(0, complex) if self.cycle.multipliers is None else self.cycle.multipliers

    @property
    def samples(self) -> float:
        """In a period; nan where they are no whole number."""
        return float("nan") if self.once is None else float(self.once.n * self.here.strobe.every)

    def next(self, here: _Here) -> _Point | None:
        """The same cycle at a value near; None where it is not there any more."""
        if isinstance(self.of, LockedOrbit):
            way = here.value - self.value
            once = here.carried(self.of, self.of.n, by=None if self.slope is None else way * self.slope)
            if once is None:
                return None
            moved, turn = _moved(self.of, once)
            slope = (once.at_samples[0] - self.of.at_samples[turn]) / way
            return _Point(here, once, slope) if moved < _MOVES else None
        found = here.by_run(self.of.state, self.of.memory, self.of.found[1])
        near = found is not None and isinstance(found.of, _LastTurn) and found.of.away(self.of) < _MOVES_IN_RUNS
        return found if near else None

    def beyond(self, here: _Here, progress: Progress | None) -> _Point | None:
        """The cycle to go on with where this one ceased: of about as many samples, where a run ends, or searched."""
        if self.once is not None:
            for difference in range(_NEIGHBOURS + 1):
                found = self._neighbour(here, difference)
                if found is not None:
                    return found
        found = here.by_run(self.cycle.state, self.cycle.memory, self.cycle.period)
        near = found is not None and away(found.cycle, self.cycle) < np.log(2.0)
        return found if near else here.searched(self.cycle, progress)

    def _neighbour(self, here: _Here, difference: int) -> _Point | None:
        """The orbit of so many samples more or less that is the nearest in size."""
        assert self.once is not None
        lengths = {self.once.n - difference, self.once.n + difference}
        spread = np.unique(np.linspace(0, self.once.n - 1, _STARTS).astype(int)).tolist()
        starts = [(n, k, size) for n in sorted(lengths) if n > 0 for size in _SIZES for k in spread]
        tried = (here.carried(self.once, *start) for start in starts)
        found = [here.locked(once) for once in tried if once is not None]
        near = [p for p in found if p is not None and away(p.cycle, self.cycle) < np.log(2.0)]
        # Of cycles of the same period and size, as of other rests between the same pulses, the first that was tried.
        return min(near, key=lambda p: round(away(p.cycle, self.cycle), _TIED), default=None)

    def row(self) -> dict[str, float]:
        """What the branch keeps of it."""
        cycle = self.cycle
        # Runs know no multipliers.
        leading = float("nan") if self.once is None else float(np.max(np.abs(self.multipliers), initial=0.0))
        return {
            "value": self.value,
            "period": cycle.period,
            "frequency": cycle.frequency,
            "stable": float(bool(cycle.stable)),
            "multiplier": leading,
            "residual": cycle.residual,
            "samples": self.samples,
            **cycle.peak_to_peak,
        }

    def in_words(self) -> str:
        """Its relation to the samples."""
        if self.once is None:
            return "cycle that is not locked to the samples"
        return f"cycle of {count(int(self.samples), 'sample')}"


def _moved(old: LockedOrbit, new: LockedOrbit) -> tuple[float, int]:
    """How far an orbit has moved at its samples, relative to its motion, and which of them is now the first."""
    there, now = old.at_samples[:-1] / old.scale, new.at_samples[:-1] / old.scale
    moves = [float(np.max(np.abs(np.roll(there, -k, axis=0) - now), initial=0.0)) for k in range(len(there))]
    turn = int(np.argmin(moves))
    return moves[turn], turn


@dataclass
class _Walk:
    """One branch under way; lives for one call."""

    at: Callable[[float], _Here]
    ends: tuple[float, float]
    n_points: int
    max_step: float
    tell: Callable[[int, float], None]
    progress: Progress | None
    last: _Point | None = None
    rows: list[dict[str, float]] = field(default_factory=list)
    special: list[tuple[Change, _Point, str, int]] = field(default_factory=list)

    @property
    def width(self) -> float:
        """Of the range."""
        return abs(self.ends[1] - self.ends[0])

    def run(self, begin: _Point, stop: float) -> str:
        """From a cycle to an end of the range; why the branch ends."""
        try:
            self._keep(begin)
            return self._along(stop)
        except BudgetExceeded:
            if not self.rows:
                raise
            return f"stops when runs had taken {_MOST_WORK:.0e} steps (a narrower range or fewer points go farther)"

    def _along(self, stop: float) -> str:
        while True:
            last = self.last
            assert last is not None
            if last.value == stop:
                return "leaves the range"
            if len(self.rows) >= self.n_points:
                return "stops at the given number of points"
            step = np.sign(stop - last.value) * min(self.max_step * self.width, abs(stop - last.value))
            if last.once is not None and last.slope is None:  # near it its way is known: others are beside it
                near = last.next(self._loop_at(last.value + _NEAR * step))
                self.last = last = last if near is None else replace(last, slope=near.slope)
            here = self._loop_at(stop if abs(stop - last.value - step) < 1e-9 * self.width else last.value + step)
            new = last.next(here)
            if new is not None:
                self._keep(new)
            elif not self._cross(last, here):
                return _CEASED

    def farther(self, stop: float) -> _Point | None:
        """A cycle behind the end of the branch that runs from its last one end on."""
        assert self.last is not None
        cycle = self.last.cycle
        for value in np.linspace(self.last.value, stop, _FARTHER + 1)[1:].tolist():
            found = self._loop_at(value).by_run(cycle.state, cycle.memory, cycle.period)
            if found is not None:
                return found
        return None

    def _loop_at(self, value: float) -> _Here:
        self.tell(len(self.rows), value)
        return self.at(value)

    def _keep(self, point: _Point) -> None:
        """Take a point into the branch: its numbers, for the signals over a slow cycle fill tens of megabytes."""
        if self.last is not None:
            self._watch(self.last, point)
        self.rows.append(point.row())
        self.last = point

    def _cross(self, last: _Point, here: _Here) -> bool:
        """Locate the border and go on behind it; whether there is something to go on with."""
        inside, outside = last, here
        width = self.width * (_BORDER_OF_RUNS if last.once is None else _BORDER)
        # Where a switch meets a sample the cycle ceases without a sign in anything that Newton's method sees: its being
        # there is bisected (docs/theory/sampled.md, Over a parameter).
        while abs(outside.value - inside.value) > width:
            middle = self._loop_at(0.5 * (inside.value + outside.value))
            found = inside.next(middle)
            inside, outside = (inside, middle) if found is None else (found, outside)
        if inside is not last:
            self._keep(inside)
        way = np.sign(outside.value - inside.value) * _BEYOND * self.width
        new = inside.beyond(
            self._loop_at(float(np.clip(outside.value + way, min(self.ends), max(self.ends)))), self.progress
        )
        leading = np.min(np.abs(inside.multipliers - 1.0), initial=np.inf)
        fold = ": a multiplier comes to 1, as at a fold" if inside.once is not None and leading < _AT_FOLD else ""
        gone = "is not there any more, or no longer stable" if inside.once is None else f"ceases to exist{fold}"
        ceased = f"the {inside.in_words()} {gone}"
        if new is None:
            self.special.append((Change.END, inside, f"{ceased}; no cycle near it was found beyond", len(self.rows)))
            return False
        self.special.append((Change.SAMPLES, inside, f"{ceased}; on with a {new.in_words()}", len(self.rows)))
        self.rows.append(new.row())
        self.last = new
        return True

    def _watch(self, old: _Point, new: _Point) -> None:
        """Note a change of stability between two orbits."""
        if old.once is None or new.once is None or old.cycle.stable == new.cycle.stable:
            return
        values = (new if not new.cycle.stable else old).multipliers
        leading = values[np.argmax(np.abs(values))]
        kind = Change.TORUS if abs(leading.imag) > 1e-9 else Change.BRANCH_POINT
        kind = Change.PERIOD_DOUBLING if kind is Change.BRANCH_POINT and leading.real < 0 else kind
        note = f"a multiplier leaves the unit circle ({kind}) between this orbit and the next"
        self.special.append((kind, old, note, len(self.rows)))


def sampled_branch(
    case: CaseLike,
    parameter: str,
    ends: tuple[float, float],
    cycle: LimitCycle | None,
    most: tuple[int, float, int],
    progress: Progress | None,
) -> Branch:
    """The branch of a loop with sampled controllers, with at `most` so many points, so long steps, so many others; see
    ``continue_branch``.
    """

    def at(value: float) -> _Here:
        changed = case.with_values({parameter: value})
        system = changed.to_system()
        hybrid = steady_hybrid(system, changed.operating_point)
        strobe = Strobe.of(hybrid)
        if strobe is None:
            raise EppError(f"continue_branch: at {case.text(parameter, value)} nothing is sampled.")
        return _Here(float(value), changed, system, hybrid, strobe)

    def tell(done: int, value: float) -> None:
        if progress is not None:
            progress(done, None, f"{case.name}: {count(done, 'point')}, {parameter} = {case.text(parameter, value)}")

    begin = _seed(case, parameter, at, ends, cycle, progress)
    stop = ends[1] if begin.value == ends[0] else ends[0]
    found: list[Branch] = []

    def followed(begin: _Point, how: str) -> _Walk:
        walk = _Walk(at, ends, *most[:2], tell, progress)
        found.append(_branch(case, parameter, walk, (how, walk.run(begin, stop))))
        return walk

    with budget(_MOST_WORK), suppress(BudgetExceeded):
        walk = followed(begin, "begins at the end of the range")
        while found[-1].ends[1] == _CEASED and len(found) <= most[2]:
            other = walk.farther(stop)
            if other is None:
                break
            walk = followed(other, "begins where a run from the last cycle of another one ended on it")
    return _joined(found, ends)


def _joined(found: Sequence[Branch], ends: tuple[float, float]) -> Branch:
    """The first branch, with the others behind it and what they all leave of the range."""
    first, *others = found
    left = gaps((min(ends), max(ends)), [(b.points["value"], b.ends) for b in found])
    part = (" Together they cover" if others else " It covers") + " a part of the range."
    return replace(first, message=first.message + part * bool(left), missing=left, others=tuple(others))


def _seed(
    case: CaseLike,
    parameter: str,
    at: Callable[[float], _Here],
    ends: tuple[float, float],
    cycle: LimitCycle | None,
    progress: Progress | None,
) -> _Point:
    """A first cycle: near the one given, on which the case's own run ends at either end, or of a search there."""
    if cycle is not None:
        begin = next(_points_of(at(ends[0]), [cycle]), None)
        if begin is None:
            place = case.text(parameter, ends[0])
            raise EppError(f"continue_branch: there is no cycle near the given one at {parameter} = {place}.")
        return begin
    for value in ends:
        own = simulate(case.with_values({parameter: value})).limit_cycle
        begin = next(_points_of(at(value), [] if own is None else [own]), None)
        if begin is not None:
            return begin
    for value in ends[::-1]:
        found = searched(case.with_values({parameter: value}), (), progress=progress)
        begin = next(_points_of(at(value), found.cycles), None)
        if begin is not None:
            return begin
    raise EppError(
        f"continue_branch: no limit cycle was found at either end of the range of {parameter}; expected a range with "
        "one at an end, from which the branch begins."
    )


def _points_of(here: _Here, cycles: Iterable[LimitCycle]) -> Iterator[_Point]:
    """Cycles as points: closed to an orbit where they are locked, else as a run has them."""
    for cycle in cycles:
        # What a run has found a run finds again, locked or not.
        known = (
            rounds_near(here.hybrid, here.strobe, cycle) if here.strobe.closes and cycle.method != SIMULATION else ()
        )
        found = next((p for p in map(here.locked, known) if p and away(p.cycle, cycle) < _MOVES_IN_RUNS), None)
        found = found or here.by_run(cycle.state, cycle.memory, cycle.period)
        if found is not None:
            yield found


def _branch(case: CaseLike, parameter: str, walk: _Walk, ends: tuple[str, str]) -> Branch:
    begun = walk.last
    assert begun is not None
    names = begun.here.system.signals.names
    data = {name: np.array([row[name] for row in walk.rows]) for name in walk.rows[0]}
    data["stable"] = data["stable"] > 0.0
    special = tuple(SpecialPoint(kind, p.value, note, p.cycle, i) for kind, p, note, i in walk.special)
    return Branch(
        parameter=parameter,
        unit=case.unit(parameter)[0],
        readable=case.readable(parameter),
        points=data,
        special=special,
        status=Status.NOT_CONVERGED if any(s.kind is Change.END for s in special) else Status.INCOMPLETE,
        message=in_words(ends),
        ends=ends,
        signals=tuple(names),
        units=dict(begun.cycle.units),
        not_covered=NOT_COVERED,
        provenance=Provenance("branch of cycles of a sampled loop", {"limits": walk.ends}, case=facts_of(case)),
        operating_point=case.operating_point,
    )
