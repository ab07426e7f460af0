"""The paper's design advice for all initial conditions: what each piece of it does to the bound and to the trigger.

Two questions are asked of each piece, since a design may be safe in two ways. By how much does it move the *bound*,
below which no limit cycle exists? And for a design that is beyond its bound, by how much does it raise the *trigger* (a
step of the harness, or a blow to the forearm) that just starts the oscillation?
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from eppanalysis.cases import Case, as_case, variation_of
from eppanalysis.errors import EppError
from eppanalysis.methods.bounds.design import design_bounds
from eppanalysis.methods.bounds.result import BoundCell, DesignBounds
from eppanalysis.methods.search.find import find_limit_cycles
from eppanalysis.methods.search.trigger import NoRest, trigger
from eppanalysis.models.systems.subject import require_case
from eppanalysis.results import PlainData

if TYPE_CHECKING:
    import pandas

__all__ = ["ADVICE", "AdviceRow", "advice_frame", "advice_of", "advice_sentences", "design_advice", "with_mass"]

GAIN, LIMIT, MASS = "bands.range", "lock_pin.backlash", "forearm.prehensor_mass"
#: Advice of the paper: in words, the parameter, and the direction in which it is to be changed.
ADVICE = (
    ("less backlash", LIMIT, -1),
    ("less pulley friction", "pulley.friction", -1),
    ("softer cable", "cable.stiffness", -1),
    ("lighter prehensor", MASS, -1),
    ("less gain", GAIN, 1),
)
#: How far a parameter is moved for its trigger.
_STEP = 0.1
#: From which elasticity on an advice is called strong, moderate, weak; smaller ones are none.
_WORDS = ((0.5, "strong"), (0.15, "moderate"), (0.02, "weak"), (-0.02, "none"), (-math.inf, "the other way"))
_ABSENT = "not applicable"
_NAN = float("nan")


@dataclass(frozen=True)
class AdviceRow(PlainData):
    """One piece of advice at one operating point; elasticities have the sign of the advice: positive where it helps.

    Attributes
    ----------
    gain : float
        Profile range [N].
    words, parameter : str
    bound : float
        Exact bound on the backlash there [rad].
    gained : float
        Per cent by which the bound on backlash grows for one per cent in the direction advised; nan for the backlash
        itself, and for a parameter that is zero.
    traded : float
        Per cent by which the gain may grow, at the same backlash, for one per cent in the direction advised.
    trigger, blow : float
        Smallest step of the harness [m], and smallest blow to the forearm [rad/s], that start the oscillation of the
        elbow as it is; nan where none does.
    trigger_gained, blow_gained : float
        Per cent by which they grow for one per cent in the direction advised (a tenth of what a change by a tenth
        does); infinite where nothing starts the oscillation any more, nan where nothing did before.
    verdict, trigger_verdict : str
        "strong", "moderate", "weak", "none", "the other way", "ends the oscillation", "not known", or "not applicable"
        where the parameter is zero: for the bound (for backlash, the gain that it is traded for), and for the trigger.
    """

    gain: float
    words: str
    parameter: str
    bound: float
    gained: float
    traded: float
    trigger: float
    blow: float
    trigger_gained: float
    blow_gained: float
    verdict: str
    trigger_verdict: str


def design_advice(
    case: Case, gains: Sequence[object], *, within: tuple[object, object] | None = None, workers: int = 1
) -> tuple[AdviceRow, ...]:
    """How much each piece of the paper's advice moves the bound on backlash, and the trigger that the design survives.

    Parameters
    ----------
    case : Case
        Of an elbow. Where it gives the forearm's inertia, the mass of the prehensor is what the shell leaves of it.
    gains : sequence of quantity
        Profile ranges.
    within : (quantity, quantity), optional
        Range in which the bound is sought.
    workers : int

    Returns
    -------
    tuple of AdviceRow
        For each gain in turn, as many as there are pieces of advice; bounds that do not exist are nan.

    Raises
    ------
    EppError
        If the case is no elbow, or its forearm leaves no mass for a prehensor.
    """
    found = design_bounds(with_mass(case), GAIN, LIMIT, at=gains, within=within, verify=False, workers=workers)
    return advice_of(case, found)


def advice_of(case: Case, found: DesignBounds) -> tuple[AdviceRow, ...]:
    """The advice at bounds that are known already.

    Parameters
    ----------
    case : Case
        As for :func:`design_advice`.
    found : DesignBounds
        On "lock_pin.backlash" over "bands.range", of :func:`with_mass` of the case.

    Raises
    ------
    EppError
        As :func:`design_advice`.
    """
    case = with_mass(case)
    return tuple(row for cell in found for row in _rows(case.with_values({GAIN: cell.value}), cell))


def with_mass(case: Case) -> Case:
    """The case with the prehensor's mass as a parameter.

    Raises
    ------
    EppError
        If the case is no elbow, or its forearm leaves no mass for a prehensor.
    """
    case = as_case(case)
    require_case(case, "design_advice")
    if variation_of(case).guided is None:
        raise EppError(f"design_advice: {case.name} is a {case.kind}; expected a case of the elbow.")
    if MASS in case.parameters:
        return case
    rest = case.value("forearm.inertia") - case.value("forearm.shell_inertia")
    if not rest > 0:
        raise EppError(
            f"design_advice: {case.name} has a forearm.inertia of {case.text('forearm.inertia', rest)} beyond its "
            "shell; expected more than the shell's, so that a prehensor is left to be made lighter."
        )
    return case.with_values({MASS: case.value(MASS)})


def _rows(case: Case, cell: BoundCell) -> Iterator[AdviceRow]:
    """All advice at one gain."""
    by_gain = cell.elasticities.get(GAIN, _NAN)
    step, blow = smallest_triggers(case)
    for words, name, direction in ADVICE:
        given = name in case.parameters and bool(case.value(name))
        share = traded = changed_step = changed_blow = _NAN
        if given:
            share = direction * cell.elasticities.get(name, _NAN)
            traded = (1.0 if name == LIMIT else share) / by_gain
            other = smallest_triggers(case.with_values({name: case.value(name) * (1.0 + direction * _STEP)}))
            changed_step, changed_blow = _growth(step, other[0]), _growth(blow, other[1])
        felt = traded if name == LIMIT else share
        verdicts = [_word(v) if given else _ABSENT for v in (felt, changed_step)]
        yield AdviceRow(
            cell.value, words, name, cell.bound, share, traded, _finite(step), _finite(blow),
            changed_step, changed_blow, *verdicts,
        )  # fmt: skip


def smallest_triggers(case: Case) -> tuple[float, float]:
    """Smallest step of the harness [m] and blow to the forearm [rad/s] that start the oscillation of an elbow.

    Infinite where nothing starts it; nan where that could not be decided.
    """
    system = case.to_system()
    cycles = find_limit_cycles(case)
    if not cycles.stable:
        # The loop is the same wherever the harness stands; the search at its start has other starts.
        # A stable cycle that is predicted would be met by the runs on its scales, whether its orbit is closed or not.
        again = find_limit_cycles(system) if cycles.left_open else cycles
        nothing = math.inf if not (again.left_open or again.stable) else _NAN
        return nothing, nothing
    try:
        found = trigger(case, cycles=cycles, states=["theta_dot"])
    except NoRest:
        return 0.0, 0.0
    sizes = [
        [abs(k.size) for k in found if (k.name in system.input_names) is external and np.isfinite(k.size)]
        for external in (True, False)
    ]
    return min(sizes[0], default=math.inf), min(sizes[1], default=math.inf)


def _growth(before: float, after: float) -> float:
    """Elasticity from a change by a tenth; nan where there was nothing to grow."""
    if not math.isfinite(before) or before == 0.0:
        return _NAN
    return (after / before - 1.0) / _STEP


def _finite(value: float) -> float:
    return value if math.isfinite(value) else _NAN


def _word(elasticity: float) -> str:
    """Plain word for an elasticity."""
    if math.isnan(elasticity):
        return "not known"
    if math.isinf(elasticity):
        return "ends the oscillation"
    return next(word for least, word in _WORDS if elasticity >= least)


def advice_frame(case: Case, rows: Sequence[AdviceRow]) -> pandas.DataFrame:
    """The advice as a table in the units that people use; elasticities in per cent for one per cent."""
    import pandas

    gain, degrees = case.readable(GAIN)[1], case.readable(LIMIT)[1]
    lines: list[dict[str, Any]] = [
        {
            "profile range [lbf]": f"{gain * r.gain:.3g}",
            "bound [deg]": _number(degrees * r.bound, ".3f"),
            "advice": r.words,
            "bound grows [%]": _number(r.gained, "+.2f"),
            "gain may grow [%]": _number(r.traded, "+.2f"),
            "on the bound": r.verdict,
            "step [mm]": _number(1e3 * r.trigger, ".3f"),
            "step grows [%]": _number(r.trigger_gained, "+.2f"),
            "blow [deg/s]": _number(math.degrees(r.blow), ".3g"),
            "blow grows [%]": _number(r.blow_gained, "+.2f"),
            "on the step": r.trigger_verdict,
        }
        for r in rows
    ]
    return pandas.DataFrame(lines)


def _number(value: float, form: str) -> str:
    if math.isnan(value):
        return "–"
    return "none starts it" if math.isinf(value) else f"{value:{form}}".replace("+0.00", "0").replace("-0.00", "0")


def advice_sentences(rows: Sequence[AdviceRow]) -> list[str]:
    """What the table says of each piece of advice, in words, over all its operating points."""
    out = []
    for words, name, _ in ADVICE:
        here = [r for r in rows if r.parameter == name and r.verdict != _ABSENT]
        if not here:
            out.append(f"{words.capitalize()}: not applicable, the parameter is zero.")
            continue
        felt = [r.traded if name == LIMIT else r.gained for r in here]
        what = "allows {} % more gain" if name == LIMIT else "moves the bound by {} %"
        text = f"{words.capitalize()}: one per cent {what.format(_range(felt))} ({_joined(r.verdict for r in here)})"
        for grown, verdicts, disturbed in (
            ([r.trigger_gained for r in here], [r.trigger_verdict for r in here], "step"),
            ([r.blow_gained for r in here], [_word(r.blow_gained) for r in here], "blow"),
        ):
            text += f"; the smallest {disturbed} grows by {_range(grown)} % "
            text += f"({_joined(verdicts)})"
        out.append(text + "." + _against(here))
    return out


def _against(rows: Sequence[AdviceRow]) -> str:
    """Where the model does not bear the paper out."""
    signs = {
        "the bound": [r.verdict for r in rows],
        "the step": [r.trigger_verdict for r in rows],
        "the blow": [_word(r.blow_gained) for r in rows],
    }
    wrong = [what for what, words in signs.items() if set(words) == {"the other way"}]
    mixed = [what for what, words in signs.items() if "the other way" in words and what not in wrong]
    idle = [what for what, words in signs.items() if set(words) <= {"none"}]
    out = f" The model does not bear the advice out for {' and '.join(wrong)}: there it harms." if wrong else ""
    out += f" For {' and '.join(mixed)} it helps or harms, by the operating point." if mixed else ""
    return out + (f" It does nothing for {' and '.join(idle)}." if idle else "")


def _range(values: Sequence[float]) -> str:
    known = sorted(v for v in values if not math.isnan(v))
    if not known:
        return "–"
    low, high = (_number(v, "+.2f") for v in (known[0], known[-1]))
    return low if low == high else f"{low} to {high}"


def _joined(words: Iterable[str]) -> str:
    """Each of the verdicts once, from the least to the greatest, as ranges of numbers are told."""
    order = [*(word for _, word in reversed(_WORDS)), "ends the oscillation"]
    return ", ".join(sorted(set(words) - {"not known"}, key=order.index))
