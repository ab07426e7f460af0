"""Newton's method on the equations of a balance, damped where that helps."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from eppanalysis.arrays import Array
from eppanalysis.methods.harmonic.elements import Unsettled
from eppanalysis.methods.harmonic.loop import Equations, Place
from eppanalysis.methods.simulation.budget import spend

_ITERATIONS = 30
_LARGEST_STEP, _SMALLEST_SHARE = 0.5, 1 / 1024
#: Steps of the engine that one linearised balance is worth: at all, and each unknown.
_ITERATE, _UNKNOWN = 800.0, 20.0


@dataclass(frozen=True, eq=False)
class Iterate:
    """A point of Newton's iteration: unknowns, scaled residual, sizes; most that are tried are never solved at."""

    X: Array
    R: Array
    place: Place
    unknowns: Array
    rows: Array

    @classmethod
    def at(cls, equations: Equations, X: Array, sizes: tuple[Array, Array] | None = None) -> Iterate:
        """The equations at a point, scaled by given sizes of unknowns and rows or by those there."""
        spend(_ITERATE + _UNKNOWN * X.size)
        place = equations.at(X)
        unknowns, rows = equations.scales(X, place.W) if sizes is None else sizes
        return cls(X, place.residual / rows, place, unknowns, rows)

    @cached_property
    def solve(self) -> Callable[[Array], Array]:
        """Solver of the scaled Jacobian."""
        return _solver(self.place.jacobian * self.unknowns / self.rows[:, None])

    @property
    def residual(self) -> float:
        """Largest of the scaled residuals."""
        return float(np.abs(self.R).max())


def newton(equations: Equations, X: Array, descend: bool) -> tuple[Iterate, bool, int]:
    """Newton's method with limited steps, with `descend` damped so that the next simplified step shrinks.

    Deuflhard (2004, section 3.3). Where switches appear and vanish on the way there may be no descent; then free steps
    often come through.
    """
    here = Iterate.at(equations, X)
    sizes = here.unknowns, here.rows
    share, small = 1.0, False
    for count in range(1, _ITERATIONS + 1):
        step = -here.solve(here.R)
        largest = float(np.abs(step).max())
        if not np.isfinite(largest):
            return here, False, count
        if largest < 1e-9:
            # Rounding sets a floor: a second small step is the last.
            if largest < 1e-13 or small:
                return here, True, count
            small, here = True, Iterate.at(equations, here.X + sizes[0] * step, sizes)
            continue
        share, small = min(1.0, 2.0 * share, _LARGEST_STEP / largest), False
        trial = _damped(equations, here, step, share, descend)
        if trial is None:
            return here, False, count
        here, share = trial
    return here, False, _ITERATIONS


def _damped(
    equations: Equations, here: Iterate, step: Array, share: float, descend: bool
) -> tuple[Iterate, float] | None:
    """The next point and the share of the step that leads there; None if even a small share does not help."""
    size = float(np.linalg.norm(step))
    while share >= _SMALLEST_SHARE:
        try:
            trial = Iterate.at(equations, here.X + share * here.unknowns * step, (here.unknowns, here.rows))
            shrinks = not descend or np.linalg.norm(here.solve(trial.R)) <= (1.0 - share / 4) * size
            # Judged by the step that would follow from the old Jacobian, as that does not depend on how the equations
            # are scaled against each other; the residual does.
            if trial.X[-1] > 0 and shrinks:
                return trial, share
        except Unsettled:
            pass
        share /= 2
    return None


def _solver(J: Array) -> Callable[[Array], Array]:
    """Solver of a linear system for several right-hand sides; not-a-number where it is singular."""
    from scipy.linalg import lapack

    factors, pivots, singular = lapack.dgetrf(J)
    if singular or not np.all(np.isfinite(factors)):
        return lambda right: np.full_like(right, np.nan)
    return lambda right: lapack.dgetrs(factors, pivots, right)[0]
