"""Designs that cure: the largest or smallest value of a parameter without a limit cycle, over another parameter.

First order, which costs next to nothing, says on a grid where the best value of the other parameter lies; there and
beside it the bound is exact, and the best one is sought between its neighbours. That optimum is put to the test like
any bound: the exact search and runs on both sides. Families of cycles that a test finds on the safe side are added, and
the best value is sought once more.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from eppanalysis.arguments import check_counts
from eppanalysis.errors import EppError, shown
from eppanalysis.methods.bounds.elasticity import exact_elasticities, size_elasticities
from eppanalysis.methods.bounds.exact import ExactBound
from eppanalysis.methods.bounds.harmonic import Question, idle
from eppanalysis.methods.bounds.result import Turn
from eppanalysis.methods.bounds.sizes.allowed import Allowed
from eppanalysis.methods.bounds.verify import Verification, check_verification, verify
from eppanalysis.methods.design.frontier import Frontier
from eppanalysis.methods.design.result import Design, Goal, Optimum
from eppanalysis.methods.design.shrinking import shrinks
from eppanalysis.methods.search.find import find_limit_cycles
from eppanalysis.models.systems.lure import LureSystem
from eppanalysis.models.systems.subject import CaseLike, facts_of, require_case
from eppanalysis.progress import Progress
from eppanalysis.results.provenance import Provenance

#: Values of the other parameter that first order is asked at, and how close its best value is sought, of its range.
_GRID, _CLOSE = 7, 1e-3
_SEED = 20050901
#: How often families that tests find are added.
_MOST_FAMILIES = 3
#: How far the range of the objective is widened to say what would have to give.
_WIDER = 20.0


@dataclass(frozen=True)
class _Task:
    """What is asked: the tuned parameters with their ranges [SI], the objective, and how it is tested."""

    objective: str
    other: str | None
    ranges: dict[str, tuple[float, float]]
    sign: float
    allowed: Allowed | None
    verify: bool
    margin: float
    starts: int
    seed: int

    def question(self, case: CaseLike) -> Question:
        return Question(case, self.objective, *self.ranges[self.objective], self.other)


def design(
    case: CaseLike | LureSystem,
    tune: Mapping[str, Sequence[object]],
    *,
    maximise: str | None = None,
    minimise: str | None = None,
    allow: str | None = None,
    front: Mapping[str, Sequence[object]] | None = None,
    verify: bool = True,
    margin: float = 0.01,
    starts: int = 200,
    seed: int = _SEED,
    progress: Progress | None = None,
) -> Design:
    """The best values of one or two parameters for which no limit cycle exists, or none above what is allowed.

    Parameters
    ----------
    case : Case or LureSystem
    tune : mapping of str to (quantity, quantity)
        The parameters that may be chosen, one or two, and their ranges (plain numbers are SI).
    maximise, minimise : str, optional
        The one of them that is to be as large, or as small, as possible; one of the two is given.
    allow : str, optional
        A stable limit cycle that may be, as in "theta 0.3 deg" or "theta 0.1 deg rms"; see
        :func:`eppanalysis.design_bounds`.
    front : mapping of str to sequence of quantity, optional
        One more parameter and its values: the optimum at each of them.
    verify : bool
        Confirm every optimum on both sides.
    margin : float
        Distance of the tests from the active constraint, relative to the objective.
    starts : int
        Runs of each test, from a seeded cloud of initial states and steps of the inputs.
    seed : int
    progress : callable, optional
        Told the number of optima done, and of all.

    Returns
    -------
    Design

    Raises
    ------
    EppError
        If a parameter, a range or a setting is not valid, more than two parameters are tuned, or not one of `maximise`
        and `minimise` is one of them.

    Examples
    --------
    >>> import eppanalysis as epp
    >>> case = epp.case("wheelchair").with_values({"loop.gain": 0.8, "play.gap": 0.012})
    >>> found = epp.design(case, {"loop.gain": (0.6, 1.2)}, maximise="loop.gain", starts=50)
    >>> round(found.optimum.at["loop.gain"], 7), found.optimum.kind.value, found.optimum.confirmed
    (0.8462572, 'fold', True)
    """
    case = require_case(case, "design")
    check_verification(margin, starts)
    check_counts("design", {"starts": (starts, int(verify)), "seed": (seed, 0)})
    objective, sign = _objective(tune, maximise, minimise)
    ranges = {name: _range(case, name, both) for name, both in tune.items()}
    other = next((name for name in ranges if name != objective), None)
    allowed = None if allow is None else Allowed.read(case.to_system(), allow)
    task = _Task(objective, other, ranges, sign, allowed, verify, margin, starts, seed)
    over, values = _front(case, front, ranges)
    n_done, n_all = 0, 1 + len(values)

    def best(of: CaseLike) -> Optimum:
        nonlocal n_done
        found = _optimum(of, task)
        n_done += 1
        if progress is not None:
            progress(n_done, n_all, "")
        return found

    optimum = best(case)
    rows = tuple((value, best(case.with_values({over: value}))) for value in values)
    settings = {"tune": ranges, "objective": objective, "sign": sign, "margin": margin, "starts": starts, "seed": seed}
    settings |= {} if allowed is None else {"allowed": allowed.to_dict()}
    names = [*ranges, *([over] if over else [])]
    return Design(
        case=case.name,
        objective=objective,
        goal=Goal.LARGEST if sign > 0 else Goal.SMALLEST,
        tune=ranges,
        optimum=optimum,
        front_over=over,
        front=rows,
        margin=margin,
        allowed=allowed,
        readable={name: case.readable(name) for name in names},
        units={name: case.unit(name)[0] for name in names},
        provenance=Provenance("design without a limit cycle", settings, case=facts_of(case)),
    )


def _objective(tune: Mapping[str, object], maximise: str | None, minimise: str | None) -> tuple[str, float]:
    """The parameter that is the objective, and 1 where it is to be large."""
    if not 1 <= len(tune) <= 2:
        raise EppError(f"design: {len(tune)} parameters are tuned; expected one or two.")
    if (maximise is None) == (minimise is None):
        raise EppError(f"design: maximise is {shown(maximise)}, minimise {shown(minimise)}; expected one of the two.")
    name = maximise if maximise is not None else minimise
    if name not in tune:
        raise EppError(f"design: the objective is {shown(name)}; expected one of what is tuned: {', '.join(tune)}.")
    assert name is not None
    return name, 1.0 if maximise is not None else -1.0


def _range(case: CaseLike, name: str, both: Sequence[object]) -> tuple[float, float]:
    if isinstance(both, str) or len(both) != 2:
        raise EppError(f"design: the range of {name} is {shown(both)}; expected its low and its high end.")
    low, high = (case.si(name, v) for v in both)
    if not low < high:
        raise EppError(f"design: {name} is tuned within {both[0]} to {both[1]}; expected low < high.")
    return low, high


def _front(
    case: CaseLike, front: Mapping[str, Sequence[object]] | None, tuned: Mapping[str, object]
) -> tuple[str, list[float]]:
    """The parameter of the front and its values [SI]."""
    if front is None:
        return "", []
    if len(front) != 1:
        raise EppError(f"design: front has {len(front)} parameters; expected one with its values.")
    ((over, values),) = front.items()
    if over in tuned:
        raise EppError(f"design: front runs over {over}, which is tuned; expected another parameter.")
    if isinstance(values, str) or not len(values):
        raise EppError(f"design: front has no values of {over}; expected one or more.")
    return over, [case.si(over, v) for v in values]


def _optimum(case: CaseLike, task: _Task) -> Optimum:
    """The optimum for a case, tested; where tests find other families, sought once more with these."""
    question = task.question(case)
    values = [0.0] if task.other is None else list(np.linspace(*task.ranges[task.other], _GRID))
    ends = [question.low, question.high]
    if idle(question.at(float(values[0])), ends):
        raise EppError(f"design: the loop of this case does not depend on {task.objective}; expected one that does.")
    frontier = Frontier(question, task.sign, task.allowed)
    for _ in range(_MOST_FAMILIES):
        here = _best(frontier, [float(v) for v in values])
        bound = frontier.at(here)
        if not np.isfinite(frontier.worth(bound)):
            return Optimum({}, message=_would_have_to_give(case, task, frontier), evaluated=_evaluated(frontier))
        found = _described(frontier, task, here, bound)
        if not task.verify:
            return replace(found, message="it was not tested.")
        found, tested = _tested(frontier, task, here, bound, found)
        if found.confirmed or tested is None or not frontier.add(here, tested.safe_value, tested.cycles):
            return found
    return found


def _best(frontier: Frontier, grid: Sequence[float]) -> float:
    """The best value of the other parameter: first order's on a grid, exact beside it, then between its neighbours."""
    if len(grid) == 1:
        return grid[0]
    i = max(range(len(grid)), key=lambda k: _proposed(frontier, grid[k]))
    asked = {k for k in (i - 1, i, i + 1) if 0 <= k < len(grid)}
    while True:
        best = max(asked, key=lambda k: frontier.worth(frontier.at(grid[k])))
        beside = {k for k in (best - 1, best + 1) if 0 <= k < len(grid)} - asked
        infeasible = not np.isfinite(frontier.worth(frontier.at(grid[best])))
        more = set(range(len(grid))) - asked if infeasible else beside
        if not more:
            break
        asked |= more
    if infeasible or frontier.at(grid[best]).kind is Turn.END:
        return grid[best]
    _refine(frontier, grid[max(best - 1, 0)], grid[min(best + 1, len(grid) - 1)], grid[-1] - grid[0])
    return max(frontier.bounds, key=lambda other: frontier.worth(frontier.bounds[other]))


