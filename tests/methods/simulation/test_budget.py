"""What a search may compute: it ends where that is done, whatever the loop."""

from __future__ import annotations

import time
from dataclasses import replace

import pytest

import eppanalysis as epp
from eppanalysis.results import Status


@pytest.mark.slow
@pytest.mark.parametrize("stribeck", [1e3, 1e18])
def test_all_methods_side_by_side_end_however_stiff_friction_falls(stribeck: float) -> None:
    """Series of smooth motion are the shorter the stiffer it is: those of runs and of orbits count, as far as any."""
    case = epp.case("belt_leine")
    stiff = replace(case.to_system(), elements=(epp.Friction(1.0, 1.0, stribeck),))
    begin = time.process_time()
    found = epp.ladder(stiff).search
    # A few seconds each; without a bound hours, by as many series as there are time constants in a period.
    assert time.process_time() - begin < 60.0
    assert found.status is not Status.CONVERGED and "starts left when" in found.message


@pytest.mark.slow
def test_clocks_of_an_orbit_with_dead_time_cost_no_more_than_clocks() -> None:
    """A hundred switches on their way: their clocks move evenly, and are left out of the matrix exponentials."""
    loop = epp.LureSystem.from_tf(([2.0], [1.0, 0.5, -0.5]), epp.HysteresisRelay(-0.05, 0.05), delay=0.2)
    begin = time.process_time()
    found = epp.find_limit_cycles(loop)
    assert time.process_time() - begin < 60.0
    assert [round(c.period, 9) for c in found] == [5.523452919]


@pytest.mark.slow
def test_predictions_leave_work_for_the_runs() -> None:
    """However many predictions there are to close, the stable cycle that runs end on is found."""
    loop = epp.LureSystem.from_tf(([5.0], [1.0, 2.0, 1.0, 0.0]), epp.RelayDeadZone(1.0))
    predicted = epp.predict_limit_cycles(loop).cycles
    found = epp.find_limit_cycles(loop, predicted=predicted * 200)
    assert [c.stable for c in found][-1]
