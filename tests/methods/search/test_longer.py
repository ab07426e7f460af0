"""A run that was too short: what its motion comes to beyond its end, and for how long to simulate."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

import eppanalysis as epp
from tests.coordinates import rotated


def _settling(rate: float) -> epp.LureSystem:
    """A lag of 1 / rate seconds behind a gap that its start is far beyond."""
    return epp.LureSystem.build([[0.0]], [[-rate]], [[1.0]], [epp.DeadZone(-0.1, 0.1)], x0=[1.0])


def test_a_run_that_is_too_short_says_what_it_comes_to():
    """A mass under PID hunts in static friction for ever, here from a swing far larger than that of its cycle."""
    loop = replace(epp.case("pid_hunting").to_system(), x0=np.array([10.0, 0.0, 0.0]))
    run = epp.simulate(loop, t_end=80.0)
    (cycle,) = epp.find_limit_cycles(loop)
    assert run.status is epp.Status.UNDECIDED
    assert f"it repeats itself every {cycle.period:.4g} s" in run.note


def test_a_ramp_that_no_element_ends_is_said_to_go_beyond_all_bounds():
    """An integrator that is pushed by one more than its limited drive can hold."""
    loop = epp.LureSystem.build([[0.0]], [[-1.0]], [[1.0]], [epp.Saturation()], constant_state=[1.5])
    run = epp.simulate(loop, t_end=20.0)
    assert run.status is epp.Status.UNDECIDED and run.note.endswith("carried on, it grows without bound.")
    assert epp.simulate(loop, t_end=20.0, decide=True).status is epp.Status.DIVERGED


def test_a_motion_that_never_repeats_itself_is_undecided_however_long_it_runs():
    """Two undamped oscillators of incommensurable frequencies behind a gap that they never come to."""
    A = np.zeros((4, 4))
    A[0, 1], A[1, 0], A[2, 3], A[3, 2] = 1.0, -1.0, 1.0, -2.0
    loop = epp.LureSystem.build(
        A, [[0.0], [1.0], [0.0], [1.0]], [[1.0, 0.0, 1.0, 0.0]], [epp.DeadZone(-1.0, 1.0)], x0=[0.45, 0.0, 0.45, 0.0]
    )
    run = epp.simulate(loop, t_end=20.0)
    assert run.status is epp.Status.UNDECIDED and re.search(r"by the end, nor by [\d.e+]+ s\.", run.note)


@pytest.mark.parametrize("rate", [0.01, 1.0])
def test_a_run_that_is_too_short_says_how_long_would_do(rate):
    loop = _settling(rate)
    run = epp.simulate(loop, t_end=2.0 / rate)
    assert run.status is epp.Status.UNDECIDED
    told = re.search(r"for (?:some |about )?([\d.e+]+) s", str(run).split("by the end", 1)[-1])
    assert told is not None
    assert epp.simulate(loop, t_end=1.1 * float(told[1])).status is epp.Status.SETTLED


@pytest.mark.parametrize(
    "name",
    [
        "relay_hyst_servo",
        "x15_flare",
        "light_forearm",  # rests
        "van_der_pol_mu1",  # curved
        "relay_fopdt_closed",  # a dead time
        "backlash_discrete_pi_kp05_ki01",
        "elbow",
    ],
)
def test_a_run_that_is_carried_on_ends_as_a_long_one(name):
    case = epp.case(name)
    short, long = epp.simulate(case, t_end=0.01 * case.t_end, decide=True), epp.simulate(case)
    assert short.end_time == pytest.approx(0.01 * case.t_end) and short.carried_to > short.end_time
    assert epp.simulate(case, t_end=0.01 * case.t_end).status is epp.Status.UNDECIDED
    assert short.status is long.status
    if long.limit_cycle is not None:
        assert short.limit_cycle.period == pytest.approx(long.limit_cycle.period, rel=1e-6)
        assert short.limit_cycle.peak_to_peak == pytest.approx(long.limit_cycle.peak_to_peak, rel=1e-6)
    assert short.settled_at == pytest.approx(long.settled_at, rel=1e-3, abs=1e-6)


@pytest.mark.parametrize("seed", [1, 2])
def test_turned_states_come_to_the_same(seed):
    loop = epp.case("relay_hyst_servo").to_system()
    one, other = (epp.simulate(each, t_end=1.0, decide=True) for each in (loop, rotated(loop, seed)))
    assert one.status is other.status is epp.Status.LIMIT_CYCLE
    assert other.limit_cycle.period == pytest.approx(one.limit_cycle.period, rel=1e-9)
    assert other.carried_to == pytest.approx(one.carried_to)
    # Turns are compared state by state: one more or less is alike to a thousandth.
    assert other.settled_since == pytest.approx(one.settled_since, abs=1.01 * one.limit_cycle.period)


def test_an_input_that_changes_late_counts_and_a_ramp_that_has_ended_is_no_ramp():
    """A lag that follows its input within a gap that it never reaches: no switch marks the end of the ramp."""
    loop = epp.LureSystem.build(
        [[-1.0]], [[1.0]], [[1.0]], [epp.DeadZone(-9.0, 9.0)], B_input=[[1.0]], input_names=["hand"]
    )
    run = epp.simulate(loop, epp.inputs.Ramp(1.0, start=2.0, stop=4.0), t_end=5.0, decide=True)
    assert run.status is epp.Status.SETTLED
    assert next(iter(run.settled_at.values())) == pytest.approx(2.0, rel=1e-6)


def test_what_stays_open_says_how_far_it_was_carried():
    A = np.zeros((4, 4))
    A[0, 1], A[1, 0], A[2, 3], A[3, 2] = 1.0, -1.0, 1.0, -2.0
    loop = epp.LureSystem.build(
        A, [[0.0], [1.0], [0.0], [1.0]], [[1.0, 0.0, 1.0, 0.0]], [epp.DeadZone(-1.0, 1.0)], x0=[0.45, 0.0, 0.45, 0.0]
    )
    run = epp.simulate(loop, t_end=20.0, decide=True)
    assert run.status is epp.Status.UNDECIDED and run.limit_cycle is None
    assert str(run) == f"Undecided after 20 s: {run.note}" and run.note.endswith(f"nor by {run.carried_to:.0f} s.")
