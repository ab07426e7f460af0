"""Every result says its sentence, shows its table and its picture, and a notebook gets all three."""

from __future__ import annotations

import html
import importlib
import inspect
import pickle
import pkgutil
import re
from dataclasses import replace
from functools import cache

import numpy as np
import pandas
import pytest
from hypothesis import given, strategies as st
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.text import Text

import eppanalysis as epp
from eppanalysis.cases import shipped_cases_folder
from eppanalysis.guides.result import GuideRow
from eppanalysis.methods.bounds.result import BoundCell, Finding, Turn
from eppanalysis.methods.bounds.tolerances.result import Quantile
from eppanalysis.methods.design.goal import Sense
from eppanalysis.methods.design.result import Optimum
from eppanalysis.methods.dither.runs import DitherRun, Start
from eppanalysis.methods.search.basin import Basin
from eppanalysis.methods.simulation.batch import BatchResult
from eppanalysis.plotting import SMALL, WIDTH
from eppanalysis.readable import number, readable
from eppanalysis.results import Result, Status
from eppanalysis.results.provenance import Provenance
from eppanalysis.shown import Shown, for_people, frame_of
from tests.made_bounds import bounds_of
from tests.shared import cycles_of, mostly_slow, touching
from tests.synthetic import cycle, prediction, trajectory
from tests.wrong_arguments import doors


def result_classes() -> set[type]:
    """All classes of results and of measured responses in the package, but for those that others are built on."""
    for module in pkgutil.walk_packages(epp.__path__, "eppanalysis."):
        if not re.search(r"__main__|\.engine\.|\.explorer|\.report", module.name):
            importlib.import_module(module.name)

    def below(kind: type) -> set[type]:
        return {kind}.union(*(below(sub) for sub in kind.__subclasses__()))

    return {kind for kind in below(Shown) if "__dataclass_params__" in vars(kind)} - {Result}


@cache
def examples() -> dict[type, Result]:
    """One result of each class: made by hand, or what the public function that makes it gives for usual arguments."""
    two = np.array([[0.002, 1.0], [0.003, 2.0], [np.nan, np.nan]])
    units = {"play.gap": "m", "loop.gain": ""}
    case = epp.case("fig8a_original")
    found = [
        cycle(),
        trajectory(),
        prediction(),
        cycles_of("relay_deadzone"),
        epp.Trigger("theta", 0.01, 0.00999, 0.01001, 0.02, unit="rad"),
        Basin(np.array([[0.0, 1.0], [1.0, 1.0], [2.0, 3.0]]), np.array([-1, 0, 0])),
        epp.ladder(epp.case("relay_ideal_khalil79")),
        wheelchair_branch(),
        epp.FoldCurve(("play.gap", "loop.gain"), two[:2], np.ones(2), np.ones(2), Status.CONVERGED, "All.", units),
        frozen(),
        made_bounds(case),
        epp.ToleranceBound(
            "lock_pin.backlash", "rad", readable("rad"), 1.0, {"cable.stiffness": 10.0}, 0.015, 0.012, {}, 4,
            (Quantile(0.95, 0.013, 0.0125, 0.0133),), np.linspace(0.012, 0.017, 50), 0.0,
        ),
        BatchResult(
            (Status.LIMIT_CYCLE, Status.SETTLED), np.array([2.0, np.nan]), {"x": np.zeros(2)},
            {"x": np.array([0.5, 0.0])}, {"x": np.array([0.2, 0.0])}, np.array([9, 1]), np.ones(2), np.full(2, np.nan),
        ),
        epp.Boundary(("play.gap", "loop.gain"), two, "exact fold", Status.CONVERGED, "By hand.", units),
        identification(),
        identification().fits[0],
        diagnosis(),
        made_guide(case),
        made_design(),
        made_dither(),
        measured_cycle(),
        lag(),
        epp.MeasuredMatrix([[None, lag(0.01)], [lag(), lag()]], name="plate"),
    ]  # fmt: skip
    made: dict[type, Result] = {type(result): result for result in found}
    for door in doors():
        kind = getattr(epp, str(inspect.signature(door.call).return_annotation).partition(" | ")[0], None)
        if inspect.isfunction(door.call) and kind in result_classes() and kind not in made:
            made[kind] = door.call(**door.good)
    return made


def lag(deviation: float | None = None) -> epp.MeasuredResponse:
    omega = np.geomspace(0.1, 10.0, 31)
    return epp.MeasuredResponse(omega, 2.0 / (1.0 + 1j * omega), deviation, static_gain=2.0, name="lag")


