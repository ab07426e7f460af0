"""Where exact orbits start from: stretches of a run that nearly return to their begin.

A stretch gives the cyclic sequence of events, the state behind the first and the dwell times between them.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from eppanalysis.arrays import Array, IntArray
from eppanalysis.engine.tables import Model
from eppanalysis.errors import ModelError
from eppanalysis.methods.orbits.arcs import LETS_GO, Arcs, EventSequence
from eppanalysis.methods.simulation.budget import spend
from eppanalysis.methods.simulation.kept import Run
from eppanalysis.methods.steady.motion import SteadyMotion
from eppanalysis.models.systems.hybrid import DELAY_LINE, HybridSystem

#: An orbit with more arcs is not closed: the time that Newton's method takes goes with the cube of their number, and
#: switches that pile up without end look like one.
MOST_ARCS = 120
#: Steps of the engine that it is worth to compare two events of a run.
_PAIR = 0.1


@dataclass(frozen=True, eq=False)
class Guess:
    """An orbit before it is closed: sequence of events, start ``y`` behind the last of them, dwell times [s].

    `origin` are the arcs, with their model, from which the sequence has been marked: a loop of the same model has them.
    """

    event_sequence: EventSequence
    y: Array
    tau: Array
    origin: tuple[Model, Arcs] | None = None

    def arcs(self, hybrid: HybridSystem) -> Arcs:
        """The arcs of its sequence in a system.

        Raises
        ------
        ModelError
            As :meth:`Arcs.build`.
        """
        if self.origin is not None and self.origin[0] is hybrid.model:
            return replace(self.origin[1], event_sequence=self.event_sequence)
        return Arcs.build(hybrid, self.event_sequence)

    def own_arcs(self, hybrid: HybridSystem, unmarked: EventSequence) -> Arcs | None:
        """The arcs from which it has been marked, where they are those of a sequence in a system."""
        of, arcs = self.origin or (None, None)
        return arcs if arcs and of is hybrid.model and arcs.event_sequence.key == unmarked.key else None

    @property
    def period(self) -> float:
        """Sum of the dwell times [s]."""
        return float(self.tau.sum())


def first_return(hybrid: HybridSystem, run: Run, y: Array, guess: Guess) -> Guess | None:
    """From a run that began at y where a guess does: the stretch to that event's best return after about a period."""
    order, modes, guard = run.order, guess.event_sequence.modes[0], int(guess.event_sequence.guards[-1])
    if run.n_kept == 0 or run.count > run.n_kept:
        return None
    time = run.time[order]
    same = (run.guard[order] == guard) & np.all(run.modes[order] == modes, axis=1)
    places = np.flatnonzero(same & (np.abs(time / guess.period - 1.0) < 0.5))
    if places.size == 0:
        return None
    n = hybrid.x0.size
    span = np.ptp(run.state[order][:, hybrid.compared], axis=0)
    away = np.abs(run.state[order[places]] - y[:n])[:, hybrid.compared] / np.where(span > 0, span, np.inf)
    last = int(places[np.argmin(np.max(away, axis=1))])
    before = order[:last]
    starts = np.vstack([y[: n + hybrid.H0.size], np.hstack([run.state[before], run.memory_values[before]])])
    tau = np.diff(time[: last + 1], prepend=0.0)
    return make_guess(hybrid, np.vstack([modes, run.modes[before]]), run.guard[order[: last + 1]], starts, tau, guess)


def guess_along(found: SteadyMotion) -> Guess | None:
    """The events of a steady motion, an observer's among them; None where there are none, or too many."""
    whole, hybrid = found.whole(), found.start
    if whole is None:
        return None
    met = [(one.run, one.run.order) for one in whole.passes]
    times = np.concatenate([begin + run.time[order] for begin, (run, order) in zip(whole.begins, met, strict=True)])
    if times.size == 0:
        return None
    guards = np.concatenate([run.guard[order] for run, order in met])
    modes = np.vstack([run.modes[order] for run, order in met])
    behind = np.vstack([np.hstack([run.state[order], run.memory_values[order]]) for run, order in met])
    tau = np.diff(times, prepend=times[-1] - whole.duration)
    return make_guess(hybrid, np.roll(modes, 1, axis=0), guards, np.roll(behind, 1, axis=0), tau)


