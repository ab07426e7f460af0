"""A curve that was measured or tabulated: straight lines between its points."""

from __future__ import annotations

import csv
from pathlib import Path
from types import MappingProxyType
from typing import Literal, Self

import numpy as np
from numpy.typing import ArrayLike

from eppanalysis.arguments import floats
from eppanalysis.arrays import Array
from eppanalysis.errors import ModelError
from eppanalysis.models.elements.base import IN, OUT, Nonlinearity
from eppanalysis.models.elements.piecewise import PiecewiseLinear


class Tabulated(Nonlinearity):
    """What the curves through the points of a table share: their fields, and how they are read from a file."""

    units = MappingProxyType({"inputs": IN, "outputs": OUT})
    columns = ("inputs", "outputs")

    inputs: Array
    outputs: Array
    beyond: Literal["line", "hold"]

    @classmethod
    def from_csv(cls, file: str | Path, beyond: Literal["line", "hold"] = "line") -> Self:
        """The table in the first two columns of a CSV file; a first line that does not hold numbers is its header.

        Parameters
        ----------
        file : path
        beyond : {"line", "hold"}
            Beyond the table, as of the class.

        Raises
        ------
        ModelError
            If the file cannot be read, or a line has no two numbers; and as the table itself.
        """
        return cls(*_points_of_file(cls.__name__, file), beyond)  # type: ignore[call-arg]  # each table has these fields


class LookupTable(Tabulated, PiecewiseLinear, kind="lookup_table"):
    """Straight lines through the points of a table; its describing function is exact.

    Parameters
    ----------
    inputs : array_like, shape (k,)
        At least two, ascending [unit of the input]; two that are the same make a jump.
    outputs : array_like, shape (k,)
        Output at each of them [unit of the output].
    beyond : {"line", "hold"}
        Beyond the table: "line" goes on with the slope of the end, "hold" with its value.

    Raises
    ------
    ModelError
        If there are fewer than two points, numbers are not finite, inputs do not ascend, or three are the same.

    Examples
    --------
    >>> from eppanalysis.models.elements import LookupTable
    >>> valve = LookupTable([0.0, 0.2, 1.0], [0.0, 0.0, 5.0], beyond="hold")
    >>> valve.output([-1.0, 0.1, 0.6, 2.0])[0].tolist()
    [0.0, 0.0, 2.5, 5.0]
    """

    def __init__(self, inputs: ArrayLike, outputs: ArrayLike, beyond: Literal["line", "hold"] = "line") -> None:
        x, y = floats(inputs, "LookupTable: inputs", ndmin=1), floats(outputs, "LookupTable: outputs", ndmin=1)
        check_points("LookupTable", x, y, beyond)
        for name, values in (("inputs", x), ("outputs", y)):
            kept = np.array(values)
            kept.flags.writeable = False
            object.__setattr__(self, name, kept)
        object.__setattr__(self, "beyond", beyond)
        self._set_pieces(*_pieces(x, y, beyond == "hold"))


def _points_of_file(who: str, file: str | Path) -> tuple[Array, Array]:
    """Inputs and outputs in the first two columns of a file with commas.

    Raises
    ------
    ModelError
        If the file cannot be read, or a line behind the heading has no two numbers.
    """
    try:
        with Path(file).open(newline="", encoding="utf-8-sig") as stream:
            rows = [(number, row) for number, row in enumerate(csv.reader(stream), start=1) if any(row)]
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise ModelError(f"{who}: {file} cannot be read: {error}.") from None
    points = []
    for number, row in rows:
        try:
            points.append((float(row[0]), float(row[1])))
        except (ValueError, IndexError):
            if (number, row) != rows[0]:
                shown = ",".join(row)[:60]
                raise ModelError(f"{who}: line {number} of {file}", shown, "two numbers") from None
    table = np.array(points, float).reshape(-1, 2)
    return table[:, 0], table[:, 1]


def check_points(who: str, x: Array, y: Array, beyond: object) -> None:
    """Refuse what is no table.

    Raises
    ------
    ModelError
        If there are fewer than two points, numbers are not finite, inputs do not ascend, or three are the same.
    """
    if x.ndim != 1 or x.size < 2:
        raise ModelError(who, x.tolist(), "two numbers or more", field="inputs")
    if y.shape != x.shape:
        raise ModelError(f"{who}: outputs has shape {y.shape}", expected=f"shape {x.shape}", field="outputs")
    for name, values in (("inputs", x), ("outputs", y)):
        if not np.all(np.isfinite(values)):
            raise ModelError(who, values.tolist(), "finite numbers", field=name)
    steps = np.diff(x)
    thrice = np.any((steps[1:] == 0) & (steps[:-1] == 0))
    if np.any(steps < 0) or thrice or steps[0] == 0 or steps[-1] == 0:
        raise ModelError(who, x.tolist(), "ascending numbers, two the same for a jump within", field="inputs")
    if not isinstance(beyond, str) or beyond not in ("line", "hold"):
        raise ModelError(who, beyond, "'line' or 'hold'", field="beyond")


def _pieces(x: Array, y: Array, hold: bool) -> tuple[Array, Array, Array]:
    """Breakpoints, slopes and intercepts; where the table is held its ends are breakpoints too."""
    left, right = np.flatnonzero(np.diff(x) > 0), np.flatnonzero(np.diff(x) > 0) + 1
    with np.errstate(over="ignore", invalid="ignore"):  # what overflows is refused as not finite
        slopes = (y[right] - y[left]) / (x[right] - x[left])
        # From the end nearer to zero: of a table through the origin the pieces there meet exactly, where nothing is
        # large enough for a jump to be rounding.
        near = np.where(np.abs(x[left]) <= np.abs(x[right]), left, right)
        intercepts = y[near] - slopes * x[near]
    edges = x[right][:-1]
    if hold:
        edges = np.concatenate([x[:1], edges, x[-1:]])
        slopes = np.concatenate([[0.0], slopes, [0.0]])
        intercepts = np.concatenate([y[:1], intercepts, y[-1:]])
    return edges, slopes, intercepts