def measured_cycle() -> epp.MeasuredCycle:
    omega = np.geomspace(0.01, 100.0, 400)
    s = 1j * omega
    response = epp.MeasuredResponse(omega, 1.0 / (s * (s + 1.0) * (s + 2.0)))
    return epp.predict_limit_cycles(epp.MeasuredLoop(response, epp.Relay()))[0]


def made_dither() -> epp.Dither:
    runs = (DitherRun(0.1, Start.CYCLE, 0.9, 40.0, False), DitherRun(0.11, Start.CYCLE, 0.01, 80.0, True))
    return epp.Dither(
        "relay", epp.Relay(), "sine", 4.0, 0.11, 0.1, 0.106, 0.42, cycle(), 0.001, np.array([[0.1, 0.2], [0.11, 0.0]]),
        runs, Status.CONVERGED,
    )  # fmt: skip


def made_design() -> epp.Design:
    rows = np.array([[0.0, 2.0776], [1.0, 7.518], [2.0, 5.1]])
    best = Optimum(
        {"k": 7.518, "T": 1.0}, {"k": 7.443, "T": 1.0}, Turn.FOLD, first_order=8.36, frequency=0.62, confirmed=True,
        n_runs=100, n_settled=100, evaluated=rows,
    )  # fmt: skip
    readable = {"k": ("", 1.0), "T": ("s", 1.0)}
    tune = {"k": (1.0, 10.0), "T": (0.0, 2.0)}
    return epp.Design("servo", "k", Sense.LARGEST, tune, best, margin=0.01, readable=readable)


@cache
def wheelchair_branch() -> epp.Branch:
    return epp.continue_branch(epp.case("wheelchair"), "play.gap", start=0.012, stop=0.004)


@cache
def identification() -> epp.Identification:
    tray = shipped_cases_folder() / "measured" / "weight_tray.csv"
    return epp.identify(epp.case("elbow"), tray=tray)


def diagnosis() -> epp.Diagnosis:
    loop = epp.LureSystem.from_tf(([5.0], [1.0, 1.0, 0.0]), epp.Play(gap=2.0))
    t = np.linspace(0.0, 40.0, 800)
    swing = np.sin(0.9 * t) + 0.02 * np.random.default_rng(1).normal(size=t.size)
    return epp.diagnose(loop, {"time": t, "x": swing})


def frozen() -> epp.FrozenLoop:
    case = epp.case("sat_plus_backlash")
    return epp.frozen_nyquist(case, epp.predict_limit_cycles(case)[0])


def made_bounds(case: epp.Case) -> epp.DesignBounds:
    gains = (9.0, 12.0)
    cells = [
        BoundCell(value=gain, finding=Finding.BOUND, first_order=0.02, exact=bound, verified=True)
        for gain, bound in zip(gains, (0.012, 0.0151), strict=True)
    ]
    return bounds_of(case, "bands.range", "lock_pin.backlash", *cells)


PAIR = ("bands.range", "lock_pin.backlash")


def made_guide(case: epp.Case) -> epp.Guide:
    bounds = made_bounds(case)
    rows = [
        GuideRow({"bands.range": c.value}, c, c.bound, 0.02 * c.bound, 80.0 * c.bound, None, 0.03, 0.04, 0.001)
        for c in bounds
    ]
    return epp.Guide(
        case,
        "bands.range",
        "lock_pin.backlash",
        (),
        tuple(rows),
        {},
        provenance=Provenance("guide", case=case.provenance()),
    )


def test_every_class_of_results_has_an_example():
    assert result_classes() == set(examples())


@pytest.fixture(params=sorted(result_classes(), key=lambda kind: kind.__name__), ids=lambda kind: kind.__name__)
def result(request) -> Result:
    return examples()[request.param]


def test_sentence_has_a_number_and_no_names_of_classes(result):
    sentence = str(result)
    assert re.search(r"\d", sentence) and sentence.endswith((".", ")"))
    assert sentence[0].isupper() or sentence[0].isdigit()
    assert not re.search(r"[<>]|array|nan|None|\b[A-Z][a-z]+[A-Z]|_", sentence), sentence
    assert repr(result).startswith(sentence)
    # No number has more digits than people write.
    assert all(len(digits.replace(".", "").lstrip("0")) <= 4 for digits in re.findall(r"\d+\.\d+", sentence)), sentence


