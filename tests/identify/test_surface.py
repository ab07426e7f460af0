"""Draws from a bent ridge against integrals that are known, and what happens where no surface fits."""

from __future__ import annotations

import numpy as np
import pytest

from eppanalysis.identify.surface import explore
from tests.shared import mostly_slow

FAR = np.full(2, 50.0)


def ridge(width: float, bend: float):
    """A ridge of length 1 along the first axis, bent: moments 1, 0, and (width^2 + 2 bend^2) are exact."""
    return lambda q: np.array([q[0], (q[1] - bend * q[0] ** 2) / width, 0.0])


@pytest.mark.parametrize(("width", "bend"), mostly_slow([(1.0, 0.0), (0.1, 0.0), (0.1, 0.3), (0.1, 0.5)], [(0.1, 0.3)]))
def test_moments_of_a_bent_ridge(width, bend):
    found = [explore(ridge(width, bend), np.zeros(2), np.diag([1.0, width**2]), -FAR, FAR, seed) for seed in range(6)]
    variances = np.mean([np.diag(c.matrix) for c in found], axis=0)
    # Six times a hundred draws: 6 % of a variance, three times that for the square of a normal number.
    np.testing.assert_allclose(variances, [1.0, width**2 + 2.0 * bend**2], rtol=0.25)
    assert np.mean([c.mean[1] for c in found]) == pytest.approx(bend, abs=0.2)
    assert min(c.effective for c in found) > 50


def test_a_matrix_of_derivatives_is_wrong_about_such_a_ridge():
    """The reason for the surface: the second parameter reaches many times farther than its derivative says."""
    cloud = explore(ridge(0.05, 1.0), np.zeros(2), np.diag([1.0, 0.0025]), -FAR, FAR, seed=1)
    assert np.sqrt(cloud.matrix[1, 1]) > 10 * 0.05


def test_bounds_are_kept_and_a_poor_begin_is_mended():
    low = np.array([0.0, -50.0])
    cloud = explore(ridge(0.2, 0.3), np.array([1.5, 1.0]), np.diag([4.0, 4.0]), low, FAR, seed=2)
    # Half a normal distribution: mean sqrt(2/pi), variance 1 - 2/pi.
    assert cloud.mean[0] == pytest.approx(np.sqrt(2 / np.pi), abs=0.25)
    assert cloud.matrix[0, 0] == pytest.approx(1 - 2 / np.pi, rel=0.5)
    assert np.sum(ridge(0.2, 0.3)(cloud.best) ** 2) < 0.5


@pytest.mark.slow
def test_what_is_no_quadratic_surface_is_worth_few_draws():
    """A comb of a hundred teeth: the weights say that the surface is none."""
    cloud = explore(
        lambda q: np.array([q[0] / 3.0, 8.0 * np.sin(60.0 * q[0]), q[1]]), np.zeros(2), np.eye(2), -FAR, FAR, seed=3
    )
    assert cloud.effective < 30
