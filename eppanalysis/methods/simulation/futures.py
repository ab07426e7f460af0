"""What the mode of a motion says of all its future: it rests, swings, leaves, or drifts to a switch at a known time.

Within one combination of modes the loop is affine until a guard is passed. Its motion is split into parts that decay,
drift (eigenvalues of zero), swing undamped and grow, and what each can add to a guard is bounded, for the decaying part
by its Lyapunov ellipsoid. Where no guard can be passed, what the parts do is what the motion does for ever
(docs/theory/exact_orbits.md, How a run ends).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import expm, matrix_balance, schur, solve_continuous_lyapunov, solve_sylvester

from eppanalysis.arrays import Array, BoolArray, ComplexArray, IntArray
from eppanalysis.methods.simulation.modes import ModeLaw, law_of
from eppanalysis.models.systems.hybrid import HybridSystem, of_model

#: Rounding of a rate or a guard, relative to its terms, and of a rank, relative to the largest singular value.
_ROUNDING, _RANK = 1e-13, 1e-12
#: A root of rounding, as a double root has it: real parts beside moduli, distances from a guard beside its terms, and
#: sizes of oscillations beside the state, below which they are zero.
_ZERO = 1e-9
#: Time constants after which an exponential is beneath rounding.
_DECAYED = 40.0


@dataclass(frozen=True, eq=False)
class Rests:
    """The motion comes to rest at a state (n,), without another switch."""

    state: Array


@dataclass(frozen=True)
class Swings:
    """An undamped oscillation goes on without another switch."""


@dataclass(frozen=True)
class Leaves:
    """The motion goes beyond all bounds, without another switch."""


@dataclass(frozen=True, eq=False)
class Switches:
    """What drifts comes to a guard: no switch is met for so long [s]."""

    after: float
    motion: _Motion

    @property
    def state(self) -> Array:
        """The state just before the switch, (n,)."""
        return self.motion.at(self.after)


Future = Rests | Swings | Leaves | Switches


def future_of(start: HybridSystem) -> Future | None:
    """What is to come from a state in its modes; None where they alone do not say."""
    if start.model.smooth_kind.size:  # a curved element, or a dead time, whose past no state has
        return None
    key, modes = start.modes0.tobytes(), _modes_of(start)
    if key not in modes:
        law = law_of(start, start.modes0)
        modes[key] = None if law is None else _Mode.of(start, law)
    mode = modes[key]
    return None if mode is None else mode.future(np.append(start.x0, start.H0))


def future_under(start: HybridSystem, law: ModeLaw, y: Array) -> Future | None:
    """What is to come from y (N,) under a law that is none of a single combination of modes."""
    mode = _Mode.of(start, law)
    return None if mode is None else mode.future(y)


@of_model
def _modes_of(hybrid: HybridSystem) -> dict[bytes, _Mode | None]:
    """The combinations of modes that motions of a model were met in, which fill it."""
    return {}


@dataclass(frozen=True, eq=False)
class _Mode:
    """The affine motion of the states that repeat, and the guards, of one combination of modes.

    In coordinates z = Wi x the motion falls into parts with eigenvalues of their own: L = Wi A W is block diagonal.
    """

    levels: Array  # (N, N): puts what sticks on its level, beside which it is by rounding
    F: Array  # (n, N): rates of all states by y, which stacks them on memory values and a 1
    g: Array  # (guards, N): below zero until passed
    repeats: IntArray  # (k,): states that repeat
    clocks: IntArray  # those that do not, and matter to those that do or to a guard
    W: Array
    Wi: Array
    L: Array
    drifts: slice
    decays: slice
    swings: slice
    grows: slice

    @classmethod
    def of(cls, hybrid: HybridSystem, law: ModeLaw) -> _Mode | None:
        """Under a law of motion; None where nothing repeats, or its parts are not separated."""
        F, g, repeats = law.F, law.g, np.flatnonzero(hybrid.compared)
        if not repeats.size:
            return None
        matters = np.any(np.vstack([F[repeats], g])[:, : len(F)] != 0.0, axis=0)
        parts = _parts(F[np.ix_(repeats, repeats)])
        if parts is None:
            return None
        return cls(law.levels, F, g, repeats, np.flatnonzero(matters & ~hybrid.compared), *parts)

    @cached_property
    def guards(self) -> Array:
        """The guards by z, (guards, k)."""
        G = self.g[:, self.repeats]
        H = G @ self.W
        return np.where(np.abs(H) <= _ROUNDING * (np.abs(G) @ np.abs(self.W)), 0.0, H)

    @cached_property
    def ellipsoid(self) -> Array:
        """P of a function e' P e of what decays."""
        return _lyapunov(self.L[self.decays, self.decays])

    @cached_property
    def _terms_of_levels(self) -> Array:
        """How large the terms of states are that are put on levels, by these states, (N, N)."""
        return np.asarray(np.abs(self.levels) + np.abs(np.eye(len(self.levels)) - self.levels))

    def _compared_with(self, size: Array) -> Array:
        """How large the terms of guards are that memory values are compared with: they were made of such, and are known
        to the rounding of these alone. Of a play that is let go near rest its output is a difference.
        """
        memory = np.abs(self.g[:, len(self.F) : -1])
        with np.errstate(divide="ignore", invalid="ignore"):
            beside = (np.abs(self.g) @ size)[:, None] / memory
        return np.max(beside, axis=0, where=memory > 0.0, initial=0.0)

    def future(self, y: Array) -> Future | None:
        """What is to come from y, (N,)."""
        # A state that the parts of the motion cancel in is their rounding, and so is what is put on a level.
        size = self._terms_of_levels @ np.abs(y)
        y, of_guards = self.levels @ y, np.abs(self.g) @ size
        size[self.repeats] = np.abs(self.W) @ (np.abs(self.Wi) @ size[self.repeats])
        size[len(self.F) : -1] = np.maximum(size[len(self.F) : -1], self._compared_with(size))
        rates, terms = self.F @ y, np.abs(self.F) @ size
        if np.any(np.abs(rates[self.clocks]) > _ROUNDING * terms[self.clocks]):
            return None
        rate, noise = self.Wi @ rates[self.repeats], _ROUNDING * (np.abs(self.Wi) @ terms[self.repeats])
        return _Motion(self, y, np.where(np.abs(rate) <= noise, 0.0, rate), of_guards).future()


