"""The flow of a loop: where a start is a time later, and the derivative of that by the start.

What drives a loop or samples it is a part of it: the clock of sampled controllers is a state, and so are the sine and
cosine of an input. What only tells the time (clocks, counts of samples, readings of a clock) goes on for ever; at the
end of a pass it is turned back by the time of the pass, so that a motion that repeats itself ends where it began
(docs/theory/flow.md).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from eppanalysis.arrays import Array, BoolArray, IntArray
from eppanalysis.engine.orbits import READY, TOUCHES, derivative_of_run
from eppanalysis.errors import EppError
from eppanalysis.methods.simulation.kept import Run
from eppanalysis.methods.simulation.runs import run_hybrid
from eppanalysis.methods.simulation.workspaces import of_thread
from eppanalysis.models.systems.hybrid import HybridSystem, of_model
from eppanalysis.models.systems.sampled.strobe import Strobe

#: Events of a pass beside the samples of controllers; a run with more is no part of a motion that could be closed.
MOST_EVENTS = 5_000


@dataclass(frozen=True, eq=False)
class Pass:
    """A run over a time from a start: its events, where it ends, how far the motion reaches, and the derivative.

    States and memory values are stacked into one vector ``y = (x, H)`` of N numbers, the last of which is 1.
    """

    start: HybridSystem
    duration: float  # [s]
    run: Run

    @cached_property
    def events(self) -> IntArray:
        """Places in the run's buffer of the events of elements, oldest first."""
        return self.run.switches(self.start)

    @cached_property
    def range(self) -> Array:
        """Least and largest value of each place of y, what tells the time in memory turned back, shape (2, N)."""
        n, range_ = self.start.x0.size, np.empty((2, self.y.size))
        told = np.outer(self.times, advances(self.start)[n:])
        memory = np.vstack([self.start.H0, self.run.memory_values[self.events]]) - told
        range_[0, :n], range_[1, :n] = self.run.low, self.run.high
        range_[0, n:], range_[1, n:] = memory.min(axis=0), memory.max(axis=0)
        return range_

    @property
    def rows(self) -> Array:
        """What follows the start and each event, its clocks as they are there, shape (events + 1, N)."""
        rows = np.empty((self.events.size + 1, self.y.size))
        n = self.start.x0.size
        rows[0], rows[1:, :n], rows[1:, n:] = self.y, self.run.state[self.events], self.run.memory_values[self.events]
        return rows

    @property
    def times(self) -> Array:
        """When the start and each event is [s], shape (events + 1,)."""
        return np.append(0.0, self.run.time[self.events])

    @cached_property
    def y(self) -> Array:
        """The start, shape (N,)."""
        return stacked(self.start)

    @cached_property
    def rate_at_start(self) -> Array:
        """Rate of y at the start, shape (N,)."""
        n = self.start.x0.size
        instant = run_over(self.start, 1e-12 * self.duration)
        return np.append((self.run if instant is None else instant).rate_end, np.zeros(self.y.size - n))

    @cached_property
    def _derivative(self) -> tuple[Array, Array, bool]:
        start, run, order = self.start, self.run, self.events
        base = 2.0 * start.time_scale
        compiled, work, _ = of_thread.workspaces(start, base)
        N = start.x0.size + start.H0.size
        D, shift = np.empty((N, N)), np.empty(N)
        met = run.time[order], run.guard[order], run.state[order], run.memory_values[order], run.modes[order]
        code = derivative_of_run(start.model, compiled, work, base, self.y, start.modes0, met, self.duration, D, shift)
        if code not in (READY, TOUCHES):
            D[:], shift[:] = np.nan, np.nan
        return D, shift, code == TOUCHES

    @property
    def derivative(self) -> Array:
        """Derivative of the end by the start, shape (N, N); nan where a guard is only touched."""
        return self._derivative[0]

    @property
    def shift(self) -> Array:
        """How much later the events come for a disturbance of the start, shape (N,)."""
        return self._derivative[1]

    @property
    def on_a_border(self) -> bool:
        """Whether a jump only just brings an event about: beyond, the derivative is another one."""
        return self._derivative[2]


def stacked(there: HybridSystem) -> Array:
    """States and memory values in one vector y, shape (N,)."""
    return np.concatenate([there.x0, there.H0])


@of_model
def strobe_of(hybrid: HybridSystem) -> Strobe | None:
    """The samples of its controllers; None where nothing is sampled."""
    return Strobe.of(hybrid)


@of_model
def ticks(hybrid: HybridSystem) -> BoolArray:
    """Memory values that count samples, shape (h,)."""
    strobe = strobe_of(hybrid)
    return np.zeros(hybrid.model.K.shape[1], bool) if strobe is None else strobe.counting


