"""Coverage of the intervals on synthetic benches with known truth: ``python -m tests.benches``.

Runs weight-tray tests, backlash cycling, step responses and steps of a servo, 200 of each unless asked otherwise, and
prints for every parameter how often its 95 % interval holds the truth, how often the data identified it, and how wide
the interval was.
With ``--log FILE`` every bench is written down once it is done, and a run that was interrupted goes on from there.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import tempfile
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass, field
from functools import partial
from pathlib import Path
from time import process_time

import numpy as np

import eppanalysis as epp
from tests.reference.benches import Bench, backlash_cycling, step_response, weight_tray
from tests.reference.make_measured import servo_step


def servo(seed: int) -> Bench:
    """A servo behind its sampled encoder, inertia, gap and gain off at random: the package's own run, with noise."""
    off = np.exp(np.random.default_rng(seed).normal(size=3) * (0.2, 0.25, 0.05))
    nominal = {name: epp.case("azimuth_servo").value(name) for name in ("J_load", "gap", "Kp")}
    return servo_step(seed + 10_000, {name: value * r for (name, value), r in zip(nominal.items(), off, strict=True)})


MAKERS: dict[str, Callable[[int], Bench]] = {
    "tray": weight_tray,
    "backlash": backlash_cycling,
    "step": step_response,
    "servo": servo,
}
#: How well the case knows what the step response takes as known.
TOLERANCE = "2 %"


@dataclass(frozen=True)
class Outcome:
    """One parameter of one bench: whether its interval holds the truth, whether the data identified it,
    relative width.
    """

    test: str
    seed: int
    name: str
    held: bool
    identified: bool
    width: float
    text: str = ""


@dataclass(frozen=True)
class BenchRun:
    """What one bench gave: outcomes, or the sentence with which it was refused; which parameter limited it."""

    test: str
    seed: int
    outcomes: tuple[Outcome, ...] = ()
    refusal: str = ""
    limited_by: str = ""
    seconds: float = 0.0
    notes: tuple[str, ...] = field(default=())


def base_case(bench: Bench, test: str) -> epp.Case:
    """What is known before the test."""
    if test == "servo":
        return epp.case("azimuth_servo")
    known: dict[str, object] = {k: v for k, v in bench.setting.items() if "." in k}
    if test == "step":
        known = {k: {"value": v, "tolerance": TOLERANCE, "mark": "measured"} for k, v in known.items()}
    return epp.case("fig8a_original").with_values(known)


def run_bench(test: str, seed: int) -> BenchRun:
    """Make a bench, write it as CSV, identify it, and compare with the truth."""
    bench = MAKERS[test](seed)
    start = process_time()
    with tempfile.TemporaryDirectory() as folder:
        path = bench.write(Path(folder) / f"{test}.csv")
        options = {test: path, "press": bench.setting.get("press", 0.0)}
        if test == "servo":
            options = {"step": path, "fit": ("J_load", "gap")}
        try:
            fit = epp.identify(base_case(bench, test), **options).fits[0]
        except epp.EppError as error:
            return BenchRun(test, seed, refusal=str(error))
    estimates = {e.name: e for e in fit.estimates}
    outcomes = []
    for name, true in bench.truth.items():
        if name in estimates:
            e = estimates[name]
            text = f"true {e.text(true)}, found {e.text(e.value)} in {e.text(e.low)} to {e.text(e.high)}"
            outcomes.append(Outcome(test, seed, name, e.low <= true <= e.high, e.identified, e.relative_width, text))
    return BenchRun(test, seed, tuple(outcomes), "", fit.limited_by, process_time() - start, fit.notes)


def run_all(test: str, seeds: Sequence[int], workers: int) -> Iterator[BenchRun]:
    """Many benches, on several processes."""
    if workers == 1:
        yield from map(partial(run_bench, test), seeds)
        return
    with ProcessPoolExecutor(workers) as pool:
        yield from pool.map(partial(run_bench, test), seeds)


