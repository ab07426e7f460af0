"""Designs that cure: the best objective without a limit cycle, over as many parameters as are to be chosen.

One tuned parameter is bounded by cycles at each place of the others; the objective is that parameter itself, or what
follows from all of them. Describing functions say on a grid where the best place lies, their programme goes on from
there, exact folds say it. That optimum is put to the test like any bound: the exact search and runs on both sides.
Families of cycles that a test finds on the safe side are added, and the best place is sought once more.
"""

from __future__ import annotations

from collections.abc import Container, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from eppanalysis.arguments import check_counts
from eppanalysis.errors import ArgumentError, EppError, shown
from eppanalysis.methods.bounds.balanced import BoundProblem, idle, spread
from eppanalysis.methods.bounds.elasticity import parameters_of, size_elasticities
from eppanalysis.methods.bounds.result import Turn
from eppanalysis.methods.bounds.searched import SearchedProblem, why_by_search
from eppanalysis.methods.bounds.sizes.allowed import Allowed
from eppanalysis.methods.bounds.tolerances.bound import check_ends, half_widths_of
from eppanalysis.methods.bounds.verify import Verification, check_verification
from eppanalysis.methods.continuation.own_states import in_own_states
from eppanalysis.methods.design.bound_curve import BoundCurve
from eppanalysis.methods.design.goal import Goal, Sense, goal_of
from eppanalysis.methods.design.programme import N_SCAN, Place
from eppanalysis.methods.design.result import INSIDE, Design, Optimum
from eppanalysis.methods.design.search import Pick, Search
from eppanalysis.methods.design.searched import SearchedFrontier
from eppanalysis.methods.design.shrinking import shrinks
from eppanalysis.methods.search.find import find_limit_cycles
from eppanalysis.models.systems.lure import LureSystem
from eppanalysis.models.systems.sampled.clocked import has_samples
from eppanalysis.models.systems.subject import CaseLike, facts_of, require_case
from eppanalysis.progress import Progress
from eppanalysis.results.provenance import Provenance

#: How near to an end of its range a parameter counts as at it, of the range.
_CLOSE = 2e-3
_SEED = 20050901
#: How often families that tests find are added.
_MOST_FAMILIES = 3
#: How far the range of the bounded parameter is widened to say what would have to give, and places that are tried then.
_WIDER, _MOST_GIVING = 20.0, 7


@dataclass(frozen=True)
class Task:
    """The problem: the tuned parameters with their ranges [SI], the goal, and how it is tested."""

    goal: Goal
    bounded: str
    ranges: dict[str, tuple[float, float]]
    allowed: Allowed | None
    shares: dict[str, float]
    verify: bool
    margin: float
    starts: int
    seed: int

    @property
    def others(self) -> dict[str, tuple[float, float]]:
        """Ranges of the tuned parameters beside the bounded one."""
        return {name: both for name, both in self.ranges.items() if name != self.bounded}

    def middle(self, case: CaseLike) -> CaseLike:
        """The case in the middle of the ranges of the others."""
        return case.with_values({name: 0.5 * (low + high) for name, (low, high) in self.others.items()})

    def frontier(self, case: CaseLike, over: str, values: Sequence[float]) -> BoundCurve:
        """The bound over all that runs: what the front does, the other tuned parameters, and what has a tolerance."""
        question = BoundProblem(in_own_states(self.middle(case)), self.bounded, *self.ranges[self.bounded])
        if idle(question, [question.low, question.high]):
            raise EppError(f"design: the loop of this case does not depend on {self.bounded}; expected one that does.")
        widths = {over: max(np.ptp(values), 1e-3 * abs(values[0])) or 1.0} if over else {}
        widths |= {name: high - low for name, (low, high) in self.others.items()}
        off = {n: abs(case.value(n)) * s for n, s in self.shares.items() if n != self.bounded}
        system, runs = case.to_system(), {**off, **widths}
        if has_samples(system):  # whose branches have no folds; others are followed even where no balance covers them
            asking = SearchedProblem(self.allowed, self.margin, why=why_by_search(system))
            return SearchedFrontier(question, runs, self._sign(question), self.allowed, asking=asking)
        return BoundCurve(question, runs, self._sign(question), self.allowed)

    def _sign(self, question: BoundProblem) -> float:
        """1 where the bounded parameter is to be large."""
        if self.goal.name == self.bounded:
            return self.goal.sign
        # Which way is better follows from the goal itself, over the range of the bounded parameter.
        rows = []
        for value in spread(question.low, question.high, N_SCAN):
            try:
                rows.append(self.goal.judge(question.case_at(value)).worth)
            except EppError:
                continue
        known = [worth for worth in rows if np.isfinite(worth)]
        if not known:
            raise EppError(
                f"design: there is no {self.goal.name} at any value of {self.bounded} in the middle of the other "
                "ranges; expected ranges in which the linearised loop is stable."
            )
        return 1.0 if known[-1] >= known[0] else -1.0

    def search(self, frontier: BoundCurve, fixed: Mapping[str, float]) -> Search:
        """The search for the best place on a frontier."""
        return Search(frontier, self.goal, self.others, dict(fixed), self.shares)