@dataclass(frozen=True, eq=False)
class _Motion:
    """The motion of a mode from y: each part goes about its centre, but what drifts, which is a polynomial of time."""

    mode: _Mode
    y: Array
    rate: Array  # (k,): of z
    terms: Array  # (guards,): how large those are that guards are made of

    def future(self) -> Future | None:
        """By what the parts can add to the guards at most."""
        mode = self.mode
        limit = mode.g @ self.y - mode.guards @ self.away
        swing, is_swinging = self._swing()
        most = limit + self._decay() + swing
        free = most < -_ROUNDING * self.terms
        if self.away[mode.grows].size:
            return self._ray(most, free) if not self.drift.any() else None
        on_edge = (np.abs(limit) <= _ZERO * self.terms) & ~free & ~np.any(mode.guards @ self.drift != 0.0, axis=1)
        stays = not is_swinging and self._stays(mode.guards[on_edge][:, mode.decays]) if on_edge.any() else True
        if not (stays and np.all(free | on_edge)):
            return None
        if self.drift.any():
            return self._ramp(np.where(on_edge, limit, most))
        return Swings() if is_swinging else Rests(self.at(np.inf))

    @cached_property
    def away(self) -> Array:
        """Where z is about its centres, (k,); zero for what drifts."""
        away = np.zeros(self.rate.size)
        for part in (self.mode.decays, self.mode.swings, self.mode.grows):
            if self.rate[part].size:
                away[part] = np.linalg.solve(self.mode.L[part, part], self.rate[part])
        return away

    @cached_property
    def drift(self) -> Array:
        """Coefficients of t, t², … of what drifts, (k, powers)."""
        part = self.mode.drifts
        N, now = self.mode.L[part, part], self.rate[part]
        out = np.zeros((self.rate.size, now.size))
        for power in range(now.size):
            out[part, power] = now
            now = N @ np.where(np.abs(now) <= _ROUNDING * np.abs(now).max(), 0.0, now) / (power + 2.0)
        return out

    def at(self, t: float) -> Array:
        """The state after a time [s], or where it comes to rest, (n,)."""
        mode, n = self.mode, len(self.mode.F)
        moved = -self.away
        if np.isfinite(t):
            moved = moved + self.drift @ t ** np.arange(1.0, self.drift.shape[1] + 1.0)
            # What has decayed by so late is beneath rounding whatever the matrix is multiplied by.
            late = min(t, _DECAYED / -np.diag(mode.L)[mode.decays].max(initial=-np.inf))
            moved[mode.decays] += expm(mode.L[mode.decays, mode.decays] * late) @ self.away[mode.decays]
            values, vectors, shares = self._oscillations
            moved[mode.swings] += (vectors @ (np.exp(1j * values.imag * t) * shares)).real
        else:
            moved[mode.swings] = 0.0
        state = self.y[:n].copy()
        state[mode.repeats] += mode.W @ moved
        return state

    def _decay(self) -> Array:
        """What the decaying part can still add to each guard, by the ellipsoid of its Lyapunov function."""
        part = self.mode.decays
        return _within(self.mode.ellipsoid, self.away[part], self.mode.guards[:, part])

    @cached_property
    def _oscillations(self) -> tuple[ComplexArray, ComplexArray, ComplexArray]:
        """Eigenvalues and vectors of what swings undamped, and how much of each there is."""
        part = self.mode.swings
        values, vectors = np.linalg.eig(self.mode.L[part, part].astype(complex))
        return values, vectors, np.linalg.solve(vectors, self.away[part].astype(complex))

    def _swing(self) -> tuple[Array, bool]:
        """What undamped oscillations add to each guard at most, and whether there are any."""
        part = self.mode.swings
        _, vectors, shares = self._oscillations
        size = np.abs((self.mode.W[:, part] @ vectors) * shares).max(initial=0.0)
        is_swinging = size > _ZERO * np.abs(self.y[self.mode.repeats]).max()
        return np.abs((self.mode.guards[:, part] @ vectors) * shares).sum(axis=1), bool(is_swinging)

    def _ramp(self, most: Array) -> Future:
        """Guards as polynomials of time: the first that may be passed, or none."""
        rows = self.mode.guards @ self.drift
        after = min((_first_root(a, row) for a, row in zip(most, rows, strict=True)), default=np.inf) * (1.0 - _ZERO)
        return Switches(after, self) if np.isfinite(after) else Leaves()

    def _ray(self, most: Array, free: BoolArray) -> Future | None:
        """Growth that no guard looks at, or along one direction, which all guards that do fall along."""
        part = self.mode.grows
        H, away = self.mode.guards[:, part], self.away[part]
        way = H[:, 0] * away[0] if away.size == 1 else np.where(H.any(axis=1), np.inf, 0.0)
        return Leaves() if away.any() and np.all((way <= 0.0) & (free | (most + way < 0.0))) else None

    def _stays(self, H: Array) -> bool:
        """Whether the guards H (·, decays) that the rest lies on are come to from below alone: the slowest motion leads
        there, real and falling along them, and what decays faster stays in a cone about it.
        """
        L, away = self.mode.L[self.mode.decays, self.mode.decays], self.away[self.mode.decays]
        if not away.size:
            return False
        values = np.linalg.eigvals(L)
        slow = values[int(np.argmax(values.real))]
        split = _split(L, lambda value: value.real > slow.real * (1.0 + _ZERO))
        if abs(slow.imag) > _ZERO * abs(slow) or split is None or split[2] != 1:
            return False
        V, Vi, _ = split
        z, along = Vi @ away, H @ V
        faster = (Vi @ L @ V)[1:, 1:] - slow.real * np.eye(z.size - 1)
        return bool(np.all(along[:, 0] * z[0] + _within(_lyapunov(faster), z[1:], along[:, 1:]) < 0.0))


