"""Motions of sampled loops that are not locked to the samples, beside plain iterations of the difference equation."""

from __future__ import annotations

import control
import numpy as np
import pytest

import eppanalysis as epp
from eppanalysis.results import Status

S = control.tf("s")
GAP = 0.00175


def servo(step: float) -> epp.LureSystem:
    """Play behind a motor under PI control: a double pole at z = 1."""
    plant = control.ss((40 + 100 / S) * 1.25 / (S * (0.1 * S + 3.125)))
    return epp.LureSystem.from_tf(control.sample_system(plant, step), epp.Play(GAP))


def turns(loop: epp.LureSystem, state: np.ndarray, held: float, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Lengths of turns [samples] of the play's input from a state on, and all its values, sample by sample."""
    A, b, c = loop.A, loop.B[:, 0], loop.C[0]
    x, rises, seen = state, [], []
    while len(rises) <= count:
        z = float(c @ x)
        held = min(max(held, z - GAP / 2), z + GAP / 2)
        x = A @ x + b * held
        if seen and seen[-1] < 0 <= z:
            rises.append(len(seen) - z / (z - seen[-1]))
        seen.append(z)
    return np.diff(rises), np.array(seen)


@pytest.mark.parametrize("step", [0.002, pytest.param(0.01, marks=pytest.mark.slow)])
def test_motion_of_a_sampled_servo_is_listed_beside_rest(step):
    """Started from the case it settles; there is a motion of about 1.57 s, which no number of samples closes."""
    loop = servo(step)
    found = epp.find_limit_cycles(loop)
    assert found.settles and not found.diverges
    (motion,) = found.stable
    assert motion.method == "simulation" and motion.note.startswith("not locked to the samples")
    lengths, seen = turns(loop, motion.state, motion.memory[0], 30)
    tail = seen[-round(8 * lengths.mean()) :]
    assert motion.period / step == pytest.approx(lengths.mean(), rel=1e-4)
    assert np.ptp(lengths) <= 2 * motion.error_estimate * lengths.mean()
    assert motion.peak_to_peak["x"] == pytest.approx(np.ptp(tail), rel=1e-3)
    assert abs(motion.harmonics["x"][1]) == pytest.approx(epp.predict_limit_cycles(loop)[0].amplitude("x"), rel=0.2)


@pytest.mark.slow
def test_at_1_khz_it_is_the_only_one_and_short_samples_lead_to_the_cycle_of_continuous_time():
    """Starts of the search are millions of times as large as the motion: what hardly moves is no orbit for that."""
    periods = []
    for step in (0.002, 0.001):
        found = epp.find_limit_cycles(servo(step))
        assert found.status is Status.CONVERGED and found.settles
        (motion,) = found
        periods.append(motion.period)
    assert periods[1] / 0.001 == pytest.approx(1565.683, abs=0.01)
    # The exact orbit of the loop in continuous time has 1.576642 s; a hold changes it in proportion, at first.
    assert 2 * periods[1] - periods[0] == pytest.approx(1.576642, rel=2e-4)


@pytest.mark.slow
def test_a_run_that_still_grows_is_no_motion():
    """A spiral whose turns grow by a thousandth each, of which a saturation takes nothing off yet."""
    angle, growth = 2 * np.pi / 40.3, 1.001 ** (1 / 40.3)
    turn = growth * np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    loop = epp.LureSystem.build(
        turn, [[0.0], [0.0]], [[1.0, 0.0]], [epp.Saturation(-1e9, 1e9)], x0=[1.0, 0.0], time_step=1.0
    )
    found = epp.find_limit_cycles(loop, predicted=[])
    assert not len(found) and found.status is Status.UNDECIDED
