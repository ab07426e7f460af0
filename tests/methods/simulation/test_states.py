"""Integrators without an input, which are held inputs, and those without a reader, which may go on for ever."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import integrate

import eppanalysis as epp

A = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.0, -2.0, -3.0]])
B, C = np.array([[0.0], [0.0], [5.0]]), np.array([[1.0, 0.0, 0.0]])
TURN = np.linalg.qr(np.random.default_rng(1).normal(size=(4, 4)))[0]
LOAD = 0.3


def with_input(element: epp.Nonlinearity) -> epp.LureSystem:
    return epp.LureSystem.build(A, -B, C, [element], B_input=B, input_names=["load"], v0=[LOAD])


def with_state(element: epp.Nonlinearity, turn: np.ndarray) -> epp.LureSystem:
    whole = np.zeros((4, 4))
    whole[:3, :3], whole[:3, 3] = A, B[:, 0]
    drive, seen, start = np.vstack([-B, [[0.0]]]), np.append(C, 0.0)[None], np.array([0.0, 0.0, 0.0, LOAD])
    return epp.LureSystem.build(turn @ whole @ turn.T, turn @ drive, seen @ turn.T, [element], x0=turn @ start)


@pytest.mark.parametrize("turn", [np.eye(4), TURN], ids=["as it is", "turned"])
@pytest.mark.parametrize("element", [epp.Relay(), epp.HysteresisRelay(-0.1, 0.1)], ids=lambda e: e.kind)
def test_a_held_state_is_a_held_input(element: epp.Nonlinearity, turn: np.ndarray) -> None:
    loop, other = with_input(element), with_state(element, turn)
    (wanted,), (found,) = epp.predict_limit_cycles(loop), epp.predict_limit_cycles(other)
    assert found.period == pytest.approx(wanted.period, rel=1e-9)
    assert found.error_estimate == pytest.approx(wanted.error_estimate, rel=1e-6)
    exact = epp.exact_orbit(loop, wanted).period
    for cycle in (epp.exact_orbit(other, found), epp.harmonic_balance(other, found, order=41)):
        assert cycle.period == pytest.approx(exact, rel=1e-9 if cycle.method == "exact orbit" else 2e-3)
        assert (turn.T @ cycle.state)[3] == pytest.approx(LOAD, rel=1e-9)
    assert abs(exact / epp.exact_orbit(with_input(element), wanted, {"load": 0.0}).period - 1.0) > 0.03


@pytest.mark.slow
@pytest.mark.parametrize("turn", [np.eye(4), TURN], ids=["as it is", "turned"])
def test_a_search_does_not_move_a_held_state(turn: np.ndarray) -> None:
    (wanted,) = epp.find_limit_cycles(with_input(epp.Relay()))
    found = epp.find_limit_cycles(with_state(epp.Relay(), turn))
    assert [c.period for c in found] == [pytest.approx(wanted.period, rel=1e-9)]
    assert found.status is epp.Status.CONVERGED and not found.settles and "continuum" not in str(found)


def speed_control(element: epp.Nonlinearity, reads: str = "") -> epp.LureSystem:
    """A motor's speed under control, with its angle among the states, which nothing reads."""
    motor, setpoint = epp.blocks.Inertia(inertia=1.0, damping=0.5), epp.blocks.Constant(value=10.0)
    return epp.Diagram(
        parts={"controller": element, "motor": motor, "setpoint": setpoint},
        connect=["setpoint - motor.speed -> controller", "controller -> motor"],
        signals={"speed": "motor.speed", "angle": "motor.angle"} if reads != "angle first" else
        {"angle": "motor.angle", "speed": "motor.speed"},
    ).to_system()  # fmt: skip


@pytest.mark.parametrize("order", ["", "angle first"])
def test_a_speed_rests_while_its_angle_goes_on(order):
    run = epp.simulate(speed_control(epp.Saturation(-20.0, 20.0, 100.0), order), t_end=20.0)
    assert run.status is epp.Status.SETTLED and str(run).startswith("Settles at rest: speed at 9.95")
    assert run.settled_at["speed"] == pytest.approx(1000.0 / 100.5) and "angle" not in run.settled_at
    assert run.signals["angle"][-1] == pytest.approx(np.trapezoid(run.signals["speed"], run.t), rel=1e-4)


