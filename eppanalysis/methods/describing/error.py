"""The error that the DF makes, from balances of higher order that are begun at its cycle.

Harmonics up to 25 are let into the balance, a few more at each step. What they make of a predicted cycle in the end is
its error, up to the part that the highest of them has left; a cycle that they take away is said to be one that may not
exist. It has been taken away where no balance is found on the way, neither by Newton's method from order to order nor
along the curve on which all harmonics are let in (``harmonic_path``), and where the one that is found is the
neighbour's: a cycle that harmonics are let into slowly keeps the sign of its Jacobian's determinant until it meets
another one, of the other sign, and vanishes with it (a fold; Kuznetsov 2004, section 4.2). And nothing is certain of
one that passes a threshold by less than the harmonics that are still neglected.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextvars import Context
from dataclasses import dataclass, fields, replace
from functools import cached_property

import numpy as np

from eppanalysis.arrays import Array, ComplexArray
from eppanalysis.errors import ModelError
from eppanalysis.methods.describing.balance import Balance
from eppanalysis.methods.describing.quality import Point
from eppanalysis.methods.harmonic.balance import settled
from eppanalysis.methods.harmonic.elements import Unsettled
from eppanalysis.methods.harmonic.loop import Equations, Loop
from eppanalysis.methods.harmonic.path import along_curve
from eppanalysis.methods.harmonic.series import extrema, orders

#: Highest harmonics of the balances, one after the other; odd, as oscillations with like half-waves have no others.
_ORDERS = (3, 5, 9, 15, 25)
#: No higher order is computed once the last one has changed less than this share of the error.
_ENOUGH = 0.05
#: Order to which harmonics are let in at once where the way over low orders ends.
_STRAIGHT = 15
#: Order from which balances may be believed, and the change by the last order up to which they are where higher ones
#: find no end.
_SEEN, _SMALL = 9, 0.05
#: Share of the error that is added to it, for what is above the highest order and does not show.
_MARGIN = 0.02
#: What the orders above the last one may still change, as a multiple of its own change: amplitudes of harmonics that
#: fall as slowly as 1/k**2 leave 1.5 times of it behind order 25.
_REST = 2.0
#: A threshold within so many times the harmonics above the last order counts as not safely passed.
_GRAZES = 4.0
#: Means and even harmonics over the fundamental, below which half-waves are alike.
_LOPSIDED = 1e-9
#: Shares of the harmonics that are let in where all of them at once are too much for Newton's method.
_SHARES = (0.1, 0.3, 0.6, 1.0)


@dataclass(frozen=True, eq=False)
class Estimate:
    """How far a predicted cycle may be off, from balances that are solved when it is first requested."""

    balance: Balance
    point: Point  # the cycle

    @property
    def error(self) -> float:
        """Relative; infinite where the cycle may not exist, nan where no balance of higher order can be set up.

        An element has no exact answer to harmonics then, or none is below half the sample rate. It is the largest of
        the errors in frequency, in the fundamental and in the peak-to-peak of the loop's first signal. How often it
        covers them is in the documentation, "How good is the DF?".
        """
        return self._found[0]

    @property
    def content(self) -> float:
        """Largest root-sum-square of an input's harmonics over the amplitude of the fundamental; nan where unknown."""
        lasts = len(self.oscillations) > 1 and np.isfinite(self.error)
        return self.oscillations[-1].content if lasts else float("nan")

    @property
    def oscillations(self) -> tuple[BalancedOscillation, ...]:
        """The cycle and what harmonics make of it, as far as they have been followed."""
        return self._found[1]

    @cached_property
    def _found(self) -> tuple[float, tuple[BalancedOscillation, ...]]:
        # The first caller does not pay for it from the budget of a search.
        return Context().run(_estimated, self.balance, self.point)


@np.errstate(all="ignore")
def _estimated(balance: Balance, p: Point) -> tuple[float, tuple[BalancedOscillation, ...]]:
    """Relative error of a predicted cycle, and its oscillations."""
    try:
        loop = Loop.with_means(balance.system, balance.static)
    except ModelError:
        return float("nan"), ()
    first = BalancedOscillation.of(balance, loop, p.amplitude, p.phase, p.bias, p.omega)
    if loop.highest(p.omega) < min(_ORDERS):
        return float("nan"), ()
    try:
        found = _refined(first)
        last = found[-1]
        if not _lasts(found):
            return float("inf"), (first, last)
        whole, rest = (np.abs(m.measures / last.measures - 1.0) for m in (first, found[-2]))
    except Unsettled:
        return float("inf"), (first,)
    # docs/how_we_know.md, Does the error estimate cover the error?
    return float(((1.0 + _MARGIN) * whole + _REST * rest).max()), (first, last)


