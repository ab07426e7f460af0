"""Values of a case file: a plain value, or a table that also says where the value comes from."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any, Literal, get_args

from pydantic import GetCoreSchemaHandler, GetJsonSchemaHandler
from pydantic_core import CoreSchema, PydanticCustomError, core_schema

from eppanalysis.models.devices.declared import Declared, Form, unmet
from eppanalysis.readable import written
from eppanalysis.units import QuantityError, format_si, parse_any, parse_quantity, typed_unit

Mark = Literal["paper", "derived", "assumed", "measured", "data sheet", "tunable"]
MARKS: tuple[str, ...] = get_args(Mark)
LONGEST_TEXT = 2000
_KEYS = ("value", "mark", "note", "tolerance")


@dataclass(frozen=True)
class Parameter:
    """One value of a case, in SI units."""

    value: float | bool  # in the SI unit `unit`
    #: unit, friendly: SI unit, and the unit that people use.
    unit: str = ""
    friendly: str = ""
    #: {"paper", "derived", "assumed", "measured", "data sheet", "tunable"}: where the value comes from, or that it is
    #: free to choose; what a user gives without a mark is assumed.
    mark: Mark = "assumed"
    note: str = ""
    tolerance: float | None = None  # half width of the interval that the value lies in, in `unit`

    @property
    def with_tolerance(self) -> str:
        """The value as people write it, with the half width of its interval where it has one.

        Examples
        --------
        >>> Parameter(0.012, "m", "mm", tolerance=0.001).with_tolerance
        '12 ± 1 mm'
        """
        if self.tolerance is None:
            return str(self)
        value, _, unit = str(self).partition(" ")
        return f"{value} ± {format_si(self.tolerance, self.unit, self.friendly).partition(' ')[0]} {unit}".rstrip()

    def __str__(self) -> str:
        """The value as people write it."""
        if isinstance(self.value, bool):
            return "true" if self.value else "false"
        return format_si(self.value, self.unit, self.friendly)


def not_as_expected(expected: str, shown: Any, key: str = "") -> PydanticCustomError:
    """What :mod:`eppanalysis.cases.schema` turns into a sentence; `key` is what is wrong of a table."""
    return PydanticCustomError("quantity", "expected {expected}", {"expected": expected, "shown": shown, "key": key})


def place_of(field: str, error: PydanticCustomError) -> str:
    """The place of what is wrong: a field, or a key of the table in it."""
    key = (error.context or {}).get("key", "")
    return f"{field}.{key}" if key else field


def plain_value(given: Any) -> Any:
    """The value of a field, which may be in a table."""
    return given.get("value") if isinstance(given, Mapping) else given


def plain_text(text: str) -> str:
    """A text of a case, if it has no characters that a terminal obeys; new lines and tabs are none.

    Raises
    ------
    PydanticCustomError
        If it has.
    """
    if not text.isprintable() and any(not c.isprintable() and c not in "\n\t" for c in text):
        raise not_as_expected("a text without control characters", text)
    return text


def _split_table(raw: Any) -> tuple[Any, Mark, str, Any]:
    """Value, mark, note and tolerance of a plain value or a table."""
    if not isinstance(raw, Mapping):
        return raw, "assumed", "", None
    unknown = [k for k in raw if k not in _KEYS]
    if unknown:
        raise not_as_expected(f"a table of {', '.join(_KEYS)} only, without {unknown[0]!r}", raw)
    if "value" not in raw:
        raise not_as_expected("a table with a value", raw)
    mark, note = raw.get("mark", "assumed"), raw.get("note", "")
    if mark not in MARKS:
        raise not_as_expected(f"a mark that is one of {', '.join(MARKS)}", mark, "mark")
    if not isinstance(note, str) or len(note) > LONGEST_TEXT:
        raise not_as_expected(f"a note that is a text of at most {LONGEST_TEXT} characters", note, "note")
    return raw["value"], mark, plain_text(note), raw.get("tolerance")


def _without_tolerance(raw: Any) -> tuple[Any, Mark, str]:
    """Value, mark and note of what is a count or a choice and has no tolerance."""
    given, mark, note, tolerance = _split_table(raw)
    if tolerance is not None:
        raise not_as_expected("no tolerance, as this is no quantity", tolerance, "tolerance")
    return given, mark, note


def _tolerance(raw: Any, value: float, unit: str, given: Any) -> float | None:
    """Tolerance in SI units; a percentage is of the value.

    A plain number is in SI units; one that is larger than a value with a unit was meant otherwise.
    """
    if raw is None:
        return None
    try:
        if isinstance(raw, str) and raw.rstrip().endswith("%"):
            tolerance = abs(value) * parse_quantity(raw, "")
        else:
            tolerance = parse_quantity(raw, unit)
    except QuantityError as error:
        raise not_as_expected(f"a tolerance in per cent or {error.expected}", raw, "tolerance") from None
    if tolerance < 0:
        raise not_as_expected("a tolerance that is not negative", raw, "tolerance")
    if unit and tolerance > abs(value) > 0.0 and typed_unit(given) and not typed_unit(raw):
        raise not_as_expected(f"a tolerance with a unit, such as '10 %' or '1 {typed_unit(given)}'", raw, "tolerance")
    return tolerance


class _Field(ABC):
    """Base of the field types: how pydantic calls them."""

    @abstractmethod
    def read(self, raw: Any) -> Any:
        """The value of a field, from what the file holds."""

    @abstractmethod
    def schema(self) -> dict[str, Any]:
        """JSON schema of the plain value."""

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        """Validate with :meth:`read`."""
        return core_schema.no_info_plain_validator_function(self.read)

    def __get_pydantic_json_schema__(self, schema: CoreSchema, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        """A plain value, or a table of value, mark, note and tolerance."""
        plain = self.schema()
        table = {
            "type": "object",
            "required": ["value"],
            "additionalProperties": False,
            "properties": {
                "value": plain,
                "mark": {"enum": list(MARKS)},
                "note": {"type": "string", "maxLength": LONGEST_TEXT},
                "tolerance": {"type": ["number", "string"]},
            },
        }
        return {"anyOf": [plain, table]}


@dataclass(frozen=True)
class Quantity(_Field):
    """A quantity of a given dimension and range."""

    #: unit, friendly: SI unit, and the unit that people use (the same by default).
    unit: str
    friendly: str = ""
    #: above, at_least, at_most: range, in SI units.
    above: float | None = None
    at_least: float | None = None
    at_most: float | None = None

    def read(self, raw: Any) -> Parameter:
        """The parameter in SI units."""
        given, mark, note, tolerance = _split_table(raw)
        try:
            value = parse_quantity(given, self.unit)
        except QuantityError as error:
            raise not_as_expected(error.expected, given) from None
        self._check_range(value, given)
        friendly = typed_unit(given) or self.friendly or self.unit
        return Parameter(value, self.unit, friendly, mark, note, _tolerance(tolerance, value, self.unit, given))

    def _check_range(self, value: float, given: Any) -> None:
        expected = unmet(value, (self.above, self.at_least, self.at_most), self._text)
        if expected:
            raise not_as_expected(expected, given)

    def _text(self, value: float) -> str:
        return format_si(value, self.unit, self.friendly or self.unit)

    def schema(self) -> dict[str, Any]:
        """JSON schema of the plain value."""
        return {"type": ["number", "string"], "description": f"SI unit: {self.unit or '1'}"}


@dataclass(frozen=True)
class AnyQuantity(_Field):
    """A quantity of any dimension, as generic loops hold them."""

    def read(self, raw: Any) -> Parameter:
        """The parameter in SI units."""
        given, mark, note, tolerance = _split_table(raw)
        try:
            value, unit = parse_any(given)
        except QuantityError as error:
            raise not_as_expected(error.expected, given) from None
        tolerance = _tolerance(tolerance, value, unit, given)
        return Parameter(value, unit, typed_unit(given) or written(unit), mark, note, tolerance)

    def schema(self) -> dict[str, Any]:
        """JSON schema of the plain value."""
        return {"type": ["number", "string"]}


@dataclass(frozen=True)
class Count(_Field):
    """A whole number in a range."""

    at_least: int
    at_most: int

    def read(self, raw: Any) -> Parameter:
        """The parameter."""
        given, mark, note = _without_tolerance(raw)
        if isinstance(given, str) and given.strip().isdigit() and len(given) < 10:
            given = int(given)
        whole = isinstance(given, int) and not isinstance(given, bool)
        if not whole or not self.at_least <= given <= self.at_most:
            raise not_as_expected(f"a whole number from {self.at_least} to {self.at_most}", given)
        return Parameter(given, "", "", mark, note)

    def schema(self) -> dict[str, Any]:
        """JSON schema of the plain value."""
        return {"type": "integer", "minimum": self.at_least, "maximum": self.at_most}


@dataclass(frozen=True)
class Flag(_Field):
    """True or false."""

    def read(self, raw: Any) -> Parameter:
        """The parameter."""
        given, mark, note = _without_tolerance(raw)
        if isinstance(given, str) and given.strip().lower() in ("true", "false"):
            given = given.strip().lower() == "true"
        if not isinstance(given, bool):
            raise not_as_expected("true or false", given)
        return Parameter(given, "", "", mark, note)

    def schema(self) -> dict[str, Any]:
        """JSON schema of the plain value."""
        return {"type": "boolean"}


def declared_type(declared: Declared) -> Any:
    """The type of a file's field for one that a device declares."""
    if declared.form is Form.FLAG:
        return Annotated[Parameter, Flag()]
    if declared.form is Form.COUNT:
        return Annotated[Parameter, Count(int(declared.at_least or 0), int(declared.at_most or 0))]
    return Annotated[Parameter, Quantity(declared.unit, declared.friendly, *declared.limits)]


Duration = Annotated[Parameter, Quantity("s", "ms", at_least=0)]
PositiveDuration = Annotated[Parameter, Quantity("s", "ms", above=0)]
