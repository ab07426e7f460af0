"""Pictures: what is drawn is what the result holds, and every axis has its unit."""

from __future__ import annotations

import re
import sys
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from matplotlib.colors import to_hex, to_rgb
from matplotlib.figure import Figure

import eppanalysis as epp
from eppanalysis.errors import EppError
from eppanalysis.methods.comparison.picture import plot_ladder
from eppanalysis.methods.continuation.picture import plot_branch
from eppanalysis.methods.driven import picture as driven_picture
from eppanalysis.methods.search import picture as search_picture
from eppanalysis.plotting import figure_of_height, lines_of, put_verdict
from eppanalysis.results import Status
from eppanalysis.results.picture import _extremes, periods, plot_limit_cycle, plot_nyquist, plot_trajectory
from eppanalysis.results.provenance import Provenance
from eppanalysis.sweep import parallel, picture as sweep_picture
from tests.shared import cycles_of, mostly_slow, of_unknown_response, said_above
from tests.synthetic import cycle, prediction, prediction_of_several, trajectory


def labels(figure):
    return [ax.get_ylabel() for ax in figure.axes]


def test_trajectory_has_one_panel_a_signal_with_its_unit():
    run = trajectory()
    figure = plot_trajectory(run)
    assert labels(figure) == ["theta [deg]", "voltage [V]"]
    assert figure.axes[-1].get_xlabel() == "time [s]"
    np.testing.assert_allclose(figure.axes[0].lines[0].get_ydata(), np.degrees(run.signals["theta"]))
    np.testing.assert_array_equal(figure.axes[1].lines[0].get_ydata(), run.signals["voltage"])


@pytest.mark.parametrize(("status", "shade"), [(Status.SETTLED, "at rest"), (Status.LIMIT_CYCLE, "on the limit cycle")])
def test_marks_and_shades_of_a_run_are_explained(status, shade):
    (legend,) = plot_trajectory(trajectory(status)).legends
    assert [text.get_text() for text in legend.get_texts()] == ["switch of an element", f"{shade} (from 0.5 s on)"]


def stands_out(colour) -> float:
    """Contrast to paper, the lesser of that by day and that by night, where pages turn pictures about (WCAG 2.2)."""
    day = np.array(to_rgb(colour))
    # The filter of pages, invert(0.92) and then hue-rotate(180deg), as CSS Filter Effects writes them.
    turned = 2.0 * np.array([[0.213, 0.715, 0.072]]).repeat(3, axis=0) - np.eye(3)
    night = np.clip(turned @ (0.92 - 0.84 * day), 0.0, 1.0)

    def luminance(rgb):
        return np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4) @ [0.2126, 0.7152, 0.0722]

    return min(1.05 / (luminance(day) + 0.05), (luminance(night) + 0.05) / (luminance(np.full(3, 0.08)) + 0.05))


def test_every_line_stands_out_from_paper_by_day_and_by_night(relay_ladder):
    search = cycles_of("relay_deadzone").plot().figure
    lines = [line for made in (plot_ladder(relay_ladder), search) for ax in made.axes for line in ax.lines]
    drawn = {line.get_color() for line in lines} | set(sweep_picture._LINE_COLOURS) - {"#000000"}
    drawn |= {colour for kind in (True, False) for colour, _ in parallel._LINES[kind]} - {"#000000"}
    drawn |= {*search_picture._STABLE, *search_picture._UNSTABLE, *(colour for colour, _ in driven_picture._STABLE)}
    drawn |= {to_hex(colour) for n in range(1, 7) for colour in sweep_picture._slice_colours(n)}
    assert len(drawn) > 5
    for colour in drawn:
        assert stands_out(colour) >= 3.0, colour


def letters(text: str) -> list[str]:
    """The words of a sentence, however its clauses end and begin."""
    return re.findall(r"\w+", text.lower())


