"""Plain TOML values as text."""

from __future__ import annotations

import json
import re
import tomllib
from collections.abc import Mapping, MutableMapping
from typing import Any

from eppanalysis.cases.values.quantities import Parameter
from eppanalysis.units import write_si

_BARE = re.compile(r"[A-Za-z0-9_-]+")


def write_toml(data: dict[str, Any]) -> str:
    """TOML text of nested tables of texts, numbers, booleans and lists.

    Examples
    --------
    >>> print(write_toml({"title": "a loop", "run": {"t_end": "6 s"}}), end="")
    title = "a loop"
    <BLANKLINE>
    [run]
    t_end = "6 s"
    """
    return "\n".join(_section("", data)).strip("\n") + "\n"


def updated_toml(text: str, data: dict[str, Any]) -> str:
    r"""TOML text with other values in it, whose comments and order stay; where it cannot be, written anew.

    Examples
    --------
    >>> print(updated_toml("gap = 1 # by hand\nti = 2", {"gap": 3, "ti": 2}))
    gap = 3 # by hand
    ti = 2
    """
    import tomlkit  # it takes as long to load as a small case to run

    try:
        document = tomlkit.parse(text.removeprefix("\ufeff"))
        _update(document, data)
        updated = tomlkit.dumps(document)
    except tomlkit.exceptions.TOMLKitError:  # the file is no longer what it was
        return write_toml(data)
    return updated if tomllib.loads(updated) == data else write_toml(data)


def _update(table: MutableMapping[str, Any], data: Mapping[str, Any]) -> None:
    """Make a table of a document hold these values."""
    for key in [key for key in table if key not in data]:
        del table[key]
    for key, value in data.items():
        held = table.get(key)
        if isinstance(value, dict) and isinstance(held, MutableMapping):
            _update(held, value)
        elif key not in table or held != value:
            table[key] = value


def toml_line(key: str, value: Any) -> str:
    """One line of TOML, tables in line.

    Examples
    --------
    >>> print(toml_line("inputs", {"setpoint": "0 rad", "wind": 0.0}))
    inputs = { setpoint = "0 rad", wind = 0.0 }
    """
    return f"{_key(key)} = {toml_value(value)}"


def _section(prefix: str, data: dict[str, Any]) -> list[str]:
    plain = {k: v for k, v in data.items() if not _is_section(v)}
    lines = [f"{_key(k)} = {toml_value(v)}" for k, v in plain.items()]
    if prefix and (lines or not data):
        lines.insert(0, f"[{prefix}]")
    for key, value in data.items():
        if _is_section(value):
            lines += ["", *_section(f"{prefix}.{_key(key)}" if prefix else _key(key), value)]
    return lines


def _is_section(value: Any) -> bool:
    """Whether a table gets a heading of its own; parameters and empty tables are written in line."""
    return isinstance(value, dict) and "value" not in value and bool(value)


def _key(key: str) -> str:
    return key if _BARE.fullmatch(key) else _text(key)


def _text(text: str) -> str:
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")


def toml_value(value: Any) -> str:
    """A value as TOML has it in a line."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return _text(value)
    if isinstance(value, list):
        return f"[{', '.join(toml_value(v) for v in value)}]"
    if isinstance(value, dict):
        inside = ", ".join(f"{_key(k)} = {toml_value(v)}" for k, v in value.items())
        return f"{{ {inside} }}" if inside else "{}"
    return repr(value)


def plain_value(value: Any) -> Any:
    """A value as TOML would give it, with its unit.

    Examples
    --------
    >>> plain_value({"gap": Parameter(0.012, "m", "mm"), "num": (1.0, 2.0)})
    {'gap': {'value': '12 mm', 'mark': 'assumed', 'note': ''}, 'num': [1.0, 2.0]}
    """
    if isinstance(value, Parameter):
        text = value.value if isinstance(value.value, bool) else write_si(value.value, value.unit, value.friendly)
        table = {"value": text, "mark": value.mark, "note": value.note}
        if value.tolerance is not None:
            table["tolerance"] = write_si(value.tolerance, value.unit, value.friendly)
        return table
    if isinstance(value, Mapping):
        return {str(k): plain_value(v) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain_value(v) for v in value]
    if hasattr(value, "tolist"):  # numpy
        return value.tolist()
    return value
