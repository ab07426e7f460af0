"""Floquet multipliers of an exact orbit, from the derivative of its return map.

The derivative of a chain of arcs is the product of flows and saltation matrices: at an event with guard row g, map J
and rates f before and f+ behind it, a disturbance is carried over by ``J + (f+ - J f) g / (g f)``. Here the same
product comes out of Newton's equations by eliminating the dwell times; it maps the disturbances on the section of the
first event onto themselves, so the multiplier 1 of a shift along the orbit is not among its eigenvalues.
"""

from __future__ import annotations

import numpy as np

from eppanalysis.arrays import Array, ComplexArray
from eppanalysis.readable import DIGITS, number

#: Singular values of the scaled return map below this share of the largest are rounding: directions that sticking,
#: resets or fast decay wipe out.
VANISHED = 1e-13
#: A multiplier this near to 1 belongs to the direction of a continuum of cycles, where there is one.
_NEUTRAL = 1e-5
#: A singular value of a scaled return map less one below this share of the largest is rounding.
_STANDS = 1e-9


def return_map(A: Array, n_free: int) -> Array:
    """Derivative of the return map from the matrix of (periodicity, guards) over (start, dwell times).

    Parameters
    ----------
    A : array, shape (n_free + p, n_free + p)
        See :func:`eppanalysis.engine.orbits.sweep`.
    n_free : int
        Places of the start that must repeat.

    Returns
    -------
    array, shape (n_free, n_free)

    Raises
    ------
    numpy.linalg.LinAlgError
        If a guard is met without being crossed (grazing): then there is no derivative.
    """
    # The guards' equations give the dwell times for any disturbed start; put into those of periodicity they leave the
    # return map less one (docs/theory/exact_orbits.md, Floquet multipliers).
    m = n_free
    dwell = np.linalg.solve(A[m:, m:], A[m:, :m]) if A.shape[0] > m else np.zeros((0, m))
    return A[:m, :m] + np.eye(m) - A[:m, m:] @ dwell


def multipliers(P: Array, scale: Array, n_wanted: int) -> ComplexArray:
    """Floquet multipliers, largest first; those that vanish are exactly zero, and those of continua exactly one.

    The eigenvalues of a defective matrix come out of a QR iteration as roots of rounding errors, so the null directions
    of the map are taken off first, and then those of the map less one, which a chain of integrators has.

    Parameters
    ----------
    P : array, shape (m, m)
        Derivative of the return map.
    scale : array, shape (m,)
        Sizes of the motion in each place, so that "small" has a meaning.
    n_wanted : int
        Number of states of the loop less one for the direction along the orbit; what the memory values add vanishes.
    """
    moved, count = _less_one(P, scale)
    values = np.ones(count, complex)
    values[: len(moved)] += np.linalg.eigvals(moved)
    values = values[np.argsort(-np.abs(values), kind="stable")]
    found = np.zeros(n_wanted, complex)
    found[: min(n_wanted, values.size)] = values[:n_wanted]
    return found


def _less_one(P: Array, scale: Array) -> tuple[Array, int]:
    """The scaled map less one without what vanishes and what is one, and how many multipliers do not vanish."""
    Q = _without_zeros(P * scale / scale[:, None])
    return _without_zeros(Q - np.eye(len(Q))), len(Q)


def eigenvalues_and_errors(M: Array, share: float) -> tuple[ComplexArray, Array]:
    """Eigenvalues of a matrix, and how far an error of that share of its norm may move each, to first order."""
    found, right = np.linalg.eig(M)
    left = np.linalg.pinv(right).conj().T
    left /= np.linalg.norm(left, axis=0)
    # An error moves an eigenvalue by its own size over the cosine between left and right eigenvector.
    with np.errstate(all="ignore"):
        worst = 1.0 / np.abs(np.sum(left.conj() * right, axis=0))
    return found, share * np.linalg.norm(M) * worst


