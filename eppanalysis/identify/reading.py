"""Measured CSV files to arrays in SI units, in bounded memory whatever their length.

A file is read in pieces. Rows beyond some ten thousand are averaged in blocks of equal numbers of rows, so that every
row counts and none is kept. Anything that is not a plain table of numbers is one sentence with its line.
"""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import BinaryIO

import numpy as np

from eppanalysis.arrays import Array
from eppanalysis.cases.files import Missing
from eppanalysis.errors import CaseError, did_you_mean
from eppanalysis.identify.columns import ROLES, Column, Role, find_columns
from eppanalysis.progress import Progress

#: Called with the bytes read so far and the size of the file.

#: Rows that are kept at least, once blocks are averaged; bytes read at a time; longest line; largest magnitude (SI).
KEPT, PIECE, LONGEST_LINE, LARGEST = 16_384, 4_000_000, 100_000, 1e9
_SEPARATORS = ",;\t"
_HEADER_WANTED = "a header such as 'time [s],force [lbf],voltage [V]'"
#: Rows from which the smallest step between readings is taken.
_LOOKED_AT = 100_000


@dataclass(frozen=True, eq=False)
class Recording:
    """Columns of a file."""

    source: str  # the file, as the user gave it
    columns: dict[str, Array]  # (n,): by role, in SI units; "time" counts rows where the file has no times
    #: n_rows, n_holes: rows in the file; those left out because a cell is empty.
    n_rows: int
    n_holes: int
    block: int  # rows that were averaged into one
    resolution: dict[str, float]  # smallest step between different readings of a column, in SI units
    timed: bool  # whether the file has times
    unused: tuple[str, ...] = ()  # headers of the other columns
    header: tuple[str, ...] = ()  # of all columns, as typed

    def __len__(self) -> int:
        return len(self.columns[Role.TIME])

    def __getitem__(self, role: str) -> Array:
        return self.columns[role]

    def __contains__(self, role: str) -> bool:
        return role in self.columns

    def sentences(self) -> list[str]:
        """What happened to the rows."""
        out = [f"Columns that were not used: {', '.join(self.unused)}."] if self.unused else []
        if self.n_holes:
            have, were = ("has", "was") if self.n_holes == 1 else ("have", "were")
            out.append(f"{self.n_holes} of {self.n_rows} rows {have} an empty cell and {were} left out.")
        if self.block > 1:
            out.append(f"{self.n_rows} rows were averaged in blocks of {self.block}.")
        return out


def read_recording(
    path: str | Path,
    needed: Sequence[str],
    optional: Sequence[str] = (),
    columns: Mapping[str, tuple[str, str]] | None = None,
    *,
    fewest: int = 8,
    progress: Progress | None = None,
    units: Mapping[str, str] = ROLES,
) -> Recording:
    """Read the columns of a CSV file that a bench needs.

    The first line names the columns with their units, as in ``time [s],force [lbf],voltage [V]``; lines before it that
    begin with ``#`` are skipped. Cells are separated by commas, semicolons or tabs. An empty cell is a missing sample.

    Parameters
    ----------
    needed, optional : sequence of str
        Roles of columns; "time" among the optional ones gives row numbers where the file has no times.
    columns : mapping of str to (str, str), optional
        Header and unit of a role where its header is not its name.
    fewest : int
        A file with fewer complete rows is refused.
    units : mapping of str to str
        SI unit of every role; those of the benches by default.

    Raises
    ------
    CaseError
        If the file is no such table: one sentence with line, column, what is there and what was expected.
    """
    path, source = Path(path), str(path)
    try:
        if not path.is_file():
            found = "a folder" if path.is_dir() else "not a file" if path.exists() else Missing()
            raise CaseError(source, "", found, "a CSV file")
        with path.open("rb") as stream:
            find = partial(find_columns, needed=needed, optional=optional, choices=columns or {}, units=units)
            return _read(stream, source, find, fewest, progress, path.stat().st_size)
    except (OSError, ValueError) as error:
        raise CaseError(source, "", getattr(error, "strerror", None) or str(error), "a readable CSV file") from None


