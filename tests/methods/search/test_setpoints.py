"""A loop that a setpoint only moves has the same cycles there; the witnesses are runs in fixed small steps."""

from __future__ import annotations

import math

import pytest

import eppanalysis as epp
from tests.shared import mostly_slow


def _carriage(setpoint: float) -> epp.Diagram:
    """A carriage under an anti-windup PID that hunts in static friction, wherever it is to stand."""
    return epp.Diagram(
        parts={
            "pid": epp.AntiWindupPID(
                kp=40.0, ki=30.0, tracking_time=0.3, lower=-10.0, upper=10.0, kd=8.0, filter_time=0.02
            ),
            "car": epp.blocks.Mass(mass=2.0, damping=3.0),
            "friction": epp.Friction(1.5, 2.5),
        },
        connect=["setpoint - car.position -> pid", "pid - friction -> car", "car.speed -> friction"],
        inputs={"setpoint": setpoint},
    )


def _flow(setpoint: float) -> epp.Diagram:
    """A flow through a valve that sticks, under PI."""
    return epp.Diagram(
        parts={
            "pi": epp.blocks.PI(kp=0.5, ti=6.0),
            "valve": epp.JumpAndFollow(4.0, 1.5),
            "pipe": epp.blocks.TransferFunction(num=[1.2], den=[6.0, 5.5, 1.0]),
        },
        connect=["setpoint - pipe -> pi", "pi -> valve", "valve -> pipe"],
        inputs={"setpoint": setpoint},
    )


@pytest.mark.parametrize("setpoint", mostly_slow([0.0, 2.0, 20.0, -300.0], [20.0]))
def test_a_carriage_that_hunts_hunts_at_every_setpoint(setpoint):
    found = epp.find_limit_cycles(_carriage(setpoint).to_system())
    # Steps of 10 us, Coulomb's law by hand, begun at rest 0.02 m beside the setpoint: 19.98653 s, 27.7627 mm.
    assert [c.period for c in found.stable] == [pytest.approx(19.98653, rel=2e-5)]
    assert found[0].peak_to_peak["car_position"] == pytest.approx(0.0277627, rel=3e-5)
    assert found.settles


@pytest.mark.parametrize("setpoint", mostly_slow([0.0, 30.0, -400.0], [-400.0]))
def test_a_flow_hunts_about_a_place_between_two_jumps_of_its_valve(setpoint):
    found = epp.find_limit_cycles(_flow(setpoint).to_system())
    # Steps of 0.2 ms, begun at rest with the valve at 27: 102.5397 s (±0.0004 s), 1.82666.
    assert [c.period for c in found.stable] == [pytest.approx(102.5397, rel=1e-5)]
    assert found[0].peak_to_peak["pipe"] == pytest.approx(1.82666, rel=5e-5)
    assert found.settles


@pytest.mark.parametrize("setpoint", mostly_slow([2.0, 20.0, 200.0], [20.0]))
def test_a_sampled_carriage_hunts_at_every_setpoint(setpoint):
    loop = epp.Diagram(
        parts={
            "pid": epp.blocks.PID(kp=40.0, ki=30.0, kd=8.0, tf=0.02, sample_time=0.02),
            "car": epp.blocks.Mass(mass=2.0, damping=3.0),
            "friction": epp.Friction(1.5, 2.5),
        },
        connect=["setpoint - car.position -> pid", "pid - friction -> car", "car.speed -> friction"],
        inputs={"setpoint": setpoint},
    )
    found = epp.find_limit_cycles(loop.to_system())
    # Steps of 20 us, begun at rest 0.02 m beside the setpoint: turns of 19.88 to 20.02 s.
    assert [c.period for c in found.stable] == [pytest.approx(19.95, abs=0.03)]
    assert found.settles


@pytest.mark.parametrize("setpoint", mostly_slow([1e3, 1e6, -1e4], [1e3]))
def test_a_servo_with_a_dead_zone_may_rest_at_every_setpoint(setpoint):
    """Within the dead zone nothing acts: the servo stays where it is, and hunts from farther out."""

    def servo(at: float) -> epp.CycleSearch:
        loop = epp.Diagram(
            parts={
                "switch": epp.HysteresisRelayDeadZone(on=1.0, off=0.5, level=1.0),
                "drive": epp.blocks.TransferFunction(num=[3.0], den=[1.0, 1.0, 0.2, 0.0]),
            },
            connect=["setpoint - drive -> switch", "switch -> drive"],
            inputs={"setpoint": at},
        )
        return epp.find_limit_cycles(loop.to_system())

    here, there = servo(0.0), servo(setpoint)
    assert here.settles and there.settles
    assert [c.period for c in there] == pytest.approx([c.period for c in here], rel=1e-7)