def test_table_is_a_frame_whose_units_are_of_its_columns(result):
    frame = result.to_frame()
    assert isinstance(frame, pandas.DataFrame) and len(frame)
    assert set(frame.attrs.get("units", {})) <= set(frame.columns)
    brief = for_people(result.in_brief())
    assert 0 < len(brief) <= 13 and len(brief.columns) <= 12
    cells = brief.to_numpy().ravel()
    assert all(isinstance(cell, str) for cell in cells)
    # Nothing as the program holds it: no lists, no complex numbers, no probabilities that nobody reads.
    assert not [cell for cell in cells if re.search(r"^\[|\dj$|e-\d{3}", cell)]
    assert not [name for name in brief.columns if "omega" in name and "deg" in name]
    assert str(epp.table(result)).strip()


def test_picture_comes_back_as_axes_given_or_its_own_and_is_read_at_8_cm(result):
    given = Figure().add_subplot()
    assert result.plot(given) is given
    assert given.lines or given.patches or given.collections
    assert not given.figure.legends  # which others that are drawn beside it have, too
    own = result.plot()
    assert isinstance(own, Axes) and own is own.figure.axes[0] and own is not given
    assert_readable(own.figure)


def assert_readable(figure: Figure) -> None:
    """It is read at 8 cm, and nothing of it is cut off or covered."""
    figure.draw_without_rendering()
    assert figure.get_figwidth() == WIDTH and SMALL * 8.0 / 2.54 >= 6.0 * WIDTH
    assert all(text.get_fontsize() >= SMALL for text in figure.findobj(Text) if text.get_text() and text.get_visible())
    drawn, whole = figure.get_tightbbox(), figure.bbox_inches
    assert drawn.x0 >= -0.02 and drawn.x1 <= whole.x1 + 0.02 and drawn.y0 >= -0.02 and drawn.y1 <= whole.y1 + 0.02
    legends = [*figure.legends, *(ax.get_legend() for ax in figure.axes if ax.get_legend())]
    boxes = [legend.get_window_extent().padded(-2.0) for legend in legends]
    assert not any(box.overlaps(ax.bbox) for box in boxes for ax in figure.axes)
    assert not list(touching(figure))


def test_a_notebook_shows_axes_as_their_whole_figure():
    axes = trajectory().plot()
    assert axes._repr_png_().startswith(b"\x89PNG") and len(axes.figure.axes) == 2
    assert len(pickle.dumps(axes.figure)) > 0


@pytest.mark.parametrize(
    "kind",
    mostly_slow(
        sorted(result_classes(), key=lambda kind: kind.__name__),
        [epp.Trajectory, epp.CycleSearch, epp.DesignBounds, epp.Ladder, Basin, epp.MeasuredMatrix],
    ),
    ids=lambda kind: kind.__name__,
)
def test_notebook_shows_sentence_table_picture_and_origin(kind):
    result = examples()[kind]
    page = result._repr_html_()
    assert f"<strong>{html.escape(str(result))}</strong>" in page
    assert "<table" in page and 'src="data:image/png;base64,iVBOR' in page and "<details>" in page
    names = for_people(result.in_brief()).columns
    assert all(html.escape(str(name)) in page for name in names)


def test_texts_of_a_case_stay_texts():
    provenance = Provenance("run", {"system": "<script>alert(1)</script>"})
    page = epp.LimitCycle("<b>x</b>", Status.CONVERGED, 1.0, {}, {}, {}, provenance=provenance)._repr_html_()
    assert "<script" not in page and "<b>" not in page and "&lt;script&gt;" in page


SENTENCES = {
    "fig8a_original": "Oscillates: theta 4.394 deg peak to peak at 8.974 Hz, from 0.8618 s on.",
    "fig8b_reduced_backlash": "Settles at rest: theta at 60.59 deg, from 0.677 s on.",
    "relay_deadzone": "Oscillates: x 6.072 peak to peak at 0.158 Hz, from 25.07 s on.",
}
PREDICTED = {
    "fig8a_original": "The describing function predicts 2 limit cycles, "
    "the stable one with theta 4.291 deg peak to peak at 10.61 Hz. "
    "Cycles between the points of its grid may be missed.",
    "band_two_cycles": "The describing function predicts 2 limit cycles, "
    "the stable one with x 9.847 peak to peak at 0.2757 Hz.",
}


@pytest.mark.parametrize(("name", "sentence"), SENTENCES.items())
def test_what_a_run_of_a_shipped_case_says(name, sentence):
    case = epp.case(name)
    run = epp.simulate(case)
    assert str(run) == sentence
    if run.limit_cycle is not None:
        signal = next(iter(run.signals))
        span = run.limit_cycle.peak_to_peak[signal] * (180.0 / np.pi if signal == "theta" else 1.0)
        assert f"{signal} {span:.4g} " in sentence and f"at {run.limit_cycle.frequency:.4g} Hz" in sentence


