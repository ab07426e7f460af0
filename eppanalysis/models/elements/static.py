"""Static elements: named shapes of the piecewise-linear map, and the sine.

The named shapes only work out the pieces of :class:`~eppanalysis.models.elements.piecewise.PiecewiseLinear`.
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from types import MappingProxyType
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from eppanalysis.arguments import floats, of_two_sides
from eppanalysis.arrays import Array
from eppanalysis.models.elements import automata
from eppanalysis.models.elements.automaton import Automaton
from eppanalysis.models.elements.base import IN, OUT, RATIO, SLOPE, Answer, Nonlinearity
from eppanalysis.models.elements.exact import Half, Pieces, Reading
from eppanalysis.models.elements.phases import (
    NOT_NEGATIVE,
    NOT_ZERO,
    POSITIVE,
    broadcast,
    require,
    require_numbers,
    require_steps,
)
from eppanalysis.models.elements.piecewise import PiecewiseLinear

__all__ = [
    "Coulomb",
    "DeadZone",
    "DeadZoneSaturation",
    "FiveBandLaw",
    "PiecewiseLinear",
    "Preload",
    "Quantiser",
    "Relay",
    "RelayDeadZone",
    "Saturation",
    "Sine",
]


@dataclass(frozen=True)
class FiveBandLaw(PiecewiseLinear, kind="five_band_law"):
    """Motor voltage of the five bands slack, extension, parking, flexion and full flexion of the cable force.

    Parameters
    ----------
    slack, low, high, max : float
        Thresholds, ascending [N]: full extension up to `slack`, no voltage between `low` and `high`,
        full flexion from `max`.
    supply_voltage : float
        Voltage of full flexion, and minus that of full extension [V].
    offset_voltage : float, optional
        Voltage at which the bands next to parking start (a jump at `low` and `high`) [V].

    Raises
    ------
    ModelError
        If thresholds do not ascend, the offset exceeds the supply or a field is out of its range.

    Examples
    --------
    >>> from eppanalysis.models.elements import FiveBandLaw
    >>> law = FiveBandLaw(slack=5.0, low=10.0, high=11.0, max=16.0, supply_voltage=16.0)
    >>> law.output([0.0, 7.5, 10.5, 13.5, 20.0])[0].tolist()
    [-16.0, -8.0, 0.0, 8.0, 16.0]
    """

    units = MappingProxyType(
        {"slack": IN, "low": IN, "high": IN, "max": IN, "supply_voltage": OUT, "offset_voltage": OUT}
    )
    input_unit = "N"

    slack: float
    low: float
    high: float
    max: float
    supply_voltage: float
    offset_voltage: float = 0.0

    def __post_init__(self) -> None:
        require_numbers(self)
        require(self, "low", self.low > self.slack, "more than slack", "slack")
        require(self, "high", self.high > self.low, "more than low", "low")
        require(self, "max", self.max > self.high, "more than high", "high")
        require(self, "supply_voltage", self.supply_voltage > 0, "a positive number")
        offset_fits = 0 <= self.offset_voltage <= self.supply_voltage
        require(self, "offset_voltage", offset_fits, "0 to the supply voltage", "supply_voltage")
        rise = self.supply_voltage - self.offset_voltage
        extend, flex = rise / (self.low - self.slack), rise / (self.max - self.high)
        self._set_pieces(
            [self.slack, self.low, self.high, self.max],
            [0.0, extend, 0.0, flex, 0.0],
            [
                -self.supply_voltage,
                -self.offset_voltage - extend * self.low,
                0.0,
                self.offset_voltage - flex * self.high,
                self.supply_voltage,
            ],
        )


@of_two_sides("lower", "upper")
@dataclass(frozen=True)
class Saturation(PiecewiseLinear, kind="saturation"):
    """``y = slope*x``, limited to `lower` and `upper`.

    Parameters
    ----------
    lower, upper : float, optional
        Least and greatest output [unit of the output].
    slope : float, optional
        Between the limits, positive [unit of the output per unit of the input].

    Raises
    ------
    ModelError
        If the limits do not ascend or the slope is not positive.
    """

    units = MappingProxyType({"lower": OUT, "upper": OUT, "slope": SLOPE})

    lower: float = -1.0
    upper: float = 1.0
    slope: float = 1.0

    def __post_init__(self) -> None:
        require_numbers(self, slope=POSITIVE)
        require(self, "upper", self.upper > self.lower, "more than lower", "lower")
        edges = [self.lower / self.slope, self.upper / self.slope]
        self._set_pieces(edges, [0.0, self.slope, 0.0], [self.lower, 0.0, self.upper])

    def exact(self, read: Reading) -> Pieces:
        """Its pieces on either side of zero in exact numbers, for certificates."""
        k = read(self.slope)
        return Pieces(*(Half(k, ((read(side) / k, -k),)) for side in (self.upper, -self.lower)))


@of_two_sides("lower", "upper")
@dataclass(frozen=True)
class DeadZone(PiecewiseLinear, kind="dead_zone"):
    """Zero between `lower` and `upper` (unit of the input), a line of `slope` from either edge outwards.

    Parameters
    ----------
    lower, upper : float, optional
        Edges, ascending [unit of the input].
    slope : float, optional
        Slope outside the edges, not zero [unit of the output per unit of the input].

    Raises
    ------
    ModelError
        If the edges do not ascend, the slope is zero or a field is not a finite number.
    """

    units = MappingProxyType({"lower": IN, "upper": IN, "slope": SLOPE})

    lower: float = -1.0
    upper: float = 1.0
    slope: float = 1.0

    def __post_init__(self) -> None:
        require_numbers(self, slope=NOT_ZERO)
        require(self, "upper", self.upper > self.lower, "more than lower", "lower")
        offsets = [-self.slope * self.lower, 0.0, -self.slope * self.upper]
        self._set_pieces([self.lower, self.upper], [self.slope, 0.0, self.slope], offsets)


@dataclass(frozen=True)
class DeadZoneSaturation(PiecewiseLinear, kind="dead_zone_saturation"):
    """Odd: zero up to ``|x| = dead_zone``, then `slope`, up to ``|y| = limit``.

    Parameters
    ----------
    dead_zone : float
        Half the width of the dead zone [unit of the input], at least zero.
    slope : float
        Slope between dead zone and limit, positive [unit of the output per unit of the input].
    limit : float
        Greatest output, positive [unit of the output].

    Raises
    ------
    ModelError
        If a field is out of its range.
    """

    units = MappingProxyType({"dead_zone": IN, "slope": SLOPE, "limit": OUT})

    dead_zone: float
    slope: float
    limit: float

    def __post_init__(self) -> None:
        require_numbers(self, dead_zone=NOT_NEGATIVE, slope=POSITIVE, limit=POSITIVE)
        d, top, k = self.dead_zone, self.dead_zone + self.limit / self.slope, self.slope
        if d == 0:
            self._set_pieces([-top, top], [0.0, k, 0.0], [-self.limit, 0.0, self.limit])
        else:
            offsets = [-self.limit, k * d, 0.0, -k * d, self.limit]
            self._set_pieces([-top, -d, d, top], [0.0, k, 0.0, k, 0.0], offsets)

    def exact(self, read: Reading) -> Pieces:
        """Its pieces on either side of zero in exact numbers, for certificates."""
        d, k = read(self.dead_zone), read(self.slope)
        half = Half(Fraction(0), ((d, k), (d + read(self.limit) / k, -k)))
        return Pieces(half, half)


@of_two_sides("low", "high")
@dataclass(frozen=True)
class Relay(PiecewiseLinear, kind="relay"):
    """`low` below `threshold`, `high` above it, halfway between the two at it.

    Parameters
    ----------
    low, high : float, optional
        Outputs below and above the threshold, not the same [unit of the output].
    threshold : float, optional
        Input at which it switches [unit of the input].

    Raises
    ------
    ModelError
        If a field is not a finite number, or both levels are the same.
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
class RelayDeadZone(PiecewiseLinear, kind="relay_dead_zone"):
    """Three levels: ``-level`` below ``-threshold``, 0 between, ``level`` above `threshold`.

    Parameters
    ----------
    threshold : float
        Half the width of the dead zone, positive [unit of the input].
    level : float, optional
        Output beyond it [unit of the output].

    Raises
    ------
    ModelError
        If the threshold is not positive.
    """

    units = MappingProxyType({"threshold": IN, "level": OUT})

    threshold: float
    level: float = 1.0

    def __post_init__(self) -> None:
        require_numbers(self, threshold=POSITIVE)
        self._set_pieces([-self.threshold, self.threshold], [0.0, 0.0, 0.0], [-self.level, 0.0, self.level])


