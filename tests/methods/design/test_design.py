"""Designs against independent answers: onsets known from elsewhere, searches on a grid, the fold of a branch."""

from __future__ import annotations

import tomllib
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest

import eppanalysis as epp
from eppanalysis.cli.common import named_range, within_of
from eppanalysis.cli.design import design_columns, values_of, write_design
from eppanalysis.methods.bounds.balanced import BoundProblem
from eppanalysis.methods.bounds.result import Turn
from eppanalysis.methods.design.bound_curve import first_turn
from eppanalysis.methods.design.design import Task, described
from eppanalysis.methods.design.goal import Goal, Sense
from eppanalysis.methods.design.result import Optimum
from eppanalysis.methods.design.shrinking import shrinks
from tests import made_bounds
from tests.shared import said_above

SERVO = """
kind = "diagram"
title = "Position servo with lead and play"
connect = ["-play -> lead", "lead -> plant", "plant -> play"]
[parameters]
k = 2.5
T = 0.5
[blocks]
lead = { kind = "transfer_function", num = ["T", 1], den = ["0.1*T", 1] }
plant = { kind = "transfer_function", num = ["k"], den = [0.2, 1.2, 1, 0] }
[elements]
play = { element = "play", gap = 1.0 }
[run]
t_end = "100 s"
"""
#: Onset of cycles without the lead, as an exact search has it.
ONSET = 2.077624
GAIN = "loop.gain"


@pytest.fixture(scope="module")
def servo() -> epp.Case:
    return epp.case_from_text(SERVO)


@pytest.fixture(scope="module")
def found(servo: epp.Case) -> epp.Design:
    """The best lead, from a cycle at hand; finding one from nothing is what the other tests do."""
    ranges = {"k": (5.0, 8.5), "T": (0.0, 2.0)}
    task = Task(Goal("k", 1.0), "k", ranges, None, {}, False, 0.01, 0, 0)
    frontier = task.frontier(servo, "", [])
    cycles = list(epp.find_limit_cycles(servo.with_values({"T": 1.0, "k": 8.0}), by_balance=False))
    assert frontier.add((1.0,), 8.0, cycles)
    search = task.search(frontier, {})
    best = replace(described(search, task, search.best([(0.98,)])), message="it was not tested.")
    readable = {"k": ("", 1.0), "T": ("", 1.0)}
    return epp.Design("servo", "k", Sense.LARGEST, ranges, best, margin=0.01, readable=readable)


@pytest.fixture(scope="module")
def sought(servo: epp.Case) -> epp.Design:
    """The best lead, from nothing."""
    return epp.design(servo, {"k": (5.0, 20.0), "T": (0.0, 2.0)}, maximise="k", verify=False)


def turn_from(case: epp.Case, low: float, value: float) -> float:
    """The fold below a value of the gain at which there is a cycle."""
    (cycle,) = epp.find_limit_cycles(case.with_values({"k": value}), by_balance=False)
    bound = first_turn(BoundProblem(case, "k", low, value), value, cycle, 1.0)
    assert bound is not None and bound.kind is Turn.FOLD
    return bound.value


def test_without_the_lead_the_turn_is_the_known_onset(servo: epp.Case) -> None:
    assert turn_from(servo.with_values({"T": 0.0}), 1.0, 2.3) == pytest.approx(ONSET, rel=5e-7)


@pytest.mark.slow
def test_the_largest_gain_over_the_lead_is_that_of_a_grid(servo: epp.Case, found: epp.Design) -> None:
    """A per cent above the optimum the exact search finds a cycle to both sides."""
    best = found.optimum.at
    assert best["T"] == pytest.approx(1.0006, abs=1e-3) and best["k"] == pytest.approx(7.5182, rel=1e-4)
    for T in (0.95, 1.05):
        above = servo.with_values({"T": T, "k": 1.01 * best["k"]})
        assert len(epp.find_limit_cycles(above, by_balance=False)) > 0
    # From another cycle, with another step: the same fold.
    assert turn_from(servo.with_values({"T": best["T"]}), 6.0, 7.8) == pytest.approx(best["k"], rel=1e-8)


