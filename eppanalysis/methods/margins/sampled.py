"""Loops with sampled controllers for margins: from sample to sample, where that is exact.

Between two samples everything else is linear and what is held is constant, so that one turn of all clocks is a linear
map. Cut where a controller that is executed once a turn reads, or where nothing passes but what it holds, the loop is
one in discrete time, exactly. Cut elsewhere it is no loop that the same sine comes back in; there the controllers are
taken in the mean over where their samples fall (see `averaged`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from eppanalysis.arrays import Array
from eppanalysis.models.elements.dynamic.sampled import SampledController
from eppanalysis.models.systems.cuts import Cuts
from eppanalysis.models.systems.hybrid import cascade
from eppanalysis.models.systems.lure import LureSystem
from eppanalysis.models.systems.sampled.ages import staircases, turn_of
from eppanalysis.models.systems.sampled.places import Places


def from_sample_to_sample(system: LureSystem, gains: Array) -> LureSystem | None:
    """The loop in discrete time, cut at what its controllers read and put out; None where that is not exact.

    Parameters
    ----------
    gains : array, shape (nw, nz)
        ``w = gains @ z`` for all elements but the controllers.
    """
    p = Places.of(system)
    turn = turn_of([c.sample_time for c in p.controllers])
    if turn is None or np.any(system.delays > 0):
        return None
    between = Between.of(system, gains, p)
    ports = _Ports.of(system, p, between, turn)
    walk = _Walk.of(p, between, ports)
    last = 0.0
    for time, _, act in _in_order(p.controllers, walk, turn):
        walk.flow(time - last)
        act()
        last = time
    walk.flow(turn - last)
    n = len(walk.now)
    used = np.arange(n)
    while used.size > (kept := used[np.any(np.vstack([walk.now[used], walk.back])[:, used], axis=0)]).size:
        used = kept
    cuts = Cuts(
        tuple(system.places.names[i] for i in ports.numbers),
        B=walk.now[used][:, n:],
        E=np.zeros((0, len(ports.numbers))),
        C=walk.back[:, used],
        D=np.zeros((len(ports.numbers), 0)),
        F=np.diag(walk.back[:, n:]),
    )
    return LureSystem.build(
        walk.now[np.ix_(used, used)], np.zeros((len(used), 0)), np.zeros((0, len(used))), [],
        time_step=turn, cuts=cuts, name=system.name,
    )  # fmt: skip


@dataclass(frozen=True, eq=False)
class Turn:
    """What a linear loop round sampled controllers does in one turn of all clocks."""

    time: float  # of the turn [s]
    shortest: float  # time between two samples of the fastest controller [s]
    #: Plant, what is held, what is computed and not yet put out, and the controllers' memory, on themselves before.
    after: Array
    rate: Array  # of plant and what is held between two samples
    seen: Array  # the signals, on both
    parts: tuple[tuple[float, float, Array], ...]  # between two samples: begin, length [s], and both, on all before

    def fundamental(self, s: complex, before: NDArray[Any]) -> NDArray[Any]:
        """Mean over the turn of the signals times ``exp(-s t)``, of a motion ``exp(s t)`` from a state on."""
        n = len(self.rate)
        turning = np.zeros((2 * n, 2 * n), complex)
        turning[:n, :n], turning[:n, n:] = self.rate - s * np.eye(n), np.eye(n)
        summed = np.zeros(n, complex)
        for begin, length, rows in self.parts:
            # The integral of a matrix exponential is a block of a larger one (Van Loan 1978).
            integral = scipy.linalg.expm(turning * length)[:n, n:]
            summed += np.exp(-s * begin) * (integral @ (rows @ before))
        return np.asarray(self.seen @ summed / self.time)


def over_a_turn(system: LureSystem) -> Turn | None:
    """The turn of a loop with no elements but sampled controllers; None where it is too long, or behind dead time."""
    p = Places.of(system)
    turn = turn_of([c.sample_time for c in p.controllers])
    if turn is None or np.any(system.delays > 0):
        return None
    none = np.zeros(0, np.intp)
    ports = _Ports((), none, none, np.zeros((p.read.size, 0)), np.zeros((0, p.held.size)))
    walk = _Walk.of(p, Between.of(system, np.zeros((len(system.delays), len(system.C))), p), ports)
    parts, last = [], 0.0
    for time, _, act in [*_in_order(p.controllers, walk, turn), (turn, 0, lambda: None)]:
        if time > last:
            parts.append((last, time - last, walk.now[: len(walk.rate)].copy()))
        walk.flow(time - last)
        act()
        last = time
    seen = np.hstack([system.signals.C[:, p.plant], system.signals.D[:, p.held]])
    shortest = min(c.sample_time for c in p.controllers)
    return Turn(turn, shortest, walk.now, walk.rate, seen, tuple(parts))


def with_straight_gains(system: LureSystem, gains: Array) -> LureSystem:
    """The loop where controllers read what elements make of one another's holds straight, by the gains of those."""
    p = Places.of(system)
    through = np.setdiff1d(list(staircases(system)), p.held)
    through = through[np.any(gains[through], axis=1)]
    if not np.any(system.D[np.ix_(p.read, through)]):
        return system
    K, places, D, E = gains[through], system.places, system.D.copy(), system.places.E.copy()
    made = np.linalg.inv(np.eye(through.size) - K @ D[:, through]) @ K
    others = ~np.isin(np.arange(D.shape[1]), through)
    rest, by_way = D * others, D[np.ix_(p.read, through)] @ made
    D[p.read], E[p.read] = rest[p.read] + by_way @ rest, E[p.read] + by_way @ E
    # Places that are what a controller reads come back as that does.
    seen = [
        i for i, row in enumerate(places.D) if np.any(row[through]) and np.any(np.all(row == system.D[p.read], axis=1))
    ]
    D_y, F = places.D.copy(), places.F.copy()
    by_way = D_y[seen][:, through] @ made
    F[seen] += np.einsum("ij,ji->i", by_way, places.E[:, seen])
    D_y[seen] = D_y[seen] * others + by_way @ rest
    return replace(system, D=D, cuts=replace(places, E=E, D=D_y, F=F))


