"""The elbow drawn as an engineer draws it: the same runs, cycles and folds as the built-in one."""

from dataclasses import replace

import numpy as np
import pytest

import eppanalysis as epp
from eppanalysis.models.elements.dynamic.parking import ParkingBandLaw, SampledLaw
from tests.shared import cycles_of, of_kind

ELBOWS = of_kind("elbow")


def _mechanics(p):
    """Motor with its inertia, lock pin, forearm, and the pulley that turns angle into way and tension into torque."""
    pull = 0.0 if p.cable.antagonist else p.pulley.radius * _tension(p)
    contact = -p.lock_pin.backlash / 2 - pull / p.lock_pin.stiffness if pull else 0.0
    torque_constant = p.drive.stall_torque / p.drive.supply_voltage
    parts = {
        "motor": epp.blocks.Motor(
            resistance=1.0, inductance=p.drive.electrical_time_constant, torque_constant=torque_constant,
            back_emf=p.drive.supply_voltage / p.drive.no_load_speed, inertia=p.drive.inertia, start=[contact, 0.0, 0.0],
        ),
        "torque_constant": epp.blocks.Gain(gain=torque_constant),
        "forearm": epp.blocks.Inertia(inertia=p.forearm.total_inertia, damping=p.forearm.viscous_friction),
        "pulley": epp.blocks.Gain(gain=p.pulley.radius),
        "lever": epp.blocks.Gain(gain=p.pulley.radius),
        "lock_pin": epp.LockPin(gap=p.lock_pin.backlash, stiffness=p.lock_pin.stiffness, damping=p.lock_pin.damping),
    }  # fmt: skip
    connect = [
        "motor.angle - forearm.angle -> lock_pin.twist", "motor.speed - forearm.speed -> lock_pin.rate",
        "motor.current -> torque_constant", "forearm.angle -> pulley",
    ]  # fmt: skip
    load, torque = "-lock_pin", "lock_pin + lever"
    if p.drive.coulomb_friction:
        parts["drive_friction"] = epp.Friction(p.drive.coulomb_friction)
        connect.append("motor.speed -> drive_friction")
        load += " - drive_friction"
    if p.forearm.total_gravity_moment:
        parts["gravity"] = epp.Sine(p.forearm.total_gravity_moment)
        connect.append("forearm.angle -> gravity")
        torque += " - gravity"
    return parts, [*connect, f"{load} -> motor.torque", f"{torque} -> forearm.torque"]


def _cables(p):
    """The cable, or two of them, and the names of their two tensions."""
    stretch = epp.blocks.Gain(gain=1.0 / p.cable.forearm_stiffness)
    cable = (
        epp.StictionPulley(
            p.cable.harness_stiffness, p.cable.forearm_stiffness, p.pulley.load_friction, p.pulley.kinetic_ratio
        )
        if p.pulley.friction
        else epp.PiecewiseLinear([0.0], [0.0, p.cable.stiffness], [0.0, 0.0])
    )
    one, two = ("{}.sensor", "{}.harness") if p.pulley.friction else ("{}", "{}")
    parts, connect = {"cable": cable, "stretch": stretch}, ["harness_position - pulley -> cable"]
    connect.append(f"{one.format('cable')} -> stretch")
    sensed, pulled = one.format("cable"), two.format("cable")
    signals = {"sensor_force": sensed, "harness_force": pulled}
    if p.cable.antagonist:
        parts["antagonist"] = cable
        parts["wound_up"] = epp.blocks.Constant(value=2.0 * _tension(p) / p.cable.stiffness)
        parts["centre"] = epp.blocks.Constant(value=p.bands.parking_centre)
        connect.append("wound_up - harness_position + pulley -> antagonist")
        signals |= {f"antagonist_{k}": v.replace("cable", "antagonist") for k, v in signals.items()}
        sensed += f" - {one.format('antagonist')} + centre"
        pulled += f" - {two.format('antagonist')}"
    return parts, [*connect, f"{pulled} -> lever"], sensed, signals