def _first_root(constant: float, row: Array) -> float:
    """First time at which a polynomial of time passes zero; infinite where it never does."""
    if not row.any():
        return np.inf
    if not row[1:].any():
        return -constant / float(row[0]) if constant * row[0] < 0.0 else np.inf
    # In the unit of time in which the largest term is as large as the constant: coefficients are of all sizes.
    orders = np.arange(1, row.size + 1)
    with np.errstate(divide="ignore"):
        unit = float(np.min((abs(constant) / np.abs(row)) ** (1.0 / orders), where=row != 0.0, initial=np.inf))
    roots = np.roots([*(row * unit**orders)[::-1], constant])
    real = roots[np.abs(roots.imag) <= _ZERO * np.abs(roots)].real
    return unit * float(np.min(real, where=real > 0.0, initial=np.inf))


def _lyapunov(L: Array) -> Array:
    """P of a function e' P e that falls along e' = L e, L in Schur form: each motion counts alike, however fast."""
    return np.asarray(solve_continuous_lyapunov(L.T, np.diag(np.diag(L))), float) if L.size else L


def _within(P: Array, away: Array, H: Array) -> Array:
    """The largest values of H e on the ellipsoid of P through a point, one for each row of H."""
    if not away.size:
        return np.zeros(len(H))
    reach = np.einsum("ij,ji->i", H, np.linalg.solve(P, H.T))
    return np.asarray(np.sqrt(np.maximum(float(away @ P @ away) * reach, 0.0)))