def on_the_circle(P: Array, scale: Array, error: float, one_of_many: bool) -> bool:
    """Whether a multiplier is beside the unit circle by less than errors may have moved it.

    Parameters
    ----------
    P, scale : arrays, shapes (m, m), (m,)
        As of :func:`multipliers`.
    error : float
        Of the orbit, relative to its size.
    one_of_many : bool
        Whether the 1 of a continuum of cycles is let pass.
    """
    moved, _ = _less_one(P, scale)
    if not (moved.size and np.isfinite(error)):
        return False
    rounding = len(moved) * np.finfo(float).eps
    values, errors = eigenvalues_and_errors(moved + np.eye(len(moved)), error + rounding)
    others = np.abs(values - 1.0) > _NEUTRAL if one_of_many else np.ones(values.size, bool)
    # What is certainly outside decides, whatever is on the circle besides.
    return bool(
        np.any(others & (np.abs(np.abs(values) - 1.0) <= errors))
        and not np.any(others & (np.abs(values) - 1.0 > errors))
    )


def _without_zeros(Q: Array, share: float = VANISHED) -> Array:
    """A matrix with the eigenvalues of another but those that vanish, by a share of the largest singular value.

    With ``Q = U R`` (R of full row rank) they are those of ``R U``, until that has full rank itself.
    """
    while Q.size:
        U, s, Vt = np.linalg.svd(Q)
        rank = int(np.sum(s > share * max(1.0, s[0])))
        if rank == Q.shape[0]:
            break
        Q = (s[:rank, None] * Vt[:rank]) @ U[:, :rank]
    return Q


def drifts(P: Array, scale: Array) -> bool:
    """Whether a disturbance grows from turn to turn by as much each time, as along a chain of integrators.

    A multiplier 1 that counts twice has one way to neighbouring cycles alone then (docs/theory/sampled.md): the other
    disturbance moves the motion along that way for ever.
    """
    moved = P * scale / scale[:, None] - np.eye(len(P))
    ones = len(moved) - len(_without_zeros(moved, _STANDS))
    gains = np.linalg.svd(moved, compute_uv=False)
    return ones > int(np.sum(gains <= _STANDS * np.maximum(1.0, gains.max(initial=0.0))))


def is_stable(values: ComplexArray, one_of_many: bool = False) -> bool:
    """Whether all multipliers lie inside the unit circle; the 1 of a continuum of cycles is let pass."""
    others = values[np.abs(values - 1.0) > _NEUTRAL] if one_of_many else values
    return bool(np.all(np.abs(others) < 1.0))


def verdict(values: ComplexArray, one_of_many: bool, drifting: bool, on_circle: bool = False) -> bool | None:
    """Whether a cycle is stable; None for a neutral one, off which a disturbance grows by as much each turn alone, or
    neither grows nor decays beyond rounding.
    """
    stable = is_stable(values, one_of_many)
    return None if on_circle or (stable and drifting) else stable


def describe(values: ComplexArray, one_of_many: bool = False, drifting: bool = False, on_circle: bool = False) -> str:
    """The sentence that goes with a verdict of stability."""
    if on_circle:
        return f"{describe(values, one_of_many, drifting)}; one lies on the unit circle to rounding"
    if drifting:
        neutral = "neutral, as " * is_stable(values, one_of_many)
        return f"{describe(values)}; {neutral}a disturbance moves it by as much each turn along a continuum of cycles"
    if one_of_many:
        return f"{describe(values)}; one of a continuum of cycles, between which a disturbance may move it"
    if values.size == 0:
        return "no Floquet multipliers: every disturbance vanishes within a period"
    size = abs(values[0])
    # Next to one four digits do not say on which side.
    digits = DIGITS if abs(size - 1.0) > 10.0 ** (1 - DIGITS) else DIGITS + 3
    return f"largest Floquet multiplier {number(size, digits)}"
