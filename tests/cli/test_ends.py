"""A command that is asked to end leaves no temporary files and no processes behind."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

COMMANDS = {
    "report": ("report", "backlash_servo", "-o", "mine.html"),
    "notebook": ("report", "backlash_servo", "-o", "mine.ipynb"),
    "sweep": ("sweep", "fig8a_original", "--axis", "bands.range=1:5:60:lbf", "--axis", "lock_pin.backlash=0:3:60:deg",
              "--scheduler", "processes", "--workers", "2"),
}  # fmt: skip


def family(pid: int) -> list[int]:
    """Processes that a process has started, and those that they have."""
    found = []
    for task in Path(f"/proc/{pid}/task").iterdir():
        for child in (task / "children").read_text().split():
            found += [int(child), *family(int(child))]
    return found


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/self/task").exists(), reason="looks at processes")
@pytest.mark.parametrize("signalled", [signal.SIGTERM, signal.SIGINT])
@pytest.mark.parametrize("what", COMMANDS)
def test_nothing_is_left_behind(tmp_path: Path, what: str, signalled: signal.Signals) -> None:
    there = tmp_path / "there"
    there.mkdir()
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(p for p in sys.path if p), "TMPDIR": str(there)}
    command = [sys.executable, "-m", "eppanalysis", *COMMANDS[what]]
    process = subprocess.Popen(command, env=environment, cwd=tmp_path, stderr=subprocess.PIPE, text=True)
    end = time.monotonic() + 60.0
    while not (children := family(process.pid)) and process.poll() is None and time.monotonic() < end:
        time.sleep(0.05)
    time.sleep(1.0)
    children = family(process.pid)
    assert process.poll() is None and children
    process.send_signal(signalled)
    _, said = process.communicate(timeout=40)
    assert process.returncode == 128 + signalled
    assert said.splitlines()[-1].startswith("Interrupted") and "Traceback" not in said
    end = time.monotonic() + 10.0
    while [pid for pid in children if Path(f"/proc/{pid}").exists()] and time.monotonic() < end:
        time.sleep(0.1)
    assert not [pid for pid in children if Path(f"/proc/{pid}").exists()]
    assert [path.name for path in tmp_path.iterdir()] == ["there"]
    assert not list(there.rglob("eppanalysis-*"))


@pytest.mark.slow
@pytest.mark.parametrize("signalled", [signal.SIGTERM, signal.SIGINT])
def test_threads_of_a_sweep_end_with_the_code_of_the_signal(tmp_path: Path, signalled: signal.Signals) -> None:
    store = tmp_path / "map.zarr"
    axes = ("--axis", "play.gap=1:3:4000", "-o", str(store))
    command = [sys.executable, "-m", "eppanalysis", "sweep", "backlash_servo", *axes]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(p for p in sys.path if p)}
    process = subprocess.Popen(command, env=environment, stderr=subprocess.PIPE, text=True)
    end = time.monotonic() + 60.0
    while not store.exists() and process.poll() is None and time.monotonic() < end:
        time.sleep(0.05)
    process.send_signal(signalled)
    _, said = process.communicate(timeout=40)
    assert said.splitlines()[-1] == "Interrupted: what is done is kept; the same command goes on."
    assert process.returncode == 128 + signalled


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/self/task").exists(), reason="looks at processes")
@pytest.mark.parametrize("signalled", [signal.SIGTERM, signal.SIGINT])
def test_the_explorer_ends_with_the_code_of_the_signal(tmp_path: Path, signalled: signal.Signals) -> None:
    pytest.importorskip("bokeh")
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(p for p in sys.path if p), "TMPDIR": str(tmp_path)}
    command = [sys.executable, "-m", "eppanalysis", "explore", "backlash_servo", "--no-browser", "--port", "0"]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    process = subprocess.Popen(command, env=environment, text=True, **pipes)
    assert process.stdout is not None and process.stdout.readline().endswith("(Ctrl-C ends it)\n")
    children = family(process.pid)
    process.send_signal(signalled)
    _, said = process.communicate(timeout=40)
    assert (process.returncode, said) == (128 + signalled, "")
    end = time.monotonic() + 10.0
    while [pid for pid in children if Path(f"/proc/{pid}").exists()] and time.monotonic() < end:
        time.sleep(0.1)
    assert not [pid for pid in children if Path(f"/proc/{pid}").exists()]
    assert not list(tmp_path.rglob("eppanalysis-*"))


#: Has the process send itself a signal when it imports a module, and then is the command.
AT_IMPORT = """
import os, signal, sys
from eppanalysis.cli import main
number, module = signal.Signals[sys.argv.pop(1)], sys.argv.pop(1)
class Asked:
    def find_spec(self, name, path=None, target=None):
        if name == module:
            sys.meta_path.remove(asked)
            os.kill(os.getpid(), number)
asked = Asked()
sys.meta_path.insert(0, asked)
main()
"""

#: The same in a callback of a weak reference, whose exceptions Python prints and forgets.
IN_A_CALLBACK = AT_IMPORT.replace(
    "            os.kill(os.getpid(), number)\n",
    "            import weakref\n"
    "            gone = asked_once = Asked()\n"
    "            told = weakref.ref(gone, lambda _: [os.kill(os.getpid(), number), list(range(9))])\n"
    "            del gone, asked_once\n",
)

#: The same in text that is executed, as that is of which a dataclass is made.
IN_TEXT = AT_IMPORT.replace(
    "            os.kill(os.getpid(), number)\n",
    """            exec("os.kill(os.getpid(), number)\\nlist(range(9))")\n""",
)


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/self/task").exists(), reason="signals of this system")
@pytest.mark.parametrize("signalled", [signal.SIGTERM, signal.SIGINT])
@pytest.mark.parametrize(
    ("module", "script"),
    [
        ("typer", AT_IMPORT),
        ("pydantic", AT_IMPORT),
        ("eppanalysis.tables.console", AT_IMPORT),
        ("pydantic", IN_A_CALLBACK),
        ("typer", IN_TEXT),
        ("eppanalysis.tables.console", IN_TEXT),
    ],
    ids=["commands", "arguments", "in a command", "in a callback", "in text", "in text of a command"],
)
def test_a_command_that_still_imports_or_reads_its_arguments_says_that_it_was_interrupted(
    tmp_path: Path, module: str, script: str, signalled: signal.Signals
) -> None:
    (tmp_path / "asked.py").write_text(script)
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(p for p in sys.path if p)}
    command = [sys.executable, "-m", "asked", signalled.name, module, "check", "backlash_servo"]
    ended = subprocess.run(
        command, check=False, env=environment, cwd=tmp_path, capture_output=True, text=True, timeout=60
    )
    assert ended.returncode == 128 + signalled
    assert ended.stderr == "Interrupted: nothing is kept.\n" and not ended.stdout
