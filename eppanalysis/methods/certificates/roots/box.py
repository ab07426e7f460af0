"""The box in which roots are certified: what is asked for, or one that the loop's own scales set."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from fractions import Fraction
from typing import Any

import numpy as np
from flint import fmpq

from eppanalysis.errors import EppError
from eppanalysis.methods.certificates.numbers import NotCovered, number_of
from eppanalysis.methods.certificates.roots.find import Box
from eppanalysis.methods.describing.search import frequency_scales
from eppanalysis.models.systems.lure import LureSystem

#: Factor by which the default box reaches beyond the least and the greatest scale of a loop.
REACH = 1024
#: What stands for pi in the ends of default boxes, from below.
_PI = Fraction("3.14")


def box_of(system: LureSystem, stated: Mapping[str, Any], given: Mapping[str, Sequence[float]] | None) -> Box:
    """The box asked for, as far as it is, and else the default one.

    Parameters
    ----------
    stated : mapping
        The loop as certificates state it.
    given : mapping, optional
        "amplitude", "omega" and, where the loop has one, "bias", each from and to [unit of the first element's input;
        rad/s].

    Raises
    ------
    EppError
        If a side is not two ascending numbers, positive but for the bias, or is none of these.
    NotCovered
        If the loop has no scale of its own and no box is given.
    """
    given, means = {} if given is None else given, [Fraction(x) for x in stated.get("means", ())]
    names = ("amplitude", "omega", "bias")[: 3 if means else 2]
    for name, ends in given.items():
        if name not in names:
            raise EppError(f"certify: box has a side {name!r}; expected {' and '.join(map(repr, names))}.")
        least, positive = (-np.inf, "") if name == "bias" else (0.0, " positive")
        if len(ends) != 2 or not least < ends[0] < ends[1] < np.inf:
            raise EppError(f"certify: {name} of the box is {list(ends)}; expected two ascending{positive} numbers.")
    amplitude = given.get("amplitude") or _amplitudes(system, stated)
    sides: list[Any] = [*amplitude, *(given.get("omega") or _frequencies(system))]
    if means:
        rest = abs(means[2] / means[0]) if means[0] else Fraction(0)
        largest = amplitude[1] if isinstance(amplitude[1], Fraction) else number_of(amplitude[1])
        widest = max(largest, 2 * rest)
        sides += given.get("bias") or (-widest, widest)
    numbers = [x if isinstance(x, Fraction) else number_of(x) for x in sides]
    return tuple(fmpq(x.numerator, x.denominator) for x in numbers)


def _frequencies(system: LureSystem) -> tuple[Fraction, Fraction]:
    """From far below the slowest scale of G to far above the fastest, with dead time to one turn of it.

    In discrete time up to half the sampling frequency; what is left of it has hardly two samples a period.
    """
    scales = frequency_scales(system)
    if not scales.size:
        raise NotCovered("the linear part has no frequency of its own; give a box.")
    low, high = _short(scales.min()) / REACH, _short(scales.max()) * REACH
    if system.time_step:
        return low, _PI / number_of(system.time_step)
    return low, min(high, 2 * _PI / number_of(system.delays.max())) if np.any(system.delays) else high


def _amplitudes(system: LureSystem, stated: Mapping[str, Any]) -> tuple[Fraction, Fraction]:
    """From far below the least threshold of the element to far above the greatest.

    Without thresholds about where the loop gain is one at its scales, or where a jump at zero is as high as its line.
    """
    first = system.element_names.index(stated["ring"][0]["name"]) if "ring" in stated else 0
    scales = np.sort(system.elements[first].thresholds())
    if not scales.size:
        scales = _balanced(system)
    if not scales.size:
        scales = _as_high(stated.get("element", {}))
    if not scales.size:
        raise NotCovered("the element has no amplitude of its own; give a box.")
    return _short(scales[0]) / REACH, _short(scales[-1]) * REACH


def _balanced(system: LureSystem) -> np.ndarray:
    """Amplitudes at which ``|N(A) G(j omega)|`` is one, at the scales of frequency."""
    omega = frequency_scales(system)
    gains = np.abs(system.frequency_response(omega)[:, 0, 0])
    gains = gains[(gains > 0) & np.isfinite(gains)]
    if not gains.size:
        return np.zeros(0)
    middle = float(np.exp(np.log(gains).mean()))
    a = np.geomspace(1e-60, 1e60, 1201)
    size = np.abs(system.elements[0].describing_function(a)[1])
    passes = np.flatnonzero((size[:-1] * middle > 1) != (size[1:] * middle > 1))
    # The power law between two nodes: exact for a relay and for powers, which scale without a threshold.
    slope = np.log(size[passes + 1] / size[passes]) / np.log(a[passes + 1] / a[passes])
    return np.sort(a[passes] * (size[passes] * middle) ** (-1.0 / slope))


def _as_high(stated: Mapping[str, Any]) -> np.ndarray:
    """Input at which the line of an element is as high as its jump at zero."""
    slope = abs(float(Fraction(stated.get("slope", "0"))))
    heights = [abs(float(Fraction(height))) for at, height in stated.get("jumps", ()) if Fraction(at) == 0]
    return np.array([height / slope for height in heights if slope and height])


def _short(value: float) -> Fraction:
    """A scale to three digits: a box does not depend on the rounding of a pole."""
    return Fraction(f"{value:.3g}")
