"""First-order harmonic balance with bias as equations: residual, Jacobian, a vectorised Newton, the static balance.

Notation: ``m`` elements, ``a`` (..., m) amplitudes and ``b`` (..., m) means of their first inputs, ``omega`` (...,).
Phasors P stand for ``Im(P exp(j omega t))``, so an input in sine phase has a real phasor. A vector of unknowns is

    X = [ln a_p, ln omega, (ln a_i, phase_i) for i != p, b_1 .. b_m, ln lambda]          length 3 m + 1

with the pivot element p in sine phase and a real gain lambda put in front of it for the fundamental. Its 3 m
equations leave curves; the limit cycles are the points of these curves with lambda = 1.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eppanalysis.models.elements.base import Nonlinearity
from eppanalysis.models.systems.lure import LureSystem
from eppanalysis.models.systems.means import StaticBalance, static_balance, without_rounding

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complexfloating[Any, Any]]

_STEP = 1e-7  # relative step of the forward differences; it only slows Newton, it does not bias its answer
_LARGEST_STEP = 0.7  # in one Newton step, of logarithms and phases
#: Last step of Newton's method for points of a curve that are only steps on the way to a limit cycle.
ON_THE_WAY = 1e-7


@dataclass(frozen=True, eq=False)
class Slopes:
    """Means and gains (nb, nw), and their derivatives (3, nb, nw) by ln a, b and ln omega of the owning element."""

    mean: Array
    gain: ComplexArray
    d_mean: Array
    d_gain: ComplexArray


@dataclass(frozen=True, eq=False)
class Balance:
    """The balance equations of one system at one value of its external inputs.

    Attributes
    ----------
    system : LureSystem
    pivot : int
        Element whose input is in sine phase and carries the artificial gain.
    static : StaticBalance
        Balance of the means.
    """

    system: LureSystem
    pivot: int
    static: StaticBalance

    @classmethod
    def of(cls, system: LureSystem, pivot: int, value: Array) -> Balance:
        """Balance of a system with the external inputs at `value` (nv,).

        Raises
        ------
        ModelError
            If the static balance leaves the means of the elements undetermined or overdetermined.
        """
        return cls(system, pivot, static_balance(system, value))

    @property
    def on_bias(self) -> Array:
        """Of the static balance, shape (m, m)."""
        return self.static.on_bias

    @property
    def on_mean(self) -> Array:
        """Of the static balance, shape (m, nw)."""
        return self.static.on_mean

    @property
    def prescribed(self) -> Array:
        """Of the static balance, shape (m,)."""
        return self.static.prescribed

    @property
    def m(self) -> int:
        """Number of elements."""
        return len(self.system.elements)

    @property
    def rows(self) -> NDArray[np.intp]:
        """Places of the first inputs in ``z``."""
        return self.static.rows

    @cached_property
    def operating_bias(self) -> Array:
        """Inputs of the elements in the start state of the system, shape (m,): where a search for biases begins."""
        return _start_inputs(self.system, self.rows)

    @cached_property
    def owner(self) -> NDArray[np.intp]:
        """Element that owns each output, shape (nw,)."""
        return np.repeat(np.arange(self.m), [e.n_outputs for e in self.system.elements])

    @cached_property
    def others(self) -> NDArray[np.intp]:
        """All elements but the pivot."""
        return np.array([i for i in range(self.m) if i != self.pivot], dtype=np.intp)

    @cached_property
    def places(self) -> NDArray[np.intp]:
        """Where the logarithms of all amplitudes stand in a vector of unknowns; the phases of the others come next."""
        places = np.zeros(self.m, dtype=np.intp)
        places[self.others] = 2 * np.arange(1, self.m)
        return places

    @cached_property
    def first_outputs(self) -> NDArray[np.intp]:
        """Place of each element's first output."""
        return np.array([s.start for s in self.system.output_slices], dtype=np.intp)

    @cached_property
    def further_outputs(self) -> list[int]:
        """Places of the others."""
        return [k for k in range(self.owner.size) if k not in self.first_outputs]

    def linear(self, omega: Array) -> ComplexArray:
        """Response from all outputs to the first inputs, shape (nb, m, nw)."""
        return self.system.frequency_response(omega)[:, self.rows]

    def linear_and_slope(self, omega: Array) -> tuple[ComplexArray, ComplexArray]:
        """:meth:`linear` and its derivative by ln omega."""
        L, dL = self.system.frequency_response_and_slope(omega)
        return L[:, self.rows], dL[:, self.rows] * omega[:, None, None]

    def evaluate(self, a: Array, b: Array, omega: Array) -> tuple[Array, ComplexArray]:
        """Mean outputs and gains of all elements, shapes (..., nw)."""
        means, gains = [], []
        for i, e in enumerate(self.system.elements):
            mean, gain = describe(e, a[..., i], b[..., i], omega)
            means.append(mean)
            gains.append(gain)
        return np.concatenate(means, -1), np.concatenate(gains, -1)

    def slopes(self, a: Array, b: Array, omega: Array, free_pivot: bool = True) -> Slopes:
        """Means, gains and derivatives at nb points; without `free_pivot` amplitude of pivot and omega stand still."""
        m, n, nw = self.m, len(omega), self.owner.size
        # The step that is really made: of a small one beside a large bias rounding changes the size.
        step_b = (b + (_STEP * a + 1e-12 * np.abs(b))) - b
        # Along the second axis: as it is, then with its amplitude, its bias and the frequency shifted.
        A, B, W = np.empty((m, 4, n)), np.empty((m, 4, n)), np.empty((4, n))
        A[:], B[:], W[:] = a.T[:, None], b.T[:, None], omega
        A[:, 1] *= 1.0 + _STEP
        B[:, 2] += step_b.T
        W[3] *= 1.0 + _STEP
        mean, gain = np.empty((4, n, nw)), np.empty((4, n, nw), complex)
        for i, e in enumerate(self.system.elements):
            out, used = self.system.output_slices[i], self._shifts(i, free_pivot)
            means, gains = describe(e, A[i, used], B[i, used], W[used])
            mean[:, :, out], gain[:, :, out] = means[0], gains[0]
            mean[used, :, out], gain[used, :, out] = means, gains
        step = np.full((3, n, nw), _STEP)
        step[1] = np.maximum(step_b, 1e-290)[:, self.owner]
        return Slopes(mean[0], gain[0], (mean[1:] - mean[0]) / step, (gain[1:] - gain[0]) / step)

    def _shifts(self, element: int, free_pivot: bool) -> slice:
        """Which of the shifts change the outputs of an element."""
        if element == self.pivot and not free_pivot:
            return slice(0, 4, 2)
        return slice(0, 4 if free_pivot and self.system.elements[element].n_inputs > 1 else 3)

    def pack(self, a: Array, phase: Array, b: Array, omega: Array, gain: Array) -> Array:
        """Vector of unknowns, shape (nb, 3 m + 1)."""
        m = self.m
        X = np.empty((len(omega), 3 * m + 1))
        X[:, self.places + 1] = phase
        X[:, self.places] = np.log(a)
        X[:, 1], X[:, 2 * m : 3 * m], X[:, -1] = np.log(omega), b, np.log(gain)
        return X

    def unpack(self, X: Array) -> tuple[Array, Array, Array, Array]:
        """Amplitudes (nb, m), phases (nb, m), biases (nb, m) and omega (nb,)."""
        phase = X[:, self.places + 1]
        phase[:, self.pivot] = 0.0
        return np.exp(X[:, self.places]), phase, X[:, 2 * self.m : 3 * self.m], np.exp(X[:, 1])

    def residual(self, X: Array) -> tuple[Array, Array]:
        """Residual (nb, 3 m), Jacobian (nb, 3 m, 3 m + 1); rows: real parts, imaginary parts, static balance."""
        a, phase, b, omega = self.unpack(X)
        s = self.slopes(a, b, omega)
        return self.assemble(X, s, a * np.exp(1j * phase), b, *self.linear_and_slope(omega))

    def assemble(
        self, X: Array, s: Slopes, Z: ComplexArray, b: Array, L: ComplexArray, dL: ComplexArray | None
    ) -> tuple[Array, Array]:
        """Residual and Jacobian from what they are made of: slopes, inputs Z, biases, linear response and its slope.

        Without the slope of the linear response, what belongs to omega is left out.
        """
        n, m, others, places = len(X), self.m, self.others, self.places
        front = 1.0 / Z
        front[:, self.pivot] *= np.exp(X[:, -1])
        L = L * front[:, :, None]
        Zw = Z[:, self.owner]
        outputs = (s.gain * Zw)[:, None, :]
        # By the logarithm of an amplitude and by a phase an output changes by itself, and by itself times j: what the
        # slope of the gain adds is all that has to be differenced (docs/theory/index.md, Several elements).
        G = self._by_element(L * outputs)
        by = slice(2 if dL is None else 3)
        by_slope = self._by_element(L * (s.d_gain[by] * Zw)[:, :, None, :])
        total = G.sum(-1)
        rows = np.zeros((n, m, 3 * m + 1), complex)
        diagonal = np.arange(m)
        rows[:, :, places] = G + by_slope[0]
        rows[:, diagonal, places] -= total
        rows[:, :, places[others] + 1] = 1j * G[:, :, others]
        rows[:, others, places[others] + 1] -= 1j * total[:, others]
        rows[:, :, 2 * m : 3 * m] = by_slope[1]
        rows[:, self.pivot, -1] = total[:, self.pivot]
        static = self._by_element(self.on_mean * s.d_mean[by, :, None, :])
        J = np.zeros((n, 3 * m, 3 * m + 1))
        if dL is not None:
            rows[:, :, 1] = by_slope[2].sum(-1) + (dL * front[:, :, None] * outputs).sum(-1)
            J[:, 2 * m :, 1] = static[2].sum(-1)
        J[:, :m], J[:, m : 2 * m] = rows.real, rows.imag
        J[:, 2 * m :, places] = static[0]
        J[:, 2 * m :, 2 * m : 3 * m] = self.on_bias + static[1]
        R = np.concatenate([total.real - 1.0, total.imag, self._static(b, s.mean)], -1)
        return R, J

    def _by_element(self, columns: NDArray) -> NDArray:
        """Sum over the outputs of each element: (..., nw) to (..., m)."""
        if self.owner.size == self.m:
            return columns
        out = np.take(columns, self.first_outputs, axis=-1)  # numpy's reduceat takes four times as long
        for k in self.further_outputs:
            out[..., self.owner[k]] += columns[..., k]
        return out

    def _static(self, b: Array, mean: Array) -> Array:
        return b @ self.on_bias.T + mean @ self.on_mean.T - self.prescribed

    def largest_residual(self, X: Array) -> Array:
        """Largest relative residual of each point, shape (nb,)."""
        a, phase, b, omega = self.unpack(X)
        mean, gain = self.evaluate(a, b, omega)
        Z = a * np.exp(1j * phase)
        total = (self.linear(omega) * (gain * Z[:, self.owner])[:, None, :]).sum(-1) / Z
        output = np.abs(mean) + np.abs(gain) * a[:, self.owner]
        size = (np.abs(b) + a) @ np.abs(self.on_bias).T + output @ np.abs(self.on_mean).T + np.abs(self.prescribed)
        static = np.abs(self._static(b, mean)) / np.where(size > 0, size, 1.0)
        return np.concatenate([np.abs(total - 1.0), static], -1).max(-1)


