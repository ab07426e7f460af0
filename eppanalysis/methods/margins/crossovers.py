"""Where a frequency response meets the unit circle and the negative real axis, and how near it comes to -1.

Without dead time all such frequencies are known beforehand, as eigenvalues of matrices made of the loop and its mirror
image; with it they are sought on a grid that is refined until neighbours are close on the Riemann sphere and in phase.
Either way each is a root of the exact response, found between two nodes on different sides of it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import scipy.linalg

from eppanalysis.arrays import Array, BoolArray, ComplexArray
from eppanalysis.methods.margins.linearised import Linear, closed_size
from eppanalysis.models.systems.linear import zeros
from eppanalysis.roots import between

_PER_DECADE = 40
#: Neighbours on the grid are closer than this, as chords of the Riemann sphere and in phase [rad].
_CHORD, _PHASE = 0.08, 0.4
#: Two nodes as close as this, relative to their frequency, are not parted any more: a pole is between them.
_CLOSEST = 1e-11
_MOST_NODES = 400_000
#: Sign changes of the phase that are followed to their roots.
_MOST_ROOTS = 40
#: Dips of the distance from -1 of which the bottom is sought; and by what share a node must lie lower to be below it.
_MOST_MINIMA, _ROUNDED = 12, 1e-9
#: Sine of the phase below which a response is real all along, not crossing the axis.
_REAL = 1e-11
#: How far from one, as a factor, a gain margin may lie for the grid to end there; further out the loop gain is less.
_FAR_GAIN = 1e-2
#: A closed loop that lets less than this through at rest has no bandwidth.
_PASSES = 1e-6
_INF, _NAN = float("inf"), float("nan")


class LoopGain(Protocol):
    """What a response is taken of."""

    def response(self, omega: Array) -> ComplexArray:
        """At frequencies (m,) [rad/s]; nan where it has no value."""

    def slope(self, omega: Array) -> ComplexArray:
        """Derivative of the response by the frequency."""

    def slow_end(self, lowest: float) -> tuple[float, float] | None:
        """Frequency zero and the response there, below the lowest frequency of a grid; None where that is no number."""

    def fast_end(self) -> tuple[float, float] | None:
        """The highest frequency there is and the response there."""

    def closed_at_rest(self, lowest: float) -> float:
        """Size of L/(1 + L) at frequency zero."""


@dataclass(frozen=True, eq=False)
class Response:
    """A loop gain on a grid that shows all that it does."""

    loop: LoopGain
    omega: Array  # (m,): ascending [rad/s]
    value: ComplexArray  # (m,)
    complete: bool  # whether the grid could be made as fine as it ought to be

    @classmethod
    def of(cls, loop: Linear, rates: ComplexArray) -> Response:
        """On a grid round the poles and zeros `rates` [rad/s] of the loop, cut open and closed."""
        # Behind a dead time the phase turns for ever: it is followed only while the loop gain is not small.
        follow = 0.0 if loop.rational or loop.time_step else _FAR_GAIN
        return cls.refined(loop, _nodes(loop, np.concatenate([rates, 1j * _candidates(loop)])), follow)

    @classmethod
    def refined(cls, loop: LoopGain, nodes: Array, follow: float = 0.0) -> Response:
        """On nodes, ascending [rad/s], and as many between as it takes; the phase is followed above a gain `follow`."""
        with np.errstate(all="ignore"):
            value = loop.response(nodes)
            while (finer := _between(nodes, value, follow)).size and nodes.size < _MOST_NODES:
                nodes = np.concatenate([nodes, finer])
                order = np.argsort(nodes)
                nodes, value = nodes[order], np.concatenate([value, loop.response(finer)])[order]
        there = np.isfinite(value)
        return cls(loop, nodes[there], value[there], nodes.size < _MOST_NODES)

    def gain_crossovers(self) -> Array:
        """Frequencies at which the loop gain is of size one."""
        return self._roots(lambda L: np.log(np.abs(L)), np.log(np.abs(self.value)))

    def phase_crossovers(self) -> tuple[Array, Array]:
        """Frequencies at which the loop gain is negative, and its values there; at the ends of the axis too.

        Dead time makes many: those of sizes nearest to one.
        """
        sine = self.value.imag / np.abs(self.value)
        shown = (np.abs(sine) > _REAL) & (self.value != 0.0)
        roots = self._roots(lambda L: L.imag / np.abs(L), sine, shown, nearest=True)
        value = self.loop.response(roots) if roots.size else np.zeros(0, complex)
        with np.errstate(all="ignore"):
            # The sine changes its sign across a pole on the axis and
            # where the response is positive, too: no crossovers.
            crosses = np.isfinite(value) & (value.real < 0.0) & (np.abs(value.imag) < 1e-6 * np.abs(value))
        ends = [end for end in self._ends if end[1] < 0.0]
        omega = np.append(roots[crosses], [end[0] for end in ends])
        return omega, np.append(value.real[crosses], [end[1] for end in ends])

    def bandwidth(self) -> float:
        """Where the closed loop L/(1 + L) first falls 3 dB below rest; nan where it passes nothing at rest."""
        level = self.loop.closed_at_rest(self.omega[0]) / np.sqrt(2.0)
        if not level > _PASSES:
            return float("nan")
        below = np.flatnonzero(closed_size(self.value) < level)
        if not below.size or below[0] == 0:
            return float("inf") if not below.size else float("nan")

        i = below[:1]
        return float(
            _crossing(lambda w: np.log(closed_size(self.loop.response(w)) / level), self.omega[i - 1], self.omega[i])[0]
        )

    def nearest_to_minus_one(self) -> tuple[float, float]:
        """Least ``2 |1 + L|/|1 - L|`` over all frequencies, and the frequency of it."""
        with np.errstate(all="ignore"):
            size, slope = _disk(self.value), self._disk_slope(self.omega)
        size = np.where(np.isnan(size), np.inf, size)
        # The grid shows every dip, as neighbours on it are joined by a straight line: only its bottom is sought.
        dips = np.flatnonzero((slope[:-1] < 0.0) & (slope[1:] >= 0.0))
        dips = dips[np.argsort(np.minimum(size[dips], size[dips + 1]), kind="stable")[:_MOST_MINIMA]]
        with np.errstate(all="ignore"):
            found = between(lambda w, _: self._disk_slope(w), self.omega[dips], self.omega[dips + 1])
        value = _disk(self.loop.response(found)) if found.size else found
        best = min(zip(value.tolist(), found.tolist(), strict=True), default=(_INF, _NAN))
        lowest = int(np.argmin(size))
        if size[lowest] < best[0] * (1.0 - _ROUNDED):  # at the end of the grid
            best = float(size[lowest]), float(self.omega[lowest])
        return min([best, *((float(_disk(np.array([value + 0j]))[0]), omega) for omega, value in self._ends)])

    @property
    def _ends(self) -> list[tuple[float, float]]:
        """The ends of the axis and the loop gain there, where that is a number."""
        return [end for end in (self.loop.slow_end(self.omega[0]), self.loop.fast_end()) if end is not None]

    def _roots(
        self,
        sign: Callable[[ComplexArray], Array],
        at_nodes: Array,
        shown: BoolArray | None = None,
        nearest: bool = False,
    ) -> Array:
        """Frequencies between neighbouring nodes on different sides of zero, to rounding."""
        used = np.isfinite(at_nodes) & (at_nodes != 0.0 if shown is None else shown)
        omega, values = self.omega[used], at_nodes[used]
        changes = np.flatnonzero(np.signbit(values[:-1]) != np.signbit(values[1:]))
        if nearest:
            # A dead time makes crossovers without end; those of a gain near one decide the margins.
            negative = (self.value[used].real[changes] < 0.0) | (self.value[used].real[changes + 1] < 0.0)
            changes = changes[negative]
            size = np.abs(np.log(np.abs(self.value[used])))
            far = np.minimum(size[changes], size[changes + 1])
            changes = changes[np.argsort(far, kind="stable")[:_MOST_ROOTS]]
        return _crossing(lambda w: sign(self.loop.response(w)), omega[changes], omega[changes + 1])

    def _disk_slope(self, omega: Array) -> Array:
        """Derivative of the logarithm of the distance from -1 by the frequency, but for a positive factor."""
        L = self.loop.response(omega)
        return np.asarray((self.loop.slope(omega) / ((1.0 + L) * (1.0 - L))).real, float)


def _crossing(function: Callable[[Array], Array], low: Array, high: Array) -> Array:
    """Roots between two frequencies; one of them where it lies within rounding of it, on which side is not sure."""
    nearer = np.where(np.abs(function(low)) < np.abs(function(high)), low, high)
    roots = between(lambda w, _: function(w), low, high)
    return np.where(np.isnan(roots), nearer, roots)


def _disk(L: ComplexArray) -> Array:
    with np.errstate(all="ignore"):
        return np.asarray(2.0 * np.abs(1.0 + L) / np.abs(1.0 - L), float)


def _nodes(loop: Linear, rates: ComplexArray) -> Array:
    """Frequencies round all rates, the lightly damped ones densely; evenly spaced where dead time turns the phase."""
    size = np.abs(rates)
    size = size[size > 0]
    top = np.pi / loop.time_step if loop.time_step else np.inf
    late = [delay for delay, _, _ in loop.terms if delay]
    marks = np.concatenate([size, [1.0 / delay for delay in late], [0.1 * top] if loop.time_step else []])
    low, high = (marks.min() * 1e-3, min(marks.max() * 1e3, top)) if marks.size else (1e-3, 1e3)
    low = min(low, 1e-3 * high)
    nodes = [np.geomspace(low, high, int(_PER_DECADE * np.log10(high / low)) + 2)]
    turn, width = np.abs(rates.imag), np.maximum(np.abs(rates.real), 1e-9 * np.abs(rates))
    reach = np.concatenate([[0.0], np.geomspace(0.05, 20.0, 12)])
    nodes += [(turn[:, None] + side * width[:, None] * reach).ravel() for side in (-1.0, 1.0)]
    nodes.append((size[:, None] * (1.0 + np.array([-1e-6, 0.0, 1e-6]))).ravel())
    if late and not loop.time_step:
        nodes.append(_while_the_phase_turns(loop, nodes[0]))
    if loop.time_step:
        nodes.append(np.linspace(0.0, top, 400 + int(20 * loop.longest_delay / loop.time_step))[1:-1])
    out = np.unique(np.concatenate(nodes))
    return out[(out >= low) & (out <= high) & (out < top)]


def _while_the_phase_turns(loop: Linear, omega: Array) -> Array:
    """Evenly spaced frequencies as far as what is late is more than a trifle of the loop gain, and two turns more."""
    with np.errstate(all="ignore"):
        gain = np.abs(loop.response(omega) - loop.D[0, 0])
    turn = 2.0 * np.pi / loop.longest_delay
    above = omega[np.isfinite(gain) & (gain > _FAR_GAIN)]
    top = min(max(float(above.max(initial=0.0)), turn) + 3.0 * turn, _MOST_NODES / 4 * 0.05 * turn)
    return np.asarray(np.arange(1, int(top / (0.05 * turn)) + 1) * 0.05 * turn, float)


def _between(omega: Array, value: ComplexArray, follow: float) -> Array:
    """Frequencies in the middle of neighbours that are too far apart to be joined by a straight line.

    Phase is followed where the gain is more than `follow`: dead time turns it for ever.
    """
    with np.errstate(all="ignore"):
        a, b = value[:-1], value[1:]
        # On the Riemann sphere a way through a pole is as smooth as one through zero.
        chord = np.abs(a - b) / np.sqrt((1.0 + np.abs(a) ** 2) * (1.0 + np.abs(b) ** 2))
        phase = np.abs(np.angle(b / a))
        far = (
            ~((chord < _CHORD) & ((phase < _PHASE) | (np.minimum(np.abs(a), np.abs(b)) <= follow)))
            & np.isfinite(a)
            & np.isfinite(b)
        )
        far &= omega[1:] - omega[:-1] > _CLOSEST * omega[1:]
    return np.sqrt(omega[:-1][far] * omega[1:][far])


def _candidates(loop: Linear) -> Array:
    """Frequencies [rad/s] at which a rational loop gain is real or of size one, others among them.

    They are zeros of ``L(s) - L(-s)`` and of ``1 - L(s) L(-s)`` beside the imaginary axis; in discrete time after the
    bilinear map of the unit circle onto that axis.
    """
    if not loop.rational or not loop.n:
        return np.zeros(0)
    A, B = loop.all_at_once
    C, D = loop.C, loop.D
    if loop.time_step:
        # The bilinear map takes the unit circle to the imaginary axis, where the eigenvalues below are requested.
        shifted = A + np.eye(loop.n)
        if np.linalg.cond(shifted) > 1e12:
            return np.zeros(0)
        half = np.linalg.inv(shifted)
        A, B, C, D = half @ (A - np.eye(loop.n)), 2.0 * half @ B, C @ half, D - C @ half @ B
    with np.errstate(all="ignore"):
        found = np.concatenate([_real_values(A, B, C), _unit_sizes(A, B, C, float(D[0, 0]))])
    near = found[(found.imag > 0) & (np.abs(found.real) < 1e-3 * np.abs(found))].imag
    return np.unique(2.0 * np.arctan(near) / loop.time_step if loop.time_step else near)


def _real_values(A: Array, B: Array, C: Array) -> ComplexArray:
    return zeros(scipy.linalg.block_diag(A, -A), np.vstack([B, B]), np.hstack([C, C]), np.zeros((1, 1)))


def _unit_sizes(A: Array, B: Array, C: Array, D: float) -> ComplexArray:
    n = len(A)
    both = np.block([[A, -B @ C], [np.zeros((n, n)), -A]])
    return zeros(both, np.vstack([B * D, B]), -np.hstack([C, -D * C]), np.array([[1.0 - D * D]]))
