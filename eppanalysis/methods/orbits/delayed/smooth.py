"""Periodic motions of loops with a dead time and elements that do not jump, smooth ones among them: collocation.

    dx/dt = A x + B w(t - delays) + held inputs,   z = C x + D w + held inputs,   w = f(z)

A balance tells where the motion is and at which phases the elements have corners. There, and at echoes of these, the
pieces end. Newton's method on the values at their nodes and the period solves the equations themselves, without cut-off
harmonics (docs/theory/exact_orbits.md, Closing an orbit); the same linearised equations carry a disturbance from one
period into the next, so that their eigenvalues are the multipliers.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import NDArray

from eppanalysis.arrays import Array, BoolArray, ComplexArray, IntArray
from eppanalysis.errors import ModelError
from eppanalysis.methods.harmonic.balance import balances_of, cycle_of, settled
from eppanalysis.methods.harmonic.elements import Unsettled
from eppanalysis.methods.harmonic.loop import Loop, inputs_of
from eppanalysis.methods.harmonic.series import TURN, orders, values as waves
from eppanalysis.methods.orbits.delayed.mesh import Mesh, basis
from eppanalysis.methods.orbits.delayed.motion import COARSE, FINE, agrees, by_turns, multipliers_of
from eppanalysis.methods.orbits.target import Target
from eppanalysis.methods.simulation.budget import spend
from eppanalysis.methods.simulation.period import analyse_period
from eppanalysis.methods.simulation.stability import describe, is_stable
from eppanalysis.models.systems.hybrid import DELAY_LINE, HybridSystem
from eppanalysis.models.systems.lure import LureSystem
from eppanalysis.models.systems.operating import OperatingPoint
from eppanalysis.readable import percent
from eppanalysis.results import EXACT_ORBIT, LimitCycle

if TYPE_CHECKING:
    from scipy.sparse import csc_array

#: Orders of the balance from which the corners of elements are read; estimate below which one is a start.
_ORDERS, _TRUSTED = (50, 100, 200), 0.05
_MOST_ITERATIONS, _CONVERGED = 12, 1e-11
#: Differences for the slopes of elements, relative to the size of their inputs, and in the period for its derivative.
_STEP = 1e-6
#: Unknowns at most; and steps of the engine that each of them is worth in a step of Newton's method.
_MOST_UNKNOWNS, _UNKNOWN = 12_000, 10.0
#: Corners nearer than this to each other, of a period, are one.
_SAME = 1e-7
#: Where an output is evaluated beside a corner, of a turn; and the share of its size by which it jumps there.
_BESIDE, _JUMP = 1e-9, 1e-6


def is_smooth_delayed(hybrid: HybridSystem) -> bool:
    """Whether a loop has a dead time and is not linear between switches."""
    kind = hybrid.model.smooth_kind
    return bool(np.any(kind == DELAY_LINE)) and bool(np.any(kind != DELAY_LINE))


def closed_behind_delay(
    system: LureSystem, hybrid: HybridSystem, start: LimitCycle, at: OperatingPoint
) -> tuple[LimitCycle | None, str]:
    """The exact cycle that an approximate one leads to, and where it is not closed how far a balance came."""
    asked, best, loop = Target.of(system, hybrid, start), None, None
    with suppress(ModelError):
        loop = Loop.of(system, at.vector(system))
        for balance in balances_of(system, start, at):
            if not asked.loosened().shape_difference(balance):
                best = balance
    if best is None or loop is None:
        return None, "no harmonic balance leads to it"
    closed = None
    at_once = all(e.n_inputs == e.n_outputs == 1 and not e.remembers for e in system.elements)
    if best.error_estimate < _TRUSTED and at_once:
        with suppress(ModelError, Unsettled):
            closed = _closed(loop, best)
    if closed is not None and not Target.of(system, hybrid, best).shape_difference(closed):
        return closed, ""
    return None, f"{best.method}, not closed: {best.size}, within {percent(best.error_estimate)}"


@dataclass(frozen=True, eq=False)
class _Course:
    """A motion on a mesh: values (pieces, degree + 1, n) of the state at the nodes."""

    loop: Loop
    mesh: Mesh
    values: Array

    def states(self, times: Array) -> Array:
        """States at times, shape (nt, n)."""
        piece, _, row = self.mesh.locate(times)
        return np.asarray(np.einsum("tj,tjn->tn", row, self.values[piece]), float)

    def on(self, mesh: Mesh) -> _Course:
        """The same motion on another mesh."""
        times = mesh.times * (self.mesh.period / mesh.period)
        return _Course(self.loop, mesh, self.states(times.ravel()).reshape(*times.shape, -1))

    @cached_property
    def sizes(self) -> Array:
        """How far each input of the elements moves, shape (nw,)."""
        z = self.values.reshape(-1, self.values.shape[-1]) @ self.loop.system.C.T
        return np.maximum(np.ptp(z, axis=0), 1e-300)

    def inputs(self, x: Array) -> tuple[Array, Array]:
        """Inputs and outputs of the elements in states x (nt, n), each shape (nt, nw)."""
        system, value = self.loop.system, self.loop.value
        given = x @ system.C.T + system.D_input @ value + system.constant_input
        z, w = given, self._outputs(given)
        for _ in system.elements if np.any(system.D) else ():  # a cascade is done after so many passes
            z = given + w @ system.D.T
            w = self._outputs(z)
        return z, w

    def _outputs(self, z: Array) -> Array:
        return np.stack([e.output(z[:, i])[0] for i, e in enumerate(self.loop.system.elements)], axis=1)

    def slopes(self, x: Array) -> Array:
        """Derivatives of the outputs by the state, shape (nt, nw, n)."""
        system, (z, _), h = self.loop.system, self.inputs(x), _STEP * self.sizes
        K = (self._outputs(z + h) - self._outputs(z - h)) / (2.0 * h)
        inner = np.eye(len(h)) - system.D * K[:, None, :]
        return np.asarray(K[:, :, None] * np.linalg.solve(inner, np.broadcast_to(system.C, (len(x), *system.C.shape))))

    def signals(self, times: Array) -> Array:
        """Signals of the loop at times, shape (nt, signals)."""
        s, x = self.loop.system.signals, self.states(times)
        return np.asarray(x @ s.C.T + self.inputs(x)[1] @ s.D.T + s.D_input @ self.loop.value + s.constant, float)

    @cached_property
    def _points(self) -> tuple[Array, Array, Array]:
        """Gauss points of the pieces (pieces, m) [s], and the rows of values and slopes there (m, m + 1)."""
        m = self.mesh.degree
        u = 0.5 + 0.5 * legendre.leggauss(m)[0]
        times = self.mesh.breaks[:-1, None] + self.mesh.size[:, None] * u
        return times, basis(u, m), basis(u, m, 1)

    def residual(self, values: Array) -> Array:
        """Of the equations at the Gauss points of each piece, behind where the piece begins; shape as the values."""
        system, (times, at, slope), here = self.loop.system, self._points, replace(self, values=values)
        rate = np.einsum("jk,pkn->pjn", slope, values) / self.mesh.size[:, None, None]
        x = np.einsum("jk,pkn->pjn", at, values)
        right = x @ system.A.T + system.B_input @ self.loop.value + system.constant_state
        for late, columns in _lines(system):
            w = here.inputs(here.states(times.ravel() - late))[1][:, columns]
            right += (w @ system.B[:, columns].T).reshape(right.shape)
        joints = values[:, :1] - np.roll(values[:, -1:], 1, axis=0)
        return np.concatenate([joints, rate - right], axis=1)

    def matrices(self) -> list[csc_array]:
        """The linearised equations: ``sum of matrices[k] y(k periods ago) = 0`` for a disturbance y at the nodes."""
        return by_turns(list(self._blocks()), self.values.size)

    def _blocks(self) -> Iterator[tuple[IntArray, IntArray, IntArray, Array]]:
        """Turn, row, column and value of entries: of states and rates, of what comes late, and of the joints."""
        system, (times, at, slope), n = self.loop.system, self._points, self.values.shape[-1]
        pieces, m = times.shape
        place = np.arange(self.values.size).reshape(self.values.shape)
        rows, here = place[:, 1:, :, None, None], place[:, None, None, :, :]
        eye = np.eye(n)[:, None, :]
        rate = slope[None, :, None, :, None] * eye / self.mesh.size[:, None, None, None, None]
        yield _entries(0, rows, here, rate - at[None, :, None, :, None] * system.A[:, None, :])
        for late, columns in _lines(system):
            source, turn, weight = self.mesh.locate(times.ravel() - late)
            gain = system.B[:, columns] @ self.slopes(self.states(times.ravel() - late))[:, columns]
            effect = -weight.reshape(pieces, m, 1, m + 1, 1) * gain.reshape(pieces, m, n, 1, n)
            there = place[source].reshape(pieces, m, 1, m + 1, n)
            yield _entries(turn.reshape(pieces, m, 1, 1, 1), rows, there, effect)
        first = (np.arange(pieces) == 0)[:, None]
        yield _entries(0, place[:, 0], place[:, 0], np.ones((pieces, n)))
        yield _entries(first, place[:, 0], np.roll(place[:, -1], 1, axis=0), -np.ones((pieces, n)))


def _entries(
    turn: NDArray[Any] | int, row: NDArray[Any], column: NDArray[Any], value: Array
) -> tuple[IntArray, IntArray, IntArray, Array]:
    whole = np.broadcast_arrays(turn, row, column, value)
    kept = whole[3].ravel() != 0.0
    turns, rows, columns, values = (a.ravel()[kept] for a in whole)
    return turns, rows, columns, values


def _lines(system: LureSystem) -> list[tuple[float, BoolArray]]:
    """Dead times, and the outputs that come so much later; zero for those that come at once."""
    return [(float(late), system.delays == late) for late in np.unique(system.delays)]


def _closed(loop: Loop, balance: LimitCycle) -> LimitCycle | None:
    """The exact cycle near a balance; None where collocation does not close it, or two meshes differ."""
    Z, omega = inputs_of(loop, balance), balance.omega
    corners = _corners(loop, Z, omega)
    if _jumps(loop, Z, corners):
        return None
    for n in _ORDERS if corners.size else ():  # corners must be where they are
        found = settled(loop, loop.continued(Z, omega, n), omega)
        if found is None:
            break
        Z, omega = found
        corners = _corners(loop, Z, omega)
    balance = cycle_of(loop, Z, omega)
    delays = np.unique(loop.system.delays[loop.system.delays > 0])
    tau = np.diff(np.append(corners, corners[0] + TURN)) / omega if corners.size else np.array([TURN / omega])
    echoes = 1 if corners.size else 0
    begun: _Series | _Course = _begun(loop, Z, omega, corners[0] / omega if corners.size else 0.0, balance.mean_state)
    made = []
    for most, degree in (COARSE, FINE):
        course = _settled(_on(begun, loop, Mesh.of(tau, delays, echoes * most, degree)))
        if course is None:
            return None
        made.append((course, multipliers_of(course.matrices())))
        tau, begun = course.mesh.tau, course
    return _result(loop, balance, made[0], made[1])


def _corners(loop: Loop, Z: ComplexArray, omega: float) -> Array:
    """Phases within a turn at which elements have a corner, in order."""
    phases = np.sort(np.concatenate([r.phases % TURN for r in loop.answers(Z, omega)[1]]))
    return phases[np.diff(phases, prepend=-1.0) > _SAME * TURN]


def _jumps(loop: Loop, Z: ComplexArray, corners: Array) -> bool:
    """Whether an output jumps at a corner."""
    around, beside = np.linspace(0.0, TURN, 64), _BESIDE * TURN
    at = (waves(Z, phases) for phases in (corners - beside, corners + beside, around))
    for e, *inputs in zip(loop.system.elements, *at, strict=True):
        before, behind, all_round = (e.output(z)[0] for z in inputs)
        if np.any(np.abs(behind - before) > _JUMP * np.ptp(all_round)):
            return True
    return False


@dataclass(frozen=True, eq=False)
class _Series:
    """The states of a balance as a Fourier series from a time on."""

    coefficients: ComplexArray
    omega: float
    begin: float

    def states(self, times: Array) -> Array:
        """States at times, shape (nt, n)."""
        waves = np.exp(1j * self.omega * np.outer(times + self.begin, orders(len(self.coefficients) - 1)))
        return np.asarray((waves @ self.coefficients).real, float)


def _begun(loop: Loop, Z: ComplexArray, omega: float, begin: float, mean: Array) -> _Series:
    W, _ = loop.answers(Z, omega)
    moving = (loop.system.state_response(omega * orders(Z.shape[1] - 1)[1:]) @ W.T[1:, :, None])[..., 0]
    return _Series(np.vstack([mean + 0j, moving]), omega, begin)


def _on(begun: _Series | _Course, loop: Loop, mesh: Mesh) -> _Course:
    """A motion at the nodes of a mesh."""
    if isinstance(begun, _Course):
        return begun.on(mesh)
    return _Course(loop, mesh, begun.states(mesh.times.ravel()).reshape(*mesh.times.shape, -1))


def _settled(course: _Course) -> _Course | None:
    """Newton's method on the values at the nodes and the period; None where it does not converge."""
    from scipy.sparse import block_array, csc_array
    from scipy.sparse.linalg import splu

    if course.values.size > _MOST_UNKNOWNS:
        return None
    size = np.ptp(course.values, axis=(0, 1))
    size = np.where(size > 0.0, size, 1.0)
    last = np.inf
    for _ in range(_MOST_ITERATIONS):
        spend(_UNKNOWN * course.values.size)
        residual = course.residual(course.values)
        longer = replace(course, mesh=course.mesh.moved(course.mesh.tau * (1.0 + _STEP)))
        by_period = (longer.residual(course.values) - residual).reshape(-1, 1) / _STEP
        # Among all shifts along the orbit the one that moves it least.
        along = np.gradient(course.values.reshape(-1, size.size), axis=0) / size**2
        now, *earlier = course.matrices()
        around: Any = sum(earlier, start=now)
        matrix: Any = block_array([[around, csc_array(by_period)], [csc_array(along.reshape(1, -1)), None]])
        try:
            step = splu(matrix.tocsc()).solve(-np.append(residual.ravel(), 0.0))
        except RuntimeError:  # singular
            return None
        change, share = step[:-1].reshape(course.values.shape), float(step[-1])
        largest = max(float(np.max(np.abs(change) / size)), abs(share))
        if not largest < 0.5:
            return None
        mesh = course.mesh.moved(course.mesh.tau * (1.0 + share))
        course = replace(course, values=course.values + change, mesh=mesh)
        if largest < _CONVERGED or (largest < 1e2 * _CONVERGED and largest > 0.3 * last):
            return course
        last = largest
    return None


