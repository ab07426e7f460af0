"""Exact periodic orbits: the cyclic sequence of events that an orbit truly has, beside its start and dwell times.

The sequence comes from a run of the engine. Where the equations of `orbit` do not close along it, or the engine meets
other events on what they close, the motion is closed on the flow, which assumes none, and solved along what it meets.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import islice

import numpy as np

from eppanalysis.arrays import Array, IntArray
from eppanalysis.engine.orbits import sizes_of_residuals
from eppanalysis.errors import EppError, ModelError
from eppanalysis.methods.orbits.arcs import Arcs, EventSequence
from eppanalysis.methods.orbits.delayed.motion import delayed_motion, is_delayed
from eppanalysis.methods.orbits.guess import Guess, first_return, guess_along, make_guess, recurrences
from eppanalysis.methods.orbits.orbit import CONVERGED, Orbit, evaluate, middle, sample_arcs, solve
from eppanalysis.methods.simulation.kept import Run
from eppanalysis.methods.simulation.rounding import SAMPLES, is_lost, left_by_rounding, watched
from eppanalysis.methods.simulation.runs import loses_elements, run_hybrid
from eppanalysis.methods.steady.closing import close
from eppanalysis.methods.steady.motion import SteadyMotion
from eppanalysis.models.systems.hybrid import DELAY_LINE, HybridSystem

#: Passes in which an orbit is closed on the flow.
_PIECES = 4
#: Residual with which an orbit that is only begun elsewhere needs no further step.
_ROUNDING = 1e-14
#: Step that Newton's method would still make from an orbit, in sizes of its motion, that leaves it the same orbit, and
#: what of its residual may be left by it.
_NEAR, _LEFT = 1e-2, 1e-13
#: Steps of Newton's method on the engine's return map, and sequences that are taken over from it.
_MOST_STEPS, _MOST_SEQUENCES = 15, 10
#: An orbit may have this many arcs more than twice those of its guess.
_MORE_ARCS = 40
#: Span of a state, relative to its size, that is rounding.
_NO_MOTION = 1e-9
#: Distance between a guess and an orbit, relative to its size, from which Newton's method leads to no other one.
_ALONG = 1e-7
#: Speed at which a guard is crossed, relative to how far the orbit moves across it in a period, that is rounding.
_TOUCHES = 1e-10
#: Roundings that the value of a guard may be off, and the share of what a period changes that it must be beneath.
_ROUNDINGS, _TOLD = 4.0 * 2.0**-52, 1e-3
#: Difference of dwell times and states, relative to the motion, up to which two turns are the same.
_SAME_TURN = 1e-7
_NO_SAMPLES = np.zeros(0)


def close_orbit(
    hybrid: HybridSystem, guess: Guess, known: Sequence[Orbit] = (), image: Array | None = None
) -> Orbit | None:
    """The exact orbit near a guess, with its true sequence of events; None when there is none to be found.

    Parameters
    ----------
    hybrid : HybridSystem
        Without external inputs that change.
    known : sequence of Orbit, optional
        Orbits of this system that have been closed: one of them, where the guess is a turn along it or leads to one.
    image : array, shape (N, N), optional
        Where the orbit should be its own mirror image, as the guess is: see :func:`mirror`.

    Returns
    -------
    Orbit or None
        Begun where its longest arc begins (with dead time: of those on which nothing is on its way); its residual is
        near rounding.
    """
    if (passed := _passed(guess, known)) is not None:
        return passed
    try:
        along = solve(hybrid, guess)
    except ModelError:
        return _close_delayed(hybrid, guess) if is_delayed(hybrid) else None
    orbit = _of_the_loop(along, known)
    if orbit is not None or is_delayed(hybrid):
        return orbit
    found = _on_the_flow(along, guess, image)
    orbit = None if found is None else orbit_along(hybrid, found, known)
    return orbit or _by_sequences(along, guess, known)


def orbit_along(hybrid: HybridSystem, guess: Guess, known: Sequence[Orbit] = ()) -> Orbit | None:
    """The exact orbit near a guess that has its sequence of events; else as :func:`close_orbit`."""
    if (passed := _passed(guess, known)) is not None:
        return passed
    try:
        return _of_the_loop(solve(hybrid, guess), known)
    except ModelError:
        return _close_delayed(hybrid, guess) if is_delayed(hybrid) else None


def _of_the_loop(along: Orbit, known: Sequence[Orbit]) -> Orbit | None:
    """What the equations along a sequence have come to, where it closes and the loop has just these events."""
    if not _closes(along):
        return None
    passed = _passed(along.guess, known)
    # The equations close for sequences, too, that the loop does not have: the engine has the last word
    # (docs/theory/exact_orbits.md, Closing an orbit).
    if passed is not None or not moves(along) or _only_touches(along) or not is_met(along):
        return passed
    orbit = _finished(along)
    return orbit if _is_closed(orbit) and crosses(orbit) else None


def _by_sequences(along: Orbit, guess: Guess, known: Sequence[Orbit]) -> Orbit | None:
    """The orbit along the sequences that the engine meets one after another, each taken over from the last.

    Where events come and go within a step, as of pulses that just pass a threshold, the flow is too bent for its own
    Newton's method, and the return map along the sequence met last still leads on.
    """
    hybrid, seen, approach = along.hybrid, set[bytes](), _Approach(iter(()))
    most = 2 * guess.tau.size + _MORE_ARCS
    for _ in range(_MOST_SEQUENCES):
        if _closes(along):
            found = next_guess(along) if moves(along) and not _only_touches(along) else None
        else:
            approach = approach.begun_at(hybrid, guess)
            found = approach.best()
            found = None if found is guess else found
        if found is None or found.event_sequence.key in seen or found.tau.size > most:
            return None
        if (passed := _passed(found, known)) is not None:
            return passed
        try:
            along = solve(hybrid, found)
        except ModelError:
            return None
        if (orbit := _of_the_loop(along, known)) is not None:
            return orbit
        seen.add(found.event_sequence.key)
        guess = found
    return None


def _on_the_flow(along: Orbit, guess: Guess, image: Array | None) -> Guess | None:
    """What Newton's method on the flow closes near a guess, with the events that it truly has; None for nothing.

    What closes `along` a sequence that the loop does not have may be near; what does not has led away from the guess.
    """
    closed = _is_closed(along) and bool(np.all(along.tau > 0.0))
    orbit = along if closed else evaluate(along.hybrid, along.arcs, guess.y, guess.tau)
    if orbit.arcs.n_timers or not np.isfinite(orbit.residual):
        return None
    # Begun in the middle of arcs, as a run from a single start may leave the orbit within a turn.
    duration, pieces = (orbit.period, _PIECES) if image is None else (0.5 * orbit.period, _PIECES // 2)
    halves = np.cumsum(orbit.tau) - 0.5 * orbit.tau
    part = np.floor(pieces * halves / duration).astype(int)
    parts = [np.flatnonzero(part == k).tolist() for k in range(pieces)]
    longest = [max(arcs, key=lambda a: float(orbit.tau[a])) for arcs in parts if arcs]
    # An arc as long as the whole turn lies in neither half of it: such a motion is no mirror image of itself.
    if not longest:
        return None
    starts = [begun_amid(orbit, a) for a in longest]
    durations = np.diff(halves[longest], append=halves[longest[0]] + duration)
    if np.any(durations <= 0.0):
        return None
    found = close(SteadyMotion.through(starts, durations.tolist(), image), given=False, pieces=pieces)
    return None if found is None else guess_along(found)


def _closes(along: Orbit) -> bool:
    """Whether the equations along a sequence are closed, with no dwell time below zero but for rounding."""
    return _is_closed(along) and bool(np.all(along.tau > -1e-9 * along.period))


def _is_closed(orbit: Orbit) -> bool:
    """Whether an orbit closes, and Newton's method sees none far from it: what grows ever more slowly closes nearly.

    Along a continuum it makes no step; what an orbit misses is made up for by others then.
    """
    if not orbit.residual < CONVERGED:
        return False
    step = orbit.correction(orbit.r) / orbit.column_scale
    left = np.max(np.abs(orbit.scaled @ step - orbit.r / orbit.row_scale))
    return bool(np.max(np.abs(step)) < _NEAR and left < _LEFT)


def _passed(guess: Guess, known: Sequence[Orbit]) -> Orbit | None:
    """The orbit along which a guess is a turn, None for none of them."""
    return next((orbit for orbit in known if _goes_along(guess, orbit)), None)


def _goes_along(guess: Guess, orbit: Orbit) -> bool:
    """Whether a guess is a turn along an orbit: the same events at the same times, from a state on it."""
    p, size = guess.tau.size, _ALONG * orbit.scale
    if orbit.tau.size != p or orbit.y.size != guess.y.size or orbit.arcs.n_timers:
        return False
    events, late = guess.event_sequence, _ALONG * orbit.period
    for k in np.flatnonzero(np.all(np.abs(orbit.starts[:-1] - guess.y) <= size, axis=1)):
        if np.all(np.abs(np.roll(orbit.tau, -k) - guess.tau) <= late):
            return events.key == orbit.arcs.event_sequence.rotated(int(k)).key
    return False


def _close_delayed(hybrid: HybridSystem, guess: Guess) -> Orbit | None:
    """The exact orbit where what is delayed moves, begun as others are."""
    first = begin_of(guess.event_sequence, guess.tau)
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
    rows, at_once = np.empty(m + p), motion.arcs.event_sequence.at_once
    sizes_of_residuals(motion.arcs.g, at_once, motion.arcs.free, motion.scale, float(motion.tau.sum()), rows)
    orbit = Orbit(
        hybrid, motion.arcs, motion.starts[0], motion.tau, motion.starts, motion.ends, np.eye(m + p), r, motion.speed,
        motion.scale, rows, motion,
    )  # fmt: skip
    return orbit if moves(orbit) else None


def _goes_round(it: EventSequence, tau: Array, q: int) -> bool:
    """Whether a sequence of events is one of q arcs several times."""
    same = np.array_equal(it.guards, np.roll(it.guards, q)) and np.array_equal(it.modes, np.roll(it.modes, q, axis=0))
    return same and bool(np.max(np.abs(tau - np.roll(tau, q))) < _SAME_TURN * tau.sum())


def moves(orbit: Orbit) -> bool:
    """Whether an orbit is a motion of which rounding leaves something, of its own and of what the elements do.

    A state of rest on several guards at once is none: it closes after no time.
    """
    n, compared = orbit.hybrid.x0.size, orbit.hybrid.compared
    both = np.concatenate([orbit.starts, orbit.ends])
    seen = both[:, :n], both[:, orbit.arcs.memory], orbit.scale[:n]
    rounding, may_be_lost = left_by_rounding(orbit.hybrid, *seen, orbit.period)
    if rounding or (may_be_lost and _is_lost(orbit)):
        return False
    if orbit.motion is None and _closes_by_rounding(orbit):
        return False
    both = both[:, :n][:, compared]
    span, size = np.ptp(both, axis=0), np.abs(both).max(axis=0)
    return orbit.period > 1e-6 * orbit.hybrid.time_scale and bool(np.any(span > _NO_MOTION * size))


def _closes_by_rounding(orbit: Orbit) -> bool:
    """Whether an orbit misses its guards by what it changes in a period.

    Motions that are far faster than the loop all close nearly: what one of them changes in a period is the period over
    the loop's time scale. Where a guard moves little beside its terms (of a relay behind two poles more than zeros, in
    turned states) that passes for rounding of these, and motions of every size for cycles.
    """
    arcs, n = orbit.arcs, orbit.arcs.n_state + orbit.arcs.n_timers
    share = min(orbit.period / orbit.hybrid.time_scale, 1.0)
    kind = arcs.event_sequence.at_once
    met = ((kind == 0) | (kind == 2)) & (arcs.event_sequence.guards >= 0)
    # Where an arc begins on the guard that ends it, it is the mean rate that has to vanish.
    time = np.where(kind == 2, orbit.tau, 1.0)
    rates = [np.einsum("pi,pij,pj->p", arcs.g[:, :n], arcs.F, y) for y in (orbit.starts[:-1], orbit.ends)]
    moved = np.abs(rates).max(axis=0) * orbit.tau / time
    terms = np.abs(arcs.g[:, :n]) @ orbit.scale[:n] / time
    missed = np.abs(orbit.r[-orbit.tau.size :]) + _ROUNDINGS * terms
    return bool(np.any(met & (moved > 0.0) & (missed > _TOLD * share * moved)))


def _is_lost(orbit: Orbit) -> bool:
    """Whether what the elements change in a period is beneath rounding, or beneath the residual of the orbit."""
    if is_delayed(orbit.hybrid):
        # A run cannot begin in the middle of what is on its way.
        times = orbit.period * (np.arange(SAMPLES) + 0.5) / SAMPLES
        return is_lost(orbit.hybrid, _seen_by_elements(orbit, times), orbit.period, orbit.residual)
    start = restarted(orbit.hybrid, orbit.arcs, orbit.y, orbit.arcs.event_sequence.modes[0])
    return loses_elements(start, orbit.period, orbit.period, orbit.residual)


def _seen_by_elements(orbit: Orbit, times: Array) -> Array:
    """Signals of the `watched` system at times of one period, of an orbit behind a dead time."""
    seen, motion, arcs = watched(orbit.hybrid), orbit.motion, orbit.arcs
    if motion is None:
        return sample_arcs(replace(orbit, arcs=Arcs.build(seen, arcs.event_sequence, arcs)), times)
    undelayed = seen.model._replace(smooth_kind=np.zeros_like(seen.model.smooth_kind))
    arcs = Arcs.build(replace(seen, model=undelayed), motion.arcs.event_sequence, motion.arcs)
    return replace(motion, arcs=arcs).signals(times)


def crosses(orbit: Orbit) -> bool:
    """Whether an orbit crosses all of its guards; where it only touches one it has no return map and no multipliers."""
    try:
        return bool(np.all(np.isfinite(orbit.return_map)))
    except np.linalg.LinAlgError:
        return False


def _only_touches(orbit: Orbit) -> bool:
    """Whether a guard is crossed no faster than rounding: what ends there after ever so long is no orbit."""
    events = orbit.arcs.event_sequence
    return bool(np.any(orbit.grazes(_TOUCHES) & (events.guards >= 0) & (events.at_once == 0)))


def _finished(orbit: Orbit) -> Orbit:
    """Taken back to one turn, begun where all are (:func:`begin_of`)."""
    p = orbit.arcs.n_arcs
    for q in range(1, p // 2 + 1):
        if p % q == 0 and _repeats(orbit, q):
            guess = _once(orbit, q)
            once = None if guess is None else solve(orbit.hybrid, guess)
            if once is not None and once.residual < CONVERGED:
                orbit = once
            break
    first = begin_of(orbit.arcs.event_sequence, orbit.tau)
    if first == 0:
        return orbit
    turned = orbit.rotated(first)
    return turned if turned.residual < _ROUNDING else solve(turned.hybrid, turned.guess, turned.arcs)


def begin_of(events: EventSequence, tau: Array) -> int:
    """The arc with which an orbit begins: the longest, on which nothing is on its way through a dead time if it can be.

    Of arcs that last as long, as the two halves of a symmetric orbit do, it is that with the first modes in the order
    of the elements, or whose next arcs have the first: rounding does not choose, nor do coordinates or starts.
    """
    source, p = events.source, tau.size
    quiet = np.ones(p, bool)
    # The timer of a delayed switch runs from its origin to its arrival: no run can begin on these arcs.
    for arrival in np.flatnonzero(events.guards < 0):
        origin, _, turns = source[arrival]
        under_way = p if turns else (arrival - origin - 1) % p + 1
        quiet[(arrival - np.arange(under_way)) % p] = False
    lasts = np.where(quiet, tau, -np.inf) if quiet.any() else tau
    longest = np.flatnonzero(lasts >= lasts.max() - _SAME_TURN * tau.sum())
    word = [(*modes, guard) for modes, guard in zip(events.modes.tolist(), events.guards.tolist(), strict=True)]
    return int(min(longest, key=lambda k: word[k:] + word[:k]))


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
    if not _goes_round(orbit.arcs.event_sequence, orbit.tau, q):
        return False
    free, n = orbit.arcs.free, orbit.arcs.n_state
    free = free[(free < n) | (free >= n + orbit.arcs.n_timers)]  # each delayed switch has its own timers
    shift = orbit.arcs.shift[free] * orbit.tau[:q].sum()
    change = np.abs(orbit.starts[q, free] - shift - orbit.starts[0, free])
    return bool(np.all(change <= _SAME_TURN * orbit.scale[free]))


def is_met(orbit: Orbit) -> bool:
    """Whether the engine, started on the orbit, meets just its events."""
    # A turn from the middle of the longest arc, where no guard is near; an orbit that is left within a turn, or has
    # switches on their way through a dead time, stretch by stretch.
    begin = int(np.argmax(orbit.tau))
    met = 0 if orbit.arcs.n_timers else _met(orbit, begin)
    if met == orbit.arcs.n_arcs:
        return True
    # From one arrival of a delayed switch to the next what is delayed is constant, so that a run over that stretch
    # needs no more of the past than this value: that switches arrive in time the orbit's own timers say.
    model = orbit.hybrid.model
    late = np.full_like(model.smooth_delay, 2.0 * orbit.period)
    standing = replace(orbit.hybrid, model=model._replace(smooth_delay=late)) if late.size else orbit.hybrid
    arcs = np.flatnonzero(orbit.tau > 1e-9 * orbit.period)
    # Where the whole turn has left the orbit a stretch fails most likely.
    first = int(np.searchsorted(arcs, (begin + met) % orbit.arcs.n_arcs, side="right")) - 1
    return all(_goes_on(orbit, standing, arc) for arc in np.roll(arcs, -first).tolist())


def _met(orbit: Orbit, first: int) -> int:
    """How many events of the orbit a turn from the middle of an arc meets in time; all but one that meets others too.

    What comes just at the end of the turn is not looked at.
    """
    p, T = orbit.arcs.n_arcs, orbit.period
    run = _from_middle(orbit, first, 1.1 * T, 3)
    arcs = (first + np.arange(min(p, run.n_kept))) % p
    tau, times, guards = orbit.tau[arcs], run.time[run.order], run.guard[run.order]
    late = np.abs(times[: arcs.size] - (tau.cumsum() - 0.5 * orbit.tau[first]))
    other = (guards[: arcs.size] != orbit.arcs.event_sequence.guards[arcs]) | ~(late < 1e-6 * T)
    if other.any():
        return int(other.argmax())
    return arcs.size - int(arcs.size == p and (times[p:] < (1.0 - 1e-6) * T).any())


def _goes_on(orbit: Orbit, standing: HybridSystem, arc: int) -> bool:
    """Whether runs from the middle of an arc to that of the next one that lasts meet what lies between, and no more."""
    p, guards = orbit.arcs.n_arcs, orbit.arcs.event_sequence.guards
    due: list[tuple[int, float]] = []
    y, begun, time, k = middle(orbit, arc), arc, 0.5 * float(orbit.tau[arc]), arc
    while True:
        if guards[k % p] >= 0:
            due.append((int(guards[k % p]), time))
        elif not _meets(orbit, standing, y, begun, due, time - 1e-6 * orbit.period):
            return False
        else:
            y, begun, time, due = orbit.starts[k % p + 1], (k + 1) % p, 0.0, []
        k += 1
        if orbit.tau[k % p] > 1e-9 * orbit.period:
            return _meets(orbit, standing, y, begun, due, time + 0.5 * float(orbit.tau[k % p]))
        time += float(orbit.tau[k % p])


def _meets(
    orbit: Orbit, standing: HybridSystem, y: Array, arc: int, due: Sequence[tuple[int, float]], t_end: float
) -> bool:
    """Whether a run from a state on an arc meets these guards in time, and no others until `t_end`."""
    if t_end <= 0.0:
        return not due
    start = restarted(standing, orbit.arcs, y, orbit.arcs.event_sequence.modes[arc])
    lines = np.flatnonzero(start.model.smooth_kind == DELAY_LINE)
    # What never switches is the same later.
    source = orbit.arcs.event_sequence.source
    own = orbit.arcs.W[arc, start.model.smooth_w[lines]] @ y
    arrived = np.where(np.isin(lines, source[source[:, 0] >= 0, 1]), y[orbit.arcs.memory.stop :], own)
    most, base = len(due) + 1, 2.0 * start.time_scale
    run = run_hybrid(start, t_end, _NO_SAMPLES, base, most, most, past=arrived)
    times, met = run.time[run.order], run.guard[run.order]
    if run.n_kept != len(due):
        return False
    late = np.abs(times - [time for _, time in due])
    return met.tolist() == [guard for guard, _ in due] and bool(np.all(late < 1e-6 * orbit.period))


def _from_middle(orbit: Orbit, arc: int, t_end: float, turns: int) -> Run:
    """A run from the middle of an arc, with room for the events of so many turns."""
    start = begun_amid(orbit, arc)
    most = turns * orbit.arcs.n_arcs + 40
    return run_hybrid(start, t_end, _NO_SAMPLES, 2.0 * orbit.hybrid.time_scale, most, most)


def next_guess(orbit: Orbit) -> Guess | None:
    """What the engine meets that is started on the orbit, where that has other events; None where it is nothing."""
    T, k = orbit.period, int(np.argmax(orbit.tau))
    turn = SteadyMotion.begun(begun_amid(orbit, k), T)
    once = guess_along(turn) if turn is not None and turn.ends_in_its_modes else None
    if once is not None and once.event_sequence.cyclic_key != orbit.arcs.event_sequence.cyclic_key:
        return once
    best = None
    for guess in recurrences(orbit.hybrid, _from_middle(orbit, k, 2.6 * T, 8), (0.6 * T, 1.5 * T), 80):
        # Just beyond a change of sequence much of the run still follows the old one.
        if guess.event_sequence.cyclic_key != orbit.arcs.event_sequence.cyclic_key:
            return guess
        best = best or guess
    return best


def run_from(orbit: Orbit, t_end: float, max_events: int, y: Array) -> Run:
    """A run of the engine from y, in the modes that the orbit has at its start."""
    start = restarted(orbit.hybrid, orbit.arcs, y, orbit.arcs.event_sequence.modes[0])
    return run_hybrid(start, t_end, _NO_SAMPLES, 2.0 * orbit.hybrid.time_scale, max_events, max_events)


def begun_amid(orbit: Orbit, arc: int) -> HybridSystem:
    """The system begun half-way along an arc of an orbit, where no guard is near."""
    return restarted(orbit.hybrid, orbit.arcs, middle(orbit, arc), orbit.arcs.event_sequence.modes[arc])


def restarted(hybrid: HybridSystem, arcs: Arcs, y: Array, modes: IntArray) -> HybridSystem:
    """The same system, started from y in given modes."""
    return hybrid.at(y[: hybrid.x0.size].copy(), y[arcs.memory].copy(), np.array(modes, np.int64))


@dataclass(eq=False)
class _Approach:
    """Newton's method on the engine's own return map, and the guesses that it has come to from the best one on."""

    steps: Iterator[tuple[Guess, float]]  # see :func:`_approaching`
    made: list[tuple[Guess, float]] = field(default_factory=list)  # those that have been taken

    def best(self) -> Guess | None:
        """The guess nearest to an orbit on so many steps; called again, on so many from there."""
        self.made += islice(self.steps, _MOST_STEPS - len(self.made))
        if not self.made:
            return None
        self.made = self.made[int(np.argmin([size for _, size in self.made])) :]
        return self.made[0][0]

    def begun_at(self, hybrid: HybridSystem, guess: Guess) -> _Approach:
        """Itself, where a guess is its best so far, or a new one."""
        return self if self.made and self.made[0][0] is guess else _Approach(_approaching(hybrid, guess))


def _approaching(hybrid: HybridSystem, guess: Guess) -> Iterator[tuple[Guess, float]]:
    """Guesses, each with the events that the engine meets on its way, and by how much they do not return."""
    if np.any(hybrid.model.smooth_kind == DELAY_LINE):
        return
    found: Guess | None = guess
    while found is not None:
        guess = found
        try:
            arcs = guess.arcs(hybrid)
        except ModelError:
            return
        orbit = evaluate(hybrid, arcs, guess.y, guess.tau)
        size = float(np.max(np.abs(orbit.r[: arcs.free.size]) / orbit.row_scale[: arcs.free.size]))
        if not size < 1e6:
            return
        yield guess, size
        if size < 1e-6:
            return
        step = -orbit.correction(orbit.r)
        change = float(np.max(np.abs(step[: arcs.free.size]) / orbit.column_scale[: arcs.free.size]))
        if not np.isfinite(change):
            return
        # At most a fifth of the motion's size: farther off the engine meets other events than the derivative is of.
        y, _ = orbit.moved(step * min(1.0, 0.2 / max(change, 1e-300)))
        run = run_from(orbit, 1.6 * guess.period, 4 * guess.tau.size + 40, y)
        found = first_return(hybrid, run, y, guess)


def orbit_of(hybrid: HybridSystem, run: Run, period: float | None = None) -> Orbit | None:
    """The exact orbit that a run is on at its end; None where none of its last events closes one."""
    for guess in recurrences(hybrid, run, None if period is None else (0.99 * period, 1.01 * period), 3):
        orbit = close_orbit(hybrid, guess)
        if orbit is not None:
            return orbit
    return None


def orbit_from(
    hybrid: HybridSystem, x: Array, memory: Array, period: float, known: Sequence[Orbit] = ()
) -> Orbit | None:
    """The exact orbit that Newton's method on the flow finds from a state that should lie on one; see `orbits_near`."""
    begin = SteadyMotion.begun(hybrid.at(x, memory, hybrid.modes0), period)
    found = close(begin, given=False, pieces=_PIECES)
    guess = None if found is None else guess_along(found)
    return None if guess is None else orbit_along(hybrid, guess, known)


