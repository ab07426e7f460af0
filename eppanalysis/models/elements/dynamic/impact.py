"""A stop that a mass hits: an impulse turns its speed back, by the coefficient of restitution."""

from __future__ import annotations

from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from eppanalysis.arguments import floats
from eppanalysis.arrays import Array
from eppanalysis.errors import ModelError
from eppanalysis.models.elements.automaton import Automaton, AutomatonBuilder
from eppanalysis.models.elements.base import IN, RATIO, Answer, Nonlinearity, Role
from eppanalysis.models.elements.phases import NOT_NEGATIVE, POSITIVE, require, require_numbers

_MASS: Role = (-1, 1, 2)


@dataclass(frozen=True)
class ImpactStop(Nonlinearity, kind="impact_stop"):
    """Rigid stops of a mass, from its position x and speed v to a force: an impulse ``-(1 + restitution) mass v``.

    The impulse comes where x reaches a limit while moving outward. A stop on one side alone has the other one far away.

    Parameters
    ----------
    lower, upper : float
        Limits of the position, the lower one below the upper one [unit of the input].
    mass : float
        What the force accelerates, positive [unit of the output times s squared per unit of the input].
    restitution : float
        Speed behind an impact over that before it, 0 to 1.

    Raises
    ------
    ModelError
        If a field is not a finite number, the mass is not positive, the limits are not in order, or the restitution is
        not from 0 to 1.

    Notes
    -----
    The loop has to bring the force to the rate of v over `mass`, and nothing else: that is what makes of the impulse
    the speed that it should be. A mass that is pressed against a stop bounces ever lower, infinitely often in a finite
    time: a run ends there, and says that its switches accumulate.

    A sine passes through the limits, so there is no describing function; runs, searches and exact orbits need none.

    Examples
    --------
    A ball that falls from 1 m, with a restitution of 0.8:

    >>> import eppanalysis as epp
    >>> floor = epp.ImpactStop(lower=0.0, upper=10.0, mass=1.0, restitution=0.8)
    >>> ball = epp.LureSystem.build(
    ...     [[0.0, 1.0], [0.0, 0.0]],
    ...     [[0.0], [1.0]],
    ...     [[1.0, 0.0], [0.0, 1.0]],
    ...     [floor],
    ...     constant_state=[0.0, -9.81],
    ...     x0=[1.0, 0.0],
    ... )
    >>> run = epp.simulate(ball, t_end=1.0)
    >>> [round(e.time, 3) for e in run.events if "hits" in e.name]
    [0.452]
    """

    n_inputs: ClassVar[int] = 2
    input_ports: ClassVar[tuple[str, ...]] = ("position", "rate")
    input_is = "way"
    output_is = "force"
    linear_gain_is: ClassVar[str] = "without impacts"
    units = MappingProxyType({"lower": IN, "upper": IN, "mass": _MASS, "restitution": RATIO})

    lower: float
    upper: float
    mass: float
    restitution: float = 1.0

    def __post_init__(self) -> None:
        require_numbers(self, mass=POSITIVE, restitution=NOT_NEGATIVE)
        require(self, "restitution", self.restitution <= 1.0, "0 to 1")
        require(self, "lower", self.lower < self.upper, "less than upper", "upper")

    @property
    def has_impulses(self) -> bool:
        """Its force is nothing else."""
        return True

    def output(self, x: Any, memory: Any = None) -> tuple[Any, Any]:
        """Force for (position, speed) between impacts: none."""
        position, speed = (floats(z, "output: x") for z in x)
        return 0.0 * (position + speed), memory

    def describing_function(self, amplitude: ArrayLike, bias: ArrayLike = 0.0, omega: ArrayLike = 1.0) -> Answer:
        """None.

        Raises
        ------
        ModelError
            Always: its output has impulses.
        """
        raise ModelError(
            "ImpactStop: a sine passes through its limits, so that it has no describing function",
            expected="a run, a search by runs, or the exact orbit",
        )

    def linear_gain(self) -> Array:
        """Zero: without impacts there is no force."""
        return np.zeros((1, 2))

    def automaton(self) -> Automaton:
        """A mode for either direction of the speed, in which the limit ahead alone is looked for."""
        build = AutomatonBuilder(n_inputs=2)
        outward, inward = build.mode("moves up"), build.mode("moves down")
        for mode, other, way, name in ((outward, inward, 1.0, "upper"), (inward, outward, -1.0, "lower")):
            # At a limit that it leaves the direction is what decides, so that it comes first.
            build.guard(f"turns {'down' if way > 0 else 'up'}", mode, other, on_input=[0.0, -way])
            impulse = [0.0, -(1.0 + self.restitution) * self.mass]
            at = float(-way * getattr(self, name))
            build.guard(f"hits the {name} limit", mode, other, on_input=[way, 0.0], constant=at, impulse=impulse)
        return build.build(outward)
