"""Linear parts in files: measured frequency responses, columns by name with their units, and systems of MATLAB.

A file is data: reading it runs no code. One row is one frequency.
"""

from __future__ import annotations

import math
import re
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from eppanalysis.arguments import checked
from eppanalysis.arrays import Array, ComplexArray
from eppanalysis.cases.files import own_or_shipped
from eppanalysis.errors import CaseError, ModelError
from eppanalysis.models.diagrams.blocks.control import StateSpaceBlock, TransferFunction
from eppanalysis.models.systems.measured.matrix import MeasuredMatrix
from eppanalysis.models.systems.measured.response import MeasuredResponse
from eppanalysis.records.columns import Column, Heading, Headings
from eppanalysis.records.formats import opened, readable_as
from eppanalysis.records.reading import read
from eppanalysis.units import QuantityError, parse_any, parse_quantity

_LARGEST_FILE, _MOST_ROWS = 50_000_000, 100_000
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
    """Measured frequency response of a file: CSV, or an ``frd`` that ``to_eppanalysis.m`` wrote.

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
    table = opened(path, _WANTED, has_si=True, largest=_LARGEST_FILE)
    headings = table.headings
    header = [heading.text for heading in headings.all]
    split = [_split(heading, headings) for heading in headings.all]
    if len({(name, place) for name, place, _ in split}) < len(header):
        raise CaseError(source, headings.line, ", ".join(header), "each column once")
    columns = [Column(heading.text, i, 1.0, heading) for i, heading in enumerate(headings.all)]
    found = read(table, columns, fewest=1, whole=True, largest=math.inf)
    rows = np.column_stack([found[text] for text in header])
    if len(rows) > _MOST_ROWS:
        raise CaseError(source, "", f"{len(rows)} rows", f"{_MOST_ROWS} at most")
    places = sorted({place for name, place, _ in split if place and name not in _SHARED})
    shared = {name: (i, unit) for i, (name, place, unit) in enumerate(split) if not place}
    if places and shared.keys() - _SHARED:
        raise CaseError(source, headings.line, ", ".join(header), "a path such as 2/1 at each of them, or at none")
    gains = np.asarray(np.nan if static_gain is None else static_gain, float)
    if not places:
        if gains.ndim:
            raise CaseError(source, "static_gain", str(static_gain), "one number: the file has one path")
        return _response(shared, rows, headings, path.name, float(gains), unstable_poles)
    shape = max(i for i, _ in places), max(j for _, j in places)
    if gains.ndim and gains.shape != shape:
        raise CaseError(source, "static_gain", str(static_gain), f"numbers of shape {shape}")
    gains = np.broadcast_to(gains, shape)
    paths: list[list[MeasuredResponse | None]] = [[None] * shape[1] for _ in range(shape[0])]
    for i, j in places:
        own = {name: (k, unit) for k, (name, place, unit) in enumerate(split) if place == (i, j)}
        gain, label = float(gains[i - 1, j - 1]), f"{path.name} {i}/{j}"
        paths[i - 1][j - 1] = _response(shared | own, rows, headings, label, gain, unstable_poles)
    return MeasuredMatrix(paths, path.name)


def _response(
    columns: dict[str, tuple[int, str]], rows: Array, headings: Headings, name: str, gain: float, unstable_poles: int
) -> MeasuredResponse:
    """The response of one path; a gain that is not a number is that of the row at rest."""
    value = _values(columns, rows, headings)
    omega = rows[:, columns["frequency"][0]] * _frequency_unit(columns["frequency"][1], headings)
    deviation = rows[:, columns["deviation"][0]] * _share(columns, headings) if "deviation" in columns else None
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
            f"{headings.source}: {error.what.removeprefix('MeasuredResponse: ')}", expected=error.expected
        ) from None


def _split(heading: Heading, headings: Headings) -> tuple[str, tuple[int, int] | None, str]:
    """Name, path (output and input, from one) and unit of a heading."""
    name = heading.name.lower()
    placed = _PLACED.fullmatch(name)
    name, place = (placed[1], (int(placed[2]), int(placed[3]))) if placed else (name, None)
    if name not in _COLUMNS or (place and (min(place) < 1 or max(place) > _MOST_PORTS or name == "frequency")):
        expected = f"one of {', '.join(_COLUMNS)}, with a unit in brackets: {_WANTED}"
        raise CaseError(headings.source, headings.line, heading.text, expected)
    return name, place, heading.unit


def _values(columns: dict[str, tuple[int, str]], rows: Array, headings: Headings) -> ComplexArray:
    """Complex response of all rows."""
    pairs = [pair for pair in _PAIRS if any(name in columns for name in pair)]
    missing = [name for name in ("frequency", *(pairs[0] if pairs else _PAIRS[0])) if name not in columns]
    if len(pairs) > 1 or missing:
        shown = " and ".join(columns)
        expected = "frequency, and either magnitude and phase or real and imaginary"
        raise CaseError(headings.source, headings.line, shown, expected)
    first, second = (rows[:, columns[name][0]] for name in pairs[0])
    units = [columns[name][1] for name in pairs[0]]
    if pairs[0][0] == "real":
        if units[0] != units[1]:
            raise CaseError(
                headings.source, headings.field("imaginary"), units[1], f"the unit of the real part, {units[0]!r}"
            )
        return np.asarray((first + 1j * second) * _gain_unit(units[0], "real", headings), complex)
    if not units[1]:
        raise CaseError(headings.source, headings.field("phase"), "without a unit", "phase [deg] or phase [rad]")
    angle = second * _in_si(units[1], "rad", "phase", headings)
    if units[0].lower() == "db":
        return np.asarray(10.0 ** (first / 20.0) * np.exp(1j * angle), complex)
    if np.any(first < 0.0):
        least = f"{first.min():.6g} {units[0]}".strip()
        raise CaseError(headings.source, "magnitude", least, "none below zero, or decibels as magnitude [dB]")
    size = first * _gain_unit(units[0], "magnitude", headings)
    return np.asarray(size * np.exp(1j * angle), complex)


def _gain_unit(unit: str, column: str, headings: Headings) -> float:
    """Factor to SI of a unit of output over input; none is a plain number."""
    try:
        return parse_any(f"1 {unit}")[0] if unit else 1.0
    except QuantityError as error:
        raise CaseError(headings.source, headings.field(column), unit, error.expected) from None


def _frequency_unit(unit: str, headings: Headings) -> float:
    """Factor to rad/s: turns a second are counted by Hz."""
    if not unit:
        raise CaseError(
            headings.source, headings.field("frequency"), "without a unit", "frequency [Hz] or frequency [rad/s]"
        )
    try:
        return 2.0 * math.pi * parse_quantity(f"1 {unit}", "Hz")
    except QuantityError:
        return _in_si(unit, "rad/s", "frequency", headings)


def _share(columns: dict[str, tuple[int, str]], headings: Headings) -> float:
    return _in_si(columns["deviation"][1], "", "deviation", headings)


def _in_si(unit: str, wanted: str, column: str, headings: Headings) -> float:
    try:
        return parse_quantity(f"1 {unit}", wanted) if unit else 1.0
    except QuantityError as error:
        raise CaseError(headings.source, headings.field(column), unit, error.expected) from None


@checked
def read_linear(path: str | Path) -> TransferFunction | StateSpaceBlock:
    """Linear system of a MAT-file that ``to_eppanalysis.m`` wrote, as a block of a diagram.

    The m-file is in the folder ``eppanalysis/records``: in MATLAB, ``to_eppanalysis('plant.mat', G)`` writes a tf, zpk
    or ss as plain numbers.

    Parameters
    ----------
    path : str or Path

    Returns
    -------
    TransferFunction or StateSpaceBlock
        With the sample time [s] of a system in discrete time; its signals are in SI units.

    Raises
    ------
    CaseError
        If it cannot be read, or holds no such system.
    ModelError
        If its numbers make no block.

    Examples
    --------
    >>> import scipy.io
    >>> import eppanalysis as epp
    >>> system = {"kind": "tf", "sample_time": 0.0, "num": [5.0], "den": [1.0, 1.0]}
    >>> scipy.io.savemat("plant.mat", {"eppanalysis": system})  # as the m-file
    >>> epp.read_linear("plant.mat").den
    (1.0, 1.0)
    """
    from eppanalysis.records import matlab

    source = str(path)
    with readable_as(source, "a MAT-file"):
        found = matlab.linear_part(Path(path), source)
        step = float(np.ravel(found["sample_time"])[0])
        if step < 0.0:
            raise CaseError(source, "sample_time", step, "zero in continuous time, or seconds")
        if found["kind"] == "tf":
            num, den = (tuple(np.ravel(found[name]).astype(float).tolist()) for name in ("num", "den"))
            return TransferFunction(num=num, den=den, sample_time=step or None)
        A, B, C, D = (np.asarray(found[name], float) for name in "ABCD")
        n, (outputs, inputs) = len(A), np.atleast_2d(D).shape
        return StateSpaceBlock(
            A=A.reshape(n, n).tolist(), B=B.reshape(n, inputs).tolist(), C=C.reshape(outputs, n).tolist(),
            D=np.atleast_2d(D).tolist(), sample_time=step or None,
            input_names=_names(found.get("input_names")), output_names=_names(found.get("output_names")),
        )  # fmt: skip


def _names(given: object) -> list[str] | None:
    """Names of signals, where all have one."""
    from eppanalysis.records.matlab import texts

    found = texts(given)
    return found if found and all(found) else None