def _proposed(frontier: Frontier, other: float) -> float:
    """What first order says of a value of the other parameter; a range without cycles counts as its wanted end."""
    found = frontier.first_order(frontier.question.at(other))
    return frontier.sign * (frontier.ends[1] if found is None else found)


def _refine(frontier: Frontier, low: float, high: float, width: float) -> None:
    """Brent's method on the exact bound, which needs no derivative: two families may meet in the optimum."""
    from scipy.optimize import minimize_scalar

    worst = frontier.sign * frontier.ends[0] - abs(frontier.ends[1] - frontier.ends[0])

    def price(other: float) -> float:
        return -max(frontier.worth(frontier.at(float(other))), worst)

    minimize_scalar(price, bounds=(low, high), method="bounded", options={"xatol": _CLOSE * width})


def _described(frontier: Frontier, task: _Task, other: float, bound: ExactBound) -> Optimum:
    """The optimum without its tests."""
    at = {task.objective: bound.value} | ({} if task.other is None else {task.other: other})
    safe = bound.value if bound.kind is Turn.END else bound.value * (1.0 - task.sign * task.margin)
    proposed = frontier.first_order(frontier.question.at(other))
    return Optimum(
        at=at,
        values={**at, task.objective: safe},
        kind=bound.kind,
        at_end=_at_end(task, other),
        first_order=float("nan") if proposed is None else proposed,
        prices=_prices(frontier, other, bound),
        frequency=1.0 / bound.period,
        orbit=bound.cycle,
        evaluated=_evaluated(frontier),
    )


