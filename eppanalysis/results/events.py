"""Switches of the elements on a run or on a cycle; a run has thousands, and most are never looked at."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple, overload

import numpy as np

from eppanalysis.arrays import Array, IntArray


class Event(NamedTuple):
    """One switch of one element.

    Attributes
    ----------
    time : float
        When [s].
    element : str
        Name of the element.
    name : str
        What happened ("contact lost", "sticks", ...).
    mode : str
        The element's mode after it.
    """

    time: float
    element: str
    name: str
    mode: str


class Events(Sequence[Event]):
    """Switches in order of time, which become objects when they are looked at.

    Parameters
    ----------
    times : array, shape (n,)
        [s].
    kinds : int array, shape (n,)
        What happened at each, one of `words`.
    words : mapping of int to (element, name, mode)
    """

    def __init__(self, times: Array, kinds: IntArray, words: Mapping[int, tuple[str, str, str]]) -> None:
        self._times, self._kinds, self._words = times, kinds, words

    def __len__(self) -> int:
        return len(self._times)

    @overload
    def __getitem__(self, place: int) -> Event: ...
    @overload
    def __getitem__(self, place: slice) -> tuple[Event, ...]: ...
    def __getitem__(self, place: int | slice) -> Event | tuple[Event, ...]:
        if isinstance(place, slice):
            return tuple(Events(self._times[place], self._kinds[place], self._words))
        return Event(float(self._times[place]), *self._words[int(self._kinds[place])])

    def __iter__(self) -> Iterator[Event]:
        words = self._words
        return (Event(t, *words[k]) for t, k in zip(self._times.tolist(), self._kinds.tolist(), strict=True))

    def without(self, element: str) -> Events:
        """Those of all other elements."""
        kept = np.isin(self._kinds, [kind for kind, words in self._words.items() if words[0] != element])
        return Events(self._times[kept], self._kinds[kept], self._words)

    def __eq__(self, other: Any) -> bool:
        return isinstance(other, Sequence) and tuple(self) == tuple(other)

    def __hash__(self) -> int:
        return hash(tuple(self))

    def __repr__(self) -> str:
        return repr(tuple(self))