@pytest.mark.parametrize("status", list(Status))
def test_trajectory_of_every_status_is_drawn_with_its_sentence(status):
    figure = trajectory(status).plot().figure
    figure.draw_without_rendering()
    verdict, details = said_above(figure)
    assert letters(f"{verdict} {details}") == letters(str(trajectory(status)))


def test_of_a_long_run_as_much_is_drawn_as_can_be_told_apart_and_the_axis_says_how_far_it_goes_on():
    """Runs of one loop that differ in length alone: fifteen periods on the cycle are shown of either."""
    runs = [epp.simulate(epp.case("backlash_servo"), t_end=t_end) for t_end in (800.0, 1600.0)]
    for run in runs:
        ax = run.plot(signals=["x"])
        shown = (ax.get_xlim()[1] - run.settled_since) / run.limit_cycle.period
        assert ax.get_xlim()[0] == 0.0 and shown == pytest.approx(15.0)
        assert ax.get_xlabel() == f"time [s], the same up to {run.end_time:.4g} s"
        t, drawn = ax.lines[0].get_data()
        late = (t > run.settled_since + 5.0 * run.limit_cycle.period) & (t < ax.get_xlim()[1])
        assert np.ptp(drawn[late]) == pytest.approx(run.limit_cycle.peak_to_peak["x"], rel=1e-3)


@pytest.mark.parametrize("name", ["rate_limited_aircraft", "fig8b_reduced_backlash"])
def test_a_run_that_rests_is_shown_until_nothing_moves(name, relay_ladder):
    run = epp.simulate(epp.case(name))
    until = run.plot().get_xlim()[1]
    assert 0.0 < until < 0.2 * run.end_time
    hidden = run.t > until
    assert all(np.ptp(y[hidden]) < 0.01 * np.ptp(y) for y in run.signals.values())
    # Beside a prediction, too, where the report's first page draws it.
    rests = replace(relay_ladder, run=run, signal=next(iter(run.signals)), matched=None, search=None, prediction=None)
    ax = plot_ladder(rests, Figure().add_subplot()).axes[0]
    assert ax.get_xlim()[1] == pytest.approx(until)
    assert ax.get_xlabel() == f"time [s], the same up to {run.end_time:.4g} s"


def test_of_many_signals_those_are_drawn_that_answer_and_the_others_are_named():
    run = replace(trajectory(), signals={f"s{i}": trajectory().signals["theta"] for i in range(6)}, units={})
    figure = run.plot().figure
    assert labels(figure) == ["s0", "s1"]
    assert [text.get_text() for text in figure.axes[-1].texts] == ["Not drawn: s2, s3, s4, s5."]
    assert labels(run.plot(signals=["s4", "s0", "s1", "s2"]).figure) == ["s4", "s0", "s1", "s2"]


def test_long_details_stand_below_the_picture_and_leave_its_panels_their_height():
    short, long = (figure_of_height(3.0) for _ in range(2))
    boxes = []
    for figure, details in ((short, "Nothing else."), (long, "More is known of this. " * 20)):
        ax = figure.add_subplot()
        ax.set_xlabel("time [s]")
        put_verdict(figure, "Oscillates", details, "servo")
        figure.draw_without_rendering()
        boxes.append((ax.get_window_extent().height, ax.get_tightbbox(), figure.artists[-1].get_window_extent()))
    assert boxes[1][0] == pytest.approx(boxes[0][0], rel=0.05)
    assert boxes[0][2].y0 > boxes[0][1].y1 and 0.0 < boxes[1][2].y0 < boxes[1][2].y1 < boxes[1][1].y0
    assert said_above(long) == ("Oscillates", f"servo {'More is known of this. ' * 20}".strip())


