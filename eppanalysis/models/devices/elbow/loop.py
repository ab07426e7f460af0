"""The elbow loop as a Lur'e system: harness, cable, pulley, five-band controller, drive, lock pin, forearm.

The equations, with R the pulley's radius, x_h the harness position and delta = drive_angle - theta:

    cable stretch     s = x_h - R theta                   F_f, F_h = cable(s)
    controller        V = bands(F_f)                      V_d: V behind the dead time
    motor             tau_e dT_m/dt = (T_stall/V_max) V_d - (T_stall/omega_0) drive_speed - T_m
    drive             J_d d(drive_speed)/dt = T_m - T_c - friction(drive_speed)
    lock pin          T_c = lock_pin(delta, d(delta)/dt)
    forearm           J d(theta_dot)/dt = T_c + R F_h - B theta_dot - g_theta sin(theta)
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from eppanalysis.arrays import Array
from eppanalysis.errors import ModelError
from eppanalysis.models.devices.elbow.parameters import ElbowParameters
from eppanalysis.models.elements.base import Nonlinearity
from eppanalysis.models.elements.contact import LockPin
from eppanalysis.models.elements.dynamic.parking import ParkingBandLaw, SampledLaw
from eppanalysis.models.elements.friction import Friction
from eppanalysis.models.elements.memory import StictionPulley
from eppanalysis.models.elements.static import FiveBandLaw, PiecewiseLinear, Quantiser, Sine
from eppanalysis.models.systems.lure import LureSystem
from eppanalysis.models.systems.signals import SignalMap

__all__ = ["ElbowParameters", "elbow"]

SIGNAL_UNITS = {
    "theta": "rad",
    "theta_dot": "rad/s",
    "drive_angle": "rad",
    "drive_speed": "rad/s",
    "motor_torque": "N*m",
    "voltage": "V",
    "sensor_force": "N",
    "harness_force": "N",
    "pin_torque": "N*m",
    "pulley_stretch": "m",
    "antagonist_sensor_force": "N",
    "antagonist_harness_force": "N",
}


@dataclass(frozen=True)
class _Matrices:
    """Arrays under construction, addressed by the names of states and elements."""

    states: dict[str, int]
    inputs: dict[str, int]
    outputs: dict[str, int]
    A: Array
    B: Array
    C: Array
    D: Array
    D_input: Array
    constant_state: Array
    constant_input: Array

    @classmethod
    def empty(cls, states: list[str], elements: dict[str, Nonlinearity]) -> _Matrices:
        n = len(states)
        starts_in = np.cumsum([0, *(e.n_inputs for e in elements.values())])
        starts_out = np.cumsum([0, *(e.n_outputs for e in elements.values())])
        nz, nw = int(starts_in[-1]), int(starts_out[-1])
        return cls(
            {name: i for i, name in enumerate(states)},
            {name: int(i) for name, i in zip(elements, starts_in, strict=False)},
            {name: int(i) for name, i in zip(elements, starts_out, strict=False)},
            *(np.zeros(shape) for shape in ((n, n), (n, nw), (nz, n), (nz, nw), (nz, 1), (n,), (nz,))),
        )


def elbow(parameters: ElbowParameters, *, delay_model: Literal["pade", "exact"] = "pade") -> LureSystem:
    """The elbow's loop, at rest at its operating point.

    Parameters
    ----------
    parameters : ElbowParameters
        In SI units.
    delay_model : {"pade", "exact"}
        The controller's dead time as a Padé approximation of order 2 with two states (time domain), or as the system's
        own dead time ``exp(-s T_d)`` without states (frequency domain).

    Returns
    -------
    LureSystem
        External input "harness_position" [m], whose value at the operating point is ``v0``. States: theta, theta_dot,
        drive_angle, drive_speed, motor_torque; then, where they are used, two of the Padé approximation, the sensor
        filter's and a clock. Elements: cable, [antagonist,] [quantiser,] bands, lock_pin, [drive_friction,] [gravity].

    Raises
    ------
    ModelError
        If the parking logic and a sample period are both given.

    Notes
    -----
    Bidirectional EPP (``cable.antagonist``): a second cable with the same springs and its own pulley of the same kind
    pulls the forearm with moment -R F_h2, its stretch is ``2 pretension/K - s``, and the controller acts on
    ``F_f1 - F_f2 + centre``, so that the elbow rests where both tensions are equal.

    Where no torque acts across the backlash (antagonist), the run starts in the middle of the gap.

    Examples
    --------
    >>> from eppanalysis import ElbowParameters, elbow
    >>> system = elbow(ElbowParameters())
    >>> system.A.shape, system.input_names, round(float(system.v0[0]), 6)
    ((7, 7), ('harness_position',), 0.001658)
    """
    if parameters.parking.dwell_time is not None and parameters.controller.sample_period is not None:
        raise ModelError(
            "elbow: parking.dwell_time and controller.sample_period are both given", expected="one of them"
        )
    pade = delay_model == "pade" and parameters.controller.delay > 0
    states = _state_names(parameters, pade)
    elements = _elements(parameters)
    m = _Matrices.empty(states, elements)
    _mechanics(m, parameters)
    _drive(m, parameters, pade)
    _sensor(m, parameters)
    delays = np.zeros(m.B.shape[1])
    if not pade:
        delays[m.outputs["bands"]] = parameters.controller.delay
    cables = ("cable", "antagonist")
    start_stretch = _start_tension(parameters) / parameters.cable.forearm_stiffness
    return LureSystem.build(
        m.A,
        m.B,
        m.C,
        list(elements.values()),
        D=m.D,
        D_input=m.D_input,
        input_names=("harness_position",),
        constant_state=m.constant_state,
        constant_input=m.constant_input,
        element_names=list(elements),
        signals=_signals(m, parameters),
        x0=_start(m, parameters),
        v0=[_start_tension(parameters) / parameters.cable.stiffness],
        memory=[start_stretch if name in cables and parameters.pulley.load_friction else None for name in elements],
        delays=delays,
        state_names=states,
        principal=list(elements).index("bands"),
        name="elbow",
    )


def _state_names(p: ElbowParameters, pade: bool) -> list[str]:
    names = ["theta", "theta_dot", "drive_angle", "drive_speed", "motor_torque"]
    if pade:
        names += ["delay_level", "delay_rate"]
    if p.sensor.filter is not None:
        names.append("filtered_force")
    if p.parking.dwell_time is not None or p.controller.sample_period is not None:
        names.append("clock")
    return names


def _cable(p: ElbowParameters) -> Nonlinearity:
    """Tensions over the total stretch; the ball bearing makes both the same, and so does a straight cable."""
    if p.pulley.load_friction == 0:
        return PiecewiseLinear(
            breakpoints=np.array([0.0]), slopes=np.array([0.0, p.cable.stiffness]), intercepts=np.array([0.0, 0.0])
        )
    return StictionPulley(
        harness_stiffness=p.cable.harness_stiffness,
        forearm_stiffness=p.cable.forearm_stiffness,
        friction=p.pulley.load_friction,
        kinetic_ratio=p.pulley.kinetic_ratio,
    )


def _band_law(p: ElbowParameters) -> Nonlinearity:
    slack, low, high, top = p.bands.thresholds
    law = FiveBandLaw(slack, low, high, top, p.drive.supply_voltage, p.bands.offset_voltage)
    if p.parking.dwell_time is not None:
        return ParkingBandLaw(law, p.parking.dwell_time)
    if p.controller.sample_period is not None:
        return SampledLaw(law, p.controller.sample_period)
    return law


def _quantiser(p: ElbowParameters) -> Nonlinearity:
    """Steps beyond F_max are left out: the voltage no longer changes there."""
    step = p.sensor.force_step
    needed = math.ceil(p.bands.thresholds[3] / step) + 1
    return Quantiser(step, min(2 ** (p.sensor.bits or 0) - 1, needed))


def _elements(p: ElbowParameters) -> dict[str, Nonlinearity]:
    elements: dict[str, Nonlinearity] = {"cable": _cable(p)}
    if p.cable.antagonist:
        elements["antagonist"] = _cable(p)
    if p.sensor.bits is not None:
        elements["quantiser"] = _quantiser(p)
    elements["bands"] = _band_law(p)
    elements["lock_pin"] = LockPin(gap=p.lock_pin.backlash, stiffness=p.lock_pin.stiffness, damping=p.lock_pin.damping)
    if p.drive.coulomb_friction:
        elements["drive_friction"] = Friction(p.drive.coulomb_friction)
    if p.forearm.total_gravity_moment:
        elements["gravity"] = Sine(p.forearm.total_gravity_moment)
    return elements


def _sides(m: _Matrices, p: ElbowParameters, name: str) -> tuple[int, int]:
    """Columns of the sensor-side and the harness-side tension of a cable."""
    first = m.outputs[name]
    return first, first + (1 if p.pulley.load_friction else 0)


def _mechanics(m: _Matrices, p: ElbowParameters) -> None:
    """Forearm, lock pin and cables."""
    J, radius = p.forearm.total_inertia, p.pulley.radius
    theta, theta_dot = m.states["theta"], m.states["theta_dot"]
    drive_angle, drive_speed = m.states["drive_angle"], m.states["drive_speed"]
    m.A[theta, theta_dot] = 1.0
    m.A[theta_dot, theta_dot] = -p.forearm.viscous_friction / J
    m.B[theta_dot, m.outputs["lock_pin"]] = 1.0 / J
    m.B[theta_dot, _sides(m, p, "cable")[1]] = radius / J
    pin = m.inputs["lock_pin"]
    m.C[pin, [drive_angle, theta]] = 1.0, -1.0
    m.C[pin + 1, [drive_speed, theta_dot]] = 1.0, -1.0
    m.C[m.inputs["cable"], theta] = -radius
    m.D_input[m.inputs["cable"], 0] = 1.0
    if "antagonist" in m.inputs:
        row = m.inputs["antagonist"]
        m.B[theta_dot, _sides(m, p, "antagonist")[1]] = -radius / J
        m.C[row, theta] = radius
        m.D_input[row, 0] = -1.0
        m.constant_input[row] = 2.0 * _start_tension(p) / p.cable.stiffness
    if "gravity" in m.inputs:
        m.B[theta_dot, m.outputs["gravity"]] = -1.0 / J
        m.C[m.inputs["gravity"], theta] = 1.0


def _drive(m: _Matrices, p: ElbowParameters, pade: bool) -> None:
    """Motor and drive behind the dead time.

    The Padé approximation (1 - sT/2 + (sT)^2/12)/(1 + sT/2 + (sT)^2/12) is 1 - sT/(...): with q the filtered voltage,
    q' = r/T, r' = 12/T (V - q - r/2), V_d = V - r.
    """
    d, T = p.drive, p.controller.delay
    angle, speed, torque = m.states["drive_angle"], m.states["drive_speed"], m.states["motor_torque"]
    voltage = m.outputs["bands"]
    per_volt = d.stall_torque / d.supply_voltage / d.electrical_time_constant
    m.A[angle, speed] = 1.0
    m.A[speed, torque] = 1.0 / d.inertia
    m.B[speed, m.outputs["lock_pin"]] = -1.0 / d.inertia
    m.A[torque, torque] = -1.0 / d.electrical_time_constant
    m.A[torque, speed] = -d.stall_torque / d.no_load_speed / d.electrical_time_constant
    m.B[torque, voltage] = per_volt
    if "drive_friction" in m.inputs:
        m.B[speed, m.outputs["drive_friction"]] = -1.0 / d.inertia
        m.C[m.inputs["drive_friction"], speed] = 1.0
    if pade:
        level, rate = m.states["delay_level"], m.states["delay_rate"]
        m.A[level, rate] = 1.0 / T
        m.A[rate, [level, rate]] = -12.0 / T, -6.0 / T
        m.B[rate, voltage] = 12.0 / T
        m.A[torque, rate] = -per_volt


def _sensor(m: _Matrices, p: ElbowParameters) -> None:
    """From the sensor-side tensions through filter and quantiser to the band law, and the clock.

    The filter (lead s + 1)/(filter s + 1) passes lead/filter of the force at once, and the rest behind its lag.
    """
    weights = np.zeros(m.B.shape[1])
    weights[_sides(m, p, "cable")[0]] = 1.0
    offset = 0.0
    if p.cable.antagonist:
        weights[_sides(m, p, "antagonist")[0]] = -1.0
        offset = p.bands.parking_centre
    entry = m.inputs["quantiser" if "quantiser" in m.inputs else "bands"]
    at_once = 1.0
    if "filtered_force" in m.states:
        state, rate = m.states["filtered_force"], 1.0 / (p.sensor.filter or 1.0)
        at_once = rate * (p.sensor.lead or 0.0)
        m.A[state, state] = -rate
        m.B[state] = rate * weights
        m.constant_state[state] = rate * offset
        m.C[entry, state] = 1.0 - at_once
    m.D[entry] = at_once * weights
    m.constant_input[entry] = at_once * offset
    if "quantiser" in m.inputs:
        m.D[m.inputs["bands"], m.outputs["quantiser"]] = 1.0
    if "clock" in m.states:
        m.constant_state[m.states["clock"]] = 1.0
        m.C[m.inputs["bands"] + 1, m.states["clock"]] = 1.0


def _start_tension(p: ElbowParameters) -> float:
    """Tension of the cable (or of both) at the start [N]."""
    if p.cable.antagonist and p.cable.pretension is not None:
        return p.cable.pretension
    return p.bands.parking_centre


def _start(m: _Matrices, p: ElbowParameters) -> Array:
    """Everything at rest, the pull of the cable pressing the forearm against the flexed side of the gap."""
    x0 = np.zeros(len(m.states))
    pull = 0.0 if p.cable.antagonist else p.pulley.radius * _start_tension(p)
    if pull:
        x0[m.states["drive_angle"]] = -p.lock_pin.backlash / 2 - pull / p.lock_pin.stiffness
    if "filtered_force" in m.states:
        x0[m.states["filtered_force"]] = p.bands.parking_centre
    return x0


def _signals(m: _Matrices, p: ElbowParameters) -> SignalMap:
    """The named signals, each a state or a multiple of an element's output."""
    rows: dict[str, tuple[int, float]] = {
        "voltage": (m.outputs["bands"], 1.0),
        "sensor_force": (_sides(m, p, "cable")[0], 1.0),
        "harness_force": (_sides(m, p, "cable")[1], 1.0),
        "pin_torque": (m.outputs["lock_pin"], 1.0),
        "pulley_stretch": (_sides(m, p, "cable")[0], 1.0 / p.cable.forearm_stiffness),
    }
    if p.cable.antagonist:
        rows["antagonist_sensor_force"] = (_sides(m, p, "antagonist")[0], 1.0)
        rows["antagonist_harness_force"] = (_sides(m, p, "antagonist")[1], 1.0)
    names = [name for name in SIGNAL_UNITS if name in rows or name in m.states]
    C, D = np.zeros((len(names), len(m.states))), np.zeros((len(names), m.B.shape[1]))
    for i, name in enumerate(names):
        if name in rows:
            column, factor = rows[name]
            D[i, column] = factor
        else:
            C[i, m.states[name]] = 1.0
    units = tuple(SIGNAL_UNITS[name] for name in names)
    return SignalMap(tuple(names), C, D, np.zeros((len(names), 1)), np.zeros(len(names)), units)
