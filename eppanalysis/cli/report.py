"""The command ``eppanalysis report``: a notebook, a page or a PDF that can be handed on."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import typer

from eppanalysis.cli.common import NOTHING, Settings, check_output, echo, expanded, file_option, load_case, progress
from eppanalysis.progress import Progress

Target = Annotated[Path, file_option("A page (.html), a notebook (.ipynb) or a document (.pdf).")]
Cases = Annotated[
    list[str],
    typer.Argument(metavar="CASE", help="Case files (TOML), or names of shipped cases.", show_default=False),
]


def report(
    cases: Cases,
    output: Target,
    settings: Settings = NOTHING,
    full: Annotated[
        bool, typer.Option("--full", help="With the guideline of an elbow at five gains; takes some minutes.")
    ] = False,
) -> None:
    """Write a report: all methods, pictures and provenance in one page, notebook or PDF.

    The page is one file that opens without a network; the notebook opens and runs again in Jupyter as it is.
    """
    from eppanalysis.report import SUFFIXES, check, report as write_report

    check_output(output, SUFFIXES)
    check(output)
    found = [load_case(text, settings) for text in expanded(cases)]
    with progress("report") as advance:
        write_report(found, output, full=full, progress=advance or _progress_over([case.title for case in found]))
    echo(f"{output}: written.")


def _progress_over(titles: Sequence[str]) -> Progress:
    """Where no bar is seen, a line for each of several cases, and for each section of a single one."""
    told: set[str] = set()

    def tell(done: int, total: int | None, doing: str) -> None:
        if doing not in told and (len(titles) == 1 or doing in titles):
            told.add(doing)
            at, of = (done + 1, total) if len(titles) == 1 else (titles.index(doing) + 1, len(titles))
            echo(f"{at} of {of}: {doing}", err=True)

    return tell
