"""The bound on a parameter as a function of others where no fold can be solved for, as in loops with samples.

The search says it once. Everywhere else runs from the cycles that are known beyond it say where they come to rest, and
how that moves with each parameter; the search runs again at the optimum, and what it finds there is added to them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from eppanalysis.errors import EppError
from eppanalysis.methods.bounds.balanced import BoundProblem
from eppanalysis.methods.bounds.exact import ExactBound
from eppanalysis.methods.bounds.result import BoundCell, Finding, Turn
from eppanalysis.methods.bounds.searched import SearchedProblem, bound_by_runs, oscillates, searched_cell
from eppanalysis.methods.bounds.verify import Verification
from eppanalysis.methods.design.bound_curve import BoundCurve
from eppanalysis.methods.design.programme import Place
from eppanalysis.models.systems.subject import CaseLike
from eppanalysis.results import LimitCycle

#: How close runs bring the two sides of a bound, and how far aside a parameter is moved for its slope, of how far it
#: runs.
_CLOSE, _ASIDE = 1e-3, 0.05


@dataclass(eq=False)
class SearchedFrontier(BoundCurve):
    """The bound on a parameter over other ones, by runs from the cycles that the search finds."""

    asking: SearchedProblem = field(default_factory=SearchedProblem)
    cycles: list[LimitCycle] = field(default_factory=list)  # that are not allowed, beyond bounds
    cells: list[BoundCell] = field(default_factory=list)  # all that were searched

    @property
    def is_foretold(self) -> bool:
        """Not so: runs are cheap, and say more."""
        return False

    @property
    def not_covered(self) -> str:
        """What the bounds do not cover, in a sentence."""
        aside = "Parameters beside the optimum were tested by runs alone."
        return f"{self.asking.not_covered(self.cells)} {aside}"

    def _at(self, place: Place) -> ExactBound:
        here, (safe, wanted) = self.here(place), self.ends
        if not self.cycles:
            return self._first(here)
        if not oscillates(here.case_at(wanted), self.cycles, self.asking):
            return ExactBound(wanted, kind=Turn.END)
        value, nearest = bound_by_runs(here, self.cycles, self.sign, self.asking, _CLOSE)
        if value == safe:
            return ExactBound(message=f"cycles exist at both ends of the range of {self.question.limit}")
        cycle = nearest or self.cycles[0]
        return ExactBound(value, cycle.period, cycle, Turn.SEARCH)

    def _first(self, here: BoundProblem) -> ExactBound:
        """The bound at a place by the search, whose cycles lead to the others."""
        wanted = self.ends[1]
        cell = searched_cell(here, float("nan"), self.asking)
        self.cells.append(cell)
        if cell.finding is Finding.NONE or (cell.finding is Finding.BOUND and cell.sign != self.sign):
            return ExactBound(wanted, kind=Turn.END)
        if cell.finding is not Finding.BOUND or cell.other_orbit is None:
            return ExactBound(message=cell.message.rstrip("."))
        found = self.asking.answer(here, cell.other_value, [cell.other_orbit]).cycles
        self.cycles = list(found) or [cell.other_orbit]
        return ExactBound(cell.bound, cell.other_orbit.period, cell.other_orbit, Turn.SEARCH)

    def first_order(self, place: Place) -> float | None:
        """Where the DF says that cycles (that are too large) begin, from the safe end on [SI]; None: nowhere."""
        if place not in self.first:
            self.first[place] = self._first_order(self.here(place))
        return self.first[place]

    def of_bound(self, place: Place, bound: ExactBound, sizes: Mapping[str, float]) -> dict[str, float]:
        """Secants of the bound at a place by parameters with their sizes; nan where one cannot be moved."""
        found = {}
        for name, size in sizes.items():
            here, step = self.here(place), _ASIDE * size
            own = here.case.value(name)
            try:
                below, above = (
                    bound_by_runs(
                        replace(here, case=here.case.with_values({name: own + side * step})),
                        self.cycles,
                        self.sign,
                        self.asking,
                        _CLOSE,
                    )[0]
                    for side in (-1.0, 1.0)
                )
            except EppError:
                found[name] = float("nan")
                continue
            found[name] = (above - below) / (2.0 * step)
        return found

    def add(self, place: Place, value: float, cycles: Sequence[LimitCycle]) -> bool:
        """Cycles that a test found; whether there are any. What was known is computed again."""
        self.cycles += cycles
        self.bounds.clear()
        return bool(cycles)

    def tested(self, place: Place, bound: ExactBound, margin: float, starts: int, seed: int) -> Verification:
        """The bound at a place put to the test by the search on both sides; its runs are those of the search."""
        here = self.here(place)
        safe, other = (bound.value * (1.0 - side * self.sign * margin) for side in (1.0, -1.0))
        known = self.cycles if bound.cycle is None else [bound.cycle, *self.cycles]
        inside = self.asking.answer(here, safe, known)
        beyond = replace(self.asking, first=True).answer(here, other, known)
        orbit = next(iter(beyond.cycles), None)
        missing = [*inside.open_ends]
        if inside.cycles:
            missing.append("the search finds a limit cycle on the safe side")
        if orbit is None:
            missing.append("no limit cycle was found on the other side")
        n_settled = inside.n_runs if inside.free else 0
        return Verification(
            safe, other, inside.n_runs, n_settled, None, inside.cycles, orbit, "; ".join(missing),
            grows=not inside.free,
        )  # fmt: skip

    def at_rest(self, cases: Sequence[CaseLike], cycle: LimitCycle, rng: np.random.Generator) -> int:
        """How many cases come to rest, or to a cycle that is allowed, from the cycles that are known."""
        return sum(not oscillates(case, self.cycles, self.asking) for case in cases)
