"""Which parameters a sum of squares leaves possible, where what it leaves is a bent ridge rather than an ellipsoid.

Lag and dead time act so alike that the sum of squares is a ridge a hundred times longer than wide, and bent: a matrix
of derivatives at one place is wrong about it a standard deviation further on, and draws from an ellipsoid miss it. So
every residual is taken as a quadratic function of the parameters (its square, the cost, is then of fourth order and may
bend), a population of chains draws from that surface at no cost (ter Braak, Stat Comput 16, 2006), and the true cost
of some draws weights them. Where weights are uneven, the surface is fitted again, to these draws too.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from numpy.typing import NDArray

from eppanalysis.arrays import Array
from eppanalysis.identify.sampling import FORBIDDEN, Cloud, root_of, step_chains

#: Draws of a round that are simulated, most rounds, share of a round's draws that its weights must be worth to end.
DRAWS, ROUNDS, ENOUGH = 100, 5, 0.5
#: Distance of the first places from the centre, in standard deviations; chains, and their steps.
_FIRST = 1.5
_CHAINS, _TURNS = 200, 1500


def explore(
    residual: Callable[[Array], Array], start: Array, matrix: Array, low: Array, high: Array, seed: int
) -> Cloud:
    """Draws of the parameters, weighted by how well they fit.

    Parameters
    ----------
    residual : callable
        Of a place, shape (p,): residuals in units of their noise, shape (n,); its square is twice the negative
        logarithm of a likelihood.
    start : array, shape (p,)
        A good place.
    matrix : array, shape (p, p)
        Covariance to begin with.
    low, high : array, shape (p,)
        Bounds.

    Returns
    -------
    Cloud
        Its `effective` is small where a quadratic surface does not describe the residuals.

    Examples
    --------
    A ridge bent like a banana, 0.05 wide and 1 long:

    >>> cloud = explore(
    ...     lambda q: np.array([q[0], (q[1] - q[0] ** 2) / 0.05]),
    ...     np.zeros(2),
    ...     np.diag([1.0, 0.0025]),
    ...     np.full(2, -9.0),
    ...     np.full(2, 9.0),
    ...     seed=1,
    ... )
    >>> bool(abs(cloud.matrix[0, 0] - 1.0) < 0.4), bool(cloud.effective > 50)
    (True, True)
    """
    rng = np.random.default_rng(seed)
    centre, root = start, root_of(matrix)
    places = np.clip(start + _design(start.size) @ root.T, low, high)
    values = np.array([residual(q) for q in places])
    found = Cloud(start, start, matrix, 0.0)
    for _ in range(ROUNDS):
        surface = _Surface.of(places, values, centre, root)
        draws = surface.draw(rng, low, high)
        fresh = np.array([residual(q) for q in draws])
        places, values = np.vstack([places, draws]), np.vstack([values, fresh])
        costs = np.sum(values**2, axis=1)
        best = places[int(np.argmin(costs))]
        # Draws are from the surface: their weights take back what it has wrong.
        logs = -0.5 * (np.sum(fresh**2, axis=1) - surface.cost(draws))
        weights = np.exp(logs - logs.max())
        weights /= weights.sum()
        effective = 1.0 / float(np.sum(weights**2))
        mean = weights @ draws
        # A weighted spread about its own mean is too small by what its few draws are worth.
        spread = (draws - mean).T @ ((draws - mean) * weights[:, None]) * effective / max(effective - 1.0, 0.5)
        if effective > found.effective:
            found = Cloud(best, mean, spread, effective)
        if effective > ENOUGH * DRAWS:
            break
        centre, root = _next(places, costs, draws, best)
    return replace(found, best=best)


def _design(p: int) -> Array:
    """Centre, both ways along every axis, and one place for every pair of axes."""
    rows = [np.zeros(p)]
    for i in range(p):
        for sign in (-_FIRST, _FIRST):
            rows.append(sign * np.eye(p)[i])
        rows += [_FIRST / np.sqrt(2.0) * (np.eye(p)[i] + np.eye(p)[j]) for j in range(i)]
    return np.array(rows)


def _next(places: Array, costs: Array, draws: Array, best: Array) -> tuple[Array, Array]:
    """Where the next surface is centred, and its axes: as the draws lie, as far as the cost is not hopeless there."""
    near = np.argsort(costs)[: max(len(draws) // 2, 3 * best.size)]
    spread = np.cov(places[near].T) + 1e-3 * np.cov(draws.T)
    return best, root_of(np.atleast_2d(spread))


@dataclass(frozen=True, eq=False)
class _Surface:
    """Residuals as quadratic functions of the distance from a centre, in few numbers."""

    #: centre, root: (p,), (p, p): a place is ``centre + root @ u``.
    centre: Array
    root: Array
    triangle: Array  # (k, k): cost is the square of ``triangle @ features(u)``

    @classmethod
    def of(cls, places: Array, values: Array, centre: Array, root: Array) -> _Surface:
        """Fit to residuals `values`, shape (m, n), at `places`, shape (m, p); good places count most."""
        u = _scaled(places, centre, root)
        costs = np.sum(values**2, axis=1)
        weight = 1.0 / (1.0 + (costs - costs.min()) / (4.0 * centre.size))
        features = _features(u) * weight[:, None]
        coefficients = np.linalg.lstsq(features, values * weight[:, None], rcond=1e-10)[0]
        # The sum of squares is the squared length of this triangle
        # times the features; the residuals are needed no more.
        return cls(centre, root, np.asarray(np.linalg.qr(coefficients.T, mode="r")))

    def cost(self, places: Array) -> Array:
        """Sum of squares at places, shape (m,)."""
        return self._at(_scaled(places, self.centre, self.root))

    def _at(self, u: Array) -> Array:
        return np.asarray(np.sum((_features(u) @ self.triangle.T) ** 2, axis=1))

    def draw(self, rng: np.random.Generator, low: Array, high: Array) -> Array:
        """Draws from the surface, shape (DRAWS, p), by chains that step along the differences of others."""

        def costs(u: Array) -> Array:
            places = self.centre + u @ self.root.T
            return np.where(np.all((places >= low) & (places <= high), axis=1), self._at(u), FORBIDDEN)

        u = 0.3 * rng.normal(size=(_CHAINS, self.centre.size))
        cost = self._at(u)
        for turn in range(_TURNS):
            step_chains(costs, u, cost, rng, turn)
        chosen = u[rng.permutation(_CHAINS)[:DRAWS]]
        return np.asarray(np.clip(self.centre + chosen @ self.root.T, low, high))


def _scaled(places: Array, centre: Array, root: Array) -> Array:
    """Distance of places from a centre in units of the axes, shape (m, p)."""
    return np.asarray(np.linalg.solve(root, (places - centre).T).T, float)


def _features(u: Array) -> Array:
    """One, the coordinates, and their products, shape (m, 1 + p + p (p + 1)/2)."""
    m, p = u.shape
    i, j = _pairs(p)
    features = np.empty((m, 1 + p + i.size))
    features[:, 0], features[:, 1 : 1 + p] = 1.0, u
    np.multiply(u[:, i], u[:, j], out=features[:, 1 + p :])
    return features


@cache
def _pairs(p: int) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """All pairs of `p` coordinates; chains use them tens of thousands of times."""
    return np.triu_indices(p)
