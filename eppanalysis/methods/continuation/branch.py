"""Branches of exact orbits over a parameter of a case: pseudo-arclength through folds and changes of event sequence."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace

import numpy as np

from eppanalysis.arguments import check_counts
from eppanalysis.arrays import Array
from eppanalysis.errors import EppError
from eppanalysis.methods.continuation.borders import across, border_collision, borders, shown_at, visit_ends
from eppanalysis.methods.continuation.cover import Gap, gaps
from eppanalysis.methods.continuation.doubling import doubled, half_alike
from eppanalysis.methods.continuation.families import Family
from eppanalysis.methods.continuation.labels import (
    STANDS,
    crossing,
    departure,
    difference,
    ending,
    in_words,
    linear_arc,
    standstill,
)
from eppanalysis.methods.continuation.own_states import OwnStates
from eppanalysis.methods.continuation.ranges import signal_sizes
from eppanalysis.methods.continuation.result import Branch, SpecialPoint
from eppanalysis.methods.continuation.sampled import sampled_branch
from eppanalysis.methods.continuation.seeds import orbits_found, refused, seed, steady_case
from eppanalysis.methods.continuation.steps import (
    LEAST_STEP,
    BranchPoint,
    admissible,
    astray,
    bend,
    beyond,
    last_admissible,
    locate,
    make_point,
    other_sequence,
    point_at,
    regular,
    step,
)
from eppanalysis.methods.orbits.cycle import to_limit_cycle
from eppanalysis.methods.orbits.orbit import Orbit
from eppanalysis.methods.orbits.shooting import same_orbit
from eppanalysis.methods.search.simulate import simulate
from eppanalysis.methods.simulation.stability import is_stable
from eppanalysis.methods.steady.changes import Change
from eppanalysis.models.systems.lure import LureSystem
from eppanalysis.models.systems.sampled.strobe import is_sampled
from eppanalysis.models.systems.subject import CaseLike, facts_of, require_case
from eppanalysis.progress import Progress
from eppanalysis.results import LimitCycle, Status
from eppanalysis.results.provenance import Provenance

#: What is added to the reason of a gap in which other cycles were searched for, and where all were such.
_SOUGHT = "an exact search in this part found no cycle that leads on through it"
_MANY = "an exact search in this part found cycles, which are a continuum"
#: What is where an element begins to hold its value.
_HELD = "each cycle from here on is one of a continuum: no switch renews what an element holds"


def continue_branch(
    case: CaseLike | LureSystem,
    parameter: str,
    start: object,
    stop: object,
    *,
    cycle: LimitCycle | None = None,
    origin: SpecialPoint | None = None,
    n_points: int = 200,
    max_step: float = 0.02,
    n_simulated: int = 0,
    n_others: int = 3,
    progress: Progress | None = None,
) -> Branch:
    """The branch of exact limit cycles over a parameter, stable and unstable, through its folds.

    Where it covers a part of the range only, and has not turned back, cycles are searched for in the rest, and their
    branches followed too.

    Parameters
    ----------
    case : Case or LureSystem
        With sampled controllers a cycle that is locked to the samples is followed at its number of samples until it
        ceases to exist, and on with the neighbouring number; one that is not locked is followed by runs. What that
        does not cover is in `Branch.not_covered`.
    parameter : str
        Dotted name of the field.
    start, stop : str or number
        Range of the parameter (plain numbers are SI).
    cycle : LimitCycle, optional
        Exact or predicted cycle at `start` from which the branch begins. By default the cycle on which the case's run
        ends there, or at `stop`, or any cycle found at `stop` or `start`.
    origin : SpecialPoint, optional
        A period doubling of another branch over this parameter: the branch of cycles of twice the period begins there.
    n_points : int
        At most so many orbits.
    max_step : float
        Longest step along the branch, relative to the parameter's range and the motion's size.
    n_simulated : int
        Number of values, evenly over the range, at which the case is simulated for comparison.
    n_others : int
        At most so many branches besides; none where `cycle` or `origin` says which branch is wanted.
    progress : callable, optional
        Called with the number of points so far, None, and what is being done in words; of sampled loops alone.

    Returns
    -------
    Branch

    Raises
    ------
    EppError
        If no limit cycle is found at either end, the range is empty, or no cycle of twice the period leaves at
        `origin`.

    Examples
    --------
    >>> import eppanalysis as epp
    >>> case = epp.case("relay_deadzone")
    >>> branch = epp.continue_branch(case, "relay_dead_zone.threshold", 1.0, 3.0)
    >>> print(f"The cycles vanish at a threshold of {branch.folds[0].value:.3f}.")
    The cycles vanish at a threshold of 1.663.
    """
    case = require_case(case, "continue_branch")
    check_counts(
        "continue_branch", {"n_points": (n_points, 1), "n_simulated": (n_simulated, 0), "n_others": (n_others, 0)}
    )
    if not 0.0 < max_step <= 1.0:
        raise EppError(f"continue_branch: max_step is {max_step}; expected more than 0 and 1 at most.")
    first, last = case.si(parameter, start), case.si(parameter, stop)
    if not first != last:
        raise EppError(f"continue_branch: {parameter} runs from {start} to {stop}; expected two different values.")
    limits = min(first, last), max(first, last)
    if (own := OwnStates.of(case)) is not None:
        case, cycle = own.from_user(cycle)
    family = Family(lambda value: steady_case(case.with_values({parameter: value})), limits)
    walk = Continuation(case, parameter, family, limits, n_points, max_step)
    if origin is not None and origin.point is None:
        raise EppError("continue_branch: cycles of doubled period are not followed in a loop with sampled controllers.")
    others = n_others if cycle is None and origin is None else 0
    if is_sampled(case.to_system().elements):
        branch = sampled_branch(case, parameter, (first, last), cycle, (n_points, max_step, others), progress)
    elif origin is None or origin.point is None:
        value, orbit = seed(case, parameter, family, (first, last), cycle)
        if orbit.motion is not None:
            raise EppError(
                "continue_branch: cycles are not followed where a delayed signal moves between switches; expected a "
                "dead time behind an element that switches, with at most blocks between them that feed nothing else "
                "and that no signal names. find_limit_cycles finds them at one value."
            )
        branch = walk.run((value, orbit))
    else:
        branch = walk.run_off(doubled(family, origin.point, 0.25 * max_step))
    if not branch.not_covered:
        branch = _with_others(walk, branch, others)
    if n_simulated > 0:
        branch = replace(branch, simulated=_simulated(case, parameter, np.linspace(*limits, n_simulated)))
    return branch if own is None else own.to_user(branch)


def _with_others(walk: Continuation, branch: Branch, most: int) -> Branch:
    """The branch, with those of cycles found in what it does not cover, and what even these leave."""
    others: list[Branch] = []
    tried: dict[float, str] = {}  # what was found where nothing leads on
    while len(others) < most:
        left = [v for g in _gaps(walk, branch, others) for v in _places(walk, g) if v not in tried]
        if not left:
            break
        found = _branch_from(walk, left[0])
        tried[left[0]] = _SOUGHT if found is None else _MANY if len(found) == 1 else ""
        if found is not None and len(found) > 1:
            others.append(found)
    missing = tuple(
        replace(g, why="; ".join(dict.fromkeys([g.why, *(w for v, w in tried.items() if w and g.low <= v <= g.high)])))
        for g in _gaps(walk, branch, others)
    )
    part = " Together they cover" if others else " It covers"
    message = branch.message + (f"{part} a part of the range." if missing else "")
    return replace(branch, message=message, missing=missing, others=tuple(others))


def _gaps(walk: Continuation, branch: Branch, others: Sequence[Branch]) -> tuple[Gap, ...]:
    # A fold lies between two points, a little beyond both.
    folds = [([s.index for s in b.special], [s.value for s in b.special]) for b in (branch, *others)]
    values = [np.insert(b.points["value"], *at) for b, at in zip((branch, *others), folds, strict=True)]
    return gaps(walk.limits, list(zip(values, [b.ends for b in (branch, *others)], strict=True)))


def _places(walk: Continuation, gap: Gap) -> list[float]:
    """Where other cycles are searched for: at the end of the range, and in the middle of the gap."""
    if gap.turns:
        return []
    values = [*(v for v in (gap.low, gap.high) if v in walk.limits), 0.5 * (gap.low + gap.high)]
    return [v for v in values if not refused(walk.case, walk.parameter, v)]


def _branch_from(walk: Continuation, value: float) -> Branch | None:
    """The longest of the branches of the cycles that the exact search finds at a value."""
    found = []
    with suppress(EppError, np.linalg.LinAlgError):
        for orbit in filter(None, orbits_found(walk.case, walk.parameter, walk.family, value)):
            with suppress(EppError, np.linalg.LinAlgError):
                found.append(replace(walk, special=[]).run((value, orbit)))
    return max(found, key=lambda b: float(np.ptp(b.points["value"])), default=None)


def _simulated(case: CaseLike, parameter: str, values: Array) -> dict[str, Array]:
    """Where the case's own run ends on a cycle: the parameter, frequency and peak-to-peak of every signal."""
    rows: list[dict[str, float]] = []
    for value in values.tolist():
        cycle = simulate(case.with_values({parameter: value})).limit_cycle
        if cycle is not None:
            rows.append({"value": value, "frequency": cycle.frequency, **cycle.peak_to_peak})
    return {name: np.array([row[name] for row in rows]) for name in (rows[0] if rows else ())}


