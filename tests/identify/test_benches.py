"""Bench tests with known truth: intervals hold it, and what the data cannot identify is named."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import replace
from functools import partial

import numpy as np
import pytest

import eppanalysis as epp
from eppanalysis.cases import shipped_cases_folder
from eppanalysis.identify.estimate import BenchFit
from eppanalysis.identify.step import DEFAULT
from tests import benches
from tests.benches import BenchRun, Outcome, collect, run_all
from tests.reference.benches import Bench, backlash_cycling, step_response, weight_tray

LBF = 4.4482216152605


def identify(bench: Bench, tmp_path, test: str, **options) -> BenchFit:
    path = bench.write(tmp_path / f"{test}.csv")
    base = epp.case("fig8a_original").with_values({k: v for k, v in bench.setting.items() if "." in k})
    return epp.identify(base, press=bench.setting.get("press", 0.0), **{test: path}, **options).fits[0]


def coverage(benches, tmp_path, test: str) -> dict[str, float]:
    hits: dict[str, list[bool]] = defaultdict(list)
    for bench in benches:
        fit = identify(bench, tmp_path, test)
        for name, value in bench.truth.items():
            found = [e for e in fit.estimates if e.name == name]
            hits[name] += [e.low <= value <= e.high for e in found]
    return {name: float(np.mean(h)) for name, h in hits.items()}


@pytest.mark.slow
def test_weight_tray_intervals_cover(tmp_path):
    found = coverage([weight_tray(seed) for seed in range(100, 110)], tmp_path, "tray")
    assert set(found) == {"pulley.friction", "pulley.kinetic_ratio", "sensor.gain", "sensor.full_scale"}
    assert min(found.values()) >= 0.8  # 95 % each; of 10 benches, 3 misses or more are one case in a hundred


@pytest.mark.slow
def test_backlash_intervals_cover(tmp_path):
    found = coverage([backlash_cycling(seed) for seed in range(100, 130)], tmp_path, "backlash")
    assert set(found) == {"lock_pin.backlash", "lock_pin.stiffness", "cable.stiffness", "K R"}
    assert min(found.values()) >= 0.83


@pytest.mark.slow
def test_step_response_intervals_cover(monkeypatch):
    """At 95 % for each parameter, two misses or more of two benches are one case in 400; at 80 %, one in 25."""
    monkeypatch.setitem(benches.MAKERS, "step", partial(step_response, t_end=1.0))
    runs = list(run_all("step", range(300, 302), 1))
    assert not [r.refusal for r in runs if r.refusal]
    held: dict[str, list[bool]] = defaultdict(list)
    for outcome in (o for r in runs for o in r.outcomes):
        held[outcome.name].append(outcome.held)
    assert set(held) == {*DEFAULT, "lock_pin.backlash", "cable.stiffness"}
    assert max(h.count(False) for h in held.values()) <= 1
    assert all(r.limited_by in held for r in runs)


def test_a_log_of_benches_is_gone_on_with(tmp_path, monkeypatch):
    """What was cut off is run again, what is there is not."""
    log, asked = tmp_path / "benches.jsonl", []

    def few(test, seeds, workers):
        asked.append(list(seeds))
        yield from (BenchRun(test, seed, (Outcome(test, seed, "a", True, True, 0.1),), notes=("n",)) for seed in seeds)

    monkeypatch.setattr(benches, "run_all", few)
    first = collect("step", range(3), 1, log)
    log.write_text(log.read_text()[:-20])
    assert collect("step", range(5), 1, log) == [*first, *few("step", [3, 4], 1)]
    assert collect("tray", range(1), 1, log)[0].test == "tray"
    assert asked[:2] == [[0, 1, 2], [2, 3, 4]]


@pytest.mark.slow
def test_ball_bearing_shows_no_friction(tmp_path):
    fit = identify(weight_tray(0, bearing=True), tmp_path, "tray")
    friction = fit["pulley.friction"]
    assert friction.value == friction.low == 0.0
    assert friction.high < 0.002


def test_loading_alone_cannot_separate_friction_from_gain(tmp_path):
    bench = weight_tray(3, continuous=True)
    rising = replace(bench, rows=bench.rows[: int(np.argmax(bench.rows[:, 1]))])
    with pytest.raises(epp.EppError, match=r"only rises, so sensor gain and pulley friction cannot be separated"):
        identify(rising, tmp_path, "tray")


def test_unloading_that_stays_in_the_standstill_cannot_either(tmp_path):
    bench = weight_tray(3, continuous=True, known={"pulley.friction": 0.08})
    top = int(np.argmax(bench.rows[:, 1]))
    short = replace(bench, rows=bench.rows[: top + 25])
    with pytest.raises(epp.EppError, match="cannot separate sensor gain and pulley friction"):
        identify(short, tmp_path, "tray")


def test_falling_voltage_is_refused(tmp_path):
    bench = weight_tray(3)
    rows = bench.rows.copy()
    rows[:, 2] *= -1.0
    with pytest.raises(epp.EppError, match="the voltage falls as the force rises"):
        identify(replace(bench, rows=rows), tmp_path, "tray")


def test_saturation_that_is_not_reached_is_not_identified(tmp_path):
    fit = identify(weight_tray(1, known={"sensor.full_scale": 20.0}), tmp_path, "tray")
    assert "sensor.full_scale" not in [e.name for e in fit.estimates]
    assert any("never saturates" in note for note in fit.notes)


@pytest.mark.slow
def test_friction_scales_with_the_angle_of_the_pulley(tmp_path):
    full = identify(weight_tray(4), tmp_path, "tray")["pulley.friction"]
    half = identify(weight_tray(4), tmp_path, "tray", wrap=np.pi / 3)["pulley.friction"]
    assert half.value == pytest.approx(2.0 * full.value)


def test_a_forearm_that_never_rests_is_refused(tmp_path):
    bench = backlash_cycling(2, torque=False)
    rows = bench.rows[: len(bench.rows) // 8]
    with pytest.raises(epp.EppError, match="rests . times at an end"):
        identify(replace(bench, rows=rows), tmp_path, "backlash")


def test_a_slack_cable_is_refused(tmp_path):
    bench = backlash_cycling(2, torque=False)
    rows = bench.rows.copy()
    rows[:, 2] = rows[::-1, 2]
    rows[:, 2] = 5.0 - rows[::-1, 2]
    with pytest.raises(epp.EppError, match="the force does not fall as the forearm flexes"):
        identify(replace(bench, rows=rows), tmp_path, "backlash")


def test_a_pulley_that_never_slides_leaves_the_stiffness_unknown(tmp_path):
    known = {"backlash": np.radians(0.3), "pulley_friction": 0.06}
    fit = identify(backlash_cycling(5, torque=False, known=known), tmp_path, "backlash")
    assert [e.name for e in fit.unidentified] == ["cable.stiffness", "K R"]
    assert "the pulley's friction holds the force" in fit.limit_sentence()
    assert fit["lock_pin.backlash"].identified


def test_equation_of_the_paper(tmp_path):
    """Equations (1) and (2): 2.5 deg of backlash and K R of 0.5 lbf/deg change the force by 1.25 lbf."""
    known = {"backlash": np.radians(2.5), "cable_stiffness": 6705.263}
    fit = identify(backlash_cycling(6, torque=False, known=known), tmp_path, "backlash")
    change = fit["force change over the travel"]
    assert change.value == pytest.approx(1.25 * LBF, rel=0.01)


def test_case_carries_marks_and_tolerances(tmp_path):
    tray = weight_tray(7).write(tmp_path / "tray.csv")
    found = epp.identify(epp.case("elbow"), tray=tray)
    path = tmp_path / "identified.toml"
    path.write_text(found.to_toml())
    again = epp.read_case(path)
    gain = again.parameters["sensor.gain"]
    assert gain.mark == "measured"
    # It is written to twelve digits of the unit that people use.
    assert gain.value == pytest.approx(found["sensor.gain"].value, rel=5e-12)
    assert gain.tolerance == pytest.approx(found["sensor.gain"].tolerance, rel=1e-9)
    assert "tray.csv" in gain.note
    assert again.parameters["drive.inertia"].mark == "assumed"


def test_pictures_have_labels_and_units(tmp_path):
    figure = identify(backlash_cycling(3, torque=True), tmp_path, "backlash").plot().figure
    labels = {ax.get_ylabel().replace("\n", " ") for ax in figure.axes}
    assert {"angle [deg]", "force [lbf]", "residual [lbf]"} <= labels


def test_forces_are_in_the_unit_of_the_gains_beside_them():
    """The slope of the unloaded line of the picture is the gain that stands below it, number by number."""
    fit = epp.identify(epp.case("elbow"), tray=shipped_cases_folder() / "measured" / "weight_tray.csv").fits[0]
    top, below, intervals = fit.plot().figure.axes
    gain = next(e for e in fit.estimates if e.name == "sensor.gain")
    assert (below.get_xlabel(), gain.friendly) == ("force [lbf]", "V/lbf")
    force, voltage = top.lines[0].get_data()
    low = (force > 0.3) & (voltage < 6.0)
    slopes = voltage[low] / force[low]
    told = [text.get_text() for text in intervals.texts if "sensor gain" in text.get_text()]
    assert slopes.min() < float(told[0].split()[3]) < slopes.max() < 1.5 * slopes.min()
