"""Smooth curves: describing functions against quadrature, series in loops against another integrator, exact cycles."""

from __future__ import annotations

import tracemalloc
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from scipy.integrate import solve_ivp

import eppanalysis as epp
from eppanalysis.errors import ModelError
from tests.models.elements.quadrature import assert_agrees, crossings, fourier, fourier_adaptive
from tests.shared import mostly_slow

numbers, amplitudes = st.floats(-3, 3), st.floats(1e-3, 20)
positive = st.floats(0.05, 4)
SMOOTH = [
    epp.Drag(1.3),
    epp.Polynomial([0.3, 1.0, -0.5, 0.7]),
    epp.Polynomial([0.0, 0.5, 0.2, 0.4, -0.1, 0.05]),
    epp.Tanh(1.5, 2.0),
    epp.Arctan(1.5, 2.0),
]


@given(st.floats(-2, 2), amplitudes, numbers)
def test_drag_matches_quadrature(scale: float, amplitude: float, bias: float) -> None:
    element = epp.Drag(scale)
    witness = fourier(element, amplitude, bias, crossings([0.0], amplitude, bias))
    assert_agrees(element.describing_function(amplitude, bias), witness, amplitude)


@given(st.lists(numbers, min_size=1, max_size=6), amplitudes, numbers)
def test_polynomials_match_quadrature(coefficients: list[float], amplitude: float, bias: float) -> None:
    element = epp.Polynomial(coefficients)
    # Its terms may cancel: the size is that of each of them.
    size = float(np.polynomial.polynomial.polyval(amplitude + abs(bias), np.abs(coefficients)))
    answer, witness = element.describing_function(amplitude, bias), fourier(element, amplitude, bias)
    assert_agrees(answer, witness, amplitude, 1e-9, rounding=1e-13 * size)


@settings(max_examples=40, deadline=None)
@given(positive, positive, st.floats(1e-3, 200), numbers)
def test_saturating_curves_match_quadrature(level: float, slope: float, amplitude: float, bias: float) -> None:
    for element in (epp.Tanh(level, slope), epp.Arctan(level, slope)):
        steep = crossings([0.0, 3 * level / slope, -3 * level / slope], amplitude, bias)
        layers = [s + sign * 0.5**k for s in steep for sign in (-1, 1) for k in range(1, 14)]
        witness = fourier_adaptive(element, amplitude, bias, [*steep, *layers])
        assert_agrees(element.describing_function(amplitude, bias), witness, amplitude)


def test_published_formulas_without_bias() -> None:
    a = np.array([0.1, 1.0, 30.0])
    np.testing.assert_allclose(epp.Drag(2.0).describing_function(a)[1], 16 * a / (3 * np.pi), rtol=1e-14)
    duffing = epp.Polynomial([0.0, 1.0, 0.0, 2.0, 0.0, 3.0]).describing_function(a)[1]
    np.testing.assert_allclose(duffing, 1 + 2 * 3 / 4 * a**2 + 3 * 5 / 8 * a**4, rtol=1e-14)
    arctan = epp.Arctan(np.pi / 2).describing_function(a)[1]
    np.testing.assert_allclose(arctan, 2 * (np.sqrt(1 + a**2) - 1) / a**2, rtol=1e-12)
    for element in (epp.Tanh(1.5, 2.0), epp.Arctan(1.5, 2.0)):
        far = element.describing_function(1e6)[1]
        assert far == pytest.approx(4 * 1.5 / (np.pi * 1e6), rel=1e-5)
        mean, gain = element.describing_function([0.0, 1e-9], 0.4)
        x = np.array([0.4 - 1e-5, 0.4 + 1e-5])
        np.testing.assert_allclose(gain, float(np.diff(element.output(x)[0])[0] / 2e-5), rtol=1e-9)
        np.testing.assert_allclose(mean, float(element.output(0.4)[0]), rtol=1e-14)


def test_a_steep_tanh_is_the_relay_but_for_its_layer() -> None:
    # With a layer of width d = level/slope the relay's gain lacks the share pi^2/24 (d/A)^2; the next power is lost.
    a = np.array([1e3, 1e4, 1e7, 1e12])
    gain = epp.Tanh(1.5, 1.5).describing_function(a)[1].real
    np.testing.assert_allclose(gain, 4 * 1.5 / (np.pi * a) * (1 - np.pi**2 / 24 / a**2), rtol=1e-12)
    mean = epp.Tanh(1.5, 1.5).describing_function(1e5, 0.3e5)[0]
    assert mean == pytest.approx(2 * 1.5 / np.pi * np.arcsin(0.3), rel=1e-9)


