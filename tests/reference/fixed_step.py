"""The elbow loop with a fixed small step and the formulas as they are printed (min, max, sgn): no events, first order.

It is far too rough to check digits, but it has no modes that could be wrong: it witnesses the mode logic.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class _Pulley:
    """Forearm spring's stretch u, moved along at every step."""

    def __init__(self, p: dict[str, float]) -> None:
        self.k_h = p["cable_stiffness"] * (1.0 + p["spring_ratio"]) / p["spring_ratio"]
        self.k_f = p["spring_ratio"] * self.k_h
        self.static = p["pulley_friction"] * math.sin(p["flexion_angle"] / 2.0)
        self.kinetic = p["kinetic_ratio"] * self.static
        self.u = p["band_centre"] / self.k_f
        self.direction = 0
        self.reached = 0.0

    def forces(self, s: float) -> tuple[float, float]:
        """(sensor force, harness force) for the total stretch, reached from that of the step before."""
        if self.direction * (s - self.reached) < 0.0:
            self.direction = 0
        self.reached = s
        sensor, harness = self.k_f * max(0.0, self.u), self.k_h * max(0.0, s - self.u)
        if self.direction == 0 and abs(harness - sensor) > self.static * (harness + sensor):
            self.direction = 1 if harness > sensor else -1
        if self.direction != 0 or self.static == 0.0:
            m = self.direction * self.kinetic
            self.u = max(0.0, self.k_h * (1.0 - m) * s / (self.k_h * (1.0 - m) + self.k_f * (1.0 + m)))
        return self.k_f * max(0.0, self.u), self.k_h * max(0.0, s - self.u)


def _voltage(force: float, p: dict[str, float]) -> float:
    c, w, r = p["band_centre"], p["parking_width"], p["band_range"]
    ramp = (r - w) / 2.0
    up = min(max((force - c - w / 2.0) / ramp, 0.0), 1.0)
    down = min(max((c - w / 2.0 - force) / ramp, 0.0), 1.0)
    return p["supply_voltage"] * (up - down)


def _pin_torque(delta: float, delta_rate: float, p: dict[str, float]) -> float:
    half, k, c = p["backlash"] / 2.0, p["pin_stiffness"], p["pin_damping"]
    if delta > half:
        return max(0.0, k * (delta - half) + c * delta_rate)
    return min(0.0, k * (delta + half) + c * delta_rate) if delta < -half else 0.0


def _next_speed(speed: float, net: float, p: dict[str, float], dt: float) -> float:
    limit = p["coulomb_friction"]
    if speed == 0.0:
        return 0.0 if abs(net) <= limit else dt * (net - math.copysign(limit, net)) / p["drive_inertia"]
    new = speed + dt * (net - math.copysign(limit, speed)) / p["drive_inertia"]
    return 0.0 if new * speed < 0.0 else new


def theta_with_fixed_step(
    p: dict[str, float], dt: float, t_end: float, every: int, second: tuple[float, float] | None = None
) -> Array:
    """Angle theta [rad] at every `every`-th step from t = 0.

    Parameters
    ----------
    p : dict of str to float
        Parameters as of elbow_reference.nominal.
    dt, t_end : float
        [s].
    every : int
    second : (float, float), optional
        Time [s] and size [m] of a second step of the harness.
    """
    pulley, radius = _Pulley(p), p["pulley_radius"]
    x_h = p["band_centre"] / p["cable_stiffness"] + p["step"]
    theta = omega = speed = torque = q1 = q2 = 0.0
    drive = -p["backlash"] / 2.0 - radius * p["band_centre"] / p["pin_stiffness"]
    out = []
    for i in range(round(t_end / dt) + 1):
        if i % every == 0:
            out.append(theta)
        if second is not None and i == round(second[0] / dt):
            x_h += second[1]
        sensor, harness = pulley.forces(x_h - radius * theta)
        volts = _voltage(sensor, p)
        pin = _pin_torque(drive - theta, speed - omega, p)
        torque_rate = (
            p["stall_torque"] * ((volts - 12.0 * q2) / p["supply_voltage"] - speed / p["no_load_speed"]) - torque
        )
        moment = pin + radius * harness - p["viscous_friction"] * omega - p["gravity_moment"] * math.sin(theta)
        new_omega = omega + dt * moment / p["forearm_inertia"]
        new_speed = _next_speed(speed, torque - pin, p, dt)
        theta, drive = theta + dt * (omega + new_omega) / 2.0, drive + dt * (speed + new_speed) / 2.0
        torque += dt * torque_rate / p["electrical_time_constant"]
        q1, q2 = q1 + dt * q2 / p["delay"], q2 + dt * (volts - 12.0 * q1 - 6.0 * q2) / p["delay"]
        omega, speed = new_omega, new_speed
    return np.array(out)
