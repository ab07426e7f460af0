#pragma once
// Once along the arcs of an orbit, with Newton's equations for its start and its dwell times.
//
// The equations and their unknowns are those of docs/theory/exact_orbits.md, "Closing an orbit".

#include "engine/constants.hpp"
#include "structures.hpp"
#include "filling.hpp"
#include "orbits/flow.hpp"

namespace epp {
inline namespace EPP_ARCH {

namespace orbits_sweep {

constexpr i64 MOST_SERIES = 10000;

void times(Matrix P, Matrix Q, Matrix out, i64 n_dense, i64 n_columns);
double guard_channels(None channels, Vector gs, Vector sigma, Vector slope, Vector row);
void guard_equation(i64 at_once, double tau, double value, Vector row, Matrix E, Vector A, Vector r, i64 place);
Vector weights(const Channels& channels, Vector gs, Vector slope);
double guard_channels(const Channels& channels, Vector gs, Vector sigma, Vector slope, Vector row);
template <class C>
double guard_at(const C& channels, Vector g, Vector gs, i64 smooth, Vector end, Vector sigma, Vector slope,
    Vector row);
template <class C>
i64 sweep(const C& channels, Matrices F, Matrices S, Matrix g, Matrix gs, Matrices J, Indices smooth,
    Indices at_once, Vector y0, Vector tau, Indices free, Vector shift, i64 most, Matrix starts, Matrix ends, Matrix A,
    Vector r, Vector speed);
template <class C>
void along(const C& channels, i64 a, Matrix F, Matrix S, Vector g, Vector gs, i64 smooth, Vector y, double tau,
    Vector end, Matrix Phi, Vector sigma, Vector row);
double guard_change(None channels, None by, Vector dg, Vector dgs, Vector gs, i64 smooth, Vector end, Vector sigma,
    Vector slope);
double guard_change(const Channels& channels, const Numbers& by, Vector dg, Vector dgs, Vector gs, i64 smooth,
    Vector end, Vector sigma, Vector slope);
template <class C>
void sweep_by(const C& channels, Matrices F, Matrices S, Matrix g, Matrix gs, Matrices J, Indices smooth,
    Indices at_once, Matrix starts, Vector tau, Indices free, const C& of_channels, Matrices dF, Matrices dS,
    Matrix dg, Matrix dgs, Matrices dJ, Vector dshift, Vector dy, Vector out);

}  // namespace orbits_sweep
}  // namespace EPP_ARCH
}  // namespace epp
