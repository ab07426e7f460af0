"""Compiled: responses of a linear part and their slopes, for matrices that are too small for a call to LAPACK each."""

import numpy as np

from eppanalysis.kernels.compiling import KERNEL, PART, njit

_COMPILED = {**KERNEL, "error_model": "numpy"}
_INNER = {**PART, "error_model": "numpy"}


@njit(**_INNER)
def _subtracted(A, s, beside, matrix):
    """Fill a matrix with ``s + j beside - A``."""
    n = len(A)
    for r in range(n):
        for c in range(n):
            matrix[r, c] = complex(-A[r, c], 0.0)
        matrix[r, r] += s + complex(0.0, beside)


@njit(**_INNER)
def _beside(A, s):
    """Rounding of the largest entry of ``s - A``."""
    size = 0.0
    for r in range(len(A)):
        for c in range(len(A)):
            entry = (s if r == c else 0.0) - A[r, c]
            size = max(size, abs(entry.real), abs(entry.imag))
    return 2.0**-52 * (size if size > 0.0 else 1.0)


@njit(**_INNER)
def pivot_row(matrix, k):
    """Row, from k on, with the largest entry in column k of a complex matrix, and the size of that."""
    best, most = k, -1.0
    for r in range(k, len(matrix)):
        size = abs(matrix[r, k].real) + abs(matrix[r, k].imag)
        if size > most:
            best, most = r, size
    return best, most


@njit(**_INNER)
def _factored(matrix, pivots):
    """Bring a matrix to its triangular factors, with pivots inverted, by rows; False where one is zero."""
    n = pivots.size
    for k in range(n):
        best, most = pivot_row(matrix, k)
        pivots[k] = best
        if not most > 0.0:
            return False
        if best != k:
            for c in range(n):
                matrix[k, c], matrix[best, c] = matrix[best, c], matrix[k, c]
        matrix[k, k] = 1.0 / matrix[k, k]
        for r in range(k + 1, n):
            if matrix[r, k] != 0.0:
                factor = matrix[r, k] * matrix[k, k]
                matrix[r, k] = factor
                for c in range(k + 1, n):
                    matrix[r, c] -= factor * matrix[k, c]
    return True


@njit(**_INNER)
def _substitute(matrix, pivots, x):
    """Solve for the columns of x by the factors of a matrix."""
    n, w = x.shape
    for k in range(n):
        if pivots[k] != k:
            for j in range(w):
                x[k, j], x[pivots[k], j] = x[pivots[k], j], x[k, j]
    for k in range(2 * n):
        r = k if k < n else 2 * n - 1 - k
        first, end = (0, r) if k < n else (r + 1, n)
        for c in range(first, end):
            factor = matrix[r, c]
            if factor != 0.0:
                for j in range(w):
                    x[r, j] -= factor * x[c, j]
        if k >= n:
            for j in range(w):
                x[r, j] *= matrix[r, r]


@njit(**_INNER)
def room_for_answers(n, w):
    """Workspace for a matrix, its pivots, and the states that w inputs bring about."""
    return np.empty((n, n), np.complex128), np.empty(n, np.int64), np.empty((n, w), np.complex128)


@njit(**_INNER)
def answer_at(A, B, C, s, ds, room, out):
    """One of the answers of :func:`response_and_slope`, with workspace from :func:`room_for_answers`."""
    matrix, pivots, x = room
    n, w = B.shape
    _subtracted(A, s, 0.0, matrix)
    if not _factored(matrix, pivots):
        _subtracted(A, s, _beside(A, s), matrix)
        _factored(matrix, pivots)
    for turn in range(len(out)):
        for r in range(n):
            for j in range(w):
                # The derivative of the resolvent is its square.
                x[r, j] = -ds * x[r, j] if turn else complex(B[r, j], 0.0)
        _substitute(matrix, pivots, x)
        for r in range(len(C)):
            for j in range(w):
                out[turn, r, j] = complex(0.0, 0.0)
            for c in range(n):
                share = C[r, c]
                if share != 0.0:
                    for j in range(w):
                        out[turn, r, j] += complex(share * x[c, j].real, share * x[c, j].imag)


@njit(**_COMPILED)
def response_and_slope(A, B, C, s, ds, out):
    """Fill `out` with ``C (s - A)^-1 B``, and then with its derivative by what s has the derivative ds by.

    At a pole to the last bit both are those a rounding beside it.

    Parameters
    ----------
    A, B, C : arrays, shapes (n, n), (n, w), (z, n)
    s, ds : complex array, shape (k,)
    out : complex array, shape (1 or 2, k, z, w)
    """
    room = room_for_answers(len(B), B.shape[1])
    for i in range(s.size):
        answer_at(A, B, C, s[i], ds[i], room, out[:, i])
