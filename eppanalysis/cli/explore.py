"""The command ``eppanalysis explore``: a page in the browser, on this machine only."""

from __future__ import annotations

import sys
from contextlib import suppress
from typing import Annotated

import typer

from eppanalysis.cli.common import NOTHING, CaseName, Settings, load_case


def explore(
    case: CaseName,
    settings: Settings = NOTHING,
    port: Annotated[int, typer.Option("--port", help="Port on this machine; 0 takes any free one.")] = 5006,
    browser: Annotated[
        bool | None,
        typer.Option("--browser/--no-browser", help="Open the page. [on a terminal]", show_default=False),
    ] = None,
) -> None:
    """See in the browser what happens when a slider moves: run, Nyquist plot, limit cycles, design map.

    The page is served to this machine only, until interrupted with Ctrl-C.
    """
    from eppanalysis.explorer import explore as serve

    wanted = sys.stdout.isatty() if browser is None else browser

    def ready(address: str) -> None:
        typer.echo(f"{address}  (Ctrl-C ends it)")
        sys.stdout.flush()
        if wanted:
            import webbrowser

            webbrowser.open(address)

    found = load_case(case, settings)
    with suppress(KeyboardInterrupt):  # how it is meant to end: nothing to be told
        serve(found, port, ready)
        return
    raise typer.Exit(130)
