"""A relay with minimum times: a compressor, a burner or a pump that must run, and must rest, for a while.

It brings a clock, on which it remembers its last switch.
"""

from __future__ import annotations

from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from eppanalysis.arrays import Array
from eppanalysis.models.elements.automaton import Automaton, AutomatonBuilder
from eppanalysis.models.elements.base import IN, OUT, TIME, Answer, Nonlinearity
from eppanalysis.models.elements.dynamic.sampled import clock
from eppanalysis.models.elements.hysteresis import HysteresisRelay
from eppanalysis.models.elements.phases import (
    NOT_NEGATIVE,
    SMALLEST_AMPLITUDE,
    broadcast_with_frequency,
    require,
    require_numbers,
)


class TimedMemory(NamedTuple):
    """What a timed relay remembers: whether it is high, and the clock at its last switch [s]."""

    high: bool
    since: float


@dataclass(frozen=True)
class TimedRelay(Nonlinearity, kind="timed_relay"):
    """Relay with hysteresis that stays high, and low, for at least a time.

    It goes `high` where x is above `upper` once it has been low for `minimum_low`, and `low` where x is below `lower`
    once it has been high for `minimum_high`. At the start nothing is awaited.

    Parameters
    ----------
    lower, upper : float
        Where it goes low and high, `upper` at least `lower` [unit of the input].
    low, high : float, optional
        Outputs while low and high, `high` above `low` [unit of the output].
    minimum_high, minimum_low : float, optional
        Least time in a row that it is high, and low [s].

    Raises
    ------
    ModelError
        If `upper` is less than `lower`, `high` not above `low`, a time is negative or a field is not a finite number.

    Examples
    --------
    A compressor that rests for two minutes answers a swing of five minutes by less than a plain relay:

    >>> import numpy as np
    >>> from eppanalysis.models.elements import TimedRelay
    >>> relay = TimedRelay(-0.5, 0.5, low=0.0, high=1.0, minimum_low=200.0)
    >>> mean, gain = relay.describing_function(1.0, 0.0, 2 * np.pi / 300.0)
    >>> round(float(mean), 4), complex(gain.round(4))
    (0.3333, (0.2757-0.4775j))
    """

    of_frequency: ClassVar[bool] = True
    n_inputs: ClassVar[int] = 2
    units = MappingProxyType(
        {"lower": IN, "upper": IN, "low": OUT, "high": OUT, "minimum_high": TIME, "minimum_low": TIME}
    )

    lower: float
    upper: float
    low: float = -1.0
    high: float = 1.0
    minimum_high: float = 0.0
    minimum_low: float = 0.0

    def __post_init__(self) -> None:
        require_numbers(self, minimum_high=NOT_NEGATIVE, minimum_low=NOT_NEGATIVE)
        require(self, "upper", self.upper >= self.lower, "at least lower", "lower")
        require(self, "high", self.high > self.low, "above low", "low")
        object.__setattr__(self, "own_states", clock(1, 1))

    @property
    def without_times(self) -> HysteresisRelay:
        """The relay that it is without its times."""
        return HysteresisRelay(self.lower, self.upper, self.low, self.high)

    def output(self, x: Any, memory: Any = None) -> tuple[float, TimedMemory]:
        """Level for ``x = (input, clock)``, and :class:`TimedMemory`; one that is low without a memory."""
        value, time = float(x[0]), float(x[1])
        is_high, since = TimedMemory(False, -np.inf) if memory is None else memory
        least = self.minimum_high if is_high else self.minimum_low
        if time - since >= least and (value < self.lower if is_high else value > self.upper):
            is_high, since = not is_high, time
        return (self.high if is_high else self.low), TimedMemory(is_high, since)

    def describing_function(self, amplitude: ArrayLike, bias: ArrayLike = 0.0, omega: ArrayLike = 1.0) -> Answer:
        """Mean and gain of an answer that repeats with the sine; not a number where it takes several periods.

        Either the input makes it high and the time high may go on beyond the input, or the time low ends while the
        input is above `upper`.

        Raises
        ------
        ModelError
            If an amplitude or a frequency is negative.
        """
        a, b, w = broadcast_with_frequency(amplitude, bias, omega)
        a = np.where(a == 0, SMALLEST_AMPLITUDE, a)
        with np.errstate(invalid="ignore"):
            up, down = np.arcsin((self.upper - b) / a), np.pi - np.arcsin((self.lower - b) / a)
        on, off, turn = w * self.minimum_high, w * self.minimum_low, 2.0 * np.pi
        # High from the rise through `upper` on, until the input has fallen through `lower` and the time is over.
        later = np.maximum(down, up + on)
        begins_by_input = (later < np.pi - down + turn) & (turn - (later - up) >= off)
        # High from the end of the time low on, which is while the input is above `upper`.
        late = down + off - turn
        begins_by_time = (late > up) & (late < np.pi - up) & (turn - off >= on)
        first, last = np.where(begins_by_input, up, late), np.where(begins_by_input, later, down)
        jump = self.high - self.low
        both = (b + a > self.upper) & (b - a < self.lower)
        known = both & (begins_by_input | begins_by_time)
        gain = np.where(known, jump / (np.pi * a) * (np.exp(-1j * first) - np.exp(-1j * last)), np.nan)
        mean = np.where(known, self.low + jump * (last - first) / turn, np.nan)
        still_mean, still_gain = self.without_times.describing_function(a, b)
        return np.where(both, mean, still_mean), np.where(both, gain, still_gain)

    def automaton(self) -> Automaton:
        """Two levels, each held for its time and free; what has passed meanwhile is followed at once."""
        build = AutomatonBuilder(n_inputs=2, n_memory=1)
        levels = {"low": (self.low, self.minimum_low), "high": (self.high, self.minimum_high)}
        held, free = (
            {name: build.mode(f"{name}{state}", constant=level) for name, (level, _) in levels.items()}
            for state in (", waits", "")
        )
        switches = (("low", "high", 1.0, self.upper), ("high", "low", -1.0, self.lower))
        for before, after, sign, edge in switches:
            target = held[after] if levels[after][1] else free[after]
            build.guard(
                f"switches to {after}", free[before], target, on_input=[sign, 0.0], constant=-sign * edge,
                memory_from_input=[0.0, 1.0],
            )  # fmt: skip
            # The time is over where the clock is beyond the switch by so much.
            build.guard(
                f"{before} long enough", held[before], free[before], on_input=[0.0, 1.0], on_memory=-1.0,
                constant=-levels[before][1],
            )  # fmt: skip
        return build.build(free["low"])

    def start(self, automaton: Automaton, memory: Any = None) -> tuple[int, Array]:
        """The mode of a memory; what the clock has passed since is left at once."""
        stored = automaton.start_memory.copy()
        if memory is None:
            return automaton.start_mode, stored
        is_high, since = memory
        waits = np.isfinite(since) and bool(self.minimum_high if is_high else self.minimum_low)
        stored[0] = since if waits else 0.0
        return int(is_high) + (0 if waits else 2), stored

    def memory_at(self, mode: int, stored: Array, x: Array, output: Array) -> TimedMemory:
        """Whether it is high, and since when."""
        return TimedMemory(bool(mode % 2), float(stored[0]) if mode < 2 else -np.inf)

    def thresholds(self, bias: float = 0.0) -> Array:
        """Those of the relay without times."""
        return self.without_times.thresholds(bias)

    def slope_bounds(self) -> tuple[float, float]:
        """Infinite: it switches while its input rests."""
        return -np.inf, np.inf

    def sector(self) -> tuple[float, float]:
        """Infinite, as it may be at either level at any input."""
        return -np.inf, np.inf

    def linear_gain(self) -> Array:
        """None, as for any relay, and nothing from the clock."""
        return np.array([[np.inf, 0.0]])
