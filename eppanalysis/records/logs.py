"""Recordings of several time bases: ULog of PX4, bags of ROS 2 (rosbag2, MCAP), and MF4 of measurement systems.

A signal is called by its topic (or group) and its field. No code is made of what a file says of its types: ROS messages
are decoded here, by their parsed definitions, and formulas of an MF4 file are not evaluated.
"""

from __future__ import annotations

import logging
import struct
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, redirect_stdout
from io import StringIO
from pathlib import Path
from traceback import walk_tb
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from eppanalysis.errors import CaseError
from eppanalysis.records.columns import Heading
from eppanalysis.records.formats import readable_as
from eppanalysis.records.memory import group
from eppanalysis.records.tables import Group, Groups

#: Formats of ROS's plain types, and longest array of fixed length whose entries are signals.
_PLAIN = {
    "bool": "?", "byte": "B", "char": "b", "octet": "B", "int8": "b", "uint8": "B", "int16": "h", "uint16": "H",
    "int32": "i", "uint32": "I", "int64": "q", "uint64": "Q", "float32": "f", "float64": "d",
}  # fmt: skip
_BASE, _NAME, _ARRAY = 1, 2, 3
_LONGEST, _DEEPEST = 36, 12


def ulog(path: Path, source: str) -> Groups:
    """A ULog file: numbers in SI units, times since the start of the controller; a further instance of a topic has its
    number, as in ``vehicle_imu_1``.

    Raises
    ------
    CaseError
        If it holds no data.
    """
    from pyulog import ULog

    with redirect_stdout(StringIO()), path.open("rb") as stream:  # pyulog prints what it finds damaged
        log = ULog(stream)
    groups = []
    for data in log.data_list:
        fields = {name: values for name, values in data.data.items() if name != "timestamp"}
        topic = f"{data.name}_{data.multi_id}" if data.multi_id else data.name
        times = 1e-6 * data.data["timestamp"].astype(float)
        groups.append(group([Heading(name, text=name) for name in fields], times, list(fields.values()), topic))
    if not groups:
        raise CaseError(source, "", "without data that can be read", "a ULog file with a logged topic")
    damaged = ["The file is damaged: only the part that can be read was used."] if log.file_corruption else []
    return Groups(source, groups, notes=damaged)


def mf4(path: Path, source: str) -> Groups:
    """An MF4 file: one group for each channel group, with the units of its channels."""
    groups = []
    with _measured(path) as file:
        for i, found in enumerate(file.groups):
            places = [
                j for j, channel in enumerate(found.channels) if j != file.masters_db.get(i) and _is_number(channel)
            ]
            own = getattr(found.channel_group, "acq_name", "") or f"group{i}"
            prefix = f"{own}." if len(file.groups) > 1 else ""
            headings = [
                Heading.of(f"{prefix}{c.name}", str(c.unit or getattr(c.conversion, "unit", "") or ""))
                for c in (found.channels[j] for j in places)
            ]
            groups.append(Group(headings, _channels(path, source, i, places)))
    return Groups(source, groups)


@contextmanager
def _quiet(log: logging.Logger) -> Iterator[None]:
    before, log.disabled = log.disabled, True
    try:
        yield
    finally:
        log.disabled = before


@contextmanager
def _measured(path: Path) -> Iterator[Any]:
    from asammdf import MDF

    log = logging.getLogger("asammdf")  # it reports what is damaged to the console
    with path.open("rb") as stream, _quiet(log):
        try:
            opened = MDF(stream)
        except Exception as error:
            # What is half made would close itself later, with a traceback.
            for frame, _ in walk_tb(error.__traceback__):
                half: Any = frame.f_locals.get("self")
                if hasattr(half, "_closed"):
                    half._closed = True
                    if getattr(half, "_tempfile", None) is not None:
                        half._tempfile.close()
            raise
        with opened as file:
            yield file


def _is_number(channel: Any) -> bool:
    return getattr(channel, "data_type", 99) <= 5  # whole numbers and floats, of either order of bytes


def _channels(path: Path, source: str, i: int, channels: Sequence[int]) -> Any:
    """What reads channels of a group of an MF4 file."""

    def read(places: Sequence[int]) -> tuple[ArrayLike, list[ArrayLike]]:
        with readable_as(source, "an MF4 file"), _measured(path) as file:
            for channel in file.groups[i].channels:
                end = channel.byte_offset + (channel.bit_offset + channel.bit_count + 7) // 8
                if end > file.groups[i].channel_group.samples_byte_nr:  # asammdf would read there
                    raise ValueError(f"{channel.name} lies outside of its record")
            found = [file.get(group=i, index=channels[k], raw=True) for k in places]
            times = found[0].timestamps if found else file.get_master(i)
            return times, [_physical(signal, source) for signal in found]

    return read


def _physical(signal: Any, source: str) -> Any:
    conversion = signal.conversion
    if conversion is None:
        return signal.samples
    if conversion.conversion_type == 1:
        return signal.samples * float(conversion.a) + float(conversion.b)
    if conversion.conversion_type == 0:
        return signal.samples
    raise CaseError(
        source, signal.name, "given by a formula or a table", "a channel of numbers, or linear in its numbers"
    )


