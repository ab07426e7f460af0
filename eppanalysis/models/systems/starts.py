"""Where a run begins: modes and memory values from what the elements remember, and what they remember from these."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise
from operator import sub
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from eppanalysis.arrays import Array, BoolArray, IntArray
from eppanalysis.engine.tables import Model
from eppanalysis.models.elements.base import Nonlinearity
from eppanalysis.models.elements.memory import Slip

if TYPE_CHECKING:
    from eppanalysis.models.elements.automaton import Automaton

#: Distance from a value, relative to its terms, that is rounding.
_ROUNDING = 1e-9
#: Share of its terms below which a sum is zero but for rounding.
_REMAINDER = 1e-12


class Hybrid(Protocol):
    """What is needed of a hybrid system here; its attributes are those of :class:`HybridSystem`."""

    @property
    def model(self) -> Model:
        """Linear parts and guards."""

    @property
    def automata(self) -> tuple[Automaton, ...]:
        """Of the elements."""

    @property
    def elements(self) -> tuple[Nonlinearity, ...]:
        """In the order of the loop."""

    @property
    def x0(self) -> Array:
        """States."""

    @property
    def H0(self) -> Array:
        """Memory values."""

    @property
    def modes0(self) -> IntArray:
        """Modes."""

    @property
    def n_plant(self) -> int:
        """Number of states of the loop."""


def starting_values(hybrid: Hybrid, state: Array, memory: Sequence[Any]) -> tuple[Array, Array, IntArray]:
    """States, memory values and modes of a hybrid system at a state of its loop with what its elements remember.

    Parameters
    ----------
    state : array, shape (n_plant,)
    memory : sequence
        One for each element, as its `output` takes it; None, or none at all, for the element's own.

    Notes
    -----
    An element that follows its input goes on from there, but where an input that jumps at the start is against that.
    """
    model = hybrid.model
    x, H, modes = hybrid.x0.copy(), hybrid.H0.copy(), hybrid.modes0.copy()
    x[: hybrid.n_plant] = state
    # An input that steps at the start is behind its step already when modes are chosen.
    now = x.copy()
    at_start = model.breakpoint_time <= 0.0
    now[model.breakpoint_state[at_start]] = model.breakpoint_value[at_start]
    for e, automaton in enumerate(hybrid.automata):
        value = memory[e] if e < len(memory) else None
        mode, stored = automaton.start_mode, automaton.start_memory
        if e < len(hybrid.elements):
            mode, stored = hybrid.elements[e].start(automaton, value)
        if automaton.modes[mode].sticking:
            mode = _beside_level(hybrid, e, mode, now)
        elif automaton.followed[mode] and _turned_back(model, e, value, now, H):
            mode = automaton.start_mode
        modes[e] = mode
        H[model.first[e, 2] : model.first[e + 1, 2]] = stored
    return x, H, modes


def _beside_level(hybrid: Hybrid, e: int, mode: int, x: Array) -> int:
    """A sticking mode only where the loop admits it and the input is on the level, else that on its side."""
    model, automaton = hybrid.model, hybrid.automata[e]
    start, row = automaton.modes[mode], model.first[e, 0]
    z = float(model.C[row] @ x + model.Kz[row, -1])
    size = float(np.abs(model.C[row]) @ np.abs(x) + abs(model.Kz[row, -1]))
    holds = admitted(np.array(start.jump), e, model.first, hybrid.automata, model.B, model.C, model.D)
    holds = holds & (not np.any(model.D[row]))
    if holds and abs(z - start.level) <= 1e-12 * size:
        return mode
    for guard in automaton.guards:
        if guard.target == mode and (guard.on_input[0] < 0) == (z > start.level):
            return guard.mode
    return mode


def admitted(
    jump: Array, e: int, first: IntArray, automata: Sequence[Automaton], B: Array, C: Array, D: Array
) -> BoolArray:
    """Whether the loop pulls an element's input back against jumps of its output.

    Held is what the output pulls back by way of the input's rate (docs/theory/engine.md, Modes). What acts straight on
    the input through D must not feel that output, nor be held or curved itself.
    """
    z, w = (int(k) for k in first[e, :2])
    pull, size = C @ B[:, w], np.abs(C) @ np.abs(B[:, w])
    feels = (np.abs(pull) > _REMAINDER * size) | (D[:, w] != 0.0)
    held = (pull[z] * jump < 0) & bool(feels[z] and not D[z, w])
    rows, known, straight = [z], {z}, set[int]()
    while rows:
        for other in {int(np.searchsorted(first[:, 1], j, side="right")) - 1 for j in np.flatnonzero(D[rows.pop()])}:
            inputs = range(*first[other : other + 2, 0])
            straight.add(other)
            held &= not (automata[other].smooth or np.any(feels[inputs]))
            rows += [row for row in inputs if row not in known]
            known.update(inputs)
    # In a ring one of them feels the output: the recursion ends.
    if np.any(held):
        held &= not any(_may_be_held(other, first, automata, B, C, D) for other in straight)
    return np.asarray(held)


def _may_be_held(e: int, first: IntArray, automata: Sequence[Automaton], B: Array, C: Array, D: Array) -> bool:
    """Whether the loop admits any sticking mode of an element."""
    columns = automata[e].mode_columns
    jumps = columns["jump"][columns["sticking"]]
    return bool(np.any(admitted(jumps, e, first, automata, B, C, D)))


def not_held(hybrid: Hybrid) -> tuple[int, ...]:
    """Numbers of the elements that the loop pulls back to a level, but on which what they do acts straight.

    They chatter where they would slide (docs/theory/engine.md, Modes).
    """
    model, found = hybrid.model, []
    for e, automaton in enumerate(hybrid.automata):
        jumps = np.array([mode.jump for mode in automaton.modes if mode.sticking])
        parts = e, model.first, hybrid.automata, model.B, model.C
        if np.any(admitted(jumps, *parts, np.zeros_like(model.D)) & ~admitted(jumps, *parts, model.D)):
            found.append(e)
    return tuple(found)


def _turned_back(model: Model, e: int, memory: Any, x: Array, H: Array) -> bool:
    """Whether an input from the linear part has jumped back from what it had reached."""
    row = model.first[e, 0]
    if not isinstance(memory, Slip) or np.any(model.D[row]):
        return False
    z = float(model.C[row] @ x + model.Kz[row] @ H)
    size = float(np.abs(model.C[row]) @ np.abs(x) + np.abs(model.Kz[row]) @ np.abs(H))
    direction, reached = float(np.asarray(memory.direction)), float(np.asarray(memory.reached))
    return direction * (z - reached) < -_ROUNDING * size


def remembered(hybrid: Hybrid, x: Array, H: Array, modes: IntArray) -> tuple[Any, ...]:
    """What the elements remember at a state, shape (n + inputs,), with memory values, shape (memory,), in
    given modes.
    """
    first, base = hybrid.model.first, (Nonlinearity.memory_at, Nonlinearity.memory_of)
    if all((type(e).memory_at, type(e).memory_of) == base for e in hybrid.elements):
        return (None,) * len(hybrid.elements)
    z, w = _inputs_and_outputs(hybrid, x, H, modes)
    return tuple(
        element.memory_at(
            int(modes[e]),
            H[first[e, 2] : first[e + 1, 2]],
            z[first[e, 0] : first[e + 1, 0]],
            w[first[e, 1] : first[e + 1, 1]],
        )
        for e, element in enumerate(hybrid.elements)
    )


def terms_of_memory(hybrid: Hybrid, x: Array, H: Array, modes: IntArray) -> Array:
    """Sizes of the terms of which events would make each memory value at a state, shape (memory,)."""
    model, size = hybrid.model, np.abs(H)
    seen = np.abs(model.C) @ np.abs(x) + np.abs(model.Kz) @ size
    z, w, laws = seen, np.zeros(model.B.shape[1]), list(_laws(model, modes))
    for _ in laws:  # as far as outputs reach straight through others
        for zs, ws, hs, from_input, from_memory, constant in laws:
            w[ws] = np.abs(from_input) @ z[zs] + (np.abs(from_memory) @ size[hs] + np.abs(constant))
        z = seen + np.abs(model.D) @ w
    terms = np.zeros(H.size)
    for e, (begin, end) in enumerate(pairwise(model.first.tolist())):
        own, zs, hs = model.guard_element == e, slice(begin[0], end[0]), slice(begin[2], end[2])
        n_z, n_h = end[0] - begin[0], end[2] - begin[2]
        of_inputs = np.abs(model.reset_z[own, :n_h, :n_z]) @ z[zs]
        of_values = np.abs(model.reset_h[own, :n_h, :n_h]) @ size[hs] + np.abs(model.reset_0[own, :n_h])
        terms[hs] = (of_inputs + of_values).max(axis=0, initial=0.0)
    return terms


def _laws(model: Model, modes: IntArray) -> Iterator[tuple[slice, slice, slice, Array, Array, Array]]:
    """Of each element the places of its inputs, outputs and memory values, and its outputs on these and a one."""
    for row, (begin, end) in zip((model.mode_first[:-1] + modes).tolist(), pairwise(model.first.tolist()), strict=True):
        (zs, ws, hs), (n_z, n_w, n_h) = map(slice, begin, end), map(sub, end, begin)
        yield zs, ws, hs, model.mode_wz[row, :n_w, :n_z], model.mode_wh[row, :n_w, :n_h], model.mode_w0[row, :n_w]


def input_rows(hybrid: Hybrid, modes: IntArray) -> Array:
    """Inputs of all elements on states and memory values, shape (inputs, n + memory), in modes without smooth channels.

    But for what the outputs of elements that stick add.
    """
    model, n = hybrid.model, hybrid.model.A.shape[0]
    on_y, E = np.hstack([model.C, model.Kz]), np.eye(model.B.shape[1])
    if not np.any(model.D):
        return on_y
    given = np.zeros((len(E), on_y.shape[1]))
    for zs, ws, hs, from_input, from_memory, constant in _laws(model, modes):
        given[ws] = from_input @ on_y[zs]
        given[ws, n + hs.start : n + hs.stop] += from_memory
        given[ws, -1] += constant
        E[ws] -= from_input @ model.D[zs]
    return np.asarray(on_y + model.D @ np.linalg.solve(E, given))


def _inputs_and_outputs(hybrid: Hybrid, x: Array, H: Array, modes: IntArray) -> tuple[Array, Array]:
    """Inputs and outputs of all elements, but for the force of what sticks."""
    model = hybrid.model
    z0 = model.C @ x + model.Kz @ H
    E, w = np.eye(model.B.shape[1]), np.zeros(model.B.shape[1])
    straight = bool(np.any(model.D))
    for e, (zs, ws, hs, from_input, from_memory, constant) in enumerate(_laws(model, modes)):
        automaton = hybrid.automata[e]
        w[ws] = from_input @ z0[zs] + from_memory @ H[hs] + constant
        if automaton.smooth:
            w[ws] += automaton.modes[modes[e]].from_smooth @ automaton.smooth_at(z0[zs])
        if straight:
            E[ws] -= from_input @ model.D[zs]
    if straight:
        w = np.asarray(np.linalg.solve(E, w), float)
    return z0 + model.D @ w, w
