"""A loop some of whose elements are gains: they become part of its linear part."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eppanalysis.arrays import Array
from eppanalysis.errors import ModelError
from eppanalysis.models.systems.lure import LureSystem

#: Condition number from which an algebraic loop has no unique solution.
_SINGULAR = 1e13


def gain_matrix(loop: LureSystem, gains: Mapping[int, NDArray[Any]]) -> NDArray[Any]:
    """Gains of elements, by their numbers, as one matrix from the inputs of all to their outputs, zero elsewhere."""
    K = np.zeros((loop.B.shape[1], loop.C.shape[0]), np.result_type(float, *gains.values()))
    for i, gain in gains.items():
        K[loop.output_slices[i], loop.input_slices[i]] = gain
    return K


def with_gains(loop: LureSystem, gains: Mapping[int, Array]) -> LureSystem:
    """The loop with ``w = gain @ z`` in place of some of its elements, which are elements of it no more.

    With the inputs ``z = C x + D w + D_input v + constant_input`` and K for the gains, ``w = K z`` is solved for the
    outputs that the gains make, as rows on the state, the other outputs, the external inputs and one.

    Parameters
    ----------
    gains : mapping of int to array, shape (outputs, inputs)
        By the number of the element.

    Raises
    ------
    ModelError
        If there is dead time behind one of these elements, or the algebraic loop through them has no unique solution.
    """
    for i in gains:
        if np.any(loop.delays[loop.output_slices[i]]):
            raise ModelError(
                f"{loop.name}: there is dead time behind {loop.element_names[i]}", expected="none behind what is linear"
            )
    K = gain_matrix(loop, gains)
    kept = [i for i in range(len(loop.elements)) if i not in gains]
    places = [np.arange(len(K))[loop.output_slices[i]] for i in kept]
    own = np.concatenate([np.zeros(0, int), *places])
    inputs = np.concatenate([np.zeros(0, int), *(np.arange(K.shape[1])[loop.input_slices[i]] for i in kept)])
    n, nv, m = len(loop.A), loop.B_input.shape[1], len(own)
    E = np.zeros((len(K), m))
    E[own, np.arange(m)] = 1.0
    # z = D K z + ...: what the gains put out may act on their own inputs straight away.
    closed = np.eye(K.shape[1]) - loop.D @ K
    if closed.size and np.linalg.cond(closed) > _SINGULAR:
        raise ModelError(f"{loop.name}: the algebraic loop through its elements has no unique solution.")
    z = np.linalg.solve(closed, np.hstack([loop.C, loop.D @ E, loop.D_input, loop.constant_input[:, None]]))
    w = K @ z
    w[:, n : n + m] += E
    s = loop.signals
    rate = np.hstack([loop.A, np.zeros((n, m)), loop.B_input, loop.constant_state[:, None]]) + loop.B @ w
    seen = np.hstack([s.C, np.zeros((len(s.C), m)), s.D_input, s.constant[:, None]]) + s.D @ w
    z = z[inputs]
    x, outputs, v = slice(0, n), slice(n, n + m), slice(n + m, n + m + nv)
    return replace(
        loop,
        A=rate[:, x], B=rate[:, outputs], B_input=rate[:, v], constant_state=rate[:, -1],
        C=z[:, x], D=z[:, outputs], D_input=z[:, v], constant_input=z[:, -1],
        elements=tuple(loop.elements[i] for i in kept), element_names=tuple(loop.element_names[i] for i in kept),
        memory=tuple(loop.memory[i] for i in kept), delays=loop.delays[own],
        signals=replace(s, C=seen[:, x], D=seen[:, outputs], D_input=seen[:, v], constant=seen[:, -1]),
        principal=0, cuts=None, margins_at=(), given=None,
    )  # fmt: skip
