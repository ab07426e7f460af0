"""The command new: every file that it writes is read, and runs; questions on a terminal; nothing is half written."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner

import eppanalysis as epp
from eppanalysis.cases.drafts import DRAFTS, Draft
from eppanalysis.cli.commands import app
from eppanalysis.cli.new import Machine


def new(*words: str) -> tuple[int, str]:
    found = CliRunner().invoke(app, ["new", *words])
    return found.exit_code, found.stdout + found.stderr


@pytest.mark.parametrize("kind", DRAFTS)
def test_what_is_written_is_checked_predicted_and_simulated(kind: str, tmp_path: Path) -> None:
    """By the commands that are printed; a run of each comes to an answer."""
    path = tmp_path / "mine.toml"
    code, said = new(str(path), "--kind", kind)
    steps = [line.split()[1] for line in said.splitlines() if line.startswith("  eppanalysis ")]
    assert code == 0 and steps == ["check", "predict", "simulate"]
    for step in steps:
        answered = CliRunner().invoke(app, [step, str(path)])
        assert answered.exit_code == 0, answered.stderr
        assert answered.stderr == ""  # nothing is remarked either
    assert epp.simulate(epp.read_case(path)).status is epp.Status.LIMIT_CYCLE


@pytest.mark.parametrize("kind", DRAFTS)
def test_six_questions_of_each_kind_and_their_numbers_are_fields(kind: str) -> None:
    """What a thing is, and five numbers, each of which the file takes by its name and prints."""
    draft = Draft(kind)
    assert len(draft.questions) == 5 and all(len(question.about) < 80 for question in draft.questions)
    case = epp.case_from_text(draft.text)
    for question in draft.questions:
        assert case.si(question.name, question.value) == case.value(question.name)
        assert draft.with_numbers({question.name: question.value}).count(question.about) == 1


def test_the_kinds_are_those_of_the_drafts() -> None:
    assert tuple(Machine) == DRAFTS


def test_numbers_are_written_as_they_are_given(tmp_path: Path) -> None:
    path = tmp_path / "servo.toml"
    code, said = new(str(path), "--kind", "servo", "--set", "ratio=36:1", "--set", "backlash=0.2 deg")
    assert code == 0 and "Plausible, not yours: resistance, torque_constant, J_load" in said
    text = path.read_text(encoding="utf-8")
    assert 'ratio = "36:1"  # Gear' in text and 'backlash = "0.2 deg"  # Gear' in text
    assert epp.read_case(path).value("ratio") == 36.0
    every = [word for question in Draft("servo").questions for word in ("--set", f"{question.name}={question.value}")]
    code, said = new(str(path), "--kind", "servo", "--force", *every)
    assert code == 0 and "Plausible, not yours: what the comments name." in said


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ([], "--kind: is missing; expected one of servo, thermostat, valve, two-mass, elbow."),
        (["--set", "ratio=3"], "--kind: is missing"),
        (["--kind", "sero"], "--kind sero: is not known; expected one of servo"),
        (["--kind", "servo", "--set", "ratioo=3"], "--set: ratioo is '3'; expected a number of a servo: did you mean"),
        (["--kind", "servo", "--set", "backlash=0.2"], "expected a quantity with its unit, such as '0.1 deg'."),
        (["--kind", "servo", "--set", "backlash=2 mm"], "--set: backlash is '2 mm'; expected an angle"),
        (["--kind", "servo", "--set", "backlash=2 dog"], "backlash is '2 dog'; expected a known unit"),
        (["--kind", "servo", "--set", "J_load=-1 kg*m^2"], "--set: J_load is '-1 kg*m^2'; expected a positive number."),
        (["--kind", "servo", "--set", "ratio=0"], "--set: ratio is '0'; expected a number other than zero."),
        (["--kind", "servo", "--set", "ratio=-36:1"], "--set: ratio is '-36:1'; expected a value with which blocks."),
        (["--kind", "servo", "--set", "ratio"], "lacks a field"),
    ],
)
def test_what_is_refused_leaves_no_file(words: list[str], said: str, tmp_path: Path) -> None:
    code, found = new(str(tmp_path / "a.toml"), *words)
    assert code == 2 and said in found
    assert list(tmp_path.iterdir()) == []


def test_a_file_is_replaced_by_force_alone(tmp_path: Path) -> None:
    path = tmp_path / "a.toml"
    path.write_text("mine", encoding="utf-8")
    code, said = new(str(path), "--kind", "valve")
    assert code == 2 and "is there already; expected a new name, or --force." in said
    assert path.read_text(encoding="utf-8") == "mine"
    code, said = new(str(path), "--kind", "servo", "--force", "--set", "backlash=2 mm")
    assert code == 2 and path.read_text(encoding="utf-8") == "mine"
    assert new(str(path), "--kind", "valve", "--force")[0] == 0
    assert epp.read_case(path).title == "Level loop with a valve that sticks"


def test_another_ending_and_a_folder_that_is_not_there_are_refused(tmp_path: Path) -> None:
    assert new(str(tmp_path / "a.txt"), "--kind", "servo")[0] == 2
    assert new(str(tmp_path / "none" / "a.toml"), "--kind", "servo")[0] == 2


def typed(text: str, path: Path) -> tuple[int, str]:
    """What the command says on a terminal on which a user types."""
    pty = pytest.importorskip("pty")
    ours, theirs = pty.openpty()
    command = [sys.executable, "-m", "eppanalysis", "new", str(path)]
    with subprocess.Popen(command, stdin=theirs, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True) as run:
        os.write(ours, text.encode())
        said, _ = run.communicate(timeout=60)
    os.close(ours)
    os.close(theirs)
    return run.returncode, said


def test_questions_on_a_terminal(tmp_path: Path) -> None:
    """Enter takes the default; what is not taken is asked once more."""
    path = tmp_path / "servo.toml"
    code, said = typed("serrvo\nservo\n1.4 ohm\n\n36:1\n2 mm\n0.2 deg\n\n", path)
    assert code == 0, said
    assert said.count("What is it: servo, thermostat, valve, two-mass, elbow [servo]: ") == 2
    assert said.count("Gear: backlash at the output, from stop to stop [0.1 deg]: ") == 2
    assert "backlash is '2 mm'; expected an angle" in said and "Next:" in said
    found = epp.read_case(path)
    assert (found.value("ratio"), found.value("resistance"), found.value("torque_constant")) == (36.0, 1.4, 0.05)


def test_questions_that_are_not_answered_leave_no_file(tmp_path: Path) -> None:
    code, said = typed("servo\n\n\x04", tmp_path / "servo.toml")
    assert code == 2 and "Nothing is written." in said
    assert list(tmp_path.iterdir()) == []
