"""Curves on which harmonics are let into a balance: where they lead, and where they come back."""

from __future__ import annotations

import numpy as np
import pytest

import eppanalysis as epp
from eppanalysis.methods.describing.predict import predict_limit_cycles
from eppanalysis.methods.harmonic.balance import harmonic_balance, settled
from eppanalysis.methods.harmonic.loop import Loop, inputs_of
from eppanalysis.methods.harmonic.path import let_in
from eppanalysis.methods.orbits.exact import exact_orbit
from studies import first_order as study


def end_of_curve(system: epp.LureSystem, guess: epp.LimitCycle, order: int) -> tuple[np.ndarray, float] | None:
    """The balance at the end of the curve from a first-order cycle of one element."""
    loop = Loop.of(system, system.v0)
    Z = inputs_of(loop, guess)
    Z = Z * np.exp(1j * np.arange(Z.shape[1]) * (-np.pi / 2 - np.angle(Z[0, 1])))
    found = let_in(loop, Z, guess.omega, 0, order)
    return None if found is None else settled(loop, *found)


@pytest.mark.parametrize("element", [epp.Relay(), epp.Saturation(), epp.RelayDeadZone(threshold=0.2)])
@pytest.mark.parametrize("order", [3, 9, 25])
def test_where_nothing_folds_the_curve_leads_where_newtons_method_does(element, order):
    system = epp.LureSystem.from_tf(([12.0], [1.0, 3.0, 2.0, 0.0]), element)
    guess = max(predict_limit_cycles(system), key=lambda c: c.amplitude("x"))
    Z, omega = end_of_curve(system, guess, order)
    balance = harmonic_balance(system, guess, order)
    assert omega == pytest.approx(balance.omega, rel=1e-9)
    assert np.abs(Z[0]) == pytest.approx(np.abs(balance.harmonics["x"]), rel=1e-7, abs=1e-9 * abs(Z[0, 1]))


def test_a_curve_that_folds_twice_is_followed_to_its_end():
    """The two-mass drive: the balances of order 3 and 5 are a third off, the curve ends at the exact orbit."""
    system = epp.case("two_mass_deadzone").to_system()
    (guess,) = predict_limit_cycles(system)
    Z, omega = end_of_curve(system, guess, 25)
    exact = exact_orbit(system, guess).require_converged()
    assert omega == pytest.approx(exact.omega, rel=1e-4)
    assert 2.0 * abs(Z[0, 1]) == pytest.approx(2.0 * exact.amplitude("twist"), rel=1e-4)


def test_a_curve_that_comes_back_leads_nowhere():
    """A relay whose threshold is passed by a hundredth: harmonics take the cycle away."""
    system, _, _ = study.random_loop("relay with dead zone", 9)
    small, large = sorted(predict_limit_cycles(system), key=lambda c: c.amplitude("x"))
    assert end_of_curve(system, small, 15) is None
    assert end_of_curve(system, large, 15) is not None
