"""Blocks and elements in series, closed to a ring: its state space."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from eppanalysis.arrays import Array
from eppanalysis.errors import ModelError
from eppanalysis.models.elements.base import Nonlinearity
from eppanalysis.models.systems.linear import StateSpace, as_state_space


class Ring:
    """Series connection of blocks: each signal is a row (on the state, on the element outputs)."""

    def __init__(self, elements: Sequence[Nonlinearity], linear: Sequence[StateSpace]) -> None:
        self.n = sum(s.A.shape[0] for s in linear)
        self.elements = elements

    def close(self, blocks: Sequence[Any], feedback: int) -> tuple[Array, Array, Array, Array]:
        """Matrices A, B, C, D of the ring, `feedback` in front of the first block."""
        n, m = self.n, len(self.elements)
        A, B, C, D = np.zeros((n, n)), np.zeros((n, m)), np.zeros((m, n)), np.zeros((m, m))
        # Start the walk just behind the first element, whose output is a signal of its own.
        first = next(i for i, b in enumerate(blocks) if isinstance(b, Nonlinearity))
        order = [(first + k) % len(blocks) for k in range(1, len(blocks) + 1)]
        on_state, on_element = np.zeros(n), np.eye(m)[0]
        numbers = {i: k for k, i in enumerate(i for i, b in enumerate(blocks) if isinstance(b, Nonlinearity))}
        offsets, total = {}, 0
        for i, b in enumerate(blocks):
            if not isinstance(b, Nonlinearity):
                offsets[i] = total
                total += as_state_space(b).A.shape[0]
        for i in order:
            if i == 0:
                on_state, on_element = feedback * on_state, feedback * on_element
            block = blocks[i]
            if isinstance(block, Nonlinearity):
                k = numbers[i]
                C[k], D[k] = on_state, on_element
                on_state, on_element = np.zeros(n), np.eye(m)[k]
                continue
            s = as_state_space(block)
            rows = slice(offsets[i], offsets[i] + s.A.shape[0])
            A[rows, rows] += s.A
            A[rows] += np.outer(s.B[:, 0], on_state)
            B[rows] += np.outer(s.B[:, 0], on_element)
            out = s.D[0, 0] * on_state
            out[rows] += s.C[0]
            on_state, on_element = out, s.D[0, 0] * on_element
        return A, B, C, D

    def place_of_dead_time(self, D: Array, name: str) -> int:
        """Number of the element that has the dead time of the ring at its output.

        It moves on past each element on which it would act straight, as that does the same later to what comes later.

        Raises
        ------
        ModelError
            If it comes to an element with states of its own, or to none before a block with states.
        """
        for k, element in enumerate(self.elements):
            if k and element.own_states is not None:
                break
            if len(self.elements) == 1 or not np.any(D[:, k]):
                return k
        said = f"{name}: the dead time acts straight on {self.elements[k].called()}"
        raise ModelError(said, expected="a linear block with states in front of it")
