"""Generic loops of a case file: elements by name, and the system that they close."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from enum import StrEnum
from typing import Any

import numpy as np

from eppanalysis.cases.blocks import Block, make_element, read_blocks, unsaid
from eppanalysis.cases.files import Missing, RawCase
from eppanalysis.cases.inputs import input_signals_of
from eppanalysis.cases.kind import Kind, Parts
from eppanalysis.cases.schema import LoopFile, LoopSection
from eppanalysis.cases.values.dimensions import check_units, units_of_ports
from eppanalysis.errors import CaseError, ModelError
from eppanalysis.models.devices.elbow.parameters import ElbowParameters
from eppanalysis.models.elements import Nonlinearity
from eppanalysis.models.systems.cuts import Cuts, suggestion
from eppanalysis.models.systems.linear import StateSpace, as_state_space
from eppanalysis.models.systems.lure import LureSystem
from eppanalysis.models.systems.own_states import ports
from eppanalysis.models.systems.signals import SignalMap
from eppanalysis.readable import count

#: Matrices of a loop without states.
_MAY_BE_EMPTY = ("A", "B", "C")
#: Scalar fields of a loop as a whole.
_OF_LOOP = ("gain", "delay", "time_step")


class Form(StrEnum):
    """How the linear part of a loop is given."""

    TRANSFER_FUNCTION = "transfer function"
    BLOCKS = "blocks"
    STATE_SPACE = "state space"


#: What a message calls what is given in such a form.
_NAMED = {
    Form.TRANSFER_FUNCTION: "a transfer function",
    Form.BLOCKS: "a loop of blocks",
    Form.STATE_SPACE: "a state space",
}


class LoopKind(Kind):
    """Cases of generic loops."""

    name = "loop"
    file = LoopFile

    def parts(self, file: Any, raw: RawCase) -> Parts:
        """The elements' scalar fields and what is before the loop as a whole, the input, and the loop."""
        loop = file.loop
        place = "loop.elements" if loop.blocks is None else "loop.blocks"
        blocks = read_blocks((loop.elements if loop.blocks is None else loop.blocks) or [], place, raw)
        check_units(loop, blocks, place, raw)
        system = build_loop(loop, blocks, raw)
        fields = {f"{b.name}.{k}": p for b in blocks for k, p in b.parameters.items()}
        for name in _OF_LOOP:
            found = getattr(loop, name)
            if found is not None:
                fields[f"loop.{name}"] = found
        inputs = input_signals_of(file.run, system.input_names, "", raw)
        return Parts(fields, inputs, system, remarks=unsaid(blocks))

    def fields(self, parameters: Iterable[str]) -> list[str]:
        """The given ones, and those of the loop as a whole."""
        return list(dict.fromkeys([*parameters, *(f"loop.{name}" for name in _OF_LOOP)]))

    def takes(self, name: str, data: Mapping[str, Any]) -> bool:
        """Any field of an element: reading it tells whether the element has it."""
        return name.partition(".")[0] in _places(data)

    def implied(self, elbow: ElbowParameters | None, name: str) -> float | None:
        """The gain of the loop, which is one where it is left out."""
        return 1.0 if name == "loop.gain" else None

    def path(self, name: str, data: Mapping[str, Any]) -> list[str | int]:
        """Elements are in a list, and are called by their names."""
        first, *rest = name.split(".")
        places = _places(data)
        return ["loop", *places[first], *rest] if first in places else [first, *rest]


def _places(data: Mapping[str, Any]) -> dict[str, tuple[str, int]]:
    """Where each named element is in the file."""
    loop = data.get("loop", {})
    return {
        table.get("name", table["kind"]): (place, i)
        for place in ("elements", "blocks")
        for i, table in enumerate(loop.get(place) or [])
        if "kind" in table
    }


def build_loop(loop: LoopSection, blocks: tuple[Block, ...], raw: RawCase) -> LureSystem:
    """The system of a generic loop.

    Raises
    ------
    CaseError
        If the parts do not fit: an improper transfer function, wrong shapes, forms mixed.
    """
    form = _form(loop, raw)
    field = "loop.blocks" if form is Form.BLOCKS else "loop.elements"
    made = {i: make_element(b, f"{field}.{i}", raw) for i, b in enumerate(blocks) if b.kind}
    try:
        with np.errstate(all="ignore"):  # what overflows is refused as not finite
            if form is Form.STATE_SPACE:
                system = _from_state_space(loop, blocks, list(made.values()), raw)
            else:
                system = _from_ring(loop, blocks, made, raw)
            return _with_margins_at(_with_units(system, loop, blocks), loop, raw)
    except ModelError as error:
        raise raw.refused_by_model(error, "loop") from None


