"""Results to files: tables as CSV or NetCDF, pictures; a file is complete or it is not there at all."""

from __future__ import annotations

import cmath
import csv
import math
import os
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from eppanalysis.errors import EppError, require_packages
from eppanalysis.methods.driven.result import FrequencyResponse
from eppanalysis.readable import with_unit
from eppanalysis.writing import at_once, atomic

if TYPE_CHECKING:
    import xarray
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from eppanalysis.diagnose.result import Diagnosis
    from eppanalysis.methods.comparison.ladder import Ladder
    from eppanalysis.methods.driven.result import ForcedResponse
    from eppanalysis.results import LimitCycle, Prediction, Trajectory

PICTURES = (".png", ".svg", ".pdf")
TABLES = (".csv", ".nc")
#: Most systems take 255 bytes; a file that is being written has some more letters in its name.
_LONGEST_NAME = 200
_Engine = Literal["h5netcdf", "netcdf4"]
_FORMULA_SIGNS = ("=", "+", "-", "@", "|", "＝", "＋", "－", "＠")
_INNER_FORMULA = re.compile(r"([;\t\r\n]\s*)(?=[-=+@|＝＋－＠])")


@dataclass(frozen=True, eq=False)
class Table:
    """Columns (sequences of equal length), with the unit of each where it has one."""

    columns: dict[str, Any]
    units: dict[str, str] = field(default_factory=dict)

    @classmethod
    def from_rows(cls, rows: Sequence[Mapping[str, Any]], units: Mapping[str, str] | None = None) -> Table:
        """Table with the columns of all rows, in the order of their first appearance; what is missing is None."""
        names = list(dict.fromkeys(name for row in rows for name in row))
        return cls({name: [row.get(name) for row in rows] for name in names}, dict(units or {}))

    def __len__(self) -> int:
        return max((len(column) for column in self.columns.values()), default=0)

    def header(self) -> list[str]:
        """Names of the columns with their units in brackets."""
        return [with_unit(name, self.units.get(name, "")) for name in self.columns]

    def to_dataset(self) -> xarray.Dataset:
        """The table as an xarray Dataset over ``row``; truth values become 1 and 0, what is missing becomes nan."""
        import xarray

        data = {name: ("row", _plain_column(column)) for name, column in self.columns.items()}
        dataset = xarray.Dataset(data)
        for name, unit in self.units.items():
            if name in dataset:
                dataset[name].attrs["units"] = str(unit)  # plain text, which a file takes
        return dataset


def join(tables: Sequence[tuple[str, Table]]) -> Table:
    """Tables of several cases below each other, with the name of the case in the first column."""
    rows = [
        {"case": case, **dict(zip(table.columns, values, strict=True))}
        for case, table in tables
        for values in zip(*table.columns.values(), strict=True)
    ]
    units: dict[str, str] = {}
    for _, table in tables:
        units.update(table.units)
    return Table.from_rows(rows, units)


def cycle_table(cycles: Sequence[LimitCycle]) -> Table:
    """One row a cycle: method, frequency, stability; mean, peak-to-peak and fundamental of every signal in SI units."""
    rows, units = [], {"frequency": "Hz", "period": "s"}
    for cycle in cycles:
        row: dict[str, Any] = {
            "method": cycle.method,
            "frequency": cycle.frequency,
            "period": cycle.period,
            "stable": cycle.stable,
            "error_estimate": cycle.error_estimate,
        }
        for name in cycle.mean:
            quantities = {
                f"mean {name}": cycle.mean[name],
                f"peak_to_peak {name}": cycle.peak_to_peak.get(name),
                f"fundamental amplitude {name}": cycle.amplitude(name) if name in cycle.harmonics else None,
            }
            row.update(quantities)
            units.update(dict.fromkeys(quantities, cycle.units.get(name, "")))
        rows.append(row)
    return Table.from_rows(rows, units)


def prediction_table(prediction: Prediction) -> Table:
    """The cycles of a prediction, one a row."""
    return cycle_table(prediction.cycles)


def trajectory_table(trajectory: Trajectory) -> Table:
    """The signals of a run, one column each, after the time."""
    return Table({"time": trajectory.t, **trajectory.signals}, {"time": "s", **trajectory.units})


def response_table(response: ForcedResponse | FrequencyResponse) -> Table:
    """Responses to one sine, or the points of all branches, one a row; complex gains as size and phase [rad]."""
    units: dict[str, str] = {"frequency": "Hz", "phase": "rad"}
    if isinstance(response, FrequencyResponse):
        units |= {"amplitude": response.units.get(response.input, "")}
        units |= {"peak_to_peak": response.units.get(response.output, "")}
        return Table.from_rows(response.to_frame().to_dict("records"), units)
    rows = []
    for one in response:
        row: dict[str, Any] = {"multiple": one.multiple, "stable": one.stable}
        for name, gain in one.responses.items():
            row |= {f"gain {name}": abs(gain), f"phase {name}": cmath.phase(gain)}
            row |= {f"peak_to_peak {name}": one.cycle.peak_to_peak[name]}
            units |= {f"phase {name}": "rad", f"peak_to_peak {name}": one.cycle.units.get(name, "")}
        rows.append(row)
    return Table.from_rows(rows, units)


def diagnosis_table(found: Diagnosis) -> Table:
    """The candidates of a diagnosis, one a row."""
    return Table.from_rows(found.to_frame().to_dict("records"), {"period": "s"})


