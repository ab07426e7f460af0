"""Run the benchmark, print its tables, write its result: ``python -m benchmarks``."""

from __future__ import annotations

import argparse
import json
import math
import os
import platform
import sys
import tempfile
import time
import warnings
from collections.abc import Callable
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from benchmarks import growth, job_a, job_b, job_c, job_calls, job_orbit, job_sweep, report, start

ROOT = Path(__file__).parents[1]
RESULT = ROOT / "docs" / "_static" / "benchmarks.json"
CACHE = Path(tempfile.gettempdir()) / "eppanalysis-benchmarks"
PACKAGES = (
    "eppanalysis", "numpy", "scipy", "numba", "control", "casadi", "jax", "diffrax", "scikit-sundae", "numbalsoda",
)  # fmt: skip


def versions() -> dict[str, str]:
    """Of everything that takes part."""
    found = {"Python": platform.python_version()}
    for name in PACKAGES:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            found[name] = "not installed"
    return found


def machine() -> dict[str, Any]:
    """Processor, number of cores and how busy they are."""
    info = Path("/proc/cpuinfo")
    lines = info.read_text(encoding="utf-8").splitlines() if info.exists() else []
    names = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    processor = names[0] if names else platform.processor()
    return {"processor": processor, "cores": os.cpu_count(), "load": os.getloadavg()[0]}


def jobs(quick: bool, clock: str) -> dict[str, Callable[[], dict[str, Any]]]:
    """Parts of the benchmark by name."""
    if quick:
        return {
            "job_a": lambda: job_a.run(CACHE, 0.3, 1, libraries=False, clock=clock),
            "job_b": lambda: job_b.run(3, 1, 1, clock),
            "job_c": lambda: job_c.run(1000, 1, clock),
            "job_orbit": lambda: job_orbit.run(1, clock),
            "job_calls": lambda: job_calls.run(clock, quick=True),
            "job_sweep": lambda: job_sweep.run(4, 1, clock, (5, 16), 10),
            "growth": lambda: growth.run(quick=True),
            "levels": lambda: growth.with_levels((40, 2048), 1, clock),
            "start": lambda: start.run(1, (2,)),
        }
    return {
        "job_a": lambda: job_a.run(CACHE, clock=clock),
        "job_b": lambda: job_b.run(clock=clock),
        "job_c": lambda: job_c.run(clock=clock),
        "job_orbit": lambda: job_orbit.run(clock=clock),
        "job_calls": lambda: job_calls.run(clock),
        "job_sweep": lambda: job_sweep.run(clock=clock),
        "growth": growth.run,
        "levels": lambda: growth.with_levels(clock=clock),
        "start": start.run,
    }


def _plain(value: Any) -> Any:
    """For JSON, which knows neither not-a-number nor infinity."""
    if isinstance(value, dict):
        return {k: _plain(v) for k, v in value.items()}
    if isinstance(value, list):
        return [_plain(v) for v in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def main(arguments: list[str] | None = None) -> dict[str, Any]:
    """Run what the arguments ask for."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description=__doc__)
    names = list(jobs(False, "wall"))
    parser.add_argument("--only", nargs="+", choices=names, default=names, help="parts to run")
    parser.add_argument("--quick", action="store_true", help="small jobs without ODE libraries: does it run at all")
    parser.add_argument("--clock", choices=("wall", "cpu"), default="wall", help="cpu where the machine is shared")
    parser.add_argument("-o", "--output", type=Path, default=RESULT, help="result (JSON); parts that did not run stay")
    given = parser.parse_args(arguments)
    warnings.simplefilter("ignore")
    results = json.loads(given.output.read_text(encoding="utf-8")) if given.output.exists() else {}
    setting = {"machine": machine(), "versions": versions(), "clock": given.clock}
    parts = jobs(given.quick, given.clock)
    for name in given.only:
        begin = time.perf_counter()
        results[name] = parts[name]() | {"setting": setting}
        sys.stderr.write(f"{name}: {time.perf_counter() - begin:.0f} s\n")
        given.output.parent.mkdir(parents=True, exist_ok=True)
        given.output.write_text(json.dumps(_plain(results), indent=1) + "\n", encoding="utf-8")
    sys.stdout.write(report.text(_plain(results)))
    return results


if __name__ == "__main__":
    main()
