#pragma once
// The motion along one arc of an orbit, and its derivative with respect to the start.
//
// Without smooth channels the flow is a matrix exponential; with them it is a Taylor series, and so is its derivative. The
// derivative by a parameter is one more column, in forward mode: the variational equation with what the parameter changes.

#include "engine/constants.hpp"
#include "structures.hpp"
#include "engine/curves.hpp"
#include "engine/flow.hpp"
#include "engine/series.hpp"
#include "filling.hpp"

namespace epp {
inline namespace EPP_ARCH {

namespace orbits_flow {

constexpr i64 CUBE = 1;
constexpr i64 DELAY_LINE = 11;
constexpr double EPS = 2.220446049250313e-16;
constexpr i64 EXPONENTIAL = 10;
constexpr i64 ORDER = 32;
constexpr i64 RECIPROCAL = 2;
constexpr i64 SINE = 0;
constexpr i64 SQUARE = 3;
constexpr i64 TANH = 6;

Matrices room(Matrices F);
None numbers_of(None channels, Matrix F, Matrix S);
i64 smooth_flow(None channels, i64 arc, Matrix F, Matrix S, Vector y, double tau, i64 most, Vector end, Matrix Phi,
    Vector sigma, Vector slope, None by);
void affine_flow(Matrix F, Vector y, double tau, Vector end, Matrix Phi, Matrices square);
void rate_at(Matrix F, Matrix S, Vector y, Vector sigma, Vector rate);
Numbers numbers_of(const Channels& channels, Matrix F, Matrix S);
void channel_term(const Channels& model, Vector sense, i64 j, i64 k, Matrix X, Vector H, Matrix Sg, Matrix arg,
    Matrix aux, Matrix slope);
void rate_by(const Numbers& by, i64 k, Matrix X, Vector H, Matrix Sg, Matrices V);
void change_term(const Channels& channels, i64 j, i64 k, Matrices V, Matrix slope, View<double, 4> change, i64 N);
void channel_by(const Channels& channels, const Numbers& by, i64 j, i64 k, Matrix X, Vector H, Matrix Sg, Matrix slope,
    View<double, 4> change);
bool ends(Matrices V, i64 column);
i64 series(const Channels& channels, Vector sense, Matrix F, Matrix S, Vector H, double h, Matrix X, Matrices V,
    Matrices workspace, View<double, 4> change, const Numbers& by);
void add_up(Matrix X, Matrices V);
void channels_at(const Channels& model, i64 arc, Vector x, Vector H, Vector sigma, Vector slope);
i64 smooth_flow(const Channels& channels, i64 arc, Matrix F, Matrix S, Vector y, double tau, i64 most, Vector end,
    Matrix Phi, Vector sigma, Vector slope, const Numbers& by);
void channels_at(None model, i64 arc, Vector x, Vector H, Vector sigma, Vector slope);
void affine_change(Matrix F, Matrix by, Vector y, double tau, Vector change, Vector end);

}  // namespace orbits_flow
}  // namespace EPP_ARCH
}  // namespace epp
