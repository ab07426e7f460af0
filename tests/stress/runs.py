"""Random runs against the slow integrator: signals to 1e-7 of the size reached, and verdicts that are borne out."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

import eppanalysis as epp
from eppanalysis.results import Status, Trajectory
from tests.reference.events import Options
from tests.stress.families import Problem, problem
from tests.stress.machine import OPTIONS, TIGHTEST, Machine, iterate

Array = NDArray[np.float64]

#: Relative difference that counts as one, and the size beyond which thresholds of order one drown in rounding.
APART, LARGEST = 1e-7, 1e5
#: A loop whose own answer moves by this share of the difference, when its start moves in the last digits, magnifies it.
EXPLAINED = 1e-2
#: Times [s] of the signals compared, and of a run that is long enough for a verdict: whole samples of sampled loops.
TIMES, LONG = np.linspace(0.0, 12.0, 61), np.linspace(0.0, 60.0, 61)


def witness(case: Problem, times: Array, options: Options = OPTIONS) -> Array:
    """States by the independent codes."""
    if case.system.time_step:
        rows = iterate(case.system, case.steps, round(times[-1] / case.system.time_step) + 1)
        return rows[np.round(times / case.system.time_step).astype(int)]
    return Machine(case.system, case.steps, options).run(times)


def simulated(case: Problem, times: Array, shift: float = 0.0) -> Trajectory:
    """The run of the package, from a start moved by a share of itself."""
    system = replace(case.system, x0=case.system.x0 * (1.0 + shift))
    return epp.simulate(system, dict(case.steps), t_end=float(times[-1]), t_eval=times)


def states(run: Trajectory) -> Array:
    """All states of a run, a row a time."""
    return np.column_stack(list(run.signals.values()))


def distance(a: Array, b: Array) -> float:
    """Largest difference relative to the size reached so far, while that stays moderate."""
    n = min(len(a), len(b))
    size = np.maximum.accumulate(np.abs(b[:n]).max(axis=1))
    use = size < LARGEST
    return float(np.max(np.abs(a[:n] - b[:n]).max(axis=1)[use] / np.maximum(size[use], 1e-300), initial=0.0))


def compare(family: str, seed: int) -> dict[str, Any]:
    """One loop: how far the two codes are apart, and whether the verdict is borne out.

    The result's `outcome` is "agrees", "magnified" (the loop itself magnifies rounding that much), "not comparable"
    (the slow integrator knows no motion there: sliding, an accumulation of switches) or "differs".
    """
    case = problem(family, seed)
    row: dict[str, Any] = {"family": family, "seed": seed}
    run = simulated(case, TIMES)
    try:
        b = witness(case, TIMES)
    except (RuntimeError, ValueError, NotImplementedError) as reason:
        return row | {"outcome": "not comparable", "why": str(reason)[:120]}
    a = states(run)
    if run.status is Status.EVENT_LIMIT:
        return row | {"outcome": "not comparable", "why": "accumulation of switches"}
    row["apart"] = distance(a, b)
    if row["apart"] > APART:
        row["apart"] = distance(a, witness(case, TIMES, TIGHTEST))
    row["outcome"] = "agrees"
    if row["apart"] > APART:
        moved = max(distance(states(simulated(case, TIMES, shift)), a) for shift in (1e-11, -1e-11, 3e-11))
        row |= {"moved": moved, "outcome": "magnified" if moved > EXPLAINED * row["apart"] else "differs"}
    return row | verdict(case)


def verdict(case: Problem) -> dict[str, Any]:
    """Whether the slow integrator, run on for a period and a half (or a while), does what a longer run's verdict says.

    The slow integrator looks dead time up piece by piece: there the longer run is twice the short one only.
    """
    long = 2.0 * TIMES if np.any(case.system.delays) else LONG
    run = simulated(case, long)
    row: dict[str, Any] = {"verdict": run.status.name, "verdict_holds": None}
    end = float(long[-1])
    if run.limit_cycle is not None and run.limit_cycle.period < end / 2.0:
        after = run.limit_cycle.period * np.array([0.0, 0.25, 0.5, 1.0, 1.25, 1.5])
        later, size = 3, max(run.limit_cycle.peak_to_peak.values())
    elif run.status is Status.SETTLED:
        after, later, size = 0.05 * end * np.arange(4), 1, float(np.max(np.abs(states(run))))
    else:
        return row
    if case.system.time_step:
        after = np.floor(after / case.system.time_step + 1e-6) * case.system.time_step
    try:
        x = witness(case, np.concatenate([[0.0], end + after]))[1:]
    except (RuntimeError, ValueError, NotImplementedError):
        return row
    change = float(np.max(np.abs(x[later:] - x[: len(x) - later])) / size)
    # A period that is wrong by its estimate moves a sine by up to pi times as much of its peak-to-peak.
    estimate = 0.0 if run.limit_cycle is None else run.limit_cycle.error_estimate
    return row | {"verdict_holds": change < 1e-3 + np.pi * estimate, "change": change}
