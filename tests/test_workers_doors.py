"""Processes at the doors: scripts without a main guard, systems without shared memory, and no port that is opened."""

from __future__ import annotations

import multiprocessing.synchronize
import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

import eppanalysis as epp
from eppanalysis.errors import EppError
from eppanalysis.workers import workers

SWEEP = """
import eppanalysis as epp
r = epp.sweep(epp.case("backlash_servo"), {"loop.gain": [1.0, 2.0]}, workers=2, scheduler="processes", progress=False)
"""
POOL = """
from eppanalysis.workers import workers
with workers(2) as pool:
    print(list(pool.map(abs, [1, -2])))
"""
#: What a script that may start processes computes, while another thread looks which ports are open.
LOOKS = """
import os, threading, time
import eppanalysis as epp

def inodes():
    mine = os.popen("cat /proc/net/tcp /proc/net/tcp6 2>/dev/null").read().splitlines()
    return {row.split()[9] for row in mine if len(row.split()) > 9 and row.split()[3] == "0A"}

def sockets(pid):
    for name in os.listdir(f"/proc/{pid}/fd"):
        try:
            yield os.readlink(f"/proc/{pid}/fd/{name}")
        except OSError:
            pass

def family(pid):
    yield pid
    for task in os.listdir(f"/proc/{pid}/task"):
        for child in open(f"/proc/{pid}/task/{task}/children").read().split():
            yield from family(int(child))

def look(seen):
    while not seen["over"]:
        for pid in [*family(os.getpid())]:
            try:
                seen["pids"].add(pid)
                listening = {f"socket:[{inode}]" for inode in inodes()} & set(sockets(pid))
                seen["ports"] |= listening
            except OSError:
                pass
        time.sleep(0.05)

if __name__ == "__main__":
    seen = {"over": False, "ports": set(), "pids": set()}
    thread = threading.Thread(target=look, args=(seen,))
    thread.start()
    case = epp.case("backlash_servo")
    axes = {"loop.gain": [1.0, 2.0, 3.0, 4.0]}
    there = epp.sweep(case, axes, chunk=1, workers=2, scheduler="processes", progress=False)
    seen["over"] = True
    thread.join()
    assert there.identical(epp.sweep(case, axes, progress=False))
    assert len(seen["pids"]) >= 3, seen
    assert not seen["ports"], seen
    print("no port")
"""


def run(script: Path, text: str) -> subprocess.CompletedProcess[str]:
    script.write_text(text)
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(p for p in sys.path if p)}
    return subprocess.run(
        [sys.executable, str(script)], env=environment, check=False, capture_output=True, text=True, timeout=120
    )


@pytest.mark.slow
@pytest.mark.parametrize("text", [SWEEP, POOL], ids=["sweep", "pool"])
def test_a_script_without_a_main_guard_is_told_so_in_one_sentence(tmp_path: Path, text: str) -> None:
    found = run(tmp_path / "script.py", text)
    assert found.returncode == 1
    assert found.stderr.count("Traceback") == 1  # that of the script itself, none of its processes
    assert found.stderr.splitlines()[-1].startswith("eppanalysis.errors.EppError: ")
    assert "expected the line if __name__ ==" in found.stderr.splitlines()[-1]


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/net/tcp").exists(), reason="looks at the sockets of processes")
def test_processes_of_a_sweep_open_no_port_to_others(tmp_path: Path) -> None:
    found = run(tmp_path / "script.py", LOOKS)
    assert found.stdout.strip() == "no port", found.stderr[-2000:]


@pytest.fixture
def no_shared_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    def refused(*_: object, **__: object) -> None:
        raise OSError(13, "Permission denied")

    monkeypatch.setattr(multiprocessing.synchronize.SemLock, "__init__", refused)


@pytest.mark.usefixtures("no_shared_memory")
def test_without_shared_memory_one_does_it_all(capsys: pytest.CaptureFixture[str]) -> None:
    with workers(3) as pool:
        assert pool is None
    said = capsys.readouterr().err.splitlines()
    assert len(said) == 1 and "/dev/shm" in said[0]


@pytest.mark.usefixtures("no_shared_memory")
def test_without_shared_memory_a_sweep_on_processes_is_refused_in_one_sentence() -> None:
    with pytest.raises(EppError, match=r"Permission denied.*expected.*/dev/shm"):
        epp.sweep(epp.case("backlash_servo"), {"loop.gain": [1.0]}, scheduler="processes", progress=False)


def test_a_process_that_is_lost_is_told_in_one_sentence() -> None:
    begin = time.monotonic()
    with pytest.raises(EppError, match="worker process ended before its time"), workers(2) as pool:
        assert pool is not None
        pool.submit(os._exit, 3).result()
    assert time.monotonic() - begin < 30.0
