"""Generic loops of a case file: elements by name, and the system that they close."""

from __future__ import annotations

import dataclasses
import difflib
import inspect
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any, Literal, get_origin, get_type_hints

import numpy as np
from pydantic_core import PydanticCustomError

from eppanalysis.case.dimensions import check_units
from eppanalysis.case.files import Missing, RawCase
from eppanalysis.case.kind import Kind, Parts
from eppanalysis.case.motions import motions_of
from eppanalysis.case.quantities import AnyQuantity, Parameter
from eppanalysis.case.schema import LoopSection
from eppanalysis.errors import CaseError, ModelError
from eppanalysis.models.linear import StateSpace, as_state_space
from eppanalysis.models.lure import LureSystem, SignalMap
from eppanalysis.models.nonlinearities import ELEMENTS, Nonlinearity
from eppanalysis.models.nonlinearities.memory import Slip
from eppanalysis.units import QuantityError, parse_any

LARGEST_COUNT = 100_000
#: Matrices of a loop without states.
_MAY_BE_EMPTY = ("A", "B", "C")
#: Scalar fields of a loop as a whole.
_OF_LOOP = ("gain", "delay", "time_step")


@dataclass(frozen=True)
class Block:
    """One element of a loop, or one linear block of a ring.

    Attributes
    ----------
    name : str
        Of the element; empty for a linear block.
    kind : str
        Name of the element's class in a case file; empty for a linear block.
    parameters : dict of str to Parameter
        Scalar fields of the element.
    others : dict
        Lists and texts of the element, or num and den of a linear block.
    memory : float, Slip or None
        First held value at the start; of an element that sticks also direction, and input reached.
    lists : dict of str to list of Parameter
        Lists of the element with their units.
    """

    name: str
    kind: str
    parameters: dict[str, Parameter]
    others: dict[str, Any]
    memory: float | Slip | None = None
    lists: dict[str, list[Parameter]] = dataclasses.field(default_factory=dict)

    @property
    def width(self) -> tuple[int, int]:
        """Number of inputs and outputs of the element."""
        made = element_class(self.kind)
        return made.n_inputs, made.n_outputs


def element_class(kind: str) -> type[Nonlinearity]:
    """Class of an element."""
    return ELEMENTS[kind]


@cache
def _field_types(made: type[Nonlinearity]) -> dict[str, str]:
    """What each field of an element holds by its annotation: a "number", a "count", a "list" or a "text"."""
    hints = get_type_hints(made)
    return {name: _field_type(hints[name]) for name in inspect.signature(made).parameters}


def _field_type(hint: Any) -> str:
    if get_origin(hint) is Literal:
        return "text"
    if get_origin(hint) is np.ndarray:
        return "list"
    return "count" if hint is int else "number"


def read_blocks(tables: list[dict[str, Any]], field: str, raw: RawCase) -> tuple[Block, ...]:
    """Check a list of elements and linear blocks.

    Raises
    ------
    CaseError
        If a table is no known element, lacks a field, or has one that is not known or has no valid value.
    """
    blocks = tuple(_read_block(t, f"{field}.{i}", raw) for i, t in enumerate(tables))
    names = [b.name for b in blocks if b.name]
    for i, block in enumerate(blocks):
        if block.name and names.count(block.name) > 1:
            raise CaseError(raw.origin(field), f"{field}.{i}.name", block.name, "a name that no other element has")
    return blocks


def _read_block(table: dict[str, Any], field: str, raw: RawCase) -> Block:
    if "element" not in table:
        if set(table) != {"num", "den"}:
            wrong = next((k for k in table if k not in ("num", "den")), None)
            name = wrong or ("num" if "num" not in table else "den")
            place, expected = f"{field}.{name}", "an element, or num and den of a linear block"
            raise CaseError(raw.origin(place), place, table.get(name, Missing()), expected)
        return Block("", "", {}, {k: _coefficients(table[k], f"{field}.{k}", raw) for k in ("num", "den")})
    kind = table["element"]
    if not isinstance(kind, str) or kind not in ELEMENTS:
        close = difflib.get_close_matches(str(kind)[:60], ELEMENTS, n=1)
        hint = f"did you mean {close[0]!r}?" if close else f"one of {', '.join(ELEMENTS)}"
        raise raw.refused(f"{field}.element", f"a known element: {hint}")
    name = table.get("name", kind)
    if not isinstance(name, str) or not name.isidentifier() or len(name) > 60:
        raise raw.refused(f"{field}.name", "a plain name of letters, digits and underscores")
    memory = table.get("memory")
    if memory is not None:
        memory = _memory(memory, f"{field}.memory", raw)
    return _read_fields(kind, name, memory, table, f"{field}", raw)


