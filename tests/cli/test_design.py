"""The command ``design`` refuses a picture that it could not draw before it computes anything."""

from __future__ import annotations

from pathlib import Path

import pytest
from typer.testing import CliRunner

from eppanalysis.cli.commands import app


def test_one_parameter_alone_has_no_picture(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr("eppanalysis.methods.design.design.design", lambda *_, **__: pytest.fail("computed"))
    asked = ["design", "wheelchair", "--tune", "loop.gain 0.5..1.5", "--maximise", "loop.gain"]
    refused = CliRunner().invoke(app, [*asked, "-o", str(tmp_path / "design.png")])
    assert refused.exit_code == 2
    assert "has no row of values to draw; expected two, or a front." in " ".join(refused.stderr.split())
    assert not list(tmp_path.iterdir())
