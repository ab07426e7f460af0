"""Sums of rows, eight numbers at a time, against numpy."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from numpy.typing import NDArray

from eppanalysis.engine._engine import parts

Array = NDArray[np.float64]

#: In units of rounding of the sum of the terms' absolute values.
ROUNDING = 16 * np.finfo(float).eps


def numbers(seed: int, *shape: int) -> Array:
    """Numbers of many sizes, and some zeros."""
    random = np.random.default_rng(seed)
    return random.normal(size=shape) * 10.0 ** random.uniform(-3, 3, shape) * (random.random(shape) > 0.2)


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), height=st.sampled_from([8, 16, 24]), width=st.sampled_from([0, 8, 16, 40]))
def test_sums_of_rows(seed: int, height: int, width: int) -> None:
    rows, weights, start = numbers(seed, height, width), numbers(seed + 1, height), numbers(seed + 2, width)
    out, largest = np.full(width, np.nan), np.abs(weights) @ np.abs(rows) + np.abs(start)
    parts.row_sum(rows, weights, 0.3, out)
    assert np.all(np.abs(out - 0.3 * (weights @ rows)) <= ROUNDING * largest)
    parts.row_sum_from(start, rows, weights, 0.3, out)
    assert np.all(np.abs(out - 0.3 * (start + weights @ rows)) <= ROUNDING * largest)


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), last=st.integers(2, 15), u=st.floats(0.0, 1.0))
def test_series(seed: int, last: int, u: float) -> None:
    rows, out = numbers(seed, 16, 8), np.full(8, np.nan)
    powers = u ** np.arange(last + 1)
    parts.polynomial(rows, last, u, out)
    assert np.all(np.abs(out - powers @ rows[: last + 1]) <= ROUNDING * (powers @ np.abs(rows[: last + 1])))
    parts.size_sum(rows, last, out)
    np.testing.assert_allclose(out, np.abs(rows[1 : last + 1]).sum(axis=0), rtol=ROUNDING)


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), length=st.sampled_from([8, 16, 40]), u=st.floats(0.0, 1.0))
def test_single_rows(seed: int, length: int, u: float) -> None:
    a, b = numbers(seed, length), numbers(seed + 1, length)
    sizes = np.abs(a) @ np.abs(b)
    assert abs(parts.dot(a, b) - a @ b) <= ROUNDING * sizes
    assert abs(parts.rises(a, b) - np.maximum(a * b, 0.0).sum()) <= ROUNDING * sizes
    k = np.arange(length)
    value, slope = parts.value_and_slope(a, u)
    assert abs(value - a @ u**k) <= ROUNDING * length * (np.abs(a) @ u**k)
    assert abs(slope - (k * a) @ u**k) <= ROUNDING * length * (np.abs(k * a) @ u**k)
    assert parts.any_above(a, 2.0, np.abs(b)) == bool(np.any(2.0 * np.abs(a) > np.abs(b)))


@pytest.mark.parametrize("place", [0, 7, 11])
def test_what_is_no_number_counts_as_above(place: int) -> None:
    row, limits = np.zeros(16), np.ones(16)
    assert not parts.any_above(row, 2.0, limits)
    row[place] = np.nan
    assert parts.any_above(row, 2.0, limits)


@settings(max_examples=200, deadline=None)
@given(
    ends=st.tuples(st.floats(-1.0, 0.2), st.floats(-20.0, 20.0), st.floats(-1.0, 0.2), st.floats(-20.0, 20.0)),
    stray=st.floats(0.0, 0.1),
    place=st.integers(0, 7),
)
def test_curves_said_to_stay_below_zero_do(ends: tuple[float, float, float, float], stray: float, place: int) -> None:
    """Against the curve that strays farthest, looked at in a thousand places of a step of length 0.3."""
    h, u = 0.3, np.linspace(0.0, 1.0, 1001)[1:]
    a, da, b, db = ends
    rows = np.zeros((6, 8))
    rows[0] = -1.0
    rows[:, place] = a, da, b - a, db, 0.0, stray
    below = parts.cubics_below(rows[0], rows[1], rows[2], rows[3], h / 3.0, rows[4], rows[5])
    w = 1.0 - u
    cubic = w**2 * ((1 + 2 * u) * a + u * h * da) + u**2 * ((3 - 2 * u) * b - w * h * db)
    if below:
        assert np.all(cubic + 16.0 * u**2 * w**2 * stray <= 1e-15)
    elif a < 0.0 and b < 0.0:
        # What is not proven is near at least: a coefficient above zero is a value near it.
        coefficients = np.array([a + h * da / 4, (a + b) / 2 + h * (da - db) / 6 + 8 / 3 * stray, b - h * db / 4])
        assert np.max(coefficients) > -1e-15


def test_a_curve_that_starts_on_zero_and_falls_is_below_zero() -> None:
    start, rate, step, end_rate = np.zeros(8), np.full(8, -1.0), np.full(8, -0.1), np.full(8, -1.0)
    noise, stray = np.full(8, 1e-12), np.full(8, 1e-3)
    assert parts.cubics_below(start, rate, step, end_rate, 0.1 / 3.0, noise, stray)
    assert not parts.cubics_below(start, -rate, step, end_rate, 0.1 / 3.0, noise, stray)
    assert not parts.cubics_below(start, rate * np.nan, step, end_rate, 0.1 / 3.0, noise, stray)


def halved(eight: Array) -> float:
    """Sum of eight numbers, half on half."""
    while eight.size > 1:
        eight = eight[: eight.size // 2] + eight[eight.size // 2 :]
    return float(eight[0])


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), length=st.sampled_from([8, 16, 40]), u=st.floats(0.0, 1.0))
def test_every_product_and_every_sum_is_rounded(seed: int, length: int, u: float) -> None:
    """To the bit what numpy gives, which fuses nothing, in the same order: it cannot follow from what is inlined."""
    a, b, rows, out = numbers(seed, length), numbers(seed + 1, length), numbers(seed + 2, length, 8), np.empty(8)
    total = np.zeros(8)
    for x, y in zip(a.reshape(-1, 8), b.reshape(-1, 8), strict=True):
        total = x * y + total
    assert parts.dot(a, b) == halved(total)
    sums = np.zeros((2, 8))
    for r in range(length):
        sums[r % 2] = a[r] * rows[r] + sums[r % 2]
    parts.row_sum(rows, a, 0.3, out)
    np.testing.assert_array_equal(out, 0.3 * (sums[0] + sums[1]))
    upper, lower, square = rows[7], rows[6], u * u
    for k in (5, 3, 1):
        upper, lower = upper * square + rows[k], lower * square + rows[k - 1]
    parts.polynomial(rows, 7, u, out)
    np.testing.assert_array_equal(out, upper * u + lower)


def sparse_sum_of(start: Array, entries: Array, rows: Array, ends: Array, weights: Array, scale: float) -> Array:
    """In the engine's order: of eight columns four rows beside each other."""
    out, begin = np.empty(8 * ends.size), 0
    for block, end in enumerate(ends):
        sums = [start[8 * block : 8 * block + 8].copy(), *np.zeros((3, 8))]
        for k in range(begin, end):
            sums[k % 4] = weights[rows[k]] * entries[k] + sums[k % 4]
        begin = end
        out[8 * block : 8 * block + 8] = scale * ((sums[0] + sums[1]) + (sums[2] + sums[3]))
    return out


