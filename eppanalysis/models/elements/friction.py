"""Dry friction as a force of velocity: Coulomb, with stiction, and falling with speed (Stribeck)."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from eppanalysis.arguments import floats
from eppanalysis.arrays import Array
from eppanalysis.models.elements import automata
from eppanalysis.models.elements.automaton import Automaton
from eppanalysis.models.elements.base import OUT, Answer, ClosedForm, Nonlinearity
from eppanalysis.models.elements.exact import Half, Pieces, Reading
from eppanalysis.models.elements.phases import (
    NOT_NEGATIVE,
    SMALLEST_AMPLITUDE,
    angle,
    broadcast,
    distances,
    require,
    require_numbers,
)
from eppanalysis.models.elements.static import Coulomb


@dataclass(frozen=True)
class Friction(Nonlinearity, kind="friction"):
    """Friction force of a velocity v: ``coulomb*sgn(v)``, or ``static/(1 + stribeck*|v|)*sgn(v)`` if `stribeck` > 0.

    At rest the force takes whatever value keeps v at zero, up to `static`.

    Parameters
    ----------
    coulomb : float
        Force while slipping [N or N*m], at least zero; ignored when `stribeck` > 0.
    static : float, optional
        Greatest force at rest: at least `coulomb`, its default; given and positive when `stribeck` > 0.
    stribeck : float, optional
        How fast the force falls with speed [s/m or s/rad], at least zero.

    Raises
    ------
    ModelError
        If a field is out of its range.

    Examples
    --------
    >>> from eppanalysis.models.elements import Friction
    >>> mean, gain = Friction(coulomb=2.0).describing_function(amplitude=4.0)
    >>> round(float(gain.real), 4)  # 4 coulomb/(pi A)
    0.6366
    """

    units = MappingProxyType({"coulomb": OUT, "static": OUT, "stribeck": (-1, 0, 0)})
    output_is = "force"

    coulomb: float
    static: float | None = None
    stribeck: float = 0.0

    def __post_init__(self) -> None:
        require_numbers(self, ("coulomb", "stribeck"), coulomb=NOT_NEGATIVE, stribeck=NOT_NEGATIVE)
        if self.static is None:
            require(self, "static", self.stribeck == 0, "a positive number, as stribeck is given")
            return
        require_numbers(self, ("static",))
        if self.stribeck > 0:
            require(self, "static", self.static > 0, "a positive number")
        else:
            require(self, "static", self.static >= self.coulomb, "at least coulomb", "coulomb")

    @property
    def breakaway(self) -> float:
        """Greatest force at rest."""
        return self.coulomb if self.static is None else self.static

    @cached_property
    def _slipping(self) -> Coulomb:
        """The force while slipping, without stiction."""
        return Coulomb(self.coulomb)

    def output(self, x: ArrayLike, memory: Any = None) -> tuple[Array, Any]:
        """Force while slipping at the velocity `x` (zero at rest, where the loop sets it); `memory` is unused."""
        v = floats(x, "output: x")
        if self.stribeck > 0:
            return np.sign(v) * self.breakaway / (1 + self.stribeck * np.abs(v)), memory
        return self.coulomb * np.sign(v), memory

    def describing_function(self, amplitude: ArrayLike, bias: ArrayLike = 0.0, omega: ArrayLike = 1.0) -> Answer:
        """Mean and gain (real) for the velocity ``bias + amplitude * sin(omega t)``, which never rests.

        Coulomb friction is the biased relay. For falling friction both integrals are elementary by the substitution
        ``tan(phi/2)``, with any bias. At amplitude zero the gain is the slope at the bias, infinite at rest.

        Raises
        ------
        ModelError
            If an amplitude is negative.
        """
        if self.stribeck == 0:
            return self._slipping.describing_function(amplitude, bias, omega)
        a, b, _ = broadcast(amplitude, bias, omega)
        at_rest = (a == 0) & (b == 0)
        a = np.where(a == 0, SMALLEST_AMPLITUDE, a)
        forward_mean, forward_gain = _half(a, b, self.stribeck)
        backward_mean, backward_gain = _half(a, -b, self.stribeck)
        mean = self.breakaway / (2 * np.pi) * (forward_mean - backward_mean)
        gain = self.breakaway / np.pi * ((forward_gain + backward_gain) / a)
        return mean, np.where(at_rest, np.inf, gain) + 0j

    def described_with_slopes(self, amplitude: Array, bias: Array) -> tuple[Array, Array, Array] | None:
        """Mean, gain and derivatives of the mean, those of a biased relay; None where the friction falls with speed."""
        return None if self.stribeck else self._slipping.described_with_slopes(amplitude, bias)

    @property
    def closed_form(self) -> ClosedForm | None:
        """The numbers of a biased relay; None where the friction falls with speed."""
        return None if self.stribeck else self._slipping.closed_form

    @property
    def sticks_and_slips(self) -> bool:
        """Whether the force at rest may be greater than in motion."""
        return self.stribeck > 0 or self.breakaway > self.coulomb

    def thresholds(self, bias: float = 0.0) -> Array:
        """The speed amplitude at which the friction has fallen by half; none for Coulomb friction."""
        return distances(1 / self.stribeck) if self.stribeck > 0 else np.zeros(0)

    linear_gain_is = "left out: it slides"

    def linear_gain(self) -> Array:
        """Zero: the margins of the linearised loop leave friction out."""
        return np.zeros((1, 1))

    def slope_bounds(self) -> tuple[float, float]:
        """Least and greatest slope; infinite at the jump at rest."""
        return -self.breakaway * self.stribeck, np.inf if self.breakaway > 0 else 0.0

    def sector(self) -> tuple[float, float]:
        """Least and greatest ``y/x`` over all x."""
        return 0.0, np.inf if self.breakaway > 0 else 0.0

    def exact(self, read: Reading) -> Pieces | None:
        """Its force while it slips in exact numbers, for certificates; None where it falls with speed."""
        if self.stribeck > 0:
            return None
        half = Half(Fraction(0), jumps=((Fraction(0), read(self.coulomb)),))
        return Pieces(half, half)

    def automaton(self) -> Automaton:
        """Slips either way, sticks at rest."""
        return automata.friction(self.coulomb, self.breakaway, self.stribeck)


def _half(a: Array, b: Array, fall: float) -> tuple[Array, Array]:
    """Integrals of ``g`` and ``g sin(phi)``, ``g = 1/(1 + fall v)``, where ``v = b + a sin(phi)`` is positive."""
    inner = np.abs(b) < a
    centre, half_range = 1 + fall * b, fall * a
    outside = b >= a
    low = np.where(inner | outside, 1 + fall * (b - a), 1.0)
    high = np.where(inner | outside, 1 + fall * (b + a), 1.0)
    root = np.sqrt(np.maximum(low, 0)) * np.sqrt(high)
    theta = angle(a + b, a - b)
    safe_root = np.where(inner, 1.0, root)
    # All of the cycle is on this side where b >= a, none of it where b <= -a.
    whole_mean = 2 * np.pi / safe_root
    # The difference of centre and root, rationalised: of a small motion they are nearly equal.
    whole_gain = -2 * np.pi * half_range / (safe_root * (np.where(outside, centre, 1.0) + safe_root))
    part_mean = _reciprocal(np.where(inner, a, 1.0), np.where(inner, b, 0.0), fall)
    # g sin(phi) = (1 - centre g)/half_range: the second integral from the first.
    closed = (2 * theta - centre * part_mean) / half_range
    part_gain = np.where(half_range < 0.05, _series(theta, half_range, np.where(inner, centre, 1.0)), closed)
    mean = np.where(inner, part_mean, np.where(outside, whole_mean, 0.0))
    gain = np.where(inner, part_gain, np.where(outside, whole_gain, 0.0))
    undefined = np.isnan(a) | np.isnan(b)
    return np.where(undefined, np.nan, mean), np.where(undefined, np.nan, gain)


def _reciprocal(a: Array, b: Array, fall: float) -> Array:
    """``integral of dphi/(1 + fall (b + a sin phi))`` over the phases with ``b + a sin(phi) > 0``, for ``|b| < a``."""
    low, high = 1 + fall * (b - a), 1 + fall * (b + a)
    ratio = np.sqrt(np.abs(low) / high) * np.sqrt((a + b) / (a - b))
    safe = np.where(ratio > 0, ratio, 1.0)
    # tan(phi/2) leads to an arc tangent, or to its hyperbolic counterpart where 1 + fall v has a zero within the
    # swing's other half.
    trigonometric = np.where(ratio > 0, np.arctan(safe) / safe, 1.0)
    # arctanh near one, where 1 - ratio^2 is known without cancellation.
    near_one = np.log((1 + ratio) / np.sqrt(2 * a / (high * (a - b))))
    small = np.arctanh(np.minimum(ratio, 0.5))
    hyperbolic = np.where(ratio > 0, np.where(ratio < 0.5, small, near_one) / safe, 1.0)
    return 4 * np.sqrt((a + b) / (a - b)) / high * np.where(low >= 0, trigonometric, hyperbolic)


def _series(theta: Array, half_range: Array, centre: Array) -> Array:
    """``integral of cos t/(centre + half_range cos t) from -theta to theta`` in powers of ``half_range``, where it is
    small.

    The closed form is a difference of nearly equal numbers there; 14 terms reach rounding for half_range < 0.05.
    """
    cosine, sine = np.cos(theta), np.sin(theta)
    small = half_range < 0.05
    centre = np.where(small, centre, 1.0)
    q = -np.where(small, half_range, 0.0) / centre
    before, moment = 2 * theta, 2 * sine
    total, power = np.zeros_like(theta), np.ones_like(theta)
    for n in range(2, 16):
        total, power = total + power * moment, power * q
        before, moment = moment, (2 * cosine ** (n - 1) * sine + (n - 1) * before) / n
    return total / centre