@of_model
def advances(hybrid: HybridSystem) -> Array:
    """What each place of y advances by per unit of time that only tells the time, shape (N,)."""
    model = hybrid.model
    n = model.A.shape[0]
    out = np.zeros(n + model.K.shape[1])
    clock = (model.K[:, -1] != 0) & (np.arange(n) < hybrid.n_plant)
    clock &= ~np.any(model.A, axis=1) & ~np.any(model.B, axis=1) & ~np.any(model.S, axis=1)
    out[:n] = np.where(clock, model.K[:, -1], 0.0)
    strobe, counts = strobe_of(hybrid), ticks(hybrid)
    if strobe is None and not clock.any():
        return out  # nothing tells the time
    # Each memory value that an event sets to what it reads of a clock.
    for e, first in enumerate(model.first[:-1]):
        own = model.guard_element == e
        n_z, n_h = (int(k) for k in (model.first[e + 1] - first)[[0, 2]])
        z0, h0 = int(first[0]), int(first[2])
        on_clock = model.reset_z[own, :n_h, :n_z] @ (model.C[z0 : z0 + n_z] @ out[:n])
        for guard in on_clock[np.any(on_clock != 0.0, axis=1)]:
            place = slice(n + h0, n + h0 + n_h)
            out[place] = np.where(guard != 0.0, guard, out[place])
        if strobe is not None and e in strobe.numbers:
            places = np.flatnonzero(counts[h0 : h0 + n_h]) + n + h0
            out[places] = 1.0 / strobe.controllers[strobe.numbers.index(e)].unit
    return out


@of_model
def repeating(hybrid: HybridSystem) -> IntArray:
    """Places of y that repeat on a steady motion: states that are compared, and values of elements but for counts."""
    strobe = strobe_of(hybrid)
    held = np.arange(hybrid.H0.size) < hybrid.model.first[-1, 2] if strobe is None else strobe.held
    return np.flatnonzero(np.concatenate([hybrid.compared, held]))


@of_model
def _timed(hybrid: HybridSystem) -> BoolArray:
    """States that the time alone moves, shape (n,): clocks and inputs."""
    n = hybrid.x0.size
    return (advances(hybrid)[:n] != 0.0) | (np.arange(n) >= hybrid.n_plant)


def turned_back(there: HybridSystem, start: HybridSystem, duration: float) -> HybridSystem:
    """A system that a motion from a start has come to, with what only tells the time turned back by a duration."""
    back, counts = advances(there)[there.x0.size :] * duration, ticks(there)
    # Whole ticks are counted: a count must not take up the rounding of the clock.
    back[counts] = back[counts].round(9)
    return there.at(np.where(_timed(there), start.x0, there.x0), there.H0 - back, there.modes0)


def run_over(start: HybridSystem, duration: float) -> Run | None:
    """A run from a start; None where it stops early or has more events than are kept."""
    strobe = strobe_of(start)
    most = MOST_EVENTS + (0 if strobe is None else strobe.samples_in(duration))
    try:
        run = run_hybrid(start, duration, np.zeros(0), 2.0 * start.time_scale, most, most)
    except EppError:
        return None
    whole = run.code == 0 and run.count == run.n_kept and bool(np.isfinite(run.x_end).all())
    return run if whole else None


def advance(start: HybridSystem, duration: float) -> Pass | None:
    """The pass over a duration [s] from a start; None where the run stops early or has too many events."""
    run = run_over(start, duration)
    return None if run is None else Pass(start, duration, run)


def later(start: HybridSystem, time: float) -> HybridSystem | None:
    """The system a time later [s], in the modes and with the memory values that it has then; None where it stops."""
    if time <= 0.0:
        return start
    run = run_over(start, time)
    return None if run is None else run.end(start)


def away_from_events(start: HybridSystem, duration: float) -> HybridSystem | None:
    """The system where its longest stretch without events within a duration [s] is half over; None where it stops.

    Begun there a motion keeps its events within a pass when it is moved a little.
    """
    found = advance(start, duration)
    return None if found is None else later(start, float(between_events(found.times[1:], duration, 1)[0]))


def between_events(times: Array, duration: float, parts: int) -> Array:
    """In each of so many equal parts of a duration, when the longest stretch without events is half over (parts,)."""
    marks, middles = np.concatenate([[0.0], times, [duration]]), np.empty(parts)
    for k in range(parts):
        within = np.clip(marks, duration * k / parts, duration * (k + 1) / parts)
        longest = int(np.argmax(np.diff(within)))
        middles[k] = 0.5 * (within[longest] + within[longest + 1])
    return middles
