"""Springs with freeplay and quantisers: describing functions against quadrature, maps by hand, loops."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from scipy.integrate import solve_ivp

import eppanalysis as epp
from eppanalysis.errors import ModelError
from tests.models.elements.quadrature import assert_agrees, crossings, fourier

numbers, positive, amplitudes = st.floats(-3, 3), st.floats(0.01, 3), st.floats(1e-3, 20)


def check(element: epp.PiecewiseLinear, amplitude: float, bias: float) -> None:
    witness = fourier(element, amplitude, bias, crossings(element.breakpoints, amplitude, bias))
    size = np.abs(element.slopes).max() * (amplitude + abs(bias)) + np.abs(element.intercepts).max()
    assert_agrees(element.describing_function(amplitude, bias), witness, amplitude, rounding=1e-14 * float(size))


@given(numbers, positive, numbers, numbers, numbers, amplitudes, numbers)
def test_springs_match_quadrature(
    lower: float, width: float, outer: float, inner: float, preload: float, amplitude: float, bias: float
) -> None:
    check(epp.BilinearSpring(lower, lower + width, outer, inner, preload), amplitude, bias)


@settings(max_examples=50)
@given(positive, st.integers(1, 12), amplitudes, numbers)
def test_quantisers_match_quadrature(step: float, levels: int, amplitude: float, bias: float) -> None:
    for element in (epp.FloorQuantiser(step, levels), epp.MidRiseQuantiser(step, levels)):
        check(element, amplitude, bias)


def test_formulas_of_the_page() -> None:
    a = np.array([0.3, 1.2, 3.7])
    dead_zone = epp.DeadZone(-0.8, 0.8, 2.0 - 0.5).describing_function(a)[1]
    np.testing.assert_allclose(
        epp.BilinearSpring(-0.8, 0.8, 2.0, 0.5, 1.0).describing_function(a)[1], 0.5 + dead_zone, rtol=1e-13
    )
    steps = 0.5 + sum(np.sqrt(np.maximum(1 - (i / a) ** 2, 0.0)) for i in range(1, 4))
    for element, mean in ((epp.MidRiseQuantiser(1.0, 8), 0.0), (epp.FloorQuantiser(1.0, 8), -0.5)):
        found = element.describing_function(a)
        np.testing.assert_allclose(found[1], 4 / (np.pi * a) * steps, rtol=1e-13)
        np.testing.assert_allclose(found[0], mean, atol=1e-13)


def test_maps_by_hand() -> None:
    x = np.array([-2.0, -0.5, 0.0, 0.5, 3.0])
    np.testing.assert_allclose(epp.BilinearSpring(-1.0, 1.0, 4.0, 1.0).output(x)[0], [-5.0, -0.5, 0.0, 0.5, 9.0])
    fine = np.linspace(-3.3, 3.3, 1001)
    np.testing.assert_array_equal(epp.FloorQuantiser(0.25, 100).output(fine)[0], 0.25 * np.floor(fine / 0.25))
    np.testing.assert_array_equal(epp.MidRiseQuantiser(0.25, 100).output(fine)[0], 0.25 * (np.floor(fine / 0.25) + 0.5))
    assert epp.FloorQuantiser(1.0, 3).output([-9.0, 9.0])[0].tolist() == [-3.0, 3.0]
    assert epp.MidRiseQuantiser(1.0, 3).output([-9.0, 0.0, 9.0])[0].tolist() == [-2.5, 0.5, 2.5]
    assert np.isnan(epp.FloorQuantiser(1.0, 3).output(np.nan)[0])
    one = epp.MidRiseQuantiser(2.0, 1)
    assert one.breakpoints.tolist() == [0.0] and one.intercepts.tolist() == [-1.0, 1.0]


def test_special_springs_are_the_elements_that_have_names() -> None:
    a, b = np.array([0.2, 1.5, 4.0]), 0.3
    for spring, plain in (
        (epp.BilinearSpring(-0.5, 1.0, 2.0), epp.DeadZone(-0.5, 1.0, 2.0)),
        (epp.BilinearSpring(-0.5, 0.5, 0.0, 3.0), epp.Saturation(-1.5, 1.5, 3.0)),
    ):
        for one, other in zip(spring.describing_function(a, b), plain.describing_function(a, b), strict=True):
            np.testing.assert_allclose(one, other, rtol=1e-13, atol=1e-15)
    assert epp.BilinearSpring(-1.0, 1.0, 2.0, 0.5).slope_bounds() == (0.5, 2.0)
    assert epp.BilinearSpring(-1.0, 1.0, 2.0, 0.5).sector() == (0.5, 2.0)
    assert epp.FloorQuantiser(1.0, 3).slope_bounds() == (0.0, np.inf)


def test_a_section_with_freeplay_against_another_integrator() -> None:
    spring = epp.BilinearSpring(-0.3, 0.5, 40.0, 4.0, 1.0)
    loop = epp.LureSystem.build([[0.0, 1.0], [0.0, 0.3]], [[0.0], [-1.0]], [[1.0, 0.0]], [spring], x0=[1.0, 0.0])
    times = np.linspace(0.0, 6.0, 121)
    run = epp.simulate(loop, t_end=6.0, t_eval=times)
    other = solve_ivp(
        lambda t, v: [v[1], 0.3 * v[1] - float(spring.output(v[0])[0])], (0, 6), [1.0, 0.0], t_eval=times,
        method="DOP853", rtol=1e-11, atol=1e-13, max_step=1e-3,
    )  # fmt: skip
    np.testing.assert_allclose(run.signals["bilinear_spring_input"], other.y[0], atol=1e-8)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: epp.BilinearSpring(1.0, 1.0, 2.0), r"upper is 1.0.*expected more than lower"),
        (lambda: epp.BilinearSpring(0.0, 1.0, float("nan")), "outer is nan; expected a finite number"),
        (lambda: epp.FloorQuantiser(0.0, 2), "step is 0.0; expected a positive number"),
        (lambda: epp.MidRiseQuantiser(1.0, 0), "levels is 0; expected a positive whole number"),
    ],
)
def test_invalid_fields_are_refused_in_one_sentence(make: object, words: str) -> None:
    with pytest.raises(ModelError, match=words):
        make()  # type: ignore[operator]
