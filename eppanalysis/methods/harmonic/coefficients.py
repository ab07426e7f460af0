"""Fourier coefficients of an element's outputs in its periodic regime, and their derivatives, in closed form.

Between switches an output is affine in the inputs, so that with the Fourier coefficients of the slopes, which are
piecewise constant functions of the phase, all integrals are closed forms:

    w = a(phi) z + r(phi) dz/dt + constant(phi),    hat(a z)_k = sum over m of hat(a)_(k-m) hat(z)_m.

The same coefficients hold the derivatives by the input's coefficients (a Toeplitz and a Hankel matrix); switching
phases contribute where the output jumps, memory values where they act. Smooth parts (sine, cube, falling friction) are
integrated by Gauss-Legendre quadrature between the switches.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from eppanalysis.arrays import Array, ComplexArray
from eppanalysis.errors import ModelError
from eppanalysis.methods.harmonic.elements import PeriodicElement, Regime, rest_value
from eppanalysis.methods.harmonic.series import TURN, orders
from eppanalysis.models.elements.automaton import LEAST, Smooth

if TYPE_CHECKING:
    from eppanalysis.engine.harmonics import Pieces

_PANEL_NODES = 16


def respond(element: PeriodicElement, Z: ComplexArray, omega: float) -> Answer:
    """Settled answer of an element to the free inputs Z, shape (n_free, n + 1), at `omega` [rad/s].

    Raises
    ------
    Unsettled
        If the element does not answer with the period of its input.
    """
    from eppanalysis.engine.harmonics import answer

    regime, pieces, sums = answer(*element.asked(Z, omega))
    return Answer(element, Z, omega, element.regime_of(*regime), pieces, sums)


def stacked(Z: ComplexArray) -> Array:
    """The real unknowns (mean, real parts, imaginary parts) of series (..., n + 1)."""
    return np.concatenate([Z.real, Z.imag[..., 1:]], -1)


@dataclass(frozen=True, eq=False)
class Answer:
    """Fourier coefficients of the outputs in a periodic regime, and their derivatives where they are asked for."""

    owner: PeriodicElement
    Z: ComplexArray
    omega: float
    regime: Regime
    pieces: Pieces
    sums: tuple[ComplexArray, ComplexArray, ComplexArray]  # see `eppanalysis.engine.harmonics.answer`

    @property
    def n(self) -> int:
        """Order."""
        return self.Z.shape[1] - 1

    @property
    def coefficients(self) -> ComplexArray:
        """Of the outputs, shape (n_outputs, n + 1)."""
        return self.sums[0] if self._smooth is None else self.sums[0] + self._smooth[0]

    @cached_property
    def slopes(self) -> ComplexArray:
        """Derivatives of the coefficients, shape (n_outputs, n + 1, 2 n + 2).

        The columns are for the mean, the real and the imaginary parts of c[1..n] of the input, and at last omega.

        Raises
        ------
        ModelError
            If a smooth function acts on a rate.
        """
        from eppanalysis.engine.harmonics import slopes

        _, S, R = self.sums
        if self._smooth is not None:
            S = S + self._smooth[1]
            if np.any(self._smooth[2]):
                raise ModelError(f"{self.owner.name}: a smooth function of a rate is not supported.")
        given = self.owner.table, self.pieces, self.Z[0], self.omega, S, R
        found: ComplexArray = slopes(*given, self._smooth_jumps(), self._rest_slopes())
        return found

    @cached_property
    def _smooth(self) -> tuple[ComplexArray, ComplexArray, ComplexArray] | None:
        return _smooth_part(self) if self.owner.smooth else None

    def inputs(self, phases: Array) -> tuple[Array, Array]:
        """The free input and its rate at phases (m,)."""
        waves = np.exp(1j * np.outer(phases, orders(self.n)))
        return (waves @ self.Z[0]).real, (waves @ (1j * self.omega * orders(self.n) * self.Z[0])).real

    def _smooth_jumps(self) -> Array:
        """By how much smooth functions change each output at each switch, shape (m, n_outputs)."""
        jump = np.zeros((self.regime.fired.size, self.owner.automaton.n_outputs))
        if self.owner.smooth and jump.size:
            z, rate = self.inputs(self.regime.phases)
            acts = np.diff(self.owner.automaton.mode_columns["from_smooth"][self.pieces.modes], axis=0)
            for i, (value, _, _) in enumerate(smooth_functions(self.owner, z, rate)):
                jump += acts[:, :, i] * value[:, None]
        return jump

    def _rest_slopes(self) -> Array:
        """Derivatives of the memory values by the mean if nothing ever sets them anew."""
        out = np.zeros(self.regime.memory.size)
        if out.size and not self.regime.fired.size:
            # The value at which an element rests is the mean of its describing function, of which no derivative is
            # known.
            step = 1e-6 * float(np.abs(self.Z[0]).sum())
            shifted = self.Z.copy()
            shifted[0, 0] += step
            low, high = (rest_value(self.owner.element, z, self.omega) for z in (self.Z, shifted))
            if low is not None and high is not None and step > 0:
                out[0] = (high - low) / step
        return out


def _reciprocal_abs(x: Array, scale: float) -> tuple[Array, Array]:
    y = scale / (1.0 + np.abs(x))
    return y, -y * np.sign(x) / (1.0 + np.abs(x))


def _logarithm(x: Array, scale: float) -> tuple[Array, Array]:
    moves = np.abs(x) > LEAST
    return scale * np.log(np.where(moves, np.abs(x), LEAST)), scale * moves / np.where(moves, x, 1.0)


#: Value and slope of smooth functions of an argument, and their scale.
_CURVES: dict[str, Callable[[Array, float], tuple[Array, Array]]] = {
    "sine": lambda x, scale: (scale * np.sin(x), scale * np.cos(x)),
    "cube": lambda x, scale: (scale * x**3, 3.0 * scale * x**2),
    "reciprocal_abs": _reciprocal_abs,
    "square": lambda x, scale: (scale * x**2, scale * (2.0 * x)),
    "fourth_power": lambda x, scale: (scale * x**4, scale * (4.0 * x**3)),
    "fifth_power": lambda x, scale: (scale * x**5, scale * (5.0 * x**4)),
    "tanh": lambda x, scale: (scale * np.tanh(x), scale * (1.0 - np.tanh(x) ** 2)),
    "arctan": lambda x, scale: (scale * np.arctan(x), scale * (1.0 / (1.0 + x**2))),
    "gaussian": lambda x, scale: (scale * np.exp(-(x**2)), scale * (-2.0 * x * np.exp(-(x**2)))),
    "logarithm": _logarithm,
    "exponential": lambda x, scale: (scale * np.exp(x), scale * np.exp(x)),
}


def smooth_values(smooth: Smooth, argument: Array) -> tuple[Array, Array]:
    """A smooth function and its derivative by its argument ``on_input @ z`` (the constant is added here)."""
    return _CURVES[smooth.kind](argument + smooth.constant, smooth.scale)


def smooth_functions(owner: PeriodicElement, z: Array, rate: Array) -> list[tuple[Array, Array, Array]]:
    """Each smooth function of an element at inputs and their rates, and its derivatives by either.

    One may be a function of those before it.
    """
    found: list[tuple[Array, Array, Array]] = []
    for (smooth, row), weights in zip(owner.smooth, owner.automaton.smooth_on_smooth, strict=True):
        by = np.full(z.shape, row.on_free[0]), np.full(z.shape, row.on_rate[0])
        terms = row.on_free[0] * z + row.on_rate[0] * rate, *by
        for weight, before in zip(weights, found, strict=False):
            if weight:
                terms = terms[0] + weight * before[0], terms[1] + weight * before[1], terms[2] + weight * before[2]
        y, slope = smooth_values(smooth, terms[0])
        found.append((y, slope * terms[1], slope * terms[2]))
    return found


def _smooth_part(c: Answer) -> tuple[ComplexArray, ComplexArray, ComplexArray]:
    """Quadrature of the smooth functions: outputs (no, n + 1), slopes by the free input and by the rate (no, 2 n + 1).

    Panels are halved until the polynomials on them are resolved to rounding.
    """
    longest = 2.0 / max(c.n, 2)
    for _ in range(8):
        panels = _Panels.cut(c, longest)
        found = smooth_functions(c.owner, *c.inputs(panels.phases))
        if all(panels.resolved(part) for parts in found for part in parts):
            break
        longest /= 2.0
    return panels.integrate(found)


@dataclass(frozen=True, eq=False)
class _Panels:
    """Gauss-Legendre nodes on parts of the pieces between switches."""

    whole: Answer
    phases: Array
    weights: Array
    piece: NDArray[np.intp]

    @classmethod
    def cut(cls, whole: Answer, longest: float) -> _Panels:
        node, weight = np.polynomial.legendre.leggauss(_PANEL_NODES)
        counts = np.maximum(1, np.ceil(np.diff(whole.pieces.edges) / longest)).astype(int)
        size = np.repeat(np.diff(whole.pieces.edges) / counts, counts)
        start = np.concatenate([[0.0], np.cumsum(size)[:-1]]) + whole.regime.start
        phases = (start[:, None] + size[:, None] * (node + 1) / 2).ravel()
        weights = (size[:, None] * weight / 2).ravel() / TURN
        return cls(whole, phases, weights, np.repeat(np.repeat(np.arange(len(counts)), counts), _PANEL_NODES))

    def resolved(self, y: Array) -> bool:
        """Whether the last two Legendre coefficients on every panel are near rounding."""
        node, weight = np.polynomial.legendre.leggauss(_PANEL_NODES)
        degrees = np.arange(_PANEL_NODES - 2, _PANEL_NODES)
        to_tail = np.polynomial.legendre.legvander(node, _PANEL_NODES - 1)[:, -2:] * weight[:, None] * (degrees + 0.5)
        return bool(np.abs(y.reshape(-1, _PANEL_NODES) @ to_tail).max() <= 1e-13 * np.abs(y).max())

    def integrate(self, found: list[tuple[Array, Array, Array]]) -> tuple[ComplexArray, ComplexArray, ComplexArray]:
        """Coefficients from the samples of all functions."""
        c, n_out = self.whole, self.whole.owner.automaton.n_outputs
        back = np.exp(-1j * np.outer(self.phases, orders(2 * c.n)))
        W, S, R = (np.zeros((n_out, size + 1), complex) for size in (c.n, 2 * c.n, 2 * c.n))
        for i, (y, by_free, by_rate) in enumerate(found):
            acts = c.owner.automaton.mode_columns["from_smooth"][c.pieces.modes[self.piece], :, i]
            W += 2.0 * (acts * (self.weights * y)[:, None]).T @ back[:, : c.n + 1]
            S += (acts * (self.weights * by_free)[:, None]).T @ back
            R += (acts * (self.weights * by_rate)[:, None]).T @ back
        W[:, 0] *= 0.5
        return W, S, R
