"""Sets of inputs, rates and memory values of an automaton, by linear inequalities, and what can happen on them.

A point is (inputs z, their rates v, memory values h, output of a sticking mode that is left, of one that is entered,
1). A guard is a row on it, whatever resets have written by then, as a reset is affine. Linear programs tell whether
guards can be positive together.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy.optimize import linprog

from eppanalysis.arrays import Array
from eppanalysis.models.elements.automaton import Automaton, Guard

#: Value of a row, scaled to about one, that is rounding.
ROUNDING = 1e-7
#: How far a scaled point may lie from the origin; points that are looked at to tell whether an output jumps.
_FAR, _POINTS = 1e3, 12
#: What a point's distance from the origin costs beside the height of the rows.
_NEAR = 1e-8
#: What is left of a sum, over its terms, that is rounding.
_CANCELS = 1e-13


class Place(NamedTuple):
    """Where a chain of events has led: the mode, and the memory values there as rows on the point."""

    mode: int
    memory: Array


@dataclass(frozen=True)
class Region:
    """Points of an automaton that obey rows: ``at_most @ point <= 0`` and ``zero @ point == 0``."""

    rules: Automaton
    scale: Array  # (n,): sizes of the entries of a point but the last, about one of which is a threshold
    #: at_most, zero: (k, n + 1)
    at_most: Array
    zero: Array
    begins: Callable[[], None] = lambda: None  # called before each linear program

    @classmethod
    def all_of(cls, rules: Automaton, begins: Callable[[], None] = lambda: None) -> Region:
        """Every point."""
        n = 2 * rules.n_inputs + rules.n_memory + 2 * rules.n_outputs
        whole = cls(rules, np.ones(n), np.zeros((0, n + 1)), np.zeros((0, n + 1)), begins)
        rows = [whole.row(g, whole.place(g.mode), leaves=False) for g in rules.guards]
        return replace(whole, scale=_sizes(np.array(rows).reshape(-1, n + 1)))

    def within(self, *rows: Array) -> Region:
        """The points at which rows are not negative, too."""
        return replace(self, at_most=np.vstack([self.at_most, *(-row for row in rows)]))

    def on(self, *rows: Array) -> Region:
        """The points at which rows are zero, too."""
        return replace(self, zero=np.vstack([self.zero, *rows]))

    def _unit(self, i: int) -> Array:
        return np.eye(1, self.scale.size + 1, i)[0]

    def place(self, mode: int) -> Place:
        """A mode with any memory values."""
        first = 2 * self.rules.n_inputs
        return Place(mode, np.eye(self.scale.size + 1)[first : first + self.rules.n_memory])

    def outputs(self, place: Place, leaves: bool) -> Array:
        """The outputs in a mode as rows, without the part that smooth functions have in them.

        In a sticking mode they are what the loop makes them: a point has them twice, of one that is left and of one
        that is entered.
        """
        n_z, n_h, n_w = self.rules.n_inputs, self.rules.n_memory, self.rules.n_outputs
        mode = self.rules.modes[place.mode]
        rows = np.zeros((n_w, self.scale.size + 1))
        if mode.sticking:
            first = 2 * n_z + n_h + (0 if leaves else n_w)
            rows[:, first : first + n_w] = np.eye(n_w)
            return rows
        rows[:, :n_z] = mode.from_input
        rows[:, -1] = mode.constant
        return _sum(rows, (mode.from_memory, place.memory))

    def row(self, guard: Guard, place: Place, leaves: bool) -> Array:
        """A guard of a mode as a row."""
        n_z = self.rules.n_inputs
        own = np.zeros(self.scale.size + 1)
        own[:n_z], own[n_z : 2 * n_z], own[-1] = guard.on_input, guard.on_rate, guard.constant
        return _sum(own, (guard.on_memory, place.memory), (guard.on_output, self.outputs(place, leaves)))

    def behind(self, guard: Guard, place: Place) -> Place:
        """Where a guard leads, its reset carried out."""
        own = np.zeros_like(place.memory)
        own[:, : self.rules.n_inputs], own[:, -1] = guard.memory_from_input, guard.memory_constant
        return Place(guard.target, _sum(own, (guard.memory_from_memory, place.memory)))

    def rise(self, row: Array) -> Array | None:
        """The rate of a row as one; None where it is none: it hangs on rates, or on what a loop makes the output."""
        n_z = self.rules.n_inputs
        held = slice(2 * n_z, 2 * n_z + self.rules.n_memory)
        if np.any(row[n_z : 2 * n_z]) or np.any(row[held.stop : -1]):
            return None
        rate = np.zeros_like(row)
        rate[n_z : 2 * n_z] = row[:n_z]
        return rate

    def highest(self, rows: Sequence[Array]) -> tuple[float, Array]:
        """The largest value, at most one, that all rows can exceed together, scaled, and a point at which they do.

        It is minus infinity where there is no point.
        """
        self.begins()
        n = self.scale.size
        fixed = self._fixed()
        if fixed is None:
            return -np.inf, np.full(n, np.nan)
        # What the equations fix by themselves is put in first, without the tolerance of the linear programme.
        known = np.append(fixed, 1.0)
        below = [float(row @ np.where(row != 0.0, known, 0.0)) for row in map(self._scaled, rows)]
        if min((value for value in below if value == value), default=0.0) < -ROUNDING:
            return min(value for value in below if value == value), np.full(n, np.nan)
        rising, at_most, zero = (
            np.array([self._scaled(row) for row in part]).reshape(-1, n + 1) for part in (rows, self.at_most, self.zero)
        )
        above = _split(-rising[:, :-1], np.ones(len(rising)))
        held = _split(at_most[:, :-1], np.zeros(len(at_most)))
        # Of all points at which the rows are highest one that is near the origin.
        found = linprog(
            np.append(np.full(2 * n, _NEAR), -1.0),
            A_ub=np.vstack([above, held]), b_ub=np.concatenate([rising[:, -1], -at_most[:, -1]]),
            A_eq=_split(zero[:, :-1], np.zeros(len(zero))), b_eq=-zero[:, -1],
            bounds=[(0.0, _FAR)] * (2 * n) + [(None, 1.0)],
            options={"primal_feasibility_tolerance": 1e-9, "dual_feasibility_tolerance": 1e-9},
        )  # fmt: skip
        if found.status != 0:
            return -np.inf, np.full(n, np.nan)
        reached = np.asarray(found.x)
        return float(reached[-1]), (reached[:n] - reached[n : 2 * n]) * self.scale

    def _fixed(self) -> Array | None:
        """Scaled values of the entries that one equation alone determines, nan of others; None where two differ."""
        fixed = np.full(self.scale.size, np.nan)
        for row in map(self._scaled, self.zero):
            places = np.flatnonzero(row[:-1])
            if places.size == 1:
                value = -row[-1] / row[places[0]]
                if abs(value - fixed[places[0]]) > ROUNDING:
                    return None
                fixed[places[0]] = value
        return fixed

    def _scaled(self, row: Array) -> Array:
        """A row on scaled points whose largest coefficient is one; of a constant its sign."""
        scaled = row * np.append(self.scale, 1.0)
        largest = np.max(np.abs(scaled[:-1]), initial=0.0)
        return np.asarray(scaled / largest) if largest else np.sign(scaled)

    def jumps(self, guard: Guard, before: Place) -> bool:
        """Whether an output jumps at an event anywhere in the region."""
        after, change = self.behind(guard, before), -np.eye(self.rules.n_outputs)
        rows = _sum(self.outputs(after, leaves=False), (change, self.outputs(before, leaves=False)))
        of_smooth = self.rules.modes[after.mode].from_smooth - self.rules.modes[before.mode].from_smooth
        if np.any(guard.impulse):
            return True
        if np.any(of_smooth):
            return self._jumps_with(rows, of_smooth)
        return any(self.highest([sign * row])[0] > ROUNDING for row in rows for sign in (1.0, -1.0))

    def _jumps_with(self, rows: Array, of_smooth: Array) -> bool:
        """Whether outputs jump that smooth functions have a part in: at points in several directions.

        A jump of an analytic function that vanishes at these vanishes throughout.
        """
        rng, n = np.random.default_rng(1), self.scale.size
        for _ in range(_POINTS):
            cut = np.append(rng.normal(size=n) / self.scale, -rng.normal())
            value, point = self.on(cut).highest([])
            if value < 0.0:
                continue
            z = point[: self.rules.n_inputs]
            terms = np.column_stack([rows * np.append(point, 1.0), of_smooth * self.rules.smooth_at(z)])
            if np.any(np.abs(terms.sum(axis=1)) > ROUNDING * np.abs(terms).sum(axis=1)):
                return True
        return False


def _split(coefficients: Array, last: Array) -> Array:
    """Coefficients of the positive and the negative parts of a point, and of what is made as high as can be."""
    return np.column_stack([coefficients, -coefficients, last])


def _sum(own: Array, *products: tuple[Array, Array]) -> Array:
    """A row and products of rows, zero where they cancel but for rounding."""
    total = own + sum(a @ b for a, b in products)
    size = np.abs(own) + sum(np.abs(a) @ np.abs(b) for a, b in products)
    return np.asarray(np.where(np.abs(total) <= _CANCELS * size, 0.0, total))


def _sizes(rows: Array) -> Array:
    """What makes thresholds about one: of each entry the largest at which a guard on it alone switches.

    Entries that guards only compare take the size of what they are compared with.
    """
    coefficients, constants = np.abs(rows[:, :-1]), np.abs(rows[:, -1])
    size = np.zeros(coefficients.shape[1])
    places = range(size.size)
    for j in places:
        read = (coefficients[:, j] > 0) & (constants > 0)
        size[j] = np.max(constants[read] / coefficients[read, j], initial=0.0)
    # An entry without a threshold of its own takes its size from those beside it in a guard, and passes it on once.
    for _ in range(2):
        for j in (j for j in places if size[j] == 0.0):
            beside = coefficients[coefficients[:, j] > 0]
            size[j] = np.max(np.max(beside * size, axis=1, initial=0.0) / beside[:, j], initial=0.0)
    return np.where(size > 0, size, 1.0)
