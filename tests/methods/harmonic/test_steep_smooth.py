"""Balances of smooth functions that are steep beside the motion: resolved where they are, in little memory."""

from __future__ import annotations

import tracemalloc

import numpy as np
import pytest
from scipy import integrate

import eppanalysis as epp


def quadrature(element, amplitude: float, bias: float, k: int) -> complex:
    """A coefficient of the answer to a sine, half wave by half wave between the peaks, kinks located."""
    centre = float(np.arcsin(np.clip(-bias / amplitude, -1.0, 1.0)))

    def integral(wave) -> float:
        def f(phi: float) -> float:
            return float(element.output(bias + amplitude * np.sin(phi))[0]) * wave(k * phi)

        edges = np.unique([-0.5 * np.pi, centre, 0.5 * np.pi, np.pi - centre, 1.5 * np.pi])
        narrow = np.concatenate([e + np.array([-1e-2, -1e-4, -1e-6, 0.0, 1e-6, 1e-4, 1e-2]) for e in edges])
        edges = np.unique(np.clip(narrow, -0.5 * np.pi, 1.5 * np.pi))
        parts = zip(edges[:-1], edges[1:], strict=True)
        return sum(integrate.quad(f, a, b, limit=200, epsabs=1e-13, epsrel=1e-12)[0] for a, b in parts)

    return complex(integral(np.sin), integral(np.cos)) / np.pi


@pytest.mark.parametrize("slope", [1.0, 1e2, 1e4, 1e6])
@pytest.mark.parametrize("bias", [0.0, 0.3])
def test_harmonics_of_a_steep_curve_are_those_of_quadrature(slope, bias):
    """Panels are halved at the steep place alone, down to its width."""
    curve = epp.Tanh(level=1.0, slope=slope)
    H = epp.sinusoidal_harmonics(curve, amplitude=2.0, bias=bias, order=7)
    for k in (1, 3, 7):
        assert 2.0 * H[0, k] == pytest.approx(quadrature(curve, 2.0, bias, k), abs=1e-11)


@pytest.mark.parametrize("order", [25, 200])
def test_a_steep_curve_needs_little_memory(order):
    """Of all phases by all orders at once it would be gigabytes."""
    tracemalloc.start()
    epp.sinusoidal_harmonics(epp.Tanh(level=1.0, slope=1e5), amplitude=2.0, bias=0.3, order=order)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 64e6
