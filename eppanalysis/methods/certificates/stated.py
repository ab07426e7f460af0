"""A loop as certificates state it, in rational numbers, and whether a certificate states that very loop."""

from __future__ import annotations

from collections.abc import Mapping
from fractions import Fraction
from typing import Any

from eppanalysis.errors import ArgumentError, shown
from eppanalysis.methods.certificates.numbers import ROUNDING, NotCovered
from eppanalysis.methods.certificates.registry import STATEMENTS, Asked
from eppanalysis.models.systems.lure import LureSystem
from eppanalysis.models.systems.operating import OperatingPoint
from eppanalysis.models.systems.subject import CaseLike, PointLike, standing

#: Which question a statement answers; an orbit's has a loop of its own kind.
_ASKED = {
    STATEMENTS[name].text: asked
    for name, asked in (
        (Asked.ROOTS, Asked.ROOTS),
        ("balance", Asked.ROOTS),
        (Asked.ABSENCE, Asked.ABSENCE),
        ("absence_with_play", Asked.ABSENCE),
        ("elbow", Asked.ABSENCE),
        ("cycles", Asked.CYCLES),
    )
}
#: What the parts of a loop are called.
_CALLED = {"num": "numerator", "den": "denominator", "delay": "dead time", "time_step": "time step"}
#: Values within a range, as shares of it, at which the numerator is seen to lie between those at its ends.
_SHARES = (0.0, 0.03, 0.17, 0.25, 0.41, 0.5, 0.68, 0.75, 0.93, 1.0)


def stated_loop(asked: Asked, system: LureSystem, at: OperatingPoint) -> tuple[dict[str, Any], float]:
    """A loop as certificates of a statement state it, and how far its coefficients are off, relatively.

    Of absence, with a list of numerators: here one, in a range of loops those at both ends.

    Raises
    ------
    NotCovered
        If there is no such certificate of it.
    """
    from eppanalysis.methods.certificates.elbow.find import rational_elbow
    from eppanalysis.methods.certificates.rational import rational_loop, require_no_bias

    if asked is Asked.ROOTS:
        return _loop_of_roots(system, at)
    if asked is Asked.ABSENCE and len(system.elements) > 1:
        return rational_elbow(system), 0.0
    stated, off = rational_loop(system)
    # Of play it is proved for every constant input (docs/theory/proofs.md, What is claimed of play).
    if asked is Asked.CYCLES or stated["element"]["kind"] != "play":
        require_no_bias(system, at.vector(system))
    return (stated | {"num": [stated["num"]]} if asked is Asked.ABSENCE else stated), off


def stated_range(
    case: CaseLike, name: str, ends: tuple[object, object], point: PointLike | None
) -> tuple[dict[str, Any], float]:
    """The loops of a case within a range of one parameter, as certificates of absence state them.

    A file speaks of all numerators on the straight line between two. That those of the case lie on it is seen at some
    values.

    Raises
    ------
    ArgumentError
        If the range has no low and high end.
    NotCovered
        If the parameter changes more than the numerator, or that not along a line.
    """
    low, high = (case.si(name, end) for end in ends)
    if not low < high:
        raise ArgumentError("within", f" is {name} {ends[0]} to {ends[1]}; expected low < high.", "certify")
    made = [
        stated_loop(Asked.ABSENCE, *standing(case.with_values({name: low + share * (high - low)}), point, "certify"))
        for share in _SHARES
    ]
    (first, _), (last, _) = made[0], made[-1]
    if "num" not in first:
        raise NotCovered("ranges are proved of loops with one element of one input and output.")
    rows = first["num"] + last["num"] if first["num"] != last["num"] else first["num"]
    for loop, _ in made:
        if {**loop, "num": rows} != {**first, "num": rows}:
            raise NotCovered(
                f"{name} changes more than the numerator of the linear part, and ranges are proved of that."
            )
        if not _lies_between(loop["num"][0], rows):
            raise NotCovered(f"the numerator does not run along a line with {name}.")
    return first | {"num": rows}, max(off for _, off in made)


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
        stated, _ = stated_loop(_ASKED[document["statement"]], system, at)
    except NotCovered as reason:
        return f"no such certificate covers it ({str(reason).rstrip('.')})"
    given = document["loop"]
    if stated.keys() != given.keys():
        return "the file states a loop of another kind"
    for name, value in stated.items():
        if given[name] != value and not (name == "num" and _lies_between(value[0], given[name])):
            called = _CALLED.get(name, name.replace("_", " "))
            return f"its {called} is {shown(value)}, and that of the file {shown(given[name])}"
    return ""


def _lies_between(row: list[str], ends: list[list[str]]) -> bool:
    """Whether a numerator lies on the line between two, but for rounding of its coefficients; or is one of them."""
    if row in ends or len(ends) != 2:
        return row in ends
    length = max(map(len, (row, *ends)))
    low, high, here = ([Fraction(0)] * (length - len(one)) + [*map(Fraction, one)] for one in (*ends, row))
    least, most = Fraction(0), Fraction(1)
    for a, b, c in zip(low, high, here, strict=True):
        room = ROUNDING * abs(c)
        if a == b:
            if abs(c - a) > room:
                return False
            continue
        shares = sorted(((c - room - a) / (b - a), (c + room - a) / (b - a)))
        least, most = max(least, shares[0]), min(most, shares[1])
    return least <= most
