"""Job B: a 10 x 10 map of profile range and backlash of the elbow, six seconds each: outcome and amplitude."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from benchmarks import fixed_step
from benchmarks.elbow_plain import FLOATS, Operations, for_scipy, start
from benchmarks.libraries import SMOOTH, Job
from benchmarks.maps import T_END, axes, make_stack, solve_map
from benchmarks.timing import CLOCKS, Contender, alternate
from eppanalysis.methods.simulation.batch import BatchResult, HybridStack, simulate_batch
from eppanalysis.results import Status
from tests.reference.elbow_reference import DEG, LBF, nominal, simulate_reference
from tests.reference.verdict import judge

Array = NDArray[np.float64]

TARGET, TARGET_THREADS = 500.0, 1.85
#: Cells that the rivals get, chosen once; their time is extrapolated to the map.
SAMPLE, SEED = 6, 20050
#: Evaluations of the right-hand side after which a run is given up: at rest the hard sgn makes an integrator chatter.
MOST_EVALUATIONS = 300_000
OUTCOMES = {Status.LIMIT_CYCLE: "oscillate", Status.SETTLED: "settle"}


def parameters(cell: int, side: int) -> dict[str, float]:
    """Of one cell, for the rivals."""
    ranges, backlashes = axes(side)
    i, j = divmod(cell, side)
    return nominal(band_range=ranges[i] * LBF, backlash=backlashes[j] * DEG)


def _verdict(theta: Array, t: Array) -> tuple[str, float]:
    outcome, peak_to_peak, _ = judge(t, theta, np.gradient(theta, t))
    return outcome, peak_to_peak


def machine(p: dict[str, float], rtol: float = 1e-6) -> tuple[str, float]:
    """Outcome and amplitude by the event machine."""
    run = simulate_reference(p, T_END, rtol=rtol, atol=rtol * 1e-2)
    return run.verdict, run.peak_to_peak


def plain(p: dict[str, float], solver: str, operations: Operations, rtol: float) -> tuple[str, float]:
    """Outcome and amplitude by scipy without events."""
    times, rates, evaluations = Job(p, T_END).times, for_scipy(p, operations), 0

    def rate(t: float, y: Array) -> Any:
        nonlocal evaluations
        evaluations += 1
        if evaluations > MOST_EVALUATIONS:
            raise TimeoutError
        return rates(t, y)

    try:
        found = solve_ivp(rate, (0.0, T_END), start(p), solver, times, rtol=rtol, atol=1e-3 * rtol)
    except TimeoutError:
        return "gave up", float("nan")
    return _verdict(found.y[0], times)


def runge_kutta(p: dict[str, float]) -> tuple[str, float]:
    """Outcome and amplitude by the hand-written fixed step."""
    return _verdict(fixed_step.runge_kutta_theta(p, 1e-4, T_END), Job(p, T_END).times)


RIVALS: dict[str, tuple[Callable[[dict[str, float]], tuple[str, float]], bool]] = {
    "scipy event machine, DOP853, rtol 1e-06": (machine, True),
    "scipy solve_ivp, RK45, rtol 1e-03, hard sgn (default)": (lambda p: plain(p, "RK45", FLOATS, 1e-3), True),
    "scipy solve_ivp, RK45, rtol 1e-03, smooth sgn": (lambda p: plain(p, "RK45", SMOOTH, 1e-3), True),
    "scipy solve_ivp, LSODA, rtol 1e-02, smooth sgn": (lambda p: plain(p, "LSODA", SMOOTH, 1e-2), True),
    "scipy solve_ivp, LSODA, rtol 1e-06, smooth sgn": (lambda p: plain(p, "LSODA", SMOOTH, 1e-6), True),
    "numba Runge-Kutta by hand, 0.1 ms": (runge_kutta, False),
}


def errors(found: Sequence[tuple[str, float]], exact: Sequence[tuple[str, float]]) -> dict[str, Any]:
    """Cells with another outcome, and the largest relative error of the amplitude where both oscillate."""
    pairs = list(zip(found, exact, strict=True))
    cycles = [f[1] / e[1] - 1.0 for f, e in pairs if f[0] == e[0] == "oscillate"]
    return {
        "other_outcomes": sum(f[0] != e[0] for f, e in pairs),
        "cells_checked": len(pairs),
        "amplitude_error": float(np.abs(cycles).max()) if cycles else float("nan"),
    }


def _ours(result: BatchResult, cells: Sequence[int]) -> list[tuple[str, float]]:
    return [(OUTCOMES.get(result.status[c], "undecided"), float(result.peak_to_peak["theta"][c])) for c in cells]


def run(side: int = 10, sample: int = SAMPLE, turns: int = 5, clock: str = "wall") -> dict[str, Any]:
    """The map against the rivals on a sample of its cells."""
    n = side * side
    cells = sorted(int(c) for c in np.random.default_rng(SEED).choice(n, sample, replace=False))
    exact = [machine(parameters(c, side), 1e-10) for c in cells]
    stack = make_stack(side)
    ours = Contender("eppanalysis, one thread", lambda: simulate_batch(stack, T_END))
    others = [Contender("eppanalysis with making the cells", lambda: solve_map(side, 1))]
    others += [Contender(name, lambda f=f: [f(parameters(c, side)) for c in cells]) for name, (f, _) in RIVALS.items()]
    timings = alternate(ours, others, turns, clock)
    rows = []
    for c in (ours, *others):
        t, rival = timings[c.name], c.name in RIVALS
        scale = n / sample if rival else 1.0
        ratio, target = t.ratio * scale, TARGET if rival and RIVALS[c.name][1] else None
        found = t.result if rival else _ours(t.result, cells)
        rows.append(
            {
                "name": c.name,
                "cells_timed": sample if rival else n,
                "seconds": t.seconds * scale,
                "turns": t.turns,
                "ratio": ratio,
                **errors(found, exact),
                "target": target,
                "met": None if target is None else bool(ratio >= target),
            }
        )
    status = timings[ours.name].result.status
    counts = {s.name: status.count(s) for s in set(status)}
    return {"cells": n, "sample": cells, "outcomes": counts, "rows": rows, "threads": threads(stack, turns)}


def threads(stack: HybridStack, turns: int) -> dict[str, Any]:
    """Two threads against one, in turns of at least half a second, by the wall clock; results must not differ.

    On a busy machine the wall clock says little; `possible` is what the processor time of both
    would give on two idle cores.
    """
    one, two = simulate_batch(stack, T_END, threads=1), simulate_batch(stack, T_END, threads=2)
    same = np.array_equal(one.period, two.period, equal_nan=True) and all(
        np.array_equal(one.peak_to_peak[k], two.peak_to_peak[k], equal_nan=True) for k in one.peak_to_peak
    )
    begin = CLOCKS["wall"]()
    simulate_batch(stack, T_END)
    calls = max(1, int(0.5 / (CLOCKS["wall"]() - begin)))
    spent = np.empty((turns, 2, 2))
    for turn, count in product(range(turns), (1, 2)):
        begin = [now() for now in CLOCKS.values()]
        for _ in range(calls):
            simulate_batch(stack, T_END, threads=count)
        spent[turn, count - 1] = [now() - b for now, b in zip(CLOCKS.values(), begin, strict=True)]
    speedup, cpu = (float(np.median(spent[:, 0, k] / spent[:, 1, k])) for k in range(2))
    return {
        "speedup": speedup,
        "possible": 2.0 * cpu,
        "target": TARGET_THREADS,
        "met": speedup >= TARGET_THREADS,
        "same": same,
        "load": os.getloadavg()[0],
    }
