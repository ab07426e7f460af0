"""Bounds of loops without a fold to solve for: where the answer of the search for limit cycles changes, by halving.

The cycles of a sampled loop are locked to its samples or not, so no branch of them runs through a fold; and
an element that reads a state of the loop has no balance of harmonics, with which folds are sought. The search runs
at some values over the range, and between two that it answers differently again and again, until both lie within the
margin; from the cycles that are known on one side it starts on the other. Beside it the case's own run is made, or
that alone. What only other starts lead to, and what comes and goes between the values tried, is not covered,
and the result says so.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from eppanalysis.errors import EppError, ModelError
from eppanalysis.methods.bounds.balanced import BoundProblem, idle
from eppanalysis.methods.bounds.result import BoundCell, Finding, Turn
from eppanalysis.methods.bounds.sizes.allowed import Allowed
from eppanalysis.methods.bounds.sizes.bound import tried_values, without_bound
from eppanalysis.methods.bounds.verify import PERIODS
from eppanalysis.methods.harmonic.loop import Loop
from eppanalysis.methods.search.find import search_from
from eppanalysis.methods.search.sampled import middle_of
from eppanalysis.methods.search.simulate import simulate
from eppanalysis.models.systems.lure import LureSystem
from eppanalysis.models.systems.sampled.clocked import has_samples
from eppanalysis.models.systems.subject import CaseLike
from eppanalysis.progress import Progress
from eppanalysis.readable import DIGITS, listed
from eppanalysis.results import LimitCycle, Status, Trajectory

#: Share of the range below which a bound is as good as zero.
_SMALL = 0.01
#: In which sizes of a cycle a run from it begins.
_SIZES = (1.0, 1.3, 1.8)


@dataclass(frozen=True, eq=False)
class Answer:
    """What the search and the case's own run say at a value of the limiting parameter."""

    value: float  # [SI]
    cycles: tuple[LimitCycle, ...]  # those found that are not allowed, the search's before that of the run
    #: Why it is not known that nothing but rest (or what is allowed) was found, in words; empty where it is.
    open_ends: tuple[str, ...]
    n_runs: int  # of the search, and the case's own

    @property
    def free(self) -> bool:
        """Whether no cycle was found and nothing was left open."""
        return not (self.cycles or self.open_ends)


def why_by_search(system: LureSystem) -> str:
    """Why the bounds of a loop are those of the search, in a sentence; empty where they are folds."""
    if has_samples(system):
        return "The loop is sampled"
    try:
        Loop.of(system, system.v0)
    except ModelError:
        return "The loop has no balance of harmonics"
    return ""


@dataclass(frozen=True)
class SearchedProblem:
    """What is tried at each value."""

    allowed: Allowed | None = None  # the largest stable cycle that is allowed
    margin: float = 0.01  # how near the two sides of a bound come, relative to it
    own_run: bool = False  # whether the case's own run alone is made, from its own start and with its own input
    why: str = ""  # why the search is used at all
    progress: Progress | None = None
    #: Whether one cycle that is not allowed is answer enough; else all are looked for, as starts at other values.
    first: bool = False

    def is_bad(self, cycle: LimitCycle) -> bool:
        """Whether a cycle is not allowed."""
        return self.allowed is None or self.allowed.exceeded_by(cycle)

    def answer(self, question: BoundProblem, value: float, known: Sequence[LimitCycle] = ()) -> Answer:
        """Make the case's own run, and the search, which starts from the cycles `known` at another value, too."""
        case = question.case_at(value)
        if self.progress is not None:
            self.progress(0, None, f"{case.name}: {question.limit} = {case.text(question.limit, value, DIGITS)}")
        run = simulate(case, decide=self.own_run)
        own = [] if run.limit_cycle is None else [run.limit_cycle]
        told = self.own_run or (self.first and any(map(self.is_bad, own)))
        search = None if told else search_from(case, known, self.is_bad if self.first else None, self.progress)
        bad = tuple(filter(self.is_bad, [*(search or ()), *own]))
        grows = run.status is Status.DIVERGED or (search is not None and search.diverges)
        left = ["runs grow without bound"] * grows
        if search is not None:
            left += search.left_open
        elif not own and run.status not in (Status.SETTLED, Status.DIVERGED):
            left.append("the case's own run neither settles nor repeats itself")
        return Answer(value, bad, tuple(left), 1 + (0 if search is None else search.n_runs))

    def not_covered(self, cells: Sequence[BoundCell]) -> str:
        """What the bounds do not cover, in a sentence."""
        asked = [c.n_searched for c in cells if c.n_searched] or [0]
        fewest, most = min(asked), max(asked)
        numbers = str(most) if fewest == most else f"{fewest} to {most}"
        how = "the answer of the search for limit cycles changes"
        others = "cycles that only other starts lead to"
        if self.own_run:
            how, others = "the case's own run ceases to come to rest", "other starts and inputs"
        return (
            f"{self.why}: bounds are where {how}, searched at {numbers} values of the range and to "
            f"{100.0 * self.margin:g} %; {others}, and cycles between these values alone, are not covered."
        )


