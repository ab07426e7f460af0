"""The slow reference integrator with what it lacks for random loops: steps of inputs, dead time, sampled loops.

Continuous loops run on scipy's integrators (tests/reference). A dead time is taken by the method of steps: the past is
the dense output of the integrator, and each switch of the past begins a new piece. Sampled loops are iterated by each
element's own definition in words.
"""

from __future__ import annotations

import bisect
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import scipy.integrate
from numpy.typing import NDArray

import eppanalysis as epp
from tests.reference.events import AT_ZERO, Options, _check_progress, _first_crossing, _polish
from tests.reference.lure_elements import Follower, Situation, handler_of
from tests.reference.lure_reference import Loop

Array = NDArray[np.float64]
#: Tolerances for all loops, and those for a second look: samples are interpolated, to less than steps are exact.
OPTIONS = Options(rtol=1e-11, atol=1e-13, max_events=1500)
TIGHTEST = Options(rtol=1e-13, atol=1e-15, max_events=1500)
#: After so many dead times a change of the past is smoother than the integrator's order.
_ECHOES = 8


class _Run:
    """Events so far, for the integrator's own check of progress."""

    def __init__(self) -> None:
        self.events: list[tuple[float, str]] = []


class Machine(Loop):
    """A loop whose inputs step, with the past of its elements' outputs."""

    def __init__(
        self, system: epp.LureSystem, steps: Mapping[str, epp.inputs.Step], options: Options = OPTIONS
    ) -> None:
        self.options = options
        self.delay = float(np.max(system.delays, initial=0.0))
        if np.ptp(system.delays) > 0.0:
            raise NotImplementedError("dead times that differ")
        super().__init__(replace(system, delays=np.zeros_like(system.delays)))
        self.v = system.v0.copy()
        names = list(system.input_names)
        self.breakpoints = sorted((s.time, names.index(n), s.size) for n, s in steps.items())
        self.past: list[tuple[float, float, Any, Any]] = []
        self.borders: list[tuple[float, int]] = []

    def external(self, t: float) -> tuple[Array, Array]:
        """The inputs as they are now: they change at borders only."""
        return self.v, np.zeros_like(self.v)

    def rate(self, t: float, y: Array, mode: Any) -> Array:
        """Time derivative of the state; with dead time the elements act as they did then."""
        if not self.delay:
            return super().rate(t, y, mode)
        s = self.system
        return s.A @ y + s.B @ self._before(t - self.delay) + s.B_input @ self.v + s.constant_state

    def solve(self, t: float, x: Array, states: Sequence[Any]) -> tuple[Array, Array, Array, Array]:
        """As without dead time, but for the rates, in which the elements act late."""
        z, w, x_rate, z_rate = super().solve(t, x, states)
        if self.delay:
            x_rate = self.rate(t, x, states)
            z_rate = self.system.C @ x_rate
        return z, w, x_rate, z_rate

    def _before(self, t: float) -> Array:
        """Outputs of the elements at an earlier time; before the start they stood as they did then."""
        k = bisect.bisect_right(self.past, t, key=lambda piece: piece[0]) - 1
        if k < 0:
            return self.first
        begin, end, solution, mode = self.past[k]
        return super().solve(t, solution(min(max(t, begin), end)), mode)[1]

    def breakpoint(self, t: float, x: Array, mode: Any) -> Any:
        """The mode behind a step of the input."""
        z = Loop.solve(self, t, x, mode)[0]
        while self.breakpoints and self.breakpoints[0][0] <= t:
            _, i, size = self.breakpoints.pop(0)
            self.v = self.v.copy()
            self.v[i] += size
        after = Loop.solve(self, t, x, mode)[0]
        states = tuple(
            h.jumped(float(a), float(b), s) for h, a, b, s in zip(self.handlers, z, after, mode, strict=True)
        )
        return self.settle(t, x, states)

    def run(self, times: Array) -> Array:
        """States at the times.

        Raises
        ------
        RuntimeError
            If events accumulate.
        """
        mode = self.start_mode()
        x, t, run = self.system.x0.copy(), 0.0, _Run()
        out: list[Array] = []
        pending = [float(s) for s in times]
        while t < times[-1]:
            stop = min([times[-1], *[k[0] for k in self.breakpoints[:1] if k[0] > t], *self._border_after(t)])
            t, x, label = self._piece(mode, (t, x, stop), pending, out)
            stepped = bool(self.breakpoints) and self.breakpoints[0][0] <= t
            if self.delay:
                self._echo(t, label is not None or stepped)
            if label is not None:
                x, mode = self.switch(t, x, mode, label)
                run.events.append((t, label))
                _check_progress(run.events, self.options)
            elif stepped:
                mode = self.breakpoint(t, x, mode)
            else:
                mode = self.settle(t, x, mode)
        while pending:
            pending.pop(0)
            out.append(x)
        return np.array(out)

    def start_mode(self) -> Any:
        """Mode at the start, and the outputs that have acted before it."""
        self.first = np.zeros(len(self.handlers))
        mode = self.start()
        self.first = Loop.solve(self, 0.0, self.system.x0, mode)[1]
        if self.delay:
            self.borders.append((self.delay, 1))
        return self.settle(0.0, self.system.x0, mode)

    def _border_after(self, t: float) -> list[float]:
        return sorted(b for b, _ in self.borders if b > t + 1e-13)[:1]

    def _echo(self, t: float, changed: bool) -> None:
        """What changes now changes again one dead time later, one order smoother each time."""
        turns = 0 if changed else min((k for b, k in self.borders if abs(b - t) <= 1e-13), default=_ECHOES)
        self.borders = [border for border in self.borders if border[0] > t + 1e-13]
        if turns < _ECHOES:
            self.borders.append((t + self.delay, turns + 1))

    def _piece(
        self, mode: Any, start: tuple[float, Array, float], pending: list[float], out: list[Array]
    ) -> tuple[float, Array, str | None]:
        """Integrate in one mode up to its first event or the end of the piece, and remember it."""
        t, y, t_end = start
        guards = self.guards(mode)
        values = [g.value(t, y) for g in guards]
        for g, v in zip(guards, values, strict=True):
            if v > AT_ZERO * g.scale:
                return t, y, g.label
        armed = [v < -AT_ZERO * g.scale for g, v in zip(guards, values, strict=True)]

        def rate(time: float, state: Array) -> Array:
            return self.rate(time, state, mode)

        # The past is looked up within a step, so no step is longer than the dead time.
        solver = scipy.integrate.DOP853(
            rate,
            t,
            y,
            t_end,
            rtol=self.options.rtol,
            atol=self.options.atol,
            max_step=0.5 * self.delay if self.delay else np.inf,
        )
        while solver.status == "running":
            before = solver.y.copy()
            message = solver.step()
            if solver.status == "failed":
                raise RuntimeError(str(message))
            solution = solver.dense_output()
            hit = _first_crossing(guards, armed, solution, solver.t_old, solver.t)
            stop, state, label = solver.t, solver.y, None
            if hit is not None:
                stop, state = _polish(hit, rate, solution, (solver.t_old, before, solver.t), self.options)
                label = hit[0].label
            if self.delay:
                self.past.append((float(solver.t_old), float(stop), solution, mode))
            while pending and pending[0] <= stop:
                out.append(solution(pending.pop(0)))
            if label is not None:
                return stop, state, label
        return solver.t, solver.y, None


def iterate(system: epp.LureSystem, steps: Mapping[str, epp.inputs.Step], count: int) -> Array:
    """States of a sampled loop of one element at its first `count` samples."""
    (element,), x = system.elements, system.x0.copy()
    handler = handler_of(element)
    mode, rows = None, []
    for k in range(count):
        rows.append(x)
        v = system.v0 + sum((s.size * (k * system.time_step >= s.time) for s in steps.values()), 0.0)
        z = float((system.C @ x + system.D_input @ v + system.constant_input)[0])
        # From sample to sample the input jumps: what holds is carried along as far as the jump forces.
        now = Situation(z, 0.0, 0.0)
        mode = handler.start(now, system.memory[0]) if mode is None else handler.settle(now, _held(handler, z, mode))
        w = handler.output(z, mode)[0]
        mode = _held(handler, z, mode)
        x = system.A @ x + system.B[:, 0] * w + system.B_input @ v + system.constant_state
    return np.array(rows)


def _held(handler: Any, z: float, mode: Any) -> Any:
    """A follower that holds what it holds now; others as they are."""
    if not isinstance(handler, Follower) or mode[0] == 0:
        return mode
    return (0, z - mode[0] * handler.lag)
