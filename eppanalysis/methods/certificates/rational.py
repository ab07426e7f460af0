"""A loop with one element in rational numbers, as certificates state it: ``x = -G y``, y = element(x).

Coefficients of G are computed exactly from the state space, and rounding in it is taken back (see `numbers`); how far
that is from the state space is told.
"""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction
from typing import Any

import numpy as np

from eppanalysis.methods.certificates.numbers import NotCovered, coefficient_of, number_of
from eppanalysis.models import elements as known
from eppanalysis.models.elements.base import Nonlinearity
from eppanalysis.models.systems.linear import poles, zeros
from eppanalysis.models.systems.lure import LureSystem
from eppanalysis.models.systems.means import static_balance

#: Slope at zero, bends (at, change of slope), jumps (at, height) of a static element for x > 0.
Half = tuple[Fraction, list[tuple[Fraction, Fraction]], list[tuple[Fraction, Fraction]]]
Row = list[Fraction]

_MOST_LEVELS = 200


def rational_loop(system: LureSystem) -> tuple[dict[str, Any], float]:
    """A loop as a certificate states it, and how far its coefficients are from the state space, relatively.

    Raises
    ------
    NotCovered
        If it has not exactly one element with one input and output.
    """
    if len(system.elements) != 1 or system.elements[0].n_inputs != 1 or system.elements[0].n_outputs != 1:
        ports = ", ".join(system.element_names) or "none"
        raise NotCovered(f"certificates speak of loops with one element of one input and output; here are: {ports}.")
    if np.any(system.delays) and np.any(system.D):
        raise NotCovered("the linear part passes a share of its input straight through, beside its dead time.")
    num, den, off = transfer_function(system)
    loop = {
        "name": system.name,
        "num": [str(c) for c in num],
        "den": [str(c) for c in den],
        "delay": str(number_of(system.delays[0])),
        "time_step": None if system.time_step is None else str(number_of(system.time_step)),
        "element": element_data(system.elements[0]),
    }
    return loop, off


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
    A, b, c = ([[Fraction(x) for x in row] for row in m.tolist()] for m in (system.A, system.B, system.C))
    n, direct = len(A), Fraction(float(system.D[0, 0]))
    den, num = [Fraction(1)], [direct]
    # Faddeev and Leverrier: the adjugate of s - A power by power.
    M = [[Fraction(int(i == j)) for j in range(n)] for i in range(n)]
    for k in range(1, n + 1):
        moment = sum(c[0][i] * M[i][j] * b[j][0] for i in range(n) for j in range(n) if c[0][i] and b[j][0])
        AM = [[sum((x * M[i][j] for i, x in enumerate(row) if x), Fraction(0)) for j in range(n)] for row in A]
        den.append(-sum((AM[i][i] for i in range(n)), Fraction(0)) / k)
        num.append(moment + direct * den[-1])
        M = [[AM[i][j] + (den[-1] if i == j else 0) for j in range(n)] for i in range(n)]
    return _without_rounding(system, [-x for x in num], den)


def _without_rounding(system: LureSystem, num: Row, den: Row) -> tuple[Row, Row, float]:
    """Coefficients that are zero but for rounding left out, the others as the numbers that they stand for."""
    n = len(den) - 1
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
    kind = type(element).kind
    if isinstance(element, known.Friction) and element.stribeck == 0:
        return _static([_jump(number_of(element.coulomb))] * 2)
    if kind in _STATIC:
        return _static(_STATIC[kind](element))
    if isinstance(element, known.PiecewiseLinear):
        return _static(_pieces(element))
    if kind in ("cube", "drag"):
        return {"kind": kind, **_texts(element, "scale")}
    if kind == "play":
        return {"kind": kind, **_texts(element, "gap")}
    if kind == "jump_and_follow":
        return {"kind": kind, **_texts(element, "stick_band", "slip_jump", "slope")}
    if kind == "hysteresis_relay_dead_zone":
        return {"kind": kind, **_texts(element, "on", "off", "level")}
    if isinstance(element, known.HysteresisRelay):
        if element.lower != -element.upper or element.low != -element.high:
            raise NotCovered("a relay with unlike thresholds or levels is biased, and has no certificate.")
        return {"kind": kind, "threshold": str(number_of(element.upper)), "level": str(number_of(element.high))}
    raise NotCovered(f"no certificate speaks of a {kind or type(element).__name__}.")


