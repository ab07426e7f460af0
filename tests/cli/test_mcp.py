"""``eppanalysis mcp`` as an assistant sees it: questions in words, calls that answer them, and what it may not do."""

from __future__ import annotations

import json
import math
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from scipy.optimize import brentq

from tests.shared import command_line

pytestmark = pytest.mark.slow

#: A loop of which all is known: its linear limit is 6/4 = 1.5 times its gain, at sqrt(2) rad/s (Routh), and below it
#: Popov's criterion proves that it rests.
THIRD = """
kind = "loop"
title = "Saturation and 4/(s (s+1) (s+2))"
[loop]
num = [4]
den = [1, 3, 2, 0]
initial_state = [0.0, 0.0, 2.0]
[[loop.elements]]
kind = "saturation"
[run]
t_end = "60 s"
"""
#: Within its limits a mass on a spring: x/force = 1/(s^2 + 0.2 s + 1).
SPRING = """
kind = "diagram"
title = "A mass on a spring that yields"
connect = ["force - mass -> spring", "spring -> mass"]
inputs = { force = "0 m" }
[blocks]
mass = { kind = "transfer_function", num = [1], den = [1, 0.2, 0] }
[elements]
spring = { element = "saturation", lower = "-1 m", upper = "1 m" }
[signals]
x = { of = "mass", unit = "m" }
[run]
t_end = "60 s"
"""
NEWTONS = 4.4482216152605  # of a pound-force
CASES = Path(__file__).parents[2] / "cases"
FILES = {"third.toml": THIRD, "spring.toml": SPRING, "wrong.toml": THIRD.replace("num", "nmu")}


class Reply(NamedTuple):
    """What a call returns: its texts, and the result of its first case where there is one."""

    failed: bool
    texts: list[str]

    @property
    def verdict(self) -> str:
        return self.texts[0]

    @property
    def result(self) -> Any:
        return json.loads(self.texts[1])["cases"][0]["result"]


Call = tuple[str, dict[str, Any]]


class Task(NamedTuple):
    """A question in words, the calls that answer it, one behind the other, and whether they did."""

    question: str
    calls: list[Call]
    is_answered: Callable[..., bool]


def near(value: float, relative: float) -> Any:
    return pytest.approx(value, rel=relative)


def wheelchair_margin() -> float:
    """Of 600 N/m, 0.04 (m/s)/N behind a lag of 0.3 s, and the Padé approximation of 30 ms, which only turns."""

    def phase(w: float) -> float:
        return -math.pi / 2 - math.atan(0.3 * w) - 2 * math.atan2(0.015 * w, 1 - 7.5e-5 * w**2)

    w = brentq(lambda w: phase(w) + math.pi, 1.0, 50.0)
    return w * math.hypot(1.0, 0.3 * w) / 24.0


def hysteresis_period() -> float:
    """Of a relay that switches at 0.1, round 1/(s (s+1)), in closed form."""
    return 2.0 * brentq(lambda h: h / 2 - math.tanh(h / 2) - 0.1, 0.5, 5.0)


def cycle_of(reply: Reply) -> dict[str, Any]:
    (found,) = reply.result["cycles"]
    return found


