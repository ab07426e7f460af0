#pragma once
// The arcs of an orbit: rates, guards and maps of events, from the modes and the guards that end them.
//
// State and memory values of the loop are stacked into one vector ``y = (x, H)`` of N numbers, the last of which is 1 and
// carries every constant. On an arc ``dy/dt = F y + S sigma(y)``, its end lies on a guard ``g y + gs sigma(y) = 0``, and
// the event there maps y to ``J y`` (docs/theory/exact_orbits.md, "Closing an orbit").

#include "engine/constants.hpp"
#include "structures.hpp"
#include "engine/modes.hpp"
#include "filling.hpp"

namespace epp {
inline namespace EPP_ARCH {

namespace orbits_arcs {

constexpr i64 DELAY_LINE = 11;
constexpr i64 NOT_A_GUARD = 2;
constexpr i64 READY = 0;
constexpr i64 SINGULAR = 1;
constexpr i64 UNSUPPORTED = 3;

void rates_of(const Combinations& compiled, i64 q, Matrix F, Matrix S);
bool is_smooth(const Model& model, Indices modes, Matrix S, Vector gs, Vector sense);
i64 guard_rows(const Model& model, const Combinations& compiled, i64 q, i64 guard, Vector g, Vector gs);
void level_map(Matrix J, Vector c, Vector on_memory, double level, Strided<double, 1> b);
i64 event_map(const Model& model, const Combinations& compiled, i64 q, i64 guard, Indices after, Matrix J);
i64 build_arcs(const Model& model, const Combinations& compiled, const Work& work, double base_step, IndexMatrix modes,
    Indices guards, Indices timing, Matrices F, Matrices S, Matrix g, Matrix gs, Matrices J, Indices smooth,
    Matrix sense, Matrices Y, Matrices Ys, Matrices W);

}  // namespace orbits_arcs
}  // namespace EPP_ARCH
}  // namespace epp
