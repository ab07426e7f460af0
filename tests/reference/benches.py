"""Synthetic benches with known truth: measured CSV as a bench would leave it, from models of their own.

Nothing here uses the package: the pulley is a state machine stepped weight by weight, the forearm is pushed through the
gap sample by sample, the step response comes from :mod:`tests.reference.elbow_reference`. Every column gets noise, slow
wander, linear drift and a 12-bit converter; samples go missing and times are uneven.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tests.reference.elbow_reference import DEG, LBF, nominal, simulate_reference

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Bench:
    """A measured file and the truth behind it (SI units, by field of the case file)."""

    header: tuple[str, ...]
    rows: Array
    truth: dict[str, float]
    setting: dict[str, float] = field(default_factory=dict)

    def write(self, path: Path, digits: int = 5) -> Path:
        """The bench as CSV; nan is an empty cell."""
        lines = [",".join(self.header)]
        for row in self.rows.tolist():
            lines.append(",".join("" if math.isnan(v) else f"{v:.{digits}f}" for v in row))
        path.write_text("\n".join(lines) + "\n", encoding="utf-8")
        return path


def quantise(values: Array, low: float, high: float, bits: int = 12) -> Array:
    """What a converter reads between two ends."""
    step = (high - low) / 2**bits
    return low + step * np.clip(np.floor((values - low) / step + 0.5), 0, 2**bits - 1)


def disturbed(rng: np.random.Generator, clean: Array, noise: float, drift: float, wander: float = 0.0) -> Array:
    """White noise, a linear drift over the whole record, and a slow wander (first-order, a twentieth of the record)."""
    n = clean.size
    phi = math.exp(-20.0 / n)
    steps = rng.normal(size=n) * math.sqrt(1 - phi**2)
    slow = np.empty(n)
    level = rng.normal()
    for i, s in enumerate(steps.tolist()):
        level = phi * level + s
        slow[i] = level
    return clean + noise * rng.normal(size=n) + drift * np.linspace(-0.5, 0.5, n) + wander * slow


def thin(rng: np.random.Generator, rows: Array, share: float) -> Array:
    """Rows without some that went missing, single ones and one stretch."""
    keep = rng.random(len(rows)) > share
    gap = int(rng.integers(0, len(rows) - 1))
    keep[gap : gap + max(1, int(share * len(rows) / 2))] = False
    keep[[0, -1]] = True
    return rows[keep]


def sensed(forces: Sequence[float], static: float, kinetic: float) -> Array:
    """Force behind the pulley, weight by weight: |F - f| <= mu (F + f); on breaking away it slides down to kappa mu."""
    f, sliding, out = 0.0, 0, []
    for force in forces:
        if sliding == 0 and force - f > static * (force + f):
            sliding = 1
        elif sliding == 0 and f - force > static * (force + f):
            sliding = -1
        up, down = force * (1 - kinetic) / (1 + kinetic), force * (1 + kinetic) / (1 - kinetic)
        if sliding == 1:
            f, sliding = (up, 1) if up >= f else (f, 0)
            sliding = -1 if sliding == 0 and f - force > static * (force + f) else sliding
            f = down if sliding == -1 else f
        elif sliding == -1:
            f, sliding = (down, -1) if down <= f else (f, 0)
            sliding = 1 if sliding == 0 and force - f > static * (force + f) else sliding
            f = up if sliding == 1 else f
        out.append(f)
    return np.array(out)


def weight_tray(
    seed: int, bearing: bool = False, continuous: bool | None = None, known: dict[str, float] | None = None
) -> Bench:
    """Weights added and removed two or three times, or a force that rises and falls evenly; some benches saturate."""
    rng = np.random.default_rng([1, seed])
    given = known or {}
    friction = given.get("pulley.friction", 0.0 if bearing else rng.uniform(0.02, 0.08))
    ratio = given.get("pulley.kinetic_ratio", rng.uniform(0.55, 0.98))
    gain = given.get("sensor.gain", 2.0 / LBF * rng.uniform(0.9, 1.1))
    saturation = given.get("sensor.full_scale", rng.uniform(8.0, 9.0) if rng.random() < 0.5 else 10.0)
    even = bool(rng.random() < 0.5) if continuous is None else continuous
    cycles = int(rng.integers(2, 4))
    if even:
        up = np.linspace(0.0, 5.0 * LBF, 400)
        forces = np.concatenate([np.append(up, up[-2:0:-1])] * cycles)
        true = forces
    else:
        increment = rng.uniform(0.1, 0.25) * LBF
        levels = np.arange(0.0, 5.0 * LBF + 1e-9, increment)
        one = np.append(levels, levels[-2:0:-1])
        true = np.concatenate([one] * cycles + [levels[:1]])
        forces = np.repeat(true, int(rng.integers(10, 30)))
    behind = sensed(true, friction, ratio * friction)
    behind = np.repeat(behind, forces.size // true.size)
    volts = np.minimum(rng.normal(0.0, 0.02) + gain * behind, saturation)
    volts = disturbed(rng, volts, rng.uniform(0.001, 0.02), rng.normal(0, 0.03), rng.uniform(0, 0.01))
    time = np.cumsum(rng.uniform(0.05, 0.15, forces.size))
    rows = np.column_stack([time, forces / LBF, quantise(np.minimum(volts, saturation + 0.05), 0.0, 10.0)])
    truth = {"pulley.friction": friction, "sensor.gain": gain}
    if not bearing:
        truth["pulley.kinetic_ratio"] = ratio
    if saturation < 9.5:
        truth["sensor.full_scale"] = saturation
    return Bench(("time [s]", "force [lbf]", "voltage [V]"), thin(rng, rows, rng.uniform(0, 0.05)), truth)


def hand_motion(rng: np.random.Generator, cycles: int, strongest: float) -> tuple[Array, Array, Array]:
    """Time [s], place in the gap from -1 to 1, and what a hand that goes to and fro presses onto the pin [N*m]."""
    dt, place, press = 0.002, [], []
    for _ in range(cycles):
        for side in (1.0, -1.0):
            cross = int(rng.uniform(0.15, 0.4) / dt)
            stay = int(rng.uniform(0.3, 0.8) / dt)
            ease = 0.5 * (1.0 - np.cos(np.pi * np.arange(cross) / cross))
            place.append(side * (2.0 * ease - 1.0))
            press.append(np.zeros(cross))
            hump = np.sin(np.pi * (np.arange(stay) + 0.5) / stay) ** 0.5
            place.append(np.full(stay, side))
            press.append(side * rng.uniform(0.2, 1.0) * strongest * hump)
    p, q = np.concatenate(place), np.concatenate(press)
    return np.cumsum(rng.uniform(0.6, 1.4, p.size) * dt), p, q


def cable_force(stretch: Array, p: dict[str, float]) -> Array:
    """Sensor force over a stretch that changes slowly: two springs and between them a sticking pulley."""
    friction = p["pulley_friction"] * math.sin(p["flexion_angle"] / 2.0)
    if friction == 0.0:
        return p["cable_stiffness"] * stretch
    k_h = p["cable_stiffness"] * (1.0 + p["spring_ratio"]) / p["spring_ratio"]
    k_f, kinetic = p["spring_ratio"] * k_h, p["kinetic_ratio"] * friction
    u, sliding, before, out = stretch[0] / (1.0 + p["spring_ratio"]), 0, stretch[0], []
    for s in stretch.tolist():
        harness, sensor = k_h * (s - u), k_f * u
        if sliding * (s - before) < 0:
            sliding = 0
        if sliding == 0 and abs(harness - sensor) >= friction * (harness + sensor):
            sliding = 1 if harness > sensor else -1
        if sliding:
            m = sliding * kinetic
            u = k_h * s * (1 - m) / (k_h * (1 - m) + k_f * (1 + m))
        before = s
        out.append(k_f * u)
    return np.array(out)


def backlash_cycling(seed: int, torque: bool | None = None, known: dict[str, float] | None = None) -> Bench:
    """Forearm taken through the gap by hand; the pin yields, the cable pulls; the hand's torque recorded or light."""
    rng = np.random.default_rng([2, seed])
    with_torque = bool(rng.random() < 0.5) if torque is None else torque
    p = nominal(
        backlash=rng.uniform(0.25, 3.0) * DEG,
        cable_stiffness=6705.263 * rng.uniform(0.6, 1.5),
        pin_stiffness=1000.0 * (rng.uniform(0.5, 2.0) if with_torque else 1.0),
    )
    if known is None and rng.random() < 0.3:
        p["pulley_friction"] = rng.uniform(0.01, 0.06)
    p |= known or {}
    time, place, press = hand_motion(rng, int(rng.integers(5, 12)), 2.0 if with_torque else 0.02)
    radius, stiffness, pin = p["pulley_radius"], p["cable_stiffness"], p["pin_stiffness"]
    x = rng.uniform(2.0, 3.0) * LBF / stiffness
    # The pin yields to what is pressed onto it; the hand carries that less the cable's pull.
    theta = place * p["backlash"] / 2.0 + press / pin
    force = cable_force(x - radius * theta, p)
    hand = press - radius * force
    theta = disturbed(rng, theta + rng.uniform(0.2, 1.5), rng.uniform(0.005, 0.03) * DEG, rng.normal(0, 0.05) * DEG)
    force = disturbed(rng, force, rng.uniform(0.005, 0.03) * LBF, rng.normal(0, 0.05) * LBF, rng.uniform(0, 0.01) * LBF)
    columns = [time, quantise(theta, 0.0, 150.0 * DEG) / DEG, quantise(force, 0.0, 5.0 * LBF) / LBF]
    header = ["time [s]", "angle [deg]", "force [lbf]"]
    truth = {"lock_pin.backlash": p["backlash"], "cable.stiffness": stiffness, "K R": stiffness * radius}
    if with_torque:
        columns.append(quantise(disturbed(rng, hand, 0.02, 0.02), -5.0, 5.0))
        header.append("torque [N*m]")
        truth["lock_pin.stiffness"] = pin
    rows = thin(rng, np.column_stack(columns), rng.uniform(0, 0.05))
    setting = {"pulley.friction": p["pulley_friction"]}
    return Bench(tuple(header), rows, truth, setting if with_torque else {**setting, "press": 0.02})


