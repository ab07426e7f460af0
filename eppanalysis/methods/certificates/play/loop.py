"""The loop that a certificate is about: its transfer function in rationals, and poles that make contact coordinates."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from math import ceil, comb, floor

import numpy as np

from eppanalysis.errors import ModelError
from eppanalysis.models.elements.memory import Play
from eppanalysis.models.systems.lure import LureSystem

#: Within this share, a coefficient in floating point is taken for the simplest rational near it.
NEAR = Fraction(1, 10**12)
_MOST_ORDER = 12


@dataclass(frozen=True)
class RationalLoop:
    """The loop u = -L(s) w + constant with w the play of u.

    Attributes
    ----------
    numerator, denominator : tuple of Fraction
        Of L, highest power first; the denominator is monic and has all poles of the linear part.
    deviation : float
        By which a coefficient differs most from that of the loop in floating point, as a share of its size;
        what is rounding beside the poles and the gain counts as zero.
    """

    numerator: tuple[Fraction, ...]
    denominator: tuple[Fraction, ...]
    deviation: float

    @property
    def order(self) -> int:
        """Number of poles."""
        return len(self.denominator) - 1


def simplest_between(low: Fraction, high: Fraction) -> Fraction:
    """The rational of smallest denominator in an interval.

    Examples
    --------
    >>> simplest_between(Fraction("0.3333"), Fraction("0.3334"))
    Fraction(1, 3)
    """
    if low <= 0 <= high:
        return Fraction(0)
    if high < 0:
        return -simplest_between(-high, -low)
    whole = ceil(low)
    if whole <= high:
        return Fraction(whole)
    return floor(low) + 1 / simplest_between(1 / (high - floor(low)), 1 / (low - floor(low)))


def _transfer_function(system: LureSystem) -> tuple[list[Fraction], list[Fraction]]:
    """C adj(sI - A) B and det(sI - A) by Leverrier's recursion, exactly those of the system's floats."""
    n = system.A.shape[0]
    A = [[Fraction(x) for x in row] for row in system.A.tolist()]
    b, c = ([Fraction(x) for x in side.ravel().tolist()] for side in (system.B, system.C))
    den, num, state = [Fraction(1)], [], [[Fraction(int(i == j)) for j in range(n)] for i in range(n)]
    for k in range(1, n + 1):
        num.append(sum((c[i] * state[i][j] * b[j] for i in range(n) for j in range(n)), Fraction(0)))
        moved = [[sum((A[i][m] * state[m][j] for m in range(n)), Fraction(0)) for j in range(n)] for i in range(n)]
        den.append(-sum((moved[i][i] for i in range(n)), Fraction(0)) / k)
        state = [[moved[i][j] + (den[-1] if i == j else 0) for j in range(n)] for i in range(n)]
    return num, den


def rational_loop(system: LureSystem) -> RationalLoop:
    """The loop in rationals that its floating-point numbers stand for.

    Raises
    ------
    ModelError
        If the loop is not one play with a gap round a strictly proper linear part in continuous time without dead time.
    """
    _require_one_play(system)
    num, den = _transfer_function(system)
    n = len(den) - 1
    # What a coefficient is made of: products of so many poles; what is far smaller than they are is rounding.
    size = Fraction(float(np.max(np.abs(np.linalg.eigvals(system.A)), initial=0.0)))
    whole = [NEAR * comb(n, k) * size**k for k in range(n + 1)]
    scale = Fraction(float(np.linalg.norm(system.B) * np.linalg.norm(system.C)))
    gain = [scale * comb(n, k) * size**k for k in range(n)]
    den_near = [_near(x, max(NEAR * abs(x), w / 100)) for x, w in zip(den, whole, strict=True)]
    num_near = [-_near(x, max(NEAR * abs(x), NEAR * g / 100)) for x, g in zip(num, gain, strict=True)]
    pairs = [*zip(den, den_near, strict=True), *zip([-x for x in num], num_near, strict=True)]
    deviation = max((float(abs(a - b) / abs(a)) for a, b in pairs if b), default=0.0)
    while len(num_near) > 1 and num_near[0] == 0:
        num_near.pop(0)
    return RationalLoop(tuple(num_near), tuple(den_near), deviation)


def _near(value: Fraction, within: Fraction) -> Fraction:
    return simplest_between(value - within, value + within)


def _require_one_play(system: LureSystem) -> None:
    """Refuse loops that the certificates do not cover."""
    kinds = ", ".join(type(element).__name__ for element in system.elements) or "none"
    n = system.A.shape[0]
    refusals = (
        (len(system.elements) != 1 or not isinstance(system.elements[0], Play), kinds, "elements", "one Play"),
        (system.time_step is not None, system.time_step, "time_step", "continuous time"),
        (bool(np.any(system.delays)), system.delays.tolist(), "delays", "no dead time"),
        (bool(np.any(system.D)), system.D.tolist(), "D", "a strictly proper linear part"),
        (not 1 <= n <= _MOST_ORDER, n, "A", f"1 to {_MOST_ORDER} states"),
    )
    for wrong, value, field, expected in refusals:
        if wrong:
            raise ModelError(f"{system.name}: a certificate of absence", value, expected, field=field)
    gap = float(getattr(system.elements[0], "gap", 0.0))
    if gap <= 0.0:
        raise ModelError(f"{system.name}: a certificate of absence", gap, "a gap above zero", field="gap")


def contact_poles(loop: RationalLoop) -> tuple[list[list[Fraction]], str]:
    """Choices of the poles that make the contact coordinates, one less than the order; or why there are none.

    The signs at a release are known for real poles only: see docs/theory/absence_with_play.md.
    """
    if loop.order not in (2, 3):
        return [], f"the linear part is of order {loop.order}, and sectors cover orders 2 and 3"
    if loop.order == 3 and len(loop.numerator) > 2:
        return [], "the linear part is of third order and has two zeros, and sectors cover one"
    roots = np.roots([float(c) for c in loop.denominator])
    if np.any(np.abs(roots.imag) > 1e-9 * np.max(np.abs(roots))) or np.any(roots.real > 0):
        return [], "sectors need a linear part with real poles, none of them unstable"
    if loop.order == 2:
        return [[_slower_pole(loop.denominator)]], ""
    exact = (_exact_pole(loop.denominator, root) for root in sorted(-roots.real))
    first = next((pole for pole in exact if pole is not None), None)
    if first is None:
        return [], "no pole of the linear part is a rational of few digits"
    return _with_second(loop, first)


def _with_second(loop: RationalLoop, first: Fraction) -> tuple[list[list[Fraction]], str]:
    """Of third order, with the first pole: the second as slow as the zero allows; with a zero the fast one, too.

    The slow one tells most of a release, the fast one of a turning point.
    """
    d1, d2 = loop.denominator[1:3]
    rest = (Fraction(1), d1 - first, d2 - first * (d1 - first))
    slow = _slower_pole(rest)
    fast, second = rest[1] - slow, slow
    if len(loop.numerator) == 2 and loop.numerator[0] > 0:
        second = max(slow, rest[1] - loop.numerator[1] / loop.numerator[0])
    choices = [[first, pole] for pole in dict.fromkeys((second, fast) if len(loop.numerator) == 2 else (second,))]
    kept = [
        poles for poles in choices if _value(rest, -poles[1]) <= 0 >= _last_input(loop.numerator, rest[1] - poles[1])
    ]
    return kept, "" if kept else "the zero of the linear part is slower than its poles, or its gain is not positive"


def _last_input(numerator: tuple[Fraction, ...], faster: Fraction) -> Fraction:
    """What moves the last contact coordinate, times a positive number: it must not be positive."""
    return (numerator[0] * faster if len(numerator) == 2 else 0) - numerator[-1]


def _value(p: tuple[Fraction, ...], x: Fraction) -> Fraction:
    out = Fraction(0)
    for c in p:
        out = out * x + c
    return out


def _exact_pole(den: tuple[Fraction, ...], root: float) -> Fraction | None:
    """The pole -x near a root, if a simple rational is one exactly."""
    near = Fraction(root)
    for within in (abs(near) * Fraction(1, 10**8), Fraction(1, 10**8)):
        found = _near(near, within)
        if found >= 0 and _value(den, -found) == 0:
            return found
    return None


def _slower_pole(quadratic: tuple[Fraction, ...]) -> Fraction:
    """The slower pole of two, or a rational a little faster, where s^2 + ... is not positive."""
    slow, fast = sorted(-np.roots([float(c) for c in quadratic]).real)
    exact = _exact_pole(quadratic, slow)
    low, wide = Fraction(slow), Fraction(fast) - Fraction(slow)
    return exact if exact is not None else simplest_between(low + wide / 10**6, low + wide / 10**5)
