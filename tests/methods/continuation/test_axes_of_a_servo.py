"""Every parameter of a sampled servo as an axis of sweeps, branches and bounds: each answers, or says why not."""

from __future__ import annotations

import numpy as np
import pytest

import eppanalysis as epp
from eppanalysis.methods.bounds.result import Finding

#: The cycle of 28 s is that of the servo at 1 kHz, whose samples take seven times as long.
SERVO = epp.case("azimuth_servo").with_values(
    {"Kp": "50 V/rad", "run.t_end": "100 s", "controller.sample_time": "4 ms"}
)
NAMES = [name for name in SERVO.parameters if name != "encoder.levels"]
#: One of each kind: a gain, a gap, a time of samples, a friction, and what the linear part is made of.
SOME = ["Kp", "gap", "controller.sample_time", "load_friction.coulomb", "motor.torque_constant", "J_load"]
#: Over this parameter a branch is asked for more than there is of it; where it ends takes four times as long.
TO_THE_END = "load_friction.coulomb"
#: Over this parameter a branch seeks its first cycle itself, at the far end; over the others it is given the servo's.
OWN_SEARCH = "motor.torque_constant"

pytestmark = pytest.mark.slow


def test_all_that_has_a_value_is_a_parameter() -> None:
    assert len(SERVO.parameters) == 16 and {"Kp", "gap", "controller.sample_time", "motor.ratio"} <= {*NAMES}


@pytest.mark.parametrize("name", NAMES)
def test_a_sweep_has_the_runs_of_the_case(name: str) -> None:
    value = SERVO.parameters[name].value
    table = epp.sweep(SERVO, {name: [0.9 * value, value]}, progress=False, workers=1)
    for k, factor in enumerate((0.9, 1.0)):
        run = epp.simulate(SERVO.with_values({name: factor * value}))
        expected = np.nan if run.limit_cycle is None else run.limit_cycle.frequency
        np.testing.assert_allclose(table["frequency"].values[k], expected, rtol=1e-12)


@pytest.fixture(scope="module")
def cycle() -> epp.LimitCycle:
    """The servo's cycle, by the search with which each branch would begin."""
    return next(iter(epp.find_limit_cycles(SERVO)))


@pytest.mark.parametrize("name", [TO_THE_END, OWN_SEARCH])
def test_a_branch_has_the_cycle_that_a_run_from_it_keeps(name: str, cycle: epp.LimitCycle) -> None:
    value, said, on = SERVO.parameters[name].value, [], 1.02 if name == TO_THE_END else 1.005
    branch = epp.continue_branch(
        SERVO, name, value, on * value, n_points=2, max_step=0.5, n_others=0,
        cycle=None if name == OWN_SEARCH else cycle, progress=lambda *told: said.append(told),
    )  # fmt: skip
    assert said and len(branch) >= 2 and "The loop is sampled" in str(branch)
    last = branch.points["value"][-1]
    # Where a branch ends runs take long to come to a cycle.
    # Of a motion that is not locked to the samples, a run of one length may be decided and a longer one not.
    runs = (epp.simulate(SERVO.with_values({name: last}), t_end=t) for t in (200.0, 400.0, 800.0))
    again = next(run for run in runs if run.limit_cycle is not None)
    # One of the cycles side by side: of one, two or three turns.
    ratio = again.limit_cycle.period / branch.points["period"][-1]
    assert min(abs(ratio / r - 1.0) for r in (1 / 3, 1 / 2, 1.0, 2.0, 3.0)) < 0.15


@pytest.mark.parametrize("name", SOME)
def test_a_bound_by_the_own_run_parts_rest_from_cycles(name: str) -> None:
    over = "Ti" if name != "Ti" else "Kp"
    value, at = SERVO.parameters[name].value, SERVO.parameters[over].value
    (cell,) = epp.design_bounds(SERVO, over, name, at=[at], within=(0.8 * value, 1.3 * value), own_run=True)
    assert cell.finding is not Finding.FAILED and (cell.finding is Finding.BOUND or cell.message)
    if cell.finding is Finding.BOUND:
        assert epp.simulate(SERVO.with_values({name: cell.searched})).status is epp.Status.SETTLED


def test_levels_of_an_encoder_are_whole_numbers() -> None:
    with pytest.raises(epp.EppError, match="expected a whole number"):
        epp.continue_branch(SERVO, "encoder.levels", 2048, 2050, n_points=3, max_step=0.3)


def test_a_bound_by_search_ends_at_the_first_cycle_of_each_value() -> None:
    (cell,) = epp.design_bounds(SERVO, "Ti", "Kp", at=["0.4 s"], within=("10 V/rad", "40 V/rad"))
    assert cell.finding is Finding.ALWAYS and cell.n_searched == 5
