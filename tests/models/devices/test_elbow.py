"""The elbow's matrices against its equations, written out by hand; its start; its options."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, strategies as st

import eppanalysis as epp
from eppanalysis.errors import ModelError
from eppanalysis.models.devices.elbow.loop import elbow
from eppanalysis.models.devices.elbow.parameters import (
    Bands,
    Cable,
    Controller,
    Drive,
    Forearm,
    Harness,
    LockPinParameters,
    Parking,
    Pulley,
    Sensor,
)

NOMINAL = epp.ElbowParameters()
BALL_BEARING = replace(NOMINAL, pulley=Pulley(friction=0.0))
OPTIONS = {
    "nominal": NOMINAL,
    "ball bearing": BALL_BEARING,
    "no delay": replace(BALL_BEARING, controller=Controller(delay=0.0)),
    "no drive friction": replace(BALL_BEARING, drive=Drive(coulomb_friction=0.0)),
    "no gap": replace(BALL_BEARING, lock_pin=LockPinParameters(backlash=0.0)),
    "upright": replace(BALL_BEARING, forearm=Forearm(upright=True)),
    "two cables": replace(BALL_BEARING, cable=Cable(antagonist=True)),
    "two cables, pretension, friction": replace(NOMINAL, cable=Cable(antagonist=True, pretension=20.0)),
    "offset": replace(BALL_BEARING, bands=Bands(offset_voltage=2.0)),
    "asymmetric": replace(BALL_BEARING, bands=Bands(slack=2.0, low=8.0, high=12.0, max=30.0)),
    "quantiser": replace(BALL_BEARING, sensor=Sensor(bits=12)),
    "filter": replace(BALL_BEARING, sensor=Sensor(filter=5e-3)),
    "filter and quantiser": replace(BALL_BEARING, sensor=Sensor(filter=5e-3, bits=8)),
    "lead": replace(BALL_BEARING, sensor=Sensor(filter=2e-3, lead=20e-3)),
    "sampled": replace(BALL_BEARING, controller=Controller(sample_period=2e-3)),
    "parking": replace(BALL_BEARING, parking=Parking(dwell_time=0.5)),
}


def tension(p: epp.ElbowParameters, stretch: float) -> float:
    return p.cable.stiffness * max(0.0, stretch)


def voltage(p: epp.ElbowParameters, force: float) -> float:
    slack, low, high, top = p.bands.thresholds
    supply = p.drive.supply_voltage
    if force < low:
        return -supply * min(1.0, (low - force) / (low - slack))
    return supply * min(1.0, max(0.0, force - high) / (top - high))


def pin_torque(p: epp.ElbowParameters, delta: float, rate: float) -> float:
    pin = p.lock_pin
    if delta > pin.backlash / 2:
        return max(0.0, pin.stiffness * (delta - pin.backlash / 2) + pin.damping * rate)
    if delta < -pin.backlash / 2:
        return min(0.0, pin.stiffness * (delta + pin.backlash / 2) + pin.damping * rate)
    return 0.0


def rates_by_hand(p: epp.ElbowParameters, x: np.ndarray, x_h: float) -> np.ndarray:
    """The equations of the model with a ball bearing, away from standstill."""
    theta, theta_dot, angle, speed, torque, q, r = x
    force = tension(p, x_h - p.pulley.radius * theta)
    contact = pin_torque(p, angle - theta, speed - theta_dot)
    V = voltage(p, force)
    d, T = p.drive, p.controller.delay
    g = p.forearm.total_gravity_moment
    return np.array(
        [
            theta_dot,
            (contact + p.pulley.radius * force - p.forearm.viscous_friction * theta_dot - g * math.sin(theta))
            / p.forearm.total_inertia,
            speed,
            (torque - contact - d.coulomb_friction * np.sign(speed)) / d.inertia,
            (d.stall_torque / d.supply_voltage * (V - r) - d.stall_torque / d.no_load_speed * speed - torque)
            / d.electrical_time_constant,
            r / T,
            12.0 / T * (V - q - r / 2.0),
        ]
    )


def outputs(system: epp.LureSystem, x: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Outputs of memoryless elements; a cascade settles in as many rounds as it has members."""
    w = np.zeros(system.B.shape[1])
    for _ in range(3):
        z = system.C @ x + system.D @ w + system.D_input @ v + system.constant_input
        for element, zs, ws in zip(system.elements, system.input_slices, system.output_slices, strict=True):
            inputs = z[zs] if zs.stop - zs.start > 1 else z[zs.start]
            w[ws] = element.output(inputs)[0]
    return w


