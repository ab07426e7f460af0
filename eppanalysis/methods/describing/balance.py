"""DF harmonic balance with bias as equations: residual, Jacobian, a vectorised Newton, the static balance.

Notation: ``m`` elements, ``a`` (..., m) amplitudes and ``b`` (..., m) means of their first inputs, ``omega`` (...,).
Phasors P mean ``Im(P exp(j omega t))``, so an input in sine phase has a real phasor. A vector of unknowns is

    X = [ln a_p, ln omega, (ln a_i, phase_i) for i != p, b_1 .. b_m, ln lambda]          length 3 m + 1

with the pivot element p in sine phase and a real gain lambda put in front of it for the fundamental. Its 3 m
equations leave curves; the limit cycles are the points of these curves with lambda = 1.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eppanalysis.arrays import Array, BoolArray, ComplexArray
from eppanalysis.engine.balances import assemble, move, newton_balance, shift, solve
from eppanalysis.models.elements.base import Nonlinearity
from eppanalysis.models.systems.lure import LureSystem
from eppanalysis.models.systems.means import CANCELLED, StaticBalance, least_solution, static_balance
from eppanalysis.readable import number, readable

_STEP = 1e-7  # relative step of the forward differences; it only slows Newton, it does not bias its answer
_LARGEST_STEP = 0.7  # in one Newton step, of logarithms and phases
#: A point is lost after so many steps in a row that are so many times longer than one may be: none of them can have
#: been towards a solution nearby, and what is far away is another point's.
_LOST, _LONG = 3, 100.0
#: Two steps in a row below this are as good as one below the tolerance.
_AS_GOOD = 1e-9
#: Last step of Newton's method for points of a curve that are only steps on the way to a limit cycle.
ON_THE_WAY = 1e-7
#: Amplitudes of any size.
_ANY_SIZE = np.geomspace(1e-40, 1e40, 161)


@dataclass(frozen=True, eq=False)
class Slopes:
    """What the elements make of their inputs Z (nb, m): means and gains (nb, nw), and their slopes (3, nb, nw).

    These are by ln a and by b of the element that owns an output, and by ln omega.
    """

    Z: ComplexArray
    omega: Array
    means: Array
    gains: ComplexArray
    by_means: Array
    by_gains: ComplexArray


@dataclass(frozen=True, eq=False)
class Balance:
    """The balance equations of one system at one value of its external inputs."""

    system: LureSystem
    pivot: int  # element whose input is in sine phase and carries the artificial gain
    static: StaticBalance  # balance of the means

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
        """Least inputs of the elements that the static balance prescribes, shape (m,): searches for biases begin there.

        The start state of the system has no say in it: a prediction is of the loop.
        """
        return least_solution(self.on_bias, self.prescribed)

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
        """Places of the logarithms of all amplitudes in a vector of unknowns; the phases of the others come next."""
        places = np.zeros(self.m, dtype=np.intp)
        places[self.others] = 2 * np.arange(1, self.m)
        return places

    def linear(self, omega: Array) -> ComplexArray:
        """Response from all outputs to the first inputs, shape (nb, m, nw)."""
        return self.system.frequency_response(omega).take(self.rows, axis=1)

    def linear_and_slope(self, omega: Array) -> tuple[ComplexArray, ComplexArray]:
        """:meth:`linear` and its derivative by ln omega."""
        L, dL = self.system.frequency_response_and_slope(omega)
        return L.take(self.rows, axis=1), dL.take(self.rows, axis=1) * omega[:, None, None]

    def evaluate(self, a: Array, b: Array, omega: Array) -> tuple[Array, ComplexArray]:
        """Mean outputs and gains of all elements, shapes (..., nw)."""
        means, gains = [], []
        for i, e in enumerate(self.system.elements):
            mean, gain = describe(e, a[..., i], b[..., i], omega)
            means.append(mean)
            gains.append(gain)
        return np.concatenate(means, -1), np.concatenate(gains, -1)

    @np.errstate(all="ignore")
    def slopes(
        self, X: Array, free_pivot: bool = True, known: tuple[NDArray[np.intp], Array, ComplexArray] | None = None
    ) -> Slopes:
        """What the elements do at nb points; without `free_pivot` amplitude of pivot and omega are held.

        With `known` only those that it lists are evaluated; means and gains of the others are held, as given there.
        """
        m, n, nw = self.m, len(X), self.owner.size
        a, b, omega, Z = np.empty((m, 4, n)), np.empty((m, 4, n)), np.empty((4, n)), np.empty((n, m), complex)
        mean, gain, steps = np.empty((n, nw)), np.empty((n, nw), complex), np.empty((3, n, nw))
        by_mean, by_gain = np.zeros((3, n, nw)), np.zeros((3, n, nw), complex)
        shift(X, self.places, self.pivot, self.owner, _STEP, Z, a, b, omega, steps)
        for i, e in enumerate(self.system.elements):
            out, used = self.system.output_slices[i], self._shifts(i, free_pivot)
            if known is not None and i not in known[0]:
                mean[:, out], gain[:, out] = known[1][:, out], known[2][:, out]
                continue
            exact = e.described_with_slopes(a[i, 0], b[i, 0])
            if exact is not None:
                o = out.start
                mean[:, o], gain[:, o], (level, sway) = exact
                by_mean[0, :, o], by_mean[1, :, o] = sway * a[i, 0], level
                by_gain[0, :, o], by_gain[1, :, o] = 2.0 * (level - exact[1]), sway * (2.0 / a[i, 0])
                continue
            means, gains = _described(e, a[i, used], b[i, used], omega[used])
            mean[:, out], gain[:, out] = means[0], gains[0]
            by = slice(1, 3, 2) if used.step else slice(used.stop - 1)
            by_mean[by, :, out] = (means[1:] - means[0]) / steps[by, :, out]
            by_gain[by, :, out] = (gains[1:] - gains[0]) / steps[by, :, out]
        return Slopes(Z, omega[0], mean, gain, by_mean, by_gain)

    def _shifts(self, element: int, free_pivot: bool) -> slice:
        """Which of the shifts change the outputs of an element."""
        if element == self.pivot and not free_pivot:
            return slice(0, 4, 2)
        e = self.system.elements[element]
        return slice(0, 4 if free_pivot and (e.n_inputs > 1 or e.of_frequency) else 3)

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
        s = self.slopes(X)
        return self.assemble(X, s, *self.linear_and_slope(s.omega))

    def assemble(self, X: Array, s: Slopes, L: ComplexArray, dL: ComplexArray) -> tuple[Array, Array]:
        """Residual and Jacobian from what they are made of: slopes, linear response and its slope.

        Without the slope of the linear response, of length zero, what belongs to omega is left out.
        """
        n, m = len(X), self.m
        J, R = np.empty((n, 3 * m, 3 * m + 1)), np.empty((n, 3 * m))
        elements = s.means, s.gains, s.by_means, s.by_gains
        assemble(X, self.places, self.owner, self.pivot, self._of_means, elements, s.Z, L, dL, J, R)
        return R, J

    @cached_property
    def _of_means(self) -> tuple[Array, Array, Array]:
        """The static balance as the engine takes it."""
        parts = self.on_bias, self.on_mean, self.prescribed
        on_bias, on_mean, prescribed = (np.ascontiguousarray(part, float) for part in parts)
        return on_bias, on_mean, prescribed

    def newton_compiled(
        self,
        X: Array,
        normal: Array,
        iterations: int,
        limits: tuple[float, ...],
        parts: tuple[NDArray[np.intp], ...],
        L: ComplexArray,
        around: ComplexArray,
        jacobian: Array,
        found: BoolArray,
    ) -> bool:
        """Newton's method in the engine, see :func:`eppanalysis.engine.balances.newton_balance`.

        False, with nothing done, where an element or the linear part has no closed form.
        """
        if self.closed_forms is None:
            return False
        # Of numbers of one type, or it would be compiled anew.
        numbers, of_balance = (_STEP, *map(float, limits)), (self.places, self.pivot, self._of_means)
        newton_balance(
            X, normal, iterations, numbers, parts, *of_balance, *self.closed_forms, L, around, jacobian, found
        )
        return True

    @cached_property
    def closed_forms(self) -> tuple[tuple[Any, ...], tuple[Array, ...]] | None:
        """Elements and linear part as the engine takes them; None where it has no closed form."""
        s, forms = self.system, [e.closed_form for e in self.system.elements]
        known = [form for form in forms if form is not None]
        if type(s) is not LureSystem or s.time_step or np.any(s.delays) or len(known) < len(forms):
            return None
        first = np.cumsum([0, *(form.pieces[0].size for form in known)])
        maps = tuple(np.concatenate(part) for part in zip(*(form.pieces for form in known), strict=True))
        linear = tuple(np.array(part, float, order="C") for part in (s.A, s.B, s.C[self.rows], s.D[self.rows]))
        numbers = np.array([(*form.pin, form.loop, *form.limit) for form in known], float)
        return (first, maps, numbers), linear

    @cached_property
    def solved(self) -> Balance | None:
        """The same with an equation of means for each element, without mean outputs that a fixed mean input makes zero.

        None where the static balance cannot be brought there.
        """
        static = self.static.solved(self.owner)
        if static is None:
            return None
        for i, e in enumerate(self.system.elements):
            if np.any(static.on_mean[i]) or np.count_nonzero(static.on_bias[i]) > 1:
                continue
            bias = np.full(_ANY_SIZE.shape, static.prescribed[i] / static.on_bias[i, i])
            mean, gain = describe(e, _ANY_SIZE, bias, np.ones(_ANY_SIZE.shape))
            if np.all(np.abs(mean) <= CANCELLED * np.abs(gain) * _ANY_SIZE[:, None]):
                static.on_mean[:, self.owner == i] = 0.0
        return replace(self, static=static)

    def blocks(self, acts: BoolArray) -> list[NDArray[np.intp]]:
        """Elements that can only be solved for together, each block behind all that it needs.

        Amplitude of the pivot and frequency are given, and the balance is one that is :attr:`solved`.

        Parameters
        ----------
        acts : bool array, shape (m, nw)
            Which outputs act on which inputs.
        """
        acts = acts & (np.arange(self.m) != self.pivot)[:, None] | (self.on_mean != 0)
        needs = np.stack([acts[:, self.owner == i].any(1) for i in range(self.m)], 1)
        needs |= (self.on_bias != 0) | np.eye(self.m, dtype=bool)
        for _ in range(self.m):
            needs = needs @ needs
        order = np.argsort(needs.sum(1), kind="stable")
        together = [np.flatnonzero(needs[i] & needs[:, i]) for i in order]
        return [block for i, block in zip(order, together, strict=True) if block[0] == i]

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
        return _described(element, a, b, omega)


def _described(element: Nonlinearity, a: Array, b: Array, omega: Array) -> tuple[Array, ComplexArray]:
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
    tolerance : float, optional
        On the last step, in logarithms, phases and biases relative to amplitude; what is left after it is of the order
        of its square.
    """
    return newton_and_jacobian(balance, X, normal, iterations, tolerance)[:2]