def _parts(A: Array) -> tuple[Array, Array, Array, slice, slice, slice, slice] | None:
    """W, W^-1, L, and the places in L of the parts that drift, decay, swing and grow; None where that is unclear.

    Eigenvalues of zero are found by ranks: rounding makes a ring of small ones of a chain of integrators.
    """
    scaled, (scale, _) = matrix_balance(A, permute=False, separate=True)
    balanced = np.asarray(scaled, float)
    rounding = len(A) * _ROUNDING * float(np.abs(balanced).max(initial=0.0))

    def swings(value: complex) -> bool:
        return abs(value.real) <= _ZERO * abs(value) + rounding

    W, Wi, k = _decoupled(balanced, *_null_space(balanced))
    ends = [0, k]
    for kind in (lambda value: value.real < 0.0 and not swings(value), swings):
        rest = slice(ends[-1], len(A))
        split = _split((Wi @ balanced @ W)[rest, rest], kind)
        if split is None:
            return None
        W[:, rest], Wi[rest] = W[:, rest] @ split[0], split[1] @ Wi[rest]
        ends.append(ends[-1] + split[2])
    L = Wi @ balanced @ W
    drifts, decays, undamped, grows = (slice(a, b) for a, b in zip(ends, [*ends[1:], len(A)], strict=True))
    # A real one that is neither zero by rank nor damped is distinct from neither.
    if np.any(np.linalg.eigvals(L[undamped, undamped]).imag == 0.0):
        return None
    W, Wi = _without_rounding(W), _without_rounding(Wi.T).T
    return scale[:, None] * W, Wi / scale, L, drifts, decays, undamped, grows


def _without_rounding(W: Array) -> Array:
    """Columns without what is rounding beside their largest entry."""
    return np.where(np.abs(W) <= _ROUNDING * np.abs(W).max(axis=0), 0.0, W)


def _null_space(A: Array) -> tuple[Array, int]:
    """Orthonormal coordinates whose first k span all motions of the eigenvalue zero, and k."""
    Q, k = np.eye(len(A)), 0
    size = float(np.linalg.norm(A, 2))
    while k < len(A):
        _, gains, ways = np.linalg.svd((Q.T @ A @ Q)[k:, k:])
        null = int(np.sum(gains <= _RANK * size))
        if not null:
            break
        Q[:, k:] = Q[:, k:] @ np.roll(ways.T, null, axis=1)
        k += null
    return Q, k


def _split(A: Array, first: Callable[[complex], bool]) -> tuple[Array, Array, int] | None:
    """Coordinates V, V^-1 and k: the k eigenvalues that `first` holds of come first, apart from the others; None where
    no Schur form keeps them apart.
    """
    if not A.size:
        return A, A, 0

    def chosen(re: float, im: float = 0.0) -> bool:
        return first(complex(re, im))

    try:
        _, Q, k = schur(A, output="real", sort=chosen)
        return _decoupled(A, Q, k)
    except np.linalg.LinAlgError:
        return None


def _decoupled(A: Array, Q: Array, k: int) -> tuple[Array, Array, int]:
    """Coordinates V, V^-1 in which the first k of orthonormal ones, which span an invariant space, and the rest are
    apart.
    """
    S, n = Q.T @ A @ Q, len(A)
    U, V = np.eye(n), np.eye(n)
    if 0 < k < n:
        X = solve_sylvester(S[:k, :k], -S[k:, k:], -S[:k, k:])
        U[:k, k:], V[:k, k:] = X, -X
    return Q @ U, V @ Q.T, k
