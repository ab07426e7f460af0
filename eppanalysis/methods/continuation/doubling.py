"""Where a multiplier is -1: the branch of orbits of twice the period that leaves there, and how it is recognised.

At such a point the orbit, gone round twice, is a solution of the equations for the doubled sequence of events, and the
eigenvector of the multiplier -1 is a second direction in which these solutions go on: disturbed by it, the first turn
ends on the other side, and the second turn brings it back.
"""

from __future__ import annotations

import numpy as np

from eppanalysis.errors import EppError
from eppanalysis.methods.continuation.families import Family
from eppanalysis.methods.continuation.steps import BranchPoint, admissible, step, weights
from eppanalysis.methods.orbits.arcs import Arcs, EventSequence
from eppanalysis.methods.orbits.orbit import Orbit, evaluate

#: Shares of the wanted step that are tried: beside the point Newton's range and the doubled sequence may be short.
_SHARES = (1.0, 0.3, 0.1, 0.03, 0.01)
#: Relative difference between the two turns of an orbit below which it is the orbit of half the period.
_ALIKE = 1e-3


def doubled(family: Family, point: BranchPoint, length: float) -> BranchPoint:
    """The first orbit on the branch of twice the period.

    Parameters
    ----------
    point : Point
        With a multiplier -1.
    length : float
        Distance from the point, in the measure of the branch.

    Raises
    ------
    EppError
        If no multiplier is -1, no such orbit is found, or the loop has dead time.
    """
    orbit, value = point.orbit, point.value
    if half_alike(orbit):
        raise EppError(
            f"continue_branch: origin is where the cycles of twice the period end, at {value:.6g}; expected a period "
            "doubling of the branch of half the period."
        )
    if orbit.arcs.n_timers:
        raise EppError("continue_branch: cycles of doubled period are not followed in a loop with dead time.")
    arcs, m = orbit.arcs, orbit.arcs.free.size
    scale = orbit.scale[arcs.free]
    values, vectors = np.linalg.eig(orbit.return_map * scale / scale[:, None])
    k = int(np.argmin(np.abs(values + 1.0)))
    if abs(values[k] + 1.0) > 1e-3:
        raise EppError(
            f"continue_branch: the multiplier nearest to -1 is {values[k]:.6g}; expected a period doubling as origin."
        )
    start = vectors[:, k].real * scale
    # Dwell times follow from the disturbance of the start by the equations of the guards; in the second turn both are
    # reversed.
    dwell = -np.linalg.solve(orbit.A[m:, m:], orbit.A[m:, :m] @ start)
    twice = _gone_round_twice(orbit)
    direction = np.concatenate([start, dwell, -dwell, [0.0]])
    direction /= np.sqrt(np.sum(weights(twice, family.width) * direction**2))
    # Distance is how far the dwell times of the turns are apart: on the branch of half the period they are alike, so
    # that Newton's method cannot follow that one instead.
    across = np.concatenate([np.zeros(m), dwell, -dwell, [0.0]])
    across /= across @ direction
    begin = BranchPoint(family, value, twice, family.slope(twice, value), direction)
    for share in _SHARES:
        new = step(begin, share * length, across)
        if new is not None and not half_alike(new.orbit, 1e-2 * share * length) and admissible(new):
            return new
    raise EppError(
        "continue_branch: no orbit of twice the period with the doubled sequence of events was found beside "
        f"{value:.6g}; where a contact is about to change there, a run beyond the point shows what follows."
    )


def _gone_round_twice(orbit: Orbit) -> Orbit:
    it = orbit.arcs.event_sequence
    two = EventSequence(
        np.tile(it.modes, (2, 1)), np.tile(it.guards, 2), np.tile(it.source, (2, 1)), np.tile(it.at_once, 2)
    )
    return evaluate(orbit.hybrid, Arcs.build(orbit.hybrid, two), orbit.y, np.tile(orbit.tau, 2))


def half_alike(orbit: Orbit, tolerance: float = _ALIKE) -> bool:
    """Whether the two halves of an orbit are the same turn, but for a small difference."""
    p, it = orbit.arcs.n_arcs, orbit.arcs.event_sequence
    if p % 2 or not np.array_equal(it.guards[: p // 2], it.guards[p // 2 :]):
        return False
    free, shift = orbit.arcs.free, orbit.arcs.shift * float(orbit.tau[: p // 2].sum())
    apart = np.abs(orbit.starts[p // 2] - shift - orbit.y)[free] / orbit.scale[free]
    return bool(np.max(apart) < tolerance)