def _memory(value: Any, field: str, raw: RawCase) -> float | Slip:
    """A held value, or a list of held value, direction and input reached."""
    if not isinstance(value, list):
        return float(_scalar(value, field, raw).value)
    if len(value) != len(Slip._fields):
        raise raw.refused(field, "a number, or a list of held value, direction and input reached")
    return Slip(*(float(p.value) for p in _list(value, field, raw)))


def _read_fields(
    kind: str, name: str, memory: float | Slip | None, table: dict[str, Any], field: str, raw: RawCase
) -> Block:
    known = {k: p.default for k, p in inspect.signature(element_class(kind)).parameters.items()}
    parameters: dict[str, Parameter] = {}
    others: dict[str, Any] = {}
    lists: dict[str, list[Parameter]] = {}
    types = _field_types(element_class(kind))
    for key, value in table.items():
        if key in ("element", "name", "memory"):
            continue
        place = f"{field}.{key}"
        if key not in known:
            close = difflib.get_close_matches(key, known, n=1)
            hint = f"did you mean {close[0]!r}?" if close else f"one of {', '.join(known)}"
            raise CaseError(raw.origin(place), place, value, f"a field of {kind}: {hint}")
        if types[key] == "list":
            lists[key] = _list(value, place, raw)
            others[key] = [float(p.value) for p in lists[key]]
        elif types[key] == "text":
            others[key] = value
        else:
            parameters[key] = _scalar(value, place, raw)
    for key, default in known.items():
        if default is inspect.Parameter.empty and key not in table:
            raise raw.refused(f"{field}.{key}", f"a value: {kind} needs it")
    return Block(name, kind, parameters, others, memory, lists)


def _scalar(value: Any, field: str, raw: RawCase) -> Parameter:
    try:
        return AnyQuantity().read(value)
    except PydanticCustomError as error:
        context = error.context or {}
        raise CaseError(
            raw.origin(field), field, context.get("shown", value), context.get("expected", "a number")
        ) from None


def _list(value: Any, field: str, raw: RawCase) -> list[Parameter]:
    if not isinstance(value, list) or not value:
        raise raw.refused(field, "a list of numbers")
    return [_scalar(v, f"{field}.{i}", raw) for i, v in enumerate(value)]


def _coefficients(value: Any, field: str, raw: RawCase) -> list[float]:
    """Coefficients of a transfer function; units differ from power to power, and are the user's own affair."""
    found = _list(value, field, raw)
    for i, parameter in enumerate(found):
        if parameter.unit or parameter.friendly:
            raise raw.refused(f"{field}.{i}", "a plain number, in SI units: a coefficient takes no unit")
    return [float(parameter.value) for parameter in found]


def make_element(block: Block, field: str, raw: RawCase) -> Nonlinearity:
    """The element of a block.

    Raises
    ------
    CaseError
        If the element does not take the values.
    """
    values: dict[str, Any] = {k: p.value for k, p in block.parameters.items()}
    types = _field_types(element_class(block.kind))
    for key in (key for key in values if types[key] == "count"):
        if not (values[key] == round(values[key]) and 0 < values[key] <= LARGEST_COUNT):
            raise raw.refused(f"{field}.{key}", f"a whole number from 1 to {LARGEST_COUNT}")
        values[key] = round(values[key])
    try:
        with np.errstate(all="ignore"):  # what overflows is refused as not finite
            return element_class(block.kind)(**values, **block.others)
    except ModelError as error:
        raise raw.refused_by_model(error, field) from None


class LoopKind(Kind):
    """Cases of generic loops."""

    name = "loop"
    input_unit = ""

    def parts(self, file: Any, raw: RawCase) -> Parts:
        """The elements' scalar fields and what stands before the loop as a whole, the input, and the loop."""
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
        return Parts(fields, motions_of(file.run, system.input_names, self.input_unit, raw), system)

    def fields(self, parameters: Iterable[str]) -> list[str]:
        """The given ones, and those of the loop as a whole."""
        return list(dict.fromkeys([*parameters, *(f"loop.{name}" for name in _OF_LOOP)]))

    def si(self, value: object, unit: str) -> float:
        """A quantity in the field's unit, or a plain number."""
        number, given = parse_any(value)
        if given not in ("", unit):
            raise QuantityError(f"a quantity in {unit or 'plain numbers'}")
        return number

    def takes(self, name: str, data: Mapping[str, Any]) -> bool:
        """Any field of an element: reading it tells whether the element has it."""
        return name.partition(".")[0] in _places(data)

    def path(self, name: str, data: Mapping[str, Any]) -> list[str | int]:
        """Elements stand in a list, and are called by their names."""
        first, _, rest = name.partition(".")
        places = _places(data)
        return ["loop", *places[first], rest] if first in places else list(name.split("."))


