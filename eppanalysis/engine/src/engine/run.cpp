#include "engine/run.hpp"

namespace epp {
inline namespace EPP_ARCH {

/// Clear what an earlier run left, which may not be a number, and which reaches the padding of rows.
void _forget(const Workspace& workspace, i64 n) {
    for (Matrix rows : {workspace.X, workspace.Y, workspace.Sg, workspace.arg, workspace.aux}) {
        rows.fill(0.0);
    }
    for (Vector row : {workspace.largest, workspace.recent, workspace.spread, workspace.push, workspace.slope,
        workspace.speed, workspace.small, workspace.wide}) {
        row.fill(0.0);
    }
    for (Vector row : {workspace.constant, workspace.lift, workspace.g0, workspace.g1, workspace.tol, workspace.stray,
        workspace.top}) {
        row.fill(0.0);
    }
    for (Vector row : {workspace.p, workspace.end, workspace.rate, workspace.behind_recent, workspace.x.slice(n,
        workspace.x.shape(0))}) {
        row.fill(0.0);
    }
}

void _lines_before(const Model& model, const Combinations& compiled, const Workspace& workspace, i64 q) {
    start_lines(model, compiled, q, workspace.x, workspace.H, workspace.line_t, workspace.line_h, workspace.line_c,
        workspace.line_n);
}

/// Clear what an earlier run left, and begin at the start; False where its modes have no solution.
bool _begin(const Model& model, const Combinations& compiled, const Work& work, const Workspace& workspace,
    const Samples& samples, Progress& now) {
    i64 n = model.S.shape(0);
    now.t = 0.0;
    now.until = now.t_end;
    now.count = 0;
    now.i_sample = 0;
    now.n_samples = samples.phases.size();
    now.watched = now.watch;
    now.i_breakpoint = now.watch ? 0 : model.breakpoint_time.size();
    now.origin = 0.0;
    now.j_grid = 0;
    now.last_t = 0.0;
    now.same_instant = 0;
    now.quiet = 0;
    now.untimed = 0;
    const bool was1 = false;
    now.armed = was1;
    now.forced = was1;
    now.entered = was1;
    now.renewed = was1;
    now.stepped = was1;
    now.aside = was1;
    now.t_behind = 0.0;
    now.i_behind = 0;
    now.spent = 0.0;
    now.holds = INF;
    const i64 was2 = 0;
    now.fast_steps = was2;
    now.series_steps = was2;
    now.refused_series = was2;
    now.forced_leaves = was2;
    now.periods_repeated = was2;
    const double was3 = 0.0;
    workspace.watch(0) = was3;
    workspace.watch(2) = was3;
    _forget(workspace, n);
    Vector x = workspace.x;
    take_sizes(workspace.largest, x);
    take_sizes(workspace.recent, x);
    take(workspace.low, x);
    take(workspace.high, x);
    now.q = find_combination(model, compiled, work, workspace.modes, now.base_step);
    if (now.q < 0) {
        return false;
    }
    if (!now.past_known) {
        _lines_before(model, compiled, workspace, now.q);
    }
    return true;
}

/// External inputs that jump or bend now; what begins at the start is no jump, for all starts from there.
void _meet_inputs(const Model& model, const Combinations& compiled, const Work& work, const Workspace& workspace,
    const EventBuffer& buffer, Progress& now) {
    Vector beyond{};
    double t = now.t;
    Vector x = workspace.x;
    Indices modes = workspace.modes;
    Vector H = workspace.H;
    if (!(now.i_breakpoint < model.breakpoint_time.size() && model.breakpoint_time(now.i_breakpoint) <= t)) {
        return;
    }
    // A jump of an input is a motion without duration: what follows its input and would be carried back lets go before
    // it (docs/theory/simulation.md).
    if (t > 0.0 && may_leave_behind(model, modes, modes.size())) {
        if (!now.entered) {
            enter(compiled, now.q, H, workspace.push, workspace.constant, workspace.lift, workspace.still);
        }
        rate_at_end(model, compiled, now.q, workspace);
        beyond = workspace.then_x.row(0);
        take(beyond, x);
        _put_inputs(model, now.i_breakpoint, t, beyond);
        std::tie(now.q, now.count) = let_go(model, compiled, work, workspace, buffer, now.q, -1, false, x, beyond,
            workspace.recent, H, workspace.Sg, 0, 0.0, modes, now.base_step, t, workspace.rate, now.count, !now.aside);
        if (now.q < 0) {
            now.code = SINGULAR;
            return;
        }
    }
    _put_inputs(model, now.i_breakpoint, t, x);
    while (now.i_breakpoint < model.breakpoint_time.size() && model.breakpoint_time(now.i_breakpoint) <= t) {
        H(model.breakpoint_memory(now.i_breakpoint)) = model.breakpoint_slope(now.i_breakpoint);
        now.i_breakpoint += 1;
    }
    const bool was1 = false;
    now.armed = was1;
    now.entered = was1;
    // A jump of inputs is an event as any other.
    now.last_t = t;
    now.same_instant = 0;
}

/// Constant parts of a mode that is new, and the state's extremes behind a series step; False beyond all bounds.
bool _stand(const Combinations& compiled, const Workspace& workspace, Progress& now) {
    if (!now.entered) {
        enter(compiled, now.q, workspace.H, workspace.push, workspace.constant, workspace.lift, workspace.still);
        now.entered = true;
    }
    if (now.stepped) {
        now.stepped = false;
        lower_to(workspace.low, workspace.x);
        raise_to(workspace.high, workspace.x);
        if (too_large(workspace.x)) {
            now.code = DIVERGED;
            return false;
        }
    }
    return true;
}

/// Step of the mode, how far the run may go, a guard that is passed already, and what fast steps need.
void _aim(const Model& model, const Combinations& compiled, const Work& work, const Workspace& workspace,
    const Samples& samples, Progress& now) {
    now.h = compiled.step(now.q);
    now.t_stop = now.until;
    if (now.i_breakpoint < model.breakpoint_time.size() && model.breakpoint_time(now.i_breakpoint) < now.t_stop) {
        now.t_stop = model.breakpoint_time(now.i_breakpoint);
    }
    now.which = -1;
    now.stays = false;
    now.why = OFF_GRID;
    if (!(now.armed || now.forced) && model.S.shape(1) == 0) {
        now.which = passed(compiled, now.q, workspace);
        // A guard that a jump has passed fires before any step is made.
        // All samples are taken, so nothing binds the run to the old grid: a new one starts here.
        if (now.which < 0 && now.i_sample == now.n_samples) {
            {
                const double was1 = now.t;
                const i64 was2 = 0;
                const bool was3 = pays(compiled, samples, now);
                const bool was4 = false;
                now.origin = was1;
                now.j_grid = was2;
                now.armed = was3;
                now.renewed = was4;
            }
        }
    }
    if (now.armed && !now.renewed) {
        arm(compiled, work, now.q, workspace);
        now.renewed = true;
    }
}

/// The next mode of the element whose guard rises, behind all that its jump leaves behind; mode combination -1 for
/// none.
void _switch_over(const Model& model, const Combinations& compiled, const Work& work, const Workspace& workspace,
    const EventBuffer& buffer, Progress& now) {
    i64 k = now.guard;
    Vector x = workspace.x;
    Indices modes = workspace.modes;
    Vector H = workspace.H;
    Vector recent = workspace.recent;
    Matrix Sg = workspace.Sg;
    i64 last = now.last;
    double best = now.best;
    // Clearly above zero means passed by a jump that has taken place: what its own jump leaves behind was in the trial
    // of that one.
    if (may_leave_behind(model, modes, model.guard_element(k)) && !clearly_above(compiled, now.q, now.which, x, recent,
        H, Sg, last, best)) {
        std::tie(now.q, now.count) = let_go(model, compiled, work, workspace, buffer, now.q, k, now.stays, x, x, recent, H,
            Sg, last, best, modes, now.base_step, now.t, workspace.rate, now.count, !now.aside);
        if (now.q >= 0) {
            now.which = place_of(compiled, now.q, k);
        }
    }
    if (now.q >= 0) {
        now.q = switch_(model, compiled, work, now.q, now.which, now.stays, x, recent, H, Sg, last, best, modes,
            workspace.memory, now.base_step);
    }
}

/// To the event of the guard that rises, and through it; whether there was one.
///
/// There is none where switches pile up at one instant (the next step leaves it, however short) and where the run ends.
bool _happen(const Model& model, const Combinations& compiled, const Work& work, const Workspace& workspace,
    const EventBuffer& buffer, Progress& now) {
    if (now.best > 0.0) {
        polynomial(workspace.X, now.last, now.best, workspace.x);
        now.t += now.best * now.d;
    }
    if (now.last >= 0) {
        rates(compiled, now.q, workspace.x, workspace.push, workspace.Sg, now.last, now.best, workspace.rate);
    }
    now.armed = false;
    now.quiet = 0;
    // Times closer than the rounding of a step are one instant: only a clock that has moved ends the count.
    if ((now.t - now.last_t) > (1e-13 * now.h)) {
        now.same_instant = 0;
    }
    now.last_t = now.t;
    now.same_instant += 1;
    // More switches at one instant than there are modes go in a circle (docs/theory/engine.md, Rules at a switch).
    if (now.same_instant > (2 * model.mode_first(model.mode_first.shape(0) - 1) + 16)) {
        now.forced = true;
        now.forced_leaves += 1;
        now.same_instant = 0;
        return false;
    }
    if (now.count >= now.max_events && !now.aside) {
        now.code = EVENT_LIMIT;
        return false;
    }
    now.guard = compiled.guard(now.q, now.which);
    // The state jumps: its extremes may be before the event.
    if (jumps_state(model, now.guard)) {
        lower_to(workspace.low, workspace.x);
        raise_to(workspace.high, workspace.x);
    }
    _switch_over(model, compiled, work, workspace, buffer, now);
    if (now.q < 0) {
        now.code = SINGULAR;
        return false;
    }
    now.entered = false;
    // No input has jumped at the start, so the given mode was wrong: the history of the delayed outputs starts in
    // the new one.
    if (workspace.line_h.shape(1) > 1 && now.t == 0.0 && now.i_breakpoint == 0) {
        _lines_before(model, compiled, workspace, now.q);
    }
    now.stepped = true;
    return true;
}

/// Record an event; where the run has closed by it, carry it on.
void _enter_event(const Model& model, const Workspace& workspace, const Samples& samples, const EventBuffer& buffer,
    Progress& now) {
    i64 r{};
    if (!now.aside) {
        r = modulo(now.count, buffer.t.size());
        buffer.t(r) = now.t;
        buffer.guard(r) = now.guard;
        record(buffer, r, workspace.x, workspace.rate, workspace.H, workspace.modes);
        now.count += 1;
    }
    if (now.watched && now.i_breakpoint == model.breakpoint_time.size() && model.S.shape(1) == 0) {
        carry_on(workspace, samples, buffer, now);
    }
}

/// Signals at the samples that are left, and the rate of the state, at the state of the run.
void _finish(const Model& model, const Combinations& compiled, const Workspace& workspace, const Samples& samples,
    Progress& now) {
    i64 first{};
    for (i64 j = 0, j_end = model.S.shape(1); j < j_end; ++j) {
        if (model.smooth_kind(j) == DELAY_LINE) {
            segment_reach(model, j, now.t, workspace.line_t, workspace.line_h, workspace.line_n);
        }
    }
    read_lines(model, workspace, now.t, 0.0);
    // Before the samples: it takes the smooth channels to the time of the run.
    if (now.code != SINGULAR) {
        rate_at_end(model, compiled, now.q, workspace);
    }
    if (now.code == DONE) {
        first = now.i_sample;
        while (now.i_sample < now.n_samples && samples.times(now.i_sample) <= (now.t * (1.0 + 1e-12))) {
            now.i_sample += 1;
        }
        write_rest(compiled, now.q, workspace.x, workspace.still, workspace.Sg.row(0), samples.rows, first,
            now.i_sample, samples.out);
    }
}

/// Run from time 0 to the end; state, modes and memory values of the workspace are changed in place to those at the
/// end.
///
/// A run that has closed on a cycle is carried through all whole periods to come: its clock, its events, and its
/// signals, whose samples are taken in one turn, in the order of their phases. The rest of the last period is computed.
///
/// Parameters
/// ----------
/// model : Model
/// compiled, work, workspace : Combinations, Work, Workspace
///     From `make_workspaces`. Mode combinations that are compiled already (for this model and step) are not compiled
///     again. The workspace's x, modes and H hold the start; its rate is filled with that of the state at the end.
/// samples : Samples
///     Filled with the signals.
/// buffer : EventBuffer
///     Keeps the last events.
/// now : record of PROGRESS
///     From `make_progress`: the request, the state of the run, and what it has counted.
///
/// Returns
/// -------
/// int
///     DONE or the reason for stopping early. PAUSED: the same call goes on, to the last bit as if there had been no
///     pause; the interpreter has its turn in between.
i64 run(const Model& model, const Combinations& compiled, const Work& work, const Workspace& workspace,
    const Samples& samples, const EventBuffer& buffer, Progress& now) {
    if (now.paused) {
        now.paused = false;
    } else if (!_begin(model, compiled, work, workspace, samples, now)) {
        return SINGULAR;
    }
    // By work, not by the clock: a run pauses, and gives up, at the same step on every machine.
    double stop_at = now.spent + now.slice;
    now.code = DONE;
    while (now.code == DONE) {
        if (now.spent >= stop_at) {
            if (now.spent < now.most_steps || now.aside) {
                now.paused = true;
                return PAUSED;
            }
            now.code = STEP_LIMIT;
            break;
        }
        now.spent += 1.0;
        _meet_inputs(model, compiled, work, workspace, buffer, now);
        if (now.code != DONE || !_stand(compiled, workspace, now)) {
            break;
        }
        if (now.t >= now.until) {
            if (!now.aside) {
                break;
            }
            come_back(model, compiled, work, workspace, samples, now);
            continue;
        }
        _aim(model, compiled, work, workspace, samples, now);
        // What costs least and proves most comes first; the series step needs no grid and misses nothing
        // (docs/theory/engine.md, Two ways to advance).
        if (go_far(compiled, work, workspace, samples, now) || go_fast(compiled, workspace, samples, now)) {
            continue;
        }
        plan(model, compiled, workspace, now);
        if (now.code == DONE) {
            expand_step(model, compiled, workspace, now);
        }
        if (now.code == DONE) {
            look_ahead(model, compiled, workspace, samples, now);
            if (now.which < 0) {
                reach(compiled, workspace, samples, now);
            } else if (_happen(model, compiled, work, workspace, buffer, now)) {
                _enter_event(model, workspace, samples, buffer, now);
            }
        }
    }
    _finish(model, compiled, workspace, samples, now);
    return now.code;
}

/// To the start of a run at which inputs step: delayed outputs on their way are those before the step.
///
/// A run of an instant with the inputs where they were settles the modes of what has no memory. The run that follows
/// begins at x0, H0 and, but for these, modes0; its record says that the past is known.
void step_at_start(const Model& model, const Combinations& compiled, const Work& work, const Workspace& workspace,
    const Samples& none, const EventBuffer& buffer, const Progress& now, Vector x0, Indices modes0, Vector H0,
    Flags without_memory) {
    Progress before = now;
    before.t_end = INSTANT * now.base_step;
    before.most_steps = INF;
    before.watch = before.past_known = before.paused = false;
    Vector x = workspace.x.slice(0, x0.size());
    x.copy(x0);
    workspace.modes.copy(modes0);
    workspace.H.copy(H0);
    run(model, compiled, work, workspace, none, buffer, before);
    x.copy(x0);
    if (before.q >= 0) {
        _lines_before(model, compiled, workspace, before.q);
    }
    workspace.H.copy(H0);
    for (i64 e = 0; e < modes0.size(); ++e) {
        if (!without_memory(e)) {
            workspace.modes(e) = modes0(e);
        }
    }
}

}  // namespace EPP_ARCH
}  // namespace epp
