"""Bounds of a design: how far one parameter may go at each value of another before any limit cycle exists.

Each bound is found by describing functions, corrected to the exact fold, put to the test on both sides, and comes with
its elasticities. The parts are in ``balanced`` (search and sweep), ``fold`` (the nonlinear programme), ``equations``
(its equations), ``exact``, ``verify`` and ``elasticity``. Where a size of cycles is allowed, exact orbits alone are
asked (``sizes``), of a sampled loop ``searched``.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from functools import partial
from operator import call
from typing import Any

import numpy as np

from eppanalysis.arguments import check_counts
from eppanalysis.errors import ArgumentError, EppError
from eppanalysis.limits import MARGIN
from eppanalysis.methods.bounds.balanced import BalancedBound, BalancedSweep, BoundProblem, value_of
from eppanalysis.methods.bounds.elasticity import exact_elasticities, size_elasticities
from eppanalysis.methods.bounds.exact import ExactBound, farthest_turn, of_balance, searched, turn_of
from eppanalysis.methods.bounds.proved import with_proofs
from eppanalysis.methods.bounds.result import UNTESTED, BoundCell, DesignBounds, Finding, Turn
from eppanalysis.methods.bounds.searched import SearchedProblem, searched_cell, why_by_search
from eppanalysis.methods.bounds.sizes.allowed import Allowed
from eppanalysis.methods.bounds.sizes.bound import bound_of_size, farthest_passage, first_order_bound, scan
from eppanalysis.methods.bounds.verify import Verification, check_verification, verify
from eppanalysis.methods.continuation.own_states import in_own_states
from eppanalysis.methods.continuation.result import Branch
from eppanalysis.models.systems.lure import LureSystem
from eppanalysis.models.systems.subject import CaseLike, facts_of, require_case
from eppanalysis.progress import Progress
from eppanalysis.results import LimitCycle
from eppanalysis.results.deferred import Deferred
from eppanalysis.results.provenance import Provenance

__all__ = ["BoundCell", "DesignBounds", "Finding", "bound_of_branch", "design_bounds"]

#: Where a bound is sought, relative to the case's own value; how far the other parameter runs.
_WITHIN, _RUN = (0.05, 2.0), (0.4, 2.0)
_SEED = 20050901
_MOST_FAMILIES = 3
_SLOW = " Near the bound a cycle that has vanished decays slowly; a larger margin leaves it room."
#: Fields of the run, and why a bound on one of its input is where the run ceases to come to rest.
_OF_THE_RUN, _INPUT = "run.", "The input does not change the loop"
#: What describing functions may find of a cell that exact orbits then examine.
_CORRECTED = (Finding.BOUND, Finding.BEYOND, Finding.FAILED)


@dataclass(frozen=True)
class Settings:
    """How bounds are tested: see :func:`design_bounds`."""

    exact: bool = True
    verify: bool = True
    margin: float = MARGIN
    starts: int = 1000
    seed: int = _SEED
    allowed: Allowed | None = None


def design_bounds(
    case: CaseLike | LureSystem,
    over: str,
    limit: str,
    *,
    start: object = None,
    stop: object = None,
    points: int = 9,
    at: Sequence[object] | None = None,
    within: tuple[object, object] | None = None,
    allow: str | None = None,
    own_run: bool = False,
    exact: bool = True,
    verify: bool = True,
    margin: float = MARGIN,
    starts: int = 1000,
    seed: int = _SEED,
    prove: bool = False,
    workers: int = 1,
    sweep: BalancedSweep | None = None,
    progress: Progress | None = None,
) -> DesignBounds:
    """The bound on one parameter of a case at each of a row of values of another.

    Parameters
    ----------
    case : Case or LureSystem
        With sampled controllers, in discrete time, and where harmonic balance does not cover an element, a bound is
        where the answer of the search for limit cycles changes; `DesignBounds.not_covered` says what
        that does not cover.
    over, limit : str
        Dotted names: the parameter that runs ("bands.range"), and the one that is bounded ("lock_pin.backlash"). The
        bound on a field of an input ("run.input.size", "run.inputs.load.size") is how large a step, a load or a rate
        the case's own run bears from its start: `own_run` is understood.
    start, stop : str or number, optional
        First and last value of `over` (plain numbers are SI); 0.4 and 2 times the case's own by default.
    points : int
        Number of values of `over`, evenly spaced.
    at : sequence of quantity, optional
        The values of `over`, in place of `start`, `stop` and `points`.
    within : (quantity, quantity), optional
        Range of `limit` in which its bound is sought; 0.05 to 2 times the case's own value by default.
    allow : str, optional
        A limit cycle that is allowed: a signal and its size peak to peak, "theta 0.3 deg", or "theta 0.1 deg rms"
        (about the mean; plain numbers are SI); with a band, "theta 0.3 deg within 1 Hz..8 Hz", cycles of such a
        frequency alone are bounded. The bound is then where the largest stable cycle becomes larger.
    own_run : bool
        Where the search decides, use the case's own run alone, from its own start and with its own input: which is the
        last value from which that comes to rest?
    exact : bool
        Correct every bound to the exact fold; bounds of a sampled loop come from the search and need none.
    verify : bool
        Test every corrected bound on both sides.
    margin : float
        Distance of the tests from the bound, relative to it; of a sampled loop, that of both sides from one another.
    starts : int
        Runs of each test, from a seeded cloud of initial states and steps of the inputs; a sampled loop has those of
        the search.
    seed : int
        Of the runs of each test.
    prove : bool
        Prove what can be proved on both sides of every exact bound (:func:`certify`, :func:`certify_orbit`; seconds
        each): that there is no limit cycle, and that there is one (`BoundCell.proved`). Needs the extra "proof".
    workers : int
        Processes that correct and test; results do not depend on their number. More than one needs a script that is
        guarded by ``if __name__ == "__main__"``.
    sweep : BalancedSweep, optional
        An earlier sweep of the same case, whose compiled programs and processes are used again; a new one by default.
    progress : callable, optional
        Called with the number of cells done, the number of all cells, and an empty text.

    Returns
    -------
    DesignBounds

    Raises
    ------
    EppError
        If a parameter, a range or a setting is not valid, or `allow` names no signal, or a unit that is not its own.

    Examples
    --------
    >>> import eppanalysis as epp
    >>> case = epp.case("wheelchair").with_values({"loop.gain": 1.0})
    >>> found = epp.design_bounds(case, "play.gap", "loop.gain", at=[0.012], starts=100)
    >>> round(found[0].exact, 7), found[0].verified
    (0.8462572, True)

    How large may the play of a servo be, if its output may move by 0.5?

    >>> servo = epp.case("backlash_servo")
    >>> options = {"at": [1.0], "allow": "x 0.5", "starts": 100}
    >>> found = epp.design_bounds(servo, "loop.gain", "play.gap", **options)
    >>> round(found[0].exact, 7), found[0].kind.value, found[0].verified
    (0.2551403, 'allowed size', True)
    """
    case = require_case(case, "design_bounds")
    allowed = None if allow is None else Allowed.read(case.to_system(), allow)
    if allowed is not None and not exact:
        raise EppError(f"design_bounds: allow is {allow!r} and exact is False; expected exact orbits with sizes.")
    check_verification(margin, starts)
    check_counts("design_bounds", {"points": (points, 1), "workers": (workers, 1), "seed": (seed, 0)})
    check_counts("design_bounds", {"starts": (starts, int(verify and exact))})
    if over == limit:
        raise EppError(f"design_bounds: {over} is to run and to be bounded; expected two different parameters.")
    values = _values(case, over, start, stop, points) if at is None else [case.si(over, v) for v in at]
    if not values:
        raise EppError(f"design_bounds: at is empty; expected one value of {over} or more.")
    low, high = range_within(case, limit, within)
    _check_pair(case, over, values[0], limit, high)
    question = BoundProblem(in_own_states(case), limit, low, high, over)
    sweep = sweep or BalancedSweep(question)
    sweep.turn_to(question)
    settings = Settings(exact, verify and exact, margin, starts, seed, allowed)
    of_run = limit.startswith(_OF_THE_RUN)
    own_run = own_run or of_run
    why = _INPUT if of_run else why_by_search(case.to_system())
    # What is done at each value only this process can tell.
    asking = (
        SearchedProblem(allowed, margin, own_run, why, progress=progress if workers == 1 else None) if why else None
    )
    _check_asking(settings, asking, own_run, prove)
    jobs: Iterator[Callable[[], BoundCell]]
    if asking is not None:
        jobs = (partial(searched_cell, question, v, asking) for v in values)
    elif allowed is not None:
        jobs = (partial(sized_cell, question, v, settings) for v in values)
    else:  # describing functions one after another, in this process, and the rest of each cell on all workers
        jobs = (partial(_corrected, *sweep.bound(v), v, settings) for v in values)
    with sweep.shared_by(workers) as pool:
        cells = _cells(jobs, len(values), pool, progress)
    if prove:
        cells = [with_proofs(replace(question, case=case).at(c.value), c) for c in cells]
    facts = {"over": over, "limit": limit, "within": (low, high), "margin": margin, "starts": starts, "seed": seed}
    facts |= {} if allowed is None else {"allowed": allowed.to_dict()}
    known = {name: value_of(case, name) for name in (over, limit)}
    return DesignBounds(
        case=case.name,
        over=over,
        limit=limit,
        units={name: case.unit(name)[0] for name in (over, limit)},
        readable={name: case.readable(name) for name in (over, limit)},
        own={name: value for name, value in known.items() if value is not None},
        within=(low, high),
        cells=tuple(cells),
        margin=margin,
        allowed=allowed,
        not_covered="" if asking is None else asking.not_covered(cells),
        provenance=Provenance("design bounds", facts, case=facts_of(case)),
        operating_point=case.operating_point,
    )


def _check_asking(settings: Settings, asking: SearchedProblem | None, own_run: bool, prove: bool) -> None:
    """Refuse what goes with exact folds alone where the search is used, and what goes with the search elsewhere."""
    if asking is None and own_run:
        said = " is given for a loop whose bounds are folds; expected a loop whose bounds the search finds."
        raise ArgumentError("own_run", said, "design_bounds")
    if asking is not None and not settings.exact:
        raise ArgumentError(
            "exact", " is False; expected True for a loop whose bounds the search finds.", "design_bounds"
        )
    if prove and (asking is not None or settings.allowed is not None or not settings.verify):
        expected = "expected exact bounds on limit cycles of any size, with tests"
        raise ArgumentError("prove", f" is given for bounds that have no proof; {expected}.", "design_bounds")


def _values(case: CaseLike, over: str, start: object, stop: object, points: int) -> list[float]:
    own = 0.0
    if start is None or (stop is None and points > 1):
        own = _own(case, over, "start" if start is None else "stop", "values for it to run over")
    first = _RUN[0] * own if start is None else case.si(over, start)
    last = first if points == 1 else _RUN[1] * own if stop is None else case.si(over, stop)
    if points > 1 and first == last:
        raise EppError(f"design_bounds: {over} runs from {start} to {stop}; expected two different values.")
    return [float(v) for v in np.linspace(first, last, points)]


def range_within(case: CaseLike, limit: str, within: tuple[object, object] | None) -> tuple[float, float]:
    """The range in which a bound is sought [SI]: the one given, else about the case's own value.

    Raises
    ------
    EppError
        If it is empty, not valid for the case, or none is given for a parameter that is not positive.
    """
    if within is not None:
        low, high = (case.si(limit, v) for v in within)
        if not low < high:
            said = f" is {within[0]} to {within[1]}; expected low < high, as {limit} is sought there."
            raise ArgumentError("within", said, "design_bounds")
        return low, high
    wanted = "within", "a range in which to seek its bound"
    own = _own(case, limit, *wanted)
    if not own > 0:
        raise _not_given(f"{limit} is {case.text(limit, own)}", *wanted)
    return _allowed(case, limit, own, _WITHIN[0]), _allowed(case, limit, own, _WITHIN[1])


def _own(case: CaseLike, name: str, argument: str, wanted: str) -> float:
    """The case's own value of a parameter [SI].

    Raises
    ------
    EppError
        If it has none: says which argument is wanted in its place.
    """
    own = value_of(case, name)
    if own is None:
        case.si(name, 0.0)  # refuses an expression, which has a value but takes none
        raise _not_given(f"{name} has no value", argument, wanted)
    return own


def _not_given(why: str, argument: str, wanted: str) -> ArgumentError:
    return ArgumentError(argument, f" is not given, and {why} in this case; expected {wanted}.", "design_bounds")


def _allowed(case: CaseLike, limit: str, own: float, factor: float) -> float:
    """A factor of the case's own value, or the one nearest to it with which the case is valid."""
    why, near, far = "", 1.0, factor
    while abs(far - near) > 1e-3 * near:
        try:
            case.with_values({limit: factor * own})
        except EppError as error:
            why, far = str(error).removesuffix("."), factor
        else:
            near = factor
        if near == far:
            return far * own
        factor = 0.5 * (near + far)
    if near == 1.0:
        raise EppError(f"design_bounds: {limit} cannot be changed in this case ({why}); expected a parameter that can.")
    return near * own


