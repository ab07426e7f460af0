"""The elbow loop integrated from its equations with scipy and explicit modes: a witness that shares no package code.

Conventions (SI): `x_h` is constant for t > 0 and equals (band centre)/K + step, so that without the step both
tensions would be at the band centre at theta = 0. State: theta, theta_dot, drive_angle, drive_speed, motor_torque,
and two states of the Padé delay, which is ``V - 12 q2`` with ``T q1' = q2``, ``T q2' = V - 12 q1 - 6 q2``.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tests.reference.events import Guard, Options, integrate
from tests.reference.verdict import judge

Array = NDArray[np.float64]

LBF = 4.4482216152605
DEG = math.pi / 180.0

#: Names of the signals, in the order of :meth:`Elbow.signals`.
SIGNALS = (
    "theta",
    "theta_dot",
    "drive_angle",
    "drive_speed",
    "motor_torque",
    "voltage",
    "sensor_force",
    "harness_force",
    "pin_torque",
    "pulley_stretch",
)

#: Rows of the truth table: what differs from the nominal parameters, and what must come out.
ROWS: dict[int, dict[str, Any]] = {
    1: {"name": "fig8a_original", "changes": {}, "must": "oscillate"},
    2: {"name": "fig8b_reduced_backlash", "changes": {"backlash": 0.5 * DEG}, "must": "settle"},
    3: {
        "name": "gain_brings_it_back",
        "changes": {"band_range": 1.0 * LBF, "backlash": 0.5 * DEG},
        "must": "oscillate",
    },
    4: {
        "name": "fig6a_original_pulley",
        "changes": {"band_range": 1.0 * LBF, "backlash": 0.25 * DEG, "pulley_friction": 0.0526},
        "must": "oscillate",
    },
    5: {
        "name": "fig6b_ball_bearing",
        "changes": {"band_range": 1.0 * LBF, "backlash": 0.25 * DEG},
        "must": "settle",
    },
    6: {"name": "soft_cable", "changes": {"cable_stiffness": 6705.263 / 4.0}, "must": "settle"},
    7: {"name": "light_forearm", "changes": {"forearm_inertia": 0.3 * 0.0465}, "must": "settle"},
    8: {"name": "upright", "changes": {"backlash": 0.25 * DEG, "gravity_moment": 1.324}, "must": "settle"},
}


def nominal(**overrides: float) -> dict[str, float]:
    """Nominal parameters (table values as printed, ball bearing) with some replaced; SI units.

    Raises
    ------
    KeyError
        If a name is unknown.
    """
    values = {
        "supply_voltage": 16.0,
        "no_load_speed": 164.0 * DEG,
        "stall_torque": 10.93,
        "drive_inertia": 0.03,
        "coulomb_friction": 0.3,
        "electrical_time_constant": 1e-3,
        "delay": 1e-3,
        "band_centre": 2.5 * LBF,
        "parking_width": 0.2 * LBF,
        "band_range": 2.5 * LBF,
        "backlash": 2.5 * DEG,
        "pin_stiffness": 1000.0,
        "pin_damping": 1.0,
        "forearm_inertia": 0.0465,
        "viscous_friction": 0.01,
        "gravity_moment": 0.0,
        "cable_stiffness": 6705.263,
        "spring_ratio": 4.0,
        "pulley_radius": 0.019,
        "pulley_friction": 0.0,
        "flexion_angle": 116.4 * DEG,
        "kinetic_ratio": 0.8,
        "step": 0.020,
    }
    unknown = set(overrides) - set(values)
    if unknown:
        raise KeyError(f"unknown parameters {sorted(unknown)}")
    return values | overrides


def row(number: int) -> dict[str, float]:
    """Parameters of a row of the truth table."""
    return nominal(**ROWS[number]["changes"])


class Mode(NamedTuple):
    """Discrete state; `stretch` is the forearm spring's stretch u [m] while the pulley sticks."""

    drive: str  # stuck, slip+, slip-
    pin: str  # gap; touch+, touch- (pushing); off+, off- (inside the wall's place, damping would pull: no torque)
    band: int  # 0 slack, 1 extension, 2 parking, 3 flexion, 4 full flexion
    cable: str  # ball bearing: taut, slack; friction: stuck, up, down, slack
    stretch: float


