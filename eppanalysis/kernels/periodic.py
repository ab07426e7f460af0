"""Compiled: Fourier series and the automaton of an element whose input is one.

A series is a row of complex coefficients c[0..n], real c[0], and stands for ``Re(sum c[k] exp(j k phi))``. Between its
extrema it is monotone, so that its next rise through a level is found to rounding; guards are multiples of few series.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from eppanalysis.arrays import Array, IntArray
from eppanalysis.kernels.compiling import KERNEL, PART, njit
from eppanalysis.kernels.filling import fill
from eppanalysis.kernels.simd.tuples import by_address

TURN = 2.0 * math.pi
#: Samples per wave of the highest harmonic (and at least so many in all) by which extrema are bracketed.
_PER_WAVE, _LEAST = 8, 32
ROUNDING = 1e-13
_MOST_STEPS = 60
#: Periods after which an automaton has to have come back, to what share of its input; how much larger the motion is
#: from which it comes; what :func:`settle` says instead of a number of switches.
_MOST_PERIODS, _SAME, _EXCURSION = 6, 1e-9, 4.0
ENDLESS, UNSETTLED = -1, -2

_COMPILED = {**KERNEL, "error_model": "numpy"}
#: Those that only kernels call.
_INNER = {**PART, "error_model": "numpy"}


@by_address
class Table(NamedTuple):
    """Mode guards (s) and modes (m) of an automaton as arrays; memory values h, inputs z in their roles, outputs w.

    A mode guard of a mode fires where ``factor * series + on_memory @ h + on_clock * time + constant`` rises through
    zero (`series` -1: it has none), writes ``from_input @ z + from_memory @ h + memory_constant`` into the memory
    values, and leads to the mode `target`. `on_free` and `on_rate` are what ``factor * series`` is of the free input
    and of its rate, `free_series` and `rate_series` what each series is. In a mode an output is ``w_free * z + w_rate *
    dz/dt + w_memory @ h + w_constant``.
    """

    roles: IntArray  # (inputs,): 0 the free series, 1 its rate, 2 the time
    first: IntArray  # (m + 1,): first mode guard of each mode
    series: IntArray
    factor: Array
    constant: Array
    on_memory: Array  # (s, h)
    on_clock: Array
    target: IntArray
    from_input: Array  # (s, h, inputs)
    from_memory: Array  # (s, h, h)
    memory_constant: Array  # (s, h)
    on_free: Array
    on_rate: Array
    free_series: Array  # (S,)
    rate_series: Array  # (S,)
    w_free: Array  # (m, w)
    w_rate: Array  # (m, w)
    w_memory: Array  # (m, w, h)
    w_constant: Array  # (m, w)


@njit(**_INNER)
def series_at(c, phi):
    """Value and slope of a series (n + 1,) at a phase."""
    step = complex(math.cos(phi), math.sin(phi))
    wave = complex(1.0, 0.0)
    value, slope = c[0].real, 0.0
    for k in range(1, c.size):
        wave *= step
        value += c[k].real * wave.real - c[k].imag * wave.imag
        slope -= k * (c[k].real * wave.imag + c[k].imag * wave.real)
    return value, slope


@njit(**_INNER)
def _slope_and_bend(c, step):
    """First and second derivative of a series at the phase whose wave is `step`."""
    wave = complex(1.0, 0.0)
    slope, bend = 0.0, 0.0
    for k in range(1, c.size):
        wave *= step
        slope -= k * (c[k].real * wave.imag + c[k].imag * wave.real)
        bend -= k * k * (c[k].real * wave.real - c[k].imag * wave.imag)
    return slope, bend


@njit(**_INNER)
def _turning_point(c, low, high, rising):
    """The root of the slope in a bracket, by Newton's method kept inside it; `rising` tells its sign at the ends."""
    phi = 0.5 * (low + high)
    for _ in range(_MOST_STEPS):
        slope, bend = _slope_and_bend(c, complex(math.cos(phi), math.sin(phi)))
        if (slope > 0.0) == rising:
            high = phi
        else:
            low = phi
        new = phi - slope / bend
        if not (low - 1e-14 <= new <= high + 1e-14):
            new = 0.5 * (low + high)
        move = abs(new - phi)
        phi = new
        if move <= 4e-15:
            break
    return phi