def orbits_near(
    hybrid: HybridSystem, x: Array, memory: Array, period: float, known: Sequence[Orbit] = ()
) -> Iterator[Orbit]:
    """Exact orbits near a state that should lie on one, best guess first.

    Parameters
    ----------
    x, memory : arrays
        State and memory values; the engine finds the modes.
    period : float
        Of the orbit, roughly [s].
    known : sequence of Orbit, optional
        As of :func:`close_orbit`.
    """
    start = hybrid.at(x, memory, hybrid.modes0)
    seen: set[bytes] = set()
    # A short run first, before it has left an unstable cycle; a stable one is nearer after a long one.
    for turns in (2.6, 8.0):
        try:
            run = run_hybrid(start, turns * period, _NO_SAMPLES, 2.0 * hybrid.time_scale, 2000, 2000)
        except EppError:  # a dead time with more switches than its history holds
            return
        for guess in recurrences(hybrid, run, (0.5 * period, 1.6 * period), 4):
            if guess.event_sequence.key in seen:
                continue
            # On the flow all of them are one: it has no sequence of events.
            close_one = orbit_along if seen else close_orbit
            seen.add(guess.event_sequence.key)
            orbit = close_one(hybrid, guess, known)
            if orbit is not None:
                yield orbit


def same_orbit(one: Orbit, other: Orbit) -> bool:
    """Whether two orbits are the same motion: equal periods, and a state of either found on the other.

    One of them may have switches that the other lacks: a guard that it meets by rounding and leaves at once.
    """
    if abs(one.period / other.period - 1.0) > 1e-6:
        return False
    return _passes(one, other) or _passes(other, one)


def _passes(one: Orbit, other: Orbit) -> bool:
    """Whether an orbit passes the begin of another one, behind the same switch."""
    n, compared = one.hybrid.x0.size, one.hybrid.compared
    at = np.flatnonzero(one.arcs.event_sequence.guards == other.arcs.event_sequence.guards[-1])
    if at.size == 0:
        return False
    away = np.abs(one.starts[at + 1, :n] - other.y[:n])[:, compared] / one.scale[:n][compared]
    return bool(np.min(np.max(away, axis=1)) < 1e-5)
