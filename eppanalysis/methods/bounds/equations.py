"""Harmonic balance of any order as CasADi expressions with exact derivatives, for one sequence of switches.

Elements with memory (stiction pulley, play, lock pin whose contact only pushes) switch at instants that belong to the
solution. They are unknowns here, each with the equation that the element's guard is zero there, and so are the values
that the element holds. Between the switches an output is affine in the input, so that its Fourier coefficients are
closed forms in the coefficients of the input, the switching phases and the memory values (Toeplitz and Hankel products
with the coefficients of piecewise constant functions, as in :mod:`eppanalysis.methods.harmonic.coefficients`): nothing
is sampled or smoothed, and CasADi's derivatives are those of the balance itself. The unknowns are

    inputs z (mean, real parts, imaginary parts), states x (the same), omega, phases, memory values, parameter p

and the equations, for k = 0 .. n,

    j k omega x_k = A x_k + B exp(-j k omega d) w_k + const,   z_k = C x_k + D w_k + const,
    guard_i(z(phi_i), dz/dt(phi_i), memory) = 0,   memory_i = reset_i(...),   Re z_1 = 0 of one input (phase).

With the states kept as unknowns every equation is polynomial but for the waves exp(j k phi), and sparse.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from eppanalysis.arrays import Array, BoolArray
from eppanalysis.errors import ModelError
from eppanalysis.methods.bounds.numbers import ElementNumbers, LoopNumbers, Plan
from eppanalysis.methods.harmonic.series import TURN
from eppanalysis.models.elements.automaton import LEAST
from eppanalysis.models.systems.signals import slices
from eppanalysis.polynomials import Polynomial

_NODES_MOST = 40


@dataclass(frozen=True, eq=False)
class Layout:
    """Places of the unknowns: counts of inputs, states, and switches and memory values of each element."""

    order: int
    n_inputs: int
    n_states: int
    switches: tuple[int, ...]
    memory: tuple[int, ...]

    @property
    def width(self) -> int:
        """Unknowns of one series."""
        return 2 * self.order + 1

    @cached_property
    def omega(self) -> int:
        """Place of omega."""
        return (self.n_inputs + self.n_states) * self.width

    @cached_property
    def phases(self) -> tuple[slice, ...]:
        """Places of the switching phases of each element."""
        return slices(self.switches, self.omega + 1)

    @cached_property
    def holds(self) -> tuple[slice, ...]:
        """Places of the memory values behind each switch, for each element."""
        sizes = [s * h for s, h in zip(self.switches, self.memory, strict=True)]
        return slices(sizes, self.omega + 1 + sum(self.switches))

    @property
    def size(self) -> int:
        """Number of unknowns without the parameter."""
        return self.holds[-1].stop if self.holds else self.omega + 1


@dataclass(frozen=True, eq=False)
class Expressions:
    """The balance of one plan as a CasADi function."""

    plan: Plan
    pivot: int  # input whose fundamental is a sine
    layout: Layout
    residual: Any  # from (unknowns, numbers) to the equations
    used: BoolArray  # which numbers are not structurally zero

    @cached_property
    def by_numbers(self) -> Any:
        """From (unknowns, numbers, multipliers) to the gradient of ``multipliers @ equations`` by the numbers."""
        # Elasticities need the multipliers times the derivative by the numbers
        # alone: one gradient in place of a Jacobian with a column for every number.
        X, theta = self.residual.sx_in()
        equations = self.residual(X, theta)
        weights = ca.SX.sym("weights", equations.numel())
        gradient = ca.gradient(ca.dot(weights, equations), theta)
        return ca.Function("by_numbers", [X, theta, weights], [gradient])

    def scales(self, X: Array) -> Array:
        """Sizes of the unknowns, shape (n,): amplitudes of the series, the frequency, one turn."""
        layout = self.layout
        series = X[: layout.omega].reshape(-1, layout.width)
        amplitude = np.abs(series[:, 1:]).max(1, initial=0.0)
        size = np.where(amplitude > 0, amplitude, np.abs(series[:, 0]))
        size = np.where(size > 0, size, size.max(initial=1e-300))
        out = np.ones(layout.size)
        out[: layout.omega] = np.repeat(size, layout.width)
        out[layout.omega] = X[layout.omega]
        for e, s in enumerate(layout.holds):
            out[s] = max(size[e], 1e-300)
        return out


def write(
    plan: Plan, shape: LoopNumbers, used: BoolArray, kinds: tuple[tuple[str, ...], ...], pivot: int
) -> Expressions:
    """Write the equations of a plan.

    Parameters
    ----------
    shape : LoopNumbers
        Of any value of the parameter; only the shapes of its arrays count.
    used : bool array, shape (n,)
        Numbers that are not used are written as zeros.
    kinds : tuple of tuple of str
        Kinds of the smooth functions of each element.
    pivot : int
        Input whose fundamental is a sine.
    """
    layout = Layout(
        plan.order,
        shape.C.shape[0],
        shape.A.shape[0],
        tuple(len(q.steps) for q in plan.sequences),
        tuple(e.on_memory.shape[2] for e in shape.elements),
    )
    X = ca.SX.sym("X", layout.size)
    theta = ca.SX.sym("theta", int(np.sum(used)))
    equations = _Writer(layout, plan, X, _symbols(shape, used, theta), kinds, pivot).equations()
    return Expressions(plan, pivot, layout, ca.Function("residual", [X, theta], [equations]), used)


def _symbols(shape: LoopNumbers, used: BoolArray, theta: Any) -> LoopNumbers:
    """The numbers as expressions: zeros where nothing is, symbols elsewhere."""
    symbols = np.zeros(used.size, dtype=object)
    symbols[used] = ca.vertsplit(theta)
    place = 0

    def take(like: Array) -> NDArray[Any]:
        nonlocal place
        part = symbols[place : place + like.size].reshape(like.shape)
        place += like.size
        return part

    arrays: list[Any] = [take(a) for a in shape[:-1]]
    arrays.append(tuple(ElementNumbers(*map(take, e)) for e in shape.elements))
    return LoopNumbers(*arrays)


def _matrix(array: NDArray[Any]) -> Any:
    """Expressions in rows and columns; zeros are left out of the sparsity."""
    rows, columns = array.shape
    out = ca.SX(rows, columns)
    for place, value in np.ndenumerate(array):
        if isinstance(value, ca.SX):
            out[place] = value
    return out


def _any(values: NDArray[Any]) -> bool:
    """Whether any of them is more than a structural zero."""
    return any(isinstance(v, ca.SX) for v in np.ravel(values))


class _Writer:
    """The equations under construction; lives for one call."""

    def __init__(
        self, layout: Layout, plan: Plan, X: Any, numbers: LoopNumbers, kinds: tuple[tuple[str, ...], ...], pivot: int
    ) -> None:
        self.layout, self.plan, self.numbers, self.kinds, self.pivot = layout, plan, numbers, kinds, pivot
        n, width = layout.order, layout.width
        self.k = ca.DM(np.arange(1, n + 1))
        series = ca.reshape(X[: layout.omega], width, layout.n_inputs + layout.n_states).T
        self.z, self.x = series[: layout.n_inputs, :], series[layout.n_inputs :, :]
        self.omega = X[layout.omega]
        self.phases = [X[s] for s in layout.phases]
        self.memory = [
            ca.reshape(X[s], h, m) for s, h, m in zip(layout.holds, layout.memory, layout.switches, strict=True)
        ]

    def equations(self) -> Any:
        """All equations in one column."""
        n = self.layout.order
        A, B, C, D, state, inputs, delays = (_matrix(a) if a.ndim == 2 else a for a in self.numbers[:-1])
        outputs, rest = [], []
        for e in range(self.layout.n_inputs):
            w, more = _Element(self, e).answer()
            outputs.append(w)
            rest += more
        w = ca.vertcat(*outputs)
        late = self._delayed(w, delays)
        forced = ca.vertcat(*[ca.SX(v) for v in state]) if len(state) else ca.SX(0, 1)
        # States are unknowns of their own: eliminated, they would put the inverse of jk omega - A into every equation.
        x, omega, k = self.x, self.omega, self.k
        real, imag = slice(1, n + 1), slice(n + 1, 2 * n + 1)
        rate = A @ x + B @ late
        waves = ca.repmat(k.T, x.shape[0], 1) * omega
        rows = [
            rate[:, 0] + forced,
            ca.vec(rate[:, real] + waves * x[:, imag]),
            ca.vec(rate[:, imag] - waves * x[:, real]),
        ]
        z = C @ x + D @ w - self.z
        z[:, 0] += ca.vertcat(*[ca.SX(v) for v in inputs])
        # One phase is free; the anchor makes the fundamental of one input a sine (docs/theory/harmonic_balance.md).
        return ca.vertcat(*rows, ca.vec(z), self.z[self.pivot, 1], *rest)

    def _delayed(self, w: Any, delays: NDArray[Any]) -> Any:
        """Coefficients behind the dead times."""
        n, out = self.layout.order, []
        for i, delay in enumerate(delays):
            row = w[i, :]
            if isinstance(delay, ca.SX):
                angle = self.k.T * (self.omega * delay)
                c, s = ca.cos(angle), ca.sin(angle)
                re, im = row[1 : n + 1], row[n + 1 :]
                row = ca.horzcat(row[0], re * c + im * s, im * c - re * s)
            out.append(row)
        return ca.vertcat(*out)


class _Element:
    """Coefficients of one element's outputs, and the equations of its switches."""

    def __init__(self, owner: _Writer, number: int) -> None:
        self.owner, self.layout = owner, owner.layout
        self.numbers = owner.numbers.elements[number]
        self.z = owner.z[number, :]
        self.phi, self.memory = owner.phases[number], owner.memory[number]
        self.steps = owner.plan.sequences[number].steps
        self.kinds = owner.kinds[number]
        n = self.layout.order
        q = ca.DM(np.arange(1, 2 * n + 1))
        if self.steps:
            angles = self.phi @ q.T
            # Two-sided coefficients of a function that steps at the phases: its steps times these.
            self.step_re = -ca.sin(angles) / ca.repmat(q.T * TURN, len(self.steps), 1)
            self.step_im = -ca.cos(angles) / ca.repmat(q.T * TURN, len(self.steps), 1)
            following = ca.vertcat(self.phi[1:], self.phi[0] + TURN)
            self.share = (following - self.phi) / TURN
        if len(self.steps) == 0 and owner.layout.memory[number]:
            raise ModelError("An element that holds a value and never switches has no bound by harmonic balance.")

    def answer(self) -> tuple[Any, list[Any]]:
        """Rows of coefficients (outputs, 2 n + 1), and the equations of switches and memory values."""
        numbers, rows = self.numbers, []
        for o in range(numbers.constant.shape[1]):
            row = self._product(numbers.on_free[:, o], self.z)
            row += self._product(numbers.on_rate[:, o], self._rate_series()) if _any(numbers.on_rate[:, o]) else 0
            level = list(numbers.constant[:, o])
            for h in range(numbers.on_memory.shape[2]):
                level = [c + numbers.on_memory[i, o, h] * self.memory[h, i] for i, c in enumerate(level)]
            row += self._level(level)
            if self.kinds:
                row += self._smooth(o)
            rows.append(row)
        return ca.vertcat(*rows), self._switches()

    def _rate_series(self) -> Any:
        """The input's rate, as a series."""
        n, k = self.layout.order, self.owner.k.T * self.owner.omega
        return ca.horzcat(0, -k * self.z[n + 1 :], k * self.z[1 : n + 1])

    def _steps_of(self, values: Any) -> tuple[Any, Any, Any]:
        """Mean and two-sided coefficients 1 .. 2 n (real, imaginary) of a piecewise constant function."""
        n2 = 2 * self.layout.order
        pieces = ca.vertcat(*[ca.SX(v) for v in values])
        if not self.steps:
            return pieces[0], ca.SX(1, n2), ca.SX(1, n2)
        jumps = pieces - ca.vertcat(pieces[-1], pieces[:-1])
        return ca.dot(pieces, self.share), jumps.T @ self.step_re, jumps.T @ self.step_im

    def _level(self, values: Any) -> Any:
        n = self.layout.order
        mean, re, im = self._steps_of(values)
        return ca.horzcat(mean, 2.0 * re[:n], 2.0 * im[:n])

    def _product(self, slopes: Any, series: Any) -> Any:
        """Coefficients of a piecewise constant function times a series."""
        if not _any(slopes):
            return ca.SX(1, self.layout.width)
        mean, re, im = self._steps_of(slopes)
        if not self.steps:
            return mean * series
        n = self.layout.order
        # Two-sided coefficients -2 n .. 2 n; k - m and k + m index into them.
        turned = list(range(2 * n - 1, -1, -1))
        both_re = ca.horzcat(re[0, turned], mean, re)
        both_im = ca.horzcat(-im[0, turned], 0, im)
        k, m = np.arange(n + 1)[:, None], np.arange(n + 1)[None, :]

        def pick(row: Any, index: NDArray[np.intp]) -> Any:
            return ca.reshape(row[index.ravel(order="F").tolist()], n + 1, n + 1)

        re_minus, re_plus = pick(both_re, k - m + 2 * n), pick(both_re, k + m + 2 * n)
        im_minus, im_plus = pick(both_im, k - m + 2 * n), pick(both_im, k + m + 2 * n)
        a = ca.vertcat(series[0], series[1 : n + 1].T)
        b = ca.vertcat(0, series[n + 1 :].T)
        out_re = (re_minus + re_plus) @ a - (im_minus - im_plus) @ b
        out_im = (im_minus + im_plus) @ a + (re_minus - re_plus) @ b
        return ca.horzcat(0.5 * out_re[0], out_re[1:].T, out_im[1:].T)

    def _smooth(self, output: int) -> Any:
        """Coefficients of the smooth functions, by quadrature between the switches."""
        total = ca.SX(1, self.layout.width)
        for piece in range(max(1, len(self.steps))):
            nodes, weights = self._nodes(piece)
            value, rate = self._input_at(nodes)
            y = 0
            for i, kind in enumerate(self.kinds):
                on, on_rate, constant, scale = self.numbers.smooth[i]
                share = self.numbers.by_smooth[piece, output, i]
                y += share * _FUNCTIONS[kind](on * value + on_rate * rate + constant, scale)
            angles = nodes @ self.owner.k.T
            y = y * weights
            total += ca.horzcat(ca.sum1(y), 2.0 * (y.T @ ca.cos(angles)), -2.0 * (y.T @ ca.sin(angles)))
        return total

    def _nodes(self, piece: int) -> tuple[Any, Any]:
        """Phases and weights (over a whole turn) of the quadrature on one piece."""
        if not self.steps:
            # The trapezium rule is spectrally exact for a smooth periodic function.
            count = 8 * self.layout.order + 32
            return ca.SX(TURN * np.arange(count) / count), ca.SX(np.full(count, 1.0 / count))
        # Gauss's rule on each piece by itself: the integrand has a corner
        # or a jump at a switch, which the trapezium rule would smear.
        node, weight = np.polynomial.legendre.leggauss(min(_NODES_MOST, 12 + 2 * self.layout.order))
        width = self.share[piece] * TURN
        return self.phi[piece] + width * (node + 1) / 2, self.share[piece] * weight / 2

    def _input_at(self, phases: Any) -> tuple[Any, Any]:
        """Value and rate of the input at phases, shape (m, 1)."""
        n, k = self.layout.order, self.owner.k.T
        angles = phases @ k
        c, s = ca.cos(angles), ca.sin(angles)
        re, im = self.z[1 : n + 1].T, self.z[n + 1 :].T
        value = self.z[0] + c @ re - s @ im
        rate = self.owner.omega * (-s @ (k.T * re) - c @ (k.T * im))
        return value, rate

    def _switches(self) -> list[Any]:
        """Guards (or the instant of the switch before, where one follows at once) and resets."""
        if not self.steps:
            return []
        value, rate = self._input_at(self.phi)
        out = []
        n_memory = self.memory.shape[0]
        for i, (_, _, _, at_once) in enumerate(self.steps):
            before = self.memory[:, i - 1] if i else self.memory[:, -1]

            def affine(row: NDArray[Any], i: int = i, before: Any = before) -> Any:
                total = row[0] * value[i] + row[1] * rate[i] + row[2]
                for h in range(n_memory):
                    total += row[3 + h] * before[h]
                return total

            # A switch that follows another one at once is at its instant, for its guard has been passed already.
            out.append(self.phi[i] - self.phi[i - 1] if at_once else affine(self.numbers.guard[i]))
            out += [self.memory[h, i] - affine(self.numbers.reset[i, h]) for h in range(n_memory)]
        return out


