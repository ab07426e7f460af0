"""The command ``eppanalysis certify``."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from eppanalysis.cli.commands import app


def run(*args: str) -> tuple[int, str]:
    result = CliRunner().invoke(app, ["certify", *args])
    return result.exit_code, result.output


def test_roots_are_written_and_checked(tmp_path: Path) -> None:
    file = str(tmp_path / "roots.json")
    code, text = run("backlash_servo", "--statement", "roots", "-o", file)
    assert code == 0 and "exactly 2 roots" in text and "1.05569530823" in text
    code, text = run("--check", file)
    assert code == 0 and text.startswith(
        "Proved: the describing function has exactly 2 roots for the loop in the file;"
    )
    code, text = run("backlash_servo", "--check", file)
    assert code == 0 and text.startswith("Proved: the describing function has exactly 2 roots for backlash servo;")
    for other in (["backlash_servo", "--set", "loop.gain=1.01"], ["relay_deadzone"], ["fig8a_original"]):
        code, text = run(*other, "--check", file)
        assert code == 1 and "not about" in text and "Traceback" not in text


def test_absence_is_written_and_checked_and_a_changed_gain_refused(tmp_path: Path) -> None:
    file = tmp_path / "absence.json"
    code, text = run("sat_am165", "--set", "loop.gain=0.5", "--statement", "absence", "-o", str(file))
    assert code == 0 and "no periodic motion but rest" in text and "with loop.gain = 0.5" in text
    file.write_text(file.read_text().replace('"9/2"', '"4"'))
    code, text = run("--check", str(file))
    assert code == 1 and "refused: a file that was changed" in text


def test_absence_with_play_is_written_checked_and_drawn(tmp_path: Path) -> None:
    file, picture = tmp_path / "absence.json", tmp_path / "level.png"
    for output in (file, picture):
        code, text = run("backlash_servo", "--set", "loop.gain=0.5", "--statement", "absence", "-o", str(output))
        assert code == 0 and "backlash servo has no periodic motion but rest, for any gap" in text.replace("\n", " ")
    assert picture.stat().st_size > 1000
    code, text = run("--check", str(file))
    assert code == 0 and text.startswith("Proved: the loop in the file has no periodic motion but rest, for any gap")
    code, text = run("backlash_servo", "--set", "loop.gain=0.5", "--check", str(file))
    assert code == 0 and text.startswith("Proved: backlash servo has no periodic motion but rest, for any gap")
    code, text = run("backlash_servo", "--check", str(file))
    assert code == 1 and "its numerator is" in text
    file.write_text(file.read_text().replace('"5/2"', '"5"'))
    code, text = run("--check", str(file))
    assert code == 1 and "refused: a file that was changed" in text


def test_one_file_for_a_range_of_gains(tmp_path: Path) -> None:
    file = tmp_path / "range.json"
    code, text = run("backlash_servo", "--within", "loop.gain 0.01..0.5", "-o", str(file))
    assert code == 0 and "backlash servo with loop.gain from 0.01 to 0.5 has no periodic motion" in text.replace(
        "\n", " "
    )
    for gain, expected in (("0.3", 0), ("0.51", 1)):
        assert run("backlash_servo", "--set", f"loop.gain={gain}", "--check", str(file))[0] == expected


def test_what_is_not_decided_is_a_result_but_no_file(tmp_path: Path) -> None:
    code, text = run("sat_am165", "--statement", "absence")
    assert code == 0 and "Not decided" in text
    code, text = run("sat_am165", "--statement", "absence", "-o", str(tmp_path / "none.json"))
    assert code == 2 and "no certificate to write" in text and not list(tmp_path.iterdir())


def test_json_and_pictures(tmp_path: Path) -> None:
    picture = tmp_path / "cover.png"
    code, text = run("relay_deadzone", "--json", "-o", str(picture))
    result = json.loads(text)["cases"][0]["result"]
    assert code == 0 and result["proved"] and len(result["roots"]) == 2 and picture.stat().st_size > 1000


@pytest.mark.parametrize(
    ("args", "why"),
    [
        ([], "there is no case"),
        (
            ["sat_am165", "--statement", "presence"],
            "--statement presence: is not known; expected one of roots, absence, cycles",
        ),
        (["sat_am165", "--json", "--check", "x.json"], "expected it alone"),
        (["sat_am165", "--statement", "roots", "--check", "x.json"], "expected it alone"),
        (["--set", "loop.gain=1", "--check", "x.json"], "--set is given without a case"),
        (["sat_am165", "--within", "loop.gain"], 'expected "FIELD LOW..HIGH"'),
        (["sat_am165", "--within", "loop.gian 1..2"], "did you mean 'loop.gain'"),
        (["sat_am165", "--within", "loop.gain 1 m..2 m"], "--within"),
        (["sat_am165", "--within", "loop.gain 2..1"], "expected low < high"),
        (["sat_am165", "--statement", "roots", "--within", "loop.gain 1..2"], "within is of absence"),
        (["sat_am165", "--within", "loop.gain 1..2", "--check", "x.json"], "expected it alone"),
        (["--check", "nowhere.json"], "expected the file of a certificate"),
        (["sat_am165", "-o", "roots.csv"], "roots.csv"),
    ],
)
def test_wrong_arguments_end_in_a_sentence(args: list[str], why: str) -> None:
    code, text = run(*args)
    assert code == 2 and why in text and "Traceback" not in text
