"""Which parameters a sum of squares leaves possible, where it is too rough for a straight line.

Sticking and slipping, or an encoder whose edges fall into one sample or the next, make the motion, and with it the sum
of squares, a stair on the scale of the intervals: no quadratic surface describes it (see
:mod:`eppanalysis.identify.surface`, which comes first and needs a tenth of the runs), and draws from one miss most of
what is possible. Then a population of chains walks over the sum of squares itself (ter Braak, Stat Comput 16, 2006);
one that cools seeks its least place where descent finds none.
"""

from __future__ import annotations

import copy
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from eppanalysis.arrays import Array
from eppanalysis.identify.response import Response
from eppanalysis.progress import Progress

#: Chains of a population, its turns that are forgotten, and those that count.
CHAINS, BEFORE, TURNS = 30, 30, 60
#: Cost beyond a bound.
FORBIDDEN = 1e300
#: Distance of the first places from the centre, in standard deviations, and of how many each chain begins at one: wide,
#: for a population shrinks fast, and grows slowly.
_SPREAD, _OF = 4.0, 3
#: Most places at which a walk evaluates the cost.
WALKED = 1 + CHAINS * (_OF + BEFORE + TURNS)
#: Every other stride is shorter: few full ones stay on a step of the stair.
_SHORT = 0.3
#: How far, in standard deviations, and by which factor in spread the two halves of the turns may differ.
_APART, _WIDER = 1.0, 2.0
#: Where it cools: places, turns at each growth, share of the record to begin with, by how much it grows, fewest rows.
_PLACES, _TURNS, _FIRST, _GROWTH, _ROWS = 30, 12, 0.03, 1.5, 30


@dataclass(frozen=True, eq=False)
class Cloud:
    """Draws in a few numbers."""

    best: Array  # (p,): place of the least cost seen
    mean: Array  # (p,)
    matrix: Array  # (p, p): covariance
    effective: float  # how many independent draws they are worth
    settled: bool = True  # whether more of them would say the same


def walk(cost: Callable[[Array], float], start: Array, matrix: Array, bounds: tuple[Array, Array], seed: int) -> Cloud:
    """Draw places by their cost, twice the negative logarithm of a likelihood.

    Parameters
    ----------
    cost : callable
        Of a place, shape (p,).
    start : array, shape (p,)
        A good place.
    matrix : array, shape (p, p)
        Covariance to begin with.
    bounds : (array, array), shapes (p,)

    Examples
    --------
    >>> cloud = walk(
    ...     lambda q: float(((q / [1.0, 0.1]) ** 2).sum()),
    ...     np.zeros(2),
    ...     np.eye(2) * 0.2,
    ...     (np.full(2, -9.0), np.full(2, 9.0)),
    ...     seed=1,
    ... )
    >>> (
    ...     bool(abs(cloud.matrix[0, 0] - 1.0) < 0.3),
    ...     bool(abs(cloud.matrix[1, 1] - 0.01) < 0.003),
    ... )
    (True, True)
    """
    rng = np.random.default_rng(seed)
    root = root_of(matrix)

    def costs(u: Array) -> Array:
        return _costs_within(bounds, cost, start + u @ root.T)

    u = _SPREAD * rng.normal(size=(_OF * CHAINS, start.size))
    found = costs(u)
    first = np.argsort(found)[:CHAINS]
    u, found = u[first], found[first]
    kept = np.empty((TURNS, *u.shape))
    best, least = start, cost(start)
    for turn in range(BEFORE + TURNS):
        step_chains(costs, u, found, rng, turn, 1.0 if turn % 2 else _SHORT)
        if found.min() < least:
            best, least = start + root @ u[np.argmin(found)], found.min()
        if turn >= BEFORE:
            kept[turn - BEFORE] = u
    mean, spread = kept.mean(axis=(0, 1)), np.cov(kept.reshape(-1, start.size).T).reshape(start.size, start.size)
    # Chains are independent but for their steps: the mean of their means is as uncertain as these scatter.
    scatter = kept.mean(axis=0).var(axis=0, ddof=1)
    effective = CHAINS * float(np.min(np.diag(spread) / np.maximum(scatter, 1e-300)))
    return Cloud(best, start + root @ mean, root @ spread @ root.T, effective, _settled(kept))


def _costs_within(bounds: tuple[Array, Array], cost: Callable[[Array], float], places: Array) -> Array:
    """Costs of places; beyond the bounds they are forbidden."""
    inside = np.all((places >= bounds[0]) & (places <= bounds[1]), axis=1)
    return np.array([cost(q) if is_in else FORBIDDEN for q, is_in in zip(places, inside, strict=True)])


