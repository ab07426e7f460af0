"""The shell commands of the README and of the documentation run as they stand there."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import pytest
from typer.testing import CliRunner

from eppanalysis.cli import app
from tests.cli.test_main import TRUTH_TABLE

ROOT = Path(__file__).parent.parent
PAGES = sorted([*(ROOT / "docs").glob("*.md"), *(ROOT / "docs").glob("[a-z]*/*.md")])
BLOCK = re.compile(r"^```sh\n(.*?)^```", re.MULTILINE | re.DOTALL)


def commands() -> list[tuple[str, str]]:
    """Page and line of every command in a block of shell commands; of one that stands on several pages the first."""
    found: dict[tuple[str, ...], tuple[str, str]] = {}
    for page in PAGES:
        for block in BLOCK.findall(page.read_text(encoding="utf-8")):
            for line in filter(None, block.replace("\\\n", " ").splitlines()):
                found.setdefault(tuple(shlex.split(line)), (page.stem, line))
    return list(found.values())


def readme_blocks() -> list[str]:
    return [block.strip() for block in BLOCK.findall((ROOT / "README.md").read_text(encoding="utf-8"))]


def is_truth_table(command: str) -> bool:
    """The longest command of the pages; ``test_cli`` runs it and reads what it prints."""
    return shlex.split(command)[1:] == TRUTH_TABLE


def test_the_command_that_is_run_elsewhere_stands_in_the_pages():
    assert any(is_truth_table(command) for _, command in commands())


@pytest.mark.parametrize(("page", "command"), [c for c in commands() if not is_truth_table(c[1])])
def test_command_of_the_documentation_runs(tmp_path, monkeypatch, page, command):
    program, *arguments = shlex.split(command)
    assert program == "eppanalysis", f"{page}: only commands of the package stand in blocks that are run"
    monkeypatch.chdir(tmp_path)
    result = CliRunner().invoke(app, arguments)
    assert result.exit_code == 0, result.output


def test_readme_begins_with_its_two_commands():
    main_job, tests = readme_blocks()
    assert "pip install" in main_job
    assert "eppanalysis validate" in main_job
    assert "pip install" in tests
    assert tests.endswith("pytest -n auto")


def test_first_screen_of_the_readme_holds_both_commands():
    lines = (ROOT / "README.md").read_text(encoding="utf-8").splitlines()
    assert max(i for i, line in enumerate(lines) if line.startswith("```sh")) < 24
