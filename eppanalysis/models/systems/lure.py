"""The Lur'e system: a linear state space with named signals, closed by any number of elements.

    dx/dt = A x + B w(t - delay) + B_input v + constant_state
    z     = C x + D w + D_input v + constant_input        inputs of the elements, stacked
    w     = elements(z)                                    outputs of the elements, stacked

``v`` are external inputs. With `time_step` set, the first line is ``x[k+1] = ...`` instead (discrete time).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from eppanalysis.arguments import checked, floats
from eppanalysis.errors import ModelError
from eppanalysis.models.elements.base import Nonlinearity
from eppanalysis.models.systems.linear import StateSpace, as_state_space, balanced, integrators_apart
from eppanalysis.models.systems.own_states import own_count, ports, stacked
from eppanalysis.models.systems.ring import Ring
from eppanalysis.models.systems.signals import (
    SignalMap,
    checked_array,
    element_signals,
    labels_of,
    require,
    require_names,
    slices,
    state_names_of,
)

if TYPE_CHECKING:
    import control

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class LureSystem:
    """A linear state space closed by nonlinear elements.

    Parameters
    ----------
    A : array, shape (n, n)
        State matrix.
    B : array, shape (n, nw)
        From the stacked outputs of the elements to the state rate.
    C : array, shape (nz, n)
        From the state to the stacked inputs of the elements.
    D : array, shape (nz, nw)
        From the outputs of the elements straight to their inputs (cascades); the loop gain through D and the elements'
        slopes must stay regular.
    elements : tuple of Nonlinearity
        In the order in which their inputs and outputs are stacked.
    element_names : tuple of str
    signals : SignalMap
        The named signals.
    B_input, D_input : array, shapes (n, nv) and (nz, nv)
        From the external inputs.
    input_names : tuple of str
    constant_state, constant_input : array, shapes (n,) and (nz,)
        Constant terms.
    x0 : array, shape (n,)
        State at the start.
    v0 : array, shape (nv,)
        External inputs before the start, where the operating point is.
    memory : tuple
        What each element remembers at the start, as its ``output`` takes it; None takes the element's own.
    delays : array, shape (nw,)
        Dead time of each element output [s] on its way to the state rate.
    time_step : float or None
        Sample time [s] of a discrete-time system.
    principal : int
        Element at which margins and pictures cut the loop.
    """

    A: Array
    B: Array
    C: Array
    D: Array
    elements: tuple[Nonlinearity, ...]
    element_names: tuple[str, ...]
    signals: SignalMap
    B_input: Array
    D_input: Array
    input_names: tuple[str, ...]
    constant_state: Array
    constant_input: Array
    x0: Array
    v0: Array
    memory: tuple[Any, ...]
    delays: Array
    time_step: float | None = None
    state_names: tuple[str, ...] = ()
    name: str = "loop"
    principal: int = 0

    @classmethod
    @checked
    def build(
        cls,
        A: ArrayLike,
        B: ArrayLike,
        C: ArrayLike,
        elements: Sequence[Nonlinearity],
        *,
        D: ArrayLike | None = None,
        B_input: ArrayLike | None = None,
        D_input: ArrayLike | None = None,
        input_names: Sequence[str] = (),
        constant_state: ArrayLike | None = None,
        constant_input: ArrayLike | None = None,
        element_names: Sequence[str] | None = None,
        signals: SignalMap | None = None,
        x0: ArrayLike | None = None,
        v0: ArrayLike | None = None,
        memory: Sequence[Any] | None = None,
        delays: ArrayLike | None = None,
        time_step: float | None = None,
        state_names: Sequence[str] | None = None,
        principal: int = 0,
        name: str = "loop",
    ) -> LureSystem:
        """Make a system from what is not zero; everything else is filled in and all shapes are checked.

        Where an element brings linear states of its own, what is given has the places of the signals before and behind
        it; its states are appended to those given.

        Raises
        ------
        ModelError
            If shapes or lengths do not fit, a number is not finite, two elements have one name, a dead time or the
            sample time is negative, or an element with states of its own has a dead time or stands in discrete time.
        """
        A = np.atleast_2d(np.asarray(A, float))
        if A.size and (A.ndim != 2 or A.shape[0] != A.shape[1]):
            raise ModelError(f"{name}: A has shape {A.shape}", expected="a square matrix", field="A")
        n = A.shape[0] if A.size else 0
        A = A.reshape(n, n)
        nz, nw = (sum(ports(e)[k] for e in elements) for k in (0, 1))
        nv = len(input_names)

        array = partial(checked_array, name)
        labels = labels_of(elements, element_names)
        starts = tuple(memory) if memory is not None else (None,) * len(elements)
        require_names(name, labels, len(elements))
        require(name, "memory", starts, len(starts) == len(elements), f"{len(elements)}, one for each element")
        require(name, "time_step", time_step, time_step is None or 0 < time_step < np.inf, "a positive number or None")
        waits = array("delays", delays, (nw,))
        require(name, "delays", waits.tolist(), bool(np.all(waits >= 0)), "zero or positive numbers")
        C, D = array("C", C, (nz, n)), array("D", D, (nz, nw))
        D_input, constant_input = array("D_input", D_input, (nz, nv)), array("constant_input", constant_input, (nz,))
        if signals is None:
            signals = element_signals(elements, labels, C, D, D_input, constant_input)
        require(name, "principal", principal, 0 <= principal < max(1, len(elements)), "the number of an element")
        made = cls(
            A=array("A", A, (n, n)),
            B=array("B", B, (n, nw)),
            C=C,
            D=D,
            elements=tuple(elements),
            element_names=labels,
            signals=signals,
            B_input=array("B_input", B_input, (n, nv)),
            D_input=D_input,
            input_names=tuple(input_names),
            constant_state=array("constant_state", constant_state, (n,)),
            constant_input=constant_input,
            x0=array("x0", x0, (n,)),
            v0=array("v0", v0, (nv,)),
            memory=starts,
            delays=waits,
            time_step=time_step,
            state_names=state_names_of(name, state_names, n),
            name=name,
            principal=principal,
        )
        return with_own_states(made) if any(e.own_states is not None for e in elements) else made

    @classmethod
    @checked
    def from_tf(
        cls,
        plant: control.TransferFunction | control.StateSpace | StateSpace | tuple[ArrayLike, ArrayLike],
        element: Nonlinearity,
        *,
        delay: float = 0.0,
        feedback: int = -1,
        x0: ArrayLike | None = None,
        memory: Any = None,
        name: str = "loop",
    ) -> LureSystem:
        """The textbook loop: ``x = feedback * G y``, ``y = element(x)``; element input "x", output "y".

        Parameters
        ----------
        plant : control.TransferFunction, control.StateSpace, StateSpace or (numerator, denominator)
            Linear part G, single input and output, proper; a discrete-time system makes a discrete-time loop.
        element : Nonlinearity
            With one input and one output.
        delay : float, optional
            Dead time of G [s].
        feedback : {-1, 1}
            Sign of the feedback.
        x0 : array, optional
            State of G at the start; by default all its states are 1, which leaves the equilibrium.

        Raises
        ------
        ModelError
            If the transfer function is improper, G is not single-input single-output, `delay` is negative, or
            `feedback` is neither -1 nor 1.

        Examples
        --------
        >>> import eppanalysis as epp
        >>> loop = epp.LureSystem.from_tf(([5.0], [1.0, 1.0, 0.0]), epp.Play(gap=2.0))
        >>> loop.A.shape
        (2, 2)
        """
        return cls.from_blocks(
            [element, as_state_space(plant)], delay=delay, feedback=feedback, x0=x0, memory=[memory], name=name
        )

    @classmethod
    @checked
    def from_blocks(
        cls,
        blocks: Sequence[Any],
        *,
        delay: float = 0.0,
        feedback: int = -1,
        x0: ArrayLike | None = None,
        memory: Sequence[Any] | None = None,
        element_names: Sequence[str] | None = None,
        name: str = "loop",
    ) -> LureSystem:
        """A ring of linear blocks and elements in series, closed by `feedback` from the last block to the first.

        Parameters
        ----------
        blocks : sequence
            Nonlinearity, or anything that :func:`as_state_space` takes, in the direction of the signal.
        delay : float, optional
            Dead time [s]; the loop is linear up to the elements' place, so it is put behind the first element.

        Raises
        ------
        ModelError
            If no block is an element, sample times differ, or `feedback` is neither -1 nor 1.
        """
        require(name, "feedback", feedback, feedback in (-1, 1), "-1 or 1")
        elements = [b for b in blocks if isinstance(b, Nonlinearity)]
        if not elements:
            raise ModelError(f"{name}: a loop needs at least one nonlinear element.")
        for e in elements:
            if ports(e) != (1, 1):
                raise ModelError(
                    f"{name}: {type(e).__name__} has several inputs or outputs; give the state space instead."
                )
        linear = [as_state_space(b) for b in blocks if not isinstance(b, Nonlinearity)]
        steps = {s.time_step for s in linear}
        if len(steps) > 1:
            raise ModelError(f"{name}: the linear blocks have different sample times {sorted(map(str, steps))}.")
        ring = Ring(elements, linear)
        A, B, C, D = ring.close(blocks, feedback)
        n = A.shape[0]
        delays = np.zeros(len(elements))
        delays[0] = delay
        if delay and (len(elements) > 1 and np.any(D[:, 0])):
            raise ModelError(
                f"{name}: dead time straight between two elements is not supported; put a linear block between."
            )
        single = ("x", "y") if len(elements) == 1 else None
        labels = labels_of(elements, element_names)
        require_names(name, labels, len(elements))
        signals = element_signals(elements, labels, C, D, np.zeros((len(C), 0)), np.zeros(len(C)), single)
        return cls.build(
            A,
            B,
            C,
            elements,
            D=D,
            element_names=labels,
            signals=signals,
            x0=np.ones(n) if x0 is None else x0,
            memory=memory,
            delays=delays,
            time_step=steps.pop() if steps else None,
            name=name,
        )

    def in_coordinates(self, T: Array, inverse: Array) -> LureSystem:
        """The same loop with another state y, where ``x = T y`` and ``y = inverse x``."""
        return replace(
            self,
            A=inverse @ self.A @ T,
            B=inverse @ self.B,
            C=self.C @ T,
            B_input=inverse @ self.B_input,
            constant_state=inverse @ self.constant_state,
            x0=inverse @ self.x0,
            signals=replace(self.signals, C=self.signals.C @ T),
        )

    @cached_property
    def with_integrators_apart(self) -> tuple[LureSystem, Array]:
        """The loop in coordinates in which integrators have rows of zeros in A, and T of ``x = T y``.

        In other coordinates (rotated, balanced, identified) rounding makes slow poles of integrators. Where they show
        as the loop is given, it stays as it is. In discrete time an integrator has its pole at one.
        """
        n = self.A.shape[0]
        unit = np.eye(n) if self.time_step else np.zeros((n, n))
        if not n:
            return self, unit
        even, size = balanced(self.A - unit)
        apart, Q, k = integrators_apart(even)
        if n - k <= int(np.sum(np.linalg.eigvals(self.A - unit) == 0)):
            return self, np.eye(n)
        T, inverse = size[:, None] * Q, Q.T / size
        return replace(self.in_coordinates(T, inverse), A=apart + unit), T

    @cached_property
    def input_slices(self) -> tuple[slice, ...]:
        """Where each element's inputs stand in ``z``."""
        return slices([e.n_inputs for e in self.elements])

    @cached_property
    def output_slices(self) -> tuple[slice, ...]:
        """Where each element's outputs stand in ``w``."""
        return slices([e.n_outputs for e in self.elements])

    def frequency_response(self, omega: ArrayLike) -> NDArray[np.complex128]:
        """Response from the elements' outputs to their inputs, shape (..., nz, nw), dead time included.

        Parameters
        ----------
        omega : array_like
            Angular frequency [rad/s]. At a pole, where the response has no value, it is that of the frequency next to
            it, and huge.
        """
        return self._response(floats(omega, "frequency_response: omega"), self.C, self.D)

    def signal_response(self, omega: ArrayLike) -> NDArray[np.complex128]:
        """Response from the elements' outputs to the named signals, shape (..., ns, nw)."""
        return self._response(omega, self.signals.C, self.signals.D)

    def state_response(self, omega: ArrayLike) -> NDArray[np.complex128]:
        """Response from the elements' outputs to the state, shape (..., n, nw)."""
        n, nw = self.B.shape
        return self._response(omega, np.eye(n), np.zeros((n, nw)))

    def frequency_response_and_slope(self, omega: ArrayLike) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
        """:meth:`frequency_response` and its derivative by `omega`, both of shape (..., nz, nw).

        The derivative of the resolvent is its square: a second solution with the first as its right side.
        """
        omega, s, resolvent = self._resolvent(omega)
        ds = 1j * self.time_step * s if self.time_step else 1j
        x = _solved(resolvent, self.B + 0j)
        dx = _solved(resolvent, -np.asarray(ds)[..., None, None] * x)
        if np.any(self.delays):
            late = np.exp(-1j * omega[..., None] * self.delays)[..., None, :]
            x, dx = x * late, (dx - 1j * self.delays * x) * late
        return np.asarray(self.C @ x + self.D, complex), np.asarray(self.C @ dx, complex)

    def _response(self, omega: ArrayLike, C: Array, D: Array) -> NDArray[np.complex128]:
        omega, _, resolvent = self._resolvent(omega)
        x = _solved(resolvent, self.B + 0j)
        if np.any(self.delays):
            x = x * np.exp(-1j * omega[..., None] * self.delays)[..., None, :]
        return np.asarray(C @ x + D, complex)

    def _resolvent(self, omega: ArrayLike) -> tuple[Array, NDArray[np.complex128], NDArray[np.complex128]]:
        """Frequencies, their points s (z in discrete time) and the matrices ``s - A`` there."""
        omega = np.asarray(omega, float)
        s = np.asarray(np.exp(1j * omega * self.time_step) if self.time_step else 1j * omega, complex)
        return omega, s, np.asarray(s[..., None, None] * np.eye(self.A.shape[0]) - self.A, complex)

    def to_control(self) -> control.StateSpace:
        """The linear part from ``w`` to ``z`` as a python-control system (without dead time)."""
        import control

        return control.ss(self.A, self.B, self.C, self.D, *([self.time_step] if self.time_step else []))


