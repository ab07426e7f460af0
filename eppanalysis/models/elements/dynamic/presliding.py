"""Friction with presliding: the model of Dahl, in which friction at rest is a spring.

The force is a state of the loop, driven by a law that has the product of velocity and force: a difference of two
squares, each a smooth function of a sum, so that its series is exact.
"""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from eppanalysis.arguments import floats
from eppanalysis.arrays import Array
from eppanalysis.models.elements.automaton import Automaton, AutomatonBuilder, Smooth
from eppanalysis.models.elements.base import OUT, SLOPE_PER_TIME, Answer, Nonlinearity
from eppanalysis.models.elements.dynamic.state import POLE, StateOutput, lag, state_of_law
from eppanalysis.models.elements.own import AutomatonElement
from eppanalysis.models.elements.phases import (
    POSITIVE,
    SMALLEST_AMPLITUDE,
    broadcast,
    broadcast_with_frequency,
    require_numbers,
    with_nan,
)
from eppanalysis.models.elements.piecewise import UNITY

_PLACE, _WEIGHT = np.polynomial.legendre.leggauss(24)
#: Most panels of an arc: the shortest is as short as the steepest begin in double precision.
_MOST_PANELS = 40


@dataclass(frozen=True)
class PreslidingLaw(Nonlinearity):
    """From the velocity and the force at rest to what drives that force; described by the velocity.

    A subclass gives the force's `rate` and, for the fundamental, its `answer`; its automaton has a mode for either
    direction.
    """

    n_inputs: ClassVar[int] = 2
    of_frequency: ClassVar[bool] = True
    linear_gain_is: ClassVar[str] = "the spring that it is at rest"

    stiffness: float
    coulomb: float

    @abstractmethod
    def rate(self, v: Array, force: Array) -> Array:
        """Rate of the force, for a velocity and the force."""

    @abstractmethod
    def answer(self, amplitude: Array, bias: Array, omega: Array) -> Answer:
        """Mean and gain of the force for the velocity ``bias + amplitude sin(omega t)``, by quadrature."""

    def output(self, x: Any, memory: Any = None) -> tuple[Any, Any]:
        """What drives the force, for a velocity and a force."""
        v, force = (floats(z, "output: x") for z in x)
        return self.rate(v, force) + POLE * force, memory

    def describing_function(self, amplitude: ArrayLike, bias: ArrayLike = 0.0, omega: ArrayLike = 1.0) -> Answer:
        """Mean and gain that make the state's those of the force."""
        a, b, w = broadcast(amplitude, bias, omega)
        mean, gain = self.answer(a, b, w)
        return POLE * mean, (1j * w + POLE) * gain

    def thresholds(self, bias: float = 0.0) -> Array:
        """No amplitudes: where it changes depends on the frequency."""
        return np.zeros(0)

    def slope_bounds(self) -> tuple[float, float]:
        """Nothing is known."""
        return -np.inf, np.inf

    def linear_gain(self) -> Array:
        """Of a spring."""
        return np.array([[self.stiffness, POLE]])

    def two_ways(self, smooth: tuple[Smooth, ...], product: ArrayLike) -> Automaton:
        """A mode for either direction; smooth functions make the product that opposes the spring in forward motion."""
        build, law = AutomatonBuilder(n_inputs=2, smooth=smooth), [self.stiffness, POLE]
        weights = np.asarray(product, float)
        forward = build.mode("forward", from_input=law, from_smooth=-weights)
        backward = build.mode("backward", from_input=law, from_smooth=weights)
        build.guard("turns backward", forward, backward, on_input=[-1.0, 0.0])
        build.guard("turns forward", backward, forward, on_input=[1.0, 0.0])
        return build.build(forward)


@dataclass(frozen=True)
class DahlLaw(PreslidingLaw):
    """From the velocity and the force to what drives the force."""

    def rate(self, v: Array, force: Array) -> Array:
        """Of a spring that gives way as the force nears the Coulomb friction."""
        return self.stiffness * (v - np.abs(v) * force / self.coulomb)

    def answer(self, amplitude: Array, bias: Array, omega: Array) -> Answer:
        """By quadrature of the closed form in either direction."""
        return _answer(amplitude, bias, omega, self.stiffness, self.coulomb)

    def automaton(self) -> Automaton:
        """The product ``v F/coulomb`` is a quarter of a difference of squares."""
        slow, quarter = self.coulomb / self.stiffness, 0.25 * self.coulomb
        rows = ([1.0 / slow, 1.0 / self.coulomb], [-1.0 / slow, 1.0 / self.coulomb])
        return self.two_ways(tuple(Smooth("square", np.array(row)) for row in rows), [quarter, -quarter])