def design(
    case: CaseLike | LureSystem,
    tune: Mapping[str, Sequence[object]],
    *,
    maximise: str | None = None,
    minimise: str | None = None,
    subject_to: Mapping[str, object] | None = None,
    at: str | None = None,
    allow: str | None = None,
    tolerances: Mapping[str, object] | None = None,
    front: Mapping[str, Sequence[object]] | None = None,
    verify: bool = True,
    margin: float = 0.01,
    starts: int = 200,
    seed: int = _SEED,
    progress: Progress | None = None,
) -> Design:
    """The best values of parameters for which no limit cycle exists, or none above what is allowed.

    Parameters
    ----------
    case : Case or LureSystem
        With sampled controllers, and in discrete time, runs from the cycles that are known bound each place, and the
        search for limit cycles tests the optimum; what that does not cover is in `Design.not_covered`.
    tune : mapping of str to (quantity, quantity)
        The parameters that may be chosen and their ranges (plain numbers are SI). Where none of them is the objective,
        the first is the one that cycles bound.
    maximise, minimise : str, optional
        The objective; one of the two is given. It is one of the tuned parameters, another number of the case that
        follows from them (an expression), or a measure of the linearised loop: "bandwidth" (of the closed loop, where
        it is 3 dB below rest), "crossover", "phase_margin", "gain_margin", "disk_margin", "delay_margin",
        "tracking_error" (behind a ramp, over its rate).
    subject_to : mapping of str to quantity, optional
        Least values of measures of the linearised loop, as in ``{"phase_margin": "45 deg"}``; of a tracking error the
        greatest.
    at : str, optional
        Where the loop is cut for them; by default where :func:`eppanalysis.margins` cuts it.
    allow : str, optional
        A stable limit cycle that may be, as in "theta 0.3 deg" or "theta 0.1 deg rms"; see
        :func:`eppanalysis.design_bounds`.
    tolerances : mapping of str to quantity or percentage, optional
        Half-widths within which every machine is to be free of cycles; ``{}`` takes those that the case carries.
    front : mapping of str to sequence of quantity, optional
        One more parameter and its values: the optimum at each of them.
    verify : bool
        Confirm every optimum on both sides.
    margin : float
        How far inside the active constraint the design is tested, as a share of the bounded parameter's value there.
    starts : int
        Runs of each test, from a seeded cloud of initial states and steps of the inputs; with tolerances as many again,
        each of a machine of its own.
    seed : int
        Of the runs of each test: the same seed, the same runs.
    progress : callable, optional
        Called with the number of optima done, and of all.

    Returns
    -------
    Design

    Raises
    ------
    EppError
        If a parameter, a range or a setting is not valid, or not one objective is given.

    Examples
    --------
    >>> import eppanalysis as epp
    >>> case = epp.case("wheelchair").with_values({"loop.gain": 0.8, "play.gap": 0.012})
    >>> free = {"loop.gain": (0.6, 1.2)}
    >>> found = epp.design(case, free, maximise="loop.gain", starts=50)
    >>> best = found.optimum
    >>> round(best.at["loop.gain"], 7), best.kind.value, best.confirmed
    (0.8462572, 'fold', True)
    """
    case = require_case(case, "design")
    check_verification(margin, starts)
    check_counts("design", {"starts": (starts, int(verify)), "seed": (seed, 0)})
    if not tune:
        raise EppError("design: no parameter is tuned; expected one or more with their ranges.")
    goal = goal_of(case, maximise, minimise, subject_to, at)
    ranges = {name: _range(case, name, both) for name, both in tune.items()}
    bounded = goal.name if goal.name in ranges else next(iter(ranges))
    allowed = None if allow is None else Allowed.read(case.to_system(), allow)
    shares = _shares(case, tolerances, ranges)
    task = Task(goal, bounded, ranges, allowed, shares, verify, margin, starts, seed)
    over, values = _front(case, front, ranges)
    frontier = task.frontier(case, over, values)
    fixed = {name: case.value(name) for name in frontier.widths if name not in ranges}
    found: list[Optimum] = []
    for moved in [{}, *({over: value} for value in values)]:
        # Along the front optima move little: each climb begins from the last ones.
        near = [tuple(o.at[n] for n in task.others) for o in found if o.feasible]
        found.append(_optimum(task.search(frontier, {**fixed, **moved}), task, near))
        if progress is not None:
            progress(len(found), 1 + len(values), "")
    settings = {"tune": ranges, "objective": goal.name, "sign": goal.sign, "margin": margin, "starts": starts}
    settings |= {"seed": seed, "tolerances": shares, "kept": [k.to_dict() for k in goal.kept]}
    settings |= {} if allowed is None else {"allowed": allowed.to_dict()}
    names = [*ranges, *([over] if over else []), *([goal.name] if goal.measure is None else [])]
    measured = {} if goal.measure is None else {goal.name: goal.measure}
    return Design(
        case=case.name,
        objective=goal.name,
        goal=Sense.LARGEST if goal.sign > 0 else Sense.SMALLEST,
        tune=ranges,
        optimum=found[0],
        bounded=bounded,
        kept=goal.kept,
        tolerances=shares,
        front_over=over,
        front=tuple(zip(values, found[1:], strict=True)),
        front_own=case.value(over) if over else float("nan"),
        margin=margin,
        allowed=allowed,
        not_covered=frontier.not_covered,
        readable={n: case.readable(n) for n in names} | {n: m.shown or (m.unit, 1.0) for n, m in measured.items()},
        units={n: case.unit(n)[0] for n in names} | {n: m.unit for n, m in measured.items()},
        provenance=Provenance("design without a limit cycle", settings, case=facts_of(case)),
    )