def _in_order(controllers: Sequence[SampledController], walk: _Walk, turn: float) -> list:
    """What happens in one turn: times in order, at one instant outputs that are due, then samples along the signal."""
    found = []
    for rank, i in enumerate(walk.order(), start=1):
        c = controllers[i]
        for k in range(round(turn / c.sample_time)):
            time = c.offset % c.sample_time + k * c.sample_time
            found.append((_even(time, turn), rank, lambda i=i: walk.sample(i)))
            if c.delay:
                found.append((_even(time + c.delay, turn), 0, lambda i=i: walk.put_out(i)))
    return sorted(found, key=lambda event: event[:2])


def _even(time: float, turn: float) -> float:
    """A time within the turn, so that those that coincide but for rounding are the same."""
    return round(time / turn % 1.0, 12) % 1.0 * turn


@dataclass(frozen=True, eq=False)
class Between:
    """A loop between two samples, where all but the controllers is linear."""

    #: x_x, x_h, r_x, r_h: rate of the plant's state (x) and what the controllers read (r), on that state and on what is
    #: held (h).
    x_x: Array
    x_h: Array
    r_x: Array
    r_h: Array
    #: x_d, r_d: the same on a disturbance at each place of the loop.
    x_d: Array
    r_d: Array
    #: y_x, y_h: what comes back to each place.
    y_x: Array
    y_h: Array
    y_d: Array  # what a disturbance at each place does straight to what comes back there

    @classmethod
    def of(cls, system: LureSystem, gains: Array, p: Places) -> Between:
        """A loop whose elements are gains."""
        places, plant, z, w, read, held = system.places, p.plant, p.z, p.w, p.read, p.held
        B, C, D = system.B, system.C, system.D
        through = gains[np.ix_(w, z)] @ np.linalg.inv(np.eye(z.size) - D[np.ix_(z, w)] @ gains[np.ix_(w, z)])
        w_x, w_h, w_d = through @ C[np.ix_(z, plant)], through @ D[np.ix_(z, held)], through @ places.E[z]
        B_w, D_w, Y_w = B[np.ix_(plant, w)], D[np.ix_(read, w)], places.D[:, w]
        return cls(
            system.A[np.ix_(plant, plant)] + B_w @ w_x,
            B[np.ix_(plant, held)] + B_w @ w_h,
            C[np.ix_(read, plant)] + D_w @ w_x,
            D[np.ix_(read, held)] + D_w @ w_h,
            places.B[plant] + B_w @ w_d,
            places.E[read] + D_w @ w_d,
            places.C[:, plant] + Y_w @ w_x,
            places.D[:, held] + Y_w @ w_h,
            places.F + np.einsum("kw,wk->k", Y_w, w_d),
        )


