"""The command line: arguments to calls, results to tables, JSON or files.

Whatever computes is imported inside the command that needs it, once its cases are read, so that ``eppanalysis --help``
and a mistake in a case are answered at once.
"""

from __future__ import annotations

import errno
import json
import os
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, get_args, get_type_hints

import typer
from typer.core import TyperCommand, TyperGroup

from eppanalysis.cli.bounds import bounds
from eppanalysis.cli.certify import certify
from eppanalysis.cli.common import (
    NOTHING,
    Drawn,
    Found,
    Json,
    Settings,
    check_output,
    echo,
    expanded,
    file_option,
    heading,
    load_case,
    print_json,
    print_table,
    progress,
    signals_drawn,
)
from eppanalysis.cli.cycles import branch, cycles
from eppanalysis.cli.design import design
from eppanalysis.cli.explore import explore
from eppanalysis.cli.export import export
from eppanalysis.cli.guide import guide
from eppanalysis.cli.identify import diagnose, identify
from eppanalysis.cli.joint import joint
from eppanalysis.cli.margins import margins
from eppanalysis.cli.mcp import mcp
from eppanalysis.cli.new import new
from eppanalysis.cli.report import report
from eppanalysis.cli.response import response
from eppanalysis.cli.sweep import sweep
from eppanalysis.errors import ArgumentError, EppError
from eppanalysis.readable import count

if TYPE_CHECKING:
    from eppanalysis.cases import Case
    from eppanalysis.methods.comparison.ladder import Ladder
    from eppanalysis.methods.elements.result import ElementCheck
    from eppanalysis.models.systems.measured.loop import MeasuredLoop
    from eppanalysis.models.systems.measured.matrix import MeasuredMatrix
    from eppanalysis.models.systems.measured.response import MeasuredResponse
    from eppanalysis.results import Prediction, Trajectory
    from eppanalysis.tables.files import Table


class _Commands(TyperGroup):
    """Ends with a sentence and its exit code where a command, or its help, fails."""

    def make_context(self, *args: Any, **kwargs: Any) -> Any:
        with _in_a_sentence():  # the library that reads arguments takes its time to import, and prints the help
            return super().make_context(*args, **kwargs)

    def invoke(self, ctx: Any) -> Any:
        with _in_a_sentence():
            result = super().invoke(ctx)
            sys.stdout.flush()  # here, where a full disk is a sentence
        return result


@contextmanager
def _in_a_sentence() -> Iterator[None]:
    """Say what the user can act on, and an interrupt, in one sentence, and end with its code."""
    try:
        yield
    except KeyboardInterrupt:
        echo("Interrupted: nothing is kept.", err=True)
        raise typer.Exit(130) from None
    except EppError as error:
        echo(str(error), err=True)
        raise typer.Exit(2) from error
    except MemoryError as error:
        echo(f"Not enough memory ({error or 'nothing is kept'}); expected a smaller case.", err=True)
        raise typer.Exit(2) from error
    except OSError as error:
        if error.errno == errno.EPIPE:  # the reader has seen enough
            raise
        where = _place(error)
        known = error.filename or error.errno in _OUTPUT
        expected = "a place to read from or write to" if known else "a system that grants it"
        echo(f"{where}: {error.strerror or error}; expected {expected}.", err=True)
        raise typer.Exit(2) from error


#: What a full or broken place to write to answers.
_OUTPUT = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO, errno.EBADF)


def _place(error: OSError) -> str:
    """Which file an error is of; the standard output is given up where that is full, as Python writes to it again."""
    if error.filename is not None:
        return str(error.filename)
    if error.errno not in _OUTPUT:
        return "The system refuses what the command needs"
    with suppress(OSError, ValueError):  # no output that belongs to the system, as in a notebook
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    return "standard output"


