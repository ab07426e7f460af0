"""Bounds under tolerances that the search says, against an iteration of the loop at all corners, from many starts."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

import eppanalysis as epp
from tests.switched_samples import KINDS, oscillates, switched


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS[:1])  # a design of the other kind has its tolerances
def test_no_corner_oscillates_beyond_the_worst_case_and_one_does_just_inside(kind: str) -> None:
    case = switched(kind)
    other = "pole" if kind == "discrete time" else "rate"
    centre = case.value(other)
    found = epp.tolerance_bound(case, "dead", {other: "4 %", "level": "5 %"}, within=(0.9, 6.0), samples=8, seed=2)
    assert found.sign == -1.0 and found.n_corners == 3
    corners = list(itertools.product((0.96 * centre, 1.04 * centre), (0.95, 1.05)))
    assert not any(oscillates(kind, value, level, found.worst_case) for value, level in corners)
    worst = found.worst_values[other], found.worst_values["level"]
    assert worst in [pytest.approx(corner) for corner in corners]
    assert oscillates(kind, *worst, 0.98 * found.worst_case)
    assert not oscillates(kind, centre, 1.0, found.nominal) and oscillates(kind, centre, 1.0, 0.98 * found.nominal)
    # What runs say of draws lies between the corners, and as near to the nominal bound.
    assert np.all(found.draws < 1.01 * found.worst_case) and abs(found.engine_offset) < 0.01
    said = str(found)
    assert said.startswith("No limit cycle was found above a dead of ") and "at the corners of the tolerances" in said
    assert found.status is epp.Status.INCOMPLETE and found.not_covered in said
    assert found.to_dict()["not_covered"] == found.not_covered
