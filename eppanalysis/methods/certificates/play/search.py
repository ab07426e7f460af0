"""Looks for a function that falls along every motion of loops with play: quadratic in each of many sectors.

Of a range of loops a function is sought for either end, such that their means serve all loops between (R).

Floating point, by a semidefinite program; what comes out is rounded to rationals, and whether it proves anything is
for `check_play` to say. The letters and numbers in brackets are those of docs/theory/proofs.md.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import numpy as np

from eppanalysis.arrays import Array
from eppanalysis.methods.certificates.check_play import MIXED, contact_form, sectors_of
from eppanalysis.methods.certificates.play.program import (
    Matrix,
    Vector,
    falling,
    largest_margin,
    products_of,
    spare,
    symmetric,
)


def rays_of(count: int) -> Matrix:
    """Borders of 2 `count` sectors of equal angles, in rationals, from (0, 1) by (1, 0) to (0, -1)."""
    angles = [math.pi / 2 * k / count for k in range(1, count)]
    # Any rays will do that differ; short numbers keep the certificate short.
    parts = max(100, 10 ** math.ceil(math.log10(2 * count)))
    upper = [[Fraction(round(parts * math.sin(a)), parts), Fraction(round(parts * math.cos(a)), parts)] for a in angles]
    lower = [[a, -b] for a, b in reversed(upper)]
    zero, one = Fraction(0), Fraction(1)
    return [[zero, one], *upper, [one, zero], *lower, [zero, -one]]


def continued(first: Any, steps: Any, borders: Matrix) -> list[Any]:
    """Forms of neighbouring sectors, each the one before and a product with the normal of the border, see (2)."""
    out, n = [first], len(first)
    for (a, b), step in zip(borders, steps.reshape(len(borders), n, *steps.shape[1:]), strict=True):
        normal = np.array([b, -a] + [Fraction(0)] * (n - 2), dtype=steps.dtype)
        outer = np.multiply.outer(normal, step)
        out.append(out[-1] + outer + np.swapaxes(outer, 0, 1))
    return out


@dataclass(frozen=True)
class _Unknowns:
    """The forms of a vector of unknowns; linear in it, so that it serves floats and batches alike."""

    n: int
    n_sectors: int
    rests: bool
    kept: Vector
    rays: Matrix

    @property
    def counts(self) -> tuple[int, int, int]:
        """Unknowns of the stuck form, of the first moving form, of the steps from sector to sector."""
        n, half = self.n, self.n * (self.n + 1) // 2
        return (1 + half - n if self.rests else half), half - (n == 3), n * (self.n_sectors - 1)

    def stuck(self, z: Any) -> Any:
        """The form Q; behind an integrator all that keeps its value is squared by itself, see (1)."""
        if not self.rests:
            return symmetric(z, self.n)
        kept = np.array(self.kept, dtype=z.dtype)
        out = np.multiply.outer(np.outer(kept, kept), z[0])
        out[1:, 1:] = out[1:, 1:] + symmetric(z[1:], self.n - 1)
        return out

    def forms(self, z: Any) -> tuple[Any, list[Any]]:
        """Q and the moving forms P; of third order all agree where speed and y_2 are zero."""
        first, second, third = np.cumsum(self.counts)
        Q = self.stuck(z[:first])
        start = z[first:second]
        first_form = symmetric(np.concatenate([start, Q[2:3, 2]]) if self.n == 3 else start, self.n)
        return Q, continued(first_form, z[second:third], self.rays[1:-1])

    @property
    def sizes(self) -> tuple[int, int]:
        """How many of the unknowns are bounded, and how many are not."""
        return sum(self.counts[:2]), self.counts[2]


@dataclass(frozen=True)
class SectorSearch:
    """The search for one loop or a range of loops, in given contact coordinates and sectors."""

    #: nums, den: of the linear part, one numerator or both ends of a range.
    nums: list[Vector]
    den: Vector
    poles: Vector  # that make the contact coordinates
    unit: Fraction  # rate by which their derivatives are divided [1/s]
    count: int  # sectors of a quarter of the plane of y_1 and y_2

    def candidate(self) -> dict[str, Any] | None:
        """What a certificate holds besides the loop, rationals that nothing has checked yet; None if there is none."""
        # In a time of which the rate is one: the solver's margins know no units.
        contacts = [contact_form(num, self.den, self.poles, self.unit) for num in self.nums]
        A = [[x / self.unit for x in row] for row in contacts[0][0]]
        inputs = [[x / self.unit for x in b] for _, b in contacts]
        n, rays = len(A), rays_of(self.count)
        sectors = sectors_of(rays, n)
        unknowns = _Unknowns(n, len(sectors), self.poles[0] == 0, _kept(A), rays)
        flows = [np.array(A, dtype=float) + np.outer(np.array(b, dtype=float), np.eye(n)[0]) for b in inputs]
        slopes = [float(-b[1] / A[0][1]) for b in inputs]
        poles = -float(sum(A[i][i] for i in range(n)))
        signs = {} if n == 2 or max(slopes) <= 0 else signs_at_turning(flows, slopes, rays, poles)
        solution = largest_margin(*_inequalities(unknowns, A, flows, sectors), len(flows) * unknowns.sizes[0])
        if solution is None or signs is None:
            return None
        rounded, margin = solution
        ends, (moving, released) = _split(rounded, len(flows), unknowns.sizes, len(sectors))
        functions = [unknowns.forms(z) for z in ends]
        release = [
            [[x, *pair] for x, pair in zip(row, _pairs(Q, P, sectors), strict=False)]
            for row, (Q, P) in zip(released.reshape(len(flows), -1), functions, strict=True)
        ]
        return {
            "poles": self.poles,
            "unit": self.unit,
            "rays": rays,
            # Half of the margin is what V falls by, the other half is room for rounding to rationals.
            "decrease": self.unit * margin / 2,
            "stuck": [Q.tolist() for Q, _ in functions],
            "moving": [[form.tolist() for form in P] for _, P in functions],
            "moving_multipliers": (self.unit * moving).tolist(),
            "release_multipliers": release,
            **({"signs": self._per_second(signs)} if signs else {}),
        }

    def _per_second(self, signs: dict[str, Any]) -> dict[str, Any]:
        """The barrier of signs in the unit of time of the loop."""
        factors = (self.unit * np.array(signs["multipliers"])).tolist()
        return signs | {"rate": self.unit * signs["rate"], "multipliers": factors}


def _kept(A: Matrix) -> Vector:
    """What keeps its value while the play rests behind an integrator: the left null vector of A."""
    unit = A[0][1]
    if len(A) == 2:
        return [-A[1][1], unit]
    return [(A[1][1] * A[2][2] - A[2][1] * unit) / unit**2, -A[2][2] / unit, Fraction(1)]


def _pairs(Q: Any, P: list[Any], sectors: list[tuple[Vector, Vector]]) -> Iterator[list[Any]]:
    """Factors of y_3 times the two forms of a sector that make up the products of P - Q with y_3, see (5)."""
    for form, (f, g) in zip(P, sectors, strict=True):
        if len(Q) == 2:
            yield [Fraction(0), Fraction(0)]
            continue
        x, y = -2 * (form - Q)[:2, 2]
        number: Any = float if getattr(x, "ndim", 0) else Fraction
        (f1, f2), (g1, g2) = map(number, f[:2]), map(number, g[:2])
        across = f1 * g2 - f2 * g1
        yield [(x * g2 - y * g1) / across, (f1 * y - f2 * x) / across]


def _split(z: Any, n_ends: int, sizes: tuple[int, int], count: int) -> tuple[list[Any], tuple[Any, Any]]:
    """The unknowns of each end of a range, the factors of sectors in each Bernstein coefficient, and what follows.

    Of all ends those that are bounded come first.
    """
    bounded, free = sizes
    heads, tails, factors, rest = np.split(z, np.cumsum((n_ends * bounded, n_ends * free, len(MIXED[n_ends]) * count)))
    ends = zip(np.split(heads, n_ends), np.split(tails, n_ends), strict=True)
    return [np.concatenate(end) for end in ends], (factors.reshape(-1, count, *z.shape[1:]), rest)


def _falling(flows: list[Array], ends: list[list[Array]], growth: float = 0.0) -> Iterator[list[Array]]:
    """By how much forms fall in motion beside a growth, in each sector, for each Bernstein coefficient, see (R)."""
    for pairs in MIXED[len(flows)]:
        parts = [[falling(form, flows[i]) - growth * form for form in ends[j]] for i, j in pairs]
        yield [sum(part) / len(pairs) for part in zip(*parts, strict=True)]


def _inequalities(
    unknowns: _Unknowns, A: Matrix, flows: list[Array], sectors: list[tuple[Vector, Vector]]
) -> tuple[list[Array], list[Array]]:
    """Matrices and numbers that must not be negative, by the unknowns they depend on; the last one is the margin."""
    count, n_ends, products = len(sectors), len(flows), products_of(sectors)
    n_released = sum(ray[1] >= 0 for ray in unknowns.rays[1:])
    eye = np.eye(n_ends * (sum(unknowns.sizes) + n_released) + len(MIXED[n_ends]) * count + 1)
    margin = eye[-1]
    ends, (moving, released) = _split(eye[:-1], n_ends, unknowns.sizes, count)
    functions = [unknowns.forms(z) for z in ends]

    # (1), (4), (3) and (5) of docs/theory/proofs.md, The function and its inequalities; (2) is in the forms.
    matrices, numbers = [], [*moving.reshape(-1, len(eye)), *released]
    for falls, factors in zip(_falling(flows, [P for _, P in functions]), moving, strict=True):
        for fall, product, factor in zip(falls, products, factors, strict=True):
            matrices.append(spare(fall - np.multiply.outer(product, factor), margin))
    for (Q, P), factors in zip(functions, np.split(released, n_ends), strict=True):
        quiet = falling(Q, np.array(A, dtype=float))
        matrices.append(spare(quiet[1:, 1:] if unknowns.rests else quiet, margin))
        numbers.append((P[-1] - Q)[1, 1] - margin)
        for form, product, factor in zip(P, products, factors, strict=False):
            matrices.append(spare((Q - form - np.multiply.outer(product, factor))[:2, :2], margin))
        if unknowns.n == 3:
            numbers.append((P[-1] - Q)[1, 2])
            numbers += [x - margin for pair in list(_pairs(Q, P, sectors))[:n_released] for x in pair]
    return matrices, numbers


#: Rates at which the barrier of signs may grow, as shares of the sum of the poles.
_GROWTH = (1.0, 0.75, 0.5, 0.25, 0.0)


def signs_at_turning(flows: list[Array], slopes: list[float], rays: Matrix, poles: float) -> dict[str, Any] | None:
    """The barrier that shows y_3 <= 0 at a turning point of loops with a zero, see (Z); None if none is found."""
    lower = rays[rays.index([Fraction(1), Fraction(0)]) :]
    sectors = sectors_of(rays, 3)[-(len(lower) - 1) :]
    count, borders, n_ends = len(sectors), lower[1:-1], len(flows)
    sizes = 5, 3 * len(borders)
    eye = np.eye(n_ends * sum(sizes) + len(MIXED[n_ends]) * count + 1)
    margin, (ends, (factors, _)) = eye[-1], _split(eye[:-1], n_ends, sizes, count)
    forms = [_barrier(z, borders) for z in ends]
    # The scale is free: the last product of y_2 and y_3 lies between -1 and minus the margin.
    numbers = [*factors.reshape(-1, len(eye))]
    for first, last in ((row[0], row[-1]) for row in forms):
        numbers += [first[0, 2] - margin, last[1, 1] - margin, -last[1, 2] - margin]
    for pairs in MIXED[n_ends]:
        starts = [-forms[j][0][0, 0] - 2 * slopes[i] * forms[j][0][0, 2] for i, j in pairs]
        numbers.append(sum(starts) / len(pairs) - margin)
    for share in _GROWTH:
        growth = Fraction(round(share * poles * 64), 64)
        matrices = [
            spare(fall - np.multiply.outer(product, factor), margin)
            for falls, row in zip(_falling(flows, forms, float(growth)), factors, strict=True)
            for fall, product, factor in zip(falls, products_of(sectors), row, strict=True)
        ]
        solution = largest_margin(matrices, numbers, n_ends * sizes[0])
        if solution is not None:
            found, (rows, _) = _split(solution[0], n_ends, sizes, count)
            made = [[form.tolist() for form in _barrier(z, borders)] for z in found]
            return {"rate": growth, "forms": made, "multipliers": rows.tolist()}
    return None


def _barrier(z: Any, borders: Matrix) -> list[Any]:
    """Forms without a square of y_3: below zero they say on which side of y_3 = 0 the motion is."""
    return continued(symmetric(np.concatenate([z[:5], 0 * z[:1]]), 3), z[5:], borders)
