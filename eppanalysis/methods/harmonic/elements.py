"""One element under a periodic input: its automaton run over exact switching phases to the periodic regime.

The input is a truncated Fourier series, so each guard of the element's automaton is one too (as long as the element
stays in one mode), and is monotone between its extrema: the next switch is found to rounding. The automaton is run over
whole periods until it repeats itself.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING

import numpy as np

from eppanalysis.errors import ModelError
from eppanalysis.methods.harmonic.series import TURN, Array, ComplexArray, extrema, orders, sampled, workspaces
from eppanalysis.models.elements.automaton import Automaton, Guard
from eppanalysis.models.elements.base import Nonlinearity

if TYPE_CHECKING:
    from eppanalysis.kernels.periodic import Table

_MOST_PERIODS = 6
_EXCURSION = 4.0


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

    `series` numbers the series that all guards are multiples of (`factor`), -1 for none.
    """

    guard: Guard
    target: int
    row: Row
    on_memory: Array
    constant: float
    series: int
    factor: float


@dataclass(frozen=True, eq=False)
class Switch:
    """One event of the periodic regime: phase, mode guard, mode and memory values after it."""

    phase: float
    mode_guard: ModeGuard
    mode: int
    memory: Array


@dataclass(frozen=True, eq=False)
class Regime:
    """The periodic regime from phase `start` on: mode and memory values there, and the switches of one period."""

    start: float
    mode: int
    memory: Array
    switches: tuple[Switch, ...]

    @property
    def memory_at_zero(self) -> Array:
        """Memory values at phase zero (and every whole turn)."""
        turn = np.ceil(self.start / TURN) * TURN
        before = [s for s in self.switches if s.phase <= turn]
        return before[-1].memory if before else self.memory


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
        return _made(element, roles) if _hashable(element) else cls(element, roles)

    def __init__(self, element: Nonlinearity, roles: Sequence[str]) -> None:
        self.element, self.roles = element, tuple(roles)
        self.automaton: Automaton = element.automaton()
        self.name = type(element).__name__
        self.free = [i for i, role in enumerate(roles) if role == "free"]
        self.n_free = len(self.free)
        self.series: list[Row] = []
        if self.n_free > 1:
            raise ModelError(
                f"{self.name}: a state of the loop that stops at the edge of a gap is no Fourier series of low order; "
                "use LockPin for a harmonic balance."
            )
        a = self.automaton
        self.from_input = [self._rows(m.from_input) for m in a.modes]
        self.smooth = [(s, self.row(s.on_input)) for s in a.smooth]
        self.mode_guards = [self._mode_guards(i) for i in range(len(a.modes))]
        self.clocked = any(t.row.on_clock for group in self.mode_guards for t in group)
        for rows in self.from_input:
            if any(row.on_clock for row in rows):
                raise ModelError(f"{self.name}: an output that grows with time has no Fourier series.")
        moving = [i for i, m in enumerate(a.modes) if not m.sticking]
        self.start_mode = a.start_mode if a.start_mode in moving else moving[0]
        self.every_mode_guard = [t for group in self.mode_guards for t in group]
        self.on_free = np.array([[s.on_free[0]] for s in self.series]).reshape(-1, 1)
        self.on_rate = np.array([[s.on_rate[0]] for s in self.series]).reshape(-1, 1)

    @cached_property
    def table(self) -> Table:
        """The mode guards as the compiled run takes them."""
        from eppanalysis.kernels.periodic import Table

        every, a = self.every_mode_guard, self.automaton
        counts = [len(group) for group in self.mode_guards]
        n, h = len(every), a.n_memory
        return Table(
            roles=np.array([("free", "rate", "clock").index(role) for role in self.roles], np.int64),
            first=np.cumsum([0, *counts], dtype=np.int64),
            series=np.array([t.series for t in every], np.int64),
            factor=np.array([t.factor for t in every], float),
            constant=np.array([t.constant for t in every], float),
            on_memory=np.array([t.on_memory for t in every], float).reshape(n, h),
            on_clock=np.array([t.row.on_clock for t in every], float),
            target=np.array([t.target for t in every], np.int64),
            from_input=np.array([t.guard.memory_from_input for t in every], float).reshape(n, h, len(self.roles)),
            from_memory=np.array([t.guard.memory_from_memory for t in every], float).reshape(n, h, h),
            memory_constant=np.array([t.guard.memory_constant for t in every], float).reshape(n, h),
        )

    def row(self, on_input: Array) -> Row:
        """Inputs by their roles."""
        on_rate, clock = np.zeros(self.n_free), 0.0
        for i, role in enumerate(self.roles):
            if role == "rate":
                on_rate[0] += on_input[i]
            elif role == "clock":
                clock += float(on_input[i])
        return Row(np.array([on_input[i] for i in self.free], float), on_rate, clock)

    def _rows(self, matrix: Array) -> list[Row]:
        return [self.row(line) for line in matrix]

    def _mode_guards(self, mode: int) -> list[ModeGuard]:
        a, m = self.automaton, self.automaton.modes[mode]
        if m.sticking:
            return []
        out = []
        for guard in (g for g in a.guards if g.mode == mode):
            target = guard.bypass if a.modes[guard.target].sticking else guard.target
            if target < 0:
                raise ModelError(f"{self.name}: {guard.name!r} leads to sticking only, which needs the loop's states.")
            if np.any(guard.on_output @ m.from_smooth):
                raise ModelError(f"{self.name}: {guard.name!r} depends on a smooth output.")
            row = self.row(guard.on_input + guard.on_output @ m.from_input)
            rate = self.row(guard.on_rate)
            if np.any(rate.on_rate) or rate.on_clock:
                raise ModelError(f"{self.name}: {guard.name!r} depends on the rate of a rate or of a clock.")
            row = Row(row.on_free, row.on_rate + rate.on_free, row.on_clock)
            if row.on_clock and not row.empty:
                raise ModelError(f"{self.name}: {guard.name!r} depends on a clock and an input at once.")
            memory = guard.on_memory + guard.on_output @ m.from_memory
            constant = guard.constant + float(guard.on_output @ m.constant)
            number, factor = self._series_of(row)
            out.append(ModeGuard(guard, target, row, memory, constant, number, factor))
        return out

    def _series_of(self, row: Row) -> tuple[int, float]:
        """Number of the series that a row is a multiple of, and the factor; guards share few series."""
        if row.empty:
            return -1, 0.0
        weights = np.concatenate([row.on_free, row.on_rate])
        factor = float(weights[int(np.argmax(np.abs(weights)))])
        shape = weights / factor
        for number, known in enumerate(self.series):
            if np.allclose(np.concatenate([known.on_free, known.on_rate]), shape, rtol=1e-15, atol=0.0):
                return number, factor
        self.series.append(Row(shape[: self.n_free], shape[self.n_free :], 0.0))
        return len(self.series) - 1, factor

    def regime(self, Z: ComplexArray, omega: float) -> Regime:
        """Periodic regime under the free inputs Z, shape (n_free, n + 1), at `omega` [rad/s].

        Raises
        ------
        Unsettled
            If the automaton does not repeat itself within six periods.
        """
        return _Run(self, Z, omega).settle()