class Elbow:
    """Rates, guards and switches of the elbow."""

    def __init__(self, p: dict[str, float]) -> None:
        self.p = p
        c, w, r = p["band_centre"], p["parking_width"], p["band_range"]
        self.thresholds = (c - r / 2.0, c - w / 2.0, c + w / 2.0, c + r / 2.0)
        self.k_h = p["cable_stiffness"] * (1.0 + p["spring_ratio"]) / p["spring_ratio"]
        self.k_f = p["spring_ratio"] * self.k_h
        self.x_rest = c / p["cable_stiffness"]
        self.x_h = self.x_rest + p["step"]
        self.friction = p["pulley_friction"] * math.sin(p["flexion_angle"] / 2.0)
        kinetic = p["kinetic_ratio"] * self.friction
        self.slide = {"up": self.line(kinetic), "down": self.line(-kinetic)}
        self.breakaway = {"up": self.line(self.friction), "down": self.line(-self.friction)}

    def line(self, m: float) -> float:
        """u/s where F_h - F_f = m (F_h + F_f), from k_h (s - u)(1 - m) = k_f u (1 + m)."""
        return self.k_h * (1.0 - m) / (self.k_h * (1.0 - m) + self.k_f * (1.0 + m))

    # Cable and pulley ------------------------------------------------------------------------------------------------
    def cable(self, y: Array, mode: Mode) -> tuple[float, float, float]:
        """(sensor force, harness force, stretch u)."""
        s = self.x_h - self.p["pulley_radius"] * y[0]
        if self.friction == 0.0:
            tension = self.p["cable_stiffness"] * s
            return (tension, tension, tension / self.k_f) if mode.cable == "taut" else (0.0, 0.0, tension / self.k_f)
        if mode.cable == "slack":
            return 0.0, 0.0, 0.0
        u = mode.stretch if mode.cable == "stuck" else self.slide[mode.cable] * s
        return self.k_f * u, self.k_h * (s - u), u

    def voltage(self, force: float, band: int) -> float:
        """Five-band law, the piece taken from the mode."""
        slack, low, high, top = self.thresholds
        v_max = self.p["supply_voltage"]
        if band == 1:
            return -v_max * (low - force) / (low - slack)
        if band == 3:
            return v_max * (force - high) / (top - high)
        return {0: -v_max, 2: 0.0, 4: v_max}[band]

    # Lock pin --------------------------------------------------------------------------------------------------------
    def push(self, y: Array, side: float) -> float:
        """Spring and damper of the wall on one side [N·m], before the rule that it only pushes."""
        delta, delta_rate = y[2] - y[0], y[3] - y[1]
        half = self.p["backlash"] / 2.0
        return self.p["pin_stiffness"] * (delta - side * half) + self.p["pin_damping"] * delta_rate

    def pin_torque(self, y: Array, mode: Mode) -> float:
        """T_c [N·m]."""
        if mode.pin == "touch+":
            return self.push(y, 1.0)
        return self.push(y, -1.0) if mode.pin == "touch-" else 0.0

    # Motion ----------------------------------------------------------------------------------------------------------
    def rate(self, t: float, y: Array, mode: Mode) -> Array:
        """Time derivative of the state."""
        p = self.p
        theta, omega, _, speed, torque, q1, q2 = y
        sensor, harness, _ = self.cable(y, mode)
        volts = self.voltage(sensor, mode.band)
        pin = self.pin_torque(y, mode)
        delay = p["delay"]
        delayed = volts - 12.0 * q2 if delay > 0.0 else volts
        forearm = pin + p["pulley_radius"] * harness - p["viscous_friction"] * omega
        if p["gravity_moment"] != 0.0:
            forearm -= p["gravity_moment"] * math.sin(theta)
        drive = 0.0
        if mode.drive != "stuck":
            sign = 1.0 if mode.drive == "slip+" else -1.0
            drive = (torque - pin - sign * p["coulomb_friction"]) / p["drive_inertia"]
        electric = (
            p["stall_torque"] / p["supply_voltage"] * delayed - p["stall_torque"] / p["no_load_speed"] * speed - torque
        ) / p["electrical_time_constant"]
        dq1, dq2 = (q2 / delay, (volts - 12.0 * q1 - 6.0 * q2) / delay) if delay > 0.0 else (0.0, 0.0)
        return np.array([omega, forearm / p["forearm_inertia"], speed, drive, electric, dq1, dq2])

    def guards(self, mode: Mode) -> list[Guard]:
        """All guards of a mode."""
        return [*self._drive_guards(mode), *self._pin_guards(mode), *self._band_guards(mode), *self._cable_guards(mode)]

    def _drive_guards(self, mode: Mode) -> list[Guard]:
        limit = self.p["coulomb_friction"]
        if limit == 0.0 and mode.drive != "stuck":
            return []  # nothing happens where the speed changes its sign
        if mode.drive == "stuck":
            return [
                Guard("drive slip+", lambda t, y: y[4] - self.pin_torque(y, mode) - limit, 10.0),
                Guard("drive slip-", lambda t, y: self.pin_torque(y, mode) - y[4] - limit, 10.0),
            ]
        sign = 1.0 if mode.drive == "slip+" else -1.0
        return [Guard("drive stops", lambda t, y: -sign * y[3], 1.0)]

    def _pin_guards(self, mode: Mode) -> list[Guard]:
        half = self.p["backlash"] / 2.0
        if mode.pin == "gap":
            return [
                Guard("pin touch+", lambda t, y: y[2] - y[0] - half, 0.01),
                Guard("pin touch-", lambda t, y: y[0] - y[2] - half, 0.01),
            ]
        name, side = mode.pin[-1], 1.0 if mode.pin[-1] == "+" else -1.0
        if mode.pin.startswith("touch"):
            # With damping the push vanishes before the wall's place is left; without, at the same moment.
            target = "pin off" + name if self.p["pin_damping"] > 0.0 else "pin gap"
            return [Guard(target, lambda t, y: -side * self.push(y, side), 10.0)]
        return [
            Guard("pin gap", lambda t, y: half - side * (y[2] - y[0]), 0.01),
            Guard("pin touch" + name, lambda t, y: side * self.push(y, side), 10.0),
        ]

    def _band_guards(self, mode: Mode) -> list[Guard]:
        out = []
        if mode.band < 4:
            upper = self.thresholds[mode.band]
            out.append(Guard(f"band {mode.band + 1}", lambda t, y: self.cable(y, mode)[0] - upper, 1.0))
        if mode.band > 0:
            lower = self.thresholds[mode.band - 1]
            out.append(Guard(f"band {mode.band - 1}", lambda t, y: lower - self.cable(y, mode)[0], 1.0))
        return out

    def _cable_guards(self, mode: Mode) -> list[Guard]:
        radius, x_h = self.p["pulley_radius"], self.x_h
        slack = Guard("cable slack", lambda t, y: radius * y[0] - x_h, 0.01)
        if mode.cable == "slack":
            return [Guard("cable taut", lambda t, y: x_h - radius * y[0], 0.01)]
        if mode.cable == "taut":
            return [slack]
        if mode.cable == "up":
            return [Guard("pulley sticks", lambda t, y: y[1], 1.0)]
        if mode.cable == "down":
            return [Guard("pulley sticks", lambda t, y: -y[1], 1.0), slack]
        up, down, u = self.breakaway["up"], self.breakaway["down"], mode.stretch
        return [
            Guard("pulley up", lambda t, y: up * (x_h - radius * y[0]) - u, 0.01),
            Guard("pulley down", lambda t, y: u - down * (x_h - radius * y[0]), 0.01),
        ]

    def switch(self, t: float, y: Array, mode: Mode, label: str) -> tuple[Array, Mode]:
        """State and mode just after an event."""
        kind, name = label.split(" ")
        if kind == "drive":
            return self._switch_drive(y, mode, name)
        if kind == "pin":
            mode = mode._replace(pin=name)
        elif kind == "band":
            mode = mode._replace(band=int(name))
        elif kind == "pulley":
            mode = self._switch_pulley(y, mode, name)
        elif self.friction == 0.0 or name == "slack":
            mode = mode._replace(cable=name, stretch=0.0)
        else:
            mode = mode._replace(cable="up")
        return y, self._released(y, mode)

    def _switch_drive(self, y: Array, mode: Mode, name: str) -> tuple[Array, Mode]:
        y = y.copy()
        y[3] = 0.0
        if name != "stops":
            return y, mode._replace(drive=name)
        return y, self._released(y, mode._replace(drive="stuck"))

    def _released(self, y: Array, mode: Mode) -> Mode:
        """The drive slips at once where a jump of the pin's torque exceeds its friction."""
        net = y[4] - self.pin_torque(y, mode)
        if mode.drive == "stuck" and abs(net) > self.p["coulomb_friction"]:
            return mode._replace(drive="slip+" if net > 0.0 else "slip-")
        return mode

    def _switch_pulley(self, y: Array, mode: Mode, name: str) -> Mode:
        if name == "sticks":
            return mode._replace(cable="stuck", stretch=self.cable(y, mode)[2])
        # The jump takes u to the kinetic line; the pulley slides on only if the cable still moves that way.
        s = self.x_h - self.p["pulley_radius"] * y[0]
        moves_on = y[1] < 0.0 if name == "up" else y[1] > 0.0
        mode = mode._replace(cable=name if moves_on else "stuck", stretch=self.slide[name] * s)
        return mode._replace(band=self.band_of(self.cable(y, mode)[0]))

    def band_of(self, force: float) -> int:
        """Number of the band that holds a force."""
        return sum(force > threshold for threshold in self.thresholds)

    # Start and output ------------------------------------------------------------------------------------------------
    def start(self) -> tuple[Array, Mode]:
        """State and mode just after the step at t = 0."""
        p = self.p
        pull = p["pulley_radius"] * p["band_centre"]
        y = np.zeros(7)
        y[2] = -p["backlash"] / 2.0 - pull / p["pin_stiffness"]
        u = self.x_rest / (1.0 + p["spring_ratio"])
        if self.friction == 0.0:
            cable = "taut" if self.x_h > 0.0 else "slack"
            mode = Mode("stuck", "touch-", 2, cable, 0.0)
        else:
            mode = self._stepped(y, Mode("stuck", "touch-", 2, "stuck", u))
        mode = mode._replace(band=self.band_of(self.cable(y, mode)[0]))
        return y, self._released(y, mode)

    def _stepped(self, y: Array, mode: Mode) -> Mode:
        """The pulley after a step of x_h, stuck before."""
        s, u = self.x_h - self.p["pulley_radius"] * y[0], mode.stretch
        if s <= 0.0:
            return mode._replace(cable="slack", stretch=0.0)
        if u < self.breakaway["up"] * s:
            return self._switch_pulley(y, mode, "up")
        return self._switch_pulley(y, mode, "down") if u > self.breakaway["down"] * s else mode

    def taken_over(self, y: Array, mode: Mode, stretch: float, jump: float) -> Mode:
        """Mode just behind a jump of the harness to this elbow's place, from the mode and the stretch u before it.

        A pulley that slides one way is at rest on the other: against its motion the jump finds it stuck as it was.
        """
        s = self.x_h - self.p["pulley_radius"] * y[0]
        if self.friction == 0.0:
            mode = mode._replace(cable="taut" if s > 0.0 else "slack")
        elif s <= 0.0 or {"up": 1.0, "down": -1.0}.get(mode.cable, 0.0) * jump <= 0.0:
            held = mode._replace(cable="stuck", stretch=stretch)
            mode = held._replace(cable="slack", stretch=0.0) if s <= 0.0 else self._stepped(y, held)
        mode = mode._replace(band=self.band_of(self.cable(y, mode)[0]))
        return self._released(y, mode)

    def signals(self, y: Array, mode: Mode) -> tuple[float, ...]:
        """Values of SIGNALS."""
        sensor, harness, u = self.cable(y, mode)
        return (*y[:5], self.voltage(sensor, mode.band), sensor, harness, self.pin_torque(y, mode), u)


