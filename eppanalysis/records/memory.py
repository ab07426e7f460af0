"""Tables in memory: arrays by name, pandas data frames, xarray datasets and arrays."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from eppanalysis.errors import CaseError
from eppanalysis.records.columns import TIME, Heading
from eppanalysis.records.tables import Group, Groups

if TYPE_CHECKING:
    import pandas
    import xarray

SOURCE = "record"


def group(headings: Sequence[Heading], time: ArrayLike | None, values: Sequence[ArrayLike], name: str = "") -> Group:
    """Signals that lie in memory; a name is put before theirs."""
    named = [Heading(f"{name}.{h.name}", h.unit, f"{name}.{h.text}") for h in headings] if name else headings
    return Group(named, lambda places: (time, [values[i] for i in places]))


def mapping(given: Mapping[str, ArrayLike]) -> Groups:
    """Arrays by name, "time" among them; a unit may be behind a name, in brackets."""
    return _table([Heading.of(str(name)) for name in given], list(given.values()))


def frame(given: pandas.DataFrame) -> Groups:
    """A data frame with a column "time", or with times as its index; ``attrs["units"]`` may have units by column."""
    own = given.attrs.get("units", {})
    units = own if isinstance(own, Mapping) else {}
    headings = [Heading.of(str(name), str(units.get(name, ""))) for name in given.columns]
    values: list[Any] = [given.iloc[:, i] for i in range(len(headings))]
    index = given.index
    if index.name is not None or index.dtype.kind in "Mm":
        name = "" if index.name is None else str(index.name)
        heading = Heading.of(name, str(units.get(index.name, "")))
        if index.dtype.kind in "Mm" or heading.name.lower() == TIME:
            headings, values = [Heading(TIME, heading.unit, name or TIME), *headings], [index, *values]
    return _table(headings, values)


def dataset(given: xarray.Dataset | xarray.DataArray) -> Groups:
    """A dataset, or an array, with a coordinate "time"; ``attrs["units"]`` of each variable is its unit.

    Raises
    ------
    CaseError
        If it has no times.
    """
    if not hasattr(given, "data_vars"):
        others = [str(d) for d in given.dims if d != TIME]
        labelled = len(others) == 1 and others[0] in given.coords
        given = given.to_dataset(dim=others[0]) if labelled else given.to_dataset(name=given.name or "value")
    if TIME not in given.coords:
        raise CaseError(SOURCE, "", f"with coordinates {', '.join(map(str, given.coords)) or 'none'}", f"one {TIME!r}")
    found = [(TIME, given.coords[TIME]), *((n, v) for n, v in given.data_vars.items() if v.dims == (TIME,))]
    headings = [Heading.of(str(name), str(value.attrs.get("units", ""))) for name, value in found]
    return _table(headings, [value.values for _, value in found])


def seconds(values: Any, first: Any = None) -> Any:
    """Dates and durations as seconds from the first of them, or from another; anything else as it is."""
    if getattr(getattr(values, "dtype", None), "kind", "") not in ("M", "m"):
        return values
    import pandas

    index = pandas.Index(values)
    begin = (index[0] if len(index) else None) if first is None else first
    return np.asarray((index - begin).total_seconds(), float) if len(index) else np.empty(0)


def _table(headings: Sequence[Heading], values: Sequence[Any]) -> Groups:
    """One group, whose first column "time" is its time."""
    at = next((i for i, heading in enumerate(headings) if heading.name.lower() == TIME), None)
    times, time = None, None
    if at is not None:
        times = seconds(values[at])
        # Dates and durations have their unit in them.
        time = headings[at] if times is values[at] else Heading(TIME, "s", headings[at].text)
    rest = [i for i in range(len(headings)) if i != at]
    return Groups(SOURCE, [group([headings[i] for i in rest], times, [values[i] for i in rest])], time)
