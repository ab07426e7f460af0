"""Branches of periodic responses over the frequency or the amplitude of the input: pseudo-arclength, through folds.

The unknowns are the state at a fixed phase of the input and the logarithm of the parameter. Every step of Newton's
method takes the events that the engine meets, so a branch runs on where events come and go as long as the map of the
state over the period is smooth enough (docs/theory/driven.md).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from eppanalysis.arrays import Array
from eppanalysis.errors import EppError, ModelError
from eppanalysis.methods.continuation.families import Family
from eppanalysis.methods.continuation.labels import determinant
from eppanalysis.methods.continuation.steps import bordered, turned, weights
from eppanalysis.methods.driven.closing import begun, ends_as_it_begins, passed
from eppanalysis.methods.driven.drive import Drive
from eppanalysis.methods.driven.result import Turning
from eppanalysis.methods.orbits.orbit import CONVERGED, Orbit
from eppanalysis.methods.orbits.shooting import restarted
from eppanalysis.methods.simulation.stability import is_stable
from eppanalysis.methods.steady.flow import away_from_events, later
from eppanalysis.models.systems.hybrid import HybridSystem

#: Steps of the corrector, and the last one that counts as none, relative to the motion and the range.
_MOST_ITERATIONS, _STILL = 10, 1e-9
#: Change of the value, relative to the range, with which a corrector has gone astray.
_ASTRAY = 1.1
#: In how many steps of a corrector the derivative by the parameter is made anew.
_FRESH = 2
#: Shortest step along a branch; how much the direction may turn in one, and below which the next one is longer.
_LEAST_STEP, _MOST_BEND, _LITTLE_BEND = 1e-5, 0.1, 0.02
#: Residual up to which a response, begun elsewhere, is the same.
_CARRIED = 1e-6
#: Distance from where a place is foretold, relative to the step, up to which it is taken for one of the branch.
_MOST_MISSED = 0.02
#: Nearest that an event may come to the begin, relative to the longest stretch without events.
_NEAR_EVENT = 0.1
#: Bisections and secants on the way to a fold or to a change of stability, and the size of the test that is zero.
_MOST_LOCATED, _ZERO = 60, 1e-9
#: Shares of the stretch in doubt, aside of where Newton's method fails, at which a place is tried.
_BESIDE = (1e-6, 1e-5, 1e-4, 1e-3, 1e-2)


#: How a branch ends within the range.
_NO_MORE = "ends where no periodic response continues it"
_CONTINUUM = "ends where periodic responses become a continuum, as an element that holds its output makes one"


@dataclass(frozen=True, eq=False)
class ResponseFamily:
    """What a branch runs over: the drive at each value of the logarithm of its parameter, between two of them."""

    drive: Callable[[float], Drive]  # from the value to the drive
    limits: tuple[float, float]
    stretch: float  # derivative of the logarithm of the input's period by the value
    multiple: int = 1  # periods of the input after which what is driven repeats itself

    @property
    def width(self) -> float:
        """Length of the range."""
        return self.limits[1] - self.limits[0]

    @cached_property
    def _systems(self) -> Family:
        return Family(lambda value: self.drive(value).hybrid, self.limits)

    def slope(self, orbit: Orbit, value: float) -> Array:
        """Derivative of the residual by the value, at fixed unknowns and events."""
        by = self._systems.slope(orbit, value)
        # The last equation says that the arcs together take the time after which all repeats itself.
        by[-1] -= self.stretch * self.multiple * self.drive(value).period
        return by

    def at(self, value: float, like: HybridSystem) -> tuple[HybridSystem, float]:
        """The system, begun as another one, and the time after which what it does repeats itself [s]."""
        drive = self.drive(value)
        start = replace(drive.hybrid, x0=like.x0, H0=like.H0, modes0=like.modes0)
        return start, self.multiple * drive.period


@dataclass(frozen=True, eq=False)
class ResponsePoint:
    """A periodic response on a branch."""

    value: float  # logarithm of the parameter
    orbit: Orbit
    #: (N + 1,): direction of (start y, value), zero where y is not free; of unit length in the branch's own measure.
    tangent: Array
    #: Distance, tangent and `singular` of the place from which this one was reached.
    before: tuple[float, Array, float] | None = None

    @cached_property
    def stable(self) -> bool:
        """Whether all multipliers lie inside the unit circle."""
        return is_stable(self.orbit.multipliers, self.orbit.one_of_many)

    @cached_property
    def unknowns(self) -> Array:
        """Start and value, shape (N + 1,)."""
        return np.append(self.orbit.y, self.value)

    @cached_property
    def singular(self) -> float:
        """Product of (1 - multiplier): it passes zero where another branch meets this one, and at a fold."""
        return float(np.prod(1.0 - self.orbit.multipliers).real)

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


def measure(orbit: Orbit, width: float) -> Array:
    """Weights of (start y, value), shape (N + 1,): mean square of the relative change, and the value over its range."""
    w, m = weights(orbit, width), orbit.arcs.free.size
    whole = np.zeros(orbit.y.size + 1)
    whole[orbit.arcs.free], whole[-1] = w[:m], w[-1]
    return whole


def place(road: ResponseFamily, value: float, orbit: Orbit, along: Array, slope: Array | None = None) -> ResponsePoint:
    """A response with the direction of its branch, turned along another direction (N + 1,)."""
    w = measure(orbit, road.width)
    slope = road.slope(orbit, value) if slope is None or slope.size != orbit.r.size else slope
    m, p = orbit.arcs.free.size, orbit.tau.size
    row, right = np.zeros(m + p + 1), np.zeros(m + p + 1)
    # The equations do not change along the tangent; of all its
    # multiples the one with a unit share of `along` is solved for.
    row[:m], row[-1], right[-1] = (w * along)[orbit.arcs.free], (w * along)[-1], 1.0
    t = bordered(orbit, slope, row, right)
    tangent = np.zeros(w.size)
    tangent[orbit.arcs.free], tangent[-1] = t[:m], t[-1]
    return ResponsePoint(value, orbit, tangent / np.sqrt(np.sum(w * tangent * tangent)))


@np.errstate(over="ignore", invalid="ignore")  # an iterate that has gone astray has an infinite residual
def corrected(
    road: ResponseFamily, origin: ResponsePoint, row: Array, distance: float, u: Array
) -> ResponsePoint | None:
    """Newton from u (N + 1,) to a response with ``row @ (u - origin.unknowns) = distance``; None where it fails."""
    best, modes, slope = np.inf, origin.orbit.arcs.event_sequence.modes[0], np.zeros(0)
    for i in range(_MOST_ITERATIONS):
        if not abs(u[-1] - origin.value) < _ASTRAY * road.width:
            return None
        like = restarted(origin.orbit.hybrid, origin.orbit.arcs, u[:-1], modes)
        try:
            orbit = passed(*road.at(float(u[-1]), like))
            if orbit is None or not orbit.residual < 1e3:
                return None
            if i < _FRESH or slope.size != orbit.r.size:
                slope = road.slope(orbit, float(u[-1]))
        except (EppError, ModelError, OverflowError):
            return None
        free, p = orbit.arcs.free, orbit.tau.size
        right = -np.concatenate([orbit.r, [row @ (u - origin.unknowns) - distance]])
        change = bordered(orbit, slope, np.concatenate([row[free], np.zeros(p), row[-1:]]), right)
        size = float(np.max(np.abs(change[: free.size]) / orbit.scale[free], initial=abs(change[-1]) / road.width))
        # Towards rounding the last steps no longer shrink.
        if orbit.residual < CONVERGED and (size < _STILL or (i > 2 and size > 0.5 * best and size < 1e-6)):
            found = ends_as_it_begins(orbit)
            return place(road, float(u[-1]), orbit, origin.tangent, slope) if found else None
        if not np.isfinite(size) or (i > 4 and size > best):
            return None
        best, u = min(best, size), u.copy()
        u[free] += change[: free.size]
        u[-1] += change[-1]
    return None


@dataclass
class ResponseContinuation:
    """One branch under way; lives for one call."""

    road: ResponseFamily
    n_places: int
    max_step: float
    special: list[tuple[Turning, ResponsePoint, int]] = field(default_factory=list)

    def both_ways(self, value: float, orbit: Orbit) -> tuple[list[ResponsePoint], tuple[str, str]]:
        """The branch through a response: places in its own order, and how it ends at both ends."""
        first = self._begin(value, orbit, 1.0 if value - self.road.limits[0] <= 0.5 * self.road.width else -1.0)
        ahead, why = self._along(first, self.n_places)
        if self._at_limit(value):
            return ahead, ("begins at the end of the range", why)
        forward, self.special = self.special, []
        back, other = self._along(replace(first, tangent=-first.tangent), max(2, self.n_places - len(ahead)))
        n = len(back) - 1
        turned = [(kind, there, n - i) for kind, there, i in self.special]
        self.special = turned[::-1] + [(kind, there, i + n) for kind, there, i in forward]
        return back[::-1][:-1] + ahead, (other, why)

    def _begin(self, value: float, orbit: Orbit, way: float) -> ResponsePoint:
        along = np.zeros(orbit.y.size + 1)
        along[-1] = way
        return place(self.road, value, orbit, along)

    def _at_limit(self, value: float) -> bool:
        return min(abs(value - x) for x in self.road.limits) < 1e-9 * self.road.width

    def _along(self, first: ResponsePoint, n_places: int) -> tuple[list[ResponsePoint], str]:
        """Places from the first on in the direction of its tangent, until the range, the count or the branch ends."""
        places, ds, turned = [first], 0.25 * self.max_step, False
        while len(places) < n_places:
            old = places[-1] = self._moved_away(places[-1], places[-2:-1])
            new = self.step(old, ds)
            shorter = ds if ds < _LEAST_STEP else 0.4 * ds
            if shorter < ds and (new is None or self._doubtful(old, new, ds)):
                ds = shorter
                continue
            if new is None:
                return places, _NO_MORE
            # A turn that the shortest step does not take away is a corner of the branch.
            if new.orbit.one_of_many:
                return places, _CONTINUUM
            low, high = self.road.limits
            out = not low <= new.value <= high
            if out:
                end = between(self.road, old, new, low if new.value < low else high)
                if end is None:
                    ds *= 0.4
                    if ds < _LEAST_STEP:
                        return places, _NO_MORE
                    continue
                new = end
            places += [*self._special_between(old, new, len(places)), new]
            if out:
                return places, "leaves the range"
            turned = turned or new.tangent[-1] * first.tangent[-1] < 0.0
            if turned and len(places) > 10 and self._same(places[0], new):
                return places, "closes on itself"
            ds = min(1.5 * ds, self.max_step) if self._bend(old, new) < _LITTLE_BEND else ds
        return places, "stops at the given number of points"

    def step(self, old: ResponsePoint, ds: float) -> ResponsePoint | None:
        """The response at a distance along the branch."""
        row = measure(old.orbit, self.road.width) * old.tangent
        found = corrected(self.road, old, row, ds, old.ahead(ds))
        return None if found is None or ds == 0.0 else replace(found, before=(ds, old.tangent, old.singular))

    def _doubtful(self, old: ResponsePoint, new: ResponsePoint, ds: float) -> bool:
        """Whether a place may not be the next one of the branch."""
        return self._bend(old, new) > _MOST_BEND or self._missed(old, new, ds) or _passed_by(old, new, ds)

    def _missed(self, old: ResponsePoint, new: ResponsePoint, ds: float) -> bool:
        """Whether a place is not where the last ones foretold it: it may be on another branch close by."""
        away = new.unknowns - old.ahead(ds)
        w = measure(old.orbit, self.road.width)
        return bool(np.sqrt(np.sum(w * away * away)) > _MOST_MISSED * ds)

    def _bend(self, old: ResponsePoint, new: ResponsePoint) -> float:
        """How much the direction turns between two places."""
        return turned(measure(new.orbit, self.road.width), old.tangent, new.tangent)

    def _same(self, one: ResponsePoint, other: ResponsePoint) -> bool:
        """Whether the branch has come back to a place, whatever phase of the input either begins at."""
        if abs(one.value - other.value) > 0.5 * self.max_step * self.road.width:
            return False
        drive = self.road.drive(other.value)
        ahead = (drive.phase(one.orbit.y) - drive.phase(other.orbit.y)) % (2.0 * np.pi)
        there = later(begun(other.orbit), ahead / drive.omega)
        if there is None or one.tangent[-1] * other.tangent[-1] < 0:
            return False
        w, away = measure(one.orbit, self.road.width), np.append(there.x0, there.H0) - one.orbit.y
        return bool(np.sqrt(np.sum(w[:-1] * away * away)) < 0.5 * self.max_step)

    def _moved_away(self, there: ResponsePoint, before: list[ResponsePoint]) -> ResponsePoint:
        """The same response begun at another phase of the input, where an event has come near to its begin."""
        tau = there.orbit.tau
        if tau.size < 3 or min(tau[0], tau[-1]) > _NEAR_EVENT * max(float(tau[1:-1].max()), tau[0] + tau[-1]):
            return there
        placed = away_from_events(begun(there.orbit), there.orbit.period)
        moved = None if placed is None else passed(placed, there.orbit.period)
        if moved is None or moved.residual > _CARRIED or not ends_as_it_begins(moved):
            return there
        along = np.zeros(moved.y.size + 1)
        along[-1] = there.tangent[-1]
        if before:  # the direction is that from the place before, carried along for as long
            drive = self.road.drive(there.value)
            ahead = (drive.phase(moved.y) - drive.phase(there.orbit.y)) % (2.0 * np.pi)
            aside = later(begun(before[0].orbit), ahead / self.road.drive(before[0].value).omega)
            if aside is not None:
                along = np.append(moved.y - np.append(aside.x0, aside.H0), there.value - before[0].value)
        return place(self.road, there.value, moved, along)

    def _special_between(self, old: ResponsePoint, new: ResponsePoint, index: int) -> list[ResponsePoint]:
        """The fold or the change of stability between two places, which is noted as the place of that number."""
        if old.tangent[-1] * new.tangent[-1] < 0:
            # With stable responses on both sides it is a pair of mirror images that meets in a symmetric one.
            kind = Turning.BRANCH_POINT if old.stable and new.stable else Turning.FOLD
            found = self._located(old, new, lambda p: float(p.tangent[-1] / self.road.width))
        elif old.stable != new.stable:
            kind, test = _crossing(old, new)
            found = self._located(old, new, test)
        else:
            return []
        if found is None:
            return []
        self.special.append((kind, found, index - 1 if found is old else index))
        return [] if found is old or found is new else [found]

    def _located(
        self, old: ResponsePoint, new: ResponsePoint, test: Callable[[ResponsePoint], float]
    ) -> ResponsePoint | None:
        """Where a test changes its sign between two places, by regula falsi (Illinois)."""
        row = measure(old.orbit, self.road.width) * old.tangent
        a, f_a, b, f_b = 0.0, test(old), float(row @ (new.unknowns - old.unknowns)), test(new)
        if f_a * f_b > 0:
            return None
        best, least = (old, abs(f_a)) if abs(f_a) < abs(f_b) else (new, abs(f_b))
        for _ in range(_MOST_LOCATED):
            c = (a * f_b - b * f_a) / (f_b - f_a)
            found = self.step(old, c)
            if found is None:
                return self._beside(old, c, b - a) or best
            f_c = test(found)
            if abs(f_c) < least:
                best, least = found, abs(f_c)
            if least < _ZERO or abs(b - a) < 1e-13:
                return best
            # Illinois: the end that stays counts half, or all secants would come from one side.
            if f_c * f_b > 0:
                b, f_b, f_a = c, f_c, 0.5 * f_a
            else:
                a, f_a, b, f_b = b, f_b, c, f_c
        return best

    def _beside(self, old: ResponsePoint, c: float, width: float) -> ResponsePoint | None:
        """The place nearest to a distance that Newton's method reaches: where branches meet, it does not converge."""
        near = (c + way * share * width for share in _BESIDE for way in (1.0, -1.0))
        return next((found for at in near if (found := self.step(old, at)) is not None), None)