@pytest.mark.slow
def test_at_an_optimum_inside_its_range_the_other_parameter_has_no_price(found: epp.Design) -> None:
    assert abs(found.optimum.prices["T"]) < 0.05
    # Sizes of cycles scale with the play, gains do not.
    assert abs(found.optimum.prices["play.gap"]) < 1e-6
    assert found.optimum.at_end == ""


@pytest.mark.slow
def test_what_was_not_tested_is_not_called_confirmed(found: epp.Design) -> None:
    assert not found.optimum.confirmed and not found.status.ok
    assert "Not confirmed: it was not tested." in found.sentence
    assert "fold" in found.sentence and "The largest k with no limit cycle is 7.518" in found.sentence


def test_where_no_cycle_limits_a_design_none_is_said_to_be_beyond(found: epp.Design) -> None:
    kept = replace(found.optimum, kind=Turn.UNKNOWN, active="phase margin of 60 deg", confirmed=True, message="")
    sentence = replace(found, optimum=kept).sentence
    assert sentence.endswith("The exact search finds no such cycle there.") and "Confirmed" not in sentence


def test_one_parameter_is_a_bound_that_is_confirmed() -> None:
    case = made_bounds.wheelchair()
    design = epp.design(case, {GAIN: (0.7, 1.0)}, maximise=GAIN, starts=20)
    best = design.optimum
    assert best.kind is Turn.FOLD and best.at[GAIN] == pytest.approx(made_bounds.GAIN, rel=1e-6)
    assert best.confirmed, best.message
    assert design.status.ok and design.values[GAIN] == pytest.approx(0.99 * made_bounds.GAIN, rel=1e-6)
    assert "Confirmed 1 % to both sides" in design.sentence
    ax = design.plot()
    assert [text.get_text() for text in ax.texts] == ["0.7", "1", "0.8462"]  # ends of the range, optimum
    (free,) = [line for line in ax.lines if str(line.get_label()).startswith("no limit cycle")]
    assert list(free.get_xdata()) == pytest.approx([0.0, (made_bounds.GAIN - 0.7) / 0.3])


@pytest.fixture
def coarse(monkeypatch: pytest.MonkeyPatch) -> None:
    """Cycles are looked for at four values of a range, where there is nothing to see between them."""
    for module in ("programme", "design", "search", "bound_curve"):
        monkeypatch.setattr(f"eppanalysis.methods.design.{module}.N_SCAN", 4, raising=False)


def test_a_margin_that_leaves_the_range_is_said(found: epp.Design) -> None:
    """The lead's best gain is 7.518, its design 1 % inside at 7.443."""
    assert "out of its range" not in found.sentence
    narrow = replace(found, tune={**found.tune, "k": (7.5, 8.5)})
    assert "A margin of 1 % takes k to 7.443, out of its range of 7.5 to 8.5." in narrow.sentence


def test_what_is_tunable_stays_so_in_the_design_file(servo: epp.Case, found: epp.Design, tmp_path: Path) -> None:
    marked = epp.case_from_text(SERVO.replace("k = 2.5", 'k = { value = 2.5, mark = "tunable" }'))
    write_design(marked, found, tmp_path / "best.toml")
    kept = tomllib.loads((tmp_path / "best.toml").read_text(encoding="utf-8"))["parameters"]["k"]
    assert kept["mark"] == "tunable" and float(kept["value"]) == pytest.approx(7.443, rel=1e-3)


@pytest.mark.slow
def test_places_that_first_order_does_not_rank_are_asked_before_nothing_is_said_to_be_free(sought: epp.Design) -> None:
    # At T = 0 all of this range cycles, which first order takes for a free one; at T = 1 it is free to 7.518.
    assert sought.optimum.feasible
    assert sought.optimum.at == pytest.approx({"k": 7.518205, "T": 1.0005}, rel=1e-3)


