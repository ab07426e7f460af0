"""The command line: tables, JSON and files come out; what is wrong is one sentence and exit code 2."""

from __future__ import annotations

import atexit
import csv
import gc
import json
import os
import signal
import subprocess
import sys

import click
import pytest
from rich.text import Text
from typer.testing import CliRunner

from eppanalysis.cli import main
from eppanalysis.cli.commands import app
from tests.shared import command_line, mostly_slow

runner = CliRunner()


def run(*arguments: str):
    result = runner.invoke(app, list(arguments))
    assert result.exception is None or isinstance(result.exception, SystemExit), result.exception
    return result


@pytest.mark.parametrize("command", sorted(command_line().commands))
def test_no_word_of_the_help_is_cut_off(command: str) -> None:
    """On a console of 80 letters, where columns of names leave little room for what they mean."""
    told = runner.invoke(app, [command, "--help"], env={"COLUMNS": "80", "TERMINAL_WIDTH": "80"}, color=False).output
    assert "Usage" in told and "…" not in told


def test_nothing_of_the_help_passes_for_markup() -> None:
    """A word in brackets is a colour to what draws the help, and vanishes."""
    for name, command in command_line().commands.items():
        for option in command.params:
            text = getattr(option, "help", None) or ""
            assert str(Text.from_markup(text)) == text.replace(r"\[", "["), f"{name}: {text}"


def one_sentence(result) -> str:
    """The only line on the standard error, of a command that was refused."""
    assert result.exit_code == 2
    lines = result.stderr.strip().splitlines()
    assert len(lines) == 1, result.stderr
    assert "Traceback" not in result.output
    return lines[0]


def test_help_names_every_command():
    output = run("--help").output
    for command in ("check", "predict", "simulate", "validate", "cases"):
        assert command in output


def test_cases_lists_what_ships():
    found = json.loads(run("cases", "--json").stdout)["cases"]
    assert "fig8a_original" in [case["name"] for case in found]
    assert "fig8a_original" in run("cases").stdout


def test_check_says_where_values_come_from():
    output = run("check", "fig8a_original").stdout
    assert "fig8a_original: valid" in output
    assert "2.5 deg" in output
    assert "paper" in output


def test_check_reports_every_case_that_is_wrong():
    result = run("check", "fig8a_original", "no_such_case", "neither_this")
    assert result.exit_code == 2
    assert "fig8a_original: valid" in result.stdout
    assert len(result.stderr.strip().splitlines()) == 2


def test_check_json_has_values_in_si_units():
    document = json.loads(run("check", "fig8a_original", "--set", "lock_pin.backlash=0.5 deg", "--json").stdout)
    backlash = document["cases"][0]["result"]["parameters"]["lock_pin.backlash"]
    assert backlash["value"] == pytest.approx(0.5 * 3.141592653589793 / 180)
    assert document["set"] == {"lock_pin.backlash": "0.5 deg"}


@pytest.mark.parametrize(
    ("setting", "expected"),
    [
        ("lock_pin.backlash=2.5 kg", "expected an angle"),
        ("lock_pin.backlsh=2.5 deg", "lock_pin.backlash"),
        ("lock_pin.stiffness=-1 N*m/rad", "lock_pin.stiffness"),
        ("lock_pin.backlash=nan", "lock_pin.backlash"),
        ("lock_pin.backlash", "expected FIELD=VALUE"),
        ("=1", "expected FIELD=VALUE"),
    ],
)
def test_wrong_settings_are_one_sentence(setting, expected):
    assert expected in one_sentence(run("simulate", "fig8a_original", "--set", setting))


@pytest.mark.parametrize(
    ("content", "expected"), [("", ""), ("a = ", ""), ('base = "self"', ""), ('title = "x"\nunknown = 1', "unknown")]
)
def test_wrong_files_are_one_sentence(tmp_path, content, expected):
    path = tmp_path / "self.toml"
    path.write_text(content)
    sentence = one_sentence(run("predict", str(path)))
    assert "self.toml" in sentence
    assert expected in sentence


