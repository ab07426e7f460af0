"""Describing function of a biased sinusoid through a piecewise-linear map: floats in, floats out.

The rising half of the input, ``x = b + A sin(phi)`` with ``phi`` from -pi/2 to pi/2, is walked outwards from the bias
to either peak. Integration by parts turns the Fourier integrals into sums over the output's *changes* (slopes, jumps),

    gain = 2/(pi A) * integral cos(phi) dy,     mean = y(b) + 1/pi * integral (pi/2 - |phi|) sgn(phi) dy,

so that saturated pieces add nothing and monotone maps cancel nothing. Angles are held as the sine and cosine of half
the angle from the peak, which keeps the relative accuracy both of pieces much narrower than the amplitude and of
amplitudes that only just pass a threshold.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

ROOT_HALF = math.sqrt(0.5)
HALF_PI = math.pi / 2


@njit(cache=True, nogil=True)
def _first_above(breakpoints, x):
    """Number of breakpoints at or below `x`."""
    low, high = 0, breakpoints.size
    while low < high:
        middle = (low + high) // 2
        if breakpoints[middle] <= x:
            low = middle + 1
        else:
            high = middle
    return low


@njit(cache=True, nogil=True)
def _excess(h, s, c):
    """``h - sin(h) cos(h)`` for ``s, c = sin(h), cos(h)``, by its series where the difference would cancel."""
    if h > 0.25:
        return h - s * c
    q = h * h
    tail = 4 / 155925 + q * (-4 / 6081075 + q * 8 / 638512875)
    return h * q * (2 / 3 + q * (-2 / 15 + q * (4 / 315 + q * (-2 / 2835 + q * tail))))


@njit(cache=True, nogil=True)
def _lever(h, s, c):
    """``sin(h) - h cos(h)``, in the same way."""
    if h > 0.25:
        return s - h * c
    q = h * h
    tail = 1 / 3991680 - q / 518918400
    return h * q * (1 / 3 + q * (-1 / 30 + q * (1 / 840 + q * (-1 / 45360 + q * tail))))


@njit(cache=True, nogil=True)
def _piece(length, s1, c1, s2, c2):
    """``integral cos^2(phi) dphi`` and ``integral (pi/2 - phi) cos(phi) dphi`` over a piece.

    ``s, c`` are the sine and cosine of half the angle from the peak, t1 at the near end and t2 < t1 at the far end;
    `length` is the difference of ``sin(phi)`` between them. The integrals are written in the middle (t1 + t2)/2 and the
    half width (t1 - t2)/2.
    """
    sin_middle, cos_middle = s1 * c2 + c1 * s2, c1 * c2 - s1 * s2
    sin_width, cos_width = length / (2 * sin_middle), c1 * c2 + s1 * s2
    width = math.atan(sin_width / cos_width)
    if sin_middle < cos_middle:
        middle = math.atan(sin_middle / cos_middle)
    else:
        middle = HALF_PI - math.atan(cos_middle / sin_middle)
    flat = sin_middle * sin_width
    gain = _excess(width, sin_width, cos_width) + 2 * flat * sin_middle * cos_width
    return gain, 2 * (middle * flat + cos_middle * _lever(width, sin_width, cos_width))


@njit(cache=True, nogil=True)
def _walk(breakpoints, slopes, jumps, piece, up, amplitude, bias):
    """Sums of ``integral cos(phi) dy / A`` and ``integral (pi/2 - |phi|) |dy| / A`` from the bias to one peak."""
    gain, mean = 0.0, 0.0
    half = 0.5 / amplitude
    near, s1, c1, known, first = 0.0, ROOT_HALF, ROOT_HALF, True, True
    step = 1 if up else -1
    while True:
        edge = piece if up else piece - 1
        far, s2, c2 = amplitude, 0.0, 1.0
        inside = 0 <= edge < breakpoints.size
        if inside:
            distance = (breakpoints[edge] - bias) * step
            inside = distance < amplitude
            far = distance if inside else amplitude
        jump = jumps[edge] if inside else 0.0
        sloped = slopes[piece] != 0.0
        needed = sloped or jump != 0.0
        if inside and needed:
            s2, c2 = math.sqrt((amplitude - far) * half), math.sqrt((amplitude + far) * half)
        if sloped:
            if not known:
                s1, c1 = math.sqrt((amplitude - near) * half), math.sqrt((amplitude + near) * half)
            # Between two breakpoints, not between their rounded distances from the bias.
            length = abs(breakpoints[edge] - breakpoints[edge - step]) if inside and not first else far - near
            gain_here, mean_here = _piece(2 * half * length, s1, c1, s2, c2)
            gain += slopes[piece] * gain_here
            mean += slopes[piece] * mean_here
        if not inside:
            return gain, mean
        if jump != 0.0:
            gain += jump * 4 * half * s2 * c2
            mean += jump * 4 * half * math.atan2(s2, c2)
        near, s1, c1, known, first = far, s2, c2, needed, False
        piece += step


@njit(cache=True, nogil=True)
def _describe_one(breakpoints, slopes, intercepts, jumps, amplitude, bias):
    above = _first_above(breakpoints, bias)
    below = above
    if above > 0 and breakpoints[above - 1] == bias:
        below = above - 1
    jump = jumps[below] if below < above else 0.0
    slope = (slopes[below] + slopes[above]) / 2
    mean = slope * bias + (intercepts[below] + intercepts[above]) / 2
    if math.isnan(amplitude) or math.isnan(bias):
        return math.nan, math.nan
    if amplitude <= 0.0:
        return mean, (math.copysign(np.inf, jump) if jump != 0.0 else slope)
    gain_up, mean_up = _walk(breakpoints, slopes, jumps, above, True, amplitude, bias)
    gain_down, mean_down = _walk(breakpoints, slopes, jumps, below, False, amplitude, bias)
    gain = 2 / math.pi * (gain_up + gain_down + jump / amplitude)
    return mean + amplitude / math.pi * (mean_up - mean_down), gain


@njit(cache=True, nogil=True)
def biased_sinusoid(breakpoints, slopes, intercepts, jumps, amplitude, bias, mean, gain):
    """Fill `mean` and `gain` for every pair of `amplitude` and `bias`; only breakpoints inside the swing are visited.

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
    """
    for i in range(amplitude.size):
        mean[i], gain[i] = _describe_one(breakpoints, slopes, intercepts, jumps, amplitude[i], bias[i])
