"""A closed sequence of events in exact arithmetic: its arcs on the unknowns of shooting, and which rows vanish.

The unknowns v of an arc are the places of y that move, with a 1 behind them; inputs that are held, memory values that
no event renews, and counts of samples are numbers. What tells the time moves, too: the clock of sampled controllers is
a state that every sample sets back to zero, and a sine with its cosine are two states that each zero of the sine sets
to what they are there, exactly. So a motion that is locked to samples or to a sine closes as any other does, and the
time of its events is that of guards like any other.

Whether a guard is exactly zero behind an event is decided by rows: it is where its
row, carried back to the end of the last arc that takes time, is a combination of the row of the guard that fired there
and of those of the inputs that are stuck.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import accumulate, chain
from typing import Any, Protocol

import numpy as np

from eppanalysis.arrays import Array, BoolArray, IntArray
from eppanalysis.methods.certificates.numbers import NotCovered
from eppanalysis.methods.certificates.orbits.modes import ExactMode, ExactModes, as_row, in_span, rational
from eppanalysis.methods.orbits.arcs import LETS_GO
from eppanalysis.methods.orbits.orbit import Orbit
from eppanalysis.models.systems.hybrid import HybridSystem
from eppanalysis.models.systems.sampled.strobe import Strobe

#: Share of the period that is taken for none; what follows then has to be proved to happen without delay.
_NO_TIME = 1e-13


class Closed(Protocol):
    """What the proof takes of an orbit that is closed in floats, beside its course."""

    @property
    def hybrid(self) -> HybridSystem:
        """The loop."""

    @property
    def y(self) -> Array:
        """State and memory values at the start, shape (N,)."""

    @property
    def starts(self) -> Array:
        """The same behind each event, shape (p + 1, N)."""

    @property
    def tau(self) -> Array:
        """Times between the events [s], shape (p,)."""

    @property
    def scale(self) -> Array:
        """Size of the motion in each place, never zero, shape (N,)."""

    @property
    def period(self) -> float:
        """Period [s]."""


@dataclass(frozen=True)
class Stage:
    """One arc, on the unknowns v."""

    rate: Any  # (m + 1, m + 1): ``dv/dt = rate v``
    guards: tuple[tuple[int, Any], ...]  # guards in the order in which they are looked at
    fired: int  # number of the guard at whose event the arc ends
    jump: Any  # (m + 1, m + 1): map of the event
    levels: dict[int, Any]  # for each element that sticks: its input less its level
    at_once: bool  # whether the event follows the one before without delay
    #: Whether the guards are those at a jump: of each element that follows its input, on the way of the input by the
    #: jump in place of its rate, and a 1 for the event itself, which comes where none of these does.
    at_jump: bool = False

    @property
    def fired_row(self) -> Any:
        """Row of the guard that ends the arc."""
        return dict(self.guards)[self.fired]


def together(tau: Array, period: float) -> BoolArray:
    """Which of the times between events are none."""
    return np.asarray(np.abs(tau) <= _NO_TIME * period)


@dataclass(frozen=True)
class Course:
    """Through which modes and events a cycle goes."""

    modes: IntArray  # (p, elements): mode of every element on each arc
    guards: IntArray  # (p,): number of the guard at whose event each arc ends
    at_once: BoolArray  # (p,): whether the event follows the one before without delay
    free: tuple[int, ...]  # places of y that are unknown
    sine: int | None = None  # place of the sine that drives the loop, before that of its cosine


class ClosedOnCourse(Closed, Protocol):
    """The same that tells its course."""

    @property
    def course(self) -> Course:
        """Modes and events."""


@dataclass(frozen=True)
class ExactPath:
    """The arcs of an orbit in rationals."""

    hybrid: HybridSystem
    stages: tuple[Stage, ...]
    free: tuple[int, ...]  # places of y that are unknown
    timed: tuple[int, ...]  # arcs that take time
    continuum: bool  # whether a memory value that no event renews acts on the motion
    course: Course
    held: dict[int, Any]  # memory values that no event renews, and counts at the start, by their places in y
    places: tuple[int, ...]  # of the stage that ends with each event of the course
    #: For each arc that takes time: rows that are zero at its end.
    vanishing: dict[int, list[Any]] = field(default_factory=dict)

    @classmethod
    def of(cls, orbit: Orbit | ClosedOnCourse) -> ExactPath:
        """The path of an orbit that is closed in floats.

        Raises
        ------
        NotCovered
            For events that the proof does not cover.
        """
        if not isinstance(orbit, Orbit):
            return cls.along(orbit.hybrid, orbit.course, orbit.y)
        sequence = orbit.arcs.event_sequence
        if np.any(sequence.at_once == LETS_GO):
            raise NotCovered("An element releases because its input is about to jump; such events are not covered.")
        at_once = (sequence.at_once == 1) | together(orbit.tau, orbit.period)
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
        groups = [made.stages(a) for a in range(len(course.guards))]
        places = tuple(accumulate(map(len, groups), initial=-1))[1:]
        stages = tuple(chain.from_iterable(groups))
        timed = tuple(a for a, stage in enumerate(stages) if not stage.at_once)
        path = cls(hybrid, stages, made.free, timed, made.continuum, course, dict(made.held), places)
        path._find_vanishing()
        for a in range(len(groups)):
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

    @property
    def timed_events(self) -> list[int]:
        """Events of the course before which the arcs lie that take time."""
        return [bisect_left(self.places, a) for a in self.timed]

    def on_rates(self, arc: int, guard: int) -> bool:
        """Whether a guard of an arc is one on rates."""
        return bool(np.any(self.hybrid.model.guard_rate[guard])) and not self.stages[arc].at_jump

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
        return _name_of(self.hybrid, guard)

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
        self.spreads = [fmpq_mat(rows)]  # from v to y on each arc; they differ by memory values that are no unknowns
        self.fixed = [i for i in range(N) if i not in self.free]
        n, count = self.exact.n, int(self.model.first[-1, 2])
        self.idle = [i for i in self.fixed if n <= i < n + count]
        self.held = [(i, rational(y[i])) for i in self.idle]
        self.continuum = False
        self.clock, self.counts = _clock(hybrid, self.free)

    def stages(self, arc: int) -> list[Stage]:
        """An arc with the event at its end; where that makes an input jump that is followed, both by themselves."""
        from flint import fmpq_mat

        stage, size = self.stage(arc), range(len(self.free) + 1)
        cause = int(self.course.guards[(arc + 1) % len(self.course.guards)] if self._lets_go(arc) else stage.fired)
        rows = self._left_behind(arc, cause)
        if not rows and cause == stage.fired and not self._lets_go(arc - 1):
            return [stage]
        always, none = (fmpq_mat([[int(i == j) for j in size] for i in of]) for of in (size[-1:], size))
        jump = replace(stage, guards=(*rows, (cause, always)), at_once=True, at_jump=True)
        if cause not in dict(stage.guards) or stage.fired not in dict(jump.guards):
            raise NotCovered(f"'{_name_of(self.hybrid, stage.fired)}' is no effect of a jump.")
        # Behind what has let go the jump is still to come: no other event is between.
        if self._lets_go(arc - 1):
            return [jump]
        return [replace(stage, fired=cause, jump=none), jump]

    def _lets_go(self, arc: int) -> bool:
        """Whether the event of an arc is that of an element whose input the next event is about to make jump."""
        p = len(self.course.guards)
        guard, cause = int(self.course.guards[arc % p]), int(self.course.guards[(arc + 1) % p])
        e, source = self.element(guard), self.element(cause)
        caused = e != source and bool(self.course.at_once[(arc + 1) % p]) and bool(self.model.reach[source, e])
        return caused and bool(np.any(self.model.guard_rate[guard]))

    def _left_behind(self, arc: int, cause: int) -> list[tuple[int, Any]]:
        """Guards on rates of elements that follow an input, with rows on the way of that by the jump of an event.

        Raises
        ------
        NotCovered
            If another element between could switch by the jump, too.
        """
        model, before, source = self.model, self.course.modes[arc], self.element(cause)
        after, rows = before.copy(), []
        after[source] = model.guard_target[cause]
        old, new = self.exact.mode(before), self.exact.mode(after)
        jump = self.exact.event(old, cause, int(after[source]))
        for e in model.order.tolist():
            m = int(model.mode_first[e]) + int(before[e])
            follows = model.mode_lags[m] and not self.exact.sticks(e, int(before[e]))
            if e == source or not (follows and model.reach[source, e]):
                continue
            z, way = int(model.first[e, 0]), (new.inputs * jump - old.inputs) * self.spreads[arc]
            for g in range(int(model.guard_first[m]), int(model.guard_first[m + 1])):
                weights = [rational(v) for v in model.guard_rate[g].tolist()]
                still = as_row([0] * (len(self.free) + 1))
                row = sum((as_row(way.tolist()[z + a]) * w for a, w in enumerate(weights) if w != 0), still)
                if any(v != 0 for v in row.tolist()[0]):
                    self._require_straight(source, e)
                    rows.append((g, row))
        return rows

    def _require_straight(self, source: int, e: int) -> None:
        """No element that switches lies between one that jumps and one that follows."""
        model = self.model
        for other in range(len(self.hybrid.automata)):
            between = other not in (source, e) and model.reach[source, other] and model.reach[other, e]
            if between and len(self.hybrid.automata[other].guards):
                names = self.hybrid.element_names
                raise NotCovered(
                    f"A jump of {names[source]} reaches {names[e]}, which follows its input, by way of {names[other]}."
                )

    def stage(self, arc: int) -> Stage:
        """An arc with the event at its end."""
        from flint import fmpq_mat

        guard = int(self.course.guards[arc])
        before, after = self.mode(arc), self.course.modes[(arc + 1) % len(self.course.guards)]
        if guard < 0 or guard not in dict(before.guards):
            raise NotCovered("The sequence has an event that the modes of its arc do not have.")
        spread = self.spreads[arc]
        rate = (before.rate * spread).tolist()
        if any(v != 0 for i in self.fixed if i < self.exact.n for v in rate[i]):
            moved = "a clock, or an unobservable integral"
            raise NotCovered(f"The loop has a state that is not periodic ({moved}); a proof needs that all are.")
        event = self.exact.event(before, guard, int(after[self.element(guard)]))
        self.continuum |= self._holds(before.rate, dict(before.guards)[guard], event)
        guards = tuple((g, row * spread) for g, row in before.guards)
        jump = (event * spread).tolist()
        self._tell_time(jump, guard, dict(guards)[guard].tolist()[0])
        self.spreads.append(self._following(arc, jump))
        m = len(self.free)
        last = [rational(float(j == m)) for j in range(m + 1)]
        zero = [rational(0.0)] * (m + 1)
        return Stage(
            fmpq_mat([*(rate[i] if i < self.exact.n else zero for i in self.free), zero]),
            guards,
            guard,
            fmpq_mat([*(jump[i] for i in self.free), last]),
            {e: row * spread for e, row in before.levels.items()},
            bool(self.course.at_once[arc]),
        )

    def _holds(self, rate: Any, fired: Any, event: Any) -> bool:
        """Whether a value that the motion does not determine acts on it: there is a cycle for each of its values."""
        values = [j for j in self.idle if j not in self.counts]
        others = [[v if i != j else 0 for j, v in enumerate(row)] for i, row in enumerate(event.tolist())]
        return any(row[j] != 0 for row in (*rate.tolist(), *fired.tolist(), *others) for j in values)

    def _tell_time(self, jump: list[list[Any]], guard: int, fired: list[Any]) -> None:
        """Set the clock back to zero at an event that it brings about, and the sine to what it is at its zeros.

        Parameters
        ----------
        jump : list of lists
            Map of the event, on v, of which rows are changed.
        fired : list
            Row of the guard, on v.
        """
        m = len(self.free)
        if self.clock is not None and (speed := fired[self.free.index(self.clock)]) != 0:
            time = -fired[m] / speed
            for i, per_second in ((self.clock, 1), *self.counts.items()):
                jump[i][m] -= time * per_second
        sine = self.course.sine
        if sine is not None and self.element(guard) == len(self.hybrid.elements) - 1:
            upward = self.model.guard_z[guard, 0] > 0
            for i, value in ((sine, 0.0), (sine + 1, 1.0 if upward else -1.0)):
                jump[i] = [*[rational(0.0)] * m, rational(value)]

    def _following(self, arc: int, jump: list[list[Any]]) -> Any:
        """From v to y on the next arc: with the memory values behind an event, after the last arc those at the start.

        Raises
        ------
        NotCovered
            If a value that is no unknown depends on one, or is another one than it should be.
        """
        from flint import fmpq_mat

        m, rows = len(self.free), self.spreads[arc].tolist()
        first = self.spreads[0].tolist() if arc == len(self.course.guards) - 1 else rows
        for i in self.fixed:
            if any(jump[i][:m]) or (jump[i][m] != first[i][m] and (i not in self.idle or first is not rows)):
                raise NotCovered("An event changes a value that the cycle should keep.")
            rows[i][m] = jump[i][m]
        return fmpq_mat(rows)

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
        guard = int(self.course.guards[arc])
        e, name = self.element(guard), path.guard_name(guard)
        before, after = self.course.modes[arc], self.course.modes[(arc + 1) % len(self.course.guards)]
        expected = before.copy()
        expected[e] = self.model.guard_target[guard]
        if not np.array_equal(after, expected):
            raise NotCovered(f"The mode behind the event '{name}' is not the one that it leads to.")
        if self.exact.sticks(e, int(after[e])):
            automaton = self.hybrid.automata[e]
            if not self.exact.pull(e) * rational(float(automaton.modes[int(after[e])].jump)) < 0:
                raise NotCovered(f"'{name}': the loop does not pull the input back against the jump there.")
            if not path.zero_at_end(path.places[arc], self.exact.level(e, int(after[e])) * self.spreads[arc]):
                raise NotCovered(f"'{name}': the input is not exactly on the level that it should stick to.")
        self._require_no_jump(path, arc, e, before)

    def _require_no_jump(self, path: ExactPath, arc: int, source: int, before: Sequence[int]) -> None:
        """Elements that stick or follow their input meet no jump, but those of which a guard at the jump tells."""
        stage = path.stages[path.places[arc]]
        told = {self.element(g) for g, _ in stage.guards} if stage.at_jump and not self._lets_go(arc) else set()
        for e in range(len(before)):
            lags = self.model.mode_lags[self.model.mode_first[e] + before[e]]
            if e == source or e in told or not (lags and self.model.reach[source, e]):
                continue
            for z in range(int(self.model.first[e, 0]), int(self.model.first[e + 1, 0])):
                old = self._input(arc, z)
                new = self._input(arc + 1, z) * stage.jump
                if not path.zero_at_end(path.places[arc], new - old):
                    names = self.hybrid.element_names
                    raise NotCovered(f"A jump of {names[source]} reaches {names[e]}, which follows its input.")

    def _input(self, arc: int, z: int) -> Any:
        from flint import fmpq_mat

        return fmpq_mat([self.mode(arc).inputs.tolist()[z]]) * self.spreads[arc]


def _name_of(hybrid: HybridSystem, guard: int) -> str:
    """Element and event of a guard, for people."""
    return f"{hybrid.element_names[int(hybrid.model.guard_element[guard])]}: {hybrid.guard_name(guard)}"


def _clock(hybrid: HybridSystem, free: Sequence[int]) -> tuple[int | None, dict[int, Any]]:
    """Place of the clock of sampled controllers in y, where it is unknown, and by how much their counts rise a second.

    Raises
    ------
    NotCovered
        If another element reads the clock.
    """
    strobe, model, counts = Strobe.of(hybrid), hybrid.model, dict[int, Any]()
    if strobe is None or strobe.clock not in free:
        return None, counts
    for e, (z, _, h) in enumerate(model.first[:-1]):
        end = int(model.first[e + 1, 0])
        if e not in strobe.numbers:
            if np.any(model.C[z:end, strobe.clock]):
                raise NotCovered(f"{hybrid.element_names[e]} remembers times; sampled controllers alone may.")
            continue
        for g in np.flatnonzero(model.guard_element == e):
            # The guard is the clock less the count in seconds: what it weighs the count by is the length of a tick.
            for a in np.flatnonzero(model.guard_h[g]):
                counts[hybrid.x0.size + int(h + a)] = -rational(model.guard_z[g, end - 1 - z]) / rational(
                    model.guard_h[g, a]
                )
    return strobe.clock, counts
