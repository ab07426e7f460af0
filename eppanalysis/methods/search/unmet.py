"""How many cycles a search has probably not met, from how often it met each of those that it has.

Where many cycles were met, and most of them once, there are more: each further start would meet others. Where each was
met again and again, hardly any is left. Chao's estimator makes a number of it that is true or too low, whatever the
sizes of the basins are (docs/theory/exact_orbits.md, The search for all of them).
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable

from eppanalysis.readable import number

#: Least estimate that is taken for a sign of more cycles: two that were met once are chance.
MANY = 3.0


def unmet(times: Iterable[int]) -> float:
    """At least how many cycles more there probably are than were met, each so many times.

    Examples
    --------
    >>> unmet([9, 4, 2]), unmet([1, 1, 1, 1, 2])
    (0.0, 3.0)
    """
    met = Counter(times)
    return met[1] * (met[1] - 1) / (2.0 * (met[2] + 1))


def more_of(which: str, many: float) -> list[str]:
    """What a search leaves open where it has probably not met so many cycles of a kind."""
    told = f"at least {number(many, 2)} more {which} are likely, as many of those known were met only once"
    return [told] if many >= MANY else []
