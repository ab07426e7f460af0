"""Wires of a diagram: ports by name, signed sums of them, and who drives what.

A connection is read aloud as it is written: ``setpoint - encoder -> controller`` or ``gear.torque -> motor.torque,
load.torque``. A part with one input or one output is called by its name alone.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Protocol

import numpy as np

from eppanalysis.arrays import Array
from eppanalysis.errors import DrivenTwice, ModelError, OpenInput, UnknownName, did_you_mean
from eppanalysis.models.diagrams.blocks import Block
from eppanalysis.models.elements.base import Nonlinearity
from eppanalysis.models.systems.own_states import ports as port_counts

#: A part and one of its ports; an external input is a part without ports.
Port = tuple[str, str]

_NAME = r"[A-Za-z_][A-Za-z0-9_]*"
_TERM = re.compile(rf"\s*([+-]?)\s*({_NAME}(?:\.{_NAME})?)\s*")
_PORT = re.compile(rf"{_NAME}(?:\.{_NAME})?")
#: What parts and external inputs may be called, so that connections can name them.
NAME = re.compile(_NAME)
#: Allowed in place of a sum: an input that is left at zero on purpose.
NOTHING = "0"


def written(port: Port) -> str:
    """A port as people write it."""
    return ".".join(port) if port[1] else port[0]


@dataclass(frozen=True)
class Ports:
    """All ports of a diagram."""

    #: inputs, outputs: names of the ports of each part.
    inputs: Mapping[str, tuple[str, ...]]
    outputs: Mapping[str, tuple[str, ...]]
    external: tuple[str, ...]  # names of the external inputs
    who: str  # what messages call the diagram

    @cached_property
    def sources(self) -> tuple[Port, ...]:
        """What drives: outputs of the parts, then external inputs."""
        return (*_all(self.outputs), *((name, "") for name in self.external))

    @cached_property
    def targets(self) -> tuple[Port, ...]:
        """What is driven: inputs of the parts."""
        return _all(self.inputs)

    def source(self, text: str, field: str) -> Port:
        """The output, or the external input, that a name means."""
        return (text, "") if text in self.external else self._port(text, self.outputs, "output", field)

    def target(self, text: str, field: str) -> Port:
        """The input that a name means."""
        return self._port(text, self.inputs, "input", field)

    def either(self, text: str, field: str) -> Port:
        """The output or input that a name means; of a bare name the output."""
        part, _, port = text.partition(".")
        if port and port in self.inputs.get(part, ()):
            return part, port
        return self.source(text, field)

    def terms(self, text: str, field: str) -> list[tuple[float, Port]]:
        """The signed sum of sources that a text means.

        Raises
        ------
        ModelError
            If it is none, or a port is not known.
        """
        if text.strip() == NOTHING:
            return []
        found: list[tuple[float, Port]] = []
        at = 0
        while match := _TERM.match(text, at):
            if found and not match[1]:
                break
            found.append((-1.0 if match[1] == "-" else 1.0, self.source(match[2], field)))
            at = match.end()
        if not found or at < len(text):
            factor = ", and a block of kind gain for a factor" * ("*" in text)
            raise ModelError(self.who, text, f"a signed sum of ports such as 'setpoint - sensor'{factor}", field=field)
        return found

    def _port(self, text: str, ports: Mapping[str, tuple[str, ...]], what: str, field: str) -> Port:
        part, _, port = text.partition(".")
        if part not in ports:
            known = [*ports, *(self.external if what == "output" else ())]
            expected = f"a part of the diagram in place of {part!r}: {did_you_mean(part, known)}"
            raise ModelError(self.who, text, expected, field=field, fault=UnknownName(part))
        of_part = ports[part]
        if port in of_part:
            return part, port
        if not port and len(of_part) == 1:
            return part, of_part[0]
        known = [f"{part}.{name}" for name in of_part]
        other = self.inputs if what == "output" else self.outputs
        if port and port in other[part]:
            hint = f"{text} is an {'input' if what == 'output' else 'output'}; {part} has {', '.join(known) or 'none'}"
            expected = f"an {what} of {part}: {hint}"
            raise ModelError(self.who, text, expected, field=field, fault=UnknownName(text))
        hint = did_you_mean(text, known) if port and known else f"one of {', '.join(known)}" if known else "it has none"
        raise ModelError(self.who, text, f"an {what} of {part}: {hint}", field=field, fault=UnknownName(text))


def port_names(part: Block | Nonlinearity) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Names of a part's inputs and outputs."""
    if isinstance(part, Block):
        return part.inputs, part.outputs
    before, behind = port_counts(part)
    return _named(part.input_ports, before, "in"), _named(part.output_ports, behind, "out")


