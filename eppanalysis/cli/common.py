"""What all commands share: the case with its settings, and the JSON document that ``--json`` prints."""

from __future__ import annotations

import math
import os
import re
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple, TypeVar

import typer

from eppanalysis.cli.signs import has_all_signs
from eppanalysis.errors import EppError, visible
from eppanalysis.progress import Progress, progress_bar
from eppanalysis.readable import leading_name

if TYPE_CHECKING:
    from rich.table import Table

    from eppanalysis.cases import Case
    from eppanalysis.tables.files import Table as FileTable

Given = TypeVar("Given")


class Found(NamedTuple):
    """A sentence and plain data, where no single result has both."""

    sentence: str
    data: Any

    def __str__(self) -> str:
        return self.sentence

    def to_dict(self) -> Any:
        """The data."""
        return self.data


#: Default of options that may be repeated.
NOTHING: list[str] = []
NO_FILES: list[Path] = []


def file_option(help: str, *names: str) -> Any:
    """The option of a file, by default that of what is written."""
    return typer.Option(*(names or ("-o", "--output")), metavar="FILE", help=help, show_default=False)


CaseName = Annotated[
    str,
    typer.Argument(metavar="CASE", help="Case file (TOML), or name of a shipped case.", show_default=False),
]
Settings = Annotated[
    list[str],
    typer.Option(
        "--set",
        metavar="FIELD=VALUE",
        help='Override a field of every case, as in lock_pin.backlash="0.5 deg"; repeatable.',
    ),
]
Json = Annotated[bool, typer.Option("--json", help="Print JSON in SI units instead of tables.")]
Output = Annotated[Path | None, file_option("Write a picture (.png, .svg, .pdf) or a table (.csv, .nc).")]
Picture = Annotated[Path | None, file_option("Write a picture (.png, .svg, .pdf).")]
Drawn = Annotated[
    list[str],
    typer.Option(
        "--signal", metavar="NAME", help="Signals in the picture; repeatable; all for every one that the file names."
    ),
]
Prove = Annotated[bool, typer.Option("--prove", help="Prove both sides of every bound where possible; seconds each.")]
Workers = Annotated[int | None, typer.Option("--workers", help="Processes.", show_default="one per core")]
Certificates = Annotated[
    Path | None,
    typer.Option(
        "--certificates",
        metavar="FOLDER",
        help="Also write the certificates; implies --prove.",
        show_default=False,
    ),
]
Allow = Annotated[
    str | None,
    typer.Option(
        "--allow",
        metavar="SIZE",
        help='Stable limit cycle that is allowed, peak to peak or rms, as in "theta 0.3 deg", "theta 0.1 deg rms", '
        '"theta 0.3 deg within 1 Hz..8 Hz".',
    ),
]


def echo(text: str = "", *, err: bool = False, bold: bool = False) -> None:
    """Write lines for people, of which names of files and whatever else they quote cannot steer the terminal."""
    shown = "\n".join(map(visible, text.split("\n")))
    if bold and os.environ.get("TERM") != "dumb":  # a terminal that would print the codes of bold letters
        shown = typer.style(shown, bold=True)
    with suppress(OSError) if err else nullcontext():  # where nobody reads a refusal the exit code still says it
        typer.echo(shown, err=err)


def load_case(text: str, settings: Sequence[str]) -> Case:
    """The case of a file or of a shipped name, with the fields of ``--set`` in place.

    Raises
    ------
    EppError
        If there is no such case, or a setting is not FIELD=VALUE or not valid.
    """
    from eppanalysis.cases import case, read_case, shipped_cases
    from eppanalysis.errors import CaseError

    if not text.strip():
        raise CaseError("CASE", "", text, "a case file, or the name of a shipped case")
    # A folder may bear the name of a shipped case, and is none; any other is named as what it is.
    is_file = text.endswith(".toml") or os.path.isfile(text) or (os.path.exists(text) and text not in shipped_cases())
    found = read_case(text) if is_file else case(text)
    values = given_values(settings)
    found = found.with_values(values, "--set") if values else found
    for remark in found.remarks:
        echo(f"{found.name}: {remark}", err=True)
    return found


def expanded(texts: Sequence[str]) -> list[str]:
    """Cases with the members of a group in place of its name."""
    from eppanalysis.cases import GROUPS

    return [name for text in texts for name in GROUPS.get(text, (text,))]


def given_values(settings: Sequence[str]) -> dict[str, Any]:
    """Fields and values of ``--set FIELD=VALUE``; what is not a TOML value ("0.5 deg") is a text."""
    import tomllib

    found: dict[str, Any] = {}
    for name, value in by_name("--set", (split_pair(text, "--set", "FIELD=VALUE") for text in settings)).items():
        try:
            found[name] = tomllib.loads(f"value = {value}")["value"]
        except tomllib.TOMLDecodeError:
            found[name] = value
    return found


