"""Units and digits in which people read tables and pictures; files and JSON stay in SI units."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from itertools import pairwise

#: What an SI unit is shown as, and the factor to it.
READABLE = {"rad": ("deg", 180.0 / math.pi), "rad/s": ("deg/s", 180.0 / math.pi), "m": ("mm", 1e3)}


class Unit(str):
    """An SI unit that people read in another one, which their case types: to all that computes, the SI unit's text.

    Examples
    --------
    >>> speed = Unit("rad/s", "rpm", 30.0 / math.pi)
    >>> speed == "rad/s", quantity(math.pi, speed)
    (True, '30 rpm')
    """

    __slots__ = ("factor", "shown")

    def __new__(cls, si: str, shown: str, factor: float) -> Unit:
        """The SI unit `si`, read in `shown`, of which one in SI is `factor`."""
        unit = super().__new__(cls, si)
        unit.shown, unit.factor = shown, factor
        return unit

    shown: str
    factor: float

    def __getnewargs__(self) -> tuple[str, str, float]:  # type: ignore[override]
        """What makes it again in another process."""
        return str(self), self.shown, self.factor

    def __bool__(self) -> bool:
        """A percentage is a plain number that is read in a unit."""
        return True


def readable(unit: str) -> tuple[str, float]:
    """Unit to show in place of an SI unit, and the factor from SI.

    Examples
    --------
    >>> readable("m")
    ('mm', 1000.0)
    >>> readable("N*m")
    ('N·m', 1.0)
    """
    if isinstance(unit, Unit):
        return in_print(unit.shown), unit.factor
    return READABLE.get(unit, (in_print(unit), 1.0))


def in_print(unit: str) -> str:
    """A unit, or a quantity, with the signs of print in place of those of files.

    Examples
    --------
    >>> in_print("kg*m^2")
    'kg·m²'
    """
    return unit.replace("*", "·").replace("^2", "²").replace("^3", "³")


def written(unit: str) -> str:
    """Unit to show in place of an SI unit, spelled as files and options take it.

    Examples
    --------
    >>> written("m"), written("N*m")
    ('mm', 'N*m')
    """
    return unit.shown if isinstance(unit, Unit) else READABLE.get(unit, (unit, 1.0))[0]


#: Significant digits of numbers in sentences, tables and pictures.
DIGITS = 4
#: Smaller numbers are written without powers of ten.
_PLAIN = 1e5
#: What rounding leaves of zero: of a signal at rest in SI units, of a peak-to-peak relative to its mean.
ROUNDING = 1e-12


def span(
    values: Iterable[float], unit: str, shown: tuple[str, float] | None = None, one: str = "at", several: str = "from"
) -> str:
    """From where to where SI values run, as people read them: in the unit and by the factor `shown`, where given.

    `one` is before a single value, `several` before the first of two.

    Examples
    --------
    >>> span([0.004, 0.012], "m"), span([], "m")
    ('from 4 mm to 12 mm', 'nowhere')
    """
    known = [value for value in values if math.isfinite(value)]
    if not known:
        return "nowhere"
    unit, factor = shown or readable(unit)
    low, high = (f"{number(factor * value)} {unit}".rstrip() for value in (min(known), max(known)))
    return f"{one} {low}" if low == high else f"{several} {low} to {high}"


def number(value: float, digits: int = DIGITS) -> str:
    """A number as people write it.

    Examples
    --------
    >>> number(0.0499871), number(12), number(float("inf"))
    ('0.04999', '12', 'infinite')
    >>> number(12345.6), number(1650.0, 3), number(1.65e7)
    ('12350', '1650', '1.65e+07')
    """
    if isinstance(value, int):
        return str(value)
    if math.isinf(value):
        return ("-" if value < 0 else "") + "infinite"
    text = f"{value + 0.0:.{digits}g}"  # zero has no sign
    return f"{float(text):.0f}" if "e+" in text and abs(value) < _PLAIN else text


def quantity(value: float, unit: str, digits: int = DIGITS, shown: tuple[str, float] | None = None) -> str:
    """An SI value as people read it, with its unit: in the unit and by the factor `shown`, where given.

    Examples
    --------
    >>> quantity(0.0069992, "m")
    '6.999 mm'
    """
    unit, factor = shown or readable(unit)
    return f"{number(value * factor, digits)} {unit}".rstrip()


def lasting(time: float, units: Mapping[str, str]) -> str:
    """A time [s] as people read it beside signals of these units.

    Examples
    --------
    >>> lasting(90.0, {}), lasting(90.0, {"time": Unit("s", "min", 1.0 / 60.0)})
    ('90 s', '1.5 min')
    """
    return quantity(time, units.get("time", "s"))


def time_unit(units: Mapping[str, str]) -> str:
    """The unit in which people read times beside signals of these units."""
    return readable(units.get("time", "s"))[0]


def words(name: str) -> str:
    """A dotted name of a parameter, or a signal's, in words.

    Examples
    --------
    >>> words("lock_pin.backlash"), words("mass.mass"), words("run.inputs.load.size")
    ('lock pin backlash', 'mass', 'load size')
    """
    name = name.removeprefix("run.inputs.").removeprefix("run.")
    parts = name.replace("_", " ").replace("peak-to-peak", "peak to peak").split(".")
    return " ".join(part for before, part in pairwise(["", *parts]) if part != before)


def at_rest(value: float) -> float:
    """Where a signal rests, in SI units; what rounding leaves of zero is zero.

    Examples
    --------
    >>> at_rest(-7.99e-20), at_rest(0.0871)
    (0.0, 0.0871)
    """
    return 0.0 if abs(value) <= ROUNDING else value


def percent(share: float) -> str:
    """An estimate of a relative error as people read it; beyond the whole size an estimate tells nothing.

    Examples
    --------
    >>> percent(0.0312), percent(1e-6), percent(3.0)
    ('3.1 %', '< 0.01 %', '> 100 %')
    """
    if math.isnan(share):
        return "-"
    if share > 1.0:
        return "may not exist" if math.isinf(share) else "> 100 %"
    return "< 0.01 %" if share < 1e-4 else f"{100.0 * share:.2g} %"


def signed_percent(share: float | None) -> str:
    """A relative difference as people read it.

    Examples
    --------
    >>> signed_percent(0.183), signed_percent(-0.0042), signed_percent(None)
    ('+18.3 %', '-0.42 %', '-')
    """
    if share is None or math.isnan(share):
        return "-"
    return "0 %" if abs(share) < 5e-5 else f"{100.0 * share:+.2f} %" if abs(share) < 0.01 else f"{100.0 * share:+.1f} %"


def listed(parts: Sequence[str]) -> str:
    """Several things in words.

    Examples
    --------
    >>> listed(["a", "b", "c"])
    'a, b and c'
    """
    return " and ".join([", ".join(parts[:-1]), parts[-1]] if len(parts) > 1 else parts)


def reasons(by_place: Iterable[tuple[str, str]]) -> str:
    """Sentences, each once, and at which places each of them holds where they differ.

    Examples
    --------
    >>> at = ("1 Hz", "It rests."), ("2 Hz", "It rests."), ("3 Hz", "It oscillates.")
    >>> reasons(at)
    'At 1 Hz and 2 Hz: It rests. At 3 Hz: It oscillates.'
    """
    places: dict[str, list[str]] = {}
    for place, sentence in by_place:
        places.setdefault(sentence, []).append(place)
    if len(places) < 2:
        return "".join(places)
    return " ".join(f"At {listed(at)}: {sentence}" for sentence, at in places.items())


def one_line(text: str) -> str:
    """A text without line breaks, words one blank apart."""
    return " ".join(text.split())


def with_unit(text: str, unit: str) -> str:
    """What is shown, with its unit in brackets where it has one.

    Examples
    --------
    >>> with_unit("time", "s"), with_unit("gain", "")
    ('time [s]', 'gain')
    """
    return f"{text} [{unit}]" if unit else text


def count(n: int, noun: str) -> str:
    """A number of things in words.

    Examples
    --------
    >>> count(1, "orbit"), count(2, "boundary"), count(0, "branch")
    ('1 orbit', '2 boundaries', 'no branches')
    """
    plural = f"{noun[:-1]}ies" if noun.endswith("ry") else f"{noun}es" if noun.endswith(("ch", "s")) else f"{noun}s"
    return f"{n or 'no'} {noun if n == 1 else plural}"


def leading_name(text: str, known: Iterable[str] = ()) -> tuple[str, str]:
    """The name that a text begins with, and the rest: the longest known one, which may hold spaces, or its first word.

    Examples
    --------
    >>> leading_name("Motor/Speed ref 0.3 deg", ["Motor/Speed ref", "Motor/Speed"])
    ('Motor/Speed ref', '0.3 deg')
    >>> leading_name("x 0.3 deg", ["y"])
    ('x', '0.3 deg')
    """
    text = text.strip()
    name = max((name for name in known if text.startswith(f"{name} ")), key=len, default=text.partition(" ")[0])
    return name, text[len(name) :].strip()