def _controller(p, sensed):
    """Filter, converter, band law and dead time, to the motor's voltage."""
    parts, connect = {}, []
    if p.sensor.filter is not None:
        start = [p.bands.parking_centre]
        parts["filter"] = epp.blocks.LowPass(bandwidth=1.0 / p.sensor.filter, start=start)
        connect.append(f"{sensed} -> filter")
        if p.sensor.lead is not None:
            at_once = p.sensor.lead / p.sensor.filter
            parts |= {"behind": epp.blocks.Gain(gain=1.0 - at_once), "at_once": epp.blocks.Gain(gain=at_once)}
            connect += ["filter -> behind", f"{sensed} -> at_once"]
        sensed = "filter" if p.sensor.lead is None else "behind + at_once"
    if p.sensor.bits is not None:
        needed = int(np.ceil(p.bands.thresholds[3] / p.sensor.force_step)) + 1
        parts["quantiser"] = epp.Quantiser(p.sensor.force_step, min(2**p.sensor.bits - 1, needed))
        connect.append(f"{sensed} -> quantiser")
        sensed = "quantiser"
    law = epp.FiveBandLaw(*p.bands.thresholds, p.drive.supply_voltage, p.bands.offset_voltage)
    parking, period = p.parking.dwell_time, p.controller.sample_period
    if parking is None and period is None:
        parts["bands"] = law
        connect.append(f"{sensed} -> bands")
    else:
        parts["bands"] = SampledLaw(law, period) if parking is None else ParkingBandLaw(law, parking)
        parts |= {"second": epp.blocks.Constant(value=1.0), "clock": epp.blocks.Integrator()}
        connect += ["second -> clock", f"{sensed} -> bands.{parts['bands'].input_ports[0]}", "clock -> bands.clock"]
    T = p.controller.delay
    if not T:
        return parts, [*connect, "bands -> motor.voltage"]
    parts["pade"] = epp.blocks.TransferFunction(num=[T * T / 12.0, -T / 2.0, 1.0], den=[T * T / 12.0, T / 2.0, 1.0])
    return parts, [*connect, "bands -> pade", "pade -> motor.voltage"]


def _tension(p):
    return p.cable.pretension if p.cable.antagonist and p.cable.pretension is not None else p.bands.parking_centre


def drawn(p):
    """An elbow as a diagram."""
    cables, wires, sensed, tensions = _cables(p)
    controller, law_wires = _controller(p, sensed)
    mechanics, shafts = _mechanics(p)
    # Rounding in a run depends on the order of the states; forearm and motor come first, as in the built-in elbow.
    first = {name: mechanics.pop(name) for name in ("forearm", "motor")}
    slack = {name: _tension(p) / p.cable.forearm_stiffness for name in ("cable", "antagonist") if name in cables}
    return epp.Diagram(
        parts={**first, **cables, **controller, **mechanics},
        connect=[*wires, *law_wires, *shafts],
        inputs={"harness_position": _tension(p) / p.cable.stiffness},
        signals={
            "theta": "forearm.angle", "theta_dot": "forearm.speed", "drive_angle": "motor.angle",
            "drive_speed": "motor.speed", "motor_torque": "torque_constant", "voltage": "bands",
            "pin_torque": "lock_pin", "pulley_stretch": "stretch", **tensions,
        },
        memory=slack if p.pulley.friction else {},
        principal="bands",
        margins_at="bands",
        name="drawn elbow",
    )  # fmt: skip


#: What moves by much within the time that rounding moves an event by.
FAST = ("theta_dot", "drive_speed", "motor_torque", "voltage", "pin_torque")
CLOSE = 1e-12


def _require_same_run(loop, drawing, motion, t_end):
    """The same events, at times and with signals that differ by 1e-12.

    A shift of the events by that time [s] counts where a signal is steep: the built-in loop with its states in another
    order differs from itself by as much.
    """
    grid = np.linspace(0.0, t_end, 1501)
    one, other = (epp.simulate(system, motion, t_end=t_end, t_eval=grid) for system in (loop, drawing))
    assert one.status is other.status
    assert [(e.element, e.name) for e in one.events] == [(e.element, e.name) for e in other.events]
    np.testing.assert_allclose([e.time for e in other.events], [e.time for e in one.events], rtol=0.0, atol=CLOSE)
    for name in loop.signals.names:
        expected = one.signals[name]
        steepest = np.abs(np.diff(expected)).max() / grid[1] if name in FAST else 0.0
        atol = CLOSE * (np.abs(expected).max() + steepest)
        np.testing.assert_allclose(other.signals[name], expected, rtol=0.0, atol=atol, err_msg=name)


@pytest.mark.parametrize("name", ELBOWS)
def test_a_drawn_elbow_runs_as_the_built_in_one(name):
    case = epp.case(name)
    drawing = drawn(case.elbow_parameters).to_system()
    _require_same_run(case.to_system(), drawing, case.input, case.t_end)


