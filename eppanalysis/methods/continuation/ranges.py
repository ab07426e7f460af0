"""How far the states and signals of an orbit reach, exactly, and whether two orbits are alike by that."""

from __future__ import annotations

import numpy as np

from eppanalysis.arrays import Array
from eppanalysis.engine.orbits import extents
from eppanalysis.methods.orbits.cycle import gained, orbit_shape
from eppanalysis.methods.orbits.orbit import Orbit
from eppanalysis.models.systems.lure import LureSystem

#: Largest difference of orbits that could be neighbours, relative to their size.
NEAR = 0.1


def near(one: Orbit, other: Orbit, most: float = NEAR) -> bool:
    """Whether two orbits could be neighbours on a branch: periods and ranges of the states are alike."""
    if abs(one.period / other.period - 1.0) > 0.5 * most:
        return False
    # What elements put out may jump at a border, by a level of a quantiser.
    (low, high), (other_low, other_high) = (_ranges_of_states(orbit) for orbit in (one, other))
    span = np.where(other_high > other_low, other_high - other_low, np.inf)
    return bool(max(np.max(np.abs(low - other_low) / span), np.max(np.abs(high - other_high) / span)) < most)


def _ranges_of_states(orbit: Orbit) -> tuple[Array, Array]:
    """Smallest and largest value of every state that must repeat."""
    arcs = orbit.arcs
    rows = np.eye(arcs.size)[: orbit.hybrid.n_plant][orbit.hybrid.compared[: orbit.hybrid.n_plant]]
    Y = np.broadcast_to(rows, (arcs.n_arcs, *rows.shape)).copy()
    return _ranges(orbit, Y, np.zeros((*Y.shape[:2], arcs.Ys.shape[2])))


def signal_ranges(orbit: Orbit) -> tuple[Array, Array]:
    """Smallest and largest value of every signal, exactly."""
    return _ranges(orbit, orbit.arcs.Y, orbit.arcs.Ys)


def signal_sizes(system: LureSystem, orbit: Orbit) -> Array:
    """Peak-to-peak of every signal, exactly; of one that goes on for ever its swing beside that, from its waveform."""
    low, high = signal_ranges(orbit)
    goes_on = gained(orbit) != 0.0
    if not np.any(goes_on):
        return high - low
    swings = orbit_shape(system, orbit).peak_to_peak
    return np.where(goes_on, [swings[name] for name in system.signals.names], high - low)


def _ranges(orbit: Orbit, Y: Array, Ys: Array) -> tuple[Array, Array]:
    arcs, low, high = orbit.arcs, np.empty(Y.shape[1]), np.empty(Y.shape[1])
    # What an element gives in a mode that it leaves at once is no value of the motion.
    lasts = np.flatnonzero(arcs.event_sequence.at_once != 1)
    acting = arcs.acting and arcs.acting._replace(sense=arcs.acting.sense[lasts])
    F, S, smooth = arcs.F[lasts], arcs.S[lasts], arcs.smooth[lasts]
    extents(acting, F, S, smooth, Y[lasts], Ys[lasts], orbit.starts[:-1][lasts], orbit.tau[lasts], low, high)
    return low, high
