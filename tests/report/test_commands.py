"""A command that is printed runs as it is printed: of every shipped case, and of a file of one's own."""

from __future__ import annotations

import shlex
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest
from typer.testing import CliRunner

import eppanalysis as epp
from eppanalysis.cases import variation_of
from eppanalysis.cases.command_line import Commands, called, commands_in
from eppanalysis.cli.commands import app
from eppanalysis.cli.common import load_case
from eppanalysis.methods.bounds.numbers import why_no_bounds
from eppanalysis.methods.bounds.searched import why_by_search
from eppanalysis.models.systems.sampled.clocked import has_samples
from eppanalysis.report.advice import Found
from eppanalysis.report.notebook import make_notebook
from eppanalysis.report.sections import SECTIONS
from eppanalysis.sweep.axes import make_design
from tests.shared import command_line, mostly_slow

CASES = epp.shipped_cases()
#: A discrete loop, an elbow, and a loop with dead time; a ring with play is that of one's own.
SOME = ("backlash_discrete_pi_kp02_ki02", "fig8a_original", "relay_biased_fopdt")
#: What makes a command of minutes one of seconds, behind what is printed: a bound that is tested by few runs.
FEWER = {"bounds": ("--starts", "10")}
#: A loop of a file of one's own, in the units of a data sheet.
MINE = """
kind = "diagram"
title = "table"
connect = ["target - screw -> drive", "drive -> screw"]
inputs = { target = "0 rad" }
signals = { place = { of = "drive", unit = "rad" }, nut = { of = "screw", unit = "rad" } }
[parameters]
K = { value = "12 rpm", mark = "tunable" }
slack = "3 deg"
[blocks]
drive = { kind = "transfer_function", num = ["K"], den = [0.5, 1, 0] }
[elements]
screw = { element = "play", gap = "slack" }
[run]
t_end = "5 s"
input = { kind = "step", size = "10 deg" }
"""


def settled() -> SimpleNamespace:
    return SimpleNamespace(limit_cycle=None, status=epp.Status.SETTLED)


def situations(case: epp.Case) -> list[str]:
    """What the first page may advise of a case, whatever was found."""
    asking = Commands.of(case)
    undecided = SimpleNamespace(limit_cycle=None, status=epp.Status.UNDECIDED)
    cycling = SimpleNamespace(limit_cycle=object(), status=epp.Status.LIMIT_CYCLE)
    none = SimpleNamespace(left_open=(), stable=(), __len__=lambda: 0)
    opened = type("Opened", (), {"left_open": ("a run",), "stable": (), "__len__": lambda self: 0})()
    unstable = SimpleNamespace(left_open=(), stable=())
    name = next(iter(variation_of(case).over()), "")
    whole = SimpleNamespace(parameter=name, lies_above=lambda end: True, points={})
    own = case.value(name) if name else 1.0
    ends = [(None, None), (whole, None), *((whole, SimpleNamespace(value=share * own)) for share in (0.5, 2.0))]
    runs = [(settled(), None), (settled(), opened), (undecided, None), (undecided, unstable), (cycling, none)]
    return [
        Found(asking, run, cycles, branch, end, None).advice()
        for run, cycles in runs
        for branch, end in ends
        if name or branch is None
    ]


def printed(case: epp.Case) -> list[str]:
    """All commands that reports of a case may print, each once."""
    texts = situations(case)
    for section in SECTIONS:
        for full in (False, True):
            texts += [line.rpartition("')")[0] or line for line in section.cell(case, full=full).splitlines()]
    return list(dict.fromkeys(commands_in(texts)))


def run_all(case: epp.Case) -> None:
    """Run what is printed, bounds with few runs behind them."""
    for text in printed(case):
        words = shlex.split(text)[1:]
        if words[0] != "guide":  # three gains of an elbow: the guideline of its own tests
            done = CliRunner().invoke(app, [*words, *FEWER.get(words[0], ())])
            assert done.exit_code == 0, f"{text}: {done.output}"


def resolve(text: str) -> None:
    """What the command line makes of a command: its options are known, its case loads, its fields and values are."""
    program, verb, *words = shlex.split(text)
    assert program == "eppanalysis"
    command = command_line().commands[verb]
    given = command.make_context(verb, list(words)).params
    named = given.get("case") or given["cases"][0]
    case = load_case(named, given["settings"])
    for option in ("over", "limit", "maximise"):
        if given.get(option):
            assert case.unit(given[option]) is not None and case.value(given[option]) == case.value(given[option])
    if given.get("start"):
        assert case.with_values({given["over"]: given["start"]}).value(given["over"]) == case.value(given["over"])
    for text in given.get("tune") or ():
        name, low, high = text.partition(" ")[0], *text.partition(" ")[2].split("..")
        assert case.si(name, low) < case.value(name) < case.si(name, high)
    if given.get("axes"):
        assert make_design(case, dict(axis.split("=", 1) for axis in given["axes"])).n_cells == 81
    if verb == "design":
        assert not has_samples(case.to_system())
    if verb in ("bounds", "guide") and not why_by_search(case.to_system()):
        assert not why_no_bounds(case.to_system())
    if verb == "bounds":
        assert given["over"] and given["limit"] and given["over"] != given["limit"]


