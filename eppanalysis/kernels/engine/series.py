"""Compiled: Taylor series of the state in one mode, and the first rise of a guard through zero along it.

Series are scaled to the step: ``x(t + u h) = sum X[k] u**k`` with u in [0, 1].
"""

import numpy as np

from eppanalysis.kernels.compiling import njit
from eppanalysis.kernels.engine.curves import CUBE, EXPONENTIAL, SINE, SQUARE, curve_term, has_fallen
from eppanalysis.kernels.engine.flow import rate_from, rate_of, size_of_rate
from eppanalysis.kernels.engine.tables import HOT, INLINE
from eppanalysis.kernels.simd.vectors import (
    any_above,
    dot,
    padded,
    rises,
    row_sum,
    row_sum_from,
    take_larger,
    value_and_slope,
)

ORDER = 32
EPS = 2.220446049250313e-16
DELAY_LINE = EXPONENTIAL + 1
#: Order up to which the terms of a series that goes far are not looked at.
_SOON = 8
#: Weights of a guard's terms in its rise behind the start, and in its second derivative at 1.
AFTER = np.where(np.arange(padded(ORDER + 1)) > 0, 1.0, 0.0)
CURVATURE = np.arange(padded(ORDER + 1)) * (np.arange(padded(ORDER + 1)) - 1.0)
MINUS_CURVATURE = -CURVATURE


@njit(**INLINE)
def expand(model, compiled, q, x, f, H, h, largest, small, X, Sg, arg, aux):
    """Fill X with the series of the state from x over the step h, and Sg with those of the smooth channels.

    `f` is the constant part of the rate (from the memory values). Delay channels must be in Sg already. Returns the
    order at which two terms in a row are below the rounding of every state's own size (or of a trace of its size over
    the run); -1 when that is not reached.
    """
    S = compiled.S[q]
    n, n_s = S.shape
    for i in range(n):
        X[0, i] = x[i]
        # A state that passes zero has no size there; without a trace of its largest the order would rise for nothing.
        small[i] = 0.5 * EPS * max(abs(x[i]), 1e-2 * largest[i])
    if n_s == 0 and compiled.row_end.shape[1] == 0:
        return _expand_linear(compiled.M[q], compiled.M_twice[q], f, h, small, X)
    below = 0
    for k in range(ORDER):
        for j in range(n_s):
            if model.smooth_kind[j] != DELAY_LINE:
                smooth_term(model, j, k, X, H, Sg, arg, aux)
        factor = h / (k + 1)
        if k == 0:
            rate_from(compiled, q, f, X[0], h, X[1])
        else:
            rate_of(compiled, q, X[k], factor, X[k + 1])
        for j in range(n_s):
            for i in range(n):
                X[k + 1, i] += factor * S[i, j] * Sg[k, j]
        # Of what moves at the pace of its step the first terms are not small.
        over = n_s == 0 and k < _SOON or any_above(X[k + 1], 1.0, small)
        for j in range(n_s):
            kind, scale = model.smooth_kind[j], model.smooth_scale[j]
            over = over or not has_fallen(kind, j, k, 0.25 * EPS, scale, Sg, arg, aux)
        below = 0 if over else below + 1
        # One small term proves nothing: of a motion that begins at its turn every other one is zero.
        if below == 2:
            for j in range(n_s):
                if model.smooth_kind[j] != DELAY_LINE:
                    smooth_term(model, j, k + 1, X, H, Sg, arg, aux)
            return k + 1
    return -1


@njit(**INLINE)
def _expand_linear(M, M_twice, f, h, small, X):
    """As `expand`, without smooth channels: odd and even orders beside each other, two products at a time."""
    row_sum_from(f, M, X[0], h, X[1])
    row_sum(M, X[1], 0.5 * h, X[2])
    # By M^2 each order needs the last but one: neither of the two products waits for the other.
    for k in range(1, ORDER - 2, 2):
        row_sum(M_twice, X[k], h * h / ((k + 1) * (k + 2)), X[k + 2])
        row_sum(M_twice, X[k + 1], h * h / ((k + 2) * (k + 3)), X[k + 3])
        if not any_above(X[k + 2], 1.0, small) and not any_above(X[k + 3], 1.0, small):
            return k + 3
    return -1


