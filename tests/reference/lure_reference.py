"""A slow integrator of any Lur'e system on scipy's solvers, independent of the package's automata and engine.

It reads a system's matrices and the fields of its elements, nothing else. Supported: continuous time, no dead time,
elements with one input and one output (see lure_elements), cascades through D without algebraic loops.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tests.reference.events import Guard, Options, integrate
from tests.reference.lure_elements import DryFriction, Situation, Watch, handler_of

Array = NDArray[np.float64]
#: One external input: its value and its rate over time.
Input = tuple[Callable[[float], float], Callable[[float], float]]


class Loop:
    """Rates, guards and switches of a Lur'e system."""

    def __init__(self, system: Any, inputs: Sequence[Input] | None = None) -> None:
        if system.time_step is not None or np.any(system.delays):
            raise NotImplementedError("the reference integrator knows neither sampled systems nor dead time")
        if any(e.n_inputs != 1 or e.n_outputs != 1 for e in system.elements):
            raise NotImplementedError("the reference integrator knows elements with one input and one output")
        self.system = system
        self.handlers = [handler_of(e) for e in system.elements]
        self.inputs = inputs
        self.order = self._order()

    def _order(self) -> list[int]:
        """Elements in the order in which they act on one another through D."""
        D, order = self.system.D, []
        rest = list(range(len(self.handlers)))
        for i, handler in enumerate(self.handlers):
            if isinstance(handler, DryFriction) and (np.any(D[i]) or np.any(D[:, i])):
                raise NotImplementedError("a friction element in a cascade through D")
        while rest:
            free = [i for i in rest if not np.any(D[i, rest])]
            if not free:
                raise NotImplementedError("an algebraic loop through D")
            order += free
            rest = [i for i in rest if i not in free]
        return order

    def external(self, t: float) -> tuple[Array, Array]:
        """External inputs and their rates."""
        if self.inputs is None:
            return self.system.v0, np.zeros_like(self.system.v0)
        return np.array([f(t) for f, _ in self.inputs]), np.array([g(t) for _, g in self.inputs])

    def solve(self, t: float, x: Array, states: Sequence[Any]) -> tuple[Array, Array, Array, Array]:
        """(z, w, dx/dt, dz/dt) at one instant."""
        s = self.system
        v, v_rate = self.external(t)
        z0 = s.C @ x + s.D_input @ v + s.constant_input
        n = len(self.handlers)
        z, w, slopes = np.zeros(n), np.zeros(n), np.zeros(n)
        for i in self.order:
            z[i] = z0[i] + s.D[i] @ w
            w[i], slopes[i] = self.handlers[i].output(z[i], states[i])
        stuck = np.flatnonzero(np.isnan(w))
        w[stuck] = 0.0
        x_rate = s.A @ x + s.B @ w + s.B_input @ v + s.constant_state
        if stuck.size:
            # Forces that keep the sticking velocities constant.
            gain = s.C[stuck] @ s.B[:, stuck]
            if np.any(np.diag(gain) >= 0.0):
                raise ValueError("a friction force does not oppose its velocity")
            w[stuck] = np.linalg.solve(gain, -(s.C[stuck] @ x_rate + s.D_input[stuck] @ v_rate))
            x_rate = x_rate + s.B[:, stuck] @ w[stuck]
        z_rate, w_rate = s.C @ x_rate + s.D_input @ v_rate, np.zeros(n)
        for i in self.order:
            z_rate[i] += s.D[i] @ w_rate
            w_rate[i] = slopes[i] * z_rate[i]
        return z, w, x_rate, z_rate

    def situation(self, i: int, t: float, x: Array, states: Sequence[Any]) -> Situation:
        """What element i sees."""
        z, w, _, z_rate = self.solve(t, x, states)
        return Situation(float(z[i]), float(z_rate[i]), float(w[i]))

    def rate(self, t: float, y: Array, mode: Any) -> Array:
        """Time derivative of the state."""
        return self.solve(t, y, mode)[2]

    def guards(self, mode: Any) -> list[Guard]:
        """All events of all elements."""
        return [
            self._guard(i, watch, mode) for i, handler in enumerate(self.handlers) for watch in handler.watches(mode[i])
        ]

    def _guard(self, i: int, watch: Watch, mode: Any) -> Guard:
        label = f"{self.system.element_names[i]}: {watch.label}"
        return Guard(label, lambda t, y: watch.value(self.situation(i, t, y, mode)), watch.scale)

    def switch(self, t: float, y: Array, mode: Any, label: str) -> tuple[Array, Any]:
        """The element's new state, then all others made consistent."""
        name, event = label.split(": ")
        i = list(self.system.element_names).index(name)
        states = list(mode)
        states[i] = self.handlers[i].fire(event, self.situation(i, t, y, mode), mode[i])
        before, after = self.solve(t, y, mode)[0], self.solve(t, y, states)[0]
        for k, handler in enumerate(self.handlers):
            if k != i:
                states[k] = handler.jumped(float(before[k]), float(after[k]), states[k])
        return y, self.settle(t, y, tuple(states), i)

    def settle(self, t: float, y: Array, states: Any, fired: int | None = None) -> Any:
        """States that agree with all inputs; the element that fired keeps its state unless it is a friction element.

        Raises
        ------
        RuntimeError
            If the elements keep switching one another.
        """
        for _ in range(20):
            before = states
            for i in self.order:
                if i == fired and not isinstance(self.handlers[i], DryFriction):
                    continue
                new = self.handlers[i].settle(self.situation(i, t, y, states), states[i])
                states = (*states[:i], new, *states[i + 1 :])
            if states == before:
                return states
        raise RuntimeError(f"the elements keep switching one another at t = {t:.6g}")

    def start(self) -> Any:
        """States at the start, in the order of the cascade."""
        states: list[Any] = [None] * len(self.handlers)
        s, x = self.system, self.system.x0
        v, _ = self.external(0.0)
        z0, w = s.C @ x + s.D_input @ v + s.constant_input, np.zeros(len(states))
        for i in self.order:
            z = float(z0[i] + s.D[i] @ w)
            states[i] = self.handlers[i].start(Situation(z, 0.0, 0.0), s.memory[i])
            w[i] = np.nan_to_num(self.handlers[i].output(z, states[i])[0])
        return self.settle(0.0, x, tuple(states))