#: Smooth functions of an argument and their scale, as CasADi takes them.
_FUNCTIONS: dict[str, Callable[[Any, Any], Any]] = {
    "sine": lambda x, scale: scale * ca.sin(x),
    "cube": lambda x, scale: scale * x**3,
    "reciprocal_abs": lambda x, scale: scale / (1.0 + ca.fabs(x)),
    "square": lambda x, scale: scale * x**2,
    "fourth_power": lambda x, scale: scale * x**4,
    "fifth_power": lambda x, scale: scale * x**5,
    "tanh": lambda x, scale: scale * ca.tanh(x),
    "arctan": lambda x, scale: scale * ca.atan(x),
    "gaussian": lambda x, scale: scale * ca.exp(-(x**2)),
    "logarithm": lambda x, scale: scale * ca.log(ca.fmax(ca.fabs(x), LEAST)),
    "exponential": lambda x, scale: scale * ca.exp(x),
}


def at_symbols(numbers: Polynomial, u: Any, constants: Any, coefficients: Any) -> Any:
    """The used numbers as expressions in u (the parameter, scaled to -1 .. 1), by Clenshaw's sum.

    Parameters
    ----------
    constants : SX, shape (n_used,)
        The numbers that stand still (anything in the places of the others).
    coefficients : SX, shape (degree + 1, k)
    """
    ahead = behind = ca.SX(1, coefficients.shape[1])
    for d in range(coefficients.shape[0] - 1, 0, -1):
        ahead, behind = coefficients[d, :] + 2.0 * u * ahead - behind, ahead
    values = coefficients[0, :] + u * ahead - behind
    place = np.cumsum(numbers.used) - 1
    out = ca.SX(constants)
    for column, where in enumerate(numbers.places):
        out[int(place[where])] = values[column]
    return out
