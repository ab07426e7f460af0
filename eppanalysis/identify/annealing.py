"""The least place of a sum of squares that is a field of needles.

A sampled controller that hunts across a step of its encoder puts out another pattern where a parameter differs by a
thousandth, and the same one until then: derivatives show nothing, and descent ends in the next needle. The begin of a
record has few and wide ones. So a population of chains goes over a record that grows (Chopin, Biometrika 89, 2002), at
a temperature at which the residual of the best place would be noise; at each growth copies of the best third take the
place of the worst.
"""

from __future__ import annotations

import copy
from collections.abc import Callable

import numpy as np

from eppanalysis.arrays import Array
from eppanalysis.identify.response import Response
from eppanalysis.identify.sampling import FORBIDDEN, SHORT, step_chains
from eppanalysis.progress import Progress

#: Places of the population, turns at each growth, share of the record to begin with, and factor by which it grows.
PLACES, TURNS, _FIRST, _GROWTH = 30, 12, 0.03, 1.5
#: Fewest rows to begin with.
_ROWS = 30


def anneal(response: Response, starts: Array, bounds: tuple[Array, Array], seed: int, progress: Progress) -> Array:
    """Best place that a population finds.

    Parameters
    ----------
    starts : array, shape (m, p)
        At least as many as the population has places.
    bounds : (array, array), shapes (p,)
    progress : Progress
        Told of every growth of the record.
    """
    rng, response, whole = np.random.default_rng(seed), copy.copy(response), response
    time, plain, u = response.time, response.channels, starts
    until = max(_FIRST * time[-1], time[min(_ROWS, len(time) - 1)])
    windows = [*until * _GROWTH ** np.arange(np.ceil(np.log(time[-1] / until) / np.log(_GROWTH))), time[-1]]
    for k, window in enumerate(windows):
        progress(k, len(windows), "identify: search by a population")

        def costs(places: Array, window: float = window) -> Array:
            inside = np.all((places >= bounds[0]) & (places <= bounds[1]), axis=1)
            pairs = zip(places, inside, strict=True)
            return np.array([float(np.sum(response.residual(q, window) ** 2)) if ok else FORBIDDEN for q, ok in pairs])

        for _ in range(2):
            found = costs(u)
            response.channels = plain
            response.read_noise(u[np.argmin(found)], window)
            u = _turns(costs, u, rng, int(np.searchsorted(time, window)) * len(plain))
    whole.runs = response.runs
    return np.asarray(u[np.argmin(costs(u))])


def _turns(costs: Callable[[Array], Array], u: Array, rng: np.random.Generator, rows: int) -> Array:
    """The population after some turns, in units of its own spread."""
    found = costs(u)
    best = np.argsort(found)[: PLACES - PLACES // 3]
    chosen = rng.permutation(np.concatenate([best, best[: PLACES // 3]]))
    u, found = u[chosen], found[chosen]
    temperature = max(1.0, float(found.min()) / rows)
    centre, size = u.mean(axis=0), u.std(axis=0) + 1e-9
    at, cold = (u - centre) / size, found / temperature
    for turn in range(TURNS // 2):
        step_chains(lambda x: costs(centre + x * size) / temperature, at, cold, rng, turn, 1.0 if turn % 2 else SHORT)
    return np.asarray(centre + at * size)
