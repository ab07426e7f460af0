"""The pages on the paper: what they conclude holds, every statement has its place, and no number is typed by hand."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from matplotlib.colors import to_rgb

import eppanalysis as epp
from studies import DOCS
from studies.paper import figures, runs as made, sensitivity, tables
from studies.paper.says import SAID

pytestmark = pytest.mark.slow

PAGES = sorted((DOCS / "paper").glob("*.md"))
PLACE = re.compile(r"Introduction|Methods|Results|Discussion|Conclusions")


@pytest.fixture(scope="module")
def rows() -> dict[str, tables.Row]:
    return {row.key: row for row in tables.all_rows()}


def test_every_statement_of_the_paper_has_its_place() -> None:
    for said in SAID.values():
        assert PLACE.match(said.place), said
        assert said.text and not said.text.endswith(".")


def test_verdicts_are_those_that_the_pages_speak_of(rows: dict[str, tables.Row]) -> None:
    verdict: dict[str, set[str]] = {}
    for key, row in rows.items():
        verdict.setdefault(row.verdict, set()).add(key)
    assert verdict[tables.DIFFERS] == {"own battery", "drift"}
    assert verdict[tables.PARTLY] == {"four phases", "stops"}
    assert verdict[tables.NO_TEST] == {"loaded speed", "tray full", "quarter"}
    assert len(verdict[tables.AGREES]) == 12


def test_no_difference_has_no_sign() -> None:
    assert [tables._percent(found, 2.0) for found in (2.0, 2.0009, 1.9991)] == ["none"] * 3
    assert [tables._percent(found, 2.0) for found in (2.002, 1.998, 3.0)] == ["+0.1 %", "-0.1 %", "+50.0 %"]


def test_statements_are_shown_once_and_known() -> None:
    keys = [row.key for row in tables.all_rows()]
    assert len(keys) == len(set(keys)) and set(keys) <= set(SAID)


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.stem)
def test_numbers_on_the_pages_are_settings_or_carry_their_place(page: Path) -> None:
    """A number with a unit in a paragraph needs a place of the paper in it; results come from the tables alone."""
    text = re.sub(r"```.*?```|`[^`]*`|\$[^$]*\$", "", page.read_text(encoding="utf-8"), flags=re.DOTALL)
    for paragraph in re.split(r"\n\s*\n|\n(?=\d\. |\* )", text):
        numbers = re.findall(r"\d[\d.]*\s*(?:°|V\b|lbf?\b|ms\b|Hz\b|percent\b|N·m)", paragraph)
        if numbers:
            assert re.search(r"Figure|Methods|Results|Discussion|Introduction", paragraph), (page.name, numbers)


def test_pages_include_tables_and_pictures_that_are_made(tmp_path: Path) -> None:
    used = "\n".join(page.read_text(encoding="utf-8") for page in PAGES)
    pictures = set(re.findall(r"_generated/(paper_\w+)\.png", used))
    assert pictures == {make.__name__ for make in figures.PICTURES}
    included = set(re.findall(r"_generated/paper_(\w+)\.md", used))
    others = {"all", "summary", "equations", "dwell", "assumptions", "together", "pieces"}
    assert included == set(tables.GROUPS) | others


def test_thin_lines_stand_out_from_paper_at_the_width_of_a_column() -> None:
    lines = [line for ax in figures.paper_figure_2().axes for line in ax.get_lines() if line.get_linestyle() == ":"]
    light = [np.dot((0.2126, 0.7152, 0.0722), np.array(to_rgb(line.get_color())) ** 2.2) for line in lines]
    assert lines and all(1.05 / (0.05 + luminance) > 4.5 for luminance in light)
    assert all(line.get_linewidth() >= 1.0 for line in lines)  # thinner ones are greys of half a pixel at 8 cm


def test_equations_one_and_two() -> None:
    large, small = tables.gaps()
    assert large.force == pytest.approx(1.25 * made.LBF, rel=1e-3)
    assert small.force == pytest.approx(0.25 * made.LBF, rel=1e-3)
    assert large.excursion == pytest.approx(0.019 * np.radians(2.5))


@pytest.mark.parametrize(("friction", "kinetic"), [(0.0526, 1.0), (0.1, 1.0), (0.0526, 0.8)])
def test_weight_tray_against_the_balance_of_tensions(friction: float, kinetic: float) -> None:
    """Loading ends between static and kinetic balance; unloading starts at the static one."""
    step = 0.01 * made.LBF
    test = made.tray(friction, kinetic, step)
    top = 5.0 * made.LBF
    gain = epp.case("elbow").elbow_parameters.sensor.gain
    tension = test.highest / gain
    static, least = (1 - friction) / (1 + friction), (1 - kinetic * friction) / (1 + kinetic * friction)
    assert static * (top - step) - 1e-6 <= tension <= least * top * (1 + 1e-6)
    assert test.flat == pytest.approx(top - tension * static, abs=1.01 * step)


def test_ball_bearing_passes_the_tension_on() -> None:
    test = made.tray(0.0, 1.0)
    np.testing.assert_allclose(test.voltage, 2.0 * test.weight / made.LBF, rtol=1e-12)


def test_phases_of_the_stick_slip_explanation_come_in_order() -> None:
    phase = made.paper_slip()
    _, low, high, _ = epp.case("fig6a_original_pulley").elbow_parameters.bands.thresholds
    assert phase.sticks < phase.slips < phase.extension
    assert phase.held > high and phase.behind > 0
    # It breaks away where the difference of the tensions is the static friction, and falls to the kinetic one.
    pulley = epp.case("fig6a_original_pulley").elbow_parameters.pulley
    harness = phase.held - phase.behind
    assert phase.behind == pytest.approx(pulley.load_friction * (phase.held + harness), rel=1e-6)
    result = made.run("fig6a_original_pulley", t_end=1.0)
    stuck = (result.t > phase.sticks) & (result.t < phase.slips)
    assert np.ptp(result.signals["sensor_force"][stuck]) < 1e-9
    assert result.signals["sensor_force"][np.searchsorted(result.t, phase.extension)] < low


def test_conclusions_on_slip_and_parking_hold_for_all_variations() -> None:
    count, total = sensitivity.slips_that_reverse()
    assert count == 0 and total == len(sensitivity.FACTORS) * len(sensitivity.one_at_a_time("fig6a_original_pulley"))
    shortest_period = 0.1
    assert 0 < sensitivity.longest_fall() < 0.1 * shortest_period


def test_cycles_end_where_the_page_says() -> None:
    """Runs started from the step on either side of a boundary; the exact cycle ends between the paper's two gaps."""
    gap = made.stable_limit(made.gap_branch())
    assert np.radians(0.5) < gap < np.radians(2.5)
    for factor, word in ((0.97, "settles"), (1.03, "oscillates")):
        run = made.run("fig8a_original", ("lock_pin.backlash", factor * gap), t_end=12.0)
        assert made.outcome(run) == word
    friction = made.stable_limit(made.friction_branch())
    assert made.outcome(made.run("fig6a_original_pulley", ("pulley.friction", 0.9 * friction))) == "settles"
    assert 0 < friction < epp.case("elbow").value("pulley.friction")


