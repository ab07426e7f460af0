"""The error estimate of first order against exact cycles, and what it says of cycles that are none."""

from __future__ import annotations

import pickle
from dataclasses import replace

import numpy as np
import pytest

import eppanalysis as epp
from eppanalysis.methods.describing import error
from eppanalysis.methods.describing.balance import Balance
from eppanalysis.methods.describing.error import BalancedOscillation
from eppanalysis.methods.describing.predict import predict_limit_cycles
from eppanalysis.methods.harmonic.loop import Loop
from eppanalysis.methods.orbits.exact import exact_orbit
from eppanalysis.methods.search.find import find_limit_cycles
from studies import first_order as study
from tests.shared import predicted
from tests.stress.first_order_loops import compare, random_loop

from_tf = epp.LureSystem.from_tf
#: First order invents cycles in 48, 55, 127 and 181.
SAMPLE = (2, 4, 7, 8, 48, 55, 62, 73, 127, 181)


@pytest.mark.slow
def test_random_loops_no_invented_cycle_is_sure_and_real_ones_are_covered():
    """The sample of what ``tests/stress/first_order.py`` does with 300 loops."""
    rows = [row for seed in SAMPLE for row in compare(random_loop(seed))]
    invented, real = [r for r in rows if not r.real], [r for r in rows if r.real]
    assert len(invented) >= 4 and len(real) >= 8
    assert min(r.estimate for r in invented) > 0.5
    assert np.mean([r.estimate >= r.error for r in real]) >= 0.95
    assert np.median([r.estimate / r.error for r in real]) < 1.3


@pytest.mark.parametrize("element", [epp.RelayDeadZone(threshold=1.0), epp.Quantiser(step=2.0, levels=1)])
def test_harmonics_may_lift_a_cycle_over_a_threshold_that_a_sine_just_passes(element):
    """A sine passes the threshold by 1e-4, harmonics are thirty times as much and push the other way; it exists."""
    den = np.polymul([1.0, 0.4, 1.0], [1.0, 0.12, 9.6])
    omega = np.geomspace(0.5, 5.0, 20001)
    half_turn = float(np.interp(np.pi, -np.unwrap(np.angle(1.0 / np.polyval(den, 1j * omega))), omega))
    slope = complex(np.asarray(element.describing_function(1.0 + 1e-4)[1]).ravel()[0])
    loop = from_tf(([abs(np.polyval(den, 1j * half_turn) / slope)], den.tolist()), element)
    guess = _smallest(loop)
    assert guess.amplitude("x") == pytest.approx(1.0 + 1e-4, rel=1e-5)
    error = min(_error(guess, c) for c in find_limit_cycles(loop))
    assert error < guess.error_estimate < 1.3 * error
    assert not guess.may_not_exist


def _error(guess: epp.LimitCycle, exact: epp.LimitCycle) -> float:
    name = next(iter(guess.harmonics))
    pairs = [
        (guess.omega, exact.omega),
        (guess.amplitude(name), exact.amplitude(name)),
        (guess.peak_to_peak[name], exact.peak_to_peak[name]),
    ]
    return max(abs(a / b - 1.0) for a, b in pairs)


def test_both_cycles_of_the_elbow_are_estimated_to_a_tenth():
    """18 and 29 per cent, of which the norm of the harmonics says only that they are large."""
    case = epp.case("fig8a_original")
    guesses = predicted("fig8a_original")
    assert len(guesses) == 2
    for guess in guesses:
        error = _error(guess, exact_orbit(case, guess).require_converged())
        assert 0.15 < error < guess.error_estimate < 1.15 * error


@pytest.mark.parametrize("element", [epp.Saturation, epp.RelayDeadZone, epp.Play])
def test_units_do_not_change_the_estimate(element):
    """Time in other units, and signals too: thresholds times `size`, a relay's level with it."""
    make = {
        epp.Saturation: lambda s: epp.Saturation(-s, s),
        epp.RelayDeadZone: lambda s: epp.RelayDeadZone(threshold=s, level=s),
        epp.Play: lambda s: epp.Play(gap=2.0 * s),
    }[element]

    def estimates(unit: float, scale: float) -> list[float]:
        den = np.array([1.0, 3.0, 2.0, 0.0]) * unit ** np.arange(3, -1, -1)
        return [c.error_estimate for c in predict_limit_cycles(from_tf(([12.0], den.tolist()), make(scale)))]

    wanted = estimates(1.0, 1.0)
    assert wanted
    for time, size in ((1e-6, 1e6), (1e6, 1.0)):
        assert estimates(time, size) == pytest.approx(wanted, rel=1e-4)