@pytest.mark.parametrize(("name", "sentence"), PREDICTED.items())
def test_what_a_prediction_of_a_shipped_case_says(name, sentence):
    assert str(epp.predict_limit_cycles(epp.case(name))) == sentence


def test_no_cycle_is_said_with_the_margin_that_is_left():
    found = epp.predict_limit_cycles(epp.case("fig8b_reduced_backlash"))
    margin = found.margins["gain_margin"]
    assert str(found) == (
        f"The describing function predicts no limit cycle; the gain margin of the linearised loop is {margin:.4g}. "
        "Cycles between the points of its grid may be missed."
    )


@pytest.mark.parametrize("name", ["backlash_servo_unseen", "pid_hunting", "fig8b_reduced_backlash"])
def test_the_verdict_that_there_is_no_cycle_says_where_first_order_may_miss_one(name):
    """In large letters stood "no limit cycle", and in small ones below them that there is one."""
    found = epp.predict_limit_cycles(epp.case(name))
    assert not len(found) and found.headline().startswith("The describing function predicts no limit cycle")
    assert found.headline().endswith("may miss one") == bool(found.warnings)


@pytest.mark.parametrize(
    ("plant", "border"),
    [
        (([4.0], [1.0, 3.0, 0.0, 0.0]), ""),  # s**3 + 3 s**2 + 4 k, by Routh at no k
        (([0.5], [1.0, -1.0]), ", and on the border of stability at 2 times its gain"),
    ],
)
def test_an_unstable_loop_without_a_cycle_is_not_told_by_its_margin_alone(plant, border):
    found = epp.predict_limit_cycles(epp.LureSystem.from_tf(plant, epp.Saturation()))
    assert str(found) == f"The describing function predicts no limit cycle; the linearised loop is unstable{border}."


def test_a_continuum_of_cycles_is_said():
    """x'' = -sgn(x), whose swings keep their energy."""
    found = epp.find_limit_cycles(epp.LureSystem.from_tf(([1.0], [1.0, 0.0, 0.0]), epp.Relay()))
    assert found.n_continua == len(found) == 1
    assert "It is one of a continuum of cycles, between which a disturbance may move the loop." in str(found)


def test_what_first_order_misses_is_said():
    found = epp.ladder(epp.case("backlash_servo_unseen"))
    assert str(found).startswith(
        "Oscillates: x 2.679 peak to peak at 0.1316 Hz. The exact search finds this limit cycle and no other. "
    )
    assert str(found).endswith("The describing function misses the stable limit cycle.")


def test_a_search_says_whether_the_start_decides():
    assert str(examples()[epp.CycleSearch]) == (
        "Can oscillate: 2 limit cycles, the stable one with x 6.072 peak to peak at 0.158 Hz. "
        "Other starts settle at rest."
    )


def test_what_does_not_count_as_an_answer_says_so():
    run = trajectory(Status.UNDECIDED)
    assert str(run) == f"Undecided after 2 s: {Status.UNDECIDED.value}"
    doubtful = replace(cycle(), error_estimate=np.inf)
    assert "may not exist" in str(doubtful)
    both = str(replace(prediction(), cycles=(cycle(), doubtful)))
    assert (
        both.startswith("The describing function predicts 1 stable limit cycle with")
        and ", and 1 more that may not exist." in both
    )
    alone = str(replace(prediction(), cycles=(doubtful, doubtful)))
    assert alone.startswith(
        "The describing function predicts 2 stable limit cycles that may not exist, the largest with"
    )


def test_a_search_without_a_stable_cycle_claims_none():
    search = examples()[epp.CycleSearch]
    unstable = replace(search, cycles=search.unstable)
    assert str(unstable).startswith("No stable limit cycle was found: 1 unstable limit cycle with x 2.066 peak to peak")
    unknown = replace(search, cycles=(replace(search[0], stable=None, multipliers=None),))
    assert str(unknown).startswith("Limit cycles of unknown stability exist: 1 limit cycle with x 2.066 peak to peak")
    none = replace(search, cycles=(), n_runs=40)
    assert str(none) == "No limit cycle was found: all runs settle at rest."
    undecided = replace(none, left_open=("2 runs neither settled nor repeated themselves",), status=Status.UNDECIDED)
    assert str(undecided).startswith(
        "Undecided: no limit cycle was found, some starts settle at rest. The search leaves"
    )
    nothing = replace(undecided, settles=False)
    assert str(nothing).startswith("Undecided: no limit cycle was found. The search leaves")
    both = replace(none, diverges=True)
    assert str(both) == "No limit cycle was found: some starts settle at rest and some grow without bound."