@dataclass(frozen=True)
class Preload(PiecewiseLinear, kind="preload"):
    """``y = slope*x + level*sgn(x)``.

    Parameters
    ----------
    level : float
        Half the step at zero [unit of the output].
    slope : float
        On either side of the step [unit of the output per unit of the input].

    Raises
    ------
    ModelError
        If a field is not a finite number.
    """

    units = MappingProxyType({"level": OUT, "slope": SLOPE})

    level: float
    slope: float

    def __post_init__(self) -> None:
        require_numbers(self)
        self._set_pieces([0.0], [self.slope, self.slope], [-self.level, self.level])


@dataclass(frozen=True)
class Coulomb(PiecewiseLinear, kind="coulomb"):
    """``y = level*sgn(x)``: a force against motion that does not stick, as dry friction at rest does.

    Parameters
    ----------
    level : float
        Force in motion [unit of the output].

    Raises
    ------
    ModelError
        If the level is not a finite number.
    """

    units = MappingProxyType({"level": OUT})
    output_is = "force"
    linear_gain_is = "left out: its force does not grow with the speed"

    level: float

    def __post_init__(self) -> None:
        require_numbers(self)
        self._set_pieces([0.0], [0.0, 0.0], [-self.level, self.level])

    def linear_gain(self) -> Array:
        """Zero: away from its jump the force stays what it is."""
        return np.zeros((1, 1))


