"""The loop with its elements as gains: closed, and cut open at one place; dead times stay what they are."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from eppanalysis.arrays import Array, BoolArray, ComplexArray
from eppanalysis.errors import ModelError
from eppanalysis.methods.margins.sampled import from_sample_to_sample, with_straight_gains
from eppanalysis.models.elements.piecewise import UNITY
from eppanalysis.models.systems.absorbed import gain_matrix
from eppanalysis.models.systems.linear import ROUNDING, balanced, poles, zeros
from eppanalysis.models.systems.lure import LureSystem, with_own_states
from eppanalysis.models.systems.sampled.averaged import averaged
from eppanalysis.models.systems.sampled.strobe import is_sampled, sampled_among
from eppanalysis.readable import number

#: Condition number from which an algebraic loop has no unique solution.
_SINGULAR = 1e13
#: Numbers whose squares are finite and not zero.
_LARGEST = 1e150
#: Share of the terms that a response is made of below which it is none.
_NOTHING = 1e-11
#: Share of the largest state, in even units, that a state counts as at least: one that nothing reaches holds rounding.
_LEAST = 1e-3


@dataclass(frozen=True, eq=False)
class Linear:
    """``dx/dt = sum of A x(t - delay) + B u(t - delay) over the terms, y = C x + D u``, one input, one output."""

    terms: tuple[tuple[float, Array, Array], ...]  # delay [s], A and B; ascending, the first without delay
    #: C, D: (1, n), (1, 1)
    C: Array
    D: Array
    time_step: float | None  # sample time [s] of a system in discrete time, where ``dx/dt`` is the next state

    @property
    def rational(self) -> bool:
        """Whether there is no dead time."""
        return len(self.terms) == 1

    @property
    def n(self) -> int:
        """Number of states."""
        return self.C.shape[1]

    @property
    def longest_delay(self) -> float:
        """Longest dead time [s]."""
        return self.terms[-1][0]

    @property
    def all_at_once(self) -> tuple[Array, Array]:
        """A and B with all dead times left out."""
        return np.sum([t[1] for t in self.terms], axis=0), np.sum([t[2] for t in self.terms], axis=0)

    def matrices(self, s: ComplexArray) -> tuple[ComplexArray, ComplexArray]:
        """A (m, n, n) and B (m, n, 1) at points s of the Laplace variable, (m,); in discrete time of z."""
        A, B = np.zeros((s.size, self.n, self.n), complex), np.zeros((s.size, self.n, 1), complex)
        for delay, a, b in self.terms:
            late = s ** -round(delay / self.time_step) if self.time_step else np.exp(-s * delay)
            A += late[:, None, None] * a
            B += late[:, None, None] * b
        return A, B

    def points(self, omega: Array) -> ComplexArray:
        """Points of the Laplace variable on the imaginary axis; of z on the unit circle."""
        return np.asarray(np.exp(1j * omega * self.time_step) if self.time_step else 1j * omega, complex)

    def response(self, omega: Array) -> ComplexArray:
        """From the input to the output at frequencies (m,) [rad/s]; nan at a pole."""
        s = self.points(omega)
        A, B = self.matrices(s)
        x = _solved(s[:, None, None] * np.eye(self.n) - A, B)
        return np.asarray((self.C @ x)[:, 0, 0] + self.D[0, 0], complex)

    def slope(self, omega: Array) -> ComplexArray:
        """Derivative of the response by the frequency, at frequencies (m,) [rad/s]; nan at a pole."""
        s = self.points(omega)
        A, B = self.matrices(s)
        resolvent = s[:, None, None] * np.eye(self.n) - A
        x = _solved(resolvent, B)
        ds = 1j * self.time_step * s if self.time_step else np.full(s.size, 1j)
        moved = -ds[:, None, None] * x
        for delay, a, b in self.terms:
            late = s ** -round(delay / self.time_step) if self.time_step else np.exp(-s * delay)
            moved += (-1j * delay * late)[:, None, None] * (a @ x + b)
        return np.asarray((self.C @ _solved(resolvent, moved))[:, 0, 0], complex)

    def slow_end(self, lowest: float) -> tuple[float, float] | None:
        """Frequency zero and the response there, where that is no pole; `lowest` is below all that it does."""
        value = self.response(lowest * np.array([1e-3, 1e-4]))
        rests = np.all(np.isfinite(value)) and abs(value[0] - value[1]) <= 1e-4 * abs(value[1])
        return (0.0, float(value[1].real)) if rests and abs(value[1].imag) < 1e-4 * abs(value[1]) else None

    def fast_end(self) -> tuple[float, float] | None:
        """The highest frequency and the response there: what passes straight through, or half the sampling rate."""
        if not self.time_step:
            return float("inf"), float(self.D[0, 0])
        top = np.pi / self.time_step
        value = complex(self.response(np.array([top]))[0])
        return (top, value.real) if np.isfinite(value) else None

    def closed_at_rest(self, lowest: float) -> float:
        """Size of the loop with this as its gain, far below a frequency that is below all that it does."""
        return float(closed_size(self.response(np.array([1e-3 * lowest])))[0])

    def behind_a_ramp(self) -> float:
        """How far the loop, closed by a feedback of -1, stays behind a ramp in the end, over its rate [s].

        The error 1/(1 + L) to first order in the Laplace variable; infinite where the error is not zero at rest.
        """
        A, B = self.all_at_once
        late = np.sum([delay * np.hstack([a, b]) for delay, a, b in self.terms], axis=0)
        I = np.eye(self.n)  # noqa: E741  # the unit matrix
        # Rows of the states and of the error e = 1 - C x - D e: at rest, and their derivative there.
        still = np.block([[(I if self.time_step else 0.0 * I) - A, -B], [self.C, 1.0 + self.D]])
        moved = np.zeros_like(still)
        moved[: self.n] = np.hstack([(self.time_step or 1.0) * I, 0.0 * B]) + late
        try:
            rest = np.linalg.solve(still, np.eye(self.n + 1)[:, -1])
            error = np.linalg.solve(still, moved @ rest)[-1]
        except np.linalg.LinAlgError:
            return float("nan")
        # An error that is left behind a step grows for ever behind a ramp.
        size = 1.0 + np.abs(still[-1]) @ np.abs(rest)
        return abs(float(error)) if abs(rest[-1]) <= ROUNDING * size else float("inf")

    @cached_property
    def rates(self) -> ComplexArray:
        """Poles and zeros [rad/s], those at the origin left out; of the system without its dead times."""
        A, B = self.all_at_once
        if not self.n:
            return np.zeros(0, complex)
        if not self.time_step:
            found: ComplexArray = np.concatenate([poles(A), zeros(A, B, self.C, self.D)])
        else:
            I = np.eye(self.n)  # noqa: E741  # the unit matrix
            # Slow poles crowd at z = 1: from A - 1 they come out with all their digits.
            z = np.concatenate([poles(A - I), zeros(A - I, B, self.C, self.D)]) + 1.0
            found = np.asarray(np.log(z[np.abs(z) > 1e-9]) / self.time_step, complex)
        size = np.abs(found)
        return np.asarray(found[size > 1e-9 * size.max(initial=0.0)], complex)


def closed_size(L: ComplexArray) -> Array:
    """Size of the closed loop L/(1 + L)."""
    with np.errstate(all="ignore"):
        return np.asarray(np.abs(L / (1.0 + L)), float)


def within_range(name: str, *parts: Array) -> None:
    """Refuse a loop with numbers whose squares are infinite, of which nothing can be computed.

    Raises
    ------
    ModelError
        If one of its parts holds such a number.
    """
    if max(np.abs(part).max(initial=0.0) for part in parts) > _LARGEST:
        what = f"{name}: numbers beyond all range, whose squares are infinite"
        raise ModelError(what, expected="values of ordinary magnitude")


def _solved(resolvent: ComplexArray, right: ComplexArray) -> ComplexArray:
    """Solutions (m, n, 1) of linear equations each; nan where there is none."""
    try:
        return np.asarray(np.linalg.solve(resolvent, right), complex)
    except np.linalg.LinAlgError:
        if len(right) == 1:
            return np.full(right.shape, np.nan, complex)
        return np.concatenate([_solved(r[None], b[None]) for r, b in zip(resolvent, right, strict=True)])


@dataclass(frozen=True, eq=False)
class Linearised:
    """A loop whose elements are gains."""

    system: LureSystem  # with its integrators apart
    gains: Array  # (nw, nz): ``w = gains @ z``; zero for elements that no gain replaces
    without: tuple[int, ...]  # elements that no gain replaces
    executed: tuple[str, ...] = ()  # what replaces sampled controllers, a sentence each

    @classmethod
    def of(cls, loop: LureSystem, place: str) -> Linearised:
        """The loop with every element as the gain that it names (`Nonlinearity.linear_gain`), to be cut at a place.

        Sampled controllers are taken with their hold and delay: exactly where the loop is cut at one of them.

        Raises
        ------
        ModelError
            If numbers are beyond all range.
        """
        loop = small_signal(loop)
        return cls._executed(loop, place) if is_sampled(loop.elements) else cls._of_gains(loop)

    @classmethod
    def _executed(cls, loop: LureSystem, place: str) -> Linearised:
        """A loop with sampled controllers, from sample to sample or in the mean."""
        rest = cls._of_gains(loop)
        controllers = {loop.element_names[i]: e for i, e in sampled_among(loop.elements).items()}
        others = tuple(i for i in rest.without if loop.element_names[i] not in controllers)
        exact = None if others else from_sample_to_sample(loop, rest.gains)
        steps = {n: e.sample_time for n, e in controllers.items()}
        if exact is not None and place in exact.places.names:
            made = cls._of_gains(exact)
            said = (f"{n}: executed every {step:.6g} s, exact from sample to sample." for n, step in steps.items())
            told = tuple(line for line in rest.rule() if line.partition(":")[0] not in controllers)
            return replace(made, executed=(*told, *said))
        made = cls._of_gains(averaged(with_straight_gains(loop, rest.gains)))
        said = (
            f"{n}: executed every {step:.6g} s, in the mean over where its samples fall; near the crossovers good to "
            f"about (omega {step:.6g} s)^2/12."
            for n, step in steps.items()
        )
        return replace(made, executed=tuple(said))

    @classmethod
    def _of_gains(cls, loop: LureSystem) -> Linearised:
        """The loop with its elements as gains."""
        system = loop.with_integrators_apart[0]
        gains = {i: np.asarray(element.linear_gain(), float) for i, element in enumerate(system.elements)}
        without = [i for i, gain in gains.items() if not np.all(np.isfinite(gain))]
        K = gain_matrix(system, {i: gain for i, gain in gains.items() if i not in without})
        within_range(system.name, system.A, system.B, system.C, system.D, K)
        return cls(system, K, tuple(without))

    def rule(self) -> tuple[str, ...]:
        """Which gain replaces each element, and why, a sentence each."""
        said = []
        for i, (name, element) in enumerate(zip(self.system.element_names, self.system.elements, strict=True)):
            if element == UNITY:
                continue  # a dead time is behind it, and nothing replaces it
            block = self.gains[self.system.output_slices[i], self.system.input_slices[i]]
            numbers = ", ".join(number(value) for value in block.ravel())
            none = "none (its output jumps, or its slope has no bound)"
            said.append(f"{name}: {none if i in self.without else f'{numbers} ({element.linear_gain_is})'}.")
        return (*said, *self.executed)

    def closed(self) -> Linear:
        """The closed loop, which nothing drives.

        Raises
        ------
        ModelError
            If the algebraic loop through the elements has no unique solution.
        """
        system, n = self.system, len(self.system.A)
        z = self._inputs(np.eye(len(system.C)) - system.D @ self.gains, system.C)
        terms = self._terms(self.gains @ z, np.zeros((len(self.gains), 1)), system.A, np.zeros((n, 1)), ())
        return Linear(terms, np.zeros((1, n)), np.zeros((1, 1)), system.time_step)

    def opened(self, place: str) -> Linear:
        """The loop cut open: what comes back to a place of what is sent off from it, with the sign of a feedback of -1.

        With ``d = u - y`` at the place, ``y = (C x + D w + F u)/(1 + F)``; all else follows.

        Raises
        ------
        ModelError
            If no place has this name, or the algebraic loop that is left has no unique solution.
        """
        system, cuts = self.system, self.system.places
        i = cuts.number(place)
        share = 1.0 / (1.0 + cuts.F[i])
        E, c, dw = cuts.E[:, [i]], share * cuts.C[[i]], share * cuts.D[[i]]
        C = _without_rounding(system.C - E @ c, np.abs(system.C) + np.abs(E) @ np.abs(c))
        D = _without_rounding(system.D - E @ dw, np.abs(system.D) + np.abs(E) @ np.abs(dw))
        z = self._inputs(np.eye(len(system.C)) - D @ self.gains, np.hstack([C, share * E]))
        w = self.gains @ z
        n = len(system.A)
        y = np.hstack([c, [[share * cuts.F[i]]]]) + dw @ w
        sent = np.hstack([np.zeros((1, n)), [[1.0]]])
        of_d = sent + np.abs(np.hstack([c, [[share * cuts.F[i]]]])) + np.abs(dw) @ np.abs(w)
        own = ((float(cuts.delays[i]), cuts.B[:, [i]], sent - y, of_d),)
        terms = self._terms(w[:, :n], w[:, n:], system.A, np.zeros((n, 1)), own)
        # A direct path that rounding alone leaves would hold up the loop gain at all high frequencies.
        size = share * abs(cuts.F[i]) + (np.abs(dw) @ np.abs(self.gains) @ np.abs(z[:, n:]))
        return _in_even_units(Linear(terms, -y[:, :n], _without_rounding(-y[:, n:], size), system.time_step))

    def _inputs(self, left: Array, right: Array) -> Array:
        """Inputs of the elements, as rows on what drives them."""
        if left.size and np.linalg.cond(left) > _SINGULAR:
            raise ModelError(f"{self.system.name}: the algebraic loop through its elements has no unique solution.")
        return np.asarray(np.linalg.solve(left, right), float)

    def _terms(
        self, w_x: Array, w_u: Array, A: Array, B: Array, own: tuple[tuple[float, Array, Array, Array], ...]
    ) -> tuple[tuple[float, Array, Array], ...]:
        """Matrices by their dead time, what has none first; `own` are inputs besides: rows on (x, u), their sizes."""
        n, w = len(A), np.hstack([w_x, w_u])
        parts = {0.0: np.hstack([A, B])}
        sizes = {0.0: np.abs(parts[0.0])}
        late = ((float(delay), self.system.delays == delay) for delay in np.unique(self.system.delays))
        led_in = [(delay, self.system.B[:, own_delay], w[own_delay], np.abs(w[own_delay])) for delay, own_delay in late]
        for delay, into, rows, size in (*led_in, *own):
            parts[delay] = parts.get(delay, 0.0) + into @ rows
            sizes[delay] = sizes.get(delay, 0.0) + np.abs(into) @ size
        parts = {delay: _without_rounding(both, sizes[delay]) for delay, both in parts.items()}
        used = {delay: both for delay, both in sorted(parts.items()) if delay == 0.0 or np.any(both)}
        return tuple((delay, both[:, :n], both[:, n:]) for delay, both in used.items())

    def in_the_way(self, place: str) -> list[int]:
        """Elements without a gain through which what is sent off from a place comes back to it."""
        if not self.without:
            return []
        leads = self._leads(place)
        while np.any(further := ~leads & (leads @ leads)):
            leads |= further
        return [i for k, i in enumerate(self.without, start=1) if leads[0, k] and leads[k, 0]]

    def _leads(self, place: str) -> BoolArray:
        """Whether what a place (0) or an element without a gain (1, ...) sends off (row) reaches another (column).

        Judged by the response at some frequencies, beside the terms that it is made of: whatever the coordinates.
        """
        system, cuts, i = self.system, self.system.places, self.system.places.number(place)
        n, nz, nw = len(system.A), len(system.C), len(self.gains)
        rates = np.abs(poles(system.A)) if not system.time_step else np.zeros(0)
        scale = float(np.exp(np.log(rates[rates > 0]).mean())) if np.any(rates > 0) else 1.0 / (system.time_step or 1.0)
        leads = np.zeros((1 + len(self.without),) * 2, bool)
        units = balanced(system.A)[1] if n else np.zeros(0)
        # Rows of z, then of y and d; columns x, z, d, and what the elements send off.
        seen = np.hstack([system.C, system.D @ self.gains, cuts.E[:, [i]], system.D])
        back = np.hstack([cuts.C[[i]], cuts.D[[i]] @ self.gains, [[cuts.F[i]]], cuts.D[[i]]])
        # At one frequency alone a path may happen to vanish.
        for omega in scale * np.array([0.13, 0.71, 1.9]):
            s = np.exp(1j * omega * system.time_step) if system.time_step else 1j * omega
            late, own = np.exp(-1j * omega * system.delays), np.exp(-1j * omega * cuts.delays[i])
            rate = np.hstack([system.A, (system.B * late) @ self.gains, own * cuts.B[:, [i]], system.B * late])
            left = np.diag([*np.full(n, s), *np.ones(nz + 1)]) - np.vstack([rate, seen, -back])[:, : n + nz + 1]
            sent = np.vstack([rate, seen, -back])[:, n + nz + 1 :]
            for k, outputs in enumerate([slice(0, 0), *(system.output_slices[j] for j in self.without)]):
                right = sent[:, outputs] if k else np.eye(n + nz + 1)[:, [-1]]
                x = np.vstack([np.linalg.solve(left, right), np.eye(nw)[:, outputs] if k else np.zeros((nw, 1))])
                size = self._sizes(x, units, seen, back, nz)
                for m, rows in enumerate([back, *(seen[system.input_slices[j]] for j in self.without)]):
                    leads[k, m] |= bool(np.any(np.abs(rows @ x) > _NOTHING * (np.abs(rows) @ size)))
        return leads

    def _sizes(self, x: ComplexArray, units: Array, seen: Array, back: Array, nz: int) -> Array:
        """Sizes of the terms of which states, inputs, disturbance and outputs are made; rounding is a share of them."""
        n = len(units)
        size = np.abs(x)
        even = size[:n] / units[:, None]
        size[:n] = np.maximum(even, _LEAST * even.max(initial=0.0)) * units[:, None]
        for _ in range(nz + 1):
            size[n : n + nz] = np.maximum(size[n : n + nz], np.abs(seen) @ size)
            size[n + nz] = np.maximum(size[n + nz], (np.abs(back) @ size)[0])
        return size


def small_signal(system: LureSystem) -> LureSystem:
    """The loop with gains in place of elements that are described together with their own states."""
    if system.given is None:
        return system
    elements = tuple(e.small_signal or e for e in system.given.elements)
    loop = replace(system.given, elements=elements)
    return with_own_states(loop) if any(e.own_states is not None for e in elements) else loop


def _without_rounding(numbers: Array, size: Array | float) -> Array:
    """Numbers without what rounding of terms of such a size leaves, as where a path is taken out of a loop again.

    In even units it would be as large as what is there, and an integrator beside others no integrator any more.
    """
    return np.where(np.abs(numbers) <= ROUNDING * size, 0.0, numbers)


def _in_even_units(system: Linear) -> Linear:
    """The same system with its states in units that make rows and columns alike."""
    if not system.n:
        return system
    size = balanced(system.all_at_once[0])[1]
    terms = tuple((delay, A * size / size[:, None], B / size[:, None]) for delay, A, B in system.terms)
    return Linear(terms, system.C * size, system.D, system.time_step)
