"""Extrema of Fourier series and their rises through a level, against roots of polynomials and dense grids."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, strategies as st

from eppanalysis.engine._engine import parts
from eppanalysis.methods.harmonic.series import extrema
from tests.fourier import series, turning_points, value


@given(seed=st.integers(0, 10**6), n=st.integers(1, 12))
def test_extrema_are_the_roots_of_the_slope(seed, n):
    c = series(n, 0.3, 1.0, seed)
    phase, level = extrema(c)[0]
    np.testing.assert_allclose(phase, turning_points(c[0]), rtol=0, atol=1e-8)
    np.testing.assert_allclose(level, [value(c[0], p) for p in phase], rtol=0, atol=1e-13)


@given(seed=st.integers(0, 10**6), share=st.floats(0.02, 0.98), start=st.floats(0.0, 6.28))
def test_next_rise_through_a_level(seed, share, start):
    c = series(5, 0.3, 1.0, seed)
    phase, level = extrema(c)[0]
    goal = level.min() + share * np.ptp(level)
    here = value(c[0], start)
    found = parts.next_rise(c[0], phase, level, len(phase), start, here, goal, 1.0)
    grid = np.linspace(start, found, 400)[1:-1]
    if here > goal:
        assert found == start
    else:
        assert abs(value(c[0], found) - goal) < 1e-13 * np.abs(c).sum()
        assert all(value(c[0], p) < goal + 1e-12 for p in grid)


@pytest.mark.parametrize("phase", [0.0, np.pi / 2, np.pi, 0.3])
def test_extrema_of_a_cosine_are_two_wherever_they_lie(phase):
    """On the seam the slope is zero at the very first sample, and of either sign half a rounding off it."""
    found, level = extrema(np.array([[0.0, np.exp(-1j * phase)]]))[0]
    assert len(found) == 2
    np.testing.assert_allclose(np.cos(found - phase), level, atol=1e-15)
    np.testing.assert_allclose(np.sort(level), [-1.0, 1.0], atol=1e-15)


@pytest.mark.parametrize("excess", [1e-3, 1e-4, 1e-6])
@pytest.mark.parametrize("shift", [0.0, 0.05, 0.1, 0.15])
def test_a_close_pair_is_found(excess, shift):
    """The slope ``cos(u) + (1 + excess) cos(2 u)``, u from `shift` on, is zero just before and just behind u = pi."""
    b, k = 1.0 + excess, np.arange(1, 3)
    c = np.array([0.0, *(np.array([1.0, b]) / (1j * k) * np.exp(-1j * k * shift))])
    found, _ = extrema(c[None])[0]
    cosines = (-1.0 + np.array([-1.0, 1.0]) * np.sqrt(1.0 + 8.0 * b * b)) / (4.0 * b)
    expected = np.concatenate([np.arccos(cosines), -np.arccos(cosines)]) + shift
    np.testing.assert_allclose(found, np.sort(expected % (2 * np.pi)), atol=1e-9)


@pytest.mark.parametrize("mean", [0.0, 1.0, 1e6])
def test_what_does_not_move_has_no_extrema(mean):
    assert len(extrema(np.array([[mean, 1e-17 * mean, 0.0]], complex))[0][0]) == 0
