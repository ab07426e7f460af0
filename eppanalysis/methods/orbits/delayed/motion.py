"""Periodic motions of loops whose delayed signals move: collocation on the pieces between events and their echoes.

For fixed dwell times the motion solves a linear equation with dead time, ``dy/dt = F y + S sigma``, where sigma is an
output of the elements one dead time earlier, around the period. Every switch comes back after each dead time, one order
smoother each time: the pieces end at the events and at so many of their echoes that polynomials between them hold to
rounding (Engelborghs, Luzyanina, in 't Hout, Roose: Collocation methods for the computation of periodic solutions of
delay differential equations, SIAM J. Sci. Comput. 22, 2000; on such pieces Barton, Krauskopf, Wilson 2006). Newton's
method then finds the dwell times with which each arc ends on its guard. The same matrices, with the jumps that a
disturbance makes at an event and at its echoes, carry the disturbances of one period into the next one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.polynomial import legendre

from eppanalysis.arrays import Array, ComplexArray, IntArray
from eppanalysis.methods.orbits.arcs import Arcs, EventSequence
from eppanalysis.methods.orbits.delayed.mesh import Mesh, basis, nodes
from eppanalysis.models.systems.hybrid import DELAY_LINE, HybridSystem

if TYPE_CHECKING:
    from scipy.sparse import csc_array

#: Echoes of each switch at which pieces end, and degree of the polynomials; the finer ones tell the error.
COARSE, FINE = (6, 9), (9, 12)
_MOST_ITERATIONS = 10
#: Step in the dwell times, of the period, for their derivative; largest step of Newton's method; and converged.
_STEP, _LARGEST, _CONVERGED = 1e-6, 0.1, 1e-10
#: What two refinements may differ in the motion, relative to its size, and in the multipliers.
_AGREE, _AGREE_MULTIPLIERS = 1e-8, 1e-5
#: What is taken for the multiplier 1 of a shift along the orbit; and how many are given, the largest ones.
_ALONG, _MULTIPLIERS = 1e-4, 6
#: What another guard may rise above zero, relative to the size of its terms.
_PASSED = 1e-8


@dataclass(frozen=True, eq=False)
class DelayedMotion:
    """A motion around the arcs with given dwell times."""

    arcs: Arcs  # without timers: what is delayed is in ``S``, ``gs`` and ``W``
    tau: Array  # (p,): dwell times [s]
    mesh: Mesh
    values: Array  # (pieces, degree + 1, N): y at the nodes of each piece
    lines: tuple[IntArray, Array]  # (s,): output that each delay line is fed with, and its dead time [s]
    error: float = float("nan")  # what it differs from a coarser one, relative to its size; nan where that is not known
    #: The largest Floquet multipliers, that of a shift along the orbit left out.
    multipliers: ComplexArray = field(default_factory=lambda: np.zeros(0, complex))

    def states(self, times: Array) -> Array:
        """The vector y at times, shape (nt, N)."""
        piece, _, row = self.mesh.locate(times)
        return np.einsum("tj,tjn->tn", row, self.values[piece])

    def on(self, mesh: Mesh) -> Array:
        """Values at the nodes of another mesh with the same dwell times."""
        inside = np.clip(nodes(mesh.degree), 1e-9, 1.0 - 1e-9)  # on the own side of an event
        times = mesh.breaks[:-1, None] + mesh.size[:, None] * inside
        return self.states(times.ravel()).reshape(*times.shape, -1)

    def delayed(self, times: Array) -> Array:
        """What comes out of the dead times, shape (nt, s)."""
        columns = [self._fed(w, times - late) for w, late in zip(*self.lines, strict=True)]
        return np.stack(columns, axis=1)

    def _fed(self, output: int, times: Array) -> Array:
        piece, _, row = self.mesh.locate(times)
        y = np.einsum("tj,tjn->tn", row, self.values[piece])
        return np.einsum("tn,tn->t", self.arcs.W[self.mesh.arc[piece], output], y)

    def signals(self, times: Array) -> Array:
        """Signals of the loop at times, shape (nt, signals)."""
        arc = self.mesh.arc[self.mesh.locate(times)[0]]
        of_state = np.einsum("tsj,tj->ts", self.arcs.Y[arc], self.states(times))
        return of_state + np.einsum("tsj,tj->ts", self.arcs.Ys[arc], self.delayed(times))

    @property
    def ends(self) -> Array:
        """The vector y before each event, shape (p, N)."""
        return self.values[self.mesh.last, -1]

    @property
    def starts(self) -> Array:
        """The vector y behind each event, that at the begin first and last, shape (p + 1, N)."""
        behind = np.einsum("pij,pj->pi", self.arcs.J, self.ends)
        return np.vstack([behind[-1:], behind])

    @cached_property
    def marks(self) -> Array:
        """Times of the events, shape (p,), the last one closes the period [s]."""
        return np.cumsum(self.tau)

    @cached_property
    def guards(self) -> Array:
        """Value of the guard that ends each arc, shape (p,)."""
        before = self._before(self.marks)
        own = np.einsum("pn,pn->p", self.arcs.g, self.ends)
        return own + np.einsum("ps,ps->p", self.arcs.gs, self.delayed(before))

    def _before(self, times: Array) -> Array:
        """Just so much earlier that an echo which falls on an event has not come yet."""
        return times - 1e-13 * self.mesh.period

    @property
    def residual(self) -> tuple[Array, Array]:
        """What the equations of the motion lack, in free places at all nodes, and the guards that end its arcs.

        The joint is at the first node of each piece, at the others the collocation at its Gauss points.
        """
        arcs, mesh = self.arcs, self.mesh
        u, at, slope = collocation(mesh.degree)
        rate = np.einsum("jn,pni->pji", slope, self.values) / mesh.size[:, None, None]
        y = np.einsum("jn,pni->pji", at, self.values)
        late = self.delayed((mesh.breaks[:-1, None] + mesh.size[:, None] * u).ravel())
        n = arcs.F.shape[1]
        rate[:, :, :n] -= np.einsum("pik,pjk->pji", arcs.F[mesh.arc], y)
        rate[:, :, :n] -= np.einsum("pis,pjs->pji", arcs.S[mesh.arc], late.reshape(*rate.shape[:2], -1))
        joint = self.values[:, 0] - np.einsum("pik,pk->pi", maps(arcs, mesh), np.roll(self.values[:, -1], 1, axis=0))
        return np.concatenate([joint[:, None], rate], axis=1)[:, :, arcs.free].ravel(), self.guards

    @property
    def rates_before(self) -> Array:
        """Rate of y before each event, shape (p, N)."""
        return self._rates(np.arange(self.tau.size), self.ends, self._before(self.marks))

    @property
    def rates_behind(self) -> Array:
        """Rate of y behind each event, shape (p, N)."""
        arc = np.roll(np.arange(self.tau.size), -1)
        return self._rates(arc, self.starts[1:], self.marks + 1e-13 * self.mesh.period)

    def _rates(self, arc: IntArray, y: Array, t: Array) -> Array:
        rate = np.zeros_like(y)
        n = self.arcs.F.shape[1]
        rate[:, :n] = np.einsum("pij,pj->pi", self.arcs.F[arc], y)
        rate[:, :n] += np.einsum("pij,pj->pi", self.arcs.S[arc], self.delayed(t))
        return rate

    @cached_property
    def speed(self) -> Array:
        """Rate at which each guard is crossed, shape (p,)."""
        own = np.einsum("pn,pn->p", self.arcs.g, self.rates_before)
        h = 1e-6 * self.mesh.period
        back = (self.delayed(self._before(self.marks)) - self.delayed(self.marks - h)) / h
        return own + np.einsum("ps,ps->p", self.arcs.gs, back)

    @cached_property
    def scale(self) -> Array:
        """Size of the motion in each place of y; never zero."""
        span, size = np.ptp(self.values, axis=(0, 1)), np.abs(self.values).max(axis=(0, 1))
        return np.where(span > 1e-9 * size, span, np.where(size > 0, size, 1.0))


@lru_cache(maxsize=8)
def collocation(degree: int) -> tuple[Array, Array, Array]:
    """Gauss points of a piece, and the rows that give a polynomial and its slope there from its values at the nodes."""
    u = 0.5 + 0.5 * legendre.leggauss(degree)[0]
    return u, basis(u, degree), basis(u, degree, 1)


def maps(arcs: Arcs, mesh: Mesh) -> Array:
    """What takes y from the end of the piece before to the begin of each piece, shape (pieces, N, N)."""
    J = np.broadcast_to(np.eye(arcs.size), (mesh.n_pieces, arcs.size, arcs.size)).copy()
    J[(mesh.last + 1) % mesh.n_pieces] = arcs.J
    return J


def is_delayed(hybrid: HybridSystem) -> bool:
    """Whether signals are delayed in a loop, and all else is linear between switches."""
    kind = hybrid.model.smooth_kind
    return bool(kind.size) and bool(np.all(kind == DELAY_LINE))


def delayed_motion(hybrid: HybridSystem, event_sequence: EventSequence, y: Array, tau: Array) -> DelayedMotion | None:
    """The periodic motion with a cyclic sequence of events, from about the dwell times tau; None where there is none.

    Parameters
    ----------
    y : array, shape (n + memory,)
        With the steady inputs and the values that are held all the time.
    tau : array, shape (p,)
        Dwell times [s].

    Raises
    ------
    ModelError
        If the loop has no such arcs.
    """
    if np.any(event_sequence.at_once) or not np.all(tau > 0):
        return None
    undelayed = replace(hybrid, model=hybrid.model._replace(smooth_kind=np.zeros_like(hybrid.model.smooth_kind)))
    arcs = Arcs.build(undelayed, event_sequence)
    if np.any(arcs.shift):
        return None
    arcs = replace(arcs, smooth=np.zeros_like(arcs.smooth))
    lines = hybrid.model.smooth_w, hybrid.model.smooth_delay
    delays = np.unique(lines[1])
    # Two meshes, for collocation has no residual that says how far it is off (docs/theory/exact_orbits.md, Closing an
    # orbit): what they differ in is the error.
    mesh = Mesh.of(tau, delays, *COARSE)
    begun = _begun(mesh, arcs, y, lines)
    coarse = None if begun is None else _closed(mesh, arcs, begun, lines)
    if coarse is None:
        return None
    mesh = Mesh.of(coarse.tau, delays, *FINE)
    fine = _closed(mesh, arcs, coarse.on(mesh), lines)
    if fine is None or _meets_others(undelayed, fine):
        return None
    u = np.linspace(0.0, 1.0, 8 * fine.mesh.n_pieces, endpoint=False)
    away = np.abs(fine.states(u * fine.mesh.period) - coarse.states(u * coarse.mesh.period)) / fine.scale
    error = max(float(np.max(away)), float(np.max(np.abs(fine.tau - coarse.tau))) / fine.mesh.period)
    rough, multipliers = _multipliers(coarse), _multipliers(fine)
    if rough is None or multipliers is None or not agrees(error, rough, multipliers):
        return None
    return replace(fine, error=error, multipliers=multipliers)


def agrees(error: float, rough: ComplexArray, fine: ComplexArray) -> bool:
    """Whether two refinements of a motion, that differ by an error in its size, are one, and as stable."""
    first, second = (np.abs(m[:1]).max(initial=0.0) for m in (rough, fine))
    return bool(error < _AGREE and abs(first - second) <= _AGREE_MULTIPLIERS * max(1.0, second))


def _closed(mesh: Mesh, arcs: Arcs, whole: Array, lines: tuple[IntArray, Array]) -> DelayedMotion | None:
    """Newton's method on the motion and the dwell times; None where it does not converge.

    `whole` are the values at the nodes, with those that stay as they are.
    """
    for _ in range(_MOST_ITERATIONS):
        step = _step(mesh, arcs, whole, lines)
        if step is None:
            return None
        change, shift = step
        span = np.ptp(whole[:, :, arcs.free], axis=(0, 1))
        largest = max(np.max(np.abs(shift)) / mesh.period, np.max(np.abs(change) / np.where(span > 0, span, np.inf)))
        # Dwell times move the mesh itself, so they are changed by a tenth of the period at most.
        share = min(1.0, _LARGEST * mesh.period / max(float(np.max(np.abs(shift))), 1e-300))
        tau = mesh.tau + share * shift
        if not np.isfinite(largest) or np.any(tau <= 0):
            return None
        whole = whole.copy()
        whole[:, :, arcs.free] += share * change
        mesh = mesh.moved(tau)
        if np.any(mesh.size <= 0):
            return None
        if largest < _CONVERGED:
            return DelayedMotion(arcs, tau, mesh, whole, lines)
    return None


def _step(mesh: Mesh, arcs: Arcs, whole: Array, lines: tuple[IntArray, Array]) -> tuple[Array, Array] | None:
    """Newton's step of the values at the nodes and of the dwell times."""
    from scipy.sparse import block_array, csc_array
    from scipy.sparse.linalg import splu

    here = _Equations(arcs, mesh, lines)
    free = here.places(arcs.free)
    p, h = mesh.tau.size, _STEP * mesh.period

    def residual_at(tau: Array) -> Array:
        return np.concatenate(DelayedMotion(arcs, tau, mesh.moved(tau), whole, lines).residual)

    # A dwell time moves the nodes of its own arc and all that is read through the dead times: by differences, which
    # slow Newton's method a little and do not shift where it ends.
    residual = residual_at(mesh.tau)
    columns = np.stack([residual_at(mesh.tau + h * unit) - residual for unit in np.eye(p)], axis=1) / h
    matrix = block_array(
        [[here.around[free][:, free], csc_array(columns[:-p])], [here.guards[:, free], csc_array(columns[-p:])]]
    )
    try:
        step = splu(matrix.tocsc()).solve(-residual)
    except RuntimeError:  # singular
        return None
    return step[:-p].reshape(mesh.n_pieces, mesh.degree + 1, -1), step[-p:]


