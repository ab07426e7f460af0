"""Writes the example recordings in cases/measured: ``python -m tests.reference.make_measured``."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

import eppanalysis as epp
from tests.reference.benches import LBF, Bench, backlash_cycling, step_response, weight_tray

FOLDER = Path(__file__).parent.parent.parent / "cases" / "measured"

#: The elbow behind the examples: nominal but for what a bench would have to find out.
TRAY = {"pulley.friction": 0.0526, "pulley.kinetic_ratio": 0.8, "sensor.gain": 2.0 / LBF, "sensor.full_scale": 8.8}
CYCLING = {"backlash": 0.0436332, "cable_stiffness": 6705.263, "pin_stiffness": 1000.0, "pulley_friction": 0.0526}
STEP = {
    "drive.inertia": 0.03,
    "drive.coulomb_friction": 0.3,
    "drive.electrical_time_constant": 1e-3,
    "controller.delay": 1e-3,
    "lock_pin.backlash": CYCLING["backlash"],
    "cable.stiffness": CYCLING["cable_stiffness"],
    "pulley.friction": TRAY["pulley.friction"],
}

#: The servo behind the example, in place of its data sheet.
SERVO = {"J_load": 0.062, "gap": np.radians(0.14)}


def servo_step(seed: int, truth: dict[str, float]) -> Bench:
    """The azimuth servo's command and load angle while it is stepped twice: of the package's own run, with noise."""
    t = np.arange(0.0, 1.2005, 0.002)
    setpoint = np.where(t < 0.1, 0.0, np.where(t < 0.6, 0.05, 0.01))
    servo = epp.case("azimuth_servo").with_values(truth)
    run = epp.simulate(servo, epp.inputs.Recorded(t, setpoint), t_end=t[-1], t_eval=t)
    load = np.degrees(run.signals["load"]) + 0.004 * np.random.default_rng(seed).normal(size=t.size)
    speed = run.signals["motor_speed"] + 0.005 * np.random.default_rng(seed + 1).normal(size=t.size)
    rows = np.column_stack([t, np.degrees(setpoint), load, speed])
    return Bench(("time [s]", "setpoint [deg]", "load [deg]", "motor_speed [rad/s]"), rows, truth)


def main() -> None:
    """Write all of them."""
    FOLDER.mkdir(exist_ok=True)
    weight_tray(2005, continuous=False, known=TRAY).write(FOLDER / "weight_tray.csv", 4)
    cycling = backlash_cycling(2005, torque=True, known=CYCLING)
    step_response(2005, known=STEP).write(FOLDER / "step_response.csv", 4)
    servo_step(2005, SERVO).write(FOLDER / "servo_step.csv", 4)
    replace(cycling, rows=cycling.rows[::3]).write(FOLDER / "backlash_cycling.csv", 4)


if __name__ == "__main__":
    main()
