"""Cycles that are one of a continuum, or are at its border: what is between two of them is a cycle, too."""

from __future__ import annotations

import numpy as np

from eppanalysis.arrays import Array, IntArray
from eppanalysis.methods.orbits.orbit import Orbit
from eppanalysis.methods.orbits.shooting import run_from

#: An orbit grazes a guard when it crosses it more slowly than this share of its movement across it in a period.
_GRAZING = 1e-3
#: Relative difference of the periods of a linear oscillation that is rounding.
_SAME_PERIOD = 1e-8
#: Distance of a multiplier from one of an orbit to which others come ever more slowly; how many periods an orbit of one
#: continuum may take for another's switches; change once round, relative to the motion, that is none, as runs come no
#: nearer to an end.
_SLOW, _LONG, _BACK = 1e-3, 10.0, 1e-6


def on_rim(known: Orbit, orbit: Orbit) -> bool:
    """Whether an orbit only grazes a guard and is the outermost of a continuum without that switch."""
    if not has_period_of(known, orbit.period):
        return False
    return bool(np.any(orbit.grazes(_GRAZING) & (orbit.arcs.event_sequence.at_once != 1)))


def has_period_of(known: Orbit, period: float) -> bool:
    """Whether a period is that of a continuum of cycles, or a multiple of it."""
    turns = period / known.period
    return known.one_of_many and round(turns) >= 1 and abs(turns / round(turns) - 1.0) < _SAME_PERIOD


def at_end(known: Orbit, orbit: Orbit) -> bool:
    """Whether an orbit is at the end of a continuum: midway to another one of it there is one, too.

    At the end a stretch of it has shrunk to nothing, or is about to, and others come near it ever more slowly.
    """
    if not known.one_of_many or orbit.motion is not None or not np.any(np.abs(orbit.multipliers - 1.0) < _SLOW):
        return False
    guards = known.arcs.event_sequence.guards
    turned = (orbit.rotated(k) for k in range(orbit.tau.size) if orbit.tau.size == guards.size)
    alike = (o for o in turned if np.array_equal(o.arcs.event_sequence.guards, guards))
    return any(_closes(known, 0.5 * (known.y + o.y)) for o in alike)


def _closes(known: Orbit, y: Array) -> bool:
    """Whether a run from y is back there when it has passed the switches of an orbit."""
    guards, n = known.arcs.event_sequence.guards, known.hybrid.x0.size
    run = run_from(known, _LONG * known.period, guards.size, y)
    if not np.array_equal(run.guard[run.order], guards):
        return False
    last = run.order[-1]
    there = np.concatenate([run.state[last] - y[:n], run.memory_values[last] - y[known.arcs.memory]])
    sizes = np.concatenate([known.scale[:n], known.scale[known.arcs.memory]])
    counts = np.concatenate([known.hybrid.compared, np.ones(len(sizes) - n, bool)])
    return bool(np.all(np.abs(there)[counts] <= _BACK * sizes[counts]))


def same_continuum(one: Orbit, other: Orbit) -> bool:
    """Whether two orbits of continua pass through the same switches and are as stable: one then represents both."""
    if not (other.one_of_many and has_switches_of(one, other.arcs.event_sequence.guards)):
        return False
    unstable = [int(np.sum(np.abs(o.multipliers) > 1.0 + 1e-4)) for o in (one, other)]
    return unstable[0] == unstable[1]


def has_switches_of(known: Orbit, guards: IntArray) -> bool:
    """Whether a turn through these guards is one through the switches of a continuum."""
    own = known.arcs.event_sequence.guards
    return (
        known.one_of_many
        and own.size == guards.size
        and any(np.array_equal(np.roll(own, k), guards) for k in range(own.size))
    )
