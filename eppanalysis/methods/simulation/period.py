"""Mean, extrema and harmonics of one period from samples on the smooth arcs between its events.

Every arc is cut into pieces on which the signals are analytic and vary little; each piece carries Gauss-Legendre nodes,
so that integrals are spectrally exact and the interpolating polynomial gives extrema that lie between the samples.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from numpy.polynomial import legendre

from eppanalysis.arrays import Array, BoolArray, ComplexArray
from eppanalysis.engine.runs import spans
from eppanalysis.errors import EppError
from eppanalysis.models.systems.hybrid import HybridSystem
from eppanalysis.models.systems.lure import LureSystem
from eppanalysis.readable import listed, quantity, words
from eppanalysis.results.deferred import Deferred

N_HARMONICS = 25
#: Nodes on a piece (so many that the last harmonic is resolved on the first pieces), points of the grid on which its
#: extrema are looked for, and each how many of these the waveform has; and the same for periods of so many pieces that
#: each is short (a slow cycle between thousands of samples).
_USUAL, _SHORT, _MANY = (20, 33, 4), (8, 9, 1), 1000
#: Products of numbers in one product of matrices, beneath which libraries leave it to one thread: the others would be
#: waited for longer than it takes.
_ALONE = 2**18
#: Pieces of a period to begin with (so many that every harmonic varies moderately on each), most of them, and how many
#: times as many as the events need.
_FEWEST, _MOST, _MORE = 32, 6000, 1.5
_ROUNDS = 14
#: Tails of the Legendre series, relative to the range of the signal: resolved, and where rounding may begin to show.
_RESOLVED, _ROUNDING = 1e-12, 1e-9
#: Share of a signal that it may go on by in as long a run again, and rests.
_STANDS = 1e-6
#: Share of its range within which a signal has come to where it rests, and of a run by which that must be.
_ENDS, _LATE = 1e-3, 0.98


@dataclass(frozen=True, eq=False)
class PeriodShape:
    """What a period looks like: see :class:`eppanalysis.results.LimitCycle` for the meaning of the fields."""

    mean: dict[str, float]
    peak_to_peak: dict[str, float]
    #: Most cycles are known by their size: these are computed when they are looked at.
    harmonics: Mapping[str, ComplexArray]
    time: Array
    waveform: dict[str, Array]
    #: Root of the mean square about the mean, by quadrature on the pieces.
    rms: Mapping[str, float]

    def moved(self, by: Array) -> PeriodShape:
        """The same with each signal moved."""
        if not np.any(by):
            return self
        waveform = {k: v + move for (k, v), move in zip(self.waveform.items(), by, strict=True)}
        mean = {k: v + float(move) for (k, v), move in zip(self.mean.items(), by, strict=True)}
        harmonics = {k: np.append(mean[k], c[1:]) if c.size else c for k, c in self.harmonics.items()}
        return replace(self, mean=mean, harmonics=harmonics, waveform=waveform)


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
        Length on which signals vary moderately behind an event [s].
    names : sequence of str
        Of the signals.
    sample : callable
        From increasing times, shape (nt,), to signals, shape (nt, len(names)).

    Raises
    ------
    EppError
        If the period has no length, or the signals end before it does.
    """
    corners = _corners(marks, delays)
    period = float(marks[-1] - marks[0])
    if corners.size < 2:
        raise EppError(
            f"A period from {marks[0]:.17g} to {marks[-1]:.17g} s has no length; expected one beyond rounding."
        )
    pieces, before = _Pieces.cut(corners, max(time_scale, 1e-5 * period), period / _FEWEST), None
    values, most = pieces.sampled(sample), max(_MOST, _MORE * pieces.size.size)
    for _ in range(_ROUNDS):
        coarse, before = pieces.unresolved(values, before)
        if not np.any(coarse) or pieces.size.size + np.sum(coarse) > most:
            break
        pieces, before, halves = pieces.halved(coarse, before)
        kept, values = values[:, ~coarse], np.empty((len(names), *pieces.times.shape))
        values[:, ~halves], values[:, halves] = kept, pieces.sampled(sample, halves)
    return pieces.analyse(names, values)


def free_of(hybrid: HybridSystem) -> Array:
    """What signals (rows) follow of the states that need not repeat, shape (signals, n)."""
    n = hybrid.n_plant
    return np.where(hybrid.compared[:n], 0.0, hybrid.model.Yx[:, :n])


def about_zero(hybrid: HybridSystem, shape: PeriodShape) -> Array:
    """By how much integrals that nothing reads are moved, so that the signals that follow them swing about zero.

    Where such an integral lies is left to where a motion began, and these motions are one cycle.
    """
    Y = free_of(hybrid)
    if not np.any(Y):
        return np.zeros(Y.shape[1])
    rows, means = np.zeros((0, Y.shape[1])), np.array(list(shape.mean.values()))
    chosen: list[int] = []
    for k, row in enumerate(Y):
        if np.linalg.matrix_rank(np.vstack([rows, row])) > len(rows):
            rows, chosen = np.vstack([rows, row]), [*chosen, k]
    return np.asarray(-np.linalg.pinv(rows) @ means[chosen], float)


