#pragma once
// States and signals along a closed orbit: at given times, and their least and greatest values.

#include "engine/constants.hpp"
#include "structures.hpp"
#include "engine/flow.hpp"
#include "filling.hpp"
#include "orbits/flow.hpp"

namespace epp {
inline namespace EPP_ARCH {

namespace orbits_signals {

constexpr double BENEATH = 1e-18;
constexpr i64 FEWEST = 8;
constexpr i64 MOST = 4096;
constexpr i64 MOST_SERIES = 10000;
constexpr double PER_TURN = 0.3;
constexpr i64 TERMS = 24;

template <class C>
void states_at(const C& channels, Matrices F, Matrices S, Indices smooth, Matrix starts, Vector marks,
    Vector times, Matrix out);
i64 steps_of(Matrix F, double tau, Matrices square);
void carry(Matrix Phi, Vector y, Vector out, i64 n);
i64 series_of(Vector Y, Matrix F, Vector rate, double d, Vector terms);
std::tuple<double, double, double> sum_at(Vector terms, double share);
template <class C>
double turning_value(const C& channels, i64 a, Matrix F, Matrix S, i64 smooth, Vector Y, Vector Ys, Vector y,
    double d, double left, double right, Vector end, Matrices square);
template <class C>
void extents(const C& channels, Matrices F, Matrices S, Indices smooth, Matrices Y, Matrices Ys, Matrix starts,
    Vector tau, Vector low, Vector high);

}  // namespace orbits_signals
}  // namespace EPP_ARCH
}  // namespace epp
