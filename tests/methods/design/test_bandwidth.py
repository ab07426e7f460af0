"""The bandwidth of a two-mass servo without limit cycles: laws of scale, its fold from elsewhere, the front."""

from __future__ import annotations

import numpy as np
import pytest

import eppanalysis as epp

TWO_MASS = """
kind = "diagram"
title = "Two-mass servo with backlash, position of the load and speed of the motor fed back"
connect = [
  "reference - load.angle -> position",
  "position - motor.speed -> speed",
  "speed - gear -> motor",
  "gear - friction -> load",
  "load.speed -> friction",
  "motor.angle - load.angle -> gear.twist",
  "motor.speed - load.speed -> gear.rate",
]
inputs = { reference = "0 rad" }
margins_at = "position"
signals = { angle = { of = "load.angle", unit = "rad" }, twist = { of = "motor.angle - load.angle", unit = "rad" } }
run = { t_end = "5 s", input = { kind = "step", size = "0.1 rad" } }
[parameters]
Kp = { value = "10 1/s", mark = "tunable" }
Kv = { value = "0.4 N*m*s/rad", mark = "tunable" }
gap = "0.5 deg"
[blocks]
position = { kind = "gain", gain = "Kp" }
speed = { kind = "gain", gain = "Kv" }
motor = { kind = "inertia", inertia = "0.001 kg*m^2", damping = "0.002 N*m*s/rad" }
load = { kind = "inertia", inertia = "0.004 kg*m^2", damping = "0.002 N*m*s/rad" }
[elements]
gear = { element = "lock_pin", gap = "gap", stiffness = "40 N*m/rad", damping = "0.02 N*m*s/rad" }
friction = { element = "friction", coulomb = "0.02 N*m" }
"""
RANGE = ("5 1/s", "100 1/s")


@pytest.fixture(scope="module")
def servo() -> epp.Case:
    return epp.case_from_text(TWO_MASS)


@pytest.fixture(scope="module")
def front(servo: epp.Case) -> epp.Design:
    return epp.design(servo, {"Kp": RANGE}, maximise="bandwidth", front={"gap": ["0.25 deg", "1 deg"]}, verify=False)


@pytest.mark.slow
def test_only_the_ratio_of_backlash_and_friction_counts(servo: epp.Case, front: epp.Design) -> None:
    """Twice the backlash with twice the friction is the same loop with motions twice as large."""
    twice = servo.with_values({"gap": "1 deg", "friction.coulomb": 0.04})
    other = epp.design(twice, {"Kp": RANGE}, maximise="bandwidth", verify=False).optimum
    best = front.optimum
    assert other.at["Kp"] == pytest.approx(best.at["Kp"], rel=1e-6)
    assert other.objective == pytest.approx(best.objective, rel=1e-6)
    assert best.prices["gap"] == pytest.approx(-best.prices["friction.coulomb"], rel=1e-4)


@pytest.mark.slow
def test_the_bandwidth_is_that_of_the_bound_and_falls_with_the_backlash(servo: epp.Case, front: epp.Design) -> None:
    best = front.optimum
    assert best.objective == pytest.approx(epp.margins(servo.with_values(best.at)).bandwidth, rel=1e-9)
    (cell,) = epp.design_bounds(servo, "gap", "Kp", at=["0.5 deg"], within=RANGE, verify=False)
    assert best.at["Kp"] == pytest.approx(cell.exact, rel=1e-6)
    (small, low), (large, high) = front.front
    assert small < servo.value("gap") < large
    assert low.objective > best.objective > high.objective
    assert front.to_frame().attrs["units"]["bandwidth"] == "rad/s"
    ax = front.plot()
    assert "bandwidth [Hz]" in ax.get_ylabel()
    # What the verdict above the picture says is of the case's own backlash: it is in the picture.
    (ring,) = [line for line in ax.lines if line.get_label() == "own value of gap"]
    assert ring.get_markerfacecolor() == "none"  # the mark of the optimum is seen within
    assert ring.get_ydata()[0] == pytest.approx(front.value_of(best) / (2.0 * np.pi))
    assert ring.get_xdata()[0] == pytest.approx(np.degrees(front.front_own))
