"""Sums of rows by vectors of eight, against numpy."""

# ruff: noqa: PLW0108  # intrinsics can be called from compiled functions only

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from numba import njit
from numpy.typing import NDArray

from eppanalysis.kernels.simd import vectors as simd

Array = NDArray[np.float64]

#: In units of rounding of the sum of the terms' absolute values.
ROUNDING = 16 * np.finfo(float).eps


@pytest.fixture(scope="module")
def kernels() -> dict[str, Callable[..., Any]]:
    """Each intrinsic in a function that can be called from here."""
    row_sum, row_sum_from, polynomial, size_sum = simd.row_sum, simd.row_sum_from, simd.polynomial, simd.size_sum
    dot, rises, value_and_slope, any_above = simd.dot, simd.rises, simd.value_and_slope, simd.any_above
    cubics_below = simd.cubics_below
    made = {
        "row_sum": lambda rows, weights, scale, out: row_sum(rows, weights, scale, out),
        "row_sum_from": lambda start, rows, weights, scale, out: row_sum_from(start, rows, weights, scale, out),
        "polynomial": lambda rows, last, u, out: polynomial(rows, last, u, out),
        "size_sum": lambda rows, last, out: size_sum(rows, last, out),
        "dot": lambda a, b: dot(a, b),
        "rises": lambda a, b: rises(a, b),
        "value_and_slope": lambda terms, u: value_and_slope(terms, u),
        "any_above": lambda row, scale, limits: any_above(row, scale, limits),
        "cubics_below": lambda a, da, s, db, third, noise, stray: cubics_below(a, da, s, db, third, noise, stray),
    }
    return {name: njit(f) for name, f in made.items()}


def numbers(seed: int, *shape: int) -> Array:
    """Numbers of many sizes, and some zeros."""
    random = np.random.default_rng(seed)
    return random.normal(size=shape) * 10.0 ** random.uniform(-3, 3, shape) * (random.random(shape) > 0.2)


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), height=st.sampled_from([8, 16, 24]), width=st.sampled_from([0, 8, 16, 40]))
def test_sums_of_rows(kernels: dict[str, Callable[..., Any]], seed: int, height: int, width: int) -> None:
    rows, weights, start = numbers(seed, height, width), numbers(seed + 1, height), numbers(seed + 2, width)
    out, largest = np.full(width, np.nan), np.abs(weights) @ np.abs(rows) + np.abs(start)
    kernels["row_sum"](rows, weights, 0.3, out)
    assert np.all(np.abs(out - 0.3 * (weights @ rows)) <= ROUNDING * largest)
    kernels["row_sum_from"](start, rows, weights, 0.3, out)
    assert np.all(np.abs(out - 0.3 * (start + weights @ rows)) <= ROUNDING * largest)


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), last=st.integers(2, 15), u=st.floats(0.0, 1.0))
def test_series(kernels: dict[str, Callable[..., Any]], seed: int, last: int, u: float) -> None:
    rows, out = numbers(seed, 16, 8), np.full(8, np.nan)
    powers = u ** np.arange(last + 1)
    kernels["polynomial"](rows, last, u, out)
    assert np.all(np.abs(out - powers @ rows[: last + 1]) <= ROUNDING * (powers @ np.abs(rows[: last + 1])))
    kernels["size_sum"](rows, last, out)
    np.testing.assert_allclose(out, np.abs(rows[1 : last + 1]).sum(axis=0), rtol=ROUNDING)


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), length=st.sampled_from([8, 16, 40]), u=st.floats(0.0, 1.0))
def test_single_rows(kernels: dict[str, Callable[..., Any]], seed: int, length: int, u: float) -> None:
    a, b = numbers(seed, length), numbers(seed + 1, length)
    sizes = np.abs(a) @ np.abs(b)
    assert abs(kernels["dot"](a, b) - a @ b) <= ROUNDING * sizes
    assert abs(kernels["rises"](a, b) - np.maximum(a * b, 0.0).sum()) <= ROUNDING * sizes
    k = np.arange(length)
    value, slope = kernels["value_and_slope"](a, u)
    assert abs(value - a @ u**k) <= ROUNDING * length * (np.abs(a) @ u**k)
    assert abs(slope - (k * a) @ u**k) <= ROUNDING * length * (np.abs(k * a) @ u**k)
    assert kernels["any_above"](a, 2.0, np.abs(b)) == bool(np.any(2.0 * np.abs(a) > np.abs(b)))