def _solved(resolvent: NDArray[np.complex128], right: NDArray[Any]) -> NDArray[Any]:
    """``(s - A)^-1`` times a matrix, for many s; for one that is a pole to the last bit, a rounding beside it."""
    try:
        return np.linalg.solve(resolvent, right)
    except np.linalg.LinAlgError:
        size = np.abs(resolvent).max(axis=(-2, -1), keepdims=True)
        beside = 1j * np.finfo(float).eps * np.where(size > 0, size, 1.0)
        return np.linalg.solve(resolvent + beside * np.eye(resolvent.shape[-1]), right)


def with_own_states(system: LureSystem) -> LureSystem:
    """The loop with the linear states of its elements appended to its own.

    What comes in has B, C, D at the signals before (x) and behind (y) the elements, what goes out at the inputs and
    outputs (z, w) of their automata. With all own states stacked, ``x = C p + D y + ...`` and ``y = C_y s + D_yx x +
    D_yw w`` are solved for x and y as rows on (p, s, w, v, 1).

    Raises
    ------
    ModelError
        If an element with states of its own has a dead time behind it or stands in discrete time, or the algebraic
        loop through one has no solution.
    """
    labels = system.element_names
    first = slices([ports(e)[1] for e in system.elements])
    for element, label, place in zip(system.elements, labels, first, strict=True):
        if element.own_states is not None and (system.time_step or np.any(system.delays[place])):
            what = "discrete time" if system.time_step else "a dead time behind it"
            raise ModelError(f"{system.name}: {label} has states of its own; expected none with {what}.")
    own = stacked(system.elements)
    n, k, nw, nv = len(system.A), len(own["A"]), own["B_w"].shape[1], len(system.v0)
    ends = np.cumsum([0, n, k, nw, nv, 1])
    zero = np.zeros

    def row(*blocks: Array) -> Array:
        return np.hstack(blocks)

    x_given = row(
        system.C, system.D @ own["C_y"], system.D @ own["D_yw"], system.D_input, system.constant_input[:, None]
    )
    closed = np.eye(len(system.C)) - system.D @ own["D_yx"]
    if np.linalg.cond(closed) > 1e14:
        raise ModelError(f"{system.name}: the algebraic loop through {', '.join(labels)} has no unique solution.")
    x = np.linalg.solve(closed, x_given)

    def of(states: Array, outputs: Array, inputs: Array) -> Array:
        """Rows on own states, automata's outputs and signals before the elements."""
        m = len(states)
        return row(zero((m, n)), states, outputs, zero((m, nv + 1))) + inputs @ x

    y, z = of(own["C_y"], own["D_yw"], own["D_yx"]), of(own["C_z"], own["D_zw"], own["D_zx"])
    p = row(system.A, zero((n, k + nw)), system.B_input, system.constant_state[:, None]) + system.B @ y
    rate = np.vstack([p, of(own["A"], own["B_w"], own["B_x"])])
    s = system.signals
    seen = row(s.C, zero((len(s.C), k + nw)), s.D_input, s.constant[:, None]) + s.D @ y
    states, outputs, inputs, one = slice(0, ends[2]), slice(ends[2], ends[3]), slice(ends[3], ends[4]), ends[4]
    delays = [
        system.delays[place] if e.own_states is None else zero(e.n_outputs)
        for e, place in zip(system.elements, first, strict=True)
    ]
    names = (f"{label}_{i}" for e, label in zip(system.elements, labels, strict=True) for i in range(own_count(e)))
    return replace(
        system,
        A=rate[:, states],
        B=rate[:, outputs],
        B_input=rate[:, inputs],
        constant_state=rate[:, one],
        C=z[:, states],
        D=z[:, outputs],
        D_input=z[:, inputs],
        constant_input=z[:, one],
        signals=SignalMap(s.names, seen[:, states], seen[:, outputs], seen[:, inputs], seen[:, one], s.units),
        x0=np.concatenate([system.x0, *(e.own_states.start for e in system.elements if e.own_states is not None)]),
        delays=np.concatenate(delays),
        state_names=(*system.state_names, *names),
    )
