"""Where runs from many initial states end: at rest, or on which of the known limit cycles.

A witness against a search that misses cycles: every run must end on something known.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from eppanalysis.arguments import checked
from eppanalysis.arrays import Array, IntArray
from eppanalysis.methods.orbits.exact import range_of, steady_hybrid
from eppanalysis.methods.orbits.samples.locked import away
from eppanalysis.methods.search.result import CycleSearch
from eppanalysis.methods.search.trigger import Judge
from eppanalysis.methods.simulation.batch import BatchResult, HybridStack, simulate_batch
from eppanalysis.methods.simulation.runs import cycle_of_run, judge, run_hybrid
from eppanalysis.models.systems.hybrid import HybridSystem
from eppanalysis.models.systems.linear import slowest_pole
from eppanalysis.models.systems.lure import LureSystem
from eppanalysis.models.systems.sampled.strobe import Strobe, is_sampled
from eppanalysis.models.systems.subject import CaseLike, PointLike, standing
from eppanalysis.readable import count, listed
from eppanalysis.results import Result, Status
from eppanalysis.results.provenance import Provenance
from eppanalysis.shown import frame_of

if TYPE_CHECKING:
    import pandas
    from matplotlib.axes import Axes

REST, UNDECIDED, DIVERGES, UNKNOWN = -1, -2, -3, -4
_ENDS = {
    REST: "settled at rest",
    UNDECIDED: "undecided",
    DIVERGES: "growing without bound",
    UNKNOWN: "on a cycle that is not known",
}
#: Relative differences of the period, and of mean and peak-to-peak, within which a run's cycle is a known one. A batch
#: takes extrema from 512 samples, which see a corner of a signal to within a per cent.
_SAME_PERIOD, _SAME_SIZE = 1e-4, 2e-2
#: The same, as logarithms together, of cycles that are not locked to the samples, of which runs differ.
_ALIKE_UNLOCKED = 0.1
_PERIODS = 60.0
_LONGER = (1.0, 4.0, 16.0)


@dataclass(frozen=True, eq=False, repr=False)
class Basin(Result):
    """What became of each start.

    Attributes
    ----------
    starts : array, shape (N, n)
        Initial states.
    ends : int array, shape (N,)
        Number of the cycle on which the run ends; REST (-1), UNDECIDED (-2), DIVERGES (-3: grows without bound),
        UNKNOWN (-4: on a cycle that is not among those known).
    """

    starts: Array
    ends: IntArray

    def __str__(self) -> str:
        """How many starts end where."""
        parts = [f"{self.count(end)} {text}" for end, text in self.ends_in_words().items()]
        return f"{count(len(self.ends), 'start')}: {listed(parts)}." if parts else "No start was run (0 starts)."

    def ends_in_words(self) -> dict[int, str]:
        """What the numbers mean that are there, cycles first and counted from 1."""
        known = sorted({int(end) for end in self.ends}, key=lambda end: (end < 0, abs(end)))
        return {end: _ENDS.get(end, f"on cycle {end + 1}") for end in known}

    def to_frame(self) -> pandas.DataFrame:
        """The starts, one a row: the states, and where the run from there ends."""
        said = self.ends_in_words()
        states = [{f"state {i + 1}": value for i, value in enumerate(start)} for start in self.starts.tolist()]
        return frame_of([{**x, "end": said[int(end)]} for x, end in zip(states, self.ends, strict=True)])

    def in_brief(self) -> pandas.DataFrame:
        """The ends, one a row."""
        return frame_of([{"starts": self.count(end), "end": text} for end, text in self.ends_in_words().items()])

    @checked
    def plot(self, ax: Axes | None = None) -> Axes:
        """The starts by where they end."""
        return self.drawn("plot_basin", ax)

    def count(self, end: int) -> int:
        """How many starts end so."""
        return int(np.sum(self.ends == end))


def basin(
    system: LureSystem | CaseLike,
    cycles: CycleSearch,
    starts: Array,
    operating_point: PointLike | None = None,
    *,
    threads: int = 1,
) -> Basin:
    """Where runs from `starts` end, by the cycles of a search.

    Parameters
    ----------
    system : LureSystem or Case
        In continuous time; with sampled controllers runs are made one by one, and these begin with their own memory.
    starts : array, shape (N, n)
        Initial states; held values are those of the system's start.
    operating_point : OperatingPoint or mapping of str to float, optional
        Where the external inputs are held, or some of them by name [SI]; by default that of the search.

    Raises
    ------
    EppError
        For a discrete-time system.

    Examples
    --------
    >>> import eppanalysis as epp
    >>> from eppanalysis.methods.search.basin import basin
    >>> loop = epp.LureSystem.from_tf(
    ...     ([5.0], [1.0, 2.0, 1.0, 0.0]), epp.RelayDeadZone(1.0)
    ... )
    >>> found = epp.find_limit_cycles(loop)
    >>> unstable = found.unstable[0].state
    >>> basin(loop, found, np.array([0.9 * unstable, 1.1 * unstable])).ends.tolist()
    [-1, 1]
    """
    system, at = standing(system, operating_point or cycles.operating_point, "basin")
    starts = np.atleast_2d(np.asarray(starts, float))
    ends = np.full(len(starts), UNDECIDED)
    horizon = _PERIODS * max((c.period for c in cycles), default=_slowest(system))
    for factor in _LONGER:
        left = np.flatnonzero(ends == UNDECIDED)
        if not left.size:
            break
        systems = [steady_hybrid(replace(system, x0=starts[i]), at) for i in left]
        if is_sampled(system.elements):
            ends[left] = [_end_among_samples(system, cycles, start, factor * horizon) for start in systems]
            continue
        result = simulate_batch(HybridStack.of(systems, system.signals.names), factor * horizon, threads=threads)
        ends[left] = [_end(cycles, result, i) for i in range(left.size)]
    made_by = Provenance("runs from many starts", {"system": system.name}, statistics={"starts": len(starts)})
    if is_sampled(system.elements):
        return Basin(starts, ends, provenance=made_by)
    hybrid = steady_hybrid(system, at)
    oscillations = (range_of(hybrid, c) for c in cycles)
    size = np.max([np.ptp(starts, axis=0), *oscillations], axis=0)
    # What only drifts ever more slowly has no verdict, and rests.
    to = Judge(_LONGER[-1] * horizon, np.append(size, np.zeros(hybrid.x0.size - size.size)))
    for i in np.flatnonzero(ends == UNDECIDED):
        if to.ends(steady_hybrid(replace(system, x0=starts[i]), at))[0] is Status.SETTLED:
            ends[i] = REST
    return Basin(starts, ends, provenance=made_by)


def _end_among_samples(system: LureSystem, cycles: CycleSearch, start: HybridSystem, t: float) -> int:
    """Where one run of a loop with sampled controllers ends."""
    strobe = Strobe.of(start)
    most = 20_000 + (0 if strobe is None else strobe.samples_in(t))
    run = run_hybrid(start, t, np.zeros(0), 2.0 * start.time_scale, most, most)
    status, found = judge(start, run, t)
    if status is not Status.LIMIT_CYCLE:
        return {Status.SETTLED: REST, Status.DIVERGED: DIVERGES}.get(status, UNDECIDED)
    seen = cycle_of_run(system, start, run, found, Provenance("event-exact simulation"))
    if seen is None:
        return UNDECIDED
    near = [away(seen, cycle) if cycle.stable else np.inf for cycle in cycles]
    alike = _ALIKE_UNLOCKED if found[5] else _SAME_PERIOD
    return int(np.argmin(near)) if min(near, default=np.inf) < alike else UNKNOWN


def _slowest(system: LureSystem) -> float:
    """A long time of the linear part [s]."""
    return 1.0 / (slowest_pole(system.A) or 1.0)


def _end(cycles: CycleSearch, result: BatchResult, i: int) -> int:
    status = result.status[i]
    if status is Status.LIMIT_CYCLE:
        name = next(iter(result.mean))
        return _number(
            cycles, float(result.period[i]), float(result.mean[name][i]), float(result.peak_to_peak[name][i])
        )
    return {Status.SETTLED: REST, Status.DIVERGED: DIVERGES}.get(status, UNDECIDED)


def _number(cycles: CycleSearch, period: float, mean: float, size: float) -> int:
    """Number of the stable cycle with that period, and with that mean and peak-to-peak of the first signal."""
    for j, cycle in enumerate(cycles):
        name = next(iter(cycle.mean))
        span = max(cycle.peak_to_peak[name], size)
        apart = max(abs(size - cycle.peak_to_peak[name]), abs(mean - cycle.mean[name]))
        if cycle.stable and abs(period / cycle.period - 1.0) < _SAME_PERIOD and apart < _SAME_SIZE * span:
            return j
    return UNKNOWN
