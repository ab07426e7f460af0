"""What public functions may be given: every argument is held against its annotation, in this one place.

An annotation says what an argument is; :func:`checked` reads it once and refuses, before the function begins, whatever
is something else, in one sentence that names the argument, what it was, and what was expected. Which values make sense
(a gap is not negative, a list not empty) is for the functions themselves to say.
"""

from __future__ import annotations

import functools
import inspect
import math
import operator
import os
import types
import typing
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from fractions import Fraction
from numbers import Real
from pathlib import Path
from typing import Any, NamedTuple, ParamSpec, TypeVar

import numpy as np
from numpy.typing import NDArray

from eppanalysis.errors import ArgumentError, EppError, ModelError, did_you_mean, shown
from eppanalysis.foreign import line_for

P = ParamSpec("P")
R = TypeVar("R")
Made = TypeVar("Made", bound=type)

#: Items of a sequence or mapping that are looked at.
_MOST_ITEMS = 10_000
#: What numpy calls types of dates and durations.
_TIMES = ("M", "m")
#: A whole number beyond this is no count of anything that fits into a computer, and none that compiled code can hold.
LARGEST_WHOLE = 2**53
#: Sizes of a model's numbers beyond which powers and products of several are no numbers any more, or zero.
_SMALLEST, _GREATEST = 1e-50, 1e50
ORDINARY = f"zero, or a number from {_SMALLEST:g} to {_GREATEST:g} in size"
#: Longest name of a file that systems have.
_LONGEST_NAME = 255
#: Most numbers of an array: what is not one yet (a range) would be made into one before anything else is known of it.
_MOST_NUMBERS = 10**8
_IN_AN_ARRAY = f"at most {_MOST_NUMBERS} of them and none masked"
#: Most of what is counted: of anything, and of what is less (or more) than that.
_MOST_COUNT = 1_000_000
_MOST = {"order": 5000, "workers": 1024, "threads": 1024, "halvings": 50, "seed": LARGEST_WHOLE}


class _Expected(NamedTuple):
    """What an argument must be: the test, and the words for it."""

    holds: Callable[[Any], bool]
    words: str


class _Unknown(type):
    """Names that exist for a type checker alone: their types are known by name."""

    def __getattr__(cls, name: str) -> type:
        if name.startswith("_"):
            raise AttributeError(name)
        return _Unknown(name, (), {})


class _Numbers:
    """In place of numpy's ArrayLike and NDArray in annotations."""

    def __class_getitem__(cls, _: Any) -> type:
        return cls


class _Names(Mapping[str, Any]):
    """The names of a module, and substitutes for those that it imports for a type checker alone."""

    def __init__(self, module: Mapping[str, Any]) -> None:
        self.module = module

    def __getitem__(self, name: str) -> Any:
        if name == "ArrayLike" or name.endswith("Array"):
            return _Numbers
        if name in self.module:
            return self.module[name]
        return getattr(__import__("builtins"), name, None) or _Unknown(name, (), {})

    def __iter__(self) -> Any:
        return iter(self.module)

    def __len__(self) -> int:
        return len(self.module)


def checked(function: Callable[P, R]) -> Callable[P, R]:
    """The function, which refuses arguments that are not what its annotations say.

    Parameters
    ----------
    function : callable
        With annotated parameters; what has no annotation is not looked at.

    Returns
    -------
    callable
        Raises EppError (ModelError where it belongs to a class) in place of whatever a wrong type leads to.

    Examples
    --------
    >>> @checked
    ... def double(number: float) -> float:
    ...     return 2 * number
    >>> double(2)
    4
    >>> double("2")
    Traceback (most recent call last):
        ...
    eppanalysis.errors.EppError: double: number is '2'; expected a number.
    """
    signature = inspect.signature(function)
    bound = _binder(signature)

    @functools.wraps(function)
    def call(*args: P.args, **kwargs: P.kwargs) -> R:
        try:
            given = bound(args, kwargs)
        except TypeError as error:
            raise TypeError(f"{_name_of(function)}: {error}{_meant(signature, kwargs)}") from None
        for name, value in given.items():
            expected = _of_parameter(function, name)
            if expected is not None and not expected.holds(value):
                kind = ModelError if "." in function.__qualname__ else EppError
                place = list(signature.parameters).index(name)
                hint = _in_place_of_another(function, name, value, given) if place < len(args) else ""
                raise kind(_refusal(function, name, value, expected.words + hint))
        # numpy takes no fractions, and nothing here computes with them.
        return function(*map(_as_float, args), **{name: _as_float(value) for name, value in kwargs.items()})

    return call


