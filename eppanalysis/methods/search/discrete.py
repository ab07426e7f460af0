"""All limit cycles of a loop in discrete time: orbits that close after whole numbers of samples, others as of runs.

Runs from many states end on stable cycles. From states on all of them, orbits of the numbers of samples that runs end
on and of those near are sought by Newton's method, stable and unstable: cycles of neighbouring numbers stand side by
side, and of a thousand runs one may meet the smallest basin.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Any

import numpy as np

from eppanalysis.arrays import Array, IntArray
from eppanalysis.methods.orbits.orbit import CONVERGED
from eppanalysis.methods.orbits.samples.continua import joined
from eppanalysis.methods.orbits.samples.locked import not_among
from eppanalysis.methods.orbits.samples.sample_step import Step
from eppanalysis.methods.orbits.samples.sampled import (
    SCALES,
    all_orbits,
    chosen,
    far_from,
    is_of_many,
    middle_of,
    ready,
    runs,
    seeds_of,
    size_of,
)
from eppanalysis.methods.orbits.samples.unlocked import unlocked
from eppanalysis.methods.search.reach import oscillations_at_reach, reach_of_elements
from eppanalysis.methods.search.result import CycleSearch, exists, undecided
from eppanalysis.methods.search.unmet import MANY, more_of, unmet
from eppanalysis.methods.simulation.effort import Spent, allotted
from eppanalysis.models.systems.lure import LureSystem
from eppanalysis.models.systems.operating import OperatingPoint
from eppanalysis.progress import Progress
from eppanalysis.readable import count, listed
from eppanalysis.results import SIMULATION, LimitCycle, Status, smallest_first
from eppanalysis.results.provenance import Provenance

_STILL = 1e-9
#: Distance of a multiplier from one that is rounding.
_NEUTRAL = 1e-7
#: Fewest and most samples of a first run, and those of a turn that it lasts; how often a run without an end is made
#: three times as long.
_FEWEST, _MOST, _TURNS, _LONGER = 400, 8000, 320, 2
#: Random starts: of a basin with a fiftieth of all states, one search in fifty does not hear.
_N_RANDOM, _SEED = 200, 20050901
#: Sizes of random starts, in parts of where elements begin to matter.
_SMALLEST, _LARGEST = 0.05, 3.0
#: Numbers of samples that are always tried; samples in all numbers near one turn, and near all of them; samples of a
#: turn from which orbits of its length are sought where runs end on them alone.
_SHORT, _MOST_NEAR, _MOST_SOUGHT, _LONG = range(2, 9), 8000, 24_000, 500
#: Difference of the shapes of cycles that are one, relative to their size.
_ALIKE = 1e-6
#: How often as many random starts more are made where runs end on ever other cycles, and the share of work for that.
_MORE, _FOR_MORE = 8, 0.3
#: Numbers of samples that are sought together.
_TOGETHER = 16
#: Steps of the engine, and what is worth as many, after which a search ends.
_MOST_WORK = 2e7


@dataclass
class _Met:
    """A cycle of n samples that runs end on: one state on it with its marks, its shape, and how many runs do."""

    n: int
    state: Array
    marks: list[Any]
    shape: Array
    times: int = 1


@dataclass
class Runs:
    """Runs from many starts: states (samples, m, d) of their first stretch, and what each has come to.

    An end is the number of samples after which a run repeats itself (1: it settles), 0 where it does not, -1 where it
    diverges. `on` counts the runs on `motions`, which are not locked to the samples; `met` are cycles of others.
    """

    step: Step
    paths: Array
    scale: Array
    far: Array
    ends: IntArray
    last: Array
    samples: int
    motions: list[LimitCycle]
    on: int = 0
    met: list[_Met] = field(default_factory=list)

    @classmethod
    def of(cls, step: Step, starts: Array, samples: int) -> tuple[Runs, list[Any]]:
        """From states (m, n) of the loop, and the marks at the end of the first stretch."""
        paths, marks = runs(step, *step.begin(starts, step.system.memory), samples)
        far = far_from(paths)
        scale = size_of(paths, far)
        ends = np.array([_end(path, scale, far) for path in np.moveaxis(paths[len(paths) // 2 :], 1, 0)])
        made = cls(step, paths, scale, far, ends, paths[-1].copy(), samples, [])
        made._count(paths, marks, ends)
        made._follow(marks)
        return made, marks

    def _follow(self, marks: list[Any]) -> None:
        """Make runs without an end longer, as long as some are on no motion that stays where it is."""
        open_ = np.flatnonzero(self.ends == 0)
        tails, marks = self.paths[len(self.paths) // 2 :, open_], chosen(marks, open_)
        for longer in range(_LONGER + 1):
            each = [chosen(marks, np.array([k])) for k in range(open_.size)]
            self.motions, on = unlocked(self.step, list(np.moveaxis(tails, 1, 0)), each)
            self.on = len(on)
            # Runs may creep for long by where two cycles have vanished, as if on a curve: once they are made longer.
            if not open_.size or longer == _LONGER or (longer and self.on == open_.size):
                return
            for _ in range(2):  # the first half is not kept
                tails, marks = runs(self.step, tails[-1], marks, self.samples)
            self.samples *= 3
            self.last[open_] = tails[-1]
            self.ends[open_] = [_end(tail, self.scale, self.far) for tail in np.moveaxis(tails, 1, 0)]
            self._count(tails, marks, self.ends[open_])
            left = np.flatnonzero(self.ends[open_] == 0)
            open_, tails, marks = open_[left], tails[:, left], chosen(marks, left)

    def _count(self, tails: Array, marks: list[Any], ends: IntArray) -> IntArray:
        """Count the runs that end on each cycle; the places of those that meet a new one."""
        new = []
        for k in np.flatnonzero(ends > 1):
            n = int(ends[k])
            shape = _shape(tails[-n:, k] / self.scale)
            known = next((m for m in self.met if m.n == n and np.abs(m.shape - shape).max() < _ALIKE), None)
            if known is None:
                new.append(k)
                self.met.append(_Met(n, tails[-1, k], chosen(marks, np.array([k])), shape))
            else:
                known.times += 1
        return np.array(new, np.int64)

    def extend(self, starts: Array) -> None:
        """Make runs from further starts, as long as the first ones; what has no end by then tells nothing."""
        paths, marks = runs(self.step, *self.step.begin(starts, self.step.system.memory), len(self.paths))
        tails = paths[len(paths) // 2 :]
        ends = np.array([_end(tail, self.scale, self.far) for tail in np.moveaxis(tails, 1, 0)])
        told = np.concatenate([np.flatnonzero(np.abs(ends) == 1), self._count(tails, marks, ends)])
        self.ends, self.last = np.concatenate([self.ends, ends[told]]), np.concatenate([self.last, tails[-1, told]])

    @property
    def unmet(self) -> float:
        """At least how many cycles more there probably are that runs end on; a continuum counts as one cycle."""
        many = unmet(m.times for m in self.met)
        if many < MANY:
            return many
        of_continua = [is_of_many(self.step, m.state, m.marks, m.n, self.scale) for m in self.met]
        return unmet(m.times for m, one in zip(self.met, of_continua, strict=True) if not one)

    @property
    def undecided(self) -> int:
        """Number of runs that come to no end and are on no motion."""
        return int(np.sum(self.ends == 0)) - self.on

    @property
    def rest(self) -> Array:
        """A state of rest of the loop; empty where no run settles."""
        return self.last[self.ends == 1][:1, : self.step.system.A.shape[0]].ravel()

    @property
    def seeds(self) -> Array:
        """States of all runs, and those at the ends of runs on cycles."""
        return np.concatenate([seeds_of(self.paths, self.far), np.unique(self.last[self.ends > 1], axis=0)])


def search_discrete(
    system: LureSystem, at: OperatingPoint, predicted: Sequence[LimitCycle], progress: Progress | None = None
) -> CycleSearch:
    """All orbits of a loop in discrete time that runs and predictions lead to, stable and unstable."""
    step = ready(system, at)
    turns = [c.period / float(system.time_step or 1.0) for c in predicted]
    samples = int(np.clip(_TURNS * (max(turns) if turns else _slowest(system)), _FEWEST, _MOST))
    with allotted(_MOST_WORK) as work:
        made, marks = Runs.of(step, starts_of(system, predicted), samples)
        with suppress(Spent), allotted(_FOR_MORE * _MOST_WORK):
            for more in range(_MORE):
                if made.unmet < MANY:
                    break
                made.extend(_random(system, predicted, _SEED + 1 + more))
        cycles, sought = list(made.motions), _lengths(made.ends, turns)
        left = list(sought)
        with suppress(Spent):
            for group in _groups(sought):
                if progress is not None:
                    progress(len(sought) - len(left), len(sought), f"{system.name}: orbits of {group[0]} samples on")
                cycles += all_orbits(step, made.seeds, marks, group, made.scale)
                left = left[len(group) :]
    open_ends = [undecided(made.undecided)] * bool(made.undecided) + more_of("cycles that runs end on", made.unmet)
    if left:
        open_ends.append(
            f"orbits of {count(len(left), 'further number')} of samples, up to {max(left)}, not sought "
            f"when the search had taken {_MOST_WORK:.0e} steps"
        )
    cycles = [c for c in cycles if not any(_stands_for(other, c) for other in cycles)]
    cycles = _continua_once(step, cycles)
    unclosed = not_among(cycles, predicted)
    closed = sorted(set(sought) - set(left))
    return CycleSearch(
        cycles=tuple(replace(c, operating_point=at) for c in smallest_first(cycles)),
        status=Status.UNDECIDED if open_ends or any(map(exists, unclosed)) else Status.CONVERGED,
        settles=bool(np.any(made.ends == 1)),
        diverges=bool(np.any(made.ends == -1)),
        search=_sentence(made),
        not_covered=_not_covered(closed),
        rest_state=made.rest,
        unclosed=unclosed,
        left_open=tuple(open_ends),
        n_runs=made.ends.size,
        n_continua=sum(map(_is_one_of_many, cycles)),
        provenance=Provenance(
            "search for limit cycles",
            {"system": system.name},
            {"residual": CONVERGED},
            {"runs": made.ends.size, "work": work.used},
        ),
        operating_point=at,
    )


def _stands_for(orbit: LimitCycle, motion: LimitCycle) -> bool:
    """Whether runs on a motion, as far as its turns are alike, are on their way to an orbit of several such turns."""
    if motion.method != SIMULATION or orbit.method == SIMULATION or not orbit.stable:
        return False
    near, turns = motion.error_estimate, orbit.period / motion.period
    alike = abs(turns - round(turns)) <= near
    return alike and all(abs(orbit.peak_to_peak[k] - y) <= near * y for k, y in motion.peak_to_peak.items())


def _is_one_of_many(cycle: LimitCycle) -> bool:
    return cycle.multipliers is not None and bool(np.any(np.abs(cycle.multipliers - 1.0) < _NEUTRAL))


def _continua_once(step: Step, cycles: Sequence[LimitCycle]) -> list[LimitCycle]:
    """The cycles, one for each continuum: a modulator keeps for ever what its integrator began with."""
    kept = [c for c in cycles if not _is_one_of_many(c)]
    many: list[LimitCycle] = []
    for cycle in (c for c in cycles if _is_one_of_many(c)):
        if not any(_joined(step, known, cycle) for known in many):
            many.append(cycle)
    # At the rim of a continuum a sample is where two pieces meet.
    on_rim = [c for c in kept if c.stable is None and any(_joined(step, known, c) for known in many)]
    return [*many, *(c for c in kept if c not in on_rim)]


def _joined(step: Step, one: LimitCycle, other: LimitCycle) -> bool:
    """Whether two cycles are of one continuum."""
    n, turn = one.state.size, float(step.system.time_step or 1.0)
    samples = round(one.period / turn)
    if samples != round(other.period / turn) or np.any(step.lag):  # what is on its way a state does not tell
        return False
    a, b = (_path(step, c.state, c.memory, samples)[:-1] for c in (one, other))

    def once(begin: Array) -> Array:
        memory = [*one.memory]
        for place, i in enumerate(step.remembers):
            memory[i] = float(begin[n + place])
        return _path(step, begin[:n], memory, samples)

    return joined(a, b, once)


def _path(step: Step, state: Array, memory: Sequence[float | None], samples: int) -> Array:
    """States (samples + 1, d) from a state of the loop."""
    S, marks = step.begin(state[None], memory)
    path = [S[0]]
    for _ in range(samples):
        S, marks, _, _ = step.advance(S, marks)
        path.append(S[0])
    return np.array(path)


def _slowest(system: LureSystem) -> float:
    """Samples in which the slowest motion of the linear part goes one radian, or decays to a third; ten at least."""
    poles = np.linalg.eigvals(system.A).astype(complex)
    rates = np.abs(np.log(poles[np.abs(poles) > _STILL]))
    return max(10.0, 1.0 / float(rates[rates > _STILL].min(initial=1.0)))


def starts_of(system: LureSystem, predicted: Sequence[LimitCycle]) -> Array:
    """States (m, n), the same ones in all coordinates: the loop's own, predicted cycles in several sizes, the reach of
    the elements in several sizes, and random sums of oscillations of sizes from a twentieth of that to three times it.
    """
    own, reach = system.x0, reach_of_elements(system)
    starts = [own, *(s * reach for s in SCALES)]
    for c in predicted:
        middle = middle_of(c.require_state(own.size), own.size)
        starts += [middle + s * (c.state - middle) for s in SCALES]
    return np.concatenate([starts, _random(system, predicted, _SEED)])


def _random(system: LureSystem, predicted: Sequence[LimitCycle], seed: int) -> Array:
    """Random starts (m, n), the same ones in all coordinates."""
    n = system.x0.size
    at_reach = oscillations_at_reach(system)[0]
    begun = [c.state - middle_of(c, n) for c in predicted]
    columns = np.column_stack([system.x0, *begun, at_reach.real, at_reach.imag])
    rng = np.random.default_rng(seed)
    size = np.exp(rng.uniform(np.log(_SMALLEST), np.log(_LARGEST), (_N_RANDOM, 1)))
    noise = rng.normal(size=(_N_RANDOM, columns.shape[1]))
    return size * noise / np.sqrt(columns.shape[1]) @ columns.T


def _lengths(ends: IntArray, turns: Sequence[float]) -> list[int]:
    """Numbers of samples of orbits that are sought: those that runs end on, short ones, and those near them and near
    turns, the nearest first.
    """
    of_runs = sorted({int(n) for n in ends if n > 1})
    about = [*turns, *of_runs]
    near = sorted({n for turn in about for n in _lengths_near(turn)} - {*of_runs, *_SHORT})
    near.sort(key=lambda n: min(abs(n - turn) / turn for turn in about))
    within = int(np.searchsorted(np.cumsum(near), _MOST_SOUGHT))
    return [*of_runs, *(n for n in _SHORT if n not in of_runs), *sorted(near[:within])]


def _lengths_near(turn: float) -> range:
    """Numbers of samples of orbits beside a turn; of long turns, each costs as much, few or none."""
    first, last = max(2, int(0.8 * turn)), int(1.25 * turn) + 2
    most = int(_MOST_NEAR / turn) if turn < _LONG else 0
    middle = round(turn)
    return range(max(first, middle - most // 2), min(last, middle + (most + 1) // 2))


def _groups(lengths: Sequence[int]) -> list[list[int]]:
    """Stretches of numbers of samples that are sought together: alike, as all of them take as long as the longest."""
    groups: list[list[int]] = []
    for n in lengths:
        if groups and len(groups[-1]) < _TOGETHER and abs(n - groups[-1][0]) <= max(_SHORT[-1], groups[-1][0] // 4):
            groups[-1].append(n)
        else:
            groups.append([n])
    return groups


def _end(tail: Array, scale: Array, far: Array) -> int:
    """Samples after which a run repeats itself (1: it settles), 0 where it does not, -1 where it diverges."""
    last = tail[-1]
    if not np.all(np.abs(last) < far):
        return -1
    near = (np.abs(tail[:-1] - last) / scale).max(1) < _STILL
    for n in (len(near) - np.flatnonzero(near)[::-1]).tolist():
        if 2 * n < len(tail) and (np.abs(tail[n:] - tail[:-n])[-n:] / scale).max() < _STILL:
            return int(n)
    return 0


def _shape(states: Array) -> Array:
    """What tells the cycles of as many samples apart, at whatever sample the states (n, d) begin."""
    mean = states.mean(axis=0)
    beside = states - mean
    return np.concatenate([mean, np.ptp(states, axis=0), (beside.T @ np.roll(beside, 1, axis=0)).ravel() / len(states)])


def _sentence(made: Runs) -> str:
    """How completeness was sought."""
    text = f"{made.ends.size} runs of up to {made.samples} samples; orbits were sought from states on all of them"
    if made.on:
        text += f"; {made.on} runs ended near listed motions that have not repeated themselves by then"
    if made.undecided:
        return f"{text}, and {undecided(made.undecided)} (their motion may fill a curve)."
    return f"{text}; every run ended on a listed orbit, at rest, or left."


def _not_covered(closed: Sequence[int]) -> str:
    """What was not looked for, where orbits of so many samples were sought."""
    others = (
        f"Cycles of other numbers of samples than {_stretches(closed)} were not sought, and those"
        if closed
        else "Cycles"
    )
    return f"{others} with small basins may be missed"


def _stretches(sought: Sequence[int]) -> str:
    """Numbers of samples in words: 2 to 8, 20 to 33 and 60."""
    cuts = [i + 1 for i, (a, b) in enumerate(pairwise(sought)) if b > a + 1]
    parts = [sought[a:b] for a, b in pairwise([0, *cuts, len(sought)])]
    return listed([str(p[0]) if len(p) == 1 else f"{p[0]} to {p[-1]}" for p in parts])
