"""Compiled: what a run came to, read from its last events: at rest, on a cycle, growing without end, or neither."""

import numpy as np

from eppanalysis.kernels.compiling import KERNEL, PART, njit
from eppanalysis.kernels.engine.series import DELAY_LINE
from eppanalysis.kernels.growth import grows, repeats

UNDECIDED, SETTLED, CYCLE, GROWS = 0, 1, 2, 3
#: A cycle is accepted when its extrapolated limit is this close, relative to its own size.
CYCLE_TOLERANCE = 1e-3
#: And when it has changed no more than this in the last period.
MOST_CHANGE = 0.02
#: A state is at rest when its rate moves it by less than this in the time since the last switch, relative to its
#: movement before.
REST_TOLERANCE = 1e-6
#: A cycle has vanished only if nothing moves by more than this after its last switch, relative to the movement before.
GONE = 1e-3
#: Movement below this, relative to the movement before, may be rounding.
ROUNDED = 1e-10
#: Changes from period to period below this, relative to the cycle's size, may be rounding.
STANDING = 1e-9
#: Changes below the first may be rounding that a stiff motion enlarges, where over so many turns all together are no
#: more than so often the largest, and neither half of them is so much the larger: even growth or decay, of any ratio,
#: fails one or the other.
_SMALL, _TURNS, _TO_AND_FRO, _EVEN = 1e-7, 16, 3.0, 10.0
#: Changes that grow by more than this from period to period are not.
GROWING = 1.5
#: Changes that do not fall evenly are taken to fall no faster than this from period to period.
STEEP = 0.5
#: The changes of parts of a period add up to that of the whole where it is more than this share of their sum.
ADD_UP = 0.5


@njit(**KERNEL)
def verdict_of_run(model, ev_t, ev_guard, ev_x, ev_v, count, t_end, low, high, x_end, rate_end, compared, found):
    """UNDECIDED, SETTLED, CYCLE or GROWS for a run of a model; the arguments are those of `verdict` and `grows`."""
    late = np.any(model.smooth_kind == DELAY_LINE)
    code = verdict(ev_t, ev_guard, ev_x, ev_v, count, t_end, low, high, rate_end, compared, late, found)
    if code == SETTLED:
        # Beside a start a million times farther out a cycle seems to be rest: switches that go on are held against what
        # moves while they do.
        low_late, high_late = _late_range(ev_t, ev_x, count, t_end)
        if not np.any((high_late - low_late > ROUNDED * (high - low)[: compared.size]) & compared):
            return SETTLED
        again = verdict(ev_t, ev_guard, ev_x, ev_v, count, t_end, low_late, high_late, rate_end, compared, late, found)
        goes_on = again == CYCLE and t_end - ev_t[(count - 1) % len(ev_t)] <= found[1]
        return CYCLE if goes_on else SETTLED
    if code == UNDECIDED and grows(model, ev_t, ev_guard, ev_x, ev_v, count, t_end, x_end, rate_end, compared):
        return GROWS
    return code


@njit(**PART)
def _late_range(ev_t, ev_x, count, t_end):
    """Least and greatest values of the state at the kept events of the second half of a run, or zeros."""
    keep, n = ev_x.shape
    low, high = np.zeros(n), np.zeros(n)
    for k in range(min(count, keep)):
        at = (count - 1 - k) % keep
        if ev_t[at] < 0.5 * t_end:
            break
        for i in range(n):
            low[i] = ev_x[at, i] if k == 0 else min(low[i], ev_x[at, i])
            high[i] = ev_x[at, i] if k == 0 else max(high[i], ev_x[at, i])
    return low, high


