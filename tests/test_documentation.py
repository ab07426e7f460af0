"""The shell commands of the README and of the documentation run as they stand there."""

from __future__ import annotations

import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
PAGES = sorted([*(ROOT / "docs").glob("*.md"), *(ROOT / "docs").glob("[a-z]*/*.md")])
BLOCK = re.compile(r"^```sh\n(.*?)^```", re.MULTILINE | re.DOTALL)


def commands() -> list[tuple[str, str]]:
    """Page and line of every command in a block of shell commands."""
    found = []
    for page in PAGES:
        for block in BLOCK.findall(page.read_text(encoding="utf-8")):
            found += [(page.stem, line) for line in block.replace("\\\n", " ").splitlines() if line]
    return found


def readme_blocks() -> list[str]:
    return [block.strip() for block in BLOCK.findall((ROOT / "README.md").read_text(encoding="utf-8"))]


@pytest.mark.parametrize(("page", "command"), commands())
def test_command_of_the_documentation_runs(tmp_path, page, command):
    program, *arguments = shlex.split(command)
    assert program == "eppanalysis", f"{page}: only commands of the package stand in blocks that are run"
    environment = {**os.environ, "MPLBACKEND": "Agg"}
    call = [sys.executable, "-m", "eppanalysis", *arguments]
    result = subprocess.run(call, cwd=tmp_path, env=environment, check=False, capture_output=True, text=True)
    assert result.returncode == 0, result.stderr


def test_readme_begins_with_its_two_commands():
    main_job, tests = readme_blocks()
    assert "pip install" in main_job
    assert "eppanalysis validate" in main_job
    assert "pip install" in tests
    assert tests.endswith("pytest -n auto")


def test_first_screen_of_the_readme_holds_both_commands():
    lines = (ROOT / "README.md").read_text(encoding="utf-8").splitlines()
    assert max(i for i, line in enumerate(lines) if line.startswith("```sh")) < 24
