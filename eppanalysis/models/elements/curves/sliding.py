"""Dry friction with a part that grows with speed: viscous and Coulomb in one, and the Stribeck curve."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from eppanalysis.arguments import floats
from eppanalysis.arrays import Array
from eppanalysis.models.elements import automata
from eppanalysis.models.elements.automaton import Automaton
from eppanalysis.models.elements.base import IN, OUT, RATIO, SLOPE, Answer, Nonlinearity
from eppanalysis.models.elements.exact import Half, Pieces, Reading
from eppanalysis.models.elements.phases import (
    NOT_NEGATIVE,
    broadcast,
    layers,
    require,
    require_numbers,
    some_at_a_time,
    with_nan,
)
from eppanalysis.models.elements.static import Coulomb

#: Largest exponent of a Stribeck curve, parts of a panel of one that falls steeply, and how much shorter panels are at
#: rest where the exponent makes a root there.
_STEEPEST, _PARTS, _ROOT = 6, 4, 2.0**30
#: Velocity over the Stribeck velocity below which a line replaces a curve that has no Taylor series at rest.
_CREEP = 1e-10


class _Sliding(Nonlinearity):
    """What the two share: a force that jumps with the direction, and holds at rest."""

    output_is = "force"
    coulomb: float
    viscous: float

    @property
    def breakaway(self) -> float:
        """Greatest force at rest."""
        return self.coulomb

    def _coulomb_and_viscous(self, amplitude: ArrayLike, bias: ArrayLike, omega: ArrayLike) -> Answer:
        mean, gain = Coulomb(self.coulomb).describing_function(amplitude, bias, omega)
        return mean + self.viscous * floats(bias, "describing_function: bias"), gain + self.viscous

    def linear_gain(self) -> Array:
        """The viscous part: the margins of the linearised loop leave dry friction out."""
        return np.array([[self.viscous]])

    def slope_bounds(self) -> tuple[float, float]:
        """Least and greatest slope; infinite at the jump at rest."""
        return self.viscous, np.inf if self.breakaway > 0 else self.viscous

    def sector(self) -> tuple[float, float]:
        """Least and greatest ``y/x``: the viscous part far out, infinite at rest."""
        return self.viscous, np.inf if self.breakaway > 0 else self.viscous


@dataclass(frozen=True)
class ViscousCoulomb(_Sliding, kind="viscous_coulomb"):
    """Friction force of a velocity v, ``coulomb*sgn(v) + viscous*v``; at rest it holds up to `coulomb`.

    Parameters
    ----------
    coulomb : float
        Coulomb friction, at least zero [N or N*m].
    viscous : float
        Viscous friction, at least zero [N*s/m or N*m*s/rad].

    Raises
    ------
    ModelError
        If a field is negative or not a finite number.

    Examples
    --------
    >>> from eppanalysis.models.elements import ViscousCoulomb
    >>> mean, gain = ViscousCoulomb(coulomb=2.0, viscous=0.5).describing_function(
    ...     amplitude=4.0
    ... )
    >>> round(float(gain.real), 4)  # 4 coulomb/(pi A) + viscous
    1.1366
    """

    units = MappingProxyType({"coulomb": OUT, "viscous": SLOPE})

    coulomb: float
    viscous: float

    def __post_init__(self) -> None:
        require_numbers(self, coulomb=NOT_NEGATIVE, viscous=NOT_NEGATIVE)

    def output(self, x: ArrayLike, memory: Any = None) -> tuple[Array, Any]:
        """Force while slipping at the velocity `x` (zero at rest, where the loop sets it); `memory` is unused."""
        v = floats(x, "output: x")
        return np.asarray(self.coulomb * np.sign(v) + self.viscous * v), memory

    def describing_function(self, amplitude: ArrayLike, bias: ArrayLike = 0.0, omega: ArrayLike = 1.0) -> Answer:
        """Mean and gain (real) for a velocity ``bias + amplitude * sin(omega t)``, which never rests.

        Raises
        ------
        ModelError
            If an amplitude is negative.
        """
        return self._coulomb_and_viscous(amplitude, bias, omega)

    def exact(self, read: Reading) -> Pieces:
        """Its force while it slips in exact numbers, for certificates."""
        half = Half(read(self.viscous), jumps=((Fraction(0), read(self.coulomb)),))
        return Pieces(half, half)

    def automaton(self) -> Automaton:
        """Slips either way, sticks at rest."""
        return automata.sticking(self.coulomb, self.coulomb, self.viscous)


@dataclass(frozen=True)
class StribeckFriction(_Sliding, kind="stribeck_friction"):
    """Friction ``(coulomb + (static - coulomb) exp(-|v/velocity|**shape))*sgn(v) + viscous*v`` of a velocity v.

    At rest the force takes whatever value keeps v at zero, up to `static`.

    Parameters
    ----------
    coulomb : float
        Dry friction at speed, at least zero [N or N*m].
    static : float
        Greatest force at rest, at least `coulomb` [N or N*m].
    velocity : float
        Stribeck velocity, positive [m/s or rad/s].
    viscous : float, optional
        Viscous friction, at least zero [N*s/m or N*m*s/rad].
    shape : float, optional
        Exponent of the falling part, positive, 6 or less: 2 is a Gaussian, 1 an exponential. Runs, orbits and balances
        follow a line below 1e-10 of `velocity` where it is no whole number.

    Raises
    ------
    ModelError
        If a field is out of its range.

    Examples
    --------
    >>> from eppanalysis.models.elements import StribeckFriction
    >>> stem = StribeckFriction(coulomb=1.0, static=1.5, velocity=0.1, viscous=0.2)
    >>> stem.output([0.0, 0.1, 1.0])[0].round(4).tolist()
    [0.0, 1.2039, 1.2]
    """

    units = MappingProxyType({"coulomb": OUT, "static": OUT, "velocity": IN, "viscous": SLOPE, "shape": RATIO})

    coulomb: float
    static: float
    velocity: float
    viscous: float = 0.0
    shape: float = 2.0

    def __post_init__(self) -> None:
        require_numbers(self, coulomb=NOT_NEGATIVE)
        require(self, "static", self.static >= self.coulomb, "at least coulomb", "coulomb")
        require(self, "velocity", self.velocity > 0, "a positive number")
        require(self, "viscous", self.viscous >= 0, "zero or more")
        require(self, "shape", 0 < self.shape <= _STEEPEST, f"a positive number, {_STEEPEST} or less")

    def _decay(self, u: Array) -> Array:
        """Falling part over what it is at rest, of velocities over the Stribeck velocity."""
        return np.asarray(np.exp(-(u**2) if self.shape == 2 else -(np.abs(u) ** self.shape)))

    @property
    def breakaway(self) -> float:
        """Greatest force at rest."""
        return self.static

    def output(self, x: ArrayLike, memory: Any = None) -> tuple[Array, Any]:
        """Force while slipping at the velocity `x` (zero at rest, where the loop sets it); `memory` is unused."""
        v = floats(x, "output: x")
        dry = self.coulomb + (self.static - self.coulomb) * self._decay(v / self.velocity)
        return np.asarray(dry * np.sign(v) + self.viscous * v), memory

    @some_at_a_time
    def describing_function(self, amplitude: ArrayLike, bias: ArrayLike = 0.0, omega: ArrayLike = 1.0) -> Answer:
        """Mean and gain (real) for a velocity ``bias + amplitude * sin(omega t)``, which never rests.

        Without a bias a Gaussian falling part has ``(static - coulomb) 4 F(p)/(pi p A)``, with Dawson's integral F and
        p the amplitude over the Stribeck velocity; with one, and of other shapes, it is integrated, accurate to about
        1e-12.

        Raises
        ------
        ModelError
            If an amplitude is negative.
        """
        from scipy.special import dawsn

        a, b, _ = broadcast(amplitude, bias, omega)
        mean, gain = self._coulomb_and_viscous(a, b, omega)
        excess = self.static - self.coulomb
        p, offset = a / self.velocity, b / self.velocity
        # A root at rest is resolved by panels that are shorter than the curve's own by a factor.
        finer = 1.0 if self.shape == round(self.shape) else _ROOT
        phi, weight = layers(p * finer, offset * finer, 1 if self.shape <= 2 else _PARTS)
        v = offset[..., None] + p[..., None] * np.sin(phi)
        falling = weight * self._decay(v) * np.sign(v)
        moves = np.where(a > 0, a, 1.0)
        drop = 2 * (falling * np.sin(phi)).sum(-1)
        if self.shape == 2:
            drop = np.where(b == 0, 4 / np.pi * np.where(p > 0, dawsn(p) / np.where(p > 0, p, 1.0), 1.0), drop)
        apart = np.where(b == 0, 1.0, np.abs(offset))
        slope = -self.shape * apart ** (self.shape - 1) * self._decay(apart) / self.velocity
        drop = np.where(a > 0, drop / moves, np.where(b == 0, np.inf if excess > 0 else 0.0, slope))
        with np.errstate(invalid="ignore"):
            falls = np.where(excess > 0, excess * drop, 0.0)
        return with_nan(a, b, mean + excess * falling.sum(-1), gain.real + falls)

    @property
    def sticks_and_slips(self) -> bool:
        """Whether the force at rest is greater than in motion."""
        return self.static > self.coulomb

    def thresholds(self, bias: float = 0.0) -> Array:
        """The Stribeck velocity, as an amplitude."""
        return np.array([self.velocity])

    def slope_bounds(self) -> tuple[float, float]:
        """Least slope, at ``(v/velocity)**shape = (shape - 1)/shape``, and greatest; infinite at the jump at rest."""
        rest = (self.shape - 1) / self.shape
        steepest = self.shape * rest**rest * np.exp(-rest) if rest >= 0 else np.inf
        excess = self.static - self.coulomb
        return float(self.viscous - (excess / self.velocity * steepest if excess else 0.0)), super().slope_bounds()[1]

    def automaton(self) -> Automaton:
        """Slips either way, sticks at rest; a line in between where the shape has no Taylor series at rest."""
        excess = self.static - self.coulomb
        law, constant = automata.decay(self.shape, self.velocity, excess)
        level = self.coulomb + constant
        if self.shape == round(self.shape):
            return automata.sticking(self.static, level, self.viscous, law)
        at_rest, more = (excess * part * _CREEP**self.shape for part in _line(self.shape))
        edge = _CREEP * self.velocity
        creeps = automata.Creep(edge, self.static - at_rest, self.viscous - more / edge)
        return automata.sticking(self.static, level, self.viscous, law, creeps)


def _line(shape: float) -> tuple[float, float]:
    """Line on [0, 1] in place of ``u**shape``: its value at zero, and how much it rises.

    It has the mean of the power, and of its reciprocal, so that a body is as long on its way whether it is pulled or
    lets go by itself (docs/theory/friction.md).
    """
    mean = 1.0 / (1.0 + shape)
    low, high = 0.0, 2.0 * mean
    while shape < 1.0 and low < (rise := 0.5 * (low + high)) < high:
        slower = np.log1p(rise / max(mean - 0.5 * rise, 1e-300)) * (1.0 - shape) > rise
        low, high = (low, rise) if slower else (rise, high)
    return mean - 0.5 * high, high
