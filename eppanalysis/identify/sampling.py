"""Which parameters a sum of squares leaves possible, where it is too rough for a straight line.

Sticking and slipping may make the motion, and with it the sum of squares, so rough on the scale of the intervals that
no quadratic surface describes it (see :mod:`eppanalysis.identify.surface`, which comes first and needs a tenth of the
runs). Then places are drawn, wide at first, weighted by how well they fit, and drawn again where the weight is
(population Monte Carlo; Cappé, Guillin, Marin and Robert, J Comput Graph Stat 13, 2004, with the mixture weights of
Owen and Zhou, J Am Stat Assoc 95, 2000).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

#: Draws of a round, rounds, degrees of freedom of the draws' distribution.
DRAWS, ROUNDS, FREEDOM = 120, 7, 6.0


@dataclass(frozen=True, eq=False)
class Cloud:
    """Weighted draws in a few numbers.

    Attributes
    ----------
    best : array, shape (p,)
        Place of the least cost seen.
    mean : array, shape (p,)
    matrix : array, shape (p, p)
        Covariance.
    effective : float
        How many independent draws the weights are worth.
    temper : float
        Power of the likelihood that the weights have: 1, or less where too few draws would be left, which makes
        intervals wider than they need be.
    """

    best: Array
    mean: Array
    matrix: Array
    effective: float
    temper: float


def draw_cloud(
    cost: Callable[[Array], float], start: Array, matrix: Array, low: Array, high: Array, seed: int
) -> Cloud:
    """Draw places by their cost, twice the negative logarithm of a likelihood.

    Parameters
    ----------
    cost : callable
        Of a place, shape (p,).
    start : array, shape (p,)
        A good place.
    matrix : array, shape (p, p)
        Covariance to begin with.
    low, high : array, shape (p,)
        Bounds.
    seed : int

    Examples
    --------
    >>> cloud = draw_cloud(lambda q: float(((q / [1.0, 0.1]) ** 2).sum()), np.zeros(2), np.eye(2) * 0.2,
    ...                    np.full(2, -9.0), np.full(2, 9.0), seed=1)
    >>> bool(abs(cloud.matrix[0, 0] - 1.0) < 0.3), bool(abs(cloud.matrix[1, 1] - 0.01) < 0.003)
    (True, True)
    """
    rng = np.random.default_rng(seed)
    p = start.size
    centre, spread = start, 4.0 * matrix
    best, least = start, cost(start)
    places, costs = np.empty((0, p)), np.empty(0)
    proposals: list[tuple[Array, Array]] = []
    cloud = Cloud(best, centre, matrix, 0.0, 0.0)
    for _ in range(ROUNDS):
        proposals.append((centre, spread))
        fresh = _draw(rng, centre, spread, low, high)
        found = np.array([cost(q) for q in fresh])
        places, costs = np.vstack([places, fresh]), np.append(costs, found)
        i = int(np.argmin(costs))
        if costs[i] < least:
            best, least = places[i], float(costs[i])
        weights, effective, temper = _weights(places, costs, least, proposals)
        centre = weights @ places
        away = places - centre
        spread = (away * weights[:, None]).T @ away
        # Draws that follow their own covariance lose a share p/N of it from round to round.
        spread = spread * (effective / max(effective - p, 0.5 * effective))
        cloud = Cloud(best, centre, spread, effective, temper)
        # What few draws say of a covariance is uncertain; a floor keeps it from collapsing.
        spread = 1.5 * spread + np.diag(1e-3 * np.diag(matrix) + 1e-14)
    return cloud


def _draw(rng: np.random.Generator, centre: Array, spread: Array, low: Array, high: Array) -> Array:
    """Draws of Student's t about a centre; those beyond a bound are drawn again, in the end put onto it."""
    root = _root(spread)
    out = np.empty((DRAWS, centre.size))
    for i in range(DRAWS):
        for _ in range(50):
            scale = np.sqrt(FREEDOM / rng.chisquare(FREEDOM))
            q = centre + scale * (root @ rng.normal(size=centre.size))
            if np.all((q >= low) & (q <= high)):
                break
        out[i] = np.clip(q, low, high)
    return out


def _root(spread: Array) -> Array:
    values, vectors = np.linalg.eigh(spread)
    return vectors * np.sqrt(np.maximum(values, 1e-18))


def _weights(
    places: Array, costs: Array, least: float, proposals: list[tuple[Array, Array]]
) -> tuple[Array, float, float]:
    """Weights of all draws against the mixture that they come from, what they are worth, and their temper."""
    p = places.shape[1]
    # Against the mixture of all rounds: a draw that its own round hardly expected gets no boundless weight.
    density = np.zeros(len(places))
    for centre, spread in proposals:
        root = _root(spread)
        size = np.linalg.norm(root, axis=0)
        z = (places - centre) @ (root / size**2)
        density += np.exp(-0.5 * (FREEDOM + p) * np.log1p(np.sum(z**2, axis=1) / FREEDOM) - np.sum(np.log(size)))
    base = -np.log(np.maximum(density, 1e-300))
    wanted = min(3.0 * p, 0.3 * len(places))
    temper = 1.0
    # Where few draws carry all the weight, costs count less until enough of them
    # do: the intervals are then wider than the data ask for, which the fit says.
    while True:
        logs = base - 0.5 * temper * (costs - least)
        weights = np.exp(logs - logs.max())
        weights /= weights.sum()
        effective = 1.0 / float(np.sum(weights**2))
        if effective >= wanted or temper < 1e-3:
            return weights, effective, temper
        temper *= 0.8
