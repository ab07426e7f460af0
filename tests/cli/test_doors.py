"""What commands say at the doors: what cannot begin, signs that an encoding lacks, and nothing but sentences."""

from __future__ import annotations

import io
import json
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner

import eppanalysis as epp
from eppanalysis.cli import main
from eppanalysis.cli.commands import app

#: Files of valid fields whose run cannot begin, and words of why.
NO_RUN = {
    "a loop without one answer": ("wheelchair", {"loop.blocks.4.num.0": 1e20}, "no unique solution"),
    "a tiny dead time": ("relay_fopdt_closed", {"loop.delay": "5e-13 s"}, "is nothing beside"),
    "numbers beyond all range": ("van_der_pol_mu1", {"loop.den.1": 1e300}, "beyond all range"),
    "samples without end": ("backlash_discrete_pi_kp05_ki01", {"run.t_end": "1e12 s"}, "at most 2000000"),
}


def changed(name: str, changes: dict[str, object], path: Path) -> Path:
    """The file of a shipped case with other values, written without the door that refuses them."""
    import tomllib

    from eppanalysis.cases.values.toml import write_toml

    data = tomllib.loads(epp.case(name).to_toml())
    for field, value in changes.items():
        holder, (*places, last) = data, field.split(".")
        for part in places:
            holder = holder[int(part) if part.isdigit() else part]
        holder[int(last) if last.isdigit() else last] = value
    path.write_text(write_toml(data), encoding="utf-8")
    return path


@pytest.mark.parametrize("what", NO_RUN)
def test_check_says_what_simulate_would_say(tmp_path: Path, what: str) -> None:
    name, changes, said = NO_RUN[what]
    path = changed(name, changes, tmp_path / "mine.toml")
    simulated, checked = (CliRunner().invoke(app, [command, str(path)]) for command in ("simulate", "check"))
    assert simulated.exit_code == checked.exit_code == 2
    assert checked.stderr.splitlines()[-1] == f"{path}: {simulated.stderr.splitlines()[-1]}"
    assert said in checked.stderr and "valid" not in checked.stdout


@pytest.mark.parametrize("file", ["", "{"])
def test_one_file_that_cannot_run_keeps_no_other_from_being_checked(tmp_path: Path, file: str) -> None:
    path = changed(*NO_RUN["a loop without one answer"][:2], tmp_path / "mine.toml")
    (tmp_path / "broken.toml").write_text(file)
    found = CliRunner().invoke(app, ["check", str(path), str(tmp_path / "broken.toml"), "backlash_servo"])
    assert found.exit_code == 2 and len(found.stderr.strip().splitlines()) == 2
    assert "backlash_servo: valid" in found.stdout


@pytest.mark.parametrize("encoding", ["ascii", "cp1251", "cp932", "gbk", "utf-8"])
@pytest.mark.parametrize(
    "command",
    [
        ("check", "fig8a_original"),
        ("check", "fig8a_original", "--json"),
        ("check", "mine.toml"),
        ("check", "typo.toml"),
        ("check", "mine.toml", "--json"),
        ("simulate", "mine.toml", "--json"),
        ("simulate", "mine.toml"),
        ("margins", "mine.toml"),
        ("cases",),
        ("cases", "--json"),
        ("simulate", "--help"),
    ],
    ids=" ".join,
)
def test_signs_that_an_encoding_lacks_are_written_otherwise(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, command: tuple[str, ...], encoding: str
) -> None:
    """A name in several alphabets, a unit with a dot, a table with lines: what is written can be written."""
    title = "Größe ω² ≤ 3 N·m, Δ ж 漢 ☃ 𝄞"
    text = epp.case("backlash_servo").with_values({"title": title}).to_toml()
    (tmp_path / "mine.toml").write_text(text, encoding="utf-8")
    (tmp_path / "typo.toml").write_text(text.replace("gap", "gäp☃"), encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    out, err = (io.TextIOWrapper(io.BytesIO(), encoding=encoding, errors="strict") for _ in range(2))
    monkeypatch.setattr(sys, "stdout", out)
    monkeypatch.setattr(sys, "stderr", err)
    monkeypatch.setattr(sys, "argv", ["eppanalysis", *command])
    with pytest.raises(SystemExit) as ended:
        main()
    for stream in (out, err):
        stream.flush()
    # The library of the command line takes ASCII for an environment that nobody has set up, and writes UTF-8.
    written, told = (s.buffer.getvalue().decode("utf-8" if encoding == "ascii" else encoding) for s in (out, err))
    assert ended.value.code == (2 if "typo.toml" in command else 0), told
    assert "Traceback" not in told + written
    if "--json" in command:
        found = json.loads(written)["cases"]
        assert "mine.toml" not in command or found[0]["title"] == title
    elif "mine.toml" in command:
        assert "3 N" in written
