"""Bounds under tolerances: for the whole box of them (worst case), and with a probability (Monte Carlo on the engine).

Worst case: the exact bound is minimised over the box. Its exact elasticities point to a corner; there they are taken
anew, until they point nowhere else. Corners in the most influential parameters are then checked one by one.

Probability: parameters are drawn, and for each draw the bound is bracketed by event-exact runs of all draws at once,
started on and around the orbit that exists at the nominal bound, by halving an interval round the value which the
elasticities predict. The bound that holds with probability P is an order statistic of the draws, and its confidence
interval is the exact (binomial) one, free of any distribution: Conover, Practical Nonparametric Statistics, 1999,
section 3.2.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from eppanalysis.arguments import check_counts
from eppanalysis.arrays import Array, BoolArray
from eppanalysis.errors import CaseError, EppError
from eppanalysis.methods.bounds.elasticity import exact_slopes, parameters_of
from eppanalysis.methods.bounds.exact import ExactBound, correct
from eppanalysis.methods.bounds.fold import Cycle, Programmes, extreme
from eppanalysis.methods.bounds.harmonic import HarmonicSweep, Question
from eppanalysis.methods.bounds.result import Finding
from eppanalysis.methods.bounds.tolerances.distribution import Distribution
from eppanalysis.methods.bounds.tolerances.result import Quantile, ToleranceBound
from eppanalysis.methods.continuation.own_states import in_own_states
from eppanalysis.methods.continuation.steps import Point
from eppanalysis.methods.orbits.exact import steady_hybrid
from eppanalysis.methods.simulation.batch import HybridStack, simulate_batch
from eppanalysis.models.systems.hybrid import HybridSystem
from eppanalysis.models.systems.lure import LureSystem
from eppanalysis.models.systems.subject import CaseLike, facts_of, require_case, require_continuous
from eppanalysis.progress import Progress
from eppanalysis.results import LimitCycle, Status
from eppanalysis.results.deferred import Deferred
from eppanalysis.results.provenance import Provenance

_MOST_CORNERS, _CHECKED = 8, 3
#: Sizes of the orbit at the nominal bound from which the runs of a draw begin, and points on it.
_SIZES, _POINTS = (1.0, 1.3, 1.8, 2.5), 2
#: First half-width of the bracket of a draw's bound, relative to what the elasticities predict; halvings of it.
_BRACKET, _HALVINGS = 0.08, 5
#: Rounds of runs: how often the end of a bracket is tried, and with its halvings.
_ENDS = 2
_ROUNDS = _ENDS + _HALVINGS
_PERIODS = 40.0
_CONFIDENCE = 0.95


def half_widths_of(case: CaseLike, given: Mapping[str, object] | None) -> dict[str, float]:
    """Half-widths of the tolerances [SI]: those given ("10 %" is of the value), or those that the case carries.

    Raises
    ------
    EppError
        If a tolerance is negative, or there are none.
    """
    if given is None:
        carried = getattr(case, "parameters", {})
        found = {name: float(p.tolerance) for name, p in carried.items() if p.tolerance}
    else:
        found = {}
        for name, width in given.items():
            text = str(width).strip()
            share = text.endswith("%")
            try:
                value = case.value(name)
            except EppError as error:
                raise EppError(f"tolerance of {name}: {error}") from None
            try:
                size = abs(value) * float(text[:-1]) / 100.0 if share else case.si(name, width)
            except ValueError:
                raise EppError(f"tolerance of {name} is {width!r}; expected a quantity or a percentage.") from None
            if not (math.isfinite(size) and size >= 0):
                raise EppError(f"tolerance of {name} is {width!r}; expected one that is not negative.")
            found[name] = size
    if not found:
        raise EppError(f"{case.name}: no parameter has a tolerance; expected at least one.")
    return found


def check_tolerances(question: Question, tolerances: Mapping[str, object] | None) -> dict[str, float]:
    """Half-widths of the tolerances [SI], if a bound under them can be asked for.

    Parameters
    ----------
    tolerances : mapping of str to quantity or percentage, optional
        As :func:`half_widths_of` takes them.

    Raises
    ------
    EppError
        If one is not valid, is of a parameter by which a bound has no elasticity, or leads to values that the case
        cannot take.
    """
    case, widths = question.case, half_widths_of(question.case, tolerances)
    known = (*parameters_of(question), question.limit)
    for name, width in widths.items():
        if name not in known:
            why = f"the case holds no number for it but {case.value(name):g}"
            raise EppError(f"tolerance of {name}: {why}; expected a parameter that is given and not zero.")
        if name != question.limit:
            check_ends(case, name, width)
    return widths


def check_ends(case: CaseLike, name: str, width: float) -> None:
    """Refuse a tolerance at one of whose ends there is no such case.

    Raises
    ------
    EppError
        If the parameter less the half-width, or with it, is nothing that the case can take.
    """
    for end in (case.value(name) - width, case.value(name) + width):
        try:
            case.with_values({name: end})
        except CaseError as error:
            said = f"at one end of it {name} is {case.text(name, end)}; expected {error.expected}"
            raise EppError(f"tolerance of {name}: {said}.") from None


def tolerance_bound(
    case: CaseLike | LureSystem,
    limit: str,
    tolerances: Mapping[str, object] | None = None,
    *,
    within: tuple[object, object],
    probabilities: Sequence[float] = (0.95, 0.99),
    samples: int = 400,
    distribution: str = "uniform",
    seed: int = 20050901,
    threads: int = 1,
    sweep: HarmonicSweep | None = None,
    progress: Progress | None = None,
) -> ToleranceBound:
    """The bound on a parameter for all values of the others within their tolerances, and with given probabilities.

    Parameters
    ----------
    case : Case or LureSystem
    limit : str
        The parameter that is bounded; its own tolerance is taken off the bound.
    tolerances : mapping of str to quantity or percentage, optional
        By default those that the case's parameters carry.
    within : (quantity, quantity)
        Range in which bounds are sought.
    probabilities : sequence of float
        Shares of machines that are to be free of cycles, each between 0 and 1.
    samples : int
        Draws; 0 for the worst case alone.
    distribution : {"uniform", "normal"}
        Even within the tolerance, or normal with a third of it as standard deviation, cut at its ends.
    seed, threads : int
        The result does not depend on the number of threads.
    sweep : HarmonicSweep, optional
        Over one of the parameters of a neighbouring case, at whose last value the search goes on; a new search by
        default.
    progress : callable, optional
        Told which rounds of runs are done, of how many, and what is being done.

    Returns
    -------
    ToleranceBound

    Raises
    ------
    EppError
        If there is no bound at the parameters' own values, or a setting is not valid.

    Examples
    --------
    >>> import eppanalysis as epp
    >>> case = epp.case("relay_deadzone")
    >>> tolerances = {"relay_dead_zone.level": "10 %"}
    >>> found = epp.tolerance_bound(
    ...     case, "relay_dead_zone.threshold", tolerances, within=(1.0, 3.0), samples=0
    ... )
    >>> str(found).partition(" wherever")[0]
    'Free of limit cycles above a relay dead zone threshold of 1.829'
    """
    case = require_case(case, "tolerance_bound")
    require_continuous(case.to_system(), "tolerance_bound")
    spreads = Distribution.called(distribution, "tolerance_bound")
    check_counts("tolerance_bound", {"samples": (samples, 0), "seed": (seed, 0), "threads": (threads, 1)})
    for share in probabilities:
        if not 0.0 < share < 1.0:
            raise EppError(f"tolerance_bound: probabilities holds {share}; expected shares between 0 and 1.")
    low, high = (case.si(limit, v) for v in within)
    if not low < high:
        raise EppError(f"tolerance_bound: {limit} is sought within {within[0]} to {within[1]}; expected low < high.")
    question = Question(in_own_states(case), limit, low, high)
    widths = check_tolerances(question, tolerances)
    # How far the bounded parameter is itself off does not move the bound: that is taken off in the end.
    own = widths.pop(limit, 0.0)
    tell = progress or (lambda done, of, doing: None)
    tell(0, _ROUNDS, "worst corner")
    box = _Box.of(question, widths, sweep)
    worst, message, n_corners = box.worst()
    draws, offset = np.zeros(0), float("nan")
    if samples:
        spread = _spread(len(widths) + 1, samples, spreads, seed)
        draws, offset = box.draws(spread[:, :-1], threads, tell)
        draws = draws - spread[:, -1] * own
    sign = box.sign
    settings = {"limit": limit, "samples": samples, "distribution": distribution, "seed": seed, "half_widths": widths}
    return ToleranceBound(
        limit=limit,
        unit=case.unit(limit)[0],
        readable=case.readable(limit),
        sign=sign,
        half_widths={**widths, **({limit: own} if own else {})},
        nominal=box.centre.value,
        worst_case=worst.value - sign * own,
        worst_values=box.values(worst.place),
        n_corners=n_corners,
        quantiles=tuple(quantile(sign * draws, p, sign) for p in probabilities) if samples else (),
        draws=draws,
        engine_offset=offset,
        message=message,
        provenance=Provenance("bound under tolerances", settings, case=facts_of(case)),
    )


def quantile(draws: Array, probability: float, sign: float = 1.0) -> Quantile:
    """The value below which at most the share 1 - probability of all bounds lie, with its exact confidence interval.

    Parameters
    ----------
    draws : array, shape (n,)
        Bounds, times `sign`, so that designs are free below.
    sign : {1, -1}

    Examples
    --------
    >>> import numpy as np
    >>> quantile(np.arange(1.0, 1001.0), 0.95).value
    51.0
    """
    from scipy.stats import binom

    ordered, n, share = np.sort(draws), draws.size, 1.0 - probability
    half = 0.5 * (1.0 - _CONFIDENCE)
    # Of n draws the number below the true quantile is binomial: ranks that bracket it with the confidence wanted.
    low, high = int(binom.ppf(half, n, share)) - 1, int(binom.ppf(1.0 - half, n, share))
    place = math.floor(share * n)
    values = [float(ordered[i]) if 0 <= i < n else float("nan") for i in (place, low, high)]
    value, first, last = (sign * v for v in values)
    return Quantile(probability, value, *((first, last) if sign > 0 else (last, first)))


def _spread(columns: int, n: int, distribution: Distribution, seed: int) -> Array:
    """Draws between -1 and 1, shape (n, columns): independent, so that the binomial interval is exact."""
    return distribution.within(np.random.default_rng(seed).uniform(size=(n, columns)))


@dataclass(frozen=True, eq=False)
class _Place:
    """An exact bound at a place of the box (-1 .. 1 in every parameter)."""

    place: tuple[float, ...]
    value: float
    slopes: Mapping[str, float]
    harmonic: Cycle


@dataclass(eq=False)
class _Box:
    """The box of tolerances round a case, and the bounds in it; lives for one call."""

    question: Question
    widths: dict[str, float]
    sign: float
    order: int
    programmes: Programmes
    centre: _Place
    orbit: LimitCycle

    @classmethod
    def of(cls, question: Question, widths: dict[str, float], sweep: HarmonicSweep | None) -> _Box:
        sweep = sweep or HarmonicSweep(question)
        bound = sweep.bound_of(question)
        if bound.fold is None or bound.finding is not Finding.BOUND:
            raise EppError(f"{question.case.name}: {bound.finding.sentence}")
        exact = correct(question, bound.fold.cycle, bound.sign)
        if exact.cycle is None or exact.point is None:
            raise EppError(f"{question.case.name}: the bound on {question.limit} was not corrected: {exact.message}.")
        slopes = _slopes(question, exact.point, widths)
        centre = _Place((0.0,) * len(widths), exact.value, slopes, bound.fold.cycle)
        return cls(question, widths, bound.sign, bound.order, sweep.programmes, centre, exact.cycle)

    def values(self, place: Sequence[float]) -> dict[str, float]:
        """Parameters at a place [SI]."""
        case = self.question.case
        return {name: case.value(name) + s * width for (name, width), s in zip(self.widths.items(), place, strict=True)}

    def at(self, place: Sequence[float]) -> Question:
        """The question at a place."""
        return replace(self.question, case=self.question.case.with_values(self.values(place)))

    def harmonic(self, place: tuple[float, ...], near: _Place) -> Cycle | None:
        """The harmonic bound at a place, from that of another one, in as many steps as it takes."""
        for n_steps in (1, 2, 4):
            here: Cycle | None = near.harmonic
            for share in np.linspace(0.0, 1.0, n_steps + 1)[1:]:
                between = [a + share * (b - a) for a, b in zip(near.place, place, strict=True)]
                assert here is not None
                found = extreme(self.at(between).numbers(), self.programmes, here, self.sign, 0.1)
                here = None if found is None else found.cycle
                if here is None:
                    break
            if here is not None:
                return here
        return None

    def exact(self, place: tuple[float, ...], near: _Place) -> _Place | None:
        """The exact bound at a place, near the one that the elasticities predict, else near the harmonic one."""
        question = self.at(place)
        moves = zip(self.widths.items(), near.place, place, strict=True)
        terms = (near.slopes.get(n, 0.0) * w * (b - a) for (n, w), a, b in moves)
        change = sum(term for term in terms if math.isfinite(term))
        # Extrapolated in the logarithm: no bound passes zero.
        cycle: Cycle | None = replace(near.harmonic, value=near.value * math.exp(change / near.value))
        assert cycle is not None
        found: ExactBound | None = correct(question, cycle, self.sign)
        if found is None or found.cycle is None:
            cycle = self.harmonic(place, near)
            found = None if cycle is None else correct(question, cycle, self.sign)
        if found is None or found.cycle is None or cycle is None:
            return None
        return _Place(place, found.value, _slopes(question, found.point, self.widths), cycle)

    def worst(self) -> tuple[_Place, str, int]:
        """The corner with the worst bound, what is missing, and the number of corners checked besides."""
        # Where the bound is monotone in each parameter it is worst at the corner to which its slopes point; they are
        # asked for anew at every corner, until it points to itself.
        here, seen = self.centre, set()
        for _ in range(_MOST_CORNERS):
            corner = self._downhill(here)
            if corner in seen:
                break
            seen.add(corner)
            found = self.exact(corner, here)
            if found is None:
                return here, "the worst corner could not be reached; the bound of the last place is given", 0
            here = found
        message = "" if self._downhill(here) == here.place else "the bound is not monotone over the box"
        better, n_corners = self._check(here)
        if better is not None:
            return better, message, n_corners
        return here, message, n_corners

    def _downhill(self, here: _Place) -> tuple[float, ...]:
        """The corner to which the elasticities point; a parameter without influence stays where it is."""
        out = []
        for name, place in zip(self.widths, here.place, strict=True):
            slope = here.slopes.get(name, 0.0) * self.sign
            out.append(-math.copysign(1.0, slope) if math.isfinite(slope) and slope else place)
        return tuple(out)

    def _check(self, worst: _Place) -> tuple[_Place | None, int]:
        """The other corners in the most influential parameters: a worse one, and how many could be checked."""
        # Slopes know their own corner: where the bound is not monotone another one may be worse.
        influence = [abs(self.centre.slopes.get(n, 0.0)) * w for n, w in self.widths.items()]
        most = sorted(range(len(influence)), key=lambda i: -influence[i])[:_CHECKED]
        count, better = 0, None
        for signs in itertools.product((-1.0, 1.0), repeat=len(most)):
            place = list(worst.place)
            for i, s in zip(most, signs, strict=True):
                place[i] = s
            if tuple(place) == worst.place:
                continue
            found = self.exact(tuple(place), self.centre)
            count += found is not None
            if found is not None and self.sign * (found.value - worst.value) < 0:
                better = worst = found
        return better, count

    def draws(self, spread: Array, threads: int, tell: Progress) -> tuple[Array, float]:
        """Bounds of draws (n, parameters) by runs, and how far the runs are off at the centre."""
        names = list(self.widths)
        reach = np.array([self.centre.slopes.get(n, 0.0) * self.widths[n] for n in names])
        share = reach / self.centre.value
        # First order in the logarithm: exact for a bound that is a product of powers.
        guesses = self.centre.value * np.exp(np.clip(spread @ np.nan_to_num(share), -2.0, 2.0))
        cases = [self.question.case.with_values(self.values(tuple(row))) for row in spread.tolist()]
        found = self._bracketed([*cases, self.question.case], np.append(guesses, self.centre.value), threads, tell)
        # Runs see stable cycles alone, and only those that they reach: by how much that shifts the nominal bound is
        # taken off every draw (docs/howto/bounds.md).
        offset = float(found[-1] / self.centre.value - 1.0)
        return found[:-1] / (1.0 + offset), offset

    def _bracketed(self, cases: Sequence[CaseLike], guesses: Array, threads: int, tell: Progress) -> Array:
        """Bounds by halving; a guess whose bracket does not hold the bound is widened, twice at most."""
        low, high = guesses * (1.0 - _BRACKET), guesses * (1.0 + _BRACKET)
        safe_end = low if self.sign > 0 else high
        # `safe_end` is `low` or `high` itself. With a run that oscillates
        # there, halving would close in on it and not on the bound.
        wrong = np.arange(len(cases))
        for k in range(_ENDS):
            tell(k, _ROUNDS, f"runs of all draws, {k + 1} of {_ROUNDS}")
            wrong = wrong[self._oscillating([cases[i] for i in wrong.tolist()], safe_end[wrong], threads)]
            safe_end[wrong] *= 1.0 - self.sign * 2 * _BRACKET
        for k in range(_ENDS, _ROUNDS):
            tell(k, _ROUNDS, f"runs of all draws, {k + 1} of {_ROUNDS}")
            middle = np.sqrt(low * high)
            moving = self._oscillating(cases, middle, threads)
            up = moving if self.sign > 0 else ~moving
            high, low = np.where(up, middle, high), np.where(up, low, middle)
        return low if self.sign > 0 else high

    def _oscillating(self, cases: Sequence[CaseLike], values: Array, threads: int) -> BoolArray:
        """Which cases have a run that does not come to rest, at their values of the bounded parameter."""
        starts: list[list[HybridSystem]] = []
        for case, value in zip(cases, values.tolist(), strict=True):
            changed = case.with_values({self.question.limit: value})
            starts.append(self._starts(steady_hybrid(changed.to_system(), changed.operating_point)))
        names, moving = self.question.case.to_system().signals.names, np.zeros(len(cases), bool)
        for column in zip(*starts, strict=True):
            # One run that oscillates tells: the others of its case need not be made.
            still = np.flatnonzero(~moving)
            if still.size:
                stack = HybridStack.of([column[i] for i in still], names)
                result = simulate_batch(stack, _PERIODS * self.orbit.period, threads=threads)
                moving[still] = [s is Status.LIMIT_CYCLE for s in result.status]
        return moving

    def _starts(self, base: HybridSystem) -> list[HybridSystem]:
        """The system on and around the orbit at the nominal bound."""
        n = base.n_plant
        # At its bound a stable cycle meets an unstable one; beyond
        # it the stable one is larger, and is reached from outside.
        corners = self.orbit.event_states
        centre = corners.mean(axis=0)
        chosen = corners[:: max(1, len(corners) // _POINTS)][:_POINTS]
        out = []
        for size, corner in itertools.product(_SIZES, chosen):
            x0 = base.x0.copy()
            x0[:n] = np.where(base.compared[:n], centre + size * (corner - centre), x0[:n])
            out.append(replace(base, x0=x0))
        return out


def _slopes(question: Question, point: Point | None, names: Iterable[str]) -> Mapping[str, float]:
    """Derivative of an exact bound by parameters [SI]; most corners are asked for their bound alone."""
    sizes = {name: abs(question.case.value(name)) for name in names}
    return {} if point is None else Deferred(partial(exact_slopes, question, point, sizes))
