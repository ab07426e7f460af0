"""An element of the user's own: modes, guards, resets and outputs are all that it needs."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from eppanalysis.arguments import floats
from eppanalysis.arrays import Array
from eppanalysis.engine.describing import Rules, describe_automaton
from eppanalysis.errors import ModelError
from eppanalysis.models.elements.automaton import SMOOTH_KINDS, Automaton, Guard
from eppanalysis.models.elements.base import Answer, Nonlinearity, OwnStates
from eppanalysis.models.elements.phases import broadcast

_MOST_EVENTS = 1000


class ModeMemory(NamedTuple):
    """Memory of an automaton: its mode, its memory values and the first input that it has reached."""

    mode: int
    memory: tuple[float, ...]
    reached: float


@dataclass(frozen=True, eq=False)
class AutomatonElement(Nonlinearity):
    """An element that is given by its automaton, with linear states of its own where it has some.

    Its describing function is a quadrature over one period of the answer to a sine, with every switch located; its
    slopes and thresholds are read off the automaton.

    Parameters
    ----------
    rules : Automaton
        With one input, or with a second one that is the rate of the first.
    own_states : OwnStates, optional
        Linear states that it brings into the loop.

    Raises
    ------
    ModelError
        If the automaton has no input, no output or no mode.

    Examples
    --------
    A dead zone that lets go later than it catches:

    >>> import eppanalysis as epp
    >>> build = epp.AutomatonBuilder()
    >>> free, pulls = build.mode("free"), build.mode("pulls", from_input=1.0)
    >>> build.guard("catches", free, pulls, on_input=1.0, constant=-1.0)
    >>> build.guard("lets go", pulls, free, on_input=-1.0, constant=0.5)
    >>> hook = epp.AutomatonElement(build.build())
    >>> hook.slope_bounds()
    (0.0, inf)
    >>> mean, gain = hook.describing_function(amplitude=2.0)
    >>> complex(gain.round(3))
    (0.484-0.03j)
    """

    by_quadrature = True

    rules: Automaton
    own_states: OwnStates | None = None

    def __post_init__(self) -> None:
        rules = self.rules
        if not isinstance(rules, Automaton):
            raise ModelError("AutomatonElement: rules", rules, "an Automaton, as AutomatonBuilder.build() makes one")
        if rules.n_inputs < 1 or rules.n_outputs < 1 or not rules.modes:
            shown = f"{rules.n_inputs} inputs, {rules.n_outputs} outputs and {len(rules.modes)} modes"
            raise ModelError(f"AutomatonElement: rules has {shown}; expected one or more of each.")
        object.__setattr__(self, "n_inputs", rules.n_inputs)
        object.__setattr__(self, "n_outputs", rules.n_outputs)

    @property
    def reads_rate(self) -> bool:
        """Whether the second of two inputs is the rate of the first, as without linear states of its own."""
        return self.n_inputs == 2 and self.own_states is None

    @property
    def has_impulses(self) -> bool:
        """Whether a guard of its automaton has one."""
        return self.rules.has_impulses

    def automaton(self) -> Automaton:
        """The automaton as it was given."""
        return self.rules

    def output(self, x: Any, memory: Any = None) -> tuple[Any, Any]:
        """Outputs and memory (:class:`ModeMemory`) for the input `x`, or (input, rate); arrays of inputs without
        memory.

        Raises
        ------
        ModelError
            If it switches without end on the way.
        """
        values = floats(x, "output: x")
        if self.n_inputs == 1 and values.ndim:
            each = [self.output(v, memory)[0] for v in values.ravel()]
            return np.reshape(np.array(each, float), (*values.shape, *np.shape(each)[1:])), memory
        mode, stored, reached = self._begin(memory, float(np.ravel(values)[0]))
        return self._moved(np.atleast_1d(values), mode, stored, reached)

    def _begin(self, memory: Any, x: float) -> tuple[int, Array, float]:
        if memory is None:
            return self._leaving(self.rules.start_mode), self.rules.start_memory.copy(), x
        mode, stored, reached = memory
        return self._leaving(int(mode)), np.array(stored, float), float(reached)

    def _leaving(self, mode: int) -> int:
        """A mode that sticks has no output of its own: the one to which it leads."""
        if not self.rules.modes[mode].sticking:
            return mode
        return next((g.target for g in self.rules.guards_of(mode)), mode)

    def _moved(self, goal: Array, mode: int, stored: Array, reached: float) -> tuple[Any, ModeMemory]:
        """Outputs and memory behind the motion straight from what was reached to `goal`."""
        rate = np.zeros_like(goal)
        rate[0] = goal[0] - reached
        share = 0.0

        def at(share: float) -> Array:
            z = goal.copy()
            z[0] = reached + share * rate[0] if share < 1.0 else goal[0]
            return z

        for _ in range(_MOST_EVENTS):
            found = [
                (when, g)
                for g in self.rules.guards_of(mode)
                if (when := self._rise(g, at, rate, stored, share)) is not None
            ]
            if not found:
                mode = next((g.on_threshold for g in self.rules.guards_of(mode) if self._stays(g, goal, stored)), mode)
                w = self._outputs(mode, goal, stored)
                return (w[0] if w.size == 1 else w), ModeMemory(mode, tuple(stored.tolist()), float(goal[0]))
            share, guard = min(found, key=lambda pair: pair[0])
            stored = guard.memory_from_input @ at(share) + guard.memory_from_memory @ stored + guard.memory_constant
            mode = self._beyond(guard)
        raise ModelError(f"AutomatonElement: it switches without end at the input {float(goal[0])!r}.")

    def _stays(self, guard: Guard, z: Array, stored: Array) -> bool:
        """Whether a guard leads somewhere by inputs that stay on its threshold, and they do."""
        return guard.on_threshold >= 0 and self._value(guard, z, np.zeros_like(z), stored) == 0.0

    def _value(self, guard: Guard, z: Array, rate: Array, stored: Array) -> float:
        w = self._outputs(guard.mode, z, stored)
        sums = guard.on_input @ z + guard.on_rate @ rate + guard.on_memory @ stored + guard.on_output @ w
        return float(sums + guard.constant)

    def _rise(self, guard: Guard, at: Any, rate: Array, stored: Array, share: float) -> float | None:
        """Where on the way, from a share of it on, a guard rises; None where it does not."""

        def value(share: float) -> float:
            return self._value(guard, at(share), rate, stored)

        # Along a straight way a guard without smooth functions is affine: one that is not up at its end has not risen.
        if not value(1.0) > 0.0:
            return None
        low, high = share, share if value(share) > 0.0 else 1.0
        while low < (middle := 0.5 * (low + high)) < high:
            low, high = (low, middle) if value(middle) > 0.0 else (middle, high)
        return high

    def _beyond(self, guard: Guard) -> int:
        """The mode behind an event; an input that moves on passes through one that sticks."""
        if not self.rules.modes[guard.target].sticking:
            return guard.target
        return guard.bypass if guard.bypass >= 0 else self._leaving(guard.target)

    def _outputs(self, mode: int, z: Array, stored: Array) -> Array:
        m = self.rules.modes[mode]
        sigma = self.rules.smooth_at(z)
        return np.asarray(m.from_input @ z + m.from_memory @ stored + m.from_smooth @ sigma + m.constant, float)

    def start(self, automaton: Automaton, memory: Any = None) -> tuple[int, Array]:
        """Mode and memory values of a memory."""
        if memory is None:
            return super().start(automaton)
        mode, stored, _ = memory
        return int(mode), np.array(stored, float)

    def memory_at(self, mode: int, stored: Array, x: Array, output: Array) -> ModeMemory:
        """Mode, memory values and input."""
        return ModeMemory(mode, tuple(stored.tolist()), float(x[0]))

    def describing_function(self, amplitude: ArrayLike, bias: ArrayLike = 0.0, omega: ArrayLike = 1.0) -> Answer:
        """Mean and gain by quadrature over a period in which memory repeats; accurate to about 1e-12.

        Not a number where it does not come to answer with the period of its input, or switches or varies without end.

        A smooth function that changes within less than a thousandth of the amplitude may be taken for a jump, which is
        off by the square of that share.

        Raises
        ------
        ModelError
            If an amplitude is negative, or the automaton has more than two inputs, an output with impulses or a smooth
            function of others.
        """
        if self.rules.has_impulses:
            raise ModelError("AutomatonElement: its output has impulses", expected="none, for a describing function")
        if np.any(self.rules.smooth_on_smooth):
            expected = "smooth functions of its inputs alone, for a describing function"
            raise ModelError("AutomatonElement: it has a smooth function of others", expected=expected)
        if self.n_inputs > 2:
            raise ModelError(f"AutomatonElement: it has {self.n_inputs} inputs; expected one and its rate.")
        a, b, w = broadcast(amplitude, bias, omega)
        scale = float(np.min(self.thresholds(), initial=np.inf))
        # The quotient by the amplitude has its limit beneath the least threshold, where nothing switches yet.
        a = np.where(a == 0, 1e-6 * (scale if np.isfinite(scale) else 1.0), a)
        shape, n_w = a.shape, self.n_outputs
        mean, gain = np.empty((a.size, n_w)), np.empty((a.size, n_w), complex)
        points = a.flatten(), b.flatten(), w.flatten()
        describe_automaton(self._rules, self._leaving(self.rules.start_mode), *points, mean, gain)
        if n_w == 1:
            return mean.reshape(shape), gain.reshape(shape)
        return mean.reshape(*shape, n_w), gain.reshape(*shape, n_w)

    @cached_property
    def _rules(self) -> Rules:
        a = self.rules
        sizes = {"z": a.n_inputs, "w": a.n_outputs, "h": a.n_memory}

        def stacked(parts: Any, name: str, *axes: str) -> Array:
            shape = (len(parts), *(sizes.get(axis, len(a.smooth)) for axis in axes))
            return np.array([getattr(p, name) for p in parts], float).reshape(shape)

        modes, guards, smooth = a.modes, a.guards, a.smooth
        return Rules(
            from_input=stacked(modes, "from_input", "w", "z"),
            from_memory=stacked(modes, "from_memory", "w", "h"),
            from_smooth=stacked(modes, "from_smooth", "w", "s"),
            constant=stacked(modes, "constant", "w"),
            smooth_kind=np.array([SMOOTH_KINDS[s.kind] for s in smooth], np.int64),
            smooth_input=stacked(smooth, "on_input", "z"),
            smooth_constant=stacked(smooth, "constant"),
            smooth_scale=stacked(smooth, "scale"),
            guard_mode=np.array([g.mode for g in guards], np.int64),
            target=np.array([self._beyond(g) for g in guards], np.int64),
            on_input=stacked(guards, "on_input", "z"),
            on_rate=stacked(guards, "on_rate", "z"),
            on_memory=stacked(guards, "on_memory", "h"),
            on_output=stacked(guards, "on_output", "w"),
            guard_constant=stacked(guards, "constant"),
            memory_from_input=stacked(guards, "memory_from_input", "h", "z"),
            memory_from_memory=stacked(guards, "memory_from_memory", "h", "h"),
            memory_constant=stacked(guards, "memory_constant", "h"),
            start=np.array(a.start_memory, float),
        )


# Case files have it, with fields of their own: it is not among the elements whose fields are those of their class.
AutomatonElement.kind = "automaton"
