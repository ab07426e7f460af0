"""Whether the units of a diagram go together: along its wires, and through its parts.

Each number that has a unit says how the unit of one signal follows from that of another: a gain in V/rad makes volts of
radians, whatever is before it. What is given without a unit is taken to fit, and radians may be left out.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from eppanalysis.cases.values.expressions import Unit, alike, is_expression, name_of_unit, parse, times
from eppanalysis.cases.values.quantities import Parameter, plain_value
from eppanalysis.errors import CaseError
from eppanalysis.models.diagrams import Block, Diagram
from eppanalysis.models.diagrams.closing import signals_of_ports
from eppanalysis.models.diagrams.wiring import Port, port_names, written
from eppanalysis.models.elements.base import RATIO, Role
from eppanalysis.units import KINDS, QuantityError, dimensions, parse_any

if TYPE_CHECKING:
    from eppanalysis.cases.files import RawCase

#: A plain number, beside which the unit of a signal is known.
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

    def shown(self, port: Port) -> Unit | None:
        """The unit of a signal as axes and tables have it, where that is known.

        Radians count in an angle and its rates alone, and once: what else holds some has them from a factor between.
        """
        if (unit := self.of(port)) is None:
            return None
        others = {name for name, power in unit.items() if power} - {"radian"}
        turns = unit.get("radian", 0) > 0 and others <= {"second"}
        return {**unit, "radian": int(turns)}


@dataclass(frozen=True)
class UnitsOfDiagram:
    """Units in a diagram, as far as they are known."""

    signals: dict[str, str]  # those that the file gives, and of ports those that follow from them and from the parts
    fields: dict[str, str]  # of fields whose part has known signals ("controller.kp"), radians included


def units_along_wires(
    diagram: Diagram, units: Mapping[str, str], fields: Mapping[str, Mapping[str, Parameter]], raw: RawCase
) -> UnitsOfDiagram:
    """The units of signals and fields; what does not go together is refused.

    Parameters
    ----------
    units : mapping of str to str
        Units that the file gives to external inputs and named signals.
    fields : mapping of str to mapping of str to Parameter
        Numbers of the file's blocks ("blocks.controller") and elements that have a unit, by their fields.

    Raises
    ------
    CaseError
        If connections, inputs, signals or fields contradict one another: the one without which least is contradicted.
    """
    claims = [
        *_by_nature(diagram, fields, raw),
        *_of_connections(diagram, raw),
        *(claim for place, typed in fields.items() for claim in _of_part(diagram, place, typed, raw)),
        *(claim for name, part in diagram.parts.items() for claim in _of_start(name, part, raw)),
        *_given(diagram, units, raw),
    ]
    signals, contradictions = _joined(claims)
    if contradictions:
        raise _blamed(claims, contradictions[0], raw)
    of_ports = {name: name_of_unit(signals.shown(port) or {}) for name, port in signals_of_ports(diagram).items()}
    given = {name: unit for name, unit in units.items() if unit}
    of_fields = (found for place, typed in fields.items() for found in _fields_of(diagram, place, typed, signals))
    return UnitsOfDiagram(of_ports | given, dict(of_fields))


def _fields_of(
    diagram: Diagram, place: str, typed: Mapping[str, Parameter], signals: _Signals
) -> Iterator[tuple[str, str]]:
    """Fields of a part and the units that its signals give them."""
    name = place.partition(".")[2]
    part = diagram.parts[name]
    before, behind = port_names(part)
    for field, (of_source, of_target, of_time), _ in _roles(part.units, typed):
        unit: Unit = {"second": of_time}
        known = True
        for power, ports in ((of_source, before), (of_target, behind)):
            if power:
                shown = signals.shown((name, ports[0])) if ports else {}
                known &= shown is not None
                unit = times(unit, shown or {}, power)
        if known:
            yield f"{name}.{field}", name_of_unit(unit)


@dataclass(frozen=True, eq=False)
class _Claim:
    """What is said of the unit of a signal: that of another one times `unit`."""

    port: Port
    other: Port
    unit: Unit
    #: The refusal, of what else is known and of the unit that the field should have.
    refused: Callable[[_Signals, Unit], CaseError]
    #: The field of the file that says it, or the parameters which that is computed from; empty for what is drawn.
    source: tuple[str, ...] = ()
    of_field: Callable[[Unit], Unit] = dict  # the unit of the field, of what that makes of the signals


def _joined(claims: Iterable[_Claim]) -> tuple[_Signals, list[_Claim]]:
    """What claims say of signals, and those that contradict the ones before them."""
    signals = _Signals()
    return signals, [claim for claim in claims if signals.join(claim.port, claim.other, claim.unit) is not None]


def _blamed(claims: Sequence[_Claim], first: _Claim, raw: RawCase) -> CaseError:
    """The refusal of the number without which least is contradicted.

    A contradiction goes round in a circle of the drawing, and shows at its last number, wherever the mistake is. Of
    several numbers it is one that was set beside the file, then one that should have a usual unit, then a simpler one.
    """
    if not first.source:
        signals, _ = _joined(claims[: claims.index(first)])
        return first.refused(signals, signals.join(first.port, first.other, first.unit) or {})
    found: list[tuple[tuple[int, bool, bool, int], CaseError]] = []
    for source in dict.fromkeys(claim.source for claim in claims if claim.source):
        signals, left = _joined(claim for claim in claims if claim.source != source)
        for claim in (claim for claim in claims if claim.source == source):
            known = signals.join(claim.port, claim.other, claim.unit)
            if known is not None:
                wanted, present = (name_of_unit(claim.of_field(unit)) for unit in (known, claim.unit))
                rank = len(left), _in_file(source, raw), wanted not in KINDS, len(wanted) - len(present)
                found.append((rank, claim.refused(signals, claim.of_field(known))))
                break
    return min(found, key=lambda one: one[0])[1]


def _in_file(source: Iterable[str], raw: RawCase) -> bool:
    """Whether a field, or all parameters that it is computed from, are in the file as they are."""
    own = raw.origin("title")
    return all(own == raw.origin(name if "." in name else f"parameters.{name}") for name in source)


def _by_nature(diagram: Diagram, fields: Mapping[str, Mapping[str, Parameter]], raw: RawCase) -> Iterator[_Claim]:
    """Units that parts have by what they are: those of machines, and of what is what comes in, or a rate of that."""

    def never(signals: _Signals, known: Unit) -> CaseError:
        return raw.refused("connect", "signals of one unit")

    for name, part in diagram.parts.items():
        before, behind = port_names(part)
        if part.same_unit:
            for source, target in zip(before, behind, strict=True):
                yield _Claim((name, target), (name, source), {}, never)
        section = "blocks" if isinstance(part, Block) else "elements"
        if isinstance(part, Block) and fields.get(f"blocks.{name}"):
            for port, unit in part.port_units.items():
                yield _Claim((name, port), _ONE, dimensions(unit), never)
        # A gain that is left out makes no other unit of what comes in; one that is given as a plain number may.
        table = raw.data.get(section, {}).get(name, {})
        for field, (of_source, of_target, of_time) in part.units.items():
            left_out = field not in table and getattr(type(part), field, None) == 1.0
            if left_out and (of_source, of_target) == (-1, 1):
                yield _Claim((name, behind[0]), (name, before[0]), {"second": -of_time}, never)


def _of_connections(diagram: Diagram, raw: RawCase) -> Iterator[_Claim]:
    """What adds up, and what it drives, has one unit."""
    for i, text in enumerate(diagram.connect):
        left, _, right = text.partition("->")
        field = f"connect.{i}"
        ports = [diagram.ports.target(name.strip(), field) for name in right.split(",")]
        for port in (*ports[1:], *(source for _, source in diagram.ports.terms(left, field))):
            yield _Claim(port, ports[0], {}, partial(_not_one, raw, field, port, ports[0]))


def _not_one(raw: RawCase, field: str, port: Port, target: Port, signals: _Signals, known: Unit) -> CaseError:
    return raw.refused(field, f"signals of one unit: {signals.said(port)}, {signals.said(target)}")


def _given(diagram: Diagram, units: Mapping[str, str], raw: RawCase) -> Iterator[_Claim]:
    """External inputs and named signals have the units of what they drive, and of what they are made of."""
    for name, unit in units.items():
        try:
            exponents = dimensions(unit)
        except QuantityError:
            continue  # a signal may be counted in any word
        external = name in diagram.levels
        if not external and unit and not exponents:  # what has radians would pass for a plain number
            raise raw.refused(f"signals.{name}.unit", "no unit of a plain number")
        place = f"inputs.{name}" if external else f"signals.{name}.unit"
        for port in [(name, "")] if external else [port for _, port in diagram.named[name]]:
            if unit:
                yield _Claim(port, _ONE, exponents, partial(_not_as_drawn, raw, place, port), (place,))


def _not_as_drawn(raw: RawCase, place: str, port: Port, signals: _Signals, known: Unit) -> CaseError:
    return raw.refused(place, f"the unit that it has in the diagram: {signals.said(port)}")


def _of_part(diagram: Diagram, place: str, typed: Mapping[str, Parameter], raw: RawCase) -> Iterator[_Claim]:
    """The numbers of a part have the units that make its outputs of its inputs."""
    section, name = place.split(".")
    part = diagram.parts[name]
    before, behind = port_names(part)
    for field, role, parameter in _roles(part.units, typed):
        where = f"{place}.{field}"
        exponents, time = dimensions(parameter.unit), {"second": role[2]}
        if section == "blocks" and parameter.unit == "Hz" and role != RATIO:
            raise _refused(where, f"a rate in 1/s or rad/s at {name}, as Hz counts turns", parameter, raw)
        if role[:2] == RATIO[:2] and not alike(exponents, time):
            raise _refused(where, _wanted(time, role, name), parameter, raw)
        found = _related((name, before[0]) if before else _ONE, (name, behind[0]), role, times(exponents, time, -1))
        if found is None:
            continue
        port, other, unit, power = found
        text = plain_value(raw.typed(where))
        names = parse(str(text)).names if is_expression(text) else ()
        refused = partial(_not_to_go, raw, where, role, parameter)
        yield _Claim(port, other, unit, refused, names or (where,), partial(_field_unit, power, time))


def _not_to_go(
    raw: RawCase, where: str, role: Role, parameter: Parameter, signals: _Signals, wanted: Unit
) -> CaseError:
    return _refused(where, _wanted(wanted, role, where.split(".")[1]), parameter, raw)


def _field_unit(power: int, time: Unit, known: Unit) -> Unit:
    """The unit of a field from that of the signals which it ties together."""
    return times(times({}, known, power), time)


def _of_start(name: str, part: Any, raw: RawCase) -> Iterator[_Claim]:
    """A state that is an output, as the angle of an inertia is, starts at a value in the unit of that."""
    if not isinstance(part, Block) or part.start is None:
        return
    system, given = part.state_space(), raw.typed(f"blocks.{name}.start")
    for port, C, D in zip(part.outputs, np.asarray(system.C), np.asarray(system.D), strict=True):
        state = int(np.argmax(C)) if C.size else 0
        if np.any(D) or not C.size or not np.array_equal(C, np.eye(C.size)[state]) or len(given) <= state:
            continue
        try:
            unit = dimensions(parse_any(given[state])[1])
        except QuantityError:
            continue  # an expression
        if unit:
            place = f"blocks.{name}.start.{state}"
            yield _Claim((name, port), _ONE, unit, partial(_not_as_drawn, raw, place, (name, port)), (place,))


def _refused(field: str, wanted: str, found: Parameter, raw: RawCase) -> CaseError:
    """The refusal of a number, with the unit of an expression."""
    text = plain_value(raw.typed(field))
    if is_expression(text):
        wanted = f"{wanted}: {text} is in {found.unit or 'plain numbers'}"
    return CaseError(raw.origin(field), field, text, wanted)


def _roles(units: Mapping[str, Role], typed: Mapping[str, Parameter]) -> Iterator[tuple[str, Role, Parameter]]:
    for field, parameter in typed.items():
        role = units.get(field)
        if role is not None:
            yield field, role, parameter


def _related(source: Port, target: Port, role: Role, unit: Unit) -> tuple[Port, Port, Unit, int] | None:
    """Which two signals a field of this unit ties together, by which one, and to what power that is in the field's."""
    match role[:2]:
        case (-1, 1):
            return target, source, unit, 1
        case (1 | -1 as power, 0):
            return source, _ONE, times({}, unit, power), power
        case (0, 1):
            return target, _ONE, unit, 1
    return None


def _wanted(unit: Unit, role: Role, part: str) -> str:
    """What is expected of a field, in words."""
    if role == RATIO:
        return "a plain number or a percentage"
    name = name_of_unit(unit)
    kind, example = KINDS.get(name, (f"a quantity in {name}", f"1 {name}"))
    return f"{kind} such as {example!r}, to go with the signals before and behind {part}"
