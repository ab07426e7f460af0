"""What a result knows how to compute, and computes when it is looked at: in one thread, as where it was made."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from functools import cached_property
from typing import Any, Generic, TypeVar, cast

import numpy as np

from eppanalysis.workers import one_thread

T = TypeVar("T")


class Deferred(Mapping[str, Any]):
    """Values by name that are computed when they are first requested.

    Most predictions are never drawn and most elasticities never read. What is handed to another process is computed
    before.
    """

    def __init__(self, make: Callable[[], Mapping[str, Any]]) -> None:
        self._make = make

    @cached_property
    def _values(self) -> Mapping[str, Any]:
        with one_thread(), np.errstate(all="ignore"):
            return self._make()

    def __getitem__(self, name: str) -> Any:
        return self._values[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._values)

    def __len__(self) -> int:
        return len(self._values)

    def __repr__(self) -> str:
        return repr(self._values)

    def __reduce__(self) -> tuple[Any, ...]:
        return dict, (dict(self),)


class WhenAsked(Generic[T]):
    """A field that holds a number or a text, or is given a function without arguments that tells it when first read.

    Most predictions are never held against their own error, which takes longer to find than they do, and of most runs
    that are undecided nobody reads what they would come to.
    """

    def __init__(self, default: T) -> None:
        self._default: T = default
        self._kind: Any = type(default)

    def __set_name__(self, owner: type, name: str) -> None:
        self._name = name

    def __get__(self, result: object | None, owner: type | None = None) -> T:
        if result is None:
            return self._default
        value = vars(result)[self._name]
        if callable(value):
            with one_thread():
                value = vars(result)[self._name] = self._kind(value())
        return cast(T, self._kind(value))

    def __set__(self, result: object, value: T | Callable[[], T]) -> None:
        vars(result)[self._name] = value


def unread(result: object, name: str) -> Any:
    """A field :class:`WhenAsked`, for a result that is made of another one: what nobody has read is not computed."""
    return vars(result)[name]
