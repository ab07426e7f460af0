"""Roots on curves: along one variable, and along solution curves of the harmonic balance (where lambda passes one).

Pairs of roots near a fold are found because every local extremum is located before signs are compared.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eppanalysis.arrays import Array, BoolArray, ComplexArray
from eppanalysis.methods.describing.balance import ON_THE_WAY, Balance, newton
from eppanalysis.roots import between, least, stretches

#: Steps between nodes that an extremum may lie beyond the nearest node; of a parabola it is a quarter.
_REACH = 4.0
#: Halvings of a step of the grid in which a gain passes zero.
_HALVINGS = 48
#: Steps along a curve to where it passes lambda = 1, and so many of these in a row that may fail.
_STEPS_ALONG, _MOST_FAILURES = 80, 24


def roots_at_once(f: Callable[[Array], Array], x: Array, y: Array, accept: float = 1e-9) -> Array:
    """All roots of `f` that the nodes bracket, or that an extremum between them reveals, ascending.

    Parameters
    ----------
    f : callable
        Of many points (n,) at once.
    x, y : array, shape (n,)
        Ascending nodes and ``f(x)``; intervals with a value that is not finite are left out.
    accept : float, optional
        Largest ``|f|`` at a root, which tells roots from jumps.

    Examples
    --------
    >>> import numpy as np
    >>> x = np.linspace(-1.0, 1.0, 6)
    >>> roots_at_once(lambda t: t * t - 1e-6, x, x * x - 1e-6).round(9).tolist()
    [-0.001, 0.001]
    """
    at, dip = np.flatnonzero(_changes(y)), _dips(y)
    sign = np.sign(y[dip])
    places = np.array([dip - 1, dip, dip + 1])
    best, height = least(lambda u, k: sign[k] * f(u), x[places], sign * y[places], _within_reach)
    turned = np.flatnonzero(height < 0)
    best, f_best, dip = best[turned], (sign * height)[turned], dip[turned]
    # From node to node, and on both sides of an extremum: places and the values there.
    low, f_low = (np.concatenate([v[at], v[dip - 1], u]) for v, u in ((x, best), (y, f_best)))
    high, f_high = (np.concatenate([v[at + 1], u, v[dip + 1]]) for v, u in ((x, best), (y, f_best)))
    roots = between(lambda t, _: f(t), low, high, (f_low, f_high))
    roots = roots[np.isfinite(roots)]
    return np.unique(roots[np.abs(f(roots)) < accept]) if roots.size else roots


def _within_reach(x: Array, y: Array, reach: float = _REACH, narrowest: float = 1e-12) -> BoolArray:
    """Whether minima (3, n) that are above zero may lie below it."""
    rise = np.maximum(y[0], y[2]) - y[1]
    return (y[1] >= 0) & (y[1] < reach * rise) & (x[2] - x[0] > narrowest)


def _changes(y: Array) -> BoolArray:
    ok = np.isfinite(y[:-1]) & np.isfinite(y[1:])
    return ok & ((y[:-1] < 0) != (y[1:] < 0))


def _dips(y: Array) -> NDArray[np.intp]:
    """Interior nodes nearer to zero than both neighbours, all of one sign, from which zero is within reach.

    Between its nodes a curve does not go much further than it goes from node to node.
    """
    ok = np.isfinite(y)
    middle = ok[1:-1] & ok[:-2] & ok[2:]
    same = ((y[1:-1] < 0) == (y[:-2] < 0)) & ((y[1:-1] < 0) == (y[2:] < 0))
    lower = (np.abs(y[1:-1]) <= np.abs(y[:-2])) & (np.abs(y[1:-1]) <= np.abs(y[2:]))
    way = np.maximum(np.abs(y[:-2] - y[1:-1]), np.abs(y[2:] - y[1:-1]))
    return np.flatnonzero(middle & same & lower & (np.abs(y[1:-1]) < _REACH * way)) + 1


def contour_lines(values: Array) -> list[Array]:
    """Zero contours of `values` (nx, ny) as polylines (n, 2) in fractional indices; not-a-number is left out."""
    from contourpy import FillType, LineType, SerialContourGenerator, ZInterp

    known, above = np.isfinite(values), values > 0
    rows = np.flatnonzero(known.any(axis=1))
    # Of a loop without gain there is one frequency, and no line in a plane.
    if min(values.shape) < 2 or not rows.size or not above.any() or not np.any(known > above):
        return []
    used = slice(int(rows[0]), int(rows[-1]) + 1)
    inner, known = values[used].T, known[used].T
    if inner.shape[1] < 2:
        return []
    # The class and not its `contour_generator`, which looks for values that are none again and takes as long.
    places = np.meshgrid(np.arange(used.start, used.stop, dtype=float), np.arange(values.shape[1], dtype=float))
    plane: list[Any] = [*places, inner, None if known.all() else ~known]
    generator = SerialContourGenerator(
        *plane,
        line_type=LineType.Separate,
        fill_type=FillType.OuterOffset,
        corner_mask=True,
        quad_as_tri=False,
        z_interp=ZInterp.Linear,
    )
    return [np.asarray(line) for line in generator.lines(0.0)]


def at_index(nodes: Array, index: Array) -> Array:
    """Values between nodes, at fractional indices."""
    return np.interp(index, np.arange(len(nodes)), nodes)


def interpolate(X: Array, loop: ComplexArray, path: Array) -> tuple[Array, ComplexArray]:
    """Unknowns and loop gain at fractional indices (bilinear; contour points lie on edges of the grid)."""
    i, j = (np.clip(np.floor(path[:, k]).astype(int), 0, X.shape[k] - 2) for k in (0, 1))
    u, v = path[:, 0] - i, path[:, 1] - j
    points, values = np.zeros((len(path), X.shape[2])), np.zeros(len(path), complex)
    for di, wi in ((0, 1 - u), (1, u)):
        for dj, wj in ((0, 1 - v), (1, v)):
            weight = wi * wj
            used = weight > 0
            points[used] += weight[used, None] * X[i + di, j + dj][used]
            values[used] += weight[used] * loop[i + di, j + dj][used]
    return points, values


def crossings(balance: Balance, curves: list[Array]) -> tuple[Array, Array]:
    """Limit cycles (n, 3 m + 1) along curves of exact solutions (points in order, shape (n_curve, 3 m + 1)).

    Besides, points beside which a curve passes lambda = 1 without a solution there.
    """
    pairs: list[tuple[Array, Array]] = []
    dips: list[Array] = []
    for curve in curves:
        F, near = curve[:, -1], _near(curve)
        pairs += [(curve[i], curve[i + 1]) for i in np.flatnonzero(_changes(F) & near)]
        dips += [curve[i - 1 : i + 2] for i in _dips(F) if near[i - 1] and near[i] and abs(F[i]) < 1.0]
    if dips:
        pairs += _split_at_extrema(balance, *np.stack(dips, axis=1))
    if not pairs:
        return np.zeros((0, 3 * balance.m + 1)), np.zeros((0, 3 * balance.m + 1))
    start, end = (np.array(side) for side in zip(*pairs, strict=True))
    return _close(balance, start, end)


def _near(curve: Array) -> BoolArray:
    """Whether neighbours are close enough to belong together."""
    return np.abs(np.diff(curve[:, :2], axis=0)).max(-1) < 1.0


def settle(balance: Balance, lines: list[Array], splits: int = 0) -> list[Array]:
    """Bring polylines of approximate solutions onto the solution curves, all points at once.

    Parameters
    ----------
    splits : int, optional
        Points put between neighbours, so that features narrower than the grid show.
    """
    lines = [line for line in lines if len(line) > 1]
    if not lines:
        return []
    if splits:
        lines = [_split(line, splits) for line in lines]
    start = np.concatenate(lines)
    # Each point in the plane across its chord: along the curve there is nothing to be solved for, and points stay in
    # order.
    normals = np.concatenate([_weigh(balance, line, np.gradient(line, axis=0)) for line in lines])
    X, ok = newton(balance, start, normals, tolerance=ON_THE_WAY)
    ok &= np.abs(X - start)[:, :2].max(-1) < 1.0
    ends = np.cumsum([len(line) for line in lines])[:-1]
    return [x[k] for x, k in zip(np.split(X, ends), np.split(ok, ends), strict=True)]


def _split(line: Array, splits: int) -> Array:
    parts = (np.arange(splits + 1) / (splits + 1))[None, :, None]
    dense = (line[:-1, None] + parts * np.diff(line, axis=0)[:, None]).reshape(-1, line.shape[1])
    return np.concatenate([dense, line[-1:]])


def _weigh(balance: Balance, X: Array, chord: Array) -> Array:
    """Normal of the plane across a chord, with biases measured by their amplitudes and lambda left out."""
    m = balance.m
    a, _, b, _ = balance.unpack(X)
    normal = chord.copy()
    normal[:, 2 * m : 3 * m] /= (a + 0.1 * np.abs(b)) ** 2
    normal[:, -1] = 0.0
    flat = np.abs(normal).max(-1) == 0
    normal[flat, 0] = 1.0
    return normal


def _between(balance: Balance, points: list[Array], weights: list[Array], chord: Array) -> tuple[Array, NDArray]:
    guess = np.sum([w[:, None] * p for w, p in zip(weights, points, strict=True)], axis=0)
    return newton(balance, guess, _weigh(balance, points[0], chord), 8, ON_THE_WAY)


def _split_at_extrema(balance: Balance, left: Array, middle: Array, right: Array) -> list[tuple[Array, Array]]:
    """Golden section for the extremum of ln lambda in [left, right]; brackets on both sides where the sign turns.

    It also ends where zero is out of reach: what is left of the way to the extremum, from the best point so far, is
    taken to be less than twice the way from there up to the ends (of a smooth curve it soon is a small part of it).
    """
    sign = np.where(middle[:, -1] < 0, -1.0, 1.0)
    heights = np.array([sign * X[:, -1] for X in (left, middle, right)])
    X_best, f_best = middle.copy(), heights[1].copy()

    def height(u: Array, k: NDArray[np.intp]) -> Array:
        weights = [0.5 * u * (u - 1.0), (1.0 - u) * (1.0 + u), 0.5 * u * (u + 1.0)]
        X, ok = _between(balance, [left[k], middle[k], right[k]], weights, right[k] - left[k])
        f = np.where(ok, sign[k] * X[:, -1], np.inf)
        better = f < f_best[k]
        X_best[k[better]], f_best[k[better]] = X[better], f[better]
        return f

    places = np.repeat([[-1.0], [0.0], [1.0]], len(left), axis=1)
    least(height, places, heights, partial(_within_reach, reach=2.0, narrowest=1e-9))
    turned = np.flatnonzero(f_best < 0)
    return [pair for i in turned for pair in ((left[i], X_best[i]), (X_best[i], right[i]))]


def _close(balance: Balance, start: Array, end: Array) -> tuple[Array, Array]:
    """One limit cycle between each pair of points on either side of lambda = 1; points where there is none."""
    chord = end - start
    place = start[:, -1] / (start[:, -1] - end[:, -1])
    X, ok = _at_one(balance, start + place[:, None] * chord)
    # What Newton's method finds at once counts where it lies between the two: beyond them there may be another cycle.
    across = _weigh(balance, start, chord)
    place = ((X - start) * across).sum(-1) / (chord * across).sum(-1)
    away = np.abs(X - start - place[:, None] * chord)[:, :2].max(-1)
    ok &= (place >= 0.0) & (place <= 1.0) & (away <= np.abs(chord)[:, :2].max(-1))
    near = _along(balance, start[~ok], end[~ok])
    solved, found = _at_one(balance, near)
    return np.concatenate([X[ok], solved[found]]), near[~found]


def _along(balance: Balance, start: Array, end: Array) -> Array:
    """Points next to lambda = 1 between pairs on either side of it, by steps along the curve that joins them.

    Each step is begun between the nearest two points of the curve, so that Newton's method needs to reach no further
    than these are apart. Where it fails it is begun nearer to one of them: between is a kink, or a turn.
    """
    low, high = start.copy(), end.copy()
    weight, before = np.ones((2, len(start))), np.zeros(len(start))
    failed, done = np.zeros(len(start), int), np.zeros(len(start), bool)
    for _ in range(_STEPS_ALONG):
        k = np.flatnonzero(~done & (failed < _MOST_FAILURES))
        if not k.size:
            break
        f_low, f_high = weight[0, k] * low[k, -1], weight[1, k] * high[k, -1]
        u = np.clip(f_low / (f_low - f_high), 0.02, 0.98)
        # A half, then nearer and nearer to either end.
        nearer = 0.5 ** ((failed[k] + 2) // 2)
        u = np.where(failed[k] == 0, u, np.where(failed[k] % 2 == 1, nearer, 1.0 - nearer))
        chord = high[k] - low[k]
        X, ok = _between(balance, [low[k], high[k]], [1.0 - u, u], chord)
        ok &= np.abs(X - low[k] - u[:, None] * chord)[:, :2].max(-1) <= np.abs(chord)[:, :2].max(-1)
        failed[k] = np.where(ok, 0, failed[k] + 1)
        left = (X[:, -1] < 0) == (low[k, -1] < 0)
        low[k[ok & left]], high[k[ok & ~left]] = X[ok & left], X[ok & ~left]
        # The Illinois rule halves the value at an end that stays twice; else regula falsi stalls where lambda bends.
        side = np.where(left, -1.0, 1.0)
        twice = ok & (side == before[k])
        weight[0, k] = np.where(ok & left, 1.0, np.where(twice & ~left, 0.5 * weight[0, k], weight[0, k]))
        weight[1, k] = np.where(ok & ~left, 1.0, np.where(twice & left, 0.5 * weight[1, k], weight[1, k]))
        before[k] = np.where(ok, side, before[k])
        done[k] = (np.abs(high[k] - low[k])[:, :2].max(-1) < 1e-9) | (ok & (np.abs(X[:, -1]) < 1e-9))
    return np.where((np.abs(low[:, -1]) < np.abs(high[:, -1]))[:, None], low, high)


def polish(balance: Balance, X: Array) -> Array:
    """Newton at lambda = 1; points that do not converge or run away are dropped."""
    out, ok = _at_one(balance, X)
    return out[ok]


def _at_one(balance: Balance, X: Array) -> tuple[Array, NDArray]:
    """Points (n, 3 m + 1) after Newton's method at lambda = 1, and which have converged nearby."""
    start = X.copy()
    start[:, -1] = 0.0
    normal = np.zeros_like(X)
    normal[:, -1] = 1.0
    out, ok = newton(balance, start, normal, 20)
    return out, ok & (np.abs(out - start)[:, :2].max(-1, initial=0.0) < 0.3)


