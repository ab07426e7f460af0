"""The DF: what sinusoidal-input describing functions say of a driven loop, all solutions of a frequency, and
branches.

Every element sees a mean and a sine and answers with a mean and a sine. Unlike for a limit cycle the phase is given, by
the input: with the inputs' phasors Z, ``Z = L(j w) N(|Z|, b) Z + L_v(j w) V`` beside the balance of the means b
(docs/theory/driven.md).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from eppanalysis.arrays import Array, ComplexArray
from eppanalysis.methods.describing.balance import describe
from eppanalysis.methods.driven.drive import Drive
from eppanalysis.models.systems.linear import solved
from eppanalysis.models.systems.means import mean_state

#: Sizes of the largest input, relative to thresholds and linear answers, from which Newton's method starts.
_STARTS = 28
#: Sizes among which a balance that is missed is looked for: a resonance is as narrow as its damping.
_SCANNED = 200
_MOST_ITERATIONS, _CONVERGED, _DIFFERENCE = 40, 1e-11, 1e-7
#: Solutions nearer to each other than this, relative to their size, are one.
_SAME = 1e-6
#: Longest and shortest step along a branch, relative to the range and the size of the motion; most of its points.
_LONGEST, _SHORTEST, _MOST_POINTS = 0.03, 1e-5, 1500


@dataclass(frozen=True, eq=False)
class Sinusoid:
    """A DF response: phasors of ``Im(P exp(j omega t))``."""

    drive: Drive
    unknowns: Array  # (3 m,): real and imaginary parts of the first inputs of the elements, and their means

    @cached_property
    def _outputs(self) -> tuple[Array, ComplexArray]:
        """Means and phasors of the elements' outputs."""
        return _Equations(self.drive).outputs(self.unknowns)

    def response(self, signal: str) -> complex:
        """Phasor of a signal over that of the input."""
        system, (_, W) = self.drive.given, self._outputs
        i, k = system.signals.names.index(signal), self.drive.column
        V = self.drive.amplitude
        through = system.signals.C[i] @ _state_response(self.drive, W) + system.signals.D[i] @ W
        return complex((through + system.signals.D_input[i, k] * V) / V)

    @property
    def start(self) -> Array:
        """State at phase zero of the input, shape (n,)."""
        system, (mean, W) = self.drive.given, self._outputs
        bias = self.unknowns[-len(system.elements) :] if system.elements else np.zeros(0)
        middle = mean_state(system, self.drive.at.vector(system), bias, mean)
        return middle + _state_response(self.drive, W).imag


def _state_response(drive: Drive, W: ComplexArray) -> ComplexArray:
    """Phasor of the state from those of the elements' outputs."""
    system = drive.given
    into = system.B @ W + system.B_input[:, drive.column] * drive.amplitude
    return solved(system.characteristic_matrix(1j * drive.omega), into[:, None] + 0j)[:, 0]


