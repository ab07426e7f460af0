"""Band laws that know the time: the parking logic, and a law that is evaluated once a sample period.

Both take two inputs, the cable force and a clock.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from eppanalysis.arrays import Array
from eppanalysis.errors import ModelError
from eppanalysis.models.elements import automata
from eppanalysis.models.elements.automaton import Automaton
from eppanalysis.models.elements.base import Answer, Nonlinearity
from eppanalysis.models.elements.piecewise import PiecewiseLinear
from eppanalysis.models.elements.static import FiveBandLaw


@dataclass(frozen=True)
class ParkingBandLaw(Nonlinearity):
    """Five-band law that parks: V = 0 after `dwell_time` inside the parking band, until the force exceeds F_high.

    Parameters
    ----------
    law : FiveBandLaw
        The law while not parked.
    dwell_time : float
        Time inside the parking band after which the elbow parks [s].

    Raises
    ------
    ModelError
        If `dwell_time` is not a positive finite number.
    """

    n_inputs: ClassVar[int] = 2
    input_ports = ("force", "clock")
    input_unit = "N"

    law: FiveBandLaw
    dwell_time: float

    def __post_init__(self) -> None:
        if not (math.isfinite(self.dwell_time) and self.dwell_time > 0):
            raise ModelError("ParkingBandLaw", self.dwell_time, "a positive number", field="dwell_time")

    def output(self, x: Any, memory: Any = None) -> tuple[float, tuple[bool, float]]:
        """Voltage for ``x = (force, clock)``; memory is (parked, clock at entry into the band), nan when outside.

        Between the last state and this one the force moves monotonically, so no band is crossed twice.
        """
        force, clock = float(x[0]), float(x[1])
        parked, entered = memory if memory is not None else (False, math.nan)
        inside = self.law.low <= force <= self.law.high
        if force > self.law.high:
            parked, entered = False, math.nan
        elif inside and math.isnan(entered):
            entered = clock
        elif not inside and not parked:
            entered = math.nan
        parked = parked or (not math.isnan(entered) and clock - entered >= self.dwell_time)
        voltage = 0.0 if parked else float(self.law.output(force)[0])
        return voltage, (parked, entered)

    def describing_function(self, amplitude: ArrayLike, bias: ArrayLike = 0.0, omega: ArrayLike = 1.0) -> Answer:
        """Closed form of the steady response to ``bias + amplitude sin(omega t)``.

        The force is inside the band from its fall through F_high to its fall through F_low. If that takes less than
        the dwell time nothing parks and the law is the plain one; if it takes longer (or if the force only ever enters
        from below and stays that long) the law below F_low is never reached.
        """
        amplitude, bias, omega = np.broadcast_arrays(
            np.asarray(amplitude, float), np.asarray(bias, float), np.asarray(omega, float)
        )
        with np.errstate(divide="ignore", invalid="ignore"):
            high = (self.law.high - bias) / amplitude
            low = (self.law.low - bias) / amplitude
        # A force that never rises above F_high turns round inside the band: it enters and leaves through F_low.
        passage = np.where(
            high < 1.0,
            np.arcsin(np.clip(high, -1, 1)) - np.arcsin(np.clip(low, -1, 1)),
            np.pi - 2.0 * np.arcsin(np.clip(low, -1, 1)),
        )
        # The way through the band against the dwell time (docs/theory/piecewise_linear.md, Laws that know the time).
        parks = passage >= self.dwell_time * omega
        mean, gain = self.law.describing_function(amplitude, bias, omega)
        parked_mean, parked_gain = self._flexion_only().describing_function(amplitude, bias, omega)
        return np.where(parks, parked_mean, mean), np.where(parks, parked_gain, gain)

    def _flexion_only(self) -> PiecewiseLinear:
        """The law with V = 0 below F_high."""
        keep = self.law.breakpoints >= self.law.high
        n = int(np.count_nonzero(keep))
        slopes = np.concatenate([[0.0], self.law.slopes[len(self.law.slopes) - n :]])
        intercepts = np.concatenate([[0.0], self.law.intercepts[len(self.law.intercepts) - n :]])
        return PiecewiseLinear(self.law.breakpoints[keep], slopes, intercepts)

    def automaton(self) -> Automaton:
        """Modes of the law, once awake and once parked."""
        law = self.law
        return automata.parking(law.breakpoints, law.slopes, law.intercepts, law.low, law.high, self.dwell_time)

    def start(self, automaton: Automaton, memory: Any = None) -> tuple[int, Array]:
        """Parked or not, with the clock at the entry into the band; a plain number is that clock, not parked."""
        parked, entered = memory if isinstance(memory, tuple) else (False, memory)
        mode, stored = super().start(automaton, None if entered is None or math.isnan(entered) else entered)
        return (self._parked if parked else mode), stored

    def memory_at(self, mode: int, stored: Array, x: Array, output: Array) -> tuple[bool, float]:
        """(parked, clock at entry into the band), nan when outside."""
        inside = mode == self._parked or self.law.low <= float(x[0]) <= self.law.high
        return mode == self._parked, float(stored[0]) if inside else math.nan

    @property
    def _parked(self) -> int:
        """Number of the mode that is parked, behind the pieces of the law."""
        return len(self.law.slopes)

    def thresholds(self, bias: float = 0.0) -> Array:
        """Those of the plain law."""
        return self.law.thresholds(bias)

    def slope_bounds(self) -> tuple[float, float]:
        """Those of the plain law: it parks where that gives no voltage, and wakes up where that begins to give one."""
        return self.law.slope_bounds()

    def sector(self) -> tuple[float, float]:
        """That of the plain law, and zero."""
        low, high = self.law.sector()
        return min(low, 0.0), max(high, 0.0)

    linear_gain_is = "the steepest slope of its law, before it parks"

    def linear_gain(self) -> Array:
        """That of the law, and nothing from the clock."""
        return np.hstack([self.law.linear_gain(), [[0.0]]])


@dataclass(frozen=True)
class SampledLaw(Nonlinearity):
    """A static law whose output is computed once a sample period and held in between.

    Parameters
    ----------
    law : PiecewiseLinear
        What is computed of the input at each sample.
    period : float
        Sample period [s].

    Raises
    ------
    ModelError
        If `period` is not a positive finite number.
    """

    n_inputs: ClassVar[int] = 2
    input_ports = ("input", "clock")

    law: PiecewiseLinear
    period: float

    def __post_init__(self) -> None:
        if not (math.isfinite(self.period) and self.period > 0):
            raise ModelError("SampledLaw", self.period, "a positive number", field="period")

    @property
    def input_unit(self) -> str:  # type: ignore[override]
        """That of the law."""
        return self.law.input_unit

    def output(self, x: Any, memory: Any = None) -> tuple[float, tuple[float, float]]:
        """Held output for ``x = (input, clock)``; memory is (held output, clock at the next reading)."""
        force, clock = float(x[0]), float(x[1])
        held, due = memory if memory is not None else (0.0, 0.0)
        if clock >= due:
            held = float(self.law.output(force)[0])
            due += self.period * (math.floor((clock - due) / self.period) + 1)
        return held, (held, due)

    def describing_function(self, amplitude: ArrayLike, bias: ArrayLike = 0.0, omega: ArrayLike = 1.0) -> Answer:
        """That of the law times the hold ``(1 - exp(-j omega h))/(j omega h)``, h the period.

        Exact in the mean over the phase between the sampling and the sine: the held output is the law's output delayed
        by a time that is spread evenly over one sample period.
        """
        mean, gain = self.law.describing_function(amplitude, bias, omega)
        half = np.asarray(omega, float) * self.period / 2
        return mean, gain * np.sinc(half / np.pi) * np.exp(-1j * half)

    def memory_of(self, output: Array) -> float | None:
        """The output itself."""
        return float(output[0])

    def start(self, automaton: Automaton, memory: Any = None) -> tuple[int, Array]:
        """Holding (output, clock at the next reading); a plain number is the output, with a reading at once."""
        mode, stored = super().start(automaton)
        given = np.atleast_1d(np.asarray(0.0 if memory is None else memory, float))
        stored[: given.size] = given
        return mode, stored

    def memory_at(self, mode: int, stored: Array, x: Array, output: Array) -> tuple[float, float]:
        """(held output, clock at the next reading)."""
        return float(stored[0]), float(stored[1])

    def automaton(self) -> Automaton:
        """One mode that holds, with a reset at every sample."""
        return automata.sampled(self.law.breakpoints, self.law.slopes, self.law.intercepts, self.period)

    def thresholds(self, bias: float = 0.0) -> Array:
        """Those of the law."""
        return self.law.thresholds(bias)

    def slope_bounds(self) -> tuple[float, float]:
        """Not bounded: between two samples the input may have come back."""
        return -np.inf, np.inf

    linear_gain_is = "the steepest slope of its law, without the lag of its sampling"

    def linear_gain(self) -> Array:
        """That of the law, and nothing from the clock."""
        return np.hstack([self.law.linear_gain(), [[0.0]]])
