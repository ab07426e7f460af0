"""The Lur'e system: a linear state space with named signals, closed by any number of elements.

    dx/dt = A x + B w(t - delay) + B_input v + constant_state
    z     = C x + D w + D_input v + constant_input        inputs of the elements, stacked
    w     = elements(z)                                    outputs of the elements, stacked

``v`` are external inputs. With `time_step` set, the first line is ``x[k+1] = ...`` instead (discrete time).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from eppanalysis.arguments import ORDINARY, are_ordinary, checked
from eppanalysis.arrays import Array
from eppanalysis.errors import ModelError
from eppanalysis.models.elements.base import Nonlinearity
from eppanalysis.models.elements.dynamic.sampled import on_common_ticks
from eppanalysis.models.elements.foreign import as_element, is_element
from eppanalysis.models.elements.phases import require_ordinary
from eppanalysis.models.elements.piecewise import UNITY
from eppanalysis.models.systems.algebraic import require_unique
from eppanalysis.models.systems.cuts import Cuts, element_cuts, require_places
from eppanalysis.models.systems.interchange.ports import connections, linear_part
from eppanalysis.models.systems.interchange.ring import Ring
from eppanalysis.models.systems.linear import Around, StateSpace, as_state_space, coordinates_with_integrators_apart
from eppanalysis.models.systems.own_states import own_count, passes_outputs, ports, stacked, started
from eppanalysis.models.systems.responses import Responses
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
    import sympy
    from scipy import signal


@dataclass(frozen=True, eq=False)
class LureSystem(Responses):
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
        From the elements' outputs straight to their inputs (cascades); with their slopes that must have one answer.
    elements : tuple of Nonlinearity
        In the order in which their inputs and outputs are stacked.
    element_names : tuple of str
        One for each element; made of their kinds by default.
    signals : SignalMap
        The named signals.
    B_input, D_input : array, shapes (n, nv) and (nz, nv)
        From the external inputs.
    input_names, state_names : tuple of str
        One for each external input and each state.
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
        Element at which pictures cut the loop, and margins by default.
    cuts : Cuts or None
        Places at which the loop can be cut besides the inputs and outputs of its elements.
    margins_at : tuple of str
        Names of the places at which margins cut the loop; empty for the principal element.
    given : LureSystem or None
        The loop as it was given, where elements in it are described together with their own states, or case files know
        them: here the states are appended, and what is inside such an element replaces it.
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
    cuts: Cuts | None = None
    margins_at: tuple[str, ...] = ()
    given: LureSystem | None = None

    @classmethod
    @checked
    def build(
        cls,
        A: ArrayLike,
        B: ArrayLike,
        C: ArrayLike,
        elements: Sequence[Nonlinearity | control.DescribingFunctionNonlinearity],
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
        cuts: Cuts | None = None,
        margins_at: Sequence[str] = (),
        name: str = "loop",
    ) -> LureSystem:
        """Make a system from what is not zero; everything else is filled in and all shapes are checked.

        Where an element brings linear states of its own, the matrices given connect the signals before and behind it,
        and its states are appended to those given. The memory of an element that is described together with its states
        is where these start. The arguments are the fields of the class.

        Raises
        ------
        ModelError
            If shapes or lengths do not fit, a number is not finite, two elements have the same name, a dead time or the
            sample time is negative, a place for margins is not known, an element with states of its own has a dead
            time or is in discrete time, or elements act straight on themselves without one answer.
        """
        elements, A = on_common_ticks([as_element(e) for e in elements]), np.atleast_2d(np.asarray(A, float))
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
        for element in elements:
            require_ordinary(element)
        require(name, "memory", starts, len(starts) == len(elements), f"{len(elements)}, one for each element")
        require(name, "time_step", time_step, time_step is None or 0 < time_step < np.inf, "a positive number or None")
        require(name, "time_step", time_step, are_ordinary(time_step or 0.0), ORDINARY)
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
            cuts=None if cuts is None else cuts.require(name, n, nz, nw),
            margins_at=tuple(margins_at),
        )
        made = with_own_states(made) if any(e.own_states is not None for e in elements) else made
        if made.margins_at or made.cuts is not None:
            require_places(name, made.margins_at, made.places)
        require_unique(name, made.elements, made.element_names, np.where(made.delays > 0.0, 0.0, made.D))
        return made

    @classmethod
    @checked
    def from_tf(
        cls,
        plant: control.LTI
        | signal.lti
        | signal.dlti
        | sympy.Expr
        | sympy.physics.control.TransferFunction
        | StateSpace
        | tuple[ArrayLike, ArrayLike],
        element: Nonlinearity | control.DescribingFunctionNonlinearity,
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
        plant : StateSpace, (numerator, denominator), a system of python-control or scipy.signal, or a sympy expression
            Linear part G, single input and output, proper; a discrete-time system makes a discrete-time loop.
        element : Nonlinearity
            With one input and one output; python-control's elements are taken, too.
        delay : float, optional
            Dead time of G [s].
        feedback : {-1, 1}
            Sign of the feedback.
        x0 : array, optional
            State of G at the start; by default all its states are 1, which leaves the equilibrium.
        memory : optional
            What the element remembers at the start; by default its own start.
        name : str
            Of the loop, in sentences and messages.

        Raises
        ------
        ModelError
            If G is improper or not single-input single-output, `delay` is negative, or `feedback` is not ±1.

        Examples
        --------
        >>> import eppanalysis as epp
        >>> loop = epp.LureSystem.from_tf(([5.0], [1.0, 1.0, 0.0]), epp.Play(gap=2.0))
        >>> loop.A.shape
        (2, 2)
        """
        blocks = [as_element(element), as_state_space(plant)]
        return cls.from_blocks(blocks, delay=delay, feedback=feedback, x0=x0, memory=[memory], name=name)

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
            Elements (python-control's, too) and linear blocks with one input and one output, each a StateSpace, a
            (numerator, denominator), or what :meth:`from_tf` takes as a plant, in the direction of the signal.
        delay : float, optional
            Dead time [s], put behind the first element, or behind the next one where the first acts straight on it.
        feedback, x0, name : optional
            As in :meth:`from_tf`.
        memory, element_names : sequence, optional
            What each element remembers at the start, and its name; by default its own start, and its kind.

        Raises
        ------
        ModelError
            If no block is an element, one has several inputs or outputs, sample times differ, or `feedback` is not ±1.

        Examples
        --------
        >>> import eppanalysis as epp
        >>> blocks = [epp.Saturation(), ([2.0], [1.0, 1.0]), ([1.0], [1.0, 0.0])]
        >>> epp.LureSystem.from_blocks(blocks).A.shape
        (2, 2)
        """
        require(name, "feedback", feedback, feedback in (-1, 1), "-1 or 1")
        blocks = [as_element(b) if is_element(b) else b for b in blocks]
        elements = [b for b in blocks if isinstance(b, Nonlinearity)]
        if not elements:
            raise ModelError(f"{name}: a loop needs at least one nonlinear element.", field="elements")
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
        delays[ring.place_of_dead_time(D, name) if delay else 0] = delay
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
            cuts=None if self.cuts is None else self.cuts.in_coordinates(T, inverse),
        )

    @property
    def around(self) -> Around:
        """What leads from state to state through the elements."""
        return self.B, [(e.n_outputs, e.n_inputs) for e in self.elements], self.C

    @cached_property
    def with_integrators_apart(self) -> tuple[LureSystem, Array]:
        """The loop in coordinates in which integrators have rows of zeros in A, and T of ``x = T y``.

        In other coordinates rounding makes slow poles of integrators. Where they show already the loop stays as it is.
        """
        found = coordinates_with_integrators_apart(self.A, discrete=bool(self.time_step), around=self.around)
        if found is None:
            return self, np.eye(len(self.A))
        A, T, inverse = found
        return replace(self.in_coordinates(T, inverse), A=A), T

    @cached_property
    def input_slices(self) -> tuple[slice, ...]:
        """Places of each element's inputs in ``z``."""
        return slices([e.n_inputs for e in self.elements])

    @cached_property
    def output_slices(self) -> tuple[slice, ...]:
        """Places of each element's outputs in ``w``."""
        return slices([e.n_outputs for e in self.elements])

    @cached_property
    def places(self) -> Cuts:
        """Every place at which the loop can be cut: those given, then the inputs and outputs of the elements."""
        sizes = [(e.n_inputs, e.n_outputs) for e in self.elements]
        of_elements = element_cuts(self.element_names, sizes, self.B, self.C, self.D, self.delays)
        if self.cuts is None:
            return of_elements
        # What hands a signal on before a dead time is a part of the diagram, which has its places there, or none.
        passing = [name for e, name in zip(self.elements, self.element_names, strict=True) if e == UNITY]
        return self.cuts.beside(of_elements, passing)

    def to_control(self) -> control.StateSpace:
        """The linear part as a python-control system with named signals, of which `from_control` makes the loop again.

        Its inputs are the outputs of the elements, then the external inputs; its outputs are the named signals but for
        these, then those inputs of the elements that have no name. Dead time, constant terms and starts are not part of
        it. Points in names, which python-control does not take, are underscores.
        """
        return linear_part(self)

    @property
    def connections(self) -> dict[tuple[str, ...], Nonlinearity]:
        """Each element by what it takes and drives in :meth:`to_control`, as `from_control` takes them."""
        return connections(self)


def _require_room_for_own_states(system: LureSystem, outputs: Sequence[slice]) -> None:
    """No element with states of its own has a dead time behind it or is in discrete time."""
    for element, label, place in zip(system.elements, system.element_names, outputs, strict=True):
        late = np.any(system.delays[place]) and not passes_outputs(element)
        if element.own_states is not None and (system.time_step or late):
            what = "in discrete time"
            if not system.time_step:
                what = "straight before a dead time, or a dead_time block behind it in a diagram"
            raise ModelError(f"{system.name}: {label} has states of its own", expected=f"none {what}")


def with_own_states(system: LureSystem) -> LureSystem:
    """The loop with the linear states of its elements appended to its own.

    What comes in has B, C, D at the signals before (x) and behind (y) the elements, what goes out at the inputs and
    outputs (z, w) of their automata. With all own states stacked, ``x = C p + D y + ...`` and ``y = C_y s + D_yx x +
    D_yw w`` are solved for x and y as rows on (p, s, w, v, 1).

    Raises
    ------
    ModelError
        If an element with states of its own has a dead time behind it or is in discrete time, or the algebraic
        loop through one has no solution.
    """
    first = slices([ports(e)[1] for e in system.elements])
    _require_room_for_own_states(system, first)
    own = stacked(system.elements)
    rate, z, seen, cuts = _rows_with_own_states(system, own)
    n, k, nw, nv = len(system.A), len(own["A"]), own["B_w"].shape[1], len(system.v0)
    states, outputs, inputs, one = slice(0, n + k), slice(n + k, n + k + nw), slice(n + k + nw, n + k + nw + nv), -1
    delays = [
        system.delays[place] if passes_outputs(e) else np.zeros(e.n_outputs)
        for e, place in zip(system.elements, first, strict=True)
    ]
    labels = zip(system.elements, system.element_names, strict=True)
    names = (f"{label}_{i}" for e, label in labels for i in range(own_count(e)))
    s, (x0, memory) = system.signals, started(system.elements, system.memory)
    made = replace(
        system,
        elements=tuple(e.inside or e for e in system.elements),
        memory=memory,
        given=system if any(e.inside is not None or (own_count(e) and e.kind) for e in system.elements) else None,
        A=rate[:, states],
        B=rate[:, outputs],
        B_input=rate[:, inputs],
        constant_state=rate[:, one],
        C=z[:, states],
        D=z[:, outputs],
        D_input=z[:, inputs],
        constant_input=z[:, one],
        signals=replace(s, C=seen[:, states], D=seen[:, outputs], D_input=seen[:, inputs], constant=seen[:, one]),
        x0=np.concatenate([system.x0, x0]),
        delays=np.concatenate(delays),
        state_names=(*system.state_names, *names),
        cuts=cuts,
    )
    return _on_one_clock(made, n)


def _rows_with_own_states(system: LureSystem, own: Mapping[str, Array]) -> tuple[Array, Array, Array, Cuts | None]:
    """Rows on (p, s, w, v, 1) of all states' rates, of z and of the named signals, and the cuts."""
    n, k, nw, nv = len(system.A), len(own["A"]), own["B_w"].shape[1], len(system.v0)
    zero, D, s = np.zeros, system.D, system.signals
    closed = np.eye(len(system.C)) - D @ own["D_yx"]
    if np.linalg.cond(closed) > 1e14:
        through = ", ".join(system.element_names)
        raise ModelError(f"{system.name}: the algebraic loop through {through} has no unique solution.")
    given = np.hstack([system.C, D @ own["C_y"], D @ own["D_yw"], system.D_input, system.constant_input[:, None]])
    x = np.linalg.solve(closed, given)

    def of(states: Array, outputs: Array, inputs: Array) -> Array:
        """Rows on own states, automata's outputs and signals before the elements."""
        m = len(states)
        return np.hstack([zero((m, n)), states, outputs, zero((m, nv + 1))]) + inputs @ x

    y, z = of(own["C_y"], own["D_yw"], own["D_yx"]), of(own["C_z"], own["D_zw"], own["D_zx"])
    p = np.hstack([system.A, zero((n, k + nw)), system.B_input, system.constant_state[:, None]]) + system.B @ y
    rate = np.vstack([p, of(own["A"], own["B_w"], own["B_x"])])
    rate[n:, -1] += own["rate"][:, 0]
    seen = np.hstack([s.C, zero((len(s.C), k + nw)), s.D_input, s.constant[:, None]]) + s.D @ y
    cuts = system.cuts and system.cuts.with_own_states(own, system.B, closed, y[:, : n + k + nw])
    return rate, z, seen, cuts


def _on_one_clock(system: LureSystem, n: int) -> LureSystem:
    """The loop with one state for all clocks among those behind the first n."""
    # States that nothing moves but a constant rate of one, from zero on, tell the same time: samples of all controllers
    # are counted on one.
    moved = np.any(np.hstack([system.A, system.B, system.B_input]), axis=1)
    clocks = n + np.flatnonzero((~moved & (system.constant_state == 1.0) & (system.x0 == 0.0))[n:])
    if len(clocks) < 2:
        return system
    keep = np.setdiff1d(np.arange(len(system.A)), clocks[1:])
    T = np.eye(len(system.A))[:, keep]
    T[clocks, np.flatnonzero(keep == clocks[0])] = 1.0
    rows = {name: getattr(system, name)[keep] for name in ("B", "B_input", "constant_state", "x0")}
    cuts = system.cuts
    return replace(
        system,
        **rows,
        A=(system.A @ T)[keep],
        C=system.C @ T,
        signals=replace(system.signals, C=system.signals.C @ T),
        state_names=tuple(system.state_names[i] for i in keep),
        cuts=cuts and replace(cuts, B=cuts.B[keep], C=cuts.C @ T),
    )
