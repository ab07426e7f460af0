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
    """An allotment: what may be spent, and what has been [steps]; within another one no more than that had left."""

    most: float
    had: float = float("inf")
    used: float = 0.0

    @property
    def left(self) -> float:
        """What may still be spent."""
        return max(min(self.most, self.had) - self.used, 0.0)


_current: ContextVar[Work | None] = ContextVar("work", default=None)


@contextmanager
def allotted(most: float) -> Iterator[Work]:
    """So much work and no more, of what an outer allotment has left: :class:`Spent` is raised where that is done."""
    outer = _current.get()
    own = Work(most) if outer is None else Work(most, outer.left)
    token = _current.set(own)
    try:
        yield own
    finally:
        _current.reset(token)
        if outer is not None:  # which nothing else spends meanwhile
            outer.used += own.used


@contextmanager
def telling() -> Iterator[None]:
    """What a search tells of what it found is computed to the end, and counted, even where its work is done."""
    outer, own = _current.get(), Work(float("inf"))
    token = _current.set(own)
    try:
        yield
    finally:
        _current.reset(token)
        if outer is not None:
            outer.used += own.used


def spend(steps: float) -> None:
    """Count work.

    Raises
    ------
    Spent
        If nothing was left before, or nothing is then.
    """
    work = _current.get()
    if work is not None:
        before = work.left
        if before:
            work.used += steps
        if before <= steps:
            raise Spent


def left() -> float:
    """Steps that may still be spent; infinite where nothing has been allotted."""
    work = _current.get()
    return float("inf") if work is None else work.left
