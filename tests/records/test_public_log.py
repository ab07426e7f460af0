"""A public log, as docs/howto/records.md reads it: the gain of the controller behind it is one of its parameters.

The file is test/sample.ulg of https://github.com/PX4/pyulog (v1.2.3); EPP_ULOG is its path.
"""

from __future__ import annotations

import os

import pytest

import eppanalysis as epp

pyulog = pytest.importorskip("pyulog")
LOG = os.environ.get("EPP_ULOG", "")
pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not LOG, reason="EPP_ULOG names no test/sample.ulg of PX4/pyulog"),
]
CONTROLLER = """
kind = "diagram"
title = "Yaw rate control of a multicopter"
connect = ["demand - rate -> law", "law -> limit"]
inputs = ["demand", "rate"]
signals = { command = { of = "limit" } }
blocks.law = { kind = "gain", gain = 0.1 }
elements.limit = { kind = "saturation", lower = -1, upper = 1 }
run.t_end = "8 s"
"""
COLUMNS = {
    "command": ("actuator_controls_0.control[2]", ""),
    "demand": ("vehicle_rates_setpoint.yaw", ""),
    "rate": ("vehicle_attitude.yawspeed", ""),
}


def test_the_gain_of_the_controller_is_the_parameter_in_the_log() -> None:
    found = epp.identify(epp.case_from_text(CONTROLLER), step=LOG, fit=("law.gain",), columns=COLUMNS)
    assert found["law.gain"].value == pytest.approx(pyulog.ULog(LOG).initial_parameters["MC_YAWRATE_P"], rel=0.005)


def test_what_repeats_nothing_is_no_oscillation() -> None:
    case = epp.case_from_text(CONTROLLER).with_values({"law.gain": 0.2})
    with pytest.raises(epp.EppError, match="holds 1.8 periods of 37.79 s; expected 3 or more"):
        epp.diagnose(case, LOG, columns={"command": COLUMNS["command"]})
