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

import numpy as np
from numpy.typing import NDArray

from eppanalysis.arrays import Array, BoolArray, ComplexArray
from eppanalysis.engine.harmonics import Pieces, answer, slopes
from eppanalysis.errors import ModelError
from eppanalysis.methods.harmonic.elements import PeriodicElement, Regime, rest_value
from eppanalysis.methods.harmonic.series import TURN, orders
from eppanalysis.models.elements.automaton import LEAST, Smooth

#: Nodes of Gauss's rule on a panel, and how many waves of them are held together.
_PANEL_NODES, _TOGETHER = 16, 2**19
#: Share of a function's size below which its last Legendre coefficients on a panel are rounding.
_RESOLVED = 1e-13
#: Halvings after which only what is steep within a few panels is cut on, and most halvings.
_EVERYWHERE, _DEEPEST = 8, 50


def respond(element: PeriodicElement, Z: ComplexArray, omega: float) -> Answer:
    """Settled answer of an element to the free inputs Z, shape (n_free, n + 1), at `omega` [rad/s].

    Raises
    ------
    Unsettled
        If the element does not answer with the period of its input.
    """
    regime, pieces, sums = answer(*element.asked(Z, omega))
    return Answer(element, Z, omega, element.regime_of(*regime), pieces, sums)


def stacked(Z: ComplexArray) -> Array:
    """The real unknowns (mean, real parts, imaginary parts) of series (..., n + 1)."""
    return np.concatenate([Z.real, Z.imag[..., 1:]], -1)


@dataclass(frozen=True, eq=False)
class Answer:
    """Fourier coefficients of the outputs in a periodic regime, and their derivatives where they are requested."""

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
        both = np.stack([self.Z[0], 1j * self.omega * orders(self.n) * self.Z[0]], axis=1)
        some = _some_at_a_time(phases, self.n)
        found = [(np.exp(1j * np.outer(part, orders(self.n))) @ both).real for part in some]
        z, rate = np.concatenate(found).T
        return z, rate

    def _smooth_jumps(self) -> Array:
        """By how much smooth functions change each output at each switch, shape (m, n_outputs)."""
        jump = np.zeros((self.regime.fired.size, self.owner.automaton.n_outputs))
        if self.owner.smooth and jump.size:
            z, rate = self.inputs(self.regime.phases)
            acts = np.diff(self.owner.automaton.mode_columns["from_smooth"][self.pieces.modes], axis=0)
            for i, (value, *_) in enumerate(smooth_functions(self.owner, z, rate)):
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


#: Curves that change where their argument passes zero, within the order of one.
_ABOUT_ZERO = ("tanh", "arctan", "gaussian", "logarithm", "reciprocal_abs")
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


def smooth_functions(owner: PeriodicElement, z: Array, rate: Array) -> list[tuple[Array, Array, Array, Array]]:
    """Each smooth function of an element at inputs and their rates, its derivatives by either, and its argument.

    One may be a function of those before it.
    """
    found: list[tuple[Array, Array, Array, Array]] = []
    for (smooth, row), weights in zip(owner.smooth, owner.automaton.smooth_on_smooth, strict=True):
        by = np.full(z.shape, row.on_free[0]), np.full(z.shape, row.on_rate[0])
        terms = row.on_free[0] * z + row.on_rate[0] * rate, *by
        for weight, before in zip(weights, found, strict=False):
            if weight:
                terms = terms[0] + weight * before[0], terms[1] + weight * before[1], terms[2] + weight * before[2]
        y, slope = smooth_values(smooth, terms[0])
        found.append((y, slope * terms[1], slope * terms[2], terms[0] + smooth.constant))
    return found


def _smooth_part(c: Answer) -> tuple[ComplexArray, ComplexArray, ComplexArray]:
    """Quadrature of the smooth functions: outputs (no, n + 1), slopes by the free input and by the rate (no, 2 n + 1).

    Panels on which a function is not resolved to rounding are halved.
    """
    panels = _Panels.cut(c, 2.0 / max(c.n, 2))
    sums, sizes, few = panels.nothing(), np.zeros(3 * len(c.owner.smooth)), panels.size.size
    for depth in range(_DEEPEST + 1):
        found, arguments = panels.sampled()
        sizes = np.maximum(sizes, np.abs(found).max((1, 2)))
        fine = panels.resolved(found, sizes) & panels.fits(arguments)
        if depth == _DEEPEST or (depth >= _EVERYWHERE and np.sum(~fine) > few):
            fine[:] = True
        for total, part in zip(sums, panels.of(fine).integrate(found[:, fine]), strict=True):
            total += part
        if np.all(fine):
            break
        panels = panels.of(~fine).halved()
    return sums


