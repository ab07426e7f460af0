"""How far a long computation is: what it tells, and the one bar that shows it on a terminal or in a notebook."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rich.progress import Progress as Bar

#: Called with how much is done, of how much (None where that is not known before the end), and a text (empty where that
#: is plain).
Progress = Callable[[int, int | None, str], None]

#: A notebook is updated this often at most [s], and a line there is so many characters wide.
_PAUSE, _WIDTH = 0.25, 90


@contextmanager
def progress_bar(
    what: str, total: int | None = None, done: int = 0, *, unit: str = "", keep: bool = False
) -> Iterator[Progress | None]:
    """Show how a computation gets on: how much of how much, how fast, how long.

    Parameters
    ----------
    what : str
        Shown in front, until something else is said to be done.
    total, done : int
        How much there is to do, where that is known, and how much of it is done already.
    unit : str
        What is counted; without one no rate is shown.
    keep : bool
        Whether the bar stays on the terminal when all is done.

    Yields
    ------
    callable or None
        Called from any thread; None where nobody looks.
    """
    from rich.console import Console

    console = Console(stderr=True)
    if done == total or not (console.is_jupyter or console.is_terminal):
        yield None
        return
    line = Console(width=_WIDTH, force_jupyter=False, force_terminal=False, no_color=True)
    bar = _bar(line if console.is_jupyter else console, total, unit, keep)
    job = bar.add_task(what, total=total, completed=done)

    def advance(done: int, of: int | None, doing: str) -> None:
        bar.update(job, completed=done, total=of, description=doing or what)

    if console.is_jupyter:
        with _in_notebook(bar, advance) as shown:
            yield shown
    else:
        with bar:
            yield advance


def steps(progress: Progress | None, total: int, done: int = 0) -> Callable[[int], None]:
    """A function that takes how much more is done, from any thread, and passes on how much there is by now."""
    lock = threading.Lock()

    def advance(n: int) -> None:
        nonlocal done
        with lock:
            done += n
            if progress is not None:
                progress(done, total, "")

    return advance


def _bar(console: Any, total: int | None, unit: str, keep: bool) -> Bar:
    from rich.progress import (
        BarColumn,
        Progress as Bar,
        ProgressColumn,
        TextColumn,
        TimeElapsedColumn,
        TimeRemainingColumn,
    )
    from rich.text import Text

    class _Count(ProgressColumn):
        def render(self, task: Any) -> Text:
            if not unit:
                return Text("")
            rate = f" {task.speed:.0f} {unit}/s" if task.speed else ""
            return Text(f"{task.completed:.0f}/{task.total:.0f}{rate}")

    # How long it takes can be said only where all there is to do was known from the begin.
    clock = TimeElapsedColumn() if total is None else TimeRemainingColumn()
    doing = TextColumn("{task.description}", markup=False)
    return Bar(doing, BarColumn(), _Count(), clock, console=console, transient=not keep)


@contextmanager
def _in_notebook(bar: Bar, progress: Progress) -> Iterator[Progress]:
    """The same bar as one line of text that is replaced: it needs no widgets and stays in the saved notebook."""
    from IPython.display import display

    lock, last = threading.Lock(), 0.0

    def line() -> dict[str, str]:
        with bar.console.capture() as held:
            bar.console.print(bar.get_renderable())
        return {"text/plain": held.get().rstrip()}

    handle = display(line(), raw=True, display_id=True)

    def show(done: int, of: int | None, doing: str) -> None:
        nonlocal last
        progress(done, of, doing)
        with lock:
            if time.monotonic() - last > _PAUSE:
                last = time.monotonic()
                handle.update(line(), raw=True)

    try:
        yield show
    finally:
        handle.update(line(), raw=True)
