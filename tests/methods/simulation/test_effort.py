"""What a search may compute: allotments within each other, and searches that end where theirs is done."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

import eppanalysis as epp
from eppanalysis.methods.orbits.exact import steady_hybrid
from eppanalysis.methods.search import find as cycles
from eppanalysis.methods.simulation.effort import Spent, allotted, left, spend
from eppanalysis.methods.simulation.simulate import run_hybrid
from eppanalysis.results import Status


def test_work_counts_in_all_allotments_around_and_ends_the_one_that_is_done() -> None:
    assert left() == float("inf")
    spend(1e30)  # nothing has been allotted
    with allotted(100.0) as outer:
        with pytest.raises(Spent), allotted(30.0) as inner:
            spend(20.0)
            assert (inner.used, left()) == (20.0, 10.0)
            spend(20.0)
        assert (inner.left, outer.used, outer.left, left()) == (0.0, 40.0, 60.0, 60.0)
        # An inner allotment has no more than the outer one has left.
        with pytest.raises(Spent), allotted(1e6):
            assert left() == 60.0
            with allotted(1e6):
                spend(15.0)
            assert left() == 45.0
            spend(45.0)
        with pytest.raises(Spent):
            spend(1.0)
        assert outer.used == 100.0
    assert left() == float("inf")


def test_a_run_ends_where_its_search_may_compute_no_more() -> None:
    hybrid = steady_hybrid(epp.LureSystem.from_tf(([1.0], [1.0, 3.0, 2.0, 0.0]), epp.Relay(), x0=[1.0, 0.0, 0.0]))
    long = 1e5
    whole = run_hybrid(hybrid, 10.0, np.zeros(0), 0.1, 10**9, 10)
    with allotted(5e3) as work:
        inside = run_hybrid(hybrid, 10.0, np.zeros(0), 0.1, 10**9, 10)
        assert np.array_equal(inside.x_end, whole.x_end) and 0.0 < work.used < 5e3
        with pytest.raises(Spent):
            run_hybrid(hybrid, long, np.linspace(0.0, long, 3_000_000), long / 3_000_000, 10**9, 10)
    assert work.used < 1e4


#: Loops that kept a search busy without end: switches that pile up, many levels, a smooth element, dead time.
HARD: dict[str, Callable[[], epp.LureSystem]] = {
    "sliding": lambda: epp.LureSystem.from_tf(([1.0], [1.0, 1.0, 0.0]), epp.Relay(-0.9, 0.4), x0=[1.0, 2.0]),
    "quantiser": lambda: epp.LureSystem.from_tf(
        ([4.0], [1.0, 2.0, 2.0, 0.0]), epp.Quantiser(0.2, 9), x0=[0.1, 0.2, 0.3]
    ),
    "pendulum": lambda: epp.LureSystem.from_tf(([1.0], [1.0, 0.0, 0.0]), epp.Sine(1.0), x0=[0.3, 1.0]),
    "dead time": lambda: epp.LureSystem.from_tf(([3.0], [1.0, 1.0, 0.0]), epp.Saturation(), delay=1.0),
}


@pytest.mark.parametrize("name", HARD)
def test_a_search_ends_where_its_work_is_done_and_says_so(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    most = 5e4
    loop = HARD[name]()
    predicted = epp.predict_limit_cycles(loop).cycles
    monkeypatch.setattr(cycles, "_MOST_WORK", most)
    found = epp.find_limit_cycles(loop, predicted=predicted)
    # What is counted in one go (a run's set-up, a comparison of all its events) may come on top.
    assert most <= found.provenance.statistics["work"] < 2.0 * most
    assert found.status is Status.UNDECIDED
    assert "starts left when" in found.message and "The search ended after" in found.search


@pytest.mark.slow
@pytest.mark.parametrize("stribeck", [1e3, 1e6, 1e18])
def test_all_methods_side_by_side_end_however_stiff_friction_falls(stribeck: float) -> None:
    """Series of smooth motion are the shorter the stiffer it is: those of runs and of orbits count, as far as any."""
    case = epp.case("belt_leine")
    stiff = replace(case.to_system(), elements=(epp.Friction(1.0, 1.0, stribeck),))
    begin = time.process_time()
    found = epp.ladder(stiff).search
    # A few seconds each; without a bound hours, by as many series as there are time constants in a period.
    assert time.process_time() - begin < 60.0
    assert found.status is not Status.CONVERGED and "starts left when" in found.message


def test_clocks_of_an_orbit_with_dead_time_cost_no_more_than_clocks() -> None:
    """A hundred switches on their way: their clocks move evenly, and are left out of the matrix exponentials."""
    loop = epp.LureSystem.from_tf(([2.0], [1.0, 0.5, -0.5]), epp.HysteresisRelay(-0.05, 0.05), delay=0.2)
    begin = time.process_time()
    found = epp.find_limit_cycles(loop)
    assert time.process_time() - begin < 60.0
    assert [round(c.period, 9) for c in found] == [5.523452919]


def test_predictions_leave_work_for_the_runs(monkeypatch: pytest.MonkeyPatch) -> None:
    """However many predictions there are to close, the stable cycle that runs end on is found."""
    loop = epp.LureSystem.from_tf(([5.0], [1.0, 2.0, 1.0, 0.0]), epp.RelayDeadZone(1.0))
    predicted = epp.predict_limit_cycles(loop).cycles
    monkeypatch.setattr(cycles, "_MOST_WORK", 1e5)
    found = epp.find_limit_cycles(loop, predicted=predicted * 200)
    assert [c.stable for c in found][-1]
    assert "predictions not followed to the end" in found.message
