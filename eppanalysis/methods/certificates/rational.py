"""A loop with one element in rational numbers, as certificates state it: ``x = -G y``, y = element(x).

Coefficients of G are computed exactly from the state space, and rounding in it is taken back (see `numbers`); how far
this is from the state space is said.
"""

from __future__ import annotations

from collections.abc import Iterator
from fractions import Fraction
from typing import Any

import numpy as np

from eppanalysis.arrays import Array
from eppanalysis.errors import ModelError
from eppanalysis.methods.certificates.numbers import ROUNDING, NotCovered, coefficient_of, number_of
from eppanalysis.models.elements.base import Nonlinearity
from eppanalysis.models.elements.exact import Named
from eppanalysis.models.systems.lure import LureSystem
from eppanalysis.models.systems.means import static_balance

Row = list[Fraction]

_MOST_PIECES = 401


def rational_loop(system: LureSystem) -> tuple[dict[str, Any], float]:
    """A loop as a certificate states it, and how far its coefficients are from the state space, relatively.

    Raises
    ------
    NotCovered
        If it has not exactly one element with one input and output.
    """
    if len(system.elements) != 1 or system.elements[0].n_inputs != 1 or system.elements[0].n_outputs != 1:
        ports = ", ".join(system.element_names) or "none"
        raise NotCovered(f"certificates cover loops with one element of one input and output; here are: {ports}.")
    link, off = rational_link(system)
    time_step = None if system.time_step is None else str(number_of(system.time_step))
    return {"time_step": time_step} | link, off


def rational_link(system: LureSystem) -> tuple[dict[str, Any], float]:
    """One element and the linear part behind it, and how far its coefficients are from the state space, relatively."""
    if np.any(system.delays) and np.any(system.D):
        raise NotCovered("the linear part passes a share of its input straight through, beside its dead time.")
    num, den, off = transfer_function(system)
    link = {
        "num": [str(c) for c in num],
        "den": [str(c) for c in den],
        "delay": str(number_of(system.delays[0])),
        "element": element_data(system.elements[0]),
    }
    return link, off


def require_no_bias(system: LureSystem, inputs: Any) -> None:
    """The element is at zero where the external inputs are held at `inputs`, shape (nv,).

    Raises
    ------
    NotCovered
        If it does not.
    """
    if np.any(static_balance(system, inputs).prescribed):
        raise NotCovered("constant terms or inputs bias the element, and biased balances have no certificate.")


def transfer_function(system: LureSystem) -> tuple[Row, Row, float]:
    """G of ``x = -G y`` in descending powers, the denominator monic, and the greatest relative change by rounding."""
    if system.time_step:  # an integrator of samples shows in no coefficient alone
        system = system.with_integrators_apart[0]
    num, den = _polynomials(system.A, system.B, system.C, system.D)
    first = next((i for i, c in enumerate(num) if c), len(num) - 1)
    num = [-x for x in num[first:]]
    pairs = [(x, coefficient_of(x)) for x in (*num, *den)]
    off = max((abs(float(after / before - 1)) for before, after in pairs if before), default=0.0)
    return [coefficient_of(x) for x in num], [coefficient_of(x) for x in den], off


def forced(system: LureSystem, inputs: Array) -> Fraction:
    """What constant terms and inputs, shape (nv,), add to ``den x + num y`` at rest, in continuous time."""
    at_rest = system.B_input @ inputs + system.constant_state, system.D_input @ inputs + system.constant_input
    num, _ = _polynomials(system.A, at_rest[0][:, None], system.C, at_rest[1][:1, None])
    return coefficient_of(num[-1])


def _polynomials(A: Array, B: Array, C: Array, D: Array) -> tuple[Row, Row]:
    """Numerator and denominator of ``C (s - A)^-1 B + D``, of one input and output, in descending powers.

    They are those of the numbers in the state space exactly, but that coefficients are zero which are no more than its
    numbers make by being off by their rounding.
    """
    rates, b, c = (_exact(matrix) for matrix in (A, B, C))
    direct, spread = Fraction(float(D[0, 0])), b * c
    den, num = [Fraction(1)], [direct]
    for (M, coefficient), (other, _) in zip(_adjugate(rates), _adjugate(rates - spread), strict=True):
        den.append(_but_for_rounding(coefficient, _size(rates, M)))
        # The numerator is by how much the denominator changes with the loop closed: it depends on A as that does.
        size = _size(spread, M) + _size(rates, other - M)
        num.append(_but_for_rounding((c * M * b)[0, 0], size) + direct * den[-1])
    return num, den


def _exact(matrix: Array) -> Any:
    """The numbers of a matrix as they are in floats."""
    from flint import fmpq, fmpq_mat

    rows, columns = matrix.shape
    return fmpq_mat(rows, columns, [fmpq(*x.as_integer_ratio()) for x in matrix.ravel().tolist()])


def _size(matrix: Any, slopes: Any) -> Any:
    """By how much a number changes at most that changes with each entry of a matrix, if all are off by their size."""
    return sum((abs(x * y) for x, y in zip(matrix.entries(), slopes.transpose().entries(), strict=True)), 0)


def _but_for_rounding(value: Any, size: Any) -> Fraction:
    """A number, zero where it is within the rounding of a size."""
    value, size = (Fraction(int(x.p), int(x.q)) for x in (value, size))
    return value if abs(value) > ROUNDING * size else Fraction(0)


def _adjugate(A: Any) -> Iterator[tuple[Any, Any]]:
    """Coefficients of powers of s in the adjugate of ``s - A`` and, one power lower, in its determinant.

    Its determinant changes with the entries of A as the transpose of the adjugate says (Faddeev and Leverrier).
    """
    n = A.nrows()
    eye = M = _exact(np.eye(n))
    for k in range(1, n + 1):
        AM = A * M
        coefficient = -sum((AM[i, i] for i in range(n)), 0) / k
        yield M, coefficient
        M = AM + eye * coefficient


def element_data(element: Nonlinearity) -> dict[str, Any]:
    """An element in rational numbers, as certificates state it.

    Raises
    ------
    NotCovered
        If none speaks of it.
    """
    pieces = element.breakpoints.size + 1
    if pieces > _MOST_PIECES:
        raise NotCovered(f"the element has {pieces} pieces; certificates go to {_MOST_PIECES}.")
    try:
        exact = element.exact(number_of)
    except ModelError as refusal:
        raise NotCovered(str(refusal)) from None
    if exact is None:
        raise NotCovered(f"no certificate covers a {element.kind or type(element).__name__}.")
    if isinstance(exact, Named):
        return {"kind": exact.kind, **{name: str(value) for name, value in exact.numbers.items()}}
    if any(at < 0 for half in exact for at, _ in half.bends + half.jumps):
        raise NotCovered("the element's output is not zero with its input, which biases the loop.")
    positive, negative = ({"slope": str(m), "bends": _rows(b), "jumps": _rows(j)} for m, b, j in exact)
    if positive == negative:
        return {"kind": "odd_pieces", **positive}
    return {"kind": "pieces", "positive": positive, "negative": negative}


def _rows(places: tuple[tuple[Fraction, Fraction], ...]) -> list[list[str]]:
    return [[str(at), str(size)] for at, size in places]
