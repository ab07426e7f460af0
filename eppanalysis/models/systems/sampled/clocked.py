"""A loop in discrete time as a sampled controller round a constant plant.

What moves from sample to sample is the controller's state: the states of the loop, and outputs of elements on their
way through dead times, each a whole number of samples. The elements are round it as round any sampled controller, so
that runs, orbits, branches and searches know loops with samples alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from eppanalysis.arrays import Array, IntArray
from eppanalysis.errors import ModelError
from eppanalysis.models.elements.dynamic.sampled import ControllerMemory, SampledController
from eppanalysis.models.systems.lure import LureSystem
from eppanalysis.models.systems.sampled.strobe import sampled_among

#: How near a time must be to a whole number of samples, in samples.
_WHOLE = 1e-6
#: Name of the controller among the elements.
_NAME = "samples"
#: Samples on their way through dead times at most: a matrix of so many rows and columns is held several times.
_MOST_LATE = 4000


@dataclass(frozen=True, eq=False)
class Clocked:
    """A loop in discrete time, and the same loop round a sampled controller.

    Parameters
    ----------
    given : LureSystem
        In discrete time.
    inputs : array, shape (nv,)
        External inputs at the first sample, which is taken before the start.
    """

    given: LureSystem
    inputs: Array

    @classmethod
    def of(cls, system: LureSystem, inputs: Array | None = None) -> Clocked:
        """The loop begun at its own start, by default with its inputs as they are."""
        return cls(system, system.v0 if inputs is None else inputs)

    @property
    def time_step(self) -> float:
        """Sample time [s]."""
        return float(self.given.time_step or 1.0)

    @cached_property
    def lags(self) -> IntArray:
        """Dead time of each output in samples.

        Raises
        ------
        ModelError
            If a state for each of them would fill the memory.
        """
        lags = whole_samples(self.given, "a dead time", self.given.delays)
        if (late := int(lags.sum())) > _MOST_LATE:
            what = f"{self.given.name}: its dead times hold {late} samples, each of which is a state of a run"
            raise ModelError(what, expected=f"at most {_MOST_LATE}, or a longer sample time")
        return lags

    @cached_property
    def controller(self) -> SampledController:
        """What makes the next states of the outputs, of the inputs at the last sample, of those now, and of a constant.

        Its outputs are the states and the inputs of the last sample.
        """
        loop, (A, B) = self.given, self._with_registers()
        nv, nw, k = len(loop.v0), loop.B.shape[1], len(A) - len(loop.A)
        held = np.vstack([loop.B_input, np.zeros((k, nv))])
        constant = np.append(loop.constant_state, np.zeros(k))[:, None]
        read = np.hstack([B, held, np.zeros((len(A), nv)), constant])
        now = np.hstack([np.zeros((nv, nw + nv)), np.eye(nv), np.zeros((nv, 1))])
        begin = self._begin(loop.x0, loop.memory)
        return SampledController(
            A,
            read,
            np.vstack([A, np.zeros((nv, len(A)))]),
            np.vstack([read, now]),
            sample_time=self.time_step,
            offset=self.time_step,
            x0=begin,
            y0=np.append(begin, self.inputs),
        )

    @cached_property
    def system(self) -> LureSystem:
        """The loop round the controller, which comes first among the elements."""
        loop, s = self.given, self.given.signals
        (nz, n), nw, nv, k = loop.C.shape, loop.B.shape[1], len(loop.v0), int(self.lags.sum())
        # Columns: states, registers and inputs that the controller holds, and outputs of the elements.
        x, v, w = slice(0, n), slice(n + k, n + k + nv), slice(n + k + nv, n + k + nv + nw)
        # Rows: what the controller reads, and the inputs of the elements.
        reads = nw + 2 * nv + 1
        D, D_input, signals = np.zeros((reads + nz, w.stop)), np.zeros((reads + nz, nv)), np.zeros((len(s.C), w.stop))
        D[:nw, w], D[nw : nw + nv, v], D_input[nw + nv : nw + 2 * nv] = np.eye(nw), np.eye(nv), np.eye(nv)
        D[reads:, x], D[reads:, v], D[reads:, w] = loop.C, loop.D_input, loop.D
        signals[:, x], signals[:, v], signals[:, w] = s.C, s.D_input, s.D
        return LureSystem.build(
            np.zeros((0, 0)),
            np.zeros((0, w.stop)),
            np.zeros((reads + nz, 0)),
            [self.controller, *loop.elements],
            D=D,
            D_input=D_input,
            constant_input=np.concatenate([np.zeros(reads - 1), [1.0], loop.constant_input]),
            input_names=loop.input_names,
            v0=loop.v0,
            memory=[None, *loop.memory],
            element_names=[_free_name(loop.element_names), *loop.element_names],
            signals=replace(s, C=np.zeros((len(s.C), 0)), D=signals, D_input=np.zeros_like(s.D_input)),
            principal=loop.principal + 1,
            name=loop.name,
        )

    def _with_registers(self) -> tuple[Array, Array]:
        """Matrices of states and registers: an output enters its chain first, and from its last place it acts."""
        loop, lags = self.given, self.lags
        n, nw, k = len(loop.A), loop.B.shape[1], int(lags.sum())
        A, B = np.zeros((n + k, n + k)), np.zeros((n + k, nw))
        A[:n, :n], B[:n] = loop.A, np.where(lags == 0, loop.B, 0.0)
        first = n + np.cumsum(lags) - lags
        for j in np.flatnonzero(lags):
            newest, oldest = first[j], first[j] + lags[j] - 1
            B[newest, j], A[:n, oldest] = 1.0, loop.B[:, j]
            A[newest + 1 : oldest + 1, newest:oldest] = np.eye(lags[j] - 1)
        return A, B

    def _begin(self, state: Array, memory: Sequence[Any]) -> Array:
        """State of the controller: before the start each output has had its first value for ever."""
        if not np.any(self.lags):
            return np.asarray(state, float)
        return np.append(state, np.repeat(outputs_at(self.given, state, self.inputs, memory), self.lags))

    def start(self, state: Array, memory: Sequence[Any]) -> tuple[Array, tuple[Any, ...]]:
        """State and memories of :attr:`system` at a state (n,) of the given loop with what its elements remember.

        Without memories they start by themselves.
        """
        memory = memory or self.given.memory
        begin = self._begin(state, memory)
        control = ControllerMemory(tuple(begin.tolist()), (*begin.tolist(), *self.inputs.tolist()), self.time_step)
        return np.zeros(1), (control, *memory)


def has_samples(system: LureSystem) -> bool:
    """Whether a loop has sampled controllers, or is one in discrete time."""
    return bool(system.time_step or sampled_among(system.elements))


def _free_name(taken: Sequence[str]) -> str:
    name = _NAME
    while name in taken:
        name += "_"
    return name


def whole_samples(system: LureSystem, what: str, times: Array) -> IntArray:
    """Times as numbers of samples.

    Raises
    ------
    ModelError
        If one is no whole number of samples.
    """
    step = float(system.time_step or 1.0)
    counts = np.round(times / step)
    for time in times[np.abs(times / step - counts) > _WHOLE].tolist():
        raise ModelError(f"{system.name}: {what} is {time:g} s", expected=f"a whole number of samples of {step:g} s")
    return np.asarray(counts, np.int64)


def outputs_at(system: LureSystem, x: Array, v: Array, memory: Sequence[Any]) -> Array:
    """Outputs of the elements (nw,) at a state, each element behind those that feed it directly.

    Raises
    ------
    ModelError
        If elements feed each other in a circle.
    """
    w = np.zeros(system.B.shape[1])
    z = system.C @ x + system.D_input @ v + system.constant_input
    for i in cascade_order(system):
        zs, ws = system.input_slices[i], system.output_slices[i]
        value, element = z[zs] + system.D[zs] @ w, system.elements[i]
        w[ws] = element.output(value[0] if element.n_inputs == 1 else value, memory[i])[0]
    return w


def cascade_order(system: LureSystem) -> list[int]:
    """Order in which elements can be evaluated, each after those that feed it directly."""
    m = len(system.elements)
    feeds = np.array([
        [np.any(system.D[zs, ws]) for ws in system.output_slices] for zs in system.input_slices
    ]).reshape(m, m)  # fmt: skip
    order: list[int] = []
    while len(order) < m:
        rest = [i for i in range(m) if i not in order]
        ready = [i for i in rest if not feeds[i, rest].any()]
        if not ready:
            raise ModelError(
                f"{system.name}: elements feed each other in a circle without delay", expected="one sample at least"
            )
        order.append(ready[0])
    return order
