"""Guidelines and bounds as tables for manuals: five columns, rounded to the safe side in a step that is said.

A limit is rounded from the value at which the design was tested, not from the bound itself: what is printed was seen to
come to rest, or lies on the safe side of what was. See ``docs/howto/bounds.md``.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from decimal import Decimal
from typing import TypeVar

from eppanalysis.arguments import checked
from eppanalysis.errors import ArgumentError, EppError, shown
from eppanalysis.guides.result import Guide, GuideRow, Region, Side, in_words
from eppanalysis.limits import Limit, Printed
from eppanalysis.methods.bounds.result import BoundCell, DesignBounds, Finding, Known
from eppanalysis.methods.bounds.sizes.allowed import Allowed
from eppanalysis.readable import number, with_unit, words
from eppanalysis.results.provenance import Provenance
from eppanalysis.tables.manual import ManualTable, Shade

_DASH = "-"
_OSCILLATION = "self-sustained oscillation"
#: Digits of a computed limit beside the one that is printed.
_COMPUTED = 3
R = TypeVar("R", Guide, DesignBounds)
#: The shade of a limit, by how it is known; the words are beside it.
_SHADES = {
    Known.PROVED: Shade.SURE,
    Known.TESTED: Shade.SURE,
    Known.EXACT: Shade.LIKELY,
    Known.SEARCHED: Shade.LIKELY,
    Known.BALANCED: Shade.ROUGH,
    Known.NONE: Shade.NONE,
}


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
        If the step is not positive, or larger than the smallest bound.

    Examples
    --------
    >>> import eppanalysis as epp
    >>> case = epp.case("relay_deadzone")
    >>> bounds = epp.design_bounds(
    ...     case,
    ...     over="loop.gain",
    ...     limit="relay_dead_zone.threshold",
    ...     start=1.0,
    ...     stop=1.0,
    ...     points=1,
    ...     starts=20,
    ... )
    >>> print(str(epp.manual_table(bounds)).splitlines()[4])
    | 1 | 1.68 | 1.67 | 0.15 | yes, 20 simulations |
    """
    if step is not None and not (math.isfinite(step) and step > 0):
        raise EppError(f"manual_table: step is {shown(step)}; expected a positive number in the unit of the table.")
    if isinstance(result, Guide):
        return _of_guide(in_steps(result, step))
    return _of_bounds(in_steps(result, step))


def in_steps(result: R, step: float | None) -> R:
    """The result with its limits printed in a step, where one is given.

    Raises
    ------
    EppError
        If the step is larger than the smallest limit.
    """
    if step is None:
        return result
    printed, rows = result.printed, result.rows if isinstance(result, Guide) else result.cells
    limits = [row.printed for row in rows if math.isfinite(row.printed.value)]
    least = min((printed.factor * limit.safe for limit in limits), default=math.inf)
    if step > least and not any(limit.holds_above for limit in limits):
        given, shortest = (f"{number(value)} {printed.unit}".rstrip() for value in (step, least))
        raise ArgumentError("step", f" is {given}; expected at most the smallest bound, {shortest}.", "manual_table")
    return replace(result, step=step)


def _of_guide(guide: Guide) -> ManualTable:
    """The limit by design, rounded; beside it an elbow's backlash at the pulley, or what happens beyond the limit."""
    up = _holds_from_below(row.cell for row in guide.rows)
    printed = guide.printed
    beside = [_under_tolerances(guide)] if any(row.tolerance is not None for row in guide.rows) else []
    if guide.of_backlash:
        pulley, force = _at_the_pulley(guide)
        beside = [pulley, *(beside or [force])]
    else:
        struck = _rests_unless_struck(guide)
        beside = beside or [struck] * any(cell != _DASH for cell in struck.cells)
        beside = [*beside, _frequencies(row.cell for row in guide.rows)]
    name = "Backlash at the elbow" if guide.of_backlash else _capital(in_words(guide.limit))
    heads = (
        "Design",
        with_unit(f"{name}, {'at least' if up else 'at most'}", printed.unit),
        *(c.head for c in beside),
        "Checked",
    )
    cells = zip(*(c.cells for c in beside), strict=True)
    rows = [
        (_design(guide, row), printed.number(row.printed), *more, _checked(row.cell))
        for row, more in zip(guide.rows, cells, strict=True)
    ]
    steps = dict.fromkeys([printed.in_steps, *(c.step for c in beside if c.step)])
    factors = [f"{number(value)} on {words(name)}" for name, value in guide.margins.items()]
    more = [f"Factors of safety that are taken off already: {', '.join(factors)}."] if factors else []
    what = "Largest" if not up else "Smallest"
    named = guide.case.title or guide.case.name
    title = f"{what} {in_words(guide.limit)} {guide.without(_OSCILLATION)}: {named}"
    found = [row.cell for row in guide.rows]
    notes = _notes(found, _how_rounded("Values", found, up, steps), guide.allowed)
    said = [c.note for c in beside if c.note] + ([guide.not_covered] if guide.not_covered else [])
    made_by = source(guide)
    return ManualTable(title, heads, tuple(rows), (*notes, *said, *more, made_by), _shades(r.cell for r in guide.rows))


