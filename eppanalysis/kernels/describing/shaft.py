"""Compiled: the torque of a damped shaft behind a gap (docs/theory/lock_pin.md, The damped shaft).

With ``twist = b + a sin(phi)``, lengths over a and ``kappa = k/(c w)``, the torque on a side is ``sin(phi + psi) - q``
but for the factor ``a |k + j c w|``, with ``tan(psi) = 1/kappa``: it falls through zero at a phase that is closed, and
begins where the contact angle arrives, of which the phase is a root.
"""

import math

from eppanalysis.kernels.compiling import KERNEL, PART, njit
from eppanalysis.kernels.describing.closed_forms import _lever, _squared_sine

_COMPILED = {**KERNEL, "error_model": "numpy"}
_INNER = {**PART, "error_model": "numpy"}
#: Steps of a bracketed Newton's method; each one that leaves the bracket halves it.
_STEPS = 200


@njit(**_INNER)
def _way(t, release, lead, kappa):
    """How far the contact angle has moved at the phase t behind its release, and its derivative."""
    left = math.exp(-kappa * t)
    moved = 2.0 * math.cos(release + 0.5 * t) * math.sin(0.5 * t) - lead * math.expm1(-kappa * t)
    return moved, math.cos(release + t) - math.cos(release) * left


@njit(**_INNER)
def _root(level, low, high, release, lead, kappa):
    """Phase behind a release at which the contact angle has moved by `level`, between two that it lies between."""
    rises = _way(high, release, lead, kappa)[0] > level
    t = 0.5 * (low + high)
    for _ in range(_STEPS):
        moved, slope = _way(t, release, lead, kappa)
        if (moved > level) == rises:
            high = t
        else:
            low = t
        step = (level - moved) / slope if slope != 0.0 else math.inf
        there = t + step
        if not low <= there <= high:
            there = 0.5 * (low + high)
        if there == t or not low < 0.5 * (low + high) < high:
            return there
        t = there
    return t


@njit(**_INNER)
def _turn(release, kappa):
    """Phase behind a release at which the contact angle turns back."""
    # The rate times exp(kappa t) has its minimum at tan(phase) = kappa, beyond the release, and rises from there on.
    low, high = max(math.pi + math.atan(kappa) - release, 0.0), 1.5 * math.pi - release
    while low < 0.5 * (low + high) < high:
        t = 0.5 * (low + high)
        if _way(t, release, 0.0, kappa)[1] > 0.0:
            high = t
        else:
            low = t
    return high


@njit(**_INNER)
def _release(q, kappa):
    """Phase at which the torque falls to zero, for the twist beyond the side, q times ``hypot(1, 1/kappa)``."""
    return 0.5 * math.pi + math.atan(kappa) - math.asin(max(-1.0, min(1.0, q)))


@njit(**_INNER)
def _lead(release, beyond, kappa):
    """Twist less contact angle at the release, over the amplitude."""
    return -math.cos(release) / kappa if kappa > 1.0 else math.sin(release) - beyond


@njit(**_INNER)
def _pushes(length, q):
    """Mean, and complex fundamental, of the torque over a contact of that length which ends with it at zero."""
    h = 0.5 * length
    m = math.pi - math.asin(max(-1.0, min(1.0, q))) - h
    across, along, twice = math.sin(m), -math.cos(m), 2.0 * _squared_sine(h)
    mean = across * _lever(h) + along * h * math.sin(h)
    real, imaginary = across * twice + 2.0 * along * math.sin(h) ** 2, along * twice
    return 2.0 * mean, complex(real, imaginary) * complex(-along, -across)


@njit(**_INNER)
def _answer(bias, half, kappa):
    """Mean over ``|k + j c w|`` and gain over ``k + j c w`` of the torque; no bias is negative, lengths are over a."""
    root = math.hypot(1.0, 1.0 / kappa)
    near, far = (half - bias) / root, (half + bias) / root
    if 1.0 + bias <= half:
        return 0.0, 0.0j
    if near <= -1.0:
        return -near, complex(1.0, 0.0)
    release = _release(near, kappa)
    lead = _lead(release, half - bias, kappa)
    turn = _turn(release, kappa)
    if _way(turn, release, lead, kappa)[0] > -2.0 * half or far >= 1.0:
        # It comes back to the side that it has left, without having seen the other.
        back = _root(0.0, turn, 2.0 * math.pi, release, lead, kappa)
        mean, wave = _pushes(2.0 * math.pi - back, near)
        return mean / (2.0 * math.pi), 1j * wave / math.pi
    across = _root(-2.0 * half, 0.0, turn, release, lead, kappa)
    other = _release(far, kappa)
    lead = _lead(other, half + bias, kappa)
    back = _root(-2.0 * half, 0.0, _turn(other, kappa), other, lead, kappa)
    up, up_wave = _pushes(max(release - other + math.pi - back, 0.0), near)
    down, down_wave = _pushes(max(other - release + math.pi - across, 0.0), far)
    return (up - down) / (2.0 * math.pi), 1j * (up_wave + down_wave) / math.pi


@njit(**_COMPILED)
def nordin_shaft(gap, stiffness, damping, amplitude, bias, omega, mean, share):
    """Torque of the settled shaft.

    Parameters
    ----------
    gap, stiffness, damping : float
        [rad], [N*m/rad], [N*m*s/rad].
    amplitude, bias, omega : array, shape (n,)
        Of the twist; no amplitude is zero.
    mean, share : array and complex array, shape (n,)
        Are filled: mean torque, and its gain over that of the shaft without a gap.
    """
    for i in range(amplitude.size):
        a, b, w = amplitude[i], bias[i], omega[i]
        if math.isnan(a + b + w):
            mean[i], share[i] = math.nan, complex(math.nan, 0.0)
            continue
        kappa = min(max(stiffness / (damping * w), 1e-200), 1e200)
        whole, share[i] = _answer(abs(b) / a, 0.5 * gap / a, kappa)
        mean[i] = math.copysign(whole * a * math.hypot(stiffness, damping * w), b)
