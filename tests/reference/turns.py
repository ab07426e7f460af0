"""Shooting on scipy's integrator: the elbow's return map from one top of the forearm's swing to the next alike.

The elbow of ``elbow_reference`` is given two more guards, at rest points of the forearm, that change nothing. A stable
cycle's return map contracts, so it is iterated: loosely at first, then to the integrator's tightest tolerance, until
a turn repeats the one before.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tests.reference.elbow_reference import Elbow, Mode
from tests.reference.events import Guard, Options, integrate

Array = NDArray[np.float64]

_TOP, _BOTTOM = "forearm at a top", "forearm at a bottom"
#: The forearm rests where its speed, relative to this [rad/s], is rounding.
_SPEED = 100.0
#: Places of the state that compare tops: all but the forearm's speed, which is zero there, and the delay's states.
_MOVING = [0, 2, 3, 4]
_LOOSE, _TIGHT = Options(1e-9, 1e-11), Options(1e-12, 1e-14)


class Watched(Elbow):
    """The elbow, with the rest points of its forearm among the events."""

    def __init__(self, p: dict[str, float]) -> None:
        super().__init__(p)
        self.rises = True
        self.seen: list[tuple[float, float, Array, Mode, bool]] = []

    def guards(self, mode: Mode) -> list[Guard]:
        """All guards of a mode, and the next rest point."""
        rest = Guard(_TOP, lambda t, y: -y[1], _SPEED) if self.rises else Guard(_BOTTOM, lambda t, y: y[1], _SPEED)
        return [*super().guards(mode), rest]

    def switch(self, t: float, y: Array, mode: Any, label: str) -> tuple[Array, Any]:
        """Nothing changes where the forearm rests."""
        if label not in (_TOP, _BOTTOM):
            return super().switch(t, y, mode, label)
        self.rises = label == _BOTTOM
        self.seen.append((t, float(y[0]), y.copy(), mode, label == _TOP))
        return y, mode


@dataclass(frozen=True)
class Turn:
    """Period [s], peak-to-peak of the forearm's angle [rad], and how far the last turn ends from where it began."""

    period: float
    peak_to_peak: float
    change: float


def closed_turn(p: dict[str, float], settle: float, most_turns: int = 14) -> Turn:
    """The stable cycle on which the elbow with parameters `p` is after `settle` seconds.

    Raises
    ------
    RuntimeError
        If no turn repeats the one before.
    """
    elbow = Watched(p)
    begin = integrate(Elbow(p), *elbow.start(), 0.05, np.zeros(0), _LOOSE)
    assert begin.end_state is not None
    elbow.rises = bool(begin.end_state[1] > 0.0)
    run = integrate(elbow, begin.end_state, begin.end_mode, settle, np.zeros(0), _LOOSE)
    y, mode = run.end_state, run.end_mode
    assert y is not None
    tops = [row for row in elbow.seen if row[4]]
    period = _period(tops[-12:])
    elbow.seen.clear()
    run = integrate(elbow, y, mode, most_turns * period, np.zeros(0), _TIGHT)
    tops = [row for row in elbow.seen if row[4]]
    last = tops[-1]
    before = min(tops[:-1], key=lambda row: abs(last[0] - row[0] - period))
    span = np.ptp([row[2][_MOVING] for row in elbow.seen], axis=0)
    change = float(np.max(np.abs(last[2] - before[2])[_MOVING] / span))
    if change > 1e-8 or last[3][:4] != before[3][:4]:
        raise RuntimeError(f"the last turn differs from the one before by {change:.3g} of the motion")
    angles = [row[1] for row in elbow.seen if before[0] <= row[0] <= last[0]]
    return Turn(float(last[0] - before[0]), float(np.ptp(angles)), change)


def _period(tops: list[tuple[float, float, Array, Mode, bool]]) -> float:
    """Time from the last top back to the one most like it."""
    last = tops[-1]
    away = [abs(row[1] - last[1]) + abs(row[2][2] - last[2][2]) for row in tops[:-1]]
    alike = [row for row, a in zip(tops, away, strict=False) if a < 3.0 * min(away) + 1e-3]
    return float(last[0] - alike[-1][0])
