"""Arcs of orbits: their flow against scipy's matrix exponential, clocks beside the states of a plant."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import expm

from eppanalysis.engine._engine import parts
from eppanalysis.engine.orbits import Channels, states_at, sweep_by


@pytest.mark.parametrize(("plant", "clocks", "memory"), [(2, 0, 1), (2, 40, 3), (9, 0, 2), (9, 60, 4), (1, 7, 1)])
@pytest.mark.parametrize("tau", [0.0, 0.3, 4.0])
def test_flow_of_an_arc_with_clocks(plant: int, clocks: int, memory: int, tau: float) -> None:
    rng = np.random.default_rng(plant + 100 * clocks)
    n, N = plant + clocks, plant + clocks + memory
    F = np.zeros((1, n, N))
    F[0, :plant, :plant] = rng.normal(size=(plant, plant))
    F[0, :plant, n:] = rng.normal(size=(plant, memory))
    F[0, plant:, -1] = rng.choice([0.0, 1.0], clocks)
    y, end, none = rng.normal(size=N), np.empty((1, N)), np.zeros((1, n, 0))
    # Exponentials cost the cube of it, once for each arc.
    assert parts.moving_states(F) < plant + 8
    exact = expm(tau * np.vstack([F[0], np.zeros((memory, N))]))
    states_at(None, F, none, np.zeros(1, np.int64), y[None], np.array([0.0, abs(tau)]), np.array([tau]), end)
    assert np.all(np.abs(end[0] - exact @ y) <= 1e-12 * np.abs(exact) @ np.abs(y))


@pytest.mark.parametrize("moves", ["rates", "constants"])
@pytest.mark.parametrize(("plant", "clocks", "memory"), [(2, 0, 1), (5, 3, 2), (9, 1, 3)])
def test_change_of_an_arc_with_a_parameter(plant: int, clocks: int, memory: int, moves: str) -> None:
    """A parameter that moves constants alone, as a gap does, takes an exponential of half the size."""
    rng = np.random.default_rng(plant)
    n, N, tau = plant + clocks, plant + clocks + memory, 0.7
    F, by = np.zeros((2, 1, n, N))
    for rates in (F, by):
        rates[0, :plant, :plant] = rng.normal(size=(plant, plant))
        rates[0, :, n:] = rng.normal(size=(n, memory))
    if moves == "constants":
        by[0, :, :n] = 0.0
    starts, change, none = rng.normal(size=(2, N)), rng.normal(size=N), np.zeros(0)
    of_none = np.zeros((0, n)), np.zeros((0, memory)), np.zeros((0, 0)), none, np.zeros((1, 0))
    channels = Channels(np.zeros(0, np.int64), *of_none)
    S, g, gs, J, no = np.zeros((1, n, 0)), np.zeros((1, N)), np.zeros((1, 0)), np.eye(N)[None], np.zeros(1, np.int64)
    numbers, end = (S, g, gs, J), change.copy()
    sweep_by(
        channels, F, *numbers, no, no, starts, np.array([tau]), no[:0], channels, by, S, g, gs, 0.0 * J, np.zeros(N),
        end, np.zeros(1),
    )  # fmt: skip
    still = np.zeros((memory, N))
    M, by_parameter = np.vstack([F[0], still]), np.vstack([by[0], still])
    exact = expm(tau * np.block([[M, np.zeros((N, N))], [by_parameter, M]])) @ np.append(starts[0], change)
    np.testing.assert_allclose(end, exact[N:], rtol=1e-12, atol=1e-12 * np.abs(exact).max())
