#include "engine/series_step.hpp"

namespace epp {
inline namespace EPP_ARCH {

/// Length of a series step: at most to the next point of the grid, and what counts of it where the past is read.
void plan(const Model& model, const Combinations& compiled, const Workspace& workspace, Progress& now) {
    double u{}, counts{}, holds{};
    double t = now.t;
    double h = now.h;
    double far = compiled.far(now.q);
    now.quiet = (far > 0.0) ? now.quiet + i64(far / h) : 0;
    if (workspace.line_h.shape(1) > 1) {
        // where the past is read, the steps made then are the grid
        now.origin = t;
    }
    now.j_grid = i64(std::floor((t - now.origin) / h + 1e-09)) + 1;
    now.t1 = now.origin + now.j_grid * h;
    // Late in a long run rounding shifts the points of the grid.
    if ((now.t1 - t) <= (1e-09 * h)) {
        now.j_grid += 1;
        now.t1 = now.origin + now.j_grid * h;
    }
    if ((t + far) > now.t1) {
        now.j_grid = i64(std::floor((t + far - now.origin) / h + 1e-09));
        now.t1 = now.origin + now.j_grid * h;
    }
    now.on_grid = true;
    if (now.t1 > now.t_stop) {
        now.t1 = now.t_stop;
        now.on_grid = false;
    }
    take_larger(workspace.largest, workspace.x, workspace.largest);
    double d = now.t1 - t;
    if (d > now.holds) {
        d = now.holds;
        now.on_grid = false;
    }
    // The cubics of the fast step that failed tell how far its event is: a series over less of the step has fewer terms.
    if (now.why == EVENT_AHEAD) {
        u = predicted(compiled, now.q, workspace.g0, workspace.g1, workspace.tol, h, workspace.end);
        if (u < 0.9) {
            d = least_of(d, u * h);
            now.on_grid = false;
        }
    }
    // Two guards that point at each other at one instant: a billionth of a step in the present mode, then they are
    // judged anew (docs/theory/engine.md, Rules at a switch).
    if (now.forced) {
        d = least_of(d, 1e-09 * h);
        now.on_grid = false;
    }
    now.ahead = d;
    for (i64 j = 0, j_end = model.S.shape(1); j < j_end; ++j) {
        // The step is expanded as far as the series of the past holds, but counts only to the end of its segment:
        // behind it the past may have had a switch.
        if (model.smooth_kind(j) == DELAY_LINE) {
            std::tie(counts, holds) = segment_reach(model, j, t, workspace.line_t, workspace.line_h, workspace.line_n);
            if (counts < 0.0) {
                now.code = HISTORY;
                break;
            }
            if (counts < now.ahead) {
                now.ahead = counts;
                now.on_grid = false;
            }
            d = least_of(d, holds);
        }
    }
    now.d = d;
}

/// Series of all delayed outputs over [t, t + d].
void read_lines(const Model& model, const Workspace& workspace, double t, double d) {
    for (i64 j = 0, j_end = model.S.shape(1); j < j_end; ++j) {
        if (model.smooth_kind(j) == DELAY_LINE) {
            read_line(model, j, t, d, workspace.line_t, workspace.line_h, workspace.line_c, workspace.line_n,
                workspace.Sg, workspace.p);
        }
    }
}

/// Give a trace of their sizes to be to states that have none yet; whether there were such. In large loops alone.
///
/// What moves reaches a state that lies many others behind with as high an order of its series, whatever the step, and
/// as next to nothing. Its size is what comes along in one turn at each of the others.
bool _give_sizes(const Combinations& compiled, i64 q, const Workspace& workspace) {
    bool grown{};
    if (compiled.row_end.shape(1) == 0 || compiled.spread_rate(q) == 0.0) {
        return false;
    }
    Vector sizes = workspace.wide;
    Vector further = workspace.spread;
    double per_turn = 1.0 / compiled.spread_rate(q);
    take_sizes(sizes, workspace.x);
    for (i64 i = 0, i_end = compiled.N.shape(1); i < i_end; ++i) {
        sizes(i) = greatest_of(sizes(i), per_turn * std::fabs(workspace.push(i)));
    }
    for (i64 turn_ = 0, turn__end = compiled.N.shape(1); turn_ < turn__end; ++turn_) {
        size_of_rate(compiled, q, sizes, per_turn, further);
        raise_to(further, sizes);
        grown = any_above(further, 0.5, sizes);
        take(sizes, further);
        if (!grown) {
            break;
        }
    }
    bool given = false;
    for (i64 i = 0, i_end = compiled.N.shape(1); i < i_end; ++i) {
        if ((TRACE * sizes(i)) > workspace.largest(i)) {
            workspace.largest(i) = TRACE * sizes(i);
            given = true;
        }
    }
    return given;
}

/// Series of the state over the step, which is halved until it holds; none where a guard is passed already.
void expand_step(const Model& model, const Combinations& compiled, const Workspace& workspace, Progress& now) {
    now.best = (now.which >= 0) ? 0.0 : 2.0;
    now.last = -1;
    while (now.last < 0 && now.which < 0) {
        read_lines(model, workspace, now.t, now.d);
        // How far the series of smooth channels converges is known by how far the one before did, or the step is halved.
        now.last = expand(model, compiled, now.q, workspace.x, workspace.push, workspace.H, now.d, workspace.largest,
            workspace.small, workspace.X, workspace.Sg, workspace.arg, workspace.aux);
        if (now.last < 0 && !_give_sizes(compiled, now.q, workspace)) {
            now.d = 0.5 * now.d;
            now.on_grid = false;
            // without, the next mode tells its own step
            if (model.S.shape(1) > 0) {
                now.holds = now.d;
            }
            now.ahead = least_of(now.ahead, now.d);
            now.refused_series += 1;
            now.spent += 1.0;
            if (!(now.d > 0.0)) {
                now.code = STALLED;
                return;
            }
        }
    }
    if ((0 <= now.last && now.last <= GROWS) && now.d >= now.holds) {
        now.holds = 2.0 * now.d;
    }
    now.untimed = (now.last >= 0 && now.d < (UNTIMED * now.h)) ? now.untimed + 1 : 0;
    if (now.untimed > MOST_UNTIMED) {
        now.code = STALLED;
    }
    now.series_steps += now.last >= 0;
}

/// The guard that rises first on the series, and the samples and delayed outputs up to there.
void look_ahead(const Model& model, const Combinations& compiled, const Workspace& workspace, const Samples& samples,
    Progress& now) {
    i64 first{};
    double clock{}, u1{}, reached{};
    i64 q = now.q;
    double t = now.t;
    double d = now.d;
    i64 last = now.last;
    Matrix X = workspace.X;
    Matrix Sg = workspace.Sg;
    i64 n = model.S.shape(0);
    i64 n_s = model.S.shape(1);
    if (last >= 0) {
        clock = (workspace.line_h.shape(1) > 1) ? t / d : 0.0;
        std::tie(now.which, now.best, now.stays) = _first_guard(model, compiled, q, workspace, last, d, clock, now.forced,
            t == now.last_t);
        // An event beyond what counts is foretold by a past that may not be so: it is looked for again from there.
        if (now.ahead < d && now.best > (now.ahead / d)) {
            now.which = -1;
            now.best = 2.0;
        }
    }
    now.forced = false;
    // Where a guard fires at once the state is not computed anew: judged by smaller sizes than its own the next guard
    // would take what is left of the rounding for a rise, and the two would fire in turn.
    if (last >= 0 && now.best > 0.0) {
        for (i64 i = 0; i < n; ++i) {
            workspace.recent(i) = std::fabs(X(0, i)) + workspace.spread(i);
        }
    }
    if (now.best > 0.0) {
        u1 = least_of(now.best, now.ahead / d);
        // A sample at the end of a step is left to the next one, which may begin behind an input's step.
        first = now.i_sample;
        reached = t + u1 * d;
        if (now.which < 0) {
            reached -= slack_at(reached, u1 * d);
        }
        while (now.i_sample < now.n_samples && (samples.times(now.i_sample) < reached ||
            samples.times(now.i_sample) <= t)) {
            now.i_sample += 1;
        }
        if (compiled.far(q) > 0.0 && compiled.y_row_end(q, compiled.y_row_end.shape(1) - 1) < ((now.i_sample - first) *
            compiled.row_end.shape(1))) {
            sample_signals(compiled, q, workspace, last, samples, first, now.i_sample, t, d);
        } else if (now.i_sample > first) {
            sample_series(compiled.Y.row(q), compiled.Ys.row(q), X, last, Sg, samples.times, samples.rows, first,
                now.i_sample, t, d, workspace.still, workspace.wide, samples.out);
        }
        if (n_s > 0) {
            extend_lines(model, compiled, q, X, last, Sg, workspace.H, t, d, u1, workspace.line_t, workspace.line_h,
                workspace.line_c, workspace.line_n, workspace.p);
        }
    }
}

/// To the end of a series step on which no guard rises.
void reach(const Combinations& compiled, const Workspace& workspace, const Samples& samples, Progress& now) {
    polynomial(workspace.X, now.last, now.ahead / now.d, workspace.x);
    now.t = (now.on_grid || (now.t1 - now.t) == now.ahead) ? now.t1 : now.t + now.ahead;
    now.armed = compiled.linear(now.q) != 0 && now.on_grid && pays(compiled, samples, now);
    now.renewed = false;
    now.stepped = true;
}

}  // namespace EPP_ARCH
}  // namespace epp
