"""Steady motions over one parameter, by pseudo-arclength: through folds, with what is special on the way.

The unknowns are what repeats at the start of a motion, and the parameter. Every step of Newton's method takes the
events that the engine meets, so a branch goes on where events come and go, as long as the map of a pass is smooth
enough. The derivative by the start is exact; that by the parameter is a difference of two passes: it steers the steps
and is in no answer, for a fold is where the exact derivative is singular (docs/theory/flow.md; Allgower and Georg,
Numerical Continuation Methods, 1990).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Protocol

import numpy as np

from eppanalysis.arrays import Array
from eppanalysis.errors import EppError, ModelError
from eppanalysis.methods.steady.changes import Change, left
from eppanalysis.methods.steady.closing import CLOSED
from eppanalysis.methods.steady.flow import advance, stacked
from eppanalysis.methods.steady.locate import End, located, solved, turned
from eppanalysis.methods.steady.motion import SteadyMotion
from eppanalysis.models.systems.hybrid import HybridSystem

#: Steps of the corrector, and the last one that counts as none, relative to the motion and the range.
_MOST_ITERATIONS, _STILL = 10, 1e-11
#: Change of the value, relative to the range, with which a corrector has gone astray.
_ASTRAY = 1.1
#: In how many steps of a corrector the derivative by the parameter is made anew, and for how small a change of it,
#: relative to the range.
_FRESH, _NEIGHBOUR = 2, 1e-7
#: Shortest step along a branch; how much the direction may turn in one, and below which the next one is longer.
_LEAST_STEP, _MOST_BEND, _LITTLE_BEND = 1e-5, 0.1, 0.02
#: Gap up to which a motion, begun elsewhere, is the same.
_CARRIED = 1e-6
#: Distance from where a place is foretold, relative to the step, up to which it is taken for one of the branch.
_MOST_MISSED = 0.02
#: Nearest that an event may come to the begin, relative to the longest stretch without events.
_NEAR_EVENT = 0.1
#: Size of the test for a fold or a change of stability that is zero.
_ZERO = 1e-9
#: Shares of the stretch in doubt, aside of where Newton's method fails, at which a place is tried.
_BESIDE = (1e-6, 1e-5, 1e-4, 1e-3, 1e-2)

#: How a branch ends within the range.
_NO_MORE = "ends where no periodic response continues it"
_CONTINUUM = "ends where periodic responses become a continuum, as an element that holds its output makes one"


class Family(Protocol):
    """What a branch runs over: a loop at each value of a parameter, whose motions last as long as something tells."""

    @property
    def limits(self) -> tuple[float, float]:
        """Between which values."""

    def at(self, value: float, like: HybridSystem) -> tuple[HybridSystem, float]:
        """The loop at a value, begun as another one, and how long its motions last [s]."""

    def alongside(self, value: float, start: HybridSystem, other: HybridSystem) -> Iterator[HybridSystem | None]:
        """Where a motion from a start comes to the phases of its drive at which another one begins."""


@dataclass(frozen=True, eq=False)
class Place:
    """A steady motion on a branch."""

    value: float
    motion: SteadyMotion
    #: (m + 1,): direction of (what repeats, value); of unit length in the branch's own measure.
    tangent: Array
    #: Distance, tangent and `singular` of the place from which this one was reached.
    before: tuple[float, Array, float] | None = None

    @property
    def stable(self) -> bool:
        """Whether all multipliers lie inside the unit circle."""
        return bool(self.motion.stable)

    @property
    def multiplier(self) -> float:
        """Largest magnitude of the multipliers; nan where there are none."""
        values = self.motion.multipliers
        return float("nan") if values is None else float(np.max(np.abs(values), initial=0.0))

    @cached_property
    def unknowns(self) -> Array:
        """What repeats, and the value, shape (m + 1,)."""
        return np.append(self.motion.begin, self.value)

    @cached_property
    def singular(self) -> float:
        """Product of (1 - multiplier): it passes zero where another branch meets this one, and at a fold."""
        return determinant(self.motion, -1.0)

    def foretells_zero(self, ds: float) -> bool:
        """Whether `singular`, gone on as from the place before to this one, has passed zero at a distance."""
        if self.before is None:
            return False
        # `singular` is the product of all 1 - mu: where it should have passed zero and has not, the step ended on
        # another response, as beyond a branch point (docs/theory/driven.md, Branches).
        before = self.before[2]
        return (self.singular + ds / self.before[0] * (self.singular - before)) * self.singular < 0.0

    def ahead(self, ds: float) -> Array:
        """Unknowns at a distance along the branch, as this place and the one before foretell them."""
        plain = self.unknowns + ds * self.tangent
        if self.before is None:
            return plain
        return plain + 0.5 * ds * ds / self.before[0] * (self.tangent - self.before[1])


def determinant(motion: SteadyMotion, sign: float) -> float:
    """Product of (multiplier + sign), but for what is held; it passes zero with any one of them."""
    # Smooth also where two multipliers meet and turn complex.
    moves = np.flatnonzero(~motion.held)
    return float(np.linalg.det(motion.matrix[np.ix_(moves, moves)] + sign * np.eye(moves.size)))


def width_of(family: Family) -> float:
    """Length of a range."""
    return family.limits[1] - family.limits[0]


def measure(motion: SteadyMotion, width: float) -> Array:
    """Weights of (what repeats, value), (m + 1,): mean square of the relative change, and the value over its range."""
    return np.append(1.0 / (motion.sought.size * motion.scale**2), 1.0 / width**2)


def _put(family: Family, motion: SteadyMotion, step: Array, value: float) -> SteadyMotion | None:
    """A motion after a step (m,) in what repeats, at another value; None where its run stops early."""
    here, duration = family.at(value, motion.start)
    longer = float(np.log(duration / motion.duration))
    return motion.moved(step[None], longer, lambda like: here.at(like.x0, like.H0, like.modes0))


def _slope(family: Family, motion: SteadyMotion, value: float) -> Array:
    """Derivative of what a motion misses by the value, its start held, (m,): by a pass with the same events if any."""
    events, slope = motion.passes[0].run.guard[motion.passes[0].events], np.full(motion.sought.size, np.nan)
    for change in (_NEIGHBOUR, -_NEIGHBOUR):
        change *= width_of(family)
        other = SteadyMotion.begun(*family.at(value + change, motion.start))
        if other is not None:
            slope = (other.misses[0] - motion.misses[0]) / change
            if np.array_equal(other.passes[0].run.guard[other.passes[0].events], events):
                break
    return slope


def _bordered(motion: SteadyMotion, slope: Array, row: Array, right: Array, width: float) -> Array:
    """Solve ``[[P - 1, slope], [row]] s = right`` in the sizes of the motion; nan where that has no numbers."""
    sizes, m = np.append(motion.scale, width), motion.sought.size
    K = np.empty((m + 1, m + 1))
    K[:m, :m], K[:m, m], K[m] = motion.matrix - np.eye(m), slope / motion.scale * width, row * sizes
    b = np.append(right[:m] / motion.scale, right[m])
    K[m], b[m] = K[m] / np.abs(K[m]).max(), b[m] / np.abs(K[m]).max()
    return solved(K, b) * sizes


def place(family: Family, value: float, motion: SteadyMotion, along: Array, slope: Array | None = None) -> Place:
    """A motion with the direction of its branch, turned along another direction (m + 1,)."""
    w, width = measure(motion, width_of(family)), width_of(family)
    slope = _slope(family, motion, value) if slope is None else slope
    # The motion stays closed along the tangent; of its multiples the one with a unit share of `along` is solved for.
    t = _bordered(motion, slope, w * along, np.append(np.zeros(motion.sought.size), 1.0), width)
    return Place(value, motion, t / np.sqrt(np.sum(w * t * t)))


@np.errstate(over="ignore", invalid="ignore")  # an iterate that has gone astray has an infinite gap
def corrected(family: Family, origin: Place, row: Array, distance: float, u: Array) -> Place | None:
    """Newton from u (m + 1,) to a motion with ``row @ (u - origin.unknowns) = distance``; None where it fails."""
    best, slope, width, now = np.inf, np.empty(0), width_of(family), origin.motion
    for i in range(_MOST_ITERATIONS):
        value = float(u[-1])
        if not abs(value - origin.value) < _ASTRAY * width:
            return None
        try:
            moved = _put(family, now, u[:-1] - now.begin, value)
            if moved is None or not moved.gap < 1e3:
                return None
            # What a pass does not depend on is as it ends.
            now, u = moved, np.append(moved.begin, value)
            slope = _slope(family, now, value) if i < _FRESH else slope
        except (EppError, ModelError, OverflowError):
            return None
        missed = row @ (u - origin.unknowns) - distance
        change = _bordered(now, slope, row, -np.append(now.misses[0], missed), width)
        size = float(np.max(np.abs(change[:-1]) / now.scale, initial=abs(change[-1]) / width))
        # Towards rounding the last steps no longer shrink.
        if now.gap < CLOSED and (size < _STILL or (i > 2 and size > 0.5 * best and size < 1e-6)):
            return place(family, value, now, origin.tangent, slope) if now.ends_in_its_modes else None
        if not np.isfinite(size) or (i > 4 and size > best):
            return None
        best, u = min(best, size), u + change
    return None


@dataclass
class Continuation:
    """One branch under way; lives for one call."""

    family: Family
    n_places: int
    max_step: float
    special: list[tuple[Change, Place, int]] = field(default_factory=list)

    def both_ways(self, value: float, motion: SteadyMotion) -> tuple[list[Place], tuple[str, str]]:
        """The branch through a motion: places in its own order, and how it ends at both ends."""
        first = self._begin(value, motion, 1.0 if value - self.family.limits[0] <= 0.5 * self._width else -1.0)
        ahead, why = self._along(first, self.n_places)
        if self._at_limit(value):
            return ahead, ("begins at the end of the range", why)
        forward, self.special = self.special, []
        back, other = self._along(replace(first, tangent=-first.tangent), max(2, self.n_places - len(ahead)))
        n = len(back) - 1
        backward = [(kind, there, n - i) for kind, there, i in self.special]
        self.special = backward[::-1] + [(kind, there, i + n) for kind, there, i in forward]
        return back[::-1][:-1] + ahead, (other, why)

    @property
    def _width(self) -> float:
        return width_of(self.family)

    def _begin(self, value: float, motion: SteadyMotion, way: float) -> Place:
        return place(self.family, value, motion, np.append(np.zeros(motion.sought.size), way))

    def _at_limit(self, value: float) -> bool:
        return min(abs(value - x) for x in self.family.limits) < 1e-9 * self._width

    def _along(self, first: Place, n_places: int) -> tuple[list[Place], str]:
        """Places from the first on in the direction of its tangent, until the range, the count or the branch ends."""
        places, ds, has_turned = [first], 0.25 * self.max_step, False
        while len(places) < n_places:
            old = places[-1] = self._moved_away(places[-1])
            new = self.step(old, ds)
            # A turn that the shortest step does not take away is a corner of the branch.
            shorter = ds if ds < _LEAST_STEP else 0.4 * ds
            end = None if new is None or self._doubtful(old, new, ds) else self._within(old, new)
            if end is None and shorter < ds:
                ds = shorter
                continue
            # Where branches meet a single motion has the multiplier 1, too: those of a continuum lie side by side.
            if old.motion.one_of_many and (new is None or new.motion.one_of_many):
                return places[:-1] or places, _CONTINUUM
            if new is None:
                turn = self._behind_corner(old, len(places))
                if not turn:
                    return places, _NO_MORE
                places += turn
                continue
            end = end or self._within(old, new)
            if end is None:
                return places, _NO_MORE
            out, new = end is not new, end
            places += [*self._special_between(old, new, len(places)), new]
            if out:
                return places, "leaves the range"
            has_turned = has_turned or new.tangent[-1] * first.tangent[-1] < 0.0
            if has_turned and len(places) > 10 and self._same(places[0], new):
                return places, "closes on itself"
            ds = min(2.0 * ds, self.max_step) if self._bend(old, new) < _LITTLE_BEND else ds
        return places, "stops at the given number of points"

    def _within(self, old: Place, new: Place) -> Place | None:
        """A place within the range, or for one beyond it that at the end; None where that one does not close."""
        low, high = self.family.limits
        return new if low <= new.value <= high else between(self.family, old, new, low if new.value < low else high)

    def step(self, old: Place, ds: float) -> Place | None:
        """The motion at a distance along the branch."""
        row = measure(old.motion, self._width) * old.tangent
        found = corrected(self.family, old, row, ds, old.ahead(ds))
        return None if found is None or ds == 0.0 else replace(found, before=(ds, old.tangent, old.singular))

    def _behind_corner(self, old: Place, index: int) -> list[Place]:
        """A corner that turns the branch back, as the place of that number, and the first place behind; [] for none.

        Events have another order there, as they have beyond it.
        """
        beyond = old.unknowns + _LEAST_STEP * old.tangent
        try:
            other = _put(self.family, old.motion, beyond[:-1] - old.motion.begin, float(beyond[-1]))
        except (EppError, ModelError):
            return []
        if other is None or not np.all(np.isfinite(other.matrix)):
            return []
        along = place(self.family, float(beyond[-1]), other, old.tangent).tangent
        w, ds = measure(old.motion, self._width), 10.0 * _LEAST_STEP
        for way in (along, -along):
            found = corrected(self.family, replace(old, tangent=way), w * way, ds, old.unknowns + ds * way)
            if found is not None and _apart(found, other) < _apart(found, old.motion):
                corner = self._meeting(old, found)
                if corner.tangent[-1] * found.tangent[-1] < 0.0:
                    self.special.append((Change.FOLD, corner, index))
                return [corner, found]
        return []

    def _meeting(self, old: Place, behind: Place) -> Place:
        """Where the directions of two places meet, on the side of the first; that one itself where nothing closes."""
        w = np.sqrt(measure(old.motion, self._width))
        both = np.column_stack([w * old.tangent, -w * behind.tangent])
        ahead = np.linalg.lstsq(both, w * (behind.unknowns - old.unknowns), rcond=None)[0][0]
        return self.step(old, float(ahead)) or old

    def _doubtful(self, old: Place, new: Place, ds: float) -> bool:
        """Whether a place may not be the next one of the branch."""
        return self._bend(old, new) > _MOST_BEND or self._missed(old, new, ds) or _passed_by(old, new, ds)

    def _missed(self, old: Place, new: Place, ds: float) -> bool:
        """Whether a place is not where the last ones foretold it: it may be on another branch close by."""
        away = new.unknowns - old.ahead(ds)
        w = measure(old.motion, self._width)
        return bool(np.sqrt(np.sum(w * away * away)) > _MOST_MISSED * ds)

    def _bend(self, old: Place, new: Place) -> float:
        """How much the direction turns between two places."""
        return turned(measure(new.motion, self._width), old.tangent, new.tangent)

    def _same(self, one: Place, other: Place) -> bool:
        """Whether the branch has come back to a place, whatever phase of its drive either begins at."""
        if abs(one.value - other.value) > 0.5 * self.max_step * self._width or one.tangent[-1] * other.tangent[-1] < 0:
            return False
        w, sought = measure(one.motion, self._width)[:-1], one.motion.sought
        return any(
            there is not None
            and np.sqrt(np.sum(w * (stacked(there)[sought] - one.motion.begin) ** 2)) < 0.5 * self.max_step
            for there in self.family.alongside(other.value, other.motion.start, one.motion.start)
        )

    def _moved_away(self, there: Place) -> Place:
        """The same motion begun elsewhere, where an event has come near to its begin."""
        (once,) = there.motion.passes
        stretches = np.diff(np.append(once.times, once.duration))
        at_begin = stretches[0] + stretches[-1]
        if stretches.size < 3 or stretches[[0, -1]].min() > _NEAR_EVENT * max(stretches[1:-1].max(), at_begin):
            return there
        moved = there.motion.placed(1)
        if moved is None or moved.gap > _CARRIED or not moved.ends_in_its_modes:
            return there
        # The direction is carried along: by the derivative of the way there, and by what another value does to it, its
        # begin and its end held at their shares of a pass.
        share, sought = float(there.motion.quiet(1)[0]) / once.duration, there.motion.sought
        way = advance(there.motion.start, share * once.duration)
        change = _NEIGHBOUR * self._width
        start, duration = self.family.at(there.value + change, there.motion.start)
        aside = advance(start, share * duration)
        if way is None or aside is None:
            return there
        ends = [stacked(one.run.end(one.start))[sought] for one in (way, aside)]
        along = way.derivative[np.ix_(sought, sought)] @ there.tangent[:-1]
        along += (ends[1] - ends[0]) / change * there.tangent[-1]
        if not np.all(np.isfinite(along)):
            return there
        return place(self.family, there.value, moved, np.append(along, there.tangent[-1]))

    def _special_between(self, old: Place, new: Place, index: int) -> list[Place]:
        """The fold or the change of stability between two places, which is noted as the place of that number."""
        if old.tangent[-1] * new.tangent[-1] < 0:
            # With stable motions on both sides it is a pair of mirror images that meets in a symmetric one.
            kind = Change.BRANCH_POINT if old.stable and new.stable else Change.FOLD
            found = self._located(old, new, lambda p: float(p.tangent[-1] / self._width))
        elif old.stable != new.stable:
            kind, test = _crossing(old, new)
            found = self._located(old, new, test)
        else:
            return []
        if found is None:
            return []
        self.special.append((kind, found, index - 1 if found is old else index))
        return [] if found is old or found is new else [found]

    def _located(self, old: Place, new: Place, test: Callable[[Place], float]) -> Place | None:
        """Where a test changes its sign between two places, or beside where Newton's method fails there."""
        failed: list[float] = []

        def at(one: End[Place], other: End[Place], distance: float) -> Place | None:
            found = self.step(old, distance)
            failed.extend([distance, other[0] - one[0]] if found is None else [])
            return found

        row = measure(old.motion, self._width) * old.tangent
        best = located((0.0, old), (float(row @ (new.unknowns - old.unknowns)), new), test, at, _ZERO)
        return (self._beside(old, *failed) if failed else None) or best

    def _beside(self, old: Place, c: float, width: float) -> Place | None:
        """The place nearest to a distance that Newton's method reaches: where branches meet, it does not converge."""
        near = (c + way * share * width for share in _BESIDE for way in (1.0, -1.0))
        return next((found for at in near if (found := self.step(old, at)) is not None), None)


