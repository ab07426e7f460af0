"""Job A: step response of the original elbow, sampled every millisecond."""

from __future__ import annotations

import hashlib
import inspect
import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import eppanalysis as epp
from benchmarks import fixed_step, mode_steps
from benchmarks.libraries import TIGHT, Job, Way, installed
from benchmarks.timing import Contender, Timing, alternate, once
from eppanalysis.methods.simulation.runs import run_hybrid
from eppanalysis.models.systems.hybrid import HybridSystem
from tests.reference import elbow_reference, events
from tests.reference.elbow_reference import Elbow, row, simulate_reference

Array = NDArray[np.float64]

#: Times as fast as a rival that the engine is to be, by group; against the event machine all of simulate() is.
TARGETS = {"event machine": 800.0, "python-control": 800.0, "library": 30.0, "fixed step": 1.0}
#: Runs of the bare engine that simulate() may take.
MOST_ENGINES = 2.0
ENGINE, SIMULATE = "eppanalysis, engine", "eppanalysis, simulate()"
#: A cycle is right when its amplitude is within this of the exact one.
AMPLITUDE = 0.01


def exact_theta(job: Job, cache: Path) -> Array:
    """Angle from the reference integrator at rtol 1e-12, kept in a file of `cache` that its source code names."""
    source = inspect.getsource(elbow_reference) + inspect.getsource(events) + json.dumps([job.p, job.t_end])
    file = cache / f"step_response_{hashlib.sha256(source.encode()).hexdigest()[:16]}.npy"
    if not file.exists():
        cache.mkdir(parents=True, exist_ok=True)
        np.save(file, simulate_reference(job.p, job.t_end, job.times, 1e-12, 1e-14, land=True).signals["theta"])
    return np.load(file)


def amplitude_error(theta: Array, exact: Array) -> float:
    """Relative error of the peak-to-peak over the last sixth (one of six seconds)."""
    last = exact.size // 6
    return float(np.ptp(theta[-last:]) / np.ptp(exact[-last:]) - 1.0)


def ours(job: Job) -> tuple[Contender, Contender]:
    """The compiled engine on a system that is packed already, and the whole analysis with verdict, cycle and event
    list.
    """
    case = epp.case("fig8a_original")
    system, times = case.to_system(), job.times
    first = epp.simulate(system, case.input, job.t_end, times)
    hybrid = HybridSystem.from_lure(system, {system.input_names[0]: case.input})
    step, place = first.provenance.settings["step"], system.signals.names.index("theta")

    def engine() -> Array:
        return run_hybrid(hybrid, job.t_end, times, step, 200_000, 20_000).samples[:, place]

    def analysis() -> Array:
        return epp.simulate(system, case.input, job.t_end, times).signals["theta"]

    return Contender(ENGINE, engine), Contender(SIMULATE, analysis)


def by_hand(job: Job) -> list[Contender]:
    """What a user could write for this one loop."""
    every, h = 4, 2.5e-4
    made = mode_steps.tables(Elbow(job.p), h)
    states = np.empty((job.times.size, mode_steps.N))

    def modes() -> Array:
        mode_steps.bisect_modes(made, states.shape[0], every, states)
        return states[:, 0].copy()

    def steps(h: float) -> Contender:
        name = f"numba Runge-Kutta by hand, {h * 1e3:g} ms"
        return Contender(name, lambda: fixed_step.runge_kutta_theta(job.p, h, job.t_end), "fixed step" * (h == 1e-4))

    return [
        steps(1e-4),
        steps(1e-5),
        Contender("numba matrix exponential by hand, 0.25 ms, bisection", modes, note="tables made beforehand"),
    ]


def event_machines(job: Job, full: bool) -> list[Contender]:
    """The reference integrator on scipy's solvers."""

    def machine(solver: str, rtol: float) -> Contender:
        def run() -> Array:
            return simulate_reference(job.p, job.t_end, job.times, rtol, rtol * 1e-2, solver).signals["theta"]

        target = "event machine" if (solver, rtol) == ("DOP853", 1e-6) else ""
        return Contender(f"scipy event machine, {solver}, rtol {rtol:.0e}", run, target)

    wanted = [("DOP853", 1e-6), ("RK45", 1e-6)]
    if full:
        wanted += [("DOP853", 1e-3), ("DOP853", 1e-12), ("LSODA", 1e-6), ("Radau", 1e-6)]
    return [machine(*w) for w in wanted]


