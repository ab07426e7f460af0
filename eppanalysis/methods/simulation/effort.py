"""How much a search may compute: its work is counted where it is done, and ends it.

A search opens an allotment; whatever computes below it, however deep, spends from it: runs of the engine, sweeps along
the arcs of an orbit, iterates of harmonic balance, comparisons of all events of a run with each other. Work is counted
in steps of the engine, never in seconds, so that a search ends at the same place on every machine. What lies between
the search and the engine need not hand anything on, and computes without end where nothing has been allotted.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass


class Spent(Exception):
    """The work that was allotted is done; the one who allotted it says what is left."""


@dataclass
class Work:
    """An allotment within another one: what may be spent, and what has been [steps]."""

    most: float
    outer: Work | None = None
    used: float = 0.0

    @property
    def left(self) -> float:
        """What may still be spent."""
        left, work = self.most - self.used, self.outer
        while work is not None:
            left, work = min(left, work.most - work.used), work.outer
        return max(left, 0.0)

    def spend(self, steps: float) -> None:
        """Count work here and in what lies around."""
        work: Work | None = self
        while work is not None:
            work.used += steps
            work = work.outer


_current: ContextVar[Work | None] = ContextVar("work", default=None)


@contextmanager
def allotted(most: float) -> Iterator[Work]:
    """So much work and no more, of what an outer allotment has left: :class:`Spent` is raised where that is done."""
    own = Work(most, _current.get())
    token = _current.set(own)
    try:
        yield own
    finally:
        _current.reset(token)


def spend(steps: float) -> None:
    """Count work.

    Raises
    ------
    Spent
        If nothing was left before, or nothing is then.
    """
    work = _current.get()
    if work is not None:
        if work.left:
            work.spend(steps)
        if not work.left:
            raise Spent


def left() -> float:
    """Steps that may still be spent; infinite where nothing has been allotted."""
    work = _current.get()
    return float("inf") if work is None else work.left
