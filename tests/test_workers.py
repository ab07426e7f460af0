"""Processes that work for another, which no interrupt reaches and none of which outlives it; and their threads."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from eppanalysis.workers import workers

pytestmark = [pytest.mark.slow, pytest.mark.skipif(os.name != "posix", reason="signals")]

#: Three processes that sleep longer than any test; their numbers are printed one a line.
SCRIPT = """
import os, sys, time

from eppanalysis.workers import workers

def sleep(_):
    os.write(1, f"{os.getpid()}\\n".encode())
    time.sleep(300)

if __name__ == "__main__":
    try:
        with workers(3) as pool:
            list(pool.map(sleep, range(3)))
    except KeyboardInterrupt:
        print("interrupted", flush=True)
        sys.exit(130)
"""


@pytest.fixture
def parent(tmp_path: Path) -> Iterator[subprocess.Popen[str]]:
    """A process with three workers, in a group of its own as a terminal makes one."""
    script = tmp_path / "parent.py"
    script.write_text(SCRIPT)
    process = subprocess.Popen(
        [sys.executable, str(script)], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True
    )
    yield process
    with contextlib.suppress(ProcessLookupError):  # what a failed test has left
        os.killpg(process.pid, signal.SIGKILL)
    process.communicate()


def gone(pids: list[int]) -> bool:
    """Whether processes have ended within some seconds."""
    for _ in range(100):
        if not any(alive(pid) for pid in pids):
            return True
        time.sleep(0.1)
    return False


def alive(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return True


def test_an_interrupt_of_the_whole_group_ends_workers_without_a_word(parent: subprocess.Popen[str]) -> None:
    pids = [int(parent.stdout.readline()) for _ in range(3)]
    os.killpg(parent.pid, signal.SIGINT)
    said, errors = parent.communicate(timeout=20)
    assert (parent.returncode, said, errors) == (130, "interrupted\n", "")
    assert gone(pids)


def test_an_interrupt_while_workers_start_is_no_different(parent: subprocess.Popen[str]) -> None:
    children = Path(f"/proc/{parent.pid}/task/{parent.pid}/children")
    if not children.exists():
        pytest.skip("no list of children")
    while len(children.read_text().split()) < 3:  # the keeper of shared things, and two workers
        time.sleep(0.001)
    pids = [int(pid) for pid in children.read_text().split()]
    os.killpg(parent.pid, signal.SIGINT)
    _, errors = parent.communicate(timeout=20)
    assert "Traceback" not in errors
    assert gone(pids)


#: Sends itself a signal when a worker has been started and has not been given all that it reads.
AMID = """
import os, signal, sys
from multiprocessing import util
from eppanalysis.cli.ends import end_as_interrupted
from eppanalysis.workers import workers

begin = util.spawnv_passfds

def spawn(path, args, passed):
    pid = begin(path, args, passed)
    if "--multiprocessing-fork" in map(os.fsdecode, args):
        os.kill(os.getpid(), signal.Signals[sys.argv[1]])
    return pid

if __name__ == "__main__":
    util.spawnv_passfds = spawn
    end_as_interrupted()
    try:
        with workers(2) as pool:
            print("not interrupted")
    except KeyboardInterrupt:
        print("interrupted")
