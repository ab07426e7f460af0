"""Measured frequency responses in CSV files: columns by name, units in the header; to SI at this border.

A file is data: reading it runs no code. The first line names the columns, each with its unit in brackets where it has
one; below are numbers, one frequency a row.
"""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from eppanalysis.arguments import checked
from eppanalysis.arrays import Array, ComplexArray
from eppanalysis.cases.files import own_or_shipped
from eppanalysis.errors import CaseError, ModelError
from eppanalysis.models.systems.measured.matrix import MeasuredMatrix
from eppanalysis.models.systems.measured.response import MeasuredResponse
from eppanalysis.units import QuantityError, parse_any, parse_quantity

_LARGEST_FILE, _MOST_ROWS = 50_000_000, 100_000
_HEADER = re.compile(r"\s*(.*?)\s*(?:\[([^\[\]]*)\]|\(([^()]*)\))?\s*", re.DOTALL)
_WANTED = "a header such as 'frequency [Hz],magnitude [dB],phase [deg]'"
_PAIRS = (("magnitude", "phase"), ("real", "imaginary"))
_PLACED = re.compile(r"(.*\S)\s+(\d{1,3})/(\d{1,3})")
_MOST_PORTS = 100
#: Columns that all paths may share.
_SHARED = {"frequency", "deviation"}
_COLUMNS = ("frequency", "magnitude", "phase", "real", "imaginary", "deviation")


@checked
def read_response(
    path: str | Path, static_gain: ArrayLike | None = None, unstable_poles: int = 0
) -> MeasuredResponse | MeasuredMatrix:
    """Measured frequency response of a CSV file.

    Columns are "frequency" [Hz, rad/s or any unit of either]; "magnitude" ([dB], or a unit of output over input) and
    "phase" [deg, rad], or "real" and "imaginary"; and, where it is known, "deviation" ([%], or a plain share of the
    magnitude): the standard deviation of real and imaginary part. Rows are in any order; a row at frequency zero is
    the static gain. Separators are commas, semicolons or tabs; beside the latter two a decimal comma will do.

    Of several inputs and outputs each path has columns of its own: "magnitude 2/1" and "phase 2/1" are output 2 over
    input 1. A path without columns does not exist.

    Parameters
    ----------
    path : str or Path
        A plain name that is not a file here is one of those that ship.
    static_gain : float, or array_like of the matrix's shape, optional
        Response at frequency zero [SI], where the file has none; infinite for a part that integrates.
    unstable_poles : int
        How many poles of the part lie right of the imaginary axis.

    Returns
    -------
    MeasuredResponse or MeasuredMatrix
        In SI units, with the name of the file; a matrix where columns name their paths.

    Raises
    ------
    CaseError
        If it cannot be read, a column or a unit is missing or twice there, or a cell is no number.
    ModelError
        If the points make no response (see :class:`MeasuredResponse`).

    Examples
    --------
    >>> import eppanalysis as epp
    >>> response = epp.read_response("frequency_response.csv")
    >>> response
    Frequency response at 301 frequencies from 0.1257 to 125.7 rad/s, standard
    deviation 1 %.
    """
    path = own_or_shipped(Path(path))
    source = str(path)
    header, rows = _rows(path, source)
    split = [_split(cell, source) for cell in header]
    if len({(name, place) for name, place, _ in split}) < len(header):
        raise CaseError(source, "line 1", ", ".join(header), "each column once")
    places = sorted({place for name, place, _ in split if place and name not in _SHARED})
    shared = {name: (i, unit) for i, (name, place, unit) in enumerate(split) if not place}
    if places and shared.keys() - _SHARED:
        raise CaseError(source, "line 1", ", ".join(header), "a path such as 2/1 at each of them, or at none")
    gains = np.asarray(np.nan if static_gain is None else static_gain, float)
    if not places:
        if gains.ndim:
            raise CaseError(source, "static_gain", str(static_gain), "one number: the file has one path")
        return _response(shared, rows, source, path.name, float(gains), unstable_poles)
    shape = max(i for i, _ in places), max(j for _, j in places)
    if gains.ndim and gains.shape != shape:
        raise CaseError(source, "static_gain", str(static_gain), f"numbers of shape {shape}")
    gains = np.broadcast_to(gains, shape)
    paths: list[list[MeasuredResponse | None]] = [[None] * shape[1] for _ in range(shape[0])]
    for i, j in places:
        own = {name: (k, unit) for k, (name, place, unit) in enumerate(split) if place == (i, j)}
        gain, label = float(gains[i - 1, j - 1]), f"{path.name} {i}/{j}"
        paths[i - 1][j - 1] = _response(shared | own, rows, source, label, gain, unstable_poles)
    return MeasuredMatrix(paths, path.name)


def _response(
    columns: dict[str, tuple[int, str]], rows: Array, source: str, name: str, gain: float, unstable_poles: int
) -> MeasuredResponse:
    """The response of one path; a gain that is not a number is that of the row at rest."""
    value = _values(columns, rows, source)
    omega = rows[:, columns["frequency"][0]] * _frequency_unit(columns["frequency"][1], source)
    deviation = rows[:, columns["deviation"][0]] * _share(columns, source) if "deviation" in columns else None
    order = np.argsort(omega, kind="stable")
    omega, value = omega[order], value[order]
    deviation = None if deviation is None else deviation[order]
    at_rest = omega == 0.0
    if np.any(at_rest) and np.isnan(gain):
        gain = float(value[at_rest][0].real)
    static_gain = None if np.isnan(gain) else gain
    try:
        kept = None if deviation is None else deviation[~at_rest]
        return MeasuredResponse(omega[~at_rest], value[~at_rest], kept, static_gain, unstable_poles, name)
    except ModelError as error:
        raise ModelError(
            f"{source}: {error.what.removeprefix('MeasuredResponse: ')}", expected=error.expected
        ) from None


