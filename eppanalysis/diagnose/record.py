"""A record of signals over time: read from a file, and what its oscillation is: period, growth, harmonics, noise.

The harmonics are fitted by least squares with mean and drift, frequency and growth by variable projection (Golub and
Pereyra, SIAM J Numer Anal 10, 1973). How uncertain a harmonic is follows from what the record holds between harmonics.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from eppanalysis.arrays import Array, ComplexArray
from eppanalysis.errors import EppError
from eppanalysis.records.formats import Given
from eppanalysis.records.reading import read_signals

#: Fewest periods and samples a period, most harmonics, and samples a period that a harmonic needs.
FEWEST_PERIODS, FEWEST_SAMPLES, _MOST_HARMONICS, PER_HARMONIC = 3.0, 8, 7, 2.5
#: Fractions of the strongest line's frequency at which the fundamental is looked for.
_PARTS = (1, 2, 3)
#: Standard deviation, relative to the largest value, that is rounding.
_STILL = 1e-10
#: Share of the variance that the harmonics must explain, of the signal that they explain best.
_EXPLAINED = 0.5
#: Lines of the spectrum within which two sines are not distinguished; chance below which a line is no noise, and share
#: of the oscillation from which on it is named: a model's waveform may be off by as much.
_NEAREST, _CHANCE, _SEEN = 2.0, 1e-6, 0.05
#: Part of a sample's distance within which samples are even; points of a grid for each that is not.
_EVEN, _FINE = 1e-3, 8
#: Places between two harmonics at which the noise is read, in multiples of the fundamental.
_BETWEEN = np.array([-0.45, -0.35, -0.25, 0.25, 0.35, 0.45])


@dataclass(frozen=True, eq=False)
class Record:
    """Measured signals."""

    source: str  # the file, or what the record was given as
    time: Array  # (n,): [s], ascending
    signals: dict[str, Array]  # (n,): by the loop's names, in SI units
    notes: tuple[str, ...] = ()  # what happened to the rows of the file


@dataclass(frozen=True)
class Line:
    """A sine in a record beside its oscillation."""

    signal: str
    frequency: float  # [Hz]
    share: float  # its amplitude over that of the largest harmonic of the oscillation


@dataclass(frozen=True, eq=False)
class Oscillation:
    """The oscillation of a record."""

    omega: float  # [rad/s]
    omega_error: float  # its standard deviation, relative
    #: growth, growth_error: of the amplitude per period, as a logarithm; its standard deviation.
    growth: float
    growth_error: float
    names: tuple[str, ...]
    #: (signals, K): coefficients c[k] of ``sum Re(c[k] exp((growth + j k omega) (t - middle)))``, k = 1 ... K.
    harmonics: ComplexArray
    variance: Array  # (signals, K): of each coefficient, of its real and imaginary part together
    noise: dict[str, float]  # standard deviation of what the harmonics leave, by signal
    middle: float  # time to which the phases refer [s]
    n_periods: float
    #: mean, drift: what is taken off each signal: at `middle`, and per second.
    mean: dict[str, float] = field(default_factory=dict)
    drift: dict[str, float] = field(default_factory=dict)
    others: tuple[Line, ...] = ()  # the largest sine in each signal above what the harmonics leave

    @property
    def period(self) -> float:
        """[s]"""
        return 2.0 * np.pi / self.omega


def record_of(given: Given, units: Mapping[str, str], columns: Mapping[str, tuple[str, str]] | None = None) -> Record:
    """A record of signals of a loop, from a file or from what is in memory.

    Parameters
    ----------
    given : path, mapping of str to array, DataFrame, Dataset or DataArray
        It has a column ``time [s]`` and one a signal, such as ``theta [deg]``.
    units : mapping of str to str
        SI unit of every signal that the loop has.
    columns : mapping of str to (str, str), optional
        Name and unit of a signal whose column has another name.

    Raises
    ------
    EppError
        If it is no such table, or holds no signal of the loop.
    """
    recording = read_signals(given, tuple(units), units, columns, fewest=4 * FEWEST_SAMPLES)
    found = {name: recording[name] for name in units if name in recording}
    return Record(recording.source, recording["time"], found, tuple(recording.sentences()))


def oscillation_of(record: Record, fewest: float = FEWEST_SAMPLES, rates: Sequence[float] = ()) -> Oscillation:
    """Period, growth and harmonics of a record.

    Parameters
    ----------
    fewest : float
        Samples a period that it must have.
    rates : sequence of float
        At which controllers are executed [rad/s]: about them what is held has images of the oscillation.

    Raises
    ------
    EppError
        If it holds less than three periods, too few samples a period, or nothing that repeats itself.
    """
    names = tuple(record.signals)
    t = record.time - 0.5 * (record.time[0] + record.time[-1])
    Y = np.column_stack([record.signals[name] for name in names])
    span, n = float(np.ptp(t)), len(t)
    if n < 4 * FEWEST_SAMPLES:
        raise EppError(f"{record.source}: has {n} samples; expected three periods with {FEWEST_SAMPLES} each or more.")
    left = Y - _trend(t, Y)
    # Signals in units of their own motion count alike, whatever they are measured in.
    with np.errstate(over="ignore"):
        size = left.std(axis=0)
    if not np.all(np.isfinite(size)):
        large = names[int(np.argmin(np.isfinite(size)))]
        raise EppError(f"{record.source}: {large} has numbers beyond all range; expected values of ordinary magnitude.")
    still_ones = size <= _STILL * np.abs(Y).max(axis=0)
    if np.any(still_ones):
        still = names[int(np.argmax(still_ones))]
        raise EppError(f"{record.source}: {still} does not move; expected signals that oscillate.")
    scaled = left / size
    line = _strongest_line(t, scaled)
    omega = _fundamental(t, scaled, line)
    if omega * span < 2.0 * np.pi * FEWEST_PERIODS * 0.98:
        periods = omega * span / (2.0 * np.pi)
        period = 2.0 * np.pi / omega
        raise EppError(f"{record.source}: holds {periods:.2g} periods of {period:.4g} s; expected 3 or more.")
    if 2.0 * np.pi / omega < fewest * span / n:
        each = 2.0 * np.pi * n / (omega * span)
        raise EppError(f"{record.source}: has {each:.2g} samples a period; expected {fewest:g} or more.")
    # The line of a spectrum is as wide as the record is short: a growing sine with its harmonics tells more.
    K = _count(t, omega)
    (omega, rate), cov = _refined(t, scaled, omega, K)
    c, rest = _fitted(t, scaled, omega, rate, K)
    if np.max(1.0 - rest.var(axis=0)) < _EXPLAINED:
        best = 100.0 * float(np.max(1.0 - rest.var(axis=0)))
        raise EppError(
            f"{record.source}: a period of {2 * np.pi / omega:.4g} s, the best, explains {best:.2g} % of the signals; "
            "expected an oscillation that repeats itself."
        )
    variance, excess = _noise_between(t, rest, omega, K)
    period = 2.0 * np.pi / omega
    errors = np.sqrt(excess * np.maximum(np.diag(cov), 0.0))
    trend = _trend_coefficients(t, Y - size * (scaled - rest - _trend(t, scaled - rest)))
    return Oscillation(
        omega, float(errors[0] / omega), float(rate * period), float(errors[1] * period), names,
        size[:, None] * c, size[:, None] ** 2 * variance,
        dict(zip(names, (size * rest.std(axis=0)).tolist(), strict=True)),
        float(0.5 * (record.time[0] + record.time[-1])), span / period,
        dict(zip(names, trend[0].tolist(), strict=True)), dict(zip(names, trend[1].tolist(), strict=True)),
        tuple(_lines_beside(t, rest, omega, c, names, rates)),
    )  # fmt: skip


def _lines_beside(
    t: Array, rest: Array, omega: float, c: ComplexArray, names: Sequence[str], rates: Sequence[float]
) -> Iterator[Line]:
    """The largest sine of each signal in what the harmonics leave, where noise has none so large.

    As wide as a line of so short a record is, what lies about a multiple of the fundamental belongs to that, and what
    lies about its images at multiples of a sample rate to these.
    """
    width, K = 2.0 * np.pi / float(np.ptp(t)), c.shape[1]
    places = np.arange(_NEAREST, 0.5 * len(t), 0.25) * width
    places = places[np.abs(places - omega * np.round(places / omega)) > _NEAREST * width]
    for rate in rates:
        aside = places - rate * np.maximum(np.round(places / rate), 1.0)
        image = np.abs(aside - omega * np.clip(np.round(aside / omega), -K, K)) <= _NEAREST * width
        places = places[~image]
    if not places.size:
        return
    found = _spectrum(t, rest)[np.round(places / (0.25 * width)).astype(int)]
    for i, name in enumerate(names):
        k = int(np.argmax(found[:, i]))
        size = abs(_amplitudes(t, rest[:, [i]], places[[k]]).item())
        # The power of a line in white noise is exponential: the chance that the largest of n has so much.
        power = len(t) * size**2 / (4.0 * max(float(rest[:, i].var()), 1e-300))
        share = size / float(np.abs(c[i]).max(initial=1e-300))
        if len(t) * np.exp(-power) < _CHANCE and share > _SEEN:
            yield Line(name, float(places[k] / (2.0 * np.pi)), share)


def _trend_coefficients(t: Array, Y: Array) -> Array:
    return np.asarray(np.linalg.lstsq(np.column_stack([np.ones_like(t), t]), Y, rcond=None)[0], float)


def _trend(t: Array, Y: Array) -> Array:
    return np.column_stack([np.ones_like(t), t]) @ _trend_coefficients(t, Y)


def _amplitudes(t: Array, Y: Array, omegas: Array) -> ComplexArray:
    """Amplitudes at frequencies, shape (frequencies, signals)."""
    out = np.empty((len(omegas), Y.shape[1]), complex)
    for i in range(0, len(omegas), 64):
        out[i : i + 64] = np.exp(-1j * np.outer(omegas[i : i + 64], t)) @ Y * (2.0 / len(t))
    return out


def _spectrum(t: Array, Y: Array) -> Array:
    """Sizes of amplitudes at quarters of the width of a line, to twice as many as there are samples.

    Each sample is shared between the two nearest points of an even grid, eight to a sample, which leaves lines where
    they are and takes 2 % off the fastest; samples that are even lie on one of their own, and lose nothing.
    """
    n = len(t)
    at = (t - t[0]) * ((n - 1) / float(np.ptp(t)))
    fine = 1 if np.abs(at - np.round(at)).max() < _EVEN else _FINE
    length = 4 * fine * (n - 1)
    left = np.minimum((fine * at + (0.5 if fine == 1 else 0.0)).astype(int), fine * (n - 1))
    share = np.zeros(n) if fine == 1 else fine * at - left
    out = np.empty((2 * n, Y.shape[1]))
    for i, y in enumerate(Y.T):
        grid = np.bincount(left, (1.0 - share) * y, length) + np.bincount(left + 1, share * y, length)
        whole = np.abs(np.fft.rfft(grid)) * (2.0 / n)
        out[:, i] = whole[np.minimum(np.arange(2 * n), length - np.arange(2 * n))]
    return out


def _strongest_line(t: Array, Y: Array) -> float:
    """Frequency [rad/s] at which the signals together have most power."""
    span = float(np.ptp(t))
    n = 1 << int(np.ceil(np.log2(len(t))))
    # A start for the fit, so that uneven samples may be interpolated; below one and a half periods it is drift.
    grid = np.linspace(t[0], t[-1], n)
    even = np.column_stack([np.interp(grid, t, y) for y in Y.T]) * np.hanning(n)[:, None]
    power = np.sum(np.abs(np.fft.rfft(even, 4 * n, axis=0)) ** 2, axis=1)
    omegas = 2.0 * np.pi * np.fft.rfftfreq(4 * n, span / (n - 1))
    power[omegas * span < 2.0 * np.pi * 1.5] = 0.0
    return float(omegas[int(np.argmax(power))])


def _count(t: Array, omega: float) -> int:
    """Harmonics that the sampling shows."""
    samples = 2.0 * np.pi / omega * (len(t) - 1) / float(np.ptp(t))
    return int(np.clip(samples / PER_HARMONIC, 1, _MOST_HARMONICS))


def _fundamental(t: Array, Y: Array, line: float) -> float:
    """The strongest line's frequency, or a fraction of it where that explains more than its harmonics cost."""
    costs = []
    for part in _PARTS:
        if line / part * float(np.ptp(t)) < 2.0 * np.pi * FEWEST_PERIODS and part > 1:
            continue
        K = _count(t, line) * part
        omega = _refined(t, Y, line / part, K, grows=False)[0][0]
        rest = _fitted(t, Y, omega, 0.0, K)[1]
        # Schwarz's criterion: more harmonics always fit better, and must pay for it.
        cost = Y.size * np.log(max(float(np.mean(rest**2)), 1e-12)) + 2 * K * Y.shape[1] * np.log(len(t))
        costs.append((cost, omega))
    return min(costs)[1]