def oscillates(case: CaseLike, cycles: Sequence[LimitCycle], asking: SearchedProblem) -> bool:
    """Whether a run from one of some cycles comes neither to rest nor to a cycle that is allowed; inputs are held."""
    return _moving(case, cycles, asking) is not None


def _moving(case: CaseLike, cycles: Sequence[LimitCycle], asking: SearchedProblem) -> Trajectory | None:
    """The first run from one of some cycles that comes neither to rest nor to a cycle that is allowed."""
    system = case.to_system()
    held = replace(system, v0=case.operating_point.vector(system))
    for cycle in cycles:
        state, middle = cycle.require_state(len(system.A)).state, middle_of(cycle)
        for size in _SIZES:
            begun = replace(held, x0=middle + size * (state - middle), memory=cycle.memory)
            run = simulate(begun, t_end=PERIODS * cycle.period)
            on = run.limit_cycle
            if run.status is not Status.SETTLED and (on is None or asking.is_bad(on)):
                return run
    return None


def bound_by_runs(
    question: BoundProblem, cycles: Sequence[LimitCycle], sign: float, asking: SearchedProblem, close: float
) -> tuple[float, LimitCycle | None]:
    """The bound as runs from some cycles have it, by halving the range until both sides are so close, relative to it.

    Runs begin on the cycle that the last one ended on, too.

    Returns
    -------
    (float, LimitCycle or None)
        The end of the range that is safe where such a run oscillates down to there, else the last value at which none
        does; and the cycle that is nearest to it.
    """
    safe, beyond = question.ends(sign)
    least, last = _SMALL * (question.high - question.low), None
    while abs(beyond - safe) > close * max(abs(safe), abs(beyond), least):
        middle = 0.5 * (safe + beyond)
        run = _moving(question.case_at(middle), cycles if last is None else [last, *cycles], asking)
        safe, beyond = (middle, beyond) if run is None else (safe, middle)
        if run is not None and run.limit_cycle is not None and run.limit_cycle.state.size:
            last = run.limit_cycle
    return safe, last


def searched_cell(question: BoundProblem, value: float, asking: SearchedProblem) -> BoundCell:
    """The bound at one value of the parameter that runs; what fails is said in the cell."""
    here = question.at(value)
    try:
        return _cell(here, value, asking)
    except EppError as error:
        message = f"The search failed ({str(error).rstrip('.')})."
        return BoundCell(value=value, finding=Finding.FAILED, message=message)


