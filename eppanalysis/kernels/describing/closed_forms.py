"""Compiled: closed forms of describing functions that are many short terms a point.

The input is ``b + a sin(phi)``, phases are measured from its peak: what is ``from_peak`` below it and ``to_trough``
above the trough is passed at an angle that is known to full relative accuracy.
"""

import math

from eppanalysis.kernels.compiling import KERNEL, PART, njit

_COMPILED = {**KERNEL, "error_model": "numpy"}
_INNER = {**PART, "error_model": "numpy"}
#: Angle below which the series is taken, which has no cancellation.
_SMALL = 0.25


@njit(**_INNER)
def _angle(from_peak, to_trough):
    # By the tangent of half the angle: an arc cosine would lose half its digits near the peak and the trough.
    return 2.0 * math.atan2(math.sqrt(max(from_peak, 0.0)), math.sqrt(max(to_trough, 0.0)))


@njit(**_INNER)
def _twice(y, x):
    """Twice the angle of (x, y), its sine and its cosine."""
    share = 1.0 / (x * x + y * y)
    return 2.0 * math.atan2(y, x), 2.0 * x * y * share, (x - y) * (x + y) * share


@njit(**_INNER)
def _squared_sine(theta):
    return _squared_sine_to(theta, math.sin(theta), math.cos(theta))


@njit(**_INNER)
def _squared_sine_to(theta, sine, cosine):
    """Integral of sin^2 from 0 to theta, of which sine and cosine are known."""
    if abs(theta) < _SMALL:
        q = theta * theta
        tail = 2 / 155925 + q * (-2 / 6081075 + q * 4 / 638512875)
        return theta * q * (1 / 3 + q * (-1 / 15 + q * (2 / 315 + q * (-1 / 2835 + q * tail))))
    return (theta - sine * cosine) / 2.0


@njit(**_INNER)
def _lever(theta):
    return _lever_to(theta, math.sin(theta), math.cos(theta))


@njit(**_INNER)
def _lever_to(theta, sine, cosine):
    """Integral of t sin(t) from 0 to theta, of which sine and cosine are known."""
    if abs(theta) < _SMALL:
        q = theta * theta
        tail = 1 / 3991680 - q / 518918400
        return theta * q * (1 / 3 + q * (-1 / 30 + q * (1 / 840 + q * (-1 / 45360 + q * tail))))
    return sine - theta * cosine


@njit(**_INNER)
def _area(theta, top, a):
    """Integral of the stretch from the peak to theta."""
    return top * theta - 4.0 * a * _squared_sine(theta / 2.0)


@njit(**_INNER)
def _slide(of, a, b, reach):
    """Mean, real and imaginary part of the gain of a cable that slides; the stretch rises by `reach` before it does."""
    rise, fall = of[3], of[4]
    # Slack cable carries no force: stretch below zero counts as none (docs/theory/play.md, The pulley with stiction).
    top, bottom = b + a, max(b - a, 0.0)
    under, drop = bottom - (b - a), top * of[6]
    # Angles from the peak at which it breaks away up, breaks away down and comes to the least taut stretch.
    up = _angle(top - bottom - reach, under + reach)
    down, end = _angle(drop, 2.0 * a - drop), _angle(top - bottom, under)
    jump_up, jump_down = of[7] * (bottom + reach) / a, of[8] * (top - drop) / a
    real = rise * _squared_sine(up) + jump_up * math.sin(up)
    real = real + fall * (_squared_sine(end) - _squared_sine(down)) + jump_down * math.sin(down)
    lag = rise * math.sin(up) ** 2 / 2.0 + jump_up * math.cos(up)
    lag = lag + fall * (math.sin(down) ** 2 - math.sin(end) ** 2) / 2.0 - jump_down * math.cos(down)
    mean = fall * bottom * (math.pi - up) + rise * (_area(up, top, a) + top * down)
    mean += fall * (_area(end, top, a) - _area(down, top, a))
    return mean / (2.0 * math.pi), real / math.pi, -lag / math.pi


@njit(**_COMPILED)
def stiction_pulley(forearm, harness, of, amplitude, bias, mean, gain):
    """Both forces of a cable that sticks to a pulley.

    Parameters
    ----------
    forearm, harness : float
        Stiffnesses [N/m].
    of : array, shape (9,)
        Shares of the stretch at rest, at the static friction and against it, at the kinetic friction and against it;
        reach and drop before it breaks away over stretch; jumps of the share as it does, up and down.
    amplitude, bias : array, shape (n,)
        Of the stretch.
    mean, gain : array and complex array, shape (n, 2)
        Are filled.
    """
    for i in range(amplitude.size):
        a, b = amplitude[i], bias[i]
        top, bottom = b + a, max(b - a, 0.0)
        held, real, imaginary, taut, taut_gain = 0.0, 0.0, 0.0, 0.0, 0.0
        if math.isnan(a) or math.isnan(b):
            held, real, imaginary = math.nan, math.nan, math.nan
        elif top > 0.0:
            reach = bottom * of[5]
            if top - bottom > reach:
                held, real, imaginary = _slide(of, a, b, reach)
            else:
                held = min(max(of[0] * b, of[1] * top), of[2] * bottom)
            slack = _angle(top - bottom, 0.0 if b >= a else a - b)
            taut, taut_gain = _area(slack, top, a) / math.pi, 2.0 / math.pi * _squared_sine(slack)
        mean[i, 0], mean[i, 1] = forearm * held, harness * (taut - held)
        gain[i, 0] = complex(forearm * real, forearm * imaginary)
        gain[i, 1] = complex(harness * (taut_gain - real), -harness * imaginary)


