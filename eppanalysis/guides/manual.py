"""Guidelines and bounds as tables for manuals: five columns, rounded to the safe side in a step that is said.

A limit is rounded from the value at which the design was tested, not from the bound itself: what is printed was seen to
come to rest, or lies on the safe side of what was. See ``docs/howto/bounds.md``.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from decimal import Decimal

from eppanalysis.arguments import checked
from eppanalysis.errors import EppError, shown
from eppanalysis.guides.guideline import GAIN, LIMIT, Guide, GuideRow, in_words
from eppanalysis.methods.bounds.result import BoundCell, DesignBounds, Finding
from eppanalysis.readable import number, with_unit, words
from eppanalysis.results.provenance import Provenance
from eppanalysis.tables.manual import ManualTable, drawing_step, to_step

_DASH = "-"


@checked
def manual_table(result: Guide | DesignBounds, step: float | None = None) -> ManualTable:
    """Guidelines or bounds as a table that goes into a manual as it is.

    Parameters
    ----------
    result : Guide or DesignBounds
    step : float, optional
        Step in which the limit is rounded to the safe side, in the unit of the table (degrees for backlash); by default
        the largest 1, 2 or 5 of a decimal place that gives away 2 % at most.

    Returns
    -------
    ManualTable
        Printed as Markdown; ``write`` makes .md, .tex, .html, .docx or .xlsx of it.

    Raises
    ------
    EppError
        If there is no bound to print, the step is not positive, or larger than the smallest bound.
    """
    if step is not None and not (math.isfinite(step) and step > 0):
        raise EppError(f"manual_table: step is {shown(step)}; expected a positive number in the unit of the table.")
    return _of_guide(result, step) if isinstance(result, Guide) else _of_bounds(result, step)


def _of_guide(guide: Guide, given: float | None) -> ManualTable:
    """Backlash at the elbow, at the pulley and under tolerances (as a force, where none are given), by design."""
    (unit, degrees), (force_unit, forces) = guide.case.readable(LIMIT), guide.case.readable(GAIN)
    tolerant = any(row.tolerance is not None for row in guide.rows)
    columns: tuple[list[float], ...] = ([], [], [])
    for row in guide.rows:
        part = _tested(row.allowed, row.cell) / row.allowed
        force = forces * part * row.force
        last_value = degrees * _worst(guide, row) if tolerant else force
        values = (degrees * part * row.allowed, 1e3 * part * row.pulley, last_value)
        for column, value in zip(columns, values, strict=True):
            column.append(value)
    limits, pulleys, fourth = columns
    step = _step(limits, given, unit)
    steps = (step, drawing_step(pulleys), step if tolerant else drawing_step(fourth))
    rounded = [[_rounded(value, one) for value in column] for column, one in zip(columns, steps, strict=True)]
    rows = [
        (_design(guide, row), *values, _checked(row.cell)) for row, *values in zip(guide.rows, *rounded, strict=True)
    ]
    last = f"Backlash with all tolerances used up, at most [{unit}]"
    heads = (
        "Design",
        f"Backlash at the elbow, at most [{unit}]",
        "Play of the cable at the pulley, at most [mm]",
        last if tolerant else f"Change of the cable's force, at most [{force_unit}]",
        "Checked",
    )
    units = (unit, "mm", unit if tolerant else force_unit)
    said = ", ".join(f"{one} {name}" for one, name in dict.fromkeys(zip(map(str, steps), units, strict=True)))
    factors = [f"{number(value)} on {words(name)}" for name, value in guide.margins.items()]
    more = [f"Factors of safety that are taken off already: {', '.join(factors)}."] if factors else []
    title = f"Largest backlash without a self-sustained oscillation: {guide.case.title or guide.case.name}"
    notes = _notes([row.cell for row in guide.rows], f"Values are rounded down, in steps of {said}.")
    return ManualTable(title, heads, tuple(rows), (*notes, *more, _source(guide.provenance, guide.case.name)))


def _of_bounds(bounds: DesignBounds, given: float | None) -> ManualTable:
    """The limit for each value of the other parameter, as it is rounded and as it was computed."""
    (x_unit, x), (y_unit, y) = bounds.readable[bounds.over], bounds.readable[bounds.limit]
    found = [cell for cell in bounds if cell.finding is Finding.BOUND]
    up = bool(found) and found[0].sign < 0
    if any((cell.sign < 0) is not up for cell in found):
        raise EppError("manual_table: some bounds hold from below and some from above; expected one side for all.")
    step = _step([y * _tested(cell.bound, cell) for cell in found], given, y_unit, up=up)
    rows = []
    for cell in bounds:
        limit = _rounded(y * _tested(cell.bound, cell), step, up=up)
        rows.append(
            (_printed(x * cell.value), limit, _about(y * cell.bound, 3), _about(cell.frequency, 2), _checked(cell))
        )
    side, way = ("at least", "up") if up else ("at most", "down")
    name = words(bounds.limit)
    heads = (
        with_unit(_capital(words(bounds.over)), x_unit),
        with_unit(f"{_capital(name)}, {side}", y_unit),
        with_unit("Computed limit", y_unit),
        "Oscillation beyond it at about [Hz]",
        "Checked",
    )
    title = f"Limits on {name} without a self-sustained oscillation: {words(bounds.case)}"
    said = f"The {name} is rounded {way}, in steps of {step} {y_unit}".rstrip() + "."
    return ManualTable(
        title, heads, tuple(rows), (*_notes(list(bounds), said), _source(bounds.provenance, bounds.case))
    )


def _tested(limit: float, cell: BoundCell) -> float:
    """A limit, or where the design was tested on the safe side of it."""
    if not math.isfinite(cell.safe_value) or not math.isfinite(limit):
        return limit
    return min(limit, cell.safe_value) if cell.sign > 0 else max(limit, cell.safe_value)


def _worst(guide: Guide, row: GuideRow) -> float:
    """The limit with all tolerances used up and the factors of safety taken off; never above the one without."""
    if row.tolerance is None:
        return math.nan
    return min(guide.less_margin(row.tolerance.worst_case), row.allowed)


def _step(values: Sequence[float], given: float | None, unit: str, *, up: bool = False) -> Decimal:
    known = [value for value in values if math.isfinite(value)]
    if not known:
        raise EppError("manual_table: no bound was found; expected at least one to print.")
    if given is None:
        return drawing_step(known)
    if given > min(known) and not up:
        least = f"{number(min(known))} {unit}".rstrip()
        raise EppError(f"manual_table: step is {number(given)}; expected at most the smallest bound, {least}.")
    return Decimal(f"{given:.12g}")


def _rounded(value: float, step: Decimal, *, up: bool = False) -> Decimal | str:
    return to_step(value, step, up=up) if math.isfinite(value) else _DASH


def _printed(value: float) -> Decimal | str:
    """A value that was given, to four digits."""
    return Decimal(f"{value:.4g}") if math.isfinite(value) else _DASH


def _about(value: float, digits: int) -> Decimal | str:
    """A value to compare with, always with so many digits."""
    return Decimal(f"{value:#.{digits}g}") if math.isfinite(value) else _DASH


def _checked(cell: BoundCell) -> str:
    """Whether a limit was tested, or why there is none."""
    if cell.finding is not Finding.BOUND:
        return cell.message or cell.finding.sentence
    if cell.verified:
        return f"yes, {cell.n_runs} simulations" if cell.n_runs else "yes"
    return "no"


def _notes(cells: Iterable[BoundCell], rounding: str) -> tuple[str, ...]:
    """How to read the table, for people who have not made it."""
    bounds = [cell for cell in cells if cell.finding is Finding.BOUND]
    unchecked = sum(not cell.verified for cell in bounds)
    notes = [rounding]
    if len(bounds) > unchecked:
        notes.append(
            "Checked (second column): on the safe side of the limit all simulations came to rest and no oscillation "
            "was found; on the other side an oscillation exists."
        )
    if unchecked:
        notes.append(f"{unchecked} of {len(bounds)} limits are not checked: do not use them without a test.")
    return tuple(notes)


def _source(made_by: Provenance, name: str) -> str:
    case = made_by.case
    version = made_by.versions.get("eppanalysis", "")
    checksum = f", checksum {case['sha256'][:12]}" if "sha256" in case else ""
    return f"Computed with eppanalysis {version} from the case {name}{checksum}."


def _design(guide: Guide, row: GuideRow) -> str:
    parts = (f"{in_words(name)} {guide.case.text(name, value, 4)}" for name, value in row.values.items())
    return _capital(", ".join(parts))


def _capital(text: str) -> str:
    return text[:1].upper() + text[1:]
