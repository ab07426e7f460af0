"""Compiled: a run that has closed to rounding repeats itself, and need not be computed again.

A run is taken as closed when three periods in a row agree at every event to rounding, after a contraction that has been
seen (a run that starts on a cycle, stable or not, shows none and is computed through), and when what the contraction
still leaves to come is below rounding too.
"""

import numpy as np

from eppanalysis.kernels.compiling import njit
from eppanalysis.kernels.engine.modes import find_combination
from eppanalysis.kernels.engine.signals import write_rest
from eppanalysis.kernels.engine.tables import HOT, INLINE
from eppanalysis.kernels.simd.vectors import take, take_larger

#: Longest period looked for, in events, and how many periods a contraction is looked back for.
MOST_EVENTS, MOST_TURNS = 128, 64
#: Changes of the events' states over a period, relative to the largest states so far: contraction must have been seen
#: from the first one down, and a closer comparison begins below the second.
APART, NEAR = 1e-7, 1e-11
#: All changes still to come, relative to the cycle's own size.
ROUNDING = 5e-13


@njit(**HOT)
def carry_on(workspace, samples, buffer, now):
    """Where the run has closed by its last event, carry it through all whole periods to come."""
    take_larger(workspace.largest, workspace.x, workspace.largest)
    p_events = closing(workspace.watch, now.count, buffer, workspace.largest)
    if p_events == 0:
        return
    now.watched = False
    turns, period, n_aside = _whole_periods(
        buffer, workspace, samples, now.i_sample, now.t, now.t_end, now.count, p_events
    )
    now.periods_repeated = turns
    if turns == 0:
        return
    now.count += turns * p_events
    now.max_events += turns * p_events  # only what is computed counts
    now.t_behind, now.i_behind = now.t + turns * period, now.i_sample + n_aside
    if n_aside > 0:
        # Their samples are taken in one more period, in the order of their phases.
        copy_start(
            workspace.x, workspace.modes, workspace.H, workspace.behind_x, workspace.behind_modes, workspace.behind_H
        )
        take(workspace.behind_recent, workspace.recent)
        now.aside, now.t, now.until = True, 0.0, period
        now.i_sample, now.n_samples = samples.phases.size, samples.phases.size + n_aside
    else:
        now.t, now.i_sample = now.t_behind, now.i_behind
    now.origin, now.last_t, now.same_instant = 0.0, now.t, 0


@njit(**HOT)
def _whole_periods(buffer, workspace, samples, first, t, t_end, count, p):
    """Enter the events of all whole periods (of p events) to come into the event buffer, and sort their samples by
    phase.

    Returns how many periods, their length, and how many samples from `first` on fall into them.
    """
    keep = buffer.t.size
    # Over two periods, which halves what the rounding of two times of events makes of it.
    period = 0.5 * (buffer.t[(count - 1) % keep] - buffer.t[(count - 1 - 2 * p) % keep])
    turns = 0
    # Switches that pile up at one instant have no period.
    if period > 1e-12 * t:
        turns = max(0, int((t_end - t) / period))
    if turns == 0:
        return 0, period, 0
    repeat_events(turns, p, period, count, workspace.once, buffer)
    return turns, period, _sort_samples(samples, first, t, period, turns)


@njit(**HOT)
def _sort_samples(samples, first, t, period, turns):
    """Sort the samples from `first` on, of all whole periods to come, by phase behind the others; returns how many."""
    times, phases, nt = samples.times, samples.phases, samples.phases.size
    n, end, per_second = 0, t + turns * period, 1.0 / period
    while first + n < nt and times[first + n] < end:
        after = times[first + n] - t
        phases[n] = max(0.0, after - np.floor(after * per_second) * period)
        n += 1
    if n > 0:
        sort_into(phases[:n], period, samples.order, samples.bins[: n + 1])
        for i in range(n):
            samples.times[nt + i], samples.rows[nt + i] = phases[samples.order[i]], first + samples.order[i]
    return n


@njit(**HOT)
def come_back(model, compiled, work, workspace, samples, now):
    """Back from the period that served the samples of all periods to come, to the time behind them."""
    first, stop = now.i_sample, now.n_samples
    write_rest(compiled, now.q, workspace.x, workspace.still, workspace.Sg[0], samples.rows, first, stop, samples.out)
    copy_start(
        workspace.behind_x, workspace.behind_modes, workspace.behind_H, workspace.x, workspace.modes, workspace.H
    )
    take(workspace.recent, workspace.behind_recent)
    now.aside, now.t, now.until = False, now.t_behind, now.t_end
    now.i_sample, now.n_samples = now.i_behind, samples.phases.size
    now.origin, now.last_t, now.same_instant, now.quiet = 0.0, now.t, 0, 0
    now.armed = now.entered = False
    now.q = find_combination(model, compiled, work, workspace.modes, now.base_step)


@njit(**HOT)
def copy_start(x, modes, H, to_x, to_modes, to_H):
    """State, modes and memory values to another place."""
    take(to_x, x)
    for i in range(modes.size):
        to_modes[i] = modes[i]
    for i in range(H.size):
        to_H[i] = H[i]