ELBOW = 'base = "fig8a_original"\n'
LOOP = 'kind = "loop"\ntitle = "x"\n[run]\nt_end = "9 s"\n[[loop.elements]]\nelement = "relay"\n[loop]\n'
RECORDED = ELBOW + '[run.input]\nkind = "recorded"\nfile = "motion.csv"\n'
INTEGRATOR = 'kind = "integrator"'
DIAGRAM = (
    'kind = "diagram"\ntitle = "x"\nconnect = ["demand - plant -> valve", "valve -> plant"]\n'
    'inputs = { demand = "0 m" }\n[run]\nt_end = "9 s"\n[blocks]\nplant = { ' + INTEGRATOR + " }\n"
    '[elements]\nvalve = { element = "saturation", lower = -1, upper = 1 }\n'
)
BAD = {
    "unknown field": (
        ELBOW + '[lock_pin]\nbacklsh = "2 deg"',
        "lock_pin.backlsh is '2 deg'",
        "did you mean 'backlash'",
    ),
    "missing field": (
        'kind = "elbow"\ntitle = "x"\n[drive]\ninertia = 1',
        "drive.supply_voltage is missing",
        "a voltage",
    ),
    "wrong dimension": (ELBOW + '[lock_pin]\nbacklash = "2.5 kg"', "lock_pin.backlash is '2.5 kg'", "an angle"),
    "order": (
        ELBOW + '[bands]\nslack = "3 lbf"\nlow = "2 lbf"\nhigh = "4 lbf"\nmax = "5 lbf"',
        "bands.low is '2 lbf'",
        "slack < low < high < max",
    ),
    "negative stiffness": (ELBOW + '[cable]\nstiffness = "-5 N/m"', "cable.stiffness is '-5 N/m'", "a positive number"),
    "kind left out": ('title = "x"\n[loop]\nnum = [1]\n', "kind is missing", "'loop'"),
    "initial state": (
        LOOP + "num = [9]\nden = [1, 3, 2, 0]\ninitial_state = [0.0, 0.1]",
        "loop.initial_state is [0.0, 0.1]",
        "3 numbers",
    ),
    "tolerance of a count": (
        ELBOW + '[sensor]\nbits = {value=12, tolerance="2"}',
        "sensor.bits.tolerance is '2'",
        "no tolerance",
    ),
    "nan": (ELBOW + "[lock_pin]\nbacklash = nan", "lock_pin.backlash is nan", "a finite number"),
    "infinity": (ELBOW + '[lock_pin]\nbacklash = "inf deg"', "lock_pin.backlash is 'inf deg'", "an angle"),
    "empty": ("", "is 'empty'", "a case file"),
    "not toml": ("a = = 1", "not TOML", "a TOML file"),
    "its own base": ('base = "bad"\ntitle = "x"', "base is 'bad'", "does not inherit from itself"),
    "improper": (LOOP + "num = [1, 2, 3]\nden = [1, 1]", "loop.num is [1, 2, 3]", "the degree of the denominator"),
    "unknown port": (DIAGRAM.replace("-> valve", "-> valv"), "connect.0 is 'demand - plant -> valv'", "a part of"),
    "driven twice": (DIAGRAM.replace('plant"]', 'plant", "demand -> plant"]'), "connect.2 is", "already: add the two"),
    "two of one name": (DIAGRAM.replace("demand", "valve"), "inputs.valve is 'valve'", "another name"),
    "rows of unequal length": (
        DIAGRAM.replace(INTEGRATOR, 'kind = "state_space", A = [[0, 1], [0]], B = [[1], [1]], C = [[1, 0]]'),
        "blocks.plant.A is [[0, 1], [0]]",
        "all of one length",
    ),
    "algebraic loop": (
        DIAGRAM.replace(INTEGRATOR, 'kind = "gain", gain = -2'),
        "connect is a list of connections",
        "has no unique answer",
    ),
    "a controller without sample time": (
        DIAGRAM.replace(INTEGRATOR, INTEGRATOR + ', computation_delay = "1 ms"'),
        "blocks.plant.computation_delay is '1 ms'",
        "no sample_time",
    ),
    "hole in a recording": (RECORDED, "motion.csv: line 3, harness_position is missing", "a recording has no holes"),
}


@pytest.mark.parametrize(("name", "what"), [(".", "a folder"), ("", "CASE is ''"), ("/dev/null", "not a file")])
def test_what_is_no_case_file_is_named_as_what_it_is(name, what):
    sentence = one_sentence(run("check", name))
    assert what in sentence and "expected a case file" in sentence