def distinct(balance: Balance, X: Array, tolerance: float = 1e-7) -> Array:
    """Each limit cycle once, in ascending order of amplitude at the pivot."""
    m, kept = balance.m, []
    left = X[np.argsort(X[:, 0], kind="stable")]
    while len(left):
        first, left = left[0], left[1:]
        kept.append(first)
        scale = np.ones_like(left)
        scale[:, 2 * m : 3 * m] = np.exp(left[:, balance.places])
        left = left[~(np.abs(_wrapped(left - first, m) / scale)[:, :-1].max(-1) < tolerance)]
    return np.array(kept).reshape(-1, X.shape[1])


def _wrapped(difference: Array, m: int) -> Array:
    out = difference.copy()
    out[:, 3 : 2 * m : 2] = np.angle(np.exp(1j * out[:, 3 : 2 * m : 2]))
    return out


def up_to_zero(
    balance: Balance, line: Array, loop_gain: Array, omega: float, gain: float
) -> Iterator[tuple[Array, Array]]:
    """Stretches of a branch of the bias on which the loop gain is positive, each with points towards where it ends.

    A gain may fall from above one through zero within a step of the grid: that of friction where a sine just reaches
    rest.
    """

    def at(points: Array) -> Array:
        N = balance.evaluate(points[:, :1], points[:, 1:], np.full(len(points), omega))[1][:, 0]
        return np.asarray(N.real * gain, float)

    for piece in stretches(loop_gain > 0):
        points, ends = [line[piece]], [(piece.start, piece.start - 1), (piece.stop - 1, piece.stop)]
        for inner, outer in ends:
            if 0 <= outer < len(line) and loop_gain[outer] <= 0.0:
                way, low, high = line[outer] - line[inner], 0.0, 1.0
                for _ in range(_HALVINGS):
                    middle = 0.5 * (low + high)
                    low, high = (middle, high) if at(line[[inner]] + middle * way)[0] > 0.0 else (low, middle)
                shares = low * (1.0 - 0.5 ** np.arange(1, _HALVINGS // 2))[:: 1 if outer > inner else -1]
                more = line[inner] + shares[:, None] * way
                points = [*points, more] if outer > inner else [more, *points]
        joined = np.concatenate(points)
        values = at(joined)
        for part in stretches(values > 0):
            yield joined[part], values[part]
