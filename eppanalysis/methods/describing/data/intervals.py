"""Intervals of predictions from noisy data: which amplitudes and frequencies the data do not refuse.

The residual of the balance at the true cycle is what the errors of the responses make of it there, whose size is
known. So a motion is refused where its residual is larger than errors make it, and an interval is what is not: near a
fold, where a small error moves a cycle far or takes it away, it is no longer even, and reaches across the fold
(docs/theory/measured.md, The interval of a prediction).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eppanalysis.arrays import Array, ComplexArray
from eppanalysis.methods.describing.balance import Balance, scales
from eppanalysis.models.systems.measured.loop import DataSystem

#: Deviates of 95 % for one unknown and for two.
_ONE, _TWO = 1.959963984540054, 2.447746830680816
#: Steps at most, their last and their longest one, in logarithms and phases.
_STEPS, _LAST, _LONGEST = 40, 1e-8, 0.3
#: Share of the deviation that a step must take off it, the damping that makes a step short, and that which ends them.
_FALLS, _SHORT, _MOST_DAMPED = 3e-4, 1e-3, 1e8
#: Steps to the balance of the means, which is exact, at most, and the share of its terms that they may leave: a
#: ten-thousandth can move the other rows by a deviation.
_MEANS, _EXACT = 8, 1e-8
#: How near to its deviate an end is found, trials for it, the first step at most, the factor by which one that falls
#: short grows, and the logarithm from which on there is no end.
_NEAR, _TRIALS, _FIRST, _GROWS, _NO_END = 1e-2, 60, 0.05, 1.5, 2.0

#: Deviations up to which a motion is one of the balance, and the distance of two that are one.
IS_ONE, _SAME = 1e-3, 1e-2


@dataclass(frozen=True, eq=False)
class Interval:
    """What the data leave of a motion."""

    #: amplitude, omega: of the first element's input; [rad/s]. Zero or infinite where there is no end.
    amplitude: tuple[float, float]
    omega: tuple[float, float]
    #: Whether a fold lies within: then errors of the size of the noise make the motion and another one, or unmake both.
    at_a_fold: bool

    @property
    def in_hertz(self) -> dict[str, tuple[float, float]]:
        """By name, the frequency in Hz."""
        slow, fast = self.omega
        return {"amplitude": self.amplitude, "frequency": (slow / (2.0 * np.pi), fast / (2.0 * np.pi))}


@dataclass(frozen=True, eq=False)
class Noise:
    """A balance and the deviation of the responses that it is made of."""

    balance: Balance
    system: DataSystem

    @classmethod
    def of(cls, system: DataSystem, balance: Balance) -> Noise | None:
        """Where all responses have a standard deviation; None otherwise."""
        known = all(r.deviation is not None for _, _, r in system.data.known)
        return cls(balance, system) if known else None

    def interval(self, X: Array, at_a_fold: bool = False) -> Interval:
        """Around a motion (3 m + 1,) that the data do not refuse; at a fold if that is known, or found."""
        balance = self.balance
        place = np.repeat([balance.places[0], 1], 2)
        side = np.array([-1.0, 1.0, -1.0, 1.0])
        if not at_a_fold:
            ends, at_a_fold = self._ends(X, place, side, _ONE)
        if at_a_fold:
            # Beyond a fold nothing makes up for an error: both of its parts count (docs/theory/measured.md).
            ends, _ = self._ends(X, place, side, _TWO)
        with np.errstate(over="ignore"):
            a, omega = (np.exp(X[i]) * np.exp(side[j] * ends[j]) for i, j in ((place[0], [0, 1]), (1, [2, 3])))
        return Interval((float(a[0]), float(a[1])), (float(omega[0]), float(omega[1])), at_a_fold)

    def missed(self, places: Sequence[Array]) -> list[tuple[Interval, float]]:
        """What the data leave of motions near given places that the balance has not, and how far off these are."""
        if not places:
            return []
        X, off = self.least_refused(places)
        kept: list[int] = []
        for i in np.flatnonzero((off > IS_ONE) & (off <= _TWO)):
            if all(np.abs(X[i, :2] - X[k, :2]).max() > _SAME for k in kept):
                kept.append(int(i))
        return [(self.interval(X[i], at_a_fold=True), float(off[i])) for i in kept]

    def least_refused(self, places: Sequence[Array]) -> tuple[Array, Array]:
        """Motions near given places that the data refuse least, and by how many deviations."""
        X = np.array(places)
        X[:, -1] = 0.0
        return self._least(X, np.full(len(X), -1))[:2]

    def _ends(self, X: Array, place: NDArray[np.intp], side: Array, most: float) -> tuple[Array, bool]:
        """How far an unknown goes to either side until a motion with it is refused, and whether a fold is passed."""
        n = len(place)
        inner, outer = np.zeros(n), np.full(n, np.inf)
        start = np.repeat(X[None], n, 0)
        _, off, turn = self._least(start[:1], np.array([-1]))
        at_inner, at_outer, first = np.full(n, off[0]), np.full(n, np.inf), turn[0]
        step, turned, done = np.minimum(most * self._linear(X, place), _FIRST), np.zeros(n, bool), np.zeros(n, bool)
        for _ in range(_TRIALS):
            k = np.flatnonzero(~done)
            if not k.size:
                break
            # The deviation of what is refused grows in proportion, where the balance does not bend.
            share = np.clip((most - at_inner[k]) / (at_outer[k] - at_inner[k]), 0.1, 0.9)
            s = inner[k] + np.where(np.isfinite(outer[k]), share * (np.nan_to_num(outer[k]) - inner[k]), step[k])
            trial = start[k].copy()
            trial[np.arange(k.size), place[k]] = X[place[k]] + side[k] * s
            trial, off, turn = self._least(trial, place[k])
            within = off <= most
            turned[k] |= within & (turn != first)
            i, o = k[within], k[~within]
            inner[i], at_inner[i], start[i] = s[within], off[within], trial[within]
            outer[o], at_outer[o] = s[~within], off[~within]
            step[i] *= _GROWS
            near = np.abs(off - most) < _NEAR
            inner[k[near]] = (s * most / off)[near]
            inner[k[s > _NO_END]] = np.inf
            done[k] = near | (s > _NO_END) | (outer[k] - inner[k] < _NEAR * inner[k])
        return inner, bool(turned.any())

    def _linear(self, X: Array, place: NDArray[np.intp]) -> Array:
        """Deviations of unknowns, were the balance straight."""
        _, J, *_ = self._whitened(X[None].copy())
        if not np.all(np.isfinite(J)):
            return np.full(len(place), _FIRST)
        moved = np.linalg.pinv(J[0])[:, : 2 * self.balance.m]
        return np.asarray(np.maximum(np.linalg.norm(moved[place], axis=1), 1e-12))

    def _least(self, X: Array, held: NDArray[np.intp]) -> tuple[Array, Array, Array]:
        """Motions with one unknown held (none at -1) whose residual has the least deviation; that; the side of a fold.

        The side is the sign of the determinant of the balance, which changes where two motions meet. Levenberg's and
        Marquardt's method: where a describing function has a corner, a full step may lead away.
        """
        X, free = X.copy(), np.arange(2 * self.balance.m) != held[:, None]
        r, J, turn, follow = self._whitened(X)
        off = self._off(r)
        damping, todo = np.full(len(X), 1e-6), np.flatnonzero(np.isfinite(off))
        for _ in range(_STEPS):
            if not todo.size:
                break
            slope = J[todo] * free[todo][:, None, :]
            slope = np.concatenate([slope, np.sqrt(damping[todo])[:, None, None] * np.eye(slope.shape[-1])], 1)
            right = np.concatenate([r[todo], np.zeros_like(r[todo])], 1)
            step = (np.linalg.pinv(slope) @ right[..., None])[..., 0]
            left = np.linalg.norm(((slope @ step[..., None])[..., 0] - right)[:, : r.shape[1]], axis=1)
            still = (off[todo] - left > _FALLS * np.maximum(off[todo], _LAST)) | (damping[todo] > _SHORT)
            if not still.all():
                # What no step takes off is left as it is: its evaluation would cost as much as the others.
                todo, step = todo[still], step[still]
                if not todo.size:
                    break
            longest = np.abs(step).max(1)
            there = X[todo]
            step = step * np.minimum(1.0, _LONGEST / np.maximum(longest, 1e-300))[:, None]
            there[:, :-1] -= np.concatenate([step, (follow[todo] @ step[..., None])[..., 0]], 1)
            r_new, J_new, turn_new, follow_new = self._whitened(there)
            new = self._off(r_new)
            ends = longest < _LAST
            better = (new < off[todo]) | (ends & np.isfinite(new))
            k = todo[better]
            falls = off[k] - new[better]
            X[k], r[k], J[k], follow[k] = there[better], r_new[better], J_new[better], follow_new[better]
            turn[k], off[k] = turn_new[better], new[better]
            damping[todo] *= np.where(better, 0.1, 10.0)
            damping[k] = np.maximum(damping[k], 1e-12)
            ends[better] |= (falls < _FALLS * off[k]) & (damping[k] < _SHORT)
            ends |= damping[todo] > _MOST_DAMPED
            todo = todo[~ends]
        return X, off, turn

    def _off(self, r: Array) -> Array:
        """Deviations by which a residual is off; infinite where it is none."""
        return np.nan_to_num(np.linalg.norm(r, axis=1), nan=np.inf)

    def _whitened(self, X: Array) -> tuple[Array, Array, Array, Array]:
        """Residual in deviations (n, 2 m), its Jacobian (n, 2 m, 2 m), the sign of the determinant of the balance.

        By amplitudes, phases and omega; means follow them (the last answer, (n, m, 2 m)), so that their balance, which
        is exact, holds; they are put right in X.
        """
        balance, m = self.balance, self.balance.m
        with np.errstate(all="ignore"):
            R, J, back = self._with_means(X)
            a, phase, b, omega = balance.unpack(X)
            root = self._root(a, phase, b, omega)
            turn = np.linalg.slogdet(np.nan_to_num(J[:, :, :-1]))[0]
            follow = -back @ J[:, 2 * m :, : 2 * m]
            by = J[:, : 2 * m, : 2 * m] + J[:, : 2 * m, 2 * m : 3 * m] @ follow
            r = (root @ (R[:, :m] + 1j * R[:, m : 2 * m])[..., None])[..., 0]
            slope = root @ (by[:, :m] + 1j * by[:, m:])
        return np.concatenate([r.real, r.imag], 1), np.concatenate([slope.real, slope.imag], 1), turn, follow

    def _with_means(self, X: Array) -> tuple[Array, Array, Array]:
        """Residual and Jacobian with the means in balance, by Newton's method, and the inverse of the means' own part.

        Not a number where they do not come to it.
        """
        balance, m = self.balance, self.balance.m
        there = balance.slopes(X)
        L, dL = balance.linear_and_slope(there.omega)  # which steps of the means leave as they are
        R, J = balance.assemble(X, there, L, dL)
        back, todo = np.zeros((len(X), m, m)), np.arange(len(X))
        for k in range(_MEANS):
            means, size = J[todo, 2 * m :, :-1], scales(balance, X[todo])[:, :-1]
            terms = np.maximum(np.abs(means * size[:, None]).max(-1), 1e-300)[..., None]
            own = np.nan_to_num(means[..., 2 * m :] * size[:, None, 2 * m :] / terms)
            back[todo] = np.linalg.pinv(own) * size[:, 2 * m :, None] / np.swapaxes(terms, 1, 2)
            off = ~(np.abs(R[todo, 2 * m :, None] / terms).max((1, 2)) <= _EXACT)
            todo, size = todo[off], size[off, 2 * m :]
            if not todo.size or k == _MEANS - 1:
                break
            step = (back[todo] @ R[todo, 2 * m :, None])[..., 0]
            longest = np.nan_to_num(np.abs(step / size).max(-1, keepdims=True))
            X[todo, 2 * m : 3 * m] -= step * np.minimum(1.0, _LONGEST / np.maximum(longest, 1e-300))
            R[todo], J[todo] = balance.assemble(X[todo], balance.slopes(X[todo]), L[todo], dL[todo])
        R[todo] = np.nan
        return R, J, back

    def _root(self, a: Array, phase: Array, b: Array, omega: Array) -> ComplexArray:
        """Inverse root of the covariance of the residuals, shape (n, m, m)."""
        balance, paths = self.balance, self.system.data.known
        Z = a * np.exp(1j * phase)
        _, gain = balance.evaluate(a, b, omega)
        outputs = (gain * Z[:, balance.owner])[:, None, None, :]
        by_path = (self.system.by_path(omega)[:, :, balance.rows] * outputs).sum(-1) / Z[:, None, :]
        weighed = by_path * np.stack([r.curve.deviation_at(omega) for _, _, r in paths], -1)[..., None]
        covariance = np.swapaxes(weighed, 1, 2) @ weighed.conj()
        values, vectors = np.linalg.eigh(np.nan_to_num(covariance))
        least = 1e-12 * values.max(-1, keepdims=True)
        inverse = 1.0 / np.sqrt(np.maximum(values, np.maximum(least, 1e-300)))
        return np.asarray(inverse[..., None] * np.swapaxes(vectors.conj(), 1, 2), complex)