def _range(case: CaseLike, name: str, both: Sequence[object]) -> tuple[float, float]:
    if isinstance(both, str) or len(both) != 2:
        raise EppError(f"design: the range of {name} is {shown(both)}; expected its low and its high end.")
    low, high = (case.si(name, v) for v in both)
    if not low < high:
        raise EppError(f"design: {name} is tuned within {both[0]} to {both[1]}; expected low < high.")
    return low, high


def _shares(case: CaseLike, tolerances: Mapping[str, object] | None, tuned: Container[str]) -> dict[str, float]:
    """Tolerances relative to the values; those of what is tuned go with its ranges."""
    if tolerances is None:
        return {}
    widths = half_widths_of(case, tolerances or None)
    for name, width in widths.items():
        if not case.value(name):
            raise EppError(f"tolerance of {name}: the case holds 0 for it; expected a parameter that is not zero.")
        if name not in tuned:
            check_ends(case, name, width)
    return {name: width / abs(case.value(name)) for name, width in widths.items()}


def _front(
    case: CaseLike, front: Mapping[str, Sequence[object]] | None, tuned: Mapping[str, object]
) -> tuple[str, list[float]]:
    """The parameter of the front and its values [SI]."""
    if front is None:
        return "", []
    if len(front) != 1:
        raise ArgumentError("front", f" has {len(front)} parameters; expected one with its values.", "design")
    ((over, values),) = front.items()
    if over in tuned:
        raise ArgumentError("front", f" runs over {over}, which is tuned; expected another parameter.", "design")
    if isinstance(values, str) or not len(values):
        raise ArgumentError("front", f" has no values of {over}; expected one or more.", "design")
    return over, [case.si(over, v) for v in values]