def search(ways: Iterable[Way], exact: Array) -> tuple[list[Way], list[dict[str, Any]]]:
    """For each library: its fastest way at the loosest tolerance that gets the amplitude, and its fastest tight one.

    Every solver (and sgn) is tried from its loosest tolerance on up to the first that gets the amplitude to a per cent.
    Everything that was tried comes back too, with time and errors.
    """
    tried: list[dict[str, Any]] = []
    right: dict[str, list[tuple[float, Way]]] = {}
    done = set()
    for way in ways:
        tight = way.rtol <= TIGHT
        if not tight and (way.library, way.solver, way.sign) in done:
            continue
        try:
            way.run()
            seconds, theta = once(way.run)
        except Exception as error:  # a solver that gives up is out of the race
            tried.append({"library": way.library, "way": way.label, "failure": str(error).splitlines()[0][:120]})
            continue
        error = amplitude_error(theta, exact)
        entry = {"library": way.library, "way": way.label, "seconds": seconds, "amplitude_error": error}
        tried.append(entry | {"error": float(np.abs(theta - exact).max())})
        if abs(error) <= AMPLITUDE:
            if not tight:
                done.add((way.library, way.solver, way.sign))
            if way.rtol >= TIGHT:
                right.setdefault(f"{way.library}{' tight' * tight}", []).append((seconds, way))
    return [min(found, key=lambda pair: pair[0])[1] for found in right.values()], tried


def as_contender(way: Way) -> Contender:
    """A way to run a library, with the target that holds for it."""
    if way.library == "python-control":
        group = "python-control" if way.rtol > TIGHT else ""
    else:
        group = "" if way.library.startswith("scipy") else "library"
    return Contender(f"{way.library}, {way.label}", way.run, group)


def table(timings: dict[str, Timing], contenders: Iterable[Contender], exact: Array) -> list[dict[str, Any]]:
    """A row for each contender: times, ratios to the engine and to simulate(), errors, target and whether it is met."""
    analysis = timings[SIMULATE].ratio
    rows = []
    for c in contenders:
        t = timings[c.name]
        target, goal, met = _goal(c, t.ratio, analysis)
        rows.append(
            {
                "name": c.name,
                "seconds": t.seconds,
                "turns": t.turns,
                "ratio": t.ratio,
                "ratio_simulate": t.ratio / analysis,
                "error": float(np.abs(t.result - exact).max()) if t.result is not None else float("nan"),
                "amplitude_error": amplitude_error(t.result, exact) if t.result is not None else float("nan"),
                "target": target,
                "goal": goal,
                "met": met,
                "note": t.failure or c.note,
            }
        )
    return rows


def _goal(contender: Contender, ratio: float, analysis: float) -> tuple[float | None, str, bool | None]:
    """Target of a row, in words, and whether it is met."""
    if contender.name == SIMULATE:
        return MOST_ENGINES, f"at most {MOST_ENGINES:g} times the engine", bool(ratio <= MOST_ENGINES)
    target = TARGETS.get(contender.group)
    if target is None:
        return None, "", None
    if contender.group == "event machine":
        return target, f"simulate() {_faster(target)}", bool(ratio / analysis >= target)
    return target, f"engine {_faster(target)}", bool(ratio >= target)


def _faster(times: float) -> str:
    """How fast in words, beside a rival."""
    return f"{times:g} times as fast" if times > 1.0 else "as fast"


def run(cache: Path, t_end: float = 6.0, turns: int = 7, libraries: bool = True, clock: str = "wall") -> dict[str, Any]:
    """The job; without `libraries` only the engine, the event machines and what is written by hand."""
    job = Job(row(1), t_end)
    exact = exact_theta(job, cache)
    engine, analysis = ours(job)
    ways, tried = search((w for ways in installed().values() for w in ways(job)) if libraries else (), exact)
    others = [analysis, *by_hand(job), *event_machines(job, libraries), *map(as_contender, ways)]
    timings = alternate(engine, others, turns, clock)
    rows = table(timings, (engine, *others), exact)
    return {"t_end": t_end, "rows": rows, "tried": tried}