def in_range(function: Callable[P, R]) -> Callable[P, R]:
    """The function, whose numbers beyond all range are one sentence."""

    @functools.wraps(function)
    def call(*args: P.args, **kwargs: P.kwargs) -> R:
        with numbers_in_range(_name_of(function)):
            return function(*args, **kwargs)

    return call


@contextmanager
def numbers_in_range(what: str) -> Iterator[None]:
    """Refuse in one sentence what computes with numbers beyond all range.

    Raises
    ------
    EppError
        In place of the errors of arithmetic.

    Examples
    --------
    >>> with numbers_in_range("a product"):
    ...     1e200**2
    Traceback (most recent call last):
        ...
    eppanalysis.errors.EppError: a product: numbers beyond all range
    (Numerical result out of range); expected values of ordinary magnitude.
    """
    try:
        yield
    except (ArithmeticError, np.linalg.LinAlgError) as error:
        why = error.args[-1] if error.args else type(error).__name__
        raise EppError(f"{what}: numbers beyond all range ({why}); expected values of ordinary magnitude.") from error


def _as_float(value: Any) -> Any:
    return float(value) if isinstance(value, Fraction) else value


def _binder(signature: inspect.Signature) -> Callable[[tuple[Any, ...], dict[str, Any]], Mapping[str, Any]]:
    """What gives arguments their names as `signature.bind` does, which takes longer than most checks."""
    parameters = signature.parameters
    by_place = [name for name, p in parameters.items() if p.kind is p.POSITIONAL_OR_KEYWORD]
    plain = all(p.kind in (p.POSITIONAL_OR_KEYWORD, p.KEYWORD_ONLY) for p in parameters.values())
    needed = {name for name, p in parameters.items() if p.default is p.empty}

    def bound(args: tuple[Any, ...], kwargs: dict[str, Any]) -> Mapping[str, Any]:
        given = dict(zip(by_place, args, strict=False))
        if kwargs:
            given = {n: given[n] if n in given else kwargs[n] for n in parameters if n in given or n in kwargs}
        if plain and len(given) == len(args) + len(kwargs) and needed <= given.keys():
            return given
        # Too many, too few, one given twice or without a place: the signature says so.
        return signature.bind(*args, **kwargs).arguments

    return bound


def checked_class(made: Made) -> Made:
    """A class whose constructor is :func:`checked`; goes above ``@dataclass``."""
    made.__init__ = checked(made.__init__)  # type: ignore[misc]
    return made


def of_two_sides(first: str, second: str) -> Callable[[Made], Made]:
    """A class of two sides, one field each: a first one alone by its place, which looks like both, is refused.

    Parameters
    ----------
    first, second : str
        The first two fields; goes above ``@dataclass``.

    Examples
    --------
    >>> from eppanalysis.models.elements import Relay
    >>> Relay(2.0)
    Traceback (most recent call last):
        ...
    eppanalysis.errors.ModelError: Relay: low is 2.0 alone; expected both,
    as in Relay(-2.0, 2.0), or
    low by its name.
    """

    def wrap(made: Made) -> Made:
        own = made.__init__  # type: ignore[misc]

        @functools.wraps(own)
        def begin(self: Any, *args: Any, **kwargs: Any) -> None:
            if len(args) == 1 and second not in kwargs:
                side = abs(args[0]) if isinstance(args[0], (int, float)) else 1.0
                example = f"{made.__name__}({-side}, {side})"
                expected = f"both, as in {example}, or {first} by its name"
                raise ModelError(f"{made.__name__}: {first} is {shown(args[0])} alone", expected=expected)
            own(self, *args, **kwargs)

        made.__init__ = begin  # type: ignore[misc]
        return made

    return wrap