def test_findings_that_flip_are_those_that_the_page_names() -> None:
    flips = {
        (i + 1, name)
        for i, finding in enumerate(sensitivity.FINDINGS)
        for name in sensitivity.assumed()
        if tables.flips_at(finding, name)
    }
    assert flips == {(3, "lock_pin.stiffness"), (5, "lock_pin.stiffness"), (1, "bands.range"), (7, "bands.range")}
    assert tables.flips_at("fig6b_ball_bearing", "lock_pin.stiffness")[0].startswith("-")
    assert tables.flips_at("gain_brings_it_back", "lock_pin.stiffness") == ["+50 %"]
    assert tables.flips_at("fig8a_original", "bands.range") == ["+50 %"]
    assert tables.flips_at("light_forearm", "bands.range") == ["-50 %"]


def test_findings_hold_together_as_the_page_says() -> None:
    for finding in sensitivity.FINDINGS:
        want = epp.case(finding).expected.outcome
        near, far = (sensitivity.all_at_once(finding, s).count(want) / sensitivity.SAMPLES for s in sensitivity.SPREADS)
        assert near > 0.9 and far > 0.6


def test_variation_keeps_what_the_paper_gives() -> None:
    case = epp.case("fig8a_original")
    wider = case.with_values(sensitivity.varied(case, "pulley.radius", 1.5))
    assert wider.value("pulley.radius") * wider.value("cable.stiffness") == pytest.approx(
        case.value("pulley.radius") * case.value("cable.stiffness")
    )
    heavier = case.with_values(sensitivity.varied(case, "forearm.shell_inertia", 1.5))
    assert heavier.value("forearm.inertia") == pytest.approx(0.0465 + 0.003)