def _apart(found: Place, motion: SteadyMotion) -> float:
    """How far the derivatives of two motions are apart."""
    return float(np.linalg.norm(found.motion.matrix - motion.matrix))


def _passed_by(old: Place, new: Place, ds: float) -> bool:
    """Whether two branches should have met between two places, and have not: the second may be on the other one.

    Where mirror images part from a symmetric motion, a step from one of them that misses where they meet ends on the
    symmetric one behind it: as stable, and hardly beside the prediction.
    """
    alike = old.singular * new.singular > 0.0 and old.tangent[-1] * new.tangent[-1] > 0.0
    return alike and old.foretells_zero(ds)


def motion_at(family: Family, near: Place, u: Array, value: float) -> Place | None:
    """The motion at a value, from unknowns u (m + 1,) nearby."""
    row = np.zeros(near.unknowns.size)
    row[-1] = 1.0 / width_of(family)
    return corrected(family, near, row, (value - near.value) / width_of(family), u)


def between(family: Family, one: Place, other: Place, value: float) -> Place | None:
    """The motion at a value between two neighbours on a branch."""
    share = (value - one.value) / (other.value - one.value) if other.value != one.value else 0.0
    near = one if share < 0.5 else other
    phase, there = (np.delete(p.motion.passes[0].y, p.motion.sought) for p in (one, other))
    u = near.unknowns.copy()
    if np.array_equal(phase, there):  # of the drive, at both begins
        u = one.unknowns + share * (other.unknowns - one.unknowns)
    u[-1] = value
    return motion_at(family, near, u, value)


def _crossing(old: Place, new: Place) -> tuple[Change, Callable[[Place], float]]:
    """Which way a multiplier crosses the unit circle, and the test function for it."""
    values = (new if not new.stable else old).motion.multipliers
    kind, _ = left(np.zeros(0, complex) if values is None else values)
    if kind is Change.TORUS:
        return kind, lambda p: p.multiplier - 1.0
    return kind, lambda p: determinant(p.motion, 1.0 if kind is Change.PERIOD_DOUBLING else -1.0)
