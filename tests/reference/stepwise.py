"""A loop step by step: the linear part exact over each small step, the elements by their own maps with memory.

It has no modes, no events and no rules for jumps: an element sees its input at the end of each step, reached from where
it was. First order in the step, so it witnesses what happens, not digits.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

Array = NDArray[np.float64]


def cascade_order(system: Any) -> list[int]:
    """Elements, each behind those that act on it through D."""
    order: list[int] = []
    while len(order) < len(system.elements):
        for i, z in enumerate(system.input_slices):
            waits = [j for j, w in enumerate(system.output_slices) if j not in order and np.any(system.D[z, w])]
            if i not in order and not waits:
                order.append(i)
    return order


def outputs(system: Any, order: list[int], x: Array, v: Array, memory: list[Any]) -> tuple[Array, list[Any]]:
    """Outputs of all elements at a state with external inputs, and what the elements then remember."""
    w, memory = np.zeros(system.B.shape[1]), list(memory)
    for i in order:
        z = (system.C @ x + system.D @ w + system.D_input @ v + system.constant_input)[system.input_slices[i]]
        y, memory[i] = system.elements[i].output(z[0] if z.size == 1 else z, memory[i])
        w[system.output_slices[i]] = y
    return w, memory


def run_stepwise(system: Any, inputs: Callable[[float], Array], t_end: float, steps: int) -> tuple[Array, Array]:
    """Times, shape (steps + 1,), and the named signals there, shape (steps + 1, signals)."""
    n, h, s = system.A.shape[0], t_end / steps, system.signals
    flow = expm(np.block([[system.A, np.eye(n)], [np.zeros((n, 2 * n))]]) * h)
    over, into = flow[:n, :n], flow[:n, n:]
    x, memory, order = system.x0.copy(), list(system.memory), cascade_order(system)
    times, rows = h * np.arange(steps + 1), []
    for t in times:
        v = inputs(float(t))
        w, memory = outputs(system, order, x, v, memory)
        rows.append(s.C @ x + s.D @ w + s.D_input @ v + s.constant)
        x = over @ x + into @ (system.B @ w + system.B_input @ v + system.constant_state)
    return times, np.array(rows)
