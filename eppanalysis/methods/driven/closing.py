"""The equations along the events of a pass, whose duration an input tells: what its users see of a response is made of
them (docs/theory/driven.md).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from eppanalysis.errors import ModelError
from eppanalysis.methods.orbits.arcs import Arcs, EventSequence
from eppanalysis.methods.orbits.guess import MOST_ARCS, brought_about, marked
from eppanalysis.methods.orbits.orbit import Orbit, evaluate
from eppanalysis.methods.orbits.shooting import restarted
from eppanalysis.methods.steady.flow import Pass, advance
from eppanalysis.models.systems.hybrid import HybridSystem


def passed(start: HybridSystem, duration: float) -> Orbit | None:
    """One pass of the duration from a start: its arcs as the engine meets them, the derivative and what does not close.

    None where the run does not come so far, or has too many events or one that arcs do not know.
    """
    found = advance(start, duration)
    return None if found is None else along(found)


def along(found: Pass) -> Orbit | None:
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


def begun(orbit: Orbit) -> HybridSystem:
    """The system at the beginning of an orbit."""
    return restarted(orbit.hybrid, orbit.arcs, orbit.y, orbit.arcs.event_sequence.modes[0])