def by_name(option: str, pairs: Iterable[tuple[str, Given]]) -> dict[str, Given]:
    """What a repeatable option gives, by names.

    Raises
    ------
    EppError
        If one name is given twice: the first would be dropped without a word.
    """
    found: dict[str, Given] = {}
    for name, given in pairs:
        if name in found:
            raise EppError(f"{option} {name}: is given twice; expected it once.")
        found[name] = given
    return found


def check_value(case: Case, option: str, name: str, value: str | None) -> None:
    """Refuse a value of an option that is none of the field that it is for.

    Raises
    ------
    EppError
        If there is no such field, or the value has another dimension.
    """
    from eppanalysis.errors import CaseError

    case.unit(name)  # refuses what is no field, before its values are blamed
    try:
        if value is not None:
            case.si(name, value)
    except CaseError as error:
        raise CaseError(option, name, value, error.expected) from None


def split_pair(text: str, option: str, expected: str) -> tuple[str, str]:
    """Name and value of an option that takes NAME=VALUE.

    Raises
    ------
    EppError
        If there is no name, no equals sign, or no value.

    Examples
    --------
    >>> split_pair("bands.range = 1:5:41:lbf", "--axis", "FIELD=start:stop:count:unit")
    ('bands.range', '1:5:41:lbf')
    """
    name, separator, value = text.partition("=")
    if not separator or not name.strip() or not value.strip():
        raise EppError(f"{option} {text}: lacks a field, '=' or a value; expected {expected}.")
    return name.strip(), value.strip()


def range_of(text: str) -> tuple[str, str] | None:
    """Both ends of LOW..HIGH, or of LOW:HIGH, which older scripts have; None where it is neither.

    Examples
    --------
    >>> range_of("0.1 deg .. 5 deg"), range_of("0.1:5"), range_of("3 mm")
    (('0.1 deg', '5 deg'), ('0.1', '5'), None)
    """
    between = ".." if ".." in text else ":"
    low, _, high = (part.strip() for part in text.partition(between))
    return (low, high) if low and high else None


#: How ± is typed, on keyboards that lack it, too.
_ABOUT = ("±", "+-", "+/-")


def range_about(case: Case, name: str, text: str) -> tuple[str, str] | None:
    """Both ends of ± SHARE or ± DISTANCE about a case's own value of a parameter; None where it is neither.

    Raises
    ------
    EppError
        If the parameter has no value, or the distance another dimension.
    """
    half = next((text.strip().removeprefix(mark).strip() for mark in _ABOUT if text.strip().startswith(mark)), "")
    if not half:
        return None
    own, share = case.value(name), half.removesuffix("%").strip()
    try:
        width = abs(own) * float(share) / 100.0 if half.endswith("%") else case.si(name, half)
    except ValueError:
        return None
    return case.text(name, own - width, 15), case.text(name, own + width, 15)


def named_range(option: str, text: str, case: Case, fields: Iterable[str] = ()) -> tuple[str, tuple[str, str]]:
    """Name and range of FIELD LOW..HIGH or FIELD ± SHARE, where a name of these fields may hold spaces.

    Raises
    ------
    EppError
        If it is none.

    Examples
    --------
    >>> from eppanalysis import case
    >>> named_range(
    ...     "--tune", "lock_pin.backlash 0.1 deg..5 deg", case("fig8a_original")
    ... )
    ('lock_pin.backlash', ('0.1 deg', '5 deg'))
    >>> named_range("--within", "play.gap ± 25 %", case("wheelchair"))
    ('play.gap', ('9 mm', '15 mm'))
    """
    name, rest = leading_name(text, fields)
    both = range_about(case, name, rest) or range_of(rest)
    if both is None:
        expected = '"FIELD LOW..HIGH" or "FIELD ± SHARE", as in "Kp 1..10" or "Kp ± 10 %"'
        raise EppError(f"{option} {text}: is no field with a range; expected {expected}.")
    return name, both


def within_of(case: Case, name: str, text: str | None) -> tuple[str, str] | None:
    """Both ends of what ``--within`` holds for a parameter.

    Raises
    ------
    EppError
        If it is no range.
    """
    found = None if text is None else range_about(case, name, text) or range_of(text)
    if text is not None and found is None:
        raise EppError(f'--within {text}: is no range; expected LOW..HIGH, as in "0.1 deg..5 deg", or ± 20 %.')
    return found


@contextmanager
def progress(what: str) -> Iterator[Progress | None]:
    """A bar on the terminal; nothing elsewhere.

    Raises
    ------
    EppError
        If the numbers of what is computed inside grow beyond all range.
    """
    from numpy import errstate

    from eppanalysis.arguments import numbers_in_range

    with numbers_in_range(what), progress_bar(what) as advance, errstate(all="ignore"):  # what overflows is said
        yield advance


def heading(text: str, settings: Sequence[str], case: Case | None = None) -> None:
    """What a table is about; below it what ``--set`` has changed, as the case's own title still names the old values.

    Parameters
    ----------
    settings : sequence of str
        As ``--set`` takes them.
    case : Case, optional
        What they made: plain numbers are shown in the units that they have there.
    """
    echo(text, bold=True)
    if settings:
        echo(f"with {', '.join(_as_taken(*split_pair(s, '--set', 'FIELD=VALUE'), case) for s in settings)}")


