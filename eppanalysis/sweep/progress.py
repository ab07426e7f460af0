"""Progress of a sweep: cells, rate and time left, on a terminal or in a notebook."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rich.progress import Progress

Report = Callable[[int], None]

#: A notebook is told this often at most [s], and a line there is so many characters wide.
_PAUSE, _WIDTH = 0.25, 90


@contextmanager
def progress(n_cells: int, n_done: int, wanted: bool, told: str = "") -> Iterator[Report]:
    """Show how a sweep gets on; nothing where nobody looks.

    Parameters
    ----------
    n_cells, n_done : int
        Cells of the sweep, and how many of them are there already.
    wanted : bool
    told : str
        What there is to know before it begins; a terminal, a notebook and a file that is written all show it.

    Yields
    ------
    callable
        To be called with the number of cells of each block that is done, from any thread.
    """
    from rich.console import Console

    console = Console(stderr=True)
    if wanted and told:
        console.print(told, markup=False, highlight=False, soft_wrap=True)
    if not wanted or n_done == n_cells or not (console.is_jupyter or console.is_terminal):
        yield lambda n: None
    elif console.is_jupyter:
        with _in_notebook(n_cells, n_done) as report:
            yield report
    else:
        with _bar(console) as bar:
            job = bar.add_task("cells", total=n_cells, completed=n_done)
            yield lambda n: bar.advance(job, n)


def _bar(console: Any) -> Progress:
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, ProgressColumn, TextColumn, TimeRemainingColumn
    from rich.text import Text

    class _Rate(ProgressColumn):
        def render(self, task: Any) -> Text:
            return Text(f"{task.speed:.0f} cells/s" if task.speed else "")

    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), _Rate(), TimeRemainingColumn())
    return Progress(*columns, console=console)


@contextmanager
def _in_notebook(n_cells: int, n_done: int) -> Iterator[Report]:
    """The same bar as one line of text that is replaced: it needs no widgets and stays in the saved notebook."""
    from IPython.display import display
    from rich.console import Console

    console = Console(width=_WIDTH, force_jupyter=False, force_terminal=False, no_color=True)
    bar, lock, last = _bar(console), threading.Lock(), 0.0
    job = bar.add_task("cells", total=n_cells, completed=n_done)

    def line() -> dict[str, str]:
        with console.capture() as held:
            console.print(bar.get_renderable())
        return {"text/plain": held.get().rstrip()}

    handle = display(line(), raw=True, display_id=True)

    def report(n: int) -> None:
        nonlocal last
        bar.advance(job, n)
        with lock:
            if time.monotonic() - last > _PAUSE:
                last = time.monotonic()
                handle.update(line(), raw=True)

    try:
        yield report
    finally:
        handle.update(line(), raw=True)
