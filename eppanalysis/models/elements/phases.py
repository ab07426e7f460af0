"""Small tools that the elements share: checked fields, broadcast arguments, stable functions of a phase.

Phases are measured from a peak of the input: level ``x`` is crossed at the angle ``theta`` with
``x = b + A cos(theta)``, which is known to full relative accuracy from its distances to both peaks.
"""

from __future__ import annotations

import operator
from collections.abc import Callable, Iterable
from functools import wraps
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from eppanalysis.arguments import LARGEST_WHOLE, ORDINARY, are_ordinary, floats, is_number
from eppanalysis.arrays import Array, ComplexArray
from eppanalysis.errors import ModelError

#: What a number may be expected to be, in the words in which it is refused.
POSITIVE, NOT_NEGATIVE, NOT_ZERO = "a positive number", "zero or more", "a number other than zero"
_HOLDS = {POSITIVE: operator.gt, NOT_NEGATIVE: operator.ge, NOT_ZERO: operator.ne}
#: Steps of a quantiser on each side: each is a piece of its table, and a mode of the loop.
_MOST_LEVELS = 100_000
#: In place of an amplitude of zero, so that quotients by the amplitude keep their limit.
SMALLEST_AMPLITUDE = 1e-150
#: Nodes of Gauss's rule on each panel: no pole is nearer to one than its own length.
_PLACE, _WEIGHT = np.polynomial.legendre.leggauss(14)
#: Most panels on either side: the smallest is as short as the steepest place in double precision.
_MOST_PANELS = 56
#: Arguments whose nodes are looked at together: those of the steepest fit into a processor's second cache.
_TOGETHER = 32
_FLOAT = np.dtype(float)
_ENDS = (slice(None, -1), slice(1, None))


def require(element: Any, field: str, holds: bool, expected: str, beside: str = "") -> None:
    """Refuse an element whose `field` does not hold, in one sentence; `beside` is the field that it is held against.

    Raises
    ------
    ModelError
        If `holds` is false.
    """
    if not holds:
        other = (beside, getattr(element, beside)) if beside else None
        raise ModelError(type(element).__name__, getattr(element, field), expected, field=field, beside=other)


def require_numbers(element: Any, fields: Iterable[str] = (), /, **expected: str) -> None:
    """Refuse an element unless each of `fields` (by default all that have a unit) is a finite real number.

    Fields that are given by name are to be `POSITIVE`, `NOT_NEGATIVE` or `NOT_ZERO`.

    Raises
    ------
    ModelError
        If one is not.
    """
    for name in fields or element.units:
        value = getattr(element, name)
        require(element, name, is_number(value), "a finite number")
        if not isinstance(value, float | int) or abs(value) > LARGEST_WHOLE:  # which numpy or compiled code cannot take
            object.__setattr__(element, name, float(value))
    for name, words in expected.items():
        require(element, name, _HOLDS[words](getattr(element, name), 0), words)


def require_ordinary(element: Any) -> None:
    """Refuse an element with numbers of a size with which no loop can be computed; alone it takes them.

    Raises
    ------
    ModelError
        If one is not what `ORDINARY` says; what has no bound may be infinite.
    """
    for name in element.units:
        sizes = np.abs(np.asarray(getattr(element, name), float))
        largest = sizes[np.isfinite(sizes)].max(initial=0.0)  # of a list: its others are small beside it
        require(element, name, are_ordinary(largest), ORDINARY)


def require_steps(element: Any, width: str = "step", number: str = "levels") -> None:
    """Refuse a map of many pieces unless their width is positive and their number a whole one that a table can hold.

    Raises
    ------
    ModelError
        If one is not.
    """
    require_numbers(element, **{width: POSITIVE})
    pieces = getattr(element, number)
    whole = pieces == int(pieces) and 1 <= pieces <= _MOST_LEVELS
    expected = f"a positive whole number of {_MOST_LEVELS} or less (those that the input meets)"
    require(element, number, whole, expected)


def _numbers(value: ArrayLike, name: str) -> Array:
    # Balances call it a hundred thousand times, with what needs no conversion.
    if type(value) is np.ndarray and value.dtype is _FLOAT:
        return value
    return floats(value, f"describing_function: {name}")


def broadcast(amplitude: ArrayLike, bias: ArrayLike, omega: ArrayLike) -> tuple[Array, Array, Array]:
    """Arguments of a describing function as float arrays of one shape.

    Raises
    ------
    ModelError
        If an amplitude is negative.
    """
    a, b, w = _numbers(amplitude, "amplitude"), _numbers(bias, "bias"), _numbers(omega, "omega")
    if not a.shape == b.shape == w.shape:
        try:
            a, b, w = np.broadcast_arrays(a, b, w)
        except ValueError:
            shapes = ", ".join(str(v.shape) for v in (a, b, w))
            raise ModelError(f"describing_function: shapes are {shapes}", expected="some that broadcast") from None
    if (a < 0).any():
        raise ModelError("The amplitude of a describing function", float(np.nanmin(a)), "zero or more")
    return a, b, w


def broadcast_with_frequency(amplitude: ArrayLike, bias: ArrayLike, omega: ArrayLike) -> tuple[Array, Array, Array]:
    """The same of a describing function that depends on the frequency.

    Raises
    ------
    ModelError
        If an amplitude or a frequency is negative.
    """
    a, b, w = broadcast(amplitude, bias, omega)
    if (w < 0).any():
        raise ModelError("The frequency of a describing function", float(np.nanmin(w)), ">= 0")
    return a, b, w


