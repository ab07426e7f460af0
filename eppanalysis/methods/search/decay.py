"""Whether a run decays: its motion dies out, or dwindles, or drifts ever more slowly towards rest."""

from __future__ import annotations

import numpy as np

from eppanalysis.arrays import Array
from eppanalysis.methods.simulation.kept import Run
from eppanalysis.models.systems.hybrid import HybridSystem

#: Largest change of a state over a period, relative to its amplitude on a cycle, that counts as rest, and as slow
#: drift.
_STILL, DRIFT = 1e-6, 1e-2
#: Switches accumulate: the amplitude between them is taken over this many events, and is rest below this share of the
#: amplitude of the whole run.
_PILE, _PILED = 64, 1e-3
#: The amplitude decays when it is below this share of what it was at the oldest events that a run keeps.
_DWINDLES = 0.999


def died_out(start: HybridSystem, run: Run) -> bool:
    """Whether switches accumulate while the amplitude between them decays to rest."""
    if not run.n_kept:  # steps without number, but no switch
        return False
    smaller, now = dwindles(start, run)
    return smaller and now <= _PILED


def dwindles(start: HybridSystem, run: Run) -> tuple[bool, float]:
    """Whether the last events that a run keeps are smaller than the first, and their size relative to the whole run."""
    size = np.where(run.high > run.low, run.high - run.low, np.inf)
    before, now = ((np.ptp(run.state[part], axis=0) / size)[start.compared].max(initial=0.0) for part in (
        run.order[:_PILE], run.order[-_PILE:],
    ))  # fmt: skip
    return bool(now < _DWINDLES * before), float(now)


def decays(start: HybridSystem, run: Run, t: float, horizon: float, size: Array) -> bool:
    """Whether a run decays: its states move by rounding only, or drift ever more slowly through a band without gain.

    Parameters
    ----------
    t, horizon : float
        Length of the run, and of some forty periods of the cycles in question [s].
    size : array, shape (n,)
        How far the states move on such cycles.
    """
    size = np.maximum(size, np.abs(run.x_end - start.x0))[start.compared]
    if t - _last_motion(start, run, _STILL * size) < 0.3 * t:
        return False
    rate = np.abs(run.rate_end)[start.compared]
    # A state that grows is faster at the end of the run than on average.
    if np.any(rate * t > 2.0 * size + np.abs(run.x_end)[start.compared] * _STILL):
        return False
    return bool(np.all(rate * horizon / 40.0 <= (_STILL if t < 9.0 * horizon else DRIFT) * size))


def _last_motion(start: HybridSystem, run: Run, size: Array) -> float:
    """Time of the last event at which a state was farther than `size` from where the run ends [s].

    Rounding makes events at standstill where a drive creeps to a stop; they do not count.
    """
    away = np.abs(run.state[run.order] - run.x_end)[:, start.compared]
    moved = np.flatnonzero(np.any(away > size, axis=1))
    if moved.size:
        return float(run.time[run.order[moved[-1]]])
    return float(run.time[run.order[0]]) if run.count > run.n_kept else 0.0