def _texts(element: Nonlinearity, *names: str) -> dict[str, str]:
    return {name: str(number_of(getattr(element, name))) for name in names}


def _static(halves: list[Half]) -> dict[str, Any]:
    """A static element: odd, or with another half for x < 0."""
    if any(at < 0 for _, bends, jumps in halves for at, _ in bends + jumps):
        raise NotCovered("the element's output is not zero with its input, which biases the loop.")
    positive, negative = ({"slope": str(m), "bends": _rows(b), "jumps": _rows(j)} for m, b, j in halves)
    if positive == negative:
        return {"kind": "odd_pieces", **positive}
    return {"kind": "pieces", "positive": positive, "negative": negative}


def _rows(pairs: list[tuple[Fraction, Fraction]]) -> list[list[str]]:
    return [[str(at), str(size)] for at, size in pairs]


def _jump(height: Fraction, slope: Fraction = Fraction(0)) -> Half:
    return slope, [], [(Fraction(0), height)]


def _saturation(e: Any) -> list[Half]:
    k = number_of(e.slope)
    return [(k, [(side / k, -k)], []) for side in (number_of(e.upper), -number_of(e.lower))]


def _dead_zone(e: Any) -> list[Half]:
    return [(Fraction(0), [(side, number_of(e.slope))], []) for side in (number_of(e.upper), -number_of(e.lower))]


def _dead_zone_saturation(e: Any) -> list[Half]:
    d, k = number_of(e.dead_zone), number_of(e.slope)
    return [(Fraction(0), [(d, k), (d + number_of(e.limit) / k, -k)], [])] * 2


def _relay(e: Any) -> list[Half]:
    if e.threshold != 0:
        raise NotCovered("a relay whose threshold is not zero is biased, and has no certificate.")
    return [_jump(number_of(e.high)), _jump(-number_of(e.low))]


def _quantiser(e: Any) -> list[Half]:
    if e.levels > _MOST_LEVELS:
        raise NotCovered(f"a quantiser of {e.levels} levels; certificates go to {_MOST_LEVELS}.")
    step = number_of(e.step)
    return [(Fraction(0), [], [(step * (2 * i + 1) / 2, step) for i in range(int(e.levels))])] * 2


def _bilinear(e: Any) -> list[Half]:
    if e.preload != 0:
        raise NotCovered("a spring with a preload is biased, and has no certificate.")
    inner, change = number_of(e.inner), number_of(e.outer) - number_of(e.inner)
    return [(inner, [(side, change)], []) for side in (number_of(e.upper), -number_of(e.lower))]


def _pieces(e: Any) -> list[Half]:
    if len(e.breakpoints) > 2 * _MOST_LEVELS:
        raise NotCovered(f"a map of {len(e.slopes)} pieces; certificates go to {2 * _MOST_LEVELS + 1}.")
    b, m, c = ([number_of(x) for x in values.tolist()] for values in (e.breakpoints, e.slopes, e.intercepts))
    met = e.jumps.tolist()  # zero where pieces meet to rounding
    steps = [(m[i + 1] - m[i]) * b[i] + c[i + 1] - c[i] if met[i] else Fraction(0) for i in range(len(b))]
    mirrored = _half([-x for x in b[::-1]], m[::-1], [-x for x in c[::-1]], steps[::-1])
    return [_half(b, m, c, steps), mirrored]


def _half(b: Row, m: Row, c: Row, steps: Row) -> Half:
    first = sum(x <= 0 for x in b)
    jumps = [(x, h) for x, h in [(Fraction(0), c[first]), *zip(b[first:], steps[first:], strict=True)] if h]
    return m[first], [(b[i], m[i + 1] - m[i]) for i in range(first, len(b))], jumps


_STATIC: dict[str, Callable[[Any], list[Half]]] = {
    "saturation": _saturation,
    "dead_zone": _dead_zone,
    "dead_zone_saturation": _dead_zone_saturation,
    "relay": _relay,
    "relay_dead_zone": lambda e: [(Fraction(0), [], [(number_of(e.threshold), number_of(e.level))])] * 2,
    "preload": lambda e: [_jump(number_of(e.level), number_of(e.slope))] * 2,
    "coulomb": lambda e: [_jump(number_of(e.level))] * 2,
    "viscous_coulomb": lambda e: [_jump(number_of(e.coulomb), number_of(e.viscous))] * 2,
    "quantiser": _quantiser,
    "bilinear_spring": _bilinear,
    "piecewise_linear": _pieces,
}