def _passed_by(old: ResponsePoint, new: ResponsePoint, ds: float) -> bool:
    """Whether two branches should have met between two places, and have not: the second may be on the other one.

    Where mirror images part from a symmetric response, a step from one of them that misses where they meet ends on the
    symmetric response behind it: as stable, and hardly beside the prediction.
    """
    alike = old.singular * new.singular > 0.0 and old.tangent[-1] * new.tangent[-1] > 0.0
    return alike and old.foretells_zero(ds)


def response_at(road: ResponseFamily, near: ResponsePoint, u: Array, value: float) -> ResponsePoint | None:
    """The response at a value, from unknowns u (N + 1,) nearby."""
    row = np.zeros(near.unknowns.size)
    row[-1] = 1.0 / road.width
    return corrected(road, near, row, (value - near.value) / road.width, u)


def between(road: ResponseFamily, one: ResponsePoint, other: ResponsePoint, value: float) -> ResponsePoint | None:
    """The response at a value between two neighbours on a branch."""
    share = (value - one.value) / (other.value - one.value) if other.value != one.value else 0.0
    near = one if share < 0.5 else other
    drive, u = road.drive(value), near.unknowns.copy()
    if abs(drive.phase(one.orbit.y) - drive.phase(other.orbit.y)) < 1e-9:
        u = one.unknowns + share * (other.unknowns - one.unknowns)
    u[-1] = value
    return response_at(road, near, u, value)


def _crossing(old: ResponsePoint, new: ResponsePoint) -> tuple[Turning, Callable[[ResponsePoint], float]]:
    """Which way a multiplier crosses the unit circle, and the test function for it."""
    values = (new if not new.stable else old).orbit.multipliers
    # Multipliers are sorted, so that the last one outside is the nearest to the circle: the one that has just crossed.
    leading = values[np.abs(values) >= 1.0][-1]
    if abs(leading.imag) > 1e-9:
        return Turning.TORUS, lambda p: float(np.max(np.abs(p.orbit.multipliers))) - 1.0
    sign = 1.0 if leading.real < 0 else -1.0
    return (Turning.PERIOD_DOUBLING if sign > 0 else Turning.BRANCH_POINT), lambda p: determinant(p.orbit, sign)