def _check_pair(case: CaseLike, over: str, value: float, limit: str, end: float) -> None:
    """Refuse two parameters of which one, once it is given, takes the place of the other."""
    both = case.with_values({over: value}).with_values({limit: end})
    kept = value_of(both, over)
    if kept is None or abs(kept - value) > 1e-9 * abs(value):
        raise EppError(f"design_bounds: {limit} replaces {over}; expected two parameters that can both be given.")


def _cells(
    jobs: Iterator[Callable[[], BoundCell]], n: int, pool: Executor | None, progress: Progress | None
) -> list[BoundCell]:
    """All cells, on all workers."""
    cells: list[BoundCell] = []
    for cell in (map if pool is None else pool.map)(call, jobs):
        cells.append(cell)
        if progress is not None:
            progress(len(cells), n, "")
    return cells


def sized_cell(question: BoundProblem, value: float, settings: Settings) -> BoundCell:
    """The bound at one value of the parameter that runs, where a size is allowed; what fails is said in the cell."""
    assert settings.allowed is not None
    here = question.at(value)
    found = scan(here, settings.allowed)
    cell = BoundCell(value=value, finding=found.finding, sign=found.sign, message=found.note)
    if found.finding is not Finding.BOUND:
        return cell
    cell = replace(cell, first_order=first_order_bound(here, settings.allowed, found))
    try:
        bound = bound_of_size(here, settings.allowed, found)
        cell = checked_bound(here, cell, bound, settings)
    except (EppError, np.linalg.LinAlgError) as error:
        cell = replace(cell, message=f"Not corrected: the exact orbits failed ({str(error).rstrip('.')}).")
    message = " ".join(text for text in (found.note, cell.message) if text and text not in found.note)
    size = float("nan") if cell.orbit is None else settings.allowed.size_of(cell.orbit)
    return replace(cell, size=size, message=message or cell.message)


