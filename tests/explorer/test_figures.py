"""The pictures of the explorer's page."""

import math

import numpy as np
import pytest

pytest.importorskip("bokeh")

from bokeh.document import Document

from eppanalysis import case, simulate
from eppanalysis.explorer.figures import BranchPicture, MapPicture, NyquistPicture, StepPicture
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
    picture.show_run(1.0, math.nan)
    assert named(picture) == ["stable", "unstable", "exact, stable", "run"]
    picture.show_branch({"pieces": [], "begins": []}, "gain", 1.0, 1.0)
    picture.show_exact(None, 1.0, 1.0)
    assert named(picture) == ["run"]


def test_a_map_names_the_design_and_where_cycles_begin():
    picture = MapPicture("gain", "gap", (0.0, 2.0), (0.0, 1.0))
    colours = ["settles", "oscillates", "diverges", "not decided"]
    assert named(picture) == colours
    picture.show_place(1.0, 0.5)
    picture.show_begins([(0.5, 0.5)])
    assert named(picture) == [*colours, "cycles begin, exactly", "the design: 1, 0.5 (drag or tap)"]


def test_the_run_before_a_move_stays_behind_those_after_it():
    servo, picture = case("backlash_servo"), StepPicture("x", "")
    signal = shown_signal(servo)
    runs = [compute(servo, signal, {"loop.gain": gain}) for gain in (3.0, 3.1, 3.2)]
    picture.show(runs[0], "3.0")
    picture.keep()
    for run, text in zip(runs[1:], ("3.1", "3.2"), strict=True):
        picture.show(run, text)
        picture.name()
        assert named(picture) == [f"now: {text}", "before: 3.0"]
        assert picture.ghost.data["y"].tolist() == pytest.approx(runs[0].values.tolist(), abs=1e-5)
        assert picture.source.data["y"].tolist() == pytest.approx(run.values.tolist(), abs=1e-5)


def test_of_a_long_run_that_soon_rests_the_beginning_is_shown():
    """600 s of an aircraft that is at rest after some seconds were a spike of four samples."""
    aircraft = case("rate_limited_aircraft")
    shown = compute(aircraft, shown_signal(aircraft), {})
    assert aircraft.t_end == 600.0 and 5.0 <= shown.time[-1] <= 20.0
    assert np.abs(np.diff(shown.values)).max() < 0.05 * np.ptp(shown.values)
    moves = np.abs(shown.values) > 0.02 * np.ptp(shown.values)
    assert moves.mean() > 0.05 and not moves[-1]


def test_a_loop_in_discrete_time_is_shown_sample_by_sample():
    loop = case("backlash_discrete_pi")
    shown, run = compute(loop, shown_signal(loop), {}), simulate(loop)
    expected = shown.factor * run.signals[shown.signal][: shown.values.size]
    assert shown.values.tolist() == pytest.approx(expected.tolist(), rel=1e-12)
    assert 10 * run.limit_cycle.period < shown.time[-1] < 0.5 * loop.t_end == 2000.0
    assert shown.sentence.startswith("Oscillates at")


def test_axes_of_the_nyquist_picture_stay_in_small_moves_and_show_the_cycle_after_large_ones():
    servo, picture = case("relay_hyst_servo"), NyquistPicture()
    signal = shown_signal(servo)

    def window(gain: float) -> list[float]:
        found = compute(servo, signal, {"loop.gain": gain})
        picture.show(found)
        x, y = picture.figure.x_range, picture.figure.y_range
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