@dataclass(frozen=True)
class FrictionCompensator(PiecewiseLinear, kind="friction_compensator"):
    """Friction that is fed forward: `level` in the direction of the velocity, taken up over a ramp about rest.

    Its input is the velocity, measured or (better) that of the reference, which does not chatter about rest.

    Parameters
    ----------
    level : float
        Force that is added in motion [unit of the output].
    ramp : float, optional
        Velocity, at least zero, up to which it grows from none at rest; by default it jumps there [unit of the input].

    Raises
    ------
    ModelError
        If a field is not a finite number, or the ramp is negative.

    Examples
    --------
    >>> from eppanalysis.models.elements import FrictionCompensator
    >>> FrictionCompensator(level=2.0, ramp=0.1).output([-1.0, 0.0, 0.05])[0].tolist()
    [-2.0, 0.0, 1.0]
    """

    units = MappingProxyType({"level": OUT, "ramp": IN})
    output_is = "force"

    level: float
    ramp: float = 0.0

    def __post_init__(self) -> None:
        require_numbers(self, ramp=NOT_NEGATIVE)
        if self.ramp:
            edges, slopes = [-self.ramp, self.ramp], [0.0, self.level / self.ramp, 0.0]
            self._set_pieces(edges, slopes, [-self.level, 0.0, self.level])
        else:
            self._set_pieces([0.0], [0.0, 0.0], [-self.level, self.level])