def advance(hybrid: HybridSystem, change: Array) -> Array:
    """What the signals gain where the state changes so (n,), by those of its places that need not repeat."""
    return np.asarray(free_of(hybrid) @ change[: hybrid.n_plant], float)


def advances(system: LureSystem, gained: Array, shape: PeriodShape) -> list[str]:
    """Which signals go on from period to period, in words; nothing where all repeat."""
    units, most = system.signals.units_of_results(), shape.peak_to_peak
    on = [
        f"{quantity(float(more), units.get(name, ''))} to {words(name)}"
        for name, more in zip(system.signals.names, gained, strict=True)
        if abs(more) > _RESOLVED * most[name]
    ]
    return [f"each period adds {listed(on)} to the swing"] if on else []


def resting(signals: Mapping[str, Array], more: Array) -> dict[str, float]:
    """Where signals rest, but for those that go on: the angle of a motor that keeps its speed."""
    still = [m <= _STANDS * np.abs(v).max() for v, m in zip(signals.values(), np.abs(more), strict=True)]
    return {name: float(v[-1]) for (name, v), rests in zip(signals.items(), still, strict=True) if rests}


def moves_until(t: Array, signals: Mapping[str, Array], rest: Iterable[str]) -> float:
    """First of the times from which on the signals at rest are within a thousandth of their range of where they end.

    What is not, late in a run that rests, is rounding.
    """
    last = 0
    for v in (signals[name] for name in rest):
        away = np.flatnonzero(np.abs(v - v[-1]) > _ENDS * np.ptp(v))
        if away.size and t[away[-1]] < _LATE * t[len(v) - 1]:
            last = max(last, int(away[-1]) + 1)
    return float(t[last]) if last else 0.0


def _corners(marks: Array, delays: Array) -> Array:
    """Times between which all signals are smooth: the events, and their echoes behind each dead time."""
    begin, period = marks[0], marks[-1] - marks[0]
    echoes = [begin + (marks - begin + delay) % period for delay in delays if delay > 0]
    # Of two events at one instant the later may come first by rounding.
    corners = np.sort(np.minimum(np.maximum(np.concatenate([marks, *echoes]), begin), marks[-1]))
    last = np.ones(corners.size, bool)
    last[:-1] = corners[1:] - corners[:-1] > 1e-12 * period
    return corners[last]


