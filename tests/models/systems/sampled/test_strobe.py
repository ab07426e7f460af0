"""Samples that come round together."""

from __future__ import annotations

import math

import numpy as np
import pytest

import eppanalysis as epp
from eppanalysis.models.systems.hybrid import HybridSystem
from eppanalysis.models.systems.sampled.strobe import Strobe, refuse_samples
from tests.coordinates import in_coordinates, orthogonal


def strobe(*times: float) -> Strobe:
    laws = [epp.SampledController([], [], [], [[1.0]], T) for T in times]
    loop = epp.LureSystem.build([[-1.0]], np.ones((1, len(laws))), np.ones((len(laws), 1)), laws)
    found = Strobe.of(HybridSystem.from_lure(loop))
    assert found is not None
    return found


@pytest.mark.parametrize(
    ("times", "period"),
    [((0.1,), 0.1), ((0.1, 0.3), 0.3), ((0.2, 0.3), 0.6), ((0.001, 0.005, 0.0125), 0.025), ((0.1, 1.0 / 3.0), 1.0)],
)
def test_samples_come_round_after_their_least_common_multiple(times, period) -> None:
    assert strobe(*times).period == pytest.approx(period, rel=1e-12)


def test_rates_without_a_common_divisor_never_come_round() -> None:
    assert strobe(0.1, 0.1 * math.sqrt(2.0)).period == math.inf


def test_a_loop_is_begun_behind_any_of_its_samples() -> None:
    s = strobe(0.1, 0.3)
    x, H = s.hybrid.x0.copy(), s.hybrid.H0.copy()
    x[s.clock] = 900.0  # s
    H[s.counting] += [9000.0, 9000.0]
    begun = s.begun(x, H, s.hybrid.modes0)
    np.testing.assert_array_equal(begun.H0, s.hybrid.H0)
    assert begun.x0[s.clock] == 0.0


@pytest.mark.parametrize(
    ("analysis", "instead"),
    [("certify", "certify_orbit"), ("frozen_nyquist", "use predict_limit_cycles"), ("A batch", "simulate")],
)
def test_an_analysis_that_does_not_cover_samples_names_those_that_do(analysis, instead) -> None:
    refuse_samples([epp.Play(1.0)], analysis)
    with pytest.raises(epp.EppError, match=f"{analysis} does not cover loops with sampled controllers: {instead}"):
        refuse_samples([epp.Play(1.0), epp.SampledController([], [], [], [[1.0]], 0.1)], analysis)


@pytest.mark.parametrize("analysis", [epp.predict_limit_cycles, epp.find_limit_cycles, epp.margins])
def test_a_clock_that_is_mixed_with_other_states_is_refused(analysis) -> None:
    """Such coordinates lost predictions and margins without a word."""
    loop = epp.case("virtual_spring").to_system()
    with pytest.raises(epp.ModelError, match="clock"):
        analysis(in_coordinates(loop, orthogonal(len(loop.A), 0)))
