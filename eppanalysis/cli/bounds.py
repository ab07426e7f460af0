"""The command ``eppanalysis bounds``: how far one parameter may go at each value of another, and its picture."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated

import typer

from eppanalysis.cli.common import (
    NO_FILES,
    NOTHING,
    Allow,
    CaseName,
    Certificates,
    Json,
    Output,
    Prove,
    Settings,
    Workers,
    answer,
    check_output,
    check_value,
    echo,
    load_case,
    print_table,
    progress,
    within_of,
    write_output,
)
from eppanalysis.cli.manual import Manuals, Step, step_for_manual, stepped, write_manual
from eppanalysis.errors import EppError
from eppanalysis.readable import count

if TYPE_CHECKING:
    from eppanalysis.cases import Case
    from eppanalysis.methods.bounds.result import DesignBounds
    from eppanalysis.tables.files import Table

Field = Annotated[
    str | None,
    typer.Option(
        "--over", metavar="FIELD", help="The parameter that runs, as in bands.range; without it one bound is found."
    ),
]
Limit = Annotated[
    str,
    typer.Option(
        "--limit",
        metavar="FIELD",
        help="The parameter that is bounded, as in lock_pin.backlash, or a field of an input, as in run.input.size.",
    ),
]


def bounds(
    case: CaseName,
    limit: Limit,
    over: Field = None,
    settings: Settings = NOTHING,
    start: Annotated[str | None, typer.Option("--from", metavar="VALUE", help="First value of --over.")] = None,
    stop: Annotated[str | None, typer.Option("--to", metavar="VALUE", help="Last value of --over.")] = None,
    points: Annotated[int, typer.Option("--points", help="Number of values of --over.")] = 9,
    within: Annotated[
        str | None,
        typer.Option(
            "--within", metavar="LOW..HIGH", help='Range of --limit to look in, as in "0.1 deg..5 deg" or "± 50 %".'
        ),
    ] = None,
    allow: Allow = None,
    own_run: Annotated[
        bool, typer.Option("--own-run", help="For a sampled loop, use the case's own run alone, not the search.")
    ] = False,
    verify: Annotated[bool, typer.Option("--verify/--no-verify", help="Test every bound on both sides.")] = True,
    margin: Annotated[float, typer.Option("--margin", help="Distance of the tests, relative to the bound.")] = 0.01,
    starts: Annotated[int, typer.Option("--starts", help="Runs of each test.")] = 1000,
    seed: Annotated[int, typer.Option("--seed", help="Seed of the runs.")] = 20050901,
    prove: Prove = False,
    certificates: Certificates = None,
    workers: Workers = None,
    as_json: Json = False,
    output: Output = None,
    manuals: Manuals = NO_FILES,
    step: Step = None,
) -> None:
    """Bound a parameter over another one: exact folds, tested on both sides, beside the describing function."""
    from eppanalysis.cases import variation_of
    from eppanalysis.methods.bounds.design import design_bounds
    from eppanalysis.workers import cores

    check_output(output)
    found = load_case(case, settings)
    if over is None:
        over, points = next(iter(variation_of(found).beside(limit)), None), 1
        if over is None:
            raise EppError(
                f"--over: is not given, and {found.name} has no positive parameter but {limit}; expected one."
            )
        start = start or found.text(over, found.value(over))
    for option, name, value in (("--from", over, start), ("--to", over, stop)):
        check_value(found, option, name, value)
    ends = within_of(found, limit, within)
    for value in ends or ():
        check_value(found, "--within", limit, value)
    rounding = step_for_manual(found, limit, manuals, step, ends)
    with progress(f"bounds {found.name}") as advance:
        result = design_bounds(
            found,
            over,
            limit,
            start=start,
            stop=stop,
            points=points,
            within=ends,
            allow=allow,
            own_run=own_run,
            verify=verify,
            margin=margin,
            starts=starts,
            seed=seed,
            prove=prove or certificates is not None,
            workers=cores() if workers is None else workers,
            progress=advance,
        )
    try:
        result = stepped(result, rounding)
    finally:  # a bound may be smaller than the step: what was computed is shown all the same
        answer("bounds", found, settings, as_json, result, lambda: _show(found, result))
        write_output(output, result, bounds_columns)
    if certificates is not None:
        result.write_certificates(certificates)
    write_manual(result, manuals)


def bounds_columns(result: DesignBounds) -> Table:
    """One row a cell, in SI units, for files."""
    from eppanalysis.tables.files import Table

    rows = [
        {
            result.over: c.value,
            "first_order": c.first_order,
            "exact": c.exact,
            **({"searched": c.searched, "values_asked": c.n_searched} if result.not_covered else {}),
            **({} if result.allowed is None else {"active": c.kind, "size": c.size}),
            "frequency": c.frequency,
            "safe_value": c.safe_value,
            "runs": c.n_runs,
            "settled": c.n_settled,
            "verified": c.verified,
            **({} if c.proved is None else {"proved_free": c.proved.free, "proved_cycle": c.proved.cycle}),
            "finding": c.finding,
            "message": c.message,
        }
        for c in result
    ]
    unit = result.units[result.limit]
    units = dict.fromkeys(("first_order", "exact", "searched", "safe_value", "proved_free", "proved_cycle"), unit)
    units |= {} if result.allowed is None else {"size": result.allowed.unit}
    return Table.from_rows(rows, {**units, result.over: result.units[result.over], "frequency": "Hz"})


def _show(case: Case, result: DesignBounds) -> None:
    from eppanalysis.tables.designs import bounds_table

    echo(f"{result.headline()}.")
    if result.own:
        echo(f"own values: {', '.join(f'{n} {case.text(n, v)}' for n, v in result.own.items())}")
    print_table(bounds_table(result))
    for sentence in sentences(case, result):
        echo(sentence)
    for cause in _why_always(case, result):
        echo(cause)


def _why_always(case: Case, result: DesignBounds) -> Iterator[str]:
    """Why a cycle exists wherever a bound was looked for, at the first such value of --over."""
    from eppanalysis.methods.bounds.result import Finding
    from eppanalysis.remedies import why

    for cell in [cell for cell in result if cell.finding is Finding.ALWAYS][:1]:
        for cause in why(case.with_values({result.over: cell.value}))[:1]:
            yield f"At {result.over} {case.text(result.over, cell.value)} it oscillates because {cause}."


def sentences(case: Case, result: DesignBounds) -> Iterator[str]:
    """What the table says in words, and what is missing in it."""
    from eppanalysis.methods.bounds.result import UNTESTED, Finding

    if result.allowed is not None:
        yield f"Allowed is a stable limit cycle up to {result.allowed}."
    yield from filter(None, [_tested(result), result.in_theorems, _first_order(result)])
    for cell in result:
        if active := cell.active(result.allowed):
            yield f"{result.over} {case.text(result.over, cell.value)}: {active}"
        if cell.message not in ("", UNTESTED) and not (cell.finding is Finding.BOUND and cell.verified):
            yield f"{result.over} {case.text(result.over, cell.value)}: {cell.message}"


def _tested(result: DesignBounds) -> str:
    """How many of the bounds were verified; of a sampled loop what they do not cover."""
    from eppanalysis.methods.bounds.result import UNTESTED, Finding

    if result.not_covered:
        # Why there is none follows for each value.
        return str(result) if any(math.isfinite(c.bound) for c in result) else result.not_covered.strip()
    found = [c for c in result if c.finding is Finding.BOUND]
    if found and all(c.message == UNTESTED for c in found):
        return "No bound was tested (--no-verify)."
    n_good, far = sum(c.verified for c in found), f"{100 * result.margin:g} %"
    return f"{n_good} of {count(len(found), 'bound')} verified {far} away from them on both sides." if found else ""


def _first_order(result: DesignBounds) -> str:
    """On which side of the bounds the DF lies; empty where none has both."""
    unsafe = [c for c in result if c.first_order_unsafe]
    if unsafe:
        worst = max(abs(c.first_order_error) for c in unsafe)
        return f"The describing function is on the unsafe side in {len(unsafe)} of them, by up to {100 * worst:.3g} %."
    known = any(math.isfinite(c.first_order_error) for c in result)
    return "The describing function is on the safe side in all of them." if known else ""
