"""A closed orbit of a fixed sequence of events: its equations, and Newton's method on them.

Between events the flow is known exactly with its derivative, so the equations are: every arc ends on its guard, and the
state behind the last event is the one behind the first.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from eppanalysis.arrays import Array, BoolArray, ComplexArray
from eppanalysis.engine.orbits import STRAY, Effort, Motion, newton_orbit, states_at, sweep_by
from eppanalysis.errors import ModelError
from eppanalysis.methods.orbits.arcs import Arcs
from eppanalysis.methods.orbits.delayed.motion import DelayedMotion
from eppanalysis.methods.orbits.guess import Guess, with_history
from eppanalysis.methods.simulation.budget import remaining, spend
from eppanalysis.methods.simulation.modes import way_back
from eppanalysis.methods.simulation.stability import multipliers, return_map
from eppanalysis.models.systems.hybrid import HybridSystem
from eppanalysis.models.systems.starts import input_rows

#: Residual, relative to the size of the motion, that counts as converged; Newton goes on to rounding.
CONVERGED = 1e-9
_MOST_ITERATIONS = 40
#: Orbits of many arcs get fewer iterations, for one costs the square of the number of arcs: their sum is limited to
#: this.
_FEW_ITERATIONS, _MOST_PRODUCTS = 8, 400_000
#: Share of the largest singular value of the scaled equations below which the smallest one is rounding.
_SINGULAR = 1e-14
#: A continuum of cycles is tested for below this share, at orbits so far beside the one found.
_NEARLY, _BESIDE = 1e-7, 0.01
#: Residual below which a motion of given period, beside another one, is one more.
_CLOSES = 1e-12
#: Steps of the engine that one sweep with its linear equations is worth: all at once, each arc, each entry of the
#: equations, and each series of smooth motion with its derivative.
_SWEEP, _ARC, _ENTRY, _SERIES = 200.0, 5.0, 0.1, 100.0


@dataclass(frozen=True, eq=False)
class Orbit:
    """A closed orbit of a hybrid system, or the last iterate on the way to it."""

    hybrid: HybridSystem
    arcs: Arcs
    y: Array  # (N,): state, timers, held and delayed values behind the event at the start
    tau: Array  # (p,): dwell times [s]
    #: starts, ends: (p + 1, N), (p, N): y behind and before each event.
    starts: Array
    ends: Array
    #: A, r: (m + p, m + p), (m + p,): derivative and residual of (periodicity, guards) over (free part of y, dwell
    #: times).
    A: Array
    r: Array
    speed: Array  # (p,): rate at which each guard is crossed
    scale: Array  # (N,): size of the motion in each place of y; never zero
    row_scale: Array  # (m + p,): sizes of the residual's entries
    #: Where what is delayed moves: the motion itself, of which the start alone tells too little.
    motion: DelayedMotion | None = None

    @cached_property
    def period(self) -> float:
        """Period [s]."""
        return float(self.tau.sum())

    @property
    def guess(self) -> Guess:
        """The orbit as a start for the next one."""
        return Guess(self.arcs.event_sequence, self.y, self.tau)

    def grazes(self, share: float) -> BoolArray:
        """Which guards are crossed more slowly than this share of the movement across them in a period, shape (p,)."""
        return np.abs(self.speed) * self.period < share * (np.abs(self.arcs.g) @ self.scale)

    @cached_property
    def column_scale(self) -> Array:
        """Sizes of the unknowns, shape (m + p,)."""
        return np.concatenate([self.scale[self.arcs.free], np.full(self.tau.size, max(self.period, 1e-300))])

    @property
    def scaled(self) -> Array:
        """The derivative A by unknowns and of equations in the sizes of the motion."""
        return self.A / self.row_scale[:, None] * self.column_scale

    @cached_property
    def residual(self) -> float:
        """Largest residual relative to the size of the motion."""
        with np.errstate(over="ignore", invalid="ignore"):  # of a motion that has gone beyond all range
            size = float(np.max(np.abs(self.r) / self.row_scale))
        return size if np.isfinite(size) else float("inf")

    @cached_property
    def return_map(self) -> Array:
        """Derivative of the return map, shape (m, m)."""
        return return_map(self.A, self.arcs.free.size)

    @cached_property
    def multipliers(self) -> ComplexArray:
        """Floquet multipliers, largest first; the largest of infinitely many where what is delayed moves."""
        if self.motion is not None:
            return self.motion.multipliers
        # Along an orbit whose period is given, by an input that drives it, a shift is a disturbance like any other.
        along = 1 if self.arcs.duration is None else 0
        # One for each state that must repeat, less the shift along the orbit, and one for each timer; those that vanish
        # are taken off first (docs/theory/exact_orbits.md, Multipliers that vanish).
        n_wanted = max(int(np.sum(self.hybrid.compared)) - along, 0) + self.arcs.n_timers
        return multipliers(self.return_map, self.scale[self.arcs.free], n_wanted)

    @property
    def holds(self) -> bool:
        """Whether an element holds a value that no switch on the cycle renews (a play that stays within its gap)."""
        # The elements' values are followed by the slopes of inputs and a 1.
        first, count = self.arcs.memory.start, int(self.hybrid.model.first[-1, 2])
        idle = np.setdiff1d(np.arange(first, first + count), self.arcs.free)
        return bool(np.any(self.arcs.F[:, :, idle]))

    @cached_property
    def one_of_many(self) -> bool:
        """Whether the cycle is one of a continuum.

        Either an element holds its value, or the equations leave a direction of the start free: to rounding, or nearly
        and there are closed orbits to both sides in that direction (of a centre, whose period may depend on the size).
        """
        if self.holds:
            return True
        if self.motion is not None:
            return False
        # Scaled, or the smallest singular value would only show that angles are beside seconds
        # (docs/theory/exact_orbits.md, The search for all of them).
        A = evened(self.scaled)
        if not np.all(np.isfinite(A)):
            return False
        # A singular direction is that of a continuum only if closed orbits lie along it: near a fold the equations are
        # nearly singular, too.
        _, sizes, rows = np.linalg.svd(A)
        if sizes[-1] >= _NEARLY * sizes[0]:
            return False
        return bool(sizes[-1] < _SINGULAR * sizes[0]) or all(self._goes_on(sign * rows[-1]) for sign in (-1.0, 1.0))

    def _goes_on(self, direction: Array) -> bool:
        """Whether there is another closed orbit a little way in a direction of the scaled unknowns."""
        away = _BESIDE * direction / np.max(np.abs(direction))
        y, tau = self.moved(away * self.column_scale)
        beside = solve(self.hybrid, Guess(self.arcs.event_sequence, y, tau), self.arcs)
        moved = np.concatenate([beside.y[self.arcs.free] - self.y[self.arcs.free], beside.tau - self.tau])
        moved /= self.column_scale
        # Beside what a weak input holds at its phase every motion closes nearly.
        closes = CONVERGED if self.arcs.duration is None else _CLOSES
        return beside.residual < closes and float(away @ moved) > 0.5 * float(away @ away)

    def correction(self, right: Array) -> Array:
        """Solution of the scaled linear equations for a right-hand side, in the units of the unknowns; nan for none."""
        with np.errstate(over="ignore", invalid="ignore"):  # of a motion that has shrunk to nothing
            A, b = self.scaled, right / self.row_scale
        if not (np.all(np.isfinite(A)) and np.all(np.isfinite(b))):
            return np.full_like(b, np.nan)  # LAPACK would complain on the terminal
        try:
            step = np.linalg.solve(A, b)
        except np.linalg.LinAlgError:
            step = np.full_like(b, np.inf)
        if not np.max(np.abs(step)) < STRAY * np.max(np.abs(b)):
            # A direction that is free to rounding, along a continuum of cycles: no step in it.
            step = np.linalg.lstsq(A, b, rcond=1e-11)[0]
        return step * self.column_scale

    def moved(self, step: Array) -> tuple[Array, Array]:
        """Start and dwell times after a step in the unknowns."""
        y = self.y.copy()
        y[self.arcs.free] += step[: self.arcs.free.size]
        return y, self.tau + step[self.arcs.free.size :]

    def rotated(self, first: int) -> Orbit:
        """The same orbit, begun behind the event that ends arc ``first - 1``."""
        if first == 0:
            return self
        arcs = Arcs.build(self.hybrid, self.arcs.event_sequence.rotated(first))
        # Timers are in the order of the delayed switches, which turns with the orbit.
        return evaluate(self.hybrid, arcs, self._turned(arcs, first), np.roll(self.tau, -first))

    def _turned(self, arcs: Arcs, first: int) -> Array:
        y = self.starts[first].copy()
        t = float(self.tau[:first].sum())
        y -= self.arcs.shift * t
        if self.arcs.n_timers:
            y = with_history(self.hybrid, arcs, y, np.roll(self.tau, -first))
        # Clocks, and what nothing reads, begin where they do on this one: remembered times have been turned back to it.
        n = self.arcs.n_state
        goes_on = np.flatnonzero(~self.hybrid.compared[:n] & (np.arange(n) < self.hybrid.n_plant))
        y[goes_on] = self.y[goes_on]
        return y


def evened(K: Array) -> Array:
    """Scaled equations, those with terms beyond the size of the motion in the size of their terms.

    An arc of nearly no duration has a guard's equation as large as the reciprocal of that: beside it all others would
    count as rounding.
    """
    return np.asarray(K / np.maximum(1.0, np.linalg.norm(K, axis=1))[:, None])


def evaluate(hybrid: HybridSystem, arcs: Arcs, y: Array, tau: Array) -> Orbit:
    """Run along the arcs once."""
    return _newton(hybrid, arcs, y, tau, 0)


def _newton(hybrid: HybridSystem, arcs: Arcs, y: Array, tau: Array, iterations: int) -> Orbit:
    """At most so many steps of Newton's method."""
    if y.size != arcs.size:
        raise ModelError("orbit: the loop changes its structure: it has other states and memory values than the orbit.")
    here, step, share, steps = room_for(arcs, y, tau), np.empty(0), 0, iterations
    while True:
        steps, share, used = newton_orbit(arcs.acting, arcs.chain, effort_of(arcs), steps, step, here, share)
        spend(used)
        orbit = Orbit(hybrid, arcs, *here)
        if steps == 0:
            return orbit
        step = -orbit.correction(orbit.r)


