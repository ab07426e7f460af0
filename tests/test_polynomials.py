"""Numbers as polynomials of a parameter: derivatives of what is resolved, and what is rounding alone."""

from __future__ import annotations

import numpy as np
import pytest

from eppanalysis.polynomials import polynomial, polynomial_at


def _numbers(x):
    return np.array([1.0 / x, np.sin(3.0 * x), (1e3 + x) - 1e3 - x, (x * x + 1e5) - 1e5 - x * x, 1e-9 * np.exp(x), 7.0])


def _slopes(x):
    return np.array([-1.0 / x**2, 3.0 * np.cos(3.0 * x), 0.0, 0.0, 1e-9 * np.exp(x), 0.0])


@pytest.mark.parametrize("x", [0.7, 1.3, 2.9, 11.7])
@pytest.mark.parametrize("power", [0, 3, -20, 20])
def test_rounding_of_a_zero_has_no_slope_and_what_is_small_has_its_own(x, power):
    # Units that are no powers of two: they round each number anew.
    units = 10.0 ** (power * np.array([1, -1, 1, -1, -1, 1]))
    found = polynomial_at(lambda v: units * _numbers(v), x, x)
    np.testing.assert_allclose(found.slope(x) / units, _slopes(x), rtol=1e-11, atol=0.0)


@pytest.mark.parametrize("jump", [1e-3, 1e-6, 1e-9])
def test_a_step_at_the_value_is_not_taken_for_rounding(jump):
    found = polynomial_at(lambda v: np.array([1.0 / v + (jump if v > 2.0 else 0.0)]), 2.0, 2.0)
    # On one side of the step, where the function is smooth.
    assert found.middle < 2.0
    assert found.slope(2.0) == pytest.approx([-0.25], rel=1e-9)


@pytest.mark.parametrize("x", [2.932, 4.542, 11.627, 13.881])
def test_a_zero_that_is_rounded_at_single_places_is_a_zero(x):
    built = []

    def numbers(v):
        built.append(v)
        return np.array([1.0 / v, v * (1.0 / v) - 1.0])

    found = polynomial(numbers, 0.99 * x, 1.01 * x)
    assert any(numbers(v)[1] != 0.0 for v in built[:])
    np.testing.assert_allclose(found.slope(x), [-1.0 / x**2, 0.0], rtol=1e-12, atol=0.0)
    assert len(set(built)) == 9


def test_a_zero_that_comes_back_time_and_again_is_a_zero_at_the_value_and_at_the_ends_too():
    # Rounding in teeth: the same at near neighbours, so that these tell nothing of it.
    def teeth(v):
        return 5.6e-16 * v * (int(1e3 * v) % 3 - 1)

    middle = 2.0003
    assert teeth(middle) != 0.0 and teeth(middle - 0.02) != 0.0
    found = polynomial(lambda v: np.array([1.0 / v, teeth(v)]), middle - 0.02, middle + 0.02)
    np.testing.assert_allclose(found.slope(middle), [-1.0 / middle**2, 0.0], rtol=1e-12, atol=0.0)


@pytest.mark.parametrize("size", [1e-15, 1e-6, 1.0])
@pytest.mark.parametrize(
    "function",
    [
        lambda v: v == 2.0,  # at the value alone
        lambda v: v > 2.0153,  # a step between the value and the end
        lambda v: v >= 2.02,  # at the end alone
        lambda v: max(v - 2.017, 0.0),  # a kink near the end
        lambda v: 2.003 < v < 2.016,  # wider than the distance of places
    ],
)
def test_what_is_left_at_once_or_for_good_is_not_taken_for_rounding(function, size):
    assert polynomial(lambda v: np.array([v, size * function(v)]), 1.98, 2.02) is None


def test_what_is_rough_everywhere_has_no_polynomial():
    assert polynomial_at(lambda v: np.array([np.sin(1e5 * v) + np.sin(1e7 * v)]), 2.0, 2.0) is None
    assert polynomial_at(lambda v: np.array([np.round(1e7 * v)]), 2.0, 2.0) is None


def test_what_is_infinite_at_some_places_has_no_polynomial_and_what_is_at_all_has_no_slope():
    assert polynomial_at(lambda v: np.array([v if round(1e9 * v) % 3 else np.inf]), 2.0, 2.0) is None
    found = polynomial_at(lambda v: np.array([np.inf, v * v]), 2.0, 2.0)
    np.testing.assert_allclose(found.slope(2.0), [0.0, 4.0], rtol=1e-13)
