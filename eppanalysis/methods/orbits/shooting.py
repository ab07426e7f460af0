"""Exact periodic orbits: Newton's method on the start and the dwell times of a cyclic sequence of events.

Between events the flow is known exactly with its derivative, so the equations are: every arc ends on its guard, and the
state behind the last event is the one behind the first. The sequence comes from a run of the engine; after
convergence the engine runs once more from the orbit, and where it meets other events these are taken and the
iteration goes on.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from eppanalysis.errors import ModelError
from eppanalysis.methods.orbits.arcs import Arcs, EventSequence
from eppanalysis.methods.orbits.delayed import DelayedMotion, delayed_motion, is_delayed
from eppanalysis.methods.orbits.guess import Guess, first_return, make_guess, one_turn, recurrences, with_history
from eppanalysis.methods.simulation.effort import spend
from eppanalysis.methods.simulation.simulate import Run, is_rounding, run_hybrid
from eppanalysis.methods.simulation.stability import multipliers, return_map
from eppanalysis.models.systems.hybrid import DELAY_LINE, HybridSystem

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]
IntArray = NDArray[np.int64]

#: Residual, relative to the size of the motion, that counts as converged; Newton goes on to rounding.
CONVERGED = 1e-9
#: Residual with which an orbit that is only begun elsewhere needs no further step.
_ROUNDING = 1e-14
_MOST_ITERATIONS = 40
#: Orbits of many arcs get fewer iterations, for one costs the square of the number of arcs: their sum is limited to
#: this.
_FEW_ITERATIONS, _MOST_PRODUCTS = 8, 400_000
#: Shares of Newton's step that are tried, longest first.
_SHARES = tuple(0.4**k for k in range(8))
_MOST_SEQUENCES = 10
#: An orbit may have this many arcs more than twice those of its guess.
_MORE_ARCS = 40
#: Span of a state, relative to its size, that is rounding.
_NO_MOTION = 1e-9
#: Share of the largest singular value of the scaled equations below which the smallest one is rounding.
_SINGULAR = 1e-14
#: A continuum of cycles is tested for below this share, at orbits so far beside the one found.
_NEARLY, _BESIDE = 1e-7, 0.01
#: Speed at which a guard is crossed, relative to how far the orbit moves across it in a period, that is rounding.
_TOUCHES = 1e-10
#: A solution this many times larger than its right-hand side is rounding.
_STRAY = 1e9
_NO_SAMPLES = np.zeros(0)
#: Steps of the engine that one sweep with its linear equations is worth: all at once, each arc, each entry of the
#: equations, and with smooth channels each time constant that is passed through.
_SWEEP, _ARC, _ENTRY, _TIME = 200.0, 5.0, 0.1, 100.0


@dataclass(frozen=True, eq=False)
class Orbit:
    """A closed orbit of a hybrid system, or the last iterate on the way to it.

    Attributes
    ----------
    hybrid : HybridSystem
    arcs : Arcs
    y : array, shape (N,)
        State, timers, held and delayed values behind the event at the start.
    tau : array, shape (p,)
        Dwell times [s].
    starts, ends : arrays, shapes (p + 1, N), (p, N)
        y behind and before each event.
    A, r : arrays, shapes (m + p, m + p), (m + p,)
        Derivative and residual of (periodicity, guards) over (free part of y, dwell times).
    speed : array, shape (p,)
        Rate at which each guard is crossed.
    motion : DelayedMotion, optional
        Where what is delayed moves: the motion itself, of which the start alone tells too little.
    """

    hybrid: HybridSystem
    arcs: Arcs
    y: Array
    tau: Array
    starts: Array
    ends: Array
    A: Array
    r: Array
    speed: Array
    motion: DelayedMotion | None = None

    @property
    def period(self) -> float:
        """Period [s]."""
        return float(self.tau.sum())

    @property
    def guess(self) -> Guess:
        """The orbit as a start for the next one."""
        return Guess(self.arcs.event_sequence, self.y, self.tau)

    @cached_property
    def scale(self) -> Array:
        """Size of the motion in each place of y, shape (N,); never zero."""
        if self.motion is not None:
            return self.motion.scale
        both = np.concatenate([self.starts, self.ends])
        if np.any(self.arcs.smooth) and np.all(np.isfinite(both)):
            # F holds no contribution of smooth channels.
            both = np.concatenate([both, [middle(self, int(a)) for a in np.flatnonzero(self.arcs.smooth)]])
        span = np.ptp(both, axis=0)
        n = self.arcs.F.shape[1]
        for y in (self.starts[:-1], self.ends):
            travel = np.abs(np.einsum("pij,pj->pi", self.arcs.F, y)) * np.abs(self.tau)[:, None]
            span[:n] = np.maximum(span[:n], 0.1 * travel.max(axis=0))
        size = np.abs(both).max(axis=0)
        return np.where(span > 1e-9 * size, span, np.where(size > 0, size, 1.0))

    @cached_property
    def row_scale(self) -> Array:
        """Sizes of the residual's entries, shape (m + p,)."""
        guards, kind, T = np.abs(self.arcs.g) @ self.scale, self.arcs.event_sequence.at_once, max(self.period, 1e-300)
        with np.errstate(over="ignore"):  # an iterate that has gone astray
            guards = np.where((kind == 1) | (guards == 0), T, np.where(kind == 2, guards / T, guards))
        return np.concatenate([self.scale[self.arcs.free], guards])

    @cached_property
    def column_scale(self) -> Array:
        """Sizes of the unknowns, shape (m + p,)."""
        return np.concatenate([self.scale[self.arcs.free], np.full(self.tau.size, max(self.period, 1e-300))])

    @cached_property
    def residual(self) -> float:
        """Largest residual relative to the size of the motion."""
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
        n_wanted = max(int(np.sum(self.hybrid.compared)) - 1, 0) + self.arcs.n_timers
        return multipliers(self.return_map, self.scale[self.arcs.free], n_wanted)

    @cached_property
    def one_of_many(self) -> bool:
        """Whether the cycle is one of a continuum.

        Either an element holds a value that no switch on the cycle renews (a play whose motion stays within its gap),
        or the equations leave a direction of the start free: to rounding, or nearly and there are closed orbits to both
        sides in that direction (of a centre, whose period may depend on the size).
        """
        # Behind the elements' values stand the slopes of inputs and a 1.
        first, count = self.arcs.memory.start, int(self.hybrid.model.first[-1, 2])
        idle = np.setdiff1d(np.arange(first, first + count), self.arcs.free)
        if np.any(self.arcs.F[:, :, idle]):
            return True
        if self.motion is not None:
            return False
        A = self.A / self.row_scale[:, None] * self.column_scale
        if not np.all(np.isfinite(A)):
            return False
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
        return beside.residual < CONVERGED and float(away @ moved) > 0.5 * float(away @ away)

    def correction(self, right: Array) -> Array:
        """Solution of the scaled linear equations for a right-hand side, in the units of the unknowns; nan for none."""
        A, b = self.A / self.row_scale[:, None] * self.column_scale, right / self.row_scale
        if not (np.all(np.isfinite(A)) and np.all(np.isfinite(b))):
            return np.full_like(b, np.nan)  # LAPACK would complain on the terminal
        try:
            step = np.linalg.solve(A, b)
        except np.linalg.LinAlgError:
            step = np.full_like(b, np.inf)
        if not np.max(np.abs(step)) < _STRAY * np.max(np.abs(b)):
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
        # Timers stand in the order of the delayed switches, which turns with the orbit.
        return evaluate(self.hybrid, arcs, self._turned(arcs, first), np.roll(self.tau, -first))

    def _turned(self, arcs: Arcs, first: int) -> Array:
        y = self.starts[first].copy()
        t = float(self.tau[:first].sum())
        y -= self.arcs.shift * t
        if self.arcs.n_timers:
            y = with_history(self.hybrid, arcs, y, np.roll(self.tau, -first))
        y[: self.arcs.n_state][~self.hybrid.compared & (np.arange(self.arcs.n_state) < self.hybrid.n_plant)] = 0.0
        return y


