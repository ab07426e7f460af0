"""Searches against runs from spread starts: nothing that a run ends on is missing, nothing listed is no cycle.

Each search is set against runs from 200 starts spread over a box larger than all its cycles, and each cycle it lists is
closed by the slow integrator from its own state and memory.
"""

from __future__ import annotations

import time
from dataclasses import replace
from typing import Any

import numpy as np
from scipy.stats import qmc

import eppanalysis as epp
from eppanalysis.errors import EppError
from eppanalysis.results import LimitCycle, Status, Trajectory
from tests.stress.families import Problem, problem
from tests.stress.machine import Machine, iterate

STARTS = 200
#: Periods of the slowest cycle (or time constants) that a run is given, and how much longer one without a verdict is.
_PERIODS, _LONGER = 60.0, 8.0
#: Runs that are made longer in vain, after which the others of that loop are not: most motions that fill a curve never
#: get a verdict.
_MOST_IN_VAIN = 10
#: Switches after which a run ends: where they pile up it would make 200,000, and so would each of the other starts.
_MOST_EVENTS = 60_000
#: Seconds of the processor after which the starts that are left are not run, and the row says how many.
_MOST_SECONDS = 60.0
#: Differences of period and sizes within which a run is on a listed cycle.
_SAME_PERIOD, _SAME_SIZE = 1e-5, 1e-3
#: The same of a cycle that is not locked to the samples, of whose turns no two are alike, relative to its size.
_LIKE = 1e-2
#: How near the slow integrator comes back, relative to the cycle and to the largest multiplier.
CLOSES = 1e-6
#: Periods that the slow integrator runs on at most.
_MOST_TURNS = 60


def spread(system: epp.LureSystem, cycles: epp.CycleSearch, count: int) -> np.ndarray:
    """Sobol points of a box twice as large as all cycles and the start, half of them in one a tenth as large."""
    n = system.A.shape[0]
    half = np.abs(system.x0) + 1e-3
    for cycle in cycles:
        half = np.maximum(half, [abs(cycle.mean[f"x{i}"]) + cycle.peak_to_peak[f"x{i}"] for i in range(n)])
    points = 4.0 * qmc.Sobol(n, seed=3).random(2 ** int(np.ceil(np.log2(count))))[:count] - 2.0
    points[::2] *= 0.1
    return points * half


def _known(cycle: LimitCycle, listed: epp.CycleSearch) -> bool:
    """Whether a run's cycle is among the stable ones listed (a run may take some periods for one)."""
    for c in listed:
        turns = max(1, round(cycle.period / c.period))
        size = max(c.peak_to_peak.values())
        apart = [abs(cycle.peak_to_peak[k] - c.peak_to_peak[k]) + abs(cycle.mean[k] - c.mean[k]) for k in c.mean]
        # Two cycles of one number of samples may be closer than that: then the stable one counts.
        same = abs(cycle.period / (turns * c.period) - 1.0) < _SAME_PERIOD and max(apart) < _SAME_SIZE * size
        if same and (c.stable or "continuum" in listed.search):
            return True
    return "continuum" in listed.search and any(_same_switches(cycle, c) for c in listed if c.stable)


def _same_switches(cycle: LimitCycle, other: LimitCycle) -> bool:
    """Whether two cycles have the same events in turn: the one listed stands for all of its continuum."""
    one, two = ([(e.element, e.name) for e in c.events] for c in (cycle, other))
    return bool(one) and any(one == two[k:] + two[:k] for k in range(len(two)))


