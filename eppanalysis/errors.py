"""Errors that a user can act on: one sentence each, never a traceback on the command line."""

from __future__ import annotations

import difflib
from collections.abc import Callable, Iterable
from datetime import date, time
from functools import partial
from importlib import util
from typing import Any, NamedTuple

_LONGEST_SHOWN = 80
#: Packages that are not called as their modules are.
_PACKAGES = {"dask_jobqueue": "dask-jobqueue", "docx": "python-docx", "flint": "python-flint"}


def visible(text: str) -> str:
    r"""A text with its control characters spelled out, so that a terminal shows them and does not obey them.

    Examples
    --------
    >>> visible("a\x1b[2Jb")
    'a\\x1b[2Jb'
    """
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)


def shown(value: Any) -> str:
    """A value as a sentence shows it: on one line, and not longer than that.

    Examples
    --------
    >>> shown("1 deg"), shown([1, 2])
    ("'1 deg'", '[1, 2]')
    """
    if getattr(value, "shape", ()):
        return f"{'an array' if hasattr(value, 'dtype') else f'a {type(value).__name__}'} of shape {value.shape}"
    if hasattr(value, "dtype"):
        value = value.item()  # a number of numpy
    if type(value).__repr__ is object.__repr__:
        return f"a {type(value).__name__}"
    try:
        return _cut(" ".join(repr(value).split()))
    except (ValueError, RecursionError):  # a whole number of thousands of digits; a list of lists without end
        return f"a very long {type(value).__name__}"


def _cut(text: str) -> str:
    return text if len(text) <= _LONGEST_SHOWN else text[: _LONGEST_SHOWN - 3] + "..."


#: What fields and kinds are also called, where no likeness of letters tells: the first that is known is meant.
_ALSO_CALLED = {
    **dict.fromkeys(("dead_time", "deadtime", "transport_delay", "pure_delay"), ("delay", "dead_time")),
    **dict.fromkeys(("time_constant", "tau", "cutoff", "corner_frequency"), ("bandwidth",)),
    **dict.fromkeys(("backlash", "freeplay", "width"), ("gap", "play")),
    **dict.fromkeys(("deadzone", "dead_band", "deadband", "half_width"), ("threshold", "upper", "dead_zone")),
    **dict.fromkeys(("limit", "max", "maximum", "limiter"), ("upper", "level", "high", "saturation")),
    **dict.fromkeys(("min", "minimum"), ("lower", "low")),
    **dict.fromkeys(("stiction", "breakaway", "fs"), ("static", "friction")),
    **dict.fromkeys(("resolution", "quantum", "lsb"), ("step",)),
    **dict.fromkeys(("encoder", "adc"), ("quantiser",)),
    **dict.fromkeys(("ts", "dt", "period"), ("sample_time",)),
    **dict.fromkeys(("k", "kp"), ("gain", "stiffness")),
    **dict.fromkeys(("b", "c", "zeta"), ("damping", "viscous")),
    **{"dead_zone": ("threshold",), "fc": ("coulomb", "level"), "delay": ("dead_time",), "lag": ("low_pass",)},
    **{"s": ("stick_band",), "j": ("slip_jump", "inertia"), "m": ("mass",), "r": ("resistance",), "l": ("inductance",)},
    **{
        "kt": ("torque_constant",),
        "ke": ("back_emf",),
        "n": ("ratio",),
        "numerator": ("num",),
        "denominator": ("den",),
    },
    **{"tf": ("transfer_function",), "ss": ("state_space",), "zpk": ("zero_pole_gain",)},
}


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """What was probably meant by a name that is not known, or all that there is.

    Examples
    --------
    >>> did_you_mean("gian", ["gain", "sum"]), did_you_mean("x", ["gain", "sum"])
    ("did you mean 'gain'?", 'one of gain, sum')
    >>> did_you_mean("x", [])
    'there is none'
    >>> did_you_mean("PI", ["pi"])
    "did you mean 'pi'?"
    >>> did_you_mean("dead_time", ["num", "den", "delay", "sample_time"])
    "did you mean 'delay'?"
    """
    names = list(known)
    close = (
        [k for k in names if k.lower() == name.lower()]
        or [k for k in _ALSO_CALLED.get(name.lower(), ()) if k in names]
        or difflib.get_close_matches(name, names, n=1)
    )
    if close:
        return f"did you mean {close[0]!r}?"
    return f"one of {', '.join(names)}" if names else "there is none"


