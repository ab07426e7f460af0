"""Writes the example recordings in cases/measured: ``python -m tests.reference.make_measured``."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from tests.reference.benches import LBF, backlash_cycling, step_response, weight_tray

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


def main() -> None:
    """Write all of them."""
    FOLDER.mkdir(exist_ok=True)
    weight_tray(2005, continuous=False, known=TRAY).write(FOLDER / "weight_tray.csv", 4)
    cycling = backlash_cycling(2005, torque=True, known=CYCLING)
    step_response(2005, known=STEP).write(FOLDER / "step_response.csv", 4)
    replace(cycling, rows=cycling.rows[::3]).write(FOLDER / "backlash_cycling.csv", 4)


if __name__ == "__main__":
    main()