def _begun(mesh: Mesh, arcs: Arcs, y: Array, lines: tuple[IntArray, Array]) -> Array | None:
    """Values at the nodes that come nearest to solving the equations with given dwell times.

    On an orbit they have the rate of the motion as a solution of their own, which only the guards tell apart.
    """
    from scipy.sparse import block_array, eye_array, vstack
    from scipy.sparse.linalg import splu

    equations = _Equations(arcs, mesh, lines)
    free, fixed = equations.places(arcs.free), np.setdiff1d(np.arange(arcs.size), arcs.free)
    whole = np.zeros((mesh.n_pieces, mesh.degree + 1, arcs.size))
    whole[:, :, fixed] = y[fixed]
    M = vstack([equations.around[free][:, free], equations.guards[:, free]])
    right = -np.concatenate(DelayedMotion(arcs, mesh.tau, mesh, whole, lines).residual)
    # More equations than unknowns, as dwell times are given: least squares as one sparse system in which M is as it
    # is.
    normal: Any = [[eye_array(M.shape[0]), M], [M.T, None]]
    try:
        found = splu(block_array(normal).tocsc()).solve(np.append(right, np.zeros(free.size)))
    except RuntimeError:
        return None
    whole.reshape(-1)[free] = found[M.shape[0] :]
    return whole if np.all(np.isfinite(whole)) else None