VARIANTS = {
    "antagonist": {"cable": {"antagonist": True}},
    "antagonist_with_stiction": {"cable": {"antagonist": True, "pretension": 8.0}, "pulley": {"friction": 0.0526}},
    "quantiser_and_filter": {"sensor": {"bits": 8, "filter": 2e-3}},
    "antagonist_with_lead": {"cable": {"antagonist": True}, "sensor": {"filter": 5e-3, "lead": 20e-3}},
    "sampled_law": {"controller": {"sample_period": 5e-3}},
    "no_delay_and_no_friction": {"controller": {"delay": 0.0}, "drive": {"coulomb_friction": 0.0}},
    "offset_and_gravity": {"bands": {"offset_voltage": 1.0}, "forearm": {"gravity_moment": 1.3}},
}


@pytest.mark.parametrize("name", VARIANTS)
def test_every_feature_of_the_elbow_can_be_drawn(name):
    parameters = epp.case("fig8a_original").elbow_parameters
    for section, values in VARIANTS[name].items():
        parameters = replace(parameters, **{section: replace(getattr(parameters, section), **values)})
    _require_same_run(epp.elbow(parameters), drawn(parameters).to_system(), epp.inputs.Step(0.02), 0.5)


def test_a_dead_time_in_the_drawing_is_that_of_the_built_in_elbow():
    parameters = epp.case("fig8a_original").elbow_parameters
    drawing = drawn(parameters)
    late = epp.blocks.DeadTime(delay=parameters.controller.delay)
    loop = replace(drawing, parts={**drawing.parts, "pade": late}).to_system()
    expected = epp.elbow(parameters, delay_model="exact")
    np.testing.assert_array_equal(loop.delays, expected.delays)
    omega = np.geomspace(0.1, 1000.0, 9)
    found, response = loop.frequency_response(omega), expected.frequency_response(omega)
    size = np.abs(response).max(axis=0)
    np.testing.assert_allclose(found / (size + (size == 0)), response / (size + (size == 0)), rtol=0.0, atol=1e-12)


@pytest.mark.parametrize("name", ELBOWS)
def test_a_drawn_elbow_has_the_margins_of_the_built_in_one(name):
    case = epp.case(name)
    one, other = epp.margins(case, at="bands.out"), epp.margins(drawn(case.elbow_parameters).to_system())
    assert other.at == "bands.out"
    for margin in ("gain_margin", "phase_margin", "disk_margin", "delay_margin"):
        assert getattr(other, margin) == pytest.approx(getattr(one, margin), rel=1e-9, nan_ok=True), margin


@pytest.mark.parametrize(
    "name",
    [
        "fig8a_original",
        pytest.param("fig6a_original_pulley", marks=pytest.mark.slow),
        pytest.param("gain_brings_it_back", marks=pytest.mark.slow),
    ],
)
def test_a_drawn_elbow_has_the_cycles_of_the_built_in_one(name):
    case = epp.case(name)
    drawing = drawn(case.elbow_parameters).to_system()
    one, other = cycles_of(name), epp.find_limit_cycles(drawing, operating_point=case.operating_point)
    assert len(one) == len(other) == 2
    for expected, found in zip(one, other, strict=True):
        assert found.stable is expected.stable
        assert found.period == pytest.approx(expected.period, rel=1e-9)
        for signal, size in expected.peak_to_peak.items():
            assert found.peak_to_peak[signal] == pytest.approx(size, rel=1e-9), signal
        assert np.abs(found.multipliers).max() == pytest.approx(np.abs(expected.multipliers).max(), rel=1e-9)


@pytest.mark.slow
def test_a_drawn_elbow_has_the_fold_of_the_built_in_one():
    case = epp.case("fig8a_original").with_values({"lock_pin.backlash": "1.1 deg"})
    drawing = epp.Case.from_system(drawn(case.elbow_parameters).to_system(), input=case.input, t_end=case.t_end)
    settings = {"start": np.deg2rad(1.1), "stop": np.deg2rad(0.9), "n_points": 80, "max_step": 0.05, "n_others": 0}
    (expected,) = epp.continue_branch(case, "lock_pin.backlash", **settings).folds
    (found,) = epp.continue_branch(drawing, "lock_pin.gap", **settings).folds
    assert found.value == pytest.approx(expected.value, rel=1e-9)
