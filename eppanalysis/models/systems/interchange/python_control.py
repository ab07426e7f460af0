"""Loops from systems of python-control: named signals, and what each element takes and drives.

A linear system has inputs, outputs and states with names. An element is put between outputs that feed it and inputs
that it drives; inputs that none drives are the loop's external ones. Nonlinear subsystems of an interconnection are cut
out and an element put in the place of each, after its function has been held against the element's.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from eppanalysis.arrays import Array
from eppanalysis.errors import ModelError
from eppanalysis.models.elements.base import Nonlinearity
from eppanalysis.models.elements.foreign import as_element
from eppanalysis.models.systems.interchange.plant import Plant, Ports, looped
from eppanalysis.models.systems.linear import as_state_space, sample_time
from eppanalysis.models.systems.lure import LureSystem
from eppanalysis.models.systems.own_states import ports

if TYPE_CHECKING:
    import control

#: Where an element is tried against a nonlinear subsystem: multiples of its last edge, and most of its pieces.
_SPREAD = np.concatenate([-np.geomspace(1e-3, 1e3, 27), [0.0], np.geomspace(1e-3, 1e3, 27)])
_MOST_TRIED = 200
#: Condition number from which an algebraic loop has no solution.
_SINGULAR = 1e14


def from_control(
    system: control.InputOutputSystem,
    elements: Mapping[str | tuple[str, ...], Nonlinearity | control.DescribingFunctionNonlinearity],
    *,
    element_names: Sequence[str] | None = None,
    x0: ArrayLike | None = None,
    v0: Mapping[str, float] | None = None,
    delays: Mapping[str, float] | None = None,
    name: str | None = None,
) -> LureSystem:
    """The loop of a python-control system with named signals and the elements around it.

    Parameters
    ----------
    system : control.StateSpace, control.TransferFunction or control.InterconnectedSystem
        As ``control.ss`` and ``control.interconnect`` make it, in continuous or discrete time. Its outputs are the
        named signals of the loop, inputs that no element drives its external inputs; names of states are kept. Inputs
        and outputs of the linear subsystems of an interconnection are places at which margins can cut the loop, as in
        ``epp.margins(loop, "voltage")``; "controller.voltage" where several have a signal of that name, "controller"
        for the output of one that has one.
    elements : mapping of (str, ..., str) or str to Nonlinearity
        By what an element takes and drives: ``("speed", "torque")`` is fed by the output "speed" and drives the input
        "torque"; with several inputs, ``("deflection", "rate", "torque")``. A name alone is an output and an input of
        the same name, or a nonlinear subsystem of an interconnection that the element replaces. What the element
        gives is added as it is: a minus belongs into the system. ``control.saturation_nonlinearity`` and its like are
        taken.
    element_names : sequence of str, optional
        What the elements are called; by default each after the first input that it drives.
    x0 : array, shape (n,), optional
        State at the start; zero by default.
    v0 : mapping of str to float, optional
        External inputs before the start; zero by default.
    delays : mapping of str to float, optional
        Dead time [s] behind what an element gives to an input of the system, by that input's name.
    name : str, optional
        By default that of the system.

    Returns
    -------
    LureSystem

    Raises
    ------
    ModelError
        If a signal is unknown or driven twice, an element takes or drives another number of them, the system is neither
        linear nor made of linear systems and elements, or an algebraic loop has no unique solution.

    Examples
    --------
    >>> import control
    >>> import eppanalysis as epp
    >>> state = ["angle", "speed"]
    >>> motor = control.ss(
    ...     [[0, 1], [0, -1]],
    ...     [[0, 0], [1, -1]],
    ...     [[1, 0], [0, 1]],
    ...     0,
    ...     name="motor",
    ...     inputs=["voltage", "friction"],
    ...     outputs=state,
    ...     states=state,
    ... )
    >>> controller = control.tf(
    ...     [4.0, 2.0], [1.0, 0.0], name="controller", inputs="error", outputs="voltage"
    ... )
    >>> difference = control.summing_junction(["reference", "-angle"], "error")
    >>> servo = control.interconnect(
    ...     [motor, controller, difference],
    ...     name="servo",
    ...     inputs=["reference", "friction"],
    ...     outputs=state,
    ... )
    >>> loop = epp.from_control(
    ...     servo, {("speed", "friction"): epp.Friction(0.5, static=0.8)}
    ... )
    >>> loop.input_names, loop.signals.names, loop.element_names
    (('reference',), ('angle', 'speed', 'friction'), ('friction',))
    """
    elements = {key: as_element(e) for key, e in elements.items()}
    if getattr(system, "syslist", None) is not None:
        plant, between = _cut(system, elements, name or system.name)
    else:
        plant, between = _linear(system, name or system.name), {}
    return looped(plant, elements, element_names, x0, v0, delays, between)


def _linear(system: Any, name: str) -> Plant:
    """A linear system with its names."""
    if hasattr(system, "A") and hasattr(system, "D"):
        A, B, C, D = (np.asarray(getattr(system, m), float) for m in "ABCD")
        states = tuple(system.state_labels)
    elif hasattr(system, "num") and system.ninputs == system.noutputs == 1:
        one = as_state_space(system)
        A, B, C, D = one.A, one.B, one.C, one.D
        states = tuple(f"x{i}" for i in range(len(A)))
    elif hasattr(system, "num"):
        raise ModelError(f"{name} is a transfer function with several inputs or outputs", expected="control.ss of it")
    else:
        raise ModelError(f"{name} is a {type(system).__name__}", expected="a linear system, or an interconnection")
    return Plant(A, B, C, D, tuple(system.input_labels), tuple(system.output_labels), states, sample_time(system), name)


def _cut(system: Any, elements: Mapping[Any, Nonlinearity], name: str) -> tuple[Plant, dict[str, tuple[str, ...]]]:
    """An interconnection with its nonlinear subsystems cut out, and the signals before and behind each of them.

    With all inputs u and outputs y of the subsystems, ``u = M y + N v``; of the linear ones ``y = C x + D u``, and
    those of the others are inputs now: w.
    """
    parts = list(system.syslist)
    outside = [p for p in parts if not hasattr(p, "A")]
    for part in outside:
        _hold_against(part, elements, name)
    ins = np.cumsum([0, *(p.ninputs for p in parts)])
    outs = np.cumsum([0, *(p.noutputs for p in parts)])
    is_cut = [not hasattr(p, "A") for p in parts]
    u_of = np.repeat(is_cut, np.diff(ins))
    y_of = np.repeat(is_cut, np.diff(outs))
    M, N = np.asarray(system.connect_map, float), np.asarray(system.input_map, float)
    linear = [p for p in parts if hasattr(p, "A")]
    A, B, C, D = _stacked(linear)
    M_linear = M[np.ix_(~u_of, ~y_of)]
    closed = np.eye(len(D)) - D @ M_linear
    if len(D) and np.linalg.cond(closed) > _SINGULAR:
        raise ModelError(f"{name}: an algebraic loop through its linear subsystems has no unique solution.")
    # Rows on (x, v, w) of the linear outputs, of all outputs, and of all inputs.
    n, nv, nw = len(A), N.shape[1], int(y_of.sum())
    to_u = np.hstack([np.zeros((int((~u_of).sum()), n)), N[~u_of], M[np.ix_(~u_of, y_of)]])
    y = np.zeros((len(y_of), n + nv + nw))
    y[~y_of] = np.linalg.solve(closed, np.hstack([C, np.zeros((len(C), nv + nw))]) + D @ to_u)
    y[y_of, n + nv :] = np.eye(nw)
    u = M @ y + np.hstack([np.zeros((len(N), n)), N, np.zeros((len(N), nw))])
    outer = np.asarray(system.output_map, float)
    seen = np.vstack([outer @ np.vstack([y, u]), u[u_of]])
    rate = B @ u[~u_of]
    rate[:, :n] += A
    # The same of disturbances that are added to the linear outputs, and to the linear inputs.
    ny, nu = C.shape[0], B.shape[1]
    y_d, u_d = np.zeros((len(y_of), ny + nu)), np.zeros((len(u_of), ny + nu))
    drives = np.hstack([M_linear, np.eye(nu)])
    own = np.linalg.solve(closed, D @ drives)
    y_d[~y_of] = own + np.eye(ny, ny + nu)
    u_d[:] = M @ y_d
    u_d[~u_of, ny:] += np.eye(nu)
    back, carried = np.diag(np.vstack([own, M_linear @ own])), np.vstack([y[~y_of], u[~u_of]])
    names = _named_ports(parts)
    at = list(names.values())
    ports = Ports(
        tuple(names), B=(B @ u_d[~u_of])[:, at], C=carried[at, :n], D=carried[at, n:],
        E=np.vstack([outer @ np.vstack([y_d, u_d]), u_d[u_of]])[:, at], F=back[at],
    )  # fmt: skip
    between = {p.name: tuple(f"{p.name}_{s}" for s in (*p.input_labels, *p.output_labels)) for p in outside}
    plant = Plant(
        rate[:, :n],
        rate[:, n:],
        seen[:, :n],
        seen[:, n:],
        (*system.input_labels, *(f"{p.name}_{s}" for p in outside for s in p.output_labels)),
        (*system.output_labels, *(f"{p.name}_{s}" for p in outside for s in p.input_labels)),
        tuple(system.state_labels),
        sample_time(system),
        name,
        ports,
    )
    return plant, between


def _named_ports(parts: Sequence[Any]) -> dict[str, int]:
    """Numbers of the outputs of linear subsystems, then of their inputs: "controller.voltage", or "controller.out" of
    one that has one output; and "voltage" alone, where one subsystem gives it, or none and one takes it.
    """
    kinds = (("output_labels", "noutputs", "out"), ("input_labels", "ninputs", "in"))
    linear = [part for part in parts if hasattr(part, "A")]
    ports = [
        (part.name, signal, alone if getattr(part, count) == 1 else signal)
        for labels, count, alone in kinds
        for part in linear
        for signal in getattr(part, labels)
    ]
    found: dict[str, int] = {}
    for place in (1, 2):
        for i, port in enumerate(ports):
            found.setdefault(f"{port[0]}.{port[place]}", i)
    given, taken = ([(part.name, s) for part in parts for s in getattr(part, labels)] for labels, _, _ in kinds)
    for signal in {signal: None for _, signal in (*given, *taken)}:
        ends = [end for end in given if end[1] == signal] or [end for end in taken if end[1] == signal]
        if len(ends) == 1 and ".".join(ends[0]) in found:
            found.setdefault(signal, found[".".join(ends[0])])
    return found


def _stacked(parts: Sequence[Any]) -> tuple[Array, ...]:
    """State spaces beside each other."""
    from scipy.linalg import block_diag

    of = [block_diag(*(np.asarray(getattr(p, m), float) for p in parts)) if parts else np.zeros((0, 0)) for m in "ABCD"]
    sizes = [sum(getattr(p, s) for p in parts) for s in ("nstates", "ninputs", "noutputs")]
    n, m, k = sizes
    return tuple(np.reshape(v, shape) for v, shape in zip(of, ((n, n), (n, m), (k, n), (k, m)), strict=True))


def _hold_against(part: Any, elements: Mapping[Any, Nonlinearity], name: str) -> None:
    """Refuse a nonlinear subsystem without an element of its kind, or that gives something else than its element."""
    what = f"{name}: subsystem {part.name!r} is nonlinear"
    if part.name not in elements:
        raise ModelError(what, expected=f"an element in its place: elements={{{part.name!r}: ...}}")
    element = elements[part.name]
    if part.nstates or (part.ninputs, part.noutputs) != ports(element):
        raise ModelError(
            f"{what}, with {part.nstates} states, {part.ninputs} inputs and {part.noutputs} outputs",
            expected=f"no states, and the signals of {type(element).__name__}",
        )
    if element.n_inputs > 1 or element.own_states is not None or element.output(0.0, None)[1] is not None:
        raise ModelError(
            f"{what} and has no memory of its own, as {type(element).__name__} has",
            expected="an element without memory",
        )
    for x in _tried(np.asarray(element.breakpoints, float)):
        given = float(np.squeeze(part.output(0.0, np.zeros(0), np.array([x]))))
        own = float(np.squeeze(element.output(x, None)[0]))
        if not np.isclose(given, own, rtol=1e-9, atol=1e-12 * abs(x)):
            raise ModelError(
                f"{what} and gives {given:.6g} at {x:.6g}", expected=f"{own:.6g}, as {element!r} in its place"
            )


def _tried(edges: Array) -> Array:
    """Inputs at which a subsystem is held against an element: far and near, and amid its pieces."""
    # Which side an edge belongs to is nothing that a loop feels.
    amid = 0.5 * (edges[1:] + edges[:-1])
    chosen = amid[np.linspace(0, len(amid) - 1, min(_MOST_TRIED, len(amid))).astype(int)] if len(amid) else amid
    far = float(np.abs(edges).max(initial=0.0)) or 1.0
    spread = far * _SPREAD
    apart = np.abs(spread[:, None] - edges).min(axis=1, initial=np.inf) > 1e-6 * far
    return np.concatenate([chosen, spread[apart]])
