"""Whether a run decays: its motion dies out, or dwindles, or drifts ever more slowly towards rest."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from eppanalysis.arrays import Array, BoolArray, IntArray
from eppanalysis.methods.simulation.futures import Future, Rests, future_under
from eppanalysis.methods.simulation.kept import Run
from eppanalysis.methods.simulation.modes import ModeLaw, law_of
from eppanalysis.methods.simulation.sliding import ALIKE, VANISHED, sliding_law
from eppanalysis.models.systems.hybrid import HybridSystem

#: Largest change of a state over a period, relative to its amplitude on a cycle, that counts as rest, and as slow
#: drift.
_STILL, _DRIFT = 1e-6, 1e-2
#: So many events tell how large the last swings are.
_PILE = 64
#: The amplitude decays when it is below this share of what it was at the oldest events that a run keeps.
_DWINDLES = 0.999
#: From here on, relative to a level, it bends a motion by less than turns that are alike may differ.
_FAR = ALIKE**-2
#: Rounding of a step or a rate, relative to its terms.
_ROUNDING = 1e-12
#: Most events of one kind in a turn, and most that are kept.
_MOST_TURNS, _MOST_EVENTS = 8, 400


def dwindles(start: HybridSystem, run: Run) -> bool:
    """Whether the last events that a run keeps are smaller than the first."""
    size = np.where(run.high > run.low, run.high - run.low, np.inf)
    before, now = ((np.ptp(run.state[part], axis=0) / size)[start.compared].max(initial=0.0) for part in (
        run.order[:_PILE], run.order[-_PILE:],
    ))  # fmt: skip
    return bool(now < _DWINDLES * before)


def comes_to_rest(
    future: Future | None, turns: PoincareReturns, start: HybridSystem, run: Run, t: float, size: Array
) -> bool:
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
class PoincareReturns:
    """The last events of a motion, over one run or several that go on from one another."""

    start: HybridSystem
    guard: IntArray  # (events,)
    modes: IntArray  # (events, elements): behind each
    lasts: Array  # (events,): how long these last [s]
    y: Array  # (events, N): the state, the memory values, and a 1
    rate: Array  # (events, n)
    swing: Array  # (n,): how far each state went in the last run, between its events, too

    @classmethod
    def of(cls, start: HybridSystem, run: Run, before: PoincareReturns | None = None) -> PoincareReturns:
        """Those of a run, and those before it."""
        order = run.order
        lasts = np.diff(run.time[order], append=float(run.stats[0]))
        y = np.hstack([run.state[order], run.memory_values[order]])
        last = cls(start, run.guard[order], run.modes[order], lasts, y, run.rate[order], run.high - run.low)
        if before is None:
            return last

        def joined(name: str) -> Any:
            return np.concatenate([getattr(before, name), getattr(last, name)])[-_MOST_EVENTS:]

        guard, modes, lasts, y, rate = map(joined, ("guard", "modes", "lasts", "y", "rate"))
        return cls(start, guard, modes, lasts, y, rate, last.swing)

    @cached_property
    def ratio(self) -> float | None:
        """The ratio of each of the last turns to the one before, where they are alike but for their size.

        Larger ones where the motion is so large that no level of an element bends it, and smaller ones about a rest,
        at which all that they meet vanishes or is far away: such turns go on for ever, as the loop does the same at all
        such sizes. None elsewhere, and where elements are curved or act late.
        """
        if self.start.model.smooth_kind.size:
            return None
        events = np.flatnonzero((self.guard == self.guard[-1:]) & np.all(self.modes == self.modes[-1:], axis=1))
        for p in range(1, min(_MOST_TURNS, (events.size - 1) // 3) + 1):
            at = events[[-1 - 3 * p, -1 - 2 * p, -1 - p, -1]]
            ratio = self._growth(at) or self._decay(at)
            if ratio is not None:
                return ratio
        return None

    @cached_property
    def sliding(self) -> Future | None:
        """What is to come of the motion that ever smaller swings between two modes hold; None elsewhere."""
        if self.start.model.smooth_kind.size or self.guard.size <= _PILE:
            return None
        # However short: on the edge of one of them the other is visited for less than rounding of the time.
        last = np.arange(self.guard.size - _PILE, self.guard.size)
        pairs = np.unique(np.column_stack([self.modes[last - 1], self.guard[last]]), axis=0)
        if len(pairs) != 2:
            return None
        law = sliding_law(self.start, pairs[:, :-1], pairs[:, -1], self.y[last])
        return None if law is None else future_under(self.start, law, self.y[-1])

    def _laws(self, since: int) -> list[ModeLaw] | None:
        """The laws of the modes that the motion was in since an event; None where one has none."""
        modes = np.unique(self.modes[since:][self.lasts[since:] > 0.0], axis=0)
        laws = [law_of(self.start, one) for one in modes]
        return None if None in laws else [law for law in laws if law is not None]

    def _growth(self, at: IntArray) -> float | None:
        """The ratio of turns that grow, begun `at` four events, and do so for ever; of several that of the fastest.

        Each state has a ratio of its own: a chain of integrators behind a limit grows in each by another power.
        """
        states, laws = np.flatnonzero(self.start.compared), self._laws(at[-2])
        if not laws or self._meets_levels(at, laws):
            return None
        turns = self.y[at][:, states]
        with np.errstate(divide="ignore", invalid="ignore"):
            _, before, now = (turns[1:] / turns[:-1])[:, np.abs(turns[-1]) > _STILL * self.swing[states]]
        alike = np.abs(before - now) < ALIKE * np.maximum(now - 1.0, ALIKE)
        grows = now.size > 0 and now.max() > 1.0 + ALIKE and np.all(alike & (now > 1.0 - ALIKE))
        return float(now.max()) if grows and self._rates_grow_alike(at, laws, float(now.max())) else None

    def _meets_levels(self, at: IntArray, laws: list[ModeLaw]) -> bool:
        """Whether a guard has terms that do not grow and are not small beside those of the states."""
        moves = np.append(self.start.compared, np.ptp(self.y[at[-2] :, self.start.compared.size :], axis=0) > 0.0)
        guards, places = np.abs(np.vstack([law.g @ law.levels for law in laws])), np.flatnonzero(self.start.compared)
        by, level = guards[:, places], guards[:, ~moves] @ np.abs(self.y[-1, ~moves])
        size = np.abs(self.y[-_PILE:, places]).max(axis=0)
        return bool(np.any((by > 0.0) & (by * size < _FAR * level[:, None])))

    def _rates_grow_alike(self, at: IntArray, laws: list[ModeLaw], ratio: float) -> bool:
        """Whether the terms that count in each rate, and the rate itself, grow alike from turn to turn, and the others
        no faster: a motion about a constant output is another one at another size.
        """
        both = np.abs(np.hstack([self.y, self.rate]))
        before, now = (both[a + 1 : b + 1].max(axis=0) for a, b in ((at[-3], at[-2]), (at[-2], at[-1])))
        growth = np.log(np.where(before * now > 0.0, now, 1.0) / np.where(before * now > 0.0, before, 1.0))
        for law in laws:
            terms = np.abs(np.hstack([law.F @ law.levels, np.eye(len(law.F))])[self.start.compared]) * now
            counts = (terms > 0.0) & (_FAR * terms >= terms.max(axis=1, keepdims=True))
            fastest = np.where(counts, growth, -np.inf).max(axis=1, keepdims=True)
            off = np.where(counts, fastest - growth, growth - fastest)[terms > 0.0]
            if np.any(off > ALIKE * np.log(ratio)):
                return False
        return True

    def _decay(self, at: IntArray) -> float | None:
        """The ratio of the steps between turns that shrink, begun `at` four events, about rests of all their modes."""
        compared, laws = self.start.compared, self._laws(at[-2])
        if not laws:
            return None
        steps = np.diff(self.y[at], axis=0)
        # In turned states what stays where it is has the rounding of the others.
        size = np.abs(self.y).max(axis=0)
        noise = _ROUNDING * np.max([law.terms @ size for law in laws], axis=0)[compared]
        repeats = np.append(compared, np.ones(size.size - compared.size, bool))
        both = np.hstack([steps[:, repeats], self.rate[at[1:]][:, compared]])
        both = np.where(np.abs(both) <= np.append(_ROUNDING * size[repeats], noise), 0.0, both)
        both = both / np.maximum(np.abs(both).max(axis=0), np.finfo(float).tiny)
        before, now = _ratio(both[0], both[1]), _ratio(both[1], both[2])
        off = float(np.abs(both[2] - now * both[1]).max())
        if abs(now) >= 1.0 - ALIKE or off >= ALIKE * (1.0 - abs(now)) or abs(before - now) >= ALIKE:
            return None
        return now if self._is_alike_at_all_sizes(at, now, repeats) else None

    def _is_alike_at_all_sizes(self, at: IntArray, ratio: float, repeats: BoolArray) -> bool:
        """Whether the loop does the same at all sizes of turns that shrink by a ratio.

        Where each event of a turn comes to, each rate and guard of the modes around it is so large that turns change
        nothing of it, or vanishes; all that vanish do so at one point to rounding, however near to zero a level lies.
        """
        last, turn = np.arange(at[-2] + 1, at[-1] + 1), int(at[-1] - at[-2])
        if last[0] < turn or not np.array_equal(self.guard[last], self.guard[last - turn]):
            return False
        way = np.where(repeats, self.y[last] - self.y[last - turn], 0.0) / (1.0 - ratio)
        limits, size = self.y[last] + ratio * way, np.abs(way).max(axis=0)
        for event, limit in zip(last, limits, strict=True):
            arcs = [k for k in (event - 1, event) if self.lasts[k] > 0.0]
            laws = [law for law in (law_of(self.start, self.modes[k]) for k in arcs) if law is not None]
            rows = [np.vstack([law.F[self.start.compared], law.g]) @ law.levels for law in laws]
            if len(laws) < len(arcs) or not (rows and _vanish_together(np.vstack(rows), limit, size, abs(ratio))):
                return False
        return True


def _vanish_together(rows: Array, limit: Array, size: Array, ratio: float) -> bool:
    """Whether those of some rates and guards (rows, N) that are not large beside what is left of turns make of them
    vanish at one point, which the turns lead to; `size` (N,) is how far the last one began from its limit.
    """
    spread = ratio * size
    change, noise = np.abs(rows) @ spread, VANISHED * (np.abs(rows) @ (np.abs(limit) + size))
    near = (ALIKE * np.abs(rows @ limit) < change) & (change > noise)
    part, point = rows[near] * spread / change[near, None], limit
    for _ in range(2):  # once more, as what is left of the first time is rounding of its largest terms
        point = point + spread * np.linalg.lstsq(part, -(rows[near] @ point) / change[near], rcond=None)[0]
    leads_there = np.all(np.abs(point - limit) <= ALIKE * size)
    return bool(leads_there and np.all(np.abs(rows[near] @ point) <= noise[near]))


def _ratio(one: Array, other: Array) -> float:
    return float(one @ other) / max(float(one @ one), np.finfo(float).tiny)
