#pragma once
// Newton's method on the equations of an orbit of a fixed sequence of events, damped.
//
// The equations are those of `sweep`.

#include "engine/constants.hpp"
#include "structures.hpp"
#include "balances.hpp"
#include "filling.hpp"
#include "orbits/flow.hpp"
#include "orbits/sizes.hpp"
#include "orbits/sweep.hpp"

namespace epp {
inline namespace EPP_ARCH {

namespace orbits_newton {

constexpr i64 MOST_SERIES = 10000;
constexpr double NO_TIME = 1e-300;
constexpr double ROUNDING = 1e-11;
alignas(64) inline double SHARES_numbers[] = {1.0, 0.4, 0.16, 0.06400000000000002, 0.025600000000000005,
    0.010240000000000003, 0.0040960000000000015, 0.0016384000000000006};
inline const Vector SHARES(SHARES_numbers, {8});
constexpr double STRAY = 1000000000.0;

double largest_share(Vector values, Vector sizes);
void sizes_of_unknowns(const Chain& chain, const Motion& it, Vector columns);
bool solved(Matrix scaled, Vector right, Vector columns, Indices places, Matrix matrix, Vector step);
template <class C>
double run_along(const C& channels, const Chain& chain, const Effort& effort, double used, const Motion& it);
template <class C>
void measure(const C& channels, const Chain& chain, const Motion& it);
Motion like(const Motion& it);
bool step(const Motion& it, Vector columns, Indices places, Matrix scaled, Matrix matrix, Vector step);
void copy(const Motion& source, const Motion& it);
template <class C>
std::tuple<double, i64, Motion, Motion> search(const C& channels, const Chain& chain, const Effort& effort,
    double used, const Motion& here, Vector step, double most, i64 share, double residual, Motion better, Motion trial);
template <class C>
std::tuple<i64, i64, double> newton(const C& channels, const Chain& chain, const Effort& effort, i64 iterations,
    Vector step, const Motion& here, i64 share);

}  // namespace orbits_newton
}  // namespace EPP_ARCH
}  // namespace epp
