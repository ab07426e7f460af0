"""Compiled: the describing function of any automaton by quadrature, its switches located.

The input is ``b + a sin(phi)``; peaks stand on the grid of phases, between which guards on the input alone are
monotone. Within a step the first guard that rises is located, and the output is integrated on either side: in closed
form where it is affine in a sinusoid, else by Gauss's rule of four points, in as many panels as smooth functions need.
Periods follow each other until what the element remembers repeats.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from eppanalysis.kernels.compiling import KERNEL, PART, njit
from eppanalysis.kernels.engine.curves import SQUARE, curve
from eppanalysis.kernels.filling import fill
from eppanalysis.kernels.simd.tuples import by_address

#: Steps in a period (a multiple of four), most periods, most events in a step.
STEPS, PERIODS, MOST_EVENTS = 64, 6, 64
#: Steps after which periods are counted: what starts at a phase switches there, and a turn later to rounding.
RUN_IN = 11
#: Change of memory over a period, relative to it and the input, of an answer that repeats itself, rounding aside.
REPEATS = 1e-9
_PLACE, _WEIGHT = np.polynomial.legendre.leggauss(4)
#: Difference of a panel from its halves, relative to the output, that is none; panels are not halved below this width.
_AGREES, _NARROWEST = 1e-12, 1e-9


@by_address
class Rules(NamedTuple):
    """Modes (leading axis m) and guards (g), inputs z, outputs w, memory values h, smooth functions s."""

    from_input: np.ndarray  # (m, w, z)
    from_memory: np.ndarray  # (m, w, h)
    from_smooth: np.ndarray  # (m, w, s)
    constant: np.ndarray  # (m, w)
    smooth_kind: np.ndarray  # (s,) int
    smooth_input: np.ndarray  # (s, z)
    smooth_constant: np.ndarray  # (s,)
    smooth_scale: np.ndarray  # (s,)
    guard_mode: np.ndarray  # (g,) int
    target: np.ndarray  # (g,) int: the mode beyond a sticking one
    on_input: np.ndarray  # (g, z)
    on_rate: np.ndarray  # (g, z)
    on_memory: np.ndarray  # (g, h)
    on_output: np.ndarray  # (g, w)
    guard_constant: np.ndarray  # (g,)
    memory_from_input: np.ndarray  # (g, h, z)
    memory_from_memory: np.ndarray  # (g, h, h)
    memory_constant: np.ndarray  # (g, h)
    start: np.ndarray  # (h,)


@njit(**PART)
def _inputs(a, b, omega, phi, z, rate):
    """The first input, its rate as the second one, and the rates of both; further ones stay at zero."""
    sine, cosine = math.sin(phi), math.cos(phi)
    z[0], rate[0] = b + a * sine, a * omega * cosine
    if z.size > 1:
        z[1], rate[1] = rate[0], -a * omega * omega * sine


@njit(**PART)
def _outputs(rules, mode, z, memory, w):
    for i in range(w.size):
        v = rules.constant[mode, i]
        for j in range(z.size):
            v += rules.from_input[mode, i, j] * z[j]
        for j in range(memory.size):
            v += rules.from_memory[mode, i, j] * memory[j]
        for j in range(rules.smooth_kind.size):
            c = rules.from_smooth[mode, i, j]
            if c != 0.0:
                u = rules.smooth_constant[j]
                for k in range(z.size):
                    u += rules.smooth_input[j, k] * z[k]
                kind = rules.smooth_kind[j]
                if kind >= SQUARE:
                    f = curve(kind, u)[0]
                else:
                    f = math.sin(u) if kind == 0 else u * u * u if kind == 1 else 1.0 / (1.0 + abs(u))
                v += c * rules.smooth_scale[j] * f
        w[i] = v


@njit(**PART)
def _guard(rules, g, mode, a, b, omega, phi, memory, z, rate, w):
    """Value of a guard at a phase."""
    _inputs(a, b, omega, phi, z, rate)
    v = rules.guard_constant[g]
    for j in range(z.size):
        v += rules.on_input[g, j] * z[j] + rules.on_rate[g, j] * rate[j]
    for j in range(memory.size):
        v += rules.on_memory[g, j] * memory[j]
    on_output = False
    for j in range(w.size):
        on_output = on_output or rules.on_output[g, j] != 0.0
    if on_output:
        _outputs(rules, mode, z, memory, w)
        for j in range(w.size):
            v += rules.on_output[g, j] * w[j]
    return v


@njit(**PART)
def _output_wave(rules, mode, i, a, b, omega, memory):
    """An output without smooth functions as ``level + sine sin(phi) + cosine cos(phi)``."""
    level = rules.constant[mode, i] + rules.from_input[mode, i, 0] * b
    sine, cosine = rules.from_input[mode, i, 0] * a, 0.0
    if rules.from_input.shape[2] > 1:
        cosine = rules.from_input[mode, i, 1] * a * omega
    for j in range(memory.size):
        level += rules.from_memory[mode, i, j] * memory[j]
    return level, sine, cosine


@njit(**PART)
def _guard_wave(rules, g, mode, a, b, omega, memory):
    """A guard as ``level + sine sin(phi) + cosine cos(phi)``; not a number where a smooth function acts on it."""
    level = rules.guard_constant[g] + rules.on_input[g, 0] * b
    sine, cosine = rules.on_input[g, 0] * a, rules.on_rate[g, 0] * a * omega
    if rules.on_input.shape[1] > 1:
        cosine += rules.on_input[g, 1] * a * omega
        sine -= rules.on_rate[g, 1] * a * omega * omega
    for j in range(memory.size):
        level += rules.on_memory[g, j] * memory[j]
    for i in range(rules.constant.shape[1]):
        share = rules.on_output[g, i]
        if share != 0.0:
            for j in range(rules.smooth_kind.size):
                if rules.from_smooth[mode, i, j] != 0.0:
                    return math.nan, math.nan, math.nan
            more = _output_wave(rules, mode, i, a, b, omega, memory)
            level, sine, cosine = level + share * more[0], sine + share * more[1], cosine + share * more[2]
    return level, sine, cosine


@njit(**PART)
def _rise(level, sine, cosine, low, high):
    """Where ``level + sine sin(phi) + cosine cos(phi)`` rises through zero, which it does between two phases."""
    turned = math.atan2(cosine, sine)
    phi = math.asin(min(max(-level / math.hypot(sine, cosine), -1.0), 1.0)) - turned
    phi += 2.0 * math.pi * math.floor((0.5 * (low + high) - phi) / (2.0 * math.pi) + 0.5)
    return min(max(phi, low), high)


@njit(**PART)
def _next_event(rules, mode, a, b, omega, low, high, memory, z, rate, w):
    """The guard of a mode that rises first in a step, and the phase behind its rise; -1 for none."""
    best, where = -1, high
    for g in range(rules.guard_mode.size):
        # Looked at where the first one so far rises, and not at the end of the step: only an earlier one takes its
        # place.
        if rules.guard_mode[g] != mode or not _guard(rules, g, mode, a, b, omega, where, memory, z, rate, w) > 0.0:
            continue
        left, right = low, where
        if _guard(rules, g, mode, a, b, omega, low, memory, z, rate, w) > 0.0:
            right = low
        level, sine, cosine = _guard_wave(rules, g, mode, a, b, omega, memory)
        if right > left and abs(sine) + abs(cosine) > 0.0:
            # An arc sine says where a sinusoid is zero, but for its last digits: these are bisected.
            near, reach = _rise(level, sine, cosine, left, right), 4e-16 * (1.0 + abs(right))
            while near + reach < right:
                if _guard(rules, g, mode, a, b, omega, near + reach, memory, z, rate, w) > 0.0:
                    right = near + reach
                reach *= 4.0
            reach = 4e-16 * (1.0 + abs(right))
            while near - reach > left:
                if not _guard(rules, g, mode, a, b, omega, near - reach, memory, z, rate, w) > 0.0:
                    left = near - reach
                reach *= 4.0
        while right - left > 4e-16 * (1.0 + abs(right)):
            middle = 0.5 * (left + right)
            if middle <= left or middle >= right:
                break
            if _guard(rules, g, mode, a, b, omega, middle, memory, z, rate, w) > 0.0:
                right = middle
            else:
                left = middle
        best, where = g, right
    return best, where


@njit(**PART)
def _panel(rules, mode, a, b, omega, low, high, memory, z, rate, w, total):
    """Add Gauss's rule for the integrals of output, output times sine and times cosine; returns the largest output."""
    largest = 0.0
    for k in range(_PLACE.size):
        phi = 0.5 * (low + high) + 0.5 * (high - low) * _PLACE[k]
        weight = 0.5 * (high - low) * _WEIGHT[k]
        _inputs(a, b, omega, phi, z, rate)
        _outputs(rules, mode, z, memory, w)
        sine, cosine = math.sin(phi), math.cos(phi)
        for i in range(w.size):
            total[0, i] += weight * w[i]
            total[1, i] += weight * w[i] * sine
            total[2, i] += weight * w[i] * cosine
            largest = max(largest, abs(w[i]))
    return largest


