"""Where the loop's rest lets a disturbance grow, any size starts a cycle, and no rounding is told as a threshold; a
drift that ends at a stop has one.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy import signal
from scipy.integrate import solve_ivp

import eppanalysis as epp

PLANT = ([9.0], [1.0, 3.0, 2.0, 0.0])
A, B, C, _ = signal.tf2ss(*PLANT)


def sampled(step: float) -> epp.LureSystem:
    """The same plant under a saturation that a hold stands before, from sample to sample."""
    Ad, Bd, *_ = signal.cont2discrete((A, B, C, np.zeros((1, 1))), step)
    return epp.LureSystem.build(Ad, -Bd, C, [epp.Saturation()], time_step=step)


@pytest.mark.parametrize(
    "loop",
    [epp.LureSystem.build(A, -B, C, [epp.Saturation()]), pytest.param(sampled(0.1), marks=pytest.mark.slow)],
    ids=["in time", "from sample to sample"],
)
def test_any_disturbance_of_an_unstable_rest_starts_a_cycle(loop: epp.LureSystem) -> None:
    """By Routh the loop is stable up to a gain of 6, and has 9."""
    hits = epp.trigger(loop)
    assert len(hits) == 2 * len(A)
    for hit in hits:
        assert (hit.size, hit.settles) == (0.0, 0.0) and 0.0 < abs(hit.starts) <= abs(hit.tried)
        assert str(hit).startswith(f"Any disturbance of {hit.name} starts a limit cycle: linearised at rest")


@pytest.mark.slow
def test_so_does_a_far_smaller_one_than_was_tried() -> None:
    """An integration of its own comes from 1e-8 to the cycle, which is a thousand million times as large."""

    def rate(_: float, x: np.ndarray) -> np.ndarray:
        return np.asarray(A @ x - B[:, 0] * np.clip(C[0] @ x, -1.0, 1.0))

    late = solve_ivp(rate, (0.0, 400.0), [1e-8, 0.0, 0.0], t_eval=np.linspace(390.0, 400.0, 500), rtol=1e-8, atol=1e-12)
    assert np.abs(C[0] @ late.y).max() == pytest.approx(1.83003927, rel=1e-3)


def test_a_drift_grows_too_and_what_has_a_threshold_keeps_it() -> None:
    """In a gap of +-0.01 nothing holds a load that is off its place, whose error is integrated; a motor alone is."""
    hits = {hit.name: hit for hit in epp.trigger(epp.case("two_mass_damped_shaft"), states=["motor", "load"])}
    assert hits["load"].size == 0.0
    assert abs(hits["motor"].size) == pytest.approx(0.01, rel=1e-6)


def test_a_drift_that_ends_at_a_stop_has_a_threshold() -> None:
    """A motor without friction drifts in its gap under any step, and holds its teeth against a load that sticks."""
    gear = {"kind": "lock_pin", "gap": "0.5 deg", "stiffness": "800 N*m/rad", "damping": "1.5 N*m*s/rad"}
    servo = epp.Case.from_tables(
        {
            "kind": "diagram",
            "title": "Servo",
            "connect": [
                "setpoint - load.angle -> controller",
                "controller -> motor.voltage",
                "motor.angle - load.angle -> gear.twist",
                "motor.speed - load.speed -> gear.rate",
                "-gear -> motor.torque",
                "gear - friction -> load",
                "load.speed -> friction",
            ],
            "inputs": {"setpoint": "0 deg"},
            "run": {"t_end": "60 s", "input": {"kind": "step", "size": "5 deg"}},
            "blocks": {
                "controller": {"kind": "gain", "gain": "250 V/rad"},
                "motor": {
                    "kind": "motor",
                    "resistance": "2 ohm",
                    "torque_constant": "0.05 N*m/A",
                    "inertia": "2e-5 kg*m^2",
                    "ratio": 50,
                },
                "load": {"kind": "inertia", "inertia": "0.05 kg*m^2", "damping": "0.1 N*m*s/rad"},
            },
            "elements": {"gear": gear, "friction": {"kind": "friction", "coulomb": "0.1 N*m"}},
        }
    )
    for hit in epp.trigger(servo, states=()):
        assert hit.starts / hit.settles == pytest.approx(1.0, rel=1e-6)
        for share, ends in ((0.99, "SETTLED"), (1.01, "LIMIT_CYCLE")):
            stepped = servo.with_values({"run.input.size": f"{share * hit.size!r} rad"})
            assert epp.simulate(stepped).status.name == ends
