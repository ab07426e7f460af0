"""Arcs of orbits: their flow against scipy's matrix exponential, clocks beside the states of a plant."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import expm

from eppanalysis.engine._engine import parts
from eppanalysis.engine.orbits import Channels, carry, sweep_by


def carried(channels, F, guard, J, at_once, y, tau, start):
    """What becomes of disturbances of the start of an arc; smooth elements, if there are any, have one channel."""
    count, D, linear = 0 if channels is None else 1, start.copy(), np.zeros(1, np.int64)
    S, gs = np.zeros((*F.shape[:2], count)), np.zeros((1, count))
    carry(channels, F, S, guard[None], gs, J[None], linear, np.full(1, at_once), y[None], np.array([tau]), D)
    return D


@pytest.mark.parametrize(("plant", "clocks", "memory"), [(2, 0, 1), (2, 40, 3), (9, 0, 2), (9, 60, 4), (1, 7, 1)])
@pytest.mark.parametrize("tau", [0.0, 0.3, -0.2, 4.0])
def test_flow_of_an_arc_with_clocks(plant: int, clocks: int, memory: int, tau: float) -> None:
    rng = np.random.default_rng(plant + 100 * clocks)
    n, N = plant + clocks, plant + clocks + memory
    F = np.zeros((1, n, N))
    F[0, :plant, :plant] = rng.normal(size=(plant, plant))
    F[0, :plant, n:] = rng.normal(size=(plant, memory))
    F[0, plant:, -1] = rng.choice([0.0, 1.0], clocks)
    y, guard, J, start = rng.normal(size=N), rng.normal(size=N), rng.normal(size=(N, N)), rng.normal(size=(N, 3))
    # Exponentials cost the cube of it, once for each arc.
    assert parts.moving_states(F) < plant + 8
    exact = expm(tau * np.vstack([F[0], np.zeros((memory, N))]))
    sooner, rate = exact @ start, F[0] @ exact @ y
    sooner[:n] -= np.outer(rate, guard @ sooner / (guard[:n] @ rate))
    for at_once, moved in ((1, exact @ start), (0, sooner)):
        size = np.abs(J) @ (np.abs(exact) @ np.abs(start) + np.abs(moved))
        assert np.all(np.abs(carried(None, F, guard, J, at_once, y, tau, start) - J @ moved) <= 1e-12 * size)


def test_without_smooth_channels_an_arc_is_that_with_one_that_does_not_act() -> None:
    rng = np.random.default_rng(3)
    n, N = 3, 5
    F, guard, y, J = rng.normal(size=(1, n, N)), rng.normal(size=N), rng.normal(size=N), rng.normal(size=(N, N))
    still = Channels(
        np.zeros(1, np.int64), np.ones((1, n)), np.ones((1, 2)), np.zeros((1, 1)), np.ones(1), np.zeros((1, 1))
    )
    found = [carried(channels, F, guard, J, 0, y, 0.7, np.eye(N)) for channels in (None, still)]
    np.testing.assert_array_equal(*found)


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
