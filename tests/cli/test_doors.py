"""What commands say at the doors: what cannot begin, signs that an encoding lacks, and nothing but sentences."""

from __future__ import annotations

import io
import json
import os
import shlex
import subprocess
import sys
from contextlib import suppress
from pathlib import Path

import pytest
from typer.testing import CliRunner

import eppanalysis as epp
from eppanalysis.cli import main
from eppanalysis.cli.commands import app
from tests.shared import mostly_slow

#: Files of valid fields whose run cannot begin, and words of why.
NO_RUN = {
    "a loop without one answer": ("wheelchair", {"loop.blocks.4.num.0": 1e20}, "no unique solution"),
    "a tiny dead time": ("relay_fopdt_closed", {"loop.delay": "5e-13 s"}, "is negligible beside"),
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


@pytest.mark.parametrize(
    ("name", "changes"),
    [
        ("two_mass_damped_shaft", {"loop.C.1.3": 0}),
        ("two_mass_damped_shaft", {"loop.C.2.4": 0.5}),
        ("two_mass_damped_shaft_classical", {"loop.C.1.3": -2}),
        ("belt_leine", {"loop.A.0.0": 1e300}),
    ],
)
def test_check_says_what_predict_would_refuse(tmp_path: Path, name: str, changes: dict[str, object]) -> None:
    """A run can begin and a search may find cycles: the case is valid, and has no describing function."""
    path = changed(name, changes, tmp_path / "mine.toml")
    predicted, checked, plain = (
        CliRunner().invoke(app, [*command, str(path)]) for command in (("predict",), ("check", "--json"), ("check",))
    )
    assert (predicted.exit_code, checked.exit_code) == (2, 0)
    said = predicted.stderr.strip()
    assert json.loads(checked.stdout)["cases"][0]["result"]["not_predicted"] == said
    assert f"The command predict refuses it: {said}" in plain.stdout


@pytest.mark.parametrize("file", ["", "{"])
def test_one_file_that_cannot_run_keeps_no_other_from_being_checked(tmp_path: Path, file: str) -> None:
    path = changed(*NO_RUN["a loop without one answer"][:2], tmp_path / "mine.toml")
    (tmp_path / "broken.toml").write_text(file)
    found = CliRunner().invoke(app, ["check", str(path), str(tmp_path / "broken.toml"), "backlash_servo"])
    assert found.exit_code == 2 and len(found.stderr.strip().splitlines()) == 2
    assert "backlash_servo: valid" in found.stdout


ENCODINGS = ("ascii", "cp1251", "cp932", "gbk", "utf-8")
WRITTEN = (
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
)


@pytest.mark.parametrize(
    ("command", "encoding"),
    mostly_slow(
        [(command, encoding) for command in WRITTEN for encoding in ENCODINGS],
        [(command, ENCODINGS[i % len(ENCODINGS)]) for i, command in enumerate(WRITTEN)],
    ),
    ids=lambda given: given if isinstance(given, str) else " ".join(given),
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


@pytest.mark.parametrize(
    ("name", "value"), [("MPLBACKEND", "nonsense"), ("SOURCE_DATE_EPOCH", "abc"), ("TERMINAL_WIDTH", "wide")]
)
def test_what_libraries_cannot_read_of_the_environment_ends_no_command(tmp_path: Path, name: str, value: str) -> None:
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(p for p in sys.path if p)}
    command = [sys.executable, "-m", "eppanalysis", "predict", "relay_deadzone", "-o", "curves.pdf"]
    files = []
    for more, options in (({}, command), ({name: value}, command), ({name: value}, [*command, "--help"])):
        given = {"env": {**environment, **more}, "cwd": tmp_path, "capture_output": True}
        ended = subprocess.run(options, check=False, timeout=60, **given)
        assert (ended.returncode, ended.stderr) == (0, b"")
        files.append((tmp_path / "curves.pdf").read_bytes())
    assert files[1] == files[0]


TUNED = ("design", "backlash_servo", "--tune", "loop.gain 1..2")
GOAL = (*TUNED, "--maximise", "loop.gain")
BOUNDED = ("bounds", "backlash_servo", "--over", "loop.gain", "--limit", "play.gap")
SERVO_SWEEP = ("sweep", "backlash_servo", "--axis", "play.gap=1:2:2")


def needs(command: str) -> None:
    """Skip where an extra of a command is not installed."""
    for library in ("dask", "zarr") if command == "sweep" else ():
        pytest.importorskip(library)


@pytest.mark.parametrize(
    ("command", "said"),
    [
        (TUNED, "design: neither --maximise nor --minimise is given; expected one of the two."),
        ((*GOAL, "--minimise", "play.gap"), "design: both --maximise and --minimise are given; expected one"),
        ((*GOAL, "--margin", "2"), "--margin is 2.0; expected a share between 0 and 0.5."),
        ((*GOAL, "--starts", "0"), "--starts is 0; expected 1 or more."),
        ((*GOAL, "--allow", "z 3"), "--allow: the loop has no signal 'z'; expected a signal of it: one of x, y."),
        ((*GOAL, "--subject-to", "phase_margin 3 m"), "--subject-to: phase_margin is '3 m'; expected an angle"),
        ((*GOAL, "--front", "loop.gain 1,2"), "--front runs over loop.gain, which is tuned; expected another"),
        ((*GOAL, "--tolerance", "play.gap 5"), "tolerance of play.gap: at one end of it play.gap is -3; expected"),
        ((*GOAL, "--starts", "1e3"), "--starts 1e3: is no number; expected a whole number."),
        (("response", "backlash_servo", "--amplitude", "1", "--frequency", "1"), "response: backlash_servo has no ext"),
        (("identify", "fig8a_original"), "no measured file is given; expected --tray, --backlash or --step."),
        ((*GOAL, "--tune", "loop.gain 1..3"), "--tune loop.gain: is given twice; expected it once."),
        ((*BOUNDED, "--within", "-1..2"), "bounds: play.gap is -1.0; expected zero or more."),
        ((*BOUNDED, "--own-run"), "--own-run is given for a loop whose bounds are folds; expected a loop whose"),
        ((*BOUNDED, "--within", "2..1"), "--within is 2 to 1; expected low < high"),
        ((*BOUNDED, "--set", "play.gap=0"), "--within is not given, and play.gap is 0 in this case; expected a range"),
        ((*BOUNDED, "--seed=-1"), "--seed is -1; expected 0 or more."),
        ((*SERVO_SWEEP, "--chunk", "0"), "--chunk is 0; expected a whole number of cells, 1 or more."),
        ((*SERVO_SWEEP, "--shard", "1/2"), "--shard is given without a store; expected the name of one (.zarr)."),
        ((*SERVO_SWEEP, "--scheduler", "foo"), "--scheduler is 'foo'; expected 'threads'"),
        (("branch", "backlash_servo", "--over", "foo", "--from", "1", "--to", "2"), "foo is 'not known'; expected a"),
        (("guide", "backlash_servo"), "--over is not given, and guidelines of backlash_servo have no"),
        (("guide", "backlash_servo", "--over", "play.gap"), "no usual one; expected a parameter, such as loop.gain."),
        ((*BOUNDED, "--from", "foo"), "--from: loop.gain is 'foo'; expected a number with or without a unit."),
        ((*BOUNDED, "--points", "1", "--to", "1 m"), "--to: loop.gain is '1 m'; expected a quantity in plain numbers."),
        ((*BOUNDED, "--within", "1 kg..x"), "--within: play.gap is '1 kg'; expected a quantity in plain numbers."),
        ((*TUNED, "--tune", "play.gap 1..a", "--minimise", "play.gap"), "--tune: play.gap is 'a'; expected a number"),
        (("simulate", "backlash_servo", "--signal", "foo"), "There is no signal 'foo'; expected one of x, y."),
        (("check", "backlash_servo", "--set", "play.gap=foo"), "--set: play.gap is 'foo'; expected a number with or"),
        (("check", "backlash_servo", "--set", "play.gap=1", "--set", "play.gap=2"), "--set play.gap: is given twice"),
    ],
    ids=lambda given: " ".join(given) if isinstance(given, tuple) else "",
)  # fmt: skip
def test_what_is_wrong_is_called_as_it_is_typed(command: tuple[str, ...], said: str) -> None:
    """An option by its name on the command line, not Python's; a field by its name, not by its place in a file."""
    needs(command[0])
    found = CliRunner().invoke(app, list(command))
    assert found.exit_code == 2
    assert said in found.stderr and len(found.stderr.splitlines()) == 1


SLASHED = ("--over", "my-motor/limit 1.upper", "--limit", "loop.gain")


@pytest.fixture(scope="module")
def foreign(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A loop whose names are those of a block diagram elsewhere, with spaces, dashes and slashes."""
    path = tmp_path_factory.mktemp("foreign") / "foreign.toml"
    path.write_text(
        """
kind = "loop"
title = "Names of a block diagram"
[run]
t_end = "60 s"
[loop]
initial_state = [1.0, 0.0]
A = [[0.0, 1.0], [0.0, -1.0]]
B = [[0.0], [4.0]]
C = [[-1.0, 0.0]]
states = ["Motor/Angle", "Motor/Speed ref"]
elements = [{ element = "saturation", name = "my-motor/limit 1", lower = -1.0, upper = 1.0 }]
signals."Motor/Speed ref" = { state = [-1.0, 0.0] }
signals."Motor-Speed" = { state = [0.0, 1.0] }
""",
        encoding="utf-8",
    )
    return path


@pytest.mark.parametrize(
    ("command", "options", "said"),
    [
        ("check", ("--set", "my-motor/limit 1.upper=2"), "with my-motor/limit 1.upper = 2"),
        ("simulate", ("--signal", "Motor/Speed ref", "-o", "run.csv"), "Settles"),
        ("simulate", ("-o", "run.nc"), "Settles"),
        ("margins", ("--at", "my-motor/limit 1.in"), "my-motor/limit 1.in"),
        ("sweep", ("--axis", "my-motor/limit 1.upper=1,2", "--signal", "all", "-o", "map.nc"), "settles in 2"),
        ("design", ("--tune", "my-motor/limit 1.upper 1..2", "--maximise", "Q"), "Q is 'not known'"),
        ("design", ("--tune", "my-motor/limit 1.upper 1 kg..2", "--maximise", "Q"), "limit 1.upper is '1 kg'"),
        ("bounds", (*SLASHED, "--allow", "Motor/Speed ref 1 kg"), "Motor/Speed ref is '1 kg'"),
        ("sweep", ("--axis", "my-motor/limit 1.upper=1,2", "-o", "map.zarr"), "a slash separates folders there"),
    ],
)  # fmt: skip
def test_names_with_spaces_dashes_and_slashes_are_taken(
    foreign: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, command: str, options: tuple[str, ...], said: str
) -> None:
    needs(command)
    monkeypatch.chdir(tmp_path)
    found = CliRunner().invoke(app, [command, str(foreign), *options])
    assert said in found.output
    assert found.exit_code == (0 if command in ("check", "simulate", "margins") or "map.nc" in options else 2)
    if "run.nc" in options:
        import xarray

        with xarray.open_dataset("run.nc") as written:
            assert "Motor.Speed ref" in written and "Motor-Speed" in written


#: The command in a process whose files may not grow beyond some bytes, as on a disk that is full.
ON_A_FULL_DISK = """
import resource, signal
from eppanalysis.cli import main
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (500, 500))
main()
"""


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="limits of this system")
@pytest.mark.parametrize(
    "command",
    [
        *(("simulate", "backlash_servo", "-o", f"run.{suffix}") for suffix in ("csv", "nc", "png", "pdf", "svg")),
        ("certify", "relay_ideal_khalil79", "--statement", "roots", "-o", "proof.json"),
        ("schema", "-o", "schema.json"),
    ],
    ids=lambda command: command[-1],
)
def test_a_full_disk_is_a_sentence_and_leaves_no_part_of_a_file(tmp_path: Path, command: tuple[str, ...]) -> None:
    environment = {
        **os.environ,
        "PYTHONPATH": os.pathsep.join(p for p in sys.path if p),
        "PYTHONDONTWRITEBYTECODE": "1",
    }
    call = [sys.executable, "-c", ON_A_FULL_DISK, *command]
    ended = subprocess.run(call, check=False, cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=60)
    said = f"{command[-1]}: cannot be written (File too large); expected a place to write to.\n"
    assert (ended.returncode, ended.stderr) == (2, said)
    assert not list(tmp_path.iterdir())


def test_names_of_files_do_not_steer_a_terminal(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """An escape that clears the screen is spelled out wherever a command quotes it, and its command runs in a shell."""
    monkeypatch.chdir(tmp_path)
    name = "a\x1b[2Jb\x07\u202e.toml"
    changed("relay_deadzone", {}, Path(name))
    commands = (("predict", name), ("cycles", name), ("predict", "no\x1b[2J"), ("predict", name, "--set", "\x1b[2J"))
    for command in commands:
        found = CliRunner().invoke(app, list(command), color=True)
        assert not set("\x07\u202e").intersection(found.output) and "\x1b[2J" not in found.output
        assert "\\x1b[2J" in found.output
    printed = next(line for line in CliRunner().invoke(app, ["cycles", name]).stdout.splitlines() if "ends it" in line)
    shell = shlex.split(printed.partition("eppanalysis ")[2].replace("$'", "'"))
    assert shell[1].encode().decode("unicode_escape").encode("latin-1").decode() == name


def test_a_refusal_that_nobody_can_read_has_its_exit_code() -> None:
    with open("/dev/full", "w") as full:
        ended = subprocess.run(
            [sys.executable, "-m", "eppanalysis", "predict", "no_such_case"], stderr=full, check=False
        )
    assert ended.returncode == 2


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="capabilities of this system")
def test_a_read_only_folder_is_refused_before_anything_is_computed(tmp_path: Path) -> None:
    tmp_path.chmod(0o555)
    # The superuser writes everywhere, except without this capability.
    drop = ["setpriv", "--bounding-set=-dac_override,-dac_read_search"] if os.geteuid() == 0 else []
    command = [*drop, sys.executable, "-m", "eppanalysis", "simulate", "relay_deadzone", "-o", str(tmp_path / "a.png")]
    ended = subprocess.run(command, check=False, capture_output=True, text=True)
    tmp_path.chmod(0o755)
    assert ended.returncode == 2 and not ended.stdout and not list(tmp_path.iterdir())
    sentence = "a.png: cannot be written (its folder is read-only); expected a place to write to."
    assert [line.rpartition("/")[2] for line in ended.stderr.splitlines()] == [sentence]


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="terminals of this system")
@pytest.mark.parametrize("case", ["backlash_servo", "no_case"])
def test_a_terminal_that_knows_no_codes_gets_none(case: str) -> None:
    import pty

    ours, theirs = pty.openpty()
    call = [sys.executable, "-m", "eppanalysis", "predict", case]
    with subprocess.Popen(call, stdout=theirs, stderr=theirs, env={**os.environ, "TERM": "dumb"}) as process:
        os.close(theirs)
        shown = b""
        with suppress(OSError):  # the other end is closed
            while more := os.read(ours, 65536):
                shown += more
        os.close(ours)
    assert process.returncode == (2 if case == "no_case" else 0)
    assert len(shown) > 40 and b"\x1b" not in shown
