"""The command ``eppanalysis new``: a case file with comments, from six short questions or from options."""

from __future__ import annotations

import sys
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from eppanalysis.cli.common import NOTHING, by_name, check_output, echo, split_pair
from eppanalysis.errors import EppError

if TYPE_CHECKING:
    from eppanalysis.cases.drafts import Draft


class Machine(StrEnum):
    """What a new file is of."""

    SERVO = "servo"
    THERMOSTAT = "thermostat"
    VALVE = "valve"
    TWO_MASS = "two-mass"
    ELBOW = "elbow"


def new(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="File to write (.toml).", show_default=False)],
    kind: Annotated[
        Machine | None,
        typer.Option("--kind", help="What it is of: servo, thermostat, valve, two-mass or elbow.", show_default=False),
    ] = None,
    settings: Annotated[
        list[str],
        typer.Option("--set", metavar="NAME=VALUE", help='A number of the file, as in ratio="36:1"; repeatable.'),
    ] = NOTHING,
    force: Annotated[bool, typer.Option("--force", help="Replace a file that is there.")] = False,
) -> None:
    """Write a case file with comments, ready to run: by six short questions, or by --kind and --set.

    Numbers that are not given are plausible ones, which the comments say how to replace.
    """
    check_output(file, (".toml",))
    if file.exists() and not force:
        raise EppError(f"{file}: is there already; expected a new name, or --force.")
    from eppanalysis.cases.command_line import command
    from eppanalysis.cases.drafts import Draft
    from eppanalysis.writing import write_text

    if kind is None and (settings or not sys.stdin.isatty()):
        raise EppError(f"--kind: is missing; expected one of {', '.join(Machine)}.")
    values = by_name("--set", (split_pair(text, "--set", "NAME=VALUE") for text in settings))
    if kind is None:
        draft = Draft(_kind())
        values = _numbers(draft)
    else:
        draft = Draft(kind)
    write_text(draft.with_numbers(values), file)
    echo(f"{file}: {draft.about}")
    left = "".join(f"{question.name}, " for question in draft.questions if question.name not in values)
    echo(f"Plausible, not yours: {left}{'and ' if left else ''}what the comments name.")
    echo("Next:")
    for step in ("check", "predict", "simulate"):
        echo(f"  {command(step, str(file))}")


def _kind() -> str:
    """The answer to the first question."""
    known = list(Machine)
    echo("Six questions; Enter takes the answer in brackets.")
    while True:
        answer = _answer(f"What is it: {', '.join(known)}", known[0]).lower().replace("_", "-")
        if answer in known:
            return answer
        echo(f"{answer}: is not known; expected one of {', '.join(known)}.")


def _numbers(draft: Draft) -> dict[str, str]:
    """The answers to the other questions; what a user leaves at its default is not among them."""
    values: dict[str, str] = {}
    for question in draft.questions:
        while (answer := _answer(question.about, question.value)) != question.value:
            try:
                draft.check(question.name, answer)
                values[question.name] = answer
                break
            except EppError as error:
                echo(str(error).removeprefix("--set: "))
    return values


def _answer(question: str, default: str) -> str:
    """What is typed behind a question, or its default.

    Raises
    ------
    EppError
        If the input ends.
    """
    try:
        return input(f"{question} [{default}]: ").strip() or default
    except EOFError:
        echo()
        raise EppError("new: the answers end before the questions; expected one each. Nothing is written.") from None
