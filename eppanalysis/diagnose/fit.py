"""How well each candidate explains an oscillation: period, growth and harmonics, weighted by noise and model error.

The likelihood is normal in the logarithm of the frequency, the growth per period and every harmonic of every signal.
Each has the variance that the record gives it and that of the model, whose relative error is given. What a candidate is
free to choose counts against it by the share of its range that fits (Laplace's method, as in Kass and Raftery, J Am
Stat Assoc 90, 1995): a disturbance of any frequency explains a period less well than a loop that has no other.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field

import numpy as np

from eppanalysis.arrays import Array, ComplexArray
from eppanalysis.diagnose.candidates import Candidates, Family, Sought, Whole
from eppanalysis.diagnose.linear import Linear
from eppanalysis.diagnose.record import Oscillation
from eppanalysis.diagnose.result import DISTURBANCE, LINEAR, OWN
from eppanalysis.errors import EppError
from eppanalysis.results import LimitCycle

#: Growth per period of a steady oscillation that a record may still show, as a share of the model error.
_SETTLING = 0.1
#: Range of a disturbance's frequency, and of the size of what may have any (a decade), and standard deviation of the
#: loop's gain, all as logarithms.
_ANY_FREQUENCY, _ANY_SIZE, _GAIN = float(np.log(10.0)), float(np.log(10.0)), 0.5
#: Chance below which the record tells two candidates apart.
_APART = 1e-3
#: Phases at which a cycle is laid against the record, sizes that are tried for a loop that is not in proportion, and
#: how near the last of them must be.
_PHASES, _SIZES, _NEAR = 256, 6, 0.003
#: Gains at which the poles of the linear loop are looked at, as logarithms.
_GAINS = np.linspace(-2.5, 2.5, 251)
_ROOT = float(np.log(np.sqrt(2.0 * np.pi)))


@dataclass(frozen=True, eq=False)
class Fit:
    """One way in which a candidate explains an oscillation."""

    evidence: float  # logarithm of the likelihood, averaged over what the candidate may choose
    #: misfit, freedom: sum of squares in units of the standard deviations, and how many of them are free.
    misfit: float
    freedom: int
    period: float  # that the candidate has [s]
    harmonics: ComplexArray  # (signals, K): that it has, laid against those of the record
    #: size, size_error: factor on the model's element (or gain), or the amplitude of a disturbance [SI], and the
    #: standard deviation of its logarithm.
    size: float = float("nan")
    size_error: float = float("nan")
    cycle: LimitCycle | None = None
    place: str = ""  # where a disturbance comes in


@dataclass(frozen=True, eq=False)
class Likelihood:
    """An oscillation with the standard deviations that differences from it are measured in."""

    found: Oscillation
    model_error: float
    #: period, growth: standard deviations of the logarithm of the frequency, and of the growth per period.
    period: float = field(init=False)
    growth: float = field(init=False)
    each: Array = field(init=False)  # (signals, K): of the real and of the imaginary part of every harmonic

    def __post_init__(self) -> None:
        c, m = self.found.harmonics, self.model_error
        k = np.arange(1, c.shape[1] + 1)
        # What a model leaves out shapes a waveform; corners of a signal fall like 1/k^2.
        wrong = m * np.maximum(np.abs(c), np.abs(c[:, :1]) / k**2)
        object.__setattr__(self, "period", float(np.hypot(m, self.found.omega_error)))
        object.__setattr__(self, "growth", float(np.hypot(_SETTLING * m, self.found.growth_error)))
        object.__setattr__(self, "each", np.sqrt(0.5 * self.found.variance + wrong**2))

    @property
    def count(self) -> int:
        """Numbers that are compared."""
        return 2 * self.each.size + 2

    def of_shape(self, harmonics: ComplexArray) -> float:
        """Sum of squares of the differences of the harmonics."""
        return float(np.sum(np.abs((self.found.harmonics - harmonics) / self.each) ** 2))

    def of_frequency(self, omega: float) -> float:
        """Square of the difference of the frequency."""
        return float((np.log(omega / self.found.omega) / self.period) ** 2)

    def of_growth(self, growth: float) -> float:
        """Square of the difference of the growth per period."""
        return float(((self.found.growth - growth) / self.growth) ** 2)

    def laid(self, harmonics: ComplexArray) -> tuple[ComplexArray, float, float]:
        """Harmonics with the phase and size that fit best, the factor on them, and the error of its logarithm."""
        k = np.arange(1, harmonics.shape[1] + 1)
        weighted = harmonics / self.each
        power = float(np.sum(np.abs(weighted) ** 2))
        if power == 0.0:
            return harmonics, 0.0, float("inf")
        # The overlap is a trigonometric polynomial of the phase; Newton's method goes on from the best of a grid.
        terms = np.sum(np.conj(weighted) * self.found.harmonics / self.each, axis=0)
        phases = np.linspace(0.0, 2.0 * np.pi, _PHASES, endpoint=False)
        phase = float(phases[int(np.argmax(np.real(np.exp(-1j * np.outer(phases, k)) @ terms)))])
        for _ in range(20):
            turned = terms * np.exp(-1j * k * phase)
            slope, bend = float(np.sum(k * turned.imag)), -float(np.sum(k**2 * turned.real))
            if bend >= 0.0:
                break
            phase -= slope / bend
        size = float(np.sum(terms * np.exp(-1j * k * phase)).real) / power
        error = float(np.hypot(self.model_error, 1.0 / (max(size, 1e-300) * np.sqrt(power))))
        return size * harmonics * np.exp(1j * k * phase), size, error


def of_family(yard: Likelihood, family: Family) -> list[Fit]:
    """How the limit cycles of an element alone explain an oscillation, each of them; none where there are none.

    Raises
    ------
    EppError
        If they cannot be sought.
    """
    cycles = family.cycles()
    fits = [_of_cycle(yard, family, cycle) for cycle in cycles]
    return [fit for fit in fits if fit is not None]


def _of_cycle(yard: Likelihood, family: Family, cycle: LimitCycle) -> Fit | None:
    """The fit of a limit cycle over the size of its element."""
    size, exponent = 1.0, 1.0
    harmonics, factor, error = yard.laid(_harmonics(yard.found, cycle))
    if not factor > 0.0:
        return None
    if family.in_proportion:
        size = factor
    else:
        # The size of a cycle is nearly a power of that of its element: secants in the logarithms, of which the exponent
        # also carries the error over. Its period tells the size, too: of the sizes that fit, the likeliest counts.
        met = [(size, cycle, harmonics, factor, error, exponent)]
        while len(met) <= _SIZES and abs(np.log(factor)) >= _NEAR:
            step = np.log(factor) / exponent
            near = None
            with suppress(EppError):  # what cannot be sought is no size of the element
                near = _nearest(family.cycles(float(size * np.exp(step))), cycle)
            if near is None:
                break
            size, cycle, before = float(size * np.exp(step)), near, factor
            harmonics, factor, error = yard.laid(_harmonics(yard.found, cycle))
            if not factor > 0.0:
                break
            exponent = float(np.clip(np.log(before / factor) / step, 0.2, 5.0))
            met.append((size, cycle, harmonics, factor, error, exponent))
        met = [one for one in met if abs(np.log(one[3])) < 10 * _NEAR]
        if not met:
            return None
        likeliest = min(met, key=lambda one: yard.of_shape(one[2]) + yard.of_frequency(one[1].omega))
        size, cycle, harmonics, factor, error, exponent = likeliest
    misfit = yard.of_shape(harmonics) + yard.of_frequency(cycle.omega) + yard.of_growth(0.0)
    # A cycle chooses neither its frequency nor its growth, so that both densities count in full
    # (docs/howto/diagnose.md, What the verdict rests on).
    evidence = -0.5 * misfit - np.log(yard.period) - np.log(yard.growth) - 2 * _ROOT
    return Fit(evidence, misfit, yard.count - 2, cycle.period, harmonics, size, error / abs(exponent), cycle)


def of_whole(yard: Likelihood, whole: Whole) -> list[Fit]:
    """How the limit cycles of the loop as it is modelled explain an oscillation; nothing but their phase is free.

    Raises
    ------
    EppError
        If they cannot be sought.
    """
    fits = []
    for cycle in whole.cycles:
        laid, size, error = yard.laid(_harmonics(yard.found, cycle))
        if size > 0.0:
            harmonics = laid / size
            misfit = yard.of_shape(harmonics) + yard.of_frequency(cycle.omega) + yard.of_growth(0.0)
            # All other candidates choose a size: they fit by choosing, and are less likely by as much.
            evidence = -0.5 * misfit - np.log(yard.period) - np.log(yard.growth) - 3 * _ROOT
            evidence += np.log(_ANY_SIZE / error)
            fits.append(Fit(evidence, misfit, yard.count - 1, cycle.period, harmonics, cycle=cycle))
    return fits


def told_apart(yard: Likelihood, one: Fit, other: Fit) -> bool:
    """Whether a record tells two ways of explaining it apart."""
    from scipy.stats import chi2

    shape = float(np.sum(np.abs((one.harmonics - other.harmonics) / yard.each) ** 2))
    period = float((np.log(one.period / other.period) / yard.period) ** 2)
    return bool(chi2.sf(shape + period, yard.count - 1) < _APART)


def _nearest(cycles: tuple[LimitCycle, ...], cycle: LimitCycle) -> LimitCycle | None:
    return min(cycles, key=lambda c: abs(np.log(c.period / cycle.period)), default=None)


def _harmonics(found: Oscillation, cycle: LimitCycle) -> ComplexArray:
    """Those of the recorded signals, shape (signals, K)."""
    K = found.harmonics.shape[1]
    out = np.zeros((len(found.names), K), complex)
    for i, name in enumerate(found.names):
        c = cycle.harmonics[name][1 : K + 1]
        out[i, : len(c)] = c
    return out


def of_linear(yard: Likelihood, linear: Linear) -> list[Fit]:
    """How an oscillation of the linear loop, by a gain that is other than in the model, explains one."""
    gains = _GAINS if linear.turned >= 0 else np.zeros(1)
    best = min((_pole_cost(yard, linear, float(q)), float(q)) for q in gains)
    if not np.isfinite(best[0]):
        return []
    q, width = best[1], float(_GAINS[1] - _GAINS[0])
    if linear.turned >= 0:
        from scipy.optimize import minimize_scalar

        found = minimize_scalar(
            lambda x: _pole_cost(yard, linear, x), bounds=(q - width, q + width), method="bounded",
            options={"xatol": 1e-10},
        )  # fmt: skip
        q = float(found.x)
    cost = _pole_cost(yard, linear, q)
    spread = _spread(lambda x: _pole_cost(yard, linear, x), q, cost) if linear.turned >= 0 else 0.0
    pole, seen = _pole(yard.found, linear, q)
    harmonics = _one_harmonic(yard, seen)
    # The gain is chosen out of a spread of `_GAIN` to within `spread`: what fits by choosing is less likely by as much.
    prior = (q / _GAIN) ** 2 + 2 * np.log(_GAIN / spread) if spread > 0.0 else 0.0
    misfit = cost + yard.of_shape(harmonics)
    evidence = -0.5 * (misfit + prior) - np.log(yard.period) - np.log(yard.growth) - 2 * _ROOT
    free = yard.count - 2 - (linear.turned >= 0)
    return [Fit(evidence, misfit, free, 2 * np.pi / pole.imag, harmonics, float(np.exp(q)),
                float(np.hypot(spread, yard.model_error)))]  # fmt: skip


def _pole(found: Oscillation, linear: Linear, q: float) -> tuple[complex, ComplexArray]:
    """The pole of the loop, its gain multiplied by exp(q), that is nearest to an oscillation, and the signals of it."""
    motions = linear.with_gain(float(np.exp(q))) if linear.turned >= 0 else linear.closed
    pole, signals = motions.nearest(found.omega * (found.growth / (2.0 * np.pi) + 1j))
    return pole, signals[_rows(found, linear)]


def _rows(found: Oscillation, linear: Linear) -> list[int]:
    """The places of the recorded signals among those of the loop."""
    return [linear.loop.signals.names.index(name) for name in found.names]


def _pole_cost(yard: Likelihood, linear: Linear, q: float) -> float:
    pole = _pole(yard.found, linear, q)[0]
    if not np.isfinite(pole):
        return float("inf")
    return yard.of_frequency(pole.imag) + yard.of_growth(2.0 * np.pi * pole.real / pole.imag)


def _spread(cost: Callable[[float], float], q: float, least: float) -> float:
    """Standard deviation of what minimises a cost, from where the cost has grown by about one."""
    step = 1e-6
    while step < 1.0 and max(cost(q + step), cost(q - step)) < least + 1.0:
        step *= 2.0
    bend = (cost(q + step) + cost(q - step) - 2.0 * least) / step**2
    return float(np.sqrt(2.0 / bend)) if bend > 0.0 else _GAIN


def of_disturbance(yard: Likelihood, linear: Linear) -> Iterator[Fit]:
    """How a sine that comes in at some place of the linear loop explains an oscillation, for every place."""
    for place, signals in linear.responses(yard.found.omega):
        seen = signals[_rows(yard.found, linear)]
        if not np.any(seen):
            continue
        harmonics = _one_harmonic(yard, seen)
        size = float(np.linalg.norm(harmonics[:, 0]) / np.linalg.norm(seen))
        misfit = yard.of_shape(harmonics) + yard.of_growth(0.0)
        # A disturbance may have any frequency of a decade, and is
        # less likely by as much than what has to have this one.
        evidence = -0.5 * misfit - np.log(_ANY_FREQUENCY) - np.log(yard.growth) - _ROOT
        yield Fit(evidence, misfit, yard.count - 4, yard.found.period, harmonics, size, place=place)


def _one_harmonic(yard: Likelihood, seen: ComplexArray) -> ComplexArray:
    """The oscillation of signals in a given ratio that fits best; nothing but its fundamental."""
    out = np.zeros_like(yard.found.harmonics)
    w = yard.each[:, 0]
    power = float(np.sum(np.abs(seen / w) ** 2))
    if power > 0.0:
        out[:, 0] = seen * np.sum(np.conj(seen / w) * yard.found.harmonics[:, 0] / w) / power
    return out


def _in_part(sought: Sought) -> str:
    """That the cycles of a candidate were not sought to the end; empty where they were."""
    return (
        f"could not be tried to the end: the search took all of {sought.steps:.0f} steps"
        if sought.begun - sought.finished
        else ""
    )


def _of_own(yard: Likelihood, whole: Whole, alone: dict[str, list[Fit]]) -> tuple[list[Fit], str]:
    """Of the loop as it is modelled, but for cycles that the record does not tell from those of an element alone."""
    try:
        found, why = of_whole(yard, whole), "has no limit cycle that does not grow"
    except EppError as error:
        return [], f"could not be tried: {error}"
    same = [n for n, fits in alone.items() if any(not told_apart(yard, one, own) for one in fits for own in found)]
    own = [o for o in found if all(told_apart(yard, one, o) for fits in alone.values() for one in fits)]
    if same and not own:
        why = f"has the cycle of {same[0]}"
    return own, (_in_part(whole) if not found else "") or why


def all_fits(yard: Likelihood, candidates: Candidates) -> Iterator[tuple[str, list[Fit], str]]:
    """Name of every candidate, its fits, and why there are none."""
    alone: dict[str, list[Fit]] = {}
    for family in candidates.families:
        try:
            fits, why = of_family(yard, family), "alone in the loop has no limit cycle"
            if not fits and family.cycles():
                why = "has no limit cycle of the recorded size"
        except EppError as error:
            fits, why = [], f"could not be tried: {error}"
        if fits and family.alone:
            alone[family.name] = fits
        yield family.name, fits, _in_part(family) or why
    yield OWN, *_of_own(yard, candidates.whole, alone)
    if candidates.linear.refusal:
        unknown = f"cannot be tried: {candidates.linear.refusal}"
        yield LINEAR, [], unknown
        yield DISTURBANCE, [], unknown
        return
    yield LINEAR, of_linear(yard, candidates.linear), "has no oscillation at any gain"
    if candidates.linear.stable:
        yield DISTURBANCE, list(of_disturbance(yard, candidates.linear)), "does not reach the recorded signals"
    else:
        yield DISTURBANCE, [], "alone is not visible: the loop without its elements' limits is unstable"
