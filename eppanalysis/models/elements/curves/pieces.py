"""Piecewise-linear curves that go by names of their own: freeplay, comparators, rounding down, overflow."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from types import MappingProxyType
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from eppanalysis.arguments import floats, of_two_sides
from eppanalysis.arrays import Array
from eppanalysis.models.elements.base import IN, OUT, RATIO, SLOPE
from eppanalysis.models.elements.exact import Half, Pieces, Reading
from eppanalysis.models.elements.phases import require, require_numbers, require_steps
from eppanalysis.models.elements.piecewise import PiecewiseLinear
from eppanalysis.models.elements.static import Relay


@dataclass(frozen=True)
class BilinearSpring(PiecewiseLinear, kind="bilinear_spring"):
    """Freeplay: the slope `inner` between `lower` and `upper`, the slope `outer` beyond either, without a jump.

    Such as a dead band with a gain inside, or a control surface or a hinge that is soft between its stops.

    Parameters
    ----------
    lower, upper : float
        Edges of the freeplay, ascending [unit of the input].
    outer : float
        Slope beyond either edge [unit of the output per unit of the input].
    inner : float, optional
        Slope between them [unit of the output per unit of the input].
    preload : float, optional
        Output that is added everywhere [unit of the output].

    Raises
    ------
    ModelError
        If the edges do not ascend or a field is not a finite number.

    Examples
    --------
    >>> from eppanalysis.models.elements import BilinearSpring
    >>> hinge = BilinearSpring(-0.5, 1.0, outer=10.0, inner=1.0, preload=2.0)
    >>> hinge.output([-1.0, 0.0, 1.0, 2.0])[0].tolist()
    [-3.5, 2.0, 3.0, 13.0]
    """

    units = MappingProxyType({"lower": IN, "upper": IN, "outer": SLOPE, "inner": SLOPE, "preload": OUT})

    lower: float
    upper: float
    outer: float
    inner: float = 0.0
    preload: float = 0.0

    def __post_init__(self) -> None:
        require_numbers(self)
        require(self, "upper", self.upper > self.lower, "more than lower", "lower")
        excess = self.inner - self.outer
        offsets = [self.preload + excess * self.lower, self.preload, self.preload + excess * self.upper]
        self._set_pieces([self.lower, self.upper], [self.outer, self.inner, self.outer], offsets)


class _SideAtEdges(PiecewiseLinear):
    """Pieces of no slope, or of slope one; at an edge the output is that of the piece above it, not between the two."""

    def output(self, x: ArrayLike, memory: Any = None) -> tuple[Array, Any]:
        """Output of the map for any array `x`; `memory` is handed through unused."""
        x = floats(x, "output: x")
        piece = np.searchsorted(self.breakpoints, x, side="right")
        rise = np.where(self.slopes[piece] == 0.0, 0.0, x)
        return np.asarray(np.where(np.isnan(x), np.nan, rise + self.intercepts[piece])), memory


@of_two_sides("low", "high")
@dataclass(frozen=True)
class Comparator(_SideAtEdges, Relay, kind="comparator"):
    """`low` below `threshold`, `high` at it and above: a relay that has a side at its threshold.

    Parameters
    ----------
    low, high : float, optional
        Outputs below the threshold and from it on, not the same [unit of the output].
    threshold : float, optional
        Least input at which it is high [unit of the input].

    Raises
    ------
    ModelError
        If a field is not a finite number, or both levels are the same.

    Examples
    --------
    >>> from eppanalysis.models.elements import Comparator
    >>> Comparator(low=0.0, high=1.0).output([-0.1, 0.0, 0.1])[0].tolist()
    [0.0, 1.0, 1.0]
    """


@dataclass(frozen=True)
class _Quantising(_SideAtEdges):
    """Steps of one width and height; levels are the multiples of a step, and `shift` of one."""

    units = MappingProxyType({"step": IN, "levels": RATIO})
    same_unit = True
    shift: ClassVar[float] = 0.0

    step: float
    levels: int

    def __post_init__(self) -> None:
        require_steps(self)
        n = int(self.levels)
        edges = np.arange(1 - n, n if self.shift else n + 1)
        levels = -n + self.shift + np.arange(edges.size + 1)
        self._set_pieces(self.step * edges, np.zeros(edges.size + 1), self.step * levels)


@dataclass(frozen=True)
class FloorQuantiser(_Quantising, kind="floor_quantiser"):
    """Quantiser that rounds down, as a converter that truncates: the greatest multiple of `step` up to the input.

    Parameters
    ----------
    step : float
        Width and height of a step [unit of input and output], positive.
    levels : int
        Steps on each side of zero, a positive whole number; beyond them the output stays.

    Raises
    ------
    ModelError
        If the step is not positive or `levels` is not a positive whole number.

    Examples
    --------
    >>> from eppanalysis.models.elements import FloorQuantiser
    >>> FloorQuantiser(step=0.5, levels=4).output([0.2, 0.5, -0.1, 9.0])[0].tolist()
    [0.0, 0.5, -0.5, 2.0]
    """


@dataclass(frozen=True)
class MidRiseQuantiser(_Quantising, kind="mid_rise_quantiser"):
    """Quantiser with a step at zero: levels are the odd multiples of half a step.

    Parameters
    ----------
    step : float
        Width and height of a step [unit of input and output], positive.
    levels : int
        Levels on each side of zero, a positive whole number; with one it is a relay.

    Raises
    ------
    ModelError
        If the step is not positive or `levels` is not a positive whole number.

    Examples
    --------
    >>> from eppanalysis.models.elements import MidRiseQuantiser
    >>> MidRiseQuantiser(step=0.5, levels=4).output([0.2, 0.5, -0.1, 9.0])[0].tolist()
    [0.25, 0.75, -0.25, 1.75]
    """

    shift = 0.5


@dataclass(frozen=True)
class WrapAround(_SideAtEdges, kind="wrap_around"):
    """Overflow of two's complement numbers: what leaves `-limit` to `limit` on one side comes in on the other.

    The output is ``(x + limit) mod (2 limit) - limit``, as of an adder that drops its carry. Beyond the last jump its
    line goes on. An adder that saturates is a :class:`Saturation`; a :class:`FloorQuantiser` in front of either
    truncates.

    Parameters
    ----------
    limit : float
        Half of the range of numbers [unit of input and output], positive.
    overflows : int
        Jumps on each side of zero, a positive whole number.

    Raises
    ------
    ModelError
        If the limit is not positive or `overflows` is not a positive whole number.

    Examples
    --------
    >>> from eppanalysis.models.elements import WrapAround
    >>> WrapAround(limit=1.0, overflows=2).output([0.75, 1.0, 1.25, -3.25])[0].tolist()
    [0.75, -1.0, -0.75, 0.75]
    """

    units = MappingProxyType({"limit": IN, "overflows": RATIO})
    same_unit = True
    linear_gain_is = "its slope between overflows"

    limit: float
    overflows: int

    def __post_init__(self) -> None:
        require_steps(self, "limit", "overflows")
        n = int(self.overflows)
        edges, turns = 2.0 * np.arange(-n, n) + 1.0, np.arange(-n, n + 1)
        self._set_pieces(self.limit * edges, np.ones(2 * n + 1), -2.0 * self.limit * turns)

    def exact(self, read: Reading) -> Pieces:
        """Its lines on either side of zero in exact numbers, for certificates."""
        limit = read(self.limit)
        half = Half(Fraction(1), jumps=tuple((limit * (2 * i + 1), -2 * limit) for i in range(int(self.overflows))))
        return Pieces(half, half)

    def linear_gain(self) -> Array:
        """One, the slope of its lines."""
        return np.ones((1, 1))
