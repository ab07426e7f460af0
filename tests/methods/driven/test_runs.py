"""Responses known from runs: dead time and sampled controllers, against closed forms and another integrator."""

import numpy as np
import pytest
from scipy.linalg import expm

import eppanalysis as epp
from eppanalysis.errors import EppError
from tests.driven_loops import TURN


def late(element: epp.Nonlinearity, delay: float) -> epp.Diagram:
    """x' = -x + force - element(x), seen late: where the element is linear, a frequency response."""
    return epp.Diagram(
        parts={
            "spring": element,
            "late": epp.blocks.DeadTime(delay=delay),
            "lag": epp.blocks.TransferFunction(num=[1.0], den=[1.0, 1.0]),
        },
        connect=["force - late -> lag", "lag -> spring", "spring -> late"],
        inputs=["force"],
    )


def test_with_dead_time_the_linear_range_gives_the_frequency_response() -> None:
    delay, omega = 0.3, 2.0
    found = epp.forced_response(late(epp.Saturation(-1.0, 1.0, 0.8), delay), amplitude=0.4, frequency=omega / TURN)
    (one,) = found
    s = 1j * omega
    # Half a millionth of a transient is left: it repeats itself to a millionth.
    assert one.response("lag") == pytest.approx(1.0 / (s + 1.0 + 0.8 * np.exp(-s * delay)), rel=1e-6)
    assert found.motion == "periodic" and found.repeats == 1 and one.stable and np.isnan(one.largest_multiplier)
    assert "from a run alone, for the loop has dead time: after 30 periods" in str(found)
    assert "Other responses were not looked for." in str(found)


def test_a_relay_behind_dead_time_against_its_closed_form() -> None:
    # The relay sees the force alone; what it gives is a square wave, seen late and through a lag of one second.
    system = epp.Diagram(
        parts={
            "relay": epp.Relay(),
            "late": epp.blocks.DeadTime(delay=0.4),
            "lag": epp.blocks.TransferFunction(num=[1.0], den=[1.0, 1.0]),
        },
        connect=["force -> relay", "relay -> late", "late -> lag"],
        inputs=["force"],
    )
    T = 3.0
    (one,) = epp.forced_response(system, amplitude=1.0, frequency=1 / T, most_periods=2)
    w = TURN / T
    assert one.response("lag") == pytest.approx(4 / np.pi * np.exp(-0.4j * w) / (1 + 1j * w), rel=1e-9)
    assert one.cycle.peak_to_peak["lag"] / 2 == pytest.approx(np.tanh(T / 4), rel=1e-9)


def test_a_sampled_gain_is_a_hold() -> None:
    """A gain that is sampled eight times a period: a staircase, whose fundamental is that of samples and a hold."""
    T, n = 2.0, 8
    system = epp.Diagram(
        parts={
            "gain": epp.SampledController([], [], [], [[2.0]], T / n),
            "lag": epp.blocks.TransferFunction(num=[1.0], den=[1.0, 1.0]),
        },
        connect=["force -> gain", "gain -> lag"],
        inputs=["force"],
    )
    found = epp.forced_response(system, amplitude=0.5, frequency=1 / T, most_periods=1)
    (one,) = found
    s = 1j * TURN / T
    hold = (1 - np.exp(-s * T / n)) / (s * T / n)
    assert one.response("lag") == pytest.approx(2.0 * hold / (s + 1.0), rel=1e-12)
    assert "1 found, 1 stable. The run from the loop's own start comes to follow the input." in str(found)
    assert np.abs(one.cycle.multipliers) == pytest.approx([np.exp(-T)], rel=1e-12)


def test_a_sampled_relay_under_a_sine_against_its_map_from_sample_to_sample() -> None:
    """A lag behind a relay that reads it five times a period: patterns of signs, of which one is consistent."""
    T, n, force = 2.0, 5, 6.0
    system = epp.Diagram(
        parts={
            "reader": epp.SampledController([], [], [], [[1.0]], T / n),
            "relay": epp.HysteresisRelay(-0.05, 0.05),
            "lag": epp.blocks.TransferFunction(num=[1.0], den=[1.0, 1.0]),
        },
        connect=["force - relay -> lag", "lag -> reader", "reader -> relay"],
        inputs=["force"],
    )
    (one,) = epp.forced_response(system, amplitude=force, frequency=1 / T, most_periods=1)
    assert one.multiple == 1 and one.cycle.method == "exact orbit" and one.cycle.residual < 1e-13
    w, h = TURN / T, T / n
    steady = force / (1.0 + 1j * w)  # of the sine, exp(i w t) in mind

    def sine(t: float) -> float:
        return float((steady * np.exp(1j * w * t)).imag)

    decay, x, relay = np.exp(-h), 0.0, -1.0
    states = []
    for k in range(60 * n):  # by hand: what the relay gives is held from sample to sample
        reads = x + sine(k * h)
        relay = 1.0 if reads > 0.05 else -1.0 if reads < -0.05 else relay
        states.append(reads)
        x = decay * x - (1.0 - decay) * relay
    at = one.phase / w
    k = round(at / h)
    assert at == pytest.approx(k * h, abs=1e-9)
    assert one.cycle.state[0] == pytest.approx(states[-n:][k % n], rel=1e-10)
    assert np.abs(one.cycle.multipliers) == pytest.approx([np.exp(-T)], rel=1e-10)


