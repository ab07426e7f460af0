"""Units and digits in which people read tables and pictures; files and JSON stay in SI units."""

from __future__ import annotations

import math

#: What an SI unit is shown as, and the factor to it.
READABLE = {"rad": ("deg", 180.0 / math.pi), "rad/s": ("deg/s", 180.0 / math.pi), "m": ("mm", 1e3)}


def readable(unit: str) -> tuple[str, float]:
    """Unit to show in place of an SI unit, and the factor from SI.

    Examples
    --------
    >>> readable("m")
    ('mm', 1000.0)
    >>> readable("N*m")
    ('N·m', 1.0)
    """
    return READABLE.get(unit, (unit.replace("*", "·"), 1.0))


def written(unit: str) -> str:
    """Unit to show in place of an SI unit, spelled as files and options take it.

    Examples
    --------
    >>> written("m"), written("N*m")
    ('mm', 'N*m')
    """
    return READABLE.get(unit, (unit, 1.0))[0]


def quantity(value: float, unit: str, digits: int = 4) -> str:
    """An SI value as people read it, with its unit.

    Examples
    --------
    >>> quantity(0.0069992, "m")
    '6.999 mm'
    """
    shown, factor = readable(unit)
    return f"{value * factor:.{digits}g} {shown}".rstrip()


def words(name: str) -> str:
    """A dotted name of a parameter, or a signal's, in words.

    Examples
    --------
    >>> words("lock_pin.backlash")
    'lock pin backlash'
    """
    return name.replace("_", " ").replace(".", " ")


def with_unit(text: str, unit: str) -> str:
    """What is shown, with its unit in brackets where it has one.

    Examples
    --------
    >>> with_unit("time", "s"), with_unit("gain", "")
    ('time [s]', 'gain')
    """
    return f"{text} [{unit}]" if unit else text


def cut(value: float, digits: int) -> float:
    """A number cut to significant digits: what may be had, rounded to the safe side."""
    if not (value > 0 and math.isfinite(value)):
        return value
    digit = 10.0 ** (math.floor(math.log10(value)) - digits + 1)
    # What is a whole number of digits but for rounding errors stays one.
    return math.floor(value / digit + 1e-9) * digit


def cut_text(value: float | str, digits: int = 4) -> str:
    """A number as text, cut to significant digits; a dash where there is none. A text stays as it is."""
    if isinstance(value, str):
        return value
    return "-" if math.isnan(value) else f"{cut(value, digits):.{digits}g}"


def count(n: int, noun: str) -> str:
    """A number of things in words.

    Examples
    --------
    >>> count(1, "orbit"), count(2, "orbit"), count(0, "branch")
    ('1 orbit', '2 orbits', 'no branches')
    """
    plural = f"{noun}es" if noun.endswith(("ch", "s")) else f"{noun}s"
    return f"{n or 'no'} {noun if n == 1 else plural}"
