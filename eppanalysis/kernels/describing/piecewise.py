"""Describing function of a biased sinusoid through a piecewise-linear map: floats in, floats out.

The rising half of the input, ``x = b + A sin(phi)`` with ``phi`` from -pi/2 to pi/2, is walked outwards from the bias
to either peak. Integration by parts turns the Fourier integrals into sums over the output's *changes* (slopes, jumps),

    gain = 2/(pi A) * integral cos(phi) dy,     mean = y(b) + 1/pi * integral (pi/2 - |phi|) sgn(phi) dy,

so that saturated pieces add nothing and monotone maps cancel nothing. Angles are held as the sine and cosine of half
the angle from the peak, which keeps the relative accuracy both of pieces much narrower than the amplitude and of
amplitudes that only just pass a threshold.

Pieces are the outer loop and amplitudes the inner one; what an amplitude does not reach costs it nothing. The arc sine
and what is left of it are polynomials of one order, which take a fraction of what library calls take.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.polynomial import chebyshev, polynomial

from eppanalysis.arrays import Array
from eppanalysis.kernels.compiling import KERNEL, PART, njit

HALF_PI = math.pi / 2
#: Amplitudes that are worked on at a time: their arrays stay in the nearest cache.
CHUNK = 512
#: Steps of a staircase up to which they are added one by one; those near a peak that always are; and the coefficients
#: of Euler and Maclaurin's formula, Bernoulli numbers over factorials.
FEW, ENDS, BERNOULLI = 128, 32, (1 / 12, -1 / 720, 1 / 30240, -1 / 1209600)
EPSILON = float(np.finfo(float).eps)
#: Order of the polynomials, as `_value` has them: their error falls as (3 + sqrt 8)**-order, to rounding.
ORDER = 20
#: Terms of the power series that the polynomials are made from, for squares up to one half.
SERIES = 60


def _polynomial(ratio: Callable[[Array], Array], first: float) -> tuple[float, ...]:
    """Coefficients in ``x = 4 q - 1`` of the series ``sum c_k q**k``, q from 0 to 1/2, with ``c_k = ratio(k) c_(k-1)``.

    All terms are positive, so that nothing cancels on the way to the basis of Chebyshev, where the series is cut off.
    """
    terms = first * np.cumprod([1.0, *ratio(np.arange(1.0, SERIES))])
    powers = np.zeros(1)
    for term in reversed(terms):
        powers = polynomial.polyadd(polynomial.polymul(powers, [0.25, 0.25]), [term])
    return tuple(chebyshev.cheb2poly(chebyshev.poly2cheb(powers)[: ORDER + 1]).tolist())


# With s the sine of an angle h from 0 to pi/4, and q its square:
#: ``h / s``
ASIN = _polynomial(lambda k: (2 * k - 1) ** 2 / (2 * k * (2 * k + 1)), 1.0)
#: ``(h - sin h cos h) / s**3``
EXCESS = _polynomial(lambda k: (2 * k - 1) * (2 * k + 1) / (2 * k * (2 * k + 3)), 2 / 3)
#: ``(sin h - h cos h) / s**3``
LEVER = _polynomial(lambda k: 2 * k / (2 * k + 3), 1 / 3)


@njit(inline="always")
def _value(coefficients, q):
    x, c = 4.0 * q - 1.0, coefficients
    s = x * x
    # Even and odd powers apart, as one sum alone would wait for each of its products; written out, as a loop would
    # choose among the coefficients at each turn.
    even = ((((c[20] * s + c[18]) * s + c[16]) * s + c[14]) * s + c[12]) * s + c[10]
    even = ((((even * s + c[8]) * s + c[6]) * s + c[4]) * s + c[2]) * s + c[0]
    odd = (((c[19] * s + c[17]) * s + c[15]) * s + c[13]) * s + c[11]
    odd = ((((odd * s + c[9]) * s + c[7]) * s + c[5]) * s + c[3]) * s + c[1]
    return even + x * odd


@njit(inline="always")
def _angle(s, c):
    """Angle from 0 to pi/2 of the sine `s` and cosine `c`."""
    least = min(s, c)
    angle = least * _value(ASIN, least * least)
    return angle if s <= c else HALF_PI - angle


@njit(inline="always")
def _halves(amplitude, distance):
    """Sine and cosine of half the angle from the peak at which the input has gone `distance` from its bias."""
    return math.sqrt((amplitude - distance) * (0.5 / amplitude)), math.sqrt((amplitude + distance) * (0.5 / amplitude))


@njit(**PART, error_model="numpy")
def _add_piece(start, end, slope, side, amplitude, bias, mean, gain, level, sway):
    """Add what a sloped piece brings on one `side` (1 above, -1 below) of the bias; it runs outwards, start to end.

    ``integral cos^2(phi) dphi`` and ``integral (pi/2 - phi) cos(phi) dphi`` are written in the middle of the two ends'
    angles from the peak and the half width between them.
    """
    for i in range(amplitude.size):
        A = amplitude[i]
        near, far = (start - bias[i]) * side, (end - bias[i]) * side
        # Between two breakpoints, not between their rounded distances from the bias.
        whole = (near >= 0.0) & (far < A)
        near, far = max(near, 0.0), min(far, A)
        swept = (end - start) * side if whole else far - near
        inside = (far > near) & (A > 0.0)
        if not inside:
            continue
        s1, c1 = _halves(A, near)
        s2, c2 = _halves(A, far)
        sin_middle, cos_middle = s1 * c2 + c1 * s2, c1 * c2 - s1 * s2
        # From the swept width itself: as a difference of two angles a piece much narrower than the amplitude would lose
        # its digits.
        sin_width, cos_width = 0.5 * swept / (A * sin_middle), c1 * c2 + s1 * s2
        flat, q = sin_middle * sin_width, sin_width * sin_width
        cube = sin_width * q
        here = cube * _value(EXCESS, q) + 2.0 * flat * sin_middle * cos_width
        lever = 2.0 * (_angle(sin_middle, cos_middle) * flat + cos_middle * cube * _value(LEVER, q))
        gain[i] += 2.0 / math.pi * slope * here
        mean[i] += side * slope / math.pi * A * lever
        level[i] += 2.0 / math.pi * slope * sin_width * _value(ASIN, q)
        sway[i] += side * 2.0 / math.pi * slope * sin_width * cos_middle


@njit(**PART, error_model="numpy")
def _add_jump(edge, jump, amplitude, bias, mean, gain, level, sway):
    """Add what a jump at `edge` brings where the input passes it."""
    for i in range(amplitude.size):
        A = amplitude[i]
        distance = abs(edge - bias[i])
        inside = distance < A
        A = A if inside else 1.0
        s, c = _halves(A, distance if inside else 0.0)
        side = 0.0 if edge == bias[i] else math.copysign(1.0, edge - bias[i])
        gain[i] += 4.0 / math.pi * jump * s * c / A if inside else 0.0
        mean[i] += side * 2.0 / math.pi * jump * _angle(s, c) if inside else 0.0
        # It is passed at the rate of the input: twice s times c is that over the amplitude.
        rate = 2.0 * s * c
        level[i] += jump / (math.pi * A * rate) if inside else 0.0
        sway[i] += jump * (edge - bias[i]) / (math.pi * A * A * rate) if inside else 0.0


@njit(**PART, error_model="numpy")
def _slopes_at(t, A, f):
    """Fill f, shape (4, 8), with what the four sums of `_even_side` add at t, and the first seven derivatives of each.

    All follow from those of ``g = 1/sqrt(A^2 - t^2)``, which has ``(A^2 - t^2) g' = t g``.
    """
    left = (A - t) * (A + t)
    root = math.sqrt(left)
    f[0, 0], f[1, 0], f[2, 0] = root, math.acos(t / A), 1.0 / root
    for n in range(7):
        f[2, n + 1] = ((2 * n + 1) * t * f[2, n] + n * n * (f[2, n - 1] if n else 0.0)) / left
    f[3, 0] = t * f[2, 0]
    for n in range(1, 8):
        f[3, n] = t * f[2, n] + n * f[2, n - 1]
        f[0, n] = -f[3, n - 1]
        f[1, n] = -f[2, n - 1]


@njit(**PART, error_model="numpy")
def _even_side(edges, first, last, bias, A, sums, below, above):
    """Sums of sqrt(A^2 - t^2), acos(t/A), 1/sqrt(A^2 - t^2) and t/sqrt(A^2 - t^2) over evenly spaced edges.

    t is the distance of an edge from the bias; `first` is the nearest and `last` lies behind the farthest, either way.
    Near the peak, where the roots are singular, term by term; before it by Euler and Maclaurin's formula, whose rest
    is a part in 10^15 of what is summed at these distances from the peak.
    """
    sums[:] = 0.0
    way = 1 if last > first else -1
    cut = last if abs(last - first) <= 2 * ENDS else last - way * ENDS
    for edge in range(cut, last, way) if cut != last else range(first, last, way):
        t = abs(edges[edge] - bias)
        root = math.sqrt((A - t) * (A + t))
        sums[0] += root
        sums[1] += math.acos(t / A)
        sums[2] += 1.0 / root
        sums[3] += t / root
    if cut == last:
        return
    p, q = abs(edges[first] - bias), abs(edges[cut - way] - bias)
    step = (q - p) / (abs(cut - first) - 1)
    _slopes_at(p, A, below)
    _slopes_at(q, A, above)
    arc, fall = math.asin(q / A) - math.asin(p / A), above[0, 0] - below[0, 0]
    sums[0] += 0.5 * (q * above[0, 0] - p * below[0, 0] + A * A * arc) / step
    sums[1] += (q * above[1, 0] - p * below[1, 0] - fall) / step
    sums[2] += arc / step
    sums[3] -= fall / step
    for i in range(4):
        sums[i] += 0.5 * (above[i, 0] + below[i, 0])
        power = step
        for j in range(4):
            sums[i] += BERNOULLI[j] * power * (above[i, 2 * j + 1] - below[i, 2 * j + 1])
            power *= step * step


@njit(**PART, error_model="numpy")
def _even_jump(breakpoints, jumps, first, last):
    """The jump at breakpoints that are evenly spaced and have one jump, both to rounding; else zero."""
    step, nearest = (breakpoints[last - 1] - breakpoints[first]) / (last - 1 - first), first
    for k in range(first, last):
        nearest = k if abs(breakpoints[k]) < abs(breakpoints[nearest]) else nearest
    # Next to zero, where least has been cancelled in it.
    jump, apart = jumps[nearest], 0.0
    for k in range(first, last):
        place = abs(breakpoints[first] + (k - first) * step - breakpoints[k])
        apart = max(apart, place, abs(jumps[k] / jump - 1.0) * step if jump != 0.0 else math.inf)
    return jump if apart <= 8.0 * EPSILON * max(abs(breakpoints[first]), abs(breakpoints[last - 1])) else 0.0


@njit(**PART, error_model="numpy")
def _add_stairs(edges, jump, amplitude, bias, mean, gain, level, sway):
    """Add what a staircase of equal steps brings, in a time that does not grow with the steps that are passed."""
    up, down, below, above = np.empty(4), np.empty(4), np.empty((4, 8)), np.empty((4, 8))
    for i in range(amplitude.size):
        A, b = amplitude[i], bias[i]
        if not A > 0.0:
            continue
        # Edges that are passed: distances from the bias decide, as rounding of bias and amplitude together would not.
        low, high = np.searchsorted(edges, b - A), np.searchsorted(edges, b + A)
        low += low < edges.size and not b - edges[low] < A
        high -= high > 0 and not edges[high - 1] - b < A
        beyond, before = np.searchsorted(edges, b, side="right"), np.searchsorted(edges, b)
        _even_side(edges, beyond, max(high, beyond), b, A, up, below, above)
        _even_side(edges, before - 1, min(low, before) - 1, b, A, down, below, above)
        middle = beyond - before  # an edge at the bias itself
        gain[i] += 2.0 * jump / (math.pi * A) * ((up[0] + down[0]) / A + middle)
        mean[i] += jump / math.pi * (up[1] - down[1])
        level[i] += jump / math.pi * (up[2] + down[2] + middle / A)
        sway[i] += jump / (math.pi * A) * (up[3] - down[3])


@njit(**PART)
def _start(breakpoints, slopes, intercepts, jumps, amplitude, bias, mean, gain, by):
    """Start `mean` with the output at the bias and `gain` with zero, or finish both where nothing oscillates."""
    last, level, slope, jump = math.nan, math.nan, math.nan, 0.0
    for i in range(amplitude.size):
        b = bias[i]
        if b != last:
            # At a breakpoint both sides count half, as a sine about it is as long on either; what lies off it the
            # pieces and jumps add.
            above = np.searchsorted(breakpoints, b, side="right")
            below = above - 1 if above > 0 and breakpoints[above - 1] == b else above
            slope = (slopes[below] + slopes[above]) / 2
            level = slope * b + (intercepts[below] + intercepts[above]) / 2
            jump = jumps[below] if below < above else 0.0
            last = b
        mean[i], gain[i], by[0, i], by[1, i] = level, 0.0, 0.0, 0.0
        if amplitude[i] <= 0.0:
            gain[i] = math.copysign(math.inf, jump) if jump != 0.0 else slope
        elif math.isnan(amplitude[i]) or math.isnan(b):
            mean[i], gain[i] = math.nan, math.nan


@njit(**PART)
def _reach(amplitude, bias):
    """Lowest and highest input in a chunk, and the lowest and highest bias."""
    bottom, top, lowest, highest = math.inf, -math.inf, math.inf, -math.inf
    for i in range(amplitude.size):
        bottom, top = min(bottom, bias[i] - amplitude[i]), max(top, bias[i] + amplitude[i])
        lowest, highest = min(lowest, bias[i]), max(highest, bias[i])
    return bottom, top, lowest, highest


@njit(**PART)
def shape_of(breakpoints, slopes, jumps):
    """Whether a piece slopes, and the jump at all breakpoints where they are those of an even staircase, else zero.

    Asked once for many chunks: an encoder has ten thousands of levels.
    """
    sloped = False
    for slope in slopes:
        sloped = sloped or slope != 0.0
    return sloped, _even_jump(breakpoints, jumps, 0, breakpoints.size) if breakpoints.size > FEW else 0.0


@njit(**PART)
def describe(breakpoints, slopes, intercepts, jumps, shape, amplitude, bias, mean, gain, by):
    """One chunk, of a map of the `shape` that :func:`shape_of` tells: only what some of its inputs reach is visited."""
    _start(breakpoints, slopes, intercepts, jumps, amplitude, bias, mean, gain, by)
    bottom, top, lowest, highest = _reach(amplitude, bias)
    k, (sloped, even) = breakpoints.size, shape
    for piece in range(k + 1 if sloped else 0):
        low = breakpoints[piece - 1] if piece > 0 else -math.inf
        high = breakpoints[piece] if piece < k else math.inf
        if slopes[piece] != 0.0 and high > lowest and low < top:
            _add_piece(low, high, slopes[piece], 1.0, amplitude, bias, mean, gain, by[0], by[1])
        if slopes[piece] != 0.0 and low < highest and high > bottom:
            _add_piece(high, low, slopes[piece], -1.0, amplitude, bias, mean, gain, by[0], by[1])
    first, last = np.searchsorted(breakpoints, bottom, side="right"), np.searchsorted(breakpoints, top)
    jump = 0.0
    if last - first > FEW:
        jump = even if even != 0.0 else _even_jump(breakpoints, jumps, first, last)
    if jump != 0.0:
        _add_stairs(breakpoints[first:last], jump, amplitude, bias, mean, gain, by[0], by[1])
        return
    for edge in range(first, last):
        if jumps[edge] != 0.0:
            _add_jump(breakpoints[edge], jumps[edge], amplitude, bias, mean, gain, by[0], by[1])


@njit(**KERNEL)
def biased_sinusoid(breakpoints, slopes, intercepts, jumps, amplitude, bias, mean, gain, by):
    """Fill `mean`, `gain` and what they change `by` for every pair of `amplitude` and `bias`; only breakpoints inside
    the oscillation are visited.

    Parameters
    ----------
    breakpoints : array, shape (k,)
        Ascending.
    slopes, intercepts : array, shape (k + 1,)
        Piece i is ``y = slopes[i] * x + intercepts[i]``.
    jumps : array, shape (k,)
        Step of y at each breakpoint; exactly zero where the map is continuous.
    amplitude, bias : array, shape (n,)
        The input ``bias + amplitude * sin(phi)``, amplitude at least zero. At zero the gain is the slope at the bias
        (the mean slope at a corner, infinite at a jump); not-a-number gives not-a-number.
    mean, gain : array, shape (n,)
        Where the results are written.
    by : array, shape (2, n)
        Likewise: derivatives of the mean by bias and amplitude, where the amplitude is above zero. Those of the gain
        follow from them, as all are moments of the map's slope: ``2 by[1] / A`` by the bias, and by the amplitude
        ``2 (by[0] - gain) / A``, for the squares of sine and cosine add up to one.
    """
    shape = shape_of(breakpoints, slopes, jumps)
    for i in range(0, amplitude.size, CHUNK):
        j = min(i + CHUNK, amplitude.size)
        chunk = amplitude[i:j], bias[i:j], mean[i:j], gain[i:j], by[:, i:j]
        describe(breakpoints, slopes, intercepts, jumps, shape, *chunk)
