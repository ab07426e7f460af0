"""Algebraic loops: what acts straight on itself, and whether it has one answer."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import product

import numpy as np

from eppanalysis.arrays import Array, BoolArray, IntArray
from eppanalysis.errors import AlgebraicLoop, ModelError
from eppanalysis.models.elements.base import Nonlinearity
from eppanalysis.models.systems.signals import slices

#: In place of the slope of a jump, relative to what it is compared with.
_STEEP = 1e9
_MOST = 10


def parts_on_loops(acts: Array) -> IntArray:
    """Numbers of those that act on themselves, straight or through others; a row of `acts` is of what is acted on."""
    return np.flatnonzero(np.diag(reached(acts != 0)))


def reached(acts: BoolArray) -> BoolArray:
    """What acts on what, straight or through others; a row is of what is acted on."""
    reach, steps = acts, 1
    while steps < len(acts):  # each product doubles the number of steps
        reach, steps = reach | (reach.astype(float) @ reach > 0), 2 * steps
    return reach


def acyclic(acts: Array) -> bool:
    """Whether nothing acts on itself, straight or through others."""
    return not len(acts) or not parts_on_loops(acts).size


def no_unique_answer(who: str, parts: Iterable[str], expected: str) -> ModelError:
    """The refusal of a loop that these parts close without one answer."""
    loop = AlgebraicLoop(tuple(dict.fromkeys(parts)))
    what = f"{who}: the algebraic loop through {', '.join(loop.parts)} has no unique answer"
    return ModelError(what, expected=expected, field="connect", fault=loop)


def require_unique(who: str, elements: Sequence[Nonlinearity], names: Sequence[str], D: Array) -> None:
    """Refuse elements that act straight on themselves in a way that has no answer, or several.

    With slopes K between their bounds the loop has one answer where ``det(I - D K)`` has one sign. As it is linear in
    each slope, its signs at the ends of all of them tell.

    Parameters
    ----------
    who : str
        The loop.
    D : array, shape (nz, nw)
        Straight from the elements' outputs to their inputs, without dead time.

    Raises
    ------
    ModelError
        If there is more or less than one answer.
    """
    single = [e for e, el in enumerate(elements) if (el.n_inputs, el.n_outputs) == (1, 1)]
    inputs, outputs = slices([e.n_inputs for e in elements]), slices([e.n_outputs for e in elements])
    D = D[np.ix_([inputs[e].start for e in single], [outputs[e].start for e in single])]
    on = parts_on_loops(D) if len(D) else np.zeros(0, np.int64)
    # Of more there are too many ends: a run then stops at the combination of modes that has no solution.
    if not on.size or on.size > _MOST:
        return
    D = D[np.ix_(on, on)]
    ends = [_finite(elements[single[i]].slope_bounds(), D) for i in on]
    signs = {float(np.sign(np.linalg.det(np.eye(len(on)) - D * np.array(k)))) for k in product(*ends)}
    if signs not in ({1.0}, {-1.0}):
        loop = (names[single[i]] for i in on)
        raise no_unique_answer(who, loop, "a block with states in it, or slopes around it that stay below one")


def _finite(bounds: tuple[float, float], D: Array) -> tuple[float, float]:
    """Slopes with jumps as very steep ones."""
    steep = _STEEP / float(np.abs(D[D != 0]).min())
    return max(bounds[0], -steep), min(bounds[1], steep)
