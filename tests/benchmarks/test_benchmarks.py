"""The benchmark runs, and what it prints is complete; times are never tested."""

from __future__ import annotations

import json
import math
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

if find_spec("numba") is None:
    pytest.skip(
        "rivals written by hand are compiled by numba, which the development tools bring", allow_module_level=True
    )

from tests.reference.elbow_reference import Elbow, row

pytestmark = pytest.mark.slow


def test_contenders_take_turns_and_failures_are_kept() -> None:
    """Each turn of a contender follows one of the base."""
    from benchmarks.timing import Contender, alternate

    calls: list[str] = []
    base, other = (Contender(n, lambda n=n: calls.append(n)) for n in ("base", "other"))
    broken = Contender("broken", lambda: 1 / 0)
    found = alternate(base, [other, broken], turns=2)
    assert calls.index("other") > calls.index("base")
    assert found["other"].turns == 2
    assert math.isnan(found["broken"].seconds)
    assert found["broken"].failure.startswith("ZeroDivisionError")


def test_hand_written_rivals_do_the_same_work(tmp_path: Path) -> None:
    """A rival that is wrong would be no rival: all of them follow the reference."""
    from benchmarks import fixed_step, job_a, libraries, mode_steps

    job = libraries.Job(row(1), 0.3)
    exact = job_a.exact_theta(job, tmp_path)
    coarse = np.abs(fixed_step.runge_kutta_theta(job.p, 1e-4, 0.3) - exact).max()
    fine = np.abs(fixed_step.runge_kutta_theta(job.p, 1e-5, 0.3) - exact).max()
    # The jumps of the friction make it first order.
    assert fine < 0.3 * coarse < 3e-4
    states = np.empty((exact.size, mode_steps.N))
    mode_steps.bisect_modes(mode_steps.tables(Elbow(job.p), 2.5e-4), exact.size, 4, states)
    np.testing.assert_allclose(states[:, 0], exact, rtol=0.0, atol=1e-10)


@pytest.mark.slow
def test_job_a_and_its_table(tmp_path: Path) -> None:
    """A short step response against two event machines and the hand-written loops."""
    from benchmarks import job_a, report

    found = job_a.run(tmp_path, t_end=0.3, turns=1, libraries=False)
    rows = {r["name"]: r for r in found["rows"]}
    assert rows[job_a.ENGINE]["error"] < 1e-9
    assert rows[job_a.SIMULATE]["error"] < 1e-9
    assert "scipy event machine, DOP853, rtol 1e-06" in report.job_a(json.loads(json.dumps(found)))


@pytest.mark.slow
def test_job_sweep_and_its_table() -> None:
    """A small map: threads and chunks give the same bits, and every cell of the run for memory is there."""
    from benchmarks import job_sweep, report

    found = job_sweep.run(4, 1, chunks=(5, 16), million=6)
    assert found["threads"]["same"]
    assert [m["cells"] for m in found["memory"]] == [36, 36]
    assert all(m["met"] for m in found["memory"])
    assert "36 runs of 1 ms, processes" in report.job_sweep(json.loads(json.dumps(found)))


def test_job_c_and_its_table() -> None:
    """Ours is a closed form, python-control's is sampled."""
    from benchmarks import job_c, report

    found = job_c.run(n=1000, turns=1)
    ours, theirs = found["rows"]
    assert ours["error"] < 1e-12 < theirs["error"] < 1e-3
    assert "python-control" in report.job_c(found)


def test_exact_orbits_and_their_table() -> None:
    """Three ways to one period; ours is the closest."""
    from benchmarks import job_orbit, report

    found = job_orbit.run(turns=1)
    errors = {r["name"]: r["error"] for r in found["rows"]}
    assert errors[job_orbit.OURS] < 1e-12
    assert errors[job_orbit.SHOOTING] < 1e-7 and errors[job_orbit.COLLOCATION] < 1e-6
    assert "under 20 ms" in report.job_orbit(found)


def test_growth_with_levels_and_its_table() -> None:
    """Levels that are not met change no event."""
    from benchmarks import growth, report

    found = growth.with_levels((40, 400), turns=1)
    assert len({r["events"] for r in found["rows"]}) == 1 and found["rows"][0]["events"] > 50
    assert "| 400" in report.levels(json.loads(json.dumps(found)))


def test_calls_stand_beside_what_they_took_before() -> None:
    """Searches and a short branch, each with the figure before and its verdict."""
    from benchmarks import job_calls, report

    found = job_calls.run("cpu", quick=True)
    assert [r["met"] is None for r in found["rows"]] == [False, False, False, False, True, False]
    assert len(job_calls.branch(20).points["value"]) == 20
    assert "| 1.1 s" in report.job_calls(json.loads(json.dumps(found)))