def test_a_run_whose_samples_miss_the_peaks_of_its_cycle_is_drawn_with_the_cycle():
    """Samples of one run in fifteen a period, the line drawn against the same run in two hundred."""
    coarse, fine = (
        epp.simulate(epp.case("backlash_servo"), t_end=400.0, t_eval=np.linspace(0.0, 400.0, n)) for n in (1501, 20001)
    )
    t, drawn = coarse.plot(signals=["x"]).lines[0].get_data()
    late = t > 60.0
    np.testing.assert_allclose(drawn[late], np.interp(t[late], fine.t, fine.signals["x"]), atol=0.02)
    assert np.ptp(drawn[late]) == pytest.approx(coarse.limit_cycle.peak_to_peak["x"], rel=1e-3)


@pytest.mark.parametrize("frequency", [10.0, 12.9, 30.0])
def test_a_motion_too_fast_for_the_samples_of_its_run_is_drawn_in_its_full_height(frequency):
    """A pole under a sine, which 6001 samples meet at the same phase or at one that creeps: its height is known."""
    pole = epp.Diagram(
        {"pole": epp.blocks.TransferFunction(num=[1.0], den=[1.0, 1.0]), "limit": epp.Saturation(-9.0, 9.0)},
        connect=["force - pole -> limit", "limit -> pole"],
        inputs=["force"],
    )
    run = epp.simulate(pole, epp.inputs.Sine(1.0, frequency), t_end=600.0)
    assert "beyond all bounds" not in str(run)
    t, drawn = run.plot(signals=["pole"]).lines[0].get_data()
    height = 2.0 / abs(2j * np.pi * frequency + 2.0)
    for late in (t > 300.0, (t > 300.0) & (t < 305.0)):
        assert np.ptp(drawn[late]) == pytest.approx(height, rel=0.03)


@pytest.mark.parametrize("n", [12_001, 50_000, 77_777])
def test_a_curve_of_many_points_keeps_its_extremes_wherever_they_are(n):
    values = np.random.default_rng(n).normal(size=n)
    t = np.linspace(3.0, 5.0, n)
    fewer, kept = _extremes(t, values)
    assert len(fewer) < 13_000
    assert np.all(np.diff(fewer) >= 0.0) and (fewer[0] - 3.0, fewer[-1]) == (pytest.approx(0.0, abs=1e-3), 5.0)
    assert (kept.min(), kept.max()) == (values.min(), values.max())
    np.testing.assert_array_equal(kept, values[np.searchsorted(t, fewer)])


@pytest.mark.parametrize("letters", ["m", "Wm", "0.1006 Hz", "il"])
def test_titles_of_broad_letters_stay_within_the_picture(letters):
    figure = figure_of_height(3.0)
    figure.add_subplot()
    put_verdict(figure, f"{letters} " * 30, f"{letters} " * 40, letters)
    figure.draw_without_rendering()
    for text in (figure._suptitle, figure.artists[-1]):
        box = text.get_window_extent()
        assert 0.0 <= box.x0 < box.x1 <= figure.bbox.x1


def test_a_cycle_that_was_not_reached_does_not_look_like_one_that_exists():
    one = cycle()
    lines = {status: plot_limit_cycle(replace(one, status=status)).axes[0].lines[0] for status in Status}
    known = {(line.get_color(), line.get_linestyle()) for status, line in lines.items() if status.ok}
    not_reached = {(line.get_color(), line.get_linestyle()) for status, line in lines.items() if not status.ok}
    doubtful = plot_limit_cycle(replace(one, error_estimate=np.inf)).axes[0].lines[0]
    assert len(known) == len(not_reached) == 1 and known.isdisjoint(not_reached)
    assert (doubtful.get_color(), doubtful.get_linestyle()) in not_reached


def test_numbers_are_not_parted_from_their_units_where_a_verdict_breaks():
    lines = lines_of("Free of limit cycles below a play gap of 3.789 mm to 14.43 mm, with x 7.011", 52)
    assert len(lines) == 2 and abs(len(lines[0]) - len(lines[1])) < 12
    assert not any(re.search(r"\d$", line) and re.match(r"mm|rad", follow) for line, follow in pairwise(lines))


