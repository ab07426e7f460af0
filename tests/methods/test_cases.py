"""What the methods need of a case."""

from __future__ import annotations

import pytest

import eppanalysis as epp

BACKLASH, RANGE = "lock_pin.backlash", "bands.range"


def test_verbs_that_want_a_case_say_so() -> None:
    """A system in place of the case is the likely slip: a sentence, and no AttributeError."""
    system = epp.case("relay_deadzone").to_system()
    verbs = {
        "continue_branch": lambda: epp.continue_branch(system, BACKLASH, 1.0, 2.0),
        "continue_folds": lambda: epp.continue_folds(system, BACKLASH, RANGE, (1.0, 2.0), (1.0, 2.0)),
        "design_bounds": lambda: epp.design_bounds(system, RANGE, BACKLASH),
        "tolerance_bound": lambda: epp.tolerance_bound(system, BACKLASH, within=(0.1, 1.0)),
        "design_advice": lambda: epp.design_advice(system, ["2.5 lbf"]),
        "design_guide": lambda: epp.design_guide(system, ["2.5 lbf"]),
        "ladder": lambda: epp.ladder(system),
    }
    for verb, call in verbs.items():
        with pytest.raises(epp.EppError, match=f"^{verb}: the first argument is a LureSystem; expected a Case"):
            call()


def test_knock_wants_a_system() -> None:
    with pytest.raises(epp.EppError, match=r"^knock: the first argument is a Case; expected a LureSystem"):
        epp.knock(epp.case("relay_deadzone"))
