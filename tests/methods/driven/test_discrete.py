"""Responses of loops in discrete time to a sine, against plain iterations."""

from __future__ import annotations

import numpy as np
import pytest

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


def test_a_curve_of_responses_is_refused_as_for_sampled_controllers() -> None:
    with pytest.raises(epp.EppError, match="does not cover loops in discrete time: use forced_response"):
        epp.frequency_response(loop(), frequencies=(0.5, 2.0), amplitude=1.0)
