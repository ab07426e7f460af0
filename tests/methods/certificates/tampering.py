"""Edits of a document: every name struck, added, twice; every value of another kind, and of another size."""

from __future__ import annotations

import copy
import json
from collections.abc import Iterator
from fractions import Fraction
from typing import Any

Path = tuple[Any, ...]
Edit = tuple[str, Any]
#: Of a list, how many of its entries are edited at either end.
_ENDS = 1
#: Names that mean something elsewhere, or nothing, put where they are not known.
STRANGERS = {"gap": "1", "slope": "2", "bias": "1/2", "hold": "1", "sample_time": "1/10", "gravity": "9", "name": "x"}


def part_of(document: Any, path: Path) -> Any:
    for step in path:
        document = document[step]
    return document


def places(part: Any, path: Path = ()) -> Iterator[Path]:
    """Every place of a document; of long lists the first and the last entries."""
    yield path
    if isinstance(part, dict):
        for name in part:
            yield from places(part[name], (*path, name))
    elif isinstance(part, list):
        for i in sorted({*range(min(_ENDS, len(part))), *range(max(0, len(part) - _ENDS), len(part))}):
            yield from places(part[i], (*path, i))


def changed(document: Any, path: Path, value: Any) -> Any:
    """A copy with another value in a place."""
    out = copy.deepcopy(document)
    if not path:
        return value
    part_of(out, path[:-1])[path[-1]] = value
    return out


def without(document: Any, path: Path) -> Any:
    out = copy.deepcopy(document)
    del part_of(out, path[:-1])[path[-1]]
    return out


def another_form(document: Any) -> Iterator[Edit]:
    """Names struck and added, and values of another kind: all of these are to be refused, whatever they say."""
    for path in places(document):
        part, label = part_of(document, path), ".".join(map(str, path)) or "document"
        if isinstance(part, dict):
            for name, value in STRANGERS.items():
                if name not in part:
                    yield f"{label} with {name}", changed(document, path, {**part, name: value})
        if path in ((), ("digest",)):
            continue
        if isinstance(path[-1], str):
            yield f"{label} struck", without(document, path)
        for other in _of_another_kind(part):
            if other is not None or not _may_be_null(path):
                yield f"{label} = {other!r}", changed(document, path, other)


def _of_another_kind(part: Any) -> Iterator[Any]:
    """Values that are not of the kind of a value, or are written as none should be."""
    written = ["2.0", " 1", "1e5", "\uff12", "0x10", "nan", "1_0", "+1", "2/4", "-0", "01"]
    for other in (None, [], {}, 0.5, True, 7, [part], *written):
        if type(other) is not type(part) or (other in written and isinstance(part, str) and _is_number(part)):
            yield other
    if isinstance(part, str) and _is_number(part):
        yield from (float(Fraction(part)), f"{part} ", f"{part}/1")
    elif type(part) is int:
        yield from (float(part), str(part))
    elif type(part) is bool:
        yield int(part)


def another_size(document: Any) -> Iterator[Edit]:
    """Values of their kind, but others: what is not refused of these has to be true."""
    for path in places(document):
        part, label = part_of(document, path), ".".join(map(str, path))
        for value in [*_others(part), *[None] * _may_be_null(path)]:
            if path and path not in (("digest",), ("statement",)) and (type(value), value) != (type(part), part):
                yield f"{label} = {str(value)[:60]}", changed(document, path, value)


def _others(part: Any) -> list[Any]:
    if type(part) is bool:
        return [not part]
    if type(part) is int:
        return [part + 1, part - 1, 0, 10**30]
    if isinstance(part, str) and _is_number(part):
        x = Fraction(part)
        near = x * Fraction(10**6 + 1, 10**6)
        return [str(y) for y in dict.fromkeys((Fraction(0), -x, 2 * x, x / 2, near, x + 1)) if y != x]
    if isinstance(part, str):
        return ["", part[:-1], part + ".", part.replace("r", "."), part.replace(".", "?", 1)]
    if isinstance(part, list) and part:
        return [part[1:], part[:-1], [*part, part[-1]], part[::-1], part * 2]
    return []


def _may_be_null(path: Path) -> bool:
    return path[-1:] == ("time_step",) or path[-2:-1] == ("sector",)


def _is_number(text: str) -> bool:
    try:
        Fraction(text)
    except (ValueError, ZeroDivisionError):
        return False
    return True


def twice(document: Any) -> Iterator[tuple[str, str]]:
    """Texts in which a name stands twice: the first time with another value, the second with its own."""
    for path in places(document):
        part = part_of(document, path)
        if isinstance(part, dict) and part:
            for name in part:
                marked = changed(document, path, {"\x00": None, **part})
                text = json.dumps(marked).replace('"\\u0000": null', f"{json.dumps(name)}: 1")
                yield ".".join(map(str, (*path, name))), text
