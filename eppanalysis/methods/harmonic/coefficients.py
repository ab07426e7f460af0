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
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from eppanalysis.errors import ModelError
from eppanalysis.methods.harmonic.elements import PeriodicElement, Regime, Row, rest_value
from eppanalysis.methods.harmonic.series import TURN, Array, ComplexArray, orders
from eppanalysis.models.elements.automaton import Smooth

_PANEL_NODES = 16


@dataclass(frozen=True, eq=False)
class Answer:
    """Fourier coefficients of the outputs, shape (n_outputs, n + 1), and their derivatives.

    `slopes` has shape (n_outputs, n + 1, n_free * (2 n + 1) + 1); its columns are for each free input the mean, the
    real and the imaginary parts of c[1..n], and at last omega. None where they were not asked for.
    """

    coefficients: ComplexArray
    slopes: ComplexArray | None
    regime: Regime


def respond(element: PeriodicElement, Z: ComplexArray, omega: float, slopes: bool = True) -> Answer:
    """Settled answer of an element to the free inputs Z, shape (n_free, n + 1), at `omega` [rad/s].

    Raises
    ------
    Unsettled
        If the element does not answer with the period of its input.
    ModelError
        If a smooth function acts on a rate.
    """
    return _Coefficients(element, Z, omega, element.regime(Z, omega)).answer(slopes)


