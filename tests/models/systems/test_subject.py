"""What the methods need of a case."""

from __future__ import annotations

from typing import Any

import pytest

import eppanalysis as epp
from eppanalysis.methods.comparison.ladder import ladder

BACKLASH, RANGE = "lock_pin.backlash", "bands.range"


def test_analyses_say_what_they_want() -> None:
    """What is neither a case nor a loop is refused in a sentence, and no AttributeError."""
    wrong: Any = epp.Saturation()
    cycle = epp.predict_limit_cycles(epp.case("relay_deadzone"))[-1]
    analyses = {
        "continue_branch": lambda: epp.continue_branch(wrong, BACKLASH, 1.0, 2.0),
        "continue_folds": lambda: epp.continue_folds(wrong, BACKLASH, RANGE, (1.0, 2.0), (1.0, 2.0)),
        "design_bounds": lambda: epp.design_bounds(wrong, RANGE, BACKLASH),
        "tolerance_bound": lambda: epp.tolerance_bound(wrong, BACKLASH, within=(0.1, 1.0)),
        "ladder": lambda: epp.ladder(wrong),
        "predict_limit_cycles": lambda: epp.predict_limit_cycles(wrong),
        "harmonic_balance": lambda: epp.harmonic_balance(wrong, cycle),
        "exact_orbit": lambda: epp.exact_orbit(wrong, cycle),
        "find_limit_cycles": lambda: epp.find_limit_cycles(wrong),
        "frozen_nyquist": lambda: epp.frozen_nyquist(wrong, cycle),
        "trigger": lambda: epp.trigger(wrong),
        "simulate": lambda: epp.simulate(wrong),
    }
    for analysis, call in analyses.items():
        with pytest.raises(epp.EppError, match=f"^{analysis}: the first argument is a Saturation; expected a Case"):
            call()


def test_analyses_of_continuous_time_say_so() -> None:
    loop = epp.LureSystem.build(
        [[0.5]], [[1.0]], [[-1.0]], [epp.Relay()], B_input=[[1.0]], input_names=["u"], time_step=0.1, name="digital"
    )
    analyses = {
        "frequency_response": lambda: epp.frequency_response(loop, amplitude=1.0, frequencies=(1.0, 2.0)),
        "olop": lambda: epp.olop(loop, 1.0),
        "free_region": lambda: epp.free_region(loop, {"loop.gain": [1.0, 2.0], "relay.high": [1.0, 2.0]}),
    }
    for analysis, call in analyses.items():
        with pytest.raises(epp.EppError, match=f"^{analysis} does not cover loops in discrete time: .+"):
            call()


def test_methods_over_parameters_say_how_a_loop_becomes_a_case() -> None:
    """Behind the public door, where a loop has not become a case."""
    loop = epp.case("relay_deadzone").to_system()
    with pytest.raises(
        epp.EppError, match=r"^ladder: the first argument is a LureSystem;.*Case\.from_system\(\) makes"
    ):
        ladder(loop)
