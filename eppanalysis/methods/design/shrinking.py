"""Slow runs beside a fold: whether a motion has left the ghost of the cycle behind and still shrinks.

A per cent beside its fold a cycle is gone, but motions pass its ghost slowly, and with play behind an integrator what
is left decays like a power of time: no run of a finite length comes to rest. Such a run is looked at in windows, each
twice as late as the one before, the last of which must be below the size of the cycle at the fold: the last three
shrink, or none is larger than the one before and each smaller than that four times earlier (some motions shrink in
steps, and pause for longer than twice the time between them).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from eppanalysis.arrays import Array
from eppanalysis.methods.continuation.seeds import steady_case
from eppanalysis.methods.simulation.runs import run_hybrid
from eppanalysis.models.systems.subject import CaseLike
from eppanalysis.results import LimitCycle

#: The first run in periods of the cycle, how often it is doubled; its windows: how late they end, how long they are.
_FIRST, _DOUBLED = 800.0, 5
_WINDOWS, _LENGTH, _SAMPLES = (0.125, 0.25, 0.5, 1.0), 2.5, 400
#: A window must be smaller than the one four times earlier by this factor, and the last one than the cycle; what is
#: constant is so to this.
_SHRINKS, _BELOW, _STANDS = 0.98**2, 0.8, 1.001


def shrinks(case: CaseLike, x0: Array, cycle: LimitCycle) -> bool:
    """Whether the motion from a state ends below the size of a cycle, and becomes smaller with time.

    Parameters
    ----------
    x0 : array, shape (states,)
        State and inputs at the begin.
    cycle : LimitCycle
        The cycle at the fold nearby.
    """
    names = case.to_system().signals.names
    size = np.array([cycle.peak_to_peak[name] for name in names])
    moving = size > 0
    hybrid = replace(steady_case(case), x0=x0)
    t = _FIRST * cycle.period
    for _ in range(_DOUBLED):
        ends = t * np.array(_WINDOWS)
        times = (ends[:, None] + np.linspace(-_LENGTH * cycle.period, 0.0, _SAMPLES)).ravel()
        samples = run_hybrid(hybrid, t, times, 2.0 * hybrid.time_scale, 2_000_000, 600).samples
        if len(samples) < times.size or not np.all(np.isfinite(samples)):
            return False
        spans = np.ptp(samples.reshape(len(ends), _SAMPLES, -1), axis=1)[:, moving] / size[moving]
        largest = spans.max(axis=1)
        evenly = np.all(largest[2:] <= np.sqrt(_SHRINKS) * largest[1:-1])
        in_steps = np.all(largest[1:] <= _STANDS * largest[:-1]) and np.all(largest[2:] <= _SHRINKS * largest[:-2])
        if largest[-1] < _BELOW and (evenly or in_steps):
            return True
        t *= 2.0
    return False
