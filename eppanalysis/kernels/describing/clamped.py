"""Compiled: the integrator of a clamped PID controller whose output without limits is a sine, derivative included.

With ``v = b + a sin(phi)``, the integrator's state s and the filter's state d, let ``sigma = (s - b)/a`` and ``delta =
(kd/filter_time) d/a``. The error is ``q = sin(phi) - sigma + delta`` but for a positive factor, and by the phase

    sigma' = kappa q  (zero while v is beyond a limit and q of its side),    delta' = tau (eta q - delta),

with ``kappa = ki/(g w)``, ``eta = kd/(filter_time g)``, ``tau = 1/(filter_time w)`` and ``g = kp + kd/filter_time``.
Both laws are linear, and where one takes over from the other inside a limit q is zero, so that rates are continuous:
the map of a period has the product of its arcs' matrices as derivative, and Newton's method finds its fixed point.
Mean and fundamental follow from the ends of arcs: ``x' = M x + f`` by parts is ``(M - j) I = [x exp(-j phi)] - F``.
"""

import math

import numpy as np

from eppanalysis.kernels.compiling import KERNEL, PART, njit

#: Places of an arc at which the error's sign is looked at: even ones, and ones that halve their distance to the begin.
_EVEN, _HALVED = 24, 16
#: Most turns of the error beyond a limit in one stay there; two are usual.
_ARCS = 12
#: Steps of Newton's method, times that one is halved, and its size of rounding.
_STEPS, _HALVINGS, _ROUNDING = 120, 12, 4e-16
_PLACE, _WEIGHT = np.polynomial.legendre.leggauss(20)


@njit(**PART)
def _forced(free, kappa, eta, tau):
    """Coefficients (s, d) of the response ``Im(c exp(j phi))`` to the sine."""
    if not free:
        return 0.0j, eta * tau / (1j + (1.0 - eta) * tau)
    # (j - M) c = (kappa, eta tau).
    m00, m01, m10, m11 = 1j + kappa, -kappa, eta * tau, 1j + (1.0 - eta) * tau
    det = m00 * m11 - m01 * m10
    return (kappa * m11 - m01 * eta * tau) / det, (m00 * eta * tau - m10 * kappa) / det


@njit(**PART)
def _passage(free, t, kappa, eta, tau):
    """Matrix of a passage of length t less that of none: of sigma and delta, on sigma and delta."""
    fall = (1.0 - eta) * tau
    if not free:
        gone = math.expm1(-fall * t)
        return 0.0, 0.0, eta / (1.0 - eta) * gone, gone
    # Roots of M, the slow one from the product, and exp(M t) - 1 = expm1(slow t) + (M - slow) dd.
    half = 0.5 * (kappa + fall)
    product = kappa * tau
    square = half * half - product
    if square >= 0.0:
        quick = -half - math.sqrt(square)
        slow = product / quick
        between = slow - quick
        first = math.expm1(slow * t)
        # The difference quotient of the exponential at both roots: its limit where they coincide, which no quotient
        # would reach.
        dd = t * math.exp(slow * t)
        if between * t > 1e-9:
            dd = -math.exp(slow * t) * math.expm1(-between * t) / between
        return first + (-kappa - slow) * dd, kappa * dd, -eta * tau * dd, first + (-fall - slow) * dd
    turn = math.sqrt(-square)
    left = math.exp(-half * t)
    # exp(-half t) cos(turn t) - 1, without cancellation.
    first = math.expm1(-half * t) - left * 2.0 * math.sin(0.5 * turn * t) ** 2
    dd = left * math.sin(turn * t) / turn
    return first + (half - kappa) * dd, kappa * dd, -eta * tau * dd, first + (half - fall) * dd


