"""How much gain the paper's remedies bring back: the smallest profile range without a limit cycle, with each of them.

The gain of the elbow is what its profile range is small for: a range half as wide is twice the gain. For the original
elbow and for each remedy the smallest range is designed (:func:`eppanalysis.design`) and put to the test.

Run it: ``python -m studies.remedies``. It takes some minutes, so that its result is kept in ``_static/remedies.md``.
"""

from __future__ import annotations

from dataclasses import dataclass

import eppanalysis as epp
from eppanalysis.results import PlainData
from studies import STORED

__all__ = ["REMEDIES", "Remedy", "cured", "remedies", "table"]

RESULT = STORED / "remedies.md"
CASE, RANGE, WITHIN = "fig8a_original", "bands.range", ("1 lbf", "8 lbf")
#: Remedies in words, and what each changes: a number is a factor, a text a value.
REMEDIES: dict[str, dict[str, float | str]] = {
    "none": {},
    "cable softer by 20 %": {"cable.stiffness": 0.8},
    "parking band half as wide again": {"bands.parking_width": 1.5},
    "backlash less by 20 %": {"lock_pin.backlash": 0.8},
    "cable softer by 20 % and parking band half as wide again": {"cable.stiffness": 0.8, "bands.parking_width": 1.5},
    "lead of 10 ms before the band law, with a lag of 1 ms": {"sensor.lead": "10 ms", "sensor.filter": "1 ms"},
    "lead of 20 ms before the band law, with a lag of 2 ms": {"sensor.lead": "20 ms", "sensor.filter": "2 ms"},
}


@dataclass(frozen=True)
class Remedy(PlainData):
    """One remedy.

    Attributes
    ----------
    words : str
    range : float
        The smallest profile range without a limit cycle [N].
    gained : float
        By how much more the gain may be than without a remedy, as a share.
    frequency : float
        Of the limit cycle that is born there [Hz].
    confirmed : bool
    """

    words: str
    range: float
    gained: float
    frequency: float
    confirmed: bool


def cured(words: str) -> epp.Case:
    """The original elbow with a remedy."""
    case = epp.case(CASE)
    changes = REMEDIES[words]
    return case.with_values({n: v if isinstance(v, str) else v * case.value(n) for n, v in changes.items()})


def remedies(starts: int = 100, verify: bool = True) -> tuple[Remedy, ...]:
    """All remedies, the first of them none."""
    found: list[Remedy] = []
    for words in REMEDIES:
        best = epp.design(cured(words), {RANGE: WITHIN}, minimise=RANGE, starts=starts, verify=verify).optimum
        first = found[0].range if found else best.at[RANGE]
        found.append(Remedy(words, best.at[RANGE], first / best.at[RANGE] - 1.0, best.frequency, best.confirmed))
    return tuple(found)


def table(found: tuple[Remedy, ...]) -> str:
    """The remedies in Markdown, in the units that people use."""
    factor = epp.case(CASE).readable(RANGE)[1]
    lines = [
        "| remedy | smallest profile range [lbf] | more gain | cycle there [Hz] | confirmed |",
        "|---|---|---|---|---|",
    ]
    lines += [
        f"| {r.words} | {factor * r.range:.3f} | {f'{100 * r.gained:.0f} %' if r.gained else '-'} | {r.frequency:.2f} "
        f"| {'yes' if r.confirmed else 'no'} |"
        for r in found
    ]
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    RESULT.write_text(table(remedies()), encoding="utf-8")
