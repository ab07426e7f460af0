"""Compiled: Newton's method for many first-order balances, but for what elements and linear part answer.

What the equations are is in :mod:`eppanalysis.methods.describing.balance`; here are the loops over points, elements and
outputs, which are too short for array operations to be worth their calls.
"""

import math

import numpy as np

from eppanalysis.kernels.compiling import KERNEL, PART, njit

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
def balance_at(x, places, owner, pivot, static, of_elements, inputs, L, dL, J, R):
    """Residual and Jacobian of one point; arguments are its shares of those of :func:`assemble`."""
    on_bias, on_mean, prescribed = static
    mean, gain, by_mean, by_gain = of_elements
    m, moves = places.size, len(dL) > 0
    for r in range(m):
        real, imaginary, level = J[r], J[m + r], J[2 * m + r]
        front = (math.exp(x[3 * m]) if r == pivot else 1.0) / inputs[r]
        total, off = complex(0.0, 0.0), -prescribed[r]
        for j in range(owner.size):
            o, share = owner[j], on_mean[r, j]
            place = places[o]
            if share != 0.0:
                off += share * mean[j]
                level[place] += share * by_mean[0, j]
                level[2 * m + o] += share * by_mean[1, j]
                if moves:
                    level[1] += share * by_mean[2, j]
            # Of the few outputs of a loop fewer yet act on an input.
            if L[r, j] == 0.0 and not (moves and dL[r, j] != 0.0):
                continue
            z = inputs[o]
            response = L[r, j] * front
            output = gain[j] * z
            loop = response * output
            total += loop
            # By the logarithm of an amplitude and by a phase an output changes by itself, and by itself times j:
            # what the slope of the gain adds is all that has to be differenced (docs/theory/index.md, Several
            # elements).
            if o != pivot:
                real[place + 1] -= loop.imag
                imaginary[place + 1] += loop.real
            response *= z
            by = response * by_gain[0, j] + loop
            real[place] += by.real
            imaginary[place] += by.imag
            by = response * by_gain[1, j]
            real[2 * m + o] += by.real
            imaginary[2 * m + o] += by.imag
            if moves:
                by = response * by_gain[2, j] + dL[r, j] * front * output
                real[1] += by.real
                imaginary[1] += by.imag
        real[places[r]] -= total.real
        imaginary[places[r]] -= total.imag
        if r == pivot:
            real[3 * m], imaginary[3 * m] = total.real, total.imag
        else:
            real[places[r] + 1] += total.imag
            imaginary[places[r] + 1] -= total.real
        for k in range(m):
            off += on_bias[r, k] * x[2 * m + k]
            level[2 * m + k] += on_bias[r, k]
        R[r], R[m + r], R[2 * m + r] = total.real - 1.0, total.imag, off


@njit(**_COMPILED)
def assemble(X, places, owner, pivot, static, of_elements, inputs, L, dL, J, R):
    """Fill the residuals R (n, 3 m) and Jacobians J (n, 3 m, 3 m + 1), which are zeros, of n balances.

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
    mean, gain, by_mean, by_gain = of_elements
    none = np.empty((0, 0), np.complex128)
    for i in range(len(R)):
        at = mean[i], gain[i], by_mean[:, i], by_gain[:, i]
        balance_at(X[i], places, owner, pivot, static, at, inputs[i], L[i], dL[i] if len(dL) else none, J[i], R[i])


@njit(**_INNER)
def room_for(size):
    """Workspace for a linear system: its matrix, the right side as one column more, zeros up to a multiple of four."""
    return np.zeros((size, size + 4 - size % 4))


@njit(**_INNER)
def _take(J, R, rows, columns, border, edge, matrix):
    """Rows and columns of a linear system, and its border, each divided by its largest entry; False if one is zeros."""
    n = columns.size
    for r in range(n):
        size, row = 0.0, matrix[r]
        row[n] = R[rows[r]] if r < rows.size else edge
        line = J[rows[r]] if r < rows.size else border
        for c in range(n):
            value = line[columns[c]]
            row[c] = value
            value = abs(value)
            size = value if value > size else size
        # What is not a number, or infinite, is found in the solution.
        if not size > 0.0:
            return False
        share = 1.0 / size
        for c in range(row.size):
            row[c] *= share
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
        top = matrix[k]
        if best != k:
            row = matrix[best]
            for c in range(width):
                top[c], row[c] = row[c], top[c]
        if top[k] == 0.0:
            top[k] = _SINGULAR
        share = 1.0 / top[k]
        for r in range(k + 1, n):
            row = matrix[r]
            factor = row[k] * share
            if factor != 0.0:
                # Four at a time, all of them before the first is written: that is one instruction each.
                for c in range((k + 1) // 4 * 4, width, 4):
                    first, second = row[c] - factor * top[c], row[c + 1] - factor * top[c + 1]
                    third, fourth = row[c + 2] - factor * top[c + 2], row[c + 3] - factor * top[c + 3]
                    row[c], row[c + 1], row[c + 2], row[c + 3] = first, second, third, fourth


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
def move_at(x, places, step, longest):
    """One of the steps of :func:`move`; returns its whole length and whether the point is sound."""
    m, length, far = places.size, 0.0, 0.0
    for c in range(3 * m + 1):
        size = 3.0 if c == 3 * m else 1.0
        if 2 * m <= c < 3 * m:
            size = math.exp(x[places[c - 2 * m]]) + 0.1 * abs(x[c])
        length = max(length, abs(step[c]) / size)
    share = min(1.0, longest / max(length, 1e-300))
    for c in range(3 * m + 1):
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
    for i in range(len(X)):
        largest[i], sound[i] = move_at(X[i], places, step[i], longest)
