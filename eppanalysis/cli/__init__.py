"""The command line: a module for each group of commands, all together in `commands`, and their entry here."""

from __future__ import annotations

import atexit
import gc
import os
import sys
from typing import NoReturn

from eppanalysis.cli.ends import end_as_interrupted, exit_code
from eppanalysis.cli.signs import write_plainly


def main() -> None:
    """Entry point of the command ``eppanalysis``."""
    # Many small linear systems: threads inside the linear algebra cost more than they give.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    # Pictures are written, never shown, and files bear no date: what libraries read here has no use, and what they
    # cannot read ends in tracebacks of theirs. So does a width of the terminal that is none.
    for name in ("MPLBACKEND", "SOURCE_DATE_EPOCH"):
        os.environ.pop(name, None)
    if not os.environ.get("TERMINAL_WIDTH", "").isdecimal():
        os.environ.pop("TERMINAL_WIDTH", None)
    # What libraries make while they are imported stays to the end: looking there for garbage took a fifth of a command.
    gc.set_threshold(50_000, 10, 10)
    atexit.register(gc.freeze)
    for name, mode in (("stdin", "r"), ("stdout", "w"), ("stderr", "w")):
        if getattr(sys, name) is None:  # closed by the caller, who wants neither text nor a traceback about it
            _lead_nowhere(name, mode)
    for stream in (sys.stdout, sys.stderr):
        write_plainly(stream)
    end_as_interrupted()
    try:
        from eppanalysis.cli.commands import app

        app()
    except KeyboardInterrupt:  # before a command has begun
        sys.stderr.write("Interrupted: nothing is kept.\n")
        _end_interrupted()
    except SystemExit as ended:
        if ended.code == 130:  # of any interrupt, whoever has caught it
            _end_interrupted()
        raise


def _lead_nowhere(name: str, mode: str) -> None:
    """Open a standard stream that is closed, for the processes of the command, too: its number is the next free one."""
    number = os.open(os.devnull, os.O_RDWR)
    os.set_inheritable(number, True)
    setattr(sys, name, os.fdopen(number, mode))


def _end_interrupted() -> NoReturn:
    """End with the code of an interrupt.

    Python notes when one passes through text that it executes (a dataclass is made of some), and would end by SIGINT
    for that; it forgets the note with the next text.
    """
    exec("")
    sys.exit(exit_code())
