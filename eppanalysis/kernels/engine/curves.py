"""Compiled: smooth functions of one argument beyond sine, cube and the falling friction: values, slopes, Taylor series.

The numbers are those of ``SMOOTH_KINDS``. Series are scaled to the step, as in
:mod:`eppanalysis.kernels.engine.series`: with the coefficients of the argument in `arg` up to order k, coefficient k of
the scaled function goes into `Sg`. `aux` holds the squared argument (powers) or the scaled slope (others).
"""

import math

from eppanalysis.kernels.compiling import njit
from eppanalysis.kernels.engine.tables import HOT

SINE, CUBE, RECIPROCAL, SQUARE, FOURTH, FIFTH, TANH, ARCTAN, GAUSSIAN, LOGARITHM, EXPONENTIAL = range(11)
#: Size of the argument below which the logarithm rests.
LEAST = 5e-11
#: Sizes of the argument beyond which tanh is one to rounding, and a Gaussian and an exponential are nothing.
_SATURATED, _GONE, _DECAYED = 20.0, 24.0, 500.0


@njit(**HOT)
def curve(kind, x):
    """Value and slope of a function."""
    if kind == SQUARE:
        return x * x, 2.0 * x
    if kind == FOURTH:
        return x * x * x * x, 4.0 * x * x * x
    if kind == FIFTH:
        return x * x * x * x * x, 5.0 * x * x * x * x
    if kind == TANH:
        # 4 e/(1 + e)^2 for 1 - tanh^2, which would cancel where the function saturates.
        e = math.exp(-2.0 * abs(x))
        return math.tanh(x), 4.0 * e / ((1.0 + e) * (1.0 + e))
    if kind == ARCTAN:
        return math.atan(x), 1.0 / (1.0 + x * x)
    if kind == LOGARITHM:
        return (math.log(abs(x)), 1.0 / x) if abs(x) > LEAST else (math.log(LEAST), 0.0)
    if kind == EXPONENTIAL:
        return math.exp(x), math.exp(x)
    y = math.exp(-x * x)
    return y, -2.0 * x * y


@njit(**HOT)
def _product(a, b, j, k):
    """Coefficient k of the product of two series."""
    total = 0.0
    for i in range(k + 1):
        total += a[i, j] * b[k - i, j]
    return total


@njit(**HOT)
def curve_term(kind, j, k, scale, Sg, arg, aux):
    """Coefficient k of a scaled function."""
    if kind <= FIFTH:
        _power_term(kind, j, k, scale, Sg, arg, aux)
        return
    if k == 0:
        value, slope = curve(kind, arg[0, j])
        Sg[0, j], aux[0, j] = scale * value, scale * slope
        return
    total = 0.0
    if kind == GAUSSIAN:  # y' = -(x^2)' y
        for i in range(1, k + 1):
            total -= i * _product(arg, arg, j, i) * Sg[k - i, j]
        Sg[k, j] = total / k
        return
    for i in range(1, k + 1):  # y' = slope(x) x'
        total += i * arg[i, j] * aux[k - i, j]
    Sg[k, j] = total / k
    if kind == TANH:  # slope = 1 - y^2
        aux[k, j] = -_product(Sg, Sg, j, k) / scale if scale != 0.0 else 0.0
        return
    if kind == EXPONENTIAL:  # slope = y
        aux[k, j] = Sg[k, j]
        return
    total = 0.0
    if kind == LOGARITHM:  # slope x = 1, and none at rest
        for i in range(1, k + 1):
            total -= arg[i, j] * aux[k - i, j]
        aux[k, j] = total / arg[0, j] if aux[0, j] != 0.0 else 0.0
        return
    for i in range(1, k + 1):  # slope (1 + x^2) = 1
        total -= _product(arg, arg, j, i) * aux[k - i, j]
    aux[k, j] = total / (1.0 + arg[0, j] * arg[0, j])


@njit(**HOT)
def _power_term(kind, j, k, scale, Sg, arg, aux):
    aux[k, j] = _product(arg, arg, j, k)
    if kind == SQUARE:
        Sg[k, j] = scale * aux[k, j]
    elif kind == FOURTH:
        Sg[k, j] = scale * _product(aux, aux, j, k)
    else:
        total = 0.0
        for i in range(k + 1):
            total += _product(aux, aux, j, i) * arg[k - i, j]
        Sg[k, j] = scale * total


@njit(**HOT)
def curve_slope_term(kind, j, k, scale, Sg, arg, aux):
    """Coefficient k of the slope of a scaled function by its argument, behind `curve_term`."""
    if kind == SQUARE:
        return 2.0 * scale * arg[k, j]
    if kind == FOURTH:
        return 4.0 * scale * _product(aux, arg, j, k)
    if kind == FIFTH:
        return 5.0 * scale * _product(aux, aux, j, k)
    if kind == GAUSSIAN:
        return -2.0 * _product(arg, Sg, j, k)
    return aux[k, j]


@njit(**HOT)
def has_fallen(kind, j, k, limit, scale, Sg, arg, aux):
    """Whether coefficient k is below a share of what the series begins with, and does not hide those behind it.

    A function that passes zero begins with nothing there: the largest coefficient counts.
    """
    size = abs(Sg[0, j])
    if SQUARE <= kind <= EXPONENTIAL:
        for i in range(1, k + 1):
            size = max(size, abs(Sg[i, j]))
    return abs(Sg[k, j]) <= limit * size and not (
        TANH <= kind <= EXPONENTIAL and hides(kind, j, k, limit, scale, Sg, arg, aux)
    )


@njit(**HOT)
def hides(kind, j, k, limit, scale, Sg, arg, aux):
    """Whether a function that is flat where its series begins may bend on the way, by terms that are still to come.

    ``1 - tanh`` of thirty is beneath the rounding of one, and so are its first terms on the way through zero: by its
    own size each is larger than the one before. The function may stay flat for the whole step, or the series of what
    bends it has fallen.
    """
    if scale == 0.0 or kind in (ARCTAN, LOGARITHM):
        return False
    flat = _SATURATED if kind == TANH else _GONE if kind == GAUSSIAN else _DECAYED
    rest, size = abs(arg[0, j]), 0.0
    bend = aux if kind == TANH else Sg
    for i in range(k + 1):
        size = max(size, abs(bend[i, j]))
        if i > 0:
            rest -= abs(arg[i, j])
    return rest <= flat and not abs(bend[k, j]) < limit * size
