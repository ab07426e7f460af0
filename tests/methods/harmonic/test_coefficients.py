"""Smooth functions as the harmonic balance takes them, against those of the elements and differences of these."""

import numpy as np
import pytest

import eppanalysis as epp
from eppanalysis.methods.harmonic.coefficients import smooth_values
from eppanalysis.models.elements.automaton import SMOOTH_FUNCTIONS


@pytest.mark.parametrize("kind", SMOOTH_FUNCTIONS)
def test_every_smooth_function_is_known_with_its_slope(kind: str) -> None:
    x, h, constant, scale = np.array([-1.3, -0.2, 0.4, 2.1]), 1e-6, 0.3, -1.7
    smooth, function = epp.Smooth(kind, np.ones(1), constant, scale), SMOOTH_FUNCTIONS[kind]
    value, slope = smooth_values(smooth, x)
    np.testing.assert_allclose(value, scale * function(x + constant), rtol=1e-14)
    up, down = (scale * function(x + constant + step) for step in (h, -h))
    # Truncation is h**2 and rounding eps/h of functions of the order of 100.
    np.testing.assert_allclose(slope, (up - down) / (2 * h), rtol=1e-7, atol=1e-7)
