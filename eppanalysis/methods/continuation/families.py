"""The hybrid system as a function of one parameter, cheap enough for thousands of values; its derivative.

The numbers in a system's arrays are analytic functions of a parameter, so that polynomials over the range, of a degree
at which they agree with the system itself to rounding, replace it. Where none do (a parameter that changes the
structure), the system is built each time. The arrays of an orbit's arcs are such functions, too: the derivatives of
their polynomials are those that folds and bounds need (docs/theory/exact_orbits.md, Derivatives by a parameter).
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field, replace

import numpy as np

from eppanalysis.arrays import Array
from eppanalysis.errors import EppError
from eppanalysis.methods.orbits.arcs import Arcs
from eppanalysis.methods.orbits.orbit import Orbit, residual_slope
from eppanalysis.models.systems.hybrid import HybridSystem
from eppanalysis.polynomials import Polynomial, constant, polynomial, polynomial_at

#: Largest difference of a system from its polynomials, relative to the largest value of an entry over the range.
_AGREEMENT = 4e-15
#: Lengths of the range that is interpolated over, relative to the one given.
_REACHES = (1.02, 0.98)
#: Parts of it over which the arcs of an orbit are polynomials: a sequence of events is rarely that of the whole range.
_PARTS = 6
_CHECKED = (-0.93, -0.41, 0.13, 0.58, 0.97)


@dataclass(frozen=True, eq=False)
class _StandIn:
    """A system whose arrays are polynomials of the parameter."""

    base: HybridSystem  # at one value
    numbers: Polynomial  # all arrays in one vector
    places: dict[str, slice]  # where in the vector those arrays are that vary

    @classmethod
    def of(cls, base: HybridSystem, numbers: Polynomial) -> _StandIn:
        """From the numbers of a system and the system at one value."""
        names = _arrays(base)
        marks = np.cumsum([0, *(_array(base, name).size for name in names)]).tolist()
        varies = np.zeros(marks[-1], bool)
        varies[numbers.places] = True
        spans = {name: slice(a, b) for name, a, b in zip(names, marks, marks[1:], strict=False)}
        return cls(base, numbers, {name: span for name, span in spans.items() if varies[span].any()})

    def at(self, value: float) -> HybridSystem:
        """The system at a value."""
        flat = self.numbers.at(value)
        changed = {name: flat[span].reshape(_array(self.base, name).shape) for name, span in self.places.items()}
        x0, H0 = changed.pop("x0", self.base.x0), changed.pop("H0", self.base.H0)
        return replace(self.base, model=self.base.model._replace(**changed), x0=x0, H0=H0)


@dataclass(eq=False)
class Family:
    """The hybrid system at each value of a parameter between two limits."""

    build: Callable[[float], HybridSystem]  # from the value (SI) to the system
    limits: tuple[float, float]
    window: tuple[float, float] | None = None  # where the polynomials are wanted, if in a small part of the range
    patience: int = 7  # how many systems are built before it is made
    _stand_in: _StandIn | None = field(default=None, init=False)
    _asked: int = field(default=0, init=False)
    _arcs: dict[tuple[bytes, tuple[float, float] | None], Polynomial] = field(default_factory=dict, init=False)

    @property
    def width(self) -> float:
        """Length of the range."""
        return abs(self.limits[1] - self.limits[0])

    def at(self, value: float) -> HybridSystem:
        """The system at a value (SI), equal to the built one to rounding."""
        stand_in = self._standing_in(value)
        return self.build(value) if stand_in is None else stand_in.at(value)

    def _standing_in(self, value: float) -> _StandIn | None:
        """The polynomials in place of the system at a requested value; None where there are none."""
        self._asked += 1
        if self._asked == self.patience + 1:
            self._stand_in = interpolate(self.build, *(self.window or self.limits))
        return self._stand_in if self._stand_in is not None and self._stand_in.numbers.covers(value) else None

    def slope(self, orbit: Orbit, value: float) -> Array:
        """Derivative of the residual of an orbit's equations by the parameter, at fixed unknowns and events.

        Raises
        ------
        EppError
            If the parameter changes the structure of the loop at the value.
        """
        # A derivative is followed by more: the polynomials pay at once.
        self._asked = max(self._asked, self.patience) if self.patience > 0 else self._asked
        part = self._part(value)
        key = orbit.arcs.event_sequence.key, part
        known = self._arcs.get(key)
        if known is None or not known.covers(value):
            known = self._arcs[key] = _arcs_over(self.at, orbit, value, self.width, part)
        return _slope_from(orbit, known, value)

    def numbers(self, value: float, arcs: Arcs) -> Polynomial:
        """The numbers of arcs over a part of the range that holds a value, or at that value alone."""
        known = self._arcs.get((arcs.event_sequence.key, self._part(value)))
        if known is not None and known.covers(value):
            return known
        hybrid = self.at(value)
        return constant(_flat_numbers(hybrid, Arcs.build(hybrid, arcs.event_sequence, arcs)), value)

    def _part(self, value: float) -> tuple[float, float] | None:
        """The part of the range of the polynomials that a value is in; None where it is in none."""
        stand_in = self._standing_in(value)
        if stand_in is None:
            return None
        numbers = stand_in.numbers
        length = 2.0 * numbers.half / _PARTS
        k = min(max(int((value - numbers.middle + numbers.half) / length), 0), _PARTS - 1)
        low = numbers.middle - numbers.half + k * length
        return low, low + length


def slope_of(build: Callable[[float], HybridSystem], orbit: Orbit, value: float, size: float) -> Array:
    """Derivative of the residual of an orbit's equations by any parameter, of which `size` is a large change.

    Raises
    ------
    EppError
        If the parameter changes the structure of the loop at the value.
    """
    return _slope_from(orbit, _arcs_over(build, orbit, value, size), value)


def _arcs_over(
    at: Callable[[float], HybridSystem],
    orbit: Orbit,
    value: float,
    size: float,
    limits: tuple[float, float] | None = None,
) -> Polynomial:
    """The numbers of an orbit's arcs as polynomials: between two limits, or about the value."""
    like = orbit.arcs

    def numbers(v: float) -> Array | None:
        hybrid = at(v)
        # Modes and guards of an orbit are numbers of rows: in a system of another structure they are none.
        if not _same_structure(orbit.hybrid, hybrid):
            return None
        return _flat_numbers(hybrid, Arcs.build(hybrid, like.event_sequence, like))

    found = None
    if limits is not None:
        with suppress(EppError):
            found = polynomial(numbers, *limits)
    found = found or polynomial_at(numbers, value, size)
    if found is None:
        raise EppError(f"The loop changes its structure at {value:g} of the parameter; expected another value.")
    return found