@njit(**_INNER)
def _where_it_turns(c, low, high, slope):
    """A phase where the slope, which comes nearer to zero and goes again, has the other sign; 0 where it never has."""
    for _ in range(_MOST_STEPS):
        middle = 0.5 * (low + high)
        here, bend = _slope_and_bend(c, complex(math.cos(middle), math.sin(middle)))
        if (here > 0.0) != (slope > 0.0):
            return middle
        # Slope times bend is half the rate of the squared slope: negative on the way to where it is nearest to zero.
        if here * bend <= 0.0:
            low = middle
        else:
            high = middle
    return 0.0


@njit(**_INNER)
def _put(phase, value, count, c, low, high, rising):
    """Add the extremum in a bracket to those in order of phase; returns their number."""
    phi = _turning_point(c, low, high, rising) % TURN
    if count == phase.size:
        return count
    i = count
    while i > 0 and phase[i - 1] > phi:
        phase[i], value[i] = phase[i - 1], value[i - 1]
        i -= 1
    phase[i], value[i] = phi, series_at(c, phi)[0]
    return count + 1


@njit(**_INNER)
def _find_extrema(c, phase, value):
    """All extrema of a series, in order of phase in [0, 2 pi); returns their number.

    Brackets come from the slope on an even grid; where it comes near zero between two samples without a change of sign,
    the point where it is nearest is sought, so that no close pair is missed.

    Parameters
    ----------
    c : array, shape (n + 1,)
    phase, value : array, shape (workspace,)
        Are filled. A series of order n has at most 2 n extrema; what rounding makes of a flat one beyond the workspace
        is left out.
    """
    n = c.size - 1
    amplitude = 0.0
    for k in range(1, n + 1):
        amplitude += abs(c[k])
    # Beside so large a mean the extrema would be those of rounding.
    if not amplitude > 1e-2 * ROUNDING * abs(c[0]):
        return 0
    cells = max(_LEAST, _PER_WAVE * n)
    h = TURN / cells
    count = 0
    slope, bend = _slope_and_bend(c, complex(1.0, 0.0))
    for i in range(cells):
        # The last cell ends on the very first sample: half a rounding off it the slope may have the other sign.
        phi = (i + 1) % cells * h
        after, bend_after = _slope_and_bend(c, complex(math.cos(phi), math.sin(phi)))
        if (slope > 0.0) != (after > 0.0):
            count = _put(phase, value, count, c, i * h, (i + 1) * h, after > 0.0)
        elif (
            # Two extrema hide in a cell only where the slope falls towards zero from both of its ends, and the bend can
            # bring the smaller of the two to zero within it.
            slope * bend <= 0.0
            and after * bend_after >= 0.0
            and min(abs(slope), abs(after)) < h * max(abs(bend), abs(bend_after))
        ):
            split = _where_it_turns(c, i * h, (i + 1) * h, slope)
            if split > 0.0:
                count = _put(phase, value, count, c, i * h, split, slope <= 0.0)
                count = _put(phase, value, count, c, split, (i + 1) * h, slope > 0.0)
        slope, bend = after, bend_after
    return count