@pytest.mark.parametrize("place", [0, 7, 11])
def test_what_is_no_number_counts_as_above(kernels: dict[str, Callable[..., Any]], place: int) -> None:
    row, limits = np.zeros(16), np.ones(16)
    assert not kernels["any_above"](row, 2.0, limits)
    row[place] = np.nan
    assert kernels["any_above"](row, 2.0, limits)


@settings(max_examples=200, deadline=None)
@given(
    ends=st.tuples(st.floats(-1.0, 0.2), st.floats(-20.0, 20.0), st.floats(-1.0, 0.2), st.floats(-20.0, 20.0)),
    stray=st.floats(0.0, 0.1),
    place=st.integers(0, 7),
)
def test_curves_said_to_stay_below_zero_do(
    kernels: dict[str, Callable[..., Any]], ends: tuple[float, float, float, float], stray: float, place: int
) -> None:
    """Against the curve that strays farthest, looked at in a thousand places of a step of length 0.3."""
    h, u = 0.3, np.linspace(0.0, 1.0, 1001)[1:]
    a, da, b, db = ends
    rows = np.zeros((6, 8))
    rows[0] = -1.0
    rows[:, place] = a, da, b - a, db, 0.0, stray
    below = kernels["cubics_below"](rows[0], rows[1], rows[2], rows[3], h / 3.0, rows[4], rows[5])
    w = 1.0 - u
    cubic = w**2 * ((1 + 2 * u) * a + u * h * da) + u**2 * ((3 - 2 * u) * b - w * h * db)
    if below:
        assert np.all(cubic + 16.0 * u**2 * w**2 * stray <= 1e-15)
    elif a < 0.0 and b < 0.0:
        # What is not proven is near at least: a coefficient above zero is a value near it.
        coefficients = np.array([a + h * da / 4, (a + b) / 2 + h * (da - db) / 6 + 8 / 3 * stray, b - h * db / 4])
        assert np.max(coefficients) > -1e-15


def test_a_curve_that_starts_on_zero_and_falls_is_below_zero(kernels: dict[str, Callable[..., Any]]) -> None:
    start, rate, step, end_rate = np.zeros(8), np.full(8, -1.0), np.full(8, -0.1), np.full(8, -1.0)
    noise, stray = np.full(8, 1e-12), np.full(8, 1e-3)
    assert kernels["cubics_below"](start, rate, step, end_rate, 0.1 / 3.0, noise, stray)
    assert not kernels["cubics_below"](start, -rate, step, end_rate, 0.1 / 3.0, noise, stray)
    assert not kernels["cubics_below"](start, rate * np.nan, step, end_rate, 0.1 / 3.0, noise, stray)


def halved(eight: Array) -> float:
    """Sum of eight numbers, half on half."""
    while eight.size > 1:
        eight = eight[: eight.size // 2] + eight[eight.size // 2 :]
    return float(eight[0])


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), length=st.sampled_from([8, 16, 40]), u=st.floats(0.0, 1.0))
def test_every_product_and_every_sum_is_rounded(
    kernels: dict[str, Callable[..., Any]], seed: int, length: int, u: float
) -> None:
    """To the bit what numpy gives, which fuses nothing, in the same order: it cannot follow from what is inlined."""
    a, b, rows, out = numbers(seed, length), numbers(seed + 1, length), numbers(seed + 2, length, 8), np.empty(8)
    total = np.zeros(8)
    for x, y in zip(a.reshape(-1, 8), b.reshape(-1, 8), strict=True):
        total = x * y + total
    assert kernels["dot"](a, b) == halved(total)
    sums = np.zeros((2, 8))
    for r in range(length):
        sums[r % 2] = a[r] * rows[r] + sums[r % 2]
    kernels["row_sum"](rows, a, 0.3, out)
    np.testing.assert_array_equal(out, 0.3 * (sums[0] + sums[1]))
    upper, lower, square = rows[7], rows[6], u * u
    for k in (5, 3, 1):
        upper, lower = upper * square + rows[k], lower * square + rows[k - 1]
    kernels["polynomial"](rows, 7, u, out)
    np.testing.assert_array_equal(out, upper * u + lower)
