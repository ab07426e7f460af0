"""Compiled: the motion along one arc of an orbit, and its derivative with respect to the start.

Without smooth channels the flow is a matrix exponential; with them it is a Taylor series, and so is its derivative. The
derivative by a parameter is one more column, in forward mode: the variational equation with what the parameter changes.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from eppanalysis.kernels.compiling import KERNEL, PART, njit
from eppanalysis.kernels.engine.curves import (
    CUBE,
    EXPONENTIAL,
    RECIPROCAL,
    SINE,
    SQUARE,
    TANH,
    curve,
    curve_slope_term,
    hides,
)
from eppanalysis.kernels.engine.flow import flow, growth_rate
from eppanalysis.kernels.engine.series import DELAY_LINE, EPS, ORDER, argument, smooth_term
from eppanalysis.kernels.filling import accumulate, fill, fill_rows, largest
from eppanalysis.kernels.simd.vectors import padded

#: Series along one arc with smooth channels, at most: some tenths of a second.
MOST_SERIES = 10_000


class Channels(NamedTuple):
    """The smooth channels of a model, under the names that they have there.

    Kernels take None where none acts on any arc: what handles them is not compiled then.
    """

    smooth_kind: np.ndarray  # (s,) int
    smooth_x: np.ndarray  # (s, n)
    smooth_H: np.ndarray  # (s, H)
    smooth_s: np.ndarray  # (s, s): on those before it
    smooth_scale: np.ndarray  # (s,)
    sense: np.ndarray  # (p, s): sign of the argument on each arc, for channels that depend on its magnitude


class Numbers(NamedTuple):
    """What the motion along one arc depends on, or the derivatives of it by a parameter."""

    F: np.ndarray  # (n, N)
    S: np.ndarray  # (n, s)
    smooth_x: np.ndarray  # (s, n)
    smooth_H: np.ndarray  # (s, H)
    smooth_s: np.ndarray  # (s, s)
    smooth_scale: np.ndarray  # (s,)


@njit(**PART)
def numbers_of(channels, F, S):
    """The numbers of an arc; where no derivative by a parameter is asked for they stand in for it, unread."""
    if channels is None:
        return None
    return Numbers(F, S, channels.smooth_x, channels.smooth_H, channels.smooth_s, channels.smooth_scale)


@njit(**KERNEL)
def room(F):
    """Room for the flow of the states that move of themselves or one another; those behind are clocks.

    With dead time an orbit has a clock for each switch on its way: a hundred of them beside two states of a plant.
    """
    p, n, _ = F.shape
    moving = 1
    for a in range(p):
        for i in range(n):
            for j in range(n):
                if F[a, i, j] != 0.0:
                    moving = max(moving, i + 1, j + 1)
    return np.zeros((8, padded(moving), padded(moving)))


@njit(**PART)
def affine_flow(F, y, tau, end, Phi, square):
    """State at the end of an affine arc, and its derivative; `square` is what `room` gave."""
    n, N = F.shape
    moving = min(n, square.shape[1])
    M, integral, power = square[0], square[1], square[2]
    for i in range(moving):
        for j in range(moving):
            M[i, j] = F[i, j]
    if tau == 0.0:
        integral[:, :] = 0.0
        fill_rows(power, np.eye(power.shape[0]))
    else:
        rate = growth_rate(M, square[3], square[4])
        flow(M, tau, rate, integral, power, square[5], square[6], square[7])
    Phi[:, :] = 0.0
    for i in range(N):
        end[i] = y[i]
        Phi[i, i] = 1.0
    for i in range(moving):
        # The integral of exp(F s), times the rate, is added to y: near rest and for integrators nothing cancels.
        v = 0.0
        for j in range(N):
            v += F[i, j] * y[j]
        for k in range(moving):
            end[k] += integral[k, i] * v
        for j in range(moving):
            Phi[i, j] = power[i, j]
        for k in range(moving):
            f = integral[i, k]
            if f != 0.0:
                for j in range(n, N):
                    Phi[i, j] += f * F[k, j]
    for i in range(moving, n):
        for j in range(n, N):
            end[i] += tau * F[i, j] * y[j]
            Phi[i, j] = tau * F[i, j]


@njit(**PART)
def affine_change(F, by, y, tau, change, end):
    """Change of the state along an affine arc with a parameter, from that at its begin; `by` holds the derivatives.

    The rate of change moves with the state's rate by the exponential of [[F, 0], [by, F]], which holds the Frechet
    derivative of the exponential of F. Where the parameter moves constants alone, F stands there by itself.
    """
    n, N = F.shape
    moving, own = 1, 0
    for i in range(n):
        for j in range(n):
            if F[i, j] != 0.0 or by[i, j] != 0.0:
                moving = max(moving, i + 1, j + 1)
            own = 1 if by[i, j] != 0.0 else own
    fill(end, change)
    if tau == 0.0:
        return
    own *= moving
    square = np.zeros((8, padded(own + moving), padded(own + moving)))
    M, integral = square[0], square[1]
    rates = np.zeros(2 * n)
    for i in range(n):
        for j in range(N):
            rates[i] += F[i, j] * y[j]
            rates[n + i] += by[i, j] * y[j] + F[i, j] * change[j]
    for i in range(moving):
        for j in range(moving):
            M[i, j] = M[own + i, own + j] = F[i, j]
            if own:
                M[own + i, j] = by[i, j]
    flow(M, tau, growth_rate(M, square[3], square[4]), integral, square[2], square[5], square[6], square[7])
    for i in range(moving):
        for j in range(moving):
            end[i] += integral[own + i, own + j] * rates[n + j]
            if own:
                end[i] += integral[own + i, j] * rates[j]
    for i in range(moving, n):
        end[i] += tau * rates[n + i]


@njit(**PART)
def smooth_flow(channels, arc, F, S, y, tau, most, end, Phi, sigma, slope, by):
    """State at the end of an arc with smooth channels, its derivative, and there the channels with their slopes.

    The derivative Phi (N, N) is that by the state at the begin. With one more column (N, N + 1) it holds the change
    with a parameter of which `by` has the derivatives, too.

    Returns the number of series made. The end is not a number where it is not reached with `most` of them: the stiffer
    the motion, the shorter its series.
    """
    if channels is None:
        return 0
    sense = channels.sense[arc]
    n, N = F.shape
    n_s = S.shape[1]
    H = y[n:].copy()
    columns = Phi.shape[1]
    X, V = np.zeros((ORDER + 1, n)), np.zeros((ORDER + 1, n, columns))
    workspace = np.zeros((4, ORDER + 1, n_s))
    change = np.zeros((2, n_s, ORDER + 1, columns))
    square = np.zeros((3, padded(n), padded(n)))
    fill_rows(square[0, :n, :n], F)
    rate = growth_rate(square[0], square[1], square[2])
    x, P = y[:n].copy(), np.zeros((n, columns))
    for i in range(n):
        P[i, i] = 1.0
    done, d = 0.0, abs(tau)
    # Series are tried over times in which no power of F grows; longer ones would not converge to rounding.
    while rate * d > 1.0:
        d *= 0.5
    if tau < 0.0:
        d = -d
    longest, made, last = d, 0, False
    while not last:
        last = abs(done + d) >= abs(tau) * (1.0 - 1e-14)
        h = tau - done if last else d
        if made >= most or not abs(d) >= 1e-15 * abs(tau):
            x[:], P[:, :] = np.nan, np.nan
            break
        fill(X[0], x)
        fill_rows(V[0], P)
        made += 1
        holds = _series(channels, sense, F, S, H, h, X, V, workspace, change, by)
        if holds == 0:
            d, last = 0.5 * h, False
            continue
        _add_up(X, V)
        fill(x, X[ORDER])
        fill_rows(P, V[ORDER])
        X[ORDER], V[ORDER] = 0.0, 0.0
        done += h
        # Deep in saturation series are short near the switch alone, those of a power near rest: they grow behind it.
        if holds == 2 and abs(d) < abs(longest):
            d *= 2.0
    fill(end[:n], x)
    fill(end[n:], H)
    Phi[:, :] = 0.0
    fill_rows(Phi[:n], P)
    for i in range(n, N):
        Phi[i, i] = 1.0
    channels_at(channels, arc, x, H, sigma, slope)
    return made


@njit(**PART)
def _add_up(X, V):
    """Series of state and derivative at the end of their step, into the place of the last order; small terms first."""
    for k in range(ORDER - 1, -1, -1):
        accumulate(X[ORDER], 1.0, X[k])
        for i in range(X.shape[1]):
            accumulate(V[ORDER, i], 1.0, V[k, i])


@njit(**PART)
def _series(channels, sense, F, S, H, h, X, V, workspace, change, by):
    """Series of state and derivative over the step h, all but the last order.

    Returns 0 when they do not converge, 2 when they do over twice the step, too, else 1.
    """
    n, N = F.shape
    n_s = S.shape[1]
    Sg, arg, aux, slope = workspace[0], workspace[1], workspace[2], workspace[3]
    size = largest(X[:1]) + 1e-300
    size_v = largest(V[0, :, :N])
    for k in range(ORDER - 1):
        for j in range(n_s):
            if channels.smooth_kind[j] != DELAY_LINE:
                _channel_term(channels, sense, j, k, X, H, Sg, arg, aux, slope)
        factor = h / (k + 1)
        for i in range(n):
            v = 0.0
            for j in range(n):
                v += F[i, j] * X[k, j]
            if k == 0:
                for j in range(H.size):
                    v += F[i, n + j] * H[j]
            for j in range(n_s):
                v += S[i, j] * Sg[k, j]
            X[k + 1, i] = v * factor
        V[k + 1] = 0.0
        for i in range(n):
            for c in range(n):
                if F[i, c] != 0.0:
                    accumulate(V[k + 1, i], F[i, c], V[k, c])
            if k == 0:
                accumulate(V[1, i, n:N], 1.0, F[i, n:])
        if V.shape[2] > N:
            _rate_by(by, k, X, H, Sg, V)
        for j in range(n_s):
            if channels.smooth_kind[j] == DELAY_LINE:
                continue
            _change_term(channels, j, k, V, slope, change, N)
            if V.shape[2] > N:
                _channel_by(channels, by, j, k, X, H, Sg, slope, change)
            for i in range(n):
                accumulate(V[k + 1, i], S[i, j], change[1, j, k])
        for i in range(n):
            for j in range(V.shape[2]):
                V[k + 1, i, j] *= factor
    # Two terms: of an odd or even motion every other one is zero. The derivative by its own series is as exact as the
    # flow, so that Newton's method ends at rounding (docs/theory/exact_orbits.md, Closing an orbit).
    tail = largest(X[ORDER - 1 : ORDER]) + largest(X[ORDER - 2 : ORDER - 1])
    tail_v = largest(V[ORDER - 1, :, :N]) + largest(V[ORDER - 2, :, :N])
    if not (tail <= 0.5 * EPS * size and tail_v <= EPS * size_v and _ends(V, N)):
        return 0
    for j in range(n_s):
        kind = channels.smooth_kind[j]
        if TANH <= kind <= EXPONENTIAL:
            if hides(kind, j, ORDER - 2, EPS, channels.smooth_scale[j], Sg, arg, aux):
                return 0
    grown = 2.0**ORDER
    return 2 if tail * grown <= 0.5 * EPS * size and tail_v * grown <= EPS * size_v else 1


@njit(**PART)
def _ends(V, column):
    """Whether the series of the change with a parameter has ended, by its own size; where there is none it has."""
    size, tail = 0.0, 0.0
    if V.shape[2] > column:
        for k in range(ORDER):
            for i in range(V.shape[1]):
                size = max(size, abs(V[k, i, column]))
                if k >= ORDER - 2:
                    tail = max(tail, abs(V[k, i, column]))
    return tail <= EPS * size


@njit(**PART)
def _rate_by(by, k, X, H, Sg, V):
    """Add to coefficient k of the rate of change with a parameter what it changes itself, channels at their values."""
    n, last = X.shape[1], V.shape[2] - 1
    for i in range(n):
        v = 0.0
        for j in range(n):
            v += by.F[i, j] * X[k, j]
        if k == 0:
            for j in range(H.size):
                v += by.F[i, n + j] * H[j]
        for j in range(by.S.shape[1]):
            v += by.S[i, j] * Sg[k, j]
        V[k + 1, i, last] += v


@njit(**PART)
def _channel_by(channels, by, j, k, X, H, Sg, slope, change):
    """Add to coefficient k of the change of channel j what a parameter changes in its argument and in its scale."""
    last = change.shape[3] - 1
    change[0, j, k, last] += argument(by, j, k, X, H, Sg)
    # The convolution with the slope again, of the part that was added; all channels are proportional to their scale.
    change[1, j, k, last] = 0.0
    for c in range(k + 1):
        change[1, j, k, last] += slope[k - c, j] * change[0, j, c, last]
    if channels.smooth_scale[j] != 0.0:
        change[1, j, k, last] += by.smooth_scale[j] / channels.smooth_scale[j] * Sg[k, j]


@njit(**PART)
def _change_term(channels, j, k, V, slope, change, N):
    """Coefficient k of the derivatives of smooth channel j: of its argument, and of its value behind it.

    The chain rule on series: the channel's slope times the derivative of its argument, convolved.
    """
    n = V.shape[1]
    of_argument, of_value = change[0, j], change[1, j]
    of_argument[k] = 0.0
    of_value[k] = 0.0
    for i in range(n):
        accumulate(of_argument[k], channels.smooth_x[j, i], V[k, i])
    if k == 0:
        accumulate(of_argument[0, n:N], 1.0, channels.smooth_H[j])
    for i in range(j):
        if channels.smooth_s[j, i] != 0.0:
            accumulate(of_argument[k], channels.smooth_s[j, i], change[1, i, k])
    for c in range(k + 1):
        accumulate(of_value[k], slope[k - c, j], of_argument[c])


@njit(**PART)
def _channel_term(model, sense, j, k, X, H, Sg, arg, aux, slope):
    """Coefficient k of smooth channel j and of its derivative with respect to its argument."""
    kind, scale = model.smooth_kind[j], model.smooth_scale[j]
    if kind != RECIPROCAL:
        smooth_term(model, j, k, X, H, Sg, arg, aux)
        if kind >= SQUARE:
            slope[k, j] = curve_slope_term(kind, j, k, scale, Sg, arg, aux)
        else:
            slope[k, j] = aux[k, j] if kind == SINE else 3.0 * scale * aux[k, j]
        return
    # scale/(1 + s a), with the sign s of the mode: at breakaway the argument and its rate are both zero.
    arg[k, j] = argument(model, j, k, X, H, Sg)
    s = sense[j]
    v = scale if k == 0 else 0.0
    for i in range(1, k + 1):
        v -= s * arg[i, j] * Sg[k - i, j]
    Sg[k, j] = v / (1.0 + s * arg[0, j])
    v = 0.0
    for i in range(k + 1):
        v += Sg[i, j] * Sg[k - i, j]
    slope[k, j] = -s * v / scale if scale != 0.0 else 0.0


@njit(**PART)
def channels_at(model, arc, x, H, sigma, slope):
    """Values and slopes of the smooth channels at the end of an arc."""
    if model is None:
        return
    sense = model.sense[arc]
    for j in range(sigma.size):
        kind, scale = model.smooth_kind[j], model.smooth_scale[j]
        a = 0.0
        for i in range(x.size):
            a += model.smooth_x[j, i] * x[i]
        for i in range(H.size):
            a += model.smooth_H[j, i] * H[i]
        for i in range(j):
            a += model.smooth_s[j, i] * sigma[i]
        if kind == SINE:
            sigma[j], slope[j] = scale * np.sin(a), scale * np.cos(a)
        elif kind == CUBE:
            sigma[j], slope[j] = scale * a**3, 3.0 * scale * a * a
        elif SQUARE <= kind < DELAY_LINE:
            value, rate = curve(kind, a)
            sigma[j], slope[j] = scale * value, scale * rate
        elif kind != DELAY_LINE:
            sigma[j] = scale / (1.0 + sense[j] * a)
            slope[j] = -sense[j] * sigma[j] * sigma[j] / scale if scale != 0.0 else 0.0


@njit(**PART)
def rate_at(F, S, y, sigma, rate):
    """Rate of the state on an arc."""
    for i in range(F.shape[0]):
        v = 0.0
        for j in range(y.size):
            v += F[i, j] * y[j]
        for j in range(sigma.size):
            v += S[i, j] * sigma[j]
        rate[i] = v
