"""The page on growing from a laptop to a cluster: its commands and its script run, on a cluster of this machine."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from eppanalysis.sweep import open_sweep, sweep
from tests.sweep.test_store import AXES, CASE

PAGE = (Path(__file__).parents[2] / "docs" / "howto" / "sweeps.md").read_text(encoding="utf-8")
#: The sweep of the page is a million cells; here its axes are those of the tests.
SMALL = {
    "bands.range=1:5:1000:lbf": "bands.range=1:5:6:lbf",
    "lock_pin.backlash=0:3:1000:deg": "lock_pin.backlash=0:3:8:deg",
}


def command(begin: str) -> str:
    """A command of the page on one line, without its comment."""
    (found,) = re.findall(rf"^((?:OPENBLAS_NUM_THREADS=1 )?{re.escape(begin)}(?:.*\\\n)*.*)$", PAGE, re.MULTILINE)
    return found.replace("\\\n", " ").partition("#")[0]


def words(line: str, address: str = "") -> list[str]:
    for text, other in SMALL.items():
        line = line.replace(text, other)
    found = [w for w in line.replace("tcp://head:8786", address).split() if not w.startswith("OPENBLAS")]
    program = {"dask": ["-m", "dask"], "eppanalysis": ["-m", "eppanalysis"]}[found[0]]
    return [sys.executable, *program, *found[1:]]


def environment() -> dict[str, str]:
    path = os.pathsep.join(p for p in sys.path if p)
    return {**os.environ, "PYTHONPATH": path, "OPENBLAS_NUM_THREADS": "1", "PYTHONWARNINGS": "ignore"}


def run(arguments: list[str], folder: Path) -> str:
    """Output of a program that ends well."""
    done = subprocess.run(arguments, cwd=folder, env=environment(), check=False, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.slow
def test_scheduler_and_workers_started_by_the_page_give_the_same_bits(tmp_path) -> None:
    def start(arguments: list[str], name: str) -> subprocess.Popen:
        with (tmp_path / name).open("w") as log:
            return subprocess.Popen(
                arguments, cwd=tmp_path, env=environment(), stdout=log, stderr=subprocess.STDOUT, start_new_session=True
            )

    running = [start([*words(command("dask scheduler")), "--port", "0", "--no-dashboard"], "scheduler.log")]
    try:
        address, end = "", time.monotonic() + 60
        while not address and time.monotonic() < end:
            found = re.search(r"tcp://[\d.]+:\d+", (tmp_path / "scheduler.log").read_text())
            address = found[0] if found else ""
            time.sleep(0.1)
        worker = [w if w != "-1" else "2" for w in words(command("dask worker"), address)]
        running.append(start([*worker, "--no-dashboard"], "workers.log"))
        call = words(command("eppanalysis sweep fig8a_original --scheduler tcp"), address)
        done = subprocess.run(
            [*call, "--set", "run.t_end=1 s"],
            cwd=tmp_path,
            env=environment(),
            check=False,
            capture_output=True,
            text=True,
        )
        assert done.returncode == 0, done.stderr
        assert "48 designs: " in done.stdout
    finally:
        for process in reversed(running):
            os.killpg(process.pid, signal.SIGTERM)
            process.wait(30)
    assert sweep(CASE, AXES, progress=False).equals(open_sweep(tmp_path / "map.zarr").load())


@pytest.mark.slow
def test_the_script_of_the_page_runs(tmp_path) -> None:
    (script,) = [b for b in re.findall(r"^```python\n(.*?)^```", PAGE, re.MULTILINE | re.DOTALL) if "LocalCluster" in b]
    (tmp_path / "script.py").write_text(script)
    output = run([sys.executable, "script.py"], tmp_path)
    assert re.fullmatch(r"\d+ of 272 elbows oscillate", output.strip())
    assert open_sweep(tmp_path / "map.zarr")["outcome"].shape == (17, 16)
