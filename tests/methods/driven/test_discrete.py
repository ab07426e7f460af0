"""Responses of loops in discrete time to a sine, against plain iterations."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import expm

import eppanalysis as epp

#: Sample time [s], pole, limit of the actuator, and gain in front of it.
T, POLE, LIMIT, GAIN = 0.1, 0.5, 0.3, 0.8


def loop() -> epp.LureSystem:
    """x[k+1] = x[k] / 2 + sat(-0.8 x) + u[k]."""
    limit = epp.Saturation(-LIMIT, LIMIT, GAIN)
    return epp.LureSystem.build(
        [[POLE]], [[1.0]], [[-1.0]], [limit], B_input=[[1.0]], input_names=("u",), time_step=T, x0=[0.2]
    )


@pytest.mark.parametrize(("amplitude", "frequency"), [(1.0, 1.0), (0.3, 0.5), (2.0, 2.0)])
def test_response_is_that_of_the_difference_equation(amplitude: float, frequency: float) -> None:
    n = round(1.0 / (frequency * T))
    x, seen, inside = 0.2, [], []
    for k in range(60 * n):
        seen.append(x)
        inside.append(abs(GAIN * x) < LIMIT)
        u = amplitude * np.sin(2 * np.pi * frequency * k * T)
        x = POLE * x + np.clip(-GAIN * x, -LIMIT, LIMIT) + u
    last = np.array(seen[-n:])
    (response,) = epp.forced_response(loop(), amplitude=amplitude, frequency=frequency)
    cycle = response.cycle
    assert cycle.period == pytest.approx(1.0 / frequency) and cycle.time.size == n
    # A cycle begins where its state is greatest.
    first = int(np.argmax(last))
    np.testing.assert_allclose(cycle.waveform["saturation_input"], -np.roll(last, -first), atol=1e-12)
    fundamental = 2.0 * np.abs(np.fft.rfft(last))[1] / n
    assert abs(cycle.harmonics["saturation_input"][1]) == pytest.approx(fundamental * (0.5 if n == 2 else 1.0))
    wanted = np.prod(np.where(inside[-n:], POLE - GAIN, POLE))
    assert cycle.multipliers[0] == pytest.approx(wanted, rel=1e-9, abs=1e-14)


#: Of a mass on a spring with a limit, moved by steps: frequency [rad/s], samples in a period, sample time [s].
OMEGA, SAMPLES = 0.88, 40
STEP = 2.0 * np.pi / OMEGA / SAMPLES
HELD = expm(STEP * np.array([[0.0, 1.0, 0.0], [0.0, -0.2, 1.0], [0.0, 0.0, 0.0]]))
A, B = HELD[:2, :2], HELD[:2, 2:]


def mass() -> epp.LureSystem:
    """x'' + 0.2 x' = sat(u - x), its right side held from sample to sample."""
    spring = epp.Saturation(-1.0, 1.0)
    return epp.LureSystem.build(
        A, B, [[-1.0, 0.0]], [spring], D_input=[[1.0]], input_names=("u",), time_step=STEP, x0=[0.0, 0.0]
    )


def swept(amplitudes: list[float], x: np.ndarray, periods: int = 300) -> list[float]:
    """Peak to peak of the position after plain iterations at amplitudes, each begun where the last one ended."""
    sizes = []
    for amplitude in amplitudes:
        seen = []
        for k in range(periods * SAMPLES):
            seen.append(x[0])
            x = A @ x + B[:, 0] * np.clip(amplitude * np.sin(2.0 * np.pi * k / SAMPLES) - x[0], -1.0, 1.0)
        sizes.append(float(np.ptp(seen[-SAMPLES:])))
    return sizes


def linear(amplitude: float) -> np.ndarray:
    """Where the response begins that stays within the limits: the closed form of a linear difference equation."""
    z = np.exp(2j * np.pi / SAMPLES)
    return np.linalg.solve(z * np.eye(2) - A + B @ [[1.0, 0.0]], B[:, 0] * amplitude).imag


def test_all_three_responses_of_a_loop_that_jumps_are_found() -> None:
    small, between, large = epp.forced_response(mass(), amplitude=0.29, frequency=OMEGA / (2.0 * np.pi))
    assert (small.stable, between.stable, large.stable) == (True, False, True)
    inner = np.linalg.eigvals(A - B @ [[1.0, 0.0]])
    assert small.largest_multiplier == pytest.approx(np.abs(inner).max() ** SAMPLES, rel=1e-9)
    assert small.response("saturation_output") == pytest.approx(small.response("saturation_input"), rel=1e-12)
    assert all(r.cycle.residual < 1e-13 for r in (small, between, large))
    # Just beside the unstable one runs part.
    outputs = between.cycle.waveform["saturation_output"]
    assert np.ptp(outputs) == 2.0 and small.cycle.peak_to_peak["saturation_input"] < 2.0


@pytest.mark.slow
@pytest.mark.parametrize("amplitudes", [(0.29, 0.33), (0.25, 0.4)])
def test_over_the_amplitude_the_responses_jump_where_a_plain_iteration_does(amplitudes: tuple[float, float]) -> None:
    """The branch turns at a corner, where a sample meets the limit: no multiplier passes 1 there."""
    found = epp.amplitude_response(mass(), frequency=OMEGA / (2.0 * np.pi), amplitudes=amplitudes)
    (fold,) = found.folds
    assert found.status.ok and fold.amplitude == pytest.approx(0.30732993968, rel=1e-9)
    beside = [(1.0 + away) * fold.amplitude for away in (-1e-3, -1e-4, -1e-5, 1e-4)]
    *below, above = swept(beside, linear(0.29))
    assert max(below) < 2.6 < 2.9 < above


def test_over_the_frequency_samples_do_not_come_round_with_the_input() -> None:
    with pytest.raises(epp.EppError, match="at single frequencies only; use amplitude_response"):
        epp.frequency_response(loop(), frequencies=(0.5, 2.0), amplitude=1.0)
