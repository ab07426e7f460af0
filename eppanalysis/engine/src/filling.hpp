#pragma once
// Arrays copied and added into slices, by loops.
//
// Numba's own assignment of an array to a slice brings along a message for shapes that differ, which takes seconds to
// compile.

#include "engine/constants.hpp"
#include "structures.hpp"

namespace epp {
inline namespace EPP_ARCH {

namespace filling {

void fill(Vector out, Vector source);
void fill(Indices out, Indices source);
void fill(Strided<double, 1> out, Vector source);
void fill_rows(Strided<double, 2> out, Matrix source);
void fill_rows(Matrix out, Matrix source);
void accumulate(Vector out, double factor, Vector source);
double largest(Matrix rows);
double largest(Strided<double, 2> rows);
void accumulate(Strided<double, 1> out, double factor, Vector source);

}  // namespace filling
}  // namespace EPP_ARCH
}  // namespace epp
