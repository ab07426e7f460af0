"""The affine modes of a loop in exact rational arithmetic: rates, guards and maps of events.

The engine has these tables in floats (``engine/src/engine/modes.cpp``). Here every float means a rational
number, and from there on nothing is rounded: that a guard is zero behind an event, or that a stuck input does not
creep, is an identity of rows and not a matter of tolerances.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eppanalysis.methods.certificates.numbers import NotCovered, number_of
from eppanalysis.models.systems.hybrid import HybridSystem

Row = list[Any]


def rational(value: float) -> Any:
    """The rational number (fmpq) that a float means; see `numbers.number_of`.

    Raises
    ------
    NotCovered
        If it is not finite.
    """
    from flint import fmpq

    exact = number_of(value)
    return fmpq(exact.numerator, exact.denominator)


def rational_matrix(values: NDArray[Any]) -> Any:
    """A matrix of floats as rationals (fmpq_mat)."""
    from flint import fmpq_mat

    rows, columns = values.shape
    return fmpq_mat(rows, columns, [rational(v) for v in values.ravel().tolist()])


def as_row(values: Sequence[Any]) -> Any:
    """A row (fmpq_mat) of rationals."""
    from flint import fmpq_mat

    return fmpq_mat(1, len(values), list(values))


def beside(*blocks: Any) -> Any:
    """Matrices of as many rows, side by side."""
    from flint import fmpq_mat

    rows = [sum((list(part) for part in parts), []) for parts in zip(*(b.tolist() for b in blocks), strict=True)]
    return fmpq_mat(rows) if rows else fmpq_mat(0, sum(b.ncols() for b in blocks))


@dataclass(frozen=True)
class ExactMode:
    """One combination of modes: all rows are on y, the state with the memory values, the last of which is 1."""

    rate: Any  # (n, N): of the state
    #: inputs, outputs: (z, N), (w, N): of the elements.
    inputs: Any
    outputs: Any
    #: Numbers of the guards, in the order in which they are looked at, with their rows.
    guards: tuple[tuple[int, Any], ...]
    levels: dict[int, Any]  # for each element that sticks: its input less the level that it is kept at


class ExactModes:
    """The modes and events of a hybrid system in rationals, each made when it is requested.

    Parameters
    ----------
    hybrid : HybridSystem
        Without smooth channels and dead time.
    """

    def __init__(self, hybrid: HybridSystem) -> None:
        self.hybrid = hybrid
        self.model = hybrid.model
        self._made: dict[tuple[int, ...], ExactMode] = {}

    @cached_property
    def _tables(self) -> tuple[Any, Any, Any, Any]:
        """Rates [A K], B, inputs [C Kz], D."""
        m = self.model
        on_state = beside(rational_matrix(m.A), rational_matrix(m.K))
        on_input = beside(rational_matrix(m.C), rational_matrix(m.Kz))
        return on_state, rational_matrix(m.B), on_input, rational_matrix(m.D)

    @property
    def n(self) -> int:
        """Number of states, inputs included."""
        return int(self.model.A.shape[0])

    @property
    def size(self) -> int:
        """Length N of y."""
        return self.n + int(self.model.K.shape[1])

    def mode(self, modes: Sequence[int]) -> ExactMode:
        """The affine system of a combination of modes.

        Raises
        ------
        NotCovered
            If it has no unique solution.
        """
        key = tuple(int(k) for k in modes)
        if key not in self._made:
            self._made[key] = self._make(key)
        return self._made[key]

    def _make(self, modes: tuple[int, ...]) -> ExactMode:
        on_state, B, on_input, D = self._tables
        outputs = self._outputs(modes)
        rate, inputs = on_state + B * outputs, on_input + D * outputs
        guards = []
        for e in self.model.order.tolist():
            m = int(self.model.mode_first[e]) + modes[e]
            for g in range(int(self.model.guard_first[m]), int(self.model.guard_first[m + 1])):
                guards.append((g, self._guard(g, rate, inputs, outputs)))
        levels = {e: self.level(e, modes[e]) for e in range(len(modes)) if self.sticks(e, modes[e])}
        return ExactMode(rate, inputs, outputs, tuple(guards), levels)

    def sticks(self, element: int, mode: int) -> bool:
        """Whether an element keeps its input on a level in a mode."""
        return bool(self.model.mode_stick[self.model.mode_first[element] + mode])

    def level(self, element: int, mode: int) -> Any:
        """Row of an element's input less the level of a sticking mode."""
        row = self._tables[2].tolist()[int(self.model.first[element, 0])]
        row[-1] -= rational(self.model.mode_level[self.model.mode_first[element] + mode])
        return as_row(row)

    def pull(self, element: int) -> Any:
        """Rate of an element's input per unit of its output."""
        z, w = (int(v) for v in self.model.first[element, :2])
        c, b = self._tables[2].tolist()[z], self._tables[1].tolist()
        return sum((c[i] * b[i][w] for i in range(self.n)), rational(0.0))

    def _outputs(self, modes: tuple[int, ...]) -> Any:
        """Outputs of the elements on y: of each its mode's equation, where it sticks that its input is constant."""
        from flint import fmpq_mat

        on_state, B, on_input, D = self._tables
        model, n_w = self.model, int(self.model.B.shape[1])
        left = [[rational(float(i == j)) for j in range(n_w)] for i in range(n_w)]
        right = [[rational(0.0)] * self.size for _ in range(n_w)]
        for e, mode in enumerate(modes):
            m = int(model.mode_first[e]) + mode
            (z0, w0, h0), (z1, w1, h1) = (tuple(int(v) for v in model.first[k]) for k in (e, e + 1))
            # What sticks holds its input still: c (A x + B w) = 0 replaces the mode's own equation.
            if model.mode_stick[m]:
                if np.any(model.D[z0]):
                    raise NotCovered("An element sticks whose input another one acts straight on.")
                c = as_row(on_input.tolist()[z0][: self.n])
                left[w0], right[w0] = (c * B).tolist()[0], (-(c * on_state)).tolist()[0]
                continue
            for a in range(w1 - w0):
                gain = self._spread(model.mode_wz[m, a, : z1 - z0], z0, int(model.first[-1, 0]))
                through, onto = (gain * D).tolist()[0], (gain * on_input).tolist()[0]
                left[w0 + a] = [x - y for x, y in zip(left[w0 + a], through, strict=True)]
                for b in range(h1 - h0):
                    onto[self.n + h0 + b] += rational(model.mode_wh[m, a, b])
                onto[-1] += rational(model.mode_w0[m, a])
                right[w0 + a] = onto
        try:
            return fmpq_mat(left).solve(fmpq_mat(right))
        except ZeroDivisionError:
            raise NotCovered("The cycle runs through a combination of modes without a unique solution.") from None

    def _spread(self, values: NDArray[Any], first: int, length: int) -> Any:
        row = [rational(0.0)] * length
        row[first : first + len(values)] = [rational(v) for v in values.tolist()]
        return as_row(row)

    def _guard(self, g: int, rate: Any, inputs: Any, outputs: Any) -> Any:
        """Row of a guard on y, rates put in."""
        model, e = self.model, int(self.model.guard_element[g])
        (z0, w0, h0), (z1, w1, h1) = (tuple(int(v) for v in model.first[k]) for k in (e, e + 1))
        n_z, n_w = int(model.first[-1, 0]), int(model.B.shape[1])
        row = self._spread(model.guard_z[g, : z1 - z0], z0, n_z) * inputs
        row += self._spread(model.guard_w[g, : w1 - w0], w0, n_w) * outputs
        if np.any(model.guard_rate[g]):
            moved = (self._spread(model.guard_rate[g, : z1 - z0], z0, n_z) * inputs).tolist()[0][: self.n]
            row += as_row(moved) * rate
        row += self._spread(model.guard_h[g, : h1 - h0], self.n + h0, self.size)
        return row + self._spread(np.array([model.guard_0[g]]), self.size - 1, self.size)

    def event(self, before: ExactMode, g: int, after: int) -> Any:
        """Map of y by the event of guard `g`, whose element is in the mode `after` behind it (fmpq_mat, N x N)."""
        from flint import fmpq_mat

        model, e, n = self.model, int(self.model.guard_element[g]), self.n
        (z0, w0, h0), (z1, _, h1) = (tuple(int(v) for v in model.first[k]) for k in (e, e + 1))
        J = [[rational(float(i == j)) for j in range(self.size)] for i in range(self.size)]
        for a in range(h1 - h0):
            row = (self._spread(model.reset_z[g, a, : z1 - z0], z0, int(model.first[-1, 0])) * before.inputs).tolist()
            J[n + h0 + a] = row[0]
            for b in range(h1 - h0):
                J[n + h0 + a][n + h0 + b] += rational(model.reset_h[g, a, b])
            J[n + h0 + a][-1] += rational(model.reset_0[g, a])
        # The output has an impulse at the event, by which the states that integrate it jump.
        if np.any(model.guard_impulse[g]):
            kick = self._spread(model.guard_impulse[g, : z1 - z0], z0, int(model.first[-1, 0])) * before.inputs
            for row, weight in zip(J[:n], self._tables[1].tolist(), strict=True):
                row[:] = [v + weight[w0] * k for v, k in zip(row, kick.tolist()[0], strict=True)]
        if self.sticks(e, after):
            self._put_on_level(J, self.level(e, after).tolist()[0], w0)
        return fmpq_mat(J)

    def _put_on_level(self, J: list[Row], level: Row, w: int) -> None:
        """Let the map J end with the input of what sticks on its level, as the engine does."""
        left = (as_row(level) * _matrix(J)).tolist()[0]
        used = [i for i in range(self.n) if level[i] != 0]
        # A level of one state is that state's; else all move along B, as an impulse of this element would move them.
        if len(used) == 1:
            J[used[0]] = [x - y / level[used[0]] for x, y in zip(J[used[0]], left, strict=True)]
            return
        b = [row[w] for row in self._tables[1].tolist()]
        scale = sum((level[i] * b[i] for i in used), rational(0.0))
        for i in range(self.n):
            J[i] = [x - b[i] / scale * y for x, y in zip(J[i], left, strict=True)]


def _matrix(rows: list[Row]) -> Any:
    from flint import fmpq_mat

    return fmpq_mat(rows)


def in_span(row: Any, others: Sequence[Any]) -> bool:
    """Whether a row is a combination of others, exactly."""
    from flint import fmpq_mat

    entries = row.tolist()[0]
    if all(v == 0 for v in entries):
        return True
    if not others:
        return False
    given = [other.tolist()[0] for other in others]
    return bool(fmpq_mat([*given, entries]).rank() == fmpq_mat(given).rank())
