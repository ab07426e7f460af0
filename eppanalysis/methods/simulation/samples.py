"""What a run with sampled controllers came to: it has samples for ever, and is looked at from one to another.

At rest: nothing has moved from sample to sample, nor between them, for the last tenth of the run. On a cycle that is
locked to the samples: a whole number of samples later the states and memory values are the same, or come to be so in
even steps. On a cycle that is not: turn by turn it comes back to where a switch was, a little beside it, without a
trend; its period and its size are then known to so much only as they differ from turn to turn. All else is undecided.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from eppanalysis.arrays import Array, BoolArray, IntArray
from eppanalysis.models.systems.sampled.strobe import Strobe
from eppanalysis.models.systems.starts import terms_of_memory
from eppanalysis.results import Status

if TYPE_CHECKING:
    from eppanalysis.methods.simulation.kept import Run

#: Share of a run that tells whether it rests, and the least number of samples in it.
_LAST, _FEWEST = 0.1, 3
#: Movement relative to that of the whole run that is none, and of a memory value relative to its size.
_REST, _ROUNDING = 1e-6, 1e-13
#: Largest change over the last period, all changes to come, and their ratio from one period to the next, relative to
#: the motion; and a change that is closed to rounding. Cycles that are not locked come back to within a few steps of a
#: sample, far farther away.
_CHANGE, _TO_COME, _FALLS, _CLOSED = 1e-6, 1e-5, 0.9, 1e-9
_NEAR = 1e-3
#: Fewest turns that show a cycle that is not locked, how far they may differ, relative to the motion and to their
#: length, and the share of their steps that is a trend.
_TURNS, _DIFFER, _TREND = 4, 0.15, 0.8


class Rows(NamedTuple):
    """States that must repeat and memory values, after the kept events of a run, and which are at the strobe."""

    values: Array  # (events, q)
    rates: Array  # (events, q) just before; of memory values zero
    size: Array  # (q,) in the whole run
    at: NDArray[np.intp]  # (k,) places of the samples


def rows_of(strobe: Strobe, run: Run) -> Rows:
    """What a run has at its kept events."""
    hybrid, order = strobe.hybrid, run.order
    held = strobe.held
    memory = run.memory_values[order][:, held]
    values = np.hstack([run.state[order][:, hybrid.compared], memory])
    rates = np.hstack([run.rate[order][:, hybrid.compared], np.zeros_like(memory)])
    moved = np.ptp(np.vstack([hybrid.H0[held], memory]), axis=0)
    last = order[-1]
    terms = terms_of_memory(hybrid, run.state[last], run.memory_values[last], run.modes[last])[held]
    floor = _ROUNDING / _REST * np.maximum(terms, np.abs(memory).max(axis=0, initial=0.0))
    size = np.concatenate([(run.high - run.low)[hybrid.compared], np.maximum(moved, floor)])
    at = np.flatnonzero(run.guard[order] == strobe.guard)
    return Rows(values, rates, size, at[::-1][:: max(strobe.every, 1)][::-1])


def judge_samples(strobe: Strobe, run: Run, t_end: float) -> tuple[Status, Array]:
    """Status of a run, and for a cycle: its events, period, change over the last period, extrapolated change.

    Where it is not locked, the shortest and the longest turn follow, and since when they are like that.
    """
    found = np.zeros(7)
    if run.n_kept == 0:
        return Status.UNDECIDED, found
    rows = rows_of(strobe, run)
    if _rests(strobe, run, rows, t_end):
        return Status.SETTLED, found
    period = locked_period(rows, run.guard[run.order]) if strobe.every else None
    if period is not None:
        n, change, to_come = period
        found[:4] = rows.at[-1] - rows.at[-1 - n], n * strobe.period, change, to_come
        return Status.LIMIT_CYCLE, found
    turns = _turns(strobe, run, rows, t_end)
    if turns is None:
        return Status.UNDECIDED, found
    places, differ = turns
    length = np.diff(run.time[run.order][places])
    since = run.time[run.order[places[0]]]
    found[:] = places[-1] - places[-2], length.mean(), differ, differ, length.min(), length.max(), since
    return Status.LIMIT_CYCLE, found


def is_locked(found: Array) -> bool:
    """Whether a cycle is locked to the samples."""
    return not found[5]


def extent_of(strobe: Strobe, run: Run, found: Array) -> Array:
    """Logarithms of the period of a run's cycle and of how far what repeats moves in it, shape (1 + free,)."""
    last = run.order[-int(found[0]) - 1 :] if is_locked(found) else run.order[run.time[run.order] >= found[6]]
    moved = np.ptp(np.hstack([run.state[last], run.memory_values[last]])[:, strobe.free], axis=0)
    return np.log(np.maximum([found[1], *moved], np.finfo(float).tiny))