def make_guess(
    hybrid: HybridSystem, modes: IntArray, guards: IntArray, starts: Array, tau: Array, like: Guess | None = None
) -> Guess | None:
    """A guess from what a run met, None for one of too many arcs; delayed switches are put in for dead time.

    Parameters
    ----------
    modes, guards : int arrays, shapes (p, elements), (p,)
        Modes on each arc, guard at its end.
    starts : array, shape (p, n + memory)
        State and memory values at the beginning of each arc.
    tau : array, shape (p,)
        Dwell times [s].
    like : Guess, optional
        One whose arcs serve, where the sequences are the same.
    """
    if guards.size > MOST_ARCS:
        return None
    it = EventSequence(modes, guards, np.full((guards.size, 3), -1), brought_about(hybrid.model, guards, tau))
    if np.any(hybrid.model.smooth_kind == DELAY_LINE):
        try:
            return _delayed_guess(hybrid, it, starts[0], tau)
        except ModelError:  # what is delayed moves
            return Guess(it, starts[0].copy(), tau)
    try:
        arcs = (None if like is None else like.own_arcs(hybrid, it)) or Arcs.build(hybrid, it)
    except ModelError:
        return None
    return Guess(marked(arcs, starts, tau), starts[0].copy(), tau, (hybrid.model, arcs))


def brought_about(model: Model, guards: IntArray, tau: Array) -> IntArray:
    """Marks, shape (p,), of the events by which an element lets go because the next event makes its input jump."""
    marks = np.zeros(guards.size, np.int64)
    element, mode = model.guard_element[guards], np.searchsorted(model.guard_first, guards, side="right") - 1
    held = (model.mode_lags[mode] & model.mode_stick[mode]).astype(bool)
    # What follows its input lets go by a guard on rates; what is held on a level, by any.
    lets_go = held | np.any(model.guard_rate[guards], axis=1)
    jump = guards.size - 1
    for a in reversed(range(guards.size - 1)):
        if tau[a + 1] == 0.0 and lets_go[a] and model.reach[element[jump], element[a]]:
            marks[a] = LETS_GO
        else:
            jump = a
    return marks


def marked(arcs: Arcs, starts: Array, tau: Array) -> EventSequence:
    """Mark the arcs that begin on the guard that ends them, and those that end at once as it is already above zero.

    Those behind an event that the next one brings about end at once, too.
    """
    before = arcs.event_sequence.at_once == LETS_GO
    parts = arcs.g * starts
    value, size = parts.sum(axis=1), np.abs(parts).sum(axis=1)
    # An arc that begins on its own guard solves its equation with no duration, too: such equations are divided by it.
    short = tau <= 1e-12 * tau.sum()
    at_once = np.where(short & (value > 1e-9 * size), 1, np.where(~short & (np.abs(value) <= 1e-12 * size), 2, 0))
    at_once = np.where(before, LETS_GO, np.where(np.roll(before, 1), 1, at_once))
    return replace(arcs.event_sequence, at_once=at_once)