def _answer(a: Array, b: Array, w: Array, stiffness: float, coulomb: float) -> Answer:
    """Mean and gain of the force for the velocity ``b + a sin(w t)``, by quadrature of either direction."""
    a = np.where(a == 0, SMALLEST_AMPLITUDE, a)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore", under="ignore"):
        sine = np.clip(b / a, -1.0, 1.0)
        beta, reach = np.arcsin(sine), stiffness * a / (coulomb * w)
        cosine = np.sqrt((1 - sine) * (1 + sine))
        lengths = np.pi + 2 * beta, np.pi - 2 * beta
        # What the force makes up of its distance to the Coulomb friction, m of docs/theory/friction.md, Presliding.
        gained = [
            -np.expm1(-reach * (s * length + 2 * cosine)) for s, length in zip((sine, -sine), lengths, strict=True)
        ]
        # Of a period: the force as it turns forward and backward, over the Coulomb friction.
        whole = gained[0] + gained[1] - gained[0] * gained[1]
        low = -(gained[1] - (1 - gained[1]) * gained[0]) / whole
        high = low + (1 - low) * gained[0]
        parts = [
            arc(reach, -beta, lengths[0], sine, low, 1.0),
            arc(reach, np.pi + beta, lengths[1], sine, high, -1.0),
        ]
        mean, wave = (np.sum(both, axis=0) for both in zip(*parts, strict=True))
        one_way = np.abs(b) >= a
        mean = np.where(one_way, coulomb * np.sign(b), coulomb * mean / (2 * np.pi))
        gain = np.where(one_way, 0.0, 1j * coulomb * wave / (np.pi * a))
    return with_nan(a, b, mean, gain, w)


def gained(reach: Array, ratio: float) -> Array:
    """Of a force over its bound: what a way gains from zero; where it gives way `ratio` times as fast, over that."""
    return np.asarray(-np.expm1(-ratio * reach) / ratio if ratio else reach)


def arc(reach: Array, begin: Array, length: Array, sine: Array, start: Array, way: float, ratio: float = 1.0) -> Answer:
    """Integrals of the force, and of it times ``exp(-j phi)``, over phases in which the velocity has one sign.

    Along the way the force follows ``df/dx = reach (way - ratio f)``. Panels double their length from the begin on,
    where the force changes within the presliding distance.
    """
    steep = reach * max(1.0, abs(ratio))
    steepest = float(np.fmax.reduce(np.where(np.isfinite(steep), steep, 0.0), axis=None, initial=1.0))
    # Behind a reversal the way grows with the square of the phase, so that a presliding distance takes the root of its
    # share.
    count = int(np.clip(np.ceil(0.5 * np.log2(steepest)) + 3, 3, _MOST_PANELS))
    edges = np.concatenate([[0.0], 0.5 ** np.arange(count, -0.5, -0.5)])
    middle, half = (edges[1:] + edges[:-1]) / 2, np.diff(edges) / 2
    share = (middle[:, None] + half[:, None] * _PLACE).ravel()
    weight = (half[:, None] * _WEIGHT).ravel() * length[..., None]
    past = share * length[..., None]
    phi = begin[..., None] + past
    # The cosine falls by this from the begin on, without cancellation.
    fallen = 2 * np.sin(past / 2) * np.sin(begin[..., None] + past / 2)
    moved = way * (sine[..., None] * past + fallen)
    force = start[..., None] + (way - ratio * start[..., None]) * gained(reach[..., None] * moved, ratio)
    return (weight * force).sum(-1), (weight * force * np.exp(-1j * phi)).sum(-1)


class Spring(AutomatonElement):
    """What margins take for the friction."""

    linear_gain_is = "the spring that it is at rest"


@dataclass(frozen=True)
class DahlFriction(StateOutput, kind="dahl_friction"):
    """Friction force F of a velocity v, a spring about rest: ``dF/dt = stiffness (v - |v| F/coulomb)``.

    It begins at its memory, a force, which is zero where none is given.

    Parameters
    ----------
    stiffness : float
        Of the spring, for small displacements, positive [unit of the output per unit of the input and s].
    coulomb : float
        Force in steady motion, positive [unit of the output].

    Raises
    ------
    ModelError
        If a field is not a positive number.

    Notes
    -----
    Dahl, A solid friction model, 1968. The force depends on the displacement alone, not on its speed.

    Examples
    --------
    >>> from eppanalysis.models.elements import DahlFriction
    >>> friction = DahlFriction(stiffness=100.0, coulomb=1.0)
    >>> mean, gain = friction.describing_function(amplitude=[1e-6, 1.0], omega=1.0)

    A spring, 100/(j omega), and nearly Coulomb friction, 4/(pi A):

    >>> gain.round(3).tolist()
    [(0.004-100j), (1.261-0.159j)]
    """

    units = MappingProxyType({"stiffness": SLOPE_PER_TIME, "coulomb": OUT})
    output_is = "force"
    linear_gain_is: ClassVar[str] = "the spring that it is at rest"

    stiffness: float
    coulomb: float

    def __post_init__(self) -> None:
        require_numbers(self, stiffness=POSITIVE, coulomb=POSITIVE)
        spring = Spring(UNITY.automaton(), lag(0.0, self.stiffness))
        self._set_parts(state_of_law(POLE), DahlLaw(self.stiffness, self.coulomb), spring)

    def describing_function(self, amplitude: ArrayLike, bias: ArrayLike = 0.0, omega: ArrayLike = 1.0) -> Answer:
        """Mean and gain for a velocity, by quadrature of the force in either direction; accurate to about 1e-12.

        A velocity that keeps its sign has the Coulomb friction against it, and no gain.

        Raises
        ------
        ModelError
            If an amplitude or a frequency is negative.
        """
        a, b, w = broadcast_with_frequency(amplitude, bias, omega)
        return _answer(a, b, w, self.stiffness, self.coulomb)

    def linear_gain(self) -> Array:
        """Zero: at a steady velocity the force stays bounded."""
        return np.zeros((1, 1))