@pytest.mark.parametrize("element", [epp.Tanh(1.5, 2.0), epp.StribeckFriction(1.0, 1.5, 0.1)], ids=lambda e: e.kind)
def test_many_arguments_need_the_memory_of_few_and_have_the_answers_of_each(element: epp.Nonlinearity) -> None:
    a = np.geomspace(1e-9, 1e9, 2000)
    b = np.random.default_rng(2).normal(size=a.size) * a
    tracemalloc.start()
    answer = element.describing_function(a, b)
    most = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert most < 30e6  # the nodes of all arguments at once fill 100 MB
    alone = [element.describing_function(a[k], b[k]) for k in range(0, a.size, 50)]
    for together, each in zip(answer, zip(*alone, strict=True), strict=True):
        np.testing.assert_allclose(together[::50], each, rtol=1e-12)


def driven(element: epp.Nonlinearity) -> epp.LureSystem:
    """An oscillator that the element pulls back, of its position, with a push."""
    return epp.LureSystem.build(
        [[0.0, 1.0], [-1.0, -0.2]], [[0.0], [-1.0]], [[1.0, 0.0]], [element], B_input=[[0.0], [1.0]], input_names=["u"],
        x0=[0.0, 0.0], element_names=["curve"],
    )  # fmt: skip


@pytest.mark.parametrize("element", SMOOTH, ids=repr)
@pytest.mark.parametrize("size", mostly_slow([1e-6, 1.5], [1.5]))
def test_in_a_loop_against_another_integrator(element: Any, size: float) -> None:
    # The run begins at zero, where powers and drag vanish with their first terms.
    times = np.linspace(0.0, 15.0, 151)
    run = epp.simulate(driven(element), epp.inputs.Sine(size, 0.2), t_end=15.0, t_eval=times)

    def rates(t: float, v: Any) -> list[float]:
        push = size * np.sin(2 * np.pi * 0.2 * t)
        return [v[1], -v[0] - 0.2 * v[1] - float(element.output(v[0])[0]) + push]

    options = {"method": "DOP853", "rtol": 1e-12, "atol": 1e-13 * size, "max_step": 0.02}
    other = solve_ivp(rates, (0, 15), [0.0, 0.0], t_eval=times, **options).y[0]
    scale = np.abs(other).max()
    np.testing.assert_allclose(run.signals["curve_input"], other, atol=1e-9 * scale)


@pytest.mark.parametrize("element", [epp.Tanh(1.0), epp.Arctan(1.0)], ids=repr)
def test_cycles_are_predicted_balanced_and_closed(element: epp.Nonlinearity) -> None:
    loop = epp.LureSystem.from_tf(([9.0], [1.0, 3.0, 2.0, 0.0]), element)
    (predicted,) = epp.predict_limit_cycles(loop)
    assert predicted.omega == pytest.approx(np.sqrt(2.0), rel=1e-9)
    exact = epp.exact_orbit(loop, predicted)
    run = epp.simulate(loop, t_end=400.0)
    assert run.limit_cycle is not None and exact.stable
    assert run.limit_cycle.period == pytest.approx(exact.period, rel=1e-8)
    balanced = epp.harmonic_balance(loop, predicted, 25)
    assert balanced.omega == pytest.approx(2 * np.pi / exact.period, rel=1e-9)
    assert abs(predicted.peak_to_peak["x"] / exact.peak_to_peak["x"] - 1) < predicted.error_estimate < 0.1


def test_van_der_pol_by_its_powers_has_the_published_period() -> None:
    """x'' - mu (1 - x^2) x' + x = 0 as a loop round x + x^3/3: 6.66328686 at mu = 1 (Andersen and Geer 1982)."""
    loop = epp.LureSystem.from_tf(([1.0, 0.0], [1.0, -2.0, 1.0]), epp.Polynomial([0.0, 1.0, 0.0, 1.0 / 3.0]))
    (predicted,) = epp.predict_limit_cycles(loop)
    assert predicted.amplitude("x") == pytest.approx(2.0, rel=1e-9) and predicted.stable
    assert epp.exact_orbit(loop, predicted).period == pytest.approx(6.66328686, rel=1e-8)


def test_cycles_of_drag_and_of_high_powers() -> None:
    # A speed loop that grows until drag takes what it gains: v'' + (drag - v)' + v = 0.
    for element in (epp.Drag(1.0), epp.Polynomial([0.0, 0.0, 0.0, 0.0, 0.0, 1.0])):
        loop = epp.LureSystem.from_tf(([1.0, 0.0], [1.0, -0.4, 1.0]), element)
        (predicted,) = epp.predict_limit_cycles(loop)
        gain = complex(element.describing_function(predicted.amplitude("x"))[1])
        assert gain == pytest.approx(0.4, rel=1e-9)
        exact = epp.exact_orbit(loop, predicted)
        run = epp.simulate(loop, t_end=300.0)
        assert run.limit_cycle is not None and exact.stable
        assert run.limit_cycle.period == pytest.approx(exact.period, rel=1e-7)


