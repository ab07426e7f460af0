"""Roots and minima of many functions at once, against closed forms."""

from __future__ import annotations

import numpy as np

from eppanalysis.roots import between, least


def test_roots_of_many_functions_are_found_to_rounding():
    """Steep, flat and with one end far nearer to the root than the other; a bracket without a change has none."""
    level = np.array([1e-8, 2.0, 3e5, -1.0])
    roots = between(lambda x, i: x**3 - level[i], np.zeros(4), np.full(4, 1e3))
    np.testing.assert_allclose(roots[:3], np.cbrt(level[:3]), rtol=4e-16)
    assert np.isnan(roots[3])


def test_a_root_at_an_end_and_a_jump():
    ends = between(lambda x, i: np.where(i == 0, x, np.sign(x - 0.3)), np.zeros(2), np.ones(2))
    assert ends[0] == 0.0 and abs(ends[1] - 0.3) < 1e-12


def test_roots_of_smooth_functions_take_few_values():
    counted = []

    def f(x, i):
        counted.append(x.size)
        return np.array([np.exp(x) - 3.0, np.arctan(x - 1.3), x**5 - 7.0])[i, np.arange(x.size)]

    roots = between(f, np.zeros(3), np.full(3, 2.0))
    np.testing.assert_allclose(roots, [np.log(3.0), 1.3, 7.0**0.2], rtol=4e-16)
    assert len(counted) <= 13


def test_minima_are_bracketed_until_they_are_not_wanted_any_more():
    place = np.array([0.1, 0.7])
    x = np.array([[0.0, 0.0], [0.5, 0.5], [1.0, 1.0]])

    def f(at, i):
        return np.abs(at - place[i])

    y = np.array([f(row, np.arange(2)) for row in x])
    at, value = least(f, x, y, lambda x, _: x[2] - x[0] > 1e-10)
    np.testing.assert_allclose(at, place, atol=1e-10)
    assert np.array_equal(value, f(at, np.arange(2))) and x[1, 0] == 0.5
    first, _ = least(f, x, y, lambda _, y: y[1] > 0.35)
    assert first[1] == 0.5 and abs(first[0] - 0.1) < 0.36
