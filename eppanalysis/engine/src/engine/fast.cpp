#include "engine/fast.hpp"

namespace epp {
inline namespace EPP_ARCH {

/// One long step, where nothing has happened for a while and nothing is to be sampled; whether it was made.
bool go_far(const Combinations& compiled, const Work& work, const Workspace& workspace, const Samples& samples,
    Progress& now) {
    i64 steps{};
    double t1{};
    if (now.quiet < LONG_QUIET || !now.armed) {
        return false;
    }
    i64 q = now.q;
    double h = now.h;
    // The longer nothing has happened, the longer the step that is tried: 16 steps of the grid, then 256, and so on; the
    // longest that ends before the next sample.
    i64 level = least_of<i64>(floor_div(now.quiet, 32), LONGS - 1);
    bool all_taken = now.i_sample == now.n_samples;
    while (true) {
        steps = 1 << LONG_DOUBLINGS * (level + 1);
        t1 = now.origin + (now.j_grid + steps) * h;
        if (t1 <= now.t_stop && (all_taken || samples.times(now.i_sample) >= (t1 - slack_at(t1, h)))) {
            break;
        }
        level -= 1;
        if (level < 0) {
            return false;
        }
    }
    while (compiled.longs(q) <= level) {
        compile_long(compiled, work, q);
    }
    if (_long_step(compiled, q, level, workspace.slope, workspace.speed, workspace.g0, workspace.tol, workspace.stray,
        workspace.end)) {
        _move(workspace.x, workspace.slope, workspace.speed, workspace.g0, workspace.g1, workspace.end, workspace.low,
            workspace.high);
        now.j_grid += steps;
        now.t = now.origin + now.j_grid * h;
        // A few of them in a row, and the next longer one is tried.
        now.quiet += 4;
        now.fast_steps += 1;
        return true;
    }
    // A bound that does not exclude an event says nothing of where: shorter steps take over until it is quiet again.
    now.quiet = greatest_of<i64>(32 * (level - 1), 0);
    return false;
}

/// Fast steps, proven free of events from the values at their ends; whether a series step need not follow.
bool go_fast(const Combinations& compiled, const Workspace& workspace, const Samples& samples, Progress& now) {
    if (!now.armed || compiled.far(now.q) > 0.0) {
        return false;
    }
    i64 q = now.q;
    i64 before = now.j_grid;
    std::tie(now.j_grid, now.i_sample, now.why) = _fast_steps(compiled.T.row(q), compiled.bound.row(q),
        compiled.Y.row(q), compiled.Ys.row(q), workspace.x, workspace.slope, workspace.speed, workspace.g0,
        workspace.g1, workspace.tol, workspace.stray, workspace.end, workspace.still, workspace.one,
        workspace.Sg.row(0), samples.times, samples.rows, samples.out, now.origin, now.j_grid, now.h, now.t,
        now.t_stop, now.i_sample, now.n_samples, now.quiet, workspace.low, workspace.high);
    i64 made = now.j_grid - before;
    if (made == 0) {
        return false;
    }
    now.t = now.origin + now.j_grid * now.h;
    now.quiet += made;
    now.fast_steps += made;
    now.spent += made * 0.0625;
    if (too_large(workspace.x)) {
        now.code = DIVERGED;
        return true;
    }
    return now.why != EVENT_AHEAD;
}

}  // namespace EPP_ARCH
}  // namespace epp
