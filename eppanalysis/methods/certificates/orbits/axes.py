"""Coordinates for the proof, so that it does not depend on those that the loop happens to be given in.

Ball arithmetic loses what coordinates cost in which fast and slow, large and small motions are mixed. Where the states
of the loop do not do, the proof takes the inputs of its elements and their rates in the linear part, each in the size
of its motion: these are the same whatever the states are called. They are chosen in floats and then taken exactly.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import linalg

from eppanalysis.arrays import Array, IntArray
from eppanalysis.methods.certificates.orbits.path import Closed, ExactPath

#: Bits of the entries of the axes; more only make the rationals longer.
_BITS = 20
#: What the last signal chosen adds to the others, relative to its size, at least.
_LEAST = 1e-12


@dataclass(frozen=True)
class OwnAxes:
    """Unknowns in the axes of the motion."""

    basis: Array  # (m, m): from the new unknowns to the places of y that are unknown
    path: ExactPath  # in the new unknowns
    starts: Array  # (p, m): states behind the events, in the new unknowns

    @classmethod
    def states(cls, path: ExactPath, orbit: Closed) -> OwnAxes:
        """The states as they are given, each in the power of two next to the size of its motion."""
        sizes = orbit.scale[np.array(path.free, int)]
        return cls._with(path, orbit, np.diag(np.exp2(np.round(np.log2(sizes)))))

    @classmethod
    def signals(cls, path: ExactPath, orbit: Closed) -> OwnAxes | None:
        """The inputs of the elements and their rates; None where they do not tell the state."""
        free = np.array(path.free, int)
        states = free < orbit.hybrid.x0.size
        rows = _signals(path, orbit, free[states])
        if rows is None:
            return None
        basis = np.diag(orbit.scale[free])
        try:
            basis[np.ix_(states, states)] = np.linalg.inv(rows)
            return cls._with(path, orbit, _rounded(basis))
        except (np.linalg.LinAlgError, ZeroDivisionError):
            return None

    @classmethod
    def _with(cls, path: ExactPath, orbit: Closed, basis: Array) -> OwnAxes:
        from flint import fmpq_mat

        free = np.array(path.free, int)
        rows = [[*(rational_of(v) for v in row), rational_of(0.0)] for row in basis.tolist()]
        last = [rational_of(0.0)] * free.size + [rational_of(1.0)]
        starts = np.linalg.solve(basis, orbit.starts[:-1, free].T).T
        return cls(basis, path.in_basis(fmpq_mat([*rows, last])), np.asarray(starts, float))


def rational_of(value: float) -> Any:
    """A float exactly as it is (fmpq)."""
    from flint import fmpq

    top, bottom = float(value).as_integer_ratio()
    return fmpq(top, bottom)


def _signals(path: ExactPath, orbit: Closed, places: IntArray) -> Array | None:
    """As many signals as there are states, the most independent ones over the motion, as rows on the states."""
    from flint import arb

    model, n, stages = orbit.hybrid.model, places.size, [path.stages[k] for k in path.places]
    v = np.hstack([orbit.starts[:-1, np.array(path.free, int)], np.ones((len(path.places), 1))])
    F = np.array([[[float(arb(x)) for x in row] for row in stage.rate.tolist()] for stage in stages])
    ends = np.einsum("pij,pj->pi", linalg.expm(F * orbit.tau[:, None, None]), v)
    rates = np.einsum("pij,pj->pi", F, v) * 0.1 * np.abs(orbit.tau)[:, None]
    both = np.concatenate([v, ends])[:, path.moving]
    away = np.concatenate([both - both.mean(axis=0), rates[:, path.moving]])
    A, rows = model.A[np.ix_(places, places)], [model.C[:, places]]
    for _ in range(n - 1):
        rows.append(rows[-1] @ A)
    every = np.vstack(rows)
    sizes = np.linalg.norm(away @ every.T, axis=0)
    every = every[sizes > 1e-12 * np.linalg.norm(every, axis=1) * np.linalg.norm(away)]
    every = every / np.linalg.norm(away @ every.T, axis=0)[:, None]
    if len(every) < n:
        return None
    # Pivoting takes the most independent signals first; the last
    # number on the diagonal says whether they tell the state.
    _, found, order = linalg.qr(away @ every.T, mode="economic", pivoting=True)
    if not abs(found[n - 1, n - 1]) > _LEAST:
        return None
    return np.asarray(every[order[:n]], float)


def _rounded(values: Array) -> Array:
    """Numbers of few bits next to some."""
    mantissa, exponent = np.frexp(values)
    return np.asarray(np.ldexp(np.round(mantissa * 2.0**_BITS), exponent - _BITS), float)
