"""Truncated Fourier series: values and all extrema.

A series is a row of complex coefficients c[0..n], real c[0], and means ``Re(sum c[k] exp(j k phi))``.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from eppanalysis.arrays import Array, ComplexArray, IntArray
from eppanalysis.engine.harmonics import find_extrema

TURN = 2.0 * np.pi


@lru_cache(maxsize=64)
def orders(n: int) -> Array:
    """0, 1, ..., n as floats."""
    k = np.arange(n + 1, dtype=float)
    k.flags.writeable = False
    return k


def anchored(Z: ComplexArray) -> tuple[ComplexArray, int]:
    """A motion, begun where the fundamental of the first input that moves is a rising sine, and that input."""
    pivot = int(np.argmax(np.abs(Z[:, 1]) > 0))
    turn = -np.pi / 2 - np.angle(Z[pivot, 1])
    return Z * np.exp(1j * turn * orders(Z.shape[1] - 1)), pivot


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
    """All extrema of series (m, n + 1): for each the phases in [0, 2 pi), increasing, and the values there."""
    phase, value, counts = workspaces(c)
    return [(p[:count], v[:count]) for p, v, count in zip(phase, value, counts, strict=True)]


def workspaces(c: ComplexArray) -> tuple[Array, Array, IntArray]:
    """Phases and values of the extrema of series (m, n + 1), in rows that are filled up to a count, and the counts."""
    m, n = c.shape[0], c.shape[1] - 1
    phase, value = np.zeros((m, 8 * n + 32)), np.zeros((m, 8 * n + 32))
    counts = np.array([find_extrema(c[i], phase[i], value[i]) for i in range(m)], np.int64)
    return phase, value, counts