@lru_cache(maxsize=256)
def _made(element: Nonlinearity, roles: tuple[str, ...]) -> PeriodicElement:
    return PeriodicElement(element, roles)


def _hashable(element: Nonlinearity) -> bool:
    try:
        hash(element)
    except TypeError:
        return False
    return True


class _Run:
    """The automaton driven over phases; lives for one call."""

    def __init__(self, owner: PeriodicElement, Z: ComplexArray, omega: float) -> None:
        self.owner, self.Z, self.omega = owner, Z, omega
        self.series = owner.on_free * Z[0] + owner.on_rate * (1j * omega * orders(Z.shape[1] - 1) * Z[0])
        self.phase, self.value, self.counts = workspaces(self.series)
        # No wave of order n passes a level more than 2 n times in a period.
        most = 200 + 2 * Z.shape[1] * max(20, len(owner.every_mode_guard))
        self.at, self.fired = np.empty(most), np.empty(most, np.int64)
        self.holds = np.empty((most, owner.automaton.n_memory))

    def settle(self) -> Regime:
        """Run whole periods until mode and memory values come back.

        An element that holds values comes from a larger motion, so that it joins its loop even where it could also
        rest; only if it then does not switch at all does it rest, where its describing function has it rest.
        """
        owner = self.owner
        if not owner.automaton.n_memory or owner.clocked:
            return self._repeat(0.0, owner.start_mode, owner.automaton.start_memory, 2 if owner.clocked else 1)
        top = self._top()
        larger = self.Z.copy()
        larger[:, 1:] *= _EXCURSION
        mode, memory, _ = _Run(owner, larger, self.omega)._advance(top - TURN, top, owner.start_mode, self._rest())
        regime = self._repeat(top, mode, memory, 2)
        return regime if regime.switches else self._repeat(0.0, owner.start_mode, self._rest(), 1)

    def _repeat(self, start: float, mode: int, memory: Array, least: int) -> Regime:
        """Run at least `least` periods, until one ends as it began."""
        mode, memory, _ = self._advance(start, start, mode, memory)
        for period in range(_MOST_PERIODS):
            begin = start + TURN * period
            after, memory_after, switches = self._advance(begin, begin + TURN, mode, memory)
            if period + 1 >= least and after == mode and self._same(memory, memory_after):
                return Regime(begin, mode, memory, tuple(switches))
            mode, memory = after, memory_after
        raise Unsettled(f"{self.owner.name} does not answer with the period of its input.")

    def _top(self) -> float:
        """Phase at which the first input is greatest."""
        phase, value = extrema(self.Z[:1])[0]
        return float(phase[np.argmax(value)]) if phase.size else 0.0

    def _same(self, memory: Array, after: Array) -> bool:
        size = 1e-9 * (np.abs(self.Z).sum() + np.abs(memory))
        same = np.abs(after - memory) <= size
        if self.owner.clocked:
            same |= np.abs(after - memory - TURN / self.omega) <= 1e-9 * TURN / self.omega
        return bool(np.all(same))

    def _rest(self) -> Array:
        memory = self.owner.automaton.start_memory.copy()
        rest = rest_value(self.owner.element, self.Z, self.omega)
        memory[0] = memory[0] if rest is None else rest
        return memory

    def _advance(self, phi: float, end: float, mode: int, memory: Array) -> tuple[int, Array, list[Switch]]:
        """All switches from `phi` to before `end` (those that are due at once if both are the same)."""
        from eppanalysis.kernels.periodic import advance

        table, memory = self.owner.table, memory.copy()
        extrema_of = self.phase, self.value, self.counts
        workspace = self.at, self.fired, self.holds
        count, mode = advance(
            table, self.series, *extrema_of, self.Z[0], self.omega, phi, end, mode, memory, *workspace
        )
        if count < 0:
            raise Unsettled(f"{self.owner.name} switches without end.")
        found = zip(self.at[:count].tolist(), self.fired[:count].tolist(), self.holds[:count].copy(), strict=True)
        every = self.owner.every_mode_guard
        return mode, memory, [Switch(at, every[i], every[i].target, h) for at, i, h in found]


def rest_value(element: Nonlinearity, Z: ComplexArray, omega: float) -> float | None:
    """Memory value that an element takes where the input does not move it: the one its describing function
    documents.
    """
    half_range = float(np.ptp(sampled(Z[0], max(32, 8 * Z.shape[1])))) / 2
    mean, _ = element.describing_function(half_range, float(Z[0, 0].real), omega)
    return element.memory_of(np.atleast_1d(np.asarray(mean, float)))