def limit_grid(
    guide: Guide, rounding: float | None = None
) -> tuple[list[list[GuideRow | None]], list[str], list[list[str]], str]:
    """The limits as a grid: values of the parameter that runs down, variants across.

    Parameters
    ----------
    rounding : float, optional
        As `step` of :func:`manual_table`.

    Returns
    -------
    cells : list of list of GuideRow or None
    heads : list of str
        The variants in words.
    texts : list of list of str
        The limits, rounded to the safe side; a dash where there is none.
    step : str
        That step with its unit.
    """
    _holds_from_below(row.cell for row in guide.rows)
    printed = in_steps(guide, rounding).printed
    groups = guide.variants()
    values = list(dict.fromkeys(row.values[guide.over] for row in guide.rows))
    by_place = [{row.values[guide.over]: row for row in rows} for rows in groups.values()]
    cells = [[rows.get(value) for rows in by_place] for value in values]
    texts = [[_DASH if cell is None else printed.digits(cell.printed) for cell in row] for row in cells]
    return cells, [guide.variant_in_words(variant) for variant in groups], texts, printed.in_steps


@dataclass(frozen=True)
class _Column:
    """A column beside the limits: its heading, its cells, its step with unit, and how it is to be read."""

    head: str
    cells: list[Decimal | str]
    step: str = ""
    note: str = ""


def _at_the_pulley(guide: Guide) -> tuple[_Column, _Column]:
    """The limit on an elbow's backlash as a play of the cable and as a force."""
    heads = ("Play of the cable at the pulley, at most", "pulley"), ("Change of the cable's force, at most", "force")
    made = []
    for (head, name), printed in zip(heads, guide.at_the_pulley()[:2], strict=True):
        cells = [printed.number(guide.lesser(row, name)) for row in guide.rows]
        made.append(_Column(with_unit(head, printed.unit), cells, printed.in_steps))
    return made[0], made[1]


def _under_tolerances(guide: Guide) -> _Column:
    printed = guide.printed
    side = "at least" if guide.side is Side.ABOVE else "at most"
    head = with_unit(f"{_capital(in_words(guide.limit))} with all tolerances used up, {side}", printed.unit)
    return _Column(head, [printed.number(guide.worst(row)) for row in guide.rows], printed.in_steps)


def _rests_unless_struck(guide: Guide) -> _Column:
    """Up to where beyond the limit the case's own run comes to rest."""
    printed = guide.printed
    cells = [
        printed.number(row.printed.beside(row.rests_to))
        if row.cell.sign * (row.rests_to - row.cell.bound) > 0
        else _DASH
        for row in guide.rows
    ]
    larger, rest, came = "", "rest", "came to rest"
    if guide.allowed is not None:
        larger, rest, came = " larger than allowed", "what is allowed", "stayed within what is allowed"
    struck = _capital(guide.says(Region.STRUCK))
    note = (
        f"{struck}: beyond the limit an oscillation{larger} exists beside {rest}; up to this value the ordinary run of "
        f"the case {came} wherever it was tried. A blow may start the oscillation."
    )
    head = with_unit(f"{struck} {'down' if guide.side is Side.ABOVE else 'up'} to", printed.unit)
    return _Column(head, cells, note=note)


def _frequencies(cells: Iterable[BoundCell]) -> _Column:
    return _Column("Oscillation beyond it at about [Hz]", [_about(cell.frequency, 2) for cell in cells])


def _holds_from_below(cells: Iterable[BoundCell]) -> bool:
    """Whether the limits are the least that a parameter may be.

    Raises
    ------
    EppError
        If some are and others are not.
    """
    found = [cell for cell in cells if cell.finding is Finding.BOUND]
    up = bool(found) and found[0].sign < 0
    if any((cell.sign < 0) is not up for cell in found):
        raise EppError("manual_table: some bounds hold from below and some from above; expected one side for all.")
    return up


