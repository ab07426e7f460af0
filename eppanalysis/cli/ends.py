"""How a command ends before its time: interrupted from the keyboard, or by a signal of the system."""

from __future__ import annotations

import os
import signal
import sys
from threading import Timer
from typing import Any, NoReturn

_asked: list[int] = []


def end_as_interrupted() -> None:
    """Let SIGTERM end a command as an interrupt does: temporary files and processes are put away.

    Where the caller has said what that signal does, or what becomes of errors that nobody can catch, it does that.
    """
    if signal.getsignal(signal.SIGTERM) is signal.SIG_DFL:
        signal.signal(signal.SIGTERM, _interrupt)
    if sys.unraisablehook is sys.__unraisablehook__:
        sys.unraisablehook = _ask_again


def exit_code() -> int:
    """Exit code of a command that was interrupted: 128 and the number of the signal."""
    return 128 + (_asked[-1] if _asked else signal.SIGINT)


def _ask_again(found: Any) -> None:
    """Send a signal once more whose interrupt was lost: one that comes in a callback of Python's own goes nowhere."""
    if found.exc_type is KeyboardInterrupt:
        # A little later, when the callback is over, as in it the interrupt would be lost again.
        Timer(0.05, os.kill, (os.getpid(), _asked[-1] if _asked else signal.SIGINT)).start()
    else:
        sys.__unraisablehook__(found)


def _interrupt(number: int, frame: object) -> NoReturn:
    _asked.append(number)
    raise KeyboardInterrupt
