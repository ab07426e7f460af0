#include "engine/periodicity.hpp"

namespace epp {
inline namespace EPP_ARCH {

/// State, modes and memory values to another place.
void copy_start(Vector x, Indices modes, Vector H, Vector to_x, Indices to_modes, Vector to_H) {
    take(to_x, x);
    for (i64 i = 0; i < modes.size(); ++i) {
        to_modes(i) = modes(i);
    }
    for (i64 i = 0; i < H.size(); ++i) {
        to_H(i) = H(i);
    }
}

/// Back from the period that served the samples of all periods to come, to the time behind them.
void come_back(const Model& model, const Combinations& compiled, const Work& work, const Workspace& workspace,
    const Samples& samples, Progress& now) {
    i64 first = now.i_sample;
    i64 stop = now.n_samples;
    write_rest(compiled, now.q, workspace.x, workspace.still, workspace.Sg.row(0), samples.rows, first, stop,
        samples.out);
    copy_start(workspace.behind_x, workspace.behind_modes, workspace.behind_H, workspace.x, workspace.modes,
        workspace.H);
    take(workspace.recent, workspace.behind_recent);
    now.aside = false;
    now.t = now.t_behind;
    now.until = now.t_end;
    now.i_sample = now.i_behind;
    now.n_samples = samples.phases.size();
    now.origin = 0.0;
    now.last_t = now.t;
    now.same_instant = 0;
    now.quiet = 0;
    const bool was1 = false;
    now.armed = was1;
    now.entered = was1;
    now.q = find_combination(model, compiled, work, workspace.modes, now.base_step);
}

/// Smallest number of events after which the guards repeat, twice over; 0 when there is none.
i64 _candidate(Indices ev_guard, i64 count, i64 keep) {
    bool same{};
    for (i64 p = 1, p_end = least_of<i64>(MOST_EVENTS, floor_div(least_of<i64>(count, keep), 3)) + 1; p < p_end; ++p) {
        same = true;
        for (i64 k = 0, k_end = 2 * p; k < k_end; ++k) {
            if (ev_guard(modulo(count - 1 - k, keep)) != ev_guard(modulo(count - 1 - k - p, keep))) {
                same = false;
                break;
            }
        }
        if (same) {
            return p;
        }
    }
    return 0;
}

/// Change of the state from event c - p to event c, relative to the largest states.
double _apart(i64 c, i64 p, i64 keep, Matrix ev_x, Vector largest) {
    double d{};
    double worst = 0.0;
    for (i64 i = 0; i < ev_x.shape(1); ++i) {
        d = std::fabs(ev_x(modulo(c, keep), i) - ev_x(modulo(c - p, keep), i));
        if (d > (worst * largest(i))) {
            worst = (largest(i) > 0.0) ? d / largest(i) : INF;
        }
    }
    return worst;
}

/// Largest change over a period within the last two, relative to the cycle's own size; infinite for other modes.
double _change(i64 c, i64 p, const EventBuffer& buffer, Vector largest) {
    double low{}, high{}, size{}, d{}, v{}, scale{};
    i64 j{};
    Matrix values{};
    bool is_memory{};
    double worst = 0.0;
    i64 keep = buffer.t.size();
    Matrix ev_x = buffer.x;
    Matrix ev_H = buffer.H;
    IndexMatrix ev_modes = buffer.modes;
    for (i64 k = 0, k_end = 2 * p; k < k_end; ++k) {
        for (i64 e = 0; e < ev_modes.shape(1); ++e) {
            if (ev_modes(modulo(c - k, keep), e) != ev_modes(modulo(c - k - p, keep), e)) {
                return INF;
            }
        }
    }
    i64 n = ev_x.shape(1);
    for (i64 i = 0, i_end = n + ev_H.shape(1); i < i_end; ++i) {
        is_memory = i >= n;
        j = is_memory ? i - n : i;
        values = is_memory ? ev_H : ev_x;
        const double was1 = values(modulo(c, keep), j);
        low = was1;
        high = was1;
        // A state may be zero at its own switches, so the largest value so far counts too.
        size = is_memory ? 0.0 : largest(i);
        d = 0.0;
        for (i64 k = 0, k_end = 2 * p; k < k_end; ++k) {
            v = values(modulo(c - k, keep), j);
            low = least_of(low, v);
            high = greatest_of(high, v);
            size = greatest_of(size, std::fabs(v));
            d = greatest_of(d, std::fabs(v - values(modulo(c - k - p, keep), j)));
        }
        scale = greatest_of(high - low, 0.001 * size);
        if (d > (worst * scale)) {
            worst = (scale > 0.0) ? d / scale : INF;
        }
    }
    return worst;
}

/// Events in the period on which the run has closed; 0 as long as it has not.
///
/// `watch` holds, from event to event: events in the candidate period, how many events in a row were near their
/// predecessors, and eighths of the events seen so far. (Events that belong to one jump come together.)
i64 closing(Vector watch, i64 count, const EventBuffer& buffer, Vector largest) {
    double before{};
    i64 c = count - 1;
    i64 p = i64(watch(0));
    i64 keep = buffer.t.size();
    Indices ev_guard = buffer.guard;
    Matrix ev_x = buffer.x;
    bool look = (floor_div(count, 8)) > watch(2);
    watch(2) = floor_div(count, 8);
    if (p == 0) {
        if (look) {
            watch(0) = _candidate(ev_guard, count, keep);
            watch(1) = 0.0;
        }
        return 0;
    }
    if (ev_guard(modulo(c, keep)) != ev_guard(modulo(c - p, keep))) {
        watch(0) = 0.0;
        return 0;
    }
    if (_apart(c, p, keep, ev_x, largest) > NEAR) {
        watch(1) = 0.0;
        return 0;
    }
    watch(1) += 1.0;
    // Two periods of events near their predecessors are three periods that agree (docs/theory/engine.md, Repetition).
    if (watch(1) < (2 * p)) {
        return 0;
    }
    watch(1) = p;
    // Back to where the change was still far above rounding: without a contraction that was seen, as on a cycle from the
    // start, small changes prove nothing.
    double change = greatest_of(_change(c, p, buffer, largest), 1e-16);
    for (i64 k = 1; k < MOST_TURNS; ++k) {
        if (((k + 1) * p) >= least_of<i64>(count, keep) || ev_guard(modulo(c - k * p, keep)) != ev_guard(modulo(c,
            keep))) {
            return 0;
        }
        before = _apart(c - k * p, p, keep, ev_x, largest);
        // From `before` to `change` in k turns: as a geometric series the changes to come add up to
        // change/(1 - ratio), which must be rounding (docs/theory/engine.md, Repetition).
        if (before > APART) {
            return (change < (ROUNDING * (1.0 - std::pow(change / before, 1.0 / k)))) ? p : 0;
        }
    }
    return 0;
}

/// Enter the events of `turns` more periods of `p` events into the event buffer; `times` has room for p of them.
void repeat_events(i64 turns, i64 p, double period, i64 count, Vector times, const EventBuffer& buffer) {
    i64 r{}, source{};
    i64 keep = buffer.t.size();
    for (i64 k = 0; k < p; ++k) {
        times(k) = buffer.t(modulo(count - p + k, keep));
    }
    i64 first = greatest_of<i64>(0, turns * p - keep);
    // of more than the buffer holds the last ones, from the begin of a turn on
    first -= modulo(first, p);
    for (i64 k = first, k_end = turns * p; k < k_end; ++k) {
        r = modulo(count + k, keep);
        source = modulo(count - p + modulo(k, p), keep);
        if (k >= (first + p)) {
            source = modulo(count + k - p, keep);
        }
        buffer.t(r) = times(modulo(k, p)) + (floor_div(k, p) + 1) * period;
        buffer.guard(r) = buffer.guard(source);
        for (i64 i = 0, i_end = buffer.x.shape(1); i < i_end; ++i) {
            buffer.x(r, i) = buffer.x(source, i);
            buffer.v(r, i) = buffer.v(source, i);
        }
        for (i64 i = 0, i_end = buffer.H.shape(1); i < i_end; ++i) {
            buffer.H(r, i) = buffer.H(source, i);
        }
        for (i64 i = 0, i_end = buffer.modes.shape(1); i < i_end; ++i) {
            buffer.modes(r, i) = buffer.modes(source, i);
        }
    }
}

/// Places of `phases`, all in [0, period), in increasing order; `first` is workspace of at least as many bins.
///
/// Evenly spread phases fall about one to a bin, so that the insertions that finish the work are few.
void sort_into(Vector phases, double period, Indices order, Indices first) {
    i64 b{}, i{}, j{};
    i64 n = phases.size();
    i64 bins = first.size() - 1;
    double scale = bins / period;
    for (i64 b_at = 0, b_at_end = bins + 1; b_at < b_at_end; ++b_at) {
        b = b_at;
        first(b) = 0;
    }
    for (i64 i_at = 0; i_at < n; ++i_at) {
        i = i_at;
        first(_bin(phases(i), scale, bins) + 1) += 1;
    }
    for (i64 b_at = 0; b_at < bins; ++b_at) {
        b = b_at;
        first(b + 1) += first(b);
    }
    for (i64 i_at = 0; i_at < n; ++i_at) {
        i = i_at;
        b = _bin(phases(i), scale, bins);
        order(first(b)) = i;
        first(b) += 1;
    }
    for (i64 k = 1; k < n; ++k) {
        i = order(k);
        j = k;
        while (j > 0 && phases(order(j - 1)) > phases(i)) {
            order(j) = order(j - 1);
            j -= 1;
        }
        order(j) = i;
    }
}

/// Sort the samples from `first` on, of all whole periods to come, by phase behind the others; returns how many.
i64 _sort_samples(const Samples& samples, i64 first, double t, double period, i64 turns) {
    double after{};
    Vector times = samples.times;
    Vector phases = samples.phases;
    i64 nt = samples.phases.size();
    i64 n = 0;
    double end = t + turns * period;
    double per_second = 1.0 / period;
    while ((first + n) < nt && times(first + n) < end) {
        after = times(first + n) - t;
        phases(n) = greatest_of(0.0, after - std::floor(after * per_second) * period);
        n += 1;
    }
    if (n > 0) {
        sort_into(phases.slice(0, n), period, samples.order, samples.bins.slice(0, n + 1));
        for (i64 i = 0; i < n; ++i) {
            samples.times(nt + i) = phases(samples.order(i));
            samples.rows(nt + i) = first + samples.order(i);
        }
    }
    return n;
}

/// Enter the events of all whole periods (of p events) to come into the event buffer, and sort their samples by
/// phase.
///
/// Returns how many periods, their length, and how many samples from `first` on fall into them.
std::tuple<i64, double, i64> _whole_periods(const EventBuffer& buffer, const Workspace& workspace,
    const Samples& samples, i64 first, double t, double t_end, i64 count, i64 p) {
    i64 keep = buffer.t.size();
    // Over two periods, which halves what the rounding of two times of events makes of it.
    double period = 0.5 * (buffer.t(modulo(count - 1, keep)) - buffer.t(modulo(count - 1 - 2 * p, keep)));
    i64 turns = 0;
    // Switches that pile up at one instant have no period.
    if (period > (1e-12 * t)) {
        turns = greatest_of<i64>(0, i64((t_end - t) / period));
    }
    if (turns == 0) {
        return {0, period, 0};
    }
    repeat_events(turns, p, period, count, workspace.once, buffer);
    return {turns, period, _sort_samples(samples, first, t, period, turns)};
}

/// Where the run has closed by its last event, carry it through all whole periods to come.
void carry_on(const Workspace& workspace, const Samples& samples, const EventBuffer& buffer, Progress& now) {
    i64 turns{}, n_aside{};
    double period{};
    take_larger(workspace.largest, workspace.x, workspace.largest);
    i64 p_events = closing(workspace.watch, now.count, buffer, workspace.largest);
    if (p_events == 0) {
        return;
    }
    now.watched = false;
    std::tie(turns, period, n_aside) = _whole_periods(buffer, workspace, samples, now.i_sample, now.t, now.t_end,
        now.count, p_events);
    now.periods_repeated = turns;
    if (turns == 0) {
        return;
    }
    now.count += turns * p_events;
    // only what is computed counts
    now.max_events += turns * p_events;
    now.t_behind = now.t + turns * period;
    now.i_behind = now.i_sample + n_aside;
    // Their samples are taken in one more period, in the order of their phases.
    if (n_aside > 0) {
        copy_start(workspace.x, workspace.modes, workspace.H, workspace.behind_x, workspace.behind_modes,
            workspace.behind_H);
        take(workspace.behind_recent, workspace.recent);
        now.aside = true;
        now.t = 0.0;
        now.until = period;
        now.i_sample = samples.phases.size();
        now.n_samples = samples.phases.size() + n_aside;
    } else {
        now.t = now.t_behind;
        now.i_sample = now.i_behind;
    }
    now.origin = 0.0;
    now.last_t = now.t;
    now.same_instant = 0;
}

}  // namespace EPP_ARCH
}  // namespace epp
