"""What can be moved: the sliders of a case, the values that were moved, and the address that holds them."""

from __future__ import annotations

import math
from collections.abc import Mapping

from eppanalysis.cases import Case
from eppanalysis.errors import CaseError, EppError
from eppanalysis.models.devices.elbow.parameters import Bands

#: Moved values by the dotted names of their fields, in SI units.
Values = dict[str, float]

SOURCE = "the page"
_LONGEST_QUERY = 4000
#: A list of all fields would fill the screen of a phone.
_LONGEST_HINT = 150
_WIDTHS = tuple(f"bands.{name}" for name in Bands.WIDTHS)


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
    >>> from eppanalysis.cases import case
    >>> write_query(case("fig8a_original"), {"controller.delay": 0.002})
    'controller.delay=2%20ms'
    """
    from urllib.parse import quote, urlencode

    texts = {name: case.text(name, value, 9) for name, value in values.items()}
    return urlencode(texts, quote_via=quote)
