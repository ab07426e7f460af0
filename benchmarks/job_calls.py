"""What users call, end to end, from predictions to reports, beside what it took before.

The figures before are those by the clock at the beginning of the work on these times, on two quiet cores; targets are
what the project has set itself. By the clock bounds and guidelines ask two worker processes. By processor time, which
counts what all processes of a call compute, there is one, and these take the time that two would share.
"""

from __future__ import annotations

import os
import statistics
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import eppanalysis as epp
from benchmarks.timing import once

ELBOW, LOOP, PLAY = "fig8a_original", "relay_hyst_servo", "backlash_servo"
#: Runs with which each bound is tested.
_STARTS = 1000


@dataclass(frozen=True)
class Call:
    """One call, what it took before [s], and its target [s] where it has one."""

    name: str
    run: Callable[[], Any]
    before: float
    target: float | None
    turns: int = 5


def branch(points: int) -> epp.Branch:
    """Exact orbits of the elbow over its backlash, so many."""
    case = epp.case(ELBOW)
    return epp.continue_branch(
        case, "lock_pin.backlash", "2.5 deg", "0.5 deg", n_points=points, max_step=0.004, n_others=0
    )


def bounds(points: int, workers: int) -> epp.DesignBounds:
    """Corrected and tested bounds on the elbow's backlash over its profile range."""
    return epp.design_bounds(
        epp.case(ELBOW),
        "bands.range",
        "lock_pin.backlash",
        start="1.5 lbf",
        stop="5 lbf",
        points=points,
        starts=_STARTS,
        within=("0.1 deg", "5 deg"),
        workers=workers,
    )


def guide(workers: int) -> epp.Guide:
    """Guidelines of the elbow: two gains for each friction of the pulley."""
    frictions = {"pulley.friction": [0.0, 0.01]}
    return epp.design_guide(epp.case(ELBOW), ["2 lbf", "3 lbf"], variants=frictions, workers=workers)


def report() -> Path:
    """The elbow's report as HTML."""
    with tempfile.TemporaryDirectory() as folder:
        return epp.report(epp.case(ELBOW), Path(folder) / "elbow.html")


def calls(quick: bool, workers: int) -> list[Call]:
    """All calls; the quick ones do less of each."""
    found = [
        Call("predict_limit_cycles, elbow", lambda: epp.predict_limit_cycles(epp.case(ELBOW)), 0.79, 0.06),
        Call("predict_limit_cycles, one-element loop", lambda: epp.predict_limit_cycles(epp.case(LOOP)), 0.1, 0.005),
        Call("find_limit_cycles, elbow", lambda: epp.find_limit_cycles(epp.case(ELBOW)), 1.1, 0.25),
        Call("find_limit_cycles, one-element loop", lambda: epp.find_limit_cycles(epp.case(LOOP)), 0.28, 0.03),
        Call("find_limit_cycles, servo with play", lambda: epp.find_limit_cycles(epp.case(PLAY)), 0.44, None),
        Call("continue_branch, 200 orbits of the elbow", lambda: branch(20 if quick else 200), 1.0, 0.3),
    ]
    if quick:
        return found
    return [
        *found,
        Call("design_bounds, 40 points, each tested with 1000 runs", lambda: bounds(40, workers), 106.0, 30.0, 1),
        Call("design_guide, 4 rows", lambda: guide(workers), 72.0, 20.0, 1),
        Call("report of the elbow", report, 24.0, 10.0, 1),
    ]


def seconds_of(call: Callable[[], Any], clock: str) -> float:
    """What a call takes [s]; by processor time with all processes that it starts and ends."""
    if clock == "wall":
        return once(call)[0]
    begin = sum(os.times()[:4])
    call()
    return sum(os.times()[:4]) - begin


def run(clock: str = "wall", quick: bool = False) -> dict[str, Any]:
    """Median of the turns of each call, behind a first one that may compile."""
    rows = []
    for call in calls(quick, 2 if clock == "wall" else 1):
        if call.turns > 1:
            call.run()
        seconds = statistics.median(seconds_of(call.run, clock) for _ in range(1 if quick else call.turns))
        met = None if call.target is None else bool(seconds <= call.target)
        rows.append({"name": call.name, "seconds": seconds, "before": call.before, "target": call.target, "met": met})
    return {"rows": rows}
