"""Onset points against scalar transfer functions written out, the boundary as published, and what the jump is."""

import json

import numpy as np
import pytest

import eppanalysis as epp
from eppanalysis.methods.margins.olop import boundary_at
from tests.shared import said_above

PLANT = ([4.0], [1.0, 1.0, 0.0])


def plant(omega):
    s = 1j * omega
    return 4.0 / (s * (s + 1.0))


def test_onset_without_an_input_is_where_the_limiter_s_input_reaches_its_rate():
    point = epp.olop(epp.LureSystem.from_tf(PLANT, epp.RateLimiter(rate=1.0)), amplitude=0.5)
    L = plant(point.omega)
    assert 0.5 * point.omega / abs(1.0 + L) == pytest.approx(1.0, rel=1e-12)
    assert point.gain == pytest.approx(abs(L), rel=1e-12)
    assert point.phase == pytest.approx(np.angle(L), rel=1e-12)
    slower = np.linspace(1e-3, point.omega, 2000, endpoint=False)
    assert np.all(0.5 * slower / np.abs(1.0 + plant(slower)) < 1.0)


def test_onset_from_a_stick_through_a_diagram():
    parts = {
        "gain": epp.blocks.Gain(gain=3.0),
        "actuator": epp.RateLimitedServo(bandwidth=20.0, rate=0.4),
        "plant": epp.blocks.TransferFunction(num=[1.0], den=[1.0, 1.0, 0.0]),
    }
    wires = ["stick - plant -> gain", "gain -> actuator", "actuator -> plant"]
    system = epp.Diagram(parts=parts, connect=wires, inputs=["stick"]).to_system()
    point = epp.olop(system, amplitude=0.1)
    s = 1j * point.omega
    L = 3.0 * 20.0 / (s + 20.0) / (s * (s + 1.0))
    moved = 0.1 * 3.0 * 20.0 / (s + 20.0) / (1.0 + L)
    assert point.omega * abs(moved) == pytest.approx(0.4, rel=1e-12)
    assert point.gain == pytest.approx(abs(L), rel=1e-10)
    assert epp.olop(system, amplitude=0.1, input="stick", element="actuator").omega == point.omega


def test_a_servo_without_an_input_has_its_lag():
    point = epp.olop(epp.LureSystem.from_tf(PLANT, epp.RateLimitedServo(bandwidth=20.0, rate=1.0)), amplitude=0.5)
    lag = 20.0 / (1j * point.omega + 20.0)
    assert 0.5 * point.omega * abs(lag / (1.0 + plant(point.omega) * lag)) == pytest.approx(1.0, rel=1e-12)


@pytest.mark.parametrize(
    ("degrees", "decibels"),
    [(-60, 13.5), (-90, 7.5), (-100, 5.5), (-120, 2.5), (-140, 1.1), (-160, 0.0), (-180, 0.0), (-110, 4.0)],
)
def test_boundary_is_the_published_one(degrees, decibels):
    assert 20.0 * np.log10(boundary_at(np.deg2rad(degrees))) == pytest.approx(decibels, abs=1e-9)


def test_outside_the_boundary_nothing_is_said():
    # A lag with gain 0.5 has little phase where a large sine at once reaches a low rate.
    point = epp.olop(epp.LureSystem.from_tf(([0.5], [1.0, 1.0]), epp.RateLimiter(rate=0.01)), amplitude=1.0)
    assert point.phase > np.deg2rad(-60.0)
    assert point.prone is None
    assert point.status is epp.Status.INCOMPLETE
    assert "covers only -180 to -60 deg" in str(point)


def test_an_amplitude_that_reaches_no_limit():
    system = epp.LureSystem.from_tf(([1.0], [1.0, 1.0, 0.0]), epp.RateLimitedServo(bandwidth=20.0, rate=100.0))
    point = epp.olop(system, amplitude=0.01)
    assert np.isnan(point.omega)
    assert point.prone is False
    assert point.margin == np.inf
    assert "not reached" in str(point)
    assert point.plot().figure.axes


def test_an_unstable_loop_gets_no_verdict():
    system = epp.LureSystem.from_tf(([40.0], [1.0, 3.0, 2.0, 0.0]), epp.RateLimiter(rate=1.0))
    assert epp.olop(system, amplitude=0.1).prone is None


def responses(gain, omega, size):
    """Amplitudes before the limiter with which first order balances a sine of this size at the reference."""
    a = np.geomspace(1e-3, 1e3, 40001)
    limiter = epp.RateLimiter(rate=1.0)
    _, N = limiter.describing_function(a, 0.0, omega)
    excess = a * np.abs(1.0 + N * gain * plant(omega) / 4.0) - size
    return np.count_nonzero(np.diff(np.sign(excess)))


@pytest.mark.parametrize(("gain", "prone"), [(4.0, True), (0.3, False)])
def test_prone_loops_have_two_answers_to_one_sine(gain, prone):
    """The jump itself, from the limiter's describing function: several amplitudes near the onset, or one."""
    point = epp.olop(epp.LureSystem.from_tf(([gain], [1.0, 1.0, 0.0]), epp.RateLimiter(rate=1.0)), amplitude=0.5)
    assert point.prone is prone
    answers = max(responses(gain, w, 0.5) for w in point.omega * np.linspace(0.8, 1.2, 41))
    assert bool(answers > 1) is prone


def test_a_limit_that_is_reached_however_slow_the_sine_is():
    """A command that is integrated before the limiter, outside the loop, with a rate beyond the limit."""
    parts = {
        "ramp": epp.blocks.Integrator(),
        "actuator": epp.RateLimiter(rate=0.4),
        "lag": epp.blocks.TransferFunction(num=[0.5], den=[1.0, 1.0]),
    }
    wires = ["stick -> ramp", "ramp - lag -> actuator", "actuator -> lag"]
    system = epp.Diagram(parts=parts, connect=wires, inputs=["stick"]).to_system()
    assert epp.olop(system, amplitude=1.0).prone is None
    assert "at any frequency" in epp.olop(system, amplitude=1.0).message


def test_refuses():
    system = epp.LureSystem.from_tf(PLANT, epp.RateLimiter(rate=1.0))
    for wrong, said in (
        ({"amplitude": 0.0}, "positive"),
        ({"amplitude": 1.0, "input": "stick"}, "no input"),
        ({"amplitude": 1.0, "element": "servo"}, "expected"),
    ):
        with pytest.raises(epp.EppError, match=said):
            epp.olop(system, **wrong)
    with pytest.raises(epp.ModelError, match="no rate limiter"):
        epp.olop(epp.LureSystem.from_tf(PLANT, epp.Relay()), amplitude=1.0)


def test_result_is_plain_data_and_has_a_picture():
    point = epp.olop(epp.LureSystem.from_tf(PLANT, epp.RateLimiter(rate=1.0)), amplitude=0.5)
    assert json.loads(json.dumps(point.to_dict()))["prone"] is True
    assert point.margin == pytest.approx(point.boundary / point.gain)
    axes = point.plot().figure.axes[0]
    assert axes.get_xlabel() == "phase of the open loop [deg]"
    assert said_above(axes.figure)[0].startswith("Prone to jump")
