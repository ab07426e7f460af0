"""Records of a digital servo by an iteration of its own: what is named in a loop with samples, and in discrete time."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import expm

import eppanalysis as epp

#: Sample time [s], samples of the record in each, and the controller's zero and pole.
T, FINE, ZERO = 0.2, 4, 0.9
#: Rates of position and speed, on these and what is held at the input: ``1/(s (s + 1.5))``.
PLANT = np.array([[0.0, 1.0, 0.0], [0.0, -1.5, 1.0], [0.0, 0.0, 0.0]])
STEP, GAIN = 0.5, 2.4


def servo(kind: str, limit: float = 0.0) -> epp.Diagram:
    """A coarse encoder, a controller with an integral part, an amplifier with or without a limit, a motor."""
    pi = {"num": [GAIN, -ZERO * GAIN], "den": [1.0, -1.0], "sample_time": T}
    motor: dict = {"num": [1.0], "den": [1.0, 1.5, 0.0]}
    if kind == "discrete time":  # a hold in front of the same motor
        step = expm(T * PLANT)
        a, b = step[:2, :2], step[:2, 2:]
        den = np.poly(a)
        num = np.poly(a - b @ np.eye(1, 2)) - den
        motor = {"num": num[1:].tolist(), "den": den.tolist(), "sample_time": T}
    parts = {
        "encoder": epp.Quantiser(STEP, 400),
        "pi": epp.blocks.TransferFunction(**pi),
        "amplifier": epp.Saturation(-limit, limit) if limit else epp.blocks.Gain(gain=1.0),
        "motor": epp.blocks.TransferFunction(**motor),
    }
    wires = ["command - encoder -> pi", "pi -> amplifier", "amplifier + load -> motor", "motor -> encoder"]
    return epp.Diagram(parts, wires, inputs=["command", "load"], signals={"x": "motor", "u": "amplifier"})


def iterated(
    t_end: float, step: float = 0.0, gain: float = GAIN, load: tuple[float, float] = (0.0, 0.0)
) -> dict[str, np.ndarray]:
    """The loop by matrix exponentials over a quarter of a sample; a load is a sine of an amplitude and a frequency."""
    size, omega = load
    rates = np.zeros((5, 5))  # position, speed, what is held, sine and cosine of the load
    rates[:3, :3], rates[1, 3], rates[3, 4], rates[4, 3] = PLANT, size, omega, -omega
    small, state, summed, last = expm(T / FINE * rates), np.array([0.3, 0.0, 0.0, 0.0, 1.0]), 0.0, 0.0
    rows = []
    for k in range(round(t_end / T) * FINE):
        if k % FINE == 0:
            measured = step * np.round(state[0] / step) if step else state[0]
            summed += -gain * measured - ZERO * gain * last
            last = -measured
            state[2] = summed
        rows.append(state[[0, 2]])
        state = small @ state
    x, u = np.transpose(rows)
    return {"time": T / FINE * np.arange(len(x)), "x": x, "u": u}


def recorded(kind: str, begin: float, run: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """The last part of a run with one per cent of noise; in discrete time the samples alone."""
    rng = np.random.default_rng(5)
    chosen = run["time"] >= begin - 1e-9
    found = {n: y[chosen][:: 1 if kind == "sampled controller" else FINE] for n, y in run.items()}
    return {n: y + 0.01 * np.std(y) * rng.normal(size=y.size) * (n != "time") for n, y in found.items()}


KINDS = ["sampled controller", "discrete time"]


@pytest.mark.slow
def test_the_coarse_encoder_of_a_sampled_loop_is_named_with_its_step() -> None:
    record = recorded("sampled controller", 220.0, iterated(300.0, step=0.8 * STEP))
    found = epp.diagnose(servo("sampled controller", limit=20.0), record, steps=300_000)
    assert found.names == ("encoder",), str(found)
    value, low, high = found[0].fields["step"]
    assert low < 0.8 * STEP < high and value == pytest.approx(0.8 * STEP, rel=0.01)


@pytest.mark.parametrize("kind", KINDS)
def test_a_gain_that_is_too_high_is_named_and_exact_from_sample_to_sample(kind: str) -> None:
    """What stands for the hold in the mean is off by some per cent at eleven samples a turn."""
    record = recorded(kind, 10.0, iterated(40.0, gain=4.4 * GAIN))
    found = epp.diagnose(servo(kind), record, steps=3_000)
    assert found.names == ("linear instability",), str(found)
    assert found[0].fields["gain"][0] == pytest.approx(4.4, rel=2e-3)
    assert found.oscillation.others == ()  # what is held has images of the oscillation about the sample rate


@pytest.mark.parametrize("kind", KINDS)
def test_a_disturbance_is_named_with_its_place(kind: str) -> None:
    record = recorded(kind, 80.0, iterated(120.0, load=(1.3, 2.1)))
    found = epp.diagnose(servo(kind), record, steps=3_000)
    assert found.names == ("external disturbance",), str(found)
    assert found[0].note == "comes in at load"


def switched(kind: str, size: float) -> tuple[epp.Diagram, dict[str, np.ndarray]]:
    """A lag of second order under a relay with dead zone, and a record with one of another size."""
    relay = epp.RelayDeadZone(threshold=1.0, level=1.0)
    plant: dict = {"num": [20.0], "den": [1.0, 2.0, 1.0]}
    wires = ["command - plant -> controller", "controller -> valve", "valve -> plant"]
    parts = {"controller": epp.blocks.Gain(gain=1.0, sample_time=0.5), "valve": relay}
    if kind == "discrete time":
        plant = {"num": [1.2], "den": [1.0, -1.0, 0.25], "sample_time": 0.5}
        parts, wires = {"valve": relay}, ["command - plant -> valve", "valve -> plant"]
    parts["plant"] = epp.blocks.TransferFunction(**plant)
    loop = epp.Diagram(parts, wires, inputs=["command"], signals={"x": "plant"})
    rows: list[float] = []
    if kind == "discrete time":
        y, w = [2.0, 2.0], [0.0, 0.0]
        for _ in range(400):
            w.append(-size * np.sign(y[-1]) * (abs(y[-1]) > size))
            y.append(y[-1] - 0.25 * y[-2] + 1.2 * w[-2])
        rows, fine = y[2:], 1
    else:
        fine, held = 8, 0.0
        small = expm(0.5 / 8 * np.array([[0.0, 1.0, 0.0], [-1.0, -2.0, 20.0], [0.0, 0.0, 0.0]]))
        state = np.array([2.0, 0.0, 0.0])
        for k in range(400 * fine):
            if k % fine == 0:
                held = -size * np.sign(state[0]) * (abs(state[0]) > size)
            state[2] = held
            rows.append(float(state[0]))
            state = small @ state
    x = np.array(rows[300 * fine :])
    x += 0.01 * np.std(x) * np.random.default_rng(3).normal(size=x.size)
    return loop, {"time": 0.5 / fine * np.arange(x.size), "x": x}


@pytest.mark.parametrize("kind", KINDS)
def test_a_relay_is_named_with_its_size(kind: str) -> None:
    loop, record = switched(kind, 0.7)
    found = epp.diagnose(loop, record, steps=60_000)
    assert found.names == ("valve",), str(found)
    assert found[0].fields["level"][0] == pytest.approx(0.7, rel=0.01)
    assert found[0].fields["threshold"][0] == pytest.approx(0.7, rel=0.01)


@pytest.mark.slow
def test_a_disturbance_of_a_loop_with_two_rates_and_a_computation_delay_has_its_amplitude() -> None:
    """What the sampled loop makes of a sine is exact over one turn of both clocks, so that its size is, too."""
    loop = epp.Diagram(
        {
            "lead": epp.blocks.TransferFunction(num=[1.5, -1.2], den=[1.0, -0.4], sample_time=0.1),
            "pi": epp.blocks.TransferFunction(
                num=[1.0, -0.97], den=[1.0, -1.0], sample_time=0.2, computation_delay=0.05
            ),
            "limit": epp.Saturation(-50.0, 50.0),
            "motor": epp.blocks.TransferFunction(num=[4.0], den=[1.0, 1.0, 0.0]),
        },
        ["command - motor -> pi", "pi -> lead", "lead -> limit", "limit + load -> motor"],
        inputs=["command", "load"],
        signals={"x": "motor", "u": "limit"},
    )
    t = 100.0 + 0.01 * np.arange(6000)
    run = epp.simulate(loop, {"load": epp.inputs.Sine(0.7, 0.31)}, t_end=160.0, t_eval=t)
    found = epp.diagnose(loop, {"time": t, "x": run.signals["x"], "u": run.signals["u"]}, steps=3_000)
    assert found.names == ("external disturbance",) and found[0].note == "comes in at load", str(found)
    (question,) = found.questions
    amplitude, frequency = (float(part.split("=")[1].rstrip(")")) for part in question.split(", ")[-2:])
    assert amplitude == pytest.approx(0.7, rel=2e-3) and frequency == pytest.approx(0.31, rel=1e-3)