def _shades(cells: Iterable[BoundCell]) -> tuple[Shade, ...]:
    """The shade of each row, by how its limit is known."""
    return tuple(_SHADES[cell.known] for cell in cells)


def _of_bounds(bounds: DesignBounds) -> ManualTable:
    """The limit for each value of the other parameter, as it is rounded and as it was computed."""
    (x_unit, x), (y_unit, _) = bounds.readable[bounds.over], bounds.readable[bounds.limit]
    up = _holds_from_below(bounds)
    found, printed = [cell for cell in bounds if cell.known is not Known.NONE], bounds.printed
    rows = [
        (
            _printed(x * cell.value),
            printed.number(cell.printed),
            _figures(printed, cell.printed),
            _about(cell.frequency, 2),
            _checked(cell),
        )
        for cell in bounds
    ]
    side = "at least" if up else "at most"
    name = words(bounds.limit)
    heads = (
        with_unit(_capital(words(bounds.over)), x_unit),
        with_unit(f"{_capital(name)}, {side}", y_unit),
        with_unit("Computed limit", y_unit),
        "Oscillation beyond it at about [Hz]",
        "Checked",
    )
    cycle = _OSCILLATION if bounds.allowed is None else bounds.allowed.exceeded
    title = f"Limits on {name} without a {cycle}: {words(bounds.case)}"
    said = _how_rounded(f"{_capital(name)}, {side}", found, up, [printed.in_steps])
    notes = (*_notes(list(bounds), said, bounds.allowed), *([bounds.not_covered] if bounds.not_covered else []))
    made_by = _source(bounds.provenance, bounds.case)
    return ManualTable(title, heads, tuple(rows), (*notes, made_by), _shades(bounds))


def _is_tested(cell: BoundCell) -> bool:
    return math.isfinite(cell.safe_value)


def _figures(printed: Printed, limit: Limit) -> Decimal | str:
    """Where a limit was computed to be, always with so many digits, cut to the safe side."""
    text = printed.figures(limit, _COMPUTED)
    return text if text == _DASH else Decimal(f"{float(text):#.{_COMPUTED}g}")


def _printed(value: float) -> Decimal | str:
    """A value that was given, to four digits."""
    return Decimal(f"{value:.4g}") if math.isfinite(value) else _DASH


def _about(value: float, digits: int) -> Decimal | str:
    """A value to compare with, always with so many digits."""
    return Decimal(f"{value:#.{digits}g}") if math.isfinite(value) else _DASH


def _checked(cell: BoundCell) -> str:
    """Whether a limit was tested, or why there is none."""
    if cell.known is Known.NONE:
        return cell.message or cell.finding.sentence
    if cell.known is Known.SEARCHED:
        return "by search" if cell.verified else "no"
    if cell.verified:
        return f"yes, {cell.n_runs} simulations" if cell.n_runs else "yes"
    return "no"


def _how_rounded(what: str, cells: Iterable[BoundCell], up: bool, steps: Iterable[str]) -> str:
    """Where the values of a table come from."""
    tested = "as tested on the safe side of the computed limit" if any(map(_is_tested, cells)) else "as computed"
    return f"{what}: {tested}, rounded {'up' if up else 'down'}, in steps of {', '.join(steps)}."


def _notes(cells: Iterable[BoundCell], rounding: str, allowed: Allowed | None) -> tuple[str, ...]:
    """How to read the table, for people who have not made it."""
    bounds = [cell for cell in cells if cell.known is not Known.NONE]
    unchecked = sum(not cell.verified for cell in bounds)
    searched = any(cell.known is Known.SEARCHED for cell in bounds)
    notes = [rounding] if bounds else ["There is no limit to print; the last column gives the reason."]
    rest, larger = "came to rest", ""
    if allowed is not None:
        notes.append(f"Allowed is a lasting oscillation up to {allowed}.")
        rest, larger = "came to rest or stayed within what is allowed", " larger than that"
    if len(bounds) > unchecked and not searched:
        notes.append(
            f"Checked: on the safe side of the computed limit all simulations {rest} and no oscillation{larger} was "
            f"found; on the other side an oscillation{larger} exists."
        )
    if unchecked:
        are, them = ("is", "it") if unchecked == 1 else ("are", "them")
        notes.append(f"{unchecked} of {len(bounds)} limits {are} not checked: do not use {them} without a test.")
    return tuple(notes)


def source(guide: Guide) -> str:
    """What made a guideline, in a sentence for people who do not make them."""
    return _source(guide.provenance, guide.case.name)


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
