"""What is proved beside a bound: that no limit cycle exists at a value on its free side, and that one does beyond.

The nearest values at which the proofs succeed are on both sides of the bound; between them nothing is proved. Of a
gain one proof of absence holds for all values from the free end of the range on, where it succeeds.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import TYPE_CHECKING, TypeVar

from eppanalysis.methods.bounds.result import BoundCell, Finding, ProvedSides
from eppanalysis.methods.certificates.certify import certify, proof_of_absence
from eppanalysis.methods.certificates.orbits.certify import proof_of_orbit
from eppanalysis.methods.search.find import find_limit_cycles

if TYPE_CHECKING:
    from eppanalysis.methods.bounds.balanced import BoundProblem
    from eppanalysis.methods.certificates.orbits.result import CertifiedOrbit
    from eppanalysis.methods.certificates.result import Certificate

T = TypeVar("T")
_NAN = float("nan")
#: Distances from a bound, relative to it, at which proofs are tried in turn until one fails.
_DISTANCES = (0.5, 0.2, 0.1, 0.05, 0.02, 0.01, 0.005, 0.002, 0.001)


def with_proofs(question: BoundProblem, cell: BoundCell) -> BoundCell:
    """The cell with what can be proved on both sides of its bound, as near to it as can be.

    Raises
    ------
    EppError
        If the packages of the extra "proof" are missing.
    """
    return replace(cell, proved=_sides(question, cell)) if cell.finding is Finding.BOUND else cell


def _sides(question: BoundProblem, cell: BoundCell) -> ProvedSides:
    bound, sign = cell.exact, cell.sign
    if not math.isfinite(bound):
        return ProvedSides(message="Nothing is proved: the bound is not exact.")
    free, absence, why_no_absence = _nearest(_absences(question, bound, sign))
    start, absence = _over_range(question, sign, free, absence)
    cycle, orbit, why_no_orbit = _nearest(_orbits(question, cell))
    reasons = []
    if absence is None:
        reasons.append(f"Absence of cycles is not proved. {why_no_absence}")
    if orbit is None:
        reasons.append(f"A cycle is not proved. {why_no_orbit}")
    return ProvedSides(free, cycle, abs(cycle - free) / abs(bound), absence, orbit, " ".join(reasons), start)


def _nearest(tried: Iterator[tuple[float, T | None, str]]) -> tuple[float, T | None, str]:
    """The last proof that succeeds, of those that come nearer and nearer to the bound."""
    kept: tuple[float, T | None, str] = (_NAN, None, "")
    for value, proof, why in tried:
        # Proofs grow harder towards the bound: the first that fails ends the row.
        if proof is None:
            return kept if kept[1] is not None else (_NAN, None, why)
        kept = (value, proof, "")
    return kept


def _absences(question: BoundProblem, bound: float, sign: float) -> Iterator[tuple[float, Certificate | None, str]]:
    for distance in _DISTANCES:
        value = bound - sign * distance * abs(bound)
        if question.low <= value <= question.high:
            yield value, *proof_of_absence(question.case_at(value))


def _over_range(
    question: BoundProblem, sign: float, free: float, absence: Certificate | None
) -> tuple[float, Certificate | None]:
    """The proof of absence from the free end of the range to the value where it is proved, if there is one for all."""
    end, _ = question.ends(sign)
    if absence is None or end == free:
        return free, absence
    found = certify(question.case, "absence", within={question.limit: (min(end, free), max(end, free))})
    return (end, found) if found.proved else (free, absence)


def _orbits(question: BoundProblem, cell: BoundCell) -> Iterator[tuple[float, CertifiedOrbit | None, str]]:
    """The cycle that is known beyond a bound, then those of searches nearer and nearer to it."""
    bound, tested, near = cell.exact, cell.other_value, cell.other_orbit
    if near is None:
        yield _NAN, None, "No exact orbit is known beyond the bound."
        return
    # Farther out than the tested value a proof would say less than the one of that value's known orbit.
    distances = [d for d in _DISTANCES if d < 0.9 * abs(tested / bound - 1.0)]
    for value in (tested, *(bound + cell.sign * d * abs(bound) for d in distances)):
        case = question.case_at(value)
        proof, why = None, "The search finds no cycle."
        for cycle in [near] if value == tested else find_limit_cycles(case).cycles:
            proof, why = proof_of_orbit(case, cycle)
            if proof is not None:
                break
        yield value, proof, why
