"""Branches of a loop that a setpoint only moves are those about zero."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import eppanalysis as epp

_CARRIAGE = """
kind = "diagram"
title = "Carriage that hunts in static friction"
connect = ["setpoint - car.position -> pid", "pid - friction -> car", "car.speed -> friction"]
inputs = {{ setpoint = "{} m" }}

[blocks]
car = {{ kind = "mass", mass = "2 kg", damping = "3 N*s/m" }}
pid = {{ kind = "pid", kp = 40, ki = 30, kd = 8, tf = 0.02 }}

[elements]
friction = {{ kind = "friction", coulomb = 1.5, static = "static" }}

[parameters]
static = 2.5

[signals]
x = {{ of = "car.position", unit = "mm" }}

[run]
t_end = "60 s"
"""


def _branch(folder: Path, setpoint: float) -> epp.Branch:
    path = folder / f"at_{setpoint}.toml"
    path.write_text(_CARRIAGE.format(setpoint))
    return epp.continue_branch(epp.read_case(path), "static", 2.0, 4.0)


@pytest.mark.parametrize("setpoint", [20.0, -3000.0])
def test_a_branch_far_from_zero_is_that_about_zero(tmp_path: Path, setpoint: float) -> None:
    here, there = _branch(tmp_path, 0.0), _branch(tmp_path, setpoint)
    assert there.status.ok and str(there) == str(here)
    mine, yours = (np.argsort(branch.points["value"]) for branch in (here, there))
    periods = np.interp(there.points["value"], here.points["value"][mine], here.points["period"][mine])
    assert there.points["period"] == pytest.approx(periods, rel=1e-3)
    assert there.points["period"][yours[-1]] == pytest.approx(here.points["period"][mine[-1]], rel=1e-8)
    assert there.operating_point == epp.OperatingPoint({"setpoint": setpoint})
