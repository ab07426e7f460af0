"""Finds the weights with which a small gap of the elbow's lock pin is proved to start no limit cycle.

What is sought are two polynomials n, d and two numbers; the checker alone decides whether they prove anything.
Theory: docs/theory/proofs.md, whose letters are used.
"""

from __future__ import annotations

from collections.abc import Mapping
from fractions import Fraction
from typing import Any

import numpy as np
from numpy.polynomial import polynomial as poly
from scipy.optimize import minimize

from eppanalysis.arrays import Array
from eppanalysis.methods.certificates import check_elbow
from eppanalysis.methods.certificates.numbers import NotCovered, number_of
from eppanalysis.methods.certificates.registry import sealed
from eppanalysis.models.elements import FiveBandLaw, Friction, LockPin, PiecewiseLinear
from eppanalysis.models.systems.lure import LureSystem

#: Where the search begins, for the elbow with nominal values: log(mu c/J), log(sigma/(1 - sigma)), then of two factors
#: of d, in units of the forearm's frequency on the contact, the log of the frequency and the damping, then n1, n2.
_START = np.array([-3.67406 + 3.0683, -1.89799, 4.34538 - 4.988, -0.60492, 4.59518 - 4.988, 0.73808, -0.415, 0.331])
_STEPS, _MARGIN, _DIGITS = 200, 0.01, 8
_REACH_LEFT = Fraction(999, 1000)
_PLACES = np.concatenate([np.geomspace(1e-3, 0.3, 20), np.linspace(0.3, 3.0, 150), np.geomspace(3.0, 1e3, 60)])


def rational_elbow(system: LureSystem, inputs: Array) -> dict[str, Any]:
    """The elbow without pulley friction, on its side, as its certificates state it [SI].

    Parameters
    ----------
    inputs : array, shape (nv,)
        Where the external inputs are held.

    Raises
    ------
    NotCovered
        If the loop is not of that structure, or a constant acts on it but through the cable, as the harness does.
    """
    cable, bands, pin, friction = _elements(system)
    rates = system.B_input @ inputs + system.constant_state
    _, *others = system.D_input @ inputs + system.constant_input
    if np.any(rates) or np.any(others):
        raise NotCovered("a constant acts on the elbow elsewhere than at its cable.")
    A, B, C = system.A, system.B, system.C
    v = {
        "inertia": 1.0 / B[1, 2],
        "viscous": -A[1, 1] / B[1, 2],
        "contact_stiffness": pin.stiffness,
        "contact_damping": pin.damping,
        "backlash": pin.gap,
        "friction": friction.coulomb,
        "lag": -1.0 / A[4, 4],
        "delay": 1.0 / A[5, 6],
        "back_emf": A[4, 3] / A[4, 4],
        "torque": B[4, 1] / -A[4, 4] * bands.supply_voltage,
        "cable_stiffness": cable.slopes[1],
        "radius": -C[0, 0],
        "slack": bands.slack,
        "low": bands.low,
        "high": bands.high,
        "max": bands.max,
    }
    if not all(np.allclose(*pair, rtol=1e-12, atol=0.0) for pair in _matrices(system, v, bands.supply_voltage)):
        raise _refused(system)
    return {name: str(number_of(float(v[name]))) for name in check_elbow.NAMES}


def _refused(system: LureSystem) -> NotCovered:
    """That a loop is another."""
    return NotCovered(
        "certificates of absence cover loops with one element of one input and output, and the elbow on its side with "
        f"a ball-bearing pulley, unfiltered and unsampled; here are: {', '.join(system.element_names)}."
    )


def _elements(system: LureSystem) -> tuple[Any, Any, Any, Any]:
    """Cable, bands, lock pin and friction of the drive, as they are covered."""
    kinds = (PiecewiseLinear, FiveBandLaw, LockPin, Friction)
    if tuple(map(type, system.elements)) != kinds or system.A.shape != (7, 7) or system.time_step is not None:
        raise _refused(system)
    cable, bands, pin, friction = elements = system.elements
    slack = [*cable.breakpoints, cable.slopes[0], *cable.intercepts]
    plain = friction.static in (None, friction.coulomb) and friction.stribeck == 0.0  # type: ignore[attr-defined]
    straight = bands.offset_voltage == 0.0 and pin.model == "unilateral"  # type: ignore[attr-defined]
    if any(slack) or not (plain and straight) or np.any(system.delays):
        raise _refused(system)
    return elements  # type: ignore[return-value]