@pytest.mark.parametrize("name", mostly_slow(CASES, SOME))
def test_commands_of_a_shipped_case_are_understood(name: str) -> None:
    texts = printed(epp.case(name))
    assert texts and all(shlex.split(text)[2] == name for text in texts)
    for text in texts:
        resolve(text)


@pytest.fixture
def mine(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> epp.Case:
    monkeypatch.chdir(tmp_path)
    Path("my servo.toml").write_text(MINE, encoding="utf-8")
    return epp.read_case("my servo.toml")


@pytest.mark.parametrize("settings", [{}, {"K": "20 rpm"}, {"slack": 0.01, "run.t_end": "7 s"}])
def test_commands_of_a_file_of_ones_own_are_understood(mine: epp.Case, settings: dict[str, object]) -> None:
    """The file as it was named, blanks and all, with what was set in it: not the name of the case."""
    case = mine.with_values(settings) if settings else mine
    texts = printed(case)
    assert texts and all('"my servo.toml"' in text for text in texts)
    for text in texts:
        resolve(text)
        _, verb, *words = shlex.split(text)
        given = command_line().commands[verb].make_context(verb, list(words)).params
        there = load_case(given.get("case") or given["cases"][0], given["settings"])
        assert (
            there.with_values({"run.t_end": case.t_end}).to_toml()
            == case.with_values({"run.t_end": case.t_end}).to_toml()
        )


def test_a_case_that_no_file_holds_is_asked_in_python(mine: epp.Case) -> None:
    """What has no name on the command line has no command that runs."""
    loop = epp.LureSystem.from_tf(([5.0], [1.0, 1.0, 0.0]), epp.Play(gap=2.0), name="servo")
    made = epp.Case.from_system(loop)
    Path("my servo.toml").write_text(MINE.replace("[0.5, 1, 0]", "[0.6, 1, 0]"), encoding="utf-8")
    for case in (made, mine, replace(epp.case("wheelchair"), name="other", source="")):
        assert not called(case)
        texts = situations(case)
        assert not commands_in(texts) and any("epp.design_bounds(case, " in text for text in texts)
        for text in texts:
            for line in text.splitlines():
                if "epp." in line:
                    compile(line[line.index("epp.") :], "advice", "eval")


@pytest.mark.parametrize("folder", [".", "data", "../elsewhere"])
@pytest.mark.parametrize("settings", [{}, {"K": "20 rpm"}])
def test_a_notebook_names_no_folder_of_the_machine(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, folder: str, settings: dict[str, object]
) -> None:
    """A file below the working folder by its way from there; of one elsewhere it asks in Python."""
    here = tmp_path / "here"
    (here / folder).mkdir(parents=True, exist_ok=True)
    monkeypatch.chdir(here)
    path = (here / folder / "servo.toml").resolve()
    path.write_text(MINE, encoding="utf-8")
    case = epp.read_case(path)
    code = "".join(cell.source for cell in make_notebook([case.with_values(settings) if settings else case]).cells)
    assert str(tmp_path) not in code
    words = called(case.with_values(settings) if settings else case, carried=True)
    assert (not words) == (folder == "../elsewhere")
    if words:
        assert epp.read_case(words[0]).to_toml() == case.to_toml() and f"called={words}" in code


@pytest.mark.parametrize("name", ["-servo.toml", "truth-table"])
def test_a_notebook_names_a_file_so_that_it_is_no_option_and_no_group(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    monkeypatch.chdir(tmp_path)
    path = tmp_path / name
    path.write_text(MINE, encoding="utf-8")
    done = CliRunner().invoke(app, ["check", *called(epp.read_case(path), carried=True)])
    assert done.exit_code == 0 and done.output.count("valid") == 1, done.output


@pytest.mark.slow
@pytest.mark.parametrize("name", SOME[:2])
def test_commands_of_a_shipped_case_run(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of a discrete loop and an elbow, as a ring is that of one's own; of all, in half an hour, in tests/stress."""
    monkeypatch.chdir(tmp_path)
    run_all(epp.case(name))


@pytest.mark.slow
def test_commands_of_a_file_of_ones_own_run(mine: epp.Case) -> None:
    for text in printed(mine.with_values({"K": "20 rpm"})):
        done = CliRunner().invoke(app, shlex.split(text)[1:])
        assert done.exit_code == 0, f"{text}: {done.output}"


def test_a_page_without_the_templates_of_nbconvert_is_refused_before_anything_is_computed(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """As where they were not installed: they lie beside its modules, under share/jupyter."""
    target = "nbconvert.exporters.templateexporter.TemplateExporter.get_prefix_root_dirs"
    monkeypatch.setattr(target, lambda _: [])
    with pytest.raises(epp.EppError, match="needs the templates of nbconvert.*pip install --force-reinstall nbconvert"):
        epp.report(epp.case("sat_am165"), tmp_path / "x.html")
    assert not [*tmp_path.iterdir()]