@dataclass(frozen=True)
class ReferenceRun:
    """What :func:`simulate_reference` returns; `verdict` is "settle", "oscillate" or "undecided"."""

    t: Array
    signals: dict[str, Array]
    events: list[tuple[float, str]]
    verdict: str
    amplitude: float
    peak_to_peak: float
    period: float
    n_steps: int = 0
    provenance: dict[str, Any] = field(default_factory=dict)


def simulate_reference(
    parameters: dict[str, float],
    t_end: float = 6.0,
    t_eval: Sequence[float] | Array | None = None,
    rtol: float = 1e-10,
    atol: float = 1e-12,
    method: str = "DOP853",
    land: bool = False,
    second: tuple[float, float] | None = None,
) -> ReferenceRun:
    """Step response of the elbow.

    Parameters
    ----------
    parameters : dict of str to float
        From :func:`nominal`.
    t_end : float
        [s].
    t_eval : array, shape (nt,), optional
        Sample times [s]; every millisecond by default. A sample at an event time is taken just before the event.
    rtol, atol : float
        Tolerances of the integrator.
    method : str
        Name of a scipy integrator.
    land : bool
        Integrate to every sample in place of interpolating (slower, a little more exact).
    second : (float, float), optional
        Time [s], at which no sample is taken, and size [m] of a second step of the harness.

    Raises
    ------
    RuntimeError
        If the integration fails or events accumulate.
    """
    grid = np.arange(round(t_end * 1000.0) + 1) / 1000.0
    wanted = grid if t_eval is None else np.asarray(t_eval, float)
    times = np.union1d(grid, wanted)
    elbow, options = Elbow(parameters), Options(rtol, atol, method, land=land)
    until, step = second or (t_end, 0.0)
    run = integrate(elbow, *elbow.start(), until, times[times <= until], options)
    rows = [elbow.signals(y, m) for y, m in zip(run.states, run.modes, strict=True)]
    t, events, n_steps = list(run.times), list(run.events), run.n_steps
    if second is not None and run.end_state is not None:
        moved = Elbow(parameters | {"step": parameters["step"] + step})
        mode = moved.taken_over(run.end_state, run.end_mode, elbow.cable(run.end_state, run.end_mode)[2], step)
        later = times[(times > until) & (times <= t_end)]
        run = integrate(moved, run.end_state, mode, t_end - until, later - until, options)
        rows += [moved.signals(y, m) for y, m in zip(run.states, run.modes, strict=True)]
        t += later.tolist()
        events += [(at + until, label) for at, label in run.events]
        n_steps += run.n_steps
    table = np.array(rows)
    every = dict(zip(SIGNALS, table.T, strict=True))
    t = np.array(t)
    chosen = np.searchsorted(t, wanted)
    verdict, peak_to_peak, period = judge(t, every["theta"], every["theta_dot"])
    return ReferenceRun(
        t=wanted,
        signals={name: values[chosen] for name, values in every.items()},
        events=events,
        verdict=verdict,
        amplitude=peak_to_peak / 2.0,
        peak_to_peak=peak_to_peak,
        period=period,
        n_steps=n_steps,
        provenance={"rtol": rtol, "atol": atol, "method": method},
    )
