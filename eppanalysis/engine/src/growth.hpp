#pragma once
// Whether a run grows without end, which its last events or its last rate show far beyond all levels.
//
// Far beyond its levels and constants a piecewise linear loop (with dead time or without) is homogeneous: what is k times
// as large moves k times as fast. So a motion that comes back enlarged, in all its states alike, comes back so for ever.

#include "engine/constants.hpp"
#include "structures.hpp"

namespace epp {
inline namespace EPP_ARCH {

namespace growth {

constexpr i64 DELAY_LINE = 11;
constexpr double EVENLY = 0.0001;
constexpr double FAR = 1000000.0;
constexpr double LASTED = 20.0;
constexpr double LEAST = 0.01;

bool repeats(Indices ev_guard, i64 count, i64 keep, i64 p);
double pushed(const Model& model, i64 i);
bool far(const Model& model, Vector state, Vector rate, Flags compared);
bool along_a_ray(Vector x, Vector rate, double quiet, Flags compared);
void reach(Vector ev_t, Matrix ev_x, Matrix ev_v, i64 count, i64 keep, i64 p, Vector state, Vector rate);
double factor(Matrix ev_x, Matrix ev_v, i64 c, i64 keep, i64 p, Vector state, Vector rate, Flags compared);
bool grows(const Model& model, Vector ev_t, Indices ev_guard, Matrix ev_x, Matrix ev_v, i64 count, double t_end,
    Vector x_end, Vector rate_end, Flags compared);

}  // namespace growth
}  // namespace EPP_ARCH
}  // namespace epp
