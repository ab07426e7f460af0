"""Compiled: the answer of a servo with a limited rate to a sine, ``dy/dphi = clip(kappa (u - y), -1/alpha, 1/alpha)``.

The input is ``u = sin(phi)``; alpha is the input's greatest rate over the limit, kappa the servo's bandwidth over the
frequency, and infinite for the ideal limiter, which follows its input where that is slow enough. The answer is odd by
half a period. In each half it ramps from the phase `begin`, where the rate reaches its limit, to the phase `end`; the
two are roots, and with them the fundamental of the output is elementary, by ``integral of y' exp(-j phi)``.
"""

import math

import numpy as np

from eppanalysis.kernels.compiling import KERNEL, PART, njit

_PLACE, _WEIGHT = np.polynomial.legendre.leggauss(20)
#: Half the angle of the ramp's reach below which the difference of input and output is integrated in powers of it.
_SHORT = 0.6
#: Error, as of `describe_inside`, from which the ideal limiter never follows: its input's rate is 1.862 of the limit.
_SATURATED = math.sqrt(math.pi**2 / 4.0 - 3.0 + 16.0 / math.pi**2)
#: Steps of safeguarded root finding, which ends by itself within a dozen; size of an equation that is rounding.
_STEPS, _ROUNDING = 100, 1e-15


@njit(**PART)
def _above_sine(x):
    """``x - sin(x)``, accurate down to zero."""
    if abs(x) > 1.0:
        return x - math.sin(x)
    q = x * x
    term, total, k = x * q / 6.0, 0.0, 4
    while abs(term) > 1e-18 * abs(total):
        total += term
        term *= -q / (k * (k + 1))
        k += 2
    return total


@njit(**PART)
def _gap(phi, begin, beta):
    """Input less output on a ramp of rate ``cos(beta)`` from `begin`, where they are equal; accurate down to zero."""
    loss = 2.0 * math.sin(0.5 * beta) ** 2
    return (phi - begin) * loss - _above_sine(phi) + _above_sine(begin)


@njit(**PART)
def _ramp_end(begin, beta):
    """Phase at which a ramp that begins at `begin`, in [-beta, beta], meets the input from which it left again."""
    rate, sine, wide = math.cos(beta), math.sin(begin), beta > 0.5
    low, high = beta, 2.0 * math.pi - beta
    phi = min(max(0.5 * (3.0 * beta - begin), low), high)  # exact to first order for a short ramp
    for _ in range(_STEPS):
        # On a short ramp input and output agree to many digits: there the difference itself is summed up.
        value = math.sin(phi) - sine - (phi - begin) * rate if wide else _gap(phi, begin, beta)
        if value > 0.0:
            low = phi
        else:
            high = phi
        slope = math.cos(phi) - rate
        if slope < 0.0:
            step = value / slope
            if abs(step) <= 2e-15 * phi:
                return phi - step
            phi -= step
        if not low < phi < high:
            phi = 0.5 * (low + high)
        if high - low <= 4e-16 * high:
            break
    return phi


@njit(**PART)
def _late(begin, beta, kappa):
    """How far the servo's error, over that of its limit, has to fall further where the next ramp should begin.

    Returns that, its derivative by `begin`, and the end of the ramp.
    """
    end, rate = _ramp_end(begin, beta), math.cos(beta)
    wait = begin + math.pi - end
    # The ramp lasts beyond the begin of the next one: a later begin shortens it, so the root lies there.
    if wait <= 0.0:
        return 2.0, -1.0, end
    share = kappa / (rate * (kappa * kappa + 1.0))
    cosine, sine = math.cos(begin), math.sin(begin)
    stop_cosine, stop_sine = math.cos(end), math.sin(end)
    left = math.exp(-kappa * wait)
    gone = 1.0 - share * (kappa * stop_cosine + stop_sine)
    falls = stop_cosine - rate
    moves = (cosine - rate) / falls if falls < 0.0 else -1.0
    slope = share * (kappa * sine - cosine)
    slope -= left * (moves * share * (stop_cosine - kappa * stop_sine) + gone * kappa * (1.0 - moves))
    return 1.0 - share * (kappa * cosine + sine) + gone * left, slope, end


@njit(**PART)
def _ramp(beta, kappa):
    """Phases at which the rising ramp begins and ends."""
    # Where the corner of a triangle would lie, for an output that never follows (docs/theory/rate_limit.md, The ideal
    # limiter): the ideal limiter's begin then, and a start for the servo's.
    begin = -math.asin(min(1.0, 0.5 * math.pi * math.cos(beta)))
    if math.isinf(kappa):
        end = _ramp_end(-beta, beta)
        return (-beta, end) if end <= math.pi - beta else (begin, begin + math.pi)
    # One equation for the begin: half a period later the error has to stand at the other limit
    # (docs/theory/rate_limit.md, The servo). Newton's method, kept in its bracket.
    low, high = -beta, beta
    begin = max(begin, 0.999 * low)
    end = beta
    for _ in range(_STEPS):
        value, slope, end = _late(begin, beta, kappa)
        if value > 0.0:
            low = begin
        else:
            high = begin
        if slope < 0.0:
            step = value / slope
            if abs(step) <= 2e-15 * beta:
                break
            begin -= step
        if not low < begin < high:
            begin = 0.5 * (low + high)
        if high - low <= 4e-16 * beta:
            break
    return begin, end