def _optimum(search: Search, task: Task, near: Sequence[Place]) -> Optimum:
    """The optimum at one value of the front, tested; where tests find other families, sought once more with these."""
    for _ in range(_MOST_FAMILIES):
        best = search.best_of_all(near)
        if not best.feasible:
            return Optimum({}, message=_would_have_to_give(search, best), evaluated=search.evaluated())
        found = described(search, task, best)
        if not task.verify:
            return replace(found, message="it was not tested.")
        found, tested = _tested(search, task, best, found)
        if found.confirmed or tested is None or not tested.cycles:
            return found
        # A family that the tests found bounds other places as well: all of them are computed anew.
        search.picks.clear()
        if not search.frontier.add(search.full(best.place, best.corner), tested.safe_value, tested.cycles):
            return found
    return found


def described(search: Search, task: Task, best: Pick) -> Optimum:
    """The optimum without its tests."""
    limit, by_cycle = task.bounded, best.by_cycle
    others = dict(zip(search.others, best.place, strict=True))
    # A margin is taken off where cycles, or what is kept, limit the design; the end of its own range needs none.
    safe = best.value * (1.0 - search.frontier.sign * task.margin) if by_cycle or best.kept else best.value
    case = search.here(best.place).case
    return Optimum(
        at={limit: best.value, **others},
        values={limit: safe, **others},
        objective=search.goal.sign * best.worth,
        kind=best.bound.kind if by_cycle else Turn.END if not best.kept and not best.inside else Turn.UNKNOWN,
        active=str(best.kept) if best.kept else INSIDE if best.inside else "",
        at_end=_at_end(search, best),
        first_order=search.first_order(best),
        prices=_prices(search, case, best),
        frequency=1.0 / best.bound.period if by_cycle else float("nan"),
        orbit=best.bound.cycle,
        off=dict(best.corner),
        evaluated=search.evaluated(),
    )


def _at_end(search: Search, best: Pick) -> str:
    """Which of the other parameters are at an end of their ranges."""
    told = []
    for share, name in zip(search.units(best.place)[0], search.others, strict=True):
        which = "lower" if share < _CLOSE else "upper" if share > 1.0 - _CLOSE else ""
        told += [f"{name} is at the {which} end of its range, which limits it, too"] if which else []
    return "; ".join(told)


def _prices(search: Search, case: CaseLike, best: Pick) -> dict[str, float]:
    """Elasticities of the objective at its optimum: there the other tuned parameters have none inside their ranges."""
    limit, goal = search.frontier.question.limit, search.goal
    sizes = {
        name: abs(case.value(name)) for name in parameters_of(search.here(best.place)) if name not in (limit, goal.name)
    }
    edge = search.of_bound(best, sizes)
    if best.by_cycle and not edge:
        return {}
    slopes = search.slopes(best, sizes, edge)
    prices = {name: slope * case.value(name) / best.worth for name, slope in slopes.items()}
    if best.bound.kind is Turn.SIZE and best.by_cycle and goal.name == limit and best.bound.point is not None:
        assert search.frontier.allowed is not None
        elastic = size_elasticities(search.here(best.place, best.corner), best.bound.point, search.frontier.allowed, ())
        prices |= {"allowed": elastic["allowed"]} if "allowed" in elastic else {}
    return prices


