"""The one mechanism behind every static element: a piecewise-linear map with jumps."""

from __future__ import annotations

from dataclasses import FrozenInstanceError
from fractions import Fraction
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from eppanalysis.arguments import floats
from eppanalysis.arrays import Array
from eppanalysis.errors import ModelError
from eppanalysis.models.elements import automata
from eppanalysis.models.elements.automaton import Automaton
from eppanalysis.models.elements.base import IN, OUT, SLOPE, Answer, ClosedForm, Nonlinearity
from eppanalysis.models.elements.exact import Half, Pieces, Reading
from eppanalysis.models.elements.phases import broadcast, distances


class PiecewiseLinear(Nonlinearity, kind="piecewise_linear"):
    """Piecewise-linear map; piece i, between breakpoints i-1 and i, is ``y = slopes[i]*x + intercepts[i]``.

    At a breakpoint with a jump the map returns the midpoint. Instances are immutable.

    Parameters
    ----------
    breakpoints : array_like, shape (k,)
        Strictly ascending [unit of the input].
    slopes : array_like, shape (k + 1,)
        Slope of each piece [unit of the output per unit of the input].
    intercepts : array_like, shape (k + 1,)
        Output of each piece, continued to zero input [unit of the output].

    Attributes
    ----------
    jumps : array, shape (k,)
        Step of the output at each breakpoint, exactly zero where the pieces meet to rounding.

    Raises
    ------
    ModelError
        If shapes do not fit, a number is not finite or breakpoints do not ascend.

    Examples
    --------
    >>> from eppanalysis.models.elements import PiecewiseLinear
    >>> cable = PiecewiseLinear([0.0], [0.0, 100.0], [0.0, 0.0])
    >>> cable.output(0.5)[0]
    array(50.)
    >>> mean, gain = cable.describing_function(amplitude=1.0)
    >>> round(float(mean), 4), round(float(gain.real), 4)
    (31.831, 50.0)
    """

    units = MappingProxyType({"breakpoints": IN, "slopes": SLOPE, "intercepts": OUT})

    breakpoints: Array
    slopes: Array
    intercepts: Array
    jumps: Array

    def __init__(self, breakpoints: ArrayLike, slopes: ArrayLike, intercepts: ArrayLike) -> None:
        self._set_pieces(breakpoints, slopes, intercepts)

    def _set_pieces(self, breakpoints: ArrayLike, slopes: ArrayLike, intercepts: ArrayLike) -> None:
        """Store the pieces, checked and read-only; subclasses call it when their own fields are valid."""
        given = {"breakpoints": breakpoints, "slopes": slopes, "intercepts": intercepts}
        who = type(self).__name__
        edges, slope, offset = (floats(v, f"{who}: {n}", ndmin=1, copy=True) for n, v in given.items())
        self._check_pieces({"breakpoints": edges, "slopes": slope, "intercepts": offset})
        terms = np.array([slope[1:] * edges, offset[1:], -slope[:-1] * edges, -offset[:-1]])
        jumps = terms.sum(axis=0)
        # Neighbouring pieces that meet only to rounding are continuous: else slopes there would seem infinite.
        size = np.abs(terms).sum(axis=0) + np.finfo(float).tiny  # below that number rounding becomes no smaller
        jumps[np.abs(jumps) <= 16 * np.finfo(float).eps * size] = 0.0
        for name, values in (("breakpoints", edges), ("slopes", slope), ("intercepts", offset), ("jumps", jumps)):
            values.flags.writeable = False
            object.__setattr__(self, name, values)

    def _check_pieces(self, pieces: dict[str, Array]) -> None:
        label = type(self).__name__
        k = pieces["breakpoints"].size
        for name, values in pieces.items():
            wanted = (k,) if name == "breakpoints" else (k + 1,)
            if values.shape != wanted:
                raise ModelError(f"{label}: {name} has shape {values.shape}", expected=f"shape {wanted}", field=name)
            if not np.all(np.isfinite(values)):
                raise ModelError(label, values.tolist(), "finite numbers", field=name)
        if np.any(np.diff(pieces["breakpoints"]) <= 0):
            raise ModelError(label, pieces["breakpoints"].tolist(), "ascending numbers", field="breakpoints")

    def __setattr__(self, name: str, value: Any) -> None:
        raise FrozenInstanceError(f"cannot assign to field {name!r}")

    def __delattr__(self, name: str) -> None:
        raise FrozenInstanceError(f"cannot delete field {name!r}")

    def __setstate__(self, state: dict[str, Any]) -> None:
        # Pickling forgets that arrays are read-only.
        for value in state.values():
            if isinstance(value, np.ndarray):
                value.flags.writeable = False
        self.__dict__.update(state)

    def _key(self) -> tuple[Any, ...]:
        return type(self), *(tuple(v.tolist()) for v in (self.breakpoints, self.slopes, self.intercepts))

    def __eq__(self, other: object) -> bool:
        return isinstance(other, PiecewiseLinear) and self._key() == other._key()

    def __hash__(self) -> int:
        return hash(self._key())

    def __repr__(self) -> str:
        named = (f"{n}={getattr(self, n).tolist()}" for n in ("breakpoints", "slopes", "intercepts"))
        return f"{type(self).__name__}({', '.join(named)})"

    def output(self, x: ArrayLike, memory: Any = None) -> tuple[Array, Any]:
        """Output of the map for any array `x`; `memory` is handed through unused."""
        x = floats(x, "output: x")
        left = np.searchsorted(self.breakpoints, x, side="left")
        right = np.searchsorted(self.breakpoints, x, side="right")
        slope, offset = self.slopes, self.intercepts
        return np.asarray((slope[left] * x + offset[left] + (slope[right] * x + offset[right])) / 2), memory

    def describing_function(self, amplitude: ArrayLike, bias: ArrayLike = 0.0, omega: ArrayLike = 1.0) -> Answer:
        """Mean output and gain (real, the map has no memory) for ``x = bias + amplitude * sin(omega t)``.

        Exact for every breakpoint and jump, by the closed form in :mod:`eppanalysis.engine.describing` (the
        classical one of Gelb and Vander Velde, Multiple-Input Describing Functions, 1968, with the bias kept and the
        terms ordered so that none cancel). At amplitude zero the gain is the slope at the bias.

        Raises
        ------
        ModelError
            If an amplitude is negative.
        """
        a, b, _ = broadcast(amplitude, bias, omega)
        mean, gain, _ = self._map.described(a, b)
        return mean, gain.astype(complex)

    def described_with_slopes(self, amplitude: Array, bias: Array) -> tuple[Array, Array, Array] | None:
        """Mean and gain of the map, and the derivatives of the mean."""
        return self._map.described(amplitude, bias) if self._is_described_by_its_map else None

    @property
    def closed_form(self) -> ClosedForm | None:
        """The pieces of the map, from which mean and gain are computed."""
        return self._map if self._is_described_by_its_map else None

    @property
    def _is_described_by_its_map(self) -> bool:
        return type(self).describing_function is PiecewiseLinear.describing_function

    @property
    def _map(self) -> ClosedForm:
        return ClosedForm((self.breakpoints, self.slopes, self.intercepts, self.jumps))

    def thresholds(self, bias: float = 0.0) -> Array:
        """Amplitudes at which the oscillation about `bias` reaches one more breakpoint."""
        return distances(*(self.breakpoints - bias))

    def slope_bounds(self) -> tuple[float, float]:
        """Least and greatest slope of the map; infinite at a jump."""
        slopes = np.concatenate([self.slopes, np.copysign(np.inf, self.jumps[self.jumps != 0.0])])
        return float(slopes.min()), float(slopes.max())

    def sector(self) -> tuple[float, float]:
        """Least and greatest ``y/x`` over all x except zero; infinite where the map misses the origin."""
        # Within a piece y/x = slope + intercept/x goes one way only: its ends decide, and zero where it lies in the
        # piece.
        at_zero = int(np.searchsorted(self.breakpoints, 0.0, side="right"))
        corner = at_zero > 0 and self.breakpoints[at_zero - 1] == 0
        ratios = [self.slopes[0], self.slopes[-1]]
        for side, piece in ((1.0, at_zero), (-1.0, at_zero - 1 if corner else at_zero)):
            start = self.intercepts[piece]
            ratios.append(self.slopes[piece] if start == 0 else np.copysign(np.inf, start * side))
        away = np.flatnonzero(self.breakpoints)
        beside = [self.slopes[p] + self.intercepts[p] / self.breakpoints[away] for p in (away, away + 1)]
        every = np.concatenate([ratios, *beside])
        return float(every.min()), float(every.max())

    def exact(self, read: Reading) -> Pieces:
        """Its pieces on either side of zero in exact numbers; where the output at zero is not zero, as a jump there."""
        b, m, c = ([read(x) for x in values.tolist()] for values in (self.breakpoints, self.slopes, self.intercepts))
        jumps = self.jumps.tolist()  # zero where pieces meet to rounding
        steps = [(m[i + 1] - m[i]) * b[i] + c[i + 1] - c[i] if jumps[i] else Fraction(0) for i in range(len(b))]
        turned = _half([-x for x in b[::-1]], m[::-1], [-x for x in c[::-1]], steps[::-1])
        return Pieces(_half(b, m, c, steps), turned)

    def automaton(self) -> Automaton:
        """Modes, guards and resets: one mode a piece, and one that slides along each jump."""
        return automata.static_map(self.breakpoints, self.slopes, self.intercepts, self.output(self.breakpoints)[0])


#: The element without an effect, of which a linear one is made by its states.
UNITY = PiecewiseLinear([], [1.0], [0.0])


def _half(b: list[Fraction], m: list[Fraction], c: list[Fraction], steps: list[Fraction]) -> Half:
    """The pieces for x > 0."""
    first = sum(x <= 0 for x in b)
    bends = [(b[i], m[i + 1] - m[i]) for i in range(first, len(b))]
    jumps = [(Fraction(0), c[first]), *zip(b[first:], steps[first:], strict=True)]
    return Half(m[first], tuple(bend for bend in bends if bend[1]), tuple(jump for jump in jumps if jump[1]))
