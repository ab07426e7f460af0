"""Loops from systems of python-control: named signals, and what each element takes and drives.

A linear system has inputs, outputs and states with names. An element is put between outputs that feed it and inputs
that it drives; inputs that none drives are the loop's external ones. Nonlinear subsystems of an interconnection are cut
out and an element put in the place of each, after its function has been held against the element's.
"""

from __future__ import annotations

import difflib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from eppanalysis.arrays import Array
from eppanalysis.errors import ModelError
from eppanalysis.models.elements.base import Nonlinearity
from eppanalysis.models.elements.foreign import as_element
from eppanalysis.models.systems.cuts import Cuts
from eppanalysis.models.systems.linear import as_state_space, sample_time
from eppanalysis.models.systems.lure import LureSystem
from eppanalysis.models.systems.own_states import ports
from eppanalysis.models.systems.signals import SignalMap

if TYPE_CHECKING:
    import control

#: Where an element is tried against a nonlinear subsystem: multiples of its last edge, and most of its pieces.
_SPREAD = np.concatenate([-np.geomspace(1e-3, 1e3, 27), [0.0], np.geomspace(1e-3, 1e3, 27)])
_MOST_TRIED = 200
#: Condition number from which an algebraic loop has no solution.
_SINGULAR = 1e14


@dataclass(frozen=True, eq=False)
class _Ports:
    """Signals of the linear subsystems of an interconnection, as places to cut: outputs, then inputs.

    Each is ``y = C x + D u`` on the states and the inputs of the system; a disturbance d that is added there acts on
    the states through B, on the outputs through E, and straight back on y through F.
    """

    names: tuple[str, ...]
    B: Array
    C: Array
    D: Array
    E: Array
    F: Array


@dataclass(frozen=True, eq=False)
class _Plant:
    """A linear system with names."""

    A: Array
    B: Array
    C: Array
    D: Array
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    states: tuple[str, ...]
    time_step: float | None
    name: str
    ports: _Ports | None = None


@dataclass(frozen=True, eq=False)
class _Place:
    """An element, what it is called, and the outputs that feed it and the inputs that it drives by number."""

    name: str
    element: Nonlinearity
    fed_by: tuple[int, ...]
    drives: tuple[int, ...]


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
    plant, places = _taken_apart(system, {key: as_element(e) for key, e in elements.items()}, name)
    places = _named(plant, places, element_names)
    driven = [j for place in places for j in place.drives]
    free = [j for j in range(len(plant.inputs)) if j not in driven]
    rows = [i for place in places for i in place.fed_by]
    external = tuple(plant.inputs[j] for j in free)
    start = _by_name(plant, "v0", v0, external)
    late = _by_name(plant, "delays", delays, tuple(plant.inputs[j] for j in driven))
    cuts = None if plant.ports is None else _cuts(plant.ports, rows, driven, late)
    return LureSystem.build(
        plant.A,
        plant.B[:, driven],
        plant.C[rows],
        [place.element for place in places],
        D=plant.D[np.ix_(rows, driven)],
        B_input=plant.B[:, free],
        D_input=plant.D[np.ix_(rows, free)],
        input_names=external,
        element_names=[place.name for place in places],
        signals=_signals(plant, driven, free),
        x0=x0,
        v0=start,
        delays=late,
        time_step=plant.time_step,
        state_names=plant.states,
        cuts=cuts,
        name=plant.name,
    )


def _cuts(ports: _Ports, rows: Sequence[int], driven: Sequence[int], late: Array) -> Cuts:
    """Places to cut, without those that carry a late output of an element, which is late for the states alone, and
    those behind which the loop that is cut open has no solution.
    """
    kept = ~np.any((ports.D[:, driven] != 0.0) & (late > 0.0), axis=1) & (ports.F != -1.0)
    names = tuple(name for name, keep in zip(ports.names, kept.tolist(), strict=True) if keep)
    of_elements = ports.D[np.ix_(kept, driven)]
    return Cuts(
        names, B=ports.B[:, kept], E=ports.E[np.ix_(rows, kept)], C=ports.C[kept], D=of_elements, F=ports.F[kept]
    )


def _taken_apart(system: Any, elements: Mapping[Any, Nonlinearity], name: str | None) -> tuple[_Plant, list[_Place]]:
    """The linear part, and the places of the elements in the order in which they were given."""
    if getattr(system, "syslist", None) is not None:
        plant, names = _cut(system, elements, name or system.name)
    else:
        plant, names = _linear(system, name or system.name), {}
    if not elements:
        raise ModelError(f"{plant.name}: a loop needs at least one nonlinear element.")
    taken: dict[int, str] = {}
    places = [_place(plant, names.get(key, key), element, taken) for key, element in elements.items()]
    return plant, [replace(p, name=key) if key in names else p for key, p in zip(elements, places, strict=True)]


