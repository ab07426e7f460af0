"""What a case file says of a loop that was made in Python: every number as it is, so that it reads back the same."""

from __future__ import annotations

import inspect
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eppanalysis.cases.blocks import element_class
from eppanalysis.errors import ModelError
from eppanalysis.models.elements import ELEMENTS
from eppanalysis.models.elements.base import Nonlinearity
from eppanalysis.models.elements.memory import Slip
from eppanalysis.models.systems.cuts import Cuts
from eppanalysis.models.systems.inputs import Constant, InputSignal, Ramp, Recorded, Sine, Step, Steps
from eppanalysis.models.systems.lure import LureSystem, with_own_states
from eppanalysis.models.systems.own_states import own_count
from eppanalysis.units import write_si


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
    table["elements"] = [_element(loop, element, name, memory) for element, name, memory in rows]
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


def _says_something(given: NDArray[np.float64]) -> bool:
    """Whether an array is not what stands for one that is left out: zeros without a sign."""
    return bool(np.any(given) or np.any(np.signbit(given)))


def _element(loop: LureSystem, element: Nonlinearity, name: str, memory: Any) -> dict[str, Any]:
    kind = next((kind for kind in ELEMENTS if element_class(kind) is type(element)), None)
    if kind is None:
        known = ", ".join(ELEMENTS)
        unknown = f"{loop.name}: {name} is a {type(element).__name__}, which no case file knows"
        raise ModelError(unknown, expected=f"one of: {known}")
    table: dict[str, Any] = {"element": kind, "name": name}
    for field in inspect.signature(type(element)).parameters:
        value = getattr(element, field)
        if value is not None:
            table[field] = np.asarray(value).tolist() if not isinstance(value, str) else value
    if memory is not None:
        table["memory"] = _memory(loop, name, memory)
    return table


def _memory(loop: LureSystem, name: str, memory: Any) -> Any:
    """A held value; with direction and input reached, of an element that sticks."""
    parts = [float(np.asarray(part)) for part in (memory if isinstance(memory, Slip) else (memory,))]
    if not np.all(np.isfinite(parts)):
        raise ModelError(f"{loop.name}: {name} remembers {parts}", expected="finite numbers")
    return parts if isinstance(memory, Slip) else parts[0]


def _signals(loop: LureSystem) -> dict[str, Any]:
    s = loop.signals
    table: dict[str, Any] = {}
    for i, name in enumerate(s.names):
        rows = {"state": s.C[i], "output": s.D[i], "input": s.D_input[i]}
        row: dict[str, Any] = {part: given.tolist() for part, given in rows.items() if _says_something(given)}
        if _says_something(s.constant[i]):
            row["constant"] = float(s.constant[i])
        if s.units and s.units[i]:
            row["unit"] = s.units[i]
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
