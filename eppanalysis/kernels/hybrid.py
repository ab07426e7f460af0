"""Compiled: the run of a hybrid system through its modes, exact between events.

Two ways of advancing, one result. Where no smooth channel acts and the state stands on the step grid of its mode, the
*fast step* multiplies by precomputed matrices and proves from end values, end rates and a bound on the fourth
derivative (Bernstein coefficients of the cubic plus its remainder) that no guard is reached. Where it can't prove that,
after an event, off the grid, and for smooth channels, the *series step* expands the state to rounding and looks for the
first rise of every guard. Rules at the start of a series step, for a guard that stands within rounding of zero: the
sign of its first derivative that is above rounding decides; rising fires at once, falling arms it for its next rise.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from eppanalysis.kernels.closure import closing, ring_on, sort_into
from eppanalysis.kernels.delays import LINE_CAPACITY, extend_lines, line_room, read_line, start_lines
from eppanalysis.kernels.lanes import (
    add,
    cubics_below,
    dot,
    padded,
    polynomial,
    row_sum,
    row_sum_from,
    size_sum,
    take,
    take_larger,
    take_sizes,
)
from eppanalysis.kernels.modes import (
    HOT,
    INLINE,
    LONG_DOUBLINGS,
    LONGS,
    compile_long,
    compile_step,
    find_slot,
    make_slots,
    make_work,
    most_guards,
)
from eppanalysis.kernels.series import (
    DELAY_LINE,
    EPS,
    ORDER,
    expand,
    first_rise,
    guard_noise,
    guard_series,
    may_rise,
    term_sizes,
)

DONE, EVENT_LIMIT, DIVERGED, SINGULAR, STALLED, HISTORY, CLOSED = 0, 1, 2, 3, 4, 5, 6
#: Functions that call `advance` are written into their own callers: each level of calls has it translated once more.
WRITTEN_IN = {"cache": True, "nogil": True, "inline": "always"}


class Room(NamedTuple):
    """Scratch room of a run (lengths with a + are padded as in `Slots`)."""

    X: np.ndarray  # (order + 1, n+) series of the state
    Y: np.ndarray  # (order + 2, n+) sizes behind it
    Sg: np.ndarray  # (order + 1, s) series of the smooth channels, their arguments, and helpers
    arg: np.ndarray
    aux: np.ndarray
    p: np.ndarray  # ((order + 1)+,) series of a guard
    still: np.ndarray  # (y+,) constant parts of the signals
    row: np.ndarray  # (8, n+)
    held: np.ndarray  # (H,)
    guard: np.ndarray  # (7, G+)
    end: np.ndarray  # (2n+ + 2G+,)
    watch: np.ndarray  # (2,) candidate period of a run that closes, events near their predecessors
    course: np.ndarray  # (2,) int: knots passed, whether the run is watched for closing
    line_t: np.ndarray  # (s, ring, 2) begin and end of each segment of a delayed output
    line_h: np.ndarray  # (s, ring) unit of its series
    line_c: np.ndarray  # (s, ring, order + 1)
    line_n: np.ndarray  # (s, 2) int: segments written, segment being read


class Ring(NamedTuple):
    """The last events of a run (leading axis: place)."""

    t: np.ndarray  # (keep,)
    guard: np.ndarray  # (keep,) int
    x: np.ndarray  # (keep, n) state just after the event
    v: np.ndarray  # (keep, n) its rate just before
    H: np.ndarray  # (keep, h) held values
    modes: np.ndarray  # (keep, E) int


@njit(cache=True, nogil=True)
def make_ring(keep, n, n_H, n_e):
    """Room for the last `keep` events."""
    return Ring(
        np.empty(keep), np.empty(keep, np.int64), np.empty((keep, n)), np.empty((keep, n)), np.empty((keep, n_H)),
        np.empty((keep, n_e), np.int64),
    )  # fmt: skip


@njit(cache=True, nogil=True)
def make_room(model):
    """Scratch room for one run of a model."""
    n, n_s, n_H = model.A.shape[0], model.S.shape[1], model.K.shape[1]
    G = most_guards(model)
    delayed = False
    for j in range(n_s):
        if model.smooth_kind[j] == DELAY_LINE:
            delayed = True
    size = LINE_CAPACITY if delayed else 1
    return Room(
        np.zeros((ORDER + 1, padded(n))),
        np.zeros((ORDER + 2, padded(n))),
        np.zeros((ORDER + 1, n_s)),
        np.zeros((ORDER + 1, n_s)),
        np.zeros((ORDER + 1, n_s)),
        np.zeros(padded(ORDER + 1)),
        np.zeros(padded(model.Yx.shape[0])),
        np.zeros((8, padded(n))),
        np.zeros(n_H),
        np.zeros((7, padded(G))),
        np.zeros(2 * padded(n) + 2 * padded(G)),
        np.zeros(2),
        np.zeros(2, np.int64),
        np.zeros((n_s, size, 2)),
        np.ones((n_s, size)),
        np.zeros((n_s, size, ORDER + 1)),
        np.zeros((n_s, 2), np.int64),
    )


@njit(cache=True, nogil=True)
def make_rooms(model):
    """Room for the mode combinations of a model, for compiling them, and for its runs."""
    return make_slots(model, min(256, 16 + 4 * model.mode_first[-1])), make_work(model), make_room(model)


@njit(cache=True, nogil=True)
def run(model, slots, work, room, x, modes, H, t_end, base_step, samples, out, max_events, ring, rate, stats):
    """Run from time 0 to t_end; x, modes and H are changed in place to the state at the end.

    Parameters
    ----------
    model : Model
    slots, work, room : Slots, Work, Room
        From `make_rooms`. Mode combinations that are compiled already (for this model and step) are not compiled again.
    x, modes, H : arrays (n+,), (E,), (h,)
        State (padded), mode of each element, held values (the last one is 1).
    t_end, base_step : float
        End, and longest step of the grid.
    samples, out : arrays (nt,), (nt, y+)
        Increasing times at which the signals are wanted, and where they go (padded).
    max_events : int
        Events allowed in all.
    ring : Ring
        Keeps the last ones.
    rate : array (n+,)
        Filled with the rate of the state at the end.
    stats : array (8,)
        Filled with: time reached, events, samples written, fast steps, series steps, forced leaves, periods repeated,
        slots compiled.

    Returns
    -------
    int
        DONE or the reason for stopping early.
    """
    return follow(
        model, slots, work, room, x, modes, H, t_end, base_step, samples, out, max_events, ring, rate, stats
    )  # fmt: skip


@njit(**WRITTEN_IN)
def follow(model, slots, work, room, x, modes, H, t_end, base_step, samples, out, max_events, ring, rate, stats):
    """The run from its start to its end, in the room given; as soon as it has closed it is only repeated."""
    begin(room, x, stats)
    code = advance(model, slots, work, room, x, modes, H, t_end, base_step, samples, out, max_events, ring, rate, stats)
    if code == CLOSED:
        unwatch(model, room)
        repeat(model, slots, work, room, x, modes, H, t_end, base_step, samples, out, max_events, ring, rate, stats)
        code = advance(
            model, slots, work, room, x, modes, H, t_end, base_step, samples, out, max_events, ring, rate, stats
        )  # fmt: skip
    return code


@njit(cache=True, nogil=True)
def begin(room, x, stats):
    """Set the counters to zero, and the sizes from which rounding is judged to those of the state at the start."""
    for i in range(8):
        stats[i] = 0.0
    for i in range(x.size):
        room.row[0, i] = room.row[1, i] = abs(x[i])
    room.course[0], room.course[1] = 0, 1
    # What an earlier run left may not be a number.
    room.Sg[:, :] = 0.0


@njit(cache=True, nogil=True)
def unwatch(model, room):
    """From now on all knots have passed, and the run is computed through."""
    room.course[0], room.course[1] = model.knot_time.size, 0


@njit(**WRITTEN_IN)
def repeat(model, slots, work, room, x, modes, H, t_end, base_step, samples, out, max_events, ring, rate, stats):
    """Carry a run that has closed through all whole periods to come: its clock, its events, and its signals.

    The samples that fall into these periods are taken in one turn, in the order of their phases.
    """
    t, count, first, p = stats[0], int(stats[1]), int(stats[2]), int(stats[6])
    keep = ring.t.size
    period = 0.5 * (ring.t[(count - 1) % keep] - ring.t[(count - 1 - 2 * p) % keep])
    # Switches that pile up at one instant have no period.
    turns = min(int((t_end - t) / period), (max_events - count) // p) if period > 1e-12 * t else 0
    stats[6] = turns
    if turns <= 0:
        return
    last = first + np.searchsorted(samples[first:], t + turns * period)
    n = last - first
    if n > 0:
        phases, order = np.empty(n), np.empty(n, np.int64)
        per_second = 1.0 / period
        for i in range(n):
            after = samples[first + i] - t
            phases[i] = max(0.0, after - np.floor(after * per_second) * period)
        sort_into(phases, period, order, np.empty(n + 1, np.int64))
        values, own, y, m, K = np.empty((n, out.shape[1])), np.zeros(8), x.copy(), modes.copy(), H.copy()
        brief = make_ring(1, ring.x.shape[1], H.size, modes.size)
        advance(
            model, slots, work, room, y, m, K, period, base_step, phases[order], values, max_events, brief, rate, own
        )  # fmt: skip
        for i in range(n):
            take(out[first + order[i]], values[i])
        for i in range(3, 6):
            stats[i] += own[i]
    ring_on(turns, p, period, count, np.empty(p), ring)
    stats[0], stats[1], stats[2] = t + turns * period, count + turns * p, last


@njit(**HOT)
def advance(model, slots, work, room, x, modes, H, t_end, base_step, samples, out, max_events, ring, rate, stats):
    """The loop of :func:`run`, without allocation, from the time, event and sample that `stats` gives (see `begin`).

    A run that is watched returns CLOSED as soon as it has closed on a cycle, with the number of events in a period in
    place of the periods repeated.
    """
    n, n_s = model.S.shape
    X, Y, Sg, arg, aux = room.X, room.Y, room.Sg, room.arg, room.aux
    p, largest, recent, D, f = room.p, room.row[0], room.row[1], room.row[2], room.row[3]
    xd, speed, small, wide = room.row[4], room.row[5], room.row[6], room.row[7]
    constant, lift, g0, g1, tol = room.guard[0], room.guard[1], room.guard[2], room.guard[3], room.guard[4]
    stray, top = room.guard[5], room.guard[6]
    held, still, end = room.held, room.still, room.end
    line_t, line_h, line_c, line_n = room.line_t, room.line_h, room.line_c, room.line_n
    n_samples, n_knots = samples.size, model.knot_time.size
    t, count, i_sample, i_knot = stats[0], int(stats[1]), int(stats[2]), room.course[0]
    origin, j_grid, last_t, same_instant, quiet, armed, forced = 0.0, 0, t, 0, 0, False, False
    limit_same = 2 * model.mode_first[-1] + 16
    watch, watched = room.watch, room.course[1] == 1
    watch[0] = 0.0
    keep = ring.t.size
    code = DONE
    q = find_slot(model, slots, work, modes, base_step)
    if q < 0:
        return SINGULAR
    start_lines(model, slots, q, x, H, line_t, line_h, line_c, line_n)
    _enter(slots, q, H, f, constant, lift, still)
    while True:
        # External inputs that jump or bend now.
        while i_knot < n_knots and model.knot_time[i_knot] <= t:
            x[model.knot_state[i_knot]] = model.knot_value[i_knot]
            H[model.knot_held[i_knot]] = model.knot_slope[i_knot]
            i_knot += 1
            armed = False
            _enter(slots, q, H, f, constant, lift, still)
        if t >= t_end:
            break
        h = slots.step[q]
        t_stop = t_end
        if i_knot < n_knots and model.knot_time[i_knot] < t_stop:
            t_stop = model.knot_time[i_knot]
        which = -1
        if not (armed or forced) and n_s == 0:
            which = _violated(slots, q, x, recent, constant, wide)
            if which < 0 and i_sample == n_samples:
                # No sample holds the run to its grid any more: it begins anew here.
                origin, j_grid, armed = t, 0, True
                if not slots.ready[q]:
                    compile_step(slots, work, q)
                _arm(slots, q, x, f, constant, wide, xd, speed, g0, g1, tol)
        # Long step, where nothing has happened for a while and nothing is to be sampled.
        if quiet >= 16 and armed:
            level = min(quiet // 32, LONGS - 1)
            steps = 1 << (LONG_DOUBLINGS * (level + 1))
            t1 = origin + (j_grid + steps) * h
            if t1 <= t_stop and (i_sample == n_samples or samples[i_sample] >= t1 - 1e-9 * h):
                while slots.longs[q] <= level:
                    compile_long(slots, work, q)
                if _long_step(slots, q, level, xd, speed, g0, tol, stray, end):
                    _move(x, xd, speed, g0, g1, end)
                    j_grid += steps
                    t = t1
                    quiet += 4
                    stats[3] += 1
                    continue
                quiet = 0
        # Fast step: proven free of events from the values at its ends.
        tried = False
        if armed:
            if i_sample < n_samples and samples[i_sample] <= t + 1e-9 * h:
                _write(slots, q, x, still, Sg[0], out[i_sample])
                i_sample += 1
            t1 = origin + (j_grid + 1) * h
            inside = i_sample < n_samples and samples[i_sample] < t1 - 1e-9 * h
            tried = t1 <= t_stop and not inside
            if tried:
                if _fast_step(slots, q, xd, speed, g0, g1, tol, stray, h, end):
                    _move(x, xd, speed, g0, g1, end)
                    j_grid += 1
                    t = t1
                    quiet += 1
                    stats[3] += 1
                    continue
        quiet = 0
        # Series step, at most to the next point of the grid.
        j_grid = int(np.floor((t - origin) / h + 1e-9)) + 1
        t1 = origin + j_grid * h
        on_grid = True
        if t1 > t_stop:
            t1, on_grid = t_stop, False
        take_larger(largest, x, largest)
        d = t1 - t
        if tried:
            u = _predicted(slots, q, g0, g1, tol, h, end)
            if u < 0.9:
                d, on_grid = min(d, u * h), False
        if forced:
            d, on_grid = min(d, 1e-9 * h), False
        for j in range(n_s):
            if model.smooth_kind[j] == DELAY_LINE:
                d1 = line_room(model, j, t, d, line_t, line_h, line_n)
                if d1 < 0.0:
                    code = HISTORY
                    break
                if d1 < d:
                    d, on_grid = d1, False
        if code != DONE:
            break
        best, sized, last = 0.0 if which >= 0 else 2.0, False, -1
        while last < 0 and which < 0:
            for j in range(n_s):
                if model.smooth_kind[j] == DELAY_LINE:
                    read_line(model, j, t, d, line_t, line_h, line_c, line_n, Sg, p)
            last = expand(model, slots, q, x, f, H, d, largest, small, X, Sg, arg, aux)
            if last < 0:
                d, on_grid = 0.5 * d, False
                if not d > 1e-14 * h:
                    code = STALLED
                    break
        stats[4] += last >= 0
        if code != DONE:
            break
        if last >= 0:
            size_sum(X, last, D)
            row_sum_from(lift, slots.all_gf[q], X[0], 1.0, top)
            row_sum_from(top, slots.reach_gf[q], D, 1.0, top)
            for g in range(slots.n_guards[q]):
                if top[g] < 0.0 and (n_s == 0 or not (slots.on_rate[q, g] or slots.smooth_guard[q, g])):
                    continue
                guard_series(slots, q, g, X, last, Sg, constant[g], d, p)
                if p[0] < 0.0 and not may_rise(p):
                    continue
                if not sized:
                    term_sizes(slots, q, X, Sg, H, d, recent, 0, 2, Y, wide)
                    sized = True
                u = _rise_from_start(slots, q, g, X, last, Sg, H, d, recent, Y, wide, p, forced)
                if u < best:
                    best, which = u, g
        forced = False
        if last >= 0:
            for i in range(n):
                recent[i] = abs(X[0, i]) + D[i]
        if best > 0.0:
            u1 = min(best, 1.0)
            first, until = i_sample, t + u1 * d - 1e-9 * h * (which < 0)
            while i_sample < n_samples and samples[i_sample] < until:
                i_sample += 1
            if i_sample > first:
                _sample_series(slots.Y[q], slots.Ys[q], X, last, Sg, samples, first, i_sample, t, d, still, wide, out)
            if n_s > 0:
                extend_lines(model, slots, q, X, last, Sg, H, t, d, u1, line_t, line_h, line_c, line_n)
        if which < 0:
            polynomial(X, last, 1.0, x)
            t = t1 if on_grid or t1 - t == d else t + d
            armed = bool(slots.linear[q]) and on_grid
            if armed:
                if not slots.ready[q]:
                    compile_step(slots, work, q)
                _arm(slots, q, x, f, constant, wide, xd, speed, g0, g1, tol)
        else:
            if best > 0.0:
                polynomial(X, last, best, x)
                t += best * d
            if last >= 0:
                _rates(slots, q, x, f, Sg, last, best, rate)
            armed = False
            if t - last_t > 1e-13 * h:
                same_instant = 0
            last_t = t
            same_instant += 1
            if same_instant > limit_same:
                forced = True
                stats[5] += 1
                same_instant = 0
                continue
            if count >= max_events:
                code = EVENT_LIMIT
                break
            k = slots.guard[q, which]
            jumped = _beyond_level(model, slots, q, k, x, recent, H, Sg, last, best)
            _reset(model, slots, q, k, x, H, Sg, last, best, modes, held)
            q1 = slots.next[q, which]
            if jumped:
                modes[model.guard_element[k]] = model.guard_bypass[k]
                q1 = -1
            if q1 < 0:
                before = slots.count[0]
                q1 = find_slot(model, slots, work, modes, base_step)
                if q1 < 0 and model.guard_bypass[k] >= 0 and not jumped:
                    # Sliding along two surfaces at once is not determined here: the newcomer crosses its own.
                    jumped = True
                    modes[model.guard_element[k]] = model.guard_bypass[k]
                    q1 = find_slot(model, slots, work, modes, base_step)
                if q1 < 0:
                    code = SINGULAR
                    break
                if slots.count[0] >= before and not jumped:
                    slots.next[q, which] = q1
            q = q1
            _settle_on_level(model, slots, q, model.guard_element[k], modes, x, H)
            _enter(slots, q, H, f, constant, lift, still)
            r = count % keep
            ring.t[r], ring.guard[r] = t, k
            _record(ring, r, x, rate, H, modes)
            count += 1
            if watched and i_knot == n_knots and n_s == 0:
                take_larger(largest, x, largest)
                p_events = closing(watch, count, ring, largest)
                if p_events > 0:
                    code, stats[6] = CLOSED, p_events
                    break
        for i in range(n):
            if not abs(x[i]) < 1e100:
                code = DIVERGED
        if code != DONE:
            break
    if code == DONE:
        while i_sample < n_samples and samples[i_sample] <= t * (1.0 + 1e-12):
            _write(slots, q, x, still, Sg[0], out[i_sample])
            i_sample += 1
    if code != SINGULAR and code != CLOSED:
        _expand_at_end(model, slots, q, x, f, H, largest, small, X, Sg, arg, aux)
        for i in range(n):
            # A rate that is rounding of what it was added up from is none: a run at rest is known by it.
            size = abs(f[i])
            for j in range(n):
                size += slots.M_size[q, j, i] * abs(x[j])
            rate[i] = X[1, i] if n_s > 0 or abs(X[1, i]) > 64.0 * EPS * size else 0.0
    stats[0], stats[1], stats[2], stats[7] = t, count, i_sample, slots.count[0]
    return code


@njit(**HOT)
def _expand_at_end(model, slots, q, x, f, H, largest, small, X, Sg, arg, aux):
    """The series once more, for the rate. (Compiled apart: written in twice it takes the compiler much longer.)"""
    expand(model, slots, q, x, f, H, 1.0, largest, small, X, Sg, arg, aux)


@njit(**INLINE)
def _fast_step(slots, q, xd, speed, g0, g1, tol, stray, h, end):
    """Increments over one grid step into `end`; False when an event inside cannot be excluded."""
    wide, half = xd.size, g0.size
    row_sum(slots.T[q], xd, 1.0, end)
    row_sum(slots.bound[q], speed, 1.0, stray)
    increments, rates = end[2 * wide : 2 * wide + half], end[2 * wide + half :]
    return cubics_below(g0, g1, increments, rates, h / 3.0, tol, stray)


@njit(**INLINE)
def _long_step(slots, q, level, xd, speed, g0, tol, stray, end):
    """Increments over a long step into `end`; False when an event inside cannot be excluded."""
    row_sum_from(tol, slots.reach[q, level], speed, 1.0, stray)
    for g in range(slots.n_guards[q]):
        if not g0[g] + stray[g] < 0.0:
            return False
    row_sum(slots.T_long[q, level], xd, 1.0, end)
    return True


@njit(**INLINE)
def _move(x, xd, speed, g0, g1, end):
    """Take over the increments of a step."""
    wide, half = x.size, g0.size
    add(x, end[:wide])
    take(xd, end[wide : 2 * wide])
    take_sizes(speed, xd)
    add(g0, end[2 * wide : 2 * wide + half])
    take(g1, end[2 * wide + half :])


@njit(**INLINE)
def _predicted(slots, q, g0, g1, tol, h, end):
    """Fraction of the step that surely holds the first event, by the guards' cubics: how far the series need reach.

    Guards that stand at zero are left to the rules of the series.
    """
    first, half = 1.0, g0.size
    place = end.size - 2 * half
    for g in range(slots.n_guards[q]):
        a, b, c, d = g0[g], h * g1[g], g0[g] + end[place + g], h * end[place + half + g]
        if a > -tol[g] or (c <= 0.0 and a + b / 3.0 <= 0.0 and c - d / 3.0 <= 0.0):
            continue
        u = 0.05
        while u < first:
            w = 1.0 - u
            v = w * w * ((1.0 + 2.0 * u) * a + u * b) + u * u * ((3.0 - 2.0 * u) * c - w * d)
            if v > 0.0:
                first = u
            u += 0.05
    return first + 0.05


@njit(**INLINE)
def _violated(slots, q, x, recent, constant, wide):
    """A guard that stands clearly above zero already, without any series; -1 when there is none."""
    take_larger(wide, x, recent)
    for g in range(slots.n_guards[q]):
        v = constant[g] + dot(slots.ga[q, g], x)
        if v > 0.0 and not slots.on_rate[q, g] and v > 1e-9 * (abs(constant[g]) + dot(slots.ga_size[q, g], wide)):
            return g
    return -1


@njit(**INLINE)
def _enter(slots, q, H, f, constant, lift, still):
    """Constant parts of the rate, the guards (on state and rate; on the state alone), the signals, until an event."""
    for i in range(slots.N.shape[1]):
        v = 0.0
        for j in range(H.size):
            v += slots.N[q, i, j] * H[j]
        f[i] = v
    for g in range(slots.n_guards[q]):
        v = 0.0
        for j in range(H.size):
            v += slots.gH[q, g, j] * H[j]
        constant[g] = lift[g] = v
        if slots.on_rate[q, g]:
            v = 0.0
            for j in range(H.size):
                v += slots.gfH[q, g, j] * H[j]
            lift[g] = v
    for i in range(slots.YH.shape[1]):
        v = 0.0
        for j in range(H.size):
            v += slots.YH[q, i, j] * H[j]
        still[i] = v


@njit(**INLINE)
def _rates(slots, q, x, f, Sg, last, u, rate):
    """Rate of the state x at place u of a series step."""
    row_sum_from(f, slots.M[q], x, 1.0, rate)
    for j in range(Sg.shape[1]):
        sigma = _at(Sg, last, j, u)
        for i in range(slots.S.shape[1]):
            rate[i] += slots.S[q, i, j] * sigma


@njit(**INLINE)
def _at(Sg, last, j, u):
    """Smooth channel j at place u of its series."""
    v = 0.0
    for k in range(last, -1, -1):
        v = v * u + Sg[k, j]
    return v


@njit(**INLINE)
def _arm(slots, q, x, f, constant, wide, xd, speed, g0, g1, tol):
    """Rates and guards of a linear slot, for the fast steps that follow."""
    take_sizes(wide, x)
    row_sum_from(f, slots.M[q], x, 1.0, xd)
    take_sizes(speed, xd)
    G = slots.n_guards[q]
    for g in range(G):
        v, size = constant[g] + dot(slots.ga[q, g], x), abs(constant[g]) + dot(slots.ga_size[q, g], wide)
        if slots.on_rate[q, g]:
            v += dot(slots.gb[q, g], xd)
            size += dot(slots.gb_size[q, g], speed)
        g0[g], g1[g], tol[g] = v, dot(slots.gf[q, g], xd), 256.0 * EPS * size
    for g in range(G, g0.size):
        g0[g], g1[g], tol[g] = -1.0, 0.0, 0.0


@njit(**INLINE)
def _rise_from_start(slots, q, g, X, last, Sg, H, d, recent, Y, wide, p, forced):
    """First u in [0, 1] where the guard series p rises through zero, by the rules at the start; 2.0 when nowhere."""
    noise = guard_noise(slots, q, g, 0, Sg, H, d, Y)
    if p[0] < -noise:
        return first_rise(p, noise)
    if forced:
        return 2.0
    if p[0] > noise:
        return 0.0
    terms = min(6, last - 1)
    for k in range(1, terms):
        if k == 2:
            # Two terms decide nearly always; more are wanted only where the guard touches.
            term_sizes(slots, q, X, Sg, H, d, recent, 3, terms + 1, Y, wide)
        noise = guard_noise(slots, q, g, k, Sg, H, d, Y)
        if p[k] > noise:
            return 0.0
        if p[k] < -noise:
            for i in range(last + 1):
                p[i] = p[i + k]
            return first_rise(p, 0.0)
    return 2.0


@njit(**INLINE)
def _reset(model, slots, q, k, x, H, Sg, last, u, modes, new):
    """Held values and mode of the element whose guard k fired."""
    e = model.guard_element[k]
    z0, h0 = model.first[e, 0], model.first[e, 2]
    n_ze, n_he = model.first[e + 1, 0] - z0, model.first[e + 1, 2] - h0
    for a in range(n_he):
        v = model.reset_0[k, a]
        for b in range(n_he):
            v += model.reset_h[k, a, b] * H[h0 + b]
        for b in range(n_ze):
            c = model.reset_z[k, a, b]
            if c != 0.0:
                v += c * _input(slots, q, z0 + b, x, H, Sg, last, u)
        new[a] = v
    for a in range(n_he):
        H[h0 + a] = new[a]
    modes[e] = model.guard_target[k]


@njit(**INLINE)
def _input(slots, q, row, x, H, Sg, last, u):
    v = 0.0
    for i in range(slots.Zx.shape[2]):
        v += slots.Zx[q, row, i] * x[i]
    for j in range(H.size):
        v += slots.ZH[q, row, j] * H[j]
    for j in range(Sg.shape[1]):
        c = slots.Zs[q, row, j]
        if c != 0.0:
            v += c * _at(Sg, last, j, u)
    return v


@njit(**INLINE)
def _beyond_level(model, slots, q, k, x, recent, H, Sg, last, u):
    """Whether the input of guard k's element has jumped over the level on which its target would keep it."""
    e = model.guard_element[k]
    m = model.mode_first[e] + model.guard_target[k]
    if not model.mode_stick[m]:
        return False
    z0 = model.first[e, 0]
    size = abs(model.mode_level[m])
    for i in range(model.C.shape[1]):
        size += abs(model.C[z0, i]) * max(abs(x[i]), recent[i])
    return abs(_input(slots, q, z0, x, H, Sg, last, u) - model.mode_level[m]) > 1e-9 * size


