"""Bounds by describing functions over a sweep: which end of the range is free of cycles, and the fold at each value.

The search begins where cycles exist. They are found once, by describing functions (or, where these see none, as exact
orbits), at some values of the limiting parameter; from value to value of the other parameter they are carried over by
Newton's method. Each bound is sought from the last one with its switches (a warm start); at every few values all
families are sought from the carried cycles again (several starts). Exact orbits go on from here (``exact``).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Executor
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np

from eppanalysis.arrays import Array
from eppanalysis.errors import EppError, ModelError
from eppanalysis.methods.bounds.fold import Cycle, Fold, Programmes, balanced, extreme, missed
from eppanalysis.methods.bounds.numbers import ParametricModel, loop_of
from eppanalysis.methods.bounds.result import Finding
from eppanalysis.methods.harmonic.loop import Loop, inputs_of
from eppanalysis.methods.orbits.exact import steady_hybrid
from eppanalysis.methods.search.find import find_limit_cycles, seeds_of
from eppanalysis.methods.simulation.in_samples import InSamples
from eppanalysis.models.systems.subject import CaseLike
from eppanalysis.results import LimitCycle
from eppanalysis.workers import workers

#: Values of the limiting parameter at which cycles are sought.
N_SCAN = 5
#: Trust region of a search that comes from far, and every so many values all families are sought so again.
_FAR, _AFRESH = 0.7, 4
#: Factors on a cycle and its parameter that tell whether cycles scale with it.
_SCALED = (0.5, 2.0)


Each = Callable[[Callable[[float], Any], Iterable[float]], Iterable[Any]]


@dataclass(frozen=True, eq=False)
class BoundProblem:
    """A case with the parameter that runs and the one that is bounded; functions take it at one value of the first."""

    case: CaseLike
    limit: str  # the parameter that is bounded
    #: low, high: range in which its bound is sought [SI].
    low: float
    high: float
    over: str | None = None  # the parameter that runs

    def at(self, value: float) -> BoundProblem:
        """The same question at a value of the parameter that runs."""
        return self if self.over is None else replace(self, case=self.case.with_values({self.over: value}), over=None)

    def ends(self, sign: float) -> tuple[float, float]:
        """The end of the range that is safe, if any is, and the other one; sign 1 where cycles are at large values."""
        return (self.low, self.high) if sign > 0 else (self.high, self.low)

    def case_at(self, value: float) -> CaseLike:
        """The case with a value of the limiting parameter."""
        return self.case.with_values({self.limit: value})

    def in_words(self, values: Iterable[float]) -> str:
        """Values of the limiting parameter in the unit that people use."""
        unit, factor = self.case.readable(self.limit)
        return ", ".join(f"{factor * value:.4g} {unit}".rstrip() for value in values)

    def model(self) -> ParametricModel:
        """The loop's numbers over the limiting parameter."""
        return ParametricModel(lambda v: steady_loop(self.case_at(v)), self.low, self.high)


def value_of(case: CaseLike, name: str) -> float | None:
    """A parameter of a case [SI]; None where it is left out.

    Raises
    ------
    EppError
        If the case does not know it.
    """
    case.unit(name)
    try:
        return float(case.value(name))
    except EppError:
        return None


def spread(first: float, last: float, count: int) -> list[float]:
    """Values from one to another, both among them: by ratio where both are positive, else evenly."""
    make = np.geomspace if min(first, last) > 0 else np.linspace
    return [first, *map(float, make(first, last, count)[1:-1]), last]


def steady_loop(case: CaseLike) -> Loop:
    """The loop of a case at the operating point of its limit cycles."""
    system = case.to_system()
    return loop_of(system, case.operating_point.vector(system))


@dataclass(frozen=True, eq=False)
class ScanResult:
    """Where cycles exist: their side of the range, and the cycles from which bounds are sought."""

    finding: Finding  # BOUND where there are cycles at some values of the limiting parameter and none at others
    sign: float = 1.0  # 1 where large values have cycles (the bound is the least of them), -1 where small ones have
    cycles: tuple[Cycle, ...] = ()  # at the value farthest from the bound
    note: str = ""  # what else is known


