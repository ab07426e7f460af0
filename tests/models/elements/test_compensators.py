"""Compensators: describing functions against quadrature of their maps, and what they make of what they compensate."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

import eppanalysis as epp
from eppanalysis import LureSystem, inputs, simulate
from eppanalysis.errors import ModelError
from tests.models.elements.quadrature import assert_agrees, crossings, fourier

positive = st.floats(0.01, 3)
amplitudes = st.floats(1e-2, 20)


@settings(max_examples=40, deadline=None)
@given(amplitudes, st.floats(-2, 2), positive, positive)
def test_compensator_with_travel_matches_quadrature(amplitude: float, bias: float, gap: float, travel: float) -> None:
    element = epp.BacklashCompensator(gap, travel)
    switches = crossings([bias + amplitude - travel, bias - amplitude + travel], amplitude, bias)
    start = bias if amplitude <= travel / 2 else None
    witness = fourier(element, amplitude, bias, switches, start)
    assert_agrees(element.describing_function(amplitude, bias), witness, amplitude)


@settings(max_examples=20, deadline=None)
@given(amplitudes, st.floats(-2, 2), positive)
def test_compensator_that_jumps_matches_quadrature(amplitude: float, bias: float, gap: float) -> None:
    element = epp.BacklashCompensator(gap)
    assert_agrees(element.describing_function(amplitude, bias), fourier(element, amplitude, bias), amplitude)
    near = epp.BacklashCompensator(gap, 1e-9 * amplitude).describing_function(amplitude, bias)[1]
    assert abs(complex(near - element.describing_function(amplitude, bias)[1])) < 1e-4 * gap / amplitude


@pytest.mark.parametrize("gap", [0.4, 1.5])
def test_behind_the_compensator_a_play_is_a_straight_connection(gap: float) -> None:
    """On any way, once it has moved by the gap; where it turns back the output stays what the input is."""
    rng = np.random.default_rng(3)
    turns = np.concatenate([[0.0, 2.0], rng.uniform(-2, 2, 20)])
    way = np.concatenate([np.linspace(a, b, 50) for a, b in zip(turns, turns[1:], strict=False)])
    compensated, play, out = None, None, []
    for x in way:
        y, compensated = epp.BacklashCompensator(gap).output(x, compensated)
        z, play = epp.Play(gap).output(y, play)
        out.append(float(z))
    np.testing.assert_allclose(out, way, atol=1e-12)


def test_compensator_in_a_run_undoes_the_play_behind_it() -> None:
    """A sine through compensator and play, with no loop: the play's output is the sine, from the start on."""
    nothing = np.zeros
    loop = LureSystem.build(
        nothing((0, 0)), nothing((0, 2)), nothing((2, 0)), [epp.BacklashCompensator(0.5), epp.Play(0.5)],
        D=[[0.0, 0.0], [1.0, 0.0]], D_input=[[1.0], [0.0]], input_names=["u"], element_names=["ahead", "play"],
    )  # fmt: skip
    times = np.linspace(0.0, 7.0, 141)
    run = simulate(loop, inputs.Sine(1.0, 0.2), t_end=7.0, t_eval=times)
    np.testing.assert_allclose(run.signals["play_output"][1:], np.sin(0.4 * np.pi * times)[1:], atol=1e-12)
    smooth = epp.BacklashCompensator(0.5, 0.3)
    memory, expected = None, []
    for x in np.sin(0.4 * np.pi * np.linspace(0.0, 7.0, 2801)):
        y, memory = smooth.output(x, memory)
        expected.append(float(y))
    alone = LureSystem.build(
        nothing((0, 0)), nothing((0, 1)), nothing((1, 0)), [smooth], D_input=[[1.0]], input_names=["u"],
        element_names=["ahead"],
    )  # fmt: skip
    run = simulate(alone, inputs.Sine(1.0, 0.2), t_end=7.0, t_eval=times)
    np.testing.assert_allclose(run.signals["ahead_output"], expected[::20], atol=1e-4)


def test_values_of_a_compensator() -> None:
    assert epp.BacklashCompensator(0.6, 0.4).slope_bounds() == pytest.approx((1.0, 2.5))
    assert epp.BacklashCompensator(0.6).slope_bounds() == (1.0, np.inf)
    assert epp.BacklashCompensator(0.0).describing_function(0.3)[1] == 1.0
    for make, words in (
        (lambda: epp.BacklashCompensator(-1.0), "BacklashCompensator: gap is -1.0; expected zero or more"),
        (lambda: epp.BacklashCompensator(1.0, -0.1), "BacklashCompensator: travel is -0.1; expected zero or more"),
    ):
        with pytest.raises(ModelError, match=words):
            make()


def test_friction_compensator_is_a_sign_or_a_saturation() -> None:
    v = np.array([-2.0, -0.05, 0.0, 0.05, 2.0])
    np.testing.assert_array_equal(epp.FrictionCompensator(1.5).output(v)[0], epp.Coulomb(1.5).output(v)[0])
    ramp = epp.FrictionCompensator(1.5, 0.1)
    np.testing.assert_array_equal(ramp.output(v)[0], epp.Saturation(-1.5, 1.5, 15.0).output(v)[0])
    assert ramp.slope_bounds() == (0.0, pytest.approx(15.0)) and ramp.sector() == (0.0, pytest.approx(15.0))
    theta = np.arcsin(0.1 / 0.4)
    closed = 2 * 1.5 / (np.pi * 0.1) * (theta + np.sin(theta) * np.cos(theta))
    assert complex(ramp.describing_function(0.4)[1]) == pytest.approx(closed, rel=1e-12)
    assert ramp.output_is == "force"
    for make, words in (
        (lambda: epp.FrictionCompensator(1.0, -0.1), "FrictionCompensator: ramp is -0.1; expected zero or more"),
        (lambda: epp.FrictionCompensator(np.inf), "FrictionCompensator: level is inf; expected a finite number"),
    ):
        with pytest.raises(ModelError, match=words):
            make()
