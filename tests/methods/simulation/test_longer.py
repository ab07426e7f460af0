"""What is said of a run that was too short: how long would do, and no more than it shows."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

import eppanalysis as epp


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
    assert run.status is epp.Status.UNDECIDED and run.note.endswith("it goes beyond all bounds without another switch.")


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