def test_a_folder_that_bears_the_name_of_a_shipped_case_does_not_hide_it(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "sat_am165").mkdir()
    assert run("check", "sat_am165").exit_code == 0


def test_a_byte_order_mark_is_read(tmp_path):
    (tmp_path / "marked.toml").write_text('base = "sat_am165"\n', encoding="utf-8-sig")
    assert run("check", str(tmp_path / "marked.toml")).exit_code == 0


@pytest.mark.parametrize("kind", BAD)
def test_bad_input_is_one_sentence_with_file_field_value_and_what_was_expected(tmp_path, kind):
    content, what, expected = BAD[kind]
    (tmp_path / "bad.toml").write_text(content)
    (tmp_path / "motion.csv").write_text("time [s],position [m]\n0,0\n1,\n2,0.02\n")
    before = sorted(p.name for p in tmp_path.iterdir())
    sentence = one_sentence(run("simulate", str(tmp_path / "bad.toml"), "-o", str(tmp_path / "out.png")))
    assert "bad.toml" in sentence or "motion.csv" in sentence
    assert what in sentence and "expected" in sentence and expected in sentence
    assert sorted(p.name for p in tmp_path.iterdir()) == before


def test_simulate_prints_the_verdict():
    output = run("simulate", "fig8b_reduced_backlash").stdout
    assert "Settles at rest: theta at 60.59 deg" in output
    assert "theta [deg]" in output


def test_a_picture_has_the_signals_that_answer_or_those_that_are_asked_for(tmp_path, monkeypatch):
    drawn = []
    monkeypatch.setattr("eppanalysis.tables.files.write_figure", lambda axes, path: drawn.append(axes.figure))
    picture = ("-o", str(tmp_path / "run.png"))
    for asked in ((), ("--signal", "voltage", "--signal", "theta"), ("--signal", "all")):
        assert run("simulate", "fig8a_original", *asked, *picture).exit_code == 0
    names = [[ax.get_ylabel().split()[0] for ax in figure.axes] for figure in drawn]
    assert names[0] == ["theta", "sensor"] and names[1] == ["voltage", "theta"] and len(names[2]) == 10
    assert "no signal 'angle'" in one_sentence(run("simulate", "fig8a_original", "--signal", "angle", *picture))


def test_where_predictions_were_sought_is_told_in_the_units_of_the_tables():
    for name, unit, other in (("fig8a_original", "deg by", "rad"), ("x15_flare", "rad/s", "deg")):
        output = " ".join(run("predict", name).stdout.split())
        sought = output[output.index("Sought") :].partition(". ")[0]
        assert " Hz" in sought and unit in sought and other not in sought


def test_simulate_json_is_documented_data():
    (case,) = json.loads(run("simulate", "fig8a_original", "--json").stdout)["cases"]
    assert case["result"]["status"] == "limit_cycle"
    assert case["result"]["limit_cycle"]["frequency"] > 0
    assert set(case) == {"name", "title", "kind", "verdict", "result"}
    assert case["verdict"].startswith("Oscillates") and case["verdict"] in run("simulate", "fig8a_original").stdout


def test_predict_finds_both_cycles_of_the_original_elbow_where_the_harness_ends():
    """20 mm of step over 19 mm of radius is 60.3 deg; without the step the cycles would be about 0 deg."""
    (case,) = json.loads(run("predict", "fig8a_original", "--json").stdout)["cases"]
    assert {True, False} <= {cycle["stable"] for cycle in case["result"]["cycles"]}
    for cycle in case["result"]["cycles"]:
        assert cycle["mean"]["theta"] == pytest.approx(20 / 19, abs=5e-3)


def test_validate_gives_a_verdict_in_words_and_says_what_must_come_out():
    (case,) = json.loads(run("validate", "sat_am165", "--json").stdout)["cases"]
    assert case["result"]["verdict"]
    assert case["result"]["verdict"] in " ".join(run("validate", "sat_am165").stdout.split())
    assert (case["result"]["must"], case["result"]["as_found"]) == ("oscillate", True)


