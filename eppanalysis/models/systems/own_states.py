"""Linear states that elements bring themselves: their signals in the loop, and all of them as one system."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from eppanalysis.arguments import floats
from eppanalysis.arrays import Array
from eppanalysis.errors import ModelError
from eppanalysis.models.elements.base import Nonlinearity, OwnStates


def ports(element: Nonlinearity) -> tuple[int, int]:
    """Numbers of the loop's signals before and behind an element: its inputs and outputs, but for its own states."""
    own = element.own_states
    return (element.n_inputs, element.n_outputs) if own is None else (own.n_before, own.n_behind)


def own_count(element: Nonlinearity) -> int:
    """Number of the linear states that an element brings."""
    return 0 if element.own_states is None else len(element.own_states.A)


def _inputs_inside(element: Nonlinearity) -> int:
    """Number of inputs of what is in the loop behind an element's own states."""
    return (element.inside or element).n_inputs


def passes_outputs(element: Nonlinearity) -> bool:
    """Whether the loop's signals behind an element are the outputs of its automaton, and nothing else has them.

    Only then may they be late: what own states or inputs take from an output, as a controller with anti-windup does,
    they take at once.
    """
    own = element.own_states
    if own is None:
        return True
    inside = _inputs_inside(element)
    behind = np.hstack([own.C, own.D])[inside:]
    outputs = np.eye(element.n_outputs, own.n_before + len(own.A) + element.n_outputs, len(own.A) + own.n_before)
    taken = np.vstack([own.B, own.D[:inside]])[:, own.n_before :]
    return behind.shape == outputs.shape and bool(np.all(behind == outputs)) and not np.any(taken)


def stacked(elements: Sequence[Nonlinearity]) -> dict[str, Array]:
    """Own states of all elements as one system; what has none passes x to z and w to y."""
    return side_by_side([_fitting(e) for e in elements])


def _fitting(element: Nonlinearity) -> OwnStates:
    """What is between the loop and an automaton, checked against their signals."""
    own, outputs = element.own_states, element.n_outputs
    if own is None:
        n = element.n_inputs
        return OwnStates(
            np.zeros((0, 0)), np.zeros((0, n + outputs)), np.zeros((n + outputs, 0)), np.eye(n + outputs), n, outputs
        )
    rows, columns = _inputs_inside(element) + own.n_behind, own.n_before + outputs
    shapes = {"B": (len(own.A), columns), "C": (rows, len(own.A)), "D": (rows, columns)}
    for name, shape in shapes.items():
        found = getattr(own, name).shape
        if found != shape:
            who = type(element).__name__
            raise ModelError(f"{who}: {name} of its own states has shape {found}; expected {shape}.")
    return own


def side_by_side(parts: Sequence[OwnStates]) -> dict[str, Array]:
    """Several such parts as one system, by the signals between which its matrices act."""
    blocks: dict[str, list[Array]] = {}
    for own in parts:
        x, z = own.n_before, len(own.C) - own.n_behind
        named = {
            "A": own.A, "B_x": own.B[:, :x], "B_w": own.B[:, x:], "C_z": own.C[:z], "C_y": own.C[z:],
            "D_zx": own.D[:z, :x], "D_zw": own.D[:z, x:], "D_yx": own.D[z:, :x], "D_yw": own.D[z:, x:],
        }  # fmt: skip
        for name, block in named.items():
            blocks.setdefault(name, []).append(block)
    rate = np.concatenate([np.zeros(0), *(own.rate for own in parts if own.rate is not None)])
    return {name: diagonal(found) for name, found in blocks.items()} | {"rate": rate[:, None]}


def started(elements: Sequence[Nonlinearity], memory: Sequence[Any]) -> tuple[Array, tuple[Any, ...]]:
    """Own states of all elements at the start, and what is left for their automata to remember.

    Raises
    ------
    ModelError
        If what an element is to remember, as whose states, is not one finite number for each.
    """
    starts, rest = [np.zeros(0)], []
    for e, value in zip(elements, memory, strict=True):
        own = e.own_states
        if own is not None and own.start is not None:
            here = own.start
            if e.inside is not None and value is not None:
                here, value = floats(value, f"{type(e).__name__}: memory", ndmin=1), None
                if here.shape != own.start.shape or not np.all(np.isfinite(here)):
                    raise ModelError(f"{type(e).__name__}: memory", here.tolist(), f"{own.start.size} finite numbers")
            starts.append(here)
        rest.append(value)
    return np.concatenate(starts), tuple(rest)


def diagonal(blocks: Sequence[Array]) -> Array:
    """Blocks of any shape, empty ones too, along the diagonal of a matrix of zeros."""
    out = np.zeros((sum(len(b) for b in blocks), sum(b.shape[1] for b in blocks)))
    i = j = 0
    for b in blocks:
        out[i : i + b.shape[0], j : j + b.shape[1]] = b
        i, j = i + b.shape[0], j + b.shape[1]
    return out
