"""What ``bounds`` and ``guide`` share: the option that writes their table as a manual prints it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, TypeVar

import typer

from eppanalysis.cli.common import check_output
from eppanalysis.errors import CaseError, EppError

if TYPE_CHECKING:
    from eppanalysis.cases import Case
    from eppanalysis.guides.guideline import Guide
    from eppanalysis.methods.bounds.result import DesignBounds

R = TypeVar("R", "Guide", "DesignBounds")
Manuals = Annotated[
    list[Path],
    typer.Option(
        "--manual",
        metavar="FILE",
        help="Write the table for a manual, in plain words: .md, .tex, .html, .docx or .xlsx; repeatable.",
        show_default=False,
    ),
]
Step = Annotated[
    str | None,
    typer.Option(
        "--step",
        metavar="VALUE",
        help='Step in which the limit is rounded to the safe side for --manual, as in "0.05 deg".',
        show_default=False,
    ),
]


def step_for_manual(
    case: Case, limit: str, paths: Sequence[Path], step: str | None, within: tuple[str, str] | None
) -> float | None:
    """The step in the unit of the table, with what cannot be written refused before anything is computed.

    Raises
    ------
    EppError
        If a file cannot be written, the step is no quantity of the limit or larger than all values in which the bound
        is sought, or there is a step and no file.
    """
    if not paths:
        if step is not None:
            raise EppError(f"--step {step}: rounds the table of --manual; expected a file for it.")
        return None
    from eppanalysis.tables.manual import MANUALS, check_manual

    for path in paths:
        check_output(path, MANUALS)
        check_manual(path)
    if step is None:
        return None
    try:
        found = case.readable(limit)[1] * case.si(limit, step)
    except CaseError as error:
        raise CaseError("--step", limit, step, error.expected) if error.field == limit else error from None
    if not found > 0:
        raise EppError(f"--step {step}: is no step; expected a positive one.")
    from eppanalysis.methods.bounds.design import range_within

    high = range_within(case, limit, within)[1]
    if case.si(limit, step) > high:
        sought = f"{case.text(limit, high)}, the end of the range in which the bound is sought"
        raise EppError(f"--step {step}: is no step of {limit}; expected at most {sought}.")
    return found


def stepped(result: R, step: float | None) -> R:
    """The result with its limits printed in a step, where one is given, so that it is the same step everywhere.

    Raises
    ------
    EppError
        If the step is larger than the smallest bound.
    """
    if step is None:
        return result
    from eppanalysis.guides.manual import in_steps

    return in_steps(result, step)


def write_manual(result: Guide | DesignBounds, paths: Sequence[Path]) -> None:
    """Write the table for a manual, where one is requested.

    Raises
    ------
    EppError
        If a file cannot be written.
    """
    if paths:
        from eppanalysis.guides.manual import manual_table

        table = manual_table(result)
        for path in paths:
            table.write(path)
