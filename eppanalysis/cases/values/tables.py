"""Tables of elements in CSV files: columns of numbers, with their units in the header; they become fields of a case."""

from __future__ import annotations

import csv
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from eppanalysis.cases.files import RawCase
from eppanalysis.errors import CaseError

_PATH = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.-]*(/[A-Za-z0-9_][A-Za-z0-9_.-]*)*")
_UNIT = re.compile(r"\[([^\[\]]*)\]\s*$")
_LARGEST_FILE, _MOST_ROWS = 5_000_000, 20_000
_WANTED = "the path of a CSV file within the case's folder, such as 'valve.csv'"


def read_columns(name: Any, columns: Sequence[str], field: str, raw: RawCase) -> dict[str, list[Any]]:
    """The first columns of a CSV file in a case's folder, as the lists that the case would have.

    Its first line may be a header; a unit in brackets there is that of its column.

    Parameters
    ----------
    name : Any
        What the case says: a path relative to its folder.
    columns : sequence of str
        What the columns are called in the case.
    field : str
        Field of the case that names the file.

    Raises
    ------
    CaseError
        If it is no such file, or a line has not as many numbers.
    """
    path = _found(name, field, raw)
    try:
        with path.open(newline="", encoding="utf-8-sig") as stream:
            lines = [(number, row) for number, row in enumerate(csv.reader(stream), start=1) if any(row)]
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        why = getattr(error, "strerror", None) or "no text in UTF-8"
        raise CaseError(str(name), "", why, "a CSV file that can be read") from None
    header, rows = _header(lines, len(columns))
    if not 0 < len(rows) <= _MOST_ROWS:
        raise CaseError(str(name), "", f"{len(rows)} rows of numbers", f"1 to {_MOST_ROWS}")
    units = [match[1].strip() if (match := _UNIT.search(cell)) else "" for cell in header]
    values = [_numbers(row, number, len(columns), str(name)) for number, row in rows]
    return {
        column: [f"{row[i]!r} {units[i]}" if units[i] else row[i] for row in values] for i, column in enumerate(columns)
    }


def _found(name: Any, field: str, raw: RawCase) -> Path:
    if not (isinstance(name, str) and len(name) <= 200 and _PATH.fullmatch(name)):
        raise raw.refused(field, _WANTED)
    path = raw.folder / name
    # A case from elsewhere must not read outside its folder, by a link either.
    if not path.is_file() or not path.resolve().is_relative_to(raw.folder.resolve()):
        raise raw.refused(field, _WANTED)
    if path.stat().st_size > _LARGEST_FILE:
        raise raw.refused(field, f"a file of at most {_LARGEST_FILE // 10**6} MB")
    return path


def _header(lines: list[tuple[int, list[str]]], count: int) -> tuple[list[str], list[tuple[int, list[str]]]]:
    """Cells of the header, empty ones where there is none, and the lines below it."""
    try:
        [float(cell) for cell in lines[0][1][:count]]
    except ValueError:
        return [*lines[0][1], *[""] * count][:count], lines[1:]
    except IndexError:
        pass
    return [""] * count, lines


def _numbers(row: list[str], line: int, count: int, source: str) -> list[float]:
    if len(row) < count:
        raise CaseError(source, f"line {line}", ",".join(row)[:60], f"{count} numbers")
    out = []
    for cell in row[:count]:
        try:
            out.append(float(cell))
        except ValueError:
            raise CaseError(source, f"line {line}", cell.strip()[:60], "a number") from None
    return out
