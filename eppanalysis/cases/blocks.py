"""Elements and linear blocks of a case file: read, checked against the element's own fields, made."""

from __future__ import annotations

import dataclasses
import inspect
import re
from collections.abc import Callable, Container, Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from enum import Enum
from functools import cache, partial
from typing import Any, Literal, get_origin, get_type_hints

import numpy as np

from eppanalysis.cases.files import LABEL, LABEL_IS, Missing, RawCase
from eppanalysis.cases.values.automata import AUTOMATON, read_automaton, read_memory
from eppanalysis.cases.values.parameters import read_scalar
from eppanalysis.cases.values.quantities import Parameter
from eppanalysis.cases.values.tables import read_columns
from eppanalysis.cases.words import FILE, KIND, OF_ALL
from eppanalysis.errors import CaseError, EppError, ModelError, did_you_mean
from eppanalysis.models.devices.declared import Declared, Form, declared_fields
from eppanalysis.models.diagrams import BLOCKS, Block as LinearBlock
from eppanalysis.models.elements import ELEMENTS, AutomatonElement, Nonlinearity
from eppanalysis.models.elements.base import Estimate, Role
from eppanalysis.models.elements.memory import Slip
from eppanalysis.models.elements.own import ModeMemory
from eppanalysis.models.elements.phases import require_ordinary
from eppanalysis.units import KINDS

