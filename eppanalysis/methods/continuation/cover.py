"""Which part of a range branches of orbits cover, and why not the rest."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from eppanalysis.arrays import Array
from eppanalysis.results import PlainData

#: Parts of the range that are shorter than this, relative to it, are beneath the least step of a branch.
_LEAST = 1e-6
TURNS = "the branch turns back there (cycles of other branches were not sought)"


@dataclass(frozen=True)
class Gap(PlainData):
    """A part of the given range in which no branch has an orbit.

    Attributes
    ----------
    low, high : float
        [SI]
    why : str
        What ends the branch beside it, and where else orbits were sought, in words.
    turns : bool
        Whether the branch beside it is followed to its end and turns back: then nothing is left to try along it.
    """

    low: float
    high: float
    why: str
    turns: bool

    in_json = "low high why"


def gaps(limits: tuple[float, float], branches: Sequence[tuple[Array, tuple[str, str]]]) -> tuple[Gap, ...]:
    """What branches leave of a range, lowest first.

    Parameters
    ----------
    limits : (float, float)
        The range, its lower end first.
    branches : sequence of (array, (str, str))
        The values of the parameter along each, and how each ends at its first and at its last value.
    """
    least = _LEAST * (limits[1] - limits[0])
    parts = covered([v for v, _ in branches])
    edges = [limits[0], *(edge for pair in parts for edge in pair), limits[1]]
    out = []
    for k, (low, high) in enumerate(zip(edges[::2], edges[1::2], strict=True)):
        if high - low > least:
            beside = [_end(branches, edge) for edge in (low,) * (k > 0) + (high,) * (k < len(parts))]
            why = "; ".join(dict.fromkeys(text for text, _ in beside))
            out.append(Gap(low, high, why, all(turns for _, turns in beside)))
    return tuple(out)


def covered(values: Iterable[Array]) -> list[tuple[float, float]]:
    """The parts of a range that branches with these values of the parameter cover, lowest first.

    Examples
    --------
    >>> covered([np.array([3.0, 2.0]), np.array([0.0, 1.0]), np.array([0.5, 1.5])])
    [(0.0, 1.5), (2.0, 3.0)]
    """
    ends = sorted((float(v.min()), float(v.max())) for v in values if v.size)
    least = _LEAST * (max(high for _, high in ends) - ends[0][0]) if ends else 0.0
    out: list[tuple[float, float]] = []
    for low, high in ends:
        if out and low <= out[-1][1] + least:
            out[-1] = out[-1][0], max(high, out[-1][1])
        else:
            out.append((low, high))
    return out


def _end(branches: Sequence[tuple[Array, tuple[str, str]]], edge: float) -> tuple[str, bool]:
    """How the branch that reaches to an edge ends there, and whether it turns back."""
    for values, (first, last) in branches:
        places = np.flatnonzero(values == edge).tolist()
        if len(values) - 1 in places:
            return f"the branch {last}", False
        if 0 in places:
            return f"the branch {first}", False
    return TURNS, True