def amplitude_and_bias(amplitude: ArrayLike, bias: ArrayLike, omega: ArrayLike) -> tuple[Array, Array]:
    """Arguments of a describing function that does not depend on the frequency; no amplitude is zero."""
    a, b, _ = broadcast(amplitude, bias, omega)
    return np.where(a == 0, SMALLEST_AMPLITUDE, a), b


def with_nan(
    a: Array, b: Array, mean: ArrayLike, gain: ArrayLike, omega: ArrayLike = 0.0
) -> tuple[Array, ComplexArray]:
    """Not-a-number in, not-a-number out (comparisons would take it for an amplitude below the threshold)."""
    undefined = np.isnan(a) | np.isnan(b) | np.isnan(omega)
    return np.where(undefined, np.nan, mean), np.where(undefined, np.nan, gain) + 0j


def distances(*levels: float) -> Array:
    """The positive ones among the absolute values of `levels`, ascending and without repetition."""
    sizes = np.unique(np.abs(np.asarray(levels, float)))
    return sizes[sizes > 0]


def level_ratios(*pieces: tuple[float, float, float]) -> tuple[float, float]:
    """Least and greatest ``level/x`` over all x but zero of pieces (level, from, to) that may overlap."""
    found = []
    for level, start, stop in pieces:
        found += [level / end if np.isfinite(end) else 0.0 for end in (start, stop) if end != 0]
        if level != 0 and start <= 0 <= stop:
            found += [np.copysign(np.inf, level * side) for side, far in ((-1.0, start), (1.0, stop)) if far != 0]
    return float(min(found)), float(max(found))


def angle(from_peak: ArrayLike, to_trough: ArrayLike) -> Array:
    """Angle from the peak, 0 to pi, of the level that lies `from_peak` below it and `to_trough` above the trough."""
    return 2 * np.arctan2(np.sqrt(np.maximum(from_peak, 0)), np.sqrt(np.maximum(to_trough, 0)))


def squared_sine(theta: Array) -> Array:
    """``integral of sin^2 from 0 to theta = (theta - sin theta cos theta)/2``, accurate down to theta = 0."""
    q = theta * theta
    tail = 2 / 155925 + q * (-2 / 6081075 + q * 4 / 638512875)
    series = theta * q * (1 / 3 + q * (-1 / 15 + q * (2 / 315 + q * (-1 / 2835 + q * tail))))
    return np.where(np.abs(theta) < 0.25, series, (theta - np.sin(theta) * np.cos(theta)) / 2)


def layers(a: Array, b: Array, parts: int = 1) -> tuple[Array, Array]:
    """Phases and weights, shapes (..., nodes), of a mean over the rising half period of ``b + a sin(phi)``.

    Panels double their length from the phase at which the input passes zero, or comes nearest to it: the curve changes
    where the argument is of the order of one. Each is cut into as many parts as are requested.
    """
    with np.errstate(invalid="ignore", divide="ignore"):
        centre = -np.arcsin(np.clip(np.nan_to_num(b / a), -1.0, 1.0))
    steepest = float(np.fmax.reduce(a, axis=None, initial=1.0))
    count = int(np.clip(np.ceil(np.log2(2 * np.pi * steepest)), 3, _MOST_PANELS))
    steps = np.pi * np.concatenate([[0.0], 0.5 ** np.arange(count, -1, -1.0)])
    if parts > 1:
        steps = np.interp(np.arange(parts * (len(steps) - 1) + 1) / parts, np.arange(len(steps)), steps)
    sides = [np.clip(centre[..., None] + sign * steps, -np.pi / 2, np.pi / 2) for sign in (1.0, -1.0)]
    low, high = (np.concatenate([np.sort(side, -1)[..., part] for side in sides], -1) for part in _ENDS)
    half = (high - low) / 2
    phi = (low + high)[..., None] / 2 + half[..., None] * _PLACE
    weight = half[..., None] * _WEIGHT / np.pi
    shape = (*phi.shape[:-2], phi.shape[-2] * phi.shape[-1])
    return phi.reshape(shape), weight.reshape(shape)


def some_at_a_time(described: Callable[..., tuple[Array, ComplexArray]]) -> Callable[..., tuple[Array, ComplexArray]]:
    """A describing function by :func:`layers`, of a few arguments after the other.

    With 1,600 nodes each, the hundred thousand of a prediction would fill the memory. The panels are then those of the
    steepest among a few, too, not among all.
    """

    @wraps(described)
    def by_parts(
        self: Any, amplitude: ArrayLike, bias: ArrayLike = 0.0, omega: ArrayLike = 1.0
    ) -> tuple[Array, ComplexArray]:
        a, b, w = broadcast(amplitude, bias, omega)
        if a.size <= _TOGETHER:
            return described(self, a, b, w)
        mean, gain = np.empty(a.size), np.empty(a.size, complex)
        for first in range(0, a.size, _TOGETHER):
            part = slice(first, first + _TOGETHER)
            mean[part], gain[part] = described(self, *(values.ravel()[part] for values in (a, b, w)))
        return mean.reshape(a.shape), gain.reshape(a.shape)

    return by_parts
