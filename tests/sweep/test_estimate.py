"""What a sweep costs, said from a sample of its cells."""

from __future__ import annotations

import json
import math
import sys
import time

import pytest
from typer.testing import CliRunner

import eppanalysis as epp
from eppanalysis.cli.commands import app
from eppanalysis.sweep.work import Work

CASE = epp.case("fig8a_original").with_values({"run.t_end": "0.3 s"})
AXES = {"bands.range": "1:5:30:lbf", "lock_pin.backlash": "0:3:80:deg"}


@pytest.fixture
def clock(monkeypatch) -> None:
    """A clock that only computing cells moves: 10 ms each."""
    now, block = [0.0], Work.block

    def computed(work, bounds):
        now[0] += 0.01 * math.prod(stop - start for start, stop in bounds)
        return block(work, bounds)

    monkeypatch.setattr(Work, "block", computed)
    monkeypatch.setattr(time, "process_time", lambda: now[0])


def test_a_sample_tells_what_all_cells_cost(clock) -> None:
    cost = epp.sweep_cost(CASE, AXES)
    assert (cost.cells, cost.measured) == (2400, 4 * 64)  # until two seconds have gone by
    assert cost.seconds == pytest.approx(0.01) and cost.core_hours == pytest.approx(24.0 / 3600.0)
    assert str(cost) == "About 24 s of one core for 2400 cells: 256 of them took 10 to 10 ms each."


def test_a_sample_of_other_analyses_takes_a_cell_at_a_time(clock) -> None:
    relay = epp.case("relay_deadzone")
    cost = epp.sweep_cost(relay, {"relay_dead_zone.threshold": [0.5, 0.6]}, "predict")
    assert (cost.cells, cost.measured) == (2, 16) and cost.seconds == pytest.approx(0.01)


def test_command(tmp_path, clock) -> None:
    arguments = [
        "sweep",
        "fig8a_original",
        "--set",
        "run.t_end=0.3 s",
        "--axis",
        "bands.range=1:5:1000:lbf",
        "--estimate",
    ]
    said = CliRunner().invoke(app, [*arguments, "-o", str(tmp_path / "map.zarr")])
    assert said.exit_code == 0 and said.stdout.startswith("About ") and "1000 cells" in said.stdout
    assert not (tmp_path / "map.zarr").exists()
    found = json.loads(CliRunner().invoke(app, [*arguments, "--json"]).stdout)
    assert found["cases"][0]["result"]["estimate"]["core_hours"] > 0.0


def test_a_big_sweep_says_it_before_it_begins(monkeypatch, capsys) -> None:
    monkeypatch.setattr(sys.modules["eppanalysis.sweep"], "_MANY_RUNS", 4)
    epp.sweep(CASE, {"bands.range": "1:5:4:lbf"})
    assert "of one core for 4 cells" in capsys.readouterr().err


@pytest.mark.parametrize("run", ["nothing", ["predict", "nothing"]])
def test_refuses(run) -> None:
    with pytest.raises(epp.EppError, match="nothing"):
        epp.sweep_cost(CASE, AXES, run)