@njit(**INLINE)
def argument(rows, j, k, X, H, Sg):
    """Coefficient k of what the rows of channel j make of state, memory and the channels before it."""
    a = 0.0
    for i in range(rows.smooth_x.shape[1]):
        a += rows.smooth_x[j, i] * X[k, i]
    if k == 0:
        for i in range(H.size):
            a += rows.smooth_H[j, i] * H[i]
    for i in range(j):
        a += rows.smooth_s[j, i] * Sg[k, i]
    return a


@njit(**HOT)
def smooth_term(model, j, k, X, H, Sg, arg, aux):
    """Coefficient k of smooth channel j by the recurrences of Taylor arithmetic."""
    arg[k, j] = argument(model, j, k, X, H, Sg)
    scale = model.smooth_scale[j]
    kind = model.smooth_kind[j]
    if kind == SINE:
        _sine_term(j, k, scale, Sg, arg, aux)
    elif kind == CUBE:
        # Products of series: the square is kept in `aux`, and the cube is its product with the argument.
        square, cube = 0.0, 0.0
        for i in range(k + 1):
            square += arg[i, j] * arg[k - i, j]
        aux[k, j] = square
        for i in range(k + 1):
            cube += aux[i, j] * arg[k - i, j]
        Sg[k, j] = scale * cube
    elif kind >= SQUARE:
        curve_term(kind, j, k, scale, Sg, arg, aux)
    else:
        noise = 0.0
        for i in range(model.smooth_x.shape[1]):
            noise += abs(model.smooth_x[j, i] * X[0, i])
        for i in range(H.size):
            noise += abs(model.smooth_H[j, i] * H[i])
        for i in range(j):
            noise += abs(model.smooth_s[j, i] * Sg[0, i])
        _reciprocal_term(j, k, scale, 64.0 * EPS * noise, Sg, arg, aux)


@njit(**HOT)
def _sine_term(j, k, scale, Sg, arg, aux):
    """Sine (in Sg) and cosine (in aux), both scaled."""
    if k == 0:
        Sg[0, j] = scale * np.sin(arg[0, j])
        aux[0, j] = scale * np.cos(arg[0, j])
        return
    # sin' = cos a' and cos' = -sin a', coefficient by coefficient.
    s, c = 0.0, 0.0
    for i in range(1, k + 1):
        s += i * arg[i, j] * aux[k - i, j]
        c -= i * arg[i, j] * Sg[k - i, j]
    Sg[k, j] = s / k
    aux[k, j] = c / k


@njit(**HOT)
def _reciprocal_term(j, k, scale, noise, Sg, arg, aux):
    """scale/(1 + |a|); within a mode the argument keeps its sign, which near zero its rate tells.

    `noise` is the rounding of the terms of which the argument is made.
    """
    if k == 0:
        Sg[0, j] = scale / (1.0 + abs(arg[0, j]))
        aux[0, j] = 1.0 if arg[0, j] >= 0 else -1.0
        return
    # From rest the first coefficient that does not vanish gives the sign, for a speed and its rate may start at zero.
    before = 0.0
    for i in range(k):
        before = max(before, abs(arg[i, j]))
    if before <= 1e-9 * abs(arg[k, j]) or before <= noise < abs(arg[k, j]):
        aux[0, j] = 1.0 if arg[k, j] > 0 else -1.0
    # y (1 + |a|) = scale: of a product that is constant all coefficients but the first vanish.
    v = 0.0
    for i in range(1, k + 1):
        v -= aux[0, j] * arg[i, j] * Sg[k - i, j]
    Sg[k, j] = v / (1.0 + abs(arg[0, j]))


@njit(**INLINE)
def guard_series(compiled, q, g, X, last, Sg, constant, h, p):
    """Series of guard g of combination q into p, zero behind its order `last`; a guard on rates has one order less."""
    row, place = compiled.ga[q, g], compiled.ga_place[q, g]
    for k in range(p.size):
        p[k] = 0.0
    for c in range(compiled.ga_count[q, g]):
        i = place[c]
        a = row[i]
        for k in range(last + 1):
            p[k] += a * X[k, i]
    if compiled.on_rate[q, g]:
        for k in range(last):
            p[k] += dot(compiled.gb[q, g], X[k + 1]) * (k + 1) / h
    if compiled.smooth_guard[q, g]:
        for j in range(Sg.shape[1]):
            for k in range(last + 1):
                p[k] += compiled.gs[q, g, j] * Sg[k, j]
            for k in range(last):
                p[k] += compiled.gt[q, g, j] * Sg[k + 1, j] * (k + 1) / h
    p[0] += constant