def test_slopes_and_sectors() -> None:
    assert epp.Drag(-1.0).slope_bounds() == (-np.inf, 0.0) and epp.Drag(0.0).sector() == (0.0, 0.0)
    assert epp.Polynomial([0.0, 1.0, 0.0, 1.0]).slope_bounds() == (1.0, np.inf)
    assert epp.Polynomial([0.0, 2.0]).slope_bounds() == (2.0, 2.0)
    assert epp.Polynomial([0.0, 1.0, -1.0]).sector() == (-np.inf, np.inf)
    assert epp.Polynomial([1.0]).sector() == (-np.inf, np.inf)
    low, high = epp.Polynomial([0.0, 0.0, 1.0, 0.0, 1.0]).slope_bounds()
    assert (low, high) == (-np.inf, np.inf)
    assert epp.Polynomial([0.0, 1.0, -2.0, 1.0]).sector() == (pytest.approx(0.0, abs=1e-15), np.inf)
    assert epp.Tanh(1.0, 3.0).sector() == epp.Arctan(1.0, 3.0).slope_bounds() == (0.0, 3.0)


def test_a_polynomial_comes_back_from_a_file() -> None:
    loop = epp.LureSystem.from_tf(([1.0, 0.0], [1.0, 0.0, 1.0]), epp.Polynomial([0.1, -1.0, 0.0, 0.3]))
    again = epp.case_from_text(epp.Case.from_system(loop, name="pol").to_toml()).to_system()
    assert again.elements == loop.elements and hash(again.elements[0]) == hash(loop.elements[0])


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: epp.Drag(float("nan")), "scale is nan; expected a finite number"),
        (lambda: epp.Polynomial([]), r"coefficients is \[\]; expected one to six finite numbers"),
        (lambda: epp.Polynomial([1.0] * 7), "expected one to six finite numbers"),
        (lambda: epp.Tanh(0.0), "level is 0.0; expected a positive number"),
        (lambda: epp.Arctan(1.0, -1.0), "slope is -1.0; expected a positive number"),
    ],
)
def test_invalid_fields_are_refused_in_one_sentence(make: object, words: str) -> None:
    with pytest.raises(ModelError, match=words):
        make()  # type: ignore[operator]


@pytest.mark.parametrize("level", [30.0, 1e3])
@pytest.mark.parametrize("step", mostly_slow([0.05, 0.5, 3.0], [0.5]))
def test_a_tanh_deep_in_saturation_leaves_it_within_a_step(level: float, step: float) -> None:
    """There its slope is beneath the rounding of one, and the first terms of its series too: steps went on across."""
    loop = epp.LureSystem.from_tf(([level], [1.0, 0.923, 0.468, 0.165]), epp.Tanh(1.0))
    times = np.linspace(0.0, 40.0, 81)
    run = epp.simulate(loop, t_end=40.0, t_eval=times, step=step)
    by_hand = solve_ivp(
        lambda t, x: loop.A @ x + loop.B @ np.tanh(loop.C @ x), (0.0, 40.0), loop.x0, "DOP853", times,
        rtol=1e-12, atol=1e-12, max_step=0.02,
    ).y  # fmt: skip
    x = (loop.C @ by_hand)[0]
    np.testing.assert_allclose(run.signals["x"], x, rtol=0.0, atol=1e-8 * np.ptp(x))


@pytest.mark.slow
def test_a_cycle_of_a_tanh_deep_in_saturation_is_that_of_a_relay() -> None:
    """The deeper, the nearer; the relay's is found by a method without series."""
    plant, slope = ([1.0], [1.0, 0.923, 0.468, 0.165]), 300.0
    (limit,) = epp.find_limit_cycles(epp.LureSystem.from_tf(plant, epp.Relay()))
    loop = epp.LureSystem.from_tf(plant, epp.Tanh(1.0, slope))
    cycle = epp.simulate(loop, t_end=200.0).limit_cycle
    assert cycle is not None
    search = epp.find_limit_cycles(loop)
    # Series that begin anew with the longest step, or stay as short as across the switch, spend all its work.
    assert search.status is epp.Status.CONVERGED
    for found in (cycle, epp.exact_orbit(loop, cycle), *search):
        shape = [found.period, found.peak_to_peak["x"]]
        assert shape == pytest.approx([limit.period, limit.peak_to_peak["x"]], rel=3.0 / slope**2)