def bag(path: Path, source: str) -> Groups:
    """A bag of ROS 2, with messages in CDR: numbers in SI units, at the time in a message's header where it has one.

    Raises
    ------
    CaseError
        If its messages are in another form.
    """
    from rosbags.rosbag2 import Reader

    with Reader(path) as reader:
        types = _types(reader.connections)
        known = [c for c in reader.connections if c.msgtype in types]
        topics = [c for c in known if getattr(c.ext, "serialization_format", "") == "cdr"]
        if not topics:
            raise CaseError(source, "", "without topics of ROS messages in CDR", "a bag of ROS 2")
        start = reader.start_time
    groups = []
    for connection in topics:
        fields = list(dict.fromkeys(_numbers(connection.msgtype, types)))
        if fields:
            topic = connection.topic.strip("/")
            headings = [Heading(f"{topic}.{name}", text=f"{topic}.{name}") for name in fields]
            groups.append(Group(headings, _messages(path, source, connection.topic, fields, types, start)))
    return Groups(source, groups)


def _types(connections: Sequence[Any]) -> Mapping[str, Any]:
    """Definitions of all messages: those of the file, else those that come with ROS."""
    from rosbags.interfaces import MessageDefinitionFormat
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    known: dict[str, Any] = dict(get_typestore(Stores.LATEST).fielddefs)
    for connection in connections:
        if connection.msgdef.format == MessageDefinitionFormat.MSG:
            known.update(get_types_from_msg(connection.msgdef.data, connection.msgtype))
    return known


def _numbers(name: str, types: Mapping[str, Any], prefix: str = "", depth: int = 0) -> Iterator[str]:
    """Names of the numbers of a message that each message of its type has."""
    for field, kind in types[name][1] if depth < _DEEPEST else ():
        count = kind[1][1] if kind[0] == _ARRAY else 1
        inner = kind[1][0] if kind[0] == _ARRAY else kind
        for i in range(count) if count <= _LONGEST else ():
            own = f"{prefix}{field}[{i}]" if kind[0] == _ARRAY else f"{prefix}{field}"
            if inner[0] == _BASE and inner[1][0] in _PLAIN:
                yield own
            elif inner[0] == _NAME:
                yield from _numbers(inner[1], types, f"{own}.", depth + 1)


def _messages(path: Path, source: str, topic: str, fields: Sequence[str], types: Mapping[str, Any], start: int) -> Any:
    """What reads fields of the messages of a topic."""

    def read(places: Sequence[int]) -> tuple[ArrayLike, list[ArrayLike]]:
        from rosbags.rosbag2 import Reader

        times, rows, names = [], [], [fields[i] for i in places]
        with readable_as(source, "a bag of ROS 2"), Reader(path) as reader:
            for connection, stamp, data in reader.messages([c for c in reader.connections if c.topic == topic]):
                message: dict[str, float] = {}
                _Decoder(data, types).message(connection.msgtype, message)
                whole, part = (message.get(f"header.stamp.{p}", 0) for p in ("sec", "nanosec"))
                times.append(1e-9 * float((int(whole) * 10**9 + int(part) or stamp) - start))
                rows.append([message[name] for name in names])
        return np.array(times), list(np.array(rows, float).reshape(len(times), len(names)).T)

    return read


class _Decoder:
    """A message in the Common Data Representation, to its numbers by name."""

    def __init__(self, data: bytes | memoryview, types: Mapping[str, Any]) -> None:
        self.order = "<" if data[1] & 1 else ">"
        self.data, self.types, self.at = memoryview(data)[4:], types, 0

    def message(self, name: str, out: dict[str, float] | None, prefix: str = "", depth: int = 0) -> None:
        """Read a message; without `out` it is passed over."""
        if depth > _DEEPEST:
            raise ValueError("messages within messages without end")
        for field, kind in self.types[name][1]:
            self._value(kind, out, f"{prefix}{field}", depth)

    def _value(self, kind: Any, out: dict[str, float] | None, name: str, depth: int) -> None:
        if kind[0] == _NAME:
            self.message(kind[1], out, f"{name}.", depth + 1)
        elif kind[0] == _BASE:
            self._plain(kind[1][0], out, name)
        else:
            inner = kind[1][0]
            count = kind[1][1] if kind[0] == _ARRAY else self._number("I")
            named = out if kind[0] == _ARRAY and count <= _LONGEST else None
            if named is None and inner[0] == _BASE and inner[1][0] in _PLAIN:
                self._skip(_PLAIN[inner[1][0]], count)
                return
            if count > len(self.data):
                raise ValueError("a message that ends early")
            for i in range(count):
                self._value(inner, named, f"{name}[{i}]", depth)

    def _plain(self, kind: str, out: dict[str, float] | None, name: str) -> None:
        if kind in _PLAIN:
            number = self._number(_PLAIN[kind])
            if out is not None:
                out[name] = number
        elif kind == "string":
            self._skip("B", self._number("I"))
        else:
            raise ValueError(f"a field of type {kind}")

    def _number(self, form: str) -> Any:
        size = struct.calcsize(form)
        self.at += -self.at % size
        self.at += size
        return struct.unpack_from(self.order + form, self.data, self.at - size)[0]

    def _skip(self, form: str, count: int) -> None:
        """Pass over numbers."""
        size = struct.calcsize(form)
        if count:
            self.at += -self.at % size + size * count
        if self.at > len(self.data):
            raise ValueError("a message that ends early")