def evaluate(hybrid: HybridSystem, arcs: Arcs, y: Array, tau: Array) -> Orbit:
    """Run along the arcs once."""
    from eppanalysis.kernels.orbits import sweep

    p, N, m = arcs.n_arcs, arcs.size, arcs.free.size
    slow = float(np.abs(tau[arcs.smooth != 0]).sum()) / hybrid.time_scale
    spend(_SWEEP + _ARC * p + _ENTRY * (m + p) ** 2 + _TIME * slow)
    starts, ends = np.empty((p + 1, N)), np.empty((p, N))
    A, r, speed = np.empty((m + p, m + p)), np.empty(m + p), np.empty(p)
    sweep(
        arcs.channels, arcs.F, arcs.S, arcs.g, arcs.gs, arcs.J, arcs.smooth, arcs.event_sequence.at_once, y, tau,
        arcs.free,
        arcs.shift, starts, ends, A, r, speed,
    )  # fmt: skip
    return Orbit(hybrid, arcs, y, tau, starts, ends, A, r, speed)


def solve(hybrid: HybridSystem, guess: Guess, arcs: Arcs | None = None) -> Orbit:
    """Damped Newton on a fixed sequence of events, to rounding; the caller looks at the residual."""
    orbit = evaluate(hybrid, arcs or guess.arcs(hybrid), guess.y, guess.tau)
    k = 0
    for _ in range(max(_FEW_ITERATIONS, min(_MOST_ITERATIONS, _MOST_PRODUCTS // guess.tau.size**2))):
        if not np.isfinite(orbit.residual):
            break
        step = -orbit.correction(orbit.r)
        size = float(np.max(np.abs(step) / orbit.column_scale))
        if not np.isfinite(size):
            break
        new, k = _search(orbit, step, min(1.0, 0.5 / size) if size > 0 else 1.0, k)
        if new is None or (new.residual < 1e-11 and new.residual > 0.3 * orbit.residual):
            return orbit if new is None or orbit.residual <= new.residual else new
        orbit = new
    return orbit


def _search(orbit: Orbit, step: Array, most: float, k: int) -> tuple[Orbit | None, int]:
    """The orbit after the longest share of a step that lowers the residual, and the number of the share.

    It is looked for from share `k` on, that of the step before, which is a neighbour as a rule.
    """
    new = _lower(orbit, step, most * _SHARES[k])
    if new is None:
        for other in (*range(k + 1, len(_SHARES)), *range(k)):
            new = _lower(orbit, step, most * _SHARES[other])
            if new is not None:
                return new, other
        return None, k
    while k > 0:
        longer = _lower(orbit, step, most * _SHARES[k - 1])
        if longer is None:
            break
        new, k = longer, k - 1
    return new, k


def _lower(orbit: Orbit, step: Array, share: float) -> Orbit | None:
    """The orbit after a share of a step; None where that does not lower the residual (near rounding any step will)."""
    new = evaluate(orbit.hybrid, orbit.arcs, *orbit.moved(share * step))
    size = float(np.max(np.abs(new.r) / orbit.row_scale))
    lower = size < orbit.residual * (1.0 - 0.1 * share) or (size < 1e-11 and orbit.residual < 1e-11)
    return new if lower else None


def close_orbit(hybrid: HybridSystem, guess: Guess) -> Orbit | None:
    """The exact orbit near a guess, with its true sequence of events; None when there is none to be found.

    Parameters
    ----------
    hybrid : HybridSystem
        Without external inputs that change.
    guess : Guess

    Returns
    -------
    Orbit or None
        Begun where its longest arc begins (with dead time: of those on which nothing is on its way); its residual is
        near rounding.
    """
    seen: set[bytes] = set()
    most = 2 * guess.tau.size + _MORE_ARCS
    for _ in range(_MOST_SEQUENCES):
        if guess.tau.size > most:
            return None  # ever more switches: they pile up
        try:
            orbit = solve(hybrid, guess)
        except ModelError:
            return _close_delayed(hybrid, guess) if is_delayed(hybrid) else None
        if orbit.residual < CONVERGED and np.all(orbit.tau > -1e-9 * orbit.period):
            if not moves(orbit) or _only_touches(orbit):
                return None
            found = next_guess(orbit)
            if found is None:
                orbit = _finished(orbit)
                return orbit if crosses(orbit) else None
            if found.event_sequence.key in seen:
                return None
        else:
            found = follow(hybrid, guess)
            # From a guess that the engine's own return map does not better, Newton's method fails as it has just done.
            if found is None or found is guess or found.event_sequence.key in seen:
                return None
        seen.add(found.event_sequence.key)
        guess = found
    return None


def _close_delayed(hybrid: HybridSystem, guess: Guess) -> Orbit | None:
    """The exact orbit where what is delayed moves, begun at its longest arc."""
    first = int(np.argmax(guess.tau))
    it, tau = guess.event_sequence.rotated(first), np.roll(guess.tau, -first)
    try:
        motion = delayed_motion(hybrid, it, guess.y, tau)
        for q in range(1, tau.size // 2 + 1):
            # Of a run that is on a cycle several turns may come as close to their begin as one.
            if motion is not None and tau.size % q == 0 and _goes_round(it, motion.tau, q):
                it = EventSequence(it.modes[:q], it.guards[:q], it.source[:q], it.at_once[:q])
                motion = delayed_motion(hybrid, it, guess.y, motion.tau[:q])
                break
    except ModelError:
        return None
    if motion is None:
        return None
    m, p = motion.arcs.free.size, motion.tau.size
    r = np.concatenate([np.zeros(m), motion.guards])
    return Orbit(
        hybrid, motion.arcs, motion.starts[0], motion.tau, motion.starts, motion.ends, np.eye(m + p), r, motion.speed,
        motion,
    )  # fmt: skip


def _goes_round(it: EventSequence, tau: Array, q: int) -> bool:
    """Whether a sequence of events is one of q arcs several times."""
    same = np.array_equal(it.guards, np.roll(it.guards, q)) and np.array_equal(it.modes, np.roll(it.modes, q, axis=0))
    return same and bool(np.max(np.abs(tau - np.roll(tau, q))) < 1e-7 * tau.sum())


def moves(orbit: Orbit) -> bool:
    """Whether an orbit is a motion, not a state of rest on several guards at once that closes after no time."""
    n, compared = orbit.hybrid.x0.size, orbit.hybrid.compared
    both = np.concatenate([orbit.starts, orbit.ends])
    if is_rounding(orbit.hybrid, both[:, :n], both[:, orbit.arcs.memory], orbit.scale[:n]):
        return False
    both = both[:, :n][:, compared]
    span, size = np.ptp(both, axis=0), np.abs(both).max(axis=0)
    return orbit.period > 1e-6 * orbit.hybrid.time_scale and bool(np.any(span > _NO_MOTION * size))


def crosses(orbit: Orbit) -> bool:
    """Whether an orbit crosses all of its guards; where it only touches one it has no return map and no multipliers."""
    try:
        return bool(np.all(np.isfinite(orbit.return_map)))
    except np.linalg.LinAlgError:
        return False


def _only_touches(orbit: Orbit) -> bool:
    """Whether a guard is crossed no faster than rounding: what ends there after ever so long is no orbit."""
    slow = np.abs(orbit.speed) * orbit.period < _TOUCHES * (np.abs(orbit.arcs.g) @ orbit.scale)
    return bool(np.any(slow & (orbit.arcs.event_sequence.guards >= 0) & (orbit.arcs.event_sequence.at_once == 0)))


def _finished(orbit: Orbit) -> Orbit:
    """Taken back to one turn, begun at its longest arc."""
    p = orbit.arcs.n_arcs
    for q in range(1, p // 2 + 1):
        if p % q == 0 and _repeats(orbit, q):
            guess = _once(orbit, q)
            once = None if guess is None else solve(orbit.hybrid, guess)
            if once is not None and once.residual < CONVERGED:
                orbit = once
            break
    first = _begin(orbit)
    if first == 0:
        return orbit
    turned = orbit.rotated(first)
    return turned if turned.residual < _ROUNDING else solve(turned.hybrid, turned.guess, turned.arcs)


def _begin(orbit: Orbit) -> int:
    """The longest arc, of those on which nothing is on its way through a dead time if there are any."""
    source, p = orbit.arcs.event_sequence.source, orbit.arcs.n_arcs
    quiet = np.ones(p, bool)
    for arrival in np.flatnonzero(orbit.arcs.event_sequence.guards < 0):
        origin, _, turns = source[arrival]
        under_way = p if turns else (arrival - origin - 1) % p + 1
        quiet[(arrival - np.arange(under_way)) % p] = False
    return int(np.argmax(np.where(quiet, orbit.tau, -1.0) if quiet.any() else orbit.tau))


def _once(orbit: Orbit, q: int) -> Guess | None:
    """The first q arcs of an orbit that repeats them, as an orbit of their own."""
    it, arcs = orbit.arcs.event_sequence, orbit.arcs
    if not arcs.n_timers:
        return Guess(EventSequence(it.modes[:q], it.guards[:q], it.source[:q], it.at_once[:q]), orbit.y, orbit.tau[:q])
    # With dead time the delayed switches are put in anew, for they have gone round more often in the shorter period.
    own = np.flatnonzero(it.guards[:q] >= 0)
    starts = orbit.starts[np.append(0, own[:-1] + 1)]
    starts = np.hstack([starts[:, : arcs.n_state], starts[:, arcs.memory]])
    tau = np.diff(np.cumsum(orbit.tau)[own], prepend=0.0)
    return make_guess(orbit.hybrid, it.modes[own], it.guards[own], starts, tau)


def _repeats(orbit: Orbit, q: int) -> bool:
    it, tol = orbit.arcs.event_sequence, 1e-7
    same = np.array_equal(it.guards, np.roll(it.guards, q)) and np.array_equal(it.modes, np.roll(it.modes, q, axis=0))
    if not same or np.max(np.abs(orbit.tau - np.roll(orbit.tau, q))) > tol * orbit.period:
        return False
    free, n = orbit.arcs.free, orbit.arcs.n_state
    free = free[(free < n) | (free >= n + orbit.arcs.n_timers)]  # each delayed switch has its own timers
    shift = orbit.arcs.shift[free] * orbit.tau[:q].sum()
    change = np.abs(orbit.starts[q, free] - shift - orbit.starts[0, free])
    return bool(np.all(change <= tol * orbit.scale[free]))


def next_guess(orbit: Orbit) -> Guess | None:
    """None when the engine, started on the orbit, meets just its events; else what it meets, as a new guess.

    The run begins in the middle of the longest arc, where no guard is near. A loop with dead time cannot be started in
    the middle of its history; its sequence is that of the run it came from.
    """
    if orbit.arcs.n_timers:
        return None
    p, T = orbit.arcs.n_arcs, orbit.period
    k = int(np.argmax(orbit.tau))
    start = restarted(orbit.hybrid, orbit.arcs, middle(orbit, k), orbit.arcs.event_sequence.modes[k])
    base = 2.0 * orbit.hybrid.time_scale
    run = run_hybrid(start, 1.1 * T, _NO_SAMPLES, base, 3 * p + 40, 3 * p + 40)
    order = run.order
    if run.n_kept >= p and np.array_equal(run.guard[order[:p]], np.roll(orbit.arcs.event_sequence.guards, -k)):
        times = np.cumsum(np.roll(orbit.tau, -k)) - 0.5 * orbit.tau[k]
        if np.max(np.abs(run.time[order[:p]] - times)) < 1e-6 * T:
            return None
    once = one_turn(orbit.hybrid, run, start.modes0, T)
    if once is not None and once.event_sequence.cyclic_key != orbit.arcs.event_sequence.cyclic_key:
        return once
    run = run_hybrid(start, 2.6 * T, _NO_SAMPLES, base, 8 * p + 80, 8 * p + 80)
    best = None
    for guess in recurrences(orbit.hybrid, run, (0.6 * T, 1.5 * T), 80):
        # Just beyond a change of sequence much of the run still follows the old one.
        if guess.event_sequence.cyclic_key != orbit.arcs.event_sequence.cyclic_key:
            return guess
        best = best or guess
    return best


def middle(orbit: Orbit, arc: int) -> Array:
    """The vector y half-way along an arc."""
    if orbit.motion is not None:
        return np.asarray(orbit.motion.states(np.array([orbit.motion.marks[arc] - 0.5 * orbit.tau[arc]]))[0], float)
    from eppanalysis.kernels.orbits import states_at

    arcs, one = orbit.arcs, slice(arc, arc + 1)
    y, marks = np.empty((1, arcs.size)), np.array([0.0, orbit.tau[arc]])
    channels = arcs.channels._replace(sense=arcs.channels.sense[one])
    states_at(channels, arcs.F[one], arcs.S[one], arcs.smooth[one], orbit.starts[one], marks, marks[1:] / 2, y)
    return y[0]


def run_from(orbit: Orbit, t_end: float, max_events: int, y: Array) -> Run:
    """A run of the engine from y, in the modes that the orbit has at its start."""
    start = restarted(orbit.hybrid, orbit.arcs, y, orbit.arcs.event_sequence.modes[0])
    return run_hybrid(start, t_end, _NO_SAMPLES, 2.0 * orbit.hybrid.time_scale, max_events, max_events)


def restarted(hybrid: HybridSystem, arcs: Arcs, y: Array, modes: IntArray) -> HybridSystem:
    """The same system, started from y in given modes."""
    return replace(hybrid, x0=y[: hybrid.x0.size].copy(), H0=y[arcs.memory].copy(), modes0=np.array(modes, np.int64))


def follow(hybrid: HybridSystem, guess: Guess) -> Guess | None:
    """Newton on the engine's own return map, each step with the events that it meets; a guess nearer to the orbit."""
    if np.any(hybrid.model.smooth_kind == DELAY_LINE):
        return None
    best: Guess | None = None
    best_size = np.inf
    for _ in range(15):
        try:
            arcs = guess.arcs(hybrid)
        except ModelError:
            break
        orbit = evaluate(hybrid, arcs, guess.y, guess.tau)
        size = float(np.max(np.abs(orbit.r[: arcs.free.size]) / orbit.row_scale[: arcs.free.size]))
        if not size < 1e6:
            break
        if size < best_size:
            best, best_size = guess, size
        if size < 1e-6:
            break
        step = -orbit.correction(orbit.r)
        change = float(np.max(np.abs(step[: arcs.free.size]) / orbit.column_scale[: arcs.free.size]))
        if not np.isfinite(change):
            break
        y, _ = orbit.moved(step * min(1.0, 0.2 / max(change, 1e-300)))
        run = run_from(orbit, 1.6 * guess.period, 4 * guess.tau.size + 40, y)
        found = first_return(
            hybrid, run, y, guess.event_sequence.modes[0], int(guess.event_sequence.guards[-1]), guess.period
        )
        if found is None:
            break
        guess = found
    return best


def orbit_of(hybrid: HybridSystem, run: Run, period: float | None = None) -> Orbit | None:
    """The exact orbit that a run is on at its end; None where none of its last events closes one."""
    for guess in recurrences(hybrid, run, None if period is None else (0.99 * period, 1.01 * period), 3):
        orbit = close_orbit(hybrid, guess)
        if orbit is not None:
            return orbit
    return None


def orbits_near(hybrid: HybridSystem, x: Array, memory: Array, period: float) -> Iterator[Orbit]:
    """Exact orbits near a state that should lie on one, best guess first.

    Parameters
    ----------
    x, memory : arrays
        State and memory values; the engine finds the modes.
    period : float
        Of the orbit, roughly [s].
    """
    start = replace(hybrid, x0=x, H0=memory)
    seen: set[bytes] = set()
    for turns in (2.6, 8.0):
        run = run_hybrid(start, turns * period, _NO_SAMPLES, 2.0 * hybrid.time_scale, 2000, 2000)
        for guess in recurrences(hybrid, run, (0.5 * period, 1.6 * period), 4):
            if guess.event_sequence.key in seen:
                continue
            seen.add(guess.event_sequence.key)
            orbit = close_orbit(hybrid, guess)
            if orbit is not None:
                yield orbit


def same_orbit(one: Orbit, other: Orbit) -> bool:
    """Whether two orbits are the same motion: equal periods, and a state of one found on the other."""
    if abs(one.period / other.period - 1.0) > 1e-6:
        return False
    n, compared = one.hybrid.x0.size, one.hybrid.compared
    at = np.flatnonzero(one.arcs.event_sequence.guards == other.arcs.event_sequence.guards[-1])
    if at.size == 0:
        return False
    away = np.abs(one.starts[at + 1, :n] - other.y[:n])[:, compared] / one.scale[:n][compared]
    return bool(np.min(np.max(away, axis=1)) < 1e-5)
