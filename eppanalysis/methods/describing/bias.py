"""The mean of a piecewise-linear element's input over amplitude, where the static balance has one answer alone.

With one piecewise-linear element the static balance is one equation ``on_bias b + on_mean mean(a, b) = prescribed``.
Where every slope of the element turns it the same way (any monotone element behind an integrator, any one in negative
feedback), its left side rises, or falls, with b throughout: one mean for each amplitude, and a bracket finds it,
however many breakpoints there are and wherever the loop is. It may be level only where the oscillation stays on
pieces without slope; the gain is zero there, and no cycle lies there.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from eppanalysis.arrays import Array, BoolArray
from eppanalysis.methods.describing.balance import Balance
from eppanalysis.models.elements.phases import distances
from eppanalysis.roots import between

_ROUNDING = 1e-13
_HALVINGS = 120


def spread(count: int) -> Array:
    """Nodes on both sides of an amplitude at which a breakpoint is reached, relative to it.

    The gain rises like a root there. Of many breakpoints each has fewer.
    """
    steps = np.geomspace(1e-12, 0.3, int(np.clip(1500 // max(count, 1), 9, 36)))
    return np.concatenate([-steps[::-1], steps])


def goes_one_way(balance: Balance) -> bool:
    """Whether each slope of a loop's one element makes the static balance go the same way over the bias."""
    on_bias, on_mean = float(balance.on_bias[0, 0]), float(balance.on_mean[0, 0])
    slopes = balance.system.elements[0].slope_bounds()
    turns = [on_bias + (on_mean * slope if on_mean else 0.0) for slope in slopes]
    return (min(turns) >= 0 or max(turns) <= 0) and any(turns)


@dataclass(frozen=True, eq=False)
class SingleBias:
    """The only mean of the input at each amplitude."""

    balance: Balance  # of a loop with one piecewise-linear element
    edges: Array  # (k,): breakpoints

    @classmethod
    def of(cls, balance: Balance) -> SingleBias | None:
        """None where the static balance may have several answers, or the element is not piecewise linear."""
        element = balance.system.elements[0]
        if not element.breakpoints.size:
            return None
        return cls(balance, element.breakpoints) if goes_one_way(balance) else None

    def at(self, amplitude: Array) -> Array:
        """Means (n,) for amplitudes (n,); not-a-number where no mean balances (the element cannot give what is needed).

        Where several do, as the oscillation stays on level pieces, it is one of them.
        """
        out = np.full(amplitude.size, self.standing)
        todo = np.flatnonzero(self._excess(amplitude, out) != 0)
        if todo.size:
            a = amplitude[todo]
            out[todo] = between(lambda b, i: self._excess(a[i], b), *self._bracket(a, self.standing))
        return out

    @cached_property
    def standing(self) -> float:
        """The mean at rest, where the oscillation is small: the middle of those that balance; zero where none does."""
        width = float(np.ptp(self.edges)) or abs(float(self.edges[0])) or 1.0
        a = np.array([1e-9 * width])
        low, high = self._bracket(a)
        end = self._excess(a, high)
        if not self._excess(a, low) * end < 0:
            return 0.0
        # A level balance is solved by an interval of biases: its two ends are bisected, each from outside.
        ends, side, twice = np.append(low, high), np.append(end, -end), np.repeat(a, 2)
        first, last = _edge(ends, ends[::-1], lambda b: self._excess(twice, b) * side >= 0)
        middle = float(0.5 * (first + last))
        # A breakpoint that so small an oscillation reaches is where the loop is: on the edge of a jump.
        nearest = float(self.edges[np.argmin(np.abs(self.edges - middle))])
        return nearest if abs(nearest - middle) <= a[0] else middle

    def thresholds(self) -> Array:
        """Amplitudes at which an oscillation about the mean at rest reaches one more breakpoint."""
        far = distances(*(self.edges - self.standing))
        return far[far > 1e-9 * far.max(initial=0.0)]

    def with_turns(self, amplitude: Array) -> Array:
        """Ascending amplitudes, and between them those around the ones at which the oscillation reaches a
        breakpoint.
        """
        mean = self.at(amplitude)
        known = np.isfinite(mean[:-1] + mean[1:]) & (np.diff(amplitude) > 1e-9 * amplitude[:-1])
        added = [amplitude]
        for side in (1.0, -1.0):
            reached = np.searchsorted(self.edges, mean + side * amplitude)
            counts = np.where(known, np.abs(np.diff(reached)), 0)
            step = np.repeat(np.arange(counts.size), counts)
            first = np.minimum(reached[:-1], reached[1:])[step]
            edge = self.edges[first + np.arange(step.size) - np.repeat(np.cumsum(counts) - counts, counts)]
            turn = self._turn(amplitude[step], amplitude[step + 1], edge, side)
            around = turn[:, None] * (1.0 + spread(self.edges.size))
            inside = (around > amplitude[step, None]) & (around < amplitude[step + 1, None])
            added.append(around[inside])
        return np.unique(np.concatenate(added))

    def _turn(self, low: Array, high: Array, edge: Array, side: float) -> Array:
        """Amplitudes between two others at which a balanced oscillation just reaches an edge, so that its mean is
        known.
        """
        return between(lambda a, i: self._excess(a, edge[i] - side * a), low, high)

    def _excess(self, a: Array, b: Array) -> Array:
        """Static balance at points (n,), zero where it holds to rounding."""
        balance = self.balance
        on_bias, on_mean = float(balance.on_bias[0, 0]), float(balance.on_mean[0, 0])
        mean, gain = (v[:, 0] for v in balance.evaluate(a[:, None], b[:, None], np.ones(a.size)))
        out = on_bias * b + on_mean * mean - balance.prescribed[0]
        size = abs(on_bias) * (np.abs(b) + a) + abs(on_mean) * (np.abs(mean) + np.abs(gain) * a)
        return np.where(np.abs(out) <= _ROUNDING * size, 0.0, out)

    def _bracket(self, amplitude: Array, middle: float = 0.0) -> tuple[Array, Array]:
        """Means on either side of what balances, sought outwards from `middle`."""
        half = 1e-3 * (
            np.min(np.diff(self.edges), initial=np.inf if self.edges.size > 1 else abs(self.edges[0])) + amplitude
        )
        for _ in range(70):
            low, high = middle - half, middle + half
            open_ = self._excess(amplitude, low) * self._excess(amplitude, high) > 0
            if not open_.any():
                break
            half = np.where(open_, 4.0 * half, half)
        return low, high


def _edge(outside: Array, inside: Array, there: Callable[[Array], BoolArray]) -> Array:
    """Where a condition that holds at `inside` and not at `outside` begins to hold."""
    for _ in range(_HALVINGS):
        middle = 0.5 * (outside + inside)
        yes = there(middle)
        outside, inside = np.where(yes, outside, middle), np.where(yes, middle, inside)
    return inside