@njit(**HOT)
def closing(watch, count, buffer, largest):
    """Events in the period on which the run has closed; 0 as long as it has not.

    `watch` holds, from event to event: events in the candidate period, how many events in a row were near their
    predecessors, and eighths of the events seen so far. (Events that belong to one jump come together.)
    """
    c, p, keep, ev_guard, ev_x = count - 1, int(watch[0]), buffer.t.size, buffer.guard, buffer.x
    look = count // 8 > watch[2]
    watch[2] = count // 8
    if p == 0:
        if look:
            watch[0], watch[1] = _candidate(ev_guard, count, keep), 0.0
        return 0
    if ev_guard[c % keep] != ev_guard[(c - p) % keep]:
        watch[0] = 0.0
        return 0
    if _apart(c, p, keep, ev_x, largest) > NEAR:
        watch[1] = 0.0
        return 0
    watch[1] += 1.0
    # Two periods of events near their predecessors are three periods that agree (docs/theory/engine.md, Repetition).
    if watch[1] < 2 * p:
        return 0
    watch[1] = p
    # Back to where the change was still far above rounding: without a contraction that was seen, as on a cycle from the
    # start, small changes prove nothing.
    change = max(_change(c, p, buffer, largest), 1e-16)
    for k in range(1, MOST_TURNS):
        if (k + 1) * p >= min(count, keep) or ev_guard[(c - k * p) % keep] != ev_guard[c % keep]:
            return 0
        before = _apart(c - k * p, p, keep, ev_x, largest)
        if before > APART:
            # From `before` to `change` in k turns: as a geometric series the changes to come add up to
            # change/(1 - ratio), which must be rounding (docs/theory/engine.md, Repetition).
            return p if change < ROUNDING * (1.0 - (change / before) ** (1.0 / k)) else 0
    return 0


@njit(**HOT)
def _candidate(ev_guard, count, keep):
    """Smallest number of events after which the guards repeat, twice over; 0 when there is none."""
    for p in range(1, min(MOST_EVENTS, min(count, keep) // 3) + 1):
        same = True
        for k in range(2 * p):
            if ev_guard[(count - 1 - k) % keep] != ev_guard[(count - 1 - k - p) % keep]:
                same = False
                break
        if same:
            return p
    return 0


@njit(**HOT)
def _apart(c, p, keep, ev_x, largest):
    """Change of the state from event c - p to event c, relative to the largest states."""
    worst = 0.0
    for i in range(ev_x.shape[1]):
        d = abs(ev_x[c % keep, i] - ev_x[(c - p) % keep, i])
        if d > worst * largest[i]:
            worst = d / largest[i] if largest[i] > 0.0 else np.inf
    return worst


@njit(**HOT)
def _change(c, p, buffer, largest):
    """Largest change over a period within the last two, relative to the cycle's own size; infinite for other modes."""
    worst, keep, ev_x, ev_H, ev_modes = 0.0, buffer.t.size, buffer.x, buffer.H, buffer.modes
    for k in range(2 * p):
        for e in range(ev_modes.shape[1]):
            if ev_modes[(c - k) % keep, e] != ev_modes[(c - k - p) % keep, e]:
                return np.inf
    n = ev_x.shape[1]
    for i in range(n + ev_H.shape[1]):
        is_memory = i >= n
        j = i - n if is_memory else i
        values = ev_H if is_memory else ev_x
        low = high = values[c % keep, j]
        # A state may be zero at its own switches, so the largest value so far counts too.
        size, d = 0.0 if is_memory else largest[i], 0.0
        for k in range(2 * p):
            v = values[(c - k) % keep, j]
            low, high, size = min(low, v), max(high, v), max(size, abs(v))
            d = max(d, abs(v - values[(c - k - p) % keep, j]))
        scale = max(high - low, 1e-3 * size)
        if d > worst * scale:
            worst = d / scale if scale > 0.0 else np.inf
    return worst


@njit(**HOT)
def repeat_events(turns, p, period, count, times, buffer):
    """Enter the events of `turns` more periods of `p` events into the event buffer; `times` has room for p of them."""
    keep = buffer.t.size
    for k in range(p):
        times[k] = buffer.t[(count - p + k) % keep]
    first = max(0, turns * p - keep)
    first -= first % p  # of more than the buffer holds the last ones, from the begin of a turn on
    for k in range(first, turns * p):
        r, source = (count + k) % keep, (count - p + k % p) % keep
        if k >= first + p:
            source = (count + k - p) % keep
        buffer.t[r] = times[k % p] + (k // p + 1) * period
        buffer.guard[r] = buffer.guard[source]
        for i in range(buffer.x.shape[1]):
            buffer.x[r, i], buffer.v[r, i] = buffer.x[source, i], buffer.v[source, i]
        for i in range(buffer.H.shape[1]):
            buffer.H[r, i] = buffer.H[source, i]
        for i in range(buffer.modes.shape[1]):
            buffer.modes[r, i] = buffer.modes[source, i]


@njit(**HOT)
def sort_into(phases, period, order, first):
    """Places of `phases`, all in [0, period), in increasing order; `first` is workspace of at least as many bins.

    Evenly spread phases fall about one to a bin, so that the insertions that finish the work are few.
    """
    n, bins = phases.size, first.size - 1
    scale = bins / period
    for b in range(bins + 1):
        first[b] = 0
    for i in range(n):
        first[_bin(phases[i], scale, bins) + 1] += 1
    for b in range(bins):
        first[b + 1] += first[b]
    for i in range(n):
        b = _bin(phases[i], scale, bins)
        order[first[b]] = i
        first[b] += 1
    for k in range(1, n):
        i, j = order[k], k
        while j > 0 and phases[order[j - 1]] > phases[i]:
            order[j] = order[j - 1]
            j -= 1
        order[j] = i


@njit(**INLINE)
def _bin(phase, scale, bins):
    return min(bins - 1, max(0, int(phase * scale)))
