"""Steps along a branch of exact orbits: the corrector, its tangent, and the tests for special points."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from eppanalysis.arrays import Array, ComplexArray
from eppanalysis.engine.orbits import ARRIVED, LOST, WANTS_STEP, Curve, Plane, correct
from eppanalysis.errors import EppError, ModelError
from eppanalysis.methods.continuation.families import Family
from eppanalysis.methods.continuation.ranges import NEAR, near
from eppanalysis.methods.orbits.arcs import Arcs
from eppanalysis.methods.orbits.guess import Guess
from eppanalysis.methods.orbits.orbit import CONVERGED, Orbit, effort_of, evaluate, evened, room_for, solve
from eppanalysis.methods.orbits.shooting import close_orbit, is_met, next_guess
from eppanalysis.methods.simulation.budget import BudgetExceeded, budget, spend
from eppanalysis.methods.steady.locate import End, located, solved, turned
from eppanalysis.models.systems.hybrid import HybridSystem

#: Rate of the parameter along the branch, relative to its range, that is rounding.
_STANDS = 1e-9
#: Largest predicted bend of the branch over a step, relative to the step.
_GENTLE = 0.1
#: A period that is this many times as long after a step is none: what dies out with time has vanished to rounding.
_MOST_LONGER = 10.0
#: Steps of the engine that may show what is left of a visit that vanishes.
_RUNS = 20_000.0
#: Nor is an orbit this many times as large, whose sizes relative to itself seem to fit.
_MOST_LARGER = 1e9
#: Share of the largest singular value of the equations over start, dwell times and parameter below which the smallest
#: one is that of an orbit that has converged no further; multipliers farther from 1 than this leave none so small.
_FREE, _NEUTRAL = CONVERGED, 1e-4
#: Steps in which an orbit beyond a border is followed back to it, relative to what is left of the way.
_NEARER = 0.25
#: A step along a branch is not made shorter than this; one that turns the direction by more than this is lost, or leads
#: so many times as far as along the direction in which it began.
LEAST_STEP, _MOST_BEND, _MOST_LENGTH = 1e-6, 0.4, 2.0


@dataclass(frozen=True, eq=False)
class BranchPoint:
    """An orbit on a branch, with the direction of the branch there."""

    family: Family
    value: float  # the parameter (SI)
    orbit: Orbit
    slope: Array  # (m + p,): derivative of the residual with respect to the parameter
    tangent: Array  # (m + p + 1,): direction of (unknowns, parameter); of unit length in the branch's own measure
    #: Distance, slope and tangent of the point from which this one was reached.
    before: tuple[float, Array, Array] | None = None
    arc: int | None = None  # at a border between two sequences of events: the arc that has no duration

    @property
    def turn(self) -> float:
        """Rate of the parameter along the branch, relative to its range: zero at a fold."""
        return float(self.tangent[-1] / self.family.width)

    @property
    def stands(self) -> bool:
        """Whether the parameter is constant along the branch, but for rounding; beside a fold it moves."""
        return abs(self.turn) <= _STANDS

    @cached_property
    def multipliers(self) -> ComplexArray:
        """Floquet multipliers."""
        return self.orbit.multipliers

    @cached_property
    def one_of_many(self) -> bool:
        """Whether cycles are a continuum at each value: the equations leave more than one direction free.

        At a fold, and where cycles of all sizes exist at one value only, the parameter takes part in the one direction.
        """
        if not np.any(np.abs(self.multipliers - 1.0) < _NEUTRAL):
            return False
        K = np.column_stack([self.orbit.A, self.slope]) / self.orbit.row_scale[:, None]
        sizes = np.linalg.svd(evened(K * _column_sizes(self.orbit, self.slope)), compute_uv=False)
        return bool(sizes[-1] < _FREE * sizes[0])

    @cached_property
    def weights(self) -> Array:
        """See :func:`weights`."""
        return weights(self.orbit, self.family.width)

    @cached_property
    def unknowns(self) -> Array:
        """Free part of the start, dwell times, parameter; shape (m + p + 1,)."""
        return np.concatenate([self.orbit.y[self.orbit.arcs.free], self.orbit.tau, [self.value]])

    def ahead(self, ds: float) -> tuple[Array, Array]:
        """Unknowns and slope at a distance along the branch, as this point and the one before foretell them."""
        plain = self.unknowns + ds * self.tangent
        if self.before is None:
            return plain, self.slope
        way, slope, tangent = self.before
        bent = (0.5 * ds * ds / way) * (self.tangent - tangent)
        size = self.orbit.column_scale
        # Beside a grazing contact the branch bends like a square root, so the points before it predict nothing
        # (docs/theory/exact_orbits.md, Branches).
        if np.max(np.abs(bent[:-1]) / size) > _GENTLE * np.max(np.abs(ds * self.tangent[:-1]) / size):
            return plain, self.slope
        return plain + bent, self.slope + (ds / way) * (self.slope - slope)


def weights(orbit: Orbit, width: float) -> Array:
    """Measure of the branch: mean square of the relative change of the start, and the parameter over its range."""
    m, p = orbit.arcs.free.size, orbit.tau.size
    # Dwell times have no weight: they follow from the start and the parameter.
    w = np.zeros(m + p + 1)
    w[:m] = 1.0 / (m * orbit.scale[orbit.arcs.free] ** 2)
    w[-1] = 1.0 / width**2
    return w


def make_point(
    family: Family,
    value: float,
    orbit: Orbit,
    along: Array | None,
    sign: float = 1.0,
    before: tuple[float, Array, Array] | None = None,
) -> BranchPoint:
    """The point with its tangent, turned along an earlier tangent (or so that the parameter changes by `sign`)."""
    slope = family.slope(orbit, value)
    w = weights(orbit, family.width)
    row = np.zeros(w.size) if along is None else w * along
    if along is None:
        row[-1] = sign / family.width
    right = np.zeros(w.size)
    right[-1] = 1.0
    # Equations and one row across: regular at a fold, where those alone are singular (docs/theory/exact_orbits.md,
    # Branches).
    t = bordered(orbit, slope, row, right)
    return BranchPoint(family, value, orbit, slope, t / np.sqrt(np.sum(w * t * t)), before)


def _column_sizes(orbit: Orbit, slope: Array) -> Array:
    size = np.abs(slope / orbit.row_scale).max()
    return np.append(orbit.column_scale, 1.0 / size if size > 0 else 1.0)


def bordered(orbit: Orbit, slope: Array, row: Array, right: Array) -> Array:
    """Solve [[A, slope], [row]] s = right, scaled."""
    n, columns = orbit.r.size, _column_sizes(orbit, slope)
    scaled = np.abs(row * columns).max()
    rows = np.append(orbit.row_scale, scaled if scaled > 0 else 1.0)
    K = np.empty((n + 1, n + 1))
    K[:n, :n], K[:n, n], K[n] = orbit.A, slope, row
    K /= rows[:, None]
    K *= columns
    return solved(K, right / rows) * columns


def step(point: BranchPoint, ds: float, row: Array | None = None) -> BranchPoint | None:
    """The point at a distance along the branch with the same sequence of events; None when Newton fails.

    The distance is measured by `row`, by default along the branch.
    """
    found = _corrected(point, _along(point) if row is None else row, ds, *point.ahead(ds))
    return None if found is None else _arrived(point, ds, found)


def _arrived(point: BranchPoint, ds: float, found: _Found) -> BranchPoint:
    """The orbit found at a distance from a point, with the direction of the branch there."""
    before = (ds, point.slope, point.tangent) if ds != 0.0 else None
    return make_point(point.family, found.value, found.orbit, point.tangent, before=before)


def _along(point: BranchPoint) -> Array:
    """Row that measures the distance along the branch."""
    return point.weights * point.tangent


class _Found(NamedTuple):
    """Where a corrector arrives."""

    value: float
    orbit: Orbit
    unknowns: Array


@np.errstate(over="ignore", invalid="ignore")  # an iterate that has gone astray has an infinite residual
def _corrected(point: BranchPoint, row: Array, ds: float, u: Array, slope: Array) -> _Found | None:
    """Newton from u to the orbit in a plane across `row`, at a distance from a point."""
    family, old, like = point.family, point.orbit, point.orbit.arcs
    plane = Plane(row, point.unknowns, ds, slope, _MOST_LARGER * old.scale.max(), _MOST_LONGER * old.period)
    inputs = old.hybrid.n_plant, old.hybrid.x0.size - old.hybrid.n_plant
    u, here, progress = u.copy(), room_for(like, old.y, old.tau), np.array([0.0, np.inf])
    along = none = np.empty(0)
    while True:
        value = float(u[-1])
        try:
            numbers = family.numbers(value, like)
            curve = Curve(numbers.middle, numbers.half, numbers.base, numbers.places, numbers.coefficients)
            code, used = correct(
                like.acting, like.chain, curve, *inputs, effort_of(like), plane, along, progress, u, here
            )
            spend(used)
            if code == LOST:
                return None
            if code == ARRIVED:
                hybrid = family.at(float(u[-1]))
                found = Orbit(hybrid, Arcs.build(hybrid, like.event_sequence, like), *here)
                return _Found(float(u[-1]), found, u)
        except (EppError, ModelError):
            return None
        along = none
        if code == WANTS_STEP:
            missed = row @ (u - point.unknowns) - ds
            along = bordered(Orbit(old.hybrid, like, *here), slope, row, -np.append(here.r, missed))


def point_at(old: BranchPoint, new: BranchPoint, value: float) -> BranchPoint | None:
    """The point at a value of the parameter between two points of one sequence; None when Newton fails."""
    share = (value - old.value) / (new.value - old.value)
    family, like, m = old.family, old.orbit.arcs, old.orbit.arcs.free.size
    u = old.unknowns + share * (new.unknowns - old.unknowns)
    y = old.orbit.y.copy()
    y[like.free] = u[:m]
    orbit = solve(*_at(family, value, Guess(like.event_sequence, y, u[m:-1])))
    if not orbit.residual < CONVERGED:
        return None
    found = make_point(family, value, orbit, old.tangent)
    return found if bend(old, found) < _MOST_BEND else None


def point_across(point: BranchPoint, u: Array, row: Array | None = None) -> BranchPoint | None:
    """The point in the plane through unknowns u, across `row` or a point's tangent, that Newton finds from u."""
    row = _along(point) if row is None else row
    found = _corrected(point, row, float(row @ (u - point.unknowns)), u, point.slope)
    return None if found is None else _arrived(point, 0.0, found)


