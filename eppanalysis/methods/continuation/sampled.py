"""Branches of limit cycles of loops with sampled controllers: at one number of samples until they cease, then on.

A cycle that is locked to the samples is a fixed point of the map over its number of samples; Newton's method carries it
from value to value. Where none is found the step is halved, until the border at which the cycle ceases to exist is
known: there a switch meets a sample. Beyond it the branch goes on with the nearest cycle of as many samples, or of a
neighbouring number; where there is none, a run and the search are asked. A cycle that is not locked has no exact orbit:
it is carried by runs, each from the last one's state, as long as these stay near it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from eppanalysis.errors import EppError
from eppanalysis.methods.continuation.cover import gaps
from eppanalysis.methods.continuation.labels import Change, in_words
from eppanalysis.methods.continuation.result import Branch, SpecialPoint
from eppanalysis.methods.orbits.exact import steady_hybrid
from eppanalysis.methods.orbits.samples.locked import (
    Round,
    away,
    close_locked,
    locked_cycle,
    rounds_near,
    starts_on,
)
from eppanalysis.methods.search.find import find_limit_cycles, search_from
from eppanalysis.methods.simulation.simulate import cycle_of_run, judge, run_hybrid, simulate
from eppanalysis.models.systems.hybrid import HybridSystem
from eppanalysis.models.systems.lure import LureSystem
from eppanalysis.models.systems.sampled.strobe import Strobe
from eppanalysis.models.systems.subject import CaseLike, facts_of
from eppanalysis.readable import count
from eppanalysis.results import SIMULATION, LimitCycle, Status
from eppanalysis.results.provenance import Provenance

Array = NDArray[np.float64]

#: How far a cycle may move from one value to the next, relative to its motion; of those that runs carry, the change
#: of period and size as logarithms.
_MOVES, _MOVES_IN_RUNS = 0.3, 0.2
#: How well a border is located, relative to the range; one behind which runs are asked.
_BORDER, _BORDER_OF_RUNS = 1e-6, 2e-3
#: How far behind a border the branch goes on, relative to the range; the numbers of samples that are tried there on
#: either side, and starts on the last orbit for each, with their sizes.
_BEYOND, _NEIGHBOURS, _STARTS = 1e-4, 5, 12
_SIZES = (1.0, 0.8, 1.25)
#: Turns of a run, and how often it is made three times as long.
_TURNS, _LONGER = 12.0, 2
#: A multiplier as near to 1 as this at a border is that of a fold.
_AT_FOLD = 0.02
NOT_COVERED = (
    "The loop is sampled: the branch follows one cycle at a time, and cycles that stand beside it with another number "
    "of samples, or with none, are not covered; parts that are not locked to the samples are stable cycles as runs "
    "have them."
)


@dataclass(frozen=True, eq=False)
class _Here:
    """The loop at a value of the parameter."""

    value: float
    case: CaseLike
    system: LureSystem
    hybrid: HybridSystem
    strobe: Strobe

    def locked(self, once: Round | None) -> _Point | None:
        """A point of a closed orbit."""
        return None if once is None else _Point(self, locked_cycle(self.system, once), once)

    def carried(self, near: Round, n: int, sample: int = 0, size: float = 1.0) -> Round | None:
        """The orbit of n periods of the samples nearest to one at another value, begun at a sample of it, scaled."""
        behind = np.flatnonzero(near.run.guard[: near.last] == near.strobe.guard) + 1
        place = int(np.append(0, behind)[:: near.strobe.every][sample])
        row, hybrid, N = near.rows[place], self.hybrid, self.hybrid.x0.size
        if row.size != N + hybrid.H0.size:
            return None
        x, mean = hybrid.x0.copy(), near.rows[:-1].mean(axis=0)
        x[hybrid.compared] = (mean + size * (row - mean))[:N][hybrid.compared]
        x[self.strobe.clock] = row[self.strobe.clock]
        modes = near.run.modes[place - 1] if place else near.start.modes0
        found = close_locked(self.strobe, self.strobe.begun(x, row[N:], modes), n, near.motion)
        return found if found is not None and found.n == n else None

    def searched(self, near: LimitCycle) -> _Point | None:
        """The cycle that the search, which starts from one at another value, too, finds nearest to it."""
        try:
            found = search_from(self.case, [near])
        except EppError:
            return None
        likely = sorted((c for c in found if away(c, near) < np.log(2.0)), key=lambda c: away(c, near))
        return next(_points_of(self, likely), None)

    def by_run(self, cycle: LimitCycle) -> _Point | None:
        """The cycle that a run from a state on another one ends on; None for none, and for rest."""
        start, t = self.hybrid.begun(cycle.state, cycle.memory), _TURNS * cycle.period
        for _ in range(_LONGER):
            most = self.strobe.samples_in(t) + 20_000
            run = run_hybrid(start, t, np.zeros(0), 2.0 * start.time_scale, most, most)
            status, found = judge(start, run, t)
            if status is not Status.UNDECIDED:
                break
            t *= 3.0
        if status is not Status.LIMIT_CYCLE:
            return None
        if not found[5] and not self.strobe.forgets:
            n = round(found[1] / self.strobe.period)
            return self.locked(close_locked(self.strobe, next(starts_on(self.strobe, run, n, 1)), n))
        facts = Provenance("event-exact simulation", {"system": self.system.name})
        seen = cycle_of_run(self.system, start, run, found, facts)
        return None if seen is None else _Point(self, seen, None)


@dataclass(frozen=True, eq=False)
class _Point:
    """A cycle at a value of the parameter; `once` is its orbit where it is locked to the samples."""

    here: _Here
    cycle: LimitCycle
    once: Round | None

    @property
    def value(self) -> float:
        """Of the parameter [SI]."""
        return self.here.value

    @property
    def multipliers(self) -> NDArray[np.complex128]:
        """Of the orbit; none where a run is all that is known."""
        return np.zeros(0, complex) if self.cycle.multipliers is None else self.cycle.multipliers

    @property
    def samples(self) -> float:
        """In a period; nan where they are no whole number."""
        return float("nan") if self.once is None else float(self.once.n * self.here.strobe.every)

    def next(self, here: _Here) -> _Point | None:
        """The same cycle at a value near; None where it is not there any more."""
        if self.once is None:
            found = here.by_run(self.cycle)
            same = found is not None and found.once is None and away(found.cycle, self.cycle) < _MOVES_IN_RUNS
            return found if same else None
        once = here.carried(self.once, self.once.n)
        return here.locked(once) if once is not None and _moved(self.once, once) < _MOVES else None

    def beyond(self, here: _Here) -> _Point | None:
        """The cycle to go on with where this one ceased: of about as many samples, where a run ends, or searched."""
        if self.once is not None:
            for difference in range(_NEIGHBOURS + 1):
                found = self._neighbour(here, difference)
                if found is not None:
                    return found
        found = here.by_run(self.cycle)
        near = found is not None and away(found.cycle, self.cycle) < np.log(2.0)
        return found if near else here.searched(self.cycle)

    def _neighbour(self, here: _Here, difference: int) -> _Point | None:
        """The orbit of so many samples more or less that is the nearest in size."""
        assert self.once is not None
        lengths = {self.once.n - difference, self.once.n + difference}
        spread = np.unique(np.linspace(0, self.once.n - 1, _STARTS).astype(int)).tolist()
        starts = [(n, k, size) for n in sorted(lengths) if n > 0 for size in _SIZES for k in spread]
        tried = (here.carried(self.once, *start) for start in starts)
        found = [here.locked(once) for once in tried if once is not None]
        near = [p for p in found if p is not None and away(p.cycle, self.cycle) < np.log(2.0)]
        return min(near, key=lambda p: away(p.cycle, self.cycle), default=None)

    def in_words(self) -> str:
        """How it stands to the samples."""
        return "not locked to the samples" if self.once is None else count(int(self.samples), "sample")


def _moved(old: Round, new: Round) -> float:
    """How far an orbit has moved at its samples, relative to its motion."""
    return float(np.max(np.abs(new.at_samples - old.at_samples) / old.scale, initial=0.0))


@dataclass
class _Walk:
    """One branch under way; lives for one call."""

    at: Callable[[float], _Here]
    ends: tuple[float, float]
    n_points: int
    max_step: float
    points: list[_Point] = field(default_factory=list)
    special: list[tuple[Change, _Point, str, int]] = field(default_factory=list)

    @property
    def width(self) -> float:
        """Of the range."""
        return abs(self.ends[1] - self.ends[0])

    def run(self, begin: _Point, stop: float) -> str:
        """From a cycle to an end of the range; why the branch ends."""
        self.points = [begin]
        while len(self.points) < self.n_points:
            last = self.points[-1]
            if last.value == stop:
                return "leaves the range"
            step = np.sign(stop - last.value) * min(self.max_step * self.width, abs(stop - last.value))
            here = self.at(stop if abs(stop - last.value - step) < 1e-9 * self.width else last.value + step)
            new = last.next(here)
            if new is None and not self._cross(last, here):
                return "ends where no cycle near it continues it"
            if new is not None:
                self._watch(last, new)
                self.points.append(new)
        return "stops at the number of points asked for"

    def _cross(self, last: _Point, here: _Here) -> bool:
        """Locate the border and go on behind it; whether there is something to go on with."""
        inside, outside = last, here
        width = self.width * (_BORDER_OF_RUNS if last.once is None else _BORDER)
        # Where a switch meets a sample the cycle ceases without a sign in anything that Newton's method sees: its being
        # there is bisected (docs/theory/sampled.md, Over a parameter).
        while abs(outside.value - inside.value) > width:
            middle = self.at(0.5 * (inside.value + outside.value))
            found = inside.next(middle)
            inside, outside = (inside, middle) if found is None else (found, outside)
        if inside is not last:
            self._watch(last, inside)
            self.points.append(inside)
        way = np.sign(outside.value - inside.value) * _BEYOND * self.width
        new = inside.beyond(self.at(float(np.clip(outside.value + way, min(self.ends), max(self.ends)))))
        leading = np.min(np.abs(inside.multipliers - 1.0), initial=np.inf)
        fold = ": a multiplier comes to 1, as at a fold" if inside.once is not None and leading < _AT_FOLD else ""
        ceased = f"the cycle of {inside.in_words()} ceases to exist{fold}"
        if inside.once is None:
            ceased = "the cycle that is not locked to the samples is not there any more, or no longer stable"
        if new is None:
            self.special.append((Change.END, inside, f"{ceased}; no cycle near it was found beyond", len(self.points)))
            return False
        self.special.append((Change.SAMPLES, inside, f"{ceased}; on with {new.in_words()}", len(self.points)))
        self.points.append(new)
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
        self.special.append((kind, old, note, len(self.points)))


def sampled_branch(
    case: CaseLike,
    parameter: str,
    ends: tuple[float, float],
    cycle: LimitCycle | None,
    n_points: int,
    max_step: float,
) -> Branch:
    """The branch of a loop with sampled controllers; see ``continue_branch``."""

    def at(value: float) -> _Here:
        changed = case.with_values({parameter: value})
        system = changed.to_system()
        hybrid = steady_hybrid(system, changed.operating_point)
        strobe = Strobe.of(hybrid)
        if strobe is None:
            raise EppError(f"continue_branch: at {case.text(parameter, value)} nothing is sampled.")
        return _Here(float(value), changed, system, hybrid, strobe)

    begin = _seed(case, parameter, at, ends, cycle)
    walk = _Walk(at, ends, n_points, max_step)
    stop = ends[1] if begin.value == ends[0] else ends[0]
    why = walk.run(begin, stop)
    return _branch(case, parameter, walk, ("begins at the end of the range", why))


def _seed(
    case: CaseLike,
    parameter: str,
    at: Callable[[float], _Here],
    ends: tuple[float, float],
    cycle: LimitCycle | None,
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
        begin = next(_points_of(at(value), find_limit_cycles(case.with_values({parameter: value})).cycles), None)
        if begin is not None:
            return begin
    raise EppError(f"continue_branch: no limit cycle was found at either end of the range of {parameter}.")


def _points_of(here: _Here, cycles: Iterable[LimitCycle]) -> Iterator[_Point]:
    """Cycles as points: closed to an orbit where they are locked, else as a run has them."""
    closes = bool(here.strobe.every) and not here.strobe.forgets
    for cycle in cycles:
        # What a run has found a run finds again, locked or not.
        known = rounds_near(here.hybrid, here.strobe, cycle) if closes and cycle.method != SIMULATION else ()
        found = next((p for p in map(here.locked, known) if p and away(p.cycle, cycle) < _MOVES_IN_RUNS), None)
        found = found or here.by_run(cycle)
        if found is not None:
            yield found


def _branch(case: CaseLike, parameter: str, walk: _Walk, ends: tuple[str, str]) -> Branch:
    points, names = walk.points, walk.points[0].here.system.signals.names
    data = {
        "value": np.array([p.value for p in points]),
        "period": np.array([p.cycle.period for p in points]),
        "frequency": np.array([p.cycle.frequency for p in points]),
        "stable": np.array([bool(p.cycle.stable) for p in points]),
        "multiplier": np.array([float(np.max(np.abs(p.multipliers), initial=0.0)) for p in points]),
        "residual": np.array([p.cycle.residual for p in points]),
        "samples": np.array([p.samples for p in points]),
    }
    data["multiplier"][np.isnan(data["samples"])] = np.nan  # runs know none
    data |= {name: np.array([p.cycle.peak_to_peak[name] for p in points]) for name in names}
    special = tuple(SpecialPoint(kind, p.value, note, p.cycle, i) for kind, p, note, i in walk.special)
    left = gaps((min(walk.ends), max(walk.ends)), [(data["value"], ends)])
    missing = tuple(replace(gap, why=f"the branch {ends[1]}") for gap in left)
    return Branch(
        parameter=parameter,
        unit=case.unit(parameter)[0],
        readable=case.readable(parameter),
        points=data,
        special=special,
        status=Status.NOT_CONVERGED if any(s.kind is Change.END for s in special) else Status.INCOMPLETE,
        message=in_words(ends) + " It covers a part of the range asked for." * bool(missing),
        ends=ends,
        signals=tuple(names),
        units=dict(points[0].cycle.units),
        missing=missing,
        not_covered=NOT_COVERED,
        provenance=Provenance("branch of cycles of a sampled loop", {"limits": walk.ends}, case=facts_of(case)),
        operating_point=case.operating_point,
    )
