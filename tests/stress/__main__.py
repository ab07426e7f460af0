"""``python -m tests.stress --runs 2000 --searches 1000 --proofs 400 -o FILE``: a row a loop in a file, a summary.

Rows are appended to the file as they come (JSON, one a line): a second start goes on where the first was stopped. The
exit code is 1 where something speaks against the package: then the rows say which loop (family and seed) it was.
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
from tests.stress.proofs import PROVABLE, proof
from tests.stress.runs import compare
from tests.stress.searches import search
from tests.stress.summary import against, in_words, markdown
from tests.stress.workers import Job, answers


def _jobs(count: int, first: int, families: list[str]) -> list[Job]:
    """So many jobs, dealt out to the families in turn."""
    return [(families[i % len(families)], first + i // len(families)) for i in range(count)]


def _known(file: Path | None) -> list[dict[str, Any]]:
    """The rows of an earlier start."""
    if file is None or not file.exists():
        return []
    return [json.loads(line) for line in file.read_text(encoding="utf-8").splitlines()]


def _do(what: str, work: Any, jobs: list[Job], options: argparse.Namespace) -> list[dict[str, Any]]:
    """The rows of all jobs: those that the file holds, then the rest as they come."""
    file = Path(options.output) if options.output else None
    wanted = set(jobs)
    rows = [r for r in _known(file) if r["what"] == what and (r["family"], r["seed"]) in wanted]
    done = {(r["family"], r["seed"]) for r in rows}
    begun = time.monotonic()
    for answer in answers(work, [j for j in jobs if j not in done], options.processes, options.limit):
        row = {"what": what, "date": time.strftime("%Y-%m-%d"), **answer}
        rows.append(row)
        if file:
            with file.open("a", encoding="utf-8") as lines:
                lines.write(json.dumps(row) + "\n")
        if against(row):
            print(f"  {row}", flush=True)
        if len(rows) % 100 == 0:
            print(f"{what}: {len(rows)} of {len(jobs)}, {time.monotonic() - begun:.0f} s", flush=True)
    counts = collections.Counter(row["outcome"] for row in rows)
    print(f"{what}: {dict(counts)}, {sum(map(against, rows))} speak against, {time.monotonic() - begun:.0f} s")
    return rows


def main() -> int:
    """Run, print, write."""
    parser = argparse.ArgumentParser(prog="python -m tests.stress", description=__doc__)
    parser.add_argument("--runs", type=int, default=2000)
    parser.add_argument("--searches", type=int, default=1000)
    parser.add_argument("--proofs", type=int, default=400)
    parser.add_argument("--first", type=int, default=0, help="first seed of each family")
    parser.add_argument(
        "--family", action="append", choices=sorted({*FAMILIES, *PROVABLE}), help="only this family (repeatable)"
    )
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--limit", type=float, default=120.0, help="seconds of the processor a job may take")
    parser.add_argument("--table", help="file for the table of the documentation (Markdown)")
    parser.add_argument("-o", "--output", help="file that all rows are appended to (JSON, one a line)")
    options = parser.parse_args()
    asked = options.family or sorted({*FAMILIES, *PROVABLE})
    families, provable = ([name for name in asked if name in known] for known in (FAMILIES, PROVABLE))
    # A search is of a loop left to itself: steps of an input are for runs.
    still = [name for name in families if "step of the input" not in name]
    rows = {
        what: _do(what, work, _jobs(count, options.first, names), options) if names else []
        for what, work, count, names in (
            ("runs", compare, options.runs, families),
            ("searches", search, options.searches, still),
            ("proofs", proof, options.proofs, provable),
        )
    }
    proofs = in_words(rows["proofs"])
    print(proofs)
    if options.table:
        title = (
            f"{time.strftime('%Y-%m-%d')}, {options.runs} runs and {options.searches} searches, "
            f"seeds of each family from {options.first} on."
        )
        text = "\n".join([markdown(rows["runs"], rows["searches"], title), *([proofs, ""] if proofs else [])])
        Path(options.table).write_text(text, encoding="utf-8")
    return int(any(against(row) for part in rows.values() for row in part))


if __name__ == "__main__":
    sys.exit(main())
