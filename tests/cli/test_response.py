"""The command ``eppanalysis response``, and what other commands say of a loop that a sine drives."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from eppanalysis.cli.commands import app

SPRING = """
kind = "diagram"
title = "A mass on a spring that yields"
connect = ["force - mass -> spring", "spring -> mass"]
inputs = { force = "0 m" }
[blocks]
mass = { kind = "transfer_function", num = [1], den = [1, 0.2, 0] }
[elements]
spring = { element = "saturation", lower = "-1 m", upper = "1 m" }
[signals]
x = { of = "mass", unit = "m" }
[run]
t_end = "60 s"
input = { kind = "sine", amplitude = "0.5 m", frequency = "0.12732 Hz" }
[expected]
signal = "x"
"""


@pytest.fixture
def case(tmp_path: Path) -> str:
    path = tmp_path / "spring.toml"
    path.write_text(SPRING)
    return str(path)


def run(command: str, *args: str) -> tuple[int, str]:
    result = CliRunner().invoke(app, [command, *args])
    return result.exit_code, result.output


def test_the_case_s_own_sine_is_taken_where_none_is_named(case: str) -> None:
    code, text = run("response", case)
    assert code == 0
    assert "amplitude 0.5 m and 0.1273 Hz at force: 3 found, 2 stable" in text
    assert "comes to follow the input" in text
    row = next(line for line in text.splitlines() if "x peak to peak [m]" in line)
    assert row.split()[-3:] == ["2.538", "3.522", "3.642"]


def test_responses_to_one_sine_as_json_and_picture(case: str, tmp_path: Path) -> None:
    picture = tmp_path / "response.png"
    code, text = run("response", case, "--json", "-o", str(picture))
    assert code == 0 and picture.stat().st_size > 10_000
    assert len(json.loads(text)["cases"][0]["result"]["responses"]) == 3


def test_a_range_of_frequencies_gives_folds_a_table_and_a_picture(case: str, tmp_path: Path) -> None:
    table = tmp_path / "response.csv"
    code, text = run("response", case, "--input", "force", "--frequency", "0.115 Hz..140 mHz", "-o", str(table))
    assert code == 0 and "jumps at 0.1229 Hz and 0.1325 Hz" in text
    rows = list(csv.DictReader(table.read_text().splitlines()))
    assert {row["method"] for row in rows} == {"exact orbit", "describing function"}
    assert float(rows[0]["frequency [Hz]"]) == pytest.approx(0.115)
    assert {row["amplitude [m]"] for row in rows} == {"0.5"}


@pytest.mark.slow
def test_a_range_of_amplitudes_as_json_and_picture(case: str, tmp_path: Path) -> None:
    picture = tmp_path / "response.png"
    ask = ["--amplitude", "300 mm..700 mm", "--frequency", "0.128", "--json", "-o", str(picture)]
    code, text = run("response", case, *ask)
    assert code == 0 and picture.stat().st_size > 10_000
    result = json.loads(text)["cases"][0]["result"]
    assert result["over"] == "amplitude" and result["output"] == "x"
    assert [s["kind"] for s in result["branches"][0]["special"]] == ["fold", "fold"]


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        (["--frequency", "0.1..fast"], "--frequency 0.1..fast: expected a frequency"),
        (["--amplitude", "5 s"], "--amplitude 5 s: expected a length"),
        (["--amplitude", "1..2", "--frequency", "1..2"], "are two ranges; expected one at most"),
        (["--input", "push"], "has no input 'push'"),
        (["--frequency", "0.1..0.2", "--signal", "y"], "has no signal 'y'"),
        (["--frequency", "-1"], "frequency is -1.0; expected a positive number [Hz]"),
    ],
)
def test_bad_options_are_one_sentence(case: str, options: list[str], sentence: str) -> None:
    code, text = run("response", case, *options)
    assert code == 2 and sentence in text and "Traceback" not in text


def test_other_commands_point_to_it_and_do_not_answer_for_the_undriven_loop(case: str) -> None:
    for command in (["cycles", case], ["predict", case]):
        code, text = run(*command)
        assert code == 2 and "input 'force' is a sine, so there is no operating point" in text
        assert "(on the command line: response)" in text
    code, text = run("simulate", case)
    assert code == 0 and "input 'force' is a sine: the command response computes the periodic response" in text
