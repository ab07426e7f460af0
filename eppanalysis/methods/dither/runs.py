"""Runs of a loop with a dither at the input of one of its elements: whether the slow motion dies out or stays.

The dither is an input of the run as any other, a sine as two more states and a triangle by its corners, so that every
switch that it brings about is located. Seen once a period of the dither, at its phase zero, the motion is slow.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np

from eppanalysis.arrays import Array
from eppanalysis.errors import EppError
from eppanalysis.methods.dither.smoothed import Wave
from eppanalysis.methods.search.simulate import simulate
from eppanalysis.models.systems.inputs import InputSignal, Recorded, Sine
from eppanalysis.models.systems.lure import LureSystem
from eppanalysis.models.systems.signals import SignalMap
from eppanalysis.results import LimitCycle

#: Names of the input that carries the dither, and of the element's input before the dither is added.
_DITHER, _SLOW = "dither", "slow"
#: The first run in periods of the cycle, how often it is doubled; where its windows end, and how long they are.
_FIRST, _DOUBLED = 40.0, 4
_WINDOWS, _LENGTH = (0.25, 0.5, 1.0), 3.0
#: Share of the cycle's size below which it is gone, and the ratio of windows from which it shrinks no more.
GONE, _STAYS = 0.02, 0.995
_MOST_EVENTS = 2_000_000


class Start(StrEnum):
    """Where a run under dither begins: on the limit cycle, or as the loop itself does."""

    CYCLE = "cycle"
    OWN = "own"


@dataclass(frozen=True)
class DitherRun:
    """What is left of a limit cycle under a dither."""

    amplitude: float  # of the dither, in the unit of the element's input
    start: Start
    #: Peak-to-peak of the slow motion at the element's input in the last periods, relative to that of the cycle.
    left: float
    periods: float  # of the cycle that were run
    gone: bool | None  # whether it is gone; None where the run could not tell


@dataclass(frozen=True, eq=False)
class Rig:
    """A loop with a dither as its input, and the cycle that the dither is to remove."""

    #: With one more input, added at the element's input, and that input without the dither as its only signal.
    system: LureSystem
    cycle: LimitCycle
    frequency: float  # of the dither [Hz]
    wave: Wave  # {"sine", "triangle"}

    @classmethod
    def of(cls, system: LureSystem, number: int, cycle: LimitCycle, frequency: float, wave: Wave) -> Rig:
        """For a loop whose inputs are held where its `v0` has them, and the number of one of its elements."""
        row = system.input_slices[number].start
        nothing = np.zeros((system.A.shape[0], 1))
        at_input = np.eye(system.C.shape[0])[:, row : row + 1]
        D_input = system.D_input[row : row + 1]
        slow = SignalMap(
            (_SLOW,), system.C[row : row + 1], system.D[row : row + 1], np.append(D_input, [[0.0]], axis=1),
            system.constant_input[row : row + 1],
        )  # fmt: skip
        rigged = replace(
            system,
            signals=slow,
            B_input=np.append(system.B_input, nothing, axis=1),
            D_input=np.append(system.D_input, at_input, axis=1),
            input_names=(*system.input_names, _DITHER),
            v0=np.append(system.v0, 0.0),
            cuts=None,
            margins_at=(),
            given=None,
        )
        return cls(rigged, cycle, frequency, wave)

    def size_of_cycle(self) -> float:
        """Peak-to-peak of the element's input on the cycle, without dither."""
        times = np.linspace(0.0, self.cycle.period, 1001)
        return float(np.ptp(simulate(self._begun(Start.CYCLE), {}, self.cycle.period, times).signals[_SLOW]))

    def run(self, amplitude: float, start: Start, size: float) -> DitherRun:
        """What is left of the cycle in a run under a dither; longer runs are made until it tells."""
        made, left = 0.0, float("nan")
        for doubled in range(_DOUBLED + 1):
            periods = _FIRST * 2.0**doubled
            spans = self._spans(amplitude, start, periods)
            if spans is None:
                return DitherRun(amplitude, start, left, made, None)
            made, left = periods, float(spans[-1]) / size
            if left < GONE:
                return DitherRun(amplitude, start, left, made, True)
            if np.all(spans[1:] >= _STAYS * spans[:-1]):
                return DitherRun(amplitude, start, left, made, False)
        return DitherRun(amplitude, start, left, made, None)

    def removes(self, amplitude: float, size: float) -> tuple[DitherRun, ...]:
        """Runs from the cycle and from the loop's own start; the second one only where the first leaves nothing."""
        first = self.run(amplitude, Start.CYCLE, size)
        return (first, self.run(amplitude, Start.OWN, size)) if first.gone else (first,)

    def _begun(self, start: Start) -> LureSystem:
        if start is Start.OWN:
            return self.system
        return replace(self.system, x0=self.cycle.state, memory=self.cycle.memory)

    def _spans(self, amplitude: float, start: Start, periods: float) -> Array | None:
        """Peak-to-peak of the slow motion in three windows of a run, each twice as late; None where it ends early."""
        # Whole periods of the dither: seen once in each of them, what is left is the slow motion.
        end = np.ceil(periods * self.cycle.period * self.frequency)
        long = np.ceil(_LENGTH * self.cycle.period * self.frequency)
        counts = np.concatenate(
            [np.arange(np.ceil(share * end) - long, np.ceil(share * end) + 1) for share in _WINDOWS]
        )
        try:
            run = simulate(
                self._begun(start), {_DITHER: self._wave(amplitude, end)}, end / self.frequency,
                np.minimum(counts, end) / self.frequency, max_events=_MOST_EVENTS,
            )  # fmt: skip
        except EppError:
            return None
        seen = run.signals[_SLOW]
        if seen.size < counts.size or not np.all(np.isfinite(seen)):
            return None
        return np.ptp(seen.reshape(len(_WINDOWS), -1), axis=1)

    def _wave(self, amplitude: float, periods: float) -> InputSignal:
        if self.wave == "sine":
            return Sine(amplitude, self.frequency)
        corners = np.arange(2 * int(periods) + 2)
        times = np.append(0.0, (0.25 + 0.5 * corners) / self.frequency)
        return Recorded(times, np.append(0.0, amplitude * (-1.0) ** corners))