def test_chosen_signals_keep_their_order():
    assert labels(plot_trajectory(trajectory(), ["voltage"])) == ["voltage [V]"]


def test_a_branch_whose_cycles_grow_without_bound_leaves_the_picture_and_not_the_others_on_its_axis():
    """Sizes 1/(3 - x), up to a million, on x from 0 to 3: at x = 2.7, nine tenths of the way, it is 3.33."""
    x = 3.0 - np.geomspace(3.0, 1e-6, 400)
    y = 1.0 / (3.0 - x)
    points = {"value": x, "stable": np.ones(400, bool), "frequency": 1.0 / y, "x": y}
    branch = epp.Branch("k", "", points, (), Status.CONVERGED, "To the limit.", ("x",), {"x": ""})
    upper, lower = branch.plot(signal="x").figure.axes
    assert upper.get_ylim() == (0.0, pytest.approx(2.0 / 0.3, rel=0.1))
    assert lower.get_ylim()[1] > 3.0


def test_a_cycle_of_a_run_that_closes_to_a_small_error_is_a_smooth_orbit():
    """A sine whose samples end a billionth of a period before they begin again, a thousandth of its size away."""
    time = np.append(np.linspace(0.0, 0.99, 100), 1.0 - 2e-9)
    wave = np.sin(2.0 * np.pi * time) + np.append(np.zeros(100), 1e-3)
    own = replace(
        cycles_of("relay_deadzone")[1], period=1.0, time=time, waveform={"x": wave}, harmonics={"x": [0, -0.5j]}
    )
    search = replace(cycles_of("relay_deadzone"), cycles=(own,))
    phase = search.plot().figure.axes[1]
    x, rate = phase.lines[0].get_data()
    assert np.abs(rate).max() == pytest.approx(2.0 * np.pi, rel=0.05)
    assert np.ptp(x) == pytest.approx(2.0, rel=1e-2)


def test_cycles_that_are_told_apart_have_colours_of_their_own():
    cycle_ = cycles_of("relay_deadzone")[1]
    many = tuple(replace(cycle_, period=cycle_.period * (1.0 + 0.1 * i)) for i in range(4))
    lines = replace(cycles_of("relay_deadzone"), cycles=many).plot().lines
    assert len({line.get_color() for line in lines}) == 4


def test_a_loop_that_no_gain_stands_for_has_no_empty_axes_for_its_margins():
    ax = epp.margins(epp.case("relay_deadzone")).plot()
    assert not ax.axison and not ax.lines and ax.get_legend() is None


def test_unknown_signal_is_one_sentence():
    with pytest.raises(EppError, match="no signal 'thetta'; expected one of theta, voltage"):
        plot_trajectory(trajectory(), ["thetta"])


def test_cycle_without_waveform_is_drawn_from_its_harmonics():
    figure = plot_limit_cycle(cycle())
    time, theta = figure.axes[0].lines[0].get_data()
    np.testing.assert_allclose(theta, np.degrees(0.8 + 0.05 * np.cos(4 * np.pi * np.asarray(time))), atol=1e-12)
    assert labels(figure) == ["theta [deg]", "voltage [V]"]
    assert figure.axes[0].lines[1].get_ydata()[0] == pytest.approx(np.degrees(0.8))
    assert [text.get_text() for text in figure.legends[0].get_texts()] == ["mean", "switch of an element"]


def test_nyquist_marks_every_cycle_where_the_response_has_its_frequency():
    figure = plot_nyquist(prediction())
    ax = figure.axes[0]
    marks = [line for line in ax.lines if line.get_marker() == "o"]
    # At 1 rad/s the response is 5/(j (1 + j)^2) = -2.5, halfway along the locus and on the real axis.
    for mark in marks:
        np.testing.assert_allclose([mark.get_xdata()[0], mark.get_ydata()[0]], [-2.5, 0.0])
    assert [mark.get_markerfacecolor() for mark in marks] == ["none", "#009E73"]
    # Peak to peak as in tables and in all other pictures.
    assert marks[0].get_label() == "1 unstable: 0.1592 Hz, theta 121.5 deg peak to peak"
    assert ax.get_xlim()[0] < -2.5 < ax.get_xlim()[1]


