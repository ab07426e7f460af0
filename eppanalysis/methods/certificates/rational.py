"""A loop with one element in rational numbers, as certificates state it: ``x = -G y``, y = element(x).

Coefficients of G are computed exactly from the state space, and rounding in it is taken back (see `numbers`); how far
that is from the state space is told.
"""

from __future__ import annotations

from fractions import Fraction
from typing import Any

import numpy as np

from eppanalysis.arrays import Array
from eppanalysis.errors import ModelError
from eppanalysis.methods.certificates.numbers import NotCovered, coefficient_of, number_of
from eppanalysis.models.elements.base import Nonlinearity
from eppanalysis.models.elements.exact import Named
from eppanalysis.models.systems.linear import poles, zeros
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
    """The element stands at zero where the external inputs are held at `inputs`, shape (nv,).

    Raises
    ------
    NotCovered
        If it does not.
    """
    if np.any(static_balance(system, inputs).prescribed):
        raise NotCovered("constant terms or inputs bias the element, and biased balances have no certificate.")


def transfer_function(system: LureSystem) -> tuple[Row, Row, float]:
    """G of ``x = -G y`` in descending powers, the denominator monic, and the greatest relative change by rounding."""
    system = system.with_integrators_apart[0]
    num, den = _polynomials(system.A, system.B, system.C, system.D)
    return _without_rounding(system, [-x for x in num], den)


def forced(system: LureSystem, inputs: Array) -> Fraction:
    """What constant terms and inputs, shape (nv,), add to ``den x + num y`` at rest, in continuous time."""
    system = system.with_integrators_apart[0]
    at_rest = system.B_input @ inputs + system.constant_state, system.D_input @ inputs + system.constant_input
    num, _ = _polynomials(system.A, at_rest[0][:, None], system.C, at_rest[1][:1, None])
    return coefficient_of(num[-1])


def _polynomials(A: Array, B: Array, C: Array, D: Array) -> tuple[Row, Row]:
    """Exact numerator and denominator of ``C (s - A)^-1 B + D``, of one input and output, in descending powers."""
    rates, b, c = ([[Fraction(x) for x in row] for row in m.tolist()] for m in (A, B, C))
    n, direct = len(rates), Fraction(float(D[0, 0]))
    den, num = [Fraction(1)], [direct]
    # Faddeev and Leverrier: the adjugate of s - A power by power.
    M = [[Fraction(int(i == j)) for j in range(n)] for i in range(n)]
    for k in range(1, n + 1):
        moment = sum(c[0][i] * M[i][j] * b[j][0] for i in range(n) for j in range(n) if c[0][i] and b[j][0])
        AM = [[sum((x * M[i][j] for i, x in enumerate(row) if x), Fraction(0)) for j in range(n)] for row in rates]
        den.append(-sum((AM[i][i] for i in range(n)), Fraction(0)) / k)
        num.append(moment + direct * den[-1])
        M = [[AM[i][j] + (den[-1] if i == j else 0) for j in range(n)] for i in range(n)]
    return num, den


def _without_rounding(system: LureSystem, num: Row, den: Row) -> tuple[Row, Row, float]:
    """Coefficients that are zero but for rounding left out, the others as the numbers that they stand for."""
    n = len(den) - 1
    # Rounding leaves small numbers where coefficients are zero: how many zeros
    # there are, and how many poles at the origin, is asked of the state space.
    finite = zeros(system.A, system.B, system.C[:1], system.D[:1])
    num = num[n - len(finite) :] if any(num) else [Fraction(0)]
    at_zero = 0 if system.time_step else int(np.sum(poles(system.A) == 0))
    num_at_zero = 0 if system.time_step else int(np.sum(finite == 0))
    den = den[: n + 1 - at_zero] + [Fraction(0)] * at_zero
    num = num[: len(num) - num_at_zero] + [Fraction(0)] * num_at_zero
    pairs = [(x, coefficient_of(x)) for x in (*num, *den)]
    off = max((abs(float(after / before - 1)) for before, after in pairs if before), default=0.0)
    return [coefficient_of(x) for x in num], [coefficient_of(x) for x in den], off


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