def rates(system: epp.LureSystem, x: np.ndarray, v: np.ndarray, w: np.ndarray) -> np.ndarray:
    return system.A @ x + system.B @ w + system.B_input @ v + system.constant_state


angles = st.floats(-0.2, 0.6)
speeds = st.one_of(st.floats(-5.0, -0.01), st.floats(0.01, 5.0))


@given(
    st.tuples(angles, speeds, angles, speeds, st.floats(-10, 10), st.floats(-16, 16), st.floats(-16, 16)),
    st.floats(0.0, 0.04),
    st.sampled_from([0.0, 1.324]),
)
def test_rates_are_the_equations(state: tuple[float, ...], x_h: float, gravity: float) -> None:
    p = replace(BALL_BEARING, forearm=Forearm(gravity_moment=gravity))
    system, x, v = elbow(p), np.array(state), np.array([x_h])
    names = ("theta", "theta_dot", "drive_angle", "drive_speed", "motor_torque", "delay_level", "delay_rate")
    assert system.state_names == names
    expected = rates_by_hand(p, x, x_h)
    found = rates(system, x, v, outputs(system, x, v))
    np.testing.assert_allclose(found, expected, rtol=1e-11, atol=1e-9)


@given(st.tuples(angles, speeds, angles, speeds, st.floats(-10, 10)), st.floats(0.0, 0.04))
def test_signals_are_what_their_names_say(state: tuple[float, ...], x_h: float) -> None:
    system = elbow(BALL_BEARING)
    x, v = np.array([*state, 0.0, 0.0]), np.array([x_h])
    m = system.signals
    values = m.C @ x + m.D @ outputs(system, x, v) + m.D_input @ v + m.constant
    found = dict(zip(m.names, values, strict=True))
    force = tension(BALL_BEARING, x_h - 0.019 * state[0])
    assert list(found)[:5] == ["theta", "theta_dot", "drive_angle", "drive_speed", "motor_torque"]
    assert found["sensor_force"] == found["harness_force"] == pytest.approx(force)
    assert found["voltage"] == pytest.approx(voltage(BALL_BEARING, force))
    assert found["pin_torque"] == pytest.approx(pin_torque(BALL_BEARING, state[2] - state[0], state[3] - state[1]))
    assert found["pulley_stretch"] == pytest.approx(force / (6705.263 * 5))
    assert len(m.units) == len(m.names) == 10


