"""A dither between the samples of a controller, against matrix exponentials in small steps; none in discrete time."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import expm

import eppanalysis as epp

T, FREQUENCY, SMALL = 0.5, 50.0, 5e-4


def loop() -> epp.Diagram:
    """Two lags under a relay with dead zone, whose gain is executed twice a second."""
    return epp.Diagram(
        {
            "controller": epp.blocks.Gain(gain=1.0, sample_time=T),
            "valve": epp.RelayDeadZone(threshold=1.0, level=1.0),
            "plant": epp.blocks.TransferFunction(num=[20.0], den=[1.0, 2.0, 1.0]),
        },
        ["command - plant -> controller", "controller -> valve", "valve -> plant"],
        inputs=["command"],
        signals={"x": "plant"},
    )


def left(amplitude: float) -> float:
    """Swing of the samples in the end, begun beyond the cycle, with the relay held over steps of half a millisecond."""
    small = expm(SMALL * np.array([[0.0, 1.0, 0.0], [-1.0, -2.0, 20.0], [0.0, 0.0, 0.0]]))
    x, held, seen = np.array([6.0, 0.0, 0.0]), 0.0, []
    for k in range(round(100.0 / SMALL)):
        if k % round(T / SMALL) == 0:
            held = -x[0]
            seen.append(x[0])
        u = held + amplitude * np.sin(2.0 * np.pi * FREQUENCY * (k + 0.5) * SMALL)
        x[2] = np.sign(u) * (abs(u) > 1.0)
        x = small @ x
    return float(np.ptp(seen[-40:]))


@pytest.mark.slow
def test_the_least_dither_of_a_sampled_loop_is_between_two_that_are_integrated() -> None:
    found = epp.dither(loop(), frequency=FREQUENCY, tolerance=0.1)
    assert found.element == "valve" and found.status is epp.Status.CONVERGED
    assert found.first_order == pytest.approx(found.amplitude, rel=0.1)
    cycle = left(0.0)
    assert cycle > 1.0 and left(0.97 * found.stays) > 0.2 * cycle
    assert left(1.03 * found.amplitude) < 0.02 * cycle


def test_in_discrete_time_there_is_nothing_to_smooth() -> None:
    step = epp.LureSystem.build([[0.5]], [[1.0]], [[-1.0]], [epp.Relay()], time_step=0.1, name="digital")
    with pytest.raises(epp.EppError, match="dither: digital is in discrete time, and nothing moves between samples"):
        epp.dither(step, frequency=1.0)
