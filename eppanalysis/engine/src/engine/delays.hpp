#pragma once
// The memory of dead times, a ring buffer of Taylor series of each delayed output.
//
// Every step that a run makes leaves the series of the delayed outputs behind; a later step reads them back, shifted to
// where it is, and counts no further than the segment that it reads. Such an end would come back after each dead time,
// with those that were there before, for ever. So a step is expanded beyond it, as far as the series that it reads holds,
// and where the next one only continues it (there was no switch, or its echo has become too faint) both are one segment.

#include "engine/constants.hpp"
#include "structures.hpp"

namespace epp {
inline namespace EPP_ARCH {

void start_lines(const Model& model, const Combinations& compiled, i64 q, Vector x, Vector H, Matrices line_t,
    Matrix line_h, Matrices line_c, IndexMatrix line_n);
std::tuple<double, double> segment_reach(const Model& model, i64 j, double t, Matrices line_t, Matrix line_h,
    IndexMatrix line_n);
void _shift(Vector c, double u, Vector p);
void read_line(const Model& model, i64 j, double t, double d, Matrices line_t, Matrix line_h, Matrices line_c,
    IndexMatrix line_n, Matrix Sg, Vector p);
bool _continues(Vector old, double begin, double h, Vector new_, double t, double d, double u1, Vector p);
void extend_lines(const Model& model, const Combinations& compiled, i64 q, Matrix X, i64 last, Matrix Sg, Vector H,
    double t, double d, double u1, Matrices line_t, Matrix line_h, Matrices line_c, IndexMatrix line_n, Vector p);

}  // namespace EPP_ARCH
}  // namespace epp