def _matrices(system: LureSystem, v: Mapping[str, float], volts: float) -> list[tuple[Array, Array]]:
    """The matrices of the loop beside those of the page, with the same parameters."""
    A, B, C, D = (np.zeros_like(m) for m in (system.A, system.B, system.C, system.D))
    J, Jd, lag, T = v["inertia"], -1.0 / system.B[3, 3], v["lag"], v["delay"]
    gain = v["torque"] / volts / lag
    A[0, 1] = A[2, 3] = 1.0
    A[1, 1], A[3, 4], A[4, 3], A[4, 4], A[4, 6] = -v["viscous"] / J, 1 / Jd, -v["back_emf"] / lag, -1 / lag, -gain
    A[5, 6], A[6, 5], A[6, 6] = 1 / T, -12 / T, -6 / T
    B[1, 0], B[1, 2], B[3, 2], B[3, 3], B[4, 1], B[6, 1] = v["radius"] / J, 1 / J, -1 / Jd, -1 / Jd, gain, 12 / T
    C[0, 0], C[2, 0], C[2, 2], C[3, 1], C[3, 3], C[4, 3] = -v["radius"], -1.0, 1.0, -1.0, 1.0, 1.0
    D[1, 0] = 1.0
    return [(system.A, A), (system.B, B), (system.C, C), (system.D, D)]


def find(stated: Mapping[str, Any]) -> dict[str, Any] | str:
    """The certificate of absence, or why there is none."""
    v = {name: Fraction(stated[name]) for name in check_elbow.NAMES}
    if min(v[name] for name in check_elbow.NAMES if name not in ("backlash", "slack")) <= 0:
        return "the proof needs friction, damping and delays above zero."
    if not 0 <= v["slack"] < v["low"] <= v["high"] < v["max"]:
        return "the proof needs bands that lie at tensions of zero and more, one above the other."
    number = {name: float(x) for name, x in v.items()}
    for x in _candidates(number):
        evidence = _written(number, x)
        largest = _largest(v, {name: _numbers(part) for name, part in evidence.items()})
        if largest is None:
            continue
        if v["backlash"] > largest:
            degrees = np.degrees(float(largest))
            return (
                f"the proof reaches a gap of {degrees:.3g} deg, and this one has {np.degrees(number['backlash']):.3g}."
            )
        claim = {"backlash": stated["backlash"]}
        return sealed({"statement": check_elbow.STATEMENT, "loop": dict(stated), "claim": claim, "evidence": evidence})
    return "no weights were found with which the drive's losses exceed its gain from the gap at all frequencies."


def _candidates(v: Mapping[str, float]) -> list[Array]:
    """Where the search begins, and where it ends from there."""
    found = minimize(_objective, _START, args=(v,), method="Nelder-Mead", options={"maxiter": _STEPS})
    return [found.x, _START]


def _shape(v: Mapping[str, float], x: Array) -> tuple[Array, Array]:
    """The polynomials n and d, ascending."""
    scale = np.sqrt(v["inertia"] / v["contact_stiffness"])
    slow, fast = (np.array([1.0, 2.0 * x[k + 1] * t, t * t]) for k in (2, 4) for t in [scale * np.exp(-x[k])])
    return np.array([1.0, x[6] * scale, x[7] * scale**2]), poly.polymul(slow, fast)


def _weights(v: Mapping[str, float], x: Array) -> tuple[float, float]:
    return float(np.exp(x[0]) * v["inertia"] / v["contact_damping"]), float(1.0 / (1.0 + np.exp(-x[1])))


def _written(v: Mapping[str, float], x: Array) -> dict[str, Any]:
    """The evidence in decimals."""

    def text(value: float) -> str:
        return str(Fraction(f"{value:.{_DIGITS}g}"))

    (mu, sigma), (n, d) = _weights(v, x), _shape(v, x)
    return {"mu": text(mu), "sigma": text(sigma), "n": [*map(text, n)], "d": [*map(text, d)]}