LARGEST_COUNT = 100_000
#: Fields that hold the two sides of one thing, and what a parameter without a default has.
_SIDES, _NONE = (("lower", "upper"), ("low", "high")), inspect.Parameter.empty
#: Values in place of a missing number when the rest of a part is read: of both signs, nothing, large and small.
_TRIALS = (1.0, -1.0, 0.0, 1e-3, 1e3)
#: What an element remembers at the start.
Memory = float | Slip | tuple[float, ...] | ModeMemory | None


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
    memory : float, Slip, tuple of float, ModeMemory or None
        First held value at the start; of an element that sticks also direction, and input reached.
    lists : dict of str to list of Parameter
        Lists of the element with their units.
    roles : mapping of str to Role
        What the fields are the units of.
    """

    name: str
    kind: str
    parameters: dict[str, Parameter]
    others: dict[str, Any]
    memory: Memory = None
    lists: dict[str, list[Parameter]] = dataclasses.field(default_factory=dict)
    roles: Mapping[str, Role] = dataclasses.field(default_factory=dict)

    @property
    def width(self) -> tuple[int, int]:
        """Number of inputs and outputs of the element."""
        own, made = self.others.get("own_states"), self.others.get("rules", element_class(self.kind))
        return (made.n_inputs, made.n_outputs) if own is None else (own.n_before, own.n_behind)


def known_elements() -> dict[str, type[Nonlinearity]]:
    """Classes of elements by what case files call them."""
    return {**ELEMENTS, AUTOMATON: AutomatonElement}


def element_class(kind: str) -> type[Nonlinearity]:
    """Class of an element."""
    return known_elements()[kind]


class Held(Enum):
    """What a field of an element holds."""

    NUMBER, COUNT, LIST, TEXT = range(4)


@cache
def field_types(made: type[Nonlinearity]) -> dict[str, Held]:
    """What each field of an element holds by its annotation."""
    hints = get_type_hints(made)
    return {name: _field_type(hints[name]) for name in inspect.signature(made).parameters}


def _field_type(hint: Any) -> Held:
    if get_origin(hint) is Literal:
        return Held.TEXT
    if get_origin(hint) is np.ndarray:
        return Held.LIST
    return Held.COUNT if hint is int else Held.NUMBER


def read_blocks(tables: list[dict[str, Any]], field: str, raw: RawCase) -> tuple[Block, ...]:
    """Check a list of elements and linear blocks.

    Raises
    ------
    CaseError
        If a table is no known element, lacks a field, or has one that is not known or has no valid value.
    """
    blocks = tuple(read_block(t, f"{field}.{i}", raw) for i, t in enumerate(tables))
    names = [b.name for b in blocks if b.name]
    for i, block in enumerate(blocks):
        if block.name and names.count(block.name) > 1:
            raise CaseError(raw.origin(field), f"{field}.{i}.name", block.name, "a name that no other element has")
    return blocks


def read_block(table: dict[str, Any], field: str, raw: RawCase) -> Block:
    """Check the table of one element or linear block in a field.

    Raises
    ------
    CaseError
        As :func:`read_blocks`.
    """
    if KIND not in table:
        if set(table) != {"num", "den"}:
            wrong = next((k for k in table if k not in ("num", "den")), None)
            name = wrong or ("num" if "num" not in table else "den")
            place, expected = f"{field}.{name}", "an element, or num and den of a linear block"
            raise CaseError(raw.origin(place), place, table.get(name, Missing()), expected)
        return Block("", "", {}, {k: _coefficients(table[k], f"{field}.{k}", raw) for k in ("num", "den")})
    kind = table[KIND]
    if not isinstance(kind, str) or kind not in known_elements():
        expected = f"a known element: {did_you_mean(str(kind)[:60], known_elements())}"
        raise raw.refused(f"{field}.{KIND}", expected)
    name = table.get("name", kind)
    if not isinstance(name, str) or not re.fullmatch(LABEL, name) or len(name) > 100:
        raise raw.refused(f"{field}.name", LABEL_IS)
    memory = table.get("memory")
    if kind == AUTOMATON:
        fields = {key: value for key, value in table.items() if key not in OF_ALL}
        found = read_automaton(fields, field, raw)
        if memory is not None:
            memory = read_memory(memory, found.arguments["rules"], f"{field}.memory", raw)
        return Block(name, kind, found.parameters, found.arguments, memory, roles=found.units)
    if memory is not None:
        memory = _memory(memory, element_class(kind).remembers_a_list, f"{field}.memory", raw)
    return _read_fields(kind, name, memory, table, f"{field}", raw)


def _memory(value: Any, is_list: bool, field: str, raw: RawCase) -> float | Slip | tuple[float, ...]:
    """A held value, or a list of held value, direction and input reached, or of whatever the element remembers."""
    if is_list:
        return tuple(float(p.value) for p in _list(value, field, raw))
    if not isinstance(value, list):
        return float(read_scalar(value, field, raw).value)
    if len(value) != len(Slip._fields):
        raise raw.refused(field, "a number, or a list of held value, direction and input reached")
    return Slip(*(float(p.value) for p in _list(value, field, raw)))


def _read_fields(kind: str, name: str, memory: Memory, table: dict[str, Any], field: str, raw: RawCase) -> Block:
    parameters: dict[str, Parameter] = {}
    others: dict[str, Any] = {}
    lists: dict[str, list[Parameter]] = {}
    types = field_types(element_class(kind))
    table = _with_columns(element_class(kind).columns, table, field, raw)
    parameters |= _from_sizes(element_class(kind).estimate, table, field, raw)
    for key, value in table.items():
        if key in OF_ALL or key in parameters:
            continue
        place = f"{field}.{key}"
        if key not in types:
            raise raw.refused(place, f"a field of {kind}: {did_you_mean(key, types)}")
        if types[key] is Held.LIST:
            lists[key] = _list(value, place, raw)
            others[key] = [float(p.value) for p in lists[key]]
        elif types[key] is Held.TEXT:
            others[key] = value
        else:
            parameters[key] = read_scalar(value, place, raw)
    return Block(name, kind, parameters, others, memory, lists, element_class(kind).units)


def _with_columns(columns: tuple[str, ...], table: dict[str, Any], field: str, raw: RawCase) -> dict[str, Any]:
    """The table of an element with the columns of its file in it, where it names one."""
    if not columns or FILE not in table:
        return table
    for column in columns:
        if column in table:
            raise raw.refused(f"{field}.{column}", f"either {FILE}, or {' and '.join(columns)}")
    rest = {key: value for key, value in table.items() if key != FILE}
    return rest | read_columns(table[FILE], columns, f"{field}.{FILE}", raw)


def _from_sizes(estimate: Estimate | None, table: dict[str, Any], field: str, raw: RawCase) -> dict[str, Parameter]:
    """The sizes that the table of an element gives, and what is estimated from them where the table does not say it."""
    if estimate is None or not any(name in table for name in estimate.sizes):
        return {}
    found = {}
    for name, unit in estimate.sizes.items():
        place = f"{field}.{name}"
        if name not in table:
            raise raw.refused(place, f"a value: {estimate.field} is estimated from {' and '.join(estimate.sizes)}")
        found[name] = read_scalar(table[name], place, raw)
        if found[name].unit not in ("", unit) or not found[name].value > 0:
            raise raw.refused(place, f"{KINDS[unit][0]} that is positive, such as {KINDS[unit][1]!r}")
    if estimate.field not in table:
        value = estimate.of(**{name: float(p.value) for name, p in found.items()})
        found[estimate.field] = Parameter(value, estimate.unit, estimate.unit, "derived", f"estimated: {estimate.by}")
    return found


def unsaid(blocks: Iterable[Block]) -> tuple[str, ...]:
    """A sentence for each number of an element that the file leaves open, and that is hardly seen from it.

    Such are an estimate, and the default of one side where the file gives the other.
    """
    said = []
    for block in blocks:
        said += _half_given(block) if block.kind else []
        estimate = known_elements()[block.kind].estimate if block.kind else None
        found = block.parameters.get(estimate.field) if estimate is not None else None
        if estimate is not None and found is not None and found.note == f"estimated: {estimate.by}":
            at = f"{block.name}.{estimate.field}"
            said.append(f"{at} is estimated to be {found}: {estimate.by}; give {estimate.field} to replace it.")
    return tuple(said)


def _half_given(block: Block) -> list[str]:
    fields = inspect.signature(element_class(block.kind)).parameters
    pairs = [pair for pair in _SIDES if all(name in fields and fields[name].default is not _NONE for name in pair)]
    one_sided = [sorted(pair, key=block.parameters.__contains__) for pair in pairs]
    return [
        f"{block.name}.{left} is not given, beside {block.name}.{given} of {block.parameters[given]}, "
        f"and is {fields[left].default:g} by default."
        for left, given in one_sided
        if given in block.parameters and left not in block.parameters
    ]


def _list(value: Any, field: str, raw: RawCase) -> list[Parameter]:
    if not isinstance(value, list):
        raise raw.refused(field, "a list of numbers")
    return [read_scalar(v, f"{field}.{i}", raw) for i, v in enumerate(value)]


def _coefficients(value: Any, field: str, raw: RawCase) -> list[float]:
    """Coefficients of a transfer function; units differ from power to power, and are the user's own affair."""
    found = _list(value, field, raw)
    if not found:
        raise raw.refused(field, "a list of numbers")
    for i, parameter in enumerate(found):
        if parameter.unit or parameter.friendly:
            raise raw.refused(f"{field}.{i}", "a plain number, in SI units: a coefficient takes no unit")
    return [float(parameter.value) for parameter in found]