@dataclass(frozen=True, eq=False)
class _Seen:
    """The cycles at one value of the limiting parameter: the DF's, and what the exact search found."""

    value: float  # [SI]
    #: predicted, exact: as inputs of the elements, smallest first.
    predicted: list[Cycle] = field(default_factory=list)
    exact: list[Cycle] = field(default_factory=list)
    complete: bool = False  # whether every run of the exact search came to an end that it lists

    @property
    def there(self) -> bool | None:
        """Whether a cycle exists; None where the exact search cannot tell."""
        return True if self.exact else (False if self.complete else None)

    @property
    def cycles(self) -> list[Cycle]:
        """From which the balance begins: those of describing functions, else the exact ones."""
        return self.predicted or self.exact


def look(question: BoundProblem, n_scan: int = N_SCAN, each: Each = map) -> ScanResult:
    """Scan the range of the limiting parameter for cycles.

    Whether a cycle exists at a value is what the exact search says of it: the DF sees some cycles that are not
    there, and misses others (friction with integral action, jumps). `each` is ``map``, or that of a pool of processes.
    """
    values = spread(question.low, question.high, n_scan)
    if idle(question, values):
        return ScanResult(Finding.IDLE)
    seen = list(each(partial(_seen_at, question), values))
    own = value_of(question.case, question.limit)
    # Before it is said that no value is free of cycles the case's
    # own is tried, too: a design may sit in a gap of the scan.
    if all(s.there for s in seen) and own is not None and question.low < own < question.high:
        seen = sorted([*seen, _seen_at(question, own)], key=lambda s: s.value)
    return _outlook(question, seen)


def _outlook(question: BoundProblem, seen: Sequence[_Seen]) -> ScanResult:
    """What the cycles at all values mean together."""
    there = [s.there for s in seen]
    if None in there:
        # A bound is tested where it is found, so that there the DF's word will do; for other answers nothing else
        # is tried.
        there = [bool(s.predicted) if s.there is None else s.there for s in seen]
        if there[0] == there[-1] and (there[0] or not any(there)):
            return ScanResult(Finding.UNSURE, note=f"It is undecided at {_named_values(question, seen, None)}.")
    if not any(there):
        return ScanResult(Finding.NONE)
    largest = (seen[-1] if there[-1] else next(s for s, t in zip(seen, there, strict=True) if t)).cycles[-1]
    if scales(question, largest):
        return ScanResult(Finding.SCALES)
    if there[0] and there[-1]:
        if all(there):
            return ScanResult(Finding.ALWAYS)
        return ScanResult(Finding.BETWEEN, note=f"There is none at {_named_values(question, seen, False)}.")
    with_cycles = [i for i, t in enumerate(there) if t]
    first, last, own = with_cycles[0], with_cycles[-1], value_of(question.case, question.limit)
    if there[-1]:
        return ScanResult(Finding.BOUND, 1.0, tuple(seen[last].cycles))
    # Of two bounds, one on either side of the cycles, the one that is met first from the case's own value.
    if there[0] or (own is not None and own > seen[last].value):
        below = "" if there[0] else f"No cycle is left below {question.in_words([seen[first - 1].value])} either."
        return ScanResult(Finding.BOUND, -1.0, tuple(seen[first].cycles), below)
    above = f"No cycle is left above {question.in_words([seen[last + 1].value])} either."
    return ScanResult(Finding.BOUND, 1.0, tuple(seen[last].cycles), above)


def _named_values(question: BoundProblem, seen: Sequence[_Seen], there: bool | None) -> str:
    """The values of one answer, in the unit that people use."""
    return question.in_words(s.value for s in seen if s.there is there)


def idle(question: BoundProblem, values: Iterable[float]) -> bool:
    """Whether the loop and its operating point are the same at all of these values of the limiting parameter."""
    first: list[Array] | None = None
    for value in values:
        case = question.case_at(value)
        system, at = case.to_system(), case.operating_point
        as_run = InSamples.at(system, at).system if system.time_step else system
        here = [*steady_hybrid(as_run, at).model, at.vector(system)]
        if first is None:
            first = here
        elif not all(np.array_equal(a, b) for a, b in zip(first, here, strict=True)):
            return False
    return True


def _seen_at(question: BoundProblem, value: float) -> _Seen:
    """The cycles at a value; nothing is known where the loop cannot be searched there."""
    case = question.case_at(value)
    loop = steady_loop(case)
    predicted = seeds_of(case)
    try:
        search = find_limit_cycles(case, predicted=predicted)
    except ModelError:
        return _Seen(value, [_of_order_one(loop, value, c) for c in predicted])
    first, exact = ([_of_order_one(loop, value, c) for c in found] for found in (predicted, search))
    return _Seen(value, first, exact, not search.left_open)