def _corrected(question: BoundProblem, bound: BalancedBound, value: float, settings: Settings) -> BoundCell:
    """One cell, its bound corrected and tested; what fails is said in it and does not end the sweep."""
    cell = _from_balance(value, bound)
    if not settings.exact or bound.finding not in _CORRECTED:
        return cell
    near = bound.fold.cycle.value if bound.fold is not None and bound.finding is Finding.BOUND else None
    try:
        found = ExactBound() if near is None else of_balance(question, bound)
        # Describing functions may see no cycle at all, as with hunting.
        if found.cycle is None:
            other = searched(question, question.ends(bound.sign)[0] if near is None else near, bound.sign)
            found = other if other.cycle is not None or other.kind or near is None else found
        return checked_bound(question, cell, found, settings)
    except (EppError, np.linalg.LinAlgError) as error:
        return _joined(cell, ExactBound(message=f"the correction failed ({error})"))


def bound_of_branch(question: BoundProblem, value: float, branch: Branch, settings: Settings) -> BoundCell | None:
    """The bound at the end of a branch of exact cycles that is known already, tested like any other.

    It takes no describing functions, and holds no value of them. Other families of cycles
    are found by the tests, as everywhere.

    Parameters
    ----------
    value : float
        Of the parameter that runs [SI].
    branch : Branch
        Over the limiting parameter, from cycles above their bound.

    Returns
    -------
    BoundCell or None
        None where the branch has no end within the range of the question.
    """
    turn = turn_of(question, branch, question.low, 1.0)
    if turn is None:
        return None
    cell = BoundCell(value=value, finding=Finding.BOUND)
    try:
        return checked_bound(question, cell, turn, settings)
    except (EppError, np.linalg.LinAlgError) as error:
        return replace(cell, exact=turn.value, kind=turn.kind, message=f"Not verified: the tests failed ({error}).")


