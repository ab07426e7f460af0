"""The command ``eppanalysis export``."""

from __future__ import annotations

import zipfile

import pytest
from typer.testing import CliRunner

from eppanalysis.cli.commands import app


def _export(*arguments: str) -> tuple[int, str]:
    result = CliRunner().invoke(app, ["export", *arguments])
    return result.exit_code, result.output.strip()


@pytest.mark.parametrize("version", ["2", "3"])
def test_writes_a_unit(tmp_path, version):
    path = tmp_path / "servo.fmu"
    assert _export("backlash_servo", "-o", str(path), "--fmi", version) == (0, f"{path}: written.")
    with zipfile.ZipFile(path) as unit:
        assert f'fmiVersion="{version}.0"' in unit.read("modelDescription.xml").decode()


@pytest.mark.parametrize(
    ("arguments", "why"),
    [
        (("backlash_servo", "-o", "a.fmu", "--fmi", "1"), "export: version is 1; expected 2 or 3."),
        (("backlash_servo", "-o", "a.zip"), "cannot write a file that ends in '.zip'; expected one of .fmu."),
        (("backlash_discrete_pi", "-o", "a.fmu"), "is in discrete time; expected a loop in continuous time."),
    ],
)
def test_refusals_are_one_sentence(tmp_path, monkeypatch, arguments, why):
    monkeypatch.chdir(tmp_path)
    code, said = _export(*arguments)
    assert code == 2 and said.endswith(why) and not list(tmp_path.iterdir())
