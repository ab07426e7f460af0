"""Whether a run decays: its motion dies out, or dwindles, or drifts ever more slowly towards rest."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from eppanalysis.arrays import Array, IntArray
from eppanalysis.methods.simulation.futures import Future, Rests
from eppanalysis.methods.simulation.kept import Run
from eppanalysis.models.systems.hybrid import HybridSystem, of_model

#: Largest change of a state over a period, relative to its amplitude on a cycle, that counts as rest, and as slow
#: drift.
_STILL, _DRIFT = 1e-6, 1e-2
#: Switches accumulate: the amplitude between them is taken over this many events, and is rest below this share of the
#: amplitude of the whole run.
_PILE, _PILED = 64, 1e-3
#: The amplitude decays when it is below this share of what it was at the oldest events that a run keeps.
_DWINDLES = 0.999
#: Turns are alike that differ by this share of what they gain or lose; from its square on levels bend a motion by less.
_ALIKE = 0.01
_FAR = _ALIKE**-2
#: Rounding of a step or a rate, relative to its terms.
_ROUNDING = 1e-12
#: Most events of one kind in a turn, and most that are kept.
_MOST_TURNS, _MOST_EVENTS = 8, 400


def died_out(start: HybridSystem, run: Run) -> bool:
    """Whether switches accumulate while the amplitude between them decays to rest."""
    if not run.n_kept:  # steps without number, but no switch
        return False
    smaller, now = dwindles(start, run)
    return smaller and now <= _PILED


def dwindles(start: HybridSystem, run: Run) -> tuple[bool, float]:
    """Whether the last events that a run keeps are smaller than the first, and their size relative to the whole run."""
    size = np.where(run.high > run.low, run.high - run.low, np.inf)
    before, now = ((np.ptp(run.state[part], axis=0) / size)[start.compared].max(initial=0.0) for part in (
        run.order[:_PILE], run.order[-_PILE:],
    ))  # fmt: skip
    return bool(now < _DWINDLES * before), float(now)


def comes_to_rest(future: Future | None, turns: Turns, start: HybridSystem, run: Run, t: float, size: Array) -> bool:
    """Whether a run that has not settled by its end will: by its modes there, by turns that shrink alike, or, of curved
    elements and behind a dead time, as it decays; arguments as of :func:`decays`.
    """
    if start.model.smooth_kind.size:
        return decays(start, run, t, size)
    return isinstance(future, Rests) or (turns.ratio is not None and abs(turns.ratio) < 1.0)


def decays(start: HybridSystem, run: Run, t: float, size: Array) -> bool:
    """Whether a run decays: its states move by rounding only, or drift ever more slowly through a band without gain.

    Parameters
    ----------
    t : float
        Length of the run [s].
    size : array, shape (n,)
        How far the states move on the cycles in question.
    """
    size = np.maximum(size, np.abs(run.x_end - start.x0))[start.compared]
    if t - _last_motion(start, run, _STILL * size) < 0.3 * t:
        return False
    rate = np.abs(run.rate_end)[start.compared]
    # A state that grows is faster at the end of the run than on average.
    if np.any(rate * t > 2.0 * size + np.abs(run.x_end)[start.compared] * _STILL):
        return False
    return bool(np.all(rate * t <= _DRIFT * size))


def _last_motion(start: HybridSystem, run: Run, size: Array) -> float:
    """Time of the last event at which a state was farther than `size` from where the run ends [s].

    Rounding makes events at standstill where a drive creeps to a stop; they do not count.
    """
    away = np.abs(run.state[run.order] - run.x_end)[:, start.compared]
    moved = np.flatnonzero(np.any(away > size, axis=1))
    if moved.size:
        return float(run.time[run.order[moved[-1]]])
    return float(run.time[run.order[0]]) if run.count > run.n_kept else 0.0


@dataclass(frozen=True, eq=False)
class Turns:
    """The last events of a motion, over one run or several that go on from one another."""

    start: HybridSystem
    guard: IntArray  # (events,)
    modes: IntArray  # (events, elements)
    state: Array  # (events, n)
    rate: Array  # (events, n)
    swing: Array  # (n,): how far each state went in the last run, between its events, too

    @classmethod
    def of(cls, start: HybridSystem, run: Run, before: Turns | None = None) -> Turns:
        """Those of a run, and those before it."""
        events = run.guard[run.order], run.modes[run.order], run.state[run.order], run.rate[run.order]
        last = cls(start, *events, run.high - run.low)
        if before is None:
            return last

        def joined(name: str) -> Any:
            return np.concatenate([getattr(before, name), getattr(last, name)])[-_MOST_EVENTS:]

        return cls(start, joined("guard"), joined("modes"), joined("state"), joined("rate"), last.swing)

    @cached_property
    def ratio(self) -> float | None:
        """The ratio of each of the last turns to the one before, where they are alike but for their size.

        Larger ones where the motion is so large that no level of an element bends it, and smaller ones about a rest,
        where the rates vanish, too: such turns go on for ever, as the loop does the same at all such sizes. None
        elsewhere, and where elements are curved or act late.
        """
        if self.start.model.smooth_kind.size:
            return None
        same = (self.guard == self.guard[-1:]) & np.all(self.modes == self.modes[-1:], axis=1)
        events, compared = np.flatnonzero(same), self.start.compared
        X, R = self.state[:, compared], self.rate[:, compared]
        for p in range(1, min(_MOST_TURNS, (events.size - 1) // 3) + 1):
            at = events[[-1 - 3 * p, -1 - 2 * p, -1 - p, -1]]
            ratio = self._growth(X[at]) or self._decay(X[at], R[at])
            if ratio is not None:
                return ratio
        return None

    def _growth(self, turns: Array) -> float | None:
        """The ratio of turns (4, k) that grow, where all levels are small beside them; of several that of the fastest.

        Each state has a ratio of its own: a chain of integrators behind a limit grows in each by another power.
        """
        level = _levels(self.start)[0] + _held(self.start)
        size = np.abs(self.state[-_PILE:][:, self.start.compared]).max(axis=0)
        if np.any((level > 0) & (size < _FAR * level)):
            return None
        with np.errstate(divide="ignore", invalid="ignore"):
            _, before, now = (turns[1:] / turns[:-1])[:, np.abs(turns[-1]) > _STILL * self.swing[self.start.compared]]
        alike = np.abs(before - now) < _ALIKE * np.maximum(now - 1.0, _ALIKE)
        grows = now.size > 0 and now.max() > 1.0 + _ALIKE and np.all(alike & (now > 1.0 - _ALIKE))
        return float(now.max()) if grows else None

    def _decay(self, turns: Array, rates: Array) -> float | None:
        """The ratio of steps between turns (4, k) that shrink, where they are small beside all levels."""
        level, push = _levels(self.start)
        steps, compared = np.diff(turns, axis=0), self.start.compared
        if np.any((level > 0) & (_FAR * np.abs(steps[-1]) > level)):
            return None
        # In turned states what has no push, or stays where it is, has the rounding of the others.
        size = np.abs(self.state).max(axis=0)
        noise = _ROUNDING * ((np.abs(self.start.model.A) @ size)[compared] + push)
        if np.any((push > noise) & (_FAR * np.abs(rates[-1]) > push)):
            return None
        both = np.hstack([steps, rates[1:]])
        both = np.where(np.abs(both) <= np.append(_ROUNDING * size[compared], noise), 0.0, both)
        both = both / np.maximum(np.abs(both).max(axis=0), np.finfo(float).tiny)
        before, now = _ratio(both[0], both[1]), _ratio(both[1], both[2])
        off = float(np.abs(both[2] - now * both[1]).max())
        shrinks = abs(now) < 1.0 - _ALIKE and off < _ALIKE * (1.0 - abs(now)) and abs(before - now) < _ALIKE
        return now if shrinks else None


def _ratio(one: Array, other: Array) -> float:
    return float(one @ other) / max(float(one @ one), np.finfo(float).tiny)


def _held(start: HybridSystem) -> Array:
    """Where a setpoint puts the guards, in terms of the states under them, shape (k,)."""
    compared = start.compared
    rows = _guard_rows(start)
    under, by = np.abs(rows[:, compared]), np.abs(rows[:, ~compared]) @ np.abs(start.x0[~compared])
    return np.max(np.where(under > 0.0, by[:, None] / np.where(under > 0.0, under, 1.0), 0.0), axis=0, initial=0.0)


@of_model
def _guard_rows(start: HybridSystem) -> Array:
    """What each guard reads of the states, (guards, n)."""
    model = start.model
    z = model.first[model.guard_element, 0]
    n_z = model.first[model.guard_element + 1, 0] - z
    rows = [w[:k] @ model.C[i : i + k] for w, i, k in zip(model.guard_z, z.tolist(), n_z.tolist(), strict=True)]
    return np.array(rows).reshape(len(rows), start.x0.size)


@of_model
def _levels(start: HybridSystem) -> tuple[Array, Array]:
    """What keeps a loop from being alike at all sizes: levels of guards, in terms of the states under them, and what
    constants add to rates; both (k,), of the states that repeat.
    """
    model, n = start.model, start.x0.size
    level, push, rows = np.zeros(n), np.abs(model.K[:, -1]), _guard_rows(start)
    for e in range(len(model.mode_first) - 1):
        (z, w), (n_z, n_w) = model.first[e, :2], (model.first[e + 1] - model.first[e])[:2]
        for guard in np.flatnonzero(model.guard_element == e):
            row = rows[guard]
            constant = abs(model.guard_0[guard]) + abs(model.guard_z[guard, :n_z] @ model.Kz[z : z + n_z, -1])
            level = np.maximum(level, np.where(row != 0, constant / np.abs(np.where(row == 0, 1.0, row)), 0.0))
        put_out = np.abs(model.mode_w0[model.mode_first[e] : model.mode_first[e + 1], :n_w]).max(axis=0, initial=0.0)
        push = push + np.abs(model.B[:, w : w + n_w]) @ put_out
    return level[start.compared], push[start.compared]
