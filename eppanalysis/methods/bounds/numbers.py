"""The numbers of a loop, laid out for one sequence of switches, and how they depend on a parameter of the case.

The harmonic-balance equations of :mod:`eppanalysis.methods.bounds.equations` are expressions in these numbers, so that
their derivatives by every parameter of a case follow from two things: the derivative of the equations by the numbers
(exact, from CasADi) and that of the numbers by the parameter (they are smooth functions of it).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from eppanalysis.arrays import Array, ComplexArray
from eppanalysis.errors import EppError, ModelError
from eppanalysis.methods.harmonic.elements import PeriodicElement, Regime, Row
from eppanalysis.methods.harmonic.loop import Loop
from eppanalysis.methods.harmonic.series import TURN
from eppanalysis.models.systems.lure import LureSystem
from eppanalysis.polynomials import DEGREES, Polynomial, polynomial

#: A window of the parameter reaches over this factor, and half as far again on both sides.
_WINDOW = 1.5


@dataclass(frozen=True)
class Sequence:
    """The switches of one element in one period: the mode before each, its mode guard, and whether it follows at
    once.
    """

    mode: int  # mode behind the last switch (the only one where there are none)
    #: Mode before, number of the mode guard in it, mode behind, and whether it shares the instant of the one before.
    steps: tuple[tuple[int, int, int, bool], ...] = ()

    @classmethod
    def of(cls, regime: Regime) -> tuple[Sequence, int]:
        """The sequence of a periodic regime, and the number of the switch with which it begins.

        Of all the switches that do not follow another one at once the first is chosen so that equal cycles of switches
        give equal sequences.
        """
        steps, mode, last = [], regime.mode, -np.inf
        for s in regime.switches:
            steps.append((mode, s.mode_guard.number, s.mode, bool(s.phase == last)))
            mode, last = s.mode, s.phase
        # One cyclic sequence must be one key of the programmes already written, wherever the period happens to begin:
        # of all turned forms the first in order is taken.
        turned = [(tuple(steps[i:] + steps[:i]), i) for i, step in enumerate(steps) if not step[3]]
        if not turned:
            return cls(regime.mode), 0
        chosen, first = min(turned)
        return cls(chosen[-1][2], chosen), first


@dataclass(frozen=True)
class Plan:
    """What the equations are written for: the order, and the sequence of switches of every element."""

    order: int
    sequences: tuple[Sequence, ...]


class ElementNumbers(NamedTuple):
    """Of one element with m pieces (one behind each switch; one piece where there are none), h memory values."""

    on_free: Array  # (m, outputs)
    on_rate: Array  # (m, outputs)
    on_memory: Array  # (m, outputs, h)
    constant: Array  # (m, outputs)
    guard: Array  # (switches, 3 + h): on the input, on its rate, constant, on the memory values
    reset: Array  # (switches, h, 3 + h): the same, of what is written into the memory values
    smooth: Array  # (functions, 4): on the input, on its rate, constant, scale
    by_smooth: Array  # (m, outputs, functions)


class LoopNumbers(NamedTuple):
    """Of the linear part, and of all elements."""

    A: Array
    B: Array
    C: Array
    D: Array
    state: Array  # (n,): constant part of the state rate, constant inputs included
    inputs: Array  # (F,): constant part of the elements' free inputs
    delays: Array
    elements: tuple[ElementNumbers, ...]

    def flat(self) -> Array:
        """All numbers in one vector."""
        parts = [a.ravel() for a in self[:-1]]
        parts += [a.ravel() for e in self.elements for a in e]
        return np.concatenate(parts)


def gather(loop: Loop, plan: Plan) -> LoopNumbers:
    """The numbers of a loop for a plan.

    Raises
    ------
    ModelError
        If an element has other modes than the plan says, or smooth functions of others.
    """
    s, rows = loop.system, loop.rows
    return LoopNumbers(
        s.A,
        s.B,
        s.C[rows],
        s.D[rows],
        s.B_input @ loop.value + s.constant_state,
        s.D_input[rows] @ loop.value + s.constant_input[rows],
        s.delays,
        tuple(_element(e, q) for e, q in zip(loop.elements, plan.sequences, strict=True)),
    )


def _element(element: PeriodicElement, sequence: Sequence) -> ElementNumbers:
    a = element.automaton
    modes = [step[2] for step in sequence.steps] or [sequence.mode]
    try:
        mode_guards = [element.guard_of(before, number) for before, number, _, _ in sequence.steps]
        on_free, on_rate = element.table.w_free[modes], element.table.w_rate[modes]
    except IndexError:
        raise ModelError(f"{element.name}: its modes change with the parameter.") from None
    n_memory = a.n_memory
    guard, reset = np.zeros((len(mode_guards), 3 + n_memory)), np.zeros((len(mode_guards), n_memory, 3 + n_memory))
    for i, t in enumerate(mode_guards):
        guard[i] = [*_pair(t.row), t.constant, *t.on_memory]
        for h in range(n_memory):
            row = element.row(t.guard.memory_from_input[h])
            reset[i, h] = [*_pair(row), t.guard.memory_constant[h], *t.guard.memory_from_memory[h]]
    if np.any(a.smooth_on_smooth):
        raise ModelError(f"{element.name}: a smooth function of others has no bound by harmonic balance.")
    smooth = [[*_pair(row), s.constant, s.scale] for s, row in element.smooth]
    return ElementNumbers(
        on_free,
        on_rate,
        a.mode_columns["from_memory"][modes],
        a.mode_columns["constant"][modes],
        guard,
        reset,
        np.array(smooth, float).reshape(len(smooth), 4),
        a.mode_columns["from_smooth"][modes],
    )


def _pair(row: Row) -> tuple[float, float]:
    return float(row.on_free[0]), float(row.on_rate[0])


@dataclass(eq=False)
class ParametricModel:
    """The numbers of one case over one parameter; systems are built once for each value."""

    build: Callable[[float], Loop]  # from the value (SI) of the parameter to the loop
    #: low, high: range of the parameter.
    low: float
    high: float
    _loops: dict[float, Loop] = field(default_factory=dict)
    _found: dict[tuple[Plan, tuple[float, float], tuple[int, ...]], Polynomial | None] = field(default_factory=dict)

    def loop(self, value: float) -> Loop:
        """The loop at a value."""
        if value not in self._loops:
            self._loops[value] = self.build(value)
        return self._loops[value]

    def window(self, value: float) -> tuple[float, float]:
        """A part of the range around a value; windows overlap."""
        if not self.low > 0:
            return self.low, self.high
        # Windows are on a fixed grid of factors, so that neighbouring values share one fit.
        k = np.floor(np.log(max(value, self.low) / self.low) / np.log(_WINDOW))
        low, high = self.low * _WINDOW ** (k - 0.5), self.low * _WINDOW ** (k + 1.5)
        return max(self.low, float(low)), min(self.high, float(high))

    def numbers(self, plan: Plan, value: float) -> Polynomial:
        """The numbers of a plan around a value, as polynomials of the parameter.

        Raises
        ------
        EppError
            If the numbers are no smooth function of the parameter there.
        """
        # The numbers do not know the order of the balance: all orders share one fit.
        shape, whole, window = Plan(1, plan.sequences), (self.low, self.high), self.window(value)
        # Most parameters enter so simply that no windows are needed.
        found = self._known(shape, whole, DEGREES[:1]) or self._known(shape, window)
        if found is None:
            raise EppError("The loop is no smooth function of the parameter over this range; expected a narrower one.")
        return found

    def _known(self, plan: Plan, window: tuple[float, float], degrees: tuple[int, ...] = DEGREES) -> Polynomial | None:
        def numbers(value: float) -> Array:
            return gather(self.loop(min(max(value, self.low), self.high)), plan).flat()

        if (plan, window, degrees) not in self._found:
            self._found[plan, window, degrees] = polynomial(numbers, *window, degrees)
        return self._found[plan, window, degrees]


def plan_of(loop: Loop, Z: ComplexArray, omega: float) -> tuple[Plan, tuple[Array, ...], tuple[Array, ...]]:
    """The plan that the elements follow under their inputs, with the phases (m,) and memory values (m, h) of each.

    Raises
    ------
    Unsettled
        If an element does not answer periodically.
    """
    sequences, phases, memory = [], [], []
    for element, z in zip(loop.elements, Z, strict=True):
        regime = element.regime(z[None], omega)
        sequence, first = Sequence.of(regime)
        phi = np.array([s.phase for s in regime.switches])
        values = np.array([s.memory for s in regime.switches]).reshape(phi.size, element.automaton.n_memory)
        sequences.append(sequence)
        # Turned as the sequence is, and ascending still.
        phases.append(np.concatenate([phi[first:], phi[:first] + TURN]))
        memory.append(np.roll(values, -first, axis=0))
    return Plan(Z.shape[1] - 1, tuple(sequences)), tuple(phases), tuple(memory)


def loop_of(system: LureSystem, value: Array) -> Loop:
    """The loop made ready for harmonic balance.

    Raises
    ------
    EppError
        For a loop in discrete time, or with an element that has a clock.
    """
    if system.time_step:
        raise EppError(f"{system.name}: a loop in discrete time has no bounds by this method; sweep it instead.")
    loop = Loop.of(system, value)
    for element in loop.elements:
        if element.clocked:
            raise EppError(f"{system.name}: {element.name} has a clock, and its loop no bounds; sweep it instead.")
    return loop


def why_no_bounds(system: LureSystem) -> str:
    """What keeps harmonic balance from the bounds of a loop, in a sentence; empty where nothing does."""
    try:
        loop_of(system, system.v0)
    except EppError as error:
        return str(error)
    return ""