@pytest.mark.parametrize("finding", sensitivity.FINDINGS)
def test_what_cannot_go_up_by_half_is_named_on_the_page(finding: str) -> None:
    case, page = epp.case(finding), (DOCS / "paper" / "assumptions.md").read_text(encoding="utf-8")
    for name in sensitivity.assumed():
        for factor in sensitivity.FACTORS:
            if sensitivity.varied(case, name, factor)[name] != pytest.approx(factor * case.value(name)):
                most = sensitivity.varied(case, name, factor)[name] / case.value(name) - 1.0
                told = re.search(rf"`{name}` goes up by (\d+) per cent only", " ".join(page.split()))
                assert told and 100.0 * most == pytest.approx(float(told[1]))


def test_pieces_put_in_flip_what_the_page_says() -> None:
    flips = {
        piece.text: {
            i + 1
            for i, finding in enumerate(sensitivity.FINDINGS)
            if sensitivity.with_piece(finding, number) != epp.case(finding).expected.outcome
        }
        for number, piece in enumerate(sensitivity.PIECES)
        if "bit" not in piece.text  # the modes of a converter take long to make
    }
    assert flips == {
        "sensor filter of 2 ms": {5},
        "controller sampled every 1 ms": set(),
        "controller sampled every 5 ms": {5},
        "parking logic, dwell time 0.5 s": set(),
        "step in the other direction": {7},
    }


def test_parking_ends_the_oscillation_at_full_amplitude() -> None:
    """It parks in a fall of the force through the band, the oscillation before is as large as those before it."""
    case = epp.case("parking_stops_it")
    stopped = made.run(case.name, t_end=4.0)
    going = made.run(case.name, ("parking.dwell_time", 10.0), t_end=6.0)
    assert made.outcome(stopped) == "settles" and made.outcome(going) == "oscillates"
    dwell = case.value("parking.dwell_time")
    falls = made.falls_through_parking(stopped)[:, 1]
    assert np.all(falls[:-1] < dwell) and falls[-1] == pytest.approx(dwell)
    parks = next(e.time for e in reversed(stopped.events) if e.name == "parks")
    before = (stopped.t > parks - 0.4) & (stopped.t < parks)
    peak_to_peak = going.limit_cycle.peak_to_peak["theta"]
    assert np.ptp(stopped.signals["theta"][before]) == pytest.approx(peak_to_peak, rel=0.02)


@pytest.mark.parametrize("name", ["fig8a_original", "gain_brings_it_back"])
def test_longest_dwell_time_that_parks_a_cycle(name: str) -> None:
    """A dwell time a little shorter than the fall through the band ends the oscillation, a longer one does not."""
    falls = made.falls_through_parking(made.run(name, ("parking.dwell_time", 10.0), t_end=6.0))[-5:, 1]
    fall = falls.max()
    assert made.outcome(made.run(name, ("parking.dwell_time", 0.97 * fall))) == "settles"
    first = made.falls_through_parking(made.run(name, ("parking.dwell_time", 10.0), t_end=6.0))[:, 1].max()
    assert made.outcome(made.run(name, ("parking.dwell_time", 1.03 * first))) == "oscillates"
