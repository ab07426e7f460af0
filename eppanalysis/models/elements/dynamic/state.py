"""What elements share whose output is a state of the loop, driven by a law inside them.

The law is what is in the loop. What the element says of itself, from its input to its output, is what the DF
takes it for.
"""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np

from eppanalysis.arguments import floats
from eppanalysis.arrays import Array
from eppanalysis.models.elements.automaton import Automaton
from eppanalysis.models.elements.base import Nonlinearity, OwnStates

#: Pole of a state in the loop's matrices that its law takes back [rad/s]: without one the balance of means would not
#: determine its mean.
POLE = 1.0


class StateOutput(Nonlinearity):
    """An element whose output is a state, which it holds while its input jumps."""

    of_frequency: ClassVar[bool] = True

    def _set_parts(self, state: OwnStates, law: Nonlinearity, small_signal: Nonlinearity) -> None:
        """Store the state, what drives it and what margins take; subclasses call it when their fields are valid."""
        for name, part in {"own_states": state, "inside": law, "small_signal": small_signal}.items():
            object.__setattr__(self, name, part)

    def output(self, x: Any, memory: Any = None) -> tuple[Any, Any]:
        """Output for an input `x` that is reached in no time: the state, which is its memory."""
        held = 0.0 if memory is None else memory
        return held + 0.0 * floats(x, "output: x"), held

    def thresholds(self, bias: float = 0.0) -> Array:
        """The amplitude from which the input changes its sign."""
        return np.array([abs(bias)]) if bias else np.zeros(0)

    def slope_bounds(self) -> tuple[float, float]:
        """Infinite: the output moves on while the input rests."""
        return -np.inf, np.inf

    def automaton(self) -> Automaton:
        """Automaton of the law inside, whose output drives the state."""
        assert self.inside is not None
        return self.inside.automaton()


def state_of_law(pole: float) -> OwnStates:
    """One state with a pole, for a law that reads the input and the state and drives the state, its output."""
    behind, through = np.array([[0.0], [1.0], [1.0]]), np.array([[1.0, 0.0], [0.0, 0.0], [0.0, 0.0]])
    return OwnStates(np.array([[-pole]]), np.array([[0.0, 1.0]]), behind, through)


def lag(pole: float, gain: float) -> OwnStates:
    """The first-order lag ``dy/dt = -pole y + gain u`` in front of an element, an integrator without a pole."""
    return OwnStates(np.array([[0.0 - pole]]), np.array([[gain, 0.0]]), np.array([[1.0], [0.0]]), np.diag([0.0, 1.0]))
