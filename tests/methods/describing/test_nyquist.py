"""What the pictures of a prediction show: the curves themselves, checked against loops with another gain."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import eppanalysis as epp
from tests.shared import predicted


def test_nyquist_curve_and_locus_meet_at_every_cycle():
    loop = epp.LureSystem.from_tf(([5.0], [1.0, 1.0, 0.0]), epp.Play(gap=2.0))
    curves = epp.predict_limit_cycles(loop).curves
    assert curves["kind"] == "nyquist" and len(curves["intersections"]) == 2
    for meeting in curves["intersections"]:
        s = 1j * meeting["omega"]
        assert meeting["value"] == pytest.approx(5.0 / (s * (s + 1)), rel=1e-9)
        for name in ("response", "locus"):
            # Both curves are drawn finely enough to pass through the mark.
            assert np.abs(curves[name] - meeting["value"]).min() < 0.05 * abs(meeting["value"])
    s = 1j * curves["omega"]
    np.testing.assert_allclose(curves["response"], 5.0 / (s * (s + 1)), rtol=1e-10)


def test_loop_gain_says_which_gain_would_keep_up_an_oscillation():
    """With its inverse in front of the saturation, the loop has a cycle of just that amplitude there."""
    system, curves = epp.case("sat_plus_backlash").to_system(), predicted("sat_plus_backlash").curves
    assert (curves["kind"], curves["element"]) == ("residual", "saturation")
    (branch,) = curves["branches"]
    for target in (0.6, 2.0):
        i = int(np.argmin(np.abs(np.log(branch["loop_gain"] / target))))
        factor = 1.0 / branch["loop_gain"][i]
        rows = np.array([[factor], [1.0]])
        scaled = replace(system, C=system.C * rows, D=system.D * rows)
        found = epp.predict_limit_cycles(scaled)
        amplitudes = [c.elements["saturation"]["amplitude"] for c in found]
        assert min(abs(a / branch["amplitude"][i] - 1.0) for a in amplitudes) < 1e-6
        assert any(c.omega == pytest.approx(branch["omega"][i], rel=1e-6) for c in found)


def test_loop_gain_of_the_elbow_rises_through_the_unstable_cycle_and_falls_through_the_stable_one():
    prediction = predicted("fig8a_original")
    (branch,) = prediction.curves["branches"]
    amplitude, gain = np.log(branch["amplitude"]), np.log(branch["loop_gain"])
    for cycle, meeting in zip(prediction, prediction.curves["intersections"], strict=True):
        near = int(np.argmin(np.hypot(amplitude - np.log(meeting["amplitude"]), gain)))
        assert abs(gain[near]) < 0.1
        slope = (gain[near + 1] - gain[near - 1]) / (amplitude[near + 1] - amplitude[near - 1])
        assert bool(slope < 0) is cycle.stable


def test_loop_gain_of_an_elbow_without_cycles_stays_below_one():
    prediction = predicted("fig8b_reduced_backlash")
    assert len(prediction) == 0 and prediction.curves["branches"]
    assert max(float(b["loop_gain"].max()) for b in prediction.curves["branches"]) < 1.0


def test_curves_are_computed_only_when_they_are_asked_for():
    curves = epp.predict_limit_cycles(epp.case("sat_plus_backlash").to_system()).curves
    assert "_values" not in vars(curves)
    assert set(curves) == {"kind", "element", "unit", "branches", "intersections"}
    assert "_values" in vars(curves)
