"""What can be moved: the sliders of a case, the values that were moved, and the address that holds them."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from eppanalysis.case import Case
from eppanalysis.errors import CaseError, EppError

#: Moved values by the dotted names of their fields, in SI units.
Values = dict[str, float]

SOURCE = "the page"
_LONGEST_QUERY = 4000
#: A list of all fields would fill the screen of a phone.
_LONGEST_HINT = 150
_MASS = "forearm.prehensor_mass"
_WIDTHS = ("bands.centre", "bands.parking_width", "bands.range")


@dataclass(frozen=True)
class Slider:
    """One slider; its numbers are in the unit that people use.

    Attributes
    ----------
    name, title, unit : str
    per_unit : float
        SI value of one `unit`.
    low, high, step, value : float
    """

    name: str
    title: str
    unit: str
    per_unit: float
    low: float
    high: float
    step: float
    value: float

    def label(self) -> str:
        """Title with unit."""
        return f"{self.title} [{self.unit}]" if self.unit else self.title


#: Of an elbow: field, words, unit, lowest, highest, step; in the order of the page.
_ELBOW = (
    ("bands.range", "Gain: profile range", "lbf", 1.0, 5.0, 0.05),
    ("lock_pin.backlash", "Backlash", "deg", 0.0, 4.0, 0.05),
    ("pulley.friction", "Pulley friction", "", 0.0, 0.15, 0.002),
    ("cable.stiffness", "Cable stiffness", "N/m", 500.0, 15000.0, 50.0),
    (_MASS, "Mass in the hand", "kg", 0.05, 1.5, 0.01),
    ("controller.delay", "Delay", "ms", 0.0, 20.0, 0.25),
)


def sliders_of(case: Case) -> tuple[Slider, ...]:
    """The sliders of a case: of an elbow the parameters of its design, of another loop every positive one.

    Examples
    --------
    >>> from eppanalysis.case import case
    >>> [slider.label() for slider in sliders_of(case("backlash_servo"))]
    ['loop gain', 'play gap']
    """
    return tuple(_elbow_sliders(case)) if case.kind == "elbow" else tuple(_loop_sliders(case))


def _elbow_sliders(case: Case) -> Iterable[Slider]:
    for name, title, unit, low, high, step in _ELBOW:
        value = current(case, name)
        if value is None:
            name, title, unit, low, high, step = "forearm.inertia", "Forearm inertia", "kg*m^2", 0.005, 0.2, 0.001
            value = case.value(name)
        per_unit = case.si(name, f"1 {unit}".strip())
        shown = value / per_unit
        yield Slider(name, title, unit.replace("*", "·"), per_unit, min(low, shown), max(high, shown), step, shown)


def _loop_sliders(case: Case) -> Iterable[Slider]:
    if "loop.gain" not in case.parameters and _takes(case, "loop.gain", 1.01):
        yield Slider("loop.gain", "loop gain", "", 1.0, 0.1, 3.0, 0.01, 1.0)
    for name, parameter in case.parameters.items():
        value = parameter.value
        if isinstance(value, bool) or not value > 0 or name == "loop.time_step" or not _takes(case, name, 1.01 * value):
            continue
        per_unit = case.si(name, f"1 {parameter.friendly}".strip())
        shown = value / per_unit
        step = 10.0 ** math.floor(math.log10(shown) - 1.5)
        title = name.replace("_", " ").replace(".", " ")
        yield Slider(name, title, parameter.friendly, per_unit, shown / 10.0, 3.0 * shown, step, shown)


def _takes(case: Case, name: str, value: float) -> bool:
    """Whether a field may have a value: a transfer function has a gain in front of it, a count is a whole number."""
    try:
        return bool(case.with_values({name: value}))
    except CaseError:
        return False


def current(case: Case, name: str) -> float | None:
    """Value of a field [SI], also of the mass where the case gives the inertia; None where there is none."""
    try:
        return case.value(name)
    except CaseError:
        if name != _MASS:
            raise
        return None


def moved_case(case: Case, values: Mapping[str, float]) -> Case:
    """The case with moved values.

    Raises
    ------
    CaseError
        If they do not go together.
    """
    if not values:
        return case
    given = dict(values)
    if "bands.range" in given and "bands.range" not in case.parameters:
        # The case gives thresholds; a width needs the other widths beside it.
        given = {name: case.value(name) for name in _WIDTHS} | given
    return case.with_values(given, SOURCE)


def read_pair(case: Case, name: str, text: str) -> float:
    """SI value of a field of the page or of its address.

    Raises
    ------
    CaseError
        If there is no such field or the text is no such quantity.
    """
    if len(name) > 100 or len(text) > 100:
        raise CaseError(SOURCE, name[:40], text[:40], "the name of a field and a quantity of ordinary length")
    try:
        value = case.si(name, text)
    except CaseError as error:
        many = len(error.expected) > _LONGEST_HINT
        expected = f"a field of the case, such as {next(iter(case.parameters))}" if many else error.expected
        raise CaseError(SOURCE, name, error.value, expected) from None
    if not math.isfinite(value):
        raise CaseError(SOURCE, name, text, "a finite number")
    return value


def read_query(case: Case, arguments: Mapping[str, list[bytes]]) -> tuple[Values, list[str]]:
    """Values of an address, and a sentence for each that is not valid; those are left out.

    Parameters
    ----------
    case : Case
    arguments : mapping of str to list of bytes
        The query of the address, decoded from per cent.
    """
    if sum(len(k) + sum(map(len, v)) for k, v in arguments.items()) > _LONGEST_QUERY:
        return {}, [f"{SOURCE}: its address is too long; expected at most {_LONGEST_QUERY} characters."]
    values: Values = {}
    sentences = []
    for name, texts in arguments.items():
        try:
            values[name] = read_pair(case, name, texts[-1].decode("utf-8", "replace"))
            moved_case(case, values)
        except EppError as error:
            values.pop(name, None)
            sentences.append(str(error))
    return values, sentences


def write_query(case: Case, values: Mapping[str, float]) -> str:
    """The query of an address that :func:`read_query` gives back.

    Examples
    --------
    >>> from eppanalysis.case import case
    >>> write_query(case("fig8a_original"), {"controller.delay": 0.002})
    'controller.delay=2%20ms'
    """
    from urllib.parse import quote, urlencode

    texts = {name: case.text(name, value, 9) for name, value in values.items()}
    return urlencode(texts, quote_via=quote)