@dataclass(frozen=True, eq=False)
class _Ports:
    """Places at which the loop is one in discrete time."""

    numbers: tuple[int, ...]  # of the places of the loop
    #: read, out: which input of the controllers is all that a disturbance there acts on, or which output is all that
    #: comes back there; -1 for none.
    read: NDArray[np.intp]
    out: NDArray[np.intp]
    into: Array  # (m, q): what a disturbance adds to what is read in the sample that computes what comes back
    #: (q, outputs): what a place that is read takes from the controller's own outputs within the same sample.
    seen: Array

    @classmethod
    def of(cls, system: LureSystem, p: Places, between: Between, turn: float) -> _Ports:
        """Those of a loop: of controllers that are executed once a turn."""
        once = [c.sample_time > 0.75 * turn for c in p.controllers]
        reads = np.repeat(once, [c.n_inputs - 1 for c in p.controllers])
        outs = np.repeat(once, [c.n_outputs for c in p.controllers])
        places, found = system.places, {}
        for i in np.flatnonzero((places.delays == 0) & (between.y_d == 0)):
            given, taken = np.flatnonzero(between.y_h[i]), np.flatnonzero(between.r_d[:, i])
            none, own = np.zeros(p.read.size), np.zeros(p.held.size)
            if given.size == 1 and outs[given[0]] and not np.any(between.y_x[i]):
                # What blocks of one controller hand on to one another is no wire of the loop (see `Network.within`).
                if np.array_equal(places.D[i], np.eye(len(places.D[i]))[p.held[given[0]]]):
                    none = places.E[p.read, i] - system.D[p.read, p.held[given[0]]]
                found[int(i)] = -1, given[0], none, own
            elif taken.size == 1 and reads[taken[0]] and not np.any(between.x_d[:, i]):
                row = p.read[taken[0]]
                if np.array_equal(places.E[:, i], np.eye(len(places.E))[row]):
                    own = (places.D[i] - system.D[row])[p.held]
                found[int(i)] = taken[0], -1, none, own
        read, out, into, seen = zip(*found.values(), strict=True) if found else [()] * 4
        return cls(
            tuple(found), np.array(read, np.intp), np.array(out, np.intp),
            np.reshape(into, (len(found), p.read.size)).T, np.reshape(seen, (len(found), p.held.size)),
        )  # fmt: skip