def _as_taken(name: str, value: str, case: Case | None) -> str:
    """A setting as it was typed, with the unit that a plain number is taken in."""
    unit = case.parameters[name].unit if case is not None and name in case.parameters else ""
    plain = re.fullmatch(r"[-+.eE\d\s]*\d[.\s]*", value)
    return f"{name} = {value.strip()} {unit}" if unit and plain else f"{name} = {value}"


def check_output(path: Path | None, suffixes: Sequence[str] | None = None, stands_for: Sequence[str] = ()) -> None:
    """Refuse a file that cannot be written, or whose name holds unknown placeholders in braces.

    Parameters
    ----------
    path : Path, optional
        None where nothing is to be written.
    suffixes : sequence of str, optional
        Pictures and tables by default.
    stands_for : sequence of str
        Placeholders that the name may have in braces.

    Raises
    ------
    EppError
        If it cannot be written.
    """
    from eppanalysis.tables.files import PICTURES, TABLES, check_target

    if path is None:
        return
    known = [f"{{{name}}}" for name in stands_for]
    for found in re.findall(r"\{[^{}]*\}", path.name):
        if found not in known:
            raise EppError(f"{path}: {found} is no placeholder; expected {' or '.join(known) or 'a name without it'}.")
    check_target(path, PICTURES + TABLES if suffixes is None else suffixes)


def write_output(path: Path | None, result: Any, to_table: Callable[[Any], FileTable], **options: Any) -> None:
    """Write a result where a file is requested: its picture, drawn with these options, or its table."""
    if path is not None:
        from eppanalysis.tables.files import write_result

        write_result(result, to_table, path, **options)


def signals_drawn(case: Case, asked: Sequence[str]) -> list[str]:
    """The signals in a picture of a run: those that were requested, else few that answer what it does.

    Raises
    ------
    EppError
        If the case has no such signal.
    """
    from eppanalysis.plotting import chosen, main_signals
    from eppanalysis.results.picture import MOST_PANELS

    every = case.to_system().signals.names
    named = list(case.named_signals) or list(every)
    if asked:
        return named if list(asked) == ["all"] else chosen(dict.fromkeys(every), asked)
    return named if len(named) <= MOST_PANELS else main_signals(named, case.expected.signal)


def print_table(table: Table) -> None:
    """A table on the standard output; in a file or a pipe it is not folded at the width of a console."""
    from rich.console import Console

    Console(highlight=False, markup=False, width=None if sys.stdout.isatty() else 240).print(table)


def answer(
    command: str,
    case: Case,
    settings: Sequence[str],
    as_json: bool,
    result: Any,
    show: Callable[[], None],
    title: str = "",
) -> None:
    """What a command found about one case: its document where JSON is requested, else what is shown below a heading.

    Parameters
    ----------
    settings : sequence of str
        As ``--set`` takes them.
    result : Result or Found
        Its sentence and its plain data are those of the document.
    show : callable
        Prints tables and sentences.
    title : str
        Name and title of the case by default.
    """
    if as_json:
        print_json(command, [(case, result)], settings)
        return
    heading(title or f"{case.name}: {case.title}", settings, case)
    show()


def print_json(command: str, results: Sequence[tuple[Case, Any]], settings: Sequence[str]) -> None:
    """One document on the standard output: what was requested, and sentence and result of every case.

    Parameters
    ----------
    settings : sequence of str
        As ``--set`` takes them.
    """
    import json

    from eppanalysis import __version__

    document = {
        "eppanalysis": __version__,
        "command": command,
        "set": given_values(settings),
        "cases": [
            {
                **{"name": case.name, "title": case.title, "kind": case.kind},
                **({"remarks": list(case.remarks)} if case.remarks else {}),
                "verdict": str(result),
                "result": result.to_dict(),
            }
            for case, result in results
        ],
    }
    as_it_is = has_all_signs(sys.stdout)
    sys.stdout.write(json.dumps(json_value(document), indent=2, allow_nan=False, ensure_ascii=not as_it_is) + "\n")


def json_value(value: Any) -> Any:
    """Plain JSON: arrays as lists, complex numbers as [real, imaginary], what is not finite as null.

    Examples
    --------
    >>> json_value({"multipliers": (1 + 2j,), "error": float("nan")})
    {'multipliers': [[1.0, 2.0]], 'error': None}
    """
    if hasattr(value, "tolist"):
        value = value.tolist()
    if isinstance(value, Mapping):
        return {str(key): json_value(item) for key, item in value.items()}
    if isinstance(value, list | tuple | set):
        return [json_value(item) for item in value]
    if isinstance(value, complex):
        return [json_value(value.real), json_value(value.imag)]
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return value if value is None or isinstance(value, bool | int | str) else str(value)
