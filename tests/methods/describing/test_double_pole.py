"""Loops in discrete time with several poles at z = 1 (any servo with PI on a motor): predictions, margins, balances.

Witnesses: the same loop in continuous time, which small sample times approach, a plain iteration of the samples,
python-control, and closed forms.
"""

from __future__ import annotations

import warnings
from functools import cache

import control
import numpy as np
import pytest

import eppanalysis as epp
from tests.coordinates import in_coordinates, rescaled, rotated

S = control.tf("s")
#: PI controller, a motor with one time constant, and play behind it.
SERVO = (40 + 100 / S) * 1.25 / (S * (0.1 * S + 3.125))
GAP = 0.00175
FORMS = ("transfer function", "state space", "turned", "balanced")


def sampled(form: str, step: float) -> epp.LureSystem:
    plant = SERVO if form == "transfer function" else control.ss(SERVO)
    loop = epp.LureSystem.from_tf(control.sample_system(plant, step), epp.Play(GAP))
    if form == "turned":
        return rotated(loop, 3)
    units = np.diag([1.0, 1e3, 1e-3])
    return in_coordinates(loop, units) if form == "balanced" else loop


@cache
def continuous() -> epp.LimitCycle:
    return epp.predict_limit_cycles(epp.LureSystem.from_tf(SERVO, epp.Play(GAP)))[0]


@cache
def iterated(step: float) -> tuple[float, float]:
    """Period [s] and size of the motion at the play's input, by iterating the difference equation of the servo."""
    plant = control.sample_system(control.ss(SERVO), step)
    A, b, c = np.asarray(plant.A), np.asarray(plant.B)[:, 0], -np.asarray(plant.C)[0]
    x, held, before, rises, recent = np.linalg.lstsq(c[None], [3e-3], rcond=None)[0], 0.0, 0.0, [], []
    for k in range(round(12.0 / step)):
        z = float(c @ x)
        held = min(max(held, z - GAP / 2), z + GAP / 2)
        x = A @ x + b * held
        if before < 0 <= z:
            rises.append(k - z / (z - before))
        before = z
        recent = [*recent[-round(2.0 / step) :], z] if k % 50 == 0 else [*recent, z]
    return (rises[-1] - rises[-3]) / 2 * step, float(np.ptp(recent))


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("step", [1e-5, 1e-3, 0.02])
def test_prediction_does_not_depend_on_the_realisation(form, step):
    (found,), (wanted,) = (
        epp.predict_limit_cycles(sampled(form, step)),
        epp.predict_limit_cycles(sampled("state space", step)),
    )
    # The coefficients of a transfer function know slow poles to rounding over the sample time, and no better.
    known = 1e-12 / step**2 if form == "transfer function" else 1e-14 / step + 1e-9
    np.testing.assert_allclose(found.omega, wanted.omega, rtol=known)
    np.testing.assert_allclose(found.amplitude("x"), wanted.amplitude("x"), rtol=known)
    assert found.stable and wanted.stable


@pytest.mark.parametrize("step", [1e-4, 2e-4])
def test_prediction_is_that_of_continuous_time_but_for_the_hold(step):
    """A hold is half a sample of dead time, as far as it is short: the first order of it is the continuous loop's."""
    (found,) = epp.predict_limit_cycles(sampled("state space", step))
    (late,) = epp.predict_limit_cycles(epp.LureSystem.from_tf(SERVO, epp.Play(GAP), delay=step / 2))
    np.testing.assert_allclose(found.omega, late.omega, rtol=1e-6)
    np.testing.assert_allclose(found.amplitude("x"), late.amplitude("x"), rtol=1e-6)
    assert abs(found.omega / continuous().omega - 1.0) < 10 * step


@pytest.mark.parametrize("form", FORMS)
def test_harmonic_balance_is_near_the_iterated_motion(form):
    loop, (period, size) = sampled(form, 1e-3), iterated(1e-3)
    found = epp.harmonic_balance(loop, epp.predict_limit_cycles(loop)[0], 25)
    assert found.status.ok
    assert found.period == pytest.approx(period, rel=2e-3)
    assert found.peak_to_peak["x"] == pytest.approx(size, rel=2e-3)


@pytest.mark.parametrize("n", [2, 3, 4])
@pytest.mark.parametrize("step", [1e-6, 1e-3, 1.0])
def test_response_of_a_chain_of_integrators_in_companion_form(n, step):
    """Samples of nothing but poles at one: 1/(z - 1)^n, of which a companion form is singular to rounding."""
    omega = np.array([0.01, 0.3, 2.0])
    loop = epp.LureSystem.from_tf(control.tf([1.0], np.poly(np.ones(n)), step), epp.Relay())
    wanted = -1.0 / np.expm1(1j * omega * step) ** n
    np.testing.assert_allclose(loop.frequency_response(omega)[:, 0, 0], wanted, rtol=1e-6)


@pytest.mark.parametrize("seed", range(4))
def test_chains_of_integrators_at_short_samples_in_other_coordinates(seed):
    """Three integrators with two zeros at 1 us, where the poles' distance from one is near rounding."""
    plant = control.sample_system(control.ss(control.tf([8.4, 5.6, 0.6], [1.0, 0.0, 0.0, 0.0])), 1e-6)
    loop = epp.LureSystem.from_tf(plant, epp.Saturation(-1, 1, 2.0))
    (wanted,) = epp.predict_limit_cycles(loop)
    for other in (rotated(loop, seed), rescaled(loop, 1.0, 1.0, seed)):
        (found,) = epp.predict_limit_cycles(other)
        np.testing.assert_allclose(found.omega, wanted.omega, rtol=1e-6)
        assert found.stable == wanted.stable


@pytest.mark.parametrize("form", FORMS)
def test_margins_come_without_a_warning_and_with_the_crossovers_of_the_response(form):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        margins = epp.predict_limit_cycles(sampled(form, 1e-3)).margins
    plant = control.sample_system(control.ss(SERVO), 1e-3)
    at_phase = complex(plant(np.exp(1e-3j * margins["phase_crossover"])))
    at_gain = complex(plant(np.exp(1e-3j * margins["gain_crossover"])))
    assert at_phase == pytest.approx(-1.0 / margins["gain_margin"], rel=1e-6)
    assert at_gain == pytest.approx(-np.exp(1j * margins["phase_margin"]), rel=1e-6)


@pytest.mark.parametrize("seed", range(6))
def test_margins_are_those_of_python_control_where_its_polynomials_hold(seed):
    rng = np.random.default_rng(seed)
    poles = np.concatenate([[0.0], rng.uniform(-3.0, -0.2, 2)])
    plant = control.sample_system(control.ss(control.tf([3.0, 4.0], np.poly(poles))), 0.5)
    gm, pm, _, wg, wp, _ = control.stability_margins(control.tf(plant), method="poly")
    found = epp.predict_limit_cycles(epp.LureSystem.from_tf(plant, epp.Saturation())).margins
    wanted = {"gain_margin": gm, "phase_margin": np.deg2rad(pm), "phase_crossover": wg, "gain_crossover": wp}
    for name, value in wanted.items():
        assert found[name] == pytest.approx(value, rel=1e-7), name
