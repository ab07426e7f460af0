"""Letting harmonics into a balance along the curve of its solutions, through its folds.

The harmonics above some order pass the linear part with a factor, the share. At share zero a balance of the lower order
is a solution; the curve of solutions through it is followed by pseudo-arclength (Keller 1977; Seydel 2010, section 4.3)
until the share is one. Where the curve comes back to share zero instead, it does so at another cycle of the lower
order, with which this one vanishes: harmonics then take both away.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from eppanalysis.arrays import Array, ComplexArray
from eppanalysis.methods.harmonic.balance import cycle_of, settled
from eppanalysis.methods.harmonic.elements import Unsettled
from eppanalysis.methods.harmonic.loop import Equations, Loop, inputs_of
from eppanalysis.methods.harmonic.series import orders
from eppanalysis.results import LimitCycle

#: Steps along a curve, the first, longest and shortest of them, in shares and relative changes of the unknowns.
_MOST_STEPS, _FIRST, _LONGEST, _SHORTEST = 80, 0.1, 0.5, 1e-4
_CORRECTIONS, _CLOSE = 6, 1e-8
#: Orders of a balance that is found on a curve, and of the one that says how good it is.
_STRAIGHT, _FINER = 15, 25


@dataclass(frozen=True, eq=False)
class _Place:
    """A point of the curve: unknowns and, at last, the share; the direction of the curve in scaled unknowns."""

    Y: Array
    direction: Array
    sizes: Array


@dataclass(frozen=True, eq=False)
class _Curve:
    """The balances of an order with harmonics above `kept` let in by a share."""

    equations: Equations
    kept: int

    def linearised(self, Y: Array) -> tuple[Array, Array, Array]:
        """Scaled residual (N,), its Jacobian (N, N + 1) by scaled unknowns and share, and sizes of the unknowns."""
        equations = replace(self.equations, weight=self._weight(Y[-1]))
        here = equations.at(Y[:-1])
        unknowns, rows = equations.scales(Y[:-1], here.W)
        loop, n = equations.loop, equations.n
        Z, omega = equations.unpack(Y[:-1])
        let_in = loop.linear(omega, n) * (orders(n)[1:] > self.kept)[:, None, None]
        by_share = equations.residual(np.zeros_like(Z), here.W, let_in)
        # Means close in full at any share.
        by_share[: len(Z)] = 0.0
        full = np.column_stack([here.jacobian * unknowns, by_share]) / rows[:, None]
        return here.residual / rows, full, np.append(unknowns, 1.0)

    def _weight(self, share: float) -> Array:
        return np.where(orders(self.equations.n)[1:] > self.kept, share, 1.0)

    def place(self, Y: Array, along: Array) -> _Place:
        """A point with the direction of the curve there, on the side of `along`."""
        _, full, sizes = self.linearised(Y)
        right = np.zeros(len(Y))
        right[-1] = 1.0
        direction = np.linalg.solve(np.vstack([full, along]), right)
        return _Place(Y, direction / np.linalg.norm(direction), sizes)

    def step(self, here: _Place, length: float) -> _Place | None:
        """The next point of the curve; None where Newton's method does not come back to it from a step so long."""
        Y = here.Y + length * here.direction * here.sizes
        try:
            for _ in range(_CORRECTIONS):
                R, full, sizes = self.linearised(Y)
                away = float(here.direction @ ((Y - here.Y) / here.sizes)) - length
                matrix = np.vstack([full * here.sizes / sizes, here.direction])
                change = np.linalg.solve(matrix, np.append(R, away))
                Y = Y - here.sizes * change
                largest = float(np.abs(change).max())
                # A correction longer than the step leads to another part of the curve, or to another curve.
                if not np.isfinite(largest) or largest > length or Y[-2] <= 0:
                    return None
                if largest < _CLOSE:
                    return self.place(Y, here.direction)
        except (Unsettled, np.linalg.LinAlgError):
            pass
        return None


def let_in(loop: Loop, Z: ComplexArray, omega: float, pivot: int, order: int) -> tuple[ComplexArray, float] | None:
    """Inputs (F, order + 1) and frequency where the curve from a balance has all harmonics up to an order let in.

    Parameters
    ----------
    Z : array, shape (F, kept + 1)
        A balance, with the fundamental of input `pivot` a sine.
    omega : float
        [rad/s].

    Returns
    -------
    (Z, omega) or None
        Near the balance of that order, for Newton's method to finish; None where the curve does not lead there.
    """
    kept = Z.shape[1] - 1
    longer = np.zeros((len(Z), order + 1), complex)
    longer[:, : kept + 1] = Z
    curve = _Curve(Equations(loop, order, pivot, np.ones(order)), kept)
    Y = np.append(curve.equations.pack(longer, omega), 0.0)
    rise = np.zeros(Y.size)
    rise[-1] = 1.0
    try:
        here, length = curve.place(Y, rise), _FIRST
    except (Unsettled, np.linalg.LinAlgError):
        return None
    # The last unknown is the share to which the higher harmonics are let in: from 0, the balance given, to 1. Along the
    # curve it may turn back and come again, where steps in it alone would end.
    for _ in range(_MOST_STEPS):
        there = curve.step(here, length)
        if there is None:
            length /= 4.0
            if length < _SHORTEST:
                return None
            continue
        if there.Y[-1] >= 1.0:
            part = (1.0 - here.Y[-1]) / (there.Y[-1] - here.Y[-1])
            return curve.equations.unpack((here.Y + part * (there.Y - here.Y))[:-1])
        if there.Y[-1] < 0.0:
            return None
        here, length = there, min(1.6 * length, _LONGEST)
    return None


def along_curve(loop: Loop, Z: ComplexArray, omega: float, pivot: int, order: int) -> tuple[ComplexArray, float] | None:
    """The balance of an order to which the curve from another one leads, as :func:`let_in`; None where to none."""
    start = let_in(loop, Z, omega, pivot, order)
    return None if start is None else settled(loop, *start)


def balance_on_curve(loop: Loop, guess: LimitCycle) -> LimitCycle | None:
    """The balance to which the curve leads that begins at the DF near a cycle; None where it leads to none.

    Its estimated error is the change by the next order, of frequency and fundamentals.
    """
    with np.errstate(all="ignore"):
        first = settled(loop, inputs_of(loop, guess)[:, :2], guess.omega)
        if first is None or loop.highest(first[1]) < _FINER:
            return None
        Z, omega = first
        pivot = int(np.flatnonzero(np.abs(Z[:, 1]) > 0)[0])
        found = along_curve(loop, Z, omega, pivot, _STRAIGHT)
        finer = None if found is None else settled(loop, loop.continued(*found, _FINER), found[1])
        if found is None or finer is None:
            return None
        size = np.abs(finer[0][:, 1]).clip(1e-300)
        change = max(float((np.abs(finer[0][:, 1] - found[0][:, 1]) / size).max()), abs(found[1] / finer[1] - 1.0))
        return replace(cycle_of(loop, *finer), error_estimate=change)
