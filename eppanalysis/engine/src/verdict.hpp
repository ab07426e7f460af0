#pragma once
// What a run came to, read from its last events: at rest, on a cycle, growing without end, or neither.

#include "engine/constants.hpp"
#include "structures.hpp"
#include "growth.hpp"

namespace epp {
inline namespace EPP_ARCH {

namespace verdict {

constexpr double ADD_UP = 0.5;
constexpr i64 CYCLE = 2;
constexpr double CYCLE_TOLERANCE = 0.001;
constexpr i64 DELAY_LINE = 11;
constexpr double EVEN = 10.0;
constexpr double GONE = 0.001;
constexpr double GROWING = 1.5;
constexpr i64 GROWS = 3;
constexpr double MOST_CHANGE = 0.02;
constexpr double REST_TOLERANCE = 1e-06;
constexpr double ROUNDED = 1e-10;
constexpr i64 SETTLED = 1;
constexpr double SMALL = 1e-07;
constexpr double STANDING = 1e-09;
constexpr double STEEP = 0.5;
constexpr double TO_AND_FRO = 3.0;
constexpr i64 TURNS = 16;
constexpr i64 UNDECIDED = 0;

void widen(Vector ev_t, Matrix ev_x, Matrix ev_v, i64 count, i64 keep, i64 p, Vector low, Vector high, Vector reach,
    Vector out);
double change(Vector ev_t, Matrix ev_x, i64 count, i64 back, i64 keep, i64 p, Vector local, Vector size,
    Flags compared);
double rates_change(Matrix ev_v, i64 last, i64 keep, i64 p, Vector local, double period, Flags compared);
double rates_to_change(Vector ev_t, Matrix ev_v, i64 count, i64 keep, i64 p, Vector local, Flags compared);
double wandering(Vector ev_t, Matrix ev_x, i64 count, i64 keep, i64 p, Vector local, Vector size, Flags compared);
double rest_change(double d1, Vector ev_t, Matrix ev_x, i64 count, i64 keep, i64 p, Vector local, Vector size,
    Flags compared, Vector rounding);
double drift(double d1, Vector ev_t, Indices ev_guard, Matrix ev_x, i64 count, i64 keep, i64 p, Vector local,
    Vector size, Flags compared);
i64 shortest(Vector ev_t, Indices ev_guard, Matrix ev_x, i64 count, i64 keep, i64 p, Vector local, Vector size,
    Flags compared);
i64 verdict(Vector ev_t, Indices ev_guard, Matrix ev_x, Matrix ev_v, i64 count, double t_end, Vector low, Vector high,
    Vector rate_end, Flags compared, bool late, Vector found);
std::tuple<Vector, Vector> late_range(Vector ev_t, Matrix ev_x, Matrix ev_v, i64 count, double t_end);
i64 verdict_of_run(const Model& model, Vector ev_t, Indices ev_guard, Matrix ev_x, Matrix ev_v, i64 count,
    double t_end, Vector low, Vector high, Vector x_end, Vector rate_end, Flags compared, Vector found);
std::tuple<bool, double> rounding_of_motion(Matrix states, Matrix memory, Vector moves, double period, Flags compared,
    Matrix on_inputs, const std::tuple<Matrix, Vector>& elements, const std::tuple<Vector, Vector>& changes,
    double rounding);

}  // namespace verdict
}  // namespace EPP_ARCH
}  // namespace epp
