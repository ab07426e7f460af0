"""Blocks and elements in series, closed to a ring: its state space."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from eppanalysis.arrays import Array
from eppanalysis.models.elements.base import Nonlinearity
from eppanalysis.models.systems.linear import StateSpace, as_state_space


class Ring:
    """Series connection of blocks: each signal is a row (on the state, on the element outputs)."""

    def __init__(self, elements: Sequence[Nonlinearity], linear: Sequence[StateSpace]) -> None:
        self.n = sum(s.A.shape[0] for s in linear)
        self.n_elements = len(elements)

    def close(self, blocks: Sequence[Any], feedback: int) -> tuple[Array, Array, Array, Array]:
        """Matrices A, B, C, D of the ring, `feedback` in front of the first block."""
        n, m = self.n, self.n_elements
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
