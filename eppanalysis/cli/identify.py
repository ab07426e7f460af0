"""The commands of measured files: ``identify`` makes a case with measured parameters of them, ``diagnose`` says which
element of a loop explains a recorded oscillation.
"""

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
    Output,
    Settings,
    answer,
    check_output,
    echo,
    file_option,
    load_case,
    print_json,
    print_table,
    progress,
    write_output,
)
from eppanalysis.errors import EppError
from eppanalysis.readable import quantity

if TYPE_CHECKING:
    from eppanalysis.cases import Case
    from eppanalysis.diagnose.result import Diagnosis
    from eppanalysis.identify import BenchFit, Identification

_PICTURES = (".png", ".svg", ".pdf")
_FILES = (".toml", ".csv", *_PICTURES)

Measured = Annotated[Path | None, typer.Option(metavar="FILE", show_default=False)]
Outputs = Annotated[
    list[Path],
    file_option(
        "A case file (.toml), a table (.csv) or a picture (.png, .svg, .pdf); repeatable. {bench} in the name of a "
        "picture becomes tray, backlash or step."
    ),
]


def _roles() -> list[str]:
    """Begins of what ``--signal`` takes."""
    from eppanalysis.identify.columns import Role

    return [f"{role}=" for role in Role]


def identify(
    case: Annotated[
        str, typer.Argument(metavar="CASE", help="What is known beforehand: a case file, or a shipped case.")
    ],
    tray: Annotated[
        Path | None,
        typer.Option("--tray", metavar="FILE", help="Weight tray: force, voltage [, time].", show_default=False),
    ] = None,
    backlash: Annotated[
        Path | None,
        typer.Option("--backlash", metavar="FILE", help="Cycling: angle, force [, time, torque].", show_default=False),
    ] = None,
    step: Annotated[
        Path | None,
        typer.Option(
            "--step",
            metavar="FILE",
            help="Step: time, angle [, force, harness]; of other cases time and any of their signals and inputs.",
            show_default=False,
        ),
    ] = None,
    columns: Annotated[
        list[str],
        typer.Option(
            "--signal",
            "--column",
            metavar="SIGNAL=NAME:UNIT",
            help=r'Which column is what, as in force="F (lbf):lbf"; by default as in "force \[lbf]". Repeatable.',
            autocompletion=lambda incomplete: [role for role in _roles() if role.startswith(incomplete)],
        ),
    ] = NOTHING,
    settings: Annotated[
        list[str], typer.Option("--set", metavar="FIELD=VALUE", help="Override a field of the case.")
    ] = NOTHING,
    fit: Annotated[
        list[str], typer.Option("--fit", metavar="FIELD", help="Parameter to identify from the response; repeatable.")
    ] = NOTHING,
    wrap: Annotated[str, typer.Option("--wrap", help="Angle at which the weight tray loads the pulley.")] = "180 deg",
    press: Annotated[
        str, typer.Option("--press", help="Largest torque of the hand in cycling, where none is recorded.")
    ] = "0 N*m",
    seed: Annotated[int, typer.Option("--seed", help="Of the starts of the step response's fit.")] = 0,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON in SI units.")] = False,
    outputs: Outputs = NO_FILES,
) -> None:
    """Identify parameters with intervals from measured files; what the data cannot identify is named."""
    from eppanalysis.cases.files import own_or_shipped
    from eppanalysis.identify import identify as run
    from eppanalysis.identify.response import layout_of

    benches = [name for name, path in (("tray", tray), ("backlash", backlash), ("step", step)) if path is not None]
    for output in outputs:
        _check_output(output, benches)
    angle, torque = _quantity("--wrap", wrap, "rad"), _quantity("--press", press, "N*m")
    base = load_case(case, settings)
    if not benches:
        expected = "--tray, --backlash or --step" if base.kind == "elbow" else "--step"
        raise EppError(f"identify: no measured file is given; expected {expected}.")
    chosen = _choices(columns, {"time": "s", **layout_of(base).units}) if columns else {}
    tray, backlash, step = (None if path is None else own_or_shipped(path) for path in (tray, backlash, step))
    with progress("identify") as advance:
        found = run(
            base, tray=tray, backlash=backlash, step=step, columns=chosen, wrap=angle, press=torque,
            fit=fit or None, seed=seed, progress=advance,
        )  # fmt: skip
    if as_json:
        print_json("identify", [(found.case, found)], settings)
    else:
        for part in found.fits:
            _show(part)
    for output in outputs:
        _write(found, output, benches)


def _choices(texts: Sequence[str], names: Mapping[str, str]) -> dict[str, tuple[str, str]]:
    """Name and unit of the column of each signal that ``--signal`` names, of those with a unit."""
    from eppanalysis.records.columns import parse_choice

    out: dict[str, tuple[str, str]] = {}
    for text in texts:
        name, header, unit = parse_choice(text, names)
        if name in out:
            raise EppError(f"--signal {text}: {name} is given twice; expected each signal once.")
        out[name] = (header, unit)
    return out


