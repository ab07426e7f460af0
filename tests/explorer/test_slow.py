"""What the explorer's page finds in some seconds."""

import pytest

pytest.importorskip("bokeh")

import eppanalysis as epp
from eppanalysis.explorer import slow


def test_a_branch_says_where_cycles_begin_without_a_fold():
    case = epp.case("backlash_servo_unseen")
    facts = slow.branch(slow.Given.of(case, "x"), "loop.gain", 0.8, 1.2)
    ((value, _),) = facts["begins"]
    assert value == pytest.approx(0.92267, rel=1e-4)  # there the period grows without bound
