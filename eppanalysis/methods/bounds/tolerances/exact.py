"""Exact bounds in a box of tolerances: their elasticities lead from corner to corner."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from eppanalysis.arrays import Array, BoolArray
from eppanalysis.errors import EppError
from eppanalysis.methods.bounds.balanced import BalancedSweep, BoundProblem
from eppanalysis.methods.bounds.elasticity import exact_slopes
from eppanalysis.methods.bounds.exact import of_balance
from eppanalysis.methods.bounds.result import Finding
from eppanalysis.methods.bounds.tolerances.box import Box, Place
from eppanalysis.methods.bounds.verify import PERIODS
from eppanalysis.methods.continuation.steps import BranchPoint
from eppanalysis.methods.orbits.exact import steady_hybrid
from eppanalysis.methods.simulation.batch import HybridStack, simulate_batch
from eppanalysis.models.systems.hybrid import HybridSystem
from eppanalysis.models.systems.subject import CaseLike
from eppanalysis.results import LimitCycle, Status
from eppanalysis.results.deferred import Deferred

_MOST_CORNERS = 8
#: Sizes of the orbit at the nominal bound from which the runs of a draw begin, and points on it.
_SIZES, _POINTS = (1.0, 1.3, 1.8, 2.5), 2


@dataclass(eq=False)
class ExactBox(Box):
    """Exact bounds in the box: each place of it is a question like the nominal one."""

    sweep: BalancedSweep
    orbit: LimitCycle  # at the nominal bound

    @classmethod
    def of(cls, question: BoundProblem, widths: dict[str, float], sweep: BalancedSweep | None) -> ExactBox:
        """The box round a case, with its nominal bound.

        Raises
        ------
        EppError
            If there is none.
        """
        sweep = sweep or BalancedSweep(question)
        bound = sweep.bound_of(question)
        if bound.fold is None or bound.finding is not Finding.BOUND:
            raise EppError(f"{question.case.name}: {bound.finding.sentence}")
        exact = of_balance(question, bound)
        if exact.cycle is None or exact.point is None:
            raise EppError(f"{question.case.name}: the bound on {question.limit} was not corrected: {exact.message}.")
        centre = Place((0.0,) * len(widths), exact.value, _slopes(question, exact.point, widths))
        return cls(question, widths, bound.sign, centre, sweep, exact.cycle)

    def exact(self, place: tuple[float, ...]) -> Place | None:
        """The exact bound at a place; None where it is not found, or has another side."""
        question = self.at(place)
        bound = self.sweep.bound_of(question)
        if bound.fold is None or (bound.finding, bound.sign) != (Finding.BOUND, self.sign):
            return None
        found = of_balance(question, bound)
        if found.cycle is None:
            return None
        return Place(place, found.value, _slopes(question, found.point, self.widths))

    def worst(self) -> tuple[Place, str, int]:
        """The corner with the worst bound, what is missing, and the number of corners checked besides."""
        # Where the bound is monotone in each parameter it is worst at the corner to which its slopes point; they are
        # computed anew at every corner, until it points to itself.
        here, seen = self.centre, set()
        for _ in range(_MOST_CORNERS):
            corner = self._downhill(here)
            if corner in seen:
                break
            seen.add(corner)
            found = self.exact(corner)
            if found is None:
                return here, "the worst corner could not be reached; the last bound is given", 0
            here = found
        message = "" if self._downhill(here) == here.place else "the bound is not monotone over the box"
        # Slopes know their own corner: where the bound is not monotone another one may be worse.
        n_corners = 0
        for corner in self._corners(here.place):
            found = self.exact(corner) if corner != here.place else None
            n_corners += found is not None
            if found is not None and self.sign * (found.value - here.value) < 0:
                here = found
        return here, message, n_corners

    def _oscillating(self, cases: Sequence[CaseLike], values: Array, threads: int) -> BoolArray:
        """Which cases have a run that does not come to rest, at their values of the bounded parameter."""
        starts: list[list[HybridSystem]] = []
        for case, value in zip(cases, values.tolist(), strict=True):
            changed = case.with_values({self.question.limit: value})
            starts.append(self._starts(steady_hybrid(changed.to_system(), changed.operating_point)))
        names, moving = self.question.case.to_system().signals.names, np.zeros(len(cases), bool)
        for column in zip(*starts, strict=True):
            # One run that oscillates tells: the others of its case need not be made.
            still = np.flatnonzero(~moving)
            if still.size:
                stack = HybridStack.of([column[i] for i in still], names)
                result = simulate_batch(stack, PERIODS * self.orbit.period, threads=threads)
                moving[still] = [s is Status.LIMIT_CYCLE for s in result.status]
        return moving

    def _starts(self, base: HybridSystem) -> list[HybridSystem]:
        """The system on and around the orbit at the nominal bound."""
        n = base.n_plant
        # At its bound a stable cycle meets an unstable one; beyond
        # it the stable one is larger, and is reached from outside.
        corners = self.orbit.event_states
        centre = corners.mean(axis=0)
        chosen = corners[:: max(1, len(corners) // _POINTS)][:_POINTS]
        out = []
        for size, corner in itertools.product(_SIZES, chosen):
            x0 = base.x0.copy()
            x0[:n] = np.where(base.compared[:n], centre + size * (corner - centre), x0[:n])
            out.append(replace(base, x0=x0))
        return out


def _slopes(question: BoundProblem, point: BranchPoint | None, names: Iterable[str]) -> Mapping[str, float]:
    """Derivative of an exact bound by parameters [SI]; at most corners the bound alone is computed."""
    sizes = {name: abs(question.case.value(name)) for name in names}
    return {} if point is None else Deferred(partial(exact_slopes, question, point, sizes))
