"""The rational number that a floating-point one means: one that is given, and one that is computed from such ones."""

from __future__ import annotations

import math
from decimal import Decimal
from fractions import Fraction
from functools import lru_cache
from typing import Any

from eppanalysis.errors import EppError

#: Significant digits of a number that is given, at most; how far, relatively, one that is their quotient may be off.
_MOST_DIGITS, _WITHIN = 14, Fraction(1, 2**50)
#: Greatest denominator of a coefficient that is taken for a fraction rather than a decimal.
_LARGEST_DENOMINATOR = 1000
#: Relative distance within which a coefficient is taken for a simpler one.
ROUNDING = Fraction(1, 10**13)


class NotCovered(EppError):
    """Why no certificate speaks of a loop, in a sentence."""


def number_of(value: float) -> Fraction:
    """The number that a parameter of a loop means.

    One of few digits is its shortest decimal. One of more than 14 has been computed in floats, as a quotient of such
    numbers for instance: it means the fraction of smallest denominator within 2**-50 of it.

    Raises
    ------
    NotCovered
        If it is not finite.

    Examples
    --------
    >>> number_of(0.019), number_of(-0.019 / 0.0465), number_of(1.2 / 0.2)
    (Fraction(19, 1000), Fraction(-38, 93), Fraction(6, 1))
    """
    if not math.isfinite(value):
        raise NotCovered(f"A number of the loop is {value}; expected finite ones.")
    return _number_of(abs(float(value))) * (1 if value >= 0 else -1)


@lru_cache(maxsize=10_000)
def _number_of(value: float) -> Fraction:
    exact = Fraction(repr(value))
    if len(Decimal(repr(value)).normalize().as_tuple().digits) <= _MOST_DIGITS:
        return exact
    return simplest_between(exact * (1 - _WITHIN), exact * (1 + _WITHIN))


def kept(value: float) -> float:
    """The float next to the number that a float means, which means the same number again.

    Examples
    --------
    >>> kept(2.0 * 0.4000000000000001)
    0.8
    """
    while (nearest := float(number_of(value))) != value:
        value = nearest
    return value


def coefficient_of(value: Fraction) -> Fraction:
    """The number of a coefficient that was computed exactly, from floats that each are off by rounding.

    The fraction of small terms or decimal of 10 digits that it is to a part in 10**13, else its decimal of 15 digits.

    Examples
    --------
    >>> coefficient_of(Fraction(0.1 + 0.2)), coefficient_of(Fraction(2 / 3))
    (Fraction(3, 10), Fraction(2, 3))
    """
    for near in (value.limit_denominator(_LARGEST_DENOMINATOR), Fraction(f"{float(value):.10g}")):
        if abs(near - value) <= ROUNDING * abs(value):
            return near
    return Fraction(f"{float(value):.15g}")


def middle_of(ball: Any) -> Any:
    """The middle of a ball (arb) exactly, as a rational (fmpq)."""
    from flint import fmpq

    mantissa, exponent = ball.mid().man_exp()
    return fmpq(mantissa) * fmpq(2) ** int(exponent)


def simplest_between(low: Fraction, high: Fraction) -> Fraction:
    """The rational of smallest denominator in an interval, by the continued fractions of its ends.

    Examples
    --------
    >>> simplest_between(Fraction("0.3333"), Fraction("0.3334"))
    Fraction(1, 3)
    """
    if low <= 0 <= high:
        return Fraction(0)
    if high < 0:
        return -simplest_between(-high, -low)
    whole = math.floor(low)
    if whole == low or whole + 1 <= high:
        return Fraction(whole if whole == low else whole + 1)
    return whole + 1 / simplest_between(1 / (high - whole), 1 / (low - whole))