def room_for(arcs: Arcs, y: Array, tau: Array) -> Motion:
    """Room for a motion along arcs, with its start and dwell times."""
    p, N, n = arcs.n_arcs, arcs.size, arcs.free.size + arcs.n_arcs
    ends = np.empty((p + 1, N)), np.empty((p, N))
    equations = np.empty((n, n)), np.empty(n), np.empty(p), np.empty(N), np.empty(n)
    return Motion(np.array(y, float), np.array(tau, float), *ends, *equations)


def effort_of(arcs: Arcs) -> Effort:
    """What sweeps along arcs may cost, and do."""
    p = arcs.n_arcs
    return Effort(remaining(), _SWEEP + _ARC * p + _ENTRY * (arcs.free.size + p) ** 2, _SERIES)


def residual_slope(orbit: Orbit, by: Arcs, start: Array) -> Array:
    """Derivative of an orbit's residual by a parameter, at fixed unknowns and events, shape (m + p,).

    Parameters
    ----------
    by : Arcs
        Arcs whose numbers are the derivatives of the orbit's own.
    start : array, shape (N,)
        Derivative of the start, of what is no unknown in it.
    """
    arcs, out = orbit.arcs, np.empty(orbit.r.size)
    p = arcs.n_arcs
    spend(_SWEEP + 2.0 * _ARC * p)
    sweep_by(
        arcs.acting, arcs.F, arcs.S, arcs.g, arcs.gs, arcs.J, arcs.smooth, arcs.event_sequence.at_once, orbit.starts,
        orbit.tau, arcs.free, by.acting, by.F, by.S, by.g, by.gs, by.J, by.shift, start.copy(), out,
    )  # fmt: skip
    return out