TASKS = [
    # The frequency by an integrator without modes (source in the case file).
    Task("Does backlash_servo oscillate, and how fast?", [("simulate", {"cases": ["backlash_servo"]})],
         lambda r: r.verdict.startswith("Oscillates")
         and r.result["limit_cycle"]["frequency"] == near(1.573232105584 / (2 * math.pi), 1e-6)),
    # Hairer, Norsett & Wanner, Exercise I.16.1.
    Task("What is the exact period of the Van der Pol oscillator?", [("cycles", {"case": "van_der_pol_mu1"})],
         lambda r: cycle_of(r)["period"] == near(6.66328685932313, 1e-9)
         and cycle_of(r)["peak_to_peak"]["x"] == near(2 * 2.00861986087484, 1e-9)),
    # Goncalves et al., 2001.
    Task("After which half period does the relay of Goncalves switch?", [("cycles", {"case": "relay_hyst_goncalves6"})],
         lambda r: cycle_of(r)["period"] / 2 == pytest.approx(2.094, abs=5e-4) and cycle_of(r)["stable"]),
    # Khalil, Example 7.9.
    Task("Which cycle does the describing function predict for Khalil's relay?",
         [("predict", {"cases": ["relay_ideal_khalil79"]})],
         lambda r: cycle_of(r)["amplitude"]["x"] == near(2 / (3 * math.pi), 1e-9)
         and 2 * math.pi * cycle_of(r)["frequency"] == near(math.sqrt(2), 1e-9)),
    Task("What is the gain margin of the wheelchair, cut before the play?",
         [("margins", {"case": "wheelchair", "at": ["play.in"]})],
         lambda r: r.result["margins"][0]["gain_margin"] == near(wheelchair_margin(), 1e-6)),
    Task("How far is my loop from instability?", [("margins", {"case": "third.toml"})],
         lambda r: "stable: gain margin 1.5 at 1.414 rad/s" in r.verdict),
    # The fold by shooting, which other tests compare with other integrators.
    Task("What is the largest backlash of the original elbow at 2.5 lbf?",
         [("bounds", {"case": "fig8a_original", "over": "bands.range", "limit": "lock_pin.backlash",
                      "from": "2.5 lbf", "points": 1, "verify": False, "workers": 1})],
         lambda r: math.degrees(r.result["cells"][0]["exact"]) == near(0.978586853, 1e-7) and "0.9785" in r.verdict),
    Task("Does this file have a mistake?", [("check", {"cases": ["wrong.toml"]})],
         lambda r: r.failed and "loop.nmu" in r.verdict and "did you mean 'num'?" in r.verdict),
    Task("Write a new servo file and check it.",
         [("new", {"file": "servo.toml", "kind": "servo", "set": ["ratio=36:1"]}),
          ("check", {"cases": ["servo.toml"]})],
         lambda new, check: new.texts[-1] == "written: servo.toml" and "valid" in check.verdict
         and check.result["parameters"]["ratio"]["value"] == 36.0),
    # The record was made by a loop with backlash alone, of 3 mm.
    Task("Which element explains this record?", [("diagnose", {"case": "level_valve", "record": "tank_level.csv",
                                                                "steps": 100_000})],
         lambda r: r.result["named"] == ["linkage"]
         and 0.0025 < r.result["explanations"][0]["fields"]["gap"][0] < 0.0035),
    # The records were made with a sensor of 2 V/lbf.
    Task("What is the gain of the harness sensor?", [("identify", {"case": "elbow", "tray": "weight_tray.csv"})],
         lambda r: (gain := r.result["fits"][0]["estimates"]["sensor.gain"])["low"] < 2 / NEWTONS < gain["high"]),
    Task("Can my loop be proved to rest? Check the proof.",
         [("certify", {"case": "third.toml", "statement": "absence", "output": "rests.json"}),
          ("certify", {"case": "third.toml", "check": "rests.json"})],
         lambda proof, checked: proof.result["proved"] and proof.texts[-1] == "written: rests.json"
         and not checked.failed),
    Task("Is it still proved with twice the gain, where it is unstable?",
         [("certify", {"case": "third.toml", "statement": "absence", "set": ["loop.gain=2"]})],
         lambda r: not r.result["proved"] and r.verdict.startswith("Not decided")),
    Task("Does my loop rest?", [("simulate", {"cases": ["third.toml"]})],
         lambda r: r.result["status"] == "settled" and r.result["limit_cycle"] is None),
    Task("What is the largest gain without a limit cycle?",
         [("design", {"case": "third.toml", "tune": ["loop.gain 0.5..3"], "maximise": "loop.gain", "verify": False,
                      "output": ["tuned.toml"]})],
         lambda r: r.result["optimum"]["at"]["loop.gain"] == near(1.5, 1e-6)
         and 2 * math.pi * r.result["optimum"]["frequency"] == near(math.sqrt(2), 1e-6)
         and r.texts[-1] == "written: tuned.toml"),
    Task("How large is the response to a small sine of 0.1 Hz?",
         [("response", {"case": "spring.toml", "amplitude": 0.1, "frequency": 0.1, "signal": "x"})],
         lambda r: r.result["responses"][0]["cycle"]["peak_to_peak"]["x"]
         == near(0.2 / abs(1 - (w := 0.2 * math.pi) ** 2 + 0.2j * w), 1e-6)),
    Task("How exact is the describing function for the relay with hysteresis?",
         [("validate", {"cases": ["relay_hyst_servo"]})],
         lambda r: r.result["exact"]["cycles"][0]["period"] == near(hysteresis_period(), 1e-9)
         and r.result["agreement"] == "agree"),
    # Lengths of a loop with play are in proportion to its gap, and times do not depend on it.
    Task("How does the cycle of backlash_servo grow with its gap?",
         [("branch", {"case": "backlash_servo", "over": "play.gap", "from": "1", "to": "4", "points": 5,
                      "output": "branch.png"})],
         lambda r: np.allclose(r.result["points"]["period"], 3.9938069436018004, rtol=1e-8)
         and np.allclose(np.divide(r.result["points"]["x"], r.result["points"]["value"]), 1.959706261794195, rtol=1e-8)
         and r.texts[-1] == "written: branch.png"),
    Task("Above which gain does my loop oscillate, of 1 and 2?",
         [("sweep", {"case": "third.toml", "axis": ["loop.gain=1,2"], "output": "gains.zarr"})],
         lambda r: r.result["outcome"]["oscillates"] == 1 and r.texts[-1] == "written: gains.zarr"),
    Task("Which cases are there?", [("cases", {})],
         lambda r: len(json.loads(r.texts[1])["cases"]) == len([*CASES.glob("*.toml")])),
]  # fmt: skip