class _Command(TyperCommand):
    """Refuses in one sentence a word that is no choice of its option, and an option that is given twice but holds one
    value: the first would be dropped without a word. What Python calls an argument it calls by its option.
    """

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        # The parser tells every option that was given, as often as
        # it was given; typer keeps the last of them in silence.
        values, _, options = self.make_parser(ctx).parse_args(args=list(args))
        hints = get_type_hints(self.callback)
        for option in options:
            _check_choice(option, hints.get(option.name), values.get(option.name))
            _check_number(option, hints.get(option.name), values.get(option.name))
        given = [option for option in options if _holds_one(option)]
        twice = next((option for option in given if given.count(option) > 1), None)
        if twice is not None:
            raise EppError(f"{'/'.join(twice.opts)}: is given {given.count(twice)} times; expected it once.")
        return super().parse_args(ctx, args)

    def invoke(self, ctx: Any) -> Any:
        try:
            return super().invoke(ctx)
        except EppError as error:
            raise EppError(self._as_called_here(error)) from error

    def _as_called_here(self, error: EppError) -> str:
        """The sentence with the options, and the command, in place of what Python calls them."""
        if isinstance(error, ArgumentError):
            called = next((option.opts[0] for option in self.params if option.name == error.name), None)
            if called:
                return error.of(called)
        who, colon, said = str(error).partition(": ")
        return f"{self.name}: {said}" if colon and who in _public_functions() else str(error)


def _public_functions() -> list[str]:
    """What Python calls the analyses, and what they change a case with."""
    import eppanalysis

    return [*(name for name in dir(eppanalysis) if name.islower()), "with_values"]


def _check_choice(option: Any, hint: Any, given: Any) -> None:
    """Refuse a word that is no member of the enumeration that an option takes, where it takes one."""
    words = next((t for t in (hint, *get_args(hint)) if isinstance(t, type) and issubclass(t, StrEnum)), None)
    if words is None:
        return
    for word in given if option.multiple else [given]:
        if word not in list(words):
            how_many = "one or several of" if option.multiple else "one of"
            raise EppError(f"{option.opts[0]} {word}: is not known; expected {how_many} {', '.join(words)}.")


def _check_number(option: Any, hint: Any, given: Any) -> None:
    """Refuse what is no number, where an option takes one."""
    kind = next((t for t in (int, float) if t in (hint, *get_args(hint))), None)
    if kind is None or not isinstance(given, str):
        return
    try:
        kind(given)
    except ValueError:
        raise EppError(
            f"{option.opts[0]} {given}: is no number; expected a {'whole number' if kind is int else 'number'}."
        ) from None


def _holds_one(option: Any) -> bool:
    """Whether it is an option with one value: no argument, no flag, not repeatable."""
    return option.param_type_name == "option" and not (option.multiple or option.is_flag or option.count)


