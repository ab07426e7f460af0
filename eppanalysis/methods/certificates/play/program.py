"""Semidefinite programs of small matrices that depend linearly on unknowns, by clarabel.

A matrix or a number that depends on m unknowns is an array with a last axis of length m: what each unknown adds.
"""

from __future__ import annotations

import math
from fractions import Fraction
from typing import Any

import numpy as np
import scipy.sparse

from eppanalysis.arrays import Array
from eppanalysis.errors import require_packages

Vector = list[Fraction]
Matrix = list[Vector]
#: Solutions are rounded to so many parts of one.
_DIGITS = 10**11
#: Margins below this are the solver's rounding.
_LEAST = 1e-8


def upper(n: int) -> list[tuple[int, int]]:
    """Places of an upper triangle, column by column."""
    return [(i, j) for j in range(n) for i in range(j + 1)]


def symmetric(z: Any, n: int) -> Any:
    """Symmetric matrices of their upper triangles, column by column."""
    out = np.zeros((n, n, *z.shape[1:]), dtype=z.dtype)
    for k, (i, j) in enumerate(upper(n)):
        out[i, j] = out[j, i] = z[k]
    return out


def spare(matrix: Array, margin: Array) -> Array:
    """The matrix less the margin on its diagonal."""
    return matrix - np.multiply.outer(np.eye(len(matrix)), margin)


def falling(form: Array, drift: Array) -> Array:
    """-(A'P + PA), by which y'Py falls along dy/dt = A y."""
    change = np.einsum("ki,kjb->ijb", drift, form)
    return -change - change.swapaxes(0, 1)


def products_of(sectors: list[tuple[Vector, Vector]]) -> list[Array]:
    """Symmetric matrices of the products of the two forms that bound each sector."""
    outer = [np.outer(*np.array([f, g], dtype=float)) for f, g in sectors]
    return [(product + product.T) / 2 for product in outer]


def largest_margin(matrices: list[Array], numbers: list[Array], bounded: int) -> tuple[Any, Fraction] | None:
    """The unknowns, as rationals, for which all matrices are semidefinite and no number negative, with most margin.

    The margin is the last unknown, at most 1; the first `bounded` unknowns lie between -1 and 1. None where there is no
    margin above rounding.

    Raises
    ------
    EppError
        If the solver is not installed.
    """
    require_packages("certify", "proof", "clarabel")
    import clarabel

    size, root = len(numbers[0]), math.sqrt(2.0)
    rows = [np.array(numbers)]
    for matrix in matrices:
        # Off the diagonal times the root of two: the scalar product of triangles is then that of the matrices.
        rows.append(np.array([matrix[i, j] * (1.0 if i == j else root) for i, j in upper(len(matrix))]))
    each = np.eye(size)
    # The inequalities are homogeneous: without a bound on the unknowns the margin would have none.
    box = np.vstack([each[:bounded], -each[:bounded], each[-1:]])
    left = scipy.sparse.csc_matrix(np.vstack([box, -np.vstack(rows)]))
    right = np.concatenate([np.ones(len(box)), np.zeros(sum(len(part) for part in rows))])
    cones = [clarabel.NonnegativeConeT(len(box) + len(numbers))]
    cones += [clarabel.PSDTriangleConeT(len(matrix)) for matrix in matrices]
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    none = scipy.sparse.csc_matrix((size, size))
    z = np.array(clarabel.DefaultSolver(none, -each[-1], left, right, cones, settings).solve().x)
    if not np.all(np.isfinite(z)) or z[-1] <= _LEAST:
        return None
    rounded = np.array([Fraction(round(x * _DIGITS), _DIGITS) for x in z], dtype=object)
    return rounded[:-1], rounded[-1]
