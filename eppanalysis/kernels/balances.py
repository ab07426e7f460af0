"""Compiled: Newton's method for many first-order balances, but for what elements and linear part answer.

What the equations are is in :mod:`eppanalysis.methods.describing.balance`; here are the loops over points, elements and
outputs, which are too short for array operations to be worth their calls.
"""

import math

import numpy as np

from eppanalysis.kernels.compiling import KERNEL, PART, njit
from eppanalysis.kernels.responses import pivot_row

_COMPILED = {**KERNEL, "error_model": "numpy"}
_INNER = {**PART, "error_model": "numpy"}
#: Stands for a pivot of zero in a matrix whose rows are of size one: a huge step, which whoever takes it limits.
_SINGULAR = 1e-13
#: Logarithm or phase beyond which a point has run away.
_FAR = 300.0


@njit(**_COMPILED)
def shift(X, places, pivot, of_outputs, relative, inputs, a, b, omega, steps):
    """Inputs of n points, and the same with amplitude, bias and frequency shifted.

    Parameters
    ----------
    X : array, shape (n, 3 m + 1)
        Unknowns.
    places, of_outputs : int array, shapes (m,), (nw,)
        Of the balance: places of amplitudes, owners of outputs.
    pivot : int
    relative : float
        Step, in units of the amplitude and of the frequency.
    inputs : complex array, shape (n, m)
        Phasors, which are filled as the next ones are.
    a, b, omega : arrays, shapes (m, 4, n), (m, 4, n), (4, n)
        Along the second axis: as it is, then with its amplitude, its bias and the frequency shifted.
    steps : array, shape (3, n, nw)
        By how much, for the element that owns an output.
    """
    m = places.size
    for i in range(len(X)):
        for e in range(m):
            size, mean = math.exp(X[i, places[e]]), X[i, 2 * m + e]
            phase = X[i, places[e] + 1] if e != pivot else 0.0
            inputs[i, e] = complex(size * math.cos(phase), size * math.sin(phase))
            for k in range(4):
                a[e, k, i], b[e, k, i] = size, mean
            a[e, 1, i] = size * (1.0 + relative)
            b[e, 2, i] = mean + (relative * size + 1e-12 * abs(mean))
        for k in range(4):
            omega[k, i] = math.exp(X[i, 1])
        omega[3, i] *= 1.0 + relative
        for j in range(of_outputs.size):
            e = of_outputs[j]
            # The step that is really made: of a small one beside a large bias rounding changes the size.
            steps[0, i, j], steps[1, i, j], steps[2, i, j] = relative, max(b[e, 2, i] - b[e, 0, i], 1e-290), relative


@njit(**_INNER)
def balance_at(x, k, block, places, owner, pivot, static, of_elements, inputs, L, dL, J, R):
    """Residual and Jacobian of one point and a block of elements, of what all elements give the share of number k.

    Other arguments are its shares of those of :func:`assemble`.
    """
    on_bias, on_mean, prescribed = static
    mean, gain, by_mean, by_gain = of_elements
    m, moves = places.size, len(dL) > 0
    # Entries by their indices: a row as an array of its own takes longer than what is done with it.
    for r in block:
        i, s = m + r, 2 * m + r
        for c in range(3 * m + 1):
            J[r, c], J[i, c], J[s, c] = 0.0, 0.0, 0.0
        # By its conjugate: the division that guards against overflow takes as long as all the rest.
        z = inputs[k, r]
        front = (math.exp(x[3 * m]) if r == pivot else 1.0) / (z.real * z.real + z.imag * z.imag)
        total, off = complex(0.0, 0.0), -prescribed[r]
        for j in range(owner.size):
            o, share = owner[j], on_mean[r, j]
            place = places[o]
            if share != 0.0:
                off += share * mean[k, j]
                J[s, place] += share * by_mean[0, k, j]
                J[s, 2 * m + o] += share * by_mean[1, k, j]
                if moves:
                    J[s, 1] += share * by_mean[2, k, j]
            # Of the few outputs of a loop fewer yet act on an input.
            if L[r, j] == 0.0 and not (moves and dL[r, j] != 0.0):
                continue
            # Relative to the input that the response is for.
            turned = inputs[k, o] * complex(front * z.real, -front * z.imag)
            response = L[r, j] * turned
            loop = response * gain[k, j]
            total += loop
            # By the logarithm of an amplitude and by a phase an output changes by itself, and by itself times j:
            # what the slope of the gain adds is all that has to be differenced (docs/theory/index.md, Several
            # elements).
            if o != pivot:
                J[r, place + 1] -= loop.imag
                J[i, place + 1] += loop.real
            by = response * by_gain[0, k, j] + loop
            J[r, place] += by.real
            J[i, place] += by.imag
            by = response * by_gain[1, k, j]
            J[r, 2 * m + o] += by.real
            J[i, 2 * m + o] += by.imag
            if moves:
                by = response * by_gain[2, k, j] + dL[r, j] * turned * gain[k, j]
                J[r, 1] += by.real
                J[i, 1] += by.imag
        J[r, places[r]] -= total.real
        J[i, places[r]] -= total.imag
        if r == pivot:
            J[r, 3 * m], J[i, 3 * m] = total.real, total.imag
        else:
            J[r, places[r] + 1] += total.imag
            J[i, places[r] + 1] -= total.real
        for e in range(m):
            off += on_bias[r, e] * x[2 * m + e]
            J[s, 2 * m + e] += on_bias[r, e]
        R[r], R[i], R[s] = total.real - 1.0, total.imag, off


