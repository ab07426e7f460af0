"""Fixed steps in numba, written by hand for this one loop, as fast as scalars allow."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from benchmarks.elbow_plain import start, thresholds

Array = NDArray[np.float64]


def constants(p: dict[str, float]) -> Array:
    """Divisions done once: the coefficients of the equations in the order in which :func:`runge_kutta` reads them."""
    low, high, ramp = thresholds(p)
    harness = p["band_centre"] / p["cable_stiffness"] + p["step"]
    return np.array(
        [
            p["cable_stiffness"] * harness,
            p["cable_stiffness"] * p["pulley_radius"],
            low,
            high,
            p["supply_voltage"] / ramp,
            p["supply_voltage"],
            p["backlash"] / 2.0,
            p["pin_stiffness"],
            p["pin_damping"],
            1.0 / p["forearm_inertia"],
            p["pulley_radius"] / p["forearm_inertia"],
            p["viscous_friction"] / p["forearm_inertia"],
            1.0 / p["drive_inertia"],
            p["coulomb_friction"] / p["drive_inertia"],
            p["stall_torque"] / p["supply_voltage"] / p["electrical_time_constant"],
            p["stall_torque"] / p["no_load_speed"] / p["electrical_time_constant"],
            1.0 / p["electrical_time_constant"],
            1.0 / p["delay"],
        ]
    )


@njit(cache=True, nogil=True, inline="always")
def _accelerations(c, theta, omega, drive, speed, torque, q1, q2):
    """Rates of omega, speed, torque and q2 (those of the other three are states)."""
    force = max(0.0, c[0] - c[1] * theta)
    volts = 0.0
    if force > c[3]:
        volts = min(c[4] * (force - c[3]), c[5])
    elif force < c[2]:
        volts = -min(c[4] * (c[2] - force), c[5])
    gap, pin = drive - theta, 0.0
    if gap > c[6]:
        pin = max(0.0, c[7] * (gap - c[6]) + c[8] * (speed - omega))
    elif gap < -c[6]:
        pin = min(0.0, c[7] * (gap + c[6]) + c[8] * (speed - omega))
    friction = c[13] if speed > 0.0 else (-c[13] if speed < 0.0 else 0.0)
    return (
        c[9] * pin + c[10] * force - c[11] * omega,
        c[12] * (torque - pin) - friction,
        c[14] * (volts - 12.0 * q2) - c[15] * speed - c[16] * torque,
        c[17] * (volts - 12.0 * q1 - 6.0 * q2),
    )


@njit(cache=True, nogil=True)
def runge_kutta(c, y0, h, n_samples, every, out):
    """Classical Runge-Kutta of order 4; theta at every `every`-th step into `out`."""
    a, b, d, e, f, g, k = y0[0], y0[1], y0[2], y0[3], y0[4], y0[5], y0[6]
    w, hh, h6 = c[17], 0.5 * h, h / 6.0
    out[0] = a
    for i in range(1, n_samples):
        for _ in range(every):
            b1, e1, f1, k1 = _accelerations(c, a, b, d, e, f, g, k)
            bb, ee, ff, kk = b + hh * b1, e + hh * e1, f + hh * f1, k + hh * k1
            b2, e2, f2, k2 = _accelerations(c, a + hh * b, bb, d + hh * e, ee, ff, g + hh * w * k, kk)
            bc, ec, fc, kc = b + hh * b2, e + hh * e2, f + hh * f2, k + hh * k2
            b3, e3, f3, k3 = _accelerations(c, a + hh * bb, bc, d + hh * ee, ec, fc, g + hh * w * kk, kc)
            bd, ed, fd, kd = b + h * b3, e + h * e3, f + h * f3, k + h * k3
            b4, e4, f4, k4 = _accelerations(c, a + h * bc, bd, d + h * ec, ed, fd, g + h * w * kc, kd)
            a += h6 * (b + 2.0 * (bb + bc) + bd)
            d += h6 * (e + 2.0 * (ee + ec) + ed)
            g += h6 * w * (k + 2.0 * (kk + kc) + kd)
            b += h6 * (b1 + 2.0 * (b2 + b3) + b4)
            e += h6 * (e1 + 2.0 * (e2 + e3) + e4)
            f += h6 * (f1 + 2.0 * (f2 + f3) + f4)
            k += h6 * (k1 + 2.0 * (k2 + k3) + k4)
        out[i] = a


def runge_kutta_theta(p: dict[str, float], h: float, t_end: float) -> Array:
    """Angle theta [rad] every millisecond from 0 to `t_end`, with the step `h` [s]."""
    n = round(t_end * 1000.0) + 1
    out = np.empty(n)
    runge_kutta(constants(p), start(p), h, n, round(1e-3 / h), out)
    return out
