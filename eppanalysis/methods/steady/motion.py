"""A steady motion, and what comes near to it: a chain of passes whose end is its start, or the mirror image of that.

One pass tells little of its begin where a motion leaves itself a thousandfold; each of several tells enough (multiple
shooting: Stoer and Bulirsch, Introduction to Numerical Analysis, 2002, section 7.3.5; docs/theory/flow.md).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from eppanalysis.arrays import Array, BoolArray, ComplexArray, IntArray
from eppanalysis.methods.simulation.stability import is_stable, multipliers
from eppanalysis.methods.steady.flow import (
    Pass,
    advance,
    advances,
    between_events,
    later,
    repeating,
    stacked,
    strobe_of,
    turned_back,
)
from eppanalysis.models.systems.hybrid import HybridSystem

#: Motion of a place, relative to its size, that is rounding: what is measured against it is measured against the size.
_ROUNDING = 1e-9
#: A multiplier as near to 1 as this belongs to a continuum.
_NEUTRAL = 1e-8


@dataclass(frozen=True, eq=False)
class SteadyMotion:
    """Passes that begin each where the one before has ended, the first where the last has, as far as it is steady.

    With an `image`, the map (N, N) of y to its mirror image, the last ends at the image of where the first begins.
    """

    passes: tuple[Pass, ...]
    image: Array | None = None

    @classmethod
    def begun(cls, start: HybridSystem, duration: float) -> SteadyMotion | None:
        """One pass from a start over a duration [s]; None where the run stops early or has too many events."""
        return cls.through([start], [duration])

    @classmethod
    def through(
        cls, starts: Sequence[HybridSystem], durations: Sequence[float], image: Array | None = None
    ) -> SteadyMotion | None:
        """Passes from starts over durations [s]; None where a run stops early or has too many events."""
        passes = []
        for start, duration in zip(starts, durations, strict=True):
            if (one := advance(start, duration)) is None:
                return None
            passes.append(one)
        return cls(tuple(passes), image)

    @property
    def start(self) -> HybridSystem:
        """Where it begins."""
        return self.passes[0].start

    @cached_property
    def duration(self) -> float:
        """Of all passes [s]: the period, or half of it for an image."""
        return float(sum(one.duration for one in self.passes))

    @cached_property
    def begins(self) -> Array:
        """When each pass begins [s], shape (k,)."""
        return np.cumsum([0.0, *(one.duration for one in self.passes[:-1])])

    @cached_property
    def ends(self) -> tuple[HybridSystem, ...]:
        """The system at the end of each pass; at the last, its clocks turned back by the time of them all."""
        *inner, last = (one.run.end(one.start) for one in self.passes)
        return (*inner, turned_back(last, self.start, self.duration))

    @cached_property
    def sought(self) -> IntArray:
        """Places of y that repeat on a steady motion, in their order."""
        return repeating(self.start)

    @property
    def begin(self) -> Array:
        """What repeats, at the start, shape (m,)."""
        return self.passes[0].y[self.sought]

    @cached_property
    def misses(self) -> Array:
        """By how much each pass misses the begin of the next one, the last that of the first, shape (k, m)."""
        ends, begins = [stacked(end) for end in self.ends], [one.y for one in self.passes]
        if self.image is not None:
            ends[-1] = self.image @ ends[-1]
        return np.array([end - begin for end, begin in zip(ends, (*begins[1:], begins[0]), strict=True)])[
            :, self.sought
        ]

    @cached_property
    def _ranges(self) -> Array:
        """Least and largest values of each place of y over all passes, shape (2, N)."""
        told = np.append(np.zeros(self.start.x0.size), advances(self.start)[self.start.x0.size :])
        ranges = np.array([one.range - begin * told for begin, one in zip(self.begins, self.passes, strict=True)])
        return np.array([ranges[:, 0].min(axis=0), ranges[:, 1].max(axis=0)])

    @property
    def extent(self) -> Array:
        """How far each place of y moves, shape (N,)."""
        return np.asarray(self._ranges[1] - self._ranges[0])

    @cached_property
    def scale(self) -> Array:
        """Size of the motion in the places that repeat, never zero, shape (m,)."""
        moves = self.extent[self.sought]
        size = np.abs(self._ranges[:, self.sought]).max(axis=0)
        return size_of(moves, size)

    @cached_property
    def gap(self) -> float:
        """By how much it is not steady, relative to the motion."""
        return self._gap_in(self.scale)

    def is_nearer(self, other: SteadyMotion, share: float) -> bool:
        """Whether it is nearer to be steady, by a share, relative to either motion: none is as it grows or shrinks."""
        return self._gap_in(other.scale) < share * other.gap and self.gap < share * other.gap

    def _gap_in(self, scale: Array) -> float:
        return float((np.abs(self.misses) / scale).max(initial=0.0))

    @cached_property
    def ends_in_its_modes(self) -> bool:
        """Whether elements begin each pass in the modes in which the one before ends (at an image they have others)."""
        own = len(self.start.elements)
        ends = [end.modes0[:own] for end in self.ends]
        begins = [one.start.modes0[:own] for one in (*self.passes[1:], self.passes[0])]
        pairs = list(zip(ends, begins, strict=True))
        return all(np.array_equal(end, begin) for end, begin in pairs[: None if self.image is None else -1])

    @cached_property
    def blocks(self) -> Array:
        """Derivative of each pass among what repeats, in sizes of the motion, shape (k, m, m)."""
        D = np.array([one.derivative for one in self.passes])
        if self.image is not None:
            D[-1] = self.image @ D[-1]
        return np.asarray(D[:, self.sought[:, None], self.sought] / self.scale[:, None] * self.scale)

    @cached_property
    def matrix(self) -> Array:
        """Derivative of the end by the start among what repeats, in sizes of the motion, shape (m, m)."""
        product = self.blocks[0]
        for block in self.blocks[1:]:
            product = block @ product
        return product

    @cached_property
    def held(self) -> BoolArray:
        """Which of the places that repeat no event renews, so that the end is the start whatever it is, shape (m,)."""
        return np.asarray(np.all(self.matrix == np.eye(self.sought.size), axis=1))

    @cached_property
    def multipliers(self) -> ComplexArray | None:
        """Floquet multipliers, one for each state of plant and controllers; None where a guard is only touched."""
        if not np.all(np.isfinite(self.matrix)):
            return None
        controllers = strobe_of(self.start)
        own = 0 if controllers is None else sum(len(np.asarray(c.x0)) for c in controllers.controllers)
        # What is held has the multiplier 1, apart from all others, which integrators behind it may have, too: together
        # they would come out as roots of rounding.
        rest, ones = np.flatnonzero(~self.held), np.ones(int(np.sum(self.held & self._acts)), complex)
        wanted = int(np.sum(self.start.compared)) + own
        found = multipliers(self.matrix[np.ix_(rest, rest)], np.ones(rest.size), max(wanted, 0))
        values = np.concatenate([found, ones])
        return values[np.argsort(-np.abs(values), kind="stable")][:wanted]

    @property
    def _acts(self) -> BoolArray:
        """Which of the places that repeat another one depends on, shape (m,)."""
        others = self.matrix.copy()
        np.fill_diagonal(others, 0.0)
        return np.asarray(np.any(others != 0.0, axis=0))

    @cached_property
    def one_of_many(self) -> bool:
        """Whether it belongs to a continuum of motions of the same duration."""
        values = self.multipliers
        return values is not None and bool(np.any(np.abs(values - 1.0) < _NEUTRAL))

    @property
    def stable(self) -> bool | None:
        """Whether all multipliers lie inside the unit circle, but the 1 of a continuum; None where there are none."""
        return None if self.multipliers is None else is_stable(self.multipliers, self.one_of_many)

    @property
    def on_a_border(self) -> bool:
        """Whether a jump only just brings an event about: beyond, the derivative is another one."""
        return any(one.on_a_border for one in self.passes)

    @cached_property
    def slope(self) -> Array:
        """Derivative of `misses` by the logarithm of the duration, shape (k, m)."""
        n, slope = self.start.x0.size, np.zeros((len(self.passes), self.passes[0].y.size))
        slope[:, :n] = [one.duration * one.run.rate_end for one in self.passes]
        slope[-1] -= self.duration * advances(self.start)
        if self.image is not None:
            slope[-1] = self.image @ slope[-1]
        return slope[:, self.sought]

    def moved(
        self, step: Array, longer: float, onto: Callable[[HybridSystem], HybridSystem] = lambda start: start
    ) -> SteadyMotion | None:
        """Passes from starts after a step (k, m) in what repeats, their durations `longer` by a logarithm.

        They are begun `onto` the loop at another value of a parameter, where one changes.

        What does not repeat, and what a pass does not depend on (a speed that sticking holds at zero), is as the pass
        before ends. Of a motion up to its image the image is taken, in which modes are known: those of the end.
        """
        n, before, passes = self.start.x0.size, self.ends[-1], list[Pass]()
        for k, one in enumerate(self.passes):
            if passes:
                before = passes[-1].run.end(passes[-1].start)
            y = one.y.copy()
            y[self.sought] += step[k]
            y = y if self.image is None else self.image @ y
            y[self._ended[k]] = stacked(before)[self._ended[k]]
            new = advance(onto(before.at(y[:n], y[n:], before.modes0)), one.duration * float(np.exp(longer)))
            if new is None:
                return None
            passes.append(new)
        return SteadyMotion(tuple(passes), self.image)

    @cached_property
    def _ended(self) -> BoolArray:
        """Which places of y at the begin of each pass are as the one before ends, shape (k, N)."""
        ended = np.ones((len(self.passes), self.start.x0.size + self.start.H0.size), bool)
        ended[0] = False
        ended[:, self.sought] = ~np.roll(self.blocks, 1, axis=0).any(axis=2)
        return ended

    def quiet(self, parts: int) -> Array:
        """When it is farthest from all events, in each of so many equal parts of its duration [s], shape (parts,)."""
        times = np.concatenate([begin + one.times[1:] for begin, one in zip(self.begins, self.passes, strict=True)])
        return between_events(times, self.duration, parts)

    def placed(self, pieces: int) -> SteadyMotion | None:
        """The same motion in so many passes, each begun where no event is near; None where a run stops early."""
        begins, starts = self.quiet(pieces), []
        for begin in begins:
            k = int(np.searchsorted(self.begins, begin, side="right")) - 1
            if (start := later(self.passes[k].start, begin - self.begins[k])) is None:
                return None
            starts.append(start)
        return SteadyMotion.through(starts, np.diff(begins, append=begins[0] + self.duration).tolist(), self.image)

    def whole(self) -> SteadyMotion | None:
        """Of a motion up to its image both halves, the second begun at the images of the first."""
        if self.image is None:
            return self
        second = self.moved(np.zeros((len(self.passes), self.sought.size)), 0.0)
        return None if second is None else SteadyMotion(self.passes + second.passes)


def size_of(moves: Array, most: Array) -> Array:
    """Size of a motion in places that move so far and are so far from zero at most; never zero."""
    return np.where(moves > _ROUNDING * most, moves, np.where(most > 0.0, most, 1.0))