def test_a_motion_that_grows_about_a_setpoint_to_its_cycle_is_not_without_bound():
    """From a tenth of its limits the motion grows by the same ratio in each turn; its setpoint is no size of it."""
    loop = epp.Diagram(
        parts={
            "band": epp.DeadZone(-1e-3, 1e-3),
            "limit": epp.Saturation(-100.0, 100.0),
            "plant": epp.blocks.TransferFunction(
                num=[8.0], den=[1.0, 3.0, 2.0, 0.0], start=[5.03642168e-04, 7.54493188e-03, 33.7479321]
            ),
        },
        connect=["setpoint - plant -> band", "band -> limit", "limit -> plant"],
        inputs={"setpoint": 10.0},
    )
    found = epp.find_limit_cycles(loop.to_system())
    # A loop of one integrator behind a limit: the whole of its gain is 4/3 of what it bears, and from afar it is less.
    assert found.settles and not found.diverges
    assert len(found.stable) == 1


def _level(setpoint: float, load: float = 0.0, kp: float = 1.0, ti: float = 10.0, **sampled: float) -> epp.LureSystem:
    """A level under PI that a valve fills which sticks over a band of one, and slips on at once by as much."""
    parts = {
        "pi": epp.blocks.PI(kp=kp, ti=ti, **sampled),
        "limit": epp.Saturation(lower=-1.0, upper=30.0),
        "valve": epp.JumpAndFollow(stick_band=1.0, slip_jump=1.0 if sampled else 0.5),
        "pipe": epp.blocks.LowPass(bandwidth=10.0) if sampled else epp.blocks.Gain(gain=1.0),
        "tank": epp.blocks.Integrator(),
    }
    connect = ["setpoint - tank -> pi", "pi -> limit", "limit -> valve", "valve -> pipe", "pipe - load -> tank"]
    return epp.Diagram(parts=parts, connect=connect, inputs={"setpoint": setpoint, "load": load}).to_system()


@pytest.mark.parametrize("setpoint", mostly_slow([0.0, 15.0, 150.0], [15.0]))
def test_a_level_swings_by_the_band_over_the_gain_at_every_setpoint(setpoint):
    found = epp.find_limit_cycles(_level(setpoint))
    # From one slip to the next the controller crosses the band; of a swing about the setpoint its integral is even.
    assert found.stable and found.settles
    for cycle in found.stable:
        assert cycle.peak_to_peak["tank"] == pytest.approx(1.0, rel=1e-9)
        assert cycle.mean["tank"] == pytest.approx(setpoint, abs=1e-9)


@pytest.mark.parametrize("setpoint", mostly_slow([0.3, 0.7], [0.7]))
def test_a_level_at_its_setpoint_is_no_cycle_for_the_rounding_of_their_difference(setpoint):
    found = epp.find_limit_cycles(_level(setpoint, load=0.7, kp=2.0, ti=5.0, sample_time=0.1))
    assert all(cycle.peak_to_peak["tank"] > 1e-9 for cycle in found)


@pytest.mark.parametrize(("setpoint", "unit"), mostly_slow([(0.0, 100.0), (30.0, 1.0), (0.0, 0.01)], [(0.0, 100.0)]))
def test_a_sampled_flow_that_hunts_does_not_settle_from_all_starts_whatever_the_unit_of_its_valve(setpoint, unit):
    kp, ti, T, band, jump = 0.64, 3.3, 0.05, 1.6, 0.3
    loop = epp.Diagram(
        parts={
            "pi": epp.blocks.PI(kp=kp * unit, ti=ti, sample_time=T),
            "valve": epp.JumpAndFollow(stick_band=band * unit, slip_jump=jump * unit),
            "pipe": epp.blocks.TransferFunction(num=[1.0 / unit], den=[1.0, 1.0]),
        },
        connect=["setpoint - pipe -> pi", "pi -> valve", "valve -> pipe"],
        inputs={"setpoint": setpoint},
    )
    found = epp.find_limit_cycles(loop.to_system())
    assert found.cycles or not found.status.ok
    # By hand, begun with the valve stuck 0.1 beside where it should be: it slips from there to the other side and back.
    e, integral, stuck, seen = -0.1, 0.0, 0.1, []
    for k in range(40_000):
        integral += kp / ti * T * e
        u = kp * e + integral
        if abs(u - stuck) > (band + jump) / 2:
            stuck = u - math.copysign((band - jump) / 2, u - stuck)
        e = -stuck + (e + stuck) * math.exp(-T)
        seen += [e] * (k >= 20_000)
    assert max(seen) - min(seen) == pytest.approx(jump, rel=0.02)
