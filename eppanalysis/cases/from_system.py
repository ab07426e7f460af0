"""What a case file says of loops and diagrams made in Python: every number as it is, so that it reads back the same."""

from __future__ import annotations

import dataclasses
import inspect
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from eppanalysis.arrays import Array
from eppanalysis.cases.blocks import element_class, known_elements
from eppanalysis.cases.values.automata import AUTOMATON, automaton_table, memory_table
from eppanalysis.errors import ModelError
from eppanalysis.models.diagrams import BLOCKS, Block, Diagram
from eppanalysis.models.elements import ELEMENTS, AutomatonElement
from eppanalysis.models.elements.base import Nonlinearity
from eppanalysis.models.systems.cuts import Cuts
from eppanalysis.models.systems.inputs import Constant, InputSignal, Ramp, Recorded, Sine, Step, Steps
from eppanalysis.models.systems.lure import LureSystem, with_own_states
from eppanalysis.models.systems.own_states import own_count
from eppanalysis.readable import written
from eppanalysis.units import write_si


def tables_of(system: LureSystem | Diagram) -> dict[str, Any]:
    """The kind of case and its sections: a diagram as drawn where a file has a place for all of it, else its loop.

    Raises
    ------
    ModelError
        If a case file has no name for an element, or no place for what it remembers.
    """
    if not isinstance(system, Diagram):
        return {"kind": "loop", "loop": loop_tables(system)}
    other_units = set(system.units) - set(system.signals) - set(system.levels)
    own_blocks = [p for p in system.parts.values() if isinstance(p, Block) and BLOCKS.get(p.kind) is not type(p)]
    if system.principal or other_units or own_blocks or not system.ports_as_signals:
        return tables_of(system.to_system())
    return {"kind": "diagram", **diagram_tables(system)}


def diagram_tables(diagram: Diagram) -> dict[str, Any]:
    """The sections of a diagram: connections, external inputs, blocks, elements, signals; all numbers in SI units.

    Raises
    ------
    ModelError
        As :func:`tables_of`.
    """
    units = diagram.units
    cuts = [diagram.margins_at] if isinstance(diagram.margins_at, str) else list(diagram.margins_at)
    blocks, elements = {}, {}
    for name, part in diagram.parts.items():
        if isinstance(part, Block):
            blocks[name] = _block(part)
        else:
            elements[name] = _element(diagram.name, part, name, diagram.memory.get(name))
            del elements[name]["name"]
    return {
        "connect": list(diagram.connect),
        "inputs": {name: write_si(level, units.get(name, "")) for name, level in diagram.levels.items()},
        **({"margins_at": cuts} if cuts else {}),
        "blocks": blocks,
        "elements": elements,
        "signals": {name: {"of": text, "unit": written(units.get(name, ""))} for name, text in diagram.signals.items()},
    }


def _block(block: Block) -> dict[str, Any]:
    """A block with the fields that are not at their defaults."""
    given = {field.name: getattr(block, field.name) for field in dataclasses.fields(block)}
    left_out = {field.name: field.default for field in dataclasses.fields(block)}
    kept = {name: value for name, value in given.items() if value is not None and value is not left_out[name]}
    return {"kind": block.kind, **kept}


def loop_tables(loop: LureSystem) -> dict[str, Any]:
    """The section of a loop: state space, elements, signals, start.

    Raises
    ------
    ModelError
        If a case file has no name for an element, or no place for what it remembers.
    """
    loop = _as_given(loop)
    matrices = {
        "D": loop.D,
        "input_matrix": loop.B_input,
        "input_feedthrough": loop.D_input,
        "constant_state": loop.constant_state,
        "constant_input": loop.constant_input,
        "initial_input": loop.v0,
    }
    table: dict[str, Any] = {name: getattr(loop, name).tolist() for name in ("A", "B", "C")}
    table |= {name: given.tolist() for name, given in matrices.items() if _says_something(given)}
    table["states"], table["initial_state"] = list(loop.state_names), loop.x0.tolist()
    if loop.input_names:
        table["inputs"] = list(loop.input_names)
    if loop.delays.size and np.ptp(loop.delays) == 0.0:
        table["delay"] = write_si(float(loop.delays[0]), "s")
    else:
        table["delays"] = loop.delays.tolist()
    if loop.time_step:
        table["time_step"] = write_si(loop.time_step, "s")
    rows = zip(loop.elements, loop.element_names, loop.memory, strict=True)
    table["elements"] = [_element(loop.name, element, name, memory) for element, name, memory in rows]
    if loop.principal:
        table["principal"] = loop.element_names[loop.principal]
    if loop.cuts is not None:
        table["cuts"] = _cuts(loop.cuts)
    if loop.margins_at:
        table["margins_at"] = list(loop.margins_at)
    table["signals"] = _signals(loop)
    return table


