"""The best place: where the goal is highest, when at each place the bounded parameter goes as far as cycles let it.

At a place (values of all tuned parameters but the bounded one) the bounded parameter may be anything between the safe
end of its range and the bound; the best of these values that keeps what is to be kept is the place's pick. Its slope by
any other number is that of the goal along what is active there: the fold (exact, by the row that annihilates the
derivative of the orbit's equations), the measure that is just kept, or nothing. Describing functions say on a
grid where the best place lies, their programme goes uphill from there, and exact folds go on from where it ends.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from eppanalysis.arrays import Array
from eppanalysis.errors import EppError
from eppanalysis.methods.bounds.balanced import BoundProblem, spread
from eppanalysis.methods.bounds.exact import ExactBound
from eppanalysis.methods.bounds.result import Turn
from eppanalysis.methods.design.bound_curve import BoundCurve
from eppanalysis.methods.design.climb import Slope, climb
from eppanalysis.methods.design.goal import Goal, Judged, Kept
from eppanalysis.methods.design.programme import N_SCAN, Place
from eppanalysis.polynomials import polynomial_at

#: Values of each parameter on the grid of the DF, by how many there are; places of a seeded sample for more.
_LEVELS, _SAMPLE = {1: 7, 2: 5, 3: 3}, 32
#: First reach of the climb, from a design nearby and from what is proposed; where it ends, and places that it tries at
#: most; those of the programme.
_REACH_NEAR, _REACH, _CLOSE, _MOST = 0.02, 0.1, 2e-4, 40
_CLOSE_PROPOSED, _MOST_PROPOSED = 1e-2, 25
#: Halvings of an interval whose one end keeps all.
_HALVINGS = 40
#: Share of an interval by which the goal is tested inside it.
_ASIDE = 0.02
#: How often a corner of the tolerances is added, and how many parameters are flipped to find a worse one.
_MOST_CORNERS, _FLIPPED = 6, 3
#: Ranges as wide as this are run through by ratios.
_DECADE = 10.0

#: Places at most at which exact bounds are computed where that which the DF proposes is not feasible.
_MOST_ALL = 7


@dataclass(frozen=True, eq=False)
class Pick:
    """The best value of the bounded parameter at a place."""

    place: Place  # values of the other tuned parameters [SI]
    value: float  # of the bounded parameter [SI]; nan where nothing is feasible
    worth: float  # of the goal: larger is better; minus infinity where nothing is feasible
    bound: ExactBound  # the least of those at the corners of the tolerances
    #: That corner: which parameters are off, -1 or 1 times their tolerance.
    corner: Mapping[str, float] = field(default_factory=dict)
    kept: Kept | None = None  # the measure that limits it
    #: Whether the goal is highest between the safe end and the bound, so that neither a cycle nor a measure limits it.
    inside: bool = False
    message: str = ""  # why nothing is feasible

    @property
    def feasible(self) -> bool:
        """Whether there is any value."""
        return bool(np.isfinite(self.worth))

    @property
    def by_cycle(self) -> bool:
        """Whether the limit cycle is what limits it."""
        return self.kept is None and not self.inside and self.bound.kind is not Turn.END


@dataclass(eq=False)
class Search:
    """The best place of one design; lives for it."""

    frontier: BoundCurve  # of the bounded parameter; shared by the designs of a front
    goal: Goal
    others: dict[str, tuple[float, float]]  # the tuned parameters that are not bounded, with their ranges [SI]
    fixed: dict[str, float] = field(default_factory=dict)  # values of the others that the frontier runs over
    shares: dict[str, float] = field(default_factory=dict)  # tolerances, relative to the values
    #: Corners of the tolerances that count; at first none of them is off.
    corners: list[dict[str, float]] = field(default_factory=lambda: [{}])
    picks: dict[Place, Pick] = field(default_factory=dict)

    @property
    def widths(self) -> dict[str, float]:
        """The other tuned parameters, and how far each may run [SI]."""
        return {name: high - low for name, (low, high) in self.others.items()}

    # Places and questions

    def full(self, place: Place, corner: Mapping[str, float]) -> Place:
        """A place as the frontier has it, with some parameters off by their tolerances."""
        values = {**self.fixed, **dict(zip(self.others, place, strict=True))}
        shares = {name: 1.0 + corner.get(name, 0.0) * self.shares.get(name, 0.0) for name in self.frontier.widths}
        return tuple(values[name] * shares[name] for name in self.frontier.widths)

    def here(self, place: Place, corner: Mapping[str, float] | None = None) -> BoundProblem:
        """The question at a place."""
        return self.frontier.here(self.full(place, corner or {}))

    def of_units(self, units: Array) -> Place:
        """Values of parameters at shares of their ranges."""
        made = []
        for share, (low, high) in zip(units.tolist(), self.others.values(), strict=True):
            value = low * (high / low) ** share if _by_ratio(low, high) else low + share * (high - low)
            made.append(float(np.clip(value, low, high)))
        return tuple(made)

    def units(self, place: Place) -> tuple[Array, Array]:
        """Shares of the ranges at a place, and the derivative of the values by them."""
        shares, slopes = [], []
        for value, (low, high) in zip(place, self.others.values(), strict=True):
            by_ratio = _by_ratio(low, high)
            width = np.log(high / low) if by_ratio else high - low
            shares.append(np.log(value / low) / width if by_ratio else (value - low) / width)
            slopes.append(width * value if by_ratio else width)
        return np.array(shares), np.array(slopes)

    # Picks

    def pick(self, place: Place) -> Pick:
        """The best value of the bounded parameter at a place, with exact bounds."""
        if place not in self.picks:
            bounds = [(self.frontier.at(self.full(place, corner)), corner) for corner in self.corners]
            bound, corner = min(bounds, key=lambda pair: self.frontier.worth(pair[0]))
            if np.isfinite(self.frontier.worth(bound)):
                found = self.within(place, self.nominal(bound.value, bound.kind is Turn.END))
                self.picks[place] = replace(found, bound=bound, corner=corner)
            else:
                self.picks[place] = Pick(place, np.nan, -np.inf, bound, corner, message=bound.message)
        return self.picks[place]

    def nominal(self, value: float, at_end: bool = False) -> float:
        """The nominal value of the bounded parameter that reaches a value when it is off by its own tolerance."""
        share = self.shares.get(self.frontier.question.limit, 0.0)
        return value if at_end else value / (1.0 + self.frontier.sign * share)

    def within(self, place: Place, edge: float) -> Pick:
        """The best value between the safe end and an edge."""
        here, safe = self.here(place), self.frontier.ends[0]
        limit, sign = here.limit, self.frontier.sign
        if self.goal.name == limit and not self.goal.kept:
            return Pick(place, edge, self.goal.sign * edge, ExactBound(edge))
        values = spread(safe, edge, N_SCAN) if sign * (edge - safe) > 0 else [edge]
        judged = [self.judge(here, v) for v in values]
        fit = [i for i, j in enumerate(judged) if j.feasible]
        if not fit:
            return Pick(place, np.nan, -np.inf, ExactBound(), message=_not_kept(judged))
        i = max(fit, key=lambda k: judged[k].worth)
        found = [Pick(place, values[i], judged[i].worth, ExactBound(), inside=i < len(values) - 1)]
        # The best value may lie between two of the grid: on the border
        # of what is kept, or where the goal rises beside the best one.
        for k in (k for k in (i - 1, i + 1) if 0 <= k < len(values)):
            if not judged[k].feasible:
                found.append(self._border(here, place, values[i], values[k]))
            elif self.judge(here, values[i] + _ASIDE * (values[k] - values[i])).worth > judged[i].worth:
                found.append(self._inside(here, place, values[i], values[k]))
        return max(found, key=lambda p: p.worth)

    def judge(self, here: BoundProblem, value: float) -> Judged:
        """What the goal says of a value of the bounded parameter."""
        try:
            return self.goal.judge(here.case_at(value))
        except EppError:
            return Judged(-np.inf, -np.inf)

    def _border(self, here: BoundProblem, place: Place, good: float, bad: float) -> Pick:
        """Where what is kept just is, between a value that keeps it and one that does not."""
        last = self.judge(here, bad)
        for _ in range(_HALVINGS):
            middle = 0.5 * (good + bad)
            judged = self.judge(here, middle)
            if judged.feasible:
                good = middle
            else:
                bad, last = middle, judged
        return Pick(place, good, self.judge(here, good).worth, ExactBound(), kept=last.tightest, inside=True)

    def _inside(self, here: BoundProblem, place: Place, one: float, other: float) -> Pick:
        """The highest value between two."""
        from scipy.optimize import minimize_scalar

        def price(value: float) -> float:
            judged = self.judge(here, float(value))
            return -judged.worth if judged.feasible else 1e300

        low, high = sorted((one, other))
        found = minimize_scalar(price, bounds=(low, high), method="bounded", options={"xatol": 1e-4 * (high - low)})
        return Pick(place, float(found.x), -float(found.fun), ExactBound(), inside=True)

    # Slopes

    def slopes(self, pick: Pick, names: Mapping[str, float], of_edge: Mapping[str, float]) -> dict[str, float]:
        """Derivative of the goal at a pick by parameters.

        Parameters
        ----------
        names : mapping of str to float
            The parameters, and what counts as a large change of each [SI].
        of_edge : mapping of str to float
            Derivative of the edge by them, for where it is what is active.
        """
        here, limit = self.here(pick.place), self.frontier.question.limit
        moves = of_edge if pick.kept is None and not pick.inside else {}
        size = abs(pick.value) or abs(self.frontier.question.high)
        if self.goal.name == limit and pick.kept is None:
            return {name: self.goal.sign * moves.get(name, 0.0) for name in names}
        case = here.case_at(pick.value)

        def slope(name: str, size: float) -> Array:
            """Of worth and slack; nan where they have none."""

            def judged(value: float) -> Array | None:
                found = self.goal.judge(case.with_values({name: value}))
                return np.array([found.worth, found.slack] if self.goal.kept else [found.worth, 0.0])

            found = polynomial_at(judged, case.value(name), size)
            return np.full(2, np.nan) if found is None else found.slope(case.value(name))

        by_limit = slope(limit, size)
        out = {}
        for name, large in names.items():
            own = slope(name, large)
            # On the border the slack stays zero: d limit/dq = -(d slack/dq)/(d slack/d limit).
            moved = moves.get(name, 0.0) if pick.kept is None else -own[1] / by_limit[1]
            out[name] = float(own[0] + by_limit[0] * moved)
        return out

    def of_bound(self, pick: Pick, names: Mapping[str, float]) -> dict[str, float]:
        """Derivative of the nominal edge by parameters, from the bound at the active corner."""
        if not pick.by_cycle:
            return {}
        found = self.frontier.of_bound(self.full(pick.place, pick.corner), pick.bound, names)
        corner, shares = pick.corner, self.shares
        # At the corner a parameter is (1 + tolerance) times its nominal value, by which the derivative is wanted.
        scale = self.nominal(1.0)
        return {n: scale * s * (1.0 + corner.get(n, 0.0) * shares.get(n, 0.0)) for n, s in found.items()}

    # The way to the best place

    def best_of_all(self, near: Sequence[Place] = ()) -> Pick:
        """The best pick for all corners of the tolerances, from designs nearby or else from what the DF proposes.

        A corner at which a bound is worse than at those that count so far is added, and the best place sought again.
        """
        best = self.best(near[-1:], self._reach(near)) if near else self.best(self.proposed())
        if not best.feasible:
            # The DF may be wrong of it: it takes a range of cycles alone, without a bound in it, for a free one.
            places = self.grid()
            best = self.best(places[:: -(-len(places) // _MOST_ALL)])
        for _ in range(_MOST_CORNERS if self.shares else 0):
            corner = self._worse_corner(best)
            if corner is None:
                break
            self.corners = [c for c in self.corners if c] + [corner]
            self.picks.clear()
            best = self.best([best.place] if best.feasible else self.proposed())
        return best

    def _reach(self, near: Sequence[Place]) -> float:
        """The first reach from designs nearby: twice as far as the last two are apart."""
        if len(near) < 2 or not self.others:
            return _REACH_NEAR
        one, other = (self.units(place)[0] for place in near[-2:])
        return float(np.clip(2.0 * np.abs(one - other).max(), 10.0 * _CLOSE, _REACH))

    def _worse_corner(self, best: Pick) -> dict[str, float] | None:
        """A corner with a worse bound than those that count: downhill of the active one, or beside that."""
        names = {n: abs(self.here(best.place).case.value(n)) for n in self.shares if n in self.frontier.widths}
        slopes = self.of_bound(best, names)
        if not slopes:
            return None
        influence = {n: abs(slopes.get(n, 0.0)) * size * self.shares[n] for n, size in names.items()}
        down = {n: -float(np.sign(slopes[n] * self.frontier.sign)) for n in names if np.isfinite(slopes.get(n, np.nan))}
        most = sorted(down, key=lambda n: -influence[n])[:_FLIPPED]
        for corner in [down, *({**down, n: -down[n]} for n in most)]:
            if corner in self.corners:
                continue
            # So far the nominal case alone counts, and downhill of it the bound is worse by its slopes.
            if not any(self.corners[0]):
                return corner
            if self.frontier.worth(self.frontier.at(self.full(best.place, corner))) < self.frontier.worth(best.bound):
                return corner
        return None

    def evaluated(self) -> Array:
        """Places of one other parameter with the bounds there, sorted; with more of them there is no such row."""
        if len(self.others) != 1:
            return np.zeros((0, 2))
        known = sorted((p.place[0], self.nominal(p.bound.value)) for p in self.picks.values() if p.feasible)
        return np.array(known, float).reshape(-1, 2)

    def best(self, starts: Sequence[Place], reach: float = _REACH) -> Pick:
        """The best pick that exact bounds lead to from the best of some places."""
        first = max((self.pick(place) for place in starts), key=lambda p: p.worth)
        if not self.others or not first.feasible:
            return first
        begin = self._exact_slope(self.units(first.place)[0])
        if begin is None:
            return first
        top = climb(self._exact_slope, begin, reach, _CLOSE, _MOST)
        return max(self.picks.values(), key=lambda p: p.worth) if top.value >= first.worth else first

    def _exact_slope(self, units: Array) -> Slope | None:
        place = self.of_units(units)
        pick = self.pick(place)
        if not pick.feasible:
            return None
        return self._as_slope(units, pick, self.of_bound(pick, self.widths))

    def _as_slope(self, units: Array, pick: Pick, of_edge: Mapping[str, float]) -> Slope | None:
        try:
            slopes = self.slopes(pick, self.widths, of_edge)
        except EppError:
            return None
        by_units = np.array([slopes[name] for name in self.others]) * self.units(pick.place)[1]
        return Slope(units, pick.worth, np.where(np.isfinite(by_units), by_units, 0.0))

    def grid(self) -> list[Place]:
        """Places at which the DF is evaluated."""
        if not self.others:
            return [()]
        m = len(self.others)
        if m in _LEVELS:
            shares = np.array(list(itertools.product(np.linspace(0.0, 1.0, _LEVELS[m]), repeat=m)))
        else:
            from scipy.stats import qmc

            shares = qmc.Sobol(m, seed=0).random(_SAMPLE)
        return [self.of_units(row) for row in shares]

    def proposed(self) -> list[Place]:
        """The best place of the DF on the grid, and where the programme of the balance goes from there.

        All places of the grid where the DF is not evaluated.
        """
        places = self.grid()
        if len(places) == 1 or not self.frontier.is_foretold:
            return places
        worths = {place: self._first_order(place).worth for place in places}
        best = max(places, key=lambda place: worths[place])
        begin = None if self.frontier.allowed is not None else self._proposed_slope(self.units(best)[0])
        if begin is None:
            return [best]
        top = climb(self._proposed_slope, begin, _REACH, _CLOSE_PROPOSED, _MOST_PROPOSED)
        return [best, self.of_units(top.place)]

    def _proposed_slope(self, units: Array) -> Slope | None:
        """What the programme says of a place, and of its neighbours by its multipliers."""
        place = self.of_units(units)
        full = self.full(place, self.corners[-1])
        fold = self.frontier.programme.bound(full)
        if fold is None:
            return None
        scale, names = self.nominal(1.0), self.widths
        pick = self.within(place, scale * fold.cycle.value)
        if not pick.feasible:
            return None
        slopes = self.frontier.programme.slopes(full, fold, names)
        return self._as_slope(units, pick, {n: scale * s for n, s in slopes.items()})

    def first_order(self, pick: Pick) -> float:
        """The bounded parameter that the DF proposes at a pick [SI]; nan where it proposes none."""
        edge = self.frontier.first_order(self.full(pick.place, pick.corner))
        return float("nan") if edge is None else self.nominal(edge)

    def _first_order(self, place: Place) -> Pick:
        """The pick by the DF; a range without cycles counts as free to its wanted end."""
        corner = self.corners[-1]
        edge = self.frontier.first_order(self.full(place, corner))
        return self.within(place, self.frontier.ends[1] if edge is None else self.nominal(edge))


def _by_ratio(low: float, high: float) -> bool:
    """Whether a range is run through by ratios."""
    return low > 0 and high >= _DECADE * low


def _not_kept(judged: Sequence[Judged]) -> str:
    """What is kept nowhere."""
    best = max(judged, key=lambda j: j.slack)
    if best.tightest is None:
        return "the linearised loop is unstable, or has no such measure, all the way to where cycles begin"
    return f"the {best.tightest} is not kept anywhere between the safe end and where cycles begin"
