"""Linear blocks of a diagram, closed among one another."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from eppanalysis.arrays import Array
from eppanalysis.errors import ModelError
from eppanalysis.models.diagrams.blocks import Block
from eppanalysis.models.diagrams.wiring import Port, incidence
from eppanalysis.models.systems.algebraic import acyclic, no_unique_answer, parts_on_loops
from eppanalysis.models.systems.linear import StateSpace
from eppanalysis.models.systems.own_states import diagonal
from eppanalysis.readable import count

Wires = Mapping[Port, list[tuple[float, Port]]]


@dataclass(frozen=True, eq=False)
class Linear:
    """A linear block as it is in a network."""

    system: StateSpace
    input_ports: tuple[Port, ...]
    output_ports: tuple[Port, ...]
    start: np.ndarray
    state_names: tuple[str, ...]

    @classmethod
    def of(cls, name: str, block: Block) -> Linear:
        """A block of a diagram under its name.

        Raises
        ------
        ModelError
            If the states at the start are not as many as the block has.
        """
        system = block.state_space()
        n = len(system.A)
        start = np.zeros(n) if block.start is None else np.asarray(block.start, float)
        if start.shape != (n,):
            raise ModelError(name, start.tolist(), f"{count(n, 'number')}, one for each state", field="start")
        given: Sequence[str] | None = getattr(block, "state_names", None)
        inputs, outputs = (tuple((name, port) for port in ports) for ports in (block.inputs, block.outputs))
        return cls(system, inputs, outputs, start, tuple(_states_of(name, block) if given is None else given))


def _states_of(name: str, block: Block) -> list[str]:
    """What the states of a block are called: after the port that puts one out as it is, else by their numbers."""
    system, several = block.state_space(), len(block.outputs) > 1
    n = len(system.A)
    names = [name] if n == 1 else [f"{name}_{i + 1}" for i in range(n)]
    for row, straight, port in zip(system.C, system.D, block.outputs, strict=True):
        if several and n > 1 and not straight.any() and np.array_equal(row, row.astype(bool)) and row.sum() == 1.0:
            names[int(row.argmax())] = f"{name}_{port}"
    return names


def closed_blocks(blocks: Mapping[str, Linear], wires: Wires, who: str) -> StateSpace:
    """Linear blocks with their connections among one another closed: from a drive at each input to all outputs.

    Parameters
    ----------
    blocks : mapping of str to Linear
        State space and names of the ports of each.

    Raises
    ------
    ModelError
        If a loop without states among them has no unique answer.
    """
    parts = list(blocks.values())
    A, B, C, D = (diagonal([getattr(part.system, name) for part in parts]) for name in "ABCD")
    inputs = [port for part in parts for port in part.input_ports]
    outputs = [port for part in parts for port in part.output_ports]
    W = incidence({port: wires[port] for port in inputs}, inputs, outputs)
    M = _straight_through(D @ W, outputs, who)
    y_x, y_e = M @ C, M @ D
    return StateSpace(A + B @ (W @ y_x), B @ (np.eye(len(inputs)) + W @ y_e), y_x, y_e)


def _straight_through(DW: Array, outputs: Sequence[Port], who: str) -> Array:
    """``(I - D W)^-1``: what goes straight from output to output, any number of times."""
    unit = np.eye(len(DW))
    if acyclic(DW):
        # Without a loop the series ends by itself, and gains stay as they were given: an inverse would round them.
        total = term = unit
        for _ in range(len(DW)):
            term = DW @ term
            if not np.any(term):
                break
            total = total + term
        return total
    if np.linalg.cond(unit - DW) > 1e12:
        loop = (outputs[i][0] for i in parts_on_loops(DW))
        raise no_unique_answer(who, loop, "a gain other than one around it, or a block with states in it")
    return np.asarray(np.linalg.inv(unit - DW))