app = typer.Typer(
    name="eppanalysis",
    cls=_Commands,
    help="Limit cycles of loops with backlash, friction and other nonlinear elements.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)

Cases = Annotated[
    list[str],
    typer.Argument(
        metavar="CASE",
        help='Case files (TOML), or names of shipped cases; "truth-table" is all eight experiments of the paper.',
        show_default=False,
    ),
]
Output = Annotated[
    Path | None,
    file_option("Write a picture (.png, .svg, .pdf) or a table (.csv, .nc); {case} in it becomes the case's name."),
]
Measured = Annotated[
    Path | None,
    file_option(
        "Measured frequency response (.csv) in place of the linear part, round the elements of each case.",
        "--response",
    ),
]


@app.callback(invoke_without_command=True)
def _version(version: Annotated[bool, typer.Option("--version", help="Print the version and stop.")] = False) -> None:
    if version:
        from eppanalysis import __version__

        echo(__version__)
        raise typer.Exit


@app.command(cls=_Command)
def check(cases: Cases, settings: Settings = NOTHING, as_json: Json = False) -> None:
    """Check case files: fields, units, ranges, own elements, whether a run can begin; all mistakes are named."""
    from eppanalysis.tables.console import parameters_table

    texts = expanded(cases)
    valid = [case for text in texts if (case := _valid(text, settings)) is not None]
    if as_json:
        print_json("check", [(case, Found(_valid_sentence(case), _checked(case))) for case in valid], settings)
    else:
        for case in valid:
            heading(_valid_sentence(case), settings, case)
            if why_not := _why_not_predicted(case):
                echo(f"The command predict refuses it: {why_not}")
            if len(texts) == 1:
                print_table(parameters_table(case))
                for found in _own_elements(case):
                    echo(str(found))
    if len(valid) < len(texts):
        raise typer.Exit(2)


def _valid(text: str, settings: Sequence[str]) -> Case | None:
    """The case of a file whose run can begin; None where its mistakes have been named."""
    from eppanalysis.cases.mistakes import sentences_of

    try:
        case = load_case(text, settings)
    except EppError as error:
        for sentence in sentences_of(text, error):
            echo(sentence, err=True)
        return None
    try:
        _begin_run(case)
    except EppError as error:
        echo(f"{text}: {error}", err=True)
        return None
    return case


def _valid_sentence(case: Case) -> str:
    return f"{case.name}: valid ({case.kind}): {case.title}"


def _checked(case: Case) -> dict[str, Any]:
    """What is known of a valid case."""
    own = [found.to_dict() for found in _own_elements(case)]
    return {"valid": True, **case.provenance(), "own_elements": own, "not_predicted": _why_not_predicted(case)}


def _begin_run(case: Case) -> None:
    """Refuse a case whose run cannot begin, as the command simulate would."""
    from eppanalysis.cases import Missing
    from eppanalysis.methods.search.simulate import simulate as run_simulation

    end = 1.0 if isinstance(case.held("run.t_end"), Missing) else None  # it begins whatever its length
    with progress(f"simulate {case.name}"):
        run_simulation(case, t_end=end, max_steps=1)


def _why_not_predicted(case: Case) -> str:
    """What the command predict would say of a case that it refuses; empty where it takes it."""
    from eppanalysis.methods.describing.predict import why_not_predicted

    return why_not_predicted(case.to_system())


def _own_elements(case: Case) -> list[ElementCheck]:
    """The checks of the elements that a file gives by their modes and guards."""
    from eppanalysis.models.elements import AutomatonElement

    system = case.to_system()
    named = zip(system.elements, system.element_names, strict=True)
    own = [(element, name) for element, name in named if type(element) is AutomatonElement]
    if not own:
        return []
    from eppanalysis.methods.elements.check import check_element

    return [check_element(element, name=name) for element, name in own]


@app.command(cls=_Command)
def predict(
    cases: Cases,
    settings: Settings = NOTHING,
    response: Measured = None,
    as_json: Json = False,
    output: Output = None,
) -> None:
    """Predict limit cycles with describing functions, stable and unstable; warn where these may miss some."""
    from eppanalysis.tables.files import prediction_table

    measured = None if response is None else _read_response(response)

    def run(case: Case) -> Prediction:
        from eppanalysis.methods.describing.predict import predict_limit_cycles

        found = predict_limit_cycles(case if measured is None else _with_response(case, measured))
        len(found.margins) + len(found.warnings)  # made when first requested: now, before a part of the output is out
        return found

    _carry_out("predict", cases, settings, as_json, output, _Analysis(run, prediction_table, _show_prediction))


@app.command(cls=_Command)
def simulate(
    cases: Cases,
    settings: Settings = NOTHING,
    signal: Drawn = NOTHING,
    as_json: Json = False,
    output: Output = None,
) -> None:
    """Simulate with every switch located, and say whether the motion settles or repeats itself, and from when on.

    What is undecided by the end of the run is carried on, for some ten seconds at most; samples and picture end there.
    """
    from eppanalysis.tables.files import trajectory_table

    def run(case: Case) -> Trajectory:
        from eppanalysis.methods.search.simulate import simulate as run_simulation

        return run_simulation(case, decide=True)

    analysis = _Analysis(
        run, trajectory_table, _show_trajectory, drawn=lambda case: signals_drawn(case, signal), asked=signal
    )
    _carry_out("simulate", cases, settings, as_json, output, analysis)


@app.command(cls=_Command)
def validate(cases: Cases, settings: Settings = NOTHING, as_json: Json = False, output: Output = None) -> None:
    """Put prediction and simulation side by side, signal by signal, with their differences in per cent.

    Several cases give one table of findings and verdicts: "eppanalysis validate truth-table".
    """
    from eppanalysis.methods.comparison.ladder import ladder
    from eppanalysis.tables.files import ladder_table

    analysis = _Analysis(ladder, ladder_table, _show_ladder, _show_truth_table, _expected_beside)
    _carry_out("validate", cases, settings, as_json, output, analysis)


@app.command("cases", cls=_Command)
def list_cases(as_json: Json = False) -> None:
    """List the cases that ship with the package."""
    from eppanalysis.cases import case as shipped, shipped_cases

    found = [shipped(name) for name in shipped_cases()]
    if as_json:
        print_json("cases", [(case, Found(case.title, None)) for case in found], ())
        return
    from eppanalysis.tables.console import cases_table

    print_table(cases_table(found))


def schema(
    output: Annotated[Path | None, file_option("Write it to a file (.json).")] = None,
) -> None:
    """Print the JSON schema of case files, with which editors complete and check them."""
    check_output(output, (".json",))
    from eppanalysis.cases.editors import case_schema

    text = json.dumps(case_schema(), indent=2)
    if output is None:
        echo(text)
        return
    from eppanalysis.writing import write_text

    write_text(f"{text}\n", output)


app.command("new", cls=_Command)(new)
app.command("cycles", cls=_Command)(cycles)
app.command("branch", cls=_Command)(branch)
app.command("response", cls=_Command)(response)
app.command("margins", cls=_Command)(margins)
app.command("bounds", cls=_Command)(bounds)
app.command("certify", cls=_Command)(certify)
app.command("design", cls=_Command)(design)
app.command("guide", cls=_Command)(guide)
app.command("sweep", cls=_Command)(sweep)
app.command("identify", cls=_Command)(identify)
app.command("diagnose", cls=_Command)(diagnose)
app.command("report", cls=_Command)(report)
app.command("explore", cls=_Command)(explore)
app.command("export", cls=_Command)(export)
app.command("schema", cls=_Command)(schema)
app.command("mcp", cls=_Command)(mcp)
imports = typer.Typer(help="Make a case file of a model elsewhere.", no_args_is_help=True)
imports.command("joint", cls=_Command)(joint)
app.add_typer(imports, name="import")


@dataclass(frozen=True)
class _Analysis:
    """What one command does with a case: compute, make a table for files, show it; and show several together."""

    run: Callable[[Case], Any]
    to_table: Callable[[Any], Table]
    show: Callable[[Case, Any], None]
    show_all: Callable[[Sequence[Case], Sequence[Any]], None] | None = None
    beside: Callable[[Case, Any], Mapping[str, Any]] = lambda case, result: {}
    drawn: Callable[[Case], list[str]] = lambda case: []  # the signals in its picture, where it has some of many
    asked: Sequence[str] = ()  # those that are requested


def _carry_out(
    command: str, texts: Sequence[str], settings: Sequence[str], as_json: bool, output: Path | None, analysis: _Analysis
) -> None:
    """Load all cases, compute, then print and write; nothing is computed when an argument is wrong."""
    texts = expanded(texts)
    if output is not None:
        _check_output(output, len(texts))
    cases = [load_case(text, settings) for text in texts]
    if output is not None:
        _check_names(output, cases)
    for case in cases if output is not None or analysis.asked else ():
        analysis.drawn(case)  # refuses a signal that is not there
    together = analysis.show_all if len(cases) > 1 else None
    results = []
    for case in cases:
        with progress(f"{command} {case.name}"):
            results.append(analysis.run(case))
        if not as_json and together is None:
            echo()
            heading(f"{case.name}: {case.title}", settings, case)
            analysis.show(case, results[-1])
    if not as_json and together is not None:
        if settings:
            heading(f"{len(cases)} cases", settings)
        together(cases, results)
    if as_json:
        found = [
            (case, Found(str(result), {**result.to_dict(), **analysis.beside(case, result)}))
            for case, result in zip(cases, results, strict=True)
        ]
        print_json(command, found, settings)
    if output is not None:
        _write(output, cases, results, analysis)


def _check_output(output: Path, n_cases: int) -> None:
    check_output(output, stands_for=("case",))
    if n_cases > 1 and "{case}" not in output.name and output.suffix.lower() != ".csv":
        raise EppError(f"{output}: is one file for {n_cases} cases; expected {{case}} in its name, or a table (.csv).")


def _check_names(output: Path, cases: Sequence[Case]) -> None:
    """Refuse one name for the files of several cases."""
    names = [case.name for case in cases]
    for case in cases:
        if "{case}" in output.name and names.count(case.name) > 1:
            raise EppError(
                f"{output}: {names.count(case.name)} cases are called {case.name}; expected a name for each."
            )


def _write(output: Path, cases: Sequence[Case], results: Sequence[Any], analysis: _Analysis) -> None:
    """One file a case where the name holds ``{case}``, else one file."""
    from eppanalysis.tables.files import join, write_result, write_table

    if "{case}" not in output.name and len(cases) > 1:
        tables = [(case.name, analysis.to_table(result)) for case, result in zip(cases, results, strict=True)]
        write_table(join(tables), output)
        return
    for case, result in zip(cases, results, strict=True):
        path = output.with_name(output.name.replace("{case}", case.name))
        names = analysis.drawn(case)
        drawn = {"signals": names} if names else {}
        write_result(result, analysis.to_table, path, **drawn)


def _read_response(path: Path) -> MeasuredResponse | MeasuredMatrix:
    from eppanalysis.cases.values.responses import read_response

    return read_response(path)


def _with_response(case: Case, response: MeasuredResponse | MeasuredMatrix) -> MeasuredLoop:
    """The case's elements in a loop with a measured linear part, closed by a feedback of -1."""
    from eppanalysis.models.systems.measured.loop import MeasuredLoop

    system = case.to_system()
    elements = system.elements if system.given is None else system.given.elements
    return MeasuredLoop(response, elements, name=case.name)


def _show_prediction(case: Case, prediction: Prediction) -> None:
    from eppanalysis.results.measured import MeasuredCycle
    from eppanalysis.tables.console import cycles_table, margins_table

    echo(str(prediction))
    if prediction.search:
        echo(prediction.search)
    if len(prediction):
        print_table(cycles_table(list(prediction), case.named_signals))
    for cycle in prediction:
        if isinstance(cycle, MeasuredCycle):
            echo(f"Of the data: {cycle.with_intervals()}.")
    if prediction.margins:
        echo(f"margins of the linearised loop, cut at {prediction.margins['at']}:")
        print_table(margins_table(prediction.margins))


def _show_trajectory(case: Case, run: Trajectory) -> None:
    from eppanalysis.cases.command_line import Commands
    from eppanalysis.results import Status
    from eppanalysis.tables.console import cycles_table, rest_table

    echo(f"{run} {count(run.n_events, 'event').capitalize()}.")
    if run.status is Status.UNDECIDED:
        echo(f"Simulate for longer: {Commands.of(case).longer(max(run.end_time, run.carried_to))}")
    point = run.operating_point
    if point is not None and point.is_driven:
        echo(f"{point}: the command response computes the periodic response.")
    if run.limit_cycle is not None:
        print_table(cycles_table([run.limit_cycle], case.named_signals))
    elif run.settled_at:
        print_table(rest_table(run, case.named_signals))
    _tell_others(case, run)


def _tell_others(case: Case, run: Trajectory) -> None:
    """How many signals the tables leave out, and where they are."""
    left = len(run.signals) - len(case.named_signals)
    if left > 0:
        echo(f"{count(left, 'signal')} of ports that the file does not name: --json and -o FILE.csv have them.")


def _show_ladder(case: Case, ladder: Ladder) -> None:
    from eppanalysis.cases.command_line import Commands
    from eppanalysis.tables.console import AS_FOUND, as_found, ladder_table, rungs_table

    echo(f"{ladder.headline()}.\n{ladder.verdict}")
    if ladder.run.limit_cycle is not None or (ladder.search is not None and ladder.search.stable):
        echo(f"Why it oscillates, and what ends it: {Commands.of(case).remedies()}")
    expected = case.expected
    if expected.finding:
        must = f" (must {expected.outcome}: {AS_FOUND[as_found(case, ladder)]})" if expected.outcome else ""
        echo(f"{expected.paper or 'expected'}: {expected.finding}{must}")
    compared = any(row.cycle is not None for row in ladder.rows)
    if compared or ladder.run.settled_at:
        print_table(ladder_table(ladder, case.named_signals))
        _tell_others(case, ladder.run)
    if ladder.errors:
        echo("error: of the describing-function cycle against the simulated one; of a mean in % of the peak-to-peak.")
    if compared:
        print_table(rungs_table(ladder))
        echo(
            "errors against the exact cycle; a cycle without a number has no exact counterpart. A period is that of "
            "one oscillation, of which a cycle may hold several."
        )
    parts = [f"search for all exact cycles {ladder.search_seconds:.2f} s"] if ladder.search is not None else []
    if ladder.probes:
        parts.append(f"{count(len(ladder.probes), 'run')} from the predicted cycles {ladder.probe_seconds:.2f} s")
    if parts:
        echo("time of the rest: " + ", ".join(parts))


def _show_truth_table(cases: Sequence[Case], ladders: Sequence[Ladder]) -> None:
    """All cases in one table, with what is known of each beside what the run did."""
    from eppanalysis.tables.console import TruthTable

    table = TruthTable()
    for case, ladder in zip(cases, ladders, strict=True):
        table.add(case, ladder)
    print_table(table.table)
    echo(table.sentence())


def _expected_beside(case: Case, ladder: Ladder) -> dict[str, Any]:
    """What is known of the case, for JSON."""
    from eppanalysis.tables.console import as_found

    k = case.expected
    return {"paper": k.paper, "finding": k.finding, "must": k.outcome, "as_found": as_found(case, ladder)}
