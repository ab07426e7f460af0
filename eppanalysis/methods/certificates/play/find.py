"""Finds a certificate that loops with play have no periodic motion but rest: a function that falls along every motion.

Few sectors are tried first, then more and more; the checker's own function decides whether one proves anything.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from fractions import Fraction
from itertools import product
from typing import Any

from eppanalysis.methods.certificates import check_play
from eppanalysis.methods.certificates.play.contact import contact_poles
from eppanalysis.methods.certificates.play.program import Vector
from eppanalysis.methods.certificates.play.search import SectorSearch
from eppanalysis.methods.certificates.registry import sealed

#: Sectors of a quarter plane that are tried, one after the other: few are fast, many come near the exact onset.
_COUNTS = (4, 10, 24, 48)


def find(loop: Mapping[str, Any], sectors: int) -> dict[str, Any] | str:
    """The certificate with up to so many sectors of a quarter plane, or why there is none.

    Parameters
    ----------
    loop : mapping
        As :func:`~eppanalysis.methods.certificates.absence.find` takes it, with one play.
    sectors : int

    Returns
    -------
    dict or str
        Plain data: statement, loop, claim, evidence; or the end of a sentence.
    """
    nums, (den, *others) = (check_play.rational(loop[name]) for name in ("num", "den"))
    if len(nums) > 2 or any(other != den for other in others):
        return "sectors take one parameter, of the numerator."
    choices, reason = contact_poles(nums, den)
    if reason:
        return f"{reason}."
    for found in _candidates(nums, den, choices, sectors):
        document = sealed(
            {
                "statement": check_play.STATEMENT,
                "loop": dict(loop),
                "claim": {"sectors": len(found["moving"][0])},
                "evidence": _text(found),
            }
        )
        if _proves(document):
            return document
    return f"no function was found that falls, with up to {sectors} sectors of a quarter plane."


def _proves(document: Mapping[str, Any]) -> bool:
    """Whether the checker accepts what was rounded to rationals."""
    try:
        check_play.verify(document)
    except check_play.Refused:
        return False
    return True


def _candidates(nums: list[Vector], den: Vector, choices: list[Vector], sectors: int) -> Iterator[dict[str, Any]]:
    """What the search finds with more and more sectors, at the rate of the slowest lag and at that of the loop gain."""
    order = len(den) - 1
    lag = next((den[k] / den[k - 1] for k in range(order, 0, -1) if den[k]), Fraction(1))
    gain = max(abs(float(num[-1])) for num in nums) ** (1.0 / order)
    units = dict.fromkeys(Fraction(2) ** round(math.log2(float(rate))) for rate in (lag, gain) if rate > 0)
    for count in dict.fromkeys([*(c for c in _COUNTS if c < sectors), sectors]):
        for poles, unit in product(choices, units):
            found = SectorSearch(nums, den, poles, unit, count).candidate()
            if found is not None:
                yield found


def _text(value: Any) -> Any:
    """Rationals as texts, in nested lists."""
    if isinstance(value, dict):
        return {name: _text(item) for name, item in value.items()}
    return [_text(item) for item in value] if isinstance(value, list) else str(value)
