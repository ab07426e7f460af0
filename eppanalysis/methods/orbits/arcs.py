"""A closed orbit of a hybrid system as a chain of arcs: which modes, which events, and the affine maps of each.

State and memory values are stacked into one vector ``y = (x, timers, H, lines)``. Timers and lines exist only for loops
with dead time whose delayed outputs are piecewise constant: a switch of such an output sets a timer to the dead time,
and where the timer has run down the delayed value (its line) follows. So a loop with dead time is one more affine
system, exactly.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from eppanalysis.arrays import Array, BoolArray, IntArray
from eppanalysis.engine.orbits import Chain, Channels
from eppanalysis.errors import ModelError
from eppanalysis.methods.simulation.modes import laws_of, on_levels
from eppanalysis.methods.steady.flow import advances
from eppanalysis.models.systems.hybrid import DELAY_LINE, HybridSystem

#: Mark of an event that is caused by the one after it at the same instant.
LETS_GO = 3


@dataclass(frozen=True, eq=False)
class EventSequence:
    """The cyclic order of events on an orbit."""

    modes: IntArray  # (p, elements): mode of every element on each arc
    guards: IntArray  # (p,): number of the guard at whose event each arc ends; -1 where a delayed switch arrives
    #: (p, 3): for a delayed switch: the arc at whose end the output switched, the delay channel, and how many full
    #: periods the switch is under way; -1 elsewhere.
    source: IntArray
    #: (p,): 1 where the event follows the one before without delay; 2 where the arc begins on the guard that ends it,
    #: as slip does; 3 where what follows an input lets go because the next event makes that input jump: the arc ends
    #: where the guard of the next event does.
    at_once: IntArray

    @property
    def key(self) -> bytes:
        """The same for equal event sequences."""
        return self.modes.tobytes() + self.guards.tobytes() + self.source.tobytes() + self.at_once.tobytes()

    @cached_property
    def cyclic_key(self) -> tuple[tuple[int, int], ...]:
        """The same for event sequences with the same cyclic order of events, wherever they begin."""
        events = [(int(g), int(k == 1)) for g, k in zip(self.guards, self.at_once, strict=True)]
        return min(tuple(events[i:] + events[:i]) for i in range(len(events)))

    @cached_property
    def timing(self) -> IntArray:
        """Number of the guard that tells when each arc ends, shape (p,)."""
        timing = self.guards.copy()
        for a in np.flatnonzero(self.at_once == LETS_GO)[::-1]:
            timing[a] = timing[(a + 1) % timing.size]
        return timing

    @cached_property
    def numbers(self) -> tuple[IntArray, int, int, int]:
        """Largest mode of each element, largest guard, least mode and least guard."""
        return self.modes.max(axis=0), int(self.guards.max()), int(self.modes.min()), int(self.guards.min())

    def rotated(self, first: int) -> EventSequence:
        """The same cycle, begun with arc `first`."""
        p = self.guards.size
        turned = (np.arange(p) + first) % p
        source = self.source[turned]
        source[:, 0] = np.where(source[:, 0] >= 0, (source[:, 0] - first) % p, -1)
        return EventSequence(self.modes[turned], self.guards[turned], source, self.at_once[turned])


@dataclass(frozen=True, eq=False)
class Arcs:
    """The arcs of an event sequence in one system; arrays as in :func:`eppanalysis.engine.orbits.build_arcs`."""

    event_sequence: EventSequence
    F: Array
    S: Array
    g: Array
    gs: Array
    J: Array
    smooth: IntArray
    Y: Array
    Ys: Array
    W: Array
    channels: Channels
    #: n_state, n_timers: how many places of y are the state's, and timers.
    n_state: int
    n_timers: int
    #: (m,): places of y that must repeat: states other than clocks and inputs, and memory values that an event renews.
    free: IntArray
    #: (N,): what each place of y advances per unit of time beyond repeating (clocks, and what is measured by them).
    shift: Array
    #: Of a motion driven by a periodic input: how long all arcs together last [s]. The last arc has no guard then.
    duration: float | None = None

    @property
    def n_arcs(self) -> int:
        """Number of arcs."""
        return self.g.shape[0]

    @property
    def size(self) -> int:
        """Length of y."""
        return self.g.shape[1]

    @cached_property
    def acting(self) -> Channels | None:
        """The smooth channels, for the engine; None where none acts on any arc."""
        return self.channels if self.smooth.any() else None

    @cached_property
    def chain(self) -> Chain:
        """The arcs for the engine."""
        arrays = self.F, self.S, self.g, self.gs, self.J, self.smooth, self.event_sequence.at_once, self.free
        return Chain(*arrays, self.shift, np.nan if self.duration is None else self.duration)

    @cached_property
    def memory(self) -> slice:
        """Places of the memory values of the loop in y (the delayed values follow)."""
        first = self.n_state + self.n_timers
        return slice(first, first + self.channels.smooth_H.shape[1])

    @classmethod
    def build(cls, hybrid: HybridSystem, event_sequence: EventSequence, like: Arcs | None = None) -> Arcs:
        """The arcs of `event_sequence` in the system `hybrid`.

        `like` are its arcs in a system that differs in numbers only: the places that must repeat are taken from there.

        Raises
        ------
        ModelError
            If the system has no such arcs, or a delayed output that is not piecewise constant.
        """
        model = hybrid.model
        _refuse_another_structure(hybrid, event_sequence, like)
        n, n_s = model.S.shape
        F, S, g, gs, J, smooth, sense, Y, Ys, W = laws_of(
            hybrid, event_sequence.modes, event_sequence.guards, event_sequence.timing
        )
        channels = Channels(
            model.smooth_kind, model.smooth_x, model.smooth_H, model.smooth_s, model.smooth_scale, sense
        )
        shift = np.concatenate([np.zeros(n), advances(hybrid)[n:]])
        free = np.zeros(0, np.int64) if like is None else like.free
        J = on_levels(hybrid, event_sequence.modes) @ J
        arcs = cls(event_sequence, F, S, g, gs, J, smooth, Y, Ys, W, channels, n, 0, free, shift)
        if n_s and np.any(model.smooth_kind == DELAY_LINE):
            arcs = arcs._with_delays(hybrid)
        return replace(arcs, free=arcs._free(hybrid)) if like is None else arcs

    def halved(self, hybrid: HybridSystem, image: Array) -> Arcs:
        """All arcs but the last, closed by a map: the half of an orbit that is its own image.

        Parameters
        ----------
        image : array, shape (N, N)
            From y to its image, which takes the orbit onto itself half a period later. The last arc only tells the
            modes that the half ends in.
        """
        p, it = self.n_arcs - 1, self.event_sequence
        # Behind the last event of the half its image is taken: then "comes back to its start" means half a period.
        J = self.J[:p].copy()
        J[-1] = image @ J[-1]
        half = replace(
            self,
            event_sequence=EventSequence(it.modes[:p], it.guards[:p], it.source[:p], it.at_once[:p]),
            F=self.F[:p], S=self.S[:p], g=self.g[:p], gs=self.gs[:p], J=J, smooth=self.smooth[:p], Y=self.Y[:p],
            Ys=self.Ys[:p], W=self.W[:p], channels=self.channels._replace(sense=self.channels.sense[:p]),
        )  # fmt: skip
        return replace(half, free=half._free(hybrid))

    def _free(self, hybrid: HybridSystem) -> IntArray:
        """Compared states, timers, and memory values that some event renews."""
        # What no event renews stays as it was at the start: as an unknown it would make the equations singular.
        own = np.eye(self.size)[self.n_state :]
        renewed = np.any(self.J[:, self.n_state :] != own, axis=(0, 2))
        return np.concatenate([np.flatnonzero(hybrid.compared), self.n_state + np.flatnonzero(renewed)])

    def _with_delays(self, hybrid: HybridSystem) -> Arcs:
        """The same arcs with timers and delayed values in y."""
        # A delayed output that is constant between switches needs no past but the times of its switches: each has a
        # timer that falls from the dead time to zero, where its echo is an event of its own
        # (docs/theory/exact_orbits.md, Closing an orbit).
        model = hybrid.model
        lines = np.flatnonzero(model.smooth_kind == DELAY_LINE)
        value = _constant_outputs(self.W[:, model.smooth_w[lines]], _moving_places(hybrid, self))
        source = self.event_sequence.source
        echoes = np.flatnonzero(self.event_sequence.guards < 0)
        first = np.cumsum([0, *(source[echoes, 2] + 1)])
        p, n, N = self.F.shape
        n_t = int(first[-1])
        place = np.concatenate([np.arange(n), n + n_t + np.arange(N - n)])
        size = N + n_t + lines.size

        def widen(a: Array) -> Array:
            out = np.zeros((*a.shape[:-1], size))
            out[..., place] = a
            return out

        F = np.zeros((p, n + n_t, size))
        F[:, :n] = widen(self.F)
        F[:, n : n + n_t, n + n_t + N - n - 1] = -1.0
        one = n + n_t + N - n - 1
        J = np.broadcast_to(np.eye(size), (p, size, size)).copy()
        J[np.ix_(np.arange(p), place, place)] = self.J
        g, Y, value = widen(self.g), widen(self.Y), widen(value)
        switching = np.isin(lines, source[echoes, 1])
        for i, j in enumerate(lines):
            # What never switches is the same later.
            fed = np.eye(size)[N + n_t + i] if switching[i] else value[0, i]
            F[:, :n] += self.S[:, :, j, None] * fed
            g += self.gs[:, j, None] * fed
            Y += self.Ys[:, :, j, None] * fed
        for e, k in enumerate(echoes):
            origin, line = source[k, :2]
            row = N + n_t + int(np.flatnonzero(lines == line)[0])
            last = n + int(first[e + 1]) - 1
            g[k] = 0.0
            g[k, last] = -1.0
            J[k, row] = value[(origin + 1) % p, row - N - n_t]
            # The switch itself shifts the register of its timers.
            for register in range(last, n + int(first[e]), -1):
                J[origin, register] = np.eye(size)[register - 1]
            J[origin, n + int(first[e])] = 0.0
            J[origin, n + int(first[e]), one] = model.smooth_delay[line]
        zeros = np.zeros((p, n + n_t, self.S.shape[2]))
        return replace(
            self, F=F, S=zeros, g=g, gs=np.zeros_like(self.gs), J=J, Y=Y, W=widen(self.W), n_timers=n_t,
            shift=widen(self.shift),
        )  # fmt: skip


def _refuse_another_structure(hybrid: HybridSystem, event_sequence: EventSequence, like: Arcs | None) -> None:
    """Raise where modes and guards, which are numbers of rows, name none of the system, or y has other places there."""
    # Compiled code would read what lies behind the arrays.
    model, n = hybrid.model, hybrid.model.A.shape[0]
    modes, guard, least_mode, least_guard = event_sequence.numbers
    first = model.mode_first
    known = modes.size == first.size - 1 and (modes < first[1:] - first[:-1]).all()
    known = known and guard < model.guard_element.size and least_mode >= 0 and least_guard >= -1
    if like is not None:
        sizes = like.n_state, like.memory.stop - like.memory.start
        known = known and sizes == (n, model.K.shape[1])
    if not known:
        raise ModelError("orbit: the loop changes its structure: it does not have the modes and events of the orbit.")


def _moving_places(hybrid: HybridSystem, arcs: Arcs) -> BoolArray:
    """Which places of y may move: all but a 1 and inputs that are held, shape (N,)."""
    moves = np.arange(arcs.size) < arcs.size - 1
    if not hybrid.model.breakpoint_time.size:
        inputs, n = slice(hybrid.n_plant, arcs.n_state), arcs.n_state
        of_state = np.any(np.dstack([arcs.F[..., :n], arcs.S])[:, inputs], axis=(0, 2))
        moves[inputs] = of_state | np.any(arcs.F[:, inputs, n:] @ hybrid.H0, axis=0)
    return moves


def _constant_outputs(W: Array, moves: BoolArray) -> Array:
    """Rows of delayed outputs on each arc, shape (p, lines, N), which are of held inputs and a 1 alone.

    Raises
    ------
    ModelError
        If an output is not constant on some arc.
    """
    if np.any(W[:, :, moves]):
        raise ModelError(
            "orbit: the exact orbit of a loop with dead time needs delayed outputs that are constant between switches."
        )
    return W
