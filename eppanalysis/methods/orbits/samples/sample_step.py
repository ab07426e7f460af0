"""One sample of a loop in discrete time, for many states at once, with its derivative."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from eppanalysis.arrays import Array, BoolArray, IntArray
from eppanalysis.methods.simulation.effort import spend
from eppanalysis.methods.simulation.iterate import cascade_order, whole_samples
from eppanalysis.models.elements.memory import Slip
from eppanalysis.models.systems.lure import LureSystem

#: Steps of differences relative to the motion, the largest first: between pieces' borders they are exact to rounding.
_STEPS = (1e-3, 1e-5, 1e-7)
#: What a sample of any number of states is worth in steps of the engine, and one of a single state; with the derivative
#: so many times as much.
_SAMPLE, _STATE, _DERIVATIVE = 40.0, 0.2, 3.0


@dataclass(frozen=True, eq=False)
class Step:
    """One sample of a loop, for many states at once.

    A state (d,) holds the states of the loop, one memory value for each element with memory, and the outputs on their
    way through dead times, the latest first. What else a memory holds (the way it slides, the input it reached) decides
    on pieces alone and is handed along beside it.
    """

    system: LureSystem
    value: Array

    @cached_property
    def order(self) -> list[int]:
        """Elements in the order in which they feed each other."""
        return cascade_order(self.system)

    @cached_property
    def lag(self) -> IntArray:
        """Dead time of each output in samples."""
        return whole_samples(self.system, "a dead time", self.system.delays)

    @cached_property
    def remembers(self) -> list[int]:
        """Elements with a memory."""
        return [i for i, e in enumerate(self.system.elements) if e.output(np.zeros(1), None)[1] is not None]

    @property
    def size(self) -> int:
        """Length d of a state."""
        return self.system.A.shape[0] + len(self.remembers) + int(self.lag.sum())

    def begin(self, x: Array, memory: Sequence[Any]) -> tuple[Array, list[Any]]:
        """States (m, d) and marks for states (m, n) of the loop and starts of the memories."""
        stored = np.zeros((len(x), len(self.remembers)))
        S = np.concatenate([x, stored, np.zeros((len(x), int(self.lag.sum())))], 1)
        W, marks = self._outputs(S, [None if m is None else np.full(len(x), float(m)) for m in memory])[:2]
        for place, i in enumerate(self.remembers):
            S[:, x.shape[1] + place] = _value(marks[i])
        S[:, self.size - int(self.lag.sum()) :] = np.repeat(W, self.lag, axis=1)
        return S, marks

    def advance(
        self, S: Array, marks: list[Any], scale: Array | None = None, careful: bool = False
    ) -> tuple[Array, list[Any], Array, Any]:
        """States one sample later, marks, outputs (m, nw), and with a `scale` (d,) of the motion the derivative.

        The derivative is good enough for Newton's method, or with `careful` exact to rounding.

        Returns
        -------
        (S, marks, W, (J, border)) : array (m, d), list, array (m, nw), (array (m, d, d), bool array (m,)) or None
            `border` tells where an element is where two of its pieces meet.

        Raises
        ------
        Spent
            If the search that it belongs to may compute no more.
        """
        spend((_SAMPLE + _STATE * len(S)) * (1.0 if scale is None else _DERIVATIVE))
        system, n, h = self.system, self.system.A.shape[0], len(self.remembers)
        memory: list[Any] = [None] * len(system.elements)
        for place, i in enumerate(self.remembers):
            stored = S[:, n + place]
            memory[i] = marks[i]._replace(value=stored) if isinstance(marks[i], Slip) else stored
        W, after, dW, dM, border = self._outputs(S, memory, scale, careful)
        late, buffer, place = W.copy(), [], n + h
        d_late, d_buffer = (dW.copy() if scale is not None else None), []
        eye = np.broadcast_to(np.eye(self.size), (len(S), self.size, self.size))
        # What is on its way through a dead time stands behind the states, the newest first: each sample puts the output
        # in front and takes the oldest off.
        for j, lag in enumerate(self.lag):
            if lag:
                late[:, j] = S[:, place + lag - 1]
                buffer += [W[:, j : j + 1], S[:, place : place + lag - 1]]
                if d_late is not None:
                    d_late[:, j] = eye[:, place + lag - 1]
                    d_buffer += [dW[:, j : j + 1], eye[:, place : place + lag - 1]]
                place += lag
        x = S[:, :n] @ system.A.T + late @ system.B.T + system.B_input @ self.value + system.constant_state
        stored = np.stack([_value(after[i]) for i in self.remembers], 1) if h else np.zeros((len(S), 0))
        out = np.concatenate([x, stored, *buffer], 1)
        if d_late is None:
            return out, after, W, None
        dx = system.A @ eye[0, :n] + np.einsum("ij,mjk->mik", system.B, d_late)
        return out, after, W, (np.concatenate([dx, dM, *d_buffer], 1), border)

    def _outputs(
        self, S: Array, memory: list[Any], scale: Array | None = None, careful: bool = False
    ) -> tuple[Array, list[Any], Array, Array, BoolArray]:
        """Outputs, memories behind them, and their derivatives by the state."""
        system, m, n, d = self.system, len(S), self.system.A.shape[0], self.size
        W, dW = np.zeros((m, system.B.shape[1])), np.zeros((m, system.B.shape[1], d))
        dM, border, after = np.zeros((m, len(self.remembers), d)), np.zeros(m, bool), list(memory)
        forced = system.D_input @ self.value + system.constant_input
        # Each element behind those whose outputs act on its input within the sample: what it sees is known by then.
        for i in self.order:
            element, zs, ws = system.elements[i], system.input_slices[i].start, system.output_slices[i]
            z = S[:, :n] @ system.C[zs] + W @ system.D[zs] + forced[zs]
            y, after[i] = element.output(z, memory[i])
            W[:, ws] = np.reshape(y, (m, -1))
            if scale is None:
                continue
            dz = np.einsum("j,mjk->mk", system.D[zs], dW)
            dz[:, :n] += system.C[zs]
            size = float(np.abs(system.C[zs]) @ scale[:n]) + float(np.abs(system.D[zs]) @ np.abs(W).max(0)) + 1e-300
            here = _beside(y, after[i], m)
            by_z, edge = _slope(lambda e: self._answer(i, z + e, memory[i], m), here, z, size, careful)  # noqa: B023
            dW[:, ws] = by_z[:, :-1, None] * dz[:, None]
            border |= edge
            if i in self.remembers:
                place = self.remembers.index(i)
                by_h, edge = _slope(lambda e: self._answer(i, z, _moved(memory[i], e), m), here, z, size, careful)  # noqa: B023
                dW[:, ws, n + place] += by_h[:, :-1]
                dM[:, place] = by_z[:, -1, None] * dz
                dM[:, place, n + place] += by_h[:, -1]
                border |= edge
        return W, after, dW, dM, border

    def _answer(self, i: int, z: Array, memory: Any, m: int) -> Array:
        """Outputs of an element, and its memory value last, (m, outputs + 1)."""
        return _beside(*self.system.elements[i].output(z, memory), m)


def _beside(y: Array, memory: Any, m: int) -> Array:
    """Outputs and memory value of m states, (m, outputs + 1)."""
    stored = np.zeros(m) if memory is None else np.broadcast_to(_value(memory), (m,))
    return np.concatenate([np.reshape(y, (m, -1)), stored[:, None]], 1)


def _value(memory: Any) -> Array:
    return np.asarray(memory.value if isinstance(memory, Slip) else memory, float)


def _moved(memory: Any, by: float) -> Any:
    return memory._replace(value=_value(memory) + by) if isinstance(memory, Slip) else memory + by


def _slope(f: Callable[[float], Array], here: Array, z: Array, size: float, careful: bool) -> tuple[Array, BoolArray]:
    """Slopes (m, k) of f, f(0) is `here`; `careful`: of the largest step on which both sides agree, where any does."""
    if not careful:
        e = _STEPS[-1] * size
        return (f(e) - here) / e, np.zeros(len(here), bool)
    out, open_ = np.zeros_like(here), np.ones(here.shape, bool)
    for step in _STEPS:
        e = step * size
        left, right = (here - f(-e)) / e, (f(e) - here) / e
        noise = 8 * np.finfo(float).eps * (np.abs(here) + np.abs(z)[:, None]) / e
        agree = np.abs(left - right) <= 1e-9 * (np.abs(left) + np.abs(right)) + noise
        out = np.where(open_, 0.5 * (left + right), out)
        open_ &= ~agree
    return out, np.asarray(open_.any(1), bool)
