"""Settings of all tests: the same random examples in every run, pictures without a display."""

from __future__ import annotations

import gc
import os
import signal
import threading
from collections.abc import Generator
from functools import cache

# As the command line has it, for processes that tests start: threads of several get in each other's way.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import matplotlib as mpl
import pytest
import threadpoolctl
import typer.testing
from hypothesis import HealthCheck, settings
from hypothesis.internal.conjecture import providers

mpl.use("Agg")

# A plugin of pytest that another package brings may have imported numpy, which asks for that variable no more.
threadpoolctl.threadpool_limits(1, "blas")

# The command line is made once in a process, as its users do, and not for each command that a test runs.
typer.testing._get_command = cache(typer.testing._get_command)

# Derandomised, so that a run never fails by luck; no deadline, because machines are busy.
settings.register_profile(
    "fixed", derandomize=True, deadline=None, print_blob=True, suppress_health_check=[HealthCheck.too_slow]
)
settings.load_profile("fixed")

# It would also try the numbers that stand in the modules loaded by then, which hang on the tests that came before.
providers._get_local_constants = lambda: providers._local_constants

# A shell starts what runs in its background with interrupts ignored, and children inherit that; the tests send some.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN and threading.current_thread() is threading.main_thread():
    signal.signal(signal.SIGINT, signal.default_int_handler)


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


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """The engine with sanitizers first: its minute is one for which the other worker would be idle at the end."""
    items.sort(key=lambda item: item.path.name != "test_builds.py")
