#pragma once
// Sizes of the motion on an orbit, by which residuals and steps of Newton's method are scaled.

#include "engine/constants.hpp"
#include "structures.hpp"

namespace epp {
inline namespace EPP_ARCH {

namespace orbits_sizes {

void sizes_of_residuals(Matrix g, Indices at_once, Indices free, Vector scale, double period, Vector rows);
void size_of_motion(Matrices F, Matrix starts, Matrix ends, Matrix inner, Vector tau, Vector scale);

}  // namespace orbits_sizes
}  // namespace EPP_ARCH
}  // namespace epp
