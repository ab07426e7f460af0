"""Relays with hysteresis, of two levels and of three; their describing functions follow as those in `memory`."""

from __future__ import annotations

from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from eppanalysis.arguments import floats
from eppanalysis.arrays import Array
from eppanalysis.models.elements import automata
from eppanalysis.models.elements.automaton import Automaton
from eppanalysis.models.elements.base import IN, OUT, Answer, ClosedForm, Nonlinearity
from eppanalysis.models.elements.exact import Named, Reading
from eppanalysis.models.elements.phases import (
    POSITIVE,
    amplitude_and_bias,
    distances,
    level_ratios,
    require,
    require_numbers,
    with_nan,
)


class _Levels(Nonlinearity):
    """What a relay with hysteresis remembers: its level; a level is a mode of its automaton."""

    def start(self, automaton: Automaton, memory: Any = None) -> tuple[int, Array]:
        """The mode of the level nearest to the memory."""
        mode, stored = super().start(automaton)
        if memory is not None:
            mode = int(np.argmin([abs(m.constant[0] - float(memory)) for m in automaton.modes]))
        return mode, stored

    def memory_at(self, mode: int, stored: Array, x: Array, output: Array) -> Any:
        """The level."""
        return float(output[0])


def _relay(a: Array, b: Array, form: ClosedForm, undecided: float) -> tuple[Array, Array]:
    """Mean and gain of a hysteresis relay; `undecided` is the mean where the input reaches neither threshold."""
    (lower, upper), (low, _, high) = form.pieces[0], form.pieces[2]
    rises, falls = b + a > upper, b - a < lower
    both = rises & falls
    mean, gain, _ = form.described(a, b)
    mean = np.where(both, mean, np.where(rises, high, np.where(falls, low, undecided)))
    a = np.where(both, a, 1.0)
    return mean, np.where(both, gain - 1j * (form.loop / a / a), 0.0)


def _two_steps(lower: float, upper: float, low: float, high: float) -> ClosedForm:
    """A relay with hysteresis as the map with half of the jump at either threshold, and the area of its loop."""
    jump = high - low
    pieces = [lower, upper], [0.0, 0.0, 0.0], [low, low + jump / 2, high], [jump / 2, jump / 2]
    arrays = tuple(np.array(part, float) for part in pieces)
    for values in arrays:
        values.flags.writeable = False
    return ClosedForm(arrays, loop=jump * (upper - lower) / np.pi)


@dataclass(frozen=True)
class HysteresisRelay(_Levels, kind="hysteresis_relay"):
    """Relay that goes `high` when x rises through `upper` and `low` when x falls through `lower`.

    Parameters
    ----------
    lower, upper : float
        Where it goes low and high, `upper` at least `lower` [unit of the input].
    low, high : float, optional
        Outputs while low and high [unit of the output].

    Raises
    ------
    ModelError
        If `upper` is less than `lower` or a field is not a finite number.

    Examples
    --------
    >>> from eppanalysis.models.elements import HysteresisRelay
    >>> mean, gain = HysteresisRelay(lower=-0.5, upper=0.5).describing_function(
    ...     amplitude=1.0
    ... )
    >>> complex(gain.round(4))
    (1.1027-0.6366j)
    """

    units = MappingProxyType({"lower": IN, "upper": IN, "low": OUT, "high": OUT})

    lower: float
    upper: float
    low: float = -1.0
    high: float = 1.0

    def __post_init__(self) -> None:
        require_numbers(self)
        require(self, "upper", self.upper >= self.lower, "at least lower", "lower")

    def output(self, x: ArrayLike, memory: Any = None) -> tuple[Array, Array]:
        """Output level, which is also the memory; without memory the relay is `low` until x exceeds `upper`."""
        x = floats(x, "output: x")
        before = self.low if memory is None else memory
        y = np.where(x > self.upper, self.high, np.where(x < self.lower, self.low, before))
        return y, y

    def describing_function(self, amplitude: ArrayLike, bias: ArrayLike = 0.0, omega: ArrayLike = 1.0) -> Answer:
        """Mean and gain; an input that reaches neither threshold has the mean of both levels and gain 0.

        Raises
        ------
        ModelError
            If an amplitude is negative.
        """
        a, b = amplitude_and_bias(amplitude, bias, omega)
        form = _two_steps(self.lower, self.upper, self.low, self.high)
        return with_nan(a, b, *_relay(a, b, form, float(form.pieces[2][1])))

    @property
    def closed_form(self) -> ClosedForm | None:
        """That of a map with two steps; None without hysteresis."""
        form = _two_steps(self.lower, self.upper, self.low, self.high)
        return form if self.upper > self.lower and form.loop else None

    def thresholds(self, bias: float = 0.0) -> Array:
        """Distances of both thresholds from the bias; with it between them both are crossed from the greater one on."""
        return distances(self.lower - bias, self.upper - bias)

    def slope_bounds(self) -> tuple[float, float]:
        """Zero on a level, infinite where it goes to the other one."""
        return (-np.inf if self.high < self.low else 0.0), (np.inf if self.high > self.low else 0.0)

    def sector(self) -> tuple[float, float]:
        """Least and greatest ``y/x``: `low` up to the upper threshold, `high` from the lower one on."""
        return level_ratios((self.low, -np.inf, self.upper), (self.high, self.lower, np.inf))

    def exact(self, read: Reading) -> Named:
        """Exact numbers of its fields, for certificates."""
        if (self.lower, self.low) != (-self.upper, -self.high):
            return Named.of(self, "biased_relay", read, "lower", "upper", "low", "high")
        return Named("hysteresis_relay", {"threshold": read(self.upper), "level": read(self.high)})

    def automaton(self) -> Automaton:
        """Two modes, one a level."""
        return automata.hysteresis_relay(self.lower, self.upper, self.low, self.high)


