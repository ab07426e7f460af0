"""The shell commands of the README and of the documentation run as they stand there."""

from __future__ import annotations

import math
import re
import shlex
from pathlib import Path

import pytest
from typer.testing import CliRunner

import eppanalysis as epp
from eppanalysis.cli.commands import app
from tests.cli.test_main import TRUTH_TABLE
from tests.shared import draw_few

ROOT = Path(__file__).parent.parent
PAGES = sorted([*(ROOT / "docs").glob("*.md"), *(ROOT / "docs").glob("[a-z]*/*.md")])
#: A block of commands, and what the page shows of the output of the last one.
BLOCK = re.compile(r"^```sh\n(.*?)^```$(?:\n\n```text\n(.*?)^```)?", re.MULTILINE | re.DOTALL)
TOML = re.compile(r"^```toml\n(.*?)^```$", re.MULTILINE | re.DOTALL)
#: A file that a page tells its reader to save.
FILE = re.compile(r"^```toml\n(# (\w+\.toml)\n.*?)^```$", re.MULTILINE | re.DOTALL)

#: Code in a block, and what stands before it: as much as fits beside the bars of a page at 1400 pixels.
CODE, WIDEST = re.compile(r"^```(python|sh|toml)\n(.*?)^```$", re.MULTILINE | re.DOTALL), 98


def test_no_line_of_code_is_broken_by_the_page():
    for page in PAGES:
        for language, block in CODE.findall(page.read_text(encoding="utf-8")):
            session = language == "python" and block.startswith(">>>")
            code = [line for line in block.splitlines() if not session or line.startswith((">>>", "..."))]
            assert not [line for line in code if len(line) > WIDEST]


def commands() -> list[tuple[Path, str, str]]:
    """Page, line and shown output of every command in a block; of one that stands on several pages the first."""
    found: dict[tuple[str, ...], tuple[Path, str, str]] = {}
    for page in PAGES:
        for block, shown in BLOCK.findall(page.read_text(encoding="utf-8")):
            lines = [line for line in block.replace("\\\n", " ").splitlines() if line]
            for i, line in enumerate(lines):
                found.setdefault(tuple(shlex.split(line)), (page, line, shown if i == len(lines) - 1 else ""))
    return list(found.values())


def readme_blocks() -> list[str]:
    return [block.strip() for block, _ in BLOCK.findall((ROOT / "README.md").read_text(encoding="utf-8"))]


def is_truth_table(command: str) -> bool:
    """The longest command of the pages; ``test_cli`` runs it and reads what it prints."""
    return shlex.split(command)[1:] == TRUTH_TABLE


def test_the_command_that_is_run_elsewhere_stands_in_the_pages():
    assert any(is_truth_table(command) for _, command, _ in commands())


@pytest.mark.slow
@pytest.mark.parametrize(
    ("page", "command", "shown"),
    [pytest.param(*c, id=f"{c[0].stem}-{c[1]}") for c in commands() if not is_truth_table(c[1])],
)
def test_command_of_the_documentation_runs_and_prints_what_the_page_shows(tmp_path, monkeypatch, page, command, shown):
    program, *arguments = shlex.split(command)
    assert program == "eppanalysis", f"{page}: only commands of the package stand in blocks that are run"
    for text, name in FILE.findall(page.read_text(encoding="utf-8")):
        (tmp_path / name).write_text(text, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    if arguments[0] == "identify":
        draw_few(monkeypatch)
    result = CliRunner().invoke(app, arguments)
    assert result.exit_code == 0, result.output
    printed = " ".join(result.output.split())
    for line in shown.splitlines():
        assert " ".join(line.split()) in printed


def cases_of_pages() -> list[tuple[Path, str]]:
    """Page and text of every whole case file that a page shows."""
    blocks = [(page, text) for page in PAGES for text in TOML.findall(page.read_text(encoding="utf-8"))]
    return [block for block in blocks if {"kind", "title"} <= set(re.findall(r"^(\w+) = ", block[1], re.MULTILINE))]


@pytest.mark.parametrize(("page", "text"), cases_of_pages(), ids=lambda value: getattr(value, "stem", ""))
def test_linear_loop_of_a_case_that_a_page_shows_is_damped(page, text):
    found = epp.margins(epp.case_from_text(text, name=page.stem))
    assert found.stable and found.phase_margin > math.radians(20.0)


def test_rows_that_the_page_on_identification_shows_stand_in_a_file_that_ships():
    page = (ROOT / "docs" / "howto" / "identify.md").read_text(encoding="utf-8")
    name, shown = re.search(r"From `(\w+\.csv)`.*?```\n(.*?)^```", page, re.MULTILINE | re.DOTALL).groups()
    head, *rows = shown.splitlines()
    lines = (ROOT / "cases" / "measured" / name).read_text(encoding="utf-8").splitlines()
    assert lines[0] == head
    assert "\n".join(rows) in "\n".join(lines)


def test_readme_begins_with_its_two_commands():
    main_job, tests = readme_blocks()
    assert "pip install" in main_job
    assert "eppanalysis validate" in main_job
    assert "pip install" in tests
    assert tests.endswith("pytest -n auto")


def test_first_screen_of_the_readme_holds_both_commands():
    lines = (ROOT / "README.md").read_text(encoding="utf-8").splitlines()
    assert max(i for i, line in enumerate(lines) if line.startswith("```sh")) < 24
