"""Means of a loop: the static balance of its elements' means, from which the state is eliminated, and the mean state.

Modes at zero that the elements do not see (a free position, say) put no condition on the elements. Ranks are found in
equilibrated coordinates, so that units do not decide them.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from eppanalysis.arrays import Array
from eppanalysis.errors import ModelError
from eppanalysis.models.systems.lure import LureSystem

#: Share of its terms below which a sum of the static balance is rounding.
_REMAINDER = 1e-12
#: The same of a response, in turned states.
CANCELLED = 1e-9


class StaticBalance(NamedTuple):
    """``on_bias @ b + on_mean @ mean = prescribed`` between mean inputs b and mean outputs of the elements."""

    rows: NDArray[np.intp]  # (m,): places of the elements' first inputs among all inputs
    #: on_bias, on_mean, prescribed: (m, m), (m, nw), (m,)
    on_bias: Array
    on_mean: Array
    prescribed: Array

    def solved(self, owner: NDArray[np.intp]) -> StaticBalance | None:
        """The same balance with each equation solved for a mean of one element, in the order of the elements.

        These are mean inputs where possible, as they often are prescribed. None where it cannot be brought there.

        Parameters
        ----------
        owner : int array, shape (nw,)
            Element of each output.
        """
        m = len(self.rows)
        table, of = np.column_stack([*self[1:]]), np.concatenate([np.arange(m), owner])
        solved = np.full(m, -1)
        for columns in (np.arange(m), np.arange(m, of.size)):
            for _ in range(m):
                size = np.abs(table[:, columns]) / np.abs(table).max(1, keepdims=True)
                size[solved >= 0] = size[:, np.isin(of[columns], solved)] = 0.0
                r, c = np.unravel_index(np.argmax(size), size.shape)
                if not size[r, c] > 0:
                    break
                solved[r] = of[columns[c]]
                table[r] /= table[r, columns[c]]
                taken = table[:, [columns[c]]] * table[r]
                taken[r] = 0.0
                table = without_rounding(table - taken, np.abs(table) + np.abs(taken), CANCELLED)
        if np.any(solved < 0):
            return None
        table = np.ascontiguousarray(table[np.argsort(solved)])
        return StaticBalance(self.rows, table[:, :m], table[:, m:-1], table[:, -1])


def static_balance(system: LureSystem, value: Array) -> StaticBalance:
    """Static balance of a system with the external inputs at `value` (nv,).

    Raises
    ------
    ModelError
        If it leaves the means of the elements undetermined or overdetermined.
    """
    rows = np.array([s.start for s in system.input_slices], dtype=np.intp)
    n, m = system.A.shape[0], len(rows)
    A = system.A - (np.eye(n) if system.time_step else 0.0)
    state = np.hstack([A.T, system.C[rows].T]).T
    # Combinations of rates and inputs in which the state cancels: rates vanish at rest, and what these rows say of
    # means is the only condition on them.
    left = _left_null(state, A, system.C[rows])
    if left.shape[0] != m:
        raise ModelError(f"{system.name}: the static balance has {left.shape[0]} equations for {m} means.")
    outputs = np.vstack([system.B, system.D[rows]])
    inputs = np.vstack([system.B_input, system.D_input[rows]])
    constants = np.concatenate([system.constant_state, system.constant_input[rows]])
    on_mean = -without_rounding(left @ outputs, np.abs(left) @ np.abs(outputs))
    forced_size = np.abs(inputs) @ np.abs(value) + np.abs(constants)
    prescribed = without_rounding(left @ (inputs @ value + constants), np.abs(left) @ forced_size)
    # Of an integrator that cancels, in turned states, rounding is left.
    on_bias = without_rounding(left[:, n:], np.abs(left).max(axis=1, keepdims=True))
    sign = _signs(on_bias, on_mean)
    return StaticBalance(rows, sign * on_bias, sign * on_mean, sign[:, 0] * prescribed)


def _signs(on_bias: Array, on_mean: Array) -> Array:
    """The sign of each equation, which a null vector leaves open, shape (m, 1).

    Where a loop integrates, means above zero are balanced below it: then contours do not run along the edge of a region
    in which an element with a dead zone leaves any bias as it is.
    """
    leading = np.where(np.any(on_bias, axis=1), on_bias.sum(1), -on_mean.sum(1))
    return np.where(leading < 0, -1.0, 1.0)[:, None]


def without_rounding(values: Array, terms: Array, share: float = _REMAINDER) -> Array:
    """Sums with zero where the sizes of their terms show them to be rounding."""
    return np.where(np.abs(values) > share * terms, values, 0.0)


def _left_null(state: Array, A: Array, C: Array) -> Array:
    """Rows that annihilate [A; C], found in equilibrated coordinates so that units do not decide ranks.

    Modes at zero that the elements do not see (a free position, say) put no condition on the elements and are dropped.
    """
    n = A.shape[0]
    if n == 0:
        return np.eye(C.shape[0])
    row, column, left, still = _null_spaces(state)
    left = without_rounding(left.T, np.ones(1)) * row
    if not still.size:
        return left
    return _without_hidden(left, A, column[:, None] * _hidden(A, C, column, still))


def _null_spaces(matrix: Array) -> tuple[Array, Array, Array, Array]:
    """Factors of rows and columns that equilibrate a matrix, and what it takes to zero from left and right then."""
    row, column = equilibrate(matrix)
    u, s, vt = np.linalg.svd(row[:, None] * matrix * column)
    rank = int(np.sum(s > 1e-11 * s.max(initial=0.0)))
    return row, column, u[:, rank:], vt[rank:].T


def _hidden(A: Array, C: Array, column: Array, still: Array) -> Array:
    """Motions of modes at zero that the elements do not see, shape (n, k): constant ones, and ramps that lead to these.

    In coordinates of the states with the factors `column` (n,), in which `still` (n, k) are the constant ones.
    """
    A, C = A * column / column[:, None], C * column
    while True:
        # Its rounding would be taken for rates of its own, which would be equilibrated with all others.
        basis = without_rounding(np.linalg.qr(still)[0], np.ones(1))
        # What A takes into directions known to be hidden, unseen by the elements itself, only drifts along them.
        beyond = np.vstack([A - basis @ (basis.T @ A), C])
        _, factor, _, more = _null_spaces(beyond)
        if more.shape[1] <= still.shape[1]:
            return still
        still = factor[:, None] * more


def _without_hidden(left: Array, A: Array, hidden: Array) -> Array:
    """Leave out the rows that only say that a hidden mode must not drift."""
    # A row acts on the rate along a hidden direction h through left[:n] @ h; keep the combinations blind to it.
    acts = left[:, : A.shape[0]] @ hidden
    size = np.abs(left).max(-1)
    u, s, _ = np.linalg.svd(acts / size[:, None])
    rank = int(np.sum(s > 1e-11 * s.max(initial=0.0)))
    keep = u[:, rank:].T / size
    return without_rounding(keep @ left, np.abs(keep) @ np.abs(left))


def equilibrate(matrix: Array) -> tuple[Array, Array]:
    """Row and column factors (powers of two) that bring the largest entries of all rows and columns to about one."""
    row, column = np.ones(matrix.shape[0]), np.ones(matrix.shape[1])
    size = np.abs(matrix)
    for _ in range(6):
        of_rows = _half_way((row[:, None] * size * column).max(1, initial=0.0))
        row = row / of_rows
        of_columns = _half_way((row[:, None] * size * column).max(0, initial=0.0))
        column = column / of_columns
        if np.all(of_rows == 1.0) and np.all(of_columns == 1.0):
            break
    return row, column


def _half_way(largest: Array) -> Array:
    """Roots of largest entries, as powers of two: these scale without rounding. One where there is nothing to scale."""
    return np.asarray(2.0 ** np.round(np.log2(np.where(largest > 0, largest, 1.0)) / 2.0), float)


def mean_state(system: LureSystem, value: Array, bias: Array, mean: Array) -> Array:
    """State at which inputs and outputs of the elements have the given means, shape (n,); hidden modes stay at zero.

    The angle of a drive whose speed is controlled is such a mode: it turns at any speed, which its rate does not tell.
    """
    rows = np.array([s.start for s in system.input_slices], dtype=int)
    n = system.A.shape[0]
    A, C = system.A - (np.eye(n) if system.time_step else 0.0), system.C[rows]
    rates = -(system.B @ mean + system.B_input @ value + system.constant_state)
    inputs = bias - system.D[rows] @ mean - system.D_input[rows] @ value - system.constant_input[rows]
    _, column, _, still = _null_spaces(np.vstack([A, C]))
    if still.size:
        hidden = _hidden(A, C, column, still)
        seen = np.linalg.qr(hidden, mode="complete")[0].T[hidden.shape[1] :] / column
        A, rates = seen @ A, seen @ rates
    matrix, right = np.vstack([A, C]), np.concatenate([rates, inputs])
    # Modes stay at zero that neither rates nor inputs tell.
    return least_solution(matrix, right)


def least_solution(matrix: Array, right: Array) -> Array:
    """Of all solutions of linear equations that of least norm, in coordinates in which units do not decide ranks."""
    row, column = equilibrate(matrix)
    return np.asarray(column * np.linalg.lstsq(row[:, None] * matrix * column, row * right, rcond=1e-11)[0])