def describe(element: Nonlinearity, a: Array, b: Array, omega: Array) -> tuple[Array, ComplexArray]:
    """Mean outputs and gains of one element, shapes (..., n_outputs)."""
    with np.errstate(all="ignore"):
        mean, gain = element.describing_function(a, b, omega)
    mean, gain = np.asarray(mean, float), np.asarray(gain, complex)
    if element.n_outputs > 1:
        return mean, gain
    if not mean.shape == gain.shape == np.shape(a) == np.shape(b) == np.shape(omega):
        shape = np.broadcast_shapes(np.shape(a), np.shape(b), np.shape(omega))
        mean, gain = np.broadcast_to(mean, shape), np.broadcast_to(gain, shape)
    return mean[..., None], gain[..., None]


def newton(
    balance: Balance, X: Array, normal: Array, iterations: int = 12, tolerance: float = 1e-12
) -> tuple[Array, NDArray]:
    """Bring points onto the solution curves, each within the plane through itself with the given `normal`.

    Parameters
    ----------
    X, normal : array, shape (nb, 3 m + 1)
    iterations : int, optional
    tolerance : float, optional
        On the last step, in logarithms, phases and biases relative to amplitude; what is left after it is of the order
        of its square.

    Returns
    -------
    (X, converged) : array (nb, 3 m + 1), bool array (nb,)
    """
    return newton_and_jacobian(balance, X, normal, iterations, tolerance)[:2]