@lru_cache(maxsize=64)
def _grid(n: int) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Indices k - m + 2 n and k + m + 2 n into coefficients -2 n .. 2 n."""
    k, m = np.arange(n + 1)[:, None], np.arange(n + 1)[None, :]
    return k - m + 2 * n, k + m + 2 * n


def product_matrix(S: ComplexArray) -> ComplexArray:
    """From the real unknowns of a series (mean, real parts, imaginary parts) to the coefficients of its product.

    Parameters
    ----------
    S : array, shape (..., 2 n + 1)
        Two-sided coefficients 0..2 n of a real function, ``sum over q of S_q exp(j q phi)``.

    Returns
    -------
    array, shape (..., n + 1, 2 n + 1)
    """
    n = (S.shape[-1] - 1) // 2
    both = np.concatenate([np.conj(S[..., :0:-1]), S], -1)
    minus, plus = (both[..., i] for i in _grid(n))
    out = np.concatenate([minus + plus, 1j * (minus - plus)[..., 1:]], -1)
    out[..., 0, :] *= 0.5
    return out


def stacked(Z: ComplexArray) -> Array:
    """The real unknowns (mean, real parts, imaginary parts) of series (..., n + 1)."""
    return np.concatenate([Z.real, Z.imag[..., 1:]], -1)


class _Coefficients:
    """Integrals over the pieces of one period; lives for one call."""

    def __init__(self, owner: PeriodicElement, Z: ComplexArray, omega: float, regime: Regime) -> None:
        self.owner, self.Z, self.omega, self.regime = owner, Z, omega, regime
        self.n = Z.shape[1] - 1
        self.phases = np.array([s.phase for s in regime.switches])
        self.edges = np.concatenate([[regime.start], self.phases, [regime.start + TURN]])
        self.modes = [regime.mode, *(s.mode for s in regime.switches)]
        self.memory = np.array([regime.memory, *(s.memory for s in regime.switches)])
        modes = owner.automaton.mode_columns
        self.on_free, self.on_rate = owner.from_input(self.modes)
        self.from_memory, self.constant = modes["from_memory"][self.modes], modes["constant"][self.modes]
        self.level = self.constant + (self.from_memory @ self.memory[:, :, None])[..., 0]
        # Mean over one period of exp(-j q phi), q = 0..2 n, on each piece: the product of two series of order n needs 2
        # n (docs/theory/harmonic_balance.md, Coefficients without sampling).
        q = orders(2 * self.n)
        waves = np.exp(-1j * np.outer(self.edges, q))
        self.at_switch = waves[1:-1, : self.n + 1]
        self.pieces = np.empty((len(self.modes), q.size), complex)
        self.pieces[:, 1:] = (waves[:-1, 1:] - waves[1:, 1:]) / (1j * TURN * q[1:])
        self.pieces[:, 0] = np.diff(self.edges) / TURN

    def answer(self, slopes: bool) -> Answer:
        n, x = self.n, stacked(self.Z)
        S: ComplexArray = np.asarray(np.einsum("pof,pq->ofq", self.on_free, self.pieces), complex)
        R: ComplexArray = np.asarray(self.on_rate.T @ self.pieces, complex)
        products = product_matrix(S)
        W = np.einsum("ofkx,fx->ok", products, x)
        constants = 2.0 * (self.level.T @ self.pieces[:, : n + 1])
        constants[:, 0] *= 0.5
        W += constants
        rated = bool(np.any(self.on_rate))
        k = orders(n)
        if rated:
            by_rate = product_matrix(R)
            W += self.omega * (by_rate @ stacked(1j * k * self.Z[0]))
        smooth = _smooth_part(self) if self.owner.smooth else None
        if smooth is not None:
            W += smooth[0]
        if not slopes:
            return Answer(W, None, self.regime)
        dW = np.zeros((len(W), n + 1, x.size + 1), complex)
        if smooth is not None:
            products = products + product_matrix(smooth[1])
            if np.any(smooth[2]):
                raise ModelError(f"{self.owner.name}: a smooth function of a rate is not supported.")
        dW[:, :, :-1] = np.moveaxis(products, 1, 2).reshape(len(W), n + 1, -1)
        if rated:
            # A real part adds j k omega, an imaginary part -k omega to the rate's coefficient.
            dW[:, :, 1 : n + 1] += self.omega * k[1:] * by_rate[:, :, n + 1 :]
            dW[:, :, n + 1 : 2 * n + 1] -= self.omega * k[1:] * by_rate[:, :, 1 : n + 1]
            dW[:, :, -1] += by_rate @ stacked(1j * k * self.Z[0])
        self._add_switches(dW)
        return Answer(W, dW, self.regime)

    def _basis(self, phases: Array) -> tuple[Array, Array]:
        """What the unknowns of one free series do to its value and to its derivative by phase, shape (m, 2 n + 1)."""
        k = orders(self.n)
        angle = np.outer(phases, k)
        c, s = np.cos(angle), np.sin(angle)
        return np.concatenate([c, -s[:, 1:]], 1), np.concatenate([-k * s, -(k * c)[:, 1:]], 1)

    def _inputs_at(self, on_free: Array, on_rate: Array, on_clock: Array) -> tuple[Array, Array]:
        """Derivatives by the unknowns (m, x + 1) and by phase (m,) of affine functions of the inputs at switches."""
        basis, bent = self._basis_at_switches
        slope, curve = self._value_at_switches
        by_x = (on_free[:, :, None] * basis[:, None] + self.omega * on_rate[:, :, None] * bent[:, None]).reshape(
            len(basis), -1
        )
        by_omega = (on_rate * slope).sum(1) - on_clock * self.phases / self.omega**2
        by_phase = (on_free * slope).sum(1) + self.omega * (on_rate * curve).sum(1) + on_clock / self.omega
        return np.concatenate([by_x, by_omega[:, None]], 1), by_phase

    def _prepare(self) -> None:
        self._basis_at_switches = self._basis(self.phases)
        jk = 1j * orders(self.n)
        waves = np.conj(self.at_switch)
        self._value_at_switches = (waves @ (jk * self.Z).T).real, (waves @ (jk * jk * self.Z).T).real

    def inputs(self, phases: Array) -> tuple[Array, Array]:
        """Free inputs (m, n_free) and rate of the first one (m,)."""
        waves = np.exp(1j * np.outer(phases, orders(self.n)))
        return (waves @ self.Z.T).real, (waves @ (1j * self.omega * orders(self.n) * self.Z[0])).real

    def _output_at(self, piece: NDArray[np.intp], phases: Array) -> Array:
        """Outputs at phases as the modes of the given pieces have them, shape (m, n_outputs)."""
        z, rate = self.inputs(phases)
        w = np.einsum("mof,mf->mo", self.on_free[piece], z) + self.on_rate[piece] * rate[:, None] + self.level[piece]
        for i, (smooth, row) in enumerate(self.owner.smooth):
            from_smooth = np.array([self.owner.automaton.modes[self.modes[p]].from_smooth[:, i] for p in piece])
            w += from_smooth * smooth_values(smooth, z @ row.on_free + row.on_rate[0] * rate)[0][:, None]
        return w

    def _add_switches(self, dW: ComplexArray) -> None:
        """Add what moving switches (where the output jumps) and memory values contribute."""
        count = len(self.phases)
        size = dW.shape[2]
        memory_slopes = self._rest_slopes(size)
        if count:
            before, after = np.arange(count), np.arange(1, count + 1)
            jump = self._output_at(after, self.phases) - self._output_at(before, self.phases)
            scale = np.abs(jump).max(initial=0.0)
            jumps = bool(scale > 1e-14 * (np.abs(self.level).max() + scale)) or self.owner.automaton.n_memory > 0
            # A switch that comes later by dphi keeps the old output for so long: minus the jump times dphi. Where the
            # output is continuous a moving switch changes nothing to first order.
            if jumps:
                moved, memory_slopes = self._moves(size, memory_slopes)
                share = -np.einsum("mo,mk->okm", jump, self.at_switch) / np.pi
                share[:, 0] *= 0.5
                dW += share @ moved
        if self.owner.automaton.n_memory:
            share = 2.0 * np.einsum("poh,pk->okph", self.from_memory, self.pieces[:, : self.n + 1])
            share[:, 0] *= 0.5
            dW += np.einsum("okph,phx->okx", share, memory_slopes)

    def _rest_slopes(self, size: int) -> Array:
        """Derivatives of the memory values on each piece by the unknowns if nothing ever sets them anew."""
        n_memory = self.owner.automaton.n_memory
        out = np.zeros((len(self.modes), n_memory, size))
        if n_memory and not len(self.phases):
            step = 1e-6 * float(np.abs(self.Z[0]).sum())
            shifted = self.Z.copy()
            shifted[0, 0] += step
            low, high = (rest_value(self.owner.element, z, self.omega) for z in (self.Z, shifted))
            if low is not None and high is not None and step > 0:
                out[:, 0, 0] = (high - low) / step
        return out

    def _moves(self, size: int, memory_slopes: Array) -> tuple[Array, Array]:
        """Derivatives of the switching phases (m, x + 1) and of the memory values (m + 1, n_memory, x + 1)."""
        self._prepare()
        switches = self.regime.switches
        on = [s.mode_guard.row for s in switches]
        base, speed = self._inputs_at(
            np.array([r.on_free for r in on]), np.array([r.on_rate for r in on]), np.array([r.on_clock for r in on])
        )
        at_once = np.concatenate([[False], np.diff(self.phases) == 0.0])
        # A grazing switch moves without bound; the bound keeps Newton's matrix finite.
        speed = np.where(np.abs(speed) > 1e-300, speed, 1e-300)
        moved = -base / speed[:, None]
        n_memory = self.owner.automaton.n_memory
        if not n_memory:
            for late in np.flatnonzero(at_once):
                moved[late] = moved[late - 1]
            return moved, memory_slopes
        resets = [self._reset(h) for h in range(n_memory)]
        h = memory_slopes[0]
        for _ in range(2):
            memory_slopes[0] = h
            for i, s in enumerate(switches):
                if at_once[i]:
                    moved[i] = moved[i - 1]
                else:
                    moved[i] = -(base[i] + s.mode_guard.on_memory @ h) / speed[i]
                h = s.mode_guard.guard.memory_from_memory @ h + np.array(
                    [by_x[i] + by_phase[i] * moved[i] for by_x, by_phase in resets]
                )
                memory_slopes[i + 1] = h
            if self.owner.clocked:
                h = h.copy()
                h[:, -1] += TURN / self.omega**2
        return moved, memory_slopes

    def _reset(self, number: int) -> tuple[Array, Array]:
        """Derivatives of what each switch writes into one memory value, by the unknowns and by phase."""
        rows = [self.owner.row(s.mode_guard.guard.memory_from_input[number]) for s in self.regime.switches]
        return self._inputs_at(
            np.array([r.on_free for r in rows]),
            np.array([r.on_rate for r in rows]),
            np.array([r.on_clock for r in rows]),
        )


def _reciprocal_abs(x: Array, scale: float) -> tuple[Array, Array]:
    y = scale / (1.0 + np.abs(x))
    return y, -y * np.sign(x) / (1.0 + np.abs(x))


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
}


def smooth_values(smooth: Smooth, argument: Array) -> tuple[Array, Array]:
    """A smooth function and its derivative by its argument ``on_input @ z`` (the constant is added here)."""
    return _CURVES[smooth.kind](argument + smooth.constant, smooth.scale)


def _smooth_part(c: _Coefficients) -> tuple[ComplexArray, ComplexArray, ComplexArray]:
    """Quadrature of the smooth functions: outputs (no, n + 1), slopes by free inputs (no, nf, 2 n + 1) and by the rate.

    Panels are halved until the polynomials on them are resolved to rounding.
    """
    longest = 2.0 / max(c.n, 2)
    for _ in range(8):
        panels = _Panels.cut(c, longest)
        found = [panels.sample(smooth, row) for smooth, row in c.owner.smooth]
        if all(panels.resolved(y) and panels.resolved(slope) for y, slope in found):
            break
        longest /= 2.0
    return panels.integrate(found)


@dataclass(frozen=True, eq=False)
class _Panels:
    """Gauss-Legendre nodes on parts of the pieces between switches."""

    whole: _Coefficients
    phases: Array
    weights: Array
    piece: NDArray[np.intp]

    @classmethod
    def cut(cls, whole: _Coefficients, longest: float) -> _Panels:
        node, weight = np.polynomial.legendre.leggauss(_PANEL_NODES)
        counts = np.maximum(1, np.ceil(np.diff(whole.edges) / longest)).astype(int)
        size = np.repeat(np.diff(whole.edges) / counts, counts)
        start = np.concatenate([[0.0], np.cumsum(size)[:-1]]) + whole.regime.start
        phases = (start[:, None] + size[:, None] * (node + 1) / 2).ravel()
        weights = (size[:, None] * weight / 2).ravel() / TURN
        return cls(whole, phases, weights, np.repeat(np.repeat(np.arange(len(counts)), counts), _PANEL_NODES))

    def sample(self, smooth: Smooth, row: Row) -> tuple[Array, Array]:
        """The function and its derivative at the nodes."""
        z, rate = self.whole.inputs(self.phases)
        return smooth_values(smooth, z @ row.on_free + row.on_rate[0] * rate)

    def resolved(self, y: Array) -> bool:
        """Whether the last two Legendre coefficients on every panel are near rounding."""
        node, weight = np.polynomial.legendre.leggauss(_PANEL_NODES)
        degrees = np.arange(_PANEL_NODES - 2, _PANEL_NODES)
        to_tail = np.polynomial.legendre.legvander(node, _PANEL_NODES - 1)[:, -2:] * weight[:, None] * (degrees + 0.5)
        return bool(np.abs(y.reshape(-1, _PANEL_NODES) @ to_tail).max() <= 1e-13 * np.abs(y).max())

    def integrate(self, found: list[tuple[Array, Array]]) -> tuple[ComplexArray, ComplexArray, ComplexArray]:
        """Coefficients from the samples of all functions."""
        c, n_out = self.whole, self.whole.owner.automaton.n_outputs
        back = np.exp(-1j * np.outer(self.phases, orders(2 * c.n)))
        W, R = np.zeros((n_out, c.n + 1), complex), np.zeros((n_out, 2 * c.n + 1), complex)
        S = np.zeros((n_out, c.owner.n_free, 2 * c.n + 1), complex)
        for i, ((_, row), (y, slope)) in enumerate(zip(c.owner.smooth, found, strict=True)):
            acts = np.array([c.owner.automaton.modes[m].from_smooth[:, i] for m in c.modes])[self.piece]
            W += 2.0 * (acts * (self.weights * y)[:, None]).T @ back[:, : c.n + 1]
            by_argument = (acts * (self.weights * slope)[:, None]).T @ back
            S += row.on_free[None, :, None] * by_argument[:, None, :]
            R += row.on_rate[0] * by_argument
        W[:, 0] *= 0.5
        return W, S, R