@njit(**INLINE)
def _settle_on_level(model, slots, q, e, modes, x, H):
    """Put the input of a sticking element exactly on its level, which the event located to rounding."""
    m = model.mode_first[e] + modes[e]
    if model.mode_stick[m]:
        z0, w0 = model.first[e, 0], model.first[e, 1]
        rest, alone, count, scale = -model.mode_level[m], -1, 0, 0.0
        for j in range(H.size):
            rest += model.Kz[z0, j] * H[j]
        left = rest
        for i in range(model.C.shape[1]):
            c = model.C[z0, i]
            if c != 0.0:
                left += c * x[i]
                scale += c * model.B[i, w0]
                alone, count = i, count + 1
        if count == 1:
            x[alone] = -rest / model.C[z0, alone]
        else:
            for i in range(model.C.shape[1]):
                x[i] -= model.B[i, w0] * left / scale


@njit(**INLINE)
def _write(slots, q, x, still, sigma, row):
    """Signals at state x."""
    row_sum_from(still, slots.Y[q], x, 1.0, row)
    for j in range(sigma.size):
        for i in range(slots.Ys.shape[1]):
            row[i] += slots.Ys[q, i, j] * sigma[j]


@njit(**HOT)
def _sample_series(Y, Ys, X, last, Sg, samples, first, stop, t, d, still, x, out):
    """Signals at the samples first..stop of a series step. (A call with all arrays would be dearer.)"""
    per_unit = 1.0 / d
    for k in range(first, stop):
        u = max(0.0, (samples[k] - t) * per_unit)
        polynomial(X, last, u, x)
        row_sum_from(still, Y, x, 1.0, out[k])
        for j in range(Sg.shape[1]):
            sigma = _at(Sg, last, j, u)
            for i in range(Ys.shape[0]):
                out[k, i] += Ys[i, j] * sigma


@njit(**INLINE)
def _record(ring, r, x, rate, H, modes):
    """State just after an event and its rate just before, into place r of the ring."""
    for i in range(ring.x.shape[1]):
        ring.x[r, i], ring.v[r, i] = x[i], rate[i]
    for i in range(H.size):
        ring.H[r, i] = H[i]
    for i in range(modes.size):
        ring.modes[r, i] = modes[i]
