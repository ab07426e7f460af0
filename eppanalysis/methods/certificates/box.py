"""The box in which roots are certified: what is asked for, or one that the loop's own scales set."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from fractions import Fraction
from typing import Any

import numpy as np
from flint import fmpq

from eppanalysis.errors import EppError
from eppanalysis.methods.certificates.numbers import NotCovered, number_of
from eppanalysis.methods.certificates.roots import Box
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
    system : LureSystem
        With one element.
    stated : mapping
        The element as certificates state it.
    given : mapping, optional
        "amplitude" and "omega", each from and to [unit of the element's input; rad/s].

    Raises
    ------
    EppError
        If a side is not two ascending positive numbers, or is none of the two.
    NotCovered
        If the loop has no scale of its own and no box is given.
    """
    given = {} if given is None else given
    for name, ends in given.items():
        if name not in ("amplitude", "omega"):
            raise EppError(f"certify: box has a side {name!r}; expected 'amplitude' and 'omega'.")
        if len(ends) != 2 or not 0 < ends[0] < ends[1] < np.inf:
            raise EppError(f"certify: {name} of the box is {list(ends)}; expected two ascending positive numbers.")
    amplitude = given.get("amplitude") or _amplitudes(system, stated)
    omega = given.get("omega") or _frequencies(system)
    sides = [x if isinstance(x, Fraction) else number_of(x) for x in (*amplitude, *omega)]
    a, b, c, d = (fmpq(x.numerator, x.denominator) for x in sides)
    return a, b, c, d


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
    return low, min(high, 2 * _PI / number_of(system.delays[0])) if system.delays[0] else high


def _amplitudes(system: LureSystem, stated: Mapping[str, Any]) -> tuple[Fraction, Fraction]:
    """From far below the least threshold of the element to far above the greatest.

    Without thresholds about where the loop gain is one at its scales, or where a jump at zero is as high as its line.
    """
    element = system.elements[0]
    scales = np.sort(element.thresholds())
    if not scales.size:
        scales = _balanced(system)
    if not scales.size:
        scales = _as_high(stated)
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
