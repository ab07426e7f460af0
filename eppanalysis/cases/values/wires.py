"""Whether the units of a diagram go together: along its wires, and through its parts.

Each number that has a unit says how the unit of one signal follows from that of another: a gain in V/rad makes volts of
radians, whatever is before it. What is given without a unit is taken to fit, and radians may be left out.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING

import numpy as np

from eppanalysis.cases.values.expressions import Unit, alike, is_expression, name_of_unit, times
from eppanalysis.cases.values.quantities import Parameter, plain_value
from eppanalysis.errors import CaseError
from eppanalysis.models.diagrams import Block, Diagram
from eppanalysis.models.diagrams.closing import signals_of_ports
from eppanalysis.models.diagrams.wiring import Port, port_names, written
from eppanalysis.models.elements.base import RATIO, Role
from eppanalysis.units import KINDS, QuantityError, dimensions, is_si, parse_any, unit_of

if TYPE_CHECKING:
    from eppanalysis.cases.files import RawCase

#: Stands for a plain number, beside which the unit of a signal is known.
_ONE: Port = ("", "")


class _Signals:
    """Units of signals as far as they are known: of each beside another one, in trees."""

    def __init__(self) -> None:
        self._above: dict[Port, tuple[Port, Unit]] = {}

    def _top(self, port: Port) -> tuple[Port, Unit]:
        unit: Unit = {}
        while port in self._above:
            port, own = self._above[port]
            unit = times(unit, own)
        return port, unit

    def join(self, port: Port, other: Port, unit: Unit) -> Unit | None:
        """Let a signal have the unit of another one times this; what it has beside that one where it is not this."""
        (top, own), (other_top, others) = self._top(port), self._top(other)
        # In one tree the quotient is known already; else one tree is
        # hung below the other by the quotient that makes it true.
        if top == other_top:
            known = times(own, others, -1)
            return None if alike(known, unit) else known
        self._above[top] = other_top, times(times(unit, others), own, -1)
        return None

    def of(self, port: Port) -> Unit | None:
        """The unit of a signal, where that is known."""
        (top, own), (ground, one) = self._top(port), self._top(_ONE)
        return times(own, one, -1) if top == ground else None

    def said(self, port: Port) -> str:
        """A signal and its unit, where that is known."""
        unit = self.of(port)
        return written(port) if unit is None else f"{written(port)} is in {name_of_unit(unit) or 'a plain number'}"

    def named(self, port: Port) -> str:
        """The unit of a signal as axes and tables have it; empty where it is not known.

        Radians count in an angle and its rates alone, and once: what else holds some has them from a factor between.
        """
        unit = self.of(port) or {}
        others = {name for name, power in unit.items() if power} - {"radian"}
        turns = unit.get("radian", 0) > 0 and others <= {"second"}
        return name_of_unit({**unit, "radian": int(turns)})


def units_along_wires(
    diagram: Diagram, units: Mapping[str, str], fields: Mapping[str, Mapping[str, Parameter]], raw: RawCase
) -> dict[str, str]:
    """The units of all signals, as far as they are known; what does not go together is refused.

    Parameters
    ----------
    diagram : Diagram
    units : mapping of str to str
        Units that the file gives to external inputs and named signals.
    fields : mapping of str to mapping of str to Parameter
        Numbers of the file's blocks ("blocks.controller") and elements that have a unit, by their fields.
    raw : RawCase

    Returns
    -------
    dict of str to str
        Those that the file gives, and of the signals of ports those that follow from them and from the parts.

    Raises
    ------
    CaseError
        At the first connection, input, signal or field that contradicts those before it.
    """
    signals = _Signals()
    for name, part in diagram.parts.items():
        before, behind = port_names(part)
        if part.same_unit:
            for source, target in zip(before, behind, strict=True):
                signals.join((name, target), (name, source), {})
        if isinstance(part, Block) and fields.get(f"blocks.{name}"):
            for port, unit in part.port_units.items():
                signals.join((name, port), _ONE, dimensions(unit))
    # Numbers come last, so that one which contradicts the wires is refused itself.
    _check_connections(diagram, signals, raw)
    _check_given(diagram, units, signals, raw)
    for place, typed in fields.items():
        _check_part(diagram, place, typed, signals, raw)
    for name, part in diagram.parts.items():
        if isinstance(part, Block) and part.start is not None:
            _check_start(name, part, signals, raw)
    of_ports = {name: signals.named(port) for name, port in signals_of_ports(diagram).items()}
    return of_ports | {name: unit for name, unit in units.items() if unit}


def _check_connections(diagram: Diagram, signals: _Signals, raw: RawCase) -> None:
    """What adds up, and what it drives, has one unit."""
    for i, text in enumerate(diagram.connect):
        left, _, right = text.partition("->")
        field = f"connect.{i}"
        ports = [diagram.ports.target(name.strip(), field) for name in right.split(",")]
        for port in (*ports[1:], *(source for _, source in diagram.ports.terms(left, field))):
            if signals.join(port, ports[0], {}) is not None:
                expected = f"signals of one unit: {signals.said(port)}, {signals.said(ports[0])}"
                raise raw.refused(field, expected)


def _check_given(diagram: Diagram, units: Mapping[str, str], signals: _Signals, raw: RawCase) -> None:
    """External inputs and named signals have the units of what they drive, and of what they are made of."""
    for name, unit in units.items():
        try:
            exponents = dimensions(unit)
        except QuantityError:
            continue  # a signal may be counted in any word
        external = name in diagram.levels
        if not external and unit and not is_si(unit):
            own = unit_of(exponents)
            expected = f"the SI unit that its values have, {own!r}; tables and pictures show it in one that people read"
            raise raw.refused(f"signals.{name}.unit", expected if own else "a signal of no unit")
        ports = [(name, "")] if external else [port for _, port in diagram.named[name]]
        for port in ports:
            if unit and signals.join(port, _ONE, exponents) is not None:
                place = f"inputs.{name}" if external else f"signals.{name}.unit"
                raise raw.refused(place, f"the unit that it has in the diagram: {signals.said(port)}")


def _check_part(diagram: Diagram, place: str, typed: Mapping[str, Parameter], signals: _Signals, raw: RawCase) -> None:
    """The numbers of a part have the units that make its outputs of its inputs."""
    section, name = place.split(".")
    part = diagram.parts[name]
    before, behind = port_names(part)
    for field, role, parameter in _roles(part.units, typed):
        exponents = dimensions(parameter.unit)
        if section == "blocks" and parameter.unit == "Hz" and role != RATIO:
            wanted = f"a rate in 1/s or rad/s at {name}, as Hz counts turns"
        else:
            known = _met((name, before[0]) if before else _ONE, (name, behind[0]), role, exponents, signals)
            wanted = "" if known is None else _wanted(known, role, name)
        if wanted:
            raise _refused(f"{place}.{field}", wanted, parameter, raw)


def _check_start(name: str, part: Block, signals: _Signals, raw: RawCase) -> None:
    """A state that is an output, as the angle of an inertia is, starts at a value in the unit of that."""
    system, given = part.state_space(), raw.typed(f"blocks.{name}.start")
    for port, C, D in zip(part.outputs, np.asarray(system.C), np.asarray(system.D), strict=True):
        state = int(np.argmax(C)) if C.size else 0
        if np.any(D) or not C.size or not np.array_equal(C, np.eye(C.size)[state]) or len(given) <= state:
            continue
        try:
            unit = dimensions(parse_any(given[state])[1])
        except QuantityError:
            continue  # an expression
        if unit and signals.join((name, port), _ONE, unit) is not None:
            raise raw.refused(
                f"blocks.{name}.start.{state}", f"the unit that it has in the diagram: {signals.said((name, port))}"
            )


def _refused(field: str, wanted: str, found: Parameter, raw: RawCase) -> CaseError:
    """The refusal of a number: of the parameter in its place where that was set beside the file, else of the field."""
    text = plain_value(raw.typed(field))
    parameter = f"parameters.{text}"
    if text in raw.data.get("parameters", ()) and raw.origin(parameter) != raw.origin(field):
        return CaseError(raw.origin(parameter), str(text), plain_value(raw.typed(parameter)), wanted)
    computed = f": {text} is in {found.unit or 'plain numbers'}" if is_expression(text) else ""
    return CaseError(raw.origin(field), field, text, f"{wanted}{computed}")


def _roles(units: Mapping[str, Role], typed: Mapping[str, Parameter]) -> Iterator[tuple[str, Role, Parameter]]:
    for field, parameter in typed.items():
        role = units.get(field)
        if role is not None:
            yield field, role, parameter


def _met(source: Port, target: Port, role: Role, exponents: Unit, signals: _Signals) -> Unit | None:
    """The unit that a field should have where it has not; None where it may be as it is, or nothing is known."""
    of_source, of_target, of_time = role
    time = {"second": of_time}
    unit = times(exponents, time, -1)
    if (of_source, of_target) == (0, 0):
        return None if alike(unit, {}) else time
    if (of_source, of_target) == (-1, 1):
        known = signals.join(target, source, unit)
    elif of_source in (1, -1) and not of_target:
        known = signals.join(source, _ONE, times({}, unit, of_source))
        known = None if known is None else times({}, known, of_source)
    elif (of_source, of_target) == (0, 1):
        known = signals.join(target, _ONE, unit)
    else:
        return None
    return None if known is None else times(known, time)


def _wanted(unit: Unit, role: Role, part: str) -> str:
    """What is expected of a field, in words."""
    if role == RATIO:
        return "a plain number or a percentage"
    name = name_of_unit(unit)
    kind, example = KINDS.get(name, (f"a quantity in {name}", f"1 {name}"))
    return f"{kind} such as {example!r}, to go with the signals before and behind {part}"