#: Names of the reference's parameters by the field of the case file.
FIELDS = {
    "drive.inertia": "drive_inertia",
    "drive.coulomb_friction": "coulomb_friction",
    "drive.electrical_time_constant": "electrical_time_constant",
    "controller.delay": "delay",
    "lock_pin.backlash": "backlash",
    "cable.stiffness": "cable_stiffness",
    "pulley.friction": "pulley_friction",
    "lock_pin.stiffness": "pin_stiffness",
}


def step_response(
    seed: int, known: dict[str, float] | None = None, force: bool = True, t_end: float = 2.0, rate: float = 500.0
) -> Bench:
    """Step response, with a limit cycle or without, whose case knows backlash and cable only within tolerances."""
    rng = np.random.default_rng([3, seed])
    truth = {
        "drive.inertia": rng.uniform(0.02, 0.045),
        "drive.coulomb_friction": rng.uniform(0.15, 0.5),
        "drive.electrical_time_constant": rng.uniform(0.5e-3, 2e-3),
        "controller.delay": rng.uniform(0.5e-3, 4e-3),
        "lock_pin.backlash": rng.uniform(0.3, 3.0) * DEG,
        "cable.stiffness": 6705.263 * rng.uniform(0.8, 1.2),
    } | (known or {})
    p = nominal(**{FIELDS[name]: value for name, value in truth.items()})
    t = np.arange(-0.02, t_end, 1.0 / rate)
    t = np.sort(t + rng.uniform(-0.3, 0.3, t.size) / rate)
    after = t[t > 0]
    try:
        run = simulate_reference(p, t_end=t_end + 0.01, t_eval=after, rtol=1e-8, atol=1e-10)
    except RuntimeError:  # a stop found again and again within rounding; other steps of the integrator pass it
        run = simulate_reference(p, t_end=t_end + 0.01, t_eval=after, rtol=1e-9, atol=1e-11)
    still = np.zeros(t.size - after.size)
    theta = np.concatenate([still, run.signals["theta"]])
    tension = np.concatenate([still + p["band_centre"], run.signals["sensor_force"]])
    theta = disturbed(
        rng, theta + 0.3, rng.uniform(0.01, 0.05) * DEG, rng.normal(0, 0.2) * DEG, rng.uniform(0, 0.02) * DEG
    )
    tension = disturbed(rng, tension, rng.uniform(0.005, 0.03) * LBF, rng.normal(0, 0.03) * LBF, 0.005 * LBF)
    columns = [t, quantise(theta, 0.0, 150.0 * DEG) / DEG]
    header = ["time [s]", "angle [deg]"]
    if force:
        columns.append(quantise(tension, 0.0, 20.0 * LBF) / LBF)
        header.append("force [lbf]")
    rows = thin(rng, np.column_stack(columns), rng.uniform(0, 0.05))
    setting = {}
    for name, share in (("lock_pin.backlash", 0.02), ("cable.stiffness", 0.02)):
        setting[name] = truth[name] * (1 + share / 1.96 * rng.normal())
    return Bench(tuple(header), rows, truth, setting)
