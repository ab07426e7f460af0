"""Smooth curves: cube, drag, polynomials, and two that saturate without a corner."""

from __future__ import annotations

from dataclasses import dataclass
from math import comb
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from eppanalysis.arguments import floats
from eppanalysis.arrays import Array
from eppanalysis.errors import ModelError
from eppanalysis.models.elements import automata
from eppanalysis.models.elements.automaton import Automaton, AutomatonBuilder, Smooth
from eppanalysis.models.elements.base import OUT, RATIO, SLOPE, Answer, Nonlinearity
from eppanalysis.models.elements.exact import Named, Reading
from eppanalysis.models.elements.phases import (
    POSITIVE,
    broadcast,
    layers,
    require_numbers,
    some_at_a_time,
    with_nan,
)

#: Smooth functions that powers are made of.
_POWERS = {2: "square", 3: "cube", 4: "fourth_power", 5: "fifth_power"}


@dataclass(frozen=True)
class _Power(Nonlinearity):
    """What cube and drag share: they grow without bound, and go by their names."""

    scale: float

    def __post_init__(self) -> None:
        require_numbers(self)

    def slope_bounds(self) -> tuple[float, float]:
        """Least and greatest slope; one of them is infinite."""
        return self.sector()

    def sector(self) -> tuple[float, float]:
        """Least and greatest ``y/x``; one of them is infinite."""
        far = np.copysign(np.inf, self.scale) if self.scale else 0.0
        return float(min(far, 0.0)), float(max(far, 0.0))

    def exact(self, read: Reading) -> Named:
        """Exact numbers of its fields, for certificates."""
        return Named.of(self, self.kind, read, "scale")


@dataclass(frozen=True)
class Cube(_Power, kind="cube"):
    """``y = scale * x**3``.

    Parameters
    ----------
    scale : float
        Factor of the cube [unit of the output per cubed unit of the input].

    Raises
    ------
    ModelError
        If the scale is not a finite number.
    """

    units = MappingProxyType({"scale": (-3, 1, 0)})

    def output(self, x: ArrayLike, memory: Any = None) -> tuple[Array, Any]:
        """Output for any array `x`; `memory` is handed through unused."""
        return self.scale * floats(x, "output: x") ** 3, memory

    def describing_function(self, amplitude: ArrayLike, bias: ArrayLike = 0.0, omega: ArrayLike = 1.0) -> Answer:
        """Mean ``scale (b^3 + 3 b A^2/2)`` and gain ``scale (3 b^2 + 3 A^2/4)``, by expanding the cube.

        Raises
        ------
        ModelError
            If an amplitude is negative.
        """
        a, b, _ = broadcast(amplitude, bias, omega)
        return np.asarray(self.scale * b * (b * b + 1.5 * a * a)), np.asarray(
            self.scale * (3 * b * b + 0.75 * a * a), complex
        )

    def automaton(self) -> Automaton:
        """One smooth mode."""
        return automata.smooth("cube", self.scale)


