"""The actuator with limits of position and rate: its cycle against another integrator."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import eppanalysis as epp

CASE = "actuator_both_limits"
GAIN, RATE, BANDWIDTH = 4.0, 0.8, 50.0


def error(v):
    return np.clip(-v[0], -1.0, 1.0) - v[3]


def rates(t, v):
    return [v[1], v[2], -2.0 * v[2] - v[1] + GAIN * v[3], np.clip(BANDWIDTH * error(v), -RATE, RATE)]


EDGES = [
    lambda t, v: v[1],
    lambda t, v: v[0] - 1.0,
    lambda t, v: v[0] + 1.0,
    lambda t, v: BANDWIDTH * error(v) - RATE,
    lambda t, v: BANDWIDTH * error(v) + RATE,
]
for edge in EDGES:
    edge.terminal = True


def half_period(limit=60.0):
    """Half the period, and the peak of the plant, once the loop has settled; every kink ends a step."""
    t, v, peaks = 0.0, np.array([6.0, 0.0, 0.0, -1.0]), []
    while t < limit:
        # A little ahead by Euler's rule, past the event at which it begins.
        v, t = v + 1e-9 * np.array(rates(t, v)), t + 1e-9
        run = solve_ivp(rates, (t, t + 30.0), v, events=EDGES, method="DOP853", rtol=1e-11, atol=1e-13)
        t, v = run.t[-1], run.y[:, -1].copy()
        if len(run.t_events[0]):
            peaks.append((t, abs(v[0])))
    return peaks[-1][0] - peaks[-2][0], peaks[-1][1]


def test_cycle_is_that_of_another_integrator():
    half, peak = half_period()
    case = epp.case(CASE)
    run = epp.simulate(case.to_system(), case.input, t_end=case.t_end)
    assert run.limit_cycle is not None
    assert run.limit_cycle.period == pytest.approx(2.0 * half, abs=1e-6)
    assert run.limit_cycle.peak_to_peak["y"] == pytest.approx(2.0 * peak, abs=1e-6)
    actuator = run.signals["servo"]
    assert actuator.min() >= -1.0 - 1e-12 and actuator.max() <= 1.0 + 1e-12
    values = {published.quantity: published.value for published in case.expected.published}
    assert values["omega of the cycle"] == pytest.approx(np.pi / half, abs=1e-6)
    assert values["amplitude of the plant's output"] == pytest.approx(peak, abs=1e-6)
