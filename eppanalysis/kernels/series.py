"""Compiled: Taylor series of the state in one mode, and the first rise of a guard through zero along it.

Series are scaled to the step: ``x(t + u h) = sum X[k] u**k`` with u in [0, 1].
"""

from __future__ import annotations

import numpy as np
from numba import njit

from eppanalysis.kernels.modes import HOT, INLINE

ORDER = 32
EPS = 2.220446049250313e-16
DELAY_LINE = 10


@njit(**INLINE)
def state_at(X, last, u, out):
    """Evaluate the series X, of order `last`, at u."""
    n = out.size
    for i in range(n):
        out[i] = X[last, i]
    for k in range(last - 1, -1, -1):
        for i in range(n):
            out[i] = out[i] * u + X[k, i]


@njit(**INLINE)
def four_at(X, last, i, u0, u1, u2, u3):
    """Column i of the series X, of order `last`, at four places."""
    v0 = v1 = v2 = v3 = X[last, i]
    for k in range(last - 1, -1, -1):
        c = X[k, i]
        v0, v1, v2, v3 = v0 * u0 + c, v1 * u1 + c, v2 * u2 + c, v3 * u3 + c
    return v0, v1, v2, v3


@njit(**INLINE)
def rate_at(X, last, u, h, out):
    """Rate of the series X, of order `last` over the step h, at u."""
    n = out.size
    for i in range(n):
        out[i] = last * X[last, i]
    for k in range(last - 1, 0, -1):
        for i in range(n):
            out[i] = out[i] * u + k * X[k, i]
    for i in range(n):
        out[i] /= h


@njit(**INLINE)
def expand(model, slots, q, x, f, H, h, largest, small, X, Sg, arg, aux):
    """Fill X with the series of the state from x over the step h, and Sg with those of the smooth channels.

    `f` is the constant part of the rate (from the held values). Delay channels must be in Sg already. Returns the order
    at which two terms in a row are below the rounding of every state's own size (or of a trace of its size over the
    run); -1 when that is not reached.
    """
    n, n_s = x.size, Sg.shape[1]
    count, place, value, S = slots.M_count[q], slots.M_place[q], slots.M_value[q], slots.S[q]
    for i in range(n):
        X[0, i] = x[i]
        small[i] = 0.5 * EPS * max(abs(x[i]), 1e-2 * largest[i])
    below = 0
    for k in range(ORDER):
        for j in range(n_s):
            if model.smooth_kind[j] != DELAY_LINE:
                _smooth_term(model, j, k, X, H, Sg, arg, aux)
        factor = h / (k + 1)
        over = 0
        for i in range(n):
            v = f[i] if k == 0 else 0.0
            for c in range(count[i]):
                v += value[i, c] * X[k, place[i, c]]
            for j in range(n_s):
                v += S[i, j] * Sg[k, j]
            v *= factor
            X[k + 1, i] = v
            over += abs(v) > small[i]
        for j in range(n_s):
            over += abs(Sg[k, j]) > 0.25 * EPS * abs(Sg[0, j])
        below = 0 if over else below + 1
        if below == 2:
            for j in range(n_s):
                if model.smooth_kind[j] != DELAY_LINE:
                    _smooth_term(model, j, k + 1, X, H, Sg, arg, aux)
            return k + 1
    return -1


@njit(**INLINE)
def combine(rows, weights, out):
    """out = weights @ rows, four rows at a time."""
    n, size = weights.size, out.size
    for r in range(size):
        out[r] = 0.0
    i = 0
    while i + 4 <= n:
        a, b, c, d = weights[i], weights[i + 1], weights[i + 2], weights[i + 3]
        ra, rb, rc, rd = rows[i], rows[i + 1], rows[i + 2], rows[i + 3]
        for r in range(size):
            out[r] += ra[r] * a + rb[r] * b + rc[r] * c + rd[r] * d
        i += 4
    while i < n:
        a, ra = weights[i], rows[i]
        for r in range(size):
            out[r] += ra[r] * a
        i += 1


