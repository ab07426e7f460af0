"""Cycles of loops whose delayed signals move, against scipy by the method of steps, harmonic balance, and long runs."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline

import eppanalysis as epp
from eppanalysis.results import LimitCycle
from tests.shared import mostly_slow

DELAY = 0.3
#: Saturation, dead time, plant, dead zone: small motions die out, beyond an unstable cycle they grow to a stable one.
RING = epp.LureSystem.from_blocks(
    [epp.Saturation(-1.0, 1.0, 5.0), ([3.0], [1.0, 1.0, 0.0]), epp.DeadZone(-0.1, 0.1)], delay=DELAY
)


@cache
def pair() -> tuple[LimitCycle, ...]:
    return tuple(epp.exact_orbit(RING, p).require_converged() for p in epp.predict_limit_cycles(RING))


def push(y: np.ndarray) -> np.ndarray:
    """What the elements make of the plant's output."""
    return np.clip(-5.0 * (y - np.clip(y, -0.1, 0.1)), -1.0, 1.0)


def by_steps(cycle: LimitCycle, larger: float, periods: int) -> np.ndarray:
    """States after each period, shape (periods + 1, 2), of a run from the cycle's past made so much larger."""
    time = np.append(cycle.time, cycle.period)
    wave = cycle.waveform["dead_zone_input"]
    periodic = CubicSpline(time, np.append(wave, wave[0]), bc_type="periodic")
    state = (1.0 + larger) * cycle.state
    wanted = cycle.period * np.arange(1, periods + 1)
    found, reached = [state], 0.0

    def past(t: float) -> float:
        return (1.0 + larger) * float(periodic(t))

    while len(found) <= periods:
        stop = reached + DELAY
        part = solve_ivp(
            lambda t, x, past=past: RING.A @ x + RING.B[:, 0] * push(past(t - DELAY)),
            (reached, stop), state, method="DOP853", rtol=1e-9, atol=1e-11, max_step=0.02, dense_output=True,
        )  # fmt: skip
        found += [part.sol(t) for t in wanted[(wanted > reached) & (wanted <= stop)]]
        state, reached = part.y[:, -1], stop

        def past(t: float, part=part) -> float:
            return float(RING.C[1] @ part.sol(t))

    return np.array(found)


@pytest.mark.parametrize("which", [pytest.param(0, marks=pytest.mark.slow), 1], ids=["unstable", "stable"])
def test_a_run_by_the_method_of_steps_comes_back_to_the_cycle(which: int) -> None:
    cycle = pair()[which]
    begin, end = by_steps(cycle, 0.0, 1)
    assert cycle.stable is bool(which) and cycle.method == "exact orbit" and cycle.error_estimate < 1e-9
    np.testing.assert_allclose(end, begin, rtol=0, atol=1e-6 * np.abs(begin).max())


@pytest.mark.parametrize(
    ("which", "larger"), mostly_slow([(0, 1e-5), (1, 1e-2)], [(0, 1e-5)]), ids=["unstable", "stable"]
)
def test_a_disturbance_grows_by_the_multiplier(which: int, larger: float) -> None:
    cycle = pair()[which]
    away = np.subtract(*(by_steps(cycle, side * larger, 3) for side in (1.0, -1.0)))
    # What shifts the cycle in time stays as it is from period to period.
    first, second = np.diff(away[1:], axis=0)
    np.testing.assert_allclose(second, first * cycle.multipliers[0].real, rtol=0, atol=0.01 * np.abs(second).max())


def test_an_unstable_cycle_is_that_of_harmonic_balance() -> None:
    loop = epp.LureSystem.from_tf(([3.0], [1.0, 1.0, 0.0]), epp.DeadZone(-0.3, 0.3), delay=0.6)
    (guess,) = epp.predict_limit_cycles(loop)
    cycle, balance = epp.exact_orbit(loop, guess), epp.harmonic_balance(loop, guess, order=65)
    assert cycle.stable is False and abs(cycle.multipliers[0]) > 1.0
    assert cycle.period == pytest.approx(balance.period, rel=1e-6)
    assert cycle.peak_to_peak["x"] == pytest.approx(balance.peak_to_peak["x"], rel=1e-5)
    sizes = (np.abs(c.harmonics["x"][:8]) for c in (cycle, balance))
    np.testing.assert_allclose(*sizes, rtol=0, atol=1e-5 * cycle.peak_to_peak["x"])


def test_play_behind_a_dead_time_has_the_cycle_of_a_long_run() -> None:
    loop = epp.LureSystem.from_tf(([5.0], [1.0, 1.0, 0.0]), epp.Play(0.5), delay=0.05, x0=[0.3, 1.0])
    (guess,) = (p for p in epp.predict_limit_cycles(loop) if p.stable)
    cycle, run = epp.exact_orbit(loop, guess), epp.simulate(loop, t_end=150.0).limit_cycle
    assert cycle.stable and len(cycle.events) == 4
    assert cycle.period == pytest.approx(run.period, rel=1e-9)
    for name, size in run.peak_to_peak.items():
        assert cycle.peak_to_peak[name] == pytest.approx(size, rel=1e-9)


def test_dead_time_longer_than_a_period() -> None:
    """Late by a whole period more, a cycle is the same, but not its stability."""
    near = epp.LureSystem.from_tf(([1.0], [1.0, 1.0]), epp.Saturation(slope=4.0), delay=1.0)
    (guess,) = epp.predict_limit_cycles(near)
    cycle = epp.exact_orbit(near, guess)
    far = epp.LureSystem.from_tf(([1.0], [1.0, 1.0]), epp.Saturation(slope=4.0), delay=1.0 + cycle.period)
    again = epp.exact_orbit(far, cycle)
    assert again.period == pytest.approx(cycle.period, rel=1e-9)
