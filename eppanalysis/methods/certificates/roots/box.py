"""The box in which roots are certified: what is requested, or one that the loop's own scales set."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from fractions import Fraction
from typing import Any, NamedTuple

import numpy as np
from flint import acb, acb_poly, ctx, fmpq, fmpq_poly

from eppanalysis.errors import ArgumentError, EppError
from eppanalysis.methods.certificates import check_roots
from eppanalysis.methods.certificates.numbers import NotCovered, number_of
from eppanalysis.methods.certificates.roots.find import Box
from eppanalysis.methods.certificates.roots.ring import order_of
from eppanalysis.methods.describing.predict import predict_limit_cycles
from eppanalysis.methods.describing.search import frequency_scales
from eppanalysis.models.systems.lure import LureSystem
from eppanalysis.models.systems.operating import OperatingPoint

#: Factor by which the default box reaches beyond the least and the greatest scale of a loop.
REACH = 1024
#: In place of pi: in the ends of default boxes, and where a box may end at most.
_PI, _MOST_PI = Fraction("3.14"), Fraction("3.14159265358979")
#: How far a side reaches beyond a predicted cycle where it would end before it.
_ROOM = Fraction(9, 8)
#: Bits in which the response at the poles and zeros is computed.
_BITS = 256


def box_of(
    system: LureSystem, stated: Mapping[str, Any], given: Mapping[str, Sequence[float]] | None, at: OperatingPoint
) -> Box:
    """The requested box, as far as it is given, and else the default one, in which all predicted cycles lie.

    Parameters
    ----------
    stated : mapping
        The loop as certificates state it.
    given : mapping, optional
        "amplitude", "omega" and, where the loop has one, "bias", each from and to [unit of the first element's input;
        rad/s].
    at : OperatingPoint
        Where the external inputs are held.

    Raises
    ------
    EppError
        If a side is not two ascending numbers, positive but for the bias, or is none of these; or if it reaches beyond
        half the sampling frequency.
    NotCovered
        If the loop has no scale of its own and no box is given.
    """
    given, means = {} if given is None else given, [Fraction(x) for x in stated.get("means", ())]
    names = ("amplitude", "omega", "bias")[: 3 if means else 2]
    _require_sides(given, names, system.time_step)
    cycles = _predicted(system, stated, at) if len(given) < len(names) else []
    rest = abs(means[2] / means[0]) if means and means[0] else Fraction(0)
    amplitude = given.get("amplitude") or _amplitudes(system, stated, cycles, rest)
    sides: list[Any] = [*amplitude, *(given.get("omega") or _frequencies(system, stated, cycles))]
    if means:
        largest = amplitude[1] if isinstance(amplitude[1], Fraction) else number_of(amplitude[1])
        widest = max(largest, 2 * rest, *(2 * _short(abs(cycle.bias)) for cycle in cycles if cycle.bias))
        sides += given.get("bias") or (-widest, widest)
    numbers = [x if isinstance(x, Fraction) else number_of(x) for x in sides]
    return tuple(fmpq(x.numerator, x.denominator) for x in numbers)


def _require_sides(given: Mapping[str, Sequence[float]], names: Sequence[str], time_step: float | None) -> None:
    """Refuse a box that is none."""
    for name, ends in given.items():
        if name not in names:
            raise ArgumentError("box", f" has a side {name!r}; expected {' and '.join(map(repr, names))}.", "certify")
        least, positive = (-np.inf, "") if name == "bias" else (0.0, " positive")
        if len(ends) != 2 or not least < ends[0] < ends[1] < np.inf:
            raise EppError(f"certify: {name} of the box is {list(ends)}; expected two ascending{positive} numbers.")
    if time_step and "omega" in given and number_of(given["omega"][1]) * number_of(time_step) > _MOST_PI:
        raise EppError(
            f"certify: omega of the box is {list(given['omega'])}; expected less than half the sampling frequency, "
            f"{np.pi / time_step:.6g} rad/s, beyond which the same motions come again."
        )


class _Predicted(NamedTuple):
    """Where a predicted cycle lies in a box."""

    amplitude: float
    omega: float
    bias: float


def _predicted(system: LureSystem, stated: Mapping[str, Any], at: OperatingPoint) -> list[_Predicted]:
    """Cycles that the DF predicts; none where it does not answer."""
    label = system.element_names[order_of(system)[0] if "ring" in stated else 0]
    try:
        found = [(cycle.elements[label], cycle.omega) for cycle in predict_limit_cycles(system, at)]
    except EppError:
        return []
    places = [_Predicted(float(one["amplitude"]), float(omega), float(one["bias"])) for one, omega in found]
    return [place for place in places if np.isfinite(place).all() and min(place[:2]) > 0.0]


def _frequencies(
    system: LureSystem, stated: Mapping[str, Any], cycles: Sequence[_Predicted]
) -> tuple[Fraction, Fraction]:
    """From far below the slowest scale of G to far above the fastest, with dead time to one turn of it.

    In discrete time up to half the sampling frequency; what is left of it has hardly two samples a period.
    """
    scales = [*_corners(system, stated), *(1.0 / system.delays[system.delays > 0]), *(c.omega for c in cycles)]
    if not scales:
        raise NotCovered("the linear part sets no frequency range; give a box.")
    low, high = _short(min(scales)) / REACH, _short(max(scales)) * REACH
    fastest = max([number_of(c.omega) for c in cycles], default=Fraction(0))
    if system.time_step:
        step = number_of(system.time_step)
        most = _MOST_PI / step
        return low, _PI / step if fastest * _ROOM < _PI / step else (min(fastest, most) + most) / 2
    if np.any(system.delays):
        high = min(high, max(2 * _PI / number_of(system.delays.max()), fastest * _ROOM))
    return low, high


def _corners(system: LureSystem, stated: Mapping[str, Any]) -> list[float]:
    """Sizes of the poles and zeros other than zero [rad/s]."""
    if system.time_step:
        return [float(x) for x in frequency_scales(system)]
    return [float(size) for link in stated.get("ring", [stated]) for size in _sizes_of_roots(link)]


def _sizes_of_roots(link: Mapping[str, Any]) -> list[Any]:
    """Sizes of the poles and zeros other than zero, as balls; from the numbers that are stated, without rounding."""
    polynomials = [fmpq_poly([check_roots.rational(c) for c in link[name][::-1]]) for name in ("num", "den")]
    found: list[Any] = [p.complex_roots() for p in polynomials if p.degree() > 0]
    return [abs(root) for roots in found for root, _ in roots if not root.contains(0)]


def _amplitudes(
    system: LureSystem, stated: Mapping[str, Any], cycles: Sequence[_Predicted], rest: Fraction
) -> tuple[Fraction, Fraction]:
    """From far below the least scale of the first element's input to far above the greatest.

    Scales are its thresholds, the amplitudes at which the gain round the loop is one at a frequency of the linear part,
    its bias where its output is zero, and the amplitudes of predicted cycles; without any, the input at which a jump at
    zero is as high as its line.
    """
    first = order_of(system)[0] if "ring" in stated else 0
    scales = [float(x) for x in system.elements[first].thresholds()]
    if len(system.elements) == 1:
        scales += _balanced(system, stated)
    scales += [float(rest)] * (rest != 0) + [c.amplitude for c in cycles]
    scales = scales or _as_high(stated.get("element", {}))
    if not scales:
        raise NotCovered("the element sets no amplitude range; give a box.")
    return _short(min(scales)) / REACH, _short(max(scales)) * REACH


def _balanced(system: LureSystem, stated: Mapping[str, Any]) -> list[float]:
    """Amplitudes at which ``|N(A) G(j omega)|`` is one at a frequency of the linear part."""
    gains = np.array(_gains(system, stated))
    a = np.geomspace(1e-60, 1e60, 1201)
    size = np.abs(system.elements[0].describing_function(a)[1])[:, None] * gains
    node, gain = np.nonzero((size[:-1] > 1) != (size[1:] > 1))
    here, after = size[node, gain], size[node + 1, gain]
    # The power law between two nodes: exact for a relay and for powers, which scale without a threshold.
    with np.errstate(divide="ignore", invalid="ignore"):  # a gain of zero before a threshold
        share = np.log(here) / (np.log(here) - np.log(after))
    return [float(x) for x in a[node] * (a[node + 1] / a[node]) ** np.where(np.isfinite(share), share, 1.0)]


def _gains(system: LureSystem, stated: Mapping[str, Any]) -> list[float]:
    """Gains of the linear part at the sizes of its poles and zeros, where it has one: none on an undamped pole."""
    if system.time_step:
        gains = np.abs(system.frequency_response(frequency_scales(system))[:, 0, 0])
        return [float(x) for x in gains if 0 < x < np.inf]
    (link,), found = stated.get("ring", [stated]), []
    with ctx.workprec(_BITS):
        for omega in _sizes_of_roots(link):
            num, den = (
                acb_poly([*map(check_roots.rational, link[name][::-1])])(acb(0, omega)) for name in ("num", "den")
            )
            if not (num.contains(0) or den.contains(0)):
                found.append(float(abs(num / den)))
    return found


def _as_high(stated: Mapping[str, Any]) -> list[float]:
    """Input at which the line of an element is as high as its jump at zero."""
    slope = abs(float(Fraction(stated.get("slope", "0"))))
    heights = [abs(float(Fraction(height))) for at, height in stated.get("jumps", ()) if Fraction(at) == 0]
    return [height / slope for height in heights if slope and height]


def _short(value: float) -> Fraction:
    """A scale to three digits: a box does not depend on the rounding of a pole."""
    return Fraction(f"{value:.3g}")
