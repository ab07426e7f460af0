"""How much a search may compute: its work is counted where it is done, and ends it.

A search opens a budget; whatever computes below it, however deep, spends from it: runs of the engine, sweeps along
the arcs of an orbit, iterates of harmonic balance, comparisons of all events of a run with each other. Work is counted
in steps of the engine, never in seconds, so that a search ends at the same place on every machine. What lies between
the search and the engine need not hand anything on, and computes without end where there is no budget.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from contextvars import ContextVar
from dataclasses import dataclass


class BudgetExceeded(Exception):
    """The budget is spent; whoever opened it says what was not done."""


@dataclass
class Budget:
    """What may be spent, and what has been [steps]; within another budget no more than that had left."""

    most: float
    had: float = float("inf")
    used: float = 0.0

    @property
    def remaining(self) -> float:
        """What may still be spent."""
        return max(min(self.most, self.had) - self.used, 0.0)


_current: ContextVar[Budget | None] = ContextVar("budget", default=None)


def budget(most: float) -> AbstractContextManager[Budget]:
    """So much work and no more, of what an outer budget leaves; :class:`BudgetExceeded` is raised behind it."""
    return _opened(Budget(most, remaining()))


def telling() -> AbstractContextManager[Budget]:
    """What a search tells of what it found is computed to the end, and counted, even where its work is done."""
    return _opened(Budget(float("inf")))


@contextmanager
def _opened(own: Budget) -> Iterator[Budget]:
    """A budget that what follows spends from, and counts in the outer one."""
    outer, token = _current.get(), _current.set(own)
    try:
        yield own
    finally:
        _current.reset(token)
        if outer is not None:  # which nothing else spends meanwhile
            outer.used += own.used


def spend(steps: float) -> None:
    """Count work.

    Raises
    ------
    BudgetExceeded
        If nothing was left before, or nothing is then.
    """
    work = _current.get()
    if work is not None:
        before = work.remaining
        if before:
            work.used += steps
        if before <= steps:
            raise BudgetExceeded


def remaining() -> float:
    """Steps that may still be spent; infinite where there is no budget."""
    work = _current.get()
    return float("inf") if work is None else work.remaining