def _cell(question: BoundProblem, value: float, asking: SearchedProblem) -> BoundCell:
    values = tried_values(question)
    if idle(question, values):
        return BoundCell(value=value, finding=Finding.IDLE, message=Finding.IDLE.sentence)
    asked: list[Answer] = []
    at_once = replace(asking, first=True)
    for v in values:
        asked.append(at_once.answer(question, v, asked[-1].cycles if asked else ()))
    free = [a.free for a in asked]
    if all(free) or not (free[0] or free[-1]):
        return _without(question, value, asked, asking)
    sign = 1.0 if free[0] else -1.0
    ordered = asked if sign > 0 else asked[::-1]
    first = next(k for k, a in enumerate(ordered) if not a.free)
    # From all cycles next to the safe side those are followed that reach farthest.
    all_there = asking.answer(question, ordered[first].value, ordered[first].cycles)
    beyond, safer = [all_there, *ordered[first + 1 :]], ordered[:first][::-1]
    # The last free value may be free only because no start led to the cycle: it is searched again from the cycles known
    # beyond, and gives way while that finds one.
    while safer and (known := _nearest(beyond).cycles) and not asking.own_run:
        again = asking.answer(question, safer[0].value, known)
        if again.free:
            break
        beyond, safer = [again, *beyond], safer[1:]
    if not safer and not beyond[0].cycles:  # other starts leave the end of the range open, where no cycle was found
        return _without(question, value, beyond, asking)
    if not safer:
        return BoundCell(value=value, finding=Finding.BEYOND, message=Finding.BEYOND.sentence, n_searched=len(asked))
    sides, more = _narrowed(question, (safer[0], beyond[0], _nearest(beyond)), asking)
    return _joined(question, value, sign, sides, asking.allowed, len(asked) + more)


def _without(question: BoundProblem, value: float, asked: Sequence[Answer], asking: SearchedProblem) -> BoundCell:
    """A cell without a bound, and why."""
    what = "limit cycle" if asking.allowed is None else asking.allowed.exceeded
    who = "The case's own run" if asking.own_run else "The search"
    found = without_bound(question, [(a.value, a.cycles, not a.open_ends) for a in asked], what, who)
    left = (f"at {question.in_words([a.value])}, {text}" for a in asked if not a.cycles for text in a.open_ends)
    opened = "; ".join(left)
    note = found.note + (f" Left open: {opened}." if opened else "")
    return BoundCell(value=value, finding=found.finding, message=note, n_searched=len(asked))


def _nearest(beyond: Sequence[Answer]) -> Answer:
    """The first answer that has cycles; where none has, the first."""
    return next((a for a in beyond if a.cycles), beyond[0])


def _narrowed(
    question: BoundProblem, sides: tuple[Answer, Answer, Answer], asking: SearchedProblem
) -> tuple[tuple[Answer, Answer, Answer], int]:
    """Two values within the margin, the first free and the next not; the nearest with a cycle; how many were tried."""
    safe, beyond, other = sides
    count, least = 0, _SMALL * (question.high - question.low)  # a bound at zero has no relative margin
    while abs(beyond.value - safe.value) > asking.margin * max(abs(safe.value), abs(beyond.value), least):
        middle = asking.answer(question, 0.5 * (safe.value + beyond.value), other.cycles)
        count += 1
        safe, beyond = (middle, beyond) if middle.free else (safe, middle)
        other = middle if middle.cycles or (beyond is middle and not other.cycles) else other
    return (safe, beyond, other), count


def _joined(
    question: BoundProblem,
    value: float,
    sign: float,
    sides: tuple[Answer, Answer, Answer],
    allowed: Allowed | None,
    n_searched: int,
) -> BoundCell:
    safe, beyond, other = sides
    cycle = max(other.cycles, key=allowed.of_cycle, default=None) if allowed else next(iter(other.cycles), None)
    message = ""
    if not beyond.cycles:
        place, next_one = (question.case.text(question.limit, a.value, DIGITS) for a in (beyond, other))
        further = "no cycle was found beyond" if cycle is None else f"the next cycle found is at {next_one}"
        message = f"Not verified: at {place} {listed(beyond.open_ends)}; {further}."
    return BoundCell(
        value=value,
        finding=Finding.BOUND,
        sign=sign,
        searched=safe.value,
        kind=Turn.SEARCH,
        frequency=float("nan") if cycle is None else cycle.frequency,
        safe_value=safe.value,
        other_value=other.value,
        n_runs=safe.n_runs,
        n_settled=safe.n_runs,
        n_searched=n_searched,
        verified=bool(beyond.cycles),
        other_orbit=cycle,
        size=float("nan") if allowed is None or cycle is None else allowed.size_of(cycle),
        message=message,
    )