def checked_bound(question: BoundProblem, cell: BoundCell, found: ExactBound, settings: Settings) -> BoundCell:
    """A cell with its exact bound, tested; where a test finds another family on the safe side, that one's is next."""
    if found.cycle is None:
        return _joined(cell, found)
    tested: Verification | None = None
    for turns_left in reversed(range(_MOST_FAMILIES if settings.verify else 0)):
        assert found.cycle is not None
        tested = verify(
            question,
            found.value,
            cell.sign,
            found.cycle,
            margin=settings.margin,
            n_starts=settings.starts,
            seed=settings.seed,
            allowed=settings.allowed,
        )
        further = None
        if turns_left:
            further = farthest_end(question, tested.safe_value, tested.cycles, cell.sign, settings.allowed)
        if further is None:
            break
        found = further
    slopes = Deferred(partial(_elasticities, question, found, settings.allowed))
    return _joined(cell, found, tested, slopes)


def farthest_end(
    question: BoundProblem, value: float, cycles: Iterable[LimitCycle], sign: float, allowed: Allowed | None
) -> ExactBound | None:
    """The bound, farthest to the safe side, of cycles at a value: where they end, or are no larger than allowed."""
    if allowed is None:
        return farthest_turn(question, value, cycles, sign)
    return farthest_passage(question, allowed, value, cycles, sign)