@pytest.mark.slow
def test_where_nothing_is_free_the_range_that_would_have_to_give_is_named() -> None:
    design = epp.design(made_bounds.wheelchair(), {GAIN: (0.9, 1.0)}, maximise=GAIN)
    assert not design.optimum.feasible and design.values == {}
    assert "Move the end of its range at 0.9: cycles vanish at 0.8463" in design.sentence
    assert design.sentence.startswith("No design within these ranges has no limit cycle")


def test_what_no_cycle_limits_is_limited_by_its_own_range(coarse: None) -> None:
    case = made_bounds.wheelchair()
    design = epp.design(case, {GAIN: (0.5, 0.7)}, maximise=GAIN)
    assert design.optimum.kind is Turn.END and design.values == {GAIN: 0.7}
    assert design.optimum.confirmed, design.optimum.message
    assert "Only its own range limits it" in design.sentence


def test_slow_runs_that_shrink_are_told_from_those_on_a_cycle(servo: epp.Case, found: epp.Design) -> None:
    best, x0 = found.optimum.at, np.array([-0.16, 0.11, 0.39, 0.28])
    assert found.optimum.orbit is not None
    inside = servo.with_values({**best, "k": 0.95 * best["k"]})
    beyond = servo.with_values({**best, "k": 1.05 * best["k"]})
    assert shrinks(inside, x0, found.optimum.orbit)
    assert not shrinks(beyond, x0, found.optimum.orbit)


@pytest.mark.slow
def test_a_run_that_shrinks_in_steps_is_told_from_one_on_a_cycle(servo: epp.Case, coarse: None) -> None:
    """With a long lead what is left of a motion stands for more than twice the time between its steps."""
    slow = servo.with_values({"T": 2.0})
    found = epp.design(slow, {"k": (1.0, 20.0)}, maximise="k", starts=60)
    best = found.optimum
    assert best.confirmed and best.n_shrinking > 0 and best.n_settled + best.n_shrinking == 60, best.message
    assert best.orbit is not None
    beyond = slow.with_values({"k": 1.01 * best.at["k"]})
    (stable,) = epp.find_limit_cycles(beyond, by_balance=False).stable
    assert not shrinks(beyond, 1.2 * stable.state, best.orbit)


def test_table_picture_and_files(servo: epp.Case, found: epp.Design, tmp_path: Path) -> None:
    assert "7.518" in str(epp.table(found))
    assert said_above(found.plot().figure)[0].startswith("The largest k")
    front = replace(found, front_over="play.gap", front=((1.0, found.optimum), (2.0, Optimum({}, message="none"))))
    front = replace(front, readable={**found.readable, "play.gap": ("", 1.0)}, front_own=3.0)
    assert front.plot().figure.axes[0].get_xlabel() == "play gap" and "infeasible" in str(epp.table(front))
    assert design_columns(front).columns["k"][1] == found.optimum.at["k"]
    assert front.to_frame()["active"].tolist() == ["fold", "fold", "infeasible"]
    assert front.to_frame()["play.gap"].tolist() == [3.0, 1.0, 2.0] and "3 (own)" in str(epp.table(front))
    write_design(servo, found, tmp_path / "designed.toml")
    again = epp.read_case(tmp_path / "designed.toml")
    assert again.value("k") == pytest.approx(0.99 * found.optimum.at["k"], rel=1e-10)
    assert tomllib.loads(again.to_toml())["blocks"]["lead"]["num"] == ["T", 1]
    assert found.to_dict()["optimum"]["at"] == found.optimum.at