@dataclass(frozen=True)
class HysteresisRelayDeadZone(_Levels, kind="hysteresis_relay_dead_zone"):
    """Odd three-level relay: ``+level`` once x > `on` until x < `off`, ``-level`` once x < ``-on`` until x > ``-off``.

    Parameters
    ----------
    on, off : float
        Where it switches on and off, ``0 <= off <= on`` [unit of the input].
    level : float, optional
        Output while on, positive [unit of the output].

    Raises
    ------
    ModelError
        If not ``0 <= off <= on`` with `on` and `level` positive.
    """

    units = MappingProxyType({"on": IN, "off": IN, "level": OUT})

    on: float
    off: float
    level: float = 1.0

    def __post_init__(self) -> None:
        require_numbers(self, on=POSITIVE)
        require(self, "off", 0 <= self.off <= self.on, "zero to on", "on")
        require(self, "level", self.level > 0, "a positive number")

    def output(self, x: ArrayLike, memory: Any = None) -> tuple[Array, Array]:
        """Output level, which is also the memory; without memory the relay is off."""
        x = floats(x, "output: x")
        before = 0.0 if memory is None else floats(memory, "output: memory")
        plus = (x > self.on) | ((before > 0) & (x >= self.off))
        minus = (x < -self.on) | ((before < 0) & (x <= -self.off))
        y = self.level * (plus.astype(float) - minus.astype(float))
        return y, y

    def describing_function(self, amplitude: ArrayLike, bias: ArrayLike = 0.0, omega: ArrayLike = 1.0) -> Answer:
        """Sum of two hysteresis relays; a side whose on-threshold the input does not pass counts as off.

        Raises
        ------
        ModelError
            If an amplitude is negative.
        """
        a, b = amplitude_and_bias(amplitude, bias, omega)
        plus_mean, plus_gain = _relay(a, b, _two_steps(self.off, self.on, 0.0, self.level), 0.0)
        minus_mean, minus_gain = _relay(a, b, _two_steps(-self.on, -self.off, -self.level, 0.0), 0.0)
        return with_nan(a, b, plus_mean + minus_mean, plus_gain + minus_gain)

    def thresholds(self, bias: float = 0.0) -> Array:
        """Distances of the four thresholds from the bias."""
        return distances(*(s * x - bias for s in (1, -1) for x in (self.on, self.off)))

    def slope_bounds(self) -> tuple[float, float]:
        """Zero on a level, infinite where it goes to another one."""
        return 0.0, np.inf

    def sector(self) -> tuple[float, float]:
        """Least and greatest ``y/x``: zero, and ``level/off`` (infinite where `off` is zero)."""
        return 0.0, self.level / self.off if self.off else np.inf

    def exact(self, read: Reading) -> Named:
        """Exact numbers of its fields, for certificates."""
        return Named.of(self, "hysteresis_relay_dead_zone", read, "on", "off", "level")

    def automaton(self) -> Automaton:
        """Three modes, one a level."""
        return automata.hysteresis_relay_dead_zone(self.on, self.off, self.level)