def _from_ring(loop: LoopSection, blocks: tuple[Block, ...], made: dict[int, Nonlinearity], raw: RawCase) -> LureSystem:
    """A ring of blocks; a transfer function with one element is one of two."""
    ring: list[Any] = [
        made[i] if i in made else _linear(b.others, loop, raw, f"loop.blocks.{i}") for i, b in enumerate(blocks)
    ]
    if loop.blocks is None:
        ring.append(_linear({"num": loop.num, "den": loop.den}, loop, raw, "loop"))
    gain = 1.0 if loop.gain is None else float(loop.gain.value)
    if gain != 1.0:
        ring.append(as_state_space(([gain], [1.0]), None if loop.time_step is None else float(loop.time_step.value)))
    elements = [b for b in blocks if b.kind]
    n = sum(part.A.shape[0] for part in ring if isinstance(part, StateSpace))
    if loop.initial_state is not None and len(loop.initial_state) != n:
        raise raw.refused("loop.initial_state", f"{count(n, 'number')}, one for each state")
    return LureSystem.from_blocks(
        ring,
        delay=0.0 if loop.delay is None else float(loop.delay.value),
        feedback=loop.feedback,
        x0=loop.initial_state,
        memory=[b.memory for b in elements],
        element_names=[b.name for b in elements],
        name=raw.name,
    )


def _form(loop: LoopSection, raw: RawCase) -> Form:
    """Which of the three forms of a loop is given; exactly one may be."""
    given = {
        Form.TRANSFER_FUNCTION: loop.num is not None or loop.den is not None,
        Form.BLOCKS: loop.blocks is not None,
        Form.STATE_SPACE: any(m is not None for m in (loop.A, loop.B, loop.C)),
    }
    forms = [name for name, there in given.items() if there]
    if len(forms) != 1:
        expected = "exactly one of: num and den with one element, blocks, or A, B, C with elements"
        raise CaseError(raw.origin("loop"), "loop", " and ".join(forms) or Missing(), expected)
    form = forms[0]
    needed = {
        Form.TRANSFER_FUNCTION: ("num", "den", "elements"),
        Form.BLOCKS: ("blocks",),
        Form.STATE_SPACE: ("A", "B", "C", "elements"),
    }
    for name in needed[form]:
        if getattr(loop, name) in ((None,) if name in _MAY_BE_EMPTY else (None, [])):
            place = f"loop.{name}"
            raise CaseError(raw.origin("loop"), place, raw.typed(place), f"a value: {_NAMED[form]} needs it")
    if form is Form.TRANSFER_FUNCTION and len(loop.elements or []) != 1:
        expected = "one element; put several into blocks or a state space"
        raise CaseError(raw.origin("loop.elements"), "loop.elements", f"{len(loop.elements or [])} elements", expected)
    if form is Form.BLOCKS and loop.elements is not None:
        raise CaseError(raw.origin("loop.elements"), "loop.elements", "given", "the elements inside blocks")
    if form is not Form.STATE_SPACE:
        _refuse_state_space_fields(loop, raw)
    return form


def _refuse_state_space_fields(loop: LoopSection, raw: RawCase) -> None:
    names = (
        "D",
        "constant_state",
        "constant_input",
        "inputs",
        "input_matrix",
        "input_feedthrough",
        "states",
        "signals",
        "initial_input",
        "delays",
        "principal",
        "cuts",
    )
    for name in names:
        if getattr(loop, name):
            raise CaseError(raw.origin(f"loop.{name}"), f"loop.{name}", "given", "it only beside A, B and C")


def _linear(block: dict[str, Any], loop: LoopSection, raw: RawCase, field: str) -> Any:
    step = None if loop.time_step is None else float(loop.time_step.value)
    try:
        return as_state_space((block["num"], block["den"]), step)
    except ModelError as error:
        raise raw.refused_by_model(error, field) from None


def _from_state_space(
    loop: LoopSection, blocks: tuple[Block, ...], elements: list[Nonlinearity], raw: RawCase
) -> LureSystem:
    gain = 1.0 if loop.gain is None else float(loop.gain.value)
    n_outputs = sum(ports(e)[1] for e in elements)
    delay = 0.0 if loop.delay is None else float(loop.delay.value)
    _check_rectangles(loop, raw)
    n = len(loop.A or [])
    if n and len((loop.A or [[]])[0]) != n:
        raise raw.refused("loop.A", "a square matrix")
    for name, length, what in (
        ("initial_state", n, "numbers, one for each state"),
        ("states", n, "names, one for each state"),
        ("initial_input", len(loop.inputs), "numbers, one for each input"),
        ("delays", n_outputs, "numbers, one for each output of an element"),
    ):
        given = getattr(loop, name)
        if given is not None and len(given) != length:
            raise raw.refused(f"loop.{name}", f"{length} {what}")
    if loop.delays is not None and loop.delay is not None:
        raise raw.refused("loop.delays", "either it or loop.delay, not both")
    return LureSystem.build(
        np.array(loop.A, float),
        gain * np.array(loop.B, float),
        np.array(loop.C, float),
        elements,
        D=loop.D,
        B_input=loop.input_matrix,
        D_input=loop.input_feedthrough,
        input_names=loop.inputs,
        constant_state=loop.constant_state,
        constant_input=loop.constant_input,
        element_names=[b.name for b in blocks],
        signals=_signals(loop, n, n_outputs, raw),
        x0=np.ones(n) if loop.initial_state is None else loop.initial_state,
        v0=loop.initial_input,
        memory=[b.memory for b in blocks],
        delays=np.full(n_outputs, delay) if loop.delays is None else loop.delays,
        time_step=None if loop.time_step is None else float(loop.time_step.value),
        state_names=loop.states,
        principal=_principal(loop, [b.name for b in blocks], raw),
        cuts=_cuts(loop, elements, gain, raw),
        name=raw.name,
    )


