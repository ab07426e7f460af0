"""The map of job B by the batch engine, apart from the rivals, so that a process for memory stays small."""

from __future__ import annotations

import threading
import time

import numpy as np
from numpy.typing import NDArray

import eppanalysis as epp
from eppanalysis.methods.simulation.batch import BatchResult, HybridStack, simulate_batch
from eppanalysis.sweep.axes import make_design
from eppanalysis.sweep.cells import make_builder

Array = NDArray[np.float64]

RANGES, BACKLASHES = (1.0, 5.0), (0.0, 3.0)
T_END = 6.0


def axes(side: int) -> tuple[Array, Array]:
    """Profile ranges [lbf] and backlashes [deg]."""
    return np.linspace(*RANGES, side), np.linspace(*BACKLASHES, side)


def map_axes(side: int) -> dict[str, str]:
    """The same as a sweep takes them."""
    return {
        "bands.range": f"{RANGES[0]}:{RANGES[1]}:{side}:lbf",
        "lock_pin.backlash": f"{BACKLASHES[0]}:{BACKLASHES[1]}:{side}:deg",
    }


def make_stack(side: int) -> HybridStack:
    """The map's cells, from the case file on, as a sweep makes them."""
    case = epp.case("fig8a_original")
    design = make_design(case, map_axes(side))
    ((_, stack),), wrong = make_builder(case, design).stacks(np.indices((side, side)).reshape(2, -1).T)
    assert not wrong
    return stack


def solve_map(side: int, threads: int) -> BatchResult:
    """The whole job: make the cells and run them."""
    return simulate_batch(make_stack(side), T_END, threads=threads)


def largest_memory() -> float:
    """Largest resident memory of this process so far [MB]; `ru_maxrss` may be that of the process that started it."""
    with open("/proc/self/status") as status:
        return next(float(line.split()[1]) for line in status if line.startswith("VmHWM")) / 1024


def peak_memory(side: int) -> dict[str, float]:
    """Largest resident memory [MB] while this process solves the map, looked at every 2 ms, and that before it."""
    import psutil

    process, peak, done = psutil.Process(), 0, threading.Event()
    solve_map(2, 2)
    before = process.memory_info().rss

    def watch() -> None:
        nonlocal peak
        while not done.is_set():
            peak = max(peak, process.memory_info().rss)
            time.sleep(2e-3)

    watcher = threading.Thread(target=watch)
    watcher.start()
    begin = time.perf_counter()
    solve_map(side, 2)
    seconds = time.perf_counter() - begin
    done.set()
    watcher.join()
    return {"cells": side * side, "seconds": seconds, "before": before / 1e6, "peak": peak / 1e6}
