"""Design guidelines for any two parameters of any case: how far one may go at each value of the other, by variant.

The bounds are those of :func:`design_bounds`, exact and tested where the loop allows it; here they meet variants,
margins and tolerances, and what the case's own run does beyond them.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, ParamSpec, TypeVar

from eppanalysis.arguments import check_counts
from eppanalysis.cases import Case, as_case, variation_of
from eppanalysis.errors import ArgumentError, EppError
from eppanalysis.guides.beyond import OwnRuns, own_runs, smallest_trigger
from eppanalysis.guides.result import GAIN, LIMIT, Guide, GuideRow
from eppanalysis.methods.bounds.balanced import BalancedSweep, BoundProblem, value_of
from eppanalysis.methods.bounds.design import Settings, bound_of_branch, design_bounds, range_within
from eppanalysis.methods.bounds.proved import with_proofs
from eppanalysis.methods.bounds.result import BoundCell
from eppanalysis.methods.bounds.searched import why_by_search
from eppanalysis.methods.bounds.sizes.allowed import Allowed
from eppanalysis.methods.bounds.tolerances.bound import check_tolerances, tolerance_bound
from eppanalysis.methods.bounds.tolerances.result import ToleranceBound
from eppanalysis.methods.continuation.own_states import in_own_states
from eppanalysis.methods.continuation.result import Branch
from eppanalysis.methods.search.trigger import Trigger
from eppanalysis.models.systems.subject import require_case
from eppanalysis.progress import Progress
from eppanalysis.results.provenance import Provenance
from eppanalysis.workers import workers as worker_processes

__all__ = ["Guide", "GuideRow", "design_guide"]

P = ParamSpec("P")
T = TypeVar("T")
_Beyond = Callable[[], tuple[OwnRuns, Trigger | None]]
_NAN = math.nan
#: Where a parameter runs that nothing is said of, relative to the case's own value.
_RUN = (0.5, 1.0, 2.0)


def design_guide(
    case: Case,
    gains: Sequence[object] | None = None,
    *,
    over: str | None = None,
    limit: str | None = None,
    variants: Mapping[str, Sequence[object]] | None = None,
    tolerances: Mapping[str, object] | None = None,
    margins: Mapping[str, float] | None = None,
    within: tuple[object, object] | None = None,
    allow: str | None = None,
    samples: int = 400,
    starts: int = 1000,
    workers: int = 1,
    seed: int = 20050901,
    branch: Branch | None = None,
    prove: bool = False,
    progress: Progress | None = None,
) -> Guide:
    """Guidelines: how far one parameter may go at each value of another, for all combinations of further parameters.

    Parameters
    ----------
    case : Case
    gains : sequence of quantity, optional
        Values of `over`; half, once and twice the case's own by default.
    over, limit : str, optional
        The parameter that runs, and the one that is bounded; of an elbow its gain (the profile range, "bands.range")
        and its backlash ("lock_pin.backlash") by default. Other cases have no default.
    variants : mapping of str to sequence of quantity, optional
        Values of parameters such as "cable.stiffness", "forearm.prehensor_mass", "pulley.friction"; every combination
        is a variant. By default the case as it is.
    tolerances : mapping of str to quantity or percentage, optional
        Adds the columns for the worst case and for 95 and 99 % of all machines. Those that the case carries are used
        where none are given; where it carries none, no columns are added.
    margins : mapping of str to float, optional
        Factor by which the limited parameter must stay on the safe side of its bound; over "bands.range" also the
        factor by which the gain may still rise (the range shrink).
    within : (quantity, quantity), optional
        Range in which the bound is sought; a twentieth to twice the case's own value by default.
    allow : str, optional
        A limit cycle that is allowed, as :func:`design_bounds` takes it ("theta 0.3 deg"): each bound is then where the
        largest stable cycle becomes larger. Bounds under tolerances, proofs and a known branch are of cycles of any
        size.
    samples : int
        Draws for the probabilities.
    starts : int
        Runs that test each bound.
    workers : int
        Processes.
    seed : int
        Of runs and draws: the same seed, the same numbers.
    branch : Branch, optional
        Exact cycles of this case over the limited parameter, where they are known already. The end of the branch is
        then put to the test in place of a bound that is searched for, in a fraction of the time and without the
        value of the describing function. Where the branch has no end, the bound is sought as without it. For the case's
        own gain only.
    prove : bool
        Prove what can be proved on both sides of every bound, as :func:`design_bounds` does; needs the extra "proof".
    progress : callable, optional
        Called with the number of rows done, the number of all rows, and an empty text.

    Returns
    -------
    Guide

    Raises
    ------
    EppError
        If two parameters are not named where the case has no usual ones, or a value is not valid.

    Examples
    --------
    >>> import eppanalysis as epp
    >>> case = epp.case("wheelchair")
    >>> guide = epp.design_guide(
    ...     case, ["12 mm"], over="play.gap", limit="loop.gain", starts=20
    ... )
    >>> guide.sentences()[0]
    'At a play gap of 12 mm keep loop gain under 0.83 (exact 0.8462).
    This case has 1: its own run ends in an oscillation.'

    How much play may a servo have whose output may move by 0.5?

    >>> servo = epp.case("backlash_servo")
    >>> guide = epp.design_guide(
    ...     servo, [1.0], over="loop.gain", limit="play.gap", allow="x 0.5", starts=20
    ... )
    >>> print(guide)
    Keep play gap under 0.250 (exact 0.2551), at a loop gain of 1, with x 0.5
    peak to peak allowed; verified.
    """
    case = as_case(case)
    require_case(case, "design_guide")
    over, limit = pair_of(case, over, limit)
    if gains is not None and not len(gains):
        raise EppError(f"guide: no value of {over} is given; expected one or more.")
    ranges = [case.si(over, g) for g in gains] if gains is not None else [share * case.value(over) for share in _RUN]
    given = dict(margins or {})
    _check_margins(given, over, limit)
    _check_branch(case, (over, limit), ranges, branch, by_own_gain=not variants and given.get(over, 1.0) == 1.0)
    allowed = _allowed(case, allow, {"tolerances": tolerances, "branch": branch, "prove": prove or None})
    counts = {"samples": (samples, 0), "starts": (starts, 1), "workers": (workers, 1), "seed": (seed, 0)}
    check_counts("guide", counts)
    combinations = _combinations(variants or {}, over, limit)
    tests = (samples, starts, workers, seed, branch, prove)
    work = _Work(over, limit, ranges, given, tolerances, within, *tests, allow, allowed)
    for combination in combinations:
        work.check(case.with_values(combination) if combination else case)
    rows, said = work.all_rows(case, combinations, progress)
    settings: dict[str, Any] = {
        "over": over,
        "limit": limit,
        "gains": ranges,
        "variants": {k: [str(v) for v in vs] for k, vs in (variants or {}).items()},
    }
    settings |= {"margins": given, "samples": samples, "starts": starts, "seed": seed}
    settings |= {"tolerances": {name: str(width) for name, width in tolerances.items()}} if tolerances else {}
    settings |= {} if allowed is None else {"allowed": allowed.to_dict()}
    made_by = Provenance("design guide", settings, case=case.provenance())
    return Guide(case, over, limit, tuple(variants or {}), tuple(rows), given, said, allowed, provenance=made_by)


def _combinations(variants: Mapping[str, Sequence[object]], over: str, limit: str) -> list[dict[str, object]]:
    """Values of the parameters that make the variants, each combination by name."""
    clash = next((name for name in variants if name in (over, limit)), None)
    if clash is not None:
        raise EppError(f"guide: {clash} makes variants and is {over} or {limit} as well; expected another parameter.")
    return [dict(zip(variants, values, strict=True)) for values in itertools.product(*variants.values())]


def pair_of(case: Case, over: str | None, limit: str | None) -> tuple[str, str]:
    """The parameter that runs and the one that is bounded: as given, or as guidelines of such a case usually are.

    Raises
    ------
    EppError
        If one is not given and the case has no usual one, they are the same, or the case does not know them.
    """
    usual = variation_of(case).guided
    lacking = next((name for name, given in (("over", over), ("limit", limit)) if given is None), None)
    if usual is None and lacking is not None:
        names = [name for name in variation_of(case).axes() if name not in (over, limit)]
        such = f", such as {' or '.join(names)}" if names else ""
        said = f" is not given, and guidelines of {case.name} have no usual one; expected a parameter{such}."
        raise ArgumentError(lacking, said, "guide")
    first, second = usual or ("", "")
    chosen = over or first, limit or second
    if chosen[0] == chosen[1]:
        raise EppError(f"guide: {chosen[0]} is to run and to be bounded; expected two different parameters.")
    for name in chosen:
        case.unit(name)
    return chosen


def _allowed(case: Case, allow: str | None, beside: Mapping[str, object]) -> Allowed | None:
    """What is allowed; nothing may be given beside it that is of cycles of any size."""
    if allow is None:
        return None
    for name, given in beside.items():
        if given is not None:
            raise EppError(
                f"guide: {name} is given beside allow; expected one of them, as it is of cycles of any size."
            )
    return Allowed.read(case.to_system(), allow)


def _check_margins(margins: Mapping[str, float], over: str, limit: str) -> None:
    """Which side of a parameter is the worse one is known of the limit, and of an elbow's gain."""
    known = (GAIN, limit) if over == GAIN else (limit,)
    for name, factor in margins.items():
        if name not in known or not (math.isfinite(factor) and factor >= 1.0):
            places = " or ".join(known)
            raise EppError(f"guide: the margin of {name} is {factor}; expected a factor of 1 or more on {places}.")


