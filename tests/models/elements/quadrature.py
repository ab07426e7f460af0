"""Describing functions by quadrature of the elements' own time-domain maps: the witness of every closed form.

Nothing here knows a closed form. The map is applied at the turning points of the input until its memory repeats, then
at the nodes of Gauss-Legendre panels whose ends are the phases at which the map switches.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.integrate import quad

NODES, WEIGHTS = np.polynomial.legendre.leggauss(32)


@dataclass(frozen=True)
class Fourier:
    """Mean, gain and the size of the output, against which both are judged."""

    mean: np.ndarray
    gain: np.ndarray
    size: float


def crossings(levels: Iterable[float], amplitude: float, bias: float) -> list[float]:
    """Phases in -pi/2..3 pi/2 at which ``bias + amplitude sin(phi)`` passes each of `levels`."""
    out = []
    for level in levels:
        d = level - bias
        if abs(d) < amplitude:
            phi = float(np.arctan2(d, np.sqrt(amplitude - d) * np.sqrt(amplitude + d)))
            out += [phi, np.pi - phi]
    return out


def steady_memories(element: Any, amplitude: float, bias: float, start: Any = None) -> tuple[Any, Any]:
    """Memories at the trough and at the peak after three periods."""
    memory = element.output(bias, start)[1]
    for _ in range(3):
        peak = element.output(bias + amplitude, memory)[1]
        memory = element.output(bias - amplitude, peak)[1]
    return memory, peak


def panels(switches: Iterable[float], begin: float, end: float) -> list[tuple[float, float]]:
    """The span from `begin` to `end`, split at the switches inside it and then into pieces of at most 0.4 rad."""
    cuts = [begin, *sorted(p for p in switches if begin < p < end), end]
    out = []
    for left, right in zip(cuts[:-1], cuts[1:], strict=True):
        edges = np.linspace(left, right, int(np.ceil((right - left) / 0.4)) + 1)
        out += list(zip(edges[:-1], edges[1:], strict=True))
    return out


def fourier(
    element: Any, amplitude: float, bias: float = 0.0, switches: Iterable[float] = (), start: Any = None
) -> Fourier:
    """Fourier coefficients of the steady output of an element with one input."""
    trough, peak = steady_memories(element, amplitude, bias, start)
    switches = list(switches)
    total, size = 0.0, 0.0
    for begin, end, memory in ((-np.pi / 2, np.pi / 2, trough), (np.pi / 2, 1.5 * np.pi, peak)):
        for left, right in panels(switches, begin, end):
            phi = (left + right) / 2 + (right - left) / 2 * NODES
            y = np.asarray(element.output(bias + amplitude * np.sin(phi), memory)[0])
            part, peak_here = _panel(phi, (right - left) / 2 * WEIGHTS, y)
            total, size = total + part, max(size, peak_here)
    return _result(total, amplitude, size)


def fourier_with_rate(
    element: Any, amplitude: float, bias: float, omega: float, switches: Iterable[float] = ()
) -> Fourier:
    """The same for a memoryless element of position and rate."""
    total, size = 0.0, 0.0
    for left, right in panels(list(switches), -np.pi / 2, 1.5 * np.pi):
        phi = (left + right) / 2 + (right - left) / 2 * NODES
        y = element.output((bias + amplitude * np.sin(phi), amplitude * omega * np.cos(phi)))[0]
        part, peak_here = _panel(phi, (right - left) / 2 * WEIGHTS, np.asarray(y))
        total, size = total + part, max(size, peak_here)
    return _result(total, amplitude, size)


def fourier_adaptive(element: Any, amplitude: float, bias: float, switches: Iterable[float] = ()) -> Fourier:
    """The same by adaptive quadrature, for static elements with steep but smooth pieces."""

    def integral(weight: Callable[[float], float]) -> float:
        def integrand(phi: float) -> float:
            return float(element.output(bias + amplitude * np.sin(phi))[0]) * weight(phi)

        cuts = [-np.pi / 2, *sorted(p for p in switches if -np.pi / 2 < p < np.pi / 2), np.pi / 2]
        return 2 * sum(
            quad(integrand, left, right, epsabs=1e-13, epsrel=1e-12, limit=400)[0]
            for left, right in zip(cuts[:-1], cuts[1:], strict=True)
        )

    phi = np.linspace(-np.pi / 2, np.pi / 2, 2001)
    size = float(np.abs(element.output(bias + amplitude * np.sin(phi))[0]).max())
    return _result(np.array([integral(lambda phi: 1.0), integral(np.sin), 0.0]), amplitude, size)


def _panel(phi: np.ndarray, weights: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, float]:
    kernels = np.stack([np.ones_like(phi), np.sin(phi), np.cos(phi)])
    return np.tensordot(kernels * weights, y, axes=1), float(np.abs(y).max())


def _result(total: Any, amplitude: float, size: float) -> Fourier:
    mean, sine, cosine = np.asarray(total)
    return Fourier(mean / (2 * np.pi), (sine + 1j * cosine) / (np.pi * amplitude), size)


def assert_agrees(
    answer: tuple[Any, Any], witness: Fourier, amplitude: float, tolerance: float = 1e-9, rounding: float = 0.0
) -> None:
    """The closed form `answer` against the quadrature, relative to the size of the output (over the amplitude).

    `rounding` is the absolute rounding of the map itself, which matters where its terms nearly cancel.
    """
    mean, gain = answer
    allowed = tolerance * max(witness.size, 1e-300) + rounding
    np.testing.assert_allclose(mean, witness.mean, rtol=0, atol=allowed)
    np.testing.assert_allclose(gain, witness.gain, rtol=0, atol=2 * allowed / amplitude)