@pytest.mark.parametrize("name", ["two_mass_deadzone", "gain_brings_it_back"])
def test_cycles_that_low_orders_do_not_lead_to_are_not_doubted(name):
    """A fold, or a motor that sticks, ends the way over low orders; the cycles are there all the same."""
    for guess in predicted(name):
        error = _error(guess, exact_orbit(epp.case(name), guess).require_converged())
        assert error < guess.error_estimate < 1.5 * error
        assert not guess.may_not_exist


def test_a_small_cycle_just_above_a_threshold_is_told_from_one_that_is_none():
    """Both pass the threshold by less than two hundredths of it; harmonics move one and take the other away."""
    real, invented = (_smallest(study.random_loop("relay with dead zone", number)[0]) for number in (43, 9))
    (stored,) = (r for r in study.read() if r.element == "relay with dead zone" and r.number == 43 and r.ratio < 1.02)
    assert stored.exists and stored.error < real.error_estimate < 1.1 * stored.error
    assert invented.error_estimate == np.inf


def _smallest(system: epp.LureSystem) -> epp.LimitCycle:
    return min(predict_limit_cycles(system), key=lambda c: c.amplitude("x"))


def test_two_predictions_that_lead_to_one_cycle_are_not_both_sure():
    """Play in a servo: harmonics lead both of its predicted cycles to the one that exists."""
    loop = from_tf(([5.0], [1.0, 1.0, 0.0]), epp.Play(gap=2.0))
    exact = find_limit_cycles(loop)
    said = [(c.error_estimate < 0.5, any(_error(c, e) < 0.5 for e in exact)) for c in predict_limit_cycles(loop)]
    assert said == [(False, False), (True, True)]


def test_a_motion_that_loses_its_symmetry_does_not_vanish():
    """The determinant of a symmetric motion's balance is that for symmetric motions: its sign holds at a pitchfork.

    The two-mass drive's symmetric cycle is unstable against lopsided ones at its side, and still there.
    """
    system = epp.case("two_mass_deadzone").to_system()
    balance = Balance.of(system, 0, system.v0)
    (guess,) = predict_limit_cycles(system)
    loop = Loop.with_means(balance.system, balance.static, system.v0)
    first = BalancedOscillation.of(
        balance, loop, *(np.array([v]) for v in (guess.amplitude("twist"), 0.0, 0.0)), guess.omega
    )
    second = first.with_harmonics(3)
    assert second is not None and second.orientation == first.orientation


@pytest.mark.parametrize("gap", [0.2, 0.5, 1.0])
def test_the_error_covers_a_play_that_a_relay_pushes_straight(gap):
    """A square wave leaves a play smaller by half of the gap, at the same instants: a relay of lower levels."""
    plant, level = ([2.0], np.poly([-1.0, -1.0, -2.0])), 1.0 - gap / 2.0
    pushed = epp.LureSystem.from_blocks([epp.HysteresisRelay(-0.1, 0.1), epp.Play(gap), plant])
    lower = epp.LureSystem.from_tf(plant, epp.HysteresisRelay(-0.1, 0.1, -level, level))
    (predicted,), (exact,) = epp.predict_limit_cycles(pushed), epp.find_limit_cycles(lower)
    size = predicted.peak_to_peak["hysteresis_relay_input"] / exact.peak_to_peak["x"] - 1.0
    assert abs(size) > 0.1
    assert abs(size) < predicted.error_estimate < 1.6 * abs(size)


@pytest.mark.parametrize("gain", [2.0, 3.0, 5.0])
def test_the_error_covers_a_schmitt_trigger_on_an_unstable_plant(gain):
    """Relative to the exact cycle: x' = x - k y takes ln((1 + k)/(k - 1)) from one threshold to the other."""
    loop = epp.LureSystem.from_tf(([gain], [1.0, -1.0]), epp.HysteresisRelay(-1.0, 1.0))
    predicted = max(epp.predict_limit_cycles(loop), key=lambda cycle: cycle.omega)
    omega = np.pi / np.log((gain + 1.0) / (gain - 1.0))
    assert abs(predicted.omega / omega - 1.0) > 0.19
    error = max(abs(predicted.omega / omega - 1.0), abs(predicted.peak_to_peak["x"] / 2.0 - 1.0))
    assert error < predicted.error_estimate < 1.6 * error


def test_the_error_is_estimated_once_and_when_it_is_first_asked_for(monkeypatch):
    asked = []
    monkeypatch.setattr(error, "_estimated", lambda *given: asked.append(given) or (0.25, ()))
    cycle = predict_limit_cycles(from_tf(([5.0], [1.0, 2.0, 1.0, 0.0]), epp.RelayDeadZone(1.0)))[1]
    assert not asked
    assert [cycle.error_estimate, cycle.error_estimate, cycle.may_not_exist] == [0.25, 0.25, False]
    assert len(asked) == 1
    assert pickle.loads(pickle.dumps(cycle)).error_estimate == 0.25
    assert replace(cycle, note="a note").error_estimate == 0.25
    assert len(asked) == 1
