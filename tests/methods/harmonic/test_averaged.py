"""Harmonic balance with sampled controllers, against the closed form of a relay and the exact locked cycles."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import brentq

import eppanalysis as epp
from tests.methods.orbits.samples.test_locked import T, fixed_points, sampled_relay


def omega_of_a_relay(order: int, delay: float) -> float:
    """Where the harmonics of a square wave behind hold, delay and 1/(s+1)^3 add up to the threshold at a switch."""

    def short(omega: float) -> float:
        k = np.arange(1, order + 1, 2)
        s = 1j * k * omega
        held = (1.0 - np.exp(-s * T)) / (s * T) * np.exp(-s * delay)
        return float(np.sum(4.0 / (np.pi * k) * np.imag(-held / (s + 1.0) ** 3))) - 0.1

    return float(brentq(short, 0.5, 2.0, xtol=1e-14))


@pytest.mark.parametrize("order", [1, 5, 25])
@pytest.mark.parametrize("delay", [0.0, 0.03])
def test_harmonics_pass_hold_and_delay(order, delay) -> None:
    loop = sampled_relay(delay)
    balance = epp.harmonic_balance(loop, epp.predict_limit_cycles(loop)[0], order=order)
    assert balance.status.ok and "aliasing" in balance.note
    assert balance.omega == pytest.approx(omega_of_a_relay(order, delay), rel=1e-10)


def test_the_balance_lies_between_the_locked_cycles_within_its_own_error() -> None:
    loop = sampled_relay()
    balance = epp.harmonic_balance(loop, epp.predict_limit_cycles(loop)[0])
    turns = [n for n, _ in fixed_points(40)]
    assert min(turns) < balance.period / T < max(turns)
    assert max(abs(balance.period / (n * T) - 1.0) for n in turns) < balance.error_estimate < 0.1
    orbit = epp.exact_orbit(loop, balance)
    assert orbit.status.ok and round(orbit.period / T, 9) in turns


def test_a_balance_that_first_order_is_far_from_is_where_a_run_goes_round() -> None:
    # A PI servo with play at 1 kHz: first order is 16 % too fast; the cycle is not locked to the samples.
    servo = epp.Diagram(
        parts={
            "law": epp.blocks.PI(kp=40.0, ti=0.4, sample_time=1e-3),
            "plant": epp.blocks.TransferFunction(num=[1.25], den=[0.1, 3.125, 0.0]),
            "play": epp.Play(gap=0.0035),
        },
        connect=["-play -> law", "law -> plant", "plant -> play"],
    ).to_system()
    predicted = epp.predict_limit_cycles(servo)[0]
    balance = epp.harmonic_balance(servo, predicted)
    run = epp.simulate(replace(servo, x0=balance.state, memory=balance.memory), t_end=30.0, t_eval=[0.0])
    assert run.limit_cycle is not None
    assert abs(predicted.period / run.limit_cycle.period - 1.0) > 0.15
    assert abs(balance.period / run.limit_cycle.period - 1.0) < balance.error_estimate < 2e-3
