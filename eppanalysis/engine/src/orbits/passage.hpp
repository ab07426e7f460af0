#pragma once
// The derivative of a run's end by its start.
//
// A run has met its events already, so nothing is sought: between them the flow and its derivative are exact, and at
// each the instant shifts with the start, by which time the state of one mode moves on and that of the next stays behind
// (docs/theory/flow.md).

#include "orbits/arcs.hpp"
#include "orbits/sweep.hpp"

namespace epp {
inline namespace EPP_ARCH {

namespace orbits_passage {

constexpr i64 TOUCHES = 4;
/// Value of a guard, relative to its terms, that is rounding of an orbit that has been closed.
constexpr double AT_THRESHOLD = 1e-9;

i64 derivative_of_run(const Model& model, const Combinations& compiled, const Work& work, double base_step, Vector y,
    Indices modes, const Met& met, double t_end, Matrix D, Vector shift);

}  // namespace orbits_passage
}  // namespace EPP_ARCH
}  // namespace epp
