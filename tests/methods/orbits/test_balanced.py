"""Orbits that no run follows, closed from the switches of a balance."""

import numpy as np
import pytest
from scipy.linalg import expm

import eppanalysis as epp

#: Six lags alike, with a zero: pulses of a relay with dead zone that only just pass its threshold.
POLE = 4.5
A = np.diag(np.full(5, POLE), -1)
A[0] = [-4.5, -3.12, -1.62, -0.394, -0.0296, 0.0]
B = np.array([POLE, 0, 0, 0, 0, 0])
C = np.array([0, 0, 0, 0, -0.0108, -0.00587])


def missed(period: float, pulse: float) -> tuple[float, float]:
    """What the input lacks of the threshold where the pulse begins and ends, by exponentials of half a period alone."""
    wide = np.zeros((7, 7))
    wide[:6, :6], wide[:6, 6] = A, B
    on, off = expm(wide * pulse), expm(A * (period / 2 - pulse))
    start = -np.linalg.solve(np.eye(6) + off @ on[:6, :6], off @ on[:6, 6])
    return float(C @ start - 1), float(C @ (on[:6, :6] @ start + on[:6, 6]) - 1)


def test_a_cycle_that_runs_leave_at_once_is_closed_from_its_balance():
    loop = epp.LureSystem.build(A, B[:, None], C[None], [epp.RelayDeadZone(threshold=1.0)])
    guess = next(c for c in epp.predict_limit_cycles(loop) if not c.stable)
    cycle = epp.exact_orbit(loop, guess)
    assert cycle.status is epp.Status.CONVERGED and abs(cycle.multipliers[0]) > 100
    up, down = (event.time for event in list(cycle.events) if "through breakpoint 2" in event.name)
    assert missed(cycle.period, (down - up) % cycle.period) == pytest.approx((0, 0), abs=1e-9)
    assert not epp.find_limit_cycles(loop).unclosed
