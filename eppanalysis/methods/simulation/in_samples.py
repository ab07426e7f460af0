"""A loop in discrete time is run round a sampled controller; its user knows its motions by their samples."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from eppanalysis.arrays import Array, ComplexArray
from eppanalysis.errors import EppError
from eppanalysis.methods.simulation.runs import run_hybrid, run_in_time
from eppanalysis.methods.simulation.times import sample_times
from eppanalysis.models.systems.hybrid import HybridSystem
from eppanalysis.models.systems.inputs import InputSignal, input_signals_by_name
from eppanalysis.models.systems.lure import LureSystem
from eppanalysis.models.systems.operating import OperatingPoint
from eppanalysis.models.systems.sampled.clocked import Clocked, whole_samples
from eppanalysis.models.systems.sampled.strobe import Strobe
from eppanalysis.results import LimitCycle, Status, Trajectory
from eppanalysis.results.events import Event, Events

#: Samples of a run: some minutes, and a gigabyte of signals.
MOST_SAMPLES = 2_000_000
#: How near a period must be to a whole number of samples to be one; turns over which another one is averaged, and its
#: harmonics.
_WHOLE, _TURNS, _HARMONICS = 1e-9, 40, 40


@dataclass(frozen=True, eq=False)
class InSamples:
    """A loop in discrete time and the loop that it is run as; offers what :class:`OtherStates` does."""

    clocked: Clocked

    @classmethod
    def at(cls, system: LureSystem, point: OperatingPoint) -> InSamples:
        """That of a loop whose inputs are at an operating point."""
        return cls(Clocked.of(system, point.vector(system)))

    @classmethod
    def under(cls, system: LureSystem, given: Mapping[str, InputSignal]) -> InSamples:
        """That of a loop under input signals, as they are at its start."""
        steps = [given[name].value(np.zeros(1))[0] if name in given else 0.0 for name in system.input_names]
        return cls(Clocked.of(system, system.v0 + np.array(steps, float)))

    def of(self, system: LureSystem) -> LureSystem:
        """A loop with the same states as the user's, such as his own at other values, as it is run."""
        return self.beside(system).system

    def beside(self, system: LureSystem) -> InSamples:
        """That of the user's loop at other values."""
        return InSamples(Clocked.of(system))

    @property
    def system(self) -> LureSystem:
        """The loop round a sampled controller."""
        return self.clocked.system

    def start(self, state: Array, memory: Sequence[Any]) -> tuple[Array, tuple[Any, ...]]:
        """State and memories of :attr:`system` at a state of the user's with what his elements remember."""
        return self.clocked.start(state, memory)

    def from_user(self, cycle: LimitCycle) -> LimitCycle:
        """A cycle in the user's states as one of the loop; the mean of its states stays untold."""
        state, memory = self.start(cycle.require_state(len(self.clocked.given.A)).state, cycle.memory)
        return replace(cycle, state=state, memory=memory, mean_state=np.zeros(0))

    def state(self, y: Array) -> Array:
        """The user's state of the loop's states and memory values."""
        return y[1:][self._outputs]  # behind the clock

    def moved(self, start: HybridSystem, state: Array, inputs: Array) -> HybridSystem:
        """A start behind a sample with the user's states (n,) and the inputs (nv,) moved by so much since then."""
        own, held = self._own, self._outputs
        x0, H0 = start.x0.copy(), start.H0.copy()
        x0[start.n_plant :] += inputs
        H0[: len(state)] += state
        H0[held] += state
        H0[2 * own : 2 * own + len(inputs)] += inputs
        return replace(start, x0=x0, H0=H0)

    def range_of(self, cycle: LimitCycle) -> Array:
        """How far each of the user's states moves on a cycle in them, shape (n,)."""
        asked = self.from_user(cycle)
        start = HybridSystem.from_lure(self.system).held.begun(asked.state, asked.memory)
        return np.ptp(self._samples(start, int(np.ceil(cycle.period / self.clocked.time_step)))[0], axis=0)

    @property
    def _own(self) -> int:
        """How many states the controller has: the user's, and outputs on their way through dead times."""
        return len(np.asarray(self.clocked.controller.x0))

    @property
    def _outputs(self) -> slice:
        """Places of the states of the last sample among the memory values: behind the controller's own."""
        return slice(self._own, self._own + len(self.clocked.given.A))

    def to_user(self, cycle: LimitCycle, start: HybridSystem | None = None) -> LimitCycle:
        """A cycle of the loop as its samples have it: states, signals at samples, and their discrete Fourier series.

        It is run from its own state, with the inputs held, or from a `start` on it.
        """
        if not cycle.state.size:
            return cycle
        loop, T = self.clocked.given, self.clocked.time_step
        period, n = cycle.period / T, len(loop.A)
        locked = abs(period - round(period)) < _WHOLE * period
        count = round(period) if locked else int(_TURNS * period)
        if start is None:
            start = HybridSystem.from_lure(self.system).held.begun(cycle.state, cycle.memory)
        x, Y = self._samples(start, count)
        period = float(count) if locked else _turn(Y[:, 0], period)
        shown = slice(count if locked else int(period) + 1)
        names = loop.signals.names
        return replace(
            cycle,
            period=cycle.period if locked else period * T,
            mean=dict(zip(names, Y.mean(axis=0).tolist(), strict=True)),
            peak_to_peak=dict(zip(names, np.ptp(Y, axis=0).tolist(), strict=True)),
            harmonics=dict(zip(names, _series(Y, period), strict=True)),
            time=T * np.arange(len(Y[shown]), dtype=float),
            waveform=dict(zip(names, Y[shown].T.copy(), strict=True)),
            state=x[0, :n].copy(),
            mean_state=x[:, :n].mean(axis=0),
            memory=cycle.memory[1:],
            events=_without_samples(cycle.events, self),
            event_states=np.zeros((0, n)),
        )

    def _samples(self, hybrid: HybridSystem, count: int) -> tuple[Array, Array]:
        """States and signals at so many samples from a start on, shapes (count, n), (count, signals)."""
        strobe, T = Strobe.of(hybrid), self.clocked.time_step
        assert strobe is not None
        most = (2 + len(hybrid.elements)) * count + 100
        times: Array = np.asarray(T * (np.arange(count) + 0.5), float)
        run = run_hybrid(hybrid, float(times[-1]), times, T, 100 * most, most)
        order = run.order[run.guard[run.order] == strobe.guard]
        held = np.vstack([hybrid.H0, run.memory_values[order]])[:count]
        return held[:, self._outputs], run.samples[:count]


