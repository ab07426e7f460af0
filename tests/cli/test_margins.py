"""The command ``eppanalysis margins``."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

import eppanalysis as epp
from eppanalysis.cli.commands import app

SERVO = """
kind = "loop"
title = "A servo"
[loop]
num = [5.0]
den = [1, 1, 0]
margins_at = ["play.in", "play.out"]
[[loop.elements]]
element = "play"
gap = 2.0
[run]
t_end = "10 s"
"""


def run(*args: str) -> tuple[int, str]:
    result = CliRunner().invoke(app, ["margins", *args])
    return result.exit_code, result.output


def test_the_table_names_the_cut_and_the_rule() -> None:
    code, text = run("wheelchair", "--at", "play.in")
    assert code == 0 and "cut at play.in" in text and "6.249 deg" in text
    assert "1 (the slope at which it follows)" in text and "dead_zone.out, play.out" in text


def test_the_cuts_of_the_case_are_asked_where_none_is_named(tmp_path: Path) -> None:
    file = tmp_path / "servo.toml"
    file.write_text(SERVO)
    code, text = run(str(file), "--json")
    found = json.loads(text)["cases"][0]["result"]["margins"]
    assert code == 0 and [one["at"] for one in found] == ["play.in", "play.out"]
    expected = epp.margins(epp.read_case(str(file)))
    assert found[0]["phase_margin"] == expected.phase_margin and found[0]["gain_margin"] is None
    assert found[0]["stable"] is True and found[0]["rule"] == ["play: 1 (the slope at which it follows)."]


@pytest.mark.parametrize("at", ["play.iin", "plya.in"])
def test_a_place_that_is_not_known_is_refused_with_the_one_that_was_meant(at: str) -> None:
    code, text = run("wheelchair", "--at", at)
    assert code == 2 and f"wheelchair has no place '{at}' to be cut at; did you mean 'play.in'?" in text


def test_a_picture_is_of_one_cut(tmp_path: Path) -> None:
    picture = tmp_path / "cut.png"
    assert run("wheelchair", "-o", str(picture))[0] == 0 and picture.stat().st_size > 1000
    code, text = run("wheelchair", "--at", "play.in", "--at", "play.out", "-o", str(picture))
    assert code == 2 and "one picture for 2 cuts" in text


def test_what_is_said_of_a_sampled_controller_is_said_of_the_cut_that_it_holds_for() -> None:
    result = CliRunner().invoke(app, ["margins", "azimuth_servo", "--at", "controller", "--at", "gear"])
    said = " ".join(result.stdout.split())
    assert "At controller.out: controller: executed every 0.001 s, exact from sample to sample." in said
    assert "At gear.out: controller: executed every 0.001 s, in the mean over where its samples fall" in said
    assert max(map(len, result.stdout.split("places of the loop")[0].splitlines())) < 120
