"""Servos whose static friction is little above Coulomb's under integral action: long cycles of short slips; the witness
solves stick and slip in turn, each in closed form.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.linalg import expm
from scipy.optimize import brentq

import eppanalysis as epp
from tests.shared import mostly_slow

_KP, _KI, _DAMPING, _STATIC = 5.0, 1.0, 0.2, 0.6


def _servo(coulomb: float, setpoint: float, controller: object) -> epp.CycleSearch:
    """A mass of 1 kg in friction."""
    loop = epp.Diagram(
        parts={
            "c": controller,
            "mass": epp.blocks.Mass(mass=1.0, damping=_DAMPING),
            "friction": epp.Friction(coulomb, static=_STATIC),
        },
        connect=["setpoint - mass.position -> c", "c - friction -> mass.force", "mass.speed -> friction"],
        inputs={"setpoint": setpoint},
    )
    return epp.find_limit_cycles(loop.to_system())


def _slide(state: NDArray[np.float64], friction: float) -> Callable[[float], NDArray[np.float64]]:
    """The motion from a state under a constant force of friction."""
    law = np.array([
        [0.0, -1.0, 0.0, 0.0],
        [0.0, 0.0, 1.0, 0.0],
        [_KI, -_KP, -_DAMPING, friction],
        [0.0, 0.0, 0.0, 0.0],
    ])  # fmt: skip
    return lambda t: np.asarray(expm(law * t) @ np.append(state, 1.0))


def _last_period(coulomb: float, state: NDArray[np.float64], slips: int) -> float:
    """Time between the last slips to one side of a motion from (integral of the error, position, speed), at setpoint 0.

    It begins with a slip; the force of the controller is `_KP` and `_KI` on the error and its integral.
    """
    now, times = 0.0, []
    for _ in range(slips):
        side = np.sign(_KI * state[0] - _KP * state[1])
        slid = _slide(state, -side * coulomb)
        steps = np.arange(1, 1000) * 1e-2
        end = next(t for t in steps if side * slid(t)[2] <= 0.0)
        t = brentq(lambda t, slid=slid: slid(t)[2], end - 1e-2, end, xtol=1e-15)
        state = np.append(slid(t)[:2], 0.0)
        # Stuck, the integral of the error goes on until the force breaks it away.
        force, rate = _KI * state[0] - _KP * state[1], -_KI * state[1]
        stuck = (np.sign(rate) * _STATIC - force) / rate
        state = np.array([state[0] - state[1] * stuck, state[1], 0.0])
        now += t + stuck
        times.append(now)
    return float(times[-1] - times[-3])


@pytest.mark.parametrize("coulomb", [0.54, pytest.param(0.594, marks=pytest.mark.slow)])
def test_slips_that_shrink_down_to_static_friction_go_on_for_ever(coulomb):
    """At first each slip is the same share of the last one: no share of it is left of what breaks it away."""
    found = _servo(coulomb, 0.0, epp.blocks.PI(kp=_KP, ti=_KP / _KI))
    begin = np.array([0.0, -_STATIC / _KP, 0.0])
    assert not found.settles and found.status.ok
    assert [c.period for c in found] == [pytest.approx(_last_period(coulomb, begin, 120), rel=1e-9)]


@pytest.mark.parametrize("setpoint", mostly_slow([5.0, -300.0, 1e5], [-300.0]))
def test_a_cycle_far_smaller_than_its_setpoint_is_closed(setpoint):
    """Its slips are a millionth of the setpoint, and its period is that at zero."""
    limited = epp.AntiWindupPID(kp=_KP, ki=_KI, tracking_time=0.25, lower=-1.7, upper=1.7)
    here, there = _servo(0.594, 0.0, limited), _servo(0.594, setpoint, limited)
    assert [c.method for c in there] == ["exact orbit"] and there.status.ok
    assert there[0].period == pytest.approx(here[0].period, rel=1e-9)
    assert there[0].mean["mass_position"] == pytest.approx(setpoint, rel=1e-9)
    assert there[0].operating_point == epp.OperatingPoint({"setpoint": setpoint})


@pytest.mark.slow
def test_a_cycle_that_runs_come_to_slowly_is_listed_once():
    """Every turn brings a run nearer by a fourteenth: what it is on shows after hundreds of turns."""
    loop = epp.Diagram(
        parts={
            "c": epp.blocks.PI(kp=27.4, ti=6.4),
            "mass": epp.blocks.Mass(mass=0.223, damping=0.817),
            "friction": epp.Friction(0.1313, static=0.1354),
        },
        connect=["setpoint - mass.position -> c", "c - friction -> mass.force", "mass.speed -> friction"],
        inputs={"setpoint": 1.0},
    )
    found = epp.find_limit_cycles(loop.to_system())
    assert [c.method for c in found] == ["exact orbit"] and found.status.ok
