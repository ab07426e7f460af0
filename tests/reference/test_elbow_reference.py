"""The reference elbow against what must hold whatever the code: energy, statics, friction cones, a mode-free rival."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.reference.elbow_reference import DEG, LBF, ROWS, nominal, row, simulate_reference
from tests.reference.fixed_step import theta_with_fixed_step

pytestmark = pytest.mark.slow


def test_energy_is_kept_without_friction_damping_and_motor() -> None:
    """Forearm, drive, cable, pin and gravity exchange energy through impacts and a slack cable, and lose none."""
    p = nominal(
        coulomb_friction=0.0, viscous_friction=0.0, pin_damping=0.0, stall_torque=0.0, gravity_moment=1.324, step=0.002
    )
    run = simulate_reference(p, 1.0, np.linspace(0.0, 1.0, 301), rtol=1e-12, atol=1e-14)
    s = run.signals
    stretch = s["harness_force"] / p["cable_stiffness"]
    wall = s["pin_torque"] / p["pin_stiffness"]
    energy = (
        0.5 * p["forearm_inertia"] * s["theta_dot"] ** 2
        + 0.5 * p["drive_inertia"] * s["drive_speed"] ** 2
        + 0.5 * p["cable_stiffness"] * stretch**2
        + 0.5 * p["pin_stiffness"] * wall**2
        - p["gravity_moment"] * np.cos(s["theta"])
    )
    assert sum(label.startswith("pin") for _, label in run.events) > 10
    assert np.ptp(s["theta"]) > 1.0 * DEG
    np.testing.assert_allclose(energy, energy[0], rtol=0.0, atol=1e-12)


def test_without_a_step_nothing_moves() -> None:
    """At the band centre the drive's friction holds the cable's pull."""
    run = simulate_reference(nominal(step=0.0), 0.2)
    assert run.events == []
    # The bound is the integrator's absolute tolerance of 1e-12, which it may use up at several steps.
    np.testing.assert_allclose(run.signals["theta"], 0.0, atol=1e-11)
    np.testing.assert_allclose(run.signals["sensor_force"], 2.5 * LBF, rtol=1e-9)


def test_drive_slips_at_once_where_its_friction_cannot_hold_the_pull() -> None:
    """R F = 0.211 N·m exceeds a friction of 0.1 N·m: the drive is pulled along, flexing."""
    run = simulate_reference(nominal(step=0.0, coulomb_friction=0.1), 0.005)
    assert run.signals["drive_speed"][-1] > 0.0


@pytest.mark.parametrize("number", [2, 6, 8])
def test_settled_rows_rest_in_static_equilibrium(number: int) -> None:
    """Rows that must settle do, and the pin then carries the cable's pull and the weight."""
    p = row(number)
    run = simulate_reference(p, 2.5, rtol=1e-8, atol=1e-10)
    assert run.verdict == ROWS[number]["must"] == "settle"
    end = {name: values[-1] for name, values in run.signals.items()}
    weight = p["gravity_moment"] * math.sin(end["theta"])
    assert end["pin_torque"] + p["pulley_radius"] * end["harness_force"] == pytest.approx(weight, abs=1e-4)
    assert end["drive_speed"] == 0.0
    assert abs(end["motor_torque"] - end["pin_torque"]) <= p["coulomb_friction"]


def test_original_elbow_oscillates() -> None:
    """Row 1 repeats itself, and its period does not depend on the tolerance."""
    runs = [simulate_reference(row(1), 3.0, rtol=rtol, atol=rtol / 100.0) for rtol in (1e-7, 1e-9)]
    assert [r.verdict for r in runs] == ["oscillate", "oscillate"]
    assert runs[0].period == pytest.approx(runs[1].period, rel=1e-8)


def test_pulley_stays_within_its_friction() -> None:
    """|F_h - F_f| never exceeds the static share, and is the kinetic share while the pulley slides."""
    p = row(4)
    run = simulate_reference(p, 0.4, rtol=1e-9)
    harness, sensor = run.signals["harness_force"], run.signals["sensor_force"]
    share = (harness - sensor) / (harness + sensor)
    static = p["pulley_friction"] * math.sin(p["flexion_angle"] / 2.0)
    assert np.all(np.abs(share) <= static * (1.0 + 1e-9))
    kinetic = p["kinetic_ratio"] * static
    for sign in (1.0, -1.0):
        assert np.count_nonzero(np.abs(share - sign * kinetic) < 1e-12) > 10


@pytest.mark.parametrize("number", [1, 4])
def test_mode_logic_against_a_fixed_step_without_modes(number: int) -> None:
    """The fixed-step error is first order: it halves with the step, towards the event-exact run."""
    times = np.arange(31) / 100.0
    exact = simulate_reference(row(number), 0.3, times).signals["theta"]
    errors = [
        np.abs(theta_with_fixed_step(row(number), dt, 0.3, round(0.01 / dt)) - exact).max() for dt in (1e-5, 5e-6)
    ]
    assert errors[1] < 3e-5
    assert errors[1] == pytest.approx(errors[0] / 2.0, rel=0.2)


@pytest.mark.parametrize("second", [(0.0405, -0.012), (0.0655, 0.004), (0.0655, 0.012), (0.0655, -0.004)])
def test_second_step_against_a_fixed_step_without_modes(second: tuple[float, float]) -> None:
    """While the cable sticks on the pulley, and while it slides: against the step, far against it, and with it."""
    times = np.arange(31) / 200.0
    exact = simulate_reference(row(4), 0.15, times, second=second).signals["theta"]
    errors = [
        np.abs(theta_with_fixed_step(row(4), dt, 0.15, round(0.005 / dt), second) - exact).max() for dt in (1e-5, 5e-6)
    ]
    assert errors[1] < 3e-5
    assert errors[1] == pytest.approx(errors[0] / 2.0, rel=0.2)


def test_integrators_agree() -> None:
    """Another family of methods gives the same motion through the same events."""
    a = simulate_reference(row(1), 0.3, rtol=1e-10)
    b = simulate_reference(row(1), 0.3, rtol=1e-9, atol=1e-11, method="RK45")
    assert [label for _, label in a.events] == [label for _, label in b.events]
    np.testing.assert_allclose(a.signals["theta"], b.signals["theta"], atol=1e-7)
