"""Truncated Fourier series: values, all extrema, and the exact phases at which they rise through a level.

A series is a row of complex coefficients c[0..n], real c[0], and stands for ``Re(sum c[k] exp(j k phi))``.
"""

from __future__ import annotations

from bisect import bisect_right
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

TURN = 2.0 * np.pi
_PER_WAVE = 8  # samples per wave of the highest harmonic, by which extrema are bracketed
_ROUNDING = 1e-13


@lru_cache(maxsize=64)
def orders(n: int) -> Array:
    """0, 1, ..., n as floats."""
    k = np.arange(n + 1, dtype=float)
    k.flags.writeable = False
    return k


def values(c: ComplexArray, phi: Array) -> Array:
    """Values of series (..., n + 1) at phases (m,), shape (..., m)."""
    waves = np.exp(1j * np.outer(orders(c.shape[-1] - 1), phi))
    return (c @ waves).real


def sampled(c: ComplexArray, count: int) -> Array:
    """Values of series (..., n + 1) at `count` > 2 n even phases from 0 on, shape (..., count)."""
    spectrum = 0.5 * count * c
    spectrum[..., 0] *= 2.0
    return np.fft.irfft(spectrum, count)


def extrema(c: ComplexArray) -> list[tuple[Array, Array]]:
    """All extrema of series (m, n + 1): for each the phases in [0, 2 pi), increasing, and the values there.

    Brackets come from the slope on an even grid; where the slope comes near zero between two samples without a change
    of sign the cell is looked at more closely, so that no pair is missed.
    """
    n = c.shape[1] - 1
    if n == 0:
        return [(np.zeros(0), np.zeros(0)) for _ in c]
    jk = 1j * orders(n)
    slope, bend = jk * c, jk * jk * c
    count = max(32, _PER_WAVE * n)
    h = TURN / count
    s, b = sampled(slope, count), sampled(bend, count)
    after, bend_after = np.roll(s, -1, 1), np.roll(b, -1, 1)
    row, cell = np.nonzero((s > 0) != (after > 0))
    low, high, rising = cell * h, (cell + 1) * h, after[row, cell] > 0
    dips = (s > 0) == (after > 0)
    dips &= (s * b <= 0) & (after * bend_after >= 0)
    dips &= np.minimum(np.abs(s), np.abs(after)) < h * np.maximum(np.abs(b), np.abs(bend_after))
    if dips.any():
        more = _look_closely(slope, np.nonzero(dips), h)
        row, low, high, rising = (np.concatenate(pair) for pair in zip((row, low, high, rising), more, strict=True))
    live = (np.abs(c[:, 1:]).sum(1) > _ROUNDING * 1e-2 * np.abs(c[:, 0]))[row]
    row, low, high, rising = row[live], low[live], high[live], rising[live]
    phi = _polish(slope, bend, row, low, high, rising)
    level = (c[row] * np.exp(1j * np.outer(phi, orders(n)))).sum(1).real
    phi = np.mod(phi, TURN)
    out = []
    for i in range(len(c)):
        mine = row == i
        order = np.argsort(phi[mine])
        out.append((phi[mine][order], level[mine][order]))
    return out


def _look_closely(
    slope: ComplexArray, where: tuple[NDArray[np.intp], ...], h: float
) -> tuple[NDArray[np.intp], Array, Array, NDArray[np.bool_]]:
    """Changes of sign of the slope on a finer grid inside some cells: series, both ends, whether it rises."""
    row, cell = where
    fine = cell[:, None] * h + h * np.linspace(0.0, 1.0, 33)
    waves = np.exp(1j * fine[..., None] * orders(slope.shape[1] - 1))
    positive = (waves * slope[row][:, None, :]).sum(-1).real > 0
    i, j = np.nonzero(positive[:, 1:] != positive[:, :-1])
    return row[i], fine[i, j], fine[i, j + 1], positive[i, j + 1]