def test_a_speed_swings_on_a_cycle_while_its_angle_goes_on():
    """A relay of 0 and 20 between speeds of 9.5 and 10.5: both times are logarithms."""
    loop = speed_control(epp.HysteresisRelay(-0.5, 0.5, 0.0, 20.0))
    rises, falls = (2.0 * np.log((40.0 - 9.5) / (40.0 - 10.5)), 2.0 * np.log(10.5 / 9.5))
    period, turned = rises + falls, (20.0 * rises - 0.0) / 0.5  # the mean torque over the damping
    run, search = epp.simulate(loop, t_end=40.0), epp.find_limit_cycles(loop)
    assert [c.stable for c in search] == [True] and search.status.ok
    for cycle in (run.limit_cycle, search[0], epp.exact_orbit(loop, run.limit_cycle)):
        assert cycle.period == pytest.approx(period, rel=1e-9)
        assert cycle.peak_to_peak["speed"] == pytest.approx(1.0, rel=1e-9)
        # The swing of the angle, beside what it gains: the speed about its mean, integrated.
        mean = turned / period
        t = np.linspace(0.0, rises, 2001), np.linspace(0.0, falls, 2001)
        speed = 40.0 - 30.5 * np.exp(-0.5 * t[0]), 10.5 * np.exp(-0.5 * t[1])
        angle = [integrate.cumulative_trapezoid(v - mean, s, initial=0.0) for v, s in zip(speed, t, strict=True)]
        angle[1] = angle[1] + angle[0][-1]
        assert cycle.peak_to_peak["angle"] == pytest.approx(np.ptp(np.concatenate(angle)), rel=1e-5)
        assert f"{turned:.4g} to angle" in cycle.note


def drill(turned: bool = False) -> epp.LureSystem:
    """A rotary table that turns a bit through a long shaft: two angles, of which their difference alone is read."""
    parts = {
        "table": epp.blocks.Inertia(inertia=2122.0, damping=425.0),
        "bit": epp.blocks.Inertia(inertia=374.0),
        "string": epp.blocks.Shaft(stiffness=473.0, damping=23.2),
        "rock": epp.StribeckFriction(coulomb=3000.0, static=5000.0, velocity=2.0, viscous=20.0),
        "drive": epp.blocks.Constant(value=6500.0),
    }
    loop = epp.Diagram(
        parts=parts,
        connect=[
            "drive - string -> table",
            "table.angle - bit.angle -> string.twist",
            "table.speed - bit.speed -> string.rate",
            "string - rock -> bit",
            "bit.speed -> rock",
        ],
        signals={"bit": "bit.speed", "twist": "table.angle - bit.angle", "angle": "table.angle"},
    ).to_system()
    Q = np.linalg.qr(np.random.default_rng(2).normal(size=(4, 4)))[0]
    return loop.in_coordinates(Q.T, Q) if turned else loop


@pytest.mark.parametrize("turned", [False, True])
def test_a_drill_string_sticks_and_slips_while_all_its_angles_go_on(turned):
    """Held against the same string with its twist as the state."""
    A = [
        [-(425.0 + 23.2) / 2122.0, 23.2 / 2122.0, -473.0 / 2122.0],
        [23.2 / 374.0, -23.2 / 374.0, 473.0 / 374.0],
        [1, -1, 0],
    ]
    rock = epp.StribeckFriction(coulomb=3000.0, static=5000.0, velocity=2.0, viscous=20.0)
    twisted = epp.LureSystem.build(
        A,
        [[0], [-1.0 / 374.0], [0]],
        [[0, 1, 0]],
        [rock],
        element_names=["rock"],
        constant_state=[6500.0 / 2122.0, 0, 0],
    )
    known = epp.simulate(twisted, t_end=300.0).limit_cycle
    run = epp.simulate(drill(turned), t_end=300.0)
    assert run.limit_cycle.period == pytest.approx(known.period, rel=1e-6)
    assert run.limit_cycle.peak_to_peak["bit"] == pytest.approx(next(iter(known.peak_to_peak.values())), rel=1e-6)
    assert epp.exact_orbit(drill(turned), run.limit_cycle).period == pytest.approx(known.period, rel=1e-6)


def test_an_encoder_between_two_levels_of_a_speed_makes_cycles_whose_angles_go_on():
    """A sampled controller: the swing of the angle is that of the speed about its mean, integrated."""
    loop = epp.Diagram(
        parts={
            "controller": epp.blocks.PI(kp=2.0, ti=0.05, sample_time=0.01),
            "motor": epp.blocks.Inertia(inertia=0.05, damping=0.02),
            "encoder": epp.Quantiser(0.5, 200),
            "setpoint": epp.blocks.Constant(value=5.2),
        },
        connect=["setpoint - encoder -> controller", "controller -> motor", "motor.speed -> encoder"],
        signals={"angle": "motor.angle", "speed": "motor.speed"},
    ).to_system()
    run = epp.simulate(loop, t_end=30.0)
    for cycle in (run.limit_cycle, epp.exact_orbit(loop, run.limit_cycle)):
        assert cycle.peak_to_peak["angle"] < cycle.peak_to_peak["speed"] * cycle.period
        moving = cycle.waveform["speed"] - cycle.mean["speed"]
        swing = integrate.cumulative_trapezoid(moving, cycle.time, initial=0.0)
        assert cycle.peak_to_peak["angle"] == pytest.approx(np.ptp(swing), rel=1e-2)
        assert "to angle" in cycle.note and "locked to the samples" in cycle.note.lower()
