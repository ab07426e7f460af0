"""The cost of a candidate in units of the noise that residuals show, and what would explain these better.

A fit that leaves more than noise may still be the best one. The score test (Rao, 1948) says which of the parameters not
fitted its residuals indicate: their derivative by that parameter, less what the fitted ones can do, is compared.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from eppanalysis.arrays import Array
from eppanalysis.cases import Case
from eppanalysis.errors import CaseError, EppError
from eppanalysis.identify.intervals import Weighted, weighted
from eppanalysis.identify.response import Response, Unknown
from eppanalysis.models.systems.inputs import Recorded, Steps

#: Standard deviation on the fitted scale where the data identify nothing at all; least lag, in units of the case's.
WIDEST_START, _LEAST_LAG = 0.7, 0.02
#: Parameters that say how a case is run, not what it is; how far others are moved.
_LEFT_OUT, _MOVED = ("run.", "expected."), 0.02


def bounds_of(unknowns: Sequence[Unknown]) -> tuple[Array, Array]:
    """Least and greatest place of every parameter on the fitted scale."""
    low = np.array(
        [u.to_scale(u.start) - math.log(50.0) if u.logarithmic else _LEAST_LAG * (not u.vanishes) for u in unknowns]
    )
    high = np.array([u.to_scale(u.start) + math.log(50.0) if u.logarithmic else 50.0 for u in unknowns])
    for i, u in enumerate(unknowns):
        if u.name == "pulley.kinetic_ratio":
            high[i] = 1.0 / u.scale
    return low, high


@dataclass(frozen=True, eq=False)
class Whitener:
    """Cost of a candidate with the noise of every channel as the residuals of the best one show it."""

    response: Response
    noises: tuple[Weighted, ...]
    bases: tuple[Array, ...]

    def left(self, i: int, model: Array) -> Array:
        """Residual of channel `i` in units of its noise, without zero and drift."""
        channel = self.response.channels[i]
        r = self.noises[i].whiten(((model - channel.data) / channel.noise)[channel.live])
        return r - self.bases[i] @ (self.bases[i].T @ r)

    def residual(self, q: Array) -> Array:
        """All channels and what the case knows; all large where a candidate has no solution."""
        try:
            found = self.response.signals(q)
            parts = [self.left(i, found[c.role]) for i, c in enumerate(self.response.channels)]
        except (EppError, ArithmeticError, ValueError):
            parts = [np.full(int(c.live.sum()), 1e3) for c in self.response.channels]
        return np.concatenate([*parts, self.response.beliefs(q)])

    def of(self, case: Case) -> Whitener:
        """The same of another case."""
        response = copy.copy(self.response)
        response.case = case
        return replace(self, response=response)

    def cost(self, q: Array) -> float:
        """Sum of squares of the residual."""
        return float(np.sum(self.residual(q) ** 2))


def local(response: Response, q: Array) -> tuple[Whitener, Array]:
    """Noise of every channel at a place, and a covariance from derivatives there to begin with."""
    jacobians, now = _jacobians(response, q, np.full(q.size, 3e-3)), response.signals(q)
    noises, bases, normal = [], [], np.diag([0.0 if u.prior is None else u.prior**-2 for u in response.unknowns])
    for channel in response.channels:
        r = ((now[channel.role] - channel.data) / channel.noise)[channel.live]
        columns = np.column_stack([jacobians[channel.role] / channel.noise, channel.nuisance])[channel.live]
        moving = columns[:, np.linalg.norm(columns, axis=0) > 0]
        step = np.linalg.lstsq(moving, -r, rcond=1e-10)[0]
        noises.append(weighted(_independent(moving), r + moving @ step, 1e-3))
        whitened = noises[-1].whiten(columns)
        bases.append(np.linalg.qr(whitened[:, q.size :])[0])
        # Zero and drift are fitted along: what they can explain is taken out of the derivatives.
        J = whitened[:, : q.size] - bases[-1] @ (bases[-1].T @ whitened[:, : q.size])
        normal = normal + J.T @ J
    # Directions without information reach as far as the starts do.
    matrix = np.linalg.inv(normal + np.diag(np.full(q.size, WIDEST_START**-2)))
    return Whitener(response, tuple(noises), tuple(bases)), matrix


def _independent(columns: Array) -> Array:
    """Columns that span the same without the dependent ones."""
    basis, triangle = np.linalg.qr(columns / np.linalg.norm(columns, axis=0))
    kept = np.abs(np.diag(triangle)) > 1e-9
    return basis[:, kept]


def _jacobians(response: Response, q: Array, steps: Array) -> dict[str, Array]:
    """Central differences of the signals, one-sided at a bound; shape (n, p) for each channel."""
    low, high = bounds_of(response.unknowns)
    columns: dict[str, list[Array]] = {c.role: [] for c in response.channels}
    for j in range(q.size):
        up, down = q.copy(), q.copy()
        up[j] = min(q[j] + steps[j], high[j])
        down[j] = max(q[j] - steps[j], low[j])
        above, below = response.signals(up), response.signals(down)
        for role, found in columns.items():
            found.append((above[role] - below[role]) / (up[j] - down[j]))
    return {role: np.column_stack(found) for role, found in columns.items()}


def suspects(whitener: Whitener, q: Array, known: Sequence[str]) -> dict[str, tuple[float, float]]:
    """The change of each parameter not fitted that residuals indicate: relative, and in standard deviations.

    Parameters
    ----------
    q : array, shape (p,)
        The best place.
    known : sequence of str
        Parameters on which the motion does not depend, or that are fitted.
    """
    response, left = whitener.response, whitener.residual(q)
    own = [_slope(whitener, whitener, q - step, q + step) for step in 3e-3 * np.eye(q.size)]
    basis = np.linalg.svd(np.column_stack(own), full_matrices=False)[0]
    out: dict[str, tuple[float, float]] = {}
    for name in response.case.parameters:
        if name in known or name.startswith(_LEFT_OUT):
            continue
        with suppress(CaseError):
            value = Unknown.of(response.case, name).start
            low, high = (whitener.of(response.case.with_values({name: r * value})) for r in (1 - _MOVED, 1 + _MOVED))
            slope = _slope(low, high, q, q) / (2 * _MOVED)
            slope -= basis @ (basis.T @ slope)
            size = float(np.linalg.norm(slope))
            if size > 0.0:
                change = -float(slope @ left) / size**2
                out[name] = change, abs(change) * size
    return out


def held_between_rows(whitener: Whitener, q: Array) -> Array:
    """How far places move, to first order, were recorded inputs held until the next row instead of linear to it.

    What an input does between two rows is not recorded; a step that a controller takes, or a row that is missing, makes
    it another one than the straight line.

    Parameters
    ----------
    q : array, shape (p,)
        The best place.

    Returns
    -------
    array, shape (p,)
    """
    response = copy.copy(whitener.response)
    response.inputs = {
        name: Steps(given.times, given.values) if isinstance(given, Recorded) else given
        for name, given in response.inputs.items()
    }
    slopes = np.column_stack([_slope(whitener, whitener, q - step, q + step) / 6e-3 for step in 3e-3 * np.eye(q.size)])
    change = replace(whitener, response=response).residual(q) - whitener.residual(q)
    return np.asarray(np.linalg.lstsq(slopes, -change, rcond=1e-10)[0], float)


def _slope(low: Whitener, high: Whitener, below: Array, above: Array) -> Array:
    return high.residual(above) - low.residual(below)
