"""Sweeps of the map of job B: what scheduling and storing cost beside the bare kernel, threads, chunks, memory."""

from __future__ import annotations

import json
import os
import tempfile
from collections.abc import Sequence
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np

import eppanalysis as epp
from benchmarks.maps import T_END, make_stack, map_axes
from benchmarks.start import fresh
from benchmarks.timing import CLOCKS, Contender, alternate
from eppanalysis.methods.simulation.batch import simulate_batch

TARGET_OVERHEAD, TARGET_MEMORY = 0.10, 1000.0
#: Two threads against one, beside what the processor time that both were given allows; a cell of the map [s].
TARGET_THREADS, TARGET_CELL = 0.95, 0.5e-3
#: Cells that are computed and stored together.
CHUNKS = (25, 100, 250, 1000, 10_000)
MILLION = """
import json, tempfile, time
import eppanalysis as epp
from benchmarks.maps import largest_memory, map_axes
case = epp.case("fig8a_original").with_values({{"run.t_end": {t_end}}})
epp.sweep(case, map_axes(3), progress=False)
before, begin = largest_memory(), time.perf_counter()
with tempfile.TemporaryDirectory() as folder:
    found = epp.sweep(case, map_axes({side}), store=folder + "/map.zarr", scheduler="{scheduler}", progress=False)
    done = int((found["status"] != 0).sum())
print(json.dumps({{"cells": done, "seconds": time.perf_counter() - begin, "before": before, "peak": largest_memory()}}))
"""


class _Sweeps:
    """The sweep of the map, into a new store each time."""

    def __init__(self, side: int, folder: Path) -> None:
        self.case, self.axes, self.folder, self.number = epp.case("fig8a_original"), map_axes(side), folder, count()

    def __call__(self, workers: int = 1, chunk: int | None = None, stored: bool = True) -> Any:
        store = self.folder / f"{next(self.number)}.zarr" if stored else None
        return epp.sweep(self.case, self.axes, workers=workers, chunk=chunk, store=store, progress=False)


def run(
    side: int = 100, turns: int = 3, clock: str = "wall", chunks: Sequence[int] = CHUNKS, million: int = 1000
) -> dict[str, Any]:
    """Everything, on a map of side x side cells; `million` is the side of the map for memory."""
    with tempfile.TemporaryDirectory() as folder:
        sweeps = _Sweeps(side, Path(folder))
        stack = make_stack(side)
        bare = Contender("bare batch kernel, one thread", lambda: simulate_batch(stack, T_END))
        others = [
            Contender("sweep in memory, one thread", lambda: sweeps(stored=False)),
            Contender("sweep into a store, one thread", sweeps),
        ]
        timings = alternate(bare, others, turns, clock)
        rows = []
        for c in (bare, *others):
            t, target = timings[c.name], None if c is bare else TARGET_OVERHEAD
            overhead = t.ratio - 1.0
            met = None if target is None else bool(overhead < target)
            row = {"name": c.name, "seconds": t.seconds, "turns": t.turns, "cells_per_second": side**2 / t.seconds}
            rows.append(row | {"overhead": overhead, "target": target, "met": met})
        return {
            "cells": side**2,
            "rows": rows,
            "cell": _cell(timings[others[0].name].seconds / side**2),
            "threads": _threads(sweeps, side**2, turns),
            "chunks": _chunks(sweeps, side**2, chunks, clock),
            "memory": [_memory(million, scheduler) for scheduler in ("threads", "processes")],  # all compiled by now
        }


def _cell(seconds: float) -> dict[str, Any]:
    """What a cell of the sweep in memory takes, and whether that is little enough."""
    return {"seconds": seconds, "target": TARGET_CELL, "met": bool(seconds <= TARGET_CELL)}


def _threads(sweeps: _Sweeps, cells: int, turns: int) -> dict[str, Any]:
    """Two threads against one into a store; `possible` is what the processor time of both would give on idle cores."""
    spent = np.empty((turns, 2, 2))
    found = []
    for turn in range(turns):
        for workers in (1, 2):
            begin = [now() for now in CLOCKS.values()]
            found.append(sweeps(workers))
            spent[turn, workers - 1] = [now() - b for now, b in zip(CLOCKS.values(), begin, strict=True)]
    speedup, cpu = (float(np.median(spent[:, 0, k] / spent[:, 1, k])) for k in range(2))
    rates = cells / np.median(spent[:, :, 0], axis=0)
    return {
        "cells_per_second": rates.tolist(),
        "speedup": speedup,
        "possible": 2.0 * cpu,
        "target": TARGET_THREADS,
        "met": bool(speedup >= TARGET_THREADS * 2.0 * cpu),
        "same": all(found[0].identical(other) for other in found[1:]),
        "load": os.getloadavg()[0],
    }


def _chunks(sweeps: _Sweeps, cells: int, chunks: Sequence[int], clock: str) -> list[dict[str, Any]]:
    """Rates of storing more and more cells together, on one thread."""
    rows = []
    for chunk in chunks:
        begin = CLOCKS[clock]()
        sweeps(chunk=chunk)
        rows.append({"chunk": chunk, "cells_per_second": cells / (CLOCKS[clock]() - begin)})
    return rows


def _memory(side: int, scheduler: str, t_end: float = 1e-3) -> dict[str, Any]:
    """Peak memory of a fresh process [MB] that sweeps side x side short runs into a store."""
    code = MILLION.format(side=side, scheduler=scheduler, t_end=t_end)
    found = json.loads(fresh(code)[1].splitlines()[-1])
    return found | {"scheduler": scheduler, "target": TARGET_MEMORY, "met": found["peak"] < TARGET_MEMORY}
