"""The hybrid system as a function of one parameter, cheap enough to be asked for thousands of times.

The numbers in a system's arrays are analytic functions of a parameter, so a Chebyshev interpolant over the range, of
a degree at which it agrees with the system itself to rounding, stands in for it. Where none does (a parameter that
changes the structure), the system is built each time.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import NDArray

from eppanalysis.errors import EppError
from eppanalysis.models.systems.hybrid import HybridSystem

Array = NDArray[np.float64]

_DEGREES = (4, 8, 16, 32)
_AGREEMENT = 4e-15
#: Lengths of the range that is interpolated over, relative to the one given.
_REACHES = (1.02, 0.98)
_CHECKED = (-0.93, -0.41, 0.13, 0.58, 0.97)


@dataclass(frozen=True, eq=False)
class _Interpolant:
    """Chebyshev coefficients of the entries that vary, over ``middle +- half``."""

    base: HybridSystem
    names: tuple[str, ...]
    places: tuple[NDArray[np.intp], ...]
    coefficients: tuple[Array, ...]
    middle: float
    half: float

    def at(self, value: float) -> HybridSystem:
        """The system at a value."""
        # Chebyshev polynomials as cosines: the place stays inside the range, which is a little wider than asked for.
        angle = np.arccos(np.clip((value - self.middle) / self.half, -1.0, 1.0))
        row = np.cos(angle * np.arange(self.coefficients[0].shape[0] if self.coefficients else 1))
        changed = {}
        for name, places, c in zip(self.names, self.places, self.coefficients, strict=True):
            array = _array(self.base, name).copy()
            array.ravel()[places] = row @ c
            changed[name] = array
        x0, H0 = changed.pop("x0", self.base.x0), changed.pop("H0", self.base.H0)
        return replace(self.base, model=self.base.model._replace(**changed), x0=x0, H0=H0)


@dataclass(eq=False)
class Family:
    """The hybrid system at each value of a parameter between two limits.

    Attributes
    ----------
    build : callable
        From the value (SI) to the system.
    limits : (float, float)
    window : (float, float), optional
        Where the interpolant is wanted, when that is a small part of the range.
    patience : int
        How many systems are built before it is made.
    """

    build: Callable[[float], HybridSystem]
    limits: tuple[float, float]
    window: tuple[float, float] | None = None
    patience: int = 7
    _stand_in: _Interpolant | None = field(default=None, init=False)
    _asked: int = field(default=0, init=False)

    @property
    def width(self) -> float:
        """Length of the range."""
        return abs(self.limits[1] - self.limits[0])

    def at(self, value: float) -> HybridSystem:
        """The system at a value (SI), equal to the built one to rounding."""
        self._asked += 1
        if self._asked == self.patience + 1:
            self._stand_in = interpolate(self.build, *(self.window or self.limits))
        if self._stand_in is None or abs(value - self._stand_in.middle) > self._stand_in.half:
            return self.build(value)
        return self._stand_in.at(value)


def interpolate(build: Callable[[float], HybridSystem], low: float, high: float) -> _Interpolant | None:
    """The interpolant over a range a little wider than given; None when the system's structure changes in it.

    Where the system refuses values beyond the range (a backlash from zero on), it is one over a little less of it.
    """
    for reach in _REACHES:
        with suppress(EppError):
            return _interpolant(build, 0.5 * (low + high), 0.5 * abs(high - low) * reach)
    return None


def _interpolant(build: Callable[[float], HybridSystem], middle: float, half: float) -> _Interpolant | None:
    """The interpolant of the least degree that agrees with the system to rounding, if there is one."""
    checks = [build(middle + u * half) for u in _CHECKED]
    built: dict[float, HybridSystem] = {}
    for degree in _DEGREES:
        # The extrema of a Chebyshev polynomial are among those of one of twice the degree.
        nodes = np.cos(np.pi * np.arange(degree + 1) / degree)
        keys = [k / degree for k in range(degree + 1)]
        built |= {k: build(middle + half * float(u)) for k, u in zip(keys, nodes, strict=True) if k not in built}
        systems = [built[k] for k in keys]
        if not all(_same_structure(checks[0], s) for s in [*systems, *checks]):
            return None
        found = _fit(nodes, systems, middle, half)
        if all(_agree(found, middle + u * half, exact) for u, exact in zip(_CHECKED, checks, strict=True)):
            return found
    return None


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


def _fit(nodes: Array, systems: list[HybridSystem], middle: float, half: float) -> _Interpolant:
    degree = nodes.size - 1
    # The discrete cosine transform at Chebyshev's extrema: the first and last node, and the first and last coefficient,
    # count half.
    to_coefficients = chebyshev.chebvander(nodes, degree).T * (2.0 / degree)
    for ends in (np.s_[[0, -1]], np.s_[:, [0, -1]]):
        to_coefficients[ends] /= 2.0
    names, places, coefficients = [], [], []
    for name in _arrays(systems[0]):
        stack = np.array([_array(s, name).ravel() for s in systems])
        varies = np.flatnonzero(np.any(stack != stack[0], axis=0)) if stack.size else np.zeros(0, np.int64)
        if varies.size:
            names.append(name)
            places.append(varies)
            coefficients.append(to_coefficients @ stack[:, varies])
    return _Interpolant(systems[0], tuple(names), tuple(places), tuple(coefficients), middle, half)


def _agree(found: _Interpolant, value: float, exact: HybridSystem) -> bool:
    """Whether interpolant and system agree to rounding of the largest value that each entry takes over the range."""
    system = found.at(value)
    for name in _arrays(exact):
        a, b = _array(system, name).ravel(), _array(exact, name).ravel()
        limit = np.zeros(a.size)
        if name in found.names:
            i = found.names.index(name)
            limit[found.places[i]] = _AGREEMENT * np.abs(found.coefficients[i]).sum(axis=0)
        if np.any(np.abs(a - b) > limit):
            return False
    return True
