"""Orbits of a symmetric loop that are their own mirror image: begun as half an orbit and its image.

In a loop without constants whose elements are odd, and in one that a shift of the state makes so, the mirror image of
every motion at the centre is a motion too. An orbit that is its own image passes through the image of its start half a
period later. Begun so, Newton's method keeps to symmetric motions and is not led to an asymmetric neighbour, of which a
pair may have branched off nearly on it.
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

#: What is left of constants at the centre, relative to what they are added up from.
_BALANCED = 1e-9
#: Distance between an orbit and its image, relative to its size, below which it is its own image.
_SAME = 1e-6
_MOST_HALVES, _MOST_EVENTS = 4, 400


def centre_of_loop(hybrid: HybridSystem) -> Array | None:
    """The state of the loop, shape (n,), where nothing moves while every element's input and output are zero.

    Without a setpoint or a load it is zero. None where there is no such state.
    """
    model, n = hybrid.model, hybrid.n_plant
    inputs = np.concatenate([hybrid.x0[n:], hybrid.H0])
    constant = np.vstack([
        np.hstack([model.A[:n, n:], model.K[:n]]),
        np.hstack([model.C[:, n:], model.Kz]),
    ]) * inputs  # fmt: skip
    memory = slice(inputs.size - model.K.shape[1], inputs.size - model.K.shape[1] + int(model.first[-1, 2]))
    constant[:, memory] = 0.0
    # Rates and inputs of the elements vanish together at the centre: more equations than unknowns, so whether there is
    # one shows in what least squares leave.
    rows = np.vstack([model.A[:n, :n], model.C[:, :n]])
    right = -constant.sum(axis=1)
    centre = np.linalg.lstsq(rows, right, rcond=None)[0] if np.any(right) else np.zeros(n)
    size = np.abs(rows) @ np.abs(centre) + np.abs(constant).sum(axis=1)
    return None if np.any(np.abs(rows @ centre - right) > _BALANCED * size) else centre


def mirror(hybrid: HybridSystem) -> Array | None:
    """The map of y = (state, memory values) to its mirror image at the loop's centre, shape (N, N).

    None where the loop has no centre, and for loops with clocks or dead time. Whether the elements are odd is not
    run: an orbit that was closed by way of the image is tested against the engine.
    """
    model, n = hybrid.model, hybrid.n_plant
    if np.any(model.smooth_kind == DELAY_LINE) or not np.all(hybrid.compared[:n]):
        return None
    centre = centre_of_loop(hybrid)
    if centre is None:
        return None
    # A reflection at the centre: what is odd changes its sign, and the 1 in y carries twice the centre.
    image = np.eye(hybrid.x0.size + hybrid.H0.size)
    odd = np.concatenate([np.arange(n), hybrid.x0.size + np.arange(int(model.first[-1, 2]))])
    image[odd, odd] = -1.0
    image[:n, -1] = 2.0 * centre
    return image


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