def floats(value: Any, name: str, **options: Any) -> NDArray[Any]:
    """An array of floats of what a caller gave, for what is called too often to be :func:`checked`.

    Parameters
    ----------
    name : str
        What it is, for the message.
    **options
        Of :func:`numpy.array`.

    Raises
    ------
    ModelError
        If numpy makes no numbers of it, or they are complex.

    Examples
    --------
    >>> floats([1, 2], "gap").tolist()
    [1.0, 2.0]
    """
    if not is_an_array(value):
        raise ModelError(name, value, f"numbers, {_IN_AN_ARRAY}")
    if getattr(getattr(value, "dtype", None), "kind", "") in _TIMES:  # numpy makes numbers of them in any unit
        raise ModelError(f"{name}: holds dates or durations", expected="numbers")
    if getattr(value, "dtype", None) is not None and np.iscomplexobj(value):  # numpy drops their imaginary parts
        if np.any(np.imag(value)):
            raise ModelError(f"{name}: holds complex numbers", expected="real ones")
        value = np.real(value)
    try:
        return np.array(value, float, copy=options.pop("copy", None), **options)
    except (TypeError, ValueError, OverflowError):
        raise ModelError(name, value, "numbers") from None


def check_counts(who: str, least: Mapping[str, tuple[int, int]]) -> None:
    """Refuse a count that is too small, or larger than anybody means.

    Parameters
    ----------
    who : str
        Whose counts they are, for the message.
    least : mapping of str to (int, int)
        By name: what is given, and the least that may be.

    Raises
    ------
    EppError
        On the first that is less, or more, than it may be.
    """
    for name, (given, at_least) in least.items():
        if given < at_least:
            raise ArgumentError(name, f" is {given}; expected {at_least} or more.", who)
        most = _MOST.get(name, _MOST_COUNT)
        if given > most:
            raise ArgumentError(name, f" is {shown(given)}; expected {most} or less.", who)


def _name_of(function: Callable[..., Any]) -> str:
    return function.__qualname__.removesuffix(".__init__").lstrip("_")


def _meant(signature: inspect.Signature, kwargs: Mapping[str, Any]) -> str:
    """What a name that is no parameter was probably meant to be."""
    wrong = next((name for name in kwargs if name not in signature.parameters), None)
    return "" if wrong is None else f"; {did_you_mean(wrong, signature.parameters)}"


def _refusal(function: Callable[..., Any], name: str, value: object, words: str) -> str:
    """The sentence; of the first argument, for which a neighbour of what is wanted is a likely slip, with a hint."""
    called = _name_of(function)
    words = line_for(value) or words
    if not is_an_array(value):
        words += f", {_IN_AN_ARRAY}"
    if name != next(iter(inspect.signature(function).parameters)) or _is_plain(value):
        return f"{called}: {name} is {shown(value)}; expected {words}{'' if words.endswith('?') else '.'}"
    methods = inspect.getmembers(type(value), inspect.isfunction)
    makers = [
        n for n, m in methods if n.startswith("to_") and m.__annotations__.get("return") == words.rpartition(" ")[2]
    ]
    hint = f"; its {makers[0]}() is one" if makers else ""
    return f"{called}: the first argument is a {type(value).__name__}; expected {words}{hint}."