@njit(**_COMPILED)
def assemble(X, places, owner, pivot, static, of_elements, inputs, L, dL, J, R):
    """Fill the residuals R (n, 3 m) and Jacobians J (n, 3 m, 3 m + 1) of n balances.

    Parameters
    ----------
    X, places, owner, pivot, inputs
        As of :func:`shift`.
    static : arrays on_bias (m, m), on_mean (m, nw), prescribed (m,)
        Balance of the means.
    of_elements : arrays mean (n, nw), gain (n, nw), by_mean (3, n, nw), by_gain (3, n, nw)
        With their slopes by logarithm of the amplitude, bias and logarithm of the frequency.
    L, dL : complex array, shapes (n, m, nw)
        Responses of the linear part and their derivatives by ln omega; none of these, (0, m, nw), where omega stands
        still.
    """
    every, none = np.arange(places.size), np.empty((0, 0), np.complex128)
    for i in range(len(R)):
        slope = dL[i] if len(dL) else none
        balance_at(X[i], i, every, places, owner, pivot, static, of_elements, inputs, L[i], slope, J[i], R[i])


@njit(**_COMPILED)
def drive(L, gains, owner, others, pivot, inputs):
    """Inputs of all elements but the pivot, for given gains and input of the pivot: linear equations.

    Parameters
    ----------
    L : complex array, shape (n, m, nw)
        Response of the linear part.
    gains : complex array, shape (n, nw)
    owner, others : int array, shapes (nw,), (m - 1,)
        Element of each output, and all elements but the pivot.
    pivot : int
    inputs : complex array, shape (n, m)
        Phasors, of which those of the others are filled.
    """
    n = others.size
    place, matrix = np.full(n + 1, n), np.empty((n, n + 1), np.complex128)
    place[others] = np.arange(n)
    for i in range(len(L)):
        matrix[:] = 0.0
        for r in range(n):
            matrix[r, r] = 1.0
            for j in range(owner.size):
                c, loop = place[owner[j]], L[i, others[r], j] * gains[i, j]
                matrix[r, c] += loop * inputs[i, pivot] if c == n else -loop
        for k in range(n):
            best, _ = pivot_row(matrix, k)
            for c in range(k, n + 1):
                matrix[k, c], matrix[best, c] = matrix[best, c], matrix[k, c]
            for r in range(n):
                factor = matrix[r, k] / matrix[k, k]
                if r != k and factor != 0.0:
                    for c in range(k + 1, n + 1):
                        matrix[r, c] -= factor * matrix[k, c]
        for k in range(n):
            inputs[i, others[k]] = matrix[k, n] / matrix[k, k]


@njit(**_INNER)
def room_for(size):
    """Workspace for a linear system: its matrix, the right side as one column more."""
    return np.zeros((size, size + 1))


