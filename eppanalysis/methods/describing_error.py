"""The error that first order makes, estimated from the harmonics that it neglects.

Harmonics up to 25 that the linear part makes of the outputs are added to the inputs of the elements, whose answers to
them are exact. What this changes in the balance of means and fundamentals moves amplitudes and frequency; there the
harmonics are made afresh, and what they change now says how far the first answer can be trusted.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from eppanalysis.errors import ModelError
from eppanalysis.methods.describing_balance import Array, Balance, ComplexArray
from eppanalysis.methods.describing_quality import Point
from eppanalysis.methods.harmonic_elements import Unsettled
from eppanalysis.methods.harmonic_loop import Equations, Loop

_HARMONICS = 25
#: Share of the correction that is added to it, for higher harmonics and for what is quadratic in the correction.
_MARGIN = 0.1


def error_estimate(balance: Balance, p: Point) -> tuple[float, float]:
    """Estimated relative error of amplitudes and frequency, and the harmonic content of the inputs.

    The estimate is the larger of two successive corrections, a tenth more, and twice their difference: if corrections
    shrink at least by halves, what is left after the second is at most as large as their difference. Over random loops
    it covers the true error in some 97 of 100 (see the documentation, "When first order is good enough").

    Returns
    -------
    (error, content) : float, float
        `content` is the largest root-sum-square of harmonics over the amplitude of the fundamental. The error is
        infinite where an element no longer answers periodically once it sees the harmonics, and both are nan where an
        element has no exact answer to them.
    """
    try:
        work = _Work.of(balance, p)
    except ModelError:
        return float("nan"), float("nan")
    try:
        first, harmonics = work.correction(np.zeros_like(work.X), work.none, passes=2)
        content = work.content(harmonics)
        rest, _ = work.correction(first, harmonics, passes=1)
    except Unsettled:
        return float("inf"), float("nan")
    sizes = [work.size(change) for change in (first, first + rest, rest)]
    return (1.0 + _MARGIN) * max(sizes[:2]) + 2.0 * sizes[2], content


@dataclass(frozen=True, eq=False)
class _Work:
    """One cycle with its linearised balance; lives for one call.

    Attributes
    ----------
    X : array, shape (3 m + 1,)
        The cycle as unknowns of the balance of order 1.
    inverse : array
        From residuals to corrections.
    settling : array, shape (n_harmonics, m, m)
        Inverse of the loop closed by the elements' mean slopes, at each harmonic: one pass then nearly settles them.
    """

    loop: Loop
    equations: Equations
    X: Array
    inverse: Array
    settling: ComplexArray
    n: int

    @classmethod
    def of(cls, balance: Balance, p: Point) -> _Work:
        loop = Loop.from_balance(balance)
        n = max(1, min(_HARMONICS, loop.highest(p.omega)))
        equations = Equations(loop, 1, balance.pivot, np.ones(1))
        turned = -1j * p.amplitude * np.exp(1j * (p.phase - p.phase[balance.pivot]))
        X = equations.pack(np.column_stack([p.bias + 0j, turned]), p.omega)
        _, J, W = equations.linearised(X)
        unknowns, rows = equations.scales(X, W)
        inverse = unknowns[:, None] * np.linalg.pinv(J * unknowns / rows[:, None], rcond=1e-14) / rows
        selector = (balance.owner[:, None] == np.arange(balance.m)[None, :]) * p.slopes_of_mean[1][:, None]
        closing = np.eye(balance.m) - loop.linear(p.omega, n)[1:] @ selector
        return cls(loop, equations, X, inverse, np.linalg.inv(closing), n)

    @property
    def none(self) -> ComplexArray:
        """No harmonics, shape (m, n - 1)."""
        return np.zeros((len(self.loop.elements), self.n - 1), complex)

    def correction(self, change: Array, harmonics: ComplexArray, passes: int) -> tuple[Array, ComplexArray]:
        """What the balance asks for next at ``X + change``, with harmonics made afresh from the given ones."""
        Z, omega = self.equations.unpack(self.X + change)
        L = self.loop.linear(omega, self.n)
        longer = np.concatenate([Z, harmonics], 1)
        for _ in range(passes):
            W, _ = self.loop.answers(longer, omega)
            made = (L @ W.T[1:, :, None])[1:, :, 0].T - longer[:, 2:]
            longer[:, 2:] += (self.settling @ made.T[..., None])[..., 0].T
        W, _ = self.loop.answers(longer, omega)
        R = self.equations.residual(Z, W[:, :2], L[:1])
        return -self.inverse @ R, longer[:, 2:]

    def size(self, change: Array) -> float:
        """Largest relative change of an amplitude or of the frequency."""
        Z, omega = self.equations.unpack(self.X)
        moved, _ = self.equations.unpack(np.append(change[:-1], 0.0))
        amplitudes = np.abs((moved[:, 1] / Z[:, 1]).real)
        return float(max(amplitudes.max(), abs(change[-1]) / omega))

    def content(self, harmonics: ComplexArray) -> float:
        """Largest root-sum-square of an input's harmonics over its fundamental."""
        Z, _ = self.equations.unpack(self.X)
        return float((np.sqrt((np.abs(harmonics) ** 2).sum(1)) / np.abs(Z[:, 1])).max())
