#pragma once
// The tables of the engine, as named tuples of arrays: a hybrid system's model, its compiled mode combinations.
//
// A hybrid system comes as flat arrays (`Model`). The combination of modes that a run visits is compiled on first visit
// into a place of `Combinations`; `Work` is the workspace for that.

#include "engine/constants.hpp"
#include "structures.hpp"

namespace epp {
inline namespace EPP_ARCH {

void clear(const Combinations& compiled, i64 q);

}  // namespace EPP_ARCH
}  // namespace epp