@njit(**PART)
def _add_waves(rules, mode, a, b, omega, low, high, memory, total):
    """Add the integrals of outputs, these times sine and times cosine, that are affine in a sinusoid."""
    width, s_low, c_low, s_high, c_high = high - low, math.sin(low), math.cos(low), math.sin(high), math.cos(high)
    of_sine, of_cosine = c_low - c_high, s_high - s_low
    both, turned = 0.5 * (s_high * s_high - s_low * s_low), 0.5 * (s_high * c_high - s_low * c_low)
    for i in range(total.shape[1]):
        level, sine, cosine = _output_wave(rules, mode, i, a, b, omega, memory)
        total[0, i] += level * width + sine * of_sine + cosine * of_cosine
        total[1, i] += level * of_sine + sine * (0.5 * width - turned) + cosine * both
        total[2, i] += level * of_cosine + sine * both + cosine * (0.5 * width + turned)


@njit(**PART)
def _integrate(rules, mode, a, b, omega, low, high, memory, z, rate, w, total, once, twice):
    """Add the integrals of output, output times sine and times cosine from phase to phase, shape (3, w).

    Those of an output that is affine in a sinusoid are closed forms. Smooth functions may vary within a small part of a
    step: their panels are halved until two halves give what the whole gives, and grow again behind.
    """
    if rules.smooth_kind.size == 0:
        _add_waves(rules, mode, a, b, omega, low, high, memory, total)
        return
    left, width = low, high - low
    while left < high:
        right = high if left + 1.5 * width > high else left + width
        middle = 0.5 * (left + right)
        once[:, :] = 0.0
        twice[:, :] = 0.0
        _panel(rules, mode, a, b, omega, left, right, memory, z, rate, w, once)
        largest = _panel(rules, mode, a, b, omega, left, middle, memory, z, rate, w, twice)
        largest = max(largest, _panel(rules, mode, a, b, omega, middle, right, memory, z, rate, w, twice))
        worst = 0.0
        for i in range(3):
            for j in range(w.size):
                worst = max(worst, abs(twice[i, j] - once[i, j]))
        if worst > _AGREES * largest * (right - left) and right - left > _NARROWEST:
            width = 0.5 * (right - left)
            continue
        total += twice
        left, width = right, 2.0 * (right - left)


