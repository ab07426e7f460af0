"""A loop as equations between Fourier coefficients: element answers, linear part, static balance.

Unknowns are the coefficients c[0..n] of all free inputs of the elements (an input that is the rate of another, or a
clock, is not free) and omega. The equations are ``Z_k = L(j k omega) W_k`` for k = 1..n, for the means the static
balance of :mod:`eppanalysis.models.systems.means` (in which integrators have their place), and an anchor of the
phase: the fundamental of one input is a sine.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from eppanalysis.arrays import Array, ComplexArray, IntArray
from eppanalysis.engine.harmonics import Automata, equations, jacobian
from eppanalysis.errors import ModelError
from eppanalysis.methods.harmonic.coefficients import Answer, respond, stacked
from eppanalysis.methods.harmonic.elements import PeriodicElement, Regime
from eppanalysis.methods.harmonic.series import orders
from eppanalysis.models.systems.lure import LureSystem
from eppanalysis.models.systems.means import StaticBalance, equilibrate, static_balance
from eppanalysis.models.systems.measured.loop import DataSystem
from eppanalysis.readable import words
from eppanalysis.results import LimitCycle

#: Share of its terms below which a sum of them is rounding; a loop that was turned, and back, has lost some digits.
_TURNED = 1e-9
_NO_MEMORY = np.zeros(0)


@dataclass(frozen=True, eq=False)
class Loop:
    """A system made ready for harmonic balance."""

    system: LureSystem
    elements: tuple[PeriodicElement, ...]
    rows: NDArray[np.intp]  # (F,): places in ``z`` of the free inputs, the first input of each element
    #: on_bias, on_mean, prescribed: (F, F), (F, nw), (F,): static balance.
    on_bias: Array
    on_mean: Array
    prescribed: Array
    value: Array  # (nv,): external inputs

    @classmethod
    def of(cls, system: LureSystem, value: Array) -> Loop:
        """Sort the inputs by their roles and eliminate the state from the static balance.

        Raises
        ------
        ModelError
            If an element uses its inputs in a way that harmonic balance does not cover, or the static balance does not
            determine the means.
        """
        return cls.with_means(system, static_balance(system, value), value)

    @classmethod
    def with_means(cls, system: LureSystem, static: StaticBalance, value: Array | None = None) -> Loop:
        """The loop with its static balance (`value` is only needed to go from named signals to inputs)."""
        elements = tuple(
            PeriodicElement.of(e, tuple(role_of_input(system, z.start, i) for i in range(z.start, z.stop)))
            for e, z in zip(system.elements, system.input_slices, strict=True)
        )
        given = np.array(system.v0, float) if value is None else value
        return cls(system, elements, *static, given)

    @cached_property
    def means(self) -> tuple[Array, Array, Array]:
        """The static balance as the engine takes it."""
        on_bias, on_mean, prescribed = (
            np.array(m, float, order="C") for m in (self.on_bias, self.on_mean, self.prescribed)
        )
        return on_bias, on_mean, prescribed

    @cached_property
    def automata(self) -> Automata | None:
        """All elements as the engine takes them; None where some are smooth."""
        if not self.elements or any(e.smooth for e in self.elements):
            return None
        modes = np.array([e.start_mode for e in self.elements], np.int64)
        sizes = [(e.automaton.n_outputs, e.automaton.n_memory) for e in self.elements]
        first = np.vstack([np.zeros((1, 2), np.int64), np.cumsum(sizes, axis=0)])
        clocked = np.array([e.clocked for e in self.elements])
        return Automata(tuple(e.table for e in self.elements), modes, clocked, first)

    @cached_property
    def behind_jumps(self) -> list[bool]:
        """Which elements with a memory of values are straight behind one that jumps."""
        system = self.system
        slopes = [np.abs(e.slope_bounds()).max() for e in system.elements]
        jumping = np.repeat(np.isinf(slopes), [e.n_outputs for e in system.elements])
        behind = np.any(system.D[self.rows][:, jumping], axis=1)
        return [bool(b) and e.automaton.n_memory > 0 for e, b in zip(self.elements, behind, strict=True)]

    @cached_property
    def free_jumps(self) -> list[bool]:
        """Which elements jump at a threshold without the loop pulling them back straight away, which would slide."""
        system = self.system
        at_once = system.straight if isinstance(system, DataSystem) else system.C @ system.B
        straight = [float(np.sum(at_once[row, out])) for row, out in zip(self.rows, system.output_slices, strict=True)]
        modes = [e.automaton.mode_columns for e in self.elements]
        jumps = [own["jump"][own["sticking"]] for own in modes]
        return [own.size > 0 and bool(np.all(s * own >= 0)) for s, own in zip(straight, jumps, strict=True)]

    def highest(self, omega: float) -> int:
        """Highest order: unlimited but for a discrete-time loop and for one that is measured."""
        return self.system.highest_harmonic(omega)

    def linear(self, omega: float, n: int) -> ComplexArray:
        """Response from outputs to free inputs at the harmonics 1..n, shape (n, F, nw)."""
        return self.system.frequency_response(omega * orders(n)[1:])[:, self.rows]

    def linear_and_slope(self, omega: float, n: int) -> tuple[ComplexArray, ComplexArray]:
        """:meth:`linear` and its derivative by omega."""
        k = orders(n)[1:]
        response, slope = self.system.frequency_response_and_slope(omega * k)
        return response[:, self.rows], k[:, None, None] * slope[:, self.rows]

    def responses(self, Z: ComplexArray, omega: float) -> tuple[Answer, ...]:
        """Answer of each element."""
        return tuple(respond(e, z[None], omega) for e, z in zip(self.elements, Z, strict=True))

    def answers(self, Z: ComplexArray, omega: float) -> tuple[ComplexArray, tuple[Regime, ...]]:
        """Coefficients of all outputs (nw, n + 1), and the regime of each element."""
        found = self.responses(Z, omega)
        return np.concatenate([a.coefficients for a in found]), tuple(a.regime for a in found)

    def outputs(self, Z: ComplexArray, omega: float) -> tuple[ComplexArray, list[int]]:
        """Coefficients of all outputs (nw, n + 1), and how often each element switches in a period.

        Raises
        ------
        Unsettled
            If an element does not answer with the period of its input.
        """
        F, n = Z.shape[0], Z.shape[1] - 1
        no_response = np.empty((n, F, 0), complex)
        found = self.at_once(np.append(stacked(Z).ravel(), omega), n, (no_response, no_response), 0, 0)
        if found is not None:
            return found[2], found[3].tolist()
        W, regimes = self.answers(Z, omega)
        return W, [r.phases.size for r in regimes]

    def at_once(
        self, X: Array, n: int, linear: tuple[ComplexArray, ComplexArray], pivot: int, size: int
    ) -> tuple[Array, Array, ComplexArray, IntArray] | None:
        """Jacobian and residual of so many equations, outputs and numbers of switches; None for what needs more.

        The arguments are those of :func:`eppanalysis.engine.harmonics.equations`.
        """
        if self.automata is None:
            return None
        rest = np.concatenate([self._rest(f, X, n) for f in range(len(self.elements))])
        J, R, W = np.empty((size, size)), np.empty(size), np.empty((self.system.B.shape[1], n + 1), complex)
        switches = np.empty(len(self.elements), np.int64)
        known = equations(self.automata, rest, X, linear, self.means, pivot, J, R, W, switches)
        return (J, R, W, switches) if known else None

    def _rest(self, f: int, X: Array, n: int) -> Array:
        """Memory values with which an element rests at unknowns X."""
        element = self.elements[f]
        return element.rest(unstacked(X, n)[f : f + 1], float(X[-1])) if element.automaton.n_memory else _NO_MEMORY

    def slopes(self, found: tuple[Answer, ...]) -> ComplexArray:
        """Derivatives (nw, n + 1, F (2 n + 1) + 1) of the outputs' coefficients by the real unknowns and omega."""
        n, width = found[0].n, 2 * found[0].n + 1
        dW = np.zeros((self.system.B.shape[1], n + 1, len(found) * width + 1), complex)
        for f, (answer, out) in enumerate(zip(found, self.system.output_slices, strict=True)):
            dW[out, :, f * width : (f + 1) * width] = answer.slopes[:, :, :-1]
            dW[out, :, -1] = answer.slopes[:, :, -1]
        return dW

    def continued(self, Z: ComplexArray, omega: float, n: int, passes: int = 1) -> ComplexArray:
        """The same inputs with harmonics up to n; the new ones are what the linear part makes of the outputs'.

        With several elements it takes as many passes for a new harmonic to come round.
        """
        old = Z.shape[1] - 1
        out = np.zeros((Z.shape[0], n + 1), complex)
        out[:, : min(old, n) + 1] = Z[:, : n + 1]
        if n > old:
            L = self.linear(omega, n)[old:]
            for _ in range(passes):
                W, _ = self.outputs(out, omega)
                out[:, old + 1 :] = (L @ W.T[old + 1 :, :, None])[..., 0].T
        return out