def test_options_are_read() -> None:
    case = epp.case("wheelchair")
    tuned, within = partial(named_range, "--tune", case=case), partial(within_of, case, "play.gap")
    assert tuned("k 1..20") == tuned("k 1:20") == ("k", ("1", "20"))
    assert within("9 mm..15 mm") == within("9 mm:15 mm") == within("± 25 %") == within("± 3 mm") == ("9 mm", "15 mm")
    assert within("+9 mm..15 mm") == ("+9 mm", "15 mm") and within("+- 3 mm") == within("+/- 3 mm") == within("± 3 mm")
    assert tuned("play.gap ± 25 %") == ("play.gap", ("9 mm", "15 mm"))
    assert values_of("play.gap 1, 2") == ("play.gap", ["1", "2"])
    for read, text in ((tuned, "k 1"), (tuned, "play.gap ± x %"), (within, "± x %"), (values_of, "play.gap")):
        with pytest.raises(epp.EppError, match="expected"):
            read(text)


def test_a_free_end_is_the_optimum_though_cycles_exist_at_the_other() -> None:
    """A relay with a dead zone oscillates while its threshold is below 1.59 (5/2 times 2/pi), not above."""
    loop = epp.LureSystem.from_tf(([5.0], [1.0, 2.0, 1.0, 0.0]), epp.RelayDeadZone(threshold=1.0))
    name = "relay_dead_zone.threshold"
    found = epp.design(loop, {name: (1.0, 4.0)}, maximise=name, verify=False)
    assert found.optimum.at == {name: 4.0} and found.optimum.kind == "end"


def test_the_frame_and_the_file_are_one_table_and_name_si_units() -> None:
    at, inside = {"lock_pin.backlash": 0.01}, {"lock_pin.backlash": 0.0099}
    best = Optimum(at, inside, kind=Turn.FOLD, first_order=0.02, frequency=2.0, confirmed=True)
    readable = {"lock_pin.backlash": ("deg", 180 / np.pi)}
    units = {"lock_pin.backlash": "rad"}
    made = epp.Design(
        "elbow",
        "lock_pin.backlash",
        Sense.LARGEST,
        {"lock_pin.backlash": (0.0, 0.1)},
        best,
        readable=readable,
        units=units,
    )
    frame, table = made.to_frame(), design_columns(made)
    assert frame.attrs["units"] == table.units
    assert table.header()[:3] == ["lock_pin.backlash [rad]", "first_order [rad]", "frequency [Hz]"]
    assert table.columns == frame.to_dict("list")
    assert "0.573" in made._repr_html_() and "[deg]" in made._repr_html_()


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"maximise": None}, "expected one of the two"),
        ({"minimise": "T"}, "expected one of the two"),
        ({"maximise": "speed"}, "a known field"),
        ({"tune": {}}, "no parameter is tuned"),
        ({"subject_to": {"phase": 1.0}}, "no measure of the linearised loop"),
        ({"subject_to": {"phase_margin": "45 Hz"}}, "expected an angle"),
        ({"subject_to": {"bandwidth": "3 kg"}}, "expected an angular velocity"),
        ({"tolerances": {"T": "-5 %"}}, "expected one that is not negative"),
        ({"tune": {"k": (2.0, 1.0)}}, "expected low < high"),
        ({"tune": {"k": (1.0, 2.0, 3.0)}}, "expected its low and its high end"),
        ({"tune": {"K": (1.0, 2.0)}, "maximise": "K"}, "a known field"),
        ({"front": {"k": [1.0]}}, "which is tuned"),
        ({"front": {"play.gap": []}}, "no values of play.gap"),
        ({"allow": "plate 3"}, "no signal 'plate'"),
        ({"margin": 0.7}, "margin is 0.7"),
    ],
)
def test_bad_questions_are_refused_in_a_sentence(servo: epp.Case, change: dict[str, object], words: str) -> None:
    asked: dict[str, object] = {"tune": {"k": (1.0, 20.0), "T": (0.0, 2.0)}, "maximise": "k", **change}
    with pytest.raises(epp.EppError, match=words):
        epp.design(servo, **asked)


LAGGING = SERVO.replace("T = 0.5", "T = 0.5\ntau = 0.2").replace("[0.2, 1.2, 1, 0]", '["tau", "1 + tau", 1, 0]')


