"""Runs that have closed on a cycle are repeated, runs at rest take long steps; neither may change what is found."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import eppanalysis as epp
from eppanalysis.results import Status


def relay_loop() -> epp.LureSystem:
    """A relay around 1/(s (s + 1) (s + 2)), whose cycle attracts quickly."""
    return epp.LureSystem.from_tf(([1.0], [1.0, 3.0, 2.0, 0.0]), epp.Relay())


def statistics(run: epp.Trajectory) -> dict[str, float]:
    """What the kernel counted."""
    return run.provenance.statistics


def test_repeated_periods_are_those_that_would_have_been_computed() -> None:
    """From a state on the cycle no contraction is seen, so every period is computed: the independent run."""
    loop = relay_loop()
    settled = epp.simulate(loop, t_end=200.0)
    assert statistics(settled)["periods_repeated"] > 20
    through = replace(loop, x0=epp.find_limit_cycles(loop).cycles[0].state)
    late, begun = settled.events[-5], 1e-9  # a start on a switch may fire it by rounding
    events = epp.simulate(through, t_end=20.0).events
    marks = [e.time for e in events if (e.name, e.mode) == (late.name, late.mode) and e.time > begun]
    shift = late.time - marks[0]
    times = np.linspace(marks[0], marks[0] + 15.0, 301)
    computed = epp.simulate(through, t_end=20.0, t_eval=times)
    repeated = epp.simulate(loop, t_end=220.0, t_eval=times + shift)
    assert statistics(computed)["periods_repeated"] == 0
    assert statistics(repeated)["periods_repeated"] > 20
    np.testing.assert_allclose(repeated.signals["x"], computed.signals["x"], rtol=0, atol=2e-13)


def test_events_of_repeated_periods_keep_their_rhythm() -> None:
    """The list of events goes on through the repeated periods, half a period apart, to the end of the run."""
    run = epp.simulate(relay_loop(), t_end=200.0)
    times = np.array([e.time for e in run.events])
    assert 200.0 - times[-1] < run.limit_cycle.period
    np.testing.assert_allclose(np.diff(times[40:]), 0.5 * run.limit_cycle.period, rtol=1e-12)


def test_a_slow_contraction_is_not_cut_short() -> None:
    """Where what is still to come exceeds rounding the run is computed: halving the time changes nothing early."""
    loop = epp.LureSystem.from_tf(([1.0], [1.0, 0.02, 1.0, 0.0]), epp.Saturation())
    run = epp.simulate(loop, t_end=60.0)
    assert statistics(run)["periods_repeated"] == 0


@pytest.mark.parametrize("t_end", [37.3, 61.0, 123.4])
def test_the_end_of_a_repeated_run_is_that_of_one_computed(t_end: float) -> None:
    """The last sample, far inside the repetition, against the run with all its steps three times as short."""
    times = [0.4 * t_end, t_end]
    coarse = epp.simulate(relay_loop(), t_end=t_end, t_eval=times)
    fine = epp.simulate(relay_loop(), t_end=t_end, t_eval=times, step=0.05)
    np.testing.assert_allclose(coarse.signals["x"], fine.signals["x"], rtol=0, atol=1e-12)


def test_long_steps_do_not_pass_a_switch() -> None:
    """A slow ramp reaches the threshold of a relay after a thousand quiet seconds: at 1/rate + 1, to rounding."""
    rate = 1e-3
    loop = epp.LureSystem.build(
        [[-1.0]],
        [[0.0]],
        [[1.0]],
        [epp.RelayDeadZone(threshold=1.0)],
        B_input=[[1.0]],
        input_names=("pull",),
    )
    run = epp.simulate(loop, epp.inputs.Ramp(rate), t_end=1200.0, t_eval=[1200.0])
    assert run.events[0].time == pytest.approx(1.0 / rate + 1.0, rel=1e-13)


def test_rest_is_passed_in_long_steps() -> None:
    """A loop at rest needs few steps, and ends where its linear part says."""
    loop = epp.LureSystem.from_tf(([0.5], [1.0, 2.0, 1.0]), epp.DeadZone(-10.0, 10.0))
    moved = replace(loop, x0=np.array([1.0, 1.0]))
    run = epp.simulate(moved, t_end=1e4, t_eval=[1e4])
    assert run.status is Status.SETTLED
    assert statistics(run)["fast_steps"] < 500
    assert abs(run.signals["x"][-1]) < 1e-15


def test_a_run_that_starts_at_rest_is_at_rest() -> None:
    """From its own rest, computed with rounding, the elbow does not move, and the verdict says so."""
    case = epp.case("fig8b_reduced_backlash")
    settled = epp.simulate(case.to_system(), case.input, t_end=6.0)
    search = epp.find_limit_cycles(case)
    again = replace(case.to_system(), x0=search.rest_state, v0=case.operating_point.vector(case.to_system()))
    run = epp.simulate(again, t_end=2.0)
    assert settled.status is run.status is Status.SETTLED
    assert all(event.time == 0.0 for event in run.events)  # modes find their places, nothing moves
    assert np.ptp(run.signals["theta"]) < 1e-12