@pytest.mark.parametrize(("t_end", "rests"), [("20 s", True), ("0.1 s", False)])
def test_validate_of_a_loop_without_cycles_shows_no_table_of_cycles(tmp_path, t_end, rests):
    path = tmp_path / "lag.toml"
    path.write_text(
        f'kind = "loop"\ntitle = "t"\nrun = {{ t_end = "{t_end}" }}\n[loop]\n'
        'blocks = [{ element = "saturation" }, { num = [0.5], den = [1.0, 1.0] }]\n'
    )
    shown = run("validate", str(path)).stdout
    assert "No exact limit cycle was found" in shown
    assert ("rests at" in shown) is rests
    assert not any(word in shown for word in ("period", "error", "peak to peak"))


def test_validate_puts_every_signal_side_by_side():
    output = run("validate", "fig8a_original").stdout
    head = next(line for line in output.splitlines() if "simulated" in line)
    assert head.split() == ["predicted,", "unstable", "predicted,", "stable", "simulated", "error"]
    for text in (
        "frequency [Hz]",
        "theta peak to peak [deg]",
        "sensor force peak to peak [N]",
        "pulley stretch peak to",
    ):
        assert text in output
    row = next(line for line in output.splitlines() if "frequency [Hz]" in line).split()
    assert row[2:] == ["5.611", "10.61", "8.974", "+18.3", "%"]
    rungs = [line.split() for line in output.splitlines() if line.strip().startswith(("1 ", "2 "))]
    assert [" ".join(r[1:3]) for r in rungs[:3]] == ["describing function,", "harmonic balance,", "exact orbit,"]
    assert len(rungs) == 7 and "search for all exact cycles" in output


@pytest.mark.slow
def test_truth_table_is_printed_as_the_paper_found():
    result = run(*TRUTH_TABLE)
    assert result.exit_code == 0
    output = result.stdout
    assert output.strip().endswith("8 of 8 as the paper found.")
    rows = {line.split()[0]: line for line in output.splitlines() if line.strip() and line.split()[0] in TRUTH}
    assert list(rows) == list(TRUTH)
    for name, (figure, must) in TRUTH.items():
        words = " ".join(rows[name].split())
        assert figure in words and f" {must} {must} ok " in words
    # A step that settles is no proof: beside the light forearm's resting state there are cycles.
    assert " 1 stable " in rows["light_forearm"] and rows["soft_cable"].split().count("none") == 3


TRUTH_TABLE = ["validate", "truth-table"]
TRUTH = {
    "fig8a_original": ("Fig. 8(a)", "oscillate"),
    "fig8b_reduced_backlash": ("Fig. 8(b)", "settle"),
    "gain_brings_it_back": ("text after Fig. 8", "oscillate"),
    "fig6a_original_pulley": ("Fig. 6(a)", "oscillate"),
    "fig6b_ball_bearing": ("Fig. 6(b)", "settle"),
    "soft_cable": ("text after Equation (2)", "settle"),
    "light_forearm": ("text after Equation (2)", "settle"),
    "upright": ("Discussion", "settle"),
}


def test_a_case_that_fails_is_called_so_and_the_exit_code_stays(tmp_path):
    path = tmp_path / "wrong.toml"
    path.write_text('base = "sat_am165"\ntitle = "x"\n[expected]\noutcome = "settle"\n')
    result = run("validate", str(path), "sat_am165")
    assert result.exit_code == 0
    assert "FAIL" in result.stdout and "1 of 2 as their sources say." in result.stdout


#: A relay with hysteresis round an angle that is typed in degrees.
SWITCHED = """
kind = "diagram"
title = "Switched servo"
connect = ["-relay -> motor", "motor -> relay"]
signals.angle = { of = "motor", unit = "deg" }
run = { t_end = "60 s" }
[blocks]
motor = { kind = "transfer_function", num = [1], den = [1, 1, 0] }
[elements]
relay = { element = "hysteresis_relay", lower = "-5 deg", upper = "5 deg" }
"""


WRITE = ("predict", "simulate", "validate", "cycles")
KINDS = ((".png", ""), (".svg", ""), (".pdf", ""), (".csv", ""), (".nc", ""), (".nc", "deg"))


