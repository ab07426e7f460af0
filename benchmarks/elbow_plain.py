"""The elbow's equations as a user would type them for a general integrator: min, max and sgn, no modes and no events.

One formula serves plain floats, numba, CasADi and JAX: it is made from the three functions that these libraries name
differently. State: theta, theta_dot, drive_angle, drive_speed, motor_torque, and two states of the Padé delay. The
pulley runs on its ball bearing (no friction), and the harness stands where it stands after the step.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Rates = Callable[..., tuple[Any, ...]]

#: Slope of the smoothed sgn: full Coulomb friction from this speed on [rad/s].
CREEP = 1e-3
N_STATES = 7


class Operations(NamedTuple):
    """What the formula needs: the smaller of two, the larger of two, the sign of a speed."""

    smaller: Callable[[Any, Any], Any]
    larger: Callable[[Any, Any], Any]
    sign: Callable[[Any], Any]


def hard_sign(speed: float) -> float:
    """The sgn of the equations, zero at zero."""
    return 1.0 if speed > 0.0 else (-1.0 if speed < 0.0 else 0.0)


def smooth_sign(speed: float) -> float:
    """What a user puts in its place when an integrator chokes on the jump."""
    return math.tanh(speed / CREEP)


#: For plain floats, and (compiled) for numba.
FLOATS = Operations(min, max, hard_sign)


def start(p: dict[str, float]) -> Array:
    """State of rest before the step, the cable's pull pressing the forearm against the flexed side of the gap."""
    y = np.zeros(N_STATES)
    y[2] = -p["backlash"] / 2.0 - p["pulley_radius"] * p["band_centre"] / p["pin_stiffness"]
    return y


def thresholds(p: dict[str, float]) -> tuple[float, float, float]:
    """Inner thresholds of the five-band law and the width of its ramps [N]."""
    half = p["parking_width"] / 2.0
    return p["band_centre"] - half, p["band_centre"] + half, (p["band_range"] - p["parking_width"]) / 2.0


def make_rates(p: dict[str, float], operations: Operations) -> Rates:
    """Rates of the seven states as a function of the seven states.

    Parameters
    ----------
    p : dict of str to float
        From :func:`tests.reference.elbow_reference.nominal`, with a ball-bearing pulley.
    operations : Operations
        For the numbers or symbols that the function will be given.
    """
    smaller, larger, sign = operations
    low, high, ramp = thresholds(p)
    supply, stall, no_load = p["supply_voltage"], p["stall_torque"], p["no_load_speed"]
    stiffness, radius = p["cable_stiffness"], p["pulley_radius"]
    harness = p["band_centre"] / stiffness + p["step"]
    half, wall, damping = p["backlash"] / 2.0, p["pin_stiffness"], p["pin_damping"]
    coulomb, drive_inertia, electrical = p["coulomb_friction"], p["drive_inertia"], p["electrical_time_constant"]
    viscous, inertia, delay = p["viscous_friction"], p["forearm_inertia"], p["delay"]

    def rates(theta, omega, drive, speed, torque, q1, q2):
        force = stiffness * larger(0.0, harness - radius * theta)
        flex = smaller(larger((force - high) / ramp, 0.0), 1.0)
        extend = smaller(larger((low - force) / ramp, 0.0), 1.0)
        volts = supply * (flex - extend)
        gap, closing = drive - theta, speed - omega
        upper = (gap > half) * larger(0.0, wall * (gap - half) + damping * closing)
        lower = (gap < -half) * smaller(0.0, wall * (gap + half) + damping * closing)
        pin = upper + lower
        return (
            omega,
            (pin + radius * force - viscous * omega) / inertia,
            speed,
            (torque - pin - coulomb * sign(speed)) / drive_inertia,
            (stall / supply * (volts - 12.0 * q2) - stall / no_load * speed - torque) / electrical,
            q2 / delay,
            (volts - 12.0 * q1 - 6.0 * q2) / delay,
        )

    return rates


def for_scipy(p: dict[str, float], operations: Operations = FLOATS) -> Callable[[float, Array], Any]:
    """Right-hand side ``f(t, y)`` on plain floats."""
    rates = make_rates(p, operations)
    return lambda t, y: rates(*y.tolist())
