"""Friction with presliding and a Stribeck curve: the model of LuGre, whose bristles are a spring and a damper.

The bristles' force is a state of the loop. What drives it has a product of that force and a function of the velocity:
differences of squares, of smooth functions of smooth functions, so that its series is exact.
"""

from __future__ import annotations

from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, ClassVar

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import ArrayLike

from eppanalysis.arguments import floats
from eppanalysis.arrays import Array, IntArray
from eppanalysis.models.elements.automaton import Automaton, Smooth
from eppanalysis.models.elements.base import IN, OUT, SLOPE, SLOPE_PER_TIME, Answer, OwnStates
from eppanalysis.models.elements.dynamic.presliding import DahlLaw, PreslidingLaw, Spring
from eppanalysis.models.elements.dynamic.state import POLE, StateOutput
from eppanalysis.models.elements.phases import (
    POSITIVE,
    SMALLEST_AMPLITUDE,
    broadcast_with_frequency,
    require,
    require_numbers,
)
from eppanalysis.models.elements.piecewise import UNITY

#: Nodes of Radau's rule on a panel, most panels of half an arc, and panels that are solved at once.
_NODES, _MOST_PANELS, _AT_ONCE = 12, 40, 4000
#: Least amplitude beside a bias: a smaller one would be lost in the rounding of the mean, and is as linear.
_LEAST_SHARE = 1e-5
#: Way in presliding distances beyond which motion is as slow as any.
_MOST_REACH = 1e30


@dataclass(frozen=True)
class LuGreLaw(PreslidingLaw):
    """From the velocity and the bristles' force to what drives that force; described by the velocity."""

    static: float
    velocity: float

    def steady(self, v: Array) -> Array:
        """Magnitude of the bristles' force in steady motion at the velocity v."""
        return self.coulomb + (self.static - self.coulomb) * np.exp(-((v / self.velocity) ** 2))

    def rate(self, v: Array, force: Array) -> Array:
        """Rate of the bristles' force."""
        return self.stiffness * (v - np.abs(v) * force / self.steady(v))

    def answer(self, amplitude: Array, bias: Array, omega: Array) -> Answer:
        """Mean and gain of the bristles' force for the velocity ``bias + amplitude sin(omega t)``, by quadrature."""
        a, b, w = (np.ravel(v) for v in (amplitude, bias, omega))
        defined = ~(np.isnan(a) | np.isnan(b) | np.isnan(w))
        mean, gain = np.full(a.shape, np.nan), np.full(a.shape, np.nan + 0j)
        a = np.maximum(np.maximum(a, SMALLEST_AMPLITUDE), _LEAST_SHARE * np.abs(b))
        w = np.maximum(w, self.stiffness * a / (self.coulomb * _MOST_REACH))
        panels = np.where(defined, self._panels(a, w), 0)
        for count in np.unique(panels[defined]).tolist():
            # Short panels at both ends of an arc, where the velocity is small: the bristles turn behind the one, and
            # the Stribeck curve rises at both (docs/theory/friction.md, Bristles).
            half = 0.5 ** np.arange(count, 0.5, -1.0)
            edges = np.concatenate([[0.0], half, 1.0 - half[-2::-1], [1.0]])
            places = np.flatnonzero(panels == count)
            for some in np.array_split(places, int(np.ceil(places.size * (edges.size - 1) / _AT_ONCE))):
                mean[some], gain[some] = _periodic(self, a[some], b[some], w[some], edges)
        shape = np.shape(amplitude)
        return mean.reshape(shape), gain.reshape(shape)

    def _panels(self, a: Array, w: Array) -> IntArray:
        """Panels of half an arc; each is half as long as the next, the nearer they are to the end of the arc.

        The force changes within the presliding distance behind a reversal, the steady one within the Stribeck velocity.
        """
        reach = np.fmax(self.stiffness * a / (self.coulomb * w), 1.0)
        # Behind a reversal the way grows with the square of the phase, so that a presliding distance takes the root of
        # its share.
        steepest = np.maximum(0.5 * np.log2(reach), np.log2(a / self.velocity))
        return np.clip(2 * np.ceil(np.nan_to_num(steepest) / 2) + 4, 4, _MOST_PANELS).astype(np.int64)

    def thresholds(self, bias: float = 0.0) -> Array:
        """The Stribeck velocity, as an amplitude; where it slides at all depends on the frequency."""
        return np.array([self.velocity])

    @property
    def sticks_and_slips(self) -> bool:
        """Whether it resists more in slow motion than in quick motion."""
        return self.static > self.coulomb

    def automaton(self) -> Automaton:
        """Each product is a quarter of a difference of squares (docs/theory/friction.md).

        With the force in units of the Coulomb friction and the velocity in those of the Stribeck velocity.
        """
        if self.static == self.coulomb:
            return DahlLaw(self.stiffness, self.coulomb).automaton()
        v, force, none = np.array([1 / self.velocity, 0.0]), np.array([0.0, 1 / self.coulomb]), np.zeros(2)
        smooth = (
            Smooth("gaussian", v, 0.0, self.static / self.coulomb - 1),
            Smooth("reciprocal_abs", none, on_smooth=(1.0,)),
            Smooth("square", v, 0.0, 0.25, on_smooth=(0.0, 1.0)),
            Smooth("square", v, 0.0, -0.25, on_smooth=(0.0, -1.0)),
            Smooth("square", force, 0.0, 0.25, on_smooth=(0.0, 0.0, 1.0, 1.0)),
            Smooth("square", force, 0.0, -0.25, on_smooth=(0.0, 0.0, -1.0, -1.0)),
        )
        return self.two_ways(smooth, self.stiffness * self.velocity * np.array([0.0, 0.0, 0.0, 0.0, 1.0, 1.0]))


