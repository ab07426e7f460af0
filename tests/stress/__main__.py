"""``python -m tests.stress --runs 2000 --searches 1000 -o FILE``: all figures as JSON, a summary on the console.

The exit code is 1 where something speaks against the package: then the rows say which loop (family and seed) it was.
"""

from __future__ import annotations

import argparse
import collections
import json
import sys
import time
from pathlib import Path
from typing import Any

from tests.stress.families import FAMILIES
from tests.stress.runs import compare
from tests.stress.searches import search
from tests.stress.summary import against, markdown
from tests.stress.workers import Job, answers


def _jobs(count: int, first: int, families: list[str]) -> list[Job]:
    """So many jobs, dealt out to the families in turn."""
    return [(families[i % len(families)], first + i // len(families)) for i in range(count)]


def _do(title: str, work: Any, jobs: list[Job], options: argparse.Namespace) -> list[dict[str, Any]]:
    rows: list[dict[str, Any]] = []
    begun = time.monotonic()
    for row in answers(work, jobs, options.processes, options.limit):
        rows.append(row)
        if against(row):
            print(f"  {row}", flush=True)
        if len(rows) % 100 == 0:
            print(f"{title}: {len(rows)} of {len(jobs)}, {time.monotonic() - begun:.0f} s", flush=True)
    counts = collections.Counter(row["outcome"] for row in rows)
    print(f"{title}: {dict(counts)}, {sum(map(against, rows))} speak against, {time.monotonic() - begun:.0f} s")
    return rows


def main() -> int:
    """Run, print, write."""
    parser = argparse.ArgumentParser(prog="python -m tests.stress", description=__doc__)
    parser.add_argument("--runs", type=int, default=2000)
    parser.add_argument("--searches", type=int, default=1000)
    parser.add_argument("--first", type=int, default=0, help="first seed of each family")
    parser.add_argument("--family", action="append", choices=sorted(FAMILIES), help="only this family (repeatable)")
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--limit", type=float, default=120.0, help="seconds of the processor a job may take")
    parser.add_argument("--table", help="file for the table of the documentation (Markdown)")
    parser.add_argument("-o", "--output", help="file for all rows (JSON)")
    options = parser.parse_args()
    families = options.family or sorted(FAMILIES)
    # A search is of a loop left to itself: steps of an input are for runs.
    still = [name for name in families if "step of the input" not in name]
    rows = {
        "runs": _do("runs", compare, _jobs(options.runs, options.first, families), options),
        "searches": _do("searches", search, _jobs(options.searches, options.first, still), options) if still else [],
    }
    if options.table:
        title = (
            f"{time.strftime('%Y-%m-%d')}, {options.runs} runs and {options.searches} searches, "
            f"seeds of each family from {options.first} on."
        )
        Path(options.table).write_text(markdown(rows["runs"], rows["searches"], title), encoding="utf-8")
    if options.output:
        results = {"date": time.strftime("%Y-%m-%d"), "first_seed": options.first, **rows}
        Path(options.output).write_text(json.dumps(results, indent=0), encoding="utf-8")
    return int(any(against(row) for part in rows.values() for row in part))


if __name__ == "__main__":
    sys.exit(main())