def bend(old: BranchPoint, new: BranchPoint) -> float:
    """How much the direction turns between two points."""
    return turned(new.weights, old.tangent, new.tangent)


def admissible(point: BranchPoint) -> bool:
    """Whether the engine, started on the orbit, meets the same events."""
    return _true(point.orbit)


def _true(orbit: Orbit) -> bool:
    return bool(np.all(orbit.tau > -1e-12 * orbit.period)) and is_met(orbit)


def locate(
    point: BranchPoint, far: BranchPoint, test: Callable[[BranchPoint], float], tolerance: float = 1e-10
) -> BranchPoint | None:
    """Where `test` changes its sign between a point and a later one of its sequence; see :func:`located`."""
    row = _along(point)

    def at(one: End[BranchPoint], other: End[BranchPoint], distance: float) -> BranchPoint | None:
        # The line through both values tells where, the cubic through both orbits with their tangents what it is like
        # there.
        return _between(point, row, one, other, distance) or step(point, distance)

    return located((0.0, point), (float(row @ (far.unknowns - point.unknowns)), far), test, at, tolerance)


def _between(
    point: BranchPoint, row: Array, one: tuple[float, BranchPoint], other: tuple[float, BranchPoint], distance: float
) -> BranchPoint | None:
    """The point at a distance from `point`, between two known ones: the cubic through both with their tangents."""
    (a, first), (b, last) = one, other
    share, whole = (distance - a) / (b - a), last.unknowns - first.unknowns
    begin, end = ((b - a) / float(row @ p.tangent) * p.tangent for p in (first, last))
    # Both tangents are scaled so that they cross the interval once: `share` runs from 0 to 1 between the two points.
    bent = (3.0 - 2.0 * share) * whole - (2.0 - share) * begin - (1.0 - share) * end
    u = first.unknowns + share * (begin + share * bent)
    found = _corrected(point, row, distance, u, first.slope + share * (last.slope - first.slope))
    return None if found is None else _arrived(point, distance, found)