def logged(log: Path, test: str) -> dict[int, BenchRun]:
    """The benches of a test that a log holds, by seed; a last line that was cut off is not one."""
    found: dict[int, BenchRun] = {}
    for line in log.read_text(encoding="utf-8").splitlines() if log.exists() else []:
        try:
            record = json.loads(line)
        except json.JSONDecodeError:
            continue  # an empty line, or the end of a run that was interrupted
        if record["test"] == test:
            outcomes = tuple(Outcome(**o) for o in record.pop("outcomes"))
            notes = tuple(record.pop("notes"))
            found[record["seed"]] = BenchRun(**record, outcomes=outcomes, notes=notes)
    return found


def collect(test: str, seeds: Sequence[int], workers: int, log: Path | None) -> list[BenchRun]:
    """The benches with these seeds, those of the log as they are there, the others run and added to it."""
    if log is None:
        return list(run_all(test, seeds, workers))
    known = logged(log, test)
    missing = [seed for seed in seeds if seed not in known]
    with log.open("a", encoding="utf-8") as file:
        if log.stat().st_size:
            file.write("\n")  # whatever was cut off there ends here
        for run in run_all(test, missing, workers):
            file.write(json.dumps(asdict(run)) + "\n")
            file.flush()
            known[run.seed] = run
    return [known[seed] for seed in seeds]


def report(test: str, runs: list[BenchRun]) -> list[str]:
    """Lines of a table: coverage of what was identified, and of everything."""
    refused = [r for r in runs if r.refusal]
    lines = [f"\n{test}: {len(runs)} benches, {len(refused)} refused, {np.mean([r.seconds for r in runs]):.1f} s each"]
    lines.append(f"  {'parameter':32s} {'identified':>10s} {'covered':>9s} {'of all':>9s} {'half width':>11s}")
    for name in dict.fromkeys(o.name for r in runs for o in r.outcomes):
        found = [o for r in runs for o in r.outcomes if o.name == name]
        identified = [o for o in found if o.identified]
        share = f"{100 * np.mean([o.held for o in identified]):.1f} %" if identified else "-"
        width = f"{100 * np.median([o.width for o in identified]):.2g} %" if identified else "-"
        everything = f"{100 * np.mean([o.held for o in found]):.1f} %"
        lines.append(f"  {name:32s} {len(identified):4d} of {len(found):3d} {share:>9s} {everything:>9s} {width:>11s}")
    limits = Counter(r.limited_by for r in runs if r.limited_by)
    lines.append("  limited by: " + ", ".join(f"{name} {count}" for name, count in limits.most_common()))
    lines += [f"  refused {r.seed}: {r.refusal}" for r in refused[:5]]
    return lines


def main(arguments: list[str] | None = None) -> int:
    """Run the benches; 1 if an interval that was identified covers in fewer than 90 or more than 99 % of many
    benches.
    """
    parser = argparse.ArgumentParser(prog="python -m tests.benches", description=__doc__)
    parser.add_argument("--n", type=int, default=200, help="benches of each test")
    parser.add_argument("--first", type=int, default=0, help="seed of the first")
    parser.add_argument("--only", choices=[*MAKERS], action="append", help="run only this test; repeatable")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--log", type=Path, help="file of JSON lines to go on from")
    parser.add_argument("--misses", action="store_true", help="print every interval that misses")
    chosen = parser.parse_args(arguments)
    bad = 0
    for test in chosen.only or MAKERS:
        runs = collect(test, range(chosen.first, chosen.first + chosen.n), chosen.workers, chosen.log)
        sys.stdout.write("\n".join(report(test, runs)) + "\n")
        misses = [o for r in runs for o in r.outcomes if not o.held]
        if chosen.misses:
            sys.stdout.writelines(f"  missed {o.seed}: {o.name} {o.text}\n" for o in misses)
        bad += sum(outside(runs, name) for name in {o.name for r in runs for o in r.outcomes})
    return int(bad > 0)


def outside(runs: list[BenchRun], name: str) -> bool:
    """Whether coverage of what was identified is outside 90 to 99 %, beyond what so many benches leave to chance."""
    held = [o.held for r in runs for o in r.outcomes if o.name == name and o.identified]
    if not held:
        return False
    share, n = float(np.mean(held)), len(held)
    return share < 0.90 - 2 * math.sqrt(0.09 / n) or share > 0.99 + 2 * math.sqrt(0.0099 / n)


if __name__ == "__main__":
    raise SystemExit(main())
