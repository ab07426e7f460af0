"""Rational models against the transfer functions that their data were made of."""

import json

import numpy as np
import pytest

import eppanalysis as epp

OMEGA = np.geomspace(0.02, 100.0, 401)
S = 1j * OMEGA


def sorted_poles(poles):
    return np.array(sorted(poles, key=lambda p: (round(p.real, 6), p.imag)))


@pytest.mark.parametrize(
    ("num", "poles"),
    [
        ([2.0], [0.0, -1.0, -4.0]),
        ([1.0, 3.0], [-1.0]),
        ([640.0], [0.0, -1.0, -2.0, -0.2 + 7.9975j, -0.2 - 7.9975j]),
        ([1.0, 0.1, 20.0], [-0.01 + 1.0j, -0.01 - 1.0j, -0.15 + 5.0j, -0.15 - 5.0j, -5.0]),
        ([5.0], [0.0, 0.0, -3.0]),
    ],
)
def test_poles_are_found_again(num, poles):
    G = np.polyval(num, S) / np.polyval(np.real(np.poly(poles)), S)
    model = epp.rational_model(epp.MeasuredResponse(OMEGA, G))
    assert model.status is epp.Status.CONVERGED
    assert model.misfit < 1e-6
    assert np.allclose(sorted_poles(model.poles), sorted_poles(poles), atol=1e-4)
    assert model.integrators == poles.count(0.0)
    A, B, C, D = (getattr(model.system, n) for n in "ABCD")
    between = 1j * np.sqrt(OMEGA[1:] * OMEGA[:-1])
    response = (C @ np.linalg.solve(between[:, None, None] * np.eye(len(A)) - A, B + 0j))[:, 0, 0] + D[0, 0]
    true = np.polyval(num, between) / np.polyval(np.real(np.poly(poles)), between)
    assert np.abs(response / true - 1.0).max() < 1e-5
    assert json.dumps(model.to_dict())
    assert "poles" in str(model)


def test_the_loop_of_a_model_oscillates_as_the_loop_itself():
    G = 640.0 / np.polyval(np.polymul([1.0, 3.0, 2.0, 0.0], [1.0, 0.4, 64.0]), S)
    loop = epp.rational_model(epp.MeasuredResponse(OMEGA, G)).loop(epp.Relay())
    true = epp.LureSystem.from_tf(([640.0], np.polymul([1.0, 3.0, 2.0, 0.0], [1.0, 0.4, 64.0])), epp.Relay())
    found, known = (epp.exact_orbit(x, epp.predict_limit_cycles(x)[0]) for x in (loop, true))
    assert found.omega == pytest.approx(known.omega, rel=1e-7)
    assert found.peak_to_peak["x"] == pytest.approx(known.peak_to_peak["x"], rel=1e-7)


def test_dead_time_is_taken_out_and_put_into_the_loop():
    response = epp.MeasuredResponse(OMEGA, np.exp(-0.3 * S) / (S + 1.0))
    model = epp.rational_model(response, delay=0.3)
    assert model.misfit < 1e-9
    assert len(model.poles) == 1
    loop = model.loop(epp.HysteresisRelay(-0.1, 0.1))
    assert loop.frequency_response(2.0)[0, 0] == pytest.approx(-np.exp(-0.6j) / (1.0 + 2.0j), rel=1e-9)


def test_noise_gives_no_poles_of_its_own():
    rng = np.random.default_rng(4)
    true = 2.0 / (S * (S + 1.0) * (S + 4.0))
    noise = 1.0 + 0.01 * (rng.standard_normal(OMEGA.size) + 1j * rng.standard_normal(OMEGA.size))
    model = epp.rational_model(epp.MeasuredResponse(OMEGA, true * noise, deviation=0.01))
    assert len(model.poles) == 3
    # 802 readings of 1 % tell five numbers: each value to some 1 % * sqrt(5 / 802), three times of it here.
    assert np.abs(model.fitted / true - 1.0).max() < 0.0024


def test_an_unstable_part_is_not_passed_off_as_a_stable_one():
    model = epp.rational_model(epp.MeasuredResponse(OMEGA, 1.0 / ((S - 1.0) * (S + 5.0))))
    assert model.status is epp.Status.NOT_CONVERGED
    assert np.all(model.poles.real < 0)
    with pytest.raises(epp.NotConverged):
        model.loop(epp.Relay())


@pytest.mark.parametrize("wrong", [{"order": 0}, {"delay": -1.0}, {"tolerance": 0.0}, {"integrators": 5}])
def test_refuses(wrong):
    with pytest.raises(epp.EppError, match="expected"):
        epp.rational_model(epp.MeasuredResponse(OMEGA, 1.0 / (S + 1.0)), **wrong)
    with pytest.raises(epp.EppError, match="order is 1; expected at least 2"):
        epp.rational_model(epp.MeasuredResponse(OMEGA, 1.0 / (S * (S + 1.0) * (S + 2.0))), order=1)


def test_picture():
    figure = epp.rational_model(epp.MeasuredResponse(OMEGA, 1.0 / (S + 1.0))).plot().figure
    assert [ax.get_ylabel() for ax in figure.axes] == ["magnitude [dB]", "phase [deg]", "distance [%]"]