def _numbers_of(hybrid: HybridSystem, arcs: Arcs) -> tuple[Array, ...]:
    """What an orbit's equations depend on: its arcs, and the values of the loop's inputs."""
    c = arcs.channels
    smooth = c.smooth_x, c.smooth_H, c.smooth_s, c.smooth_scale
    return arcs.F, arcs.S, arcs.g, arcs.gs, arcs.J, arcs.shift, *smooth, hybrid.x0[hybrid.n_plant :]


def _flat_numbers(hybrid: HybridSystem, arcs: Arcs) -> Array:
    return np.concatenate([a.ravel() for a in _numbers_of(hybrid, arcs)])


def _slope_from(orbit: Orbit, numbers: Polynomial, value: float) -> Array:
    like, slopes, at = _numbers_of(orbit.hybrid, orbit.arcs), [], 0
    flat = numbers.slope(value)
    for array in like:
        slopes.append(flat[at : at + array.size].reshape(array.shape))
        at += array.size
    F, S, g, gs, J, shift, x, H, s, scale, inputs = slopes
    channels = orbit.arcs.channels._replace(smooth_x=x, smooth_H=H, smooth_s=s, smooth_scale=scale)
    change = replace(orbit.arcs, F=F, S=S, g=g, gs=gs, J=J, shift=shift, channels=channels)
    start = np.zeros(orbit.y.size)
    start[orbit.hybrid.n_plant : orbit.hybrid.x0.size] = inputs
    return residual_slope(orbit, change, start)


def interpolate(build: Callable[[float], HybridSystem], low: float, high: float) -> _StandIn | None:
    """The polynomials over a range a little wider than given; None when the system's structure changes in it.

    Where the system refuses values beyond the range (a backlash from zero on), it is one over a little less of it.
    """
    for reach in _REACHES:
        with suppress(EppError):
            return _stand_in(build, 0.5 * (low + high), 0.5 * abs(high - low) * reach)
    return None


def _stand_in(build: Callable[[float], HybridSystem], middle: float, half: float) -> _StandIn | None:
    """The polynomials that agree with the system to rounding, if there is one."""
    checks = [build(middle + u * half) for u in _CHECKED]
    first = checks[0]

    def numbers(value: float) -> Array | None:
        hybrid = build(value)
        return _flat(hybrid) if _same_structure(first, hybrid) else None

    if not all(_same_structure(first, other) for other in checks[1:]):
        return None
    found = polynomial(numbers, middle - half, middle + half)
    if found is None:
        return None
    limit = np.zeros(found.base.size)
    limit[found.places] = _AGREEMENT * np.abs(found.coefficients).sum(axis=0) + found.noise
    for u, exact in zip(_CHECKED, checks, strict=True):
        if np.any(np.abs(found.at(middle + u * half) - _flat(exact)) > limit):
            return None
    return _StandIn.of(first, found)


def _flat(hybrid: HybridSystem) -> Array:
    return np.concatenate([_array(hybrid, name).ravel() for name in _arrays(hybrid)])


def _arrays(hybrid: HybridSystem) -> list[str]:
    model = hybrid.model
    return ["x0", "H0", *(n for n in model._fields if getattr(model, n).dtype.kind == "f")]


def _array(hybrid: HybridSystem, name: str) -> Array:
    return getattr(hybrid, name) if name in ("x0", "H0") else getattr(hybrid.model, name)


def _same_structure(one: HybridSystem, other: HybridSystem) -> bool:
    kinds = ([type(e) for e in h.elements] for h in (one, other))
    if one.element_names != other.element_names or next(kinds) != next(kinds):
        return False
    for name in one.model._fields:
        a, b = getattr(one.model, name), getattr(other.model, name)
        if a.shape != b.shape or (a.dtype.kind != "f" and not np.array_equal(a, b)):
            return False
    return one.x0.shape == other.x0.shape and np.array_equal(one.compared, other.compared)