def _rows(path: Path, source: str) -> tuple[list[str], Array]:
    """Header and numbers of a file."""
    try:
        size = path.stat().st_size
        text = path.read_text(encoding="utf-8-sig") if size <= _LARGEST_FILE else ""
    except (OSError, UnicodeDecodeError, ValueError) as error:
        why = getattr(error, "strerror", None) or "no text in UTF-8"
        raise CaseError(source, "", why, "a CSV file that can be read") from None
    if not text.strip():
        found = "empty" if size <= _LARGEST_FILE else f"{size} bytes long"
        raise CaseError(source, "", found, f"a table of at most {_LARGEST_FILE // 10**6} MB with {_WANTED}")
    lines = [(i, line) for i, line in enumerate(text.splitlines(), start=1) if line.strip()]
    separator = max(",;\t", key=lines[0][1].count)
    try:
        cells = [
            (i, row) for (i, _), row in zip(lines, csv.reader([t for _, t in lines], delimiter=separator), strict=True)
        ]
    except (csv.Error, ValueError) as error:
        raise CaseError(source, "", str(error), "plain cells, each on one line") from None
    header = [c.strip() for c in cells[0][1]]
    for cell in header:
        _split(cell, source)
    if len(cells) - 1 > _MOST_ROWS:
        raise CaseError(source, "", f"{len(cells) - 1} rows", f"{_MOST_ROWS} at most")
    if separator != ",":
        cells[1:] = [(i, [cell.replace(",", ".") for cell in row]) for i, row in cells[1:]]
    return header, np.array([_numbers(row, len(header), i, source) for i, row in cells[1:]]).reshape(-1, len(header))


def _numbers(row: Sequence[str], count: int, line: int, source: str) -> list[float]:
    if len(row) != count:
        raise CaseError(source, f"line {line}", f"{len(row)} cells long", f"{count} cells, as in the header")
    out = []
    for cell in row:
        try:
            number = float(cell)
        except ValueError:
            number = math.nan
        if not math.isfinite(number):
            raise CaseError(source, f"line {line}", cell.strip(), "a finite number")
        out.append(number)
    return out


def _split(cell: str, source: str) -> tuple[str, tuple[int, int] | None, str]:
    """Name, path (output and input, from one) and unit of a header's cell."""
    match = _HEADER.fullmatch(cell)
    name, unit = (match[1].lower(), (match[2] or match[3] or "").strip()) if match else (cell, "")
    placed = _PLACED.fullmatch(name)
    name, place = (placed[1], (int(placed[2]), int(placed[3]))) if placed else (name, None)
    if name not in _COLUMNS or (place and (min(place) < 1 or max(place) > _MOST_PORTS or name == "frequency")):
        raise CaseError(source, "line 1", cell, f"one of {', '.join(_COLUMNS)}, with a unit in brackets: {_WANTED}")
    return name, place, unit


def _values(columns: dict[str, tuple[int, str]], rows: Array, source: str) -> ComplexArray:
    """Complex response of all rows."""
    pairs = [pair for pair in _PAIRS if any(name in columns for name in pair)]
    missing = [name for name in ("frequency", *(pairs[0] if pairs else _PAIRS[0])) if name not in columns]
    if len(pairs) > 1 or missing:
        shown = " and ".join(columns)
        raise CaseError(source, "line 1", shown, "frequency, and either magnitude and phase or real and imaginary")
    first, second = (rows[:, columns[name][0]] for name in pairs[0])
    units = [columns[name][1] for name in pairs[0]]
    if pairs[0][0] == "real":
        if units[0] != units[1]:
            raise CaseError(source, "line 1, imaginary", units[1], f"the unit of the real part, {units[0]!r}")
        return np.asarray((first + 1j * second) * _gain_unit(units[0], "real", source), complex)
    if not units[1]:
        raise CaseError(source, "line 1, phase", "without a unit", "phase [deg] or phase [rad]")
    angle = second * _in_si(units[1], "rad", "phase", source)
    if units[0].lower() == "db":
        return np.asarray(10.0 ** (first / 20.0) * np.exp(1j * angle), complex)
    if np.any(first < 0.0):
        least = f"{first.min():.6g} {units[0]}".strip()
        raise CaseError(source, "magnitude", least, "none below zero, or decibels as magnitude [dB]")
    size = first * _gain_unit(units[0], "magnitude", source)
    return np.asarray(size * np.exp(1j * angle), complex)


def _gain_unit(unit: str, column: str, source: str) -> float:
    """Factor to SI of a unit of output over input; none is a plain number."""
    try:
        return parse_any(f"1 {unit}")[0] if unit else 1.0
    except QuantityError as error:
        raise CaseError(source, f"line 1, {column}", unit, error.expected) from None


def _frequency_unit(unit: str, source: str) -> float:
    """Factor to rad/s: turns a second are counted by Hz."""
    if not unit:
        raise CaseError(source, "line 1, frequency", "without a unit", "frequency [Hz] or frequency [rad/s]")
    try:
        return 2.0 * math.pi * parse_quantity(f"1 {unit}", "Hz")
    except QuantityError:
        return _in_si(unit, "rad/s", "frequency", source)


def _share(columns: dict[str, tuple[int, str]], source: str) -> float:
    return _in_si(columns["deviation"][1], "", "deviation", source)


def _in_si(unit: str, wanted: str, column: str, source: str) -> float:
    try:
        return parse_quantity(f"1 {unit}", wanted) if unit else 1.0
    except QuantityError as error:
        raise CaseError(source, f"line 1, {column}", unit, error.expected) from None
