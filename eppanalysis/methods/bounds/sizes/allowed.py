"""How large a limit cycle may be: a signal of the loop, peak to peak or rms about its mean, with its unit.

Most standards do not forbid a limit cycle, they bound it. What is allowed is said in one line, "theta 0.3 deg" or
"theta 0.1 deg rms"; sizes of exact orbits are exact (extrema and quadrature on their arcs), those of predictions are
those of a sinusoid. With a band of frequencies, "theta 0.3 deg within 1 Hz..8 Hz", only cycles of such a frequency are
bounded.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from enum import StrEnum
from typing import TYPE_CHECKING

import numpy as np

from eppanalysis.arrays import Array, BoolArray
from eppanalysis.errors import ArgumentError, did_you_mean, shown
from eppanalysis.methods.continuation.ranges import signal_sizes
from eppanalysis.methods.orbits.cycle import orbit_shape
from eppanalysis.methods.orbits.orbit import Orbit
from eppanalysis.models.systems.lure import LureSystem
from eppanalysis.readable import leading_name, quantity, readable
from eppanalysis.results import LimitCycle, PlainData, Status
from eppanalysis.units import QuantityError, parse_quantity

if TYPE_CHECKING:
    from eppanalysis.methods.simulation.batch import BatchResult


class Measure(StrEnum):
    """How the size of a cycle is measured."""

    PEAK_TO_PEAK = "peak to peak"
    RMS = "rms"


#: How a measure may be written behind a size.
_WRITTEN = {
    "peak to peak": Measure.PEAK_TO_PEAK,
    "peak-to-peak": Measure.PEAK_TO_PEAK,
    "rms": Measure.RMS,
}
_EXPECTED = (
    '"SIGNAL SIZE", as in "theta 0.3 deg"; add "rms" for a size that is not peak to peak, and "within 1 Hz..8 Hz" to '
    "bound only cycles of these frequencies"
)


@dataclass(frozen=True)
class Allowed(PlainData):
    """The largest stable limit cycle that is allowed.

    Attributes
    ----------
    signal : str
    size : float
        [SI unit of the signal]
    measure : Measure
    unit : str
        SI unit of the signal.
    band : (float, float), optional
        The frequencies of a cycle at which it counts [Hz]; by default all.
    """

    signal: str
    size: float
    measure: Measure = Measure.PEAK_TO_PEAK
    unit: str = ""
    band: tuple[float, float] | None = None

    def __str__(self) -> str:
        """As people say it."""
        within = "" if self.band is None else " within {:.4g} Hz to {:.4g} Hz".format(*self.band)
        return f"{self.signal} {self.text(self.size)}{within}"

    @property
    def exceeded(self) -> str:
        """What must not be, in words."""
        return f"stable limit cycle larger than allowed ({self})"

    @property
    def shown(self) -> tuple[str, float]:
        """The unit in which people read the signal, and the factor to it."""
        return readable(self.unit)

    def text(self, size: float) -> str:
        """A size in this measure."""
        return f"{quantity(size, self.unit)} {self.measure}"

    @classmethod
    def read(cls, system: LureSystem, text: str) -> Allowed:
        """What a line such as "theta 0.3 deg rms" allows in a loop.

        Parameters
        ----------
        text : str
            Signal and size, measure and band; plain numbers are SI.

        Raises
        ------
        EppError
            If the loop has no such signal, or the size is no positive quantity of its dimension.
        """
        words, _, within = text.strip().partition(" within ")
        measure = next((m for word, m in _WRITTEN.items() if words.endswith(f" {word}")), None)
        if measure is not None:
            words = next(words.removesuffix(word) for word in _WRITTEN if words.endswith(f" {word}"))
        names = system.signals.names
        signal, size = leading_name(words, names)
        if not signal or not size:
            raise ArgumentError("allow", f": {shown(text)} is no signal with a size; expected {_EXPECTED}.")
        if signal not in names:
            hint = did_you_mean(signal, names)
            raise ArgumentError(
                "allow", f": the loop has no signal {shown(signal)}; expected a signal of it: {hint.rstrip('?')}."
            )
        unit = system.signals.units_by_name()[signal]
        try:
            value = parse_quantity(size, unit)
        except QuantityError as error:
            raise ArgumentError("allow", f": {signal} is {shown(size)}; expected {error.expected}.") from None
        if not value > 0:
            raise ArgumentError("allow", f": {signal} is {shown(size)}; expected a positive size.")
        return cls(signal, value, measure or Measure.PEAK_TO_PEAK, unit, _band(within) if within else None)

    def within(self, size: float, period: float) -> float:
        """What a size counts as at a period: at most what is allowed outside the band, and that just on its edge.

        So what is too large begins at a root, of the size or of the frequency, that a branch can be followed to.
        """
        if self.band is None:
            return size
        low, high = self.band
        return min(size, self.size / (period * low), self.size * high * period)

    def counts(self, period: Array) -> BoolArray:
        """Whether cycles of these periods are bounded."""
        if self.band is None:
            return np.full(np.shape(period), True)
        return (period * self.band[0] < 1.0) & (period * self.band[1] > 1.0)

    def of_orbit(self, system: LureSystem, orbit: Orbit) -> float:
        """Size of an exact orbit [SI], exactly, as it counts."""
        return self.within(self.size_of_orbit(system, orbit), orbit.period)

    def size_of_orbit(self, system: LureSystem, orbit: Orbit) -> float:
        """Size of an exact orbit [SI], exactly, at whatever frequency."""
        if self.measure is Measure.RMS:
            return orbit_shape(system, orbit).rms[self.signal]
        return float(signal_sizes(system, orbit)[system.signals.names.index(self.signal)])

    def of_cycle(self, cycle: LimitCycle) -> float:
        """Size of a cycle as its method has it [SI], as it counts."""
        return self.within(self.size_of(cycle), cycle.period)

    def size_of(self, cycle: LimitCycle) -> float:
        """Size of a cycle as its method has it [SI], at whatever frequency."""
        if self.measure is Measure.PEAK_TO_PEAK:
            return cycle.peak_to_peak[self.signal]
        wave = cycle.waveform.get(self.signal)
        # Without a waveform the mean square is that of the harmonics, by Parseval.
        if wave is None or not wave.size:
            return float(np.sqrt(0.5 * np.sum(np.abs(cycle.harmonics[self.signal][1:]) ** 2)))
        time = np.append(cycle.time, cycle.time[0] + cycle.period)
        square = (np.append(wave, wave[0]) - cycle.mean[self.signal]) ** 2
        return float(np.sqrt(np.trapezoid(square, time) / cycle.period))

    def too_large(self, runs: BatchResult) -> BoolArray:
        """Which of many runs end on a cycle larger than allowed, by 512 samples of it."""
        on_cycle = np.array([status is Status.LIMIT_CYCLE for status in runs.status])
        return on_cycle & (self.size_of_runs(runs) > self.size) & self.counts(runs.period)

    def size_of_runs(self, runs: BatchResult) -> Array:
        """Sizes of the cycles that many runs end on [SI], at whatever frequency; zero at rest."""
        return (runs.peak_to_peak if self.measure is Measure.PEAK_TO_PEAK else runs.rms)[self.signal]

    def exceeded_by(self, cycle: LimitCycle) -> bool:
        """Whether a cycle is stable, as far as its method can tell, and larger than allowed."""
        return cycle.stable is not False and self.of_cycle(cycle) > self.size

    def largest(self, cycles: Iterable[LimitCycle]) -> LimitCycle | None:
        """The largest of the cycles that exceed it; None where none does."""
        return max(filter(self.exceeded_by, cycles), key=self.of_cycle, default=None)


def ends_of(runs: BatchResult, allowed: Allowed | None) -> list[Status]:
    """How many runs end, where a cycle that is allowed is as good as rest."""
    if allowed is None:
        return list(runs.status)
    good = (np.array([status is Status.LIMIT_CYCLE for status in runs.status]) & ~allowed.too_large(runs)).tolist()
    return [Status.SETTLED if rests else status for status, rests in zip(runs.status, good, strict=True)]


def _band(text: str) -> tuple[float, float]:
    """Frequencies as in "1 Hz..8 Hz" [Hz]."""
    low, dots, high = text.partition("..")
    try:
        band = parse_quantity(low.strip(), "Hz"), parse_quantity(high.strip(), "Hz")
    except QuantityError as error:
        raise ArgumentError(
            "allow", f": the band is {shown(text)}; expected {error.expected} on both sides of .."
        ) from None
    if not (dots and 0.0 < band[0] < band[1]):
        raise ArgumentError(
            "allow", f": the band is {shown(text)}; expected a low and a higher frequency, as in 1 Hz..8 Hz."
        )
    return band