def _some_at_a_time(phases: Array, order: int) -> list[Array]:
    """Phases in parts: all orders of all of them are no array that fits into memory."""
    together = max(1, _TOGETHER // (order + 1))
    return np.split(phases, np.arange(together, phases.size, together))


@dataclass(frozen=True, eq=False)
class _Panels:
    """Parts of the pieces between switches, with Gauss-Legendre nodes."""

    whole: Answer
    #: start, size, piece: (p,): phase at which each begins, its length, and the piece of which it is a part.
    start: Array
    size: Array
    piece: NDArray[np.intp]

    @classmethod
    def cut(cls, whole: Answer, longest: float) -> _Panels:
        """All of a period, none longer than that."""
        counts = np.maximum(1, np.ceil(np.diff(whole.pieces.edges) / longest)).astype(int)
        size = np.repeat(np.diff(whole.pieces.edges) / counts, counts)
        start = np.concatenate([[0.0], np.cumsum(size)[:-1]]) + whole.regime.start
        return cls(whole, start, size, np.repeat(np.arange(len(counts)), counts))

    def of(self, which: BoolArray) -> _Panels:
        """Some of them."""
        return _Panels(self.whole, self.start[which], self.size[which], self.piece[which])

    def halved(self) -> _Panels:
        """Their halves."""
        size = np.repeat(self.size / 2.0, 2)
        start = np.repeat(self.start, 2)
        start[1::2] += size[1::2]
        return _Panels(self.whole, start, size, np.repeat(self.piece, 2))

    @property
    def phases(self) -> Array:
        """Of the nodes, shape (p, nodes)."""
        return self.start[:, None] + self.size[:, None] * (_NODE + 1.0) / 2.0

    def sampled(self) -> tuple[Array, Array]:
        """Smooth functions and their derivatives by the free input and by its rate, (3 s, p, nodes); arguments."""
        phases = self.phases
        found = smooth_functions(self.whole.owner, *self.whole.inputs(phases.ravel()))
        values = np.array([part for parts in found for part in parts[:3]]).reshape(-1, *phases.shape)
        return values, np.array([parts[3] for parts in found]).reshape(-1, *phases.shape)

    def fits(self, arguments: Array) -> BoolArray:
        """Panels no longer than a curve is wide: it changes where its argument is of the order of one.

        Between an end and the nodes a narrow one would not show.
        """
        narrow = [smooth.kind in _ABOUT_ZERO for smooth, _ in self.whole.owner.smooth]
        low, high = arguments.min(-1), arguments.max(-1)
        # Up to the ends beyond the first and the last node.
        low, high = low - 0.05 * (high - low), high + 0.05 * (high - low)
        away = np.maximum(np.maximum(low, -high), 0.0)
        fine: BoolArray = np.all((high - low <= 2.0 + away)[narrow], axis=0)
        return fine

    def resolved(self, found: Array, sizes: Array) -> BoolArray:
        """Panels on which the last two Legendre coefficients of all functions are near rounding of their `sizes`."""
        fine: BoolArray = np.all(np.abs(found @ _TO_TAIL).max(-1) <= _RESOLVED * sizes[:, None], axis=0)
        return fine

    def nothing(self) -> tuple[ComplexArray, ComplexArray, ComplexArray]:
        """Coefficients before anything is added."""
        n_out, n = self.whole.owner.automaton.n_outputs, self.whole.n
        W, S, R = (np.zeros((n_out, size + 1), complex) for size in (n, 2 * n, 2 * n))
        return W, S, R

    def integrate(self, found: Array) -> tuple[ComplexArray, ComplexArray, ComplexArray]:
        """Coefficients from the samples of all functions."""
        c, sums = self.whole, self.nothing()
        weights = (self.size[:, None] * _WEIGHT / 2.0 / TURN).ravel()
        acts = np.repeat(
            c.owner.automaton.mode_columns["from_smooth"][c.pieces.modes[self.piece]], _PANEL_NODES, axis=0
        )
        # One row for each output and each of value, slope by the input and slope by its rate.
        given = np.einsum("pos,sdp->dop", acts, found.reshape(len(c.owner.smooth), 3, -1)) * weights
        first = 0
        for some in _some_at_a_time(self.phases.ravel(), 2 * c.n):
            back = np.exp(-1j * np.outer(some, orders(2 * c.n)))
            for total, rows in zip(sums, given[..., first : first + some.size], strict=True):
                total += rows @ back[:, : total.shape[1]]
            first += some.size
        sums[0][:, 1:] *= 2.0
        return sums


_NODE, _WEIGHT = np.polynomial.legendre.leggauss(_PANEL_NODES)
#: From the values at the nodes of a panel to its last two Legendre coefficients.
_TO_TAIL = np.polynomial.legendre.legvander(_NODE, _PANEL_NODES - 1)[:, -2:] * (
    _WEIGHT[:, None] * (np.arange(_PANEL_NODES - 2, _PANEL_NODES) + 0.5)
)
