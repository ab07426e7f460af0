"""Springs, quantisers and overflow: describing functions against quadrature, maps by hand, loops, digital filters."""

from __future__ import annotations

from dataclasses import replace

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
        (lambda: epp.WrapAround(0.0, 1), "limit is 0.0; expected a positive number"),
        (lambda: epp.WrapAround(1.0, 1.5), "overflows is 1.5; expected a positive whole number"),
    ],
)
def test_invalid_fields_are_refused_in_one_sentence(make: object, words: str) -> None:
    with pytest.raises(ModelError, match=words):
        make()  # type: ignore[operator]


@given(positive, st.integers(1, 5), amplitudes, numbers)
def test_overflow_matches_quadrature(limit: float, overflows: int, amplitude: float, bias: float) -> None:
    check(epp.WrapAround(limit, overflows), amplitude, bias)


def test_overflow_is_the_remainder_and_its_gain_a_sum_of_jumps() -> None:
    wrap, x = epp.WrapAround(0.75, 4), np.linspace(-6.0, 6.0, 1601)  # its edges are among them
    np.testing.assert_array_equal(wrap.output(x)[0], np.mod(x + 0.75, 1.5) - 0.75)
    assert np.isnan(wrap.output([np.nan, np.inf])[0]).tolist() == [True, False]
    assert wrap.slope_bounds() == (-np.inf, 1.0) and wrap.sector() == (-1.0, 1.0) and wrap.linear_gain() == [[1.0]]
    a = np.array([0.5, 1.0, 2.9])
    jumps = sum(np.sqrt(np.maximum(1 - (i * 0.75 / a) ** 2, 0.0)) for i in (1, 3))
    np.testing.assert_allclose(wrap.describing_function(a)[1], 1 - 8 * 0.75 / (np.pi * a) * jumps, rtol=1e-13)


def section(a: float, b: float, *elements: epp.Nonlinearity, x0: tuple[float, float] = (0.8, -0.8)) -> epp.LureSystem:
    """A filter of second order, ``y[n] = f(a y[n-1] + b y[n-2])`` with the elements one behind the other."""
    n = len(elements)
    B, C = np.zeros((2, n)), np.zeros((n, 2))
    B[0, -1], C[0] = 1.0, [a, b]
    return epp.LureSystem.build([[0, 0], [1, 0]], B, C, elements, D=np.eye(n, k=-1), x0=x0, time_step=1.0)


def turned(a: float, b: float, x: np.ndarray, samples: int, limit: float = 1.0) -> np.ndarray:
    """States behind each sample, by the recursion alone, of many starts (n, 2)."""
    path = [x]
    for _ in range(samples):
        y = np.mod(a * x[:, 0] + b * x[:, 1] + limit, 2 * limit) - limit
        path.append(x := np.column_stack([y, x[:, 0]]))
    return np.array(path)


def test_the_overflow_of_a_textbook_filter() -> None:
    """1/(1 - 1/z + 1/(2 z^2)): from 4/5, -4/5 it goes on so (Jones, Connexions m11928, Example 1)."""
    found = epp.find_limit_cycles(section(1.0, -0.5, epp.WrapAround(1.0, 1)))
    (cycle,) = found
    assert cycle.period == 2.0 and cycle.stable and found.settles
    np.testing.assert_allclose(np.abs(cycle.state), 0.8, atol=1e-12)
    assert cycle.state[0] == pytest.approx(-cycle.state[1], abs=1e-12)


@pytest.mark.parametrize(("a", "b"), [(1.0, -0.8), (0.5, -0.9), (-1.5, -0.9)])
def test_overflow_oscillations_of_a_digital_filter(a: float, b: float) -> None:
    """Ebert, Mazo and Taylor 1969, outside ``|a| + |b| < 1``: signs change at ``2 limit/(1+a-b)``, or stay at 1-a-b."""
    limit = 8.0
    stays, size = a < 0, 2 * limit / (1 + abs(a) - b)
    loop = section(a, b, epp.WrapAround(limit, 1), x0=(0.8 * limit, -0.8 * limit))
    found = epp.find_limit_cycles(loop)
    assert found.settles and len(found.stable) == len(found) >= 1
    at = np.array([size, size if stays else -size])
    np.testing.assert_allclose(turned(a, b, at[None], 2, limit)[-1][0], at, atol=1e-12)
    if stays:
        run = epp.simulate(replace(loop, x0=0.9 * at), t_end=1000.0)
        assert run.settled_at["wrap_around_output"] == pytest.approx(size, rel=1e-6)
    else:
        assert [c.period for c in found if np.abs(np.abs(c.state) - size).max() < 1e-12 * limit] == [2.0]
    for cycle in found:
        path = turned(a, b, cycle.state[None], round(cycle.period), limit)
        np.testing.assert_allclose(path[-1], path[0], atol=1e-12 * limit)
    # Where 2000 starts of the recursion end: nowhere else, but for basins below one in 100.
    starts = limit * np.random.default_rng(0).uniform(-1.0, 1.0, (2000, 2))
    ends = turned(a, b, starts, 1000, limit)[-1]
    near = [p for c in found for p in turned(a, b, c.state[None], round(c.period), limit)[1:, 0]]
    near += [0.0 * at, *((at, -at) if stays else ())]
    away = np.min([np.abs(ends - point).max(axis=1) for point in near], axis=0)
    assert np.mean(away > 1e-9 * limit) < 0.01


@pytest.mark.parametrize("a", [1.0, -1.5])
def test_no_overflow_oscillates_where_sums_are_small_or_saturate(a: float) -> None:
    """The same authors: none with ``|a| + |b| < 1``, and none in saturation arithmetic."""
    for loop in (section(a / 2, -0.2, epp.WrapAround(1.0, 1)), section(a, -0.8, epp.Saturation())):
        found = epp.find_limit_cycles(loop)
        assert not len(found) and found.settles and not found.diverges


@pytest.mark.slow
def test_the_proof_that_no_overflow_oscillates_ends_where_oscillations_begin() -> None:
    for a, b in ((i / 7, j / 7) for i in (-5, -2, 1, 4) for j in (-4, -1, 2)):
        assert epp.certify(section(a, b, epp.WrapAround(1.0, 2)), "absence").proved is (abs(a) + abs(b) < 1.0)


@pytest.mark.parametrize("rounding", ["down", "to the nearest"])
def test_a_filter_in_whole_numbers_runs_as_its_arithmetic(rounding: str) -> None:
    """Truncated or rounded, then of four bits: sums meet the edges of both elements, where the upper piece begins."""
    step, a, b = 0.125, 1.5, -0.875
    first = epp.FloorQuantiser(step, 60) if rounding == "down" else epp.Quantiser(step, 60)
    met = 0
    for i, j in np.random.default_rng(2).integers(-8, 8, (12, 2)):
        run = epp.simulate(section(a, b, first, epp.WrapAround(1.0, 3), x0=(i * step, j * step)), t_end=30.0)
        past, now, want = int(j), int(i), []
        for _ in range(20):
            total = 12 * now - 7 * past  # in eighths of a step
            whole = total // 8 if rounding == "down" else int(np.copysign((abs(total) + 4) // 8, total))
            met += total % 8 == (0 if rounding == "down" else 4) or whole % 16 == 8
            past, now = now, (whole + 8) % 16 - 8
            want.append(now * step)
        np.testing.assert_array_equal(run.signals["wrap_around_output"][:20], want)
    assert met > 20
