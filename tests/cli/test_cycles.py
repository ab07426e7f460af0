"""The commands ``cycles`` and ``branch``: their files and their mistakes."""

from __future__ import annotations

import csv
import json
import math
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import eppanalysis as epp
from eppanalysis.cli.commands import app
from eppanalysis.errors import EppError
from eppanalysis.methods.search.picture import plot_cycles
from tests.shared import cycles_of, said_above


def run(*arguments: str, code: int = 0):
    result = CliRunner().invoke(app, list(arguments))
    assert result.exit_code == code, result.output
    return result


def test_cycles_writes_a_table_and_a_picture(tmp_path: Path) -> None:
    run("cycles", "relay_deadzone", "-o", str(tmp_path / "all.csv"))
    with (tmp_path / "all.csv").open(encoding="utf-8") as stream:
        rows = list(csv.DictReader(stream))
    assert [row["stable"] for row in rows] == ["false", "true"]
    assert float(rows[1]["period [s]"]) == pytest.approx(6.327796595, rel=1e-9)
    run("cycles", "relay_deadzone", "--json", "-o", str(tmp_path / "all.png"))
    assert (tmp_path / "all.png").read_bytes().startswith(b"\x89PNG")


def test_a_wrong_file_is_refused_before_anything_is_computed(tmp_path: Path) -> None:
    assert "expected one of" in run("cycles", "relay_deadzone", "-o", str(tmp_path / "all.xyz"), code=2).output
    bad = run("branch", "relay_deadzone", "--over", "x", "--from", "1", "--to", "2", "-o", "b.csv", code=2)
    assert ".png" in bad.output


def test_cycles_as_json() -> None:
    (case,) = json.loads(run("cycles", "sat_am165", "--json").stdout)["cases"]
    assert [c["stable"] for c in case["result"]["cycles"]] == [True]


def test_a_branch_is_in_units_that_people_read() -> None:
    output = run(
        "branch", "wheelchair", "--over", "play.gap", "--from", "12 mm", "--to", "10 mm", "--points", "8"
    ).output
    assert re.search(r"orbits over play gap between [\d.]+ mm and 12 mm", output), output


def test_a_branch_that_covers_a_part_says_which_and_why() -> None:
    ends = ("--over", "loop.gain", "--from", "0.7", "--to", "1")
    output = run("branch", "wheelchair", "--set", "loop.gain=1", "--set", "play.gap=12 mm", *ends).output
    assert re.search(r"No orbit between 0\.7 and 0\.8463: the branch turns back there", output), output
    assert "It covers a part of the range" in output


def test_cycles_and_triggers_are_in_units_that_people_read(monkeypatch: pytest.MonkeyPatch) -> None:
    hits = (
        epp.Trigger("harness_position", -0.00024566037, -0.000245660366, -0.000245660378, 1.0, unit="m"),
        epp.Trigger("theta", 0.01, 0.009999999, 0.01, 1.0, unit="rad"),
        epp.Trigger("theta_dot", math.nan, 0.0, math.nan, 2.0, unit="rad/s"),
    )
    monkeypatch.setattr("eppanalysis.methods.search.trigger.trigger", lambda *_, **__: hits)
    output = run("cycles", "fig8a_original", "--trigger").stdout
    assert "theta 4.394 deg peak to peak" in output and "rad " not in output
    # Of a trigger two numbers that differ are told.
    assert [line for line in output.splitlines() if line.startswith("trigger")] == [
        "trigger: harness position by -0.24566038 mm starts a cycle; -0.24566037 mm settles.",
        "trigger: theta by 0.5729578 deg starts a cycle; 0.5729577 deg settles.",
        "trigger: theta dot by up to 114.6 deg/s starts no cycle.",
    ]


@pytest.mark.slow
def test_a_branch_of_one_orbit_is_one_orbit() -> None:
    ends = ("--over", "lock_pin.backlash", "--from", "1 deg", "--to", "2 deg")
    assert "\n1 orbit over" in run("branch", "fig8a_original", *ends, "--points", "1").stdout


