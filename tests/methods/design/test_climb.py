"""The climb against optima known in closed form: smooth ones, where two functions meet, and at the end of a range."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from eppanalysis.arrays import Array
from eppanalysis.methods.design.climb import Slope, climb


def top_of(values, slopes, start: Array) -> Slope:
    """The top of the least of functions."""

    def ask(place: Array) -> Slope:
        known = [f(place) for f in values]
        i = int(np.argmin(known))
        return Slope(place, float(known[i]), np.asarray(slopes[i](place), float))

    return climb(ask, ask(start), 0.1, 1e-6, 300)


@pytest.mark.slow
@settings(max_examples=30, deadline=None)
@given(st.lists(st.floats(0.05, 0.95), min_size=2, max_size=3), st.floats(0.1, 0.9))
def test_a_smooth_top_is_found(top: list[float], start: float) -> None:
    centre, weight = np.array(top), 1.0 + np.arange(len(top))
    found = top_of(
        [lambda p: 1.0 - float(weight @ (p - centre) ** 2)],
        [lambda p: -2.0 * weight * (p - centre)],
        np.full(len(top), start),
    )
    assert found.value == pytest.approx(1.0, abs=1e-4)


@settings(max_examples=30, deadline=None)
@given(st.floats(0.2, 0.8), st.floats(0.5, 20.0), st.floats(0.5, 20.0))
def test_a_ridge_where_two_functions_meet_is_found(meet: float, up: float, down: float) -> None:
    found = top_of(
        [lambda p: 5.0 + up * (p[0] - meet), lambda p: 5.0 - down * (p[0] - meet)],
        [lambda p: [up], lambda p: [-down]],
        np.array([0.05]),
    )
    assert found.place[0] == pytest.approx(meet, abs=1e-4)


def test_the_end_of_a_range_is_a_top() -> None:
    found = top_of([lambda p: p[0] - 2.0 * p[1]], [lambda p: [1.0, -2.0]], np.array([0.5, 0.5]))
    assert found.place.tolist() == [1.0, 0.0]


def test_where_nothing_is_known_the_reach_shrinks() -> None:
    """Beyond 0.7 nothing is feasible: the top is found at the rim."""

    def ask(place: Array) -> Slope | None:
        return Slope(place, float(place[0]), np.ones(1)) if place[0] <= 0.7 else None

    start = ask(np.array([0.2]))
    assert start is not None
    assert climb(ask, start, 0.1, 1e-6, 300).value == pytest.approx(0.7, abs=1e-4)