def last_admissible(point: BranchPoint, ds: float, n_halvings: int = 20) -> tuple[BranchPoint, BranchPoint | None]:
    """Points on both sides of where the sequence of events ceases to be true.

    The second is None where all orbits up to the whole distance are true: what a step found there is of another branch.
    """
    a, inside, row, at_a = 0.0, point, _along(point), point.unknowns
    far = _corrected(point, row, ds, *point.ahead(ds))
    b, outside, at_b = ds, far, None if far is None else far.unknowns
    for _ in range(n_halvings):
        c = 0.5 * (a + b)
        # Bisection on what the engine says of the orbit: no function of the distance changes its sign there.
        u, slope = point.ahead(c)
        # Two known orbits predict a third one between them better than one orbit alone does, but where the far one,
        # which need not be true, is of another branch.
        found = _corrected(point, row, c, u if at_b is None else 0.5 * (at_a + at_b), slope)
        found = found or _corrected(point, row, c, *inside.ahead(c - a))
        if found is None or not _true(found.orbit):
            b = c
            if found is not None:
                outside, at_b = found, found.unknowns
        else:
            a, inside, at_a = c, _arrived(point, c, found), found.unknowns
    return inside, None if outside is None or b == ds else _arrived(point, b, outside)


def other_sequence(inside: BranchPoint, outside: BranchPoint) -> tuple[BranchPoint | None, bool]:
    """Beyond a change of the sequence: the orbit with the new one, and whether the branch turns back there.

    Just beyond a grazing contact the new visit grows like a root, and no step that the branch can take leads on from
    there: then the new sequence is taken up a little further on. So it is where the visit has no duration yet, but by
    rounding.
    """
    first: tuple[BranchPoint, bool] | None = None
    for new, turns_back in _others(inside, outside):
        if not regular(new):
            continue
        first = first or (new, turns_back)
        if not _same_sequence(new.orbit, first[0].orbit):
            continue
        # Beside the border the side on which the new orbit was found is rounding: where a step is not true there, the
        # branch goes to the other side.
        for begun, back in ((new, turns_back), (replace(new, tangent=-new.tangent), not turns_back)):
            led = step(begun, LEAST_STEP)
            if led is not None and not astray(begun, led) and admissible(led):
                return begun, back
    return first or (None, False)


