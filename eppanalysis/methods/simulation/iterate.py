"""Iteration of discrete-time loops, with the same verdicts as the continuous-time engine."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from eppanalysis.arrays import Array, IntArray
from eppanalysis.errors import EppError, ModelError
from eppanalysis.models.elements.memory import Slip
from eppanalysis.models.systems.inputs import InputSignal, input_signals_by_name
from eppanalysis.models.systems.lure import LureSystem
from eppanalysis.results import SIMULATION, LimitCycle, Status, Trajectory
from eppanalysis.results.provenance import Provenance

#: Samples of a run: some minutes, and a gigabyte of signals.
MOST_SAMPLES = 2_000_000
#: How near a time must be to a whole number of samples, in samples.
_WHOLE = 1e-6
#: Difference of states a period apart, relative to the motion, of a run that repeats itself.
_REPEATS = 1e-9
#: Rounding of a state at rest, relative to the terms that it is the sum of: slow motions gather it over many samples.
_ROUNDING = 1e-13


def iterate(
    system: LureSystem,
    input: InputSignal | Mapping[str, InputSignal] | None,
    t_end: float,
    t_eval: Array | None = None,
    max_steps: int = MOST_SAMPLES,
) -> Trajectory:
    """Run a discrete-time loop up to `t_end`; signals at every sample, or at those that `t_eval` names.

    A run of more than `max_steps` samples stops there and says so.

    Raises
    ------
    EppError
        If the run has more samples than can be kept.
    ModelError
        If elements feed each other without a delay of at least one sample in a circle, an input is unknown, or a dead
        time or a time of `t_eval` is no whole number of samples.
    """
    step = float(system.time_step or 1.0)
    wanted = _samples_of(system, t_end / step)
    n = min(wanted, max_steps) + 1
    t: Array = np.asarray(step * np.arange(n), float)
    v = np.tile(system.v0, (n, 1))
    input_signals = input_signals_by_name(system.input_names, input)
    unknown = set(input_signals) - set(system.input_names)
    if unknown:
        known = ", ".join(system.input_names) or "none"
        raise ModelError(f"{system.name} has no input {sorted(unknown)[0]!r}", expected=f"one of: {known}")
    for i, name in enumerate(system.input_names):
        if name in input_signals:
            v[:, i] += input_signals[name].value(t)
    order = cascade_order(system)
    x, memory = system.x0.copy(), list(system.memory)
    lag = whole_samples(system, "a dead time", system.delays)
    shown = np.arange(n) if t_eval is None else whole_samples(system, "a time of t_eval", t_eval)
    shown = shown[shown < n]
    W = np.zeros((n, system.B.shape[1]))
    X = np.zeros((n, x.size))
    for k in range(n):
        X[k] = x
        W[k], memory = _outputs(system, order, x, v[k], memory)
        # Before the start a delayed output has had its first value for ever, as in continuous time.
        late = np.array([W[max(k - d, 0), j] for j, d in enumerate(lag)])
        x = system.A @ x + system.B @ late + system.B_input @ v[k] + system.constant_state
    s = system.signals
    Y = X @ s.C.T + W @ s.D.T + v @ s.D_input.T + s.constant
    signals = dict(zip(s.names, Y.T.copy(), strict=True))
    rounding = _rounding(system, X, W, v)
    status, period, change = _verdict(X, rounding)
    early = n <= wanted
    if early and status is Status.SETTLED:  # what stops before its time has not shown that it rests
        status = Status.EVENT_LIMIT
    facts = Provenance("iteration", {"t_end": t_end, "time_step": step, "system": system.name})
    cycle = cycle_of_samples(signals, period, step, change, facts) if status is Status.LIMIT_CYCLE else None
    if cycle is not None and not np.any(lag):
        # Values inside a dead time would be missing from the memory. The state at the end is that at the begin, a whole
        # number of periods before.
        cycle = replace(cycle, state=x, memory=tuple(map(_plain, memory)), mean_state=X[-period:].mean(axis=0))
    return Trajectory(
        t=t[shown],
        signals={k: y[shown] for k, y in signals.items()},
        events=(),
        status=status,
        limit_cycle=cycle,
        settled_at={k: float(y[-1]) for k, y in signals.items()} if status is Status.SETTLED else {},
        settled_since=_since(t, X, period, rounding) if status.ok else float("nan"),
        note=f"The run stopped after {n - 1} of {wanted} samples; give it more (max_steps)." if early else "",
        units=s.units_of_results(),
        provenance=facts,
    )


def _samples_of(system: LureSystem, samples: float) -> int:
    if not samples <= MOST_SAMPLES:
        raise EppError(
            f"simulate: the run of {system.name} has {samples:.6g} samples of {system.time_step:g} s; expected at most "
            f"{MOST_SAMPLES}, as of a shorter run."
        )
    return round(samples)


def _plain(memory: Any) -> Any:
    """A memory in plain numbers."""
    if isinstance(memory, tuple):
        return Slip(*map(_plain, memory)) if isinstance(memory, Slip) else tuple(map(_plain, memory))
    return memory.item() if isinstance(memory, np.ndarray | np.generic) else memory


def whole_samples(system: LureSystem, what: str, times: Array) -> IntArray:
    """Times as numbers of samples."""
    step = float(system.time_step or 1.0)
    counts = np.round(times / step)
    for time in times[np.abs(times / step - counts) > _WHOLE].tolist():
        raise ModelError(f"{system.name}: {what} is {time:g} s", expected=f"a whole number of samples of {step:g} s")
    return np.asarray(counts, np.int64)


def _since(t: Array, X: Array, period: int, rounding: Array) -> float:
    """From when on the state is where it rests, or where it is one period later, to a millionth of its motion."""
    later = X[period:] if period else X[-1:]
    away = np.abs(X[: len(X) - period] - later) > np.maximum(1e-6 * np.ptp(X, axis=0), rounding)
    moving = np.flatnonzero(np.any(away, axis=1))
    return float(t[moving[-1] + 1]) if moving.size else 0.0


def cascade_order(system: LureSystem) -> list[int]:
    """Order in which elements can be evaluated, each after those that feed it directly."""
    feeds = np.zeros((len(system.elements),) * 2, bool)
    for i, zs in enumerate(system.input_slices):
        for j, ws in enumerate(system.output_slices):
            feeds[i, j] = bool(np.any(system.D[zs, ws]))
    order: list[int] = []
    while len(order) < len(system.elements):
        ready = [
            i
            for i in range(len(system.elements))
            if i not in order and not feeds[i, [j for j in range(len(feeds)) if j not in order]].any()
        ]
        if not ready:
            raise ModelError(
                f"{system.name}: elements feed each other in a circle without delay", expected="one sample at least"
            )
        order.append(ready[0])
    return order


def _outputs(system: LureSystem, order: list[int], x: Array, v: Array, memory: list) -> tuple[Array, list]:
    w = np.zeros(system.B.shape[1])
    z = system.C @ x + system.D_input @ v + system.constant_input
    memory = list(memory)
    for i in order:
        zs, ws = system.input_slices[i], system.output_slices[i]
        value = z[zs] + system.D[zs] @ w
        element = system.elements[i]
        y, memory[i] = element.output(value[0] if element.n_inputs == 1 else value, memory[i])
        w[ws] = y
    return w, memory


def _rounding(system: LureSystem, X: Array, W: Array, v: Array) -> Array:
    """How far each state moves by rounding alone of the terms of itself and of the elements' inputs, (n,)."""
    reached, made = np.abs(X).max(0), np.abs(W).max(0)
    forced = v @ system.D_input.T + system.constant_input
    seen = np.abs(system.C) @ reached + np.abs(system.D) @ made + np.abs(forced).max(0)
    moved = np.ptp(X @ system.C.T + W @ system.D.T + forced, axis=0)
    for zs, ws in zip(system.input_slices, system.output_slices, strict=True):
        # As outputs follow inputs on this motion, they follow the rounding of inputs.
        made[ws] += np.ptp(W[:, ws], axis=0) * seen[zs].max() / max(moved[zs].max(), np.finfo(float).tiny)
    given = np.abs(v @ system.B_input.T + system.constant_state).max(0)
    return _ROUNDING * (np.abs(system.A) @ reached + np.abs(system.B) @ made + given)


