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


def test_what_swings_less_and_less_is_not_said_to_come_to_rest():
    """A mass under PID hunts in static friction for ever, here from a swing far larger than that of its cycle."""
    loop = replace(epp.case("pid_hunting").to_system(), x0=np.array([10.0, 0.0, 0.0]))
    run = epp.simulate(loop, t_end=80.0)
    assert run.status is epp.Status.UNDECIDED and "swung less and less" in run.note
    assert epp.simulate(loop, t_end=3000.0).status is epp.Status.LIMIT_CYCLE
    assert run.note.endswith("to a smaller motion, or to rest.")


@pytest.mark.xfail(
    strict=True,
    reason='a run that is too short asks to "simulate for longer" without how long; budgets by the time constants of '
    "the modes that were met tell",
)
@pytest.mark.parametrize("rate", [0.01, 1.0])
def test_a_run_that_is_too_short_says_how_long_would_do(rate):
    loop = _settling(rate)
    run = epp.simulate(loop, t_end=2.0 / rate)
    assert run.status is epp.Status.UNDECIDED
    told = re.search(r"for (?:some |about )?([\d.e+]+) s", str(run).split("by the end", 1)[-1])
    assert told is not None
    assert epp.simulate(loop, t_end=1.1 * float(told[1])).status is epp.Status.SETTLED
