"""Compiled: the run of a hybrid system through its modes, exact between events.

Two ways of advancing, one result. Where no smooth channel acts and the state stands on the step grid of its mode, the
*fast step* multiplies by precomputed matrices and proves that no guard is reached (`fast`). Where it can't prove that,
off the grid of the samples, and for smooth channels, the *series step* expands the state to rounding and looks for the
first rise of every guard (`series_step`). See docs/theory/engine.md.
"""

import numpy as np

from eppanalysis.kernels.compiling import njit
from eppanalysis.kernels.engine.delays import segment_reach, start_lines
from eppanalysis.kernels.engine.fast import OFF_GRID, arm, go_far, go_fast, pays, too_large, violated
from eppanalysis.kernels.engine.jumps import clearly_above, let_go, may_leave_behind, place_of
from eppanalysis.kernels.engine.modes import find_combination
from eppanalysis.kernels.engine.periodicity import carry_on, come_back
from eppanalysis.kernels.engine.series import DELAY_LINE
from eppanalysis.kernels.engine.series_step import expand_step, look_ahead, plan, reach, read_lines
from eppanalysis.kernels.engine.signals import enter, rate_at_end, rates, write_rest
from eppanalysis.kernels.engine.switches import jumps_state, record, switch
from eppanalysis.kernels.engine.tables import ENTRY, HOT, INLINE
from eppanalysis.kernels.engine.workspace import DIVERGED, DONE, EVENT_LIMIT, PAUSED, SINGULAR, STEP_LIMIT
from eppanalysis.kernels.simd.vectors import lower_to, polynomial, raise_to, take, take_sizes


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
    # By work, not by the clock: a run pauses, and gives up, at the same step on every machine.
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
            come_back(model, compiled, work, workspace, samples, now)
            continue
        _aim(model, compiled, work, workspace, samples, now)
        # What costs least and proves most comes first; the series step needs no grid and misses nothing
        # (docs/theory/engine.md, Two ways to advance).
        if go_far(compiled, work, workspace, samples, now) or go_fast(compiled, workspace, samples, now):
            continue
        plan(model, compiled, workspace, now)
        if now.code == DONE:
            expand_step(model, compiled, workspace, now)
        if now.code == DONE:
            look_ahead(model, compiled, workspace, samples, now)
            if now.which < 0:
                reach(compiled, workspace, samples, now)
            elif _happen(model, compiled, work, workspace, buffer, now):
                _enter_event(model, workspace, samples, buffer, now)
    _finish(model, compiled, workspace, samples, now)
    return now.code


@njit(**ENTRY)
def lines_before(model, compiled, workspace, q):
    """What is on its way through dead times at the start of the next run: what mode combination q has put out."""
    _lines_before(model, compiled, workspace, q)


@njit(**HOT)
def _lines_before(model, compiled, workspace, q):
    start_lines(
        model, compiled, q, workspace.x, workspace.H, workspace.line_t, workspace.line_h, workspace.line_c,
        workspace.line_n
    )  # fmt: skip


@njit(**HOT)
def _begin(model, compiled, work, workspace, samples, now):
    """Clear what an earlier run left, and stand at the start; False where its modes have no solution."""
    n = model.S.shape[0]
    now.t, now.until, now.count, now.i_sample, now.n_samples = 0.0, now.t_end, 0, 0, samples.phases.size
    now.watched, now.i_breakpoint = now.watch, 0 if now.watch else model.breakpoint_time.size
    now.origin, now.j_grid, now.last_t, now.same_instant, now.quiet, now.untimed = 0.0, 0, 0.0, 0, 0, 0
    now.armed = now.forced = now.entered = now.renewed = now.stepped = now.aside = False
    now.t_behind, now.i_behind, now.spent, now.holds = 0.0, 0, 0.0, np.inf
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
    if not now.past_known:
        _lines_before(model, compiled, workspace, now.q)
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
def _stand(compiled, workspace, now):
    """Constant parts of a mode that is new, and the state's extremes behind a series step; False beyond all bounds."""
    if not now.entered:
        enter(compiled, now.q, workspace.H, workspace.push, workspace.constant, workspace.lift, workspace.still)
        now.entered = True
    if now.stepped:
        now.stepped = False
        lower_to(workspace.low, workspace.x)
        raise_to(workspace.high, workspace.x)
        if too_large(workspace.x):
            now.code = DIVERGED
            return False
    return True


@njit(**HOT)
def _aim(model, compiled, work, workspace, samples, now):
    """Step of the mode, how far the run may go, a guard that is passed already, and what fast steps need."""
    now.h, now.t_stop = compiled.step[now.q], now.until
    if now.i_breakpoint < model.breakpoint_time.size and model.breakpoint_time[now.i_breakpoint] < now.t_stop:
        now.t_stop = model.breakpoint_time[now.i_breakpoint]
    now.which, now.why = -1, OFF_GRID
    if not (now.armed or now.forced) and model.S.shape[1] == 0:
        now.which = violated(compiled, now.q, workspace.x, workspace.recent, workspace.constant, workspace.wide)
        # A guard that a jump has passed fires before any step is made.
        if now.which < 0 and now.i_sample == now.n_samples:
            # All samples are taken, so nothing binds the run to the old grid: a new one starts here.
            now.origin, now.j_grid, now.armed, now.renewed = now.t, 0, pays(compiled, samples, now), False
    if now.armed and not now.renewed:
        arm(compiled, work, now.q, workspace)
        now.renewed = True