@pytest.mark.parametrize("share", [0.0, 0.05, 0.5, 1.0])
@pytest.mark.parametrize("shape", [(24, 24), (64, 8), (8, 40)])
def test_sums_over_what_is_not_zero(shape: tuple[int, int], share: float) -> None:
    random = np.random.default_rng([*shape, int(100 * share)])
    M = random.normal(size=shape) * (random.random(shape) < share)
    weights, start = random.normal(size=shape[0]), random.normal(size=shape[1])
    most = shape[0] * shape[1] // 8
    kept = np.full((most, 8), np.nan), np.zeros(most, np.int64), np.zeros(shape[1] // 8, np.int64)
    parts.keep_sparse(M, *kept)
    largest, out, none = np.abs(weights) @ np.abs(M) + np.abs(start), np.full(shape[1], np.nan), np.zeros(shape[1])
    parts.sparse_sum(*kept, weights, 0.3, out, False)
    assert np.all(np.abs(out - 0.3 * (weights @ M)) <= ROUNDING * largest)
    np.testing.assert_array_equal(out, sparse_sum_of(none, *kept, weights, 0.3))
    parts.sparse_sum(*kept, weights, 0.3, out, True)
    assert np.all(np.abs(out - 0.3 * (weights @ np.abs(M))) <= ROUNDING * largest)
    np.testing.assert_array_equal(out, sparse_sum_of(none, np.abs(kept[0]), *kept[1:], weights, 0.3))
    parts.sparse_sum_from(start, *kept, weights, 0.3, out)
    assert np.all(np.abs(out - 0.3 * (start + weights @ M)) <= ROUNDING * largest)
    np.testing.assert_array_equal(out, sparse_sum_of(start, *kept, weights, 0.3))
