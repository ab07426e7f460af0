"""Boundaries: against loops whose boundary is known in closed form, and against the branch's own fold."""

from __future__ import annotations

import numpy as np
import pytest

import eppanalysis as epp
from eppanalysis.errors import EppError
from eppanalysis.results import Status
from eppanalysis.sweep.boundary import Boundary, edges_of, fold_boundary, outcome_boundary, pieces_of
from tests.shared import mostly_slow

RELAY = epp.case("relay_deadzone")
AXES = {"relay_dead_zone.threshold": "0.3:2.1:3", "loop.gain": "0.2:1.4:3"}


def test_the_prediction_of_a_relay_with_dead_zone_ends_on_a_straight_line() -> None:
    """Its describing function is at most 2 / (pi threshold), and the loop gain 5 / (s (s + 1)^2) needs 2 / (5 gain)."""
    found = outcome_boundary(RELAY, AXES, halvings=4, progress=False)
    threshold, gain = found.over("relay_dead_zone.threshold", "loop.gain")
    assert found.status is Status.CONVERGED
    assert found.provenance.settings["run"] and found.provenance.case["sha256"]
    assert threshold.size > 3
    assert np.all(np.isfinite(threshold))  # one piece
    # An edge of the coarse grid, halved four times.
    reach = 0.2 * np.pi * 0.9 / 2**5, 0.6 / 2**5
    assert np.abs(gain - 0.2 * np.pi * threshold).max() < 1.01 * max(reach)


@pytest.mark.slow
def test_processes_are_started_once_for_all_its_sweeps() -> None:
    axes = {"relay_dead_zone.threshold": "1:4:2", "loop.gain": "0.5:1:2"}
    here = outcome_boundary(RELAY, axes, "simulate", halvings=1, progress=False)
    there = outcome_boundary(RELAY, axes, "simulate", halvings=1, scheduler="processes", workers=1, progress=False)
    assert here.points.size
    assert np.array_equal(here.points, there.points, equal_nan=True)


def test_pieces_are_closed_or_open_curves_of_neighbouring_crossings() -> None:
    x, y = np.meshgrid(np.arange(9.0), np.arange(9.0), indexing="ij")
    for inside, pieces in (
        (np.hypot(x - 4, y - 4) < 2.5, 1),
        ((np.hypot(x - 2, y - 2) < 1.5) | (np.hypot(x - 6, y - 6) < 1.5), 2),
        (x + y < 7, 1),
        (x < 0, 0),
    ):
        edges = edges_of(inside)
        points = pieces_of(inside.shape, {e: np.mean(np.array(e, float), axis=0) for e in edges})
        gaps = np.isnan(points[:, 0])
        assert (gaps.sum() + 1 if points.size else 0) == pieces
        steps = np.hypot(*np.diff(points, axis=0).T)
        assert np.nanmax(steps, initial=0.0) <= np.sqrt(2)
        assert {tuple(p) for p in points[~gaps]} == {tuple(np.mean(np.array(e, float), axis=0)) for e in edges}


@pytest.mark.slow
def test_the_fold_curve_goes_through_the_folds_of_branches() -> None:
    case = epp.case("fig8a_original")
    found = fold_boundary(case, {"bands.range": "2.4:2.6:3:lbf", "lock_pin.backlash": "0.6:2.5:2:deg"})
    assert found.label == "exact fold"
    ranges, backlash = found.over("bands.range", "lock_pin.backlash")
    assert np.all(np.diff(backlash) > 0)
    middle = case.with_values({"bands.range": float(ranges[1])})
    single = epp.continue_branch(middle, "lock_pin.backlash", "2.5 deg", "0.6 deg", n_others=0)
    assert backlash[1] == pytest.approx(single.folds[0].value, rel=1e-9)


@pytest.mark.parametrize(
    ("gains", "reach"),
    mostly_slow([("1:1.2:2", "1.2:2.5:2"), ("1:1.2:3", "1:2:2"), ("0.8:1.2:2", "1:2:2")], [("0.8:1.2:2", "1:2:2")]),
)
def test_rows_far_apart_have_folds_that_lie_far_apart(gains: str, reach: str) -> None:
    """The loop is homogeneous: its thresholds at the folds are in proportion to its gain, 1.66257 at a gain of 1."""
    found = fold_boundary(RELAY, {"loop.gain": gains, "relay_dead_zone.threshold": reach})
    assert found.status is Status.CONVERGED
    gain, threshold = found.over("loop.gain", "relay_dead_zone.threshold")
    np.testing.assert_allclose(threshold / gain, 1.6625701907, rtol=1e-9)


def test_a_boundary_knows_its_axes() -> None:
    found = Boundary(("a", "b"), np.array([[1.0, 2.0], [3.0, 4.0]]), "edge", Status.CONVERGED, "by hand")
    assert [v.tolist() for v in found.over("b", "a")] == [[2.0, 4.0], [1.0, 3.0]]
    with pytest.raises(EppError, match="over a and b; expected a map of the same axes"):
        found.over("a", "c")
    assert found.to_dict()["points"] == [[1.0, 2.0], [3.0, 4.0]]


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: outcome_boundary(RELAY, {"loop.gain": "1:5:4"}), "two of them"),
        (lambda: outcome_boundary(RELAY, AXES, "trigger"), "expected one of simulate, predict, cycles"),
        (lambda: outcome_boundary(RELAY, AXES | {"loop.gain": "1:5"}), "start:stop:count:unit"),
        (lambda: outcome_boundary(RELAY, AXES, scheduler="magic"), "address of a Dask scheduler"),
        (lambda: fold_boundary(RELAY, {"loop.gain": "1:5:4"}), "two of them"),
        (
            lambda: fold_boundary(epp.case("azimuth_servo"), {"Kp": "20:80:2:V/rad", "Ti": "0.4:0.5:2:s"}),
            "does not cover loops with sampled controllers: use outcome_boundary",
        ),
        (
            lambda: fold_boundary(RELAY, {"loop.gain": "0.01:0.02:2", "relay_dead_zone.threshold": "1:1.1:2"}),
            "no fold in relay_dead_zone.threshold",
        ),
    ],
)
def test_what_is_wrong_is_one_sentence(call, words) -> None:
    with pytest.raises(EppError, match=words):
        call()
