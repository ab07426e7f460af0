"""Case files that mean harm: one sentence each, in good time; nothing outside the folder is read, nothing is obeyed."""

from __future__ import annotations

import os
import time
from pathlib import Path

import pytest

import eppanalysis as epp
from eppanalysis.cases.files import LARGEST_FILE
from eppanalysis.errors import CaseError

BASE = 'base = "fig8a_original"\n'
LONGEST_SENTENCE = 700

HOSTILE = {
    "a key of 300 000 letters": BASE + "k" * 300_000 + " = 1",
    "a field of 300 000 letters": BASE + "[lock_pin]\n" + "k" * 300_000 + " = 1",
    "a title of 900 000 letters": BASE + f'title = "{"t" * 900_000}"',
    "a number of 900 000 digits": BASE + f'lock_pin.backlash = "{"9" * 900_000} deg"',
    "a whole number of 90 000 digits": BASE + f"pulley.friction = {'9' * 90_000}",
    "a base of 900 000 letters": f'base = "{"b" * 900_000}"',
    "90 000 keys": BASE + "".join(f"k{i} = 1\n" for i in range(90_000)),
    "20 000 elements": "kind = 'loop'\ntitle = 'x'\n" + "[[loop.elements]]\nelement = 'play'\n" * 20_000,
    "lists 50 000 deep": BASE + "x = " + "[" * 50_000 + "]" * 50_000,
    "tables 5 000 deep": BASE + "a." * 5_000 + "a = 1",
    "inline tables 5 000 deep": BASE + "x = " + "{a=" * 5_000 + "1" + "}" * 5_000,
    "too large a file": BASE + "#" * LARGEST_FILE,
    "terminal commands in a title": BASE + 'title = "\\u001b[2J\\u001b]0;title\\u0007"',
    "terminal commands in a note": BASE + 'lock_pin.backlash = {value = "1 deg", note = "\\u001b[31m"}',
    "terminal commands in a key": BASE + '"\\u001b[2J" = 1',
    "a call for a unit": BASE + "lock_pin.backlash = \"1 __import__('os').getcwd()\"",
    "a tower of powers": BASE + 'lock_pin.backlash = "1 m**9**9**9"',
    "a unit that a pattern may stumble over": BASE + f'lock_pin.backlash = "1 {"m " * 39}"',
    "not a number": BASE + "pulley.friction = nan",
    "infinity": BASE + "pulley.friction = inf",
}


@pytest.mark.parametrize("what", HOSTILE)
def test_a_hostile_file_is_one_sentence(tmp_path, what):
    path = tmp_path / "case.toml"
    path.write_text(HOSTILE[what], encoding="utf-8")
    begin = time.process_time()
    with pytest.raises(CaseError) as caught:
        epp.read_case(path)
    assert time.process_time() - begin < 5.0
    said = str(caught.value).removeprefix(str(path))
    assert len(said) < LONGEST_SENTENCE and "expected" in said
    assert said.isprintable()


@pytest.mark.parametrize("what", ["a title of 900 000 letters", "lists 50 000 deep", "terminal commands in a title"])
def test_a_hostile_text_is_one_sentence_too(what):
    with pytest.raises(CaseError):
        epp.case_from_text(HOSTILE[what])


@pytest.fixture
def secret(tmp_path) -> Path:
    """A valid case and a recording outside the folder of the case."""
    outside, inside = tmp_path / "outside", tmp_path / "inside"
    outside.mkdir()
    inside.mkdir()
    (outside / "secret.toml").write_text(BASE + 'title = "secret"')
    (outside / "secret.csv").write_text("time [s],position [m]\n0,0\n1,0.1\n")
    return inside


BASES = [
    "../outside/secret",
    "..\\outside\\secret",
    "./../outside/secret",
    "{outside}/secret",
    "file://{outside}/secret",
]


@pytest.mark.parametrize(
    "base", [*BASES, "..", ".", "", "secret\0", "~/secret", "$HOME/secret", "link", "linked/secret"]
)
def test_no_base_leads_out_of_the_folder(secret, base):
    outside = secret.parent / "outside"
    os.symlink(outside / "secret.toml", secret / "link.toml")
    os.symlink(outside, secret / "linked")
    text = base.replace("{outside}", str(outside)).replace("\\", "\\\\").replace("\0", "\\u0000")
    (secret / "case.toml").write_text(f'base = "{text}"\n')
    with pytest.raises(CaseError, match="base is .*; expected"):
        epp.read_case(secret / "case.toml")
    with pytest.raises(CaseError, match="base is .*; expected"):
        epp.case_from_text(f'base = "{text}"\n', folder=secret)


@pytest.mark.parametrize(
    "file", ["../outside/secret.csv", "/etc/passwd", "link.csv", "linked/secret.csv", "case.toml/.."]
)
def test_no_recording_is_read_from_elsewhere(secret, file):
    outside = secret.parent / "outside"
    os.symlink(outside / "secret.csv", secret / "link.csv")
    os.symlink(outside, secret / "linked")
    (secret / "case.toml").write_text(BASE + f'[run.input]\nkind = "recorded"\nfile = "{file}"\n')
    with pytest.raises(CaseError, match=r"run.input.file is .*; expected"):
        epp.read_case(secret / "case.toml")


@pytest.mark.parametrize("name", ["../x", "/x", "", "a/b", "a\0", "x" * 200, ".hidden"])
def test_names_of_texts_are_plain(name):
    with pytest.raises(CaseError, match="expected a plain name"):
        epp.case_from_text(BASE, name=name)


def test_a_shipped_name_is_no_path():
    for name in ("../cases/elbow", "elbow.toml", "/etc/passwd", "elbow\0"):
        with pytest.raises(CaseError):
            epp.case(name)


def test_a_pipe_in_place_of_a_file_is_refused_at_once(tmp_path):
    os.mkfifo(tmp_path / "pipe.toml")
    with pytest.raises(CaseError, match="not a file"):
        epp.read_case(tmp_path / "pipe.toml")