def ladder_table(ladder: Ladder) -> Table:
    """The methods of a ladder, one a row, with the verdict beside each."""
    rows = [
        {
            "method": row.method,
            **row.quantities,
            "exact cycle": None if row.exact is None else row.exact + 1,
            "error of the period": row.errors.get("period"),
            "error of the peak-to-peak": row.errors.get("peak-to-peak"),
            "seconds": row.seconds,
            "note": row.note,
            "verdict": ladder.verdict,
        }
        for row in ladder.rows
    ]
    return Table.from_rows(rows, {**ladder.units, "seconds": "s"})


def check_target(
    path: Path, suffixes: Sequence[str] = PICTURES + TABLES, needed: Mapping[str, tuple[str, ...]] | None = None
) -> None:
    """Refuse a file that cannot be written, before anything is computed for it.

    Raises
    ------
    EppError
        If the suffix is not one of `suffixes`, the folder does not exist or is read-only, the path is a folder itself,
        its name is too long for a file, or modules that `needed` lists for the suffix are not installed.
    """
    if len(os.fsencode(path.name)) > _LONGEST_NAME:
        raise EppError(f"{path.name[:40]}...: is a name of {len(path.name)} letters; expected at most {_LONGEST_NAME}.")
    if path.suffix.lower() not in suffixes:
        found = f"cannot write a file that ends in {path.suffix!r}" if path.suffix else "its name has no ending"
        raise EppError(f"{path}: {found}; expected one of {', '.join(suffixes)}.")
    if not os.path.isdir(path.parent):
        raise EppError(f"{path}: the folder {str(path.parent)!r} does not exist; expected an existing one.")
    if os.path.isdir(path):
        raise EppError(f"{path}: is a folder; expected the name of a file.")
    if not os.access(os.path.dirname(os.path.realpath(path)), os.W_OK):
        raise EppError(f"{path}: cannot be written (its folder is read-only); expected a place to write to.")
    require_packages(f"{path}: the file", "tables", *(needed or {}).get(path.suffix.lower(), ()))


def write_result(result: Any, to_table: Callable[[Any], Table], path: Path, **options: Any) -> None:
    """Write a result as the picture, drawn with these options, or the table that the suffix of `path` names."""
    if path.suffix.lower() in PICTURES:
        write_figure(result.plot(**options), path)
    elif path.suffix.lower() == ".nc" and hasattr(result, "to_dataset"):
        write_dataset(result.to_dataset(), path)
    else:
        write_table(to_table(result), path)


def write_figure(picture: Figure | Axes, path: Path) -> None:
    """Write a picture, or the whole one that holds axes; its format is the suffix of `path`."""
    import matplotlib as mpl

    from eppanalysis.plotting import figure_of

    # Text stays text in SVG and PDF, and equal results give equal files.
    with (
        mpl.rc_context({"svg.fonttype": "none", "pdf.fonttype": 42, "svg.hashsalt": "eppanalysis"}),
        atomic(path) as part,
        at_once(part) as drawn,
    ):
        stamp = {".svg": {"Date": None}, ".pdf": {"CreationDate": None}}.get(path.suffix.lower())
        figure_of(picture).savefig(drawn, format=path.suffix[1:].lower(), dpi=200, metadata=stamp)


def write_table(table: Table, path: Path) -> None:
    """Write a table as CSV or NetCDF, by the suffix of `path`."""
    if path.suffix.lower() == ".nc":
        write_dataset(table.to_dataset(), path)
        return
    with atomic(path) as part, part.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream)
        writer.writerow([csv_cell(name) for name in table.header()])
        writer.writerows([csv_cell(value) for value in row] for row in zip(*table.columns.values(), strict=True))


def write_dataset(dataset: xarray.Dataset, path: Path) -> None:
    """Write a dataset as NetCDF (version 4 where h5netcdf and h5py, or netCDF4, are installed, else version 3).

    A slash separates groups there: in names, dots take its place.
    """
    from importlib.util import find_spec

    # Named, because xarray takes h5netcdf as soon as it is there, with or without the h5py that it needs.
    complete: tuple[tuple[_Engine, tuple[str, ...]], ...] = (
        ("h5netcdf", ("h5netcdf", "h5py")),
        ("netcdf4", ("netCDF4",)),
    )
    engines = [name for name, needed in complete if all(find_spec(module) for module in needed)]
    named = dataset.rename({name: str(name).replace("/", ".") for name in [*dataset.variables, *dataset.dims]})
    with atomic(path) as part:
        # In memory first, where that can be: on a full disk the library of NetCDF 4 takes the whole process with it.
        if engines[:1] == ["netcdf4"]:
            named.to_netcdf(part, engine="netcdf4")
        elif engines:
            with at_once(part) as held:
                named.to_netcdf(held, engine="h5netcdf")
        else:
            part.write_bytes(named.to_netcdf(engine="scipy"))


def csv_cell(value: Any) -> str:
    """A value as a table's cell: texts that a spreadsheet would take for a formula are marked as texts."""
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return ""
    if isinstance(value, bool):
        return "true" if value else "false"
    if not isinstance(value, str):
        return repr(value.item() if hasattr(value, "item") else value)
    # A spreadsheet runs a text that begins like a formula (after blanks too, and with the wide signs of East Asian
    # keyboards); a leading apostrophe makes it a text. Some split lines at semicolons and tabs as well.
    body = value.lstrip()
    begin = "'" * body.startswith(_FORMULA_SIGNS) + value[: len(value) - len(body)]
    return begin + _INNER_FORMULA.sub(r"\1'", body)


def _plain_column(column: Sequence[Any]) -> Any:
    import numpy as np

    if any(isinstance(value, str) for value in column):
        return np.array(["" if value is None else str(value) for value in column], dtype=object)
    return np.array([math.nan if value is None else float(value) for value in column])