@njit(**PART)
def verdict(ev_t, ev_guard, ev_x, ev_v, count, t_end, low, high, rate_end, compared, late, found):
    """UNDECIDED, SETTLED or CYCLE from the buffer of the last events.

    Parameters
    ----------
    ev_t, ev_guard, ev_x, ev_v : arrays (keep, ...)
        Event buffer, `count` of them in all.
    t_end : float
        End of the run.
    low, high, rate_end : arrays (n,) or longer
        Least and greatest values of the state on the way; its rate at the end.
    compared : bool array (n,)
        States that must repeat.
    late : bool
        Whether elements act late: then rates at events must repeat, too, for they show what is on its way.
    found : array (4,)
        Filled with: events in a period, period, change of the state over the last period relative to the cycle's size,
        and the same extrapolated to all periods to come.
    """
    keep, n = ev_x.shape
    kept = min(count, keep)
    size, rounding = np.zeros(n), np.zeros(n)
    for i in range(n):
        size[i] = high[i] - low[i]
        rounding[i] = 4e-15 * max(abs(low[i]), abs(high[i]))
    quiet = t_end - ev_t[(count - 1) % keep] if count > 0 else t_end
    if quiet >= 0.02 * t_end:
        rest = True
        for i in range(n):
            # What the rate would move in the time since the last switch, a tenth of the run at least: a slow creep is
            # no rest, however little it has moved yet.
            if compared[i] and abs(rate_end[i]) * max(quiet, 0.1 * t_end) > max(REST_TOLERANCE * size[i], rounding[i]):
                rest = False
        if rest:
            return SETTLED
    for i in range(n):
        # Of the time of an event, too.
        rounding[i] += 1e-15 * abs(ev_v[(count - 1) % keep, i]) * t_end if count > 0 else 0.0
    last = ev_t[(count - 1) % keep] if count > 0 else 0.0
    low_p, high_p, reach, local = np.full(n, np.inf), np.full(n, -np.inf), np.zeros(n), np.zeros(n)
    may_vanish = True
    # Three stretches have to be kept of a period: one change says nothing of those to come, two have a ratio.
    for p in range(1, kept // 3 + 1):
        _widen(ev_t, ev_x, ev_v, count, keep, p, low_p, high_p, reach, local)
        since = max(quiet, last - ev_t[(count - 1 - p) % keep])
        # What moves too far in some events does so in more of them, and in a longer time.
        for i in range(n):
            if compared[i] and (local[i] > REST_TOLERANCE * size[i] or abs(rate_end[i]) * since > GONE * size[i]):
                may_vanish = False
        d1 = _change(ev_t, ev_x, count, 0, keep, p, local, size, compared)
        # Of ten thousands of switches that pile up any number may repeat itself: the change is cheaper to tell.
        if not (may_vanish or d1 < MOST_CHANGE):
            continue
        # Rounding may move a large state across a switch and back: switches that repeat at one instant are no period.
        if repeats(ev_guard, count, keep, p) and last - ev_t[(count - 1 - p) % keep] > 4e-15 * last:
            if may_vanish:
                return SETTLED
            if late and _rates_to_change(ev_t, ev_v, count, keep, p, local, compared) > CYCLE_TOLERANCE:
                continue
            rest_change = _rest_change(d1, ev_t, ev_x, count, keep, p, local, size, compared, rounding)
            if rest_change > STANDING:
                drift = _drift(d1, ev_t, ev_guard, ev_x, count, keep, p, local, size, compared)
                rest_change = max(rest_change, d1 * drift / (1.0 - drift) if drift < 1.0 else 1e300)
            if d1 < MOST_CHANGE and rest_change < CYCLE_TOLERANCE:
                once = _shortest(ev_t, ev_guard, ev_x, count, keep, p, local, size, compared)
                found[0], found[3] = once, rest_change
                found[2] = _change(ev_t, ev_x, count, 0, keep, once, local, size, compared)
                found[1] = ev_t[(count - 1) % keep] - ev_t[(count - 1 - once) % keep]
                return CYCLE
    return UNDECIDED


@njit(**PART)
def _rest_change(d1, ev_t, ev_x, count, keep, p, local, size, compared, rounding):
    """What all periods to come will change after `d1`: a geometric series, but for rounding; 1e300 where it grows.

    Changes that fall or grow evenly go on so, however small they are: a state that creeps back changes little in one
    period, and a run that began on an unstable cycle leaves it from rounding.
    """
    d2 = _change(ev_t, ev_x, count, p, keep, p, local, size, compared)
    d3 = _change(ev_t, ev_x, count, 2 * p, keep, p, local, size, compared) if min(count, keep) > 3 * p else 0.0
    since = ev_t[(count - 1) % keep]
    # The rounding of the clock: the later in the run, the greater a share of a period it is.
    noise = 4e-16 * since / (since - ev_t[(count - 1 - p) % keep] + 1e-300)
    for i in range(local.size):
        scale = max(local[i], 1e-6 * size[i])
        if compared[i] and scale > 0.0:
            noise = max(noise, rounding[i] / scale)
    if d1 <= min(noise, STANDING):
        return d1
    wandering = _wandering(ev_t, ev_x, count, keep, p, local, size, compared)
    if wandering > 0.0:
        return wandering
    now, before = d1 / d2 if d2 > 0.0 else 0.0, d2 / d3 if d3 > 0.0 else 0.0
    if d3 > 0.0 and abs(now - before) > 0.1 * max(now, before):
        if d1 < STANDING and min(now, before) < GROWING:
            return max(d1, d2, d3)
        # A decrease from one period to the next proves nothing: the changes of an oscillating decay fall and grow in
        # turn (docs/theory/simulation.md, Verdict). Nor does a steep one: the last change may be all drift.
        now = max(now, before, STEEP) if before < 1.0 else np.sqrt(now * before) if before < 3.0 else 1.0
    return d1 * now / (1.0 - now) if now < 1.0 else 1e300


@njit(**PART)
def _wandering(ev_t, ev_x, count, keep, p, local, size, compared):
    """Largest change of the last turns where they go to and fro about one place without a trend; 0 otherwise."""
    if (_TURNS + 1) * p >= min(count, keep):
        return 0.0
    late = early = 0.0
    for k in range(_TURNS):
        change = _change(ev_t, ev_x, count, k * p, keep, p, local, size, compared)
        if k < _TURNS // 2:
            late = max(late, change)
        else:
            early = max(early, change)
    most = max(late, early)
    if most > _SMALL or most > _EVEN * min(late, early):
        return 0.0
    for k in range(2, _TURNS + 1):
        # What creeps adds up.
        if _change(ev_t, ev_x, count, 0, keep, k * p, local, size, compared) > _TO_AND_FRO * most:
            return 0.0
    return most


@njit(**PART)
def _drift(d1, ev_t, ev_guard, ev_x, count, keep, p, local, size, compared):
    """Ratio at which `d1` changes from one stretch to the next as its parts do, where they add up to it; 0 for none.

    A fast transient still within the three stretches makes their changes fall steeply whatever goes on beneath; the
    parts of the last one lie behind it. Parts that go to and fro (a cycle of several turns, an oscillating decay) do
    not add up.
    """
    ratio = 0.0
    for part in range(1, p // 2 + 1):
        if p % part == 0 and repeats(ev_guard, count, keep, part):
            turns = p // part
            first = last = total = 0.0
            for k in range(turns):
                first = _change(ev_t, ev_x, count, k * part, keep, part, local, size, compared)
                last = first if k == 0 else last
                total += first
            if d1 > ADD_UP * total and first > 0.0:
                # From the oldest part to the latest it is turns - 1 parts; a whole stretch is turns of them.
                ratio = max(ratio, (last / first) ** (turns / (turns - 1.0)))
    return ratio


@njit(**PART)
def _shortest(ev_t, ev_guard, ev_x, count, keep, p, local, size, compared):
    """The period among p and its parts: a part whose change is still decaying, or has come to rounding, is the whole.

    The changes of an oscillating decay do not fall evenly from period to period, so that the contraction shows only
    after several periods.
    """
    for part in range(1, p // 2 + 1):
        if p % part == 0 and repeats(ev_guard, count, keep, part):
            now = _change(ev_t, ev_x, count, 0, keep, part, local, size, compared)
            before = _change(ev_t, ev_x, count, p, keep, part, local, size, compared)
            rests = now <= STANDING or _wandering(ev_t, ev_x, count, keep, part, local, size, compared) > 0.0
            if now < 0.02 and (now < 0.5 * before or rests):
                return part
    return p


@njit(**PART)
def _rates_to_change(ev_t, ev_v, count, keep, p, local, compared):
    """What the rates at events will change in all periods to come, by a geometric series; 1e300 where it grows."""
    period = ev_t[(count - 1) % keep] - ev_t[(count - 1 - p) % keep]
    now = _rates_change(ev_v, count - 1, keep, p, local, period, compared)
    before = _rates_change(ev_v, count - 1 - p, keep, p, local, period, compared)
    if now <= STANDING:
        return now
    return max(now, now * now / (before - now)) if now < before else 1e300


@njit(**PART)
def _rates_change(ev_v, last, keep, p, local, period, compared):
    """Largest change of the rates at events over the period up to one, relative to the largest rate in it.

    That is at least the mean one: where events are the turns of a motion, its rates there are rounding.
    """
    worst = 0.0
    for i in range(compared.size):
        size, change = local[i] / period, 0.0
        for k in range(p):
            now, before = ev_v[(last - k) % keep, i], ev_v[(last - k - p) % keep, i]
            size, change = max(size, abs(now)), max(change, abs(now - before))
        if compared[i] and size > 0.0:
            worst = max(worst, change / size)
    return worst


@njit(**PART)
def _widen(ev_t, ev_x, ev_v, count, keep, p, low, high, reach, out):
    """How far each state moves over the last p events, from its values there and its rates on the way.

    `low`, `high` and `reach` hold what the last p - 1 events tell.
    """
    here, before = (count - p) % keep, (count - 1 - p) % keep
    for i in range(out.size):
        low[i], high[i] = min(low[i], ev_x[here, i], ev_x[before, i]), max(high[i], ev_x[here, i], ev_x[before, i])
        reach[i] = max(reach[i], 0.1 * abs(ev_v[here, i]) * (ev_t[here] - ev_t[before]))
        out[i] = max(high[i] - low[i], reach[i])


@njit(**PART)
def _change(ev_t, ev_x, count, back, keep, p, local, size, compared):
    """Largest change over the period that ended `back` events ago, relative to the cycle's size.

    That of the period itself counts, too: what creeps towards rest may return ever later to the very same states.
    """
    last, worst = count - 1 - back, 0.0
    if back + 2 * p < min(count, keep):
        now = ev_t[last % keep] - ev_t[(last - p) % keep]
        before = ev_t[(last - p) % keep] - ev_t[(last - 2 * p) % keep]
        if now + before > 0.0:
            worst = abs(now - before) / max(now, before)
    for i in range(local.size):
        if not compared[i]:
            continue
        # A state that stands still on the cycle is held against how far it has moved in the run, or its rounding would
        # be a change.
        scale = max(local[i], 1e-6 * size[i])
        if scale > 0.0:
            worst = max(worst, abs(ev_x[last % keep, i] - ev_x[(last - p) % keep, i]) / scale)
    return worst


@njit(**KERNEL, error_model="numpy")
def rounding_of_motion(states, memory, moves, period, compared, gains, elements, changes, rounding):
    """Whether elements see but `rounding` of a motion, and the largest share of it that they change in a period.

    Parameters
    ----------
    states, memory, moves : arrays, shapes (events, n), (events, h), (n,)
        At the events, and how far each state moves at most.
    period : float
    compared : bool array, shape (n,)
        States that belong to the motion.
    gains : arrays on_states (z, n), on_memory (z, h), sizes (z, n + h)
        From states and memory values to the elements' inputs, and sizes of both.
    elements : arrays, shapes (elements, z), (elements,)
        Largest weights of the inputs in the guards of each element, and its largest threshold.
    changes : arrays, shapes (n,), (z,)
        Most by which the outputs change the rates of the states, and the inputs at once.
    rounding : float
        Movement of an element's input that is rounding, relative to its thresholds and to its value.
    """
    on_states, on_memory, on_inputs = gains
    (n_z, n), h = on_states.shape, memory.shape[1]
    most, span = np.empty(n + h), np.empty(n + h)
    for j in range(n):
        size = 0.0
        for i in range(len(states)):
            size = max(size, abs(states[i, j]))
        most[j], span[j] = size + moves[j], moves[j]
    for j in range(h):
        size, low, high = 0.0, memory[0, j], memory[0, j]
        for i in range(len(memory)):
            size, low, high = max(size, abs(memory[i, j])), min(low, memory[i, j]), max(high, memory[i, j])
        most[n + j], span[n + j] = size, high - low
    share, place, amplitude = 0.0, np.zeros(n_z), np.zeros(n_z)
    for j in range(n):
        if compared[j] and changes[0][j] > 0.0:
            share = max(share, changes[0][j] * period / most[j])
    for k in range(n_z):
        seen = 0.0
        for j in range(n + h):
            seen += on_inputs[k, j] * most[j]
            amplitude[k] += on_inputs[k, j] * span[j]
        if changes[1][k] > 0.0:
            share = max(share, changes[1][k] / seen)
        for i in range(len(states)):
            value = 0.0
            for j in range(n):
                value += on_states[k, j] * states[i, j]
            for j in range(h):
                value += on_memory[k, j] * memory[i, j]
            place[k] = max(place[k], abs(value))
    weights, levels = elements
    sees, lost = False, True
    for e in range(levels.size):
        size, moved = levels[e], 0.0
        for k in range(n_z):
            size += weights[e, k] * place[k]
            moved += weights[e, k] * amplitude[k]
        lost = lost and not moved > rounding * size
        sees = sees or size > 0.0
    return lost and sees, share
