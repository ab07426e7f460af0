"""Symmetric cycles of one relay at all half periods, against closed forms by residues of the plant."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.signal import residue

import eppanalysis as epp


@pytest.mark.parametrize("width", [0.01, 0.05])
@pytest.mark.parametrize("turned", [False, True], ids=["canonical", "turned"])
def test_a_relay_with_hysteresis_has_the_roots_of_tsypkins_function(width: float, turned: bool) -> None:
    """For G = sum r/(s - p) the input behind half a period h is sum of r/p tanh(p h/2), of a relay of one."""
    numerator, denominator = [1.0, 0.3], np.polymul([1.0, 0.06, 1.0], [1.0, 0.08, 9.0])
    loop = epp.LureSystem.from_tf((numerator, denominator), epp.HysteresisRelay(-width, width))
    if turned:
        Q, _ = np.linalg.qr(np.random.default_rng(1).normal(size=loop.A.shape))
        loop = loop.in_coordinates(Q, Q.T)
    r, p, _ = residue(numerator, denominator)

    def off(h: float) -> float:
        return float(np.sum(r / p * np.tanh(p * h / 2.0)).real) - width

    grid = np.arange(0.05, 60.0, 0.01)
    values = np.array([off(h) for h in grid])
    at = np.flatnonzero((values[:-1] < 0) != (values[1:] < 0))
    roots = [brentq(off, grid[i], grid[i + 1], xtol=1e-13) for i in at]

    def stays(h: float) -> bool:
        """Whether the input stays above the lower threshold until half a period behind the upper one is over."""
        t = np.linspace(0.0, h, 4000)[1:-1, None]
        state = np.exp(p * t) * (-np.tanh(p * h / 2.0) / p) + np.expm1(p * t) / p
        return bool(np.max((state @ r).real) < width)

    found = sorted(0.5 * cycle.period for cycle in epp.find_limit_cycles(loop))
    assert found == pytest.approx([h for h in roots if stays(h)], rel=1e-9) and found