class _Equations:
    """The equations of a motion on a mesh, ``sum of matrices[k] y(k periods ago) = 0``; lives for one call.

    With `motion` those of a small disturbance of it, which also shifts its events.
    """

    def __init__(
        self, arcs: Arcs, mesh: Mesh, lines: tuple[IntArray, Array], motion: DelayedMotion | None = None
    ) -> None:
        self.arcs, self.mesh, self.lines = arcs, mesh, lines
        self.entries: list[tuple[IntArray, IntArray, IntArray, Array]] = []
        self._flow()
        self._joints()
        if motion is not None:
            self._shifts(motion)
        self.matrices = by_turns(self.entries, mesh.n_pieces * (mesh.degree + 1) * arcs.size)

    def places(self, of_y: IntArray) -> IntArray:
        """Places of those of y among the unknowns."""
        first = np.arange(self.mesh.n_pieces * (self.mesh.degree + 1)) * self.arcs.size
        return np.asarray((first[:, None] + of_y).ravel(), np.int64)

    def _place(self, piece: IntArray, node: IntArray, place: IntArray) -> IntArray:
        return np.asarray((piece * (self.mesh.degree + 1) + node) * self.arcs.size + place, np.int64)

    def _add(self, turn: IntArray, row: IntArray, column: IntArray, value: Array) -> None:
        shape = np.broadcast_shapes(turn.shape, row.shape, column.shape, value.shape)
        kept = np.broadcast_to(value, shape) != 0.0
        at, of_row, of_column = (np.broadcast_to(a, shape)[kept] for a in (turn, row, column))
        self.entries.append((at, of_row, of_column, np.broadcast_to(value, shape)[kept]))

    def _flow(self) -> None:
        """Collocation at the Gauss points of each piece: rows of all nodes but the first."""
        arcs, mesh, m, N = self.arcs, self.mesh, self.mesh.degree, self.arcs.size
        n = arcs.F.shape[1]
        u, at, slope = collocation(m)
        piece, j, node, i = np.ix_(np.arange(mesh.n_pieces), np.arange(m), np.arange(m + 1), np.arange(N))
        now = np.zeros(1, np.int64)
        row = self._place(piece, j + 1, i)
        self._add(now, row, self._place(piece, node, i), (slope[None, :, :, None] / mesh.size[:, None, None, None]))
        F = np.zeros((mesh.n_pieces, N, N))
        F[:, :n] = arcs.F[mesh.arc]
        piece, j, node, i, k = np.ix_(*(np.arange(s) for s in (mesh.n_pieces, m, m + 1, n, N)))
        row = self._place(piece, j + 1, i)
        self._add(now, row, self._place(piece, node, k), -F[:, None, None, :n, :] * at[None, :, :, None, None])
        times = mesh.breaks[:-1, None] + mesh.size[:, None] * u
        for line, (w, late) in enumerate(zip(*self.lines, strict=True)):
            source, turn, weight = mesh.locate((times - late).ravel())
            source, turn, weight = source.reshape(-1, m), turn.reshape(-1, m), weight.reshape(-1, m, m + 1)
            gain = arcs.S[mesh.arc][:, None, None, :, None, line] * arcs.W[mesh.arc[source], w][:, :, None, None, :]
            there = self._place(source[:, :, None, None, None], node, k)
            self._add(turn[:, :, None, None, None], row, there, -weight[:, :, :, None, None] * gain)

    def _joints(self) -> None:
        """Each piece begins where the one before ends, behind an event by its map."""
        mesh, N, m = self.mesh, self.arcs.size, self.mesh.degree
        before = np.roll(np.arange(mesh.n_pieces), 1)
        piece, i, k = np.ix_(np.arange(mesh.n_pieces), np.arange(N), np.arange(N))
        none, first = np.zeros(1, np.int64), (np.arange(mesh.n_pieces) == 0).astype(np.int64)[:, None, None]
        at, end = np.zeros(1, np.int64), np.full(1, m)
        self._add(none, self._place(piece, at, i), self._place(piece, at, i), np.ones(1))
        self._add(first, self._place(piece, at, i), self._place(before[piece], end, k), -maps(self.arcs, mesh))

    def _shifts(self, motion: DelayedMotion) -> None:
        """What the shift of an event does behind it, and, where the output jumps, behind the dead time."""
        arcs, mesh, p = self.arcs, self.mesh, self.mesh.tau.size
        # The saltation matrix without J (docs/theory/exact_orbits.md, Floquet multipliers), which the joints have
        # already.
        kick = np.einsum("pij,pj->pi", arcs.J, motion.rates_before) - motion.rates_behind
        for e, last in enumerate(mesh.last.tolist()):
            guard = self._guard(e)
            self._push((last + 1) % mesh.n_pieces, int(last + 1 == mesh.n_pieces), kick[e] / motion.speed[e], guard)
            for line, (w, late) in enumerate(zip(*self.lines, strict=True)):
                jump = arcs.W[e, w] @ motion.ends[e] - arcs.W[(e + 1) % p, w] @ motion.starts[e + 1]
                turn = int(np.floor((motion.marks[e] + late) / mesh.period * (1.0 + 1e-14)))
                arrival = motion.marks[e] + late - turn * mesh.period
                piece = int(np.argmin(np.abs(mesh.breaks[:-1] - arrival)))
                push = np.zeros(arcs.size)
                push[: arcs.S.shape[1]] = arcs.S[mesh.arc[piece], :, line] * jump / motion.speed[e]
                self._push(piece, turn, push, guard)

    def _push(self, piece: int, turn: int, effect: Array, guard: tuple[IntArray, IntArray, Array]) -> None:
        """Add `effect` times the value of a guard, so many periods ago, where a piece begins."""
        turns, columns, values = guard
        rows = self._place(np.array(piece), np.array(0), np.arange(self.arcs.size))[:, None]
        self._add(turns + turn, rows, columns, effect[:, None] * values)

    def _guard(self, arc: int) -> tuple[IntArray, IntArray, Array]:
        """The guard at the end of an arc as a row: turns, columns, values."""
        arcs, mesh, m, N = self.arcs, self.mesh, self.mesh.degree, self.arcs.size
        last = mesh.last[arc]
        turns, columns, values = [np.zeros(N, np.int64)], [self._place(last, np.array(m), np.arange(N))], [arcs.g[arc]]
        for line, (w, late) in enumerate(zip(*self.lines, strict=True)):
            # Just so much earlier that an echo which falls on the event has not come yet.
            (piece,), (turn,), (weight,) = mesh.locate(np.array([mesh.breaks[last + 1] - late - 1e-13 * mesh.period]))
            turns.append(np.full((m + 1) * N, turn))
            columns.append(self._place(piece, np.arange(m + 1)[:, None], np.arange(N)).ravel())
            values.append(arcs.gs[arc, line] * np.outer(weight, arcs.W[mesh.arc[piece], w]).ravel())
        return np.concatenate(turns), np.concatenate(columns), np.concatenate(values)

    @cached_property
    def around(self) -> csc_array:
        """All matrices together, for a motion that repeats itself."""
        return sum(self.matrices[1:], start=self.matrices[0])

    @cached_property
    def guards(self) -> csc_array:
        """Value of the guard at the end of each arc."""
        from scipy.sparse import coo_array

        rows = [self._guard(a) for a in range(self.mesh.tau.size)]
        place = np.repeat(np.arange(len(rows)), [columns.size for _, columns, _ in rows])
        columns, values = (np.concatenate([row[k] for row in rows]) for k in (1, 2))
        return coo_array((values, (place, columns)), shape=(len(rows), self.around.shape[0])).tocsc()


