"""Border collisions of branches, where a visit to a mode ends after no time: from both sides, and by another
integrator.
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
import scipy.linalg
import scipy.optimize

import eppanalysis as epp
from eppanalysis.methods.bounds.balanced import BoundProblem
from eppanalysis.methods.bounds.elasticity import exact_elasticities
from eppanalysis.methods.continuation.result import SpecialPoint
from tests.noise import noise
from tests.reference.elbow_reference import DEG, nominal, simulate_reference
from tests.shared import conveyor

LIMIT, FRICTION = "lock_pin.backlash", 0.0526
#: Where the elbow with its original pulley ceases to oscillate, at a profile range of 2.5 lbf [rad].
COLLISION = 0.8234704211 * DEG


@pytest.fixture(scope="module")
def case() -> epp.Case:
    return epp.case("fig8a_original").with_values({"pulley.friction": FRICTION})


@pytest.fixture(scope="module")
def branch(case: epp.Case) -> epp.Branch:
    """From the stable cycle at 0.9 degrees down to the border collision, and up again on the unstable one."""
    return epp.continue_branch(case, LIMIT, "0.9 deg", "0.7 deg", max_step=0.05, n_others=0)


def collision_of(branch: epp.Branch) -> SpecialPoint:
    [collision] = [s for s in branch.special if s.kind == "turning change of sequence"]
    return collision


def test_a_stable_and_an_unstable_cycle_meet_in_a_collision(branch: epp.Branch) -> None:
    collision = collision_of(branch)
    value, stable = branch.points["value"], branch.points["stable"]
    assert collision.value == pytest.approx(COLLISION, rel=1e-9)
    assert np.all(value > collision.value * (1.0 - 1e-12)) and not branch.folds
    assert np.all(stable[: collision.index]) and not np.any(stable[collision.index :])
    # It is no smooth fold: the multiplier jumps over 1.
    below, above = branch.points["multiplier"][[collision.index - 1, collision.index]]
    assert below < 0.96 and above > 1.1
    assert value[-1] == pytest.approx(0.9 * DEG)


@pytest.mark.slow
def test_the_collision_is_the_same_from_the_unstable_side(case: epp.Case, branch: epp.Branch) -> None:
    """There the drive does not stop yet; where it begins to, the longer sequence of events says where it is."""
    changed = case.with_values({LIMIT: "0.86 deg"})
    [unstable] = epp.find_limit_cycles(changed).unstable
    back = epp.continue_branch(case, LIMIT, "0.86 deg", "0.7 deg", cycle=unstable, n_others=0)
    assert not back.points["stable"][0] and back.points["stable"][-1]
    assert collision_of(back).value == pytest.approx(collision_of(branch).value, rel=1e-10)


@pytest.mark.slow
@pytest.mark.parametrize(("share", "verdict"), [(-0.005, "settle"), (0.005, "oscillate")])
def test_an_independent_integrator_agrees_on_both_sides(case: epp.Case, share: float, verdict: str) -> None:
    backlash = COLLISION * (1.0 + share)
    run = simulate_reference(nominal(backlash=backlash, pulley_friction=FRICTION), 8.0, rtol=1e-8, atol=1e-10)
    assert run.verdict == verdict
    if verdict == "oscillate":
        exact = epp.continue_branch(case, LIMIT, "0.9 deg", backlash, n_others=0)
        assert exact.points["value"][-1] == pytest.approx(backlash)
        # The period is the mean over a second at the end, where what is left of the start has died away (0.8 a turn).
        assert run.period == pytest.approx(exact.points["period"][-1], rel=1e-5)


@pytest.mark.slow
def test_elasticities_of_a_border_collision_against_moved_ones(case: epp.Case, branch: epp.Branch) -> None:
    h, point = 1e-3, collision_of(branch).point
    known = exact_elasticities(BoundProblem(case, LIMIT, 0.01, 0.02), point)
    for name in ("bands.range", "pulley.friction"):
        moved = []
        for share in (-h, h):
            changed = case.with_values({name: case.value(name) * (1.0 + share)})
            moved.append(collision_of(epp.continue_branch(changed, LIMIT, "0.85 deg", "0.8 deg", n_others=0)).value)
        slope = (math.log(moved[1]) - math.log(moved[0])) / (2.0 * h)
        assert known[name] == pytest.approx(slope, rel=1e-4)


def test_a_branch_goes_on_where_its_old_sequence_turns_back() -> None:
    """A band is visited for ever shorter times before the drive stops; without the visit the cycle goes on."""
    name, friction = "fig6a_original_pulley", "pulley.friction"
    case = epp.case(name)
    branch = epp.continue_branch(case.with_values({friction: 0.0255}), friction, start=0.0255, stop=0.0245, n_others=0)
    assert branch.message.endswith("The branch begins at the end of the range and leaves the range.")
    assert branch.points["stable"].all()
    (change,) = [s for s in branch.special if "disappears: bands falls through breakpoint 4" in s.note]
    assert change.value == pytest.approx(0.0252124506, rel=1e-7)
    run = epp.simulate(case.with_values({friction: 0.0245}).to_system(), case.input, t_end=12.0)
    assert run.limit_cycle is not None
    assert branch.points["period"][-1] == pytest.approx(run.limit_cycle.period, rel=1e-9)


def test_a_branch_does_not_go_on_with_another_cycle_where_its_own_ends() -> None:
    """Where the level only just reaches a step of the gauge, the jump of the command moves the linkage, all at once.

    The cycle found beyond is 1.6 % shorter: the branch went on with it as if it were its own.
    """
    branch = epp.continue_branch(epp.case("level_valve"), "linkage.gap", "4 mm", "2 mm", n_others=0)
    value, period = np.log(branch.points["value"]), np.log(branch.points["period"])
    assert np.all(np.abs(np.diff(period)) < 2.0 * np.abs(np.diff(value)) + 1e-6)
    end = branch.special[-1]
    assert end.kind == "end" and end.value == pytest.approx(3.3638627e-3, rel=1e-6)
    assert "gauge falls through breakpoint 34" in branch.ends[1] and branch.points["multiplier"][-1] > 100.0
    (gap,) = branch.missing
    assert gap.low == 2e-3 and gap.high == end.value and branch.ends[1] in gap.why


def test_a_limit_that_is_just_touched_at_a_reversal_is_passed_from_both_sides() -> None:
    """The drive's voltage is largest where the load turns back, within the friction's own events.

    A branch to greater gains and two to smaller ones, of steps of their own: all pass the same place.
    """
    servo = epp.Diagram(
        parts={
            "controller": epp.blocks.Gain(gain=600.0),
            "motor": epp.blocks.Motor(resistance=1.5, torque_constant=0.06, inertia=3e-5, ratio=40.0),
            "load": epp.blocks.Inertia(inertia=0.08, damping=0.15),
            "amplifier": epp.Saturation(-24.0, 24.0),
            "gear": epp.LockPin(gap=math.radians(0.4), stiffness=1000.0, damping=2.0),
            "bearing": epp.Friction(coulomb=0.15),
        },
        connect=[
            "setpoint - load.angle -> controller",
            "controller -> amplifier",
            "amplifier -> motor.voltage",
            "motor.angle - load.angle -> gear.twist",
            "motor.speed - load.speed -> gear.rate",
            "-gear -> motor.torque",
            "gear - bearing -> load",
            "load.speed -> bearing",
        ],
        inputs=["setpoint"],
        signals={"load": "load.angle", "voltage": "controller"},
    )
    case = epp.Case.from_system(servo, name="servo", input=epp.inputs.Step(0.05))
    options = {"n_points": 240, "max_step": 0.1, "n_others": 0}
    touched = []
    for start, stop in ((540.0, 900.0), (600.0, 540.0), (900.0, 540.0)):
        branch = epp.continue_branch(case, "controller.gain", start, stop, **options)
        assert sorted(branch.points["value"][[0, -1]]) == pytest.approx(sorted((start, stop)))
        touched += [s.value for s in branch.special if "amplifier" in s.note]
    assert touched == pytest.approx([touched[0]] * 3, rel=1e-6)
    loop = epp.continue_branch(case, "controller.gain", 900.0, touched[0] * 1.0001, **options)
    assert loop.points["voltage"][-1] == pytest.approx(48.0, rel=1e-3)


def growth_without_limits(gain: float) -> float:
    """Logarithm of the growth of Clegg's loop without the actuator's limits from one reset to the next, after many."""
    # Integrator, lag, plant and its speed; the plant's gain at the integrator.
    A = np.array([[0.0, 0.0, -gain, 0.0], [1.0, -1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0], [0.0, 1.0, -1.0, -2.0]])
    step, dt, x = scipy.linalg.expm(1e-2 * A), 1e-2, np.array([0.0, 0.3, 0.0, 0.5])
    for _ in range(60):
        y = step @ x
        while y[2] * x[3] > 0.0:
            before, y = y, step @ y
        passes = scipy.optimize.brentq(lambda s, v: (scipy.linalg.expm(A * s) @ v)[2], 0.0, dt, before, xtol=1e-15)
        end = scipy.linalg.expm(A * passes) @ before
        growth, x = np.log(abs(end[3] / x[3])), np.array([0.0, end[1], 0.0, end[3]]) / abs(end[3])
    return float(growth)


@pytest.mark.slow
def test_a_branch_ends_where_a_loop_without_its_limit_has_cycles_of_all_sizes() -> None:
    branch = epp.continue_branch(epp.case("clegg_loop"), "gain", 3.0, 2.0)
    (end,) = branch.special
    assert end.kind == "continuum" and "continuum" in branch.ends[1]
    assert end.value == pytest.approx(scipy.optimize.brentq(growth_without_limits, 1.8, 2.4, xtol=1e-12), rel=1e-8)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(5))
def test_beyond_a_visit_that_vanishes_the_branch_goes_to_where_the_new_sequence_is_true(
    tmp_path: Path, seed: int
) -> None:
    """On some processors it went back on itself: the side on which it went on was the sign of a rounding error."""
    with noise(seed):
        branch = epp.continue_branch(conveyor(tmp_path), "pid.kp", 3.0, 0.75)
    assert branch.ends == ("begins at the end of the range", "leaves the range")
    assert branch.points["value"].max() == pytest.approx(3.0) and not branch.missing
