"""The command ``design`` writes every file that it was given which the design has."""

from __future__ import annotations

from pathlib import Path

import pytest
from typer.testing import CliRunner

import eppanalysis as epp
from eppanalysis.cli.commands import app

THRESHOLD = "relay_dead_zone.threshold"


@pytest.fixture
def relay(tmp_path: Path) -> Path:
    """A relay with a dead zone, which oscillates while its threshold is below 1.59 (5/2 times 2/pi), as a file."""
    loop = epp.LureSystem.from_tf(([5.0], [1.0, 2.0, 1.0, 0.0]), epp.RelayDeadZone(threshold=1.0))
    path = tmp_path / "relay.toml"
    path.write_text(epp.Case.from_system(loop, name="relay").to_toml(), encoding="utf-8")
    return path


def test_one_parameter_alone_has_a_case_file_a_picture_and_a_table(relay: Path) -> None:
    files = [relay.parent / f"design.{suffix}" for suffix in ("toml", "png", "csv")]
    options = [text for path in files for text in ("-o", str(path))]
    tuned = ["--tune", f"{THRESHOLD} 1..4", "--maximise", THRESHOLD, "--no-verify"]
    made = CliRunner().invoke(app, ["design", str(relay), *tuned, *options])
    assert made.exit_code == 0, made.stderr
    assert epp.read_case(files[0]).value(THRESHOLD) == 4.0
    assert files[1].read_bytes().startswith(b"\x89PNG") and "4.0" in files[2].read_text(encoding="utf-8")


@pytest.mark.slow
def test_the_table_is_written_where_there_is_no_design_for_a_case_file(relay: Path) -> None:
    case, table = (relay.parent / f"design.{suffix}" for suffix in ("toml", "csv"))
    tuned = ["--tune", f"{THRESHOLD} 0.8..1.2", "--maximise", THRESHOLD, "--no-verify"]
    made = CliRunner().invoke(app, ["design", str(relay), *tuned, "-o", str(case), "-o", str(table)])
    assert made.exit_code == 2 and not case.exists()
    assert "no design is feasible, so there is no case to write." in " ".join(made.stderr.split())
    assert "infeasible" in table.read_text(encoding="utf-8")
