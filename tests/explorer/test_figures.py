"""The pictures of the explorer's page."""

import math
from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("bokeh")

from bokeh.document import Document

from eppanalysis import case, simulate
from eppanalysis.explorer import figures
from eppanalysis.explorer.figures import BranchPicture, MapPicture, RunPictures
from eppanalysis.explorer.quick import compute, shown_signal
from eppanalysis.explorer.standalone import standalone


def named(picture) -> list[str]:
    """What a legend names."""
    return [item.label["value"] for item in picture.figure.legend[0].items if item.visible]


def test_a_legend_names_what_there_is():
    picture = BranchPicture("x", "")
    assert named(picture) == []
    pieces = [{"stable": [True, True, False], "value": [1.0, 2.0, 1.5], "size": [3.0, 4.0, 2.0]}]
    picture.show_branch({"pieces": pieces, "begins": []}, "gain", 1.0, 1.0)
    assert named(picture) == ["stable", "unstable"]
    picture.show_exact({"size": [3.0], "stable": [True]}, 1.0, 1.0)
    picture.show_run(1.0, 0.0)
    assert named(picture) == ["stable", "unstable", "exact, stable", "run"]
    picture.show_branch({"pieces": [], "begins": []}, "gain", 1.0, 1.0)
    picture.show_exact(None, 1.0, 1.0)
    assert named(picture) == ["run"]


def test_a_run_that_is_not_decided_is_not_marked_as_one_at_rest():
    picture = BranchPicture("x", "")
    sizes = [
        compute(loop, shown_signal(loop), {}).peak_to_peak
        for loop in (case("stiction_deadband_none"), case("upright"), case("backlash_servo"))
    ]
    assert math.isnan(sizes[0]) and sizes[1] == 0.0 < sizes[2]
    for size, names in zip(sizes, ([], ["run"], ["run"]), strict=True):
        picture.show_run(1.0, size)
        assert named(picture) == names


def test_a_map_names_the_design_and_where_cycles_begin():
    picture = MapPicture("gain", "gap", (0.0, 2.0), (0.0, 1.0))
    colours = ["settles", "oscillates", "diverges", "not decided", "changes in between"]
    assert named(picture) == colours
    picture.show_place(1.0, 0.5)
    picture.show_begins([(0.5, 0.5)])
    picture.show_border({"x": [0.5, 1.0], "y": [0.0, 1000.0]}, 2.0, 1e-3)
    assert picture.border.data["x"].tolist() == [1.0, 2.0] and picture.border.data["y"].tolist() == [0.0, 1.0]
    begun = ["cycles end, exactly", "cycles begin, exactly", "the design: 1, 0.5 (drag or tap)"]
    assert named(picture) == [*colours, *begun]


def test_the_run_before_a_move_stays_behind_those_after_it():
    servo, pictures = case("backlash_servo"), RunPictures("x", "")
    picture = pictures.step
    signal = shown_signal(servo)
    runs = [compute(servo, signal, {"loop.gain": gain}) for gain in (3.0, 3.1, 3.2)]
    pictures.show(runs[0], "3.0")
    picture.keep()
    for run, text in zip(runs[1:], ("3.1", "3.2"), strict=True):
        pictures.show(run, text)
        picture.name()
        assert named(picture) == [f"now: {text}", "before: 3.0"]
        assert picture.ghost.data["values"][0].tolist() == pytest.approx(runs[0].values.tolist(), abs=1e-5)
        assert picture.row.data["values"][0].tolist() == pytest.approx(run.values.tolist(), abs=1e-5)


def test_of_a_long_run_that_soon_rests_the_beginning_is_shown():
    """600 s of an aircraft that is at rest after some seconds were a spike of four samples."""
    aircraft = case("rate_limited_aircraft")
    shown = compute(aircraft, shown_signal(aircraft), {})
    assert aircraft.t_end == 600.0 and 5.0 <= shown.time[-1] <= 20.0
    assert np.abs(np.diff(shown.values)).max() < 0.05 * np.ptp(shown.values)
    moves = np.abs(shown.values) > 0.02 * np.ptp(shown.values)
    assert moves.mean() > 0.05 and not moves[-1]


@pytest.mark.parametrize("name", ["x15_flare", "fig8a_original", "two_mass_deadzone"])
def test_of_a_run_that_oscillates_no_more_is_shown_than_its_periods_can_be_told_apart(name):
    """223 periods of an aircraft were a blue block."""
    loop = case(name)
    shown, run = compute(loop, shown_signal(loop), {}), simulate(loop)
    cycle = run.limit_cycle
    assert run.settled_since + 15 * cycle.period <= shown.time[-1] < loop.t_end
    steady = shown.values[shown.time > shown.time[-1] - 3 * cycle.period]
    assert np.ptp(steady) == pytest.approx(shown.factor * cycle.peak_to_peak[shown.signal], rel=0.03)


def test_the_time_axis_stays_in_small_moves_and_holds_what_there_is_to_see():
    loop, held, ends = case("backlash_servo_unseen"), 0.0, []
    for gain in (1.0, 1.03, 1.06, 1.1, 1.15, 1.2, 1.15, 1.1, 1.06, 1.03, 1.06):
        shown = compute(loop, shown_signal(loop), {"loop.gain": gain}, held)
        cycle = simulate(loop.with_values({"loop.gain": gain}))
        assert cycle.settled_since + 15 * cycle.limit_cycle.period <= shown.until
        held = shown.until
        ends.append(held)
    alone = {compute(loop, shown_signal(loop), {"loop.gain": gain}).until for gain in (1.0, 1.1, 1.2)}
    assert len(set(ends)) == 1 < len(alone)


