"""A loop as certificates state it, in rational numbers, and whether a certificate states that very loop."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from fractions import Fraction
from itertools import product
from typing import Any

import numpy as np

from eppanalysis.errors import ArgumentError, shown
from eppanalysis.methods.certificates.numbers import ROUNDING, NotCovered
from eppanalysis.methods.certificates.registry import STATEMENTS, Claim
from eppanalysis.models.systems.lure import LureSystem
from eppanalysis.models.systems.operating import OperatingPoint
from eppanalysis.models.systems.subject import CaseLike, PointLike, standing

#: Which question a statement answers; an orbit's has a loop of its own kind.
_CLAIMS = {
    STATEMENTS[name].text: claim
    for name, claim in (
        (Claim.ROOTS, Claim.ROOTS),
        ("balance", Claim.ROOTS),
        (Claim.ABSENCE, Claim.ABSENCE),
        ("absence_with_play", Claim.ABSENCE),
        ("elbow", Claim.ABSENCE),
        ("cycles", Claim.CYCLES),
    )
}
#: Statements that hold for all elements of a sector, and for play with any gap.
_OF_A_SECTOR = (STATEMENTS[Claim.ABSENCE].text, STATEMENTS["absence_with_play"].text)
#: What the parts of a loop are called.
_CALLED = {"num": "numerator", "den": "denominator", "delay": "dead time", "time_step": "time step"}
#: What of the linear part may change within a box, besides its dead time.
_ROWS = ("num", "den")
#: Most steps of Newton's method.
_STEPS = 30
#: Values within a range, as shares of it, at which the coefficients are seen to lie between those at its ends.
_SHARES = (0.03, 0.17, 0.25, 0.41, 0.5, 0.68, 0.75, 0.93)


def stated_loop(claim: Claim, system: LureSystem, at: OperatingPoint) -> tuple[dict[str, Any], float]:
    """A loop as certificates of a statement state it, and how far its coefficients are off, relatively.

    Of absence, with lists of numerators and denominators: here of one, of a box of loops those at the corners.

    Raises
    ------
    NotCovered
        If there is no such certificate of it.
    """
    from eppanalysis.methods.certificates.elbow.find import rational_elbow
    from eppanalysis.methods.certificates.rational import rational_loop, require_no_bias

    if claim is Claim.ROOTS:
        return _loop_of_roots(system, at)
    if claim is Claim.ABSENCE and len(system.elements) > 1:
        return rational_elbow(system, at.vector(system)), 0.0
    stated, off = rational_loop(system)
    # Of play it is proved for every constant input (docs/theory/proofs.md, What is claimed of play).
    if claim is Claim.CYCLES or stated["element"]["kind"] != "play":
        require_no_bias(system, at.vector(system))
    if claim is Claim.ABSENCE:
        stated |= {name: [stated[name]] for name in _ROWS}
    return stated, off


def stated_box(
    case: CaseLike, within: Mapping[str, tuple[object, object]], point: PointLike | None
) -> tuple[dict[str, Any], float, list[dict[str, Any]]]:
    """The loops of a case within ranges of parameters, as certificates of absence state them.

    A file speaks of all linear parts between those at the corners, and of all elements in the sector of its own. That
    those of the case are among them is seen at some values: the loops there are given, too.

    Raises
    ------
    ArgumentError
        If a range has no low and high end.
    NotCovered
        If a parameter changes more than linear part and element, the coefficients do not run along a straight line
        with it, or no element of the range has a sector in which the others lie.
    """
    sides = []
    for name, ends in within.items():
        low, high = (case.si(name, end) for end in ends)
        if not low < high:
            raise ArgumentError("within", f" is {name} {ends[0]} to {ends[1]}; expected low < high.", "certify")
        sides.append((low, high))

    def at(shares: Iterable[float]) -> tuple[dict[str, Any], float]:
        values = {n: (1.0 - t) * low + t * high for n, (low, high), t in zip(within, sides, shares, strict=True)}
        return stated_loop(Claim.ABSENCE, *standing(case.with_values(values), point, "certify"))

    # Bit i of a corner's place says at which end of side i it is.
    made = [at(corner[::-1]) for corner in product((0.0, 1.0), repeat=len(sides))]
    made += [at(shares) for shares in zip(*(_SHARES[i:] + _SHARES[:i] for i in range(len(sides))), strict=True)]
    first = made[0][0]
    if "num" not in first:
        raise NotCovered("ranges are proved of loops with one element of one input and output.")
    corners = [[loop[name][0] for name in _ROWS] for loop, _ in made[: 2 ** len(sides)]]
    # Sides along which the linear part stays as it is are none of its box.
    moving = sum(1 << i for i in range(len(sides)) if any(row != corners[k ^ 1 << i] for k, row in enumerate(corners)))
    kept = [row for k, row in enumerate(corners) if k | moving == moving]
    family = first | {name: [row[i] for row in kept] for i, name in enumerate(_ROWS)}
    elements = [loop["element"] for loop, _ in made]
    widest = next((e for e in elements if all(covers(e, other) for other in elements)), None)
    if widest is None:
        raise NotCovered(f"no sector of an element with {' and '.join(within)} in the range holds the others.")
    family["element"] = widest
    late = sorted({Fraction(loop["delay"]) for loop, _ in made})
    if len(late) > 1:
        family["delay"] = [str(late[0]), str(late[-1])]
    for loop, _ in made:
        sampled = loop["time_step"] is not None
        if loop["time_step"] != first["time_step"] or (sampled and loop["delay"] != first["delay"]):
            raise NotCovered(
                f"{' or '.join(within)} changes the samples, and ranges are proved of linear part and element."
            )
        if not _lies_within(loop, family):
            raise NotCovered(
                f"coefficients of the linear part do not run along straight lines with {' or '.join(within)}."
            )
    return family, max(off for _, off in made), [loop for loop, _ in made]


def covers(element: Mapping[str, Any], other: Mapping[str, Any], edges: Sequence[str | None] | None = None) -> bool:
    """Whether what a criterion proves with an element holds with another one: by its sector, of play with any gap.

    Parameters
    ----------
    element, other : mapping
        As certificates state them.
    edges : (str or None, str or None), optional
        Sector that is claimed, in place of that of the element; without both ends any memoryless element lies in it.
    """
    from eppanalysis.methods.certificates.check_absence import Refused, number, sector

    if other == element:
        return True
    if "play" in (element["kind"], other["kind"]):
        return element["kind"] == other["kind"]
    try:
        within, (low, high) = sector(element), sector(other)
    except Refused:
        return False
    if edges is not None:
        within = tuple(None if edge is None else number(edge) for edge in edges)
    least, most = within
    return within == (None, None) or (
        low is not None and least is not None and least <= low and (most is None or (high is not None and high <= most))
    )


def _loop_of_roots(system: LureSystem, at: OperatingPoint) -> tuple[dict[str, Any], float]:
    """A loop as certificates of roots state it: one odd element without bias, else a ring, or one with a bias."""
    from eppanalysis.methods.certificates.rational import rational_loop
    from eppanalysis.methods.certificates.roots.ring import rational_ring
    from eppanalysis.models.systems.means import static_balance

    if any(element.of_frequency for element in system.elements):
        raise NotCovered("the element's describing function depends on the frequency.")
    inputs = at.vector(system)
    if (
        len(system.elements) == 1
        and system.elements[0].is_single
        and not static_balance(system, inputs).prescribed.any()
    ):
        stated, off = rational_loop(system)
        if stated["element"]["kind"] not in ("pieces", "biased_relay"):
            return stated, off
    return rational_ring(system, inputs)


def another_loop(document: Mapping[str, Any], system: LureSystem, at: OperatingPoint) -> str:
    """In what a certificate's loop is another than this one, as the end of a sentence; empty where it is this very one.

    Parameters
    ----------
    document : mapping
        That its checker has accepted.
    at : OperatingPoint
        Where the external inputs are held.
    """
    if document["statement"] == STATEMENTS["orbit"].text:
        from eppanalysis.methods.certificates.orbits.document import other_arcs

        return other_arcs(document["loop"], system, at)
    try:
        stated, _ = stated_loop(_CLAIMS[document["statement"]], system, at)
    except NotCovered as reason:
        return f"no such certificate covers it ({str(reason).rstrip('.')})"
    return another(document, stated)


def another(document: Mapping[str, Any], stated: Mapping[str, Any]) -> str:
    """The same of a loop as certificates of the statement state it."""
    claim, given = _CLAIMS[document["statement"]], document["loop"]
    if stated.keys() != given.keys():
        return "the file states a loop of another kind"
    for name, value in stated.items():
        among = claim is Claim.ABSENCE and name in _ROWS and _lies_within(stated, given)
        if name == "delay" and isinstance(given[name], list):
            among = Fraction(given[name][0]) <= Fraction(value) <= Fraction(given[name][1])
        if name == "element" and document["statement"] in _OF_A_SECTOR:
            among = covers(given[name], value, document["claim"].get("sector"))
        if given[name] != value and not among:
            called = _CALLED.get(name, name.replace("_", " "))
            listed = " to ".join(given[name]) if name == "delay" and not isinstance(given[name], str) else given[name]
            return f"its {called} is {shown(value)}, and that of the file {shown(listed)}"
    return ""


def _lies_within(loop: Mapping[str, Any], family: Mapping[str, Any]) -> bool:
    """Whether a linear part is one of those between the corners, but for rounding of its coefficients.

    The shares along the sides, from 0 to 1, are found by Newton's method; what they give is compared exactly.
    """
    points = [_coefficients(*parts) for parts in zip(*(family[name] for name in _ROWS), strict=True)]
    here, count = _coefficients(*(loop[name][0] for name in _ROWS)), len(points).bit_length() - 1
    if len(points) == 1 or len({len(row) for row in (here, *points)}) > 1:
        return points == [here]
    sizes = np.array([max(map(abs, column)) or 1 for column in zip(here, *points, strict=True)], dtype=float)
    shares = [Fraction(1, 2)] * count
    for _ in range(_STEPS):
        off = [a - b for a, b in zip(_between(points, shares), here, strict=True)]
        if all(abs(x) <= ROUNDING * abs(c) for x, c in zip(off, here, strict=True)):
            return True
        slopes = [
            np.array(
                [a - b for a, b in zip(*(_between(points, _with(shares, i, t)) for t in (1, 0)), strict=True)], float
            )
            for i in range(count)
        ]
        step = np.linalg.lstsq(np.array(slopes).T / sizes[:, None], np.array(off, dtype=float) / sizes, rcond=None)[0]
        shares = [min(max(t - Fraction(float(d)), Fraction(0)), Fraction(1)) for t, d in zip(shares, step, strict=True)]
    return False


def _coefficients(num: list[str], den: list[str]) -> list[Fraction]:
    """Of a linear part, those of the numerator from the order of the denominator on."""
    return [Fraction(0)] * (len(den) - len(num)) + [*map(Fraction, num), *map(Fraction, den)]


def _with(shares: list[Fraction], i: int, share: int) -> list[Fraction]:
    return [*shares[:i], Fraction(share), *shares[i + 1 :]]


def _between(points: list[list[Fraction]], shares: list[Fraction]) -> list[Fraction]:
    """What lies at shares of the sides of a box; bit i of a corner's place says at which end of side i it is."""
    if not shares:
        return points[0]
    low, high = (_between(points[bit::2], shares[1:]) for bit in (0, 1))
    return [a + shares[0] * (b - a) for a, b in zip(low, high, strict=True)]