def _delayed_guess(hybrid: HybridSystem, it: EventSequence, y: Array, tau: Array) -> Guess:
    """Put the delayed switches among the events, and their timers and delayed values into the start."""
    plain = Arcs.build(
        replace(hybrid, model=hybrid.model._replace(smooth_kind=np.zeros_like(hybrid.model.smooth_kind))), it
    )
    model, T, t = hybrid.model, float(tau.sum()), np.cumsum(tau)
    rows = []
    # An output that jumps at an event does so again one dead time later, perhaps turns later: that is an event of its
    # own (docs/theory/exact_orbits.md, Closing an orbit).
    for line in np.flatnonzero(model.smooth_kind == DELAY_LINE):
        value = plain.W[:, model.smooth_w[line]]
        for k in np.flatnonzero(np.any(value != np.roll(value, -1, axis=0), axis=1)):
            late = float(t[k] + model.smooth_delay[line])
            rows.append((late % T, int(k), int(line), int(model.smooth_delay[line] // T)))
    rows.sort()
    arrivals = np.array([r[0] for r in rows])
    p = it.guards.size
    place = np.searchsorted(t, arrivals)  # the arc into which each arrival falls
    at = np.argsort(np.concatenate([t, arrivals]), kind="stable")
    new_place = np.argsort(at, kind="stable")
    modes = np.concatenate([it.modes, it.modes[np.minimum(place, p - 1)]])[at]
    guards = np.concatenate([it.guards, np.full(len(rows), -1)])[at]
    source = np.full((p + len(rows), 3), -1)
    for i, (_, origin, channel, turns) in enumerate(rows):
        source[new_place[p + i]] = new_place[origin], channel, turns
    times = np.concatenate([t, arrivals])[at]
    new_tau = np.diff(times, prepend=0.0)
    full = EventSequence(modes, guards, source, np.concatenate([it.at_once, np.zeros(len(rows), np.int64)])[at])
    arcs = Arcs.build(hybrid, full)
    n, n_H = model.A.shape[0], model.K.shape[1]
    wide = np.zeros(arcs.size)
    wide[:n], wide[arcs.memory] = y[:n], y[n : n + n_H]
    return Guess(full, with_history(hybrid, arcs, wide, new_tau), new_tau)


def with_history(hybrid: HybridSystem, arcs: Arcs, y: Array, tau: Array) -> Array:
    """The vector y with the timers and delayed values that belong to the start of a periodic motion."""
    y, t, T = y.copy(), np.cumsum(tau), float(tau.sum())
    source, model = arcs.event_sequence.source, hybrid.model
    lines = np.flatnonzero(model.smooth_kind == DELAY_LINE)
    register = arcs.n_state
    arrivals = np.flatnonzero(arcs.event_sequence.guards < 0)
    for k in arrivals:
        origin, line, turns = source[k]
        for i in range(turns + 1):
            # What is left of the dead time of the switch that was so many turns before the start.
            y[register] = model.smooth_delay[line] - ((i + 1) * T - t[origin])
            register += 1
    for i, line in enumerate(lines):
        of_line = [k for k in arrivals if source[k, 1] == line]
        if of_line:
            last = of_line[-1]
            column = arcs.memory.stop + i
            y[column] = arcs.J[last, column] @ y
    return y


def stretch(hybrid: HybridSystem, run: Run, first: int, last: int) -> Guess | None:
    """The stretch between two of the kept events (counted from the oldest)."""
    order = run.order[first : last + 1]
    starts = np.hstack([run.state[order[:-1]], run.memory_values[order[:-1]]])
    return make_guess(hybrid, run.modes[order[:-1]], run.guard[order[1:]], starts, np.diff(run.time[order]))


def recurrences(
    hybrid: HybridSystem, run: Run, period: tuple[float, float] | None = None, most: int = 6, n_events: int = 200
) -> Iterator[Guess]:
    """Stretches of a run that nearly return to their begin, best first; as for :func:`returns`."""
    for first, last in returns(hybrid, run, period, most, n_events):
        guess = stretch(hybrid, run, first, last)
        if guess is not None:
            yield guess


def returns(
    hybrid: HybridSystem,
    run: Run,
    period: tuple[float, float] | None,
    most: int,
    n_events: int,
    image: Array | None = None,
) -> list[tuple[int, int]]:
    """Pairs of kept events (counted from the oldest) of which the second nearly returns to the first, best first.

    Parameters
    ----------
    period : (float, float), optional
        Shortest and longest return wanted [s].
    most : int
        How many pairs at most.
    n_events : int
        Only so many of the last events are looked at.
    image : array, shape (N, N), optional
        Returns to the image of the first are wanted, where events are others than here.
    """
    skipped = max(run.n_kept - n_events, 0)
    order, compared, n = run.order[skipped:], hybrid.compared, hybrid.x0.size
    time = run.time[order]
    if order.size < 2:
        return []
    spend(_PAIR * order.size**2)
    # Of several events at one instant the last one counts.
    free = np.flatnonzero(np.diff(time, append=np.inf) > 0)
    begin = state = run.state[order][:, compared]
    if image is None:
        kind = np.column_stack([run.guard[order[free]], run.modes[order[free]]])
        _, kinds = np.unique(kind.view(f"V{kind.itemsize * kind.shape[1]}").ravel(), return_inverse=True)
        i, j = np.nonzero(np.triu(kinds[:, None] == kinds, 1))
    else:
        begin = (np.hstack([run.state[order], run.memory_values[order]]) @ image.T)[:, :n][:, compared]
        i, j = np.triu_indices(free.size, 1)
    gap = time[free[j]] - time[free[i]]
    if period is not None:
        wanted = (gap >= period[0]) & (gap <= period[1])
        i, j, gap = i[wanted], j[wanted], gap[wanted]
    span = np.ptp(state, axis=0)
    away = np.abs(begin[free[i]] - state[free[j]]) / np.where(span > 0, span, np.inf)
    # The nearest return first; of those that are equal to rounding the shortest, or a cycle would be closed over two
    # turns.
    nearest = np.round(np.max(away, axis=1, initial=0.0), 12)
    worst = np.partition(nearest, most - 1)[most - 1] if nearest.size > most else np.inf
    near = np.flatnonzero(~(nearest > worst))
    best = near[np.lexsort((gap[near], nearest[near]))[:most]]
    return [(skipped + int(free[i[k]]), skipped + int(free[j[k]])) for k in best]
