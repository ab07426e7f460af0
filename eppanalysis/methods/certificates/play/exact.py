"""Rational arithmetic of the checkers: sums of quadratic forms, and whether one is never positive."""

from __future__ import annotations

from fractions import Fraction
from typing import Any

Vector = list[Fraction]
Matrix = list[Vector]
ONE = Fraction(1)


class Refused(ValueError):
    """What is wrong with a certificate, in a sentence."""


def require(holds: bool, what: str) -> None:
    """Refuse the certificate unless something holds."""
    if not holds:
        raise Refused(f"The certificate proves nothing: {what}.")


def rational(value: Any) -> Any:
    """Rationals of the strings in nested lists."""
    return [rational(item) for item in value] if isinstance(value, list) else Fraction(value)


def product(a: Vector, b: Vector) -> Matrix:
    """Matrix of the quadratic form (a.y)(b.y)."""
    return [[(p * s + q * r) / 2 for s, q in zip(b, a, strict=True)] for p, r in zip(a, b, strict=True)]


def total(*terms: tuple[Fraction, Matrix]) -> Matrix:
    """Sum of matrices with factors."""
    rows = range(len(terms[0][1]))
    return [[sum((c * M[i][j] for c, M in terms), Fraction(0)) for j in rows] for i in rows]


def rate(P: Matrix, A: Matrix) -> Matrix:
    """A'P + PA, by which y'Py changes along dy/dt = A y."""
    n = range(len(A))
    return [[sum((A[k][i] * P[k][j] + P[i][k] * A[k][j] for k in n), Fraction(0)) for j in n] for i in n]


def never_positive(matrix: Matrix) -> bool:
    """Whether the symmetric matrix is negative semidefinite, by elimination without rounding."""
    M = [[-x for x in row] for row in matrix]
    n = len(M)
    for k in range(n):
        if M[k][k] < 0 or (M[k][k] == 0 and any(M[k][k + 1 :])):
            return False
        for i in range(k + 1, n):
            factor = M[i][k] / M[k][k] if M[k][k] else Fraction(0)
            M[i] = [x - factor * y for x, y in zip(M[i], M[k], strict=True)]
    return True
