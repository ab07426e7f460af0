"""The paper's design advice for all initial conditions: what each piece of it does to bound and knock."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from eppanalysis.case import Case
from eppanalysis.errors import EppError
from eppanalysis.methods.bounds import design_bounds
from eppanalysis.methods.bounds_harmonic import Question
from eppanalysis.methods.bounds_regions import smallest_knock

if TYPE_CHECKING:
    import pandas

__all__ = ["ADVICE", "AdviceRow", "advice_frame", "design_advice"]

#: Advice of the paper: in words, the parameter, and the direction in which it is to be changed.
ADVICE = (
    ("less backlash", "lock_pin.backlash", -1),
    ("less pulley friction", "pulley.friction", -1),
    ("softer cable", "cable.stiffness", -1),
    ("lighter prehensor", "forearm.prehensor_mass", -1),
    ("less gain", "bands.range", 1),
)
STRONG, WEAK, _STEP = 0.5, 0.15, 0.1


@dataclass(frozen=True)
class AdviceRow:
    """One piece of advice at one operating point.

    Attributes
    ----------
    gain : float
        Profile range [N].
    words, parameter : str
    bound : float
        Exact bound on the backlash there [rad].
    gained : float
        Relative growth of the bound for a relative change of the parameter in the direction advised (elasticity, with
        the sign of the advice); nan for the backlash itself and for a parameter that is zero.
    knock : float
        Relative growth of the knock that the elbow's own backlash survives, for a tenth in the direction advised; nan
        where there is no knock to compare with, infinite where no knock starts the oscillation any more.
    verdict : str
    """

    gain: float
    words: str
    parameter: str
    bound: float
    gained: float
    knock: float
    verdict: str


def design_advice(
    case: Case, gains: Sequence[object], *, within: tuple[object, object] | None = None, workers: int = 1
) -> tuple[AdviceRow, ...]:
    """How much each piece of the paper's advice moves the bound on backlash, and the knock that the design survives.

    Parameters
    ----------
    case : Case
        Of an elbow.
    gains : sequence of quantity
        Profile ranges.
    within : (quantity, quantity), optional
        Range in which the bound is sought.
    workers : int

    Returns
    -------
    tuple of AdviceRow

    Raises
    ------
    EppError
        If the case is no elbow or gives no prehensor mass.
    """
    if case.kind != "elbow":
        raise EppError(f"design_advice: {case.name} is a {case.kind}; expected a case of the elbow.")
    found = design_bounds(
        case, "bands.range", "lock_pin.backlash", at=gains, within=within, verify=False, workers=workers
    )
    rows: list[AdviceRow] = []
    for cell in found:
        here = case.with_values({"bands.range": cell.value})
        first = _knock(here)
        for words, name, direction in ADVICE:
            share = direction * cell.elasticities.get(name, math.nan)
            given = name in here.parameters and bool(here.parameters[name].value)
            other = (
                _knock(here.with_values({name: here.value(name) * (1.0 + direction * _STEP)})) if given else math.nan
            )
            change = other / first - 1.0
            rows.append(AdviceRow(cell.value, words, name, cell.bound, share, change, _verdict(share, change)))
    return tuple(rows)


def _knock(case: Case) -> float:
    """Size of the smallest step of the harness that starts the oscillation [m]; infinite where none does."""
    own = case.value("lock_pin.backlash")
    hit = smallest_knock(Question(case, "lock_pin.backlash", own, own), own)
    return math.inf if hit is None else abs(hit.size)


def _verdict(share: float, knock: float) -> str:
    """Plain words for an elasticity (or, where there is none, for what a tenth does to the knock)."""
    size = share if math.isfinite(share) else knock / _STEP
    if math.isnan(size):
        return "not applicable here"
    if size >= STRONG:
        return "strong"
    if size >= WEAK:
        return "moderate"
    return "weak" if size > -0.02 else "not borne out by the model"


def advice_frame(case: Case, rows: Sequence[AdviceRow]) -> pandas.DataFrame:
    """The advice as a table in the units that people use."""
    import pandas

    gain, degrees = case.readable("bands.range")[1], case.readable("lock_pin.backlash")[1]
    lines: list[dict[str, Any]] = [
        {
            "profile range [lbf]": f"{gain * r.gain:.3g}",
            "advice": r.words,
            "bound [deg]": f"{degrees * r.bound:.3f}",
            "bound grows by [% for 1 %]": _number(r.gained, "+.2f"),
            "knock grows by [% for 10 %]": _number(100.0 * r.knock, "+.1f"),
            "": r.verdict,
        }
        for r in rows
    ]
    return pandas.DataFrame(lines)


def _number(value: float, form: str) -> str:
    return "-" if math.isnan(value) else "none starts it" if math.isinf(value) else f"{value:{form}}"