@njit(**PART)
def _write(rules, g, a, b, omega, phi, z, rate, memory, before):
    """Memory values behind the event of a guard."""
    _inputs(a, b, omega, phi, z, rate)
    fill(before, memory)
    for h in range(memory.size):
        v = rules.memory_constant[g, h]
        for j in range(z.size):
            v += rules.memory_from_input[g, h, j] * z[j]
        for j in range(memory.size):
            v += rules.memory_from_memory[g, h, j] * before[j]
        memory[h] = v


@njit(**PART)
def _steps(rules, mode, a, b, omega, first, last, memory, z, rate, w, before, total, once, twice):
    """Integrals over some steps into `total`, (3, w); the mode at their end, -1 where switches never end, and these."""
    total[:, :] = 0.0
    step, switches = 2.0 * math.pi / STEPS, 0
    for i in range(first, last):
        phi, stop = i * step, (i + 1) * step
        for events in range(MOST_EVENTS + 1):
            if events == MOST_EVENTS:
                return -1, switches
            g, where = _next_event(rules, mode, a, b, omega, phi, stop, memory, z, rate, w)
            _integrate(rules, mode, a, b, omega, phi, where, memory, z, rate, w, total, once, twice)
            if g < 0:
                break
            phi = where
            _write(rules, g, a, b, omega, phi, z, rate, memory, before)
            mode, switches = rules.target[g], switches + 1
    return mode, switches


@njit(**KERNEL)
def describe(rules, start_mode, a, b, omega, mean, gain):
    """Mean outputs and gains (points, w) for points of amplitude, bias and frequency (points,).

    Not a number where an element switches without end, or does not answer with the period of its input.
    """
    n_w, n_z, n_h = rules.constant.shape[1], rules.on_input.shape[1], rules.start.size
    z, rate, w, memory, before = np.zeros(n_z), np.zeros(n_z), np.zeros(n_w), np.zeros(n_h), np.zeros(n_h)
    total, once, twice, begin = np.zeros((3, n_w)), np.zeros((3, n_w)), np.zeros((3, n_w)), np.zeros(n_h)
    for p in range(a.size):
        mode, repeats = start_mode, False
        fill(memory, rules.start)
        given = (a[p], b[p], omega[p])
        mode, _ = _steps(rules, mode, *given, 0, RUN_IN, memory, z, rate, w, before, total, once, twice)
        for _ in range(PERIODS):
            if mode < 0:
                break
            first = mode
            fill(begin, memory)
            ends = (RUN_IN, RUN_IN + STEPS)
            mode, switches = _steps(rules, mode, *given, *ends, memory, z, rate, w, before, total, once, twice)
            # The integrals are those of the last period: of an answer that has not come back they would be of one turn.
            same = repeats = mode >= 0 and mode == first
            for h in range(n_h):
                moved, size = abs(memory[h] - begin[h]), abs(memory[h]) + a[p]
                # Each switch is where it is to rounding, and so is what it writes.
                same = same and moved <= 1e-14 * size * (1 + switches)
                repeats = repeats and moved <= REPEATS * (size + abs(b[p]))
            if same:
                break
        for i in range(n_w):
            mean[p, i] = total[0, i] / (2.0 * math.pi) if repeats else math.nan
            gain[p, i] = complex(total[1, i], total[2, i]) / (math.pi * a[p]) if repeats else complex(math.nan, 0.0)
