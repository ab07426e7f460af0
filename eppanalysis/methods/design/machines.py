"""A design in many machines: each with parameters of its own within the tolerances, and with a start of its own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from eppanalysis.methods.bounds.sizes.allowed import Allowed
from eppanalysis.methods.bounds.verify import PERIODS, cloud, rest_of, size_of
from eppanalysis.methods.continuation.seeds import steady_case
from eppanalysis.methods.design.shrinking import shrinks
from eppanalysis.methods.search.trigger import Judge
from eppanalysis.methods.simulation.batch import BatchResult, HybridStack, simulate_batch
from eppanalysis.models.systems.hybrid import HybridSystem
from eppanalysis.models.systems.subject import CaseLike
from eppanalysis.results import LimitCycle, Status


def machines_at_rest(
    cases: Sequence[CaseLike], cycle: LimitCycle, allowed: Allowed | None, rng: np.random.Generator
) -> int:
    """How many machines come to rest, or to a cycle that is allowed.

    Parameters
    ----------
    cases : sequence of Case
        The machines.
    cycle : LimitCycle
        At the bound of the design: it says how large the starts are and how long the runs.
    rng : Generator
        Of where they start.
    """
    hybrids = [steady_case(case) for case in cases]
    size = size_of(hybrids[0], cycle)
    judge = Judge(PERIODS * cycle.period, size)
    system = cases[0].to_system()
    for i, hybrid in enumerate(hybrids):
        start = cloud(hybrid, rest_of(hybrid, judge), system.v0, size, 1, int(rng.integers(2**31)))[0]
        hybrids[i] = replace(hybrid, x0=start)
    result = simulate_batch(HybridStack.of(hybrids, system.signals.names), judge.horizon)
    good = 0
    for i, status in enumerate(result.status):
        rests = status is Status.SETTLED or _allowed(result, i, allowed)
        good += rests or _in_the_end(judge, hybrids[i]) or shrinks(cases[i], hybrids[i].x0, cycle)
    return good


def _allowed(result: BatchResult, i: int, allowed: Allowed | None) -> bool:
    """Whether a run is on a cycle that may be, whatever its measure: rms is half the peak to peak at most."""
    if allowed is None or result.status[i] is not Status.LIMIT_CYCLE:
        return False
    return float(result.peak_to_peak[allowed.signal][i]) <= allowed.size or not allowed.counts(result.period)[i]


def _in_the_end(judge: Judge, hybrid: HybridSystem) -> bool:
    """Whether a run comes to rest when it is given more time."""
    status, _ = judge.ends(hybrid)
    return status is Status.SETTLED
