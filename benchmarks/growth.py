"""How cost grows: with states, with events per second, with cells, with threads, with levels of a quantiser."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

import eppanalysis as epp
from benchmarks.maps import T_END, make_stack
from benchmarks.timing import Contender, alternate
from eppanalysis.methods.simulation.batch import simulate_batch
from eppanalysis.methods.simulation.runs import run_hybrid
from eppanalysis.models.systems.hybrid import HybridSystem

Array = NDArray[np.float64]

STATES = (4, 8, 16, 32, 64)
RATES = (1.0, 10.0, 100.0, 1000.0, 10_000.0)
SIDES = (5, 10, 20, 40)
LEVELS = (40, 2048, 65_536)
#: Times as fast as scipy that a run of so many states is to be.
TARGETS = {64: 200.0}


def chain(n: int) -> epp.LureSystem:
    """Masses in a row between walls, with springs and some damping; a drive pushes the first one the way it goes.

    The push saturates, and a relay with dead zone brakes the last mass where it moves far: it keeps oscillating.
    """
    m = n // 2
    # The whole chain keeps its mass and its lowest frequency, however many masses it is divided into.
    springs = (2.0 * np.eye(m) - np.eye(m, k=1) - np.eye(m, k=-1)) * (m + 1) ** 2
    A = np.block([[np.zeros((m, m)), np.eye(m)], [-50.0 * springs, -0.1 * np.eye(m) - 0.002 * springs]])
    B, C = np.zeros((n, 2)), np.zeros((2, n))
    B[m, 0], C[0, m] = 0.5 * m, 1.0
    B[n - 1, 1], C[1, m - 1] = -0.5 * m, 1.0
    x0 = np.zeros(n)
    x0[0] = 0.1
    return epp.LureSystem.build(A, B, C, [epp.Saturation(slope=5.0), epp.RelayDeadZone(threshold=0.02)], x0=x0)


def chain_plain(n: int, t_end: float, times: Array) -> Array:
    """Speed of the first mass by scipy on the same equations, elements evaluated with numpy, no events."""
    system = chain(n)
    A, B, C = system.A, system.B, system.C

    def rate(t: float, x: Array) -> Array:
        velocity, position = C @ x
        push = min(max(5.0 * velocity, -1.0), 1.0)
        brake = float(position > 0.02) - float(position < -0.02)
        return A @ x + B @ (push, brake)

    return solve_ivp(rate, (0.0, t_end), system.x0, "DOP853", times, rtol=1e-6, atol=1e-9).y[n // 2]


def with_states(sizes: Sequence[int] = STATES, t_end: float = 6.0, turns: int = 3) -> list[dict[str, Any]]:
    """Engine and scipy on chains of growing length, sampled every millisecond."""
    rows = []
    times = np.arange(round(t_end * 1000.0) + 1) / 1000.0
    for n in sizes:
        system = chain(n)
        hybrid = HybridSystem.from_lure(system)
        step = epp.simulate(system, None, t_end, times).provenance.settings["step"]
        ours = Contender("ours", lambda h=hybrid, s=step: run_hybrid(h, t_end, times, s, 200_000, 100))
        theirs = Contender("scipy", lambda n=n: chain_plain(n, t_end, times))
        timings = alternate(ours, [theirs], turns)
        run, ratio, target = timings["ours"].result, timings["scipy"].ratio, TARGETS.get(n)
        rows.append(
            {
                "states": n,
                "events": run.count,
                "seconds": timings["ours"].seconds,
                "ratio": ratio,
                "scipy_error": float(np.abs(timings["scipy"].result - run.samples[:, 0]).max()),
                "target": target,
                "met": None if target is None else bool(ratio >= target),
            }
        )
    return rows


def with_events(rates: Sequence[float] = RATES, t_end: float = 6.0, turns: int = 5) -> list[dict[str, Any]]:
    """A relay loop whose clock runs faster and faster, sampled every millisecond."""
    rows = []
    times = np.arange(round(t_end * 1000.0) + 1) / 1000.0
    for wanted in rates:
        # 1/((s/k + 1)(s/k + 2)(s/k)) switches twice in a period of 4.551/k.
        k = wanted * 4.551 / 2.0
        system = epp.LureSystem.from_tf(([k**3], [1.0, 3.0 * k, 2.0 * k**2, 0.0]), epp.Relay())
        hybrid = HybridSystem.from_lure(system)
        step = epp.simulate(system, None, t_end, times).provenance.settings["step"]
        ours = Contender("ours", lambda h=hybrid, s=step: run_hybrid(h, t_end, times, s, 2_000_000, 100))
        timings = alternate(ours, [Contender("again", ours.run)], turns)
        run = timings["ours"].result
        rows.append({"events_per_second": run.count / t_end, "seconds": timings["ours"].seconds})
    return rows


def with_cells(sides: Sequence[int] = SIDES, turns: int = 3) -> list[dict[str, Any]]:
    """Maps of growing size on one and two threads."""
    rows = []
    for side in sides:
        stack = make_stack(side)
        one = Contender("one", lambda s=stack: simulate_batch(s, T_END))
        two = Contender("two", lambda s=stack: simulate_batch(s, T_END, threads=2))
        timings = alternate(one, [two], turns)
        rows.append(
            {
                "cells": side * side,
                "seconds": timings["one"].seconds,
                "seconds_per_cell": timings["one"].seconds / side**2,
                "speedup_two_threads": 1.0 / timings["two"].ratio,
            }
        )
    return rows


def with_levels(levels: Sequence[int] = LEVELS, turns: int = 9, clock: str = "wall") -> dict[str, Any]:
    """A loop that hunts over a few levels of its quantised sensor, which has more and more of them."""
    rows = []
    for n in levels:

        def build_and_run(n: int = n) -> epp.Trajectory:
            sensor = epp.Quantiser(step=0.05, levels=n)
            return epp.simulate(epp.LureSystem.from_tf(([5.6], [1, 3, 2, 0]), sensor, x0=[0.2, 0.2, 0.2]), t_end=30.0)

        ours = Contender("ours", build_and_run)
        timings = alternate(ours, [Contender("again", build_and_run)], turns, clock)
        rows.append({"levels": n, "events": timings["ours"].result.n_events, "seconds": timings["ours"].seconds})
    return {"rows": rows}


def run(quick: bool = False) -> dict[str, Any]:
    """Everything; `quick` for a look whether it runs."""
    if quick:
        states, events = with_states((4, 8), 0.5, 1), with_events((10.0,), 0.5, 1)
        return {"states": states, "events": events, "cells": with_cells((2,), 1)}
    return {"states": with_states(), "events": with_events(), "cells": with_cells()}