def sampled_spring(n: int, omega: float) -> epp.Diagram:
    """x'' + 0.2 x' = sat(force - x) with n samples of the difference in a period."""
    return epp.Diagram(
        parts={
            "reader": epp.SampledController([], [], [], [[1.0]], TURN / omega / n),
            "spring": epp.Saturation(-1.0, 1.0),
            "mass": epp.blocks.TransferFunction(num=[1.0], den=[1.0, 0.2, 0.0]),
        },
        connect=["force - mass -> reader", "reader -> spring", "spring -> mass"],
        inputs=["force"],
    )


def test_all_responses_of_a_sampled_loop_are_found_as_of_its_difference_equation() -> None:
    found = epp.forced_response(sampled_spring(40, 0.88), amplitude=0.29, frequency=0.88 / TURN)
    assert [r.stable for r in found] == [True, False, True]
    # Of the same loop as a difference equation (tests/methods/driven/test_discrete.py).
    assert [r.largest_multiplier for r in found] == pytest.approx([0.6742708807, 1.6271601435, 0.5565221328], rel=1e-9)


def test_a_controller_of_two_inputs_needs_no_describing_function() -> None:
    h, limit = 0.1, epp.Saturation(-10.0, 10.0)
    loop = epp.Diagram(
        parts={
            "control": epp.SampledController([], [], [], [[1.0, 0.3]], h),
            "limit": limit,
            "plant": epp.blocks.TransferFunction(num=[1.0], den=[1.0, 1.0]),
            "sensor": epp.blocks.TransferFunction(num=[1.0], den=[0.1, 1.0]),
        },
        connect=[
            "force - plant -> control.in1",
            "-sensor -> control.in2",
            "control -> limit",
            "limit -> plant",
            "plant -> sensor",
        ],
        inputs=["force"],
    )
    (one,) = epp.forced_response(loop, amplitude=0.5, frequency=1.0)
    # Within the limits the loop is linear: states of plant and sensor, what the controller gives held.
    held = expm(h * np.array([[-1.0, 0.0, 1.0], [10.0, -10.0, 0.0], [0.0, 0.0, 0.0]]))
    closed = held[:2, :2] - held[:2, 2:] @ [[1.0, 0.3]]
    wanted = np.linalg.eigvals(np.linalg.matrix_power(closed, 10))
    assert np.sort(np.abs(one.cycle.multipliers)) == pytest.approx(np.sort(np.abs(wanted)), rel=1e-8, abs=1e-12)


def test_where_samples_never_come_round_with_the_input_a_run_answers() -> None:
    found = epp.forced_response(sampled_spring(40, 0.88), amplitude=0.1, frequency=0.88 / TURN / np.sqrt(2.0))
    assert "from a run alone, for the loop has samples that do not come round with the input" in str(found)
    with pytest.raises(EppError, match="samples that do not come round with the input within 60 periods of it"):
        epp.amplitude_response(sampled_spring(40, 0.88), amplitudes=(0.1, 0.2), frequency=0.88 / TURN / np.sqrt(2.0))


def test_what_does_not_repeat_itself_and_what_cannot_be_followed_is_said() -> None:
    slow = late(epp.Saturation(-1.0, 1.0, 5.0), 1.0)  # oscillates by itself, besides
    found = epp.forced_response(slow, amplitude=0.01, frequency=0.137, most_periods=2)
    assert found.motion == "undecided" and not found.responses and not found.status.ok
    assert "does not repeat itself within 300 periods of the input" in str(found)
    with pytest.raises(EppError, match="has dead time, so there is no exact response to follow"):
        epp.frequency_response(slow, amplitude=1.0, frequencies=(0.1, 1.0))
