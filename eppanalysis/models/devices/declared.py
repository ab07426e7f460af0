"""Fields of a device, each declared once: default, unit, range and meaning.

What a case file may hold, what is refused in which words and what the documentation says all follow from it.
"""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable, Sequence
from dataclasses import Field, dataclass, field
from enum import Enum
from typing import Any, ClassVar

import numpy as np

from eppanalysis.arguments import ORDINARY, are_ordinary, is_an_array, is_number
from eppanalysis.errors import ModelError
from eppanalysis.readable import quantity as written

_KEY = "declared"


class Form(Enum):
    """What a field holds."""

    QUANTITY = "a number"
    COUNT = "a whole number"
    FLAG = "true or false"
    NUMBERS = "a list of numbers"
    MATRIX = "a list of rows of numbers, all of one length"
    ROOTS = "a list of numbers, and of pairs [real part, imaginary part]"
    NAMES = "a list of names"
    CHOICE = "one of several words"


#: Lower limits, one outside and one inside of the range, and the upper limit, which is inside; None is no limit.
Limits = tuple[float | None, float | None, float | None]


def unmet(value: float, limits: Limits, text: Callable[[float], str]) -> str:
    """What is expected of a value outside of its range, with the limit as `text` writes it; empty for one inside."""
    above, at_least, at_most = limits
    if above is not None and not value > above:
        return "a positive number" if above == 0 else f"more than {text(above)}"
    if at_least is not None and not value >= at_least:
        return "zero or a positive number" if at_least == 0 else f"at least {text(at_least)}"
    return f"at most {text(at_most)}" if at_most is not None and not value <= at_most else ""


@dataclass(frozen=True)
class Declared:
    """What is known of a field beside its name and default.

    Attributes
    ----------
    about : str
        What it is.
    unit, friendly : str
        SI unit, and the unit that people use.
    above, at_least, at_most : float or None
        Range, in SI units.
    optional : bool
        Whether a case file may leave it out.
    form : Form
    choices : tuple of str
        Words that a choice is made of.
    """

    about: str
    unit: str = ""
    friendly: str = ""
    above: float | None = None
    at_least: float | None = None
    at_most: float | None = None
    optional: bool = False
    form: Form = Form.QUANTITY
    choices: tuple[str, ...] = ()

    @property
    def limits(self) -> Limits:
        """The range."""
        return self.above, self.at_least, self.at_most

    def refusal(self, value: Any) -> str:
        """What is expected in place of a value; empty for one that is right."""
        if self.form in (Form.FLAG, Form.NAMES):
            return ""
        if self.form is Form.CHOICE:
            return "" if value in self.choices else " or ".join(repr(choice) for choice in self.choices)
        if self.form in (Form.NUMBERS, Form.MATRIX, Form.ROOTS):
            return _unlike(value, self.form)
        if self.form is Form.COUNT:
            whole = isinstance(value, int) and not unmet(value, self.limits, str)
            return "" if whole else f"a whole number from {self.at_least} to {self.at_most}"
        if not is_number(value):
            return "a finite number"
        return unmet(value, self.limits, lambda limit: written(limit, self.unit)) or (
            "" if are_ordinary(value) else ORDINARY
        )


def quantity(default: float | None, about: str, unit: str = "", friendly: str = "", **limits: Any) -> Any:
    """A field of a device that is a number; one that is None by default may be left out.

    Parameters
    ----------
    default : float or None
    about, unit, friendly : str
    **limits
        Further attributes of :class:`Declared`.
    """
    declared = Declared(about, unit, friendly, **{"optional": default is None, **limits})
    return field(default=default, metadata={_KEY: declared})


def required(about: str, unit: str = "", friendly: str = "", **limits: Any) -> Any:
    """A field of a device that is a number and has no default; the parameters are those of :func:`quantity`."""
    return field(metadata={_KEY: Declared(about, unit, friendly, **limits)})


_NO_DEFAULT = object()


