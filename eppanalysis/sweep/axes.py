"""What a sweep runs over: grids, zipped axes, samples of ranges and of tolerances, all in SI units.

Whatever the user requests becomes a :class:`Design`: named dimensions, each of which moves one or several parameters.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import prod
from typing import Any, Literal

import numpy as np

from eppanalysis.arguments import checked_class
from eppanalysis.arrays import Array
from eppanalysis.cases import Case
from eppanalysis.errors import ArgumentError, EppError

Axis = str | Sequence[Any]
Limits = str | Sequence[Any]

#: More values than these on one axis, or cells in all, are a slip of the pen.
_MOST_VALUES, _MOST_CELLS = 10_000_000, 10**9


@checked_class
@dataclass(frozen=True)
class Zipped:
    """Axes of equal length that move together, along one dimension "point".

    Attributes
    ----------
    axes : mapping of str to axis
        By parameter: a list of quantities, or "start:stop:count:unit".
    """

    axes: Mapping[str, Axis]


@checked_class
@dataclass(frozen=True)
class _Ranges:
    """Ranges that are sampled along one dimension "sample"."""

    ranges: Mapping[str, Limits]
    n: int  # number of cells; of a Sobol sample a power of two
    seed: int = 0


class LatinHypercube(_Ranges):
    """Latin hypercube sample of `n` cells in `ranges`, along "sample" (scipy.stats.qmc.LatinHypercube).

    Parameters
    ----------
    ranges : mapping of str to range
        By parameter: "start:stop:unit", or a pair of quantities.
    n : int
        Number of cells.
    seed : int
        Of the sample.
    """


class Sobol(_Ranges):
    """Scrambled Sobol sample of `n` cells (a power of two) in `ranges`, along "sample" (scipy.stats.qmc.Sobol).

    Parameters
    ----------
    ranges : mapping of str to range
        By parameter: "start:stop:unit", or a pair of quantities.
    n : int
        Number of cells, a power of two.
    seed : int
        Of the scrambling.
    """


@checked_class
@dataclass(frozen=True)
class Tolerances:
    """Latin hypercube sample of the tolerances in the case, along one dimension "sample".

    Attributes
    ----------
    n : int
        Number of cells.
    seed : int
        Of the draws: the same seed, the same machines.
    names : sequence of str, optional
        Parameters; by default all that have a tolerance.
    distribution : {"uniform", "normal"}
        Within value ± tolerance: even, or normal with a third of the tolerance as standard deviation, cut at its ends.
    """

    n: int
    seed: int = 0
    names: Sequence[str] | None = None
    distribution: Literal["uniform", "normal"] = "uniform"


Axes = Mapping[str, Axis] | Zipped | LatinHypercube | Sobol | Tolerances


@dataclass(frozen=True, eq=False)
class Dimension:
    """One dimension of a sweep."""

    name: str
    values: dict[str, Array]  # (n,): by parameter, in SI units (counts and flags as numbers)
    given: dict[str, tuple[Any, ...]]  # the same as a case takes them: whole numbers and flags stay what they are

    @property
    def n(self) -> int:
        """Number of places along the dimension."""
        return len(next(iter(self.values.values())))

    def at(self, i: int) -> dict[str, Any]:
        """What a case is given at one place."""
        return {name: values[i] for name, values in self.given.items()}


@dataclass(frozen=True, eq=False)
class Design:
    """Dimensions of a sweep; its cells are numbered with the last dimension fastest."""

    dimensions: tuple[Dimension, ...]

    @property
    def shape(self) -> tuple[int, ...]:
        """Number of places along each dimension."""
        return tuple(d.n for d in self.dimensions)

    @property
    def n_cells(self) -> int:
        """Number of cells."""
        return prod(self.shape)

    def at(self, place: Sequence[int]) -> dict[str, Any]:
        """What a case is given in one cell."""
        return {k: v for d, i in zip(self.dimensions, place, strict=True) for k, v in d.at(int(i)).items()}


def make_design(case: Case, axes: Axes) -> Design:
    """The dimensions that `axes` describe, in SI units.

    Raises
    ------
    EppError
        If an axis is empty, has a wrong unit or is not understood, or a parameter is unknown or given twice.
    """
    if isinstance(axes, Zipped):
        return _zipped(case, axes)
    if isinstance(axes, LatinHypercube | Sobol):
        return _sampled(case, axes)
    if isinstance(axes, Tolerances):
        return _tolerances(case, axes)
    if not isinstance(axes, Mapping):
        raise EppError(f"sweep: the axes are {_shown(axes)}; expected axes by parameter, or a sample.")
    if not axes:
        raise EppError("sweep: there is no axis; expected at least one.")
    design = Design(tuple(_dimension(name, {name: _given(case, name, axis)}) for name, axis in axes.items()))
    if design.n_cells > _MOST_CELLS:
        raise EppError(f"sweep: the grid has {design.n_cells} cells; expected at most {_MOST_CELLS}.")
    return design


def _dimension(name: str, given: dict[str, tuple[Any, ...]]) -> Dimension:
    return Dimension(name, {k: np.array([float(x) for x in v]) for k, v in given.items()}, given)


def _given(case: Case, name: str, axis: Axis) -> tuple[Any, ...]:
    """Values of one axis as the case takes them."""
    case.unit(name)  # refuses a parameter that is not known, in its own words
    values = _range(case, name, axis) if isinstance(axis, str) else _listed(case, name, axis)
    if not values:
        raise EppError(f"sweep: axis {name} is empty; expected at least one value.")
    return values


def _listed(case: Case, name: str, axis: Any) -> tuple[Any, ...]:
    if isinstance(axis, np.ndarray):
        axis = axis.tolist()
    if not isinstance(axis, Sequence):
        axis = [axis]
    return tuple(_value(case, name, value) for value in axis)


def _value(case: Case, name: str, value: Any) -> Any:
    """One value in SI units; a flag stays one."""
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, str) and value.strip().lower() in ("true", "false"):
        value = value.strip().lower() == "true"
    if isinstance(value, bool):
        case.with_values({name: value})
        return value
    number = case.si(name, value)
    # A whole number of a field without unit may be a count, which takes no fraction.
    return int(number) if number.is_integer() and case.unit(name) == ("", "") else number


def _range(case: Case, name: str, text: str) -> tuple[Any, ...]:
    """Values of "start:stop:count:unit"."""
    parts = [part.strip() for part in text.split(":")]
    expected = "start:stop:count:unit, as in 1:5:41:lbf"
    if len(parts) == 1 and ".." not in text:
        return (_value(case, name, text),)
    if len(parts) not in (3, 4) or not parts[2].isdecimal():
        raise EppError(f"sweep: axis {name} is {_shown(text)}; expected {expected}.")
    if len(parts[2]) > len(str(_MOST_VALUES)) or int(parts[2]) > _MOST_VALUES:
        raise EppError(f"sweep: axis {name} is {_shown(text)}; expected a count of at most {_MOST_VALUES}.")
    count = int(parts[2])
    unit = parts[3] if len(parts) == 4 else ""
    start, stop = (case.si(name, f"{part} {unit}".strip()) for part in parts[:2])
    return tuple(_value(case, name, x) for x in np.linspace(start, stop, count))


def _zipped(case: Case, axes: Zipped) -> Design:
    given = {name: _given(case, name, axis) for name, axis in axes.axes.items()}
    lengths = {len(v) for v in given.values()}
    if len(lengths) != 1:
        found = ", ".join(f"{k} has {len(v)}" for k, v in given.items()) or "there is none"
        raise EppError(f"sweep: zipped axes must be of one length ({found}); expected as many values on each.")
    return Design((_dimension("point", given),))


def _limits(case: Case, name: str, limits: Limits) -> tuple[float, float]:
    ends: Sequence[Any] = limits
    if isinstance(limits, str):
        parts = [part.strip() for part in limits.split(":")]
        if len(parts) > 3 or (len(parts) == 3 and parts[2].isdecimal()):
            raise EppError(
                f"sweep: the range of {name} is {_shown(limits)}; expected low:high:unit, without the count of an axis."
            )
        unit = parts.pop() if len(parts) == 3 else ""
        ends = [f"{part} {unit}".strip() for part in parts]
    if len(ends) != 2:
        raise EppError(f"sweep: the range of {name} is {_shown(limits)}; expected low:high:unit, as in 1:5:lbf.")
    low, high = (case.si(name, value) for value in ends)
    if not low < high:
        shown = f"{case.text(name, low)} to {case.text(name, high)}"
        raise EppError(f"sweep: the range of {name} is {shown}; expected its lower end first.")
    return low, high


def _points(kind: type, dimensions: int, n: int, seed: int) -> Array:
    """Points of the unit cube, shape (n, dimensions)."""
    from scipy.stats import qmc

    if isinstance(n, bool) or not isinstance(n, int) or not 1 <= n <= _MOST_VALUES:
        raise EppError(f"sweep: the sample has {n} cells; expected 1 to {_MOST_VALUES}.")
    if seed < 0:
        raise ArgumentError("seed", f" is {seed}; expected zero or a positive number.", "sweep")
    if dimensions == 0:
        raise EppError("sweep: the sample has no parameter; expected at least one.")
    if kind is LatinHypercube:
        return qmc.LatinHypercube(d=dimensions, rng=np.random.default_rng(seed)).random(n)
    # Sobol's points are even over the ranges in powers of two alone.
    if n & (n - 1):
        near = 1 << n.bit_length()
        raise EppError(f"sweep: a Sobol sample has {n} cells; expected a power of two, such as {near}.")
    return qmc.Sobol(d=dimensions, rng=np.random.default_rng(seed)).random(n)


def _sampled(case: Case, axes: LatinHypercube | Sobol) -> Design:
    limits = np.array([_limits(case, name, r) for name, r in axes.ranges.items()]).reshape(-1, 2)
    points = _points(type(axes), len(limits), axes.n, axes.seed)
    values = limits[:, 0] + points * (limits[:, 1] - limits[:, 0])
    return _sample(list(axes.ranges), values)


def _tolerances(case: Case, axes: Tolerances) -> Design:
    from eppanalysis.methods.bounds.tolerances.distribution import Distribution

    distribution = Distribution.called(axes.distribution, "sweep")
    found = {k: p for k, p in case.parameters.items() if p.tolerance}
    names = list(found) if axes.names is None else list(axes.names)
    for name in names:
        if name not in found:
            case.unit(name)
            raise EppError(f"sweep: {name} has no tolerance in {case.source}; expected a parameter that has one.")
    if not names:
        raise EppError(f"sweep: no parameter of {case.source} has a tolerance; expected at least one.")
    share = _points(LatinHypercube, len(names), axes.n, axes.seed)
    spread = distribution.within(share)
    centre = np.array([float(found[k].value) for k in names])
    half = np.array([float(found[k].tolerance or 0.0) for k in names])
    return _sample(names, centre + spread * half)


def _sample(names: list[str], values: Array) -> Design:
    given = {name: tuple(values[:, i].tolist()) for i, name in enumerate(names)}
    return Design((_dimension("sample", given),))


def _shown(value: object) -> str:
    text = repr(value)
    return text if len(text) <= 80 else text[:77] + "..."