@dataclass(frozen=True)
class Drag(_Power, kind="drag"):
    """``y = scale * x*|x|``: quadratic drag of a flow, over the velocity.

    Parameters
    ----------
    scale : float
        Factor of ``x*|x|`` [unit of the output per squared unit of the input].

    Raises
    ------
    ModelError
        If the scale is not a finite number.

    Examples
    --------
    >>> from eppanalysis.models.elements import Drag
    >>> mean, gain = Drag(scale=1.0).describing_function(amplitude=2.0)
    >>> round(float(gain.real), 4)  # 8 scale A/(3 pi)
    1.6977
    """

    units = MappingProxyType({"scale": (-2, 1, 0)})

    def output(self, x: ArrayLike, memory: Any = None) -> tuple[Array, Any]:
        """Output for any array `x`; `memory` is handed through unused."""
        x = floats(x, "output: x")
        return np.asarray(self.scale * x * np.abs(x)), memory

    def describing_function(self, amplitude: ArrayLike, bias: ArrayLike = 0.0, omega: ArrayLike = 1.0) -> Answer:
        """Mean and gain, closed with the phase ``theta = arcsin(b/A)`` at which the input passes zero.

        The gain is ``scale * 2/pi`` times the integral of ``|x| cos^2`` over a period, by parts.

        Raises
        ------
        ModelError
            If an amplitude is negative.
        """
        a, b, _ = broadcast(amplitude, bias, omega)
        crosses = np.abs(b) < a
        safe = np.where(crosses, a, 1.0)
        theta = np.arcsin(np.where(crosses, b, 0.0) / safe)
        sine, cosine = np.sin(theta), np.cos(theta)
        # In units of the amplitude, with b = A sin(theta).
        gain = 2 / np.pi * (2 * sine * (theta + sine * cosine) + 4 / 3 * cosine**3)
        mean = (2 * theta * (1 + 2 * sine**2) + 6 * sine * cosine) / (2 * np.pi)
        gain = np.where(crosses, safe * gain, 2 * np.abs(b))
        mean = np.where(crosses, safe * safe * mean, np.sign(b) * (b * b + a * a / 2))
        return with_nan(a, b, self.scale * mean, self.scale * gain)

    def thresholds(self, bias: float = 0.0) -> Array:
        """The amplitude at which the input passes zero; none without a bias."""
        return np.array([abs(bias)] if bias else [])

    def linear_gain(self) -> Array:
        """The slope at zero, which is zero."""
        return np.zeros((1, 1))

    def automaton(self) -> Automaton:
        """Forward and backward, a square either way."""
        build = AutomatonBuilder(smooth=(Smooth("square", np.ones(1), 0.0, self.scale),))
        forward, backward = build.mode("forward", from_smooth=1.0), build.mode("backward", from_smooth=-1.0)
        build.guard("turns back", forward, backward, on_input=-1.0)
        build.guard("turns forward", backward, forward, on_input=1.0)
        return build.build(forward)