def _elasticities(question: BoundProblem, found: ExactBound, allowed: Allowed | None) -> dict[str, float]:
    """Elasticities of an exact bound where its kind has some."""
    point = found.point
    if point is None:
        return {}
    if found.kind is Turn.SIZE and allowed is not None:
        return size_elasticities(question, point, allowed)
    return exact_elasticities(question, point) if found.is_solved else {}


def _from_balance(value: float, bound: BalancedBound) -> BoundCell:
    """A cell with what describing functions say; where their cycles go on to the end of the range, they say none."""
    fold = bound.fold
    return BoundCell(
        value=value,
        finding=bound.finding,
        sign=bound.sign,
        first_order=float("nan") if fold is None or fold.at_end else fold.cycle.value,
        frequency=float("nan") if fold is None else fold.cycle.omega / (2.0 * np.pi),
        message=" ".join(t for t in (bound.finding.sentence, bound.message) if t),
    )


def _joined(
    cell: BoundCell,
    bound: ExactBound,
    test: Verification | None = None,
    slopes: Mapping[str, float] | None = None,
) -> BoundCell:
    """A cell with what correction and tests gave."""
    if bound.kind == Turn.END:
        return replace(cell, finding=Finding.BEYOND, message=Finding.BEYOND.sentence)
    # What describing functions know besides, of cycles beyond the bound, say, holds whatever the tests give.
    note = cell.message.removeprefix(cell.finding.sentence).strip()
    if bound.cycle is None:
        why = bound.message.removesuffix(".")
        if cell.finding is not Finding.BOUND:
            # That cycles go on to the end of the range is then the describing functions' word alone.
            failed = Finding.FAILED
            return replace(cell, finding=failed, message=f"{failed.sentence} {note} Tried: {why}.".replace("  ", " "))
        return replace(cell, message=f"{note} Not corrected: {why}. Not verified.".strip())
    if cell.finding is not Finding.BOUND:
        # Describing functions saw the family go on to the end of the range, or saw nothing.
        cell = replace(cell, finding=Finding.BOUND)
    cell = replace(
        cell,
        exact=bound.value,
        kind=bound.kind,
        frequency=1.0 / bound.period,
        elasticities={} if slopes is None else slopes,
        orbit=bound.cycle,
    )
    if test is None:
        return replace(cell, message=f"{note} {UNTESTED}".strip())
    facts: dict[str, Any] = {
        "safe_value": test.safe_value,
        "other_value": test.other_value,
        "n_runs": test.n_runs,
        "n_settled": test.n_settled,
        "n_cycles": len(test.cycles),
        "other_orbit": test.orbit,
        "verified": test.verified,
    }
    slow = not test.cycles and test.n_settled < test.n_runs
    remark = f"Not verified: {test.message}." + _SLOW * slow
    return replace(cell, message=(note if test.verified else f"{note} {remark}").strip(), **facts)
