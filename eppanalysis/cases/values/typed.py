"""In which units people read the signals and times of a case: in those that its file types."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any

from eppanalysis.models.systems.signals import SignalMap
from eppanalysis.readable import Unit
from eppanalysis.units import QuantityError, dimensions, parse_any, parse_quantity, typed_unit

#: Places of units that count for other signals too, the nearest to what moves first.
_SECTIONS = ("signals", "elements", "loop", "parameters", "blocks", "inputs", "run")
#: Fields that hold no quantity, or one that says nothing of how signals are read.
_OTHERS = ("of", "note", "mark", "kind", "tolerance", "name")
#: Rates are read per second of what they are rates of, where the file types none of them.
_RATES = {"rad/s": "rad", "m/s": "m"}


def in_typed_units(signals: SignalMap, data: Mapping[str, Any], time: object) -> SignalMap:
    """The signals of a loop in SI units, read in the units that its file types.

    A signal is read in its own unit, else in the first of its dimension that the file types, else in what is usual.

    Parameters
    ----------
    data : mapping
        The tables of the file.
    time : object
        How the length of the run is typed; times are read in its unit.
    """
    known: dict[tuple[tuple[str, int], ...], str] = {}
    for unit in _typed(data):
        known.setdefault(_key(unit), unit)
    own = data.get("signals") or (data.get("loop") or {}).get("signals") or {}
    late = typed_unit(time)
    units = []
    for name, unit in zip(signals.names, signals.units or ("",) * len(signals.names), strict=True):
        row = own.get(name)
        typed = row.get("unit", "") if isinstance(row, Mapping) else ""
        units.append(_shown(unit, typed or _usual(unit, known)))
    return replace(signals, units=tuple(units), time=read_in("s", late) if late not in ("", "s") else "s")


def read_in(si: str, shown: str) -> str:
    """An SI unit that is read in another one.

    Examples
    --------
    >>> unit = read_in("m", "mm")
    >>> unit, unit.shown, unit.factor
    ('m', 'mm', 1000.0)
    """
    return Unit(si, shown, 1.0 / parse_quantity(f"1 {shown}", si))


def _shown(unit: str, typed: str) -> str:
    """A signal's unit, read as typed; a word that is no unit stays one."""
    if not typed:
        return unit
    try:
        return read_in(parse_any(f"1 {typed}")[1], typed)
    except QuantityError:
        return unit


def _usual(unit: str, known: Mapping[tuple[tuple[str, int], ...], str]) -> str:
    """The unit that the file types for others of this dimension; empty for none."""
    try:
        found = known.get(_key(unit), "") if unit else ""
        base = _RATES.get(unit, "")
        return found or (f"{known[_key(base)]}/s" if base and _key(base) in known else "")
    except QuantityError:
        return ""


def _key(unit: str) -> tuple[tuple[str, int], ...]:
    return tuple(sorted(dimensions(unit).items()))


def _typed(data: Mapping[str, Any]) -> Iterator[str]:
    """Units of all quantities, and of signals, in the order of the sections."""
    for section in _SECTIONS:
        for text in _texts(data.get(section)):
            try:
                unit = typed_unit(text)
                if unit and dimensions(unit) and parse_any(text)[0]:  # "0 rad" says what it is, not how to read it
                    yield unit
            except QuantityError:
                continue


def _texts(value: Any) -> Iterator[str]:
    """All texts in nested tables; a unit alone as a quantity of one."""
    if isinstance(value, str):
        yield value
    elif isinstance(value, Mapping):
        for key, part in value.items():
            if key in _OTHERS:
                continue
            yield from ([f"1 {part}"] if key == "unit" and isinstance(part, str) else _texts(part))
    elif isinstance(value, list):
        for part in value:
            yield from _texts(part)
