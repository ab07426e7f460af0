"""Wherever a traced curve passes a loop gain of one, there is a cycle in the list, or the result says why not."""

from __future__ import annotations

import numpy as np
import pytest

import eppanalysis as epp


def axis(kp=60.0, ti=0.5, gap=1.5, friction=0.15, step=10.0, sampled=True) -> epp.Case:
    """A geared axis with play, friction on both sides and an encoder, under PI control of its position."""
    pi = {"kind": "pi", "kp": kp, "ti": ti} | ({"sample_time": "2 ms"} if sampled else {})
    motor = {
        "kind": "motor", "resistance": "2.49 ohm", "inductance": "2.63 mH", "torque_constant": "0.0458 N*m/A",
        "inertia": "7.06e-6 kg*m^2", "ratio": 36,
    }  # fmt: skip
    return epp.Case.from_tables(
        {
            "kind": "diagram",
            "title": "Geared axis",
            "connect": [
                "setpoint - encoder -> pi", "pi -> amp", "amp -> motor.voltage",
                "motor.angle - load.angle -> gear.twist", "motor.speed - load.speed -> gear.rate",
                "-gear - motor_friction -> motor.torque", "motor.speed -> motor_friction",
                "gear - load_friction -> load", "load.speed -> load_friction", "load.angle -> encoder",
            ],
            "inputs": {"setpoint": "0 deg"},
            "margins_at": "pi",
            "run": {"t_end": "5 s", "input": {"kind": "step", "size": f"{step} deg"}},
            "blocks": {
                "pi": pi,
                "motor": motor,
                "load": {"kind": "inertia", "inertia": "0.01 kg*m^2", "damping": "0.01 N*m*s/rad"},
            },
            "elements": {
                "amp": {"element": "saturation", "lower": "-24 V", "upper": "24 V"},
                "gear": {
                    "element": "lock_pin", "gap": f"{gap} deg", "stiffness": "500 N*m/rad", "damping": "0.5 N*m*s/rad"
                },
                "motor_friction": {"element": "friction", "coulomb": f"{friction} N*m"},
                "load_friction": {"element": "friction", "coulomb": "0.05 N*m"},
                "encoder": {"element": "quantiser", "step": "2*pi/2000", "levels": 2000},
            },
        },
        name="axis",
    )  # fmt: skip


def unlisted(prediction: epp.Prediction) -> list[tuple[float, float]]:
    """Amplitudes and frequencies at which a branch of the picture passes one away from all that is listed."""
    listed = np.log([(p["amplitude"], p["omega"]) for p in prediction.curves["intersections"]]).reshape(-1, 2)
    missing = []
    for branch in prediction.curves["branches"]:
        gain, place = branch["loop_gain"] - 1.0, np.log(np.stack([branch["amplitude"], branch["omega"]], -1))
        for k in np.flatnonzero(gain[1:] * gain[:-1] < 0.0):
            way = np.abs(place[k + 1] - place[k])
            if np.all(way < 0.5) and not np.any(np.all(np.abs(listed - place[k]) < 2.0 * way + 0.02, axis=1)):
                missing.append(tuple(np.exp(place[k])))
    return missing


VARIED = [
    {},
    {"kp": 35.0, "ti": 0.2, "gap": 2.0, "sampled": False},
    {"kp": 90.0, "ti": 0.9, "gap": 0.4, "friction": 0.05, "step": 3.0},
]


@pytest.mark.slow
@pytest.mark.parametrize("changed", VARIED)
def test_every_crossing_of_the_picture_is_listed(changed):
    prediction = epp.predict_limit_cycles(axis(**changed))
    assert not unlisted(prediction) or any("was not solved" in w for w in prediction.warnings)
    assert all(cycle.residual < 1e-9 for cycle in prediction)


@pytest.mark.slow
def test_a_cycle_between_steps_of_an_encoder_is_found():
    """The gain of an encoder has a kink at each step that the motion meets: the corrector goes along the curve."""
    (cycle,) = epp.predict_limit_cycles(axis())
    assert cycle.omega == pytest.approx(2.780194, rel=1e-6)
    assert cycle.elements["amp"]["amplitude"] == pytest.approx(0.4053316, rel=1e-6)
    assert cycle.stable and cycle.residual < 1e-11
