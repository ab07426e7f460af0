"""Loops as diagrams: the elements around one block that holds the whole linear part."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from eppanalysis.arrays import Array
from eppanalysis.errors import ModelError
from eppanalysis.models.diagrams.blocks import Block, Constant, DeadTime, StateSpaceBlock
from eppanalysis.models.diagrams.wiring import NAME, Port, free_name, port_names, written
from eppanalysis.models.elements.base import Nonlinearity
from eppanalysis.models.systems.lure import LureSystem
from eppanalysis.models.systems.signals import SignalMap


def drawn(loop: LureSystem) -> dict[str, Any]:
    """What a diagram of a loop is made of.

    Raises
    ------
    ModelError
        If a diagram cannot hold the loop.
    """
    _require_drawable(loop)
    ports = {name: port_names(part) for name, part in zip(loop.element_names, loop.elements, strict=True)}
    before: list[Port] = [(name, port) for name, both in ports.items() for port in both[0]]
    behind: list[Port] = [(name, port) for name, both in ports.items() for port in both[1]]
    taken = {*ports, *loop.input_names}
    block, one = free_name("linear", taken), free_name("one", taken)
    called_before, called_behind = (
        [_called(port, ports[port[0]][k]) for port in group] for k, group in ((0, before), (1, behind))
    )
    sources = [*called_behind, *loop.input_names]
    inputs = _different([name.replace(".", "_") for name in sources])
    signals, direct = _undelayed(loop.signals, loop.delays)
    columns = [np.hstack(rows) for rows in _columns(loop, signals)]
    parts: dict[str, Nonlinearity | Block] = dict(zip(loop.element_names, loop.elements, strict=True))
    if any(np.any(column[:, -1]) for column in columns):
        parts[one] = Constant(value=1.0)
        sources.append(one)
        inputs.append(free_name("one", set(inputs)))
    else:
        columns = [column[:, :-1] for column in columns]
    for j, delay in enumerate(loop.delays.tolist()):
        if delay:
            sources[j] = free_name(f"{called_behind[j].replace('.', '_')}_delay", {*taken, *parts, block})
            parts[sources[j]] = DeadTime(delay=delay)
    outputs = _different(["_".join(port) for port in before] + [_plain(name) for name in signals.names])
    n = len(loop.A)
    parts[block] = StateSpaceBlock(
        A=loop.A.tolist(), B=columns[0].tolist(), C=np.vstack([loop.C, signals.C]).tolist(),
        D=np.vstack(columns[1:]).tolist(), input_names=inputs, output_names=outputs, state_names=loop.state_names,
        start=loop.x0.tolist() if n else None, sample_time=loop.time_step,
    )  # fmt: skip
    connect = [f"{name} -> {late}" for name, late in zip(called_behind, sources, strict=False) if name != late]
    connect += [f"{source} -> {block}.{port}" for source, port in zip(sources, inputs, strict=True)]
    connect += [f"{block}.{port} -> {to}" for port, to in zip(outputs, called_before, strict=False)]
    return {
        "parts": parts,
        "connect": tuple(connect),
        "inputs": dict(zip(loop.input_names, loop.v0.tolist(), strict=True)),
        "signals": {
            name: " ".join([f"{block}.{port}", *(f"{sign} {called_behind[j]}" for sign, j in added)])
            for name, port, added in zip(signals.names, outputs[len(before) :], direct, strict=True)
        },
        "units": dict(zip(signals.names, signals.units, strict=False)),
        "memory": {k: m for k, m in zip(loop.element_names, loop.memory, strict=True) if m is not None},
        "margins_at": _margins_at(loop, before, behind),
        "principal": loop.element_names[loop.principal] if loop.principal else "",
        "ports_as_signals": False,
        "name": loop.name,
    }


def _columns(loop: LureSystem, signals: SignalMap) -> tuple[tuple[Array, ...], ...]:
    """Rows on outputs, external inputs and one: of the state, of the elements' inputs, of the signals."""
    return (
        (loop.B, loop.B_input, loop.constant_state[:, None]),
        (loop.D, loop.D_input, loop.constant_input[:, None]),
        (signals.D, signals.D_input, signals.constant[:, None]),
    )


def _undelayed(signals: SignalMap, delays: Array) -> tuple[SignalMap, list[list[tuple[str, int]]]]:
    """Signals without the outputs that have a dead time, and with which sign each of them adds those: undelayed."""
    late = np.flatnonzero(delays > 0)
    D = signals.D.copy()
    D[:, late] = 0.0
    direct = []
    for name, row in zip(signals.names, signals.D[:, late], strict=True):
        used = [(weight, int(j)) for weight, j in zip(row.tolist(), late, strict=True) if weight]
        if any(abs(weight) != 1.0 for weight, _ in used):
            raise ModelError(f"signal {name}", [w for w, _ in used], "1 or -1 times an output that has a dead time")
        direct.append([("+" if weight > 0 else "-", j) for weight, j in used])
    return replace(signals, D=D), direct


def _require_drawable(loop: LureSystem) -> None:
    """Refuse what a diagram cannot hold."""
    for name, element in zip(loop.element_names, loop.elements, strict=True):
        if element.own_states is not None:
            raise ModelError(f"{loop.name}: {name} brought linear states of its own into the loop",
                             expected="a diagram that is drawn with it")  # fmt: skip
    late = loop.delays > 0
    if np.any(late) and loop.time_step:
        raise ModelError(f"{loop.name}: it has a dead time in discrete time", expected="states that hold samples back")
    if np.any(loop.D[:, late]):
        expected = "a block with states between them"
        raise ModelError(f"{loop.name}: an output with a dead time acts straight on an element", expected=expected)


def _margins_at(loop: LureSystem, before: Sequence[Port], behind: Sequence[Port]) -> tuple[str, ...]:
    """Places of the loop as the diagram calls them: the inputs and outputs of elements."""
    names = loop.places.names if loop.cuts is None else ()
    called = dict(zip(names, (written(port) for port in (*before, *behind)), strict=False))
    for place in loop.margins_at:
        if place not in called:
            raise ModelError(loop.name, place, "an input or output of an element", field="margins_at")
    return tuple(called[place] for place in loop.margins_at)


def _called(port: Port, ports: Sequence[str]) -> str:
    """How connections call a port of a part that has the ports `ports`: a single one by the part alone."""
    return port[0] if len(ports) == 1 else written(port)


def _plain(name: str) -> str:
    """A name that a port can have."""
    return name if NAME.fullmatch(name) else "signal"


def _different(names: Iterable[str]) -> list[str]:
    """The same names with numbers behind those that occur twice."""
    found: list[str] = []
    for name in names:
        found.append(free_name(name, found))
    return found