def _quantity(option: str, text: str, unit: str) -> float:
    from eppanalysis.errors import CaseError
    from eppanalysis.units import QuantityError, parse_quantity

    try:
        return parse_quantity(text, unit)
    except QuantityError as error:
        raise CaseError(option, "", text, error.expected) from None


def _check_output(output: Path, benches: Sequence[str]) -> None:
    check_output(output, _FILES, stands_for=("bench",) if output.suffix.lower() in _PICTURES else ())
    if output.suffix.lower() in _PICTURES and len(benches) > 1 and "{bench}" not in output.name:
        raise EppError(f"{output}: is one picture for {len(benches)} tests; expected {{bench}} in its name.")


def _show(fit: BenchFit) -> None:
    echo()
    echo(f"{fit.bench}: {fit.source}", bold=True)
    for estimate in fit.estimates:
        note = f" ({estimate.note})" if estimate.note and estimate.identified else ""
        identified = "" if estimate.identified else f"  NOT IDENTIFIED BY THESE DATA: {estimate.note}"
        echo(f"  {estimate}{note}{identified}")
    for role, left in fit.residuals.items():
        echo(
            f"  residual of {role}: {quantity(left.rms, left.unit, 3)} rms, autocorrelation "
            f"{left.autocorrelation:+.2f}, drift {quantity(left.drift, left.unit, 2)}"
        )
    echo("  " + " ".join([fit.limit_sentence(), *fit.notes]))
    if not fit.status.ok:
        echo(f"  {fit.message}")


def _write(found: Identification, output: Path, benches: Sequence[str]) -> None:
    from eppanalysis.tables.files import Table, write_figure, write_table
    from eppanalysis.writing import write_text

    if output.suffix.lower() == ".toml":
        write_text(found.to_toml(), output)
    elif output.suffix.lower() == ".csv":
        rows = [
            {"test": fit.bench, "parameter": e.name, **{k: v for k, v in e.to_dict().items() if k != "note"}}
            for fit in found.fits
            for e in fit.estimates
        ]
        write_table(Table.from_rows(rows), output)
    else:
        for name, fit in zip(benches, found.fits, strict=True):
            write_figure(fit.plot(), output.with_name(output.name.replace("{bench}", name)))


def diagnose(
    case: CaseName,
    record: Annotated[Path, typer.Argument(metavar="FILE", help="The record: time and signals of the loop.")],
    settings: Settings = NOTHING,
    columns: Annotated[
        list[str],
        typer.Option(
            "--signal",
            "--column",
            metavar="SIGNAL=NAME:UNIT",
            help=r'Which column is what, as in level="LT 4 (mm):mm" or theta=attitude.pitch; by default as in '
            r'"level \[mm]". A name alone is of the signal so called, or of the only one. Repeatable.',
        ),
    ] = NOTHING,
    model_error: Annotated[
        float, typer.Option("--model-error", help="Relative error of the model's periods, sizes and harmonics.")
    ] = 0.02,
    steps: Annotated[
        int | None,
        typer.Option(
            "--steps",
            help="Steps of the engine for the search of each candidate's cycles. [1000000]",
            show_default=False,
        ),
    ] = None,
    as_json: Json = False,
    output: Output = None,
) -> None:
    """Say which element explains a recorded oscillation, how large it is, and what the record cannot tell."""
    from eppanalysis.cases.files import own_or_shipped
    from eppanalysis.diagnose import STEPS, diagnose as run
    from eppanalysis.tables.files import diagnosis_table

    check_output(output)
    found = load_case(case, settings)
    chosen = _choices(columns, {"time": "s", **found.to_system().signals.units_by_name()})
    with progress(f"diagnose {found.name}") as advance:
        result = run(
            found,
            own_or_shipped(record),
            columns=chosen,
            model_error=model_error,
            steps=STEPS if steps is None else steps,
            progress=advance,
        )
    answer("diagnose", found, settings, as_json, result, lambda: _show_diagnosis(found, result))
    write_output(output, result, diagnosis_table)


def _show_diagnosis(case: Case, result: Diagnosis) -> None:
    from eppanalysis.cases.command_line import Commands
    from eppanalysis.tables.console import candidates_table

    for note in result.record.notes:
        echo(note)
    echo(f"{result.headline()}.", bold=True)
    detail = str(result).removeprefix(f"{result.headline()}: ")
    echo(f"{detail[:1].upper()}{detail[1:]}")
    print_table(candidates_table(result))
    for name, why in result.left_out.items():
        echo(f"{name} {why}.")
    for line in result.remedies():
        echo(line)
    if result.named:
        echo(f"What ends the oscillation of the model: {Commands.of(case).remedies()}")
