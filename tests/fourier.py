"""Fourier series of tests, and what is known of them without the package: values, extrema."""

from __future__ import annotations

import numpy as np


def series(n: int, mean: float, size: float, seed: int) -> np.ndarray:
    """Random coefficients of order n that fall off slowly, shape (1, n + 1)."""
    random = np.random.default_rng(seed)
    c = size * random.normal(size=n + 1) * np.exp(2j * np.pi * random.uniform(size=n + 1)) / np.arange(1, n + 2)
    c[0], c[1] = mean, size * np.exp(1j * np.angle(c[1]))
    return c[None]


def turning_points(c: np.ndarray) -> np.ndarray:
    """Extrema by the roots of a polynomial in exp(j phi) (not the way the package finds them)."""
    k = np.arange(c.size)
    slope = 1j * k * c
    roots = np.roots(np.concatenate([slope[:0:-1], [0.0], np.conj(slope[1:])]))
    on_circle = roots[np.abs(np.abs(roots) - 1.0) < 1e-6]
    return np.sort(np.angle(on_circle) % (2 * np.pi))


def value(c: np.ndarray, phi: float | np.ndarray) -> np.ndarray:
    return (np.exp(1j * np.multiply.outer(phi, np.arange(c.size))) @ c).real
