#pragma once
// What a jump does to the elements that it reaches, when an input steps or another element's output jumps.
//
// An element takes a jump of its input as the motion from the old value straight to the new one, as its map with memory
// does. One that follows its input lets go first where the jump is against its motion, at the value that it held; one that
// keeps its input on a level is thrown off it. Then the jump takes place, and guards that it has passed fire, upstream
// first. So the jump is tried beforehand along the cascade, each element settled before those that it acts on are looked
// at: what overshoots on the way is no motion.

#include "engine/constants.hpp"
#include "structures.hpp"
#include "engine/modes.hpp"
#include "engine/switches.hpp"

namespace epp {
inline namespace EPP_ARCH {

inline bool may_leave_behind(const Model& model, Indices modes, i64 source);
i64 place_of(const Combinations& compiled, i64 q, i64 k);
double _input_size(const Combinations& compiled, i64 q, i64 row, Vector x, Vector recent, Vector H);
i64 _way_off(const Model& model, i64 m, double off);
i64 _letting_go(const Model& model, const Combinations& compiled, i64 e, i64 mode, Vector before, i64 new_, Vector x,
    Vector recent, Vector H, Matrix Sg, i64 last, double u);
bool clearly_above(const Combinations& compiled, i64 q, i64 i, Vector x, Vector recent, Vector H, Matrix Sg, i64 last,
    double u);
i64 passed(const Combinations& compiled, i64 q, const Workspace& workspace);
i64 _passed(const Model& model, const Combinations& compiled, i64 q, i64 e, Vector x, Vector recent, Vector H,
    Matrix Sg, i64 last, double u);
i64 _left_behind(const Model& model, const Combinations& compiled, const Work& work, const Workspace& workspace, i64 q,
    i64 k, bool stays, Vector x, Vector beyond, Vector recent, Vector H, Matrix Sg, i64 last, double u, Indices modes,
    double base_step);
std::tuple<i64, i64> let_go(const Model& model, const Combinations& compiled, const Work& work,
    const Workspace& workspace, const EventBuffer& buffer, i64 q, i64 k, bool stays, Vector x, Vector beyond,
    Vector recent, Vector H, Matrix Sg, i64 last, double u, Indices modes, double base_step, double t, Vector rate, i64 count,
    bool kept);

/// Whether a jump of an element's output (of external inputs: the number behind the last) can leave one behind.
inline bool may_leave_behind(const Model& model, Indices modes, i64 source) {
    for (i64 e = 0; e < modes.size(); ++e) {
        if (model.reach(source, e) && model.mode_lags(model.mode_first(e) + modes(e))) {
            return true;
        }
    }
    return false;
}

}  // namespace EPP_ARCH
}  // namespace epp