def _read(
    stream: BinaryIO,
    source: str,
    find: Callable[..., tuple[Column, ...]],
    fewest: int,
    progress: Progress | None,
    size: int,
) -> Recording:
    header, separator, line = _header(stream, source)
    found = find(header, source=source)
    table = _Table(source, len(header), separator, found)
    blocks = _Blocks(len(found))
    for piece in _pieces(stream, source):
        blocks.add(table.numbers(piece, line))
        line += piece.count(b"\n")
        if progress is not None:
            progress(stream.tell(), size, "")
    complete = table.n_rows - table.n_holes
    if complete < fewest or complete < table.n_rows / 2:
        shown = f"{table.n_rows} row{'s' * (table.n_rows != 1)} long" + (
            f", {table.n_holes} of them with empty cells" if table.n_holes else ""
        )
        raise CaseError(
            source, "", shown, f"{fewest} or more complete rows under the header, and holes in fewer than half"
        )
    rows = blocks.rows()
    columns = {c.role: rows[:, i].copy() for i, c in enumerate(found)}
    timed = Role.TIME in columns
    if not timed:
        columns[Role.TIME] = np.arange(float(len(rows)))
    unused = tuple(cell.strip() for i, cell in enumerate(header) if i not in {c.place for c in found})
    return Recording(
        source, columns, table.n_rows, table.n_holes, blocks.block, table.resolution(), timed, unused,
        tuple(cell.strip() for cell in header),
    )  # fmt: skip


def read_signals(
    path: str | Path,
    signals: Sequence[str],
    units: Mapping[str, str],
    columns: Mapping[str, tuple[str, str]] | None = None,
    *,
    fewest: int = 8,
    progress: Progress | None = None,
) -> Recording:
    """Read times and whatever columns a CSV file has of the named signals.

    Parameters
    ----------
    signals : sequence of str
        Names of which the file has one or more.
    units : mapping of str to str
        SI unit of everything that may be read: of the signals, and of others that may stand beside them.
    columns, fewest, progress
        As for :func:`read_recording`.

    Raises
    ------
    CaseError
        If the file is no such table, or holds none of the signals.
    """
    others = tuple(name for name in units if name != Role.TIME)
    units = {**units, Role.TIME: "s"}
    found = read_recording(path, (Role.TIME,), others, columns, fewest=fewest, progress=progress, units=units)
    if not any(name in found for name in signals):
        shown = ", ".join(found.header)
        hint = did_you_mean(found.unused[0].partition("[")[0].strip() if found.unused else "", signals)
        raise CaseError(found.source, "line 1", shown, f"a column of a signal of the loop: {hint}")
    return found


def _header(stream: BinaryIO, source: str) -> tuple[list[str], str, int]:
    """Cells of the header, the separator, and the number of the header's line."""
    number = 0
    while True:
        raw = stream.readline(LONGEST_LINE)
        number += 1
        if not raw:
            raise CaseError(source, "", "empty", f"{_HEADER_WANTED}, and rows of numbers")
        text = _text(raw, source).lstrip("\ufeff") if number == 1 else _text(raw, source)
        if len(raw) >= LONGEST_LINE:
            raise _too_long(source, number)
        if text.strip() and not text.startswith("#"):
            break
    if "\r" in text.strip("\r\n"):
        raise CaseError(source, f"line {number}", "ended by a carriage return alone", "lines that end in a line feed")
    separator = max(_SEPARATORS, key=text.count)
    try:
        cells = next(csv.reader([text.strip("\r\n")], delimiter=separator))
    except csv.Error as error:
        raise CaseError(source, f"line {number}", str(error), "a header of names with units") from None
    if all(_number(cell) is not None for cell in cells):
        raise CaseError(source, f"line {number}", text.strip(), _HEADER_WANTED)
    return cells, separator, number