def simulate_in_samples(
    system: LureSystem,
    input: InputSignal | Mapping[str, InputSignal] | None,
    t_end: float,
    t_eval: Array | None,
    max_events: int,
    max_steps: int,
) -> Trajectory:
    """See ``simulate``: signals at every sample up to `t_end`, or at those that `t_eval` names.

    A run of more than `max_steps` samples stops there and says so.

    Raises
    ------
    EppError
        If the run has more samples than can be kept.
    ModelError
        If an input is unknown, or a dead time or a time of `t_eval` is no whole number of samples.
    """
    T = float(system.time_step or 1.0)
    if not t_end / T <= MOST_SAMPLES:
        raise EppError(
            f"simulate: the run of {system.name} has {t_end / T:.6g} samples of {T:g} s; expected at most "
            f"{MOST_SAMPLES}, as of a shorter run."
        )
    wanted = round(t_end / T)
    n = min(wanted, max_steps)
    given = input_signals_by_name(system.input_names, input)
    form = InSamples.under(system, given)
    counts = np.arange(n + 1) if t_eval is None else whole_samples(system, "a time of t_eval", t_eval)
    counts = counts[counts <= n]
    # Nothing moves between samples, so that all that a sample brings about is seen half a sample later.
    end = (n + 0.5) * T
    made = run_in_time(form.system, given, end, sample_times(end, T * (counts + 0.5)), False, max_events)
    return _at_samples(form, made, np.asarray(T * counts, float), OperatingPoint.of(system, input, t_end), n, wanted)


def _at_samples(form: InSamples, made: Trajectory, t: Array, at: OperatingPoint, n: int, wanted: int) -> Trajectory:
    """A run of n samples looked at amid them, as one at their times."""
    T = form.clocked.time_step
    early, status, again = n < wanted, made.status, made.again
    if early and status is Status.SETTLED:  # what stops before its time has not shown that it rests
        status = Status.EVENT_LIMIT
    cycle = made.limit_cycle and replace(form.to_user(made.limit_cycle), operating_point=at)

    def at_times(times: Array) -> Mapping[str, Array]:
        assert again is not None
        return again(times + 0.5 * T)

    stopped = f"The run stopped after {n} of {wanted} samples; give it more (max_steps)."
    return replace(
        made,
        t=t[: made.t.size],
        status=status,
        limit_cycle=cycle,
        settled_since=T * float(np.floor(made.settled_since / T + 0.25)),  # of an event at a sample, or amid samples
        events=_without_samples(made.events, form),
        n_events=made.n_events - n,
        note=stopped if early else made.note,
        operating_point=at,
        again=at_times,
    )


def _without_samples(events: Sequence[Event], form: InSamples) -> Sequence[Event]:
    return events.without(form.system.element_names[0]) if isinstance(events, Events) else events


def _turn(y: Array, about: float) -> float:
    """Mean length of the turns of a signal [samples], by where it passes its middle upwards, from an estimate."""
    middle = 0.5 * (y.max() + y.min())
    before = np.flatnonzero((y[:-1] < middle) & (y[1:] >= middle))
    if before.size < 2:
        return about
    span = float(np.ptp((before + (middle - y[before]) / (y[before + 1] - y[before]))[[0, -1]]))
    return span / max(round(span / about), 1)


def _series(Y: Array, period: float) -> list[ComplexArray]:
    """Fourier coefficients of signals (samples, s) over one whole period [samples], or over many that are none."""
    if period == len(Y):
        c, last = np.fft.rfft(Y, axis=0) / len(Y), (len(Y) + 1) // 2
    else:
        k = np.arange(min(int(period / 2.0), _HARMONICS) + 1)
        c, last = np.exp(-2j * np.pi / period * np.outer(k, np.arange(len(Y)))) @ Y / len(Y), k.size
    c[1:last] *= 2.0  # an even number of samples has one at the highest frequency that is its own mirror image
    return [np.asarray(each, complex) for each in c.T]
