"""Where runs from many initial states end: at rest, or on which of the known limit cycles.

A witness against a search that misses cycles: every run must end on something known.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from eppanalysis.methods.batch import BatchResult, HybridStack, simulate_batch
from eppanalysis.methods.cycles import CycleSearch
from eppanalysis.methods.exact import steady_hybrid
from eppanalysis.models.lure import LureSystem
from eppanalysis.results import LimitCycle, Status

Array = NDArray[np.float64]

REST, UNDECIDED, LEAVES, UNKNOWN = -1, -2, -3, -4
#: Relative differences of the period, and of mean and peak-to-peak, within which a run's cycle is a known one. A batch
#: takes extrema from 512 samples, which see a corner of a signal to within a per cent.
_SAME_PERIOD, _SAME_SIZE = 1e-5, 2e-2
_PERIODS = 60.0
_LONGER = (1.0, 4.0, 16.0)


@dataclass(frozen=True, eq=False)
class Basin:
    """What became of each start.

    Attributes
    ----------
    starts : array, shape (N, n)
        Initial states.
    ends : int array, shape (N,)
        Number of the cycle on which the run ends; REST (-1), UNDECIDED (-2), LEAVES (-3: grows without bound), UNKNOWN
        (-4: on a cycle that is not among those known).
    """

    starts: Array
    ends: NDArray[np.int64]

    def count(self, end: int) -> int:
        """How many starts end so."""
        return int(np.sum(self.ends == end))


def basin(
    system: LureSystem,
    cycles: CycleSearch,
    starts: Array,
    input_value: Mapping[str, float] | None = None,
    *,
    threads: int = 1,
) -> Basin:
    """Where runs from `starts` end, by the cycles of a search.

    Parameters
    ----------
    system : LureSystem
        In continuous time.
    cycles : CycleSearch
    starts : array, shape (N, n)
        Initial states; held values are those of the system's start.
    input_value : mapping of str to float, optional
        Steady values of external inputs by name [SI].
    threads : int

    Returns
    -------
    Basin

    Raises
    ------
    EppError
        For a discrete-time system.

    Examples
    --------
    >>> import eppanalysis as epp
    >>> from eppanalysis.methods.basin import basin
    >>> loop = epp.LureSystem.from_tf(([5.0], [1.0, 2.0, 1.0, 0.0]), epp.RelayDeadZone(1.0))
    >>> found = epp.find_limit_cycles(loop)
    >>> unstable = found.unstable[0].state
    >>> basin(loop, found, np.array([0.9 * unstable, 1.1 * unstable])).ends.tolist()
    [-1, 1]
    """
    starts = np.atleast_2d(np.asarray(starts, float))
    ends = np.full(len(starts), UNDECIDED)
    horizon = _PERIODS * max((c.period for c in cycles), default=_slowest(system))
    for factor in _LONGER:
        left = np.flatnonzero(ends == UNDECIDED)
        if not left.size:
            break
        systems = [steady_hybrid(replace(system, x0=starts[i]), input_value) for i in left]
        result = simulate_batch(HybridStack.of(systems, system.signals.names), factor * horizon, threads=threads)
        ends[left] = [_end(cycles, result, i) for i in range(left.size)]
    return Basin(starts, ends)


def _slowest(system: LureSystem) -> float:
    """A long time of the linear part [s]."""
    rates = np.abs(np.linalg.eigvals(system.A)) if system.A.size else np.ones(1)
    slow = rates[rates > 1e-9 * max(float(rates.max()), 1e-300)]
    return 1.0 / float(slow.min()) if slow.size else 1.0


def _end(cycles: CycleSearch, result: BatchResult, i: int) -> int:
    status = result.status[i]
    if status is Status.LIMIT_CYCLE:
        means, sizes = ({k: float(v[i]) for k, v in group.items()} for group in (result.mean, result.peak_to_peak))
        return _number(cycles, float(result.period[i]), means, sizes)
    return {Status.SETTLED: REST, Status.DIVERGED: LEAVES}.get(status, UNDECIDED)


def _number(cycles: CycleSearch, period: float, means: Mapping[str, float], sizes: Mapping[str, float]) -> int:
    """Number of the stable cycle with that period, those means and those peak-to-peaks."""
    for j, cycle in enumerate(cycles):
        same = cycle.stable and abs(period / cycle.period - 1.0) < _SAME_PERIOD
        if same and all(_near(cycle, k, means[k], sizes[k]) for k in cycle.peak_to_peak):
            return j
    return UNKNOWN


def _near(cycle: LimitCycle, name: str, mean: float, size: float) -> bool:
    span = max(cycle.peak_to_peak[name], size)
    return abs(size - cycle.peak_to_peak[name]) <= _SAME_SIZE * span + 1e-9 and (
        abs(mean - cycle.mean[name]) <= _SAME_SIZE * span + 1e-9
    )
