"""Sweeps with a limit cycle that is allowed: closed forms, stores, shares, boundaries and pictures that know it."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest
import xarray
from typer.testing import CliRunner

import eppanalysis as epp
from eppanalysis.cli.commands import app
from eppanalysis.results import Status
from eppanalysis.sweep.analyses import NOT_RUN, Allowance
from eppanalysis.sweep.picture import plot_design_map, plot_slices, plot_sweep
from tests.shared import said_above

SERVO = epp.case("backlash_servo")
#: Peak to peak of the cycle for a gap of one: published with the case (exact), and of first order.
EXACT, FIRST_ORDER = 1.959706261794195, 2.020632276959861
GAPS = {"play.gap": "0.2:0.3:3"}
SETTLES, WITHIN, EXCEEDS = Allowance.SETTLES, Allowance.WITHIN, Allowance.EXCEEDS


def triangle(sign: float = 1.0) -> epp.LureSystem:
    """A relay with hysteresis 0.5 at an integrator: a triangle of amplitude 0.5 and frequency gain / 2 [Hz]."""
    return epp.LureSystem.from_tf(([sign], [1.0, 0.0]), epp.HysteresisRelay(-0.5, 0.5, -sign, sign))


@pytest.fixture(scope="module")
def gaps() -> xarray.Dataset:
    return epp.sweep(SERVO, GAPS, ("simulate", "predict", "cycles"), allow="x 0.5", progress=False)


@pytest.fixture(scope="module")
def grid() -> xarray.Dataset:
    axes = {"loop.gain": "0.8:2:3", "play.gap": "0.1:0.4:4"}
    return epp.sweep(SERVO, axes, ("simulate", "predict"), allow="x 0.5", progress=False)


@pytest.fixture(scope="module")
def edge() -> epp.Boundary:
    return epp.free_region(SERVO, {"loop.gain": [0.9, 1.0], "play.gap": [0.2, 0.4]}, allow="x 0.5", places=3)


@pytest.mark.parametrize(
    ("prefix", "share", "within"), [("", EXACT, 1e-4), ("exact_", EXACT, 1e-9), ("predicted_", FIRST_ORDER, 1e-6)]
)
def test_sizes_scale_with_the_gap_and_cells_are_told_apart_by_them(gaps, prefix, share, within) -> None:
    size = share * gaps["play.gap"].values
    np.testing.assert_allclose(gaps[f"{prefix}size"], size, rtol=within)
    np.testing.assert_array_equal(gaps[f"{prefix}allowed"], np.where(size > 0.5, EXCEEDS, WITHIN))


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_rms_of_a_triangle_is_its_amplitude_by_the_root_of_three(sign: float) -> None:
    found = epp.sweep(
        triangle(sign), {"loop.gain": [1.0, 2.0]}, ("simulate", "cycles"), allow="x 0.28 rms", progress=False
    )
    for prefix in ("", "exact_"):
        # The trapezoid rule on 256 samples of a triangle: 4 / 256^2 too much.
        np.testing.assert_allclose(found[f"{prefix}size"], 0.5 / math.sqrt(3.0), rtol=1e-4)
        assert found[f"{prefix}allowed"].values.tolist() == [EXCEEDS, EXCEEDS]


def test_outside_the_band_cycles_are_let_be() -> None:
    allow = "x 0.28 rms within 0.9 Hz..1.2 Hz"
    found = epp.sweep(triangle(), {"loop.gain": [1.0, 2.0, 3.0]}, ("simulate", "cycles"), allow=allow, progress=False)
    np.testing.assert_allclose(found["frequency"], [0.5, 1.0, 1.5], rtol=1e-9)
    for prefix in ("", "exact_"):
        assert found[f"{prefix}allowed"].values.tolist() == [WITHIN, EXCEEDS, WITHIN]
        assert np.isfinite(found[f"{prefix}size"]).values.tolist() == [False, True, False]


def test_what_settles_and_what_diverges_are_neither() -> None:
    relay = epp.case("relay_deadzone")
    found = epp.sweep(relay, {"loop.gain": [0.5, 1.0, 50.0]}, ("simulate", "cycles"), allow="x 1000", progress=False)
    for name in ("allowed", "exact_allowed"):
        beside = {0: Allowance.UNKNOWN, 1: SETTLES, 2: WITHIN, 3: Allowance.DIVERGES}
        outcome = found[name.replace("allowed", "outcome")].values
        assert found[name].values.tolist() == [beside[int(code)] for code in outcome]
    assert found["allowed"].values[0] == SETTLES


def test_what_a_search_left_open_is_not_called_allowed() -> None:
    case, at = epp.case("parking_stops_it"), {"lock_pin.backlash": ["0.98 deg"]}
    found = epp.sweep(case, at, "cycles", allow="theta 3 deg", progress=False)
    assert found["status"].attrs["flag_meanings"].split()[int(found["status"][0])] == Status.UNDECIDED.name.lower()
    assert found["exact_allowed"].values.tolist() == [Allowance.UNKNOWN]


def test_one_signal_and_its_size_are_reported_by_default() -> None:
    case = epp.case("fig8a_original").with_values({"run.t_end": "1 s"})
    found = epp.sweep(case, {"lock_pin.backlash": ["2 deg"]}, allow="drive_angle 3 deg", progress=False)
    assert found.attrs["signal"] == "drive_angle" and found["size"].attrs["units"] == "rad"
    np.testing.assert_allclose(found["size"], found["peak_to_peak"], rtol=1e-12)


def test_other_units_are_the_same_sweep_and_another_size_is_not(tmp_path: Path) -> None:
    case = epp.case("fig8a_original").with_values({"run.t_end": "1 s"})
    axes, store = {"lock_pin.backlash": ["1 deg", "2 deg", "3 deg"]}, tmp_path / "map.zarr"
    first = epp.sweep(case, axes, allow="theta 180 deg", store=store, progress=False).load()
    again = epp.sweep(case, axes, allow=f"theta {math.pi!r} rad", store=store, progress=False).load()
    assert first.identical(again)
    for other in ("theta 90 deg", "theta 180 deg rms", "theta 180 deg within 1 Hz..8 Hz", None):
        with pytest.raises(epp.EppError, match="another limit cycle allowed|other variables"):
            epp.sweep(case, axes, signals="theta", allow=other, store=store, progress=False)


def test_a_store_without_it_is_what_it_was_before(tmp_path: Path) -> None:
    """Neither the sheet nor the marks of a sweep without an allowed cycle know of one."""
    made = {"store": tmp_path / "map.zarr", "progress": False}
    epp.sweep(SERVO, {"play.gap": ["1", "2"]}, **made)
    assert "allowed" not in json.loads((tmp_path / "map.zarr/progress/sweep.json").read_text())["facts"]
    with pytest.raises(epp.EppError, match="other variables|another limit cycle allowed"):
        epp.sweep(SERVO, {"play.gap": ["1", "2"]}, allow="x 1", **made)


@pytest.mark.slow
def test_shares_joined_are_the_sweep_to_the_bit(grid: xarray.Dataset, tmp_path: Path) -> None:
    axes = {"loop.gain": "0.8:2:3", "play.gap": "0.1:0.4:4"}
    asked = {"run": ("simulate", "predict"), "allow": "x 0.5", "store": tmp_path / "map.zarr", "progress": False}
    for number in (1, 2):
        part = epp.sweep(SERVO, axes, shard=(number, 2), **asked)
        assert (part["status"] == NOT_RUN).any()
    joined = epp.sweep(SERVO, axes, merge=True, **asked).load()
    assert joined.identical(grid)


@pytest.mark.slow
def test_the_region_of_what_is_allowed_ends_at_the_bounds(edge: epp.Boundary) -> None:
    """The published cycle at a gain of one: the gap at which it is as large as allowed."""
    assert edge.status is Status.CONVERGED and set(edge.kinds) == {"allowed size", "end of the range"}
    at_one = [gap for gain, gap in edge.points.tolist() if gain == 1.0]
    assert min(abs(gap / (0.5 / EXACT) - 1.0) for gap in at_one) < 1e-9
    assert edge.label == "no stable limit cycle larger than allowed (x 0.5 peak to peak)"


@pytest.mark.parametrize(("run", "share"), [("predict", FIRST_ORDER), ("simulate", EXACT)])
def test_a_boundary_by_halving_is_where_cells_begin_to_exceed_it(run: str, share: float) -> None:
    axes = {"loop.gain": [0.99, 1.01], "play.gap": "0.2:0.3:2"}
    found = epp.outcome_boundary(SERVO, axes, run, allow="x 0.5", halvings=6, progress=False)
    across = found.points[:, 1]
    # At a gain of one it is half way between both, but for the curve's bend.
    assert across.mean() == pytest.approx(0.5 / share, abs=0.1 / 2**7 + 1e-4)
    assert "what is allowed" in found.label


def test_a_map_tells_apart_what_is_allowed(grid: xarray.Dataset) -> None:
    points = np.array([[0.5, np.nan], [1.0, 0.5 / EXACT]])
    names, label = ("loop.gain", "play.gap"), "exact bound, x 0.5 peak to peak allowed"
    edge = epp.Boundary(names, points, label, Status.CONVERGED, "By hand.", {"loop.gain": "", "play.gap": ""})
    figure = plot_design_map(grid, curves=[edge])
    ax = figure.axes[0]
    np.testing.assert_array_equal(ax.collections[0].get_array().reshape(4, 3), grid["allowed"].values.T)
    named = [text.get_text() for text in ax.get_legend().get_texts()]
    assert named == [
        "cycles within what is allowed", "exceeds what is allowed", "peak to peak of x",
        "describing function exceeds it", label,
    ]  # fmt: skip
    verdict, details = said_above(figure)
    assert "what is allowed in" in verdict.replace("\n", " ") and details.endswith("allowed is x 0.5 peak to peak")
    figure.draw_without_rendering()
    box = ax.get_legend().get_window_extent()
    assert box.x0 >= 0.0 and box.x1 <= figure.bbox.width


def test_slices_show_the_size_that_is_allowed(gaps: xarray.Dataset) -> None:
    size = plot_slices(gaps).axes[0]
    assert size.get_ylabel() == "size of x"
    assert any(np.allclose(line.get_ydata(), 0.5) for line in size.lines)
    assert plot_sweep(epp.sweep(SERVO, epp.Sobol({"play.gap": "0.2:0.3"}, 4), allow="x 0.5", progress=False)).axes


@pytest.mark.parametrize(
    ("asked", "words"),
    [
        ({"allow": "theta 1 deg"}, "the loop has no signal 'theta'"),
        ({"allow": "x 1 Hz"}, "x is '1 Hz'"),
        ({"allow": "x 0.5", "run": "trigger"}, "run has no cycles"),
    ],
)
def test_what_cannot_be_allowed_is_refused(asked: dict[str, str], words: str) -> None:
    with pytest.raises(epp.EppError, match=words):
        epp.sweep(SERVO, GAPS, progress=False, **asked)


def test_the_command_counts_and_draws(tmp_path: Path) -> None:
    asked = ["sweep", "backlash_servo", "--axis", "play.gap=0.2:0.3:11", "--allow", "x 0.5", "--json"]
    done = CliRunner().invoke(app, [*asked, "-o", str(tmp_path / "map.png")])
    assert done.exit_code == 0, done.output
    counts = json.loads(done.stdout)["cases"][0]["result"]
    assert counts["allowed"] == {"cycles_within_what_is_allowed": 6, "exceeds_what_is_allowed": 5}
    assert (tmp_path / "map.png").exists()


@pytest.mark.slow
def test_the_elbows_boundary_is_where_its_branch_has_the_size() -> None:
    """The exact branch over the backlash, read by hand between its points."""
    case = epp.case("fig8a_original")
    axes = {"bands.range": ["2.5 lbf", "3 lbf"], "lock_pin.backlash": ["0.5 deg", "5 deg"]}
    edge = epp.free_region(case, axes, allow="theta 4 deg", places=3)
    reached = edge.points[np.array(edge.kinds) == "allowed size"]
    for gain, bound in reached[:: len(reached) // 2].tolist():
        here = case.with_values({"bands.range": gain})
        branch = epp.continue_branch(here, "lock_pin.backlash", "4 deg", "2 deg", max_step=0.02)
        value, size = (np.asarray(branch.points[name]) for name in ("value", "theta"))
        assert bound == pytest.approx(np.interp(math.radians(4.0), size[::-1], value[::-1]), rel=1e-4)
