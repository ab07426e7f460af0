"""Bounds on other pairs of parameters than gain and backlash, in a loop of its own that is small enough for it."""

from __future__ import annotations

import pytest

import eppanalysis as epp
from tests import made_bounds


@pytest.mark.slow
def test_gain_of_a_generic_loop_over_its_free_play() -> None:
    """The bound parts runs from the case's own start; first order is on its unsafe side."""
    case = made_bounds.wheelchair()
    (cell,) = epp.design_bounds(case, "play.gap", "loop.gain", at=[0.012], starts=100)
    assert cell.verified and cell.sign == 1.0, cell.message
    assert cell.exact == pytest.approx(made_bounds.GAIN, rel=1e-6)
    assert cell.first_order_unsafe
    # Its fold from the other side: the branch over the gap at that gain turns back at the gap.
    here = case.with_values({"loop.gain": cell.exact})
    branch = epp.continue_branch(here, "play.gap", start=0.014, stop=0.010, n_others=0)
    assert min(f.value for f in branch.folds) == pytest.approx(0.012, rel=1e-4)


@pytest.mark.slow
def test_dead_time_of_a_generic_loop_over_its_gain() -> None:
    """A true dead time as the limit: in the orbits and in the runs; first order is unsafe."""
    case = epp.case("relay_deadzone").with_values({"loop.gain": 1.0})
    (cell,) = epp.design_bounds(case, "loop.gain", "loop.delay", at=[0.5], within=(0.01, 1.0), starts=50)
    assert cell.verified and cell.sign == 1.0, cell.message
    assert cell.exact == pytest.approx(0.0994420, rel=1e-5)
    assert cell.first_order_unsafe
    # Its fold from the other side: the branch over the gain at that dead time turns back at the gain.
    here = case.with_values({"loop.delay": cell.exact})
    branch = epp.continue_branch(here, "loop.gain", start=0.6, stop=0.4, n_others=0)
    assert min(f.value for f in branch.folds) == pytest.approx(0.5, rel=1e-4)


@pytest.mark.slow
def test_two_processes_give_the_same_numbers() -> None:
    case = made_bounds.wheelchair()
    one, two = (
        epp.design_bounds(case, "play.gap", "loop.gain", at=[0.012, 0.013], starts=20, workers=n) for n in (1, 2)
    )
    # As text: a value that is none is no longer the same object behind another process, and not equal to itself.
    assert repr([c.to_dict() for c in two]) == repr([c.to_dict() for c in one])
    assert one[1].exact < one[0].exact  # more play allows less gain