def newton_and_jacobian(
    balance: Balance, X: Array, normal: Array, iterations: int, tolerance: float
) -> tuple[Array, NDArray, Array]:
    """:func:`newton`, and the Jacobian (nb, 3 m, 3 m + 1) with which each point made its last step."""
    jacobian = np.zeros((len(X), 3 * balance.m, X.shape[1]))
    X, done = X.copy(), np.ones(len(X), bool)
    limits, every = (_LARGEST_STEP, _LONG, _LOST, tolerance, _AS_GOOD), np.arange(X.shape[1])
    parts, moving = (every[: balance.m], every[:-1], every), np.empty((0, balance.m, balance.m), complex)
    if balance.newton_compiled(X, normal, iterations, limits, parts, moving, moving[:, 0, 0], jacobian, done):
        return X, done, jacobian
    done[:] = False
    settled, lost = np.zeros(len(X), bool), np.zeros(len(X), int)
    alive = np.all(np.isfinite(X), -1)
    with np.errstate(all="ignore"):
        for _ in range(iterations):
            todo = np.flatnonzero(alive & ~done)
            if not todo.size:
                break
            x = X[todo]
            R, J = balance.residual(x)
            jacobian[todo] = J
            step, regular = solved(J, R, normal[todo])
            largest, sound = moved(balance, x, step, _LARGEST_STEP)
            X[todo] = x
            lost[todo] = np.where(largest > _LONG, lost[todo] + 1, 0)
            alive[todo] = regular & sound & (lost[todo] < _LOST)
            # Rounding may keep the last steps above the tolerance; two small ones in a row are as good.
            small = (largest < _AS_GOOD) & regular
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