def server(folder: Path, budget: float = 60.0) -> list[str]:
    return [sys.executable, "-m", "eppanalysis", "mcp", str(folder), "--budget", f"{budget:g}"]


@asynccontextmanager
async def session(folder: Path, budget: float = 60.0) -> Any:
    from mcp import Client, StdioServerParameters, stdio_client

    command, *arguments = server(folder, budget)
    path = os.pathsep.join(p for p in sys.path if p)
    parameters = StdioServerParameters(command=command, args=arguments, env={**os.environ, "PYTHONPATH": path})
    async with Client(stdio_client(parameters)) as client:
        yield client


async def called(client: Any, name: str, arguments: dict[str, Any]) -> Reply:
    found = await client.call_tool(name, arguments)
    assert all("Traceback" not in part.text for part in found.content)
    return Reply(bool(found.is_error), [part.text for part in found.content])


def at_work(folder: Path) -> list[str]:
    """Processes that work in a folder."""
    found = []
    for process in Path("/proc").glob("[0-9]*"):
        try:
            if os.readlink(process / "cwd") == str(folder):
                found.append((process / "cmdline").read_text().replace("\0", " "))
        except OSError:  # it has ended, or is another user's
            continue
    return found


def ended(folder: Path, patience: float) -> bool:
    end = time.monotonic() + patience
    while at_work(folder) and time.monotonic() < end:
        time.sleep(0.05)
    return not at_work(folder)


looks_at_processes = pytest.mark.skipif(not Path("/proc/self/cwd").exists(), reason="looks at processes")
#: A call of a minute and more, with processes of its own.
HEAVY: Call = ("bounds", {"case": "fig8a_original", "over": "bands.range", "limit": "lock_pin.backlash", "workers": 2})


@pytest.fixture(scope="module")
def told(tmp_path_factory: pytest.TempPathFactory) -> Iterator[dict[str, Any]]:
    """Replies to the calls of all tasks, in one session; the calls of a task follow each other."""
    import anyio

    folder = tmp_path_factory.mktemp("told")
    for name, text in FILES.items():
        (folder / name).write_text(text, encoding="utf-8")
    replies: dict[str, Any] = {}

    async def ask(client: Any, task: Task) -> None:
        replies[task.question] = [await called(client, *call) for call in task.calls]

    async def ask_all() -> None:
        async with session(folder) as client, anyio.create_task_group() as together:
            replies["tools"] = (await client.list_tools()).tools
            replies["instructions"] = client.instructions
            for task in TASKS:
                together.start_soon(ask, client, task)

    anyio.run(ask_all)
    yield replies
    assert not at_work(folder)