def _result(
    loop: Loop,
    balance: LimitCycle,
    coarse: tuple[_Course, ComplexArray | None],
    fine: tuple[_Course, ComplexArray | None],
) -> LimitCycle | None:
    """The closed cycle; None where its refinements differ."""
    (rough, first), (course, values) = coarse, fine
    size, period = np.ptp(course.values, axis=(0, 1)), course.mesh.period
    size = np.where(size > 0.0, size, 1.0)
    u = np.linspace(0.0, 1.0, 8 * course.mesh.n_pieces, endpoint=False)
    away = np.abs(course.states(u * period) - rough.states(u * rough.mesh.period)) / size
    error = max(float(np.max(away)), abs(rough.mesh.period / period - 1.0))
    if values is None or first is None or not agrees(error, first, values):
        return None
    # Between the points at which they were solved, the equations are evaluated anew.
    finer = course.on(replace(course.mesh, degree=course.mesh.degree + 5))
    residual = float(np.max(np.abs(finer.residual(finer.values)) / (size / period)))
    system = loop.system
    shape = analyse_period(course.mesh.breaks, np.zeros(0), period / 40.0, system.signals.names, course.signals)
    return replace(
        balance,
        method=EXACT_ORBIT,
        period=period,
        mean=shape.mean,
        peak_to_peak=shape.peak_to_peak,
        harmonics=shape.harmonics,
        stable=is_stable(values),
        stability_criterion=describe(values),
        multipliers=values,
        residual=residual,
        error_estimate=error,
        time=shape.time,
        waveform=shape.waveform,
        state=course.values[0, 0].copy(),
        events=(),
        note="",
        provenance=replace(balance.provenance, method=EXACT_ORBIT),
    )
