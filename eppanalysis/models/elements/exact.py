"""What an element does in exact numbers, as certificates state it: in pieces or by a name, rational numbers alone.

The reader decides which rational number a field of an element means: it is handed in as a function.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from fractions import Fraction
from typing import NamedTuple

#: The rational number that a field means.
Reading = Callable[[float], Fraction]
Place = tuple[Fraction, Fraction]


class Half(NamedTuple):
    """A static element for x > 0: its slope at zero, bends (at, change of slope) and jumps (at, height)."""

    slope: Fraction
    bends: tuple[Place, ...] = ()
    jumps: tuple[Place, ...] = ()


class Pieces(NamedTuple):
    """A static element: for x > 0, and for x < 0 turned about the origin; the same twice where it is odd."""

    positive: Half
    negative: Half


class Named(NamedTuple):
    """An element that goes by a name, with its numbers."""

    kind: str
    numbers: Mapping[str, Fraction]

    @classmethod
    def of(cls, element: object, kind: str, read: Reading, *fields: str) -> Named:
        """With numbers that are fields of the element."""
        return cls(kind, {name: read(getattr(element, name)) for name in fields})


Exact = Pieces | Named