@dataclass(frozen=True)
class LureRun:
    """Samples of the named signals and of the state, and events as (time, "element: what")."""

    t: Array
    signals: dict[str, Array]
    states: Array
    events: list[tuple[float, str]]

    def event_times(self, label: str) -> Array:
        """Times of one event [s]."""
        return np.array([t for t, name in self.events if name == label])


def simulate_lure(
    system: Any, t_eval: Sequence[float] | Array, options: Options | None = None, inputs: Sequence[Input] | None = None
) -> LureRun:
    """Integrate a Lur'e system from its start to the last sample time.

    Parameters
    ----------
    system : LureSystem
    t_eval : array, shape (nt,)
        Increasing sample times [s].
    options : Options, optional
        Tolerances and method.
    inputs : sequence of (value, rate), optional
        Smooth functions of time, one pair an external input; by default the inputs keep `v0`.

    Raises
    ------
    NotImplementedError
        If the system holds something that the module's first lines do not name.
    RuntimeError
        If events accumulate (sliding along a relay's threshold, for one).
    """
    loop = Loop(system, inputs)
    t_eval = np.asarray(t_eval, float)
    run = integrate(loop, system.x0, loop.start(), float(t_eval[-1]), t_eval, options or Options())
    rows = []
    for t, x, mode in zip(run.times, run.states, run.modes, strict=True):
        w = loop.solve(t, x, mode)[1]
        m = system.signals
        rows.append(m.C @ x + m.D @ w + m.D_input @ loop.external(t)[0] + m.constant)
    table = np.array(rows).T
    return LureRun(t_eval, dict(zip(system.signals.names, table, strict=True)), np.array(run.states), run.events)
