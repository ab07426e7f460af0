"""Linear states that elements bring themselves: their signals in the loop, and all of them as one system."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from eppanalysis.errors import ModelError
from eppanalysis.models.elements.base import Nonlinearity

Array = NDArray[np.float64]


def ports(element: Nonlinearity) -> tuple[int, int]:
    """Numbers of the loop's signals before and behind an element: its inputs and outputs, but for its own states."""
    own = element.own_states
    return (element.n_inputs, element.n_outputs) if own is None else (own.n_before, own.n_behind)


def own_count(element: Nonlinearity) -> int:
    """Number of the linear states that an element brings."""
    return 0 if element.own_states is None else len(element.own_states.A)


def stacked(elements: Sequence[Nonlinearity]) -> dict[str, Array]:
    """Own states of all elements as one system; what has none passes x to z and w to y."""
    parts: dict[str, list[Array]] = {}
    for e in elements:
        before, behind = ports(e)
        own = e.own_states
        k, z = own_count(e), e.n_inputs
        A, B, C, D = (
            np.zeros((0, 0)),
            np.zeros((0, before + e.n_outputs)),
            np.zeros((z + behind, 0)),
            np.eye(z + behind),
        )
        if own is not None:
            A, B, C, D = own.A, own.B, own.C, own.D
        shapes = {"B": (k, before + e.n_outputs), "C": (z + behind, k), "D": (z + behind, before + e.n_outputs)}
        for name, given in zip("BCD", (B, C, D), strict=True):
            if given.shape != shapes[name]:
                who = type(e).__name__
                raise ModelError(f"{who}: {name} of its own states has shape {given.shape}; expected {shapes[name]}.")
        blocks = {
            "A": A, "B_x": B[:, :before], "B_w": B[:, before:], "C_z": C[:z], "C_y": C[z:],
            "D_zx": D[:z, :before], "D_zw": D[:z, before:], "D_yx": D[z:, :before], "D_yw": D[z:, before:],
        }  # fmt: skip
        for name, block in blocks.items():
            parts.setdefault(name, []).append(block)
    return {name: _diagonal(blocks) for name, blocks in parts.items()}


def _diagonal(blocks: Sequence[Array]) -> Array:
    """Blocks of any shape, empty ones too, along the diagonal of a matrix of zeros."""
    out = np.zeros((sum(len(b) for b in blocks), sum(b.shape[1] for b in blocks)))
    i = j = 0
    for b in blocks:
        out[i : i + b.shape[0], j : j + b.shape[1]] = b
        i, j = i + b.shape[0], j + b.shape[1]
    return out
