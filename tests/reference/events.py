"""A small event machine on scipy's integrators: flow in one mode, locate the first guard, switch, restart.

A guard is a function that is negative inside its mode; its event is where it rises through zero. A guard that stands
at zero when a mode begins stays unarmed until it has been clearly negative, so no guard fires twice for one event.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple, Protocol

import numpy as np
import scipy.integrate
from numpy.typing import NDArray
from scipy.optimize import brentq

Array = NDArray[np.float64]
Rate = Callable[[float, Array], Array]

#: Relative size (against a guard's scale) below which the guard stands at zero.
AT_ZERO = 1e-12
#: Points of each integrator step at which the guards are looked at.
LOOKS = 8


class Guard(NamedTuple):
    """Fires where ``value(t, y)`` rises through zero; `scale` is the size of its terms."""

    label: str
    value: Callable[[float, Array], float]
    scale: float = 1.0


class Model(Protocol):
    """A hybrid system: a rate and guards in each mode, and what happens at a guard."""

    def rate(self, t: float, y: Array, mode: Any) -> Array:
        """Time derivative of the state."""

    def guards(self, mode: Any) -> Sequence[Guard]:
        """All guards of a mode."""

    def switch(self, t: float, y: Array, mode: Any, label: str) -> tuple[Array, Any]:
        """State and mode just after the event `label`."""


@dataclass(frozen=True)
class Options:
    """How to integrate; with `land`, samples are integrated to rather than interpolated."""

    rtol: float = 1e-10
    atol: float = 1e-12
    method: str = "DOP853"
    max_step: float = np.inf
    land: bool = False
    max_events: int = 100_000


@dataclass
class Run:
    """Samples (times, states, modes, all taken just before an event that falls on a sample) and events."""

    times: list[float] = field(default_factory=list)
    states: list[Array] = field(default_factory=list)
    modes: list[Any] = field(default_factory=list)
    events: list[tuple[float, str]] = field(default_factory=list)
    end_state: Array | None = None
    end_mode: Any = None
    n_steps: int = 0


def integrate(model: Model, y0: Array, mode0: Any, t_end: float, t_eval: Array, options: Options) -> Run:
    """Integrate a hybrid system from t = 0.

    Parameters
    ----------
    model : Model
    y0 : array, shape (n,)
    mode0 : object
        Any value that the model understands; it must be consistent with `y0`.
    t_end : float
        [s].
    t_eval : array, shape (nt,)
        Increasing sample times within [0, t_end].
    options : Options

    Raises
    ------
    RuntimeError
        If the integrator fails, if events accumulate, or if one guard fires again and again at one instant.
    """
    run = Run()
    pending = [float(s) for s in t_eval]
    t, y, mode = 0.0, np.array(y0, float), mode0
    while pending and pending[0] <= 0.0:
        _record(run, pending.pop(0), y, mode)
    while t < t_end:
        t, y, label = _flow(model, mode, (t, y, t_end), run, pending, options)
        if label is None:
            break
        y, mode = model.switch(t, y, mode, label)
        run.events.append((t, label))
        _check_progress(run.events, options)
    run.end_state, run.end_mode = y, mode
    return run


def _record(run: Run, t: float, y: Array, mode: Any) -> None:
    run.times.append(t)
    run.states.append(np.array(y))
    run.modes.append(mode)


def _check_progress(events: list[tuple[float, str]], options: Options) -> None:
    if len(events) >= options.max_events:
        raise RuntimeError(f"more than {options.max_events} events by t = {events[-1][0]:.6g} s")
    if len(events) > 20 and events[-20][0] == events[-1][0]:
        raise RuntimeError(f"no progress at t = {events[-1][0]:.17g} s: {[e[1] for e in events[-6:]]}")


def _flow(
    model: Model, mode: Any, start: tuple[float, Array, float], run: Run, pending: list[float], options: Options
) -> tuple[float, Array, str | None]:
    """Integrate in one mode up to its first event or the end; returns (time, state, label or None)."""
    t, y, t_end = start

    def rate(time: float, state: Array) -> Array:
        return model.rate(time, state, mode)

    guards = model.guards(mode)
    values = [g.value(t, y) for g in guards]
    for g, v in zip(guards, values, strict=True):
        if v > AT_ZERO * g.scale:
            return t, y, g.label
    armed = [v < -AT_ZERO * g.scale for g, v in zip(guards, values, strict=True)]
    solver_class = getattr(scipy.integrate, options.method)
    solver = solver_class(rate, t, y, t_end, rtol=options.rtol, atol=options.atol, max_step=options.max_step)
    while solver.status == "running":
        y_old = solver.y.copy()
        message = solver.step()
        if solver.status == "failed":
            raise RuntimeError(f"{options.method} failed at t = {solver.t:.6g} s: {message}")
        run.n_steps += 1
        sol = solver.dense_output()
        hit = _first_crossing(guards, armed, sol, solver.t_old, solver.t)
        stop, y_stop, label = solver.t, solver.y, None
        if hit is not None:
            stop, y_stop = _polish(hit, rate, sol, (solver.t_old, y_old, solver.t), options)
            label = hit[0].label
        while pending and pending[0] <= stop:
            s = pending.pop(0)
            _record(run, s, advance(rate, solver.t_old, y_old, s, options) if options.land else sol(s), mode)
        if label is not None:
            return stop, y_stop, label
    return solver.t, solver.y, None


def _first_crossing(guards: Sequence[Guard], armed: list[bool], sol: Any, t0: float, t1: float) -> Any:
    """First event in a step as (guard, time, whether it is a sign change); `armed` is brought up to date."""
    nodes = t0 + (t1 - t0) * np.arange(LOOKS + 1) / LOOKS
    nodes[-1] = t1
    states = sol(nodes)
    for k in range(1, LOOKS + 1):
        roots = []
        for i, g in enumerate(guards):
            v = g.value(nodes[k], states[:, k])
            if armed[i] and v >= 0.0:
                roots.append((_root(g, sol, nodes[k - 1], nodes[k]), i, True))
            elif not armed[i] and v > AT_ZERO * g.scale:
                roots.append((nodes[k - 1], i, False))
            elif v < -AT_ZERO * g.scale:
                armed[i] = True
        if roots:
            time, i, is_crossing = min(roots)
            return guards[i], time, is_crossing
    return None


def _root(guard: Guard, sol: Any, a: float, b: float) -> float:
    def value(s: float) -> float:
        return guard.value(s, sol(s))

    if value(a) >= 0.0:
        return a
    if value(b) <= 0.0:
        return b
    return brentq(value, a, b, xtol=1e-15, rtol=8.9e-16)


def advance(rate: Rate, t0: float, y0: Array, t1: float, options: Options) -> Array:
    """State at `t1`, integrated (not interpolated) from `t0`."""
    if t1 <= t0:
        return np.array(y0)
    solution = scipy.integrate.solve_ivp(
        rate, (t0, t1), y0, method=options.method, rtol=options.rtol, atol=options.atol, first_step=t1 - t0
    )
    if not solution.success:
        raise RuntimeError(solution.message)
    return solution.y[:, -1]


def _polish(hit: Any, rate: Rate, sol: Any, step: tuple[float, Array, float], options: Options) -> tuple[float, Array]:
    """Event time and state by Newton steps on integrated states: the interpolant is less exact than the step."""
    guard, t, is_crossing = hit
    t0, y0, t1 = step
    y = advance(rate, t0, y0, t, options)
    if not is_crossing:
        return t, y
    h = 1e-3 * (t1 - t0)
    for _ in range(4):
        residual = guard.value(t, y)
        slope = (guard.value(t + h, sol(t + h)) - guard.value(t - h, sol(t - h))) / (2.0 * h)
        if abs(residual) < 1e-15 * guard.scale or slope <= 0.0 or abs(residual) > 0.1 * slope * (t1 - t0):
            break
        t = max(t0, t - residual / slope)
        y = advance(rate, t0, y0, t, options)
    return t, y
