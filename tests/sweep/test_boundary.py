"""Boundaries: against loops whose boundary is known in closed form, and against the branch's own fold."""

from __future__ import annotations

import numpy as np
import pytest

import eppanalysis as epp
from eppanalysis.errors import EppError
from eppanalysis.results import Status
from eppanalysis.sweep.boundary import Boundary, edges_of, free_region, outcome_boundary, pieces_of

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


@pytest.fixture(scope="module")
def region() -> Boundary:
    """The loop is homogeneous: its cycles end where the threshold is 1.6625701907 times the gain."""
    return free_region(RELAY, {"loop.gain": [1.0, 1.2], "relay_dead_zone.threshold": [1.5, 1.8]})


@pytest.mark.slow
def test_a_region_ends_where_exact_cycles_do(region: Boundary) -> None:
    assert region.status is Status.CONVERGED and set(region.kinds) == {"fold", "end of the range"}
    gain, threshold = region.over("loop.gain", "relay_dead_zone.threshold")
    fold = np.array(region.kinds) == "fold"
    np.testing.assert_allclose((threshold / gain)[fold], 1.6625701907, rtol=1e-9)


@pytest.mark.slow
def test_its_border_is_closed_and_has_its_area(region: Boundary) -> None:
    """A triangle above the line, cut off by the ranges."""
    np.testing.assert_array_equal(region.points[0], region.points[-1])
    last = 1.8 / 1.6625701907
    assert region.area == pytest.approx(1.8 * (last - 1.0) - 0.5 * 1.6625701907 * (last**2 - 1.0), rel=1e-8)
    assert str(region).startswith("No limit cycle in 9.5 % of loop gain from 1 to 1.2 and relay dead zone threshold")


@pytest.mark.slow
def test_runs_on_both_sides_of_the_border_agree(region: Boundary) -> None:
    """By runs of the case itself, one part in 10,000 of the ranges beside it; in time they know nothing of orbits."""
    size = np.array([0.2, 0.3])
    for at, kind in zip(region.points, region.kinds, strict=True):
        if kind != "fold" or not np.all((at > [1.001, 1.501]) & (at < [1.199, 1.799])):
            continue
        for side, status in ((1.0, Status.SETTLED), (-1.0, Status.LIMIT_CYCLE)):
            gain, threshold = at + side * 1e-4 * size * [-1.0, 1.0]
            here = RELAY.with_values({"loop.gain": gain, "relay_dead_zone.threshold": threshold})
            assert epp.simulate(here, decide=True).status is status


@pytest.mark.slow
def test_a_border_goes_on_with_another_family_where_their_borders_cross() -> None:
    """The elbow's at the small ranges, against the bound on single lines and the fold of a branch."""
    case = epp.case("fig8a_original")
    axes = {"bands.range": ["1.03 lbf", "1.13 lbf"], "lock_pin.backlash": ["0.182 deg", "0.482 deg"]}
    found = free_region(case, axes, places=3)
    assert found.status is Status.CONVERGED
    points = found.points[np.array(found.kinds) == "fold"]
    slopes = np.diff(points[:, 1]) / np.diff(points[:, 0])
    assert slopes.max() > 2.0 * slopes.min()
    for gain, backlash in points[[1, -2]].tolist():
        at = [f"{backlash * 0.9} rad", f"{backlash * 1.1} rad"]
        cell = epp.design_bounds(case, "bands.range", "lock_pin.backlash", at=[gain], within=tuple(at), starts=50)[0]
        assert backlash == pytest.approx(cell.exact, rel=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize(("gain", "inside"), [("2/(1 + a*a + b*b)", "cycles"), ("(1 + a*a + b*b)/4", "none")])
def test_a_border_that_closes_within_the_ranges_is_a_circle(gain: str, inside: str) -> None:
    """The gain depends on two parameters alike: the border is where it is that at which the relay's cycles end."""
    parts = {"num": [f"5*({gain})"], "den": [1, 2, 1, 0], "start": [0.0, 0.0, 1.0]}
    case = epp.Case.from_tables({
        "kind": "diagram",
        "title": "Relay with dead zone",
        "connect": ["-plant -> relay", "relay -> plant"],
        "parameters": {"a": 0.1, "b": 0.1},
        "blocks": {"plant": {"kind": "transfer_function", **parts}},
        "elements": {"relay": {"kind": "relay_dead_zone", "threshold": 1.0, "level": 1.0}},
        "run": {"t_end": "60 s"},
    })  # fmt: skip
    found = free_region(case, {"a": [-2.0, 2.0], "b": [-2.2, 2.0]}, places=3)
    square = 2.0 * 1.6625701907 - 1.0 if inside == "cycles" else 4.0 / 1.6625701907 - 1.0
    assert found.status is Status.CONVERGED
    on = np.array(found.kinds) == "fold"
    np.testing.assert_allclose(np.sum(found.points[on] ** 2, axis=1), square, rtol=1e-8)
    # Of a polygon in the circle.
    circle = np.pi * square
    assert found.area == pytest.approx(16.8 - circle if inside == "cycles" else circle, abs=0.02 * circle)
    assert (np.sum(np.isnan(found.points[:, 0])) == 1) == (inside == "cycles")


def test_a_region_may_have_no_border_of_cycles() -> None:
    found = free_region(RELAY, {"loop.gain": [0.1, 0.2], "relay_dead_zone.threshold": [1.0, 2.0]}, places=3)
    assert set(found.kinds) == {"end of the range"}
    assert found.area == pytest.approx(0.1, rel=1e-12)


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
        (lambda: free_region(RELAY, {"loop.gain": "1:5:4"}), "two of them"),
        (
            lambda: free_region(epp.case("azimuth_servo"), {"Kp": "20:80:2:V/rad", "Ti": "0.4:0.5:2:s"}),
            "does not cover loops with sampled controllers: use outcome_boundary",
        ),
        (
            lambda: free_region(RELAY, {"loop.gain": [5.0, 6.0], "relay_dead_zone.threshold": [1.0, 1.1]}, places=2),
            "limit cycles are at all places searched",
        ),
        (
            lambda: free_region(RELAY, {"loop.gain": [5.0], "relay_dead_zone.threshold": [1.0, 1.1]}),
            "loop.gain has one value; expected a range",
        ),
    ],
)
def test_what_is_wrong_is_one_sentence(call, words) -> None:
    with pytest.raises(EppError, match=words):
        call()