def _too_long(source: str, line: int) -> CaseError:
    return CaseError(source, f"line {line}", f"longer than {LONGEST_LINE} characters", "rows of numbers, one a line")


def _text(raw: bytes, source: str) -> str:
    """Text of bytes that must be UTF-8 without control characters."""
    if b"\0" in raw:
        raise CaseError(source, "", "binary (it holds zero bytes)", "a CSV file in UTF-8")
    try:
        return raw.decode("utf-8")
    except UnicodeDecodeError as error:
        shown = f"not UTF-8 (byte {raw[error.start : error.start + 1]!r})"
        raise CaseError(source, "", shown, "a CSV file in UTF-8; save it again in that encoding") from None


def _pieces(stream: BinaryIO, source: str) -> Iterator[bytes]:
    """The rest of a file in pieces that end where a line ends."""
    rest = b""
    while True:
        fresh = stream.read(PIECE)
        if not fresh:
            break
        rest += fresh
        cut = rest.rfind(b"\n") + 1
        if cut:
            yield rest[:cut]
            rest = rest[cut:]
        if len(rest) > LONGEST_LINE:
            _text(rest[:LONGEST_LINE], source)
            raise CaseError(source, "", f"a line longer than {LONGEST_LINE} characters", "rows of numbers, one a line")
    if rest:
        yield rest


def _number(cell: str) -> float | None:
    try:
        return float(cell)
    except ValueError:
        return None


