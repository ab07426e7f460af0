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
)
from eppanalysis.kernels.series import (
    DELAY_LINE,
    EPS,
    ORDER,
    combine,
    expand,
    first_rise,
    four_at,
    guard_noise,
    guard_series,
    guard_travel,
    guard_value,
    may_rise,
    rate_at,
    state_at,
    term_sizes,
    travel,
)

DONE, EVENT_LIMIT, DIVERGED, SINGULAR, STALLED, HISTORY, CLOSED = 0, 1, 2, 3, 4, 5, 6
#: Functions that call `advance` are written into their own callers: each level of calls has it translated once more.
WRITTEN_IN = {"cache": True, "nogil": True, "inline": "always"}


class Room(NamedTuple):
    """Scratch room of a run."""

    X: np.ndarray  # (order + 1, n) series of the state
    Y: np.ndarray  # (order + 2, n) sizes behind it
    Sg: np.ndarray  # (order + 1, s) series of the smooth channels, their arguments, and helpers
    arg: np.ndarray
    aux: np.ndarray
    lanes: np.ndarray  # (n + s, 4) state and smooth channels at four samples
    p: np.ndarray  # (order + 1,) series of a guard
    still: np.ndarray  # (y,) constant parts of the signals
    row: np.ndarray  # (8, n)
    held: np.ndarray  # (H,)
    guard: np.ndarray  # (4, G)
    end: np.ndarray  # (2n + 2G,)
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
    G = model.guard_first[-1]
    delayed = False
    for j in range(n_s):
        if model.smooth_kind[j] == DELAY_LINE:
            delayed = True
    size = LINE_CAPACITY if delayed else 1
    return Room(
        np.zeros((ORDER + 1, n)),
        np.zeros((ORDER + 2, n)),
        np.zeros((ORDER + 1, n_s)),
        np.zeros((ORDER + 1, n_s)),
        np.zeros((ORDER + 1, n_s)),
        np.zeros((n + n_s, 4)),
        np.zeros(ORDER + 1),
        np.zeros(model.Yx.shape[0]),
        np.zeros((8, n)),
        np.zeros(n_H),
        np.zeros((4, G)),
        np.zeros(2 * n + 2 * G),
        np.zeros(2),
        np.zeros(2, np.int64),
        np.zeros((n_s, size, 2)),
        np.ones((n_s, size)),
        np.zeros((n_s, size, ORDER + 1)),
        np.zeros((n_s, 2), np.int64),
    )