@njit(**HOT)
def _smooth_term(model, j, k, X, H, Sg, arg, aux):
    """Coefficient k of smooth channel j by the recurrences of Taylor arithmetic."""
    a = 0.0
    for i in range(model.smooth_x.shape[1]):
        a += model.smooth_x[j, i] * X[k, i]
    if k == 0:
        for i in range(H.size):
            a += model.smooth_H[j, i] * H[i]
    arg[k, j] = a
    scale = model.smooth_scale[j]
    kind = model.smooth_kind[j]
    if kind == 0:
        _sine_term(j, k, scale, Sg, arg, aux)
    elif kind == 1:
        square, cube = 0.0, 0.0
        for i in range(k + 1):
            square += arg[i, j] * arg[k - i, j]
        aux[k, j] = square
        for i in range(k + 1):
            cube += aux[i, j] * arg[k - i, j]
        Sg[k, j] = scale * cube
    else:
        _reciprocal_term(j, k, scale, Sg, arg, aux)


@njit(**HOT)
def _sine_term(j, k, scale, Sg, arg, aux):
    """Sine (in Sg) and cosine (in aux), both scaled."""
    if k == 0:
        Sg[0, j] = scale * np.sin(arg[0, j])
        aux[0, j] = scale * np.cos(arg[0, j])
        return
    s, c = 0.0, 0.0
    for i in range(1, k + 1):
        s += i * arg[i, j] * aux[k - i, j]
        c -= i * arg[i, j] * Sg[k - i, j]
    Sg[k, j] = s / k
    aux[k, j] = c / k


@njit(**HOT)
def _reciprocal_term(j, k, scale, Sg, arg, aux):
    """scale/(1 + |a|); within a mode the argument keeps its sign, which near zero its rate tells."""
    if k == 0:
        Sg[0, j] = scale / (1.0 + abs(arg[0, j]))
        aux[0, j] = 1.0 if arg[0, j] >= 0 else -1.0
        return
    # From rest the sign is that of the first coefficient that does not vanish: a speed and its rate may start at zero.
    before = 0.0
    for i in range(k):
        before = max(before, abs(arg[i, j]))
    if before <= 1e-9 * abs(arg[k, j]):
        aux[0, j] = 1.0 if arg[k, j] > 0 else -1.0
    v = 0.0
    for i in range(1, k + 1):
        v -= aux[0, j] * arg[i, j] * Sg[k - i, j]
    Sg[k, j] = v / (1.0 + abs(arg[0, j]))


@njit(**INLINE)
def travel(X, last, D, V):
    """Bounds on how far each state can move over the step (D), and its rate in units of the step (V)."""
    n = D.size
    for i in range(n):
        D[i] = abs(X[1, i])
        V[i] = 0.0
    for k in range(2, last + 1):
        for i in range(n):
            v = abs(X[k, i])
            D[i] += v
            V[i] += k * v


@njit(**INLINE)
def guard_value(slots, q, g, X, Sg, constant, h):
    """Value of guard g at the start of the step."""
    v = constant
    for c in range(slots.ga_count[q, g]):
        v += slots.ga_value[q, g, c] * X[0, slots.ga_place[q, g, c]]
    for c in range(slots.gb_count[q, g]):
        v += slots.gb_value[q, g, c] * X[1, slots.gb_place[q, g, c]] / h
    if slots.smooth_guard[q, g]:
        for j in range(Sg.shape[1]):
            v += slots.gs[q, g, j] * Sg[0, j] + slots.gt[q, g, j] * Sg[1, j] / h
    return v


@njit(**INLINE)
def guard_travel(slots, q, g, D, V, h):
    """Bound on how far guard g can move over the step; infinite where a smooth channel acts on it."""
    if slots.smooth_guard[q, g]:
        return np.inf
    v = 0.0
    for c in range(slots.ga_count[q, g]):
        v += abs(slots.ga_value[q, g, c]) * D[slots.ga_place[q, g, c]]
    for c in range(slots.gb_count[q, g]):
        v += abs(slots.gb_value[q, g, c]) * V[slots.gb_place[q, g, c]] / h
    return v


@njit(**INLINE)
def guard_series(slots, q, g, X, last, Sg, constant, h, p):
    """Series p of guard g of slot q, of order `last`; a guard on rates has one order less."""
    rates = slots.gb_count[q, g]
    smooth = slots.smooth_guard[q, g]
    n_s = Sg.shape[1]
    for k in range(last + 1):
        v = 0.0
        for c in range(slots.ga_count[q, g]):
            v += slots.ga_value[q, g, c] * X[k, slots.ga_place[q, g, c]]
        if smooth:
            for j in range(n_s):
                v += slots.gs[q, g, j] * Sg[k, j]
        if k < last and (rates or smooth):
            r = 0.0
            for c in range(rates):
                r += slots.gb_value[q, g, c] * X[k + 1, slots.gb_place[q, g, c]]
            if smooth:
                for j in range(n_s):
                    r += slots.gt[q, g, j] * Sg[k + 1, j]
            v += r * (k + 1) / h
        p[k] = v
    p[0] += constant


