"""The command ``eppanalysis guide``: design guidelines on backlash, as tables, sentences and a picture."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from eppanalysis.cli.common import (
    NO_FILES,
    NOTHING,
    CaseName,
    Json,
    Settings,
    check_output,
    heading,
    load_case,
    print_json,
    print_table,
    progress,
    split_pair,
    within_of,
)
from eppanalysis.cli.manual import Manual, Step, step_for_manual, write_manual
from eppanalysis.errors import EppError

if TYPE_CHECKING:
    from eppanalysis.cases import Case
    from eppanalysis.guides.guideline import Guide

_GAINS = "1.5 lbf,2.5 lbf,3.5 lbf"
_END = "; repeatable."


def guide(
    case: CaseName,
    settings: Settings = NOTHING,
    gains: Annotated[str, typer.Option("--gains", metavar="VALUES", help="Profile ranges, at commas.")] = _GAINS,
    vary: Annotated[
        list[str],
        typer.Option(
            "--vary", metavar="FIELD=VALUES", help='Variants, as in cable.stiffness="3000 N/m,6705 N/m"' + _END
        ),
    ] = NOTHING,
    tolerances: Annotated[
        list[str],
        typer.Option("--tolerance", metavar="FIELD=VALUE", help='As in cable.stiffness="10 %"' + _END),
    ] = NOTHING,
    margins: Annotated[
        list[str],
        typer.Option("--margin", metavar="FIELD=FACTOR", help="On bands.range or lock_pin.backlash" + _END),
    ] = NOTHING,
    within: Annotated[
        str | None, typer.Option("--within", metavar="LOW..HIGH", help="Range of backlash to look in.")
    ] = None,
    samples: Annotated[int, typer.Option("--samples", help="Draws for the probabilities.")] = 400,
    starts: Annotated[int, typer.Option("--starts", help="Runs that test each bound.")] = 1000,
    seed: Annotated[int, typer.Option("--seed", help="Seed of runs and draws.")] = 20050901,
    workers: Annotated[
        int | None, typer.Option("--workers", help="Processes. [one a core]", show_default=False)
    ] = None,
    as_json: Json = False,
    manual: Manual = None,
    step: Step = None,
    outputs: Annotated[
        list[Path],
        typer.Option("-o", "--output", metavar="FILE", help=".md, .csv, .tex, .html, .xlsx, .png, .svg or .pdf" + _END),
    ] = NO_FILES,
) -> None:
    """Say how much backlash an elbow may have at several gains, with tolerances and margins."""
    from eppanalysis.guides.files import FILES, check_file, title
    from eppanalysis.guides.guideline import GAIN, LIMIT, design_guide
    from eppanalysis.methods.bounds.design import cores

    for path in outputs:
        check_output(path, FILES)
        check_file(path)
    found = load_case(case, settings)
    rounding = step_for_manual(found, LIMIT, manual, step)
    chosen = {name: _values(text) for name, text in (split_pair(v, "--vary", "FIELD=VALUES") for v in vary)}
    for option, values in (("--gains", {GAIN: _values(gains)}), ("--vary", chosen)):
        _check_values(found, option, values)
    with progress(f"guide {found.name}") as advance:
        result = design_guide(
            found,
            _values(gains),
            variants=chosen,
            tolerances=dict(split_pair(t, "--tolerance", "FIELD=VALUE") for t in tolerances) or None,
            margins={
                name: _factor(name, text) for name, text in (split_pair(m, "--margin", "FIELD=FACTOR") for m in margins)
            },
            within=within_of(within),
            samples=samples,
            starts=starts,
            workers=cores() if workers is None else workers,
            seed=seed,
            progress=advance,
        )
    if as_json:
        print_json("guide", [(found, result.to_dict())], settings)
    else:
        heading(title(result), settings)
        _show(result)
    for path in outputs:
        result.write(path)
    write_manual(result, manual, rounding)


def _check_values(case: Case, option: str, values: Mapping[str, Sequence[str]]) -> None:
    """Refuse values that the case cannot take, by the name of the option that holds them."""
    from eppanalysis.cases.variation import variation_of

    if not variation_of(case).has_guideline:
        return  # refused as such in a moment, which says more than what its fields are
    for name, texts in values.items():
        if not texts:
            raise EppError(f"{option}: holds no value of {name}; expected one or more, at commas.")
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
    from eppanalysis.guides.files import facts
    from eppanalysis.tables.console import frame_table

    print_table(frame_table(result.rounded()))
    for sentence in result.sentences():
        typer.echo(sentence)
    typer.echo(facts(result))
