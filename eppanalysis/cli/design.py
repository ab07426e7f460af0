"""The command ``eppanalysis design``: the best values of parameters without a limit cycle, as a new case file."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from eppanalysis.cli.common import (
    NO_FILES,
    NOTHING,
    Allow,
    CaseName,
    Json,
    Settings,
    answer,
    by_name,
    check_output,
    check_value,
    echo,
    file_option,
    load_case,
    named_range,
    print_table,
    progress,
)
from eppanalysis.errors import EppError
from eppanalysis.readable import DIGITS, leading_name, words

if TYPE_CHECKING:
    from eppanalysis.cases import Case
    from eppanalysis.methods.design.result import Design
    from eppanalysis.tables.files import Table

Tuned = Annotated[
    list[str],
    typer.Option("--tune", metavar='"FIELD RANGE"', help='Parameter that may be chosen, as in "Kp 1..10"; repeatable.'),
]
_GOALS = "a parameter, or bandwidth, crossover, a margin, tracking_error."


def design(
    case: CaseName,
    tune: Tuned,
    settings: Settings = NOTHING,
    maximise: Annotated[str | None, typer.Option(metavar="GOAL", help=f"Quantity to maximise: {_GOALS}")] = None,
    minimise: Annotated[str | None, typer.Option(metavar="GOAL", help=f"Quantity to minimise: {_GOALS}")] = None,
    subject_to: Annotated[
        list[str],
        typer.Option(
            "--subject-to",
            metavar='"MEASURE LIMIT"',
            help='Constraint, as in "phase_margin 45 deg"; repeatable.',
            show_default=False,
        ),
    ] = NOTHING,
    at: Annotated[str | None, typer.Option("--at", metavar="NAME", help="Where to cut the loop for measures.")] = None,
    allow: Allow = None,
    tolerance: Annotated[
        list[str],
        typer.Option(
            "--tolerance",
            metavar='"FIELD WIDTH"',
            help='Half-width within which all is to hold, as in "Kp 10 %"; repeatable; "all": those of the case.',
            show_default=False,
        ),
    ] = NOTHING,
    front: Annotated[
        str | None,
        typer.Option("--front", metavar='"FIELD VALUES"', help='The optimum at each value, as in "play.gap 1,2,3".'),
    ] = None,
    verify: Annotated[bool, typer.Option("--verify/--no-verify", help="Confirm every optimum on both sides.")] = True,
    margin: Annotated[
        float, typer.Option("--margin", help="How far inside to test, as a share of the bounded parameter.")
    ] = 0.01,
    starts: Annotated[int, typer.Option("--starts", help="Runs of each test.")] = 200,
    seed: Annotated[int, typer.Option("--seed", help="Seed of the runs.")] = 20050901,
    as_json: Json = False,
    output: Annotated[
        list[Path],
        file_option(
            "Write the design as a case file (.toml), a picture (.png, .svg, .pdf) or a table (.csv); repeatable."
        ),
    ] = NO_FILES,
) -> None:
    """Choose parameters so that no limit cycle exists, or none above what is allowed."""
    from eppanalysis.methods.design.design import design as designed
    from eppanalysis.tables.files import PICTURES

    for path in output:
        check_output(path, (".toml", ".csv", *PICTURES))
    if (maximise is None) == (minimise is None):
        given = "neither --maximise nor --minimise is" if maximise is None else "both --maximise and --minimise are"
        raise EppError(f"design: {given} given; expected one of the two.")
    found = load_case(case, settings)
    fields = list(found.parameters)
    ranges = by_name("--tune", (named_range("--tune", text, found, fields) for text in tune))
    fronts = {} if front is None else dict([values_of(front, fields)])
    typed: dict[str, Mapping[str, Sequence[str]]] = {"--tune": ranges, "--front": fronts}
    for option, name in ((option, name) for option, fields in typed.items() for name in fields):
        for value in typed[option][name]:
            check_value(found, option, name, value)
    with progress(f"design {found.name}") as advance:
        result = designed(
            found,
            ranges,
            maximise=maximise,
            minimise=minimise,
            subject_to=by_name("--subject-to", (_pair("--subject-to", t, "phase_margin 45 deg") for t in subject_to))
            or None,
            at=at,
            allow=allow,
            tolerances=tolerances_of(tolerance, fields),
            front=fronts or None,
            verify=verify,
            margin=margin,
            starts=starts,
            seed=seed,
            progress=advance,
        )
    answer("design", found, settings, as_json, result, lambda: _show(found, result))
    unwritten = []
    for path in output:
        try:
            write_design(found, result, path)
        except EppError as error:  # the other files are written
            unwritten.append(str(error))
    if unwritten:
        raise EppError(" ".join(unwritten))


def _show(case: Case, result: Design) -> None:
    from eppanalysis.tables.designs import design_table

    echo(result.sentence)
    print_table(design_table(result))
    prices = {n: p for n, p in result.optimum.prices.items() if abs(p) > 5e-3}
    if prices:
        told = ", ".join(f"{n} {p:+.2g} %" for n, p in sorted(prices.items(), key=lambda item: -abs(item[1])))
        echo(f"One per cent more of each changes {words(result.objective)} by: {told}.")
    if result.values:
        told = ", ".join(f"{n} {case.text(n, v, DIGITS)}" for n, v in result.values.items())
        echo(f"Design, {100 * result.margin:g} % inside: {told}.")
    for value, best in result.front:
        if best.message and not best.confirmed:
            echo(f"{result.front_over} {case.text(result.front_over, value)}: {best.message}")


def write_design(case: Case, result: Design, path: Path) -> None:
    """The design as the kind of file that the suffix names.

    Raises
    ------
    EppError
        If no design is feasible, so that there is no case to write.
    """
    from eppanalysis.tables.files import write_result
    from eppanalysis.writing import write_text

    if path.suffix.lower() != ".toml":
        write_result(result, design_columns, path)
        return
    if not result.values:
        raise EppError(f"{path}: no design is feasible, so there is no case to write.")
    changed = case.with_values({name: case.text(name, value, 12) for name, value in result.values.items()})
    write_text(changed.to_toml(comments=True), path)


def design_columns(result: Design) -> Table:
    """The optimum and the front, one a row, in SI units."""
    from eppanalysis.tables.files import Table

    frame = result.to_frame()
    return Table.from_rows(frame.to_dict("records"), frame.attrs["units"])


def tolerances_of(texts: Sequence[str], fields: Iterable[str] = ()) -> dict[str, str] | None:
    """Half-widths of tolerances; those of the case where "all" is requested, none where nothing is.

    Raises
    ------
    EppError
        If one is no field with a width.

    Examples
    --------
    >>> tolerances_of(["Kp 10 %", "play.gap 0.1 mm"]), tolerances_of(["all"])
    ({'Kp': '10 %', 'play.gap': '0.1 mm'}, {})
    >>> tolerances_of([]) is None
    True
    """
    if list(texts) == ["all"]:
        return {}
    return by_name("--tolerance", (_pair("--tolerance", text, "Kp 10 %", fields) for text in texts)) or None


def _pair(option: str, text: str, example: str, known: Iterable[str] = ()) -> tuple[str, str]:
    name, rest = leading_name(text, known)
    if not rest:
        raise EppError(f'{option} {text}: is no name with a value; expected one, as in "{example}".')
    return name, rest


def values_of(text: str, fields: Iterable[str] = ()) -> tuple[str, list[str]]:
    """Name and values of FIELD VALUE,VALUE,...

    Raises
    ------
    EppError
        If it is none.

    Examples
    --------
    >>> values_of("play.gap 1 mm, 2 mm")
    ('play.gap', ['1 mm', '2 mm'])
    """
    name, rest = leading_name(text, fields)
    values = [value.strip() for value in rest.split(",") if value.strip()]
    if not values:
        raise EppError(
            f'--front {text}: is no field with values; expected "FIELD VALUE,VALUE", as in "play.gap 1,2,3".'
        )
    return name, values