@pytest.mark.parametrize(
    ("command", "suffix", "typed"),
    mostly_slow(
        [(command, *kind) for command in WRITE for kind in KINDS],
        [(WRITE[i % len(WRITE)], *kind) for i, kind in enumerate(KINDS)],
    ),
)
def test_every_command_writes_every_kind_of_file(tmp_path, command, suffix, typed):
    """Of a loop without units, and of one whose file types them in others than SI."""
    name, path = "relay_hyst_servo", tmp_path / f"out{suffix}"
    if typed:
        (tmp_path / "case").mkdir()
        name = str(tmp_path / "case" / "servo.toml")
        (tmp_path / "case" / "servo.toml").write_text(SWITCHED, encoding="utf-8")
    result = run(command, name, "-o", str(path))
    assert result.exit_code == 0, result.output
    assert path.stat().st_size > 100
    assert [p.name for p in tmp_path.iterdir() if p.is_file()] == [path.name]


def test_one_table_holds_several_cases(tmp_path):
    path = tmp_path / "cycles.csv"
    assert run("predict", "relay_deadzone", "sat_am165", "-o", str(path)).exit_code == 0
    with path.open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert [row["case"] for row in rows] == ["relay_deadzone", "relay_deadzone", "sat_am165"]


def test_several_pictures_need_a_name_for_each(tmp_path):
    cases = ("relay_hyst_servo", "sat_am165")
    assert "{case}" in one_sentence(run("predict", *cases, "-o", str(tmp_path / "all.png")))
    assert run("predict", *cases, "-o", str(tmp_path / "{case}.png")).exit_code == 0
    assert sorted(p.stem for p in tmp_path.iterdir()) == sorted(cases)


def test_simulate_carries_on_what_is_undecided_and_prints_how_to_go_on(monkeypatch):
    short = run("simulate", "relay_hyst_servo", "--set", "run.t_end=1 s", "--json")
    found = json.loads(short.stdout)["cases"][0]["result"]
    assert found["status"] == "limit_cycle" and found["settled_since"] > found["end_time"] == 1.0
    monkeypatch.setattr("eppanalysis.methods.search.longer._WORK", 1.0)
    open_ = run("simulate", "azimuth_servo", "--set", "run.t_end=0.2 s").stdout
    assert 'Simulate for longer: eppanalysis simulate azimuth_servo --set "run.t_end=' in open_


@pytest.mark.parametrize("name", ["out.docx", "out", "missing/out.png"])
def test_output_that_cannot_be_written_is_refused_before_computing(tmp_path, monkeypatch, name):
    def computed(*_):
        raise AssertionError("computed before the output was checked")

    monkeypatch.setattr("eppanalysis.methods.search.simulate.simulate", computed)
    one_sentence(run("simulate", "fig8a_original", "-o", str(tmp_path / name)))
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("arguments", "option"),
    [
        (("predict", "relay_deadzone", "-o", "a.png", "-o", "b.png"), "-o/--output"),
        (("report", "relay_deadzone", "-o", "a.html", "--output", "b.pdf"), "-o/--output"),
        (("identify", "fig8a_original", "--tray", "a.csv", "--tray", "b.csv"), "--tray"),
        (
            ("branch", "backlash_servo", "--over", "x", "--from", "1", "--to", "2", "--points", "3", "--points=4"),
            "--points",
        ),
    ],
)
def test_an_option_of_one_value_is_not_given_twice(tmp_path, monkeypatch, arguments, option):
    monkeypatch.chdir(tmp_path)
    assert one_sentence(run(*arguments)) == f"{option}: is given 2 times; expected it once."
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("command", ["check", "predict", "simulate", "validate", "cycles"])
def test_a_heading_names_what_is_overridden(command):
    """The title of a case still tells of the old values."""
    plain, changed = (run(command, "sat_am165", *more) for more in ((), ("--set", "saturation.upper=1.5")))
    assert changed.exit_code == 0, changed.stderr
    lines = [line for line in changed.stdout.splitlines() if line]
    assert lines[0].startswith("sat_am165: ") and lines[1] == "with saturation.upper = 1.5"
    assert "with saturation" not in plain.stdout


def test_a_plain_number_that_is_set_is_shown_in_the_unit_that_it_is_taken_in():
    settings = ["--set", "gap=0.003", "--set", "Kp=5e1", "--set", "Ti=0.3 s", "--set", "run.t_end=1"]
    lines = runner.invoke(app, ["check", "azimuth_servo", *settings]).stdout.splitlines()
    assert lines[1] == "with gap = 0.003 rad, Kp = 5e1 V/rad, Ti = 0.3 s, run.t_end = 1"