def test_several_elements_are_drawn_as_loop_gain_over_peak_to_peak():
    ax = plot_nyquist(prediction_of_several()).axes[0]
    marks = [(line.get_xdata()[0], line.get_ydata()[0]) for line in ax.lines if line.get_marker() == "o"]
    np.testing.assert_allclose(marks, [(1.238122, 1.0), (3.02427, 1.0)])
    assert ax.get_xlabel() == "peak to peak at the input of play"


def test_nyquist_without_cycles_says_so():
    assert said_above(prediction(0).plot().figure)[0].startswith("The describing function predicts no limit cycle")


def test_nyquist_draws_into_given_axes():
    figure = Figure()
    ax = figure.add_subplot()
    assert plot_nyquist(prediction(), ax) is figure
    assert ax.lines


@pytest.fixture(scope="module")
def relay_ladder() -> epp.Ladder:
    return epp.ladder(epp.case("relay_ideal_khalil79"))


def test_ladder_shows_the_run_the_cycle_and_the_prediction(relay_ladder):
    figure = relay_ladder.plot().figure
    figure.draw_without_rendering()
    run_x, run_y, close_x, close_y, nyquist = figure.axes
    assert labels(figure)[:4] == ["x", "y", "x", "y"]
    np.testing.assert_array_equal(run_x.lines[0].get_ydata(), relay_ladder.run.signals["x"])
    assert nyquist.get_xlabel() == "real part"
    verdict, details = said_above(figure)
    assert verdict == "Oscillates: x 0.4401 peak to peak at 0.2197 Hz"
    # The name is on a line of its own, or before the sentences where they leave it room.
    assert f"{verdict}. {details.removeprefix('relay_ideal_khalil79').lstrip(': ')}" == str(relay_ladder)


