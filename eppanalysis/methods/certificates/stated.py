"""A loop as certificates state it, in rational numbers, and whether a certificate states that very loop."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from eppanalysis.errors import shown
from eppanalysis.methods.certificates.numbers import NotCovered
from eppanalysis.methods.certificates.registry import STATEMENTS, Asked
from eppanalysis.models.systems.lure import LureSystem
from eppanalysis.models.systems.operating import OperatingPoint

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


def stated_loop(asked: Asked, system: LureSystem, at: OperatingPoint) -> tuple[dict[str, Any], float]:
    """A loop as certificates of a statement state it, and how far its coefficients are off, relatively.

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
    return stated, off


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
        if given[name] != value:
            called = _CALLED.get(name, name.replace("_", " "))
            return f"its {called} is {shown(value)}, and that of the file {shown(given[name])}"
    return ""
