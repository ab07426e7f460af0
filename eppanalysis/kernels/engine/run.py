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

from eppanalysis.kernels.compiling import njit
from eppanalysis.kernels.engine.delays import extend_lines, read_line, segment_reach, start_lines
from eppanalysis.kernels.engine.flow import compile_long, compile_step
from eppanalysis.kernels.engine.jumps import clearly_above, let_go, may_leave_behind, place_of
from eppanalysis.kernels.engine.modes import find_combination
from eppanalysis.kernels.engine.periodicity import closing, repeat_events, sort_into
from eppanalysis.kernels.engine.series import (
    DELAY_LINE,
    EPS,
    _smooth_term,
    expand,
    guard_series,
    may_rise,
    term_sizes,
)
from eppanalysis.kernels.engine.switches import record, rise_from_start, smooth_at, switch
from eppanalysis.kernels.engine.tables import ENTRY, HOT, INLINE, LONG_DOUBLINGS, LONGS
from eppanalysis.kernels.simd.vectors import (
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

DONE, EVENT_LIMIT, DIVERGED, SINGULAR, STALLED, HISTORY, STEP_LIMIT, PAUSED = 0, 1, 2, 3, 4, 5, 6, 7
#: A state beyond this has diverged.
LARGEST = 1e100
#: Why fast steps end.
OFF_GRID, EVENT_AHEAD, LONG_AHEAD = 0, 1, 2
#: Steps without a switch before a long one (of as many) is tried.
LONG_QUIET = 16
#: A step that is so little of its mode's does not move the clock; so many in a row may die out, or grow beyond bounds.
UNTIMED, MOST_UNTIMED = 1e-14, 2500


@njit(**ENTRY)
def run(model, compiled, work, workspace, samples, buffer, now):
    """Run from time 0 to the end; state, modes and memory values of the workspace are changed in place to those at the
    end.

    A run that has closed on a cycle is carried through all whole periods to come: its clock, its events, and its
    signals, whose samples are taken in one turn, in the order of their phases. The rest of the last period is computed.

    Parameters
    ----------
    model : Model
    compiled, work, workspace : Combinations, Work, Workspace
        From `make_workspaces`. Mode combinations that are compiled already (for this model and step) are not compiled
        again. The workspace's x, modes and H hold the start; its rate is filled with that of the state at the end.
    samples : Samples
        Filled with the signals.
    buffer : EventBuffer
        Keeps the last events.
    now : record of PROGRESS
        From `make_progress`: what is asked for, where the run stands, and what it has counted.

    Returns
    -------
    int
        DONE or the reason for stopping early. PAUSED: the same call goes on, to the last bit as if there had been no
        pause; the interpreter has its turn in between.
    """
    if now.paused:
        now.paused = False
    elif not _begin(model, compiled, work, workspace, samples, now):
        return SINGULAR
    stop_at = now.spent + now.slice
    now.code = DONE
    while now.code == DONE:
        if now.spent >= stop_at:
            if now.spent < now.most_steps or now.aside:
                now.paused = True
                return PAUSED
            now.code = STEP_LIMIT
            break
        now.spent += 1.0
        _meet_inputs(model, compiled, work, workspace, buffer, now)
        if now.code != DONE or not _stand(compiled, workspace, now):
            break
        if now.t >= now.until:
            if not now.aside:
                break
            _come_back(model, compiled, work, workspace, samples, now)
            continue
        _aim(model, compiled, work, workspace, samples, now)
        if _go_far(compiled, work, workspace, samples, now) or _go_fast(compiled, workspace, samples, now):
            continue
        _plan(model, compiled, workspace, now)
        if now.code == DONE:
            _expand(model, compiled, workspace, now)
        if now.code == DONE:
            _look_ahead(model, compiled, workspace, samples, now)
            if now.which < 0:
                _reach(compiled, workspace, now)
            elif _happen(model, compiled, work, workspace, buffer, now):
                _enter_event(model, workspace, samples, buffer, now)
    _finish(model, compiled, workspace, samples, now)
    return now.code


@njit(**HOT)
def _begin(model, compiled, work, workspace, samples, now):
    """Clear what an earlier run left, and stand at the start; False where its modes have no solution."""
    n = model.S.shape[0]
    now.t, now.until, now.count, now.i_sample, now.n_samples = 0.0, now.t_end, 0, 0, samples.phases.size
    now.watched, now.i_breakpoint = now.watch, 0 if now.watch else model.breakpoint_time.size
    now.origin, now.j_grid, now.last_t, now.same_instant, now.quiet, now.untimed = 0.0, 0, 0.0, 0, 0, 0
    now.armed = now.forced = now.entered = now.renewed = now.stepped = now.aside = False
    now.t_behind, now.i_behind, now.spent = 0.0, 0, 0.0
    now.fast_steps = now.series_steps = now.refused_series = now.forced_leaves = now.periods_repeated = 0
    workspace.watch[0] = workspace.watch[2] = 0.0
    _forget(workspace, n)
    x = workspace.x
    take_sizes(workspace.largest, x)
    take_sizes(workspace.recent, x)
    take(workspace.low, x)
    take(workspace.high, x)
    now.q = find_combination(model, compiled, work, workspace.modes, now.base_step)
    if now.q < 0:
        return False
    start_lines(
        model, compiled, now.q, x, workspace.H, workspace.line_t, workspace.line_h, workspace.line_c, workspace.line_n
    )
    return True


@njit(**HOT)
def _forget(workspace, n):
    """Clear what an earlier run left, which may not be a number, and which reaches the padding of rows."""
    for rows in (workspace.X, workspace.Y, workspace.Sg, workspace.arg, workspace.aux):
        rows[:, :] = 0.0
    for row in (
        workspace.largest,
        workspace.recent,
        workspace.spread,
        workspace.push,
        workspace.slope,
        workspace.speed,
        workspace.small,
        workspace.wide,
    ):
        row[:] = 0.0
    for row in (
        workspace.constant,
        workspace.lift,
        workspace.g0,
        workspace.g1,
        workspace.tol,
        workspace.stray,
        workspace.top,
    ):
        row[:] = 0.0
    for row in (workspace.p, workspace.end, workspace.rate, workspace.behind_recent, workspace.x[n:]):
        row[:] = 0.0


@njit(**HOT)
def _meet_inputs(model, compiled, work, workspace, buffer, now):
    """External inputs that jump or bend now; what begins at the start is no jump, for all starts from there."""
    t, x, modes, H = now.t, workspace.x, workspace.modes, workspace.H
    if not (now.i_breakpoint < model.breakpoint_time.size and model.breakpoint_time[now.i_breakpoint] <= t):
        return
    if t > 0.0 and may_leave_behind(model, modes, modes.size):
        if not now.entered:
            _enter(compiled, now.q, H, workspace.push, workspace.constant, workspace.lift, workspace.still)
        _rate_at_end(model, compiled, now.q, workspace)
        beyond = workspace.then_x[0]
        take(beyond, x)
        _put_inputs(model, now.i_breakpoint, t, beyond)
        now.q, now.count = let_go(
            model, compiled, work, workspace, buffer, now.q, -1, x, beyond, workspace.recent, H, workspace.Sg, 0, 0.0,
            modes,
            now.base_step, t, workspace.rate, now.count, not now.aside,
        )  # fmt: skip
        if now.q < 0:
            now.code = SINGULAR
            return
    _put_inputs(model, now.i_breakpoint, t, x)
    while now.i_breakpoint < model.breakpoint_time.size and model.breakpoint_time[now.i_breakpoint] <= t:
        H[model.breakpoint_memory[now.i_breakpoint]] = model.breakpoint_slope[now.i_breakpoint]
        now.i_breakpoint += 1
    now.armed = now.entered = False


@njit(**HOT)
def _stand(compiled, workspace, now):
    """Constant parts of a mode that is new, and the state's extremes behind a series step; False beyond all bounds."""
    if not now.entered:
        _enter(compiled, now.q, workspace.H, workspace.push, workspace.constant, workspace.lift, workspace.still)
        now.entered = True
    if now.stepped:
        now.stepped = False
        lower_to(workspace.low, workspace.x)
        raise_to(workspace.high, workspace.x)
        if _too_large(workspace.x):
            now.code = DIVERGED
            return False
    return True


@njit(**HOT)
def _come_back(model, compiled, work, workspace, samples, now):
    """Back from the period that served the samples of all periods to come, to the time behind them."""
    first, stop = now.i_sample, now.n_samples
    _write_rest(compiled, now.q, workspace.x, workspace.still, workspace.Sg[0], samples.rows, first, stop, samples.out)
    _copy_start(
        workspace.behind_x, workspace.behind_modes, workspace.behind_H, workspace.x, workspace.modes, workspace.H
    )
    take(workspace.recent, workspace.behind_recent)
    now.aside, now.t, now.until = False, now.t_behind, now.t_end
    now.i_sample, now.n_samples = now.i_behind, samples.phases.size
    now.origin, now.last_t, now.same_instant, now.quiet = 0.0, now.t, 0, 0
    now.armed = now.entered = False
    now.q = find_combination(model, compiled, work, workspace.modes, now.base_step)


@njit(**HOT)
def _aim(model, compiled, work, workspace, samples, now):
    """Step of the mode, how far the run may go, a guard that is passed already, and what fast steps need."""
    now.h, now.t_stop = compiled.step[now.q], now.until
    if now.i_breakpoint < model.breakpoint_time.size and model.breakpoint_time[now.i_breakpoint] < now.t_stop:
        now.t_stop = model.breakpoint_time[now.i_breakpoint]
    now.which, now.why = -1, OFF_GRID
    if not (now.armed or now.forced) and model.S.shape[1] == 0:
        now.which = _violated(compiled, now.q, workspace.x, workspace.recent, workspace.constant, workspace.wide)
        if now.which < 0 and now.i_sample == now.n_samples:
            # All samples are taken, so nothing binds the run to the old grid: a new one starts here.
            now.origin, now.j_grid, now.armed, now.renewed = now.t, 0, True, False
    if now.armed and not now.renewed:
        _arm(compiled, work, now.q, workspace)
        now.renewed = True


@njit(**HOT)
def _go_far(compiled, work, workspace, samples, now):
    """One long step, where nothing has happened for a while and nothing is to be sampled; whether it was made."""
    if now.quiet < LONG_QUIET or not now.armed:
        return False
    q, h = now.q, now.h
    level = min(now.quiet // 32, LONGS - 1)
    steps = 1 << (LONG_DOUBLINGS * (level + 1))
    t1 = now.origin + (now.j_grid + steps) * h
    if not (t1 <= now.t_stop and (now.i_sample == now.n_samples or samples.times[now.i_sample] >= t1 - _slack(t1, h))):
        return False
    while compiled.longs[q] <= level:
        compile_long(compiled, work, q)
    if _long_step(
        compiled,
        q,
        level,
        workspace.slope,
        workspace.speed,
        workspace.g0,
        workspace.tol,
        workspace.stray,
        workspace.end,
    ):
        _move(
            workspace.x,
            workspace.slope,
            workspace.speed,
            workspace.g0,
            workspace.g1,
            workspace.end,
            workspace.low,
            workspace.high,
        )
        now.j_grid += steps
        now.t = now.origin + now.j_grid * h
        now.quiet += 4
        now.fast_steps += 1
        return True
    now.quiet = 0
    return False


@njit(**HOT)
def _go_fast(compiled, workspace, samples, now):
    """Fast steps, proven free of events from the values at their ends; whether a series step need not follow."""
    if not now.armed:
        return False
    q, before = now.q, now.j_grid
    now.j_grid, now.i_sample, now.why = _fast_steps(
        compiled.T[q], compiled.bound[q], compiled.Y[q], compiled.Ys[q], workspace.x, workspace.slope, workspace.speed,
        workspace.g0, workspace.g1,
        workspace.tol, workspace.stray, workspace.end, workspace.still, workspace.one, workspace.Sg[0], samples.times,
        samples.rows, samples.out,
        now.origin, now.j_grid, now.h, now.t, now.t_stop, now.i_sample, now.n_samples, now.quiet, workspace.low,
        workspace.high,
    )  # fmt: skip
    made = now.j_grid - before
    if made == 0:
        return False
    now.t = now.origin + now.j_grid * now.h
    now.quiet += made
    now.fast_steps += made
    now.spent += made * 0.0625
    if _too_large(workspace.x):
        now.code = DIVERGED
        return True
    return now.why != EVENT_AHEAD


@njit(**HOT)
def _plan(model, compiled, workspace, now):
    """Length of a series step: at most to the next point of the grid, and what counts of it where the past is read."""
    now.quiet = 0
    t, h = now.t, now.h
    if workspace.line_h.shape[1] > 1:
        now.origin = t  # where the past is read, the steps made then are the grid
    now.j_grid = int(np.floor((t - now.origin) / h + 1e-9)) + 1
    now.t1 = now.origin + now.j_grid * h
    if now.t1 - t <= 1e-9 * h:
        # Late in a long run rounding shifts the points of the grid.
        now.j_grid += 1
        now.t1 = now.origin + now.j_grid * h
    now.on_grid = True
    if now.t1 > now.t_stop:
        now.t1, now.on_grid = now.t_stop, False
    take_larger(workspace.largest, workspace.x, workspace.largest)
    d = now.t1 - t
    if now.why == EVENT_AHEAD:
        u = _predicted(compiled, now.q, workspace.g0, workspace.g1, workspace.tol, h, workspace.end)
        if u < 0.9:
            d, now.on_grid = min(d, u * h), False
    if now.forced:
        d, now.on_grid = min(d, 1e-9 * h), False
    now.ahead = d
    for j in range(model.S.shape[1]):
        if model.smooth_kind[j] == DELAY_LINE:
            counts, holds = segment_reach(model, j, t, workspace.line_t, workspace.line_h, workspace.line_n)
            if counts < 0.0:
                now.code = HISTORY
                break
            if counts < now.ahead:
                now.ahead, now.on_grid = counts, False
            d = min(d, holds)
    now.d = d


@njit(**HOT)
def _expand(model, compiled, workspace, now):
    """Series of the state over the step, which is halved until it holds; none where a guard is passed already."""
    now.best, now.last = 0.0 if now.which >= 0 else 2.0, -1
    while now.last < 0 and now.which < 0:
        _read_lines(model, workspace, now.t, now.d)
        now.last = expand(
            model, compiled, now.q, workspace.x, workspace.push, workspace.H, now.d, workspace.largest,
            workspace.small, workspace.X, workspace.Sg, workspace.arg,
            workspace.aux,
        )  # fmt: skip
        if now.last < 0:
            now.d, now.on_grid = 0.5 * now.d, False
            now.ahead = min(now.ahead, now.d)
            now.refused_series += 1
            now.spent += 1.0
            if not now.d > 0.0:
                now.code = STALLED
                return
    now.untimed = now.untimed + 1 if now.last >= 0 and now.d < UNTIMED * now.h else 0
    if now.untimed > MOST_UNTIMED:
        now.code = STALLED
    now.series_steps += now.last >= 0


@njit(**HOT)
def _read_lines(model, workspace, t, d):
    """Series of all delayed outputs over [t, t + d]."""
    for j in range(model.S.shape[1]):
        if model.smooth_kind[j] == DELAY_LINE:
            read_line(
                model, j, t, d, workspace.line_t, workspace.line_h, workspace.line_c, workspace.line_n, workspace.Sg,
                workspace.p
            )  # fmt: skip


@njit(**HOT)
def _look_ahead(model, compiled, workspace, samples, now):
    """The guard that rises first on the series, and the samples and delayed outputs up to there."""
    q, t, d, last, X, Sg, n, n_s = (
        now.q,
        now.t,
        now.d,
        now.last,
        workspace.X,
        workspace.Sg,
        model.S.shape[0],
        model.S.shape[1],
    )
    if last >= 0:
        clock = t / d if workspace.line_h.shape[1] > 1 else 0.0
        now.which, now.best = _first_guard(compiled, q, workspace, last, d, clock, now.forced)
        if now.ahead < d and now.best > now.ahead / d:
            now.which, now.best = -1, 2.0
    now.forced = False
    if last >= 0:
        for i in range(n):
            workspace.recent[i] = abs(X[0, i]) + workspace.spread[i]
    if now.best > 0.0:
        u1 = min(now.best, now.ahead / d)
        # A sample at the end of a step is left to the next one, which may begin behind an input's step.
        first, reached = now.i_sample, t + u1 * d
        if now.which < 0:
            reached -= _slack(reached, u1 * d)
        while now.i_sample < now.n_samples and (
            samples.times[now.i_sample] < reached or samples.times[now.i_sample] <= t
        ):
            now.i_sample += 1
        if now.i_sample > first:
            _sample_series(
                compiled.Y[q], compiled.Ys[q], X, last, Sg, samples.times, samples.rows, first, now.i_sample, t, d,
                workspace.still, workspace.wide, samples.out,
            )  # fmt: skip
        if n_s > 0:
            extend_lines(
                model, compiled, q, X, last, Sg, workspace.H, t, d, u1, workspace.line_t, workspace.line_h,
                workspace.line_c, workspace.line_n,
                workspace.p,
            )  # fmt: skip


@njit(**HOT)
def _reach(compiled, workspace, now):
    """To the end of a series step on which no guard rises."""
    polynomial(workspace.X, now.last, now.ahead / now.d, workspace.x)
    now.t = now.t1 if now.on_grid or now.t1 - now.t == now.ahead else now.t + now.ahead
    now.armed, now.renewed = bool(compiled.linear[now.q]) and now.on_grid, False
    now.stepped = True


@njit(**HOT)
def _happen(model, compiled, work, workspace, buffer, now):
    """To the event of the guard that rises, and through it; whether there was one.

    There is none where switches pile up at one instant (the next step leaves it, however short) and where the run ends.
    """
    if now.best > 0.0:
        polynomial(workspace.X, now.last, now.best, workspace.x)
        now.t += now.best * now.d
    if now.last >= 0:
        _rates(compiled, now.q, workspace.x, workspace.push, workspace.Sg, now.last, now.best, workspace.rate)
    now.armed = False
    if now.t - now.last_t > 1e-13 * now.h:
        now.same_instant = 0
    now.last_t = now.t
    now.same_instant += 1
    if now.same_instant > 2 * model.mode_first[-1] + 16:
        now.forced = True
        now.forced_leaves += 1
        now.same_instant = 0
        return False
    if now.count >= now.max_events and not now.aside:
        now.code = EVENT_LIMIT
        return False
    now.guard = compiled.guard[now.q, now.which]
    _switch_over(model, compiled, work, workspace, buffer, now)
    if now.q < 0:
        now.code = SINGULAR
        return False
    now.entered = False
    if workspace.line_h.shape[1] > 1 and now.t == 0.0 and now.i_breakpoint == 0:
        # No input has jumped at the start, so the given mode was wrong: the history of the delayed outputs starts in
        # the new one.
        start_lines(
            model, compiled, now.q, workspace.x, workspace.H, workspace.line_t, workspace.line_h, workspace.line_c,
            workspace.line_n
        )  # fmt: skip
    now.stepped = True
    return True


@njit(**HOT)
def _switch_over(model, compiled, work, workspace, buffer, now):
    """The next mode of the element whose guard rises, behind all that its jump leaves behind; mode combination -1 for
    none.
    """
    k, x, modes, H, recent, Sg, last, best = (
        now.guard, workspace.x, workspace.modes, workspace.H, workspace.recent, workspace.Sg, now.last, now.best
    )  # fmt: skip
    if may_leave_behind(model, modes, model.guard_element[k]) and not clearly_above(
        compiled, now.q, now.which, x, recent, H, Sg, last, best
    ):
        now.q, now.count = let_go(
            model, compiled, work, workspace, buffer, now.q, k, x, x, recent, H, Sg, last, best, modes, now.base_step,
            now.t,
            workspace.rate, now.count, not now.aside,
        )  # fmt: skip
        if now.q >= 0:
            now.which = place_of(compiled, now.q, k)
    if now.q >= 0:
        now.q = switch(
            model,
            compiled,
            work,
            now.q,
            now.which,
            x,
            recent,
            H,
            Sg,
            last,
            best,
            modes,
            workspace.memory,
            now.base_step,
        )


@njit(**HOT)
def _enter_event(model, workspace, samples, buffer, now):
    """Record an event; where the run has closed by it, carry it through all whole periods to come."""
    if not now.aside:
        r = now.count % buffer.t.size
        buffer.t[r], buffer.guard[r] = now.t, now.guard
        record(buffer, r, workspace.x, workspace.rate, workspace.H, workspace.modes)
        now.count += 1
    if not (now.watched and now.i_breakpoint == model.breakpoint_time.size and model.S.shape[1] == 0):
        return
    take_larger(workspace.largest, workspace.x, workspace.largest)
    p_events = closing(workspace.watch, now.count, buffer, workspace.largest)
    if p_events == 0:
        return
    now.watched = False
    turns, period, n_aside = _carry_on(
        buffer, workspace, samples, now.i_sample, now.t, now.t_end, now.count, p_events, now.max_events
    )
    now.periods_repeated = turns
    if turns == 0:
        return
    now.count += turns * p_events
    now.t_behind, now.i_behind = now.t + turns * period, now.i_sample + n_aside
    if n_aside > 0:
        # Their samples are taken in one more period, in the order of their phases.
        _copy_start(
            workspace.x, workspace.modes, workspace.H, workspace.behind_x, workspace.behind_modes, workspace.behind_H
        )
        take(workspace.behind_recent, workspace.recent)
        now.aside, now.t, now.until = True, 0.0, period
        now.i_sample, now.n_samples = samples.phases.size, samples.phases.size + n_aside
    else:
        now.t, now.i_sample = now.t_behind, now.i_behind
    now.origin, now.last_t, now.same_instant = 0.0, now.t, 0


@njit(**HOT)
def _finish(model, compiled, workspace, samples, now):
    """Signals at the samples that are left, and the rate of the state, where the run stands."""
    for j in range(model.S.shape[1]):
        if model.smooth_kind[j] == DELAY_LINE:
            segment_reach(model, j, now.t, workspace.line_t, workspace.line_h, workspace.line_n)
    _read_lines(model, workspace, now.t, 0.0)
    if now.code == DONE:
        first = now.i_sample
        while now.i_sample < now.n_samples and samples.times[now.i_sample] <= now.t * (1.0 + 1e-12):
            now.i_sample += 1
        _write_rest(
            compiled, now.q, workspace.x, workspace.still, workspace.Sg[0], samples.rows, first, now.i_sample,
            samples.out
        )  # fmt: skip
    if now.code != SINGULAR:
        _rate_at_end(model, compiled, now.q, workspace)


@njit(**INLINE)
def _first_guard(compiled, q, workspace, last, d, clock, forced):
    """The guard that rises first on the series, and where in [0, 1]; -1 and 2.0 when none does."""
    X, Sg, H, p, top, constant = workspace.X, workspace.Sg, workspace.H, workspace.p, workspace.top, workspace.constant
    which, best, sized = -1, 2.0, False
    size_sum(X, last, workspace.spread)
    row_sum_from(workspace.lift, compiled.all_gf[q], X[0], 1.0, top)
    row_sum_from(top, compiled.reach_gf[q], workspace.spread, 1.0, top)
    for g in range(compiled.n_guards[q]):
        if top[g] < 0.0 and (Sg.shape[1] == 0 or not (compiled.on_rate[q, g] or compiled.smooth_guard[q, g])):
            continue
        guard_series(compiled, q, g, X, last, Sg, constant[g], d, p)
        if p[0] < 0.0 and not may_rise(p):
            continue
        if not sized:
            term_sizes(compiled, q, X, Sg, H, d, workspace.recent, clock, 0, 2, workspace.Y, workspace.wide)
            sized = True
        u = rise_from_start(
            compiled, q, g, X, last, Sg, H, d, workspace.recent, clock, workspace.Y, workspace.wide, p, forced
        )  # fmt: skip
        if u < best:
            best, which = u, g
    return which, best


@njit(**INLINE)
def _put_inputs(model, i, t, x):
    """Put external inputs where they stand behind all their breakpoints from i on that are due."""
    while i < model.breakpoint_time.size and model.breakpoint_time[i] <= t:
        x[model.breakpoint_state[i]] = model.breakpoint_value[i]
        i += 1


@njit(**INLINE)
def _slack(t, step):
    """How far from the end of a step, at time t, a sample counts as at its end: the rounding of times.

    It is little of the step, too: smooth motion may be faster than the steps of its mode by any factor.
    """
    return min(16.0 * EPS * t, 1e-9 * step)


@njit(**INLINE)
def _too_large(x):
    """Whether a state is beyond all bounds, or no number."""
    for i in range(x.size):
        if not abs(x[i]) < LARGEST:
            return True
    return False


@njit(**HOT)
def _copy_start(x, modes, H, to_x, to_modes, to_H):
    """State, modes and memory values to another place."""
    take(to_x, x)
    for i in range(modes.size):
        to_modes[i] = modes[i]
    for i in range(H.size):
        to_H[i] = H[i]


@njit(**HOT)
def _carry_on(buffer, workspace, samples, first, t, t_end, count, p, max_events):
    """Enter the events of all whole periods (of p events) to come into the event buffer, and sort their samples by
    phase.

    Returns how many periods, their length, and how many samples from `first` on fall into them.
    """
    keep = buffer.t.size
    period = 0.5 * (buffer.t[(count - 1) % keep] - buffer.t[(count - 1 - 2 * p) % keep])
    turns = 0
    # Switches that pile up at one instant have no period.
    if period > 1e-12 * t:
        turns = max(0, min(int((t_end - t) / period), (max_events - count) // p))
    if turns == 0:
        return 0, period, 0
    repeat_events(turns, p, period, count, workspace.once, buffer)
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
    wide, half, slack = x.size, g0.size, _slack(t_stop, h)
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
def _long_step(compiled, q, level, xd, speed, g0, tol, stray, end):
    """Increments over a long step into `end`; False when an event inside cannot be excluded."""
    row_sum_from(tol, compiled.reach[q, level], speed, 1.0, stray)
    for g in range(compiled.n_guards[q]):
        if not g0[g] + stray[g] < 0.0:
            return False
    row_sum(compiled.T_long[q, level], xd, 1.0, end)
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
def _predicted(compiled, q, g0, g1, tol, h, end):
    """Fraction of the step that surely holds the first event, by the guards' cubics: how far the series need reach.

    Guards that stand at zero are left to the rules of the series.
    """
    first, half = 1.0, g0.size
    place = end.size - 2 * half
    for g in range(compiled.n_guards[q]):
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
def _violated(compiled, q, x, recent, constant, wide):
    """A guard that stands clearly above zero already, without any series; -1 when there is none."""
    take_larger(wide, x, recent)
    for g in range(compiled.n_guards[q]):
        v = constant[g] + dot(compiled.ga[q, g], x)
        if v > 0.0 and not compiled.on_rate[q, g] and v > 1e-9 * (abs(constant[g]) + dot(compiled.ga_size[q, g], wide)):
            return g
    return -1


@njit(**INLINE)
def _enter(compiled, q, H, f, constant, lift, still):
    """Constant parts of the rate, the guards (on state and rate; on the state alone), the signals, until an event."""
    for i in range(compiled.N.shape[1]):
        v = 0.0
        for j in range(H.size):
            v += compiled.N[q, i, j] * H[j]
        f[i] = v
    for g in range(compiled.n_guards[q]):
        v = 0.0
        for j in range(H.size):
            v += compiled.gH[q, g, j] * H[j]
        constant[g] = lift[g] = v
        if compiled.on_rate[q, g]:
            v = 0.0
            for j in range(H.size):
                v += compiled.gfH[q, g, j] * H[j]
            lift[g] = v
    for i in range(compiled.YH.shape[1]):
        v = 0.0
        for j in range(H.size):
            v += compiled.YH[q, i, j] * H[j]
        still[i] = v


@njit(**INLINE)
def _rates(compiled, q, x, f, Sg, last, u, rate):
    """Rate of the state x at place u of a series step."""
    row_sum_from(f, compiled.M[q], x, 1.0, rate)
    for j in range(Sg.shape[1]):
        sigma = smooth_at(Sg, last, j, u)
        for i in range(compiled.S.shape[1]):
            rate[i] += compiled.S[q, i, j] * sigma


@njit(**HOT)
def _rate_at_end(model, compiled, q, workspace):
    """Rate of the state where a run stands; one that is rounding of what it was added up from is none."""
    rate, Sg, f, small = workspace.rate, workspace.Sg, workspace.push, workspace.small
    n_s = Sg.shape[1]
    take(workspace.X[0], workspace.x)
    for j in range(n_s):
        if model.smooth_kind[j] != DELAY_LINE:
            _smooth_term(model, j, 0, workspace.X, workspace.H, Sg, workspace.arg, workspace.aux)
    _rates(compiled, q, workspace.x, f, Sg, 0, 0.0, rate)
    take_sizes(workspace.wide, workspace.x)
    row_sum(compiled.M_size[q], workspace.wide, 1.0, small)
    for i in range(compiled.S.shape[1]):
        # The verdict recognises a run at rest by rates that are exactly zero.
        if n_s == 0 and not abs(rate[i]) > 64.0 * EPS * (abs(f[i]) + small[i]):
            rate[i] = 0.0


@njit(**INLINE)
def _arm(compiled, work, q, workspace):
    """Matrices, rates and guards of a linear mode combination, for the fast steps that follow."""
    if not compiled.ready[q]:
        compile_step(compiled, work, q)
    x, xd, wide, speed, constant, g0 = (
        workspace.x,
        workspace.slope,
        workspace.wide,
        workspace.speed,
        workspace.constant,
        workspace.g0,
    )
    take_sizes(wide, x)
    row_sum_from(workspace.push, compiled.M[q], x, 1.0, xd)
    take_sizes(speed, xd)
    G = compiled.n_guards[q]
    for g in range(G):
        v, size = constant[g] + dot(compiled.ga[q, g], x), abs(constant[g]) + dot(compiled.ga_size[q, g], wide)
        if compiled.on_rate[q, g]:
            v += dot(compiled.gb[q, g], xd)
            size += dot(compiled.gb_size[q, g], speed)
        g0[g], workspace.g1[g], workspace.tol[g] = v, dot(compiled.gf[q, g], xd), 256.0 * EPS * size
    for g in range(G, g0.size):
        g0[g], workspace.g1[g], workspace.tol[g] = -1.0, 0.0, 0.0


@njit(**INLINE)
def _write(Y, Ys, x, still, sigma, row):
    """Signals at state x."""
    row_sum_from(still, Y, x, 1.0, row)
    for j in range(sigma.size):
        for i in range(Ys.shape[0]):
            row[i] += Ys[i, j] * sigma[j]


@njit(**HOT)
def _write_rest(compiled, q, x, still, sigma, rows, first, stop, out):
    """Signals at state x at the samples first..stop."""
    for k in range(first, stop):
        _write(compiled.Y[q], compiled.Ys[q], x, still, sigma, out[rows[k]])


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