def _multipliers(motion: DelayedMotion) -> ComplexArray | None:
    """The largest Floquet multipliers without that of a shift along the orbit; None where that one is not there."""
    if np.any(np.abs(motion.speed) <= 0):
        return None
    system = _Equations(motion.arcs, motion.mesh, motion.lines, motion)
    free = system.places(motion.arcs.free)
    return multipliers_of([a[free][:, free] for a in system.matrices])


def by_turns(entries: Sequence[tuple[IntArray, IntArray, IntArray, Array]], size: int) -> list[csc_array]:
    """The matrix (size, size) of each turn from entries with their turn, row, column and value."""
    from scipy.sparse import coo_array

    turn, row, column, value = (np.concatenate(parts) for parts in zip(*entries, strict=True))
    return [
        coo_array((value[turn == k], (row[turn == k], column[turn == k])), shape=(size, size)).tocsc()
        for k in range(int(turn.max()) + 1)
    ]


def multipliers_of(matrices: Sequence[csc_array]) -> ComplexArray | None:
    """The largest multipliers of ``sum of matrices[k] y(k periods ago) = 0``, less the 1 of a shift along the orbit.

    None where that one is not there.
    """
    from scipy.sparse.linalg import splu

    now, *earlier = matrices
    # Only what is still on its way at the end of a period is felt in later ones.
    felt = np.flatnonzero(np.sum([np.diff(a.indptr) for a in earlier], axis=0))
    try:
        solve = splu(now.tocsc())
    except RuntimeError:
        return None
    step = np.eye(felt.size * len(earlier), k=-felt.size)  # what was so many periods ago is then one more
    step[: felt.size] = np.hstack([-solve.solve(a[:, felt].toarray())[felt] for a in earlier])
    values = np.linalg.eigvals(step).astype(complex)
    along = int(np.argmin(np.abs(values - 1.0)))
    if abs(values[along] - 1.0) > _ALONG:
        return None
    values = np.delete(values, along)
    return values[np.argsort(-np.abs(values), kind="stable")][:_MULTIPLIERS]


def _meets_others(undelayed: HybridSystem, motion: DelayedMotion) -> bool:
    """Whether a guard other than the one that ends an arc is passed on it, or that one earlier."""
    it, model = motion.arcs.event_sequence, undelayed.model
    arc, guard = [], []
    for a, modes in enumerate(it.modes):
        for m in model.mode_first[:-1] + modes:
            for g in range(model.guard_first[m], model.guard_first[m + 1]):
                arc.append(a)
                guard.append(g)
    none = np.full((len(arc), 3), -1)
    every = EventSequence(it.modes[arc], np.array(guard, np.int64), none, np.zeros(len(arc), np.int64))
    rows = Arcs.build(undelayed, every, motion.arcs)
    begins = motion.marks - motion.tau
    for k, a in enumerate(arc):
        times = begins[a] + motion.tau[a] * np.linspace(0.0, 1.0, 130)[1:-1]
        y, late = motion.states(times), motion.delayed(times)
        value = y @ rows.g[k] + late @ rows.gs[k]
        size = np.abs(rows.g[k]) @ motion.scale + np.abs(late) @ np.abs(rows.gs[k])
        if np.any(value > _PASSED * np.max(size)):
            return True
    return bool(np.any(motion.speed <= 0))
