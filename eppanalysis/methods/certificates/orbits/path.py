"""A closed sequence of events in exact arithmetic: its arcs on the unknowns of shooting, and which rows vanish.

The unknowns v of an arc are the places of y that move, with a 1 behind them; inputs that are held, and memory values
that no event renews, are numbers. Whether a guard is exactly zero behind an event is decided by rows: it is where its
row, carried back to the end of the last arc that takes time, is a combination of the row of the guard that fired there
and of those of the inputs that are stuck.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from eppanalysis.arrays import Array, BoolArray, IntArray
from eppanalysis.methods.certificates.numbers import NotCovered
from eppanalysis.methods.certificates.orbits.modes import ExactMode, ExactModes, in_span, rational
from eppanalysis.methods.orbits.arcs import LETS_GO
from eppanalysis.methods.orbits.orbit import Orbit
from eppanalysis.models.systems.hybrid import HybridSystem

#: Share of the period that is taken for none; what follows then has to be proved to happen without delay.
_NO_TIME = 1e-13


@dataclass(frozen=True)
class Stage:
    """One arc, on the unknowns v."""

    rate: Any  # (m + 1, m + 1): ``dv/dt = rate v``
    guards: tuple[tuple[int, Any], ...]  # guards in the order in which they are looked at
    fired: int  # number of the guard at whose event the arc ends
    jump: Any  # (m + 1, m + 1): map of the event
    levels: dict[int, Any]  # for each element that sticks: its input less its level
    at_once: bool  # whether the event follows the one before without delay

    @property
    def fired_row(self) -> Any:
        """Row of the guard that ends the arc."""
        return dict(self.guards)[self.fired]


@dataclass(frozen=True)
class Course:
    """Through which modes and events a cycle goes."""

    modes: IntArray  # (p, elements): mode of every element on each arc
    guards: IntArray  # (p,): number of the guard at whose event each arc ends
    at_once: BoolArray  # (p,): whether the event follows the one before without delay
    free: tuple[int, ...]  # places of y that are unknown


@dataclass(frozen=True)
class ExactPath:
    """The arcs of an orbit in rationals."""

    hybrid: HybridSystem
    stages: tuple[Stage, ...]
    free: tuple[int, ...]  # places of y that are unknown
    timed: tuple[int, ...]  # arcs that take time
    continuum: bool  # whether a memory value that no event renews acts on the motion
    course: Course
    held: dict[int, Any]  # memory values that no event renews, by their places in y
    #: For each arc that takes time: rows that are zero at its end.
    vanishing: dict[int, list[Any]] = field(default_factory=dict)

    @classmethod
    def of(cls, orbit: Orbit) -> ExactPath:
        """The path of an orbit that is closed in floats.

        Raises
        ------
        NotCovered
            For events that the proof does not cover.
        """
        sequence = orbit.arcs.event_sequence
        if np.any(sequence.at_once == LETS_GO):
            raise NotCovered("An element releases because its input is about to jump; such events are not covered.")
        at_once = (sequence.at_once == 1) | (np.abs(orbit.tau) <= _NO_TIME * orbit.period)
        free = tuple(int(i) for i in orbit.arcs.free)
        return cls.along(orbit.hybrid, Course(sequence.modes, sequence.guards, at_once, free), orbit.y)

    @classmethod
    def along(cls, hybrid: HybridSystem, course: Course, y: Array) -> ExactPath:
        """The path of a course of events.

        Parameters
        ----------
        y : array, shape (N,)
            Of which the places that are not unknown are read.

        Raises
        ------
        NotCovered
            For events that the proof does not cover, or that are not those of the system.
        """
        if all(course.at_once):
            raise NotCovered("All events of the cycle fall on one instant.")
        made = _Reduction(hybrid, course, y)
        stages = tuple(made.stage(a) for a in range(len(course.guards)))
        timed = tuple(a for a, instant in enumerate(course.at_once) if not instant)
        path = cls(hybrid, stages, made.free, timed, made.continuum, course, dict(made.held))
        path._find_vanishing()
        for a in range(len(stages)):
            made.require_event(path, a)
        return path

    @property
    def m(self) -> int:
        """Number of unknowns at an event."""
        return len(self.free)

    @property
    def moving(self) -> list[int]:
        """Which unknowns are states: the others are memory values, which keep theirs between events."""
        return [i for i, place in enumerate(self.free) if place < self.hybrid.x0.size]

    def since(self, arc: int) -> tuple[int, Any]:
        """The last arc before that takes time, and the map from its end to the start of `arc`."""
        back = (arc - 1) % len(self.stages)
        through = self.stages[back].jump
        while self.stages[back].at_once:
            back = (back - 1) % len(self.stages)
            through = through * self.stages[back].jump
        return back, through

    def zero_at_start(self, arc: int, row: Any) -> bool:
        """Whether a row is zero at the start of an arc by the equations of the orbit."""
        before, through = self.since(arc)
        return in_span(row * through, self.vanishing[before])

    def zero_at_end(self, arc: int, row: Any) -> bool:
        """Whether a row is zero at the end of an arc by the equations of the orbit."""
        if self.stages[arc].at_once:
            return self.zero_at_start(arc, row)
        return in_span(row, self.vanishing[arc])

    def guard_name(self, guard: int) -> str:
        """Element and event of a guard, for people."""
        element = int(self.hybrid.model.guard_element[guard])
        return f"{self.hybrid.element_names[element]}: {self.hybrid.guard_name(guard)}"

    def in_basis(self, basis: Any) -> ExactPath:
        """The same path with other unknowns u, where ``v = basis u``, exactly.

        Parameters
        ----------
        basis : fmpq_mat, shape (m + 1, m + 1)
            That leaves the 1, and apart from one another states and memory values.
        """
        back = basis.inv()
        stages = tuple(
            replace(
                stage,
                rate=back * stage.rate * basis,
                guards=tuple((g, row * basis) for g, row in stage.guards),
                jump=back * stage.jump * basis,
                levels={e: row * basis for e, row in stage.levels.items()},
            )
            for stage in self.stages
        )
        vanishing = {a: [row * basis for row in rows] for a, rows in self.vanishing.items()}
        return replace(self, stages=stages, vanishing=vanishing)

    def _find_vanishing(self) -> None:
        """Rows of guards that fired, and of stuck inputs as far as they can be traced back to the event they stuck at.

        A stuck input is on its level at the end of an arc if it does so at its start and its rate is the zero row.
        """
        for a in self.timed:
            self.vanishing[a] = [self.stages[a].fired_row]
        open_ = [(a, row) for a in self.timed for row in self.stages[a].levels.values()]
        while open_:
            known = [item for item in open_ if self._stands(*item)]
            if not known:
                raise NotCovered(
                    "It cannot be shown that a sticking element is exactly on its level; where it sticks all the "
                    "time, no event puts it there."
                )
            for a, row in known:
                self.vanishing[a].append(row)
            open_ = [item for item in open_ if not any(item is one for one in known)]

    def _stands(self, arc: int, row: Any) -> bool:
        still = all(v == 0 for v in (row * self.stages[arc].rate).tolist()[0])
        return still and self.zero_at_start(arc, row)


class _Reduction:
    """From y to the unknowns v; lives while a path is made."""

    def __init__(self, hybrid: HybridSystem, course: Course, y: Array) -> None:
        from flint import fmpq_mat

        self.hybrid, self.exact = hybrid, ExactModes(hybrid)
        self.course, self.model = course, hybrid.model
        self.free = course.free
        m, N, zero = len(self.free), self.exact.size, rational(0.0)
        rows = [[zero] * (m + 1) for _ in range(N)]
        for i in range(N):
            rows[i][m] = rational(y[i])
        for k, i in enumerate(self.free):
            rows[i][m], rows[i][k] = zero, rational(1.0)
        self.spread = fmpq_mat(rows)
        self.fixed = [i for i in range(N) if i not in self.free]
        n, count = self.exact.n, int(self.model.first[-1, 2])
        self.idle = [i for i in self.fixed if n <= i < n + count]
        self.held = [(i, rational(y[i])) for i in self.idle]
        self.continuum = False

    def stage(self, arc: int) -> Stage:
        """An arc with the event at its end."""
        from flint import fmpq_mat

        guard = int(self.course.guards[arc])
        before, after = self.mode(arc), self.course.modes[(arc + 1) % len(self.course.guards)]
        if guard < 0 or guard not in dict(before.guards):
            raise NotCovered("The sequence has an event that the modes of its arc do not have.")
        rate = (before.rate * self.spread).tolist()
        if any(v != 0 for i in self.fixed if i < self.exact.n for v in rate[i]):
            moved = "a clock, or an unobservable integral"
            raise NotCovered(f"The loop has a state that is not periodic ({moved}); a proof needs that all are.")
        # A value that no event renews and that moves the states: there is a cycle for each of its values.
        self.continuum |= any(before.rate[i, j] != 0 for i in range(self.exact.n) for j in self.idle)
        jump = (self.exact.event(before, guard, int(after[self.element(guard)])) * self.spread).tolist()
        if any(jump[i] != self.spread.tolist()[i] for i in self.fixed):
            raise NotCovered("An event changes a value that the cycle should keep.")
        m = len(self.free)
        last = [rational(float(j == m)) for j in range(m + 1)]
        zero = [rational(0.0)] * (m + 1)
        return Stage(
            fmpq_mat([*(rate[i] if i < self.exact.n else zero for i in self.free), zero]),
            tuple((g, row * self.spread) for g, row in before.guards),
            guard,
            fmpq_mat([*(jump[i] for i in self.free), last]),
            {e: row * self.spread for e, row in before.levels.items()},
            bool(self.course.at_once[arc]),
        )

    def mode(self, arc: int) -> ExactMode:
        """The combination of modes on an arc."""
        return self.exact.mode(self.course.modes[arc % len(self.course.guards)])

    def element(self, guard: int) -> int:
        """The element that a guard belongs to."""
        return int(self.model.guard_element[guard])

    def require_event(self, path: ExactPath, arc: int) -> None:
        """The event at the end of an arc is one of the loop.

        Raises
        ------
        NotCovered
            If another mode follows, what should stick is not on its level there, or a jump reaches an element that
            follows its input or sticks.
        """
        guard = path.stages[arc].fired
        e, name = self.element(guard), path.guard_name(guard)
        before, after = self.course.modes[arc], self.course.modes[(arc + 1) % len(path.stages)]
        expected = before.copy()
        expected[e] = self.model.guard_target[guard]
        if not np.array_equal(after, expected):
            raise NotCovered(f"The mode behind the event '{name}' is not the one that it leads to.")
        if self.exact.sticks(e, int(after[e])):
            automaton = self.hybrid.automata[e]
            if not self.exact.pull(e) * rational(float(automaton.modes[int(after[e])].jump)) < 0:
                raise NotCovered(f"'{name}': the loop does not pull the input back against the jump there.")
            if not path.zero_at_end(arc, self.exact.level(e, int(after[e])) * self.spread):
                raise NotCovered(f"'{name}': the input is not exactly on the level that it should stick to.")
        self._require_no_jump(path, arc, e, before)

    def _require_no_jump(self, path: ExactPath, arc: int, source: int, before: Sequence[int]) -> None:
        """Elements that follow their input, or stick, and that the event reaches, meet no jump."""
        for e in range(len(before)):
            lags = self.model.mode_lags[self.model.mode_first[e] + before[e]]
            if e == source or not (lags and self.model.reach[source, e]):
                continue
            for z in range(int(self.model.first[e, 0]), int(self.model.first[e + 1, 0])):
                old = self._input(arc, z)
                new = self._input(arc + 1, z) * path.stages[arc].jump
                if not path.zero_at_end(arc, new - old):
                    names = self.hybrid.element_names
                    raise NotCovered(f"A jump of {names[source]} reaches {names[e]}, which follows its input.")

    def _input(self, arc: int, z: int) -> Any:
        from flint import fmpq_mat

        return fmpq_mat([self.mode(arc).inputs.tolist()[z]]) * self.spread
