"""Records of a sampled controller that hunts: its jumps are no noise, and a pattern that differs is no fit."""

from __future__ import annotations

import numpy as np
import pytest

import eppanalysis as epp
from eppanalysis.identify.response import Channel, _noise_of

SPINDLE = """
kind = "diagram"
title = "Spindle: sampled PI speed loop with encoder and current limit"
connect = [
  "demand - tacho -> controller",
  "controller -> current_limit",
  "current_limit -> torque_constant",
  "torque_constant - rubbing -> spindle",
  "spindle.speed -> rubbing",
  "spindle.speed -> tacho",
]
inputs = { demand = "0 rad/s" }
signals = { speed = { of = "spindle.speed", unit = "rad/s" }, current = { of = "current_limit", unit = "A" } }
[parameters]
J = { value = "350 g*cm^2", mark = "assumed", tolerance = "10 %" }
T = "1 ms"
[blocks]
controller = { kind = "pi", kp = "60 mA*s/rad", ti = "30 ms", sample_time = "T" }
torque_constant = { kind = "gain", gain = "38 mN*m/A" }
spindle = { kind = "inertia", inertia = "J", damping = "1e-5 N*m*s/rad" }
tacho = { kind = "sensor", step = "2*pi/2000/T", sample_time = "T" }
[elements]
current_limit = { element = "saturation", lower = "-6 A", upper = "6 A", slope = 1 }
rubbing = { element = "friction", coulomb = "4 mN*m", static = "6 mN*m" }
[run]
t_end = "1 s"
inputs = { demand = { kind = "step", size = "100 rad/s" } }
"""


def spindle(inertia: float, coulomb: float, rows: int, step: float = 1e-5) -> np.ndarray:
    """Time, speed and current at every sample: in fixed steps, the friction by its sign."""
    T, quantum, speed, integral, out = 1e-3, 2 * np.pi / 2.0, 0.0, 0.0, []
    for k in range(rows):
        error = 100.0 - quantum * np.rint(speed / quantum)
        integral += 0.06 / 0.03 * T * error
        current = float(np.clip(0.06 * error + integral, -6.0, 6.0))
        out.append((k * T, speed, current))
        for _ in range(round(T / step)):
            speed = max(speed + step * (0.038 * current - 1e-5 * speed - coulomb) / inertia, 0.0)
    return np.array(out)


def hunting(rng: np.random.Generator, n: int = 600) -> np.ndarray:
    """A current that jumps at every third or fourth row."""
    out = np.zeros(n)
    out[np.cumsum(rng.integers(3, 5, n // 4))] = 0.19
    return out


@pytest.mark.parametrize("seed", range(5))
def test_jumps_of_the_motion_are_no_noise_and_another_pattern_is_no_fit(seed) -> None:
    rng = np.random.default_rng(seed)
    motion = hunting(rng)
    data = motion + 0.01 * rng.normal(size=motion.size)
    drift = np.column_stack([np.ones(data.size), np.linspace(-0.5, 0.5, data.size)])
    seen = Channel("current", data, drift, _noise_of(data, 0.0), np.ones(data.size, bool))
    assert seen.noise > 0.03
    known = seen.quieter(motion)
    assert known.noise == pytest.approx(0.01, rel=0.15) and known.noise_alone(motion)
    late = motion.copy()
    late[300:330] = np.roll(motion, 1)[300:330]
    assert not seen.quieter(late).noise_alone(late)
    other = hunting(rng)
    assert not seen.quieter(other).noise_alone(other)


@pytest.mark.slow
def test_friction_of_a_loop_that_hunts_is_within_its_interval(tmp_path, few_draws) -> None:
    coulomb = 4.6e-3
    rows = spindle(372e-7, coulomb, 300)
    rows[:, 1:] += np.random.default_rng(1).normal(size=(len(rows), 2)) * [0.3, 0.01]
    path = tmp_path / "record.csv"
    np.savetxt(path, rows, delimiter=",", header="time [s],speed [rad/s],current [A]", comments="")
    fit = epp.identify(epp.case_from_text(SPINDLE), step=path, fit=("rubbing.coulomb",)).fits[0]
    friction, inertia = fit["rubbing.coulomb"], fit["J"]
    assert friction.low < coulomb < friction.high and inertia.low < 372e-7 < inertia.high
    assert fit.status.ok or any("searches from other starts" in note for note in fit.notes)
