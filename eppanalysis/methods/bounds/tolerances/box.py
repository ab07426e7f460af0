"""The box of tolerances round a case, and the bounds of draws from it by runs."""

from __future__ import annotations

import itertools
import math
from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from eppanalysis.arrays import Array, BoolArray
from eppanalysis.methods.bounds.balanced import BoundProblem
from eppanalysis.models.systems.subject import CaseLike
from eppanalysis.progress import Progress

#: First half-width of the bracket of a draw's bound, relative to what the elasticities predict; halvings of it.
_BRACKET, _HALVINGS = 0.08, 5
#: Rounds of runs: how often the end of a bracket is tried, and with its halvings.
_ENDS = 2
ROUNDS = _ENDS + _HALVINGS
#: Most influential parameters, in all corners of which the worst case is checked.
_CHECKED = 3


@dataclass(frozen=True, eq=False)
class Place:
    """A bound at a place of the box (-1 .. 1 in every parameter)."""

    place: tuple[float, ...]
    value: float
    slopes: Mapping[str, float]


@dataclass(eq=False)
class Box(ABC):
    """The box of tolerances round a case, and the bounds in it; lives for one call."""

    question: BoundProblem
    widths: dict[str, float]
    sign: float
    centre: Place

    @property
    def not_covered(self) -> str:
        """What the bounds do not cover, in a sentence; empty where they are exact."""
        return ""

    @abstractmethod
    def worst(self) -> tuple[Place, str, int]:
        """The corner with the worst bound, what is missing, and the number of corners checked besides."""

    @abstractmethod
    def _oscillating(self, cases: Sequence[CaseLike], values: Array, threads: int) -> BoolArray:
        """Which cases have a run that does not come to rest, at their values of the bounded parameter."""

    def values(self, place: Sequence[float]) -> dict[str, float]:
        """Parameters at a place [SI]."""
        case = self.question.case
        return {name: case.value(name) + s * width for (name, width), s in zip(self.widths.items(), place, strict=True)}

    def at(self, place: Sequence[float]) -> BoundProblem:
        """The question at a place."""
        return replace(self.question, case=self.question.case.with_values(self.values(place)))

    def _downhill(self, here: Place) -> tuple[float, ...]:
        """The corner to which the elasticities point; a parameter without influence stays where it is."""
        out = []
        for name, place in zip(self.widths, here.place, strict=True):
            slope = here.slopes.get(name, 0.0) * self.sign
            out.append(-math.copysign(1.0, slope) if math.isfinite(slope) and slope else place)
        return tuple(out)

    def _corners(self, place: tuple[float, ...]) -> Iterator[tuple[float, ...]]:
        """A place with all combinations of the ends of those parameters that move the bound most at the centre."""
        influence = [abs(self.centre.slopes.get(n, 0.0)) * w for n, w in self.widths.items()]
        most = sorted(range(len(influence)), key=lambda i: -influence[i])[:_CHECKED]
        return itertools.product(*((-1.0, 1.0) if i in most else (end,) for i, end in enumerate(place)))

    def draws(self, spread: Array, threads: int, tell: Progress) -> tuple[Array, float]:
        """Bounds of draws (n, parameters) by runs, and how far the runs are off at the centre."""
        names = list(self.widths)
        reach = np.array([self.centre.slopes.get(n, 0.0) * self.widths[n] for n in names])
        share = reach / self.centre.value
        # First order in the logarithm: exact for a bound that is a product of powers.
        guesses = self.centre.value * np.exp(np.clip(spread @ np.nan_to_num(share), -2.0, 2.0))
        cases = [self.question.case.with_values(self.values(tuple(row))) for row in spread.tolist()]
        found = self._bracketed([*cases, self.question.case], np.append(guesses, self.centre.value), threads, tell)
        # Runs see stable cycles alone, and only those that they reach: by how much that shifts the nominal bound is
        # taken off every draw (docs/howto/bounds.md).
        offset = float(found[-1] / self.centre.value - 1.0)
        return found[:-1] / (1.0 + offset), offset

    def _bracketed(self, cases: Sequence[CaseLike], guesses: Array, threads: int, tell: Progress) -> Array:
        """Bounds by halving; a guess whose bracket does not hold the bound is widened, twice at most."""
        low, high = guesses * (1.0 - _BRACKET), guesses * (1.0 + _BRACKET)
        safe_end = low if self.sign > 0 else high
        # `safe_end` is `low` or `high` itself. With a run that oscillates
        # there, halving would close in on it and not on the bound.
        wrong = np.arange(len(cases))
        for k in range(_ENDS):
            tell(k, ROUNDS, f"runs of all draws, {k + 1} of {ROUNDS}")
            wrong = wrong[self._oscillating([cases[i] for i in wrong.tolist()], safe_end[wrong], threads)]
            safe_end[wrong] *= 1.0 - self.sign * 2 * _BRACKET
        for k in range(_ENDS, ROUNDS):
            tell(k, ROUNDS, f"runs of all draws, {k + 1} of {ROUNDS}")
            middle = np.sqrt(low * high)
            moving = self._oscillating(cases, middle, threads)
            up = moving if self.sign > 0 else ~moving
            high, low = np.where(up, middle, high), np.where(up, low, middle)
        return low if self.sign > 0 else high