def numbers(about: str, default: Any = _NO_DEFAULT, form: Form = Form.NUMBERS) -> Any:
    """A field of a device that is a list of numbers, or of what `form` says."""
    metadata = {_KEY: Declared(about, optional=default is not _NO_DEFAULT, form=form)}
    return field(metadata=metadata) if default is _NO_DEFAULT else field(default=default, metadata=metadata)


def names(about: str) -> Any:
    """A field of a device that is a list of names, or None."""
    return field(default=None, metadata={_KEY: Declared(about, optional=True, form=Form.NAMES)})


def choice(about: str, choices: tuple[str, ...]) -> Any:
    """A field of a device that is one of several words, by default the first."""
    return field(default=choices[0], metadata={_KEY: Declared(about, optional=True, form=Form.CHOICE, choices=choices)})


def _unlike(values: Any, form: Form) -> str:
    """What is expected in place of lists of numbers; empty for those of the right depth and of equal rows."""
    if not is_an_array(values):
        return form.value
    if form is Form.ROOTS:
        pairs = isinstance(values, Sequence | np.ndarray) and all(_depth(root, (0, 1), (1, 2)) for root in values)
        return (_not_finite(np.array([0.0, *map(np.sum, values)]))) if pairs else form.value
    # A matrix of one row may be written as a list of numbers.
    if not _depth(values, (1,) if form is Form.NUMBERS else (1, 2)):
        return form.value
    return _not_finite(np.asarray(values, float))


def _depth(values: Any, depths: tuple[int, ...], lengths: tuple[int, ...] = ()) -> bool:
    """Whether values are numbers in lists that lie so deep in one another, all of one length."""
    try:
        found = np.asarray(values)
    except ValueError:  # rows of different lengths
        return False
    numbers = not found.size or found.dtype.kind in "iuf"
    return numbers and found.ndim in depths and (not lengths or found.size in lengths)


def _not_finite(values: Any) -> str:
    return "" if np.all(np.isfinite(values)) else "finite numbers"


def whole_number(about: str, at_least: int, at_most: int) -> Any:
    """A field of a device that is a count, or None."""
    declared = Declared(about, at_least=at_least, at_most=at_most, optional=True, form=Form.COUNT)
    return field(default=None, metadata={_KEY: declared})


def flag(about: str) -> Any:
    """A field of a device that is true or, by default, false."""
    return field(default=False, metadata={_KEY: Declared(about, optional=True, form=Form.FLAG)})


def _in_words(annotation: Any) -> str:
    """A type as docstrings call it."""
    text = str(annotation).replace(" | ", " or ").replace("Sequence[Any]", "sequence")
    return re.sub(r"Sequence\[(\w+)\]", r"sequence of \1", text.replace("Sequence[Sequence[float]]", "rows of float"))


class Section:
    """Base of the dataclasses that are one section of a device: their fields are checked and documented.

    Raises
    ------
    ModelError
        If a number is not finite or out of its range.
    """

    #: Whether a case file may leave the whole section out.
    left_out: ClassVar[bool] = False
    __dataclass_fields__: ClassVar[dict[str, Field[Any]]]

    def __init_subclass__(cls) -> None:
        lines = [inspect.cleandoc(cls.__doc__ or ""), "", "Attributes", "----------"]
        for name, annotation in cls.__annotations__.items():
            found = cls.__dict__.get(name)
            if isinstance(found, Field):
                about: Declared = found.metadata[_KEY]
                unit = f" [{about.unit}]" if about.unit else ""
                lines += [f"{name} : {_in_words(annotation)}", f"    {about.about}{unit}."]
        lines += ["", "Raises", "------", "ModelError", "    If a number is not finite or out of its range."]
        cls.__doc__ = "\n".join(lines)

    def __post_init__(self) -> None:
        for name, about in declared_fields(type(self)).items():
            value = getattr(self, name)
            expected = "" if value is None else about.refusal(value)
            if expected:
                raise ModelError(type(self).__name__, value, expected, field=name)


def declared_fields(section: type[Section]) -> dict[str, Declared]:
    """What is declared of every field of a section, by their names."""
    found = section.__dataclass_fields__.items()
    return {name: about.metadata[_KEY] for name, about in found if _KEY in about.metadata}
