"""Arcs of orbits: their flow against scipy's matrix exponential, clocks beside the states of a plant."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import expm

from eppanalysis.kernels.orbits.flow import Channels, room
from eppanalysis.kernels.orbits.sweep import along


@pytest.mark.parametrize(("plant", "clocks", "memory"), [(2, 0, 1), (2, 40, 3), (9, 0, 2), (9, 60, 4), (1, 7, 1)])
@pytest.mark.parametrize("tau", [0.0, 0.3, -0.2, 4.0])
def test_flow_of_an_arc_with_clocks(plant: int, clocks: int, memory: int, tau: float) -> None:
    rng = np.random.default_rng(plant + 100 * clocks)
    n, N = plant + clocks, plant + clocks + memory
    F = np.zeros((1, n, N))
    F[0, :plant, :plant] = rng.normal(size=(plant, plant))
    F[0, :plant, n:] = rng.normal(size=(plant, memory))
    F[0, plant:, -1] = rng.choice([0.0, 1.0], clocks)
    y, end, Phi, row, none = rng.normal(size=N), np.zeros(N), np.zeros((N, N)), np.zeros(N), np.zeros(0)
    # Exponentials cost the cube of it, once for each arc.
    assert room(F).shape[1] < plant + 8
    of_none = np.zeros((0, n)), np.zeros((0, memory)), np.zeros((0, 0)), none, np.zeros((1, 0))
    channels, guard = Channels(np.zeros(0, np.int64), *of_none), rng.normal(size=N)
    along(channels, none, F[0], np.zeros((n, 0)), guard, none, 0, y, tau, end, Phi, none, row)
    assert np.array_equal(row, guard)
    exact = expm(tau * np.vstack([F[0], np.zeros((memory, N))]))
    np.testing.assert_allclose(Phi, exact, rtol=1e-12, atol=1e-13 * np.abs(exact).max())
    np.testing.assert_allclose(end, exact @ y, rtol=1e-12, atol=1e-12 * np.abs(exact).max())
