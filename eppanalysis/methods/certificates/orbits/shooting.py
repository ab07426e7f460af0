"""Multiple shooting in ball arithmetic: Newton's method at high precision, and one step of Krawczyk's test.

Unknown are the states v at the start of every arc that takes time, and the lengths of these arcs. The equations are:
every arc ends on the guard that fires, and the event leads to the start of the next one. With x the last iterate,
Y an approximate inverse of the derivative and X a box about x, the operator

    K(X) = x - Y r(x) + (I - Y r'(X)) (X - x)

lies in the interior of X only if X holds exactly one solution (Krawczyk 1969; Neumaier 1990, theorem 5.1.8).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from eppanalysis.arrays import Array
from eppanalysis.methods.certificates.numbers import NotCovered
from eppanalysis.methods.certificates.orbits.axes import OwnAxes
from eppanalysis.methods.certificates.orbits.path import Closed

#: Relative sizes of the box that are tried, largest first.
_BOXES = tuple(10.0**-k for k in range(3, 16))
#: Steps of Newton's method with a fixed inverse, at most.
_MOST_STEPS = 40
#: A radius of zero is none: as a power of a half.
_SMALLEST = 1000


@dataclass(frozen=True)
class Leg:
    """An arc that takes time with all events up to the next one, in balls."""

    rate: Any
    guard: Any
    jump: Any


@dataclass(frozen=True)
class Enclosure:
    """The one solution in a box."""

    starts: list[Any]  # (m + 1, 1): state behind the events before each arc that takes time
    durations: list[Any]  # length of each of these arcs [s]
    #: radius, unique_within: relative to the size of the motion: of the balls, and of the box in which there is no
    #: other solution.
    radius: Any
    unique_within: Any
    contraction: Any  # bound on the norm of ``I - Y r'`` over that box


class Shooting:
    """The shooting equations of a path.

    Parameters
    ----------
    axes : OwnAxes
        The path, in the unknowns in which it is solved.
    orbit : Closed
        Closed in floats: where Newton's method begins.
    """

    def __init__(self, axes: OwnAxes, orbit: Closed) -> None:
        from flint import arb_mat

        path = axes.path
        self.path, self.m, self.n_legs = path, path.m, len(path.timed)
        self.legs = []
        for place, a in enumerate(path.timed):
            _, through = path.since(path.timed[(place + 1) % self.n_legs])
            stage = path.stages[a]
            self.legs.append(Leg(arb_mat(stage.rate), arb_mat(stage.fired_row), arb_mat(through)))
        timed = np.array(path.timed_events, int)
        # Scales are powers of two, by which balls are multiplied without rounding.
        state, T = np.ones(self.m), float(_power_of_two(np.array(orbit.period)))
        # One row and one column of the equations for each unknown, leg by leg: m states, then the length.
        self.columns = np.tile(np.append(state, T), self.n_legs)
        sizes = [_power_of_two(np.abs(_floats(leg.guard)[0, : self.m]) @ state) for leg in self.legs]
        self.rows = np.concatenate([np.append(state, s) for s in sizes])
        x = np.hstack([axes.starts[timed], orbit.tau[timed][:, None]])
        self.x0 = x.ravel()

    def enclose(self) -> Enclosure:
        """The box about the solution near the orbit in which it is the only one.

        Raises
        ------
        NotCovered
            If the test fails on boxes of every size.
        """
        from flint import arb, arb_mat

        x = [arb(float(v)) for v in self.x0]
        inverse = self._inverse(self._derivative(x, self._flows(x)))
        Y, sizes = arb_mat(inverse.tolist()), arb_mat(np.abs(inverse).tolist())
        x, step = self._newton(x, Y)
        flows = self._flows(x)
        rest = self._rest(Y, self._derivative(x, flows))
        for box in _BOXES:
            contraction = rest + self._contraction(x, flows, sizes, box)
            if contraction < 0.5:
                break
        else:
            raise NotCovered("Krawczyk's test fails: the equations of the cycle are singular, or nearly so.")
        # With the contraction q the operator maps a box of radius R into one of |Y r| + q R: into its interior for
        # twice |Y r|/(1 - q) (docs/theory/proofs.md, Existence and uniqueness).
        radius = (2 * step / (1 - contraction) + arb(2) ** -_SMALLEST).upper()
        if not radius < box:
            raise NotCovered("Newton's method does not come close enough to the cycle for Krawczyk's test.")
        ball = arb(0, 1) * radius
        starts, durations = self._parts([v + ball * float(c) for v, c in zip(x, self.columns, strict=True)])
        return Enclosure(starts, durations, radius, arb(box), contraction)

    def _parts(self, x: list[Any]) -> tuple[list[Any], list[Any]]:
        """States with their 1, and lengths."""
        from flint import arb_mat

        k = self.m + 1
        starts = [arb_mat(k, 1, [*x[i * k : i * k + self.m], 1]) for i in range(self.n_legs)]
        return starts, [x[i * k + self.m] for i in range(self.n_legs)]

    def _flows(self, x: list[Any]) -> list[Any]:
        _, durations = self._parts(x)
        return [(leg.rate * t).exp() for leg, t in zip(self.legs, durations, strict=True)]

    def _residual(self, x: list[Any], flows: list[Any]) -> list[Any]:
        """Start of the next arc less the end of this one, and the guard, leg by leg; each over its size."""
        starts, _ = self._parts(x)
        out = []
        for i, (leg, flow) in enumerate(zip(self.legs, flows, strict=True)):
            end = flow * starts[i]
            miss = starts[(i + 1) % self.n_legs] - leg.jump * end
            out += [*miss.entries()[: self.m], *(leg.guard * end).entries()]
        return [r / float(s) for r, s in zip(out, self.rows, strict=True)]

    def _block(self, i: int, flow: Any, start: Any) -> list[list[Any]]:
        """Derivative of a leg's equations by its own unknowns, scaled."""
        leg, place = self.legs[i], i * (self.m + 1)
        onward = (leg.jump * flow).tolist()
        across = (leg.guard * flow).tolist()[0]
        slope = leg.rate * (flow * start)
        moved, speed = (leg.jump * slope).entries(), (leg.guard * slope).entries()[0]
        # v_next - J e^(F tau) v and g e^(F tau) v, by v and by tau
        # (docs/theory/proofs.md, Existence and uniqueness).
        rows = [[*(-v for v in onward[j][: self.m]), -moved[j]] for j in range(self.m)]
        rows.append([*across[: self.m], speed])
        sizes = self.rows[place : place + self.m + 1].tolist()
        columns = self.columns[: self.m + 1].tolist()
        return [[v * (c / r) for v, c in zip(row, columns, strict=True)] for row, r in zip(rows, sizes, strict=True)]

    def _derivative(self, x: list[Any], flows: list[Any]) -> Any:
        """Derivative of the equations by the unknowns, both scaled."""
        from flint import arb, arb_mat

        starts, _ = self._parts(x)
        k, size = self.m + 1, len(x)
        entries = [[arb(0)] * size for _ in range(size)]
        for i in range(self.n_legs):
            block = self._block(i, flows[i], starts[i])
            after = ((i + 1) % self.n_legs) * k
            for row in range(k):
                entries[i * k + row][i * k : i * k + k] = block[row]
            for row in range(self.m):
                entries[i * k + row][after + row] += float(self.columns[row] / self.rows[row])
        return arb_mat(entries)

    def _inverse(self, derivative: Any) -> Array:
        """Approximate inverse of the scaled derivative, in floats."""
        try:
            inverse = np.linalg.inv(_floats(derivative))
        except np.linalg.LinAlgError:
            inverse = np.full((1, 1), np.nan)
        if not np.all(np.isfinite(inverse)):
            raise NotCovered("Krawczyk's test fails: the equations of the cycle are singular.")
        return np.asarray(inverse, float)

    def _newton(self, x: list[Any], Y: Any) -> tuple[list[Any], Any]:
        """The last iterate, of points, and a bound on the size of its own step."""
        from flint import arb_mat

        size, best = len(x), None
        # Iterates are points, whose errors need not be carried: the residual of the last one is bounded by itself.
        # Where a step is no longer half the one before, rounding is reached.
        for _ in range(_MOST_STEPS):
            r = arb_mat(size, 1, self._residual(x, self._flows(x)))
            step = (Y * r).entries()
            length = max(abs(v).upper() for v in step)
            if not length.is_finite() or (best is not None and not length < 0.5 * best[1]):
                break
            best = (x, length)
            x = [(v - s * float(c)).mid() for v, s, c in zip(x, step, self.columns, strict=True)]
        if best is None:
            raise NotCovered("Newton's method leaves the cycle at once.")
        return best

    def _rest(self, Y: Any, derivative: Any) -> Any:
        """Bound on the largest row sum of ``I - Y r'`` at a point, by way of the sum of squares."""
        from flint import arb_mat

        rest = Y * derivative - arb_mat(Y.nrows(), Y.nrows(), 1)
        return ((rest * rest.transpose()).trace() * Y.nrows()).sqrt().upper()

    def _contraction(self, x: list[Any], flows: list[Any], sizes: Any, box: float) -> Any:
        """Bound by how much ``Y r'`` differs, over the box of that size about x, from what it is at x.

        `sizes` are the absolute values of Y.
        """
        from flint import arb, arb_mat

        wide = [v + arb(0, 1) * (box * float(c)) for v, c in zip(x, self.columns, strict=True)]
        (points, _), (starts, _) = self._parts(x), self._parts(wide)
        spread = arb(0, 1) * (box * float(self.columns[self.m]))
        change = []
        for i, leg in enumerate(self.legs):
            at_x = self._block(i, flows[i], points[i])
            over = self._block(i, flows[i] * (leg.rate * spread).exp(), starts[i])
            for one, other in zip(at_x, over, strict=True):
                change.append(sum((abs(b - a).upper() for a, b in zip(one, other, strict=True)), arb(0)))
        return max(v.upper() for v in (sizes * arb_mat(len(x), 1, change)).entries())


def _floats(matrix: Any) -> Array:
    return np.array([[float(v.mid()) for v in row] for row in matrix.tolist()])


def _power_of_two(sizes: Any) -> Any:
    """The power of two next to each size, so that scaling does not round."""
    sizes = np.asarray(sizes, float)
    return np.exp2(np.round(np.log2(np.where(sizes > 0, sizes, 1.0))))