@dataclass(frozen=True, eq=False)
class Equations:
    """The balance of order n with phase anchor; `weight` (n,) scales the linear part at each harmonic (1: the loop).

    Unknowns X, shape (F (2 n + 1) + 1,): mean, real parts and imaginary parts of each free input, and omega.
    """

    loop: Loop
    n: int
    pivot: int
    weight: Array

    def pack(self, Z: ComplexArray, omega: float) -> Array:
        """Vector of unknowns."""
        return np.append(stacked(Z).ravel(), omega)

    def unpack(self, X: Array) -> tuple[ComplexArray, float]:
        """Free inputs (F, n + 1) and omega."""
        return unstacked(X, self.n), float(X[-1])

    def residual(self, Z: ComplexArray, W: ComplexArray, L: ComplexArray) -> Array:
        """Residual, shape (F (2 n + 1) + 1,): static rows, real rows, imaginary rows, anchor."""
        ac = Z[:, 1:] - (L @ W.T[1:, :, None])[..., 0].T
        static = self.loop.on_bias @ Z[:, 0].real + self.loop.on_mean @ W[:, 0].real - self.loop.prescribed
        return np.concatenate([static, ac.real.ravel(), ac.imag.ravel(), [Z[self.pivot, 1].real]])

    def at(self, X: Array) -> Place:
        """What the equations are at a point.

        Raises
        ------
        Unsettled
            If an element does not answer with the period of its input.
        """
        loop, omega = self.loop, float(X[-1])
        weight = self.weight[:, None, None]
        L, dL = (np.ascontiguousarray(m * weight) for m in loop.linear_and_slope(omega, self.n))
        found = loop.at_once(X, self.n, (L, dL), self.pivot, X.size)
        if found is None:
            return self._in_parts(X, L, dL)
        J, R, W, _ = found
        return Place(W, R, lambda: J)

    def _in_parts(self, X: Array, L: ComplexArray, dL: ComplexArray) -> Place:
        """Element by element."""
        loop, (Z, omega) = self.loop, self.unpack(X)
        found = loop.responses(Z, omega)
        W = np.concatenate([a.coefficients for a in found])

        def linearised() -> Array:
            J: Array = jacobian(loop.slopes(found), W, L, dL, *loop.means[:2], self.pivot)
            return J

        return Place(W, self.residual(Z, W, L), linearised)

    def scales(self, X: Array, W: ComplexArray) -> tuple[Array, Array]:
        """Sizes of the unknowns and of the equations, given the outputs."""
        Z, omega = self.unpack(X)
        amplitude = np.abs(Z[:, 1:]).max(1)
        amplitude = np.where(amplitude > 0, amplitude, np.maximum(np.abs(Z[:, 0]), 1e-300))
        unknowns = np.append(np.repeat(amplitude, 2 * self.n + 1), omega)
        loop = self.loop
        static = np.abs(loop.on_bias) @ (np.abs(Z[:, 0]) + amplitude) + np.abs(loop.on_mean) @ np.abs(W).max(1)
        rows = np.repeat(amplitude, self.n)
        return unknowns, np.concatenate([np.maximum(static, 1e-300), rows, rows, [amplitude[self.pivot]]])


