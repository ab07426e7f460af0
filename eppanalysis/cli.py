"""The command line: arguments to calls, results to tables, JSON or files.

Whatever computes is imported inside the command that needs it, so that ``eppanalysis --help`` answers at once.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer.core import TyperGroup

from eppanalysis.errors import EppError

if TYPE_CHECKING:
    from rich.table import Table as RichTable

    from eppanalysis.case import Case
    from eppanalysis.export import Table
    from eppanalysis.methods.ladder import Ladder
    from eppanalysis.results import LimitCycle, Prediction, Trajectory

#: Units in which people read tables, and the factor from SI; files and JSON stay in SI.
READABLE = {"rad": ("deg", 180.0 / math.pi), "rad/s": ("deg/s", 180.0 / math.pi)}


class _Commands(TyperGroup):
    """Turns an error that the user can act on into one sentence and exit code 2."""

    def invoke(self, ctx: Any) -> Any:
        try:
            return super().invoke(ctx)
        except EppError as error:
            typer.echo(str(error), err=True)
            raise typer.Exit(2) from error


app = typer.Typer(
    name="eppanalysis",
    cls=_Commands,
    help="Limit cycles of loops with backlash, friction and other nonlinear elements.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)

Cases = Annotated[
    list[str], typer.Argument(metavar="CASE", help="Case files (TOML), or names of shipped cases.", show_default=False)
]
Settings = Annotated[
    list[str],
    typer.Option(
        "--set",
        metavar="FIELD=VALUE",
        help='Override a field of every case, as in lock_pin.backlash="0.5 deg"; repeatable.',
    ),
]
NO_SETTINGS: list[str] = []
Json = Annotated[bool, typer.Option("--json", help="Print JSON in SI units instead of tables.")]
Output = Annotated[
    Path | None,
    typer.Option(
        "-o",
        "--output",
        metavar="FILE",
        help="Write a picture (.png, .svg, .pdf) or a table (.csv, .nc); {case} in it stands for the case's name.",
        show_default=False,
    ),
]


@app.callback(invoke_without_command=True)
def _version(version: Annotated[bool, typer.Option("--version", help="Print the version and stop.")] = False) -> None:
    if version:
        from eppanalysis import __version__

        typer.echo(__version__)
        raise typer.Exit


@app.command()
def check(cases: Cases, settings: Settings = NO_SETTINGS, as_json: Json = False) -> None:
    """Check case files: every field, its unit and its range."""
    valid = []
    for text in cases:
        try:
            valid.append(_load(text, settings))
        except EppError as error:
            typer.echo(str(error), err=True)
    if as_json:
        _print_json("check", {case.name: {"valid": True, **case.provenance()} for case in valid}, valid, settings)
    else:
        for case in valid:
            typer.echo(f"{case.name}: valid ({case.kind}): {case.title}")
            if len(cases) == 1:
                _print(_parameters_table(case))
    if len(valid) < len(cases):
        raise typer.Exit(2)


@app.command()
def predict(cases: Cases, settings: Settings = NO_SETTINGS, as_json: Json = False, output: Output = None) -> None:
    """Predict all limit cycles with describing functions, stable and unstable."""
    from eppanalysis.export import prediction_table
    from eppanalysis.methods.describing import predict_limit_cycles

    def run(case: Case) -> Prediction:
        return predict_limit_cycles(case.to_system())

    _carry_out("predict", cases, settings, as_json, output, _Verb(run, prediction_table, _show_prediction))


@app.command()
def simulate(cases: Cases, settings: Settings = NO_SETTINGS, as_json: Json = False, output: Output = None) -> None:
    """Simulate with every switch located, and say whether the motion settles or repeats itself."""
    from eppanalysis.export import trajectory_table
    from eppanalysis.methods.simulate import simulate as run_simulation

    def run(case: Case) -> Trajectory:
        return run_simulation(case.to_system(), case.input, t_end=case.t_end)

    _carry_out("simulate", cases, settings, as_json, output, _Verb(run, trajectory_table, _show_trajectory))


@app.command()
def validate(cases: Cases, settings: Settings = NO_SETTINGS, as_json: Json = False, output: Output = None) -> None:
    """Put prediction and simulation side by side, with their differences in per cent."""
    from eppanalysis.export import ladder_table
    from eppanalysis.methods.ladder import ladder

    _carry_out("validate", cases, settings, as_json, output, _Verb(ladder, ladder_table, _show_ladder, _show_verdicts))


@app.command("cases")
def list_cases(as_json: Json = False) -> None:
    """List the cases that ship with the package."""
    from eppanalysis.case import case as shipped, shipped_cases

    found = [shipped(name) for name in shipped_cases()]
    if as_json:
        _print_json("cases", {case.name: None for case in found}, found, ())
        return
    table = _table("name", "kind", "title", numbers=False)
    for case in found:
        table.add_row(case.name, case.kind, case.title)
    _print(table)


@dataclass(frozen=True)
class _Verb:
    """What one command does with a case: compute, make a table for files, show it; and show several together."""

    run: Callable[[Case], Any]
    to_table: Callable[[Any], Table]
    show: Callable[[Case, Any], None]
    summarise: Callable[[Sequence[Case], Sequence[Any]], None] | None = None


def _carry_out(
    command: str, texts: Sequence[str], settings: Sequence[str], as_json: bool, output: Path | None, verb: _Verb
) -> None:
    """Load all cases, compute, then print and write; nothing is computed when an argument is wrong."""
    if output is not None:
        _check_output(output, len(texts))
    cases = [_load(text, settings) for text in texts]
    results = []
    for case in cases:
        results.append(verb.run(case))
        if not as_json:
            verb.show(case, results[-1])
    if verb.summarise is not None and len(cases) > 1 and not as_json:
        verb.summarise(cases, results)
    if as_json:
        found = {case.name: result.to_dict() for case, result in zip(cases, results, strict=True)}
        _print_json(command, found, cases, settings)
    if output is not None:
        _write(output, cases, results, verb)


def _load(text: str, settings: Sequence[str]) -> Case:
    """The case of a file or of a shipped name, with the fields of ``--set`` in place."""
    from eppanalysis.case import case, read_case

    is_file = text.endswith(".toml") or Path(text).is_file()
    found = read_case(text) if is_file else case(text)
    values = dict(_setting(item) for item in settings)
    return found.with_values(values, "--set") if values else found


def _setting(text: str) -> tuple[str, Any]:
    """Field and value of ``FIELD=VALUE``; what is not a TOML value ("0.5 deg") is a text."""
    import tomllib

    field, separator, value = text.partition("=")
    if not separator or not field.strip():
        raise EppError(f"--set {text}: has no field and value; expected FIELD=VALUE.")
    try:
        return field.strip(), tomllib.loads(f"value = {value}")["value"]
    except tomllib.TOMLDecodeError:
        return field.strip(), value.strip()


def _check_output(output: Path, n_cases: int) -> None:
    from eppanalysis.export import check_target

    check_target(output)
    if n_cases > 1 and "{case}" not in output.name and output.suffix.lower() != ".csv":
        raise EppError(f"{output}: is one file for {n_cases} cases; expected {{case}} in its name, or a table (.csv).")


def _write(output: Path, cases: Sequence[Case], results: Sequence[Any], verb: _Verb) -> None:
    """One file a case where the name holds ``{case}``, else one file."""
    from eppanalysis.export import join, write_result, write_table

    if "{case}" not in output.name and len(cases) > 1:
        tables = [(case.name, verb.to_table(result)) for case, result in zip(cases, results, strict=True)]
        write_table(join(tables), output)
        return
    for case, result in zip(cases, results, strict=True):
        name = output.name.replace("{case}", case.name)
        write_result(result, verb.to_table, output.with_name(name))


def _print_json(command: str, results: Mapping[str, Any], cases: Iterable[Case], settings: Sequence[str]) -> None:
    import json

    from eppanalysis import __version__

    document = {
        "eppanalysis": __version__,
        "command": command,
        "set": dict(_setting(item) for item in settings),
        "cases": [
            {"name": case.name, "title": case.title, "kind": case.kind, "result": results[case.name]} for case in cases
        ],
    }
    sys.stdout.write(json.dumps(_json_value(document), indent=2, allow_nan=False, ensure_ascii=False) + "\n")


def _json_value(value: Any) -> Any:
    """Plain JSON: arrays as lists, complex numbers as [real, imaginary], what is not finite as null."""
    if hasattr(value, "tolist"):
        value = value.tolist()
    if isinstance(value, Mapping):
        return {str(key): _json_value(item) for key, item in value.items()}
    if isinstance(value, list | tuple | set):
        return [_json_value(item) for item in value]
    if isinstance(value, complex):
        return [_json_value(value.real), _json_value(value.imag)]
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return value if value is None or isinstance(value, bool | int | str) else str(value)


def _parameters_table(case: Case) -> RichTable:
    """Every value of a case with where it comes from."""
    table = _table("field", "value", "from", "note", numbers=False)
    for name, parameter in case.parameters.items():
        table.add_row(name, str(parameter), parameter.mark, parameter.note)
    return table


def _show_prediction(case: Case, prediction: Prediction) -> None:
    n = len(prediction)
    _heading(case, f"{n or 'no'} limit cycle{'' if n == 1 else 's'} predicted. {prediction.search}")
    if not prediction.status.ok:
        typer.echo(prediction.status.value)
    if n:
        _print(_cycles_table(list(prediction)))
    if prediction.margins:
        typer.echo(
            "margins of the linearised loop: " + ", ".join(f"{k} {v:.4g}" for k, v in prediction.margins.items())
        )


def _show_trajectory(case: Case, run: Trajectory) -> None:
    since = f" From {run.settled_since:.4g} s on." if math.isfinite(run.settled_since) else ""
    _heading(case, f"{run.status.value}{since} {len(run.events)} events.")
    if run.limit_cycle is not None:
        _print(_cycles_table([run.limit_cycle]))
    elif run.settled_at:
        table = _table("signal", "rests at")
        for name, value in run.settled_at.items():
            unit, factor = _readable(run.units.get(name, ""))
            table.add_row(_with_unit(name, unit), _number(value * factor))
        _print(table)


def _show_ladder(case: Case, ladder: Ladder) -> None:
    _heading(case, ladder.verdict)
    if case.expected.finding:
        typer.echo(f"{case.expected.paper or 'expected'}: {case.expected.finding}")
    names = list(dict.fromkeys(name for row in ladder.rows for name in row.quantities))
    readable = {name: _readable(ladder.units.get(name, "")) for name in names}
    table = _table("method", *(_with_unit(name, unit) for name, (unit, _) in readable.items()))
    for row in ladder.rows:
        values = ((row.quantities.get(name), factor) for name, (_, factor) in readable.items())
        table.add_row(
            row.method, *(_number(value * factor if _is_number(value) else value) for value, factor in values)
        )
    _print(table)


def _show_verdicts(cases: Sequence[Case], ladders: Sequence[Ladder]) -> None:
    """All cases in one table, with what is known of each beside the verdict."""
    table = _table("case", "source", "finding", "must", "verdict", numbers=False)
    for case, ladder in zip(cases, ladders, strict=True):
        expected = case.expected
        source = expected.paper or expected.source
        table.add_row(case.name, source, expected.finding, expected.outcome or "", ladder.verdict)
    _print(table)


def _cycles_table(cycles: Sequence[LimitCycle]) -> RichTable:
    """Signals down, cycles across: mean and peak-to-peak of each."""
    table = _table("", *(column for i in range(len(cycles)) for column in (f"cycle {i + 1}", "")))
    stability = {True: "stable", False: "unstable", None: "stability unknown"}
    for label, values in (
        ("", [stability[c.stable] for c in cycles]),
        ("frequency [Hz]", [_number(c.frequency) for c in cycles]),
        ("period [s]", [_number(c.period) for c in cycles]),
        ("estimated error", [_percent(c.error_estimate) for c in cycles]),
    ):
        table.add_row(label, *(cell for value in values for cell in (value, "")))
    table.add_section()
    table.add_row("signal", *(cell for _ in cycles for cell in ("peak to peak", "mean")))
    for name in dict.fromkeys(name for c in cycles for name in c.mean):
        unit, factor = _readable(next((c.units[name] for c in cycles if name in c.units), ""))
        cells = []
        for c in cycles:
            span, mean = c.peak_to_peak.get(name, math.nan), c.mean.get(name, math.nan)
            # What is left of a mean of zero after summation is not worth its digits.
            cells += [_number(span * factor), _number(mean * factor if abs(mean) > 1e-9 * span else 0.0)]
        table.add_row(_with_unit(name, unit), *cells)
    return table


def _heading(case: Case, sentence: str) -> None:
    typer.echo()
    typer.secho(f"{case.name}: {case.title}", bold=True)
    typer.echo(sentence.strip())


def _table(*columns: str, numbers: bool = True) -> RichTable:
    """An empty table; its columns after the first hold numbers, or texts."""
    from rich import box
    from rich.table import Table

    table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    for i, name in enumerate(columns):
        table.add_column(name, justify="right" if numbers and i else "left", overflow="fold")
    return table


def _print(table: RichTable) -> None:
    from rich.console import Console

    # Output that goes to a file or a pipe is not folded at the width of a screen.
    Console(highlight=False, markup=False, width=None if sys.stdout.isatty() else 200).print(table)


def _readable(unit: str) -> tuple[str, float]:
    return READABLE.get(unit, (unit.replace("*", "·"), 1.0))


def _with_unit(name: str, unit: str) -> str:
    return f"{name} [{unit}]" if unit else name


def _percent(share: float) -> str:
    if math.isnan(share):
        return "-"
    if share > 1.0:
        return "> 100 %"
    return "< 0.01 %" if share < 1e-4 else f"{100.0 * share:.2g} %"


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _number(value: Any) -> str:
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return "-"
    return f"{value:.4g}" if _is_number(value) else str(value)


def main() -> None:
    """Entry point of the command ``eppanalysis``."""
    app()
