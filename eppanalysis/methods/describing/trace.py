"""Pseudo-arclength continuation of solution curves of the harmonic balance, many ends at once."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eppanalysis.arrays import Array, BoolArray
from eppanalysis.methods.describing.balance import ON_THE_WAY, Balance, newton_and_jacobian, scales, solved

_FIRST, _LARGEST, _SMALLEST = 0.08, 0.3, 1e-4
#: Steps away from the start of a curve before it may have come back to it.
_BESIDE = 10


@dataclass(frozen=True)
class Box:
    """Region of a trace: ln a of the pivot, ln omega, and the largest ``|ln lambda|``."""

    amplitude: tuple[float, float]
    omega: tuple[float, float]
    gain: float

    def holds(self, X: Array) -> BoolArray:
        """Which points lie inside."""
        low, high = zip(self.amplitude, self.omega, (-self.gain, self.gain), strict=True)
        place = X[:, (0, 1, -1)]
        inside: BoolArray = np.all((place >= low) & (place <= high), axis=-1)
        return inside


def trace(balance: Balance, start: Array, outward: Array, box: Box, steps: int = 1000) -> list[Array]:
    """Follow curves outward from their ends.

    Parameters
    ----------
    start, outward : array, shape (k, 3 m + 1)
        An end of each curve, and the direction in which to leave it.
    box : Box
        Where to stop; a curve that is closed ends where it began.
    steps : int, optional
        Most steps, accepted or not.

    Returns
    -------
    list of array
        New points of each curve, outward.
    """
    k = len(start)
    paths: list[list[Array]] = [[] for _ in range(k)]
    X = start.copy()
    size = scales(balance, X)
    heading = outward / size
    heading /= np.maximum(np.linalg.norm(heading, axis=-1, keepdims=True), 1e-300)
    heading, alive = tangents(balance.residual(X)[1], size, heading)
    h = np.full(k, _FIRST)
    for _ in range(steps):
        todo = np.flatnonzero(alive)
        if not todo.size:
            break
        here, ahead, step = size[todo], heading[todo], h[todo]
        guess = X[todo] + step[:, None] * here * ahead
        new, ok, J = newton_and_jacobian(balance, guess, ahead / here, 6, ON_THE_WAY)
        # Accepted where the curve has turned little and Newton has stayed near the tangent: farther off it may have
        # changed over to another curve.
        there = scales(balance, new)
        turned, regular = tangents(J, there, ahead)
        # A kink, where an element enters another regime, turns the curve at once: only small steps may pass it.
        least = np.where(step > 5 * _SMALLEST, 0.85, -0.3)
        ok &= regular & ((turned * ahead).sum(-1) > least)
        ok &= (np.abs(new - guess) / here).max(-1) < 2.0 * step
        good = todo[ok]
        X[good], heading[good], size[good] = new[ok], turned[ok], there[ok]
        # Back at the start and on the same way, behind more than the steps that lie beside it.
        off = (X - start) / size
        back = (np.abs(off).max(-1) < h) & ((off * heading).sum(-1) > 0.0) & (np.array([*map(len, paths)]) > _BESIDE)
        for i, x in zip(good, new[ok], strict=True):
            paths[i].append(x)
        h[todo] = np.where(ok, np.minimum(1.4 * step, _LARGEST), step / 2.5)
        alive[todo] = np.where(ok, box.holds(new) & ~back[todo], h[todo] > _SMALLEST)
    return [np.array(path).reshape(-1, start.shape[1]) for path in paths]


def tangents(J: Array, size: Array, heading: Array) -> tuple[Array, NDArray]:
    """Unit tangents in unknowns scaled by `size` at points with the Jacobian J, on the side of `heading`."""
    with np.errstate(all="ignore"):
        tangent, ok = solved(J, np.zeros(J.shape[:2]), heading / size, 1.0)
        tangent /= size
    length = np.linalg.norm(tangent, axis=-1, keepdims=True)
    return np.where(length > 0, tangent / np.maximum(length, 1e-300), heading), ok