def _check_branch(
    case: Case, pair: tuple[str, str], ranges: Sequence[float], branch: Branch | None, *, by_own_gain: bool
) -> None:
    """A branch answers for one loop."""
    if branch is None:
        return
    over, limit = pair
    if branch.parameter != limit:
        raise EppError(f"guide: the branch runs over {branch.parameter}; expected one over {limit}.")
    if not by_own_gain or list(ranges) != [case.value(over)]:
        raise EppError(
            f"guide: the branch is of the gain {case.text(over, case.value(over))}; expected that gain alone, "
            "no variants, and no margin on the gain."
        )


@dataclass(frozen=True)
class _Work:
    """The settings of a guide."""

    over: str
    limit: str
    ranges: list[float]
    margins: dict[str, float]
    tolerances: Mapping[str, object] | None
    within: tuple[object, object] | None
    samples: int
    starts: int
    workers: int
    seed: int
    branch: Branch | None
    prove: bool
    allow: str | None
    allowed: Allowed | None

    def all_rows(
        self, case: Case, combinations: Sequence[Mapping[str, object]], progress: Progress | None
    ) -> tuple[list[GuideRow], str]:
        """The rows of all variants, and in sentences what bounds of sampled loops do not cover."""
        rows: list[tuple[GuideRow, _Beyond]] = []
        open_ends: dict[str, None] = {}
        each = 1 + self.is_under_tolerances(case)  # a row's bound, and that under its tolerances
        total = each * len(self.ranges) * len(combinations)
        # All variants share the programmes and the processes. The end of a branch that is known takes none.
        with worker_processes(self.workers if self.branch is None else 1) as pool:
            sweep = BalancedSweep(self.question(case), pool)
            for combination in combinations:
                done = each * len(rows)

                def advance(count: int, of: int | None, doing: str, done: int = done) -> None:
                    if progress is not None:
                        progress(done + count, total, doing)

                here = case.with_values(combination) if combination else case
                found, not_covered = self.rows(here, tuple(combination), sweep, advance)
                rows += found
                open_ends[not_covered] = None
            return [_with_runs(row, *beyond()) for row, beyond in rows], " ".join(text for text in open_ends if text)

    def check(self, case: Case) -> None:
        """Refuse tolerances that one variant cannot have, before anything is computed."""
        if not self.is_under_tolerances(case):
            return
        for gain in self.ranges:
            check_tolerances(self.question(case.with_values({self.over: gain})), self.tolerances)

    def is_under_tolerances(self, case: Case) -> bool:
        """Whether rows have a bound under tolerances, those given or those that the case carries."""
        carried = any(p.tolerance for p in case.parameters.values())
        return self.allowed is None and (self.tolerances is not None or carried)

    def question(self, case: Case) -> BoundProblem:
        """The settings of a variant."""
        return BoundProblem(in_own_states(case), self.limit, *range_within(case, self.limit, self.within))

    def rows(
        self, case: Case, varied: tuple[str, ...], sweep: BalancedSweep, advance: Progress
    ) -> tuple[list[tuple[GuideRow, _Beyond]], str]:
        """Rows of one variant, each with what is computed beyond its bound, and what they do not cover."""
        known = self._known(case)
        if known is not None:
            question, cell = known
            row = self._row(case, varied, cell.value, cell, BalancedSweep(question), partial(advance, 1, None))
            advance(1, 1, "")
            return [row], ""
        # A margin on the gain needs the bound of a loop whose gain is larger by it.
        worse = [gain / self.margins.get(self.over, 1.0) for gain in self.ranges]
        bounds = design_bounds(
            case,
            self.over,
            self.limit,
            at=worse,
            within=self.within,
            allow=self.allow,
            starts=self.starts,
            seed=self.seed,
            workers=self.workers,
            prove=self.prove,
            sweep=sweep,
            progress=advance,
        )
        rows = [
            self._row(case, varied, gain, cell, sweep, partial(advance, len(self.ranges) + k, None))
            for k, (gain, cell) in enumerate(zip(self.ranges, bounds, strict=True))
        ]
        return rows, bounds.not_covered

    def _known(self, case: Case) -> tuple[BoundProblem, BoundCell] | None:
        """The bound at the end of the branch that was given, tested; None where it has no end."""
        if self.branch is None:
            return None
        question = self.question(case)
        settings = Settings(starts=self.starts, seed=self.seed)
        cell = bound_of_branch(question, self.ranges[0], self.branch, settings)
        if cell is None:
            return None
        return question, with_proofs(replace(question, case=case), cell) if self.prove else cell

    def _row(
        self,
        case: Case,
        varied: tuple[str, ...],
        gain: float,
        cell: BoundCell,
        sweep: BalancedSweep,
        tell: Callable[[str], None],
    ) -> tuple[GuideRow, _Beyond]:
        within = sweep.question.low, sweep.question.high
        here = case.with_values({self.over: gain})
        own, bound = value_of(here, self.limit), cell.bound
        own = _NAN if own is None else own
        factor = self.margins.get(self.limit, 1.0)
        allowed = bound / factor if cell.sign > 0 else bound * factor
        tolerance, missing = None, ""
        beyond: _Beyond = _nothing
        if math.isfinite(bound):
            beyond = _submitted(sweep.pool, _beyond, here, self.limit, within, own, (bound, cell.sign), self.allowed)
            try:
                tolerance = self._tolerance(here.with_values({self.over: cell.value}), sweep, tell)
            except EppError as error:
                missing = str(error).rstrip(".")
        radius, stiffness = _NAN, _NAN
        if self.limit == LIMIT:
            radius, stiffness = case.value("pulley.radius"), case.value("cable.stiffness")
        row = GuideRow(
            values={self.over: gain, **{name: case.value(name) for name in varied}},
            cell=cell,
            allowed=allowed,
            pulley=radius * allowed,
            force=stiffness * radius * allowed,
            tolerance=tolerance,
            from_rest=_NAN,
            own=own,
            trigger=_NAN,
            missing=missing,
        )
        return row, beyond

    def _tolerance(self, case: Case, sweep: BalancedSweep, tell: Callable[[str], None]) -> ToleranceBound | None:
        carried = any(p.tolerance for p in case.parameters.values())
        if self.tolerances is None and not carried:
            return None
        if self.allowed is not None:
            raise EppError("it is computed for cycles of any size alone.")
        return tolerance_bound(
            case,
            self.limit,
            self.tolerances,
            within=(sweep.question.low, sweep.question.high),
            samples=self.samples,
            seed=self.seed,
            threads=self.workers,
            sweep=sweep,
            progress=lambda done, of, doing: tell(f"tolerances: {doing}"),
        )