@dataclass
class Continuation:
    """One branch under way; lives for one call.

    `passes`, where given, is a function of its points of which every zero is located and noted, too.
    """

    case: CaseLike
    parameter: str
    family: Family
    limits: tuple[float, float]
    n_points: int
    max_step: float
    special: list[tuple[Change, BranchPoint, str, int]] = field(default_factory=list)
    passes: Callable[[BranchPoint], float] | None = None
    stopped: list[BranchPoint] = field(default_factory=list)  # where branches ended that would go on with more points

    def run(self, seed: tuple[float, Orbit]) -> Branch:
        """Both directions from the seed."""
        value, orbit = seed
        inward = 1.0 if value - self.limits[0] <= self.limits[1] - value else -1.0
        begin = make_point(self.family, value, orbit, None, inward)
        if begin.one_of_many:
            _, why = self._stood([], begin, Change.CONTINUA)
            return self._branch([begin], ("begins at the end of the range" if self._at_limit(value) else why, why))
        points, why = self.along(begin, self.n_points)
        back: list[BranchPoint] = []
        other = "begins at the end of the range"
        if not self._at_limit(value):
            forward, self.special = self.special, []
            back, other = self.along(make_point(self.family, value, orbit, None, -inward), self.n_points - len(points))
            n = len(back)
            turned = [(k, p, note, n - 1 - i) for k, p, note, i in self.special]
            self.special = turned[::-1] + [(k, p, note, i + n - 1) for k, p, note, i in forward]
            points = back[::-1][:-1] + points
        return self._branch(points, (other, why))

    def run_off(self, begin: BranchPoint) -> Branch:
        """Away from where the branch leaves another one."""
        points, why = self.along(begin, self.n_points)
        return self._branch(points, ("leaves the branch of half the period", why))

    def _at_limit(self, value: float) -> bool:
        return any(self._is_one(x, value) for x in self.limits)

    def _is_one(self, value: float, other: float) -> bool:
        """Whether two values of the parameter are one, but for rounding."""
        return abs(value - other) < 1e-9 * self.family.width

    def along(self, point: BranchPoint, n_points: int) -> tuple[list[BranchPoint], str]:
        """Points from `point` on in the direction of its tangent, until the range, the count or the branch ends."""
        points, ds = [point], 0.25 * self.max_step
        while len(points) < n_points:
            new, outside = _ahead(points[-1], ds)
            # Steps shrink first; only at the least of them is the sequence of events taken to have ended
            # (docs/theory/exact_orbits.md, Branches).
            if new is None and ds > LEAST_STEP:
                ds *= 0.3
                continue
            if new is None or outside is not None:
                new, why = self._change(points, new, outside)
                if new is None or standstill(points[-1], new):
                    return self._ended(points, new, why)
                points.append(new)
                ds = 0.25 * self.max_step
                continue
            if not self.limits[0] <= new.value <= self.limits[1]:
                if points[-1].turn * new.turn < 0 and ds > LEAST_STEP:  # the fold between may lie within the range
                    ds *= 0.3
                    continue
                return self._left(points, new)
            if (what := standstill(points[-1], new)) is not None:
                return self._stood(points, new, what)
            if self._watch(points[-1], new, len(points)):
                return points, "joins the branch of half its period"
            points.append(new)
            if known := self._known(points):
                return points, known
            ds = min(1.5 * ds, self.max_step) if bend(points[-2], new) < 0.1 else ds
        self.stopped.append(points[-1])
        return points, "stops at the given number of points"

    def _known(self, points: list[BranchPoint]) -> str:
        """What the last step has come to that was followed before; a branch that stopped is joined at its end."""
        first, old, new = points[0], *points[-2:]
        if len(points) > 21 and same_orbit(first.orbit, new.orbit) and _same_value(first, new):
            return "closes on itself"
        for end in self.stopped:
            here = point_at(old, new, end.value) if (old.value - end.value) * (new.value - end.value) < 0.0 else None
            if here is not None and same_orbit(here.orbit, end.orbit):
                points[-1] = here
                return "joins a branch that stops at the given number of points"
        return ""

    def _ended(self, points: list[BranchPoint], new: BranchPoint | None, why: str) -> tuple[list[BranchPoint], str]:
        """The points up to a change of the sequence beyond which no orbit is, or at which the parameter is constant."""
        if new is None:
            return points, why
        _, inside, _, _ = self.special.pop()  # that the events change there is up to rounding
        what = standstill(points[-1], new) or Change.CONTINUUM
        return self._stood(points, inside if what is Change.CONTINUA else new, what)

    def _stood(self, points: list[BranchPoint], new: BranchPoint, what: Change) -> tuple[list[BranchPoint], str]:
        """The points up to one at which the parameter is constant, or cycles are a continuum from there on."""
        if what is Change.CONTINUUM and linear_arc(new.orbit) is not None:
            what = Change.LINEAR
        self._note(what, new, STANDS[what], len(points))
        return points if what is Change.LINEAR else [*points, new], f"ends where {STANDS[what]}"

    def _left(self, points: list[BranchPoint], new: BranchPoint) -> tuple[list[BranchPoint], str]:
        """The points up to the limit of the range, beyond which the new one is."""
        end = point_at(points[-1], new, self.limits[0] if new.value < self.limits[0] else self.limits[1])
        if end is not None:
            if self._watch(points[-1], end, len(points)):
                return points, "joins the branch of half its period"
            if end.one_of_many:
                return self._stood(points, end, Change.CONTINUA)
            points.append(end)
        return points, "leaves the range"

    def _lost(
        self, points: list[BranchPoint], last: BranchPoint, outside: BranchPoint
    ) -> tuple[BranchPoint | None, str]:
        """Go on where Newton does not with the old sequence, or where that is not true outside."""
        way = float(np.sign(last.tangent[-1])) or 1.0
        for border in borders(last):
            new, back = across(border, way)
            if new is not None:
                return self._crossed(points, border if back else shown_at(border, last), new, back)
        return self._crossed(points, last, *beyond(last), outside)

    def _change(
        self, points: list[BranchPoint], inside: BranchPoint | None, outside: BranchPoint | None
    ) -> tuple[BranchPoint | None, str]:
        """Cross a change of the sequence of events, on both sides of which orbits are known or none is."""
        if inside is None or outside is None:
            return self._lost(points, points[-1], points[-1])
        # One step may hold both a fold and, behind it, the change.
        if self._watch(points[-1], inside, len(points)):
            return None, "joins the branch of half its period"
        new, back = other_sequence(inside, outside)
        if new is None:  # the old sequence, no longer true, may lead back to where it came from
            return self._lost(points, inside, outside)
        inside = border_collision(inside, new) if back else visit_ends(inside, new)
        return self._crossed(points, inside, new, back)

    def _crossed(
        self,
        points: list[BranchPoint],
        inside: BranchPoint,
        new: BranchPoint | None,
        back: bool,
        outside: BranchPoint | None = None,
    ) -> tuple[BranchPoint | None, str]:
        """The point beyond a border, noted; or how the branch ends there."""
        if new is not None and not _same_motion(points, new):
            kind_before, before = self.special[-1][:2] if self.special else (None, inside)
            if back and kind_before is Change.FOLD and self._is_one(before.value, inside.value):
                # A branch that comes to the change like a root stands upright there: on which side of it, is rounding.
                # It turns twice, which is not at all.
                self.special.pop()
                back = False
            kind = Change.TURNING if back else Change.SEQUENCE
            self._note(kind, inside, difference(inside.orbit, new.orbit), len(points))
            return new, ""
        if left := self._leaves(inside):
            points.append(inside)
            return None, left
        kind = ending(inside.orbit)
        why = STANDS.get(kind) or f"no orbit continues it: {departure(inside.orbit, (outside or inside).orbit)}"
        self._note(kind, inside, why, len(points))
        if kind is not Change.LINEAR and inside is not points[-1] and regular(inside):
            points.append(inside)
        return None, f"ends where {why}"

    def _leaves(self, inside: BranchPoint) -> str:
        """How the branch leaves the range, or the values that the loop takes, within its least step; else nothing."""
        least, ahead = LEAST_STEP * self.family.width, 1.0 if inside.turn > 0.0 else -1.0
        beyond = inside.value + ahead * least
        if not self.limits[0] < beyond < self.limits[1]:
            return "leaves the range"
        refusal = refused(self.case, self.parameter, beyond)
        return f"leaves the values that the loop takes ({refusal})" if refusal else ""

    def _watch(self, old: BranchPoint, new: BranchPoint, index: int) -> bool:
        """Folds and changes of stability between two points of one sequence; whether the branch ends there."""
        if self.passes is not None and self.passes(old) * self.passes(new) < 0:
            found = locate(old, new, self.passes, 1e-12)
            if found is not None:
                self._note(Change.PASSAGE, found, "the function that is watched passes zero", index)
        # A multiplier passes 1 at a fold, too: that is no special point besides. Where the parameter is constant its
        # sign is rounding, and at the limit of linear stability, where a cycle is neutral, the side of its multipliers.
        if old.turn * new.turn < 0 and not new.stands:
            found = locate(old, new, lambda p: p.turn, 1e-11)
            if found is not None and half_alike(found.orbit):
                self._note(
                    Change.PERIOD_DOUBLING, found, "the cycle of half the period, which this branch leaves", index
                )
                return True
            if found is not None:
                stable = is_stable(old.multipliers) or is_stable(new.multipliers)
                meet = "a stable and an unstable cycle meet" if stable else "two unstable cycles meet"
                self._note(Change.FOLD, found, meet, index)
            return False
        if is_stable(old.multipliers) != is_stable(new.multipliers) and linear_arc(new.orbit) is None:
            kind, test = crossing(old, new)
            found = locate(old, new, test, 1e-9)
            if found is not None:
                self._note(kind, found, f"a multiplier leaves the unit circle ({kind})", index)
        return False

    def _note(self, kind: Change, point: BranchPoint, note: str, index: int) -> None:
        self.special.append((kind, point, note, index))

    def _branch(self, points: list[BranchPoint], ends: tuple[str, str]) -> Branch:
        system = self.case.to_system()
        names = system.signals.names
        sizes = np.array([signal_sizes(system, p.orbit) for p in points])
        data = {
            "value": np.array([p.value for p in points]),
            "period": np.array([p.orbit.period for p in points]),
            "frequency": np.array([1.0 / p.orbit.period for p in points]),
            "stable": np.array([is_stable(p.multipliers, p.one_of_many) for p in points]),
            "multiplier": np.array([float(np.max(np.abs(p.multipliers), initial=0.0)) for p in points]),
            "residual": np.array([p.orbit.residual for p in points]),
        }
        data |= {name: sizes[:, i] for i, name in enumerate(names)}
        held = np.array([p.orbit.holds for p in points])
        begins = np.flatnonzero(held & ~np.append(False, held[:-1])).tolist()
        noted = [*self.special, *((Change.CONTINUA, points[i], _HELD, i) for i in begins)]
        special = tuple(
            SpecialPoint(kind, p.value, note, to_limit_cycle(system, p.orbit), i, p)
            for kind, p, note, i in sorted(noted, key=lambda s: s[3])
        )
        failed = any(s.kind is Change.END for s in special)
        return Branch(
            parameter=self.parameter,
            unit=self.case.unit(self.parameter)[0],
            readable=self.case.readable(self.parameter),
            points=data,
            special=special,
            status=Status.NOT_CONVERGED if failed else Status.CONVERGED,
            message=in_words(ends),
            ends=ends,
            signals=tuple(names),
            units=system.signals.units_of_results(),
            provenance=Provenance("pseudo-arclength continuation", {"limits": self.limits}, case=facts_of(self.case)),
            operating_point=self.case.operating_point,
        )


def _ahead(point: BranchPoint, ds: float) -> tuple[BranchPoint | None, BranchPoint | None]:
    """Where a step leads, and the orbit behind a change of the sequence of events in front of which it ends.

    Both are None where the step has lost the branch.
    """
    new = step(point, ds)
    if new is None or astray(point, new) or not regular(new):
        return None, None
    return (new, None) if admissible(new) else last_admissible(point, ds)


def _same_value(one: BranchPoint, other: BranchPoint) -> bool:
    return abs(one.value - other.value) < 1e-3 * one.family.width


def _same_motion(points: list[BranchPoint], new: BranchPoint) -> bool:
    """Whether a new point only repeats the one before it, so that the branch would run to and fro."""
    if len(points) < 2:
        return False
    it = new.orbit.arcs.event_sequence.key
    return it == points[-1].orbit.arcs.event_sequence.key
