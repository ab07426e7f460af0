"""Named parameters of a case file, and fields that hold an expression of them: "Kp = 40 V/rad", "Ki = Kp/Ti"."""

from __future__ import annotations

import keyword
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from graphlib import CycleError, TopologicalSorter
from typing import Any, NamedTuple

from pydantic_core import PydanticCustomError

from eppanalysis.cases.files import RawCase
from eppanalysis.cases.values.expressions import (
    FUNCTIONS,
    Expression,
    Value,
    alike,
    is_expression,
    name_of_unit,
    parse,
    unknown_name,
)
from eppanalysis.cases.values.quantities import AnyQuantity, Parameter, Quantity, place_of, plain_value
from eppanalysis.errors import CaseError
from eppanalysis.readable import written
from eppanalysis.units import QuantityError, dimensions, format_si, parse_quantity

_NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_]{0,59}")


class Named(NamedTuple):
    """A number of a case file: as parameters are shown, and as expressions take it."""

    parameter: Parameter
    value: Value


def read(
    given: Any,
    place: str,
    raw: RawCase,
    parameters: Mapping[str, Named],
    kind: Quantity | AnyQuantity = AnyQuantity(),  # noqa: B008
) -> Named:
    """The number in a field: a quantity, an expression, or a table of value, mark and note that holds one.

    Parameters
    ----------
    given : object
        What the file holds there.
    place : str
        Dotted name of the field.
    parameters : mapping of str to Named
        What expressions may use.
    kind : Quantity or AnyQuantity
        Unit and range that the number must have; an expression's unit may differ in radians or be a plain number.

    Raises
    ------
    CaseError
        If it is no such number.
    """
    table = dict(given) if isinstance(given, Mapping) else {"value": given}
    text = plain_value(given)
    try:
        if is_expression(text):
            return _computed(parse(text), table, parameters, kind)
        parameter = kind.read(given)
    except QuantityError as error:
        raise CaseError(raw.origin(place), place, text, error.expected, error.fault) from None
    except PydanticCustomError as error:
        context = error.context or {}
        field = place_of(place, error)
        raise CaseError(raw.origin(field), field, context.get("shown", given), context.get("expected", "")) from None
    return Named(parameter, Value(float(parameter.value), dimensions(parameter.unit)))


def _computed(
    expression: Expression, table: Mapping[str, Any], parameters: Mapping[str, Named], kind: Quantity | AnyQuantity
) -> Named:
    if table.get("tolerance") is not None:
        raise QuantityError("no tolerance beside an expression, which has those of its parameters")
    value = expression.value({name: named.value for name, named in parameters.items()})
    unit = (
        parameters[expression.names[0]].parameter.unit
        if (expression.text,) == expression.names
        else name_of_unit(value.unit)
    )
    made = AnyQuantity().read({"mark": "derived", **table, "value": value.number})
    if isinstance(kind, AnyQuantity):
        alike_ones = (p for p in (parameters[n].parameter for n in expression.names) if p.unit == unit)
        typed = next((p.friendly for p in alike_ones), written(unit))  # as what it is computed from was typed
        return Named(replace(made, unit=unit, friendly=typed), value)
    turns = unit == "Hz" and dimensions(kind.unit).get("radian")
    if turns or (value.unit and not alike(value.unit, dimensions(kind.unit))):
        try:
            parse_quantity(f"1 {unit}", kind.unit)
        except QuantityError as error:
            raise QuantityError(f"{error.expected}: {expression.text} is in {unit}") from None
    try:
        return Named(kind.read({"mark": "derived", **table, "value": value.number}), value)
    except PydanticCustomError as error:
        found = format_si(value.number, kind.unit, kind.friendly or kind.unit)
        raise QuantityError(f"{(error.context or {}).get('expected')}: {expression.text} is {found}") from None


def read_scalar(value: Any, field: str, raw: RawCase) -> Parameter:
    """A quantity of any dimension in a field; one that has been read already stays as it is.

    Raises
    ------
    CaseError
        If it is no quantity.
    """
    if isinstance(value, Parameter):
        return value
    try:
        return AnyQuantity().read(value)
    except PydanticCustomError as error:
        context, place = error.context or {}, place_of(field, error)
        raise CaseError(
            raw.origin(place), place, context.get("shown", value), context.get("expected", "a number")
        ) from None


def _check_name(name: str) -> None:
    if not _NAME.fullmatch(name) or keyword.iskeyword(name):
        raise QuantityError("a plain name of letters, digits and underscores, which is no word of Python")
    if name in FUNCTIONS or name == "pi":
        raise QuantityError(f"a name that is no function or constant of expressions ({', '.join(FUNCTIONS)}, pi)")


def _circle(feeding: Sequence[str], tables: Sequence[str]) -> list[str]:
    """Parameters that use one another, each the next, from the first of the file; a long circle is cut."""
    using = list(reversed(feeding))
    start = min(range(len(using)), key=lambda i: tables.index(using[i]))
    whole = [*using[start:], *using[: start + 1]]
    return whole if len(whole) < 10 else [*whole[:8], "...", whole[-1]]


def resolve(tables: Mapping[str, Any], place: str, raw: RawCase) -> dict[str, Named]:
    """Named parameters of a file, each a quantity or an expression of others, in any order.

    Parameters
    ----------
    tables : mapping of str to object
        What the file holds of each.
    place : str
        Dotted name of the section.

    Returns
    -------
    dict of str to Named
        In the order of the file; derivatives are by the parameters that are quantities.

    Raises
    ------
    CaseError
        If a name or a value is not valid, or parameters use one another in a circle.

    Examples
    --------
    >>> from pathlib import Path
    >>> from eppanalysis.cases.files import RawCase
    >>> gain = {"value": "40 V/rad", "tolerance": "10 %"}
    >>> given = {"Ki": "Kp/Ti", "Kp": gain, "Ti": "0.4 s"}
    >>> raw = RawCase("servo", "servo.toml", Path(), {"parameters": given})
    >>> found = resolve(given, "parameters", raw)
    >>> Ki, Kp = found["Ki"], found["Kp"]
    >>> print(Ki.parameter, Kp.parameter.tolerance, dict(Ki.value.gradient))
    100 V/rad/s 4.0 {'Kp': 2.5, 'Ti': -250.0}
    """
    used: dict[str, tuple[str, ...]] = {}
    for name, given in tables.items():
        text = plain_value(given)
        try:
            _check_name(name)
            used[name] = parse(text).names if is_expression(text) else ()
            for other in used[name]:
                if other not in tables:
                    raise unknown_name(other, (known for known in tables if known != name))
        except QuantityError as error:
            at = f"{place}.{name}"
            raise CaseError(raw.origin(at), at, text, error.expected, error.fault) from None
    try:
        order = list(TopologicalSorter(used).static_order())
    except CycleError as error:
        said = _circle(error.args[1][1:], list(tables))
        expected = f"an expression that does not lead back to itself: {' uses '.join(said[:2])}"
        expected += "".join(f", which uses {name}" for name in said[2:])
        raise raw.refused(f"{place}.{said[0]}", expected) from None
    found: dict[str, Named] = {}
    for name in order:
        named = read(tables[name], f"{place}.{name}", raw, found)
        # What is given is a variable of its own; what is computed hangs on such ones by its slopes.
        slopes = named.value.gradient if is_expression(plain_value(tables[name])) else {name: 1.0}
        found[name] = named._replace(value=replace(named.value, gradient=slopes))
    return {name: found[name] for name in tables}