@njit(cache=True, nogil=True)
def run(model, x, modes, H, t_end, base_step, samples, out, max_events, ring, rate, stats):
    """Run from time 0 to t_end; x, modes and H are changed in place to the state at the end.

    Parameters
    ----------
    model : Model
    x, modes, H : arrays (n,), (E,), (h,)
        State, mode of each element, held values (the last one is 1).
    t_end, base_step : float
        End, and longest step of the grid.
    samples, out : arrays (nt,), (nt, y)
        Increasing times at which the signals are wanted, and where they go.
    max_events : int
        Events allowed in all.
    ring : Ring
        Keeps the last ones.
    rate : array (n,)
        Filled with the rate of the state at the end.
    stats : array (8,)
        Filled with: time reached, events, samples written, fast steps, series steps, forced leaves, periods repeated,
        slots compiled.

    Returns
    -------
    int
        DONE or the reason for stopping early.
    """
    slots, work, room = make_slots(model, min(256, 16 + 4 * model.mode_first[-1])), make_work(model), make_room(model)
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
        brief = make_ring(1, x.size, H.size, modes.size)
        advance(
            model, slots, work, room, y, m, K, period, base_step, phases[order], values, max_events, brief, rate, own
        )  # fmt: skip
        for i in range(n):
            for j in range(out.shape[1]):
                out[first + order[i], j] = values[i, j]
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
    n, n_s = x.size, model.S.shape[1]
    X, Y, Sg, arg, aux = room.X, room.Y, room.Sg, room.arg, room.aux
    p, largest, recent, D, V = room.p, room.row[0], room.row[1], room.row[2], room.row[3]
    f, xd, small, held, still = room.row[4], room.row[5], room.row[7], room.held, room.still
    constant, g0, g1, tol, end = room.guard[0], room.guard[1], room.guard[2], room.guard[3], room.end
    line_t, line_h, line_c, line_n = room.line_t, room.line_h, room.line_c, room.line_n
    n_samples, n_knots = samples.size, model.knot_time.size
    t, count, i_sample, i_knot = stats[0], int(stats[1]), int(stats[2]), room.course[0]
    j_grid, last_t, same_instant, quiet, armed, forced = 0, t, 0, 0, False, False
    limit_same = 2 * model.mode_first[-1] + 16
    watch, watched = room.watch, room.course[1] == 1
    watch[0] = 0.0
    keep = ring.t.size
    code = DONE
    q = find_slot(model, slots, work, modes, base_step)
    if q < 0:
        return SINGULAR
    start_lines(model, slots, q, x, H, line_t, line_h, line_c, line_n)
    _enter(slots, q, H, f, constant, still)
    while True:
        # External inputs that jump or bend now.
        while i_knot < n_knots and model.knot_time[i_knot] <= t:
            x[model.knot_state[i_knot]] = model.knot_value[i_knot]
            H[model.knot_held[i_knot]] = model.knot_slope[i_knot]
            i_knot += 1
            armed = False
            _enter(slots, q, H, f, constant, still)
        if t >= t_end:
            break
        h = slots.step[q]
        t_stop = t_end
        if i_knot < n_knots and model.knot_time[i_knot] < t_stop:
            t_stop = model.knot_time[i_knot]
        # Long step, where nothing has happened for a while and nothing is to be sampled.
        if quiet >= 16 and armed:
            level = min(quiet // 32, LONGS - 1)
            steps = 1 << (LONG_DOUBLINGS * (level + 1))
            t1 = (j_grid + steps) * h
            if t1 <= t_stop and (i_sample == n_samples or samples[i_sample] >= t1 - 1e-9 * h):
                while slots.longs[q] <= level:
                    compile_long(slots, work, q)
                if _long_step(slots, q, level, n, xd, g0, tol, end):
                    _move(x, xd, g0, g1, end, n, slots.n_guards[q])
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
            t1 = (j_grid + 1) * h
            inside = i_sample < n_samples and samples[i_sample] < t1 - 1e-9 * h
            tried = t1 <= t_stop and not inside
            if tried:
                if _fast_step(slots, q, n, xd, g0, g1, tol, h, end):
                    _move(x, xd, g0, g1, end, n, slots.n_guards[q])
                    j_grid += 1
                    t = t1
                    quiet += 1
                    stats[3] += 1
                    continue
        quiet = 0
        # Series step, at most to the next point of the grid.
        j_grid = int(np.floor(t / h + 1e-9)) + 1
        t1 = j_grid * h
        on_grid = True
        if t1 > t_stop:
            t1, on_grid = t_stop, False
        for i in range(n):
            largest[i] = max(largest[i], abs(x[i]))
        d = t1 - t
        if tried:
            u = _predicted(slots, q, n, g0, g1, h, end)
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
        best, which, sized, last = 2.0, -1, False, -1
        if not (armed or forced) and n_s == 0:
            which = _violated(slots, q, x, recent, constant)
        if which >= 0:
            best = 0.0
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
            travel(X, last, D, V)
            for g in range(slots.n_guards[q]):
                reach = guard_travel(slots, q, g, D, V, d)
                if guard_value(slots, q, g, X, Sg, constant[g], d) + 1.000001 * reach < 0.0:
                    continue
                guard_series(slots, q, g, X, last, Sg, constant[g], d, p)
                if not sized:
                    term_sizes(slots, q, X, Sg, H, d, recent, 0, 2, Y)
                    sized = True
                u = _rise_from_start(slots, q, g, X, last, Sg, H, d, recent, Y, p, forced)
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
                _sample_series(
                    slots.Y_count[q], slots.Y_place[q], slots.Y_value[q], slots.Ys[q], X, last, Sg, samples, first,
                    i_sample, t, d, still, room.lanes, out,
                )  # fmt: skip
            if n_s > 0:
                extend_lines(model, slots, q, X, last, Sg, H, t, d, u1, line_t, line_h, line_c, line_n)
        if which < 0:
            state_at(X, last, 1.0, x)
            t = t1 if on_grid or t1 - t == d else t + d
            armed = bool(slots.linear[q]) and on_grid
            if armed:
                if not slots.ready[q]:
                    compile_step(slots, work, q)
                _arm(slots, q, x, f, constant, xd, g0, g1, tol)
        else:
            if best > 0.0:
                state_at(X, last, best, x)
                t += best * d
            if last >= 0:
                rate_at(X, last, best, d, rate)
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
            _enter(slots, q, H, f, constant, still)
            r = count % keep
            ring.t[r], ring.guard[r] = t, k
            _record(ring, r, x, rate, H, modes)
            count += 1
            if watched and i_knot == n_knots and n_s == 0:
                for i in range(n):
                    largest[i] = max(largest[i], abs(x[i]))
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
            for c in range(slots.M_count[q, i]):
                size += abs(slots.M_value[q, i, c] * x[slots.M_place[q, i, c]])
            rate[i] = X[1, i] if n_s > 0 or abs(X[1, i]) > 64.0 * EPS * size else 0.0
    stats[0], stats[1], stats[2], stats[7] = t, count, i_sample, slots.count[0]
    return code


@njit(**HOT)
def _expand_at_end(model, slots, q, x, f, H, largest, small, X, Sg, arg, aux):
    """The series once more, for the rate. (Compiled apart: written in twice it takes the compiler much longer.)"""
    expand(model, slots, q, x, f, H, 1.0, largest, small, X, Sg, arg, aux)


@njit(**INLINE)
def _fast_step(slots, q, n, xd, g0, g1, tol, h, end):
    """Increments over one grid step into `end`; False when an event inside cannot be excluded."""
    G = slots.n_guards[q]
    bound = slots.bound[q]
    combine(slots.T[q], xd, end[: 2 * n + 2 * G])
    third = h / 3.0
    for g in range(G):
        a = g0[g]
        b = a + end[2 * n + g]
        most = max(max(a, b), max(a + third * g1[g], b - third * end[2 * n + G + g]))
        if most > -tol[g]:
            return False
        stray = tol[g]
        for i in range(n):
            stray += bound[i, g] * abs(xd[i])
        if most > -stray:
            return False
    return True


@njit(**INLINE)
def _long_step(slots, q, level, n, xd, g0, tol, end):
    """Increments over a long step into `end`; False when an event inside cannot be excluded."""
    G = slots.n_guards[q]
    reach = slots.reach[q, level]
    for g in range(G):
        v = g0[g] + tol[g]
        for i in range(n):
            v += reach[i, g] * abs(xd[i])
        if not v < 0.0:
            return False
    combine(slots.T_long[q, level], xd, end[: 2 * n + 2 * G])
    return True


@njit(**INLINE)
def _move(x, xd, g0, g1, end, n, G):
    """Take over the increments of a step."""
    for i in range(n):
        x[i] += end[i]
        xd[i] = end[n + i]
    for g in range(G):
        g0[g] += end[2 * n + g]
        g1[g] = end[2 * n + G + g]


@njit(**INLINE)
def _predicted(slots, q, n, g0, g1, h, end):
    """Fraction of the step that surely holds the first event, by the guards' cubics: how far the series need reach."""
    G = slots.n_guards[q]
    first = 1.0
    for g in range(G):
        a, b, c, d = g0[g], h * g1[g], g0[g] + end[2 * n + g], h * end[2 * n + G + g]
        if c <= 0.0 and a + b / 3.0 <= 0.0 and c - d / 3.0 <= 0.0:
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
def _violated(slots, q, x, recent, constant):
    """A guard that stands clearly above zero already, without any series; -1 when there is none."""
    for g in range(slots.n_guards[q]):
        if slots.gb_count[q, g] == 0:
            v, size = constant[g], abs(constant[g])
            for c in range(slots.ga_count[q, g]):
                i, a = slots.ga_place[q, g, c], slots.ga_value[q, g, c]
                v += a * x[i]
                size += abs(a) * max(abs(x[i]), recent[i])
            if v > 1e-9 * size:
                return g
    return -1


@njit(**INLINE)
def _enter(slots, q, H, f, constant, still):
    """Constant parts of the rate and of the guards while mode and held values stay."""
    for i in range(f.size):
        v = 0.0
        for j in range(H.size):
            v += slots.N[q, i, j] * H[j]
        f[i] = v
    for g in range(slots.n_guards[q]):
        v = 0.0
        for j in range(H.size):
            v += slots.gH[q, g, j] * H[j]
        constant[g] = v
    for i in range(still.size):
        v = 0.0
        for j in range(H.size):
            v += slots.YH[q, i, j] * H[j]
        still[i] = v


@njit(**INLINE)
def _rates(slots, q, x, f, xd):
    """Rate of the state x in a linear slot."""
    count, place, value = slots.M_count[q], slots.M_place[q], slots.M_value[q]
    for i in range(x.size):
        v = f[i]
        for c in range(count[i]):
            v += value[i, c] * x[place[i, c]]
        xd[i] = v


@njit(**INLINE)
def _arm(slots, q, x, f, constant, xd, g0, g1, tol):
    """Rates and guards at a grid point, for the fast steps that follow."""
    n = x.size
    _rates(slots, q, x, f, xd)
    for g in range(slots.n_guards[q]):
        v, d, size = constant[g], 0.0, abs(constant[g])
        for c in range(slots.ga_count[q, g]):
            i, a = slots.ga_place[q, g, c], slots.ga_value[q, g, c]
            v += a * x[i]
            size += abs(a * x[i])
            d += a * xd[i]
        if slots.gb_count[q, g]:
            d = 0.0
            for i in range(n):
                d += slots.gf[q, g, i] * xd[i]
            for c in range(slots.gb_count[q, g]):
                a = slots.gb_value[q, g, c] * xd[slots.gb_place[q, g, c]]
                v += a
                size += abs(a)
        g0[g], g1[g], tol[g] = v, d, 256.0 * EPS * size


@njit(**INLINE)
def _rise_from_start(slots, q, g, X, last, Sg, H, d, recent, Y, p, forced):
    """First u in [0, 1] where the guard series p rises through zero, by the rules at the start; 2.0 when nowhere."""
    if p[0] < 0.0 and not may_rise(p, last, 0.0):
        return 2.0
    noise = guard_noise(slots, q, g, 0, Sg, H, d, Y)
    if p[0] < -noise:
        return first_rise(p, 0, last, noise)
    if forced:
        return 2.0
    if p[0] > noise:
        return 0.0
    terms = min(6, last - 1)
    for k in range(1, terms):
        if k == 2:
            # Two terms decide nearly always; more are wanted only where the guard touches.
            term_sizes(slots, q, X, Sg, H, d, recent, 3, terms + 1, Y)
        noise = guard_noise(slots, q, g, k, Sg, H, d, Y)
        if p[k] > noise:
            return 0.0
        if p[k] < -noise:
            return first_rise(p, k, last, 0.0)
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
    for i in range(x.size):
        v += slots.Zx[q, row, i] * x[i]
    for j in range(H.size):
        v += slots.ZH[q, row, j] * H[j]
    for j in range(Sg.shape[1]):
        c = slots.Zs[q, row, j]
        if c != 0.0:
            s = 0.0
            for k in range(last, -1, -1):
                s = s * u + Sg[k, j]
            v += c * s
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
    for i in range(x.size):
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
        for i in range(x.size):
            c = model.C[z0, i]
            if c != 0.0:
                left += c * x[i]
                scale += c * model.B[i, w0]
                alone, count = i, count + 1
        if count == 1:
            x[alone] = -rest / model.C[z0, alone]
        else:
            for i in range(x.size):
                x[i] -= model.B[i, w0] * left / scale


@njit(**INLINE)
def _write(slots, q, x, still, sigma, row):
    """Signals at state x."""
    _signals(slots.Y_count[q], slots.Y_place[q], slots.Y_value[q], slots.Ys[q], x, still, sigma, row)


@njit(**INLINE)
def _signals(count, place, value, smooth, x, still, sigma, row):
    for i in range(row.size):
        v = still[i]
        for c in range(count[i]):
            v += value[i, c] * x[place[i, c]]
        for j in range(sigma.size):
            v += smooth[i, j] * sigma[j]
        row[i] = v


@njit(**HOT)
def _sample_series(count, place, value, smooth, X, last, Sg, samples, first, stop, t, d, still, lanes, out):
    """Signals at the samples first..stop of a series step, four at a time. (A call with all arrays would be dearer.)"""
    n, n_s = X.shape[1], Sg.shape[1]
    final = stop - 1
    for k0 in range(first, stop, 4):
        # Beyond the last sample it is taken again, to the same place.
        k1, k2, k3 = min(k0 + 1, final), min(k0 + 2, final), min(k0 + 3, final)
        u0, u1 = max(0.0, (samples[k0] - t) / d), max(0.0, (samples[k1] - t) / d)
        u2, u3 = max(0.0, (samples[k2] - t) / d), max(0.0, (samples[k3] - t) / d)
        for i in range(n):
            lanes[i, 0], lanes[i, 1], lanes[i, 2], lanes[i, 3] = four_at(X, last, i, u0, u1, u2, u3)
        for i in range(n_s):
            v0, v1, v2, v3 = four_at(Sg, last, i, u0, u1, u2, u3)
            lanes[n + i, 0], lanes[n + i, 1], lanes[n + i, 2], lanes[n + i, 3] = v0, v1, v2, v3
        for i in range(still.size):
            v0 = v1 = v2 = v3 = still[i]
            for c in range(count[i]):
                a, x = value[i, c], lanes[place[i, c]]
                v0, v1, v2, v3 = v0 + a * x[0], v1 + a * x[1], v2 + a * x[2], v3 + a * x[3]
            for j in range(n_s):
                a, x = smooth[i, j], lanes[n + j]
                v0, v1, v2, v3 = v0 + a * x[0], v1 + a * x[1], v2 + a * x[2], v3 + a * x[3]
            out[k0, i], out[k1, i], out[k2, i], out[k3, i] = v0, v1, v2, v3


@njit(**INLINE)
def _record(ring, r, x, rate, H, modes):
    """State just after an event and its rate just before, into place r of the ring."""
    for i in range(x.size):
        ring.x[r, i], ring.v[r, i] = x[i], rate[i]
    for i in range(H.size):
        ring.H[r, i] = H[i]
    for i in range(modes.size):
        ring.modes[r, i] = modes[i]