@dataclass(frozen=True)
class Quantiser(PiecewiseLinear, kind="quantiser"):
    """Mid-tread quantiser: the nearest multiple of `step`, limited to `levels` steps on each side.

    Halfway between two multiples it gives the one that is further from zero; there is no output between two levels.

    Parameters
    ----------
    step : float
        Width and height of a step, positive [unit of input and output].
    levels : int
        Steps on each side, a positive whole number.

    Raises
    ------
    ModelError
        If the step is not positive or `levels` is not a positive whole number.

    Examples
    --------
    >>> from eppanalysis.models.elements import Quantiser
    >>> Quantiser(step=0.5, levels=4).output([0.2, 0.3, -9.0])[0].tolist()
    [0.0, 0.5, -2.0]
    """

    units = MappingProxyType({"step": IN, "levels": RATIO})
    same_unit = True
    linear_gain_is = "the mean slope of its steps"

    step: float
    levels: int

    def __post_init__(self) -> None:
        require_steps(self)
        n = int(self.levels)
        self._set_pieces(
            self.step * (np.arange(-n, n) + 0.5), np.zeros(2 * n + 1), self.step * np.arange(-n, n + 1, dtype=float)
        )

    def exact(self, read: Reading) -> Pieces:
        """Its steps on either side of zero in exact numbers, for certificates."""
        step = read(self.step)
        half = Half(Fraction(0), jumps=tuple((step * (2 * i + 1) / 2, step) for i in range(int(self.levels))))
        return Pieces(half, half)

    def linear_gain(self) -> Array:
        """The mean slope of its steps: each is as high as it is wide."""
        return np.ones((1, 1))

    def output(self, x: ArrayLike, memory: Any = None) -> tuple[Array, Any]:
        """Output of the map for any array `x`; `memory` is handed through unused."""
        x = floats(x, "output: x")
        # Breakpoints are symmetric: those passed or reached by the size of x, of the positive ones.
        passed = np.searchsorted(self.breakpoints[int(self.levels) :], np.abs(x), side="right")
        return np.asarray(np.where(np.isnan(x), np.nan, np.copysign(self.step * passed, x) + 0.0)), memory


@dataclass(frozen=True)
class Sine(Nonlinearity, kind="sine"):
    """``y = scale * sin(x)``, x in radians (gravity on a link, a pendulum).

    Parameters
    ----------
    scale : float
        Greatest output [unit of the output].

    Raises
    ------
    ModelError
        If the scale is not a finite number.

    Examples
    --------
    >>> from eppanalysis.models.elements import Sine
    >>> mean, gain = Sine(scale=1.0).describing_function(amplitude=[0.0, 1.0])
    >>> gain.real.round(4).tolist()
    [1.0, 0.8801]
    """

    units = MappingProxyType({"scale": OUT})

    scale: float

    #: Minimum of sin(x)/x, at the first positive root of tan(x) = x, 4.493409...
    LEAST_RATIO: ClassVar[float] = -0.21723362821122166

    def __post_init__(self) -> None:
        require_numbers(self)

    def output(self, x: ArrayLike, memory: Any = None) -> tuple[Array, Any]:
        """Output for any array `x`; `memory` is handed through unused."""
        return self.scale * np.sin(floats(x, "output: x")), memory

    def describing_function(self, amplitude: ArrayLike, bias: ArrayLike = 0.0, omega: ArrayLike = 1.0) -> Answer:
        """Mean ``scale J0(A) sin b`` and gain ``scale 2 J1(A)/A cos b``, by the Jacobi-Anger expansion.

        Raises
        ------
        ModelError
            If an amplitude is negative.
        """
        from scipy.special import j0, j1

        a, b, _ = broadcast(amplitude, bias, omega)
        ratio = np.where(a > 0, 2 * j1(a) / np.where(a > 0, a, 1.0), np.where(a == 0, 1.0, np.nan))
        return np.asarray(self.scale * j0(a) * np.sin(b)), np.asarray(self.scale * ratio * np.cos(b), complex)

    def slope_bounds(self) -> tuple[float, float]:
        """Least and greatest slope."""
        return -abs(self.scale), abs(self.scale)

    def sector(self) -> tuple[float, float]:
        """Least and greatest ``y/x`` over all x."""
        ends = (self.scale, self.scale * self.LEAST_RATIO)
        return min(ends), max(ends)

    def thresholds(self, bias: float = 0.0) -> Array:
        """No amplitudes: the describing function has one form."""
        return np.zeros(0)

    linear_gain_is = "its slope at zero"

    def linear_gain(self) -> Array:
        """The slope at zero."""
        return np.array([[self.scale]])

    def automaton(self) -> Automaton:
        """One smooth mode."""
        return automata.smooth("sine", self.scale)
