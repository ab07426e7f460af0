"""Hysteresis of Bouc and Wen: a spring that gives way as its force grows, along the motion other than against it.

Built as Dahl's friction, which it is without `gamma`: the force is a state of the loop, driven by a law with the
product of velocity and force, in a mode for either sign of both.
"""

from __future__ import annotations

from dataclasses import dataclass
from types import MappingProxyType
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from eppanalysis import roots
from eppanalysis.arrays import Array, IntArray
from eppanalysis.models.elements.automaton import Automaton, AutomatonBuilder, Smooth
from eppanalysis.models.elements.base import SLOPE_PER_TIME, Answer, Role
from eppanalysis.models.elements.dynamic.presliding import PreslidingLaw, Spring, arc, gained
from eppanalysis.models.elements.dynamic.state import POLE, StateOutput, lag, state_of_law
from eppanalysis.models.elements.phases import (
    POSITIVE,
    SMALLEST_AMPLITUDE,
    broadcast_with_frequency,
    require,
    require_numbers,
    with_nan,
)
from eppanalysis.models.elements.piecewise import UNITY

#: Size of a force over its bound below which its ways are summed as series.
_SERIES = 0.1
_PER_WAY: Role = (-1, 0, -1)
#: Ways in presliding distances: below the one it is a spring, beyond the other motion is as slow as any.
_LEAST, _MOST = 1e-100, 1e24
#: The greatest force over its bound that is not the bound.
_BELOW_ONE = float(np.nextafter(1.0, 0.0))