@pytest.mark.parametrize("task", TASKS, ids=lambda task: task.question)
def test_question_is_answered(told: dict[str, Any], task: Task) -> None:
    replies = told[task.question]
    assert task.is_answered(*replies), replies


def test_tools_are_the_commands_with_their_options(told: dict[str, Any]) -> None:
    commands = command_line().commands
    assert {tool.name for tool in told["tools"]} == commands.keys() - {"explore", "mcp", "import"}
    for tool in told["tools"]:
        options = {p.opts[-1].lstrip("-").replace("-", "_"): p for p in commands[tool.name].params}
        left_out = {"json", "help"} | ({"scheduler", "shard", "merge"} if tool.name == "sweep" else set())
        assert tool.input_schema["properties"].keys() == options.keys() - left_out
        assert {*tool.input_schema.get("required", ())} == {name for name, p in options.items() if p.required}
        files = {name for name, p in options.items() if p.metavar in ("CASE", "CSV", "FILE", "FOLDER")}
        assert {*paths_of(tool.input_schema)} == files & tool.input_schema["properties"].keys()
        assert tool.description.splitlines()[0] in commands[tool.name].help
    assert "Limit cycles of loops" in told["instructions"]


def paths_of(schema: dict[str, Any]) -> Iterator[str]:
    """Arguments that lead to files."""
    for name, field in schema["properties"].items():
        if "path" in (field.get("format"), field.get("items", {}).get("format")) or name in ("case", "cases"):
            yield name


def filled(schema: dict[str, Any], **given: Any) -> dict[str, Any]:
    """Arguments with something in place of each that is needed."""
    needed = {name: "x" for name in schema.get("required", ())} | given
    return {n: [v] if schema["properties"][n].get("type") == "array" else v for n, v in needed.items()}


def test_no_path_leads_out_of_the_folder(tmp_path: Path) -> None:
    import anyio

    folder, outside = tmp_path / "inside", tmp_path / "outside"
    folder.mkdir(), outside.mkdir()
    (outside / "third.toml").write_text(THIRD, encoding="utf-8")
    (outside / "back.toml").symlink_to(folder / "mine.toml")
    (folder / "mine.toml").write_text(THIRD, encoding="utf-8")
    (folder / "linked.toml").symlink_to(outside / "third.toml")
    (folder / "out").symlink_to(outside)
    (folder / "run_third.png").symlink_to(outside / "run_third.png")
    (folder / "proofs").mkdir()
    (folder / "proofs" / "free.json").symlink_to(outside / "free.json")
    refused = [str(outside / "third.toml"), "../outside/third.toml", "linked.toml", "out/third.toml", "out/back.toml",
               "run_{case}.png", "proofs", "out/new.toml", ".."]  # fmt: skip

    async def try_all() -> tuple[list[str], list[tuple[str, str, str, Reply]]]:
        found, names = [], set()
        async with session(folder) as client:
            for tool in (await client.list_tools()).tools:
                for name in paths_of(tool.input_schema):
                    names.add(name)
                    for text in refused:
                        reply = await called(client, tool.name, filled(tool.input_schema, **{name: text}))
                        found.append((tool.name, name, text, reply))
        return sorted(names), found

    names, found = anyio.run(try_all)
    assert names == ["backlash", "case", "cases", "certificates", "check", "file", "manual", "output", "picture",
                     "record", "response", "step", "tray"]  # fmt: skip
    for tool, name, text, reply in found:
        assert reply.failed and len(reply.texts) == 1, (tool, name, text)
        assert reply.verdict.startswith(f"{text}: leads out of the folder"), (tool, name, text, reply)
    assert sorted(path.name for path in outside.iterdir()) == ["back.toml", "third.toml"]