class UnknownName(NamedTuple):
    """Fault: a name that is not known."""

    name: str


class OpenInput(NamedTuple):
    """Fault: an input of a diagram that nothing drives, as connections call it."""

    port: str


class IdleInput(NamedTuple):
    """Fault: an external input that drives nothing."""

    name: str


class AlgebraicLoop(NamedTuple):
    """Fault: parts of a diagram that act straight on themselves, without one answer."""

    parts: tuple[str, ...]


class DrivenTwice(NamedTuple):
    """Fault: an input of a diagram that another connection drives already, as this one calls it."""

    name: str


#: What a refusal is about, for another part of the program; its sentence is for people alone.
Fault = UnknownName | OpenInput | IdleInput | AlgebraicLoop | DrivenTwice


def _typed(value: Any) -> Any:
    """What is shown of a value of a file as the file has it: true, dates and tables are not Python's."""
    if isinstance(value, bool):
        return _Text("true" if value else "false")
    if isinstance(value, date | time):
        return _Text(value.isoformat())
    if isinstance(value, list):
        return [_typed(part) for part in value]
    if isinstance(value, dict):
        return _Text(f"{{{', '.join(f'{key} = {_typed(part)!r}' for key, part in value.items())}}}")
    return value


def _in_file(value: Any) -> str:
    try:
        return shown(_typed(value))
    except RecursionError:  # tables without end
        return shown(value)


class _Text(str):
    """A text that is shown without quotation marks."""

    def __repr__(self) -> str:
        return str(self)


class Missing:
    """What a message shows for a field that is not there."""

    def __repr__(self) -> str:
        return "missing"


class EppError(Exception):
    r"""A request that cannot be carried out, in one sentence that says why and what was expected.

    Examples
    --------
    >>> from eppanalysis import EppError
    >>> print(EppError("a\x1b[2J.toml is missing; expected a case file."))
    a\x1b[2J.toml is missing; expected a case file.
    """

    def __init__(self, sentence: str = "") -> None:
        super().__init__(visible(sentence))


def require_packages(what: str, extra: str, *modules: str) -> None:
    """Refuse in one sentence what needs packages of an extra that are not installed.

    Examples
    --------
    >>> require_packages("a sum", "proof", "math")
    >>> require_packages(
    ...     "a sum", "proof", "no_such_module", "math", "none_either", "nor_this"
    ... )
    Traceback (most recent call last):
    eppanalysis.errors.EppError: a sum needs no_such_module, none_either, nor_this; expected what
    "pip install 'eppanalysis[proof]'" installs.
    """
    missing = [_PACKAGES.get(name, name) for name in modules if util.find_spec(name) is None]
    if missing:
        how = f"what \"pip install 'eppanalysis[{extra}]'\" installs"
        raise EppError(f"{what} needs {', '.join(missing)}; expected {how}.")


class CaseError(EppError):
    """A case file or a value in it that is not valid.

    Parameters
    ----------
    source : str
        File (or shipped case, or command-line option) that holds the value.
    field : str
        Dotted name of the field; empty when the file as a whole is meant.
    value : object
        What was found.
    expected : str
        What was expected in its place.
    fault : Fault, optional
        What kind of fault it is, for programs that act on it.
    also : tuple of CaseError
        What is wrong beside it in the same part.
    """

    def __init__(
        self,
        source: str,
        field: str,
        value: object,
        expected: str,
        fault: Fault | None = None,
        also: tuple[CaseError, ...] = (),
    ) -> None:
        self.source, self.field, self.value, self.expected, self.fault = source, field, value, expected, fault
        self.also = also
        where = f"{source}: {_cut(visible(field))}" if field else source
        super().__init__(f"{where} is {_in_file(value)}; expected {expected}{'' if expected.endswith('?') else '.'}")

    def __reduce__(self) -> tuple[type[CaseError], tuple[Any, ...]]:
        """Made again from its fields, so that another process can send it back."""
        return type(self), (self.source, self.field, self.value, self.expected, self.fault, self.also)


