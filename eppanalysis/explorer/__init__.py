"""The explorer: a page in the browser of this machine on which one sees what happens when a slider moves.

``values`` are what can be moved, ``quick`` is what is seen at once, ``slow`` what a moment later; ``figures`` draws,
``page`` is one tab, ``server`` serves it.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import TYPE_CHECKING

from eppanalysis.errors import require_packages

if TYPE_CHECKING:
    from eppanalysis.cases import Case

__all__ = ["explore"]

_NEEDED = ("bokeh", "dask", "filelock", "zarr")


def explore(case: Case, port: int = 0, ready: Callable[[str], None] | None = None) -> None:
    """Serve a page that explores a case, on this machine only, until interrupted.

    Sliders move the parameters of the design; run and Nyquist plot follow at once, exact limit cycles, their branch
    over a parameter, and the design map a moment later. The address holds the state; nothing is read from files and
    nothing written but what the browser saves itself.

    Parameters
    ----------
    port : int
        Port on the loopback address; 0 for any free one.
    ready : callable, optional
        Called with the address of the page when it can be opened; by default it is printed.

    Raises
    ------
    EppError
        If a library is missing, the port is in use, or the case cannot be run.
    """
    require_packages("explore: the page", "explore", *_NEEDED)
    from eppanalysis.explorer.server import serve

    serve(case, port, ready or _say)


def _say(address: str) -> None:
    sys.stdout.write(f"{address}\n")
    sys.stdout.flush()
