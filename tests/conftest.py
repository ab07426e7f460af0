"""Settings of all tests: the same random examples in every run, pictures without a display, kernels compiled once."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading

# As the command line has it; numpy asks when it is imported. Threads of several test processes get in each other's way.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import matplotlib as mpl
import pytest
from hypothesis import HealthCheck, settings

mpl.use("Agg")

# Derandomised, so that a run never fails by luck; no deadline, because the first call of a kernel compiles it.
settings.register_profile(
    "fixed", derandomize=True, deadline=None, print_blob=True, suppress_health_check=[HealthCheck.too_slow]
)
settings.load_profile("fixed")

# A shell starts what runs in its background with interrupts ignored, and children inherit that; the tests send some.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN and threading.current_thread() is threading.main_thread():
    signal.signal(signal.SIGINT, signal.default_int_handler)

#: Calls the kernels that most tests need.
CALLS = """
import eppanalysis as epp

epp.sweep(epp.case("relay_deadzone"), {"relay_dead_zone.threshold": [1.0]}, run="all", progress=False)
"""
COMPILING = pytest.StashKey[subprocess.Popen[bytes]]()


def pytest_sessionstart(session: pytest.Session) -> None:
    """One process compiles while workers collect; else each of them would compile the same for itself."""
    if session.config.getoption("numprocesses", None):
        process = subprocess.Popen([sys.executable, "-c", CALLS], cwd=session.config.rootpath)
        session.config.stash[COMPILING] = process
        session.config.add_cleanup(process.kill)


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_node_collection_finished(node: object) -> None:
    """No test begins before what it needs is compiled."""
    process = node.config.stash.get(COMPILING, None)
    if process is not None:
        process.wait()