@njit(**INLINE)
def term_sizes(compiled, q, X, Sg, H, h, recent, clock, first, last, Y, wide):
    """Rows first..last of Y: sizes of the terms that were added up to make the rows of X.

    Rounding comes from these, not from what is left after they cancel; `recent` holds the sizes from which the state at
    the start was computed. What comes out of the past comes with the rounding of the time at which it is read: `clock`
    is that time in steps, 0 where nothing is delayed. `wide` is workspace.
    """
    n, n_s = compiled.N.shape[1], Sg.shape[1]
    if first == 0:
        take_larger(Y[0], X[0], recent)
    for k in range(max(first, 1), last + 1):
        take_larger(wide, X[k - 1], Y[k - 1])
        size_of_rate(compiled, q, wide, h / k, Y[k])
        if k == 1:
            for i in range(n):
                v = 0.0
                for j in range(H.size):
                    v += abs(compiled.N[q, i, j] * H[j])
                Y[1, i] += v * h
        for j in range(n_s):
            for i in range(n):
                Y[k, i] += abs(compiled.S[q, i, j]) * (abs(Sg[k - 1, j]) + clock * k * abs(Sg[k, j])) * h / k


@njit(**INLINE)
def guard_noise(compiled, q, g, k, Sg, H, h, Y):
    """Rounding noise of term k of a guard's series, from the sizes in Y."""
    v = dot(compiled.ga_size[q, g], Y[k])
    if compiled.on_rate[q, g]:
        v += dot(compiled.gb_size[q, g], Y[k + 1]) * (k + 1) / h
    for j in range(Sg.shape[1]):
        v += abs(compiled.gs[q, g, j] * Sg[k, j]) + abs(compiled.gt[q, g, j] * Sg[k + 1, j]) * (k + 1) / h
    if k == 0:
        for j in range(H.size):
            v += abs(compiled.gH[q, g, j] * H[j])
    return 64.0 * EPS * v


@njit(**INLINE)
def may_rise(p):
    """Cheap test of a series that starts below zero: False proves that it stays there on [0, 1]."""
    return p[0] + rises(p, AFTER) > 0.0


@njit(**HOT)
def first_rise(p, tolerance):
    """First u in (0, 1] where ``sum p[k] u**k`` rises to zero from a negative start; 2.0 when nowhere.

    Each step goes to the first zero of a quadratic that lies above the series (its curvature is a bound on [u, 1]),
    so no zero can be passed; once Newton's condition holds the zero is unique ahead and Newton finishes.
    """
    # Sums over the terms that rise bound p'' above, and -p'', on all of [0, 1] (docs/theory/engine.md, Series step).
    over, under = rises(p, CURVATURE), rises(p, MINUS_CURVATURE)
    u, v, d = 0.0, p[0], p[1]
    for _ in range(1000):
        if v >= 0.0 or (v >= -tolerance and d >= 0.0):
            return u
        rest = 1.0 - u
        if v + rest * (d + 0.5 * over * rest) < 0.0:
            return 2.0
        # Kantorovich's condition, twice as strict as he needs it: only downward curvature bends away from the zero.
        if d > 0.0 and under * -v < 0.25 * d * d and -2.0 * v <= d * rest:
            return _newton(p, u, v, d)
        root = np.sqrt(d * d - 2.0 * over * v)
        if d < 0.0:
            # Just beneath zero, and falling: the sum of slope and root would be rounding, or none at all.
            if over <= 0.0:
                return 2.0
            u += (root - d) / over
        else:
            if d + root <= 0.0:
                return 2.0
            u += -2.0 * v / (d + root)
        if u > 1.0:
            return 2.0
        if not u > 0.0:  # a bound beyond all range: no step is safe, however short
            return 0.0
        v, d = value_and_slope(p, u)
        d /= u
    return u


@njit(**HOT)
def _newton(p, u, v, d):
    """Finish from a point where the zero ahead is unique and near."""
    for _ in range(12):
        if d == 0.0:
            break
        step = -v / d
        u += step
        if abs(step) <= 1e-17 + 1e-16 * u or not u > 0.0:
            break
        v, d = value_and_slope(p, u)
        d /= u
    return u if u <= 1.0 else 2.0
