"""Piecewise-linear curves that go by names of their own: freeplay, comparators, quantisers that round down."""

from __future__ import annotations

from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from eppanalysis.arguments import floats, of_two_sides
from eppanalysis.arrays import Array
from eppanalysis.models.elements.base import IN, OUT, RATIO, SLOPE
from eppanalysis.models.elements.phases import require, require_numbers, require_steps
from eppanalysis.models.elements.piecewise import PiecewiseLinear


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
    """Constant pieces; at an edge the output is that of the piece above it, not the middle of the step."""

    def output(self, x: ArrayLike, memory: Any = None) -> tuple[Array, Any]:
        """Output of the map for any array `x`; `memory` is handed through unused."""
        x = floats(x, "output: x")
        level = self.intercepts[np.searchsorted(self.breakpoints, x, side="right")]
        return np.asarray(np.where(np.isnan(x), np.nan, level)), memory


@of_two_sides("low", "high")
@dataclass(frozen=True)
class Comparator(_SideAtEdges, kind="comparator"):
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

    units = MappingProxyType({"low": OUT, "high": OUT, "threshold": IN})

    low: float = -1.0
    high: float = 1.0
    threshold: float = 0.0

    def __post_init__(self) -> None:
        require_numbers(self)
        require(self, "high", self.high != self.low, "other than low", "low")
        self._set_pieces([self.threshold], [0.0, 0.0], [self.low, self.high])


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
        Steps on each side of zero, a positive whole number; beyond the last of them the output stays where it is.

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
    """Quantiser with a step at zero: levels are the odd multiples of half a step, and there is none at zero.

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