def moved(balance: Balance, X: Array, step: Array, longest: float) -> tuple[Array, NDArray]:
    """Take steps (nb, 3 m + 1) from points, which are changed, shortened to the longest one in :func:`scales`.

    Returns
    -------
    (largest, sound) : array (nb,), bool array (nb,)
        Lengths of the whole steps, and whether points are finite and have not run away.
    """
    largest, sound = np.empty(len(X)), np.empty(len(X), bool)
    move(X, balance.places, step, longest, largest, sound)
    return largest, sound


def solved(J: Array, R: Array, border: Array, edge: float = 0.0) -> tuple[Array, NDArray]:
    """Solutions (nb, c) of systems J (nb, c - 1, c) with one row more, the border with `edge` on its right side."""
    rows, columns = np.arange(R.shape[1]), np.arange(J.shape[2])
    return solved_in_part(J, R, rows, columns, border, edge)


def solved_in_part(
    J: Array, R: Array, rows: NDArray[np.intp], columns: NDArray[np.intp], border: Array, edge: float = 0.0
) -> tuple[Array, NDArray]:
    """Solve a batch of systems, for some columns by some rows, after scaling these.

    Returns
    -------
    (solution, regular) : array (nb, c), bool array (nb,)
        Singular systems give a huge solution, which the caller limits; those that are not finite zeros and False.
    """
    out, ok = np.empty((len(R), J.shape[2])), np.empty(len(R), bool)
    solve(J, R, rows, columns, border, edge, out, ok)
    return out, ok


