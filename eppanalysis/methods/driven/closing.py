"""Periodic responses by shooting: Newton's method on the map of the state over a whole number of the input's periods.

The engine runs from a state over that time and tells the events; along them the flow and its derivative are exact, with
the jumps of the derivative at the events (docs/theory/driven.md). So each step is Newton's on the true map, whatever
events the next start meets.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from eppanalysis.arrays import BoolArray, IntArray
from eppanalysis.errors import EppError, ModelError
from eppanalysis.methods.orbits.arcs import Arcs, EventSequence
from eppanalysis.methods.orbits.guess import MOST_ARCS, brought_about, marked
from eppanalysis.methods.orbits.orbit import CONVERGED, Orbit, evaluate, solve
from eppanalysis.methods.orbits.shooting import restarted
from eppanalysis.methods.simulation.kept import Run
from eppanalysis.methods.simulation.simulate import run_hybrid
from eppanalysis.models.systems.hybrid import HybridSystem

_NO_SAMPLES = np.zeros(0)
#: Most events of a run that is kept, and the engine's code for one that reached its end.
_MOST_EVENTS, _ENDED = 4000, 0
_MOST_ITERATIONS = 30
#: Residual below which the sequence of events is taken for the true one, and Newton goes on with it to rounding.
_NEAR = 1e-5
#: Shares of Newton's step that are tried, and the longest step relative to the motion.
_SHARES, _LONGEST = (1.0, 0.4, 0.15, 0.05, 0.015), 1.0
#: Difference between the dwell times of an orbit and those that the engine meets, relative to the period.
_SAME_TIMES = 1e-7


def run_over(start: HybridSystem, duration: float) -> Run | None:
    """A run from a start; None where it stops early or has more events than are kept."""
    try:
        run = run_hybrid(start, duration, _NO_SAMPLES, 2.0 * start.time_scale, _MOST_EVENTS, _MOST_EVENTS)
    except EppError:
        return None
    whole = run.code == _ENDED and run.count == run.n_kept and bool(np.all(np.isfinite(run.x_end)))
    return run if whole else None


def later(start: HybridSystem, time: float) -> HybridSystem | None:
    """The system a time later [s], in the modes and with the memory values that it has then."""
    if time <= 0.0:
        return start
    run = run_over(start, time)
    return None if run is None else run.end(start)


def passed(start: HybridSystem, duration: float) -> Orbit | None:
    """One pass of the duration from a start: its arcs as the engine meets them, the derivative and what does not close.

    None where the run does not come so far, or has too many events or one that arcs do not know.
    """
    run = run_over(start, duration)
    if run is None:
        return None
    rows = run.order[_of_elements(start, run.guard[run.order])]
    if rows.size > MOST_ARCS:
        return None
    tau = np.diff(np.concatenate([[0.0], run.time[rows], [duration]]))
    modes = np.vstack([start.modes0, run.modes[rows]])
    guards = run.guard[rows]
    marks = np.append(brought_about(start.model, guards, tau[:-1]) if rows.size else guards, 0)
    # The last arc ends when the time is over and on no guard: -1 (docs/theory/driven.md, Periodic responses).
    sequence = EventSequence(modes, np.append(guards, -1), np.full((rows.size + 1, 3), -1), marks)
    starts = np.vstack([np.append(start.x0, start.H0), np.hstack([run.state[rows], run.memory_values[rows]])])
    try:
        arcs = replace(Arcs.build(start, sequence), duration=duration)
    except ModelError:
        return None
    arcs = replace(arcs, event_sequence=marked(arcs, starts, tau))
    orbit = evaluate(start, arcs, starts[0].copy(), tau)
    return orbit if np.isfinite(orbit.residual) else None


def _of_elements(hybrid: HybridSystem, guards: IntArray) -> BoolArray:
    """Which events are of elements, not of the observer that only marks extrema."""
    return np.asarray(hybrid.model.guard_element[guards] < len(hybrid.elements))


def quiet(start: HybridSystem, duration: float) -> HybridSystem | None:
    """The system where its longest stretch without events is half over: there no guard is near."""
    run = run_over(start, duration)
    if run is None:
        return None
    times = run.time[run.order[_of_elements(start, run.guard[run.order])]]
    if times.size == 0:
        return start
    gaps = np.diff(times, append=times[0] + duration)
    # Newton's steps move the events: one near the begin would pass it, and the sequence would be another.
    longest = int(np.argmax(gaps))
    return later(start, float(times[longest] + 0.5 * gaps[longest]) % duration)


def ends_as_it_begins(orbit: Orbit) -> bool:
    """Whether every element ends in the mode in which it begins (the observer's is of no consequence)."""
    modes = orbit.arcs.event_sequence.modes[:, : len(orbit.hybrid.elements)]
    return bool(np.array_equal(modes[0], modes[-1]))


def is_true(orbit: Orbit) -> bool:
    """Whether the engine, started on the orbit, meets just its events, and is back at the end."""
    if not ends_as_it_begins(orbit) or np.any(orbit.tau < 0.0):
        return False
    again = passed(begun(orbit), float(orbit.arcs.duration or 0.0))
    if again is None or again.tau.size != orbit.tau.size or again.residual > 100.0 * CONVERGED:
        return False
    same = np.array_equal(again.arcs.event_sequence.guards, orbit.arcs.event_sequence.guards)
    return same and bool(np.max(np.abs(again.tau - orbit.tau)) < _SAME_TIMES * orbit.period)


def begun(orbit: Orbit) -> HybridSystem:
    """The system at the beginning of an orbit."""
    return restarted(orbit.hybrid, orbit.arcs, orbit.y, orbit.arcs.event_sequence.modes[0])


def close(start: HybridSystem, duration: float) -> Orbit | None:
    """The periodic response near a start; None where Newton's method finds none.

    Parameters
    ----------
    start : HybridSystem
        With the input as a state: see :class:`eppanalysis.methods.driven.drive.Drive`.
    duration : float
        A whole number of periods of the input [s].

    Returns
    -------
    Orbit or None
        Begun where no event is near; the engine meets just its events.
    """
    placed = quiet(start, duration)
    orbit = None if placed is None else passed(placed, duration)
    for _ in range(_MOST_ITERATIONS):
        if orbit is None:
            return None
        # Far off each step takes the events that the engine meets from
        # there; near by they are kept, for Newton to reach rounding.
        if orbit.residual < _NEAR and ends_as_it_begins(orbit):
            closed = solve(orbit.hybrid, orbit.guess, orbit.arcs)
            if closed.residual < CONVERGED and is_true(closed):
                return closed
        orbit = _nearer(orbit, duration)
    return None


def _nearer(orbit: Orbit, duration: float) -> Orbit | None:
    """The pass after the longest share of Newton's step that brings end and begin nearer to each other."""
    step, m = -orbit.correction(orbit.r), orbit.arcs.free.size
    size = float(np.max(np.abs(step[:m]) / orbit.column_scale[:m], initial=0.0))
    if not np.isfinite(size):
        return None
    most = min(1.0, _LONGEST / size) if size > 0 else 1.0
    for share in _SHARES:
        y, _ = orbit.moved(most * share * step)
        start = restarted(orbit.hybrid, orbit.arcs, y, orbit.arcs.event_sequence.modes[0])
        new = passed(start, duration)
        if new is not None and not ends_as_it_begins(new):
            # An event has passed the begin, or what holds memory is elsewhere: go on from where no event is near.
            placed = quiet(start, duration)
            new = None if placed is None else passed(placed, duration)
        if new is not None and _gap(new, orbit) < (1.0 - 0.1 * share) * _gap(orbit, orbit) + CONVERGED:
            return new
    return None


def _gap(one: Orbit, other: Orbit) -> float:
    """How far begin and end of a pass are apart, in the measure of another one."""
    n = one.arcs.n_state
    away = np.abs(one.starts[-1] - one.y)[:n][one.hybrid.compared] / other.scale[:n][one.hybrid.compared]
    return float(np.max(away, initial=0.0))
