"""Curves of folds: where in the plane of two parameters a stable and an unstable limit cycle are born together."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from eppanalysis.arguments import check_counts, checked
from eppanalysis.arrays import Array
from eppanalysis.errors import EppError
from eppanalysis.methods.continuation.branch import Continuation, continue_branch
from eppanalysis.methods.continuation.families import Family
from eppanalysis.methods.continuation.own_states import OwnStates
from eppanalysis.methods.continuation.seeds import steady_case
from eppanalysis.methods.continuation.steps import (
    BranchPoint,
    admissible,
    make_point,
    other_sequence,
    point_across,
    step,
)
from eppanalysis.methods.orbits.cycle import to_limit_cycle
from eppanalysis.methods.simulation.stability import is_stable
from eppanalysis.models.systems.lure import LureSystem
from eppanalysis.models.systems.subject import CaseLike, facts_of, require_case, require_continuous
from eppanalysis.readable import count, span, words
from eppanalysis.results import LimitCycle, Result, Status
from eppanalysis.results.provenance import Provenance
from eppanalysis.shown import frame_of

if TYPE_CHECKING:
    import pandas
    from matplotlib.axes import Axes

#: Into how many steps a way along a curve of folds is divided at most before a branch is followed instead.
_FEW = 8
#: How far aside of a fold a branch begins, relative to the parameter there, and most orbits on the way.
_ASIDE = (0.1, 0.3, 0.8)
_MOST_ASIDE = 60
#: Rate of the parameter along the branch that is none, and that rounding may leave.
_TURNED, _ROUNDED = 1e-11, 1e-9
#: Steps of a secant method to where it is none, and the longest.
_MOST_STEPS, _LONGEST = 20, 0.1


@dataclass(frozen=True, eq=False, repr=False)
class FoldCurve(Result):
    """Folds of limit cycles, followed over two parameters.

    Attributes
    ----------
    parameters : (str, str)
        The one in which the cycles fold, and the one that runs.
    values : array, shape (k, 2)
        Both at each fold [SI].
    period : array, shape (k,)
        Of the cycle there [s].
    multiplier : array, shape (k,)
        Its largest Floquet multiplier, which is 1 but for rounding.
    status : Status
        CONVERGED where it covers all given values.
    message : str
        How the curve ended.
    units : dict of str to str
        SI units of both parameters.
    readable : dict of str to (str, float)
        The units that people use for them, and the factors from SI to these.
    operating_point : OperatingPoint or None
        Where the case holds the external inputs, as for a :class:`Branch`.
    """

    parameters: tuple[str, str]
    values: Array
    period: Array
    multiplier: Array
    status: Status
    message: str
    units: dict[str, str] = field(default_factory=dict)
    readable: dict[str, tuple[str, float]] = field(default_factory=dict)

    in_json = "parameters values period multiplier status message operating_point provenance"

    def __str__(self) -> str:
        """Over which values the fold is known, and how the curve ended."""
        folds, runs = (
            f"{words(name)} {span(values, self.units.get(name, ''), self.readable.get(name))}"
            for name, values in zip(self.parameters, self.values.T, strict=True)
        )
        return f"{count(len(self.values), 'fold')}: {folds}, for {runs}. {self.message}"

    def to_frame(self) -> pandas.DataFrame:
        """The folds, one a row: both parameters, period [s], largest Floquet multiplier."""
        rows = [
            {**dict(zip(self.parameters, pair, strict=True)), "period": period, "multiplier": multiplier}
            for pair, period, multiplier in zip(
                self.values.tolist(), self.period.tolist(), self.multiplier.tolist(), strict=True
            )
        ]
        return frame_of(rows, {**self.units, "period": "s"}, self.readable)

    @checked
    def plot(self, ax: Axes | None = None) -> Axes:
        """The curve of folds in the plane of the two parameters."""
        return self.drawn("plot_folds", ax)


def continue_folds(
    case: CaseLike | LureSystem,
    parameter: str,
    other: str,
    limits: tuple[object, object],
    over: tuple[object, object],
    *,
    cycle: LimitCycle | None = None,
    n_points: int = 21,
) -> FoldCurve:
    """The fold in `parameter` at each of a row of values of `other`.

    Parameters
    ----------
    case : Case or LureSystem
    parameter, other : str
        Dotted names: the parameter in which the cycles fold, and the one that runs.
    limits : (quantity, quantity)
        Range of `parameter` in which the first fold is looked for, and the curve followed.
    over : (quantity, quantity)
        Values of `other` from the first to the last.
    cycle : LimitCycle, optional
        A cycle at the first of `limits` and of `over`.
    n_points : int
        Number of values of `other`.

    Returns
    -------
    FoldCurve
        Ends early, with status NOT_CONVERGED, where the curve of folds does (a cusp, or a change of sequence).

    Raises
    ------
    EppError
        If there is no fold at the first value of `other`.

    Examples
    --------
    >>> import eppanalysis as epp
    >>> case = epp.case("relay_deadzone")
    >>> curve = epp.continue_folds(
    ...     case,
    ...     "relay_dead_zone.threshold",
    ...     "loop.gain",
    ...     (1.0, 3.0),
    ...     (1.0, 1.1),
    ...     n_points=2,
    ... )
    >>> curve.values.round(3).tolist()
    [[1.663, 1.0], [1.829, 1.1]]
    """
    case = require_case(case, "continue_folds")
    require_continuous(case.to_system(), "continue_folds")
    check_counts("continue_folds", {"n_points": (n_points, 1)})
    rows = np.linspace(case.si(other, over[0]), case.si(other, over[1]), n_points)
    low, high = sorted(case.si(parameter, v) for v in limits)
    at = case.operating_point
    if (own := OwnStates.of(case)) is not None:
        case, cycle = own.from_user(cycle)
    first = case.with_values({other: float(rows[0])})
    branch = continue_branch(first, parameter, limits[0], limits[1], cycle=cycle)
    if not branch.folds:
        raise EppError(
            f"continue_folds: the branch over {parameter} has no fold at {other} = {case.text(other, rows[0])}."
        )
    walk = _FoldWalk(case, parameter, other, (low, high))
    found = [fold.point for fold in branch.folds[:1] if fold.point is not None]
    message = "The curve covers all given values."
    for here, value in zip(rows, rows[1:], strict=False):
        new = walk.reach(found[-1], float(here), float(value))
        if new is None:
            where = f"{words(other)} = {case.text(other, value)}"
            message = f"The curve ends before {where}: no fold continues it within the limits."
            break
        found.append(new)
    return FoldCurve(
        parameters=(parameter, other),
        values=np.column_stack([[p.value for p in found], rows[: len(found)]]),
        period=np.array([p.orbit.period for p in found]),
        multiplier=np.array([float(np.max(np.abs(p.multipliers))) for p in found]),
        status=Status.CONVERGED if len(found) == rows.size else Status.NOT_CONVERGED,
        message=message,
        units={name: case.unit(name)[0] for name in (parameter, other)},
        readable={name: case.readable(name) for name in (parameter, other)},
        provenance=Provenance("fold curve", {"limits": (low, high), "over": rows.tolist()}, case=facts_of(case)),
        operating_point=at,
    )


@dataclass
class _FoldWalk:
    """A curve of folds under way; lives for one call."""

    case: CaseLike
    parameter: str
    other: str
    limits: tuple[float, float]
    slope: float = 0.0
    drift: Array | None = None

    def family(self, value: float, near: float) -> Family:
        """The systems over `parameter`, around `near`, at a value of `other`."""
        case, reach = self.case.with_values({self.other: value}), 0.05 * abs(near)
        window = max(near - reach, self.limits[0]), min(near + reach, self.limits[1])
        return Family(lambda v: steady_case(case.with_values({self.parameter: v})), self.limits, window)

    def reach(self, fold: BranchPoint, here: float, there: float) -> BranchPoint | None:
        """The fold at another value of `other`: in a few steps along the curve, else by a branch at that value."""
        at, d = here, there - here
        begin = fold
        while abs(there - at) > 1e-12 * abs(there - here):
            d = there - at if abs(d) > abs(there - at) else d
            # Beside a grazing contact steps fail however short they are; a branch at the new value still leads to the
            # fold (docs/theory/exact_orbits.md, Branches).
            new = self._next(fold, self.family(at + d, fold.value + self.slope * d), d)
            if new is None:
                d *= 0.5
                if abs(d) < abs(there - here) / _FEW:
                    return self._by_branch(begin, here, there)
                continue
            self._remember(fold, new, d)
            fold, at, d = new, at + d, 1.5 * d
        return fold

    def _remember(self, old: BranchPoint, new: BranchPoint, d: float) -> None:
        """How the fold and its orbit move with `other`, as a secant for the next one."""
        self.slope = (new.value - old.value) / d
        same = old.orbit.arcs.event_sequence.key == new.orbit.arcs.event_sequence.key
        self.drift = (new.unknowns - old.unknowns) / d if same else None

    def _next(self, fold: BranchPoint, family: Family, d: float) -> BranchPoint | None:
        """The fold in a neighbouring family, from the last one."""
        u = fold.unknowns + (0.0 if self.drift is None or self.drift.size != fold.unknowns.size else d * self.drift)
        u[-1] = fold.value + self.slope * d
        found = fold_in(family, fold, u)
        return found if found is not None and self.limits[0] <= found.value <= self.limits[1] else None

    def _by_branch(self, fold: BranchPoint, here: float, there: float) -> BranchPoint | None:
        """The fold on a branch that begins aside of the last one, on its stable side, at the new value of `other`."""
        foretold = fold.value + self.slope * (there - here)
        for share in _ASIDE:
            distance = abs(foretold - fold.value) + share * abs(fold.value)
            aside = _aside(self.case.with_values({self.other: here}), self.parameter, fold, distance)
            folds = [] if aside is None else self._folds_from(aside, fold.value < aside.value, here, there)
            if folds:
                new = min(folds, key=lambda p: abs(p.value - foretold))
                self.slope, self.drift = (new.value - fold.value) / (there - here), None
                return new
        return None

    def _folds_from(self, aside: BranchPoint, outward: bool, here: float, there: float) -> list[BranchPoint]:
        """Folds of the branch at the new value of `other` that begins at an orbit of the old one."""
        system = self.case.with_values({self.other: here, self.parameter: aside.value}).to_system()
        # Of another loop, it may be farther from the one here than by any error.
        cycle = replace(to_limit_cycle(system, aside.orbit), error_estimate=float("inf"))
        limit = self.limits[0 if outward else 1]
        case = self.case.with_values({self.other: there})
        try:
            branch = continue_branch(case, self.parameter, aside.value, limit, cycle=cycle, n_points=100)
        except EppError:
            return []
        return [s.point for s in branch.folds if s.point is not None]


def _aside(case: CaseLike, parameter: str, fold: BranchPoint, distance: float) -> BranchPoint | None:
    """The last stable orbit, at most so far in the parameter, on one of the two branches that meet in a fold.

    A fold may lie where its unstable branch ends; there rounding may call a cycle stable, so the farther one counts.
    """
    limits = fold.value - distance, fold.value + distance
    family = Family(lambda v: steady_case(case.with_values({parameter: v})), limits)
    last = []
    for tangent in (fold.tangent, -fold.tangent):
        begin = make_point(family, fold.value, fold.orbit, tangent)
        points, _ = Continuation(case, parameter, family, limits, _MOST_ASIDE, 0.05).along(begin, _MOST_ASIDE)
        last += [p for p in points[1:] if is_stable(p.multipliers)][-1:]
    return max(last, key=lambda p: abs(p.value - fold.value), default=None)


def fold_in(family: Family, near: BranchPoint, u: Array) -> BranchPoint | None:
    """The fold of a family of cycles that a fold in a neighbouring one leads to; None where Newton is led nowhere.

    Parameters
    ----------
    family : Family
        The systems over the parameter in which the cycles fold.
    near : Point
        The fold of the neighbouring family.
    u : array, shape (m + p + 1,)
        Unknowns from which to begin.
    """
    moved = point_across(replace(near, family=family, before=None), u)
    for _ in range(4):
        new = None if moved is None else _fold_near(moved)
        if new is None or moved is None:
            return None
        if admissible(new):
            return new
        # The fold of a sequence that the engine does not meet: that of the one that it does meet is computed.
        moved, _ = other_sequence(moved, new)
    return None


def _fold_near(point: BranchPoint) -> BranchPoint | None:
    """Secant steps along the branch to where the parameter turns."""
    here, ds = point, 1e-3
    for _ in range(_MOST_STEPS):
        if abs(here.turn) < _TURNED:
            return here
        new = step(here, ds)
        if new is None:
            ds *= 0.3
            continue
        rate = (new.turn - here.turn) / ds
        if abs(here.turn) < _ROUNDED and abs(new.turn) >= abs(here.turn):
            return here
        if rate == 0.0:
            break
        # A secant through two nearly equal values leads anywhere: no step beyond a share of the branch.
        here, ds = new, float(np.clip(-new.turn / rate, -_LONGEST, _LONGEST))
    return here if abs(here.turn) < _ROUNDED else None
