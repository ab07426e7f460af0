"""Pictures of sweeps: what is drawn is what the dataset holds, in the units that people read."""

from __future__ import annotations

import math
import re

import numpy as np
import pytest
from matplotlib.colors import to_hex

import eppanalysis as epp
from eppanalysis.errors import EppError
from eppanalysis.results import Status
from eppanalysis.sweep.boundary import Boundary
from eppanalysis.sweep.parallel import plot_parallel
from eppanalysis.sweep.picture import plot_design_map, plot_slices, plot_sweep
from tests.shared import said_above

DEG, LBF = math.pi / 180, 4.4482216152605
SHORT = epp.case("fig8a_original").with_values({"run.t_end": "2 s"})
AXES = {"bands.range": "2:3:3:lbf", "lock_pin.backlash": "0.5:2.5:4:deg"}
RELAY = epp.case("relay_deadzone")


@pytest.fixture(scope="module")
def grid():
    return epp.sweep(SHORT, AXES, progress=False)


@pytest.fixture(scope="module")
def relays():
    return epp.sweep(RELAY, {"relay_dead_zone.threshold": [0.5, 1.0, 4.0]}, run="all", progress=False)


def texts(figure) -> list[str]:
    legend = figure.axes[0].get_legend()
    return [] if legend is None else [t.get_text() for t in legend.get_texts()]


def test_a_map_shows_every_cell_at_its_place(grid) -> None:
    ax = plot_design_map(grid).axes[0]
    mesh = ax.collections[0]
    np.testing.assert_array_equal(mesh.get_array().reshape(4, 3), grid["outcome"].values.T)
    corners = mesh.get_coordinates()
    np.testing.assert_allclose(corners[0, :, 0], [1.75, 2.25, 2.75, 3.25])
    np.testing.assert_allclose(corners[:, 0, 1], 0.5 + (np.arange(5) - 0.5) * 2 / 3)
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("bands range [lbf]", "lock pin backlash [deg]")


def test_a_map_turns_with_its_axes(grid) -> None:
    ax = plot_design_map(grid, "lock_pin.backlash", "bands.range").axes[0]
    np.testing.assert_array_equal(ax.collections[0].get_array().reshape(3, 4), grid["outcome"].values)


@pytest.mark.parametrize("law", [lambda x, y: x + y, lambda x, y: x * y**3, lambda x, y: np.exp(-5.0 * (x + y))])
def test_labels_of_contours_lie_within_the_frame_and_not_on_each_other(law) -> None:
    axes = {"bands.range": "2:3:12:lbf", "lock_pin.backlash": "0.5:2.5:12:deg"}
    cells = epp.sweep(SHORT.with_values({"run.t_end": "0.1 s"}), axes, progress=False)
    x, y = np.meshgrid(*2 * [np.linspace(0.0, 1.0, 12)])
    figure = plot_design_map(cells.assign(peak_to_peak=cells["peak_to_peak"].copy(data=law(x, y) * DEG)))
    figure.draw_without_rendering()
    ax = figure.axes[0]
    labels = [text.get_window_extent() for text in ax.texts]
    assert labels and all(ax.bbox.containsx(edge) for box in labels for edge in (box.x0, box.x1))
    assert all(ax.bbox.containsy(edge) for box in labels for edge in (box.y0, box.y1))
    assert not any(box.overlaps(other) for i, box in enumerate(labels) for other in labels[:i])


@pytest.mark.parametrize("turned", [False, True])
def test_boundaries_lie_on_the_map_in_its_units(grid, turned) -> None:
    names = tuple(AXES)[::-1] if turned else tuple(AXES)
    edge = Boundary(tuple(AXES), np.array([[2 * LBF, DEG], [3 * LBF, 2 * DEG]]), "exact fold", Status.CONVERGED, "")
    figure = plot_design_map(grid, *names, curves=[edge])
    line = next(line for line in figure.axes[0].lines if line.get_label() == "exact fold")
    by_name = dict(zip(names, line.get_data(), strict=True))
    np.testing.assert_allclose(by_name["bands.range"], [2, 3])
    np.testing.assert_allclose(by_name["lock_pin.backlash"], [1, 2])
    assert "exact fold" in texts(figure)


def test_curves_by_name_differ_in_colour_and_line(grid) -> None:
    curves = {name: ([2 * LBF, 3 * LBF], [DEG, DEG]) for name in ("one", "two", "three", "four")}
    lines = [line for line in plot_design_map(grid, curves=curves).axes[0].lines if line.get_label() in curves]
    assert len({line.get_color() for line in lines}) == len({line.get_linestyle() for line in lines}) == 4


