"""Settings of all tests: the same random examples in every run, pictures without a display, kernels compiled once."""

from __future__ import annotations

import gc
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Generator

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

#: Calls the kernels that most tests need: those of runs and of smooth elements' orbits, and beside them those of
#: predictions, balances and orbits.
RUNS = """
import eppanalysis as epp

epp.simulate(epp.case("relay_deadzone"))
print("the engine is there", flush=True)
epp.sweep(epp.case("relay_deadzone"), {"relay_dead_zone.threshold": [1.0]}, progress=False)
smooth = epp.case("van_der_pol_mu1")
orbit = epp.exact_orbit(smooth, epp.predict_limit_cycles(smooth)[-1])
epp.continue_branch(smooth, "cube.scale", 0.33, 0.3, cycle=orbit, n_points=2, n_others=0)
"""
ORBITS = """
import eppanalysis as epp

case, play = epp.case("relay_deadzone"), epp.AutomatonElement(epp.Play(1.0).automaton())
play.describing_function([2.0])
epp.RateLimiter(1.0).describing_function([2.0])
predicted = epp.predict_limit_cycles(case)[-1]
elbow = epp.case("fig8a_original")
epp.harmonic_balance(elbow, epp.predict_limit_cycles(elbow)[-1])
input()
orbit = epp.exact_orbit(case, predicted)
epp.continue_branch(case, "relay_dead_zone.threshold", 1.0, 1.1, cycle=orbit, n_points=2, n_others=0)
"""
COMPILING = pytest.StashKey[list[subprocess.Popen[bytes]]]()
CALLED = pytest.StashKey[set[str]]()


def pytest_sessionstart(session: pytest.Session) -> None:
    """Two processes compile while workers collect; else each of these would compile the same for itself."""
    if session.config.getoption("numprocesses", None):
        root, python = session.config.rootpath, [sys.executable, "-c"]
        runs = subprocess.Popen([*python, RUNS], cwd=root, stdout=subprocess.PIPE)
        orbits = subprocess.Popen([*python, ORBITS], cwd=root, stdin=runs.stdout)  # waits for the engine of the first
        runs.stdout.close()
        session.config.stash[COMPILING] = [runs, orbits]
        for process in (runs, orbits):
            session.config.add_cleanup(process.kill)


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Generator[None, object, object]:
    """What modules hold stays to the end: it is no garbage, and is not looked through again and again.

    Little of what tests leave is garbage in circles: looking for it twenty times as often takes 3 % more time.
    """
    gc.disable()
    try:
        return (yield)
    finally:
        gc.freeze()
        gc.set_threshold(15_000, 10, 5)
        gc.enable()


def pytest_collection_finish(session: pytest.Session) -> None:
    """On a fresh machine what modules of tests call is compiled by each worker, and beside them by those two."""
    modules = [module for name, module in sys.modules.items() if name.startswith("eppanalysis.kernels.")]
    found = (value for module in modules for value in vars(module).values() if hasattr(value, "py_func"))
    session.config.stash[CALLED] = {f"{kernel.__module__}.{kernel.__name__}" for kernel in found if kernel.signatures}


@pytest.fixture
def called_by_collecting(pytestconfig: pytest.Config) -> set[str]:
    """Kernels that had been called before the first test."""
    return pytestconfig.stash[CALLED]


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Commands of pages first: some take most of a minute, for which the other worker would be idle at the end."""
    items.sort(key=lambda item: item.path.name != "test_documentation.py")


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_node_collection_finished(node: object) -> None:
    """No test begins before what it needs is compiled."""
    for process in node.config.stash.get(COMPILING, []):
        process.wait()
