"""Rows of one kind, the modes or the guards of an automaton, held as columns.

A map of thousands of pieces has as many modes, of which a run visits a few: as columns they cost what their arrays
cost, and a row is made where it is requested.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields
from typing import Any, TypeVar, overload

import numpy as np
from numpy.typing import NDArray

from eppanalysis.errors import ModelError

Row = TypeVar("Row")
ByName = Mapping[str, NDArray[Any]]

#: Types of the columns by those of the fields; all others hold numbers.
_TYPES = {"bool": np.bool_, "int": np.int64}


class Columns(Sequence[Row]):
    """Rows of a dataclass whose first field is their name, as one array for each other field.

    Parameters
    ----------
    kind : type
        The dataclass.
    name : callable
        From the number of a row to its name.
    columns : mapping of str to array, shapes (rows, ...)
        The other fields.
    """

    def __init__(self, kind: type[Row], name: Callable[[int], str], columns: ByName) -> None:
        self.kind, self.name, self.columns = kind, name, columns

    @overload
    def __getitem__(self, i: int) -> Row: ...
    @overload
    def __getitem__(self, i: slice) -> Sequence[Row]: ...
    def __getitem__(self, i: int | slice) -> Row | Sequence[Row]:
        """A row, or some of them."""
        if isinstance(i, slice):
            return [self[k] for k in range(len(self))[i]]
        i = range(len(self))[i]
        values = {name: column[i].item() if column.ndim == 1 else column[i] for name, column in self.columns.items()}
        made: Any = self.kind
        row: Row = made(self.name(i), **values)
        return row

    def __len__(self) -> int:
        """Number of rows."""
        return len(next(iter(self.columns.values())))


def name_of(rows: Sequence[Any], i: int) -> str:
    """Name of a row, which is not made for it."""
    return rows.name(i) if isinstance(rows, Columns) else str(rows[i].name)


def in_columns(kind: type[Any], rows: Sequence[Any], shapes: Mapping[str, tuple[int, ...]]) -> ByName:
    """The fields of rows, but for their names, as one array each; `shapes` are those of the fields that are arrays."""
    if isinstance(rows, Columns):
        return rows.columns
    columns: dict[str, NDArray[Any]] = {}
    for field in fields(kind)[1:]:
        kept: Any = _TYPES.get(str(field.type), np.float64)
        values = np.array([getattr(row, field.name) for row in rows], kept)
        columns[field.name] = values.reshape(len(rows), *shapes.get(field.name, ()))
    return columns


def require_shapes(parts: Sequence[Any], shapes: Mapping[str, tuple[int, ...]]) -> None:
    """Refuse parts of an automaton with an array of another shape than theirs."""
    for name, expected in shapes.items():
        if isinstance(parts, Columns):
            every = [("all", parts.columns[name].shape[1:])]
        else:
            every = [(getattr(p, "name", getattr(p, "kind", "")), np.shape(getattr(p, name))) for p in parts]
        for label, found in every:
            if found != expected:
                raise ModelError(f"Automaton: {name} of {label!r} has shape {found}; expected {expected}.")
