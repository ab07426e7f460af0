"""Exact orbits of loops with sampled controllers: those that close after a whole number of samples.

They are steady motions whose duration is given, a whole number of periods of the samples that come round together; none
of their multipliers is that of a shift along the orbit, which the samples do not let pass. A motion whose period is no
whole number of samples has no such orbit.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from eppanalysis.arrays import Array, IntArray
from eppanalysis.methods.orbits.samples.continua import joined
from eppanalysis.methods.simulation.kept import Run
from eppanalysis.methods.simulation.rounding import left_by_rounding
from eppanalysis.methods.simulation.runs import run_hybrid
from eppanalysis.methods.steady.closing import close
from eppanalysis.methods.steady.cycle import steady_cycle
from eppanalysis.methods.steady.flow import MOST_EVENTS, run_over
from eppanalysis.methods.steady.motion import SteadyMotion
from eppanalysis.models.systems.hybrid import HybridSystem
from eppanalysis.models.systems.lure import LureSystem
from eppanalysis.models.systems.sampled.strobe import Strobe
from eppanalysis.results import EXACT_ORBIT, LimitCycle, Status

#: Decimals, in sizes of the motion, to which samples are compared to choose the one where an orbit begins.
_DIGITS = 6
#: Two orbits are one, or one is a shorter one gone round several times, where they are as near as this.
_SAME = 1e-7
#: Motion, relative to what is looked for, that is rest.
_REST = 1e-6
#: Numbers of samples that are tried where the period of a start is none.
_MOST_LENGTHS = 40


@dataclass(frozen=True, eq=False)
class SampledTurn:
    """Once round: a start behind a sample, and the run from there to the same sample some whole periods later."""

    strobe: Strobe
    start: HybridSystem  # its clock at zero
    n: int  # periods of the strobe
    run: Run
    last: int  # place of the event that ends it

    @classmethod
    def of(cls, strobe: Strobe, start: HybridSystem, n: int) -> SampledTurn | None:
        """The run once round; None where it ends before."""
        run = run_over(start, n * strobe.period + 0.25 * min(c.sample_time for c in strobe.controllers))
        if run is None:
            return None
        samples = np.flatnonzero(run.guard[: run.n_kept] == strobe.guard)
        if samples.size < n * strobe.every:
            return None
        return SampledTurn(strobe, start, n, run, int(samples[n * strobe.every - 1]))

    @cached_property
    def rows(self) -> Array:
        """States and memory values behind the start and each event, shape (events + 1, N)."""
        after = np.hstack([self.run.state, self.run.memory_values])[: self.last + 1]
        return np.vstack([np.concatenate([self.start.x0, self.start.H0]), after])

    @cached_property
    def at_samples(self) -> Array:
        """What repeats, behind the start and each sample of the strobe, shape (n + 1, m)."""
        places = np.flatnonzero(self.run.guard[: self.last + 1] == self.strobe.guard) + 1
        return self.rows[np.append(0, places)][:: self.strobe.every, self.strobe.free]

    def begun_at(self, begin: Array) -> HybridSystem:
        """The start, with other values of what repeats."""
        y, n = self.rows[0].copy(), self.start.x0.size
        y[self.strobe.free] = begin
        return self.strobe.begun(y[:n], y[n:], self.run.modes[self.last])


@dataclass(frozen=True, eq=False)
class LockedOrbit(SampledTurn):
    """A turn that ends where it began."""

    steady: SteadyMotion  # the same motion, begun where no event is near

    @classmethod
    def closed(cls, strobe: Strobe, steady: SteadyMotion, n: int) -> LockedOrbit | None:
        """A steady motion of n periods, begun at the sample where what repeats is greatest, its first place first."""
        (once,) = steady.passes
        run = once.run
        samples = once.events[run.guard[once.events] == strobe.guard]
        behind = np.hstack([run.state[samples], run.memory_values[samples]])[:, strobe.free] / steady.scale
        first = samples[np.lexsort(np.round(behind, _DIGITS).T[::-1])[-1]]
        turn = SampledTurn.of(strobe, begun_behind(strobe, run, first), n)
        return None if turn is None else cls(strobe, turn.start, n, turn.run, turn.last, steady)

    @property
    def motion(self) -> Array:
        """How far what repeats moves, between samples too, shape (m,)."""
        return self.steady.extent[self.strobe.free]

    @property
    def scale(self) -> Array:
        """Size of the motion in each place, never zero."""
        return self.steady.scale

    @property
    def rests(self) -> bool:
        """Whether what the elements see of the motion is rounding: at rest, too, every sample closes."""
        n, on = self.start.x0.size, self.strobe.free < self.start.x0.size
        moves = np.zeros(n)
        moves[self.strobe.free[on]] = self.motion[on]
        return left_by_rounding(self.start, self.rows[:, :n], self.rows[:, n:], moves, 1.0)[0]

    @property
    def one_of_many(self) -> bool:
        """Whether it belongs to a continuum of orbits."""
        return self.steady.one_of_many

    @property
    def is_stable(self) -> bool:
        """Whether all its multipliers are within one."""
        values = self.steady.multipliers
        return values is not None and bool(np.all(np.abs(values) < 1.0))


def close_locked(strobe: Strobe, start: HybridSystem, n: int, size: Array | None = None) -> LockedOrbit | None:
    """The orbit of n periods of the strobe near a start, once round in the fewest; None where none is found.

    Parameters
    ----------
    start : HybridSystem
        Behind a sample, as :meth:`Strobe.begun` makes it.
    size : array, shape (m,), optional
        Of the motion that is looked for: far smaller ones are rest.
    """
    steady = close(SteadyMotion.begun(start, n * strobe.period), given=True) if n else None
    found = None if steady is None else LockedOrbit.closed(strobe, steady, n)
    if found is None or found.rests or (size is not None and not np.any(found.motion > _REST * size)):
        return None
    return _once(found)


def _once(found: LockedOrbit) -> LockedOrbit | None:
    """Taken back to the fewest periods after which it has closed; None for rest."""
    away = np.max(np.abs(found.at_samples - found.at_samples[0]) / found.scale, axis=1)
    for n in range(1, found.n):
        if found.n % n == 0 and np.max(away[::n]) < _SAME:
            return close_locked(found.strobe, found.start, n)
    return found


def same_round(one: LockedOrbit, other: LockedOrbit) -> bool:
    """Whether two orbits are one, begun at different samples."""
    if one.n != other.n:
        return False
    there, here = one.at_samples[:-1] / one.scale, other.at_samples[:-1] / one.scale
    turns = np.flatnonzero(np.max(np.abs(there - here[0]), axis=1) < _SAME)
    return any(bool(np.max(np.abs(np.roll(there, -turn, axis=0) - here)) < _SAME) for turn in turns)


def of_one_continuum(one: LockedOrbit, other: LockedOrbit) -> bool:
    """Whether two orbits belong to one continuum, which a disturbance moves the loop along."""

    def once(begin: Array) -> Array | None:
        path = SampledTurn.of(one.strobe, one.begun_at(begin), one.n)
        return None if path is None else path.at_samples

    # At its rim, where a sample meets a threshold, a disturbance leads off a continuum to one side.
    many = one.n == other.n and (one.one_of_many or other.one_of_many)
    return many and joined(one.at_samples[:-1], other.at_samples[:-1], once)


def samples_of(strobe: Strobe, run: Run) -> IntArray:
    """Places among the kept events of a run of the samples at which all come round, oldest first."""
    samples = run.order[run.guard[run.order] == strobe.guard]
    return samples[::-1][:: max(strobe.every, 1)][::-1]


def begun_behind(strobe: Strobe, run: Run, place: int) -> HybridSystem:
    """The system begun behind a sample of a run."""
    return strobe.begun(run.state[place], run.memory_values[place], run.modes[place])


def starts_on(strobe: Strobe, run: Run, n: int, most: int) -> Iterator[HybridSystem]:
    """Starts behind samples of the last n periods of a run, evenly spread, the last one first."""
    order = samples_of(strobe, run)[::-1][:n]
    for place in order[np.unique(np.linspace(0, order.size - 1, min(most, order.size)).astype(int))]:
        yield begun_behind(strobe, run, place)


def locked_cycle(system: LureSystem, found: LockedOrbit) -> LimitCycle:
    """What a closed orbit looks like to its user."""
    strobe = found.strobe
    samples = found.n * strobe.every
    cycle = steady_cycle(
        system, found.steady, (found.start, found.run, found.last), found.rows, found.n * strobe.period
    )
    locked = f"locked to the samples: {samples} of {strobe.controllers[0].sample_time:g} s"
    settings = {**cycle.provenance.settings, "samples": samples}
    return replace(
        cycle,
        note="; ".join([locked, cycle.note] if cycle.note else [locked]),
        provenance=replace(cycle.provenance, settings=settings),
    )


def locked_orbit(system: LureSystem, hybrid: HybridSystem, strobe: Strobe, start: LimitCycle) -> LimitCycle:
    """The orbit of a loop with sampled controllers nearest to an approximate one; see ``exact_orbit``."""
    if strobe.forgets:
        return unclosed(start, "orbits through a dead time are not closed in loops with sampled controllers")
    if not strobe.every:
        return unclosed(start, "its samples never come round together, so no cycle is locked to them")
    best = [locked_cycle(system, found) for found in rounds_near(hybrid, strobe, start)]
    alike = [c for c in best if away(c, start) < np.log(2.0)]
    fit = [c for c in alike if start.stable in (None, c.stable)] or alike
    if fit:
        return min(fit, key=lambda c: away(c, start))
    length = start.period / strobe.period
    return unclosed(start, f"no orbit that is locked to the samples was found near {length:.6g} of {strobe.period:g} s")


def rounds_near(hybrid: HybridSystem, strobe: Strobe, start: LimitCycle) -> Iterator[LockedOrbit]:
    """Closed orbits near an approximate cycle: of its number of samples, or where that is no whole one, of all near."""
    length, found = start.period / strobe.period, list[LockedOrbit]()
    whole = abs(length - round(length)) < 1e-6 * length and round(length) > 0
    begun = hybrid.begun(start.state, start.memory)
    # A short run first, before it has left an unstable cycle; a stable one is nearer after a long one.
    for turns in (2.0, 12.0):
        most = strobe.samples_in((turns + 1.0) * start.period) + MOST_EVENTS
        t_end = (turns + 1.0 / max(length, 0.1)) * start.period
        run = run_hybrid(begun, t_end, np.zeros(0), 2.0 * hybrid.time_scale, most, most)
        for n in [round(length)] if whole else lengths_near(length):
            for begin in starts_on(strobe, run, max(n, 1), 4):
                orbit = close_locked(strobe, begin, n)
                if orbit is not None and not any(same_round(known, orbit) for known in found):
                    found.append(orbit)
                    yield orbit


def lengths_near(length: float) -> list[int]:
    """Numbers of samples near one, the nearest first."""
    within = np.arange(max(1, int(0.75 * length)), int(1.35 * length) + 2)
    return within[np.argsort(np.abs(within - length), kind="stable")][:_MOST_LENGTHS].tolist()


def unclosed(start: LimitCycle, why: str) -> LimitCycle:
    """The cycle as it was given, where no orbit was closed from it, with the reason."""
    return replace(start, method=EXACT_ORBIT, status=Status.NOT_CONVERGED, stable=None, residual=float("nan"), note=why)


def away(cycle: LimitCycle, start: LimitCycle) -> float:
    """How far two cycles are apart in period and sizes, as logarithms."""
    sizes = [(cycle.peak_to_peak[k], v) for k, v in start.peak_to_peak.items() if v > 0 and cycle.peak_to_peak.get(k)]
    return abs(float(np.log(cycle.period / start.period))) + float(
        np.median([abs(np.log(a / b)) for a, b in sizes] or [0.0])
    )


def not_among(cycles: Sequence[LimitCycle], predicted: Sequence[LimitCycle]) -> tuple[LimitCycle, ...]:
    """The predicted cycles that no turn of those found is near: within a factor of two of period and size together."""

    def turn(found: LimitCycle, c: LimitCycle) -> LimitCycle:
        return replace(found, period=found.period / max(round(found.period / c.period), 1))

    return tuple(c for c in predicted if all(away(turn(found, c), c) > np.log(2.0) for found in cycles))