#: In place of a value, where an error has no single one to show.
_NO_VALUE = object()


class ModelError(EppError):
    """A model that has no well-defined solution: improper, singular, negative where it must be positive.

    Parameters
    ----------
    what : str
        What is wrong: the model whose `field` has the value, the quantity that has it, or a clause that says it all.
    value : object, optional
        What was found [SI].
    expected : str
        What was expected in its place; empty where `what` is a whole sentence.
    field : str
        Field of the model that is meant, as its class calls it; empty where it is none, or several.
    beside : (str, object), optional
        Another field that `expected` ends with, and its value [SI].
    fault : Fault, optional
        What kind of fault it is, for programs that act on it.

    Examples
    --------
    >>> from eppanalysis import ModelError
    >>> given = {"field": "upper", "beside": ("lower", 2.0)}
    >>> print(ModelError("Saturation", 1.0, "more than lower", **given))
    Saturation: upper is 1.0; expected more than lower (2.0).
    >>> print(ModelError("The system has 2 inputs", expected="signals by name"))
    The system has 2 inputs; expected signals by name.
    """

    def __init__(
        self,
        what: str,
        value: object = _NO_VALUE,
        expected: str = "",
        *,
        field: str = "",
        beside: tuple[str, object] | None = None,
        fault: Fault | None = None,
    ) -> None:
        self.what, self.value, self.expected, self.field = what, value, expected, field
        self.beside, self.fault = beside, fault
        super().__init__(f"{self.found}; expected {self.wanted()}." if expected else what)

    @property
    def has_value(self) -> bool:
        """Whether it shows a value, which shows what is wrong."""
        return self.value is not _NO_VALUE

    @property
    def found(self) -> str:
        """What was found, as a clause."""
        if not self.has_value:
            return self.what.removesuffix(".")
        return (
            f"{self.what}: {self.field} is {shown(self.value)}" if self.field else f"{self.what} is {shown(self.value)}"
        )

    def wanted(self, written: Callable[[str, object], object] = lambda _, value: value) -> str:
        """What was expected; `written` gives the other field's value as a user wrote it."""
        if self.beside is None:
            return self.expected
        other = written(*self.beside)
        return f"{self.expected} ({other if isinstance(other, str) else shown(other)})"

    def __reduce__(self) -> tuple[Any, ...]:
        """Made again from its fields, so that another process can send it back."""
        value = () if self.value is _NO_VALUE else (self.value,)
        named = {name: getattr(self, name) for name in ("expected", "field", "beside", "fault")}
        return partial(type(self), **named), (self.what, *value)


class ArgumentError(EppError):
    """An argument that is not as expected, which the command line calls by its option.

    Parameters
    ----------
    name : str
        What Python calls it.
    said : str
        The sentence from behind the name on.
    who : str, optional
        The function.

    Examples
    --------
    >>> from eppanalysis.errors import ArgumentError
    >>> error = ArgumentError("starts", " is 0; expected 1 or more.", "design")
    >>> print(error, error.of("--starts"))
    design: starts is 0; expected 1 or more. --starts is 0; expected 1 or more.
    """

    def __init__(self, name: str, said: str, who: str = "") -> None:
        self.name, self.said, self.who = name, said, who
        super().__init__(f"{who}: {self.of(name)}" if who else self.of(name))

    def of(self, called: str) -> str:
        """The sentence with another name."""
        return f"{called}{self.said}"

    def __reduce__(self) -> tuple[type[ArgumentError], tuple[str, ...]]:
        """Made again from its parts, so that another process can send it back."""
        return type(self), (self.name, self.said, self.who)


class NotConverged(EppError):
    """Raised by ``require_converged()`` on a result whose status is not a success."""
