"""Designs of loops with samples, run once more by an iteration of their own, from many starts."""

from __future__ import annotations

import numpy as np
import pytest

import eppanalysis as epp
from tests.switched_samples import oscillates, switched


def least_dead_zone(kind: str, value: float) -> float:
    """The least dead zone with which no start oscillates, by halving."""
    low, high = 0.5, 8.0
    while high - low > 1e-3 * high:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if oscillates(kind, value, 1.0, middle) else (low, middle)
    return high


@pytest.mark.slow
def test_the_best_pole_of_a_difference_equation_is_that_of_all_poles_iterated() -> None:
    kind, poles = "discrete time", (0.45, 0.6)
    found = epp.design(switched(kind), {"dead": (0.9, 6.0), "pole": poles}, minimise="dead")
    best = found.optimum
    assert best.confirmed and best.kind.value == "search" and found.status is epp.Status.INCOMPLETE
    assert found.not_covered in str(found) and "found beyond (by the search)" in str(found)
    # It is free where it is to be built, and not a little inside.
    assert not oscillates(kind, found.values["pole"], 1.0, found.values["dead"])
    assert oscillates(kind, best.at["pole"], 1.0, 0.98 * best.at["dead"])
    of_all = [least_dead_zone(kind, pole) for pole in np.linspace(*poles, 7)]
    assert best.at["dead"] < 1.02 * min(of_all)
    assert best.prices["level"] == pytest.approx(1.0, abs=0.02)  # the loop has no other measure of size


@pytest.mark.slow
def test_the_least_dead_zone_of_a_sampled_loop_holds_in_all_machines_within_the_tolerances() -> None:
    kind = "sampled controller"
    found = epp.design(switched(kind), {"dead": (0.9, 6.0)}, minimise="dead", tolerances={"level": "5 %"}, starts=20)
    best = found.optimum
    assert best.confirmed and best.n_machines == 20, str(found)
    assert best.at["dead"] == pytest.approx(1.05 * least_dead_zone(kind, 1.0), rel=0.02)
    assert not any(oscillates(kind, 1.0, level, found.values["dead"]) for level in (0.95, 1.0, 1.05))
