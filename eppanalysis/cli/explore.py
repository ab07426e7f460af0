"""The command ``eppanalysis explore``: a page in the browser, on this machine only."""

from __future__ import annotations

import sys
import tempfile
import webbrowser
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Annotated

import typer

from eppanalysis.cli.common import NOTHING, CaseName, Settings, echo, load_case


def explore(
    case: CaseName,
    settings: Settings = NOTHING,
    port: Annotated[int, typer.Option("--port", help="Port on this machine; 0 takes any free one.")] = 5006,
    browser: Annotated[
        bool | None,
        typer.Option("--browser/--no-browser", help="Open the page.", show_default="on a terminal"),
    ] = None,
) -> None:
    """See in the browser what happens when a slider moves: run, Nyquist plot, limit cycles, design map.

    The page is served to this machine only, until interrupted with Ctrl-C.
    """
    from eppanalysis.explorer import explore as serve

    wanted = sys.stdout.isatty() if browser is None else browser

    found = load_case(case, settings)
    with ExitStack() as until_the_end:

        def ready(address: str) -> None:
            echo(f"{address}  (Ctrl-C ends it)")
            sys.stdout.flush()
            if wanted:
                webbrowser.open(until_the_end.enter_context(_leading_to(address)).as_uri())

        with suppress(KeyboardInterrupt):  # how it is meant to end: nothing to report
            serve(found, port, ready)
            return
        raise typer.Exit(130)


@contextmanager
def _leading_to(address: str) -> Iterator[Path]:
    """A file that only its owner may read and that leads on to an address, which has a secret in it.

    What a browser is started with, other users of the machine can see.
    """
    number, name = tempfile.mkstemp(prefix="eppanalysis-", suffix=".html")
    try:
        with open(number, "w", encoding="utf-8") as file:
            file.write(
                f'<!DOCTYPE html>\n<meta charset="utf-8">\n<meta http-equiv="refresh" content="0; url={address}">\n'
            )
            file.write(f'<title>eppanalysis</title>\n<a href="{address}">eppanalysis</a>\n')
        yield Path(name)
    finally:
        Path(name).unlink(missing_ok=True)
