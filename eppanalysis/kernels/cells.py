"""Compiled: many loops of one structure, one after another, each to its verdict and the shape of its cycle.

Only what the caller keeps is kept: a buffer of the last events and one period of samples serve all cells in turn, so
memory does not grow with the number of cells.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from eppanalysis.kernels.compiling import KERNEL, PART, njit
from eppanalysis.kernels.engine.run import run
from eppanalysis.kernels.engine.workspace import PAUSED
from eppanalysis.kernels.filling import fill
from eppanalysis.kernels.simd.tuples import by_address, rows
from eppanalysis.kernels.verdict import CYCLE, SETTLED, verdict_of_run

SAMPLES = 512


@by_address
class Outcome(NamedTuple):
    """Results of cells (leading axis: cell)."""

    code: np.ndarray  # (cells,) int: how the run ended
    verdict: np.ndarray  # (cells,) int
    events: np.ndarray  # (cells,) int
    since: np.ndarray  # (cells,) time of the last event
    period: np.ndarray  # (cells,)
    change: np.ndarray  # (cells, 2): last and extrapolated change of the cycle
    mean: np.ndarray  # (cells, y)
    low: np.ndarray  # (cells, y)
    high: np.ndarray  # (cells, y)
    rms: np.ndarray  # (cells, y): about the mean
    stop: np.ndarray  # (1,) int: set, from another thread, to end before all cells are done


@njit(**KERNEL)
def run_cells(
    stack, compiled, work, workspace, none, period_samples, buffer, now, x0, modes0, H0, compared, base_step, first,
    last, out
):  # fmt: skip
    """Run cells first..last-1 of a stack of models; every result goes to its own place in `out`.

    A stack of one model serves all cells, and its mode combinations are compiled once.
    `none` and `period_samples` are Samples without and with SAMPLES + 1 times; mode combinations, work and workspace
    are those of any of the models, from these cells alone; `now` says when runs end.
    """
    n, keep = x0.shape[1], buffer.t.size
    x, modes, H, found, t_end = workspace.x, workspace.modes, workspace.H, np.empty(4), now.t_end
    times, signals = period_samples.times, period_samples.out
    one = len(stack.A) == 1
    for c in range(first, last):
        model = rows(stack, 0 if one else c)
        fill(x[:n], x0[c])
        fill(modes, modes0[c])
        fill(H, H0[c])
        if not one or base_step[c] != now.base_step:
            compiled.count[0] = 0
        now.base_step, now.t_end, now.watch, now.paused, code = base_step[c], t_end, True, False, PAUSED
        while code == PAUSED:
            if out.stop[0]:
                return
            code = run(model, compiled, work, workspace, none, buffer, now)
        count = now.count
        out.code[c], out.events[c] = code, count
        out.since[c] = buffer.t[(count - 1) % keep] if count > 0 else 0.0
        if code != 0:
            continue
        kind = verdict_of_run(
            model, buffer.t, buffer.guard, buffer.x, buffer.v, count, t_end, workspace.low, workspace.high, x,
            workspace.rate, compared, found,
        )  # fmt: skip
        out.verdict[c] = kind
        if kind == CYCLE:
            # The run to the verdict takes no samples: the last period is run once more, from where it began, for its
            # shape.
            p, period = int(found[0]), found[1]
            out.period[c], out.change[c, 0], out.change[c, 1] = period, found[2], found[3]
            k = (count - 1 - p) % keep
            fill(x[:n], buffer.x[k])
            fill(modes, buffer.modes[k])
            fill(H, buffer.H[k])
            for i in range(SAMPLES + 1):
                times[i] = period * i / SAMPLES
        elif kind == SETTLED:
            # A run of no length to speak of gives the signals where it stands.
            period = 1e-12 * t_end
            for i in range(SAMPLES + 1):
                times[i] = 2.0 * i * period
        else:
            continue
        now.t_end, now.watch, code = period, False, PAUSED
        while code == PAUSED and not out.stop[0]:
            code = run(model, compiled, work, workspace, period_samples, buffer, now)
        if kind == SETTLED:
            for whole in (out.mean, out.low, out.high):
                fill(whole[c], signals[0])
            out.rms[c, :] = 0.0
        else:
            _shape(signals, now.i_sample, out.mean[c], out.low[c], out.high[c], out.rms[c])
    now.t_end = t_end


@njit(**PART)
def _shape(signals, n, mean, low, high, rms):
    """Mean, extrema and rms of one period, sampled evenly; each extremum by a parabola through three samples."""
    for j in range(mean.size):
        total = 0.0
        top, bottom = 0, 0
        for i in range(n - 1):
            total += 0.5 * (signals[i, j] + signals[i + 1, j])
            if signals[i, j] > signals[top, j]:
                top = i
            if signals[i, j] < signals[bottom, j]:
                bottom = i
        mean[j] = total / (n - 1)
        total = 0.0
        for i in range(n - 1):
            total += 0.5 * ((signals[i, j] - mean[j]) ** 2 + (signals[i + 1, j] - mean[j]) ** 2)
        rms[j] = np.sqrt(total / (n - 1))
        high[j] = _refined(signals, n - 1, top, j)
        low[j] = _refined(signals, n - 1, bottom, j)


@njit(**PART)
def _refined(signals, n, i, j):
    a, b, c = signals[(i - 1) % n, j], signals[i, j], signals[(i + 1) % n, j]
    # The vertex of the parabola through three samples; flat ones have none.
    bend = a - 2.0 * b + c
    if bend == 0.0:
        return b
    shift = 0.5 * (a - c) / bend
    return b - 0.25 * (a - c) * shift if abs(shift) < 1.0 else b
