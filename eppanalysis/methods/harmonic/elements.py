"""One element under a periodic input: its automaton run over exact switching phases to the periodic regime.

The input is a truncated Fourier series, so each guard of the element's automaton is one too (as long as the element
stays in one mode), and is monotone between its extrema: the next switch is found to rounding. The automaton is run over
whole periods until it repeats itself.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any

import numpy as np

from eppanalysis.arrays import Array, BoolArray, ComplexArray, IntArray
from eppanalysis.engine.harmonics import ENDLESS, Table, settle
from eppanalysis.errors import ModelError
from eppanalysis.methods.harmonic.series import TURN, sampled
from eppanalysis.models.elements.automaton import Automaton, Guard
from eppanalysis.models.elements.base import Nonlinearity, automaton_of, is_hashable


class Unsettled(Exception):
    """An element does not answer periodically, or switches without end; carries the reason."""


@dataclass(frozen=True, eq=False)
class Row:
    """An affine function of inputs: on the free series, on their derivatives by time, on the clock."""

    on_free: Array
    on_rate: Array
    on_clock: float

    @property
    def empty(self) -> bool:
        """Whether it does not depend on any series."""
        return not (np.any(self.on_free) or np.any(self.on_rate))


@dataclass(frozen=True, eq=False)
class ModeGuard:
    """A guard in its mode, with the output inserted: ``row @ inputs + on_memory @ h + constant``.

    `number` is its own among those of the mode.
    """

    guard: Guard
    number: int
    target: int
    row: Row
    on_memory: Array
    constant: float


@dataclass(frozen=True, eq=False)
class Switch:
    """One event of the periodic regime: phase, mode guard, mode and memory values after it."""

    phase: float
    mode_guard: ModeGuard
    mode: int
    memory: Array


@dataclass(frozen=True, eq=False)
class Regime:
    """The periodic regime of an element from phase `start` on."""

    element: PeriodicElement
    start: float  # phase at its beginning
    mode: int  # at its beginning, as the memory values
    memory: Array  # (h,)
    #: phases, fired, holds: (s,), (s,), (s, h): phase of each switch of one period, the row of its mode guard in the
    #: element's table, memory values behind it.
    phases: Array
    fired: IntArray
    holds: Array

    @cached_property
    def switches(self) -> tuple[Switch, ...]:
        """Those of one period, in order."""
        found = zip(self.phases.tolist(), self.fired.tolist(), self.holds, strict=True)
        of = self.element.mode_guard
        return tuple(Switch(at, of(i), of(i).target, h) for at, i, h in found)

    @property
    def memory_at_zero(self) -> Array:
        """Memory values at phase zero (and every whole turn)."""
        before = np.searchsorted(self.phases, np.ceil(self.start / TURN) * TURN, side="right")
        return np.asarray(self.holds[before - 1] if before else self.memory)

    @property
    def stored_at_zero(self) -> float | tuple[float, ...] | None:
        """The same as the element takes it at a start: all of them where it remembers a list, else the first."""
        stored = self.memory_at_zero.tolist()
        if self.element.element.remembers_a_list:
            return tuple(stored)
        return stored[0] if stored else None


class PeriodicElement:
    """An element with the roles of its inputs: free series, the rate of the first one, or a clock.

    Parameters
    ----------
    element : Nonlinearity
    roles : sequence of {"free", "rate", "clock"}
        One for each input; the first is free.

    Raises
    ------
    ModelError
        If the element uses a rate or a clock in a way that harmonic balance does not cover.
    """

    @classmethod
    def of(cls, element: Nonlinearity, roles: tuple[str, ...]) -> PeriodicElement:
        """As the constructor; elements that are equal share what has been made of one of them.

        Loops are built by the hundred that differ in one element or in none.
        """
        return _shared(element, roles) if is_hashable(element) else cls(element, roles)

    def __init__(self, element: Nonlinearity, roles: Sequence[str]) -> None:
        self.element, self.roles = element, tuple(roles)
        self.automaton: Automaton = automaton_of(element)
        self.name = type(element).__name__
        self.n_free = self.roles.count("free")
        if self.automaton.has_impulses:
            raise ModelError(
                f"{self.name}: a state that jumps where it is reset is no Fourier series of low order",
                expected="the exact orbit instead of a harmonic balance",
            )
        if self.n_free > 1:
            raise ModelError(
                f"{self.name}: a harmonic balance does not cover an element that reads a state of the loop beside its "
                "input",
                expected="one that reads its input alone, or a search, a run or the exact orbit",
            )
        a = self.automaton
        self.smooth = [(s, self.row(s.on_input)) for s in a.smooth]
        if np.any(self._by_role(a.mode_columns["from_input"])[2]):
            raise ModelError(f"{self.name}: an output that grows with time has no Fourier series.")
        sticking = a.mode_columns["sticking"]
        #: Numbers of the guards of all modes that do not stick, by mode.
        self.guards = a.by_mode[~sticking[a.guard_columns["mode"][a.by_mode]]]
        self.start_mode = int(np.argmin(sticking)) if sticking[a.start_mode] else a.start_mode
        self.table = self._table()
        self._made: dict[int, ModeGuard] = {}
        self.clocked = bool(np.any(self.table.on_clock))

    def mode_guard(self, number: int) -> ModeGuard:
        """Mode guard in a row of the table; it is made once."""
        if number not in self._made:
            t, guard = self.table, self.automaton.guards[int(self.guards[number])]
            row = self.row(guard.on_input + guard.on_output @ self.automaton.modes[guard.mode].from_input)
            row = Row(row.on_free, row.on_rate + self.row(guard.on_rate).on_free, row.on_clock)
            of_mode = number - int(t.first[guard.mode])
            constant, target = float(t.constant[number]), int(t.target[number])
            self._made[number] = ModeGuard(guard, of_mode, target, row, t.on_memory[number], constant)
        return self._made[number]

    def guard_of(self, mode: int, number: int) -> ModeGuard:
        """Mode guard of a mode by its own number there.

        Raises
        ------
        IndexError
            If there is none.
        """
        first = self.table.first
        if not (0 <= mode < first.size - 1 and 0 <= number < first[mode + 1] - first[mode]):
            raise IndexError(number)
        return self.mode_guard(int(first[mode]) + number)

    def _outputs(self) -> dict[str, Array]:
        """What the outputs are in each mode, as the table holds it."""
        columns = self.automaton.mode_columns
        free, rate, _ = self._by_role(columns["from_input"])
        parts = (free, rate, columns["from_memory"], columns["constant"])
        names = ("w_free", "w_rate", "w_memory", "w_constant")
        return {name: np.ascontiguousarray(part, float) for name, part in zip(names, parts, strict=True)}

    def _table(self) -> Table:
        """The mode guards as the compiled run takes them, the outputs of their modes inserted."""
        a = self.automaton
        of = {name: column[self.guards] for name, column in a.guard_columns.items()}
        modes = {name: column[of["mode"]] for name, column in a.mode_columns.items()}

        def of_output(part: str) -> Array:
            return np.asarray(np.einsum("go,go...->g...", of["on_output"], modes[part]))

        free, rate, clock = self._by_role(of["on_input"] + of_output("from_input"))
        by_rate = self._by_role(of["on_rate"])
        rate = rate + by_rate[0]
        sticks = a.mode_columns["sticking"][of["target"]]
        target = np.where(sticks, of["bypass"], of["target"])
        # The force at rest is no function of the input: what would stick passes on to the mode beyond
        # (docs/theory/harmonic_balance.md, What it cannot do).
        self._refuse(target < 0, "leads to sticking only, which needs the loop's states")
        self._refuse(np.any(of_output("from_smooth") != 0.0, axis=1), "depends on a smooth output")
        self._refuse((by_rate[1] != 0.0) | (by_rate[2] != 0.0), "depends on the rate of a rate or of a clock")
        self._refuse((clock != 0.0) & ((free != 0.0) | (rate != 0.0)), "depends on a clock and an input at once")
        free_series, rate_series, series, factor = _series_of(free, rate)
        return Table(
            roles=np.array([("free", "rate", "clock").index(role) for role in self.roles], np.int64),
            first=np.concatenate([[0], np.cumsum(np.bincount(of["mode"], minlength=len(a.modes)))]),
            series=series,
            factor=factor,
            constant=of["constant"] + of_output("constant"),
            on_memory=of["on_memory"] + of_output("from_memory"),
            on_clock=clock,
            target=target,
            from_input=of["memory_from_input"],
            from_memory=of["memory_from_memory"],
            memory_constant=of["memory_constant"],
            on_free=free,
            on_rate=rate,
            free_series=free_series,
            rate_series=rate_series,
            **self._outputs(),
        )

    def _refuse(self, wrong: BoolArray, why: str) -> None:
        for number in self.guards[wrong][:1]:
            raise ModelError(f"{self.name}: {self.automaton.guards[int(number)].name!r} {why}.")

    def _by_role(self, on_input: Array) -> tuple[Array, Array, Array]:
        """From weights on all inputs, the last axis, to those on the free one, on its rate and on the clock."""
        roles = np.array(self.roles)
        free, rate, clock = (on_input[..., roles == role].sum(axis=-1) for role in ("free", "rate", "clock"))
        return free, rate, clock

    def row(self, on_input: Array) -> Row:
        """Inputs by their roles."""
        free, rate, clock = self._by_role(on_input)
        return Row(np.array([free]), np.array([rate]), float(clock))

    def regime(self, Z: ComplexArray, omega: float) -> Regime:
        """Periodic regime under the free inputs Z, shape (n_free, n + 1), at `omega` [rad/s].

        Raises
        ------
        Unsettled
            If the automaton does not repeat itself within six periods.
        """
        return self.regime_of(*settle(*self.asked(Z, omega)))

    def asked(self, Z: ComplexArray, omega: float) -> tuple[Any, ...]:
        """What the engine is given to find the regime under the free inputs Z."""
        return self.table, Z[0], omega, self.start_mode, self.clocked, self.rest(Z, omega)

    def regime_of(
        self, count: int, mode: int, start: float, memory: Array, phases: Array, fired: IntArray, holds: Array
    ) -> Regime:
        """The regime that :func:`eppanalysis.engine.harmonics.settle` returns.

        Raises
        ------
        Unsettled
            If there is none.
        """
        if count < 0:
            why = "switches without end" if count == ENDLESS else "does not answer with the period of its input"
            raise Unsettled(f"{self.name} {why}.")
        return Regime(self, start, mode, memory, phases, fired, holds)

    def rest(self, Z: ComplexArray, omega: float) -> Array:
        """Memory values (h,) with which it rests under the free inputs Z."""
        memory = self.automaton.start_memory
        if self.clocked or not memory.size:
            return memory
        rest = rest_value(self.element, Z, omega)
        return memory if rest is None else np.concatenate([[rest], memory[1:]])


def _series_of(free: Array, rate: Array) -> tuple[Array, Array, IntArray, Array]:
    """The few series that guards are multiples of.

    Parameters
    ----------
    free, rate : arrays, shape (g,)
        What each guard is of the free series and of its rate.

    Returns
    -------
    free_series, rate_series : arrays, shape (S,)
        The same of the series.
    number : int array, shape (g,)
        Of the series of each guard, -1 for a guard without.
    factor : array, shape (g,)
    """
    weights = np.column_stack([free, rate])
    factor = weights[np.arange(free.size), np.argmax(np.abs(weights), axis=1)]
    shape = weights / np.where(factor == 0.0, 1.0, factor)[:, None]
    number = np.full(free.size, -1)
    series: list[Array] = []
    # Guards that are multiples of one series share it, and the search for its extrema.
    while np.any(left := (number < 0) & (factor != 0.0)):
        first = np.argmax(left)
        series.append(shape[first])
        same = np.all(np.isclose(series[-1], shape, rtol=1e-15, atol=0.0), axis=1)
        same[first] = True  # where a weight is not a number, too
        number[left & same] = len(series) - 1
    free_series, rate_series = np.array(series).reshape(-1, 2).T.copy()
    return free_series, rate_series, number, factor


@lru_cache(maxsize=256)
def _shared(element: Nonlinearity, roles: tuple[str, ...]) -> PeriodicElement:
    return PeriodicElement(element, roles)


def rest_value(element: Nonlinearity, Z: ComplexArray, omega: float) -> float | None:
    """Memory value that an element takes where the input does not move it: the one its describing function
    documents.
    """
    half_range = float(np.ptp(sampled(Z[0], max(32, 8 * Z.shape[1])))) / 2
    mean, _ = element.describing_function(half_range, float(Z[0, 0].real), omega)
    return element.memory_of(np.atleast_1d(np.asarray(mean, float)))
