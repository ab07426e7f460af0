"""The largest gain of a servo with lead and play: found also where the scan leaves a value undecided; and its tests."""

from __future__ import annotations

import pytest

import eppanalysis as epp
from tests.methods.design.test_design import SERVO


@pytest.fixture(scope="module")
def servo() -> epp.Case:
    return epp.case_from_text(SERVO)


@pytest.mark.slow
def test_a_bound_is_found_though_a_value_of_the_scan_is_undecided(servo):
    # At both ends of the range and at 4.472 no cycle is known, at 9.457 there is one: the fold lies between.
    found = epp.design_bounds(servo, "T", "k", at=[1.2], within=(1.0, 20.0), verify=False)
    branch = epp.continue_branch(servo.with_values({"T": 1.2}), "k", 9.0, 5.0)
    assert [found[0].exact] == [pytest.approx(fold.value, rel=1e-9) for fold in branch.folds]


@pytest.mark.slow
def test_a_bound_beside_which_motions_die_out_as_a_power_of_time_is_verified(servo):
    found = epp.design_bounds(servo, "T", "k", at=[0.5], within=(1.0, 20.0), starts=100)
    assert found[0].verified and found.status is epp.Status.CONVERGED
