"""``eppanalysis identify`` on the shipped recordings, and on hostile ones."""

from __future__ import annotations

import json

import pytest
from typer.testing import CliRunner

import eppanalysis as epp
from eppanalysis.cases import shipped_cases_folder
from eppanalysis.cli.commands import app
from tests.records.test_csv import BAD

runner = CliRunner()
MEASURED = shipped_cases_folder() / "measured"


def run(*arguments: object):
    result = runner.invoke(app, ["identify", *map(str, arguments)])
    assert result.exception is None or isinstance(result.exception, SystemExit), result.exception
    return result


def test_measured_files_to_a_case(tmp_path):
    out = tmp_path / "identified.toml"
    table = tmp_path / "found.csv"
    pictures = tmp_path / "{bench}.png"
    result = run(
        "elbow", "--tray", MEASURED / "weight_tray.csv", "--backlash", MEASURED / "backlash_cycling.csv",
        "-o", out, "-o", table, "-o", pictures,
    )  # fmt: skip
    assert result.exit_code == 0, result.output
    assert "95 % interval" in result.stdout
    assert "Limited by" in result.stdout
    case = epp.read_case(out)
    assert case.parameters["lock_pin.backlash"].mark == "measured"
    assert case.parameters["lock_pin.backlash"].tolerance > 0
    assert table.read_text().startswith("test,parameter,value,low,high")
    assert (tmp_path / "tray.png").stat().st_size > 10_000
    assert (tmp_path / "backlash.png").stat().st_size > 10_000


def test_json_is_strict_and_in_si_units():
    document = json.loads(run("elbow", "--tray", MEASURED / "weight_tray.csv", "--json").stdout)
    fit = document["cases"][0]["result"]["fits"][0]
    gain = fit["estimates"]["sensor.gain"]
    assert gain["low"] < 2.0 / 4.4482216152605 < gain["high"]
    assert gain["unit"] == "V/N"


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        ((), "no measured file is given"),
        (("--tray", "no_such.csv"), "no_such.csv is missing"),
        (("--tray", MEASURED / "backlash_cycling.csv"), "line 1, voltage"),
        (("--tray", MEASURED / "weight_tray.csv", "--wrap", "3 kg"), "--wrap is '3 kg'"),
        (("--tray", MEASURED / "weight_tray.csv", "--wrap", "270 deg"), "0 to 180 deg"),
        (("--tray", MEASURED / "weight_tray.csv", "--signal", "force=F:lbf"), "the column 'F' of --signal"),
        (("--tray", MEASURED / "weight_tray.csv", "--signal", "voltage=force:V"), "line 1, voltage"),
        (("--tray", MEASURED / "weight_tray.csv", "-o", "x.xlsx"), "expected one of .toml"),
        (("--backlash", MEASURED / "backlash_cycling.csv", "--press", "-1 N*m"), "press is -1.0 N*m"),
    ],
)
def test_what_is_wrong_is_one_sentence(arguments, expected):
    result = run("elbow", *arguments)
    assert result.exit_code == 2
    assert expected in result.stderr
    assert len(result.stderr.strip().splitlines()) == 1


@pytest.mark.parametrize("kind", BAD)
def test_hostile_files_are_one_sentence(tmp_path, kind):
    content, found, expected = BAD[kind]
    (tmp_path / "bench.csv").write_bytes(content)
    result = run("elbow", "--tray", tmp_path / "bench.csv")
    assert result.exit_code == 2
    assert found in result.stderr and expected in result.stderr
    assert len(result.stderr.strip().splitlines()) == 1
    assert not result.stdout


def test_generic_loops_are_refused():
    result = run("relay_ideal_khalil79", "--tray", MEASURED / "weight_tray.csv")
    assert result.exit_code == 2
    assert "expected a case of the elbow" in result.stderr


def test_a_wrong_file_leaves_an_old_case_alone(tmp_path):
    out = tmp_path / "identified.toml"
    out.write_text("old")
    bad = tmp_path / "bad.csv"
    bad.write_text("force [lbf],voltage [V]\n1,2\n")
    assert run("elbow", "--tray", bad, "-o", out).exit_code == 2
    assert out.read_text() == "old"
    assert [p.name for p in tmp_path.iterdir()] == ["identified.toml", "bad.csv"] or len(list(tmp_path.iterdir())) == 2
