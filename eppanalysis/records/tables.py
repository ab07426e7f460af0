"""What every format is opened as: headings with units, and blocks of rows of chosen columns.

Signals of a recording that have times of their own lie in groups. Those that are chosen beside signals of another group
are interpolated linearly onto the times of the first that is chosen.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike

from eppanalysis.arguments import floats
from eppanalysis.arrays import Array
from eppanalysis.errors import CaseError
from eppanalysis.records.columns import TIME, Column, Heading, Headings

#: What a message calls a row (i) and its cell in a column (j): the row's number, and the cell as the table has it.
Cell = Callable[[int, int], tuple[str, str]]


@dataclass(frozen=True, eq=False)
class Piece:
    """Some rows, one behind the other."""

    rows: Array  # (rows, columns): as in the table; nan where a sample is missing
    cell: Cell
    done: int  # how much of the table is read, in the table's measure


class Table(Protocol):
    """A table that has been opened: its headings are read, its rows are not."""

    headings: Headings
    size: int  # of what a piece has done of it
    notes: list[str]  # what happened on reading

    def pieces(self, columns: Sequence[Column]) -> Iterator[Piece]:
        """Rows of some columns.

        Raises
        ------
        CaseError
            If a cell is no number.
        """


def numbered(rows: Array, before: int = 0) -> Cell:
    """What messages call the cells of rows of a table without lines."""
    return lambda i, j: (f"row {before + i + 1}", "" if np.isnan(rows[i, j]) else f"{rows[i, j]:g}")


@dataclass(frozen=True, eq=False)
class Group:
    """Signals that share their times."""

    headings: Sequence[Heading]
    #: Times in the unit of their heading, or None where the table has none, and values of the signals in some places.
    read: Callable[[Sequence[int]], tuple[ArrayLike | None, Sequence[ArrayLike]]]


@dataclass(eq=False)
class Groups:
    """A table in memory, of one group or several."""

    source: str
    groups: Sequence[Group]
    time: Heading | None = Heading(TIME, "s", "time [s]")
    notes: list[str] = field(default_factory=list)
    size: int = 1

    def __post_init__(self) -> None:
        own = [(None, 0)] if self.time is not None else []
        self.places = own + [(group, i) for group in self.groups for i in range(len(group.headings))]
        found = [self.time if group is None else group.headings[i] for group, i in self.places]
        self.headings = Headings(self.source, [heading for heading in found if heading is not None], "", True)

    def pieces(self, columns: Sequence[Column]) -> Iterator[Piece]:
        """All rows at once."""
        chosen = [(*self.places[c.place], c.heading.name) for c in columns]
        groups = list(dict.fromkeys(group for group, _, _ in chosen if group is not None)) or [*self.groups[:1]]
        read = {}
        for group in groups:
            names = {i: name for other, i, name in chosen if other is group}
            time, values = group.read([*names])
            read[group] = self._numbers("time", time, None), dict(zip(names, values, strict=True))
        times = read[groups[0]][0] if groups else np.empty(0)
        inside = np.ones(times.shape, bool)
        for group in groups[1:]:
            inside &= self._common(times, read[group][0], next(n for g, _, n in chosen if g is group))
        found = []
        for group, i, name in chosen:
            own, values = read[group] if group is not None else (times, {i: times})
            numbers = self._numbers(name, values[i], own.shape if self.time is not None else None)
            if not np.array_equal(own, times):
                numbers = np.interp(times, own, numbers) if own.size else np.full_like(times, np.nan)
                first = next(n for g, _, n in chosen if g is not None)
                self.notes.append(f"{name} is interpolated linearly at the times of {first}.")
            found.append(numbers)
        rows = np.column_stack(found)
        rows = rows[inside] if self.time is not None else rows
        yield Piece(rows, numbered(rows), 1)

    def _numbers(self, name: str, values: Any, shape: tuple[int, ...] | None) -> Array:
        if values is None:
            return np.empty(0)
        numbers = floats(values, f"{self.source}: {name}")
        if numbers.ndim != 1 or shape not in (None, numbers.shape):
            expected = "a number for each sample" if shape is None else f"that of time, {shape}"
            raise CaseError(self.source, name, f"of shape {numbers.shape}", expected)
        return numbers

    def _common(self, times: Array, own: Array, name: str) -> Array:
        """Where signals of another group have values, which must be in order."""
        if not np.all(np.diff(own) > 0):
            raise CaseError(self.source, name, "at times that do not increase", "a later time in each row")
        return (times >= own[0]) & (times <= own[-1]) if own.size else np.zeros(times.shape, bool)
