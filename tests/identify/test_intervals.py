"""Intervals against experiments repeated many times, and the friction loop against a state machine."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, strategies as st

from eppanalysis.identify.intervals import confounded, rounding, weighted
from eppanalysis.identify.strokes import Pulley, sensor_force, strokes
from tests.reference.benches import disturbed, quantise, sensed


@pytest.mark.slow
@pytest.mark.parametrize("wander", [0.0, 0.01])
def test_intervals_of_a_slope_cover_it_with_white_noise_and_with_wander(wander):
    rng = np.random.default_rng(3)
    t = np.linspace(-0.5, 0.5, 300)
    columns = np.column_stack([np.ones(300), t, np.abs(6.0 * t % 2.0 - 1.0)])
    hits = 0
    for _ in range(200):
        y = disturbed(rng, np.zeros(300), 0.01, 0.03, wander)
        p = np.linalg.lstsq(columns, y, rcond=None)[0]
        found = weighted(columns, columns @ p - y)
        hits += abs(p[2] + found.step[2]) < found.half_widths()[2]
    assert 0.90 <= hits / 200 <= 0.99


@pytest.mark.slow
def test_plain_least_squares_would_not_cover():
    """The reason for the weights: with wander the textbook interval holds the truth far too rarely."""
    rng = np.random.default_rng(4)
    t = np.linspace(-0.5, 0.5, 300)
    columns = np.column_stack([np.ones(300), t, np.abs(6.0 * t % 2.0 - 1.0)])
    inverse = np.linalg.inv(columns.T @ columns)
    hits = 0
    for _ in range(100):
        y = disturbed(rng, np.zeros(300), 0.01, 0.03, 0.01)
        p = np.linalg.lstsq(columns, y, rcond=None)[0]
        hits += abs(p[2]) < 1.96 * math.sqrt(inverse[2, 2] * np.sum((y - columns @ p) ** 2) / 297)
    assert hits < 60


def test_dependent_columns_are_named():
    a = np.array([1.0, 2.0, 4.0, 1.0])
    columns = np.column_stack([a, np.ones(4), 2.0 * a])
    assert confounded(columns, ["gain", "offset", "friction"]) == ["gain", "friction"]
    assert confounded(columns[:, :2], ["gain", "offset"]) == []
    assert confounded(np.column_stack([a, np.zeros(4)]), ["gain", "delay"]) == ["delay"]


@pytest.mark.parametrize("noise", [0.02, 0.2, 0.35])
def test_rounding_bounds_the_error_of_a_mean(noise):
    rng = np.random.default_rng(5)
    worst = 0.0
    for level in np.linspace(0.0, 1.0, 21):
        readings = quantise(level + 10.0 + noise * rng.normal(size=20_000), 0.0, 4096.0)
        bound = rounding(1.0, float(np.std(readings)))
        worst = max(worst, abs(readings.mean() - level - 10.0) - bound)
    assert worst < 0.16 * math.exp(-2 * (math.pi * noise) ** 2) + 0.02


@given(st.lists(st.floats(0.0, 20.0), min_size=2, max_size=30), st.floats(0.005, 0.1), st.floats(0.5, 1.0))
def test_friction_loop_is_that_of_a_state_machine(turns, static, ratio):
    """Weights added and removed at will, against a pulley that is asked weight by weight whether it holds."""
    loads = np.concatenate([[0.0], *(np.linspace(a, b, 6)[1:] for a, b in zip([0.0, *turns], turns, strict=False))])
    pieces = strokes(loads, 1e-9)
    if not pieces or np.min(np.abs(np.diff(loads))) == 0:
        return
    pulley = Pulley.of_force(math.atanh(static), math.atanh(ratio * static))
    found = sensor_force(loads, pieces, pulley)
    expected = sensed(loads.tolist(), static, ratio * static)
    np.testing.assert_allclose(found, expected, atol=1e-9)