@njit(**_INNER)
def _take(J, R, rows, columns, border, edge, matrix):
    """Rows and columns of a linear system, and its border, each divided by its largest entry; False if one is zeros."""
    n = columns.size
    for r in range(n):
        size, own = 0.0, r < rows.size
        matrix[r, n] = R[rows[r]] if own else edge
        for c in range(n):
            value = J[rows[r], columns[c]] if own else border[columns[c]]
            matrix[r, c] = value
            size = max(size, abs(value))
        # What is not a number, or infinite, is found in the solution.
        if not size > 0.0:
            return False
        share = 1.0 / size
        for c in range(n + 1):
            matrix[r, c] *= share
    return True


@njit(**_INNER)
def _eliminate(matrix):
    """Bring a linear system to an upper triangle, with the largest entry of each column as its pivot.

    What is left of the triangle is not cleared.
    """
    n, width = matrix.shape
    for k in range(n):
        best, most = k, abs(matrix[k, k])
        for r in range(k + 1, n):
            size = abs(matrix[r, k])
            if size > most:
                best, most = r, size
        if best != k:
            for c in range(k, width):
                matrix[k, c], matrix[best, c] = matrix[best, c], matrix[k, c]
        if matrix[k, k] == 0.0:
            matrix[k, k] = _SINGULAR
        share = 1.0 / matrix[k, k]
        for r in range(k + 1, n):
            factor = matrix[r, k] * share
            if factor != 0.0:
                for c in range(k + 1, width):
                    matrix[r, c] -= factor * matrix[k, c]


@njit(**_INNER)
def solve_at(J, R, rows, columns, border, edge, matrix, step):
    """One of the systems of :func:`solve`, in a matrix from :func:`room_for`; returns whether it is regular."""
    step[:] = 0.0
    if not _take(J, R, rows, columns, border, edge, matrix):
        return False
    _eliminate(matrix)
    n, regular = columns.size, True
    for k in range(n - 1, -1, -1):
        value = matrix[k, n] / matrix[k, k]
        # Taken from all rows above at once, no sum waits for its last product.
        for r in range(k):
            matrix[r, n] -= matrix[r, k] * value
        step[columns[k]] = value
        regular = regular and math.isfinite(value)
    if not regular:
        step[:] = 0.0
    return regular


@njit(**_COMPILED)
def solve(J, R, rows, columns, border, edge, step, regular):
    """Solve n linear systems for some of their columns; those that are not finite give zeros and False.

    Parameters
    ----------
    J, R : array, shapes (n, r, c), (n, r)
        Left and right sides.
    rows, columns : int array, shapes (k,), (k,) or (k + 1,)
        Those that are taken.
    border : array, shape (n, c)
        One more row where there is one more column, with `edge` on its right side.
    step, regular : array and bool array, shapes (n, c), (n,)
        Are filled; zeros in columns that are not taken.
    """
    matrix = room_for(columns.size)
    for i in range(len(R)):
        regular[i] = solve_at(J[i], R[i], rows, columns, border[i], edge, matrix, step[i])


@njit(**_INNER)
def move_at(x, columns, places, step, longest):
    """One of the steps of :func:`move`, in some columns; returns its whole length and whether the point is sound."""
    m, length, far = places.size, 0.0, 0.0
    for c in columns:
        size = 3.0 if c == 3 * m else 1.0
        if 2 * m <= c < 3 * m:
            size = math.exp(x[places[c - 2 * m]]) + 0.1 * abs(x[c])
        length = max(length, abs(step[c]) / size)
    share = min(1.0, longest / max(length, 1e-300))
    for c in columns:
        x[c] -= step[c] * share
        far = max(far, abs(x[c])) if c < 2 * m else far
        far = far if math.isfinite(x[c]) else math.inf
    return length, far < _FAR


@njit(**_COMPILED)
def move(X, places, step, longest, largest, sound):
    """Take steps from points, shortened to the longest that is allowed.

    Parameters
    ----------
    X, step : array, shape (n, 3 m + 1)
        Points, which are moved.
    places : int array, shape (m,)
        As of :func:`shift`.
    longest : float
        In logarithms, where a step is a factor; in phases; in biases relative to the amplitude.
    largest, sound : array and bool array, shape (n,)
        Are filled: lengths of the whole steps, and whether a point has numbers that can be worked with.
    """
    every = np.arange(X.shape[1])
    for i in range(len(X)):
        largest[i], sound[i] = move_at(X[i], every, places, step[i], longest)
