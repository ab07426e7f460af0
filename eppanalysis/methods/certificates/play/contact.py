"""The poles that make the contact coordinates of a loop with play: rationals on which the proof by sectors rests."""

from __future__ import annotations

from fractions import Fraction

import numpy as np

from eppanalysis.methods.certificates.numbers import simplest_between
from eppanalysis.methods.certificates.play.program import Vector


def contact_poles(nums: list[Vector], den: Vector) -> tuple[list[Vector], str]:
    """Choices of the poles that make the contact coordinates, one less than the order; or why there are none.

    They are the same for both numerators that end a range.

    The signs at a release are known for real poles only: see docs/theory/proofs.md, "Contact coordinates".
    """
    order = len(den) - 1
    if order not in (2, 3):
        return [], f"the linear part is of order {order}, and sectors cover orders 2 and 3"
    if order == 3 and max(map(len, nums)) > 2:
        return [], "the linear part is of third order and has two zeros, and sectors cover one"
    roots = np.roots([float(c) for c in den])
    if np.any(np.abs(roots.imag) > 1e-9 * np.max(np.abs(roots))) or np.any(roots.real > 0):
        return [], "sectors need a linear part with real poles, none of them unstable"
    if not any(den[-2:]):
        return [], "the linear part has two integrators, and sectors cover one"
    if order == 2:
        return [[_slower_pole(den)]], ""
    exact = (_exact_pole(den, root) for root in sorted(-roots.real))
    first = next((pole for pole in exact if pole is not None), None)
    if first is None:
        return [], "no pole of the linear part is a rational of few digits"
    return _with_second(nums, den, first)


def _with_second(nums: list[Vector], den: Vector, first: Fraction) -> tuple[list[Vector], str]:
    """Of third order, with the first pole: the second as slow as the zero allows; with a zero the fast one, too.

    The slow one tells most of a release, the fast one of a turning point.
    """
    d1, d2 = den[1:3]
    rest = [Fraction(1), d1 - first, d2 - first * (d1 - first)]
    slow = _slower_pole(rest)
    fast, second = rest[1] - slow, slow
    # The last input, (n1 m3 - n0)/c^2, must not be positive, so that m3 is at most n0/n1
    # (docs/theory/proofs.md, Contact coordinates).
    with_zero = [num for num in nums if len(num) == 2]
    second = max([slow, *(rest[1] - num[1] / num[0] for num in with_zero if num[0] > 0)])
    choices = [[first, pole] for pole in dict.fromkeys((second, fast) if with_zero else (second,))]

    def fits(pole: Fraction) -> bool:
        return _value(rest, -pole) <= 0 >= max(_last_input(num, rest[1] - pole) for num in nums)

    kept = [poles for poles in choices if fits(poles[1])]
    return kept, "" if kept else "the zero of the linear part is slower than its poles, or its gain is not positive"


def _last_input(numerator: Vector, faster: Fraction) -> Fraction:
    """What moves the last contact coordinate, times a positive number: it must not be positive."""
    return (numerator[0] * faster if len(numerator) == 2 else 0) - numerator[-1]


def _value(p: Vector, x: Fraction) -> Fraction:
    out = Fraction(0)
    for c in p:
        out = out * x + c
    return out


def _exact_pole(den: Vector, root: float) -> Fraction | None:
    """The pole -x near a root, if a simple rational is one exactly."""
    near = Fraction(root)
    for within in (abs(near) * Fraction(1, 10**8), Fraction(1, 10**8)):
        found = simplest_between(near - within, near + within)
        if found >= 0 and _value(den, -found) == 0:
            return found
    return None


def _slower_pole(quadratic: Vector) -> Fraction:
    """The slower pole of two, or a rational a little faster, where s^2 + ... is not positive."""
    slow, fast = sorted(-np.roots([float(c) for c in quadratic]).real)
    exact = _exact_pole(quadratic, slow)
    low, wide = Fraction(slow), Fraction(fast) - Fraction(slow)
    return exact if exact is not None else simplest_between(low + wide / 10**6, low + wide / 10**5)
