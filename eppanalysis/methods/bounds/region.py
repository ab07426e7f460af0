"""The region of two parameters that is free of limit cycles: its border all round, each stretch with its kind.

Limit cycles are searched for at the places of a coarse grid. Between two that differ lies a border, which is followed
in the plane itself. Round a point of it lies a small circle; from the side on which limit cycles are known the circle
is followed to where these end, which is a bound as on any line, with its kind and its tests. So the border is followed
through turns in either parameter, cusps and changes of the sequence of events, and on from one family of cycles to
another where the borders of both cross: the tests find that one. Between its ends on the edges of the ranges the region
ends with these.

Places in the plane are shares of the ranges of both parameters. A border has the region on its right.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import product
from typing import Any, cast

import numpy as np

from eppanalysis.arrays import Array
from eppanalysis.errors import EppError
from eppanalysis.methods.bounds.balanced import BoundProblem
from eppanalysis.methods.bounds.design import Settings, checked_bound, farthest_end
from eppanalysis.methods.bounds.result import BoundCell, Finding, Turn
from eppanalysis.methods.bounds.sizes.allowed import Allowed
from eppanalysis.methods.bounds.verify import orbit_at
from eppanalysis.methods.continuation.own_states import OwnStates
from eppanalysis.methods.search.find import find_limit_cycles
from eppanalysis.methods.steady.locate import turned
from eppanalysis.models.systems.subject import CaseLike
from eppanalysis.progress import Progress
from eppanalysis.results import LimitCycle

#: What the place on a curve is called, as a parameter.
_PLACE = "place"
#: Radius of the circles, relative to the ranges: of the first, at least, at most; and what makes it longer and shorter.
_FIRST, _LEAST, _MOST = 0.02, 2e-3, 0.05
_SHORTER, _LONGER = 0.4, 1.6
#: Turn between two stretches above which the circle is made smaller, and below which the next one is larger.
_BENT, _STRAIGHT = 1.0 - math.cos(math.radians(25.0)), 1.0 - math.cos(math.radians(8.0))
#: Angles from the direction to the cycles at which a cycle is looked for [rad], and the last one at which their end is:
#: beyond it lies the stretch of the border that is known.
_BEGINS, _LAST = (0.0, 0.4, -0.4, 0.9), math.radians(245.0)
#: Distance of the tests from the border, relative to the angle, and runs of each.
_MARGIN, _RUNS = 0.25, 50
#: Points of a border one way, and borders, at most.
_MOST_POINTS, _MOST_BORDERS = 300, 12
#: How far inside of the ranges places on their edges are, so that borders which end there are crossed.
_INSIDE = 1e-6


@dataclass(frozen=True, eq=False)
class OnCurve:
    """A case on a curve in the plane of two of its parameters: the place on it is a parameter by itself."""

    case: CaseLike
    values_at: Callable[[float], dict[str, float]]
    place: float = math.nan

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__") or name in ("case", "values_at", "place"):  # read while it is copied
            raise AttributeError(name)
        return getattr(self.case, name)

    def with_values(self, values: Mapping[str, Any]) -> OnCurve:
        """The case with other values, the place among them."""
        if _PLACE not in values:
            return replace(self, case=self.case.with_values(values))
        place = float(values[_PLACE])
        others = {name: value for name, value in values.items() if name != _PLACE}
        return replace(self, case=self.case.with_values({**others, **self.values_at(place)}), place=place)

    def si(self, name: str, value: Any) -> float:
        """SI value of a quantity; the place has no unit."""
        return float(value) if name == _PLACE else self.case.si(name, value)

    def value(self, name: str) -> float:
        """A parameter [SI]."""
        return self.place if name == _PLACE else self.case.value(name)

    def unit(self, name: str) -> tuple[str, str]:
        """SI unit and the unit people use."""
        return ("", "") if name == _PLACE else self.case.unit(name)

    def readable(self, name: str) -> tuple[str, float]:
        """The unit people use, and the factor from SI to it."""
        return ("", 1.0) if name == _PLACE else self.case.readable(name)

    def text(self, name: str, value: float, digits: int = 6) -> str:
        """A value as people write it."""
        return f"{value:.{digits}g}" if name == _PLACE else self.case.text(name, value, digits)


@dataclass(frozen=True, eq=False)
class BorderPoint:
    """A point of a border."""

    at: Array  # (2,): shares of the ranges
    to_cycles: Array  # (2,): unit direction to the side with limit cycles
    kind: str  # of the stretch that ends here
    verified: bool
    cycle: LimitCycle | None = None  # the one that ends there

    @property
    def on_edge(self) -> bool:
        """Whether it lies at the end of a range."""
        return bool(np.any((self.at <= 0.0) | (self.at >= 1.0)))


@dataclass(frozen=True, eq=False)
class Border:
    """A curve with the region on its right: closed, but where it could not be followed."""

    points: tuple[BorderPoint, ...]
    closed: bool

    @property
    def places(self) -> Array:
        """Shares of the ranges, (k, 2); of a closed one the last is the first."""
        at = np.array([p.at for p in self.points])
        return np.vstack([at, at[:1]]) if self.closed else at

    @property
    def kinds(self) -> list[str]:
        """Of the stretch that ends at each place."""
        kinds = [p.kind for p in self.points]
        return kinds + kinds[:1] if self.closed else kinds

    @property
    def area(self) -> float:
        """Share of the plane, positive where the region is inside, negative for a hole in it."""
        (x, y), (x2, y2) = self.places.T, np.roll(self.places, -1, axis=0).T
        return -0.5 * float(np.sum(x * y2 - x2 * y))


@dataclass
class RegionSearch:
    """The borders of a region under way; lives for one call."""

    case: CaseLike  # in states of its own
    axes: tuple[str, str]
    low: Array  # (2,): of both ranges [SI]
    high: Array
    n: int  # places along each side of the grid that is searched
    allow: str | None = None  # the limit cycle that is allowed, as for bounds
    progress: Progress | None = None
    borders: list[Border] = field(default_factory=list)
    searched: dict[tuple[int, ...], tuple[LimitCycle, ...]] = field(default_factory=dict)  # by place of the grid
    n_open: int = 0  # places without an answer
    why: str = ""  # what is missing

    @cached_property
    def settings(self) -> Settings:
        """How points of the border are tested."""
        allowed = None if self.allow is None else Allowed.read(self.case.to_system(), self.allow)
        return Settings(margin=_MARGIN, starts=_RUNS, allowed=allowed)

    @property
    def area(self) -> float:
        """Share of the plane that is free of limit cycles; nan where a border is not closed."""
        return sum(b.area for b in self.borders) if not self.why else math.nan

    def run(self) -> None:
        """Find the borders between the ends of both ranges."""
        for place in product(range(self.n), repeat=2):
            self._told("places searched", len(self.searched), self.n**2)
            self.searched[place] = self._cycles_at(self._on_grid(place))
        found: list[Border] = []
        for cycles, free in self._pairs():
            a, b = self._on_grid(cycles), self._on_grid(free)
            if len(found) < _MOST_BORDERS and not sum(_crossings(a, b, f.places) for f in found) % 2:
                found += self._between(a, b, self.searched[cycles])
        self.borders = [f for f in found if f.closed]
        self._close([f for f in found if not f.closed])
        self._check()

    def _pairs(self) -> Iterator[tuple[tuple[int, ...], tuple[int, ...]]]:
        """Neighbours on the grid of which the first has limit cycles and the other none."""
        for i, j in self.searched:
            for other in ((i + 1, j), (i, j + 1)):
                if other in self.searched and bool(self.searched[i, j]) != bool(self.searched[other]):
                    yield ((i, j), other) if self.searched[i, j] else (other, (i, j))

    def _between(self, cycles: Array, free: Array, known: Sequence[LimitCycle]) -> list[Border]:
        """The border between two places; none where it is not found."""
        way = free - cycles
        cell = self._end_along(lambda share: cycles + share * way, 0.0, 1.0, known)
        if cell is None:
            self.why = self.why or f"No border was found between {self._in_words(cycles)}, and {self._in_words(free)}."
            return []
        at = cycles + cell.exact * way
        first = BorderPoint(at, -way / np.linalg.norm(way), cell.kind, cell.verified, cell.orbit)
        border = self._through(first)
        if not border.closed and not (border.points[0].on_edge and border.points[-1].on_edge):
            end = next(p for p in (border.points[-1], border.points[0]) if not p.on_edge)
            self.why = self.why or f"The border could not be followed beyond {self._in_words(end.at)}."
        return [border]

    def _close(self, parts: list[Border]) -> None:
        """Close borders that end on the edges of the ranges along these, clockwise, each on to the next one."""
        if self.why:
            self.borders += parts
            return
        if not parts and not any(b.area > 0.0 for b in self.borders) and not self.searched[0, 0]:
            self.borders.append(Border(tuple(_edge_point(u) for u in _corners_between(-1e-6, 4.0)), True))
        left = list(parts)
        while left:
            points: list[BorderPoint] = []
            part = left[0]
            while part in left:
                left.remove(part)
                # The stretch that ends where a border begins is that along the edge.
                points += [replace(part.points[0], kind=Turn.EDGE), *part.points[1:]]
                end = _perimeter_of(points[-1].at)
                ahead = {id(p): (_perimeter_of(p.points[0].at) - end) % 4.0 for p in parts}
                part = min(parts, key=lambda p: ahead[id(p)])
                points += [_edge_point(u) for u in _corners_between(end, end + ahead[id(part)])]
            self.borders.append(Border(tuple(points), True))

    def _check(self) -> None:
        """Whether the places of the grid are on their sides."""
        for place, cycles in self.searched.items():
            at = self._on_grid(place)
            if not self.why and _is_inside(at, [b.places for b in self.borders]) == bool(cycles):
                said = "a limit cycle, inside" if cycles else "none, outside"
                self.why = f"At {self._in_words(at)} there is {said} of the border that was followed."

    def _on_grid(self, place: tuple[int, ...]) -> Array:
        """A place of the grid, those on the edges a little inside of these."""
        return np.clip(np.array(place) / (self.n - 1.0), _INSIDE, 1.0 - _INSIDE)

    def _told(self, what: str, done: int, of: int | None = None) -> None:
        if self.progress is not None:
            self.progress(done, of, what)

    def _values(self, at: Array) -> dict[str, float]:
        return dict(zip(self.axes, (self.low + (self.high - self.low) * at).tolist(), strict=True))

    def _on(self, curve: Callable[[float], Array], low: float, high: float) -> BoundProblem:
        """The loop along a curve of the plane, as the question for a bound on the place along it."""

        def values_at(place: float) -> dict[str, float]:
            return self._values(curve(place))

        own = self.case
        on = replace(own, case=OnCurve(own.case, values_at)) if isinstance(own, OwnStates) else OnCurve(own, values_at)
        return BoundProblem(cast(CaseLike, on), _PLACE, low, high)

    def _end_along(
        self, curve: Callable[[float], Array], low: float, high: float, near: Sequence[LimitCycle]
    ) -> BoundCell | None:
        """Where along a curve the cycles at its beginning end; None where they are not followed to an end."""
        question, allowed = self._on(curve, low, high), self.settings.allowed
        try:
            cycles = [c for known in near if (c := orbit_at(question, low, known, allowed)) is not None]
            found = farthest_end(question, low, cycles, -1.0, allowed)
            if found is None or found.cycle is None:
                return None
            cell = BoundCell(value=math.nan, finding=Finding.BOUND, sign=-1.0)
            return checked_bound(question, cell, found, self.settings)
        except (EppError, np.linalg.LinAlgError):  # the loop does not take the values there, or nothing closes
            return None

    def _next(self, here: BorderPoint, way: float, radius: float) -> BorderPoint | None:
        """The point of the border on the circle round one, or at the edge within it; `way` 1 with the region on the
        right, -1 back.
        """
        assert here.cycle is not None
        x, y = here.to_cycles

        def direction(angle: float) -> Array:
            c, s = math.cos(angle), -way * math.sin(angle)
            return np.array([c * x - s * y, s * x + c * y])

        def circle(angle: float) -> Array:
            return here.at + radius * direction(angle)

        def within(angle: float) -> Array:
            return _within(here.at, direction(angle), radius)

        # Where the loop does not take values beyond the ranges, the circle keeps to their edge.
        for curve in (circle, within):
            for begin in _BEGINS:
                cell = self._end_along(curve, begin, _LAST, [here.cycle])
                if cell is not None:
                    along = direction(cell.exact)
                    across = way * np.array([-along[1], along[0]])
                    new = BorderPoint(curve(cell.exact), across, cell.kind, cell.verified, cell.orbit)
                    return new if _is_in_ranges(new.at) else self._on_edge(here, new, radius)
            if _is_in_ranges(here.at - radius) and _is_in_ranges(here.at + radius):
                break
        return None

    def _on_edge(self, here: BorderPoint, beyond: BorderPoint, radius: float) -> BorderPoint | None:
        """Where the border leaves the ranges between two points."""
        way = beyond.at - here.at
        crossing = _within(here.at, way / np.linalg.norm(way), radius)
        side = np.where((crossing <= 0.0) | (crossing >= 1.0), 0.0, np.sign(beyond.to_cycles))

        def edge(place: float) -> Array:
            return crossing + (1.0 - place) * radius * side

        assert beyond.cycle is not None
        cell = self._end_along(edge, 0.0, 2.5, [beyond.cycle])
        if cell is None:
            return None
        return BorderPoint(np.clip(edge(cell.exact), 0.0, 1.0), side, cell.kind, cell.verified, cell.orbit)

    def _walk(self, first: BorderPoint, way: float) -> tuple[list[BorderPoint], bool]:
        """Points of the border behind a first one, up to the edge of the ranges, back to the first, or to its end.

        And whether it is back: then the last is beside the first.
        """
        here, radius, last = first, _FIRST, None
        points: list[BorderPoint] = []
        for n in range(_MOST_POINTS):
            self._told("points of the border", n)
            while True:
                new = self._next(here, way, radius)
                bend = 0.0 if new is None or last is None else turned(np.ones(2), here.at - last, new.at - here.at)
                doubtful = new is None or bend > _BENT or (new.kind != here.kind and last is not None)
                if not doubtful or radius <= _LEAST:
                    break
                radius = max(_SHORTER * radius, _LEAST)
            if new is None:
                break
            points.append(new)
            is_back = n > 2 and not new.on_edge and bool(np.linalg.norm(new.at - first.at) < radius)
            if new.on_edge or is_back:
                return points, is_back
            last, here = here.at, new
            radius = min(_LONGER * radius, _MOST) if bend < _STRAIGHT else radius
        return points, False

    def _through(self, first: BorderPoint) -> Border:
        """The whole border through a point."""
        ahead, is_back = self._walk(first, 1.0)
        if is_back:
            return Border((first, *ahead[:-1]), True)
        back, _ = self._walk(first, -1.0)
        kinds = [p.kind for p in (first, *back)]
        # The kind is that of the stretch behind a point, and backwards of the one ahead of it.
        turned = [replace(p, kind=kind) for p, kind in zip(back, kinds, strict=False)][::-1]
        return Border((*turned, first, *ahead), False)

    def _in_words(self, at: Array) -> str:
        return " and ".join(f"{name} = {self.case.text(name, v)}" for name, v in self._values(at).items())

    def _cycles_at(self, at: Array) -> tuple[LimitCycle, ...]:
        """The limit cycles at a place that are not allowed."""
        allowed = self.settings.allowed
        search = find_limit_cycles(self.case.with_values(self._values(at)))
        found = tuple(c for c in search if allowed is None or allowed.exceeded_by(c))
        self.n_open += not found and bool(search.left_open)
        return found


def _is_in_ranges(at: Array) -> bool:
    return bool(np.all((at >= 0.0) & (at <= 1.0)))


def _within(at: Array, direction: Array, radius: float) -> Array:
    """The point at a distance from another, or where the way there leaves the ranges."""
    with np.errstate(divide="ignore", invalid="ignore"):
        reach = np.where(direction > 0.0, (1.0 - at) / direction, np.where(direction < 0.0, -at / direction, np.inf))
    i = int(np.argmin(reach))
    if reach[i] > radius:
        return at + radius * direction
    point = np.clip(at + max(reach[i], 0.0) * direction, 0.0, 1.0)
    point[i] = float(direction[i] > 0.0)
    return point


def _on_perimeter(u: float) -> Array:
    """A place on the edges, clockwise from the origin: one side for every 1."""
    side, share = int(u % 4.0), u % 1.0
    return np.array([(0.0, share), (share, 1.0), (1.0, 1.0 - share), (1.0 - share, 0.0)][side])


def _perimeter_of(at: Array) -> float:
    x, y = at
    if x <= 0.0:
        return float(y)
    if y >= 1.0:
        return 1.0 + float(x)
    return 3.0 - float(y) if x >= 1.0 else 4.0 - float(x)


def _edge_point(u: float) -> BorderPoint:
    """A point that is on a border because a range ends there."""
    return BorderPoint(_on_perimeter(u), np.zeros(2), Turn.EDGE, True)


def _corners_between(begin: float, end: float) -> list[float]:
    """Corners on the edges between two places, without these."""
    return [float(u) for u in range(math.floor(begin) + 1, math.ceil(end))]


def _crossings(a: Array, b: Array, curve: Array) -> int:
    """How often a curve crosses the line from a to b."""
    way, normal = b - a, np.array([a[1] - b[1], b[0] - a[0]])
    side = (curve - a) @ normal > 0.0
    k = np.flatnonzero(side[1:] != side[:-1])
    before, behind = (curve[k] - a) @ normal, (curve[k + 1] - a) @ normal
    share = before / (before - behind)
    along = (curve[k] + share[:, None] * (curve[k + 1] - curve[k]) - a) @ way
    return int(np.sum((along > 0.0) & (along < way @ way)))


def _is_inside(at: Array, curves: Sequence[Array]) -> bool:
    """Whether a point is inside of a region with holes: a way out crosses an odd number of curves."""
    return sum(_crossings(at, np.array([2.0, at[1] + 0.01]), curve) for curve in curves) % 2 == 1