@dataclass(frozen=True)
class BoucWenLaw(PreslidingLaw):
    """From the velocity and the force to what drives the force, whose bound is `coulomb`.

    Where the force acts with the motion it gives way `ratio` times as fast as where it acts against it.
    """

    ratio: float

    def rate(self, v: Array, force: Array) -> Array:
        """Of a spring that gives way as the force nears its bound."""
        gives_way = np.where(v * force >= 0.0, 1.0, self.ratio)
        return np.asarray(self.stiffness * (v - gives_way * np.abs(v) * force / self.coulomb))

    def answer(self, amplitude: Array, bias: Array, omega: Array) -> Answer:
        """By quadrature of the closed form on either side of zero force in either direction."""
        slow = self.coulomb * omega / self.stiffness
        a = np.maximum(amplitude, np.maximum(_LEAST * slow, SMALLEST_AMPLITUDE))
        with np.errstate(divide="ignore", invalid="ignore", over="ignore", under="ignore"):
            # Turned about zero it is the same: a bias upward covers either.
            sine = np.minimum(np.abs(bias) / a, 1.0)
            beta, cosine = np.arcsin(sine), np.sqrt((1 - sine) * (1 + sine))
            reach = np.minimum(a / slow, _MOST)
            lengths = np.pi + 2 * beta, np.pi - 2 * beta
            ways = [reach * (s * length + 2 * cosine) for s, length in zip((sine, -sine), lengths, strict=True)]
            low = self._forward_turn(*(way.ravel() for way in ways)).reshape(a.shape)
            high = self._behind(low, ways[0])
            parts = self._arcs(reach, -beta, lengths[0], sine, low, 1.0)
            # Without a bias either direction gives one half.
            parts += self._arcs(reach, np.pi + beta, lengths[1], sine, high, -1.0) if np.any(bias) else parts
            mean, wave = (np.sum(both, axis=0) for both in zip(*parts, strict=True))
            one_way = sine >= 1.0
            mean = self.coulomb * np.sign(bias) * np.where(one_way, 1.0, mean / (2 * np.pi))
            gain = np.where(one_way, 0.0, 1j * self.coulomb * wave / (np.pi * a))
        return with_nan(a, bias, mean, gain, omega)

    def _to_zero(self, force: Array) -> Array:
        """Way to zero force, from one of this size over the bound against the motion."""
        return np.asarray(np.log1p(self.ratio * force) / self.ratio if self.ratio else force)

    def _behind(self, force: Array, way: Array) -> Array:
        """Force over its bound behind a way forward, both in presliding distances."""
        back = np.minimum(way, self._to_zero(np.maximum(-force, 0.0)))
        below = np.minimum(force + (1.0 - self.ratio * force) * gained(back, self.ratio), 0.0)
        begun = np.where(force < 0.0, np.where(way > back, 0.0, below), force)
        return np.asarray(begun + (1.0 - begun) * gained(way - back, 1.0))

    def _forward_turn(self, forward: Array, backward: Array) -> Array:
        """Force over its bound, at the turn forward, that repeats behind the ways (n,) of a period, the first longer.

        With a(f) the way from zero to a force and c(f) that back to zero, the forces l at the turn forward and h at the
        turn backward have ``a(h) + c(-l) = forward`` and ``a(-l) + c(h) = backward``, unless both are positive.
        """

        def excess(size: Array, i: IntArray) -> Array:
            """Of the way backward, over the square of the one forward, if the force is minus this at the turn."""
            there, back = forward[i], backward[i]
            high = gained(np.maximum(there - self._to_zero(size), 0.0), 1.0)
            plain = -np.log1p(-size) + self._to_zero(high) - back
            # The same by what a is more than c: as the sizes vanish the ways cancel, but for their squares.
            small = self._more(size) - self._more(high) + (there - back)
            return np.asarray(np.where(np.maximum(size, high) < _SERIES, small, plain) / there / there)

        none = np.zeros(forward.size)
        back_to_zero = gained(forward, -self.ratio)
        found = -roots.between(excess, none, np.minimum(back_to_zero, _BELOW_ONE))
        found = np.where(np.isnan(found), -1.0, found)
        up, down = gained(forward, 1.0), gained(backward, self.ratio)
        both_positive = (up - down - self.ratio * up * down) / (up + self.ratio * down * (1.0 - up))
        return np.where(excess(none, np.arange(none.size)) >= 0.0, both_positive, found)

    def _more(self, force: Array) -> Array:
        """By how much the way from zero to a small force is longer than that back to zero."""
        back = _beyond_log(self.ratio * force) / self.ratio if self.ratio else 0.0
        return np.asarray(_beyond_log(-force) + back)

    def _arcs(self, reach: Array, begin: Array, length: Array, sine: Array, start: Array, way: float) -> list[Answer]:
        """Integrals over the phases of one direction, up to zero force and beyond it."""
        begins, sines, goal = (v.ravel() for v in (begin, sine, self._to_zero(np.maximum(-way * start, 0.0)) / reach))

        def past(phase: Array, i: IntArray) -> Array:
            """How far the way has passed the zero of the force."""
            fallen = 2 * np.sin(phase / 2) * np.sin(begins[i] + phase / 2)
            return np.asarray(way * (sines[i] * phase + fallen) - goal[i])

        crossing = roots.between(past, np.zeros(length.size), length.ravel()).reshape(length.shape)
        whole = np.where(way * start < 0.0, length, 0.0)
        first = np.where(np.isnan(crossing), whole, crossing)
        behind = np.maximum(way * start, 0.0) * way
        return [
            arc(reach, begin, first, sine, start, way, self.ratio),
            arc(reach, begin + first, length - first, sine, behind, way),
        ]

    def automaton(self) -> Automaton:
        """The product ``v F/coulomb`` is a quarter of a difference of squares."""
        slow, law = self.coulomb / self.stiffness, [self.stiffness, POLE]
        rows = ([1.0 / slow, 1.0 / self.coulomb], [-1.0 / slow, 1.0 / self.coulomb])
        build = AutomatonBuilder(n_inputs=2, smooth=tuple(Smooth("square", np.array(row)) for row in rows))
        quarter, modes = np.array([0.25, -0.25]) * self.coulomb, {}
        for v, direction in ((1.0, "forward"), (-1.0, "backward")):
            for f, name in ((1.0, "pulled"), (-1.0, "pushed")):
                weight = 1.0 if v == f else self.ratio
                modes[v, f] = build.mode(f"{direction}, {name}", from_input=law, from_smooth=-v * weight * quarter)
        for (v, f), mode in modes.items():
            turns = "turns backward" if v > 0 else "turns forward"
            build.guard(turns, mode, modes[-v, f], on_input=[-v, 0.0])
            build.guard("force passes zero", mode, modes[v, -f], on_input=[0.0, -f])
        return build.build(modes[1.0, 1.0])