def test_a_map_of_more_axes_says_where_it_is() -> None:
    axes = {"forearm.inertia": [0.03, 0.0465], **AXES}
    found = epp.sweep(SHORT.with_values({"run.t_end": "0.3 s"}), axes, progress=False)
    figure = plot_design_map(found, at={"forearm.inertia": 1})
    assert figure.axes[0].get_xlabel() == "bands range [lbf]\nat forearm inertia = 0.0465 kg·m²"


def test_slices_have_a_line_for_every_value_of_the_other_axis(grid) -> None:
    figure = plot_slices(grid)
    size, frequency = figure.axes
    assert [ax.get_ylabel() for ax in figure.axes] == ["peak to peak\nof theta [deg]", "frequency [Hz]"]
    assert frequency.get_xlabel() == "lock pin backlash [deg]"
    assert texts(figure) == [*(f"bands range {v} lbf" for v in ("2", "2.5", "3")), "unknown"]
    backlash = grid["lock_pin.backlash"].values / DEG
    for line, i in zip(size.lines[:3], range(3), strict=True):
        drawn = np.asarray(line.get_ydata(), float)
        values = grid["peak_to_peak"].values[i] / DEG
        np.testing.assert_allclose(drawn[np.isin(line.get_xdata(), backlash)], values)
    # Dark to light, so that the lines keep apart in print.
    brightness = [float(np.mean(line.get_color()[:3])) for line in size.lines[:3]]
    assert brightness == sorted(brightness)


def test_designs_of_which_nothing_is_known_have_a_mark_where_no_curve_goes() -> None:
    found = epp.sweep(epp.case("robot_servo").with_values({"run.t_end": "0.6 s"}), {"Kp": [20.0, 60.0]}, progress=False)
    unknown = found["Kp"].values[found["outcome"].values == 0]
    assert unknown.size
    figure = plot_slices(found)
    assert "unknown" in texts(figure)
    for ax in figure.axes:
        marks = [line for line in ax.lines if line.get_marker() == "x"]
        np.testing.assert_array_equal(marks[0].get_xdata(), unknown)
        assert ax.get_xlim()[0] <= found["Kp"].values.min() and found["Kp"].values.max() <= ax.get_xlim()[1]


def test_slices_are_broken_between_rest_and_oscillation(relays) -> None:
    for line, name in zip(plot_slices(relays).axes[0].lines, ("", "predicted_", "exact_"), strict=True):
        x, y = (np.asarray(values, float) for values in line.get_data())
        assert relays[f"{name}outcome"].values.tolist() == [2, 2, 1]
        np.testing.assert_allclose(x, [0.5, 1.0, 2.5, 4.0])
        assert np.isnan(y[2]) and not np.any(np.isnan(y[:2]))
        # A cell between two breaks is no line; it is seen by its marker.
        assert line.get_marker() not in ("", "None")


def test_pictures_name_their_case(grid, relays) -> None:
    sample = epp.sweep(RELAY, epp.Sobol({"relay_dead_zone.threshold": (0.5, 2.0)}, 2), run="predict", progress=False)
    names = ["predicted_peak_to_peak", "predicted_frequency"]
    above = [said_above(f) for f in (plot_design_map(grid), plot_slices(relays), plot_parallel(sample, names))]
    assert [details for _, details in above] == ["fig8a_original", "relay_deadzone", "relay_deadzone"]
    # The counts are of all designs that are drawn.
    numbers = [[int(word) for word in re.findall(r"\d+", verdict)] for verdict, _ in above]
    assert all(first + sum(others) == total for first, total, *others in numbers)


def test_slices_show_methods_beside_each_other(relays) -> None:
    figure = plot_slices(relays)
    assert texts(figure) == ["run", "predicted", "exact"]
    assert [line.get_linestyle() for line in figure.axes[0].lines] == ["-", "--", ":"]
    np.testing.assert_allclose(figure.axes[1].lines[1].get_ydata()[[0, 1, 3]], relays["predicted_frequency"].values)


def test_parallel_coordinates_run_through_every_parameter_and_result() -> None:
    ranges = {"bands.range": "1:5:lbf", "lock_pin.backlash": "0:3:deg", "forearm.inertia": (0.03, 0.06)}
    found = epp.sweep(epp.case("fig8a_original"), epp.Sobol(ranges, 16), progress=False)
    figure = plot_parallel(found)
    ax = figure.axes[0]
    assert [t.get_text() for t in ax.get_xticklabels()] == [
        "bands range\n[lbf]",
        "lock pin\nbacklash\n[deg]",
        "forearm\ninertia\n[kg·m²]",
        "peak to\npeak [deg]",
        "frequency\n[Hz]",
    ]
    settles, oscillates = ax.collections
    # Apart without colour, in the picture and in the legend.
    assert settles.get_linestyle() != oscillates.get_linestyle()
    assert [line.get_linestyle() for line in ax.get_legend().get_lines()] == [":", "-"]
    n = int(np.sum(found["outcome"] == 2))
    assert len(oscillates.get_segments()) == n
    assert len(settles.get_segments()) == 16 - n
    assert texts(figure) == [f"settles ({16 - n})", f"oscillates ({n})"]
    # A cell at rest has no frequency: its line ends at the peak to peak.
    assert {len(s) for s in settles.get_segments()} == {4}
    assert {len(s) for s in oscillates.get_segments()} == {5}
    heights = np.array([s[0, 1] for s in oscillates.get_segments()])
    values = found["bands.range"].values
    share = (values - values.min()) / np.ptp(values)
    np.testing.assert_allclose(np.sort(heights), np.sort(share[found["outcome"].values == 2]))


