"""Orbits of a symmetric loop that are their own mirror image: begun as half an orbit and its image.

In a loop without constants whose elements are odd the mirror image of every motion is a motion too, and a shift of the
state makes a loop with a setpoint one (`simulation/states.py`). An orbit that is its own image passes through the image
of its start half a period later. Begun so, Newton's method keeps to symmetric motions and is not led to an asymmetric
neighbour, of which a pair may have branched off nearly on it.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from eppanalysis.arrays import Array
from eppanalysis.methods.orbits.guess import guess_along, returns
from eppanalysis.methods.orbits.orbit import Orbit
from eppanalysis.methods.orbits.shooting import close_orbit
from eppanalysis.methods.simulation.runs import run_hybrid
from eppanalysis.methods.steady.motion import SteadyMotion
from eppanalysis.models.systems.hybrid import DELAY_LINE, HybridSystem
from eppanalysis.models.systems.means import without_rounding

#: Distance between an orbit and its image, relative to its size, below which it is its own image.
_SAME = 1e-6
_MOST_HALVES, _MOST_EVENTS = 4, 400


def mirror(hybrid: HybridSystem) -> Array | None:
    """The map of y = (state, memory values) to its mirror image, shape (N, N).

    None where constants act on the loop, whose state is not counted from its centre then or has none, and for loops
    with clocks or dead time. That the elements are odd is not tested: an orbit that was closed by way of the image is
    tested against the engine.
    """
    model, n = hybrid.model, hybrid.n_plant
    if np.any(model.smooth_kind == DELAY_LINE) or not np.all(hybrid.compared[:n]) or has_constants(hybrid):
        return None
    # What is odd changes its sign, which the 1 in y and held inputs do not.
    image = np.eye(hybrid.x0.size + hybrid.H0.size)
    odd = np.concatenate([np.arange(n), hybrid.x0.size + np.arange(int(model.first[-1, 2]))])
    image[odd, odd] = -1.0
    return image


def has_constants(hybrid: HybridSystem) -> bool:
    """Whether at zero something moves, or an element has an input, while no element gives anything."""
    model, n = hybrid.model, hybrid.n_plant
    inputs = np.concatenate([hybrid.x0[n:], hybrid.H0])
    terms = np.vstack([
        np.hstack([model.A[:n, n:], model.K[:n]]),
        np.hstack([model.C[:, n:], model.Kz]),
    ]) * inputs  # fmt: skip
    memory = slice(inputs.size - model.K.shape[1], inputs.size - model.K.shape[1] + int(model.first[-1, 2]))
    terms[:, memory] = 0.0
    return bool(np.any(without_rounding(terms.sum(axis=1), np.abs(terms).sum(axis=1))))


def is_mirrored(orbit: Orbit, image: Array) -> bool:
    """Whether an orbit is its own mirror image."""
    p, n = orbit.arcs.n_arcs, orbit.hybrid.x0.size
    if p % 2 or abs(orbit.tau[: p // 2].sum() / orbit.period - 0.5) > _SAME:
        return False
    away = np.abs(orbit.starts[p // 2] - image @ orbit.y)[:n][orbit.hybrid.compared]
    return bool(np.all(away <= _SAME * orbit.scale[:n][orbit.hybrid.compared]))


def mirrored_orbits(hybrid: HybridSystem, image: Array, x: Array, memory: Array, period: float) -> Iterator[Orbit]:
    """Exact orbits that are their own image, from a state that should lie on one.

    Parameters
    ----------
    image : array, shape (N, N)
        See :func:`mirror`.
    x, memory : arrays
        State and memory values; the engine finds the modes.
    period : float
        Of the whole orbit, roughly [s].
    """
    known: list[Orbit] = []
    start = hybrid.at(x, memory, hybrid.modes0)
    run = run_hybrid(start, 1.2 * period, np.zeros(0), 2.0 * hybrid.time_scale, _MOST_EVENTS, _MOST_EVENTS)
    # The period that was handed in is rough.
    for pair in returns(hybrid, run, (0.3 * period, 0.8 * period), _MOST_HALVES, _MOST_EVENTS, image):
        begin, end = run.order[list(pair)]
        start = hybrid.at(run.state[begin], run.memory_values[begin], run.modes[begin])
        half = SteadyMotion.through([start], [float(run.time[end] - run.time[begin])], image)
        guess = None if half is None else guess_along(half)
        orbit = None if guess is None else close_orbit(hybrid, guess, known, image)
        if orbit is not None and is_mirrored(orbit, image):
            known.append(orbit)
            yield orbit
