#pragma once
// The run of a hybrid system through its modes, exact between events.
//
// Two ways of advancing, one result. Where no smooth channel acts and the state is on the step grid of its mode, the
// *fast step* multiplies by precomputed matrices and proves that no guard is reached (`fast`). Where it can't prove that,
// off the grid of the samples, and for smooth channels, the *series step* expands the state to rounding and looks for the
// first rise of every guard (`series_step`). See docs/theory/engine.md.

#include "engine/constants.hpp"
#include "structures.hpp"
#include "engine/delays.hpp"
#include "engine/fast.hpp"
#include "engine/jumps.hpp"
#include "engine/modes.hpp"
#include "engine/periodicity.hpp"
#include "engine/series_step.hpp"
#include "engine/signals.hpp"
#include "engine/switches.hpp"

namespace epp {
inline namespace EPP_ARCH {

void _forget(const Workspace& workspace, i64 n);
void _lines_before(const Model& model, const Combinations& compiled, const Workspace& workspace, i64 q);
bool _begin(const Model& model, const Combinations& compiled, const Work& work, const Workspace& workspace,
    const Samples& samples, Progress& now);
inline void _put_inputs(const Model& model, i64 i, double t, Vector x);
void _meet_inputs(const Model& model, const Combinations& compiled, const Work& work, const Workspace& workspace,
    const EventBuffer& buffer, Progress& now);
bool _stand(const Combinations& compiled, const Workspace& workspace, Progress& now);
void _aim(const Model& model, const Combinations& compiled, const Work& work, const Workspace& workspace,
    const Samples& samples, Progress& now);
void _switch_over(const Model& model, const Combinations& compiled, const Work& work, const Workspace& workspace,
    const EventBuffer& buffer, Progress& now);
bool _happen(const Model& model, const Combinations& compiled, const Work& work, const Workspace& workspace,
    const EventBuffer& buffer, Progress& now);
void _enter_event(const Model& model, const Workspace& workspace, const Samples& samples, const EventBuffer& buffer,
    Progress& now);
void _finish(const Model& model, const Combinations& compiled, const Workspace& workspace, const Samples& samples,
    Progress& now);
i64 run(const Model& model, const Combinations& compiled, const Work& work, const Workspace& workspace,
    const Samples& samples, const EventBuffer& buffer, Progress& now);
void step_at_start(const Model& model, const Combinations& compiled, const Work& work, const Workspace& workspace,
    const Samples& none, const EventBuffer& buffer, const Progress& now, Vector x0, Indices modes0, Vector H0,
    Flags without_memory);

/// Give external inputs their values behind all their breakpoints from i on that are due.
inline void _put_inputs(const Model& model, i64 i, double t, Vector x) {
    while (i < model.breakpoint_time.size() && model.breakpoint_time(i) <= t) {
        x(model.breakpoint_state(i)) = model.breakpoint_value(i);
        i += 1;
    }
}

}  // namespace EPP_ARCH
}  // namespace epp