class Polynomial(Nonlinearity, kind="polynomial"):
    """``y = c[0] + c[1] x + c[2] x**2 + ...`` up to the fifth power.

    Parameters
    ----------
    coefficients : array_like, shape (k,)
        From the constant on, at most six, in SI units of output and input.

    Raises
    ------
    ModelError
        If there are none or more than six, or one is not finite.

    Examples
    --------
    >>> from eppanalysis.models.elements import Polynomial
    >>> duffing = Polynomial([0.0, 1.0, 0.0, 0.5])
    >>> mean, gain = duffing.describing_function(amplitude=2.0)
    >>> float(gain.real)  # 1 + 0.5 * 3/4 * 2**2
    2.5
    """

    units = MappingProxyType({"coefficients": RATIO})

    coefficients: Array

    def __init__(self, coefficients: ArrayLike) -> None:
        c = np.array(floats(coefficients, "Polynomial: coefficients", ndmin=1))
        if c.ndim != 1 or not 1 <= c.size <= 6 or not np.all(np.isfinite(c)):
            raise ModelError("Polynomial", c.tolist(), "one to six finite numbers", field="coefficients")
        c.flags.writeable = False
        self.coefficients = c

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Polynomial) and self.coefficients.tolist() == other.coefficients.tolist()

    def __hash__(self) -> int:
        return hash(tuple(self.coefficients.tolist()))

    def __repr__(self) -> str:
        return f"Polynomial(coefficients={self.coefficients.tolist()})"

    def output(self, x: ArrayLike, memory: Any = None) -> tuple[Array, Any]:
        """Output for any array `x`; `memory` is handed through unused."""
        return np.asarray(np.polynomial.polynomial.polyval(floats(x, "output: x"), self.coefficients)), memory

    def describing_function(self, amplitude: ArrayLike, bias: ArrayLike = 0.0, omega: ArrayLike = 1.0) -> Answer:
        """Mean and gain by expanding the powers: the mean of ``sin**(2 k)`` is ``comb(2 k, k)/4**k``.

        Raises
        ------
        ModelError
            If an amplitude is negative.
        """
        a, b, _ = broadcast(amplitude, bias, omega)
        mean, gain = np.zeros(a.shape), np.zeros(a.shape)
        for n, c in enumerate(self.coefficients.tolist()):
            for k in range(n + 1):
                # The k-th power of the sine, to the mean where k is even and to the gain where it is odd.
                whole = c * comb(n, k) * b ** (n - k)
                if k % 2:
                    gain = gain + 2 * whole * a ** (k - 1) * comb(k + 1, (k + 1) // 2) / 2 ** (k + 1)
                else:
                    mean = mean + whole * a**k * comb(k, k // 2) / 2**k
        return with_nan(a, b, mean, gain)

    def thresholds(self, bias: float = 0.0) -> Array:
        """Where two powers are as great as each other: the sizes of the roots."""
        c = np.trim_zeros(self.coefficients, "b")
        sizes = np.unique(np.abs(np.roots(c[::-1]))) if c.size > 1 else np.zeros(0)
        return sizes[sizes > 0]

    def slope_bounds(self) -> tuple[float, float]:
        """Least and greatest slope."""
        return _range(np.asarray(np.polynomial.polynomial.polyder(self.coefficients), float))

    def sector(self) -> tuple[float, float]:
        """Least and greatest ``y/x``; infinite with a constant."""
        if self.coefficients[0] != 0.0:
            return -np.inf, np.inf
        return _range(self.coefficients[1:]) if self.coefficients.size > 1 else (0.0, 0.0)

    def linear_gain(self) -> Array:
        """The slope at zero."""
        return np.array([[self.coefficients[1] if self.coefficients.size > 1 else 0.0]])

    def automaton(self) -> Automaton:
        """One smooth mode."""
        c = dict(enumerate(self.coefficients.tolist()))
        smooth = tuple(Smooth(kind, np.ones(1), 0.0, c[n]) for n, kind in _POWERS.items() if c.get(n))
        build = AutomatonBuilder(smooth=smooth)
        build.mode("smooth", from_input=c.get(1, 0.0), constant=c[0], from_smooth=np.ones(len(smooth)))
        return build.build()


def _range(coefficients: Array) -> tuple[float, float]:
    """Least and greatest value of a polynomial over all real numbers."""
    c = np.trim_zeros(np.atleast_1d(coefficients), "b")
    if c.size < 2:
        return (float(c[0]), float(c[0])) if c.size else (0.0, 0.0)
    turns = np.roots(np.polynomial.polynomial.polyder(c)[::-1]) if c.size > 2 else np.zeros(0)
    # A turn that is a double root may be a rounding off the real axis; a value too many is one that is taken.
    values = np.polynomial.polynomial.polyval(turns.real, c).tolist()
    far = np.copysign(np.inf, c[-1])
    values += [far, far if c.size % 2 else -far]
    return float(min(values)), float(max(values))


@dataclass(frozen=True)
class _Saturating(Nonlinearity):
    """What the two that saturate share."""

    units = MappingProxyType({"level": OUT, "slope": SLOPE})

    level: float
    slope: float = 1.0

    def __post_init__(self) -> None:
        require_numbers(self, level=POSITIVE, slope=POSITIVE)

    def thresholds(self, bias: float = 0.0) -> Array:
        """The amplitude at which a line would reach the level."""
        return np.array([self.level / self.slope])

    def slope_bounds(self) -> tuple[float, float]:
        """Zero far out, `slope` at zero."""
        return 0.0, self.slope

    def sector(self) -> tuple[float, float]:
        """Zero far out, `slope` at zero."""
        return 0.0, self.slope


@dataclass(frozen=True)
class Tanh(_Saturating, kind="tanh"):
    """``y = level * tanh(slope*x/level)``: a saturation without a corner.

    Parameters
    ----------
    level : float
        Output far out, positive [unit of the output].
    slope : float, optional
        Slope at zero, positive [unit of the output per unit of the input].

    Raises
    ------
    ModelError
        If a field is not a positive number.

    Examples
    --------
    >>> from eppanalysis.models.elements import Tanh
    >>> mean, gain = Tanh(level=1.0).describing_function(amplitude=[0.0, 1.0, 100.0])
    >>> gain.real.round(4).tolist()
    [1.0, 0.8117, 0.0127]
    """

    def output(self, x: ArrayLike, memory: Any = None) -> tuple[Array, Any]:
        """Output for any array `x`; `memory` is handed through unused."""
        return np.asarray(self.level * np.tanh(self.slope / self.level * floats(x, "output: x"))), memory

    @some_at_a_time
    def describing_function(self, amplitude: ArrayLike, bias: ArrayLike = 0.0, omega: ArrayLike = 1.0) -> Answer:
        """Mean and gain by quadrature, for there is no closed form; accurate to about 1e-12.

        Raises
        ------
        ModelError
            If an amplitude is negative.
        """
        a, b, _ = broadcast(amplitude, bias, omega)
        scale = self.slope / self.level
        phi, weight = layers(scale * a, scale * b)
        sine = np.sin(phi)
        x = scale * (b[..., None] + a[..., None] * sine)
        e = np.exp(-2 * np.abs(x))
        mean = self.level * (weight * np.tanh(x)).sum(-1)
        # By parts, so that all terms are positive: the mean slope, weighted by twice the squared cosine.
        gain = 2 * self.slope * (weight * 4 * e / (1 + e) ** 2 * np.cos(phi) ** 2).sum(-1)
        return with_nan(a, b, mean, gain)

    def automaton(self) -> Automaton:
        """One smooth mode."""
        return _one(Smooth("tanh", np.array([self.slope / self.level]), 0.0, self.level))


@dataclass(frozen=True)
class Arctan(_Saturating, kind="arctan"):
    """``y = 2*level/pi * arctan(pi*slope*x/(2*level))``: a saturation without a corner, slow to reach its level.

    Parameters
    ----------
    level : float
        Output far out, positive [unit of the output].
    slope : float, optional
        Slope at zero, positive [unit of the output per unit of the input].

    Raises
    ------
    ModelError
        If a field is not a positive number.

    Examples
    --------
    >>> from eppanalysis.models.elements import Arctan
    >>> mean, gain = Arctan(level=1.0).describing_function(amplitude=[0.0, 1.0, 100.0])
    >>> gain.real.round(4).tolist()
    [1.0, 0.6988, 0.0127]
    """

    def output(self, x: ArrayLike, memory: Any = None) -> tuple[Array, Any]:
        """Output for any array `x`; `memory` is handed through unused."""
        return np.asarray(self._height * np.arctan(self.slope / self._height * floats(x, "output: x"))), memory

    def describing_function(self, amplitude: ArrayLike, bias: ArrayLike = 0.0, omega: ArrayLike = 1.0) -> Answer:
        """Mean and gain, closed in complex numbers: ``1/(1 + x^2) = -Im 1/(x + j)`` is integrated by residues.

        With ``z = b + j`` and ``s = sqrt(z^2 - A^2)``, both scaled, the mean is ``pi/2 - arg((z + s)/2)`` and the gain
        ``-2 Im 1/(z + s)``.

        Raises
        ------
        ModelError
            If an amplitude is negative.
        """
        a, b, _ = broadcast(amplitude, bias, omega)
        scale = self.slope / self._height
        z = np.asarray(scale * b + 1j)
        # Two roots for that of z^2 - A^2: each stays on its branch, where the square of z would cross the cut.
        both = z + np.sqrt(z - scale * a) * np.sqrt(z + scale * a)
        # pi/2 - arg, without the loss of a difference.
        return with_nan(a, b, self._height * np.arctan2(both.real, both.imag), -2 * self.slope * (1 / both).imag)

    @property
    def _height(self) -> float:
        return 2 * self.level / np.pi

    def automaton(self) -> Automaton:
        """One smooth mode."""
        return _one(Smooth("arctan", np.array([self.slope / self._height]), 0.0, self._height))


def _one(channel: Smooth) -> Automaton:
    build = AutomatonBuilder(smooth=(channel,))
    build.mode("smooth", from_smooth=1.0)
    return build.build()