def test_a_loop_in_discrete_time_is_shown_sample_by_sample():
    loop = case("backlash_discrete_pi")
    shown, run = compute(loop, shown_signal(loop), {}), simulate(loop)
    expected = shown.factor * run.signals[shown.signal][: shown.values.size]
    assert shown.values.tolist() == pytest.approx(expected.tolist(), rel=1e-12)
    assert 10 * run.limit_cycle.period < shown.time[-1] < 0.5 * loop.t_end == 2000.0
    assert shown.sentence.startswith("Oscillates at")


def test_axes_of_the_nyquist_picture_stay_in_small_moves_and_show_the_cycle_after_large_ones():
    servo, pictures = case("relay_hyst_servo"), RunPictures("x", "")
    signal = shown_signal(servo)

    def window(gain: float) -> list[float]:
        found = compute(servo, signal, {"loop.gain": gain})
        pictures.show(found, "")
        x, y = pictures.nyquist.figure.x_range, pictures.nyquist.figure.y_range
        for point in (0j, found.loop.point):
            assert x.start < point.real < x.end
            assert y.start < point.imag < y.end
        return [x.start, x.end, y.start, y.end]

    first = window(1.0)
    assert window(1.01) == first
    large = window(10.0)
    assert large[1] - large[0] > 1.5 * (first[1] - first[0])
    assert window(1.0) == pytest.approx(first)


def test_marks_that_do_not_move_are_not_drawn_again():
    picture, drawn = MapPicture("gain", "gap", (0.0, 2.0), (0.0, 1.0)), []
    picture.star.on_change("data", lambda attr, old, new: drawn.append(new))
    for place in ((1.0, 0.5), (1.0, 0.5), (1.0, 0.6)):
        picture.show_place(*place)
    assert len(drawn) == 2


def test_a_page_that_is_kept_promises_nothing_that_is_still_being_computed():
    doc, picture = Document(), BranchPicture("x", "mm")
    doc.add_root(picture.figure)
    picture.figure.title.text = "Limit cycles: being computed ..."
    page = standalone(doc, "Servo", ["Settles at rest.", "Exact limit cycles: being sought ..."], ["branch"])
    assert "being sought" not in page and "being computed" not in page and "Settles at rest." in page
    assert page.count("imit cycles: not yet known when this page was saved") == 2
    assert picture.figure.title.text.endswith("...")


def test_a_move_is_one_change_of_one_source_so_that_both_pictures_are_drawn_in_one_frame():
    servo, doc, pictures = case("backlash_servo"), Document(), RunPictures("x", "")
    for picture in (pictures.step, pictures.nyquist):
        doc.add_root(picture.figure)
    runs = [compute(servo, shown_signal(servo), {"loop.gain": gain}) for gain in (3.0, 3.001)]
    pictures.show(runs[0], "3.0")
    changed = []
    doc.on_change(changed.append)
    pictures.show(runs[1], "3.001")
    assert [type(event).__name__ for event in changed] == ["ColumnDataChangedEvent"]


def test_lines_of_runs_are_no_wider_than_what_is_drawn_without_an_outline():
    """Of 220 oscillations a line of 1.3 px takes a browser without a graphics card 20 ms, one of 1 px less than one."""
    assert all(line.glyph.line_width <= 1.0 for line in RunPictures("x", "").step.figure.renderers)


def test_a_loop_without_a_gain_has_no_curves_and_no_names_of_them():
    servo, pictures = case("backlash_servo"), RunPictures("x", "")
    found = compute(servo, shown_signal(servo), {})
    pictures.show(found, "")
    assert named(pictures.nyquist) == ["G(jω)", "−1/N(A)", "cycle of the describing function", "run"]
    pictures.show(replace(found, loop=None, of_run=None), "")
    assert named(pictures.nyquist) == [] and named(pictures.step) == ["now"]


@pytest.mark.parametrize("seed", range(6))
def test_no_cell_of_the_map_shows_what_none_of_its_runs_does(seed: int) -> None:
    """A fold between two runs lay in a cell that was all "oscillates", half of it beneath the fold."""
    rng = np.random.default_rng(seed)
    xs, ys = np.sort(rng.uniform(1.0, 4.0, 9)), np.sort(rng.uniform(0.2, 3.0, 7))
    xs, ys = np.linspace(xs[0], xs[-1], 9), np.linspace(ys[0], ys[-1], 7)
    slope, height = rng.uniform(-0.3, 0.3), rng.uniform(ys[1], ys[-2])
    fold = height + slope * (xs - xs.mean())
    outcome = np.where(ys[:, None] > fold[None, :], 2, 1)
    picture = figures.MapPicture("x", "y", (xs[0], xs[-1]), (ys[0], ys[-1]))
    picture.show_cells({"outcome": outcome.tolist(), "x": xs.tolist(), "y": ys.tolist()}, 1.0, 1.0)
    data = picture.cells.data
    image, low, wide = data["image"][0], (data["x"][0], data["y"][0]), (data["dw"][0], data["dh"][0])
    assert low == (xs[0], ys[0]) and np.allclose(np.add(low, wide), (xs[-1], ys[-1]))
    for x, y in zip(rng.uniform(xs[0], xs[-1], 500), rng.uniform(ys[0], ys[-1], 500), strict=True):
        i = min(int((y - low[1]) / wide[1] * image.shape[0]), image.shape[0] - 1)
        j = min(int((x - low[0]) / wide[0] * image.shape[1]), image.shape[1] - 1)
        truth = 2 if y > height + slope * (x - xs.mean()) else 1
        assert image[i, j] in (truth, figures._BETWEEN)
    visible = {item.label["value"] for item in picture.figure.legend[0].items if item.visible}
    assert {"settles", "oscillates", "changes in between"} <= visible