def _principal(loop: LoopSection, names: list[str], raw: RawCase) -> int:
    """Number of the element at which the loop is cut for margins: the first, where nothing is said."""
    if loop.principal is None:
        return 0
    if loop.principal not in names:
        raise raw.refused("loop.principal", f"one of the elements: {', '.join(names)}")
    return names.index(loop.principal)


def _cuts(loop: LoopSection, elements: list[Nonlinearity], gain: float, raw: RawCase) -> Cuts | None:
    """The places of a state space at which it can be cut besides the ports of its elements.

    The gain of the loop acts behind the elements' outputs: a place whose signal is made of them alone lies before it.
    """
    if loop.cuts is None:
        return None
    nz, nw = (sum(ports(e)[k] for e in elements) for k in (0, 1))
    lengths = {"to_state": len(loop.A or []), "to_inputs": nz, "state": len(loop.A or []), "output": nw}
    rows: dict[str, list[list[float]]] = {part: [] for part in lengths}
    for name, row in loop.cuts.items():
        # The gain scales what the elements' outputs do to the
        # states, so also what a disturbance of such an output does.
        before = gain if row.output is not None and not np.any(row.state or [0.0]) else 1.0
        for part, length in lengths.items():
            given = getattr(row, part)
            if given is not None and len(given) != length:
                raise raw.refused(f"loop.cuts.{name}.{part}", f"{length} numbers")
            factor = before if part == "to_state" else 1.0
            rows[part].append([factor * v for v in given or [0.0] * length])
    matrices = {part: np.array(rows[part], float).reshape(len(loop.cuts), length) for part, length in lengths.items()}
    return Cuts(
        tuple(loop.cuts),
        B=matrices["to_state"].T,
        E=matrices["to_inputs"].T,
        C=matrices["state"],
        D=matrices["output"],
        F=np.array([row.itself for row in loop.cuts.values()]),
        delays=np.array([row.delay for row in loop.cuts.values()]),
    )


def _with_units(system: LureSystem, loop: LoopSection, blocks: Sequence[Block]) -> LureSystem:
    """The loop with units of the signals at its elements' ports, which their fields tell where the file names none."""
    if loop.signals is not None:
        return system
    units: list[str] = []
    for block in blocks:
        if block.kind:
            first, second = units_of_ports(block)
            units += [first, *[second] * block.width[1]]
    return replace(system, signals=replace(system.signals, units=tuple(units)))


def _with_margins_at(system: LureSystem, loop: LoopSection, raw: RawCase) -> LureSystem:
    """The loop with the places at which its margins cut it, where the file names them."""
    if loop.margins_at is None:
        return system
    names = [loop.margins_at] if isinstance(loop.margins_at, str) else loop.margins_at
    for name in names:
        if name not in system.places.names:
            expected = suggestion(name, system.places.names)
            raise CaseError(
                raw.origin("loop.margins_at"), "loop.margins_at", name, f"a place of the loop: {expected.rstrip('.')}"
            )
    return replace(system, margins_at=tuple(names))


def _check_rectangles(loop: LoopSection, raw: RawCase) -> None:
    for name in ("A", "B", "C", "D", "input_matrix", "input_feedthrough"):
        matrix = getattr(loop, name)
        if matrix is not None and len({len(row) for row in matrix}) > 1:
            raise raw.refused(f"loop.{name}", "rows of equal length")


def _signals(loop: LoopSection, n: int, n_outputs: int, raw: RawCase) -> SignalMap | None:
    """The named signals of a state space; None leaves them to the elements."""
    if loop.signals is None:
        return None
    rows_state: list[list[float]] = []
    rows_output: list[list[float]] = []
    rows_input: list[list[float]] = []
    for name, row in loop.signals.items():
        for part, given, length, rows in (
            ("state", row.state, n, rows_state),
            ("output", row.output, n_outputs, rows_output),
            ("input", row.input, len(loop.inputs), rows_input),
        ):
            if given is not None and len(given) != length:
                field = f"loop.signals.{name}.{part}"
                raise raw.refused(field, f"{length} numbers")
            rows.append(given if given is not None else [0.0] * length)
    n_signals = len(loop.signals)
    return SignalMap(
        tuple(loop.signals),
        np.array(rows_state, np.float64).reshape(n_signals, n),
        np.array(rows_output, np.float64).reshape(n_signals, n_outputs),
        np.array(rows_input, np.float64).reshape(n_signals, len(loop.inputs)),
        np.array([row.constant for row in loop.signals.values()]),
        tuple(row.unit for row in loop.signals.values()),
    )
