"""Tables of a benchmark's result, as Markdown: printed by the benchmark, included by the page."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from typing import Any

Results = dict[str, Any]


def markdown(header: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table whose columns line up."""
    lines = [list(header), *(list(r) for r in rows)]
    widths = [max(len(line[k]) for line in lines) for k in range(len(header))]
    lines.insert(1, ["-" * w for w in widths])
    padded = (" | ".join(cell.ljust(w) for cell, w in zip(line, widths, strict=True)) for line in lines)
    return "\n".join(f"| {line} |" for line in padded) + "\n"


def duration(seconds: float | None) -> str:
    """With a unit that suits."""
    if seconds is None or not math.isfinite(seconds):
        return "–"
    for unit, size in (("s", 1.0), ("ms", 1e-3), ("µs", 1e-6)):
        if seconds >= size:
            return f"{seconds / size:.3g} {unit}"
    return f"{seconds / 1e-9:.3g} ns"


def ratio(value: float | None) -> str:
    """Three digits."""
    return "–" if value is None or not math.isfinite(value) else f"{float(f'{value:.3g}'):.10g}"


def small(value: float | None) -> str:
    """An error."""
    return "–" if value is None or not math.isfinite(value) else f"{abs(value):.0e}" if value else "0"


def verdict(row: dict[str, Any]) -> tuple[str, str]:
    """Target and whether it is met."""
    if row.get("target") is None:
        return "", ""
    return f"{row['target']:g}", "met" if row["met"] else "MISSED"


def job_a(found: Results) -> str:
    """Step response."""
    rows = []
    for r in found["rows"]:
        cells = [duration(r["seconds"]), ratio(r["ratio"]), ratio(r["ratio_simulate"])]
        goal = [r["goal"], verdict(r)[1]]
        rows.append([r["name"], *cells, small(r["error"]), small(r["amplitude_error"]), *goal, r["note"]])
    header = ["who", "time", "engine is faster by", "simulate() is faster by", "error of theta [rad]"]
    return markdown([*header, "error of amplitude", "target", "", "note"], rows)


def job_b(found: Results) -> str:
    """Map."""
    rows = []
    for r in found["rows"]:
        errors = [f"{r['other_outcomes']} of {r['cells_checked']}", small(r["amplitude_error"])]
        rows.append([r["name"], duration(r["seconds"]), ratio(r["ratio"]), *errors, *verdict(r)])
    t = found["threads"]
    same = "no bit differs" if t["same"] else "RESULTS DIFFER"
    who = f"two threads against one (load {t['load']:.1f}; by processor time {t['possible']:.2f})"
    rows.append([who, "", ratio(t["speedup"]), same, "", *verdict(t)])
    header = ["who", "time for the map", "ours is faster by", "other outcomes", "error of amplitude", "target", ""]
    return markdown(header, rows)


def job_c(found: Results) -> str:
    """Describing functions."""
    rows = [
        [r["name"], duration(r["seconds_per_evaluation"]), ratio(r["ratio"]), small(r["error"]), *verdict(r)]
        for r in found["rows"]
    ]
    return markdown(["who", "time of an evaluation", "ours is faster by", "error", "target", ""], rows)


def job_sweep(found: Results) -> str:
    """Sweeps: overhead, threads, chunks, memory."""
    rows = []
    for r in found["rows"]:
        rate, over = f"{r['cells_per_second']:.0f}", f"{100 * r['overhead']:+.1f} %"
        bound = "" if r["target"] is None else f"under {100 * r['target']:g} %"
        rows.append([r["name"], rate, "" if r["target"] is None else over, bound, verdict(r)[1]])
    cell = found["cell"]
    bound = f"under {duration(cell['target'])}"
    rate = f"{1.0 / cell['seconds']:.0f}"
    rows.append(["a cell of the sweep in memory", rate, duration(cell["seconds"]), bound, verdict(cell)[1]])
    t = found["threads"]
    same = "no bit differs" if t["same"] else "RESULTS DIFFER"
    who = f"sweep into a store, two threads ({same}; load {t['load']:.1f})"
    goal = f"{t['target']:g} of the factor {t['possible']:.2f} that their processor time allows"
    rows.append([who, f"{t['cells_per_second'][1]:.0f}", f"{t['speedup']:.2f} times one", goal, verdict(t)[1]])
    for r in found["chunks"]:
        rows.append([f"into a store in blocks of {r['chunk']} cells", f"{r['cells_per_second']:.0f}", "", "", ""])
    for m in found["memory"]:
        who = f"{m['cells']:,} runs of 1 ms, {m['scheduler']}: peak memory of the parent ({m['before']:.0f} MB before)"
        rate = f"{m['cells'] / m['seconds']:.0f}"
        rows.append([who, rate, f"{m['peak']:.0f} MB", f"under {m['target']:g} MB", verdict(m)[1]])
    return markdown(["who", "cells/s", "against the bare kernel", "target", ""], rows)


def job_orbit(found: Results) -> str:
    """Exact orbits."""
    rows = []
    for r in found["rows"]:
        target = (
            ["", ""] if r["target"] is None else [f"under {duration(r['target'])}", "met" if r["met"] else "MISSED"]
        )
        rows.append([r["name"], duration(r["seconds"]), ratio(r["ratio"]), small(r["error"]), *target])
    return markdown(["who", "time of one orbit", "ours is faster by", "error of the period", "target", ""], rows)