@njit(**HOT)
def _meet_inputs(model, compiled, work, workspace, buffer, now):
    """External inputs that jump or bend now; what begins at the start is no jump, for all starts from there."""
    t, x, modes, H = now.t, workspace.x, workspace.modes, workspace.H
    if not (now.i_breakpoint < model.breakpoint_time.size and model.breakpoint_time[now.i_breakpoint] <= t):
        return
    # A jump of an input is a motion without duration: what follows its input and would be carried back lets go before
    # it (docs/theory/simulation.md).
    if t > 0.0 and may_leave_behind(model, modes, modes.size):
        if not now.entered:
            enter(compiled, now.q, H, workspace.push, workspace.constant, workspace.lift, workspace.still)
        rate_at_end(model, compiled, now.q, workspace)
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


@njit(**INLINE)
def _put_inputs(model, i, t, x):
    """Put external inputs where they stand behind all their breakpoints from i on that are due."""
    while i < model.breakpoint_time.size and model.breakpoint_time[i] <= t:
        x[model.breakpoint_state[i]] = model.breakpoint_value[i]
        i += 1


@njit(**HOT)
def _happen(model, compiled, work, workspace, buffer, now):
    """To the event of the guard that rises, and through it; whether there was one.

    There is none where switches pile up at one instant (the next step leaves it, however short) and where the run ends.
    """
    if now.best > 0.0:
        polynomial(workspace.X, now.last, now.best, workspace.x)
        now.t += now.best * now.d
    if now.last >= 0:
        rates(compiled, now.q, workspace.x, workspace.push, workspace.Sg, now.last, now.best, workspace.rate)
    now.armed, now.quiet = False, 0
    # Times closer than the rounding of a step are one instant: only a clock that has moved ends the count.
    if now.t - now.last_t > 1e-13 * now.h:
        now.same_instant = 0
    now.last_t = now.t
    now.same_instant += 1
    # More switches at one instant than there are modes go in a circle (docs/theory/engine.md, Rules at a switch).
    if now.same_instant > 2 * model.mode_first[-1] + 16:
        now.forced = True
        now.forced_leaves += 1
        now.same_instant = 0
        return False
    if now.count >= now.max_events and not now.aside:
        now.code = EVENT_LIMIT
        return False
    now.guard = compiled.guard[now.q, now.which]
    if jumps_state(model, now.guard):
        # The state jumps: its extremes may stand before the event.
        lower_to(workspace.low, workspace.x)
        raise_to(workspace.high, workspace.x)
    _switch_over(model, compiled, work, workspace, buffer, now)
    if now.q < 0:
        now.code = SINGULAR
        return False
    now.entered = False
    if workspace.line_h.shape[1] > 1 and now.t == 0.0 and now.i_breakpoint == 0:
        # No input has jumped at the start, so the given mode was wrong: the history of the delayed outputs starts in
        # the new one.
        _lines_before(model, compiled, workspace, now.q)
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
    # Clearly above zero means passed by a jump that has taken place: what its own jump leaves behind was in the trial
    # of that one.
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
    """Record an event; where the run has closed by it, carry it on."""
    if not now.aside:
        r = now.count % buffer.t.size
        buffer.t[r], buffer.guard[r] = now.t, now.guard
        record(buffer, r, workspace.x, workspace.rate, workspace.H, workspace.modes)
        now.count += 1
    if now.watched and now.i_breakpoint == model.breakpoint_time.size and model.S.shape[1] == 0:
        carry_on(workspace, samples, buffer, now)


@njit(**HOT)
def _finish(model, compiled, workspace, samples, now):
    """Signals at the samples that are left, and the rate of the state, where the run stands."""
    for j in range(model.S.shape[1]):
        if model.smooth_kind[j] == DELAY_LINE:
            segment_reach(model, j, now.t, workspace.line_t, workspace.line_h, workspace.line_n)
    read_lines(model, workspace, now.t, 0.0)
    if now.code != SINGULAR:
        # Before the samples: it takes the smooth channels to where the run stands.
        rate_at_end(model, compiled, now.q, workspace)
    if now.code == DONE:
        first = now.i_sample
        while now.i_sample < now.n_samples and samples.times[now.i_sample] <= now.t * (1.0 + 1e-12):
            now.i_sample += 1
        write_rest(
            compiled, now.q, workspace.x, workspace.still, workspace.Sg[0], samples.rows, first, now.i_sample,
            samples.out
        )  # fmt: skip