"""


@pytest.mark.parametrize("signalled", [signal.SIGTERM, signal.SIGINT])
def test_an_interrupt_amid_the_start_of_a_worker_comes_behind_it(tmp_path: Path, signalled: signal.Signals) -> None:
    script = tmp_path / "amid.py"
    script.write_text(AMID)
    command = [sys.executable, str(script), signalled.name]
    ended = subprocess.run(command, check=False, capture_output=True, text=True, timeout=60)
    assert (ended.stdout, ended.stderr) == ("interrupted\n", "")


def test_no_thread_of_the_workers_is_left_where_their_block_ends_badly() -> None:
    before = set(threading.enumerate())
    with pytest.raises(KeyboardInterrupt), workers(2) as pool:
        pool.submit(time.sleep, 300)
        raise KeyboardInterrupt
    assert set(threading.enumerate()) == before


def test_workers_do_not_outlive_a_parent_that_is_killed(parent: subprocess.Popen[str]) -> None:
    pids = [int(parent.stdout.readline()) for _ in range(3)]
    parent.kill()
    parent.wait()
    assert gone(pids)


def test_each_worker_does_linear_algebra_in_one_thread(monkeypatch) -> None:
    monkeypatch.delenv("OPENBLAS_NUM_THREADS", raising=False)
    with workers(2) as pool:
        assert pool is not None
        assert pool.submit(os.getenv, "OPENBLAS_NUM_THREADS").result() == "1"
    assert "OPENBLAS_NUM_THREADS" not in os.environ
    monkeypatch.setenv("OPENBLAS_NUM_THREADS", "2")
    with workers(2) as pool:
        assert pool is not None
        assert pool.submit(os.getenv, "OPENBLAS_NUM_THREADS").result() == "2"


#: Threads of linear algebra before, within and behind a public function; and last bits of a sweep.
THREADS = """
import numpy as np
import eppanalysis as epp
from threadpoolctl import threadpool_info

def threads():
    return {library["num_threads"] for library in threadpool_info() if library["user_api"] == "blas"}

before, within = threads(), set()
epp.find_limit_cycles(epp.case("relay_deadzone"), progress=lambda *_: within.update(threads()))
print(*before, *within, *(threads() - before))
at = {"bands.range": ["2 lbf", "2.5 lbf"]}
found = epp.sweep(epp.case("light_forearm"), at, run=["simulate", "predict"], progress=False)
print(*(found[name].values.tobytes().hex() for name in sorted(found.data_vars) if found[name].dtype.kind == "f"))
"""


def test_linear_algebra_takes_one_thread_within_public_functions_and_as_many_as_before_behind_them() -> None:
    said = {}
    for given in ("1", "2"):
        environment = {**os.environ, "OPENBLAS_NUM_THREADS": given}
        run = subprocess.run(
            [sys.executable, "-c", THREADS], env=environment, check=True, capture_output=True, text=True
        )
        counts, bits = run.stdout.splitlines()
        assert counts.split() == [given, "1"]
        said[given] = bits
    assert said["1"] == said["2"]


def test_a_library_that_is_loaded_within_a_block_takes_one_thread_there_and_as_many_as_the_others_behind_it() -> None:
    code = """
import sys
import numpy
from threadpoolctl import threadpool_info
from eppanalysis.workers import one_thread

threads = lambda: [library["num_threads"] for library in threadpool_info() if library["user_api"] == "blas"]
with one_thread():
    assert "scipy.linalg" not in sys.modules
    import scipy.linalg
    print(*set(threads()))
print(*set(threads()))
with one_thread():
    print(*set(threads()))
"""
    free = {name: value for name, value in os.environ.items() if not name.endswith("_NUM_THREADS")}
    for given in (free | {"OPENBLAS_NUM_THREADS": "2"}, free):
        run = subprocess.run([sys.executable, "-c", code], env=given, check=True, capture_output=True, text=True)
        within, behind, again = run.stdout.split()
        assert (within, again) == ("1", "1")
        assert int(behind) > 1


def test_blocks_that_overlap_end_with_the_last_of_them() -> None:
    code = """
import scipy.linalg
from contextlib import ExitStack
from threadpoolctl import threadpool_info
from eppanalysis.workers import one_thread

threads = lambda: {library["num_threads"] for library in threadpool_info() if library["user_api"] == "blas"}
first, second = ExitStack(), ExitStack()
first.enter_context(one_thread())
second.enter_context(one_thread())
first.close()
print(*threads())
second.close()
print(*threads())
"""
    environment = {**os.environ, "OPENBLAS_NUM_THREADS": "2"}
    run = subprocess.run([sys.executable, "-c", code], env=environment, check=True, capture_output=True, text=True)
    assert run.stdout.split() == ["1", "2"]