def _named(names: tuple[str, ...], count: int, default: str) -> tuple[str, ...]:
    if len(names) == count:
        return names
    return (default,) if count == 1 else tuple(f"{default}{i + 1}" for i in range(count))


def plain_name(name: str) -> str:
    """A name that connections can have, as near as may be to one that they cannot.

    Examples
    --------
    >>> plain_name("my-motor"), plain_name("Motor/Speed ref"), plain_name("2nd")
    ('my_motor', 'Motor_Speed_ref', 'part_2nd')
    """
    plain = re.sub("[^A-Za-z0-9]+", "_", name).strip("_")
    return plain if NAME.fullmatch(plain) else f"part_{plain}".rstrip("_")


def free_name(name: str, taken: Iterable[str]) -> str:
    """The name, with a number behind it where it is taken."""
    taken, free, i = set(taken), name, 1
    while free in taken:
        i += 1
        free = f"{name}_{i}"
    return free


class Drawn(Protocol):
    """What the closing of a diagram needs of it; the diagram itself is in a higher layer."""

    @property
    def parts(self) -> Mapping[str, Any]:
        """Blocks and elements by their names."""

    @property
    def signals(self) -> Mapping[str, str]:
        """Named signals beside those of all ports."""

    @property
    def units(self) -> Mapping[str, str]:
        """Units of the signals."""

    @property
    def memory(self) -> Mapping[str, Any]:
        """What elements remember at the start."""

    @property
    def name(self) -> str:
        """What messages call it."""

    @property
    def principal(self) -> str | None:
        """Element at which pictures cut the loop."""

    @property
    def ports_as_signals(self) -> bool:
        """Whether all ports are signals."""

    @property
    def ports(self) -> Ports:
        """Names of all ports."""

    @property
    def levels(self) -> dict[str, float]:
        """External inputs and where they are before the start [SI]."""

    @property
    def cuts(self) -> tuple[str, ...]:
        """Ports at which margins are requested."""

    @property
    def controllers(self) -> tuple[str, ...]:
        """Ports at which they are taken where nothing is said."""


def _all(ports: Mapping[str, tuple[str, ...]]) -> tuple[Port, ...]:
    return tuple((part, name) for part, names in ports.items() for name in names)


def driven(ports: Ports, connect: Sequence[str]) -> dict[Port, list[tuple[float, Port]]]:
    """The signed sum of sources that drives each input.

    Raises
    ------
    ModelError
        If a connection cannot be read, a port is not known, or an input is driven twice or left open.
    """
    found: dict[Port, list[tuple[float, Port]]] = {}
    where: dict[Port, str] = {}
    for i, text in enumerate(connect):
        field = f"connect.{i}"
        left, arrow, right = text.partition("->")
        if not arrow or not right.strip() or "->" in right:
            raise ModelError(ports.who, text, "a connection such as 'controller -> motor.voltage'", field=field)
        terms = ports.terms(left, field)
        for name in right.split(","):
            if not _PORT.fullmatch(name.strip()):
                raise ModelError(ports.who, text, "names of inputs behind the arrow, with commas between", field=field)
            port = ports.target(name.strip(), field)
            if port in found:
                twice = (
                    f"one connection that drives {written(port)}; {where[port]!r} does already: add the two in one sum"
                )
                raise ModelError(ports.who, text, twice, field=field, fault=DrivenTwice(name.strip()))
            found[port], where[port] = terms, text
    for port in ports.targets:
        if port not in found:
            name = written(port)
            raise ModelError(
                f"{ports.who}: nothing drives {name}",
                expected=f"a connection to {name}, '{NOTHING} -> {name}' where it is to stay at zero",
                field="connect",
                fault=OpenInput(name),
            )
    return found


def incidence(
    wires: Mapping[Port, list[tuple[float, Port]]], targets: Iterable[Port], sources: Sequence[Port]
) -> Array:
    """How sources (columns) drive targets (rows)."""
    place = {port: i for i, port in enumerate(sources)}
    rows = list(targets)
    out = np.zeros((len(rows), len(place)))
    for i, port in enumerate(rows):
        for sign, source in wires[port]:
            if source in place:
                out[i, place[source]] += sign
    return out