def _at_end(task: _Task, other: float) -> str:
    """At which end of its range the other parameter stands."""
    if task.other is None:
        return ""
    low, high = task.ranges[task.other]
    close = 2.0 * _CLOSE * (high - low)
    which = "lower" if other - low < close else "upper" if high - other < close else ""
    return f"{task.other} is at the {which} end of its range, which limits it, too" if which else ""


def _evaluated(frontier: Frontier) -> np.ndarray:
    known = sorted((q, b.value) for q, b in frontier.bounds.items() if np.isfinite(b.value))
    return np.array(known, float).reshape(-1, 2)


def _prices(frontier: Frontier, other: float, bound: ExactBound) -> dict[str, float]:
    """Elasticities of the objective at its optimum: by the envelope theorem those of the exact bound there."""
    point, here = bound.point, frontier.question.at(other)
    if point is None:
        return {}
    if bound.kind is Turn.SIZE and frontier.allowed is not None:
        return size_elasticities(here, point, frontier.allowed)
    return exact_elasticities(here, point) if bound.kind is Turn.FOLD or point.arc is not None else {}


def _tested(
    frontier: Frontier, task: _Task, other: float, bound: ExactBound, found: Optimum
) -> tuple[Optimum, Verification | None]:
    """The optimum with what the tests of it found."""
    here = frontier.question.at(other)
    if bound.cycle is None:
        search = find_limit_cycles(here.case_at(bound.value))
        cycles = [c for c in search if task.allowed is None or task.allowed.exceeded_by(c)]
        missing = "a search there finds a limit cycle" if cycles else " and ".join(search.left_open)
        return replace(found, confirmed=not missing, message=missing), None
    tested = verify(
        here,
        bound.value,
        task.sign,
        bound.cycle,
        margin=task.margin,
        n_starts=task.starts,
        seed=task.seed,
        allowed=task.allowed,
    )
    message = f"{tested.message}." if tested.message else ""
    slow = _only_slow(tested) and all(shrinks(here.case_at(tested.safe_value), x, bound.cycle) for x in tested.slow)
    found = replace(
        found,
        n_runs=tested.n_runs,
        n_settled=tested.n_settled,
        n_shrinking=len(tested.slow) if slow else 0,
        confirmed=tested.verified or slow,
        message=message,
    )
    return found, tested


def _only_slow(tested: Verification) -> bool:
    """Whether nothing but runs without an end keeps a bound from being verified."""
    ended = not tested.cycles and not tested.grows and tested.orbit is not None
    return ended and not tested.verified and tested.n_settled + len(tested.slow) == tested.n_runs


def _would_have_to_give(case: CaseLike, task: _Task, frontier: Frontier) -> str:
    """Which range would have to be wider, and by how much, where nothing within the ranges is free of cycles."""
    reasons = sorted({b.message for b in frontier.bounds.values() if b.message})
    low, high = task.ranges[task.objective]
    end = low if task.sign > 0 else high
    wider = (low / _WIDER, low) if task.sign > 0 else (high, high * _WIDER)
    told = f"{'; '.join(reasons)}."
    if not (0.0 < wider[0] < wider[1]):
        return f"{told} Its range would have to begin elsewhere."
    try:
        beyond = Frontier(replace(frontier.question, low=wider[0], high=wider[1]), task.sign, task.allowed)
        known = {q: beyond.at(q) for q in list(frontier.bounds)[:_GRID]}
    except EppError:
        return told
    best = max(known, key=lambda q: beyond.worth(known[q]))
    if not np.isfinite(beyond.worth(known[best])) or known[best].kind is Turn.END:
        return f"{told} Within {wider[0]:.4g} to {wider[1]:.4g} no bound was found either."
    where = "" if task.other is None else f" (at {task.other} {best:.4g})"
    return (
        f"{told} The end of its range at {end:.6g} would have to give: cycles vanish at {known[best].value:.6g}{where}."
    )
