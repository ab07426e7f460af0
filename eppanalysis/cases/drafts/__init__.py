"""Drafts of case files, one a kind of machine: valid files with comments, and questions about their first numbers.

A question is a line of the file: the name of a field, a plausible value, and two spaces before the comment.
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from eppanalysis.cases import Case, case_from_text
from eppanalysis.cases.values.toml import toml_value
from eppanalysis.errors import CaseError, did_you_mean
from eppanalysis.units import QuantityError, dimensions, typed_unit

#: In the order in which they are offered; files beside this one have these names.
DRAFTS = ("servo", "thermostat", "valve", "two-mass", "elbow")
_QUESTION = re.compile(r'^([\w.]+) = "([^"]*)"  # (.+)$', re.MULTILINE)


@dataclass(frozen=True)
class Question:
    """A question about a number of a draft."""

    name: str  # of the field, as ``--set`` takes it
    value: str  # plausible, with its unit
    about: str


@dataclass(frozen=True)
class Draft:
    """A draft of a case file.

    Examples
    --------
    >>> draft = Draft("servo")
    >>> print(draft.about)
    Position servo: motor, gear with backlash, friction, load, encoder and PI controller.
    >>> [question.name for question in draft.questions][:3]
    ['resistance', 'torque_constant', 'ratio']
    >>> 'ratio = "36:1"  # Gear' in draft.with_numbers({"ratio": "36:1"})
    True
    """

    kind: str

    @cached_property
    def text(self) -> str:
        """The file with plausible numbers."""
        return (Path(__file__).parent / f"{self.kind}.toml").read_text(encoding="utf-8")

    @property
    def about(self) -> str:
        """What it is, in a line."""
        return self.text.partition("\n")[0].removeprefix("# ")

    @property
    def questions(self) -> tuple[Question, ...]:
        """The questions in the order of the file."""
        return tuple(Question(*found.groups()) for found in _QUESTION.finditer(self.text))

    @cached_property
    def _case(self) -> Case:
        return case_from_text(self.text)

    def check(self, name: str, value: str) -> None:
        """Refuse a number that the field of this name does not take.

        Raises
        ------
        CaseError
            If there is no question about it, or it has another unit, or is out of range.
        """
        names = {question.name: question for question in self.questions}
        if name not in names:
            raise CaseError("--set", name, value, f"a number of a {self.kind}: {did_you_mean(name, names)}")
        try:
            unit, other = typed_unit(names[name].value), typed_unit(value)
        except QuantityError as error:
            raise CaseError("--set", name, value, error.expected) from None
        # Beside a default in degrees a plain number would be taken for degrees, and be radians.
        if dimensions(unit) and not other:
            raise CaseError("--set", name, value, f"a quantity with its unit, such as {names[name].value!r}")
        self._case.with_values({name: value}, "--set")

    def with_numbers(self, values: Mapping[str, str]) -> str:
        """The text of the file with the numbers of a user.

        Raises
        ------
        CaseError
            If a number is not taken, alone or beside the others.
        """
        for name, value in values.items():
            self.check(name, value)
        if values:
            self._case.with_values(values, "--set")

        def line(found: re.Match[str]) -> str:
            name, _, about = found.groups()
            return f"{_as_written(name, values[name])}  # {about}" if name in values else found[0]

        return _QUESTION.sub(line, self.text)


def _as_written(name: str, value: str) -> str:
    """The line of a number; one without a unit has no quotation marks."""
    try:
        plain = tomllib.loads(f"value = {value}")["value"]
    except tomllib.TOMLDecodeError:
        plain = value
    written = toml_value(plain if type(plain) in (int, float) else value.strip())
    return f"{name} = {written}"