@dataclass(eq=False)
class _Walk:
    """State of a loop on its way through one turn, as rows on the state before it and on the disturbances."""

    controllers: tuple[SampledController, ...]
    ports: _Ports
    rate: Array  # of the plant's state and of what is held, the disturbances among it, on both
    reads: Array  # what the controllers read, on both
    brings: Array  # what comes back to each port, on both, but for what its own controller computes in that sample
    now: Array  # plant, what is held, what is computed and not yet put out, and the controllers' memory
    back: Array  # what comes back to each port

    @classmethod
    def of(cls, p: Places, between: Between, ports: _Ports) -> _Walk:
        """A loop before the turn."""
        chosen, q, n = list(ports.numbers), len(ports.numbers), len(between.x_x)
        held = p.held.size + q
        size = n + 2 * held + sum(_order(c) for c in p.controllers)
        # A disturbance where something is held is held with it; where something is read it acts in that sample alone.
        stays = ports.out >= 0
        rate = np.vstack(
            [np.hstack([between.x_x, between.x_h, between.x_d[:, chosen] * stays]), np.zeros((held, n + held))]
        )
        reads = np.hstack([between.r_x, between.r_h, (between.r_d[:, chosen] - ports.into) * stays])
        brings = np.hstack([between.y_x[chosen], between.y_h[chosen] - ports.seen, np.zeros((q, q))])
        into = np.where(stays, ports.into, between.r_d[:, chosen])
        now, back = np.eye(size, size + q), np.zeros((q, size + q))
        return cls(p.controllers, replace(ports, into=into), rate, reads, brings, now, back)

    @property
    def n_held(self) -> int:
        """What is held: outputs of all controllers, and the disturbances."""
        return sum(c.n_outputs for c in self.controllers) + len(self.back)

    def order(self) -> list[int]:
        """Controllers along the signal: each behind those that act straight on it."""
        rows = [self._rows(i) for i in range(len(self.controllers))]
        straight = self.reads[:, len(self.rate) - self.n_held :] != 0
        acts = np.array([[np.any(straight[np.ix_(reads, outs)]) for _, outs, _ in rows] for reads, _, _ in rows], bool)
        return cascade(range(len(rows)), acts)

    def flow(self, time: float) -> None:
        """Let time pass."""
        moving = self.now[: len(self.rate)]
        if time > 0.0:
            moving[:] = scipy.linalg.expm(self.rate * time) @ moving

    def sample(self, i: int) -> None:
        """Let a controller read, compute, and put out what is ready at once."""
        c, (reads, outs, own), n = self.controllers[i], self._rows(i), len(self.now)
        A, B, C, D = (np.reshape(getattr(c, name), shape) for name, shape in _shapes(c).items())
        u = self._read(reads)
        y = C @ self.now[own] + D @ u
        ready = len(self.rate) - self.n_held + (self.n_held if c.delay else 0)
        for q, (read, out) in enumerate(zip(self.ports.read, self.ports.out, strict=True)):
            if read in reads:
                self.back[q] = self.brings[q] @ self.now[: len(self.rate)] + self.ports.seen[q, outs] @ y
            elif out in outs:
                self.back[q] = self.brings[q, len(self.rate) - self.n_held + out] * y[outs == out][0]
                self.now[ready + self.n_held - len(self.back) + q] = np.eye(1, n + len(self.back), n + q)[0]
        self.now[ready + outs] = y
        self.now[own] = A @ self.now[own] + B @ (self._read(reads) if c.state_last else u)

    def put_out(self, i: int) -> None:
        """Put out what a controller has computed."""
        outs = self._rows(i)[1]
        own = np.concatenate([outs, self.n_held - len(self.back) + np.flatnonzero(np.isin(self.ports.out, outs))])
        held = len(self.rate) - self.n_held + own
        self.now[held] = self.now[held + self.n_held]

    def _read(self, reads: NDArray[np.intp]) -> Array:
        """What is read now, with the disturbances."""
        u = np.asarray(self.reads[reads] @ self.now[: len(self.rate)])
        u[:, len(self.now) :] += self.ports.into[reads]
        return u

    def _rows(self, i: int) -> tuple[NDArray[np.intp], NDArray[np.intp], NDArray[np.intp]]:
        """What a controller reads, its outputs, and its memory among the rows of `now`."""
        before, c = self.controllers[:i], self.controllers[i]
        reads, outs = sum(b.n_inputs - 1 for b in before), sum(b.n_outputs for b in before)
        own = len(self.rate) + self.n_held + sum(_order(b) for b in before)
        return (
            np.arange(reads, reads + c.n_inputs - 1),
            np.arange(outs, outs + c.n_outputs),
            np.arange(own, own + _order(c)),
        )


def _order(controller: SampledController) -> int:
    return len(np.asarray(controller.x0))


def _shapes(c: SampledController) -> dict[str, tuple[int, int]]:
    n, m, p = _order(c), c.n_inputs - 1, c.n_outputs
    return {"A": (n, n), "B": (n, m), "C": (p, n), "D": (p, m)}
