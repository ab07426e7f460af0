"""From a steady motion to the LimitCycle that users see: waveform, harmonics, events, stability."""

from __future__ import annotations

import numpy as np

from eppanalysis.arrays import Array
from eppanalysis.methods.simulation.kept import Run
from eppanalysis.methods.simulation.period import about_zero, advance, advances, analyse_period
from eppanalysis.methods.simulation.runs import named_events, run_hybrid
from eppanalysis.methods.simulation.stability import describe, drifts, on_the_circle, verdict
from eppanalysis.methods.steady.closing import CLOSED
from eppanalysis.methods.steady.motion import SteadyMotion
from eppanalysis.models.systems.hybrid import HybridSystem
from eppanalysis.models.systems.lure import LureSystem
from eppanalysis.models.systems.starts import remembered
from eppanalysis.results import EXACT_ORBIT, LimitCycle, Status
from eppanalysis.results.provenance import Provenance

#: Distance of an event from the end of a period, relative to that, which is rounding.
_AT_END = 1e-12
BORDER = (
    "an element is where two of its pieces meet on a sample: a disturbance to either side has multipliers of its own"
)


def steady_cycle(
    system: LureSystem, steady: SteadyMotion, turn: tuple[HybridSystem, Run, int], rows: Array, period: float
) -> LimitCycle:
    """A motion that is closed as a cycle of its loop.

    Parameters
    ----------
    turn : tuple of (HybridSystem, Run, int)
        Once round: a start, which may be elsewhere than that of `steady`, a run from there over a period at least, and
        the place of the last event in it.
    rows : array, shape (k, N)
        States and memory values behind the start, behind events, and at the end.
    period : float
        [s].
    """
    start, run, last = turn
    marks = np.unique(np.concatenate([[0.0], run.time[: last + 1]]))
    marks = marks if marks[-1] > (1.0 - _AT_END) * period else np.append(marks, period)
    gained = advance(start, rows[-1] - rows[0])

    def sample(times: Array) -> Array:
        again = run_hybrid(start, float(marks[-1]), times, 2.0 * start.time_scale, 2 * run.count + 100, 1)
        signals = again.samples[: int(again.stats[2])]
        return signals - np.outer(times[: len(signals)], gained / period)

    n, shape = start.n_plant, analyse_period(marks, system.delays, start.time_scale, system.signals.names, sample)
    aside = about_zero(start, shape)
    shape = shape.moved(start.model.Yx[:, :n] @ aside)
    many, matrix = steady.one_of_many, steady.matrix
    values = None if steady.on_a_border and not many else steady.multipliers
    drifting = many and drifts(matrix, np.ones(len(matrix)))
    noise = steady.gap + np.finfo(float).eps * np.sqrt(last + 1.0)
    error = float("nan")
    if values is not None:
        inverse = np.linalg.pinv(matrix - np.eye(len(matrix)), rcond=1e-12)
        error = float(np.abs(inverse).sum(1).max(initial=0.0) * noise)
    on_circle = values is not None and on_the_circle(matrix, np.ones(len(matrix)), error, many)
    return LimitCycle(
        method=EXACT_ORBIT,
        status=Status.CONVERGED,
        period=period,
        mean=shape.mean,
        peak_to_peak=shape.peak_to_peak,
        harmonics=shape.harmonics,
        stable=None if values is None else verdict(values, many, drifting, on_circle),
        stability_criterion=BORDER if values is None else describe(values, many, drifting, on_circle),
        multipliers=values,
        residual=steady.gap,
        error_estimate=error,
        events=named_events(start, run.time[: last + 1], run.guard[: last + 1], run.modes[: last + 1]),
        time=shape.time,
        waveform=shape.waveform,
        state=start.x0[:n] + aside,
        memory=remembered(start, start.x0, start.H0, start.modes0),
        mean_state=rows[:-1, :n].mean(axis=0) + aside,
        event_states=rows[:-1, :n] + aside,
        units=system.signals.units_of_results(),
        note="; ".join(advances(system, gained, shape)),
        provenance=Provenance(EXACT_ORBIT, {"system": system.name}, {"residual": CLOSED}),
    )
