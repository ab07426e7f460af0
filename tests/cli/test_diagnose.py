"""``eppanalysis diagnose`` on a record of a shipped loop, and on hostile ones."""

from __future__ import annotations

import json
from dataclasses import replace
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import eppanalysis as epp
from eppanalysis.cli.commands import app
from eppanalysis.diagnose.questions import question
from eppanalysis.diagnose.record import oscillation_of, record_of

runner = CliRunner()


def run(*arguments: object):
    result = runner.invoke(app, ["diagnose", *map(str, arguments)])
    assert result.exception is None or isinstance(result.exception, SystemExit), result.exception
    return result


@pytest.fixture(scope="module")
def record(tmp_path_factory) -> Path:
    """A sine of 0.9 rad/s, with noise, as two columns of which one has a name of its own."""
    path = tmp_path_factory.mktemp("record") / "sine.csv"
    t = np.linspace(0.0, 60.0, 900)
    x = np.sin(0.9 * t) + 0.02 * np.random.default_rng(3).normal(size=t.size)
    rows = [f"{1e3 * a:.3f},{b:.6f}" for a, b in zip(t, x, strict=True)]
    path.write_text("\n".join(["time [ms],LT 4", *rows]), encoding="utf-8")
    return path


def test_what_explains_a_record_is_said_and_drawn(record, tmp_path, monkeypatch):
    module, held = import_module("eppanalysis.diagnose"), []

    def sought_once(*given):
        held[:] = held or [module_seeks(*given)]
        return held[0]

    module_seeks = module.candidates_of
    monkeypatch.setattr(module, "candidates_of", sought_once)
    picture, table = tmp_path / "found.png", tmp_path / "found.csv"
    result = run("backlash_servo", record, "--signal", "x=LT 4", "-o", picture)
    assert result.exit_code == 0, result.output
    assert "Explained by external disturbance." in result.stdout
    assert "candidate" in result.stdout and "play" in result.stdout
    assert picture.stat().st_size > 10_000
    document = json.loads(run("backlash_servo", record, "--signal", "x=LT 4", "--json", "-o", table).stdout)
    found = document["cases"][0]["result"]
    assert found["verdict"] == "named" and found["named"] == ["external disturbance"]
    assert found["period"] == pytest.approx(2 * np.pi / 0.9, rel=1e-3)
    assert table.read_text().startswith("candidate,probability,misfit")


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        ((), "expected a column of a signal of the loop: one of x, y"),
        (("--signal", "z=LT 4"), "a signal that is one of time, x, y"),
        (("--signal", "x=LT 4", "--signal", "x=LT 5"), "each signal once"),
        (("--signal", "x=LT 4", "--model-error", "2"), "--model-error is 2.0; expected 0.001 to 0.5"),
        (("--signal", "x=LT 4", "-o", "found.xyz"), "found.xyz"),
    ],
)
def test_what_is_wrong_is_said_in_a_sentence(record, arguments, sentence):
    result = run("backlash_servo", record, *arguments)
    assert result.exit_code == 2
    assert sentence in " ".join(result.output.split())


def test_a_file_that_is_not_there_is_named():
    result = run("backlash_servo", "nowhere.csv")
    assert result.exit_code == 2 and "nowhere.csv" in result.output


def test_what_is_printed_to_be_typed_next_is_a_command_and_nothing_dangles(tmp_path):
    """Of a file without parameters of its own nothing was printed; of a sine behind an element half a sentence."""
    loop = epp.case("backlash_servo")
    motion = epp.simulate(loop, t_end=60.0, t_eval=np.linspace(30.0, 60.0, 600))
    found = epp.diagnose(loop, {"time": motion.t - 30.0, **motion.signals})
    assert found.names == ("play",)
    (said,) = found.questions
    command = said.partition("eppanalysis ")[2]
    assert command.startswith("bounds backlash_servo --over loop.gain --from 1 --points 1 --limit play.gap --allow")
    sine = replace(found[0], name="external disturbance", note="comes in behind play")
    oscillation = oscillation_of(record_of({"time": motion.t, **motion.signals}, {"x": "", "y": ""}))
    assert question(loop, sine, oscillation, {}, 1.0) == ""
    at = question(loop, replace(sine, note="comes in at load"), oscillation, {}, 1.0)
    assert at.startswith("How the loop answers what comes in at load: eppanalysis response backlash_servo --input load")
