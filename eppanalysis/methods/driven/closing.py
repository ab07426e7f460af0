"""Periodic responses as steady motions of the flow, and the equations along their events for what follows them.

The duration of a response is a whole number of the input's periods; the sine is two states of the flow (docs/theory/
driven.md).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from eppanalysis.errors import ModelError
from eppanalysis.methods.orbits.arcs import Arcs, EventSequence
from eppanalysis.methods.orbits.guess import MOST_ARCS, brought_about, marked
from eppanalysis.methods.orbits.orbit import CONVERGED, Orbit, evaluate, solve
from eppanalysis.methods.orbits.shooting import restarted
from eppanalysis.methods.steady.closing import close as closed_pass
from eppanalysis.methods.steady.flow import Pass, advance
from eppanalysis.methods.steady.motion import SteadyMotion
from eppanalysis.models.systems.hybrid import HybridSystem


def passed(start: HybridSystem, duration: float) -> Orbit | None:
    """One pass of the duration from a start: its arcs as the engine meets them, the derivative and what does not close.

    None where the run does not come so far, or has too many events or one that arcs do not know.
    """
    found = advance(start, duration)
    return None if found is None else _along(found)


def _along(found: Pass) -> Orbit | None:
    """The equations along the events of a pass."""
    start, run, rows = found.start, found.run, found.events
    if rows.size > MOST_ARCS:
        return None
    tau = np.diff(np.concatenate([[0.0], run.time[rows], [found.duration]]))
    modes, guards = np.vstack([start.modes0, run.modes[rows]]), run.guard[rows]
    marks = np.append(brought_about(start.model, guards, tau[:-1]) if rows.size else guards, 0)
    # The last arc ends when the time is over and on no guard: -1 (docs/theory/driven.md, Periodic responses).
    sequence = EventSequence(modes, np.append(guards, -1), np.full((rows.size + 1, 3), -1), marks)
    try:
        arcs = replace(Arcs.build(start, sequence), duration=found.duration)
    except ModelError:
        return None
    arcs = replace(arcs, event_sequence=marked(arcs, found.rows, tau))
    orbit = evaluate(start, arcs, found.y, tau)
    return orbit if np.isfinite(orbit.residual) else None


def ends_as_it_begins(orbit: Orbit) -> bool:
    """Whether every element ends in the mode in which it begins (the observer's is of no consequence)."""
    modes = orbit.arcs.event_sequence.modes[:, : len(orbit.hybrid.elements)]
    return bool(np.array_equal(modes[0], modes[-1]))


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
    found = closed_pass(SteadyMotion.begun(start, duration), given=True)
    orbit = None if found is None else _along(found.passes[0])
    if orbit is None:
        return None
    # To rounding along the events that the engine has met.
    finished = solve(orbit.hybrid, orbit.guess, orbit.arcs)
    return finished if finished.residual < CONVERGED else None