def _radau() -> tuple[Array, Array]:
    """Nodes of Radau's rule on [-1, 1], the end among them, and the integrals from -1 to each of its polynomials."""
    nodes = np.append(np.sort(legendre.legroots(np.append(np.zeros(_NODES - 1), [-1.0, 1.0])))[:-1], 1.0)
    matrix = legendre.legvander(nodes, _NODES - 1)
    integrals = np.column_stack([
        legendre.legval(nodes, legendre.legint(row, lbnd=-1)) for row in np.eye(_NODES)
    ])  # fmt: skip
    return nodes, np.linalg.solve(matrix.T, integrals.T).T


_PLACE, _INTEGRAL = _radau()


def _periodic(law: LuGreLaw, a: Array, b: Array, w: Array, edges: Array) -> Answer:
    """Mean and gain of the force that repeats itself, shapes (n,), over an arc forward and one backward."""
    sine = np.clip(b / a, -1.0, 1.0)
    beta = np.arcsin(sine)
    forward = _Arc.of(law, a, b, w, edges, -beta, np.pi + 2 * beta, 1.0)
    backward = _Arc.of(law, a, b, w, edges, np.pi + beta, np.pi - 2 * beta, -1.0)
    # Less is left of the start than one by this: small, where the motion is, and known as that.
    lost = forward.lost + backward.lost + forward.lost * backward.lost
    start = -((1 + backward.lost) * forward.added + backward.added) / lost
    turned = (1 + forward.lost) * start + forward.added
    ahead, back = forward.integrals(start), backward.integrals(turned)
    mean, wave = ahead[0] + back[0], ahead[1] + back[1]
    return law.coulomb * mean / (2 * np.pi), 1j * law.coulomb * wave / (np.pi * a)


@dataclass(frozen=True)
class _Arc:
    """The force, over the Coulomb friction, along phases in which the velocity has one sign.

    At every node it is ``(1 + loses) start + adds``, with the start of the arc; `lost` and `added` are those of its
    end.
    """

    phi: Array
    weight: Array
    loses: Array
    adds: Array
    lost: Array
    added: Array

    @classmethod
    def of(
        cls, law: LuGreLaw, a: Array, b: Array, w: Array, edges: Array, begin: Array, length: Array, way: float
    ) -> _Arc:
        """Solve it panel by panel, by collocation."""
        middle, half = (edges[1:] + edges[:-1]) / 2, np.diff(edges) / 2
        past = (middle[:, None] + half[:, None] * _PLACE) * length[:, None, None]
        phi = begin[:, None, None] + past
        # The velocity over its amplitude, without cancellation at the begin.
        share = b / a
        over = (share - np.clip(share, -1.0, 1.0))[:, None, None]
        u = over + 2 * np.sin(past / 2) * np.cos(begin[:, None, None] + past / 2)
        u = way * np.maximum(way * u, 0.0)
        reach = (law.stiffness * a / (law.coulomb * w))[:, None, None]
        decay = reach * np.abs(u) * law.coulomb / law.steady(u * a[:, None, None])
        step = (half * length[:, None])[:, :, None, None] * _INTEGRAL
        # The end is among Radau's nodes, so that a panel over which the bristles have long given way leaves nothing of
        # its start; of Gauss's nodes all of it would be left, with either sign.
        matrix = np.eye(_NODES) + step * decay[..., None, :]
        right = np.concatenate([-step @ decay[..., None], step @ (reach * u)[..., None]], -1)
        solved = np.linalg.solve(matrix, right)
        loses, adds = solved[..., 0], solved[..., 1]
        lost, added = np.zeros(len(a)), np.zeros(len(a))
        for i in range(len(half)):
            # (1 + lost)(1 + own) less one, written out: what a small motion loses is far below one.
            own, gained = loses[:, i].copy(), adds[:, i].copy()
            loses[:, i] = lost[:, None] + own + lost[:, None] * own
            adds[:, i] = (1 + own) * added[:, None] + gained
            lost, added = loses[:, i, -1], adds[:, i, -1]
        weight = (half * length[:, None])[:, :, None] * _INTEGRAL[-1]
        return cls(phi, weight, loses, adds, lost, added)

    def integrals(self, start: Array) -> Answer:
        """Integrals of the force, and of it times ``exp(-j phi)``."""
        force = self.weight * ((1 + self.loses) * start[:, None, None] + self.adds)
        return force.sum((1, 2)), (force * np.exp(-1j * self.phi)).sum((1, 2))


