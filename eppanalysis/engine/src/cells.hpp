#pragma once
// Many loops of one structure, one after another, each to its verdict and the shape of its cycle.
//
// Only what the caller keeps is kept: a buffer of the last events and one period of samples serve all cells in turn, so
// memory does not grow with the number of cells.

#include "engine/constants.hpp"
#include "structures.hpp"
#include "engine/run.hpp"
#include "filling.hpp"
#include "verdict.hpp"

namespace epp {
inline namespace EPP_ARCH {

namespace cells {

constexpr i64 CYCLE = 2;
constexpr i64 PAUSED = 7;
constexpr i64 SAMPLES = 512;
constexpr i64 SETTLED = 1;

double refined(Matrix signals, i64 n, i64 i, i64 j);
void shape(Matrix signals, i64 n, Vector mean, Vector low, Vector high, Vector rms);
void run_cells(const Models& stack, const Combinations& compiled, const Work& work, const Workspace& workspace,
    const Samples& none, const Samples& period_samples, const EventBuffer& buffer, Progress& now, Matrix x0,
    IndexMatrix modes0, Matrix H0, Flags compared, Vector base_step, i64 first, i64 last, const Outcome& out);

}  // namespace cells
}  // namespace EPP_ARCH
}  // namespace epp