def astray(point: BranchPoint, new: BranchPoint | None) -> bool:
    """Whether a step from a point has lost the branch: it turns, or has gone farther aside than ahead.

    The measure of the new orbit alone does not tell, for one that has collapsed to rest has another measure.
    """
    if new is None or bend(point, new) > _MOST_BEND:
        return True
    way, w = new.unknowns - point.unknowns, point.weights
    return bool(np.sum(w * way * way) > _MOST_LENGTH**2 * np.sum(w * point.tangent * way) ** 2)


def regular(point: BranchPoint) -> bool:
    """Whether the orbit has multipliers: where an element's input no longer moves as it switches, it has none.

    An orbit that has converged tells no slower movement: what is left of it is rounding.
    """
    if np.any(point.orbit.grazes(CONVERGED) & (point.orbit.arcs.event_sequence.at_once != 1)):
        return False
    try:
        return bool(np.all(np.isfinite(point.multipliers)))
    except np.linalg.LinAlgError:
        return False


def _others(inside: BranchPoint, outside: BranchPoint) -> Iterator[tuple[BranchPoint, bool]]:
    """Orbits beyond a change of the sequence, ever further on, and whether the branch turns back to them.

    At a grazing contact Newton's range shrinks to nothing, so the old sequence, though no longer true, is followed a
    little further until the new one can be closed from what the engine makes of it.
    """
    family = inside.family
    way = float(np.sign(inside.tangent[-1])) or 1.0
    for reach in (0.0, 1e-6, 1e-5, 1e-4, 1e-3, 5e-3, 2e-2):
        virtual = outside if reach == 0.0 else step(inside, reach)
        guess = None if virtual is None or is_met(virtual.orbit) else next_guess(virtual.orbit)
        if virtual is None or guess is None:
            continue
        for turns_back in (False, True):
            value = 2.0 * inside.value - virtual.value if turns_back else virtual.value
            found = _close_at(family, value, guess)
            if found is None or _same_sequence(found, inside.orbit) or not joins(found, value, inside):
                continue
            if turns_back and found.arcs.event_sequence.guards.size == inside.orbit.arcs.event_sequence.guards.size:
                continue
            # The old sequence, no longer true, may have turned already: the new orbit's own side tells the way to it.
            side = float(np.sign(value - inside.value)) or (-way if turns_back else way)
            yield make_point(family, value, found, None, side), side != way
        upright = _upright(inside, guess)
        if upright is not None:
            yield upright, False