@pytest.fixture(scope="module")
def lagging() -> epp.Case:
    """The same servo with its second lag as a parameter."""
    return epp.case_from_text(LAGGING)


@pytest.fixture(scope="module")
def tolerant(lagging: epp.Case) -> epp.Design:
    tolerances = {"tau": "10 %", "T": "5 %", "k": "5 %"}
    return epp.design(lagging, {"k": (1.0, 20.0)}, maximise="k", tolerances=tolerances, starts=300)


@pytest.mark.slow
def test_with_tolerances_a_design_holds_at_the_worst_corner(lagging: epp.Case, tolerant: epp.Design) -> None:
    """Its bound is that of the worst of all corners, each found by itself, less its own tolerance."""
    found = tolerant
    corners = {
        (tau, T): epp.design(
            lagging.with_values({"tau": tau, "T": T}), {"k": (1.0, 20.0)}, maximise="k", verify=False
        ).optimum.at["k"]
        for tau in (0.18, 0.22)
        for T in (0.475, 0.525)
    }
    assert min(corners, key=lambda c: corners[c]) == (0.22, 0.475)
    assert found.optimum.at["k"] == pytest.approx(min(corners.values()) / 1.05, rel=1e-6)
    assert found.optimum.off == {"tau": 1.0, "T": -1.0}
    assert found.optimum.confirmed and found.optimum.n_machines == 300, found.optimum.message
    assert "worst corner of the tolerances: tau +10 %, T -5 %, k itself off by 5 %" in found.sentence


@pytest.mark.slow
def test_a_few_per_cent_beyond_a_design_with_tolerances_its_worst_corner_has_a_cycle(
    lagging: epp.Case, tolerant: epp.Design
) -> None:
    beyond = lagging.with_values({"tau": 0.22, "T": 0.475, "k": 1.05 * 1.02 * tolerant.optimum.at["k"]})
    assert len(epp.find_limit_cycles(beyond)) > 0


@pytest.mark.slow
def test_the_lead_is_that_of_an_exact_search_on_a_grid(servo: epp.Case, sought: epp.Design) -> None:
    """To 0.1 %: at each lead of a grid an exact cycle is closed at lower and lower gains, until there is none."""
    best = sought.optimum.at

    def onset(T: float) -> float:
        k = 1.01 * best["k"]
        (cycle,) = epp.find_limit_cycles(servo.with_values({"T": T, "k": k}), by_balance=False)
        while True:
            # Beside its onset the cycle changes so fast that a longer step would lead to one that is not asked for.
            lower = epp.exact_orbit(servo.with_values({"T": T, "k": k / 1.0001}), cycle)
            if not lower.status.ok:
                return k
            k, cycle = k / 1.0001, lower

    on_grid = {T: onset(T) for T in (0.99, best["T"], 1.01)}
    assert on_grid[best["T"]] == pytest.approx(best["k"], rel=1e-3)
    assert max(on_grid.values()) == on_grid[best["T"]]


@pytest.mark.slow
def test_of_three_parameters_the_one_that_only_costs_goes_to_its_end() -> None:
    """The faster the lead's own lag, the more gain: what is left of the three is the design of two at that end."""
    text = SERVO.replace("T = 0.5", "T = 0.5\nlag = 0.1").replace('"0.1*T"', '"lag*T"')
    case = epp.case_from_text(text)
    three = epp.design(
        case, {"k": (1.0, 20.0), "T": (0.5, 2.0), "lag": (0.08, 0.2)}, maximise="k", verify=False
    ).optimum
    two = epp.design(
        case.with_values({"lag": 0.08}), {"k": (1.0, 20.0), "T": (0.5, 2.0)}, maximise="k", verify=False
    ).optimum
    assert three.at["lag"] == pytest.approx(0.08, rel=1e-6) and "lag is at the lower end" in three.at_end
    assert three.at["k"] == pytest.approx(two.at["k"], rel=2e-3)
