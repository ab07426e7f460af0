"""Cycles of the loop that stands for one with sampled controllers, told as cycles of that one."""

from __future__ import annotations

from dataclasses import replace

from eppanalysis.models.systems.sampled.averaged import AveragedSystem
from eppanalysis.results import LimitCycle

#: What controllers in the mean over where their samples fall do not tell.
LEFT_OUT = (
    "Sampled controllers stand as their mean over all phases of the samples, hold and delay included; what the samples "
    "fold back from beyond half their rate, and locking to them, is left out."
)


def of_samples(system: AveragedSystem, cycle: LimitCycle) -> LimitCycle:
    """A predicted or balanced cycle with the state of the loop whose controllers are sampled.

    It may lock to the samples a whole one to either side, which no mean over their phases tells: two samples in its
    period are added to its error. An error that is not known stays so.
    """
    state, memory = system.started(cycle.state, cycle.memory)
    mean_state = system.started(cycle.mean_state, ())[0]
    error = cycle.error_estimate + 2.0 * system.slowest / cycle.period
    return replace(cycle, state=state, memory=memory, mean_state=mean_state, error_estimate=error)