def _linear(system: Any, name: str) -> _Plant:
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
    return _Plant(
        A, B, C, D, tuple(system.input_labels), tuple(system.output_labels), states, sample_time(system), name
    )


def _place(plant: _Plant, key: Any, element: Nonlinearity, taken: dict[int, str]) -> _Place:
    """Where an element stands; `taken` has the inputs that are driven already."""
    names = (key, key) if isinstance(key, str) else tuple(key)
    n_fed, n_driven = ports(element)
    if len(names) != n_fed + n_driven:
        who = type(element).__name__
        raise ModelError(f"{plant.name}: {who} is at {names}", expected=f"{_counts(n_fed, n_driven)} in a row")
    fed_by = tuple(_number(plant, "output", plant.outputs, n) for n in names[:n_fed])
    drives = tuple(_number(plant, "input", plant.inputs, n) for n in names[n_fed:])
    for j in drives:
        if j in taken:
            raise ModelError(
                f"{plant.name}: input {plant.inputs[j]!r} is driven by two elements",
                expected="one, or a sum of two inputs",
            )
        taken[j] = names[n_fed]
    return _Place(names[n_fed], element, fed_by, drives)


def _counts(n_fed: int, n_driven: int) -> str:
    what = "the output of the system that feeds it" if n_fed == 1 else f"{n_fed} outputs of the system that feed it"
    where = "the input that it drives" if n_driven == 1 else f"{n_driven} inputs that it drives"
    return f"{what} and {where}"


def _number(plant: _Plant, kind: str, known: Sequence[str], name: str) -> int:
    """Place of a signal among those of the system."""
    if name in known:
        return known.index(name)
    raise ModelError(f"{plant.name} has no {kind} {name!r}", expected=_choice(name, known))


def _choice(name: str, known: Sequence[str]) -> str:
    close = difflib.get_close_matches(str(name)[:100], known, n=1)
    listed = f"one of: {', '.join(known) or 'none'}"
    return f"{listed} (did you mean {close[0]!r}?)" if close else listed


def _named(plant: _Plant, places: list[_Place], names: Sequence[str] | None) -> list[_Place]:
    if names is None:
        return places
    if len(names) != len(places):
        raise ModelError(plant.name, list(names), f"{len(places)}, one for each element", field="element_names")
    return [replace(p, name=n) for n, p in zip(names, places, strict=True)]


def _by_name(plant: _Plant, what: str, given: Mapping[str, float] | None, names: Sequence[str]) -> Array:
    """Values in the order of names, zero where none is given."""
    for name in given or {}:
        if name not in names:
            raise ModelError(f"{plant.name}: {what} has {name!r}", expected=_choice(name, names))
    return np.array([float((given or {}).get(name, 0.0)) for name in names])


def _signals(plant: _Plant, driven: Sequence[int], free: Sequence[int]) -> SignalMap:
    """Outputs of the system, and behind them what the elements give, by the inputs that they drive."""
    own = len(plant.outputs)
    given = [plant.inputs[j] for j in driven]
    names = (*plant.outputs, *(f"{n}_output" if n in plant.outputs else n for n in given))
    n_given = len(given)
    return SignalMap(
        names,
        np.vstack([plant.C, np.zeros((n_given, len(plant.A)))]),
        np.vstack([plant.D[:, driven], np.eye(n_given)]),
        np.vstack([plant.D[:, free], np.zeros((n_given, len(free)))]),
        np.zeros(own + n_given),
        ("",) * (own + n_given),
    )


def _cut(system: Any, elements: Mapping[Any, Nonlinearity], name: str) -> tuple[_Plant, dict[str, tuple[str, ...]]]:
    """An interconnection with its nonlinear subsystems cut out, and between which signals each of them stood.

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
    ports = _Ports(
        tuple(names), B=(B @ u_d[~u_of])[:, at], C=carried[at, :n], D=carried[at, n:],
        E=np.vstack([outer @ np.vstack([y_d, u_d]), u_d[u_of]])[:, at], F=back[at],
    )  # fmt: skip
    between = {p.name: tuple(f"{p.name}_{s}" for s in (*p.input_labels, *p.output_labels)) for p in outside}
    plant = _Plant(
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
    """Refuse a nonlinear subsystem that no element stands for, or that gives something else than its element."""
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
