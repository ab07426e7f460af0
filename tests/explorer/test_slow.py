"""What the explorer's page finds in some seconds."""

import numpy as np
import pytest

pytest.importorskip("bokeh")

import eppanalysis as epp
from eppanalysis.explorer import slow


def test_a_branch_says_where_cycles_begin_without_a_fold():
    case = epp.case("backlash_servo_unseen")
    facts = slow.branch(slow.Given.of(case, "x"), "loop.gain", 0.8, 1.2)
    ((value, _),) = facts["begins"]
    assert value == pytest.approx(0.92267, rel=1e-4)  # there the period grows without bound


@pytest.mark.slow
def test_a_branch_that_is_lost_says_where_and_is_sought_from_the_case_too():
    case = epp.case("level_valve")
    (signal, *_), own = case.to_system().signals.names, case.value("linkage.gap")
    facts = slow.branch(slow.Given.of(case, signal), "linkage.gap", 2e-3, 4e-3)
    assert facts["doubts"].startswith("not followed beyond 3.364 mm")
    values = [value for piece in facts["pieces"] for value in piece["value"]]
    assert min(values) <= own < 3.3638e-3 < max(values)


def test_a_branch_in_discrete_time_is_drawn_as_any_other():
    case = epp.case("backlash_discrete_pi")
    facts = slow.branch(slow.Given.of(case, case.to_system().signals.names[0]), "play.gap", 0.5, 2.0)
    (piece,) = facts["pieces"]
    assert not facts["doubts"] and (min(piece["value"]), max(piece["value"])) == (0.5, 2.0)
    assert np.array(piece["size"]) == pytest.approx(1.66604459745 * np.array(piece["value"]))


def test_what_ends_an_oscillation_is_said_in_a_sentence():
    case = epp.case("pid_hunting")
    facts = slow.remedies(slow.Given.of(case, "x"))
    assert facts == {"sentence": str(epp.remedies(case))} and facts["sentence"].endswith("(tested).")


@pytest.mark.slow
def test_the_border_of_the_map_is_that_of_the_region_without_cycles():
    """The threshold at which a relay's cycles end is 1.6625701907 times the gain."""
    given = slow.Given.of(epp.case("relay_deadzone"), "x")
    facts = slow.border(given, "loop.gain", "relay_dead_zone.threshold", (1.05, 1.25), (1.5, 1.8))
    gain, threshold = (np.array(facts[name]) for name in ("x", "y"))
    on = np.isfinite(gain)
    assert on.sum() > 3 and threshold[on] / gain[on] == pytest.approx(1.6625701907, rel=1e-9)
