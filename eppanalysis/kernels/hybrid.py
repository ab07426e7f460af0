"""Compiled: the run of a hybrid system through its modes, exact between events.

Two ways of advancing, one result. Where no smooth channel acts and the state stands on the step grid of its mode, the
*fast step* multiplies by precomputed matrices and proves from end values, end rates and a bound on the fourth
derivative (Bernstein coefficients of the cubic plus its remainder) that no guard is reached. Where it can't prove that,
off the grid of the samples, and for smooth channels, the *series step* expands the state to rounding and looks for the
first rise of every guard. Rules at the start of a series step, for a guard that stands within rounding of zero: the
sign of its first derivative that is above rounding decides; rising fires at once, falling arms it for its next rise.
"""

from __future__ import annotations

import numpy as np

from eppanalysis.kernels.closure import closing, ring_on, sort_into
from eppanalysis.kernels.compiling import njit
from eppanalysis.kernels.delays import extend_lines, line_room, read_line, start_lines
from eppanalysis.kernels.flow import compile_long, compile_step
from eppanalysis.kernels.jumps import clearly_above, let_go, may_leave_behind, place_of
from eppanalysis.kernels.lanes import (
    add,
    any_above,
    cubics_below,
    dot,
    lower_to,
    polynomial,
    raise_to,
    row_sum,
    row_sum_from,
    size_sum,
    take,
    take_larger,
    take_sizes,
)
from eppanalysis.kernels.modes import find_slot
from eppanalysis.kernels.series import (
    DELAY_LINE,
    EPS,
    _smooth_term,
    expand,
    guard_series,
    may_rise,
    term_sizes,
)
from eppanalysis.kernels.switches import record, rise_from_start, smooth_at, switch
from eppanalysis.kernels.tables import ENTRY, HOT, INLINE, LONG_DOUBLINGS, LONGS

DONE, EVENT_LIMIT, DIVERGED, SINGULAR, STALLED, HISTORY, STEP_LIMIT, PAUSED = 0, 1, 2, 3, 4, 5, 6, 7
#: A state beyond this has diverged.
LARGEST = 1e100
#: Why fast steps end.
OFF_GRID, EVENT_AHEAD, LONG_AHEAD = 0, 1, 2
#: Steps without a switch before a long one (of as many) is tried.
LONG_QUIET = 16