def newton_and_jacobian(
    balance: Balance, X: Array, normal: Array, iterations: int, tolerance: float
) -> tuple[Array, NDArray, Array]:
    """:func:`newton`, and the Jacobian (nb, 3 m, 3 m + 1) with which each point made its last step."""
    jacobian = np.zeros((len(X), 3 * balance.m, X.shape[1]))
    X, done, m = X.copy(), np.zeros(len(X), bool), balance.m
    settled = np.zeros(len(X), bool)
    alive = np.all(np.isfinite(X), -1)
    with np.errstate(all="ignore"):
        for _ in range(iterations):
            todo = np.flatnonzero(alive & ~done)
            if not todo.size:
                break
            x = X[todo]
            R, J = balance.residual(x)
            jacobian[todo] = J
            J = np.concatenate([J, normal[todo, None]], 1)
            R = np.concatenate([R, np.zeros((len(todo), 1))], 1)
            step, regular = solve_rows(J, R)
            largest = (np.abs(step) / scales(balance, x)).max(-1)
            # In logarithms a step is a factor: no amplitude or frequency becomes negative, or changes by more than
            # about two.
            step *= np.minimum(1.0, _LARGEST_STEP / np.maximum(largest, 1e-300))[:, None]
            X[todo] = x = x - step
            alive[todo] = regular & np.isfinite(x).all(-1) & (np.abs(x[:, : 2 * m]).max(-1) < 300.0)
            # Rounding may keep the last steps above the tolerance; two small ones in a row are as good.
            small = (largest < 1e-9) & regular
            done[todo] = ((largest < tolerance) & regular) | (small & settled[todo])
            settled[todo] = small
    return X, done & alive, jacobian