@pytest.mark.parametrize("parameters", OPTIONS.values(), ids=OPTIONS.keys())
def test_start_is_at_rest(parameters: epp.ElbowParameters) -> None:
    """Forces balance at the start, the drive's friction being what is left (it holds unless it is left out)."""
    p, system = parameters, elbow(parameters)
    tensions = p.cable.pretension or p.bands.parking_centre
    w = np.zeros(system.B.shape[1])
    by_name = dict(zip(system.element_names, system.output_slices, strict=True))
    for name in ("cable", "antagonist"):
        if name in by_name:
            w[by_name[name]] = tensions
    pull = 0.0 if p.cable.antagonist else p.pulley.radius * tensions
    w[by_name["lock_pin"]] = -pull
    if "drive_friction" in by_name:
        assert pull <= p.drive.coulomb_friction
        w[by_name["drive_friction"]] = pull
    x_rate = rates(system, system.x0, system.v0, w)
    if "clock" in system.state_names:
        assert x_rate[system.state_names.index("clock")] == 1.0
        x_rate[system.state_names.index("clock")] = 0.0
    if "drive_friction" not in by_name:
        x_rate[system.state_names.index("drive_speed")] -= pull / p.drive.inertia
    np.testing.assert_allclose(x_rate, 0.0, atol=1e-9)
    # Each element gives these outputs at the start.
    z = system.C @ system.x0 + system.D_input @ system.v0 + system.constant_input
    inputs = dict(zip(system.element_names, system.input_slices, strict=True))
    assert z[inputs["cable"]][0] == pytest.approx(tensions / p.cable.stiffness)
    delta, rate = z[inputs["lock_pin"]]
    assert rate == 0.0 and pin_torque(p, delta, 0.0) == pytest.approx(-pull, abs=1e-12)
    if "antagonist" in inputs:
        assert z[inputs["antagonist"]][0] == pytest.approx(tensions / p.cable.stiffness)
    if p.pulley.friction:
        u = system.memory[system.element_names.index("cable")]
        assert u is not None
        k_f, k_h = p.cable.forearm_stiffness, p.cable.harness_stiffness
        assert k_f * u == pytest.approx(tensions)
        assert k_h * (z[inputs["cable"]][0] - u) == pytest.approx(tensions)


@pytest.mark.parametrize("parameters", OPTIONS.values(), ids=OPTIONS.keys())
def test_controller_reads_the_centre_at_the_start(parameters: epp.ElbowParameters) -> None:
    system = elbow(parameters)
    if parameters.pulley.friction:
        pytest.skip("the pulley's forces follow from its memory")
    w = outputs(system, system.x0, system.v0)
    z = system.C @ system.x0 + system.D @ w + system.D_input @ system.v0 + system.constant_input
    bands = system.element_names.index("bands")
    force = z[system.input_slices[bands].start]
    step = parameters.sensor.force_step if parameters.sensor.bits else 1e-9
    assert force == pytest.approx(parameters.bands.parking_centre, abs=step / 2)
    assert w[system.output_slices[bands].start] == 0.0


def test_springs_in_series() -> None:
    cable = Cable(stiffness=6705.263, spring_ratio=4.0)
    k_h, k_f = cable.harness_stiffness, cable.forearm_stiffness
    assert k_h * k_f / (k_h + k_f) == pytest.approx(6705.263) and k_f / k_h == pytest.approx(4.0)


@pytest.mark.parametrize("delay", [1e-3, 0.02])
def test_delay_is_the_pade_approximation(delay: float) -> None:
    system = elbow(replace(BALL_BEARING, controller=Controller(delay=delay)))
    poles = np.linalg.eigvals(system.A)
    for pole in np.roots([delay**2 / 12, delay / 2, 1.0]):
        assert np.min(np.abs(poles - pole)) < 1e-6 * abs(pole)
    exact = elbow(replace(BALL_BEARING, controller=Controller(delay=delay)), delay_model="exact")
    assert exact.A.shape[0] == system.A.shape[0] - 2
    pin = system.input_slices[system.element_names.index("lock_pin")].start
    bands = system.output_slices[system.element_names.index("bands")].start
    omega = np.array([0.5, 1.0]) / delay
    ratio = system.frequency_response(omega)[:, pin, bands] / exact.frequency_response(omega)[:, pin, bands]
    # The error of the phase of order 2 is (omega T)^5/720 to leading order.
    phase_error = np.angle(ratio)
    np.testing.assert_allclose(phase_error, (omega * delay) ** 5 / 720, rtol=0.1)
    np.testing.assert_allclose(np.abs(ratio), 1.0, rtol=1e-9)


def test_upright_follows_from_the_prehensor() -> None:
    assert Forearm(upright=True).total_gravity_moment == pytest.approx(0.45 * 9.80665 * 0.30)
    heavy = Forearm(prehensor_mass=0.9, upright=True)
    assert heavy.total_gravity_moment == pytest.approx(0.9 * 9.80665 * 0.30)
    assert heavy.total_inertia == pytest.approx(0.9 * 0.09 + 0.006)