def _like_unlocked(run: Trajectory, listed: epp.CycleSearch) -> bool:
    """Whether the last half of a run without a period is as large, about the same middle, as a listed one without."""
    tails = {name: y[len(y) // 2 :] for name, y in run.signals.items()}
    for c in (c for c in listed if "not locked" in c.note):
        near = _LIKE * max(c.peak_to_peak.values())
        if all(
            abs(np.ptp(y) - c.peak_to_peak[k]) < near and abs(0.5 * (y.min() + y.max()) - _middle(c, k)) < near
            for k, y in tails.items()
        ):
            return True
    return False


def _middle(cycle: LimitCycle, name: str) -> float:
    y = cycle.waveform[name]
    return float(0.5 * (y.min() + y.max()))


def _slowest(system: epp.LureSystem) -> float:
    poles = np.linalg.eigvals(system.A).astype(complex)
    if system.time_step:
        poles = np.log(np.where(np.abs(poles) > 1e-9, poles, 1e-9)) / system.time_step
    rates = np.abs(poles)
    slow = rates[rates > 1e-6 * max(float(rates.max()), 1e-300)]
    return 1.0 / float(slow.min()) if slow.size else 1.0


def _run(system: epp.LureSystem, start: np.ndarray, t_end: float, patient: bool = True) -> Trajectory:
    """A run, made longer where it has no verdict or has not yet come as near its cycle as cycles are told apart.

    A cycle with a multiplier of 0.998 is come nearer by a factor of a thousand in 3,500 periods.
    """
    begun = replace(system, x0=start)

    def made(longer: float, *ends: float) -> Trajectory:
        shown = None if system.time_step else [0.0, *ends]
        return epp.simulate(begun, t_end=longer * t_end, t_eval=shown, max_events=_MOST_EVENTS)

    run = made(1.0, t_end)
    if (patient and run.status is Status.UNDECIDED) or _is_coarse(run):
        run = made(_LONGER)
    return made(_LONGER**2) if _is_coarse(run) else run


def _is_coarse(run: Trajectory) -> bool:
    return run.limit_cycle is not None and run.limit_cycle.error_estimate > _SAME_PERIOD


def _ends(system: epp.LureSystem, found: epp.CycleSearch) -> dict[str, int]:
    """How runs from spread starts end, and how many so."""
    t_end = _PERIODS * max([c.period for c in found] or [_slowest(system)])
    if system.time_step:
        t_end = system.time_step * np.ceil(t_end / system.time_step)
    ends: dict[str, int] = {}
    begun = time.process_time()
    for number, start in enumerate(spread(system, found, STARTS)):
        if time.process_time() - begun > _MOST_SECONDS:
            return ends | {"NOT RUN": STARTS - number}
        run = _run(system, start, t_end, ends.get("UNDECIDED", 0) < _MOST_IN_VAIN)
        what = run.status.name
        if run.limit_cycle is not None:
            what = "LISTED" if _known(run.limit_cycle, found) else "UNKNOWN"
        elif run.status is Status.UNDECIDED and _like_unlocked(run, found):
            what = "LIKE ONE LISTED"
        ends[what] = ends.get(what, 0) + 1
    return ends


def closes(case: Problem, cycle: LimitCycle) -> float:
    """How far from its begin the slow integrator ends after one period, relative to the cycle's size.

    State and memory do not hold what is on its way through a dead time. There a stable cycle is given the time to come
    back to itself; of an unstable one nothing can be said.
    """
    if not cycle.state.size:
        return float("nan")
    system = replace(case.system, x0=cycle.state, memory=cycle.memory or case.system.memory)
    turns = _turns(system, cycle)
    if turns > _MOST_TURNS:
        return float("nan")
    if system.time_step:
        samples = cycle.period / system.time_step
        x = iterate(system, {}, int(np.ceil(samples - 1e-9)) + 1)
        share = samples - (len(x) - 2)  # of the last sample: none is a whole period behind one that is not locked
        x = [x[0], (1.0 - share) * x[-2] + share * x[-1]]
    else:
        x = Machine(system, {}).run(cycle.period * np.unique([0.0, turns - 1.0, turns]))[-2:]
    size = max(cycle.peak_to_peak[f"x{i}"] for i in range(system.A.shape[0]))
    return float(np.max(np.abs(x[1] - x[0]))) / (size * max(1.0, _largest(cycle)))


def _allowed(cycle: LimitCycle, time_step: float | None) -> float:
    """How near a cycle must come back: as near as its turns are, and as a straight line between samples is a curve."""
    if not time_step or "not locked" not in cycle.note:
        return CLOSES
    return cycle.error_estimate + 0.125 * (2.0 * np.pi * time_step / cycle.period) ** 2


def _largest(cycle: LimitCycle) -> float:
    return 0.0 if cycle.multipliers is None else float(np.max(np.abs(cycle.multipliers), initial=0.0))


def _turns(system: epp.LureSystem, cycle: LimitCycle) -> float:
    """Periods after which a cycle is compared with itself: one, or as many as its past is felt behind a dead time."""
    if system.time_step or not np.any(system.delays):
        return 1.0
    if not cycle.stable or _largest(cycle) >= 1.0:
        return np.inf
    return 2.0 + np.ceil(np.log(0.1 * CLOSES) / np.log(max(_largest(cycle), 1e-3)))


def search(family: str, seed: int) -> dict[str, Any]:
    """One search and what speaks against it."""
    case = problem(family, seed)
    row: dict[str, Any] = {"family": family, "seed": seed}
    try:
        found = epp.find_limit_cycles(case.system)
    except EppError as refused:
        return row | {"outcome": "refused", "why": str(refused)[:160]}
    row |= {"status": found.status.name, "cycles": len(found), "stable": len(found.stable)}
    ends = row["ends"] = _ends(case.system, found)
    row["said"] = {"settles": found.settles, "diverges": found.diverges}
    against = [
        what
        for end, said, what in (
            ("UNKNOWN", False, "a run ends on a cycle that is not listed"),
            ("SETTLED", found.settles, "a run comes to rest, and none was said to"),
            ("DIVERGED", found.diverges, "a run grows without bound, and none was said to"),
        )
        if ends.get(end) and not said
    ]
    row["open"], row["not_closed"] = [], 0
    for i, cycle in enumerate(found):
        try:
            gap = closes(case, cycle)
        except (RuntimeError, ValueError, NotImplementedError):
            gap = float("nan")
        if not gap < _allowed(cycle, case.system.time_step):
            row["not_closed"] += int(np.isnan(gap))
            row["open"] += [] if np.isnan(gap) else [(i, cycle.method, gap)]
    if row["open"]:
        against.append("a cycle that is listed does not close")
    return row | {"against": against, "outcome": "contradicted" if against else "borne out"}