def job_calls(found: Results) -> str:
    """What users call."""
    rows = []
    for r in found["rows"]:
        target = "" if r["target"] is None else f"under {duration(r['target'])}"
        rows.append([r["name"], duration(r["seconds"]), duration(r["before"]), target, verdict(r)[1]])
    return markdown(["call", "time", "before", "target", ""], rows)


def start(found: Results) -> str:
    """Fresh processes and memory."""

    def limit(row: dict[str, Any], unit: str) -> list[str]:
        return [f"under {row['target']:g} {unit}", "met" if row["met"] else "MISSED"]

    rows = [
        ["import and first simulation, cached", duration(found["warm"]["seconds"]), *limit(found["warm"], "s")],
        ["import alone", duration(found["import"]["seconds"]), "", ""],
        *([f"`eppanalysis {r['words']}`", duration(r["seconds"]), *limit(r, "s")] for r in found["commands"]),
    ]
    for m in found["memory"]["cells"]:
        what = f"peak memory of a map of {m['cells']} cells ({m['before']:.0f} MB before it)"
        rows.append([what, f"{m['peak']:.0f} MB", *limit(found["memory"], "MB")])
    return markdown(["a fresh process", "", "target", ""], rows)


def states(found: Results) -> str:
    """Growth with the number of states."""
    rows = [
        [
            str(r["states"]),
            str(r["events"]),
            duration(r["seconds"]),
            ratio(r["ratio"]),
            small(r["scipy_error"]),
            *verdict(r),
        ]
        for r in found["states"]
    ]
    header = ["states", "events", "engine", "faster than scipy DOP853, rtol 1e-06, by", "its error", "target", ""]
    return markdown(header, rows)


def events(found: Results) -> str:
    """Growth with the rate of events."""
    rows = [[f"{r['events_per_second']:.0f}", duration(r["seconds"])] for r in found["events"]]
    return markdown(["events per second", "engine"], rows)


def cells(found: Results) -> str:
    """Growth with the number of cells and threads."""
    rows = [
        [str(r["cells"]), duration(r["seconds"]), duration(r["seconds_per_cell"]), ratio(r["speedup_two_threads"])]
        for r in found["cells"]
    ]
    return markdown(["cells", "one thread", "per cell", "two threads are faster by"], rows)


def levels(found: Results) -> str:
    """Growth with the levels of a quantiser."""
    rows = [[str(r["levels"]), str(r["events"]), duration(r["seconds"])] for r in found["rows"]]
    return markdown(["levels on each side", "events", "loop built and run"], rows)


#: Tables by name: title, part of the results, maker.
TABLES: dict[str, tuple[str, str, Callable[[Results], str]]] = {
    "job_a": ("Job A: 6 s step response of the original elbow, sampled every millisecond", "job_a", job_a),
    "job_b": ("Job B: 10 x 10 map of profile range and backlash, 6 s each", "job_b", job_b),
    "job_c": ("Job C: describing function of the five-band law", "job_c", job_c),
    "job_orbit": ("Exact limit cycle of a saturating loop from its first-order prediction", "job_orbit", job_orbit),
    "job_calls": ("What users call, beside what it took before", "job_calls", job_calls),
    "job_sweep": ("Sweeps: 100 x 100 map of profile range and backlash, 6 s each", "job_sweep", job_sweep),
    "start": ("Fresh processes", "start", start),
    "states": ("Growth with states: 6 s of a chain of masses, sampled every millisecond", "growth", states),
    "events": ("Growth with events: 6 s of a relay loop, sampled every millisecond", "growth", events),
    "cells": ("Growth with cells and threads", "growth", cells),
    "levels": ("Growth with levels: 30 s of a loop that hunts over a few levels of its sensor", "levels", levels),
}


def tables(results: Results) -> dict[str, str]:
    """Markdown of every table whose part of the results is there."""
    return {name: make(results[part]) for name, (_, part, make) in TABLES.items() if part in results}


def setting(results: Results) -> str:
    """Where and with what the numbers were measured; parts may come from different runs."""
    parts: dict[str, list[str]] = {}
    for part, found in results.items():
        parts.setdefault(_measured(found["setting"]), []).append(part.replace("_", " "))
    if len(parts) == 1:
        return f"Measured {next(iter(parts))}.\n"
    return "".join(f"* {', '.join(names)}: measured {how}.\n" for how, names in parts.items())


def _measured(how: dict[str, Any]) -> str:
    m, versions = how["machine"], ", ".join(f"{k} {v}" for k, v in how["versions"].items())
    clock = {"wall": "the wall clock", "cpu": "processor time, because the machine was shared"}[how["clock"]]
    return f"on {m['cores']} cores ({m['processor']}, load {m['load']:.1f} at the start) by {clock}, with {versions}"


def text(results: Results) -> str:
    """Everything, to be printed."""
    return setting(results) + "".join(f"\n{TABLES[name][0]}\n\n{table}" for name, table in tables(results).items())
