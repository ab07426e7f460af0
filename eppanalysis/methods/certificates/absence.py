"""Finds a certificate of absence: the multiplier with which Popov's criterion, or the circle criterion, holds.

One multiplier serves one loop, or all loops of a range or box.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import partial
from itertools import accumulate, zip_longest
from math import comb
from typing import Any

import numpy as np

from eppanalysis.methods.certificates import check_absence
from eppanalysis.methods.certificates.check_absence import (
    Refused,
    added,
    coefficients,
    dead_times,
    holds,
    linear_parts,
    number,
    sector,
    times,
)
from eppanalysis.methods.certificates.numbers import ROUNDING, middle_of, simplest_between
from eppanalysis.methods.certificates.registry import sealed

Polynomial = list[Fraction]
#: Numerators and denominators of one loop, or of those at the corners of a box.
Corners = list[tuple[Polynomial, Polynomial]]
#: Least and greatest y/x; without the one there is no bound, without both nothing is known of the element.
Sector = tuple[Fraction | None, Fraction | None]


@dataclass(frozen=True)
class Linear:
    """Linear parts at the corners, on the axis of s; how large their coefficients are there, the least degree, and dead
    times from and to.
    """

    corners: Corners
    sizes: tuple[Polynomial, Polynomial]
    degree: int
    late: tuple[Fraction, Fraction] | None

    @classmethod
    def of(cls, loop: Mapping[str, Any]) -> Linear:
        """Those of a loop; of samples each coefficient is rounded as those of z are that it is the sum of."""
        corners, degree = linear_parts(loop)
        rows = [[[number(c) for c in row[::-1]] for row in loop[name]] for name in ("num", "den")]
        sized = _greatest if loop["time_step"] is None else partial(_greatest_of_samples, degree)
        nums, dens = map(sized, rows)
        return cls(corners, (nums, dens), degree, dead_times(loop))


def _greatest(rows: Sequence[Polynomial]) -> Polynomial:
    """How large each coefficient is among several polynomials."""
    return [max(map(abs, c)) for c in zip_longest(*rows, fillvalue=Fraction(0))]


def _greatest_of_samples(degree: int, rows: Sequence[Polynomial]) -> Polynomial:
    """The same on the axis of s, where integrators, which are exact, stay so: roots at z = 1 are ones at s = 0."""
    integrators = 0
    while all(sum(row) == 0 for row in rows):
        rows = [list(accumulate(row[:0:-1]))[::-1] for row in rows]  # divided by z - 1
        integrators += 1
    most = sum(_greatest(rows)) * 2**integrators
    return [Fraction(0)] * integrators + [most * comb(degree - integrators, k) for k in range(degree - integrators + 1)]


#: How far beyond all turning points the ends of the frequency axis are looked at, as a factor.
_FAR = Fraction(10) ** 20
#: Behind dead time: frequencies of a grid, and how far it goes beyond all scales, as a factor.
_GRID, _WIDE = 2000, 300.0


def find(loop: Mapping[str, Any], sectors: int) -> dict[str, Any] | str:
    """The certificate that a loop has no periodic motion but rest, or why it is not decided.

    Parameters
    ----------
    loop : mapping
        As :func:`~eppanalysis.methods.certificates.rational.rational_loop` gives it, but for lists of numerators and
        denominators: one, or those at the corners of a box; or as
        :func:`~eppanalysis.methods.certificates.elbow.find.rational_elbow` does.
    sectors : int
        For play, of which no criterion holds: most sectors of a quarter plane in which a function is quadratic.

    Returns
    -------
    dict or str
        Plain data: statement, loop, claim, evidence; or a sentence.
    """
    if "element" not in loop:
        from eppanalysis.methods.certificates.elbow.find import find as find_weights

        return find_weights(loop)
    reason = _not_covered(loop)
    if reason:
        return reason
    try:
        linear = Linear.of(loop)
    except Refused as error:
        return f"{error}."
    edges, reason = _sector(loop, linear)
    # With memory the integral of w dx/dt over a period need not vanish, nor need its sum over samples.
    circle = loop["element"]["kind"] == "play" or loop["time_step"] is not None
    multiplier = None if reason else _multiplier(linear, edges, circle)
    if multiplier is None and not circle and not linear.late:
        edges, multiplier = (None, None), _sign(linear)
    if multiplier is None:
        return _otherwise(loop, sectors, reason)
    polynomials = coefficients(linear.corners, edges, multiplier, linear.late)
    return sealed(
        {
            "statement": check_absence.STATEMENT,
            "loop": dict(loop),
            "claim": {
                "sector": [None if edge is None else str(edge) for edge in edges],
                "multiplier": str(multiplier),
            },
            "evidence": {
                "multiplier": str(multiplier),
                "polynomials": [[str(c) for c in polynomial[::-1]] for polynomial in polynomials],
            },
        }
    )


def _otherwise(loop: Mapping[str, Any], sectors: int, reason: str) -> dict[str, Any] | str:
    """What proves absence where no criterion does, or why nothing does."""
    if loop["element"]["kind"] == "play" and not reason:
        return _by_sectors(loop, sectors)
    if reason:
        return reason
    low, high = sector(loop["element"])
    shown = f"{float(low):.6g} to {'infinity' if high is None else f'{float(high):.6g}'}"
    sampled, late = loop["time_step"] is not None, dead_times(loop)
    fails = "the circle criterion fails" if sampled else "neither the circle criterion nor Popov's holds"
    why = f"{fails} for the sector from {shown}, so absence is undecided"
    if len(loop["num"]) > 1 or sampled or late:
        return f"{why}."
    from eppanalysis.methods.certificates.cells.find import find as find_cells

    found = find_cells({**loop, **{name: loop[name][0] for name in ("num", "den")}})
    return found if not isinstance(found, str) else f"{why}{found}."


def _by_sectors(loop: Mapping[str, Any], sectors: int) -> dict[str, Any] | str:
    """The certificate of a loop with play by a function that falls, or why there is none."""
    from eppanalysis.methods.certificates.play.find import find as find_function

    rational = loop["time_step"] is None and not dead_times(loop)
    none = "functions that fall are sought in continuous time without dead time."
    found = find_function(loop, sectors) if rational else none
    if isinstance(found, str):
        return f"Re G(jω) > -1 fails at some frequency, and {found} There may be a cycle or none."
    return found


def _not_covered(loop: Mapping[str, Any]) -> str:
    """Which hypothesis of all criteria a loop does not meet; empty where it meets all."""
    if not all(any(number(c) for c in row) for row in loop["num"]):
        return "the element's output does not reach its input."
    if max(map(len, loop["num"])) >= min(map(len, loop["den"])):
        return "the linear part passes its input straight through."
    if loop["element"]["kind"] not in check_absence.ELEMENTS:
        return f"{loop['element']['kind']}: the criteria are those of memoryless elements, and of play."
    return ""


def _sector(loop: Mapping[str, Any], linear: Linear) -> tuple[Sector, str]:
    """The sector of the element, and why the criteria that need one do not cover it; empty where they do."""
    try:
        low, high = sector(loop["element"])
    except Refused as error:
        return (None, None), f"{error}: the criteria are those of memoryless elements in a sector, and of play."
    if low is None or low == high:
        return (None, None), "the element lies in no sector, or is linear."
    if linear.late and high is None:
        return (None, None), "behind dead time the criteria need a sector that is bounded, and this one is not."
    # The criteria know the loop by what the element sees: an integrator that cancels is beyond them
    # (docs/theory/proofs.md, No periodic motion).
    lasts = [[p[0] if p else Fraction(0) for p in row] for row in zip(*linear.corners, strict=True)]
    seen = any(min(row) > 0 or max(row) < 0 for row in lasts) or loop["element"]["kind"] == "play"
    # Of an element of many pieces the edges are quotients of thousands of digits: they may be a little farther out.
    low = simplest_between(low - ROUNDING * abs(low), low)
    high = None if high is None else simplest_between(high, high + ROUNDING * abs(high))
    return (low, high), "" if seen else "the element does not see an integrator of the loop."


def _multiplier(linear: Linear, edges: Sector, circle: bool) -> Fraction | None:
    """A multiplier with which the criterion holds, the circle criterion's zero first; None where none was found.

    Where the circle criterion alone holds there is none but zero.
    """
    if _holds(linear, edges, Fraction(0)):
        return Fraction(0)
    if circle:
        return None
    # The criterion is linear in its multiplier: two of them give the polynomial of any (docs/theory/proofs.md, No
    # periodic motion).
    circles, tilted = (coefficients(linear.corners, edges, Fraction(r), linear.late) for r in (0, 1))
    tilts = [added(tilt, circle, Fraction(-1)) for tilt, circle in zip(tilted, circles, strict=True)]
    bounds = _exact_bounds(circles, tilts) if not linear.late else _bounds_behind(circles, tilts, linear.late)
    return next((r for r in _between(*bounds) if _holds(linear, edges, r)), None)


def _sign(linear: Linear) -> Fraction | None:
    """The sign of Re(j omega G) where it is the same at all frequencies."""
    return next((r for r in (Fraction(1), Fraction(-1)) if _holds(linear, (None, None), r)), None)


def _holds(linear: Linear, edges: Sector, multiplier: Fraction) -> bool:
    """Whether the criterion holds for all linear parts that are the stated ones but for rounding of coefficients.

    A mode without damping that the element does not see cancels in G exactly, and after rounding hardly.
    """
    low, high = edges
    sizes, dens = linear.sizes
    dens = added(dens, sizes, abs(low or Fraction(0)))
    terms = times([Fraction(low is not None), abs(multiplier)], times(sizes, dens))
    if high is not None and low is not None:
        terms = added(terms, times(dens, dens), 1 / (high - low))
    # Each term has two rounded coefficients; those of omega squared come from even powers.
    room = [3 * ROUNDING * c for c in terms[::2]]
    left = coefficients(linear.corners, edges, multiplier, linear.late)
    if linear.late:  # odd powers count, too, each with a sine, which is no more than its angle
        room = added(room, [Fraction(0), *(3 * ROUNDING * c * linear.late[1] for c in terms[1::2])])
    still = slice(None, None, 3 if linear.late else 1)
    left[still] = [added(p, room, Fraction(-1)) for p in left[still]]
    return holds(left, linear.degree, linear.late)


#: The least and the greatest multiplier; None where there is no bound.
Bounds = tuple[Fraction | None, Fraction | None]


def _exact_bounds(circles: list[Polynomial], tilts: list[Polynomial]) -> Bounds:
    """All bounds that ``circle + r tilt > 0`` sets to r, at the frequencies where they are tightest."""
    pairs = []
    for circle, tilt in zip(circles, tilts, strict=True):
        # Each frequency bounds the multiplier by -circle/tilt; the tightest bounds are where that quotient turns.
        turning = added(times(_slope(circle), tilt), times(circle, _slope(tilt)), Fraction(-1))
        places = _positive_roots(turning) or [Fraction(1)]
        pairs += [(_at(circle, u), _at(tilt, u)) for u in [min(places) / _FAR, *places, max(places) * _FAR]]
    return _bounds(pairs)


def _bounds_behind(circles: list[Polynomial], tilts: list[Polynomial], late: tuple[Fraction, Fraction]) -> Bounds:
    """The same behind dead time, on a grid of frequencies and dead times: what is found there is checked."""
    roots = np.abs(np.concatenate([np.roots(_floats(row)) for row in circles]))
    scales = [*np.sqrt(roots[roots > 0]), 1.0 / float(late[1])]
    omega = np.geomspace(min(scales) / _WIDE, max(scales) * _WIDE, _GRID)
    pairs: list[tuple[float, float]] = []
    for tau in np.linspace(float(late[0]), float(late[1]), 5):
        phi = omega * tau
        for i in range(0, len(circles), 3):
            sizes, leans = (
                np.polyval(_floats(still), omega**2)
                + np.polyval(_floats(cosine), omega**2) * np.cos(phi)
                + np.polyval(_floats(sine), omega**2) * omega * np.sin(phi)
                for still, cosine, sine in (circles[i : i + 3], tilts[i : i + 3])
            )
            pairs += zip(sizes.tolist(), leans.tolist(), strict=True)
    return _bounds(pairs)


def _floats(p: Polynomial) -> list[float]:
    """Coefficients in descending powers."""
    return [float(c) for c in p[::-1]]


def _bounds(pairs: Iterable[tuple[Fraction, Fraction] | tuple[float, float]]) -> Bounds:
    """The bounds of all r with ``size + r lean > 0``."""
    pairs = list(pairs)
    least = max((-size / lean for size, lean in pairs if lean > 0), default=None)
    most = min((-size / lean for size, lean in pairs if lean < 0), default=None)
    return None if least is None else Fraction(least), None if most is None else Fraction(most)


def _between(least: Fraction | None, most: Fraction | None) -> list[Fraction]:
    """Multipliers between two bounds; bounded on one side alone, a little beyond the bound, and far beyond it."""
    if least is None and most is None:
        return []
    if least is None or most is None:
        bound, way = (most, -1) if least is None else (least, 1)
        assert bound is not None
        return [bound + way * abs(bound), bound + way * 10 * abs(bound)]
    return [_simplest(least, most)] if least < most else []


def _simplest(low: Fraction, high: Fraction) -> Fraction:
    """The middle of an interval, with as small a denominator as stays well inside."""
    middle, room = (low + high) / 2, (high - low) / 4
    limit = 1
    while abs(middle.limit_denominator(limit) - middle) > room:
        limit *= 10
    return middle.limit_denominator(limit)


def _slope(p: Polynomial) -> Polynomial:
    return [i * c for i, c in enumerate(p)][1:]


def _at(p: Polynomial, u: Fraction) -> Fraction:
    out = Fraction(0)
    for c in reversed(p):
        out = out * u + c
    return out


def _positive_roots(p: Polynomial) -> list[Fraction]:
    """Positive real roots of a polynomial, nearly."""
    from flint import fmpq, fmpq_poly

    poly = fmpq_poly([fmpq(c.numerator, c.denominator) for c in p])
    if poly.degree() < 1:
        return []
    found = []
    roots: list[Any] = poly.complex_roots()
    for root, _ in roots:
        middle = middle_of(root.real)
        value = Fraction(int(middle.p), int(middle.q))
        if value > 0 and root.imag.contains(0):
            found.append(value)
    return found