@dataclass(frozen=True)
class LuGreFriction(StateOutput, kind="lugre_friction"):
    """Friction force F over the velocity v, of bristles with a spring and a damper, that falls with speed.

    With the bristles' force z and the Stribeck curve g::

        g = coulomb + (static - coulomb) exp(-(v/velocity)**2)
        dz/dt = stiffness (v - |v| z/g)
        F = z + (damping/stiffness) dz/dt + viscous v

    It begins at its memory, the bristles' force, which is zero where none is given.

    Parameters
    ----------
    stiffness : float
        Of the bristles, for small displacements, positive [unit of the output per unit of the input and s].
    coulomb : float
        Dry friction at speed, positive [unit of the output].
    static : float
        Greatest force in slow steady motion, at least `coulomb` [unit of the output].
    velocity : float
        Stribeck velocity, positive [unit of the input].
    damping : float, optional
        Of the bristles, at least zero [unit of the output per unit of the input].
    viscous : float, optional
        Viscous friction, at least zero [unit of the output per unit of the input].

    Raises
    ------
    ModelError
        If a field is out of its range.

    Notes
    -----
    Canudas de Wit, Olsson, Åström and Lischinsky, A new model for control of systems with friction, 1995. With `static`
    equal to `coulomb` and neither damper it is :class:`DahlFriction`; the stiffer the bristles, the closer it comes to
    :class:`StribeckFriction`.

    Examples
    --------
    >>> from eppanalysis.models.elements import LuGreFriction
    >>> friction = LuGreFriction(
    ...     stiffness=1e5,
    ...     coulomb=1.0,
    ...     static=1.5,
    ...     velocity=1e-3,
    ...     damping=300.0,
    ...     viscous=0.4,
    ... )
    >>> mean, gain = friction.describing_function(amplitude=[1e-12, 1.0], omega=1.0)
    >>> gain.round(1).tolist()  # a spring and two dampers; Coulomb and viscous friction
    [(300.4-100000j), (1.7-0j)]
    """

    units = MappingProxyType({
        "stiffness": SLOPE_PER_TIME, "coulomb": OUT, "static": OUT, "velocity": IN, "damping": SLOPE, "viscous": SLOPE,
    })  # fmt: skip
    output_is = "force"
    linear_gain_is: ClassVar[str] = "the spring and the dampers that it is at rest"

    stiffness: float
    coulomb: float
    static: float
    velocity: float
    damping: float = 0.0
    viscous: float = 0.0

    def __post_init__(self) -> None:
        require_numbers(self, stiffness=POSITIVE, coulomb=POSITIVE, velocity=POSITIVE)
        require(self, "static", self.static >= self.coulomb, "at least coulomb", "coulomb")
        for name in ("damping", "viscous"):
            require(self, name, getattr(self, name) >= 0, "zero or more")
        part = self.damping / self.stiffness
        state = OwnStates(
            np.array([[-POLE]]), np.array([[0.0, 1.0]]), np.array([[0.0], [1.0], [1.0 - POLE * part]]),
            np.array([[1.0, 0.0], [0.0, 0.0], [self.viscous, part]]),
        )  # fmt: skip
        at_rest = OwnStates(
            np.zeros((1, 1)), np.array([[self.stiffness, 0.0]]), np.array([[1.0], [0.0]]),
            np.array([[self.damping + self.viscous, 0.0], [0.0, 1.0]]),
        )  # fmt: skip
        law = LuGreLaw(self.stiffness, self.coulomb, self.static, self.velocity)
        self._set_parts(state, law, Spring(UNITY.automaton(), at_rest))

    def output(self, x: Any, memory: Any = None) -> tuple[Any, Any]:
        """Force at the velocity `x` that is reached in no time; the bristles' force is its memory."""
        v, held = floats(x, "output: x"), 0.0 if memory is None else memory
        return held + self.damping / self.stiffness * self._law.rate(v, np.asarray(held)) + self.viscous * v, held

    def describing_function(self, amplitude: ArrayLike, bias: ArrayLike = 0.0, omega: ArrayLike = 1.0) -> Answer:
        """Mean and gain for a velocity, by quadrature of the force in either direction; accurate to about 1e-11.

        Raises
        ------
        ModelError
            If an amplitude or a frequency is negative.
        """
        a, b, w = broadcast_with_frequency(amplitude, bias, omega)
        mean, gain = self._law.answer(a, b, w)
        of_bristles = np.asarray(1 + 1j * w * self.damping / self.stiffness, complex)
        return mean + self.viscous * b, gain * of_bristles + self.viscous

    @property
    def sticks_and_slips(self) -> bool:
        """Whether it resists more in slow motion than in quick one."""
        return self._law.sticks_and_slips

    def linear_gain(self) -> Array:
        """The viscous part: at a steady velocity the rest stays bounded."""
        return np.array([[self.viscous]])

    @property
    def _law(self) -> LuGreLaw:
        assert isinstance(self.inside, LuGreLaw)
        return self.inside
