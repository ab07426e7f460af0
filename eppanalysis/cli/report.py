"""The command ``eppanalysis report``: a notebook, a page or a PDF that can be handed on."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from eppanalysis.cli.common import NOTHING, Settings, check_output, expanded, file_option, load_case, progress

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
        write_report(found, output, full=full, progress=advance)
    typer.echo(f"{output}: written.")