def test_two_cases_of_one_name_are_not_written_over_each_other(tmp_path, monkeypatch):
    monkeypatch.setattr(
        "eppanalysis.methods.describing.predict.predict_limit_cycles", lambda *_: pytest.fail("computed")
    )
    for folder in ("a", "b"):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "x.toml").write_text('base = "relay_deadzone"\n')
    cases = [str(tmp_path / folder / "x.toml") for folder in ("a", "b")]
    sentence = one_sentence(run("predict", *cases, "-o", str(tmp_path / "out_{case}.csv")))
    assert "2 cases are called x; expected a name for each" in sentence


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("predict", "relay_deadzone", "-o", "{foo}.png"), "{foo}.png: {foo} is no placeholder; expected {case}."),
        (("cycles", "relay_deadzone", "-o", "{case}.png"), "{case} is no placeholder; expected a name without it."),
        (("identify", "fig8a_original", "--tray", "x.csv", "-o", "{foo}.png"), "expected {bench}."),
        (("predict", "relay_deadzone", "-o", "x" * 5000 + ".png"), "is a name of 5004 letters; expected at most 200."),
        (("predict", "relay_deadzone", "-o", "x" * 5000), "is a name of 5000 letters; expected at most 200."),
        (("predict", "x" * 5000), "is missing; expected a case file, or the name of a shipped case."),
        (
            ("branch", "backlash_servo", "--over", "play.gap", "--from", "0.1", "--to", "1", "--points", "0"),
            "--points 0",
        ),
        (("branch", "fig8a_original", "--over", "bands.range", "--from", "2", "--to", "-1"), "--to: bands.range is"),
        (("branch", "fig8a_original", "--over", "bands.range", "--from", "-2", "--to", "1"), "--from: bands.range is"),
    ],
)
def test_names_and_values_that_cannot_be_are_one_sentence(tmp_path, monkeypatch, arguments, words):
    monkeypatch.chdir(tmp_path)
    assert words in one_sentence(run(*arguments))
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("command", ["predict", "validate", "cycles"])
@pytest.mark.parametrize("setting", ["play.gap=1e308", "loop.num=[1e300]"])
def test_numbers_beyond_all_range_are_one_sentence(command, setting):
    result = run(command, "backlash_servo", "--set", setting)
    assert "from 1e-50 to 1e+50 in size" in one_sentence(result)
    assert not result.stdout


@pytest.mark.slow
@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="no disk that is always full")
@pytest.mark.parametrize(
    "arguments", [("cases",), ("cases", "--json"), ("--version",), ("check", "sat_am165"), ("--help",), ()]
)
def test_a_full_disk_behind_the_standard_output_is_one_sentence(arguments):
    with open("/dev/full", "w") as full:
        command = [sys.executable, "-m", "eppanalysis", *arguments]
        process = subprocess.run(command, check=False, stdout=full, stderr=subprocess.PIPE, text=True)
    assert process.returncode == 2
    assert process.stderr.splitlines() == [
        "standard output: No space left on device; expected a place to read from or write to."
    ]


def test_options_that_may_be_repeated_still_may():
    twice = ("--set", "lock_pin.backlash=2 deg", "--set", "lock_pin.stiffness=900 N*m/rad", "--json", "--json")
    assert run("check", "fig8a_original", *twice).exit_code == 0