def _in_place_of_another(function: Callable[..., Any], name: str, value: object, given: Mapping[str, Any]) -> str:
    """The parameter behind its own place that a value fits, as what was probably meant; empty where it fits none."""
    if value is None:  # which fits all that may be left out
        return ""
    names = list(inspect.signature(function).parameters)
    for other in names[names.index(name) + 1 :]:
        fits = None if other in given or not _is_plain(value) else _of_parameter(function, other)
        if fits is not None and fits.holds(value):
            return f"; did you mean {other}={shown(value)}?"
    return ""


def _is_plain(value: object) -> bool:
    return value is None or isinstance(value, (str, bytes, int, float, complex, list, tuple, dict, set))


@functools.cache
def _of_parameter(function: Callable[..., Any], name: str) -> _Expected | None:
    """What a parameter must be; None where nothing is said of it."""
    parameter = inspect.signature(function).parameters[name]
    if parameter.annotation is parameter.empty or parameter.kind in (parameter.VAR_KEYWORD, parameter.VAR_POSITIONAL):
        return None
    annotation = parameter.annotation
    if isinstance(annotation, str):
        annotation = eval(annotation, {}, _Names(inspect.unwrap(function).__globals__))
    return _of(annotation)


def _of(annotation: Any) -> _Expected | None:
    """What an annotation requires; None where anything will do."""
    plain = _PLAIN.get(annotation) if isinstance(annotation, typing.Hashable) else None
    if plain is not None:
        return plain
    origin = typing.get_origin(annotation)
    if origin is not None:
        return _of_generic(origin, typing.get_args(annotation))
    if not isinstance(annotation, type) or annotation in (Any, object) or getattr(annotation, "_is_protocol", False):
        return None
    return _of_class(annotation)


def _of_class(wanted: type) -> _Expected:
    name = wanted.__name__
    words = f"{'an' if name[0] in 'AEIOU' else 'a'} {name}"
    if isinstance(wanted, _Unknown):
        return _Expected(lambda v: any(t.__name__ == name for t in type(v).__mro__), words)
    return _Expected(lambda v: isinstance(v, wanted), words)


def _of_generic(origin: Any, args: tuple[Any, ...]) -> _Expected | None:
    if origin in (typing.Union, types.UnionType):
        return _one_of([_of(a) for a in args])
    if origin is typing.Literal:
        return _Expected(lambda v: isinstance(v, str) and v in args, " or ".join(map(repr, args)))
    if origin is Callable:
        return _Expected(callable, "a function")
    if origin is tuple and args[-1] is not ...:
        return _row([_of(a) for a in args])
    if origin in (Sequence, Iterable, list, tuple):
        return _many(_of(args[0]))
    if origin in (Mapping, dict):
        return _named(_of(args[0]), _of(args[1]))
    return _of(origin)


def _one_of(choices: Sequence[_Expected | None]) -> _Expected | None:
    known = [c for c in choices if c is not None]
    if len(known) < len(choices):
        return None
    if _PLAIN[Path] in known and _PLAIN[str] in known:
        known = [_PATHS.get(c.words, c) for c in known]
    words = [c.words for c in known]
    last = ", or" if any(", " in w for w in words) else " or"
    listed = f"{', '.join(words[:-1])}{last} {words[-1]}"
    return _Expected(lambda v: any(c.holds(v) for c in known), listed)


def _row(places: Sequence[_Expected | None]) -> _Expected:
    def holds(value: Any) -> bool:
        fits = isinstance(value, (tuple, list)) or (isinstance(value, np.ndarray) and value.ndim > 0)
        fits = fits and len(value) == len(places)
        return fits and all(p is None or p.holds(v) for p, v in zip(places, value, strict=True))

    return _Expected(holds, f"{len(places)} values in a row")