def _places(data: Mapping[str, Any]) -> dict[str, tuple[str, int]]:
    """Where each named element stands in the file."""
    loop = data.get("loop", {})
    return {
        table.get("name", table["element"]): (place, i)
        for place in ("elements", "blocks")
        for i, table in enumerate(loop.get(place) or [])
        if "element" in table
    }


def build_loop(loop: LoopSection, blocks: tuple[Block, ...], raw: RawCase) -> LureSystem:
    """The system of a generic loop.

    Raises
    ------
    CaseError
        If the parts do not fit: an improper transfer function, wrong shapes, forms mixed.
    """
    form = _form(loop, raw)
    field = "loop.blocks" if form == "blocks" else "loop.elements"
    made = {i: make_element(b, f"{field}.{i}", raw) for i, b in enumerate(blocks) if b.kind}
    try:
        with np.errstate(all="ignore"):  # what overflows is refused as not finite
            if form == "state space":
                return _from_state_space(loop, blocks, list(made.values()), raw)
            return _from_ring(loop, blocks, made, raw)
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
        numbers = "1 number, of the one state" if n == 1 else f"{n} numbers, one for each state"
        raise raw.refused("loop.initial_state", numbers)
    return LureSystem.from_blocks(
        ring,
        delay=0.0 if loop.delay is None else float(loop.delay.value),
        feedback=loop.feedback,
        x0=loop.initial_state,
        memory=[b.memory for b in elements],
        element_names=[b.name for b in elements],
        name=raw.name,
    )


def _form(loop: LoopSection, raw: RawCase) -> str:
    """Which of the three forms of a loop is given; exactly one may be."""
    given = {
        "transfer function": loop.num is not None or loop.den is not None,
        "blocks": loop.blocks is not None,
        "state space": any(m is not None for m in (loop.A, loop.B, loop.C)),
    }
    forms = [name for name, there in given.items() if there]
    if len(forms) != 1:
        expected = "exactly one of: num and den with one element, blocks, or A, B, C with elements"
        raise CaseError(raw.origin("loop"), "loop", " and ".join(forms) or Missing(), expected)
    form = forms[0]
    needed = {
        "transfer function": ("num", "den", "elements"),
        "blocks": ("blocks",),
        "state space": ("A", "B", "C", "elements"),
    }
    for name in needed[form]:
        if getattr(loop, name) in ((None,) if name in _MAY_BE_EMPTY else (None, [])):
            raise CaseError(raw.origin("loop"), f"loop.{name}", Missing(), f"a value: a {form} needs it")
    if form == "transfer function" and len(loop.elements or []) != 1:
        expected = "one element; put several into blocks or a state space"
        raise CaseError(raw.origin("loop.elements"), "loop.elements", f"{len(loop.elements or [])} elements", expected)
    if form == "blocks" and loop.elements is not None:
        raise CaseError(raw.origin("loop.elements"), "loop.elements", "given", "the elements inside blocks")
    if form != "state space":
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
    )
    for name in names:
        if getattr(loop, name):
            raise CaseError(raw.origin(f"loop.{name}"), f"loop.{name}", "given", "it only beside A, B and C")


def _linear(block: dict[str, Any], loop: LoopSection, raw: RawCase, field: str) -> Any:
    step = None if loop.time_step is None else float(loop.time_step.value)
    try:
        return as_state_space((block["num"], block["den"]), step)
    except ModelError as error:
        raise raw.refused_by_model(error, f"{field}.num") from None


def _from_state_space(
    loop: LoopSection, blocks: tuple[Block, ...], elements: list[Nonlinearity], raw: RawCase
) -> LureSystem:
    gain = 1.0 if loop.gain is None else float(loop.gain.value)
    n_outputs = sum(e.n_outputs for e in elements)
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
        name=raw.name,
    )


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


def describe_block(block: Block) -> dict[str, Any]:
    """Plain data of a block, for provenance."""
    return {
        "name": block.name,
        "element": block.kind,
        **{k: dataclasses.asdict(p) for k, p in block.parameters.items()},
        **block.others,
    }
