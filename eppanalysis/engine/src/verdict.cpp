#include "verdict.hpp"

namespace epp {
inline namespace EPP_ARCH {

namespace verdict {

/// How far each state moves over the last p events, from its values there and its rates on the way.
///
/// `low`, `high` and `reach` hold what the last p - 1 events tell.
void widen(Vector ev_t, Matrix ev_x, Matrix ev_v, i64 count, i64 keep, i64 p, Vector low, Vector high, Vector reach,
    Vector out) {
    i64 here = modulo(count - p, keep);
    i64 before = modulo(count - 1 - p, keep);
    for (i64 i = 0; i < out.size(); ++i) {
        {
            const double was1 = least_of(least_of(low(i), ev_x(here, i)), ev_x(before, i));
            const double was2 = greatest_of(greatest_of(high(i), ev_x(here, i)), ev_x(before, i));
            low(i) = was1;
            high(i) = was2;
        }
        reach(i) = greatest_of(reach(i), 0.1 * std::fabs(ev_v(here, i)) * (ev_t(here) - ev_t(before)));
        out(i) = greatest_of(high(i) - low(i), reach(i));
    }
}

/// Largest change over the period that ended `back` events ago, relative to the cycle's size.
///
/// That of the period itself counts, too: what creeps towards rest may return ever later to the very same states.
double change(Vector ev_t, Matrix ev_x, i64 count, i64 back, i64 keep, i64 p, Vector local, Vector size,
    Flags compared) {
    double now{}, before{}, scale{};
    i64 last = count - 1 - back;
    double worst = 0.0;
    if ((back + 2 * p) < least_of<i64>(count, keep)) {
        now = ev_t(modulo(last, keep)) - ev_t(modulo(last - p, keep));
        before = ev_t(modulo(last - p, keep)) - ev_t(modulo(last - 2 * p, keep));
        if ((now + before) > 0.0) {
            worst = std::fabs(now - before) / greatest_of(now, before);
        }
    }
    for (i64 i = 0; i < local.size(); ++i) {
        if (!compared(i)) {
            continue;
        }
        // A state that is constant on the cycle is held against how far it has moved in the run, or its rounding would
        // be a change.
        scale = greatest_of(local(i), 1e-06 * size(i));
        if (scale > 0.0) {
            worst = greatest_of(worst, std::fabs(ev_x(modulo(last, keep), i) - ev_x(modulo(last - p, keep),
                i)) / scale);
        }
    }
    return worst;
}

/// Largest change of the rates at events over the period up to one, relative to the largest rate in it.
///
/// That is at least the mean one: where events are the turns of a motion, its rates there are rounding.
double rates_change(Matrix ev_v, i64 last, i64 keep, i64 p, Vector local, double period, Flags compared) {
    double size{}, change{}, now{}, before{};
    double worst = 0.0;
    for (i64 i = 0; i < compared.size(); ++i) {
        size = local(i) / period;
        change = 0.0;
        for (i64 k = 0; k < p; ++k) {
            now = ev_v(modulo(last - k, keep), i);
            before = ev_v(modulo(last - k - p, keep), i);
            size = greatest_of(size, std::fabs(now));
            change = greatest_of(change, std::fabs(now - before));
        }
        if (compared(i) && size > 0.0) {
            worst = greatest_of(worst, change / size);
        }
    }
    return worst;
}

/// What the rates at events will change in all periods to come, by a geometric series; 1e300 where it grows.
double rates_to_change(Vector ev_t, Matrix ev_v, i64 count, i64 keep, i64 p, Vector local, Flags compared) {
    double period = ev_t(modulo(count - 1, keep)) - ev_t(modulo(count - 1 - p, keep));
    double now = rates_change(ev_v, count - 1, keep, p, local, period, compared);
    double before = rates_change(ev_v, count - 1 - p, keep, p, local, period, compared);
    if (now <= STANDING) {
        return now;
    }
    return (now < before) ? greatest_of(now, now * now / (before - now)) : 1e+300;
}

/// Largest change of the last turns where they go to and fro about one place without a trend; 0 otherwise.
double wandering(Vector ev_t, Matrix ev_x, i64 count, i64 keep, i64 p, Vector local, Vector size, Flags compared) {
    double change{};
    if (((TURNS + 1) * p) >= least_of<i64>(count, keep)) {
        return 0.0;
    }
    const double was1 = 0.0;
    double late = was1;
    double early = was1;
    for (i64 k = 0; k < TURNS; ++k) {
        change = verdict::change(ev_t, ev_x, count, k * p, keep, p, local, size, compared);
        if (k < (floor_div(TURNS, 2))) {
            late = greatest_of(late, change);
        } else {
            early = greatest_of(early, change);
        }
    }
    double most = greatest_of(late, early);
    if (most > SMALL || most > (EVEN * least_of(late, early))) {
        return 0.0;
    }
    // What creeps adds up.
    for (i64 k = 2, k_end = TURNS + 1; k < k_end; ++k) {
        if (verdict::change(ev_t, ev_x, count, 0, keep, k * p, local, size, compared) > (TO_AND_FRO * most)) {
            return 0.0;
        }
    }
    return most;
}

/// What all periods to come will change after `d1`: a geometric series, but for rounding; 1e300 where it grows.
///
/// Changes that fall or grow evenly go on so, however small they are: a state that creeps back changes little in one
/// period, and a run that began on an unstable cycle leaves it from rounding.
double rest_change(double d1, Vector ev_t, Matrix ev_x, i64 count, i64 keep, i64 p, Vector local, Vector size,
    Flags compared, Vector rounding) {
    double scale{}, wandering{};
    double d2 = change(ev_t, ev_x, count, p, keep, p, local, size, compared);
    double d3 = (least_of<i64>(count, keep) > (3 * p)) ? change(ev_t, ev_x, count, 2 * p, keep, p, local, size,
        compared) : 0.0;
    double since = ev_t(modulo(count - 1, keep));
    // The rounding of the clock: the later in the run, the greater a share of a period it is.
    double noise = 4e-16 * since / (since - ev_t(modulo(count - 1 - p, keep)) + 1e-300);
    for (i64 i = 0; i < local.size(); ++i) {
        scale = greatest_of(local(i), 1e-06 * size(i));
        if (compared(i) && scale > 0.0) {
            noise = greatest_of(noise, rounding(i) / scale);
        }
    }
    if (d1 <= least_of(noise, STANDING)) {
        return d1;
    }
    wandering = verdict::wandering(ev_t, ev_x, count, keep, p, local, size, compared);
    if (wandering > 0.0) {
        return wandering;
    }
    double now = (d2 > 0.0) ? d1 / d2 : 0.0;
    double before = (d3 > 0.0) ? d2 / d3 : 0.0;
    if (d3 > 0.0 && std::fabs(now - before) > (0.1 * greatest_of(now, before))) {
        if (d1 < STANDING && least_of(now, before) < GROWING) {
            return greatest_of(greatest_of(d1, d2), d3);
        }
        // A decrease from one period to the next proves nothing: the changes of an oscillating decay fall and grow in
        // turn (docs/theory/simulation.md, Verdict). Nor does a steep one: the last change may be all drift.
        now = (before < 1.0) ? greatest_of(greatest_of(now, before), STEEP) : ((before < 3.0) ? std::sqrt(now *
            before) : 1.0);
    }
    return (now < 1.0) ? d1 * now / (1.0 - now) : 1e+300;
}

/// Ratio at which `d1` changes from one stretch to the next as its parts do, where they add up to it; 0 for none.
///
/// A fast transient still within the three stretches makes their changes fall steeply whatever goes on beneath; the
/// parts of the last one lie behind it. Parts that go to and fro (a cycle of several turns, an oscillating decay) do
/// not add up.
double drift(double d1, Vector ev_t, Indices ev_guard, Matrix ev_x, i64 count, i64 keep, i64 p, Vector local,
    Vector size, Flags compared) {
    double first{}, last{}, total{};
    i64 turns{};
    double ratio = 0.0;
    for (i64 part = 1, part_end = floor_div(p, 2) + 1; part < part_end; ++part) {
        if ((modulo(p, part)) == 0 && growth::repeats(ev_guard, count, keep, part)) {
            turns = floor_div(p, part);
            const double was1 = 0.0;
            first = was1;
            last = was1;
            total = was1;
            for (i64 k = 0; k < turns; ++k) {
                first = change(ev_t, ev_x, count, k * part, keep, part, local, size, compared);
                last = (k == 0) ? first : last;
                total += first;
            }
            // From the oldest part to the latest it is turns - 1 parts; a whole stretch is turns of them.
            if (d1 > (ADD_UP * total) && first > 0.0) {
                ratio = greatest_of(ratio, std::pow(last / first, turns / (turns - 1.0)));
            }
        }
    }
    return ratio;
}

/// Whether the last p events took time: rounding may move a large state across a switch and back, and switches that
/// repeat at one instant are no period.
bool takes_time(Vector ev_t, i64 count, i64 keep, i64 p) {
    double last = ev_t(modulo(count - 1, keep));
    return (last - ev_t(modulo(count - 1 - p, keep))) > (4e-15 * last);
}

/// The period among p and its parts: a part whose change is still decaying, or has come to rounding, is the whole.
///
/// The changes of an oscillating decay do not fall evenly from period to period, so that the contraction shows only
/// after several periods.
i64 shortest(Vector ev_t, Indices ev_guard, Matrix ev_x, i64 count, i64 keep, i64 p, Vector local, Vector size,
    Flags compared) {
    double now{}, before{};
    bool rests{};
    for (i64 part = 1, part_end = floor_div(p, 2) + 1; part < part_end; ++part) {
        if ((modulo(p, part)) == 0 && growth::repeats(ev_guard, count, keep, part) &&
            takes_time(ev_t, count, keep, part)) {
            now = change(ev_t, ev_x, count, 0, keep, part, local, size, compared);
            before = change(ev_t, ev_x, count, p, keep, part, local, size, compared);
            rests = now <= STANDING || wandering(ev_t, ev_x, count, keep, part, local, size, compared) > 0.0;
            if (now < 0.02 && (now < (0.5 * before) || rests)) {
                return part;
            }
        }
    }
    return p;
}

/// UNDECIDED, SETTLED or CYCLE from the buffer of the last events.
///
/// Parameters
/// ----------
/// ev_t, ev_guard, ev_x, ev_v : arrays (keep, ...)
///     Event buffer, `count` of them in all.
/// t_end : float
///     End of the run.
/// low, high, rate_end : arrays (n,) or longer
///     Least and greatest values of the state on the way; its rate at the end.
/// compared : bool array (n,)
///     States that must repeat.
/// late : bool
///     Whether elements act late: then rates at events must repeat, too, for they show what is on its way.
/// found : array (4,)
///     Filled with: events in a period, period, change of the state over the last period relative to the cycle's size,
///     and the same extrapolated to all periods to come.
i64 verdict(Vector ev_t, Indices ev_guard, Matrix ev_x, Matrix ev_v, i64 count, double t_end, Vector low, Vector high,
    Vector rate_end, Flags compared, bool late, Vector found) {
    Scope scope;
    i64 once{};
    double since{}, d1{}, rest_change{}, drift{};
    bool rest{};
    i64 keep = ev_x.shape(0);
    i64 n = ev_x.shape(1);
    i64 kept = least_of<i64>(count, keep);
    Vector size = zeros<double>(n);
    Vector rounding = zeros<double>(n);
    for (i64 i = 0; i < n; ++i) {
        size(i) = high(i) - low(i);
        rounding(i) = 4e-15 * greatest_of(std::fabs(low(i)), std::fabs(high(i)));
    }
    double quiet = (count > 0) ? t_end - ev_t(modulo(count - 1, keep)) : t_end;
    if (quiet >= (0.02 * t_end)) {
        rest = true;
        // What the rate would move in the time since the last switch, a tenth of the run at least: a slow creep is
        // no rest, however little it has moved yet.
        for (i64 i = 0; i < n; ++i) {
            if (compared(i) && (std::fabs(rate_end(i)) * greatest_of(quiet, 0.1 *
                t_end)) > greatest_of(REST_TOLERANCE * size(i), rounding(i))) {
                rest = false;
            }
        }
        if (rest) {
            return SETTLED;
        }
    }
    // Of the time of an event, too.
    for (i64 i = 0; i < n; ++i) {
        rounding(i) += (count > 0) ? 1e-15 * std::fabs(ev_v(modulo(count - 1, keep), i)) * t_end : 0.0;
    }
    double last = (count > 0) ? ev_t(modulo(count - 1, keep)) : 0.0;
    Vector low_p = full<double>(INF, n);
    Vector high_p = full<double>(-INF, n);
    Vector reach = zeros<double>(n);
    Vector local = zeros<double>(n);
    bool may_vanish = true;
    // Three stretches have to be kept of a period: one change says nothing of those to come, two have a ratio.
    for (i64 p = 1, p_end = floor_div(kept, 3) + 1; p < p_end; ++p) {
        widen(ev_t, ev_x, ev_v, count, keep, p, low_p, high_p, reach, local);
        since = greatest_of(quiet, last - ev_t(modulo(count - 1 - p, keep)));
        // What moves too far in some events does so in more of them, and in a longer time.
        for (i64 i = 0; i < n; ++i) {
            if (compared(i) && (local(i) > (REST_TOLERANCE * size(i)) || (std::fabs(rate_end(i)) * since) > (GONE *
                size(i)))) {
                may_vanish = false;
            }
        }
        d1 = change(ev_t, ev_x, count, 0, keep, p, local, size, compared);
        // Of ten thousands of switches that pile up any number may repeat itself: the change is cheaper to tell.
        if (!(may_vanish || d1 < MOST_CHANGE)) {
            continue;
        }
        if (growth::repeats(ev_guard, count, keep, p) && takes_time(ev_t, count, keep, p)) {
            if (may_vanish) {
                return SETTLED;
            }
            if (late && rates_to_change(ev_t, ev_v, count, keep, p, local, compared) > CYCLE_TOLERANCE) {
                continue;
            }
            rest_change = verdict::rest_change(d1, ev_t, ev_x, count, keep, p, local, size, compared, rounding);
            if (rest_change > STANDING) {
                drift = verdict::drift(d1, ev_t, ev_guard, ev_x, count, keep, p, local, size, compared);
                rest_change = greatest_of(rest_change, (drift < 1.0) ? d1 * drift / (1.0 - drift) : 1e+300);
            }
            if (d1 < MOST_CHANGE && rest_change < CYCLE_TOLERANCE) {
                once = shortest(ev_t, ev_guard, ev_x, count, keep, p, local, size, compared);
                found(0) = once;
                found(3) = rest_change;
                found(2) = change(ev_t, ev_x, count, 0, keep, once, local, size, compared);
                found(1) = ev_t(modulo(count - 1, keep)) - ev_t(modulo(count - 1 - once, keep));
                return CYCLE;
            }
        }
    }
    return UNDECIDED;
}

/// Least and greatest values of the state over the kept events of the second half of a run, or zeros.
///
/// A state may be zero at every event, as a speed is where a motion turns: how far it goes between two follows from
/// its rate.
std::tuple<Vector, Vector> late_range(Vector ev_t, Matrix ev_x, Matrix ev_v, i64 count, double t_end) {
    i64 at{}, after{};
    double between{};
    i64 keep = ev_x.shape(0);
    i64 n = ev_x.shape(1);
    Vector low = zeros<double>(n);
    Vector high = zeros<double>(n);
    for (i64 k = 0, k_end = least_of<i64>(count, keep); k < k_end; ++k) {
        at = modulo(count - 1 - k, keep);
        after = (k == 0) ? at : modulo(count - k, keep);
        if (ev_t(at) < (0.5 * t_end)) {
            break;
        }
        for (i64 i = 0; i < n; ++i) {
            between = 0.1 * std::fabs(ev_v(at, i)) * (ev_t(after) - ev_t(at));
            low(i) = (k == 0) ? ev_x(at, i) : least_of(low(i), ev_x(at, i));
            high(i) = (k == 0) ? ev_x(at, i) : greatest_of(high(i), greatest_of(ev_x(at, i), low(i) + between));
        }
    }
    return {low, high};
}

/// UNDECIDED, SETTLED, CYCLE or GROWS for a run of a model; the arguments are those of `verdict` and `grows`.
i64 verdict_of_run(const Model& model, Vector ev_t, Indices ev_guard, Matrix ev_x, Matrix ev_v, i64 count,
    double t_end, Vector low, Vector high, Vector x_end, Vector rate_end, Flags compared, Vector found) {
    Scope scope;
    bool moves{}, goes_on{};
    i64 again{};
    Vector low_late{}, high_late{};
    bool late = model.smooth_kind.any([&](auto one) { return one == DELAY_LINE; });
    i64 code = verdict(ev_t, ev_guard, ev_x, ev_v, count, t_end, low, high, rate_end, compared, late, found);
    // Beside a start a million times farther out a cycle seems to be rest: switches that go on are held against what
    // moves while they do.
    if (code == SETTLED) {
        std::tie(low_late, high_late) = late_range(ev_t, ev_x, ev_v, count, t_end);
        moves = false;
        for (i64 i = 0; i < compared.size(); ++i) {
            moves = moves || (compared(i) && (high_late(i) - low_late(i)) > (ROUNDED * (high(i) - low(i))));
        }
        if (!moves) {
            return SETTLED;
        }
        again = verdict(ev_t, ev_guard, ev_x, ev_v, count, t_end, low_late, high_late, rate_end, compared, late, found);
        goes_on = again == CYCLE && (t_end - ev_t(modulo(count - 1, ev_t.shape(0)))) <= found(1);
        return goes_on ? CYCLE : SETTLED;
    }
    if (code == UNDECIDED && growth::grows(model, ev_t, ev_guard, ev_x, ev_v, count, t_end, x_end, rate_end,
        compared)) {
        return GROWS;
    }
    return code;
}

/// Whether elements see but `rounding` of a motion, and the largest share of it that they change in a period.
///
/// Parameters
/// ----------
/// states, memory, moves : arrays, shapes (events, n), (events, h), (n,)
///     At the events, and how far each state moves at most.
/// period : float
/// compared : bool array, shape (n,)
///     States that belong to the motion.
/// on_inputs : array, shape (z, n + h)
///     Sizes of the gains from states and memory values to the elements' inputs.
/// elements : arrays, shapes (elements, z), (elements,)
///     Largest weights of the inputs in the guards of each element, and its largest threshold.
/// changes : arrays, shapes (n,), (z,)
///     Most by which the outputs change the rates of the states, and the inputs at once.
/// rounding : float
///     Movement of an element's input that is rounding, relative to its thresholds and to the terms of its value.
std::tuple<bool, double> rounding_of_motion(Matrix states, Matrix memory, Vector moves, double period, Flags compared,
    Matrix on_inputs, const std::tuple<Matrix, Vector>& elements, const std::tuple<Vector, Vector>& changes,
    double rounding) {
    Scope scope;
    Matrix weights{};
    Vector levels{};
    double size{}, low{}, high{}, moved{};
    i64 n_z = on_inputs.shape(0);
    i64 n = states.shape(1);
    i64 h = memory.shape(1);
    Vector most = empty<double>(n + h);
    Vector span = empty<double>(n + h);
    for (i64 j = 0; j < n; ++j) {
        size = 0.0;
        for (i64 i = 0; i < states.shape(0); ++i) {
            size = greatest_of(size, std::fabs(states(i, j)));
        }
        most(j) = size + moves(j);
        span(j) = moves(j);
    }
    for (i64 j = 0; j < h; ++j) {
        size = 0.0;
        low = memory(0, j);
        high = memory(0, j);
        for (i64 i = 0; i < memory.shape(0); ++i) {
            size = greatest_of(size, std::fabs(memory(i, j)));
            low = least_of(low, memory(i, j));
            high = greatest_of(high, memory(i, j));
        }
        most(n + j) = size;
        span(n + j) = high - low;
    }
    double share = 0.0;
    Vector place = zeros<double>(n_z);
    Vector amplitude = zeros<double>(n_z);
    for (i64 j = 0; j < n; ++j) {
        if (compared(j) && std::get<0>(changes)(j) > 0.0) {
            share = greatest_of(share, std::get<0>(changes)(j) * period / most(j));
        }
    }
    for (i64 k = 0; k < n_z; ++k) {
        // Of a difference, as of a setpoint and what is held on it, the terms round, however small their sum.
        for (i64 j = 0, j_end = n + h; j < j_end; ++j) {
            place(k) += on_inputs(k, j) * most(j);
            amplitude(k) += on_inputs(k, j) * span(j);
        }
        if (std::get<1>(changes)(k) > 0.0) {
            share = greatest_of(share, std::get<1>(changes)(k) / place(k));
        }
    }
    std::tie(weights, levels) = elements;
    bool sees = false;
    bool lost = true;
    for (i64 e = 0; e < levels.size(); ++e) {
        size = levels(e);
        moved = 0.0;
        for (i64 k = 0; k < n_z; ++k) {
            size += weights(e, k) * place(k);
            moved += weights(e, k) * amplitude(k);
        }
        lost = lost && !(moved > (rounding * size));
        sees = sees || size > 0.0;
    }
    return {lost && sees, share};
}

}  // namespace verdict
}  // namespace EPP_ARCH
}  // namespace epp