def _design(t: Array, omega: float, rate: float, K: int) -> Array:
    phases = np.outer(t, omega * np.arange(1, K + 1))
    swell = np.exp(rate * t)[:, None]
    return np.hstack([np.ones((len(t), 1)), t[:, None], swell * np.cos(phases), swell * np.sin(phases)])


def _fitted(t: Array, Y: Array, omega: float, rate: float, K: int) -> tuple[ComplexArray, Array]:
    """Coefficients, shape (signals, K), and what they leave."""
    X = _design(t, omega, rate, K)
    b = np.linalg.lstsq(X, Y, rcond=None)[0]
    return (b[2 : 2 + K] - 1j * b[2 + K :]).T, Y - X @ b


def _refined(t: Array, Y: Array, omega: float, K: int, grows: bool = True) -> tuple[Array, Array]:
    """Frequency and rate of growth by least squares, and their covariance where the noise is white."""
    from scipy.optimize import least_squares

    span = float(np.ptp(t))
    n = 2 if grows else 1

    def rest(q: Array) -> Array:
        return _fitted(t, Y, omega + q[0] / span, q[1] / span if grows else 0.0, K)[1].ravel()

    found = least_squares(rest, np.zeros(n), diff_step=[1e-4] * n, x_scale=0.1, max_nfev=30)
    level = 2.0 * found.cost / max(Y.size - (2 * K + 2) * Y.shape[1] - n, 1)
    J = np.asarray(found.jac, float)
    cov = level * np.linalg.pinv(J.T @ J) / span**2
    return np.array([omega + found.x[0] / span, found.x[1] / span if grows else 0.0]), cov


def _noise_between(t: Array, rest: Array, omega: float, K: int) -> tuple[Array, float]:
    """Variance of each harmonic from what is left beside it, and that of the first in units of white noise."""
    # What is left between the harmonics is the noise about them, whatever
    # its colour (docs/howto/diagnose.md, What the verdict rests on).
    places = omega * (np.arange(1, K + 1)[:, None] + _BETWEEN)
    power = np.abs(_amplitudes(t, rest, places.ravel())) ** 2
    variance = power.reshape(K, len(_BETWEEN), -1).mean(axis=1).T
    white = 4.0 * rest.var(axis=0) / len(t)
    variance = np.maximum(variance, 0.25 * white[:, None])
    return variance, float(max(1.0, np.mean(variance[:, 0] / np.maximum(white, 1e-300))))


def waveform(oscillation: Oscillation, c: Sequence[complex] | ComplexArray, t: Array) -> Array:
    """A signal from its harmonics, without growth, at times from `middle` on."""
    k = np.arange(1, len(c) + 1)
    return np.real(np.exp(1j * np.outer(t, oscillation.omega * k)) @ np.asarray(c))
