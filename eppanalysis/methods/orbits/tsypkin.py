"""Symmetric cycles of one relay, with a dead zone or without: every half period at which its switches close.

With the relay at M for a time w and at zero for the rest of half a period h, the state behind each half is its image:
``x(h) = -x(0)``. In the modes of the linear part, ``g(t) = (exp(s t) - 1)/s``,

    x(0) = -M b (g(h) - g(h - w)) / (1 + exp(s h)),

and the switches lie on their thresholds: one equation for h without a dead zone, where w = h (Tsypkin, Relay Control
Systems, 1984), two for w and h with one. Their roots on a grid are starts for the exact orbits
(docs/theory/exact_orbits.md, The search for all of them).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eppanalysis.arrays import Array, IntArray
from eppanalysis.methods.describing.curves import roots_at_once
from eppanalysis.methods.orbits.guess import Guess, make_guess
from eppanalysis.methods.orbits.mirrored import mirror
from eppanalysis.models.systems.hybrid import HybridSystem
from eppanalysis.models.systems.linear import balanced, integrators_apart, poles as known_poles

#: Numbers of the modes: real ones cost a fraction.
Modes = NDArray[np.inexact]
#: Half periods from this share of the fastest time constant to so many of the slowest; nodes of them on a logarithmic
#: and, eight to half a turn of the fastest oscillation, an even grid; nodes of the pulse in a half period; and half
#: periods that are computed together.
_SHORTEST, _LONGEST = 0.05, 30.0
_LOGARITHMIC, _EVEN, _TO_A_TURN, _PULSES, _BLOCK = 400, 1200, 8, 200, 16
#: How far beside a matrix the one is whose modes replace its own where rounding shows in these by as much. Poles of a
#: multiple one are apart by a root of it, so that rounding in their modes is less than what the step aside changes.
_BESIDE = 1e-10
#: Newton's method in both times: iterations, step for derivatives, and what a root leaves, relative to the guards.
_ITERATIONS, _STEP, _ROOT = 20, 1e-6, 1e-9
#: Samples of a half period at which no other switch may lie, and what counts as beyond one.
_SAMPLES, _BEYOND = 400, 1e-9
#: Relative difference of half periods that are one.
_SAME = 1e-7


@dataclass(frozen=True, eq=False)
class TsypkinLocus:
    """The symmetric motions of one relay."""

    hybrid: HybridSystem
    rates: Array  # sizes of the poles of the linear part, but for that of an integrator [1/s]
    #: poles, given, seen, vectors: (k,), (k,), (k,), (n, k): modes of the linear part, one of each pair, what the
    #: relay's output gives to each, and the relay's input of each; real where no pole swings.
    poles: Modes
    given: Modes
    seen: Modes
    vectors: Modes
    level: float  # largest output of the relay
    #: modes, guards: (p,): of a whole turn, p is 2 without and 4 with a dead zone.
    modes: IntArray
    guards: IntArray
    #: (p / 2, 2): guard at the end of each part of a half: its factor on the input, and constant.
    ends: Array

    @classmethod
    def of(cls, hybrid: HybridSystem) -> TsypkinLocus | None:
        """Of a loop with one relay, odd and without dead time and inputs; None for others."""
        model, image = hybrid.model, mirror(hybrid)
        single = len(hybrid.automata) == len(hybrid.elements) == 1 and hybrid.x0.size == hybrid.n_plant
        if image is None or not single or model.smooth_kind.size or np.any(model.D) or model.C.shape[0] != 1:
            return None
        turn = _turn(hybrid)
        if turn is None:
            return None
        modes, guards, level = turn
        # In modes the motion between two switches is a row of exponentials, and half a turn an equation for each.
        A, units = balanced(model.A)
        rates = np.abs(known_poles(A))
        if np.sum(rates == 0.0) > 1 or not np.any(rates):
            return None
        poles, vectors = _modes(A)
        given = np.linalg.solve(vectors, model.B[:, 0] / units)
        # The second of a pair, which follows the first, moves as the first one's conjugate does, but for what rounding
        # has given it: one mode takes what is given to both.
        one = poles.imag >= 0.0
        given = (given + np.where(poles.imag > 0.0, np.roll(given, -1).conj(), 0.0))[one]
        poles = poles[one]
        vectors = units[:, None] * vectors[:, one]
        rows = guards[: guards.size // 2]
        factor = model.guard_z[rows, 0]
        ends = np.stack([factor, model.guard_0[rows]], axis=1)
        rates = rates[rates > 0.0]
        return cls(hybrid, rates, poles, given, model.C[0] @ vectors, vectors, level, modes, guards, ends)

    @property
    def reach(self) -> tuple[float, float]:
        """Shortest and longest half period that is searched [s]."""
        return float(_SHORTEST / self.rates.max()), float(_LONGEST / self.rates.min())

    def guesses(self) -> Iterator[Guess]:
        """A start for each symmetric cycle, as far as the grid tells them apart."""
        for w, h in self._roots():
            if self._is_motion(w, h):
                guess = self._guess(w, h)
                if guess is not None:
                    yield guess

    def _states(self, w: Array, h: Array) -> tuple[Modes, Modes]:
        """Modes at the beginning of a pulse and at its end, shape (k, ...)."""
        (pulse, in_pulse), (_, behind), (half, in_half) = (self._driven(t) for t in (w, h - w, h))
        begin = (behind - in_half) / (2.0 + half)
        return begin, (1.0 + pulse) * begin + in_pulse

    def _driven(self, t: Array) -> tuple[Modes, Modes]:
        """By how much modes grow in a time, ``exp(s t) - 1``, and what the relay at its level adds, shape (k, ...)."""
        poles, force = (a.reshape(-1, *[1] * t.ndim) for a in (self.poles, self.level * self.given))
        still, grown = poles == 0, _grown(poles, t)
        # What poles side by side are given is large and nearly cancels: only the last product has it.
        return grown, force * np.where(still, t, grown * (1.0 / np.where(still, 1.0, poles)))

    def _off(self, w: Array, h: Array) -> Array:
        """Values of the guards at the end of each part of a half, shape (parts, ...)."""
        begin, end = self._states(w, h)
        at = [-begin] if len(self.ends) == 1 else [end, -begin]
        return np.stack([f * self._seen(x) + c for x, (f, c) in zip(at, self.ends, strict=True)])

    def _seen(self, x: Modes) -> Array:
        """The relay's input, of modes (k, ...)."""
        if np.isrealobj(x):
            return np.asarray(np.tensordot(self.seen, x, 1))
        return np.asarray(np.tensordot(self.seen.real, x.real, 1) - np.tensordot(self.seen.imag, x.imag, 1))

    def _nodes(self) -> Array:
        low, high = self.reach
        fastest = float(np.abs(self.poles.imag).max())
        nodes: list[Array] = [np.geomspace(low, high, _LOGARITHMIC)]
        if fastest > 0:
            nodes.append(low + np.arange(1.0, _EVEN) * (np.pi / fastest / _TO_A_TURN))
        return np.unique(np.concatenate(nodes).clip(low, high))

    def _roots(self) -> list[tuple[float, float]]:
        h = self._nodes()
        with np.errstate(all="ignore"):
            if len(self.ends) == 1:
                y = self._off(h, h)[0]
                size = np.abs(self.ends[0, 1]) + np.nanmedian(np.abs(y))
                found = roots_at_once(lambda t: self._off(t, t)[0], h, y, accept=1e-6 * size)
                return [(t, t) for t in found.tolist()]
            w = h[:, None] * (np.arange(1, _PULSES) / _PULSES) ** 2
            rows = (slice(i, i + _BLOCK) for i in range(0, h.size, _BLOCK))  # so few stay in the processor's cache
            off = np.concatenate([self._off(w[i], h[i, None]) for i in rows], axis=1)
            corners = np.stack([off[:, i : i - 1 or None, j : j - 1 or None] > 0 for i in (0, 1) for j in (0, 1)])
            cells = np.argwhere(np.all(np.any(corners, axis=0) & ~np.all(corners, axis=0), axis=0))
            return self._polished(w[tuple(cells.T)], h[cells[:, 0]])

    def _polished(self, w: Array, h: Array) -> list[tuple[float, float]]:
        """Newton's method from all cells at once; each root once."""
        if not w.size:
            return []
        at = np.stack([w, h])
        # The point, and beside it to both sides in either time.
        beside = _STEP * np.array([[0.0, 1.0, -1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0, -1.0]])
        for _ in range(_ITERATIONS):
            off = self._off(*(at[:, None] + beside[..., None] * at[1]))
            J = ((off[:, 1::2] - off[:, 2::2]) / (2.0 * _STEP * at[1])).transpose(2, 0, 1)
            J[~np.all(np.isfinite(J), axis=(1, 2)) | (np.abs(np.linalg.det(J)) <= 0.0)] = np.eye(2)
            move = np.linalg.solve(J, off[:, 0].T[..., None])[..., 0].T
            at = at - np.clip(move, -0.05 * at[1], 0.05 * at[1])
        size = np.abs(self.ends[:, 1]).max()
        inside = np.all(np.abs(self._off(*at)) < _ROOT * size, axis=0) & (at[0] > 0) & (at[0] < at[1])
        found: list[tuple[float, float]] = []
        for w_root, h_root in at.T[inside].tolist():
            if all(abs(h_root / b - 1.0) + abs(w_root / a - 1.0) > _SAME for a, b in found):
                found.append((w_root, h_root))
        return found

    def _is_motion(self, w: float, h: float) -> bool:
        """Whether no other switch comes before those that end the parts of a half."""
        begin, end = self._states(np.array(w), np.array(h))
        begin, end, share = begin[:, None], end[:, None], np.linspace(0.0, 1.0, _SAMPLES)[1:-1]
        grown, added = self._driven(share * w)
        parts = [(1.0 + grown) * begin + added]
        parts += [(1.0 + self._driven(share * (h - w))[0]) * end] if len(self.ends) > 1 else []
        model = self.hybrid.model
        for mode, x in zip(self.modes, parts, strict=False):
            z = self._seen(x)
            for g in range(*model.guard_first[mode : mode + 2]):
                value = model.guard_z[g, 0] * z + model.guard_0[g]
                if np.any(value > _BEYOND * (np.abs(z).max() + abs(model.guard_0[g]))):
                    return False
        return True

    def _guess(self, w: float, h: float) -> Guess | None:
        begin, end = ((self.vectors @ x).real for x in self._states(np.array(w), np.array(h)))
        parts = [begin] if len(self.ends) == 1 else [begin, end]
        states = [side * x for side in (1.0, -1.0) for x in parts]
        starts = np.array([np.concatenate([x, self.hybrid.H0]) for x in states])
        tau = np.tile([h] if len(self.ends) == 1 else [w, h - w], 2)
        return make_guess(self.hybrid, self.modes[:, None], self.guards, starts, tau)