@njit(**ENTRY)
def run(model, slots, work, room, x, modes, H, t_end, base_step, samples, max_events, ring, rate, stats, watched):
    """Run from time 0 to t_end; x, modes and H are changed in place to the state at the end.

    A run that has closed on a cycle is carried through all whole periods to come: its clock, its events, and its
    signals, whose samples are taken in one turn, in the order of their phases. The rest of the last period is computed.

    Parameters
    ----------
    model : Model
    slots, work, room : Slots, Work, Room
        From `make_rooms`. Mode combinations that are compiled already (for this model and step) are not compiled again.
    x, modes, H : arrays (n+,), (E,), (h,)
        State (padded), mode of each element, held values (the last one is 1).
    t_end, base_step : float
        End, and longest step of the grid.
    samples : Samples
        Filled with the signals.
    max_events : int
        Events allowed in all.
    ring : Ring
        Keeps the last ones.
    rate : array (n+,)
        Filled with the rate of the state at the end.
    stats : array (8,)
        Filled with: time reached, events, samples written, fast steps, series steps, forced leaves, periods repeated,
        slots compiled.
    watched : bool
        False for a run that goes on from one that has ended: its inputs have passed, and it is computed through.

    Returns
    -------
    int
        DONE or the reason for stopping early. PAUSED: the same call goes on, to the last bit as if there had been no
        pause; the interpreter has its turn in between.
    """
    n, n_s = model.S.shape
    X, Y, Sg, arg, aux = room.X, room.Y, room.Sg, room.arg, room.aux
    p, largest, recent, D, f = room.p, room.row[0], room.row[1], room.row[2], room.row[3]
    xd, speed, small, wide, one, recent_behind = (
        room.row[4], room.row[5], room.row[6], room.row[7], room.row[8], room.row[9]
    )  # fmt: skip
    constant, lift, g0, g1, tol = room.guard[0], room.guard[1], room.guard[2], room.guard[3], room.guard[4]
    stray, top = room.guard[5], room.guard[6]
    held, still, end, low, high = room.held, room.still, room.end, room.range[0], room.range[1]
    line_t, line_h, line_c, line_n = room.line_t, room.line_h, room.line_c, room.line_n
    times, rows, out = samples.times, samples.rows, samples.out
    all_samples, n_knots, n_e, beyond = samples.phases.size, model.knot_time.size, modes.size, room.then_x[0]
    t, until, count, i_sample, n_samples = 0.0, t_end, 0, 0, all_samples
    i_knot = 0 if watched else n_knots
    origin, j_grid, last_t, same_instant, quiet, armed, forced = 0.0, 0, 0.0, 0, 0, False, False
    # Whether the constant parts are those of the mode; what fast steps carry along, that of the state; and whether the
    # state comes from a series step.
    entered, renewed, stepped = False, False, False
    aside, t_behind, i_behind = False, 0.0, 0
    delayed = line_h.shape[1] > 1
    limit_same = 2 * model.mode_first[-1] + 16
    watch, keep, pause = room.watch, ring.t.size, room.pause
    code, spent = DONE, 0.0
    if pause[2] == 0.0:
        watch[0] = watch[2] = 0.0
        for i in range(8):
            stats[i] = 0.0
        _forget(room, x, n)
        take_sizes(largest, x)
        take_sizes(recent, x)
        take(low, x)
        take(high, x)
        one[:] = 1.0
        q = find_slot(model, slots, work, modes, base_step)
        if q < 0:
            return SINGULAR
        start_lines(model, slots, q, x, H, line_t, line_h, line_c, line_n)
    else:
        t, until, origin, last_t, t_behind, spent = pause[3], pause[4], pause[5], pause[6], pause[7], pause[8]
        count, i_sample, n_samples, i_knot, j_grid = (
            int(pause[9]), int(pause[10]), int(pause[11]), int(pause[12]), int(pause[13])
        )  # fmt: skip
        same_instant, quiet, i_behind, q = int(pause[14]), int(pause[15]), int(pause[16]), int(pause[17])
        armed, forced, entered = pause[18] > 0.0, pause[19] > 0.0, pause[20] > 0.0
        renewed, stepped, aside, watched = pause[21] > 0.0, pause[22] > 0.0, pause[23] > 0.0, pause[24] > 0.0
        pause[2] = 0.0
    stop_at = spent + pause[0]
    while True:
        if spent >= stop_at:
            if spent >= pause[1] and not aside:
                code = STEP_LIMIT
                break
            pause[2] = 1.0
            pause[3], pause[4], pause[5], pause[6], pause[7], pause[8] = t, until, origin, last_t, t_behind, spent
            pause[9], pause[10], pause[11], pause[12], pause[13] = count, i_sample, n_samples, i_knot, j_grid
            pause[14], pause[15], pause[16], pause[17] = same_instant, quiet, i_behind, q
            pause[18], pause[19], pause[20] = armed, forced, entered
            pause[21], pause[22], pause[23], pause[24] = renewed, stepped, aside, watched
            return PAUSED
        spent += 1.0
        # External inputs that jump or bend now; what begins at the start is no jump, for all starts from there.
        if i_knot < n_knots and model.knot_time[i_knot] <= t:
            if t > 0.0 and may_leave_behind(model, modes, n_e):
                if not entered:
                    _enter(slots, q, H, f, constant, lift, still)
                _rate_at_end(model, slots, q, x, f, H, X, Sg, arg, aux, wide, small, rate)
                take(beyond, x)
                _put_inputs(model, i_knot, t, beyond)
                q, count = let_go(
                    model, slots, work, room, ring, q, -1, x, beyond, recent, H, Sg, 0, 0.0, modes, base_step, t, rate,
                    count, not aside,
                )  # fmt: skip
                if q < 0:
                    code = SINGULAR
                    break
            _put_inputs(model, i_knot, t, x)
            while i_knot < n_knots and model.knot_time[i_knot] <= t:
                H[model.knot_held[i_knot]] = model.knot_slope[i_knot]
                i_knot += 1
            armed, entered = False, False
        if not entered:
            _enter(slots, q, H, f, constant, lift, still)
            entered = True
        if stepped:
            stepped = False
            lower_to(low, x)
            raise_to(high, x)
            if _too_large(x):
                code = DIVERGED
                break
        if t >= until:
            if not aside:
                break
            # Back from the period that served the samples of all periods to come, to the time behind them.
            _write_rest(slots, q, x, still, Sg[0], rows, i_sample, n_samples, out)
            _copy_start(room.x, room.modes, room.H, x, modes, H)
            take(recent, recent_behind)
            aside, t, until, i_sample, n_samples = False, t_behind, t_end, i_behind, all_samples
            origin, last_t, same_instant, quiet, armed, entered = 0.0, t, 0, 0, False, False
            q = find_slot(model, slots, work, modes, base_step)
            continue
        h = slots.step[q]
        t_stop = until
        if i_knot < n_knots and model.knot_time[i_knot] < t_stop:
            t_stop = model.knot_time[i_knot]
        which = -1
        if not (armed or forced) and n_s == 0:
            which = _violated(slots, q, x, recent, constant, wide)
            if which < 0 and i_sample == n_samples:
                # No sample holds the run to its grid any more: it begins anew here.
                origin, j_grid, armed, renewed = t, 0, True, False
        if armed and not renewed:
            _arm(slots, work, q, x, f, constant, wide, xd, speed, g0, g1, tol)
            renewed = True
        # Long step, where nothing has happened for a while and nothing is to be sampled.
        if quiet >= LONG_QUIET and armed:
            level = min(quiet // 32, LONGS - 1)
            steps = 1 << (LONG_DOUBLINGS * (level + 1))
            t1 = origin + (j_grid + steps) * h
            if t1 <= t_stop and (i_sample == n_samples or times[i_sample] >= t1 - 1e-9 * h):
                while slots.longs[q] <= level:
                    compile_long(slots, work, q)
                if _long_step(slots, q, level, xd, speed, g0, tol, stray, end):
                    _move(x, xd, speed, g0, g1, end, low, high)
                    j_grid += steps
                    t = origin + j_grid * h
                    quiet += 4
                    stats[3] += 1
                    continue
                quiet = 0
        # Fast steps: proven free of events from the values at their ends.
        why = OFF_GRID
        if armed:
            before = j_grid
            j_grid, i_sample, why = _fast_steps(
                slots.T[q], slots.bound[q], slots.Y[q], slots.Ys[q], x, xd, speed, g0, g1, tol, stray, end, still,
                one, Sg[0], times, rows, out, origin, j_grid, h, t, t_stop, i_sample, n_samples, quiet, low, high,
            )  # fmt: skip
            if j_grid > before:
                t = origin + j_grid * h
                quiet += j_grid - before
                stats[3] += j_grid - before
                spent += (j_grid - before) * 0.0625
                if _too_large(x):
                    code = DIVERGED
                    break
                if why != EVENT_AHEAD:
                    continue
        quiet = 0
        # Series step, at most to the next point of the grid; where the past is read, the steps made then are the grid.
        if delayed:
            origin = t
        j_grid = int(np.floor((t - origin) / h + 1e-9)) + 1
        t1 = origin + j_grid * h
        if t1 - t <= 1e-9 * h:
            # Late in a long run the place on the grid is rounded.
            j_grid += 1
            t1 = origin + j_grid * h
        on_grid = True
        if t1 > t_stop:
            t1, on_grid = t_stop, False
        take_larger(largest, x, largest)
        d = t1 - t
        if why == EVENT_AHEAD:
            u = _predicted(slots, q, g0, g1, tol, h, end)
            if u < 0.9:
                d, on_grid = min(d, u * h), False
        if forced:
            d, on_grid = min(d, 1e-9 * h), False
        ahead = d
        for j in range(n_s):
            if model.smooth_kind[j] == DELAY_LINE:
                counts, holds = line_room(model, j, t, line_t, line_h, line_n)
                if counts < 0.0:
                    code = HISTORY
                    break
                if counts < ahead:
                    ahead, on_grid = counts, False
                d = min(d, holds)
        if code != DONE:
            break
        best, last = 0.0 if which >= 0 else 2.0, -1
        while last < 0 and which < 0:
            for j in range(n_s):
                if model.smooth_kind[j] == DELAY_LINE:
                    read_line(model, j, t, d, line_t, line_h, line_c, line_n, Sg, p)
            last = expand(model, slots, q, x, f, H, d, largest, small, X, Sg, arg, aux)
            if last < 0:
                d, on_grid = 0.5 * d, False
                ahead = min(ahead, d)
                if not d > 1e-14 * h:
                    code = STALLED
                    break
        stats[4] += last >= 0
        if code != DONE:
            break
        if last >= 0:
            clock = t / d if delayed else 0.0
            which, best = _first_guard(
                slots, q, X, last, Sg, H, d, recent, clock, Y, wide, p, constant, lift, D, top, forced
            )  # fmt: skip
            if ahead < d and best > ahead / d:
                which, best = -1, 2.0
        forced = False
        if last >= 0:
            for i in range(n):
                recent[i] = abs(X[0, i]) + D[i]
        if best > 0.0:
            u1 = min(best, ahead / d)
            first, reached = i_sample, t + u1 * d - 1e-9 * h * (which < 0)
            while i_sample < n_samples and times[i_sample] < reached:
                i_sample += 1
            if i_sample > first:
                _sample_series(
                    slots.Y[q], slots.Ys[q], X, last, Sg, times, rows, first, i_sample, t, d, still, wide, out
                )  # fmt: skip
            if n_s > 0:
                extend_lines(model, slots, q, X, last, Sg, H, t, d, u1, line_t, line_h, line_c, line_n, p)
        if which < 0:
            polynomial(X, last, ahead / d, x)
            t = t1 if on_grid or t1 - t == ahead else t + ahead
            armed, renewed = bool(slots.linear[q]) and on_grid, False
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
            if count >= max_events and not aside:
                code = EVENT_LIMIT
                break
            k = slots.guard[q, which]
            if may_leave_behind(model, modes, model.guard_element[k]) and not clearly_above(
                slots, q, which, x, recent, H, Sg, last, best
            ):
                q, count = let_go(
                    model, slots, work, room, ring, q, k, x, x, recent, H, Sg, last, best, modes, base_step, t, rate,
                    count, not aside,
                )  # fmt: skip
                if q >= 0:
                    which = place_of(slots, q, k)
            if q >= 0:
                q = switch(model, slots, work, q, which, x, recent, H, Sg, last, best, modes, held, base_step)
            if q < 0:
                code = SINGULAR
                break
            entered = False
            if delayed and t == 0.0 and i_knot == 0:
                # No input has jumped: the element has been for ever in another mode than it was given.
                start_lines(model, slots, q, x, H, line_t, line_h, line_c, line_n)
            if not aside:
                r = count % keep
                ring.t[r], ring.guard[r] = t, k
                record(ring, r, x, rate, H, modes)
                count += 1
            if watched and i_knot == n_knots and n_s == 0:
                take_larger(largest, x, largest)
                p_events = closing(watch, count, ring, largest)
                if p_events > 0:
                    # From here on the run repeats itself: it is carried through all whole periods to come.
                    watched = False
                    turns, period, n_aside = _carry_on(
                        ring, room, samples, i_sample, t, t_end, count, p_events, max_events
                    )
                    stats[6] = turns
                    if turns > 0:
                        count += turns * p_events
                        t_behind, i_behind = t + turns * period, i_sample + n_aside
                        if n_aside > 0:
                            # Their samples are taken in one more period, in the order of their phases.
                            _copy_start(x, modes, H, room.x, room.modes, room.H)
                            take(recent_behind, recent)
                            aside, t, until, i_sample, n_samples = True, 0.0, period, all_samples, all_samples + n_aside
                        else:
                            t, i_sample = t_behind, i_behind
                        origin, last_t, same_instant = 0.0, t, 0
        stepped = True
    for j in range(n_s):
        if model.smooth_kind[j] == DELAY_LINE:
            line_room(model, j, t, line_t, line_h, line_n)
            read_line(model, j, t, 0.0, line_t, line_h, line_c, line_n, Sg, p)
    if code == DONE:
        first = i_sample
        while i_sample < n_samples and times[i_sample] <= t * (1.0 + 1e-12):
            i_sample += 1
        _write_rest(slots, q, x, still, Sg[0], rows, first, i_sample, out)
    if code != SINGULAR:
        _rate_at_end(model, slots, q, x, f, H, X, Sg, arg, aux, wide, small, rate)
    stats[0], stats[1], stats[2], stats[7] = t, count, i_sample, slots.count[0]
    return code


@njit(**INLINE)
def _first_guard(slots, q, X, last, Sg, H, d, recent, clock, Y, wide, p, constant, lift, D, top, forced):
    """The guard that rises first on the series, and where in [0, 1]; -1 and 2.0 when none does."""
    which, best, sized = -1, 2.0, False
    size_sum(X, last, D)
    row_sum_from(lift, slots.all_gf[q], X[0], 1.0, top)
    row_sum_from(top, slots.reach_gf[q], D, 1.0, top)
    for g in range(slots.n_guards[q]):
        if top[g] < 0.0 and (Sg.shape[1] == 0 or not (slots.on_rate[q, g] or slots.smooth_guard[q, g])):
            continue
        guard_series(slots, q, g, X, last, Sg, constant[g], d, p)
        if p[0] < 0.0 and not may_rise(p):
            continue
        if not sized:
            term_sizes(slots, q, X, Sg, H, d, recent, clock, 0, 2, Y, wide)
            sized = True
        u = rise_from_start(slots, q, g, X, last, Sg, H, d, recent, clock, Y, wide, p, forced)
        if u < best:
            best, which = u, g
    return which, best


@njit(**HOT)
def _forget(room, x, n):
    """Clear what an earlier run left, which may not be a number, and which reaches the padding of rows."""
    for rows in (room.X, room.Y, room.Sg, room.arg, room.aux, room.row, room.guard):
        rows[:, :] = 0.0
    for row in (room.p, room.end, x[n:]):
        row[:] = 0.0


@njit(**INLINE)
def _put_inputs(model, i, t, x):
    """Put external inputs where they stand behind all their knots from i on that are due."""
    while i < model.knot_time.size and model.knot_time[i] <= t:
        x[model.knot_state[i]] = model.knot_value[i]
        i += 1


@njit(**INLINE)
def _too_large(x):
    """Whether a state is beyond all bounds, or no number."""
    for i in range(x.size):
        if not abs(x[i]) < LARGEST:
            return True
    return False


@njit(**HOT)
def _copy_start(x, modes, H, to_x, to_modes, to_H):
    """State, modes and held values to another place."""
    take(to_x, x)
    for i in range(modes.size):
        to_modes[i] = modes[i]
    for i in range(H.size):
        to_H[i] = H[i]


@njit(**HOT)
def _carry_on(ring, room, samples, first, t, t_end, count, p, max_events):
    """Enter the events of all whole periods (of p events) to come into the ring, and sort their samples by phase.

    Returns how many periods, their length, and how many samples from `first` on fall into them.
    """
    keep = ring.t.size
    period = 0.5 * (ring.t[(count - 1) % keep] - ring.t[(count - 1 - 2 * p) % keep])
    turns = 0
    # Switches that pile up at one instant have no period.
    if period > 1e-12 * t:
        turns = max(0, min(int((t_end - t) / period), (max_events - count) // p))
    if turns == 0:
        return 0, period, 0
    ring_on(turns, p, period, count, room.once, ring)
    return turns, period, _sort_samples(samples, first, t, period, turns)


@njit(**HOT)
def _sort_samples(samples, first, t, period, turns):
    """Sort the samples from `first` on, of all whole periods to come, by phase behind the others; returns how many."""
    times, phases, nt = samples.times, samples.phases, samples.phases.size
    n, end, per_second = 0, t + turns * period, 1.0 / period
    while first + n < nt and times[first + n] < end:
        after = times[first + n] - t
        phases[n] = max(0.0, after - np.floor(after * per_second) * period)
        n += 1
    if n > 0:
        sort_into(phases[:n], period, samples.order, samples.bins[: n + 1])
        for i in range(n):
            samples.times[nt + i], samples.rows[nt + i] = phases[samples.order[i]], first + samples.order[i]
    return n


@njit(**INLINE)
def _fast_steps(
    T, bound, Y, Ys, x, xd, speed, g0, g1, tol, stray, end, still, one, sigma, times, rows, out,
    origin, j, h, t, t_stop, i_sample, n_samples, quiet, low, high,
):  # fmt: skip
    """Steps of the grid from its point j on, with the samples on it; returns the point, the next sample, why there.

    EVENT_AHEAD: a switch within the next step can't be excluded, and what the step would add is in `end`. OFF_GRID: the
    next step would go beyond `t_stop` or a sample. LONG_AHEAD: so much has passed without a switch that a long step may
    be tried, or the state has grown too large. A row of ones is in `one`.
    """
    wide, half, slack = x.size, g0.size, 1e-9 * h
    after = 2 * wide + half
    while True:
        if i_sample < n_samples and times[i_sample] <= t + slack:
            _write(Y, Ys, x, still, sigma, out[rows[i_sample]])
            i_sample += 1
        t1 = origin + (j + 1) * h
        if t1 > t_stop or (i_sample < n_samples and times[i_sample] < t1 - slack):
            return j, i_sample, OFF_GRID
        row_sum(T, xd, 1.0, end)
        row_sum(bound, speed, 1.0, stray)
        if not cubics_below(g0, g1, end[2 * wide : after], end[after:], h / 3.0, tol, stray):
            return j, i_sample, EVENT_AHEAD
        _move(x, xd, speed, g0, g1, end, low, high)
        j += 1
        t = t1
        quiet += 1
        if (
            any_above(x, 1.0 / LARGEST, one)
            or t >= t_stop
            or quiet >= LONG_QUIET
            and (i_sample == n_samples or times[i_sample] >= t + LONG_QUIET * h)
        ):
            return j, i_sample, LONG_AHEAD


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
def _move(x, xd, speed, g0, g1, end, low, high):
    """Take over the increments of a step."""
    wide, half = x.size, g0.size
    add(x, end[:wide])
    lower_to(low, x)
    raise_to(high, x)
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
        sigma = smooth_at(Sg, last, j, u)
        for i in range(slots.S.shape[1]):
            rate[i] += slots.S[q, i, j] * sigma


@njit(**INLINE)
def _rate_at_end(model, slots, q, x, f, H, X, Sg, arg, aux, wide, small, rate):
    """Rate of the state where a run stands; one that is rounding of what it was added up from is none."""
    n_s = Sg.shape[1]
    take(X[0], x)
    for j in range(n_s):
        if model.smooth_kind[j] != DELAY_LINE:
            _smooth_term(model, j, 0, X, H, Sg, arg, aux)
    _rates(slots, q, x, f, Sg, 0, 0.0, rate)
    take_sizes(wide, x)
    row_sum(slots.M_size[q], wide, 1.0, small)
    for i in range(slots.S.shape[1]):
        # A run at rest is known by it.
        if n_s == 0 and not abs(rate[i]) > 64.0 * EPS * (abs(f[i]) + small[i]):
            rate[i] = 0.0


@njit(**INLINE)
def _arm(slots, work, q, x, f, constant, wide, xd, speed, g0, g1, tol):
    """Matrices, rates and guards of a linear slot, for the fast steps that follow."""
    if not slots.ready[q]:
        compile_step(slots, work, q)
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
def _write(Y, Ys, x, still, sigma, row):
    """Signals at state x."""
    row_sum_from(still, Y, x, 1.0, row)
    for j in range(sigma.size):
        for i in range(Ys.shape[0]):
            row[i] += Ys[i, j] * sigma[j]


@njit(**HOT)
def _write_rest(slots, q, x, still, sigma, rows, first, stop, out):
    """Signals at state x at the samples first..stop."""
    for k in range(first, stop):
        _write(slots.Y[q], slots.Ys[q], x, still, sigma, out[rows[k]])


@njit(**HOT)
def _sample_series(Y, Ys, X, last, Sg, samples, rows, first, stop, t, d, still, x, out):
    """Signals at the samples first..stop of a series step. (A call with all arrays would be dearer.)"""
    per_unit = 1.0 / d
    for k in range(first, stop):
        u = max(0.0, (samples[k] - t) * per_unit)
        polynomial(X, last, u, x)
        row = out[rows[k]]
        row_sum_from(still, Y, x, 1.0, row)
        for j in range(Sg.shape[1]):
            sigma = smooth_at(Sg, last, j, u)
            for i in range(Ys.shape[0]):
                row[i] += Ys[i, j] * sigma