def make_element(block: Block, field: str, raw: RawCase) -> Nonlinearity:
    """The element of a block.

    Raises
    ------
    CaseError
        If a value is missing, or the element does not take those that are there.
    """
    made_of = element_class(block.kind)
    types = field_types(made_of)
    values: dict[str, Any] = {k: p.value for k, p in block.parameters.items() if k in types}
    for key in (key for key in values if types[key] is Held.COUNT):
        if not (values[key] == round(values[key]) and 0 < values[key] <= LARGEST_COUNT):
            near = round(min(max(values[key], 1.0), LARGEST_COUNT))
            raise raw.refused(f"{field}.{key}", f"a whole number from 1 to {LARGEST_COUNT}, such as {near}")
        values[key] = round(values[key])
    lacking = needed(made_of, next((len(v) for v in block.lists.values()), 2), {**values, **block.others})
    if lacking:
        raise without(made_of, {**values, **block.others}, lacking, field, block.kind, raw)
    try:
        with np.errstate(all="ignore"):  # what overflows is refused as not finite
            made = made_of(**values, **block.others)
        require_ordinary(made)
        if made.remembers_a_list:
            made.start(made.automaton(), block.memory)
    except ModelError as error:
        raise raw.refused_by_model(error, field) from None
    if block.memory is not None and not made.remembers:
        raise raw.refused(f"{field}.memory", f"none, as {block.kind} remembers nothing")
    return made


