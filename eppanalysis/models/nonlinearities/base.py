"""What every element offers: its map in time, its describing function, its automaton."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from eppanalysis.models.automaton import Automaton


class Nonlinearity(ABC):
    """One nonlinear element of a loop.

    Attributes
    ----------
    n_inputs, n_outputs : int
        Numbers of scalar inputs and outputs. Only the first input is excited in the describing function; a second one
        is its rate (lock pin) or a clock.
    """

    n_inputs: ClassVar[int] = 1
    n_outputs: ClassVar[int] = 1

    @abstractmethod
    def output(self, x: Any, memory: Any = None) -> tuple[Any, Any]:
        """Output for the input `x` that is reached, monotonically, from the state `memory`: (output, memory)."""

    @abstractmethod
    def describing_function(
        self, amplitude: ArrayLike, bias: ArrayLike = 0.0, omega: ArrayLike = 1.0
    ) -> tuple[NDArray[np.float64], NDArray[np.complex128]]:
        """Mean output and complex gain for ``x = bias + amplitude * sin(omega t)``.

        The output is approximated by ``mean + Im(gain * amplitude * exp(j omega t))``: with
        ``y ~ mean + b1 sin + a1 cos`` the gain is ``(b1 + j a1)/amplitude``. Arguments broadcast; with several
        outputs both results have a trailing axis of length `n_outputs`.
        """

    @abstractmethod
    def automaton(self) -> Automaton:
        """Modes, guards and resets of the element for the hybrid system."""

    def start(self, automaton: Automaton, memory: Any = None) -> tuple[int, NDArray[np.float64]]:
        """Mode and held values at a start with a memory as `output` takes it (None: the element's own).

        The mode need not be the one in which the element is: what an input has passed it leaves at once.
        """
        held = automaton.start_held.copy()
        if memory is not None and held.size:
            held[0] = memory
        return automaton.start_mode, held

    def memory_at(
        self, mode: int, held: NDArray[np.float64], x: NDArray[np.float64], output: NDArray[np.float64]
    ) -> Any:
        """What `output` and `start` take as memory, in a mode with held values, shape (n_held,), input and output."""
        return self.held_at(output)

    def held_at(self, output: NDArray[np.float64]) -> float | None:
        """First held value of the automaton for an output, shape (n_outputs,); None without such a memory."""
        return None

    def thresholds(self) -> NDArray[np.float64]:
        """Positive amplitudes at which the describing function changes its form (the scales of an amplitude search)."""
        return np.zeros(0)
