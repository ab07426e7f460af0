"""Cycles of the averaged loop of one with sampled controllers, given as cycles of that one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from eppanalysis.models.systems.lure import LureSystem
from eppanalysis.models.systems.measured.loop import DataSystem
from eppanalysis.models.systems.sampled.averaged import AveragedSystem
from eppanalysis.results import LimitCycle

#: What controllers in the mean over where their samples fall do not tell.
LEFT_OUT = (
    "Sampled controllers are averaged over all phases of their samples, hold and delay included; aliasing and locking "
    "to the samples are left out."
)


def of_samples(system: AveragedSystem | DataSystem, cycle: LimitCycle) -> LimitCycle:
    """A predicted or balanced cycle with the state of the loop whose controllers are sampled, if it has states."""
    if not system.slowest:
        return cycle
    cycle = locking(cycle, system.slowest)
    if isinstance(system, DataSystem):
        return cycle
    state, memory = system.started(cycle.state, cycle.memory)
    return replace(cycle, state=state, memory=memory, mean_state=system.started(cycle.mean_state, ())[0])


def locking(cycle: LimitCycle, time_step: float) -> LimitCycle:
    """A predicted or balanced cycle with what samples [s] may change in its error.

    It may lock to the samples a whole one to either side, which no mean over their phases tells: two samples in its
    period are added to its error. An error that is not known stays so. Of fewer than two samples in its period all that
    counts is what they fold back: the cycle may not exist.
    """
    samples = cycle.period / time_step
    error = 2.0 / samples if samples >= 2.0 else float("inf")
    return replace(cycle, error_estimate=cycle.error_estimate + error)


def left_out(system: LureSystem, cycles: Sequence[LimitCycle]) -> tuple[str, ...]:
    """What the mean over the phases of the samples does not tell; nothing of a loop without samples."""
    if not isinstance(system, AveragedSystem | DataSystem) or not system.slowest:
        return ()
    turns = min((c.period / system.slowest for c in cycles), default=None)
    return (LEFT_OUT if turns is None else f"{LEFT_OUT} The fastest cycle has {turns:.3g} samples a turn.",)