def _grown(poles: Modes, t: Array) -> Modes:
    """``exp(s t) - 1`` to rounding, also where it is small; numpy takes several times as long for complex numbers."""
    grown = np.expm1(poles.real * t)
    if np.isrealobj(poles):
        return np.asarray(grown)
    half = 0.5 * poles.imag * t
    sine = np.sin(half)
    size = 2.0 * (1.0 + grown) * sine
    return np.asarray(grown - size * sine + 1j * (size * np.cos(half)))


def _modes(A: Array) -> tuple[Modes, Modes]:
    """Poles and modes of a matrix, or of one beside it where modes of a multiple pole are nearly one (Davies 2007).

    The motions of that one are the same but for as little, and its modes are well apart. The pole of an integrator is
    exactly zero.
    """
    apart, Q, k = integrators_apart(A)
    values, vectors = np.linalg.eig(apart)
    if np.linalg.cond(vectors) * np.finfo(float).eps > _BESIDE:
        apart[:k, :k] += _BESIDE * np.linalg.norm(A) * np.random.default_rng(0).normal(size=(k, k))
        values, vectors = np.linalg.eig(apart)
    return values, Q @ vectors


def _turn(hybrid: HybridSystem) -> tuple[IntArray, IntArray, float] | None:
    """Modes and guards of a whole turn from the mode of the largest output on, and that output; None for no relay."""
    model, columns = hybrid.model, hybrid.automata[0].mode_columns
    value, sticks = columns["constant"][:, 0], columns["sticking"]
    own = ~np.repeat(sticks, np.diff(model.guard_first))  # guards of modes that do not slide
    constant = not (columns["from_input"].any() or columns["from_memory"].any())
    if not constant or model.guard_rate.any() or model.guard_w[own].any():
        return None
    level = float(value[~sticks].max(initial=0.0))
    mode = int(np.argmax(np.where(sticks, -np.inf, value)))
    modes, guards = [mode], []
    for _ in range(4):
        downward = value[modes[-1]] > 0 or (value[modes[-1]] == 0 and len(modes) == 2)
        ways = [
            g
            for g in range(*model.guard_first[modes[-1] : modes[-1] + 2])
            if (value[model.guard_target[g]] < value[modes[-1]]) == downward and not sticks[model.guard_target[g]]
        ]
        if len(ways) != 1:
            return None
        guards.append(ways[0])
        if model.guard_target[ways[0]] == mode:
            turn = np.array(modes), np.array(guards)
            return (*turn, level) if len(modes) in (2, 4) and _is_odd(hybrid, value[modes], *turn) else None
        modes.append(int(model.guard_target[ways[0]]))
    return None


def _is_odd(hybrid: HybridSystem, value: Array, modes: IntArray, guards: IntArray) -> bool:
    """Whether the second half of a turn is the image of the first."""
    model, half = hybrid.model, modes.size // 2
    factor, constant = model.guard_z[guards, 0], model.guard_0[guards]
    same = np.array_equal(value[:half], -value[half:]) and np.array_equal(factor[:half], -factor[half:])
    return bool(value[0] > 0 and same and np.array_equal(constant[:half], constant[half:]))