def test_picture_of_all_cycles() -> None:
    found = cycles_of("relay_deadzone")
    left, right = found.plot().figure.axes
    verdict, details = said_above(found.plot().figure)
    assert verdict.startswith("Can oscillate: 2 limit cycles") and details.startswith("relay_deadzone: ")
    assert [text.get_text() for text in left.get_legend().get_texts()] == ["unstable, 0.1211 Hz", "stable, 0.158 Hz"]
    # The waveform begins where its fundamental rises through zero; here it is odd, so it begins at zero.
    assert abs(left.lines[1].get_ydata()[0]) < 0.05 * found[1].peak_to_peak["x"]
    assert right.get_ylabel() == "rate of x [1/s]"
    with pytest.raises(EppError, match="no signal"):
        plot_cycles(found, "nothing")


def test_picture_of_many_cycles_tells_few_apart() -> None:
    """The stable ones, largest first; none is left out, and the legend has no line for each."""
    small, large = cycles_of("relay_deadzone")
    many = [replace(small, waveform={"x": size * small.waveform["x"]}) for size in np.geomspace(0.1, 5.0, 15)]
    found = replace(cycles_of("relay_deadzone"), cycles=(*many, large))
    for ax in found.plot().figure.axes:
        assert len(ax.lines) == 16 and sum(line.get_linewidth() > 1.0 for line in ax.lines) == 4
    waveforms, orbits = ([len(line.get_xdata()) > 0 for line in ax.lines] for ax in found.plot().figure.axes)
    assert sum(waveforms) == 4 and all(orbits)
    legend = [text.get_text() for text in found.plot().get_legend().get_texts()]
    assert legend == ["12 more, unstable", "unstable, 0.1211 Hz", "stable, 0.158 Hz"]


def test_picture_shows_a_prediction_that_was_not_closed_as_one() -> None:
    blocks = [epp.Saturation(slope=2.0), ([2.0], [1.0, 1.0]), epp.Play(0.7), ([2.5], [1.0, 2.0, 0.0])]
    found = epp.find_limit_cycles(epp.LureSystem.from_blocks(blocks))
    (doubtful,) = found.unclosed
    left, right = found.plot().figure.axes
    assert [text.get_text() for text in left.get_legend().get_texts()] == [
        "stable, 0.1736 Hz", "predicted, 0.02025 Hz (may not exist)",
    ]  # fmt: skip
    for ax in (left, right):
        assert [line.get_linestyle() for line in ax.lines] == ["-", ":"]
    drawn = left.lines[1].get_ydata()
    assert max(drawn) - min(drawn) == pytest.approx(next(iter(doubtful.peak_to_peak.values())), rel=1e-3)


def test_picture_of_no_cycle_says_so() -> None:
    loop = epp.LureSystem.from_tf(([1.0], [1.0, 3.0, 2.0, 0.0]), epp.Saturation())
    picture = epp.find_limit_cycles(loop).plot().figure
    assert said_above(picture)[0].startswith("No limit cycle") and "Sought with" in picture.axes[0].texts[0].get_text()


@pytest.mark.parametrize(
    ("name", "settings", "why"),
    [
        ("relay_hyst_servo", (), "no resting state was reached from the start, so there is nothing to disturb."),
        (
            "relay_deadzone",
            ("relay_dead_zone.level=0.1",),
            "no stable cycle was found, so none is there for a disturbance to start.",
        ),
    ],
)
def test_a_loop_that_does_not_rest_or_has_no_cycle_is_answered_with_its_search(
    name: str, settings: tuple[str, ...], why: str
) -> None:
    """Nothing can be disturbed, or nothing started: what the search found is said all the same."""
    asked = ("cycles", name, "--trigger", *(word for text in settings for word in ("--set", text)))
    assert "Sought with" in (output := run(*asked).output) and output.splitlines()[-1] == f"trigger: {why}"
    (case,) = json.loads(run(*asked, "--json").stdout)["cases"]
    assert case["result"]["triggers"] == [] and case["result"]["no_triggers"] == why
    assert bool(case["result"]["cycles"]) == (name == "relay_hyst_servo")
