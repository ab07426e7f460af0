"""Where branches begin and which ranges they run over: given cycles, and values that a loop does not take."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import eppanalysis as epp
from tests.shared import mostly_slow

DEAD = "relay_dead_zone.threshold"


@pytest.fixture(scope="module")
def relay() -> epp.Case:
    return epp.case("relay_deadzone").with_values({DEAD: 1.0})


def test_a_branch_begins_on_the_orbit_of_the_cycle_given_and_on_no_neighbour(relay):
    """From the unstable cycle of a prediction a run ends on the stable one, whose branch was followed in its place."""
    predicted = epp.predict_limit_cycles(relay)
    assert sorted(bool(c.stable) for c in predicted) == [False, True]
    for cycle in predicted:
        exact = epp.exact_orbit(relay, cycle)
        branch = epp.continue_branch(relay, DEAD, 1.0, 1.1, cycle=cycle)
        assert branch.points["period"][0] == pytest.approx(exact.period, rel=1e-9)
        assert branch.points["stable"][0] == exact.stable == cycle.stable


def test_cycles_of_another_loop_are_refused(relay):
    cycle = epp.find_limit_cycles(relay).cycles[0]
    harmonics = {f"other_{name}": c for name, c in cycle.harmonics.items()}
    for foreign, what in (
        (replace(cycle, state=np.zeros(7)), "has 7 states at its start; expected 3"),
        (replace(cycle, harmonics=harmonics), "is of another loop"),
    ):
        for ask in (epp.exact_orbit, lambda case, c: epp.continue_branch(case, DEAD, 1.0, 1.1, cycle=c)):
            with pytest.raises(epp.EppError, match=what):
                ask(relay, foreign)


@pytest.mark.parametrize("stop", mostly_slow([0.0, -0.5], [0.0]))
def test_a_branch_up_to_values_that_the_loop_does_not_take_leaves_them_out(relay, stop):
    """A dead zone of zero is no dead zone: nothing near it "no longer continues", and nothing is sought beyond."""
    branch = epp.continue_branch(relay, DEAD, 1.0, stop)
    assert branch.status.ok and not branch.special and not branch.others
    assert 0.0 < branch.points["value"][-1] < 1e-6
    if stop < 0.0:
        assert "leaves the values that the loop takes" in branch.ends[1] and "expected a positive number" in str(branch)
        assert [(g.low, g.why) for g in branch.missing] == [(stop, f"the branch {branch.ends[1]}")]
    else:
        assert branch.ends[1] == "leaves the range" and not branch.missing


def test_a_branch_that_stops_at_the_number_of_points_does_not_find_itself_again():
    """Its own cycles, searched for farther on, were followed back along it as those of another branch."""
    branch = epp.continue_branch(epp.case("relay_biased_fopdt"), "hysteresis_relay.high", 1.3, 0.7, n_points=20)
    assert branch.ends[1] == "stops at the given number of points" and branch.others and not branch.missing
    assert "joins a branch that stops" in branch.others[-1].message
    values = [one.points["value"] for one in (branch, *branch.others)]
    assert sum(np.ptp(v) for v in values) == pytest.approx(0.6, rel=1e-9)
    assert str(branch).startswith("Limit cycles exist for hysteresis relay high from 0.7 to 1.3;")
