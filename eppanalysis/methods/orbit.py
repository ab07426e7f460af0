"""Mean, extrema and harmonics of one period from samples on the smooth arcs between its events.

Every arc is cut into pieces on which the signals are analytic and vary little; each piece carries Gauss-Legendre nodes,
so that integrals are spectrally exact and the interpolating polynomial gives extrema that lie between the samples.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import NDArray

Array = NDArray[np.float64]

N_NODES = 16
N_HARMONICS = 25


@dataclass(frozen=True, eq=False)
class PeriodShape:
    """What a period looks like: see :class:`eppanalysis.results.LimitCycle` for the meaning of the fields."""

    mean: dict[str, float]
    peak_to_peak: dict[str, float]
    harmonics: dict[str, NDArray[np.complex128]]
    time: Array
    waveform: dict[str, Array]


class PeriodSampler:
    """Where to sample a period, and what to make of the samples.

    Parameters
    ----------
    marks : array, shape (events + 1,)
        Times of the events from the begin of the period to its end [s].
    time_scale : float
        Length over which the loop's linear part varies moderately [s].
    """

    def __init__(self, marks: Array, time_scale: float) -> None:
        lengths = np.diff(marks)
        keep = lengths > 1e-13 * (marks[-1] - marks[0])
        self.begin, self.end = float(marks[0]), float(marks[-1])
        longest = max(4.0 * time_scale, (self.end - self.begin) / 2000)
        counts = np.ceil(lengths[keep] / longest).astype(int)
        starts, sizes = [], []
        for a, length, n in zip(marks[:-1][keep], lengths[keep], counts, strict=True):
            starts.append(a + length / n * np.arange(n))
            sizes.append(np.full(n, length / n))
        self.start, self.size = np.concatenate(starts), np.concatenate(sizes)

    @cached_property
    def _rule(self) -> tuple[Array, Array]:
        return legendre.leggauss(N_NODES)

    @cached_property
    def times(self) -> Array:
        """Sample times [s], increasing, shape (pieces * N_NODES,)."""
        nodes, _ = self._rule
        return (self.start[:, None] + self.size[:, None] * (nodes + 1) / 2).ravel()

    def analyse(self, samples: Mapping[str, Array]) -> PeriodShape:
        """Mean, peak-to-peak, harmonics and waveform of signals sampled at `times`."""
        nodes, weights = self._rule
        period = self.end - self.begin
        t = self.times - self.begin
        w = (self.size[:, None] * weights / 2).ravel() / period
        # Legendre coefficients from nodal values: Gauss quadrature is exact for them.
        degrees = np.arange(N_NODES)
        to_coefficients = (legendre.legvander(nodes, N_NODES - 1) * weights[:, None]).T * (2 * degrees[:, None] + 1) / 2
        grid = np.linspace(-1.0, 1.0, 33)
        on_grid = legendre.legvander(grid, N_NODES - 1)
        phases = np.exp(-2j * np.pi * np.outer(np.arange(N_HARMONICS + 1), t) / period)
        mean, peak, harmonics, waveform = {}, {}, {}, {}
        fine_t = (self.start[:, None] - self.begin + self.size[:, None] * (grid[:-1] + 1) / 2).ravel()
        for name, y in samples.items():
            c = y.reshape(-1, N_NODES) @ to_coefficients.T
            fine = c @ on_grid.T
            peak[name] = _extremum(c, fine, grid) + _extremum(-c, -fine, grid)
            coefficients = 2.0 * phases @ (w * y)
            coefficients[0] /= 2.0
            harmonics[name], mean[name] = coefficients, float(coefficients[0].real)
            waveform[name] = fine[:, :-1].ravel()
        return PeriodShape(mean, peak, harmonics, fine_t, waveform)


def _extremum(c: Array, fine: Array, grid: Array) -> float:
    """Maximum of piecewise polynomials: the best grid value, refined by Newton on its own piece."""
    piece, place = np.unravel_index(int(np.argmax(fine)), fine.shape)
    slope, bend = legendre.legder(c[piece]), legendre.legder(c[piece], 2)
    u = grid[place]
    for _ in range(8):
        curvature = legendre.legval(u, bend)
        if not curvature < 0:
            break
        u = float(np.clip(u - legendre.legval(u, slope) / curvature, -1.0, 1.0))
    return float(max(fine[piece, place], legendre.legval(u, c[piece])))
