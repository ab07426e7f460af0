"""Intervals that stay honest where residuals are correlated, and which parameters the data cannot identify.

Residuals of measured data are not independent: sensors drift and wander, quantisation repeats itself. They are taken as
white noise plus noise with a correlation time (first-order), whose shares come from the residuals themselves. Cosine
transforms make such noise independent from coefficient to coefficient with the variance

    S_k = s (1 + r/(1 + (k/k_0)^2)),

so that fitting and weighting cost no more than a fast transform. Ratio r and corner k_0 are not taken as known: every
pair on a grid counts by its restricted likelihood (Harville, J Am Stat Assoc 72, 1977), which widens intervals where
the record is too short to separate wander from drift.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from eppanalysis.arrays import Array

#: Columns of a scaled Jacobian that are closer to dependent than this cannot be separated.
SMALLEST_SINGULAR = 1e-7
_RATIOS = np.append(0.0, np.geomspace(0.1, 1e7, 17))
_CORNERS = 12


@dataclass(frozen=True, eq=False)
class Weighted:
    """What is left of a least-squares fit once the correlation of its residuals is accounted for."""

    step: Array  # (p,): what the weighted fit adds to the parameters
    matrix: Array  # (p, p): covariance of the parameters
    critical: float  # factor that makes 95 % half widths of standard errors
    #: (n,): variance of every cosine coefficient of the noise, the mean over what the record leaves possible.
    power: Array

    def half_widths(self) -> Array:
        """95 % half widths of the parameters, shape (p,)."""
        return self.critical * np.sqrt(np.maximum(np.diag(self.matrix), 0.0))

    def cost(self, residual: Array) -> float:
        """Sum of squares of residuals in units of the noise; twice the logarithm of a likelihood."""
        return float(np.sum(_transform(residual) ** 2 / self.power))

    def whiten(self, columns: Array) -> Array:
        """Columns (or a residual) in units of the noise, coefficient by coefficient."""
        scale = np.sqrt(self.power)
        return _transform(columns) / (scale if columns.ndim == 1 else scale[:, None])


def _transform(columns: Array) -> Array:
    from scipy.fft import dct

    return dct(columns, axis=0, norm="ortho")


def weighted(jacobian: Array, residual: Array, floor: float = 0.0) -> Weighted:
    """Weighted correction and covariance of a least-squares fit with correlated residuals.

    Parameters
    ----------
    jacobian : array, shape (n, p)
        Of the residuals, in the order of time, of full rank.
    residual : array, shape (n,)
    floor : float
        Standard deviation that the white part has at least, where rounding leaves nothing to see.

    Raises
    ------
    numpy.linalg.LinAlgError
        If the Jacobian has not full rank.

    Examples
    --------
    >>> rng = np.random.default_rng(1)
    >>> t = np.linspace(-1.0, 1.0, 400)
    >>> noise = 0.01 * rng.normal(size=400)
    >>> found = weighted(np.column_stack([np.ones(400), t]), noise)
    >>> least = 1.96 * 0.01 / 20  # and what wander might hide
    >>> bool(0.9 * least < found.half_widths()[0] < 1.5 * least)
    True
    """
    from scipy.stats import t as student

    n, p = jacobian.shape
    size = np.linalg.norm(jacobian, axis=0)
    J, r = _transform(jacobian / size), _transform(residual)
    freedom = max(n - p, 1)
    least = max(floor**2, (1e-12 * float(np.max(np.abs(residual), initial=0.0))) ** 2, 1e-300)
    ratios, corners = np.meshgrid(_RATIOS, np.geomspace(0.7, max(n / 6, 1.5), _CORNERS), indexing="ij")
    pairs = np.column_stack([ratios.ravel(), corners.ravel()])
    pairs = pairs[(pairs[:, 0] > 0) | (pairs[:, 1] == pairs[0, 1])]
    k2 = np.arange(n) ** 2.0
    fits, logs = [], np.empty(len(pairs))
    for i, (ratio, corner) in enumerate(pairs):
        shape = 1.0 + ratio / (1.0 + k2 / corner**2)
        JW = J / shape[:, None]
        normal = JW.T @ J
        step = np.linalg.solve(normal, -(JW.T @ r))
        left = r + J @ step
        level = max(float(np.sum(left**2 / shape)) / freedom, least)
        # The restricted likelihood: the determinant counts what the fitted parameters take off the residuals.
        logs[i] = -0.5 * (freedom * math.log(level) + np.sum(np.log(shape)) + np.linalg.slogdet(normal)[1])
        # White noise is one pair, any other ratio has one for each corner: all ratios are to count alike.
        if ratio == 0:
            logs[i] += math.log(_CORNERS)
        fits.append((step, level * np.linalg.inv(normal), level * shape))
    share = np.exp(logs - logs.max())
    share /= share.sum()
    step = sum(w * f[0] for w, f in zip(share, fits, strict=True))
    matrix = sum(w * (f[1] + np.outer(f[0] - step, f[0] - step)) for w, f in zip(share, fits, strict=True))
    power = sum(w * f[2] for w, f in zip(share, fits, strict=True) if w > 1e-6)
    return Weighted(step / size, matrix / np.outer(size, size), float(student.ppf(0.975, freedom)), power)


def confounded(jacobian: Array, names: list[str]) -> list[str]:
    """Names of the parameters that the data cannot separate, empty where all columns are independent.

    Parameters
    ----------
    jacobian : array, shape (n, p)

    Examples
    --------
    >>> columns = np.array([[1.0, 2.0, 0.0], [2.0, 4.0, 1.0], [3.0, 6.0, 5.0]])
    >>> confounded(columns, ["a", "b", "c"])
    ['a', 'b']
    """
    scale = np.linalg.norm(jacobian, axis=0)
    if np.any(scale == 0):
        return [name for name, s in zip(names, scale, strict=True) if s == 0]
    _, singular, rows = np.linalg.svd(jacobian / scale, full_matrices=False)
    if len(singular) == len(names) and singular[-1] > SMALLEST_SINGULAR * singular[0]:
        return []
    direction = np.abs(rows[-1])
    return [name for name, d in zip(names, direction, strict=True) if d > 0.1]


def rounding(resolution: float, scatter: float) -> float:
    """Largest error that quantisation leaves in a mean of many readings that scatter.

    The first term of the series of a dithered quantiser: half a step without noise, nothing once the noise is about
    half a step. The scatter of readings holds the quantiser's own, a twelfth of the squared step.

    Examples
    --------
    >>> rounding(1.0, 0.0), round(rounding(1.0, 0.6), 4)
    (0.5, 0.0021)
    """
    if not resolution > 0:
        return 0.0
    noise = max(scatter**2 - resolution**2 / 12.0, 0.0)
    # The mean rounding error is a sawtooth over the value; noise damps its first harmonic by exp(-2 pi^2 sigma^2/q^2).
    return 0.5 * resolution * math.exp(-2.0 * noise * (math.pi / resolution) ** 2)
