"""Builds of the engine: all give the same bits, and what native code alone can do wrong is looked for."""

from __future__ import annotations

import importlib.util
import os
import re
import shutil
import subprocess
import sys
import threading
from pathlib import Path

import numpy as np
import pytest

import eppanalysis as epp
from eppanalysis.engine import _engine
from tests.engine.fuzzer import tried

ROOT = Path(__file__).parents[2]
SOURCES = ROOT / "eppanalysis" / "engine"
#: What is run with sanitizers.
SANITIZED = (
    "orbits", "test_arguments.py", "test_balances.py", "test_delays.py", "test_growth.py", "test_jumps.py",
    "test_newton.py", "test_periodic.py", "test_periodicity.py", "test_responses.py",
)  # fmt: skip
#: Seconds of processor time that automata are drawn for.
FUZZ = float(os.environ.get("EPP_FUZZ", "6"))


def run_python(*args: str, limit: float = 600.0, **environment: str) -> str:
    """What a process of its own prints; it may neither crash nor go on for ever."""
    made = subprocess.run(
        [sys.executable, *args],
        cwd=ROOT,
        env=os.environ | environment,
        capture_output=True,
        text=True,
        timeout=limit,
        check=False,
    )
    assert made.returncode == 0, made.stdout[-4000:] + made.stderr[-4000:]
    return made.stdout


@pytest.mark.slow
def test_the_modules_of_a_wheel_give_the_same_bits() -> None:
    if importlib.util.find_spec("eppanalysis.engine._native_avx2") is None or not _engine.__name__.endswith("avx2"):
        pytest.skip("no wheel with a module for AVX2, or a processor without")
    from eppanalysis.engine import _native

    tests = "tests/engine/test_run.py", "tests/engine/test_balances.py", "tests/engine/orbits"
    told = run_python("-m", "pytest", "-q", "-p", "tests.beside", f"--beside={_native.__file__}", *tests)
    found = re.search(r"(\d+) calls of the engine give the same bits in both builds", told)
    assert found and int(found[1]) > 100


def library(name: str) -> str:
    """Path of a library of the compiler, a bare name where it has none."""
    return subprocess.run(
        ["gcc", f"-print-file-name={name}"], capture_output=True, text=True, check=True
    ).stdout.strip()


@pytest.fixture(scope="module")
def sanitized(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The engine with sanitizers of addresses and of undefined behaviour, and the bounds of every access checked."""
    pytest.importorskip("nanobind")
    if not all(map(shutil.which, ("gcc", "cmake", "ninja"))) or not os.path.isabs(library("libasan.so")):
        pytest.skip("no GCC with its sanitizers, or no CMake and Ninja")
    folder = tmp_path_factory.mktemp("sanitized")
    options = "-DEPP_SANITIZE=ON", "-DEPP_CHECKED=ON", f"-DPython_EXECUTABLE={sys.executable}"
    for command in (
        ["cmake", "-G", "Ninja", "-S", str(SOURCES), "-B", str(folder), *options],
        ["ninja", "-C", folder, "_native"],
    ):
        made = subprocess.run(command, capture_output=True, text=True, check=False)
        assert made.returncode == 0, made.stdout[-4000:] + made.stderr[-4000:]
    return next(folder.glob("_native*.so"))


@pytest.mark.slow
def test_sanitizers_find_nothing(sanitized: Path) -> None:
    """Those of the tests that reach most of the sources in the least time: all take four times as long."""
    tests = [f"tests/engine/{name}" for name in SANITIZED]
    libraries = " ".join(library(name) for name in ("libasan.so", "libubsan.so"))
    told = run_python(
        "-m", "pytest", "-q", "-p", "tests.built", f"--built={sanitized}", *tests,
        LD_PRELOAD=libraries, ASAN_OPTIONS="detect_leaks=0",
    )  # fmt: skip
    assert "passed" in told


@pytest.mark.parametrize("name", ["fig8a_original", "relay_fopdt_closed", "backlash_servo"])
def test_two_threads_on_one_system_find_the_bits_of_one(name: str) -> None:
    case, times = epp.case(name), np.linspace(0.0, 4.0, 400)

    def run() -> tuple[bytes, ...]:
        found = epp.simulate(case, t_end=4.0, t_eval=times)
        return np.array([e.time for e in found.events]).tobytes(), *(found.signals[k].tobytes() for k in found.signals)

    alone, found, together = run(), [], threading.Barrier(2)

    def run_some() -> None:
        together.wait()
        found.extend(run() for _ in range(5))

    threads = [threading.Thread(target=run_some) for _ in range(2)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(found) == 10 and set(found) == {alone}


@pytest.mark.slow
def test_random_automata_neither_crash_nor_hang_nor_give_numbers_that_are_none() -> None:
    told = run_python("-m", "tests.engine.fuzzer", f"--seconds={FUZZ}", limit=10.0 * FUZZ + 60.0)
    for what in ("run: settled", "run: diverged", "run: undecided", "describe: described", "answer_series: regime"):
        assert what in told, told  # all that it looks for is there


@pytest.mark.parametrize(
    ("seed", "ends"),
    [
        (3, "describe: not described"),  # an output so small that no panel of its integral agrees with its halves
        (60, "run: refused, EppError"),  # a mode that sticks where its output does not move its input
        (134, "answer_series: regime"),  # a weight that is no number
        (980, "run: undecided"),  # elements that let one another go in a circle
        (4150, "run: "),  # switches at one instant that repeat, which had no period to divide by
    ],
)
@pytest.mark.filterwarnings("ignore:.*:RuntimeWarning")
def test_what_once_went_on_for_ever_or_ended_in_numbers_that_are_none(seed: int, ends: str) -> None:
    assert tried(seed).startswith(ends)


@pytest.mark.parametrize("amplitude", [1e9, 1e17])
def test_a_curve_that_varies_without_end_in_a_period_has_no_describing_function(amplitude: float) -> None:
    build = epp.AutomatonBuilder(smooth=(epp.Smooth("sine", np.ones(1)),))
    build.mode("waves", from_smooth=1.0)
    element = epp.AutomatonElement(build.build())
    assert np.isnan(element.describing_function(amplitude)[1])
    assert np.isfinite(element.describing_function(1e3)[1])
