"""The command ``eppanalysis certify``: proofs about loops with one element, and the check of their files."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from eppanalysis.cli.common import (
    NOTHING,
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
)
from eppanalysis.errors import EppError
from eppanalysis.methods.certificates.registry import Claim

if TYPE_CHECKING:
    from eppanalysis.methods.certificates.result import Certificate

#: Exit code of a file that is refused, or that is about another loop than the case.
_REFUSED = 1

MaybeCase = Annotated[
    str | None,
    typer.Argument(metavar="CASE", help="Case file (TOML), or name of a shipped case.", show_default=False),
]
Statement = Annotated[
    Claim | None,
    typer.Option(
        "--statement",
        help="roots: all roots of the describing-function balance in a box (default); absence: no periodic motion but "
        "rest; cycles: these are all limit cycles, and nothing else is periodic but rest.",
        show_default=False,
    ),
]
Within = Annotated[
    list[str],
    typer.Option(
        "--within",
        metavar='"FIELD RANGE"',
        help='One proof of absence for all values of a parameter, as in "Kp 0.8..2" or "Kp ± 10 %"; repeatable.',
    ),
]
File = Annotated[Path | None, file_option("Write the certificate (.json), or a picture.")]
Checked = Annotated[
    Path | None,
    file_option(
        "Check a certificate in a separate process; with a CASE, also whether it is about that case.", "--check"
    ),
]


def certify(
    case: MaybeCase = None,
    statement: Statement = None,
    within: Within = NOTHING,
    check: Checked = None,
    settings: Settings = NOTHING,
    as_json: Json = False,
    output: File = None,
) -> None:
    """Prove what the DF predicts, or which limit cycles a loop has, or none, in a file that is checked."""
    if check is not None:
        _check(check, case, settings, [statement, within, as_json, output])
        return
    if case is None:
        raise EppError("certify: there is no case; expected a case, or --check FILE.")
    from eppanalysis.methods.certificates.certify import certify as prove
    from eppanalysis.tables.files import PICTURES

    check_output(output, (".json", *PICTURES))
    found = load_case(case, settings)
    ranges = by_name("--within", (named_range("--within", text, found, found.parameters) for text in within))
    for name, value in ((name, value) for name, both in ranges.items() for value in both):
        check_value(found, "--within", name, value)
    result = prove(found, statement or (Claim.ABSENCE if ranges else Claim.ROOTS), within=ranges or None)
    answer("certify", found, settings, as_json, result, lambda: _show(result))
    if output is not None:
        _write(result, output)


def _show(result: Certificate) -> None:
    from eppanalysis.tables.console import certificate_table

    echo(result.message)
    if result.roots or result.undecided:
        print_table(certificate_table(result))


def _write(result: Certificate, output: Path) -> None:
    from eppanalysis.tables.files import write_figure

    if output.suffix.lower() == ".json":
        result.write(output)
    else:
        write_figure(result.plot(), output)


def _check(path: Path, case: str | None, settings: Settings, others: list[object]) -> None:
    """Say whether a file proves what it claims, and whether that is about a case."""
    from eppanalysis.methods.certificates.certify import check_certificate

    if any(others):
        raise EppError(f"--check {path}: is given beside other options; expected it alone, or with a case.")
    if case is None and settings:
        raise EppError(f"--check {path}: --set is given without a case; expected a case whose fields it sets.")
    found = check_certificate(path, None if case is None else load_case(case, settings))
    passed = found.accepted and found.about is not False
    echo(found.message, err=not passed)
    if not passed:
        raise typer.Exit(_REFUSED)