def _lasts(found: list[BalancedOscillation]) -> bool:
    """Whether the last of the balances still is the first one's cycle, and passes no threshold by a hair."""
    first, last = found[0], found[-1]
    # A cycle of the other orientation is the neighbour's, to which Newton's method has leapt from one that vanished
    # (docs/how_we_know.md, When it says "may not exist").
    if len(found) < 3 or _lost(found) or last.orientation != first.orientation:
        return False
    return not last.grazes and first.jumps == last.jumps


@dataclass(frozen=True, eq=False)
class BalancedOscillation:
    """A balanced oscillation: inputs of the elements Z (m, n + 1), in sine phase at the pivot, and omega [rad/s]."""

    loop: Loop
    Z: ComplexArray
    omega: float
    pivot: int

    @classmethod
    def of(
        cls, balance: Balance, loop: Loop, amplitude: Array, phase: Array, bias: Array, omega: float
    ) -> BalancedOscillation:
        """From the unknowns of a DF balance, each of shape (m,)."""
        # From phasors of the DF, of Im(P exp(j omega t)), to coefficients of Re(c exp(j omega t)).
        turned = -1j * amplitude * np.exp(1j * (phase - phase[balance.pivot]))
        return cls(loop, np.column_stack([bias + 0j, turned]), omega, balance.pivot)

    @property
    def order(self) -> int:
        """Highest harmonic."""
        return self.Z.shape[1] - 1

    @property
    def content(self) -> float:
        """Largest root-sum-square of an input's harmonics over its fundamental."""
        sizes = np.abs(self.Z[:, 1:])
        return float((np.sqrt((sizes[:, 1:] ** 2).sum(1)) / sizes[:, 0]).max())

    @cached_property
    def measures(self) -> Array:
        """What an error is measured in: frequency, fundamental and peak-to-peak of the first signal that moves.

        Of the input of the pivot where none does: those of a file may all be constant.
        """
        system = self.loop.system
        W, _ = self.loop.outputs(self._without_overshoot, self.omega)
        response = system.signal_response(self.omega * orders(self.order)[1:])
        c = (response @ W.T[1:, :, None])[..., 0].T
        moves = np.flatnonzero(np.abs(c[:, 0]) > 0)
        series = c[moves[0]] if moves.size else self.Z[self.pivot, 1:]
        sizes = [self.omega, float(np.abs(series[0]))]
        if not (moves.size and np.any(system.signals.D[moves[0]])):  # series of signals that jump overshoot
            _, value = extrema(np.concatenate([[0.0], series])[None])[0]
            sizes.append(float(np.ptp(value)))
        return np.array(sizes)

    @property
    def _without_overshoot(self) -> ComplexArray:
        """The inputs, less the overshoot of a series that jumps where an element would remember it.

        A play straight behind a relay is pushed on by it, however high the order; Lanczos's factors all but end it.
        """
        Z = self.Z.copy()
        Z[self.loop.behind_jumps, 1:] *= np.sinc(np.arange(self.order) / self.order) ** 2
        return Z

    @cached_property
    def orientation(self) -> float:
        """Sign of the determinant of the balance's Jacobian; where half-waves are alike, of that for such oscillations.

        A symmetric oscillation that loses its stability to a pair of lopsided ones does not vanish.
        """
        m, n = self.Z.shape[0], self.order
        equations = Equations(self.loop, n, self.pivot, np.ones(n))
        anchored = self.Z * np.exp(-1j * (np.pi / 2 + np.angle(self.Z[self.pivot, 1])) * orders(n))
        X = equations.pack(anchored, self.omega)
        here = equations.at(X)
        unknowns, rows = equations.scales(X, here.W)
        harmonic = np.concatenate([np.zeros(m), *[orders(n)[1:]] * (2 * m), [1.0]])
        place = np.arange(m)[:, None] * (2 * n + 1) + np.arange(1, n + 1)
        column = np.concatenate([place[:, 0] - 1, place.ravel(), place.ravel() + n, [X.size - 1]])
        # At a pitchfork the whole determinant changes its sign, but a symmetric cycle lives on: among oscillations with
        # like half-waves it does not meet the lopsided ones.
        symmetric = np.all(np.abs(self.Z[:, ::2]).max(1) <= _LOPSIDED * np.abs(self.Z[:, 1]))
        kept = harmonic % 2 == 1 if symmetric else harmonic >= 0
        scaled = (here.jacobian * unknowns / rows[:, None])[:, column]
        return float(np.linalg.slogdet(scaled[np.ix_(kept, kept)])[0])

    @cached_property
    def grazes(self) -> bool:
        """Whether a threshold with a jump is passed, or missed, by less than a few times the neglected harmonics."""
        order = min(3 * self.order, self.loop.highest(self.omega))
        longer = self.loop.continued(self.Z, self.omega, order, min(2, len(self.loop.elements)))
        longer[:, self.order + 1 :] *= _GRAZES
        return self.jumps != replace(self, Z=longer).jumps

    @cached_property
    def jumps(self) -> list[int]:
        """How often each element with jumps switches in a period; one that slides switches as often as it is let to."""
        switches = self.loop.outputs(self.Z, self.omega)[1]
        return [count for count, jumps in zip(switches, self.loop.free_jumps, strict=True) if jumps]

    def along_curve(self, order: int) -> BalancedOscillation | None:
        """The balance of an order to which the curve leads on which harmonics are let in; None where it does not."""
        found = along_curve(self.loop, self.Z, self.omega, self.pivot, order)
        return None if found is None else replace(self, Z=found[0], omega=found[1])

    def with_harmonics(self, order: int, loop: Loop | None = None) -> BalancedOscillation | None:
        """The balance of an order near this one, in this loop or another one; None where Newton's method finds none."""
        loop = self.loop if loop is None else loop
        try:
            start = loop.continued(self.Z, self.omega, order, min(2, len(loop.elements)))
        except Unsettled:
            return None
        found = settled(loop, start, self.omega)
        return None if found is None else BalancedOscillation(self.loop, *found, self.pivot)