@dataclass(frozen=True, eq=False)
class _Pieces:
    """Smooth pieces of a period, with Gauss-Legendre nodes on each."""

    start: Array
    size: Array
    #: `_USUAL` or `_SHORT`.
    rule: tuple[int, int, int]

    @classmethod
    def cut(cls, corners: Array, first: float, longest: float) -> _Pieces:
        """Pieces between corners, short behind each, where fast modes die out, and then growing to `longest`."""
        begin, length = corners[:-1], np.diff(corners)
        growing = first * np.cumsum(4.0 ** np.arange(np.log(max(longest / first, 1.0)) / np.log(4.0)))
        short = growing < 0.5 * length[:, None]
        grown = (growing * short).max(axis=1, initial=0.0)
        rest = np.ceil((length - grown) / longest).astype(int)
        gap = np.repeat(np.arange(length.size), rest - 1)
        number = np.arange(gap.size) - np.repeat(np.cumsum(rest - 1) - (rest - 1), rest - 1) + 1
        even = (begin + grown)[gap] + number * ((length - grown) / rest)[gap]
        all_marks = np.sort(np.concatenate([corners, (begin[:, None] + growing)[short], even]))
        return cls(all_marks[:-1], np.diff(all_marks), _USUAL if all_marks.size < _MANY else _SHORT)

    @property
    def times(self) -> Array:
        """Sample times [s], increasing, shape (pieces, nodes)."""
        nodes = _rule(self.rule[0])[0]
        return self.start[:, None] + self.size[:, None] * (nodes + 1) / 2

    def sampled(self, sample: Callable[[Array], Array], which: BoolArray | None = None) -> Array:
        """Signals at the nodes of all pieces, or of some, shape (signals, pieces, nodes).

        A run that is made once more may end before the one that was on the cycle did.
        """
        times = self.times if which is None else self.times[which]
        values = sample(times.ravel())
        if len(values) < times.size:
            raise EppError(
                f"The motion of a period of {self.size.sum():.6g} s could not be computed once more: "
                f"{len(values)} of {times.size} samples."
            )
        return np.ascontiguousarray(values.T).reshape(-1, *times.shape)

    def coefficients(self, values: Array, first: int = 0) -> Array:
        """Legendre coefficients from degree `first` on of signals (s, pieces, nodes), shape (s, pieces, degrees)."""
        # From a node on: at the ends of a piece the rounding of an offset grows with the square of their number. One
        # product of matrices, not one for each signal.
        offset = values[..., :1]
        found = (values - offset).reshape(-1, values.shape[-1]) @ _rule(self.rule[0])[2][first:].T
        found = found.reshape(*values.shape[:-1], -1)
        if first == 0:
            found[..., :1] += offset
        return found

    def unresolved(self, values: Array, before: Array | None) -> tuple[BoolArray, Array]:
        """Pieces on which some signal's last coefficients are neither near rounding of its range nor rounding.

        `before` are the largest tails of the pieces from which these come: where halving no longer shrinks a small
        tail, it is rounding. Returns the tails of these pieces too.
        """
        last = np.abs(self.coefficients(values, self.rule[0] - 2))
        tails, flat = np.maximum(last[..., 0], last[..., 1]), values.reshape(len(values), -1)
        low, high = flat.min(axis=1), flat.max(axis=1)
        size = np.maximum(high - low, 1e-6 * np.maximum(high, -low))
        size[~(size > 0)] = 1.0
        tail = (tails / size[:, None]).max(axis=0)
        coarse = ~(tail <= _RESOLVED)
        if before is not None:
            coarse &= ~((tail < _ROUNDING) & (tail > 0.3 * before))
        return coarse, tail

    def halved(self, coarse: BoolArray, tail: Array) -> tuple[_Pieces, Array, BoolArray]:
        """Marked pieces cut in two; for each new piece the tail of the one it comes from, and whether it is a half."""
        count = np.where(coarse, 2, 1)
        size = np.repeat(self.size / count, count)
        start = np.repeat(self.start, count)
        second = np.cumsum(count)[coarse] - 1
        start[second] += size[second]
        return (
            _Pieces(start, size, self.rule),
            np.repeat(np.where(coarse, tail, np.inf), count),
            np.repeat(coarse, count),
        )

    def analyse(self, names: Sequence[str], values: Array) -> PeriodShape:
        """Mean, peak-to-peak, harmonics and waveform of signals at `times`, shape (s, pieces, nodes)."""
        begin, period = float(self.start[0]), float(self.size.sum())
        n, points, each = self.rule
        w = (self.size[:, None] * _rule(n)[1] / 2).ravel() / period
        grid, on_grid = _grid(n, points)
        flat = values.reshape(len(values), -1)
        mean = flat @ w

        def harmonics() -> dict[str, ComplexArray]:
            turn = np.exp(-2j * np.pi * (self.times.ravel() - begin) / period)
            return dict(zip(names, _harmonics(w, turn, flat), strict=True))

        def rms() -> dict[str, float]:
            return dict(zip(names, np.sqrt((flat - mean[:, None]) ** 2 @ w).tolist(), strict=True))

        c = self.coefficients(values)
        fine = (c.reshape(-1, n) @ on_grid.T).reshape(*c.shape[:-1], points)
        spans(c, fine, grid, peak_to_peak := np.empty(len(c)))
        fine_t = (self.start[:, None] - begin + self.size[:, None] * (grid[:-1:each] + 1) / 2).ravel()
        return PeriodShape(
            dict(zip(names, mean.tolist(), strict=True)),
            dict(zip(names, peak_to_peak.tolist(), strict=True)),
            Deferred(harmonics),
            fine_t,
            dict(zip(names, fine[:, :, :-1:each].reshape(len(names), -1), strict=True)),
            Deferred(rms),
        )


def _harmonics(w: Array, turn: ComplexArray, values: Array) -> ComplexArray:
    """Fourier coefficients of signals (s, nt) with weights of their times, shape (s, N_HARMONICS + 1)."""
    series = np.zeros((len(values), N_HARMONICS + 1), complex)
    size = max(_ALONE // series.size, 1)
    for part in (slice(i, i + size) for i in range(0, w.size, size)):
        phases = np.empty((N_HARMONICS + 1, w[part].size), complex)
        phases[0] = w[part]
        for k in range(N_HARMONICS):
            np.multiply(phases[k], turn[part], out=phases[k + 1])
        series.real += values[:, part] @ phases.real.T
        series.imag += values[:, part] @ phases.imag.T
    series[:, 1:] *= 2.0
    return series


@cache
def _rule(n: int) -> tuple[Array, Array, Array]:
    """Nodes and weights, and the matrix from samples to Legendre coefficients; Gauss quadrature is exact for them."""
    nodes, weights = legendre.leggauss(n)
    degrees = np.arange(n)
    values = legendre.legvander(nodes, n - 1)
    return nodes, weights, (values * weights[:, None]).T * (2 * degrees[:, None] + 1) / 2


@cache
def _grid(n: int, points: int) -> tuple[Array, Array]:
    """Fine grid on a piece, with the Legendre polynomials there."""
    grid: Array = np.linspace(-1.0, 1.0, points)
    return grid, np.asarray(legendre.legvander(grid, n - 1), float)