def _numbers(part: Any) -> Any:
    return [*map(Fraction, part)] if isinstance(part, list) else Fraction(part)


def _largest(v: Mapping[str, Fraction], evidence: Mapping[str, Any]) -> Fraction | None:
    """The largest gap that some evidence proves [rad], less a thousandth; None where it proves nothing."""
    polynomial, third, full, late, lag = check_elbow.share(v, evidence)
    if not check_elbow.positive(polynomial):
        return None
    kappa, pull = check_elbow.slope_and_pull(v)
    twice = (
        2
        * v["friction"]
        / kappa
        / _upper(check_elbow.mean_size(check_elbow.turned(late), check_elbow.times(lag, late)))
    )
    largest = (twice - pull) / _upper(check_elbow.mean_size(third, full)) * _REACH_LEFT
    return largest if largest >= 0 else None


def _upper(ball: Any) -> Fraction:
    return Fraction(f"{float(ball.upper()) * (1.0 + 1e-9):.12g}")


def gained(document: Mapping[str, Any], omega: Array) -> Array:
    """The sum of sizes of a certificate over its limit, at some frequencies [rad/s], in floats."""
    v = {name: float(Fraction(document["loop"][name])) for name in check_elbow.NAMES}
    mu, sigma, n, d = (_numbers(document["evidence"][name]) for name in ("mu", "sigma", "n", "d"))
    return _sizes(v, (float(mu), float(sigma)), (np.array(n, dtype=float), np.array(d, dtype=float)), omega)


def _objective(x: Array, v: Mapping[str, float]) -> float:
    """Mean size of the filter before the gap, and far more where the sum of sizes is too large at a frequency."""
    n, d = _shape(v, x)
    k = v["contact_stiffness"]
    over = np.max(_sizes(v, _weights(v, x), (n, d), _PLACES * np.sqrt(k / v["inertia"]))) - (1.0 - _MARGIN)
    mass = np.array([0.0, v["viscous"], v["inertia"]])
    mean = _mean_size(np.asarray(poly.polysub(poly.polymul(mass, n), k * d), dtype=float), k * d)
    return mean + 1e3 * max(0.0, over)


def _sizes(v: Mapping[str, float], weights: tuple[float, float], shape: tuple[Array, Array], omega: Array) -> Array:
    """The sum of sizes over its limit, less the fourth, which is small."""
    (mu, sigma), k, c, s = weights, v["contact_stiffness"], v["contact_damping"], 1j * omega
    mass, delta = v["viscous"] + v["inertia"] * s, k + (c + v["viscous"]) * s + v["inertia"] * s**2
    late, lag = poly.polyval(s, [12.0, 6.0 * v["delay"], v["delay"] ** 2]), 1.0 + v["lag"] * s
    formed, turn = poly.polyval(s, shape[0]) / poly.polyval(s, k * shape[1]), late / (lag * late).conj()
    first, second, third = (
        ((turn - 1.0) / s + mu * turn + mass * formed) * lag,
        (1.0 - delta * formed) / s,
        mass * s * formed - 1.0,
    )
    total = abs(first) ** 2 / v["back_emf"] + abs(second) ** 2 * 2.0 / ((1.0 - sigma) * c)
    total += abs(third) ** 2 * c / (0.75 * sigma * k**2)
    steepest = v["torque"] / min(v["max"] - v["high"], v["low"] - v["slack"]) * v["cable_stiffness"] * v["radius"]
    return total * steepest / (4.0 * mu)


def _mean_size(num: Array, den: Array) -> float:
    """Integral of the size of the impulse response of ``num/den``, to both sides of zero, in floats."""
    through = num[-1] / den[-1]
    poles = poly.polyroots(den)
    parts = poly.polyval(poles, num - through * den) / poly.polyval(poles, poly.polyder(den))
    t = np.linspace(0.0, 30.0 / np.min(abs(poles.real)), 3001)
    sides = (
        np.where(sign * poles.real < 0.0, parts, 0.0) @ np.exp(-np.outer(abs(poles.real) - 1j * sign * poles.imag, t))
        for sign in (1, -1)
    )
    return abs(float(through)) + sum(float(np.trapezoid(abs(side.real), t)) for side in sides)