def unit_at_input(system: LureSystem, element: int) -> str:
    """Unit of an element's input: its own, or of signals whose sum or difference it is; empty where none has one."""
    z, signals = system.input_slices[element].start, system.signals
    wanted = np.hstack([system.C[z], system.D[z], system.D_input[z]])
    rows = np.hstack([signals.C, signals.D, signals.D_input])
    for unit in () if system.elements[element].input_unit else filter(None, dict.fromkeys(signals.units)):
        alike = rows[[unit == other for other in signals.units]]
        terms = np.concatenate([np.zeros_like(alike[:1]), alike, -alike])
        sums = terms[:, None] + alike
        if any(np.isclose(sums, w, atol=1e-8 * np.abs(w).max()).all(-1).any() for w in (wanted, -wanted)):
            return unit
    return system.elements[element].input_unit


def ranges(system: LureSystem, element: int, amplitude: Array, omega: Array) -> tuple[str, str]:
    """From where to where amplitudes at an element and frequencies run, in the units that people read."""
    unit, factor = readable(unit_at_input(system, element))
    low, high = factor * amplitude[[0, -1]]
    slow, fast = omega[[0, -1]] / (2.0 * np.pi)
    return f"{number(low, 3)} to {number(high, 3)} {unit}".rstrip(), f"{number(slow, 3)} to {number(fast, 3)} Hz"
