#pragma once
// The corrector of a branch, Newton's method to the orbit in a plane across it; the parameter is sought, too.
//
// The numbers of the loop come from their polynomials over the parameter; the equations are those of
// `newton`, bordered by the plane's.

#include "engine/constants.hpp"
#include "structures.hpp"
#include "balances.hpp"
#include "filling.hpp"
#include "orbits/newton.hpp"

namespace epp {
inline namespace EPP_ARCH {

namespace orbits_corrector {

constexpr i64 ARRIVED = 0;
constexpr double ASTRAY = 1000.0;
constexpr double CLOSED = 1e-11;
constexpr double CONVERGED = 1e-09;
constexpr i64 LOST = 1;
constexpr i64 MOST_CORRECTIONS = 9;
constexpr double SMALL = 1e-09;
constexpr double STILL = 1e-11;
constexpr i64 WANTS_NUMBERS = 2;
constexpr i64 WANTS_STEP = 3;

Chain chain_of(const Chain& like, Vector numbers);
None channels_of(None like, const Chain& chain, Vector numbers);
void numbers_at(const Curve& curve, double value, Vector numbers);
bool bordered(const Motion& here, const Plane& plane, Vector u, Vector columns, Vector right, Indices places,
    Matrix scaled, Matrix matrix, Vector change);
Channels channels_of(const Channels& like, const Chain& chain, Vector numbers);
template <class C>
std::tuple<i64, double> correct(C channels, Chain chain, const Curve& curve, i64 input_place, i64 n_inputs,
    const Effort& effort, const Plane& plane, Vector step, Vector progress, Vector u, const Motion& here);

}  // namespace orbits_corrector
}  // namespace EPP_ARCH
}  // namespace epp