@njit(**PART)
def _short(begin, end, beta):
    """What the fundamental of the ideal limiter's output lacks, by quadrature over the ramp."""
    total, half, middle = 0.0 + 0.0j, 0.5 * (end - begin), 0.5 * (end + begin)
    for k in range(_PLACE.size):
        phi = middle + half * _PLACE[k]
        total += half * _WEIGHT[k] * _gap(phi, begin, beta) * complex(math.sin(phi), math.cos(phi))
    return 2.0 / math.pi * total


@njit(**PART)
def _turn(phi):
    """``exp(-j phi)``"""
    return complex(math.cos(phi), -math.sin(phi))


@njit(**PART)
def _following(low, high):
    """Integrals of ``cos(phi) exp(-j phi)`` and ``sin(phi) exp(-j phi)`` from `low` to `high`."""
    width = high - low
    twice = 0.5j * (_turn(2.0 * high) - _turn(2.0 * low))
    return 0.5 * (width + twice), -0.5j * (width - twice)


@njit(**PART)
def lack(alpha, kappa):
    """``1 - N`` of the describing function N from input to output."""
    linear = 0.0j if math.isinf(kappa) else 1.0 / complex(1.0, -kappa)
    if not alpha > math.sqrt(1.0 + 1.0 / (kappa * kappa)):
        return linear
    # arccos(1/alpha) by the half angle, which keeps its digits where alpha is hardly above one.
    beta = 2.0 * math.atan2(math.sqrt(alpha - 1.0), math.sqrt(alpha + 1.0))
    begin, end = _ramp(beta, kappa)
    # A short ramp costs as little as beta^4 (docs/theory/rate_limit.md, The ideal limiter): the closed form, one less
    # nearly one, would keep no digit of it, and the gain from the error divides by it.
    if math.isinf(kappa) and end < _SHORT:
        return _short(begin, end, beta)
    stop = begin + math.pi
    turn = _turn(end)
    ramp = 1j / alpha * (turn - _turn(begin))
    with_cosine, with_sine = _following(end, stop)
    if math.isinf(kappa):
        return 1.0 - 2.0 / math.pi * (ramp + with_cosine)
    share = kappa * kappa / (kappa * kappa + 1.0)
    gone = 1.0 / alpha - share * (math.cos(end) + math.sin(end) / kappa)
    wait = stop - end
    left = math.exp(-kappa * wait) * _turn(wait)
    behind = gone * turn * (1.0 - left) / complex(kappa, 1.0)
    return 1.0 - 2.0 / math.pi * (ramp + share * (with_cosine + with_sine / kappa) + behind)


@njit(**PART)
def _excess(beta, error, kappa):
    """How much the error of input less output is too large, at the input whose rate is ``1/cos(beta)`` of the limit."""
    alpha = 1.0 / math.cos(beta)
    ratio = abs(lack(alpha, kappa)) * alpha / error
    # The ideal limiter's error starts with the fourth power of beta.
    return math.sqrt(math.sqrt(ratio)) - 1.0 if math.isinf(kappa) else ratio - 1.0


@njit(**PART)
def _drive(error, kappa):
    """alpha at which the fundamental of the error ``alpha (u - y)`` has the size `error`, above the linear range."""
    if math.isinf(kappa) and error > _SATURATED:
        # Of a triangle |1 - N|^2 = 1 - (4 - 16/pi^2)/alpha^2, so that the drive follows from the error at once.
        return math.sqrt(error * error + 4.0 - 16.0 / math.pi**2)
    # alpha = 1/cos(beta) maps all drives onto a bounded interval; a regula falsi on it, with the end that stays halved
    # (docs/theory/rate_limit.md).
    low = math.atan(1.0 / kappa)
    high = math.acos(1.0 / (error + 4.0 / math.pi + 1.0 / kappa))
    at_low, at_high, side = _excess(low, error, kappa), _excess(high, error, kappa), 0
    for _ in range(_STEPS):
        if not at_low < 0.0 or not at_high > 0.0 or high - low <= 4e-16 * high:
            break
        middle = (low * at_high - high * at_low) / (at_high - at_low)
        if not low < middle < high:
            middle = 0.5 * (low + high)
        value = _excess(middle, error, kappa)
        if abs(value) <= _ROUNDING:
            return 1.0 / math.cos(middle)
        if value < 0.0:
            low, at_low = middle, value
            at_high = 0.5 * at_high if side == -1 else at_high
            side = -1
        else:
            high, at_high = middle, value
            at_low = 0.5 * at_low if side == 1 else at_low
            side = 1
    return 1.0 / math.cos(low if abs(at_low) < abs(at_high) else high)


@njit(**KERNEL)
def describe(alpha, kappa, gain):
    """Gains from input to output, for points (p,) of alpha and kappa."""
    for i in range(alpha.size):
        gain[i] = 1.0 - lack(alpha[i], kappa[i]) if alpha[i] >= 0.0 and kappa[i] > 0.0 else complex(math.nan, math.nan)


@njit(**KERNEL)
def describe_inside(error, kappa, gain):
    """Gains from the error ``u - y`` to the rate of the output, over the frequency, for points (p,).

    `error` is the amplitude of the fundamental of the error, over the limit divided by the frequency. In the linear
    range of the servo the gain is kappa; the ideal limiter has none, and any error there is has a ramp.
    """
    for i in range(error.size):
        if not (error[i] > 0.0 and kappa[i] > 0.0):
            gain[i] = complex(math.nan, math.nan)
        elif error[i] * kappa[i] <= 1.0:
            gain[i] = kappa[i]
        else:
            missing = lack(_drive(error[i], kappa[i]), kappa[i])
            gain[i] = 1j * (1.0 - missing) / missing if missing != 0.0 else 1.0 / error[i] + 0.0j
