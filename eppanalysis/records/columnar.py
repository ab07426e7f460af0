"""Parquet files, read a block of rows at a time."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from eppanalysis.records.columns import TIME, Column, Heading, Headings
from eppanalysis.records.formats import readable_as
from eppanalysis.records.memory import seconds
from eppanalysis.records.tables import Piece, numbered

if TYPE_CHECKING:
    import pyarrow

#: Rows that are read at a time.
_PIECE = 100_000


class Parquet:
    """A Parquet file: columns of numbers.

    A unit is in the metadata of its column ("unit" or "units"), in the attributes of a data frame that pandas wrote, or
    in brackets behind the name. Dates or durations are the time where no column is called so.
    """

    def __init__(self, path: Path, source: str) -> None:
        import pyarrow.parquet
        import pyarrow.types as types

        self.file, self.source, self.notes = pyarrow.parquet.ParquetFile(path), source, list[str]()
        self.size = self.file.metadata.num_rows
        schema = self.file.schema_arrow
        stamped = {f.name for f in schema if types.is_timestamp(f.type) or types.is_duration(f.type)}
        self.names = [
            f.name
            for f in schema
            if f.name in stamped or types.is_integer(f.type) or types.is_floating(f.type) or types.is_boolean(f.type)
        ]
        units = _units(schema)
        headings = [Heading.of(name, units.get(name, "")) for name in self.names]
        named = any(heading.name.lower() == TIME for heading in headings)
        for i, heading in enumerate(headings):
            if self.names[i] in stamped:
                is_time = heading.name.lower() == TIME or not named
                headings[i] = Heading(TIME if is_time else heading.name, "s", heading.text)
                named = True
        self.headings = Headings(source, headings, "", True)

    def pieces(self, columns: Sequence[Column]) -> Iterator[Piece]:
        """Rows of some columns, many thousands at a time."""
        names, done = [self.names[c.place] for c in columns], 0
        first: dict[str, Any] = {}
        with readable_as(self.source, "a Parquet file"):
            for batch in self.file.iter_batches(_PIECE, columns=list(dict.fromkeys(names))):
                found = []
                for name in names:
                    values = batch.column(name).to_pandas()
                    if len(values):
                        first.setdefault(name, values.iloc[0])
                    found.append(np.asarray(seconds(values, first.get(name)), float))
                rows = np.column_stack(found)
                yield Piece(rows, numbered(rows, done), done + len(rows))
                done += len(rows)


def _units(schema: pyarrow.Schema) -> Mapping[str, str]:
    """Units of columns that a file has beside their names."""
    found: dict[str, str] = {}
    attributes = json.loads((schema.metadata or {}).get(b"PANDAS_ATTRS", b"{}"))
    if isinstance(attributes, Mapping) and isinstance(attributes.get("units"), Mapping):
        found = {str(name): str(unit) for name, unit in attributes["units"].items()}
    for column in schema:
        own = column.metadata or {}
        unit = own.get(b"unit") or own.get(b"units")
        if unit:
            found[column.name] = unit.decode()
    return found
