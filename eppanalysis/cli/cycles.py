"""The commands ``eppanalysis cycles`` and ``eppanalysis branch``: exact limit cycles, and how they change."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated, Any

import typer

from eppanalysis.cli.common import (
    NOTHING,
    CaseName,
    Found,
    Json,
    Output,
    Picture,
    Settings,
    answer,
    check_output,
    echo,
    load_case,
    progress,
    write_output,
)
from eppanalysis.errors import EppError
from eppanalysis.readable import DIGITS, count, lasting, number, quantity, readable, words

if TYPE_CHECKING:
    from eppanalysis.cases import Case
    from eppanalysis.methods.continuation.result import Branch
    from eppanalysis.methods.search.result import CycleSearch
    from eppanalysis.methods.search.trigger import Trigger
    from eppanalysis.progress import Progress
    from eppanalysis.remedies import Remedies


def cycles(
    case: CaseName,
    settings: Settings = NOTHING,
    triggers: Annotated[
        bool, typer.Option("--trigger", help="Also the smallest disturbances that start a cycle.")
    ] = False,
    ends: Annotated[
        bool, typer.Option("--remedies", help="Also why it oscillates, and what ends it, each change tried.")
    ] = False,
    as_json: Json = False,
    output: Output = None,
) -> None:
    """Search for limit cycles, stable and unstable, as exact orbits, and say how; a search may miss one."""
    check_output(output)
    found = load_case(case, settings)
    from eppanalysis.cases.command_line import Commands
    from eppanalysis.methods.search.find import find_limit_cycles
    from eppanalysis.tables.files import cycle_table

    with progress(f"cycles {found.name}") as advance:
        search = find_limit_cycles(found, progress=advance)
        hits, why = _triggers(found, search) if triggers else ((), "")
        remedies = _remedies(found, search, advance) if ends else None

    def data() -> dict[str, Any]:
        told = {"triggers": [hit.to_dict() for hit in hits], "no_triggers": why}
        return {**search.to_dict(), **told, "remedies": None if remedies is None else remedies.to_dict()}

    def show() -> None:
        _show_cycles(found, search)
        if remedies is not None:
            echo("\n".join(remedies.lines()))
        elif search.stable:
            echo(f"Why it oscillates, and what ends it: {Commands.of(found).remedies()}")
        _show_triggers(found, hits, why)

    answer("cycles", found, settings, as_json, Found(str(search), data()), show)
    write_output(output, search, lambda result: cycle_table(result.cycles))


def _remedies(case: Case, search: CycleSearch, progress: Progress | None) -> Remedies:
    """Why the case oscillates, and what ends it."""
    from eppanalysis.remedies import remedies

    return remedies(case, search, progress=progress)


def _triggers(case: Case, search: CycleSearch) -> tuple[Sequence[Trigger], str]:
    """The smallest disturbances that start a cycle, or why there are none: an answer of the loop, as others are."""
    from eppanalysis.methods.search.trigger import NoRest, trigger

    if not search.stable:
        return (), "no stable cycle was found, so none is there for a disturbance to start."
    try:
        return trigger(case, cycles=search), ""
    except NoRest as error:
        return (), str(error).removeprefix(f"{case.name}: ")


def branch(
    case: CaseName,
    over: Annotated[str, typer.Option("--over", metavar="FIELD", help="The parameter, as in bands.range.")],
    start: Annotated[str, typer.Option("--from", metavar="VALUE", help="Where the branch begins.")],
    stop: Annotated[str, typer.Option("--to", metavar="VALUE", help="Where it ends.")],
    settings: Settings = NOTHING,
    points: Annotated[int, typer.Option("--points", help="At most so many orbits.")] = 200,
    as_json: Json = False,
    output: Picture = None,
) -> None:
    """Follow a limit cycle over a parameter, through folds, and name every special point."""
    from eppanalysis.methods.continuation.branch import continue_branch
    from eppanalysis.tables.files import PICTURES, write_figure

    check_output(output, PICTURES)
    if points < 1:
        raise EppError(f"--points {points}: is no number of orbits; expected 1 or more.")
    found = load_case(case, settings)
    found.unit(over)  # refuses what is no field, before its values are blamed
    for option, value in (("--from", start), ("--to", stop)):
        found.with_values({over: value}, option)
    with progress(f"branch {found.name}") as advance:
        result = continue_branch(found, over, start, stop, n_points=points, progress=advance)
    answer("branch", found, settings, as_json, result, lambda: _show_branch(found, over, result))
    if output is not None:
        write_figure(result.plot(signal=found.expected.signal), output)


def _show_cycles(case: Case, search: CycleSearch) -> None:
    echo(f"{search}\nSought with {search.search}")
    for cycle in search:
        name = case.expected.signal or next(iter(cycle.peak_to_peak))
        kind = "stable  " if cycle.stable else "unstable"
        told = "; ".join(filter(None, (cycle.stability_criterion, cycle.note)))
        echo(
            f"  {kind}  period {lasting(cycle.period, cycle.units)}  frequency {number(cycle.frequency)} Hz  "
            f"{words(name)} {quantity(cycle.peak_to_peak[name], cycle.units[name])} peak to peak  {told}"
        )


def _show_triggers(case: Case, triggers: Sequence[Trigger], why: str) -> None:
    for hit in triggers:
        echo(f"trigger: {_trigger_text(case, hit)}")
    if why:
        echo(f"trigger: {why}")


def _trigger_text(case: Case, hit: Trigger) -> str:
    """The threshold between its two sides, with as many digits as tell them apart."""
    from eppanalysis.methods.search.trigger import GROWS

    unit, factor = readable(hit.unit or case.input_units.get(hit.name, ""))
    name, tail = words(hit.name), f" {unit}" if unit else " (SI unit)"
    if math.isnan(hit.size):
        return f"{name} by up to {number(hit.tried * factor)}{tail} starts no cycle."
    if hit.size == 0.0:
        return f"{name} by any size starts a cycle: {GROWS}."
    for digits in range(DIGITS, 18):
        starts, settles = (f"{value * factor:.{digits}g}" for value in (hit.starts, hit.settles))
        if starts != settles:
            break
    return f"{name} by {starts}{tail} starts a cycle; {settles}{tail} settles."


def _show_branch(case: Case, over: str, result: Branch) -> None:
    echo(f"{result.headline()}.")
    for branch in (result, *result.others):
        value = branch.points["value"]
        low, high = branch.ends_of(float(value.min()), float(value.max()))
        echo(f"{count(len(branch), 'orbit')} over {words(over)} between {low} and {high}. {branch.message}")
        for special in branch.special:
            echo(f"  {special.kind} at {branch.place(special)}: {special.note}")
    for gap in result.missing:
        low, high = (case.text(over, v, DIGITS) for v in (gap.low, gap.high))
        echo(f"No orbit between {low} and {high}: {gap.why}.")