class _Equations:
    """DF balance under one drive; unknowns as in :class:`Sinusoid`."""

    def __init__(self, drive: Drive) -> None:
        system, balance = drive.given, drive.balance
        assert balance is not None  # refused by what is public here
        self.drive, self.balance = drive, balance
        self.m, self.owner = self.balance.m, self.balance.owner
        rows, k = self.balance.rows, drive.column
        self.L = self.balance.linear(np.array([drive.omega]))[0]
        state = _state_response(drive, np.zeros(system.B.shape[1], complex))
        self.driven = system.C[rows] @ state + system.D_input[rows, k] * drive.amplitude

    def outputs(self, q: Array) -> tuple[Array, ComplexArray]:
        """Means and phasors of the outputs, shapes (..., nw), at unknowns (..., 3 m)."""
        Z, b = self._parts(q)
        mean, gain = self.gains(np.abs(Z), b)
        return mean, gain * Z[..., self.owner]

    def _parts(self, q: Array) -> tuple[ComplexArray, Array]:
        m = self.m
        return q[..., :m] + 1j * q[..., m : 2 * m], q[..., 2 * m :]

    def gains(self, a: Array, b: Array) -> tuple[Array, ComplexArray]:
        """Means and gains, shapes (..., nw), at amplitudes and biases (..., m)."""
        a, omega = np.maximum(a, 1e-12), np.full(a.shape[:-1], self.drive.omega)
        found = [describe(e, a[..., i], b[..., i], omega) for i, e in enumerate(self.drive.given.elements)]
        return np.concatenate([m for m, _ in found], -1), np.concatenate([g for _, g in found], -1)

    def residual(self, q: Array) -> Array:
        """What is left of the balance, shape (..., 3 m)."""
        (Z, b), (mean, W) = self._parts(q), self.outputs(q)
        left, s = Z - W @ self.L.T - self.driven, self.balance.static
        static = b @ s.on_bias.T + mean @ s.on_mean.T - s.prescribed
        return np.concatenate([left.real, left.imag, static], -1)

    def jacobian(self, q: Array, r: Array) -> Array:
        """Derivative of the residual, by differences, shape (3 m, 3 m)."""
        size = _DIFFERENCE * max(float(np.max(np.abs(q), initial=0.0)), 1e-12)
        return np.asarray((self.residual(q + size * np.eye(q.size)) - r).T / size, float)

    def starts(self) -> list[Array]:
        """Unknowns of many sizes, each with the means and phases that the balance has for elements of that size."""
        return [tried.unknowns for tried in self._tried(_STARTS)]

    def near_misses(self) -> list[Array]:
        """Unknowns of the sizes at which the balance comes nearest to one without reaching it, beside its folds."""
        tried = self._tried(_SCANNED)
        missed = np.array([one.missed for one in tried])
        # Between neighbours of one sign the balance has no solution.
        size, sign = np.abs(missed), np.sign(missed)
        least = (size[1:-1] < size[:-2]) & (size[1:-1] <= size[2:])
        least &= (sign[:-2] == sign[1:-1]) & (sign[1:-1] == sign[2:])
        return [tried[i + 1].unknowns for i in np.flatnonzero(least)]

    def _tried(self, count: int) -> list[_Tried]:
        """The balance for elements of so many sizes, about thresholds and linear answers, largest first."""
        levels = [t for e in self.drive.given.elements for t in e.thresholds() if np.isfinite(t)]
        sizes = [*levels, float(np.max(np.abs(self.driven)))]
        share = np.maximum(np.abs(self.driven) / max(float(np.max(np.abs(self.driven))), 1e-300), 1e-3)
        # Means of a large motion are determined where an element that is at its limit leaves those of a small one open:
        # each size has those of the one above it to begin with.
        found, b = [], np.nan_to_num(self.balance.operating_bias)
        for size in np.geomspace(50.0 * max(sizes), 0.02 * min(sizes), count):
            b = self._means(size * share, b)
            _, gain = self.gains(size * share, b)
            loop = np.zeros((self.m, self.m), complex)
            np.add.at(loop.T, self.owner, (self.L * gain).T)
            if not (np.all(np.isfinite(loop)) and np.all(np.isfinite(self.driven))):
                continue  # beyond all range; LAPACK would complain on the terminal
            # With given gains the balance is linear (docs/theory/driven.md, Describing functions).
            Z = np.linalg.lstsq(np.eye(self.m) - loop, self.driven, rcond=None)[0]
            found.append(_Tried(float(size), Z, b))
        return found

    def _means(self, a: Array, b: Array) -> Array:
        """Means at which the elements are in static balance while they swing by a; those given where none are found."""
        s = self.balance.static

        def both(b: Array) -> tuple[Array, Array]:
            tried = np.vstack([b, b + _DIFFERENCE * max(float(np.max(a)), 1e-12) * np.eye(b.size)])
            mean, _ = self.gains(np.broadcast_to(a, tried.shape), tried)
            r = tried @ s.on_bias.T + mean @ s.on_mean.T - s.prescribed
            return r[0], np.asarray((r[1:] - r[0]).T / (tried[1, 0] - tried[0, 0]))

        found = _newton(both, b, float(np.max(a)))
        return b if found is None else found


@dataclass(frozen=True, eq=False)
class _Tried:
    """The balance for elements that swing by a size."""

    size: float
    inputs: ComplexArray  # (m,): that the balance then has
    means: Array  # (m,)

    @property
    def missed(self) -> float:
        """Logarithm of how many times as large as tried the inputs are."""
        return float(np.log(np.max(np.abs(self.inputs), initial=1e-300) / self.size))

    @property
    def unknowns(self) -> Array:
        """Of this size, with the phases of the inputs."""
        Z = self.inputs * (self.size / max(float(np.max(np.abs(self.inputs))), 1e-300))
        return np.concatenate([Z.real, Z.imag, self.means])


def _newton(equations: Callable[[Array], tuple[Array, Array]], q: Array, least: float = 1e-300) -> Array | None:
    """Damped Newton to rounding of q, or of what counts at least as its size; None where it does not converge."""
    r, J = equations(q)
    for _ in range(_MOST_ITERATIONS):
        if not (np.all(np.isfinite(r)) and np.all(np.isfinite(J))):
            return None
        try:
            step = np.linalg.solve(J, -r)
        except np.linalg.LinAlgError:
            return None
        size = float(np.max(np.abs(q), initial=least))
        share = min(1.0, 0.7 * size / max(float(np.max(np.abs(step))), 1e-300))
        q = q + share * step
        if np.max(np.abs(step)) < _CONVERGED * size:
            return q
        r, J = equations(q)
    return None


def _both(drive: Drive) -> Callable[[Array], tuple[Array, Array]]:
    """Residual and Jacobian under one drive."""
    equations = _Equations(drive)

    def both(q: Array) -> tuple[Array, Array]:
        r = equations.residual(q)
        return r, equations.jacobian(q, r)

    return both


