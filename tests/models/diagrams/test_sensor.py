"""The block "sensor": gain, quantiser and sample time in one, beside the same drawn by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

import eppanalysis as epp

CONNECT = ["setpoint - encoder -> controller", "controller -> plant", "plant -> encoder"]


def servo(parts: dict[str, epp.Block | epp.Nonlinearity], connect: list[str]) -> epp.LureSystem:
    both = {"controller": epp.blocks.PI(kp=2.0, ti=2.0, sample_time=0.05), **parts}
    both["plant"] = epp.blocks.TransferFunction(num=[1.0], den=[1.0, 1.5, 0.0])
    signals = {"position": "plant", "error": "setpoint - encoder"}
    return epp.Diagram(parts=both, connect=connect, inputs={"setpoint": 0.0}, signals=signals).to_system()


@pytest.mark.parametrize("sample_time", [None, 0.05, 0.1])
def test_a_sensor_is_a_quantiser_before_a_sampled_gain(sample_time: float | None) -> None:
    sensor = epp.blocks.Sensor(gain=-4.0, step=0.25, levels=40, sample_time=sample_time)
    one = servo({"encoder": sensor}, [c.replace("- encoder", "+ encoder") for c in CONNECT])
    drawn = {
        "steps": epp.Quantiser(step=0.0625, levels=40),
        "encoder": epp.blocks.Gain(gain=-4.0, sample_time=sample_time),
    }
    other = servo(
        drawn, ["setpoint + encoder -> controller", "controller -> plant", "plant -> steps", "steps -> encoder"]
    )
    runs = [
        epp.simulate(loop, epp.inputs.Step(1.0), t_end=10.0, t_eval=np.arange(0.0, 10.0, 0.013))
        for loop in (one, other)
    ]
    for name in ("position", "error"):
        np.testing.assert_array_equal(runs[0].signals[name], runs[1].signals[name])


def test_what_a_sampled_sensor_gives_is_a_whole_number_of_steps_of_what_was_there_at_the_sample() -> None:
    sensor = epp.blocks.Sensor(gain=10.0, step=0.01, levels=300, sample_time=0.1)
    loop = servo({"encoder": sensor}, CONNECT)
    times = np.arange(0.0, 8.0, 0.1) + 0.05
    run = epp.simulate(loop, epp.inputs.Step(1.0), t_end=8.0, t_eval=np.sort(np.append(times, times - 0.05)))
    given = 1.0 - run.signals["error"][1::2]
    np.testing.assert_allclose(given / 0.01, np.round(given / 0.01), atol=1e-9)
    at_samples = 10.0 * run.signals["position"][::2]
    assert np.abs(given - at_samples).max() <= 0.005 + 1e-9


def test_a_file_takes_its_fields_with_expressions_and_units() -> None:
    tables = {
        "kind": "diagram",
        "title": "Encoder",
        "connect": ["setpoint - encoder -> controller", "controller -> load", "load.angle -> encoder"],
        "inputs": {"setpoint": "0 rad"},
        "run": {"t_end": "1 s"},
        "parameters": {"bits": 12},
        "blocks": {
            "controller": {"kind": "pi", "kp": "4 N*m/rad", "sample_time": "1 ms"},
            "load": {"kind": "inertia", "inertia": "1 kg*m^2", "damping": "2 N*m*s/rad"},
            "encoder": {"kind": "sensor", "step": "2*pi/2^bits", "levels": 2048, "sample_time": "1 ms"},
        },
    }
    system = epp.Case.from_tables(tables, name="encoder").to_system()
    steps = dict(zip(system.element_names, system.elements, strict=True))["encoder_quantiser"]
    assert (
        isinstance(steps, epp.Quantiser) and steps.step == pytest.approx(2.0 * math.pi / 4096) and steps.levels == 2048
    )


@pytest.mark.parametrize(("field", "value"), [("step", 0.0), ("levels", 2.5), ("levels", 0), ("gain", 0.0)])
def test_what_is_no_sensor_is_refused(field: str, value: float) -> None:
    with pytest.raises(epp.EppError, match=f"Sensor: {field} is|{field} is"):
        epp.blocks.Sensor(**{"step": 0.1, field: value})