def solve(hybrid: HybridSystem, guess: Guess, arcs: Arcs | None = None) -> Orbit:
    """Damped Newton on a fixed sequence of events, to rounding; the caller looks at the residual."""
    steps = max(_FEW_ITERATIONS, min(_MOST_ITERATIONS, _MOST_PRODUCTS // guess.tau.size**2))
    return _newton(hybrid, arcs or guess.arcs(hybrid), guess.y, guess.tau, steps)


def middle(orbit: Orbit, arc: int) -> Array:
    """The vector y half-way along an arc, where what sticks is exactly on its level."""
    if orbit.motion is not None:
        return np.asarray(orbit.motion.states(np.array([orbit.motion.marks[arc] - 0.5 * orbit.tau[arc]]))[0], float)
    arcs, one = orbit.arcs, slice(arc, arc + 1)
    y, marks = np.empty((1, arcs.size)), np.array([0.0, orbit.tau[arc]])
    channels = arcs.acting and arcs.acting._replace(sense=arcs.acting.sense[one])
    states_at(channels, arcs.F[one], arcs.S[one], arcs.smooth[one], orbit.starts[one], marks, marks[1:] / 2, y)
    _put_on_levels(orbit, arc, y[0])
    return y[0]


def _put_on_levels(orbit: Orbit, arc: int, y: Array) -> None:
    """Put the inputs of sticking elements exactly on their levels, as the engine does where they begin to stick."""
    # A motion that is begun off a level by rounding breaks away with a speed of the wrong sign, and sticks again.
    model, n, modes = orbit.hybrid.model, orbit.hybrid.model.A.shape[0], orbit.arcs.event_sequence.modes[arc]
    rows = model.mode_first[:-1] + modes
    sticks = np.flatnonzero(model.mode_stick[rows])
    seen = input_rows(orbit.hybrid, modes) if sticks.size else y
    for e in sticks:
        row = seen[model.first[e, 0]]
        x, c, way = y[:n], row[:n], way_back(orbit.hybrid, seen, int(e))
        rest, acts = row[n:] @ y[orbit.arcs.memory] - model.mode_level[rows[e]], np.flatnonzero(c)
        if acts.size == 1:
            x[acts] = -rest / c[acts]
        else:
            x -= way * (rest + c @ x) / (c @ way)


def sample_arcs(orbit: Orbit, times: Array) -> Array:
    """Signals at increasing `times` of one period, shape (nt, signals); not for loops with smooth channels."""
    marks = np.concatenate([[0.0], np.cumsum(orbit.tau)])
    y = np.empty((times.size, orbit.arcs.size))
    states_at(orbit.arcs.acting, orbit.arcs.F, orbit.arcs.S, orbit.arcs.smooth, orbit.starts, marks, times, y)
    arc = np.clip(np.searchsorted(marks, times, side="left") - 1, 0, orbit.tau.size - 1)
    return np.einsum("tsj,tj->ts", orbit.arcs.Y[arc], y)
