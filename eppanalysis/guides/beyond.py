"""What a design does beyond its bound: it rests unless struck, or its own run ends in an oscillation.

Beyond its bound a design may rest until a disturbance carries it over an unstable cycle; the region in which the
case's own start and input lead to the oscillation begins further on. Both are found by runs, all on a grid at once;
where a run is not decided, neither is said.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from eppanalysis.errors import EppError
from eppanalysis.methods.bounds.balanced import BoundProblem, spread
from eppanalysis.methods.bounds.sizes.allowed import Allowed, ends_of
from eppanalysis.methods.search.find import find_limit_cycles
from eppanalysis.methods.search.trigger import Trigger, trigger
from eppanalysis.methods.simulation.batch import HybridStack, simulate_batch
from eppanalysis.models.systems.hybrid import HybridSystem
from eppanalysis.models.systems.inputs import input_signals_by_name
from eppanalysis.results import Status

_GRID, _HALVINGS = 40, 3


@dataclass(frozen=True)
class OwnRuns:
    """What the case's own run does beyond a bound."""

    #: The last value up to which it comes to rest (or to a cycle that is allowed) wherever it was tried [SI]; nan where
    #: it does not at the first.
    rests_to: float = math.nan
    #: The value from which on it ends on a cycle (that is larger than allowed) [SI]; nan where it never does.
    oscillates_from: float = math.nan


def own_runs(question: BoundProblem, bound: float, sign: float, allowed: Allowed | None = None) -> OwnRuns:
    """What the case's own run does from a bound to the end of the range; a cycle that is allowed is as good as rest.

    Raises
    ------
    EppError
        If the loop has no form that is run in batches, as one with sampled controllers.
    """
    inside, outside = bound, question.ends(sign)[1]
    rests_to = math.nan
    for halving in range(_HALVINGS):
        values = spread(inside, outside, _GRID if halving == 0 else 8)
        ends = _ends(question, values, allowed)
        rests = next((i for i, status in enumerate(ends) if status is not Status.SETTLED), len(ends))
        # Only where all up to the bracket came to rest may a finer
        # row push `rests_to` on; an undecided run stays its end.
        if rests and (halving == 0 or rests_to == inside):
            rests_to = values[rests - 1]
        starting = [status is Status.LIMIT_CYCLE for status in ends]
        if not any(starting):
            return OwnRuns(rests_to, math.nan if halving == 0 else outside)
        first = starting.index(True)
        if first == 0:
            return OwnRuns(rests_to, values[0])
        inside, outside = values[first - 1], values[first]
    return OwnRuns(rests_to, outside)


def _ends(question: BoundProblem, values: Sequence[float], allowed: Allowed | None) -> list[Status]:
    """How the case's own run ends at values of the limiting parameter; a cycle that is allowed counts as rest."""
    hybrids = []
    for value in values:
        case = question.case_at(value)
        system = case.to_system()
        hybrids.append(HybridSystem.from_lure(system, input_signals_by_name(system.input_names, case.input)))
    return ends_of(simulate_batch(HybridStack.of(hybrids, system.signals.names), question.case.t_end), allowed)


def smallest_trigger(question: BoundProblem, value: float, allowed: Allowed | None = None) -> Trigger | None:
    """The smallest step of an external input that starts a cycle at a value of the limiting parameter; None if none.

    Where a size is allowed also none, unless all stable cycles are larger: on which of them a run is does not matter.
    """
    system = question.case_at(value).to_system()
    try:
        cycles = find_limit_cycles(system)
        if allowed is not None and not all(map(allowed.exceeded_by, cycles.stable)):
            return None
        found = [k for k in trigger(system, cycles=cycles) if k.name in system.input_names and math.isfinite(k.size)]
    except EppError:
        return None
    return min(found, key=lambda k: abs(k.size)) if found else None
