"""Ranges of signals over an orbit against the exponential of each arc, looked at closely where they turn."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.optimize import minimize_scalar

from eppanalysis.arrays import Array
from eppanalysis.engine.orbits import extents
from tests.shared import mostly_slow


@pytest.mark.parametrize("fastest", [0.5, 8.0, 30.0, 1000.0])  # in eight steps of an arc the last two are over
@pytest.mark.parametrize("seed", mostly_slow(range(4), [0]))
def test_ranges_of_signals_are_those_of_the_exponential(seed: int, fastest: float) -> None:
    rng = np.random.default_rng(seed)
    n, N, n_y, p = 4, 5, 6, 2
    F, tau = np.zeros((p, n, N)), rng.uniform(1.0, 2.0, p)
    for a in range(p):
        F[a, :2, :2] = [[-0.3, 4.0 + a], [-4.0 - a, -0.3]]
        F[a, 2, 2], F[a, 3, 3] = -1.0, -fastest
        F[a] += 0.3 * rng.normal(size=(n, N))
    starts, Y = rng.normal(size=(p + 1, N)), rng.normal(size=(p, n_y, N))
    none, no = np.zeros((p, n, 0)), np.zeros(p, np.int64)
    low, high = np.empty(n_y), np.empty(n_y)
    extents(None, F, none, no, Y, np.zeros((p, n_y, 0)), starts, tau, low, high)

    for s in range(n_y):
        for side, found in ((1.0, high[s]), (-1.0, low[s])):
            most = max(_largest(F[a], side * Y[a, s], starts[a], tau[a]) for a in range(p))
            assert side * found == pytest.approx(most, rel=1e-9, abs=1e-9)


def _largest(F: Array, y: Array, start: Array, tau: float) -> float:
    """Largest value of a signal over an arc."""
    n, N = F.shape
    M, times = np.vstack([F, np.zeros((N - n, N))]), np.linspace(0.0, tau, 200)

    def less(t: float) -> float:
        return -float(y @ expm(t * M) @ start)

    values = [-less(t) for t in times]
    k = int(np.argmax(values))
    close = {"xatol": 1e-9 * tau}
    beside = times[max(k - 1, 0)], times[min(k + 1, times.size - 1)]
    return max(*values, -float(minimize_scalar(less, bounds=beside, method="bounded", options=close).fun))