def _verdict(X: Array, rounding: Array) -> tuple[Status, int, float]:
    """At rest, periodic with a whole number of samples, or undecided."""
    if not np.all(np.isfinite(X)):
        return Status.DIVERGED, 0, float("nan")
    tail = X[len(X) // 2 :]
    size = np.ptp(X, axis=0)
    moved = np.ptp(X[-max(2, len(X) // 10) :], axis=0)
    if np.all(moved <= np.maximum(1e-6 * size, rounding)):
        return Status.SETTLED, 0, 0.0
    scale = np.maximum(np.ptp(tail, axis=0), 1e-300)
    near = np.all(np.abs(tail[::-1][: len(tail) // 3] - tail[-1]) < _REPEATS * scale, axis=1)
    # One sample that has come back may be chance: the whole last period is held against the one before it.
    for period in (np.flatnonzero(near[1:]) + 1).tolist():
        recent = np.abs(tail[-period:] - tail[-2 * period : -period]) / scale
        if recent.max() < _REPEATS:
            return Status.LIMIT_CYCLE, period, float(recent.max())
    return Status.UNDECIDED, 0, float("nan")


def cycle_of_samples(
    signals: dict[str, Array], period: int, step: float, change: float, facts: Provenance
) -> LimitCycle:
    """The cycle that signals are on over their last `period` samples."""
    last = {k: y[-period:] for k, y in signals.items()}
    harmonics = {}
    for name, y in last.items():
        c = np.fft.rfft(y) / period
        # An even number of samples has one at the highest frequency that is its own mirror image.
        c[1 : (period + 1) // 2] *= 2.0
        harmonics[name] = c
    return LimitCycle(
        method=SIMULATION,
        status=Status.CONVERGED,
        period=period * step,
        mean={k: float(y.mean()) for k, y in last.items()},
        peak_to_peak={k: float(np.ptp(y)) for k, y in last.items()},
        harmonics=harmonics,
        stable=True,
        stability_criterion="reached in simulation",
        residual=change,
        error_estimate=change,
        time=np.asarray(step * np.arange(period), float),
        waveform=last,
        provenance=facts,
    )
