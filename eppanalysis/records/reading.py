"""Tables to arrays in SI units, in bounded memory whatever their length.

A table is read in pieces. Rows beyond some ten thousand are averaged in blocks of equal numbers of rows, so that every
row counts and none is kept. What must hold of times, sizes and holes is checked here, of all formats.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from eppanalysis.arrays import Array, BoolArray
from eppanalysis.errors import CaseError, Missing, did_you_mean
from eppanalysis.progress import Progress
from eppanalysis.records.columns import TIME, Column, find_columns
from eppanalysis.records.formats import Given, opened
from eppanalysis.records.tables import Piece, Table

#: Rows that are kept at least, once blocks are averaged; largest magnitude (SI).
KEPT, LARGEST = 16_384, 1e9
#: Most columns that a note lists of those that were not used.
_LISTED = 10
#: Rows from which the smallest step between readings is taken.
_LOOKED_AT = 100_000


@dataclass(frozen=True, eq=False)
class Recording:
    """Columns of a table."""

    source: str  # the file, as the user gave it
    columns: dict[str, Array]  # (n,): by role, in SI units; "time" counts rows where the table has no times
    #: n_rows, n_holes: rows in the table; those left out because a cell is empty.
    n_rows: int
    n_holes: int
    block: int  # rows that were averaged into one
    resolution: dict[str, float]  # smallest step between different readings of a column, in SI units
    timed: bool  # whether the table has times
    notes: tuple[str, ...] = ()  # which columns were read, and what happened to the rows

    def __len__(self) -> int:
        return len(self.columns[TIME])

    def __getitem__(self, role: str) -> Array:
        return self.columns[role]

    def __contains__(self, role: str) -> bool:
        return role in self.columns

    def sentences(self) -> list[str]:
        """What happened to the rows."""
        out = list(self.notes)
        if self.n_holes:
            have, were = ("has", "was") if self.n_holes == 1 else ("have", "were")
            out.append(f"{self.n_holes} of {self.n_rows} rows {have} an empty cell and {were} left out.")
        if self.block > 1:
            out.append(f"{self.n_rows} rows were averaged in blocks of {self.block}.")
        return out


def read_recording(
    given: Given,
    needed: Sequence[str],
    optional: Sequence[str] = (),
    columns: Mapping[str, tuple[str, str]] | None = None,
    *,
    units: Mapping[str, str],
    fewest: int = 8,
    progress: Progress | None = None,
) -> Recording:
    """Read the columns of a record that are needed.

    Parameters
    ----------
    given : path, mapping of str to array, DataFrame, Dataset or DataArray
        A file of any format of :mod:`eppanalysis.records.formats`, or a table in memory.
    needed, optional : sequence of str
        Roles of columns; "time" among the optional ones gives row numbers where the table has no times.
    columns : mapping of str to (str, str), optional
        Name and unit of a role whose column has another name.
    units : mapping of str to str
        SI unit of every role.
    fewest : int
        A table with fewer complete rows is refused.

    Raises
    ------
    CaseError
        If it is no such table: one sentence with row, column, what is there and what was expected.
    """
    table = opened(given)
    found = find_columns(table.headings, needed, optional, columns or {}, units)
    return read(table, found, fewest=fewest, progress=progress)


def read_signals(
    given: Given,
    signals: Sequence[str],
    units: Mapping[str, str],
    columns: Mapping[str, tuple[str, str]] | None = None,
    *,
    fewest: int = 8,
    progress: Progress | None = None,
) -> Recording:
    """Read times and whatever columns a record has of the named signals.

    Parameters
    ----------
    signals : sequence of str
        Names of which the record has one or more.
    units : mapping of str to str
        SI unit of everything that may be read: of the signals, and of others that may be beside them.
    given, columns, fewest, progress
        As for :func:`read_recording`.

    Raises
    ------
    CaseError
        If it is no such table, or holds none of the signals.
    """
    table = opened(given)
    others = [name for name in units if name != TIME]
    found = find_columns(table.headings, [TIME], others, columns or {}, {**units, TIME: "s"})
    if not any(column.role in signals for column in found):
        unused = [h.name for i, h in enumerate(table.headings.all) if i not in {c.place for c in found}]
        hint = did_you_mean(unused[0] if unused else "", signals)
        near = table.headings.nearest(signals)
        expected = f"a column of a signal of the loop: {hint.rstrip('?') + near if near else hint}"
        raise CaseError(table.headings.source, table.headings.line, table.headings.shown, expected)
    return read(table, found, fewest=fewest, progress=progress)


def read(
    table: Table,
    columns: Sequence[Column],
    *,
    fewest: int,
    whole: bool = False,
    largest: float = LARGEST,
    progress: Progress | None = None,
) -> Recording:
    """Read some columns of a table.

    Parameters
    ----------
    whole : bool
        Whether every row is kept, and none may have a hole; else blocks of many rows are averaged.
    largest : float
        Magnitude beyond which a number is refused [SI].

    Raises
    ------
    CaseError
        If times do not increase, a number is not finite or too large, or there are too few complete rows.
    """
    checked = _Checked(table, columns, largest, whole)
    blocks = _Blocks(len(columns), math.inf if whole else KEPT)
    for piece in table.pieces(columns):
        blocks.add(checked.numbers(piece))
        if progress is not None:
            progress(piece.done, table.size, "")
    complete = checked.n_rows - checked.n_holes
    if complete < fewest or complete < checked.n_rows / 2:
        shown = f"{checked.n_rows} row{'s' * (checked.n_rows != 1)} long" + (
            f", {checked.n_holes} of them with empty cells" if checked.n_holes else ""
        )
        expected = f"{fewest} or more complete rows, and holes in fewer than half"
        raise CaseError(table.headings.source, "", shown, expected)
    rows = blocks.rows()
    found = {c.role: rows[:, i].copy() for i, c in enumerate(columns)}
    timed = TIME in found
    if not timed:
        found[TIME] = np.arange(float(len(rows)))
    return Recording(
        table.headings.source, found, checked.n_rows, checked.n_holes, blocks.block, checked.resolution(), timed,
        tuple(_notes(table, columns)),
    )  # fmt: skip


def _notes(table: Table, columns: Sequence[Column]) -> Iterator[str]:
    """Which columns were read under other names, and which were not."""
    for column in columns:
        if column.heading.is_called(column.role):
            yield f"{column.role} is {column.heading.name}."
    used = {c.place for c in columns}
    left = [heading for i, heading in enumerate(table.headings.all) if i not in used]
    if len(left) > _LISTED:
        yield f"{len(left)} columns were not used."
    elif left:
        yield f"Columns that were not used: {', '.join(heading.text for heading in left)}."
    yield from table.notes


class _Checked:
    """Pieces of a table in SI units, with what must hold from one to the next."""

    def __init__(self, table: Table, columns: Sequence[Column], largest: float, whole: bool) -> None:
        self.source, self.columns, self.largest, self.whole = table.headings.source, columns, largest, whole
        self.factors = np.array([c.factor for c in columns])
        self.time = next((i for i, c in enumerate(columns) if c.role == TIME), None)
        self.last = -math.inf
        self.begun: float | None = None
        self.n_rows = self.n_holes = 0
        self.steps = np.full(len(columns), math.inf)

    def numbers(self, piece: Piece) -> Array:
        """Complete rows of a piece, shape (rows, columns)."""
        self._check_numbers(piece)
        with np.errstate(over="ignore"):
            rows = piece.rows * self.factors
        self._check_size(rows, piece)
        holes = np.isnan(rows).any(axis=1)
        if self.time is not None:
            self._check_time(rows[:, self.time], piece)
        if self.n_rows < _LOOKED_AT:
            self._look(rows[~holes])
        self.n_rows += len(rows)
        self.n_holes += int(holes.sum())
        return rows[~holes]

    def _refused(self, piece: Piece, wrong: BoolArray, expected: str | Sequence[str]) -> None:
        """Refuse the first cell of those that are wrong; what was expected may depend on the column."""
        places = np.argwhere(wrong)
        if len(places):
            i, j = (int(k) for k in places[0])
            row, cell = piece.cell(i, j)
            wanted = expected if isinstance(expected, str) else expected[j]
            raise CaseError(self.source, f"{row}, {self.columns[j].role}", cell or Missing(), wanted)

    def _check_numbers(self, piece: Piece) -> None:
        self._refused(piece, np.isinf(piece.rows), "a finite number")
        if self.whole:
            self._refused(piece, np.isnan(piece.rows), "a finite number; a recording has no holes")

    def _check_size(self, rows: Array, piece: Piece) -> None:
        if self.time is not None and len(rows):
            # Stamps count from some day long ago: how large a time is says when the record begins, and nothing else.
            self.begun = float(rows[0, self.time]) if self.begun is None else self.begun
            rows = rows - self.begun * (np.arange(len(self.columns)) == self.time)
        expected = [f"an ordinary magnitude in the unit of {c.heading.text!r}" for c in self.columns]
        self._refused(piece, np.abs(rows) > self.largest, expected)

    def _check_time(self, times: Array, piece: Piece) -> None:
        """Times are there and grow from row to row."""
        steps = np.diff(times, prepend=self.last)
        wrong = np.flatnonzero(~(steps > 0))
        if wrong.size:
            i = int(wrong[0])
            row, cell = piece.cell(i, self.time or 0)
            backwards = "a later time than in the row before" + (
                ", not the same" if steps[i] == 0 else "; it runs backwards"
            )
            expected = "a time in every row" if math.isnan(times[i]) else backwards
            raise CaseError(self.source, f"{row}, time", cell or Missing(), expected)
        if times.size:
            self.last = float(times[-1])

    def _look(self, rows: Array) -> None:
        for j in range(rows.shape[1]):
            steps = np.diff(np.unique(rows[:_LOOKED_AT, j]))
            if steps.size:
                # What rounding leaves between equal readings is no step.
                steps = steps[steps > 1e-9 * np.ptp(rows[:, j])]
                self.steps[j] = min(self.steps[j], steps.min(initial=math.inf))

    def resolution(self) -> dict[str, float]:
        """Smallest step between readings; 0 where all are equal."""
        return {c.role: float(s) if math.isfinite(s) else 0.0 for c, s in zip(self.columns, self.steps, strict=True)}


class _Blocks:
    """Rows averaged in blocks; the blocks double whenever their number reaches twice the rows to keep."""

    def __init__(self, n_columns: int, kept: float) -> None:
        self.most, self.block = 2 * kept, 1
        self.full: list[Array] = []  # averaged blocks, in pieces as they came
        self.count = 0
        self.rest = np.empty((0, n_columns))

    def add(self, rows: Array) -> None:
        """Take in more rows."""
        rows = np.concatenate([self.rest, rows])
        while len(rows) >= self.block:
            n = int(min(len(rows) // self.block, self.most - self.count))
            self.full.append(rows[: n * self.block].reshape(n, self.block, -1).mean(axis=1))
            self.count += n
            rows = rows[n * self.block :]
            if self.count == self.most:
                self.full = [np.concatenate(self.full).reshape(self.count // 2, 2, -1).mean(axis=1)]
                self.count, self.block = self.count // 2, 2 * self.block
        self.rest = rows.copy()

    def rows(self) -> Array:
        """The blocks; what does not fill the last one makes a block of its own if it is at least half full."""
        last = [self.rest.mean(axis=0, keepdims=True)] if len(self.rest) >= max(1, self.block // 2) else []
        return np.concatenate([*self.full, *last, self.rest[:0]])