@dataclass(frozen=True, eq=False)
class Place:
    """The equations at a point."""

    W: ComplexArray  # (nw, n + 1): coefficients of the outputs
    residual: Array  # (F (2 n + 1) + 1,)
    linearised: Callable[[], Array]

    @property
    def jacobian(self) -> Array:
        """Derivatives of the residual by the unknowns."""
        return self.linearised()


def unstacked(X: Array, n: int) -> ComplexArray:
    """The series (F, n + 1) of which the unknowns are mean, real parts and imaginary parts, and omega behind them."""
    x = X[:-1].reshape(-1, 2 * n + 1)
    Z = x[:, : n + 1].astype(complex)
    Z[:, 1:] += 1j * x[:, n + 1 :]
    return Z


def role_of_input(system: LureSystem, first: int, row: int) -> str:
    """Role of an input of an element whose first input is in row `first`: "free", "rate" of the first, or "clock"."""
    if row == first or system.time_step:
        return "free"
    c = system.C[row]
    moves = ((np.abs(c @ M), np.abs(M).max(initial=0.0)) for M in (system.A, system.B, system.B_input))
    alone = all(np.all(rate <= _TURNED * np.abs(c).max() * most) for rate, most in moves)
    if alone and abs(c @ system.constant_state - 1.0) <= _TURNED and not np.any(system.D[row]):
        return "clock"
    rate, straight = system.C[first] @ system.A, system.C[first] @ system.B
    size = np.abs(system.C[first]) @ np.abs(system.A) + np.abs(c)
    same = np.all(np.abs(c - rate) <= _TURNED * size.max())
    size_w = np.abs(system.C[first]) @ np.abs(system.B) + np.abs(system.D[row])
    same &= np.all(np.abs(system.D[row] - straight) <= _TURNED * size_w) and not np.any(system.D[first])
    return "rate" if same else "free"