class _Table:
    """Pieces of text to rows of numbers in SI units, with what must hold from one piece to the next."""

    def __init__(self, source: str, n_cells: int, separator: str, columns: Sequence[Column]) -> None:
        self.source, self.n_cells, self.separator, self.columns = source, n_cells, separator, columns
        self.factors = np.array([c.factor for c in columns])
        self.time = next((i for i, c in enumerate(columns) if c.role == Role.TIME), None)
        self.last = -math.inf
        self.begun: float | None = None
        self.n_rows = self.n_holes = 0
        self.steps = np.full(len(columns), math.inf)

    def numbers(self, piece: bytes, line: int) -> Array:
        """Complete rows of a piece whose first line is number ``line + 1``, shape (rows, columns)."""
        text = _text(piece, self.source)
        # Where semicolons or tabs separate the cells a comma can only stand for the decimal point.
        rows = self._fast(piece if self.separator == "," else piece.replace(b",", b"."))
        if rows is None:
            rows = self._slow(text, line)
        rows = rows * self.factors
        self._check_size(rows, text, line)
        holes = np.isnan(rows).any(axis=1)
        if self.time is not None:
            self._check_time(rows[:, self.time], text, line)
        if self.n_rows < _LOOKED_AT:
            self._look(rows[~holes])
        self.n_rows += len(rows)
        self.n_holes += int(holes.sum())
        return rows[~holes]

    def _fast(self, piece: bytes) -> Array | None:
        """All rows at once, where every cell is a number or empty; nan where it is empty."""
        import pandas

        places = [c.place for c in self.columns]
        try:
            frame = pandas.read_csv(
                io.BytesIO(piece),
                sep=self.separator,
                header=None,
                names=list(range(self.n_cells)),
                usecols=places,
                dtype=np.float64,
                na_values=[""],
                keep_default_na=False,
                quoting=csv.QUOTE_NONE,
                index_col=False,
            )
        except (ValueError, OverflowError, MemoryError):
            return None
        rows = frame[places].to_numpy(np.float64)
        # pandas fills short rows up; the number of separators gives them away.
        complete = piece.count(self.separator.encode()) == len(rows) * (self.n_cells - 1)
        return rows if complete and not np.isinf(rows).any() else None

    def _slow(self, text: str, line: int) -> Array:
        """Row by row: finds what is wrong, or reads what only the fast way stumbles over (quotation marks)."""
        rows = []
        for number, cells in self._lines(text, line):
            if len(cells) != self.n_cells:
                shown = f"{len(cells)} cell{'' if len(cells) == 1 else 's'} long"
                raise CaseError(self.source, f"line {number}", shown, f"{self.n_cells} cells, as in the header")
            rows.append([self._cell(cells[c.place].strip(), c, number) for c in self.columns])
        return np.array(rows, float).reshape(-1, len(self.columns))

    def _lines(self, text: str, line: int) -> Iterator[tuple[int, list[str]]]:
        for number, row in enumerate(text.splitlines(), start=line + 1):
            if not row.strip():
                continue
            try:
                cells = next(csv.reader([row], delimiter=self.separator, strict=True))
            except csv.Error as error:
                raise CaseError(
                    self.source, f"line {number}", str(error), "cells with closed quotation marks"
                ) from None
            yield number, cells

    def _cell(self, cell: str, column: Column, number: int) -> float:
        if not cell:
            return math.nan
        value = _number(cell if self.separator == "," else cell.replace(",", "."))
        if value is None or not math.isfinite(value):
            missing = value is not None and math.isnan(value)
            wanted = "a finite number; leave the cell empty where a sample is missing" if missing else "a finite number"
            raise CaseError(self.source, f"line {number}, {column.role}", cell, wanted)
        return value

    def _check_size(self, rows: Array, text: str, line: int) -> None:
        if self.time is not None and len(rows):
            # Stamps count from some day long ago: how large a time is says when the record begins, and nothing else.
            self.begun = float(rows[0, self.time]) if self.begun is None else self.begun
            rows = rows - self.begun * (np.arange(len(self.columns)) == self.time)
        wrong = np.argwhere(np.abs(rows) > LARGEST)
        if len(wrong):
            i, j = (int(k) for k in wrong[0])
            number, cells = self._line_of(text, line, i)
            column = self.columns[j]
            expected = f"an ordinary magnitude in the unit of {column.header.strip()!r}"
            raise CaseError(self.source, f"line {number}, {column.role}", cells[column.place].strip(), expected)

    def _check_time(self, times: Array, text: str, line: int) -> None:
        """Times are there and grow from row to row."""
        steps = np.diff(times, prepend=self.last)
        wrong = np.flatnonzero(~(steps > 0))
        if wrong.size:
            i = int(wrong[0])
            number, cells = self._line_of(text, line, i)
            place = self.columns[self.time or 0].place
            backwards = "a later time than in the row before" + (
                ", not the same" if steps[i] == 0 else "; it runs backwards"
            )
            expected = "a time in every row" if math.isnan(times[i]) else backwards
            raise CaseError(self.source, f"line {number}, time", cells[place].strip() or Missing(), expected)
        if times.size:
            self.last = float(times[-1])

    def _line_of(self, text: str, line: int, row: int) -> tuple[int, list[str]]:
        """Number and cells of a row that is not blank."""
        for i, found in enumerate(self._lines(text, line)):
            if i == row:
                return found
        raise IndexError(row)

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

    def __init__(self, n_columns: int) -> None:
        self.kept = np.empty((2 * KEPT, n_columns))
        self.count, self.block = 0, 1
        self.rest = np.empty((0, n_columns))

    def add(self, rows: Array) -> None:
        """Take in more rows."""
        rows = np.concatenate([self.rest, rows])
        at = 0
        while len(rows) - at >= self.block:
            n = min((len(rows) - at) // self.block, 2 * KEPT - self.count)
            taken = rows[at : at + n * self.block]
            self.kept[self.count : self.count + n] = taken.reshape(n, self.block, -1).mean(axis=1)
            self.count += n
            at += n * self.block
            if self.count == 2 * KEPT:
                self.kept[:KEPT] = self.kept.reshape(KEPT, 2, -1).mean(axis=1)
                self.count, self.block = KEPT, 2 * self.block
        self.rest = rows[at:].copy()

    def rows(self) -> Array:
        """The blocks; what does not fill the last one makes a block of its own if it is at least half full."""
        rows = self.kept[: self.count]
        if len(self.rest) >= max(1, self.block // 2):
            rows = np.concatenate([rows, self.rest.mean(axis=0, keepdims=True)])
        return rows