def sinusoids(drive: Drive) -> tuple[Sinusoid, ...]:
    """The DF responses that Newton's method finds from many sizes, smallest first.

    There are none where the balance of the means does not determine them.
    """
    found: list[Array] = []
    if drive.balance is None:
        return ()
    with np.errstate(all="ignore"):
        for start in _Equations(drive).starts():
            q = _newton(_both(drive), start)
            if q is None:
                continue
            if not any(np.max(np.abs(q - k)) < _SAME * np.max(np.abs(k)) for k in found):
                found.append(q)
    return tuple(Sinusoid(drive, q) for q in sorted(found, key=lambda q: float(np.linalg.norm(q))))


def near_misses(drive: Drive) -> tuple[Sinusoid, ...]:
    """Where the DF comes nearest to a response that it does not have, beside its folds.

    The exact folds are not quite its own: between the two an exact response may lie near.
    """
    if drive.balance is None:
        return ()
    with np.errstate(all="ignore"):
        return tuple(Sinusoid(drive, q) for q in _Equations(drive).near_misses())


def sinusoid_branches(
    family: Callable[[float], Drive], limits: tuple[float, float]
) -> list[tuple[Array, list[Sinusoid]]]:
    """DF responses along branches over the logarithm of a parameter: values (k,) and responses, through folds.

    Begun at both ends and in the middle of the range.
    """
    branches: list[tuple[Array, list[Sinusoid]]] = []
    # Branches that close on themselves between these three values are not seen.
    for value in (limits[0], limits[1], 0.5 * sum(limits)):
        for one in sinusoids(family(value)):
            if not any(_passes(branch, value, one) for branch in branches):
                branches.append(_Curve(family, limits).through(value, one.unknowns))
    return branches


def _passes(branch: tuple[Array, list[Sinusoid]], value: float, one: Sinusoid) -> bool:
    """Whether a branch comes through a response at a value, by its own points beside that."""
    values, there = branch
    for k in np.flatnonzero((values[:-1] - value) * (values[1:] - value) <= 0):
        share = (value - values[k]) / (values[k + 1] - values[k]) if values[k + 1] != values[k] else 0.0
        q = there[k].unknowns + share * (there[k + 1].unknowns - there[k].unknowns)
        if np.max(np.abs(q - one.unknowns)) < 0.02 * np.max(np.abs(one.unknowns)):
            return True
    return False


class _Curve:
    """One branch of DF responses under way; unknowns with the value of the parameter behind them."""

    def __init__(self, family: Callable[[float], Drive], limits: tuple[float, float]) -> None:
        self.family, self.limits = family, limits
        self.width = limits[1] - limits[0]

    def through(self, value: float, q: Array) -> tuple[Array, list[Sinusoid]]:
        first = np.append(q, value)
        ahead = self._along(first, 1.0) if value < self.limits[1] else [first]
        back = self._along(first, -1.0) if value > self.limits[0] else [first]
        points = back[::-1][:-1] + ahead
        return np.array([p[-1] for p in points]), [Sinusoid(self.family(float(p[-1])), p[:-1]) for p in points]

    def _along(self, first: Array, way: float) -> list[Array]:
        points, ds, direction = [first], 0.25 * _LONGEST, np.append(np.zeros(first.size - 1), way)
        while len(points) < _MOST_POINTS and ds > _SHORTEST:
            old = points[-1]
            scale = np.append(np.full(old.size - 1, max(float(np.max(np.abs(old[:-1]))), 1e-300)), self.width)
            plane = direction / scale
            plane = plane / np.linalg.norm(plane)
            new = self._corrected(old, plane, ds, scale)
            # A step that turns sharply may have come to another branch; a shorter one tells.
            if new is None or (len(points) > 1 and self._turn(points[-2], old, new, scale) < 0.9):
                ds *= 0.5
                continue
            if not self.limits[0] <= new[-1] <= self.limits[1]:
                end = self.limits[0] if new[-1] < self.limits[0] else self.limits[1]
                share = (end - old[-1]) / (new[-1] - old[-1])
                q = _newton(_both(self.family(end)), old[:-1] + share * (new - old)[:-1])
                points += [] if q is None else [np.append(q, end)]
                break
            direction = new - old
            points.append(new)
            ds = min(1.3 * ds, _LONGEST)
        return points

    def _turn(self, before: Array, old: Array, new: Array, scale: Array) -> float:
        one, other = (old - before) / scale, (new - old) / scale
        size = float(np.linalg.norm(one) * np.linalg.norm(other))
        return float(one @ other) / max(size, 1e-300)

    def _corrected(self, old: Array, plane: Array, ds: float, scale: Array) -> Array | None:
        def both(u: Array) -> tuple[Array, Array]:
            here = _Equations(self.family(float(u[-1])))
            r, shift = here.residual(u[:-1]), _DIFFERENCE * self.width
            across = (_Equations(self.family(float(u[-1] + shift))).residual(u[:-1]) - r) / shift
            J = np.vstack([np.column_stack([here.jacobian(u[:-1], r), across]), plane / scale])
            return np.append(r, plane @ ((u - old) / scale) - ds), J

        with np.errstate(all="ignore"):
            return _newton(both, old + ds * plane * scale)
