"""The three regions of a design: free of cycles, guarded by an unstable one, and oscillating from rest.

Beyond its bound a design rests until a disturbance carries it over the unstable cycle; the region in which the case's
own input signal starts it from rest begins further on. That second boundary is found by runs, all on a grid at once.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from eppanalysis.errors import EppError
from eppanalysis.methods.bounds.harmonic import Question
from eppanalysis.methods.search.trigger import Trigger, trigger
from eppanalysis.methods.simulation.batch import HybridStack, simulate_batch
from eppanalysis.models.systems.hybrid import HybridSystem
from eppanalysis.models.systems.inputs import input_signals_by_name
from eppanalysis.results import Status

_GRID, _HALVINGS = 40, 3


def starts_from_rest(question: Question, bound: float, sign: float) -> float:
    """The value from which on the case's own run ends on a cycle [SI]; nan where it never does.

    Parameters
    ----------
    question : Question
        At one value of the parameter that runs.
    bound : float
        Where cycles begin to exist [SI].
    sign : {1, -1}
        1 where they exist above it.
    """
    end = question.high if sign > 0 else question.low
    inside, outside = bound, end
    for halving in range(_HALVINGS):
        count = _GRID if halving == 0 else 8
        values = np.geomspace(inside, outside, count)
        starting = _oscillating(question, values)
        if not np.any(starting):
            return float("nan") if halving == 0 else outside
        first = int(np.argmax(starting))
        if first == 0:
            return float(values[0])
        inside, outside = float(values[first - 1]), float(values[first])
    return outside


def _oscillating(question: Question, values: Sequence[float] | np.ndarray) -> np.ndarray:
    hybrids = []
    for value in np.asarray(values).tolist():
        case = question.case_at(value)
        system = case.to_system()
        hybrids.append(HybridSystem.from_lure(system, input_signals_by_name(system.input_names, case.input)))
    result = simulate_batch(HybridStack.of(hybrids, system.signals.names), question.case.t_end)
    return np.array([s is Status.LIMIT_CYCLE for s in result.status])


def smallest_trigger(question: Question, value: float) -> Trigger | None:
    """The smallest step of an external input that starts a cycle at a value of the limiting parameter; None if none."""
    system = question.case_at(value).to_system()
    try:
        found = [k for k in trigger(system) if k.name in system.input_names and np.isfinite(k.size)]
    except EppError:
        return None
    return min(found, key=lambda k: abs(k.size)) if found else None