def _tested(search: Search, task: Task, best: Pick, found: Optimum) -> tuple[Optimum, Verification | None]:
    """The optimum with what the tests of it found, at the corner of the tolerances that is active."""
    here = search.here(best.place, best.corner)
    if not best.by_cycle or best.bound.cycle is None:
        cycles = find_limit_cycles(here.case_at(best.value))
        bad = [c for c in cycles if task.allowed is None or task.allowed.exceeded_by(c)]
        missing = "a search there finds a limit cycle" if bad else " and ".join(cycles.left_open)
        return replace(found, confirmed=not missing, message=missing), None
    full = search.full(best.place, best.corner)
    tested = search.frontier.tested(full, best.bound, task.margin, task.starts, task.seed)
    message = f"{tested.message}." if tested.message else ""
    n_machines = n_good = 0
    if task.shares:
        n_machines = task.starts
        n_good = _machines_at_rest(search, best, found.values[task.bounded], n_machines, task.seed)
        if n_good < n_machines:
            message = (
                f"{n_machines - n_good} of {n_machines} machines within the tolerances do not come to rest. {message}"
            )
    case = here.case_at(tested.safe_value)
    # Beside a fold motions pass the ghost of the cycle slowly: runs that
    # are slow and nothing else go on until they are seen to shrink.
    slow = _only_slow(tested) and all(shrinks(case, x, best.bound.cycle) for x in tested.slow)
    found = replace(
        found,
        n_runs=tested.n_runs,
        n_settled=tested.n_settled,
        n_shrinking=len(tested.slow) if slow else 0,
        n_machines=n_machines,
        confirmed=(tested.verified or slow) and n_good == n_machines,
        message=message.strip(),
    )
    return found, tested


def _machines_at_rest(search: Search, best: Pick, value: float, n: int, seed: int) -> int:
    """How many machines drawn from the tolerances come to rest, with a nominal value of the bounded parameter [SI]."""
    rng = np.random.default_rng(seed)
    cycle, limit = best.bound.cycle, search.frontier.question.limit
    if cycle is None:
        raise EppError("design: machines are drawn where a limit cycle bounds the design; expected one that does.")
    names = sorted(search.shares)
    cases = []
    for row in rng.uniform(-1.0, 1.0, (n, len(names))).tolist():
        off = dict(zip(names, row, strict=True))
        own = 1.0 + off.get(limit, 0.0) * search.shares.get(limit, 0.0)
        cases.append(search.here(best.place, off).case_at(value * own))
    return search.frontier.at_rest(cases, cycle, rng)


def _only_slow(tested: Verification) -> bool:
    """Whether nothing but runs without an end keeps a bound from being verified."""
    ended = not tested.cycles and not tested.grows and tested.orbit is not None
    return ended and not tested.verified and tested.n_settled + len(tested.slow) == tested.n_runs


def _would_have_to_give(search: Search, best: Pick) -> str:
    """Which range would have to be wider, and by how much, where nothing within the ranges is feasible."""
    frontier = search.frontier
    reasons = sorted({p.message for p in search.picks.values() if p.message})
    low, high = frontier.question.low, frontier.question.high
    end = low if frontier.sign > 0 else high
    wider = (low / _WIDER, low) if frontier.sign > 0 else (high, high * _WIDER)
    told = f"{'; '.join(reasons)}."
    if np.isfinite(frontier.worth(best.bound)):  # not the cycles, but what is to be kept
        return f"{told} Relax that, or the allowed size of cycles."
    if not (0.0 < wider[0] < wider[1]):
        return f"{told} Begin its range elsewhere."
    try:
        beyond = frontier.over(*wider)
        known = {p: beyond.at(search.full(p, search.corners[-1])) for p in list(search.picks)[:_MOST_GIVING]}
    except EppError:
        return told
    place = max(known, key=lambda p: beyond.worth(known[p]))
    if not np.isfinite(beyond.worth(known[place])) or known[place].kind is Turn.END:
        return f"{told} Within {wider[0]:.4g} to {wider[1]:.4g} no bound was found either."
    where = ", ".join(f"{name} {value:.4g}" for name, value in zip(search.others, place, strict=True))
    moved = f"Move the end of its range at {end:.4g}: cycles vanish at {known[place].value:.4g}"
    return f"{told} {moved}{f' (at {where})' if where else ''}."
