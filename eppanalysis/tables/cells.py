"""What tables on the console are made of: an empty table, a number in a cell."""

from __future__ import annotations

import math
from typing import Any

from rich import box
from rich.table import Table

from eppanalysis.readable import number


def table_of(*columns: str, numbers: bool = True) -> Table:
    """An empty table; its columns after the first hold numbers, or texts."""
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    for i, name in enumerate(columns):
        table.add_column(name, justify="right" if numbers and i else "left", overflow="fold")
    return table


def is_number(value: Any) -> bool:
    """Whether it is written as a number."""
    return isinstance(value, int | float) and not isinstance(value, bool)


def cell(value: Any) -> str:
    """A number as people write it, a dash where there is none, or a text as it is."""
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return "-"
    return number(value) if is_number(value) else str(value)