def _upright(inside: BranchPoint, guess: Guess) -> BranchPoint | None:
    """The orbit of a new sequence where such orbits exist at one value alone: its start is held in place of the value.

    So it is where a loop becomes linear but for switches that go with its size (Clegg's integrator, a relay on a sum):
    cycles of all sizes, or none.
    """
    family = inside.family
    hybrid, guess = _at(family, inside.value, guess)
    like = evaluate(hybrid, guess.arcs(hybrid), guess.y, guess.tau)
    if not np.array_equal(like.arcs.free, inside.orbit.arcs.free):
        return None
    along = np.zeros(like.arcs.free.size + like.tau.size + 1)
    along[: like.arcs.free.size] = inside.tangent[: like.arcs.free.size]
    begun = BranchPoint(family, inside.value, like, family.slope(like, inside.value), along)
    found = _corrected(begun, _along(begun), 0.0, begun.unknowns, begun.slope)
    if found is None or not _true(found.orbit) or not joins(found.orbit, found.value, inside):
        return None
    new = make_point(family, found.value, found.orbit, along)
    return new if new.stands else None


def beyond(point: BranchPoint) -> tuple[BranchPoint | None, bool]:
    """Where Newton cannot go on with the old sequence (two events merge): the orbit with a new one a little further."""
    family, width = point.family, point.family.width
    sign = np.sign(point.tangent[-1]) or 1.0
    for turns_back in (False, True):
        way = -sign if turns_back else sign
        for share in (1e-7, 1e-6, 1e-5, 1e-4, 1e-3):
            value = point.value + way * share * width
            for guess in _guesses(point, value):
                found = _close_at(family, value, guess)
                if found is not None and not _same_sequence(found, point.orbit) and joins(found, value, point):
                    return make_point(family, value, found, None, way), turns_back
    return None, False


def _guesses(point: BranchPoint, value: float) -> Iterator[Guess]:
    """The orbit, and what the engine makes of it at another value: which events a visit that vanishes leaves."""
    yield point.orbit.guess
    made = None
    # The loop may not take the value, and a dead time that is nearly none takes the engine a step each.
    with suppress(EppError, BudgetExceeded), budget(_RUNS):
        made = next_guess(replace(point.orbit, hybrid=point.family.at(value)))
    if made is not None:
        yield made


def _close_at(family: Family, value: float, guess: Guess) -> Orbit | None:
    try:
        return close_orbit(*_at(family, value, guess))
    except EppError:
        return None


def _at(family: Family, value: float, guess: Guess) -> tuple[HybridSystem, Guess]:
    """The system at a value, and a guess with what the system itself sets in y (its inputs)."""
    hybrid = family.at(value)
    return hybrid, replace(guess, y=_with_inputs(hybrid, guess.y))


def _with_inputs(hybrid: HybridSystem, y: Array) -> Array:
    y = y.copy()
    y[hybrid.n_plant : hybrid.x0.size] = hybrid.x0[hybrid.n_plant :]
    return y


def _same_sequence(one: Orbit, other: Orbit) -> bool:
    return one.arcs.event_sequence.cyclic_key == other.arcs.event_sequence.cyclic_key


def joins(orbit: Orbit, value: float, border: BranchPoint) -> bool:
    """Whether an orbit of another sequence at a value is the branch's own beyond a border, and no other one near by.

    The branch is continuous: the nearer the border the more alike the orbits. Beside a grazing contact it bends like a
    root of the distance, and nowhere more.
    """
    way = abs(value - border.value) / border.family.width
    while way > LEAST_STEP:
        value = border.value + _NEARER * (value - border.value)
        nearer = solve(*_at(border.family, value, orbit.guess))
        if not nearer.residual < CONVERGED:
            break
        orbit, way = nearer, _NEARER * way
    return near(orbit, border.orbit, min(max(way, LEAST_STEP) ** 0.5, NEAR))
