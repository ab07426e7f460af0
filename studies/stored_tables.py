"""Tables that take long to make: rows of a dataclass, kept as CSV under ``_static``."""

from __future__ import annotations

import csv
from collections.abc import Callable, Sequence
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any, TypeVar, get_type_hints

import numpy as np

import eppanalysis as epp

Row = TypeVar("Row")

_PARSERS: dict[type, Callable[[str], Any]] = {str: str, int: int, float: float, bool: lambda text: text == "True"}


def write_rows(rows: Sequence[Any], kind: type, path: Path, script: str) -> None:
    """Rows to CSV, with a first line that says which script of this package they come from."""
    with path.open("w", newline="", encoding="utf-8") as stream:
        stream.write(
            f"# python -m studies.{Path(script).stem}, eppanalysis {epp.__version__}, numpy {np.__version__}\n"
        )
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow([f.name for f in fields(kind)])
        writer.writerows([f"{v:.6g}" if isinstance(v, float) else v for v in asdict(row).values()] for row in rows)


def read_rows(kind: type[Row], path: Path) -> list[Row]:
    """Rows of a stored table, each field as the type that the dataclass gives it."""
    types = get_type_hints(kind)
    parsers = {field.name: _PARSERS[types[field.name]] for field in fields(kind)}
    with path.open(encoding="utf-8") as stream:
        next(stream)
        return [kind(**{name: parse(d[name]) for name, parse in parsers.items()}) for d in csv.DictReader(stream)]