def test_predicted_cycle_lies_over_the_simulated_one_in_phase_and_size(relay_ladder):
    ax = plot_ladder(relay_ladder).axes[2]
    simulated, predicted, balanced = (np.asarray(line.get_ydata(), float) for line in ax.lines)
    assert np.ptp(predicted) == pytest.approx(relay_ladder.prediction[0].peak_to_peak["x"], rel=1e-3)
    assert np.ptp(simulated) == pytest.approx(relay_ladder.run.limit_cycle.peak_to_peak["x"], rel=1e-3)
    assert [line.get_label() for line in ax.lines] == ["simulated", "predicted", relay_ladder.balance.method]
    assert relay_ladder.balance.method.startswith("harmonic balance, order ")
    # One period of either is nearly the same sine: their correlation in the middle is close to one.
    n = simulated.size
    middle = slice(n // 3, 2 * n // 3)
    assert np.corrcoef(simulated[middle], predicted[middle])[0, 1] > 0.99
    np.testing.assert_allclose(balanced[middle], simulated[middle], atol=1e-2 * np.ptp(simulated))


def test_angles_are_in_degrees_in_the_ladder():
    ladder = replace(
        epp.ladder(epp.case("relay_ideal_khalil79")),
        signal="theta",
        run=trajectory(Status.SETTLED),
        matched=None,
        search=None,
    )
    figure = plot_ladder(replace(ladder, prediction=prediction()))
    assert labels(figure)[:2] == ["theta\n[deg]", "voltage\n[V]"]
    assert max(figure.axes[0].lines[0].get_ydata()) == pytest.approx(np.degrees(0.85), rel=1e-6)
    # The stable cycle predicted is a band: 3.0012 rad either way of the mean.
    assert len(figure.axes[2].patches) == 1


def test_a_run_that_rests_where_no_cycle_is_known_is_drawn_once_and_whole(relay_ladder):
    rests = replace(relay_ladder, run=trajectory(Status.SETTLED), signal="theta", matched=None, search=None)
    rests = replace(rests, prediction=prediction(0))
    *runs, nyquist = plot_ladder(rests).axes
    assert len(runs) == 2 and nyquist.get_xlabel() == "real part"
    ax = plot_ladder(rests, Figure().add_subplot()).axes[0]
    drawn = ax.lines[0].get_ydata()
    assert ax.get_ylim()[0] < min(drawn) and ax.get_ylim()[1] > max(drawn)


def test_an_axis_of_few_powers_of_ten_has_plain_numbers():
    figure = plot_nyquist(prediction_of_several())
    figure.draw_without_rendering()
    low, high = figure.axes[0].get_ylim()
    texts = {text.get_text() for which in ("major", "minor") for text in figure.axes[0].get_yticklabels(which=which)}
    written = sorted(float(text) for text in texts if text)
    assert len([value for value in written if low <= value <= high]) > 2


def test_ladder_without_prediction_says_so():
    figure = plot_ladder(epp.ladder(of_unknown_response()))
    assert [text.get_text() for text in figure.axes[-1].texts] == ["no describing function"]


NAMED = [Provenance(settings={"system": "my_loop"}), Provenance(case={"case": "my_loop"})]


@pytest.mark.parametrize("facts", NAMED)
def test_titles_name_the_case_or_the_system(facts):
    for result in (trajectory(), cycle(), prediction()):
        assert said_above(replace(result, provenance=facts).plot().figure)[1].startswith("my_loop")


def test_a_name_is_no_formula():
    figure = replace(trajectory(), provenance=Provenance(case={"case": r"a $\frac{$ case"})).plot().figure
    figure.draw_without_rendering()
    assert said_above(figure)[1].startswith(r"a \$\frac{\$ case")


def branch_of(gap: tuple[float, float], frequency: tuple[float, float], unit: str = "") -> epp.Branch:
    """A stable branch of two points of a loop with play."""
    columns = {"value": gap, "period": (4.0, 4.0), "x": (2.0, 4.0), "frequency": frequency}
    points = {name: np.array(values) for name, values in columns.items()} | {"stable": np.array([True, True])}
    return epp.Branch(
        "play.gap",
        unit,
        points,
        (),
        Status.CONVERGED,
        "",
        signals=("x",),
        provenance=Provenance(case={"case": "backlash_servo"}),
    )


def test_a_branch_lists_what_is_drawn_and_is_named():
    figure = branch_of((2.0, 4.0), (0.25, 0.26)).plot().figure
    verdict, details = said_above(figure)
    assert verdict.startswith("Limit cycles exist") and details.startswith("backlash_servo: ")
    assert [text.get_text() for text in figure.axes[0].get_legend().get_texts()] == ["stable"]


def test_rounding_errors_of_a_constant_are_drawn_as_a_flat_line():
    figure = plot_branch(branch_of((2.0, 4.0), (0.25, 0.25 + 1e-14)))
    figure.draw_without_rendering()
    ax = figure.axes[1]
    assert ax.get_ylim() == pytest.approx((0.2375, 0.2625))
    assert ax.yaxis.get_offset_text().get_text() == ""
    # What changes, however little, keeps its axis.
    low, high = plot_branch(branch_of((2.0, 4.0), (0.25, 0.2501))).axes[1].get_ylim()
    assert high - low < 2e-4


def test_a_run_at_rest_is_flat_from_the_begin_on():
    run = trajectory(Status.SETTLED)
    still = {"theta": 0.8 + 1e-15 * np.sin(np.arange(run.t.size)), "voltage": np.zeros(run.t.size)}
    theta, voltage = plot_trajectory(replace(run, signals=still)).axes
    assert np.ptp(theta.get_ylim()) == pytest.approx(0.1 * np.degrees(0.8))
    assert voltage.get_ylim()[0] < 0.0 < voltage.get_ylim()[1]


def test_pictures_leave_the_global_state_alone():
    plot_nyquist(prediction())
    pyplot = sys.modules.get("matplotlib.pyplot")
    assert pyplot is None or not pyplot.get_fignums()


@pytest.mark.parametrize("name", ["backlash_servo", "wheelchair"])
def test_the_curve_of_margins_leaves_the_window_where_the_loop_gain_goes_on(name):
    """Cut off within it, the curve of an integrator looked as if the gain ended there."""
    ax = epp.margins(epp.case(name)).plot()
    curve = ax.lines[0].get_xydata()
    assert np.nanmax(np.abs(curve)) > ax.get_xlim()[1]


@pytest.mark.parametrize("factor", [1.3, 2.6, 4.0])
@pytest.mark.parametrize("unit", mostly_slow([0.021, 1.0, 370.0], [0.021]))
def test_numbers_along_the_peak_to_peak_do_not_run_into_one_another(factor, unit):
    """However little of a power of ten the loop gain covers; two numbers at least, for one tells no scale."""
    found = prediction_of_several()
    branch = dict(found.curves["branches"][0], amplitude=np.geomspace(unit, factor * unit, 200))
    meets = [{"amplitude": unit * factor**share, "omega": 2.0} for share in (0.3, 0.7)]
    figure = plot_nyquist(replace(found, curves={**found.curves, "branches": [branch], "intersections": meets}))
    assert numbers_are_apart(figure.axes[0])


def numbers_are_apart(ax) -> bool:
    """Whether two numbers at least are written along the level axis, and none touches its neighbour."""
    ax.figure.draw_without_rendering()
    boxes = sorted(
        (text.get_window_extent() for text in ax.get_xticklabels(which="both") if text.get_text()), key=lambda b: b.x0
    )
    low, high = ax.bbox.x0 - 1.0, ax.bbox.x1 + 1.0
    boxes = [box for box in boxes if low <= (box.x0 + box.x1) / 2 <= high]
    return len(boxes) >= 2 and all(left.x1 + 4.0 < right.x0 for left, right in pairwise(boxes))


@pytest.mark.parametrize("size", [0.0402, 0.0804, 0.8])
def test_numbers_along_a_small_orbit_do_not_run_into_one_another(size):
    time = np.linspace(0.0, 1.0, 101)
    wave = size * np.cos(2.0 * np.pi * time)
    own = replace(
        cycles_of("relay_deadzone")[1], period=1.0, time=time, waveform={"x": wave}, harmonics={"x": [0, size]}
    )
    figure = replace(cycles_of("relay_deadzone"), cycles=(own,)).plot().figure
    assert all(map(numbers_are_apart, figure.axes))


@pytest.mark.parametrize("residual", [1e-9, 0.05, float("nan")])
def test_a_cycle_that_does_not_close_has_no_stroke_through_its_misfit(residual):
    """Its line breaks where the period begins anew: a stroke would be a jump of a mass."""
    time = np.linspace(0.0, 0.5, 401)
    misfit = 0.0 if residual < 1e-3 else 0.3
    wave = np.cos(4.0 * np.pi * time) + misfit * time / 0.5
    drawn = replace(cycle(), period=0.5, time=time, waveform={"theta": wave}, residual=residual)
    both, values = periods(drawn, "theta")
    x, y, _ = search_picture._turned(drawn, "theta")
    steps = np.abs(np.diff(wave)).max()
    for line in (values, y):
        assert np.nanmax(np.abs(np.diff(line))) <= 1.001 * steps
        assert np.isnan(line).any() == (misfit > 0.0)
    assert np.nanmax(both) == pytest.approx(1.0) and x.size == y.size
