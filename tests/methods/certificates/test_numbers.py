"""Which rational a float stands for: what was meant is found again, however it was rounded."""

from __future__ import annotations

from fractions import Fraction

import pytest
from hypothesis import given, strategies as st

from eppanalysis.methods.certificates.numbers import NotCovered, coefficient_of, number_of, simplest_between
from eppanalysis.methods.certificates.orbits.modes import rational

flint = pytest.importorskip("flint")


@given(top=st.integers(1, 999), bottom=st.integers(1, 999), power=st.integers(-6, 6))
def test_quotients_of_short_decimals_come_back(top: int, bottom: int, power: int) -> None:
    exact = Fraction(top, bottom) * Fraction(10) ** power
    assert number_of(float(Fraction(top) * Fraction(10) ** power) / bottom) == exact


@given(value=st.floats(1e-300, 1e300))
def test_a_fraction_is_next_to_its_float(value: float) -> None:
    found = number_of(value)
    assert abs(found / Fraction(value) - 1) < Fraction(1, 2**49)
    assert rational(-value) == -rational(value)


def test_short_decimals_are_themselves_and_infinity_is_refused() -> None:
    assert number_of(0.1) == Fraction(1, 10)
    assert number_of(12345678.901234) == Fraction("12345678.901234")
    assert rational(-2.5e-3) == flint.fmpq(-1, 400)
    with pytest.raises(NotCovered, match="inf"):
        rational(float("inf"))


@given(st.fractions(min_value=-100, max_value=100, max_denominator=50))
def test_simple_rationals_are_found_again(value: Fraction) -> None:
    near, within = Fraction(float(value)), Fraction(1, 10**9)
    assert simplest_between(near - within, near + within) == value
    assert coefficient_of(near) == number_of(float(value)) == value


@given(st.decimals(min_value=-100, max_value=100, places=8), st.integers(-3, 3))
def test_decimals_of_few_digits_are_found_again_beside_rounding(value, ulps: int) -> None:
    exact = Fraction(value)
    assert coefficient_of(Fraction(float(value)) * (1 + ulps * Fraction(1, 2**52))) == exact
    assert number_of(float(value)) == exact
