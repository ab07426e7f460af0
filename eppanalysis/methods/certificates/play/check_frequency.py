"""Checks that Re L(j omega) > -1 at every frequency, by which a loop with play has no periodic motion but rest.

Rational arithmetic alone; why it suffices stands in docs/theory/absence_with_play.md.
"""

from __future__ import annotations

from fractions import Fraction
from typing import Any

from eppanalysis.methods.certificates.play.check_play import checked
from eppanalysis.methods.certificates.play.exact import Vector, require

FORMAT = "no periodic motion with play, by frequency, 1"


def remainder(a: Vector, b: Vector) -> Vector:
    """Of polynomials, highest power first; without leading zeros."""
    a = list(a)
    while len(a) >= len(b):
        factor = a[0] / b[0]
        a = [x - factor * y for x, y in zip(a, b + [Fraction(0)] * (len(a) - len(b)), strict=True)][1:]
    while a and a[0] == 0:
        a = a[1:]
    return a


def positive_beyond_zero(p: Vector) -> bool:
    """Whether a polynomial is positive at every x > 0: Sturm's sequence counts its zeros there."""
    while p and p[-1] == 0:
        p = p[:-1]
    if not p or p[0] <= 0:
        return False
    chain = [p, [c * (len(p) - 1 - i) for i, c in enumerate(p[:-1])]]
    while chain[-1]:
        chain.append([-c for c in remainder(chain[-2], chain[-1])])
    signs = ([q[end] > 0 for q in chain[:-1] if q[end]] for end in (-1, 0))
    at_zero, far_out = (sum(a != b for a, b in zip(s, s[1:], strict=False)) for s in signs)
    return at_zero == far_out


def frequency_bound(num: Vector, den: Vector, _: Any = None) -> None:
    """(F): |den|^2 + Re(num conj(den)) > 0 at every frequency, as a polynomial in its square."""

    def halves(p: Vector) -> tuple[Vector, Vector]:
        turned = [c * (-1) ** ((len(p) - 1 - i) // 2) for i, c in enumerate(p)]
        return turned[::-1][0::2][::-1], turned[::-1][1::2][::-1]

    def times(a: Vector, b: Vector) -> Vector:
        out = [Fraction(0)] * (len(a) + len(b) - 1) if a and b else []
        for i, x in enumerate(a):
            for j, y in enumerate(b):
                out[i + j] += x * y
        return out

    (a, b), (c, d) = halves(den), halves(num)
    parts = [times(a, a), times(b, b) + [Fraction(0)], times(a, c), times(b, d) + [Fraction(0)]]
    size = max(map(len, parts))
    padded = [[Fraction(0)] * (size - len(part)) + part for part in parts]
    p = [sum(column) for column in zip(*padded, strict=True)]
    while p and p[0] == 0:
        p = p[1:]
    require(positive_beyond_zero(p), "Re L(j omega) > -1 fails at some frequency (F)")


def check_frequency(text: str) -> str:
    """The sentence that a certificate by frequency proves; Refused, which is a ValueError, if it proves none."""
    return checked(text, FORMAT, frequency_bound)