@njit(**PART)
def _after(free, begin, t, s, d, kappa, eta, tau):
    """States behind an arc of length t from `begin`."""
    cs, cd = _forced(free, kappa, eta, tau)
    turn = np.exp(1j * begin)
    change = turn * (2j * math.sin(0.5 * t) * np.exp(0.5j * t))
    rest_s, rest_d = s - (cs * turn).imag, d - (cd * turn).imag
    p00, p01, p10, p11 = _passage(free, t, kappa, eta, tau)
    return s + p00 * rest_s + p01 * rest_d + (cs * change).imag, d + p10 * rest_s + p11 * rest_d + (cd * change).imag


@njit(**PART)
def _until(free, side, begin, end, s, d, kappa, eta, tau):
    """Length of an arc beyond a limit, up to where the error turns or to its end; minus one where it has turned before.

    Where the error begins at zero, its sign is that of the first places at which it is not rounding.
    """
    whole, last, seen = end - begin, 0.0, False
    for k in range(_HALVED + _EVEN):
        t = whole / _EVEN * 0.5 ** (_HALVED - k) if k < _HALVED else whole * (k - _HALVED + 1.0) / _EVEN
        at_s, at_d = _after(free, begin, t, s, d, kappa, eta, tau)
        q = side * (math.sin(begin + t) - at_s + at_d)
        if (q > 0.0) != free:
            last, seen = t, True
        elif seen:
            return _turn(free, side, begin, last, t, s, d, kappa, eta, tau)
    return whole if seen else -1.0


@njit(**PART)
def _turn(free, side, begin, low, high, s, d, kappa, eta, tau):
    """Length of the arc up to the place between two at which the error turns."""
    while True:
        t = 0.5 * (low + high)
        if not low < t < high:
            return high
        at_s, at_d = _after(free, begin, t, s, d, kappa, eta, tau)
        q = side * (math.sin(begin + t) - at_s + at_d)
        if (q > 0.0) != free:
            low = t
        else:
            high = t


@njit(**PART)
def _integrals(free, begin, t, s, d, s1, d1, kappa, eta, tau, sums):
    """Add the integrals of sigma, and of sigma times ``exp(-j phi)``, over an arc to `sums`."""
    turn = np.exp(-1j * begin)
    if not free:
        sums[0] += s * t
        sums[1] += s * turn * (1.0 - np.exp(-1j * t)) / 1j
        return
    # By parts small integrals would be differences divided by small determinants, det M = kappa tau: on a short arc
    # Gauss's rule leaves rounding alone.
    if (kappa + tau) * t < 2.0:
        for k in range(_PLACE.size):
            past = 0.5 * t * (1.0 + _PLACE[k])
            here, _ = _after(free, begin, past, s, d, kappa, eta, tau)
            sums[0] += 0.5 * t * _WEIGHT[k] * here
            sums[1] += 0.5 * t * _WEIGHT[k] * here * np.exp(-1j * (begin + past))
        return
    m00, m01, m10, m11 = -kappa, kappa, -eta * tau, -(1.0 - eta) * tau
    # Of the sine, and of the sine times exp(-j phi).
    sine = 2.0 * math.sin(begin + 0.5 * t) * math.sin(0.5 * t)
    twice = (np.exp(-2j * begin) - np.exp(-2j * (begin + t))) / 4j
    wave = t / 2j - twice / 1j
    r0, r1 = s1 - s - kappa * sine, d1 - d - eta * tau * sine
    sums[0] += (m11 * r0 - m01 * r1) / (m00 * m11 - m01 * m10)
    stop = np.exp(-1j * (begin + t))
    c0, c1 = s1 * stop - s * turn - kappa * wave, d1 * stop - d * turn - eta * tau * wave
    n00, n11 = m00 - 1j, m11 - 1j
    sums[1] += (n11 * c0 - m01 * c1) / (n00 * n11 - m01 * m10)


