"""Bounds in a box of tolerances where the search for limit cycles says them, as in loops with samples.

Such a bound has no derivative. How it moves with each parameter is shown by runs from the cycles that are known beyond
the nominal bound, to both ends of its tolerance; with them the corners in the most influential parameters are ranked,
the search gives the bound at the worst one, and says of the others whether nothing but rest is found there.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from eppanalysis.arrays import Array, BoolArray
from eppanalysis.errors import EppError
from eppanalysis.methods.bounds.balanced import BoundProblem
from eppanalysis.methods.bounds.result import BoundCell, Finding
from eppanalysis.methods.bounds.searched import SearchedProblem, bound_by_runs, oscillates, searched_cell
from eppanalysis.methods.bounds.tolerances.box import Box, Place
from eppanalysis.models.systems.subject import CaseLike
from eppanalysis.results import LimitCycle


@dataclass(eq=False)
class SearchedBox(Box):
    """Bounds in the box that the search says."""

    asking: SearchedProblem
    cycles: tuple[LimitCycle, ...]  # beyond the nominal bound
    cells: list[BoundCell]  # all that were searched

    @classmethod
    def of(cls, question: BoundProblem, widths: dict[str, float], asking: SearchedProblem) -> SearchedBox:
        """The box round a case, with its nominal bound.

        Raises
        ------
        EppError
            If there is none, or no cycle was found beyond it.
        """
        cell = searched_cell(question, float("nan"), asking)
        if cell.finding is not Finding.BOUND or cell.other_orbit is None:
            raise EppError(f"{question.case.name}: {cell.message}")
        beyond = asking.answer(question, cell.other_value, [cell.other_orbit]).cycles or (cell.other_orbit,)
        centre = Place((0.0,) * len(widths), cell.bound, {})
        box = cls(question, widths, cell.sign, centre, asking, beyond, [cell])
        box.centre = replace(centre, slopes=box._slopes())
        return box

    @property
    def not_covered(self) -> str:
        """What the bounds do not cover, in a sentence."""
        return f"{self.asking.not_covered(self.cells)} Only the corners of the tolerances were searched."

    def worst(self) -> tuple[Place, str, int]:
        """The corner with the worst bound, what is missing, and the number of corners checked besides."""
        corners = sorted(self._corners(self._downhill(self.centre)), key=lambda c: self.sign * self._by_runs(c))
        here, at_once = self.centre, replace(self.asking, first=True)
        for k, corner in enumerate(corners):
            question = self.at(corner)
            if k and at_once.answer(question, here.value, self.cycles).free:
                continue
            cell = searched_cell(question, float("nan"), self.asking)
            if cell.finding is not Finding.BOUND:
                values = self.values(corner).items()
                at = ", ".join(f"{name} {self.question.case.text(name, value)}" for name, value in values)
                return here, f"at {at} no bound was found within the range", k
            self.cells.append(cell)
            if k == 0 or self.sign * (cell.bound - here.value) < 0:
                here = Place(corner, cell.bound, {})
        return here, "", len(corners) - 1

    def _slopes(self) -> dict[str, float]:
        """How the bound moves with each parameter, from runs at both ends of its tolerance."""
        found = {}
        for i, (name, width) in enumerate(self.widths.items()):
            ends = [tuple(side * float(k == i) for k in range(len(self.widths))) for side in (-1.0, 1.0)]
            low, high = map(self._by_runs, ends)
            found[name] = (high - low) / (2.0 * width)
        return found

    def _by_runs(self, place: tuple[float, ...]) -> float:
        """The bound at a place as runs from the known cycles have it."""
        return bound_by_runs(self.at(place), self.cycles, self.sign, self.asking, 0.5 * self.asking.margin)[0]

    def _oscillating(self, cases: Sequence[CaseLike], values: Array, threads: int) -> BoolArray:
        """Which cases have a run that does not come to rest, at their values of the bounded parameter."""
        pairs = zip(cases, values.tolist(), strict=True)
        there = (case.with_values({self.question.limit: value}) for case, value in pairs)
        return np.array([oscillates(case, self.cycles, self.asking) for case in there], bool)