def _beyond_log(x: Array) -> Array:
    """``x - log(1 + x)`` for small x, by the series of the area tangent."""
    s = x / (2.0 + x)
    q = s * s
    tail = 1 / 3 + q * (1 / 5 + q * (1 / 7 + q * (1 / 9 + q * (1 / 11 + q * (1 / 13 + q / 15)))))
    return np.asarray(2.0 * q / (1.0 - s) - 2.0 * s * q * tail)


@dataclass(frozen=True)
class BoucWen(StateOutput, kind="bouc_wen"):
    """Hysteretic force F of a velocity v, of Bouc and Wen: ``dF/dt = stiffness v - beta |v| F - gamma v |F|``.

    It begins at its memory, a force, which is zero where none is given.

    Parameters
    ----------
    stiffness : float
        Of the spring that it is for small displacements, positive [unit of the output per unit of the input and s].
    beta : float
        How fast the force gives way, positive [1 per unit of the input and s].
    gamma : float
        By how much faster against the motion, and slower with it; more than -beta [1 per unit of the input and s].

    Raises
    ------
    ModelError
        If stiffness or beta is not a positive number, or gamma is not a number above -beta.

    Notes
    -----
    Wen, "Method for random vibration of hysteretic systems", Journal of the Engineering Mechanics Division 102 (1976)
    249, with the exponent 1. Of a force ``alpha k x + (1 - alpha) k z`` with ``dz/dt = A v - ...`` this is the second
    part, with ``stiffness = (1 - alpha) k A``; the first one is a spring of the loop. The force stays below
    ``stiffness/(beta + gamma)``. Without `gamma` it is Dahl's friction.

    Examples
    --------
    >>> from eppanalysis.models.elements import BoucWen
    >>> spring = BoucWen(stiffness=100.0, beta=50.0, gamma=50.0)
    >>> mean, gain = spring.describing_function(amplitude=[1e-8, 1.0], omega=1.0)

    A spring, 100/(j omega), and nearly Coulomb friction, 4/(pi A):

    >>> gain.round(3).tolist()
    [-100j, (1.257-0.183j)]
    """

    units = MappingProxyType({"stiffness": SLOPE_PER_TIME, "beta": _PER_WAY, "gamma": _PER_WAY})
    output_is = "force"
    linear_gain_is: ClassVar[str] = "the spring that it is at rest"

    stiffness: float
    beta: float
    gamma: float = 0.0

    def __post_init__(self) -> None:
        require_numbers(self, stiffness=POSITIVE, beta=POSITIVE)
        require(self, "gamma", self.gamma > -self.beta, "more than -beta", "beta")
        against, along = self.beta + self.gamma, self.beta - self.gamma
        law = BoucWenLaw(self.stiffness, self.stiffness / against, along / against)
        self._set_parts(state_of_law(POLE), law, Spring(UNITY.automaton(), lag(0.0, self.stiffness)))

    def describing_function(self, amplitude: ArrayLike, bias: ArrayLike = 0.0, omega: ArrayLike = 1.0) -> Answer:
        """Mean and gain for a velocity, by quadrature of the force in either direction; accurate to about 1e-12.

        A velocity that keeps its sign has the greatest force against it, and no gain.

        Raises
        ------
        ModelError
            If an amplitude or a frequency is negative.
        """
        assert isinstance(self.inside, BoucWenLaw)
        return self.inside.answer(*broadcast_with_frequency(amplitude, bias, omega))

    def linear_gain(self) -> Array:
        """Zero: at a steady velocity the force stays bounded."""
        return np.zeros((1, 1))