@njit(**PART)
def _period(s, d, edges, kappa, eta, tau, product, sums):
    """Go through a period: states behind it; fills the product of the passages, and integrals."""
    product[0, 0] = product[1, 1] = 1.0
    product[0, 1] = product[1, 0] = 0.0
    sums[:] = 0.0
    for part in range(5):
        begin, end = edges[part], edges[part + 1]
        # From trough to trough v is beyond the lower limit, within, beyond the upper one, within, beyond the lower one.
        # Within the integrator always moves; beyond a limit only where the error leads back
        # (docs/theory/anti_windup.md, Clamping).
        side = 1.0 if part == 2 else -1.0
        free = part % 2 == 1 or side * (math.sin(begin) - s + d) < 0.0
        for arc in range(_ARCS):
            if not end > begin:
                break
            t = end - begin
            if part % 2 == 0 and arc < _ARCS - 1:
                t = _until(free, side, begin, end, s, d, kappa, eta, tau)
                if t < 0.0:
                    # The error has nowhere on the arc the sign of its begin, which was rounding: the other law holds.
                    free, t = not free, end - begin
            s1, d1 = _after(free, begin, t, s, d, kappa, eta, tau)
            _integrals(free, begin, t, s, d, s1, d1, kappa, eta, tau, sums)
            p00, p01, p10, p11 = _passage(free, t, kappa, eta, tau)
            for k in range(2):
                one, two = product[0, k], product[1, k]
                product[0, k] = one + p00 * one + p01 * two
                product[1, k] = two + p10 * one + p11 * two
            s, d = s1, d1
            begin = end if begin + t >= end else begin + t
            free = not free
    return s, d


@njit(**PART)
def _answer(low, high, kappa, eta, tau):
    """Mean of sigma and its fundamental over the sine; no numbers where no period repeats itself."""
    below, above = math.asin(min(max(low, -1.0), 1.0)), math.asin(min(max(high, -1.0), 1.0))
    quarter = 0.5 * math.pi
    edges = np.array([-quarter, below, above, math.pi - above, math.pi - below, 3.0 * quarter])
    product, sums = np.empty((2, 2)), np.empty(2, np.complex128)
    s, d = min(max(0.0, low), high), 0.0
    from_s, from_d, move_s, move_d, least, halved = s, d, 0.0, 0.0, np.inf, 0
    for _ in range(_STEPS):
        s1, d1 = _period(s, d, edges, kappa, eta, tau, product, sums)
        off_s, off_d = s1 - s, d1 - d
        off = abs(off_s) + abs(off_d)
        if off > least and halved < _HALVINGS:
            # The map is of several linear pieces: a whole step may lead beyond the one that holds.
            halved += 1
            move_s, move_d = 0.5 * move_s, 0.5 * move_d
            s, d = from_s + move_s, from_d + move_d
            continue
        a, b, c, e = 1.0 - product[0, 0], -product[0, 1], -product[1, 0], 1.0 - product[1, 1]
        det = a * e - b * c
        move_s, move_d = (e * off_s - b * off_d) / det, (a * off_d - c * off_s) / det
        # Where the integrator is slow, one less the derivative of the map is small, and a step as uncertain as rounding
        # over its determinant.
        if abs(move_s) + abs(move_d) <= _ROUNDING * (1.0 + abs(s) + abs(d)) / min(1.0, max(abs(det), 1e-12)):
            return sums[0].real / (2.0 * math.pi), 1j * sums[1] / math.pi
        from_s, from_d, least, halved = s, d, off, 0
        s, d = s + move_s, d + move_d
    return np.nan, complex(np.nan, np.nan)


@njit(**KERNEL)
def describe(low, high, kappa, eta, tau, mean, gain):
    """Mean of the integrator's state about the bias and its fundamental, over the amplitude.

    Parameters
    ----------
    low, high : array, shape (n,)
        Limits less the bias, over the amplitude.
    kappa, eta, tau : array, shape (n,)
        As in the module's first lines.
    mean : array, shape (n,)
        Written to.
    gain : array of complex, shape (n,)
        Written to.
    """
    for i in range(low.size):
        mean[i], gain[i] = _answer(low[i], high[i], kappa[i], eta[i], tau[i])