def _many(item: _Expected | None) -> _Expected:
    def holds(value: Any) -> bool:
        if (
            isinstance(value, (str, bytes, Mapping))
            or not hasattr(value, "__getitem__")
            or not hasattr(value, "__len__")
        ):
            return False
        if isinstance(value, type) or (isinstance(value, np.ndarray) and (not value.size or not value.ndim)):
            return False
        if not is_an_array(value):
            return False
        return item is None or all(map(item.holds, value[:_MOST_ITEMS]))

    return _Expected(holds, "a sequence" if item is None else f"a sequence, each item {item.words}")


def _named(key: _Expected | None, item: _Expected | None) -> _Expected:
    def holds(value: Any) -> bool:
        if not isinstance(value, Mapping):
            return False
        return all((key is None or key.holds(k)) and (item is None or item.holds(v)) for k, v in value.items())

    return _Expected(holds, "a mapping by name" if item is None else f"a mapping by name, each value {item.words}")


def is_number(value: Any) -> bool:
    """Whether a value is one finite real number: no text, no truth value, no array."""
    return _is_real(value) and math.isfinite(value)


def are_ordinary(values: Any) -> bool:
    """Whether numbers of a model are what `ORDINARY` says, so that what is computed of them is a number, too."""
    sizes = np.abs(np.asarray(values, float))
    return bool(np.all((sizes == 0) | ((sizes >= _SMALLEST) & (sizes <= _GREATEST))))


def _is_real(value: Any) -> bool:
    if type(value) is float:
        return True
    if not isinstance(value, Real) or isinstance(value, bool):
        return False
    try:
        float(value)
    except OverflowError:  # a whole number of hundreds of digits
        return False
    return True


def _is_whole(value: Any) -> bool:
    if isinstance(value, bool | np.bool_):
        return False
    try:
        return abs(operator.index(value)) <= LARGEST_WHOLE
    except TypeError:
        return False


def is_an_array(value: Any) -> bool:
    """Whether numpy may make an array of it: not too large to try, and without masked numbers, which it would take."""
    try:
        return _size(value) <= _MOST_NUMBERS and not np.ma.is_masked(value)
    except RecursionError:  # a list within itself
        return False


def _size(value: Any) -> int:
    """How many numbers an array of it would have, without making one."""
    shape = getattr(value, "shape", None)
    if isinstance(shape, tuple):
        return math.prod(shape)
    if isinstance(value, list | tuple):
        return sum(1 if type(v) is float or type(v) is int else _size(v) for v in value)
    return len(value) if isinstance(value, range) else 1


def _is_array(value: Any) -> bool:
    """Whether numpy makes numbers of it: no texts, no lists of unequal lengths, no objects, nothing without end."""
    try:
        if not is_an_array(value):
            return False
        array = np.asarray(value)
        return array.dtype.kind in "iufb" or (
            array.dtype.kind == "O" and array.size > 0 and bool(array.astype(float).size)
        )
    except (TypeError, ValueError, OverflowError):
        return False


def _may_be_path(value: Any) -> bool:
    """Whether a text, in place of a path, is one that a system looks up: what is none ends in errors of its own."""
    return isinstance(value, str) and "\0" not in value and all(len(n) <= _LONGEST_NAME for n in value.split(os.sep))


#: Where one may be given, by what each is elsewhere.
_PATHS = {
    "a text": _Expected(_may_be_path, "a text"),
    "a path": _Expected(lambda v: isinstance(v, Path) and _may_be_path(str(v)), "a path that a file can have"),
}
_PLAIN: dict[Any, _Expected | None] = {
    float: _Expected(_is_real, "a number"),
    int: _Expected(_is_whole, "a whole number"),
    bool: _Expected(lambda v: isinstance(v, bool | np.bool_), "True or False"),
    str: _Expected(lambda v: isinstance(v, str), "a text"),
    Path: _Expected(lambda v: isinstance(v, Path), "a path"),
    None: _Expected(lambda v: v is None, "None"),
    type(None): _Expected(lambda v: v is None, "None"),
    _Numbers: _Expected(_is_array, "an array of numbers"),
}