@dataclass(frozen=True, eq=False)
class _Muted(Loop):
    """A loop whose harmonics pass the linear part with the factor `share`."""

    share: float = 1.0

    def linear(self, omega: float, n: int) -> ComplexArray:
        """As the loop's own."""
        return self._muted(super().linear(omega, n))

    def linear_and_slope(self, omega: float, n: int) -> tuple[ComplexArray, ComplexArray]:
        """As the loop's own."""
        response, slope = super().linear_and_slope(omega, n)
        return self._muted(response), self._muted(slope)

    def _muted(self, response: ComplexArray) -> ComplexArray:
        response[1:] *= self.share
        return response


def _refined(first: BalancedOscillation) -> list[BalancedOscillation]:
    """A DF cycle and balances of rising order, until they change little.

    Low orders may be far from both the DF and the cycle. Where the way over them ends, all harmonics are let in
    at once, along the curve of balances.
    """
    found = _walk([first], _ORDERS)
    if _lost(found):
        straight = first.along_curve(min(_STRAIGHT, first.loop.highest(first.omega)))
        if straight is not None:
            found = _walk([first, straight], [n for n in _ORDERS if n > straight.order])
    return found


def _walk(begun: list[BalancedOscillation], higher: Sequence[int]) -> list[BalancedOscillation]:
    """Balances of the given orders after those begun, until they change little or two of them fail."""
    found, failed, here = [*begun], False, begun[-1]
    top = here.loop.highest(here.omega)
    for n in sorted({min(n, top) for n in higher}):
        oscillation = here.with_harmonics(n)
        if oscillation is None and here is begun[0] and not failed:
            oscillation = _gently(here, n)
        if oscillation is None and here.order > 1:
            # An order between is a step on the way and no more: how far balances move is judged over whole steps.
            here = here.with_harmonics((here.order + n) // 2) or here
            oscillation = here.with_harmonics(n) if here is not found[-1] else None
        if oscillation is None and failed:
            break
        failed = oscillation is None
        if oscillation is not None:
            here = oscillation
            found.append(oscillation)
            if _done(found):
                break
    return found


def _lost(found: list[BalancedOscillation]) -> bool:
    """Whether balances of rising order end before they have come to something."""
    top = min(_ORDERS[-1], found[0].loop.highest(found[0].omega))
    if _done(found) or 2 * found[-1].order > top:
        return False
    return found[-1].order < _SEEN or _change(found) > _SMALL


def _done(found: list[BalancedOscillation]) -> bool:
    """Whether the last order has changed but a small part of the error, and passes no threshold by a hair."""
    if len(found) < 3 or found[-1].order < _SEEN:
        return False
    whole = float(np.abs(found[0].measures / found[-1].measures - 1.0).max())
    return _change(found) < _ENOUGH * whole and not found[-1].grazes


def _change(found: list[BalancedOscillation]) -> float:
    """Largest relative change of the measures by the last order."""
    return float(np.abs(found[-2].measures / found[-1].measures - 1.0).max())


def _gently(first: BalancedOscillation, order: int) -> BalancedOscillation | None:
    """The balance of an order, with the harmonics let in share by share."""
    here: BalancedOscillation | None = first
    for share in _SHARES:
        muted = _Muted(**{f.name: getattr(first.loop, f.name) for f in fields(first.loop)}, share=share)
        here = here and here.with_harmonics(order, muted)
    return here