EMPTY = {
    epp.Trajectory: {"t": np.zeros(0), "signals": {}, "limit_cycle": None, "status": Status.UNDECIDED},
    epp.CycleSearch: {"cycles": ()},
    epp.Prediction: {"cycles": (), "curves": {"kind": "residual"}},
    epp.DesignBounds: {"cells": (BoundCell(9.0, Finding.SCALES),)},
    epp.Guide: {"rows": ()},
    epp.ForcedResponse: {"responses": ()},
    epp.Boundary: {"points": np.full((1, 2), np.nan)},
    Basin: {"starts": np.zeros((0, 2)), "ends": np.zeros(0, int)},
    BatchResult: {"status": (), "period": np.zeros(0), "peak_to_peak": {}, "mean": {}},
}


@pytest.mark.parametrize("kind", EMPTY, ids=lambda kind: kind.__name__)
def test_a_result_that_holds_nothing_shows_itself_too(kind):
    empty = replace(examples()[kind], **EMPTY[kind])
    assert str(empty) in repr(empty) and "nan" not in str(empty)
    page = empty._repr_html_()
    assert "base64" in page or "No picture: " in page


def test_responses_of_which_there_are_none_are_drawn_as_a_sentence():
    """The command refused them with an empty list of signals."""
    none = replace(examples()[epp.ForcedResponse], responses=())
    assert [text.get_text() for text in none.plot(signals=["x"]).texts] == ["There is no response to draw."]


def test_a_long_table_is_cut_in_the_middle():
    shown = for_people(frame_of([{"play.gap": 1e-3 * i} for i in range(100)], {"play.gap": "m"}))
    assert shown["play gap [mm]"].tolist() == [*"012345", "...", *["94", "95", "96", "97", "98", "99"]]


@given(st.floats(-1e300, 1e300), st.integers(1, 6))
def test_a_number_in_a_sentence_is_the_value_to_its_digits(value, digits):
    assert float(number(value, digits)) == pytest.approx(value, rel=0.5 * 10.0 ** (1 - digits), abs=1e-307)


@pytest.mark.parametrize("gain", [1.0, 60.0])
def test_a_run_that_starts_at_rest_is_not_said_to_settle(gain):
    """At the greater gain that rest is unstable: the run alone cannot tell, and does not pretend to."""
    loop = epp.LureSystem.from_tf(([gain], [1.0, 3.0, 2.0, 0.0]), epp.Saturation(), x0=[0.0, 0.0, 0.0])
    sentence = "Rests where it starts: x at 0; other starts may oscillate."
    assert str(epp.simulate(loop, t_end=20.0)) == sentence
    moved = epp.simulate(replace(loop, x0=np.full(3, 1e-3)), t_end=400.0)
    assert str(moved).startswith("Settles at rest: x at" if gain < 6.0 else "Oscillates: x ")


@pytest.mark.parametrize(("plant", "decided"), [([1.0, 0.0, 0.0], False), ([1.0, 0.1, 0.0], True)])
def test_no_gain_margin_is_told_of_a_loop_on_the_border_of_stability(plant, decided):
    sentence = str(epp.predict_limit_cycles(epp.LureSystem.from_tf(([0.5], plant), epp.DeadZone())))
    assert ("the stability of the linearised loop is undecided" in sentence) is not decided
    assert ("gain margin" in sentence) is decided


def test_of_a_signal_that_all_but_stands_still_the_one_that_moves_is_named_too():
    """A motor hunts within the gap of its gear; nothing is said of other units, nor of what a gear's ratio makes."""
    units = {"load": "rad", "motor": "rad", "voltage": "V"}
    hunting = replace(cycle(), units=units, mean={}, harmonics={}, peak_to_peak=dict.fromkeys(units, 5e-7))
    spoken = (
        (3e-3, r"load \S+ deg but motor 0\.1719 deg peak to peak at 2 Hz"),
        (8e-5, r"load \S+ deg peak .*"),
    )
    for motor, told in spoken:
        found = replace(hunting, peak_to_peak={"load": 5e-7, "motor": motor, "voltage": 9.0})
        assert re.fullmatch(told, found.size), found.size
        assert re.fullmatch(r"motor \S+ deg peak to peak at 2 Hz", found.size_of("motor"))
    bare = replace(hunting, units={}, peak_to_peak={"x": 1e-6, "y": 2.0})
    assert "but" not in bare.size
