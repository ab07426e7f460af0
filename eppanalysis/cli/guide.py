"""The command ``eppanalysis guide``: how far a parameter may go, for each design of a grid, as tables and a picture."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from eppanalysis.cli.common import (
    NO_FILES,
    NOTHING,
    Allow,
    CaseName,
    Certificates,
    Json,
    Prove,
    Settings,
    Workers,
    answer,
    by_name,
    check_output,
    echo,
    file_option,
    load_case,
    print_table,
    progress,
    split_pair,
    within_of,
)
from eppanalysis.cli.manual import Manuals, Step, step_for_manual, stepped, write_manual
from eppanalysis.errors import EppError

if TYPE_CHECKING:
    from eppanalysis.cases import Case
    from eppanalysis.guides.guideline import Guide

#: Of an elbow; other cases run from half to twice their own value.
_GAINS = ["1.5 lbf", "2.5 lbf", "3.5 lbf"]
_END = "; repeatable."


def guide(
    case: CaseName,
    settings: Settings = NOTHING,
    over: Annotated[
        str | None,
        typer.Option("--over", metavar="FIELD", help="The parameter that runs; of an elbow its gain, bands.range."),
    ] = None,
    limit: Annotated[
        str | None,
        typer.Option("--limit", metavar="FIELD", help="The parameter that is bounded; of an elbow its backlash."),
    ] = None,
    gains: Annotated[
        str | None,
        typer.Option(
            "--gains",
            metavar="VALUES",
            help="Values of --over, separated by commas; of an elbow 1.5, 2.5 and 3.5 lbf, else half, once and twice "
            "its own.",
        ),
    ] = None,
    vary: Annotated[
        list[str],
        typer.Option(
            "--vary", metavar="FIELD=VALUES", help='Variants, as in cable.stiffness="3000 N/m,6705 N/m"' + _END
        ),
    ] = NOTHING,
    tolerances: Annotated[
        list[str],
        typer.Option("--tolerance", metavar="FIELD=VALUE", help='Half-width, as in cable.stiffness="10 %"' + _END),
    ] = NOTHING,
    margins: Annotated[
        list[str],
        typer.Option("--margin", metavar="FIELD=FACTOR", help="Safety factor on the limit, or on bands.range" + _END),
    ] = NOTHING,
    within: Annotated[
        str | None, typer.Option("--within", metavar="LOW..HIGH", help="Range of the limit to look in.")
    ] = None,
    allow: Allow = None,
    samples: Annotated[int, typer.Option("--samples", help="Draws for the probabilities.")] = 400,
    starts: Annotated[int, typer.Option("--starts", help="Runs that test each bound.")] = 1000,
    seed: Annotated[int, typer.Option("--seed", help="Seed of runs and draws.")] = 20050901,
    workers: Workers = None,
    prove: Prove = False,
    certificates: Certificates = None,
    as_json: Json = False,
    manuals: Manuals = NO_FILES,
    step: Step = None,
    outputs: Annotated[
        list[Path],
        file_option(".md, .csv, .tex, .html, .docx, .xlsx, .png, .svg or .pdf" + _END),
    ] = NO_FILES,
) -> None:
    """Say how far a parameter may go in each design of a grid (how much backlash an elbow may have at each gain)."""
    from eppanalysis.guides.files import FILES, check_file, title
    from eppanalysis.guides.guideline import design_guide, pair_of
    from eppanalysis.guides.result import GAIN
    from eppanalysis.workers import cores

    for path in outputs:
        check_output(path, FILES)
        check_file(path)
    found = load_case(case, settings)
    over, limit = pair_of(found, over, limit)
    ends = within_of(found, limit, within)
    rounding = step_for_manual(found, limit, manuals, step, ends)
    values = (_GAINS if over == GAIN else None) if gains is None else _values(gains)
    chosen = {name: _values(text) for name, text in _pairs("--vary", vary, "FIELD=VALUES").items()}
    for option, given in (("--gains", {} if values is None else {over: values}), ("--vary", chosen)):
        _check_values(found, option, given)
    with progress(f"guide {found.name}") as advance:
        result = design_guide(
            found,
            values,
            over=over,
            limit=limit,
            variants=chosen,
            tolerances=_pairs("--tolerance", tolerances, "FIELD=VALUE") or None,
            margins={name: _factor(name, text) for name, text in _pairs("--margin", margins, "FIELD=FACTOR").items()},
            within=ends,
            allow=allow,
            samples=samples,
            starts=starts,
            workers=cores() if workers is None else workers,
            seed=seed,
            prove=prove or certificates is not None,
            progress=advance,
        )
    try:
        result = stepped(result, rounding)
    finally:  # a bound may be smaller than the step: what was computed is shown all the same
        for path in outputs:
            result.write(path)
        answer("guide", found, settings, as_json, result, lambda: _show(result), title(result))
    if certificates is not None:
        result.write_certificates(certificates)
    write_manual(result, manuals)


def _pairs(option: str, texts: Sequence[str], expected: str) -> dict[str, str]:
    """Names and values of an option that takes NAME=VALUE and may be repeated."""
    return by_name(option, (split_pair(text, option, expected) for text in texts))


def _check_values(case: Case, option: str, values: Mapping[str, Sequence[str]]) -> None:
    """Refuse values that the case cannot take, by the name of the option that holds them."""
    for name, texts in values.items():
        if not texts:
            raise EppError(f"{option}: holds no value of {name}; expected one or more, separated by commas.")
        for text in texts:
            case.with_values({name: text}, option)


def _values(text: str) -> list[str]:
    return [part.strip() for part in text.split(",") if part.strip()]


def _factor(name: str, text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise EppError(f"--margin {name}={text}: is no factor; expected a number of 1 or more.") from None


def _show(result: Guide) -> None:
    """The strictest limit, all limits as a grid in the step of the manual, what they are in words, and their source."""
    from eppanalysis.guides.manual import source

    echo(str(result))
    if any(math.isfinite(row.allowed) for row in result.rows):
        _show_grid(result)
        for sentence in result.sentences():
            echo(sentence)
    echo(source(result))


def _show_grid(result: Guide) -> None:
    """The limits by design."""
    from eppanalysis.guides.manual import limit_grid
    from eppanalysis.guides.result import in_words
    from eppanalysis.readable import with_unit
    from eppanalysis.tables.cells import table_of

    cells, heads, texts, step = limit_grid(result)
    unit = result.case.readable(result.limit)[0]
    what = with_unit(f"{in_words(result.limit)} at {'most' if result.side == 'below' else 'least'}", unit)
    beside = [head or what for head in heads]
    if len(heads) == 1:
        beside += ["this case", "known"]
    table = table_of(in_words(result.over), *beside)
    for row, shown in zip(cells, texts, strict=True):
        first = next(cell for cell in row if cell is not None)
        more = [result.says(first.region), first.cell.known] if len(heads) == 1 else []
        table.add_row(result.case.text(result.over, first.values[result.over], 4), *shown, *more)
    table.caption = f"{what.capitalize()}, where tests took place on the safe side of the limit, in steps of {step}."
    print_table(table)
