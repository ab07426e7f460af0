"""From a predicted unstable cycle to the exact one: the disturbance between growth and decay, bisected with the engine.

Along the line of starts from the mean of a prediction through its state, motions below an unstable cycle decay and
those above it grow (or the other way round). The basin boundary between both lies on the set of starts that lead to the
unstable cycle. Two runs, one from each side of the basin boundary, keep together while they are near that cycle; a turn
from the end of this time is where the exact orbit is closed from. A run of a few periods takes less than a millisecond.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from eppanalysis.arrays import Array
from eppanalysis.methods.orbits.guess import recurrences
from eppanalysis.methods.orbits.orbit import Orbit
from eppanalysis.methods.orbits.shooting import close_orbit
from eppanalysis.methods.simulation.kept import Run
from eppanalysis.methods.simulation.simulate import run_hybrid
from eppanalysis.models.systems.hybrid import HybridSystem

#: Factor between the starts among which a change from decay to growth is looked for, and how often it is applied.
_FACTOR, _MOST_FACTORS = 1.25, 9
_MOST_HALVINGS = 36
_MOST_EVENTS = 600
#: Turns of a run, and samples in each of the two turns whose sizes are compared.
_TURNS, _SAMPLES = 4.0, 24
#: Two runs keep together while their states at the same events differ by less than this share of the motion.
_TOGETHER = 0.05
#: Turns that two runs must keep together before an orbit is closed, and the factor on them after a failure.
_ENOUGH_TURNS, _MORE = 1.5, 1.3
#: How often an orbit is closed at most, from ever closer to the basin boundary.
_MOST_ATTEMPTS = 4


@dataclass(frozen=True, eq=False)
class _Side:
    """A run from the share s of the predicted oscillation, and whether it grows."""

    share: float
    run: Run
    grows: bool


def orbits_on_boundary(hybrid: HybridSystem, x: Array, centre: Array, memory: Array, period: float) -> Iterator[Orbit]:
    """Unstable orbits near the basin boundary between decay and growth on the line from `centre` through `x`.

    Parameters
    ----------
    x, centre : arrays, shape (n,)
        State on the prediction with inputs, and its mean.
    memory : array
        Memory values of the elements at `x`.
    period : float
        As predicted [s].

    Yields
    ------
    Orbit
        With a multiplier outside the unit circle and a period between half and 1.6 times the predicted one.
    """
    line = _Line(hybrid, centre, x - centre, memory, period)
    pair = line.bracket()
    if pair is None:
        return
    attempts, turns = _MOST_ATTEMPTS, _ENOUGH_TURNS
    for _ in range(_MOST_HALVINGS):
        together = _time_together(hybrid, *pair)
        # As long as both runs keep together they are near the unstable cycle; their last turn is closed.
        if together > turns * period:
            orbit = line.closed(pair[0], together)
            if orbit is not None:
                yield orbit
            attempts, turns = attempts - 1, _MORE * together / period
            if attempts == 0:
                return
        middle = line.at(0.5 * (pair[0].share + pair[1].share))
        if middle is None:
            return
        pair = (middle, pair[1]) if middle.grows == pair[0].grows else (pair[0], middle)


@dataclass(frozen=True, eq=False)
class _Line:
    """A line of starts."""

    hybrid: HybridSystem
    centre: Array
    direction: Array
    memory: Array
    period: float

    def start(self, share: float) -> HybridSystem:
        """The system started there."""
        return self.hybrid.at(self.centre + share * self.direction, self.memory, self.hybrid.modes0)

    def at(self, share: float) -> _Side | None:
        """Run from a start: does it grow from its second turn to its last? None for a run with too many events."""
        turn = self.period * np.arange(_SAMPLES) / _SAMPLES
        times = np.concatenate([self.period + turn, (_TURNS - 1.0) * self.period + turn])
        step = 2.0 * self.hybrid.time_scale
        run = run_hybrid(self.start(share), _TURNS * self.period, times, step, _MOST_EVENTS, _MOST_EVENTS)
        if run.count >= _MOST_EVENTS:
            return None
        if int(run.stats[2]) < times.size:
            return _Side(share, run, True)  # left every bound
        early, late = np.ptp(run.samples[:_SAMPLES], axis=0), np.ptp(run.samples[_SAMPLES:], axis=0)
        moves = early > 0
        growth = np.log((late[moves] + 1e-9 * early[moves]) / early[moves])
        return _Side(share, run, bool(growth.size) and float(growth.mean()) > 0)

    def bracket(self) -> tuple[_Side, _Side] | None:
        """Neighbouring starts of which one grows and the other does not."""
        side = self.at(1.0)
        factor = _FACTOR if side is None or not side.grows else 1.0 / _FACTOR
        for _ in range(_MOST_FACTORS):
            if side is None:
                return None
            other = self.at(side.share * factor)
            if other is not None and other.grows != side.grows:
                return side, other
            side = other
        return None

    def closed(self, side: _Side, together: float) -> Orbit | None:
        """An unstable orbit from the last turn of the time near the basin boundary."""
        run = run_hybrid(
            self.start(side.share), together, np.zeros(0), 2.0 * self.hybrid.time_scale, _MOST_EVENTS, _MOST_EVENTS
        )
        for guess in recurrences(self.hybrid, run, (0.5 * self.period, 1.6 * self.period), 2):
            orbit = close_orbit(self.hybrid, guess)
            if orbit is None or not 0.5 < orbit.period / self.period < 1.6:
                continue
            if np.any(np.abs(orbit.multipliers) > 1.0):
                return orbit
        return None


def _time_together(hybrid: HybridSystem, one: _Side, other: _Side) -> float:
    """Until when two runs meet the same events in nearly the same states [s]."""
    first, second = one.run.order, other.run.order
    count = min(first.size, second.size)
    if count == 0:
        return 0.0
    first, second = first[:count], second[:count]
    a, b = one.run.state[first][:, hybrid.compared], other.run.state[second][:, hybrid.compared]
    span = np.minimum(np.ptp(a, axis=0), np.ptp(b, axis=0))
    apart = np.max(np.abs(a - b) / np.where(span > 0, span, np.inf), axis=1, initial=0.0) > _TOGETHER
    apart |= one.run.guard[first] != other.run.guard[second]
    until = int(np.argmax(apart)) if apart.any() else count
    return float(one.run.time[first[until - 1]]) if until else 0.0
