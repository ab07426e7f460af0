"""Cycles of loops with a dead time and smooth elements, against scipy by the method of steps."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline

import eppanalysis as epp
from tests.shared import mostly_slow

DELAY = 0.5
Function = Callable[[float], float]
LOOPS: list[tuple[epp.Nonlinearity, Function]] = [
    (epp.Tanh(1.0, 2.0), lambda z: float(np.tanh(2.0 * z))),
    (epp.Cube(1.0), lambda z: z**3),
    (epp.Polynomial([0.0, -1.0, 0.0, 1.0]), lambda z: z**3 - z),
    (epp.Drag(1.0), lambda z: z * abs(z)),
]
NAMES = [type(e).__name__ for e, _ in LOOPS]


def loop_of(element: epp.Nonlinearity) -> epp.LureSystem:
    return epp.LureSystem.from_tf(([3.0], [1.0, 1.0, 1.0]), element, delay=DELAY)


def by_steps(loop: epp.LureSystem, cycle: epp.LimitCycle, f: Function, larger: float, periods: int) -> np.ndarray:
    """States after each period of a run from the cycle's past made so much larger, shape (periods + 1, n)."""
    time, wave = np.append(cycle.time, cycle.period), cycle.waveform["x"]
    periodic = CubicSpline(time, np.append(wave, wave[0]), bc_type="periodic")
    state, reached = (1.0 + larger) * cycle.state, 0.0
    found, wanted = [state], cycle.period * np.arange(1, periods + 1)

    def past(t: float) -> float:
        return (1.0 + larger) * float(periodic(t))

    while len(found) <= periods:
        part = solve_ivp(
            lambda t, x, past=past: loop.A @ x + loop.B[:, 0] * f(past(t - DELAY)),
            (reached, reached + DELAY), state, method="DOP853", rtol=1e-11, atol=1e-13, dense_output=True,
        )  # fmt: skip
        found += [part.sol(t) for t in wanted[(wanted > reached) & (wanted <= reached + DELAY)]]
        state, reached = part.y[:, -1], reached + DELAY

        def past(t: float, part=part) -> float:
            return float(loop.C[0] @ part.sol(t))

    return np.array(found)


@pytest.mark.parametrize(("element", "f"), mostly_slow(LOOPS, LOOPS[:2]), ids=NAMES)
def test_a_run_by_the_method_of_steps_comes_back_to_the_cycle_and_departs_by_its_multiplier(
    element: epp.Nonlinearity, f: Function
) -> None:
    loop = loop_of(element)
    for predicted in epp.predict_limit_cycles(loop):
        cycle = epp.exact_orbit(loop, predicted).require_converged()
        assert cycle.residual < 1e-6 and cycle.error_estimate < 1e-9 and cycle.stable is predicted.stable
        begin, end = by_steps(loop, cycle, f, 0.0, 1)
        np.testing.assert_allclose(end, begin, rtol=0, atol=1e-8 * np.abs(begin).max())
        assert cycle.multipliers is not None
        larger = 1e-7 if not cycle.stable else 1e-4
        away = np.subtract(*(by_steps(loop, cycle, f, side * larger, 3) for side in (1.0, -1.0)))
        # What shifts the cycle in time stays as it is from period to period.
        first, second = np.diff(away[1:], axis=0)
        np.testing.assert_allclose(second, first * cycle.multipliers[0].real, rtol=0, atol=2e-3 * np.abs(second).max())


@pytest.mark.slow
@pytest.mark.parametrize("element", [epp.Tanh(1.0, 2.0), epp.Drag(1.0)], ids=["Tanh", "Drag"])
def test_a_search_lists_them_whatever_the_unit_of_time_and_the_sign(element: epp.Nonlinearity) -> None:
    loop = loop_of(element)
    found = epp.find_limit_cycles(loop)
    assert found.status.ok and len(found) == len(epp.predict_limit_cycles(loop))
    for cycle in found:
        assert cycle.method == "exact orbit"
    slow = epp.LureSystem.from_tf(([3e-6], [1.0, 1e-3, 1e-6]), element, delay=1e3 * DELAY)
    turned = epp.LureSystem.from_tf(([-3.0], [1.0, 1.0, 1.0]), element, delay=DELAY, feedback=1)
    for other, unit in ((slow, 1e-3), (turned, 1.0)):
        again = epp.find_limit_cycles(other)
        assert [c.stable for c in again] == [c.stable for c in found]
        for one, two in zip(found, again, strict=True):
            assert two.frequency == pytest.approx(unit * one.frequency, rel=1e-9)
            assert two.peak_to_peak["x"] == pytest.approx(one.peak_to_peak["x"], rel=1e-8)
            assert two.multipliers is not None and one.multipliers is not None
            assert abs(two.multipliers[0]) == pytest.approx(abs(one.multipliers[0]), rel=1e-6)


def test_what_jumps_beside_a_smooth_element_is_balanced_and_said_not_to_be_closed() -> None:
    loop = epp.LureSystem.from_blocks(
        [epp.Relay(-1.0, 1.0), ([3.0], [1.0, 1.0, 1.0]), epp.Tanh(1.0, 2.0), ([1.0], [1.0, 1.0])], delay=DELAY
    )
    loop = replace(loop, signals=replace(loop.signals, units=("rad", "", "", "")))
    predicted = max(epp.predict_limit_cycles(loop), key=lambda c: c.period)
    cycle = epp.exact_orbit(loop, predicted)
    assert not cycle.status.ok and "harmonic balance, order" in cycle.note and "not closed" in cycle.note
    degrees = re.search(r"relay input (.*) deg peak to peak", cycle.note)
    assert degrees and float(degrees[1]) == pytest.approx(math.degrees(predicted.peak_to_peak["relay_input"]), rel=0.3)


def test_an_element_whose_gain_grows_without_bound_leaves_out_modes_faster_than_the_dead_time() -> None:
    found = epp.predict_limit_cycles(loop_of(epp.Cube(1.0)))
    assert len(found) == 1 and "were left out" in found.search