def test_elements_follow_the_options() -> None:
    names = {key: elbow(p).element_names for key, p in OPTIONS.items()}
    assert names["ball bearing"] == ("cable", "bands", "lock_pin", "drive_friction")
    assert names["two cables"] == ("cable", "antagonist", "bands", "lock_pin", "drive_friction")
    assert names["quantiser"] == ("cable", "quantiser", "bands", "lock_pin", "drive_friction")
    assert names["upright"][-1] == "gravity" and "drive_friction" not in names["no drive friction"]
    units = elbow(OPTIONS["two cables"]).signals
    assert "antagonist_sensor_force" in units.names


def test_antagonist_pulls_the_other_way() -> None:
    """Bidirectional: with x_h 1 mm further out the tensions differ by 2 K times that, and flexion evens them out."""
    p = OPTIONS["two cables"]
    system = elbow(p)
    x = system.x0.copy()
    w = outputs(system, x, system.v0 + 1e-3)
    assert w[0] - w[1] == pytest.approx(2 * p.cable.stiffness * 1e-3)
    x[0] = 1e-3 / p.pulley.radius
    w = outputs(system, x, system.v0 + 1e-3)
    assert w[0] == pytest.approx(w[1])
    moment = system.B[1, :2]
    assert moment[0] == -moment[1] == p.pulley.radius / p.forearm.total_inertia


def test_straight_cable_has_no_friction_at_the_pulley() -> None:
    """At full extension both pulls on the pulley cancel: the loop is that with the ball bearing."""
    nominal = epp.ElbowParameters()
    straight = elbow(replace(nominal, pulley=replace(nominal.pulley, flexion_angle=0.0)))
    bearing = elbow(OPTIONS["ball bearing"])
    assert straight.element_names == bearing.element_names
    np.testing.assert_array_equal(straight.B, bearing.B)


def test_quantiser_has_the_steps_of_the_converter() -> None:
    system = elbow(OPTIONS["quantiser"])
    quantiser = system.elements[system.element_names.index("quantiser")]
    step = 10.0 / 4096 / (2.0 / 4.4482216152605)
    for force in (11.0, 11.12, 16.0):
        read = float(quantiser.output(force)[0])
        assert abs(read - force) <= step / 2 * (1 + 1e-12) and read / step == pytest.approx(round(read / step))


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Drive(inertia=0.0), "inertia is 0.0; expected a positive number"),
        (lambda: Drive(stall_torque=math.nan), "expected a finite number"),
        (lambda: Bands(slack=1.0), "expected all four or none"),
        (lambda: Bands(slack=1.0, low=3.0, high=2.0, max=4.0), "slack < low < high < max"),
        (lambda: Bands(parking_width=20.0), "slack < low < high < max"),
        (lambda: Bands(centre=0.1), "low is"),
        (lambda: Cable(pretension=1.0), "pretension is given without antagonist"),
        (lambda: Pulley(kinetic_ratio=1.2), "expected at most 1"),
        (lambda: Pulley(flexion_angle=4.0), "at most 180 deg"),
        (lambda: Pulley(friction=1.5), "never slides"),
        (lambda: Forearm(upright=True, gravity_moment=1.0), "expected one of them"),
        (lambda: Sensor(bits=0), "a whole number from 1 to 24"),
        (lambda: Sensor(bits=30), "from 1 to 24"),
        (lambda: Harness(step=math.inf), "expected a finite number"),
        (lambda: Parking(dwell_time=-1.0), "expected a positive number"),
        (lambda: elbow(replace(OPTIONS["sampled"], parking=Parking(1.0))), "expected one of them"),
    ],
)
def test_refusals(make: object, message: str) -> None:
    with pytest.raises(ModelError, match=message):
        make()