def inputs_of(loop: Loop, cycle: LimitCycle) -> ComplexArray:
    """Harmonics of the free inputs of a cycle, shape (F, n + 1), from those of its named signals.

    State and element outputs are found together, by least squares over the named signals and the linear part.

    Raises
    ------
    ModelError
        If the named signals of the cycle do not determine the inputs of the elements.
    """
    system, s, v = loop.system, loop.system.signals, loop.value
    if isinstance(system, DataSystem):
        return _of_data(system, loop.rows, cycle)
    given = [i for i, name in enumerate(s.names) if name in cycle.harmonics]
    count = min((len(cycle.harmonics[s.names[i]]) for i in given), default=0)
    if count < 2:
        raise ModelError(f"{system.name}: the guess has no fundamental of any of the signals {', '.join(s.names)}.")
    y = np.array([cycle.harmonics[s.names[i]][:count] for i in given], complex)
    y[:, 0] = [cycle.mean[s.names[i]] for i in given] - (s.D_input[given] @ v + s.constant[given])
    n = system.A.shape[0]
    forced = np.zeros((n, count))
    forced[:, 0] = system.B_input @ v + system.constant_state
    to_inputs = np.hstack([system.C[loop.rows], system.D[loop.rows]])
    Z = np.zeros((len(loop.rows), count), complex)
    # One linear system a harmonic: the linear part moves with the outputs of the elements, and what it shows is the
    # named signals.
    for k in range(count):
        pole = 1j * k * cycle.omega
        step = np.exp(pole * system.time_step) if system.time_step else pole
        moves = [step * np.eye(n) - system.A, -system.B * np.exp(-pole * system.delays)]
        matrix = np.block([moves, [s.C[given], s.D[given]]])
        found, seen = _least_squares(matrix, np.concatenate([forced[:, k], y[:, k]]), to_inputs)
        if k == 1 and not seen:
            raise ModelError(
                f"{system.name}: the named signals do not determine the elements' inputs; name more of them."
            )
        Z[:, k] = to_inputs @ found
    Z[:, 0] = Z[:, 0].real + system.D_input[loop.rows] @ v + system.constant_input[loop.rows]
    return Z


def _of_data(system: DataSystem, rows: NDArray[np.intp], cycle: LimitCycle) -> ComplexArray:
    """:func:`inputs_of` a measured loop: from what the named signals say that the elements put out."""
    names = system.signals.names
    missing = [name for name in names if len(cycle.harmonics.get(name, ())) < 2]
    if missing:
        raise ModelError(f"{system.name}: the guess has no fundamental of the signal {missing[0]}.")
    count = min(len(cycle.harmonics[name]) for name in names)
    count = min(count, 1 + system.highest_harmonic(cycle.omega))
    seen = np.array([cycle.harmonics[name][:count] for name in names], complex)
    omega = cycle.omega * np.arange(1, count)
    outputs = np.linalg.pinv(system.signal_response(omega)) @ seen.T[1:, :, None]
    Z = np.zeros((len(rows), count), complex)
    Z[:, 1:] = (system.frequency_response(omega)[:, rows] @ outputs)[..., 0].T
    known = system.element_names
    means = np.array([cycle.elements[name]["bias"] if name in cycle.elements else np.nan for name in known])
    before = [names.index("x" if "x" in names else f"{name}_input") for name in known]
    Z[:, 0] = np.where(np.isfinite(means), means, seen[before, 0].real)
    return Z


def _least_squares(matrix: ComplexArray, right: ComplexArray, wanted: Array) -> tuple[ComplexArray, bool]:
    """Least-squares solution in equilibrated coordinates, and whether it determines `wanted @ solution`."""
    used = np.any(matrix, 1)
    row, column = equilibrate(np.abs(matrix[used]))
    u, sigma, vh = np.linalg.svd(row[:, None] * matrix[used] * column)
    rank = int(np.sum(sigma > 1e-11 * sigma.max(initial=0.0)))
    x = column * (vh[:rank].conj().T @ ((u.conj().T @ (row * right[used]))[:rank] / sigma[:rank]))
    size = np.abs(wanted * column)
    hidden = np.abs(wanted * column @ vh[rank:].conj().T)
    return x, bool(np.all(hidden <= 1e-8 * size.max(1, initial=0.0)[:, None]))


def order_one(system: LureSystem, order: int) -> str:
    """How order 1 differs from first order, where elements are described from their input and balanced inside."""
    given = getattr(system, "given", None)
    limited = [] if given is None else [n for n, e in zip(given.element_names, given.elements, strict=True) if e.inside]
    if order > 1 or not limited:
        return ""
    return (
        f"Order 1 takes the error of {' and '.join(map(words, limited))}, input less output, for a sine; "
        "the describing function takes its input for one."
    )