def test_of_many_cells_some_are_drawn_and_the_picture_says_so(grid) -> None:
    figure = plot_parallel(grid, most=5)
    assert sum(len(c.get_segments()) for c in figure.axes[0].collections) == 5
    assert said_above(figure)[1].endswith("drawn are 5 of 12 designs")


def test_colours_of_outcomes_differ_without_hue(grid) -> None:
    """Red, green and blue weighted as the eye does; a difference of a tenth is seen by everyone."""
    collections = plot_parallel(grid).axes[0].collections
    colours = [tuple(int(to_hex(c.get_color()[0])[i : i + 2], 16) / 255 for i in (1, 3, 5)) for c in collections]
    light = [0.299 * r + 0.587 * g + 0.114 * b for r, g, b in colours]
    assert abs(light[0] - light[1]) > 0.1


def test_every_sweep_has_its_picture(grid, relays) -> None:
    assert plot_sweep(grid).axes[0].get_ylabel() == "lock pin backlash [deg]"
    assert plot_sweep(relays).axes[0].get_ylabel() == "peak to peak of x"
    sample = epp.sweep(RELAY, epp.Sobol({"relay_dead_zone.threshold": (0.5, 2.0)}, 2), run="predict", progress=False)
    assert plot_sweep(sample).axes[0].get_xticklabels()[-1].get_text() == "predicted\nfrequency [Hz]"


@pytest.mark.parametrize(
    ("draw", "words"),
    [
        (lambda d: plot_design_map(d, "bands.rnge"), "no axis 'bands.rnge'"),
        (lambda d: plot_design_map(d, "bands.range", "bands.range"), "two different ones"),
        (lambda d: plot_design_map(d.isel({"bands.range": 0}, drop=True)), "two axes or more"),
        (lambda d: plot_design_map(d.drop_vars("outcome")), "no outcome"),
        (lambda d: plot_slices(d, "bands.rnge"), "no axis 'bands.rnge'"),
        (lambda d: plot_slices(d, variables=["size"]), "no size"),
        (lambda d: plot_parallel(d, ["size"]), "no size"),
        (lambda d: plot_parallel(d.drop_vars("outcome")), "no outcome"),
        (lambda d: plot_slices(d.drop_vars(list(AXES))), "need an axis"),
    ],
)
def test_what_is_wrong_is_one_sentence(grid, draw, words) -> None:
    with pytest.raises(EppError, match=words):
        draw(grid)


@pytest.mark.parametrize(("t_end", "unknown"), [("0.01 s", True), ("188 s", False)])
def test_a_map_that_is_mostly_unknown_says_what_that_is(t_end, unknown):
    """A grey picture that says no more helps nobody."""
    case = epp.case("backlash_servo").with_values({"run.t_end": t_end})
    figure = epp.plot_design_map(epp.sweep(case, {"loop.gain": "0.9:1.1:2", "play.gap": "1:2:2"}, progress=False))
    assert ("neither settles nor repeats itself by its end (run.t_end)" in said_above(figure)[1]) == unknown


def test_a_region_is_filled_and_its_stretches_are_named() -> None:
    """Two stretches of the border of a triangle; on a map only what ends no range."""
    points = np.array([[1.0, 1.0], [2.0, 1.0], [2.0, 2.0], [1.0, 1.0]])
    kinds, within = ("fold", "end of the range", "end of the range", "fold"), ((1.0, 2.0), (1.0, 3.0))
    region = Boundary(("a.x", "b.y"), points, "no limit cycle", Status.CONVERGED, "", kinds=kinds, within=within)
    ax = region.plot()
    assert [text.get_text() for text in ax.get_legend().get_texts()] == ["no limit cycle", "fold", "end of the range"]
    fold, edge = ax.lines
    np.testing.assert_array_equal(fold.get_xydata()[2:], points[2:])
    np.testing.assert_array_equal(edge.get_xydata()[:3], points[:3])
    assert ax.get_xlim() == (1.0, 2.0) and ax.get_ylim() == (1.0, 3.0)
    assert ax.patches[0].get_path().vertices.tolist() == points.tolist()
