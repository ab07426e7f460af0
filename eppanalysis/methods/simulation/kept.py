"""What is kept of a run: signals, the last events, where it ended; what the codes of the engine mean."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from eppanalysis.arrays import Array, IntArray
from eppanalysis.models.systems.hybrid import DELAY_LINE, HybridSystem
from eppanalysis.readable import number
from eppanalysis.results import Status

#: By the codes of `engine/workspace.py` for runs that ended before their time, and of `engine/runs.py`.
EARLY = {
    1: Status.EVENT_LIMIT,
    2: Status.DIVERGED,
    3: Status.NOT_CONVERGED,
    4: Status.EVENT_LIMIT,
    5: Status.EVENT_LIMIT,
    6: Status.EVENT_LIMIT,
}
#: The last switches of a run, as a share of those kept, come this much closer where they accumulate than all did.
_LATE, _CLOSER = 0.1, 1e-6
#: So many events tell how large the last swings are; below this share of the whole motion it is said.
_FEW, _TINY = 64, 1e-4
VERDICTS = (Status.UNDECIDED, Status.SETTLED, Status.LIMIT_CYCLE, Status.DIVERGED)


@dataclass(frozen=True, eq=False)
class Run:
    """What one run left: signals, event buffer, least and greatest values of the states, end."""

    code: int
    samples: Array
    count: int
    time: Array
    guard: IntArray
    state: Array
    rate: Array
    memory_values: Array
    modes: IntArray
    low: Array
    high: Array
    x_end: Array
    rate_end: Array
    stats: Array

    @property
    def n_kept(self) -> int:
        """Events that the event buffer still holds."""
        return min(self.count, self.time.size)

    @cached_property
    def order(self) -> IntArray:
        """Places of the kept events in the buffer, oldest first."""
        places = np.arange(self.count - self.n_kept, self.count)
        return places % max(self.time.size, 1) if self.count > self.time.size else places

    def switches(self, start: HybridSystem) -> IntArray:
        """Places of the kept events of elements (an observer only marks extrema), oldest first."""
        return self.order[start.model.guard_element[self.guard[self.order]] < len(start.elements)]

    def end(self, start: HybridSystem) -> HybridSystem:
        """The system at its end, in the modes and with the memory values that it has then."""
        memory, modes, since = start.H0, start.modes0, 0.0
        if self.count:
            last = self.order[-1]
            memory, modes, since = self.memory_values[last], self.modes[last].copy(), float(self.time[last])
        return start.at(self.x_end.copy(), self._with_slopes(start, memory, since), modes)

    def _with_slopes(self, start: HybridSystem, memory: Array, since: float) -> Array:
        """Memory values with what the inputs changed to after the last event: the slopes of ramps are among them."""
        model, memory = start.model, memory.copy()
        for k in np.flatnonzero((model.breakpoint_time >= since) & (model.breakpoint_time <= self.stats[0])):
            memory[model.breakpoint_memory[k]] = model.breakpoint_slope[k]
        return memory

    def is_quiet_at(self, t: float) -> bool:
        """Whether it has met no event in the last half of the time t."""
        return not self.n_kept or bool(self.time[self.order[-1]] <= 0.5 * t)

    @property
    def is_out_of_events(self) -> bool:
        """Whether it ended early with many events, which do not accumulate."""
        return self.code == 1 and not self._accumulates

    @cached_property
    def _last_of_events(self) -> Array:
        """Times of the last events."""
        return self.time[self.order[-max(int(_LATE * self.n_kept), 2) :]]

    @property
    def _accumulates(self) -> bool:
        last = self._last_of_events
        return bool(np.ptp(last) <= _CLOSER * last[-1] / self.count * (last.size - 1))

    @property
    def _last_swings(self) -> float:
        """Size of the motion over the last events, relative to that of the whole run: of the state that moves most."""
        size = np.where(self.high > self.low, self.high - self.low, np.inf)
        return float((np.ptp(self.state[self.order[-_FEW:]], axis=0) / size).max(initial=0.0))

    def why_early(self, t_end: float) -> str:
        """Why a run has ended before its time, and what to do, in a sentence; empty for one that has not."""
        if EARLY.get(self.code) is not Status.EVENT_LIMIT:
            return ""
        reached = float(self.stats[0])
        stopped = f"The run stopped at {number(reached)} s"
        if self.code != 1:
            return (
                f"{stopped}: far faster motions, or a far smaller step, than its length allows took all its steps; "
                "shorten it or give more (max_steps)."
            )
        if self._accumulates:
            return f"{stopped}: its switches accumulate there, as the time between them shrinks to nothing."
        each = float(np.ptp(self._last_of_events)) / max(self._last_of_events.size - 1, 1)
        if self._last_swings < _TINY:
            return (
                f"{stopped}: it had used up all its events, the last in swings of {number(self._last_swings, 1)} of "
                f"the whole motion, one each {number(each)} s; hysteresis or a delay, as real switches have, would "
                "bound them."
            )
        return (
            f"{stopped}: it had used up all its events, one each {number(each)} s; shorten it or give some "
            f"{number((t_end - reached) / each, 2)} more (max_events)."
        )


def from_event(hybrid: HybridSystem, run: Run, place: int) -> tuple[HybridSystem, float]:
    """The system started behind an event of its run, and when that was [s].

    From the run's own start where the input still changes later, or where what is delayed must be known from before.
    """
    begin = float(run.time[place])
    if np.any(hybrid.model.breakpoint_time > begin) or np.any(hybrid.model.smooth_kind == DELAY_LINE):
        return hybrid, 0.0
    x, memory, modes = (a[place].copy() for a in (run.state, run.memory_values, run.modes))
    return hybrid.held.at(x, memory, modes), begin
