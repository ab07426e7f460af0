"""Diagrams of a case file: named parameters, blocks, elements and connections, and the loop that they close."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any

from eppanalysis.cases.blocks import (
    Block as ElementTable,
    Held,
    element_class,
    field_types,
    known_elements,
    make_element,
    needed,
    read_block,
    unsaid,
    without,
)
from eppanalysis.cases.files import Connections, Missing, RawCase
from eppanalysis.cases.inputs import input_signals_of
from eppanalysis.cases.kind import Kind, Parts
from eppanalysis.cases.schema import DiagramFile
from eppanalysis.cases.values.automata import AUTOMATON, NUMBERS
from eppanalysis.cases.values.bodies import plays_between_bodies
from eppanalysis.cases.values.dimensions import check_each, check_fields
from eppanalysis.cases.values.expressions import is_expression, same_unit
from eppanalysis.cases.values.parameters import Named, read, resolve
from eppanalysis.cases.values.quantities import AnyQuantity, Parameter, Quantity, plain_value
from eppanalysis.cases.values.toml import toml_line
from eppanalysis.cases.values.wires import units_along_wires
from eppanalysis.cases.variation import LoopVariation
from eppanalysis.cases.words import ELEMENT, KIND, KINDS_OF_BLOCKS, KINDS_OF_ELEMENTS
from eppanalysis.errors import CaseError, IdleInput, ModelError, UnknownName, did_you_mean
from eppanalysis.models.devices.declared import Declared, Form, declared_fields
from eppanalysis.models.diagrams import BLOCKS, Block, Diagram
from eppanalysis.models.diagrams.blocks.control import INTEGRAL, PI, PID
from eppanalysis.models.diagrams.wiring import NAME
from eppanalysis.models.elements import Nonlinearity
from eppanalysis.readable import written
from eppanalysis.units import dimensions

#: The field of a part that is put into the connection to an input.
BEFORE = "before"
#: A name in a sum that is not followed by that of a port.
_ALONE = re.compile(rf"(?<![\w.]){NAME.pattern}(?![\w.])")


class DiagramVariation(LoopVariation):
    """Of a diagram: as of any loop, and parts that may be put before its controllers."""

    def places(self) -> dict[str, str]:
        """Inputs of its controllers, and of the parts that margins are taken at, with what drives them."""
        blocks, cuts = (self.case.held(name) for name in ("blocks", "margins_at"))
        names = {text.partition(".")[0] for text in ([cuts] if isinstance(cuts, str) else _texts(cuts))}
        names |= {name for name in _texts(blocks) if _has_integral(blocks, name)}
        driven = wires(self.case.held("connect"))
        places = {port: left for port, left in driven.items() if port.partition(".")[0] in names}
        integral = {f"{name}.{INTEGRAL}": left for name, left in places.items() if _has_integral(blocks, name)}
        return {**integral, **places}


def _has_integral(blocks: Any, name: str) -> bool:
    """Whether a part is a block with an integral part that can have an input of its own."""
    return name in _texts(blocks) and blocks[name][KIND] in (PI.kind, PID.kind)


class DiagramKind(Kind):
    """Cases of diagrams."""

    name = "diagram"
    file = DiagramFile
    variation = DiagramVariation

    def parts(self, file: Any, raw: RawCase) -> Parts:
        """Named parameters and the fields that are given as quantities, the input, and the loop."""
        file = _with_inserted(file, raw)
        reader = _Reader.of(file.parameters, raw)
        blocks = {name: reader.block(name, table) for name, table in file.blocks.items()}
        elements, memory = reader.elements(file.elements)
        levels = {name: reader.level(name, value) for name, value in file.inputs.items()}
        _require_different_names(file, raw)
        diagram = _diagram(file, {**blocks, **elements}, memory, levels, raw)
        try:
            system = diagram.to_system()
            _require_driving(diagram, raw)
        except ModelError as error:
            raise _refused(error, raw) from None
        known = units_along_wires(diagram, diagram.units, reader.with_units, raw)
        for place, table in reader.tables.items():
            check_fields(table, place, raw)  # what is in lists, which no wire has seen
        system = replace(system, signals=system.signals.in_units(known.signals))
        computed = {place: _in_unit(named, [known.fields.get(place, "")]) for place, named in reader.computed.items()}
        parameters = {**_with_radians(reader.named, computed, file, raw), **reader.given}
        units = {name: (level.unit, level.friendly) for name, level in levels.items()}
        inputs = input_signals_of(file.run, system.input_names, {name: unit for name, (unit, _) in units.items()}, raw)
        said = (*unsaid(reader.tables.values()), *plays_between_bodies(diagram))
        return Parts(parameters, inputs, system, computed=computed, input_units=units, remarks=said)

    def fields(self, parameters: Iterable[str]) -> list[str]:
        """The given ones."""
        return list(parameters)

    def takes(self, name: str, data: Mapping[str, Any]) -> bool:
        """Any part or signal, as a whole table, and any field of a part: reading it tells whether the part has it."""
        first, *rest = name.split(".")
        new = first in ("blocks", "elements", "signals") and len(rest) == 1
        return new or any(first in (data.get(place) or {}) for place in ("blocks", "elements"))

    def named_signals(self, data: Mapping[str, Any], signals: tuple[str, ...]) -> tuple[str, ...]:
        """Those under `signals`; all ports where there are none."""
        return tuple(data.get("signals") or signals)

    def path(self, name: str, data: Mapping[str, Any]) -> list[str | int]:
        """Parameters are in a table of their own, fields in those of their parts, parts in those of their sort."""
        first, *rest = name.split(".")
        if not rest and name in (data.get("parameters") or {}):
            return ["parameters", name]
        place = next((p for p in ("blocks", "elements") if first in (data.get(p) or {})), None)
        return [first, *rest] if place is None else [place, first, *rest]


def _with_radians(
    named: Mapping[str, Named], computed: Mapping[str, Named], file: Any, raw: RawCase
) -> dict[str, Parameter]:
    """The named parameters; one that is computed has the radians of the fields that take it as it is."""
    taken: dict[str, list[str]] = {}
    for place, of_field in computed.items():
        section = "blocks" if place.partition(".")[0] in file.blocks else "elements"
        name = str(plain_value(raw.typed(f"{section}.{place}")))
        if is_expression(plain_value(file.parameters.get(name))):
            taken.setdefault(name, []).append(of_field.parameter.unit)
    return {name: _in_unit(own, taken.get(name, ())).parameter for name, own in named.items()}


def _in_unit(named: Named, units: Iterable[str]) -> Named:
    """A computed number in the unit with radians that it has where it is used, if its own is that but for them.

    A unit that was typed for what it is computed from stays.
    """
    own = named.parameter
    if not own.unit or "radian" in dimensions(own.unit) or own.friendly != written(own.unit):
        return named
    others = {unit for unit in units if "radian" in dimensions(unit) and same_unit(unit, own.unit)}
    if len(others) != 1:
        return named
    unit = others.pop()
    return named._replace(parameter=replace(own, unit=unit, friendly=written(unit)))


def wires(connect: Iterable[str]) -> dict[str, str]:
    """What drives each input, by the connections of a file as they are written."""
    ends = [text.partition("->") for text in connect]
    return {name.strip(): left.strip() for left, _, right in ends for name in right.split(",")}


def _renamed(connection: str, port: str, name: str) -> str:
    """A connection with another name in place of an input."""
    left, arrow, right = connection.partition("->")
    ends = (name if end.strip() == port else end.strip() for end in right.split(","))
    return f"{left}{arrow} {', '.join(ends)}"


def _with_inserted(file: Any, raw: RawCase) -> Any:
    """The file with connections through the parts that say which input they are before."""
    connect, sections = list(file.connect), {}
    for section in ("blocks", "elements"):
        sections[section] = {
            name: {k: v for k, v in table.items() if k != BEFORE} for name, table in getattr(file, section).items()
        }
    for section in sections:
        tables = getattr(file, section)
        for name, table in tables.items():
            if BEFORE not in table:
                continue
            port, driven = table[BEFORE], wires(connect)
            part, _, last = str(port).partition(".")
            if last == INTEGRAL and port not in driven and part in driven and part in file.blocks:
                # A controller whose parts read one error: the integral part gets an input of its own.
                sections["blocks"][part]["integral_input"] = INTEGRAL
                connect = [_renamed(text, part, f"{part}.in, {port}") for text in connect]
                driven = wires(connect)
            if not isinstance(port, str) or port not in driven:
                expected = f"an input as a connection names it: one of {', '.join(filter(None, driven))}"
                raise raw.refused(f"{section}.{name}.{BEFORE}", expected)
            connect = [_renamed(text, port, name) for text in connect]
            connect.append(f"{name} -> {port}")  # at the end: the others keep their numbers in messages
    return file.model_copy(update={**sections, "connect": connect})


def _diagram(
    file: Any,
    parts: Mapping[str, Block | Nonlinearity],
    memory: Mapping[str, Any],
    levels: Mapping[str, Parameter],
    raw: RawCase,
) -> Diagram:
    """The diagram of a file whose parts are made."""
    units = {name: signal.unit for name, signal in file.signals.items()}
    units |= {name: level.unit for name, level in levels.items() if level.unit}
    try:
        return Diagram(
            parts=parts,
            connect=file.connect,
            inputs={name: float(level.value) for name, level in levels.items()},
            signals={name: signal.of for name, signal in file.signals.items()},
            units=units,
            memory=memory,
            margins_at=raw.data.get("margins_at", ()),
            name=raw.name,
        )
    except ModelError as error:
        raise _refused(error, raw) from None


def _refused(error: ModelError, raw: RawCase) -> CaseError:
    """What a diagram refuses as that of the file: of the field that it names, else of the connections."""
    field = error.field or "connect"
    if isinstance(raw.typed(field), Mapping) and field.startswith("signals."):
        field = f"{field}.of"
    found = error.found.removeprefix(f"{raw.name}: ")
    value = Connections() if field == "connect" else raw.typed(field)
    if not error.expected:
        expected = f"{'a place of the loop' if field == 'margins_at' else 'a diagram that makes a loop'} ({found})"
    else:
        expected = error.wanted() if error.has_value else f"{error.wanted()} ({found})"
    return CaseError(raw.origin(field), field, value, expected, error.fault)


def with_declaration(error: CaseError, raw: RawCase) -> CaseError:
    """A refusal of a name that may be an external input, with the line that declares it."""
    if not isinstance(error.fault, UnknownName) or error.fault.name not in (names := _undeclared(raw.data)):
        return error
    declared = raw.data.get("inputs", [])
    every = {**declared, **dict.fromkeys(names, 0.0)} if isinstance(declared, dict) else [*_texts(declared), *names]
    line = f"{toml_line('inputs', every)} above the first section"
    expected = f"{error.expected}; an external input needs the line {line}"
    return CaseError(error.source, error.field, error.value, expected, error.fault, error.also)


def _undeclared(data: Mapping[str, Any]) -> list[str]:
    """Names that drive something and are driven by nothing, of no part and like no name that there is."""
    known = [name for section in ("blocks", "elements", "inputs") for name in _texts(data.get(section))]
    ends = [text.partition("->") for text in _texts(data.get("connect"))]
    driven = {name for _, _, right in ends for name in NAME.findall(right)}
    names = dict.fromkeys(name for left, _, _ in ends for name in _ALONE.findall(left))
    slips = {name for name in names if did_you_mean(name, known).startswith("did you mean")}
    return [name for name in names if name not in {*known, *driven, *slips}]


def _texts(given: Any) -> list[str]:
    """The texts in a list, or the names in a table, whatever else a file has there."""
    return [text for text in given if isinstance(text, str)] if isinstance(given, list | dict) else []


def _require_driving(diagram: Diagram, raw: RawCase) -> None:
    """An external input of a file that nothing is connected to is one that was forgotten."""
    for name in diagram.idle_inputs:
        field = f"inputs.{name}"
        expected = f"a connection such as '{name} -> ...', as the external input {name} drives nothing"
        raise CaseError(raw.origin(field), field, raw.typed_or(field, name), expected, IdleInput(name))


def _require_different_names(file: Any, raw: RawCase) -> None:
    """Blocks, elements and external inputs are called by their names in connections, so no two have the same."""
    places: dict[str, str] = {}
    for section in ("blocks", "elements", "inputs"):
        for name in getattr(file, section):
            if name in places:
                field = f"{section}.{name}"
                expected = f"another name: {places[name]}.{name} has it already"
                raise CaseError(raw.origin(field), field, name, expected)
            places[name] = section


@dataclass(frozen=True)
class _Reader:
    """Reads values of a file, be they quantities or expressions of its parameters."""

    named: Mapping[str, Named]  # the named parameters
    raw: RawCase
    given: dict[str, Parameter]  # fields of parts that are quantities, filled while they are read
    #: Of each part ("blocks.controller") the numbers that have a unit, filled while they are read.
    with_units: dict[str, dict[str, Parameter]]
    tables: dict[str, ElementTable]  # the elements' own by their places, filled while they are read
    computed: dict[str, Named]  # what expressions in fields of parts come to, filled while they are read

    @classmethod
    def of(cls, parameters: Mapping[str, Any], raw: RawCase) -> _Reader:
        """With the named parameters of a file."""
        return cls(resolve(parameters, "parameters", raw), raw, {}, {}, {}, {})

    def level(self, name: str, value: Any) -> Parameter:
        """Where an external input is before the start."""
        return self._number(value, f"inputs.{name}")

    def block(self, name: str, table: Mapping[str, Any]) -> Block:
        """A linear block."""
        place = f"blocks.{name}"
        kind = table.get(KIND)
        if not isinstance(kind, str) or kind not in BLOCKS:
            expected = f"a known kind of block: {did_you_mean(str(kind)[:60], BLOCKS)}"
            for word in (kind, table.get(ELEMENT)):
                if isinstance(word, str) and (word in known_elements() or word in KINDS_OF_ELEMENTS):
                    expected = f"a kind of block; {word} is an element, which belongs in [elements]"
            raise CaseError(self.raw.origin(place), f"{place}.kind", kind or Missing(), expected)
        made = BLOCKS[kind]
        fields = declared_fields(made)
        given = {key: value for key, value in table.items() if key != "kind"}
        for key, value in given.items():
            if key not in fields:
                expected = f"a field of {kind}: {did_you_mean(key, fields)}"
                raise CaseError(self.raw.origin(f"{place}.{key}"), f"{place}.{key}", value, expected)
        self.with_units[place] = {}
        values = {key: self._field(name, key, value, fields[key]) for key, value in given.items()}
        lacking = needed(made, given=values)
        if lacking:
            raise without(lambda **given: made(**given).state_space(), values, lacking, place, kind, self.raw)
        try:
            block = made(**values)
            block.state_space()
            return block
        except ModelError as error:
            raise self.raw.refused_by_model(error, place) from None

    def elements(self, tables: Mapping[str, Mapping[str, Any]]) -> tuple[dict[str, Nonlinearity], dict[str, Any]]:
        """The elements by their names, and what they remember at the start."""
        elements, memory = {}, {}
        for name, table in tables.items():
            place = f"elements.{name}"
            kind = table.get(KIND)
            if not isinstance(kind, str) or kind not in known_elements():
                expected = f"a known element: {did_you_mean(str(kind)[:60], known_elements())}"
                if isinstance(kind, str) and (kind in BLOCKS or kind in KINDS_OF_BLOCKS):
                    expected = f"an element; {kind} is a kind of block, which belongs in [blocks]"
                raise self.raw.refused(f"{place}.{KIND}", expected)
            block = read_block({**self._evaluated(name, table), "name": name}, place, self.raw)
            check_each(block, place, self.raw)
            try:
                elements[name] = make_element(block, place, self.raw)
            except CaseError as error:
                raise self._with_value(error, block) from None
            if block.memory is not None:
                memory[name] = block.memory
            self.with_units[place] = {k: p for k, p in block.parameters.items() if p.unit or p.friendly}
            self._keep(name, block)
            self.tables[place] = block
        return elements, memory

    def _with_value(self, error: CaseError, block: ElementTable) -> CaseError:
        """The same refusal with what an expression comes to."""
        found = block.parameters.get(error.field.rpartition(".")[2])
        if found is None or not is_expression(error.value):
            return error
        return CaseError(error.source, error.field, error.value, f"{error.expected}: {error.value} is {found}")

    def _keep(self, name: str, block: ElementTable) -> None:
        """Remember the fields of an element that are quantities."""
        for key, parameter in block.parameters.items():
            if not is_expression(self.raw.typed(f"elements.{name}.{key}")):
                self.given[f"{name}.{key}"] = parameter

    def _evaluated(self, name: str, table: Mapping[str, Any]) -> dict[str, Any]:
        """The table of an element with its expressions replaced by what they come to, in fields that hold numbers."""
        kind, place = table[KIND], f"elements.{name}"
        if kind == AUTOMATON:
            return self._of_rules(table, place)
        made = element_class(kind)
        sizes = {} if made.estimate is None else made.estimate.sizes
        types = field_types(made)
        single = {*sizes, *(field for field, held in types.items() if held in (Held.NUMBER, Held.COUNT))}
        lists = {"memory", *(field for field, held in types.items() if held is Held.LIST)}
        return {
            key: self._put_in(value, f"{place}.{key}", key in lists) if key in single | lists else value
            for key, value in table.items()
        }

    def _of_rules(self, table: Mapping[str, Any], place: str) -> dict[str, Any]:
        """The same of an automaton, whose fields are in tables of tables."""
        found: dict[str, Any] = {}
        for key, value in table.items():
            field = f"{place}.{key}"
            if isinstance(value, Mapping):
                found[key] = value if "value" in value else self._of_rules(value, field)
            elif key in NUMBERS:
                found[key] = self._put_in(value, field, True)
            elif isinstance(value, list):
                found[key] = [
                    self._of_rules(part, f"{field}.{i}") if isinstance(part, Mapping) else part
                    for i, part in enumerate(value)
                ]
            else:
                found[key] = value
        return found

    def _put_in(self, value: Any, field: str, in_lists: bool) -> Any:
        """A value with its expression computed, or those in lists."""
        if in_lists and isinstance(value, list):
            return [self._put_in(v, f"{field}.{i}", True) for i, v in enumerate(value)]
        return self._number(value, field) if is_expression(value) else value

    def _field(self, part: str, key: str, value: Any, declared: Declared) -> Any:
        """A field of a block."""
        field = f"blocks.{part}.{key}"
        if declared.form is Form.CHOICE:
            return value
        if declared.form is Form.NAMES:
            if not isinstance(value, list) or not all(isinstance(v, str) and v.isidentifier() for v in value):
                raise self.raw.refused(field, "a list of plain names")
            return tuple(value)
        if declared.form in (Form.NUMBERS, Form.MATRIX, Form.ROOTS):
            return self._numbers(value, field, declared.form.value)
        found = self._number(value, field, declared)
        typed = self._number(value, field)
        if typed.unit or typed.friendly:
            self.with_units[f"blocks.{part}"][key] = typed
            found = replace(found, friendly=typed.friendly)  # shown as it was typed
        if not is_expression(value):
            self.given[f"{part}.{key}"] = found
        return float(found.value)

    def _numbers(self, value: Any, field: str, expected: str) -> Any:
        """Lists of numbers, of any depth."""
        if not isinstance(value, list):
            raise self.raw.refused(field, expected)
        found, refused = [], []
        for i, v in enumerate(value):
            at = f"{field}.{i}"
            try:
                found.append(
                    self._numbers(v, at, expected) if isinstance(v, list) else float(self._number(v, at).value)
                )
            except CaseError as error:
                refused += [error, *error.also]
        if refused:
            refused[0].also = tuple(refused[1:])
            raise refused[0]
        return tuple(found)

    def _number(self, value: Any, field: str, declared: Declared | None = None) -> Parameter:
        """A quantity or an expression, of the unit and in the range that are declared."""
        kind: Quantity | AnyQuantity = AnyQuantity()
        if declared is not None and declared.unit:
            kind = Quantity(declared.unit, declared.friendly, *declared.limits)
        found = read(value, field, self.raw, self.named, kind)
        if is_expression(plain_value(value)):
            self.computed.setdefault(field.partition(".")[2], found)
        return found.parameter
