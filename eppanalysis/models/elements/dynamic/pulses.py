"""Pulse-width modulation: one pulse a sample period, as wide as the input is large, with a dead time.

It brings a clock, on which it counts its samples.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from eppanalysis.arrays import Array
from eppanalysis.models.elements.automaton import Automaton, AutomatonBuilder
from eppanalysis.models.elements.base import IN, OUT, TIME, Answer, Nonlinearity
from eppanalysis.models.elements.dynamic.sampled import clock
from eppanalysis.models.elements.phases import (
    NOT_NEGATIVE,
    POSITIVE,
    broadcast_with_frequency,
    require,
    require_numbers,
)
from eppanalysis.models.elements.static import DeadZoneSaturation

_PLACE, _WEIGHT = np.polynomial.legendre.leggauss(24)


class PulseMemory(NamedTuple):
    """What a modulator remembers: the sign of its pulse (0 between pulses), its end and the next sample [s]."""

    sign: int = 0
    end: float = 0.0
    due: float = 0.0


class CarrierMemory(NamedTuple):
    """What a modulator with a carrier remembers: the sign of its pulse (0 between pulses) and the next sample [s]."""

    sign: int = 0
    due: float = 0.0


@dataclass(frozen=True)
class _Modulator(Nonlinearity):
    """What modulators have in common: fields, a clock, and the mean of their pulses."""

    of_frequency: ClassVar[bool] = True
    n_inputs: ClassVar[int] = 2
    units = MappingProxyType({"sample_time": TIME, "level": OUT, "full": IN, "dead_time": TIME})
    linear_gain_is = "the mean slope of its pulses"
    #: What it remembers: the sign of its pulse first, the next sample last.
    _memory_type: ClassVar[type[PulseMemory | CarrierMemory]]

    sample_time: float
    level: float
    full: float = 1.0
    dead_time: float = 0.0

    def __post_init__(self) -> None:
        require_numbers(self, sample_time=POSITIVE, level=POSITIVE, full=POSITIVE, dead_time=NOT_NEGATIVE)
        require(self, "dead_time", self.dead_time < self.sample_time, "less than sample_time", "sample_time")
        object.__setattr__(self, "own_states", clock(1, 1))

    @property
    def in_the_mean(self) -> DeadZoneSaturation:
        """The mean of a pulse over its period, by the input."""
        lost = self.dead_time / self.sample_time
        return DeadZoneSaturation(self.full * lost, self.level / self.full, self.level * (1.0 - lost))

    def _builder(self, n_memory: int) -> tuple[AutomatonBuilder, int, int, int, int]:
        """Modes between pulses, for no time where a sample is read, and in a pulse of either sign, with its samples."""
        build = AutomatonBuilder(n_inputs=2, n_memory=n_memory)
        off, reads = build.mode("between pulses"), build.mode("reads")
        up, down = build.mode("pulse up", constant=self.level), build.mode("pulse down", constant=-self.level)
        for mode in (off, up, down):
            build.guard("samples", mode, reads, on_input=[0.0, 1.0], on_memory=[*[0.0] * (n_memory - 1), -1.0])
        return build, off, reads, up, down

    def start(self, automaton: Automaton, memory: Any = None) -> tuple[int, Array]:
        """The mode of a memory; by default the first sample is at once."""
        sign, *times = self._memory_type() if memory is None else self._memory_type(*memory)
        return {0: automaton.start_mode, 1: 2, -1: 3}[int(sign)], np.array(times)

    def memory_at(self, mode: int, stored: Array, x: Array, output: Array) -> PulseMemory | CarrierMemory:
        """Sign of the pulse, its end where that is remembered, and the next sample."""
        return self._memory_type((0, 0, 1, -1)[mode], *stored.tolist())

    def thresholds(self, bias: float = 0.0) -> Array:
        """Where pulses begin, and where they are full."""
        return self.in_the_mean.thresholds(bias)

    def slope_bounds(self) -> tuple[float, float]:
        """Infinite: between two samples the input may have returned."""
        return -np.inf, np.inf

    def sector(self) -> tuple[float, float]:
        """Infinite, for the same reason."""
        return -np.inf, np.inf

    def linear_gain(self) -> Array:
        """The mean slope of its pulses, and nothing from the clock."""
        return np.array([[self.level / self.full, 0.0]])


@dataclass(frozen=True)
class PulseWidthModulator(_Modulator, kind="pulse_width_modulator"):
    """Pulses of the height `level` and the input's sign, one a sample, as wide as the input is large.

    At each sample of the input u, from time zero on, a pulse begins that lasts the fraction ``|u|/full`` of a period,
    one at most, less the dead time, in which a bridge holds both of its switches open; or none begins. Of a bridge
    whose current flows on meanwhile, the mean error is a :class:`Coulomb` of that current,
    ``level dead_time/sample_time``.

    Parameters
    ----------
    sample_time : float
        Period of the pulses [s], positive.
    level : float
        Height of a pulse, positive [unit of the output].
    full : float, optional
        Input of a pulse over the whole period, positive [unit of the input].
    dead_time : float, optional
        By how much each pulse is shorter, less than a period [s].

    Raises
    ------
    ModelError
        If a field is out of its range.

    Examples
    --------
    Its mean is that of a dead zone with a saturation, and it lags by half of a pulse:

    >>> from eppanalysis.models.elements import PulseWidthModulator
    >>> bridge = PulseWidthModulator(0.01, level=24.0, dead_time=0.001)
    >>> mean, gain = bridge.describing_function(0.5, 0.2, 100.0)
    >>> round(float(mean), 3), complex(gain.round(3))
    (4.166, (17.752-4.083j))
    """

    _memory_type = PulseMemory

    def output(self, x: Any, memory: PulseMemory | None = None) -> tuple[float, PulseMemory]:
        """Height for ``x = (input, clock)``, and :class:`PulseMemory`; samples that have become due read this input."""
        value, time = float(x[0]), float(x[1])
        sign, end, due = PulseMemory() if memory is None else memory
        if time >= due:
            due += self.sample_time * math.floor((time - due) / self.sample_time)
            width = self.sample_time * min(abs(value) / self.full, 1.0) - self.dead_time
            sign, end, due = int(np.sign(value)), due + max(width, 0.0), due + self.sample_time
        sign = sign if time < end else 0
        return self.level * sign, PulseMemory(sign, end, due)

    def describing_function(self, amplitude: ArrayLike, bias: ArrayLike = 0.0, omega: ArrayLike = 1.0) -> Answer:
        """Mean and gain, exact in the mean over the phase between samples and sine.

        A pulse of the width d adds ``(1 - exp(-j omega d))/(j omega)`` at its sample. Integrated by parts over the
        phase of the samples, the gain is ``2 level/(pi full)`` times the integral of ``exp(-j omega d) cos(theta)**2``
        over where the width grows.

        Raises
        ------
        ModelError
            If an amplitude or a frequency is negative.
        """
        a, b, w = broadcast_with_frequency(amplitude, bias, omega)
        mean, gain = self.in_the_mean.describing_function(a, b)[0], np.zeros(a.shape, complex)
        least = self.in_the_mean.dead_zone
        for sign in (1.0, -1.0):
            with np.errstate(divide="ignore", invalid="ignore"):
                sides = [
                    np.where(a > 0, (edge - sign * b) / a, np.sign(edge - sign * b)) for edge in (least, self.full)
                ]
            low, high = (np.arcsin(np.clip(side, -1.0, 1.0)) for side in sides)
            theta = low[..., None] + 0.5 * (high - low)[..., None] * (1.0 + _PLACE)
            size = sign * b[..., None] + a[..., None] * np.sin(theta)
            width = self.sample_time * size / self.full - self.dead_time
            turned = np.exp(-1j * w[..., None] * width) * np.cos(theta) ** 2
            gain += 0.5 * (high - low) * (turned @ _WEIGHT)
        return mean, np.asarray(2.0 * self.level / (np.pi * self.full) * gain, complex)

    def automaton(self) -> Automaton:
        """Between pulses, in one of either sign, and for no time where a sample is read.

        Memory values are the end of the pulse and the next sample, on the clock.
        """
        T, dead, full = self.sample_time, self.dead_time, self.full
        build, off, reads, up, down = self._builder(2)
        for mode in (up, down):
            build.guard("pulse ends", mode, off, on_input=[0.0, 1.0], on_memory=[-1.0, 0.0])
        # Of guards that are above zero the first one goes.
        for name, target, sign, least, slope, end in (
            ("begins a full pulse up", up, 1.0, full, 0.0, T - dead),
            ("begins a full pulse down", down, -1.0, full, 0.0, T - dead),
            ("begins a pulse up", up, 1.0, full * dead / T, T / full, -dead),
            ("begins a pulse down", down, -1.0, full * dead / T, -T / full, -dead),
            ("skips", off, 0.0, -1.0, 0.0, 0.0),
        ):
            build.guard(
                name, reads, target, on_input=[sign, 0.0], constant=-least,
                memory_from_input=[[slope, 1.0], [0.0, 1.0]], memory_constant=[end, T],
            )  # fmt: skip
        return build.build(off)


@dataclass(frozen=True)
class NaturalPulseWidthModulator(_Modulator, kind="natural_pulse_width_modulator"):
    """Pulses that end where a sawtooth meets the input: pulse-width modulation with a comparator, naturally sampled.

    Each period begins with a pulse of the input's sign, if it has one. The pulse ends where the sawtooth, which rises
    from zero to `full` over the period, has reached ``|u|``; with a dead time earlier by that. It is the modulator of
    analogue converters; :class:`PulseWidthModulator` holds the input of the sample, as digital ones do.

    Parameters
    ----------
    sample_time, level : float
        Period [s] and height of the pulses, positive [unit of the output].
    full : float, optional
        Height of the sawtooth, positive [unit of the input].
    dead_time : float, optional
        By how much each pulse is shorter, less than a period [s].

    Raises
    ------
    ModelError
        If a field is out of its range.

    Examples
    --------
    Its mean is that of a dead zone with a saturation, without a lag:

    >>> from eppanalysis.models.elements import NaturalPulseWidthModulator
    >>> bridge = NaturalPulseWidthModulator(0.01, level=24.0, dead_time=0.001)
    >>> mean, gain = bridge.describing_function(0.5, 0.2, 100.0)
    >>> round(float(mean), 3), complex(gain.round(3))
    (4.166, (18.452+0j))
    """

    _memory_type = CarrierMemory

    def output(self, x: Any, memory: CarrierMemory | None = None) -> tuple[float, CarrierMemory]:
        """Height for ``x = (input, clock)``, and :class:`CarrierMemory`."""
        value, time = float(x[0]), float(x[1])
        sign, due = CarrierMemory() if memory is None else memory
        if time >= due:
            due += self.sample_time * (1.0 + math.floor((time - due) / self.sample_time))
            sign = int(np.sign(value))
        width = self.sample_time * min(sign * value / self.full, 1.0) - self.dead_time
        sign = sign if time < due - self.sample_time + width else 0
        return self.level * sign, CarrierMemory(sign, due)

    def describing_function(self, amplitude: ArrayLike, bias: ArrayLike = 0.0, omega: ArrayLike = 1.0) -> Answer:
        """Mean and gain in the mean over the phase between samples and sine, those of :attr:`in_the_mean`.

        At any time the share of phases with a pulse is that of the sawtooth below the input: exact while the sine is
        nowhere steeper than the sawtooth.

        Raises
        ------
        ModelError
            If an amplitude or a frequency is negative.
        """
        a, b, _ = broadcast_with_frequency(amplitude, bias, omega)
        return self.in_the_mean.describing_function(a, b)

    def automaton(self) -> Automaton:
        """Between pulses, in one of either sign, and for no time where one is read; it remembers the next sample."""
        T, dead, full = self.sample_time, self.dead_time, self.full
        build, off, reads, up, down = self._builder(1)
        for mode, sign in ((up, 1.0), (down, -1.0)):
            build.guard("pulse ends", mode, off, on_input=[-sign * T / full, 1.0], on_memory=[-1.0], constant=T + dead)
            if dead > 0.0:
                build.guard("full pulse ends", mode, off, on_input=[0.0, 1.0], on_memory=[-1.0], constant=dead)
        for name, target, sign, least in (
            ("begins a pulse up", up, 1.0, full * dead / T),
            ("begins a pulse down", down, -1.0, full * dead / T),
            ("skips", off, 0.0, -1.0),
        ):
            build.guard(
                name, reads, target, on_input=[sign, 0.0], constant=-least, memory_from_input=[[0.0, 1.0]],
                memory_constant=[T],
            )  # fmt: skip
        return build.build(off)
