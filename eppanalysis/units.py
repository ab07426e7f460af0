"""Quantities as people write them ("2.5 deg", "360/2000 deg", "36:1") to SI numbers and back; the only user of pint.

Angles count as a dimension of their own: "10 Hz" is no angular velocity, "5 %" no angle, "1 lb" no force.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from fractions import Fraction
from functools import cache, lru_cache
from typing import TYPE_CHECKING

from eppanalysis.errors import EppError, Fault

if TYPE_CHECKING:
    import pint

#: What a unit measures and how people write it, for messages.
KINDS: dict[str, tuple[str, str]] = {
    "": ("a plain number", "0.8"),
    "rad": ("an angle", "2.5 deg"),
    "rad/s": ("an angular velocity", "164 deg/s"),
    "m": ("a length", "20 mm"),
    "m/s": ("a velocity", "10 mm/s"),
    "s": ("a time", "1 ms"),
    "Hz": ("a frequency", "2 Hz"),
    "kg": ("a mass", "0.45 kg"),
    "N": ("a force", "1.25 lbf"),
    "V": ("a voltage", "16 V"),
    "V/N": ("a sensor gain", "2 V/lbf"),
    "N/m": ("a stiffness", "6705 N/m"),
    "N*m": ("a torque", "10.93 N*m"),
    "N*m/rad": ("a torsional stiffness", "1000 N*m/rad"),
    "N*m*s/rad": ("a torsional damping", "1.0 N*m*s/rad"),
    "kg*m^2": ("a moment of inertia", "0.03 kg*m^2"),
}

#: Factor and base units of the units above and of those in the shipped cases, as pint gives them (a test compares):
#: pint takes as long to start as everything else that a first simulation needs.
_COMMON = {
    "": (1.0, "dimensionless"),
    "rad": (1.0, "radian"),
    "deg": (0.017453292519943295, "radian"),
    "rad/s": (1.0, "radian / second"),
    "deg/s": (0.017453292519943295, "radian / second"),
    "rpm": (0.10471975511965977, "radian / second"),
    "m": (1.0, "meter"),
    "mm": (0.001, "meter"),
    "m/s": (1.0, "meter / second"),
    "mm/s": (0.001, "meter / second"),
    "s": (1.0, "second"),
    "ms": (0.001, "second"),
    "us": (1e-06, "second"),
    "min": (60.0, "second"),
    "Hz": (1.0, "1 / second"),
    "kg": (1.0, "kilogram"),
    "N": (1.0, "kilogram * meter / second ** 2"),
    "lbf": (4.4482216152605005, "kilogram * meter / second ** 2"),
    "V": (1.0, "kilogram * meter ** 2 / ampere / second ** 3"),
    "mV": (0.001, "kilogram * meter ** 2 / ampere / second ** 3"),
    "V/N": (1.0, "meter / ampere / second"),
    "V/lbf": (0.22480894309971053, "meter / ampere / second"),
    "N/m": (1.0, "kilogram / second ** 2"),
    "N*m": (1.0, "kilogram * meter ** 2 / second ** 2"),
    "N*m/rad": (1.0, "kilogram * meter ** 2 / radian / second ** 2"),
    "N*m*s/rad": (1.0, "kilogram * meter ** 2 / radian / second"),
    "kg*m^2": (1.0, "kilogram * meter ** 2"),
    "%": (0.01, "dimensionless"),
    "1/s": (1.0, "1 / second"),
    "m/s^2": (1.0, "meter / second ** 2"),
    "N*s/m": (1.0, "kilogram / second"),
    "N*m*s": (1.0, "kilogram * meter ** 2 / second"),
    "A": (1.0, "ampere"),
    "ohm": (1.0, "kilogram * meter ** 2 / ampere ** 2 / second ** 3"),
    "V/A": (1.0, "kilogram * meter ** 2 / ampere ** 2 / second ** 3"),
    "V*s/A": (1.0, "kilogram * meter ** 2 / ampere ** 2 / second ** 2"),
    "H": (1.0, "kilogram * meter ** 2 / ampere ** 2 / second ** 2"),
    "V/rad": (1.0, "kilogram * meter ** 2 / ampere / radian / second ** 3"),
    "V*s/rad": (1.0, "kilogram * meter ** 2 / ampere / radian / second ** 2"),
    "N*m/A": (1.0, "kilogram * meter ** 2 / ampere / second ** 2"),
}
#: Base units as they are written.
_SYMBOLS = {"kilogram": "kg", "meter": "m", "second": "s", "radian": "rad", "ampere": "A", "kelvin": "K"}

_LONGEST = 80
#: What pint raises for text that is no unit; its own errors derive from these.
_PINT_FAILURES = (AttributeError, ValueError, TypeError, KeyError, OverflowError, AssertionError)

_PLAIN = r"(?:\d+(?:_?\d+)*\.?\d*|\.\d+)(?:[eE][+-]?\d{1,4})?"
#: A number, or a quotient of two as data sheets have them: "360/2000 deg", and of a gear "36:1".
_NUMBER = rf"([+-]?{_PLAIN})(?:\s*([/:])\s*({_PLAIN}))?"
_NAME = r"(?:[A-Za-zµμΩ][A-Za-z_]*|%)"
_FACTOR = rf"{_NAME}(?:(?:\^|\*\*)-?\d)?"
#: What is below the line, as in "m^3/(s*V)".
_BELOW = rf"\(\s*{_FACTOR}(?:\s*(?:\*(?!\*)|\s)\s*{_FACTOR})*\s*\)"
#: The 1 of "1/s" is apart from the number before it: "11/s" is no "1 1/s".
_UNIT = rf"(?:(?<![\d.])1/{_BELOW}|(?:(?<![\d.])1/)?{_FACTOR})(?:\s*(?:\*(?!\*)|/|\s)\s*{_FACTOR}|\s*/\s*{_BELOW})*"
_QUANTITY = re.compile(rf"\s*{_NUMBER}\s*({_UNIT})?\s*")
#: Units as data sheets run them together, a force or a mass and a length: "mNm", "Nms", "gcm2".
_TOGETHER = re.compile(r"(?<![A-Za-z_])([mkM]?N|k?g|lbf|ozf)(cm|mm|m|in|ft)(s)?(?:\^?(\d))?(?![A-Za-z_\d])")
_COMMA = re.compile(r"^(\s*[+-]?\d+),(\d+)")
SPELLINGS = str.maketrans({"°": "deg", "·": "*", "⋅": "*", "−": "-", "²": "^2", "³": "^3"})


class QuantityError(ValueError):
    """A value that is not the quantity wanted; `expected` says what is, `fault` the kind of mistake."""

    def __init__(self, expected: str, fault: Fault | None = None) -> None:
        self.expected, self.fault = expected, fault
        super().__init__(expected)


class UnknownUnit(QuantityError):
    """A quantity in a unit that there is none of."""


class NoQuotient(QuantityError):
    """A quotient of two numbers that has no value, or no unit."""


@cache
def _registry() -> pint.UnitRegistry:
    """Pint's units.

    Raises
    ------
    EppError
        If pint cannot be loaded: only the common units are known then.
    """
    try:
        import pint

        return pint.UnitRegistry()
    except Exception as error:  # an old pint beside new libraries fails with whatever they raise
        why = " ".join(f"{type(error).__name__}: {error}".split())
        raise EppError(
            f"units: pint, which knows all but the most common units, cannot be loaded ({why}); "
            "expected a version of it that works with the other packages (pip install -U pint)."
        ) from error


def _factor_and_base(unit: str) -> tuple[float, str]:
    """Factor to base units, and those units; angles keep their radian.

    Raises
    ------
    QuantityError
        If there is no such unit.
    EppError
        If pint is needed and does not start.
    """
    return _COMMON.get(unit) or _as_pint_has_it(unit)


@cache
def _as_pint_has_it(unit: str) -> tuple[float, str]:
    """As :func:`_factor_and_base`, for any unit.

    Raises
    ------
    QuantityError
        If there is no such unit.
    """
    if (parted := _parted(unit)) != unit:
        raise UnknownUnit(f"a known unit in place of '{unit}': did you mean '{parted}'?")
    registry = _registry()
    try:
        parsed = registry.parse_units(unit)
        one, two = (registry.Quantity(count, parsed).to_base_units() for count in (1.0, 2.0))
    except _PINT_FAILURES as error:
        raise UnknownUnit(f"a known unit in place of '{unit}'") from error
    if two.magnitude != 2.0 * one.magnitude:
        counted = ": counted from any level, it is in K" if registry.K.is_compatible_with(parsed) else ""
        raise UnknownUnit(f"a unit without offset or logarithm in place of '{unit}'{counted}")
    return float(one.magnitude), str(one.units)


def _parted(text: str) -> str:
    """A text with signs between units that are run together; below the line in brackets, as "V/Nm" means them."""

    def parted(found: re.Match[str]) -> str:
        length = found[2] + (f"^{found[4]}" if found[4] else "")
        product = "*".join(filter(None, (found[1], length, found[3])))
        return f"({product})" if text[: found.start()].rstrip().endswith("/") else product

    return _TOGETHER.sub(parted, text)


def meant(text: str) -> str:
    """The quantity that a text probably means which is none; empty where it is no slip of a known kind.

    Examples
    --------
    >>> meant("0,8 ohm"), meant("420 gcm\N{SUPERSCRIPT TWO}"), meant("5 apples")
    ('0.8 ohm', '420 g*cm^2', '')
    """
    likely = _parted(_COMMA.sub(r"\1.\2", text.translate(SPELLINGS)))
    try:
        return likely if likely != text.translate(SPELLINGS) and parse_any(likely) else ""
    except QuantityError:
        return ""


def _describe(unit: str) -> str:
    kind, example = KINDS.get(unit, (f"a quantity in {unit}", f"1 {unit}"))
    return f"{kind} such as {example!r}" if unit else f"{kind} such as {example}"


# A case that is varied is read again and again, and most of its texts stay.
@lru_cache(maxsize=4096)
def _split(text: str, unit: str | None) -> tuple[float, str]:
    wanted = "a number with or without a unit" if unit is None else _describe(unit)
    if len(text) > _LONGEST:
        raise QuantityError(f"{wanted}, at most {_LONGEST} characters long")
    match = _QUANTITY.fullmatch(text.translate(SPELLINGS))
    if match is None:
        raise QuantityError(f"{wanted}: did you mean {likely!r}?" if (likely := meant(text)) else wanted)
    above, sign, below, given = match.groups(default="")
    if sign == ":" and given:
        raise NoQuotient(f"{wanted}; a ratio such as '36:1' has no unit")
    try:
        # The float that is nearest to the quotient of the decimal fractions.
        number = float(Fraction(above) / Fraction(below)) if below else float(above)
    except ZeroDivisionError:
        raise NoQuotient(f"a divisor that is not zero: {wanted}") from None
    except OverflowError:
        number = math.inf
    if not math.isfinite(number):
        raise QuantityError(f"a finite number: {wanted}")
    return number, given.strip()


def _number(value: object, unit: str | None) -> float:
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise QuantityError("a number with or without a unit" if unit is None else _describe(unit))
    try:
        number = float(value)
    except OverflowError:
        number = math.inf
    if not math.isfinite(number):
        raise QuantityError("a finite number" if unit is None else f"a finite number: {_describe(unit)}")
    return number


def parse_quantity(value: object, unit: str) -> float:
    """SI value of a quantity.

    Parameters
    ----------
    value : str, int or float
        Text with a unit, or a plain number, which is taken to be in SI units.
    unit : str
        The SI unit that the value must have the dimension of ("rad", "N*m/rad"; "" is a plain number).

    Returns
    -------
    float
        The value in `unit`.

    Raises
    ------
    QuantityError
        If the value is no such quantity, not finite, or a boolean.

    Examples
    --------
    >>> round(parse_quantity("1.25 lbf", "N"), 6), parse_quantity("36:1", "")
    (5.560277, 36.0)
    """
    if not isinstance(value, str):
        return _number(value, unit)
    number, given = _split(value, unit)
    if not given:
        return number
    factor, base = _factor_and_base(given)
    wanted_factor, wanted_base = _factor_and_base(unit)
    if base != wanted_base:
        raise QuantityError(_describe(unit) + _hint(base, wanted_base))
    return _finite(number * factor / wanted_factor, unit)


def _finite(value: float, unit: str) -> float:
    if not math.isfinite(value):
        raise QuantityError(f"a finite number: {_describe(unit)}")
    return value


def _hint(base: str, wanted: str) -> str:
    """What was probably meant."""
    if wanted == _factor_and_base("N")[1] and base == "kilogram":
        return " (lb, oz, kg are masses; write lbf, ozf, kgf)"
    if wanted == "kilogram" and base == _factor_and_base("N")[1]:
        return " (lbf, ozf, kgf are forces; write lb, oz, kg)"
    if wanted == _factor_and_base("rad/s")[1] and base == _factor_and_base("Hz")[1]:
        return " (Hz counts turns; write turn/s)"
    return ""


def parse_any(value: object) -> tuple[float, str]:
    """SI value and SI unit of a quantity of any dimension; hertz are those of what is written in hertz alone.

    Raises
    ------
    QuantityError
        If the value is no quantity, not finite, or a boolean.

    Examples
    --------
    >>> parse_any("20 mm"), parse_any("2 kHz"), parse_any("30 1/s")
    ((0.02, 'm'), (2000.0, 'Hz'), (30.0, '1/s'))
    """
    return _parsed(value) if isinstance(value, str) else (_number(value, None), "")


@lru_cache(maxsize=4096)
def _parsed(text: str) -> tuple[float, str]:
    number, given = _split(text, None)
    unit = "Hz" if _counts_turns(given) else unit_of(dimensions(given))
    return _finite(number * _factor_and_base(given)[0], unit), unit


def typed_unit(value: object) -> str:
    """Unit that a quantity was written in; empty where it has none.

    Examples
    --------
    >>> typed_unit("20 mm"), typed_unit("3 %"), typed_unit("2"), typed_unit(2)
    ('mm', '%', '', '')
    """
    return _split(value, None)[1] if isinstance(value, str) else ""


def _counts_turns(unit: str) -> bool:
    """Whether a unit is written as one of frequency; 1/s is none, nor is rad/s."""
    return unit.lower().endswith(("hz", "hertz")) and dimensions(unit) == dimensions("Hz")


@cache
def dimensions(unit: str) -> dict[str, int]:
    """Exponents of the base units of a unit, angles among them.

    Raises
    ------
    QuantityError
        If there is no such unit.

    Examples
    --------
    >>> dimensions("N/m")
    {'kilogram': 1, 'second': -2}
    """
    found: dict[str, int] = {}
    for sign, name, power in re.findall(r"(?:^|([*/]) )([a-z_]+)(?: \*\* (\d+))?", _factor_and_base(unit)[1]):
        found[name] = found.get(name, 0) + (-1 if sign == "/" else 1) * int(power or 1)
    found.pop("dimensionless", None)
    return {name: power for name, power in found.items() if power}


def is_si(unit: str) -> bool:
    """Whether one of a unit is one in SI units.

    Raises
    ------
    QuantityError
        If there is no such unit.

    Examples
    --------
    >>> is_si("N*m"), is_si("deg")
    (True, False)
    """
    return _factor_and_base(unit)[0] == 1.0


def unit_of(exponents: Mapping[str, float]) -> str:
    """The SI unit with these exponents of base units, as people call it where it has a name.

    Units of :data:`KINDS` go first; what has no name is a product, of a force or a voltage where that is shorter. What
    is only known to be one over a time is no count of turns: it is in 1/s, never in Hz.

    Examples
    --------
    >>> unit_of({"kilogram": 1, "second": -2}), unit_of({"second": 2.0})
    ('N/m', 's^2')
    """
    return _called(tuple((name, power) for name, power in exponents.items() if power))


@lru_cache(maxsize=1024)
def _called(exponents: tuple[tuple[str, float], ...]) -> str:
    wanted = dict(exponents)
    for unit in (*KINDS, *_COMMON):
        if unit != "Hz" and dimensions(unit) == wanted:
            return unit
    mass = wanted.get("kilogram", 0)
    ways: list[Mapping[str, float]] = [wanted]
    if abs(mass) == 1 and "second" in wanted:  # a force or a voltage, over or under others
        for head in ("N", "V"):
            rest = {name: wanted.get(name, 0) - mass * dimensions(head).get(name, 0) for name in (*wanted, "meter")}
            if head == "N" or "ampere" in wanted:
                ways.append({head: mass, **rest})
    return min((_product(way) for way in ways), key=lambda unit: (unit.count("^") + unit.count("/"), len(unit)))


def _product(powers: Mapping[str, float]) -> str:
    """A product of powers of units, as people write it."""
    parts = ["", ""]
    for name, power in powers.items():
        if power:
            raised = f"^{abs(float(power)):g}" if abs(power) != 1 else ""
            parts[power < 0] += ("/" if power < 0 else "*") + _SYMBOLS.get(name, name) + raised
    return (parts[0].removeprefix("*") or "1") + parts[1]


def format_si(value: float, unit: str, friendly: str | None = None, digits: int = 6) -> str:
    """Text of an SI value in a unit that people use, for reading.

    Parameters
    ----------
    value : float
        In the SI unit `unit`.
    friendly : str, optional
        Unit to write in; by default `unit` itself.
    digits : int
        Significant digits.

    Examples
    --------
    >>> format_si(0.04363323129985824, "rad", "deg")
    '2.5 deg'
    """
    shown = unit if friendly is None else friendly
    scaled = value * _factor_and_base(unit)[0] / _factor_and_base(shown)[0]
    return f"{scaled:.{digits}g} {shown}".rstrip()


def rounded(value: float, unit: str, friendly: str | None = None) -> float:
    """An SI value to twelve digits of the unit that people use, so that :func:`write_si` writes it in that.

    Examples
    --------
    >>> write_si(2.0 / 3.0, "rad", "deg")
    '0.6666666666666666 rad'
    >>> write_si(rounded(2.0 / 3.0, "rad", "deg"), "rad", "deg")
    '38.1971863421 deg'
    """
    return parse_quantity(format_si(value, unit, friendly, digits=12), unit)


def write_si(value: float, unit: str, friendly: str | None = None) -> str:
    """Text that :func:`parse_quantity` turns back into exactly the same number.

    The friendly unit is used where at most 15 digits of it give the number back, the SI unit otherwise.

    Examples
    --------
    >>> write_si(0.02, "m", "mm"), write_si(0.1, "N")
    ('20 mm', '0.1 N')
    """
    text = format_si(value, unit, friendly, digits=15)
    try:
        if parse_quantity(text, unit) == value:
            return text
    except QuantityError:  # too large for the friendly unit
        pass
    return f"{float(value)!r} {unit}".rstrip()