def _as_given(loop: LureSystem) -> LureSystem:
    """The loop before states of its elements were appended that files know nothing of; they start at its memory."""
    if loop.given is None:
        return loop
    n, appended = len(loop.given.A), with_own_states(loop.given)
    if any(not np.array_equal(getattr(loop, name), getattr(appended, name)) for name in ("A", "B", "C", "D")):
        raise ModelError(f"{loop.name}: its matrices are not those with which it was given; expected those.")
    starts = np.split(loop.x0[n:], np.cumsum([own_count(e) for e in loop.given.elements])[:-1])
    for e, name, start in zip(loop.given.elements, loop.element_names, starts, strict=True):
        if own_count(e) and e.inside is None and np.any(start):
            raise ModelError(f"{loop.name}: states of {name} start", start.tolist(), "zero, as no file holds them")
    rows = zip(loop.given.elements, loop.memory, starts, strict=True)
    memory = tuple(float(start[0]) if e.inside is not None else kept for e, kept, start in rows)
    return replace(loop.given, x0=loop.x0[:n], v0=loop.v0, memory=memory)


def _cuts(cuts: Cuts) -> dict[str, Any]:
    table: dict[str, Any] = {}
    for i, name in enumerate(cuts.names):
        rows = {"to_state": cuts.B[:, i], "to_inputs": cuts.E[:, i], "state": cuts.C[i], "output": cuts.D[i]}
        row: dict[str, Any] = {part: given.tolist() for part, given in rows.items() if _says_something(given)}
        row |= {part: float(v) for part, v in {"itself": cuts.F[i], "delay": cuts.delays[i]}.items() if v}
        table[name] = row
    return table


def _says_something(given: Array) -> bool:
    """Whether an array is none that may be left out: zeros without a sign."""
    return bool(np.any(given) or np.any(np.signbit(given)))


def _element(who: str, element: Nonlinearity, name: str, memory: Any) -> dict[str, Any]:
    table: dict[str, Any]
    if type(element) is AutomatonElement:
        table = {"kind": AUTOMATON, "name": name, **automaton_table(element, f"{who}: {name}")}
        return table if memory is None else table | {"memory": memory_table(memory, element.rules)}
    kind = next((kind for kind in ELEMENTS if element_class(kind) is type(element)), None)
    if kind is None:
        known = ", ".join(known_elements())
        unknown = f"{who}: {name} is a {type(element).__name__}, which no case file knows"
        raise ModelError(unknown, expected=f"one of: {known}")
    table = {"kind": kind, "name": name}
    for field in inspect.signature(type(element)).parameters:
        value = getattr(element, field)
        if value is not None:
            table[field] = np.asarray(value).tolist() if not isinstance(value, str) else value
    if memory is not None:
        table["memory"] = _memory(who, name, memory)
    return table


def _memory(who: str, name: str, memory: Any) -> Any:
    """A held value; with direction and input reached, of an element that sticks; or a list."""
    parts = np.ravel(np.asarray(memory, float)).tolist()
    if not np.all(np.isfinite(parts)):
        raise ModelError(f"{who}: {name} remembers {parts}", expected="finite numbers")
    return parts[0] if np.ndim(memory) == 0 else parts


def _signals(loop: LureSystem) -> dict[str, Any]:
    s = loop.signals
    table: dict[str, Any] = {}
    for i, name in enumerate(s.names):
        rows = {"state": s.C[i], "output": s.D[i], "input": s.D_input[i]}
        row: dict[str, Any] = {part: given.tolist() for part, given in rows.items() if _says_something(given)}
        if _says_something(s.constant[i]):
            row["constant"] = float(s.constant[i])
        if s.units and s.units[i]:
            row["unit"] = written(s.units[i])
        table[name] = row
    return table


def input_tables(input: InputSignal | Mapping[str, InputSignal] | None) -> dict[str, Any]:
    """What the section of the run says of the external inputs."""
    if input is None:
        return {}
    if isinstance(input, Mapping):
        return {"inputs": {name: _input_signal(input_signal) for name, input_signal in input.items()}}
    return {"input": _input_signal(input)}


def _input_signal(input_signal: InputSignal) -> dict[str, Any]:
    if isinstance(input_signal, Constant):
        return {"kind": "step", "size": float(input_signal.size)}
    if isinstance(input_signal, Step):
        return {"kind": "step", "size": float(input_signal.size), "time": float(input_signal.time)}
    if isinstance(input_signal, Steps | Recorded):
        kind = type(input_signal).__name__.lower()
        return {"kind": kind, "times": input_signal.times.tolist(), "values": input_signal.values.tolist()}
    if isinstance(input_signal, Ramp):
        stop = {} if input_signal.stop is None else {"stop": float(input_signal.stop)}
        return {"kind": "ramp", "rate": float(input_signal.rate), "start": float(input_signal.start), **stop}
    assert isinstance(input_signal, Sine)
    place = {"frequency": float(input_signal.frequency_hz), "phase": float(input_signal.phase)}
    return {"kind": "sine", "amplitude": float(input_signal.amplitude), **place}