def _settled(kept: Array) -> bool:
    """Whether the two halves of the turns say the same."""
    one, other = (half.reshape(-1, kept.shape[-1]) for half in np.array_split(kept, 2))
    a, b = one.std(axis=0), other.std(axis=0)
    near = np.abs(one.mean(axis=0) - other.mean(axis=0)) < _APART * np.minimum(a, b)
    return bool(np.all(near & (np.maximum(a, b) < _WIDER * np.minimum(a, b))))


def root_of(matrix: Array) -> Array:
    """Axes of a covariance, as long as its standard deviations."""
    values, vectors = np.linalg.eigh(matrix)
    return np.asarray(vectors * np.sqrt(np.maximum(values, 1e-16 * values.max())))


def step_chains(
    costs: Callable[[Array], Array], u: Array, found: Array, rng: np.random.Generator, turn: int, share: float = 1.0
) -> None:
    """One step of every chain, in place: a Markov chain by differential evolution.

    Parameters
    ----------
    costs : callable
        Of places `u`, shape (m, p).
    u, found : array, shapes (n, p), (n,)
        Where the chains are, and the costs there.
    share : float
        Of the stride that is best on a smooth surface.
    """
    half, p = len(u) // 2, u.shape[1]
    # Each half steps along differences of the other; a stride of one now and then leads from one ridge to another.
    for move, other in ((slice(0, half), half), (slice(half, None), 0)):
        pair = other + rng.integers(0, half, (2, half))
        stride = 1.0 if turn % 10 == 0 else share * 2.38 / np.sqrt(2.0 * p)
        tried = u[move] + stride * (u[pair[0]] - u[pair[1]]) + 1e-3 * rng.normal(size=(half, p))
        there = costs(tried)
        taken = np.log(rng.random(half)) < -0.5 * (there - found[move])
        u[move] = np.where(taken[:, None], tried, u[move])
        found[move] = np.where(taken, there, found[move])


def anneal(response: Response, starts: Array, bounds: tuple[Array, Array], seed: int, progress: Progress) -> Array:
    """Best place that a population finds where a sum of squares is a field of needles.

    A sampled controller that hunts across a step of its encoder puts out another pattern where a parameter differs by a
    thousandth, and the same one until then: derivatives show nothing, and descent ends in the next needle. The begin of
    a record has few and wide ones. So a population of chains goes over a record that grows (Chopin, Biometrika 89,
    2002), at a temperature at which the residual of the best place would be noise; at each growth copies of the best
    third take the place of the worst.

    Parameters
    ----------
    starts : array, shape (m, p)
        At least as many as the population has places.
    bounds : (array, array), shapes (p,)
    progress : Progress
        Called at every growth of the record.
    """
    rng, response, whole = np.random.default_rng(seed), copy.copy(response), response
    time, plain, u = response.time, response.channels, starts
    until = max(_FIRST * time[-1], time[min(_ROWS, len(time) - 1)])
    windows = [*until * _GROWTH ** np.arange(np.ceil(np.log(time[-1] / until) / np.log(_GROWTH))), time[-1]]
    for k, window in enumerate(windows):
        progress(k, len(windows), "identify: search by a population")

        def cost(q: Array, window: float = window) -> float:
            return float(np.sum(response.residual(q, window) ** 2))

        costs = partial(_costs_within, bounds, cost)

        for _ in range(2):
            found = costs(u)
            response.channels = plain
            response.read_noise(u[np.argmin(found)], window)
            u = _go_on(costs, u, rng, int(np.searchsorted(time, window)) * len(plain))
    whole.runs = response.runs
    return np.asarray(u[np.argmin(costs(u))])


def _go_on(costs: Callable[[Array], Array], u: Array, rng: np.random.Generator, rows: int) -> Array:
    """The population after some turns, in units of its own spread."""
    found = costs(u)
    best = np.argsort(found)[: _PLACES - _PLACES // 3]
    chosen = rng.permutation(np.concatenate([best, best[: _PLACES // 3]]))
    u, found = u[chosen], found[chosen]
    temperature = max(1.0, float(found.min()) / rows)
    centre, size = u.mean(axis=0), u.std(axis=0) + 1e-9
    at, cold = (u - centre) / size, found / temperature
    for turn in range(_TURNS // 2):
        step_chains(lambda x: costs(centre + x * size) / temperature, at, cold, rng, turn, 1.0 if turn % 2 else _SHORT)
    return np.asarray(centre + at * size)
