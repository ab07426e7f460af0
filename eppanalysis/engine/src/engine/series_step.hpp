#pragma once
// A step by series, from any state and with smooth channels: its length, the guard that rises first, its end.
//
// Rules at its start, for a guard within rounding of zero: the sign of its first derivative that is above
// rounding decides; rising fires at once, falling arms it for its next rise. One that stays on zero behind an event leads to the mode
// for that, where it has one (docs/theory/engine.md, "Rules at a switch").

#include "engine/constants.hpp"
#include "structures.hpp"
#include "engine/delays.hpp"
#include "engine/fast.hpp"
#include "engine/flow.hpp"
#include "engine/series.hpp"
#include "engine/signals.hpp"
#include "engine/switches.hpp"

namespace epp {
inline namespace EPP_ARCH {

void plan(const Model& model, const Combinations& compiled, const Workspace& workspace, Progress& now);
void read_lines(const Model& model, const Workspace& workspace, double t, double d);
bool _give_sizes(const Combinations& compiled, i64 q, const Workspace& workspace);
void expand_step(const Model& model, const Combinations& compiled, const Workspace& workspace, Progress& now);
inline std::tuple<i64, double, bool> _first_guard(const Model& model, const Combinations& compiled, i64 q,
    const Workspace& workspace, i64 last, double d, double clock, bool forced, bool at_event);
void look_ahead(const Model& model, const Combinations& compiled, const Workspace& workspace, const Samples& samples,
    Progress& now);
void reach(const Combinations& compiled, const Workspace& workspace, const Samples& samples, Progress& now);

/// The guard that rises first on the series, and where in [0, 1]; -1 and 2.0 when none does. Behind an event, first one
/// that stays on zero and leads somewhere by that, and that it does.
inline std::tuple<i64, double, bool> _first_guard(const Model& model, const Combinations& compiled, i64 q,
    const Workspace& workspace, i64 last, double d, double clock, bool forced, bool at_event) {
    double u{};
    Matrix X = workspace.X;
    Matrix Sg = workspace.Sg;
    Vector H = workspace.H;
    Vector p = workspace.p;
    Vector top = workspace.top;
    Vector constant = workspace.constant;
    i64 which = -1;
    double best = 2.0;
    bool sized = false;
    size_sum(X, last, workspace.spread);
    row_sum_from(workspace.lift, compiled.all_gf.row(q), X.row(0), 1.0, top);
    row_sum_from(top, compiled.reach_gf.row(q), workspace.spread, 1.0, top);
    // Below zero by the sum of the absolute terms: nothing on [0, 1] can lift it (rates and smooth channels aside).
    for (i64 g = 0, g_end = compiled.n_guards(q); g < g_end; ++g) {
        bool may_stay = at_event && model.guard_on_threshold(compiled.guard(q, g)) >= 0;
        if (!may_stay && top(g) < 0.0 && (Sg.shape(1) == 0 || !(compiled.on_rate(q, g) || compiled.smooth_guard(q, g)))) {
            continue;
        }
        guard_series(compiled, q, g, X, last, Sg, constant(g), d, p);
        if (!may_stay && p(0) < 0.0 && !may_rise(p)) {
            continue;
        }
        if (!sized) {
            term_sizes(compiled, q, X, Sg, H, d, workspace.recent, clock, 0, 2, workspace.Y, workspace.wide);
            sized = true;
        }
        u = rise_from_start(compiled, q, g, X, last, Sg, H, d, workspace.recent, clock, workspace.Y, workspace.wide, p,
            forced);
        if (may_stay && u == STAYS) {
            return {g, 0.0, true};
        }
        if (u < best) {
            best = u;
            which = g;
        }
    }
    return {which, best, false};
}

}  // namespace EPP_ARCH
}  // namespace epp