def scales(balance: Balance, X: Array) -> Array:
    """Sizes by which steps are judged: one for logarithms and phases, amplitude plus mean for biases."""
    biases = slice(2 * balance.m, 3 * balance.m)
    scale = np.ones_like(X)
    scale[:, biases] = np.exp(X[:, balance.places]) + 0.1 * np.abs(X[:, biases])
    scale[:, -1] = 3.0
    return scale


def solve_rows(J: Array, R: Array) -> tuple[Array, NDArray]:
    """Solve a batch of systems after scaling their rows; singular or non-finite ones give zero and False."""
    size = np.abs(J).max(-1)
    ok = ((size > 0) & np.isfinite(size) & np.isfinite(R)).all(-1)
    safe, right = J / size[..., None], R / size
    if not ok.all():
        safe[~ok], right[~ok] = np.eye(J.shape[-1]), 0.0
    try:
        out = np.linalg.solve(safe, right[..., None])[..., 0]
    except np.linalg.LinAlgError:
        # One exactly singular matrix stops the whole batch; shifted, it gives a huge step that the caller rejects.
        # The shifts differ in size and order, or a shift would only move a matrix onto another singular one.
        shifted = safe + 1e-13 * np.diag(np.sqrt(np.arange(2.0, J.shape[-1] + 2.0)))
        try:
            out = np.asarray(np.linalg.solve(shifted, right[..., None])[..., 0], float)
        except np.linalg.LinAlgError:
            out = (np.linalg.pinv(safe) @ right[..., None])[..., 0]
            ok &= np.linalg.matrix_rank(safe) == J.shape[-1]
    ok &= np.isfinite(out).all(-1)
    out[~ok] = 0.0
    return out, ok


def _start_inputs(system: LureSystem, rows: NDArray[np.intp]) -> Array:
    """First inputs of all elements in the start state, by passing through direct connections once for each element."""
    w = np.zeros(system.B.shape[1])
    z = np.zeros(system.C.shape[0])
    for _ in range(len(rows) + 1):
        z = system.C @ system.x0 + system.D @ w + system.D_input @ system.v0 + system.constant_input
        terms = [(system.C, system.x0), (system.D, w), (system.D_input, system.v0)]
        size = sum((np.abs(matrix) @ np.abs(vector) for matrix, vector in terms), np.abs(system.constant_input))
        z = without_rounding(z, size)
        for i, e in enumerate(system.elements):
            scale = float(np.min(e.thresholds(), initial=np.inf))
            scale = 1e-9 * (scale if np.isfinite(scale) else abs(float(z[rows[i]])) or 1.0)
            mean, _ = describe(e, np.array(scale), np.array(z[rows[i]]), np.array(1.0))
            w[system.output_slices[i]] = np.nan_to_num(mean)
    return z[rows]
