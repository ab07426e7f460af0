"""The command ``sweep``: files, summaries, pictures with boundaries; what is wrong is one sentence and exit code 2."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
import time
from enum import StrEnum

import pytest
import xarray
from typer.testing import CliRunner

from eppanalysis.cli.commands import app
from eppanalysis.cli.sweep import Design, Kind, Run
from eppanalysis.sweep import open_sweep
from eppanalysis.sweep.analyses import PREFIX, Analysis
from tests.cli.test_main import one_sentence, run

ELBOW = ("sweep", "fig8a_original", "--axis", "bands.range=2:3:2:lbf", "--axis", "lock_pin.backlash=0.5:2.5:2:deg")
SHORT = (*ELBOW, "--set", "run.t_end=0.5 s")
RELAY = ("sweep", "relay_deadzone", "--axis", "relay_dead_zone.threshold=0.5,1,4")


def summary(*arguments: str) -> dict:
    (case,) = json.loads(run(*arguments, "--json").stdout)["cases"]
    return case["result"]


def test_a_map_is_summarised_stored_and_drawn(tmp_path) -> None:
    store, picture = tmp_path / "map.zarr", tmp_path / "map.png"
    found = summary(*ELBOW, "-o", str(store), "--picture", str(picture))
    assert found["cells"] == 4
    assert found["outcome"] == {"settles": 2, "oscillates": 2}
    assert found["output"] == str(store)
    assert picture.stat().st_size > 1000
    assert open_sweep(store)["outcome"].values.tolist() == [[1, 2], [1, 2]]
    # The same command again finds all of it done.
    assert "outcome: settles in 2 of 4 designs, oscillates in 2" in run(*ELBOW, "-o", str(store)).stdout


def test_settings_hold_in_every_cell(tmp_path) -> None:
    run(*SHORT, "-o", str(tmp_path / "map.nc"))
    with xarray.open_dataset(tmp_path / "map.nc") as found:
        assert json.loads(found.attrs["provenance"])["settings"]["t_end"] == 0.5
        assert found["peak_to_peak"].dims == ("bands.range", "lock_pin.backlash")


@pytest.mark.parametrize(
    ("design", "axes"),
    [
        ("zip", ("bands.range=2:3:2:lbf", "lock_pin.backlash=1 deg,2 deg")),
        ("latin", ("bands.range=2:3:lbf", "lock_pin.backlash=1:2:deg")),
        ("sobol", ("bands.range=2:3:lbf", "lock_pin.backlash=1:2:deg")),
        ("tolerances", ()),
    ],
)
def test_designs_and_their_pictures(tmp_path, design, axes) -> None:
    case = tmp_path / "case.toml"
    case.write_text(
        'base = "fig8a_original"\n[run]\nt_end = "0.5 s"\n[bands]\nrange = {value="2 lbf", tolerance="5 %"}'
    )
    options = [text for axis in axes for text in ("--axis", axis)]
    picture = tmp_path / "sample.svg"
    size = () if design == "zip" else ("--n", "2")
    found = summary("sweep", str(case), *options, "--design", design, *size, "-o", str(picture))
    assert found["cells"] == 2
    assert "bands range" in picture.read_text(encoding="utf-8")


def test_one_axis_is_drawn_as_slices_with_every_analysis(tmp_path) -> None:
    picture = tmp_path / "slices.svg"
    found = summary(*RELAY, "--run", "all", "-o", str(picture))
    assert found["exact_stability"] == {"no_cycle": 1, "stable": 2}
    assert found["trigger_outcome"] == {"no_cycle": 1, "starts": 2}
    text = picture.read_text(encoding="utf-8")
    assert "predicted" in text and "exact" in text and "frequency [Hz]" in text


def test_boundaries_are_drawn_on_a_map(tmp_path) -> None:
    picture = tmp_path / "map.svg"
    arguments = (*RELAY[:2], "--axis", "relay_dead_zone.threshold=1:4:2", "--axis", "loop.gain=3:6:2")
    result = run(*arguments, "--boundary", "simulate", "-o", str(picture))
    assert result.exit_code == 0, result.output
    assert "boundary (run in time):" in result.stdout
    assert "run in time" in picture.read_text(encoding="utf-8")


def test_one_cell_is_one_cell() -> None:
    shown = run("sweep", "fig8a_original", "--axis", "lock_pin.backlash=1 deg", "--set", "run.t_end=0.1 s").stdout
    assert "outcome: unknown in 1 of 1 designs" in shown


def test_a_failed_cell_is_told_and_the_exit_code_stays() -> None:
    axis = ("--axis", "forearm.inertia=0.03,-1", "--set", "run.t_end=0.1 s")
    result = run("sweep", "fig8a_original", *axis)
    assert result.exit_code == 0
    assert "first failure: sweep: forearm.inertia is '-1 kg*m^2'; expected a positive number." in result.stdout


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--axis", "bands.range=1:5:4:deg"), "a force"),
        (("--axis", "bands.range="), "lacks a field, '=' or a value"),
        (("--axis", "bands.range"), "FIELD=start:stop:count:unit"),
        (("--axis", "bands.range=1 lbf", "--axis", "bands.range=2 lbf"), "given twice"),
        ((), "no axis"),
        (
            ("--axis", "bands.range=1:2:2:lbf", "--run", "dance"),
            "--run dance: is not known; expected one or several of simulate",
        ),
        (
            ("--axis", "bands.range=1:2:2:lbf", "--design", "magic"),
            "--design magic: is not known; expected one of grid, zip",
        ),
        (("--axis", "bands.range=1:2:2:lbf", "--design", "tolerances"), "no place in a sample of tolerances"),
        (("--axis", "bands.range=1:2:lbf", "--design", "latin", "--seed", "-1"), "seed is -1"),
        (("--axis", "bands.range=1:2:3", "--design", "latin"), "expected low:high:unit, without the count"),
        (("--axis", "bands.range=1:2:3:lbf", "--design", "sobol"), "expected low:high:unit, without the count"),
        (("--axis", "bands.range=1:2:1000000000"), "expected a count of at most 10000000"),
        (("--axis", "bands.range=1:2:2:lbf", "--n", "50"), "--n 50: is of a sample"),
        (("--axis", "bands.range=1 lbf", "--design", "zip", "--n", "50"), "--n 50: is of a sample"),
        (("--axis", "bands.range=1:2:2:lbf", "-o", "map.docx"), ".zarr"),
        (("--axis", "bands.range=1:2:2:lbf", "-o", "nowhere/map.zarr"), "does not exist"),
        (("--axis", "bands.range=1:2:2:lbf", "--picture", "map.zarr"), ".png"),
        (("--axis", "bands.range=1:2:2:lbf", "--boundary", "free"), "two --axis and a picture"),
        (("--axis", "bands.range=1:2:2:lbf", "--boundary", "guess"), "expected one or several of free"),
        (("--axis", "bands.range=1:2:2:lbf", "--scheduler", "magic"), "address of a Dask scheduler"),
    ],
)
def test_what_is_wrong_is_one_sentence(tmp_path, monkeypatch, arguments, words) -> None:
    monkeypatch.chdir(tmp_path)
    assert words in one_sentence(run("sweep", "fig8a_original", "--set", "run.t_end=0.1 s", *arguments))
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
@pytest.mark.skipif(os.name != "posix", reason="signals")
@pytest.mark.parametrize("scheduler", ["threads", "processes"])
def test_an_interrupt_ends_in_one_sentence_and_at_once(tmp_path, scheduler) -> None:
    """Also while a thread has work for long, and while processes begin."""
    code = (
        "import importlib, os, signal, time\n"
        "schedule = importlib.import_module('eppanalysis.sweep.schedule')\n"
        "def interrupted(*_):\n"
        "    os.killpg(os.getpgid(0), signal.SIGINT)\n"
        "    time.sleep(60)\n"
        "schedule.Work.block = interrupted\n"
        "if __name__ == '__main__':\n"
        "    importlib.import_module('eppanalysis.cli').main()\n"
    )
    script = tmp_path / "script.py"
    script.write_text(code)
    command = [sys.executable, str(script), *SHORT, "--scheduler", scheduler]
    begin = time.monotonic()
    process = subprocess.run(command, check=False, capture_output=True, text=True, start_new_session=True, timeout=50)
    assert process.returncode == 130
    assert process.stderr.splitlines() == ["Interrupted: nothing is kept without -o FILE.zarr."]
    assert time.monotonic() - begin < 45


def test_a_store_of_another_case_is_refused_and_kept(tmp_path) -> None:
    store = str(tmp_path / "map.zarr")
    assert run(*SHORT, "-o", store).exit_code == 0
    sentence = one_sentence(run(*SHORT, "--set", "forearm.inertia=0.03", "-o", store))
    assert "holds a sweep with another case" in sentence
    assert run(*SHORT, "-o", store).exit_code == 0


@pytest.mark.parametrize("words", [Run, Design, Kind])
def test_help_lists_every_choice(words: type[StrEnum]) -> None:
    shown = CliRunner().invoke(app, ["sweep", "--help"], env={"COLUMNS": "400"}).output
    option = {Run: "--run ", Design: "--design ", Kind: "--boundary "}[words]
    described = re.split(r"^\W*--", shown.partition(option)[2], maxsplit=1, flags=re.MULTILINE)[0]
    assert set(words) <= set(re.findall(r"\w+", described))


def test_choices_are_what_the_analyses_are() -> None:
    assert list(Run) == [*Analysis, "all"] and set(Kind) - {Kind.FREE} == set(PREFIX)


def test_what_was_swept_is_said_in_the_units_of_people():
    axes = "--axis", "lock_pin.backlash=0.5 deg,1 deg", "--axis", "bands.range=2:3:2:lbf"
    told = run("sweep", "fig8a_original", *axes, "--set", "run.t_end=0.1 s").stdout
    assert "4 designs: lock pin backlash from 0.5 deg to 1 deg; bands range from 2 lbf to 3 lbf" in told
    assert "unknown in 4 of 4 designs" in told and "run.t_end" in told


def test_a_range_of_another_option_is_no_value_of_an_axis():
    refused = one_sentence(run("sweep", "fig8a_original", "--axis", "bands.range=1..5 lbf"))
    assert "start:stop:count:unit" in refused
