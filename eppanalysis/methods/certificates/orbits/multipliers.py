"""Floquet multipliers of an orbit as discs, each of which holds as many as it is said to.

The derivative of the return map is a product of flows and of maps of events in balls. In a basis from its Schur form,
scaled so that what is left beside the diagonal is small, Gershgorin's discs hold all its eigenvalues; a group of discs
apart from the others holds as many as it has discs.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import linalg

from eppanalysis.arrays import Array
from eppanalysis.methods.certificates.orbits.shooting import Enclosure, Shooting


@dataclass(frozen=True)
class Disc:
    """A disc in the complex plane."""

    centre: complex
    radius: float  # rounded upward
    #: inside, outside: whether it is proved to lie inside, or outside, the unit circle.
    inside: bool
    outside: bool


def return_map(shooting: Shooting, enclosure: Enclosure) -> Any:
    """Derivative of the map from behind an event to behind the same event one period later (arb_mat, m x m).

    Behind an event the direction of the flow is mapped to zero, so that the multiplier 1 of the motion along the orbit
    is 0 in it.
    """
    from flint import arb_mat

    k = shooting.m + 1
    total = arb_mat(k, k, 1)
    for leg, start, duration in zip(shooting.legs, enclosure.starts, enclosure.durations, strict=True):
        flow = (leg.rate * duration).exp()
        slope = leg.rate * (flow * start)
        speed = (leg.guard * slope).entries()[0]
        # A neighbour meets the guard earlier or later; the projection along the flow takes that off (the saltation
        # matrix, docs/theory/exact_orbits.md, Floquet multipliers).
        onto_guard = arb_mat(k, k, 1) - slope * leg.guard * (1 / speed)
        total = leg.jump * onto_guard * flow * total
    return arb_mat([row[: shooting.m] for row in total.tolist()[: shooting.m]])


def discs_of(matrix: Any, scale: Array) -> tuple[Disc, ...]:
    """Discs that hold the eigenvalues of a matrix of balls, largest centre first.

    Parameters
    ----------
    matrix : arb_mat, shape (m, m)
    scale : array, shape (m,)
        Powers of two; sizes of the state.
    """
    from flint import acb_mat

    size = range(matrix.nrows())
    entries = matrix.tolist()
    scaled = acb_mat([[entries[i][j] * float(scale[j] / scale[i]) for j in size] for i in size])
    middle = np.array([[complex(v.mid()) for v in row] for row in scaled.tolist()])
    # Any basis gives discs that hold the eigenvalues, for its inverse is taken in balls: floats only make them small.
    # Schur's is unitary, so the inverse loses nothing; eigenvectors may nearly coincide.
    _, basis = linalg.schur(middle, output="complex")
    basis = acb_mat([[_point(v) for v in row] for row in basis])
    rows = (basis.inv() * scaled * basis).tolist()
    weights = _weights(np.array([[float(abs(v).upper()) for v in row] for row in rows]))
    out = [_disc(rows[i][i], _beside(rows[i], i, weights)) for i in size]
    return tuple(sorted(out, key=lambda d: -abs(d.centre)))


def _point(value: complex) -> Any:
    from flint import acb

    return acb(float(value.real), float(value.imag))


def _beside(row: list[Any], i: int, weights: Array) -> Any:
    """Sum of the entries beside the diagonal, in the scaled basis."""
    from flint import arb

    others = (abs(v) * float(weights[j] / weights[i]) for j, v in enumerate(row) if j != i)
    return sum(others, arb(0)).upper()


def _disc(diagonal: Any, radius: Any) -> Disc:
    size = abs(diagonal)
    centre = complex(diagonal.mid())
    wide = (radius + abs(diagonal - _point(centre))).upper()
    return Disc(centre, float(np.nextafter(float(wide), np.inf)), bool(size + radius < 1), bool(size - radius > 1))


def _weights(sizes: Array) -> Array:
    """Scaling, in powers of two, in which the entries beside the diagonal have rows and columns of about equal size."""
    beside = sizes - np.diag(np.diag(sizes))
    beside = beside + 1e-18 * max(float(beside.max(initial=0.0)), 1e-300)
    _, (weights, _) = linalg.matrix_balance(beside, permute=False, separate=True)
    return np.asarray(weights, float)
