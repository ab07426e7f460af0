"""CSV files: one line a row under a line of headings, in bounded memory whatever their length."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import BinaryIO

import numpy as np

from eppanalysis.arrays import Array
from eppanalysis.errors import CaseError
from eppanalysis.records.columns import Column, Heading, Headings
from eppanalysis.records.tables import Piece

#: Bytes read at a time; longest line.
PIECE, LONGEST_LINE = 4_000_000, 100_000
_SEPARATORS = ",;\t"


class Text:
    """A CSV file.

    The first line names the columns with their units, as in ``time [s],force [lbf],voltage [V]``; lines before it that
    begin with ``#`` are skipped. Cells are separated by commas, semicolons or tabs. An empty cell is a missing sample.

    Parameters
    ----------
    header : str
        What the line of headings may be, for messages.
    has_si : bool
        Whether a column without a unit is in SI units.

    Raises
    ------
    CaseError
        If it has no such line.
    """

    def __init__(self, path: Path, source: str, header: str, has_si: bool) -> None:
        self.path, self.source, self.size = path, source, path.stat().st_size
        self.notes: list[str] = []
        with path.open("rb") as stream:
            cells, self.separator, self.line = self._header(stream, header)
            self.begin = stream.tell()
        self.n_cells = len(cells)
        self.headings = Headings(source, [Heading.of(cell) for cell in cells], f"line {self.line}", has_si)

    def pieces(self, columns: Sequence[Column]) -> Iterator[Piece]:
        """Rows of some columns, some millions of bytes at a time."""
        line = self.line
        with self.path.open("rb") as stream:
            stream.seek(self.begin)
            for raw in self._pieces(stream):
                text = self._text(raw)
                # Where semicolons or tabs separate the cells a comma can only be the decimal point.
                rows = self._fast(raw if self.separator == "," else raw.replace(b",", b"."), columns)
                if rows is None:
                    rows = self._slow(text, line, columns)

                def cell(i: int, j: int, text: str = text, line: int = line) -> tuple[str, str]:
                    number, cells = next(found for k, found in enumerate(self._lines(text, line)) if k == i)
                    return f"line {number}", cells[columns[j].place].strip()

                yield Piece(rows, cell, stream.tell())
                line += raw.count(b"\n")

    def _header(self, stream: BinaryIO, wanted: str) -> tuple[list[str], str, int]:
        """Cells of the header, the separator, and the number of the header's line."""
        number = 0
        while True:
            raw = stream.readline(LONGEST_LINE)
            number += 1
            if not raw:
                raise CaseError(self.source, "", "empty", f"{wanted}, and rows of numbers")
            text = self._text(raw).lstrip("\ufeff") if number == 1 else self._text(raw)
            if len(raw) >= LONGEST_LINE:
                raise self._too_long(f"line {number}", "longer than")
            if text.strip() and not text.startswith("#"):
                break
        if "\r" in text.strip("\r\n"):
            found = "ended by a carriage return alone"
            raise CaseError(self.source, f"line {number}", found, "lines that end in a line feed")
        separator = max(_SEPARATORS, key=text.count)
        try:
            cells = next(csv.reader([text.strip("\r\n")], delimiter=separator))
        except csv.Error as error:
            raise CaseError(self.source, f"line {number}", str(error), "a header of names with units") from None
        if all(_number(cell) is not None for cell in cells):
            raise CaseError(self.source, f"line {number}", text.strip(), wanted)
        return cells, separator, number

    def _too_long(self, field: str, longer: str) -> CaseError:
        return CaseError(self.source, field, f"{longer} {LONGEST_LINE} characters", "rows of numbers, one a line")

    def _text(self, raw: bytes) -> str:
        """Text of bytes that must be UTF-8 without control characters."""
        if b"\0" in raw:
            raise CaseError(self.source, "", "binary (it holds zero bytes)", "a CSV file in UTF-8")
        try:
            return raw.decode("utf-8")
        except UnicodeDecodeError as error:
            shown = f"not UTF-8 (byte {raw[error.start : error.start + 1]!r})"
            expected = "a CSV file in UTF-8; save it again in that encoding"
            raise CaseError(self.source, "", shown, expected) from None

    def _pieces(self, stream: BinaryIO) -> Iterator[bytes]:
        """The rest of a file in pieces that end where a line ends."""
        rest = b""
        while fresh := stream.read(PIECE):
            rest += fresh
            cut = rest.rfind(b"\n") + 1
            if cut:
                yield rest[:cut]
                rest = rest[cut:]
            if len(rest) > LONGEST_LINE:
                self._text(rest[:LONGEST_LINE])
                raise self._too_long("", "a line longer than")
        if rest:
            yield rest

    def _fast(self, piece: bytes, columns: Sequence[Column]) -> Array | None:
        """All rows at once, where every cell is a number or empty; nan where it is empty."""
        import pandas

        places = [c.place for c in columns]
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

    def _slow(self, text: str, line: int, columns: Sequence[Column]) -> Array:
        """Row by row: finds what is wrong, or reads what only the fast way stumbles over (quotation marks)."""
        rows = []
        for number, cells in self._lines(text, line):
            if len(cells) != self.n_cells:
                shown = f"{len(cells)} cell{'' if len(cells) == 1 else 's'} long"
                raise CaseError(self.source, f"line {number}", shown, f"{self.n_cells} cells, as in the header")
            rows.append([self._cell(cells[c.place].strip(), c, number) for c in columns])
        return np.array(rows, float).reshape(-1, len(columns))

    def _lines(self, text: str, line: int) -> Iterator[tuple[int, list[str]]]:
        """Numbers and cells of the rows that are not blank."""
        for number, row in enumerate(text.splitlines(), start=line + 1):
            if not row.strip():
                continue
            try:
                cells = next(csv.reader([row], delimiter=self.separator, strict=True))
            except csv.Error as error:
                expected = "cells with closed quotation marks"
                raise CaseError(self.source, f"line {number}", str(error), expected) from None
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


def _number(cell: str) -> float | None:
    try:
        return float(cell)
    except ValueError:
        return None