@njit(**_INNER)
def next_rise(c, phase, value, count, phi, here, level, sign):
    """Phase, not before `phi`, at which ``sign * series`` next exceeds ``sign * level``; infinite if it never does.

    Parameters
    ----------
    c : array, shape (n + 1,)
        The series; `phase`, `value` and `count` are its extrema from :func:`find_extrema`, `here` its value at `phi`.
    """
    size = 0.0
    for k in range(c.size):
        size += abs(c[k])
    slack = ROUNDING * (size + abs(level))
    goal = sign * level
    if sign * here > goal + slack:
        return phi
    turns = math.floor(phi / TURN)
    start = 0
    while start < count and phase[start] <= phi - turns * TURN:
        start += 1
    for i in range(start, start + count):
        top = sign * value[i % count]
        if not top > goal + slack:
            continue
        # On its level but for rounding, and on the way to a top that is clearly above: it rises here.
        if i == start and sign * here >= goal:
            return phi
        before = (i - 1) % count
        # In Python's sense: the extremum before the first is the last one of the turn before.
        low = phase[before] + TURN * (turns + (i - 1) // count)
        high = phase[i % count] + TURN * (turns + i // count)
        bottom = sign * value[before]
        if high <= phi or bottom >= goal:
            return max(phi, low)
        return _root(c, max(low, phi), low, high, 1.0 - 2.0 * (goal - bottom) / (top - bottom), level, sign)
    return math.inf


@njit(**_INNER)
def _root(c, low, begin, high, share, level, sign):
    """Where a rising piece from `begin` to `high` meets a level, not before `low`: begun as on a cosine."""
    x = begin + (high - begin) * math.acos(share) / math.pi
    x = min(max(x, low), high)
    for _ in range(_MOST_STEPS):
        value, slope = series_at(c, x)
        gap, slope = sign * (value - level), sign * slope
        if gap > 0.0:
            high = x
        else:
            low = x
        new = x - gap / slope if slope > 0.0 else 0.5 * (low + high)
        if not low <= new <= high:
            new = 0.5 * (low + high)
        # Newton squares its error: after so small a step the next one would be below rounding.
        if abs(new - x) <= 1e-9:
            return new
        x = new
    return x


@njit(**_INNER)
def _due(table, mode_guard, offset, phi, omega):
    """Phase at which a mode guard on the clock alone (or on nothing) fires."""
    clock = table.on_clock[mode_guard]
    if clock <= 0.0:
        return phi if offset + clock * phi / omega > 0.0 else math.inf
    return max(phi, -offset / clock * omega)


@njit(**_INNER)
def _advance(table, series, phase, value, counts, z, omega, phi, end, mode, memory, work, here, at, fired, holds):
    """Run an automaton over phases, from `phi` to before `end` (over what is due at once if both are the same).

    Parameters
    ----------
    table : Table
    series : array, shape (S + 1, n + 1)
        Those of the guards, and the input.
    phase, value, counts : array, shapes (S + 1, workspace), (S + 1, workspace), (S + 1,)
        Their extrema.
    z : array, shape (n + 1,)
        The free input.
    omega : float
        [rad/s].
    memory : array, shape (h,)
        Memory values; left as they are at the end.
    work, here : array, shapes (h,), (S,)
        For work.
    at, fired, holds : array, shapes (most,), (most,), (most, h)
        Are filled with phase, mode guard, and memory values behind each switch.

    Returns
    -------
    (int, int)
        Number of switches, and the mode at the end; -1 switches where there are more than `most`.
    """
    only_now = end == phi
    n_memory = memory.size
    number = 0
    while True:
        for s in range(here.size):
            here[s] = series_at(series[s], phi)[0]
        when, best = math.inf, -1
        # Between switches memory stands still, so a guard on the input is a level that the series has to pass.
        for t in range(table.first[mode], table.first[mode + 1]):
            offset = table.constant[t]
            for h in range(n_memory):
                offset += table.on_memory[t, h] * memory[h]
            s = table.series[t]
            if s < 0:
                due = _due(table, t, offset, phi, omega)
            else:
                sign = 1.0 if table.factor[t] > 0.0 else -1.0
                level = -offset / table.factor[t]
                due = next_rise(series[s], phase[s], value[s], counts[s], phi, here[s], level, sign)
            if due < when:
                when, best = due, t
        if best < 0 or (when > phi if only_now else when >= end):
            return number, mode
        if number == at.size:
            return -1, mode
        phi, mode = when, table.target[best]
        level, slope = series_at(z, phi)
        fill(work, memory)
        for h in range(n_memory):
            new = table.memory_constant[best, h]
            for i in range(table.roles.size):
                role = table.roles[i]
                part = level if role == 0 else omega * slope if role == 1 else phi / omega
                new += table.from_input[best, h, i] * part
            for k in range(n_memory):
                new += table.from_memory[best, h, k] * work[k]
            memory[h] = new
            holds[number, h] = new
        at[number], fired[number] = phi, best
        number += 1


@njit(**_INNER)
def _repeat(table, motion, start, mode, memory, least, clocked, room):
    """Run at least `least` periods of a motion from a phase, until one ends as it began; returns as :func:`settle`."""
    series, extrema, counts, z, omega = motion
    begun, work, here, at, fired, holds = room
    size = 0.0
    for k in range(z.size):
        size += abs(z[k])
    turn = TURN / omega
    phase, value = extrema[0], extrema[1]
    count, mode = _advance(
        table, series, phase, value, counts, z, omega, start, start, mode, memory, work, here, at, fired, holds
    )
    if count < 0:
        return ENDLESS, mode, start
    for period in range(_MOST_PERIODS):
        begin, before = start + TURN * period, mode
        fill(begun, memory)
        end = begin + TURN
        count, mode = _advance(
            table, series, phase, value, counts, z, omega, begin, end, mode, memory, work, here, at, fired, holds
        )
        if count < 0:
            return ENDLESS, mode, begin
        same = period + 1 >= least and mode == before
        for h in range(memory.size):
            moved = memory[h] - begun[h]
            near = abs(moved) <= _SAME * (size + abs(begun[h]))
            # A memory value that is a time repeats itself a period later.
            same = same and (near or (clocked and abs(moved - turn) <= _SAME * turn))
        if same:
            return count, mode, begin
    return UNSETTLED, mode, start


@njit(**_INNER)
def settle_part(table, z, omega, mode, clocked, rest):
    """Run an automaton over whole periods until mode and memory values come back.

    An element that holds values comes from a larger motion, so that it joins its loop even where it could also rest;
    only if it then does not switch at all does it rest, where its describing function has it rest.

    Parameters
    ----------
    table : Table
    z : array, shape (n + 1,)
        The free input.
    omega : float
        [rad/s].
    mode : int
        At the start.
    clocked : bool
        Whether a guard is on the time.
    rest : array, shape (h,)
        Memory values at rest.

    Returns
    -------
    count : int
        Number of switches, :data:`ENDLESS` where they never end, :data:`UNSETTLED` where no period repeats.
    mode : int
    start : float
        At the beginning of the period, its phase.
    begun : array, shape (h,)
        Memory values there.
    at, fired, holds : array, shapes (s,), (s,), (s, h)
        Phase, mode guard, and memory values behind each switch of the period.
    """
    n, n_series, n_memory = z.size - 1, table.free_series.size, rest.size
    # No wave of order n passes a level more than 2 n times in a period.
    most = 200 + 2 * z.size * max(20, table.series.size)
    at, fired, holds = np.empty(most), np.empty(most, np.int64), np.empty((most, n_memory))
    series, extrema = np.empty((2, n_series + 1, n + 1), np.complex128), np.empty((3, n_series + 1, 8 * n + 32))
    counts, here, begun = np.zeros(n_series + 1, np.int64), np.empty(n_series), np.empty(n_memory)
    own, larger, phase, value, wide = series[0], series[1], extrema[0], extrema[1], extrema[2]
    held, work = rest.copy(), np.empty(n_memory)
    motion, room = (own, extrema, counts, z, omega), (begun, work, here, at, fired, holds)
    # The last row is the input itself, which mostly is one of the series, too.
    same = n_series
    for s in range(n_series):
        on_free, on_rate = table.free_series[s], table.rate_series[s]
        same = s if on_free == 1.0 and on_rate == 0.0 else same
        for k in range(n + 1):
            free, rate = on_free, on_rate * (omega * k)
            own[s, k] = complex(free * z[k].real - rate * z[k].imag, free * z[k].imag + rate * z[k].real)
        counts[s] = _find_extrema(own[s], phase[s], value[s])
    own[n_series] = z
    count, start, least, there = 0, 0.0, 2 if clocked else 1, mode
    if n_memory > 0 and not clocked:
        if same == n_series:
            counts[same] = _find_extrema(z, phase[same], value[same])
        best = -math.inf
        for i in range(counts[same]):
            if value[same, i] > best:
                best, start = value[same, i], phase[same, i]
        for s in range(n_series + 1):
            larger[s, 0] = own[s, 0]
            for k in range(1, n + 1):
                larger[s, k] = _EXCURSION * own[s, k]
            for i in range(counts[s]):
                wide[s, i] = own[s, 0].real + _EXCURSION * (value[s, i] - own[s, 0].real)
        # From peak to peak, so that the larger motion hands over at the top of the smaller one.
        moving, before = larger[n_series], start - TURN
        count, there = _advance(
            table, larger, phase, wide, counts, moving, omega, before, start, mode, held, work, here, at, fired, holds
        )
        if count >= 0:
            count, there, start = _repeat(table, motion, start, there, held, 2, clocked, room)
        if count == 0:
            fill(held, rest)
            start, there = 0.0, mode
    # What holds nothing, or does not switch in a motion of its own.
    if count == 0:
        count, there, start = _repeat(table, motion, start, there, held, least, clocked, room)
    s = max(count, 0)
    return count, there, start, begun, at[:s].copy(), fired[:s].copy(), holds[:s].copy()


@njit(**_COMPILED)
def settle(table, z, omega, mode, clocked, rest):
    """See :func:`settle_part`, for whoever asks for nothing else."""
    return settle_part(table, z, omega, mode, clocked, rest)


@njit(**_COMPILED)
def find_extrema(c, phase, value):
    """See :func:`_find_extrema`."""
    return _find_extrema(c, phase, value)
