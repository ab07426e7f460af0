"""The unstable response between two stable ones; each is held against an independent integrator over one period."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import eppanalysis as epp
from tests.driven_loops import TURN, duffing, saturated

#: Damping of the mass on a cubic spring, and the force on it.
DAMPING, FORCE = 0.1, 0.3


def _saturated_spring(omega: float, force: float = 0.35) -> Callable[[float, np.ndarray], list[float]]:
    return lambda t, y: [y[1], np.clip(force * np.sin(omega * t) - y[0], -1.0, 1.0) - 0.2 * y[1]]


def _cubic_spring(omega: float) -> Callable[[float, np.ndarray], list[float]]:
    return lambda t, y: [y[1], FORCE * np.sin(omega * t) - DAMPING * y[1] - y[0] - y[0] ** 3]


def _over(rates: Callable[[float, np.ndarray], list[float]], omega: float, start: np.ndarray) -> np.ndarray:
    T = TURN / omega
    return solve_ivp(rates, (0.0, T), start, "DOP853", rtol=1e-11, atol=1e-13, max_step=T / 200).y[:, -1]


def _position_and_speed(system: epp.LureSystem, response: epp.PeriodicResponse) -> np.ndarray:
    """The mass where the sine has phase zero: the force acts on the rate of its speed alone."""
    assert response.phase == pytest.approx(0.0, abs=1e-9)
    row = system.signals.C[system.signals.names.index("mass")]
    return np.array([row @ response.cycle.state, row @ system.A @ response.cycle.state])


@pytest.mark.slow
@pytest.mark.parametrize(
    ("system", "amplitude", "rates", "omegas"),
    [
        (saturated, 0.35, _saturated_spring, (0.868, 0.872, 0.876, 0.877, 0.879, 0.88, 0.881, 0.882, 0.883, 0.884)),
        pytest.param(
            lambda: duffing(1.0, DAMPING, 1.0),
            FORCE,
            _cubic_spring,
            (1.34, 1.42, 1.5, 1.54, 1.62, 1.66, 1.7, 1.74),
            marks=pytest.mark.slow,
        ),
    ],
    ids=["saturated spring", "cubic spring"],
)
def test_between_two_folds_there_are_three_responses(system, amplitude, rates, omegas):
    loop = system()
    for omega in omegas:
        found = epp.forced_response(loop, amplitude=amplitude, frequency=omega / TURN, most_periods=1)
        assert [r.stable for r in found] == [True, False, True]
        assert "was not found" not in found.message
        for response in found:
            start = _position_and_speed(loop, response)
            assert _over(rates(omega), omega, start) == pytest.approx(start, abs=1e-6)


def test_responses_are_found_between_the_folds_of_first_order_and_their_own():
    # First order folds at 0.6098 and has one response here; the exact fold is at 0.61206 (amplitude_response).
    loop, omega, force = saturated(), 0.8, 0.6114
    found = epp.forced_response(loop, amplitude=force, frequency=omega / TURN, most_periods=1)
    assert found.first_order["mass"].size == 1
    assert [r.stable for r in found] == [True, False, True]
    for response in found:
        start = _position_and_speed(loop, response)
        end = _over(
            lambda t, y: [y[1], np.clip(force * np.sin(omega * t) - y[0], -1.0, 1.0) - 0.2 * y[1]], omega, start
        )
        assert end == pytest.approx(start, abs=1e-6)


@pytest.mark.parametrize("begin", [1.0, 2.0, 5.0])
def test_where_the_loop_begins_hides_no_response(begin):
    # The mass alone is an integrator: nothing but the spring, which swings, says where it is in the mean.
    parts = {
        "spring": epp.PiecewiseLinear(breakpoints=[-1.0, 1.0], slopes=[4.0, 1.0, 4.0], intercepts=[3.0, 0.0, -3.0]),
        "mass": epp.blocks.TransferFunction(num=[1.0], den=[1.0, 0.14, 0.0]),
    }
    loop = epp.Diagram(parts, ["force - mass -> spring", "spring -> mass"], inputs=["force"]).to_system()
    row = loop.signals.C[loop.signals.names.index("mass")]
    loop = replace(loop, x0=begin * row / (row @ row))
    found = epp.forced_response(loop, amplitude=0.36, frequency=1.32 / TURN, most_periods=1)
    assert [r.stable for r in found] == [True, False, True]
    # The smallest stays within the middle slope, where all is linear: s^2 + 0.14 s + 1 with s = j omega.
    s = 1.32j
    linear = 2.0 * 0.36 / abs(s * s + 0.14 * s + 1.0)
    assert found[0].cycle.peak_to_peak["mass"] == pytest.approx(linear, rel=1e-9)


def test_where_one_between_is_not_found_it_is_said(monkeypatch):
    monkeypatch.setattr("eppanalysis.methods.driven.forced.Search.from_between", lambda search: None)
    found = epp.forced_response(saturated(), amplitude=0.35, frequency=0.877 / TURN)
    assert [r.stable for r in found] == [True, True]
    assert "At least one more response of one period exists" in found.message


@pytest.mark.slow
@pytest.mark.xfail(strict=True, reason="first order does not come near the pair of responses beside a fold")
@pytest.mark.parametrize("share", [0.001, 0.01])
def test_beside_a_fold_there_are_three_responses(share: float) -> None:
    spring = epp.PiecewiseLinear([-1.0, 1.0], [8.0, 1.0, 8.0], [7.0, 0.0, -7.0])
    loop = epp.LureSystem.build(
        [[0.0, 1.0], [0.0, -0.08]], [[0.0], [1.0]], [[-1.0, 0.0]], [spring],
        input_names=["place"], B_input=np.zeros((2, 1)), D_input=[[1.0]],
    )  # fmt: skip
    frequency = 1.085 / TURN
    low, high = sorted(
        f.amplitude for f in epp.amplitude_response(loop, frequency=frequency, amplitudes=(0.03, 0.8)).folds
    )
    found = epp.forced_response(loop, amplitude=low * (high / low) ** share, frequency=frequency)
    assert [r.stable for r in found] == [True, False, True]