def _polish(
    slope: ComplexArray,
    bend: ComplexArray,
    row: NDArray[np.intp],
    low: Array,
    high: Array,
    rising: NDArray[np.bool_],
) -> Array:
    """Roots of the slope in brackets, by Newton's method kept inside them; `rising` tells its sign at their ends."""
    k = orders(slope.shape[1] - 1)
    first, second = slope[row], bend[row]
    low, high = low.copy(), high.copy()
    phi = 0.5 * (low + high)
    for _ in range(60):
        waves = np.exp(1j * np.outer(phi, k))
        s, b = (first * waves).sum(1).real, (second * waves).sum(1).real
        above = (s > 0) == rising
        high, low = np.where(above, phi, high), np.where(above, low, phi)
        with np.errstate(divide="ignore", invalid="ignore"):
            new = phi - s / b
        inside = (new >= low - 1e-14) & (new <= high + 1e-14)
        new = np.where(inside, new, 0.5 * (low + high))
        move = np.abs(new - phi)
        phi = new
        if not np.any(move > 4e-15):
            break
    return phi


class Monotone:
    """One series between its extrema, where it is monotone; finds the next rise (or fall) through a level.

    Parameters
    ----------
    c : array, shape (n + 1,)
        The series.
    phase, value : array, shape (ne,)
        Its extrema, from :func:`extrema`.
    """

    def __init__(self, c: ComplexArray, phase: Array, value: Array) -> None:
        jk = 1j * orders(len(c) - 1)
        self._jk = jk
        self._pair = np.stack([c, jk * c], 1)
        self._phase, self._value = phase.tolist(), value.tolist()
        self.rounding = _ROUNDING * float(np.abs(c).sum())

    def at(self, phi: float) -> tuple[float, float]:
        """Value and slope at a phase."""
        value, slope = (np.exp(self._jk * phi) @ self._pair).real
        return float(value), float(slope)

    def segment(self, phi: float, here: float, level: float, sign: float) -> tuple[float, float, float, float] | None:
        """The piece on which ``sign * series`` next rises through ``sign * level``, from the phase `phi` on.

        Returns its ends and the values there times `sign`; both ends are `phi` if the level is exceeded already, None
        if it never is.
        """
        slack = self.rounding + _ROUNDING * abs(level)
        goal = sign * level
        if sign * here > goal + slack:
            return phi, phi, sign * here, sign * here
        count = len(self._phase)
        turns, rest = divmod(phi, TURN)
        start = bisect_right(self._phase, rest)
        for i in range(start, start + count):
            v = sign * self._value[i % count]
            if v > goal + slack:
                if i == start and sign * here >= goal:
                    return phi, phi, sign * here, sign * here
                before = (i - 1) % count
                low = self._phase[before] + TURN * (turns + (i - 1) // count)
                high = self._phase[i % count] + TURN * (turns + i // count)
                return low, high, sign * self._value[before], v
        return None

    def root(self, phi: float, piece: tuple[float, float, float, float], level: float, sign: float) -> float:
        """Phase in a piece of :meth:`segment`, not before `phi`, at which the level is met."""
        low, high, bottom, top = piece
        goal = sign * level
        if high <= phi or bottom >= goal:
            return max(phi, low)
        share = 1.0 - 2.0 * (goal - bottom) / (top - bottom)
        x = low + (high - low) * float(np.arccos(share)) / np.pi
        low = max(low, phi)
        x = min(max(x, low), high)
        for _ in range(80):
            value, slope = self.at(x)
            gap, slope = sign * value - goal, sign * slope
            if gap > 0:
                high = x
            else:
                low = x
            new = x - gap / slope if slope > 0 else 0.5 * (low + high)
            if not low <= new <= high:
                new = 0.5 * (low + high)
            # Newton squares its error: after so small a step the next one would be below rounding.
            if abs(new - x) <= 1e-9:
                return new
            x = new
        return x