@njit(**INLINE)
def term_sizes(slots, q, X, Sg, H, h, recent, first, last, Y):
    """Rows first..last of Y: sizes of the terms that were added up to make the rows of X.

    Rounding comes from these, not from what is left after they cancel; `recent` holds the sizes from which the state at
    the start was computed.
    """
    n, n_s = Y.shape[1], Sg.shape[1]
    count, place, value = slots.M_count[q], slots.M_place[q], slots.M_value[q]
    if first == 0:
        for i in range(n):
            Y[0, i] = max(abs(X[0, i]), recent[i])
    for k in range(max(first, 1), last + 1):
        for i in range(n):
            v = 0.0
            for c in range(count[i]):
                j = place[i, c]
                v += abs(value[i, c]) * max(abs(X[k - 1, j]), Y[k - 1, j])
            if k == 1:
                for j in range(H.size):
                    v += abs(slots.N[q, i, j] * H[j])
            for j in range(n_s):
                v += abs(slots.S[q, i, j] * Sg[k - 1, j])
            Y[k, i] = v * h / k


@njit(**INLINE)
def guard_noise(slots, q, g, k, Sg, H, h, Y):
    """Rounding noise of term k of a guard's series, from the sizes in Y."""
    v = 0.0
    for c in range(slots.ga_count[q, g]):
        v += abs(slots.ga_value[q, g, c]) * Y[k, slots.ga_place[q, g, c]]
    for c in range(slots.gb_count[q, g]):
        v += abs(slots.gb_value[q, g, c]) * Y[k + 1, slots.gb_place[q, g, c]] * (k + 1) / h
    for j in range(Sg.shape[1]):
        v += abs(slots.gs[q, g, j] * Sg[k, j]) + abs(slots.gt[q, g, j] * Sg[k + 1, j]) * (k + 1) / h
    if k == 0:
        for j in range(H.size):
            v += abs(slots.gH[q, g, j] * H[j])
    return 64.0 * EPS * v


@njit(**INLINE)
def may_rise(p, last, margin):
    """Cheap test on [0, 1]: False proves that p stays below -margin."""
    v = p[0]
    for k in range(1, last + 1):
        if p[k] > 0.0:
            v += p[k]
    return v > -margin


@njit(**HOT)
def first_rise(p, first, order, tolerance):
    """First u in (0, 1] where ``sum p[first + k] u**k`` rises to zero from a negative start; 2.0 when nowhere.

    Each step goes to the first zero of a quadratic that lies above the series (its curvature is a bound on [u, 1]),
    so no zero can be passed; once Newton's condition holds the zero is unique ahead and Newton finishes.
    """
    over, under = 0.0, 0.0
    last = order - first
    for k in range(2, last + 1):
        c = k * (k - 1) * p[first + k]
        if c > 0.0:
            over += c
        else:
            under -= c
    u, v, d = 0.0, p[first], p[first + 1] if last > 0 else 0.0
    for _ in range(1000):
        if v >= 0.0 or (v >= -tolerance and d >= 0.0):
            return u
        rest = 1.0 - u
        if v + rest * (d + 0.5 * over * rest) < 0.0:
            return 2.0
        if d > 0.0 and under * -v < 0.25 * d * d and -2.0 * v <= d * rest:
            return _newton(p, first, last, u, v, d)
        below = d + np.sqrt(d * d - 2.0 * over * v)
        if below <= 0.0:
            return 2.0
        u += -2.0 * v / below
        if u > 1.0:
            return 2.0
        v, d = 0.0, 0.0
        for k in range(last, -1, -1):
            d = d * u + v
            v = v * u + p[first + k]
    return u


@njit(**HOT)
def _newton(p, first, last, u, v, d):
    """Finish from a point where the zero ahead is unique and near."""
    for _ in range(12):
        step = -v / d
        u += step
        if abs(step) <= 1e-17 + 1e-16 * u:
            break
        v, d = 0.0, 0.0
        for k in range(last, -1, -1):
            d = d * u + v
            v = v * u + p[first + k]
    return u if u <= 1.0 else 2.0
