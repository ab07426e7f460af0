#pragma once
// A run that has closed to rounding repeats itself, and need not be computed again.
//
// A run is taken as closed when three periods in a row agree at every event to rounding, after a contraction that has been
// seen (a run that starts on a cycle, stable or not, shows none and is computed through), and when what the contraction
// still leaves to come is below rounding too.

#include "engine/constants.hpp"
#include "structures.hpp"
#include "engine/modes.hpp"
#include "engine/signals.hpp"

namespace epp {
inline namespace EPP_ARCH {

void copy_start(Vector x, Indices modes, Vector H, Vector to_x, Indices to_modes, Vector to_H);
void come_back(const Model& model, const Combinations& compiled, const Work& work, const Workspace& workspace,
    const Samples& samples, Progress& now);
i64 _candidate(Indices ev_guard, i64 count, i64 keep);
double _apart(i64 c, i64 p, i64 keep, Matrix ev_x, Vector largest);
double _change(i64 c, i64 p, const EventBuffer& buffer, Vector largest);
i64 closing(Vector watch, i64 count, const EventBuffer& buffer, Vector largest);
void repeat_events(i64 turns, i64 p, double period, i64 count, Vector times, const EventBuffer& buffer);
inline i64 _bin(double phase, double scale, i64 bins);
void sort_into(Vector phases, double period, Indices order, Indices first);
i64 _sort_samples(const Samples& samples, i64 first, double t, double period, i64 turns);
std::tuple<i64, double, i64> _whole_periods(const EventBuffer& buffer, const Workspace& workspace,
    const Samples& samples, i64 first, double t, double t_end, i64 count, i64 p);
void carry_on(const Workspace& workspace, const Samples& samples, const EventBuffer& buffer, Progress& now);

inline i64 _bin(double phase, double scale, i64 bins) {
    return least_of<i64>(bins - 1, greatest_of<i64>(0, i64(phase * scale)));
}

}  // namespace EPP_ARCH
}  // namespace epp
