"""Orbits of a symmetric loop that are their own mirror image: closed as half an orbit.

In a loop without constants whose elements are odd, and in one that a shift of the state makes so, the mirror image of
every motion at the centre is a motion too. An orbit that is its own image passes through the image of its start half a
period later. Closed as a half it cannot be mistaken for an asymmetric neighbour: where such a pair has branched off,
nearly on it, the whole period's return map has a multiplier near 1, but the half's is near -1, far from singular.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from eppanalysis.arrays import Array
from eppanalysis.methods.orbits.guess import make_half, one_turn
from eppanalysis.methods.orbits.orbit import CONVERGED, Orbit, middle, solve
from eppanalysis.methods.orbits.shooting import close_orbit, moves, restarted
from eppanalysis.methods.simulation.kept import Run
from eppanalysis.methods.simulation.simulate import run_hybrid
from eppanalysis.models.systems.hybrid import DELAY_LINE, HybridSystem

#: What is left of constants at the centre, relative to what they are added up from.
_BALANCED = 1e-9
#: Distance between an orbit and its image, relative to its size, below which it is its own image.
_SAME = 1e-6
_MOST_HALVES, _MOST_EVENTS = 4, 400


def mirror(hybrid: HybridSystem) -> Array | None:
    """The map of y = (state, memory values) to its mirror image at the loop's centre, shape (N, N).

    The centre is where nothing moves while every element's input and output are zero. None where there is no such
    place, and for loops with clocks or dead time. Whether the elements are odd is not asked: an orbit that was closed
    by way of the image is tested against the engine.
    """
    model, n = hybrid.model, hybrid.n_plant
    if np.any(model.smooth_kind == DELAY_LINE) or not np.all(hybrid.compared[:n]):
        return None
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
    if np.any(np.abs(rows @ centre - right) > _BALANCED * size):
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
    run = _run(hybrid.at(x, memory, hybrid.modes0), 1.2 * period)
    for first, last in _half_returns(hybrid, image, run, period):
        orbit = _closed(hybrid, image, run, first, last, known)
        if orbit is not None:
            known.append(orbit)
            yield orbit


def _run(start: HybridSystem, t_end: float) -> Run:
    return run_hybrid(start, t_end, np.zeros(0), 2.0 * start.time_scale, _MOST_EVENTS, _MOST_EVENTS)


def _half_returns(hybrid: HybridSystem, image: Array, run: Run, period: float) -> list[tuple[int, int]]:
    """Pairs of events about half a period apart, of which the second is nearest to the image of the first."""
    order, compared = run.order, hybrid.compared
    n, time = hybrid.x0.size, run.time[run.order]
    if order.size < 2:
        return []
    # Of several events at one instant the last one counts.
    free = np.flatnonzero(np.diff(time, append=np.inf) > 0)
    state = np.hstack([run.state[order[free]], run.memory_values[order[free]]])
    imaged = (state @ image.T)[:, :n][:, compared]
    state, gap = state[:, :n][:, compared], time[free] - time[free][:, None]
    # Events at which a run may be half a turn on: the period that was handed in is rough.
    i, j = np.nonzero((gap > 0.3 * period) & (gap < 0.8 * period))
    span = np.ptp(state, axis=0)
    away = np.max(np.abs(state[j] - imaged[i]) / np.where(span > 0, span, np.inf), axis=1, initial=0.0)
    return [(int(free[i[k]]), int(free[j[k]])) for k in np.argsort(away, kind="stable")[:_MOST_HALVES]]


def _closed(
    hybrid: HybridSystem, image: Array, run: Run, first: int, last: int, known: Sequence[Orbit]
) -> Orbit | None:
    """The whole orbit from half a turn of a run; the engine's own turn says which events it has."""
    for _ in range(_MOST_HALVES):
        made = make_half(hybrid, image, run, first, last)
        if made is None:
            return None
        half = solve(hybrid, *made)
        if not (half.residual < CONVERGED and np.all(half.tau > -1e-9 * half.period) and moves(half)):
            return None
        # From the middle of the longest arc no guard is near, so rounding makes no event of its own.
        k, period = int(np.argmax(half.tau)), 2.0 * half.period
        start = restarted(hybrid, half.arcs, middle(half, k), half.arcs.event_sequence.modes[k])
        run = _run(start, 1.1 * period)
        turn = one_turn(hybrid, run, start.modes0, period)
        orbit = None if turn is None else close_orbit(hybrid, turn, known)
        if orbit is not None and is_mirrored(orbit, image):
            return orbit
        # The half has other events than the engine meets on it.
        again = _half_returns(hybrid, image, run, period)
        if not again:
            return None
        first, last = again[0]
    return None