@njit(**_INNER)
def _hold(a, inside, q):
    """Classical contact on one side: the cosine of the damper adds the spring's own integral, turned by 90 degrees.

    Integrals over one cycle of the torque over the stiffness, for ``delta = edge + inside + a sin(phi)``: mean, real
    and imaginary part of the gain.
    """
    theta = _angle(min(max(a + inside, 0.0), 2.0 * a), min(max(a - inside, 0.0), 2.0 * a))
    mean = 2.0 * math.pi * inside if inside >= a else 2.0 * a * _lever(theta) if inside > -a else 0.0
    held = 2.0 * _squared_sine(theta)
    return mean, held, held * q


@njit(**_INNER)
def _push(a, inside, q):
    """Unilateral contact on one side; arguments and results as in `_hold`.

    With ``depth = 1 + inside/a``, the greatest penetration over the amplitude, the torque ``sin + q cos - (1 - depth)``
    falls through zero at the angle `end` behind the peak and rises through it at `begin` before the peak (which counts
    only where the gap is not reached, depth >= 2); the half-angle tangents are roots of a quadratic.
    """
    if not inside > -a:
        return 0.0, 0.0, 0.0
    if inside >= a and inside >= a * math.hypot(1.0, q):
        return 2.0 * math.pi * inside, math.pi, math.pi * q
    d = (a + inside) / a
    root = math.sqrt(max(q * q + d * (2.0 - d), 0.0))
    edge = d <= 2.0
    begin, sin_begin, cos_begin = _twice(math.sqrt(d), math.sqrt(2.0 - d)) if edge else _twice(d, root - q)
    # Contact ends where the torque is zero, before the twist is back at the gap (docs/theory/lock_pin.md). With the
    # root in the denominator neither a shallow contact cancels nor d = 2 divides by zero.
    end, sin_end, cos_end = _twice(d, q + root)
    held = _squared_sine_to(begin, sin_begin, cos_begin) + _squared_sine_to(end, sin_end, cos_end)
    begin_square, end_square = sin_begin * sin_begin, sin_end * sin_end
    real = held + q / 2.0 * (end_square + (begin_square if edge else -begin_square))
    imaginary = q * (held + q / 2.0 * (end_square - (0.0 if edge else begin_square)))
    damper = q * sin_end * (end + q) + (0.0 if edge else q * sin_begin * (q - begin))
    levers = _lever_to(begin, sin_begin, cos_begin) + _lever_to(end, sin_end, cos_end)
    return a * (levers + damper), real, imaginary


@njit(**_INNER)
def lock_pin_at(gap, stiffness, damping, unilateral, a, b, omega):
    """Mean and gain of one input to :func:`lock_pin`."""
    q = damping / stiffness * omega
    if math.isnan(a + b + q):
        return math.nan, complex(math.nan, 0.0)
    # The other side sees the twist mirrored: its mean is subtracted, its gain the same way round
    # (docs/theory/lock_pin.md).
    if unilateral:
        up, up_real, up_imaginary = _push(a, b - gap / 2.0, q)
        down, down_real, down_imaginary = _push(a, -b - gap / 2.0, q)
    else:
        up, up_real, up_imaginary = _hold(a, b - gap / 2.0, q)
        down, down_real, down_imaginary = _hold(a, -b - gap / 2.0, q)
    factor = stiffness / math.pi
    gain = complex(factor * (up_real + down_real), factor * (up_imaginary + down_imaginary))
    return stiffness / (2.0 * math.pi) * (up - down), gain


@njit(**_COMPILED)
def lock_pin(gap, stiffness, damping, unilateral, amplitude, bias, omega, mean, gain):
    """Torque of a spring and a damper outside a gap.

    Parameters
    ----------
    gap, stiffness, damping : float
        [rad], [N*m/rad], [N*m*s/rad].
    unilateral : bool
        Whether it only pushes.
    amplitude, bias, omega : array, shape (n,)
        Of the twist.
    mean, gain : array and complex array, shape (n,)
        Are filled.
    """
    for i in range(amplitude.size):
        mean[i], gain[i] = lock_pin_at(gap, stiffness, damping, unilateral, amplitude[i], bias[i], omega[i])
