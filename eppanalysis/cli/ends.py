"""How a command ends before its time: interrupted from the keyboard, or asked by the system."""

from __future__ import annotations

import signal
from typing import NoReturn

_asked: list[int] = []


def end_as_interrupted() -> None:
    """Let SIGTERM end a command as an interrupt does: temporary files and processes are put away.

    Where the caller has said what that signal does, it does that.
    """
    if signal.getsignal(signal.SIGTERM) is signal.SIG_DFL:
        signal.signal(signal.SIGTERM, _interrupt)


def exit_code() -> int:
    """Exit code of a command that was interrupted: 128 and the number of the signal."""
    return 128 + (_asked[-1] if _asked else signal.SIGINT)


def _interrupt(number: int, frame: object) -> NoReturn:
    _asked.append(number)
    raise KeyboardInterrupt