def without(
    made: Callable[..., object],
    values: Mapping[str, Any],
    lacking: Mapping[str, Callable[[float], Any]],
    field: str,
    kind: str,
    raw: RawCase,
) -> CaseError:
    """The error that fields of a part are missing, and beside it what the part refuses whatever these were.

    Parameters
    ----------
    made : callable
        Makes the part of its values.
    values : mapping of str to object
        Those that are there.
    lacking : mapping of str to callable
        A value for each that is missing, made of a number.
    field, kind : str
        Where the part is in the file, and what it is.
    """
    first, *others = (
        raw.refused(f"{field}.{key}", f"a value: {kind} needs it{_or_sizes(kind, key)}") for key in lacking
    )
    found: list[ModelError] = []
    for number in _TRIALS:
        try:
            with np.errstate(all="ignore"):
                made(**values, **{key: stand_in(number) for key, stand_in in lacking.items()})
        except ModelError as error:
            # A refusal of such a value, or of one beside it, says nothing of the values that are there.
            if error.field in values and (error.beside is None or error.beside[0] not in lacking):
                found.append(error)
        else:
            found = []
            break
    if len({str(error) for error in found}) == 1:
        others.append(raw.refused_by_model(found[0], field))
    return CaseError(first.source, first.field, first.value, first.expected, first.fault, tuple(others))


def _or_sizes(kind: str, key: str) -> str:
    """What a file may give in place of a field."""
    made = ELEMENTS.get(kind)
    estimate = None if made is None else made.estimate
    return f", or {' and '.join(estimate.sizes)}" if estimate is not None and estimate.field == key else ""


def needed(
    made: type[Nonlinearity | LinearBlock], length: int = 2, given: Container[str] = ()
) -> dict[str, Callable[[float], Any]]:
    """Values for the fields that a part needs and that are not given: made of a number, lists as long."""
    forms = declared_fields(made) if issubclass(made, LinearBlock) else field_types(made)
    # A class has a hash though its instances have none.
    lacking = [key for key in _without_default(made) if key not in given]  # type: ignore[arg-type]
    return {key: partial(_stand_in, forms[key], length, i + 1) for i, key in enumerate(lacking)}


@cache
def _without_default(made: type) -> tuple[str, ...]:
    """Fields that a part cannot be made without."""
    return tuple(k for k, p in inspect.signature(made).parameters.items() if p.default is inspect.Parameter.empty)


def _stand_in(what: Declared | Held, length: int, nth: int, number: float) -> Any:
    """A value for the nth missing field: other numbers than those before."""
    match what if isinstance(what, Held) else what.form:
        case Held.NUMBER | Form.QUANTITY:
            return nth * number
        case Held.COUNT:
            return round(abs(number)) + nth
        case Held.LIST:
            return [number * i for i in range(length)]
        case Form.NUMBERS | Form.ROOTS:
            return (number,) * (1 + _TRIALS.index(number))  # of several orders, which other fields hang on
    return "?"  # refused itself, as the shape of a matrix is that of others


def left_out(kind: str, field: str) -> float | None:
    """The number that a field of a part of a kind has where it is left out; None where there is none.

    Examples
    --------
    >>> left_out("gain", "gain"), left_out("pi", "kp"), left_out("gain", "sample_time")
    (1.0, None, None)
    """
    number = getattr(BLOCKS.get(kind) or ELEMENTS.get(kind), field, None)
    return number if isinstance(number, float) else None


def example(kind: str) -> tuple[dict[str, Any], Nonlinearity | LinearBlock] | None:
    """Fields that make a part of a kind, and the part; None where none is known."""
    made: type[Nonlinearity | LinearBlock] | None = BLOCKS.get(kind) or ELEMENTS.get(kind)
    if made is None:
        return None
    for number in _TRIALS:
        fields = {key: stand_in(number) for key, stand_in in needed(made).items()}
        with suppress(EppError):
            return fields, made(**fields)
    return None