def _submitted(pool: Executor | None, function: Callable[P, T], *args: P.args, **kwargs: P.kwargs) -> Callable[[], T]:
    """What a function gives: of processes, where there are some, which go on meanwhile, else at once."""
    if pool is not None:
        return pool.submit(function, *args, **kwargs).result
    found = function(*args, **kwargs)
    return lambda: found


def _nothing() -> tuple[OwnRuns, Trigger | None]:
    """What is known beyond a bound where there is none."""
    return OwnRuns(), None


def _with_runs(row: GuideRow, runs: OwnRuns, hit: Trigger | None) -> GuideRow:
    """A row with what the case's own run does beyond its bound."""
    trigger, struck = (_NAN, "") if hit is None else (hit.size, hit.name)
    return replace(row, from_rest=runs.oscillates_from, rests_to=runs.rests_to, trigger=trigger, struck=struck)


def _beyond(
    case: Case,
    limit: str,
    within: tuple[float, float],
    own: float,
    beside: tuple[float, float],
    allowed: Allowed | None,
) -> tuple[OwnRuns, Trigger | None]:
    """What the case's own run does beyond a bound, and the smallest step that starts a cycle at the case's own value.

    Both of cycles that are larger than allowed, where a size is.

    Neither is computed where the bound is that of a search, and what it does not cover is said with it.

    Parameters
    ----------
    beside : (float, {1, -1})
        The bound [SI], and 1 where cycles exist above it.
    """
    bound, sign = beside
    if why_by_search(case.to_system()):
        return OwnRuns(), None
    low, high = within
    if math.isfinite(own):
        # The range of the bound may end before the case's own value, of which it is to be said what it does.
        low, high = (low, max(high, 2.0 * own)) if sign > 0 else (min(low, 0.5 * own), high)
    question = BoundProblem(in_own_states(case), limit, low, high)
    hit = smallest_trigger(question, own, allowed) if sign * (own - bound) > 0 else None
    try:
        return own_runs(question, bound, sign, allowed), hit
    except EppError:
        return OwnRuns(), hit