def test_no_case_leads_out_of_the_folder(tmp_path: Path) -> None:
    """Of files that a case names, those in its folder are read, and no others."""
    import anyio

    folder = tmp_path / "inside"
    (folder / "below").mkdir(parents=True)
    for place in (tmp_path, folder):
        (place / "third.toml").write_text(THIRD, encoding="utf-8")
        (place / "table.csv").write_text("time,position\n0,0\n1,1\n", encoding="utf-8")
    shutil.copy(CASES / "measured" / "weight_tray.csv", tmp_path / "weights.csv")
    (folder / "linked.toml").symlink_to(tmp_path / "third.toml")
    (folder / "linked.csv").symlink_to(tmp_path / "table.csv")
    (folder / "below" / "weights.csv").symlink_to(tmp_path / "weights.csv")
    (folder / "below" / "arm.toml").write_text('base = "elbow"\ntitle = "An arm"\n', encoding="utf-8")
    heir, curve = 'base = "{}"\ntitle = "t"\n', THIRD.replace('"saturation"', '"lookup_table"\nfile = "{}"')
    driven = SPRING.replace("{", "{{").replace("}", "}}") + 'input = {{ kind = "recorded", file = "{}" }}\n'
    names = {"base": (heir, "third", "../third", "linked", str(tmp_path / "third"))}
    names |= {"loop.elements.0.file": (curve, "table.csv", "../table.csv", "linked.csv", str(tmp_path / "table.csv"))}
    names |= {"run.input.file": (driven, "table.csv", "../table.csv", "linked.csv", str(tmp_path / "table.csv"))}
    good, bad = [], []
    for number, (text, own, *others) in enumerate(names.values()):
        for name in (own, *others):
            (good if name == own else bad).append(f"mine_{number}_{len(good) + len(bad)}.toml")
            (folder / (good if name == own else bad)[-1]).write_text(text.format(name), encoding="utf-8")

    async def try_all() -> list[Reply]:
        async with session(folder) as client:
            weights = {"case": "below/arm.toml", "tray": "weights.csv"}
            return [await called(client, "check", {"cases": good}), await called(client, "check", {"cases": bad}),
                    await called(client, "identify", weights)]  # fmt: skip

    read, refused, tray = anyio.run(try_all)
    assert not read.failed and len(read.verdict.splitlines()) == len(names), read
    assert refused.failed and len(refused.texts) == 1
    for name in bad:
        field = [*names][int(name.split("_")[1])]
        assert f"\n{name}: {field} is " in f"\n{refused.verdict}", refused
    assert tray.failed and tray.verdict == "weights.csv is missing; expected a CSV file that can be read."


@looks_at_processes
def test_a_call_ends_with_its_budget_and_leaves_no_process(tmp_path: Path) -> None:
    import anyio

    async def call() -> tuple[Reply, float, bool, Reply]:
        async with session(tmp_path, budget=1.0) as client:
            begin = time.monotonic()
            reply = await called(client, *HEAVY)
            took = time.monotonic() - begin
            return reply, took, ended(tmp_path, 0.5), await called(client, "nonsense", {})

    reply, took, none_left, after = anyio.run(call)
    assert reply.failed and none_left and took < 3.0
    assert reply.texts == ["bounds: was ended after 1 s, the budget of a call; expected smaller points, starts, or a "
                           "larger --budget."]  # fmt: skip
    assert after.failed and after.verdict.startswith("nonsense: is no tool; expected one of check, predict")
    assert not list(tmp_path.iterdir())


@looks_at_processes
def test_a_cancelled_call_ends_and_the_next_one_is_answered(tmp_path: Path) -> None:
    import anyio

    async def call() -> tuple[bool, bool, Reply]:
        async with session(tmp_path) as client:
            with anyio.move_on_after(2.5) as patience:
                await called(client, *HEAVY)
            none_left = await anyio.to_thread.run_sync(ended, tmp_path, 3.0)
            return patience.cancelled_caught, none_left, await called(client, "schema", {})

    cancelled, none_left, after = anyio.run(call)
    assert cancelled and none_left and not after.failed


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (
            {"case": "third.toml", "over": "loop.gain", "from": 1, "to": 2, "points": "many"},
            "points is 'many'; expected a",
        ),
        ({"case": ["third.toml"], "over": "loop.gain", "from": 1, "to": 2}, "case is ['third.toml']; expected a valid"),
        ({"case": "third.toml", "over": "loop.gain", "from": 1}, "to is missing; expected a value"),
        ({"case": "third.toml", "over": "loop.gain", "from": 1, "to": 2, "point": 3}, "did you mean 'points'?"),
        ({"case": "third.toml", "over": "loop.gain\0", "from": 1, "to": 2}, "holds a zero byte"),
    ],
)
def test_a_wrong_argument_is_a_sentence(arguments: dict[str, Any], sentence: str) -> None:
    from eppanalysis.cli.mcp import tools
    from eppanalysis.errors import EppError

    tool = tools()["branch"]
    with pytest.raises(EppError) as refused:
        tool.command_line(tool.checked(arguments))
    assert str(refused.value).startswith("branch: ") and sentence in str(refused.value)


