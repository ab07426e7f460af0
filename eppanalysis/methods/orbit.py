"""Mean, extrema and harmonics of one period from samples on the smooth arcs between its events.

Every arc is cut into pieces on which the signals are analytic and vary little; each piece carries Gauss-Legendre nodes,
so that integrals are spectrally exact and the interpolating polynomial gives extrema that lie between the samples.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, cached_property

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import NDArray

Array = NDArray[np.float64]

N_NODES = 16
N_HARMONICS = 25
_TRIED = 4


@dataclass(frozen=True, eq=False)
class PeriodShape:
    """What a period looks like: see :class:`eppanalysis.results.LimitCycle` for the meaning of the fields."""

    mean: dict[str, float]
    peak_to_peak: dict[str, float]
    harmonics: dict[str, NDArray[np.complex128]]
    time: Array
    waveform: dict[str, Array]


def analyse_period(
    marks: Array, delays: Array, time_scale: float, names: Sequence[str], sample: Callable[[Array], Array]
) -> PeriodShape:
    """Sample a period on pieces fine enough for every signal, and analyse it.

    Parameters
    ----------
    marks : array, shape (events + 1,)
        Times of the events from the begin of the period to its end [s].
    delays : array
        Dead times [s] after which a switch is felt again.
    time_scale : float
        First guess of the length on which signals vary moderately [s].
    names : sequence of str
        Of the signals.
    sample : callable
        From increasing times, shape (nt,), to signals, shape (nt, len(names)).
    """
    corners = _corners(marks, delays)
    period = float(marks[-1] - marks[0])
    # The highest harmonic too must vary moderately on a piece, or its integral is not exact.
    longest = min(max(time_scale, period / 2000), period / 16)
    for _ in range(6):
        pieces = _Pieces.cut(corners, longest)
        values = sample(pieces.times)
        if pieces.resolved(values):
            break
        longest = float(pieces.size.max()) / 2
    return pieces.analyse(dict(zip(names, values.T, strict=True)))


def _corners(marks: Array, delays: Array) -> Array:
    """Times between which all signals are smooth: the events, and their echoes behind each dead time."""
    begin, period = marks[0], marks[-1] - marks[0]
    echoes = [begin + (marks - begin + delay) % period for delay in delays if delay > 0]
    corners = np.unique(np.concatenate([marks, *echoes]))
    near = np.diff(corners) > 1e-12 * period
    return np.append(corners[:-1][near], marks[-1])


@cache
def _rule() -> tuple[Array, Array]:
    """Nodes and weights of Gauss and Legendre."""
    return legendre.leggauss(N_NODES)


@cache
def _to_coefficients() -> Array:
    """From values at the nodes to Legendre coefficients, shape (N_NODES, N_NODES)."""
    nodes, weights = _rule()
    degrees = np.arange(N_NODES)
    return (legendre.legvander(nodes, N_NODES - 1) * weights[:, None]).T * (2 * degrees[:, None] + 1) / 2


@dataclass(frozen=True, eq=False)
class _Pieces:
    """Smooth pieces of a period, with Gauss-Legendre nodes on each."""

    start: Array
    size: Array

    @classmethod
    def cut(cls, corners: Array, longest: float) -> _Pieces:
        counts = np.ceil(np.diff(corners) / longest).astype(int)
        size = np.repeat(np.diff(corners) / counts, counts)
        start = np.concatenate(
            [a + (b - a) / n * np.arange(n) for a, b, n in zip(corners, corners[1:], counts, strict=False)]
        )
        return cls(start, size)

    @cached_property
    def times(self) -> Array:
        """Sample times [s], increasing, shape (pieces * N_NODES,)."""
        nodes, _ = _rule()
        return (self.start[:, None] + self.size[:, None] * (nodes + 1) / 2).ravel()

    def coefficients(self, y: Array) -> Array:
        """Legendre coefficients on each piece, shape (pieces, N_NODES); Gauss quadrature is exact for them."""
        # einsum, not BLAS: its threads cost far more than these small products.
        return np.einsum("ij,kj->ik", y.reshape(-1, N_NODES), _to_coefficients())

    def resolved(self, values: Array) -> bool:
        """Whether the last coefficients of every signal are near rounding of its range."""
        for y in values.T:
            tail = np.abs(self.coefficients(y)[:, -2:]).max()
            if not tail <= 1e-12 * max(np.ptp(y), 1e-6 * np.abs(y).max()):
                return False
        return True

    def analyse(self, samples: Mapping[str, Array]) -> PeriodShape:
        """Mean, peak-to-peak, harmonics and waveform of signals sampled at `times`."""
        _, weights = _rule()
        begin, period = float(self.start[0]), float(self.size.sum())
        w = (self.size[:, None] * weights / 2).ravel() / period
        grid = np.linspace(-1.0, 1.0, 33)
        on_grid = legendre.legvander(grid, N_NODES - 1)
        # Powers of the first harmonic cost far less than exponentials of all.
        first = np.exp(-2j * np.pi * (self.times - begin) / period)
        phases = np.multiply.accumulate(np.vstack([2.0 * w, *[first] * N_HARMONICS]), axis=0)
        mean, harmonics, waveform = {}, {}, {}
        fine_t = (self.start[:, None] - begin + self.size[:, None] * (grid[:-1:4] + 1) / 2).ravel()
        c = np.array([self.coefficients(y) for y in samples.values()])
        fine = np.einsum("sij,kj->sik", c, on_grid)
        both = _maxima(np.concatenate([c, -c]), np.concatenate([fine, -fine]), grid)
        peak = dict(zip(samples, (both[: len(c)] + both[len(c) :]).tolist(), strict=True))
        parts = (np.einsum("ij,sj->si", part, np.array([*samples.values()])) for part in (phases.real, phases.imag))
        all_coefficients = next(parts) + 1j * next(parts)
        all_coefficients[:, 0] /= 2.0
        for name, coefficients, values in zip(samples, all_coefficients, fine, strict=True):
            harmonics[name], mean[name] = coefficients, float(coefficients[0].real)
            waveform[name] = values[:, :-1:4].ravel()
        return PeriodShape(mean, peak, harmonics, fine_t, waveform)


def _maxima(c: Array, fine: Array, grid: Array) -> Array:
    """Maximum of each signal, shape (signals,): its best grid values, each refined by Newton on its own piece.

    The best grid value may stand at the end of a piece with the maximum just inside the next one: several of the
    best pieces are tried. `c` are Legendre coefficients, shape (signals, pieces, N_NODES), `fine` values on the grid.
    """
    best = np.argsort(fine.max(axis=2), axis=1)[:, -_TRIED:]
    rows = np.arange(len(c))[:, None]
    c, fine = c[rows, best], fine[rows, best]
    slope, bend = (legendre.legder(c, order, axis=2) for order in (1, 2))
    u = grid[np.argmax(fine, axis=2)]
    for _ in range(8):
        basis = legendre.legvander(u, N_NODES - 2)
        rate = np.einsum("spj,spj->sp", basis, slope)
        curvature = np.einsum("spj,spj->sp", basis[..., :-1], bend)
        turns = curvature < 0
        if not np.any(turns):
            break
        u = np.where(turns, np.clip(u - rate / np.where(turns, curvature, 1.0), -1.0, 1.0), u)
    refined = np.einsum("spj,spj->sp", legendre.legvander(u, N_NODES - 1), c)
    return np.maximum(fine.max(axis=(1, 2)), refined.max(axis=1))