def locked_or_not(strobe: Strobe, found: Array) -> str:
    """The relation of a cycle to the samples, in words."""
    n, sample_time = round(found[1] / strobe.period) * strobe.every if strobe.every else 0, _slowest(strobe)
    if is_locked(found):
        return f"locked to the samples: {n} of {sample_time:g} s"
    return (
        f"not locked to the samples of {sample_time:g} s: its periods are {_from_to(found[4], found[5])}, and its "
        f"states returned to within {100.0 * found[2]:.2g} % of their motion"
    )


def _from_to(least: float, most: float) -> str:
    """Lengths of periods, in four digits, or in seven where four do not tell them apart."""
    for digits in (4, 7):
        if (shown := [f"{turn:.{digits}g}" for turn in (least, most)])[0] != shown[1]:
            return f"{shown[0]} to {shown[1]} s"
    return f"{least:.4g} s"


def _slowest(strobe: Strobe) -> float:
    return strobe.controllers[0].sample_time


def _turns(strobe: Strobe, run: Run, rows: Rows, t_end: float) -> tuple[NDArray[np.intp], float] | None:
    """Places of a switch to which the last turns of a run came back, and how far they differ; None for no such turns.

    The rarest switches are tried first.
    """
    guards, time = run.guard[run.order], run.time[run.order]
    # How far all goes from each event to the end.
    spans = _reach(rows.values, np.maximum) - _reach(rows.values, np.minimum)
    for at in _rarest(guards, strobe.of_samples, time, t_end):
        values, scale = rows.values[at], spans[at[-_TURNS - 1]]
        scale = np.where(scale > _REST * rows.size, scale, np.inf)
        if not np.isfinite(scale).any():
            continue  # all of it is constant: what is left of a decay has no turns
        back = np.max(np.abs(values - values[-1]) / scale, axis=1) <= _DIFFER
        places, values = at[back], values[back]
        length = np.diff(time[places])
        if length.size < _TURNS or t_end - time[places[-1]] > (1.0 + _DIFFER) * np.median(length):
            continue
        even = np.abs(length / np.median(length) - 1.0) <= _DIFFER
        first = int(np.flatnonzero(~even)[-1]) + 1 if not even.all() else 0
        # The later half: before, what is left of the transient may show.
        first += max(min(places.size - first - _TURNS - 1, (places.size - first) // 2), 0)
        places, values = places[first:], values[first:]
        if places.size <= _TURNS:
            continue
        values = values / scale
        span = np.array([np.ptp(rows.values[a : b + 1], axis=0) / scale for a, b in pairwise(places)])
        if _trends(values) or _trends(span):
            continue
        differ = float(max(np.ptp(values, axis=0).max(), np.ptp(span, axis=0).max()))
        if differ <= 2.0 * _DIFFER:
            return places, differ
    return None


def _trends(turns: Array) -> bool:
    """Whether a column goes one way from turn to turn.

    What wanders goes to and fro; of a trend the way from the first turn to the last is nearly all its steps together.
    Of one that samples roughen, each turn beginning at another phase of theirs, a straight line is nearly all there is.
    """
    steps = np.abs(np.diff(turns, axis=0)).sum(axis=0)
    if np.any(np.abs(turns[-1] - turns[0]) > _TREND * steps + _CLOSED):
        return True
    count = np.arange(len(turns)) - 0.5 * (len(turns) - 1)
    away = turns - turns.mean(axis=0)
    along = (count @ away) ** 2 / (count @ count)
    return bool(np.any(along > _TREND * np.sum(away**2, axis=0) + _CLOSED**2))


def _reach(values: Array, of: np.ufunc) -> Array:
    return of.accumulate(values[::-1])[::-1]


def _rarest(guards: IntArray, of_samples: BoolArray, time: Array, t_end: float) -> Iterator[NDArray[np.intp]]:
    """Places of each switch that may have come back often enough until the end, the rarest switch first."""
    order = np.argsort(guards, kind="stable")
    first = np.flatnonzero(np.diff(guards[order], prepend=-1))
    at = np.split(order, first[1:])
    last, begin = time[order[np.append(first[1:], order.size) - 1]], time[order[first]]
    counts = np.diff(np.append(first, order.size))
    # Half of the turns that are compared at least are as long as the median: a switch that is longer past than these
    # can be has belonged to a transient. (An encoder passes thousands of edges in one.)
    recent = t_end - last <= (1.0 + _DIFFER) * 0.5 * (last - begin)
    for k in np.argsort(counts, kind="stable"):
        if counts[k] > _TURNS and recent[k] and not of_samples[guards[at[k][0]]]:
            yield at[k]


def _rests(strobe: Strobe, run: Run, rows: Rows, t_end: float) -> bool:
    """Whether nothing has moved for the last part of a run."""
    sample_time = strobe.controllers[0].sample_time
    # Samples never end, so that no time without an event tells (docs/theory/sampled.md, Verdict).
    last = max(_LAST * t_end, _FEWEST * sample_time)
    time = run.time[run.order]
    within = time >= t_end - last
    if not (t_end > last and time[0] <= t_end - last or run.count == run.n_kept) or np.sum(within) < _FEWEST:
        return False
    moved = np.ptp(rows.values[within], axis=0)
    # Of what chases a sample at a fixed rate the arc to it is as short as the step.
    lasts = np.minimum(np.diff(time, prepend=time[0] - sample_time), sample_time)[within]
    between = (np.abs(rows.rates[within]) * lasts[:, None]).max(axis=0)
    return bool(np.all(np.maximum(moved, between) <= _REST * rows.size))


def rests_since(strobe: Strobe, run: Run, found: Array) -> float:
    """Time of the last event at which a run was not yet where it rests, of those kept [s]; zero for none.

    On a cycle that is not locked, since when its turns are alike.
    """
    if found[0]:
        return float(found[6])
    rows = rows_of(strobe, run)
    moving = np.flatnonzero(np.any(np.abs(rows.values - rows.values[-1]) > _REST * rows.size, axis=1))
    # What is held comes to rest with the event behind the last at which it was not there yet.
    return float(run.time[run.order[min(moving[-1] + 1, run.order.size - 1)]]) if moving.size else 0.0


def locked_period(rows: Rows, guards: IntArray) -> tuple[int, float, float] | None:
    """Fewest samples after which a run repeats itself, its change over the last ones, and all to come; or None."""
    s, at = rows.values[rows.at], rows.at
    most = len(s) // 3
    if most < 1:
        return None
    away = np.abs(s[-1] - s[-2 : -2 - most : -1])
    near = away <= _NEAR * np.maximum(np.ptp(s[-most - 1 :], axis=0), rows.size)
    for n in (1 + np.flatnonzero(np.all(near, axis=1))).tolist():
        last, before = guards[at[-1 - n] + 1 : at[-1] + 1], guards[at[-1 - 2 * n] + 1 : at[-1 - n] + 1]
        if not np.array_equal(last, before):
            continue
        scale = np.maximum(np.ptp(rows.values[at[-1 - n] :], axis=0), _REST * rows.size)
        scale = np.where(scale > 0.0, scale, np.inf)
        d = [float(np.max(np.abs(_turn(s, n, k) - _turn(s, n, k + 1)) / scale)) for k in range(min(3, len(s) // n - 1))]
        # Even steps add up as a geometric series; the worse of two ratios counts, and a single one proves nothing.
        ratio = max([now / then for now, then in pairwise(d) if then > 0.0], default=1.0)
        to_come = d[0] * ratio / (1.0 - ratio) if ratio <= _FALLS and len(d) == 3 else np.inf
        if d[0] <= _CLOSED or (d[0] <= _CHANGE and to_come <= _TO_COME):
            return n, d[0], min(to_come, d[0])
    return None


def _turn(s: Array, n: int, k: int) -> Array:
    """The n samples of a turn, the last one for k = 0."""
    return s[len(s) - (k + 1) * n : len(s) - k * n]