def said_to(folder: Path) -> subprocess.Popen[str]:
    """A server that has been spoken to in its own protocol, without the client."""
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(p for p in sys.path if p), "PYTHONWARNINGS": "default"}
    pipe = subprocess.PIPE
    process = subprocess.Popen(server(folder), stdin=pipe, stdout=pipe, stderr=pipe, text=True, env=environment)
    hello = {"protocolVersion": "2025-06-18", "capabilities": {}, "clientInfo": {"name": "test", "version": "0"}}
    say(process, {"id": 0, "method": "initialize", "params": hello})
    process.stdout.readline()
    say(process, {"method": "notifications/initialized"})
    return process


def say(process: subprocess.Popen[str], message: dict[str, Any]) -> None:
    process.stdin.write(json.dumps({"jsonrpc": "2.0", **message}) + "\n")
    process.stdin.flush()


def test_nothing_but_the_protocol_is_on_the_output(tmp_path: Path) -> None:
    (tmp_path / "numpy.py").write_text("print('read from the folder')", encoding="utf-8")
    calls = [("new", {"file": "a.toml", "kind": "valve"}), ("predict", {"cases": ["quantised_sensor_ct"]}),
             ("schema", {}), ("check", {"cases": ["none.toml"]})]  # fmt: skip
    process = said_to(tmp_path)
    for number, (name, arguments) in enumerate(calls, start=1):
        say(process, {"id": number, "method": "tools/call", "params": {"name": name, "arguments": arguments}})
    found = [json.loads(process.stdout.readline()) for _ in calls]
    rest, _ = process.communicate(timeout=20)
    assert not rest and process.returncode == 0
    assert {message["id"] for message in found} == {1, 2, 3, 4} and {message["jsonrpc"] for message in found} == {"2.0"}
    texts = {m["id"]: [part["text"] for part in m["result"]["content"]] for m in found}
    assert texts[1][-1] == "written: a.toml" and json.loads(texts[3][0])["type"] == "object"
    assert texts[4] == ["none.toml is missing; expected a case file."] and "from the folder" not in str(texts)


@looks_at_processes
@pytest.mark.parametrize("how", ["its input ends", "it is ended"])
def test_no_call_outlives_the_server(tmp_path: Path, how: str) -> None:
    process = said_to(tmp_path)
    say(process, {"id": 1, "method": "tools/call", "params": {"name": HEAVY[0], "arguments": HEAVY[1]}})
    end = time.monotonic() + 20.0
    while not at_work(tmp_path) and time.monotonic() < end:
        time.sleep(0.05)
    assert at_work(tmp_path)
    if how == "it is ended":
        process.send_signal(signal.SIGTERM)
    _, said = process.communicate(timeout=20)
    assert ended(tmp_path, 3.0) and "Traceback" not in said


def test_a_folder_that_is_none_and_a_budget_that_is_none_are_refused(tmp_path: Path) -> None:
    for arguments, sentence in (
        (["mcp", str(tmp_path / "none")], "none: is no folder; expected an existing one."),
        (["mcp", str(tmp_path), "--budget", "0"], "--budget 0: is no time; expected a positive number of seconds."),
    ):
        done = subprocess.run([*server(tmp_path)[:3], *arguments], capture_output=True, text=True, check=False)
        assert done.returncode == 2 and not done.stdout and done.stderr.strip().endswith(sentence)
