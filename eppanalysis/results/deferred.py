"""What a result knows how to compute, and computes when it is looked at: in one thread, as where it was made."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from functools import cached_property
from typing import Any

import numpy as np

from eppanalysis.workers import one_thread


class Deferred(Mapping[str, Any]):
    """Values by name that are computed when they are first asked for.

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


class WhenAsked:
    """A field that holds a number, or is given a function without arguments that tells it when it is first read.

    Most predictions are never held against their own error, which takes longer to find than they do.
    """

    def __set_name__(self, owner: type, name: str) -> None:
        self._name = name

    def __get__(self, result: object | None, owner: type | None = None) -> float:
        if result is None:
            return float("nan")
        value = vars(result)[self._name]
        if callable(value):
            with one_thread():
                value = vars(result)[self._name] = float(value())
        return float(value)

    def __set__(self, result: object, value: float | Callable[[], float]) -> None:
        vars(result)[self._name] = value
