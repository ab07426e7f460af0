"""Processor time of the elbow's run of six seconds in two checkouts: python -m benchmarks.paired BEFORE AFTER.

Each checkout runs in a process of its own; they take turns, so that a busy machine disturbs both alike, and the least
of many times counts: what disturbs a run only ever makes it longer.
"""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

#: Turns of each checkout, and runs in a turn.
TURNS, RUNS = 30, 25

_WORKER = """
import sys, time
import numpy as np
import eppanalysis as epp
from eppanalysis.methods.simulation.runs import run_hybrid
from eppanalysis.models.systems.hybrid import HybridSystem
from eppanalysis.models.systems.inputs import input_signals_by_name

case = epp.case("fig8a_original")
system = case.to_system()
hybrid = HybridSystem.from_lure(system, input_signals_by_name(system.input_names, case.input))
times = np.linspace(0.0, 6.0, 6001)
run_hybrid(hybrid, 6.0, times, 1e-3, 200_000, 20_000)
for line in sys.stdin:
    best = float("inf")
    for _ in range(int(line)):
        begin = time.process_time()
        run_hybrid(hybrid, 6.0, times, 1e-3, 200_000, 20_000)
        best = min(best, time.process_time() - begin)
    print(best, flush=True)
"""


def _worker(checkout: str) -> subprocess.Popen[str]:
    environment = {**os.environ, "PYTHONPATH": str(Path(checkout).resolve())}
    command = [sys.executable, "-c", _WORKER]
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
    return subprocess.Popen(command, env=environment, cwd=checkout, **pipes)


def main(checkouts: list[str]) -> None:
    """Least time in each checkout, and relative to the first."""
    workers = [_worker(c) for c in checkouts]
    least = [float("inf")] * len(workers)
    for _ in range(TURNS):
        for i, worker in enumerate(workers):
            worker.stdin.write(f"{RUNS}\n")
            worker.stdin.flush()
            least[i] = min(least[i], float(worker.stdout.readline()))
    for checkout, seconds in zip(checkouts, least, strict=True):
        sys.stdout.write(f"{checkout}: {1e3 * seconds:.4f} ms, {seconds / least[0]:.3f} of the first\n")
    for worker in workers:
        worker.stdin.close()
        worker.wait()


if __name__ == "__main__":
    main(sys.argv[1:])