@pytest.mark.slow
@pytest.mark.skipif(os.name != "posix", reason="signals")
def test_interrupt_ends_with_130_and_no_file(tmp_path):
    code = (
        "import os, signal, eppanalysis.tables.files as export\n"
        "export.write_result = lambda *_, **__: os.kill(os.getpid(), signal.SIGINT)\n"
        "from eppanalysis.cli import main\n"
        "main()\n"
    )
    arguments = ["simulate", "relay_deadzone", "-o", str(tmp_path / "out.png")]
    process = subprocess.run([sys.executable, "-c", code, *arguments], check=False, capture_output=True, text=True)
    assert process.returncode in (130, -signal.SIGINT)
    assert "Traceback" not in process.stderr
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("command", "place", "said"),
    [
        ("cycles", "eppanalysis.cli.cycles.load_case", "Interrupted: nothing is kept."),
        ("predict", "eppanalysis.cli.commands.expanded", "Interrupted: nothing is kept."),
        ("explore", "eppanalysis.explorer.explore", ""),
    ],
)
def test_an_interrupt_is_a_sentence_wherever_it_comes(monkeypatch, command, place, said):
    """Of a page, which has no other end, it is none."""

    def interrupted(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(place, interrupted)
    result = run(command, "sat_am165")
    assert (result.exit_code, result.stderr.strip()) == (130, said)


def test_an_interrupt_before_a_command_has_begun_is_a_sentence_too(monkeypatch, capsys):
    """While the commands are put together, outside of all of them."""

    def interrupted():
        raise KeyboardInterrupt

    monkeypatch.setattr(gc, "set_threshold", lambda *_: None)
    monkeypatch.setattr(atexit, "register", lambda _: None)
    monkeypatch.setattr("eppanalysis.cli.commands.app", interrupted)
    with pytest.raises(SystemExit) as end:
        main()
    assert (end.value.code, capsys.readouterr().err) == (130, "Interrupted: nothing is kept.\n")


@pytest.mark.slow
def test_help_loads_nothing_heavy():
    """Commands for help must stay quick: none of the numerical packages may be loaded for it."""
    code = (
        "import sys\nfrom eppanalysis.cli import main\nsys.argv = ['eppanalysis', '--help']\n"
        "try:\n    main()\nexcept SystemExit:\n    pass\n"
        "heavy = 'numpy', 'scipy', 'eppanalysis.engine', 'matplotlib', 'pint', 'pydantic'\n"
        "print([m for m in heavy if m in sys.modules])"
    )
    process = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)
    assert process.stdout.strip().endswith("[]")


@pytest.mark.slow
@pytest.mark.parametrize("command", ["predict", "simulate", "cycles"])
def test_a_case_that_is_not_there_is_said_before_anything_is_loaded_that_computes(command: str) -> None:
    code = (
        f"import sys\nfrom eppanalysis.cli import main\nsys.argv = ['eppanalysis', {command!r}, 'nofile']\n"
        "try:\n    main()\nexcept SystemExit as end:\n    assert end.code == 2\n"
        "heavy = 'scipy', 'casadi', 'eppanalysis.methods.describing.predict'\n"
        "print([m for m in heavy if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)
    assert "nofile" in done.stderr and done.stdout.strip() == "[]"


@pytest.mark.slow
@pytest.mark.parametrize("command", ["cases", "predict sat_am165 --json"])
@pytest.mark.parametrize("end", [">&-", "2>&-", "| head -1"])
def test_a_closed_output_is_no_reason_for_a_traceback(command: str, end: str) -> None:
    line = f'"{sys.executable}" -m eppanalysis {command} {end}'
    done = subprocess.run(line, shell=True, capture_output=True, text=True, check=False)
    assert done.returncode == 0 and done.stderr == "", done.stderr


@pytest.mark.slow
@pytest.mark.skipif(os.name != "posix", reason="numbers of streams")
def test_what_a_command_starts_has_the_streams_that_its_caller_has_closed(tmp_path) -> None:
    """A kernel dies without an output, and a file that took its number would hold what the kernel prints."""
    line = f'"{sys.executable}" -m eppanalysis report relay_deadzone -o "{tmp_path}/a.ipynb" >&-'
    # A kernel that knows of a test leaves the numbers of its streams alone.
    own = {name: value for name, value in os.environ.items() if name != "PYTEST_CURRENT_TEST"}
    assert subprocess.run(line, shell=True, env=own, stderr=subprocess.DEVNULL, check=False).returncode == 0
    assert [path.name for path in tmp_path.iterdir()] == ["a.ipynb"]


@pytest.mark.parametrize(
    ("command", "name", "begin", "words"),
    [
        ("identify", "columns", "t", ["time=", "torque="]),
        ("sweep", "scheduler", "p", ["processes", "pbs"]),
        ("sweep", "run", "c", ["cycles", "certify"]),
    ],
)
def test_a_shell_completes_the_words_of_an_option(command: str, name: str, begin: str, words: list[str]) -> None:
    found = command_line().get_command(None, command)
    option = next(option for option in found.params if option.name == name)
    assert [item.value for item in option.shell_complete(click.Context(found), begin)] == words