def _of_order_one(loop: Loop, value: float, cycle: LimitCycle) -> Cycle:
    Z = inputs_of(loop, cycle)
    return Cycle(value, Z[:, :2], cycle.omega)


def scales(question: BoundProblem, cycle: Cycle) -> bool:
    """Whether the cycle, made larger in proportion to the limiting parameter, is again one.

    True of loops in which the parameter is the only length: play in an otherwise linear loop, say.
    """
    model = question.model()
    true = balanced(model, cycle.value, cycle)
    if true is None:
        return False
    # The enlarged motion is put into the balance and not searched for: what scales leaves no residual at all.
    for factor in _SCALED:
        larger = Cycle(true.value * factor, true.Z * factor, true.omega)
        try:
            if not missed(model.loop(larger.value), larger) < 1e-8:
                return False
        except EppError:
            return False
    return True


@dataclass(frozen=True, eq=False)
class BalancedBound:
    """The bound by describing functions at one value of the parameter that runs."""

    finding: Finding
    sign: float  # 1: free below the bound; -1: free above it
    fold: Fold | None = None
    far: tuple[Cycle, ...] = ()  # cycles where the range holds them, farthest from the bound
    message: str = ""


@dataclass
class BalancedSweep:
    """Bounds at one value after another, each begun from the last; lives for one sweep."""

    question: BoundProblem
    pool: Executor | None = None  # of processes that share the work, while there is one
    programmes: Programmes = field(default_factory=Programmes)
    outlook: ScanResult | None = None  # of the first value
    far: tuple[Cycle, ...] = ()
    families: tuple[Fold, ...] = ()  # the last folds of all families that were met
    done: int = 0

    def turn_to(self, question: BoundProblem) -> None:
        """Begin anew with another question, and keep what is written of programmes: loops alike have the same."""
        vars(self).update(vars(BalancedSweep(question, self.pool, self.programmes)))

    @contextmanager
    def shared_by(self, n: int) -> Iterator[Executor | None]:
        """The pool of processes that is there already, else so many new ones; None for one."""
        if self.pool is not None:  # to start processes takes as long as several bounds
            yield self.pool
            return
        with workers(n) as self.pool:
            try:
                yield self.pool
            finally:
                self.pool = None

    def bound(self, value: float) -> tuple[BoundProblem, BalancedBound]:
        """The question and the bound at a value of the parameter that runs."""
        question = self.question.at(value)
        return question, self.bound_of(question)

    def bound_of(self, question: BoundProblem) -> BalancedBound:
        """The bound of a question like the sweep's own, at one value of the parameter that runs."""
        model = question.model()
        outlook = self._outlook(question, model)
        if outlook.finding is not Finding.BOUND or not self.far:
            return BalancedBound(outlook.finding, outlook.sign, message=outlook.note)
        fold = self._farthest(model, outlook.sign)
        finding = Finding.FAILED if fold is None else Finding.BEYOND if fold.at_end else Finding.BOUND
        return BalancedBound(finding, outlook.sign, fold, self.far, outlook.note)

    def _outlook(self, question: BoundProblem, model: ParametricModel) -> ScanResult:
        """Where cycles exist, with those to begin from: carried over from the last value, or sought anew."""
        # Newton's method from the last value's cycles is cheap; the exact
        # search over the range is asked again only where all are lost.
        carried = tuple(c for c in (balanced(model, c.value, c) for c in self.far) if c is not None)
        if not carried or self.outlook is None:
            # A pool that is at work already is asked for nothing more.
            self.outlook = look(question, each=map if self.pool is None or self.outlook is not None else self.pool.map)
        self.far = carried or self.outlook.cycles
        return self.outlook

    def _farthest(self, model: ParametricModel, sign: float) -> Fold | None:
        """The farthest of the last folds of all families; where one is lost, and now and then, also from far away."""
        found = [extreme(model, self.programmes, f, sign) for f in self.families]
        # A family that appears on the way has no last fold to be followed from, and is only found from afar.
        if self.done % _AFRESH == 0 or not found or None in found:
            found += [extreme(model, self.programmes, c, sign, _FAR) for c in self.far]
        self.done += 1
        self.families = tuple({f"{f.cycle.value:.6e}": f for f in found if f is not None}.values())
        return min(self.families, key=lambda f: sign * f.cycle.value, default=None)
